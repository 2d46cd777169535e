# SPDX-License-Identifier: GPL-3.0-or-later

"""Circles and splines of a copter: shape, speed, and how many straight pieces stand for them.

Pure geometry in metres; `copter_path.py` says which item is flown as which curve.

Rules
-----
* A circle (NAV_LOITER_TURNS) is flown at the lowest of three speeds: that of the mission, the one that takes half of
  WPNAV_ACCEL towards the middle, and CIRCLE_RATE. ArduCopter's defaults are assumed: 2.5 m/s^2 and 20 degrees/s.
* ArduCopter moves a target around the circle without telling its speed, and counts the target's turns. The aircraft
  flies after the target at a distance. So its own circle is smaller, and it brakes at the end, before the target's end
  (`ring`). Flown on ArduCopter 4.7-dev: 100 m at 10 m/s is 95.5 m, 60 m is 56.3 m, 200 m is 197.5 m; at 5 m/s 100 m is
  99.9 m. `ring` says 0.2 to 0.7 m less. Neither PSC_JERK_NE nor another parameter than the three above counts.
* A spline (NAV_SPLINE_WAYPOINT) is a cubic curve from its beginning to its end, with a velocity at each. Velocities
  that are together longer than four times the straight way are shortened to that. Half of WPNAV_ACCEL limits the speed
  where the curve bends.
* The straight pieces stay within WITHIN_M of the curve.

Sources: AC_Circle (`calc_velocities`, `update_cms`), AC_PosControl (`init_NE_controller_stopping_point`), AP_Math
(`shape_pos_vel_accel_xy`), SplineCurve (`update_solution`, `calc_dt_speed_max`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

__all__ = ["CIRCLE_RATE_DEG_S", "WITHIN_M", "Ring", "Spline", "Vector", "circle_pieces", "circle_rate", "ring"]

#: how far a straight piece may be from the curve that it stands for (m)
WITHIN_M: Final = 0.5
#: defaults of ArduCopter's WPNAV_ACCEL and CIRCLE_RATE
_ACCELERATION_MPSS: Final = 2.5
CIRCLE_RATE_DEG_S: Final = 20.0
#: part of the acceleration that a curve may take
_ACROSS: Final = 0.5
#: of the target's distance a speed (1/s), and of a difference of speeds an acceleration (1/s), with PSC_JERK_XY 5
_TO_SPEED, _TO_ACCELERATION = 1.0, 2.0
#: angle (radians) in which the aircraft comes nearer to the smaller circle by the factor e: flown, 90 to 120 m
_SETTLES: Final = 0.65
#: halvings of a radius until it is known to a millionth
_HALVINGS: Final = 20
#: SPLINE_FACTOR
_STRETCH: Final = 4.0
_FEWEST_ON_CIRCLE: Final = 12
_FEWEST_ON_SPLINE: Final = 4
#: slower than that no piece of a spline is counted: a cusp has no speed
_SLOWEST_MPS: Final = 0.5

#: metres east, north and up
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Ring:
    """The circle that is flown where another one was told: its radius (m) and its speed (m/s).

    The aircraft begins on the one that was told. It leaves at the angle `left` (radians) before the end of the last
    turn, `ends_m` from the middle.
    """

    told_m: float

    radius_m: float
    speed_mps: float
    left: float
    ends_m: float

    def after(self, angle: float) -> float:
        """Distance from the middle (m) after that angle (radians)."""
        return self.radius_m + (self.told_m - self.radius_m) * math.exp(-angle / _SETTLES)


def ring(told_m: float, speed_mps: float) -> Ring:
    """What is flown of a circle of that radius on a mission at that speed."""
    rate = circle_rate(told_m, speed_mps)
    inward = math.atan(rate / _TO_ACCELERATION)
    low_m, high_m = 0.0, told_m
    for _ in range(_HALVINGS):
        flown_m = (low_m + high_m) / 2.0
        ahead_m = _behind_m(rate * flown_m / math.cos(inward))
        reaches_m = math.hypot(flown_m - ahead_m * math.sin(inward), ahead_m * math.cos(inward))
        low_m, high_m = (low_m, flown_m) if reaches_m > told_m else (flown_m, high_m)
    lag = math.atan2(ahead_m * math.cos(inward), flown_m - ahead_m * math.sin(inward))
    stops_m = _braking_m(rate * flown_m)
    left = max(0.0, lag - math.atan2(stops_m, flown_m))
    return Ring(told_m, flown_m, rate * flown_m, left, min(told_m, math.hypot(flown_m, stops_m)))


def circle_rate(told_m: float, speed_mps: float) -> float:
    """Rate (radians/s) of the target on a circle of that radius, on a mission at that speed."""
    across_mps = math.sqrt(_ACROSS * _ACCELERATION_MPSS * told_m)
    return min(speed_mps / told_m, across_mps / told_m, math.radians(CIRCLE_RATE_DEG_S))


def _behind_m(speed_mps: float) -> float:
    """Distance from the target at which it is followed at that speed."""
    most = _ACROSS * _ACCELERATION_MPSS
    linear_mps = most / _TO_SPEED
    if speed_mps < linear_mps:
        return speed_mps / _TO_SPEED
    return speed_mps**2 / (2.0 * most) + linear_mps / (2.0 * _TO_SPEED)


def _braking_m(speed_mps: float) -> float:
    """How far on a stop from that speed is."""
    linear_mps = _ACCELERATION_MPSS / _TO_SPEED
    if speed_mps < linear_mps:
        return speed_mps / _TO_SPEED
    return speed_mps**2 / (2.0 * _ACCELERATION_MPSS) + linear_mps / (2.0 * _TO_SPEED)


def circle_pieces(radius_m: float) -> int:
    """Number of straight pieces of a circle of at least 1 m."""
    return max(_FEWEST_ON_CIRCLE, math.ceil(math.pi / math.acos(1.0 - WITHIN_M / max(1.0, radius_m))))


@dataclass(frozen=True, slots=True)
class Spline:
    """A spline that begins at (0, 0, 0): its end, and its velocities at both ends before they are shortened."""

    end: Vector
    velocity: Vector
    end_velocity: Vector

    def _terms(self) -> tuple[Vector, Vector, Vector]:
        """Factors of the time, its square and its cube. The time is 0 to 1."""
        together = _length(self.velocity) + _length(self.end_velocity)
        scale = min(1.0, _STRETCH * _length(self.end) / together) if together > 0.0 else 1.0
        first = _times(self.velocity, scale)
        last = _times(self.end_velocity, scale)
        square = _sum((self.end, 3.0), (first, -2.0), (last, -1.0))
        cube = _sum((self.end, -2.0), (first, 1.0), (last, 1.0))
        return first, square, cube

    @property
    def pieces(self) -> int:
        """Number of its straight pieces."""
        _first, square, cube = self._terms()
        # the second derivative is a straight line: it is longest at one of the ends
        most = max(_length(_times(square, 2.0)), _length(_sum((square, 2.0), (cube, 6.0))))
        return max(_FEWEST_ON_SPLINE, math.ceil(math.sqrt(most / (8.0 * WITHIN_M))))

    def points(self, pieces: int, speed_mps: float) -> list[tuple[Vector, float]]:
        """End and speed (m/s) of each straight piece, on a mission at that speed."""
        terms = self._terms()
        return [
            (self._place(terms, n / pieces), self._speed_mps(terms, (n - 0.5) / pieces, speed_mps))
            for n in range(1, pieces + 1)
        ]

    def _place(self, terms: tuple[Vector, Vector, Vector], time: float) -> Vector:
        first, square, cube = terms
        return self.end if time == 1.0 else _sum((first, time), (square, time**2), (cube, time**3))

    def _speed_mps(self, terms: tuple[Vector, Vector, Vector], time: float, speed_mps: float) -> float:
        first, square, cube = terms
        velocity = _sum((first, 1.0), (square, 2.0 * time), (cube, 3.0 * time**2))
        force = _sum((square, 2.0), (cube, 6.0 * time))
        pace = _length(velocity)
        if pace == 0.0:
            return min(speed_mps, _SLOWEST_MPS)
        along = sum(a * b for a, b in zip(force, velocity, strict=True)) / pace**2
        across = _length(_sum((force, 1.0), (velocity, -along)))
        if across == 0.0:
            return speed_mps
        bend_mps = pace * math.sqrt(_ACROSS * _ACCELERATION_MPSS / across)
        return min(speed_mps, max(_SLOWEST_MPS, bend_mps))


def _length(vector: Vector) -> float:
    return math.hypot(*vector)


def _times(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _sum(*parts: tuple[Vector, float]) -> Vector:
    east, north, up = (sum(vector[axis] * factor for vector, factor in parts) for axis in range(3))
    return east, north, up

# SPDX-License-Identifier: GPL-3.0-or-later

"""The guidance of ArduPlane (AP_L1_Control) in small steps: how wings fly along a line and around a circle.

Pure: no clock, no chance. The same start gives the same path.

Rules
-----
* The demand for turning is computed ten times a second, as ArduPlane does (`navigate`).
* Along a line, it is 4 damping^2 v^2 / ahead x sin(angle). `ahead` is the length that the guidance looks ahead:
  NAVL1_PERIOD x NAVL1_DAMPING / pi seconds of flight. The angle is that between the course and a point so far ahead on
  the line. A line that is far away is headed for at 45 degrees.
* Around a circle, it is the centripetal acceleration, and a part of the distance from the circle and of its rate.
  Outside of the circle the middle is headed for, as long as that needs less of a turn.
* The bank is limited (ROLL_LIMIT_DEG), and follows its demand with a delay (RLL2SRV_TCONST, 0.5 s). ArduPlane in SITL
  showed that delay: its bank comes to 45 degrees within 0.8 s and goes 5 degrees beyond it.
* The turn is coordinated: the heading changes by g tan(bank) / airspeed.

Sources: AP_L1_Control (`update_waypoint`, `update_loiter`), ArduPlane's `calc_nav_roll`, AP_RollController.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

__all__ = ["AHEAD_S", "STEP_S", "Flyer", "Point", "around_circle", "along_line"]

#: metres east and north
Point = tuple[float, float]

STEP_S: Final = 0.1
_GRAVITY_MPSS: Final = 9.80665
#: defaults of NAVL1_PERIOD and NAVL1_DAMPING
_PERIOD_S, _DAMPING = 17.0, 0.75
#: the guidance looks so many seconds ahead
AHEAD_S: Final = _PERIOD_S * _DAMPING / math.pi
_GAIN: Final = 4.0 * _DAMPING**2
_OMEGA: Final = math.tau / _PERIOD_S
#: on a circle: acceleration per metre outside of it, and per metre a second outward
_PER_METRE, _PER_SPEED = _OMEGA**2, 2.0 * _DAMPING * _OMEGA
_CAPTURE: Final = math.sin(math.radians(45.0))
#: RLL2SRV_TCONST, and the part of a difference in bank that is left after a step
_BANK_DELAY_S: Final = 0.5
_LEFT: Final = math.exp(-STEP_S / _BANK_DELAY_S)
#: the sideslip of a turn follows the bank with this delay (s; ArduPlane's planes in SITL), and its part of a step
_SLIP_DELAY_S: Final = 0.6
_SLIPS: Final = 1.0 - math.exp(-STEP_S / _SLIP_DELAY_S)
#: after the end of a line by so many seconds of flight, its end is headed for
_BEYOND_S: Final = 3.0
#: before the beginning of a line, in a cone of 45 degrees, that beginning is headed for
_BEHIND: Final = -math.cos(math.radians(45.0))
_LEAST_MPS: Final = 1.0
#: beyond that angle (radians) small differences decide to which side it turns
_ABOUT: Final = math.radians(170.0)


@dataclass(slots=True)
class Flyer:
    """An aircraft on its wings: place (m east and north of a point), heading and bank (radians), and time (s).

    `speed_mps`: its airspeed, the true one. `limit`: the largest bank. `turn_part`: see `Wings`. `about`: to which side
    it turns if it has to turn about, 1.0 to the right, -1.0 to the left.
    """

    east: float
    north: float
    heading: float
    speed_mps: float
    limit: float
    wind: Point = (0.0, 0.0)
    turn_part: float = 1.0
    about: float = 1.0
    bank: float = 0.0
    sideslip_mpss: float = 0.0
    time_s: float = 0.0

    @property
    def velocity(self) -> Point:
        """Over ground, east and north (m/s)."""
        return (
            self.speed_mps * math.sin(self.heading) + self.wind[0],
            self.speed_mps * math.cos(self.heading) + self.wind[1],
        )

    @property
    def ground_mps(self) -> float:
        """Speed over ground."""
        return max(_LEAST_MPS, math.hypot(*self.velocity))

    def step(self, demand_mpss: float) -> None:
        """Fly one step with that demand, to the right above 0."""
        wanted = max(-self.limit, min(self.limit, math.atan(demand_mpss / _GRAVITY_MPSS)))
        before = self.bank
        self.bank = wanted + (before - wanted) * _LEFT
        pull = _GRAVITY_MPSS * math.tan((before + self.bank) / 2.0)
        self.sideslip_mpss += ((1.0 - self.turn_part) * pull - self.sideslip_mpss) * _SLIPS
        turned = (pull - self.sideslip_mpss) / self.speed_mps * STEP_S
        middle = self.heading + turned / 2.0
        self.heading = math.remainder(self.heading + turned, math.tau)
        self.east += (self.speed_mps * math.sin(middle) + self.wind[0]) * STEP_S
        self.north += (self.speed_mps * math.cos(middle) + self.wind[1]) * STEP_S
        self.time_s += STEP_S


def along_line(flyer: Flyer, start: Point, end: Point) -> float:
    """The demand (m/s^2, to the right above 0) along a line."""
    east, north = end[0] - start[0], end[1] - start[1]
    length = math.hypot(east, north)
    if length < 1e-3:
        return _to(flyer, end)
    unit = (east / length, north / length)
    here = (flyer.east - start[0], flyer.north - start[1])
    away, along = math.hypot(*here), here[0] * unit[0] + here[1] * unit[1]
    speed = flyer.ground_mps
    ahead = AHEAD_S * speed
    if away > ahead and along < _BEHIND * away:
        return _to(flyer, start)
    if along > length + _BEYOND_S * speed:
        return _to(flyer, end)
    to_line = math.asin(max(-_CAPTURE, min(_CAPTURE, _cross(here, unit) / ahead)))
    return _demand(speed, _to_side(to_line + _angle(flyer.velocity, unit), flyer.about))


def around_circle(flyer: Flyer, middle: Point, radius_m: float, side: float) -> tuple[float, bool]:
    """The demand around a circle, and whether the aircraft is on it. `side`: 1.0 to the right, -1.0 to the left."""
    east, north = flyer.east - middle[0], flyer.north - middle[1]
    away = math.hypot(east, north)
    velocity = flyer.velocity
    unit = (east / away, north / away) if away > 0.1 else _direction(velocity)
    across, outward = _cross(unit, velocity), velocity[0] * unit[0] + velocity[1] * unit[1]
    to_middle = _demand(flyer.ground_mps, math.atan2(across, -outward))
    around = across * side
    pull = (away - radius_m) * _PER_METRE + outward * _PER_SPEED
    if outward > 0.0 and around < 0.0:
        pull = max(0.0, pull)
    demand = side * (pull + around * around / max(0.5 * radius_m, away))
    if away > radius_m and side * to_middle < side * demand:
        return to_middle, False
    return demand, True


def _to(flyer: Flyer, place: Point) -> float:
    unit = _direction((place[0] - flyer.east, place[1] - flyer.north))
    return _demand(flyer.ground_mps, _to_side(_angle(flyer.velocity, unit), flyer.about))


def _to_side(angle: float, about: float) -> float:
    """The angle, to the given side if it is about: ArduPlane may turn to either."""
    return math.copysign(angle, about) if abs(angle) > _ABOUT else angle


def _demand(speed_mps: float, angle: float) -> float:
    limited = max(-math.pi / 2.0, min(math.pi / 2.0, angle))
    return _GAIN * speed_mps / AHEAD_S * math.sin(limited)


def _angle(velocity: Point, unit: Point) -> float:
    """From the course to a direction, to the right above 0."""
    return math.atan2(_cross(velocity, unit), velocity[0] * unit[0] + velocity[1] * unit[1])


def _cross(one: Point, other: Point) -> float:
    return one[1] * other[0] - one[0] * other[1]


def _direction(vector: Point) -> Point:
    length = math.hypot(*vector)
    return (vector[0] / length, vector[1] / length) if length > 0.0 else (0.0, 1.0)

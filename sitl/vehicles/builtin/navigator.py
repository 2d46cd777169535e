# SPDX-License-Identifier: GPL-3.0-or-later

"""Flying along straight legs: the part that ArduPilot calls wpnav.

A leg runs from an origin to a destination in three dimensions; speed along it is bounded by the horizontal,
climb and descent limits together, as in ArduPilot's track calculation. Rules:

1. The aircraft stops at a destination unless the next one is known; then it rounds the corner, about half the waypoint
   radius away from it, as fast as the cornering acceleration allows.
2. A destination where the aircraft stops counts as reached inside the waypoint radius with the track flown to its end;
   one that it rounds counts as reached where the turn begins.
3. Pause brakes along the leg and resumes on it; it never leaves the track.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sitl.vehicles.builtin.frame import Vector

__all__ = ["Limits", "Navigator", "approach_speed", "pursue"]

_TRACK_GAIN = 1.0
_ARRIVED_M = 0.5
#: ArduPilot's tracks limit jerk as well; on the whole that costs this share of the acceleration when speeding up.
_SPEED_UP_SHARE = 0.65
#: Share of the waypoint radius by which ArduPilot's tracks cut a corner.
_CORNER_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the aircraft: m/s, m/s^2 and the waypoint radius in metres."""

    speed: float = 10.0
    up: float = 2.5
    down: float = 1.5
    accel: float = 2.5
    accel_up: float = 1.0
    corner_accel: float = 5.0
    radius: float = 2.0


def approach_speed(distance_m: float, accel: float, gain: float = _TRACK_GAIN) -> float:
    """Fastest speed from which a stop within `distance_m` works: proportional close by, square root further out."""
    if distance_m <= 0:
        return 0.0
    linear = accel / gain**2
    if distance_m <= linear:
        return gain * distance_m
    return math.sqrt(2 * accel * (distance_m - linear / 2))


def _unit(start: Vector, end: Vector) -> tuple[Vector, float]:
    delta = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    length = math.sqrt(delta[0] ** 2 + delta[1] ** 2 + delta[2] ** 2)
    if length < 1e-6:
        return (0.0, 0.0, 0.0), 0.0
    return (delta[0] / length, delta[1] / length, delta[2] / length), length


def _along(direction: Vector, horizontal: float, up: float, down: float) -> float:
    """Largest length along `direction` whose parts stay inside the horizontal and vertical limits."""
    flat = math.hypot(direction[0], direction[1])
    best = math.inf
    if flat > 1e-9:
        best = horizontal / flat
    if direction[2] > 1e-9:
        best = min(best, up / direction[2])
    elif direction[2] < -1e-9:
        best = min(best, down / -direction[2])
    return best if best < math.inf else 0.0


def pursue(position: Vector, destination: Vector, limits: Limits) -> Vector:
    """Velocity straight towards a destination that may move at any time, slowing down to stop there."""
    direction, distance = _unit(position, destination)
    accel = _along(direction, limits.accel, limits.accel_up, limits.accel_up)
    speed = min(_along(direction, limits.speed, limits.up, limits.down), approach_speed(distance, accel))
    return direction[0] * speed, direction[1] * speed, direction[2] * speed


class Navigator:
    """Leads the aircraft along legs and says when a destination is reached."""

    def __init__(self) -> None:
        self.limits = Limits()
        self.origin: Vector = (0.0, 0.0, 0.0)
        self.destination: Vector = (0.0, 0.0, 0.0)
        self.reached = True
        self.paused = False
        self._next: Vector | None = None
        self._direction: Vector = (0.0, 0.0, 0.0)
        self._length = 0.0
        self._corner_speed = 0.0
        self._corner_tan = 0.0
        self._speed = 0.0

    def begin(self, limits: Limits, stopping_point: Vector) -> None:
        """Start afresh: hold `stopping_point` until a destination comes."""
        self.limits = limits
        self.origin = self.destination = stopping_point
        self._direction, self._length = (0.0, 0.0, 0.0), 0.0
        self._next = None
        self.reached, self.paused = True, False
        self._speed = 0.0

    def set_limits(self, **changes: float) -> None:
        """Change speeds in flight; the leg goes on with the new ones."""
        self.limits = replace(self.limits, **changes)

    def fly_to(self, destination: Vector, speed_now: float) -> None:
        """Next leg: from the last destination if it was reached, otherwise from there by way of the present motion."""
        rounding = self._next is not None and self.reached
        self.origin = self.destination
        self.destination = destination
        self._direction, self._length = _unit(self.origin, destination)
        self._next = None
        self._corner_speed = self._corner_tan = 0.0
        self._speed = speed_now if rounding else min(speed_now, self._speed)
        self.reached = False

    def then(self, next_destination: Vector) -> None:
        """Announce what follows, so that the aircraft rounds the corner instead of stopping."""
        onward, length = _unit(self.destination, next_destination)
        if length == 0.0 or self._length == 0.0:
            return
        dot = sum(a * b for a, b in zip(self._direction, onward, strict=True))
        turn = math.acos(max(-1.0, min(1.0, dot)))
        cruise = min(self._cruise(self._direction), self._cruise(onward))
        accel = self.limits.corner_accel
        if turn < 1e-3:
            speed, tangent = cruise, 0.0
        elif turn > math.radians(175):
            return
        else:
            fillet = _CORNER_SHARE * self.limits.radius / (1 / math.cos(turn / 2) - 1)
            tangent = math.tan(turn / 2)
            fillet = min(fillet, min(self._length, length) / 2 / tangent)
            speed = min(cruise, math.sqrt(accel * fillet))
        self._next, self._corner_speed, self._corner_tan = next_destination, speed, tangent

    def distance_m(self, position: Vector) -> float:
        """Horizontal distance to the destination."""
        return math.hypot(self.destination[0] - position[0], self.destination[1] - position[1])

    def crosstrack_m(self, position: Vector) -> float:
        """Signed horizontal distance from the leg, positive to its right."""
        north, east = position[0] - self.origin[0], position[1] - self.origin[1]
        flat = math.hypot(self._direction[0], self._direction[1])
        if flat < 1e-6:
            return 0.0
        return (self._direction[0] * east - self._direction[1] * north) / flat

    def update(self, position: Vector, dt: float) -> Vector:
        """Velocity command for this step (m/s); sets `reached`."""
        limits = self.limits
        offset = tuple(d - p for d, p in zip(self.destination, position, strict=True))
        if self._length == 0.0:
            self.reached = True
            return self._hold(offset)
        remaining = sum(o * u for o, u in zip(offset, self._direction, strict=True))
        accel = self._accel(self._direction)
        speed = self._cruise(self._direction)
        turn_length = 0.0
        if self._next is None:
            speed = min(speed, approach_speed(remaining, accel))
        else:
            turn_length = self._speed**2 / limits.corner_accel * self._corner_tan
            speed = min(speed, math.sqrt(self._corner_speed**2 + 2 * accel * max(0.0, remaining - turn_length)))
        if self.paused:
            speed = 0.0
        self._speed = max(self._speed - 1.5 * accel * dt, min(self._speed + _SPEED_UP_SHARE * accel * dt, speed))
        if not self.reached and not self.paused:
            if self._next is not None:
                self.reached = remaining <= max(turn_length, 0.1)
            else:
                self.reached = remaining <= _ARRIVED_M and math.sqrt(sum(o * o for o in offset)) <= limits.radius
        if remaining < 0 and self._next is None:
            return self._hold(offset)
        across = tuple(o - remaining * u for o, u in zip(offset, self._direction, strict=True))
        side = self._hold((across[0], across[1], across[2]), limits.speed / 2)
        ahead = self._speed
        return (
            self._direction[0] * ahead + side[0],
            self._direction[1] * ahead + side[1],
            self._direction[2] * ahead + side[2],
        )

    def _hold(self, offset: tuple[float, ...], cap: float = math.inf) -> Vector:
        flat = math.hypot(offset[0], offset[1])
        pull = min(approach_speed(flat, self.limits.accel), self.limits.speed, cap) / flat if flat > 1e-9 else 0.0
        lift = math.copysign(approach_speed(abs(offset[2]), self.limits.accel_up), offset[2])
        return offset[0] * pull, offset[1] * pull, max(-self.limits.down, min(self.limits.up, lift))

    def _cruise(self, direction: Vector) -> float:
        return _along(direction, self.limits.speed, self.limits.up, self.limits.down)

    def _accel(self, direction: Vector) -> float:
        return _along(direction, self.limits.accel, self.limits.accel_up, self.limits.accel_up)

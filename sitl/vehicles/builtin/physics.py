# SPDX-License-Identifier: GPL-3.0-or-later

"""The airframe: a point mass that can change its velocity only so fast.

A velocity command comes in, the velocity follows it inside an acceleration limit, the position follows the
velocity. The ground is a plane at height 0. Heading turns at a limited rate. There is no drag and no lift-off weight.
Roll and pitch are what a multicopter would need to hold the acceleration; they are only reported.

Of the wind there is what it takes to be carried away by it: through the air the aircraft makes MAX_AIRSPEED_M_S, which
is what ArduCopter's lean limit allows in SITL. Where that is too little for what is wanted, it goes slower the same way
over ground; where it is too little to stand still, it is carried along. In calm air nothing is limited.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from sitl.vehicles.builtin.frame import Vector, bearing_deg

__all__ = ["MAX_AIRSPEED_M_S", "MAX_YAW_RATE_DEG_S", "Body", "made_good"]

MAX_YAW_RATE_DEG_S = 60.0
MAX_AIRSPEED_M_S = 10.0
_GRAVITY = 9.80665
#: Below this speed the direction of flight says nothing about the heading (ArduPilot's look-ahead threshold).
_HEADING_MIN_SPEED_M_S = 1.0


@dataclass(slots=True)
class Body:
    """Position and motion in the local frame: north, east, up, metres and seconds; heading in degrees."""

    position: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    acceleration: Vector = (0.0, 0.0, 0.0)
    heading_deg: float = 0.0
    yaw_rate_deg_s: float = 0.0
    ground_m: float = 0.0
    #: where the air moves to: north, east, m/s
    wind: tuple[float, float] = (0.0, 0.0)
    #: Set while the model stands still: then nothing is integrated.
    resting: bool = field(default=True)

    @property
    def ground_speed_m_s(self) -> float:
        return math.hypot(self.velocity[0], self.velocity[1])

    @property
    def on_ground(self) -> bool:
        return self.position[2] <= self.ground_m

    def rest(self) -> None:
        """Stand on the ground: no motion at all."""
        self.position = (self.position[0], self.position[1], self.ground_m)
        self.velocity = self.acceleration = (0.0, 0.0, 0.0)
        self.yaw_rate_deg_s = 0.0
        self.resting = True

    def drive(self, command: Vector, accel_ne: float, accel_up: float, dt: float) -> None:
        """Let the velocity follow `command` (m/s) for `dt` seconds, within both acceleration limits (m/s^2)."""
        self.resting = False
        vn, ve, vu = self.velocity
        north, east = made_good((command[0], command[1]), self.wind)
        dn, de = north - vn, east - ve
        change = math.hypot(dn, de)
        room = accel_ne * dt
        if change > room:
            dn, de = dn * room / change, de * room / change
        du = max(-accel_up * dt, min(accel_up * dt, command[2] - vu))
        new = (vn + dn, ve + de, vu + du)
        n, e, u = self.position
        n += (vn + new[0]) / 2 * dt
        e += (ve + new[1]) / 2 * dt
        u += (vu + new[2]) / 2 * dt
        self.acceleration = (dn / dt, de / dt, du / dt)
        if u <= self.ground_m and new[2] <= 0:
            u, new = self.ground_m, (0.0, 0.0, 0.0)
        self.position, self.velocity = (n, e, u), new

    def turn(self, wanted_deg: float | None, dt: float) -> None:
        """Turn towards `wanted_deg`; None: towards the direction of flight, or hold when too slow for one."""
        if wanted_deg is None:
            if self.ground_speed_m_s < _HEADING_MIN_SPEED_M_S:
                self.yaw_rate_deg_s = 0.0
                return
            wanted_deg = bearing_deg(self.velocity[0], self.velocity[1])
        error = (wanted_deg - self.heading_deg + 180.0) % 360.0 - 180.0
        step = max(-MAX_YAW_RATE_DEG_S * dt, min(MAX_YAW_RATE_DEG_S * dt, error))
        self.heading_deg = (self.heading_deg + step) % 360.0
        self.yaw_rate_deg_s = step / dt

    def roll_pitch_rad(self) -> tuple[float, float]:
        """Lean that holds the present acceleration, radians (right wing down and nose up are positive)."""
        heading = math.radians(self.heading_deg)
        an, ae, _ = self.acceleration
        forward = an * math.cos(heading) + ae * math.sin(heading)
        right = -an * math.sin(heading) + ae * math.cos(heading)
        return math.atan2(right, _GRAVITY), -math.atan2(forward, _GRAVITY)


def made_good(wanted: tuple[float, float], wind: tuple[float, float]) -> tuple[float, float]:
    """The velocity over ground (north, east, m/s) that is reached in a wind."""
    strength = math.hypot(*wind)
    if strength == 0.0 or math.hypot(wanted[0] - wind[0], wanted[1] - wind[1]) <= MAX_AIRSPEED_M_S:
        return wanted
    if strength > MAX_AIRSPEED_M_S:
        share = 1.0 - MAX_AIRSPEED_M_S / strength
        return wind[0] * share, wind[1] * share
    # the largest share of `wanted` that needs no more than that through the air: |share * wanted - wind| = the most
    square, along = wanted[0] ** 2 + wanted[1] ** 2, wanted[0] * wind[0] + wanted[1] * wind[1]
    share = (along + math.sqrt(along**2 + square * (MAX_AIRSPEED_M_S**2 - strength**2))) / square
    return wanted[0] * share, wanted[1] * share

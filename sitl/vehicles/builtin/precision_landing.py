# SPDX-License-Identifier: GPL-3.0-or-later

"""Precision landing: what a LANDING_TARGET in the body frame does to a descent, as in ArduCopter.

With PLND_ENABLED and PLND_TYPE 1, the aircraft moves over the target while it comes down. It does not come down while
the target is more than PLND_XY_DIST_MAX away. A target that is silent for two seconds is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.builtin.physics import Body

__all__ = ["PrecisionLanding"]

_LOST_S = 2.0
_MOST_M_S = 3.0
_XY_DIST_MAX_M = 2.5


class PrecisionLanding:
    """The target of one aircraft. Times are simulated seconds."""

    def __init__(self, parameters: ParameterTable, say: Callable[[int, str], None]) -> None:
        self._parameters = parameters
        self._say = say
        self._target: tuple[float, float] | None = None
        self._seen_at_s = -math.inf

    def take(self, m: dialect.MAVLink_landing_target_message, body: Body, now_s: float) -> None:
        """A LANDING_TARGET has come: angles from straight down, in the body frame, and a distance."""
        p = self._parameters
        if p["PLND_ENABLED"] != 1 or p["PLND_TYPE"] != 1 or not m.distance > 0.0:
            return
        forward, right = -math.tan(m.angle_y), math.tan(m.angle_x)
        slope = math.hypot(forward, right, 1.0)
        forward, right = forward * m.distance / slope, right * m.distance / slope
        heading = math.radians(body.heading_deg)
        north, east, _up = body.position
        if self._target is None:
            self._say(6, "PrecLand: Target Found")
        self._target = (
            north + forward * math.cos(heading) - right * math.sin(heading),
            east + forward * math.sin(heading) + right * math.cos(heading),
        )
        self._seen_at_s = now_s

    def steer(self, down_m_s: float, body: Body, now_s: float) -> tuple[float, float, float]:
        """The velocity (north, east, up) of a descent that would come straight down at this rate."""
        if self._target is not None and now_s - self._seen_at_s > _LOST_S:
            self._say(2, "PrecLand: Target Lost")
            self._target = None
        if self._target is None or body.on_ground:
            return 0.0, 0.0, -down_m_s
        north, east = (there - here for there, here in zip(self._target, body.position, strict=False))
        away_m = math.hypot(north, east)
        share = min(1.0, _MOST_M_S / away_m) if away_m > 0.0 else 0.0
        return north * share, east * share, 0.0 if away_m > _XY_DIST_MAX_M else -down_m_s

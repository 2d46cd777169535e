# SPDX-License-Identifier: GPL-3.0-or-later

"""The true cost of flying: power, speed in the wind, and the way home, computed only from numbers.

No line of the rules is used here. The aircraft's consumption and the judge's demands use it, so that a fault in the
rules' own computation (`core/safety/energy.py`) is found. Unlike there a tail wind helps, and nothing is lost in
speeding up and braking: what is out of reach here is out of reach for the rules by far.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, radians, sin, sqrt
from typing import Final

from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import Spot, bearing_deg

__all__ = ["Physics"]

#: ArduCopter's WPNAV_SPEED_UP, WPNAV_SPEED_DN, LAND_SPEED (m/s), LAND_ALT_LOW (m) and RTL_LOIT_TIME (s)
CLIMB_MPS, DESCENT_MPS, LANDING_MPS, LANDING_BELOW_M, LOITER_S = 2.5, 1.5, 0.5, 10.0, 5.0
_HOUR_S: Final = 3600.0


@dataclass(frozen=True, slots=True)
class Physics:
    """One aircraft in one wind. Powers in W: in level flight at `cruise_mps`, the others at rest; speeds in m/s."""

    hover_w: float
    cruise_w: float
    climb_w: float
    descent_w: float
    cruise_mps: float
    #: the fastest airspeed that it can hold
    airspeed_mps: float
    wind_mps: float
    from_deg: float
    #: the height (m) of a return at the least, and what the rules are to keep: a part of the need, and Wh beyond it
    return_alt_m: float
    reserve_factor: float
    reserve_wh: float
    #: without a wind report: the headwind that the rules have to expect in every direction
    headwind_mps: float | None

    @classmethod
    def of(cls, plan: FlightPlan) -> Physics:
        """The physics of a flight."""
        model, wind = plan.model(), plan.truth.wind
        return cls(
            model.hover_w,
            model.cruise_w,
            model.climb_w,
            model.descent_w,
            model.cruise_mps,
            model.airspeed_mps,
            wind.speed_mps,
            wind.from_deg,
            model.return_alt_m,
            model.reserve_factor,
            model.reserve_wh,
            None if plan.truth.tells_wind else model.headwind_mps,
        )

    def power_w(self, airspeed_mps: float) -> float:
        """In level flight: drag's power grows with the cube of the airspeed."""
        return self.hover_w + max(0.0, self.cruise_w - self.hover_w) * (airspeed_mps / self.cruise_mps) ** 3

    @property
    def still_w(self) -> float:
        """At rest in the wind."""
        return self.power_w(min(self.wind_mps, self.airspeed_mps))

    def against(self, east: float, north: float) -> tuple[float, float]:
        """The wind against a flight in that direction: from ahead (below 0: a tail wind), and across (m/s)."""
        angle = radians(self.from_deg - bearing_deg(east, north))
        return self.wind_mps * cos(angle), self.wind_mps * sin(angle)

    def most_mps(self, ahead: float, across: float) -> float:
        """The fastest ground speed in that wind; not above 0: it cannot be flown."""
        return sqrt(max(0.0, self.airspeed_mps**2 - across**2)) - ahead

    def down_wh(self, height_m: float) -> float:
        """The energy for coming straight down."""
        low = min(height_m, LANDING_BELOW_M)
        return self.descent_w * ((height_m - low) / DESCENT_MPS + low / LANDING_MPS) / _HOUR_S

    def home_wh(self, here: tuple[float, float, float], place: Spot) -> float:
        """Energy of the way home: up to the height of the return, straight there, a pause, and down.

        Infinite if the wind does not let it be flown.
        """
        x, y, z = here
        height = max(z, place.alt_m, self.return_alt_m)
        ahead, across = self.against(place.x_m - x, place.y_m - y)
        if self.headwind_mps is not None:
            ahead, across = self.headwind_mps, 0.0
        speed = min(self.cruise_mps, self.most_mps(ahead, across))
        away = place.away_m(x, y)
        if speed <= 0.0 < away:
            return inf
        level_j = self.power_w(min(self.airspeed_mps, hypot(speed + ahead, across))) * away / speed if away else 0.0
        joules = self.climb_w * (height - z) / CLIMB_MPS + level_j + self.still_w * LOITER_S
        return joules / _HOUR_S + self.down_wh(height)

    def budget_wh(self, need_wh: float) -> float:
        """The energy that must be left for that."""
        return self.reserve_factor * need_wh + self.reserve_wh

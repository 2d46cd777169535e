# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts that the turns of wings depend on: radius, beginning, sideslip, airspeed at a height, ground speed.

The turns themselves are flown in small steps (`l1_guidance.py`, `path.py`).

Rules
-----
* A level turn at bank b and ground speed v has the radius v^2 / (part g tan b). The bank is ROLL_LIMIT_DEG. The speed
  is the fastest that the wind allows. `turn_part` is 1 for an aircraft that turns without sideslip. The plane of SITL
  turns with 0.67 of that: the force of its sideslip holds against the turn.
* A turn may be wider than that radius says. The demand of ArduPlane's guidance falls with the angle to the next
  line. So its bank falls before the end of the turn. After 135 degrees at 22 m/s the plane of SITL was 76 m outside.
* ArduPlane flies past its waypoints: it takes the next one when it is nearer than the turn distance. That is the
  smaller of WP_RADIUS and the length that its guidance looks ahead. Turns of less than 90 degrees have their part of
  that (`verify_nav_wp`, `turn_distance`). Parameter 2 of the item replaces that distance. Parameter 3 has it fly past
  the place first.
* A circle (NAV_LOITER_*) has the radius of its item or WP_LOITER_RAD. It is flown wider with sideslip, of which the
  guidance does not know: 118 m instead of 100 m in SITL at 23 m/s.
* ArduPlane holds an airspeed as it is at the sea (`true_airspeed_factor`). Its radii grow with the square of that.
* Over ground it makes sqrt(airspeed^2 - across^2) and the wind along. If the wind is not known, a tail wind is assumed
  everywhere: then there is least time, and the turns are widest.

Defaults are ArduPlane's (4.7): ROLL_LIMIT_DEG 45, WP_RADIUS 90, WP_LOITER_RAD 60, NAVL1_PERIOD 17, NAVL1_DAMPING 0.75,
AIRSPEED_CRUISE 12.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.mission.l1_guidance import AHEAD_S

__all__ = [
    "AS_IT_COMES",
    "HOVER_MPS",
    "ROLL_IN_S",
    "Air",
    "Wings",
    "true_airspeed_factor",
    "turn_end_m",
]

#: Q_WP_SPD of ArduPlane
HOVER_MPS: Final = 5.0
_GRAVITY_MPSS: Final = 9.80665
#: what the bank takes to come
ROLL_IN_S: Final = 1.0
#: how steeply a line is headed for
_CAPTURE: Final = math.radians(45.0)
#: slower than that over ground nothing gets anywhere
_LEAST_MPS: Final = 1.0
#: of the standard atmosphere: how temperature falls with height (part of that at the sea), and density with temperature
_LAPSE_PER_M, _DENSITY_POWER = 2.25577e-5, 4.25588


@dataclass(frozen=True, slots=True)
class Wings:
    """The table [wings]: what the autopilot is set to where turns are concerned."""

    #: ROLL_LIMIT_DEG
    bank_deg: float = 45.0
    #: WP_RADIUS
    waypoint_m: float = 90.0
    #: WP_LOITER_RAD, without its sign
    circle_m: float = 60.0
    #: acceleration of a turn, as a part of that of one without sideslip
    turn_part: float = 0.67

    def turn_radius_m(self, speed_mps: float) -> float:
        """Radius of a turn at that ground speed, with its sideslip."""
        return speed_mps**2 / (self.turn_part * _GRAVITY_MPSS * math.tan(math.radians(self.bank_deg)))

    def turn_distance_m(self, speed_mps: float, turn_deg: float, faster: float = 1.0) -> float:
        """Distance before a waypoint at which a turn of that angle begins. `faster`: see `true_airspeed_factor`."""
        return min(self.waypoint_m * faster**2, AHEAD_S * speed_mps) * min(1.0, abs(turn_deg) / 90.0)

    def circle_radius_m(self, wanted_m: float, speed_mps: float) -> float:
        """Radius of a circle whose item has this radius, 0: none."""
        return max(abs(wanted_m) or self.circle_m, self.turn_radius_m(speed_mps))

    def reach_m(self, speed_mps: float) -> float:
        """Distance from a waypoint within which an aircraft at that ground speed may be beside its legs."""
        return self.turn_distance_m(speed_mps, 90.0) + 2.0 * self.turn_radius_m(speed_mps)


#: with ArduPlane's own settings
AS_IT_COMES: Final = Wings()


@dataclass(frozen=True, slots=True)
class Air:
    """An airspeed, and the wind; None: unknown, and `unknown_mps` come from any direction."""

    airspeed_mps: float
    wind: Wind | None = None
    unknown_mps: float = 0.0

    @property
    def wind_mps(self) -> float:
        """How strong it blows."""
        return self.unknown_mps if self.wind is None else self.wind.speed_mps

    @property
    def blows(self) -> tuple[float, float]:
        """How it moves the aircraft, east and north (m/s)."""
        if self.wind is None:
            return 0.0, 0.0
        angle = math.radians(self.wind.from_deg)
        return -self.wind.speed_mps * math.sin(angle), -self.wind.speed_mps * math.cos(angle)

    @property
    def fastest_mps(self) -> float:
        """Ground speed with a tail wind."""
        return self.airspeed_mps + self.wind_mps

    def flies(self, bearing_deg: float) -> bool:
        """True if the wind allows that direction."""
        return self._made_mps(bearing_deg) > _LEAST_MPS

    def ground_mps(self, bearing_deg: float) -> float:
        """The ground speed in that direction, at the most."""
        return max(_LEAST_MPS, self._made_mps(bearing_deg))

    def _made_mps(self, bearing_deg: float) -> float:
        if self.wind is None:
            return self.fastest_mps
        angle = math.radians(self.wind.from_deg - bearing_deg)
        across, along = self.wind.speed_mps * math.sin(angle), -self.wind.speed_mps * math.cos(angle)
        if abs(across) >= self.airspeed_mps:
            return 0.0
        return math.sqrt(self.airspeed_mps**2 - across**2) + along


def turn_end_m(turn_deg: float, before_m: float, radius_m: float) -> float:
    """How far along the next line a turn of that angle ends.

    The turn begins `before_m` before the corner (below 0: after it). It has that radius, or a wider one that begins and
    ends as far from the corner. If it comes outside of the line, it swings back to it at 45 degrees at the most.
    """
    turn = math.radians(turn_deg)
    if 0.0 < turn < math.pi and before_m >= radius_m * math.tan(turn / 2.0):
        return before_m
    outside = radius_m * (1.0 - math.cos(turn)) - before_m * math.sin(turn)
    along = radius_m * math.sin(turn) - before_m * math.cos(turn)
    if outside <= 0.0:
        return along
    swing = min(_CAPTURE, math.acos(max(0.0, 1.0 - outside / (2.0 * radius_m))))
    straight = max(0.0, outside - 2.0 * radius_m * (1.0 - math.cos(swing))) / math.tan(swing)
    return along + 2.0 * radius_m * math.sin(swing) + straight


def true_airspeed_factor(above_sea_m: float) -> float:
    """How much faster an airspeed is at that height than at the sea, in the standard atmosphere."""
    part = max(0.1, 1.0 - _LAPSE_PER_M * above_sea_m)
    return math.pow(part, -_DENSITY_POWER / 2.0)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Turns of wings: radius, beginning, distance outside the next leg, and ground speed.

Rules
-----
* A level turn at bank b and ground speed v has the radius r = v^2 / (g tan b). The bank is ROLL_LIMIT_DEG; the speed is
  the fastest that the wind allows, airspeed and wind together, so no turn is wider than it is told here.
* ArduPlane flies past its waypoints: it takes the next one when it is nearer than the turn distance. That is the
  smaller of WP_RADIUS and the length that its navigation looks ahead (AP_L1_Control: NAVL1_PERIOD x NAVL1_DAMPING / pi
  seconds of flight), in proportion for turns of less than 90 degrees (`verify_nav_wp`, `turn_distance`). Parameter 2 of
  the item replaces that distance, parameter 3 has it fly past the place first. The bank takes a second to come: so much
  later the turn begins (ArduPlane 4.7 in SITL: 0.85 s at 22 m/s and 30 degrees, 0.95 s at 30 m/s and 90 degrees).
* A turn that begins early enough, at r tan(angle / 2) or before, stays inside the corner. One that begins later comes
  outside the next leg, by r (1 - cos angle) - distance sin angle, and swings back at 45 degrees at the most, which is
  how steeply ArduPlane heads for a line.
* A circle (NAV_LOITER_*) is flown with the radius of its item or WP_LOITER_RAD, and never narrower than a turn.
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

__all__ = [
    "AS_IT_COMES",
    "HOVER_MPS",
    "ROLL_IN_S",
    "Air",
    "Bend",
    "Wings",
    "bend",
]

#: Q_WP_SPD of ArduPlane
HOVER_MPS: Final = 5.0
_GRAVITY_MPSS: Final = 9.80665
#: NAVL1_PERIOD x NAVL1_DAMPING / pi: so many seconds ahead the navigation looks
_AHEAD_S: Final = 17.0 * 0.75 / math.pi
#: what the bank takes to come
ROLL_IN_S: Final = 1.0
#: how steeply a line is headed for
_CAPTURE: Final = math.radians(45.0)
#: slower than that over ground nothing gets anywhere
_LEAST_MPS: Final = 1.0
#: an arc is a row of straight pieces, each for at most so much of it
_PIECE: Final = math.radians(15.0)


@dataclass(frozen=True, slots=True)
class Wings:
    """The table [wings]: what the autopilot is set to where turns are concerned."""

    #: ROLL_LIMIT_DEG
    bank_deg: float = 45.0
    #: WP_RADIUS
    waypoint_m: float = 90.0
    #: WP_LOITER_RAD, without its sign
    circle_m: float = 60.0

    def turn_radius_m(self, speed_mps: float) -> float:
        """Radius of a turn at that ground speed."""
        return speed_mps**2 / (_GRAVITY_MPSS * math.tan(math.radians(self.bank_deg)))

    def turn_distance_m(self, speed_mps: float, turn_deg: float) -> float:
        """Distance before a waypoint at which a turn of that angle begins."""
        return min(self.waypoint_m, _AHEAD_S * speed_mps) * min(1.0, abs(turn_deg) / 90.0)

    def circle_radius_m(self, wanted_m: float, speed_mps: float) -> float:
        """Radius of a circle whose item has this radius, 0: none."""
        return max(abs(wanted_m) or self.circle_m, self.turn_radius_m(speed_mps))

    def reach_m(self, speed_mps: float) -> float:
        """Distance from a waypoint within which an aircraft at that ground speed may be beside its legs."""
        return self.turn_distance_m(speed_mps, 90.0) + 3.0 * self.turn_radius_m(speed_mps)


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


@dataclass(frozen=True, slots=True)
class Bend:
    """The path around a waypoint.

    Places (m) along the leg to it, and beside that, to the side of the turn. It begins `before_m` before the waypoint,
    comes at most `outside_m` outside the next leg, and is on that leg `after_m` after the waypoint.
    """

    places: tuple[tuple[float, float], ...]
    radius_m: float
    before_m: float
    outside_m: float
    after_m: float


def bend(turn_deg: float, before_m: float, radius_m: float) -> Bend:
    """A turn of that angle (0 to 180) and at least that radius.

    It begins `before_m` before a waypoint (below 0: after it).
    """
    turn = math.radians(turn_deg)
    reach = before_m / math.tan(turn / 2.0) if 0.0 < turn < math.pi and before_m > 0.0 else 0.0
    if reach >= radius_m:  # begun early enough: wide, and inside the corner
        places = tuple((-before_m + reach * math.sin(a), reach * (1.0 - math.cos(a))) for a in _angles(0.0, turn))
        return Bend(places, reach, before_m, 0.0, before_m)
    cos, sin = math.cos(turn), math.sin(turn)
    outside = radius_m * (1.0 - cos) - before_m * sin
    # half of what it is outside is turned away, and half turned back
    swing = min(_CAPTURE, math.acos(max(0.0, 1.0 - outside / (2.0 * radius_m)))) if outside > 0.0 else 0.0
    found = [(-before_m + radius_m * math.sin(a), radius_m * (1.0 - math.cos(a))) for a in _angles(0.0, turn + swing)]
    along, beside = found[-1]
    straight = max(0.0, outside - 2.0 * radius_m * (1.0 - math.cos(swing))) / math.sin(swing) if swing > 0.0 else 0.0
    end = turn + swing
    along, beside = along + straight * math.cos(end), beside + straight * math.sin(end)
    if straight > 0.0:
        found.append((along, beside))
    # the way back has its middle on the other side
    middle = (along + radius_m * math.sin(end), beside - radius_m * math.cos(end))
    found += [(middle[0] - radius_m * math.sin(a), middle[1] + radius_m * math.cos(a)) for a in _angles(end, turn)[1:]]
    along, beside = found[-1]
    return Bend(tuple(found), radius_m, before_m, max(0.0, outside), along * cos + beside * sin)


def _angles(first: float, last: float) -> list[float]:
    """From one to the other, in pieces."""
    count = max(1, math.ceil(abs(last - first) / _PIECE - 1e-9))
    return [first + (last - first) * number / count for number in range(count + 1)]

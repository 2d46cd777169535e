# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the autopilot's own parameters that would defeat what the companion counts on.

Most are those of its failsafes: battery, geofence and return. The others are speeds, circles, terrain and gripper. The
checks are a table, `CHECKS`, whose findings `monitors/preflight/rules.py` adds to its own: they are warnings. Two
functions are no rows of it, because what they find makes START refuse: `circles_for_ever` and `no_terrain`.

The checks rest on these facts:

* Only plain RTL goes to the return site, the one point of the rally list, and only if home is no alternative to it.
  SMART_RTL flies back along its track, AUTO_RTL along the mission's landing sequence.
* A fence that is stored but not enabled has no effect.
* ArduCopter's own fences, around home and above it, end a mission that leaves them.
* Each battery monitor has failsafes of its own, which act on the whole aircraft. Those of all packs in flight
  (`batteries` of [energy]) are read and judged alike.
* A plane that returns circles for ever, unless the mission's landing sequence (RTL_AUTOLAND) or its rotors (Q_RTL_MODE)
  end that. Otherwise START is refused (`circles_for_ever`).

Names and units differ by firmware: RTL_ALT, RTL_ALT_FINAL, RTL_CLIMB_MIN of copters and RTL_SPEED are centimetres (a
second), RTL_ALT_M, RTL_ALT_FINAL_M, RTL_CLIMB_MIN_M and RTL_SPEED_MS (from 4.7 on) metres. The same holds for
WPNAV_SPEED* and WP_SPD*, LAND_SPEED and LAND_SPD_MS. The energy rule counts climb, descent and landing by fixed
numbers. They are compared with the parameters: a slower autopilot needs more energy than is counted.

Sources: ArduCopter's and ArduPlane's Parameters.cpp, Plane.h (`_failsafe_priorities`), events.cpp, mode_rtl.cpp and
fence.cpp of the latter, AP_BattMonitor (`check_failsafes`), AC_Fence; docs of the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, inf
from typing import Final

from mavproxy_handover.core.safety.energy import (
    ACCELERATION_MPSS,
    CLIMB_MPS,
    DESCENT_MPS,
    LANDING_BELOW_M,
    LANDING_MPS,
    LOITER_S,
)
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.switches import switch_name, switch_rule
from mavproxy_handover.mission.curves import circle_rate
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.heights import above_sea, above_terrain, low_ways, named
from mavproxy_handover.mission.items import GRIPPER, LANDINGS, LOITER_TURNS, TAKEOFFS, MissionItem, stored_radius_m
from mavproxy_handover.mission.plan import Route, first_in_air, ways_from_land_starts
from mavproxy_handover.mission.route_simulation import cruise_of, legs_of, speed_at
from mavproxy_handover.vehicle.profiles import SWITCHED, Profile, RuleGroup
from mavproxy_handover.vehicle.return_limits import BELOW_CEILING_M

__all__ = [
    "CHECKS",
    "PlanFacts",
    "circles_for_ever",
    "further_names",
    "further_checks",
    "no_terrain",
    "plan_facts",
]

#: the parameters that are read of each further battery monitor, without their prefix: BATT2_MONITOR and so on
_OF_MONITOR: Final = ("MONITOR", "FS_LOW_ACT", "FS_CRT_ACT", "LOW_VOLT", "LOW_MAH")

#: tolerance (degrees a second): parameters have 24 bits, and settings are rounded
_ROUNDED_DEG_S: Final = 0.01


@dataclass(frozen=True, slots=True)
class PlanFacts:
    """The facts of a plan that concern the autopilot's own limits."""

    #: it has a geofence
    fence: bool
    #: number of its inclusion areas
    inclusions: int
    #: greatest distance of the route from home, and greatest height above home (m)
    farthest_m: float
    highest_m: float
    #: it has a landing sequence, and the nearest one always lands
    lands: bool = False
    #: item number of a DO_LAND_START whose landing sequence has no landing; None: there is none
    aloft: int | None = None
    #: home above the sea (m)
    home_alt_m: float = 0.0
    #: items with heights above the sea, and above terrain
    above_sea: tuple[MissionItem, ...] = ()
    above_terrain: tuple[MissionItem, ...] = ()
    #: it brings heights of the ground
    ground: bool = False
    #: the greatest rate of its circles in the energy rule (degrees a second); 0: it has no circles
    circle_deg_s: float = 0.0
    #: the speed that it was checked with (m/s), an airspeed for wings; None: not known
    cruise_mps: float | None = None
    #: the ways at or near home's height, in words; "": none
    low: str = ""
    #: number of its first DO_GRIPPER; None: it has none
    gripper: int | None = None
    #: what it begins with, in words, if that is no take-off; "": it takes off
    begins_with: str = ""


def plan_facts(route: Route, cruise_mps: float | None = None) -> PlanFacts:
    """The facts of a route, checked with that speed. Takes a few milliseconds for up to MAX_ITEMS items."""
    home = route.home.lat_deg, route.home.lon_deg
    legs = legs_of(route, cruise_mps)
    farthest_m = max(distance_m(*home, *leg.end[:2]) for leg in legs)
    highest_m = max(leg.end[2] for leg in legs)
    inclusions, ways = sum(part.inclusion for part in route.fence), ways_from_land_starts(route.items)
    aloft = next((way[0].seq for way in ways if way[-1].command not in LANDINGS), None)
    first = first_in_air(route.items)
    return PlanFacts(
        bool(route.fence),
        inclusions,
        farthest_m,
        highest_m,
        bool(ways) and aloft is None,
        aloft,
        route.home.alt_m,
        above_sea(route),
        above_terrain(route),
        route.ground is not None,
        0.0 if route.profile.flies_past else _circle_deg_s(route, cruise_of(route, cruise_mps)),
        cruise_mps,
        next((low.text for low in low_ways(route, legs)), ""),
        next((item.seq for item in route.items if item.command == GRIPPER), None),
        "" if first is None or first.command in TAKEOFFS else named(first),
    )


def _circle_deg_s(route: Route, cruise_mps: float) -> float:
    """The greatest rate of a copter's circles in the energy rule."""
    circles = (item for item in route.items if item.command == LOITER_TURNS)
    rates = (
        circle_rate(abs(stored_radius_m(item.param3)), speed_at(route, item.seq) or cruise_mps) for item in circles
    )
    return degrees(max(rates, default=0.0))


Parameters = Mapping[str, float]
ParameterCheck = Callable[[Parameters, "PlanFacts | None"], "str | None"]
#: parameter to change ("": none), check, and the group that it belongs to
CheckRow = tuple[str, ParameterCheck, RuleGroup]

# ---- the way home -------------------------------------------------------------------------------------------------

_SMART, _AUTO, _MOTORS_OFF = (
    "SMART_RTL flies back the way it came, not to the return site",
    "AUTO_RTL follows the mission's landing sequence, and does not go to the return site",
    "stops the motors in the air",
)
#: actions that the batteries' failsafes and that of dead reckoning take alike (`Copter::do_failsafe_action`)
_ACTIONS: Final = {3: _SMART, 4: _SMART, 5: _MOTORS_OFF, 6: _AUTO}
#: parameter -> its values with which a failsafe goes neither to the return site nor lands, and what it does instead
_WAYS: Final[Mapping[str, Mapping[int, str]]] = {
    "HNDO_ACTION": {2: _SMART},
    "FS_GCS_ENABLE": {3: _SMART, 4: _SMART, 6: _AUTO},
    "FS_THR_ENABLE": {4: _SMART, 5: _SMART, 6: _AUTO},
    "FS_DR_ENABLE": _ACTIONS,
    "FENCE_ACTION": {3: _SMART, 5: _SMART},
}


_SEQUENCE, _AUTOLAND, _GLIDE, _NO_FENCE, _AROUND = (
    "the return goes straight to the mission's landing sequence, not to the return site",
    "AUTOLAND lands at home, not at the return site",
    "glides without a motor, wherever it is",
    "ArduPlane knows no such action: nothing is done",
    "circles at the fence's own return point, and does not go to the return site",
)
_WINGED_ACTIONS: Final = {3: _MOTORS_OFF, 5: "releases the parachute in the air", 7: _AUTOLAND}
#: the same of aircraft with wings
_WINGED_WAYS: Final[Mapping[str, Mapping[int, str]]] = {
    "HNDO_ACTION": {2: "SMART_RTL is no mode of ArduPlane"},
    "FS_LONG_ACTN": {
        0: "the failsafes let a mission go on without radio and ground station",
        2: _GLIDE,
        3: "the failsafes release the parachute",
        4: "the failsafes fly the mission on",
        5: _AUTOLAND,
    },
    "FS_SHORT_ACTN": {2: _GLIDE, 4: "flies on straight ahead, by hand, without a radio"},
    "FENCE_ACTION": {**dict.fromkeys((2, 3, 4, 5), _NO_FENCE), 6: _AROUND, 7: _AROUND, 8: _AUTOLAND},
    "RTL_AUTOLAND": {2: _SEQUENCE, 4: _SEQUENCE},
    "MIS_RESTART": {1: "CONTINUE, and AUTO after a return, begin the mission again"},
}


def _way(name: str, ways: Mapping[int, str]) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        if name not in p:
            return None
        value = int(p[name])
        way = ways.get(value)
        return None if way is None else f"is {value}: {way}"

    return check


#: RTL_AUTOLAND that lands by the mission's sequence, and Q_RTL_MODE that lands by rotors
_BY_SEQUENCE, _BY_ROTORS = (1, 2), (1, 2, 3)


def circles_for_ever(p: Parameters | None, plan: PlanFacts | None, profile: Profile) -> str:
    """Why a return does not end in a landing, in words; "" if it does, or no mission is known.

    `p` None: not read yet. START asks this: an aircraft that circles has not come back.
    """
    if not profile.holds_by_circling or plan is None:
        return ""
    if plan.aloft is not None:
        return f"it would never land: the landing sequence of item {plan.aloft} (DO_LAND_START) comes to no landing"
    if p is None:
        return "its parameters are not read yet"
    if profile.vertical and int(p.get("Q_RTL_MODE", 0)) in _BY_ROTORS:
        return ""
    sequence = int(p.get("RTL_AUTOLAND", 0)) in _BY_SEQUENCE
    if plan.lands and sequence:
        return ""
    missing = "RTL_AUTOLAND is not 1" if plan.lands else "the mission has no landing sequence (DO_LAND_START)"
    rotors = ", and Q_RTL_MODE is 0" if profile.vertical else ""
    return f"it would circle for ever: {missing}{rotors}"


def no_terrain(p: Parameters | None, plan: PlanFacts | None) -> str:
    """Why the autopilot cannot fly the plan's heights above terrain, in words; "" if it can, or if there are none.

    `p` None: not read yet. Without heights of the ground the autopilot turns back (`failsafe_terrain_on_event`).
    """
    if plan is None or not plan.above_terrain:
        return ""
    what = f"{named(plan.above_terrain[0])} above terrain"
    if p is None:
        return f"{what}: the parameters are not read yet"
    if p.get("TERRAIN_ENABLE", 0.0) >= 1.0 or (
        p.get("WPNAV_RFND_USE", 0.0) >= 1.0 and p.get("RNGFND1_TYPE", 0.0) >= 1.0
    ):
        return ""
    return f"{what}: TERRAIN_ENABLE is not 1 and there is no range finder. Set it to 1, or plan heights above home"


def _terrain(p: Parameters, plan: PlanFacts | None) -> str | None:
    lacks = no_terrain(p, plan)
    if lacks:
        return f"{lacks}; START is refused"
    if plan is None or not plan.above_terrain or plan.ground:
        return None
    what = f"{named(plan.above_terrain[0])} above terrain"
    return f"{what}: the mission has no heights of the ground, so its heights above home are not known"


def _low_way(p: Parameters, plan: PlanFacts | None) -> str | None:
    return None if plan is None or not plan.low else plan.low


def _gripper(p: Mapping[str, float], plan: PlanFacts | None) -> str | None:
    """ArduPilot without a gripper still reports `Gripper Released`, and keeps the load."""
    if plan is None or plan.gripper is None or p.get("GRIP_ENABLE", 1) != 0:
        return None
    return f"is 0: item {plan.gripper} (DO_GRIPPER) moves no gripper, and the load stays on board"


def _circle_rate(p: Parameters, plan: PlanFacts | None) -> str | None:
    """A circle at a lower rate takes longer, and at rate 0 it never ends (`AC_Circle::calc_velocities`)."""
    rate = abs(p.get("CIRCLE_RATE", inf))
    if plan is None or rate >= plan.circle_deg_s - _ROUNDED_DEG_S:
        return None
    ends = "never ends" if rate == 0.0 else "takes longer, and more energy, than was counted"
    return f"is {rate:g} degrees/s: a circle of the mission {ends} ({plan.circle_deg_s:.1f} were counted)"


def _hover(name: str, unit_m: float) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        final = p.get(name, 0.0)
        return f"is {final:g}: a return ends hovering at {final * unit_m:g} m, not landed" if final > 0 else None

    return check


#: the speed between waypoints -> its unit in m/s
_CRUISE: Final = {"WPNAV_SPEED": 0.01, "WP_SPD": 1.0, "TRIM_ARSPD_CM": 0.01, "AIRSPEED_CRUISE": 1.0}
#: parameters have 24 bits, and some are whole numbers
_ROUGHLY: Final = 0.01


def _cruise_speed(name: str) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        counted = None if plan is None else plan.cruise_mps
        if counted is None or name not in p or p[name] * _CRUISE[name] >= counted - _ROUGHLY:
            return None
        return (
            f"is {p[name]:g}: {p[name] * _CRUISE[name]:g} m/s is flown, handover check and START count {counted:g} m/s"
        )

    return check


def _slower(name: str, unit: float, counted: float, what: str) -> ParameterCheck:
    """Speeds that are slower than the energy rule counts. 0 means another parameter's value, or the firmware's own."""

    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        value = p.get(name, 0.0) * unit
        if not 0.0 < value < counted - _ROUGHLY:
            return None
        return f"is {p[name]:g}: {what.format(value=f'{value:g}', counted=f'{counted:g}')}"

    return check


def _lands_slowly_from(name: str, unit_m: float) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        low_m = p.get(name, 0.0) * unit_m
        if low_m <= LANDING_BELOW_M + _ROUGHLY:
            return None
        return (
            f"is {p[name]:g}: it lands slowly from {low_m:g} m on, and the energy is counted from {LANDING_BELOW_M:g} m"
        )

    return check


def _switched(name: str) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        function = int(p.get(name, 0))
        if not function or switch_rule(function).access is not Access.SAFEGUARD:
            return None
        what = switch_name(function) or "not known here"
        return f"is {function} ({what}): a station's RC override switches it in flight, which DO_AUX_FUNCTION may not"

    return check


def _flies_around(p: Parameters, plan: PlanFacts | None) -> str | None:
    if p.get("OA_TYPE", 0.0) == 0.0:
        return None
    return f"is {p['OA_TYPE']:g}: a return flies around obstacles, and the energy and coverage of that are not counted"


def _return_speed(name: str, unit_mps: float) -> ParameterCheck:
    """0 is the speed of missions (ModeRTL::init). The companion writes both if the plan names a speed."""

    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        speed = p.get(name, 0.0)
        missions = next((p[cruise] * unit for cruise, unit in _CRUISE.items() if cruise in p), None)
        if speed <= 0.0 or (missions is not None and abs(speed * unit_mps - missions) <= _ROUGHLY):
            return None
        counted = "handover check and START count the mission's cruise speed"
        return f"is {speed:g}: a return is flown at {speed * unit_mps:g} m/s, {counted}"

    return check


def _return_height(name: str, unit_m: float) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        height_m, most_m = p.get(name, 0.0) * unit_m, p.get("FENCE_ALT_MAX", 0.0)
        if not _fence_on(p, _CEILING) or height_m <= most_m:
            return None
        return f"is {height_m:g} m, above FENCE_ALT_MAX: a return is flown at {most_m:g} m"

    return check


def _first_climb(name: str, unit_m: float) -> ParameterCheck:
    """A copter's RTL first climbs by this height, up to the fence (`ModeRTL::build_path`)."""

    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        climb_m = p.get(name, 0.0) * unit_m
        if climb_m <= 0.0:
            return None
        return f"is {climb_m:g} m: a return climbs by so much first, and the energy of that is not counted"

    return check


def _loiter(p: Parameters, plan: PlanFacts | None) -> str | None:
    waits_s = p.get("RTL_LOIT_TIME", 0.0) / 1000.0
    if waits_s <= LOITER_S:
        return None
    return f"is {waits_s:g} s: a return waits this long above its site, but the energy of {LOITER_S:g} s is counted"


def _climb(p: Parameters, plan: PlanFacts | None) -> str | None:
    """RTL first climbs by this height, from any place (`ModeRTL::update`)."""
    climb_m, most_m = p.get("RTL_CLIMB_MIN", 0.0), p.get("FENCE_ALT_MAX", 0.0)
    if plan is None or not _fence_on(p, _CEILING) or climb_m <= 0.0 or plan.highest_m + climb_m <= most_m:
        return None
    highest = f"{plan.highest_m:.0f} m"
    return f"is {climb_m:g} m: a return from the route's {highest} climbs above FENCE_ALT_MAX first, {most_m:g} m"


def _approach(p: Parameters, plan: PlanFacts | None) -> str | None:
    """QRTL arrives RTL_ALTITUDE - Q_RTL_ALT higher than its site (`ModeQRTL::update_target_altitude`).

    The point in the rally list is already as high as RTL_ALTITUDE.
    """
    return_m, most_m = p.get("RTL_ALTITUDE", p.get("ALT_HOLD_RTL", 0.0) / 100.0), p.get("FENCE_ALT_MAX", 0.0)
    if not _fence_on(p, _CEILING) or "Q_RTL_ALT" not in p:
        return None
    listed_m = min(return_m, most_m - BELOW_CEILING_M)
    height_m = listed_m + max(0.0, return_m - p["Q_RTL_ALT"])
    if height_m <= most_m:
        return None
    return f"is {p['Q_RTL_ALT']:g} m: QRTL from afar comes in at {height_m:.0f} m, above FENCE_ALT_MAX, {most_m:g} m"


#: FLIGHT_OPTIONS: RTL climbs first (`ModeRTL::update`). TERRAIN_FOLLOW: every mode, RTL, QRTL (`Plane::do_RTL`)
_CLIMB_FIRST, _FOLLOWS_GROUND = 1 << 4, 1 << 0 | 1 << 4 | 1 << 9
#: Q_OPTIONS: the failsafes' return out of hover, by QRTL or by RTL; take-off and landing of a mission on wings
_RETURNS, _ON_WINGS = 1 << 5 | 1 << 20, 1 << 1 | 1 << 2


def _climbs_first(p: Parameters, plan: PlanFacts | None) -> str | None:
    options = int(p.get("FLIGHT_OPTIONS", 0))
    if not options & _CLIMB_FIRST:
        return None
    return f"is {options}: bit 4 has a return climb straight on to its whole height, whatever RTL_CLIMB_MIN is"


def _follows_ground(p: Parameters, plan: PlanFacts | None) -> str | None:
    modes = int(p.get("TERRAIN_FOLLOW", 0))
    if not modes & _FOLLOWS_GROUND:
        return None
    return f"is {modes}: a return keeps a height above the ground, not the one above home that is judged"


def _lands_in_hover(p: Parameters, plan: PlanFacts | None) -> str | None:
    options = int(p.get("Q_OPTIONS", _RETURNS))
    if options & _RETURNS:
        return None
    where = "where it is, not at the return site"
    return f"is {options}: without bit 5 the failsafes land it out of hover {where}"


def _on_wings(p: Parameters, plan: PlanFacts | None) -> str | None:
    options = int(p.get("Q_OPTIONS", 0))
    if not options & _ON_WINGS:
        return None
    checked = "the mission was checked with those of a QuadPlane"
    return f"is {options}: bits 1 and 2 make a plane's of take-off and landing; {checked}"


def _home(p: Parameters, plan: PlanFacts | None) -> str | None:
    if p.get("RALLY_INCL_HOME", 0) == 0:
        return None
    return "is 1: where home is nearer a return goes there, not to the return site"


# ---- battery ------------------------------------------------------------------------------------------------------

#: rank of ArduCopter's failsafe actions, the gravest first; other actions come last. A later failsafe acts only if it
#: is at least as grave as the one before
_GRAVITY: Final = {5: 0, 1: 1, 2: 2, 4: 3, 3: 4, 0: 5}
_WINGED_GRAVITY: Final = {3: 0, 5: 1, 4: 2, 2: 3, 1: 4, 0: 5}
_LEAST: Final = 6


def _monitor(battery: str) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        return "is 0: the autopilot does not measure the battery" if p.get(f"{battery}_MONITOR", 1) == 0 else None

    return check


def _low(battery: str) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        if p.get(f"{battery}_MONITOR", 1) == 0 or p.get(f"{battery}_FS_LOW_ACT", 2) != 0:
            return None
        return "is 0: nothing brings the aircraft home when the battery is low"

    return check


def _low_when(battery: str) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        acts = p.get(f"{battery}_MONITOR", 0) != 0 and p.get(f"{battery}_FS_LOW_ACT", 0) != 0
        if not acts or p.get(f"{battery}_LOW_VOLT", 1.0) > 0 or p.get(f"{battery}_LOW_MAH", 1.0) > 0:
            return None
        return f"is 0, and {battery}_LOW_MAH is 0: the battery's failsafe never acts"

    return check


def _critical(battery: str, gravity: Mapping[int, int]) -> ParameterCheck:
    def check(p: Parameters, plan: PlanFacts | None) -> str | None:
        low, critical = int(p.get(f"{battery}_FS_LOW_ACT", 0)), int(p.get(f"{battery}_FS_CRT_ACT", 0))
        if critical == 0 or gravity.get(critical, _LEAST) <= gravity.get(low, _LEAST):
            return None
        return f"is {critical}: never acts after {battery}_FS_LOW_ACT {low}"

    return check


def _checks_of(battery: str) -> tuple[CheckRow, ...]:
    """The checks of one monitor. `battery`: the prefix of its parameters."""
    low, critical = f"{battery}_FS_LOW_ACT", f"{battery}_FS_CRT_ACT"
    return (
        (f"{battery}_MONITOR", _monitor(battery), RuleGroup.EVERY),
        (low, _low(battery), RuleGroup.EVERY),
        (f"{battery}_LOW_VOLT", _low_when(battery), RuleGroup.EVERY),
        *((name, _way(name, _ACTIONS), RuleGroup.ARDUCOPTER) for name in (low, critical)),
        *((name, _way(name, _WINGED_ACTIONS), RuleGroup.ARDUPLANE) for name in (low, critical)),
        (critical, _critical(battery, _GRAVITY), RuleGroup.ARDUCOPTER),
        (critical, _critical(battery, _WINGED_GRAVITY), RuleGroup.ARDUPLANE),
    )


def _further(batteries: int) -> tuple[str, ...]:
    """The prefixes of the parameters of the further monitors: BATT2_ for monitor 1."""
    return tuple(f"BATT{number}" for number in range(2, batteries + 1))


def further_names(batteries: int) -> tuple[str, ...]:
    """The further parameters to read from an aircraft with this many batteries."""
    return tuple(f"{battery}_{name}" for battery in _further(batteries) for name in _OF_MONITOR)


def further_checks(batteries: int) -> tuple[CheckRow, ...]:
    """The checks of the further parameters."""
    return tuple(row for battery in _further(batteries) for row in _checks_of(battery))


# ---- the fence ----------------------------------------------------------------------------------------------------

_CEILING, _CIRCLE, _POLYGON = 1, 2, 4
_UNION: Final = 0b10


def _fence_on(p: Parameters, kind: int = 0) -> bool:
    """Whether the fence is enabled in flight, with this type of fence."""
    on = p.get("FENCE_ENABLE", 0) != 0 or p.get("FENCE_AUTOENABLE", 0) != 0
    return on and int(p.get("FENCE_TYPE", 0)) & kind == kind


def _enabled(p: Parameters, plan: PlanFacts | None) -> str | None:
    if plan is None or not plan.fence or "FENCE_ENABLE" not in p or _fence_on(p):
        return None
    return "is 0: the plan's geofence is stored, and not kept to"


def _kinds(p: Parameters, plan: PlanFacts | None) -> str | None:
    if plan is None or not plan.fence or not _fence_on(p) or _fence_on(p, _POLYGON):
        return None
    return f"is {p.get('FENCE_TYPE', 0):.0f}: without bit 2 the plan's geofence is stored, and not kept to"


def _reported(p: Parameters, plan: PlanFacts | None) -> str | None:
    if not _fence_on(p) or p.get("FENCE_ACTION", 1) != 0:
        return None
    return "is 0: leaving the geofence is reported, and nothing is done"


def _union(p: Parameters, plan: PlanFacts | None) -> str | None:
    options = int(p.get("FENCE_OPTIONS", 0))
    if plan is None or plan.inclusions < 2 or not _fence_on(p, _POLYGON) or not options & _UNION:
        return None
    return f"is {options}: bit 1 makes one area of those to stay inside; the plan was checked against each"


def _radius(p: Parameters, plan: PlanFacts | None) -> str | None:
    radius_m = p.get("FENCE_RADIUS", 0.0)
    if plan is None or not _fence_on(p, _CIRCLE) or plan.farthest_m < radius_m:
        return None
    return f"is {radius_m:g} m, and the route goes {plan.farthest_m:.0f} m from home: take bit 1 out of FENCE_TYPE"


def _ceiling(p: Parameters, plan: PlanFacts | None) -> str | None:
    most_m = p.get("FENCE_ALT_MAX", 0.0)
    if plan is None or not _fence_on(p, _CEILING) or plan.highest_m < most_m:
        return None
    return f"is {most_m:g} m, and the route climbs to {plan.highest_m:.0f} m"


#: bit of DID_OPTIONS: arming needs Remote ID (`AP_OpenDroneID::pre_arm_check`)
_ENFORCES: Final = 1


def _remote_id_off(p: Parameters, _plan: PlanFacts | None) -> str | None:
    if p.get("DID_ENABLE", 1.0) >= 1.0 or not int(p.get("DID_OPTIONS", 0)) & _ENFORCES:
        return None
    return "is 0, and DID_OPTIONS wants Remote ID for arming: arming is refused"


def _transponder(p: Parameters, _plan: PlanFacts | None) -> str | None:
    if p.get("DID_ENABLE", 0.0) < 1.0 or p.get("DID_MAVPORT", 0.0) >= 0.0 or p.get("DID_CANDRIVER", 0.0) >= 1.0:
        return None
    return "is -1, and DID_CANDRIVER is 0: Remote ID is enabled and has no transponder"


_CRUISES: Final = (
    ("WPNAV_SPEED", RuleGroup.ARDUCOPTER),
    ("WP_SPD", RuleGroup.ARDUCOPTER),
    ("TRIM_ARSPD_CM", RuleGroup.ARDUPLANE),
    ("AIRSPEED_CRUISE", RuleGroup.ARDUPLANE),
)
_CLIMBS, _SINKS, _TOUCHES, _SPEEDS_UP = (
    "a return climbs at {value} m/s, and the energy of {counted} m/s is counted",
    "a return comes down at {value} m/s, and the energy of {counted} m/s is counted",
    "it lands at {value} m/s, and the energy of {counted} m/s is counted",
    "it speeds up and brakes at {value} m/s2, and the energy of {counted} m/s2 is counted",
)
#: parameter, its unit, the value that the energy rule counts with, and the text if the parameter is lower
_COUNTED: Final = (
    ("WPNAV_SPEED_UP", 0.01, CLIMB_MPS, _CLIMBS),
    ("WP_SPD_UP", 1.0, CLIMB_MPS, _CLIMBS),
    ("WPNAV_SPEED_DN", 0.01, DESCENT_MPS, _SINKS),
    ("WP_SPD_DN", 1.0, DESCENT_MPS, _SINKS),
    ("LAND_SPEED", 0.01, LANDING_MPS, _TOUCHES),
    ("LAND_SPD_MS", 1.0, LANDING_MPS, _TOUCHES),
    ("WPNAV_ACCEL", 0.01, ACCELERATION_MPSS, _SPEEDS_UP),
    ("WP_ACC", 1.0, ACCELERATION_MPSS, _SPEEDS_UP),
)

#: the gravest first
CHECKS: Final[tuple[CheckRow, ...]] = (
    *_checks_of("BATT"),
    *((name, _way(name, ways), RuleGroup.ARDUCOPTER) for name, ways in _WAYS.items()),
    *((name, _way(name, ways), RuleGroup.ARDUPLANE) for name, ways in _WINGED_WAYS.items()),
    ("GRIP_ENABLE", _gripper, RuleGroup.EVERY),
    ("FENCE_ENABLE", _enabled, RuleGroup.EVERY),
    ("FENCE_TYPE", _kinds, RuleGroup.EVERY),
    ("FENCE_ACTION", _reported, RuleGroup.EVERY),
    ("FENCE_OPTIONS", _union, RuleGroup.EVERY),
    ("FENCE_RADIUS", _radius, RuleGroup.EVERY),
    ("FENCE_ALT_MAX", _ceiling, RuleGroup.EVERY),
    ("RTL_ALT", _return_height("RTL_ALT", 0.01), RuleGroup.ARDUCOPTER),
    ("RTL_ALT_M", _return_height("RTL_ALT_M", 1.0), RuleGroup.ARDUCOPTER),
    ("RTL_ALTITUDE", _return_height("RTL_ALTITUDE", 1.0), RuleGroup.ARDUPLANE),
    ("ALT_HOLD_RTL", _return_height("ALT_HOLD_RTL", 0.01), RuleGroup.ARDUPLANE),
    ("RTL_CLIMB_MIN", _climb, RuleGroup.ARDUPLANE),
    ("FLIGHT_OPTIONS", _climbs_first, RuleGroup.ARDUPLANE),
    ("TERRAIN_FOLLOW", _follows_ground, RuleGroup.ARDUPLANE),
    ("Q_RTL_ALT", _approach, RuleGroup.ARDUPLANE_ROTORS),
    ("Q_OPTIONS", _lands_in_hover, RuleGroup.ARDUPLANE_ROTORS),
    ("Q_OPTIONS", _on_wings, RuleGroup.ARDUPLANE_ROTORS),
    ("RTL_ALT_FINAL", _hover("RTL_ALT_FINAL", 0.01), RuleGroup.ARDUCOPTER),
    ("RTL_ALT_FINAL_M", _hover("RTL_ALT_FINAL_M", 1.0), RuleGroup.ARDUCOPTER),
    ("RTL_SPEED", _return_speed("RTL_SPEED", 0.01), RuleGroup.ARDUCOPTER),
    ("RTL_SPEED_MS", _return_speed("RTL_SPEED_MS", 1.0), RuleGroup.ARDUCOPTER),
    ("RTL_CLIMB_MIN", _first_climb("RTL_CLIMB_MIN", 0.01), RuleGroup.ARDUCOPTER),
    ("RTL_CLIMB_MIN_M", _first_climb("RTL_CLIMB_MIN_M", 1.0), RuleGroup.ARDUCOPTER),
    ("RTL_LOIT_TIME", _loiter, RuleGroup.ARDUCOPTER),
    *((name, _cruise_speed(name), group) for name, group in _CRUISES),
    *((name, _slower(name, unit, counted, what), RuleGroup.ARDUCOPTER) for name, unit, counted, what in _COUNTED),
    ("LAND_ALT_LOW", _lands_slowly_from("LAND_ALT_LOW", 0.01), RuleGroup.ARDUCOPTER),
    ("LAND_ALT_LOW_M", _lands_slowly_from("LAND_ALT_LOW_M", 1.0), RuleGroup.ARDUCOPTER),
    ("OA_TYPE", _flies_around, RuleGroup.ARDUCOPTER),
    *((name, _switched(name), RuleGroup.EVERY) for name in SWITCHED),
    ("RALLY_INCL_HOME", _home, RuleGroup.EVERY),
    ("TERRAIN_ENABLE", _terrain, RuleGroup.EVERY),
    ("DID_ENABLE", _remote_id_off, RuleGroup.EVERY),
    ("DID_MAVPORT", _transponder, RuleGroup.EVERY),
    ("CIRCLE_RATE", _circle_rate, RuleGroup.ARDUCOPTER),
    ("", _low_way, RuleGroup.EVERY),  # about the plan: no parameter would change it
)

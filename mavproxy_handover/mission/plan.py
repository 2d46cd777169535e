# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the route of a mission package: QGroundControl `.plan` files and the older `.waypoints` (QGC WPL 110).

Formats: QGroundControl developer guide, "Plan File Format" (Plan 1, mission 2, geoFence 2, rallyPoints 2), and
mavlink.io, "File Formats". What comes out is what goes to the autopilot: only simple items, parameters that the file
leaves open (null, NaN) as 0, which is what ArduCopter takes them for, and frames in the form ArduCopter stores.
Surveys and other complex items count by the waypoints that they store (`complex_items.py`). A section of any version
that is empty counts as none. All faults of the items are told at once (`Faults`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Protocol, TypeAlias

from mavproxy_handover.core.safety.energy import CLIMB_MPS, DESCENT_MPS
from mavproxy_handover.mission.complex_items import simple_items
from mavproxy_handover.mission.conditions import waiting
from mavproxy_handover.mission.errors import Faults, Where, parse_json
from mavproxy_handover.mission.items import (
    CHANGE_ALTITUDE,
    CHANGE_SPEED,
    COMMANDS,
    DELAY,
    FRAME_ABOVE_HOME,
    FRAME_ABOVE_SEA,
    FRAME_ABOVE_TERRAIN,
    FRAME_NONE,
    GRIPPER,
    JUMP,
    JUMP_TO_TAG,
    JUMPS,
    LAND,
    LAND_START,
    LANDINGS,
    LOITER_TURNS,
    LOITER_UNLIMITED,
    RETURN_TO_LAUNCH,
    SPLINE_WAYPOINT,
    TAKEOFFS,
    VTOL_TRANSITION,
    WAYPOINT,
    Command,
    MissionItem,
    RallyPoint,
    stored_radius_m,
)
from mavproxy_handover.mission.jumps import as_flown, check_jumps, endless_jumps, jumps
from mavproxy_handover.mission.refused_items import command_name, safeguard_taken_away, why_not_flown
from mavproxy_handover.mission.waypoint_numbers import has_home, odd_numbers
from mavproxy_handover.mission.wings import AS_IT_COMES, Wings
from mavproxy_handover.vehicle.profiles import ASSUMED, Profile

__all__ = [
    "FenceCircle",
    "FencePart",
    "FencePolygon",
    "Ground",
    "Home",
    "MADE_FOR",
    "Route",
    "first_in_air",
    "next_place",
    "on_ground",
    "read_fence",
    "read_route",
    "ways_from_land_starts",
    "with_items",
]

#: what a flight controller's mission storage holds, rounded down (Cube Orange: 724 items)
MAX_ITEMS = 700
#: what ArduPilot takes for one polygon of a fence
MAX_CORNERS = 255
#: seconds, as ArduCopter stores them
LONGEST_WAIT_S = 65535
_WAIT = f"0 to {LONGEST_WAIT_S} s"
#: far beyond any sensible altitude, near enough to catch centimetres given for metres
LOWEST_M, HIGHEST_M = -1000.0, 10000.0
LONGEST_NUMBER = 1e9
#: parameters 5 and 6 of a command without a place have 32 bits
_MOST_32 = 2.0**31 - 1.0

#: MAV_FRAME as files have it -> as ArduCopter stores it (the _INT variants are the same frames)
_FRAMES = {
    0: FRAME_ABOVE_SEA,
    2: FRAME_ABOVE_SEA,
    5: FRAME_ABOVE_SEA,
    3: FRAME_ABOVE_HOME,
    6: FRAME_ABOVE_HOME,
    10: FRAME_ABOVE_TERRAIN,
    11: FRAME_ABOVE_TERRAIN,
}
#: MAV_TYPE of a plan -> what it was made for, in words
MADE_FOR: Mapping[int, str] = {
    **dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35), "a multicopter"),
    1: "a fixed-wing aircraft",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"),
    10: "a rover",
    11: "a boat",
    12: "a submarine",
}
#: SPEED_TYPE -> what it is the speed of, and what the walk counts for it (m/s)
_VERTICAL_SPEEDS: Mapping[float, tuple[str, float]] = {2.0: ("climbs", CLIMB_MPS), 3.0: ("descents", DESCENT_MPS)}
#: what may wait for a condition and never be done -> what counts then
_WORST: Mapping[int, str] = {
    CHANGE_SPEED: "the slower speed for time and energy, the faster one for handovers. A speed without a condition "
    "ends that",
    GRIPPER: "the payload stays on board",
}
_NO_HOME = "home is at latitude 0, longitude 0: it was never set (allowed: the place of the take-off)"
#: after these the aircraft flies nothing by itself
_LAST = LANDINGS | {RETURN_TO_LAUNCH, LOITER_UNLIMITED}


@dataclass(frozen=True, slots=True)
class Home:
    """The planned home position; `alt_m` above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_m: float

    @property
    def is_set(self) -> bool:
        """False at latitude 0, longitude 0, which programs write for no home."""
        return not self.lat_deg == self.lon_deg == 0.0


@dataclass(frozen=True, slots=True)
class FencePolygon:
    """A polygon of the geofence: stay inside it (`inclusion`) or outside. Corners are (latitude, longitude)."""

    inclusion: bool
    corners: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class FenceCircle:
    """A circle of the geofence: stay inside it (`inclusion`) or outside."""

    inclusion: bool
    lat_deg: float
    lon_deg: float
    radius_m: float


FencePart: TypeAlias = FencePolygon | FenceCircle


class Ground(Protocol):
    """The heights of the ground that a mission brings (`terrain.py`)."""

    @property
    def cell_m(self) -> float:
        """How far apart its heights are."""
        ...

    def rise_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """How much higher the ground is at a place than at home; None: not known."""
        ...


@dataclass(frozen=True, slots=True)
class Route:
    """The route of the aircraft. `items[n].seq == n + 1`: item 0 of the autopilot is home."""

    home: Home
    items: tuple[MissionItem, ...]
    rally: tuple[RallyPoint, ...] = ()
    fence: tuple[FencePart, ...] = ()
    #: speed the plan was made for, if the file says so
    cruise_speed_mps: float | None = None
    #: what is odd but flyable, one line each
    warnings: tuple[str, ...] = ()
    #: latitude and longitude where its RTL item ends (`returns.py`); None: not known, or it has none
    return_to: tuple[float, float] | None = None
    #: of the aircraft that the route is for
    profile: Profile = ASSUMED
    #: how it turns, where it has wings
    wings: Wings = AS_IT_COMES
    #: the ground below it; None: the mission has no heights of it
    ground: Ground | None = field(default=None, repr=False, compare=False)
    #: it may have a jump without end
    endless: bool = False
    #: speeds that wait for a condition count as the fastest possible; False: as the slowest (`conditions.py`)
    fastest: bool = False

    def upload_items(self) -> tuple[MissionItem, ...]:
        """All items to write to the autopilot, in order, home as item 0 first."""
        home = MissionItem(
            0,
            WAYPOINT,
            FRAME_ABOVE_SEA,
            0.0,
            0.0,
            0.0,
            0.0,
            self.home.lat_deg,
            self.home.lon_deg,
            self.home.alt_m,
        )
        return (home, *self.items)


def read_route(file: str, text: str, profile: Profile = ASSUMED, *, endless: bool = False) -> Route:
    """Read the route in `text`, for an aircraft of that profile; the ending of `file` tells the format. `endless`: it
    may have a jump without end. Raises MissionError."""
    where = Where(file)
    if file.endswith(".plan"):
        return _read_plan(where, text, profile, endless)
    if file.endswith(".waypoints"):
        return _read_waypoints(where, text, profile, endless)
    raise where.error("not a route (allowed: a file named *.plan or *.waypoints)")


# --- QGroundControl .plan ---


def _read_plan(where: Where, text: str, profile: Profile, endless: bool) -> Route:
    plan = where.table(parse_json(text, where), "the file")
    if plan.get("fileType") != "Plan":
        raise where.error("not a QGroundControl plan (fileType is not 'Plan')")
    _version(where, plan, "version", 1)
    mission = where.table(where.need(plan, "mission"), "mission")
    inside = where.at("mission")
    _version(inside, mission, "version", 2)
    faults = Faults()
    home, rally, fence = Home(0.0, 0.0, 0.0), tuple[RallyPoint, ...](), tuple[FencePart, ...]()
    with faults.noted():
        home = _planned_home(inside, inside.need(mission, "plannedHomePosition"))
    items = _plan_items(where, inside.array(inside.need(mission, "items"), "items"), profile, faults)
    with faults.noted():
        _check_kind(inside, mission, profile)
    with faults.noted():
        rally = _rally_points(where.at("rallyPoints"), plan.get("rallyPoints"))
    with faults.noted():
        fence = read_fence(where.at("geoFence"), plan.get("geoFence"))
    faults.raise_all()
    return _finish(
        where,
        home,
        items,
        rally=rally,
        fence=fence,
        cruise_speed_mps=_plan_speed(inside, mission),
        warnings=_plan_warnings(inside, mission),
        profile=profile,
        endless=endless,
    )


def _planned_home(where: Where, value: object) -> Home:
    """The planned home. QGroundControl leaves its height open (null) if it has no heights of the ground."""
    numbers = where.array(value, "plannedHomePosition")
    known = [*numbers[:2], 0.0] if len(numbers) == 3 and numbers[2] is None else numbers
    return Home(*_coordinate(where, known, "plannedHomePosition", 3))


def _version(where: Where, table: Mapping[str, object], key: str, wanted: int) -> None:
    if where.need(table, key) != wanted:
        raise where.error(f"{key} is not {wanted}: save the plan again with a present QGroundControl")


def _coordinate(where: Where, value: object, name: str, length: int) -> tuple[float, ...]:
    numbers = where.array(value, name)
    if len(numbers) != length:
        raise where.error(f"{name} has {len(numbers)} numbers (allowed: {length})")
    limits = ((-90.0, 90.0), (-180.0, 180.0), (LOWEST_M, HIGHEST_M))
    parts = ("latitude", "longitude", "altitude")
    return tuple(
        where.number(number, f"{name} {part}", low, high)
        for number, part, (low, high) in zip(numbers, parts, limits, strict=False)
    )


def _plan_items(where: Where, listed: Sequence[object], profile: Profile, faults: Faults) -> tuple[MissionItem, ...]:
    found: list[MissionItem] = []
    numbers: dict[float, int] = {}
    for seq, inside, item in simple_items(where, listed, faults):
        with faults.noted():
            found.append(_plan_item(inside, seq, item, profile))
        jump_id = item.get("doJumpId", seq)
        if isinstance(jump_id, int):
            numbers.setdefault(jump_id, seq)
    return tuple(replace(item, param1=numbers.get(item.param1, 0)) if item.command == JUMP else item for item in found)


def _plan_item(inside: Where, seq: int, item: Mapping[str, object], profile: Profile) -> MissionItem:
    numbers = inside.array(inside.need(item, "params"), "params")
    if len(numbers) != 7:
        raise inside.error(f"params has {len(numbers)} numbers (allowed: 7)")
    command = inside.whole(inside.need(item, "command"), "command", 0, 65535)
    return _item(
        inside,
        seq,
        command,
        frame=inside.need(item, "frame"),
        numbers=numbers,
        auto_continue=item.get("autoContinue") is not False,
        profile=profile,
    )


def _rally_points(where: Where, value: object) -> tuple[RallyPoint, ...]:
    if not value:
        return ()
    rally = where.table(value, "rallyPoints")
    if not rally.get("points"):  # QGroundControl ignores such a section of any version
        return ()
    _version(where, rally, "version", 2)
    points = where.array(where.need(rally, "points"), "points")
    return tuple(RallyPoint(*_coordinate(where, point, f"point {number}", 3)) for number, point in enumerate(points, 1))


def read_fence(where: Where, value: object) -> tuple[FencePart, ...]:
    """The areas of a plan's section geoFence: polygons first, then circles. Raises MissionError."""
    if not value:
        return ()
    fence = where.table(value, "geoFence")
    if not any(fence.get(part) for part in ("polygon", "polygons", "circles")):
        return ()
    _version(where, fence, "version", 2)
    found: list[FencePart] = []
    for number, entry in enumerate(where.array(fence.get("polygons", []), "polygons"), 1):
        inside = where.at(f"polygon {number}")
        polygon = inside.table(entry, "the polygon")
        path = inside.array(inside.need(polygon, "polygon"), "polygon")
        if not 3 <= len(path) <= MAX_CORNERS:
            raise inside.error(f"{len(path)} corners (allowed: 3 to {MAX_CORNERS})")
        corners = [_coordinate(inside, corner, f"corner {n}", 2) for n, corner in enumerate(path, 1)]
        found.append(FencePolygon(polygon.get("inclusion") is not False, tuple((lat, lon) for lat, lon in corners)))
    for number, entry in enumerate(where.array(fence.get("circles", []), "circles"), 1):
        inside = where.at(f"circle {number}")
        outer = inside.table(entry, "the circle")
        circle = inside.table(inside.need(outer, "circle"), "circle")
        lat, lon = _coordinate(inside, inside.need(circle, "center"), "center", 2)
        radius = inside.number(inside.need(circle, "radius"), "radius", 1.0, 1e6)
        found.append(FenceCircle(outer.get("inclusion") is not False, lat, lon, radius))
    return tuple(found)


def _plan_speed(where: Where, mission: Mapping[str, object]) -> float | None:
    # QGroundControl plans copters by the hover speed; its cruise speed is for wings
    kind = mission.get("vehicleType", 2)
    key = "hoverSpeed" if isinstance(kind, int) and MADE_FOR.get(kind) == "a multicopter" else "cruiseSpeed"
    value = mission.get(key)
    return None if value is None else where.number(value, key, 0.1, 100.0)


def _plan_warnings(where: Where, mission: Mapping[str, object]) -> tuple[str, ...]:
    found = []
    if where.array(mission["plannedHomePosition"], "plannedHomePosition")[2] is None:
        found.append("home has no height in the plan: 0 m above the sea is assumed")
    if mission.get("firmwareType", 3) != 3:
        found.append("the plan was made for another autopilot than ArduPilot (firmwareType is not 3)")
    return tuple(found)


def _check_kind(where: Where, mission: Mapping[str, object], profile: Profile) -> None:
    """A plan for another kind of aircraft flies other ways: its items mean other things there. Raises MissionError."""
    made_for = mission.get("vehicleType")
    name = MADE_FOR.get(made_for) if type(made_for) is int else None
    if name is not None and made_for not in profile.types:
        raise where.error(
            f"the plan was made for {name} (vehicleType {made_for}), the mission is for a {profile.name}: set aircraft "
            "in mission.toml, or make the plan for that vehicle"
        )


# --- QGC WPL 110 .waypoints ---


def _read_waypoints(where: Where, text: str, profile: Profile, endless: bool) -> Route:
    lines = text.splitlines()
    if not lines or lines[0].split() != ["QGC", "WPL", "110"]:
        raise where.error("not a waypoint file (allowed: a first line 'QGC WPL 110')")
    numbered = [
        (where.at(f"line {number}"), line.split())
        for number, line in enumerate(lines[1:], 2)
        if line.strip() and not line.startswith("#")
    ]
    if not numbered:
        raise where.error("no items (allowed: item 0 is home, item 1 the first one flown)")
    faults = Faults()
    home, warnings = Home(0.0, 0.0, 0.0), tuple[str, ...]()
    with faults.noted():
        warnings = odd_numbers(numbered)
    if has_home(numbered):
        with faults.noted():
            home = _home_line(*numbered.pop(0))
    items: list[MissionItem] = []
    for seq, (inside, fields) in enumerate(numbered, 1):
        with faults.noted():
            items.append(_item_line(inside, seq, fields, profile))
    faults.raise_all()
    return _finish(where, home, tuple(items), warnings=warnings, profile=profile, endless=endless)


def _home_line(where: Where, fields: Sequence[str]) -> Home:
    values = _values(where, fields)
    return Home(
        where.number(values[6], "latitude", -90.0, 90.0),
        where.number(values[7], "longitude", -180.0, 180.0),
        where.number(values[8], "altitude", LOWEST_M, HIGHEST_M),
    )


def _item_line(where: Where, seq: int, fields: Sequence[str], profile: Profile) -> MissionItem:
    values, goes_on = _values(where, fields), fields[-1] != "0"
    inside = where.at(f"item {seq}")
    command = inside.whole(values[1], "command", 0, 65535)
    return _item(inside, seq, command, frame=values[0], numbers=values[2:9], auto_continue=goes_on, profile=profile)


def _values(where: Where, fields: Sequence[str]) -> list[float | None]:
    """The numbers of a line, from its frame to its height. Raises MissionError."""
    if len(fields) != 12:
        raise where.error(f"{len(fields)} fields (allowed: 12)")
    return [_field(where, field, n) for n, field in enumerate(fields[2:11], 3)]


def _field(where: Where, field: str, number: int) -> float | None:
    try:
        value = float(field)
    except ValueError:
        raise where.error(f"field {number} is '{field[:20]}' (allowed: a number)") from None
    return None if math.isnan(value) else value


# --- common to both ---


def _item(
    where: Where,
    seq: int,
    command: int,
    *,
    frame: object,
    numbers: Sequence[object],
    auto_continue: bool,
    profile: Profile,
) -> MissionItem:
    """Check one item. `numbers` are parameters 1 to 4, latitude, longitude, altitude; None where left open."""
    unsafe = safeguard_taken_away(command, numbers[0] or 0.0)
    if unsafe:
        raise where.error(f"{command_name(command)} takes away a safeguard: {unsafe}", grave=True)
    known = COMMANDS.get(command)
    if known is None:
        raise where.error(f"{command_name(command)} is not allowed: {why_not_flown(command)}")
    if command in profile.not_flown:
        raise where.error(f"{known.name} is not for a {profile.name}: {profile.not_flown[command]}")
    item = _item_of(where, seq, command, known, frame=frame, numbers=numbers, auto_continue=auto_continue)
    _check_numbers(where, known, item, profile.item_ranges)
    if not profile.flies_past:
        _check_circle(where, item)
        _check_delay(where, item)
    return item


def _item_of(
    where: Where,
    seq: int,
    command: int,
    known: Command,
    *,
    frame: object,
    numbers: Sequence[object],
    auto_continue: bool,
) -> MissionItem:
    param1, param2, param3, param4 = (
        0.0 if value is None else where.number(value, f"parameter {n}", -LONGEST_NUMBER, LONGEST_NUMBER)
        for n, value in enumerate(numbers[:4], 1)
    )
    if not known.located:
        x, y, z = (
            0.0 if value is None or not known.numbered else where.number(value, f"parameter {n}", -_MOST_32, _MOST_32)
            for n, value in enumerate(numbers[4:], 5)
        )
        place = float(int(x)) / 1e7, float(int(y)) / 1e7, z
        return MissionItem(seq, command, FRAME_NONE, param1, param2, param3, param4, *place, auto_continue)
    stored = (
        None if isinstance(frame, bool) else next((kept for value, kept in _FRAMES.items() if value == frame), None)
    )
    if stored is None:
        allowed = ", ".join(str(value) for value in _FRAMES)
        raise where.error(f"frame of {known.name} is not one with a place (allowed: {allowed})")
    return MissionItem(
        seq,
        command,
        stored,
        param1,
        param2,
        param3,
        param4,
        0.0 if numbers[4] is None else where.number(numbers[4], "latitude", -90.0, 90.0),
        0.0 if numbers[5] is None else where.number(numbers[5], "longitude", -180.0, 180.0),
        where.number(numbers[6], "altitude", LOWEST_M, HIGHEST_M),
        auto_continue,
    )


def _check_numbers(
    where: Where,
    known: Command,
    item: MissionItem,
    numbers: Mapping[tuple[int, int], tuple[float, float, str]],
) -> None:
    """What the aircraft cannot do, and what ArduPilot would take for something else. Raises MissionError."""
    for number, value in enumerate(item.params, 1):
        low, high, allowed = numbers.get((item.command, number), (-math.inf, math.inf, ""))
        if not low <= value <= high:
            raise where.error(f"parameter {number} of {known.name} is {value:g} (allowed: {allowed})")


def _check_circle(where: Where, item: MissionItem) -> None:
    """ArduCopter flies a circle without a radius with the radius of the circle before, of this flight or another one.
    Raises MissionError."""
    if item.command == LOITER_TURNS and stored_radius_m(item.param3) == 0.0:
        raise where.error(
            "NAV_LOITER_TURNS has no radius (parameter 3): ArduCopter takes that of its last circle, and how far it "
            "flies is not known (allowed: 1 to 2000 m, below 0 to the left)"
        )


def _check_delay(where: Where, item: MissionItem) -> None:
    """Until an hour or a minute of the day a NAV_DELAY waits up to 24 hours. Raises MissionError."""
    if item.command != DELAY or item.param1 > 0.0:
        return
    hour, minute, second = (int(value) for value in item.params[1:])
    if hour != -1 or minute != -1:
        longest = "24 hours" if hour != -1 else "60 minutes"
        raise where.error(
            f"NAV_DELAY waits until a time of day (hour {hour}, minute {minute}, second {second} UTC), up to {longest} "
            "in the air: its energy cannot be judged (allowed: seconds in parameter 1; parameters 2 to 4 are then -1)"
        )
    if not -1 <= second <= 59:
        raise where.error(f"parameter 4 of NAV_DELAY is {second} (allowed: a second from 0 to 59, or -1)")


def _check_splines(where: Where, items: Sequence[MissionItem]) -> None:
    """Refuse a NAV_DELAY after a spline. Raises MissionError.

    To aim a spline at the item after it, ArduCopter would take the numbers of the NAV_DELAY for a place.
    """
    flown = [item for item in items if COMMANDS[item.command].flown]
    for item, behind in pairwise(flown):
        if item.command == SPLINE_WAYPOINT and behind.command == DELAY and item.param1 == 0.0:
            raise where.at(f"item {behind.seq}").error(
                f"NAV_DELAY after NAV_SPLINE_WAYPOINT, item {item.seq}: ArduCopter takes its numbers for a place, and "
                f"aims item {item.seq} at that (allowed: the seconds in parameter 1 of item {item.seq})"
            )


def with_items(route: Route, items: Sequence[MissionItem]) -> Route:
    """Copy of a plan with other items, which a station sent; the first of them is home and is ignored.

    For an aircraft in flight: the mission need not begin with a take-off. Raises MissionError.
    """
    where = Where("the upload")
    if len(items) - 1 > MAX_ITEMS:
        raise where.error(f"{len(items) - 1} items (allowed: at most {MAX_ITEMS})")
    checked = _checked(where, items[1:], route.profile)
    for item in checked:
        if item.command in JUMPS:
            name = COMMANDS[item.command].name
            raise where.at(f"item {item.seq}").error(f"{name}: in flight it is not known how often it was flown")
    if not any(COMMANDS[item.command].flown for item in checked):
        raise where.error("nothing is flown (allowed: at least one item that is)")
    _check_on_ground(where, checked, route.profile, grounded=False)
    if route.profile.flies_past:
        _check_landings(where, checked, route.profile)
    else:
        _check_splines(where, checked)
    return replace(route, items=checked, return_to=None)


def on_ground(route: Route, items: Sequence[MissionItem], fence: tuple[FencePart, ...]) -> Route:
    """Copy of a plan with the mission and the geofence that the autopilot has on the ground.

    The first item is its home. The rules for a plan in a file apply, and it has to begin with a take-off. Raises
    MissionError.
    """
    where = Where("")
    checked = _checked(where, items[1:], route.profile)
    name, begins = route.profile.begins
    first = first_in_air(checked)
    if first is None or first.command not in begins:
        begun = f"the first flown item is {COMMANDS[first.command].name}" if first is not None else "nothing is flown"
        raise where.error(f"{begun} (allowed: {name} first)")
    home = Home(items[0].lat_deg, items[0].lon_deg, items[0].alt_m)
    if not home.is_set:
        raise where.error(_NO_HOME)
    found = _finish(
        where,
        home,
        checked,
        rally=route.rally,
        fence=fence,
        cruise_speed_mps=route.cruise_speed_mps,
        profile=route.profile,
        endless=route.endless,
    )
    return replace(found, wings=route.wings)


def _checked(where: Where, items: Sequence[MissionItem], profile: Profile) -> tuple[MissionItem, ...]:
    """Items that came from a station or from the autopilot, numbered from 1. Raises MissionError."""
    faults, found = Faults(), list[MissionItem]()
    for seq, item in enumerate(items, 1):
        known = COMMANDS.get(item.command)
        scale = 1e7 if known is not None and known.numbered else 1.0
        with faults.noted():
            found.append(
                _item(
                    where.at(f"item {seq}"),
                    seq,
                    item.command,
                    frame=item.frame,
                    numbers=(*item.params, round(item.lat_deg * scale, 7), round(item.lon_deg * scale, 7), item.alt_m),
                    auto_continue=item.auto_continue,
                    profile=profile,
                )
            )
    faults.raise_all()
    return tuple(found)


def first_in_air(items: Sequence[MissionItem]) -> MissionItem | None:
    """The first item that is flown; None: there is none. A NAV_DELAY before the take-off waits on the ground."""
    return next((item for item in items if COMMANDS[item.command].flown and item.command != DELAY), None)


def next_place(items: Sequence[MissionItem], item: MissionItem) -> tuple[float, float] | None:
    """The place of the first item after that one that is flown to a place; None: there is none."""
    places = (each for each in items if each.seq > item.seq and COMMANDS[each.command].flown and each.has_place)
    return next(((each.lat_deg, each.lon_deg) for each in places), None)


def ways_from_land_starts(items: Sequence[MissionItem]) -> tuple[tuple[MissionItem, ...], ...]:
    """The items that ArduPlane flies from each DO_LAND_START to the landing, or to an earlier end."""
    found: list[tuple[MissionItem, ...]] = []
    for number, start in enumerate(items):
        if start.command == LAND_START:
            end = next((n for n, item in enumerate(items[number:], number + 1) if item.command in _LAST), len(items))
            found.append(tuple(items[number:end]))
    return tuple(found)


def _finish(
    where: Where,
    home: Home,
    items: tuple[MissionItem, ...],
    *,
    rally: tuple[RallyPoint, ...] = (),
    fence: tuple[FencePart, ...] = (),
    cruise_speed_mps: float | None = None,
    warnings: tuple[str, ...] = (),
    profile: Profile = ASSUMED,
    endless: bool = False,
) -> Route:
    """Check the route as a whole: raise if it makes no flight, warn if it makes an odd one."""
    flown, faults = [item for item in items if COMMANDS[item.command].flown], Faults()
    if len(items) > MAX_ITEMS:
        raise where.error(f"{len(items)} items (allowed: at most {MAX_ITEMS})")
    if not flown:
        raise where.error("nothing is flown (allowed: at least one item that is)")
    with faults.noted():
        home, unset = _known_home(where, home, flown)
        warnings = (*unset, *warnings)
    with faults.noted():
        check_jumps(where, items, endless=endless)
        if not profile.flies_past:
            _check_splines(where, as_flown(items))
        _check_on_ground(where, as_flown(items), profile, grounded=True)
    with faults.noted():
        _check_transitions(where, items)
    with faults.noted():
        _check_takeoff(where, home, flown, profile)
    if profile.flies_past:
        with faults.noted():
            _check_landings(where, items, profile)
    faults.raise_all()
    found = (*warnings, *_odd(items, flown, profile))
    if not rally:
        found = (*found, "no rally point: the aircraft can only return to home")
    return Route(home, items, rally, fence, cruise_speed_mps, found, profile=profile, endless=endless)


def _odd(items: Sequence[MissionItem], flown: Sequence[MissionItem], profile: Profile) -> Iterator[str]:
    """What is odd but flyable, and what the check cannot know, one line each."""
    first = first_in_air(flown)
    if first is not None and first.command not in profile.begins[1]:
        yield (
            f"the mission begins with {COMMANDS[first.command].name}, not with {profile.begins[0]}: START is refused. "
            "Take off with the remote control, then change to AUTO"
        )
    if first is not None and first.command in TAKEOFFS and profile.takeoff_needs_place and not first.has_place:
        yield (
            f"item {first.seq} ({COMMANDS[first.command].name}) has no place: the aircraft climbs ahead in the "
            "direction in which it stands. The check takes that of the next place. Give the item a place ahead on the "
            "runway"
        )
    name, ends = profile.ends
    if flown[-1].command not in (*ends, RETURN_TO_LAUNCH):
        last = COMMANDS[flown[-1].command].name
        yield f"the route ends with {last}, not with {name} or NAV_RETURN_TO_LAUNCH"
    for item in flown[:-1]:
        if item.command == RETURN_TO_LAUNCH:
            yield f"item {item.seq} is NAV_RETURN_TO_LAUNCH: what follows it is never flown"
            break
    if not profile.flies_past:
        for item in flown[:-1]:
            if item.command == LAND:
                yield (
                    f"item {item.seq} is NAV_LAND: ArduCopter disarms there. What follows it is flown only if "
                    "MIS_OPTIONS has 4 and a take-off follows"
                )
                break
    for item in flown:
        if item.command == LOITER_UNLIMITED:
            waits = "circles" if profile.holds_by_circling else "waits"
            yield (
                f"item {item.seq} is NAV_LOITER_UNLIM: the aircraft {waits} there until told to go on. No time is "
                "counted for that. The flight ends when no return site would be in reach any more"
            )
    for item in items:
        if not profile.flies_past and item.command == CHANGE_SPEED and item.param1 in _VERTICAL_SPEEDS:
            way, counted_mps = _VERTICAL_SPEEDS[item.param1]
            yield (
                f"item {item.seq} ({COMMANDS[item.command].name}) sets the speed of {way}: time and energy are counted "
                f"at {counted_mps:g} m/s"
            )
    if profile.flies_past:
        for item in items:
            if item.command == WAYPOINT and item.param1 > 0.0:
                yield (
                    f"item {item.seq} (NAV_WAYPOINT) has {item.param1:g} s to wait: ArduPlane flies on at once, as "
                    "the check counts it. NAV_LOITER_TIME circles there"
                )
    held_up = waiting(items)
    for item in items:
        if item.command in _WORST and item.seq in held_up:
            condition = held_up[item.seq]
            yield (
                f"item {item.seq} ({COMMANDS[item.command].name}) waits for item {condition.seq} "
                f"({COMMANDS[condition.command].name}), and is left out if the next place is reached first. The worst "
                f"case counts: {_WORST[item.command]}"
            )
    if not profile.flies_past:
        for item in items:
            if item.command == JUMP_TO_TAG:
                yield (
                    f"item {item.seq} is DO_JUMP_TAG: ArduCopter first flies some way towards the item after it, and "
                    "the walk does not. Use DO_JUMP where that matters"
                )
    for item in endless_jumps(items):
        yield (
            f"item {item.seq} ({COMMANDS[item.command].name}) repeats without end: one round is judged. The flight "
            "ends when no return site would be in reach any more, or when the operator ends it"
        )


def _known_home(where: Where, home: Home, flown: Sequence[MissionItem]) -> tuple[Home, tuple[str, ...]]:
    """Home, or the first place of a plan that has none, with a warning. Raises MissionError.

    Ground station programs pass over the home of a file: the autopilot sets it where it arms.
    """
    if home.is_set:
        return home, ()
    first = next((item for item in flown if item.has_place), None)
    if first is None:
        raise where.error(_NO_HOME)
    text = (
        "home is not in the plan, or at latitude 0, longitude 0. It is taken to be at item "
        f"{first.seq} ({COMMANDS[first.command].name}). Coverage, energy and returns count from there: set it to the "
        "place of the take-off"
    )
    return Home(first.lat_deg, first.lon_deg, home.alt_m), (text,)


def _check_transitions(where: Where, items: Sequence[MissionItem]) -> None:
    if not jumps(items):
        return
    for item in items:
        if item.command == VTOL_TRANSITION:
            raise where.at(f"item {item.seq}").error(
                "DO_VTOL_TRANSITION in a mission with DO_JUMP: whether the aircraft hovers after a jump is not known"
            )


def _check_on_ground(where: Where, items: Sequence[MissionItem], profile: Profile, *, grounded: bool) -> None:
    """Refuse items in the air that the aircraft does on the ground only. Raises MissionError.

    `items`: in the order of flight. `grounded`: the aircraft is on the ground before the first.
    """
    for item in items:
        if item.command in profile.not_in_air and not grounded:
            name, why = COMMANDS[item.command].name, profile.not_in_air[item.command]
            raise where.at(f"item {item.seq}").error(f"{name} is not for a {profile.name}: {why}")
        if COMMANDS[item.command].flown and item.command not in profile.not_in_air:
            grounded = item.command in LANDINGS


def _check_takeoff(where: Where, home: Home, flown: Sequence[MissionItem], profile: Profile) -> None:
    item = first_in_air(flown)
    if item is None or item.command not in TAKEOFFS:
        return
    inside = where.at(f"item {item.seq}")
    above_sea = item.frame == FRAME_ABOVE_SEA
    if item.alt_m <= (home.alt_m if above_sea else 0.0):
        height = (
            f"{item.alt_m:g} m above the sea, and home is at {home.alt_m:g} m" if above_sea else f"{item.alt_m:g} m"
        )
        raise inside.error(f"take-off to {height} (allowed: above home)")
    if not profile.takeoff_above_sea and item.frame == FRAME_ABOVE_SEA:
        raise inside.error(
            "take-off to a height above the sea, which ArduPlane adds to where it stands (allowed: above home)"
        )
    if profile.takeoff_needs_place and not item.has_place and next_place(flown, item) is None:
        raise inside.error(
            "take-off without a place, and no item after it has one (allowed: one ahead on the runway, to where it "
            "climbs)"
        )


def _check_landings(where: Where, items: Sequence[MissionItem], profile: Profile) -> None:
    """Check that each landing sequence lands, and that a landing that is broken off finds a path down.

    A return goes on to the nearest DO_LAND_START. After the end of a mission ArduPlane returns, so a sequence that does
    not land begins again. A landing that is broken off goes on with a change of altitude right after it, if there is
    one. Otherwise it goes on to the nearest DO_LAND_START, which leads down again.
    """
    for way in ways_from_land_starts(items):
        last = way[-1]
        if last.command in LANDINGS:
            continue
        ends = f"item {last.seq}, {COMMANDS[last.command].name}" if last.command in _LAST else "the end of the mission"
        raise where.at(f"item {way[0].seq}").error(
            f"DO_LAND_START leads to {ends}, and to no landing before: a return that goes there may never end "
            f"(allowed: {profile.ends[0]} before that)"
        )
    for item, behind in pairwise(items):
        if item.command == LAND and behind.command == CHANGE_ALTITUDE:
            raise where.at(f"item {behind.seq}").error(
                "NAV_CONTINUE_AND_CHANGE_ALT after NAV_LAND: a landing that is broken off would go on there, and not "
                "land (allowed: something else; by itself it goes back to the nearest DO_LAND_START)"
            )

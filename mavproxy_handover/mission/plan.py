# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the route of a mission package: QGroundControl `.plan` files and the older `.waypoints` (QGC WPL 110).

Formats: QGroundControl developer guide, "Plan File Format" (Plan 1, mission 2, geoFence 2, rallyPoints 2), and
mavlink.io, "File Formats". What comes out is what goes to the autopilot: only simple items, parameters that the file
leaves open (null, NaN) as 0, which is what ArduCopter takes them for, and frames in the form ArduCopter stores.
Survey patterns and other complex items would have to be unfolded the way QGroundControl does it; they are refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Protocol, TypeAlias

from mavproxy_handover.mission.errors import Where, parse_json
from mavproxy_handover.mission.items import (
    CHANGE_ALTITUDE,
    COMMANDS,
    DELAY,
    FRAME_ABOVE_HOME,
    FRAME_ABOVE_SEA,
    FRAME_ABOVE_TERRAIN,
    FRAME_NONE,
    JUMP,
    LAND,
    LAND_START,
    LANDINGS,
    LOITER_TURNS,
    LOITER_UNLIMITED,
    RETURN_TO_LAUNCH,
    SPLINE_WAYPOINT,
    TAKEOFFS,
    WAYPOINT,
    Command,
    MissionItem,
    RallyPoint,
    stored_radius_m,
)
from mavproxy_handover.mission.jumps import as_flown, check_jumps
from mavproxy_handover.mission.wings import AS_IT_COMES, Wings
from mavproxy_handover.vehicle.profiles import ASSUMED, Profile

__all__ = [
    "FenceCircle",
    "FencePart",
    "FencePolygon",
    "Ground",
    "Home",
    "Route",
    "on_ground",
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

#: MAV_FRAME as files have it -> as ArduCopter stores it (the _INT variants are the same frames)
_FRAMES = {
    0: FRAME_ABOVE_SEA,
    5: FRAME_ABOVE_SEA,
    3: FRAME_ABOVE_HOME,
    6: FRAME_ABOVE_HOME,
    10: FRAME_ABOVE_TERRAIN,
    11: FRAME_ABOVE_TERRAIN,
}
#: MAV_TYPE of a plan -> what it was made for, in words
_MADE_FOR: Mapping[int, str] = {
    **dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35), "a multicopter"),
    1: "a fixed-wing aircraft",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"),
    10: "a rover",
    11: "a boat",
    12: "a submarine",
}
#: after these the aircraft flies nothing by itself
_LAST = LANDINGS | {RETURN_TO_LAUNCH, LOITER_UNLIMITED}


@dataclass(frozen=True, slots=True)
class Home:
    """The planned home position; `alt_m` above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_m: float


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


def read_route(file: str, text: str, profile: Profile = ASSUMED) -> Route:
    """Read the route in `text`, for an aircraft of that profile; the ending of `file` tells the format. Raises
    MissionError."""
    where = Where(file)
    if file.endswith(".plan"):
        return _read_plan(where, text, profile)
    if file.endswith(".waypoints"):
        return _read_waypoints(where, text, profile)
    raise where.error("not a route (allowed: a file named *.plan or *.waypoints)")


# --- QGroundControl .plan ---


def _read_plan(where: Where, text: str, profile: Profile) -> Route:
    plan = where.table(parse_json(text, where), "the file")
    if plan.get("fileType") != "Plan":
        raise where.error("not a QGroundControl plan (fileType is not 'Plan')")
    _version(where, plan, "version", 1)
    mission = where.table(where.need(plan, "mission"), "mission")
    inside = where.at("mission")
    _version(inside, mission, "version", 2)
    home = Home(*_coordinate(inside, inside.need(mission, "plannedHomePosition"), "plannedHomePosition", 3))
    listed = inside.array(inside.need(mission, "items"), "items")
    items = tuple(_plan_item(where, seq, entry, profile) for seq, entry in enumerate(listed, 1))
    fence = plan.get("geoFence")
    rally = plan.get("rallyPoints")
    return _finish(
        where,
        home,
        items,
        rally=() if rally is None else _rally_points(where.at("rallyPoints"), rally),
        fence=() if fence is None else _fence(where.at("geoFence"), fence),
        cruise_speed_mps=_plan_speed(inside, mission),
        warnings=_plan_warnings(mission, profile),
        profile=profile,
    )


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


def _plan_item(where: Where, seq: int, entry: object, profile: Profile) -> MissionItem:
    inside = where.at(f"item {seq}")
    item = inside.table(entry, "the item")
    kind = inside.need(item, "type")
    if kind == "ComplexItem":
        name = item.get("complexItemType")
        shown = f" '{inside.text(name, 'complexItemType', 60)}'" if name is not None else ""
        raise inside.error(f"complex item{shown} (allowed: SimpleItem; rebuild the pattern from waypoints)")
    if kind != "SimpleItem":
        raise inside.error("type is not 'SimpleItem'")
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
    rally = where.table(value, "rallyPoints")
    if rally.get("version") == 1 and not rally.get("points"):  # QGroundControl ignores that, too
        return ()
    _version(where, rally, "version", 2)
    points = where.array(where.need(rally, "points"), "points")
    return tuple(RallyPoint(*_coordinate(where, point, f"point {number}", 3)) for number, point in enumerate(points, 1))


def _fence(where: Where, value: object) -> tuple[FencePart, ...]:
    fence = where.table(value, "geoFence")
    if fence.get("version") == 1 and not any(fence.get(part) for part in ("polygon", "polygons", "circles")):
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
    key = "hoverSpeed" if isinstance(kind, int) and _MADE_FOR.get(kind) == "a multicopter" else "cruiseSpeed"
    value = mission.get(key)
    return None if value is None else where.number(value, key, 0.1, 100.0)


def _plan_warnings(mission: Mapping[str, object], profile: Profile) -> tuple[str, ...]:
    found = []
    if mission.get("firmwareType", 3) != 3:
        found.append("the plan was made for another autopilot than ArduPilot (firmwareType is not 3)")
    made_for = mission.get("vehicleType")
    name = _MADE_FOR.get(made_for) if type(made_for) is int else None
    if name is not None and made_for not in profile.types:
        found.append(f"the plan was made for {name} (vehicleType {made_for}), the mission is for a {profile.name}")
    return tuple(found)


# --- QGC WPL 110 .waypoints ---


def _read_waypoints(where: Where, text: str, profile: Profile) -> Route:
    lines = text.splitlines()
    if not lines or lines[0].split() != ["QGC", "WPL", "110"]:
        raise where.error("not a waypoint file (allowed: a first line 'QGC WPL 110')")
    home: Home | None = None
    items: list[MissionItem] = []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip() or line.startswith("#"):
            continue
        inside = where.at(f"line {number}")
        fields = line.split()
        if len(fields) != 12:
            raise inside.error(f"{len(fields)} fields (allowed: 12)")
        seq = 0 if home is None else len(items) + 1
        if fields[0] != str(seq):
            raise inside.error(f"item number is '{fields[0][:20]}' (allowed here: {seq}, items count up from 0)")
        values = [_field(inside, field, n) for n, field in enumerate(fields[2:11], 3)]
        if home is None:
            home = Home(
                inside.number(values[6], "latitude", -90.0, 90.0),
                inside.number(values[7], "longitude", -180.0, 180.0),
                inside.number(values[8], "altitude", LOWEST_M, HIGHEST_M),
            )
            continue
        command = inside.whole(values[1], "command", 0, 65535)
        goes_on = fields[11] != "0"
        items.append(
            _item(inside, seq, command, frame=values[0], numbers=values[2:9], auto_continue=goes_on, profile=profile)
        )
    if home is None:
        raise where.error("no items (allowed: item 0 is home, item 1 the first one flown)")
    return _finish(where, home, tuple(items), profile=profile)


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
    jumps: bool = False,
) -> MissionItem:
    """Check one item. `numbers` are parameters 1 to 4, latitude, longitude, altitude; None where left open. `jumps`: it
    may be a DO_JUMP."""
    known = COMMANDS.get(command)
    if known is None or (command == JUMP and not jumps):
        raise where.error(f"command {command} is not one a mission package may hold (allowed: {_allowed(profile)})")
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
        return MissionItem(seq, command, FRAME_NONE, param1, param2, param3, param4, 0.0, 0.0, 0.0, auto_continue)
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
        where.number(numbers[4], "latitude", -90.0, 90.0),
        where.number(numbers[5], "longitude", -180.0, 180.0),
        where.number(numbers[6], "altitude", LOWEST_M, HIGHEST_M),
        auto_continue,
    )


def _allowed(profile: Profile) -> str:
    return ", ".join(
        f"{number} {command.name}"
        for number, command in COMMANDS.items()
        if number not in profile.not_flown and number != JUMP
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
    if not any(COMMANDS[item.command].flown for item in checked):
        raise where.error("nothing is flown (allowed: at least one item that is)")
    if route.profile.flies_past:
        _check_landings(where, checked, route.profile)
    else:
        _check_splines(where, checked)
    return replace(route, items=checked, return_to=None)


def on_ground(route: Route, items: Sequence[MissionItem], fence: tuple[FencePart, ...]) -> Route:
    """Copy of a plan with the mission and the geofence that the autopilot has on the ground.

    The first item is its home. The rules for a plan in a file apply. Raises MissionError.
    """
    where = Where("")
    home = Home(items[0].lat_deg, items[0].lon_deg, items[0].alt_m)
    checked = _checked(where, items[1:], route.profile, jumps=True)
    check_jumps(where, checked)
    found = _finish(
        where,
        home,
        checked,
        rally=route.rally,
        fence=fence,
        cruise_speed_mps=route.cruise_speed_mps,
        profile=route.profile,
    )
    return replace(found, wings=route.wings)


def _checked(
    where: Where, items: Sequence[MissionItem], profile: Profile, *, jumps: bool = False
) -> tuple[MissionItem, ...]:
    """Items that came from a station or from the autopilot, numbered from 1. Raises MissionError."""
    return tuple(
        _item(
            where.at(f"item {seq}"),
            seq,
            item.command,
            frame=item.frame,
            numbers=(*item.params, item.lat_deg, item.lon_deg, item.alt_m),
            auto_continue=item.auto_continue,
            profile=profile,
            jumps=jumps,
        )
        for seq, item in enumerate(items, 1)
    )


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
) -> Route:
    """Check the route as a whole: raise if it makes no flight, warn if it makes an odd one."""
    if len(items) > MAX_ITEMS:
        raise where.error(f"{len(items)} items (allowed: at most {MAX_ITEMS})")
    if home.lat_deg == home.lon_deg == 0.0:
        raise where.error("home is at latitude 0, longitude 0: it was never set (allowed: the place of the take-off)")
    flown = [item for item in items if COMMANDS[item.command].flown]
    name, begins = profile.begins
    if not flown or flown[0].command not in begins:
        first = f"the first flown item is {COMMANDS[flown[0].command].name}" if flown else "nothing is flown"
        raise where.error(f"{first} (allowed: {name} first)")
    _check_takeoff(where, home, flown[0], profile)
    found = list(warnings)
    name, ends = profile.ends
    if flown[-1].command not in (*ends, RETURN_TO_LAUNCH):
        last = COMMANDS[flown[-1].command].name
        found.append(f"the route ends with {last}, not with {name} or NAV_RETURN_TO_LAUNCH")
    for item in flown[:-1]:
        if item.command == RETURN_TO_LAUNCH:
            found.append(f"item {item.seq} is NAV_RETURN_TO_LAUNCH: what follows it is never flown")
            break
    for item in flown:
        if item.command == LOITER_UNLIMITED:
            if profile.holds_by_circling:
                circles = "it would circle there for ever (allowed: NAV_LOITER_TIME, NAV_LOITER_TURNS)"
                raise where.at(f"item {item.seq}").error(f"NAV_LOITER_UNLIM: {circles}")
            found.append(f"item {item.seq} is NAV_LOITER_UNLIM: the aircraft waits there until told to go on")
    if profile.flies_past:
        _check_landings(where, items, profile)
    else:
        _check_splines(where, as_flown(items))
    if not rally:
        found.append("no rally point: the aircraft can only return to home")
    return Route(home, items, rally, fence, cruise_speed_mps, tuple(found), profile=profile)


def _check_takeoff(where: Where, home: Home, item: MissionItem, profile: Profile) -> None:
    if item.command not in TAKEOFFS:
        return
    inside = where.at(f"item {item.seq}")
    ground = home.alt_m if item.frame == FRAME_ABOVE_SEA else 0.0
    if item.alt_m <= ground:
        raise inside.error(f"take-off to {item.alt_m:g} m (allowed: above home)")
    if not profile.takeoff_above_sea and item.frame == FRAME_ABOVE_SEA:
        raise inside.error(
            "take-off to a height above the sea, which ArduPlane adds to where it stands (allowed: above home)"
        )
    if profile.takeoff_needs_place and not item.has_place:
        raise inside.error("take-off without a place (allowed: one ahead on the runway, to where it climbs)")


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

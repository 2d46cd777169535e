# SPDX-License-Identifier: GPL-3.0-or-later

"""Some 400 plans and waypoint files that cover every mission item that ArduPilot stores.

The plans are made of tables. `ITEMS` has one row for each item, with its verdict for a copter, a plane and a quadplane.
`SITUATIONS` has what concerns a whole file: scans, jumps, frames, sections, damaged files. `cases()` makes the files:
each row once for each kind of aircraft, in turn as a `.plan` and as a `.waypoints` file. Nothing is random.

A verdict is `OK`, or the word of a reason in `REASONS`. Each reason has the words that the refusal must have, and
what a planner would say to it.

Source of `STORED`: ArduPilot's AP_Mission (`mavlink_int_to_mission_cmd`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from mavproxy_handover.mission.geodesy import offset

__all__ = ["ITEMS", "KINDS", "OK", "REASONS", "SITUATIONS", "STORED", "Case", "Item", "cases", "flight", "text_of"]

#: every MAV_CMD that ArduPilot stores in a mission
STORED: Final = frozenset(
    (
        *(16, 17, 18, 19, 20, 21, 22, 30, 31, 82, 83, 84, 85, 92, 93, 94, 213, 42702, 42703),
        *(112, 114, 115),
        *(177, 178, 179, 181, 182, 183, 184, 188, 189, 191, 193, 194, 195, 197),
        *(201, 202, 203, 205, 206, 207, 208, 210, 211, 212, 215, 216, 217, 218, 222, 223),
        *(531, 532, 534, 600, 601, 1000, 2000, 2001, 2500, 2501, 3000, 42600),
    )
)
KINDS: Final = ("copter", "plane", "quadplane")
OK: Final = ""

#: reason -> words of the refusal (a regular expression), and what a planner says to it
REASONS: Final[Mapping[str, tuple[str, str]]] = {
    "safeguard": ("takes away a safeguard", "the check before the flight would be worth nothing"),
    "unstored": ("ArduPilot does not store it", "the autopilot would refuse the whole mission"),
    "unknown path": ("the path that it makes is not known", "where it would be is not known before the flight"),
    "rover": ("only rovers", "an aircraft does not do it"),
    "parameters": ("changes the parameters of the autopilot", "it would fly otherwise afterwards"),
    "upside down": ("upside down", "its turns are not known"),
    "breaks off": ("breaks off a landing", "where it goes then is not planned"),
    "waits": ("may wait without end", "its energy is not known"),
    "again": ("flies a part of its path again", "its path is not known"),
    "other aircraft": (r"is not for a (copter|plane|quadplane)", "this kind of aircraft does not do it"),
    "number": (r"parameter \d of \w+ is ", "this autopilot cannot store it, or flies something else"),
    "no radius": ("has no radius", "ArduCopter flies the radius of its last circle"),
    "time of day": ("waits until a time of day", "it may wait for hours in the air"),
    "aims wrong": ("ArduCopter takes its numbers for a place", "the spline would be aimed at nowhere"),
    "no frame": ("frame of .* is not one with a place", "ArduPilot refuses heights of that frame"),
    "no waypoints": ("stores no waypoints", "there is nothing to fly"),
    "endless": ("repeats without end", "the battery ends before the mission does"),
    "nowhere": (r"DO_JUMP to item \d+ \(allowed", "there is no such item"),
    "no tag": (r"DO_JUMP_TAG to tag \d+", "there is no such tag"),
    "too often": ("items of it", "no battery lasts for that"),
    "hovers?": ("whether the aircraft hovers after a jump", "how it would fly after the jump is not known"),
    "no home": ("it was never set", "all heights count from home"),
    "nothing": ("nothing is flown", "it is no flight"),
    "no climb": (r"take-off to .* \(allowed: above home\)", "it would not leave the ground"),
    "above the sea": ("height above the sea, which ArduPlane adds", "it would climb too high"),
    "no direction": ("take-off without a place", "where the plane climbs to is not known"),
    "no landing": ("leads to .*, and to no landing before", "the return would never end"),
    "not down": ("a landing that is broken off would go on there", "it would climb away without a path down"),
    "latitude": ("latitude is", "there is no such place"),
    "longitude": ("longitude is", "there is no such place"),
    "height": ("altitude is", "the item has no height, or one that nothing flies at"),
    "parts": (r"\d+ (numbers|fields) \(allowed", "the file is damaged"),
    "no number": ("parameter|field", "the file is damaged"),
    "order": ("item number is", "what a jump leads to, or where home is, is not known"),
    "form": ("not a waypoint file|not a QGroundControl plan|not JSON|no items", "it is another file"),
    "old form": ("save the plan again", "what an old form means is not known"),
    "many": (r"\d+ items \(allowed: at most", "the autopilot has no room for it"),
    "key": (r"key '\w+' is missing", "the file is damaged"),
    "another kind": (r"the plan was made for a .*, the mission is for a", "its items mean other things there"),
    "corners": ("corners", "it is no area"),
}

#: home of all plans: latitude, longitude (degrees), metres above the sea
HOME: Final = (47.31, 8.12, 410.0)
_FRAME: Final = 3


@dataclass(frozen=True, slots=True)
class Item:
    """An item to write into a file: parameters 1 to 4, and metres east, north of home and up.

    `place` None: what the file has in parameters 5 to 7 is `numbers`. A parameter that is None is left open.
    """

    command: int
    params: tuple[float | None, ...] = (0, 0, 0, 0)
    place: tuple[float, float, float] | None = None
    frame: int = _FRAME
    numbers: tuple[float | None, float | None, float | None] = (0, 0, 0)

    def values(self) -> list[float | None]:
        """Parameters 1 to 7."""
        first = [*self.params, *[0.0] * (4 - len(self.params))]
        if self.place is None:
            return [*first, *self.numbers]
        east, north, up = self.place
        lat, lon = offset(*HOME[:2], east, north)
        return [*first, round(lat, 7), round(lon, 7), up]


@dataclass(frozen=True, slots=True)
class Row:
    """One item, and the verdict for each kind of aircraft. `where`: the place of the flight that it takes."""

    name: str
    item: Item
    copter: str = OK
    plane: str = OK
    quadplane: str = OK
    where: str = "middle"

    def verdict(self, kind: str) -> str:
        """For that kind of aircraft."""
        return str(getattr(self, kind))


@dataclass(frozen=True, slots=True)
class Case:
    """One file, for one kind of aircraft, and its verdict. `verdict`: `OK`, or a word of `REASONS`.

    `extra`: lines of mission.toml. `terrain`: text of a terrain file, if it brings one.
    """

    name: str
    kind: str
    file: str
    text: str
    verdict: str
    extra: str = ""
    terrain: str = ""


def waypoint(east: float, north: float, up: float = 40.0, *params: float, frame: int = _FRAME) -> Item:
    """A waypoint."""
    return Item(16, params or (0, 0, 0, 0), (east, north, up), frame)


def flight(kind: str, middle: Sequence[Item], *, begin: Item | None = None, end: Item | None = None) -> list[Item]:
    """A whole flight of that kind of aircraft, with these items in its middle."""
    if kind == "copter":
        return [
            begin or Item(22, place=(0.0, 0.0, 30.0)),
            waypoint(0.0, 120.0),
            *middle,
            waypoint(150.0, -80.0),
            end or Item(21, place=(0.0, 0.0, 0.0)),
        ]
    if kind == "quadplane":
        return [
            begin or Item(84, place=(0.0, 0.0, 40.0)),
            waypoint(0.0, 900.0, 60.0),
            *middle,
            waypoint(1500.0, -900.0, 60.0),
            waypoint(0.0, -600.0, 50.0),
            end or Item(85, place=(0.0, 0.0, 0.0)),
        ]
    return [
        begin or Item(22, (12, 0, 0, 0), (0.0, 400.0, 50.0)),
        waypoint(0.0, 1200.0, 60.0),
        *middle,
        waypoint(1500.0, -900.0, 60.0),
        Item(189, place=(0.0, -1300.0, 60.0)),
        waypoint(0.0, -1200.0, 60.0),
        waypoint(0.0, -700.0, 35.0),
        end or Item(21, place=(0.0, 0.0, 0.0)),
    ]


#: where wings fly, which have no room for a copter's distances
_FAR: Final = (900.0, 300.0, 60.0)
_NEAR: Final = (100.0, 60.0, 40.0)


def _row(name: str, command: int, params: tuple[float | None, ...] = (0, 0, 0, 0), **verdicts: str) -> Row:
    return Row(name, Item(command, params, _NEAR), **verdicts)


def _do(name: str, command: int, params: tuple[float | None, ...] = (0, 0, 0, 0), **verdicts: str) -> Row:
    return Row(name, Item(command, params), **verdicts)


def _all(reason: str) -> dict[str, str]:
    return dict.fromkeys(KINDS, reason)


def _winged(reason: str) -> dict[str, str]:
    return {"plane": reason, "quadplane": reason}


ITEMS: Final = (
    # ---- places ----
    _row("waypoint", 16),
    _row("waypoint-waits", 16, (5,)),
    _row("waypoint-near", 16, (0, 40)),
    _row("waypoint-past", 16, (0, 0, 30)),
    _row("waypoint-open", 16, (None, None, None, None)),
    _row("spline", 82, **_winged("other aircraft")),
    _row("loiter-unlimited", 17, (0, 0, 80)),
    _row("loiter-turns", 18, (2, 0, 100, 1)),
    _row("loiter-turns-left", 18, (1, 0, -120, 0)),
    _row("loiter-turns-half", 18, (0.5, 0, 90, 0)),
    _row("loiter-turns-wide", 18, (1, 0, 420, 0)),
    _row("loiter-turns-wider", 18, (1, 0, 3000, 0), **_all("number")),
    _row("loiter-turns-many", 18, (300, 0, 80, 0), **_all("number")),
    _row("loiter-turns-none", 18, (0, 0, 80, 0), **_winged("number")),
    _row("loiter-turns-no-radius", 18, (1, 0, 0, 0), copter="no radius"),
    _row("loiter-time", 19, (20, 0, 0, 0)),
    _row("loiter-time-left", 19, (20, 0, -1, 1)),
    _row("loiter-to-altitude", 31, (1, 0, 0, 0)),
    _row("loiter-to-altitude-left", 31, (0, -120, 0, 1)),
    Row("change-altitude", Item(30, (1,), (0.0, 0.0, 90.0)), "other aircraft"),
    _row("altitude-wait", 83, (100, 2, 0), **_all("unknown path")),
    _row("payload-place", 94, (5,), **_winged("other aircraft")),
    Row("return", Item(20), where="return"),
    Row("land-broken-off", Item(21, (30,), (0.0, 0.0, 0.0)), where="end"),
    Row("takeoff", Item(22, (15,), (0.0, 350.0, 45.0)), where="begin"),
    Row("takeoff-above-sea", Item(22, (15,), (0.0, 350.0, 455.0), 0), quadplane="above the sea", where="begin"),
    Row("takeoff-below", Item(22, (15,), (0.0, 350.0, 0.0)), **_all("no climb"), where="begin"),
    Row("takeoff-no-place", Item(22, (15,), None, 3, (0, 0, 45)), where="begin"),
    Row("vtol-takeoff", Item(84, (), (0.0, 0.0, 45.0)), "other aircraft", "other aircraft", where="begin"),
    Row("vtol-land", Item(85, (), (0.0, 0.0, 0.0)), "other aircraft", "other aircraft", where="end"),
    Row("vtol-land-spiral", Item(85, (1,), (0.0, 0.0, 40.0)), "other aircraft", "other aircraft", where="end"),
    # ---- waits and conditions ----
    _do("delay", 93, (5, -1, -1, -1), **_winged("other aircraft")),
    _do("delay-second", 93, (0, -1, -1, 30), **_winged("other aircraft")),
    _do("delay-hour", 93, (0, 12, 0, 0), copter="time of day", **_winged("other aircraft")),
    _do("delay-minute", 93, (0, -1, 30, 0), copter="time of day", **_winged("other aircraft")),
    _do("condition-delay", 112, (5,)),
    _do("condition-distance", 114, (50,)),
    _do("condition-yaw", 115, (90, 0, 1, 0), **_winged("other aircraft")),
    # ---- order, speed and landing sequence ----
    _do("jump", 177, (2, 2)),
    _do("jump-tag", 600, (7,)),
    _do("jump-to-tag", 601, (7, 1), **_all("no tag")),
    _do("speed-air", 178, (0, 14, -1)),
    _do("speed-ground", 178, (1, 8, -1), **_winged("number")),
    _do("speed-climb", 178, (2, 2, 0), **_winged("number")),
    Row("return-path-start", Item(188, place=_NEAR), plane="other aircraft", quadplane="other aircraft"),
    Row("land-start", Item(189, place=_NEAR)),
    _do("go-around", 191, **_all("breaks off")),
    _do("pause", 193, **_all("waits")),
    _do("repeat-distance", 215, (20,), **_all("again")),
    _do("transition-hover", 3000, (3,), copter="other aircraft", plane="other aircraft"),
    _do("transition-wings", 3000, (4,), copter="other aircraft", plane="other aircraft"),
    # ---- what takes away a safeguard ----
    Row("set-home", Item(179, (0,), _NEAR), **_all("safeguard")),
    _do("guided-enable", 92, (1,), **_all("safeguard")),
    _do("guided-limits", 222, (30, 10, 60, 200), **_all("safeguard")),
    _do("script-time", 42702, (1, 20, 0, 0), **_all("safeguard")),
    _do("script-message", 217, (1, 2, 3, 4), **_all("safeguard")),
    _do("aux-function", 218, (11, 2), **_all("safeguard")),
    _do("termination", 185, (1,), **_all("safeguard")),
    _do("fence-on", 207, (1,)),
    _do("fence-off", 207, (0,), **_all("safeguard")),
    _do("fence-floor-off", 207, (2,), **_all("safeguard")),
    _do("parachute-on", 208, (1,)),
    _do("parachute-off", 208, (0,), **_all("safeguard")),
    _do("parachute-release", 208, (2,), **_all("safeguard")),
    _do("engine-start", 223, (1, 0, 0, 0)),
    _do("engine-stop", 223, (0, 0, 0, 0), **_all("safeguard")),
    # ---- what changes how it flies ----
    _do("attitude-time", 42703, (5, 10, 5, 0), **_all("unknown path")),
    _do("yaw-speed", 213, (30, 2, 0), **_all("rover")),
    _do("reverse", 194, (1,), **_all("rover")),
    _do("inverted", 210, (1,), **_all("upside down")),
    _do("autotune", 212, (1,), **_all("parameters")),
    # ---- servos, payload, cameras ----
    _do("relay", 181, (0, 1)),
    _do("relay-repeat", 182, (0, 3, 2)),
    _do("servo", 183, (9, 1500)),
    _do("servo-repeat", 184, (9, 1500, 3, 2)),
    _do("gripper", 211, (1, 0)),
    _do("sprayer", 216, (1,)),
    _do("winch", 42600, (1, 1, 5, 1), **_winged("other aircraft")),
    Row("roi-location", Item(195, place=_NEAR)),
    _do("roi-none", 197),
    Row("roi", Item(201, (3,), _NEAR)),
    Row("digicam-configure", Item(202, (1, 60, 4, 100), None, 2, (0, 0, 0))),
    Row("digicam-control", Item(203, (0, 0, 0, 0), None, 2, (1, 0, 0))),
    _do("mount-control", 205, (-45, 0, 90, 0)),
    _do("trigger-distance", 206, (25, 0, 1)),
    _do("zoom", 531, (1, 2.5)),
    _do("focus", 532, (4, 0)),
    _do("source", 534, (0, 1, 2)),
    Row("gimbal", Item(1000, (-30, 90, 0, 0), None, 2, (12, 0, 0))),
    _do("image-start", 2000, (0, 2, 10, 0)),
    _do("image-stop", 2001),
    _do("video-start", 2500, (0, 1)),
    _do("video-stop", 2501),
    # ---- what files have, and ArduPilot does not store ----
    _do("camera-mode", 530, (0, 0), **_all("unstored")),
    _do("control-video", 200, (-1, 0, 0, 2), **_all("unstored")),
    _do("mount-configure", 204, (2, 0, 0, 0), **_all("unstored")),
    _row("follow", 32, **_all("unstored")),
    _do("no-command", 64999, **_all("unstored")),
)


# --- files ---


def text_of(form: str, items: Sequence[Item], *, kind: str = "copter", **changes: Any) -> str:
    """A file in the form `plan` or `waypoints`. `changes`: entries of the plan that replace others."""
    return _plan(items, kind, **changes) if form == "plan" else _waypoints(items)


def _waypoints(items: Sequence[Item]) -> str:
    rows = [f"0\t1\t0\t16\t0\t0\t0\t0\t{HOME[0]:.7f}\t{HOME[1]:.7f}\t{HOME[2]:g}\t1"]
    for seq, item in enumerate(items, 1):
        values = "\t".join("nan" if value is None else f"{value:.7f}" for value in item.values())
        rows.append(f"{seq}\t0\t{item.frame}\t{item.command}\t{values}\t1")
    return "\n".join(["QGC WPL 110", *rows, ""])


def _simple(number: int, item: Item) -> dict[str, Any]:
    return {
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": item.values(),
        "type": "SimpleItem",
    }


_VEHICLE_TYPES: Final = {"copter": 2, "plane": 1, "quadplane": 20}


def _plan(items: Sequence[Item | dict[str, Any]], kind: str, **changes: Any) -> str:
    mission = {
        "version": 2,
        "firmwareType": 3,
        "vehicleType": _VEHICLE_TYPES[kind],
        "cruiseSpeed": 15,
        "hoverSpeed": 8,
        "plannedHomePosition": list(HOME),
        "items": [_simple(n, item) if isinstance(item, Item) else item for n, item in enumerate(items, 1)],
    }
    mission.update({key: value for key, value in changes.items() if key in (*mission, "extra")})
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": mission,
    }
    plan.update({key: value for key, value in changes.items() if key in plan})
    return json.dumps(plan)


# --- situations: whole files ---


@dataclass(frozen=True, slots=True)
class Situation:
    """A whole file, made by `make` for a kind of aircraft in a form."""

    name: str
    make: Callable[[str, str], str]
    verdict: str = OK
    kinds: tuple[str, ...] = ("copter",)
    forms: tuple[str, ...] = ("plan",)
    extra: str = ""
    terrain: str = field(default="", repr=False)


def _middle(*items: Item) -> Callable[[str, str], str]:
    return lambda kind, form: text_of(form, flight(kind, items), kind=kind)


def _items(*items: Item) -> Callable[[str, str], str]:
    return lambda kind, form: text_of(form, items, kind=kind)


def _changed(**changes: Any) -> Callable[[str, str], str]:
    return lambda kind, form: text_of(form, flight(kind, [waypoint(*_NEAR)]), kind=kind, **changes)


def _lines(change: Callable[[list[str]], list[str]]) -> Callable[[str, str], str]:
    return lambda kind, form: "\n".join(change(text_of(form, flight(kind, [waypoint(*_NEAR)])).splitlines()))


def _scan(name: str, *items: Item, stored: bool = True) -> Callable[[str, str], str]:
    def make(kind: str, _form: str) -> str:
        entries = flight(kind, [])
        inside = [_simple(3 + number, item) for number, item in enumerate(items)]
        scan = {"type": "ComplexItem", "complexItemType": name}
        pattern = {"TransectStyleComplexItem": {"Items": inside}} if stored else {"polygon": [[47.31, 8.12]]}
        return _plan([*entries[:2], {**scan, **pattern}, *entries[2:]], kind)

    return make


def _pattern(kind: str, **changes: Any) -> str:
    """A plan of wings that ends with a landing pattern, which stores no items."""
    lat, lon = offset(*HOME[:2], 0.0, -1200.0)
    pattern: dict[str, Any] = {
        "type": "ComplexItem",
        "complexItemType": "fwLandingPattern" if kind == "plane" else "vtolLandingPattern",
        "version": 2,
        "altitudesAreRelative": True,
        "landCoordinate": [*HOME[:2], 0.0],
        "landingApproachCoordinate": [lat, lon, 40.0],
        "loiterClockwise": True,
        "loiterRadius": 120.0,
        "stopTakingPhotos": True,
        "stopVideoPhotos": True,
        "useLoiterToAlt": True,
        "valueSetIsDistance": True,
        **changes,
    }
    kept = {key: value for key, value in pattern.items() if value is not None}
    return _plan([*flight(kind, [waypoint(*_FAR)])[:4], kept], kind)


def _lands(**changes: Any) -> Callable[[str, str], str]:
    return lambda kind, _form: _pattern(kind, **changes)


def _lawn(step: float, rows: int, *between: Item) -> tuple[Item, ...]:
    """Rows of a survey."""
    found: list[Item] = []
    for number in range(rows):
        east = 40.0 + step * number
        ends = (20.0, 200.0) if number % 2 == 0 else (200.0, 20.0)
        found += [waypoint(east, ends[0], 40.0), *between, waypoint(east, ends[1], 40.0)]
    return tuple(found)


def _takes(*lists: str) -> dict[str, Any]:
    return {"version": 2, **{each: [] for each in lists}}


_RING: Final = [
    list(offset(*HOME[:2], east, north)) for east, north in ((-2e3, -2e3), (2e3, -2e3), (2e3, 2e3), (-2e3, 2e3))
]
#: a take-off without a place
_UP: Final = Item(22, (15,), None, 3, (0, 0, 45))
_FLAT: Final = "ncols 5\nnrows 5\nxllcorner 8.08\nyllcorner 47.28\ncellsize 0.02\n" + "410 410 410 410 410\n" * 5
_WINGS: Final = ("plane", "quadplane")
_JUMPS: Final = ("copter", "plane", "quadplane")
_BOTH: Final = ("plan", "waypoints")

SITUATIONS: Final = (
    Situation("survey", _scan("survey", *_lawn(30.0, 4, Item(206, (20, 0, 1))), Item(206))),
    Situation("corridor", _scan("CorridorScan", *_lawn(15.0, 2))),
    Situation("structure", _scan("StructureScan", *(waypoint(60, 60, up) for up in (30.0, 40.0, 50.0)))),
    Situation("scan-without-waypoints", _scan("survey", stored=False), "no waypoints"),
    Situation("jump-back-twice", _middle(waypoint(200, 50), Item(177, (2, 2))), kinds=_JUMPS, forms=_BOTH),
    Situation("jump-back-none", _middle(waypoint(200, 50), Item(177, (3, 0))), forms=_BOTH),
    Situation("jump-ahead", _middle(Item(177, (5, 1)), waypoint(200, 50)), forms=_BOTH),
    Situation("jumps-nested", _middle(waypoint(200, 50), Item(177, (2, 1)), waypoint(250, 80), Item(177, (3, 1)))),
    Situation(
        "jump-to-tag",
        _middle(Item(600, (4,)), waypoint(200, 50), waypoint(120, 160), Item(601, (4, 3))),
        forms=_BOTH,
    ),
    Situation(
        "jump-to-tag-far",
        _middle(Item(600, (4,)), waypoint(1400, 900, 60), waypoint(400, 1900, 60), Item(601, (4, 1))),
        kinds=_WINGS,
        forms=_BOTH,
    ),
    Situation("jump-endless", _middle(waypoint(200, 50), Item(177, (3, -1))), "endless", forms=_BOTH),
    Situation(
        "jump-endless-declared",
        _middle(waypoint(200, 50), Item(177, (3, -1))),
        forms=_BOTH,
        extra="endless_jump = true",
    ),
    Situation("jump-to-nowhere", _middle(Item(177, (60, 1))), "nowhere", forms=_BOTH),
    Situation("jump-to-itself", _middle(Item(177, (3, 1))), "nowhere", forms=_BOTH),
    Situation("jump-too-often", _middle(waypoint(200, 50), Item(177, (3, 3000))), "too often", forms=_BOTH),
    Situation("jump-transition", _middle(Item(3000, (4,)), Item(177, (2, 1))), "hovers?", ("quadplane",), _BOTH),
    Situation("spline-then-delay", _middle(Item(82, place=_NEAR), Item(93, (5, -1, -1, -1))), "aims wrong"),
    Situation(
        "splines",
        _middle(Item(82, place=(200, 100, 40)), Item(82, (3,), (200, 0, 60)), Item(82, place=(80, 20, 40))),
        forms=_BOTH,
    ),
    Situation("no-take-off", _items(waypoint(50, 50), waypoint(90, 0), Item(20)), forms=_BOTH),
    Situation("return-in-the-middle", _middle(Item(20), waypoint(90, 0)), forms=_BOTH),
    Situation("two-landings", _middle(Item(21, place=(50, 50, 0)), Item(22, place=(50, 50, 30))), forms=_BOTH),
    Situation("nothing-flown", _items(Item(183, (9, 1500)), Item(206, (20,))), "nothing", forms=_BOTH),
    Situation("empty", _items(), "nothing"),
    Situation("height-0", _middle(waypoint(100, 60, 0.0)), forms=_BOTH),
    Situation("place-0", _middle(Item(19, (10,), None, 3, (0, 0, 40))), forms=_BOTH),
    Situation("latitude", _middle(Item(16, (), None, 3, (91.5, 8.0, 40))), "latitude", forms=_BOTH),
    Situation("longitude", _middle(Item(16, (), None, 3, (47.0, 181.0, 40))), "longitude", forms=_BOTH),
    Situation("height-open", _middle(Item(16, (), None, 3, (47.31, 8.121, None))), "height", forms=_BOTH),
    Situation("height-in-centimetres", _middle(waypoint(50, 50, 40000.0)), "height", forms=_BOTH),
    Situation("many", _middle(*[waypoint(50, 50 + n / 10) for n in range(700)]), "many"),
    *(
        Situation(f"frame-{frame}", _middle(waypoint(100, 60, up, frame=frame)), forms=(form,))
        for frame, up, form in (
            *((0, 450.0, "plan"), (2, 450.0, "waypoints"), (5, 450.0, "plan")),
            *((3, 40.0, "waypoints"), (6, 40.0, "plan")),
            *((10, 40.0, "waypoints"), (11, 40.0, "plan")),
        )
    ),
    *(
        Situation(f"frame-{frame}", _middle(waypoint(100, 60, 40.0, frame=frame)), "no frame", forms=_BOTH)
        for frame in (1, 4, 8, 20)
    ),
    Situation(
        "terrain-known",
        _middle(waypoint(100, 60, 40.0, frame=10)),
        forms=_BOTH,
        extra='terrain = "ground.asc"',
        terrain=_FLAT,
    ),
    Situation("home-0", _changed(plannedHomePosition=[0, 0, 0])),
    Situation(
        "home-nowhere",
        lambda kind, form: text_of(form, [_UP, Item(20)], kind=kind, plannedHomePosition=[0, 0, 0]),
        "no home",
    ),
    Situation("home-height-open", _changed(plannedHomePosition=[*HOME[:2], None])),
    Situation("home-short", _changed(plannedHomePosition=[47.31, 8.12]), "parts"),
    Situation("mission-version-1", _changed(version=1, mission={"version": 1, "items": []}), "old form"),
    Situation("empty-rally-of-version-1", _changed(rallyPoints={"version": 1, "points": []})),
    Situation("empty-fence-of-version-1", _changed(geoFence={"version": 1})),
    Situation("sections-missing", _changed(rallyPoints=None, geoFence=None)),
    Situation("rally", _changed(rallyPoints={"version": 2, "points": [[47.311, 8.121, 30]]})),
    Situation("rally-of-version-1", _changed(rallyPoints={"version": 1, "points": [[47.311, 8.121, 30]]}), "old form"),
    Situation("rally-off-earth", _changed(rallyPoints={"version": 2, "points": [[97.0, 8.1, 30]]}), "latitude"),
    Situation("fence", _changed(geoFence={**_takes("circles"), "polygons": [{"inclusion": True, "polygon": _RING}]})),
    Situation(
        "fence-of-two-corners",
        _changed(geoFence={**_takes("circles"), "polygons": [{"inclusion": True, "polygon": _RING[:2]}]}),
        "corners",
    ),
    *(
        Situation(f"made-for-{made_for}", _changed(vehicleType=made_for), "another kind", (kind,))
        for made_for, kind in ((1, "copter"), (20, "copter"), (10, "copter"), (2, "plane"), (2, "quadplane"))
    ),
    Situation("made-for-hexacopter", _changed(vehicleType=13)),
    Situation("another-file", _changed(fileType="Params"), "form"),
    Situation("cut-short", lambda kind, form: text_of(form, flight(kind, []))[:300], "form"),
    Situation("line-ends", _lines(lambda rows: [row + "\r" for row in rows]), forms=("waypoints",)),
    Situation(
        "spaces", _lines(lambda rows: [rows[0], *(row.replace("\t", "  ") for row in rows[1:])]), forms=("waypoints",)
    ),
    Situation("first-line", _lines(lambda rows: rows[1:]), "form", forms=("waypoints",)),
    Situation("home-alone", _lines(lambda rows: rows[:2]), "nothing", forms=("waypoints",)),
    Situation("line-missing", _lines(lambda rows: [*rows[:3], *rows[4:]]), forms=("waypoints",)),
    Situation("lines-from-1", _lines(lambda rows: [rows[0], *rows[2:]]), forms=("waypoints",)),
    Situation("lines-from-3", _lines(lambda rows: [rows[0], *rows[4:]]), "order", forms=("waypoints",)),
    Situation(
        "line-missing-before-jump",
        _lines(lambda rows: [*rows[:3], *rows[4:], "9\t0\t2\t177\t2\t1\t0\t0\t0\t0\t0\t1"]),
        "order",
        forms=("waypoints",),
    ),
    Situation("line-cut", _lines(lambda rows: [*rows[:3], rows[3][:20], *rows[4:]]), "parts", forms=("waypoints",)),
    Situation(
        "word", _lines(lambda rows: [*rows[:3], rows[3].replace("16", "x", 1)]), "no number", forms=("waypoints",)
    ),
    # ---- wings ----
    Situation("take-off-nowhere", _items(_UP, Item(20)), "no direction", ("plane",), _BOTH),
    Situation("landing-pattern", _lands(), OK, _WINGS),
    Situation("landing-pattern-straight", _lands(useLoiterToAlt=False), OK, _WINGS),
    Situation("landing-pattern-left", _lands(loiterClockwise=False, stopTakingPhotos=False), OK, _WINGS),
    Situation(
        "landing-pattern-of-version-1",
        _lands(version=1, altitudesAreRelative=None, loiterAltitudeRelative=True, landingAltitudeRelative=False),
        OK,
        _WINGS,
    ),
    Situation("landing-pattern-cut", _lands(landCoordinate=None), "key", _WINGS),
    Situation("landing-pattern-flat", _lands(landCoordinate=list(HOME[:2])), "parts", _WINGS),
    Situation(
        "sequence-without-landing",
        _items(*flight("plane", [])[:-1], Item(20)),
        "no landing",
        ("plane",),
        _BOTH,
    ),
    Situation(
        "climb-after-landing",
        _items(*flight("plane", []), Item(30, (1,), (0.0, 300.0, 60.0))),
        "not down",
        ("plane",),
        _BOTH,
    ),
    Situation(
        "turn-by-turn", _middle(waypoint(1400, 900, 60), waypoint(1400, -500, 90)), OK, ("plane", "quadplane"), _BOTH
    ),
    Situation(
        "down-in-a-circle",
        _items(*flight("plane", [])[:5], Item(31, (1, 120, 0, 1), (0, -1200, 40)), *flight("plane", [])[-2:]),
        OK,
        ("plane",),
        _BOTH,
    ),
)


# --- all of them ---


def cases() -> Iterator[Case]:
    """All files, in a fixed order."""
    number = 0
    for row in ITEMS:
        for kind in KINDS:
            number += 1
            form = "plan" if number % 2 else "waypoints"
            yield Case(
                f"{row.name}-{kind}",
                kind,
                f"route.{form}",
                text_of(form, _flight_of(kind, row), kind=kind),
                row.verdict(kind),
            )
    for each in SITUATIONS:
        for kind in each.kinds:
            for form in each.forms:
                name = f"{each.name}-{kind}-{form}"
                yield Case(name, kind, f"route.{form}", each.make(kind, form), each.verdict, each.extra, each.terrain)


def _flight_of(kind: str, row: Row) -> list[Item]:
    item = row.item
    if item.place == _NEAR and kind != "copter":
        item = Item(item.command, item.params, _FAR, item.frame)
    if row.where == "begin":
        return flight(kind, [], begin=item)
    if row.where == "end":
        return flight(kind, [], end=item)
    if row.where == "return":  # a landing sequence after it is for the return
        whole = flight(kind, [])
        return [*whole[:-1], item] if kind != "plane" else [*whole[:3], item, *whole[3:]]
    behind = [waypoint(200.0, 60.0)] if kind == "copter" else [waypoint(1900.0, 300.0, 60.0)]
    return flight(kind, [item, *behind])

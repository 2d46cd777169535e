# SPDX-License-Identifier: GPL-3.0-or-later

"""Mission items and rally points as they go to the autopilot, and what the autopilot keeps of them.

`COMMANDS` lists the allowed commands of a mission package. Each entry has the parameters that ArduPilot stores and the
kinds of aircraft that fly it. The list is shorter than the autopilot's own: `refused_items.py` says which commands no
mission may have, and why. DO_JUMP and DO_JUMP_TAG are walked (`jumps.py`).
ArduCopter and ArduPlane share one mission storage, so each stores much that it then passes over in flight; what an
aircraft would pass over is not for it.

ArduPilot does not store an item as it got it (AP_Mission, `mavlink_int_to_mission_cmd`): whole numbers are cut off,
signs kept without their value, unused parameters forgotten, altitudes held in centimetres. `difference` knows that, so
that a mission that was written can be read back and compared. Of a waypoint ArduCopter keeps the time to wait, and
ArduPlane in the same place how near and how far past it is flown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mavproxy_handover.vehicle.profiles import ASSUMED, Profile

__all__ = [
    "CHANGE_ALTITUDE",
    "CHANGE_SPEED",
    "COMMANDS",
    "CONDITIONS",
    "DELAY",
    "FRAME_ABOVE_HOME",
    "FRAME_ABOVE_SEA",
    "FRAME_ABOVE_TERRAIN",
    "FRAME_NONE",
    "GRIPPER",
    "JUMP",
    "JUMPS",
    "JUMP_TAG",
    "JUMP_TO_TAG",
    "LAND",
    "LANDINGS",
    "LAND_START",
    "LOITERS",
    "LOITER_TIME",
    "LOITER_TO_ALTITUDE",
    "LOITER_TURNS",
    "LOITER_UNLIMITED",
    "PAYLOAD_PLACE",
    "RETURN_TO_LAUNCH",
    "SPLINE_WAYPOINT",
    "TAKEOFF",
    "TAKEOFFS",
    "VTOL_LAND",
    "VTOL_TAKEOFF",
    "VTOL_TRANSITION",
    "WAYPOINT",
    "Command",
    "MissionItem",
    "RallyPoint",
    "difference",
    "stored_radius_m",
    "stored_turns",
    "alike",
]

#: MAV_FRAME values that ArduPilot stores; the others that exist are written as one of these
FRAME_ABOVE_SEA = 0
FRAME_NONE = 2
FRAME_ABOVE_HOME = 3
FRAME_ABOVE_TERRAIN = 10

WAYPOINT = 16
LOITER_UNLIMITED = 17
LOITER_TURNS = 18
LOITER_TIME = 19
RETURN_TO_LAUNCH = 20
LAND = 21
TAKEOFF = 22
CHANGE_ALTITUDE = 30
LOITER_TO_ALTITUDE = 31
SPLINE_WAYPOINT = 82
VTOL_TAKEOFF = 84
VTOL_LAND = 85
DELAY = 93
PAYLOAD_PLACE = 94
JUMP = 177
CHANGE_SPEED = 178
LAND_START = 189
GRIPPER = 211
JUMP_TAG = 600
JUMP_TO_TAG = 601
VTOL_TRANSITION = 3000

TAKEOFFS = frozenset((TAKEOFF, VTOL_TAKEOFF))
LANDINGS = frozenset((LAND, VTOL_LAND))
#: what follows one of these on the way waits for it
CONDITIONS = frozenset((112, 114, 115))
#: these go on with another item than the next one
JUMPS = frozenset((JUMP, JUMP_TO_TAG))
#: what wings fly as circles
LOITERS = frozenset((LOITER_UNLIMITED, LOITER_TURNS, LOITER_TIME, LOITER_TO_ALTITUDE))


@dataclass(frozen=True, slots=True)
class Command:
    """One MAV_CMD of a mission.

    `kept` has a letter for each of the parameters 1 to 4, for what ArduPilot stores of it. `f`: the value; `i`: its
    whole part; `s`: its sign; `b`: 1 if it is above zero; `-`: nothing; `y`: its whole part up to 255; `t`: its whole
    part up to 255, below 1 in parts of 256; `r`: a radius in metres up to 255, beyond that in tens of metres up to
    2550. `flown` marks the commands that move the aircraft or make it wait; the rest are done on the way. `located`
    commands carry a place. A profile says which commands its aircraft does not fly, and where its autopilot stores
    something else. `numbered` commands have numbers where others have a place (parameters 5 to 7), and the autopilot
    stores them.
    """

    name: str
    located: bool
    flown: bool
    kept: str
    numbered: bool = False


COMMANDS: Mapping[int, Command] = {
    WAYPOINT: Command("NAV_WAYPOINT", True, True, "i---"),
    LOITER_UNLIMITED: Command("NAV_LOITER_UNLIM", True, True, "--i-"),
    LOITER_TURNS: Command("NAV_LOITER_TURNS", True, True, "t-rb"),
    LOITER_TIME: Command("NAV_LOITER_TIME", True, True, "i-sb"),
    RETURN_TO_LAUNCH: Command("NAV_RETURN_TO_LAUNCH", False, True, "----"),
    LAND: Command("NAV_LAND", True, True, "i--s"),
    TAKEOFF: Command("NAV_TAKEOFF", True, True, "i---"),
    CHANGE_ALTITUDE: Command("NAV_CONTINUE_AND_CHANGE_ALT", True, True, "i---"),
    LOITER_TO_ALTITUDE: Command("NAV_LOITER_TO_ALT", True, True, "-i-b"),
    SPLINE_WAYPOINT: Command("NAV_SPLINE_WAYPOINT", True, True, "i---"),
    VTOL_TAKEOFF: Command("NAV_VTOL_TAKEOFF", True, True, "----"),
    VTOL_LAND: Command("NAV_VTOL_LAND", True, True, "i---"),
    DELAY: Command("NAV_DELAY", False, True, "fiii"),
    PAYLOAD_PLACE: Command("NAV_PAYLOAD_PLACE", True, True, "f---"),
    112: Command("CONDITION_DELAY", False, False, "f---"),
    114: Command("CONDITION_DISTANCE", False, False, "f---"),
    115: Command("CONDITION_YAW", False, False, "ffib"),
    JUMP: Command("DO_JUMP", False, False, "ii--"),
    CHANGE_SPEED: Command("DO_CHANGE_SPEED", False, False, "iff-"),
    181: Command("DO_SET_RELAY", False, False, "ii--"),
    182: Command("DO_REPEAT_RELAY", False, False, "iif-"),
    183: Command("DO_SET_SERVO", False, False, "ii--"),
    184: Command("DO_REPEAT_SERVO", False, False, "iiif"),
    188: Command("DO_RETURN_PATH_START", True, False, "----"),
    LAND_START: Command("DO_LAND_START", True, False, "----"),
    195: Command("DO_SET_ROI_LOCATION", True, False, "----"),
    197: Command("DO_SET_ROI_NONE", False, False, "----"),
    201: Command("DO_SET_ROI", True, False, "i---"),
    202: Command("DO_DIGICAM_CONFIGURE", False, False, "iiii", numbered=True),
    203: Command("DO_DIGICAM_CONTROL", False, False, "iiii", numbered=True),
    205: Command("DO_MOUNT_CONTROL", False, False, "fff-"),
    206: Command("DO_SET_CAM_TRIGG_DIST", False, False, "f---"),
    207: Command("DO_FENCE_ENABLE", False, False, "i---"),
    208: Command("DO_PARACHUTE", False, False, "i---"),
    GRIPPER: Command("DO_GRIPPER", False, False, "ii--"),
    216: Command("DO_SPRAYER", False, False, "i---"),
    223: Command("DO_ENGINE_CONTROL", False, False, "bbf-"),
    531: Command("SET_CAMERA_ZOOM", False, False, "if--"),
    532: Command("SET_CAMERA_FOCUS", False, False, "if--"),
    534: Command("SET_CAMERA_SOURCE", False, False, "iii-"),
    JUMP_TAG: Command("JUMP_TAG", False, False, "i---"),
    JUMP_TO_TAG: Command("DO_JUMP_TAG", False, False, "ii--"),
    1000: Command("DO_GIMBAL_MANAGER_PITCHYAW", False, False, "iiii", numbered=True),
    2000: Command("IMAGE_START_CAPTURE", False, False, "ifii"),
    2001: Command("IMAGE_STOP_CAPTURE", False, False, "i---"),
    2500: Command("VIDEO_START_CAPTURE", False, False, "i---"),
    2501: Command("VIDEO_STOP_CAPTURE", False, False, "i---"),
    VTOL_TRANSITION: Command("DO_VTOL_TRANSITION", False, False, "i---"),
    42600: Command("DO_WINCH", False, False, "iiff"),
}


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One mission item, fields as in MISSION_ITEM_INT (degrees and metres instead of scaled integers).

    `seq` is its number in the autopilot, where 0 is home. `frame` is one of the FRAME values above. Parameters 5 to 7
    of a numbered command (`Command`) are stored as MISSION_ITEM_INT has them: `lat_deg` and `lon_deg` in 1e-7.
    """

    seq: int
    command: int
    frame: int
    param1: float
    param2: float
    param3: float
    param4: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    auto_continue: bool = True

    @property
    def params(self) -> tuple[float, float, float, float]:
        """Parameters 1 to 4."""
        return self.param1, self.param2, self.param3, self.param4

    @property
    def has_place(self) -> bool:
        """The item carries a place. Latitude and longitude both 0 mean "where the aircraft is" to ArduPilot."""
        return COMMANDS[self.command].located and (self.lat_deg != 0.0 or self.lon_deg != 0.0)


@dataclass(frozen=True, slots=True)
class RallyPoint:
    """A return site other than home; `alt_m` above home. ArduPilot stores the altitude in whole metres."""

    lat_deg: float
    lon_deg: float
    alt_m: float


#: half of the last digit of a coordinate, degrees; altitudes are kept in whole metres
_ROUNDING_DEG, _ROUNDING_M = 1.5e-7, 1.0


def alike(one: RallyPoint, other: RallyPoint) -> bool:
    """Whether two points are the same to the autopilot."""
    near = max(abs(one.lat_deg - other.lat_deg), abs(one.lon_deg - other.lon_deg)) <= _ROUNDING_DEG
    return near and abs(one.alt_m - other.alt_m) <= _ROUNDING_M


def _stored(value: float, letter: str) -> float:
    if letter == "f":
        return value
    if letter == "i":
        return float(int(value))
    if letter == "b":
        return 1.0 if value > 0 else 0.0
    if letter == "y":
        return float(min(255, int(value)))
    if letter == "t":
        return int(256.0 * value) / 256.0 if 0.0 < value < 1.0 else float(min(255, int(value)))
    if letter == "r":
        radius = abs(value)
        return math.copysign(int(radius) if radius <= 255.0 else 10 * min(255, int(radius // 10.0)), value)
    return (-1.0 if value < 0 else 1.0) if letter == "s" else 0.0


def stored_radius_m(radius_m: float) -> float:
    """What ArduPilot keeps of the radius of NAV_LOITER_TURNS, with its sign: below 0 to the left."""
    return _stored(radius_m, "r")


def stored_turns(turns: float) -> float:
    """What ArduPilot keeps of the turns of NAV_LOITER_TURNS."""
    return _stored(turns, "t")


def difference(sent: MissionItem, got: MissionItem, profile: Profile = ASSUMED) -> str | None:
    """Text about how an item read back from an aircraft differs from the sent one; None if it does not.

    Rounding and values that the autopilot does not store are no difference. Item 0 is home, which the autopilot sets
    itself, so comparing it is meaningless.
    """
    if got.command != sent.command:
        return f"item {sent.seq}: command {sent.command} came back as {got.command}"
    command = COMMANDS[sent.command]
    kept = profile.stores.get(sent.command, command.kept)
    for number, letter, ours, theirs in zip((1, 2, 3, 4), kept, sent.params, got.params, strict=True):
        want, have = _stored(ours, letter), _stored(theirs, letter)
        if not abs(want - have) <= 0.01 + 1e-6 * abs(want):
            return f"item {sent.seq}: parameter {number} {want:g} came back as {have:g}"
    if command.numbered:
        return _numbers_differ(sent, got)
    if not command.located:
        return None
    if got.frame != sent.frame:
        return f"item {sent.seq}: frame {sent.frame} came back as {got.frame}"
    for name, ours, theirs in (
        ("latitude", sent.lat_deg, got.lat_deg),
        ("longitude", sent.lon_deg, got.lon_deg),
    ):
        if not abs(ours - theirs) <= 1.5e-7:
            return f"item {sent.seq}: {name} {ours:.7f} came back as {theirs:.7f}"
    if not abs(sent.alt_m - got.alt_m) <= 0.02:
        return f"item {sent.seq}: altitude {sent.alt_m:g} m came back as {got.alt_m:g} m"
    return None


def _numbers_differ(sent: MissionItem, got: MissionItem) -> str | None:
    """Text about how parameters 5 and 6 of a numbered command differ; None if they do not.

    ArduPilot stores parameter 7 as a number of 8 bits, or not at all.
    """
    for number, ours, theirs in ((5, sent.lat_deg, got.lat_deg), (6, sent.lon_deg, got.lon_deg)):
        if round(ours * 1e7) != round(theirs * 1e7):
            return f"item {sent.seq}: parameter {number} {ours * 1e7:.0f} came back as {theirs * 1e7:.0f}"
    return None

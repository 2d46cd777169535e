# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of a mission item that the autopilot stores, and so returns.

ArduPilot stores items in a few bytes each: a waypoint keeps its delay and place, nothing else; altitudes are whole
centimetres; relative and absolute altitudes survive, other frames are turned into those two or refused; parameters that
a command does not use come back as zero. `stored` applies this at once, so that read-back is simply what is stored.
Source of the facts: AP_Mission::mavlink_int_to_mission_cmd and mission_cmd_to_mavlink_int, MissionItemProtocol_Rally
and _Fence of ArduCopter 4.7.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

__all__ = ["Cmd", "Item", "Result", "command_name", "is_nav", "stored", "stored_fence", "stored_rally", "whole_fence"]


class Cmd(IntEnum):
    """MAV_CMD values used by the model."""

    WAYPOINT = 16
    LOITER_UNLIM = 17
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RTL = 20
    LAND = 21
    TAKEOFF = 22
    LOITER_TO_ALT = 31
    SPLINE_WAYPOINT = 82
    GUIDED_ENABLE = 92
    DELAY = 93
    CONDITION_DELAY = 112
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_JUMP = 177
    CHANGE_SPEED = 178
    SET_HOME = 179
    GRIPPER = 211
    RALLY_POINT = 5100


class Result(IntEnum):
    """MAV_MISSION_RESULT values used."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


@dataclass(frozen=True, slots=True)
class Item:
    """A mission item as on the wire: x and y in 1e-7 degrees, z in metres counted as `frame` says."""

    command: int
    frame: int = 0
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: int = 1

    @property
    def params(self) -> tuple[float, float, float, float]:
        return self.param1, self.param2, self.param3, self.param4


_GLOBAL, _RELATIVE, _TERRAIN = 0, 3, 10
_FRAMES = {0: _GLOBAL, 2: _GLOBAL, 5: _GLOBAL, 3: _RELATIVE, 6: _RELATIVE, 10: _TERRAIN, 11: _TERRAIN}
_MAX_ALT_M = 83_000.0

Params = tuple[float, float, float, float]


def _u16(value: float) -> float:
    return float(int(value) & 0xFFFF) if math.isfinite(value) else 0.0


def _sign(value: float) -> float:
    return -1.0 if value < 0 else 1.0


def _flag(value: float) -> float:
    return 1.0 if value > 0 else 0.0


def _none(_: Params) -> Params:
    return 0.0, 0.0, 0.0, 0.0


def _first(p: Params) -> Params:
    return _u16(p[0]), 0.0, 0.0, 0.0


def _all(p: Params) -> Params:
    return p


def _turns(p: Params) -> Params:
    turns, radius = abs(p[0]), abs(p[2])
    turns = int(turns * 256) / 256 if 0 < turns < 1 else min(255, int(turns))
    radius = int(radius) if radius <= 255 else min(255, int(radius * 0.1)) * 10
    return float(turns), 0.0, math.copysign(radius, p[2]), _flag(p[3])


#: command -> (carries a place, name in the autopilot's texts, what is kept of param1..4)
_RULES: dict[int, tuple[bool, str, Callable[[Params], Params]]] = {
    Cmd.WAYPOINT: (True, "WP", _first),
    Cmd.LOITER_UNLIM: (True, "LoitUnlim", lambda p: (0.0, 0.0, _u16(abs(p[2])) * _sign(p[2]), 0.0)),
    Cmd.LOITER_TURNS: (True, "LoitTurns", _turns),
    Cmd.LOITER_TIME: (True, "LoitTime", lambda p: (_u16(p[0]), 0.0, _sign(p[2]), _flag(p[3]))),
    Cmd.RTL: (False, "RTL", _none),
    Cmd.LAND: (True, "Land", lambda p: (_u16(p[0]), 0.0, 0.0, 1.0 if math.isnan(p[3]) else _sign(p[3]))),
    Cmd.TAKEOFF: (True, "Takeoff", _first),
    Cmd.LOITER_TO_ALT: (True, "LoitAltitude", lambda p: (0.0, _u16(abs(p[1])) * _sign(p[1]), 0.0, _flag(p[3]))),
    Cmd.SPLINE_WAYPOINT: (True, "SplineWP", _first),
    Cmd.GUIDED_ENABLE: (True, "GuidedEnable", _first),
    Cmd.DELAY: (False, "Delay", _all),
    Cmd.CONDITION_DELAY: (False, "CondDelay", lambda p: (p[0], 0.0, 0.0, 0.0)),
    Cmd.CONDITION_DISTANCE: (False, "CondDist", lambda p: (p[0], 0.0, 0.0, 0.0)),
    Cmd.CONDITION_YAW: (False, "CondYaw", _all),
    Cmd.DO_JUMP: (False, "Jump", lambda p: (_u16(p[0]), float(int(p[1])), 0.0, 0.0)),
    Cmd.CHANGE_SPEED: (False, "ChangeSpeed", lambda p: (float(int(p[0])), p[1], p[2], 0.0)),
    Cmd.SET_HOME: (True, "SetHome", _first),
    181: (False, "SetRelay", lambda p: (p[0], p[1], 0.0, 0.0)),
    183: (False, "SetServo", lambda p: (p[0], p[1], 0.0, 0.0)),
    189: (True, "LandStart", _none),
    195: (True, "SetROILocation", _first),
    197: (False, "SetROINone", _first),
    201: (True, "SetROI", _first),
    203: (False, "DigiCamCtrl", _all),
    205: (False, "MountControl", lambda p: (p[0], p[1], p[2], 0.0)),
    206: (False, "SetCamTrigDst", lambda p: (p[0], 0.0, p[2], 0.0)),
    207: (False, "FenceEnable", _first),
    Cmd.GRIPPER: (False, "Gripper", lambda p: (p[0], p[1], 0.0, 0.0)),
    2000: (False, "ImageStartCapture", _all),
    2001: (False, "ImageStopCapture", _first),
}
_NAN_ALLOWED_4 = {Cmd.WAYPOINT, Cmd.LOITER_UNLIM, Cmd.LAND, Cmd.TAKEOFF}
_LAST_NAV_COMMAND = 95


def command_name(command: int) -> str:
    """The name used in texts such as "Mission: 3 WP"."""
    rule = _RULES.get(command)
    return rule[1] if rule else "?"


def is_nav(command: int) -> bool:
    """Navigation commands occupy the aircraft; the others ("do" and "condition") run beside them."""
    return command <= _LAST_NAV_COMMAND


def _f32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _place_fault(item: Item) -> Result | None:
    if abs(item.x) > 900_000_000:
        return Result.INVALID_PARAM5_X
    if abs(item.y) > 1_800_000_000:
        return Result.INVALID_PARAM6_Y
    return None


def stored(item: Item) -> Item | Result:
    """The stored form of an uploaded mission item, or why it is refused."""
    rule = _RULES.get(item.command)
    for number, value in enumerate(item.params):
        nan_allowed = number == 3 and item.command in _NAN_ALLOWED_4
        if math.isinf(value) or (math.isnan(value) and not nan_allowed):
            return Result(Result.INVALID_PARAM1 + number)
    if item.command <= 1:
        return Result.INVALID
    if rule is None:
        return Result.UNSUPPORTED
    located, _, keep = rule
    params = keep(item.params)
    if not located:
        return Item(item.command, 0, *params)
    fault = _place_fault(item)
    if fault is not None:
        return fault
    if not abs(item.z) < _MAX_ALT_M:  # NaN too
        return Result.INVALID_PARAM7
    frame = _FRAMES.get(item.frame)
    if frame is None:
        return Result.UNSUPPORTED_FRAME
    centimetres = int(_f32(item.z * 100.0))
    return Item(item.command, frame, *params, item.x, item.y, _f32(centimetres * _f32(0.01)))


def stored_rally(item: Item) -> Item | Result:
    """The stored form of a rally point: place, whole metres, relative or absolute."""
    if item.command != Cmd.RALLY_POINT:
        return Result.UNSUPPORTED
    fault = _place_fault(item)
    if fault is not None:
        return fault
    if not -32768 <= item.z <= 32767:
        return Result.INVALID_PARAM7
    if item.frame not in _FRAMES or item.frame == 2:
        return Result.UNSUPPORTED_FRAME
    return Item(item.command, _FRAMES[item.frame], x=item.x, y=item.y, z=float(int(item.z)), autocontinue=0)


def whole_fence(items: Sequence[Item]) -> bool:
    """Whether these items are a fence: polygons of three corners or more, each whole, and circles with a radius."""
    corners_left, of = 0, (0, 0.0)
    for item in items:
        kind = item.command, item.param1
        if item.command in (5001, 5002):
            if item.param1 < 3 or (corners_left and kind != of):
                return False
            corners_left, of = (corners_left or int(item.param1)) - 1, kind
        elif corners_left or (item.command in (5003, 5004) and not item.param1 > 0):
            return False
    return corners_left == 0


def stored_fence(item: Item) -> Item | Result:
    """The stored form of a fence item: place, and vertex count or radius."""
    if item.frame not in _FRAMES or item.frame == 2:
        return Result.UNSUPPORTED_FRAME
    if item.command not in (5000, 5001, 5002, 5003, 5004):
        return Result.UNSUPPORTED
    if item.command in (5001, 5002) and not item.param1 <= 255:
        return Result.INVALID_PARAM1
    kept = {5000: 0.0, 5001: float(int(item.param1)), 5002: float(int(item.param1))}.get(item.command, item.param1)
    return Item(item.command, 0, kept, x=item.x, y=item.y, autocontinue=0)

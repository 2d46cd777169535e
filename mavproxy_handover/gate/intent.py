# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads what a frame of the commander asks of an aircraft in flight, for frames that the situation judges.

The policy names these frames (`JUDGED_RULES`; messages that are no commands are here). This module only reads frames,
and a frame may contain anything. It looks up no place. `operator/checks/command_check.py` judges.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Hashable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from math import isfinite
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.safety.commands import QUIET_S, Kind
from mavproxy_handover.gate.policy.commands import JUDGED_RULES, MODE_BITS, JudgedRule
from mavproxy_handover.vehicle.profiles import ASSUMED, Modes
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float, field_int

__all__ = [
    "GUIDED_ITEM",
    "INTENT_MESSAGES",
    "NO_PLACE",
    "TARGET_MESSAGES",
    "Aim",
    "Intent",
    "aim_of",
    "intent_of",
    "repeats",
    "wish_of",
]

_COMMAND_LONG: Final = mavlink.MAVLINK_MSG_ID_COMMAND_LONG
_COMMAND_INT: Final = mavlink.MAVLINK_MSG_ID_COMMAND_INT
_SET_MODE: Final = mavlink.MAVLINK_MSG_ID_SET_MODE
_SET_CURRENT: Final = mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT
_ITEM: Final = mavlink.MAVLINK_MSG_ID_MISSION_ITEM
_ITEM_INT: Final = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT
_FOLLOW_TARGET: Final = mavlink.MAVLINK_MSG_ID_FOLLOW_TARGET
_GLOBAL: Final = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
_LOCAL: Final = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED

#: targets that come many times a second: guided targets, and the position of a system that the aircraft follows
TARGET_MESSAGES: Final = frozenset({_GLOBAL, _LOCAL, _FOLLOW_TARGET})
#: MISSION_ITEM.current: a place to fly to, and no item; or only a height, which only planes accept
GUIDED_ITEM: Final = 2
_HEIGHT_ITEM: Final = 3
#: MAV_FRAMEs with positions in degrees
_GLOBAL_FRAMES: Final = frozenset({0, 3, 5, 6, 10, 11})
_ABOVE_HOME: Final = 3
_LOCAL_OFFSET: Final = 7
#: higher than any aircraft flies (m)
_NO_BOUND_M: Final = 1e5
#: bits of type_mask: if one is set, the frame has no place
NO_PLACE: Final = 0b111
#: the parameter that holds the height of a place
_HEIGHT: Final = 7
#: ArduPlane keeps whole metres of a radius; up to 1 m it uses its own (`ModeGuided::set_radius_and_direction`)
_LEAST_RADIUS_M, _MOST_RADIUS_M = 2.0, 65535.0
_INT32: Final = struct.Struct("<i")
#: the parameters of COMMAND_LONG; compared as bytes, because a NaN does not equal itself
_FLOATS: Final = struct.Struct("<7f")
_MODE_MASK: Final = (1 << MODE_BITS) - 1
#: MAV_FRAMEs that differ only in the integer form of their name
_INT_FRAMES: Final = {5: 0, 6: 3, 11: 10}
#: Mission Planner sends MISSION_SET_CURRENT 6 times, 2.0 to 3.2 s apart, whatever the answer is
_CURRENT_QUIET_S: Final = 20.0


@dataclass(frozen=True, slots=True)
class Aim:
    """A place to fly to, as in the frame: MAV_FRAME, and latitude, longitude, altitude (degrees, metres).

    In a local frame the three numbers are metres north, east and down. `radius_m`: radius of the circle that a plane
    is to fly there; 0: its own. `here`: only the height counts, at any place."""

    frame: int
    first: float
    second: float
    third: float
    _: KW_ONLY
    radius_m: float = 0.0
    here: bool = False

    @property
    def on_earth(self) -> bool:
        """Whether the position is in degrees."""
        return self.frame in _GLOBAL_FRAMES

    @property
    def makes_sense(self) -> bool:
        """Whether the numbers are a place. The autopilot flies to no other."""
        if not all(map(isfinite, (self.first, self.second, self.third))):
            return False
        return not self.on_earth or (abs(self.first) <= 90.0 and abs(self.second) <= 180.0)


@dataclass(frozen=True, slots=True)
class Intent:
    """The act that a frame asks for.

    `word`: its name for people. `wish`: tells it from other acts of its kind. `repeats`: the frame itself says that it
    was sent before. `quiet_s`: programs repeat it within a shorter time than this. `item`: the mission item to continue
    with; None: the current one. `speed_mps`: the speed to fly with; `speed_type`: its SPEED_TYPE; `throttle`: the
    throttle for a plane (%)."""

    kind: Kind
    word: str
    wish: Hashable
    repeats: bool = False
    quiet_s: float = QUIET_S
    item: int | None = None
    aim: Aim | None = None
    speed_mps: float | None = None
    speed_type: int = mavlink.SPEED_TYPE_AIRSPEED
    throttle: float = 0.0
    auto_only: bool = False


def _by_command() -> dict[int, tuple[JudgedRule, ...]]:
    found: dict[int, tuple[JudgedRule, ...]] = {}
    for rule in JUDGED_RULES:
        number = getattr(mavlink, f"MAV_CMD_{rule.name}", None)
        if number is not None:
            found[number] = (*found.get(number, ()), rule)
    return found


_RULES: Final[Mapping[int, tuple[JudgedRule, ...]]] = _by_command()


def intent_of(frame: Frame, modes: Modes = ASSUMED.gate) -> Intent | None:
    """What the frame wants of an aircraft with these modes; None: nothing that is judged. The frame is known to the
    dialect."""
    read = _READERS.get(frame.msgid)
    return None if read is None else read(frame, modes)


def _of_command(frame: Frame, modes: Modes) -> Intent | None:
    rules = _RULES.get(field_int(frame, "command"), ())
    rule = next((rule for rule in rules if _is_one(frame, rule, modes)), None)
    if rule is None:
        return None
    item = None if rule.item is None else _whole(field_float(frame, f"param{rule.item}"))
    return Intent(
        rule.kind,
        rule.word if item is None else f"item {item}",
        wish_of(frame),
        repeats=repeats(frame),
        item=item,
        aim=_aim_of_command(frame, rule) if rule.kind is Kind.FLY_TO else None,
        speed_mps=None if rule.speed is None else field_float(frame, f"param{rule.speed}"),
        speed_type=0 if rule.speed is None else _speed_type(field_float(frame, "param1"), modes),
        throttle=0.0 if rule.speed is None else field_float(frame, "param3"),
        auto_only=rule.auto_only,
    )


def _is_one(frame: Frame, rule: JudgedRule, modes: Modes) -> bool:
    """Whether a command that has such a rule is judged by it."""
    if rule.height is not None and not modes.takes_heights:
        return False
    values = rule.values
    if rule.mode:
        mode = modes.auto if rule.mode == "auto" else modes.follow
        if mode is None:
            return False
        values = (mode,)
    if rule.which is not None and not _holds(field_float(frame, f"param{rule.which}"), values):
        return False
    return rule.also is None or _holds(field_float(frame, f"param{rule.also[0]}"), rule.also[1:])


def _speed_type(asked: float, modes: Modes) -> int:
    """The kind of speed, as the autopilot reads it. A NaN is the first kind."""
    if not isfinite(asked):
        return 0
    if modes.speed_type_bits:
        return int(asked) & 0xFF
    return 3 if asked > 2.9 else int(asked + 0.1)  # as ArduCopter up to 4.6 compares it


def _aim_of_command(frame: Frame, rule: JudgedRule) -> Aim:
    if rule.height not in (None, _HEIGHT):
        height_m, above = (field_float(frame, f"param{n}") for n in (rule.height, rule.height + 1))
        return Aim(_whole(above), 0.0, 0.0, height_m, here=True)
    if frame.msgid == _COMMAND_INT:
        place = _signed(frame, "x") / 1e7, _signed(frame, "y") / 1e7, field_float(frame, "z")
        aim = Aim(field_int(frame, "frame"), *place)
    else:
        aim = Aim(_ABOVE_HOME, *(field_float(frame, f"param{n}") for n in (5, 6, 7)))
    if rule.height is not None:
        return Aim(aim.frame, 0.0, 0.0, aim.third, here=True)
    return aim if rule.radius is None else replace(aim, radius_m=_radius_m(field_float(frame, f"param{rule.radius}")))


def _radius_m(asked: float) -> float:
    """Radius of the circle that ArduPlane flies for this; 0: its own."""
    return float(int(min(asked, _MOST_RADIUS_M))) if asked >= _LEAST_RADIUS_M else 0.0


def _of_mode(frame: Frame, modes: Modes) -> Intent | None:
    mode = field_int(frame, "custom_mode") & _MODE_MASK
    if mode == modes.auto:
        return Intent(Kind.GO_ON, "AUTO", wish_of(frame))
    return Intent(Kind.UNKNOWN, "FOLLOW", wish_of(frame)) if mode == modes.follow else None


def _of_current(frame: Frame, _modes: Modes) -> Intent | None:
    item = field_int(frame, "seq")
    return Intent(Kind.GO_ON, f"item {item}", wish_of(frame), quiet_s=_CURRENT_QUIET_S, item=item)


def _of_item(frame: Frame, modes: Modes) -> Intent | None:
    current = field_int(frame, "current")
    if current != GUIDED_ITEM and not (current == _HEIGHT_ITEM and modes.takes_heights):
        return None
    aim = _aim_of_item(frame)
    if current == GUIDED_ITEM:
        return Intent(Kind.FLY_TO, "target", wish_of(frame), aim=aim)
    return Intent(Kind.FLY_TO, "altitude", wish_of(frame), aim=Aim(aim.frame, 0.0, 0.0, aim.third, here=True))


def _aim_of_item(frame: Frame) -> Aim:
    number = field_int(frame, "frame")
    if frame.msgid == _ITEM_INT:
        return Aim(number, _signed(frame, "x") / 1e7, _signed(frame, "y") / 1e7, field_float(frame, "z"))
    return Aim(number, *(field_float(frame, name) for name in ("x", "y", "z")))


def aim_of(frame: Frame, modes: Modes = ASSUMED.gate) -> Aim | None:
    """The place in a frame of TARGET_MESSAGES, of wings a height without one too; None where it holds none.

    A plane takes the height of SET_POSITION_TARGET_GLOBAL_INT. ArduPlane 4.7 ignores the height if the mask says so; up
    to 4.6 it looks at other bits of the mask. So the height counts, whatever the mask says.
    Of SET_POSITION_TARGET_LOCAL_NED a plane takes only the height, whatever the mask says, and adds it to its target
    height. If the stream goes on, the height has no bound, so it is judged as `_NO_BOUND_M`."""
    if frame.msgid == _FOLLOW_TARGET:
        return Aim(0, _signed(frame, "lat") / 1e7, _signed(frame, "lon") / 1e7, field_float(frame, "alt"))
    if modes.takes_heights and frame.msgid == _LOCAL:
        adds = field_int(frame, "coordinate_frame") == _LOCAL_OFFSET and field_float(frame, "z") != 0.0
        return Aim(_ABOVE_HOME, 0.0, 0.0, _NO_BOUND_M, here=True) if adds else None
    mask, number = field_int(frame, "type_mask"), field_int(frame, "coordinate_frame")
    if mask & NO_PLACE:
        height = modes.takes_heights and frame.msgid == _GLOBAL
        return Aim(number, 0.0, 0.0, field_float(frame, "alt"), here=True) if height else None
    if frame.msgid == _GLOBAL:
        place = _signed(frame, "lat_int") / 1e7, _signed(frame, "lon_int") / 1e7
        return Aim(number, *place, field_float(frame, "alt"))
    return Aim(number, *(field_float(frame, name) for name in ("x", "y", "z")))


_READERS: Final[Mapping[int, Callable[[Frame, Modes], Intent | None]]] = {
    _COMMAND_LONG: _of_command,
    _COMMAND_INT: _of_command,
    _SET_MODE: _of_mode,
    _SET_CURRENT: _of_current,
    _ITEM: _of_item,
    _ITEM_INT: _of_item,
}
#: messages that may hold an intent
INTENT_MESSAGES: Final = frozenset(_READERS)


def wish_of(frame: Frame) -> Hashable:
    """A key that tells an act from others: its sender, and what it does.

    Two forms of one act have the same key: COMMAND_LONG and COMMAND_INT, SET_MODE and DO_SET_MODE, MISSION_SET_CURRENT
    and DO_SET_MISSION_CURRENT. Mission Planner sends both forms of a mode, one after the other."""
    return frame.sysid, frame.compid, *_act(frame)


def _act(frame: Frame) -> tuple[Hashable, ...]:
    match frame.msgid:
        case mavlink.MAVLINK_MSG_ID_COMMAND_LONG | mavlink.MAVLINK_MSG_ID_COMMAND_INT:
            return _act_of_command(frame)
        case mavlink.MAVLINK_MSG_ID_SET_MODE:
            return "mode", field_int(frame, "custom_mode") & _MODE_MASK, _by_number(field_int(frame, "base_mode"))
        case mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT:
            return "item", field_int(frame, "seq"), False
        case mavlink.MAVLINK_MSG_ID_MISSION_ITEM | mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT:
            aim = _aim_of_item(frame)
            place = _as_bytes(aim.first, aim.second, aim.third)
            return "target", field_int(frame, "current"), _plain_frame(aim.frame), place
        case _:
            return frame.msgid, frame.payload


def _act_of_command(frame: Frame) -> tuple[Hashable, ...]:
    command = field_int(frame, "command")
    one, two, three, four = (field_float(frame, f"param{n}") for n in (1, 2, 3, 4))
    if command == mavlink.MAV_CMD_DO_SET_MODE and isfinite(one) and isfinite(two):
        return "mode", int(two) & _MODE_MASK, _by_number(int(one))
    if command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT and isfinite(one):
        return "item", int(one), two == 1.0
    placed = any(rule.kind is Kind.FLY_TO for rule in _RULES.get(command, ()))
    if frame.msgid == _COMMAND_LONG:
        number, place = _ABOVE_HOME, [field_float(frame, f"param{n}") for n in (5, 6, 7)]
    else:
        scale = 1e7 if placed else 1.0
        number, place = field_int(frame, "frame"), [_signed(frame, "x") / scale, _signed(frame, "y") / scale]
        place.append(field_float(frame, "z"))
    return command, _plain_frame(number) if placed else None, _as_bytes(one, two, three, four, *place)


def _by_number(base_mode: int) -> bool:
    """Whether the mode is chosen by its custom number."""
    return bool(base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)


def _plain_frame(number: int) -> int:
    return _INT_FRAMES.get(number, number)


def _as_bytes(*numbers: float) -> bytes:
    return _FLOATS.pack(*numbers, *(0.0,) * (7 - len(numbers)))


def repeats(frame: Frame) -> bool:
    """Whether the frame itself says that it was sent before."""
    return frame.msgid == _COMMAND_LONG and field_int(frame, "confirmation") > 0


def _holds(value: float, values: tuple[int, ...]) -> bool:
    """Whether the autopilot reads one of these values. A NaN may be any of them."""
    return not isfinite(value) or int(value) & 0xFF in values


def _whole(value: float) -> int:
    return int(value) if isfinite(value) else -1


def _signed(frame: Frame, field: str) -> int:
    (value,) = _INT32.unpack(field_bytes(frame, field))
    return int(value)

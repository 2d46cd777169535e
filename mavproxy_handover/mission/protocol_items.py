# SPDX-License-Identifier: GPL-3.0-or-later

"""Converts items of a mission, fence or rally list between `MissionItem` and messages, and checks single items.

MISSION_ITEM_INT has positions in 1e-7 degrees. The older MISSION_ITEM has 32-bit degrees, up to a metre less exact.
Both have the numbers of a numbered command (`items.Command`) as they are. A parameter that is NaN is left open;
ArduCopter takes it for 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import COMMANDS, MissionItem

__all__ = ["Flaw", "filled", "flaw", "item_of", "item_message", "older_item_message"]

#: frames that differ only in the integer form of their name
_INT_FRAMES: Final = {5: 0, 6: 3, 11: 10}
#: frames with a position, as ArduCopter stores them; in other frames x and y are no degrees
_PLACED: Final = (0, 3, 10)
#: the results for parameters 1 to 4
_INVALID: Final = (
    mavlink.MAV_MISSION_INVALID_PARAM1,
    mavlink.MAV_MISSION_INVALID_PARAM2,
    mavlink.MAV_MISSION_INVALID_PARAM3,
    mavlink.MAV_MISSION_INVALID_PARAM4,
)
_LIMITS: Final = (
    ("latitude", 90.0, mavlink.MAV_MISSION_INVALID_PARAM5_X),
    ("longitude", 180.0, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
    ("altitude", 1e5, mavlink.MAV_MISSION_INVALID_PARAM7),
)


@dataclass(frozen=True, slots=True)
class Flaw:
    """Why an item or a list is not accepted: a MAV_MISSION_RESULT, and a text."""

    result: int
    words: str


def item_of(message: Any) -> MissionItem:
    """The item in MISSION_ITEM_INT or MISSION_ITEM. Its numbers are not checked (see `flaw`)."""
    whole = message.get_type() == "MISSION_ITEM_INT"
    frame = _INT_FRAMES.get(message.frame, message.frame)
    params = message.param1, message.param2, message.param3, message.param4
    scale = 1e7 if whole or _numbered(message.command) else 1.0
    lat_deg, lon_deg = message.x / scale, message.y / scale
    goes_on = bool(message.autocontinue)
    return MissionItem(message.seq, message.command, frame, *params, lat_deg, lon_deg, message.z, goes_on)


def _numbered(command: int) -> bool:
    return command in COMMANDS and COMMANDS[command].numbered


def filled(item: MissionItem) -> MissionItem:
    """The item with 0 for each parameter that is left open."""
    one, two, three, four = (0.0 if math.isnan(p) else p for p in item.params)
    return replace(item, param1=one, param2=two, param3=three, param4=four)


def flaw(item: MissionItem) -> Flaw | None:
    """What is wrong with an item of any list: infinite numbers, impossible positions. None: nothing."""
    for number, (value, result) in enumerate(zip(item.params, _INVALID, strict=True), 1):
        if not math.isfinite(value):
            return Flaw(result, f"item {item.seq}: parameter {number} is no number")
    for value, (name, most, result) in zip((item.lat_deg, item.lon_deg, item.alt_m), _LIMITS, strict=True):
        if item.frame in _PLACED and not abs(value) <= most:
            return Flaw(result, f"item {item.seq}: {name} out of range")
    return None


def item_message(item: MissionItem, target: tuple[int, int], kind: int, current: bool = False) -> Any:
    """The item as MISSION_ITEM_INT of a list of this MAV_MISSION_TYPE."""
    place = round(item.lat_deg * 1e7), round(item.lon_deg * 1e7), item.alt_m
    return mavlink.MAVLink_mission_item_int_message(*_head(item, target, current), *place, kind)


def older_item_message(item: MissionItem, target: tuple[int, int], kind: int, current: bool = False) -> Any:
    """The item as MISSION_ITEM, for programs that ask by MISSION_REQUEST."""
    scale = 1e7 if _numbered(item.command) else 1.0
    place = item.lat_deg * scale, item.lon_deg * scale, item.alt_m
    return mavlink.MAVLink_mission_item_message(*_head(item, target, current), *place, kind)


def _head(item: MissionItem, target: tuple[int, int], current: bool) -> tuple[Any, ...]:
    return (*target, item.seq, item.frame, item.command, int(current), int(item.auto_continue), *item.params)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers for the autopilot of a replay where a recording cannot: lists, parameters, commands.

The companion of the flight asked at its own times and got answers; the companion of the replay asks at others. So those
answers are left out of the recording (`ANSWERS`), and this module answers. It uses the plan of the mission that is
replayed, and the rally list as it was written last. Parameters, fence and home are those of the recording. A command is
accepted without effect: the recording contains what the aircraft does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.protocol_items import item_message
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID

__all__ = ["ANSWERS", "StandIn"]

#: answers to what was asked then
ANSWERS: Final = frozenset(
    {
        *("MISSION_COUNT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_ACK"),
        "COMMAND_ACK",
    }
)
_MISSION, _FENCE, _RALLY = range(3)


class StandIn:
    """The lists and parameters of one autopilot. `messages`: its own, of the whole recording."""

    def __init__(self, package: MissionPackage, sysid: int, messages: Sequence[tuple[float, Any]]) -> None:
        self._sysid = sysid
        self._encoder = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=AUTOPILOT_COMPID)
        self._decoder = mavlink.MAVLink(None)
        self._asker = sysid, COMPANION_COMPID
        home = package.route.home
        self._home = round(home.lat_deg * 1e7), round(home.lon_deg * 1e7)
        self._parameters: dict[str, Any] = {}
        fence: dict[int, Any] = {}
        for _at, message in messages:
            kind = message.get_type()
            if kind == "PARAM_VALUE":
                self._parameters.setdefault(message.param_id, message)
            elif kind == "MISSION_ITEM_INT" and message.mission_type == _FENCE:
                fence[message.seq] = message
        plan = [item_message(item, self._asker, _MISSION) for item in package.route.upload_items()]
        self._lists: dict[int, list[Any]] = {
            _MISSION: plan,
            _FENCE: [fence[seq] for seq in sorted(fence)],
            _RALLY: [self._point(*self._home)],
        }
        self._upload: tuple[int, int, list[Any]] | None = None

    def sees(self, message: Any) -> None:
        """A message of the recording: home may be elsewhere by it."""
        if message.get_type() == "HOME_POSITION":
            self._home = message.latitude, message.longitude

    def answers(self, frame: bytes) -> list[Any]:
        """The answers to a frame of the companion."""
        message = self._decoder.decode(bytearray(frame))
        match message.get_type():
            case "MISSION_REQUEST_LIST":
                kind = message.mission_type
                said = [mavlink.MAVLink_mission_count_message(*self._asker, len(self._lists.get(kind, ())), kind)]
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                said = self._item(message.mission_type, message.seq)
            case "MISSION_COUNT":
                self._upload = message.mission_type, message.count, []
                said = self._next()
            case "MISSION_ITEM_INT":
                said = self._taken(message)
            case "PARAM_REQUEST_READ":
                found = self._parameters.get(message.param_id)
                return [] if found is None else [found]
            case "COMMAND_LONG" | "COMMAND_INT":
                said = [mavlink.MAVLink_command_ack_message(message.command, 0, 0, 0, *self._asker)]
            case _:
                return []
        return [self._decoder.decode(bytearray(each.pack(self._encoder))) for each in said]

    def _item(self, kind: int, seq: int) -> list[Any]:
        items = self._lists.get(kind, [])
        if seq >= len(items):
            return [mavlink.MAVLink_mission_ack_message(*self._asker, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)]
        item = items[seq]
        if kind == _MISSION and seq == 0:
            item = self._point(*self._home)
            item.mission_type, item.command = _MISSION, mavlink.MAV_CMD_NAV_WAYPOINT
        return [item]

    def _next(self) -> list[Any]:
        assert self._upload is not None
        kind, count, items = self._upload
        if len(items) < count:
            return [mavlink.MAVLink_mission_request_int_message(*self._asker, len(items), kind)]
        self._lists[kind], self._upload = items, None
        return [mavlink.MAVLink_mission_ack_message(*self._asker, mavlink.MAV_MISSION_ACCEPTED, kind)]

    def _taken(self, item: Any) -> list[Any]:
        if self._upload is None or (item.mission_type, item.seq) != (self._upload[0], len(self._upload[2])):
            return []
        item.target_system, item.target_component = self._asker
        self._upload[2].append(item)
        return self._next()

    def _point(self, lat: int, lon: int) -> Any:
        frame, command = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_RALLY_POINT
        nothing = 0.0, 0.0, 0.0, 0.0
        return mavlink.MAVLink_mission_item_int_message(
            *self._asker, 0, frame, command, 0, 1, *nothing, lat, lon, 0.0, _RALLY
        )

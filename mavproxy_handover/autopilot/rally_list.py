# SPDX-License-Identifier: GPL-3.0-or-later

"""The rally list that stations see: the points where a return may go, served by the companion itself.

The autopilot's own list holds one point, the place that is chosen of these (`rally.py`), and no station reads or writes
it. What a station's program takes for the autopilot's list is this one: the mission protocol for rally points, both
ways, answered in the autopilot's name. The gate lets everybody read, and the commander write.

An upload counts when it is whole and every point makes sense: then it replaces all of the list, until the flight is
over. One that breaks off leaves the list as it was. One at a time, asked for again each second, given up after 8 s, and
at once when its station commands no more.

Sources: mavlink.io, "Mission Protocol"; what ArduPilot's MissionItemProtocol answers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.mission_protocol import rally_items
from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.mission.items import MissionItem, RallyPoint
from mavproxy_handover.mission.plan import HIGHEST_M, LOWEST_M
from mavproxy_handover.stations.port import StationPort

__all__ = ["MOST_POINTS", "RallyList"]

#: as many as ArduCopter's own list holds in simulation
MOST_POINTS: Final = 46
_RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
_POINT: Final = mavlink.MAV_CMD_NAV_RALLY_POINT
_ABOVE_HOME: Final = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_ASK_S, _GIVE_UP_S = 1.0, 8.0
_ACCEPTED: Final = mavlink.MAV_MISSION_ACCEPTED

_Sender = tuple[int, int]


@dataclass(slots=True)
class _Upload:
    """One that is open: whose it is, the points as they come, which of them is next and which the last."""

    port: StationPort
    sender: _Sender
    points: list[RallyPoint]
    next: int
    last: int
    heard_at: float
    asked_at: float = field(default=0.0)


class RallyList:
    """The list, and the uploads and downloads of it. Times are monotonic seconds.

    `points` says what is in it, `replaced` is told what the commander has put there instead.
    """

    def __init__(
        self,
        ties: Ties,
        points: Callable[[], Sequence[RallyPoint]],
        replaced: Callable[[tuple[RallyPoint, ...], str, float], None],
    ) -> None:
        self._ties = ties
        self._points = points
        self._replaced = replaced
        self._upload: _Upload | None = None

    def take(self, port: StationPort, message: Any, now: float) -> None:
        """A message of the mission protocol about rally points; the gate has seen whether the station may send it."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.mission_type != _RALLY:  # to clear all lists at once, as ArduPilot has it
            self._ack(port, sender, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)
            return
        match message.get_type():
            case "MISSION_REQUEST_LIST":
                self._send(port, mavlink.MAVLink_mission_count_message(*sender, len(self._points()), _RALLY))
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                self._give(port, sender, message)
            case "MISSION_COUNT":
                self._begin(port, sender, message.count, now)
            case "MISSION_WRITE_PARTIAL_LIST":
                self._change(port, sender, message.start_index, message.end_index, now)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                self._item(port, sender, message, now)
            case "MISSION_CLEAR_ALL":
                self._begin(port, sender, 0, now)
            case _:  # the end of a download
                pass

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        upload = self._upload
        if upload is None:
            return
        if not self._ties.commands(upload.port.sysid):
            self._upload = None
        elif now - upload.heard_at >= _GIVE_UP_S:
            self._upload = None
            self._ack(upload.port, upload.sender, mavlink.MAV_MISSION_OPERATION_CANCELLED)
        elif now - upload.asked_at >= _ASK_S:
            self._ask(upload, now)

    # ---- up -------------------------------------------------------------------------------------------------------

    def _begin(self, port: StationPort, sender: _Sender, count: int, now: float) -> None:
        """A new list of so many points."""
        if not self._free(port, sender):
            return
        if count > MOST_POINTS:
            self._ack(port, sender, mavlink.MAV_MISSION_NO_SPACE)
        elif count == 0:
            self._conclude(_Upload(port, sender, [], 0, 0, now), now)
        else:
            self._open(_Upload(port, sender, [], 0, count - 1, now), now)

    def _change(self, port: StationPort, sender: _Sender, first: int, last: int, now: float) -> None:
        """Points of the list from the first to the last of these; the one behind its end may be one of them."""
        if not self._free(port, sender):
            return
        points = list(self._points())
        if 0 <= first <= last <= min(len(points), MOST_POINTS - 1):
            self._open(_Upload(port, sender, points, first, last, now), now)
        else:
            self._ack(port, sender, mavlink.MAV_MISSION_ERROR)

    def _free(self, port: StationPort, sender: _Sender) -> bool:
        """No upload of somebody else is open; one of the same sender is given up."""
        upload = self._upload
        if upload is not None and upload.sender != sender and self._ties.commands(upload.port.sysid):
            self._ack(port, sender, mavlink.MAV_MISSION_DENIED)
            return False
        self._upload = None
        return True

    def _open(self, upload: _Upload, now: float) -> None:
        self._upload = upload
        self._ask(upload, now)

    def _item(self, port: StationPort, sender: _Sender, message: Any, now: float) -> None:
        upload = self._upload
        if upload is None:
            self._ack(port, sender, mavlink.MAV_MISSION_ERROR)
            return
        if upload.sender != sender:
            self._ack(port, sender, mavlink.MAV_MISSION_DENIED)
            return
        if message.seq != upload.next:
            self._ack(port, sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        point = _point(message)
        if isinstance(point, int):
            self._upload = None
            self._ack(port, sender, point)
            return
        upload.points[upload.next : upload.next + 1] = [point]
        upload.next, upload.heard_at = upload.next + 1, now
        if upload.next <= upload.last:
            self._ask(upload, now)
        else:
            self._conclude(upload, now)

    def _ask(self, upload: _Upload, now: float) -> None:
        upload.asked_at = now
        self._send(upload.port, mavlink.MAVLink_mission_request_message(*upload.sender, upload.next, _RALLY))

    def _conclude(self, upload: _Upload, now: float) -> None:
        self._upload = None
        self._replaced(tuple(upload.points), upload.port.name, now)
        self._ack(upload.port, upload.sender, _ACCEPTED)

    # ---- down -----------------------------------------------------------------------------------------------------

    def _give(self, port: StationPort, sender: _Sender, message: Any) -> None:
        items = rally_items(self._points())
        if message.seq >= len(items):
            self._ack(port, sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = items[message.seq]
        older = message.get_type() == "MISSION_REQUEST"
        self._send(port, (_older_item if older else _item)(sender, item))

    def _ack(self, port: StationPort, sender: _Sender, result: int, kind: int = _RALLY) -> None:
        self._send(port, mavlink.MAVLink_mission_ack_message(*sender, result, kind))

    def _send(self, port: StationPort, message: Any) -> None:
        self._ties.voice.as_autopilot(port, message)


def _item(sender: _Sender, item: MissionItem) -> Any:
    head = (*sender, item.seq, item.frame, item.command, 0, 1, *item.params)
    place = round(item.lat_deg * 1e7), round(item.lon_deg * 1e7), item.alt_m
    return mavlink.MAVLink_mission_item_int_message(*head, *place, _RALLY)


def _older_item(sender: _Sender, item: MissionItem) -> Any:
    head = (*sender, item.seq, item.frame, item.command, 0, 1, *item.params)
    return mavlink.MAVLink_mission_item_message(*head, item.lat_deg, item.lon_deg, item.alt_m, _RALLY)


def _point(message: Any) -> RallyPoint | int:
    """The point of an item, or the MAV_MISSION_RESULT that says why it is none.

    Heights count from home, as everywhere here; a program that gives them above the sea is told so.
    """
    scale = 1e-7 if message.get_type() == "MISSION_ITEM_INT" else 1.0
    lat_deg, lon_deg, alt_m = message.x * scale, message.y * scale, message.z
    if message.command != _POINT:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if message.frame not in _ABOVE_HOME:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if not -90.0 <= lat_deg <= 90.0:
        return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    if not -180.0 <= lon_deg <= 180.0 or (lat_deg == 0.0 and lon_deg == 0.0):
        return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
    if not isfinite(alt_m) or not LOWEST_M <= alt_m <= HIGHEST_M:
        return int(mavlink.MAV_MISSION_INVALID_PARAM7)
    return RallyPoint(lat_deg, lon_deg, float(int(alt_m)))

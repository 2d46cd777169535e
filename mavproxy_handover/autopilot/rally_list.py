# SPDX-License-Identifier: GPL-3.0-or-later

"""The rally list that stations see: the points where a return may go, served by the companion itself.

The autopilot's own list holds one point, the place that is chosen of these (`rally.py`), and no station reads or writes
it. What a station's program takes for the autopilot's list is this one: the mission protocol for rally points, and the
file `@MISSION/rally.dat`, both ways, answered in the autopilot's name. The gate lets everybody read, and the commander
write.

An upload counts when it is whole and every point makes sense: then it replaces all of the list, until the flight is
over. One that breaks off leaves the list as it was, and so does one whose station commands no more. How it goes is for
`gate/mission_server.py`, as for every list that is uploaded here, and `gate/list_file.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.mission_protocol import rally_items
from mavproxy_handover.autopilot.reports import Reports
from mavproxy_handover.gate.list_file import ListFile
from mavproxy_handover.gate.mission_items import Flaw, flaw
from mavproxy_handover.gate.mission_server import MissionServer, Turn
from mavproxy_handover.mission.items import FRAME_ABOVE_HOME, MissionItem, RallyPoint
from mavproxy_handover.mission.plan import HIGHEST_M, LOWEST_M
from mavproxy_handover.stations.port import StationPort

__all__ = ["MOST_POINTS", "RallyList"]

#: as many as ArduCopter's own list holds in simulation
MOST_POINTS: Final = 46
_RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
_WORDS: Final = "rally points"


class RallyList:
    """The list, and the uploads and downloads of it. Times are monotonic seconds.

    `commands`: whether a station commands. `points` says what is in it, `replaced` is told what the commander has put
    there instead.
    """

    def __init__(
        self,
        commands: Callable[[int], bool],
        reports: Reports,
        points: Callable[[], Sequence[RallyPoint]],
        replaced: Callable[[tuple[RallyPoint, ...], str, float], None],
    ) -> None:
        self._commands = commands
        self._reports = reports
        self._points = points
        self._replaced = replaced
        self._server = MissionServer(_RALLY, MOST_POINTS, _flaw)
        #: the same as a file
        self.file = ListFile(_RALLY, MOST_POINTS, lambda: rally_items(points()), _flaw)
        #: of the upload that is open
        self._port: StationPort | None = None

    def take(self, port: StationPort, message: Any, now: float) -> None:
        """A message about rally points, of the mission protocol or of file transfer; the gate has seen whether the
        station may send it."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "FILE_TRANSFER_PROTOCOL":
            self._take_file(port, message, sender, now)
            return
        if message.mission_type != _RALLY:  # to clear all lists at once, as ArduPilot has it
            refusal = mavlink.MAVLink_mission_ack_message(
                *sender, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type
            )
            self._reports.answer(port, _WORDS, Turn((refusal,)), now)
            return
        if not self._server.knows(message):
            return
        self._give_up(now)
        self._server.offered = rally_items(self._points())
        turn = self._server.take(message, sender, now)
        if self._server.sender == sender:
            self._port = port
        self._reports.answer(port, _WORDS, turn, now)
        if turn.whole is not None:
            self._replaced(tuple(map(_point, turn.whole.items)), port.name, now)
            self._reports.answer(port, _WORDS, self._server.conclude(mavlink.MAV_MISSION_ACCEPTED, now), now)

    def _take_file(self, port: StationPort, message: Any, sender: tuple[int, int], now: float) -> None:
        self._give_up(now)
        turn = self.file.take(port.sysid, message, sender)
        if turn.whole is not None:
            self._replaced(tuple(map(_point, turn.whole.items)), port.name, now)
            turn = self.file.conclude(port.sysid)
        self._reports.answer(port, _WORDS, turn, now)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._give_up(now)
        if self._port is not None:
            self._reports.answer(self._port, _WORDS, self._server.tick(now), now)

    def _give_up(self, now: float) -> None:
        """The uploads of stations that command no more."""
        for station in self.file.writers:
            if not self._commands(station):
                self.file.forget(station)
        if self._server.sender is None:
            self._port = None
        if self._port is not None and not self._commands(self._port.sysid):
            self._reports.answer(
                self._port, _WORDS, self._server.give_up("its sender no longer has authority", now), now
            )
            self._port = None


def _flaw(item: MissionItem) -> Flaw | None:
    """Why an item is no point. Heights count from home, as everywhere here; a program that gives them above the sea is
    told so."""
    if item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
        return Flaw(mavlink.MAV_MISSION_UNSUPPORTED, f"item {item.seq}: no rally point")
    if item.frame != FRAME_ABOVE_HOME:
        return Flaw(mavlink.MAV_MISSION_UNSUPPORTED_FRAME, f"item {item.seq}: the height does not count from home")
    if item.lat_deg == 0.0 and item.lon_deg == 0.0:
        return Flaw(mavlink.MAV_MISSION_INVALID_PARAM6_Y, f"item {item.seq}: no place")
    wrong = flaw(item)
    if wrong is None and not LOWEST_M <= item.alt_m <= HIGHEST_M:
        return Flaw(mavlink.MAV_MISSION_INVALID_PARAM7, f"item {item.seq}: altitude out of range")
    return wrong


def _point(item: MissionItem) -> RallyPoint:
    return RallyPoint(item.lat_deg, item.lon_deg, float(int(item.alt_m)))

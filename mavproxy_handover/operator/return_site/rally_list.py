# SPDX-License-Identifier: GPL-3.0-or-later

"""The rally list that stations see: the candidates for the return site, served by the companion.

The autopilot's own list holds only the chosen return site (`rally_writer.py`), and no station reads or writes it. The
companion serves this list in the autopilot's name, by the mission protocol for rally points. The gate lets all stations
read, and only the commander write. The file `@MISSION/rally.dat` does not exist for stations.

An upload counts if it is complete and every point is valid. It replaces the whole list until the flight is over. An
upload that ends early, or whose station no longer has authority, changes nothing. The protocol is in
`gate/mission_server.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.mission_server import MissionServer, Turn
from mavproxy_handover.mission.items import FRAME_ABOVE_HOME, MissionItem, RallyPoint
from mavproxy_handover.mission.plan import HIGHEST_M, LOWEST_M
from mavproxy_handover.mission.protocol_items import Flaw, flaw
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.vehicle.mission_protocol import rally_items

__all__ = ["MOST_POINTS", "RallyList"]

#: as many as ArduCopter's own list holds in simulation
MOST_POINTS: Final = 46
_RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
_WORDS: Final = "rally points"


class RallyList:
    """The list, its uploads and its downloads. Times are monotonic seconds.

    `commands`: whether a station commands. `points` returns the points of the list. `replaced` is called with the
    points that the commander has uploaded.
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
        #: the sender of the open upload
        self._port: StationPort | None = None

    def on_message(self, port: StationPort, message: Any, now: float) -> None:
        """A message of the mission protocol about rally points. The gate has checked that the station may send it."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.mission_type != _RALLY:  # clearing all lists at once is refused, as by ArduPilot
            refusal = mavlink.MAVLink_mission_ack_message(
                *sender, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type
            )
            self._reports.answer(port, _WORDS, Turn((refusal,)), now)
            return
        if not self._server.knows(message):
            return
        self._give_up(now)
        self._server.offered = rally_items(self._points())
        turn = self._server.handle(message, sender, now)
        if self._server.sender == sender:
            self._port = port
        self._reports.answer(port, _WORDS, turn, now)
        if turn.whole is not None:
            self._replaced(tuple(map(_point, turn.whole.items)), port.name, now)
            self._reports.answer(port, _WORDS, self._server.conclude(mavlink.MAV_MISSION_ACCEPTED, now), now)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._give_up(now)
        if self._port is not None:
            self._reports.answer(self._port, _WORDS, self._server.tick(now), now)

    def _give_up(self, now: float) -> None:
        """End the upload of a station that no longer commands."""
        if self._server.sender is None:
            self._port = None
        if self._port is not None and not self._commands(self._port.sysid):
            self._reports.answer(
                self._port, _WORDS, self._server.give_up("its sender no longer has authority", now), now
            )
            self._port = None


def _flaw(item: MissionItem) -> Flaw | None:
    """Why an item is not a valid rally point; None: it is valid. Heights must count from home, not from the sea."""
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

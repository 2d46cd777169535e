# SPDX-License-Identifier: GPL-3.0-or-later

"""Missions and geofences that the commander uploads in flight: they end here, and go on as a whole or not at all.

Sent straight to the autopilot, an upload would cut the list that is being flown with its first message, and leave a
mixture behind where the link breaks; what it holds would be known to nobody. So (the protocol is
`gate/mission_server.py`):

* A mission is gathered, read as a mission package's would be, judged by energy, fence and coverage from where the
  aircraft is, written by the companion, and read back. Then its sender hears ACCEPTED, and from then on the rest of
  the companion goes by it: route check, speeds, zones on the way, and who is to command along it.
* It has to consist of what a package may hold (`mission/items.py`): what jumps, moves home or switches the fence off
  cannot be judged. It need not begin with a take-off. A plane's has to leave a return that ends on the ground: where
  that goes on to the landing sequence, one without would have it circle for ever.
* Heights above the sea need the plan's and the autopilot's home at the same height, heights above terrain an autopilot
  that knows the ground; a way into the ground, by the heights that the package has of it, is refused
  (`mission/heights.py`).
* To clear the mission is refused: there is nothing to fly by then, and RTL needs no empty mission.
* A geofence is not changed in flight. It is a limit that the autopilot keeps by itself, the places of a return were
  checked against it, and one that leaves the aircraft outside lands it at once (4.7) or turns it back. The one that is
  held is taken again: ground station programs send a plan whole.
* The package's digest stays. It is what stations have to agree on to take the aircraft, zones and stations, and these
  have not changed; with another one nobody could. Stations are told that the route has. On the ground again the
  mission counts as unknown, and the next START needs a package.

What takes time is done beside the main loop. Times are monotonic seconds.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.command_check import CommandCheck
from mavproxy_handover.autopilot.context import Context
from mavproxy_handover.autopilot.flown_mission import FlownMission
from mavproxy_handover.autopilot.mission_protocol import same_fence
from mavproxy_handover.autopilot.prepared import Rerouted
from mavproxy_handover.gate.mission_items import Flaw, flaw
from mavproxy_handover.gate.mission_server import MissionServer, Turn, Upload
from mavproxy_handover.mission.ahead import Ahead
from mavproxy_handover.mission.crossings import WayAhead
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.heights import into_ground
from mavproxy_handover.mission.items import COMMANDS, JUMP, MissionItem
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import MAX_CORNERS, MAX_ITEMS, Route, with_items
from mavproxy_handover.mission.returns import with_return
from mavproxy_handover.mission.route_simulation import walk_legs
from mavproxy_handover.monitors.preflight.own_failsafes import plan_facts
from mavproxy_handover.monitors.preflight.plan_fit import not_as_checked
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.conversation import Conversation
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.worker import Worker

__all__ = ["FlightUploads"]

_MISSION: Final[int] = mavlink.MAV_MISSION_TYPE_MISSION
_FENCE: Final[int] = mavlink.MAV_MISSION_TYPE_FENCE
_WORDS: Final = {_MISSION: "mission", _FENCE: "geofence"}
_DENIED: Final[int] = mavlink.MAV_MISSION_DENIED
#: more areas of a geofence than ArduPilot stores
_MOST_AREAS: Final = 32
#: names of the conversations
_WRITE: Final = "upload"
_READ: Final = "mission found in flight"


def _mission_flaw(item: MissionItem) -> Flaw | None:
    """What is wrong with an item of a mission by itself. Item 0 is home, which the autopilot sets itself."""
    if item.seq and (item.command not in COMMANDS or item.command == JUMP):
        words = f"item {item.seq}: command {item.command} is not one that can be judged"
        return Flaw(mavlink.MAV_MISSION_UNSUPPORTED, words)
    return flaw(item)


class FlightUploads:
    """The uploads of one vehicle's commander in flight."""

    def __init__(self, context: Context, command_check: CommandCheck, flown: FlownMission) -> None:
        self._command_check = command_check
        self._state = context.state
        self._procedures = context.procedures
        self._conversations = context.conversations
        self._authority = context.authority
        self._reports = context.reports
        self._flown = flown
        self._worker = Worker()
        self._servers = {
            _MISSION: MissionServer(_MISSION, MAX_ITEMS + 1, _mission_flaw),
            _FENCE: MissionServer(_FENCE, _MOST_AREAS * MAX_CORNERS),
        }
        #: who sends the upload of each kind that is open
        self._ports: dict[int, StationPort] = {}

    def on_frame(self, port: StationPort, frame: Frame, now: float) -> None:
        """A frame of the commander that is part of an upload."""
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        sender = (frame.sysid, frame.compid)
        for kind, server in self._servers.items():
            if not server.knows(message):
                continue
            self._offer(kind)
            turn = server.take(message, sender, now)
            if server.sender == sender:
                self._ports[kind] = port
            self._carry_out(kind, port, turn, now)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._worker.tick(now)
        for kind, server in self._servers.items():
            if kind in self._ports:
                self._carry_out(kind, self._ports[kind], server.tick(now), now)

    def found(self, now: float) -> None:
        """After a restart of the companion in flight: the autopilot flies another mission than the package's. It is
        read back, so that the rest of the companion goes by it again; if that fails, nobody knows it, as before."""

        def done(talk: Conversation, now: float) -> None:
            package, here, commander = (
                self._flown.package,
                self._command_check.here(now),
                self._authority.arbiter.view.commander,
            )
            if talk.failure is not None or len(talk.result) <= 1:
                return
            if package is None or here is None or commander is None:
                return
            items = talk.result
            self._worker.submit(lambda: _read_route(package, items, here, commander), self._was_found)

        if _WRITE not in self._conversations:
            self._conversations.begin(_READ, self._procedures().held_mission(), done, now)

    def _was_found(self, result: Rerouted | Exception, now: float) -> None:
        if isinstance(result, Rerouted) and self._command_check.ahead is None and _WRITE not in self._conversations:
            self._reports.event_log.found_in_flight(len(result.ahead.route.items), result.commanders)
            self._flown.reroute(result, now)

    def authority_moved(self, now: float) -> None:
        """Somebody else commands, or nobody: what is not being written by now is given up."""
        for kind, port in list(self._ports.items()):
            if kind == _MISSION and _WRITE in self._conversations:
                continue
            self._carry_out(kind, port, self._servers[kind].give_up("its sender no longer has authority", now), now)

    # ---- the steps ------------------------------------------------------------------------------------------------

    def _offer(self, kind: int) -> None:
        """What a part of a list is laid into."""
        ahead = self._command_check.ahead
        if kind == _MISSION:
            self._servers[kind].offered = None if ahead is None else ahead.route.upload_items()

    def _carry_out(self, kind: int, port: StationPort, turn: Turn, now: float) -> None:
        self._reports.answer(port, _WORDS[kind], turn, now)
        if self._servers[kind].sender is None:
            self._ports.pop(kind, None)
        if turn.whole is None:
            return
        if kind == _FENCE:
            self._judge_fence(port, turn.whole, now)
        else:
            self._read(port, turn.whole, now)

    def _conclude(self, port: StationPort, kind: int, result: int, words: str, now: float) -> None:
        """The upload is dealt with; `words`: why it is refused, "" if people know that already, or it is not."""
        turn = self._servers[kind].conclude(result, now)
        self._carry_out(kind, port, Turn(turn.answers, words=words), now)

    def _judge_fence(self, port: StationPort, upload: Upload, now: float) -> None:
        ahead = self._command_check.ahead
        held = ahead is not None and upload.items and same_fence(upload.items, ahead.route.fence)
        result = mavlink.MAV_MISSION_ACCEPTED if held else _DENIED
        words = "" if held else "it cannot be changed in flight"
        self._conclude(port, _FENCE, result, words, now)

    def _read(self, port: StationPort, upload: Upload, now: float) -> None:
        package, here = self._flown.package, self._command_check.here(now)
        if not upload.items:
            self._conclude(port, _MISSION, _DENIED, "it cannot be cleared in flight, only replaced", now)
        elif package is None or here is None:
            self._conclude(port, _MISSION, _DENIED, "without a mission package and a position it cannot be judged", now)
        else:
            commander = port.sysid
            read = self._worker.submit(
                lambda: _read_route(package, upload.items, here, commander),
                lambda result, now: self._was_read(port, upload, result, now),
            )
            if not read:
                self._conclude(port, _MISSION, mavlink.MAV_MISSION_ERROR, "another mission is being read", now)

    def _was_read(self, port: StationPort, upload: Upload, result: Rerouted | Exception, now: float) -> None:
        if self._servers[_MISSION].sender != upload.sender:  # it was given up meanwhile
            return
        if not isinstance(result, Rerouted):
            why = str(result) if isinstance(result, (MissionError, TimeoutError)) else "internal fault"
            if why == "internal fault":
                self._reports.fault("upload", f"{type(result).__name__}: {result}")
            self._conclude(port, _MISSION, mavlink.MAV_MISSION_INVALID, why, now)
            return
        lacks = not_as_checked(result.facts, self._state)
        if lacks:
            self._conclude(port, _MISSION, _DENIED, lacks, now)
            return
        ruling = self._command_check.route(port, result.ahead, (upload.sender, upload.items), upload.begun_at, now)
        if not ruling.passes:
            self._conclude(port, _MISSION, _DENIED, "", now)
            return
        self._write(port, result, now)

    def _write(self, port: StationPort, read: Rerouted, now: float) -> None:
        items = read.ahead.route.upload_items()
        self._flown.reroute(None, now)  # from its first message on, the autopilot does not hold what it held

        def done(talk: Conversation, now: float) -> None:
            if talk.failure is not None:
                words = f"{talk.failure}: what the autopilot holds is not known, send it again"
                self._conclude(port, _MISSION, mavlink.MAV_MISSION_ERROR, words, now)
                return
            self._reports.event_log.rerouted(port.name, len(items) - 1, read.commanders)
            self._flown.reroute(read, now)
            self._conclude(port, _MISSION, mavlink.MAV_MISSION_ACCEPTED, "", now)
            if read.facts.low:
                self._reports.voice.say(port, f"mission, warning: {read.facts.low}")

        self._conversations.begin(_WRITE, self._procedures().replace_mission(items), done, now)


def _read_route(
    package: MissionPackage, items: tuple[MissionItem, ...], here: tuple[float, float, float], commander: int
) -> Rerouted:
    """What an upload says, with the zones of the package. Raises MissionError. Takes as long as the upload makes it."""
    route: Route = with_return(with_items(package.route, items), package.zones, package.terrain)
    ahead = Ahead(route, package.zone_finder(), package.cruise_speed_mps)
    legs, facts = ahead.way(1, here), plan_facts(route, ahead.speed_mps)
    if not legs:
        return Rerouted(ahead, (commander,), facts)
    wrong = into_ground(route, legs, package.relief())
    if wrong:
        raise MissionError(wrong)
    walk = walk_legs(legs, package.zone_finder(), commander)
    return Rerouted(ahead, walk.commanders, facts, WayAhead.of(walk, route))

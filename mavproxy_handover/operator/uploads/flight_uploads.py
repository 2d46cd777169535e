# SPDX-License-Identifier: GPL-3.0-or-later

"""Missions and geofences that the commander uploads in flight: the companion takes and judges them.

An upload straight to the autopilot would change the flown list with its first message. After a link loss, the autopilot
would hold a mixture that no program knows. So the companion takes uploads itself, by the protocol of
`gate/mission_server.py`. It writes the whole upload to the autopilot, or nothing.

* A mission is collected, read like that of a package, and judged by energy, fence and coverage from where the aircraft
  is. Then the companion writes it and reads it back, and answers ACCEPTED. From then on, route check, speeds, zones and
  the expected commanders follow the new mission.
* Only items that a package may hold are allowed (`mission/items.py`). Jumps, a moved home and a disabled fence cannot
  be judged. A take-off is not needed. After a plane's mission, a return must end in a landing: if the return needs a
  landing sequence, a mission without one would let the plane circle for ever.
* Heights above the sea need the same height of home in the plan and at the autopilot. Heights above terrain need an
  autopilot that knows the ground. A way into the ground is refused, by the package's heights (`mission/heights.py`).
* Clearing the mission is refused: the autopilot would have nothing to fly, and RTL needs no empty mission.
* A geofence cannot be changed in flight. The autopilot enforces it by itself, and the return sites were checked against
  it. A fence that leaves the aircraft outside lands it at once (4.7) or turns it back. The same fence is accepted,
  because ground station programs send a whole plan.
* The package's digest stays: it covers zones and stations, which have not changed, and a partner must have the same.
  Stations are told that the route is another one. After landing the mission does not count any more, and START needs a
  package.

A worker thread does what takes time. Times are monotonic seconds.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.mission_server import MissionServer, Turn, Upload
from mavproxy_handover.mission.ahead import Ahead
from mavproxy_handover.mission.crossings import WayAhead
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.heights import into_ground
from mavproxy_handover.mission.items import COMMANDS, JUMPS, MissionItem
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import MAX_CORNERS, MAX_ITEMS, Route, with_items
from mavproxy_handover.mission.protocol_items import Flaw, flaw
from mavproxy_handover.mission.returns import with_return
from mavproxy_handover.mission.route_simulation import simulate_legs
from mavproxy_handover.monitors.preflight.own_failsafes import plan_facts
from mavproxy_handover.monitors.preflight.plan_fit import not_as_checked
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.uploads.flown_mission import FlownMission
from mavproxy_handover.operator.uploads.prepared import Rerouted
from mavproxy_handover.tools.worker import Worker
from mavproxy_handover.vehicle.mission_protocol import same_fence
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.conversation import Conversation
from mavproxy_handover.wire.frames import Frame

__all__ = ["FlightUploads"]

_MISSION: Final[int] = mavlink.MAV_MISSION_TYPE_MISSION
_FENCE: Final[int] = mavlink.MAV_MISSION_TYPE_FENCE
_WORDS: Final = {_MISSION: "mission", _FENCE: "geofence"}
_DENIED: Final[int] = mavlink.MAV_MISSION_DENIED
#: a geofence may have at most this many areas, more than ArduPilot stores
_MOST_AREAS: Final = 32
#: names of the conversations
_WRITE: Final = "upload"
_READ: Final = "mission found in flight"


def _mission_flaw(item: MissionItem) -> Flaw | None:
    """The flaw of a single mission item; None: none. Item 0 is home, which the autopilot sets itself."""
    if item.seq and (item.command not in COMMANDS or item.command in JUMPS):
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
        #: the sender of each open upload, by kind of list
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
            turn = server.handle(message, sender, now)
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
        """After a restart of the companion in flight, the autopilot flies another mission than the package's.

        The mission is read back, so that the companion follows it again. If that fails, it stays unknown.
        """

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
        """Another station commands, or no station: end the uploads that are not being written yet."""
        for kind, port in list(self._ports.items()):
            if kind == _MISSION and _WRITE in self._conversations:
                continue
            self._carry_out(kind, port, self._servers[kind].give_up("its sender no longer has authority", now), now)

    # ---- the steps ------------------------------------------------------------------------------------------------

    def _offer(self, kind: int) -> None:
        """Set the list that a partial upload changes."""
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
        """Answer the upload. `words`: why it is refused, "" if it is not or if people know that already."""
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
        if self._servers[_MISSION].sender != upload.sender:  # the upload has ended meanwhile
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
        self._flown.reroute(None, now)  # from the first message on, the autopilot does not hold the former mission

        def done(talk: Conversation, now: float) -> None:
            if talk.failure is not None:
                words = f"{talk.failure}: what the autopilot holds is not known, send it again"
                self._conclude(port, _MISSION, mavlink.MAV_MISSION_ERROR, words, now)
                return
            self._reports.event_log.rerouted(port.name, len(items) - 1, read.commanders)
            self._flown.reroute(read, now)
            self._conclude(port, _MISSION, mavlink.MAV_MISSION_ACCEPTED, "", now)
            if read.facts.low:
                self._reports.message_sender.say(port, f"mission, warning: {read.facts.low}")

        self._conversations.begin(_WRITE, self._procedures().replace_mission(items), done, now)


def _read_route(
    package: MissionPackage, items: tuple[MissionItem, ...], here: tuple[float, float, float], commander: int
) -> Rerouted:
    """Read the mission of an upload, with the zones of the package; for a worker thread. Raises MissionError."""
    route: Route = with_return(with_items(package.route, items), package.zones, package.terrain)
    ahead = Ahead(route, package.zone_finder(), package.cruise_speed_mps)
    legs, facts = ahead.way(1, here), plan_facts(route, ahead.speed_mps)
    if not legs:
        return Rerouted(ahead, (commander,), facts)
    wrong = into_ground(route, legs, package.relief())
    if wrong:
        raise MissionError(wrong)
    simulation = simulate_legs(legs, package.zone_finder(), commander)
    return Rerouted(ahead, simulation.commanders, facts, WayAhead.of(simulation, route))

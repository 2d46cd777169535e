# SPDX-License-Identifier: GPL-3.0-or-later

"""One vehicle at a station: connects its rules, mission, links and displays.

Makes events of `StationCore` from the vehicle's messages and the operator's commands, and messages and lines from the
actions of `StationCore`. Decides nothing. A station has one `Aircraft` for each vehicle; none knows another one.

MAVProxy does not know our messages unless it was started with `--dialect=handover`: it delivers them undecoded, without
a check of CRC or signature. So their raw bytes are parsed here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.banner import Situation
from gcs_module.briefing import Briefing
from gcs_module.commands import StationCommands
from gcs_module.core import (
    Action,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    Notice,
    StationCore,
    ToPeer,
    ToVehicle,
    VehicleHeard,
)
from gcs_module.decisions import Decisions
from gcs_module.duty import Duty
from gcs_module.event_log import FlightEventLog
from gcs_module.events import AcknowledgeManager, AskManager, AutopilotHeard
from gcs_module.flight_values import FlightValues
from gcs_module.links import Links
from gcs_module.map_layer import Now, now_of
from gcs_module.map_view import MapView, loaded_maps
from gcs_module.mission_session import MissionSession
from gcs_module.mission_transfer import MissionTransfer
from gcs_module.notices import notice
from gcs_module.route_watch import StationRouteWatch
from gcs_module.standard_frames import acknowledgement, control_asked, control_status
from gcs_module.station_resources import VehicleResources
from gcs_module.texts import Texts
from gcs_module.vehicle_addresses import VehicleAddresses
from gcs_module.vehicle_connection import VehicleConnection
from gcs_module.vehicle_links import VehicleLinks
from gcs_module.vehicle_state import VehicleState
from gcs_module.vehicle_texts import VehicleTexts
from gcs_module.view import View, telemetry_line
from mavproxy_handover.companion.hosting import guarded
from mavproxy_handover.config.files import FleetVehicle, StationConfig
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.mission.addresses import without_addresses
from mavproxy_handover.store.confirmed_address import address_file
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, OUR_MESSAGES, PROBE_COMPID
from mavproxy_handover.wire.signing import SignatureVerdict

__all__ = ["Aircraft"]

#: components of the vehicle whose messages of `wire/handover.xml` count
_SPEAKERS: Final = frozenset((COMPANION_COMPID, LANGUAGE_COMPID))
#: notices about another station: the rules of every vehicle make them, and the station tells them once
_OF_STATION: Final = ("peer", "peer_lost")


def _is_answer(action: Action) -> bool:
    """Whether the action answers the vehicle or another station, or tells the operator of such an answer."""
    return not isinstance(action, Notice) or action.event in ("consent", "set_up", "told")


class Host(Protocol):
    """The part of the station's module that one vehicle needs."""

    config: StationConfig
    links: Links
    faults: Counter[str]
    settings_of_ours: Any
    journal: Journal
    console: Any
    mpstate: Any
    duty: Duty
    #: numbers of questions about addresses: no two vehicles use the same one
    address_questions: Iterator[int]

    def now(self) -> float:
        """Monotonic time (s)."""

    def fault(self, where: str, text: str) -> None:
        """Count and journal an internal fault."""

    def speak(self, text: str) -> None:
        """Say a text by MAVProxy's speech module, if it is loaded."""

    def ring(self, bell: str) -> None:
        """Ring the terminal's bell."""

    def chosen(self, sysid: int) -> bool:
        """Whether MAVProxy's own lines and commands are about this vehicle."""

    def to_peer(self, peer: int, message: Any, vehicle: int) -> None:
        """Send a MAVLink message about a vehicle to another station."""

    def of_station(self, notice: Notice, vehicle: int) -> None:
        """A notice about another station, from one vehicle's rules."""

    def ground_ports(self) -> tuple[int, ...]:
        """Ports at which the station listens for other stations."""


class Aircraft:
    """`row`: the status row of MAVProxy's console that this vehicle uses."""

    def __init__(self, host: Host, vehicle: FleetVehicle, resources: VehicleResources, row: int) -> None:
        self.config = config = host.config
        self.vehicle = vehicle
        self.sysid = vehicle.sysid
        #: the vehicle's name in lines about it; "" if the station has no other vehicle
        self.of = vehicle.name if host.links.several else ""
        self.faults = host.faults
        self._host = host
        stations = tuple(peer.station for peer in config.peers)
        self.core = StationCore(config.station, vehicle.called, stations, automatic=config.automatic)
        self.state = VehicleState(self.core)
        self.connection = VehicleConnection(host.links, self.sysid, resources.signing, host.now, self._fault)
        package_file = config.path.with_name(f"{config.station.name}-vehicle-{vehicle.sysid}.mission")
        self.mission_transfer = MissionTransfer(resources.held, package_file)
        #: addresses of the vehicle that other stations send with a mission
        self.addresses = VehicleAddresses(
            VehicleLinks(host.mpstate, host.links, vehicle.sysid, vehicle.name, host.ground_ports),
            config.station.sysid,
            address_file(config.path, config.station.name, vehicle.sysid),
            ask=config.offered_addresses,
            local=config.offered_addresses_local,
            keyed=resources.signing is not None,
            numbers=host.address_questions,
        )
        self.route = StationRouteWatch(config.route)
        companion_texts = Texts(self._was_shown_by_mavproxy)
        self.decisions = Decisions(companion_texts.pop)
        self.briefing = Briefing()
        self.values = FlightValues()
        self.view = View(self.situation, config.station.name, host.console, host.speak, host.ring, row, host.now)
        duty = host.duty
        self.core.manned = duty.manned
        self.event_log = FlightEventLog(host.journal, self.core, self.view, self.of or None, lambda: duty.name)
        self.texts = VehicleTexts(companion_texts, self.decisions, self.event_log, partial(host.chosen, self.sysid))
        self.missions = MissionSession(
            self.sysid, self.mission_transfer, self.core, self.state, self.route, self.event_log
        )
        self._map_view = MapView(f"handover {vehicle.sysid}", partial(loaded_maps, host.mpstate), self._fault)
        self.commands = StationCommands(self, host.settings_of_ours)
        self._telemetry_shown_at = 0.0
        #: nothing is answered by itself: the program that is this station is not there (`served_program.py`)
        self.mute = False
        #: the name that the vehicle uses for itself, if a notice about the difference was given
        self._other_name = ""

    def begin(self) -> None:
        """Set up the links, and tell the rules which mission package is held; to be called once, after construction."""
        self.connection.refresh()
        held = self.mission_transfer.held
        if held is not None:
            self.handle(MissionHeld(held.digest))
            if held.addresses_fault:
                self._notice(Notice("address", without_addresses(held.addresses_fault)))

    def release(self) -> None:
        """Restore the links, and remove the vehicle from map and console."""
        self._guarded("map", self._map_view.remove)
        self._guarded("status row", self.view.clear)
        self.connection.release()
        self._guarded("vehicle address", self.addresses.release)

    def situation(self) -> Situation:
        """What the station knows of the vehicle now."""
        return self.state.situation(self._now(), self.decisions.action, self.of)

    def _was_shown_by_mavproxy(self, text: str) -> bool:
        """MAVProxy's link module handles a text before this module does: it keeps the last one that it has shown."""
        return self._host.chosen(self.sysid) and getattr(self._host.mpstate.status, "last_apm_msg", None) == text

    # ---- in -------------------------------------------------------------------------------------------------------

    def on_frame(self, frame: Frame, m: Any) -> None:
        """A frame of this vehicle, and MAVProxy's message of it."""
        if frame.compid == AUTOPILOT_COMPID:
            self._guarded("route check", lambda: self._notice(self.route.on_autopilot(m, self._now())))
            self._guarded("values", lambda: self.view.values.update(m, self._now()))
            self._guarded("values", lambda: self.values.on_autopilot(m, self._now()))
        if frame.msgid in OUR_MESSAGES:
            if frame.compid in _SPEAKERS and self._is_proven(frame):
                self._on_ours(frame)
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_CONTROL_STATUS:
            if self._is_proven(frame):
                heard = control_status(frame)
                if heard is not None and not heard.manager:
                    self.state.on_payload(frame.compid, heard.main, self._now())
                self._on_control(heard)
        elif frame.msgid in (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT):
            self._on_control(control_asked(frame, self.config.station.sysid))
        elif frame.compid == COMPANION_COMPID:
            if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self.handle(VehicleHeard())
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:  # of a request for control
                self.commands.on_message(m, self._now())
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self.texts.on_companion(frame, self._now())
        elif frame.compid == PROBE_COMPID:
            if not self.mute:
                self.connection.answer_probe(frame, self._now())
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            self.texts.on_other(frame, m, self._now())
        elif frame.msgid in (mavlink.MAVLINK_MSG_ID_COMMAND_ACK, mavlink.MAVLINK_MSG_ID_HEARTBEAT):
            if frame.compid == AUTOPILOT_COMPID and frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self.state.on_heartbeat(m, self._now())
                self.handle(AutopilotHeard(not self.state.disarmed))
            self.commands.on_message(m, self._now())

    def _on_control(self, event: Event | None) -> None:
        """A message of the operator-control standard; the rules use it only if no companion of ours is heard."""
        if event is not None:
            self.handle(event)

    def _is_proven(self, frame: Frame) -> bool:
        """Whether a message of ours is the vehicle's; a wrong signature is counted."""
        verdict = self.connection.check(frame)
        if verdict not in (SignatureVerdict.OK, None):
            self.faults[self._where(f"message of the vehicle: signature {verdict.value}")] += 1
        return verdict is SignatureVerdict.OK

    def _on_ours(self, frame: Frame) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        kind = message.get_type()
        if kind in ("MISSION_PACKAGE", "MISSION_CHUNK", "MISSION_PACKAGE_ACK"):
            # from the vehicle only the package that it flies is accepted
            other = kind == "MISSION_PACKAGE" and bytes(message.mission_digest) != self.core.vehicle_digest
            if not other and message.target_system in (0, self.config.station.sysid):
                self.on_package(frame, message)
        elif kind == "AUTHORITY_STATUS":
            self.handle(self.state.on_authority(message, self._now()))
            self._on_route_changed(bool(message.route_changed))
            self._on_rehearsal(bool(message.rehearsal))
        elif kind == "HANDOVER_TELEMETRY":
            self._on_telemetry(message)
        elif kind == "HANDOVER_DECISION":
            site = "" if self.state.return_site is None else self.state.return_site[0]
            self._notice(self.decisions.on_message(message, self.state.commanded_by, site))
        elif kind in ("HANDOVER_OVERRIDE", "HANDOVER_REHEARSAL", "HANDOVER_DELEGATE"):
            self.commands.on_message(message, self._now())
        elif kind == "HANDOVER_BRIEFING":
            if message.target_system == self.config.station.sysid:
                self._on_briefing(message)
        else:
            self._on_transfer(message)

    def _on_route_changed(self, changed: bool) -> None:
        """The vehicle says whether it flies its package's mission, or another one that its commander has sent since."""
        if changed == self.state.rerouted:
            return
        self.state.rerouted = changed
        if changed:
            self._notice(notice("rerouted"))
        self._update_held_mission()

    def _on_rehearsal(self, rehearsal: bool) -> None:
        """A text of the vehicle tells the beginning and the end; at the end the station asks for the report."""
        was, self.state.rehearsal = self.state.rehearsal, rehearsal
        if was and not rehearsal:
            self.commands.rehearsal_report()

    def _on_transfer(self, message: Any) -> None:
        decoded = codec.decode(message)
        if decoded is None or message.target_system not in (0, self.config.station.sysid):
            return
        if message.vehicle != self.sysid:
            self.faults[self._where("message of the vehicle: about another one")] += 1
            return
        self.event_log.message("in", decoded, "vehicle", self._now())
        self.handle(FromVehicle(decoded))
        self._update_held_mission()

    def _on_telemetry(self, message: Any) -> None:
        now = self._now()
        self.view.telemetry(message, now)
        self._guarded("values", lambda: self.values.on_telemetry(message, now))
        zone = self.core.zone_name(message.zone, message.other_zone)
        self.event_log.telemetry(message.lat / 1e7, message.lon / 1e7, zone)
        every_s = self.commands.settings.telemetry
        if every_s > 0 and now - self._telemetry_shown_at >= every_s:
            self._telemetry_shown_at = now
            self.view.line(telemetry_line(message, zone))
        self._guarded("route check", lambda: self._notice(self.route.on_telemetry(message, now)))

    def _on_briefing(self, message: Any) -> None:
        self.briefing.add_line(message.number, message.line, message.lines, message.text, self._now())
        lines = self.briefing.due(self.core.asked_to_take, self.core.asked_at)
        if lines:
            self.event_log.briefing(self.core.vehicle_name, lines)

    def on_package(self, frame: Frame, message: Any) -> None:
        """A package message for this vehicle's mission, from its companion or from another station."""
        for answer in self.missions.on_message(frame.sysid, frame.compid, message, self._now()):
            if not self.mute:
                self._put(frame.sysid, answer)
        if message.get_type() == "MISSION_PACKAGE":
            name = "" if frame.sysid == self.sysid else self.core.name(frame.sysid)
            self.addresses.offered(frame.sysid, name, message.name, bytes(message.addresses))

    def on_peer(self, peer: int, message: Any) -> None:
        """A message of a transfer of this vehicle, from another station over the ground link."""
        decoded = codec.decode(message)
        if decoded is not None:
            self.event_log.message("in", decoded, self.core.name(peer), self._now(), via="ground")
            self.handle(FromPeer(peer, decoded))

    # ---- time -----------------------------------------------------------------------------------------------------

    def idle(self, now: float, links: Sequence[Any]) -> None:
        """The vehicle's turn in MAVProxy's main loop, many times a second. `links`: the vehicle's."""
        self._guarded("choice of link", lambda: self._choose_link(links, now))
        self._guarded("command", lambda: self.commands.tick(now))
        self._guarded("mission package", lambda: self._send_package(now))
        self._guarded("text of the vehicle", lambda: self.texts.show_due(now))

    def each_second(self, now: float) -> None:
        """To be called once a second."""
        self._guarded("vehicle address", lambda: self._update_addresses(now))
        self._guarded("links", self.connection.refresh)  # after the addresses: sign a new link before anything is sent
        self._perform(self.core.tick(now))
        self._guarded("alarms", lambda: self.event_log.repeat_alarms(now))
        self.event_log.sum_up(now)
        self._check_name()
        self.view.status(now)
        self.event_log.border_shown(self.situation())
        self._guarded("map", lambda: self._map_view.show(self.missions.flown(), self._map_contents, now))

    def _choose_link(self, links: Sequence[Any], now: float) -> None:
        address = self.connection.choose_link(links, now)
        if address:
            self.event_log.link_chosen(address)

    def _send_package(self, now: float) -> None:
        messages = self.missions.tick(now)
        self._update_held_mission()
        for receiver, message in messages:
            if not self.mute:
                self._put(receiver, message)

    def _update_held_mission(self) -> None:
        event = self.missions.update()
        if event is not None:
            self.handle(event)

    def _update_addresses(self, now: float) -> None:
        for line in self.addresses.tick(now, self.state.armed(now)):
            self._notice(Notice("address", line))

    def _map_contents(self) -> Now:
        state, now = self.state, self._now()
        text, track = self.decisions.text, self.route.track
        values = self.view.values
        return now_of(
            self.core,
            self.situation(),
            text,
            state.return_site,
            track,
            now,
            own_route=not state.rerouted,
            aircraft=values.place,
            aircraft_s=now - values.at if values.place is not None else 0.0,
        )

    def _check_name(self) -> None:
        """The vehicle's texts use its own name for itself: tell the operator if the configuration has another one."""
        calls_itself = self.core.vehicle_name
        if self.of and calls_itself not in (self.of, self._other_name):
            self._other_name = calls_itself
            self._notice(notice("other_name", calls_itself=calls_itself, configured=self.of))

    # ---- out ------------------------------------------------------------------------------------------------------

    def handle(self, event: Event) -> None:
        """An event for the rules, of this vehicle, of another station or of the operator."""
        self._perform(self.core.handle(event, self._now()))

    def _perform(self, actions: list[Action]) -> None:
        for action in actions:  # if one fails, the next one is still performed
            if self.mute and _is_answer(action):
                continue
            self._guarded(f"action {type(action).__name__}", partial(self._perform_one, action))

    def _perform_one(self, action: Action) -> None:
        match action:
            case ToVehicle():
                self._send(self.sysid, action.message, "vehicle")
            case ToPeer():
                self._send(action.peer, action.message, self.core.name(action.peer), via="ground")
            case AskManager():
                self.commands.ask_manager(action)
            case AcknowledgeManager():
                self.connection.send(acknowledgement(self.sysid, action.component))
            case Notice():
                if self.of and action.event in _OF_STATION:
                    self._host.of_station(action, self.sysid)
                else:
                    self._notice(action)
            case _:
                assert_never(action)

    def _notice(self, notice: Notice | None) -> None:
        if notice is not None:
            self.event_log.notice(notice, self._now())

    def _send(self, receiver: int, message: Message, who: str, via: str | None = None) -> None:
        component = COMPANION_COMPID if receiver == self.sysid else 0
        self.event_log.message("out", message, who, self._now(), via)
        self._put(receiver, codec.encode(message, (receiver, component), self.sysid))

    def _put(self, receiver: int, message: Any) -> None:
        if receiver == self.sysid:
            self.connection.send(message)
        else:
            self._host.to_peer(receiver, message, self.sysid)

    # ---- faults ---------------------------------------------------------------------------------------------------

    def _now(self) -> float:
        return self._host.now()

    def _where(self, what: str) -> str:
        return f"{self.of}: {what}" if self.of else what

    def _fault(self, where: str, text: str) -> None:
        self._host.fault(self._where(where), text)

    def _guarded(self, where: str, job: Callable[[], None]) -> None:
        """Run `job`; an exception is counted and journalled."""
        guarded(where, job, self._fault)

# SPDX-License-Identifier: GPL-3.0-or-later

"""One vehicle at a station: its rules, its mission, its links, and what the operator sees of it.

It decides nothing: it turns the vehicle's messages and the operator's words into events of `StationCore`, and the
core's actions into messages and lines. A station has one for each vehicle, and they know nothing of each other.

MAVProxy hands our messages over as unknown ones unless it was started with `--dialect=handover`, with neither CRC nor
signature checked, so their raw bytes are parsed here again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final, Protocol

from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.banner import OLD_S, Situation
from gcs_module.briefing import Briefing
from gcs_module.commands import StationCommands
from gcs_module.core import (
    Action,
    AuthorityHeard,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    Notice,
    Role,
    StationCore,
    ToPeer,
    ToVehicle,
    VehicleHeard,
)
from gcs_module.decisions import Decisions, Who
from gcs_module.links import Links
from gcs_module.map_layer import Now, now_of, place_of
from gcs_module.map_view import MapView, loaded_maps
from gcs_module.mission_transfer import MissionTransfer
from gcs_module.narrator import FlightNarrator
from gcs_module.route_watch import StationRouteWatch
from gcs_module.station_resources import VehicleResources
from gcs_module.texts import SEVERITIES, Texts
from gcs_module.udp_senders import UdpSenders
from gcs_module.uplink import UplinkSelector
from gcs_module.vehicle_addresses import SILENT_S, VehicleAddresses
from gcs_module.vehicle_links import VehicleLinks
from gcs_module.view import View, telemetry_line
from mavproxy_handover.config.files import FleetVehicle, StationConfig
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import LeaseState, Phase, Reason
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.gate.latent import fuller
from mavproxy_handover.hosting import guarded
from mavproxy_handover.link.timesync import probe_answer
from mavproxy_handover.mission.addresses import without_addresses
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.confirmed_address import address_file
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, field_int
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, OUR_MESSAGES, PROBE_COMPID
from mavproxy_handover.wire.signing import SignatureVerdict
from mavproxy_handover.wire.texts import is_marked

__all__ = ["Aircraft"]

#: components of the vehicle that the messages of `handover.xml` are taken from
_SPEAKERS: Final = frozenset((COMPANION_COMPID, LANGUAGE_COMPID))
#: what is said of another station, and not of a vehicle: every vehicle's rules notice it
_OF_STATION: Final = ("peer", "peer_lost")


class Host(Protocol):
    """The station's module, as far as one vehicle's part needs it."""

    config: StationConfig
    links: Links
    faults: Counter[str]
    settings_of_ours: Any
    journal: Journal
    console: Any
    mpstate: Any
    #: numbers of questions about addresses: no two vehicles ask by the same one
    address_questions: Iterator[int]

    def now(self) -> float:
        """Monotonic time (s)."""

    def fault(self, where: str, text: str) -> None:
        """Something broke."""

    def speak(self, text: str) -> None:
        """Say it, where MAVProxy can."""

    def ring(self, bell: str) -> None:
        """The terminal's bell."""

    def chosen(self, sysid: int) -> bool:
        """Whether MAVProxy's own lines and commands are about this vehicle."""

    def to_peer(self, peer: int, message: Any, vehicle: int) -> None:
        """Send a MAVLink message about a vehicle to another station."""

    def of_station(self, notice: Notice, vehicle: int) -> None:
        """A notice of one vehicle's rules that is about another station."""

    def ground_ports(self) -> tuple[int, ...]:
        """Ports at which the station listens for others."""


class Aircraft:
    """`row`: of the status rows of MAVProxy's console."""

    def __init__(self, host: Host, vehicle: FleetVehicle, resources: VehicleResources, row: int) -> None:
        self.config = config = host.config
        self.vehicle = vehicle
        self.sysid = vehicle.sysid
        #: in front of what is said of it, "" where there is no other one
        self.of = vehicle.name if host.links.several else ""
        self.faults = host.faults
        self._host = host
        #: the autopilot has said that it is
        self.disarmed = False
        #: the vehicle flies another mission than its package's
        self._rerouted = False
        #: whose zone holds it, as it says; None: nobody's
        self.zone: int | None = None
        stations = tuple(peer.station for peer in config.peers)
        self.core = StationCore(config.station, vehicle.called, stations, automatic=config.automatic)
        kept = config.path.with_name(f"{config.station.name}-vehicle-{vehicle.sysid}.mission")
        self.mission_transfer = MissionTransfer(resources.held, kept)
        #: the vehicle's addresses that come with a mission
        self.addresses = VehicleAddresses(
            VehicleLinks(host.mpstate, host.links, vehicle.sysid, vehicle.name, host.ground_ports),
            config.station.sysid,
            address_file(config.path, config.station.name, vehicle.sysid),
            ask=config.offered_addresses,
            local=config.offered_addresses_local,
            keyed=resources.signing is not None,
            numbers=host.address_questions,
        )
        #: the aircraft against its route
        self.route = StationRouteWatch(config.route)
        self.decisions = Decisions(self.said)
        self.briefing = Briefing()
        self.texts = Texts(self._shown)
        #: the autopilot's own, while MAVProxy shows another vehicle's
        self._its_texts = Texts(lambda _text: False)
        #: flight mode of the autopilot by its last heartbeat, and when that came
        self._mode, self._mode_at = "", -math.inf
        self.view = View(self.situation, config.station.name, host.console, host.speak, host.ring, row)
        self.narrator = FlightNarrator(host.journal, self.core, self.view, self.of or None)
        self._uplink = UplinkSelector()
        self._signing = resources.signing
        self._callers = UdpSenders(vehicle.sysid, resources.signing is not None, host.now, self._fault)
        self._telemetry_shown_at = 0.0
        self.map_view = MapView(f"handover {vehicle.sysid}", partial(loaded_maps, host.mpstate), self._fault)
        #: name, latitude and longitude (degrees) of where a return goes, as the vehicle said last
        self._place: tuple[str, float, float] | None = None
        #: it is carried, in a rehearsal on the ground
        self.rehearsal = False
        self.commands = StationCommands(self, host.settings_of_ours)
        self._other_name = ""

    def begin(self) -> None:
        """Everything is there: the first look at its links, and what the station holds for it."""
        self._see_to_links()
        held = self.mission_transfer.held
        if held is not None:
            self._handle(MissionHeld(held.digest))
            if held.addresses_fault:
                self._notice(Notice("address", without_addresses(held.addresses_fault)))

    def release(self) -> None:
        """Give its links back as they were, and take what is drawn of it from the map."""
        self._guarded("map", self.map_view.remove)
        self._guarded("status row", self.view.clear)
        self._callers.release()
        if self._signing is not None:
            self._signing.release()
        self._guarded("vehicle address", self.addresses.release)

    # ---- in -------------------------------------------------------------------------------------------------------

    def on_frame(self, frame: Frame, m: Any) -> None:
        """A frame of this vehicle, and MAVProxy's message of it."""
        if frame.compid == AUTOPILOT_COMPID:
            self._guarded("route check", lambda: self._notice(self.route.on_autopilot(m, self._now())))
            self._guarded("values", lambda: self.view.values.take(m, self._now()))
        if frame.msgid in OUR_MESSAGES:
            if frame.compid in _SPEAKERS and self._proven(frame):
                self._on_ours(frame)
        elif frame.compid == COMPANION_COMPID:
            if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._handle(VehicleHeard())
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:  # of a request for control
                self.commands.on_message(m, self._now())
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self.texts.on_frame(frame, self._now())
        elif frame.compid == PROBE_COMPID:
            self._answer_probe(frame)
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            self._on_text(frame, m)
        elif frame.msgid in (mavlink.MAVLINK_MSG_ID_COMMAND_ACK, mavlink.MAVLINK_MSG_ID_HEARTBEAT):
            if frame.compid == AUTOPILOT_COMPID and frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self.disarmed = not m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
                self._mode, self._mode_at = mavutil.mode_string_v10(m), self._now()
            self.commands.on_message(m, self._now())

    def situation(self) -> Situation:
        """What is known of the vehicle now."""
        core, now = self.core, self._now()
        fresh = now - self._mode_at <= OLD_S and not self.disarmed
        ahead = core.ahead if core.partner is None else None
        return Situation(
            core.vehicle_name,
            core.phase,
            core.name(core.commander) if core.commander else "",
            core.role is Role.COMMANDER,
            core.name(core.partner) if core.partner else "",
            self._mode if fresh else "",
            core.vehicle_silent_s(now),
            self.decisions.action,
            core.answer_left_s(now),
            core.alone,
            core.name(ahead.key.to_station) if ahead is not None else "",
            ahead.at - now if ahead is not None else math.inf,
            core.asked_ahead is not None,
            self.of,
            self.rehearsal,
        )

    def links_in_words(self) -> str:
        """How many of its links MAVProxy takes for good."""
        masters = self._host.links.of(self.sysid)
        return f"{sum(not getattr(master, 'linkerror', False) for master in masters)} of {len(masters)}"

    @property
    def flown_from_here(self) -> bool:
        """Whether it is in flight, and this station commands it."""
        return self.core.role is Role.COMMANDER and self.core.phase is not Phase.ON_LOAD

    @property
    def _who(self) -> Who:
        if self.core.commander is None:
            return Who.NOBODY
        return Who.THIS if self.core.role is Role.COMMANDER else Who.OTHER

    def said(self, beginning: str) -> str:
        """Words of the companion that begin so and are not shown yet; "" if there are none."""
        return self.texts.take(beginning)

    def _show_texts(self, now: float) -> None:
        for text in self.texts.due(now, self._told):
            self.narrator.text(text, now)
        for text in self._its_texts.due(now, self._told):
            self.narrator.text(text, now)

    def _told(self, text: str) -> bool:
        """Decisions, and who commands: they come in messages of ours too, and are told from those."""
        return self.decisions.told(text) or " commands now" in text

    def _shown(self, text: str) -> bool:
        """MAVProxy's own link module has it before this one: it remembers what it wrote last, of the chosen vehicle."""
        return self._host.chosen(self.sysid) and getattr(self._host.mpstate.status, "last_apm_msg", None) == text

    def _on_text(self, frame: Frame, m: Any) -> None:
        """MAVProxy shows it, of the vehicle that it has chosen; of others, what is grave is told here.

        What the gate says of this station's sticks is told in full as well.
        """
        text = m.text.decode("ascii", "replace") if isinstance(m.text, bytes) else m.text
        full = fuller(text.rstrip("\0"))
        if full is not None:
            self.narrator.stream(full, self._now())
        elif frame.compid == AUTOPILOT_COMPID and is_marked(frame):  # before the vehicle knew this program
            self.texts.on_frame(frame, self._now())
        elif field_int(frame, "severity") in SEVERITIES and not self._host.chosen(self.sysid):
            self._its_texts.on_frame(frame, self._now())

    def _proven(self, frame: Frame) -> bool:
        """Whether one of our messages is the vehicle's: MAVProxy checks no signature of what it takes for unknown."""
        verdict = SignatureVerdict.OK if self._signing is None else self._signing.check(frame)
        if verdict not in (SignatureVerdict.OK, None):
            self.faults[self._where(f"message of the vehicle: signature {verdict.value}")] += 1
        return verdict is SignatureVerdict.OK

    def _see_to_links(self) -> None:
        """Links may come later."""
        masters = self._host.links.of(self.sysid)
        self._callers.watch(masters)
        if self._signing is not None:
            self._signing.tell(self._callers.proven)
            self._signing.sign(masters)

    def _answer_probe(self, frame: Frame) -> None:
        """On every link: MAVProxy does not say by which one a message came, and the vehicle takes the right one."""
        answer = probe_answer(frame, int(self._now() * 1e9))
        if answer is not None:
            for master in self._host.links.of(self.sysid):
                master.mav.send(answer)

    def _on_ours(self, frame: Frame) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        kind = message.get_type()
        if kind in ("MISSION_PACKAGE", "MISSION_CHUNK", "MISSION_PACKAGE_ACK"):
            # the vehicle sends back the package that it flies, and no other
            other = kind == "MISSION_PACKAGE" and bytes(message.mission_digest) != self.core.vehicle_digest
            if not other and message.target_system in (0, self.config.station.sysid):
                self.on_package(frame, message)
        elif kind == "AUTHORITY_STATUS":
            phase = Phase(message.phase) if message.phase in list(Phase) else Phase.EMERGENCY
            recovering = message.lease == LeaseState.RECOVERING
            who = message.commander or None, message.partner or None
            why = Reason(message.transfer_reason) if message.transfer_reason in list(Reason) else Reason.NONE
            ends_s = message.zone_ends - 1.0 if message.zone_ends else math.inf
            self.zone = zone = message.zone or None
            left_s = message.answer_left - 1.0 if message.answer_left else math.inf
            transfer = *who, message.epoch, message.handover_id
            alone = message.lease == LeaseState.ALONE
            border = message.crossing
            self._handle(AuthorityHeard(phase, *transfer, recovering, why, zone, ends_s, alone, left_s, border))
            self._place = place_of(message)
            self._route_changed(bool(message.route_changed))
            self._rehearses(bool(message.rehearsal))
        elif kind == "HANDOVER_TELEMETRY":
            self._on_telemetry(message)
        elif kind == "HANDOVER_DECISION":
            self._notice(self.decisions.on_message(message, self._who))
        elif kind in ("HANDOVER_OVERRIDE", "HANDOVER_REHEARSAL"):
            self.commands.on_message(message, self._now())
        elif kind == "HANDOVER_BRIEFING":
            if message.target_system == self.config.station.sysid:
                self._on_briefing(message, self._now())
        else:
            self._on_transfer(message)

    def _rehearses(self, rehearsal: bool) -> None:
        """What has begun, or is over, was told in a text of its own; when it is over, there is a report."""
        was, self.rehearsal = self.rehearsal, rehearsal
        if was and not rehearsal:
            self.commands.rehearsal_report()

    def _on_transfer(self, message: Any) -> None:
        decoded = codec.decode(message)
        if decoded is None or message.target_system not in (0, self.config.station.sysid):
            return
        if message.vehicle != self.sysid:
            self.faults[self._where("message of the vehicle: about another one")] += 1
            return
        self.narrator.message("in", decoded, "vehicle", self._now())
        self._handle(FromVehicle(decoded))
        self._hold()

    def _on_telemetry(self, message: Any) -> None:
        now = self._now()
        self.view.telemetry(message, now)
        zone = self.core.zone_name(message.zone, message.other_zone)
        self.narrator.telemetry(message.lat / 1e7, message.lon / 1e7, zone)
        every_s = self.commands.settings.telemetry
        if every_s > 0 and now - self._telemetry_shown_at >= every_s:
            self._telemetry_shown_at = now
            self.view.line(telemetry_line(message, zone))
        self._guarded("route check", lambda: self._notice(self.route.on_telemetry(message, now)))

    def _on_briefing(self, message: Any, now: float) -> None:
        self.briefing.take(message.number, message.line, message.lines, message.text, now)
        lines = self.briefing.due(self.core.asked_to_take, self.core.asked_at)
        if lines:
            self.narrator.briefing(self.core.vehicle_name, lines)

    def _notice(self, notice: Notice | None) -> None:
        if notice is not None:
            self.narrator.notice(notice, self._now())

    def on_package(self, frame: Frame, message: Any) -> None:
        """A message of a package that is this vehicle's, of its companion or of another station."""
        now = self._now()
        answers, line = self.mission_transfer.on_message(frame.sysid, frame.compid, message, now)
        for answer in answers:
            self._put(frame.sysid, answer)
        if line:
            self._tell_of(frame.sysid, "package_sent", line)
        if message.get_type() == "MISSION_PACKAGE":
            name = "" if frame.sysid == self.sysid else self.core.name(frame.sysid)
            self.addresses.offered(frame.sysid, name, message.name, bytes(message.addresses))

    def _hold(self) -> None:
        """An offer of another station counts once the vehicle announces it; the core is told what is held."""
        line = self.mission_transfer.inbox.announced(self.core.vehicle_digest, self.disarmed)
        if line:
            self._tell_of(self.sysid, "package_received", line)
        held = self.mission_transfer.held
        if held is not None and held.digest != self.core.digest:
            self._handle(MissionHeld(held.digest))
        same = held is not None and held.digest == self.core.vehicle_digest
        self.route.compare_to(held if same and not self._rerouted else None)

    def _route_changed(self, changed: bool) -> None:
        """The vehicle says whether it flies its package's mission, or another one that its commander has sent since."""
        if changed == self._rerouted:
            return
        self._rerouted = changed
        if changed:
            text = "The commander has changed the mission in flight: no route check here until it has landed."
            self._notice(Notice("rerouted", text))
        self._hold()

    def on_peer(self, peer: int, message: Any) -> None:
        """A message of a transfer of this vehicle, from another station over the ground link."""
        decoded = codec.decode(message)
        if decoded is not None:
            self.narrator.message("in", decoded, self.core.name(peer), self._now(), via="ground")
            self._handle(FromPeer(peer, decoded))

    # ---- time -----------------------------------------------------------------------------------------------------

    def idle(self, now: float, links: Sequence[Any]) -> None:
        """Its turn in MAVProxy's main loop, many times a second. `links`: its own."""
        self._guarded("choice of link", lambda: self._choose_link(links, now))
        self._guarded("command", lambda: self.commands.tick(now))
        self._guarded("mission package", lambda: self._send_package(now))
        self._guarded("text of the vehicle", lambda: self._show_texts(now))

    def each_second(self, now: float) -> None:
        """Once a second."""
        self._guarded("vehicle address", lambda: self._see_to_addresses(now))
        self._guarded("links", self._see_to_links)  # after it: a new link is signed before anything is sent
        self._perform(self.core.tick(now))
        self._guarded("alarms", lambda: self.narrator.again(now))
        self.narrator.sum_up(now)
        self._other_name_noticed()
        self.view.status(now)
        self._guarded("map", lambda: self.map_view.show(self._flown(), self._on_map, now))

    @property
    def armed(self) -> bool:
        """Whether autopilot or companion was heard within SILENT_S, and the autopilot has not said that it is
        disarmed."""
        now = self._now()
        silent_s = min(now - self._mode_at, self.core.vehicle_silent_s(now))
        return self._mode_at > -math.inf and not self.disarmed and silent_s < SILENT_S

    def _see_to_addresses(self, now: float) -> None:
        for line in self.addresses.tick(now, self.armed):
            self._notice(Notice("address", line))

    def _flown(self) -> MissionPackage | None:
        """The mission package that the vehicle flies, or will fly for all that is known here."""
        held, announced = self.mission_transfer.held, self.core.vehicle_digest
        return held if held is not None and (not any(announced) or announced == held.digest) else None

    def _on_map(self) -> Now:
        track, own = self.route.track, not self._rerouted
        return now_of(self.core, self.situation(), self.decisions.text, self._place, track, self._now(), own_route=own)

    def _other_name_noticed(self) -> None:
        """What an aircraft calls itself stands in its texts: where that is not what it is called here, say so."""
        calls_itself = self.core.vehicle_name
        if self.of and calls_itself not in (self.of, self._other_name):
            self._other_name = calls_itself
            self._notice(Notice("named", f"It calls itself {calls_itself!r}, the configuration {self.of!r}."))

    def _choose_link(self, masters: Sequence[Any], now: float) -> None:
        """MAVProxy's own fail-over takes five seconds."""
        if len(masters) < 2:
            return
        links = self._host.links
        before = links.number(self.sysid)
        chosen = self._uplink.choose([self._callers.received(master) for master in masters], before, now)
        if chosen != before:
            self.narrator.link_chosen(links.use(self.sysid, chosen).address)

    def _send_package(self, now: float) -> None:
        messages, lines = self.mission_transfer.tick(now, lambda receiver: self._alive(receiver, now))
        for receiver, line in lines:
            self._tell_of(receiver, "package_offer", line)
        self._hold()
        for receiver, message in messages:
            self._put(receiver, message)

    def _alive(self, receiver: int, now: float) -> bool:
        vehicle = receiver == self.sysid
        return self.core.vehicle_alive(now) if vehicle else self.core.peer_alive(receiver, now)

    def _tell_of(self, sysid: int, event: str, line: str) -> None:
        who = "this station" if not sysid else "vehicle" if sysid == self.sysid else self.core.name(sysid)
        self.narrator.package(event, line, who)

    # ---- out ------------------------------------------------------------------------------------------------------

    def handle(self, event: Event) -> None:
        """An event for the rules: of this vehicle, or of another station."""
        self._handle(event)

    def _handle(self, event: Event) -> None:
        self._perform(self.core.handle(event, self._now()))

    def operator(self, event: Event) -> None:
        """An operator's word to the core."""
        self._handle(event)

    def _perform(self, actions: list[Action]) -> None:
        for action in actions:  # those behind one that breaks are none the worse for it
            self._guarded(f"action {type(action).__name__}", partial(self._perform_one, action))

    def _perform_one(self, action: Action) -> None:
        match action:
            case ToVehicle():
                self._send(self.sysid, action.message, "vehicle")
            case ToPeer():
                self._send(action.peer, action.message, self.core.name(action.peer), via="ground")
            case Notice():
                if self.of and action.event in _OF_STATION:
                    self._host.of_station(action, self.sysid)
                else:
                    self.narrator.notice(action, self._now())
            case _:
                assert_never(action)

    def _send(self, receiver: int, message: Message, who: str, via: str | None = None) -> None:
        component = COMPANION_COMPID if receiver == self.sysid else 0
        self.narrator.message("out", message, who, self._now(), via)
        self._put(receiver, codec.encode(message, (receiver, component), self.sysid))

    def _put(self, receiver: int, message: Any) -> None:
        if receiver != self.sysid:
            self._host.to_peer(receiver, message, self.sysid)
            return
        # packed by MAVProxy: numbers of a second sequence on its link would look like lost frames over there
        link = self._host.links.carrier(self.sysid)
        if link is not None:  # None after `link remove`
            link.mav.send(message)

    def to_vehicle(self, message: Any) -> None:
        """Send a MAVLink message to the vehicle."""
        self._put(self.sysid, message)

    # ---- faults ---------------------------------------------------------------------------------------------------

    def _now(self) -> float:
        return self._host.now()

    def _where(self, what: str) -> str:
        return f"{self.of}: {what}" if self.of else what

    def _fault(self, where: str, text: str) -> None:
        self._host.fault(self._where(where), text)

    def _guarded(self, where: str, job: Callable[[], None]) -> None:
        """Run `job`; if it breaks, count and journal that."""
        guarded(where, job, self._fault)

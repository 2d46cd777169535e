# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover_gcs`: the MAVProxy module of a ground station.

It decides nothing: it turns the vehicle's messages, the ground link's datagrams and the operator's words into events of
`StationCore`, and the core's actions into messages and lines.

MAVProxy's own link to the vehicle carries everything. MAVProxy hands our messages over as unknown ones unless it was
started with `--dialect=handover`, with neither CRC nor signature checked, so their raw bytes are parsed here again.
"""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from MAVProxy.modules.lib import mp_module, mp_util
from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from gcs_module.banner import OLD_S, Situation
from gcs_module.callers import Callers
from gcs_module.commands import StationCommands
from gcs_module.core import (
    Action,
    AuthorityHeard,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    Notice,
    PeerHeard,
    Role,
    StationCore,
    ToPeer,
    ToVehicle,
    VehicleHeard,
)
from gcs_module.decisions import Decisions, Who
from gcs_module.means import Means
from gcs_module.narrator import StationNarrator
from gcs_module.package_desk import PackageDesk
from gcs_module.route_watch import StationRouteWatch
from gcs_module.texts import Texts
from gcs_module.uplink import UplinkChoice
from gcs_module.view import View, telemetry_line
from mavproxy_handover.clocks import Clocks
from mavproxy_handover.config.files import (
    ConfigError,
    StationConfig,
    config_argument,
    find_station_config,
    load_station,
)
from mavproxy_handover.core.messages import Message
from mavproxy_handover.core.model import LeaseState, Phase, Reason
from mavproxy_handover.core.never import assert_never
from mavproxy_handover.gate.latent import fuller
from mavproxy_handover.hosting import guarded, why
from mavproxy_handover.link.devices import Device
from mavproxy_handover.link.timesync import probe_answer
from mavproxy_handover.must_load import loaded, not_loaded
from mavproxy_handover.version import VERSION
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, OUR_MESSAGES, PROBE_COMPID
from mavproxy_handover.wire.signing import SignatureVerdict

__all__ = ["HandoverGcsModule", "init"]

_last_config: list[str] = []

#: components of the vehicle that the messages of `handover.xml` are taken from
_SPEAKERS: Final = frozenset((COMPANION_COMPID, LANGUAGE_COMPID))


class HandoverGcsModule(mp_module.MPModule):
    """The station's side of authority handover."""

    def __init__(
        self,
        mpstate: Any,
        config: StationConfig,
        means: Means,
    ) -> None:
        super().__init__(
            mpstate, "handover_gcs", "authority handover (ground station)", public=True, multi_vehicle=True
        )
        self.config = config
        self.faults: Counter[str] = Counter()
        #: the autopilot has said that it is
        self.disarmed = False
        #: the vehicle flies another mission than its package's
        self._rerouted = False
        stations = tuple(peer.station for peer in config.peers)
        self.core = StationCore(config.station, f"vehicle {config.vehicle}", stations, automatic=config.automatic)
        self.desk = PackageDesk(means.held)
        #: the aircraft against its route
        self.route = StationRouteWatch(config.route)
        self.decisions = Decisions()
        self.texts = Texts(self._shown)
        #: flight mode of the autopilot by its last heartbeat, and when that came
        self._mode, self._mode_at = "", -math.inf
        self.view = View(self.situation, config.station.name, self.console, self._speak, self._ring)
        self.narrator = StationNarrator(means.journal, self.core, self.view)
        self._ground = ground = means.ground
        self._own = mavlink.MAVLink(None, srcSystem=config.station.sysid, srcComponent=self.settings.source_component)
        self._uplink = UplinkChoice()
        self._signing = means.signing
        self._callers = Callers(config.vehicle, means.signing is not None, self._now, self._fault)
        self._each_second_at = 0.0
        self._telemetry_shown_at = 0.0
        self.commands = StationCommands(self)
        self.add_command(
            "handover", self._command, "authority handover, this station ('handover help')", self.commands.completions()
        )
        self.add_completion_function("(HANDOVERSETTING)", self.commands.settings.completion)
        if ground.listening is not None:
            mpstate.select_extra[ground.listening] = (self._readable, None)
        for link in self._links():
            mp_util.child_fd_list_add(link.fileno())  # or a map's process would keep the port after `unload`
        self.narrator.loaded(VERSION, str(config.path))
        self.view.show(
            f"handover_gcs {VERSION}: {config.station.name}, vehicle {config.vehicle}, configuration {config.path}"
        )
        if ground.peers and not ground.signed:
            self.narrator.ground_open()
        elif ground.note:
            self.narrator.replay_state(ground.note)
        self._kept_source_system = self.settings.source_system
        if self.settings.source_system != config.station.sysid:
            text = f"source_system is {self.settings.source_system}: set to {config.station.sysid}."
            self.view.line(text, Level.ADVISORY)
            self.settings.source_system = config.station.sysid
        self._see_to_links()
        if means.held is not None:
            self._handle(MissionHeld(means.held.digest))

    # ---- MAVProxy's callbacks, all wrapped ------------------------------------------------------------------------

    def idle_task(self) -> None:
        """Called by MAVProxy in every round of its main loop."""
        self._guarded("idle", self._idle)

    def mavlink_packet(self, m: Any) -> None:
        """A message from the vehicle."""
        self._guarded("message of the vehicle", lambda: self._on_packet(m))

    def _readable(self, _unused: Any) -> None:
        self._guarded("ground link", self._read_ground)

    def _command(self, args: list[str]) -> None:
        self._guarded("command", lambda: self.commands.run(args), "handover: internal fault, see the journal")

    def unload(self) -> None:
        """Give everything back: sockets, command, setting, signing."""
        self._callers.release()
        if self._signing is not None:
            self._signing.release()
        self.mpstate.select_extra.pop(self._ground.listening, None)
        for link in self._links():
            mp_util.child_fd_list_remove(link.fileno())
        self._ground.close()
        self.remove_command("handover")
        self.mpstate.completion_functions.pop("(HANDOVERSETTING)", None)
        self.mpstate.public_modules.pop("handover_gcs", None)
        self.settings.source_system = self._kept_source_system
        self.narrator.unloaded()

    def _links(self) -> list[Device]:
        return self._ground.devices

    def _guarded(self, where: str, job: Callable[[], None], line: str = "") -> None:
        """Run `job`; if it breaks, count and journal that, and show `line`."""
        guarded(where, job, self._fault, partial(self.view.show, line) if line else None)

    @staticmethod
    def _now() -> float:
        return time.monotonic()

    def _fault(self, where: str, text: str) -> None:
        self.faults[where] += 1
        if self.faults[where] <= 10:
            self.narrator.fault(where, text)

    # ---- in -------------------------------------------------------------------------------------------------------

    def _on_packet(self, m: Any) -> None:
        frame = parse_one(bytes(m.get_msgbuf()))
        if frame is None or not frame.known or frame.sysid != self.config.vehicle:
            return
        if frame.compid == AUTOPILOT_COMPID:
            self._guarded("route check", lambda: self._notice(self.route.on_autopilot(m, time.monotonic())))
        if frame.msgid in OUR_MESSAGES:
            if frame.compid in _SPEAKERS and self._proven(frame):
                self._on_ours(frame)
        elif frame.compid == COMPANION_COMPID:
            if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._handle(VehicleHeard())
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:  # of a request for control
                self.commands.on_message(m, time.monotonic())
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self.texts.on_frame(frame, time.monotonic())
        elif frame.compid == PROBE_COMPID:
            self._answer_probe(frame)
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            self._on_text(m)
        elif frame.msgid in (mavlink.MAVLINK_MSG_ID_COMMAND_ACK, mavlink.MAVLINK_MSG_ID_HEARTBEAT):
            if frame.compid == AUTOPILOT_COMPID and frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self.disarmed = not m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
                self._mode, self._mode_at = mavutil.mode_string_v10(m), time.monotonic()
            self.commands.on_message(m, time.monotonic())

    def situation(self) -> Situation:
        """What is known of the vehicle now."""
        core, now = self.core, time.monotonic()
        fresh = now - self._mode_at <= OLD_S and not self.disarmed
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
        )

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

    def _told(self, text: str) -> bool:
        """Decisions, and who commands: they come in messages of ours too, and are told from those."""
        return self.decisions.told(text) or " commands now" in text

    def _shown(self, text: str) -> bool:
        """MAVProxy's own link module has it before this one: it remembers what it wrote last."""
        return getattr(self.mpstate.status, "last_apm_msg", None) == text

    def _on_text(self, m: Any) -> None:
        """MAVProxy shows it; what the gate says of this station's sticks is told in full as well."""
        text = m.text.decode("ascii", "replace") if isinstance(m.text, bytes) else m.text
        full = fuller(text.rstrip("\0"))
        if full is not None:
            self.narrator.stream(full, time.monotonic())

    def _proven(self, frame: Frame) -> bool:
        """Whether one of our messages is the vehicle's: MAVProxy checks no signature of what it takes for unknown."""
        verdict = SignatureVerdict.OK if self._signing is None else self._signing.check(frame)
        if verdict not in (SignatureVerdict.OK, None):
            self.faults[f"message of the vehicle: signature {verdict.value}"] += 1
        return verdict is SignatureVerdict.OK

    def _see_to_links(self) -> None:
        """Links may come later."""
        self._callers.watch(self.mpstate.mav_master)
        if self._signing is not None:
            self._signing.tell(self._callers.proven)
            self._signing.sign(self.mpstate.mav_master)

    def _answer_probe(self, frame: Frame) -> None:
        """On every link: MAVProxy does not say by which one a message came, and the vehicle takes the right one."""
        answer = probe_answer(frame, int(time.monotonic() * 1e9))
        if answer is not None:
            for master in self.mpstate.mav_master:
                master.mav.send(answer)

    def _on_ours(self, frame: Frame) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        kind = message.get_type()
        if kind == "MISSION_PACKAGE_ACK":  # a vehicle sends no packages
            self._on_package(frame, message)
        elif kind == "AUTHORITY_STATUS":
            phase = Phase(message.phase) if message.phase in list(Phase) else Phase.EMERGENCY
            recovering = message.lease == LeaseState.RECOVERING
            who = message.commander or None, message.partner or None
            why = Reason(message.transfer_reason) if message.transfer_reason in list(Reason) else Reason.NONE
            ends_s = message.zone_ends - 1.0 if message.zone_ends else math.inf
            zone = message.zone or None
            left_s = message.answer_left - 1.0 if message.answer_left else math.inf
            transfer = *who, message.epoch, message.handover_id
            alone = message.lease == LeaseState.ALONE
            self._handle(AuthorityHeard(phase, *transfer, recovering, why, zone, ends_s, alone, left_s))
            self._route_changed(bool(message.route_changed))
        elif kind == "HANDOVER_TELEMETRY":
            self._on_telemetry(message)
        elif kind == "HANDOVER_DECISION":
            self._notice(self.decisions.on_message(message, self._who))
        elif kind == "HANDOVER_OVERRIDE":
            self.commands.on_message(message, time.monotonic())
        else:
            decoded = codec.decode(message)
            if decoded is not None and message.target_system in (0, self.config.station.sysid):
                self.narrator.message("in", decoded, "vehicle", time.monotonic())
                self._handle(FromVehicle(decoded))
                self._hold()

    def _on_telemetry(self, message: Any) -> None:
        now = time.monotonic()
        self.view.telemetry(message, now)
        zone = self.core.name(message.zone) if message.zone else "none"
        self.narrator.telemetry(message.lat / 1e7, message.lon / 1e7, zone)
        every_s = self.commands.settings.telemetry
        if every_s > 0 and now - self._telemetry_shown_at >= every_s:
            self._telemetry_shown_at = now
            self.view.line(telemetry_line(message, zone))
        self._guarded("route check", lambda: self._notice(self.route.on_telemetry(message, now)))

    def _notice(self, notice: Notice | None) -> None:
        if notice is not None:
            self.narrator.notice(notice, time.monotonic())

    def _on_package(self, frame: Frame, message: Any) -> None:
        now = time.monotonic()
        answers, line = self.desk.on_message(frame.sysid, frame.compid, message, now)
        for answer in answers:
            self._put(frame.sysid, answer)
        if line:
            self._tell_of(frame.sysid, "package_sent", line)

    def _hold(self) -> None:
        """An offer of another station counts once the vehicle announces it; the core is told what is held."""
        line = self.desk.inbox.announced(self.core.vehicle_digest, self.disarmed)
        if line:
            self._tell_of(self.config.vehicle, "package_received", line)
        held = self.desk.held
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

    def _read_ground(self) -> None:
        frames = self._ground.read()
        for what, count in self._ground.refused.items():
            self.faults[f"ground frame: {what}"] = count
        for frame in frames:
            if frame.sysid not in self._ground.peers:
                self.faults["ground frame of a stranger"] += 1
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._handle(PeerHeard(frame.sysid))
            elif frame.msgid in OUR_MESSAGES:
                self._on_peer(frame)

    def _on_peer(self, frame: Frame) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is None or getattr(message, "target_system", 0) not in (0, self.config.station.sysid):
            return
        if message.get_type().startswith("MISSION_"):
            self._on_package(frame, message)
            return
        decoded = codec.decode(message)
        if decoded is not None:
            name = self.core.name(frame.sysid)
            self.narrator.message("in", decoded, name, time.monotonic(), via="ground")
            self._handle(FromPeer(frame.sysid, decoded))

    # ---- time -----------------------------------------------------------------------------------------------------

    def _idle(self) -> None:
        now = time.monotonic()
        self._guarded("ground link", self._read_ground)
        self._guarded("replay state", partial(self._ground.tick, now))
        self._guarded("choice of link", lambda: self._choose_link(now))
        self._guarded("command", lambda: self.commands.tick(now))
        self._guarded("mission package", lambda: self._send_package(now))
        self._guarded("text of the vehicle", lambda: self._show_texts(now))
        if now >= self._each_second_at:
            self._each_second_at = now + 1.0
            self._guarded("links", self._see_to_links)
            self._perform(self.core.tick(now))
            self._beat()
            self._guarded("alarms", lambda: self.narrator.again(now))
            self.narrator.sum_up(now)
            self.view.status()

    def _choose_link(self, now: float) -> None:
        """MAVProxy's own fail-over takes five seconds."""
        masters = self.mpstate.mav_master
        if len(masters) < 2:
            return
        chosen = self._uplink.choose(
            [self._callers.received(master) for master in masters], self.settings.link - 1, now
        )
        if chosen != self.settings.link - 1:
            self.settings.link = chosen + 1
            self.narrator.link_chosen(masters[chosen].address)

    def _send_package(self, now: float) -> None:
        messages, lines = self.desk.tick(now, lambda receiver: self._alive(receiver, now))
        for receiver, line in lines:
            self._tell_of(receiver, "package_offer", line)
        self._hold()
        for receiver, message in messages:
            self._put(receiver, message)

    def _alive(self, receiver: int, now: float) -> bool:
        vehicle = receiver == self.config.vehicle
        return self.core.vehicle_alive(now) if vehicle else self.core.peer_alive(receiver, now)

    def _tell_of(self, sysid: int, event: str, line: str) -> None:
        who = "vehicle" if sysid == self.config.vehicle else self.core.name(sysid)
        self.narrator.package(event, line, who)

    def _beat(self) -> None:
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        for peer in self._ground.peers:
            self._ground.write(peer, codec.pack(beat, self._own))

    # ---- out ------------------------------------------------------------------------------------------------------

    def _handle(self, event: Event) -> None:
        self._perform(self.core.handle(event, time.monotonic()))

    def operator(self, event: Event) -> None:
        """An operator's word to the core."""
        self._handle(event)

    def _perform(self, actions: list[Action]) -> None:
        for action in actions:  # those behind one that breaks are none the worse for it
            self._guarded(f"action {type(action).__name__}", partial(self._perform_one, action))

    def _perform_one(self, action: Action) -> None:
        match action:
            case ToVehicle():
                self._send(self.config.vehicle, action.message, "vehicle")
            case ToPeer():
                self._send(action.peer, action.message, self.core.name(action.peer), via="ground")
            case Notice():
                self.narrator.notice(action, time.monotonic())
            case _:
                assert_never(action)

    def _send(self, receiver: int, message: Message, who: str, via: str | None = None) -> None:
        component = COMPANION_COMPID if receiver == self.config.vehicle else 0
        self.narrator.message("out", message, who, time.monotonic(), via)
        self._put(receiver, codec.encode(message, (receiver, component), self.config.vehicle))

    def _put(self, receiver: int, message: Any) -> None:
        if receiver == self.config.vehicle:
            # packed by MAVProxy: numbers of a second sequence on its link would look like lost frames over there
            if self.master is not None:  # None after `link remove`
                self.master.mav.send(message)
        elif receiver in self._ground.peers:
            self._ground.write(receiver, codec.pack(message, self._own))

    def _speak(self, text: str) -> None:
        if any(module.name == "speech" for module, _package in self.mpstate.modules):
            self.say(text)

    @staticmethod
    def _ring(bell: str) -> None:
        """In the terminal: the console's window has none."""
        sys.stdout.write(bell)
        sys.stdout.flush()

    def to_vehicle(self, message: Any) -> None:
        """Send a MAVLink message to the vehicle."""
        self._put(self.config.vehicle, message)


def init(mpstate: Any, config: Any = None, **unknown: Any) -> HandoverGcsModule | None:
    """Called by MAVProxy. Without a usable configuration it says why, and MAVProxy lives on.

    `config`: path of the configuration file (`module load handover_gcs:{"config":"FILE"}`).
    """
    means: Means | None = None
    try:
        if unknown:
            raise ConfigError(f"unknown argument {', '.join(unknown)}; allowed is: config")
        if "handover" in mpstate.command_map:
            raise ConfigError("module handover is loaded here: vehicle and station need a MAVProxy each")
        last = _last_config[-1] if _last_config else None
        settings = load_station(find_station_config(config_argument(config) or last))
        means = Means.of(settings, Clocks(time.time, time.monotonic))
        module = HandoverGcsModule(mpstate, settings, means)
    except Exception as error:  # MAVProxy would not live through it when it loads its default modules
        if means is not None:
            mpstate.select_extra.pop(means.ground.listening, None)
            means.close()
        mpstate.public_modules.pop("handover_gcs", None)
        mpstate.command_map.pop("handover", None)
        mpstate.console.writeln(f"handover_gcs is not loaded: {why(error)}")
        not_loaded(f"module handover_gcs is not loaded: {why(error)}")
        return None
    loaded()
    _last_config[:] = [str(settings.path)]
    return module

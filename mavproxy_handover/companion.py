# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion: turns frames and ticks into events, and the arbiter's actions into frames.

It decides nothing about authority. What it does decide is what to do when something breaks: whatever goes wrong inside
the arbiter ends authority for good (nobody commands, no lease is sent, so the guard brings the aircraft home); whatever
goes wrong with one frame costs that frame.

MAVProxy is not known here: `module.py` gives a function that writes to the autopilot, the messages that come from
there, and the time.
"""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover import broadcast
from mavproxy_handover.aircraft import Aircraft
from mavproxy_handover.autopilot import COPTER_MODES, Copter
from mavproxy_handover.config import VehicleConfig
from mavproxy_handover.core import events
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.facts import ZoneFact
from mavproxy_handover.core.messages import Connect, ConnectAck
from mavproxy_handover.core.model import AuthorityView, LeaseState, Phase, Reason
from mavproxy_handover.dialogue import Conversation, Dialogue
from mavproxy_handover.gate.downlink import DownlinkPolicy
from mavproxy_handover.gate.judge import Action, GateReason, Verdict, judge
from mavproxy_handover.gate.refusals import RefusalLimiter, refusal
from mavproxy_handover.gate.tables import COMPANION_COMPID, Access
from mavproxy_handover.journal import Journal
from mavproxy_handover.loading import MissionLoader
from mavproxy_handover.stations import StationPort
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.lease import GUARD_STATUS_TYPE, unpack_guard_status

__all__ = ["Companion"]

_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
#: the autopilot is asked for 20 positions a second; they come unevenly, so less than 50 ms is no reason to skip one
_ZONE_CHECK_S = 0.03
_STREAM_CHECK_S = 5.0
#: fewer than this: a ground station has asked for slower ones
_POSITIONS_A_SECOND = 10
_START = mavlink.MAV_CMD_MISSION_START
_DISPLAY_MODE = {phase: phase.name.replace("_", "") for phase in Phase}


class Companion:
    """One vehicle's companion. Times are monotonic seconds; not safe for threads."""

    def __init__(
        self,
        config: VehicleConfig,
        ports: dict[int, StationPort],
        journal: Journal,
        write_autopilot: Callable[[bytes], None],
        nonce: int,
        show: Callable[[str], None],
    ) -> None:
        self.config = config
        self.ports = ports
        self.journal = journal
        self.aircraft = Aircraft()
        self.faults: Counter[str] = Counter()
        self.guard_status: Any | None = None
        stations = tuple(entry.station for entry in config.stations)
        self.arbiter = Arbiter(Identity(config.name, stations, config.parent, nonce), config.limits)
        self.view = self.arbiter.view
        self.failed = False
        self._show = show
        self._write_autopilot = write_autopilot
        self._own = mavlink.MAVLink(None, srcSystem=config.sysid, srcComponent=COMPANION_COMPID)
        self._as_autopilot = mavlink.MAVLink(None, srcSystem=config.sysid, srcComponent=_AUTOPILOT)
        self._copter = Copter(config.sysid, lambda: self.aircraft.status_text)
        self._downlink = DownlinkPolicy(port.identity for port in ports.values())
        self._limiter = RefusalLimiter()
        self._lease = broadcast.LeaseSequence(nonce)
        self._reason = Reason.NONE
        self._dialogues: dict[str, tuple[Dialogue, Callable[[Dialogue, float], None]]] = {}
        self._loader = MissionLoader(config)
        self._start_asker: tuple[int, int, int] | None = None
        self._zones_at = 0.0
        self._streams_at = 0.0
        self._streams_asked = False
        self._positions = 0
        self._refusals_journalled: dict[tuple[int, int, GateReason], tuple[float, int]] = {}
        self._due = {
            self._send_lease: (broadcast.LEASE_INTERVAL_S, 0.0),
            self._send_authority_status: (0.5, 0.0),
            self._each_second: (1.0, 0.0),
        }

    # ---- from the stations ----------------------------------------------------------------------------------------

    def on_station(self, port: StationPort, frames: list[Frame], now: float) -> None:
        """Frames that came in on a link of `port`."""
        for frame in frames:
            try:
                self._on_frame(port, frame, now)
            except Exception:
                self.fault("frame of a station", traceback.format_exc(limit=-3))

    def _on_frame(self, port: StationPort, frame: Frame, now: float) -> None:
        verdict = judge(frame, port.identity, self.view, self.config.sysid)
        own_voice = frame.sysid == port.sysid
        if verdict.access is Access.LIVENESS and verdict.action is not Action.DROP and own_voice:
            port.component = frame.compid
            self.handle(events.StationHeard(port.sysid), now)
            verdict = judge(frame, port.identity, self.view, self.config.sysid)
        port.verdicts[verdict.reason.value] += 1
        if verdict.action is Action.FORWARD:
            self._forward(port, frame, verdict, now)
        elif verdict.action is Action.CONSUME:
            if own_voice or verdict.access is Access.COMMAND:
                self._consume(port, frame, verdict, now)
        else:
            self._refuse(port, frame, verdict, now)

    def _forward(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        self._write_autopilot(frame.raw)
        self._downlink.asked(frame, port.sysid, now)
        if verdict.access is Access.COMMAND:
            self.journal.write("accepted", station=port.name, what=verdict.what)
        elif verdict.access is Access.STREAM and verdict.what in ("RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"):
            port.steered = True

    def _consume(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        if verdict.access is Access.LIVENESS:
            return
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        if verdict.access is Access.TRANSFER:
            self._on_transfer(port, frame, message, now)
        elif verdict.access is Access.CONTROL:
            if message.get_type() != "COMMAND_ACK":
                self._answer(port, frame, message.command, mavlink.MAV_RESULT_UNSUPPORTED)
        elif message.command == _START:
            if "start" in self._dialogues:  # asked again: it is on its way
                mine = self._start_asker == (port.sysid, frame.sysid, frame.compid)
                result = mavlink.MAV_RESULT_IN_PROGRESS if mine else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
                self._answer(port, frame, _START, result)
                return
            self.journal.write("accepted", station=port.name, what=verdict.what)
            self._start_asker = (port.sysid, frame.sysid, frame.compid)
            self.handle(events.StartRequested(port.sysid), now)

    def _on_transfer(self, port: StationPort, frame: Frame, message: Any, now: float) -> None:
        port.component = frame.compid
        kind = message.get_type()
        if kind.startswith("MISSION_"):
            self._on_package(port, kind, message, now)
            return
        decoded = codec.decode(message)
        if decoded is None or getattr(message, "vehicle", 0) != self.config.sysid:
            self.journal.write("dropped", f"{kind} of {port.name} makes no sense", station=port.name)
            return
        if not isinstance(decoded, (Connect, ConnectAck)):
            self._journal_message("in", port, decoded)
        self.handle(events.StationMessage(port.sysid, decoded), now)

    def _refuse(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        key = (port.sysid, frame.msgid, verdict.reason)
        since, kept_back = self._refusals_journalled.get(key, (-1.0, 0))
        if now - since >= 1.0:
            self.journal.write(
                "refused",
                f"{verdict.what} of {port.name} refused: {verdict.reason.value}",
                station=port.name,
                what=verdict.what,
                reason=verdict.reason.value,
                answered=verdict.action is Action.REFUSE,
                also=kept_back or None,
            )
            self._refusals_journalled[key] = (now, 0)
        else:
            self._refusals_journalled[key] = (since, kept_back + 1)
        if verdict.action is Action.REFUSE and self._limiter.allow(port.sysid, frame.msgid, now):
            answer = refusal(frame, verdict, self._own)
            if answer is not None:
                port.write(answer)

    def _answer(self, port: StationPort, frame: Frame, command: int, result: int, text: str = "") -> None:
        """COMMAND_ACK in the autopilot's name, and the reason as text."""
        ack = mavlink.MAVLink_command_ack_message(command, result, 0, 0, frame.sysid, frame.compid)
        port.write(codec.pack(ack, self._as_autopilot))
        if text:
            self._say_to(port, text)

    def _say_to(self, port: StationPort, text: str) -> None:
        raw = text.encode("utf-8")
        for start in range(0, len(raw), 50):
            line = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, raw[start : start + 50])
            port.write(codec.pack(line, self._own))

    # ---- the mission package --------------------------------------------------------------------------------------

    def _on_package(self, port: StationPort, kind: str, message: Any, now: float) -> None:
        grounded = self.view.phase is Phase.ON_LOAD and not self.view.armed and "start" not in self._dialogues
        welcome = self.view.commander == port.sysid and grounded
        answers, package = self._loader.on_message(kind, message, port.target, welcome)
        for answer in answers:
            port.write(codec.pack(answer, self._own))
        if package is None:
            return
        self.journal.write("package_received", f"mission {package.name!r} from {port.name}", station=port.name)
        if self.arbiter.mission_digest:  # from the first item on, the autopilot no longer holds what it held
            self.handle(events.MissionLoaded(b"", ()), now)
        conversation = self._copter.load(package.route.upload_items(), package.route.rally)

        def done(dialogue: Dialogue, now: float) -> None:
            answer = self._loader.concluded(package, dialogue.failure, port.target)
            port.write(codec.pack(answer, self._own))
            if dialogue.failure is not None:
                self.journal.write("mission_failed", dialogue.failure, station=port.name)
                self._tell(f"mission not loaded: {dialogue.failure}")
                return
            self.journal.write("mission_written", "mission and rally points written, read back, equal")
            self.handle(events.MissionLoaded(package.digest, self._loader.commanders), now)

        self._talk("load", conversation, done, now)

    # ---- from the autopilot ---------------------------------------------------------------------------------------

    def on_autopilot(self, message: Any, now: float) -> None:
        """A message that MAVProxy received from the vehicle's side."""
        raw = bytes(message.get_msgbuf())
        frame = parse_one(raw)
        if frame is None:
            return
        if frame.sysid == self.config.sysid and frame.compid == _AUTOPILOT and frame.known:
            self._take(message, now)
        for port in self.ports.values():
            if self._downlink.wanted(frame, port.sysid, self.view, now):
                port.write(raw)

    def _take(self, message: Any, now: float) -> None:
        kind = message.get_type()
        waypoint, mode = self.aircraft.waypoint, self.aircraft.custom_mode
        self.aircraft.take(message, now)
        if getattr(message, "target_system", 0) in (0, self.config.sysid) and (
            getattr(message, "target_component", 0) in (0, COMPANION_COMPID)
        ):
            self._with_dialogues(lambda dialogue: dialogue.on_message(message, now))
        if kind == "HEARTBEAT":
            if self.aircraft.custom_mode != mode:
                self.journal.write(
                    "mode", f"mode {_mode_name(self.aircraft.custom_mode)}", mode=_mode_name(self.aircraft.custom_mode)
                )
            self.handle(events.AutopilotState(self.aircraft.armed, self.aircraft.flying), now)
        elif kind == "EXTENDED_SYS_STATE":
            self.handle(events.AutopilotState(self.aircraft.armed, self.aircraft.flying), now)
        elif kind == "GLOBAL_POSITION_INT":
            self._check_zones(now)
        elif kind == "TUNNEL" and message.payload_type == GUARD_STATUS_TYPE:
            self._on_guard(message, now)
        elif kind == "MISSION_ITEM_REACHED":
            self._on_reached(message.seq)
        elif kind == "MISSION_CURRENT" and message.seq != waypoint:
            self.journal.write("waypoint", f"flying to waypoint {message.seq}", number=message.seq)

    def zone_facts(self) -> tuple[ZoneFact, ...]:
        """Facts about every zone at the last position; none before there are mission and position."""
        finder, position = self._loader.finder, self.aircraft.position
        if finder is None or position is None:
            return ()
        where = position.lat / 1e7, position.lon / 1e7
        return finder.facts(*where, *self.aircraft.track, position.relative_alt / 1000.0)

    def _check_zones(self, now: float) -> None:
        if now - self._zones_at < _ZONE_CHECK_S or self.aircraft.position_at != now:  # that one held no position
            return
        self._zones_at = now
        self._positions += 1
        self.handle(events.PositionSeen(self.zone_facts()), now)

    def _on_guard(self, message: Any, now: float) -> None:
        status = unpack_guard_status(bytes(message.payload)[: message.payload_length])
        if status is None:
            return
        self.guard_status = status
        ours = status.nonce == self._lease.nonce
        self.handle(events.GuardSeen(status.state, ours), now)

    def _on_reached(self, number: int) -> None:
        self.journal.write("reached", f"waypoint {number} reached", number=number)
        if number == self._loader.delivery:
            self.journal.write("delivery", f"delivery point (waypoint {number}) reached", number=number)
            self._tell(f"Delivery point reached, waypoint {number}.")

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """To be called often (MAVProxy: at least 50 times a second). What fails in here stops nothing else in here."""
        self._with_dialogues(lambda dialogue: dialogue.tick(now))
        self._finish_dialogues(now)
        if self._arbiter_is_due(now):
            self.handle(events.Tick(), now)
        for job, (interval_s, due_at) in self._due.items():
            if now >= due_at:
                late_s = now - due_at
                self._due[job] = (interval_s, now + interval_s - (late_s if late_s < interval_s else 0.0))
                try:
                    job(now)
                except Exception:
                    self.fault(job.__name__.strip("_"), traceback.format_exc(limit=-3))

    def _arbiter_is_due(self, now: float) -> bool:
        if self.failed:
            return False
        try:
            deadline = self.arbiter.next_deadline()
        except Exception:
            self.fail_closed(f"arbiter failed on its deadline: {traceback.format_exc(limit=-3)}")
            return False
        return deadline is not None and now >= deadline

    def _send_lease(self, now: float) -> None:
        if not self.failed:
            self._to_autopilot(self._lease.next(self.view, self.config.sysid))

    def _send_authority_status(self, now: float) -> None:
        guard = self.arbiter.guard(now)
        self._to_stations(broadcast.authority_status(self.view, self.arbiter.zone(), guard, self._reason))

    def _each_second(self, now: float) -> None:
        beat = broadcast.heartbeat(self.view)
        self._to_autopilot(beat)
        self._to_stations(beat)
        self._to_stations(broadcast.control_status(self.view))
        self._send_telemetry(now)
        self._ask_for_streams(now)

    def _ask_for_streams(self, now: float) -> None:
        """Once, when the autopilot falls silent, and for positions alone when somebody has slowed them down."""
        slow, self._positions = self._positions < _POSITIONS_A_SECOND, 0
        if now - self.aircraft.heartbeat_at >= 3.0:
            self._streams_asked = False
        elif now >= self._streams_at and (slow or not self._streams_asked):
            all_of_them = not self._streams_asked or now - self.aircraft.position_at > 2.0
            self._streams_at, self._streams_asked = now + _STREAM_CHECK_S, True
            for request in self._copter.stream_requests()[: None if all_of_them else 1]:
                self._to_autopilot(request)

    def _send_telemetry(self, now: float) -> None:
        position = self.aircraft.position
        if position is None or now - self.aircraft.position_at > self.config.limits.position_stale_s:
            return
        zone = self.arbiter.zone()
        self.journal.write(
            "position",
            lat_deg=position.lat / 1e7,
            lon_deg=position.lon / 1e7,
            alt_m=position.relative_alt / 1000.0,
            zone=self.arbiter.name(zone) if zone else None,
            commander=self.arbiter.name(self.view.commander) if self.view.commander else None,
            waypoint=self.aircraft.waypoint,
        )
        for station in (self.view.commander, self.view.partner):
            port = self.ports.get(station or 0)
            if port is not None:
                message = self.aircraft.telemetry(port.target, int(time.time() * 1e6), zone)
                port.write(codec.pack(message, self._own))

    # ---- the arbiter ----------------------------------------------------------------------------------------------

    def handle(self, event: events.Event, now: float) -> None:
        """Give one event to the arbiter and carry out what it asks for."""
        if self.failed:
            return
        try:
            actions = self.arbiter.handle(event, now)
        except Exception:
            self.fail_closed(f"arbiter failed on {type(event).__name__}: {traceback.format_exc(limit=-3)}")
            return
        for action in actions:
            try:
                self._perform(action, now)
            except Exception:  # those behind it are none the worse for it
                self.fault(f"action {type(action).__name__}", traceback.format_exc(limit=-3))

    def fail_closed(self, text: str) -> None:
        """Nobody commands from here on, and no lease is sent: the guard brings the aircraft home."""
        self.failed = True
        self.view = AuthorityView(self.view.phase, None, None, self.view.epoch, LeaseState.LOST, self.view.armed)
        self.journal.write("failed_closed", text, reason="fault")
        self._give_start_up("internal fault")
        self._tell(f"INTERNAL FAULT, authority ends here: {text.strip().splitlines()[-1]}")

    def fault(self, where: str, text: str) -> None:
        """Something broke that costs one frame or one tick."""
        self.faults[where] += 1
        if self.faults[where] <= 10:
            self.journal.write("fault", f"{where}: {text}")

    def _perform(self, action: events.Action, now: float) -> None:
        if isinstance(action, events.Send):
            self._send(action)
        elif isinstance(action, events.ViewChanged):
            self._on_view(action, now)
        elif isinstance(action, events.Record):
            self._record(action)
        elif isinstance(action, events.Flush):
            self._flush(action.station)
        elif isinstance(action, events.Fly):
            self._bring_home(action, now)
        elif isinstance(action, events.BeginStart):
            self._begin_start(action, now)
        else:
            self._conclude_start(mavlink.MAV_RESULT_TEMPORARILY_REJECTED, "START refused: " + ", ".join(action.needs))

    def _send(self, action: events.Send) -> None:
        port = self.ports[action.station]
        if not isinstance(action.message, (Connect, ConnectAck)):
            self._journal_message("out", port, action.message, action.attempt)
        message = codec.encode(action.message, port.target, self.config.sysid, self.aircraft.state())
        port.write_all(codec.pack(message, self._own))

    def _on_view(self, action: events.ViewChanged, now: float) -> None:
        before, view = self.view, action.view
        self.view, self._reason = view, action.reason
        if view.commander != before.commander and view.commander in self.ports:
            self.ports[view.commander].steered = False
        self.journal.write(
            "view",
            phase=view.phase.name.lower(),
            commander=self.arbiter.name(view.commander) if view.commander else None,
            partner=self.arbiter.name(view.partner) if view.partner else None,
            epoch=view.epoch,
            lease=view.lease.name.lower(),
            reason=action.reason.name.lower(),
        )
        self._send_lease(now)
        self._send_authority_status(now)
        self._to_stations(broadcast.control_status(view))

    def _record(self, action: events.Record) -> None:
        self.journal.write(
            action.event,
            action.text,
            reason=action.reason.name.lower() if action.reason is not Reason.NONE else None,
            station=self.arbiter.name(action.station) if action.station else None,
            duration_s=None if action.duration_s is None else round(action.duration_s, 4),
            handover_id=self.arbiter.view.handover_id if action.event.startswith(("transfer", "step")) else None,
            epoch=self.arbiter.view.epoch if action.event in ("transfer_committed", "authority") else None,
        )
        if action.event != "step":
            self._tell(action.text[:1].upper() + action.text[1:] + ".")

    def _flush(self, station: int) -> None:
        """RC override of the former commander is released in its own name: the autopilot takes it from nobody else."""
        port = self.ports[station]
        if not port.steered:
            return
        port.steered = False
        as_station = mavlink.MAVLink(None, srcSystem=station, srcComponent=port.component)
        release = [0] * 8 + [0xFFFE] * 10  # 0 releases channels 1 to 8, UINT16_MAX - 1 the others
        message = mavlink.MAVLink_rc_channels_override_message(self.config.sysid, _AUTOPILOT, *release)
        self._write_autopilot(codec.pack(message, as_station))
        self.journal.write("flush", f"RC override of {port.name} released", station=port.name)

    # ---- conversations with the autopilot -------------------------------------------------------------------------

    def _talk(self, name: str, conversation: Conversation, done: Callable[[Dialogue, float], None], now: float) -> None:
        """Start a conversation; one of the same name that is still going on is dropped."""
        self._dialogues[name] = (Dialogue(conversation, self._to_autopilot, now), done)

    def _with_dialogues(self, step: Callable[[Dialogue], None]) -> None:
        for name, (dialogue, _done) in list(self._dialogues.items()):
            try:
                step(dialogue)
            except Exception as error:
                self.fault(f"conversation {name}", traceback.format_exc(limit=-3))
                dialogue.break_off(f"internal fault: {error}")

    def _finish_dialogues(self, now: float) -> None:
        for name, (dialogue, done) in list(self._dialogues.items()):
            if dialogue.finished and name in self._dialogues and self._dialogues[name][0] is dialogue:
                del self._dialogues[name]
                try:
                    done(dialogue, now)
                except Exception:
                    self.fault(f"end of conversation {name}", traceback.format_exc(limit=-3))

    def _begin_start(self, action: events.BeginStart, now: float) -> None:
        port = self.ports[action.station]
        self._conclude_start(mavlink.MAV_RESULT_IN_PROGRESS)

        def done(dialogue: Dialogue, now: float) -> None:
            text = dialogue.failure or ""
            self.handle(events.StartFinished(dialogue.failure is None, text), now)
            result = mavlink.MAV_RESULT_ACCEPTED if dialogue.failure is None else mavlink.MAV_RESULT_FAILED
            self._conclude_start(result, f"START failed: {text}" if text else "")

        self.journal.write("start_sequence", "GUIDED, arm, AUTO", station=port.name)
        self._talk("start", self._copter.start(), done, now)

    def _conclude_start(self, result: int, text: str = "") -> None:
        if self._start_asker is None:
            return
        station, sysid, compid = self._start_asker
        ack = mavlink.MAVLink_command_ack_message(_START, result, 0, 0, sysid, compid)
        port = self.ports[station]
        port.write(codec.pack(ack, self._as_autopilot))
        if text:
            self._say_to(port, text)
        if result != mavlink.MAV_RESULT_IN_PROGRESS:
            self._start_asker = None

    def _give_start_up(self, why: str) -> None:
        if self._dialogues.pop("start", None) is not None:
            self._conclude_start(mavlink.MAV_RESULT_FAILED, f"START failed: {why}")

    def _bring_home(self, action: events.Fly, now: float) -> None:
        self._give_start_up("the aircraft is brought home")

        def done(dialogue: Dialogue, now: float) -> None:
            text = dialogue.failure or f"the autopilot flies {dialogue.result}"
            self.journal.write("fly", text, action=action.action.name.lower(), obeyed=dialogue.failure is None)
            self._tell(text[:1].upper() + text[1:] + ".")

        self._talk("home", self._copter.bring_home(action.action), done, now)

    # ---- out ------------------------------------------------------------------------------------------------------

    def _to_autopilot(self, message: Any) -> None:
        self._write_autopilot(codec.pack(message, self._own))

    def _to_stations(self, message: Any) -> None:
        data = codec.pack(message, self._own)
        for port in self.ports.values():
            port.write(data)

    def _journal_message(self, direction: str, port: StationPort, message: Any, attempt: int | None = None) -> None:
        key = message.key
        self.journal.write(
            "message",
            direction=direction,
            name=codec.name_of(message),
            station=port.name,
            handover_id=key.handover_id,
            epoch=key.epoch,
            attempt=attempt,
            relayed=getattr(message, "relayed", False) or None,
            consent=message.consent.name.lower() if hasattr(message, "consent") else None,
        )

    def _tell(self, text: str) -> None:
        stamp = time.strftime("%H:%M:%S")
        self._show(f"[{stamp}|{self.config.name}][{_DISPLAY_MODE[self.view.phase]}]: {text}")

    def close(self) -> None:
        """Close links and journal."""
        for port in self.ports.values():
            port.close()
        self.journal.write("unloaded")
        self.journal.close()


def _mode_name(custom_mode: int) -> str:
    return COPTER_MODES.get(custom_mode, f"mode {custom_mode}")

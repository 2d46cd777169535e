# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion: turns frames and ticks into events, and the arbiter's actions into frames.

It decides nothing about authority. What it does decide is what to do when something breaks: whatever goes wrong inside
the arbiter ends authority for good (nobody commands, no lease is sent, so the guard brings the aircraft home); whatever
goes wrong with one frame costs that frame.

MAVProxy is not known here: `module.py` gives a function that writes to the autopilot, the messages that come from
there, and the time.
"""

from __future__ import annotations

import math
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover import broadcast
from mavproxy_handover.aircraft import Aircraft
from mavproxy_handover.autopilot import COPTER_MODES, Copter
from mavproxy_handover.config import VehicleConfig
from mavproxy_handover.conversations import Conversations
from mavproxy_handover.core import events
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.facts import ZoneFact
from mavproxy_handover.core.messages import Connect, ConnectAck
from mavproxy_handover.core.model import AuthorityView, LeaseState, Phase, Reason
from mavproxy_handover.core.snapshot import Snapshot
from mavproxy_handover.dialogue import Dialogue
from mavproxy_handover.gate.downlink import DownlinkPolicy
from mavproxy_handover.gate.flush import Closing, FlushTracker
from mavproxy_handover.gate.judge import Action, Verdict, judge
from mavproxy_handover.gate.refusals import RefusalLimiter, refusal
from mavproxy_handover.gate.tables import COMPANION_COMPID, Access
from mavproxy_handover.journal import Journal
from mavproxy_handover.keys import load_key
from mavproxy_handover.link.quality import LinkEvent
from mavproxy_handover.loading import MissionLoader
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator_control import notification, read_request
from mavproxy_handover.preflight import Finding, Preflight
from mavproxy_handover.state_store import StateStore, recall
from mavproxy_handover.stations import StationPort
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.lease import GUARD_STATUS_TYPE, unpack_guard_status

__all__ = ["Companion"]

_AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
#: the autopilot is asked for 20 positions a second; they come unevenly, so less than 50 ms is no reason to skip one
_ZONE_CHECK_S = 0.03
_STREAM_CHECK_S = 5.0
_CLOCK_STEP_S = 1.0
#: a heartbeat this old still says that its station lives
_HEARTBEAT_FRESH_S = 2.0
_ON_BOARD_RETRY_S = 10.0
#: fewer than this: a ground station has asked for slower ones
_POSITIONS_A_SECOND = 10
_START = mavlink.MAV_CMD_MISSION_START
_CONTROL = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL
#: what changes the mission at the autopilot behind the companion's back
_MISSION_WRITES = ("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST", "FILE_TRANSFER_PROTOCOL/")
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
        store: StateStore | None = None,
        on_board: MissionPackage | None = None,
    ) -> None:
        """`store`: where authority is kept over a restart; without one a restart in flight means nobody commands.
        `on_board`: a mission package that need not come from the parent."""
        self.config = config
        self.ports = ports
        self.journal = journal
        self.aircraft = Aircraft()
        self.faults: Counter[str] = Counter()
        self.guard_status: Any | None = None
        stations = tuple(entry.station for entry in config.stations)
        self._store = store
        restored, trouble = recall(store)
        self.arbiter = Arbiter(Identity(config.name, stations, config.parent, nonce), config.limits, restored)
        self.view = self.arbiter.view
        #: what the state file says; None if it is not known to say anything
        self._saved: Snapshot | None = restored or self.arbiter.snapshot()
        self.failed = False
        #: the arbiter's next deadline; it moves with events only
        self._deadline: float | None = None
        self._deadline_known = False
        self._show = show
        self._write_autopilot = write_autopilot
        self._own = mavlink.MAVLink(None, srcSystem=config.sysid, srcComponent=COMPANION_COMPID)
        self._as_autopilot = mavlink.MAVLink(None, srcSystem=config.sysid, srcComponent=_AUTOPILOT)
        self._copter = Copter(config.sysid, lambda: self.aircraft.status_text)
        self._downlink = DownlinkPolicy(port.identity for port in ports.values())
        self._flusher = FlushTracker(config.sysid)
        self._limiter = RefusalLimiter()
        self._rate_answers = RefusalLimiter(per_second=20)
        guard_key = None if config.guard_key is None else load_key(config.guard_key)
        self._lease = broadcast.LeaseSequence(nonce, guard_key)
        self._reason = Reason.NONE
        self._conversations = Conversations(self._to_autopilot, self.fault)
        self.preflight = Preflight(config.sysid, config.limits, self._conversations, self._on_preflight)
        self._loader = MissionLoader(config)
        self._on_board = on_board
        self._on_board_at = 0.0
        self._start_asker: tuple[int, int, int] | None = None
        #: system, component that asked for control last, and the component that was asked
        self._control_asker = (0, 0, 0)
        #: (station, transfer) of the question that the owner was asked last, and of the one that it has acknowledged
        self._question: tuple[int, int] | None = None
        self._acknowledged: tuple[int, int] | None = None
        self._second_manager_told = False
        self._clock_offset_s: float | None = None
        self._zones_at = 0.0
        self._streams_at = 0.0
        self._streams_asked = False
        self._positions = 0
        self._refusals_journalled: dict[tuple[int, int, Enum], tuple[float, int]] = {}
        self._due = {
            self._send_lease: (broadcast.LEASE_INTERVAL_S, 0.0),
            self._send_authority_status: (0.5, 0.0),
            self._each_second: (1.0, 0.0),
        }
        self._resume(restored, trouble)

    def _resume(self, restored: Snapshot | None, trouble: str) -> None:
        """Go on where the run before this one ended, or say that this cannot be done."""
        if trouble:
            self.journal.write("state_lost", trouble, reason="fault")
            self._tell(f"State file: {trouble}: nobody commands.")
        if restored is None or self._store is None:
            return
        self._save()  # the epoch has risen: if this run ends soon, the next one must begin above it
        if restored.phase is Phase.ON_LOAD:
            return
        name = self.arbiter.name(restored.owner)
        self.journal.write("restarted", f"restarted in flight; {name} had authority", epoch=self.view.epoch)
        self._tell(f"Restarted in flight, epoch {self.view.epoch}: waiting for {name}.")
        package = self._store.load_package(restored.digest) if restored.digest else None
        if package is not None:
            self._loader.adopt(package)
        elif restored.digest:
            self.journal.write("state_lost", "the mission package of the run before is gone: no zones", reason="fault")

    def _save(self) -> None:
        """Before anybody hears of it: what is told must outlive a crash. If it cannot be written, the old file must go:
        after a restart it would give authority to whoever had it then. It is tried again each second."""
        snapshot = self.arbiter.snapshot()
        if self._store is None or snapshot == self._saved:
            return
        try:
            self._store.save(snapshot)
            self._saved = snapshot
        except OSError as error:
            self._saved = None
            self.fault("state file", str(error))
            with suppress(OSError):
                self._store.clear()

    # ---- from the stations ----------------------------------------------------------------------------------------

    def on_station(self, port: StationPort, frames: list[Frame], now: float) -> None:
        """Frames that came in on a link of `port`; those that were rejected there are journalled."""
        while port.rejected:
            frame, signature = port.rejected.popleft()
            what = mavlink.mavlink_map[frame.msgid].msgname if frame.known else f"message {frame.msgid}"
            self._journal_refusal(port, (port.sysid, frame.msgid, signature), what, signature.value, False, now)
        if self._arbiter_is_due(now):  # after a stall: nothing is judged by authority that has run out
            self.handle(events.Tick(), now)
        for frame in frames:
            try:
                self._on_frame(port, frame, now)
            except Exception:
                self.fault("frame of a station", traceback.format_exc(limit=-3))

    def on_links(self, port: StationPort, changes: list[LinkEvent], now: float) -> None:
        """What the measuring of a station's links has brought to light."""
        for change in changes:
            self.journal.write(
                "link",
                change.text,
                station=port.name,
                link=change.device,
                change=change.kind.value,
                measure=None if change.measure is None else change.measure.value,
                value=None if change.value is None else round(change.value, 3),
            )
            self.handle(events.LinkJudged(port.sysid, port.weak, port.attacked, change.text), now)

    def _on_frame(self, port: StationPort, frame: Frame, now: float) -> None:
        verdict = judge(frame, port.identity, self.view, self.config.sysid)
        own_voice = frame.sysid == port.sysid
        if verdict.access is Access.LIVENESS and verdict.action is not Action.DROP and own_voice:
            port.component = frame.compid
            port.heartbeat, port.heartbeat_at = frame.raw, now
            self.handle(events.StationHeard(port.sysid), now)
            verdict = judge(frame, port.identity, self.view, self.config.sysid)
        port.verdicts[verdict.reason.value] += 1
        self._downlink.rates.heard(port.sysid, now)
        if verdict.action is Action.FORWARD:
            self._forward(port, frame, verdict, now)
        elif verdict.action is Action.CONSUME:
            if own_voice or verdict.access in (Access.COMMAND, Access.ANSWERED):
                self._consume(port, frame, verdict, now)
        else:
            self._refuse(port, frame, verdict, now)

    def _forward(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        self._write_autopilot(frame.raw)
        self._downlink.asked(frame, port.sysid, now)
        self._flusher.saw(frame, verdict, port.sysid)
        if verdict.access in (Access.COMMAND, Access.SAFEGUARD):
            self.journal.write("accepted", station=port.name, what=verdict.what)
            rewrites = verdict.what.startswith(_MISSION_WRITES)
            if rewrites and self.view.phase is Phase.ON_LOAD and self.arbiter.mission_digest:
                self.handle(events.MissionLoaded(b"", ()), now)

    def _consume(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        if verdict.access is Access.LIVENESS:
            return
        if verdict.access is Access.ANSWERED:
            self._on_rates(port, frame, now)
            return
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        if verdict.access is Access.TRANSFER:
            self._on_transfer(port, frame, message, now)
        elif verdict.access is Access.CONTROL:
            self._on_control(port, frame, message, now)
        elif message.command == _START:
            if "start" in self._conversations:  # asked again: it is on its way
                mine = self._start_asker == (port.sysid, frame.sysid, frame.compid)
                result = mavlink.MAV_RESULT_IN_PROGRESS if mine else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
                self._answer(port, frame, _START, result)
                return
            self.journal.write("accepted", station=port.name, what=verdict.what)
            self._start_asker = (port.sysid, frame.sysid, frame.compid)
            self.handle(events.StartRequested(port.sysid), now)

    def _on_control(self, port: StationPort, frame: Frame, message: Any, now: float) -> None:
        if message.get_type() == "COMMAND_ACK":  # the owner has heard that somebody asks
            if self._question == (port.sysid, self.view.handover_id):
                self._acknowledged = self._question
            return
        port.component = port.component or frame.compid
        request = read_request(message, port.sysid)
        self._control_asker = (frame.sysid, frame.compid, message.target_component)
        if isinstance(request, str):
            self.journal.write("control", f"request of {port.name} not understood: {request}", station=port.name)
            self._answer_control(port, mavlink.MAV_RESULT_DENIED, request)
            return
        self.handle(request, now)

    def _answer_control(self, port: StationPort, result: int, text: str) -> None:
        """COMMAND_ACK of the component that was asked; the companion where nobody was named."""
        sysid, compid, component = self._control_asker
        ack = mavlink.MAVLink_command_ack_message(_CONTROL, result, 0, 0, sysid, compid)
        port.write(codec.pack(ack, self._as_autopilot if component == _AUTOPILOT else self._own))
        if text:
            self._say_to(port, f"Control denied: {text}")

    def _notify_owner(self, action: events.NotifyOwner) -> None:
        question = (action.station, self.view.handover_id)
        if question == self._acknowledged:
            return
        again, self._question = question == self._question, question
        port = self.ports[action.station]
        name = self.arbiter.name(action.requester)
        port.send(notification(port.target, action.requester, action.timeout_s), everywhere=True)
        if not again:
            self.journal.write("notified", f"{port.name} is asked: may {name} have control?", station=port.name)

    def _on_rates(self, port: StationPort, frame: Frame, now: float) -> None:
        """What an observer wants to hear is the companion's to give: the autopilot is not asked for more."""
        answers = self._downlink.rates.asked(frame, port.sysid, now)
        if answers and self._rate_answers.allow(port.sysid, "rates", now):
            for answer in answers:
                port.write(codec.pack(answer, self._as_autopilot))

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
        answered = verdict.action is Action.REFUSE
        self._journal_refusal(port, key, verdict.what, verdict.reason.value, answered, now)
        if verdict.action is Action.REFUSE and self._limiter.allow(port.sysid, frame.msgid, now):
            for answer in refusal(frame, verdict, self._own):
                port.write(answer)

    def _journal_refusal(
        self, port: StationPort, key: tuple[int, int, Enum], what: str, reason: str, answered: bool, now: float
    ) -> None:
        """One entry a second for each station, message and reason; the next one says how many were left out."""
        since, kept_back = self._refusals_journalled.get(key, (-1.0, 0))
        if now - since < 1.0:
            self._refusals_journalled[key] = (since, kept_back + 1)
            return
        self._refusals_journalled[key] = (now, 0)
        text = f"{what} of {port.name} refused: {reason}"
        also = kept_back or None
        self.journal.write("refused", text, station=port.name, what=what, reason=reason, answered=answered, also=also)

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
            port.send(line)

    # ---- the mission package --------------------------------------------------------------------------------------

    def _on_package(self, port: StationPort, kind: str, message: Any, now: float) -> None:
        grounded = self.view.phase is Phase.ON_LOAD and not self.view.armed and "start" not in self._conversations
        welcome = self.view.commander == port.sysid and grounded
        answers, package = self._loader.on_message(kind, message, port.target, welcome)
        for answer in answers:
            port.send(answer)
        if package is None:
            return
        self.journal.write("package_received", f"mission {package.name!r} from {port.name}", station=port.name)
        self._load(package, port, now)

    def _load(self, package: MissionPackage, port: StationPort | None, now: float) -> None:
        """Write a package to the autopilot and read it back; `port`: who sent it, None for the one on board."""
        if self.arbiter.mission_digest:  # from the first item on, the autopilot no longer holds what it held
            self.handle(events.MissionLoaded(b"", ()), now)
        source = "on board" if port is None else port.name

        def done(dialogue: Dialogue, now: float) -> None:
            if port is not None:
                answer = self._loader.concluded(package, dialogue.failure, port.target)
                port.send(answer)
            elif dialogue.failure is None:
                self._loader.adopt(package)
            if dialogue.failure is not None:
                self.journal.write("mission_failed", dialogue.failure, station=source)
                self._tell(f"mission not loaded: {dialogue.failure}")
                return
            self.journal.write("mission_written", "mission and rally points written, read back, equal")
            self._keep(package)
            loader = self._loader
            self.handle(events.MissionLoaded(package.digest, loader.commanders, loader.out_of_coverage), now)

        conversation = self._copter.load(package.route.upload_items(), package.route.rally)
        self._conversations.begin("load", conversation, done, now)

    def _load_on_board(self, now: float) -> None:
        """The package on board, once the autopilot is there and on the ground; again after a while if that failed."""
        package = self._on_board
        wanted = package is not None and not self.arbiter.mission_digest and "load" not in self._conversations
        grounded = self.view.phase is Phase.ON_LOAD and not self.view.armed and self.aircraft.position is not None
        if package is not None and wanted and grounded and now >= self._on_board_at:
            self._on_board_at = now + _ON_BOARD_RETRY_S
            self._load(package, None, now)

    def _keep(self, package: MissionPackage) -> None:
        if self._store is None:
            return
        try:
            self._store.save_package(package)
        except OSError as error:
            self.fault("state file", str(error))

    # ---- from the autopilot ---------------------------------------------------------------------------------------

    def on_autopilot(self, message: Any, now: float) -> None:
        """A message that MAVProxy received from the vehicle's side."""
        raw = bytes(message.get_msgbuf())
        frame = parse_one(raw)
        if frame is None:
            return
        if frame.sysid == self.config.sysid and frame.known and frame.msgid == mavlink.MAVLINK_MSG_ID_CONTROL_STATUS:
            self._on_second_manager(frame)
            return
        if frame.sysid == self.config.sysid and frame.compid == _AUTOPILOT and frame.known:
            self._flusher.heard(frame)
            self._take(message, now)
        for port in self.ports.values():
            if self._downlink.wanted(frame, port.sysid, self.view, now):
                port.write(raw)

    def _on_second_manager(self, frame: Frame) -> None:
        """Somebody else on board says who is in control. The stations must hear one voice: it goes no further."""
        manager = bool(frame.payload[0] & mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER)
        if manager and not self._second_manager_told:
            self._second_manager_told = True
            text = f"component {frame.compid} claims to be the system manager too: switch its operator control off"
            self.journal.write("second_manager", text)
            self._tell(text[:1].upper() + text[1:] + ".")

    def _take(self, message: Any, now: float) -> None:
        kind = message.get_type()
        waypoint, mode = self.aircraft.waypoint, self.aircraft.custom_mode
        self.aircraft.take(message, now)
        if getattr(message, "target_system", 0) in (0, self.config.sysid) and (
            getattr(message, "target_component", 0) in (0, COMPANION_COMPID)
        ):
            self._conversations.on_message(message, now)
        if kind == "HEARTBEAT":
            if self.aircraft.custom_mode != mode:
                self.journal.write(
                    "mode", f"mode {_mode_name(self.aircraft.custom_mode)}", mode=_mode_name(self.aircraft.custom_mode)
                )
            self.handle(events.AutopilotState(self.aircraft.armed, self.aircraft.flying), now)
        elif kind == "EXTENDED_SYS_STATE" and self.aircraft.heartbeat_at > -math.inf:
            # before the first heartbeat nothing is known of arming: in flight it would read as disarmed
            self.handle(events.AutopilotState(self.aircraft.armed, self.aircraft.flying), now)
        elif kind == "GLOBAL_POSITION_INT":
            self._check_zones(now)
        elif kind == "TUNNEL" and message.payload_type == GUARD_STATUS_TYPE:
            self._on_guard(message, now)
        elif kind == "STATUSTEXT":
            self.preflight.text(message.text)
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
        self._conversations.tick(now)
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
        if not self._deadline_known:
            try:
                self._deadline = self.arbiter.next_deadline()
            except Exception:
                self.fail_closed(f"arbiter failed on its deadline: {traceback.format_exc(limit=-3)}")
                return False
            self._deadline_known = True
        return self._deadline is not None and now >= self._deadline

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
        self._watch_the_clock(now)
        self._load_on_board(now)
        self._save()
        grounded = self.view.phase is Phase.ON_LOAD and not self.aircraft.armed and "start" not in self._conversations
        firmware = None if self.guard_status is None else self.guard_status.firmware
        self.preflight.each_second(self.aircraft.heartbeat_at, grounded, self.arbiter.guard(now), firmware, now)

    def _on_preflight(self, finding: Finding, fits: bool) -> None:
        self.journal.write("preflight", finding.text, parameter=finding.parameter or None, fits=fits)
        self._tell(f"Preflight: {finding.text}." if fits else f"Preflight WARNING: {finding.text}.")

    def _watch_the_clock(self, now: float) -> None:
        """Nothing here goes by the wall clock; who reads the journal must know that it was set."""
        offset_s = time.time() - now
        if self._clock_offset_s is not None and abs(offset_s - self._clock_offset_s) > _CLOCK_STEP_S:
            step_s = offset_s - self._clock_offset_s
            self.journal.write("clock_step", f"the clock was set by {step_s:+.1f} s", step_s=round(step_s, 3))
        self._clock_offset_s = offset_s

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
                port.send(message)

    # ---- the arbiter ----------------------------------------------------------------------------------------------

    def handle(self, event: events.Event, now: float) -> None:
        """Give one event to the arbiter and carry out what it asks for."""
        if self.failed:
            return
        self._deadline_known = False
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
        if self.aircraft.flying:
            self._bring_home(events.Fly(events.FlightAction.RETURN, Reason.FAULT), time.monotonic())
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
            pass  # done before the view went out
        elif isinstance(action, events.Fly):
            self._bring_home(action, now)
        elif isinstance(action, events.BeginStart):
            self._begin_start(action, now)
        elif isinstance(action, events.ControlAnswer):
            self._answer_control(self.ports[action.station], action.result, action.text)
        elif isinstance(action, events.NotifyOwner):
            self._notify_owner(action)
        else:
            self._conclude_start(mavlink.MAV_RESULT_TEMPORARILY_REJECTED, "START refused: " + ", ".join(action.needs))

    def _send(self, action: events.Send) -> None:
        port = self.ports[action.station]
        if not isinstance(action.message, (Connect, ConnectAck)):
            self._journal_message("out", port, action.message, action.attempt)
        message = codec.encode(action.message, port.target, self.config.sysid, self.aircraft.state())
        port.send(message, everywhere=True)

    def _on_view(self, action: events.ViewChanged, now: float) -> None:
        self._save()
        before, view = self.view, action.view
        self.view, self._reason = view, action.reason
        # Before the lease: the autopilot takes sticks from nobody but its commander, whom the lease names.
        if before.commander is not None and view.commander != before.commander:
            self._flush(before.commander, self._flusher.flush(before.commander))
        successor = None if view.commander == before.commander else self.ports.get(view.commander or 0)
        if successor is not None and now - successor.heartbeat_at < _HEARTBEAT_FRESH_S:
            self._write_autopilot(successor.heartbeat)  # the autopilot watches this station from now on
        if view.armed and not before.armed and view.commander is not None:
            self._flush(view.commander, self._flusher.parameters())
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

    def _flush(self, station: int, closings: list[Closing]) -> None:
        """What `station` has open at the autopilot is closed, in its own name."""
        for closing in closings:
            for raw in closing.frames:
                self._write_autopilot(raw)
            name = self.arbiter.name(station)
            self.journal.write("flush", f"{closing.what} ({name})", station=name, incomplete=closing.incomplete or None)

    # ---- conversations with the autopilot -------------------------------------------------------------------------

    def _begin_start(self, action: events.BeginStart, now: float) -> None:
        port = self.ports[action.station]
        self._conclude_start(mavlink.MAV_RESULT_IN_PROGRESS)

        def done(dialogue: Dialogue, now: float) -> None:
            text = dialogue.failure or ""
            self.handle(events.StartFinished(dialogue.failure is None, text), now)
            result = mavlink.MAV_RESULT_ACCEPTED if dialogue.failure is None else mavlink.MAV_RESULT_FAILED
            self._conclude_start(result, f"START failed: {text}" if text else "")

        self.journal.write("start_sequence", "GUIDED, arm, AUTO", station=port.name)
        self._conversations.begin("start", self._copter.start(), done, now)

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
        if self._conversations.drop("start"):
            self._conclude_start(mavlink.MAV_RESULT_FAILED, f"START failed: {why}")

    def _bring_home(self, action: events.Fly, now: float) -> None:
        self._give_start_up("the aircraft is brought home")

        def done(dialogue: Dialogue, now: float) -> None:
            text = dialogue.failure or f"the autopilot flies {dialogue.result}"
            self.journal.write("fly", text, action=action.action.name.lower(), obeyed=dialogue.failure is None)
            self._tell(text[:1].upper() + text[1:] + ".")

        self._conversations.begin("home", self._copter.bring_home(action.action), done, now)

    # ---- out ------------------------------------------------------------------------------------------------------

    def _to_autopilot(self, message: Any) -> None:
        self._write_autopilot(codec.pack(message, self._own))

    def _to_stations(self, message: Any) -> None:
        for port in self.ports.values():
            port.send(message)

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

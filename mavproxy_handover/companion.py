# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion: turns frames and ticks into events, and the arbiter's actions into frames.

It decides nothing about authority. What it does decide is what to do when something breaks: whatever goes wrong inside
the arbiter ends authority for good (nobody commands, no lease is sent, so the guard brings the aircraft home); whatever
goes wrong with one frame costs that frame.

MAVProxy is not known here: `module.py` gives a function that writes to the autopilot, the messages that come from
there, and the time.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable
from math import inf
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.aircraft import Aircraft
from mavproxy_handover.autopilot.changeover import Changeover
from mavproxy_handover.autopilot.copter import Copter
from mavproxy_handover.autopilot.loading import MissionLoader, MissionWriter
from mavproxy_handover.autopilot.orders import FlightOrders
from mavproxy_handover.autopilot.preflight import Preflight
from mavproxy_handover.autopilot.streams import Streams
from mavproxy_handover.autopilot.telemetry import Telemetry
from mavproxy_handover.autopilot.watch import AutopilotWatch
from mavproxy_handover.config.files import VehicleConfig
from mavproxy_handover.core import events
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.messages import Connect, ConnectAck
from mavproxy_handover.core.model import AuthorityView, FlightAction, LeaseState, Phase, Reason
from mavproxy_handover.gate.downlink import DownlinkPolicy
from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.judge import Action, Verdict, judge
from mavproxy_handover.gate.observers import ObserverRates
from mavproxy_handover.gate.policy.rows import classify
from mavproxy_handover.gate.policy.tables import Access
from mavproxy_handover.gate.questions import Questions
from mavproxy_handover.gate.refusals import RefusalLimiter, refusal
from mavproxy_handover.link.quality import LinkEvent
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.restart import Memory
from mavproxy_handover.schedule import Schedule
from mavproxy_handover.stations.operator_control import OperatorControl
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.stations.voice import Voice
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.keys import load_key
from mavproxy_handover.store.state import StateStore, recall
from mavproxy_handover.wire import codec, status
from mavproxy_handover.wire.conversation import Conversations
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["Companion"]

#: accepted commands are in the journal this much later at most, as long as the main loop goes round
JOURNAL_S = 0.2
_START = mavlink.MAV_CMD_MISSION_START
_CONTROL_STATUS = mavlink.MAVLINK_MSG_ID_CONTROL_STATUS
#: messages whose CRC pymavlink has checked, and by our own definitions, unless it is told not to (MAV_IGNORE_CRC)
_CHECKED = frozenset(() if getattr(mavlink, "MAVLINK_IGNORE_CRC", False) else mavlink.mavlink_map.values())
_CHANGES = frozenset((Access.COMMAND, Access.SAFEGUARD))
#: of the commander's frames, what may come often and is noted with the next tick (see `_note_passed`)
_FREQUENT = frozenset((Access.READ, Access.STREAM))
#: frames that wait to be noted, at most
_UNNOTED = 512
#: no time: the arbiter is to be asked
_UNKNOWN = -inf
#: what changes the mission at the autopilot behind the companion's back
_MISSION_WRITES = ("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST", "FILE_TRANSFER_PROTOCOL/")


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
        stations = tuple(entry.station for entry in config.stations)
        restored, trouble = recall(store)
        self.arbiter = Arbiter(Identity(config.name, stations, config.parent, nonce), config.limits, restored)
        self.view = self.arbiter.view
        self.failed = False
        #: the arbiter's next deadline, inf if it has none; it moves with events only
        self._due_at = _UNKNOWN
        self._write_autopilot = write_autopilot
        self._voice = Voice(config.sysid, write_autopilot, ports)
        narrator = self._narrator = Narrator(config.name, journal, self.arbiter, show, lambda: self.view.phase)
        self._memory = Memory(store, restored or self.arbiter.snapshot(), self.fault)
        self._downlink = DownlinkPolicy((port.identity for port in ports.values()), ObserverRates(config.observers))
        self._flusher = FlushTracker(config.sysid)
        self._questions = Questions(self._flusher)
        self._limiter = RefusalLimiter()
        self._rate_answers = RefusalLimiter(per_second=20)
        #: frames that went to the autopilot and are not noted yet
        self._passed: list[tuple[StationPort, Frame, Verdict, float]] = []
        guard_key = None if config.guard_key is None else load_key(config.guard_key)
        self._lease = status.LeaseSequence(nonce, guard_key)
        self._reason = Reason.NONE
        talks = self._conversations = Conversations(self._voice.to_autopilot, self.fault)
        self.preflight = Preflight(config.sysid, config.limits, talks, narrator.preflight)
        copter = Copter(config.sysid, lambda: self.aircraft.status_text)
        self._streams = Streams(copter, self._voice.to_autopilot)
        self._changeover = Changeover(self._flusher, write_autopilot, ports, self._streams, narrator)
        self._orders = FlightOrders(copter, talks, self._voice, narrator, self.handle)
        self._control = OperatorControl(self._voice, journal, self.handle)
        self._telemetry = Telemetry(self.aircraft, self.arbiter, ports, narrator, config.limits.position_stale_s)
        loader = MissionLoader(config)
        self._missions = MissionWriter(
            loader, copter, talks, narrator, self._memory, self.arbiter, self.handle, on_board
        )
        self.autopilot = AutopilotWatch(
            config.sysid, nonce, self.aircraft, loader, talks, self.preflight, self._streams, narrator, self.handle
        )
        #: station, system and component that asked for START last
        self._start_asker = (0, 0, 0)
        jobs = [
            ("send_lease", self._send_lease, status.LEASE_INTERVAL_S),
            ("send_authority_status", self._send_authority_status, 0.5),
            ("each_second", self._each_second, 1.0),
            ("journal", lambda _now: journal.flush(), JOURNAL_S),
        ]
        self._schedule = Schedule(jobs, self.fault)
        package = self._memory.resume(restored, trouble, self.arbiter, narrator)
        if package is not None:
            loader.adopt(package)

    # ---- from the stations ----------------------------------------------------------------------------------------

    def on_station(self, port: StationPort, frames: list[Frame], now: float) -> None:
        """Frames that came in on a link of `port`; those that were rejected there are journalled."""
        while port.rejected:
            frame, signature = port.rejected.popleft()
            what = classify(frame).what  # words for people, of somebody who is not known to be the station
            self._narrator.refused(port, (port.sysid, frame.msgid, signature), what, signature.value, False, now)
        # after a stall: nothing is judged by authority that has run out. Nearly always the first comparison is all
        if now >= self._due_at and self._arbiter_is_due(now):
            if self.position_waits:  # a position that came before counts before, too
                self.check_zones(now)
            self.handle(events.Tick(), now)
        for frame in frames:
            try:
                self._on_frame(port, frame, now)
            except Exception:
                self.fault("frame of a station", traceback.format_exc(limit=-3))

    def on_links(self, port: StationPort, changes: list[LinkEvent], now: float) -> None:
        """What the measuring of a station's links has brought to light."""
        for change in changes:
            self._narrator.link(port, change)
            self.handle(events.LinkJudged(port.sysid, port.weak, port.attacked, change.text), now)

    def _on_frame(self, port: StationPort, frame: Frame, now: float) -> None:
        verdict = judge(frame, port.identity, self.view, self.config.sysid)
        own_voice = frame.sysid == port.sysid
        if verdict.access is Access.LIVENESS and verdict.action is not Action.DROP and own_voice:
            port.component = frame.compid
            port.heartbeat, port.heartbeat_at = frame.raw, now
            self.handle(events.StationHeard(port.sysid), now)
            verdict = judge(frame, port.identity, self.view, self.config.sysid)
        commands = port.sysid == self.view.commander
        if not commands:
            self._note_passed()
            verdict = self._questions.limit(frame, verdict, port.sysid, self.view.commander, now)
            self._downlink.rates.heard(port.sysid, now)
        if verdict.action is Action.FORWARD:  # and the rest behind it: nothing delays a frame that may pass
            self._write_autopilot(frame.raw)
            self._passed.append((port, frame, verdict, now))
            if not commands or verdict.access not in _FREQUENT or len(self._passed) >= _UNNOTED:
                self._forwarded(port, verdict, now)
            return
        port.verdicts[verdict.reason] += 1
        if verdict.action is Action.CONSUME:
            if own_voice or verdict.access in (Access.COMMAND, Access.ANSWERED):
                self._consume(port, frame, verdict, now)
        else:
            self._refuse(port, frame, verdict, now)

    def _note_passed(self) -> None:
        """Note what the frames mean that went to the autopilot: what they ask, and what they leave open there.

        Before the arbiter hears of anything, before another station's frames, and with every tick; what opens something
        that an answer of the autopilot may close is noted at once. Several together cost much less than each by itself
        (see `journal`), and none of them waits for it.
        """
        if not self._passed:
            return
        passed, self._passed = self._passed, []
        for port, frame, verdict, at in passed:
            try:
                port.verdicts[verdict.reason] += 1
                if port.sysid == self.view.commander:
                    self._questions.commander_sent(frame, at)
                self._downlink.asked(frame, port.sysid, at)
                self._flusher.saw(frame, verdict, port.sysid)
            except Exception:
                self.fault("frame that passed", traceback.format_exc(limit=-3))

    def _forwarded(self, port: StationPort, verdict: Verdict, now: float) -> None:
        self._note_passed()
        if verdict.access in _CHANGES:
            self.journal.note("accepted", station=port.name, what=verdict.what)
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
            self._control.take(port, frame, message, self.view.handover_id, now)
        elif message.command == _START:
            if "start" in self._conversations:  # asked again: it is on its way
                mine = self._start_asker == (port.sysid, frame.sysid, frame.compid)
                result = mavlink.MAV_RESULT_IN_PROGRESS if mine else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
                self._voice.acknowledge(port, (frame.sysid, frame.compid), _START, result)
                return
            self.journal.write("accepted", station=port.name, what=verdict.what)
            self._start_asker = (port.sysid, frame.sysid, frame.compid)
            self.handle(events.StartRequested(port.sysid), now)

    def _on_rates(self, port: StationPort, frame: Frame, now: float) -> None:
        """What an observer wants to hear is the companion's to give: the autopilot is not asked for more."""
        answers = self._downlink.rates.asked(frame, port.sysid, now)
        if answers and self._rate_answers.allow(port.sysid, "rates", now):
            for answer in answers:
                self._voice.answer(port, answer)

    def _on_transfer(self, port: StationPort, frame: Frame, message: Any, now: float) -> None:
        port.component = frame.compid
        kind = message.get_type()
        if kind.startswith("MISSION_"):
            grounded = self.view.phase is Phase.ON_LOAD and not self.view.armed and "start" not in self._conversations
            self._missions.on_message(port, message, self.view.commander == port.sysid and grounded, now)
            return
        decoded = codec.decode(message)
        if decoded is None or getattr(message, "vehicle", 0) != self.config.sysid:
            self.journal.write("dropped", f"{kind} of {port.name} makes no sense", station=port.name)
            return
        if not isinstance(decoded, (Connect, ConnectAck)):
            self._narrator.message("in", port, decoded)
        self.handle(events.StationMessage(port.sysid, decoded), now)

    def _refuse(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        key = (port.sysid, frame.msgid, verdict.reason)
        answered = verdict.action is Action.REFUSE
        self._narrator.refused(port, key, verdict.what, verdict.reason.value, answered, now)
        if verdict.action is Action.REFUSE and self._limiter.allow(port.sysid, frame.msgid, now):
            for answer in refusal(frame, verdict, self._voice.own):
                port.write(answer)

    # ---- from the autopilot ---------------------------------------------------------------------------------------

    def on_autopilot(self, message: Any, now: float) -> None:
        """A message that MAVProxy received from the vehicle's side."""
        frame = parse_one(message.get_msgbuf(), proven=type(message) in _CHECKED)
        if frame is None:
            return
        if frame.sysid == self.config.sysid and frame.known:
            if frame.msgid == _CONTROL_STATUS:
                self.autopilot.second_manager(frame)
                return
            if frame.compid == AUTOPILOT_COMPID:
                self._flusher.heard(frame)
                self.autopilot.take(message, now)
        raw = frame.raw
        for station in self._downlink.receivers(frame, self.ports, self.view, now):
            self.ports[station].write(raw)

    @property
    def position_waits(self) -> bool:
        """There is a position for `check_zones`."""
        return self.autopilot.position_waits

    def check_zones(self, now: float) -> None:
        """Compare the newest position to the zones; to be called soon after it came.

        Not at once: this is the longest job there is, and stations' frames that came meanwhile go before it.
        """
        self._attempt("zone check", self.autopilot.check_zones, now)

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """To be called often (the module: 20 times a second). What fails in here stops nothing else in here."""
        self._note_passed()
        self._conversations.tick(now)
        if self._arbiter_is_due(now):
            self.handle(events.Tick(), now)
        self._schedule.run(now)

    def _arbiter_is_due(self, now: float) -> bool:
        if self.failed:
            return False
        if self._due_at == _UNKNOWN:
            try:
                deadline = self.arbiter.next_deadline()
            except Exception:
                self.fail_closed(f"arbiter failed on its deadline: {traceback.format_exc(limit=-3)}", now)
                return False
            self._due_at = inf if deadline is None else deadline
        return now >= self._due_at

    def _send_lease(self, now: float) -> None:
        if not self.failed:
            self._voice.to_autopilot(self._lease.next(self.view, self.config.sysid))

    def _send_authority_status(self, now: float) -> None:
        guard = self.arbiter.guard(now)
        self._voice.to_stations(status.authority_status(self.view, self.arbiter.zone(), guard, self._reason))

    def _each_second(self, now: float) -> None:
        beat = status.heartbeat(self.view)
        self._voice.to_autopilot(beat)
        self._voice.to_stations(beat)
        self._voice.to_stations(status.control_status(self.view))
        self._telemetry.each_second(self.view, now)
        self._streams.each_second(self.aircraft, now)
        self._narrator.clock(now)
        on_load = self.view.phase is Phase.ON_LOAD
        self._missions.load_on_board(on_load and not self.view.armed and self.aircraft.position is not None, now)
        self._memory.save(self.arbiter.snapshot())
        grounded = on_load and not self.aircraft.armed and "start" not in self._conversations
        word = self.autopilot.guard_status
        firmware = None if word is None else word.firmware
        self.preflight.each_second(self.aircraft.heartbeat_at, grounded, self.arbiter.guard(now), firmware, now)

    # ---- the arbiter ----------------------------------------------------------------------------------------------

    def handle(self, event: events.Event, now: float) -> None:
        """Give one event to the arbiter and carry out what it asks for."""
        if self.failed:
            return
        self._note_passed()
        self._due_at = _UNKNOWN
        try:
            actions = self.arbiter.handle(event, now)
        except Exception:
            self.fail_closed(f"arbiter failed on {type(event).__name__}: {traceback.format_exc(limit=-3)}", now)
            return
        for action in actions:
            self._attempt(f"action {type(action).__name__}", self._perform, action, now)

    def fail_closed(self, text: str, now: float) -> None:
        """Nobody commands from here on, and no lease is sent: the guard brings the aircraft home.

        What can be done to help it is done, each for itself: after one fault another is no surprise.
        """
        former, self.failed = self.view.commander, True
        self.view = AuthorityView(self.view.phase, None, None, self.view.epoch, LeaseState.LOST, self.view.armed)
        self.journal.write("failed_closed", text, reason="fault")
        self._note_passed()
        if former is not None:
            self._attempt("flush", self._changeover.close_all_of, former)
        self._attempt("end of START", self._orders.give_start_up, "internal fault", now)
        if self.aircraft.flying:
            self._attempt("way home", self._orders.bring_home, FlightAction.RETURN, now)
        line = f"INTERNAL FAULT, authority ends here: {text.strip().splitlines()[-1]}"
        self._attempt("console", self._narrator.tell, line)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: Any) -> None:
        """Do it; if it breaks, what comes behind it is none the worse for it."""
        try:
            job(*arguments)
        except Exception:
            self.fault(where, traceback.format_exc(limit=-3))

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
            self._narrator.record(action)
        elif isinstance(action, events.Fly):
            self._orders.bring_home(action.action, now)
        elif isinstance(action, events.BeginStart):
            self._orders.start(self.ports[action.station], self._start_asker[1:], now)
        elif isinstance(action, events.StartRefused):
            self._orders.refuse_start(self.ports[action.station], self._start_asker[1:], action.needs)
        elif isinstance(action, events.ControlAnswer):
            self._control.answer(self.ports[action.station], action.result, action.text)
        elif isinstance(action, events.NotifyOwner):
            name = self.arbiter.name(action.requester)
            self._control.ask_owner(self.ports[action.station], action, name, self.view.handover_id)
        else:
            raise TypeError(f"nobody carries out {type(action).__name__}")

    def _send(self, action: events.Send) -> None:
        port = self.ports[action.station]
        if not isinstance(action.message, (Connect, ConnectAck)):
            self._narrator.message("out", port, action.message, action.attempt)
        message = codec.encode(action.message, port.target, self.config.sysid, self.aircraft.state())
        port.send(message, everywhere=True)

    def _on_view(self, action: events.ViewChanged, now: float) -> None:
        self._memory.save(self.arbiter.snapshot())
        before, view = self.view, action.view
        self.view, self._reason = view, action.reason
        self._changeover.view_changed(before, view, now)
        if view.commander != before.commander:
            self._orders.give_start_up("its commander commands no more", now)
        self._narrator.view(view, action.reason)
        self._send_lease(now)
        self._send_authority_status(now)
        self._voice.to_stations(status.control_status(view))

    def close(self) -> None:
        """Close links and journal."""
        for port in self.ports.values():
            self._attempt("closing links", port.close)
        self.journal.write("unloaded")
        self.journal.close()

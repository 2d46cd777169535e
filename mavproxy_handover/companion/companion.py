# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion: turns frames and ticks into events, and the arbiter's actions into frames.

It decides nothing about authority (the arbiter does, in `core`), nothing about what passes (the gate does, and every
frame of a station goes through it), and it knows the autopilot by the front of its wing. What it does decide is what to
do when something breaks: whatever goes wrong inside the arbiter, or for 5 s of flight with what it knows of the zones,
ends authority for good (nobody commands, no lease is sent, so the guard brings the aircraft home); whatever goes wrong
with one frame costs that frame.

MAVProxy is not known here: `module.py` gives a function that writes to the autopilot, the messages that come from
there, and the time.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any, Final, TypeVar

from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.assembly import assemble
from mavproxy_handover.autopilot.authority import Authority
from mavproxy_handover.autopilot.orders import UNDOING, commanded, disarms
from mavproxy_handover.autopilot.package_loading import MissionSurroundings
from mavproxy_handover.autopilot.read_back import WITHDRAWN
from mavproxy_handover.autopilot.reports import Reports
from mavproxy_handover.clocks import Clocks
from mavproxy_handover.companion.event_queue import EventQueue
from mavproxy_handover.companion.restart import Restart
from mavproxy_handover.config.running import Running
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.authority.start import MIDWAY
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.messages import TransferMessage
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState, ModeClass, Phase, Reason
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.event_log import EventLog
from mavproxy_handover.gate.filters import CompanionMatters
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import intent_of, repeats, wish_of
from mavproxy_handover.gate.judge import Fate, Verdict, uploads
from mavproxy_handover.gate.latent import News
from mavproxy_handover.gate.list_changes import list_change
from mavproxy_handover.gate.passed import PassedFrames
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.rows import begins_midway, classify
from mavproxy_handover.gate.replies import GateReports
from mavproxy_handover.gate.tongues import Tongue
from mavproxy_handover.gate.words import thesis_command
from mavproxy_handover.link.quality import LinkEvent
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.monitors.position.source import Box
from mavproxy_handover.operator.announcer import Announcer
from mavproxy_handover.operator.briefing import Briefing
from mavproxy_handover.operator.missing_heartbeats import Unheard
from mavproxy_handover.operator.operator_control import OperatorControl
from mavproxy_handover.operator.overrides import Overrides
from mavproxy_handover.operator.package_return import PackageReturn
from mavproxy_handover.operator.rehearsal import RehearsalDesk, Surroundings
from mavproxy_handover.operator.rehearsal_stats import Foreseen
from mavproxy_handover.schedule import Schedule, attempt
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.stations.voice import Voice
from mavproxy_handover.store.journal import Journal, strangers_path
from mavproxy_handover.store.state_store import StateStore
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.wire import codec, status
from mavproxy_handover.wire.frames import Frame, checked_types, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, MISSION_START

__all__ = ["Companion", "Edge"]

T = TypeVar("T")

#: accepted commands are in the journal this much later at most, as long as the main loop goes round
_JOURNAL_S: Final = 0.2
#: between two heartbeats of the companion at least, and without the autopilot's
_BEAT_S: Final = 0.9
_BEAT_ALONE_S: Final = 1.9
_HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_CONTROL_STATUS: Final = mavlink.MAVLINK_MSG_ID_CONTROL_STATUS
#: what strangers fill is no more than that, twice
_STRANGERS_BYTES = 8 * 1024 * 1024
#: what passes and changes something: it is in the journal
_CHANGES: Final = frozenset((Access.COMMAND, Access.SAFEGUARD))
#: what a system behind a station says in the station's name; the words of a transfer are the station's own
_COMMANDS: Final = frozenset((Access.COMMAND, Access.CONTROL, Access.READ, Access.RALLY_READ, Access.RALLY_WRITE))
#: the list of rally points that stations see is the companion's own
_RALLY: Final = frozenset((Access.RALLY_READ, Access.RALLY_WRITE))
#: why the aircraft is brought home after an internal fault of the rules
_FAILED: Final = "internal fault of the companion, no station commands"
#: so many findings of the checks before flight are told to whoever starts it
_WARNINGS: Final = 6
#: a station whose heartbeat is no older than that hears what it is told
_HEARS_S: Final = 2.5
#: in flight, where the aircraft is cannot be compared to the zones for so long: nobody knows whether it is in one
_UNJUDGED_S: Final = 5.0
#: no time: the arbiter is to be asked
_UNKNOWN: Final = -inf


@dataclass(frozen=True, slots=True)
class Edge:
    """What the companion stands on: the way to the autopilot (whole frames), the console, the clocks, a number that
    makes this run recognisable (never 0), and the position box, where there is one."""

    write_autopilot: Callable[[bytes], None]
    show: Callable[[str], None]
    clocks: Clocks
    nonce: int
    box: Box | None = None


class Companion:
    """One vehicle's companion. Times are monotonic seconds; not safe for threads."""

    def __init__(self, running: Running, ports: dict[int, StationPort], edge: Edge) -> None:
        """Raises OSError: the journal cannot be written, and it is no restart."""
        self.config = config = running.config
        self.ports = ports
        strict = not running.restart
        self.journal = Journal(config.journal, config.name, strict=strict)
        self._strangers = Journal(strangers_path(config.journal), config.name, _STRANGERS_BYTES, strict=strict)
        self.faults: Counter[str] = Counter()
        #: of each station, how many of a kind there were when it was told of that kind
        self._faults_told: dict[int, Counter[str]] = {station: Counter() for station in ports}
        #: since when no position could be compared to the zones, because that breaks
        self._unjudged_at = inf
        self.failed = False
        #: the arbiter's next deadline, inf if it has none; it moves with events only
        self._due_at = _UNKNOWN
        #: when the stations heard the companion's heartbeat last
        self._beaten_at = edge.clocks.monotonic()
        self._reason = Reason.NONE
        #: what each station was told last of what the checks before flight have found
        self._warned: dict[int, tuple[str, ...]] = {}
        keeper = None if config.state is None else StateStore(config.state, config.name)
        self._restart = Restart(keeper, self.fault, self._not_kept)
        identity = Identity(config.name, tuple(entry.station for entry in config.stations), config.parent, edge.nonce)
        self.arbiter = Arbiter(identity, config.limits, self._restart.restored)
        self._queue: EventQueue[float] = EventQueue(self._take, self._begin_order)
        self._edge = edge
        #: MAVProxy's messages whose CRC need not be checked again: MAVProxy may speak another dialect than ours
        self._checked = checked_types(mavutil.mavlink) | checked_types(mavlink)
        self._voice = Voice(config.sysid, self._write_autopilot, ports, self.fault)
        self._in_force = in_force = AuthorityInForce()
        self._passed = passed = PassedFrames(
            config.sysid, ports, config.observers, in_force, edge.write_autopilot, self.fault
        )
        self.event_log = EventLog(
            config.name, self.journal, self._strangers, self.arbiter, self._shown_by(edge.show), lambda: self.view.phase
        )
        self._announcer = Announcer(self._voice)
        self._unheard = Unheard(self._voice)
        self._control = OperatorControl(self._voice, self.event_log, self.handle)
        authority = Authority(self.arbiter, self.handle, in_force.commands)
        reports = Reports(self.event_log, self._voice, self.fault)
        mission = MissionSurroundings(self._keep, self._close_mission_files, lambda: passed.list_open)
        try:
            self.autopilot = assemble(running, authority, reports, mission, edge.clocks, edge.nonce, edge.box)
        except Exception:
            self._restart.close()
            self.journal.close()
            self._strangers.close()
            raise
        around = Surroundings(lambda: self.view, self._place, self._where, self._foreseen)
        told_by = self._voice, self.event_log, self._announcer
        self.rehearsal = RehearsalDesk(config.sysid, self.arbiter, self.handle, *told_by, around)
        self._package_return = PackageReturn(ports, self.arbiter.unfit, self.event_log)
        self._briefing = Briefing(self.arbiter, self.autopilot, ports, self.fault)
        matters = CompanionMatters(
            self.autopilot.command_check.target,
            self.autopilot.orders.takes_over,
            self.autopilot.return_site.list.file.access,
            lambda: self.autopilot.aircraft.judged_by,
        )
        told = GateReports(self.fault, self._station_told, self._say)
        self.gate = Gate(config.sysid, ports, in_force, passed, edge.write_autopilot, told, matters)
        self.gate.distrust()
        self.gate.change(self.arbiter.view, edge.clocks.monotonic())
        self._overrides = Overrides(self.autopilot.command_check, lambda: self.view.commander, config.sysid)
        jobs = [
            ("send_lease", self._send_lease, status.LEASE_INTERVAL_S),
            ("send_authority_status", self._send_authority_status, 0.5),
            ("each_second", self._each_second, 1.0),
            ("journal", lambda _now: self.journal.flush(), _JOURNAL_S),
            ("package_return", self._return_packages, 0.25),
        ]
        self._schedule = Schedule(jobs, self.fault)
        package = self._restart.resume(self.arbiter, self.event_log)
        if package is not None:
            self.autopilot.mission.restore(package, edge.clocks.monotonic())
            self._lay_out(package)
        restored = self._restart.restored
        if restored is not None:
            self.autopilot.energy.resume(restored.packs, edge.clocks.monotonic())
            if restored.kept:
                self.autopilot.mission.restore_upload(self._restart.kept_by(), edge.clocks.monotonic())

    def _write_autopilot(self, data: bytes) -> None:
        """A frame of the companion's own goes to the autopilot."""
        self._edge.write_autopilot(data)
        self._passed.companion_sent(data, self._edge.clocks.monotonic())

    def _snapshot(self) -> Snapshot:
        """What a run after this one needs."""
        kept, kept_by = self.autopilot.mission.kept
        snapshot = replace(self.arbiter.snapshot(), kept=kept, kept_by=kept_by)
        try:
            return replace(snapshot, packs=self.autopilot.energy.memory)
        except Exception:  # that is worth less than what else there is to keep
            self.fault("memory of the batteries", traceback.format_exc(limit=-3))
            return snapshot

    def _not_kept(self, text: str) -> None:
        """Memory or disk does not take the state: that is no fault of ours, and no flight ends by it."""
        self.event_log.kept_elsewhere(text)
        self._voice.say_to_all(text)

    def _keep(self, package: MissionPackage) -> None:
        """The autopilot holds this mission now."""
        self._restart.keep(package)
        self._lay_out(package)

    def _lay_out(self, package: MissionPackage) -> None:
        """Beside the journal: whoever reads it later needs no more."""
        self.journal.lay_beside(f"mission-{package.digest.hex()[:8]}", package.files)

    def _close_mission_files(self) -> None:
        for station, closing in self._passed.close_mission_files():
            self.event_log.closed(station, closing)

    def _place(self) -> str:
        """The zones that hold the aircraft, by name."""
        held = sorted(fact.station for fact in self.autopilot.zones.facts() if fact.margin_m > 0.0)
        return "+".join(self.arbiter.name(station) for station in held) or "no zone"

    def _where(self) -> tuple[float, float] | None:
        where = self.autopilot.aircraft.where
        return None if where is None else where[:2]

    def _foreseen(self) -> tuple[Foreseen, ...]:
        """The handovers that the check of the mission has."""
        name = self.arbiter.name
        return tuple(
            Foreseen(name(h.from_station), name(h.to_station), (h.lat_deg, h.lon_deg), h.seq, h.overlap_s)
            for h in self.autopilot.mission.flown.foreseen
        )

    @property
    def view(self) -> AuthorityView:
        """The authority that is in force: what the gate judges by."""
        return self._in_force.view

    @property
    def decision(self) -> str:
        """What is done about what is wrong, in one sentence; "" if nothing is."""
        return self._announcer.text

    # ---- from the stations ----------------------------------------------------------------------------------------

    def on_station(self, port: StationPort, frames: list[Frame], now: float) -> None:
        """Frames that came in on a link of `port`; those that were rejected there are journalled."""
        while port.rejected:
            frame, signature = port.rejected.popleft()
            what = classify(frame).what  # words for people, of somebody who is not known to be the station
            self.event_log.rejected(port.name, (frame.msgid, signature), what, signature.value, now)
        # after a stall: nothing is judged by authority that has run out. Nearly always the first comparison is all
        if now >= self._due_at and self._arbiter_is_due(now):
            if self.autopilot.aircraft.uncompared:  # a position that came before counts before, too
                self.check_zones(now)
            self.handle(events.Tick(), now)
        gate = self.gate
        for frame in frames:
            try:
                if gate.sign_of_life(port, frame):
                    port.heard(frame, now)
                    self.handle(events.StationHeard(port.sysid), now)
                verdict = gate.up(port, frame, now)
                if verdict.fate is not Fate.FORWARD or verdict.access in _CHANGES:
                    self._follow_up(port, frame, verdict, now)
            except Exception:
                self.fault("frame of a station", traceback.format_exc(limit=-3))

    def on_links(self, port: StationPort, changes: list[LinkEvent], now: float) -> None:
        """What the measuring of a station's links has brought to light."""
        for change in changes:
            self.event_log.link(port.name, change)
            self.handle(events.LinkJudged(port.sysid, port.weak, port.attacked, change.text), now)

    def _follow_up(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        """What the companion itself has to do with a frame, now that the gate is done with it."""
        match verdict.fate:
            case Fate.FORWARD:
                self._accepted(port, frame, verdict.what, now)
                self._chosen(frame, now)
                if disarms(frame):
                    self.autopilot.orders.disarmed(port, frame, self.autopilot.aircraft.armed, now)
                    self.autopilot.read_back.withdraw(now)
            case Fate.CONSUME:
                if frame.sysid == port.sysid or verdict.access in _COMMANDS:
                    self._consume(port, frame, verdict, now)
            case Fate.REFUSE | Fate.DROP:
                kind, answered = (frame.msgid, verdict.reason), verdict.fate is Fate.REFUSE
                proven = port.proves(frame)
                named, why = partial(self.gate.unsaid, frame), verdict.reason.value
                self.event_log.refused(
                    port.name, kind, verdict.what, named, why, answered, proven, now, thesis_command(frame)
                )
                self.rehearsal.turned_away(port.name, verdict.what, verdict.reason.value)
            case _:
                assert_never(verdict.fate)

    def _accepted(self, port: StationPort, frame: Frame, what: str, now: float) -> None:
        # it has reached the autopilot: what follows from it must not depend on the journal
        self._journal_accepted(port, frame, what)
        change = list_change(frame)
        if change is not None:
            self.autopilot.mission.list_changed(port, change, self.view.phase is Phase.ON_LOAD, now)

    def _journal_accepted(self, port: StationPort, frame: Frame, what: str) -> None:
        self._attempt("journal", lambda: self.event_log.accepted(port.name, what, thesis_command(frame)))

    def _chosen(self, frame: Frame, now: float) -> None:
        """The commander's command goes to the autopilot: perhaps it asks for another mode."""
        aircraft = self.autopilot.aircraft
        hand = mode_requests.of_command(frame, aircraft.vehicle, aircraft.ways_down.leads_to)
        if hand is not None:
            self.handle(hand, now)

    def _station_told(self, news: News, now: float) -> None:
        self.event_log.stream(self.ports[news.station].name, news, now)

    def _say(self, station: int, text: str, now: float) -> None:
        """Why something is refused, to the station that asked."""
        port = self.ports[station]
        self.event_log.told(port.name, text, now)
        self._voice.say(port, text)

    def _consume(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        if verdict.access in (Access.COMMAND, Access.READ):  # of those what starts a flight, or is judged during it
            if self.view.phase is Phase.ON_LOAD:
                self._begins_flight(port, frame, verdict, now)
            else:
                self._in_flight(port, frame, verdict, now)
            return
        if verdict.access not in (Access.TRANSFER, Access.CONTROL, *_RALLY):  # the gate has seen to it
            return
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        if verdict.access in _RALLY:
            self.autopilot.return_site.list.take(port, message, now)
            return
        if verdict.access is Access.CONTROL:
            self._control.take(port, frame, message, self.view.handover_id, now)
        else:
            self._on_transfer(port, frame, message, now)

    def _begins_flight(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        """The commander's START, or what else arms or takes off on the ground: that needs no less."""
        orders, midway = self.autopilot.orders, begins_midway(classify(frame))
        if not midway:
            self.autopilot.command_check.start(port, wish_of(frame), repeats(frame), now)
        if commanded(frame) == MISSION_START:
            orders.start_asked(port, frame, verdict.what, now)
            return
        needs = MIDWAY if midway else self.arbiter.take_off_needs(port.sysid, now)
        needs = needs or (UNDOING if orders.undoing else ())
        if needs:
            self._refuse_take_off(port, frame, verdict, needs, now)
            return
        command = port.sysid, frame.sysid, frame.compid, frame.msgid, wish_of(frame)
        self.autopilot.read_back.ask(
            command, lambda trouble, now: self._takes_off(port, frame, verdict, trouble, now), now
        )

    def _takes_off(self, port: StationPort, frame: Frame, verdict: Verdict, trouble: str, now: float) -> None:
        """The mission was read back (`trouble`: why not): a command that arms or takes off passes, or is refused."""
        troubles = (trouble,) if trouble else ()
        needs = troubles if trouble == WITHDRAWN else self.arbiter.take_off_needs(port.sysid, now) or troubles
        if needs:
            self._refuse_take_off(port, frame, verdict, needs, now)
            return
        self.handle(events.TakeOffPassed(port.sysid), now)
        self._warn()
        self._accepted(port, frame, self.gate.release(port, frame, verdict, now).what, now)
        self._chosen(frame, now)

    def _refuse_take_off(
        self, port: StationPort, frame: Frame, verdict: Verdict, needs: tuple[str, ...], now: float
    ) -> None:
        self.autopilot.orders.refuse_take_off(port, frame, needs, now)
        kind, proven = (frame.msgid, verdict.reason), port.proves(frame)
        named, why = partial(self.gate.unsaid, frame), "; ".join(needs)
        self.event_log.refused(port.name, kind, verdict.what, named, why, True, proven, now)

    def _warn(self) -> None:
        """Whoever starts the flight hears what does not fit on board, once."""
        found = tuple(finding.text for finding in self.autopilot.preflight.findings or ())
        commander = self.view.commander
        if commander is None or found == self._warned.get(commander, ()):
            return
        self._warned[commander] = found
        port = self.ports[commander]
        more = len(found) - _WARNINGS
        for text in found[:_WARNINGS]:
            self._voice.say(port, f"preflight: {text}")
        if more > 0:
            self._voice.say(port, f"preflight: {more} more are in the companion's journal")

    def _in_flight(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        """A command of the commander that the situation judges, or a part of an upload."""
        if uploads(frame, self.autopilot.aircraft.judged_by):
            self.autopilot.mission.flight_uploads.on_frame(port, frame, now)
            return
        intent = intent_of(frame, self.autopilot.aircraft.judged_by)
        if intent is None or self.autopilot.command_check.judge(port, intent, now).passes:
            if self.autopilot.orders.takes_over(frame):
                self._journal_accepted(port, frame, verdict.what)
                self.autopilot.orders.pause_asked(port, frame, now)
                return
            self._accepted(port, frame, self.gate.release(port, frame, verdict, now).what, now)
            self._chosen(frame, now)
            if intent is not None:
                self.autopilot.orders.passed(port, intent, now)
            return
        refused = self.gate.turn_down(port, frame, verdict, now)
        kind, proven = (frame.msgid, refused.reason), port.proves(frame)
        named, why = partial(self.gate.unsaid, frame), refused.reason.value
        self.event_log.refused(port.name, kind, refused.what, named, why, True, proven, now, thesis_command(frame))
        self.rehearsal.turned_away(port.name, refused.what, refused.reason.value)

    def _on_transfer(self, port: StationPort, frame: Frame, message: Any, now: float) -> None:
        port.spoke(frame.compid)
        port.tongues.show((frame.sysid, frame.compid), Tongue.OURS, now)
        kind = message.get_type()
        if kind == "MISSION_PACKAGE_ACK":
            self._package_return.on_ack(port, message, now)
            return
        if kind.startswith("MISSION_"):
            self.autopilot.mission.on_package(port, message, now)
            return
        if kind == "HANDOVER_REHEARSE":
            self.rehearsal.take(port, message, now)
            return
        if kind == "HANDOVER_OVERRIDE":
            if message.vehicle == self.config.sysid:
                port.send(self._overrides.take(port, message, now))
            return
        decoded = codec.decode(message)
        if decoded is None or getattr(message, "vehicle", 0) != self.config.sysid:
            self.event_log.senseless(kind, port.name, now)
            return
        if isinstance(decoded, TransferMessage):
            self._attempt("journal", self.event_log.message, "in", port.sysid, decoded, now)
        self.handle(events.StationMessage(port.sysid, decoded), now)

    # ---- from the autopilot ---------------------------------------------------------------------------------------

    def on_autopilot(self, message: Any, now: float) -> None:
        """A message that MAVProxy received from the vehicle's side."""
        frame = parse_one(message.get_msgbuf(), proven=type(message) in self._checked)
        if frame is None:
            return
        if frame.sysid == self.config.sysid and frame.known:
            if frame.compid == AUTOPILOT_COMPID:
                self.autopilot.messages.take(message, now)
                if self.autopilot.guard.asks:
                    self._send_lease(now)
            if frame.msgid == _CONTROL_STATUS:
                self.autopilot.messages.second_manager(frame)
        if not self.gate.down(frame, now):
            self.event_log.in_our_name((frame.sysid, frame.compid), classify(frame).what)
        elif (frame.msgid, frame.sysid, frame.compid) == (_HEARTBEAT, self.config.sysid, AUTOPILOT_COMPID):
            self._beat_stations(now, _BEAT_S)

    def check_zones(self, now: float) -> None:
        """Compare the newest position to the zones; to be called soon after it came.

        Not at once: this is the longest job there is, and stations' frames that came meanwhile go before it.
        """
        try:
            self.autopilot.zones.update(now)
        except Exception:
            self._not_checked(traceback.format_exc(limit=-3), now)
        else:
            self._unjudged_at = inf

    def _not_checked(self, text: str, now: float) -> None:
        """Once or twice costs a position; where it goes on in flight nothing would say that coverage has ended."""
        self.fault("zone check", text)
        self._unjudged_at = min(self._unjudged_at, now)
        if now - self._unjudged_at >= _UNJUDGED_S and self.autopilot.aircraft.flying and not self.failed:
            self.fail_closed(f"positions cannot be compared to the zones: {text}", now)

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """To be called often (the module: 20 times a second). What fails in here stops nothing else in here."""
        self._attempt("gate", self.gate.tick, now)
        self._attempt("autopilot", self.autopilot.rounds.tick, now)
        if self._arbiter_is_due(now):
            self.handle(events.Tick(), now)
        self._attempt("briefing", self._briefing.tick, now)
        self._attempt("rehearsal", self.rehearsal.tick, now)
        self._schedule.run(now)

    def _arbiter_is_due(self, now: float) -> bool:
        if self.failed:
            return False
        if self._due_at == _UNKNOWN:
            deadline = self._asked("its deadline", self.arbiter.next_deadline, None, now)
            self._due_at = inf if deadline is None else deadline
        return now >= self._due_at

    def _asked(self, what: str, ask: Callable[[], T], otherwise: T, now: float) -> T:
        """What the arbiter says of itself; `otherwise` where it cannot: then it is no judge any more."""
        if self.failed:
            return otherwise
        try:
            return ask()
        except Exception:
            self.fail_closed(f"arbiter failed on {what}: {traceback.format_exc(limit=-3)}", now)
            return otherwise

    def _return_packages(self, now: float) -> None:
        package, flying = self.autopilot.mission.flown.package, self.autopilot.aircraft.flying
        self._package_return.tick(None if self.failed else package, flying, now)

    def _send_lease(self, now: float) -> None:
        alone_s = self._asked("the way alone", lambda: self.arbiter.alone_s(now), 0.0, now)
        if not self.failed:
            self.autopilot.guard.send_lease(self.view, alone_s)

    def _send_authority_status(self, now: float) -> None:
        guard = self.arbiter.guard(now)
        changed, zone = self.autopilot.mission.flown.changed, self.arbiter.zone()
        told = status.authority_status(
            self.view,
            zone,
            guard,
            self._reason,
            route_changed=changed,
            zone_ends_s=self.arbiter.zone_ends_s,
            answer_left_s=self.arbiter.answer_left_s(now),
            place=self.autopilot.return_site.where,
        )
        self._voice.to_stations(told)

    def _each_second(self, now: float) -> None:
        """What breaks in one of these is that one's alone."""
        self._attempt("heartbeat", lambda: self._voice.to_autopilot(status.heartbeat(self.view)))
        self._attempt("heartbeat", self._beat_stations, now, _BEAT_ALONE_S)
        self._attempt("control status", lambda: self._voice.to_stations(status.control_status(self.view)))
        self._attempt("word of a decision", self._announcer.tick, now)
        self._attempt("clock", self.event_log.clock, now)
        self._attempt("journal", self.event_log.sum_up, now)
        self._attempt("state", lambda: self._restart.each_second(self._snapshot()))
        grounded = self._asked("whether it is on the ground", lambda: self.arbiter.grounded(now), False, now)
        self._attempt("each second", self.autopilot.rounds.each_second, self.view, grounded, now)
        self._attempt("word of a fault", self._tell_faults, now)
        self._attempt("word of heartbeats", self._unheard.each_second, now)

    def _beat_stations(self, now: float, pause_s: float) -> None:
        """The companion's heartbeat, if the last one is so long ago. It goes out behind the autopilot's, not between.

        A program may take the first heartbeat that it hears for all that there is: MAVSDK 3 looks for an autopilot at
        that moment and never again.
        """
        if now - self._beaten_at >= pause_s:
            self._beaten_at = now
            self._voice.beat(status.heartbeat(self.view))

    # ---- the arbiter ----------------------------------------------------------------------------------------------

    def handle(self, event: events.Event, now: float) -> None:
        """Append an event to the queue, and handle all that wait (`EventQueue` has the order).

        While an event is handled, this only appends. After `fail_closed` no event is handled.
        """
        if not self.failed:
            self._queue.put(event, now)

    def _take(self, event: events.Event, now: float) -> None:
        """Give one event to the arbiter and carry out what it asks for."""
        self._due_at = _UNKNOWN
        try:
            actions = self.arbiter.handle(event, now)
        except Exception:
            self.fail_closed(f"arbiter failed on {type(event).__name__}: {traceback.format_exc(limit=-3)}", now)
            return
        for action in actions:
            if self.failed:
                return
            self._attempt(f"action {type(action).__name__}", self._perform, action, now)

    def _begin_order(self, now: float) -> None:
        """All events are handled: the autopilot gets the order that was decided last, if there is one."""
        orders = self.autopilot.orders
        if orders.ordered is not None:  # after nearly every event there is none
            self._attempt("action Fly", orders.begin, now)

    def fail_closed(self, text: str, now: float) -> None:
        """No station commands from here on, and no lease is sent: the guard brings the aircraft home.

        Events that wait are dropped, and none is handled afterwards. What can be done to help the guard is done, each
        for itself: after one fault another is no surprise. A return is ordered; a landing, flown or ordered, goes on.
        """
        self.failed = True
        self._queue.clear()
        nobody = AuthorityView(self.view.phase, None, None, self.view.epoch, LeaseState.LOST, self.view.armed)
        self._attempt("flush", self._put_in_force, nobody, now)
        self._attempt("journal", self.event_log.failed_closed, text)
        self._attempt("end of START", self.autopilot.orders.give_start_up, "internal fault", now)
        if self.autopilot.aircraft.flying:
            action = self._way_home()
            self._attempt("way home", self._come_home, action, now)
            told = events.Announce(f"{action.name}: {_FAILED}", action, Reason.FAULT)
            self._attempt("word of it", self._announce, told, now)
        self._attempt("console", self.event_log.authority_ends, text)

    def _way_home(self) -> FlightAction:
        """LAND if it comes down or was ordered to land, else RETURN; RETURN too if looking for that breaks."""
        try:
            lands = self.autopilot.aircraft.lands or self.autopilot.orders.landing
        except Exception:
            self.fault("way home", traceback.format_exc(limit=-3))
            lands = False
        return FlightAction.LAND if lands else FlightAction.RETURN

    def _come_home(self, action: FlightAction, now: float) -> None:
        """Order a return or a landing. What comes down in a mode that ends on the ground is left alone."""
        aircraft = self.autopilot.aircraft
        if not (aircraft.lands and aircraft.flown in (ModeClass.RETURN, ModeClass.LAND)):
            self.autopilot.orders.fly(action, now)

    def _shown_by(self, show: Callable[[str], None]) -> Callable[[str], None]:
        """A console that breaks keeps nothing else from being done, or from being told to the operators."""
        return lambda line: self._attempt("console", show, line)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: Any) -> None:
        """Do it; if it breaks, what comes behind it is none the worse for it."""
        attempt(self.fault, where, job, *arguments)

    def fault(self, where: str, text: str) -> None:
        """Something broke that costs one frame or one tick. The stations are told of the first of a kind, each when it
        hears, and again at the next take-off if more of it came."""
        self.faults[where] += 1
        if self.faults[where] <= 10:
            with suppress(Exception):  # the journal may be what is broken: it is counted all the same
                self.event_log.fault(where, text)

    def _tell_faults(self, now: float) -> None:
        for station, told in self._faults_told.items():
            if now - self.ports[station].heartbeat_at > _HEARS_S:
                continue
            for where, count in list(self.faults.items()):  # telling may break as well
                if not told[where]:
                    told[where] = count
                    self._voice.say(self.ports[station], f"internal fault of the companion: {where}")

    def _flight_begins(self) -> None:
        """People hear once more what has broken since they were told."""
        for told in self._faults_told.values():
            for where in [where for where, count in told.items() if self.faults[where] > count]:
                del told[where]

    def _perform(self, action: events.Action, now: float) -> None:
        match action:
            case events.Send():
                self._send(action, now)
            case events.ViewChanged():
                self._on_view(action, now)
            case events.Record():
                self.event_log.record(action, now)
                if action.reason is Reason.LANDED:
                    self.autopilot.orders.flight_over(now)
                self.rehearsal.record(action, now)
            case events.Fly():
                self._fly(action, now)
            case events.Announce():
                self._announce(action, now)
            case events.BeginStart():
                self.autopilot.orders.start(action.station, now)
                self._warn()
            case events.StartRefused():
                self.autopilot.orders.refuse_start(action.station, action.needs, now)
            case events.RehearsalMoved():
                self.rehearsal.moved(action, now)
            case events.Advise():
                self._announcer.advise(action)
            case events.RehearsalRefused():
                self.rehearsal.refused(action, now)
            case events.ControlAnswer():
                self._control.answer(self.ports[action.station], action.result, action.text, now)
            case events.NotifyOwner():
                name = self.arbiter.name(action.requester)
                self._control.ask_owner(self.ports[action.station], action, name, self.view.handover_id)
            case _:
                assert_never(action)

    def _fly(self, action: events.Fly, now: float) -> None:
        if self.view.rehearsal:  # the rules order nothing in one; whoever carries the aircraft has his hands on it
            self.fault("order in a rehearsal", f"{action.action.name} is not commanded")
            return
        # what stands still by this order must not be left standing
        self._attempt("state", lambda: self._restart.save(self._snapshot()))
        self.autopilot.orders.order(action.action, now)

    def _announce(self, told: events.Announce, now: float) -> None:
        self._attempt("journal", self.event_log.decision, told)
        self._announcer.tell(told, now)
        self._briefing.decided(told.text, now, over=told.action is None)
        self.rehearsal.told(told, now)

    def _send(self, action: events.Send, now: float) -> None:
        port = self.ports[action.station]
        if isinstance(action.message, TransferMessage):
            self._attempt("journal", self.event_log.message, "out", port.sysid, action.message, now, action.attempt)
        state = self.autopilot.aircraft.state()
        port.send(codec.encode(action.message, port.target, self.config.sysid, state), everywhere=True)
        self._briefing.asked(action.station, action.message)

    def _on_view(self, action: events.ViewChanged, now: float) -> None:
        before, view = self.view, action.view
        former = before.commander
        self._reason = action.reason
        if view.armed and not before.armed:
            self._flight_begins()
        try:
            self._restart.save(self._snapshot())
            self._put_in_force(view, now)
        except Exception:
            if self.view is not view:  # the former one would stay in force, with leases and all
                self.fail_closed(f"a new view could not be put in force: {traceback.format_exc(limit=-3)}", now)
                return
            self.fault("what follows from a new view", traceback.format_exc(limit=-3))
        if view.commander != former:
            self.autopilot.authority_moved(before, now)
            self.autopilot.orders.give_start_up("its commander commands no more", now)
            self._attempt("word of it", self._tell_commander, before, view)
        self._attempt("journal", self.event_log.view, view, action.reason)
        self._send_lease(now)
        self._send_authority_status(now)
        self._voice.to_stations(status.control_status(view))

    def _tell_commander(self, before: AuthorityView, view: AuthorityView) -> None:
        """Who commands now, to everybody; the number is that of the transfer that has brought it about, if one has."""
        if view.commander is None:
            self._announcer.commander("", None)
            return
        transferred = view.commander == before.partner and view.handover_id == before.handover_id
        self._announcer.commander(self.arbiter.name(view.commander), view.handover_id if transferred else None)

    def _put_in_force(self, view: AuthorityView, now: float) -> None:
        for station, closing in self.gate.change(view, now):
            self.event_log.closed(station, closing)

    def settle(self, within_s: float) -> bool:
        """Wait, so long at most, until journal and state are on the disk; whether they are. Not for the main loop."""
        return all(each.settle(within_s) for each in (self.journal, self._strangers, self._restart))

    def close(self) -> None:
        """Close links, state and journals."""
        for port in self.ports.values():
            self._attempt("closing links", port.close)
        self._attempt("closing the state", self._restart.close)
        self.event_log.unloaded()
        self.journal.close()
        self._strangers.close()

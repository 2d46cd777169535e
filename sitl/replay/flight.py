# SPDX-License-Identifier: GPL-3.0-or-later

"""One replay: a recorded flight, passed through the real edge of the autopilot and the real rules.

The recorded messages go at their times into the same parts that fly (`companion/autopilot_parts.py`). The events go
into the same `Arbiter`, and the same `EventLog` writes its decisions. Nothing is sent anywhere. Rules that live here:

* The aircraft does what it did. After an order that was not given in the flight, the rules judge an aircraft that does
  not obey; and a mode that was ordered then, and is not now, looks like a pilot's choice.
* What the companion asked the autopilot then is not asked now: the mission is held from the moment the journal has it,
  without one from the first message on.
* A recording that begins in flight begins as after a restart, under the commander of its first lease, else the parent.
* A new run of the companion (its leases have another nonce) begins with what the one before left, as after a restart.
  Between the last message of the one and the first lease of the other nothing was judged, and nothing is.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, cast

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.companion.autopilot_parts import assemble
from mavproxy_handover.companion.event_queue import EventQueue
from mavproxy_handover.config.running import Running
from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import GuardState, Phase
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.base.context import Authority, Reports
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.operator.uploads.package_loading import MissionSurroundings
from mavproxy_handover.operator.uploads.prepared import Prepared, prepare
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.tools.schedule import TICK_S
from mavproxy_handover.vehicle.profiles import profile_of
from sitl.replay.ground import Ground, silences
from sitl.replay.happened import Decision, Happened, decision_of
from sitl.replay.recording import Recording
from sitl.replay.stand_in import ANSWERS, StandIn
from sitl.report.journal_reader import Entry

__all__ = ["Commander", "Replay", "replay"]

#: the guard says so often (s) that it lives, where the recording has no word of it
_GUARD_S: Final = 0.5
#: time (s) in which the autopilot answers a question
_ANSWER_S: Final = 0.005
_CONTROL_TIMEOUT_S: Final = 10.0
#: a pause of the messages longer than this (s) before a new run of the companion: nothing was judged in it
_SILENT_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Commander:
    """From `at` (UTC s) on this station commands, "": none; `reason`: why."""

    at: float
    station: str
    reason: str


@dataclass(slots=True)
class Replay:
    """The result of one replay. Times are UTC (s)."""

    config: VehicleConfig
    decisions: list[Decision] = field(default_factory=list)
    commanders: list[Commander] = field(default_factory=list)
    #: what would have been ordered and was not flown, in words
    disobeyed: list[tuple[float, str]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    #: transfers whose answers were not recorded
    assumed_answers: int = 0
    #: the assumed commander of a recording that begins in flight; "": it does not
    aloft: str = ""


class _Book:
    """A journal for the event log: keeps its entries with the time of the replay."""

    def __init__(self, clock: Callable[[], float], replay: Replay) -> None:
        self._clock, self._replay = clock, replay

    def write(self, event: str, text: str = "", **values: Any) -> None:
        now = self._clock()
        entry = Entry(now, "", event, text, {key: value for key, value in values.items() if value is not None})
        decision = decision_of(now, entry)
        if decision is not None:
            self._replay.decisions.append(decision)
        if event == "fly" and not entry.get("obeyed"):
            self._replay.disobeyed.append((now, text))

    note = write


class _Flight:
    """Lets one recording pass once."""

    def __init__(
        self, recording: Recording, happened: Happened | None, prepared: Prepared, config: VehicleConfig,
        flown: VehicleConfig,
    ) -> None:  # fmt: skip
        self._recording, self._happened, self._prepared, self._config = recording, happened, prepared, config
        self.replay = Replay(config)
        self._now = recording.begin
        self._names = {entry.station.sysid: entry.station.name for entry in config.stations}
        self._sysids = {name: sysid for sysid, name in self._names.items()}
        self._stand_in = StandIn(prepared.package, recording.sysid, recording.messages)
        self._later: list[tuple[float, int, Callable[[float], None]]] = []
        self._number = itertools.count()
        silent = silences(recording, happened, self._sysids, flown.limits)
        self._ground = Ground(self._names, silent, happened, self._message_later)
        self._failed = False
        self._weak: set[int] = set()
        self._attacked: set[int] = set()
        self._beats = iter(recording.beats)
        self._second_at = next(self._beats, recording.begin)
        self._started_by_log = happened is None or not (happened.starts or happened.start_ends)
        self._begin_run(self._aloft(), self._nonces()[0][1])

    def _nonces(self) -> list[tuple[float, int]]:
        return self._recording.runs() or [(self._recording.begin, 1)]

    # ---- the companion ----------------------------------------------------------------------------------------------

    def _aloft(self) -> Snapshot | None:
        """The state that a run before would have left if the recording begins in flight, else None."""
        recording, prepared = self._recording, self._prepared
        heartbeat = next((m for _at, m in recording.messages if m.get_type() == "HEARTBEAT"), None)
        if heartbeat is None or not heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
            return None
        lease = recording.leases[0][1] if recording.leases else None
        owner = lease.commander if lease is not None and lease.commander in self._names else self._config.parent
        epoch = lease.epoch if lease is not None else 1
        digest, route = prepared.package.digest, prepared.commanders
        self.replay.aloft = self._names[owner]
        return Snapshot(owner, epoch, 0, Phase.ON_MISSION, 0, digest, route)

    def _begin_run(self, restored: Snapshot | None, nonce: int) -> None:
        config = self._config
        stations = tuple(entry.station for entry in config.stations)
        self._arbiter = Arbiter(Identity(config.name, stations, config.parent, nonce), config.limits, restored)
        self._view = self._arbiter.view
        clock = Clocks(lambda: self._now, lambda: self._now)
        book = cast("Journal", _Book(lambda: self._now, self.replay))
        event_log = EventLog(config.name, book, book, self._arbiter, lambda _line: None, lambda: self._view.phase)
        voice = MessageSender(config.sysid, self._asked, {}, self._fault)
        self._event_log = event_log
        self._queue: EventQueue[float] = EventQueue(self._decide, self._begin_order)
        self._autopilot = assemble(
            Running(config, b""),
            Authority(self._arbiter, self._handle, lambda station: self._view.commander == station),
            Reports(event_log, voice, self._fault),
            MissionSurroundings(lambda _package: None, lambda: None, lambda: False),
            clock,
            nonce,
            LineBudget(),
        )
        if restored is not None and restored.digest:
            self._autopilot.mission.replay(self._prepared, self._now)

    def _asked(self, frame: bytes) -> None:
        """The companion says something to the autopilot."""
        autopilot = self._autopilot
        for answer in self._stand_in.answers(frame):
            self._at(self._now + _ANSWER_S, partial(autopilot.messages.on_message, answer))

    def _fault(self, where: str, text: str) -> None:
        self.replay.faults.append(f"{where}: {text}")

    def _handle(self, event: events.Event, now: float) -> None:
        self._queue.put(event, now)

    def _begin_order(self, now: float) -> None:
        self._autopilot.orders.begin(now)

    def _decide(self, event: events.Event, now: float) -> None:
        if self._failed:
            return
        try:
            actions = self._arbiter.handle(event, now)
        except Exception as error:  # in flight this ends authority, without recovery
            self._failed = True
            self._fault("the rules failed", f"{type(event).__name__}: {type(error).__name__}: {error}")
            self.replay.commanders.append(Commander(now, "", "fault"))
            return
        for action in actions:
            self._perform(action, now)

    def _perform(self, action: events.Action, now: float) -> None:
        match action:
            case events.Send():
                digest = self._arbiter.mission_digest
                if self._ground.there(action.station, now):
                    self._ground.hears(action.station, action.message, digest, now)
            case events.ViewChanged():
                self._in_force(action, now)
            case events.Record():
                self._event_log.record(action, now)
            case events.Advise():  # for people; the recording has the reason
                pass
            case events.Announce():
                self._event_log.decision(action)
            case events.Fly():
                self._autopilot.orders.order(action.action, now)
            case events.BeginStart() | events.StartRefused():  # the recording has its result
                pass
            case events.RehearsalMoved() | events.RehearsalRefused():
                pass
            case events.ControlAnswer() | events.NotifyOwner():
                pass
            case _:
                assert_never(action)

    def _in_force(self, action: events.ViewChanged, now: float) -> None:
        before, self._view = self._view, action.view
        if before.commander == action.view.commander:
            return
        self._autopilot.authority_moved(before, now)
        name = "" if action.view.commander is None else self._arbiter.name(action.view.commander)
        self.replay.commanders.append(Commander(now, name, action.reason.name.lower()))

    # ---- what comes from elsewhere than the autopilot ---------------------------------------------------------------

    def _at(self, at: float, job: Callable[[float], None]) -> None:
        heapq.heappush(self._later, (at, next(self._number), job))

    def _event_at(self, at: float, event: events.Event) -> None:
        self._at(at, lambda now: self._handle(event, now))

    def _message_later(self, station: int, message: Message, at: float) -> None:
        self._event_at(at, events.StationMessage(station, message))

    def _plan(self) -> None:
        """Everything whose time is known before."""
        recording, happened = self._recording, self._happened
        for station in self._names:
            for at in self._beats_of(station):
                self._event_at(at, events.StationHeard(station))
        for at, hand in recording.hands:
            self._event_at(at, hand)
        if not recording.guarded and self._config.limits.guard_required:
            for number in range(int((recording.end - recording.begin) / _GUARD_S) + 1):
                at = recording.begin + number * _GUARD_S
                self._at(at, lambda now: self._handle(events.GuardSeen(GuardState.LIVE, True), now))
        missions = [] if happened is None else happened.mission
        if self.replay.aloft:  # it is held already
            missions = [(at, loaded) for at, loaded in missions if at >= recording.begin]
        elif not missions:
            missions = [(recording.begin, True)]
        for at, loaded in missions:
            self._at(max(at, recording.begin), self._load if loaded else self._drop)
        if happened is not None:
            self._plan_people(happened)

    def _plan_people(self, happened: Happened) -> None:
        for at, name in happened.starts:
            if name in self._sysids:
                self._event_at(at, events.StartRequested(self._sysids[name]))
        for at, ok, text in happened.start_ends:
            if ok and not text.endswith("armed and in AUTO"):
                continue  # it was in the air: the rules see that by themselves
            self._event_at(at, events.StartFinished(ok, text.partition(": ")[2]))
        for at, name, wants in happened.requests:
            if name in self._sysids:
                station = self._sysids[name]
                request = events.ControlRequested(station, wants, True, _CONTROL_TIMEOUT_S, station)
                self._event_at(at, request)
        for at, name, what, text in happened.links:
            if name in self._sysids:
                self._at(at, self._links_changed(self._sysids[name], what, text))

    def _links_changed(self, station: int, what: str, text: str) -> Callable[[float], None]:
        def change(now: float) -> None:
            over = self._weak if what == "link_quality" else self._attacked
            over ^= {station}
            weak, attacked = station in self._weak, station in self._attacked
            self._handle(events.LinkJudged(station, weak, attacked, text.partition(": ")[2]), now)

        return change

    def _beats_of(self, station: int) -> list[float]:
        """The heartbeats that are in the file, and one each second between those."""
        recording = self._recording
        known = recording.station_beats.get(station, [])
        found: list[float] = []
        last = recording.begin - 1.0
        for at in [*known, math.inf]:
            while last + 1.0 < min(at - 0.5, recording.end):
                last += 1.0
                found.append(last)
            if at < math.inf:
                found.append(at)
                last = at
        begins = [until for _since, until in self._ground.silent(station) if recording.begin < until < recording.end]
        return sorted(at for at in {*found, *begins} if self._ground.there(station, at))

    def _load(self, now: float) -> None:
        package = self._prepared.package
        self._autopilot.mission.replay(self._prepared, now)
        word = package.policies.get("on_out_of_coverage")
        self._handle(events.MissionLoaded(package.digest, self._prepared.commanders, word), now)

    def _drop(self, now: float) -> None:
        self._autopilot.mission.drop(now)

    # ---- time -------------------------------------------------------------------------------------------------------

    def run(self) -> Replay:
        """Let it pass."""
        self._plan()
        runs = self._nonces()[1:]
        tick_at = self._now
        down = False
        last_at = self._now
        for at, message in [*self._recording.messages, (self._recording.end + TICK_S, None)]:
            if runs and at >= runs[0][0]:
                self._now = at
                self._begin_run(self._arbiter.snapshot(), runs.pop(0)[1])
                self._log_restart()
                tick_at, down = at, False
            elif runs and at - last_at > _SILENT_S:
                down = True
            last_at = at
            while min(tick_at, self._next_later()) <= at:
                if self._next_later() <= tick_at:
                    due, _number, job = heapq.heappop(self._later)
                    if not down:
                        self._now = max(self._now, due)
                        job(self._now)
                else:
                    self._now = max(self._now, tick_at)
                    tick_at += TICK_S
                    if not down:
                        self._tick(self._now)
            if message is None or down:
                continue
            self._now = max(self._now, at)
            self._take(message, self._now)
        self.replay.assumed_answers = self._ground.assumed
        return self.replay

    def _log_restart(self) -> None:
        self.replay.commanders.append(Commander(self._now, "", "restarted"))

    def _next_later(self) -> float:
        return self._later[0][0] if self._later else math.inf

    def _tick(self, now: float) -> None:
        autopilot = self._autopilot
        autopilot.rounds.tick(now)
        if self._failed:
            return
        due = self._arbiter.next_deadline()
        if due is not None and now >= due:
            self._handle(events.Tick(), now)
        if now >= self._second_at:
            autopilot.rounds.each_second(self._view, self._arbiter.grounded(now), now)
            while self._second_at <= now:
                self._second_at = next(self._beats, self._second_at + 1.0)

    def _take(self, message: Any, now: float) -> None:
        autopilot = self._autopilot
        was_armed = autopilot.aircraft.armed
        if self._started_by_log and message.get_type() == "HEARTBEAT":
            self._begin_by_log(message, was_armed, now)
        self._stand_in.sees(message)
        if message.get_type() not in ANSWERS:
            autopilot.messages.on_message(message, now)
        if autopilot.aircraft.uncompared:
            autopilot.zones.update(now)

    def _begin_by_log(self, message: Any, was_armed: bool, now: float) -> None:
        """START is where the recording arms: its commander is taken to have sent it."""
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        commander = self._view.commander
        if armed and not was_armed and commander is not None:
            self._handle(events.StartRequested(commander), now)
        profile = profile_of(message.autopilot, message.type)
        if armed and profile is not None and message.custom_mode == profile.auto:
            self._handle(events.StartFinished(True), now)


def replay(
    recording: Recording, happened: Happened | None, package: MissionPackage, config: VehicleConfig,
    flown: VehicleConfig,
) -> Replay:  # fmt: skip
    """Let `recording` pass under `config`. `flown`: what it was flown with, as far as known."""
    return _Flight(recording, happened, prepare(package), config, flown).run()

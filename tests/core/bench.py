# SPDX-License-Identifier: GPL-3.0-or-later

"""An arbiter on the bench: a clock that the test turns, stations that live or fall silent, an aircraft that says what
the test wants.

Every half second the living stations' heartbeats come in, they answer CONNECT, and autopilot, guard and position
report. Transfer messages are the test's own. The arbiter gets its ticks exactly at `next_deadline()`. `watch.Watch`
checks the invariants of authority after every event, in every test.
"""

from __future__ import annotations

from collections.abc import Collection

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.events import (
    Action,
    AutopilotState,
    ControlRequested,
    Event,
    Fly,
    GuardSeen,
    MissionLoaded,
    ModeSeen,
    MotionSeen,
    OperatorControlShown,
    PositionSeen,
    Record,
    Send,
    StartFinished,
    StartRequested,
    StationHeard,
    StationMessage,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.handling import STANDS_STILL
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    Message,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import (
    Consent,
    GapFact,
    GuardState,
    Outcome,
    Phase,
    Reason,
    StandingConsent,
    Station,
    ZoneFact,
)
from mavproxy_handover.core.common.snapshot import Snapshot
from tests.core.watch import Watch

A, B, C, D = 251, 252, 253, 254
NAMES = {A: "GCSA", B: "GCSB", C: "GCSC", D: "GCSD"}
STATIONS = tuple(Station(sysid, name) for sysid, name in NAMES.items())
DIGEST = bytes(range(32))
STEP_S = 0.5

#: Transfer 1, from GCSA in epoch 1 to GCSB: the first one of every test.
KEY = TransferKey(A, B, 1, 1)

__all__ = [
    "A",
    "B",
    "C",
    "D",
    "DIGEST",
    "KEY",
    "NAMES",
    "STATIONS",
    "STEP_S",
    "Bench",
    "Connect",
    "ConnectAck",
    "ConnectHandover",
    "Consent",
    "DisconnectHandover",
    "DroneConnected",
    "HandoverRequest",
    "HandoverResult",
    "OkHandover",
    "OnHandover",
    "Outcome",
    "Phase",
    "Reason",
    "TransferKey",
    "far",
    "inside",
    "not_records",
    "outside",
]


def inside(station: int, exit_s: float | None = None, margin_m: float = 100.0) -> ZoneFact:
    """The station's zone holds the aircraft."""
    return ZoneFact(station, margin_m, exit_s)


def outside(station: int, margin_m: float = -100.0) -> ZoneFact:
    """The station's zone does not hold the aircraft."""
    return ZoneFact(station, margin_m, None)


def far(*stations: int) -> tuple[ZoneFact, ...]:
    """Outside all of these."""
    return tuple(outside(station) for station in stations)


def not_records(actions: list[Action]) -> list[Action]:
    """What the edge must do, without what it only writes down, and without the questions to the stations."""
    return [
        action
        for action in actions
        if not isinstance(action, Record) and not (isinstance(action, Send) and isinstance(action.message, Connect))
    ]


class Bench:
    """One arbiter and its surroundings. `alive` and the other attributes may be changed at any time."""

    def __init__(
        self,
        limits: Limits | None = None,
        route: tuple[int, ...] = (A, B, A, B, A),
        nonce: int = 999,
        *,
        standard: Collection[int] = (),
        consent: StandingConsent | None = None,
        shown: bool = True,
    ) -> None:
        """`standard`: stations without a module of ours; `consent`: what the vehicle's file answers for them; `shown`:
        their programs have shown in this run that they know operator control."""
        self.limits = limits or Limits()
        self.standard = frozenset(standard)
        self._consent = consent
        self._nonce = nonce
        self.route = route
        self.now = 100.0
        self._start(None)
        for station in self.standard if shown else ():
            self.arbiter.handle(OperatorControlShown(station), self.now)
        self.alive = {A, B}
        #: stations that hear nothing of the vehicle: they do not answer CONNECT
        self.deaf: set[int] = set()
        self.digests = dict.fromkeys(NAMES, DIGEST)
        self.versions = dict.fromkeys(NAMES, 1)
        self.armed = False
        self.flying = False
        self.autopilot = True
        #: what the autopilot says of its mode and its motion; None: nothing
        self.mode: ModeSeen | None = None
        self.motion: MotionSeen | None = None
        self.guard: GuardSeen | None = GuardSeen(GuardState.LIVE, ours=True)
        #: the gap that the mission declares where the aircraft is
        self.gap: GapFact | None = None
        #: how it carries out an order, and the room that it needs to circle: ahead (s), and on both sides (m)
        self.handling, self.circles_s, self.circle_m = STANDS_STILL, 0.0, 0.0
        self.facts: tuple[ZoneFact, ...] | None = (inside(A), outside(B), outside(C), outside(D))
        #: everything the arbiter asked for, with its time
        self.log: list[tuple[float, Action]] = []
        self._surroundings_at = self.now

    def _start(self, restored: Snapshot | None) -> None:
        stations = tuple(
            Station(sysid, name, sysid in self.standard, self._consent if sysid in self.standard else None)
            for sysid, name in NAMES.items()
        )
        self.arbiter = Arbiter(Identity("drone", stations, A, self._nonce), self.limits, restored)
        automatic = self.standard if self._consent is StandingConsent.AUTOMATIC else ()
        self.watch = Watch(self.arbiter, A, self.limits, standard=self.standard, automatic=automatic, restored=restored)

    # ---- driving --------------------------------------------------------------------------------------------------

    def restart(self, away_s: float = 1.0, snapshot: Snapshot | None = None) -> Bench:
        """The companion dies; after a while one starts from what this one has left behind, or from `snapshot`."""
        left = snapshot or self.arbiter.snapshot()
        self.now += away_s
        self._surroundings_at = max(self._surroundings_at, self.now)
        self._nonce += 1_000_000
        self._start(left)
        self.log.clear()
        return self

    def request(
        self, station: int, *, takeover: bool = False, timeout_s: float = 10.0, give_to: int | None = None
    ) -> ControlRequested:
        """A station's request of control, for itself or for another."""
        return ControlRequested(station, True, takeover, timeout_s, give_to or station)

    def give(self, event: Event) -> list[Action]:
        """Hand over one event now; stations answer CONNECT at once."""
        actions = self.arbiter.handle(event, self.now)
        self.watch.saw(event, actions, self.now)
        self.log += [(self.now, action) for action in actions]
        for action in list(actions):
            if not isinstance(action, Send) or not isinstance(action.message, Connect):
                continue
            if action.station in self.alive - self.deaf - self.standard:
                actions += self.give(StationMessage(action.station, self.ack(action.station, action.message)))
        return actions

    def ack(self, station: int, question: Connect) -> ConnectAck:
        """The station's honest answer to CONNECT."""
        return ConnectAck(
            station,
            self.versions[station],
            question.nonce,
            question.epoch,
            question.commander,
            NAMES[station],
            self.digests[station],
        )

    def back(self, station: int, *, for_good: bool = True) -> list[Action]:
        """A station is heard, and answers what it is asked; for this moment, or from now on."""
        alive = self.alive
        self.alive = alive | {station}
        actions = self.give(StationHeard(station))
        if not for_good:
            self.alive = alive
        return actions

    def say(self, station: int, message: Message) -> list[Action]:
        """A station's message arrives now."""
        return self.give(StationMessage(station, message))

    def rehearsal_needs(self, station: int) -> tuple[str, ...]:
        """What a rehearsal at this station's request lacks now."""
        return self.arbiter._rehearsal.needs(station, self.now)

    def position(self, *facts: ZoneFact) -> list[Action]:
        """The aircraft is here from now on."""
        self.facts = facts
        return self.give(PositionSeen(facts, self.gap))

    def autopilot_says(self, *, armed: bool, flying: bool) -> list[Action]:
        """The autopilot says this from now on."""
        self.armed, self.flying = armed, flying
        return self.give(self._state)

    @property
    def _state(self) -> AutopilotState:
        room = self.circles_s, self.circle_m
        return AutopilotState(self.armed, self.flying, "", self.handling, *room)

    def run(self, duration_s: float) -> list[tuple[float, Action]]:
        """Let time pass; returns what the arbiter asked for meanwhile."""
        mark, until = len(self.log), self.now + duration_s
        while True:
            deadline = self.arbiter.next_deadline()
            self.now = max(self.now, min(until, self._surroundings_at, until if deadline is None else deadline))
            if deadline is not None and deadline <= self.now:
                self.give(Tick())
            elif self._surroundings_at <= self.now:
                self._surroundings_at += STEP_S
                self._surroundings()
            else:
                return self.log[mark:]

    def _surroundings(self) -> None:
        for station in sorted(self.alive):
            self.give(StationHeard(station))
        if self.autopilot:
            # as the companion: what is flown by now first
            for said in (self.mode, self._state, self.motion):
                if said is not None:
                    self.give(said)
        if self.guard is not None:
            self.give(self.guard)
        if self.facts is not None:
            self.give(PositionSeen(self.facts, self.gap))

    # ---- where most tests begin -----------------------------------------------------------------------------------

    def on_ground(self) -> Bench:
        """GCSA commands, the mission is loaded, every need of START is met."""
        self.run(1.0)
        self.give(MissionLoaded(DIGEST, self.route))
        self.run(1.0)
        assert self.arbiter.view.commander == A
        assert self.arbiter.view.phase is Phase.ON_LOAD
        return self

    def on_mission(self) -> Bench:
        """Flying in GCSA's zone alone, after START; the dwell time is over."""
        self.on_ground()
        self.give(StartRequested(A))
        self.autopilot_says(armed=True, flying=False)
        self.give(StartFinished(ok=True))
        self.autopilot_says(armed=True, flying=True)
        self.run(10.0)
        assert self.arbiter.view.commander == A
        assert self.arbiter.view.epoch == 1
        assert self.arbiter.view.phase is Phase.ON_MISSION
        return self

    def in_transfer(self) -> Bench:
        """GCSB's zone has just been entered: transfer 1 has begun and HANDOVER_REQUEST is out."""
        self.on_mission()
        self.log.clear()
        self.position(inside(A), inside(B), outside(C), outside(D))
        assert self.arbiter.view.phase is Phase.ON_HANDOVER
        return self

    def up_to(self, step: str) -> Bench:
        """In transfer 1, at the step `transfer.Step` of this name; nothing is out but what the step has sent."""
        words: dict[str, list[tuple[int, Message]]] = {
            "REQUEST": [],
            "CONSENT": [(B, OnHandover(KEY))],
            "CONNECT": [(B, OnHandover(KEY)), (A, OkHandover(KEY))],
            "CONNECT_FREED": [(B, OnHandover(KEY)), (A, OkHandover(KEY)), (A, DisconnectHandover(KEY))],
            "RELEASE": [(B, OnHandover(KEY)), (A, OkHandover(KEY)), (B, DroneConnected(KEY))],
        }
        self.in_transfer()
        for station, word in words[step]:
            self.say(station, word)
        assert self.arbiter.view.phase is Phase.ON_HANDOVER
        self.log.clear()
        return self

    def commit(self) -> Bench:
        """Transfer 1 is committed: GCSB commands in epoch 2."""
        self.up_to("RELEASE")
        self.say(A, DisconnectHandover(KEY))
        assert self.arbiter.view.commander == B
        return self

    # ---- looking --------------------------------------------------------------------------------------------------

    def sent(self) -> list[tuple[float, int, Message, int]]:
        """Transfer messages so far: time, station, message, attempt."""
        return [
            (at, action.station, action.message, action.attempt)
            for at, action in self.log
            if isinstance(action, Send) and not isinstance(action.message, (Connect, ConnectAck))
        ]

    def flights(self) -> list[Fly]:
        """What the autopilot was commanded so far."""
        return [action for _at, action in self.log if isinstance(action, Fly)]

    def views(self) -> list[ViewChanged]:
        """Changes of the view so far."""
        return [action for _at, action in self.log if isinstance(action, ViewChanged)]

    def records(self, event: str) -> list[Record]:
        """Journal entries of this kind so far."""
        return [action for _at, action in self.log if isinstance(action, Record) and action.event == event]

    def dropped(self) -> dict[str, int]:
        """What was dropped so far, by cause."""
        return dict(self.arbiter.dropped)

# SPDX-License-Identifier: GPL-3.0-or-later

"""A real arbiter and real station cores, connected by queues that lose, delay, double and reorder, in virtual time.

The aircraft is a list of zone visits; links are functions that say what becomes of each message. After every event
`watch.Watch` checks the vehicle, and the network checks what the stations believe.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from math import inf

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.events import (
    Action,
    AutopilotState,
    BordersSeen,
    Event,
    Fly,
    GuardSeen,
    MissionLoaded,
    PositionSeen,
    Record,
    Send,
    StationHeard,
    StationMessage,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import DisconnectHandover, DroneConnected, Message, OkHandover, OnHandover
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    BorderFact,
    Consent,
    GuardState,
    Station,
    ZoneFact,
)
from tests.core.watch import Watch

__all__ = ["TAKE_OFF_S", "Link", "Network", "lossy", "perfect", "scripted"]

PARENT = 251
DIGEST = bytes(range(32))
TAKE_OFF_S = 5.0
POSITION_S = 0.25

#: Says when the copies of one message arrive, in seconds from now; nothing means that it is lost.
Link = Callable[[], Sequence[float]]


def perfect(delay_s: float = 0.001) -> Link:
    """Every message arrives once."""
    return lambda: (delay_s,)


def lossy(seed: int, loss: float, delay_s: float = 0.01, jitter_s: float = 0.0, double: float = 0.0) -> Link:
    """Each message is lost, doubled and delayed by chance; the chance is the same for the same seed."""
    chance = random.Random(seed)

    def fate() -> list[float]:
        copies = 0 if chance.random() < loss else 2 if chance.random() < double else 1
        return [delay_s + chance.random() * jitter_s for _ in range(copies)]

    return fate


def scripted(fates: Sequence[Sequence[float]], then: Link) -> Link:
    """One fate for each message as listed, and after the list the link `then`."""
    listed: Iterator[Sequence[float]] = iter(fates)

    def fate() -> Sequence[float]:
        following = next(listed, None)
        return then() if following is None else following

    return fate


@dataclass
class Network:
    """Run it with `run(until)`; everything else is looked at afterwards.

    `visits`: for each station the times during which its zone holds the aircraft. Up to take-off every link is perfect.
    """

    visits: Mapping[int, Sequence[tuple[float, float]]]
    route: tuple[int, ...]
    air: Link = field(default_factory=perfect)
    #: None: there is no ground link
    ground: Link | None = field(default_factory=perfect)
    limits: Limits = field(default_factory=Limits)
    #: stations whose operator is asked -> his answer, and how long he thinks; None: he never answers
    operators: Mapping[int, tuple[bool, float] | None] = field(default_factory=dict)
    #: from when on a station is dead
    dies: Mapping[int, float] = field(default_factory=dict)
    #: from when on the ground link is dead
    ground_dies: float = inf
    #: the way ahead is known; and how long after it is asked beforehand an operator answers (`operators` says what)
    foresees: bool = False
    early: Mapping[int, float] = field(default_factory=dict)
    #: by the way ahead each border is so much sooner than by the zones
    sooner_s: float = 0.0
    #: from when on the autopilot holds another mission
    rerouted: float = inf

    def __post_init__(self) -> None:
        self.now = 0.0
        stations = [Station(sysid, f"GCS{chr(ord('A') + sysid - PARENT)}") for sysid in sorted(self.visits)]
        self.arbiter = Arbiter(Identity("drone", tuple(stations), PARENT, nonce=7), self.limits)
        self.watch = Watch(self.arbiter, PARENT, self.limits)
        #: when the arbiter's next tick is due
        self._due = inf
        self.cores = {
            station.sysid: gcs.StationCore(
                station,
                "drone",
                tuple(other for other in stations if other is not station),
                automatic=() if station.sysid in self.operators else AUTOMATIC,
            )
            for station in stations
        }
        self.flights: list[tuple[float, Fly]] = []
        self.records: list[tuple[float, Record]] = []
        self.notices: dict[int, list[str]] = {sysid: [] for sysid in self.cores}
        self.over_ground = 0
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._number = count()
        self._consented: dict[int, set[object]] = {sysid: set() for sysid in self.cores}
        self._questions: dict[int, set[object]] = {sysid: set() for sysid in self.cores}
        for sysid, core in self.cores.items():
            core.handle(gcs.MissionHeld(DIGEST), 0.0)
            self._every(1.0, partial(self._beat, sysid), first=0.001 * (sysid - PARENT))
        self._every(1.0, lambda: self._to_all(gcs.VehicleHeard()))
        self._every(0.5, self._status)
        self._every(0.5, lambda: self.give(GuardSeen(GuardState.LIVE, ours=True)))
        self._every(1.0, lambda: self.give(AutopilotState(self.flying, self.flying)))
        self._every(POSITION_S, lambda: self.give(PositionSeen(self._facts())))
        if self.foresees:
            self._every(1.0, lambda: self.give(BordersSeen(self._borders(), int(self.now >= self.rerouted))), first=0.5)
        self._at(2.0, lambda: self.give(MissionLoaded(DIGEST, self.route)))

    # ---- time -----------------------------------------------------------------------------------------------------

    @property
    def flying(self) -> bool:
        return self.now >= TAKE_OFF_S

    def _at(self, when: float, job: Callable[[], None]) -> None:
        heapq.heappush(self._queue, (when, next(self._number), job))

    def _every(self, pause_s: float, job: Callable[[], None], first: float = 0.0) -> None:
        def again(times: int) -> None:
            job()
            self._at(first + (times + 1) * pause_s, lambda: again(times + 1))

        self._at(first, lambda: again(0))

    def run(self, until: float) -> Network:
        """Let time pass up to `until`."""
        while True:
            due = max(self._due, self.now)
            if self._queue and self._queue[0][0] <= min(due, until):
                when, _number, job = heapq.heappop(self._queue)
                self.now = max(self.now, when)
                job()
            elif due <= until:
                self.now = due
                self.give(Tick())
            else:
                self.now = until
                return self

    # ---- the vehicle ----------------------------------------------------------------------------------------------

    def give(self, event: Event) -> None:
        """One event for the arbiter, now."""
        actions = self.arbiter.handle(event, self.now)
        deadline = self.arbiter.next_deadline()
        self._due = inf if deadline is None else deadline
        self.watch.saw(event, actions, self.now)
        for action in actions:
            self._carry_out(action)
        self._check_beliefs()

    def _carry_out(self, action: Action) -> None:
        if isinstance(action, Send):
            self._to_station(action.station, gcs.FromVehicle(action.message))
        elif isinstance(action, ViewChanged):
            self._status()
        elif isinstance(action, Fly):
            self.flights.append((self.now, action))
        elif isinstance(action, Record):
            self.records.append((self.now, action))

    def _status(self) -> None:
        view = self.arbiter.view
        self._to_all(
            gcs.AuthorityHeard(
                view.phase,
                view.commander,
                view.partner,
                view.epoch,
                view.handover_id,
                why=view.why,
                crossing=view.crossing,
            )
        )

    def _facts(self) -> tuple[ZoneFact, ...]:
        facts = []
        for station, times in self.visits.items():
            left = next((end for begin, end in times if begin <= self.now < end), None)
            left_s = None if left is None else left - self.now
            facts.append(ZoneFact(station, -50.0 if left is None else 50.0, left_s, left_s))
        return tuple(facts)

    def _borders(self) -> tuple[BorderFact, ...]:
        if not self.flying:
            return ()
        times = sorted({time for visits in self.visits.values() for visit in visits for time in visit})
        found = []
        for number, at in enumerate(times):
            if self.now < at - self.sooner_s <= self.now + 45.0:
                holding = {s for s, visits in self.visits.items() if any(begin <= at < end for begin, end in visits)}
                found.append(BorderFact(number, at - self.sooner_s - self.now, frozenset(holding)))
        return tuple(found)

    # ---- the stations ---------------------------------------------------------------------------------------------

    def alive(self, sysid: int) -> bool:
        return self.now < self.dies.get(sysid, inf)

    def _beat(self, sysid: int) -> None:
        if not self.alive(sysid):
            return
        self._to_vehicle(StationHeard(sysid))
        for other in self.cores:
            if other != sysid:
                self._over_ground(other, gcs.PeerHeard(sysid))
        self._perform(sysid, self.cores[sysid].tick(self.now))

    def _station(self, sysid: int, event: gcs.Event) -> None:
        if not self.alive(sysid):
            return
        core = self.cores[sysid]
        epoch = core.epoch
        self._perform(sysid, core.handle(event, self.now))
        assert core.epoch >= epoch
        question = core.question
        if question is not None and question not in self._questions[sysid]:
            self._questions[sysid].add(question)
            answer = self.operators[sysid]
            if answer is not None:
                yes, after_s = answer
                self._at(self.now + after_s, lambda: self._answer(sysid, question, yes))
        asked, answer = core.asked_ahead, self.operators.get(sysid)
        if asked is not None and asked not in self._questions[sysid] and sysid in self.early and answer is not None:
            self._questions[sysid].add(asked)
            yes = answer[0]
            self._at(self.now + self.early[sysid], lambda: self._answer(sysid, asked, yes))
        self._check_beliefs()

    def _answer(self, sysid: int, question: object, yes: bool) -> None:
        core = self.cores[sysid]
        if question in (core.question, core.asked_ahead):
            self._station(sysid, gcs.Answer(yes))

    def _perform(self, sysid: int, actions: list[gcs.Action]) -> None:
        for action in actions:
            if isinstance(action, gcs.ToVehicle):
                self._check_word(sysid, action.message)
                self._to_vehicle(StationMessage(sysid, action.message))
            elif isinstance(action, gcs.ToPeer):
                self._check_word(sysid, action.message)
                self.over_ground += 1
                self._over_ground(action.peer, gcs.FromPeer(sysid, action.message))
            else:
                self.notices[sysid].append(action.text)

    def _check_word(self, sysid: int, message: Message) -> None:
        """A station releases only what it has consented to, and says nothing but its own words."""
        if isinstance(message, (OnHandover, DroneConnected)):
            assert message.key.to_station == sysid
            assert not message.relayed
        if isinstance(message, OkHandover) and message.consent is Consent.GRANTED:
            self._consented[sysid].add(message.key)
        if isinstance(message, DisconnectHandover):
            assert message.key in self._consented[sysid]

    def _check_beliefs(self) -> None:
        """Two stations never command in the same epoch, and no station is ahead of the vehicle."""
        view = self.arbiter.view
        for sysid, core in self.cores.items():
            assert core.epoch <= view.epoch
            if core.role is gcs.Role.COMMANDER and core.epoch == view.epoch:
                assert view.commander in (sysid, None)

    # ---- the links ------------------------------------------------------------------------------------------------

    def _deliver(self, link: Link, job: Callable[[], None]) -> None:
        for delay_s in link() if self.flying else (0.001,):
            self._at(self.now + delay_s, job)

    def _to_station(self, sysid: int, event: gcs.Event) -> None:
        self._deliver(self.air, lambda: self._station(sysid, event))

    def _to_all(self, event: gcs.Event) -> None:
        for sysid in self.cores:
            self._to_station(sysid, event)

    def _to_vehicle(self, event: Event) -> None:
        self._deliver(self.air, lambda: self.give(event))

    def _over_ground(self, sysid: int, event: gcs.Event) -> None:
        if self.ground is not None and self.now < self.ground_dies:
            self._deliver(self.ground, lambda: self._station(sysid, event))

    # ---- looking --------------------------------------------------------------------------------------------------

    def commits(self) -> list[tuple[int, int, int]]:
        """Changes from one station to another: from, to, new epoch."""
        return [(old, new, epoch) for _at, old, new, epoch in self.watch.moves if old is not None and new is not None]

    def durations(self) -> list[float]:
        """How long each committed transfer took, in seconds."""
        return [r.duration_s or 0.0 for _at, r in self.records if r.event == "transfer_committed"]

    def said(self, event: str) -> list[str]:
        """Texts of the vehicle's journal entries of this kind."""
        return [record.text for _at, record in self.records if record.event == event]

    def agreed(self) -> bool:
        """Whether all living stations believe what the vehicle says."""
        view = self.arbiter.view
        return all(
            (core.commander, core.epoch, core.partner) == (view.commander, view.epoch, view.partner)
            for sysid, core in self.cores.items()
            if self.alive(sysid)
        )

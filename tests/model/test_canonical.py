# SPDX-License-Identifier: GPL-3.0-or-later

"""What the explorer works with behaves like the real objects.

The explorer takes states apart, makes times and numbers relative, and looks results up. Here the same schedules are
played, beside it, to an arbiter and to stations that are never taken apart, whose clock runs on and whose numbers grow:
after every event both must be in the same state and have sent the same.
"""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.events import StationMessage, Tick
from mavproxy_handover.core.common.messages import ConnectAck
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    UNASKED,
    Phase,
    Station,
)
from mavproxy_handover.core.common.snapshot import Snapshot
from tests.model.canonical import EPOCH, NOW, NUMBER, Packer, Shift, shifted
from tests.model.nodes import DIGEST
from tests.model.setting import FAULTS, LIMITS, PARENT, Fault, Request, Setting
from tests.model.steps import Graph
from tests.model.world import DEAD, State

#: whole seconds, so that no sum is rounded
START_S = 123_456.0
FIRST_EPOCH = 5000
FIRST_NUMBER = 20_000


class Shadow:
    """Plays to real objects what a graph does, and compares. One way through the graph only."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.now = START_S
        self.epochs, self.numbers = FIRST_EPOCH - EPOCH, FIRST_NUMBER - NUMBER
        self.compared = 0
        self._packer = Packer(graph.setting.limits, {station.sysid: station.name for station in graph.stations})
        self._identity = Identity("drone", graph.stations, PARENT)
        nobody = Snapshot(None, FIRST_EPOCH - 1, FIRST_NUMBER, Phase.ON_LOAD, 0, b"", ())
        self.arbiter = Arbiter(self._identity, graph.setting.limits, nobody)
        self.arbiter._authority._may_be_ahead.update(self.arbiter._presence)  # as in a first run, but for the numbers
        self.cores: dict[int, gcs.StationCore] = {}
        self._originals = (graph.vehicles.step, graph.vehicles.later, graph.vehicles.up, graph.cores.step)
        graph.vehicles.step = self._step  # type: ignore[method-assign]
        graph.vehicles.later = self._later  # type: ignore[method-assign]
        graph.vehicles.up = self._up  # type: ignore[method-assign]
        graph.cores.step = self._station  # type: ignore[method-assign]
        graph.story = []  # nothing is looked up: every step is made

    def _shift(self) -> Shift:
        return Shift(self.now - NOW, self.epochs, self.numbers)

    def _real(self, event: Any) -> Any:
        """The event with the numbers of the real objects."""
        event = shifted(event, Shift(0.0, -self.epochs, -self.numbers))
        if isinstance(event, StationMessage) and isinstance(event.message, ConnectAck) and event.message.nonce:
            asked = self.arbiter._presence[event.station].asked
            event = replace(event, message=replace(event.message, nonce=asked[-1][0] if asked else 1))
        return event

    def _step(self, number: int, event: int) -> Any:
        real = self._real(self.graph.events.values[event])
        result = self._originals[0](number, event)
        actions = self.arbiter.handle(real, self.now)
        while (self.arbiter.next_deadline() or self.now + 1) <= self.now:
            actions += self.arbiter.handle(Tick(), self.now)
        self.epochs += result[2].epoch
        self.numbers += result[2].number
        assert self._packer.pack_arbiter(self.arbiter, self._shift()) == self.graph.vehicles[result[0]].packed
        sent = tuple(self.graph.vehicles._parcels(actions, Shift(0.0, self.epochs, self.numbers)))
        assert sent == result[1]
        self.compared += 1
        return result

    def _later(self, number: int) -> int:
        self.now += 1.0
        for core in self.cores.values():
            core.tick(self.now)
        return self._originals[1](number)

    def _up(self, number: int, *, blank: bool = False) -> Any:
        result, shift = self._originals[2](number, blank=blank)
        self.arbiter = Arbiter(self._identity, self.graph.setting.limits, None if blank else self.arbiter.snapshot())
        self.epochs += shift.epoch
        self.numbers += shift.number
        return result, shift

    def _station(self, number: int, event: int) -> Any:
        index, packed, _books = self.graph.cores._states.values[number]
        if number == self.graph._fresh[index] or index not in self.cores:  # it has just started
            self.cores[index] = self._new_core(index)
        core = self.cores[index]
        assert self._packer.pack_station(core, self._shift()) == packed
        core.handle(self._real(self.graph.events.values[event]), self.now)
        result = self._originals[3](number, event)
        assert self._packer.pack_station(core, self._shift()) == self.graph.cores._states.values[result[0]][1]
        self.compared += 1
        return result

    def _new_core(self, index: int) -> gcs.StationCore:
        station: Station = self.graph.stations[index]
        letter = "ABC"[index]
        peers = tuple(other for other in self.graph.stations if other is not station)
        setting = self.graph.setting
        automatic = () if letter in setting.forced else UNASKED if letter in setting.operators else AUTOMATIC
        core = gcs.StationCore(station, "drone", peers, automatic=automatic)
        core.handle(gcs.MissionHeld(DIGEST), self.now)
        return core


WALKS = (
    Setting("faults", path=("A", "AB", "B", "AB", "A"), faults=12, kinds=FAULTS | {Fault.WEAK, Fault.LIE}),
    Setting("operators", path=("A", "AB"), faults=6, operators="AB", requests=10, wishes=frozenset(Request)),
    Setting("three", stations=3, path=("A", "AB", "ABC", "BC", "C"), faults=10),
    Setting("ground", path=("_A", "A", "AB", "_B"), faults=6, requests=6, wishes=frozenset(Request)),
)


def walk(graph: Graph, seed: int, steps: int) -> None:
    """One way through the graph, by chance; what moves things on is more likely than what goes wrong."""
    chance = random.Random(seed)
    state: State = graph.root()
    for _ in range(steps):
        labels = list(graph.labels(state))
        usual = [label for label in labels if label[0] not in ("fault", "request", "move")]
        label = chance.choice(usual if usual and chance.random() < 0.85 else labels)
        state = graph.follow(state, label)


@pytest.mark.parametrize("setting", WALKS, ids=lambda setting: setting.name)
def test_a_state_taken_apart_and_put_together_behaves_like_the_original(setting: Setting) -> None:
    compared = 0
    for seed in range(2):
        graph = Graph(setting)
        shadow = Shadow(graph)
        walk(graph, seed, 120)
        compared += shadow.compared
    assert compared > 1250


def test_whoever_adds_a_field_to_the_rules_is_asked_what_it_is() -> None:
    station = Station(PARENT, "GCSA")
    arbiter = Arbiter(Identity("drone", (station,), PARENT), LIMITS)
    arbiter._new = 1.0  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match=r"say in canonical\.py what _new is"):
        Packer(LIMITS, {PARENT: "GCSA"}).pack_arbiter(arbiter)


def test_what_can_not_matter_makes_no_new_state() -> None:
    packer = Packer(LIMITS, {PARENT: "GCSA"})
    station = Station(PARENT, "GCSA")
    one, other = (Arbiter(Identity("drone", (station,), PARENT), LIMITS) for _ in range(2))
    one.handle(Tick(), NOW)
    other.handle(Tick(), NOW + 100.0)
    assert packer.pack_arbiter(one, Shift(0.0)) == packer.pack_arbiter(other, Shift(100.0))
    assert packer.pack_arbiter(one, Shift(0.0)) != packer.pack_arbiter(other, Shift(99.0))


def test_a_dead_station_takes_no_part() -> None:
    graph = Graph(Setting("dead", faults=1))
    state = graph.root()
    dead = graph.follow(state, ("fault", Fault.KILL_STATION, 0))
    assert dead.stations[0] == DEAD
    assert graph.follow(dead, ("tick",)).stations[0] == DEAD

# SPDX-License-Identifier: GPL-3.0-or-later

"""Breadth first through a `Graph`: every state that a setting's schedules can lead to, each looked at once.

From every state the world is also run on with nothing more going wrong (`_settle`): then a transfer must end within a
bounded time, everybody must agree in the end, and whoever can command does. What is found to settle is remembered, so
this costs little more than the exploration itself.

The first violation found ends the exploration. Since it is breadth first, no shorter schedule leads to it; it is told
as a story, step by step.
"""

from __future__ import annotations

import gc
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from mavproxy_handover.core.common.model import LeaseState, Phase, StandingConsent
from tests.model.checks import Violation, demand
from tests.model.steps import Graph, Label
from tests.model.world import DEAD, State

#: the fields of a state that healing leaves
HEALABLE = State._fields.index("cuts")

__all__ = ["Found", "Report", "explore"]


@dataclass(frozen=True, slots=True)
class Found:
    """A violation: what, and the shortest schedule that leads to it, one line a step."""

    what: str
    story: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join((*self.story, f"VIOLATION: {self.what}"))


@dataclass(frozen=True, slots=True)
class Report:
    """What an exploration saw."""

    setting: str
    states: int
    transitions: int
    #: every schedule of so many steps was followed
    depth: int
    #: no longer schedule leads to a new state
    complete: bool
    vehicle_states: int
    station_states: int
    #: events that the real objects have worked on
    handled: int
    #: most ticks that a transfer took to end with nothing more going wrong
    longest_s: int
    processor_s: float
    found: Found | None

    @property
    def extent(self) -> str:
        """How far the exploration went, in words."""
        if self.found is not None:
            return "violated"
        return f"all, depth {self.depth}" if self.complete else f"complete to depth {self.depth}"

    def __str__(self) -> str:
        return (
            f"{self.setting}: {self.extent}: {self.states} states, {self.transitions} transitions; "
            f"{self.vehicle_states} states of the vehicle, {self.station_states} of stations, {self.handled} events "
            f"handled by the real objects; a transfer ends within {self.longest_s} s; {self.processor_s:.1f} s"
        )


class _Stop(Exception):
    """A violation: from which state, and after which steps from there. `healed`: that state, with all links healed."""

    def __init__(self, what: str, start: State, labels: list[Label], *, healed: bool = False) -> None:
        super().__init__(what)
        self.what, self.start, self.labels, self.healed = what, start, labels, healed


class _Settling:
    """Runs states on with nothing more going wrong, and judges how they end."""

    #: steps; nothing takes as many to come to rest
    LIMIT = 2000

    def __init__(self, world: Graph) -> None:
        self._world = world
        limits = world.setting.limits
        operators = world.setting.operators or world.setting.forced or world.setting.standard or world.setting.requests
        asked = 2 * limits.operator_timeout_s if operators else 0
        #: a step may last its time-out, and a transfer has at most four before its release
        self.bound_s = int(4 * limits.step_timeout_s + limits.release_timeout_s + asked)
        #: commanders from which the vehicle's file refuses planned handovers
        self._keeping = frozenset(s.sysid for s in world.stations if s.consent is StandingConsent.REFUSE)
        #: state -> ticks until its transfer has ended
        self._known: dict[State, int] = {}
        #: states judged, whatever is cut in them and may still go wrong
        self._judged: set[tuple[object, ...]] = set()
        self.longest_s = 0

    def judge(self, state: State) -> None:
        """Raise `_Stop` if this state, healed, does not end as it should."""
        what_counts = state[:HEALABLE]
        if what_counts in self._judged:
            return
        self._judged.add(what_counts)
        dead = DEAD in state.stations
        for revived in (False, True) if dead else (False,):
            try:
                healed = self._world.healed(state, revived=revived)
            except Violation as violation:
                raise _Stop(str(violation), state, [], healed=True) from None
            self._run(healed)

    def _run(self, start: State) -> None:
        path: dict[State, Label] = {}
        state = start
        try:
            while (rest := self._known.get(state)) is None:
                label = self._world.next_quietly(state)
                path[state] = label
                following = self._world.follow(state, label)
                self._world.check(following)
                if following == state:
                    self._at_rest(state)
                    rest = 0
                    break
                demand(following not in path, "it goes round in circles and never comes to rest")
                demand(len(path) < self.LIMIT, "it never comes to rest")
                state = following
            for before, label in reversed(path.items()):
                busy = self._world.vehicles[before.vehicle].view.partner is not None
                rest = rest + (label == ("tick",)) if busy else 0
                demand(rest <= self.bound_s, f"a transfer does not end within {self.bound_s} s")
                self._known[before] = rest
                self.longest_s = max(self.longest_s, rest)
        except Violation as violation:
            raise _Stop(str(violation), start, list(path.values()), healed=True) from None

    def _at_rest(self, state: State) -> None:
        """Nothing moves any more: is all as it should be?"""
        world = self._world
        vehicle = world.vehicles[state.vehicle]
        view, books = vehicle.view, vehicle.books
        living = {world.sysids[index] for index in range(world.count) if world.alive(state, index)}
        demand(view.partner is None, f"at rest with a transfer under way: {view}")
        demand(view.lease in (LeaseState.HELD, LeaseState.LOST), f"at rest, and the lease is {view.lease.name}")
        for each in state.stations:
            if each != DEAD:
                belief = world.cores.beliefs[each]
                agreed = (belief.commander, belief.epoch) == (view.commander, view.epoch)
                demand(agreed, f"station {belief.station} believes {belief.commander} commands, the vehicle has {view}")
        if books.blank:
            demand(view.commander is None, "the state file was lost, and somebody commands in flight")
            return
        holding = (living - self._keeping) & books.zones  # those are never partner
        if books.had in living or (books.had is not None and holding and books.flying):
            demand(view.commander is not None, f"no station commands, though {sorted(living)} live")
        if view.commander is None:
            return
        demand(view.commander in living, f"station {view.commander} commands, and is dead")
        if view.commander in self._keeping:  # the vehicle's file has it keep the aircraft
            return
        if books.flying and vehicle.loaded and view.commander not in books.zones:
            demand(not holding, f"station {view.commander} commands outside its zone; {sorted(holding)} could")
        if view.commander in books.ending and vehicle.loaded and books.flying:
            demand(not holding - books.ending, f"station {view.commander} commands on, and its zone is about to end")
        owed = (books.entered & living) - {view.commander} if vehicle.loaded else set()
        demand(not owed, f"station {view.commander} commands on, though the zones of {sorted(owed)} were entered")
        if books.flying and books.zones:
            # who is in zones whose stations are all gone, and not in its commander's, is brought home; and so is who
            # was held and taken by nobody, or has energy for nothing else
            stays = view.commander in books.zones and not (books.held or books.stood) and books.short is None
            expected = Phase.ON_MISSION if stays else Phase.EMERGENCY
            demand(view.phase is expected, f"at rest in {view.phase.name}")


def explore(world: Graph, progress: Callable[[str], None] | None = None, states_limit: int | None = None) -> Report:
    """Explore; `progress` is told now and then.

    `states_limit`: the exploration ends at the state in which so many are known, and is not complete.
    """
    collecting = gc.isenabled()
    gc.disable()  # a great many tuples, and no cycles among them
    try:
        return _explore(world, progress, states_limit)
    finally:
        if collecting:
            gc.enable()


def _explore(world: Graph, progress: Callable[[str], None] | None, states_limit: int | None) -> Report:
    begun = told = time.perf_counter()
    processor_begun = time.process_time()
    setting = world.setting
    order: list[State] = [world.root()]
    seen: set[State] = set(order)
    came_from = array("q", [-1])
    settling = _Settling(world)
    parts: dict[object, object] = {}
    transitions, depth, layer_end, at = 0, 0, 1, 0
    complete, found = True, None
    try:
        while at < len(order):
            if at == layer_end:
                depth, layer_end = depth + 1, len(order)
            if depth == setting.depth or (states_limit is not None and len(order) >= states_limit):
                complete = False
                break
            state = order[at]
            settling.judge(state)
            for label in world.labels(state):
                transitions += 1
                following = _followed(world, state, label)
                if following not in seen:
                    _checked(world, state, label, following)
                    following = _slim(following, parts)
                    seen.add(following)
                    order.append(following)
                    came_from.append(at)
            at += 1
            if progress is not None and time.perf_counter() - told > 5.0:
                told = time.perf_counter()
                waiting = len(order) - at
                progress(f"{setting.name}: {told - begun:.0f} s, {len(order)} states, depth {depth}, {waiting} waiting")
    except _Stop as stop:
        complete = False
        found = Found(stop.what, tuple(_Story(world).tell(order, came_from, at, stop)))
    return Report(
        setting.name,
        len(order),
        transitions,
        depth,
        complete,
        len(world.vehicles),
        len(world.cores),
        world.vehicles.handled + world.cores.handled,
        settling.longest_s,
        time.process_time() - processor_begun,
        found,
    )


def _slim(state: State, parts: dict[object, object]) -> State:
    """The same state, made of parts that other states are made of: it takes half the memory."""
    return State._make([parts.setdefault(part, part) if part.__class__ is tuple else part for part in state])


def _followed(world: Graph, state: State, label: Label) -> State:
    try:
        return world.follow(state, label)
    except Violation as violation:
        raise _Stop(str(violation), state, [label]) from None


def _checked(world: Graph, state: State, label: Label, following: State) -> None:
    try:
        world.check(following)
    except Violation as violation:
        raise _Stop(str(violation), state, [label]) from None


class _Story:
    """Makes the steps that lead to a violation once more, and writes down what everybody does."""

    def __init__(self, world: Graph) -> None:
        self._world = world
        self._lines: list[str] = []
        self._steps = 0

    def tell(self, order: list[State], came_from: array[int], at: int, stop: _Stop) -> list[str]:
        """The story, one line for each step and below it what came of it."""
        indices = [at]
        while came_from[indices[-1]] >= 0:
            indices.append(came_from[indices[-1]])
        states = [order[index] for index in reversed(indices)]
        for state, following in pairwise(states):
            labels = self._world.labels(state)
            self._step(state, next(label for label in labels if self._world.follow(state, label) == following))
        if stop.healed:
            self._lines.append("-- from here on nothing more goes wrong, what is down comes up --")
        state = stop.start
        for label in stop.labels:
            after = self._step(state, label)
            if after is None:
                break
            state = after
        return self._lines

    def _step(self, state: State, label: Label) -> State | None:
        self._steps += 1
        self._lines.append(f"{self._steps:3} {self._world.describe(label)}")
        story: list[str] = []
        self._world.story = story
        try:
            return self._world.follow(state, label)
        except Violation:
            return None
        finally:
            self._world.story = None
            self._lines += [f"      {line}" for line in story]

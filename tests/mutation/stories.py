# SPDX-License-Identifier: GPL-3.0-or-later

"""Is a fault that no test notices one? This looks for a story in which the core with it does otherwise:

    python tests/mutation/stories.py [--stories N] [--only TEXT] MODULE

A story is what happens around the bench of `tests/core`: stations that die, positions, modes, hands, restarts; by
chance, and the same for every fault. Where it differs what the core asks for, its deadline, or what it leaves to the
next run, the story is shortened to the steps that it takes and printed: that is the test that is missing. A fault that
shows in no story may still show in another one; why it is none belongs into `core_survivors.py`.
"""

from __future__ import annotations

import argparse
import importlib
import random
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from types import SimpleNamespace
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation import core  # noqa: E402
from tests.mutation.faults import STATION, faults, file_of, source_of  # noqa: E402
from tests.mutation.run import _Mutated, in_child, limit  # noqa: E402

__all__ = ["Difference", "Story", "find", "main", "player", "shorten", "story"]

#: a step of a story: what, and with what
Step = tuple[str, Any]
Player = Callable[["Story"], Iterator[str]]

#: what has to be there once for the core with the fault, and once for the one without
OWN = ("mavproxy_handover.core", "mavproxy_handover.vehicle", "mavproxy_handover.wire", "sitl.campaign", "tests.core")
#: so much of its own time (s) one story takes at most: a fault may turn in circles
STORY_S = 30.0
FLOWN = ("HANDS", "MISSION", "GUIDED", "STOP", "RETURN", "LAND", "OTHER")
#: where the aircraft is: station, margin (m), how soon its zone ends (s), what holds it there; who is not named is far
WHERE: dict[str, tuple[tuple[str, float, float | None, str], ...]] = {
    "in A": (("A", 100.0, None, ""),),
    "deep in A": (("A", 300.0, None, ""),),
    "at the border of A": (("A", 3.0, None, ""),),
    "A ends": (("A", 40.0, 3.0, ""),),
    "A ends, B begins": (("A", 40.0, 3.0, "AB"),),
    "A ends in B": (("A", 40.0, 3.0, "B"), ("B", 100.0, None, "")),
    "in A and B": (("A", 100.0, None, ""), ("B", 100.0, None, "")),
    "in B": (("B", 100.0, None, ""),),
    "B ends": (("B", 40.0, 3.0, ""),),
    "nowhere": (),
}
#: weight and choices of each step; those of a mode and of a hand name what is flown
STEPS: dict[str, tuple[float, tuple[Any, ...]]] = {
    "run": (30.0, (0.1, 0.5, 1.0, 2.5, 4.0, 6.0, 12.0, 20.0, 35.0)),
    "where": (12.0, (*WHERE, "A ends", "A ends", None)),
    "mode": (7.0, FLOWN),
    "radio": (2.0, (True, False)),
    "hand": (8.0, tuple((hand, f) for hand in ("COMMANDER", "COMMANDER", "FAILSAFE", "GUARD") for f in (*FLOWN, None))),
    "motion": (
        5.0,
        (None, (0.0, 0.0, 300.0), (0.0, 1.0, 100.0), (8.0, 0.0, 10.0), (0.0, -1.0, 5.0), (12.0, 0.0, None)),
    ),
    "obeys": (1.0, (True, True, False)),
    "alive": (3.0, ("A", "AB", "AB", "ABC", "B", "")),
    "deaf": (1.0, ("", "", "A", "B")),
    "autopilot": (3.0, (True, False)),
    "guard": (2.0, (None, "LIVE", "LIVE", "DISABLED")),
    "gap": (2.0, (None, (20.0, False), (20.0, True), (5.0, False))),
    "signs": (4.0, ((), (), ("energy",), ("off_route",), ("fence",))),
    "place": (3.0, (("home", True), ("home", False), ("rally 2", True))),
    "link": (2.0, (("A", True, False), ("A", False, False), ("A", False, True), ("B", True, False))),
    "word": (4.0, ("ready", "waits", "agreed", "connected", "released")),
    "control": (1.0, ("A", "B", "C")),
    "flying": (0.5, ((True, True), (True, False), (False, False))),
    "restart": (3.0, (0.5, 1.0, 5.0, 70.0)),
    "rehearsal": (1.0, (True, False)),
}


@dataclass(frozen=True)
class Story:
    """What happens, how it begins ("mission", "ground", "rehearsal"), and which aircraft and configuration it has."""

    steps: tuple[Step, ...]
    begin: str = "mission"
    kind: str = "COPTER"
    policies: tuple[tuple[str, str], ...] = ()
    hold_s: float = 60.0


@dataclass(frozen=True)
class Difference:
    """The shortest story found, and what the core and the core with the fault say behind its last step."""

    story: Story
    without: str
    with_it: str


def story(seed: int) -> Story:
    """The same story for the same seed."""
    chance = random.Random(seed)
    causes = importlib.import_module("mavproxy_handover.core.common.causes").CAUSES
    policies = {cause.name: chance.choice(row.policies) for cause, row in causes.items() if chance.random() < 0.3}
    # each story dwells on a few things
    weights = [weight * chance.choice((0.2, 1.0, 1.0, 2.0)) for weight, _choices in STEPS.values()]
    names = chance.choices(list(STEPS), weights, k=chance.choice((8, 15, 30, 50)))
    return Story(
        tuple((name, chance.choice(STEPS[name][1])) for name in names),
        chance.choice(("mission",) * 8 + ("ground", "rehearsal")),
        chance.choice(("COPTER",) * 4 + ("QUADPLANE", "PLANE")),
        tuple(sorted(policies.items())),
        chance.choice((5.0, 60.0, 60.0, 600.0)),
    )


# ---- how one is played -----------------------------------------------------------------------------------------------


def player(module: str = "", source: str | None = None) -> Player:
    """Plays stories with a core of its own, in which `module` has that source. Nothing it has raised gets out."""
    for name in [name for name in sys.modules if name.startswith(OWN)]:
        del sys.modules[name]
    finder = None
    if source is not None:
        path = file_of(module)
        finder = _Mutated(".".join(path.relative_to(ROOT).with_suffix("").parts), source, path)
        sys.meta_path.insert(0, finder)
    try:
        found = SimpleNamespace(
            **{
                name.rpartition(".")[2]: importlib.import_module(name)
                for name in (
                    "tests.core.bench",
                    "mavproxy_handover.core.common.events",
                    "mavproxy_handover.core.common.limits",
                    "mavproxy_handover.core.common.model",
                    "mavproxy_handover.core.common.causes",
                    "mavproxy_handover.vehicle.profiles",
                )
            }
        )
    finally:
        if finder is not None:
            sys.meta_path.remove(finder)
    world = _world(found)

    def play(told: Story) -> Iterator[str]:
        try:
            bench = _begun(world, found, told)
            for step, choice in told.steps:
                mark = 0 if step == "restart" else len(bench.log)
                _act(bench, found, step, choice)
                arbiter = bench.arbiter
                said = [
                    *bench.log[mark:],
                    arbiter.snapshot(),
                    arbiter.next_deadline(),
                    sorted(map(str, arbiter.causes)),
                ]
                yield "\n".join(map(repr, said))
        except Exception as error:  # with a fault that is a difference; without one, this bench is broken
            if source is None:
                raise
            yield f"{type(error).__name__}: {error}"

    return play


def _world(found: SimpleNamespace) -> Any:
    """The bench with an aircraft that does what it is commanded, or does not."""
    events, action, flown = found.events, found.model.FlightAction, found.model.ModeClass

    class World(found.bench.Bench):  # type: ignore[misc, name-defined]
        obeys, speed_mps, left_m = True, 8.0, 600.0

        def give(self, event: Any) -> Any:
            actions = super().give(event)
            for each in actions:
                if isinstance(each, events.Fly) and self.obeys:
                    self.obey(each.action)
            return actions

        def obey(self, order: Any) -> None:
            modes = {action.RETURN: flown.RETURN, action.LAND: flown.LAND}
            if self.handling.by_mode:
                modes |= {action.HOLD: flown.STOP, action.CONTINUE: flown.MISSION}
            if order in modes:
                self.flies(modes[order])
            self.speed_mps = 0.0 if order is action.HOLD else 8.0
            self.moves()

        def flies(self, mode: Any, radio: bool | None = None) -> None:
            radio = self.mode.radio if radio is None else radio
            self.mode = events.ModeSeen(mode, mode.name, mode is flown.LAND, radio)

        def moves(self) -> None:
            down = self.mode.flown is flown.LAND
            self.motion = events.MotionSeen(0.0 if down else self.speed_mps, -1.0 if down else 0.0, self.left_m)

        def _surroundings(self) -> None:
            if self.obeys and self.motion is not None:
                self.left_m = max(0.0, self.left_m - self.speed_mps / 2.0)
                self.moves()
            super()._surroundings()

    return World


def _begun(world: Any, found: SimpleNamespace, told: Story) -> Any:
    policies = {found.causes.Cause[cause]: policy for cause, policy in told.policies}
    bench = world(found.limits.Limits(policies=policies, hold_s=told.hold_s))
    bench.handling = getattr(found.profiles, told.kind).handling
    if told.kind != "COPTER":
        bench.circles_s, bench.circle_m = 8.0, 80.0
    bench.mode = found.events.ModeSeen(found.model.ModeClass.MISSION, "MISSION")
    bench.moves()
    if told.begin == "mission":
        return bench.on_mission()
    bench.on_ground()
    if told.begin == "rehearsal":
        bench.give(found.events.RehearsalAsked(found.bench.A, True))
        bench.run(10.0)
    return bench


def _act(bench: Any, found: SimpleNamespace, step: str, choice: Any) -> None:
    events, model = found.events, found.model
    stations = {"A": found.bench.A, "B": found.bench.B, "C": found.bench.C}
    match step:
        case "run":
            bench.run(choice)
        case "where":
            bench.facts = None if choice is None else _facts(found, stations, WHERE[choice])
            if bench.facts is not None:
                bench.position(*bench.facts)
        case "mode":
            bench.flies(model.ModeClass[choice])
            bench.give(bench.mode)
        case "radio":
            bench.flies(bench.mode.flown, radio=choice)
        case "hand":
            hand, flown = choice
            bench.give(events.ModeSourceSeen(model.ModeSource[hand], None if flown is None else model.ModeClass[flown]))
            if flown is not None:
                bench.flies(model.ModeClass[flown])
        case "motion":
            bench.motion = None if choice is None else events.MotionSeen(*choice)
            bench.give(bench.motion or events.MotionUnseen())
        case "obeys" | "autopilot":
            setattr(bench, step, choice)
        case "alive" | "deaf":
            setattr(bench, step, {stations[name] for name in choice})
        case "guard":
            bench.guard = None if choice is None else events.GuardSeen(model.GuardState[choice], True)
        case "gap":
            bench.gap = None if choice is None else model.GapFact(choice[0], "A -> B", choice[1])
        case "signs":
            bench.give(events.ConditionsSeen(**dict.fromkeys(choice, True)))
        case "place":
            bench.give(events.PlaceJudged(*choice))
        case "link":
            bench.give(events.LinkJudged(stations[choice[0]], choice[1], choice[2], "loss"))
        case "word":
            _speak(bench, found, choice)
        case "control":
            bench.give(bench.request(stations[choice]))
        case "flying":
            bench.autopilot_says(armed=choice[0], flying=choice[1])
        case "restart":
            bench.restart(choice)
        case "rehearsal":
            bench.give(events.RehearsalAsked(stations["A"], choice))


def _facts(
    found: SimpleNamespace, stations: dict[str, int], where: tuple[tuple[str, float, float | None, str], ...]
) -> Any:
    inside = {
        stations[name]: found.model.ZoneFact(
            stations[name], margin_m, ends_s, ends_s, frozenset(stations[each] for each in beyond)
        )
        for name, margin_m, ends_s, beyond in where
    }
    return tuple(inside.get(station, found.bench.outside(station)) for station in stations.values())


def _speak(bench: Any, found: SimpleNamespace, word: str) -> None:
    """A word of the transfer under way, if there is one."""
    view, messages = bench.arbiter.view, found.bench
    if view.partner is None or view.commander is None:
        return
    key = messages.TransferKey(view.commander, view.partner, view.handover_id, view.epoch)
    match word:
        case "ready":
            bench.say(view.partner, messages.OnHandover(key))
        case "waits":
            bench.say(view.partner, messages.OnHandover(key, found.model.Consent.WAITING))
        case "agreed":
            bench.say(view.commander, messages.OkHandover(key))
        case "connected":
            bench.say(view.partner, messages.DroneConnected(key))
        case "released":
            bench.say(view.commander, messages.DisconnectHandover(key))


# ---- what differs ----------------------------------------------------------------------------------------------------


def _differs(without: Player, with_it: Player, told: Story) -> tuple[int, str, str] | None:
    """How many steps it takes, and what both say then; None where it makes no difference."""
    limit(STORY_S)
    other = with_it(told)
    for steps, said in enumerate(without(told), 1):
        answer = next(other, "")
        if answer != said:
            return steps, said, answer
    return None


def shorten(without: Player, with_it: Player, told: Story) -> Difference:
    """The steps without which it makes no difference any more, in the plainest surroundings."""
    found = _differs(without, with_it, told)
    assert found is not None
    told = replace(told, steps=told.steps[: found[0]])

    def try_it(other: Story) -> bool:
        nonlocal told, found
        differs = _differs(without, with_it, other)
        if differs is None:
            return False
        told, found = replace(other, steps=other.steps[: differs[0]]), differs
        return True

    size = len(told.steps)
    while size:
        place = 0
        while place < len(told.steps):
            if not try_it(replace(told, steps=told.steps[:place] + told.steps[place + size :])):
                place += size
        size //= 2
    for plain in ({"begin": "mission"}, {"kind": "COPTER"}, {"hold_s": 60.0}):
        try_it(replace(told, **plain))
    for policy in told.policies:
        try_it(replace(told, policies=tuple(each for each in told.policies if each != policy)))
    return Difference(told, *found[1:])


def find(module: str, source: str, stories: int) -> Difference | None:
    """The story in which the core with that source of a module does otherwise; None in none of so many."""
    told = [story(seed) for seed in range(stories)]
    without = player()
    try:
        with_it = player(module, source)
    except Exception as error:
        return Difference(Story(()), "", f"{type(error).__name__}: {error}")
    for each in told:
        if _differs(without, with_it, each) is not None:
            return shorten(without, with_it, each)
    return None


def _printed(difference: Difference) -> str:
    told = difference.story
    lines = zip_longest(difference.without.split("\n"), difference.with_it.split("\n"), fillvalue="nothing")
    without, with_it = next(pair for pair in lines if pair[0] != pair[1])
    surroundings = f"{told.begin}, {told.kind}, hold_s {told.hold_s:g}, {dict(told.policies)}"
    steps = "\n".join(f"      {step} {choice}" for step, choice in told.steps)
    return f"    {surroundings}\n{steps}\n    the core:   {without[:400]}\n    with it:    {with_it[:400]}"


def main(arguments: list[str] | None = None) -> int:
    """Print a story for each fault asked for."""
    parser = argparse.ArgumentParser(description="stories in which a fault of the core shows")
    parser.add_argument("module", metavar="MODULE", help="a module of the core, as `core.py` calls it")
    parser.add_argument("--stories", type=int, default=400, metavar="N", help="so many are tried (default: 400)")
    parser.add_argument("--only", metavar="TEXT", default="", help="faults whose names have it in them")
    options = parser.parse_args(arguments)
    if options.module not in core.FIRST or options.module.startswith(STATION):
        parser.error(f"unknown {options.module}; known are the modules of the core: {', '.join(core.FIRST)}")
    for fault in faults(source_of(options.module)):
        if options.only in fault.name:
            source, begun = fault.source, time.monotonic()
            assert source is not None
            answer = in_child(lambda source=source: [find(options.module, source, options.stories)])  # type: ignore[misc]
            if isinstance(answer, BaseException):
                raise answer
            took = f"{fault.name} ({time.monotonic() - begun:.0f} s)"
            if answer is None:
                print(f"shows, it turns in circles: {took}", flush=True)
            elif answer[0] is None:
                print(f"shows in none of {options.stories} stories: {took}", flush=True)
            else:
                print(f"shows: {took}\n{_printed(answer[0])}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

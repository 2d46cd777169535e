# SPDX-License-Identifier: GPL-3.0-or-later

"""No program's own retransmission lifts a refusal: each timer of `retransmission.py` against the rule."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, product
from math import inf
from random import Random

import pytest

from mavproxy_handover.core.safety.commands import CommandRules, Kind, Limit, Outcome
from tests.core.safety.retransmission import TIMERS, Timer

LEFT = {Limit.COVERAGE: "leaves coverage"}
REFUSED, LIFTED = Outcome.REFUSED, Outcome.LIFTED


def each_of(timers: Sequence[Timer]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("timer", timers, ids=[f"{t.program}: {t.sends}" for t in timers])


#: more copies than that are never all lost but for an interruption of the link
FEW = [timer for timer in TIMERS if not timer.endless and len(timer.pauses) < 10]


@dataclass(frozen=True)
class Copy:
    """One that arrives: when, whether it says of itself that it is a copy, and since when the station is heard."""

    at: float
    marked: bool = False
    heard_since: float = -inf


def outcomes(timer: Timer, copies: Sequence[Copy]) -> list[Outcome]:
    """What becomes of them; all answers are lost."""
    rules = CommandRules()
    return [
        rules.rule(
            Kind.GO_ON,
            "AUTO",
            LEFT,
            251,
            copy.at,
            heard_since=copy.heard_since,
            repeats=copy.marked,
            quiet_s=timer.quiet_s,
        ).outcome
        for copy in copies
    ]


def plays(timer: Timer) -> Iterator[list[Copy]]:
    """All copies: with the shortest pauses, with the longest ones, and with some between them."""
    chance = Random(6)
    rounds = 40 if timer.endless else 1
    for pick in (min, max, *(lambda pause: chance.uniform(*pause),) * 8):
        times = accumulate((pick(pause) for pause in timer.pauses * rounds), initial=0.0)
        yield [Copy(at, timer.marked and number > 0) for number, at in enumerate(times)]


@each_of(TIMERS)
def test_with_all_answers_lost_no_copy_lifts_the_refusal(timer: Timer) -> None:
    for copies in plays(timer):
        assert set(outcomes(timer, copies)) == {REFUSED}


@each_of(FEW)
def test_with_any_copies_lost_too_no_copy_lifts_the_refusal(timer: Timer) -> None:
    """The station is heard meanwhile, so the loss looks like silence."""
    for copies in plays(timer):
        for arrives in product((False, True), repeat=len(copies)):
            arrived = [copy for copy, here in zip(copies, arrives, strict=True) if here]
            assert set(outcomes(timer, arrived)) <= {REFUSED}


@each_of(TIMERS)
@pytest.mark.parametrize("for_s", [9.0, 12.0, 20.0, 29.0])
def test_after_an_interruption_of_the_link_the_next_copy_lifts_nothing(timer: Timer, for_s: float) -> None:
    """Copies and heartbeats are lost for that long, or are held back and come all at once."""
    ends = 5.0 + for_s
    for copies in plays(timer):
        after = [replace(copy, heard_since=ends) for copy in copies if copy.at >= ends]
        before, during = [c for c in copies if c.at < 5.0], [c for c in copies if 5.0 <= c.at < ends]
        held_back = [replace(copy, at=ends, heard_since=ends) for copy in during]
        assert set(outcomes(timer, [*before, *after])) == {REFUSED}
        assert set(outcomes(timer, [*before, *held_back, *after])) == {REFUSED}


@each_of(TIMERS)
def test_an_operator_who_waits_after_the_last_copy_insists(timer: Timer) -> None:
    quiet_s = timer.quiet_s
    for copies in plays(timer):
        for wait_s, outcome in ((quiet_s - 0.1, REFUSED), (quiet_s + 0.1, LIFTED), (29.9, LIFTED), (30.1, REFUSED)):
            assert outcomes(timer, [*copies, Copy(copies[-1].at + wait_s)])[-1] is outcome

# SPDX-License-Identifier: GPL-3.0-or-later

"""Commands judged by the situation: by table, and what lifts a refusal. Expected values are written out."""

from __future__ import annotations

from itertools import product
from math import inf
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.safety.commands import (
    JUDGED,
    POLICIES,
    CommandRules,
    Kind,
    Limit,
    Outcome,
    Ruling,
)

ENERGY, FENCE, COVERAGE = Limit.ENERGY, Limit.FENCE, Limit.COVERAGE
GCSA, GCSB = 251, 252
ALL = {ENERGY: "no energy", FENCE: "over the fence", COVERAGE: "out of coverage"}
REFUSED, PASSES, WARNED, LIFTED = Outcome.REFUSED, Outcome.PASSES, Outcome.WARNED, Outcome.LIFTED

#: kind -> what becomes of it without a word in the configuration when it would leave just that
DEFAULT = {
    (Kind.START, ENERGY): REFUSED,
    (Kind.START, FENCE): PASSES,
    (Kind.START, COVERAGE): PASSES,
    (Kind.GO_ON, ENERGY): REFUSED,
    (Kind.GO_ON, FENCE): REFUSED,
    (Kind.GO_ON, COVERAGE): REFUSED,
    (Kind.FLY_TO, ENERGY): REFUSED,
    (Kind.FLY_TO, FENCE): REFUSED,
    (Kind.FLY_TO, COVERAGE): REFUSED,
    (Kind.TARGET, ENERGY): REFUSED,
    (Kind.TARGET, FENCE): REFUSED,
    (Kind.TARGET, COVERAGE): REFUSED,
    (Kind.SPEED, ENERGY): REFUSED,
    (Kind.SPEED, FENCE): PASSES,
    (Kind.SPEED, COVERAGE): PASSES,
    (Kind.ROUTE, ENERGY): REFUSED,
    (Kind.ROUTE, FENCE): REFUSED,
    (Kind.ROUTE, COVERAGE): REFUSED,
    (Kind.UNKNOWN, ENERGY): PASSES,
    (Kind.UNKNOWN, FENCE): PASSES,
    (Kind.UNKNOWN, COVERAGE): REFUSED,
}


def test_the_table_is_whole() -> None:
    assert set(DEFAULT) == set(product(Kind, Limit))
    assert set(JUDGED) == set(Kind)


@pytest.mark.parametrize(("kind", "limit"), list(DEFAULT))
def test_what_becomes_of_a_command_by_what_it_would_leave(kind: Kind, limit: Limit) -> None:
    outcome = DEFAULT[kind, limit]
    words = ALL[limit] if outcome is REFUSED else ""
    for policy, expected in (("refuse", outcome), ("warn", WARNED if outcome is REFUSED else PASSES), ("off", PASSES)):
        ruling = CommandRules({limit: policy}).rule(kind, 1, {limit: ALL[limit]}, GCSA, 0.0, heard_since=-inf)
        assert ruling.outcome is expected
        assert ruling.words == (words if policy != "off" else "")


def test_what_leaves_nothing_passes() -> None:
    rules = CommandRules()
    for kind in Kind:
        assert rules.rule(kind, 1, {}, GCSA, 0.0, heard_since=-inf) == Ruling(PASSES)
        assert rules.rule(kind, 1, dict.fromkeys(Limit, ""), GCSA, 0.0, heard_since=-inf) == Ruling(PASSES)


def test_the_gravest_limit_is_named() -> None:
    rules = CommandRules()
    assert rules.rule(Kind.FLY_TO, 1, ALL, GCSA, 0.0, heard_since=-inf) == Ruling(REFUSED, (ENERGY,), "no energy")
    milder = CommandRules({ENERGY: "warn"})
    assert milder.rule(Kind.FLY_TO, 1, ALL, GCSA, 0.0, heard_since=-inf) == Ruling(REFUSED, (FENCE,), "over the fence")
    all_warned = CommandRules(dict.fromkeys(Limit, "warn"))
    ruling = all_warned.rule(Kind.FLY_TO, 1, ALL, GCSA, 0.0, heard_since=-inf)
    words = "no energy, over the fence, out of coverage"
    assert ruling == Ruling(WARNED, (ENERGY, FENCE, COVERAGE), words, words)


def ask(rules: CommandRules, at: float, kind: Kind = Kind.GO_ON, wish: int = 1, **more: Any) -> Outcome:
    heard: dict[str, Any] = {"heard_since": -inf, **more}
    return rules.rule(kind, wish, {COVERAGE: "out of coverage"}, GCSA, at, **heard).outcome


@pytest.mark.parametrize(
    ("after_s", "outcome"),
    [
        (0.0, REFUSED),
        (3.0, REFUSED),
        (3.5, REFUSED),
        (9.99, REFUSED),
        (10.0, LIFTED),
        (20.0, LIFTED),
        (30.0, LIFTED),
        (30.01, REFUSED),
    ],
)
def test_the_same_command_sent_again_after_ten_seconds_insists(after_s: float, outcome: Outcome) -> None:
    rules = CommandRules()
    assert ask(rules, 100.0) is REFUSED
    assert ask(rules, 100.0 + after_s) is outcome


def test_each_copy_begins_the_wait_anew() -> None:
    """The fault: the same COMMAND_INT every 3.05 to 3.5 s was carried out at its second or third try."""
    for pause_s in (0.5, 1.5, 3.05, 3.5, 9.9):
        rules = CommandRules()
        assert {ask(rules, at * pause_s) for at in range(100)} == {REFUSED}
        assert ask(rules, 99 * pause_s + 10.5) is LIFTED


def test_what_is_quiet_for_longer_has_its_own_wait() -> None:
    rules = CommandRules()
    assert ask(rules, 0.0, quiet_s=20.0) is REFUSED
    assert ask(rules, 19.0, quiet_s=20.0) is REFUSED
    assert ask(rules, 39.5, quiet_s=20.0) is LIFTED


def test_what_says_that_it_was_sent_before_lifts_nothing_and_begins_the_wait_anew() -> None:
    rules = CommandRules()
    assert ask(rules, 0.0) is REFUSED
    assert ask(rules, 11.0, repeats=True) is REFUSED
    assert ask(rules, 22.0, repeats=True) is REFUSED
    assert ask(rules, 31.0) is REFUSED
    assert ask(rules, 42.0) is LIFTED


def test_silence_counts_only_while_the_station_is_heard() -> None:
    rules = CommandRules()
    assert ask(rules, 100.0) is REFUSED
    assert ask(rules, 112.0, heard_since=100.1) is REFUSED, "its link was interrupted after the last copy"
    assert ask(rules, 124.0, heard_since=112.0) is LIFTED


def test_of_what_takes_several_messages_the_wait_ends_with_the_first() -> None:
    """An upload over a slow link takes longer than the window."""
    rules = CommandRules()
    assert ask(rules, 60.0, Kind.ROUTE, begun_at=0.0) is REFUSED
    assert ask(rules, 125.0, Kind.ROUTE, begun_at=65.0) is REFUSED
    assert ask(rules, 200.0, Kind.ROUTE, begun_at=140.0) is LIFTED


@pytest.mark.parametrize(
    ("kind", "wish", "station", "outcome"),
    [
        (Kind.GO_ON, 1, GCSA, REFUSED),
        (Kind.GO_ON, 2, GCSA, LIFTED),
        (Kind.FLY_TO, 1, GCSA, LIFTED),
        (Kind.GO_ON, 1, GCSB, LIFTED),
    ],
    ids=["a copy", "another command", "another kind", "another station"],
)
def test_a_copy_that_is_not_judged_begins_the_wait_anew(kind: Kind, wish: int, station: int, outcome: Outcome) -> None:
    rules = CommandRules()
    ask(rules, 0.0)
    rules.came(kind, wish, station, 5.0)
    assert ask(rules, 12.0) is outcome


def test_it_is_said_how_long_after_the_last_copy_one_came() -> None:
    rules = CommandRules()
    rulings = [
        rules.rule(Kind.GO_ON, 1, {COVERAGE: "out"}, GCSA, at, heard_since=-inf).copy_after_s
        for at in (0.0, 3.0, 9.0, 40.0)
    ]
    assert rulings == [None, 3.0, 6.0, None]


def test_a_stream_lifts_nothing_but_is_lifted_by_the_operator() -> None:
    rules = CommandRules()
    assert {ask(rules, at, Kind.TARGET) for at in (0.0, 12.0, 24.0, 50.0)} == {REFUSED}
    rules.lift(COVERAGE, 60.0)
    assert ask(rules, 60.0, Kind.TARGET) is LIFTED
    assert ask(rules, 120.0, Kind.TARGET) is REFUSED


@pytest.mark.parametrize("other", ["another command", "another kind", "another station", "after another one"])
def test_only_the_very_same_command_counts(other: str) -> None:
    rules = CommandRules()
    assert ask(rules, 0.0) is REFUSED
    if other == "another command":
        assert ask(rules, 12.0, wish=2) is REFUSED
    elif other == "another kind":
        assert ask(rules, 12.0, Kind.FLY_TO) is REFUSED
    elif other == "another station":
        assert rules.rule(Kind.GO_ON, 1, {COVERAGE: "out"}, GCSB, 12.0, heard_since=-inf).outcome is REFUSED
    else:
        assert ask(rules, 1.0, wish=2) is REFUSED
        assert ask(rules, 12.0) is REFUSED


def test_sent_again_it_lifts_the_limit_that_was_named_and_no_other() -> None:
    rules = CommandRules()
    two = {ENERGY: "no energy", COVERAGE: "out of coverage"}

    def rule(at: float) -> Ruling:
        return rules.rule(Kind.GO_ON, 1, two, GCSA, at, heard_since=-inf)

    assert rule(0.0).limits == (ENERGY,)
    assert rule(12.0) == Ruling(REFUSED, (COVERAGE,), "out of coverage")
    assert rule(13.0).outcome is REFUSED
    assert rule(25.0) == Ruling(LIFTED, (ENERGY, COVERAGE), "no energy, out of coverage")


def test_what_is_only_warned_of_is_told_beside_the_limit_that_was_lifted() -> None:
    """The fault: while an operator had lifted one limit, the warning of another one was dropped."""
    rules = CommandRules({COVERAGE: "warn"})
    two = {FENCE: "over the fence", COVERAGE: "out of coverage"}
    rules.lift(FENCE, 0.0)
    ruling = rules.rule(Kind.GO_ON, 1, two, GCSA, 1.0, heard_since=-inf)
    assert ruling == Ruling(LIFTED, (FENCE, COVERAGE), "over the fence, out of coverage", "out of coverage")


def test_a_limit_that_comes_up_since_is_refused_for_itself() -> None:
    rules = CommandRules()
    assert ask(rules, 0.0) is REFUSED
    both = {FENCE: "over the fence", COVERAGE: "out of coverage"}
    ruling = rules.rule(Kind.GO_ON, 1, both, GCSA, 12.0, heard_since=-inf)
    assert ruling == Ruling(REFUSED, (FENCE,), "over the fence")


def test_a_copy_of_what_was_let_pass_passes_too() -> None:
    rules = CommandRules()
    ask(rules, 0.0)
    assert ask(rules, 12.0) is LIFTED
    assert ask(rules, 13.5, repeats=True) is LIFTED
    assert ask(rules, 20.0) is LIFTED
    assert ask(rules, 31.0) is REFUSED, "that is no retransmission, it is asked anew"


def test_what_was_lifted_by_insisting_is_lifted_for_a_minute_at_most() -> None:
    """The fault: a program that goes on repeating the command kept it lifted for the whole flight."""
    rules = CommandRules()
    ask(rules, 0.0)
    assert {ask(rules, 12.0 + each) for each in range(60)} == {LIFTED}
    assert {ask(rules, 73.0 + each) for each in range(60)} == {REFUSED}


def test_what_leaves_nothing_in_between_begins_the_count_anew() -> None:
    rules = CommandRules()
    ask(rules, 0.0)
    assert rules.rule(Kind.GO_ON, 1, {}, GCSA, 2.0, heard_since=-inf).outcome is PASSES
    assert ask(rules, 12.0) is REFUSED


def test_the_operator_lifts_one_limit_for_a_minute() -> None:
    rules = CommandRules()
    rules.lift(COVERAGE, 10.0)
    assert ask(rules, 10.0) is LIFTED
    assert ask(rules, 69.9, wish=7) is LIFTED
    assert rules.lifted_s(40.0) == {COVERAGE: 30.0}
    two = {ENERGY: "no energy", COVERAGE: "out of coverage"}
    assert rules.rule(Kind.FLY_TO, 1, two, GCSA, 30.0, heard_since=-inf) == Ruling(REFUSED, (ENERGY,), "no energy")
    assert ask(rules, 70.0, wish=8) is REFUSED
    assert rules.lifted_s(70.0) == {}


def test_what_was_lifted_ends_with_the_authority_of_who_lifted_it() -> None:
    rules = CommandRules()
    rules.lift(COVERAGE, 10.0)
    ask(rules, 5.0, Kind.FLY_TO)
    rules.authority_moved()
    assert ask(rules, 11.0) is REFUSED
    assert ask(rules, 11.0, Kind.FLY_TO) is REFUSED


def test_a_refusal_under_another_authority_lifts_nothing() -> None:
    rules, left = CommandRules(), {COVERAGE: "out of coverage"}
    for at, moved, outcome in ((10.0, False, REFUSED), (22.0, True, REFUSED), (34.0, False, LIFTED)):
        if moved:
            rules.authority_moved()
        assert rules.rule(Kind.FLY_TO, 1, left, GCSA, at, heard_since=-inf).outcome is outcome


def test_a_lifted_limit_that_nobody_would_leave_is_no_news() -> None:
    rules = CommandRules()
    rules.lift(COVERAGE, 0.0)
    assert rules.rule(Kind.GO_ON, 1, {}, GCSA, 1.0, heard_since=-inf) == Ruling(PASSES)


_LEFT = st.dictionaries(st.sampled_from(list(Limit)), st.sampled_from(["", "left"]))


@pytest.mark.slow
@given(
    kind=st.sampled_from(list(Kind)),
    policies=st.dictionaries(st.sampled_from(list(Limit)), st.sampled_from(POLICIES)),
    asked=st.lists(st.tuples(st.integers(0, 1), _LEFT, st.floats(0.0, 9.9), st.booleans())),
)
def test_nothing_is_lifted_by_what_comes_oftener_than_every_ten_seconds(
    kind: Kind, policies: dict[Limit, str], asked: list[tuple[int, dict[Limit, str], float, bool]]
) -> None:
    rules, now = CommandRules(policies), 0.0
    for wish, left, pause_s, repeats in asked:
        now += pause_s
        ruling = rules.rule(kind, wish, left, GCSA, now, heard_since=-inf, repeats=repeats)
        strict = [x for x in JUDGED[kind] if left.get(x) and policies.get(x, "refuse") == "refuse"]
        assert ruling.outcome is not LIFTED
        assert ruling.passes is (not strict)


@pytest.mark.parametrize("outcome", Outcome)
def test_only_a_refused_command_is_not_carried_out(outcome: Outcome) -> None:
    assert Ruling(outcome).passes is (outcome is not REFUSED)


@pytest.mark.parametrize(("last", "outcome"), [(70.0, LIFTED), (70.1, REFUSED)])
def test_copies_of_a_command_that_passed_pass_for_a_minute(last: float, outcome: Outcome) -> None:
    rules = CommandRules()
    assert ask(rules, 0.0) is REFUSED
    for at in (10.0, 19.0, 28.0, 37.0, 46.0, 55.0, 64.0):
        assert ask(rules, at) is LIFTED
    assert ask(rules, last) is outcome

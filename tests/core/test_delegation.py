# SPDX-License-Identifier: GPL-3.0-or-later

"""Delegation of guided targets: who may give it, what ends it, and when a hold follows."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.authority.delegation import FIRST_S, SILENT_S, Delegation, End, GuidedFacts, Over

A, B = 251, 252
GOOD = GuidedFacts(commander=A, epoch=3, flying=True, guided=True, ordered_by=A)


def given(now: float = 100.0) -> Delegation:
    delegation = Delegation()
    assert delegation.give("mavros", A, GOOD, now) == ""
    return delegation


def test_it_permits_targets_of_that_program_alone() -> None:
    delegation = given()
    assert delegation.program == "mavros"
    assert delegation.permits("mavros")
    assert not delegation.permits("other")
    assert not Delegation().permits("")


@pytest.mark.parametrize(
    ("station", "facts", "why"),
    [
        (B, GOOD, "only the commander delegates"),
        (A, replace(GOOD, commander=None), "only the commander delegates"),
        (A, replace(GOOD, flying=False), "the aircraft does not fly"),
        (A, replace(GOOD, decided=True), "the companion has decided what the aircraft does now"),
        (A, replace(GOOD, guided=False), "the aircraft does not fly GUIDED; order GUIDED first"),
        (A, replace(GOOD, ordered_by=None), "this GUIDED was not ordered by the commander; order GUIDED again"),
        (A, replace(GOOD, ordered_by=B), "this GUIDED was not ordered by the commander; order GUIDED again"),
    ],
)
def test_it_is_refused_by_name(station: int, facts: GuidedFacts, why: str) -> None:
    delegation = Delegation()
    assert delegation.give("mavros", station, facts, 0.0) == why
    assert not delegation.permits("mavros")


def test_one_program_leads_at_a_time() -> None:
    delegation = given()
    assert delegation.give("other", A, GOOD, 101.0) == "targets are delegated to mavros; take that back first"
    assert delegation.permits("mavros")


@pytest.mark.parametrize(
    ("facts", "end", "holds"),
    [
        (replace(GOOD, commander=B, epoch=4, ordered_by=A), End.AUTHORITY, True),
        (replace(GOOD, commander=None), End.AUTHORITY, True),
        (replace(GOOD, epoch=4), End.AUTHORITY, True),
        (replace(GOOD, decided=True), End.DECISION, False),
        (replace(GOOD, guided=False), End.MODE, False),
        (replace(GOOD, flying=False), End.MODE, False),
        (replace(GOOD, ordered_by=None), End.MODE, False),
    ],
)
def test_a_fact_ends_it_once(facts: GuidedFacts, end: End, holds: bool) -> None:
    delegation = given()
    assert delegation.tick(facts, 100.1) == Over("mavros", end, holds)
    assert not delegation.permits("mavros")
    assert delegation.tick(facts, 100.2) is None
    assert delegation.tick(GOOD, 100.3) is None, "it never begins again by itself"


def test_silence_ends_it_the_first_target_may_take_longer() -> None:
    delegation = given()
    assert delegation.tick(GOOD, 100.0 + FIRST_S) is None
    delegation.target_passed("other", 104.0)
    over = delegation.tick(GOOD, 100.01 + FIRST_S)
    assert over == Over("mavros", End.SILENCE, True)

    delegation = given()
    delegation.target_passed("mavros", 100.2)
    assert delegation.tick(GOOD, 100.2 + SILENT_S) is None
    assert delegation.tick(GOOD, 100.21 + SILENT_S) == Over("mavros", End.SILENCE, True)


def test_a_copy_of_the_request_gives_a_new_time() -> None:
    delegation = given()
    assert delegation.give("mavros", A, GOOD, 103.0) == ""
    assert delegation.tick(GOOD, 103.0 + FIRST_S) is None


def test_commands_the_commanders_word_and_a_fault_end_it() -> None:
    assert given().commanded(flies=False) == Over("mavros", End.COMMAND, True)
    assert given().commanded(flies=True) == Over("mavros", End.COMMAND, False)
    assert given().revoke() == Over("mavros", End.REVOKED, True)
    assert given().link_closed("mavros") == Over("mavros", End.FAULT, True)
    assert given().link_closed("other") is None
    nothing = Delegation()
    assert (nothing.commanded(flies=True), nothing.revoke(), nothing.link_closed("mavros")) == (None, None, None)
    assert nothing.tick(GOOD, 1.0) is None


@pytest.mark.parametrize(
    ("facts", "over"),
    [
        (replace(GOOD, ordered_by=None), Over("mavros", End.RESTART, True)),
        (replace(GOOD, ordered_by=None, commander=None), Over("mavros", End.RESTART, True)),
        (GOOD, None),
        (replace(GOOD, ordered_by=None, guided=False), None),
        (replace(GOOD, ordered_by=None, flying=False), None),
        (replace(GOOD, ordered_by=None, decided=True), None),
    ],
)
def test_a_restart_in_guided_counts_as_the_end_of_one(facts: GuidedFacts, over: Over | None) -> None:
    assert Delegation().restarted("mavros", facts) == over

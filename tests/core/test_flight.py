# SPDX-License-Identifier: GPL-3.0-or-later

"""How long the word of autopilot, position and guard counts."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.events import (
    AircraftJudged,
    AutopilotState,
    BoxJudged,
    EnergyJudged,
    GapsJudged,
    GuardSeen,
    HeightsJudged,
    MissionJudged,
    ReturnJudged,
)
from mavproxy_handover.core.common.flight import Flight, StartJudgement
from mavproxy_handover.core.common.handling import CIRCLES
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GuardState

LIMITS = Limits(position_stale_s=2.0, autopilot_lost_s=3.0, guard_lost_s=2.0)


def flight(*, armed: bool = False, flying: bool = False, limits: Limits = LIMITS) -> Flight:
    """An autopilot that said this at 100 s."""
    made = Flight(limits)
    made.autopilot_said(AutopilotState(armed, flying), 100.0)
    return made


def test_before_the_autopilot_has_spoken_nothing_is_known() -> None:
    fresh = Flight(LIMITS)
    assert fresh.armed is None
    assert not fresh.autopilot_alive(0.0)
    assert not fresh.disarmed(0.0)
    assert not fresh.position_known(0.0)
    assert fresh.guard(0.0) is GuardState.SILENT
    assert (fresh.circles_s, fresh.circle_m) == (0.0, 0.0)


@pytest.mark.parametrize(("now", "counts"), [(100.0, True), (102.9, True), (103.0, False)])
def test_disarmed_is_what_the_autopilot_has_said_in_the_last_three_seconds(now: float, counts: bool) -> None:
    assert flight().disarmed(now) is counts
    assert not flight(armed=True).disarmed(now)


def test_nobody_flies_disarmed() -> None:
    assert not flight(armed=False, flying=True).flying
    assert flight(armed=True, flying=True).flying
    assert not flight(armed=True, flying=False).flying


def test_an_autopilot_that_falls_silent_in_the_air_is_still_taken_for_flying() -> None:
    made = flight(armed=True, flying=True)
    assert not made.autopilot_alive(1000.0)
    assert made.flying


@pytest.mark.parametrize(("now", "known"), [(100.0, True), (101.9, True), (102.0, False)])
def test_a_position_counts_for_two_seconds(now: float, known: bool) -> None:
    made = flight(armed=True, flying=True)
    made.position_seen(100.0)
    assert made.position_known(now) is known
    assert made.position_lost(now) is not known


def test_its_loss_is_told_once_and_after_the_next_position_once_more() -> None:
    made = flight(armed=True, flying=True)
    made.position_seen(100.0)
    assert made.stale_at() == 102.0
    assert [made.position_lost(now) for now in (101.0, 102.0, 103.0)] == [False, True, False]
    assert made.stale_at() is None
    made.position_seen(110.0)
    assert made.stale_at() == 112.0
    assert [made.position_lost(now) for now in (110.0, 112.0, 113.0)] == [False, True, False]


def test_on_the_ground_no_position_is_missed() -> None:
    made = flight(armed=True, flying=False)
    assert made.stale_at() is None
    assert not made.position_lost(1000.0)


def test_in_the_air_a_position_that_never_came_is_missed_at_once() -> None:
    assert flight(armed=True, flying=True).position_lost(100.0)


@pytest.mark.parametrize(("now", "state"), [(101.9, GuardState.LIVE), (102.0, GuardState.SILENT)])
def test_the_guards_word_counts_for_two_seconds(now: float, state: GuardState) -> None:
    made = flight()
    made.guard_said(GuardSeen(GuardState.LIVE, ours=True), 100.0)
    assert made.guard(now) is state
    assert made.guarded(now) is (state is GuardState.LIVE)


@pytest.mark.parametrize("state", [state for state in GuardState if state is not GuardState.LIVE])
def test_any_other_word_of_the_guard_is_none_to_start_with(state: GuardState) -> None:
    made = flight()
    made.guard_said(GuardSeen(state, ours=True), 100.0)
    assert not made.guarded(100.0)


def test_a_guard_that_lives_on_another_companions_leases_is_none() -> None:
    made = flight()
    made.guard_said(GuardSeen(GuardState.LIVE, ours=False), 100.0)
    assert not made.guarded(100.0)


def test_where_none_is_required_none_is_missed() -> None:
    assert flight(limits=Limits(guard_required=False)).guarded(1000.0)


def test_a_rehearsal_counts_as_a_flight_until_it_is_over() -> None:
    made = flight()
    made.rehearsal_begun()
    assert (made.rehearsing, made.flying) == (True, True)
    made.rehearsal_over()
    assert (made.rehearsing, made.flying) == (False, False)


def test_what_the_autopilot_said_last_of_the_aircraft_counts() -> None:
    made = flight()
    assert (made.circles_s, made.circle_m, made.foreign) == (0.0, 0.0, "")
    made.autopilot_said(AutopilotState(True, True, "ArduSub", CIRCLES, 4.0, 90.0), 101.0)
    assert (made.foreign, made.handling, made.circles_s, made.circle_m) == ("ArduSub", CIRCLES, 4.0, 90.0)


@pytest.mark.parametrize(
    ("event", "lacks"),
    [
        (EnergyJudged("too little"), "energy_short"),
        (GapsJudged("too little"), "gaps_lack"),
        (AircraftJudged("too little"), "aircraft_lacks"),
        (BoxJudged("too little"), "box_lacks"),
        (HeightsJudged("too little"), "heights_lack"),
        (ReturnJudged("too little"), "return_lacks"),
        (MissionJudged("too little"), "mission_lacks"),
    ],
)
def test_what_start_lacks_by_a_monitor(event: StartJudgement, lacks: str) -> None:
    made = flight()
    assert getattr(made, lacks) == ""
    made.judged(event)
    names = [name for name in made.__slots__ if name.endswith(("_short", "_lack", "_lacks"))]
    assert [name for name in names if getattr(made, name)] == [lacks]


@pytest.mark.parametrize(
    ("now", "lacks"), [(101.9, "signed otherwise"), (102.0, "the guard does not answer the lease")]
)
def test_why_the_guard_does_not_fit_counts_for_two_seconds(now: float, lacks: str) -> None:
    made = flight()
    made.guard_said(GuardSeen(GuardState.LIVE, ours=True), 99.0)
    made.guard_said(GuardSeen(GuardState.SILENT, ours=False, misfit="signed otherwise"), 100.0)
    assert made.guard_lacks(now) == lacks


def test_a_status_that_is_not_proven_to_be_the_guards_says_nothing_of_it() -> None:
    made = flight()
    made.guard_said(GuardSeen(GuardState.LIVE, ours=True), 100.0)
    made.guard_said(GuardSeen(GuardState.SILENT, ours=False), 101.0)
    assert (made.guard(101.0), made.guard_lacks(101.0), made.guard_silent_s(101.0)) == (GuardState.LIVE, "", 1.0)


@pytest.mark.parametrize(("autopilot_at", "silent"), [(100.0, False), (101.0, False), (101.1, True)])
def test_an_autopilot_that_speaks_a_second_after_its_last_position_is_silent_on_it(
    autopilot_at: float, silent: bool
) -> None:
    made = flight()
    made.position_seen(100.0)
    made.autopilot_said(AutopilotState(True, True), autopilot_at)
    assert made.silent_on_position() is silent


def test_for_how_long_nothing_was_heard() -> None:
    made = flight()
    made.position_seen(100.5)
    made.guard_said(GuardSeen(GuardState.LIVE, ours=True), 101.0)
    assert (made.autopilot_silent_s(103.0), made.position_silent_s(103.0), made.guard_silent_s(103.0)) == (
        3.0,
        2.5,
        2.0,
    )

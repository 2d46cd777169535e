# SPDX-License-Identifier: GPL-3.0-or-later

"""Conditions of one aircraft, with an authority that says what the test wants."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from mavproxy_handover.core.common.authority_facts import CoverageFacts
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import AutopilotState, ConditionsSeen, GuardSeen
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.handling import STANDS_STILL
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GapFact, GuardState
from mavproxy_handover.core.safety.conditions import Conditions

A, B = 251, 252
NOW = 100.0
GAP, BEFORE_GAP = GapFact(60.0, "GCSA to GCSB"), GapFact(60.0, "GCSA to GCSB", ahead=True)


@dataclass
class Told:
    """What authority says."""

    owner: int | None = A
    lost: bool = False
    recovering: bool = False
    covered: bool = True
    out_of_coverage: bool = False
    attacked: bool = False
    owner_name: str = "GCSA"
    facts: CoverageFacts = field(default_factory=CoverageFacts)
    room_m: dict[int, float] = field(default_factory=lambda: {A: 10.0, B: 10.0})

    def successor_awaited(self, now: float) -> bool:
        return False

    def coverage(self, now: float) -> CoverageFacts:
        assert self.owner is not None
        return self.facts

    def margin_m(self, station: int) -> float:
        return self.room_m[station]

    def words(self, cause: Cause, now: float) -> str:
        return ""


class Bench:
    """An aircraft in flight; autopilot, position and guard are fresh at `NOW`."""

    def __init__(self, limits: Limits | None = None, *, flying: bool = True) -> None:
        self.told = Told()
        self.flight = Flight(limits or Limits())
        self.conditions = Conditions(self.told, self.flight, limits or Limits())
        self.said(NOW, flying=flying)

    def said(self, now: float, *, flying: bool = True, circle_m: float = 0.0) -> None:
        self.flight.autopilot_said(AutopilotState(flying, flying, "", STANDS_STILL, 0.0, circle_m), now)
        self.flight.position_seen(now)
        self.flight.guard_said(GuardSeen(GuardState.LIVE, ours=True), now)

    def at(self, now: float, facts: CoverageFacts | None = None, gap: GapFact | None = None) -> frozenset[Cause]:
        """A position that shows this of coverage, and what looks wrong then."""
        self.said(now)
        self.told.facts = facts or CoverageFacts()
        self.conditions.position_seen(gap, now)
        return self.conditions.evaluate(now)


ENDS = CoverageFacts(ends_ahead=True)


class TestAuthority:
    def test_with_a_commander_that_is_heard_nothing_is_wrong(self) -> None:
        assert Bench().at(NOW) == frozenset()

    def test_a_lost_commander_on_the_ground_too(self) -> None:
        for flying in (True, False):
            bench = Bench(flying=flying)
            bench.told.lost = True
            assert bench.conditions.evaluate(NOW) == {Cause.COMMANDER_LOST}

    @pytest.mark.parametrize(("flying", "found"), [(True, {Cause.COMMANDER_LOST}), (False, set())])
    def test_without_an_owner_in_flight(self, flying: bool, found: set[Cause]) -> None:
        bench = Bench(flying=flying)
        bench.told.owner = None
        bench.conditions.position_seen(None, NOW)
        assert bench.conditions.evaluate(NOW) == found

    def test_outside_every_zone(self) -> None:
        bench = Bench()
        bench.told.out_of_coverage = True
        assert bench.at(NOW) == {Cause.OUT_OF_COVERAGE}

    def test_an_attack_in_the_name_of_the_commander_while_there_is_one(self) -> None:
        bench = Bench()
        bench.told.attacked = True
        assert bench.at(NOW) == {Cause.AUTHENTICATION}
        bench.told.lost = True
        assert bench.at(NOW) == {Cause.COMMANDER_LOST}

    def test_what_the_position_shows_is_of_a_commander_that_is_heard(self) -> None:
        bench = Bench()
        assert bench.at(NOW, CoverageFacts(no_station=True)) == {Cause.NO_STATION}
        assert bench.at(NOW, CoverageFacts(links_weak=True)) == {Cause.LINKS_WEAK}
        bench.told.lost = True
        assert bench.conditions.evaluate(NOW) == {Cause.COMMANDER_LOST}

    def test_on_the_ground_no_position_shows_anything(self) -> None:
        bench = Bench(flying=False)
        bench.told.facts = CoverageFacts(no_station=True, links_weak=True, ends_ahead=True)
        bench.conditions.position_seen(None, NOW)
        bench.said(NOW)
        assert bench.conditions.evaluate(NOW) == frozenset()


class TestAircraft:
    @pytest.mark.parametrize(("now", "found"), [(102.9, set()), (103.0, {Cause.AUTOPILOT_LOST})])
    def test_an_autopilot_that_is_silent(self, now: float, found: set[Cause]) -> None:
        bench = Bench()
        bench.flight.guard_said(GuardSeen(GuardState.LIVE, ours=True), now)
        assert bench.conditions.evaluate(now) == found

    @pytest.mark.parametrize("state", GuardState)
    @pytest.mark.parametrize("required", [True, False])
    def test_a_guard_that_does_not_watch(self, state: GuardState, required: bool) -> None:
        bench = Bench(Limits(guard_required=required))
        bench.flight.guard_said(GuardSeen(state, ours=True), 102.5)
        bench.flight.position_seen(102.5)
        lost = required and state in (GuardState.SILENT, GuardState.DISABLED)
        assert bench.conditions.evaluate(102.5) == ({Cause.GUARD_LOST} if lost else set())

    @pytest.mark.parametrize(
        ("autopilot_at", "now", "found"),
        [
            (101.5, 101.9, set()),
            (101.5, 102.0, {Cause.POSITION_STALE}),
            (100.5, 102.0, set()),  # the autopilot has said nothing since either
        ],
    )
    def test_a_position_that_is_late(self, autopilot_at: float, now: float, found: set[Cause]) -> None:
        bench = Bench()
        bench.flight.autopilot_said(AutopilotState(True, True), autopilot_at)
        bench.flight.guard_said(GuardSeen(GuardState.LIVE, ours=True), now)
        assert bench.conditions.evaluate(now) == found

    def test_a_position_may_be_late_by_the_hold_off_of_its_cause(self) -> None:
        bench = Bench()
        assert bench.conditions.blind_until == float("inf")
        bench.flight.autopilot_said(AutopilotState(True, True), 101.5)
        for now in (102.0, 102.4):
            bench.conditions.evaluate(now)
        assert bench.conditions.blind_until == 103.0
        bench.flight.position_seen(102.5)
        bench.conditions.evaluate(102.5)
        assert bench.conditions.blind_until == float("inf")

    @pytest.mark.parametrize(
        ("report", "cause"),
        [
            (ConditionsSeen(energy=True), Cause.ENERGY),
            (ConditionsSeen(off_route=True), Cause.OFF_ROUTE),
            (ConditionsSeen(fence=True), Cause.FENCE),
        ],
    )
    def test_what_the_monitors_report_counts_in_flight(self, report: ConditionsSeen, cause: Cause) -> None:
        bench = Bench()
        bench.conditions.report(report)
        assert bench.conditions.evaluate(NOW) == {cause}
        bench.said(NOW, flying=False)
        assert bench.conditions.evaluate(NOW) == frozenset()


class TestEndOfCoverageAhead:
    """It stays until another station has authority, the flight is over, or the commander orders the aircraft on."""

    def test_it_stays_though_a_held_aircraft_nears_no_end(self) -> None:
        bench = Bench()
        assert bench.at(NOW, ENDS) == {Cause.COVERAGE_ENDS}
        assert bench.at(101.0) == {Cause.COVERAGE_ENDS}

    def test_another_owner_ends_it(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.told.owner = B
        assert bench.at(101.0) == frozenset()

    def test_the_ground_ends_it_and_what_was_ordered_on(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.conditions.overruled()
        bench.said(101.0, flying=False)
        bench.conditions.evaluate(101.0)
        assert bench.conditions.passed_at_m is None
        assert bench.at(102.0) == frozenset()

    def test_ordered_on_it_ends_fifty_metres_and_a_circle_further_inside(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.conditions.overruled()
        assert bench.conditions.passed_at_m == 60.0
        bench.said(NOW, circle_m=20.0)
        assert bench.conditions.passed_at_m == 100.0
        bench.told.room_m[A] = 59.9
        assert bench.at(101.0) == {Cause.COVERAGE_ENDS}
        bench.told.room_m[A] = 60.0
        assert bench.at(102.0) == frozenset()

    def test_without_an_end_of_coverage_there_is_no_border_to_pass(self) -> None:
        bench = Bench()
        bench.at(NOW)
        bench.conditions.overruled()
        assert bench.conditions.passed_at_m is None

    def test_a_new_order_uses_up_what_the_commander_said(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.conditions.overruled()
        bench.conditions.end_of_coverage_decided()
        assert bench.conditions.passed_at_m is None

    def test_the_loss_of_the_commander_that_ordered_the_aircraft_on_ends_both(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.conditions.overruled()
        bench.told.lost = True
        assert bench.at(101.0) == {Cause.COMMANDER_LOST}
        bench.told.lost = False
        assert bench.at(102.0) == frozenset()

    def test_without_an_owner_no_border_is_passed(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.conditions.overruled()
        bench.told.owner = None
        assert bench.at(101.0) == {Cause.COMMANDER_LOST}
        assert bench.conditions.passed_at_m is None

    def test_a_commander_that_ordered_nothing_and_comes_back_finds_it_as_it_was(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        bench.told.lost = True
        assert bench.at(101.0) == {Cause.COMMANDER_LOST}
        bench.told.lost = False
        assert bench.at(102.0) == {Cause.COVERAGE_ENDS}

    def test_after_a_restart_the_hold_goes_on_for_it(self) -> None:
        bench = Bench()
        bench.conditions.resume_end_of_coverage(A)
        assert bench.at(NOW) == {Cause.COVERAGE_ENDS}

    @pytest.mark.parametrize(("covered", "found"), [(True, set()), (False, {Cause.COVERAGE_ENDS})])
    def test_in_a_rehearsal_it_lasts_only_while_a_position_shows_it(self, covered: bool, found: set[Cause]) -> None:
        bench = Bench()
        bench.flight.rehearsal_begun()
        assert bench.at(NOW, ENDS) == {Cause.COVERAGE_ENDS}
        bench.told.covered = covered
        assert bench.at(101.0) == found


class TestGaps:
    """A gap that the mission declares."""

    def in_gap(self) -> Bench:
        bench = Bench()
        bench.told.covered, bench.told.out_of_coverage = False, True
        bench.at(NOW, gap=GAP)
        return bench

    def test_outside_every_zone_a_crossing_begins(self) -> None:
        bench = self.in_gap()
        assert bench.conditions.crossing.since == NOW
        assert bench.conditions.may_cross(NOW)

    def test_with_a_commander_in_another_zone_none_begins(self) -> None:
        bench = Bench()
        bench.told.covered = False
        bench.at(NOW, gap=GAP)
        assert bench.conditions.crossing.since is None

    @pytest.mark.parametrize(("lost", "owner"), [(True, A), (False, None)])
    def test_without_a_commander_one_begins_inside_a_zone_too(self, lost: bool, owner: int | None) -> None:
        bench = Bench()
        bench.told.lost, bench.told.owner = lost, owner
        bench.at(NOW, gap=GAP)
        assert bench.conditions.crossing.since == NOW

    def test_the_commanders_zone_ends_it(self) -> None:
        bench = self.in_gap()
        bench.told.covered, bench.told.out_of_coverage = True, False
        bench.at(101.0, gap=GAP)
        assert bench.conditions.crossing.since is None

    def test_weak_links_are_no_condition_meanwhile(self) -> None:
        bench = self.in_gap()
        assert bench.at(101.0, CoverageFacts(links_weak=True), GAP) == {Cause.OUT_OF_COVERAGE}

    def test_after_it_coverage_does_not_end_ahead_any_more(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS, GAP)
        assert bench.at(101.0, gap=GAP) == {Cause.COVERAGE_ENDS}
        assert bench.at(102.0) == frozenset()

    def test_without_a_gap_it_does_not_end_by_itself(self) -> None:
        bench = Bench()
        bench.at(NOW, ENDS)
        assert bench.at(101.0) == {Cause.COVERAGE_ENDS}

    def test_on_the_ground_there_is_none(self) -> None:
        bench = Bench(flying=False)
        bench.conditions.position_seen(GAP, NOW)
        assert bench.conditions.crossing.gap is None
        assert not bench.conditions.may_cross(NOW)

    def test_it_is_crossed_with_a_fresh_position_in_flight_and_an_owner(self) -> None:
        for change in ("old position", "no owner", "ground"):
            bench = self.in_gap()
            assert bench.conditions.may_cross(101.9)
            if change == "no owner":
                bench.told.owner = None
            if change == "ground":
                bench.said(NOW, flying=False)
            assert not bench.conditions.may_cross(102.0 if change == "old position" else 101.0), change

    @pytest.mark.parametrize(("lost", "crosses"), [(False, True), (True, False)])
    def test_right_before_it_only_with_a_commander(self, lost: bool, crosses: bool) -> None:
        bench = Bench()
        bench.at(NOW, gap=BEFORE_GAP)
        bench.told.lost = lost
        assert bench.conditions.may_cross(NOW) is crosses

    def test_a_commander_that_is_lost_in_it_begins_the_crossing(self) -> None:
        bench = Bench()
        bench.at(NOW, gap=GAP)
        assert bench.conditions.crossing.since is None
        assert bench.conditions.commander_lost(101.0)
        assert bench.conditions.crossing.since == 101.0

    def test_and_the_aircraft_flies_on_only_with_a_fresh_position_and_not_before_the_gap(self) -> None:
        bench = Bench()
        bench.at(NOW, gap=GAP)
        assert not bench.conditions.commander_lost(102.0)
        bench.at(NOW, gap=BEFORE_GAP)
        assert not bench.conditions.commander_lost(NOW)
        bench.at(NOW, gap=GAP)
        bench.said(NOW, flying=False)
        assert not bench.conditions.commander_lost(NOW)

    def test_the_flights_end_ends_it(self) -> None:
        bench = self.in_gap()
        bench.conditions.landed()
        assert (bench.conditions.crossing.gap, bench.conditions.crossing.since) == (None, None)


class TestDue:
    """When a condition begins though no event comes."""

    def test_each_loss_at_its_time(self) -> None:
        bench = Bench()
        bench.flight.autopilot_said(AutopilotState(True, True), 101.5)
        bench.conditions.evaluate(101.5)
        assert bench.conditions.due_at() == [104.5, 102.0, 102.0]

    def test_a_position_that_cannot_be_late_is_not_waited_for(self) -> None:
        bench = Bench()
        bench.conditions.evaluate(NOW)
        assert bench.conditions.due_at() == [103.0, 102.0]

    def test_a_guard_that_is_not_required_is_not_waited_for(self) -> None:
        bench = Bench(Limits(guard_required=False))
        bench.conditions.evaluate(NOW)
        assert bench.conditions.due_at() == [103.0]

    def test_what_is_seen_already_is_not_due(self) -> None:
        bench = Bench()
        bench.flight.autopilot_said(AutopilotState(True, True), 101.5)
        bench.conditions.evaluate(104.5)
        assert bench.conditions.due_at() == []

# SPDX-License-Identifier: GPL-3.0-or-later

"""Safety as a whole, with an authority that says what the test wants: restarts, events, and what is due."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.common.authority_facts import CoverageFacts
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Action,
    Announce,
    AutopilotState,
    GuardSeen,
    ModeSeen,
    MotionSeen,
    MotionUnseen,
    OrderRefused,
    PlaceJudged,
)
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GapFact, GuardState, ModeClass, Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.core.safety.command_verification import Seen
from mavproxy_handover.core.safety.emergency import News
from mavproxy_handover.core.safety.safety import Safety
from mavproxy_handover.core.safety.strategy import Decision
from tests.core.safety.test_conditions_alone import Told

NOW = 100.0
A = 251
LEFT = Snapshot(A, 4, 7, Phase.ON_MISSION, 0, b"", (A,))
ENDS = CoverageFacts(ends_ahead=True)
HOLD, RETURN, LAND = FlightAction.HOLD, FlightAction.RETURN, FlightAction.LAND


class Bench:
    """An aircraft in flight on its mission; everything that it says is fresh at `now`."""

    def __init__(self, limits: Limits | None = None) -> None:
        self.told, self.flight = Told(), Flight(limits or Limits())
        self.safety = Safety(self.told, self.flight, limits or Limits())
        self.actions: list[Action] = []
        self.says(NOW)

    def says(self, now: float, *, flying: bool = True) -> None:
        self.flight.autopilot_said(AutopilotState(flying, flying), now)
        self.flight.guard_said(GuardSeen(GuardState.LIVE, ours=True), now)
        self.flight.position_seen(now)

    def position(self, now: float, facts: CoverageFacts | None = None, gap: GapFact | None = None) -> None:
        self.says(now)
        self.told.facts = facts or CoverageFacts()
        self.safety.position_seen(gap, now)

    def judge(self, now: float) -> News | None:
        """Decide, and carry that out."""
        _facts, news = self.safety.judge(now)
        if news is not None:
            self.safety.executor.carry_out(news, now, self.actions)
        return news

    def fly(self, mode: ModeClass) -> None:
        self.safety.handle(ModeSeen(mode, mode.name), NOW, self.actions)

    def verify(self, now: float) -> Seen | None:
        safety = self.safety
        return safety.verification.verify(safety.mode, safety.facts.now(now), False, now)


def held() -> Bench:
    """Coverage ends ahead, and the aircraft has been ordered to hold."""
    bench = Bench()
    bench.fly(ModeClass.MISSION)
    bench.position(NOW, ENDS)
    news = bench.judge(NOW)
    assert news is not None
    assert news.holds
    return bench


class TestRestart:
    def test_without_an_emergency_nothing_is_over_afterwards(self) -> None:
        bench = Bench()
        bench.safety.resume(LEFT)
        bench.position(NOW)
        assert bench.judge(NOW) is None

    @pytest.mark.parametrize("left", [replace(LEFT, phase=Phase.EMERGENCY), replace(LEFT, stands=True)])
    def test_an_emergency_of_the_run_before_is_over_when_no_cause_is_found(self, left: Snapshot) -> None:
        bench = Bench()
        bench.safety.resume(left)
        bench.position(NOW)
        assert bench.judge(NOW) == News(None, None, grave=True)

    def test_while_the_owner_may_come_back_that_is_not_known(self) -> None:
        bench = Bench()
        bench.safety.resume(replace(LEFT, phase=Phase.EMERGENCY))
        bench.told.recovering = True
        bench.position(NOW)
        assert bench.judge(NOW) is None

    @pytest.mark.parametrize(("proven", "left_s"), [(True, 55.0), (False, 0.0)])
    def test_a_crossing_goes_on_with_the_time_that_is_left(self, proven: bool, left_s: float) -> None:
        bench = Bench()
        bench.safety.resume(replace(LEFT, gap_since=95.0, proven=proven))
        bench.told.covered, bench.told.out_of_coverage = False, True
        bench.position(NOW, gap=GapFact(60.0, "GCSA to GCSB"))
        assert bench.safety.conditions.crossing.left_s(NOW) == left_s

    def test_a_hold_goes_on(self) -> None:
        bench = Bench()
        bench.safety.resume(replace(LEFT, stands=True, held_for=Cause.COVERAGE_ENDS, held_since=80.0))
        assert bench.safety.emergency.told == Decision(HOLD, Cause.COVERAGE_ENDS)
        assert (bench.safety.resuming, bench.safety.held_since) == (True, 80.0)

    def test_a_hold_whose_beginning_is_not_known_has_no_time_left(self) -> None:
        bench = Bench()
        bench.safety.resume(replace(LEFT, stands=True, held_for=Cause.COVERAGE_ENDS))
        assert bench.safety.hold_timer.used_up(NOW)

    def test_on_the_ground_the_aircraft_stands_by_no_order(self) -> None:
        bench = Bench()
        bench.safety.resume(replace(LEFT, stands=True, held_since=80.0))
        bench.says(NOW, flying=False)
        bench.safety.judge(NOW)
        assert (bench.safety.resuming, bench.safety.verification.stands) == (False, False)


class TestHeldSince:
    def test_from_the_order_until_another_moves_the_aircraft(self) -> None:
        bench = Bench()
        assert bench.safety.held_since is None
        bench = held()
        assert bench.safety.held_since == NOW
        bench.safety.verification.over()
        assert bench.safety.held_since is None

    def test_an_aircraft_that_was_ordered_home_and_still_stands_has_been_held_since_then(self) -> None:
        bench = held()
        bench.told.lost = True
        bench.judge(101.0)
        assert bench.safety.executor.held_for is None
        assert bench.safety.held_since == NOW

    def test_an_aircraft_that_stands_without_a_time_was_told_to_go_on(self) -> None:
        bench = held()
        bench.safety.hold_timer.overridden()
        assert bench.safety.verification.stands
        assert bench.safety.held_since is None


class TestEvents:
    def test_a_refused_order(self) -> None:
        bench = Bench()
        bench.fly(ModeClass.MISSION)
        bench.safety.verification.ordered(RETURN, NOW)
        bench.safety.handle(OrderRefused(RETURN), NOW, bench.actions)
        assert bench.verify(NOW) is Seen.REFUSED

    def test_motion_shows_a_hold_while_it_is_known(self) -> None:
        for known in (True, False):
            bench = Bench()
            bench.fly(ModeClass.MISSION)
            bench.safety.verification.ordered(HOLD, NOW)
            bench.safety.handle(MotionSeen(0.0, 0.0, None), NOW, bench.actions)
            if not known:
                bench.safety.handle(MotionUnseen(), NOW, bench.actions)
            assert bench.verify(NOW) is (Seen.OBEYED if known else None)

    def test_another_return_site_is_told(self) -> None:
        bench = Bench()
        bench.fly(ModeClass.MISSION)
        bench.told.lost = True
        bench.judge(NOW)
        bench.safety.executor.tell_return(NOW, bench.actions)
        bench.actions.clear()
        bench.safety.handle(PlaceJudged("field", True), NOW, bench.actions)
        [told] = bench.actions
        assert isinstance(told, Announce)
        assert "field" in told.text

    def test_the_end_of_the_flight_ends_every_order(self) -> None:
        bench = held()
        bench.safety.landed()
        assert (bench.safety.verification.order, bench.safety.verification.stands) == (None, False)

    def test_a_lost_commander_lets_the_aircraft_cross_a_gap_unless_it_comes_home(self) -> None:
        bench = Bench()
        bench.fly(ModeClass.MISSION)
        bench.position(NOW, gap=GapFact(60.0, "GCSA to GCSB"))
        assert bench.safety.commander_lost(NOW)
        bench = Bench(Limits(policies={Cause.GUARD_LOST: "return"}, hold_off_s={Cause.GUARD_LOST: 0.0}))
        bench.fly(ModeClass.MISSION)
        bench.position(NOW, gap=GapFact(60.0, "GCSA to GCSB"))
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), NOW)
        bench.judge(NOW)
        assert bench.safety.emergency.brings_down
        assert not bench.safety.commander_lost(NOW)


class TestOrderedOnAtABorder:
    """A new order because coverage ends ahead uses up what the commander said of that border; nothing else does."""

    def ordered_on(self, limits: Limits | None = None) -> Bench:
        bench = Bench(limits)
        bench.fly(ModeClass.MISSION)
        bench.position(NOW, ENDS)
        bench.safety.conditions.evaluate(NOW)
        bench.safety.conditions.overruled()
        assert bench.safety.conditions.passed_at_m == 60.0
        return bench

    def test_a_new_order(self) -> None:
        bench = self.ordered_on()
        bench.judge(NOW)
        assert bench.safety.conditions.passed_at_m is None

    def test_a_warning(self) -> None:
        bench = self.ordered_on(Limits(policies={Cause.COVERAGE_ENDS: "warn"}))
        news = bench.judge(NOW)
        assert news is not None
        assert news.warning
        assert bench.safety.conditions.passed_at_m == 60.0

    def test_an_order_for_another_cause(self) -> None:
        limits = Limits(
            policies={Cause.COVERAGE_ENDS: "warn", Cause.GUARD_LOST: "return"}, hold_off_s={Cause.GUARD_LOST: 0.0}
        )
        bench = self.ordered_on(limits)
        bench.flight.guard_said(GuardSeen(GuardState.DISABLED, ours=True), NOW)
        news = bench.judge(NOW)
        assert news is not None
        assert news.decision == Decision(RETURN, Cause.GUARD_LOST)
        assert bench.safety.conditions.passed_at_m == 60.0


class TestDue:
    def test_in_flight_the_losses_and_the_hold(self) -> None:
        bench = held()
        bench.judge(NOW)
        assert set(bench.safety.due_at()) == {103.0, 102.0, 160.0}

    def test_on_the_ground_none_of_them(self) -> None:
        bench = held()
        bench.says(101.0, flying=False)
        assert bench.safety.due_at() == []

    def test_nothing_is_due_that_was_never_heard(self) -> None:
        bench = Bench()
        bench.flight._guard_at = -inf
        assert bench.safety.due_at() == [103.0]

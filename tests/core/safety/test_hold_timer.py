# SPDX-License-Identifier: GPL-3.0-or-later

"""How long the aircraft has been held, and the facts that this and other parts give to a decision."""

from __future__ import annotations

from math import inf

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import AutopilotState, ModeSeen, PlaceJudged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GapFact, ModeClass
from mavproxy_handover.core.safety.command_verification import CommandVerification
from mavproxy_handover.core.safety.decision_facts import DecisionFacts
from mavproxy_handover.core.safety.emergency import News
from mavproxy_handover.core.safety.hold_timer import HoldTimer
from mavproxy_handover.core.safety.mode_source import ModeTracker
from mavproxy_handover.core.safety.strategy import Decision, Fact
from tests.core.safety.test_conditions_alone import Bench as Surroundings

NOW = 100.0
HOLD = Decision(FlightAction.HOLD, Cause.COVERAGE_ENDS)
RETURN = Decision(FlightAction.RETURN, Cause.COVERAGE_ENDS)
WARN = Decision(FlightAction.WARN, Cause.COVERAGE_ENDS)


def held(at: float = NOW) -> HoldTimer:
    timer = HoldTimer(Limits(hold_s=60.0))
    timer.decided(News(HOLD, None), at, stands=False)
    return timer


class TestTime:
    def test_it_runs_from_the_order(self) -> None:
        timer = HoldTimer(Limits())
        assert (timer.used_up(NOW), timer.due_at(), timer.resuming) == (False, None, False)
        timer = held()
        assert [timer.used_up(now) for now in (NOW, 159.9, 160.0)] == [False, False, True]

    def test_it_is_due_until_it_is_used_up(self) -> None:
        timer = held()
        timer.used_up(NOW)
        assert timer.due_at() == 160.0
        timer.used_up(160.0)
        assert timer.due_at() is None

    def test_another_order_to_hold_gives_no_new_time_while_the_aircraft_stands(self) -> None:
        timer = held()
        timer.decided(News(HOLD, WARN), 120.0, stands=True)
        assert timer.held_at == NOW
        timer.decided(News(HOLD, WARN), 130.0, stands=False)
        assert timer.held_at == 130.0

    def test_an_aircraft_that_stands_and_was_told_to_go_on_is_held_anew(self) -> None:
        timer = held()
        timer.overridden()
        assert timer.held_at == -inf
        timer.decided(News(HOLD, None), 120.0, stands=True)
        assert timer.held_at == 120.0

    @pytest.mark.parametrize(
        ("news", "stands", "held_at"),
        [
            (News(None, HOLD), True, -inf),
            (News(RETURN, HOLD), True, NOW),
            (News(RETURN, HOLD), False, -inf),
        ],
    )
    def test_the_end_of_the_cause_ends_it_and_so_does_an_order_that_moves_the_aircraft(
        self, news: News, stands: bool, held_at: float
    ) -> None:
        timer = held()
        timer.decided(news, 120.0, stands=stands)
        assert timer.held_at == held_at

    @pytest.mark.parametrize(("since", "certain", "left_s"), [(80.0, True, 40.0), (80.0, False, 0.0)])
    def test_after_a_restart_it_goes_on(self, since: float, certain: bool, left_s: float) -> None:
        timer = HoldTimer(Limits(hold_s=60.0))
        timer.resume_hold(since, certain=certain)
        assert timer.resuming
        assert timer.used_up(NOW) is (left_s == 0.0)
        assert timer.used_up(NOW + left_s)
        timer.aircraft_known()
        assert not timer.resuming

    def test_a_hold_whose_beginning_is_not_known_has_no_time_left(self) -> None:
        timer = HoldTimer(Limits())
        timer.resume_hold(None, certain=True)
        assert timer.used_up(NOW)

    def test_an_aircraft_that_was_told_to_go_on_before_the_restart_is_not_held(self) -> None:
        timer = HoldTimer(Limits())
        timer.resume(None, certain=True)
        assert (timer.held_at, timer.resuming) == (-inf, True)


class Bench(Surroundings):
    """What a decision rests on, of an aircraft that flies a mission in its commander's zone."""

    def __init__(self) -> None:
        super().__init__()
        self.timer, self.mode, self.verification = HoldTimer(Limits()), ModeTracker(), CommandVerification(Limits())
        self.facts = DecisionFacts(self.told, self.flight, self.conditions, self.timer, self.mode, self.verification)
        self.fly(ModeClass.MISSION)

    def fly(self, mode: ModeClass) -> None:
        self.mode.seen(ModeSeen(mode, mode.name, False, False), False, NOW)

    def now(self, now: float = NOW) -> frozenset[Fact]:
        return self.facts.now(now)


ALOFT = {Fact.FLYING, Fact.AUTOPILOT, Fact.PLACE, Fact.MAY_HOLD}


class TestFacts:
    def test_in_flight_nothing_held_back(self) -> None:
        assert Bench().now() == ALOFT

    def test_the_mode_says_who_flies_but_not_in_a_rehearsal(self) -> None:
        bench = Bench()
        bench.fly(ModeClass.RETURN)
        assert bench.now() == ALOFT | {Fact.RETURNING}
        bench.flight.rehearsal_begun()
        assert bench.now() == ALOFT

    def test_a_return_needs_a_place_that_can_be_reached_and_an_autopilot_that_follows(self) -> None:
        bench = Bench()
        bench.facts.place_judged(PlaceJudged("home", True))
        assert Fact.PLACE in bench.now()
        bench.verification.unable = frozenset({FlightAction.RETURN})
        assert Fact.PLACE not in bench.now()
        bench.verification.unable = frozenset()
        bench.facts.place_judged(PlaceJudged("home", False))
        assert Fact.PLACE not in bench.now()

    def test_a_hold_needs_the_commanders_zone(self) -> None:
        bench = Bench()
        bench.told.covered = False
        assert Fact.MAY_HOLD not in bench.now()

    def test_a_hold_needs_a_commander_that_is_heard(self) -> None:
        bench = Bench()
        bench.told.lost = True
        assert Fact.MAY_HOLD not in bench.now()

    def test_a_hold_needs_an_autopilot_that_follows(self) -> None:
        bench = Bench()
        bench.verification.unable = frozenset({FlightAction.HOLD})
        assert Fact.MAY_HOLD not in bench.now()

    def test_a_hold_needs_time(self) -> None:
        bench = Bench()
        bench.timer.decided(News(HOLD, None), NOW, stands=False)
        bench.said(159.0)
        assert Fact.MAY_HOLD in bench.now(159.9)
        assert Fact.MAY_HOLD not in bench.now(160.0)

    def test_a_hold_needs_a_position_to_stand_still_by(self) -> None:
        bench = Bench()
        bench.flight.autopilot_said(AutopilotState(True, True), 101.5)
        bench.conditions.evaluate(102.0)
        assert Fact.MAY_HOLD in bench.now(102.9)
        assert Fact.MAY_HOLD not in bench.now(103.0)

    def test_after_a_restart_the_aircraft_counts_as_being_where_it_can_be_held(self) -> None:
        bench = Bench()
        bench.told.covered = False
        bench.timer.resume(NOW, certain=True)
        assert Fact.MAY_HOLD in bench.now()

    def test_a_gap_with_time_left(self) -> None:
        bench = Bench()
        bench.told.covered, bench.told.out_of_coverage = False, True
        bench.at(NOW, gap=GapFact(1.5, "GCSA to GCSB"))
        assert Fact.GAP in bench.now(101.4)
        assert Fact.GAP not in bench.now(101.5)


class TestFactsDue:
    """When a fact changes in flight though no event comes."""

    def test_nothing_is_due_without_a_time_that_runs(self) -> None:
        bench = Bench()
        bench.now()
        assert bench.facts.due_at() == []

    def test_the_end_of_a_crossing_while_the_aircraft_may_fly_on(self) -> None:
        bench = Bench()
        bench.told.covered, bench.told.out_of_coverage = False, True
        bench.at(NOW, gap=GapFact(1.5, "GCSA to GCSB"))
        bench.now(101.0)
        assert bench.facts.due_at() == [101.5]
        bench.now(101.5)
        assert bench.facts.due_at() == []

    def test_before_a_crossing_there_is_no_end_of_it(self) -> None:
        bench = Bench()
        bench.at(NOW, gap=GapFact(60.0, "GCSA to GCSB"))
        assert Fact.GAP in bench.now()
        assert bench.facts.due_at() == []

    def test_the_end_of_the_last_position_while_the_aircraft_may_be_held(self) -> None:
        bench = Bench()
        bench.flight.autopilot_said(AutopilotState(True, True), 101.5)
        bench.conditions.evaluate(102.0)
        bench.now(102.0)
        assert bench.facts.due_at() == [103.0]
        bench.timer.resume(NOW, certain=True)
        assert bench.facts.due_at() == []
        bench.timer.aircraft_known()
        bench.told.covered = False
        bench.now(102.0)
        assert bench.facts.due_at() == []

# SPDX-License-Identifier: GPL-3.0-or-later

"""A gap that the mission declares is crossed alone: no emergency in it, no longer than its limit."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    ConditionsSeen,
    Fly,
    GapsJudged,
    HeightsJudged,
    LinkJudged,
    ModeSeen,
    ReturnJudged,
    StartRefused,
    StartRequested,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GapFact, LeaseState, ModeClass, Reason, ZoneFact
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.core.safety.gap import Crossing
from tests.core.bench import (
    A,
    B,
    Bench,
    C,
    D,
    DroneConnected,
    OnHandover,
    Phase,
    TransferKey,
    far,
    inside,
    outside,
)

GAP = GapFact(40.0, "GCSA -> GCSB")
AHEAD = GapFact(40.0, "GCSA -> GCSB", ahead=True)
HOLD = Fly(FlightAction.HOLD, Reason.COVERAGE_ENDS)
NOWHERE = far(A, B, C, D)


def mission(limits: Limits | None = None, *alive: int) -> Bench:
    bench = Bench(limits)
    bench.alive = {A, *alive}
    bench.on_mission()
    bench.log.clear()
    return bench


def crossing(limits: Limits | None = None, *alive: int) -> Bench:
    """Out of GCSA's zone, in the gap, and GCSA still heard."""
    bench = mission(limits, *alive)
    bench.gap = AHEAD
    bench.position(replace(inside(A, exit_s=3.0), ends_s=3.0), *far(B, C, D))
    bench.gap = GAP
    bench.position(*NOWHERE)
    return bench


def lost_in_the_gap(limits: Limits | None = None, *alive: int) -> Bench:
    """The same, and its commander has just been lost."""
    bench = crossing(limits, *alive)
    bench.alive.discard(A)
    bench.run(5.6)
    assert bench.arbiter.view.commander is None
    return bench


def told(bench: Bench) -> list[str]:
    return [record.text for record in bench.records("gap")]


def trouble(bench: Bench) -> list[str]:
    return [record.event for event in ("emergency", "warning") for record in bench.records(event)]


class TestIntoIt:
    def test_the_plan_says_that_coverage_ends_so_it_is_not_held_at_the_border(self) -> None:
        bench = mission()
        bench.gap = AHEAD
        bench.position(replace(inside(A, exit_s=3.0), ends_s=3.0), *far(B, C, D))
        assert bench.flights() == []
        assert told(bench) == ["coverage ends ahead: It crosses the mission's gap GCSA -> GCSB, at most 40 s"]

    def test_an_aircraft_that_was_held_before_goes_on(self) -> None:
        bench = mission()
        ending = replace(inside(A, exit_s=3.0), ends_s=3.0)
        bench.position(ending, *far(B, C, D))
        assert bench.flights() == [HOLD]
        bench.gap = AHEAD
        bench.position(ending, *far(B, C, D))
        assert bench.flights() == [HOLD, Fly(FlightAction.CONTINUE, Reason.COVERAGE_ENDS)]

    def test_a_commander_that_is_lost_before_the_border_is_an_ordinary_loss(self) -> None:
        bench = mission()
        bench.gap = AHEAD
        bench.position(inside(A, exit_s=3.0), *far(B, C, D))
        bench.alive.clear()
        bench.run(8.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_nor_do_leases_say_for_a_moment_that_it_is_alone(self) -> None:
        """The guard would keep the time that the first of them has left, which is none. Found by a campaign."""
        bench = mission()
        bench.gap = AHEAD
        bench.position(inside(A, exit_s=3.0), *far(B, C, D))
        bench.alive.clear()
        bench.run(8.0)
        assert {change.view.lease for change in bench.views()} == {LeaseState.LOST}

    def test_nor_where_it_is_brought_home_and_another_hand_holds_that_back(self) -> None:
        """A return that has to wait for who flies is one all the same. Found by a campaign."""
        bench = crossing()
        bench.give(ModeSeen(ModeClass.MISSION, "AUTO", radio=True))
        bench.give(ConditionsSeen(energy=True))
        bench.run(3.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        bench.alive.clear()
        bench.run(6.0)
        bench.give(ModeSeen(ModeClass.HANDS, "LOITER", radio=True))
        bench.run(1.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert LeaseState.ALONE not in {change.view.lease for change in bench.views()}
        assert bench.arbiter.alone_s(bench.now) == 0.0

    def test_nor_where_the_gap_ends_with_the_zone_whose_station_is_asked(self) -> None:
        """One position says that the gap is over and that a zone begins. Found by a campaign."""
        bench = lost_in_the_gap(None, B)
        assert bench.arbiter.view.lease is LeaseState.ALONE
        bench.gap = None
        mark = len(bench.views())
        bench.position(*far(A), inside(B), *far(C, D))
        assert bench.arbiter.view.partner == B
        assert {change.view.lease for change in bench.views()[mark:]} == {LeaseState.LOST}

    def test_out_of_coverage_in_it_is_no_emergency_and_the_journal_says_so(self) -> None:
        bench = crossing()
        bench.run(20.0)
        assert (bench.flights(), trouble(bench)) == ([], [])
        assert told(bench)[-1] == "out of coverage: It crosses the mission's gap GCSA -> GCSB, 39 s left"
        view = bench.arbiter.view
        assert (view.phase, view.lease, view.commander) == (Phase.ON_MISSION, LeaseState.HELD, A)


class TestAlone:
    def test_a_lost_commander_is_expected_and_nobody_is_told_of_a_loss_between(self) -> None:
        bench = lost_in_the_gap()
        assert [change.view.lease for change in bench.views()] == [LeaseState.ALONE]
        assert (bench.flights(), trouble(bench)) == ([], [])
        assert bench.arbiter.view.phase is Phase.ON_MISSION
        assert told(bench)[-1].startswith("commander lost: It crosses the mission's gap GCSA -> GCSB, 3")

    def test_the_time_that_is_left_runs_from_where_coverage_ended(self) -> None:
        bench = crossing()
        began_at = bench.now
        assert bench.arbiter.alone_s(bench.now) == 0.0  # there is a commander
        bench.alive.clear()
        bench.run(10.0)
        assert bench.arbiter.alone_s(bench.now) == pytest.approx(began_at + 40.0 - bench.now)

    def test_at_its_end_the_aircraft_comes_home(self) -> None:
        bench = crossing()
        began_at = bench.now
        bench.alive.clear()
        bench.run(120.0)
        (home,) = [(at, action) for at, action in bench.log if isinstance(action, Fly)]
        assert home == (began_at + 40.0, Fly(FlightAction.RETURN, Reason.COMMANDER_LOST))
        view = bench.arbiter.view
        assert (view.phase, view.lease) == (Phase.EMERGENCY, LeaseState.LOST)
        assert bench.arbiter.alone_s(bench.now) == 0.0
        # the guard hears LOST before, or when, the aircraft is told to turn
        order = [action for at, action in bench.log if at == home[0] and isinstance(action, (Fly, ViewChanged))]
        assert isinstance(order[0], ViewChanged)
        assert order[0].view.lease is LeaseState.LOST

    def test_it_does_so_with_a_commander_too(self) -> None:
        bench = crossing()
        began_at = bench.now
        bench.run(60.0)
        assert [(at, action.action) for at, action in bench.log if isinstance(action, Fly)] == [
            (began_at + 40.0, FlightAction.RETURN)
        ]

    def test_a_commander_that_comes_back_for_a_moment_gives_no_new_time(self) -> None:
        bench = crossing()
        began_at = bench.now
        bench.alive.clear()
        bench.run(10.0)
        bench.alive = {A}
        bench.run(5.0)
        assert (bench.arbiter.view.lease, bench.arbiter.view.commander) == (LeaseState.HELD, A)
        bench.alive.clear()
        bench.run(10.0)
        assert bench.arbiter.view.lease is LeaseState.ALONE
        bench.run(60.0)
        assert [at for at, action in bench.log if isinstance(action, Fly)] == [began_at + 40.0]

    def test_nor_does_a_mode_that_comes_and_goes(self) -> None:
        bench = crossing()
        began_at = bench.now
        bench.run(10.0)
        bench.gap = None  # it has left AUTO
        bench.run(2.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.OUT_OF_COVERAGE)]
        bench.gap = GAP
        bench.position(*NOWHERE)
        bench.run(30.0)
        assert bench.now > began_at + 40.0
        assert may_cross(bench) is False

    def test_energy_goes_before_it_and_then_it_is_no_authority(self) -> None:
        bench = lost_in_the_gap()
        bench.give(ConditionsSeen(energy=True))
        bench.run(3.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.ENERGY)]
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_weak_links_are_no_sign_there(self) -> None:
        bench = crossing(Limits(policies={Cause.LINKS_WEAK: "return"}, link_weak_s=0.5))
        bench.give(LinkJudged(A, True, False, "loss"))
        bench.run(20.0)
        assert bench.flights() == []
        bench.gap = None
        bench.position(inside(A), *far(B, C, D))
        bench.run(20.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.LINK_QUALITY)]

    def test_without_a_position_nothing_is_known_of_a_gap(self) -> None:
        bench = lost_in_the_gap()
        bench.facts = None
        bench.run(4.0)
        assert FlightAction.RETURN in [action.action for action in bench.flights()]
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_nor_where_the_position_was_old_when_its_commander_was_lost(self) -> None:
        """Not for a moment either: the guard would keep the time that such a lease has left."""
        bench = mission()
        bench.gap = GAP
        bench.position(inside(A), *far(B, C, D))
        bench.alive.clear()
        bench.run(1.0)
        bench.facts = None
        bench.run(6.0)
        assert bench.arbiter.view.lease is LeaseState.LOST
        assert LeaseState.ALONE not in {change.view.lease for change in bench.views()}

    def test_nor_of_an_aircraft_that_stands_on_the_ground_when_its_commander_is_lost(self) -> None:
        bench = crossing()
        bench.alive.clear()
        bench.run(4.6)
        bench.facts = None
        bench.autopilot_says(armed=True, flying=False)
        bench.run(1.0)
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.lease is LeaseState.LOST
        assert LeaseState.ALONE not in {change.view.lease for change in bench.views()}

    def test_where_a_zone_still_reaches_its_time_runs_from_the_loss(self) -> None:
        bench = mission()
        bench.gap = GAP
        bench.position(inside(A), *far(B, C, D))
        bench.alive.clear()
        bench.run(4.6)
        assert bench.arbiter.snapshot().gap_since is None
        bench.facts = None  # no position begins it
        bench.run(1.0)
        since = bench.arbiter.snapshot().gap_since
        assert (bench.arbiter.view.lease, since is not None) == (LeaseState.ALONE, True)
        bench.facts = (inside(A), *far(B, C, D))
        bench.run(60.0)
        assert bench.arbiter.snapshot().gap_since == since
        assert since is not None
        assert [at for at, action in bench.log if isinstance(action, Fly)] == [since + 40.0]

    def test_so_it_does_where_a_gap_is_entered_behind_the_loss(self) -> None:
        bench = mission()
        bench.alive.clear()
        bench.run(8.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]
        bench.gap = GAP
        bench.position(inside(A), *far(B, C, D))
        assert bench.arbiter.snapshot().gap_since == bench.now

    @pytest.mark.parametrize("facts", [NOWHERE, (inside(A), *far(B, C, D))])
    def test_whom_nobody_ever_commanded_comes_home_from_a_gap_as_well(self, facts: tuple[ZoneFact, ...]) -> None:
        bench = Bench()
        bench.alive = set()
        bench.gap, bench.facts = GAP, facts
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        assert bench.arbiter.view.lease is LeaseState.LOST
        assert {action.action for action in bench.flights()} == {FlightAction.RETURN}
        assert bench.arbiter.snapshot().gap_since is not None

    def test_in_the_zone_of_another_station_it_does_not_run_while_it_is_commanded(self) -> None:
        bench = mission()
        bench.gap = GAP
        bench.position(outside(A), inside(B), *far(C, D))
        assert bench.arbiter.snapshot().gap_since is None

    def test_outside_the_declared_stretch_it_is_out_of_coverage_as_ever(self) -> None:
        bench = mission()
        bench.position(*NOWHERE)
        bench.run(3.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.OUT_OF_COVERAGE)]


def may_cross(bench: Bench) -> bool:
    return bench.arbiter._safety.conditions.may_cross(bench.now)


class TestContact:
    def test_the_far_station_takes_it_by_force(self) -> None:
        bench = lost_in_the_gap(None, B)
        bench.position(outside(A), inside(B), *far(C, D))
        view = bench.arbiter.view
        assert (view.partner, view.why, view.lease) == (B, Reason.COMMANDER_LOST, LeaseState.ALONE)
        key = TransferKey(A, B, view.handover_id, view.epoch)
        bench.say(B, OnHandover(key))
        bench.say(B, DroneConnected(key))
        assert (bench.arbiter.view.commander, bench.arbiter.view.lease) == (B, LeaseState.HELD)
        bench.gap = None
        bench.run(60.0)
        assert (bench.flights(), trouble(bench)) == ([], [])
        assert [record.text for record in bench.records("gap_over")] == ["the gap is crossed"]

    def test_the_next_gap_has_a_time_of_its_own(self) -> None:
        bench = lost_in_the_gap(None, B)
        bench.position(outside(A), inside(B), *far(C, D))
        view = bench.arbiter.view
        key = TransferKey(A, B, view.handover_id, view.epoch)
        bench.say(B, OnHandover(key))
        bench.say(B, DroneConnected(key))
        bench.gap = None
        bench.run(100.0)
        bench.log.clear()
        bench.gap = GapFact(20.0, "GCSB -> GCSC")
        began_at = bench.now
        bench.position(*NOWHERE)
        bench.alive.clear()
        bench.run(60.0)
        assert [at for at, action in bench.log if isinstance(action, Fly)] == [began_at + 20.0]

    def test_a_far_station_that_is_not_there_brings_it_home_behind_the_gap(self) -> None:
        bench = lost_in_the_gap()
        bench.position(outside(A), inside(B), *far(C, D))  # the few seconds for contact
        bench.run(3.0)
        assert bench.flights() == []
        bench.gap = None
        bench.position(outside(A), inside(B), *far(C, D))
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]
        assert bench.arbiter.view.lease is LeaseState.LOST


class TestRestart:
    def test_the_clock_goes_on_over_a_restart(self) -> None:
        bench = crossing()
        began_at = bench.now
        bench.alive.clear()
        bench.run(10.0)
        assert bench.arbiter.snapshot().gap_since == began_at
        bench.restart(away_s=1.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.position(*NOWHERE)
        assert bench.arbiter.view.lease is LeaseState.RECOVERING
        bench.run(4.0)
        assert (bench.arbiter.view.lease, bench.flights()) == (LeaseState.ALONE, [])
        bench.run(60.0)
        assert [at for at, action in bench.log if isinstance(action, Fly)] == [began_at + 40.0]

    def test_a_clock_of_another_boot_leaves_no_time(self) -> None:
        left = Snapshot(A, 3, 1, Phase.ON_MISSION, 0, b"", (A, B), gap_since=90.0, proven=False)
        bench = Bench()
        bench.alive = set()
        bench.restart(snapshot=left)
        bench.gap = GAP
        bench.autopilot_says(armed=True, flying=True)
        bench.position(*NOWHERE)
        bench.run(10.0)
        assert bench.arbiter.view.lease is LeaseState.LOST
        assert {action.action for action in bench.flights()} == {FlightAction.RETURN}

    def test_who_has_to_show_that_it_commanded_and_does_not_sends_nobody_through(self) -> None:
        bench = Bench()
        bench.alive = set()
        bench.restart(snapshot=Snapshot(A, 3, 1, Phase.ON_MISSION, 0, b"", (A, B), proven=False))
        bench.gap, bench.facts = GAP, NOWHERE
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        assert bench.arbiter.snapshot().gap_since is not None
        assert {action.action for action in bench.flights()} == {FlightAction.RETURN}


class TestGround:
    def test_start_is_refused_with_what_the_gaps_lack(self) -> None:
        bench = Bench().on_ground()
        bench.give(GapsJudged("HNDO_ALONE_MAX is 0 s, the gap GCSA -> GCSB may take 40 s"))
        bench.give(StartRequested(A))
        (refusal,) = [action for _at, action in bench.log if isinstance(action, StartRefused)]
        assert refusal.needs == ("gaps: HNDO_ALONE_MAX is 0 s, the gap GCSA -> GCSB may take 40 s",)
        bench.give(GapsJudged(""))
        assert bench.arbiter.start_needs(A, bench.now) == ()

    def test_and_with_why_a_return_does_not_land(self) -> None:
        bench = Bench().on_ground()
        bench.give(ReturnJudged("it would circle for ever: RTL_AUTOLAND is 0"))
        bench.give(StartRequested(A))
        (refusal,) = [action for _at, action in bench.log if isinstance(action, StartRefused)]
        assert refusal.needs == ("a return does not land: it would circle for ever: RTL_AUTOLAND is 0",)
        assert bench.rehearsal_needs(A) == ()
        bench.give(ReturnJudged(""))
        assert bench.arbiter.start_needs(A, bench.now) == ()

    def test_and_with_why_the_heights_are_not_those_that_were_checked(self) -> None:
        bench = Bench().on_ground()
        bench.give(HeightsJudged("item 2 (NAV_WAYPOINT) above sea: home is at 0 m in the plan"))
        bench.give(StartRequested(A))
        (refusal,) = [action for _at, action in bench.log if isinstance(action, StartRefused)]
        assert refusal.needs == ("heights: item 2 (NAV_WAYPOINT) above sea: home is at 0 m in the plan",)
        assert bench.rehearsal_needs(A) == ()
        bench.give(HeightsJudged(""))
        assert bench.arbiter.start_needs(A, bench.now) == ()

    def test_on_the_ground_a_lost_commander_is_lost_wherever_it_is(self) -> None:
        bench = Bench().on_ground()
        bench.gap = GAP
        bench.alive.clear()
        bench.run(10.0)
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_a_landing_ends_it(self) -> None:
        bench = lost_in_the_gap()
        bench.gap = None
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.snapshot().gap_since is None
        assert bench.arbiter.view.lease is LeaseState.LOST


class TestCrossing:
    def test_in_a_gap_ahead_there_is_no_clock_yet(self) -> None:
        watch = Crossing()
        watch.seen(AHEAD, 10.0, covered=False, exposed=True)
        assert (watch.since, watch.ends_at(), watch.left_s(10.0)) == (None, None, 0.0)
        assert (watch.open(10.0, commanded=True), watch.open(10.0, commanded=False)) == (True, False)

    def test_the_limit_is_that_of_the_gap_where_it_is(self) -> None:
        watch = Crossing()
        watch.seen(GAP, 10.0, covered=False, exposed=True)
        assert (watch.ends_at(), watch.left_s(20.0)) == (50.0, 30.0)
        watch.seen(GapFact(15.0, "GCSB -> GCSC"), 20.0, covered=False, exposed=True)
        assert (watch.since, watch.ends_at()) == (10.0, 25.0)
        assert (watch.open(24.9, commanded=False), watch.open(25.0, commanded=False)) == (True, False)
        assert watch.left_s(30.0) == 0.0

    def test_only_a_commander_in_its_own_zone_ends_it(self) -> None:
        watch = Crossing()
        watch.seen(GAP, 10.0, covered=False, exposed=True)
        watch.seen(None, 20.0, covered=False, exposed=False)  # a zone whose station does not have the aircraft
        assert watch.since == 10.0
        watch.seen(None, 30.0, covered=True, exposed=False)
        assert watch.since is None


def test_a_run_before_that_was_not_crossing_leaves_nothing_behind() -> None:
    crossing_ = Crossing()
    crossing_.resume(None, certain=False)
    assert crossing_.since is None
    crossing_.seen(GAP, 100.0, covered=False, exposed=True)
    assert crossing_.left_s(110.0) == 30.0


def test_outside_of_a_gap_no_time_is_left_and_there_is_nothing_to_say() -> None:
    crossing_ = Crossing()
    assert (crossing_.words(100.0), crossing_.left_s(100.0), crossing_.ends_at()) == ("", 0.0, None)
    crossing_.resume(100.0, certain=True)
    assert (crossing_.words(110.0), crossing_.left_s(110.0), crossing_.ends_at()) == ("", 0.0, None)

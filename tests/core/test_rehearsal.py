# SPDX-License-Identifier: GPL-3.0-or-later

"""A rehearsal on the ground: everything but the flying is as in flight, and nothing is commanded."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Action,
    Announce,
    BeginStart,
    ConditionsSeen,
    ControlAnswer,
    ControlRequested,
    ControlResult,
    EnergyJudged,
    GapsJudged,
    ModeSeen,
    RehearsalAsked,
    RehearsalMoved,
    RehearsalRefused,
    StartRefused,
    StartRequested,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GapFact, LeaseState, ModeClass, Phase, Reason, ZoneFact
from tests.core.bench import (
    KEY,
    A,
    B,
    Bench,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
    inside,
    outside,
)

IN_A = (inside(A), outside(B))
IN_BOTH = (inside(A), inside(B))
IN_B = (outside(A), inside(B))
NOWHERE = (outside(A), outside(B))
BEGUN = RehearsalMoved(True, "REHEARSAL: begun by GCSA, nothing arms", Reason.OPERATOR)


def carried(limits: Limits | None = None) -> Bench:
    """GCSA commands, and the aircraft is carried in its zone; the dwell time is over."""
    bench = Bench(limits).on_ground()
    bench.position(*IN_A)
    assert BEGUN in bench.give(RehearsalAsked(A, True))
    bench.run(10.0)
    bench.log.clear()
    return bench


def hand_over(bench: Bench, key: TransferKey) -> list[Action]:
    """Both stations say their words; returns what the last one led to."""
    bench.say(key.to_station, OnHandover(key))
    bench.say(key.from_station, OkHandover(key))
    bench.say(key.to_station, DroneConnected(key))
    return bench.say(key.from_station, DisconnectHandover(key))


def moved(bench: Bench) -> list[RehearsalMoved]:
    return [action for _at, action in bench.log if isinstance(action, RehearsalMoved)]


def said(bench: Bench) -> list[str]:
    return [action.text for _at, action in bench.log if isinstance(action, Announce)]


def ending(left_s: float) -> ZoneFact:
    """Inside the zone of GCSA, which ends so soon on the way that it is carried."""
    return ZoneFact(A, 100.0, left_s, left_s)


class TestBeginning:
    def test_the_aircraft_counts_as_on_its_mission(self) -> None:
        view = carried().arbiter.view
        assert (view.phase, view.commander, view.rehearsal) == (Phase.ON_MISSION, A, True)

    def test_what_is_locked_while_armed_is_locked(self) -> None:
        bench = Bench().on_ground()
        assert not bench.arbiter.view.armed
        bench.give(RehearsalAsked(A, True))
        assert bench.arbiter.view.armed

    def test_authority_and_epoch_stay(self) -> None:
        bench = Bench().on_ground()
        before = bench.arbiter.view
        bench.give(RehearsalAsked(A, True))
        after = bench.arbiter.view
        assert (after.commander, after.epoch, after.lease) == (before.commander, before.epoch, LeaseState.HELD)

    def test_the_view_is_told_before_the_word_of_it(self) -> None:
        bench = Bench().on_ground()
        bench.log.clear()
        bench.give(RehearsalAsked(A, True))
        kinds = [type(action).__name__ for _at, action in bench.log]
        assert kinds.index("ViewChanged") < kinds.index("RehearsalMoved")

    def test_asked_again_it_changes_nothing(self) -> None:
        bench = carried()
        view = bench.arbiter.view
        assert bench.give(RehearsalAsked(A, True)) == []
        assert bench.arbiter.view == view

    def test_of_who_does_not_command_it_is_refused(self) -> None:
        bench = Bench().on_ground()
        assert RehearsalRefused(B, True, ("GCSB does not command", "outside the zone of GCSB")) in bench.give(
            RehearsalAsked(B, True)
        )
        assert not bench.arbiter.view.rehearsal

    def test_never_armed(self) -> None:
        bench = Bench().on_ground()
        bench.autopilot_says(armed=True, flying=False)
        needs = ("the vehicle is already flying or starting",)
        assert RehearsalRefused(A, True, needs) in bench.give(RehearsalAsked(A, True))
        assert not bench.arbiter.view.rehearsal

    def test_never_in_flight(self) -> None:
        bench = Bench().on_mission()
        needs = ("the vehicle is already flying or starting",)
        assert RehearsalRefused(A, True, needs) in bench.give(RehearsalAsked(A, True))
        assert not bench.arbiter.view.rehearsal

    def test_never_while_start_is_under_way(self) -> None:
        bench = Bench().on_ground()
        assert BeginStart(A) in bench.give(StartRequested(A))
        needs = ("the vehicle is already flying or starting",)
        assert RehearsalRefused(A, True, needs) in bench.give(RehearsalAsked(A, True))

    def test_never_without_a_heartbeat_of_the_autopilot(self) -> None:
        bench = Bench().on_ground()
        bench.autopilot = False
        bench.run(3.1)
        assert RehearsalRefused(A, True, ("no autopilot",)) in bench.give(RehearsalAsked(A, True))
        assert not bench.arbiter.view.rehearsal

    def test_it_needs_mission_guard_and_position_as_start_does(self) -> None:
        bench = Bench()
        bench.guard, bench.facts = None, None
        bench.run(2.0)
        assert bench.rehearsal_needs(A) == (
            "no mission loaded",
            "the guard does not answer the lease",
            "no position",
        )

    def test_it_needs_no_energy_and_no_gap_that_the_guard_allows(self) -> None:
        bench = Bench().on_ground()
        bench.give(EnergyJudged("needs 60 Wh of 20 Wh"))
        bench.give(GapsJudged("HNDO_ALONE_MAX 0 s"))
        assert bench.rehearsal_needs(A) == ()
        assert BEGUN in bench.give(RehearsalAsked(A, True))


class TestAsInFlight:
    def test_a_zone_brings_a_handover_about(self) -> None:
        bench = carried()
        bench.position(*IN_BOTH)
        assert bench.arbiter.view.phase is Phase.ON_HANDOVER
        hand_over(bench, KEY)
        view = bench.arbiter.view
        assert (view.commander, view.epoch, view.phase, view.rehearsal) == (B, 2, Phase.ON_MISSION, True)

    def test_and_another_one_back(self) -> None:
        bench = carried()
        bench.position(*IN_BOTH)
        hand_over(bench, KEY)
        bench.position(*IN_B)
        bench.run(10.0)
        bench.position(*IN_BOTH)
        hand_over(bench, TransferKey(B, A, 2, 2))
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (A, 3)

    def test_a_request_is_judged_as_in_flight(self) -> None:
        bench = carried()
        answers = bench.give(ControlRequested(B, True, False, 10.0, B))
        assert ControlAnswer(B, ControlResult.DENIED, "the aircraft is outside the zone of GCSB") in answers

    def test_released_it_stays_with_its_commander(self) -> None:
        bench = carried()
        bench.give(ControlRequested(A, False, False, 10.0, A))
        assert bench.arbiter.view.commander == A

    def test_a_lost_commander_is_followed_by_force(self) -> None:
        bench = carried()
        bench.position(*IN_BOTH)
        bench.alive = {B}
        bench.run(5.5)
        forced = [message for _at, to, message, _n in bench.sent() if to == B]
        assert forced
        key = forced[-1].key  # type: ignore[union-attr]
        bench.say(B, OnHandover(key))
        bench.say(B, DroneConnected(key))
        assert bench.arbiter.view.commander == B
        assert bench.flights() == []

    def test_start_is_refused_with_the_reason(self) -> None:
        bench = carried()
        needs = ("a rehearsal is under way: nothing arms",)
        assert StartRefused(A, needs) in bench.give(StartRequested(A))
        assert bench.arbiter.take_off_needs(A, bench.now) == needs

    def test_disarmed_is_no_end_of_it(self) -> None:
        bench = carried()
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.view.rehearsal
        assert bench.records("landed") == []


class TestDecisions:
    """What is wrong is told as what would be done, and nothing is."""

    def lost(self) -> Bench:
        bench = carried()
        bench.alive = set()
        bench.run(8.0)
        return bench

    def test_a_return_is_told_and_not_ordered(self) -> None:
        bench = self.lost()
        assert bench.flights() == []
        assert said(bench)[-1].startswith("REHEARSAL: would RETURN. GCSA silent ")
        assert [record.text for record in bench.records("would")] == ["commander lost: would return"]
        assert bench.records("emergency") == []

    def test_it_is_shown_as_the_emergency_that_it_would_be(self) -> None:
        assert self.lost().arbiter.view.phase is Phase.EMERGENCY

    def test_no_graver_action_follows_because_nothing_obeys(self) -> None:
        bench = self.lost()
        bench.run(60.0)
        assert bench.flights() == []
        assert len(bench.records("would")) == 1

    def test_the_commander_is_back_and_it_goes_on(self) -> None:
        bench = self.lost()
        bench.alive = {A, B}
        bench.run(10.0)
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal) == (Phase.ON_MISSION, A, True)
        assert said(bench)[-1] == "REHEARSAL: ALL CLEAR. Over: commander lost"
        assert bench.flights() == []

    def test_the_next_station_takes_over_in_the_emergency(self) -> None:
        bench = self.lost()
        bench.alive = {B}
        bench.run(2.0)
        bench.position(*IN_BOTH)
        key = TransferKey(A, B, 1, 1)
        bench.say(B, OnHandover(key))
        bench.say(B, DroneConnected(key))
        assert (bench.arbiter.view.commander, bench.arbiter.view.phase) == (B, Phase.ON_MISSION)

    def test_out_of_coverage(self) -> None:
        bench = carried()
        bench.position(*NOWHERE)
        bench.run(10.0)
        assert bench.flights() == []
        assert any(text.startswith("REHEARSAL: would RETURN. Out of coverage") for text in said(bench))

    def test_a_gap_that_the_mission_declares(self) -> None:
        bench = carried()
        bench.gap = GapFact(40.0, "GCSA -> GCSB", ahead=True)
        bench.position(ending(1.0), outside(B))
        assert said(bench) == [
            "REHEARSAL: would CONTINUE. The zone of GCSA ends in 1 s, and no station is ready beyond it. "
            "It crosses the mission's gap GCSA -> GCSB, at most 40 s"
        ]
        assert bench.flights() == []

    def test_a_landing(self) -> None:
        bench = carried(Limits(policies={Cause.OUT_OF_COVERAGE: "land"}))
        bench.position(*NOWHERE)
        bench.run(10.0)
        assert bench.flights() == []
        assert any(text.startswith("REHEARSAL: would LAND. Out of coverage") for text in said(bench))

    def test_a_hold_is_over_as_soon_as_it_is_carried_away_from_the_border(self) -> None:
        """In flight it would stand there, until another station has it or its time is up. Nobody stands here."""
        bench = carried(Limits(hold_s=60.0))
        bench.position(ending(4.0), outside(B))
        bench.run(1.0)
        bench.position(*IN_A)
        bench.run(5.0)
        assert [record.text for record in bench.records("would")] == ["coverage ends ahead: would hold"]
        assert said(bench)[-1] == "REHEARSAL: ALL CLEAR. Over: coverage ends ahead"
        assert bench.arbiter.view.phase is Phase.ON_MISSION
        bench.run(120.0)
        assert len(bench.records("would")) == 1

    def test_a_hold_lasts_while_it_is_carried_towards_the_border(self) -> None:
        bench = carried(Limits(hold_s=60.0))
        bench.position(ending(4.0), outside(B))
        bench.run(1.0)
        bench.position(ending(1.0), outside(B))
        bench.run(5.0)
        assert said(bench)[-1].startswith("REHEARSAL: would HOLD. The zone of GCSA ends")

    def test_carried_over_the_border_it_is_not_over_in_between(self) -> None:
        bench = carried()
        bench.position(ending(1.0), outside(B))
        bench.run(1.0)
        bench.position(*NOWHERE)
        bench.run(10.0)
        assert [record.text for record in bench.records("would")] == [
            "coverage ends ahead: would hold",
            "coverage ends ahead: would return",
            "out of coverage: would return",
        ]
        assert not [text for text in said(bench) if "OVER" in text]
        bench.position(*IN_A)
        bench.run(10.0)
        assert said(bench)[-1] == "REHEARSAL: ALL CLEAR. Over: out of coverage"

    @pytest.mark.parametrize("policy", ["hold", "land"])
    def test_whatever_the_policy_says_nothing_is_commanded(self, policy: str) -> None:
        bench = carried(Limits(policies={Cause.LINKS_WEAK: policy, Cause.GUARD_LOST: policy}))
        bench.guard = None
        bench.run(120.0)
        assert bench.flights() == []
        assert bench.records("would")

    def test_a_warning_is_one(self) -> None:
        bench = carried()
        bench.facts = None
        bench.run(10.0)
        assert any(text.startswith("REHEARSAL: WARNING. ") for text in said(bench))
        assert bench.flights() == []

    def test_the_mode_of_what_is_carried_is_nobodys(self) -> None:
        """By hand with a radio on: in flight that is a pilot's, and nothing would be done."""
        bench = carried()
        bench.mode = ModeSeen(ModeClass.HANDS, "STABILIZE", radio=True)
        bench.run(2.0)
        bench.mode = ModeSeen(ModeClass.RETURN, "RTL", radio=True)
        bench.run(2.0)
        bench.alive = set()
        bench.run(8.0)
        assert said(bench)[-1].startswith("REHEARSAL: would RETURN. GCSA silent ")
        assert bench.records("helm") == []


class TestEnding:
    def test_by_the_commanders_word(self) -> None:
        bench = carried()
        over = RehearsalMoved(False, "REHEARSAL OVER: ended by GCSA", Reason.OPERATOR)
        assert over in bench.give(RehearsalAsked(A, False))
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal, view.armed) == (Phase.ON_LOAD, A, False, False)

    def test_by_whoever_commands_then(self) -> None:
        bench = carried()
        bench.position(*IN_BOTH)
        hand_over(bench, KEY)
        assert RehearsalRefused(A, False, ("GCSA does not command",)) in bench.give(RehearsalAsked(A, False))
        assert bench.arbiter.view.rehearsal
        bench.give(RehearsalAsked(B, False))
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal) == (Phase.ON_LOAD, B, False)

    def test_a_transfer_under_way_is_called_off(self) -> None:
        bench = carried()
        bench.position(*IN_BOTH)
        bench.give(RehearsalAsked(A, False))
        assert bench.arbiter.view.partner is None
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.CANCELLED]

    def test_without_one_there_is_nothing_to_end(self) -> None:
        bench = Bench().on_ground()
        view = bench.arbiter.view
        assert bench.give(RehearsalAsked(A, False)) == []
        assert bench.arbiter.view == view

    def test_what_would_be_done_is_not_told_behind_its_end(self) -> None:
        """A return is told with the next event: that may be the end."""
        bench = carried(Limits(hold_off_s={Cause.ENERGY: 0.0}))
        bench.give(ConditionsSeen(energy=True))
        assert [record.text for record in bench.records("would")] == ["energy only for the way back: would return"]
        bench.give(RehearsalAsked(A, False))
        bench.run(10.0)
        assert not [text for text in said(bench) if "RETURN" in text]

    def test_then_start_may_be_again(self) -> None:
        bench = carried()
        bench.give(RehearsalAsked(A, False))
        assert BeginStart(A) in bench.give(StartRequested(A))

    def test_a_second_rehearsal_begins_anew_on_the_route(self) -> None:
        bench = carried()
        bench.position(*IN_BOTH)
        hand_over(bench, KEY)
        assert bench.arbiter.snapshot().route_at == 1
        bench.give(RehearsalAsked(B, False))
        assert bench.arbiter.snapshot().route_at == 0

    def test_armed_all_the_same_it_is_over_at_once(self) -> None:
        bench = carried()
        bench.autopilot_says(armed=True, flying=False)
        over = RehearsalMoved(False, "REHEARSAL OVER: the aircraft is armed", Reason.STARTED)
        assert moved(bench) == [over]
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal, view.armed) == (Phase.ON_LOAD, A, False, True)

    def test_in_the_air_all_the_same_it_is_a_flight(self) -> None:
        bench = carried()
        bench.autopilot_says(armed=True, flying=True)
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal) == (Phase.ON_MISSION, A, False)

    def test_what_was_only_told_is_done_in_that_flight(self) -> None:
        bench = carried()
        bench.alive = set()
        bench.run(8.0)
        assert bench.flights() == []
        bench.autopilot_says(armed=True, flying=True)
        bench.run(6.0)
        assert [fly.action for fly in bench.flights()] == [FlightAction.RETURN]
        assert not said(bench)[-1].startswith("REHEARSAL")

    def test_nobody_has_commanded_for_long(self) -> None:
        bench = carried(Limits(rehearsal_lost_s=60.0))
        bench.alive = set()
        bench.run(5.0 + 59.0)
        assert bench.arbiter.view.rehearsal
        bench.run(2.0)
        assert moved(bench) == [
            RehearsalMoved(False, "REHEARSAL OVER: no station has had authority for 60 s", Reason.COMMANDER_LOST)
        ]
        assert bench.arbiter.view.phase is Phase.ON_LOAD
        assert said(bench)[-1] == "ALL CLEAR. Over: the rehearsal"

    def test_who_comes_back_in_time_goes_on(self) -> None:
        bench = carried(Limits(rehearsal_lost_s=60.0))
        for away_s, back_s in ((50.0, 5.0), (15.0, 44.0), (50.0, 1.0)):
            bench.alive = set()
            bench.run(5.0 + away_s)
            bench.alive = {A}
            bench.run(back_s)
        assert bench.arbiter.view.rehearsal

    def test_its_end_is_a_deadline(self) -> None:
        bench = carried(Limits(rehearsal_lost_s=60.0))
        bench.alive, bench.autopilot, bench.guard, bench.facts = set(), False, None, None
        begun = bench.now
        bench.run(70.0)
        ended = [at for at, action in bench.log if isinstance(action, RehearsalMoved)]
        lost = [at for at, action in bench.log if getattr(action, "event", "") == "authority_lost"]
        assert len(ended) == len(lost) == 1
        assert ended[0] == pytest.approx(lost[0] + 60.0)
        assert lost[0] > begun


class TestRestart:
    def test_it_goes_on(self) -> None:
        bench = carried().restart()
        assert bench.arbiter.view.rehearsal
        assert bench.arbiter.view.commander is None
        bench.run(2.0)
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal) == (Phase.ON_MISSION, A, True)
        assert bench.flights() == []

    def test_armed_meanwhile_it_is_over_with_the_first_heartbeat(self) -> None:
        bench = carried().restart()
        bench.armed = bench.flying = True
        bench.run(2.0)
        view = bench.arbiter.view
        assert (view.phase, view.commander, view.rehearsal) == (Phase.ON_MISSION, A, False)
        assert [each.reason for each in moved(bench)] == [Reason.STARTED]

    def test_and_its_commander_does_not_come_back(self) -> None:
        bench = carried().restart()
        bench.alive = {B}
        bench.run(8.0)
        assert bench.arbiter.view.commander is None
        assert bench.flights() == []
        assert bench.arbiter.view.rehearsal

    def test_a_flight_is_none(self) -> None:
        bench = Bench().on_mission()
        assert not bench.arbiter.snapshot().rehearsal
        assert not bench.restart().arbiter.view.rehearsal

    def test_what_was_on_the_ground_is_none(self) -> None:
        bench = carried()
        bench.give(RehearsalAsked(A, False))
        assert not bench.arbiter.snapshot().rehearsal


@pytest.mark.parametrize("begin", [True, False])
def test_the_refusal_says_what_it_is_about(begin: bool) -> None:
    bench = Bench().on_ground() if begin else carried()
    bench.give(RehearsalAsked(B, begin))
    what = "begin" if begin else "end"
    (record,) = bench.records("rehearsal_refused")
    assert record.text.startswith(f"rehearsal does not {what}: GCSB does not command")


class TestWithoutACommander:
    """The time without a commander runs in a rehearsal alone, from the moment on that there is none."""

    def test_it_runs_from_the_first_look_without_one(self) -> None:
        arbiter = Bench().arbiter
        arbiter._flight.rehearsal_begun()
        arbiter._rehearsal.update(100.0)
        arbiter._rehearsal.update(150.0)
        assert arbiter._rehearsal.due_at() == 400.0

    def test_a_commander_ends_it_and_so_does_the_end_of_the_rehearsal(self) -> None:
        for end in ("commander", "no rehearsal", "end"):
            arbiter = Bench().arbiter
            arbiter._flight.rehearsal_begun()
            arbiter._rehearsal.update(100.0)
            if end == "commander":
                arbiter._authority.grant(A, Reason.OPERATOR, [])
            elif end == "no rehearsal":
                arbiter._flight.rehearsal_over()
            else:
                arbiter._rehearsal.end()
            if end != "end":
                arbiter._rehearsal.update(101.0)
            assert arbiter._rehearsal.due_at() is None, end


def test_a_request_of_another_station_ends_when_a_rehearsal_begins() -> None:
    bench = Bench().on_ground()
    bench.position(*IN_BOTH)
    bench.give(bench.request(B))
    assert bench.arbiter.view.partner == B
    bench.give(RehearsalAsked(A, True))
    assert bench.arbiter.view.rehearsal
    assert bench.arbiter.view.partner is None

# SPDX-License-Identifier: GPL-3.0-or-later

"""Where coverage that counts ends, the aircraft stops inside; what else looks wrong, and what comes of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import ConditionsSeen, Fly, GuardSeen, LinkJudged, PlaceJudged, StationHeard
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, GuardState, Reason, ZoneFact
from tests.core.bench import (
    KEY,
    A,
    B,
    Bench,
    C,
    Consent,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    Phase,
    TransferKey,
    far,
    inside,
    outside,
)

HOLD = Fly(FlightAction.HOLD, Reason.COVERAGE_ENDS)
GO_ON = Fly(FlightAction.CONTINUE, Reason.NONE)
HOME = Fly(FlightAction.RETURN, Reason.COVERAGE_ENDS)


def ends(exit_s: float, *beyond: int) -> ZoneFact:
    """GCSA's zone, left in so many seconds; there these stations' zones are."""
    return replace(inside(A, exit_s=exit_s), ends_s=exit_s, beyond=frozenset(beyond))


def mission(limits: Limits | None = None, *alive: int) -> Bench:
    bench = Bench(limits)
    bench.alive = {A, *alive}
    bench.on_mission()
    bench.log.clear()
    return bench


class TestHold:
    def test_it_stops_before_the_last_coverage_ends(self) -> None:
        bench = mission()
        bench.position(ends(5.1), outside(B))
        assert bench.flights() == []
        bench.position(ends(5.0), outside(B))
        assert bench.flights() == [HOLD]
        # that is no emergency: it goes on looking for a partner
        assert (bench.arbiter.view.phase, bench.arbiter.view.commander) == (Phase.ON_MISSION, A)
        assert [record.text for record in bench.records("emergency")] == ["coverage ends ahead: hold"]

    def test_a_zone_that_begins_before_it_ends_is_coverage_if_its_station_could_take_the_aircraft(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(ends(3.0, A, B), outside(B))
        assert bench.flights() == []
        dead = mission()  # the fault: it flew on into the zone of a station that was not there
        dead.position(ends(3.0, A, B), outside(B))
        assert dead.flights() == [HOLD]

    def test_so_is_one_that_holds_it_already_and_lasts_longer(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(ends(3.0, A, B), inside(B, exit_s=40.0))
        assert bench.flights() == []
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(ends(3.0), replace(inside(B, exit_s=3.0), ends_s=3.0))
        assert bench.flights() == [HOLD]

    def test_standing_still_it_stays_held_until_authority_has_moved(self) -> None:
        bench = mission(None, B, C)
        bench.digests[B] = b""  # it holds another mission, for a while
        bench.run(2.0)
        bench.position(ends(4.0, A, B), inside(B))
        assert bench.flights() == [HOLD]
        bench.position(inside(A), inside(B))  # it stands: no end is in sight
        bench.run(20.0)
        assert bench.flights() == [HOLD]
        bench.digests[B] = bench.digests[A]
        bench.position(ends(2.0, A, B), inside(B))
        bench.run(3.0)
        view = bench.arbiter.view
        assert view.partner == B
        key = TransferKey(A, B, view.handover_id, view.epoch)
        for station, word in ((B, OnHandover(key)), (A, OkHandover(key)), (B, DroneConnected(key))):
            bench.say(station, word)
        assert bench.flights() == [HOLD]
        bench.say(A, DisconnectHandover(key))
        assert bench.arbiter.view.commander == B
        assert bench.flights() == [HOLD, GO_ON]

    def test_when_nobody_has_taken_it_for_a_minute_it_comes_home(self) -> None:
        bench = mission(Limits(hold_s=60.0))
        bench.position(ends(4.0), outside(B))
        held_at = bench.now
        bench.run(59.9)
        assert bench.flights() == [HOLD]
        bench.run(0.2)
        assert bench.flights() == [HOLD, HOME]
        assert [at for at, action in bench.log if action == HOME] == [held_at + 60.0]
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        bench.run(300.0)
        assert bench.flights() == [HOLD, HOME]

    def test_who_is_denied_holds_too(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(inside(A, exit_s=7.0), inside(B, exit_s=90.0))
        view = bench.arbiter.view
        key = TransferKey(A, B, view.handover_id, view.epoch)
        bench.say(B, OnHandover(key))
        bench.say(A, OkHandover(key, Consent.DENIED))
        bench.position(ends(5.0, A, B), inside(B, exit_s=90.0))
        assert bench.flights() == [HOLD]

    def test_a_partner_that_does_not_answer_for_a_second_is_no_coverage(self) -> None:
        """The fault: whoever died seconds before the border was overflown, for a station is silent after five only."""
        bench = self.asked()
        bench.run(0.9)
        assert bench.flights() == []
        bench.run(0.6)
        assert bench.flights() == [HOLD]
        assert bench.arbiter.view.partner == B, "the transfer is not called off for that"
        self.taken(bench)
        assert bench.flights() == [HOLD, GO_ON]

    def test_one_that_takes_it_within_that_second_is(self) -> None:
        bench = self.asked()
        bench.run(0.9)
        self.taken(bench)
        bench.run(5.0)
        assert bench.flights() == []

    def test_nor_is_who_is_asked_where_its_zone_lasts_longer_held_within_it(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(ends(4.0), inside(B, exit_s=40.0))
        assert bench.arbiter.view.partner == B
        bench.run(0.9)
        assert bench.flights() == []
        bench.run(0.6)
        assert bench.flights() == [HOLD]

    def test_nobody_crosses_while_an_operator_thinks(self) -> None:
        """The fault: with the question open the aircraft left the zone of the only station that commanded it."""
        for station, word in ((B, OnHandover(KEY, Consent.WAITING)), (A, OkHandover(KEY, Consent.WAITING))):
            bench = self.asked()
            if station == A:
                bench.say(B, OnHandover(KEY))
            bench.say(station, word)
            bench.run(0.9)
            assert bench.flights() == []
            bench.run(10.0)
            assert bench.flights() == [HOLD]
            assert bench.arbiter.view.partner == B
            self.taken(bench)
            assert bench.flights() == [HOLD, GO_ON]

    def test_what_is_asked_anew_for_the_zones_end_has_its_second_from_then_on(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(inside(A), inside(B, exit_s=90.0))
        bench.say(A, OkHandover(KEY, Consent.WAITING))
        bench.run(3.0)
        bench.position(ends(4.0, A, B), inside(B, exit_s=90.0))
        assert [record.reason for record in bench.records("transfer_raised")] == [Reason.ZONE_ENDS]
        assert bench.flights() == []
        bench.run(1.5)
        assert bench.flights() == [HOLD]

    def test_others_that_could_take_it_are_coverage_all_the_same(self) -> None:
        bench = mission(None, B, C)
        bench.run(2.0)
        bench.position(ends(4.0, A, B), inside(B, exit_s=40.0), inside(C, exit_s=30.0))
        bench.run(1.5)
        assert (bench.flights(), bench.arbiter.view.partner) == ([], B)

    def test_another_limit(self) -> None:
        bench = self.asked(Limits(answer_s=2.0))
        bench.run(1.9)
        assert bench.flights() == []
        bench.run(0.6)
        assert bench.flights() == [HOLD]

    def test_while_a_station_is_about_to_take_it_from_a_lost_commander_it_stays_held(self) -> None:
        """The fault: for the two seconds of a forced transfer it was told to go on, with nobody in command."""
        for takes_it in (True, False):
            bench = self.asked()
            bench.alive = {B}
            bench.run(6.0)
            assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (None, B)
            assert bench.flights() == [HOLD]
            if takes_it:
                key = TransferKey(A, B, bench.arbiter.view.handover_id, 1)
                bench.say(B, OnHandover(key))
                bench.say(B, DroneConnected(key))
                assert bench.arbiter.view.commander == B
                assert bench.flights() == [HOLD, GO_ON]
            else:
                bench.run(3.0)
                assert bench.flights() == [HOLD, Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    def test_a_commander_that_returns_has_the_same_border_ahead(self) -> None:
        """The fault: with the next epoch the border was forgotten, and it was told to go on."""
        bench = mission(Limits(forced_timeout_s=4.0), B)
        bench.run(2.0)
        bench.position(ends(4.0, A), replace(inside(B), ends_s=2.0))
        assert bench.flights() == [HOLD]
        bench.position(inside(A), inside(B))  # it stands
        bench.alive = {B}
        bench.run(6.0)
        assert bench.arbiter.view.commander is None
        bench.alive = {A, B}
        bench.run(1.0)
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (A, 2)
        assert bench.flights() == [HOLD]

    def test_a_border_that_comes_while_nobody_commands_is_not_the_commanders(self) -> None:
        bench = mission()
        bench.alive = set()
        bench.run(8.0)
        bench.position(ends(3.0), outside(B))
        bench.position(inside(A), outside(B))
        bench.alive = {A}
        bench.run(5.0)
        assert (bench.arbiter.view.commander, bench.arbiter.causes) == (A, frozenset())

    def test_nobody_is_held_where_nobody_commands(self) -> None:
        bench = mission(Limits(policies={Cause.COMMANDER_LOST: "warn", Cause.OFF_ROUTE: "hold"}))
        bench.alive = set()
        bench.run(8.0)
        assert bench.flights() == []
        bench.give(ConditionsSeen(off_route=True))
        bench.run(1.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.OFF_ROUTE)]

    @staticmethod
    def asked(limits: Limits | None = None) -> Bench:
        """Right before the border, in GCSB's zone since this moment: HANDOVER_REQUEST is out."""
        bench = mission(limits, B)
        bench.run(2.0)
        bench.position(ends(4.0, A, B), inside(B, exit_s=40.0))
        assert bench.arbiter.view.partner == B
        assert bench.flights() == []
        return bench

    @staticmethod
    def taken(bench: Bench) -> None:
        """Both stations say what there is left to say."""
        for station, word in ((B, OnHandover(KEY)), (A, OkHandover(KEY)), (B, DroneConnected(KEY))):
            bench.say(station, word)
        bench.say(A, DisconnectHandover(KEY))
        assert bench.arbiter.view.commander == B

    def test_who_waits_for_a_partners_operator_holds_until_he_has_answered(self) -> None:
        """It flew on into the partner's zone, out of the commander's. Found by a campaign."""
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(inside(A, exit_s=12.0), inside(B, exit_s=90.0))
        view = bench.arbiter.view
        key = TransferKey(A, B, view.handover_id, view.epoch)
        bench.say(B, OnHandover(key, Consent.WAITING))
        bench.position(ends(5.0, A, B), inside(B, exit_s=90.0))
        assert bench.flights() == []
        bench.run(1.5)
        assert bench.flights() == [HOLD]
        for station, word in ((B, OnHandover(key)), (A, OkHandover(key)), (B, DroneConnected(key))):
            bench.say(station, word)
        bench.say(A, DisconnectHandover(key))
        assert bench.flights() == [HOLD, GO_ON]

    def test_a_partner_whose_operator_never_answers_is_none(self) -> None:
        """Each attempt ended after 30 s, and counted for nothing when the next one began. Found by a campaign."""
        bench = mission(Limits(operator_timeout_s=30.0), B)
        bench.run(2.0)
        bench.position(inside(A, exit_s=90.0), inside(B, exit_s=190.0))
        view = bench.arbiter.view
        bench.say(B, OnHandover(TransferKey(A, B, view.handover_id, view.epoch), Consent.WAITING))
        bench.run(30.1)
        assert bench.arbiter.view.partner is None
        bench.position(ends(5.0, A, B), inside(B, exit_s=90.0))
        assert bench.flights() == [HOLD]

    def test_but_it_may_have_been_a_moment_without_a_link(self) -> None:
        bench = mission(Limits(operator_timeout_s=30.0), B)
        bench.run(2.0)
        bench.position(inside(A, exit_s=90.0), inside(B, exit_s=190.0))
        bench.run(4.1)  # nobody has answered at all
        bench.position(inside(A, exit_s=90.0))  # out of it again: it is not asked any more
        bench.run(35.1)
        bench.position(ends(5.0, A, B), outside(B))
        assert bench.flights() == []

    def test_nobody_is_held_outside_of_the_commanders_zone(self) -> None:
        """The fault: sent on by its commander out of its zone, with a partner whose operator is silent, it was held
        there for a minute. Found by the campaign."""
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(ends(4.0, A, B), inside(B, exit_s=90.0))
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        bench.run(1.5)
        assert bench.flights() == [HOLD]
        bench.position(outside(A), inside(B, exit_s=90.0))
        bench.run(1.0)
        assert bench.flights() == [HOLD, HOME]

    def test_the_loss_of_the_commander_is_graver(self) -> None:
        bench = mission()
        bench.position(ends(4.0), outside(B))
        bench.alive = set()
        bench.run(10.0)
        assert bench.flights() == [HOLD, Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    def test_the_policy_may_be_to_come_home_at_once_or_to_warn_or_not_to_look(self) -> None:
        for policy, flights, texts in (
            ("return", [HOME], ["coverage ends ahead: return"]),
            ("warn", [], ["coverage ends ahead: warn"]),
            ("off", [], []),
        ):
            bench = mission(Limits(policies={Cause.COVERAGE_ENDS: policy}))
            bench.position(ends(4.0), outside(B))
            bench.run(2.0)
            assert bench.flights() == flights
            assert [record.text for record in bench.records("emergency") + bench.records("warning")] == texts

    def test_on_the_ground_nothing_is_held(self) -> None:
        bench = Bench().on_ground()
        bench.log.clear()
        bench.position(ends(4.0), outside(B))
        bench.run(5.0)
        assert bench.flights() == []
        assert bench.records("emergency") == []

    def test_before_it_is_known_to_fly_nothing_is_looked_at(self) -> None:
        bench = mission()
        bench.autopilot = False
        bench.restart()
        bench.give(StationHeard(A))
        bench.position(ends(3.0), outside(B))
        bench.autopilot_says(armed=True, flying=True)
        assert bench.flights() == []
        bench.position(ends(3.0), outside(B))
        assert bench.flights() == [HOLD]


class TestNoStation:
    def test_in_the_zone_of_a_station_that_is_not_there_it_comes_home(self) -> None:
        bench = mission()
        entered_at = bench.now
        bench.position(outside(A), inside(B))
        bench.run(10.0)
        assert [(at, action) for at, action in bench.log if isinstance(action, Fly)] == [
            (entered_at + 2.0, Fly(FlightAction.RETURN, Reason.NO_STATION))
        ]

    def test_to_hold_there_is_to_come_home_it_is_held_only_where_its_commander_covers(self) -> None:
        bench = mission(Limits(policies={Cause.NO_STATION: "hold"}))
        bench.position(outside(A), inside(B))
        bench.run(10.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.NO_STATION)]

    def test_with_a_station_that_could_take_it_that_is_asked(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(outside(A), inside(B))
        bench.run(2.9)
        assert bench.flights() == []
        assert bench.arbiter.view.partner == B

    def test_one_that_has_not_answered_for_a_second_could_not(self) -> None:
        """The fault: over the zone of a station that had just died the aircraft flew on for five seconds."""
        bench = mission(None, B)
        bench.run(2.0)
        asked_at = bench.now
        bench.position(outside(A), inside(B))
        bench.run(4.0)
        ((at, home),) = [(at, action) for at, action in bench.log if isinstance(action, Fly)]
        assert home == Fly(FlightAction.RETURN, Reason.NO_STATION)
        # a second without an answer, the hold-off of two; the aircraft is looked at every half a second
        assert asked_at + 3.0 <= at <= asked_at + 3.5

    def test_one_that_goes_on_not_answering_could_not_however_often_it_is_asked(self) -> None:
        """The fault: with each new attempt the emergency was over for a second, and began again."""
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(outside(A), inside(B))
        bench.run(60.0)
        assert len(bench.records("transfer_aborted")) > 5
        assert len(bench.records("emergency")) == 1
        assert bench.records("emergency_over") == []
        bench.say(B, OnHandover(TransferKey(A, B, bench.arbiter.view.handover_id, 1)))
        bench.run(2.0)
        assert len(bench.records("emergency_over")) == 1, "it has answered"

    def test_a_station_of_the_standard_has_no_words_to_answer_with(self) -> None:
        bench = Bench(standard={B})
        bench.on_mission()
        bench.position(outside(A), inside(B))
        bench.say(A, OkHandover(KEY, Consent.WAITING))
        bench.run(1.0)
        bench.alive = {A}
        bench.run(7.0)
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.PARTNER_SILENT]
        assert len(bench.records("emergency")) == 1
        bench.alive = {A, B}
        bench.run(4.0)
        assert bench.arbiter.view.partner == B
        assert len(bench.records("emergency_over")) == 1

    def test_one_whose_operator_thinks_could(self) -> None:
        bench = mission(None, B)
        bench.run(2.0)
        bench.position(outside(A), inside(B))
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        bench.run(10.0)
        assert bench.flights() == []
        assert bench.arbiter.view.partner == B


class TestWarnings:
    """What nothing is done about, unless the configuration says so, is told once, and its end."""

    @staticmethod
    def texts(bench: Bench) -> list[str]:
        return [record.text for record in bench.records("warning") + bench.records("warning_over")]

    def test_a_guard_that_falls_silent(self) -> None:
        bench = mission()
        bench.guard = None
        silent_at = bench.now
        bench.run(10.0)
        assert self.texts(bench) == ["guard lost: warn"]
        (at,) = [at for at, action in bench.log if action in bench.records("warning")]
        assert silent_at + 4.0 < at <= silent_at + 5.0  # guard_lost_s, and the hold-off
        bench.guard = GuardSeen(GuardState.LIVE, ours=True)
        bench.run(3.0)
        assert self.texts(bench) == ["guard lost: warn", "the cause of the warning is gone"]
        assert bench.flights() == []

    def test_a_guard_that_is_switched_off(self) -> None:
        bench = mission()
        bench.guard = GuardSeen(GuardState.DISABLED, ours=True)
        bench.run(10.0)
        assert self.texts(bench) == ["guard lost: warn"]

    def test_a_vehicle_without_a_guard_misses_none(self) -> None:
        bench = mission(Limits(guard_required=False))
        bench.guard = None
        bench.run(10.0)
        assert self.texts(bench) == []

    def test_a_position_that_is_old(self) -> None:
        bench = mission()
        bench.facts = None
        bench.run(10.0)
        assert self.texts(bench) == ["no fresh position: warn"]

    def test_an_autopilot_that_is_not_heard(self) -> None:
        bench = mission()
        bench.autopilot = False
        bench.run(10.0)
        assert self.texts(bench) == ["autopilot not heard: warn"]

    def test_what_could_not_be_commanded_is_commanded_when_the_autopilot_is_back(self) -> None:
        bench = mission()
        bench.autopilot = False
        bench.run(4.0)
        bench.alive = set()
        bench.run(10.0)
        assert bench.flights() == []
        bench.autopilot = True
        bench.run(2.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    def test_weak_links_and_nobody_with_better_ones(self) -> None:
        bench = mission()
        bench.give(LinkJudged(A, weak=True, attacked=False, text="loss"))
        bench.run(9.0)
        assert self.texts(bench) == []
        bench.run(4.0)
        assert self.texts(bench) == ["links weak, and no better station: warn"]

    def test_weak_links_where_a_station_with_better_ones_is_asked(self) -> None:
        bench = mission(None, B)
        bench.facts = (inside(A), inside(B))
        bench.run(40.0)
        bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
        bench.run(4.0)
        view = bench.arbiter.view
        assert view.partner == B
        bench.say(B, OnHandover(TransferKey(A, B, view.handover_id, view.epoch), Consent.WAITING))
        bench.run(20.0)
        assert bench.arbiter.view.partner == B
        assert self.texts(bench) == []

    def test_somebody_who_speaks_as_the_commander(self) -> None:
        bench = mission()
        bench.give(LinkJudged(A, weak=False, attacked=True, text="bad signatures"))
        bench.run(1.0)
        assert self.texts(bench) == ["repeated authentication failures: warn"]
        bench.give(LinkJudged(A, weak=False, attacked=False, text="none"))
        bench.run(29.0)
        assert len(self.texts(bench)) == 1
        bench.run(2.0)
        assert self.texts(bench)[-1] == "the cause of the warning is gone"

    @pytest.mark.parametrize("policy", ["return", "land"])
    def test_the_configuration_may_have_something_done(self, policy: str) -> None:
        bench = mission(Limits(policies={Cause.GUARD_LOST: policy}))
        bench.guard = None
        bench.run(10.0)
        assert bench.flights() == [Fly(FlightAction[policy.upper()], Reason.GUARD_LOST)]


class TestWhatTheEdgeSees:
    def test_energy_for_the_way_back_only_turns_back_and_stays_so(self) -> None:
        bench = mission()
        seen_at = bench.now
        bench.give(ConditionsSeen(energy=True))
        bench.run(10.0)
        assert [(at, action) for at, action in bench.log if isinstance(action, Fly)] == [
            (seen_at + 2.0, Fly(FlightAction.RETURN, Reason.ENERGY))
        ]
        bench.give(ConditionsSeen())
        bench.run(60.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert len(bench.flights()) == 1

    def test_a_sag_that_is_over_at_once_is_none(self) -> None:
        bench = mission()
        bench.give(ConditionsSeen(energy=True))
        bench.run(1.0)
        bench.give(ConditionsSeen())
        bench.run(10.0)
        assert bench.flights() == []

    def test_where_no_place_is_in_reach_it_lands(self) -> None:
        bench = mission()
        bench.give(PlaceJudged("home", False))
        bench.run(5.0)
        assert bench.flights() == [], "that by itself is no reason to do anything"
        bench.give(ConditionsSeen(energy=True))
        bench.run(2.0)
        assert bench.flights() == [Fly(FlightAction.LAND, Reason.ENERGY)]

    def test_a_place_that_falls_out_of_reach_on_the_way_there_is_not_flown_to_any_more(self) -> None:
        bench = mission()
        bench.give(PlaceJudged("rally 1", True))
        bench.give(ConditionsSeen(energy=True))
        bench.run(2.0)
        bench.give(PlaceJudged("rally 1", False))
        bench.run(1.0)
        assert [action.action for action in bench.flights()] == [FlightAction.RETURN, FlightAction.LAND]

    def test_off_its_route_is_told(self) -> None:
        bench = mission()
        bench.give(ConditionsSeen(off_route=True))
        assert [record.text for record in bench.records("warning")] == ["off route: warn"]
        bench.give(ConditionsSeen())
        assert len(bench.records("warning_over")) == 1

    def test_on_the_ground_it_is_nothing(self) -> None:
        bench = Bench().on_ground()
        bench.log.clear()
        bench.give(ConditionsSeen(energy=True, off_route=True))
        bench.run(5.0)
        assert bench.records("emergency") == []


def test_on_the_way_home_authority_still_moves_by_zones() -> None:
    """The fault: whoever had to come home through another station's zone was nobody's to command there."""
    bench = mission(Limits(policies={Cause.GUARD_LOST: "return"}), B)
    bench.guard = None
    bench.run(10.0)
    assert bench.arbiter.view.phase is Phase.EMERGENCY
    bench.position(inside(A), inside(B))
    assert bench.arbiter.view.partner == B
    view = bench.arbiter.view
    key = TransferKey(A, B, view.handover_id, view.epoch)
    for station, word in (
        (B, OnHandover(key)),
        (A, OkHandover(key)),
        (B, DroneConnected(key)),
        (A, DisconnectHandover(key)),
    ):
        bench.say(station, word)
    assert (bench.arbiter.view.commander, bench.arbiter.view.phase) == (B, Phase.EMERGENCY)


def test_what_is_left_to_warn_of_is_no_emergency() -> None:
    """The fault: with the guard silent, the return of the commander did not end the emergency of its loss."""
    bench = mission()
    bench.alive = set()
    bench.run(6.0)
    assert bench.arbiter.view.phase is Phase.EMERGENCY
    bench.guard = None
    bench.run(8.0)
    bench.alive = {A}
    bench.run(2.0)
    assert (bench.arbiter.view.commander, bench.arbiter.view.phase) == (A, Phase.ON_MISSION)
    assert [record.text for record in bench.records("warning")][-1] == "guard lost: warn"


def test_far_from_everything_nothing_ends_ahead() -> None:
    bench = mission()
    bench.position(*far(A, B))
    bench.run(0.5)
    assert bench.flights() == []


def test_who_could_take_the_aircraft_is_the_commander_and_who_is_fit_to_be_partner() -> None:
    bench = mission(None, B)
    bench.run(2.0)
    assert bench.arbiter.usable(bench.now) == {A, B}
    bench.alive = {B}
    bench.run(7.0)
    assert bench.arbiter.usable(bench.now) == {B}, "a commander that is silent could not"
    bench.alive = set()
    bench.run(7.0)
    assert bench.arbiter.usable(bench.now) == frozenset()


class TestAPositionThatIsLate:
    def held(self) -> Bench:
        bench = mission()
        bench.position(ends(4.0), outside(B))
        bench.facts = (inside(A), outside(B))
        bench.run(5.0)
        assert bench.flights() == [HOLD]
        return bench

    def test_by_less_than_the_hold_off_of_its_cause_it_ends_no_hold(self) -> None:
        """The fault: 2 s without one were a return at once, and POSITION_STALE has a second more to be nothing."""
        bench = self.held()
        facts, bench.facts = bench.facts, None
        bench.run(2.4)
        bench.facts = facts
        bench.run(10.0)
        assert bench.flights() == [HOLD]

    def test_by_more_it_is_brought_home_at_that_moment(self) -> None:
        bench = self.held()
        last = bench.now
        bench.facts = None
        bench.run(10.0)
        assert bench.flights()[:2] == [HOLD, HOME]
        assert next(at for at, action in bench.log if action == HOME) == pytest.approx(last + 3.0, abs=0.5)

    def test_at_that_moment_too_where_its_cause_is_not_looked_at(self) -> None:
        bench = mission(Limits(position_stale_s=2.375, policies={Cause.POSITION_STALE: "off"}))
        bench.position(ends(4.0), outside(B))
        bench.facts = None
        last = bench.now
        bench.run(10.0)
        assert [at for at, action in bench.log if action == HOME] == [pytest.approx(last + 3.375)]

    def test_of_an_autopilot_that_is_heard_again_it_may_come_behind_its_heartbeat(self) -> None:
        bench = self.held()
        facts, bench.facts, bench.autopilot = bench.facts, None, False
        bench.run(8.0)
        bench.autopilot = True
        bench.run(0.8)
        bench.facts = facts
        bench.run(5.0)
        assert HOME not in bench.flights()


@pytest.mark.parametrize(
    ("limits", "falls_silent", "after_s"),
    [
        (Limits(autopilot_lost_s=3.375), "autopilot", 3.375),
        (Limits(guard_lost_s=2.375), "guard", 2.375 + 3.0),
        (Limits(position_stale_s=2.375), "facts", 2.375 + 1.0),
    ],
)
def test_silence_is_told_at_its_moment_whatever_else_comes_then(
    limits: Limits, falls_silent: str, after_s: float
) -> None:
    bench = mission(limits)
    bench.run(0.5)
    heard_at = bench.now
    setattr(bench, falls_silent, False if falls_silent == "autopilot" else None)
    bench.run(8.0)
    (told_at,) = [at for at, action in bench.log if action in bench.records("warning")]
    assert told_at == pytest.approx(heard_at + after_s)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The arbiter's own part: what it tells the rest of the companion, and what it does with each event and decision."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause as Wrong
from mavproxy_handover.core.common.events import (
    Action,
    Announce,
    AutopilotState,
    BordersSeen,
    ConditionsSeen,
    ControlRequested,
    Fly,
    GuardSeen,
    LinkJudged,
    MissionLoaded,
    ModeSeen,
    OperatorControlShown,
    OrderRefused,
    PositionSeen,
    Record,
    RehearsalAsked,
    RehearsalMoved,
    StartRequested,
    StationHeard,
    TakeOffPassed,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import CrossingKey
from mavproxy_handover.core.common.model import (
    BorderFact,
    FlightAction,
    GapFact,
    GuardState,
    LeaseState,
    ModeClass,
    Reason,
)
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.core.safety.emergency import News
from mavproxy_handover.core.safety.strategy import Decision
from tests.core.bench import DIGEST, A, B, Bench, C, ConnectAck, Phase, far, inside, outside

LEFT = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, DIGEST, (A, B, A))


class TestZones:
    def test_no_zone_is_zero_and_one_zone_leaves_the_second_at_zero(self) -> None:
        bench = Bench().on_mission()
        bench.position(*far(A, B, C))
        assert bench.arbiter.zones() == (0, 0)
        bench.position(inside(A), *far(B, C))
        assert bench.arbiter.zones() == (A, 0)

    def test_in_an_overlap_the_commander_is_the_first(self) -> None:
        bench = Bench().commit()
        bench.position(inside(A), inside(B))
        assert bench.arbiter.zones() == (B, A)
        assert bench.arbiter.zone() == B


class TestAwaitsTheCommander:
    def test_without_a_transfer_no_answer_is_awaited(self) -> None:
        assert not Bench().on_mission().arbiter.awaits_commander

    def test_until_the_commander_has_agreed(self) -> None:
        bench = Bench().up_to("CONSENT")
        assert bench.arbiter.awaits_commander

    def test_a_commander_that_gives_the_aircraft_away_has_agreed(self) -> None:
        bench = Bench().up_to("CONSENT")
        bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.view.partner == B
        assert not bench.arbiter.awaits_commander

    def test_a_standard_commander_has_no_message_for_an_answer(self) -> None:
        bench = Bench(standard={A}).in_transfer()
        assert bench.arbiter.view.partner == B
        assert not bench.arbiter.awaits_commander


class TestHowWellStationsHear:
    """A station that is heard and answers a part of its questions may count otherwise after the next one."""

    def test_stations_that_answer_everything_do_not_waver_and_are_settled_after_a_while(self) -> None:
        bench = Bench().on_mission()
        bench.run(20.0)
        assert not bench.arbiter.wavers(bench.now)
        assert bench.arbiter.settled(bench.now)

    def test_one_that_begins_to_miss_questions_wavers(self) -> None:
        bench = Bench().on_mission()
        bench.run(20.0)
        bench.deaf = {B}
        bench.run(4.0)
        assert bench.arbiter.wavers(bench.now)
        assert not bench.arbiter.settled(bench.now)

    def test_one_that_is_not_heard_plays_no_part(self) -> None:
        bench = Bench().on_mission()
        bench.run(20.0)
        bench.deaf = {B}
        bench.run(4.0)
        bench.alive = {A}
        bench.run(6.0)
        assert not bench.arbiter.wavers(bench.now)
        assert bench.arbiter.settled(bench.now)


class TestRestored:
    @pytest.mark.parametrize(("phase", "rehearses"), [(Phase.ON_MISSION, True), (Phase.ON_LOAD, False)])
    def test_a_rehearsal_goes_on_after_a_restart_unless_it_had_ended(self, phase: Phase, rehearses: bool) -> None:
        bench = Bench()
        bench.restart(0.0, replace(LEFT, phase=phase, rehearsal=True))
        assert bench.arbiter.view.rehearsal is rehearses


def test_zones_of_the_first_position_were_not_entered_in_this_flight() -> None:
    """A pilot takes off before there is a position: an overlap that the aircraft stood in calls for no handover."""
    bench = Bench()
    bench.facts = None
    bench.on_ground().autopilot_says(armed=True, flying=True)
    assert bench.arbiter.view.phase is Phase.ON_MISSION
    bench.position(inside(A), inside(B))
    bench.run(10.0)
    assert (bench.arbiter.view.commander, bench.arbiter.view.handover_id) == (A, 0)


class TestStations:
    def test_what_an_unknown_station_sends_is_counted_and_changes_nothing(self) -> None:
        bench = Bench()
        for event in (StationHeard(77), OperatorControlShown(77)):
            assert not [action for action in bench.give(event) if getattr(action, "station", None) == 77]
        assert bench.dropped() == {"unknown station": 2}

    def test_a_standard_station_shows_operator_control_by_a_message_of_ours_or_by_the_command(self) -> None:
        for shows in ("message", "command"):
            bench = Bench(standard={A}, shown=False)
            assert not bench.arbiter._presence[A].can_be_asked
            if shows == "message":
                bench.say(A, ConnectAck(A, 1, 0, 0, None, "GCSA", DIGEST))
            else:
                bench.give(OperatorControlShown(A))
            assert bench.arbiter._presence[A].can_be_asked

    def test_a_message_of_our_module_is_nothing_to_show(self) -> None:
        bench = Bench().on_ground()
        assert not bench.arbiter._presence[A].shows_control

    def test_an_answer_that_was_not_asked_for_is_no_stale_one(self) -> None:
        bench = Bench().on_ground()
        bench.say(A, ConnectAck(A, 1, 0, 1, A, "GCSA", DIGEST))
        assert bench.dropped() == {}

    def test_links_that_are_judged_are_journalled(self) -> None:
        bench = Bench().on_ground()
        assert bench.give(LinkJudged(B, True, False, "loss 40%"))[0] == Record(
            "link_quality", "links of GCSB are weak: loss 40%", Reason.LINK_QUALITY, B
        )

    @pytest.mark.parametrize(("station", "barred"), [(A, True), (B, False)])
    def test_after_a_silence_only_the_lost_commander_is_still_barred(self, station: int, barred: bool) -> None:
        bench = Bench().on_mission()
        bench.arbiter._authority.lose(A, bench.now, [])
        presence = bench.arbiter._presence[station]
        presence.hearing.barred_at, presence.heard_at = bench.now, bench.now - 6.0
        bench.arbiter.handle(StationHeard(station), bench.now)
        assert presence.hearing.barred is barred


class TestParent:
    """On the ground the parent gets authority when no station has it."""

    def given_to_b(self) -> Bench:
        bench = Bench().on_ground()
        bench.give(ControlRequested(A, False, False, 10.0, A))
        bench.give(bench.request(B))
        assert bench.arbiter.view.commander == B
        return bench

    def test_when_another_commander_is_lost(self) -> None:
        bench = self.given_to_b()
        bench.alive = {A}
        bench.run(8.0)
        assert bench.arbiter.view.commander == A

    def test_not_when_its_operator_has_released_it(self) -> None:
        bench = Bench().on_ground()
        bench.give(ControlRequested(A, False, False, 10.0, A))
        bench.run(3.0)
        assert bench.arbiter.view.commander is None

    def test_not_during_a_transfer_from_the_one_that_is_lost(self) -> None:
        bench = self.given_to_b()
        bench.alive = {A, C}
        bench.run(3.5)
        bench.give(bench.request(C))
        while bench.arbiter.view.commander == B:
            bench.run(0.1)
        bench.run(0.6)
        assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (None, C)


class TestPositions:
    def test_zones_that_are_entered_and_left_are_journalled(self) -> None:
        bench = Bench().on_mission()
        bench.log.clear()
        bench.position(outside(A), inside(B))
        assert [record.text for record in bench.records("zone_entered")] == ["zone of GCSB entered"]
        assert [record.text for record in bench.records("zone_left")] == ["zone of GCSA left"]

    @pytest.mark.parametrize(
        ("gap", "alone"),
        [(None, False), (GapFact(60.0, "A to B", ahead=True), False), (GapFact(60.0, "A to B"), True)],
    )
    def test_outside_a_gap_the_aircraft_does_not_fly_alone(self, gap: GapFact | None, alone: bool) -> None:
        bench = Bench().on_mission()
        bench.arbiter._authority.fly_alone(True)
        bench.arbiter._on_position(PositionSeen((inside(A),), gap), bench.now, [])
        assert bench.arbiter._authority.alone is alone


class TestUsable:
    """Stations that have the aircraft or could take it."""

    def test_without_an_owner_those_that_could_take_it(self) -> None:
        bench = Bench().on_ground()
        bench.give(ControlRequested(A, False, False, 10.0, A))
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.usable(bench.now) == {A, B}

    def test_the_owner_while_it_is_heard_whatever_mission_it_holds(self) -> None:
        bench = Bench().on_mission()
        bench.digests[A] = bytes(32)
        bench.run(2.0)
        assert bench.arbiter.unfit(A, bench.now) is not None
        assert bench.arbiter.usable(bench.now) == {A, B}
        bench.arbiter._authority.lose(A, bench.now, [])
        assert bench.arbiter.usable(bench.now) == {B}


def test_a_new_commander_has_the_time_of_an_answer_from_the_commit_on() -> None:
    bench = Bench().commit()
    at = bench.now
    bench.arbiter._presence[B].answered_at = at - 60.0
    assert bench.arbiter._owner_lost_at(B) == at + 5.0
    bench.run(1.0)
    assert bench.arbiter._epoch_since == at


def test_the_loss_of_the_owner_is_a_deadline() -> None:
    """On the ground nothing else is due when no question is."""
    bench = Bench().on_ground()
    for presence in bench.arbiter._presence.values():
        presence.ask_at = bench.now + 100.0
    assert bench.arbiter.next_deadline() == bench.arbiter._presence[A].lost_at()


def test_borders_on_the_way_are_foreseen() -> None:
    bench = Bench().on_mission()
    bench.give(BordersSeen((BorderFact(0, 20.0, frozenset({A, B})),)))
    assert bench.arbiter.ahead == CrossingKey(A, B, 1, 1)
    assert bench.arbiter.ahead_s(bench.now) == 20.0


def test_links_that_are_judged_may_call_for_a_transfer_at_once() -> None:
    bench = Bench().on_mission()
    zones, links = bench.arbiter._candidates.zones, bench.arbiter._candidates.links
    zones.update((inside(A), inside(B)), bench.now)
    zones.forget_entries()
    links._weak[A] = bench.now - 10.0
    bench.give(LinkJudged(C, False, False, ""))
    assert (bench.arbiter.view.partner, bench.arbiter.view.why) == (B, Reason.LINK_QUALITY)


class TestAnswers:
    """What a station's answer to CONNECT shows."""

    def test_that_it_knows_the_last_result(self) -> None:
        bench = Bench().commit()
        results = bench.arbiter._transfer_manager.results
        assert len(results.deadlines()) == 2
        bench.say(A, ConnectAck(A, 1, 0, 2, B, "GCSA", DIGEST))
        assert len(results.deadlines()) == 1

    def test_that_it_answers_too_few_which_is_told_once(self) -> None:
        bench = Bench().on_mission()
        assert bench.records("deaf") == []
        presence = bench.arbiter._presence[B]
        presence.ask_at = bench.now + 100.0
        presence.hearing._fates.clear()
        presence.hearing._fates.extend((bench.now - seconds, False) for seconds in range(14, 1, -1))
        for nonce in (1, 2):
            presence.asked.append((nonce, bench.now))
            bench.say(B, ConnectAck(B, 1, nonce, 1, A, "GCSB", DIGEST))
            assert [each.text for each in bench.records("deaf")] == [
                "GCSB hears less than 15 % of what the aircraft sends"
            ]

    @pytest.mark.parametrize("barred", [True, False])
    def test_that_a_lost_commander_is_back_if_it_hears_enough(self, barred: bool) -> None:
        bench = Bench().on_mission()
        bench.arbiter._authority.lose(A, bench.now, [])
        presence = bench.arbiter._presence[A]
        if barred:
            presence.hearing.barred_at = bench.now
        presence.asked.append((1, bench.now))
        bench.arbiter._on_connect_ack(A, ConnectAck(A, 1, 1, 1, None, "GCSA", DIGEST), bench.now, [])
        assert bench.arbiter._authority.lost is barred


class TestRehearsal:
    """On the ground, by the commander's word; it counts as a flight."""

    def rehearsing(self) -> Bench:
        bench = Bench().on_ground()
        bench.give(RehearsalAsked(A, True))
        assert (bench.arbiter.view.rehearsal, bench.arbiter.view.phase) == (True, Phase.ON_MISSION)
        return bench

    def ended(self, actions: list[Action]) -> list[str]:
        return [action.text for action in actions if isinstance(action, RehearsalMoved) and not action.on]

    def test_the_time_without_a_commander_is_counted_from_the_event_that_shows_it(self) -> None:
        bench = self.rehearsing()
        assert bench.arbiter._rehearsal.due_at() is None
        bench.arbiter._authority.lose(A, bench.now, [])
        bench.arbiter.handle(Tick(), bench.now)
        assert bench.arbiter._rehearsal.due_at() == bench.now + 300.0

    def test_when_that_is_over_it_ends(self) -> None:
        bench = self.rehearsing()
        bench.arbiter._authority.lose(A, bench.now, [])
        bench.arbiter._rehearsal._nobody_since = bench.now - 300.0
        text = "REHEARSAL OVER: no station has had authority for 300 s"
        assert self.ended(bench.arbiter.handle(Tick(), bench.now)) == [text]

    def test_an_aircraft_that_is_armed_ends_it(self) -> None:
        bench = self.rehearsing()
        actions = bench.arbiter.handle(AutopilotState(True, False), bench.now)
        assert self.ended(actions) == ["REHEARSAL OVER: the aircraft is armed"]

    def test_an_aircraft_that_is_not_armed_does_not(self) -> None:
        bench = self.rehearsing()
        bench.arbiter.handle(AutopilotState(False, False), bench.now)
        assert (bench.arbiter.view.rehearsal, bench.arbiter.view.phase) == (True, Phase.ON_MISSION)


def test_a_take_off_by_hand_ends_the_request_of_another_station() -> None:
    bench = Bench().on_ground()
    bench.give(bench.request(B))
    assert bench.arbiter.view.partner == B
    bench.give(TakeOffPassed(A))
    assert bench.arbiter.view.partner is None


def test_after_a_landing_every_station_begins_anew() -> None:
    bench = Bench().on_mission()
    bench.arbiter._presence[B].hearing.losses = 2
    bench.autopilot_says(armed=False, flying=False)
    assert bench.arbiter._presence[B].hearing.losses == 0


def test_another_state_of_the_guard_is_journalled() -> None:
    bench = Bench().on_ground()
    bench.log.clear()
    for state in (GuardState.LIVE, GuardState.DISABLED, GuardState.DISABLED, GuardState.SILENT):
        bench.give(GuardSeen(state, ours=True))
    assert [record.text for record in bench.records("guard")] == ["guard: live -> disabled"]


def test_a_mission_brings_its_policy_and_is_journalled() -> None:
    bench = Bench().on_ground()
    bench.log.clear()
    bench.give(MissionLoaded(DIGEST, (A, B), "land"))
    assert bench.arbiter.snapshot().out_of_coverage == "land"
    bench.give(MissionLoaded(b"", ()))
    assert [record.text for record in bench.records("mission_loaded")] == [
        "mission loaded, commanders along the route: GCSA GCSB"
    ]
    assert [record.text for record in bench.records("mission_dropped")] == [
        "the autopilot no longer holds the mission that was loaded"
    ]


class TestTime:
    """What has run out is over before the event counts."""

    def test_a_station_whose_answers_are_too_few_when_its_next_question_is_due(self) -> None:
        bench = Bench().on_mission()
        presence = bench.arbiter._presence[B]
        presence.hearing._fates.clear()
        presence.hearing._fates.extend((bench.now - seconds, False) for seconds in range(14, 1, -1))
        presence.ask_at = bench.now
        actions = bench.arbiter.handle(Tick(), bench.now)
        assert Record("deaf", "GCSB hears less than 15 % of what the aircraft sends", station=B) in actions

    @pytest.mark.parametrize("how", ["silent", "barred", "there"])
    def test_a_partner_that_is_not_there_any_more_ends_the_transfer(self, how: str) -> None:
        bench = Bench().in_transfer()
        presence = bench.arbiter._presence[B]
        if how == "silent":
            presence.heard_at = bench.now - 5.0
        elif how == "barred":
            presence.hearing.barred_at = bench.now
        actions = bench.arbiter.handle(Tick(), bench.now)
        aborted = [action.text for action in actions if isinstance(action, Record)]
        assert ("handover 1 aborted (partner silent): GCSA commands" in aborted) is (how != "there")


class TestLoss:
    """What the loss of the commander changes at once."""

    def test_in_a_gap_the_first_lease_says_that_the_aircraft_flies_alone(self) -> None:
        for gap, lease in ((GapFact(60.0, "A to B"), LeaseState.ALONE), (None, LeaseState.LOST)):
            bench = Bench().on_mission()
            bench.arbiter._on_position(PositionSeen(far(A, B), gap), bench.now, [])
            bench.arbiter._authority.fly_alone(False)
            bench.arbiter._lose_owner(A, bench.now, [])
            assert bench.arbiter.view.lease is lease

    def test_the_pauses_are_over(self) -> None:
        bench = Bench().on_mission()
        bench.arbiter._candidates.pause(B, Reason.COMMANDER_LOST, Reason.PARTNER_SILENT, bench.now)
        bench.arbiter._lose_owner(A, bench.now, [])
        assert bench.arbiter._candidates.paused_s(B, Reason.COMMANDER_LOST, bench.now) == 0.0

    @pytest.mark.parametrize("standard", [True, False])
    def test_a_station_with_our_module_has_to_show_for_longer_that_it_hears(self, standard: bool) -> None:
        bench = Bench(standard={A} if standard else set()).on_mission()
        bench.arbiter._lose_owner(A, bench.now, [])
        assert bench.arbiter._presence[A].hearing.losses == (0 if standard else 1)

    @pytest.mark.parametrize(
        ("heard_ago_s", "answered_ago_s", "why"),
        [
            (0.0, 0.0, "hears less than 15 % of what the aircraft sends"),
            (0.0, 6.0, "answers no more"),
            (6.0, 6.0, "is lost"),
        ],
    )
    def test_it_is_told_why(self, heard_ago_s: float, answered_ago_s: float, why: str) -> None:
        bench = Bench().on_mission()
        presence = bench.arbiter._presence[A]
        presence.heard_at, presence.answered_at = bench.now - heard_ago_s, bench.now - answered_ago_s
        actions: list[Action] = []
        bench.arbiter._lose_owner(A, bench.now, actions)
        assert [action.text for action in actions if isinstance(action, Record)] == [f"GCSA {why}: no station commands"]


def test_a_position_that_is_late_is_journalled_once() -> None:
    bench = Bench().on_mission()
    bench.arbiter._flight._position_at = bench.now - 2.0
    for told in (1, 0):
        actions = bench.arbiter.handle(Tick(), bench.now)
        assert len([each for each in actions if isinstance(each, Record) and each.event == "position_stale"]) == told


class TestDecisions:
    """What the arbiter does with a decision of safety."""

    def told(self, news: News, bench: Bench) -> list[Action]:
        actions: list[Action] = []
        bench.arbiter._on_news(news, bench.now, actions)
        return actions

    @pytest.mark.parametrize(
        ("before", "grave", "event", "text"),
        [
            (FlightAction.CONTINUE, False, "gap_over", "the gap is crossed"),
            (FlightAction.HOLD, True, "emergency_over", "the cause of the emergency is gone"),
            (FlightAction.WARN, False, "warning_over", "the cause of the warning is gone"),
        ],
    )
    def test_its_end_is_journalled(self, before: FlightAction, grave: bool, event: str, text: str) -> None:
        bench = Bench().on_mission()
        news = News(None, Decision(before, Wrong.COVERAGE_ENDS), grave=grave)
        assert self.told(news, bench)[0] == Record(event, text)

    def test_a_return_is_an_emergency_and_shown_as_one(self) -> None:
        bench = Bench().on_mission()
        actions = self.told(News(Decision(FlightAction.RETURN, Wrong.ENERGY), None), bench)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert ViewChanged(bench.arbiter.view, Reason.ENERGY) in actions

    def test_a_hold_is_none(self) -> None:
        bench = Bench().on_mission()
        self.told(News(Decision(FlightAction.HOLD, Wrong.COVERAGE_ENDS), None), bench)
        assert bench.arbiter.view.phase is Phase.ON_MISSION

    def test_after_it_a_transfer_under_way_is_a_phase_again(self) -> None:
        bench = Bench().in_transfer()
        bench.arbiter._authority.phase = Phase.EMERGENCY
        self.told(News(None, Decision(FlightAction.RETURN, Wrong.ENERGY), grave=True), bench)
        assert bench.arbiter.view.phase is Phase.ON_HANDOVER

    @pytest.mark.parametrize(("cause", "partner"), [(Wrong.OUT_OF_COVERAGE, None), (Wrong.COMMANDER_LOST, B)])
    def test_out_of_every_zone_a_transfer_ends(self, cause: Wrong, partner: int | None) -> None:
        bench = Bench().in_transfer()
        self.told(News(Decision(FlightAction.RETURN, cause), None), bench)
        assert bench.arbiter.view.partner == partner

    def test_a_start_under_way_does_not_count_any_more(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        assert bench.arbiter._authority.starting
        bench.arbiter._come_home(Wrong.ENERGY, bench.now, [])
        assert not bench.arbiter._authority.starting

    def test_a_return_is_told_with_the_first_event_after_its_order(self) -> None:
        bench = Bench(Limits(policies={Wrong.GUARD_LOST: "return"}, hold_off_s={Wrong.GUARD_LOST: 0.0})).on_mission()
        told = []
        for event in (GuardSeen(GuardState.DISABLED, ours=True), Tick(), Tick()):
            actions = bench.arbiter.handle(event, bench.now)
            told.append([type(each) for each in actions if isinstance(each, (Fly, Announce))])
        assert told == [[Fly], [Announce], []]

    def test_a_return_that_another_cause_takes_over_is_told_after_the_order_for_that(self) -> None:
        causes = (Wrong.GUARD_LOST, Wrong.ENERGY)
        limits = Limits(policies=dict.fromkeys(causes, "return"), hold_off_s=dict.fromkeys(causes, 0.0))
        bench = Bench(limits).on_mission()
        told = []
        for event in (GuardSeen(GuardState.DISABLED, ours=True), ConditionsSeen(energy=True), Tick(), Tick()):
            bench.now += 0.1
            actions = bench.arbiter.handle(event, bench.now)
            told.append([(type(each), each.reason) for each in actions if isinstance(each, (Fly, Announce))])
        assert told == [[(Fly, Reason.GUARD_LOST)], [(Fly, Reason.ENERGY)], [(Announce, Reason.ENERGY)], []]

    def test_an_order_that_is_refused_is_decided_again_in_the_same_event(self) -> None:
        bench = Bench(Limits(policies={Wrong.GUARD_LOST: "return"}, hold_off_s={Wrong.GUARD_LOST: 0.0})).on_mission()
        bench.give(ModeSeen(ModeClass.MISSION, "AUTO"))
        bench.give(GuardSeen(GuardState.DISABLED, ours=True))
        bench.give(Tick())
        actions = bench.give(OrderRefused(FlightAction.RETURN))
        assert [action.action for action in actions if isinstance(action, Fly)] == [FlightAction.LAND]

    def test_in_a_gap_the_aircraft_may_fly_alone_unless_it_is_brought_home(self) -> None:
        limits = Limits(policies={Wrong.GUARD_LOST: "return"}, hold_off_s={Wrong.GUARD_LOST: 0.0})
        bench = Bench(limits).on_mission()
        bench.gap = GapFact(60.0, "A to B")
        bench.position(*far(A, B, C))
        assert bench.arbiter._authority.alone
        bench.give(GuardSeen(GuardState.DISABLED, ours=True))
        bench.give(Tick())
        assert not bench.arbiter._authority.alone

    def test_without_a_commander_the_lease_follows_though_nothing_is_decided(self) -> None:
        bench = Bench(Limits(hold_off_s={Wrong.COMMANDER_LOST: 5.0})).on_mission()
        bench.arbiter._authority.lose(A, bench.now, [])
        bench.arbiter._authority.fly_alone(True)
        bench.arbiter._authority.refresh(Reason.NONE, [])
        assert bench.arbiter.view.lease is LeaseState.ALONE
        actions: list[Action] = []
        bench.arbiter._judge(bench.now, actions)
        assert actions == [ViewChanged(bench.arbiter.view, Reason.COMMANDER_LOST)]
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_a_doubt_about_the_mode_ends_with_time(self) -> None:
        bench = Bench().on_mission()
        for mode in (ModeClass.MISSION, ModeClass.HANDS):
            bench.give(ModeSeen(mode, mode.name, radio=True))
        actions = bench.arbiter.handle(Tick(), bench.now + 1.0)
        assert Record("helm", "HANDS: a pilot has taken over") in actions

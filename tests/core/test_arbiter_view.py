# SPDX-License-Identifier: GPL-3.0-or-later

"""What the arbiter tells the rest of the companion: zones, answers that are awaited, and how well stations hear."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.events import (
    BordersSeen,
    ControlRequested,
    LinkJudged,
    OperatorControlShown,
    PositionSeen,
    Record,
    StationHeard,
)
from mavproxy_handover.core.common.messages import CrossingKey
from mavproxy_handover.core.common.model import BorderFact, GapFact, Reason
from mavproxy_handover.core.common.snapshot import Snapshot
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
            assert [each.text for each in bench.records("deaf")] == ["GCSB hears less than 15 % of the aircraft"]

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

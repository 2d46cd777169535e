# SPDX-License-Identifier: GPL-3.0-or-later

"""Who is to be asked at a border is asked before it is reached, and what was said counts for that border alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_module import core as gcs
from mavproxy_handover.core.authority.foresight import Foresight
from mavproxy_handover.core.common.events import BordersSeen
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import CrossingKey, HandoverAhead, OkAhead
from mavproxy_handover.core.common.model import BorderFact, Consent, Reason, ZoneFact
from tests.core.network import Network, lossy, perfect

A, B, C = 251, 252, 253
#: into B's zone at 60 s, out of A's at 66 s: an operator who is asked there is asked too late
SHORT = {A: [(0, 66)], B: [(60, 200)]}
YES, NO = (True, 20.0), (False, 20.0)


def network(**options: object) -> Network:
    settings = {"operators": {A: YES, B: YES}, "foresees": True, "early": {A: 5.0, B: 9.0}} | options
    return Network(settings.pop("visits", SHORT), settings.pop("route", (A, B)), **settings)  # type: ignore[arg-type]


class TestInTime:
    def test_both_are_asked_at_once_and_so_early_that_an_operator_has_all_his_time(self) -> None:
        flown = network().run(59.0)
        told = [at for at, record in flown.records if record.event == "foreseen"]
        assert told == pytest.approx([30.5], abs=1.0)
        question = "Handover GCSA -> GCSB of drone in 30 s. Type 'handover accept' or 'handover deny'."
        for station in (A, B):
            assert next(text for text in flown.notices[station] if "->" in text) == question

    def test_at_the_border_authority_moves_without_another_question(self) -> None:
        flown = network().run(80.0)
        assert flown.commits() == [(A, B, 2)]
        assert flown.durations()[0] < 0.1
        assert flown.flights == []
        assert flown.agreed()

    @pytest.mark.parametrize("sooner_s", [0.4, 1.0, 3.0])
    def test_a_zone_is_entered_some_metres_inside_its_border(self, sooner_s: float) -> None:
        """By then the next border is the nearest one on the way: that is no other question."""
        flown = network(sooner_s=sooner_s, visits={A: [(0, 75)], B: [(60, 200)]}).run(80.0)
        assert len(flown.said("foreseen")) == 1
        assert flown.commits() == [(A, B, 2)]
        assert flown.durations()[0] < 0.1

    def test_but_one_that_was_passed_five_seconds_ago_and_not_entered_is_no_border_any_more(self) -> None:
        flown = network(sooner_s=5.6, visits={A: [(0, 80)], B: [(60, 200)]}).run(62.0)
        assert len(flown.said("foreseen")) == 2

    def test_both_are_told_each_second_and_the_first_border_has_the_number_one(self) -> None:
        flown = network(early={}).run(40.0)
        key = flown.arbiter._transfer_manager.foresight.key
        assert key is not None
        assert key.crossing == 1
        foresight, told = flown.arbiter._transfer_manager.foresight, []
        for tenth in range(1, 31):
            foresight._ahead = replace(foresight._ahead, seen_at=40.0 + tenth / 10)  # type: ignore[type-var]
            actions: list[object] = []
            foresight.speak(40.0 + tenth / 10, actions)  # type: ignore[arg-type]
            told += [tenth for _action in actions]
        assert len(told) == 2 * 3

    @pytest.mark.parametrize(("ago_s", "told"), [(2.4, 2), (2.5, 0), (3.4, 0)])
    def test_a_border_that_is_on_the_way_no_more_is_told_for_a_moment(self, ago_s: float, told: int) -> None:
        flown = network(early={}).run(40.0)
        foresight = flown.arbiter._transfer_manager.foresight
        assert foresight._ahead is not None
        foresight._ahead = replace(foresight._ahead, seen_at=50.0 - ago_s)
        actions: list[object] = []
        foresight.speak(50.0, actions)  # type: ignore[arg-type]
        assert len(actions) == told

    def test_without_foresight_the_same_flight_turns_home(self) -> None:
        flown = network(foresees=False).run(80.0)
        assert flown.commits() == []
        assert flown.flights != []

    def test_the_journal_says_who_has_answered_what(self) -> None:
        flown = network().run(80.0)
        assert flown.said("foreseen_answer") == [
            "GCSB asks its operator",
            "GCSA asks its operator",
            "GCSA agrees to it beforehand",
            "GCSB agrees to it beforehand",
        ]

    def test_who_needs_no_operator_is_told_and_not_asked(self) -> None:
        flown = network(operators={}).run(80.0)
        assert flown.commits() == [(A, B, 2)]
        assert "Handover GCSA -> GCSB of drone in 30 s." in flown.notices[A]
        assert not [text for text in flown.notices[A] if "accept" in text]

    def test_each_crossing_has_its_own_question(self) -> None:
        visits = {A: [(0, 64), (120, 200)], B: [(60, 124)]}
        flown = network(visits=visits, route=(A, B, A)).run(150.0)
        assert flown.commits() == [(A, B, 2), (B, A, 3)]
        assert len(flown.said("foreseen")) == 2

    def test_the_end_of_a_zone_is_foreseen_as_well_as_the_beginning(self) -> None:
        """B's zone ends inside A's, which was never left."""
        visits = {A: [(0, 300)], B: [(60, 120)]}
        flown = network(visits=visits, route=(A, B, A)).run(200.0)
        assert flown.commits() == [(A, B, 2), (B, A, 3)]
        assert max(flown.durations()) < 0.1


class TestWhatWasSaid:
    def test_who_denies_beforehand_is_not_asked_at_the_border(self) -> None:
        flown = network(operators={A: YES, B: NO}, visits={A: [(0, 90)], B: [(60, 200)]}).run(64.0)
        assert len(flown.said("foreseen")) == 1, "the end of the zone is no other question"
        assert flown.said("transfer_aborted") == ["handover 1 aborted (the partner's operator denied): GCSA commands"]
        assert "GCSB has denied the handover GCSA -> GCSB." in flown.notices[A]

    @pytest.mark.parametrize("who", [A, B])
    def test_who_has_denied_is_asked_again_after_a_pause_as_everybody_is(self, who: int) -> None:
        answers = {A: YES, B: YES} | {who: NO}
        flown = network(operators=answers, early={A: 5.0, B: 5.0}, visits={A: [(0, 120)], B: [(60, 200)]}).run(69.0)
        assert flown.cores[who].question is None
        flown.run(71.5)
        assert flown.cores[who].question is not None
        flown._station(who, gcs.Answer(True))
        assert flown.run(73.0).commits() == [(A, B, 2)]

    @pytest.mark.parametrize("who", [A, B])
    def test_it_may_be_taken_back(self, who: int) -> None:
        flown = network().run(50.0)
        flown._station(who, gcs.Answer(False))
        flown.run(62.0)
        reason = "the commander's operator denied" if who == A else "the partner's operator denied"
        assert flown.said("transfer_aborted") == [f"handover 1 aborted ({reason}): GCSA commands"]

    def test_and_given_after_all(self) -> None:
        flown = network(operators={A: YES, B: NO}).run(50.0)
        flown._station(B, gcs.Answer(True))
        assert flown.run(80.0).commits() == [(A, B, 2)]
        assert flown.durations()[0] < 0.1

    def test_who_has_not_answered_by_the_border_is_asked_there(self) -> None:
        """The question goes on: what was about to be typed is meant for it."""
        flown = network(operators={A: YES, B: (True, 3.0)}, early={A: 5.0}, visits={A: [(0, 90)], B: [(60, 200)]})
        flown.run(60.4)
        assert flown.cores[B].question is not None
        flown._station(B, gcs.Answer(True))
        assert flown.run(62.0).commits() == [(A, B, 2)]

    def test_another_mission_ends_it(self) -> None:
        flown = network(rerouted=50.0, visits={A: [(0, 90)], B: [(60, 200)]}).run(61.0)
        assert len(flown.said("foreseen")) == 2
        assert flown.said("foreseen_answer")[4:6] == ["GCSB asks its operator", "GCSA asks its operator"]

    def test_a_way_that_is_left_is_not_told_any_more_and_is_the_same_when_it_is_taken_up_again(self) -> None:
        flown = network(early={A: 0.0, B: 0.0}).run(40.0)
        foresight = flown.arbiter._transfer_manager.foresight
        key = foresight.key
        actions: list[object] = []
        for second in range(30):
            foresight.seen(BordersSeen(()), 40.0 + second, [])
            actions.clear()
            foresight.speak(40.0 + second, actions)  # type: ignore[arg-type]
        assert actions == []
        assert foresight.key == key
        ahead = foresight._ahead
        assert ahead is not None
        foresight.speak(ahead.seen_at + 59.9, [])
        assert foresight.key == key
        foresight.speak(ahead.seen_at + 60.0, [])
        assert foresight.key is None

    def test_an_emergency_ends_it(self) -> None:
        flown = network(early={}).run(45.0)
        core = flown.cores[B]
        assert core.asked_ahead is not None
        core.handle(gcs.AuthorityHeard(gcs.Phase.EMERGENCY, A, None, 1), flown.now)
        assert core.asked_ahead is None

    def test_it_counts_for_the_zones_sake_alone(self) -> None:
        """An operator who has agreed to what comes has not agreed to what another operator wants now."""
        flown = network().run(50.0)
        core = flown.cores[B]
        assert core.ahead is not None
        key = replace(flown.cores[A].ahead.key)  # type: ignore[union-attr]
        said = core._early_consent.answer_for
        transfer = gcs.TransferKey(A, B, 9, 1)
        assert said(transfer, Reason.ZONE, key.crossing, as_partner=True) is Consent.GRANTED
        for reason in set(Reason) - {Reason.ZONE, Reason.ZONE_ENDS}:
            assert said(transfer, reason, key.crossing, as_partner=True) is None
        assert said(transfer, Reason.ZONE, key.crossing + 1, as_partner=True) is None
        assert said(transfer, Reason.ZONE, 0, as_partner=True) is None
        assert said(transfer, Reason.ZONE, key.crossing, as_partner=False) is None
        assert said(replace(transfer, epoch=2), Reason.ZONE, key.crossing, as_partner=True) is None
        assert said(replace(transfer, from_station=C), Reason.ZONE, key.crossing, as_partner=True) is None


class TestWhoeverSaysIt:
    def test_an_answer_counts_from_its_two_stations_and_for_the_border_that_is_told(self) -> None:
        flown = network(visits=SHORT | {C: [(0, 200)]}, early={}).run(45.0)
        foresight = flown.arbiter._transfer_manager.foresight
        key = foresight.key
        assert key is not None
        assert foresight.accept_answer(C, OkAhead(key), []) == "not the sender's to say"
        for field in ("from_station", "to_station", "crossing", "epoch"):
            other = replace(key, **{field: getattr(key, field) + 1})
            assert foresight.accept_answer(B, OkAhead(other), []) == "no such border ahead"

    def test_no_answer_moves_anything(self) -> None:
        """Before the border is reached, whatever both say."""
        flown = network(early={A: 0.0, B: 0.0}).run(59.9)
        assert flown.commits() == []
        assert flown.arbiter.view.partner is None

    def test_a_station_heeds_the_commanders_epoch_and_itself(self) -> None:
        core = network().run(20.0).cores[B]
        for key in (CrossingKey(A, C, 1, 1), CrossingKey(A, B, 1, 2), CrossingKey(C, B, 1, 1)):
            assert core.handle(gcs.FromVehicle(HandoverAhead(key, 20.0)), 20.0) == []
            assert core.ahead is None

    def test_an_older_word_does_not_replace_a_newer_one(self) -> None:
        flown = network(early={}).run(45.0)
        core = flown.cores[B]
        assert core.ahead is not None
        key = core.ahead.key
        older = replace(key, crossing=(key.crossing - 1) % 0x10000)
        core.handle(gcs.FromVehicle(HandoverAhead(older, 5.0)), flown.now)
        assert core.ahead.key == key

    def test_a_question_that_is_not_repeated_is_over(self) -> None:
        flown = network(early={}).run(45.0)
        core = flown.cores[B]
        texts = [action.text for action in core.tick(flown.now + 6.0) if isinstance(action, gcs.Notice)]
        assert "Question withdrawn: the route does not lead to that border any more." in texts
        assert core.asked_ahead is None


class TestCountdown:
    def test_it_is_spoken_at_ten_and_five_seconds_and_says_what_comes_of_silence(self) -> None:
        flown = network(early={}).run(59.9)
        left = [text for text in flown.notices[B] if "left to answer" in text]
        assert [text.split(":")[0] for text in left] == ["10 s left to answer", "5 s left to answer"]
        assert all("At the border you are asked again." in text for text in left)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    loss=st.sampled_from([0.0, 0.1, 0.3, 0.6]),
    answers=st.tuples(st.sampled_from([YES, NO, None]), st.sampled_from([YES, NO, None])),
    early=st.tuples(st.floats(0.0, 40.0), st.floats(0.0, 40.0)),
    rerouted=st.sampled_from([float("inf"), 40.0, 59.8]),
)
def test_over_bad_links_authority_moves_with_the_word_of_both_and_not_without(
    seed: int,
    loss: float,
    answers: tuple[tuple[bool, float] | None, tuple[bool, float] | None],
    early: tuple[float, float],
    rerouted: float,
) -> None:
    flown = Network(
        {A: [(0, 100)], B: [(60, 200)]},
        (A, B),
        air=lossy(seed, loss),
        ground=lossy(seed + 1, loss),
        limits=Limits(operator_timeout_s=30.0),
        operators=dict(zip((A, B), answers, strict=True)),
        foresees=True,
        early=dict(zip((A, B), early, strict=True)),
        rerouted=rerouted,
    ).run(140.0)
    lost = flown.said("authority_lost")
    if (A, B, 2) in flown.commits() and not lost:
        assert all(answer is not None and answer[0] for answer in answers)


@pytest.mark.slow
def test_over_good_links_every_early_yes_is_in_time() -> None:
    for delay_s in (0.001, 0.1, 0.5):
        flown = network(air=perfect(delay_s), ground=perfect(delay_s), visits={A: [(0, 66)], B: [(60, 200)]}).run(90.0)
        assert flown.commits() == [(A, B, 2)]


class TestWhichBorder:
    def foreseen(self, **options: object) -> tuple[Network, Foresight]:
        flown = network(early={}, **options).run(20.0)
        return flown, flown.arbiter._transfer_manager.foresight

    def test_it_is_told_when_an_operator_has_just_all_his_time(self) -> None:
        for in_s, told in ((30.01, False), (30.0, True)):
            _flown, foresight = self.foreseen()
            foresight.seen(BordersSeen((BorderFact(0, in_s, frozenset({A, B})),)), 20.0, [])
            assert (foresight.key is not None) is told

    def test_numbers_begin_anew_behind_the_last_one_that_the_message_holds(self) -> None:
        _flown, foresight = self.foreseen()
        foresight._number = 0xFFFE
        for route, number in ((1, 0xFFFF), (2, 1)):
            foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({A, B})),), route), 20.0, [])
            assert foresight.key is not None
            assert foresight.key.crossing == number

    @pytest.mark.parametrize(("after_s", "told"), [(2.49, 2), (2.5, 0)])
    def test_it_is_told_two_and_a_half_seconds_longer_than_its_way_is_flown(self, after_s: float, told: int) -> None:
        _flown, foresight = self.foreseen()
        foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({A, B})),)), 20.0, [])
        actions: list[object] = []
        foresight.speak(20.0 + after_s, actions)  # type: ignore[arg-type]
        assert len(actions) == told

    def test_a_transfer_begins_for_it_with_its_partner_for_the_zones_sake_and_while_it_is_ahead(self) -> None:
        _flown, foresight = self.foreseen()
        foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({A, B})),)), 20.0, [])
        named = {reason for reason in Reason if foresight.number_for(B, reason, 21.0) == 1}
        assert named == {Reason.ZONE, Reason.ZONE_ENDS}
        assert foresight.number_for(C, Reason.ZONE, 21.0) == 0
        assert foresight.number_for(B, Reason.ZONE, 79.9) == 1
        assert foresight.number_for(B, Reason.ZONE, 80.0) == 0

    def test_no_other_border_takes_its_place_while_its_transfer_is_under_way(self) -> None:
        visits = {A: [(0, 300)], B: [(60, 300)], C: [(70, 300)]}
        flown = network(visits=visits, operators={B: None}, early={}).run(61.0)
        foresight = flown.arbiter._transfer_manager.foresight
        key = foresight.key
        assert flown.arbiter.view.crossing == 1
        foresight._ahead = replace(foresight._ahead, reached=False, at=0.0)  # type: ignore[type-var]
        foresight.seen(BordersSeen((BorderFact(7, 9.0, frozenset({A, B, C})),)), 61.0, [])
        assert foresight.key == key

    def test_nothing_is_foreseen_for_who_is_unknown_or_has_no_words_for_it(self) -> None:
        _flown, foresight = self.foreseen()
        for station in (99, 0):
            foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({A, station})),)), 20.0, [])
            assert foresight.key is None

    def test_a_zone_that_awaits_the_aircraft_at_a_waypoint_begins_there(self) -> None:
        """It holds the aircraft long before; who else has it already is asked at no border of it."""
        for awaits in (True, False):
            _flown, foresight = self.foreseen(visits={A: [(0, 300)], B: [(0, 300)]})
            foresight._candidates.zones.update([ZoneFact(A, 50, None), ZoneFact(B, 50, None, awaits=awaits)], 20.0)
            foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({A, B})),)), 20.0, [])
            assert (foresight.key is not None) is awaits

    def test_and_is_not_reached_before(self) -> None:
        _flown, foresight = self.foreseen(visits={A: [(0, 300)], B: [(0, 300)]})
        zones = foresight._candidates.zones
        zones.update([ZoneFact(A, 50, None), ZoneFact(B, 50, None, awaits=True)], 20.0)
        foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({A, B})),)), 20.0, [])
        reached = []
        for awaits in (True, False):
            zones.update([ZoneFact(A, 50, None), ZoneFact(B, 50, None, awaits=awaits)], 39.0)
            foresight.speak(39.0, [])
            assert foresight._ahead is not None
            reached.append(foresight._ahead.reached)
        assert reached == [False, True]

    def test_where_the_way_leaves_every_zone_nothing_behind_it_counts(self) -> None:
        _flown, foresight = self.foreseen()
        borders = BorderFact(0, 9.0, frozenset()), BorderFact(1, 19.0, frozenset({B}))
        foresight.seen(BordersSeen(borders), 20.0, [])
        assert foresight.key is None

    def test_where_zones_touch_it_is_the_border_itself_and_where_they_overlap_the_time_to_move_before_it(self) -> None:
        for inside, in_s in (((), 20.0), ((B,), 12.0)):
            visits = {A: [(0, 300)], B: [(0, 300)] if inside else [(290, 300)]}
            _flown, foresight = self.foreseen(visits=visits)
            foresight.seen(BordersSeen((BorderFact(0, 20.0, frozenset({B})),)), 20.0, [])
            assert foresight.left_s(20.0) == pytest.approx(in_s)

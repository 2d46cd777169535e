# SPDX-License-Identifier: GPL-3.0-or-later

"""The share of answered questions of one station: what it says, and what bars the station and brings it back."""

from __future__ import annotations

from math import inf

import pytest

from mavproxy_handover.core.authority.hearing import Hearing
from mavproxy_handover.core.common.limits import Limits


def hearing_of(*, unanswered: tuple[float, ...] = (), limits: Limits | None = None, until: float = 112.0) -> Hearing:
    """A question each second from 100 on; each is answered at once, except these."""
    hearing = Hearing(limits or Limits())
    at = 100.0
    while at < until:
        hearing.asked(at)
        if at not in unanswered:
            hearing.answered(at, at)
        hearing.judge(at)
        at += 1.0
    return hearing


def nothing_answered(until: float) -> Hearing:
    return hearing_of(unanswered=tuple(100.0 + number for number in range(100)), until=until)


def barred(at: float = 100.0) -> Hearing:
    hearing = Hearing(Limits())
    hearing.barred_at = at
    return hearing


class TestWavering:
    """Whether the next question may change what counts."""

    def test_before_the_first_question_and_with_all_of_them_answered_it_does_not(self) -> None:
        assert not Hearing(Limits()).wavering
        assert not hearing_of().wavering

    def test_with_a_part_of_them_answered_it_does(self) -> None:
        hearing = hearing_of(unanswered=(104.0,))
        assert hearing.share is not None
        assert 0.0 < hearing.share < 1.0
        assert hearing.wavering

    def test_with_none_answered_it_does_until_the_station_is_barred(self) -> None:
        hearing = nothing_answered(106.0)
        assert (hearing.share, hearing.barred, hearing.wavering) == (0.0, False, True)
        hearing = nothing_answered(120.0)
        assert (hearing.share, hearing.barred, hearing.wavering) == (0.0, True, False)

    def test_a_barred_station_that_answers_all_is_on_its_way_back(self) -> None:
        hearing = barred()
        hearing.asked(100.0)
        hearing.answered(100.0, 100.2)
        assert (hearing.share, hearing.wavering) == (1.0, True)

    def test_a_barred_station_that_was_not_asked_yet_is_not(self) -> None:
        hearing = barred()
        assert not hearing.judge(101.0)
        assert not hearing.wavering


class TestSettled:
    """Whether another while of the same changes nothing."""

    def test_after_the_time_that_counts(self) -> None:
        assert not Hearing(Limits()).settled
        assert not hearing_of(until=108.0).settled
        assert hearing_of(until=120.0).settled

    def test_not_while_it_wavers(self) -> None:
        assert not hearing_of(unanswered=(115.0,), until=120.0).settled

    def test_one_question_may_be_missing_from_that_time(self) -> None:
        hearing = hearing_of()
        hearing._asked_s = hearing._window_s - 1.0
        assert hearing.settled
        hearing._asked_s -= 0.01
        assert not hearing.settled

    def test_however_short_that_time_is_without_a_question_nothing_is_settled(self) -> None:
        short = Limits(deaf_lost_s=1.5)
        fresh, begun, forgiven = Hearing(short), hearing_of(limits=short), hearing_of(limits=short)
        begun.begin()
        forgiven.forgive()
        for hearing in (fresh, begun, forgiven):
            assert (hearing.share, hearing.settled) == (None, False)


class TestPause:
    @pytest.mark.parametrize(("lost_s", "pause_s"), [(5.0, 0.2), (10.0, 0.2), (20.0, 0.4), (120.0, 1.0)])
    def test_a_share_has_fifty_questions_and_no_more(self, lost_s: float, pause_s: float) -> None:
        assert Hearing(Limits(deaf_lost_s=lost_s)).short_pause_s == pytest.approx(pause_s)

    @pytest.mark.parametrize(
        ("share", "pause_s"), [(None, 1.0), (0.0, 1.0), (0.1, 0.2), (0.49, 0.2), (0.5, 0.4), (0.9, 0.4), (1.0, 1.0)]
    )
    def test_few_answers_are_asked_for_more_often(self, share: float | None, pause_s: float) -> None:
        hearing = Hearing(Limits())
        hearing.share = share
        assert hearing.pause_s == pytest.approx(pause_s)


class TestEnough:
    @pytest.mark.parametrize(("share", "enough"), [(None, True), (0.29, False), (0.3, True), (1.0, True)])
    def test_to_be_given_the_aircraft_three_tenths_are_enough(self, share: float | None, enough: bool) -> None:
        hearing = Hearing(Limits())
        hearing.share = share
        assert hearing.enough is enough

    def test_not_for_a_barred_station(self) -> None:
        hearing = barred()
        hearing.share = 1.0
        assert not hearing.enough


class TestAnswers:
    def test_an_answer_counts_at_once(self) -> None:
        hearing = Hearing(Limits())
        hearing.asked(100.0)
        hearing.answered(100.0, 100.2)
        assert hearing.share == 1.0

    @pytest.mark.parametrize(("answered", "share"), [(100.0, 1 / 3), (101.0, 1 / 3), (102.0, 1 / 3), (100.5, 0.0)])
    def test_it_counts_for_the_question_that_it_answers(self, answered: float, share: float) -> None:
        hearing = Hearing(Limits())
        for at in (100.0, 101.0, 102.0):
            hearing.asked(at)
        hearing.answered(answered, 102.5)
        hearing.judge(104.0)
        assert hearing.share == pytest.approx(share)

    def test_on_the_ground_an_answer_is_enough_to_come_back(self) -> None:
        hearing = barred()
        hearing.losses = 2
        hearing.asked(101.0)
        hearing.answered(101.0, 101.0, at_once=True)
        assert (hearing.barred, hearing.losses) == (False, 0)

    def test_on_the_ground_a_station_that_is_not_barred_keeps_its_share(self) -> None:
        hearing = nothing_answered(106.0)
        hearing.asked(106.0)
        hearing.answered(106.0, 106.0, at_once=True)
        hearing.judge(107.0)
        assert hearing.share == pytest.approx(1 / 7)

    def test_in_flight_it_has_to_answer_well_for_twelve_seconds(self) -> None:
        hearing = barred()
        for number in range(12):
            hearing.asked(100.0 + number)
            hearing.answered(100.0 + number, 100.5 + number)
            assert hearing.barred
        hearing.asked(112.0)
        hearing.answered(112.0, 112.5)
        assert (hearing.barred, hearing.wavering) == (False, False)

    def test_what_was_good_before_a_gap_does_not_count(self) -> None:
        hearing = barred()
        for number in range(30):
            hearing.asked(100.0 + number)
            if number < 6 or number > 25:
                hearing.answered(100.0 + number, 100.0 + number)
            hearing.judge(100.5 + number)
            assert hearing.barred_at == 100.0

    def test_three_tenths_are_well_enough(self) -> None:
        hearing = barred()
        for number in range(10):
            hearing.asked(100.0 + number)
            if number < 3:
                hearing.answered(100.0 + number, 100.0 + number)
        hearing._good_since = inf
        hearing.judge(111.0)
        assert (hearing.share, hearing._good_since) == (0.3, 111.0)


class TestBars:
    def test_it_is_barred_once(self) -> None:
        hearing = nothing_answered(111.0)
        hearing.asked(111.0)
        assert hearing.judge(111.0)
        assert not hearing.judge(113.0)
        assert hearing.barred_at == 111.0

    def test_a_share_of_exactly_the_limit_bars_no_station(self) -> None:
        unanswered = tuple(100.0 + number for number in range(12) if number % 4)
        hearing = hearing_of(unanswered=unanswered, limits=Limits(deaf_share=0.25))
        hearing.judge(113.0)
        assert (hearing.share, hearing.barred) == (0.25, False)


class TestBeginning:
    """It was silent and is heard again, or takes the aircraft, or has lost command."""

    def test_what_was_before_a_silence_does_not_count(self) -> None:
        hearing = nothing_answered(120.0)
        hearing.begin()
        assert (hearing.share, hearing.barred, hearing.wavering) == (None, False, False)
        hearing.judge(121.0)
        assert hearing.share is None

    def test_it_stays_barred_if_it_waits_for_command_or_has_lost_it_in_this_flight(self) -> None:
        waits, lost = barred(), barred()
        waits.begin(commanded=True)
        lost.losses = 1
        lost.begin()
        assert waits.barred
        assert lost.barred

    def test_a_silence_ends_the_way_back(self) -> None:
        hearing = barred()
        hearing.asked(100.0)
        hearing.answered(100.0, 100.2)
        assert hearing.wavering
        hearing.begin(commanded=True)
        assert not hearing.wavering

    def test_a_station_that_takes_the_aircraft_answers_all_whatever_was_before(self) -> None:
        hearing = nothing_answered(120.0)
        hearing.lost(120.0, deaf=True)
        hearing.trust(121.0)
        assert (hearing.share, hearing.barred, hearing.enough) == (1.0, False, True)

    @pytest.mark.parametrize("limits", [Limits(), Limits(answer_s=3.0)])
    def test_it_is_judged_from_then_on_as_one_that_answered_each_second_before(self, limits: Limits) -> None:
        trusted, answered_all = Hearing(limits), Hearing(limits)
        for number in range(21):
            answered_all.asked(80.0 + number)
            answered_all.answered(80.0 + number, 80.0 + number)
        trusted.trust(100.0)
        for tenths in range(2, 60):
            now = 100.0 + tenths / 10
            for hearing in (trusted, answered_all):
                if tenths % 2 == 0:
                    hearing.asked(now)
                hearing.judge(now)
            assert trusted.share == pytest.approx(answered_all.share)

    @pytest.mark.parametrize(("deaf", "losses", "is_barred"), [(True, 1, True), (False, 1, False), (False, 2, True)])
    def test_one_that_has_lost_command_is_barred_unless_it_was_its_first_silence(
        self, deaf: bool, losses: int, is_barred: bool
    ) -> None:
        hearing = Hearing(Limits())
        for _ in range(losses):
            hearing.lost(100.0, deaf=deaf)
        assert hearing.barred is is_barred

    def test_it_has_been_barred_since_the_first_reason_and_its_way_back_begins_again(self) -> None:
        hearing = barred(95.0)
        hearing.asked(96.0)
        hearing.answered(96.0, 96.2)
        assert hearing.wavering
        hearing.lost(100.0, deaf=True)
        assert (hearing.barred_at, hearing.wavering) == (95.0, False)

    def test_forgiven_it_is_as_new(self) -> None:
        hearing = nothing_answered(120.0)
        hearing.lost(120.0, deaf=True)
        hearing.forgive()
        assert (hearing.share, hearing.barred_at, hearing.losses) == (None, inf, 0)
        hearing.judge(121.0)
        assert hearing.share is None

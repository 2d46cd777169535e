# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle may conclude about a station, and from what."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import ConnectAck
from mavproxy_handover.core.common.model import Reason, StandingConsent, Station

DIGEST = bytes(range(32))
ANSWER = ConnectAck(252, 1, 7, 3, 251, "GCSB", DIGEST, accepted=True)


def presence(heard_at: float | None = None, answered_at: float | None = None, answer: ConnectAck = ANSWER) -> Presence:
    station = Presence(Station(252, "GCSB"), Limits())
    if heard_at is not None:
        station.heard_at = heard_at
    if answered_at is not None:
        station.answered_at, station.answer = answered_at, answer
    return station


def test_a_station_never_heard_is_neither_alive_nor_connected() -> None:
    station = presence()
    assert not station.alive(0.0)
    assert not station.connected(0.0)
    assert station.unfit(DIGEST, 0.0) is Reason.PARTNER_SILENT


def test_alive_for_five_seconds_after_a_heartbeat() -> None:
    station = presence(heard_at=100.0)
    assert station.lost_at() == 105.0
    assert station.alive(104.999)
    assert not station.alive(105.0)


@pytest.mark.parametrize("heard_at", [0.1, 0.3, 3.2, 3.3, 1e6 + 0.7])
def test_lost_exactly_at_the_moment_announced(heard_at: float) -> None:
    station = presence(heard_at=heard_at)
    assert not station.alive(station.lost_at())


def test_a_heartbeat_alone_does_not_connect() -> None:
    station = presence(heard_at=100.0)
    assert not station.connected(100.0)
    assert station.unfit(DIGEST, 100.0) is Reason.PARTNER_SILENT


def test_an_answer_proves_both_ways_for_five_seconds() -> None:
    station = presence(heard_at=104.0, answered_at=100.0)
    assert station.connected(104.999)
    assert not station.connected(105.0)
    assert station.unfit(DIGEST, 104.999) is None
    assert station.unfit(DIGEST, 105.0) is Reason.PARTNER_SILENT


def test_an_answer_does_not_outlive_the_heartbeat() -> None:
    station = presence(heard_at=100.0, answered_at=104.0)
    assert station.connected(104.999)
    assert not station.connected(105.0)


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (ANSWER, None),
        (replace(ANSWER, protocol_version=2), Reason.VERSION_DIFFERS),
        (replace(ANSWER, protocol_version=0), Reason.VERSION_DIFFERS),
        (replace(ANSWER, accepted=False), Reason.VERSION_DIFFERS),
        (replace(ANSWER, mission_digest=b"another one"), Reason.MISSION_DIFFERS),
        (replace(ANSWER, mission_digest=b""), Reason.MISSION_MISSING),
        (replace(ANSWER, mission_digest=bytes(32)), Reason.MISSION_MISSING),
        (replace(ANSWER, protocol_version=2, mission_digest=b""), Reason.VERSION_DIFFERS),
        (replace(ANSWER, manned=False), Reason.UNMANNED),
        (replace(ANSWER, manned=False, mission_digest=b""), Reason.MISSION_MISSING),
        (replace(ANSWER, manned=False, accepted=False), Reason.VERSION_DIFFERS),
        # what it believes of authority is no matter: the vehicle decides
        (replace(ANSWER, epoch=0xFFFFFFFF, commander=252, station=9, name=""), None),
    ],
)
def test_what_makes_a_partner_unfit(answer: ConnectAck, why: Reason | None) -> None:
    assert presence(heard_at=100.0, answered_at=100.0, answer=answer).unfit(DIGEST, 101.0) is why


def test_no_question_is_answered_before_one_is_asked() -> None:
    assert presence().answers(0, 0.0) is None


def test_a_question_is_answered_once() -> None:
    station = presence()
    station.asked.append((11, 0.0))
    assert station.answers(12, 0.0) is None
    assert station.answers(11, 0.0) == 0.0
    assert station.answers(11, 0.0) is None


def test_an_answer_may_come_after_the_next_question() -> None:
    # one question a second, 1.5 s there and back
    station = presence()
    station.asked.extend((nonce, 0.0) for nonce in (11, 12))
    assert station.answers(11, 0.0) == 0.0
    assert station.answers(12, 0.0) == 0.0


def test_an_answer_closes_the_older_questions() -> None:
    station = presence()
    station.asked.extend((nonce, 0.0) for nonce in (11, 12, 13))
    assert station.answers(12, 0.0) == 0.0
    assert station.answers(11, 0.0) is None
    assert station.answers(13, 0.0) == 0.0


def test_a_question_stays_open_as_long_as_its_answer_would_prove_something() -> None:
    # after a restart there are five questions a second, each of them good for connect_lost_s = 5 s
    station = presence()
    station.asked.extend((nonce, 0.0) for nonce in range(1, 27))
    assert station.answers(1, 0.0) is None
    assert station.answers(2, 0.0) == 0.0


def test_an_answer_to_a_question_of_long_ago_proves_nothing() -> None:
    """At one question a second 25 of them are open: an answer that took 20 s brought back a commander that was deaf."""
    station = presence()
    station.asked.extend([(11, 100.0), (12, 101.0)])
    assert station.answers(11, 105.0) is None
    assert station.answers(12, 105.0) == 101.0


def test_an_answer_is_overdue_when_two_questions_have_none_and_it_is_heard() -> None:
    station = presence(heard_at=100.0, answered_at=98.1)
    assert not station.overdue(100.0)
    assert station.overdue(100.1)
    assert not station.overdue(105.0), "silent, it is asked when it is heard"


def test_where_an_answer_proves_something_no_longer_than_one_question_lasts_only_the_last_is_open() -> None:
    station = Presence(Station(252, "GCSB"), replace(Limits(), connect_lost_s=1.0, retry_first_s=1.0))
    station.asked.extend((nonce, 0.0) for nonce in (1, 2))
    assert station.answers(1, 0.0) is None
    assert station.answers(2, 0.0) == 0.0


def test_a_station_of_the_standard_is_connected_while_it_is_heard() -> None:
    station = Presence(Station(252, "GCSB", standard=True), Limits())
    assert not station.connected(100.0)
    station.heard_at = 100.0
    assert station.connected(104.999)
    assert not station.connected(105.0)


class TestAsking:
    def test_a_question_to_a_station_that_is_heard_counts_for_what_it_hears(self) -> None:
        for heard_at, counted in ((100.0, 1), (90.0, 0)):
            station = presence(heard_at=heard_at)
            station.ask(7, 101.0, 102.0)
            assert len(station.hearing._fates) == counted
            assert station.ask_at == 102.0

    @pytest.mark.parametrize(
        ("heard_at", "answered_at", "share", "owner", "pause_s"),
        [
            (99.5, 99.0, 1.0, False, 1.0),
            (99.5, 99.0, 0.4, False, 0.2),
            (99.5, 98.0, None, False, 0.2),  # an answer is overdue
            (99.5, 98.0, 1.0, False, 0.2),
            (99.5, 98.0, 0.5, False, 0.2),
            (99.5, 98.0, 0.0, False, 1.0),  # it answers none, and does not command
            (99.5, 98.0, 0.0, True, 0.2),
            (95.0, 98.0, 0.4, True, 1.0),  # it is not heard
        ],
    )
    def test_the_pause_before_the_next_question(
        self, heard_at: float, answered_at: float, share: float | None, owner: bool, pause_s: float
    ) -> None:
        station = presence(heard_at=heard_at, answered_at=answered_at)
        station.hearing.share = share
        assert station.pause_s(100.0, owner=owner) == pytest.approx(pause_s)

    @pytest.mark.parametrize(
        ("ask_at", "heard_at", "deaf"), [(113.0, 112.5, True), (113.1, 112.5, False), (113.0, 107.0, False)]
    )
    def test_it_is_judged_when_its_next_question_is_due_and_it_is_heard(
        self, ask_at: float, heard_at: float, deaf: bool
    ) -> None:
        station = presence(heard_at=112.5)
        for number in range(13):
            station.hearing.asked(100.0 + number)
        station.heard_at, station.ask_at = heard_at, ask_at
        assert station.judge(113.0) is deaf
        assert station.hearing.barred is deaf

    def test_one_that_answers_is_not_deaf(self) -> None:
        station = presence(heard_at=112.5)
        station.ask_at = 113.0
        assert not station.judge(113.0)


class TestDeafAt:
    @pytest.mark.parametrize(
        ("answered_at", "since", "barred_at", "deaf_at"),
        [
            (100.0, 50.0, inf, 110.0),
            (100.0, 107.0, inf, 112.0),
            (100.0, 50.0, 104.0, 104.0),
            (100.0, 50.0, 111.0, 110.0),
        ],
    )
    def test_ten_seconds_without_an_answer_or_five_after_it_took_command_or_when_it_is_barred(
        self, answered_at: float, since: float, barred_at: float, deaf_at: float
    ) -> None:
        station = presence(heard_at=100.0, answered_at=answered_at)
        station.hearing.barred_at = barred_at
        assert station.deaf_at(since) == deaf_at

    def test_a_standard_station_is_not_asked(self) -> None:
        assert Presence(Station(252, "GCSB", True), Limits()).deaf_at(0.0) == inf


class TestConsent:
    @pytest.mark.parametrize(
        ("standard", "shown", "asked"), [(False, False, True), (True, False, False), (True, True, True)]
    )
    def test_whether_its_operator_can_be_asked(self, standard: bool, shown: bool, asked: bool) -> None:
        station = Presence(Station(252, "GCSB", standard), Limits())
        if shown:
            station.control_shown()
        assert station.can_be_asked is asked

    @pytest.mark.parametrize(
        ("consent", "why"),
        [(StandingConsent.REFUSE, Reason.CONSENT_REFUSED), (StandingConsent.AUTOMATIC, None), (None, None)],
    )
    def test_one_for_which_the_file_refuses_is_no_partner(
        self, consent: StandingConsent | None, why: Reason | None
    ) -> None:
        station = Presence(Station(252, "GCSB", True, consent), Limits())
        station.note_heard(100.0)
        assert station.unfit(DIGEST, 100.0) is why


def test_why_it_is_no_partner_is_news_when_it_changes() -> None:
    station = presence()
    words = (None, "silent", "silent", "deaf", None, None, "deaf")
    assert [station.unfit_told(each) for each in words] == [False, True, False, True, False, False, True]

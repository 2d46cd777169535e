# SPDX-License-Identifier: GPL-3.0-or-later

"""The questions that are out, and which answers prove something."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.contacts import Contacts
from mavproxy_handover.core.common.events import Action, Record, Send
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck
from mavproxy_handover.core.common.model import Reason, Station

A, B = 251, 252
OURS, STANDARD = Station(A, "GCSA"), Station(B, "GCSB", standard=True)
DIGEST = bytes(range(32))
LIMITS = Limits()


def contacts(nonce: int = 6) -> tuple[Contacts, Authority]:
    """GCSA has our module, GCSB speaks the standard alone; GCSA commands in epoch 1."""
    stations = (OURS, STANDARD)
    authority = Authority(stations, Flight(LIMITS))
    authority.grant(A, Reason.PARENT_CONNECTED, [])
    return Contacts("drone", stations, nonce, LIMITS), authority


def asked(made: Contacts, authority: Authority, now: float) -> list[Action]:
    actions: list[Action] = []
    made.ask(authority, DIGEST, now, actions)
    return actions


def question(nonce: int) -> Send:
    return Send(A, Connect(A, 1, nonce, 1, A, "drone", DIGEST))


def answer(nonce: int) -> ConnectAck:
    return ConnectAck(A, 1, nonce, 1, A, "GCSA", DIGEST)


def test_our_stations_are_asked_each_second_whether_they_are_heard_or_not_and_others_never() -> None:
    made, authority = contacts()
    assert asked(made, authority, 100.0) == [question(7)]
    assert asked(made, authority, 100.9) == []
    assert asked(made, authority, 101.0) == [question(8)]


def test_numbers_go_round_without_0() -> None:
    made, authority = contacts(nonce=0xFFFFFFFE)
    assert [asked(made, authority, now) for now in (100.0, 101.0)] == [[question(0xFFFFFFFF)], [question(1)]]


def test_whoever_is_heard_for_the_first_time_is_told_of_and_asked_at_once() -> None:
    made, authority = contacts()
    asked(made, authority, 100.0)
    actions: list[Action] = []
    made.note_heard(A, 100.3, actions)
    made.note_heard(B, 100.3, actions)
    made.note_heard(A, 100.4, actions)
    assert actions == [
        Record("station_heard", "GCSA is heard", station=A),
        Record("station_heard", "GCSB is heard", station=B),
    ]
    assert asked(made, authority, 100.4) == [question(8)]


@pytest.mark.parametrize(("silent_s", "news"), [(4.9, []), (5.0, ["station_heard"])])
def test_heard_again_is_news_after_a_loss(silent_s: float, news: list[str]) -> None:
    made, _authority = contacts()
    made.note_heard(A, 100.0, [])
    actions: list[Action] = []
    made.note_heard(A, 100.0 + silent_s, actions)
    assert [action.event for action in actions if isinstance(action, Record)] == news


def test_an_answer_connects_once() -> None:
    made, authority = contacts()
    made.note_heard(A, 100.0, [])
    asked(made, authority, 100.0)
    actions: list[Action] = []
    assert made.answered(A, answer(7), 100.1, actions) is None
    assert actions == [Record("connected", "GCSA is connected", station=A)]
    asked(made, authority, 101.0)
    actions.clear()
    assert made.answered(A, answer(8), 101.1, actions) is None
    assert actions == []
    assert made.presence[A].connected(106.0) is False  # no heartbeat since
    assert made.presence[A].answered_at == 101.1


def test_what_is_no_answer_to_an_open_question_says_why_and_proves_nothing() -> None:
    made, authority = contacts()
    made.note_heard(A, 100.0, [])
    asked(made, authority, 100.0)
    assert made.answered(A, answer(6), 100.1, []) == "stale answer to CONNECT"
    assert made.answered(A, answer(7), 100.2, []) is None
    assert made.answered(A, replace(answer(7), mission_digest=b""), 100.3, []) == "doubled answer to CONNECT"
    assert made.answered(A, answer(6), 100.4, []) == "stale answer to CONNECT"
    assert made.presence[A].answer == answer(7)
    assert made.presence[A].answered_at == 100.2


@pytest.mark.parametrize(("version", "accepted"), [(0, False), (1, True), (2, False)])
def test_a_stations_own_question_is_answered_whatever_its_version_and_says_whether_that_will_do(
    version: int, accepted: bool
) -> None:
    made, authority = contacts()
    theirs = Connect(A, version, 555, 0, None, "GCSA", b"")
    actions: list[Action] = []
    made.answer(A, theirs, authority, DIGEST, actions)
    assert actions == [Send(A, ConnectAck(A, 1, 555, 1, A, "drone", DIGEST, accepted))]


def test_nobody_is_told_that_a_lost_commander_commands() -> None:
    made, authority = contacts()
    authority.lose(A, 0.0, [])
    sent = asked(made, authority, 100.0)[0]
    assert isinstance(sent, Send)
    assert isinstance(sent.message, Connect)
    assert sent.message.commander is None


def barred(made: Contacts) -> None:
    made.presence[A].hearing.barred_at = 99.0


@pytest.mark.parametrize("commanded", [False, True])
def test_after_a_silence_a_station_is_judged_anew_unless_it_waits_for_command(commanded: bool) -> None:
    made, _authority = contacts()
    barred(made)
    made.note_heard(A, 100.0, [], **({"commanded": True} if commanded else {}))
    assert made.presence[A].hearing.barred is commanded


@pytest.mark.parametrize(
    ("was_barred", "grounded", "news"),
    [(True, True, ["hears_again"]), (True, False, []), (False, True, [])],
)
def test_that_a_station_hears_again_is_told(was_barred: bool, grounded: bool, news: list[str]) -> None:
    made, authority = contacts()
    made.note_heard(A, 100.0, [])
    asked(made, authority, 100.0)
    made.answered(A, answer(7), 100.1, [])
    asked(made, authority, 101.0)
    if was_barred:
        barred(made)
    actions: list[Action] = []
    made.answered(A, answer(8), 101.1, actions, **({"grounded": True} if grounded else {}))
    assert [action.event for action in actions if isinstance(action, Record)] == news


def test_after_a_restart_all_are_asked_five_times_a_second() -> None:
    made, authority = contacts()
    authority.recover_until = 102.5
    assert asked(made, authority, 100.0) == [question(7)]
    assert asked(made, authority, 100.1) == []
    assert asked(made, authority, 100.2) == [question(8)]


@pytest.mark.parametrize(("owner", "pause_s"), [(A, 0.2), (B, 1.0)])
def test_an_owner_that_answers_nothing_is_asked_more_often_and_another_station_is_not(
    owner: int, pause_s: float
) -> None:
    made, authority = contacts()
    authority.owner = owner
    made.note_heard(A, 100.0, [])
    made.presence[A].hearing.share = 0.0
    asked(made, authority, 100.0)
    assert made.presence[A].ask_at == pytest.approx(100.0 + pause_s)

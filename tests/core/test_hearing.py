# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that hears too little of the aircraft neither commands nor takes it, and comes back slowly."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from random import Random

import pytest

from mavproxy_handover.core.authority.hearing import Hearing
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.common.events import Advise, Announce, Fly, Send
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, DisconnectHandover, DroneConnected, OnHandover, TransferKey
from mavproxy_handover.core.common.model import FlightAction, Reason
from tests.core.bench import KEY, STATIONS, A, B, Bench, far, inside
from tests.core.network import Network, lossy
from tests.depth import first

RETURN = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)
STEP_S = 0.1


def rhythm(on_s: float, off_s: float) -> Callable[[float], bool]:
    """Heard for `on_s`, then not for `off_s`, again and again; the off phase comes first."""
    return lambda at: at % (on_s + off_s) >= off_s - 1e-9


def fly(bench: Bench, seconds: float, hears: Callable[[float], bool], *stations: int) -> None:
    """These stations hear the vehicle when `hears` says so."""
    begun = bench.now
    while bench.now - begun < seconds - 1e-9:
        bench.deaf = set() if hears(bench.now - begun) else set(stations)
        bench.run(STEP_S)


def moves(bench: Bench) -> list[str]:
    return [r.text for r in (*bench.records("authority_lost"), *bench.records("authority"))]


def on_mission(*alive: int) -> Bench:
    bench = Bench()
    bench.alive = {A, *alive}
    bench.on_mission()
    bench.facts = (inside(A), *(inside(station) for station in alive), *far(253, 254))
    bench.log.clear()
    return bench


# ---- too little ------------------------------------------------------------------------------------------------------


def test_a_commander_that_hears_three_tenths_of_a_second_in_five_is_lost() -> None:
    """Attack 5: its operator saw nothing, one answer in five seconds kept it in command, and nothing was said."""
    bench = on_mission()
    fly(bench, 20.0, rhythm(0.3, 4.7), A)
    assert bench.arbiter.view.commander is None
    assert bench.flights() == [RETURN]
    assert moves(bench) == ["GCSA hears less than 15 % of what the aircraft sends: no station commands"]
    told = [action.text for _at, action in bench.log if isinstance(action, Announce)]
    assert any("GCSA hears less than 15 % of what the aircraft sends" in text for text in told), told


def test_it_is_lost_within_fourteen_seconds() -> None:
    bench = on_mission()
    fly(bench, 14.0, rhythm(0.3, 4.7), A)
    assert bench.arbiter.view.commander is None


def taken_by_b() -> Bench:
    """GCSA has lost command because it hears too little, and GCSB has taken the aircraft."""
    bench = on_mission(B)
    bench.facts = (inside(A), *far(B, 253, 254))
    fly(bench, 9.0, rhythm(0.3, 4.7), A)
    bench.facts = (inside(A), inside(B), *far(253, 254))
    while bench.arbiter.view.commander == A:
        fly(bench, STEP_S, lambda _at: False, A)
    view = bench.arbiter.view
    assert view.partner == B
    key = TransferKey(A, B, view.handover_id, view.epoch)
    bench.say(B, OnHandover(key))
    bench.say(B, DroneConnected(key))
    return bench


def test_it_goes_to_a_station_that_hears_and_not_to_one_as_deaf() -> None:
    bench = taken_by_b()
    assert bench.arbiter.view.commander == B
    assert bench.flights() == []


def test_where_all_hear_as_little_nobody_takes_it() -> None:
    bench = on_mission(B)
    bench.facts = (inside(A), *far(B, 253, 254))
    fly(bench, 15.0, rhythm(0.3, 4.7), A, B)
    bench.facts = (inside(A), inside(B), *far(253, 254))
    fly(bench, 120.0, rhythm(0.3, 4.7), A, B)
    assert bench.arbiter.view.commander is None
    assert bench.flights() == [RETURN]
    assert bench.records("transfer_begun") == []


def test_a_partner_that_hears_too_little_is_none_and_covers_nothing() -> None:
    bench = on_mission(B)
    bench.facts = (inside(A), *far(B, 253, 254))
    fly(bench, 15.0, rhythm(0.3, 4.7), B)
    for _ in range(300):  # at whatever moment
        assert bench.arbiter.unfit(B, bench.now) is Reason.PARTNER_SILENT
        assert bench.arbiter.usable(bench.now) == {A}
        fly(bench, STEP_S, rhythm(0.3, 4.7), B)
    bench.position(inside(A, exit_s=4.0), inside(B), *far(253, 254))
    assert bench.arbiter.view.partner is None
    assert [r.text for r in bench.records("partner_unfit")][-1:] != []


def test_what_is_said_of_such_a_partner() -> None:
    bench = on_mission(B)
    bench.facts = (inside(A), *far(B, 253, 254))
    fly(bench, 15.0, rhythm(0.3, 4.7), B)
    bench.deaf = set()
    bench.run(1.0)
    bench.position(inside(A), inside(B), *far(253, 254))
    assert [record.text for record in bench.records("partner_unfit")] == [
        "GCSB cannot be partner: it hears less than 15 % of what the aircraft sends"
    ]


def test_the_operators_get_no_advice_about_a_partner_that_comes_into_range() -> None:
    """At the entry of its zone it has answered too few questions yet. Soon it is partner, or barred."""
    bench = on_mission(B)
    bench.facts = (inside(A), *far(B, 253, 254))
    bench.alive = {A}
    bench.run(8.0)
    bench.alive = {A, B}
    fly(bench, 5.0, rhythm(0.2, 0.8), B)
    bench.log.clear()
    bench.position(inside(A), inside(B), *far(253, 254))
    assert [record.text for record in bench.records("partner_unfit")] == [
        "GCSB cannot be partner: it has answered too few questions"
    ]
    assert [action for _at, action in bench.log if isinstance(action, Advise)] == []


def test_a_transfer_to_a_partner_that_goes_deaf_does_not_commit() -> None:
    bench = Bench().up_to("RELEASE")
    bench.arbiter._presence[B].hearing.barred_at = bench.now
    bench.say(A, DisconnectHandover(KEY))
    assert bench.arbiter.view.commander == A
    assert bench.arbiter.view.partner is None


def test_that_a_station_is_deaf_is_told_also_when_its_answer_shows_it() -> None:
    """Its share may fall below the limit between two questions, where an answer is looked at."""
    bench = on_mission(B)
    bench.run(1.2)
    presence = bench.arbiter._presence[B]
    presence.hearing.begin()
    for ago_s in range(13, 0, -1):
        presence.hearing.asked(bench.now - ago_s)
    question = next(
        action.message
        for _at, action in bench.log
        if isinstance(action, Send) and action.station == B and isinstance(action.message, Connect)
    )
    presence.asked.append((question.nonce, bench.now - 0.1))
    assert bench.now < presence.ask_at
    bench.log.clear()
    bench.say(B, bench.ack(B, question))
    assert presence.hearing.barred
    assert [record.text for record in bench.records("deaf")] == ["GCSB hears less than 15 % of what the aircraft sends"]


# ---- enough ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("on_off", [(2.0, 3.0), (1.0, 2.0), (5.0, 4.0)])
def test_a_commander_that_hears_a_third_of_the_time_commands(on_off: tuple[float, float]) -> None:
    bench = on_mission()
    fly(bench, 300.0, rhythm(*on_off), A)
    assert bench.arbiter.view.commander == A
    assert moves(bench) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", first(1, range(4)))
def test_at_one_message_in_five_lost_each_way_nothing_is_deaf(seed: int) -> None:
    visits = {A: [(0.0, 900.0)], B: [(400.0, 900.0)]}
    net = Network(visits, (A, B), air=lossy(seed, 0.2)).run(880.0)
    said = net.said("authority_lost") + net.said("partner_unfit")
    assert [text for text in said if "hears" in text or "answers no more" in text] == []
    assert [(old, new) for old, new, _epoch in net.commits()] == [(A, B)]


def test_total_loss_is_noticed_after_ten_seconds_as_ever() -> None:
    bench = on_mission()
    begun = bench.now
    bench.deaf = {A}
    while bench.arbiter.view.commander == A:
        bench.run(0.05)
    assert 9.0 <= bench.now - begun <= 10.1
    assert moves(bench) == ["GCSA answers no more: no station commands"]


def test_a_station_that_is_not_heard_is_silent_and_not_deaf() -> None:
    bench = on_mission(B)
    bench.alive = {A}
    bench.run(60.0)
    assert not bench.arbiter._presence[B].hearing.barred
    bench.alive = {A, B}
    bench.run(1.0)
    assert bench.arbiter.unfit(B, bench.now) is None


# ---- by chance ------------------------------------------------------------------------------------------------------


def lost_after(seed: int, heard: float, within_s: float) -> float:
    """When a commander is lost (s) that is heard well, and hears each question by chance from 0 on; inf: it is not."""
    chance, limits, delay_s = Random(seed), Limits(), 0.3
    presence = Presence(STATIONS[0], limits)
    presence.hearing.trust(0.0)
    presence.heard_at, presence.answered_at = inf, 0.0
    presence.ask_at = chance.random()
    answers: list[tuple[float, int]] = []
    now, nonce = 0.0, 0
    while now < within_s:
        now = min([presence.ask_at, *(at for at, _nonce in answers[:1])])
        if presence.deaf_at(-100.0) <= now or presence.judge(now):
            return now
        if answers and answers[0][0] == now:
            asked_at = presence.answers(answers.pop(0)[1], now)
            assert asked_at is not None
            presence.answered_at = now
            presence.hearing.answered(asked_at, now)
            continue
        nonce += 1
        presence.asked.append((nonce, now))
        presence.hearing.asked(now)
        presence.ask_at = now + presence.pause_s(now, owner=True)
        if chance.random() < heard:
            answers.append((now + delay_s, nonce))
    return inf


@pytest.mark.slow
@pytest.mark.parametrize(("heard", "longest_s"), [(0.0, 11.0), (0.03, 15.0), (0.05, 16.0), (0.06, 17.0)])
def test_whom_chance_lets_hear_next_to_nothing_is_lost_in_time_in_99_of_100_trials(
    heard: float, longest_s: float
) -> None:
    """Not in all: lucky answers count until they leave the time that is looked at."""
    after_s = sorted(lost_after(seed, heard, 60.0) for seed in range(400))
    assert after_s[395] <= longest_s
    assert after_s[399] <= 24.0
    assert after_s[0] >= 8.9  # the last answer came up to a second before


@pytest.mark.slow
def test_whom_chance_lets_hear_half_of_it_commands() -> None:
    assert [lost_after(seed, 0.5, 600.0) for seed in range(10)] == [inf] * 10


# ---- coming back -----------------------------------------------------------------------------------------------------


def test_a_station_that_is_not_heard_is_asked_once_a_second_whatever_it_answered_before() -> None:
    """Half-answered questions made it one of those that are asked four times a second; silence kept that pace."""
    bench = on_mission(B)
    fly(bench, 10.0, rhythm(1.0, 1.0), B)
    bench.alive = {A}
    bench.run(8.0)
    bench.log.clear()
    bench.run(10.0)
    asked = [action for _at, action in bench.log if isinstance(action, Send) and action.station == B]
    assert 9 <= sum(isinstance(each.message, Connect) for each in asked) <= 11


def test_a_commander_that_was_deaf_is_back_when_it_has_answered_well_for_longer_than_it_took() -> None:
    bench = on_mission()
    fly(bench, 20.0, lambda _at: False, A)
    assert bench.arbiter.view.commander is None
    begun = bench.now
    bench.deaf = set()
    while bench.arbiter.view.commander is None:
        bench.run(0.1)
    assert 12.0 <= bench.now - begun <= 18.0
    assert bench.records("hears_again")[0].text == "GCSA hears the aircraft again"


def test_a_lucky_answer_now_and_then_brings_nothing_back() -> None:
    bench = on_mission()
    fly(bench, 20.0, lambda _at: False, A)
    fly(bench, 200.0, rhythm(1.0, 4.0), A)
    assert bench.arbiter.view.commander is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("on_s", "off_s"),
    first(3, [(0.3, 4.7), (17.0, 11.0), (20.0, 20.0), (1.0, 9.0), (2.0, 11.0), (45.0, 12.0)]),
)
def test_whatever_the_rhythm_command_is_lost_five_times_in_ten_minutes_at_most(on_s: float, off_s: float) -> None:
    """Attack 17: 'answers no more' and 'is back' came 46 times in ten minutes."""
    bench = on_mission()
    fly(bench, 600.0, rhythm(on_s, off_s), A)
    assert len(bench.records("authority_lost")) <= 5
    assert len(bench.records("authority")) <= 5


@pytest.mark.slow
def test_a_commander_that_falls_silent_again_and_again_is_lost_five_times_at_most() -> None:
    bench = on_mission()
    for _ in range(60):
        bench.alive = set()
        bench.run(6.0)
        bench.alive = {A}
        bench.run(4.0)
    assert 1 < len(bench.records("authority_lost")) <= 5


def test_a_station_that_was_lost_as_deaf_is_no_partner_at_once_after_a_silence() -> None:
    """Five seconds of silence lifted the bar, and one answer made it a partner that counted as coverage."""
    bench = taken_by_b()
    bench.alive = {B}
    bench.run(6.0)
    bench.alive, bench.deaf = {A, B}, set()
    begun = bench.now
    while bench.arbiter.unfit(A, bench.now) is not None:
        bench.run(STEP_S)
    assert 12.0 <= bench.now - begun <= 14.0


def test_the_first_silence_needs_no_proof() -> None:
    bench = on_mission()
    bench.alive = set()
    bench.run(7.0)
    assert bench.arbiter.view.commander is None
    bench.alive = {A}
    bench.run(1.0)
    assert bench.arbiter.view.commander == A


def test_after_a_landing_nothing_of_it_counts() -> None:
    bench = on_mission()
    fly(bench, 20.0, lambda _at: False, A)
    bench.deaf = set()
    bench.autopilot_says(armed=False, flying=False)
    bench.run(2.0)
    assert bench.arbiter.view.commander == A
    assert bench.arbiter._presence[A].hearing.losses == 0


# ---- the share -------------------------------------------------------------------------------------------------------


def asked(times: dict[float, bool]) -> Hearing:
    """Questions at these times, answered or not."""
    hearing = Hearing(Limits())
    for at, answered in times.items():
        hearing.asked(at)
        if answered:
            hearing.answered(at, at)
    return hearing


def share_of(hearing: Hearing, now: float) -> float | None:
    hearing.judge(now)
    return hearing.share


def test_a_share_is_of_the_time_and_not_of_the_questions() -> None:
    once = {float(second): True for second in range(100, 105)}
    often = {105.0 + 0.2 * number: False for number in range(30)}
    assert share_of(asked(once | often), 111.0) == pytest.approx(0.5)


def test_a_question_counts_after_a_second() -> None:
    hearing = asked({100.0: True, 101.0: False})
    assert share_of(hearing, 101.0) == 1.0
    assert share_of(hearing, 102.0) == 1.0
    assert share_of(hearing, 103.0) == 0.5
    assert share_of(Hearing(Limits()), 100.0) is None


def test_few_questions_bar_nobody() -> None:
    hearing = asked({100.0 + number: False for number in range(12)})
    hearing.judge(110.9)
    assert not hearing.barred
    hearing.judge(111.0)
    assert hearing.barred_at == 111.0


@pytest.mark.parametrize(("interval_s", "lost_s"), [(0.2, 60.0), (0.2, 120.0), (1.0, 120.0), (10.0, 120.0)])
def test_whatever_the_configured_times_a_station_that_answers_nothing_is_barred(
    interval_s: float, lost_s: float
) -> None:
    """With many questions in the time that counts the older ones were forgotten, and no share was ever known."""
    hearing = Hearing(Limits(connect_interval_s=interval_s, deaf_lost_s=lost_s))
    hearing.trust(0.0)
    number = 0
    while not hearing.barred and number * interval_s < 3.0 * lost_s:
        number += 1
        hearing.asked(number * interval_s)
        hearing.judge(number * interval_s + interval_s)
    assert lost_s - interval_s <= number * interval_s <= lost_s + 2.0 * interval_s + 1.0


def test_a_take_over_stands_until_the_next_question_as_an_answer_does() -> None:
    """The second of the take-over did not count: a commander with 15 % was lost half a second early."""
    trusted = Hearing(Limits())
    trusted.trust(100.0)
    answers_all = asked({80.0 + number: True for number in range(21)})
    for hearing in (trusted, answers_all):
        for number in range(1, 10):
            hearing.asked(100.0 + number)
            hearing.judge(100.5 + number)
    assert trusted.share == answers_all.share
    assert trusted.share is not None
    assert 0.0 < trusted.share < 1.0


def test_each_loss_of_command_makes_the_way_back_longer() -> None:
    hearing = Hearing(Limits())
    waits = []
    for _ in range(6):
        hearing.lost(0.0, deaf=True)
        waits.append(hearing._back_s)
    assert waits == [12.0, 36.0, 108.0, 300.0, 300.0, 300.0]
    hearing.forgive()
    assert (hearing.losses, hearing.barred_at) == (0, inf)


def test_to_be_given_the_aircraft_takes_more_than_not_to_be_barred() -> None:
    hearing = asked({100.0 + number: number % 4 == 0 for number in range(13)})
    hearing.judge(112.9)
    assert not hearing.barred
    assert hearing.share == pytest.approx(0.25, abs=0.06)
    assert not hearing.enough
    assert Hearing(Limits()).enough

# SPDX-License-Identifier: GPL-3.0-or-later

"""A commander that is heard and hears nothing of the aircraft is lost, like one that is silent. The fault: its
heartbeats alone kept it in command for ever, of an aircraft that its operator did not see."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.events import Announce, Fly, Send
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Consent, FlightAction, LeaseState, Reason
from tests.core.bench import (
    A,
    B,
    Bench,
    Connect,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    Phase,
    TransferKey,
    inside,
    outside,
)

RETURN = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)


def deafened(limits: Limits | None = None, *alive: int) -> Bench:
    """GCSA commands in flight and hears nothing from now on."""
    bench = Bench(limits)
    bench.alive = {A, *alive}
    bench.on_mission()
    bench.log.clear()
    bench.deaf = {A}
    return bench


def lost_at(bench: Bench) -> list[float]:
    return [at for at, action in bench.log if getattr(action, "event", "") == "authority_lost"]


def lost_beside_b() -> tuple[Bench, TransferKey]:
    """GCSA is lost where GCSB could take the aircraft, and that has been asked by force."""
    bench = deafened(None, B)
    bench.facts = (inside(A), inside(B))
    while not lost_at(bench):
        bench.run(0.5)
    view = bench.arbiter.view
    assert view.partner == B
    return bench, TransferKey(A, B, view.handover_id, view.epoch)


def test_it_is_lost_when_it_has_not_answered_for_so_long() -> None:
    bench = deafened()
    begun = bench.now
    bench.run(9.0)
    assert (bench.arbiter.view.commander, bench.flights()) == (A, [])
    bench.run(3.0)
    (at,) = lost_at(bench)
    assert 9.0 < at - begun <= 10.0, "its last answer was up to a second old"
    assert bench.arbiter.view.commander is None
    assert bench.arbiter.view.lease is LeaseState.LOST
    assert [record.text for record in bench.records("authority_lost")] == ["GCSA answers no more: no station commands"]


def test_with_nobody_else_the_aircraft_comes_home_and_says_why() -> None:
    bench = deafened()
    bench.run(13.0)
    assert bench.flights() == [RETURN]
    told = [action.text for _at, action in bench.log if isinstance(action, Announce)]
    assert any(text.startswith("RETURN") and "GCSA hears nothing for 1" in text for text in told), told


def test_another_station_takes_it_by_its_own_word() -> None:
    bench, key = lost_beside_b()
    bench.say(B, OnHandover(key))
    bench.say(B, DroneConnected(key))
    assert bench.arbiter.view.commander == B
    assert bench.flights() == []


@pytest.mark.parametrize("away_s", [2.0, 30.0])
def test_its_heartbeat_brings_nothing_back_and_its_answers_do(away_s: float) -> None:
    bench = deafened()
    bench.run(12.0)
    bench.run(away_s)
    assert bench.arbiter.view.commander is None
    bench.deaf.clear()
    bench.run(12.0)
    assert bench.arbiter.view.commander is None
    bench.run(6.0)
    assert bench.arbiter.view.commander == A
    assert bench.arbiter.view.epoch == 2
    bench.run(30.0)
    assert bench.arbiter.view.commander == A


def test_silent_and_back_it_is_back_when_it_answers() -> None:
    """Flight 2301259 of the campaign: a weak link hid the heartbeats of a deaf commander for 5 s, and the next one
    brought it back, for 10 s more: 19.5 s without a commander that hears."""
    bench = deafened()
    begun = bench.now
    bench.run(4.0)
    bench.alive.clear()
    while not lost_at(bench):
        bench.run(0.25)
    assert bench.now - begun < 10.0, "silent, and not yet deaf"
    bench.alive = {A}
    bench.run(20.0)
    assert bench.arbiter.view.commander is None
    bench.deaf.clear()
    bench.run(18.0)
    assert bench.arbiter.view.commander == A


def test_of_one_that_is_lost_no_denial_ends_a_forced_transfer() -> None:
    bench, key = lost_beside_b()
    bench.say(A, OkHandover(key, Consent.DENIED))
    bench.say(B, OnHandover(key))
    bench.say(B, DroneConnected(key))
    assert bench.arbiter.view.commander == B
    assert bench.dropped() == {"the commander is lost": 1}


def test_whose_answer_is_overdue_is_asked_five_times_a_second() -> None:
    """Asked once a second a link that loses a third of everything leaves ten seconds without an answer several times in
    an hour, and each of them would be a return."""
    bench = deafened(None, B)
    begun = bench.now
    bench.run(3.05)
    asked = {A: 0, B: 0}
    for at, action in bench.log:
        if isinstance(action, Send) and isinstance(action.message, Connect) and at > begun + 2.05:
            asked[action.station] = asked.get(action.station, 0) + 1
    assert (asked[B], asked[A]) == (1, 5)


def test_a_station_of_the_standard_is_back_by_its_heartbeat_each_time() -> None:
    bench = Bench(standard={A})
    bench.on_mission()
    for _ in range(3):
        bench.alive = {A}
        bench.run(2.0)
        assert bench.arbiter.view.commander == A
        bench.alive.clear()
        bench.run(6.0)
        assert bench.arbiter.view.commander is None


def test_a_partner_that_goes_deaf_as_it_takes_over_does_not_keep_it() -> None:
    """Flight 1050295 of the campaign: the last thing that it heard was that it should take the aircraft."""
    bench = Bench()
    bench.on_mission()
    bench.position(inside(A, exit_s=7.0), inside(B, exit_s=90.0))
    view = bench.arbiter.view
    key = TransferKey(A, B, view.handover_id, view.epoch)
    bench.say(B, OnHandover(key))
    bench.say(A, OkHandover(key))
    bench.say(B, DroneConnected(key))
    bench.say(A, DisconnectHandover(key))
    assert bench.arbiter.view.commander == B
    bench.deaf = {B}
    bench.alive = {B}
    bench.facts = (outside(A), inside(B))
    bench.run(9.0)
    assert bench.arbiter.view.commander == B
    bench.run(5.0)
    assert bench.arbiter.view.commander is None
    assert RETURN in bench.flights()


def test_after_a_restart_it_is_back_when_it_answers() -> None:
    bench = deafened()
    bench.run(3.0)
    bench.restart(1.0)
    bench.run(4.0)
    assert bench.arbiter.view.commander is None
    assert bench.flights() == [RETURN]
    bench.deaf.clear()
    bench.run(0.25)
    assert bench.arbiter.view.commander == A


def test_a_station_of_the_standard_answers_nothing_and_commands() -> None:
    bench = Bench(standard={A})
    bench.alive = {A}
    bench.on_mission()
    bench.run(60.0)
    assert bench.arbiter.view.commander == A


def test_on_the_ground_it_is_lost_too_and_gets_it_back() -> None:
    bench = Bench().on_ground()
    bench.deaf = {A}
    bench.run(12.0)
    assert bench.arbiter.view.commander is None
    assert bench.arbiter.view.phase is Phase.ON_LOAD
    bench.deaf.clear()
    bench.run(2.0)
    assert bench.arbiter.view.commander == A


def test_the_limit_is_the_configurations() -> None:
    bench = deafened(Limits(deaf_lost_s=30.0))
    bench.facts = (inside(A), outside(B))
    bench.run(28.0)
    assert bench.arbiter.view.commander == A
    bench.run(4.0)
    assert bench.arbiter.view.commander is None

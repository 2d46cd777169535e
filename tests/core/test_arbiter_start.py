# SPDX-License-Identifier: GPL-3.0-or-later

"""START: what it needs, each need alone, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from mavproxy_handover.core.common.events import (
    AircraftJudged,
    BeginStart,
    ControlAnswer,
    ControlRequested,
    ControlResult,
    EnergyJudged,
    GapsJudged,
    GuardSeen,
    HeightsJudged,
    MissionLoaded,
    Record,
    ReturnJudged,
    StartFinished,
    StartRefused,
    StartRequested,
    ViewChanged,
)
from mavproxy_handover.core.common.flight import StartJudgement
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import AuthorityView, GuardState, LeaseState
from tests.core.bench import (
    DIGEST,
    KEY,
    A,
    B,
    Bench,
    DroneConnected,
    OnHandover,
    Phase,
    Reason,
    inside,
    not_records,
    outside,
)


def without_autopilot(bench: Bench) -> None:
    bench.autopilot = False
    bench.run(3.0)


def without_position(bench: Bench) -> None:
    bench.facts = None
    bench.run(2.0)


def without_guard(bench: Bench) -> None:
    bench.guard = None
    bench.run(2.0)


def guard_says(state: GuardState, *, ours: bool = True) -> Callable[[Bench], None]:
    def say(bench: Bench) -> None:
        bench.guard = GuardSeen(state, ours)
        bench.give(bench.guard)

    return say


NO_GUARD = "the guard does not answer the lease"
NEEDS: dict[str, tuple[Callable[[Bench], object], str]] = {
    "mission": (lambda b: b.give(MissionLoaded(b"", ())), "no mission loaded"),
    "autopilot": (without_autopilot, "no autopilot"),
    "armed": (lambda b: b.autopilot_says(armed=True, flying=False), "the vehicle is already flying or starting"),
    "starting": (lambda b: b.give(StartRequested(A)), "the vehicle is already flying or starting"),
    "guard silent": (without_guard, NO_GUARD),
    "guard without a lease": (guard_says(GuardState.WAITING), NO_GUARD),
    "guard with a dead lease": (guard_says(GuardState.EXPIRED), NO_GUARD),
    "guard with a lost lease": (guard_says(GuardState.LOST), NO_GUARD),
    "guard switched off": (guard_says(GuardState.DISABLED), NO_GUARD),
    "guard of another companion": (guard_says(GuardState.LIVE, ours=False), NO_GUARD),
    "position": (without_position, "no position"),
    "zone": (lambda b: b.position(outside(A), inside(B)), "outside the zone of GCSA"),
}


def test_with_every_need_met_it_begins() -> None:
    bench = Bench().on_ground()
    assert bench.arbiter.start_needs(A, bench.now) == ()
    assert bench.give(StartRequested(A)) == [Record("start", "START from GCSA", station=A), BeginStart(A)]


@pytest.mark.parametrize("missing", NEEDS)
def test_each_need_alone_refuses_it(missing: str) -> None:
    spoil, text = NEEDS[missing]
    bench = Bench().on_ground()
    spoil(bench)
    before = bench.arbiter.view
    assert not_records(bench.give(StartRequested(A))) == [StartRefused(A, (text,))]
    assert bench.records("start_refused")[-1].text == f"START refused: {text}"
    assert bench.arbiter.view == before


def test_only_the_commander_may_start() -> None:
    bench = Bench().on_ground()
    bench.position(inside(A), inside(B))
    assert not_records(bench.give(StartRequested(B))) == [StartRefused(B, ("GCSB does not command",))]
    assert not_records(bench.give(StartRequested(99))) == [
        StartRefused(99, ("station 99 does not command", "outside the zone of station 99"))
    ]


def test_a_lost_commander_does_not_start() -> None:
    bench = Bench().on_ground()
    bench.alive = {B}
    bench.run(10.0)
    assert not_records(bench.give(StartRequested(A))) == [StartRefused(A, ("GCSA does not command",))]


def test_every_missing_need_is_named() -> None:
    bench = Bench()
    bench.alive, bench.autopilot, bench.guard, bench.facts = set(), False, None, None
    bench.run(5.0)
    assert not_records(bench.give(StartRequested(A))) == [
        StartRefused(A, ("GCSA does not command", "no mission loaded", "no autopilot", NO_GUARD, "no position"))
    ]


def test_in_flight_there_is_no_start() -> None:
    bench = Bench().on_mission()
    assert not_records(bench.give(StartRequested(A))) == [
        StartRefused(A, ("the vehicle is already flying or starting",))
    ]


def test_a_vehicle_without_a_guard_starts_without_one() -> None:
    bench = Bench(replace(Limits(), guard_required=False)).on_ground()
    without_guard(bench)
    assert bench.arbiter.start_needs(A, bench.now) == ()


def test_success_is_a_mission() -> None:
    bench = Bench().on_ground()
    bench.give(StartRequested(A))
    bench.autopilot_says(armed=True, flying=False)
    bench.log.clear()
    bench.give(StartFinished(ok=True))
    assert bench.views() == [
        ViewChanged(AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0), Reason.STARTED)
    ]


def test_the_phase_waits_for_the_end_of_the_sequence() -> None:
    # off the ground before AUTO is confirmed: still the same START, and no second "on mission" after it
    bench = Bench().on_ground()
    bench.give(StartRequested(A))
    bench.autopilot_says(armed=True, flying=True)
    assert bench.records("started") == []
    bench.give(StartFinished(ok=True))
    assert bench.arbiter.view.phase is Phase.ON_MISSION
    assert [record.text for record in bench.records("started")] == ["on mission: armed and in AUTO"]


def test_failure_is_told_and_may_be_tried_again() -> None:
    bench = Bench().on_ground()
    bench.give(StartRequested(A))
    assert not_records(bench.give(StartFinished(ok=False, text="arming refused"))) == []
    assert [record.text for record in bench.records("start_failed")] == ["START failed: arming refused"]
    assert bench.arbiter.view.phase is Phase.ON_LOAD
    assert not_records(bench.give(StartRequested(A))) == [BeginStart(A)]


def test_an_end_without_a_beginning_starts_nothing() -> None:
    bench = Bench().on_ground()
    assert not_records(bench.give(StartFinished(ok=True))) == []
    assert bench.arbiter.view.phase is Phase.ON_LOAD


def test_what_was_loaded_is_journalled_and_that_it_holds_no_more_is_too() -> None:
    bench = Bench().on_ground()
    bench.give(MissionLoaded(b"", ()))
    assert [record.text for record in bench.records("mission_loaded")] == [
        "mission loaded, commanders along the route: GCSA GCSB GCSA GCSB GCSA"
    ]
    assert [record.text for record in bench.records("mission_dropped")] == [
        "the autopilot no longer holds the mission that was loaded"
    ]


def test_the_mission_loaded_is_the_one_that_partners_must_hold() -> None:
    bench = Bench().on_ground()
    assert bench.arbiter.mission_digest == DIGEST
    assert bench.arbiter.unfit(B, bench.now) is None
    bench.give(MissionLoaded(bytes(32), (A, B)))
    assert bench.arbiter.mission_digest == bytes(32)
    assert bench.arbiter.unfit(B, bench.now) is Reason.MISSION_DIFFERS


class TestOnItsWay:
    """From START on the aircraft is about to fly: the rules of the ground hold no more."""

    def test_the_aircraft_is_not_left_without_a_commander(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        answer = ControlAnswer(A, ControlResult.ACCEPTED)
        assert answer in bench.give(ControlRequested(A, False, False, 0.0, A))
        # nobody's zone but the commander's holds it: the commander stays, and whoever can take it later need not ask
        assert (bench.arbiter.view.commander, bench.arbiter.view.takeover_allowed) == (A, True)
        bench.autopilot_says(armed=True, flying=False)
        bench.give(StartFinished(ok=True))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(1.0)
        assert (bench.arbiter.view.phase, bench.arbiter.view.commander) == (Phase.ON_MISSION, A)
        assert bench.flights() == []

    def test_nor_between_its_end_and_the_autopilots_next_heartbeat(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        bench.give(StartFinished(ok=True))  # armed and in AUTO, but the last heartbeat was of before
        bench.give(ControlRequested(A, False, False, 0.0, A))
        assert (bench.arbiter.view.commander, bench.arbiter.view.takeover_allowed) == (A, True)

    def test_nobody_gets_it_who_could_not_have_it_in_flight(self) -> None:
        bench = Bench().on_ground()
        bench.give(ControlRequested(A, True, True, 10.0, A))
        bench.give(StartRequested(A))
        answer = ControlAnswer(B, ControlResult.DENIED, "the aircraft is outside the zone of GCSB")
        assert answer in bench.give(ControlRequested(B, True, False, 10.0, B))
        assert (bench.arbiter.view.commander, bench.arbiter.view.partner) == (A, None)

    def test_the_parent_does_not_inherit_it(self) -> None:
        bench = Bench().on_ground()
        bench.give(ControlRequested(A, True, False, 10.0, B))
        for word in (OnHandover(KEY), DroneConnected(KEY)):
            bench.say(B, word)
        bench.position(inside(A), inside(B))
        assert bench.arbiter.view.commander == B
        bench.give(StartRequested(B))
        bench.alive = {A}
        bench.run(6.0)
        assert bench.arbiter.view.commander is None
        bench.give(StartFinished(ok=False, text="arming refused"))
        bench.run(1.0)
        assert bench.arbiter.view.commander == A

    def test_when_it_has_failed_the_rules_of_the_ground_hold_again(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        bench.give(StartFinished(ok=False, text="arming refused"))
        bench.give(ControlRequested(A, False, False, 0.0, A))
        assert bench.arbiter.view.commander is None


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (EnergyJudged("12 Wh are missing"), "energy: 12 Wh are missing"),
        (GapsJudged("too long"), "gaps: too long"),
        (ReturnJudged("no place"), "a return does not land: no place"),
        (AircraftJudged("it is for a plane"), "it is for a plane"),
        (HeightsJudged("other terrain"), "heights: other terrain"),
    ],
)
def test_what_the_loaded_mission_lacks_stops_a_flight_and_no_rehearsal(event: StartJudgement, text: str) -> None:
    bench = Bench().on_ground()
    bench.give(event)
    assert bench.arbiter.start_needs(A, bench.now) == (text,)
    assert bench.rehearsal_needs(A) == ()
    bench.give(MissionLoaded(b"", ()))
    assert bench.arbiter.start_needs(A, bench.now) == ("no mission loaded",)


class TestByHand:
    """A command that is a part of START: the one before may have armed already."""

    FLIES = ("the vehicle is already flying or starting",)

    def test_armed_on_the_ground_it_may_take_off_and_not_start(self) -> None:
        bench = Bench().on_ground()
        bench.autopilot_says(armed=True, flying=False)
        assert bench.arbiter.take_off_needs(A, bench.now) == ()
        assert bench.arbiter.start_needs(A, bench.now) == self.FLIES

    def test_while_start_is_under_way_it_may_not(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        assert bench.arbiter.take_off_needs(A, bench.now) == self.FLIES

    def test_in_flight_it_may_not(self) -> None:
        bench = Bench().on_mission()
        assert bench.arbiter.take_off_needs(A, bench.now) == self.FLIES


def test_the_beginning_of_a_flight_is_journalled() -> None:
    bench = Bench().on_mission()
    assert bench.records("start") == [Record("start", "START from GCSA", station=A)]
    assert bench.records("started") == [Record("started", "on mission: armed and in AUTO", Reason.STARTED, A)]

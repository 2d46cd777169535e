# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion dies while the aircraft stands still by its order: the next run holds it on, for what is left of the
time, or has it fly on. The fault: nobody knew of it any more, and it stood there until its battery was low."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    ConditionsSeen,
    Fly,
    LinkJudged,
    ModeSeen,
    ModeSourceSeen,
    MotionSeen,
    Record,
    StationHeard,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, LeaseState, ModeClass, ModeSource, Reason, ZoneFact
from mavproxy_handover.core.common.snapshot import Snapshot
from tests.core.bench import (
    DIGEST,
    A,
    B,
    Bench,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    Phase,
    TransferKey,
    inside,
    outside,
)
from tests.core.safety.test_conditions import GO_ON, HOLD, HOME, ends, mission
from tests.core.safety.test_decision_executor import AUTO, RTL, aloft, said, standing, taken_by_b

HOMEWARD = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)
HELD = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, DIGEST, (A, B, A), held_since=90.0, held_for=Cause.COVERAGE_ENDS)


def held(limits: Limits | None = None) -> Bench:
    """Held for the end of coverage, and standing still."""
    bench = mission(limits)
    bench.position(ends(4.0), outside(B))
    assert bench.flights() == [HOLD]
    bench.facts = (inside(A), outside(B))
    bench.run(5.0)
    return bench


def orders(bench: Bench) -> list[tuple[float, FlightAction]]:
    return [(at, action.action) for at, action in bench.log if isinstance(action, Fly)]


def test_what_is_held_is_kept_and_for_what() -> None:
    bench = mission()
    assert bench.arbiter.snapshot().held_since is None
    bench.position(ends(4.0), outside(B))
    snapshot = bench.arbiter.snapshot()
    assert (snapshot.held_since, snapshot.held_for) == (bench.now, Cause.COVERAGE_ENDS)


def test_it_is_held_on_and_told_anew() -> None:
    bench = held().restart()
    bench.run(2.0)
    assert bench.flights() == [HOLD]
    assert [record.text for record in bench.records("emergency")] == ["coverage ends ahead: hold"]


def test_the_hold_time_goes_on_over_a_restart_and_over_another() -> None:
    bench = held(Limits(hold_s=60.0))
    held_at = bench.arbiter.snapshot().held_since
    assert held_at is not None
    bench.restart()
    bench.restart(3.0)  # it died before it had heard anything
    bench.run(20.0)
    assert bench.arbiter.snapshot().held_since == held_at
    bench.restart()
    bench.run(100.0)
    assert orders(bench)[-1] == (held_at + 60.0, FlightAction.RETURN)
    assert [action for _at, action in orders(bench)] == [FlightAction.HOLD, FlightAction.RETURN]


def test_it_flies_on_when_another_station_has_taken_it_behind_the_restart() -> None:
    bench = held().restart()
    bench.alive = {A, B}
    bench.run(3.0)
    bench.position(ends(2.0, A, B), inside(B))
    bench.run(2.0)
    view = bench.arbiter.view
    assert view.partner == B
    key = TransferKey(A, B, view.handover_id, view.epoch)
    for station, word in ((B, OnHandover(key)), (A, OkHandover(key)), (B, DroneConnected(key))):
        bench.say(station, word)
    bench.say(A, DisconnectHandover(key))
    assert bench.flights() == [HOLD, GO_ON]


@pytest.mark.parametrize("facts", [None, (inside(A), outside(B))])
def test_before_it_is_known_to_fly_nothing_is_commanded(facts: tuple[ZoneFact, ...] | None) -> None:
    """Neither on, as if nothing were wrong, nor home, as if it could not stand still here; position or none."""
    bench = held()
    bench.alive = set()
    bench.armed = bench.flying = False
    bench.restart()
    bench.autopilot = False
    bench.alive = {A}
    bench.facts = facts
    bench.run(1.5)
    assert bench.arbiter.view.commander == A
    assert bench.flights() == []
    bench.armed = bench.flying = bench.autopilot = True
    bench.run(0.6)
    assert bench.flights() == [HOLD]  # before there is a position
    bench.position(inside(A), outside(B))
    bench.run(5.0)
    assert bench.flights() == [HOLD]


def test_whose_commander_is_not_heard_again_comes_home() -> None:
    bench = held()
    bench.alive = set()
    bench.restart()
    bench.run(6.0)
    assert bench.arbiter.view.lease is LeaseState.LOST
    assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]


def test_what_its_commander_flies_is_not_held_again() -> None:
    bench = held()
    bench.give(ModeSeen(ModeClass.MISSION, "AUTO", False, False))
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    assert bench.arbiter.snapshot().held_since is None
    bench.restart()
    bench.run(5.0)
    assert bench.flights() == []


def test_nor_is_what_comes_home() -> None:
    bench = held(Limits(hold_s=4.0))
    assert HOME in bench.flights()
    assert bench.arbiter.snapshot().held_for is None


def test_of_another_boot_no_hold_time_is_left() -> None:
    bench = Bench()
    bench.alive = {A}
    bench.armed = bench.flying = True
    bench.facts = (inside(A), outside(B))
    bench.restart(0.0, replace(HELD, proven=False))
    bench.run(10.0)
    assert {action for _at, action in orders(bench)} == {FlightAction.RETURN}


def test_on_the_ground_nothing_is_left_of_it() -> None:
    bench = Bench()
    bench.alive = {A}
    bench.facts = (inside(A), outside(B))
    bench.restart(0.0, HELD)
    bench.run(5.0)
    assert bench.flights() == []
    assert bench.arbiter.snapshot().held_since is None
    bench.armed = bench.flying = True
    bench.run(5.0)
    assert FlightAction.HOLD not in {action for _at, action in orders(bench)}


def test_nor_where_it_stands_with_its_motors_on() -> None:
    bench = held().restart()
    bench.autopilot_says(armed=True, flying=False)
    snapshot = bench.arbiter.snapshot()
    assert (snapshot.held_since, snapshot.stands) == (None, False)


def test_what_was_not_held_waits_for_no_position() -> None:
    bench = mission()
    bench.facts = None
    bench.restart(snapshot=replace(HELD, phase=Phase.EMERGENCY, held_since=None, held_for=None))
    bench.give(bench._state)
    bench.give(StationHeard(A))
    assert bench.arbiter.view.phase is Phase.ON_MISSION
    assert len(bench.records("emergency_over")) == 1


@pytest.mark.parametrize("cause", [Cause.GUARD_LOST, Cause.LINKS_WEAK])
def test_what_was_held_for_something_else_flies_on_when_that_is_gone(cause: Cause) -> None:
    bench = Bench(Limits(policies={cause: "hold"}))
    bench.alive = {A}
    bench.armed = bench.flying = True
    bench.facts = (inside(A), outside(B))
    bench.restart(0.0, replace(HELD, held_since=99.0, held_for=cause))
    bench.run(3.0)
    assert bench.flights() == [GO_ON]
    assert [action.event for _at, action in bench.log if isinstance(action, Record) and "over" in action.event] == [
        "emergency_over"
    ]


def test_a_second_cause_gives_no_new_time() -> None:
    bench = mission(Limits(policies={Cause.GUARD_LOST: "hold"}, hold_s=60.0))
    bench.position(ends(4.0), outside(B))
    held_at = bench.now
    bench.facts = (inside(A), outside(B))
    bench.guard = None
    bench.run(80.0)
    assert [at for at, action in orders(bench) if action is FlightAction.RETURN] == [held_at + 60.0]


def returned_in_vain(bench: Bench) -> None:
    """Its commander is lost for a moment: it is ordered home, and the autopilot does nothing."""
    bench.alive = set()
    while HOMEWARD not in bench.flights():
        bench.run(0.1)
    bench.alive = {A}
    bench.run(bench.limits.obey_s + 1.0)
    assert [flight.action for flight in bench.flights()][-1] is FlightAction.HOLD


@pytest.mark.parametrize("restarts", [False, True])
def test_a_return_that_was_never_flown_gives_no_new_time(restarts: bool) -> None:
    """The fault: the hold behind it began anew, for as long again. Found by a campaign."""
    bench = standing(aloft(Limits(hold_s=60.0)))
    ((held_at, _),) = orders(bench)
    bench.run(20.0)
    returned_in_vain(bench)
    if restarts:
        bench.restart()
    bench.run(100.0)
    # when the autopilot has been looked at once more, half a second later at the most
    over = [at for at, action in orders(bench) if action is FlightAction.RETURN and at > held_at + 30.0]
    assert over[0] - held_at == pytest.approx(60.0, abs=0.6)


def test_and_to_be_ordered_home_behind_a_restart_neither() -> None:
    bench = standing(aloft(Limits(hold_s=60.0)))
    ((held_at, _),) = orders(bench)
    bench.run(20.0)
    bench.alive = set()
    while HOMEWARD not in bench.flights():
        bench.run(0.1)
    assert bench.arbiter.snapshot().held_since == held_at
    bench.restart()
    bench.alive = {A}
    bench.facts = (ends(4.0), outside(B))
    bench.run(100.0)
    (held, _), (over, action) = orders(bench)[:2]
    assert held < held_at + 30.0
    assert (over - held_at, action) == (pytest.approx(60.0, abs=0.6), FlightAction.RETURN)


def test_a_hold_at_another_border_has_all_its_time() -> None:
    bench = standing(aloft(Limits(hold_s=60.0)))
    bench.run(20.0)
    taken_by_b(bench)
    bench.motion = MotionSeen(8.0, 0.0, 300.0)
    bench.run(20.0)
    assert bench.flights()[-1] == GO_ON
    bench.position(outside(A), replace(inside(B, exit_s=4.0), ends_s=4.0))
    held_at = bench.now
    assert bench.flights()[-1] == HOLD
    bench.facts = (outside(A), inside(B))
    bench.motion = MotionSeen(0.0, 0.0, 300.0)
    bench.run(100.0)
    assert orders(bench)[3] == (held_at + 60.0, FlightAction.RETURN)


def test_so_has_one_long_after_another_cause_of_the_first_commander() -> None:
    """What is over takes its time with it: else there would be none left."""
    bench = aloft(Limits(policies={Cause.LINKS_WEAK: "hold"}, hold_s=60.0))
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(12.0)
    bench.give(LinkJudged(A, weak=False, attacked=False, text=""))
    bench.run(80.0)
    assert bench.flights()[-1] == GO_ON
    bench.position(ends(4.0), outside(B))
    assert bench.flights()[-1] == HOLD
    assert bench.arbiter.snapshot().held_since == bench.now


def test_and_one_for_another_cause_while_it_is_to_go_on_by_the_commanders_word() -> None:
    bench = standing(aloft(Limits(policies={Cause.LINKS_WEAK: "hold"}, hold_s=60.0)))
    bench.give(LinkJudged(A, weak=True, attacked=False, text="a third is lost"))
    bench.run(5.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.run(7.0)
    assert bench.flights()[-1] == Fly(FlightAction.HOLD, Reason.LINK_QUALITY)
    since = bench.arbiter.snapshot().held_since
    assert since is not None
    assert since > bench.now - 5.0
    bench.run(70.0)
    assert (since + 60.0, FlightAction.RETURN) in orders(bench)


def test_and_one_behind_a_return_that_was_flown_and_that_a_stranger_has_ended() -> None:
    bench = standing(aloft(Limits(hold_s=60.0)))
    bench.run(5.0)
    bench.alive = set()
    bench.run(6.0)
    assert bench.flights()[-1] == HOMEWARD
    bench.mode, bench.motion = RTL, MotionSeen(8.0, 0.0, 300.0)
    bench.run(2.0)
    bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
    bench.run(3.0)
    bench.alive = {A}
    bench.run(bench.limits.obey_s)
    held_at, action = orders(bench)[-1]
    assert action is FlightAction.HOLD
    assert bench.arbiter.snapshot().held_since == held_at


# ---- it stands, and the order in force is another one ---------------------------------------------------------------


def moves(bench: Bench) -> None:
    """It flies on: nothing more is commanded."""
    ordered = bench.flights()
    bench.motion = MotionSeen(8.0, 0.0, 300.0)
    bench.run(60.0)
    assert bench.flights() == ordered


def test_a_pilot_who_took_it_during_a_restart_is_not_told_to_go_on() -> None:
    """His transmitter lives; the commit that would have ended the hold came under his hands."""
    bench = aloft(Limits(hold_s=60.0), ModeSeen(ModeClass.MISSION, "AUTO", radio=True))
    bench.position(ends(4.0, A, B), outside(B))
    bench.motion, bench.facts = MotionSeen(0.0, 0.0, 300.0), (inside(A), outside(B))
    bench.run(8.0)
    assert bench.flights() == [HOLD]
    bench.restart()
    bench.log.clear()
    bench.mode, bench.motion = ModeSeen(ModeClass.HANDS, "LOITER", radio=True), MotionSeen(4.0, 0.0, 300.0)
    bench.run(5.0)
    bench.facts = (inside(A), inside(B))
    taken_by_b(bench)
    bench.run(60.0)
    assert bench.flights() == []


def ordered_home() -> Bench:
    """Held, and ordered home where the autopilot hears nothing any more: it stands."""
    bench = standing(aloft(Limits(hold_s=4.0)))
    bench.run(3.0)
    assert bench.flights() == [HOLD, HOME]
    bench.log.clear()
    return bench


def test_whose_return_was_never_flown_goes_on_behind_a_restart_when_that_is_over() -> None:
    """The fault: the return had taken the place of the hold in what the next run was told, and when its cause was gone
    the aircraft stood there until its battery was low. Found by a campaign."""
    bench = ordered_home()
    bench.restart()
    bench.run(1.0)
    assert bench.arbiter.view.commander == A
    assert bench.flights() == [GO_ON]
    bench.run(60.0)
    assert len(bench.flights()) > 5
    assert set(bench.flights()) == {GO_ON}
    moves(bench)


def test_and_behind_two() -> None:
    bench = ordered_home()
    bench.restart()
    bench.restart(3.0)  # it died before it had heard anything
    bench.run(1.0)
    assert bench.flights() == [GO_ON]


def test_whose_return_is_flown_by_then_flies_it() -> None:
    bench = ordered_home()
    bench.mode, bench.motion = ModeSeen(ModeClass.RETURN, "RTL", False, False), MotionSeen(8.0, 0.0, 300.0)
    bench.run(1.0)
    assert not bench.arbiter.snapshot().stands
    bench.restart()
    bench.run(5.0)
    assert bench.flights() == []


@pytest.mark.parametrize(
    ("mode", "motion"),
    [
        (ModeSeen(ModeClass.RETURN, "RTL", False, False), MotionSeen(8.0, 0.0, 300.0)),
        (ModeSeen(ModeClass.LAND, "LAND", False, True), MotionSeen(0.0, -0.5, 300.0)),
    ],
    ids=["return", "land"],
)
def test_whose_end_of_the_flight_shows_behind_the_restart_flies_it(mode: ModeSeen, motion: MotionSeen) -> None:
    bench = ordered_home()
    bench.mode, bench.motion = mode, motion
    bench.restart()
    bench.run(20.0)
    assert bench.flights() == []


def test_who_is_ordered_home_before_there_is_a_position_is_held_for_nothing_in_the_next_run() -> None:
    bench = standing(aloft())
    bench.facts = None
    bench.restart()
    bench.run(1.0)
    assert bench.arbiter.snapshot().held_for is Cause.COVERAGE_ENDS
    bench.give(ConditionsSeen(energy=True))
    bench.run(3.0)
    assert bench.flights() == [HOLD, Fly(FlightAction.RETURN, Reason.ENERGY)]
    snapshot = bench.arbiter.snapshot()
    assert (snapshot.held_for, snapshot.stands) == (None, True)
    bench.autopilot = False  # the return waits, which is no hold that waits
    bench.run(4.0)
    assert bench.arbiter.snapshot().held_for is None


def test_nor_whom_a_pilot_has_by_then() -> None:
    bench = aloft(Limits(hold_s=60.0), ModeSeen(ModeClass.MISSION, "AUTO", radio=True))
    bench.position(ends(4.0, A, B), outside(B))
    bench.motion, bench.facts = MotionSeen(0.0, 0.0, 300.0), None
    bench.run(2.0)
    assert bench.flights() == [HOLD]
    bench.mode = ModeSeen(ModeClass.HANDS, "LOITER", radio=True)
    bench.restart()
    bench.run(2.0)
    snapshot = bench.arbiter.snapshot()
    assert (snapshot.held_for, snapshot.stands) == (None, True)


def test_it_stands_until_the_station_that_takes_it_from_a_lost_commander_has_it() -> None:
    bench = ordered_home()
    bench.alive = {B}
    bench.restart()
    while bench.arbiter.view.partner is None:
        bench.run(0.1)
    bench.run(0.5)
    assert bench.arbiter.view.commander is None
    assert bench.flights() == []
    key = TransferKey(A, B, bench.arbiter.view.handover_id, bench.arbiter.view.epoch)
    bench.say(B, OnHandover(key))
    bench.say(B, DroneConnected(key))
    assert bench.arbiter.view.commander == B
    assert bench.flights() == [GO_ON]


def test_what_was_told_to_go_on_and_has_not_is_told_again() -> None:
    """The fault: the companion died behind the order, which the autopilot had not heard."""
    bench = standing(aloft())
    taken_by_b(bench)
    assert bench.flights() == [HOLD, GO_ON]
    bench.restart()
    bench.log.clear()
    bench.run(60.0)
    assert len(bench.flights()) > 5
    assert set(bench.flights()) == {GO_ON}
    moves(bench)


def test_what_is_held_no_more_behind_a_restart_is_told_until_it_goes_on() -> None:
    """The fault: it was told once."""
    bench = Bench(Limits(policies={Cause.LINKS_WEAK: "hold"}))
    bench.alive = {A}
    bench.armed = bench.flying = True
    bench.mode, bench.motion = ModeSeen(ModeClass.MISSION, "AUTO", False, False), MotionSeen(0.0, 0.0, 300.0)
    bench.facts = (inside(A), outside(B))
    bench.restart(0.0, replace(HELD, held_since=99.0, held_for=Cause.LINKS_WEAK, stands=True))
    bench.run(60.0)
    assert len(bench.flights()) > 5
    assert set(bench.flights()) == {GO_ON}
    moves(bench)


def test_what_its_commander_has_stopped_stands_by_that_word_behind_a_restart_too() -> None:
    bench = standing(aloft())
    taken_by_b(bench)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.STOP))
    bench.log.clear()
    bench.restart()
    bench.run(20.0)
    assert bench.flights() == []


def test_on_the_ground_nothing_is_told_to_go_on() -> None:
    bench = Bench()
    bench.alive = {A}
    bench.facts = (inside(A), outside(B))
    bench.restart(0.0, replace(HELD, phase=Phase.EMERGENCY, held_since=None, held_for=None, stands=True))
    bench.run(5.0)
    assert bench.flights() == []
    assert not bench.arbiter.snapshot().stands
    bench.armed = bench.flying = True
    bench.run(5.0)
    assert bench.flights() == []


def test_what_was_held_while_the_autopilot_was_not_heard_is_held_on() -> None:
    """The fault: that it was held was not known over the restart, so it was told to go on, towards the border."""
    bench = held()
    bench.autopilot, bench.facts = False, None
    bench.run(8.0)
    assert bench.arbiter.snapshot().held_for is Cause.COVERAGE_ENDS
    bench.restart()
    bench.run(2.0)
    bench.restart()
    bench.autopilot, bench.facts = True, (inside(A), outside(B))
    bench.run(5.0)
    assert GO_ON not in bench.flights()
    assert HOLD in bench.flights()


def test_what_its_commander_has_sent_on_meanwhile_is_not() -> None:
    bench = held()
    bench.autopilot, bench.facts = False, None
    bench.run(8.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    assert bench.arbiter.snapshot().held_for is None


def test_nor_what_he_sends_on_behind_the_restart_in_the_run_behind_that() -> None:
    bench = held().restart()
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    snapshot = bench.arbiter.snapshot()
    assert (snapshot.held_for, snapshot.held_since) == (None, None)
    bench.restart()
    bench.run(5.0)
    assert bench.flights() == []


def test_without_a_position_time_passes_behind_a_restart() -> None:
    """The fault: a moment that had passed was due for ever."""
    bench = held().restart()
    bench.facts = None
    bench.run(20.0)
    deadline = bench.arbiter.next_deadline()
    assert deadline is None or deadline > bench.now
    assert HOLD in bench.flights()


def test_what_the_guard_brings_home_is_not_held_any_more() -> None:
    """The fault: the next run held it against the commander's word, with no end ahead."""
    bench = held(Limits(hold_s=600.0))
    facts, bench.facts, bench.autopilot = bench.facts, None, False
    bench.run(8.0)
    bench.facts, bench.autopilot, bench.mode, bench.motion = facts, True, RTL, MotionSeen(8.0, 0.0, 300.0)
    bench.run(5.0)
    assert bench.arbiter.snapshot().held_for is None
    bench.restart()
    bench.run(3.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
    bench.mode = AUTO
    bench.run(8.0)
    assert bench.flights() == []


def test_a_border_passed_before_there_was_a_position_is_passed() -> None:
    bench = held(Limits(hold_s=600.0))
    bench.mode, bench.motion = AUTO, MotionSeen(0.0, 0.0, 300.0)
    bench.run(1.0)
    bench.restart()
    bench.facts = None
    bench.run(1.2)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
    bench.run(0.6)
    ordered = bench.flights()
    bench.motion, bench.facts = MotionSeen(1.5, 0.0, 300.0), (inside(A, margin_m=25.0), outside(B))
    bench.run(8.0)
    bench.facts = (replace(ends(4.0), margin_m=7.0), outside(B))
    bench.run(2.0)
    assert bench.flights() == ordered


def test_what_waits_for_a_position_is_told_meanwhile() -> None:
    limits = Limits(policies={Cause.LINKS_WEAK: "hold"})
    bench = mission(limits)
    bench.mode, bench.motion, bench.facts = AUTO, MotionSeen(0.0, 0.0, 300.0), None
    bench.restart(snapshot=replace(HELD, held_for=Cause.LINKS_WEAK, stands=True))
    bench.run(20.0)
    assert any("no fresh position" in text for text in said(bench))


def test_what_was_held_is_known_before_the_first_heartbeat_and_while_a_mode_is_in_doubt() -> None:
    bench = held(Limits(hold_s=600.0))
    bench.mode, bench.motion = AUTO, MotionSeen(0.0, 0.0, 300.0)
    bench.run(1.0)
    bench.autopilot, bench.facts, bench.alive = False, None, set()
    bench.restart()
    bench.run(3.5)
    bench.restart()
    bench.alive, bench.autopilot, bench.facts = {A}, True, (inside(A), outside(B))
    bench.run(6.0)
    assert bench.flights() == [HOLD]
    bench.mode = ModeSeen(ModeClass.STOP, "BRAKE", radio=True)
    bench.run(0.5)
    assert bench.arbiter.snapshot().held_for is Cause.COVERAGE_ENDS


def test_a_hold_that_is_over_while_a_mode_is_in_doubt_is_none_in_the_next_run() -> None:
    bench = mission(Limits(policies={Cause.LINKS_WEAK: "hold", Cause.POSITION_STALE: "off"}))
    bench.mode, bench.motion, bench.facts = replace(AUTO, radio=True), MotionSeen(0.0, 0.0, 300.0), None
    bench.restart(snapshot=replace(HELD, held_for=Cause.LINKS_WEAK, stands=True))
    bench.run(1.0)
    bench.mode = ModeSeen(ModeClass.STOP, "BRAKE", radio=True)
    bench.run(0.5)
    assert bench.arbiter.snapshot().held_for is Cause.LINKS_WEAK
    bench.give(ConditionsSeen(off_route=True))
    assert bench.arbiter.snapshot().held_for is None

# SPDX-License-Identifier: GPL-3.0-or-later

"""What is different for an aircraft with wings: it holds by circling, and is watched by its modes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.events import Fly, ModeSeen, ModeSourceSeen, MotionSeen
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Reason, ZoneFact
from mavproxy_handover.core.safety.command_verification import Seen
from mavproxy_handover.vehicle.profiles import PLANE, PROFILES, QUADPLANE, Profile
from tests.core.bench import A, B, Bench, inside, outside
from tests.core.safety.test_command_verification import CONTINUE, HOLD, LAND, RETURN, Watched
from tests.core.safety.test_conditions import ends, mission
from tests.core.safety.test_decision_executor import said, taken_by_b

OBEYED, AGAIN, UNABLE = Seen.OBEYED, Seen.AGAIN, Seen.UNABLE
AUTO, LOITER, RTL = (
    ModeSeen(ModeClass.MISSION, "AUTO"),
    ModeSeen(ModeClass.STOP, "LOITER"),
    ModeSeen(ModeClass.RETURN, "RTL"),
)
CIRCLE = Fly(FlightAction.HOLD, Reason.COVERAGE_ENDS)
GO_ON = Fly(FlightAction.CONTINUE, Reason.NONE)
HOME = Fly(FlightAction.RETURN, Reason.COVERAGE_ENDS)
WINGED = (PLANE, QUADPLANE)


def winged(kind: Profile = QUADPLANE, flown: ModeClass = ModeClass.MISSION, speed_mps: float = 20.0) -> Watched:
    watched = Watched(flown, speed_mps)
    watched.supervision.handling = kind.handling
    return watched


def flying(circles_s: float = 8.0, circle_m: float = 90.0) -> Bench:
    """A quadplane over GCSA's zone on its mission, nobody but GCSA there."""
    bench = mission()
    bench.handling, bench.circles_s, bench.circle_m = QUADPLANE.handling, circles_s, circle_m
    bench.mode, bench.motion = AUTO, MotionSeen(20.0, 0.0, 900.0)
    bench.run(1.0)
    bench.log.clear()
    return bench


# ---- what shows ---------------------------------------------------------------------------------------------------


def test_each_profile_says_of_each_order_how_it_shows() -> None:
    orders = {HOLD, CONTINUE, RETURN, LAND}
    assert all(set(profile.handling.shows) == orders for profile in PROFILES)


@pytest.mark.parametrize("kind", WINGED)
def test_to_hold_shows_by_the_mode_however_fast_it_flies(kind: Profile) -> None:
    watched = winged(kind).order(HOLD)
    assert watched.look() is None
    watched.flies(ModeClass.STOP)
    assert watched.look(1.0) is OBEYED
    assert watched.look(600.0) is None
    assert watched.supervision.stands


@pytest.mark.parametrize("kind", WINGED)
def test_what_does_not_circle_is_told_once_more_and_then_cannot_hold(kind: Profile) -> None:
    watched = winged(kind, speed_mps=0.2).order(HOLD)
    assert watched.look(5.9) is None
    assert watched.look(0.1) is AGAIN
    assert watched.look(6.0) is UNABLE
    assert watched.supervision.unable == {HOLD}


@pytest.mark.parametrize("back", [ModeClass.MISSION, ModeClass.GUIDED])
@pytest.mark.parametrize("kind", WINGED)
def test_to_go_on_shows_by_the_mode_and_is_commanded_without_end(kind: Profile, back: ModeClass) -> None:
    watched = winged(kind).order(HOLD)
    watched.flies(ModeClass.STOP)
    assert watched.look(1.0) is OBEYED
    watched.supervision.go_on(watched.now)
    assert watched.look(5.9) is None
    for _ in range(5):
        assert watched.look(6.0) is AGAIN
    watched.flies(back)
    assert watched.look(0.5) is OBEYED
    assert (watched.supervision.order, watched.supervision.stands) == (None, False)


@pytest.mark.parametrize("kind", WINGED)
def test_it_circles_at_the_place_of_its_return_and_that_is_no_hanging(kind: Profile) -> None:
    watched = winged(kind, ModeClass.RETURN).order(RETURN)
    watched.moves(20.0, 0.0, 250.0)
    assert watched.look() is OBEYED
    for _ in range(10):
        watched.moves(20.0, 0.0, 250.0)
        assert watched.look(10.0) is None


@pytest.mark.parametrize("kind", WINGED)
def test_what_gets_no_nearer_farther_away_hangs(kind: Profile) -> None:
    watched = winged(kind, ModeClass.RETURN).order(RETURN)
    watched.moves(20.0, 0.0, 251.0)
    assert watched.look() is OBEYED
    watched.moves(20.0, 0.0, 251.0)
    assert watched.look(29.9) is None
    assert watched.look(0.1) is UNABLE


def test_what_hovers_lands_like_a_copter() -> None:
    watched = winged(QUADPLANE, ModeClass.RETURN).order(LAND)
    assert watched.look(6.0) is AGAIN
    watched.flies(ModeClass.LAND)
    watched.moves(1.0, -0.5)
    assert watched.look(1.0) is OBEYED


@pytest.mark.parametrize("flown", [ModeClass.LAND, ModeClass.MISSION, ModeClass.RETURN])
def test_what_cannot_hover_flies_its_landing_sequence_in_whatever_mode_has_it(flown: ModeClass) -> None:
    watched = winged(PLANE, flown).order(LAND)
    assert watched.look() is OBEYED
    assert watched.look(300.0) is None


def test_what_cannot_hover_and_circles_does_not_land() -> None:
    watched = winged(PLANE, ModeClass.STOP).order(LAND)
    assert watched.look(5.9) is None
    assert watched.look(0.1) is AGAIN


# ---- where it is held ---------------------------------------------------------------------------------------------


def near(margin_m: float, exit_s: float | None) -> ZoneFact:
    """GCSA's zone, that far from its border and left in so many seconds."""
    return replace(ends(60.0), margin_m=margin_m, exit_s=exit_s, ends_s=exit_s)


def test_it_is_told_to_circle_as_much_earlier_as_its_circle_reaches_ahead() -> None:
    bench = flying()
    bench.position(ends(8.1), outside(B))
    assert bench.flights() == []
    bench.position(ends(8.0), outside(B))
    assert bench.flights() == [CIRCLE]


def test_one_that_is_slow_to_the_border_keeps_to_the_time_of_the_limits() -> None:
    bench = flying(circles_s=2.0)
    bench.position(ends(5.1), outside(B))
    assert bench.flights() == []
    bench.position(ends(5.0), outside(B))
    assert bench.flights() == [CIRCLE]


def test_beside_a_border_that_its_circle_would_cross_it_is_held_before_that() -> None:
    bench = flying()
    bench.position(near(90.0, 30.0), outside(B))
    assert bench.flights() == []
    bench.position(near(89.9, 30.0), outside(B))
    assert bench.flights() == [CIRCLE]


def test_a_border_beside_a_way_that_stays_inside_holds_nobody() -> None:
    bench = flying()
    bench.position(near(20.0, None), outside(B))
    bench.run(10.0)
    assert bench.flights() == []


def test_where_a_station_could_take_it_nobody_is_held() -> None:
    bench = flying()
    bench.alive = {A, B}
    bench.run(2.0)
    bench.position(replace(ends(7.0, B), beyond=frozenset({B})), inside(B))
    assert CIRCLE not in bench.flights()


def test_it_circles_until_its_time_is_over_and_comes_home() -> None:
    bench = flying()
    bench.position(ends(8.0), outside(B))
    bench.mode = LOITER
    bench.run(59.0)
    assert bench.flights() == [CIRCLE]
    bench.run(2.0)
    assert bench.flights() == [CIRCLE, HOME]


@pytest.mark.parametrize("radio", [False, True], ids=["no radio", "a pilot could steer"])
def test_a_circle_and_its_end_that_were_commanded_are_nobody_elses(radio: bool) -> None:
    bench = flying()
    bench.mode = replace(AUTO, radio=radio)
    bench.run(1.0)
    bench.position(ends(8.0), outside(B))
    bench.mode = replace(LOITER, radio=radio)
    bench.run(3.0)
    bench.facts = (inside(A), inside(B))
    bench.run(1.0)
    taken_by_b(bench)
    assert bench.flights() == [CIRCLE, GO_ON]
    bench.mode = replace(AUTO, radio=radio)
    bench.run(10.0)
    assert bench.flights() == [CIRCLE, GO_ON]
    assert [record.text for record in bench.records("helm")] == []
    assert not [text for text in said(bench) if text.startswith("PILOT")]


def test_what_its_commander_has_circle_is_not_told_to_go_on() -> None:
    """He asks for the mode that it circles in already: that is his word now."""
    bench = flying()
    bench.position(ends(8.0), outside(B))
    bench.mode = LOITER
    bench.run(3.0)
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.STOP))
    assert not bench.arbiter.snapshot().stands
    bench.run(20.0)
    assert bench.flights() == [CIRCLE]

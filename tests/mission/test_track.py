# SPDX-License-Identifier: GPL-3.0-or-later

"""Which leg is flown, and where the aircraft is with respect to it: legs by hand, and whole flights."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavproxy_handover.core.safety.route import TrackFact
from mavproxy_handover.mission import Circle, Zone, ZoneFinder
from mavproxy_handover.mission.geodesy import bearing_deg, offset
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.path import path_of
from mavproxy_handover.mission.plan import Home, Route
from mavproxy_handover.mission.route_simulation import legs_of, simulate_legs
from mavproxy_handover.mission.track import Motion, RouteTracker
from mavproxy_handover.mission.wings import Air
from mavproxy_handover.vehicle.profiles import QUADPLANE

HOME = (52.679, 5.924)
TAKEOFF, WAYPOINT, SPLINE, TURNS, TIME, DELAY, PLACE, LAND, RTL, SPEED = 22, 16, 82, 18, 19, 93, 94, 21, 20, 178
NOWHERE = (0.0, 0.0)


def at(east_m: float, north_m: float) -> tuple[float, float]:
    return offset(*HOME, east_m, north_m)


def route(*items: tuple[int, tuple[float, float] | None]) -> Route:
    """A take-off, then these commands, each with metres east and north of home, None for no place."""
    made = [MissionItem(1, TAKEOFF, 3, 0, 0, 0, 0, *HOME, 30.0)]
    for seq, (command, place) in enumerate(items, 2):
        lat, lon = NOWHERE if place is None else at(*place)
        made.append(MissionItem(seq, command, 3, 0, 0, 0, 0, lat, lon, 30.0))
    return Route(Home(*HOME, 0.0), tuple(made))


#: item 2 is 1000 m north of home, item 3 from there 1000 m east, item 4 back at home: a landing
TRIANGLE = route((WAYPOINT, (0, 1000)), (WAYPOINT, (1000, 1000)), (LAND, (0, 0)))


class Flight:
    """An aircraft that is put where the test wants it, a second at a time."""

    def __init__(self, flown: Route) -> None:
        self.tracker = RouteTracker(flown)
        self.now = 100.0

    def fly(
        self, waypoint: int, east_m: float, north_m: float, course: float = 0.0, speed: float = 10.0, auto: bool = True
    ) -> TrackFact | None:
        self.now += 1.0
        return self.tracker.follow(Motion(*at(east_m, north_m), course, speed, waypoint, auto), self.now)

    def up(self, east_m: float = 0.0, north_m: float = 0.0) -> Flight:
        """Take off there."""
        assert self.fly(1, east_m, north_m, speed=0.0) is None
        return self


def near(fact: TrackFact | None, across: float, course: float | None, along: float, length: float, seq: int) -> None:
    assert fact is not None
    found = (fact.cross_track_m, fact.along_m, fact.length_m)
    assert found == pytest.approx((across, along, length), abs=0.2)
    assert fact.seq == seq
    assert fact.course_off_deg == (None if course is None else pytest.approx(course, abs=0.1))


# ---- on a leg -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("east_m", "north_m", "course", "speed", "across", "off"),
    [
        pytest.param(0, 500, 0, 10, 0, 0, id="on it"),
        pytest.param(25, 500, 0, 10, 25, 0, id="east of a leg to the north is right of it"),
        pytest.param(-25, 500, 0, 10, -25, 0, id="west is left"),
        pytest.param(0, 500, 90, 10, 0, 90, id="off to the right"),
        pytest.param(0, 500, 270, 10, 0, -90, id="off to the left"),
        pytest.param(0, 500, 180, 10, 0, -180, id="backwards"),
        pytest.param(25, 500, 90, 2.4, 25, None, id="too slow for a course"),
        pytest.param(25, 500, 90, 0, 25, None, id="a pause has a place and no course"),
        pytest.param(0, 29, 90, 10, 0, None, id="at the beginning it turns: no course"),
        pytest.param(0, 971, 90, 10, 0, None, id="and at the end"),
        pytest.param(0, 44, 90, 15, 0, None, id="for longer at a higher speed"),
        pytest.param(0, 46, 90, 15, 0, 90, id="but not for ever"),
        pytest.param(0, 1040, 0, 10, 40, None, id="beyond the end it is the distance from the end that counts"),
        pytest.param(-30, 1040, 0, 10, -50, None, id="in any direction"),
        pytest.param(0, -60, 180, 10, 60, None, id="and before the beginning the one from there"),
    ],
)
def test_a_leg_to_the_north(
    east_m: float, north_m: float, course: float, speed: float, across: float, off: float | None
) -> None:
    near(Flight(TRIANGLE).up().fly(2, east_m, north_m, course, speed), across, off, north_m, 1000, 2)


def test_the_first_leg_begins_where_the_aircraft_took_off() -> None:
    """40 m east of the home of the plan: nobody measured where it was to be put down."""
    flight = Flight(TRIANGLE).up(40)
    near(flight.fly(2, 40, 0, 0, 1), 0, None, 0, 1000.8, 2)
    near(flight.fly(2, 20, 500), 0, 2.3, 500.4, 1000.8, 2)


def test_legs_follow_one_another_and_a_corner_may_be_cut() -> None:
    """Told to go on 25 m before the corner, it is 25 m beside the next leg, and on the one behind."""
    flight = Flight(TRIANGLE).up()
    near(flight.fly(2, 0, 960), 0, 0, 960, 1000, 2)
    near(flight.fly(3, 0, 975), 0, None, 0, 1000, 3)
    near(flight.fly(3, 10, 988, 45), 10, None, 10, 1000, 3)
    near(flight.fly(3, 100, 960, 90), 40, 0, 100, 1000, 3)


def test_a_turn_that_is_missed_is_seen() -> None:
    """It goes on to the north: from the one leg's end and from the other leg it is equally far."""
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 990)
    near(flight.fly(3, 0, 1045, 0), -45, None, 0, 1000, 3)


def test_a_speed_change_in_between_is_no_item_that_is_flown() -> None:
    flight = Flight(route((WAYPOINT, (0, 1000)), (SPEED, None), (WAYPOINT, (1000, 1000)))).up()
    flight.fly(2, 0, 995)
    near(flight.fly(4, 500, 1010, 90), -10, 0, 500, 1000, 4)


# ---- where nothing is expected ------------------------------------------------------------------------------------


def test_in_another_mode_and_on_the_ground_there_is_no_leg() -> None:
    flight = Flight(TRIANGLE).up()
    assert flight.fly(2, 300, 500, auto=False) is None


@pytest.mark.parametrize("command", [DELAY, RTL])
def test_what_is_flown_to_no_place_of_the_route_has_no_leg(command: int) -> None:
    flight = Flight(route((WAYPOINT, (0, 1000)), (command, (1000, 1000)))).up()
    flight.fly(2, 0, 995)
    assert [flight.fly(3, 300, 700) for _ in range(20)] == [None] * 20


@pytest.mark.parametrize("command", [LAND, PLACE])
def test_a_leg_to_a_landing_ends_short_of_it_and_does_not_come_back(command: int) -> None:
    flight = Flight(route((WAYPOINT, (0, 1000)), (command, (1000, 1000)))).up()
    flight.fly(2, 0, 995)
    near(flight.fly(3, 900, 1000, 90), 0, 0, 900, 1000, 3)
    assert flight.fly(3, 980, 1000, 90, 8) is None
    assert flight.fly(3, 1060, 1050, 90, 3) is None
    assert flight.fly(3, 900, 1000, 90, 3) is None


def test_behind_a_landing_in_between_the_leg_begins_there() -> None:
    flight = Flight(route((WAYPOINT, (0, 1000)), (PLACE, (1000, 1000)), (WAYPOINT, (0, 0)))).up()
    flight.fly(2, 0, 995)
    flight.fly(3, 990, 1000, 90, 8)
    assert flight.fly(3, 940, 1000, 270, 3) is None  # a wind takes it along while it climbs
    near(flight.fly(4, 470, 500, 223.2), 0, 0, 686.2, 1372.4, 4)


def test_behind_a_spline_the_leg_begins_at_its_end() -> None:
    flight = Flight(route((SPLINE, (0, 1000)), (WAYPOINT, (1000, 1000)))).up()
    flight.fly(2, 100, 700)
    flight.fly(2, 0, 995)
    near(flight.fly(3, 500, 990, 90), 10, 0, 500, 1000, 3)


def test_an_item_that_nobody_knows_has_no_leg() -> None:
    flight = Flight(TRIANGLE).up()
    assert flight.fly(0, 0, 100) is None
    assert flight.fly(77, 0, 100) is None
    assert flight.fly(2, 0, 100) is None


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("field", ["lat_deg", "lon_deg", "course_deg", "speed_mps"])
def test_what_is_no_number_is_no_fact(field: str, value: float) -> None:
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 100)
    motion = replace(Motion(*at(0, 500), 0.0, 10.0, 2, True), **{field: value})
    assert flight.tracker.follow(motion, flight.now + 1) is None
    near(flight.fly(2, 5, 600), 5, 0, 600, 1000, 2)


# ---- legs that the route does not know ----------------------------------------------------------------------------


def test_auto_taken_up_again_flies_from_there_once_it_has_turned() -> None:
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 300)
    assert flight.fly(2, 200, 300, 90, auto=False) is None
    assert [flight.fly(2, 400 + 2 * n, 300 + 8 * n) for n in range(5)] == [None] * 5
    near(flight.fly(2, 400, 400, 326.3), 0, None, 0, 721.1, 2)
    near(flight.fly(2, 200, 700, 326.3), 0, 0, 360.6, 721.1, 2)
    near(flight.fly(2, 240, 700, 326.3), 33.3, 0, 338.4, 721.1, 2)


def test_behind_such_a_leg_the_next_one_is_of_the_route() -> None:
    flight = Flight(TRIANGLE).up()
    for n in range(7):
        flight.fly(2, 400 - n, 300 + n, auto=n > 0)
    flight.fly(2, 3, 995, 330)
    near(flight.fly(3, 500, 1000, 90), 0, 0, 500, 1000, 3)


def test_an_item_that_is_skipped_makes_a_leg_from_there() -> None:
    """300 m before waypoint 2 somebody chooses 3: straight there is 250 m off the leg from 2 to 3."""
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 700)
    assert [flight.fly(3, 5 * n, 710 + 2 * n) for n in range(5)] == [None] * 5
    near(flight.fly(3, 0, 700, 73.3), 0, None, 0, 1044.0, 3)
    near(flight.fly(3, 500, 850, 73.3), 0, 0, 522.0, 1044.0, 3)


def test_what_was_not_seen_for_a_while_was_flown_as_planned() -> None:
    """The last that was heard is 100 m before the corner, the next 14 s later, 40 m behind it."""
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 900)
    flight.now += 13.0
    near(flight.fly(3, 40, 1002, 90), -2, 0, 40, 1000, 3)


def test_a_gust_that_stops_it_behind_a_waypoint_makes_no_leg_of_its_own() -> None:
    """It was 35 m before the corner at 10 m/s when it was heard last, and is slow now, being blown off the next leg."""
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 965)
    near(flight.fly(3, 5, 990, 180, 3), 5, None, 5, 1000, 3)
    near(flight.fly(3, 60, 940, 180, 4), 60, 90, 60, 1000, 3)


def test_an_item_out_of_turn_makes_a_leg_from_there() -> None:
    flight = Flight(TRIANGLE).up()
    flight.fly(2, 0, 995)
    flight.fly(3, 200, 1000)
    assert flight.fly(2, 210, 1000) is None


def curved(*items: MissionItem) -> Route:
    """A leg of 1000 m to the north, then these."""
    first = MissionItem(1, TAKEOFF, 3, 0, 0, 0, 0, *HOME, 30.0)
    return Route(Home(*HOME, 0.0), (first, MissionItem(2, WAYPOINT, 3, 0, 0, 0, 0, *at(0, 1000), 30.0), *items))


def flies(flown: Route, seq: int, past_m: float = 0.0) -> list[TrackFact | None]:
    """An aircraft that flies the legs to an item, beside them by so much on their right."""
    flight = Flight(flown).up()
    flight.fly(2, 0, 995)
    found = []
    for leg in (leg for leg in legs_of(flown) if leg.seq == seq):
        course = bearing_deg(*leg.start[:2], *leg.end[:2])
        spot = offset(
            *leg.at(0.5)[:2], past_m * math.cos(math.radians(course)), -past_m * math.sin(math.radians(course))
        )
        flight.now += 1.0
        motion = Motion(*spot, course, 10.0, seq, True)
        found.append(flight.tracker.follow(motion, flight.now))
    return found


SWING = curved(MissionItem(3, SPLINE, 3, 0, 0, 0, 0, *at(1000, 1000), 30.0))
AROUND = curved(MissionItem(3, TURNS, 3, 3, 0, 100, 0, *at(500, 1000), 30.0))


@pytest.mark.parametrize("flown", [SWING, AROUND], ids=["spline", "circle"])
def test_on_its_curve_an_aircraft_is_on_its_route(flown: Route) -> None:
    """The spline swings out 148 m beyond the straight line, the circle is 100 m beside its place."""
    facts = flies(flown, 3)
    assert len(facts) > 12
    assert all(fact is not None and abs(fact.cross_track_m) < 0.5 and fact.course_off_deg is None for fact in facts)


@pytest.mark.parametrize("flown", [SWING, AROUND], ids=["spline", "circle"])
def test_beside_its_curve_it_is_off_its_route(flown: Route) -> None:
    facts = [fact for fact in flies(flown, 3, 40.0)[2:-2] if fact is not None]
    assert sum(abs(fact.cross_track_m) > 35.0 for fact in facts) > 0.8 * len(facts)


@pytest.mark.parametrize("flown", [SWING, AROUND], ids=["spline", "circle"])
def test_a_curve_that_is_taken_up_elsewhere_is_not_known(flown: Route) -> None:
    flight = Flight(flown).up()
    flight.fly(2, 300, 500, auto=False)
    assert [flight.fly(3, 300 + 10 * n, 700) for n in range(20)] == [None] * 20


def test_behind_a_circle_the_leg_begins_where_it_is_left() -> None:
    flight = Flight(route((TURNS, (0, 1000)), (WAYPOINT, (1000, 1000)))).up()
    flight.fly(2, 80, 1000)
    assert flight.fly(3, 0, 1080) is None
    for _ in range(5):
        fact = flight.fly(3, 40, 1078)
    near(fact, 0, None, 0, 963.2, 3)


# ---- the earth ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", [(0.0, 10.0), (-16.84, 179.999), (70.0, -30.0), (-52.0, -180.0)])
def test_the_same_anywhere(place: tuple[float, float]) -> None:
    end = offset(*place, 800, 600)
    items = (MissionItem(1, TAKEOFF, 3, 0, 0, 0, 0, *place, 30), MissionItem(2, WAYPOINT, 3, 0, 0, 0, 0, *end, 30))
    tracker = RouteTracker(Route(Home(*place, 0.0), items))
    tracker.follow(Motion(*place, 0, 0, 1, True), 1.0)
    tracker.follow(Motion(*place, 0, 0, 2, True), 2.0)
    beside = offset(*place, 400 + 12, 300 - 16)  # 20 m to the right of its middle
    near(tracker.follow(Motion(*beside, 53.13, 10, 2, True), 3.0), 20, 0, 500, 1000, 2)


# ---- anything ------------------------------------------------------------------------------------------------------


@settings(max_examples=200)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 5),
            st.floats(-3000, 3000),
            st.floats(-3000, 3000),
            st.floats(0, 360),
            st.floats(0, 40),
            st.booleans(),
        )
    )
)
def test_whatever_is_flown_the_facts_are_sound(moves: list[tuple[int, float, float, float, float, bool]]) -> None:
    flight = Flight(TRIANGLE)
    for move in moves:
        fact = flight.fly(*move)
        if fact is None:
            continue
        assert move[5]
        assert fact.seq == move[0]
        assert math.isfinite(fact.cross_track_m)
        assert math.isfinite(fact.along_m)
        assert fact.length_m >= 0
        assert fact.course_off_deg is None or -180.0 <= fact.course_off_deg <= 180.0


# --- wings ---

#: up, 3 km east, 2 km north, a circle 2 km west of that, and down 2 km south of that
WINGED = Route(
    Home(*HOME, 0.0),
    (
        MissionItem(1, 84, 3, 0, 0, 0, 0, *HOME, 60.0),
        MissionItem(2, WAYPOINT, 3, 0, 0, 0, 0, *at(3000, 0), 100.0),
        MissionItem(3, WAYPOINT, 3, 0, 0, 0, 0, *at(3000, 2000), 100.0),
        MissionItem(4, TURNS, 3, 1, 0, 100, 0, *at(1000, 2000), 100.0),
        MissionItem(5, 85, 3, 0, 0, 0, 0, *at(1000, 0), 0.0),
    ),
    profile=QUADPLANE,
)


def test_wings_that_fly_their_path_are_on_their_route_all_the_way():
    """Its turns of 150 m and its circle are beside the legs, and nothing is expected of them there."""
    zone = Zone(251, "A", Circle(*HOME, 20_000.0))
    samples = simulate_legs(path_of(WINGED, Air(22.0, None, 5.0)).legs, ZoneFinder((zone,)), 251).samples
    flight, facts = RouteTracker(WINGED), []
    for here, ahead in pairwise(samples):
        if here.alt_m < 59.0 or here.time_s == ahead.time_s:
            continue
        course = bearing_deg(here.lat_deg, here.lon_deg, ahead.lat_deg, ahead.lon_deg)
        fact = flight.follow(Motion(here.lat_deg, here.lon_deg, course, 27.0, ahead.seq, True), ahead.time_s)
        facts += [fact] if fact is not None else []
    assert {fact.seq for fact in facts} >= {2, 3, 4}
    assert len(facts) > 400
    assert max(abs(fact.cross_track_m) for fact in facts) < 9.0, "the last of a turn"


def test_wings_have_time_to_come_to_their_first_leg_behind_a_take_off():
    """Flown: a transition that left the line by 39 m was off route for 45 s."""
    flight = Flight(WINGED).up()
    assert flight.fly(2, 400, -60, course=120.0, speed=20.0) is None
    assert flight.fly(2, 800, -16, course=80.0, speed=20.0) is None
    fact = flight.fly(2, 1000, -14, course=80.0, speed=20.0)
    assert fact is not None
    assert fact.cross_track_m == pytest.approx(14.0, abs=0.5)
    left = flight.fly(2, 1400, -60, course=120.0, speed=20.0)
    assert left is not None, "once there it has to stay there"
    assert left.cross_track_m == pytest.approx(60.0, abs=0.5)


def test_and_no_more_of_it_than_that():
    flight = Flight(WINGED).up()
    assert flight.fly(2, 400, -60, course=90.0, speed=20.0) is None
    flight.now += 88.0
    assert flight.fly(2, 1000, -60, course=90.0, speed=20.0) is None
    assert flight.fly(2, 1020, -60, course=90.0, speed=20.0) is not None


def test_wings_that_fly_away_from_a_turn_are_off_their_route_beyond_its_reach():
    """At 20 m/s that is 81 m of turn distance and three radii of 41 m around the waypoint: 204 m."""
    flight = Flight(WINGED).up()
    assert flight.fly(2, 1000, 0, course=90.0, speed=20.0) is not None
    assert flight.fly(2, 2910, 0, course=90.0, speed=20.0) is None, "it may turn already"
    assert flight.fly(3, 2930, 0, course=90.0, speed=20.0) is None
    assert flight.fly(3, 3190, 0, course=90.0, speed=20.0) is None
    fact = flight.fly(3, 3250, 0, course=90.0, speed=20.0)
    assert fact is not None
    assert fact.cross_track_m == pytest.approx(250.0, abs=1.0)

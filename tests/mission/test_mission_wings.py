# SPDX-License-Identifier: GPL-3.0-or-later

"""The path of an aircraft with wings: turns, circles and wind, on paper; and what the check finds of it.

On the equator 0.001 degrees of longitude are 111.3195 m, 0.001 degrees of latitude 110.5743 m. At 20 m/s and 45 degrees
of bank a turn has a radius of 400 / 9.80665 = 40.789 m.
"""

from __future__ import annotations

import math
import time
from itertools import pairwise

import pytest

from mavproxy_handover.cli.check import main
from mavproxy_handover.core.safety.energy import Piece, Wind, landing
from mavproxy_handover.mission import MissionError, MissionItem, RallyPoint, load
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.check_text import report_text
from mavproxy_handover.mission.energy import places_of, way_back
from mavproxy_handover.mission.geodesy import east_north_m
from mavproxy_handover.mission.path import path_of
from mavproxy_handover.mission.plan import Home, Route
from mavproxy_handover.mission.route_simulation import hovers_at, landing_sequences, legs_of
from mavproxy_handover.mission.wings import Air, Wings, true_airspeed_factor, turn_end_m
from mavproxy_handover.vehicle.profiles import PLANE, QUADPLANE

CALM = Air(20.0)


def near(value, tolerance=0.06):
    return pytest.approx(value, abs=tolerance)


def item(seq, command, north=0.0, east=0.0, alt=60.0, params=(0, 0, 0, 0)):
    """`north`, `east`: thousandths of a degree from home at 0, 10."""
    return MissionItem(seq, command, 3, *map(float, params), north / 1000, 10.0 + east / 1000, alt)


def route(*items, profile=QUADPLANE, **more):
    return Route(Home(0.0, 10.0, 0.0), items, profile=profile, **more)


#: up, east to 10.02, north to 0.02, down there
CORNER = route(item(1, 84), item(2, 16, 0, 20), item(3, 16, 20, 20), item(4, 85, 20, 20, 0.0))


def from_corner(path, number):
    """The start of a leg, metres east and north of the corner of CORNER."""
    return east_north_m(0.0, 10.02, *path.legs[number].start[:2])


# --- formulas ---


def test_radius_of_a_turn():
    """Without sideslip it is v^2 / (g tan bank), with sideslip it is wider by its part."""
    assert Wings(turn_part=1.0).turn_radius_m(20.0) == near(40.789, 1e-3)
    assert Wings(turn_part=1.0, bank_deg=30.0).turn_radius_m(20.0) == near(70.648, 1e-3)
    assert Wings(turn_part=0.5).turn_radius_m(20.0) == near(81.577, 1e-3)


def test_a_turn_begins_at_the_smaller_of_wp_radius_and_what_the_navigation_looks_ahead():
    """17 s x 0.75 / pi are 4.058 s of flight: 81.2 m at 20 m/s, 48.7 m at 12 m/s; WP_RADIUS is 90 m."""
    wings = Wings()
    assert [wings.turn_distance_m(v, 90.0) for v in (12.0, 20.0, 30.0)] == [near(48.70), near(81.17), 90.0]
    assert wings.turn_distance_m(20.0, 30.0) == near(27.06)
    assert wings.turn_distance_m(20.0, 170.0) == near(81.17), "no more than for a right angle"


def test_a_circle_is_never_narrower_than_a_turn():
    wings = Wings(circle_m=60.0, turn_part=1.0)
    assert [wings.circle_radius_m(wanted, 20.0) for wanted in (0.0, 100.0, -100.0, 10.0)] == [
        60.0,
        100.0,
        100.0,
        near(40.789, 1e-3),
    ]


def test_where_a_turn_ends_on_the_next_leg():
    """Begun early, as far behind the corner as it began before. Begun late, it swings back to the leg: from 20 m before
    a right angle with 40 m it comes 20 m outside; half of that is turned away, half turned back."""
    assert turn_end_m(90.0, 80.0, 40.0) == 80.0
    assert turn_end_m(90.0, 20.0, 40.0) == near(40.0 + 2 * 40.0 * math.sin(math.acos(0.75)), 1e-6)
    assert turn_end_m(30.0, -10.0, 40.0) > 0.0


def test_an_airspeed_is_faster_higher_up():
    """Standard atmosphere: density 1.225 kg/m^3 at the sea, 1.112 at 1000 m, 0.7361 at 5000 m."""
    assert true_airspeed_factor(0.0) == 1.0
    assert true_airspeed_factor(1000.0) == near((1.225 / 1.112) ** 0.5, 1e-3)
    assert true_airspeed_factor(5000.0) == near((1.225 / 0.7361) ** 0.5, 1e-3)


def test_ground_speed_in_the_wind():
    west = Air(20.0, Wind(10.0, 270.0))
    assert [west.ground_mps(bearing) for bearing in (90.0, 270.0)] == [near(30.0), near(10.0)]
    assert west.ground_mps(0.0) == near(17.3205, 1e-3)
    assert Air(20.0, None, 5.0).ground_mps(123.0) == 25.0, "not known: from behind wherever it flies"
    assert not Air(20.0, Wind(25.0, 90.0)).flies(90.0)
    assert not Air(20.0, Wind(25.0, 0.0)).flies(90.0), "it is blown aside"


# --- the path ---


def test_a_quadplane_rises_flies_its_turn_and_comes_down():
    path = path_of(CORNER, CALM)
    # 60 m at 2.5 m/s; 50 m at 1.5 m/s, 10 m at 0.5 m/s
    assert path.legs[0].duration_s == 24.0
    assert [leg.duration_s for leg in path.legs[-2:]] == [near(33.333), 20.0]
    assert path.legs[-1].end == (0.02, 10.02, 0.0)
    (turn,) = path.turns
    assert (turn.seq, turn.angle_deg) == (2, near(90.0))
    # told 81.4 m before the waypoint, which is 2226.39 m away, within a step of 2 m
    assert turn.begins_m == near(2226.39 - 81.4, 2.1)
    assert path.tight == path.unflown == ()


def test_a_right_angle_is_flown_past_its_corner_and_comes_outside_the_next_leg():
    """Flown so on ArduPlane at 22 m/s: turned 91 m before it, 18 m outside. A turn without sideslip stays nearer."""
    (turn,) = path_of(CORNER, CALM).turns
    (narrow,) = path_of(CORNER, CALM, sideslip=False).turns
    assert 10.0 < turn.outside_m < 25.0
    assert narrow.outside_m < turn.outside_m - 5.0


def test_the_next_item_is_flown_to_from_where_the_turn_begins():
    path = path_of(CORNER, CALM)
    seqs = [leg.seq for leg in path.legs]
    assert seqs == sorted(seqs)
    first = seqs.index(3)
    assert from_corner(path, first) == (near(-81.4, 2.1), near(0.0, 0.5))


def test_the_path_ends_where_its_lines_end_and_has_no_gaps():
    path = path_of(CORNER, CALM)
    assert all(before.end == after.start for before, after in pairwise(path.legs))
    assert all(leg.duration_s > 0.0 for leg in path.legs)


def test_the_same_route_gives_the_same_path():
    before = path_of(CORNER, CALM)
    path_of.cache_clear()
    assert path_of(CORNER, CALM) == before


def test_five_hundred_items_are_walked_in_four_seconds_of_computing():
    """It takes 0.7 s on a usual computer."""
    places = (item(n, 16, 2 * (n // 2), 10 if (n // 2 + n) % 2 else 20) for n in range(2, 501))
    began = time.process_time()
    path = path_of(route(item(1, 84), *places), Air(22.0))
    assert path.legs[-1].seq == 500
    assert time.process_time() - began < 4.0


def test_a_tail_wind_makes_less_time_and_wider_turns():
    """22 m/s and 8 m/s from behind. Flown so on ArduPlane the turn came 30.6 m outside: between the two walks."""
    air = Air(22.0, Wind(8.0, 270.0))
    path, narrow = path_of(CORNER, air), path_of(CORNER, air, sideslip=False)
    assert sum(leg.duration_s for leg in path.legs if leg.seq == 2) == near((2226.39 - 90.5) / 30.06, 0.15)
    assert narrow.turns[0].outside_m < 30.6 < path.turns[0].outside_m
    assert path.turns[0].outside_m > path_of(CORNER, Air(22.0)).turns[0].outside_m + 15.0


def test_the_distances_of_an_item_replace_wp_radius():
    def turn(params):
        (found,) = path_of(route(item(1, 84), item(2, 16, 0, 20, params=params), item(3, 16, 20, 20)), CALM).turns
        return found

    assert turn((0, 10.9, 0, 0)).begins_m == near(2226.39 - 10.0, 2.1), "in whole metres"
    assert turn((0, 10.9, 0, 0)).outside_m == near(60.9, 12.0), (
        "the radius of a turn with its sideslip, and what banking takes"
    )
    assert turn((0, 0, 30, 0)).begins_m == near(2226.39 + 30.0, 2.1)
    assert turn((0, 0, 30, 0)).outside_m == near(turn((0, 10.9, 0, 0)).outside_m + 40.0, 4.0)


@pytest.mark.parametrize("about", [1.0, -1.0])
def test_a_turn_about_may_go_to_either_side(about):
    """On ArduPlane one of three went to the other side."""
    back = route(item(1, 84), item(2, 16, 0, 20), item(3, 16, 0, 2), item(4, 85, 0, 2, 0.0))
    path = path_of(back, CALM, about=about)
    norths = [east_north_m(0.0, 10.02, *leg.end[:2])[1] for leg in path.legs if leg.seq == 3]
    far = min(norths) if about > 0.0 else max(norths)
    assert -about * far == near(2.0 * 60.9, 25.0), "east, and by the south on to the west: to the right"
    assert path.turns[0].outside_m == near(2.0 * 60.9, 25.0)


def test_rounds_of_a_circle_and_on_to_where_it_is_left():
    """Ten turns of 100 m are 6.28 km. The second stands for the rest. Radii are those at the sea: 60 m up it is 0.6 m
    more."""
    path = path_of(
        route(item(1, 84), item(2, 18, 0, 20, params=(10, 0, 100, 0)), item(3, 16, 20, 20)), CALM, sideslip=False
    )
    (turn,) = path.turns
    assert (turn.circle, turn.radius_m) == (True, near(100.58, 0.1))
    # to the right from the west, and left to the north, where the course leads there within 10 degrees
    assert turn.ends_m - turn.begins_m == near(math.tau * 100.58 * 10.0, 100.0)
    assert max(leg.times for leg in path.legs) == 8
    flown_s = sum(leg.times * leg.duration_s for leg in path.legs if leg.seq == 2)
    assert flown_s == near((2226.39 + math.tau * 1005.8) / 20.06, 6.0)
    lines = [leg for leg in path.legs if leg.seq == 3]
    assert east_north_m(0.0, 10.02, *lines[-1].end[:2]) == (near(0.0, 1.0), near(2211.5, 5.0)), "from its middle"


def test_a_circle_with_slip_is_wider_than_its_item_says():
    """Flown so on ArduPlane: 118 m instead of 100 m at 23 m/s. Its guidance does not know of the sideslip."""

    def farthest_m(**options):
        path = path_of(
            route(item(1, 84), item(2, 18, 0, 20, params=(6, 0, 100, 0)), item(3, 16, 20, 20)), CALM, **options
        )
        return max(math.hypot(*east_north_m(0.0, 10.02, *leg.end[:2])) for leg in path.legs if leg.times > 1)

    assert farthest_m(sideslip=False) == near(100.6, 0.5)
    assert farthest_m() == near(114.0, 2.0)


def test_a_circle_that_is_left_by_its_tangent():
    """Parameter 4: the next line begins where the circle is left, so it is 100 m beside the middle there."""

    def first_m(xtrack):
        items = (
            item(1, 84),
            item(2, 18, 0, 20, params=(1, 0, 100, xtrack)),
            item(3, 16, 60, 20),
            item(4, 85, 60, 20, 0.0),
        )
        legs = [leg for leg in path_of(route(*items), CALM).legs if leg.seq == 3]
        places = [east_north_m(0.0, 10.02, *leg.start[:2]) for leg in legs]
        return min((abs(north - 1500.0), east) for east, north in places)[1]

    assert first_m(0) == near(0.0, 3.0)
    assert first_m(1) < -50.0


def test_a_circle_for_a_time_ends_after_it():
    def circled_s(seconds):
        items = (item(1, 84), item(2, 19, 0, 20, params=(seconds, 0, 0, 0)), item(3, 16, 20, 20))
        (turn,) = path_of(route(*items), CALM).turns
        return (turn.ends_m - turn.begins_m) / 20.06

    round_s = math.tau * 60.35 / 20.06
    assert 600.0 <= circled_s(600.0) <= 600.0 + round_s * 1.4
    assert circled_s(0.0) <= round_s * 1.4


def test_a_circle_to_a_height_that_the_aircraft_has_is_left_at_once():
    """Flown so on ArduPlane; a whole round was counted."""
    (turn,) = path_of(route(item(1, 84), item(2, 31, 0, 20), item(3, 16, 20, 20)), CALM).turns
    assert turn.ends_m - turn.begins_m < math.tau * 60.35


def test_a_circle_is_flown_to_the_side_of_its_sign():
    """From the west: to the right over the north. It swings out to the other side before, by 40 m."""

    def first_north(radius):
        path = path_of(route(item(1, 84), item(2, 18, 0, 20, params=(1, 0, radius, 0)), item(3, 16, 0, 60)), CALM)
        norths = [east_north_m(0.0, 10.02, *leg.end[:2])[1] for leg in path.legs]
        return next(north for north in norths if abs(north) > 60.0)

    assert first_north(100) > 0.0
    assert first_north(-100) < 0.0


def test_hovering_there_are_no_turns_and_five_metres_a_second():
    hover = MissionItem(2, 3000, 2, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    flown = route(item(1, 84), hover, item(3, 16, 0, 2), item(4, 16, 2, 2), item(5, 85, 2, 2, 0.0))
    assert [hovers_at(flown, seq) for seq in (1, 3, 5)] == [False, True, True]
    path = path_of(flown, Air(20.0, Wind(10.0, 270.0)))
    assert path.turns == ()
    assert path.legs[1].duration_s == near(222.64 / 5.0)


def test_a_circle_down_before_a_hovering_landing():
    (turn,) = path_of(route(item(1, 84), item(2, 85, 0, 20, 0.0, params=(1, 0, 0, 0))), CALM).turns
    assert (turn.circle, turn.radius_m) == (True, near(60.35, 0.1))


def test_a_climb_straight_on_goes_as_far_as_it_takes():
    """40 m at 2 m/s are 20 s: 400 m on, whatever place the item names."""
    legs = legs_of(route(item(1, 84), item(2, 16, 0, 20), item(3, 30, 9, 9, 100.0), item(4, 85, 0, 40, 0.0)), 20.0)
    assert east_north_m(0.0, 10.02, *legs[2].end[:2]) == (near(400.0), near(0.0))
    assert legs[2].end[2] == 100.0


# --- a plane ---

RUNWAY = (item(1, 22, 0, 3), item(2, 16, 0, 30), item(3, 189, 5, 8), item(4, 16, 5, 8), item(5, 21, 0, 0, 0.0))


def test_a_plane_climbs_along_its_runway_and_lands_on_a_straight_way_down():
    legs = legs_of(route(*RUNWAY, profile=PLANE), 20.0)
    assert [(leg.seq, leg.end) for leg in legs] == [
        (1, (0.0, 10.003, 60.0)),
        (2, (0.0, 10.03, 60.0)),
        (4, (0.005, 10.008, 60.0)),
        (5, (0.0, 10.0, 0.0)),
    ]
    assert [place.name for place in places_of(route(*RUNWAY, profile=PLANE))] == ["home"]


def test_a_return_of_a_plane_circles_at_its_place_and_flies_the_nearest_landing_sequence():
    home = MissionItem(3, 20, 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rest = (item(4, 189, 5, 8), item(5, 16, 5, 8), item(6, 21, 0, 0, 0.0))
    flown = route(*RUNWAY[:2], home, *rest, profile=PLANE)
    legs = legs_of(flown, 20.0)
    assert [leg.seq for leg in legs] == [1, 2, 3, 5, 6]
    assert legs[-1].end == (0.0, 10.0, 0.0)
    assert [turn.seq for turn in path_of(flown, CALM).turns if turn.circle] == [3]


#: metres and degrees from the middle of RUNWAY's landing to where its sequence begins: 890.56 m east, 552.87 m north
AWAY_M, TOWARDS_DEG = near(1048.2, 0.1), near(58.17, 0.05)


def test_a_return_of_a_plane_comes_down_by_its_landing_sequence():
    """The fault: a landing of rotors at the place was counted, which it has not, and the sequence was not."""
    (home,) = places_of(route(*RUNWAY, profile=PLANE), 20.0)
    assert home.down == (
        Piece(length_m=AWAY_M, bearing_deg=TOWARDS_DEG, speed_mps=20.0),
        Piece(length_m=AWAY_M, bearing_deg=near(238.17, 0.05), descent_m=60.0, speed_mps=20.0),
    )
    assert home.down_from_m == 60.0
    there, *down = way_back((0.0, 10.03, 60.0), home, 50.0, 20.0, climbs_on_way=True)
    # at 60 m, where the sequence begins, and not at the 50 m of the return
    assert there == Piece(length_m=near(3339.6, 0.1), bearing_deg=near(270.0), hold_s=30.0, speed_mps=20.0)
    assert tuple(down) == home.down


def test_what_comes_down_hovering_counts_no_landing_sequence():
    flown = route(*RUNWAY, profile=QUADPLANE)
    assert [place.down for place in places_of(flown, 20.0)] == [None]
    assert way_back((0.0, 10.03, 60.0), places_of(flown)[0], 50.0, 20.0, climbs_on_way=True)[-1] == landing(60.0)


def test_a_plane_without_a_landing_sequence_has_no_way_down_of_its_own():
    """A return of it circles for ever: the check says so, and START is refused."""
    flown = route(RUNWAY[0], RUNWAY[1], item(3, 21, 0, 0, 0.0), profile=PLANE)
    assert [place.down for place in places_of(flown)] == [None]


def test_each_place_has_the_sequence_that_begins_nearest_to_it():
    """AP_Mission's get_landing_sequence_start."""
    more = (item(6, 189, 0, 40), item(7, 16, 0, 40, 80.0), item(8, 21, 0, 50, 0.0))
    flown = route(*RUNWAY, *more, profile=PLANE, rally=(RallyPoint(0.0, 10.038, 60.0),))
    home, rally, end = places_of(flown, 20.0)
    assert (home.down_from_m, rally.down_from_m) == (60.0, 80.0)
    assert rally.down[0] == Piece(length_m=near(222.64), bearing_deg=near(90.0), speed_mps=20.0)
    assert end.down[-1].length_m == near(1113.2, 0.1)


def test_in_its_landing_sequence_a_plane_goes_straight_down_by_circling():
    """20 m at 2 m/s; and a speed that is set there is flown there."""
    slower = MissionItem(4, 178, 2, 0.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rest = (slower, item(5, 16, 5, 8, 60.0), item(6, 16, 5, 8, 40.0), item(7, 21, 0, 0, 0.0))
    (home,) = places_of(route(*RUNWAY[:3], *rest, profile=PLANE), 20.0)
    assert home.down == (
        Piece(length_m=AWAY_M, bearing_deg=TOWARDS_DEG, speed_mps=20.0),
        Piece(hold_s=10.0),
        Piece(length_m=AWAY_M, bearing_deg=near(238.17, 0.05), descent_m=40.0, speed_mps=15.0),
    )


def test_a_return_in_its_own_landing_sequence_ends_the_lines_of_a_route():
    """No package has one: it would be flown for ever."""
    back = MissionItem(5, 20, 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    flown = route(*RUNWAY[:4], back, item(6, 21, 0, 0, 0.0), profile=PLANE)
    assert landing_sequences(flown) == ()
    assert [leg.seq for leg in legs_of(flown, 20.0)] == [1, 2, 4, 5]


def test_wings_fly_at_the_airspeed_of_arduplane_where_nobody_names_one():
    assert legs_of(CORNER)[1].speed_mps == 12.0


# --- a mission of the small kind, with wings ---


@pytest.fixture
def winged(small):
    """Up at 10.001, east at 15 m/s to 10.03, down there; A covers up to 10.02, B from 10.01; 2 km north and south."""
    small.items[0]["command"], small.items[2]["command"] = 84, 85
    for number, east in ((1, 10.03), (2, 10.03)):
        small.items[number]["params"][5] = east
    small.plan["mission"]["vehicleType"] = 20
    small.toml = small.toml.replace("detector", 'aircraft = "quadplane"\ndetector', 1)
    small.toml += "[energy]\nheadwind_mps = 5\n"
    for feature, (west, east) in zip(small.zones["features"], ((9.98, 10.02), (10.01, 10.05)), strict=True):
        feature["geometry"]["coordinates"] = [small.box(west, east, -0.02, 0.02)]
    return small


def errors(small, **options):
    return [f.text for f in check(load(small.write()), **options).findings if f.severity is Severity.ERROR]


def test_the_time_in_a_region_is_that_of_the_fastest_ground_speed(winged):
    """1113.2 m at 15 m/s and 5 m/s of wind from behind; from ahead, where that is known, at 10 m/s."""
    package = load(winged.write())
    assert package.simulate().handovers[0].overlap_s == near(55.66, 0.4)
    assert package.simulate(Wind(5.0, 90.0)).handovers[0].overlap_s == near(111.32, 1.2)
    assert package.simulate(Wind(5.0, 270.0)).handovers[0].overlap_s == near(55.66, 0.4)


def test_the_table_tells_airspeed_wind_and_radius(winged):
    assert (
        "wings       quadplane, airspeed 15 m/s, wind up to 5 m/s from anywhere: up to 20 m/s over ground, "
        "turns of 61 m at 45 degrees"
    ) in _lines(winged, None)
    assert any("wind 8 m/s from 90 degrees: up to 23 m/s" in line for line in _lines(winged, Wind(8.0, 90.0)))


def _lines(small, wind):
    return report_text(check(load(small.write()), wind=wind)).splitlines()


def test_a_turn_whose_outside_leaves_coverage_is_found(winged):
    """North from 10.03 back to the west, with the border 20 m east of the waypoint: 150 degrees at 20 m/s come 36 m
    beyond it. (The lines of the route stay inside.)"""
    winged.items[2:2] = [winged.item(3, 16, 0.01, 10.0127, 30)]
    winged.items[1]["params"][1] = 5  # turned at 5 m from it
    for feature, (west, east) in zip(winged.zones["features"], ((9.98, 10.02), (10.01, 10.03018)), strict=True):
        feature["geometry"]["coordinates"] = [winged.box(west, east, -0.02, 0.02)]
    winged.items[3]["params"][4:6] = [0.01, 10.0]
    winged.toml = winged.toml.replace("expected_handovers = 1", "expected_handovers = 2")
    (text,) = [each for each in errors(winged) if "no coverage" in each]
    assert ", in the turn at item 2 (150 degrees, radius 61 m, " in text
    winged.items[1]["params"][1] = 0  # as WP_RADIUS has it
    assert [each for each in errors(winged) if "no coverage" in each] == []


def test_a_turn_about_that_leaves_coverage_to_its_other_side_is_found(winged):
    """East to 10.015 and back to the west: to the right by the south, else by the north."""
    winged.items[2:2] = [winged.item(3, 16, 0.0, 10.015, 30)]
    winged.items[1], winged.items[2] = winged.items[2], winged.items[1]
    winged.items[2]["params"][4:6] = [0.0, 10.005]
    assert [each for each in errors(winged) if "no coverage" in each] == []
    for feature, (west, east) in zip(winged.zones["features"], ((9.98, 10.02), (10.01, 10.05)), strict=True):
        feature["geometry"]["coordinates"] = [winged.box(west, east, -0.02, 0.0007)]
    right, left = [each for each in errors(winged) if "no coverage" in each]
    assert ", in the turn at item 3 (180 degrees, radius 61 m, 125 m outside)" in right, "from the west to the right"
    assert left.endswith("if it turns without sideslip, or to the other side")
    assert "on the way to 3" in left


def test_a_quadplane_that_slows_down_to_hover_needs_room_all_around(winged):
    winged.items[2:2] = [winged.item(3, 3000, 0.0, 0.0, 0), winged.item(4, 16, 0.0, 10.031, 30)]
    winged.items[2]["params"][:4] = [3, 0, 0, 0]
    assert [each for each in errors(winged) if "slows down to hover" in each] == []
    winged.zones["features"][1]["geometry"]["coordinates"] = [winged.box(10.01, 10.0302, -0.02, 0.02)]
    (text,) = [each for each in errors(winged) if "slows down to hover" in each]
    assert text.endswith("Not all of that is covered, and inside the geofence")


TIGHT = "the leg to item 3 is 111 m, the turns at its ends need 123 m: where it is flown is not known"


@pytest.fixture
def tight(winged):
    """61 m before each of two right angles are more than the 110.6 m between them."""
    winged.items[2:2] = [winged.item(3, 16, 0.001, 10.03, 30), winged.item(4, 16, 0.001, 10.01, 30)]
    winged.toml = winged.toml.replace("expected_handovers = 1", "expected_handovers = 3")
    return winged


def warnings(small):
    return [finding.text for finding in check(load(small.write())).findings if finding.severity is Severity.WARNING]


def test_a_leg_shorter_than_its_turns_need_is_told_where_all_around_it_is_covered(tight):
    """It is flown within 81.17 m and two radii of 60.88 m: 202.9 m."""
    assert errors(tight) == []
    assert f"{TIGHT}. All within 203 m of it is covered alike" in warnings(tight)


def test_a_leg_shorter_than_its_turns_need_has_the_time_of_a_circle_more(tight):
    """60.9 m at 15 m/s."""
    legs = load(tight.write()).path().legs
    assert [leg.seq for leg in legs if leg.hold_s > 0.0] == [3]
    assert max(leg.hold_s for leg in legs) == near(math.tau * 60.879 / 15.0, 0.5)


def test_a_leg_shorter_than_its_turns_need_near_a_border_is_an_error(tight):
    """The border is 167 m to the east of it."""
    tight.zones["features"][1]["geometry"]["coordinates"] = [tight.box(10.01, 10.0315, -0.02, 0.02)]
    assert errors(tight) == [TIGHT]


def test_a_leg_shorter_than_its_turns_need_near_the_geofence_is_an_error(tight):
    corners = [[-0.02, 9.98], [-0.02, 10.0315], [0.02, 10.0315], [0.02, 9.98]]
    tight.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": corners, "version": 1}]
    assert TIGHT in errors(tight)


def test_a_circle_that_leaves_the_zone_is_found(winged):
    winged.items[1]["command"] = 18
    winged.items[1]["params"][:3] = [1, 0, 400]
    assert errors(winged) == []
    winged.zones["features"][1]["geometry"]["coordinates"] = [winged.box(10.01, 10.05, -0.003, 0.02)]
    (text,) = errors(winged)
    assert text.startswith("no coverage for ")
    assert text.endswith(", in the circle of 405 m at item 2")


def test_a_wind_that_does_not_let_it_fly_is_found(winged):
    assert errors(winged, wind=Wind(16.0, 90.0)) == ["the wind does not let the way to item 2 be flown"]


def test_the_check_says_how_a_return_of_a_quadplane_ends(winged):
    texts = [finding.text for finding in check(load(winged.write())).findings]
    assert (
        "a return ends in a hovering landing at its place: it needs Q_RTL_MODE 1 to 3 (RTL alone circles for ever)"
    ) in texts


def test_a_rally_point_lower_than_the_return_is_said_to_be_flown_to_higher(winged):
    """The companion's list has it at RTL_ALTITUDE: ArduPlane flies to a rally point at the height that it has there."""
    winged.plan["rallyPoints"]["points"] = [[0.0, 10.001, 0.0], [0.0, 10.002, 100.0]]
    told = [f for f in check(load(winged.write())).findings if "RTL_ALTITUDE, not" in f.text]
    (found,) = told
    assert found.severity is Severity.INFO
    assert found.text == (
        "rally point 1 at 0.00000 N 10.00100 E is flown to at RTL_ALTITUDE, not at 0 m: "
        "wings have to stay up on the way"
    )


@pytest.fixture
def plane(winged):
    """The same with a plane: take-off to the east, and a landing that is approached from the west."""
    winged.items[0]["command"], winged.items[2]["command"] = 22, 21
    winged.items[0]["params"][5] = 10.003
    winged.plan["rallyPoints"]["points"] = [[0.0, 10.03, 60]]
    winged.plan["mission"]["vehicleType"] = 1
    winged.toml = winged.toml.replace('"quadplane"', '"plane"')
    return winged


def for_ever(place):
    sequence = "no landing sequence (DO_LAND_START to NAV_LAND) begins within 2000 m of it"
    return f"a return to {place} would circle for ever: {sequence}"


OPEN = (
    "item 1 (NAV_TAKEOFF) has no place: it climbs 300 m ahead, wherever the aircraft points, and turns there. Not all "
    "of that is covered alike, and inside the geofence. Give the item a place ahead on the runway"
)


def test_a_take_off_without_a_place_is_walked_towards_the_next_one_with_the_time_of_the_way_back(plane):
    """30 m at 2 m/s are 15 s: 225 m at 15 m/s, and twice that back if the aircraft stands the other way round."""
    plane.items[0]["params"][4:6] = [0, 0]
    first = load(plane.write()).path(Wind(0.0, 0.0)).legs[0]
    assert east_north_m(0.0, 10.001, *first.end[:2]) == (near(225.0), near(0.0))
    assert (first.end[2], first.hold_s) == (30.0, near(30.0))


def test_a_take_off_without_a_place_needs_room_in_every_direction(plane):
    plane.items[0]["params"][4:6] = [0, 0]
    assert OPEN not in errors(plane)
    plane.zones["features"][0]["geometry"]["coordinates"] = [plane.box(9.998, 10.02, -0.02, 0.02)]
    assert OPEN in errors(plane)


def test_a_return_that_would_circle_for_ever_is_an_error(plane):
    assert errors(plane) == [for_ever("home"), for_ever("rally 1")]


def test_a_landing_sequence_near_a_place_ends_its_return(plane):
    """At 10.02, 1113 m from rally point and landing, 2115 m from home."""
    plane.items[2:2] = [plane.item(3, 189, 0.0, 10.02, 30)]
    assert errors(plane) == [for_ever("home")]
    plane.items[2] = plane.item(3, 189, 0.0, 10.017, 30)
    assert errors(plane) == []
    texts = [finding.text for finding in check(load(plane.write())).findings]
    assert "a return to rally 1 ends in the landing sequence of item 3: it needs RTL_AUTOLAND 1 or 2" in texts


def test_a_return_that_would_begin_itself_again_is_one_line_and_no_traceback(plane, capsys):
    plane.items[2:2] = [plane.item(3, 189, 0.0, 10.017, 30), plane.item(4, 20, 0.0, 0.0, 0)]
    assert main([str(plane.write())]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("handover check: small.plan: item 3: DO_LAND_START leads to item 4, NAV_RETURN_TO_LAUNCH, ")


def test_a_circle_of_a_return_that_leaves_every_zone_is_a_warning(plane):
    plane.items[2:2] = [plane.item(3, 189, 0.0, 10.017, 30)]
    plane.plan["rallyPoints"]["points"] = [[0.0197, 10.017, 60]]
    found = [f.text for f in check(load(plane.write())).findings if f.severity is Severity.ERROR]
    assert len(found) == 1, "too far from the sequence as well"
    plane.items[2]["params"][4] = 0.0190
    found = [f.text for f in check(load(plane.write())).findings if f.severity is Severity.WARNING]
    assert found == ["the circle of 61 m around rally 1 leaves every zone: a return waits there"]


# --- [wings] ---


def test_wings_are_as_the_mission_says(winged):
    winged.toml += "[wings]\nbank_deg = 30\ncircle_m = 100\n"
    assert load(winged.write()).route.wings == Wings(bank_deg=30.0, waypoint_m=90.0, circle_m=100.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("bank_deg = 80", "mission.toml: [wings]: bank_deg is 80 (allowed: a number from 10 to 75)"),
        ("roll = 3", "mission.toml: [wings]: unknown key 'roll' (allowed: bank_deg, waypoint_m, circle_m, turn_part)"),
    ],
)
def test_wings_that_are_none_are_refused(winged, line, words):
    winged.toml += f"[wings]\n{line}\n"
    with pytest.raises(MissionError) as caught:
        load(winged.write())
    assert str(caught.value) == words


def test_a_copter_has_no_wings(small):
    small.toml += "[wings]\nbank_deg = 30\n"
    with pytest.raises(MissionError) as caught:
        load(small.write())
    assert (
        str(caught.value) == "mission.toml: [wings] does not go with aircraft 'copter' (allowed: with plane, quadplane)"
    )


def test_a_copter_flies_the_lines_of_its_route_and_no_wind_changes_that(small):
    package = load(small.write())
    assert package.path() is None
    assert package.legs() == legs_of(package.route, 5.0)
    assert package.simulate(Wind(9.0, 90.0)) == package.simulate()
    assert not any(line.startswith("wings") for line in _lines(small, Wind(4.0, 90.0)))


# --- the mission that ships ---


def test_ferry_passes_three_stations_with_two_handovers(missions):
    package = load(missions / "ferry")
    assert (package.profile, package.cruise_speed_mps) == (QUADPLANE, 22.0)
    walk = package.simulate()
    assert walk.commanders == (251, 252, 253)
    assert walk.gaps == ()
    assert 12_000.0 < walk.length_m < 12_600.0
    assert all(handover.overlap_s > 30.0 for handover in package.simulate(Wind(12.0, 270.0)).handovers)
    assert [item.command for item in package.route.items] == [84, 16, 16, 16, 16, 85]
    assert package.route.rally == (RallyPoint(52.696912, 5.36213, 60.0), RallyPoint(52.713986, 5.415407, 60.0))


def test_dike_returns_by_its_landing_sequence(missions):
    """From home 4.6 km, 241 s and more at 17 m/s over ground and 134 W: 9 Wh and more, where 4.84 Wh of rotors were
    counted."""
    package = load(missions / "dike")
    home, rally = places_of(package.route, package.cruise_speed_mps)
    model = package.energy.model(prior=PLANE.energy)
    lengths = [sum(piece.length_m for piece in place.down) for place in (home, rally)]
    needs = [model.need_wh(place.down) for place in (home, rally)]
    assert all(4000.0 < length < 4700.0 for length in lengths)
    assert needs == [near(length / 17.0 * 134.0 / 3600.0, 0.05) for length in lengths]

# SPDX-License-Identifier: GPL-3.0-or-later

"""The path of an aircraft with wings: turns, circles and wind, on paper; and what the check finds of it.

On the equator 0.001 degrees of longitude are 111.3195 m, 0.001 degrees of latitude 110.5743 m. At 20 m/s and 45 degrees
of bank a turn has a radius of 400 / 9.80665 = 40.789 m.
"""

from __future__ import annotations

import math

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
from mavproxy_handover.mission.wings import Air, Wings, bend
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
    assert Wings().turn_radius_m(20.0) == near(40.789, 1e-3)
    assert Wings(bank_deg=30.0).turn_radius_m(20.0) == near(70.648, 1e-3)


def test_a_turn_begins_at_the_smaller_of_wp_radius_and_what_the_navigation_looks_ahead():
    """17 s x 0.75 / pi are 4.058 s of flight: 81.2 m at 20 m/s, 48.7 m at 12 m/s; WP_RADIUS is 90 m."""
    wings = Wings()
    assert [wings.turn_distance_m(v, 90.0) for v in (12.0, 20.0, 30.0)] == [near(48.70), near(81.17), 90.0]
    assert wings.turn_distance_m(20.0, 30.0) == near(27.06)
    assert wings.turn_distance_m(20.0, 170.0) == near(81.17), "no more than for a right angle"


def test_a_circle_is_never_narrower_than_a_turn():
    wings = Wings(circle_m=60.0)
    assert [wings.circle_radius_m(wanted, 20.0) for wanted in (0.0, 100.0, -100.0, 10.0)] == [
        60.0,
        100.0,
        100.0,
        near(40.789, 1e-3),
    ]


def test_a_turn_that_begins_early_stays_inside_the_corner():
    """80 m before a right angle: an arc of 80 m."""
    made = bend(90.0, 80.0, 40.0)
    assert (made.radius_m, made.outside_m, made.after_m) == (near(80.0), 0.0, 80.0)
    assert made.places[0] == (-80.0, 0.0)
    assert made.places[-1] == (near(0.0), near(80.0))
    assert max(along for along, _beside in made.places) <= 1e-9


def test_a_turn_that_begins_late_comes_outside_the_next_leg():
    """20 m before a right angle with 40 m: 20 m beyond; half of that is turned away, half turned back."""
    made = bend(90.0, 20.0, 40.0)
    assert (made.radius_m, made.outside_m) == (40.0, near(20.0))
    assert max(along for along, _beside in made.places) == near(20.0)
    assert made.places[-1] == (near(0.0, 1e-6), near(made.after_m, 1e-6))
    # acos(1 - 20 / 80) = 41.4 degrees: 40 m up to the end of the turn, 2 x 40 sin 41.4 along the swing
    assert made.after_m == near(40.0 + 2 * 40.0 * math.sin(math.acos(0.75)), 1e-6)


def test_a_turn_back_is_two_radii_wide():
    made = bend(180.0, 80.0, 40.0)
    assert made.outside_m == near(80.0)
    assert max(beside for _along, beside in made.places) == near(80.0)
    assert made.places[-1][1] == near(0.0, 1e-6)


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
    assert (turn.seq, turn.angle_deg, turn.outside_m) == (2, near(90.0), 0.0)
    # told 81.17 m before the waypoint, which is 2226.39 m away, banked a second later, and as wide as that leaves it
    assert turn.radius_m == near(61.17, 0.1)
    assert turn.begins_m == near(2226.39 - 61.17, 0.1)
    assert turn.ends_m - turn.begins_m == near(61.17 * math.pi / 2, 0.5)
    assert from_corner(path, 2) == (near(-61.17, 0.1), near(0.0))
    assert path.legs[1].duration_s == near(108.26, 0.02)
    assert path.tight == path.unflown == ()


def test_the_next_item_is_flown_to_from_where_the_turn_begins():
    path = path_of(CORNER, CALM)
    assert [leg.seq for leg in path.legs] == [1, 2, *[3] * 7, 4, 4]


def test_a_tail_wind_makes_less_time_and_wider_turns():
    """30 m/s over ground: 91.77 m of radius, begun a second behind WP_RADIUS: 31.77 m outside. Flown so on ArduPlane
    (22 m/s and 8 m/s from behind) it was 30.6 m."""
    path = path_of(CORNER, Air(20.0, Wind(10.0, 270.0)))
    assert path.legs[1].duration_s == near((2226.39 - 60.0) / 30.0, 0.02)
    (turn,) = path.turns
    assert (turn.radius_m, turn.outside_m) == (near(91.77), near(31.77))


def test_the_distances_of_an_item_replace_wp_radius():
    def turn(params):
        (found,) = path_of(route(item(1, 84), item(2, 16, 0, 20, params=params), item(3, 16, 20, 20)), CALM).turns
        return found

    assert turn((0, 10.9, 0, 0)).outside_m == near(40.789 + 20.0 - 10.0), "in whole metres"
    assert turn((0, 0, 30, 0)).outside_m == near(40.789 + 50.0)
    assert turn((0, 0, 30, 0)).begins_m == near(2226.39 + 50.0, 0.1)


def test_once_around_a_circle_and_on_to_where_it_is_left():
    """Two turns of 100 m to the right, from the west, left to the north: hardly more than the whole circle."""
    path = path_of(route(item(1, 84), item(2, 18, 0, 20, params=(2, 0, 100, 0)), item(3, 16, 20, 20)), CALM)
    (turn,) = path.turns
    assert (turn.circle, turn.radius_m) == (True, 100.0)
    assert turn.begins_m == near(2226.39 - 100.0, 0.1)
    # to the right from the western end, and left 2.6 degrees behind it: acos(100 / 2211.5) are 87.4 degrees from north;
    # 24 chords are 0.3 % shorter than the circle
    assert turn.ends_m - turn.begins_m == near(0.997 * 2 * math.pi * 100.0 * (1 + 2.6 / 360.0), 1.0)
    assert sum(leg.hold_s for leg in path.legs) == near(2 * math.pi * 100.0 / 20.0, 0.2), "the second turn"


def test_a_circle_is_flown_to_the_side_of_its_sign():
    def norths(radius):
        path = path_of(route(item(1, 84), item(2, 18, 0, 20, params=(1, 0, radius, 0)), item(3, 16, 0, 60)), CALM)
        return [from_corner(path, number)[1] for number in range(2, 8)]

    assert all(north > 0.0 for north in norths(100)[1:]), "to the right from the west: over the north"
    assert all(north < 0.0 for north in norths(-100)[1:])


def test_hovering_there_are_no_turns_and_five_metres_a_second():
    hover = MissionItem(2, 3000, 2, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    flown = route(item(1, 84), hover, item(3, 16, 0, 2), item(4, 16, 2, 2), item(5, 85, 2, 2, 0.0))
    assert [hovers_at(flown, seq) for seq in (1, 3, 5)] == [False, True, True]
    path = path_of(flown, Air(20.0, Wind(10.0, 270.0)))
    assert path.turns == ()
    assert path.legs[1].duration_s == near(222.64 / 5.0)


def test_a_circle_down_before_a_hovering_landing():
    (turn,) = path_of(route(item(1, 84), item(2, 85, 0, 20, 0.0, params=(1, 0, 0, 0))), CALM).turns
    assert (turn.circle, turn.radius_m) == (True, 60.0)


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
    assert package.simulate().handovers[0].overlap_s == near(55.66)
    assert package.simulate(Wind(5.0, 90.0)).handovers[0].overlap_s == near(111.32, 0.2)
    assert package.simulate(Wind(5.0, 270.0)).handovers[0].overlap_s == near(55.66)


def test_the_table_tells_airspeed_wind_and_radius(winged):
    assert (
        "wings       quadplane, airspeed 15 m/s, wind up to 5 m/s from anywhere: up to 20 m/s over ground, "
        "turns of 41 m at 45 degrees"
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
    assert ", in the turn at item 2 (150 degrees, radius 41 m, " in text
    winged.items[1]["params"][1] = 0  # as WP_RADIUS has it
    assert [each for each in errors(winged) if "no coverage" in each] == []


TIGHT = "the leg to item 3 is 111 m, the turns at its ends need 122 m: where it is flown is not known"


@pytest.fixture
def tight(winged):
    """61 m before each of two right angles are more than the 110.6 m between them."""
    winged.items[2:2] = [winged.item(3, 16, 0.001, 10.03, 30), winged.item(4, 16, 0.001, 10.01, 30)]
    winged.toml = winged.toml.replace("expected_handovers = 1", "expected_handovers = 3")
    return winged


def warnings(small):
    return [finding.text for finding in check(load(small.write())).findings if finding.severity is Severity.WARNING]


def test_a_leg_shorter_than_its_turns_need_is_told_where_all_around_it_is_covered(tight):
    """It is flown within 81.17 m and three radii of 40.79 m: 203.5 m."""
    assert errors(tight) == []
    assert f"{TIGHT}. All within 204 m of it is covered alike" in warnings(tight)


def test_a_leg_shorter_than_its_turns_need_has_the_time_of_a_circle_more(tight):
    """40.79 m at 15 m/s."""
    legs = load(tight.write()).path().legs
    assert [leg.seq for leg in legs if leg.hold_s > 0.0] == [3]
    assert max(leg.hold_s for leg in legs) == near(math.tau * 40.789 / 15.0)


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
    assert text.endswith(", in the circle of 400 m at item 2")


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
    assert found == ["the circle of 60 m around rally 1 leaves every zone: a return waits there"]


# --- [wings] ---


def test_wings_are_as_the_mission_says(winged):
    winged.toml += "[wings]\nbank_deg = 30\ncircle_m = 100\n"
    assert load(winged.write()).route.wings == Wings(bank_deg=30.0, waypoint_m=90.0, circle_m=100.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("bank_deg = 80", "mission.toml: [wings]: bank_deg is 80 (allowed: a number from 10 to 75)"),
        ("roll = 3", "mission.toml: [wings]: unknown key 'roll' (allowed: bank_deg, waypoint_m, circle_m)"),
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

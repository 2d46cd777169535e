# SPDX-License-Identifier: GPL-3.0-or-later

"""The search for the nearest border and for the exit finds what a walk along every edge finds, whatever the shape."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from itertools import pairwise

import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from mavproxy_handover.mission import Circle, Zone, ZoneFinder
from mavproxy_handover.mission.geodesy import degree_lengths_m, distance_m, offset
from mavproxy_handover.mission.zones import KEPT_FROM_M, KEPT_PART

SQUARE = Polygon([(10.0, 0.0), (10.01, 0.0), (10.01, 0.01), (10.0, 0.01)])
NORTH, EAST = 0.0, 90.0


def fact(area, lat, lon, track=NORTH, speed=0.0, horizon_s=300.0):
    return ZoneFinder([Zone(251, "A", area)], horizon_s=horizon_s).facts(lat, lon, track, speed)[0]


def ring(dice, lat, lon, size_m, corners, dents):
    """A star around a place: its corners between `size_m` and a part `dents` less."""
    turns = [2.0 * math.pi * n / corners for n in range(corners)]
    radii = [size_m * (1.0 - dents * dice.random()) for _ in turns]
    places = [offset(lat, lon, r * math.sin(turn), r * math.cos(turn)) for r, turn in zip(radii, turns, strict=True)]
    return [(there_lon, there_lat) for there_lat, there_lon in places]


def rings_of(area):
    for polygon in getattr(area, "geoms", [area]):
        yield from (polygon.exterior, *polygon.interiors)


def edges_of(area):
    for line in rings_of(area):
        yield from pairwise(line.coords)


@st.composite
def areas(draw):
    """One to three stars, some with a hole, from 30 m to 30 km large, anywhere a drone flies."""
    dice = random.Random(draw(st.integers(0, 2**32)))
    lat, lon = draw(st.floats(-75.0, 75.0)), draw(st.floats(-170.0, 170.0))
    size = 10.0 ** draw(st.floats(1.5, 4.5))
    parts = []
    for number in range(draw(st.integers(1, 3))):
        middle_lat, middle_lon = offset(lat, lon, 2.2 * number * size, 0.0)
        corners = draw(st.sampled_from([3, 4, 5, 9, 17, 40, 150]))
        holes = []
        if draw(st.booleans()):
            holes.append(ring(dice, middle_lat, middle_lon, size * 0.2, draw(st.sampled_from([3, 4, 30])), 0.3))
        outline = ring(dice, middle_lat, middle_lon, size, corners, 0.5 if corners > 5 else 0.0)
        parts.append(Polygon(outline, holes))
    area = parts[0] if len(parts) == 1 else MultiPolygon(parts)
    assume(area.is_valid)
    return area


@st.composite
def places(draw, area, kinds=("inside", "around", "far", "border")):
    """Inside, mostly; somewhere in the area's box and near it; far from it; or on a corner or an edge."""
    west, south, east, north = area.bounds
    kind = draw(st.sampled_from(kinds))
    if kind == "inside":
        part = draw(st.sampled_from(list(getattr(area, "geoms", [area]))))
        place, corner = part.representative_point(), draw(st.sampled_from(list(part.exterior.coords)))
        out = draw(st.floats(0.0, 0.9))
        return place.y + out * (corner[1] - place.y), place.x + out * (corner[0] - place.x)
    if kind == "border":
        start, end = draw(st.sampled_from(list(edges_of(area))))
        part = draw(st.sampled_from([0.0, 0.5, 1.0]) | st.floats(0.0, 1.0))
        return start[1] + part * (end[1] - start[1]), start[0] + part * (end[0] - start[0])
    if kind == "around":
        return (
            draw(st.floats(south - (north - south) / 3.0, north + (north - south) / 3.0)),
            draw(st.floats(west - (east - west) / 3.0, east + (east - west) / 3.0)),
        )
    away, turn = 10.0 ** draw(st.floats(2.0, 4.7)), draw(st.floats(0.0, 2.0 * math.pi))
    return offset((south + north) / 2.0, east, away * math.sin(turn), away * math.cos(turn))


def walked_m(area, lat, lon):
    """The distance to the border by a walk along every edge, each in the plane halfway to the place found on it."""
    nearest = math.inf
    for start, end in edges_of(area):
        there = lat
        for _ in range(4):
            per_lat, per_lon = degree_lengths_m((lat + there) / 2.0)
            x, y = (lon - start[0]) * per_lon, (lat - start[1]) * per_lat
            dx, dy = (end[0] - start[0]) * per_lon, (end[1] - start[1]) * per_lat
            part = min(1.0, max(0.0, (x * dx + y * dy) / (dx * dx + dy * dy)))
            there = start[1] + part * (end[1] - start[1])
        nearest = min(nearest, distance_m(lat, lon, there, start[0] + part * (end[0] - start[0])))
    return nearest


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_margin_is_what_a_walk_along_every_edge_finds(data):
    area = data.draw(areas())
    lat, lon = data.draw(places(area))
    margin = fact(area, lat, lon).margin_m
    assert abs(margin) == pytest.approx(walked_m(area, lat, lon), rel=1e-4, abs=1e-4)
    assert (margin > 0.0) == area.contains(Point(lon, lat)) or abs(margin) < 1e-6


@settings(deadline=None, max_examples=200)
@given(st.data())
def test_facts_along_a_track_are_those_of_a_finder_that_was_never_asked_before(data):
    """Steps of every size, from one side of the border to the other and back."""
    area = data.draw(areas())
    finder = ZoneFinder([Zone(251, "A", area)])
    lat, lon = data.draw(places(area))
    for _ in range(data.draw(st.integers(1, 12))):
        (found,) = finder.facts(lat, lon, EAST, 20.0)
        (exact,) = ZoneFinder([Zone(251, "A", area)]).facts(lat, lon, EAST, 20.0)
        if exact.margin_m <= -(1.0 - KEPT_PART) * KEPT_FROM_M:  # far outside it may be that of a place just before
            assert found == replace(exact, margin_m=pytest.approx(exact.margin_m, rel=0.0205))
        else:
            assert found == exact
        if data.draw(st.booleans()):
            there, part = data.draw(places(area)), data.draw(st.floats(0.0, 1.0))
            lat, lon = lat + part * (there[0] - lat), lon + part * (there[1] - lon)
        else:
            lat, lon = offset(lat, lon, *data.draw(st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))))


@pytest.mark.parametrize("first", [179.96, -179.96])
def test_zone_on_both_sides_of_the_180th_meridian_is_left_and_entered_across_it(first):
    area = MultiPolygon(
        [
            Polygon([(-180.0, 0.0), (-179.0, 0.0), (-179.0, 1.0), (-180.0, 1.0)]),
            Polygon([(179.0, 2.0), (180.0, 2.0), (180.0, 3.0), (179.0, 3.0)]),
        ]
    )
    finder = ZoneFinder([Zone(251, "A", area)])
    for hundredth in range(9):
        east = first + math.copysign(hundredth / 100.0, -1.0 if first < 0.0 else 1.0)
        lon = east - 360.0 if east > 180.0 else east + 360.0 if east < -180.0 else east
        margin = finder.facts(0.5, lon, EAST, 20.0)[0].margin_m
        assert (margin > 0.0) is (lon < 0.0 and lon > -180.0), lon


def test_border_crossed_in_small_steps_is_noticed_at_the_border():
    finder = ZoneFinder([Zone(251, "A", SQUARE)])
    for step in range(-200, 201):
        lon = 10.0 + step * 1e-6  # 11 cm
        margin = finder.facts(0.005, lon, EAST, 5.0)[0].margin_m
        assert (margin > 0.0) is (step > 0), step
        assert margin == pytest.approx(step * 0.111319, abs=1e-3)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32), st.floats(-75.0, 75.0), st.floats(0.0, 360.0), st.floats(3_000.0, 50_000.0))
def test_distance_to_a_zone_of_many_corners_is_geodesic_to_a_permille(seed, lat, direction, away):
    """Against the shortest geodesic to a corner; edges are so short that places between hardly differ."""
    area = Polygon(ring(random.Random(seed), lat, 10.0, 2000.0, 300, 0.02))
    here = Geodesic.WGS84.Direct(lat, 10.0, direction, away)
    corners = list(area.exterior.coords)
    nearest = min(Geodesic.WGS84.Inverse(here["lat2"], here["lon2"], there[1], there[0])["s12"] for there in corners)
    margin = fact(area, here["lat2"], here["lon2"]).margin_m
    assert margin < 0.0
    assert -margin == pytest.approx(nearest, rel=1e-3, abs=1.5)


@pytest.mark.parametrize("lat", [70.0, -70.0])
@pytest.mark.parametrize("nearer", [45.0, 135.0])
def test_parts_north_and_south_are_compared_by_the_scales_there(lat, nearer):
    """Half a percent apart; by the scale at the aircraft the part nearer to the pole looks 0.8 % farther than it is."""
    parts = []
    for direction in (45.0, 135.0):
        there = Geodesic.WGS84.Direct(lat, 10.0, direction, 50_100.0 if direction == nearer else 50_350.0)
        parts.append(Polygon(ring(random.Random(1), there["lat2"], there["lon2"], 100.0, 20, 0.0)))
    assert fact(MultiPolygon(parts), lat, 10.0).margin_m == pytest.approx(-50_000.0, abs=15.0)


def test_long_edges_towards_a_pole_are_not_overlooked():
    """Their boxes are so high that the scale differs by percents within; the nearest edge may be in any of them."""
    dice = random.Random(8)
    for _ in range(1000):
        lat, strips = dice.uniform(65.0, 75.0), []
        for _ in range(8):
            west, south = 10.0 + dice.choice([-1, 1]) * dice.uniform(0.3, 1.2), lat + dice.uniform(-0.5, 0.1)
            north = south + dice.uniform(0.05, 1.5)
            strips.append(Polygon([(west, south), (west + 1e-3, south), (west + 1e-3, north), (west, north)]))
        area = MultiPolygon(strips)
        assert fact(area, lat, 10.0).margin_m == pytest.approx(-walked_m(area, lat, 10.0), rel=1e-3)


@settings(deadline=None, max_examples=200)
@given(st.data(), st.sampled_from([NORTH, EAST, 180.0, 270.0, None]) | st.floats(0.0, 360.0))
def test_exit_is_where_the_track_is_first_outside(data, track):
    """Against shapely's difference of track and area, in the plane at the aircraft; None stands for: at a corner."""
    area = data.draw(areas())
    lat, lon = data.draw(places(area, ("inside", "around")))
    per_lat, per_lon = degree_lengths_m(lat)
    if track is None:
        corner = data.draw(st.sampled_from([corner for line in rings_of(area) for corner in line.coords]))
        track = math.degrees(math.atan2((corner[0] - lon) * per_lon, (corner[1] - lat) * per_lat))
    found = fact(area, lat, lon, track, 20.0)
    assume(found.margin_m > 0.1)  # on the border itself either side is right
    plane = affinity.affine_transform(area, [per_lon, 0.0, 0.0, per_lat, -lon * per_lon, -lat * per_lat])
    reach = 20.0 * 300.0
    way = math.sin(math.radians(track)), math.cos(math.radians(track))
    outside = LineString([(0.0, 0.0), (reach * way[0], reach * way[1])]).difference(plane)
    pieces = [piece for piece in getattr(outside, "geoms", [outside]) if not piece.is_empty]
    assume(all(piece.length > 0.1 or piece.length < 0.001 for piece in pieces))  # a corner touched, or not quite
    starts = [math.hypot(*piece.coords[0]) for piece in pieces if piece.length > 0.1]
    if found.exit_s is None:
        assert starts == []
    elif starts:
        assert found.exit_s * 20.0 == pytest.approx(min(starts), abs=0.01)
    else:
        assert found.exit_s * 20.0 == pytest.approx(reach, abs=0.2)


@pytest.mark.parametrize(
    ("lat", "lon", "track", "exit_s"),
    [(0.008, 10.001, -26.719300551416094, 24.7586), (0.002, 10.002, -134.80757680169503, 31.3807)],
)
def test_track_that_runs_into_a_corner_ends_there(lat, lon, track, exit_s):
    """Rounding puts these tracks past the ends of both edges: there was no crossing at all, and the check failed."""
    assert fact(SQUARE, lat, lon, track, 10.0).exit_s == pytest.approx(exit_s, abs=0.001)


def test_track_that_just_misses_the_end_of_a_long_edge_goes_on():
    """By 0.01 mm, which rounding takes for a crossing of the edge of 56 km, but not of its short neighbour."""
    notched = Polygon(
        [(10.0, 0.0), (10.4, 0.0), (10.5, 0.5), (10.50001, 0.4999), (10.6, 0.0), (11.0, 0.0), (11.0, 1.0), (10.0, 1.0)]
    )
    assert fact(notched, 0.5 + 1e-10, 10.2, EAST, 400.0).exit_s == pytest.approx(222.635, abs=0.01)
    assert fact(notched, 0.4999, 10.2, EAST, 400.0).exit_s == pytest.approx(83.483, abs=0.01)


def test_border_just_come_over_is_no_exit():
    assert fact(SQUARE, 0.005, 10.0 + 1e-8, EAST, 10.0).exit_s == pytest.approx(111.319, abs=0.001)


@pytest.mark.parametrize(("lat", "lon"), [(0.0001, 10.005), (0.0099, 10.005), (0.005, 10.0001), (0.005, 10.0099)])
def test_place_close_to_any_side_is_inside(lat, lon):
    assert fact(SQUARE, lat, lon).margin_m == pytest.approx(11.1, abs=0.1)


def test_exit_of_a_zone_in_parts_is_that_of_the_part_that_holds_the_aircraft():
    beside = Polygon([(10.02, 0.0), (10.03, 0.0), (10.03, 0.01), (10.02, 0.01)])
    area = MultiPolygon([SQUARE, beside])
    assert fact(area, 0.005, 10.005, EAST, 10.0).exit_s == pytest.approx(55.660, abs=0.001)
    assert fact(area, 0.005, 10.025, 270.0, 10.0).exit_s == pytest.approx(55.660, abs=0.001)


def test_zone_at_the_180th_meridian_is_near_from_its_other_side():
    east_end = Polygon([(179.99, 0.0), (180.0, 0.0), (180.0, 0.01), (179.99, 0.01)])
    assert fact(east_end, 0.005, -179.999).margin_m == pytest.approx(-111.319, abs=0.001)
    assert fact(east_end, 0.005, 179.999).margin_m == pytest.approx(111.319, abs=0.001)
    west_end = Polygon([(-180.0, 0.0), (-179.99, 0.0), (-179.99, 0.01), (-180.0, 0.01)])
    assert fact(west_end, 0.005, 179.999).margin_m == pytest.approx(-111.319, abs=0.001)


def test_outline_of_a_circle_has_the_margin_of_the_circle_in_all_directions():
    """From its middle every edge is as near as any other: nothing can be left out."""
    circle = Circle(52.679, 5.924, 420.0)
    outline = circle.outline()
    assert fact(outline, 52.679, 5.924).margin_m == pytest.approx(420.0 * math.cos(math.pi / 128), abs=0.01)
    for turn in range(0, 360, 15):
        lat, lon = offset(52.679, 5.924, 900.0 * math.sin(math.radians(turn)), 900.0 * math.cos(math.radians(turn)))
        assert fact(outline, lat, lon).margin_m == pytest.approx(fact(circle, lat, lon).margin_m, abs=0.15)

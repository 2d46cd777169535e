# SPDX-License-Identifier: GPL-3.0-or-later

"""Places of a return on the map: whose zones hold the way there, and whether the fence does."""

from __future__ import annotations

import math
import random
from collections import Counter

import pytest
from shapely.geometry import MultiPolygon, Polygon, box

from mavproxy_handover.core.safety.energy import Piece, Wind
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.borders import Circle
from mavproxy_handover.mission.fence import Fence, outside_fence
from mavproxy_handover.mission.plan import FenceCircle, FencePolygon
from mavproxy_handover.mission.return_paths import PlaceFinder, PlaceView, flown_s
from mavproxy_handover.mission.zones import Zone, ZoneFinder

A, B = 251, 252
#: one degree of latitude is 111 km: these are squares of 1.1 km beside each other, with 0.1 km in common
WEST = Zone(A, "GCSA", box(5.000, 52.000, 5.010, 52.010))
EAST = Zone(B, "GCSB", box(5.009, 52.000, 5.020, 52.010))


def sets(*stations: set[int]) -> frozenset[frozenset[int]]:
    return frozenset(frozenset(part) for part in stations)


def look(
    zones: tuple[Zone, ...], here: tuple[float, float], place: tuple[float, float], height: float = 30.0
) -> PlaceView:
    return PlaceFinder(zones, Fence(())).evaluate(here, place, height)


def test_the_way_is_cut_where_zones_begin_and_end() -> None:
    view = look((WEST, EAST), (52.005, 5.015), (52.005, 5.005))
    assert view.there == {A}
    assert view.way == sets({B}, {A, B}, {A})


def test_a_gap_on_the_way_is_seen_however_small() -> None:
    apart = Zone(B, "GCSB", box(5.0101, 52.000, 5.020, 52.010))  # 7 m
    assert look((WEST, apart), (52.005, 5.015), (52.005, 5.005)).way == sets({B}, set(), {A})


def test_zones_that_touch_leave_none() -> None:
    beside = Zone(B, "GCSB", box(5.010, 52.000, 5.020, 52.010))
    assert look((WEST, beside), (52.005, 5.015), (52.005, 5.005)).way == sets({B}, {A})


def test_a_way_that_leaves_its_zone_and_comes_back() -> None:
    horseshoe = Polygon([(5.0, 52.0), (5.01, 52.0), (5.01, 52.01), (5.006, 52.01), (5.006, 52.002), (5.004, 52.002),
                         (5.004, 52.01), (5.0, 52.01)])  # fmt: skip
    view = look((Zone(A, "GCSA", horseshoe),), (52.005, 5.008), (52.005, 5.002))
    assert (view.there, view.way) == ({A}, sets({A}, set()))


def test_a_place_that_nobody_covers() -> None:
    view = look((WEST,), (52.005, 5.005), (52.005, 5.05))
    assert (view.there, view.way) == (set(), sets({A}, set()))


def test_over_the_place_itself_there_is_no_way() -> None:
    assert look((WEST, EAST), (52.005, 5.0095), (52.005, 5.0095)) == PlaceView(
        True, True, frozenset({A, B}), sets({A, B})
    )
    assert look((WEST,), (52.5, 5.0095), (52.5, 5.0095)) == PlaceView(True, True, frozenset(), sets(set()))


def test_nor_where_the_place_is_a_rounding_error_away() -> None:
    """The fault: a line of a millionth of a millimetre, cut by a zone, was nothing, and nobody covered the place."""
    for zone in (WEST, Zone(A, "GCSA", Circle(52.005, 5.005, 500.0))):
        view = look((zone,), (52.005, 5.005), (52.005 + 7e-15, 5.005 - 9e-16))
        assert (view.there, view.way) == ({A}, sets({A}))


@pytest.mark.parametrize(("height", "there"), [(50.0, {A}), (50.1, set()), (9.0, set())])
def test_the_height_of_the_return_has_to_be_inside(height: float, there: set[int]) -> None:
    zone = Zone(A, "GCSA", box(5.0, 52.0, 5.01, 52.01), min_alt_m=10.0, max_alt_m=50.0)
    assert look((zone,), (52.005, 5.008), (52.005, 5.002), height).there == there


def test_a_circle_is_cut_too() -> None:
    # 500 m around, the way passes its middle at 300 m: it is inside for 2 x 400 m of 2000
    zone = Zone(A, "GCSA", Circle(52.0, 5.0, 500.0))
    metre = 1 / 111_270.0
    start, end = (52.0 + 300 * metre, 5.0 - 0.01457), (52.0 + 300 * metre, 5.0 + 0.01457)
    assert look((zone,), start, end).way == sets(set(), {A})
    assert look((zone,), start, (start[0], 5.0)).there == {A}
    far = (52.0 + 501 * metre, 5.0 - 0.01457), (52.0 + 501 * metre, 5.0 + 0.01457)
    assert look((zone,), *far).way == sets(set())


@pytest.mark.parametrize("area", [box(179.99, -17.0, 180.01, -16.99), MultiPolygon(
    [box(179.99, -17.0, 180.0, -16.99), box(-180.0, -17.0, -179.99, -16.99)])])  # fmt: skip
def test_a_way_across_the_180th_meridian(area: Polygon | MultiPolygon) -> None:
    zone = Zone(A, "GCSA", area)
    for start, end in ((179.995, -179.995), (-179.995, 179.995)):
        view = look((zone,), (-16.995, start), (-16.995, end))
        assert (view.there, view.way) == ({A}, sets({A}))


def test_it_agrees_with_the_zone_finder_along_random_ways() -> None:
    """The judge is another one: places along the way, asked one by one, each less than a metre from the next."""
    chance = random.Random(16)

    def spot() -> tuple[float, float]:
        return 52.0 + chance.uniform(0, 0.01), 5.0 + chance.uniform(0, 0.01)

    for _ in range(60):
        zones = (
            Zone(A, "GCSA", Circle(*spot(), 400.0)),
            Zone(B, "GCSB", box(5.0 + chance.uniform(0, 0.007), 52.0, 5.008, 52.006)),
            Zone(B, "GCSB", _star(chance)),
        )
        start, end = spot(), spot()
        view, finder = look(zones, start, end), ZoneFinder(zones)
        asked = Counter(
            finder.holding(start[0] + n / 2000 * (end[0] - start[0]), start[1] + n / 2000 * (end[1] - start[1]))
            for n in range(2001)
        )
        assert view.way <= set(asked)
        assert {part for part, times in asked.items() if times > 10} <= view.way
        assert view.there == finder.holding(*end)


def _star(chance: random.Random) -> Polygon:
    turns = sorted(chance.uniform(0, 2 * math.pi) for _ in range(9))
    return Polygon([
        (5.005 + chance.uniform(0.001, 0.005) * math.sin(t), 52.005 + chance.uniform(0.001, 0.005) * math.cos(t))
        for t in turns
    ]).buffer(0)  # fmt: skip


# ---- the fence ----------------------------------------------------------------------------------------------------

FIELD = FencePolygon(True, ((52.0, 5.0), (52.01, 5.0), (52.01, 5.02), (52.0, 5.02)))
YARD = FencePolygon(False, ((52.004, 5.009), (52.006, 5.009), (52.006, 5.011), (52.004, 5.011)))
PYLON = FenceCircle(False, 52.005, 5.01, 100.0)
RANGE = FenceCircle(True, 52.005, 5.01, 500.0)


@pytest.mark.parametrize(
    ("fence", "here", "place", "inside", "way_inside"),
    [
        ((), (0.0, 0.0), (1.0, 1.0), True, True),
        ((FIELD,), (52.005, 5.002), (52.005, 5.018), True, True),
        ((FIELD,), (52.005, 5.002), (52.005, 5.021), False, False),
        ((FIELD,), (52.005, 5.021), (52.005, 5.018), True, False),
        ((FIELD, YARD), (52.005, 5.002), (52.005, 5.018), True, False),
        ((FIELD, YARD), (52.008, 5.002), (52.008, 5.018), True, True),
        ((FIELD, YARD), (52.008, 5.002), (52.005, 5.010), False, False),
        ((PYLON,), (52.005, 5.002), (52.005, 5.018), True, False),
        ((PYLON,), (52.0062, 5.002), (52.0062, 5.018), True, True),
        ((PYLON,), (52.005, 5.002), (52.005, 5.005), True, True),
        ((PYLON,), (52.005, 5.002), (52.005, 5.010), False, False),
        ((RANGE,), (52.005, 5.004), (52.005, 5.016), True, True),
        ((RANGE,), (52.005, 5.004), (52.005, 5.018), False, False),
        ((RANGE,), (52.005, 5.002), (52.005, 5.016), True, False),
        ((FIELD, RANGE, PYLON), (52.0062, 5.007), (52.0062, 5.013), True, True),
    ],
)
def test_place_and_way_against_the_fence(
    fence: tuple[FencePolygon | FenceCircle, ...],
    here: tuple[float, float],
    place: tuple[float, float],
    inside: bool,
    way_inside: bool,
) -> None:
    view = PlaceFinder((), Fence(fence)).evaluate(here, place, 30.0)
    assert (view.inside, view.way_inside) == (inside, way_inside)
    assert outside_fence(fence, *place) is not inside


def test_a_straight_way_between_two_places_of_a_bent_field_may_leave_it() -> None:
    bent = FencePolygon(
        True, ((52.0, 5.0), (52.01, 5.0), (52.01, 5.004), (52.002, 5.004), (52.002, 5.01), (52.0, 5.01))
    )
    assert Fence((bent,)).holds((52.009, 5.002))
    assert Fence((bent,)).holds((52.001, 5.009))
    assert not Fence((bent,)).holds_way((52.009, 5.002), (52.001, 5.009))


def test_a_fence_across_the_180th_meridian() -> None:
    sea = FencePolygon(True, ((-17.0, 179.99), (-16.99, 179.99), (-16.99, -179.99), (-17.0, -179.99)))
    for start, end in ((179.995, -179.995), (-179.995, 179.995)):
        assert Fence((sea,)).holds_way((-16.995, start), (-16.995, end))
        assert not Fence((sea,)).holds_way((-16.995, start), (-16.98, end))


# ---- time ---------------------------------------------------------------------------------------------------------


def test_how_long_a_way_takes() -> None:
    way = (Piece(climb_m=25.0), Piece(length_m=800.0, hold_s=5.0), Piece(descent_m=40.0, landing_m=10.0))
    # 10 s up, 100 s there, 5 s of pause, 20 s down and 20 s of landing
    assert flown_s(way, None, 8.0) == pytest.approx(155.0)
    slower = (way[0], way[1]._replace(speed_mps=4.0), way[2])
    assert flown_s(slower, None, 8.0) == pytest.approx(255.0), "what the piece says goes first"
    model = EnergySettings(battery_wh=100.0, hover_w=300.0).model(Wind(12.0, 0.0))
    assert flown_s(way, model, 8.0) == math.inf, "north, against 12 m/s"

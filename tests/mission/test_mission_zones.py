# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts about zones: which side, how far, how soon. Values by hand on the equator, where 0.001 degrees are 110.574 m
of latitude and 111.319 m of longitude."""

from __future__ import annotations

import math

import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Point, Polygon

from mavproxy_handover.core.common.model import ZoneFact
from mavproxy_handover.mission import Circle, Zone, ZoneFinder, overlap

SQUARE = Polygon([(10.0, 0.0), (10.01, 0.0), (10.01, 0.01), (10.0, 0.01)])
NORTH, EAST, SOUTH, WEST = 0.0, 90.0, 180.0, 270.0


def fact(area, lat, lon, track=NORTH, speed=0.0, alt=None, **limits):
    found = ZoneFinder([Zone(251, "A", area, **limits)]).facts(lat, lon, track, speed, alt)
    assert len(found) == 1
    assert found[0].station == 251
    return found[0]


# --- margin ---


def test_margin_inside_a_polygon_is_the_distance_to_the_nearest_edge():
    assert fact(SQUARE, 0.005, 10.002).margin_m == pytest.approx(222.639, abs=0.001)
    assert fact(SQUARE, 0.009, 10.005).margin_m == pytest.approx(110.574, abs=0.001)


def test_margin_outside_is_negative():
    assert fact(SQUARE, 0.005, 10.011).margin_m == pytest.approx(-111.319, abs=0.001)


def test_margin_beyond_a_corner_is_the_distance_to_the_corner():
    assert fact(SQUARE, -0.001, 9.999).margin_m == pytest.approx(-math.hypot(110.574, 111.319), abs=0.001)


def test_place_in_a_hole_is_outside():
    area = Polygon(SQUARE.exterior.coords, [[(10.004, 0.004), (10.006, 0.004), (10.006, 0.006), (10.004, 0.006)]])
    assert fact(area, 0.005, 10.005).margin_m == pytest.approx(-110.574, abs=0.001)
    assert fact(area, 0.005, 10.003).margin_m == pytest.approx(111.319, abs=0.001)


def test_margin_of_a_zone_in_parts_is_that_of_the_nearest_border():
    far = Polygon([(10.02, 0.0), (10.03, 0.0), (10.03, 0.01), (10.02, 0.01)])
    area = MultiPolygon([SQUARE, far])
    assert fact(area, 0.005, 10.021).margin_m == pytest.approx(111.319, abs=0.001)
    assert fact(area, 0.005, 10.012).margin_m == pytest.approx(-222.639, abs=0.001)


def test_margin_of_a_circle():
    circle = Circle(0.0, 10.0, 500.0)
    assert fact(circle, 0.0, 10.0).margin_m == 500.0
    assert fact(circle, 0.001, 10.0).margin_m == pytest.approx(500.0 - 110.574, abs=0.001)
    assert fact(circle, 0.0, 10.01).margin_m == pytest.approx(500.0 - 1113.195, abs=0.001)


def test_circle_on_the_180th_meridian_holds_both_sides():
    circle = Circle(0.0, 180.0, 500.0)
    assert fact(circle, 0.0, 179.999).margin_m == pytest.approx(388.681, abs=0.001)
    assert fact(circle, 0.0, -179.999).margin_m == pytest.approx(388.681, abs=0.001)


@settings(deadline=None)
@given(
    st.floats(-75.0, 75.0),
    st.floats(0.0, 360.0),
    st.floats(100.0, 50_000.0),
    st.floats(-0.02, 0.02),
    st.floats(0.0, 180.0),
)
def test_distance_to_a_far_border_is_geodesic_to_a_permille(lat, direction, distance, tilt, turn):
    """Against the shortest of many geodesics to places on an edge, first coarsely, then finely."""
    there = Geodesic.WGS84.Direct(lat, 10.0, direction, distance)
    start = (there["lon2"], there["lat2"])
    lon_step, lat_step = 0.05 * math.cos(math.radians(turn)), 0.05 * math.sin(math.radians(turn)) + tilt
    end = (start[0] + lon_step, start[1] + lat_step)
    area = Polygon([start, end, (start[0] + 1e-7, start[1] + 1e-7)])
    margin = fact(area, lat, 10.0).margin_m

    def along(part):
        return Geodesic.WGS84.Inverse(lat, 10.0, start[1] + part * lat_step, start[0] + part * lon_step)["s12"]

    best = min(range(201), key=lambda n: along(n / 200))
    nearest = min(along(min(1.0, max(0.0, (best + n / 100) / 200))) for n in range(-100, 101))
    assert abs(margin) == pytest.approx(nearest, rel=1e-3, abs=0.05)


# --- altitude ---


def test_altitude_limits_put_the_aircraft_outside_by_the_way_back():
    limits = {"min_alt_m": 20.0, "max_alt_m": 120.0}
    assert fact(SQUARE, 0.005, 10.005, alt=130.0, **limits).margin_m == -10.0
    assert fact(SQUARE, 0.005, 10.005, alt=5.0, **limits).margin_m == -15.0
    assert fact(SQUARE, 0.005, 10.011, alt=130.0, **limits).margin_m == pytest.approx(
        -math.hypot(111.319, 10.0), abs=0.001
    )


def test_margin_just_below_the_ceiling_is_horizontal():
    assert fact(SQUARE, 0.005, 10.002, alt=119.0, max_alt_m=120.0).margin_m == pytest.approx(222.639, abs=0.001)


def test_unknown_altitude_is_not_held_against_the_aircraft():
    assert fact(SQUARE, 0.005, 10.002, alt=None, max_alt_m=120.0).margin_m > 0


# --- exit ---


def test_exit_is_the_way_along_the_track_at_the_present_speed():
    assert fact(SQUARE, 0.005, 10.002, EAST, 10.0).exit_s == pytest.approx(89.0556, abs=0.001)
    assert fact(SQUARE, 0.005, 10.002, WEST, 10.0).exit_s == pytest.approx(22.2639, abs=0.001)
    assert fact(SQUARE, 0.005, 10.002, NORTH, 5.0).exit_s == pytest.approx(110.574, abs=0.001)


def test_exit_of_a_circle():
    circle = Circle(0.0, 10.0, 500.0)
    assert fact(circle, 0.0, 10.001, EAST, 10.0).exit_s == pytest.approx(38.868, abs=0.001)
    assert fact(circle, 0.0, 10.001, WEST, 10.0).exit_s == pytest.approx(61.132, abs=0.001)
    assert fact(circle, 0.0, 10.001, NORTH, 10.0).exit_s == pytest.approx(48.745, abs=0.001)


def test_exit_through_a_hole_counts():
    area = Polygon(SQUARE.exterior.coords, [[(10.004, 0.004), (10.006, 0.004), (10.006, 0.006), (10.004, 0.006)]])
    assert fact(area, 0.005, 10.002, EAST, 10.0).exit_s == pytest.approx(22.2639, abs=0.001)


def test_touching_a_corner_is_no_exit():
    notched = Polygon(
        [(10.0, 0.0), (10.01, 0.0), (10.01, 0.01), (10.006, 0.01), (10.005, 0.005), (10.004, 0.01), (10.0, 0.01)]
    )
    assert fact(notched, 0.005, 10.002, EAST, 10.0).exit_s == pytest.approx(89.0556, abs=0.001)


def test_no_exit_beyond_the_horizon():
    finder = ZoneFinder([Zone(251, "A", SQUARE)], horizon_s=60.0)
    assert finder.facts(0.005, 10.002, EAST, 10.0)[0].exit_s is None
    assert finder.facts(0.005, 10.002, WEST, 10.0)[0].exit_s == pytest.approx(22.2639, abs=0.001)


def test_no_exit_when_slow_outside_or_without_track():
    assert fact(SQUARE, 0.005, 10.002, EAST, 0.49).exit_s is None
    assert fact(SQUARE, 0.005, 10.002, EAST, 0.5).exit_s is None  # 890 m at half a metre a second
    assert fact(SQUARE, 0.005, 10.0099, EAST, 0.5).exit_s == pytest.approx(22.264, abs=0.001)
    assert fact(SQUARE, 0.005, 9.999, EAST, 10.0).exit_s is None
    assert fact(SQUARE, 0.005, 10.002, math.nan, 10.0).exit_s is None
    assert fact(SQUARE, 0.005, 10.002, EAST, math.nan).exit_s is None
    assert fact(SQUARE, 0.005, 10.002, EAST, 10.0, alt=500.0, max_alt_m=120.0).exit_s is None


# --- finder ---


def test_facts_come_in_the_order_of_the_zones():
    finder = ZoneFinder([Zone(252, "B", Circle(0.0, 10.0, 100.0)), Zone(251, "A", Circle(0.0, 10.0, 50.0))])
    assert finder.facts(0.0, 10.0, NORTH, 0.0) == (ZoneFact(252, 100.0, None), ZoneFact(251, 50.0, None))


@pytest.mark.parametrize(("lat", "lon"), [(math.nan, 10.0), (0.0, math.inf), (91.0, 10.0), (0.0, -181.0)])
def test_position_that_is_no_place_gives_no_facts(lat, lon):
    assert ZoneFinder([Zone(251, "A", SQUARE)]).facts(lat, lon, NORTH, 0.0) == ()


@settings(deadline=None)
@given(st.floats(-0.005, 0.015), st.floats(9.995, 10.015), st.floats(0.0, 360.0), st.floats(0.0, 30.0))
def test_margin_has_the_sign_of_holding_and_exit_lies_on_the_border(lat, lon, track, speed):
    """INV: a zone holds a place exactly when its margin is above zero; an exit never comes before the border."""
    finder = ZoneFinder([Zone(251, "A", SQUARE), Zone(252, "B", Circle(0.005, 10.005, 300.0))], horizon_s=1000.0)
    holding = finder.holding(lat, lon)
    for found in finder.facts(lat, lon, track, speed):
        if abs(found.margin_m) > 1e-6:
            assert (found.margin_m > 0.0) == (found.station in holding)
        if found.exit_s is not None:
            assert found.station in holding
            assert found.exit_s * speed >= found.margin_m * 0.999 - 1e-6
            beyond = found.exit_s * speed + 0.5
            north, east = beyond * math.cos(math.radians(track)), beyond * math.sin(math.radians(track))
            assert found.station not in finder.holding(lat + north / 110574.27, lon + east / 111319.49)


def test_altitude_counts_for_holding():
    finder = ZoneFinder([Zone(251, "A", SQUARE, "", None, 120.0)])
    assert finder.holding(0.005, 10.005, 119.0) == {251}
    assert finder.holding(0.005, 10.005, 121.0) == frozenset()


# --- handover region ---


def test_overlap_of_two_polygons_is_their_common_area():
    east = Polygon([(10.008, 0.002), (10.02, 0.002), (10.02, 0.004), (10.008, 0.004)])
    region = overlap(Zone(251, "A", SQUARE), Zone(252, "B", east))
    assert region.bounds == (10.008, 0.002, 10.01, 0.004)


def test_zones_that_touch_have_no_handover_region():
    beside = Polygon([(10.01, 0.0), (10.02, 0.0), (10.02, 0.01), (10.01, 0.01)])
    assert overlap(Zone(251, "A", SQUARE), Zone(252, "B", beside)).is_empty


def test_zones_above_one_another_have_no_handover_region():
    assert overlap(Zone(251, "A", SQUARE, max_alt_m=50.0), Zone(252, "B", SQUARE, min_alt_m=50.0)).is_empty
    assert not overlap(Zone(251, "A", SQUARE, max_alt_m=50.0), Zone(252, "B", SQUARE, min_alt_m=40.0)).is_empty


def test_outline_of_a_circle_is_inside_it_by_less_than_a_permille():
    outline = Circle(52.679, 5.924, 420.0).outline()
    centre = Point(5.924, 52.679)
    assert outline.contains(centre)
    distances = {
        round(Geodesic.WGS84.Inverse(52.679, 5.924, lat, lon)["s12"], 1) for lon, lat in outline.exterior.coords
    }
    assert distances == {420.0}


class TestWay:
    """On the way that is known to be flown a zone ends where that leaves it, and not where the track would."""

    #: a square of 2 km around the origin
    SQUARE = Zone(251, "A", Polygon([(-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01)]))
    EAST_OF_IT = Zone(252, "B", Polygon([(0.009, -0.01), (0.03, -0.01), (0.03, 0.01), (0.009, 0.01)]))
    #: 111 m before the eastern border
    PLACE = (0.0, 0.009)

    def facts(self, way: tuple[tuple[float, float], ...], *zones: Zone, speed_mps: float = 10.0) -> ZoneFact:
        return ZoneFinder(zones or (self.SQUARE,)).facts(*self.PLACE, 90.0, speed_mps, 50.0, way)[0]

    def test_straight_on_without_one(self) -> None:
        fact = self.facts(())
        assert fact.exit_s == pytest.approx(11.13, abs=0.1)
        assert fact.ends_s == pytest.approx(11.13, abs=0.55)

    def test_a_turn_before_the_border_does_not_leave(self) -> None:
        fact = self.facts(((0.0, 0.0095), (0.008, 0.0095), (0.008, 0.0)))
        assert fact.exit_s == pytest.approx(11.13, abs=0.1)
        assert fact.ends_s is None
        assert fact.beyond == frozenset()

    def test_a_turn_towards_the_border_leaves_where_the_way_does(self) -> None:
        """The track misses the border in front; behind the next waypoint it is 55 m away."""
        fact = ZoneFinder((self.SQUARE,)).facts(0.0085, 0.0, 90.0, 10.0, 50.0, ((0.0085, 0.0005), (0.02, 0.0005)))[0]
        assert fact.ends_s == pytest.approx((55.7 + 166.0) / 10.0, abs=0.6) or fact.ends_s is None
        near = ZoneFinder((self.SQUARE,)).facts(0.0095, 0.0, 90.0, 10.0, 50.0, ((0.0095, 0.0005), (0.02, 0.0005)))[0]
        assert near.ends_s == pytest.approx((55.7 + 55.3) / 10.0, abs=0.6)

    def test_who_holds_the_place_where_it_ends(self) -> None:
        assert self.facts((), self.SQUARE, self.EAST_OF_IT).beyond == {251, 252}
        assert self.facts((), self.SQUARE).beyond == {251}

    @pytest.mark.parametrize("speed_mps", [0.0, 0.4, float("nan"), float("inf")])
    def test_what_does_not_move_leaves_nothing(self, speed_mps: float) -> None:
        assert self.facts((), speed_mps=speed_mps).ends_s is None

    def test_a_way_without_length_leads_nowhere(self) -> None:
        assert self.facts((self.PLACE, self.PLACE)).ends_s is None
        assert self.facts((self.PLACE, (0.0, 0.02))).ends_s == pytest.approx(11.13, abs=0.55)

    def test_across_the_180th_meridian(self) -> None:
        zone = Zone(251, "A", MultiPolygon([
            Polygon([(179.99, -0.01), (180.0, -0.01), (180.0, 0.01), (179.99, 0.01)]),
            Polygon([(-180.0, -0.01), (-179.99, -0.01), (-179.99, 0.01), (-180.0, 0.01)]),
        ]))  # fmt: skip
        (fact,) = ZoneFinder((zone,)).facts(0.0, 179.9995, 90.0, 60.0, 50.0, ((0.0, -179.98),))
        assert fact.ends_s == pytest.approx(1169.0 / 60.0, abs=0.6)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Distances and directions against Karney's algorithm (geographiclib) and against written-out values."""

from __future__ import annotations

import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import given, settings
from hypothesis import strategies as st

from mavproxy_handover.mission.geodesy import (
    LocalPlane,
    bearing_deg,
    degree_lengths_m,
    distance_m,
    offset,
    wrap_longitude_deg,
)

LATITUDES = st.floats(-80.0, 80.0)
LONGITUDES = st.floats(-180.0, 180.0)
DIRECTIONS = st.floats(0.0, 360.0)
WGS84 = Geodesic.WGS84


@pytest.mark.parametrize(
    ("lat", "per_lat", "per_lon"),
    [(0.0, 110574.276, 111319.491), (45.0, 111131.778, 78846.806), (60.0, 111412.240, 55800.0)],
)
def test_length_of_a_degree_is_that_of_the_ellipsoid(lat, per_lat, per_lon):
    assert degree_lengths_m(lat) == (pytest.approx(per_lat, abs=0.05), pytest.approx(per_lon, abs=0.5))


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, DIRECTIONS, st.floats(1.0, 50_000.0))
def test_distance_is_better_than_a_tenth_of_a_permille_to_50_km(lat, lon, direction, distance):
    there = WGS84.Direct(lat, lon, direction, distance)
    assert distance_m(lat, lon, there["lat2"], there["lon2"]) == pytest.approx(distance, rel=1e-4, abs=1e-6)


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, DIRECTIONS, st.floats(10.0, 50_000.0))
def test_bearing_is_better_than_a_hundredth_of_a_degree_to_50_km(lat, lon, direction, distance):
    there = WGS84.Direct(lat, lon, direction, distance)
    error = wrap_longitude_deg(bearing_deg(lat, lon, there["lat2"], there["lon2"]) - direction)
    assert abs(error) < 0.01


@settings(deadline=None)
@given(LATITUDES, LONGITUDES, st.floats(-30_000.0, 30_000.0), st.floats(-30_000.0, 30_000.0))
def test_offset_is_where_distance_says_it_is(lat, lon, east, north):
    there = offset(lat, lon, east, north)
    assert distance_m(lat, lon, *there) == pytest.approx((east**2 + north**2) ** 0.5, rel=1e-6, abs=1e-3)


def test_distance_crosses_the_180th_meridian_the_short_way():
    assert distance_m(0.0, 179.999, 0.0, -179.999) == pytest.approx(222.639, abs=0.001)


def test_directions_of_the_compass():
    assert bearing_deg(52.0, 5.0, 52.001, 5.0) == pytest.approx(0.0, abs=1e-9)
    assert bearing_deg(52.0, 5.0, 51.999, 5.0) == pytest.approx(180.0, abs=1e-9)
    assert bearing_deg(0.0, 5.0, 0.0, 5.001) == pytest.approx(90.0, abs=1e-9)
    assert bearing_deg(0.0, 5.0, 0.0, 4.999) == pytest.approx(270.0, abs=1e-9)


def test_plane_and_earth_are_each_others_inverse():
    plane = LocalPlane(52.679, 5.924)
    lat, lon = plane.to_earth(300.0, -200.0)
    assert plane.to_plane(lat, lon) == (pytest.approx(300.0), pytest.approx(-200.0))
    assert distance_m(52.679, 5.924, lat, lon) == pytest.approx(360.555, rel=1e-4)

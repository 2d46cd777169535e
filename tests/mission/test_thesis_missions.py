# SPDX-License-Identifier: GPL-3.0-or-later

"""The missions of chapter 6 of the thesis: `delivery` has the facts of 6.1 and 6.3, `field-test` those of 6.2.

The thesis gives three coordinates (log of figure 6.13). All others are ours and are not checked here.
"""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import pytest

from mavproxy_handover.mission import load
from mavproxy_handover.mission.energy import released_at
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.package import MissionPackage
from tests.packages import MISSIONS

GCSA, GCSB = 251, 252
TAKE_OFF, WAYPOINT, LAND, GRIPPER = 22, 16, 21, 211
#: DO_GRIPPER: the first gripper, release
FIRST, RELEASE = 1.0, 0.0
#: latitude, longitude, altitude (m) and the zones of the log of 22 September 2023
LOG_6_3 = {
    "Area: A": (52.6794, 5.92423, 47.4, {GCSA}),
    "Area: Handover Zone": (52.6798, 5.92465, 46.1, {GCSA, GCSB}),
    "Area: B": (52.68, 5.92475, 45.8, {GCSB}),
}


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return load(MISSIONS / "delivery")


@pytest.fixture(scope="module")
def field_test() -> MissionPackage:
    return load(MISSIONS / "field-test")


def outline(package: MissionPackage, station: str) -> list[list[float]]:
    """Corners of a station's polygon (longitude, latitude), the first one not repeated."""
    features = json.loads(package.files["zones.geojson"])["features"]
    (found,) = [feature for feature in features if feature["properties"]["station"] == station]
    assert found["geometry"]["type"] == "Polygon"
    (ring,) = found["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    return ring[:-1]


def zones_at(package: MissionPackage, seq: int) -> set[int]:
    """The stations whose zones hold an item of the route."""
    item = package.route.items[seq - 1]
    return set(package.zone_finder().holding(item.lat_deg, item.lon_deg, item.alt_m))


def lands_where_it_takes_off(package: MissionPackage) -> bool:
    first, last, home = package.route.items[0], package.route.items[-1], package.route.home
    assert (first.command, last.command) == (TAKE_OFF, LAND)
    places = [(first.lat_deg, first.lon_deg), (last.lat_deg, last.lon_deg)]
    return places == [(home.lat_deg, home.lon_deg)] * 2


# --- delivery: figure 6.1, section 6.1 ---


@pytest.mark.parametrize("said", LOG_6_3)
def test_the_places_of_the_log_of_6_3_are_in_the_zones_that_the_log_names(delivery: MissionPackage, said: str) -> None:
    lat_deg, lon_deg, alt_m, zones = LOG_6_3[said]
    assert set(delivery.zone_finder().holding(lat_deg, lon_deg, alt_m)) == zones


def test_the_delivery_has_a_polygon_and_a_rectangle(delivery: MissionPackage) -> None:
    assert len(outline(delivery, "GCSA")) == 8
    corners = outline(delivery, "GCSB")
    assert len(corners) == 4
    west, east = min(lon for lon, _lat in corners), max(lon for lon, _lat in corners)
    south, north = min(lat for _lon, lat in corners), max(lat for _lon, lat in corners)
    assert corners == [[west, south], [east, south], [east, north], [west, north]]


def test_the_delivery_crosses_the_region_four_times(delivery: MissionPackage) -> None:
    walk = delivery.simulate()
    assert walk.commanders == (GCSA, GCSB, GCSA, GCSB, GCSA)
    assert [handover.seq for handover in walk.handovers] == [3, 5, 7, 12]
    assert walk.gaps == ()


def test_the_delivery_takes_off_and_lands_at_one_place_in_zone_a(delivery: MissionPackage) -> None:
    assert lands_where_it_takes_off(delivery)
    assert zones_at(delivery, 1) == {GCSA}


def test_waypoint_8_of_the_delivery_is_its_delivery_point_and_the_gripper_opens_there(delivery: MissionPackage) -> None:
    commands = [item.command for item in delivery.route.items]
    assert commands == [TAKE_OFF, *[WAYPOINT] * 7, GRIPPER, *[WAYPOINT] * 4, LAND]
    assert delivery.delivery_waypoint == 8
    point, gripper = delivery.route.items[7:9]
    assert (point.seq, point.param1, point.alt_m) == (8, 10.0, 15.0), "it hovers for 10 s, 15 m above home"
    assert zones_at(delivery, 8) == {GCSB}
    assert (gripper.seq, gripper.param1, gripper.param2) == (9, FIRST, RELEASE)
    assert released_at(delivery.route) == 9, "the energy is counted without the parcel from there"


def test_waypoint_12_of_the_delivery_is_flown_after_the_fourth_crossing_and_the_flight_goes_on(
    delivery: MissionPackage,
) -> None:
    """Section 6.3: "after way point 12, the drone returned to launch due to the low battery"."""
    assert len(delivery.route.items) == 14
    assert zones_at(delivery, 12) == zones_at(delivery, 13) == {GCSA}
    beyond = [item for item in delivery.route.items if item.seq >= 12]
    metres = sum(distance_m(a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg) for a, b in pairwise(beyond))
    assert metres > 250.0, "long enough for the autopilot to notice a low battery, which takes 10 s"


# --- field-test: figure 6.9, section 6.2 ---


def test_the_field_test_has_two_polygons_and_two_crossings(field_test: MissionPackage) -> None:
    assert len(outline(field_test, "GCSA")) == 4
    assert len(outline(field_test, "GCSB")) == 4
    walk = field_test.simulate()
    assert walk.commanders == (GCSA, GCSB, GCSA)
    assert [handover.seq for handover in walk.handovers] == [4, 12]
    assert walk.gaps == ()


def test_the_field_test_takes_off_and_lands_at_one_place_in_zone_a(field_test: MissionPackage) -> None:
    assert lands_where_it_takes_off(field_test)
    assert zones_at(field_test, 1) == {GCSA}


def test_waypoint_11_of_the_field_test_is_its_delivery_point(field_test: MissionPackage) -> None:
    assert field_test.delivery_waypoint == 11
    assert field_test.route.items[10].command == WAYPOINT
    assert zones_at(field_test, 11) == {GCSB}


def test_the_field_test_goes_at_the_pace_of_a_walk(field_test: MissionPackage) -> None:
    assert field_test.cruise_speed_mps == 1.5
    spans: Any = [(item.lat_deg, item.lon_deg) for item in field_test.route.items]
    metres = sum(distance_m(*a, *b) for a, b in pairwise(spans))
    assert metres == pytest.approx(423.0, abs=3.0), "about five minutes on foot"

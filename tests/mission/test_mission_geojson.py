# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones from GeoJSON: what is read, and the words for every file that is not right."""

from __future__ import annotations

import json

import pytest

from mavproxy_handover.mission import Circle, MissionError
from mavproxy_handover.mission.geojson import read_zones

IDS = {"A": 251, "B": 252}
HOME = (0.0, 10.001)


def read(zones, detector="polygons", ids=IDS, home=HOME):
    return read_zones("zones.geojson", zones if isinstance(zones, str) else json.dumps(zones), ids, detector, home)


def refusal(zones, **options):
    with pytest.raises(MissionError) as caught:
        read(zones, **options)
    return str(caught.value)


def ring_refusal(small, ring):
    small.zones["features"][1]["geometry"]["coordinates"] = [ring]
    return refusal(small.zones)


# --- what is read ---


def test_zones_come_in_the_order_of_the_stations_with_their_system_ids(small):
    small.zones["features"].reverse()
    assert [(zone.station, zone.station_name) for zone in read(small.zones)] == [(251, "A"), (252, "B")]


def test_polygon_has_longitude_first_and_its_limits(small):
    small.zones["features"][0]["properties"].update(name="Around A", min_alt_m=10, max_alt_m=120)
    zone = read(small.zones)[0]
    assert zone.area.bounds == (10.0, -0.001, 10.004, 0.001)
    assert (zone.name, zone.min_alt_m, zone.max_alt_m) == ("Around A", 10.0, 120.0)


def test_hole_and_multipolygon_are_read(small):
    hole = small.box(10.0031, 10.0039, -0.0005, 0.0005)
    small.zones["features"][1] = small.feature(
        "B", [[small.box(10.003, 10.004), hole], [small.box(10.005, 10.006)]], "MultiPolygon"
    )
    area = read(small.zones)[1].area
    assert len(area.geoms) == 2
    assert len(area.geoms[0].interiors) == 1


def test_point_with_radius_is_a_circle(small):
    small.zones["features"] = [small.feature("A", [10.0, 0.5], "Point", radius_m=400)]
    assert read(small.zones, detector="circles", ids={"A": 251})[0].area == Circle(0.5, 10.0, 400.0)


def test_properties_of_editors_are_passed_over(small):
    small.zones["features"][0]["properties"].update({"stroke": "#f00", "fill-opacity": 0.5})
    assert len(read(small.zones)) == 2


# --- what is refused ---


def test_refuses_text_that_is_no_json():
    assert refusal("{") == (
        "zones.geojson: line 1, column 2: not JSON: Expecting property name enclosed in double quotes"
    )


def test_refuses_a_single_feature():
    assert refusal({"type": "Feature"}) == "zones.geojson: not GeoJSON of zones (allowed: a FeatureCollection)"


def test_refuses_a_feature_without_station(small):
    del small.zones["features"][1]["properties"]["station"]
    assert refusal(small.zones) == "zones.geojson: feature 2: key 'station' is missing"


def test_refuses_an_unknown_station(small):
    small.zones["features"][1]["properties"]["station"] = "C"
    assert refusal(small.zones) == "zones.geojson: feature 2 (C): unknown station 'C' (allowed: A, B)"


def test_refuses_a_second_zone_of_a_station(small):
    small.zones["features"][1]["properties"]["station"] = "A"
    assert refusal(small.zones) == (
        "zones.geojson: feature 2 (A): second zone for station 'A' (allowed: one; use a MultiPolygon for parts)"
    )


def test_refuses_a_station_without_zone(small):
    del small.zones["features"][1]
    assert refusal(small.zones) == ("zones.geojson: no zone for station 'B' (allowed: one feature for each station)")


def test_refuses_misspelt_properties(small):
    small.zones["features"][0]["properties"]["max_alt"] = 120
    assert refusal(small.zones) == (
        "zones.geojson: feature 1 (A): unknown property 'max_alt', did you mean 'max_alt_m'?"
    )


def test_refuses_an_outline_that_crosses_itself(small):
    ring = [[10.0, 0.0], [10.004, 0.004], [10.004, 0.0], [10.0, 0.004], [10.0, 0.0]]
    assert ring_refusal(small, ring) == (
        "zones.geojson: feature 2 (B): the outline crosses itself near latitude 0.002000, longitude 10.002000"
        " (allowed: a plain area)"
    )


def test_refuses_a_hole_outside_its_outline(small):
    small.zones["features"][1]["geometry"]["coordinates"].append(small.box(10.01, 10.02))
    assert refusal(small.zones).startswith("zones.geojson: feature 2 (B): a hole lies outside the outline near ")


def test_refuses_parts_that_overlap(small):
    parts = [[small.box(10.0, 10.004)], [small.box(10.002, 10.006)]]
    small.zones["features"][1] = small.feature("B", parts, "MultiPolygon")
    assert refusal(small.zones).startswith("zones.geojson: feature 2 (B): the outline crosses itself near ")


def test_refuses_an_open_ring(small):
    assert ring_refusal(small, small.box(10.0, 10.004)[:4]) == (
        "zones.geojson: feature 2 (B): the ring is not closed (the last position must repeat the first)"
    )


def test_refuses_fewer_than_three_corners(small):
    assert ring_refusal(small, [[10.0, 0.0], [10.004, 0.0], [10.0, 0.0]]) == (
        "zones.geojson: feature 2 (B): 2 corners (allowed: 3 or more)"
    )


def test_refuses_a_polygon_without_rings(small):
    small.zones["features"][1]["geometry"]["coordinates"] = []
    assert refusal(small.zones) == "zones.geojson: feature 2 (B): no ring in the polygon (allowed: 1 or more)"


def test_refuses_more_corners_than_the_finder_can_take(small):
    ring = [[10.0 + n * 1e-6, 0.0] for n in range(1000)] + [[10.0, 0.001], [10.0, 0.0]]
    assert ring_refusal(small, ring) == "zones.geojson: feature 2 (B): too many corners (allowed: at most 1000)"


def test_refuses_a_latitude_out_of_range_and_asks_whether_it_is_swapped(small):
    assert ring_refusal(small, [[10.0, 120.0]]) == (
        "zones.geojson: feature 2 (B): latitude of corner 1 is 120: swapped? Longitude comes first"
    )


def test_refuses_coordinates_that_only_make_sense_swapped(small):
    small.zones["features"][0]["geometry"]["coordinates"] = [
        [[lat, lon] for lon, lat in small.box(5.92, 5.93, 52.67, 52.68)]
    ]
    assert refusal(small.zones, home=(52.679, 5.924)) == (
        "zones.geojson: feature 1 (A): corner 1 is far from home, and near it when swapped: longitude comes first"
    )


def test_refuses_latitudes_too_near_the_pole(small):
    assert ring_refusal(small, [[10.0, 89.0]]) == (
        "zones.geojson: feature 2 (B): latitude of corner 1 is 89.0 (allowed: a number from -85 to 85)"
    )


def test_refuses_a_longitude_out_of_range(small):
    assert ring_refusal(small, [[10.0, 0.0], [190.0, 0.0]]) == (
        "zones.geojson: feature 2 (B): longitude of corner 2 is 190.0 (allowed: a number from -180 to 180)"
    )


def test_refuses_a_zone_across_the_180th_meridian(small):
    assert ring_refusal(small, [[179.0, 0.0], [-179.0, 0.0], [-179.0, 1.0], [179.0, 0.0]]) == (
        "zones.geojson: feature 2 (B): the polygon crosses the 180th meridian (allowed: a MultiPolygon cut there)"
    )


def test_refuses_a_position_of_one_number(small):
    assert ring_refusal(small, [[10.0]]) == (
        "zones.geojson: feature 2 (B): corner 1 has 1 numbers (allowed: longitude, latitude, perhaps altitude)"
    )


def test_refuses_a_number_that_is_text(small):
    assert ring_refusal(small, [["10.0", 0.0]]) == (
        "zones.geojson: feature 2 (B): longitude of corner 1 is '10.0' (allowed: a number from -180 to 180)"
    )


def test_refuses_the_geometry_of_another_detector(small):
    assert refusal(small.zones, detector="circles") == (
        "zones.geojson: feature 1 (A): geometry of detector 'circles' is 'Polygon' (allowed: Point)"
    )


def test_refuses_a_line(small):
    small.zones["features"][0]["geometry"]["type"] = "LineString"
    assert refusal(small.zones) == (
        "zones.geojson: feature 1 (A): geometry of detector 'polygons' is 'LineString' (allowed: Polygon, MultiPolygon)"
    )


def test_refuses_a_circle_without_radius(small):
    small.zones["features"] = [small.feature("A", [10.0, 0.5], "Point")]
    assert refusal(small.zones, detector="circles") == "zones.geojson: feature 1 (A): key 'radius_m' is missing"


def test_refuses_a_circle_of_no_size(small):
    small.zones["features"] = [small.feature("A", [10.0, 0.5], "Point", radius_m=0)]
    assert refusal(small.zones, detector="circles") == (
        "zones.geojson: feature 1 (A): radius_m is 0 (allowed: a number from 1 to 100000)"
    )


def test_refuses_a_radius_on_a_polygon(small):
    small.zones["features"][0]["properties"]["radius_m"] = 100
    assert refusal(small.zones) == "zones.geojson: feature 1 (A): radius_m on a Polygon (allowed: on a Point)"


def test_refuses_altitude_limits_the_wrong_way_round(small):
    small.zones["features"][0]["properties"].update(min_alt_m=100, max_alt_m=50)
    assert refusal(small.zones) == "zones.geojson: feature 1 (A): min_alt_m is 100, not below max_alt_m 50"

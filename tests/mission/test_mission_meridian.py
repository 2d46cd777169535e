# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission across the 180th meridian is the same mission as anywhere else: there are people in Fiji and Chukotka."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Polygon

from mavproxy_handover.cli.check import main
from mavproxy_handover.mission import load
from mavproxy_handover.mission.check import check
from mavproxy_handover.mission.drawing import degrees
from mavproxy_handover.mission.fence import outside_fence
from mavproxy_handover.mission.geodesy import beside_deg, wrap_longitude_deg
from mavproxy_handover.mission.picture import draw
from mavproxy_handover.mission.plan import FencePolygon
from mavproxy_handover.mission.zones import Circle, Zone, ZoneFinder, beside, overlap

#: the small mission is moved so that the meridian is in the handover region, in either zone, at home
SHIFTS = [169.997, 169.9985, 169.9955, 169.999, -190.001]
EAST = 90.0


def move(small: Any, by: float) -> None:
    """Everything with a place goes that far east."""
    for item in small.items:
        item["params"][5] = wrap_longitude_deg(item["params"][5] + by)
    home = small.plan["mission"]["plannedHomePosition"]
    home[1] = wrap_longitude_deg(home[1] + by)
    for point in small.plan["rallyPoints"]["points"]:
        point[1] = wrap_longitude_deg(point[1] + by)
    for polygon in small.plan["geoFence"]["polygons"]:
        for corner in polygon["polygon"]:
            corner[1] = wrap_longitude_deg(corner[1] + by)
    for feature in small.zones["features"]:
        geometry = feature["geometry"]
        if geometry["type"] == "Point":
            geometry["coordinates"][0] = wrap_longitude_deg(geometry["coordinates"][0] + by)
        else:
            (ring,) = geometry["coordinates"]
            west, east = (beside_deg(ring[corner][0] + by, 180.0) for corner in (0, 1))
            if west < 180.0 < east:  # as RFC 7946 wants it
                geometry["type"] = "MultiPolygon"
                geometry["coordinates"] = [[small.box(west, 180.0)], [small.box(-180.0, east - 360.0)]]
            else:
                geometry["coordinates"] = [small.box(wrap_longitude_deg(west), wrap_longitude_deg(east))]


def make(small: Any, detector: str) -> Any:
    if detector == "circles":
        small.toml = small.toml.replace('"polygons"', '"circles"')
        small.zones["features"] = [
            small.feature("A", [10.002, 0.0], "Point", radius_m=300),
            small.feature("B", [10.004, 0.0], "Point", radius_m=300),
        ]
    elif detector == "waypoints":
        small.toml = small.toml.replace('"polygons"', '"waypoints"').replace('zones = "zones.geojson"\n', "")
        small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 1\ncorridor_m = 150.0")
        small.toml = small.toml.replace("sysid = 251", "sysid = 251\nwaypoints = [1, 2]")
        small.toml = small.toml.replace("sysid = 252", "sysid = 252\nwaypoints = [2, 3]")
    fence = [[0.01, 9.99], [0.01, 10.02], [-0.01, 10.02], [-0.01, 9.99]]
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": fence, "version": 1}]
    return small


def story(folder: Path) -> list[Any]:
    """What the check finds, without places."""
    report = check(load(folder))
    words = [re.sub(r"\d+\.\d{5} [NS] \d+\.\d{5} [EW]", "PLACE", f"{f.severity} {f.text}") for f in report.findings]
    walk = report.simulation
    return [
        words,
        walk.commanders,
        [round(handover.overlap_s, 1) for handover in walk.handovers],
        [round(handover.distance_along_m) for handover in walk.handovers],
        len(walk.gaps),
    ]


@pytest.mark.parametrize("by", SHIFTS)
@pytest.mark.parametrize("detector", ["circles", "polygons", "waypoints"])
def test_the_check_says_the_same_of_it_as_of_the_mission_elsewhere(small: Any, detector: str, by: float) -> None:
    make(small, detector)
    elsewhere = story(small.write())
    assert elsewhere[1] == (251, 252)
    move(small, by)
    assert story(small.write()) == elsewhere


@pytest.mark.parametrize("detector", ["circles", "polygons", "waypoints"])
def test_its_map_is_drawn(small: Any, detector: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    move(make(small, detector), SHIFTS[0])
    assert main([str(small.write()), "--map", str(tmp_path / "map.svg")]) == 0, capsys.readouterr()
    assert (tmp_path / "map.svg").stat().st_size > 10_000
    draw(load(small.folder), tmp_path / "map.png")


def test_two_circles_that_meet_there_are_checked_and_not_a_fault(
    small: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """What shapely made of their outlines was a TopologyException."""
    move(make(small, "circles"), 169.997)
    assert main([str(small.write())]) == 0
    assert "overlaps no other zone" not in capsys.readouterr().out


def zone(lat: float, lon: float, radius: float) -> Zone:
    return Zone(251, "A", Circle(lat, wrap_longitude_deg(lon), radius))


@settings(deadline=None)
@given(
    st.floats(-80.0, 80.0),
    st.floats(-0.5, 0.5),
    st.tuples(st.floats(-0.2, 0.2), st.floats(-0.5, 0.5)),
    st.tuples(st.floats(1.0, 50_000.0), st.floats(1.0, 50_000.0)),
)
def test_circles_overlap_there_as_they_do_elsewhere(
    lat: float, lon: float, away: tuple[float, float], radii: tuple[float, float]
) -> None:
    def region(middle: float) -> Polygon | MultiPolygon:
        return overlap(zone(lat, middle + lon, radii[0]), zone(lat + away[0], middle + lon + away[1], radii[1]))

    assert region(180.0).area == pytest.approx(region(10.0).area, rel=1e-6, abs=1e-10)


def cut(south: float = 0.0) -> MultiPolygon:
    """A zone from longitude 179.99 to -179.98, cut at the meridian."""
    north = south + 0.01
    return MultiPolygon(
        [
            Polygon([(179.99, south), (180.0, south), (180.0, north), (179.99, north)]),
            Polygon([(-180.0, south), (-179.98, south), (-179.98, north), (-180.0, north)]),
        ]
    )


@pytest.mark.parametrize("lon", [179.0, -179.0, 180.0, -180.0])
def test_a_zone_that_the_meridian_cuts_in_two_is_one(lon: float) -> None:
    area = beside(cut(), lon)
    assert isinstance(area, Polygon)
    assert area.area == pytest.approx(0.03 * 0.01)
    west, _, east, _ = area.bounds
    assert (west, east) == (pytest.approx(beside_deg(179.99, lon)), pytest.approx(west + 0.03))


def test_the_cut_is_no_border(small: Any) -> None:
    """Before, an aircraft that flew over the meridian left its zone there, for a moment."""
    move(make(small, "polygons"), 169.998)  # zone A from 179.998 to -179.998, the route along its middle
    package = load(small.write())
    finder = ZoneFinder([package.zones[0]])
    margins = []
    for step in range(-15, 16):
        (fact,) = finder.facts(0.0, wrap_longitude_deg(180.0 + step * 1e-4), EAST, 10.0)
        margins.append(fact.margin_m)
        assert fact.exit_s == pytest.approx((0.002 - step * 1e-4) * 111319.5 / 10.0, abs=0.1)
    assert min(margins) == pytest.approx(0.0005 * 111319.5, abs=0.5)
    assert max(margins) == pytest.approx(0.001 * 110574.3, abs=0.5)


def test_a_fence_across_it_holds_what_is_in_it() -> None:
    fence = FencePolygon(True, ((0.01, 179.99), (0.01, -179.99), (-0.01, -179.99), (-0.01, 179.99)))
    inside, outside = (179.995, -179.995, 180.0, -180.0), (179.98, -179.98, 0.0, 10.0, -90.0)
    assert [outside_fence([fence], 0.0, lon) for lon in inside] == [False] * 4
    assert [outside_fence([fence], 0.0, lon) for lon in outside] == [True] * 5
    assert [outside_fence([replace(fence, inclusion=False)], 0.0, lon) for lon in inside] == [True] * 4


@pytest.mark.parametrize(
    ("lon", "middle", "same"),
    [
        (10.0, 20.0, 10.0),
        (-179.9, 179.9, 180.1),
        (179.9, -179.9, -180.1),
        (180.0, 180.0, 180.0),
        (-180.0, 180.0, 180.0),
        (-10.0, 179.0, 350.0),
        (0.1, 180.2, 360.1),
    ],
)
def test_a_longitude_is_counted_to_the_side_of_another(lon: float, middle: float, same: float) -> None:
    assert beside_deg(lon, middle) == pytest.approx(same)


def test_the_map_is_labelled_with_longitudes_that_exist() -> None:
    assert degrees([179.9, 180.0, 180.1], "EW") == ["179.9° E", "180.0° W", "179.9° W"]


def corners(area: Polygon | MultiPolygon) -> Iterator[tuple[float, float]]:
    for part in getattr(area, "geoms", [area]):
        yield from part.exterior.coords


def test_a_circle_goes_on_beyond_180() -> None:
    for lon in (179.999, -179.999):
        lons = [corner[0] for corner in corners(Circle(0.0, lon, 500.0).outline())]
        assert max(lons) - min(lons) == pytest.approx(1000.0 / 111319.5, rel=1e-3)
        assert Circle(0.0, lon, 500.0).outline().is_valid

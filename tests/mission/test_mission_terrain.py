# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of the ground: the file, the highest ground along a way, and what the check and the places make of it.

The small mission flies along the equator from longitude 10.001 to 10.005 at 30 m, with home at the first and a rally
point of 30 m at 10.0035. A hill stands at 10.003.
"""

from __future__ import annotations

import math

import pytest

from mavproxy_handover.mission import MissionError, load
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.package import from_bytes
from mavproxy_handover.mission.return_paths import PlaceFinder
from mavproxy_handover.mission.terrain import Relief, read_terrain
from tests.mission.test_mission_kinds import hovering

#: cells of 0.001 degrees, their middles at longitude 10.000 to 10.006 and latitude -0.001 to 0.001
HILL = """ncols 7
nrows 3
xllcenter 10.0
yllcenter -0.001
cellsize 0.001
NODATA_value -9999
100 100 100 {north} 100 100 100
100 100 100 {hill} 100 100 100
100 100 100 100 100 100 -9999
"""


def hill(height: float = 100.0, north: float = 100.0) -> str:
    return HILL.format(hill=height, north=north)


def with_hill(small, height, north=100.0):
    small.toml = 'terrain = "terrain.asc"\n' + small.toml
    folder = small.write()
    (folder / "terrain.asc").write_text(hill(height, north))
    return load(folder)


def found(package, severity):
    texts = [finding.text for finding in check(package).findings if finding.severity is severity]
    return [text for text in texts if "ground" in text]


# --- the file ---


def test_heights_are_where_the_header_says():
    grid = read_terrain("terrain.asc", hill(160.0, north=130.0))
    assert grid.highest_m((0.0, 10.003), (0.0, 10.003)) == 160.0
    assert grid.highest_m((0.001, 10.003), (0.001, 10.003)) == 130.0
    assert grid.highest_m((0.0, 10.001), (0.0, 10.002)) == 100.0
    assert grid.highest_m((-0.001, 10.001), (-0.001, 10.005)) == 100.0


def test_a_corner_is_half_a_cell_away_from_the_middle():
    text = hill(160.0).replace("xllcenter 10.0", "xllcorner 9.9995").replace("yllcenter -0.001", "YLLCORNER -0.0015")
    assert read_terrain("t.asc", text).highest_m((0.0, 10.003), (0.0, 10.003)) == 160.0


def test_between_cells_the_highest_around_counts():
    grid = read_terrain("terrain.asc", hill(160.0))
    for lat, lon in ((0.0004, 10.0026), (-0.0004, 10.0034), (0.0009, 10.0021)):
        assert grid.highest_m((lat, lon), (lat, lon)) == 160.0
    assert grid.lowest_m((0.0004, 10.0026)) == 100.0


def test_a_way_meets_the_hill_that_it_crosses_and_no_other():
    grid = read_terrain("terrain.asc", hill(160.0))
    assert grid.highest_m((0.0, 10.001), (0.0, 10.005)) == 160.0
    assert grid.highest_m((0.0, 10.005), (0.0, 10.001)) == 160.0
    assert grid.highest_m((-0.001, 10.001), (0.001, 10.005)) == 160.0
    assert grid.highest_m((0.0, 10.0045), (0.0, 10.005)) == 100.0


def test_what_is_outside_or_has_no_value_is_not_known():
    grid = read_terrain("terrain.asc", hill(160.0))
    assert grid.highest_m((-0.001, 10.006), (-0.001, 10.006)) is None
    assert grid.highest_m((1.0, 10.003), (2.0, 10.003)) is None
    # what is known of a way counts
    assert grid.highest_m((0.0, 9.0), (0.0, 11.0)) == 160.0
    assert grid.lowest_m((1.0, 10.0)) is None


def test_a_grid_across_the_180th_meridian_is_met_from_both_sides():
    grid = read_terrain("terrain.asc", hill(160.0).replace("xllcenter 10.0", "xllcenter 179.997"))
    assert grid.highest_m((0.0, -179.9995), (0.0, 179.9985)) == 160.0
    assert grid.highest_m((0.0, 179.9985), (0.0, -179.9995)) == 160.0
    assert grid.highest_m((0.0, -179.998), (0.0, -179.9985)) == 100.0


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("ncols 7", "ncols 8", "line 7: 7 heights, ncols is 8"),
        ("nrows 3", "nrows 4", "3 rows of heights, nrows is 4"),
        ("ncols 7", "", "ncols is None"),
        ("ncols 7", "ncols seven", "line 1: 'seven' is no number"),
        ("ncols 7", "ncols 7.5", "ncols is 7.5"),
        ("ncols 7", "ncols 1", "ncols is 1.0"),
        ("ncols 7", "ncols 99999", "99999 x 3 cells (allowed: at most 100000)"),
        ("ncols 7", "ncols 7\nncols 7", "line 2: a name and one number, each name once"),
        ("cellsize 0.001", "", "cellsize is None"),
        ("cellsize 0.001", "cellsize 30", "cellsize is 30.0"),
        ("xllcenter 10.0", "xllcenter 10.0\nxllcorner 10.0", "one of xllcorner and xllcenter is wanted"),
        ("xllcenter 10.0", "xllcenter 463000", "xll is 463000: a grid in degrees"),
        ("yllcenter -0.001", "yllcenter 5800000", "yll is 5.8e+06: a grid in degrees"),
        ("yllcenter -0.001", "yllcenter 90", "ends beyond the pole"),
        ("160", "nan", "line 8: 'nan' is no number"),
        ("160", "1e999", "line 8: '1e999' is no number"),
        ("160", "99999", "line 8: a height of 99999 m"),
        ("160", "high", "line 8: 'high' is no number"),
    ],
)
def test_a_file_that_is_none_is_named_with_the_line(old, new, text):
    source = hill(160)
    assert source.count(old) == 1
    changed = (
        source.replace(f"{old}\n", f"{new}\n" if new else "") if f"{old}\n" in source else source.replace(old, new)
    )
    with pytest.raises(MissionError) as raised:
        read_terrain("terrain.asc", changed)
    assert str(raised.value).startswith("terrain.asc: ")
    assert text in str(raised.value)


@pytest.mark.parametrize("text", ["", "\n", "ncols", "hello", "\x00", "1 2 3\n" * 4])
def test_no_text_breaks_the_reader(text):
    with pytest.raises(MissionError):
        read_terrain("terrain.asc", text)


# --- the package ---


def test_the_heights_travel_with_the_package(small):
    package = with_hill(small, 160.0)
    assert "terrain.asc" in package.files
    received = from_bytes(package.to_bytes())
    assert received == package
    relief = received.relief()
    assert relief is not None
    # the ground at home is 100 m in the grid, and it is as high in the plan
    assert relief.above_m((0.0, 10.001), (0.0, 10.005), 70.0) == 10.0


def test_heights_are_counted_from_home_whatever_they_are_counted_from(small):
    grid = read_terrain("terrain.asc", hill(160.0))
    for home in (100.0, 0.0, 400.0):
        relief = Relief(grid, home, home)
        assert relief.above_m((0.0, 10.001), (0.0, 10.005), 70.0) == 70.0 - (160.0 - home)
    assert Relief(grid, 0.0, 0.0).above_m((1.0, 10.0), (1.0, 11.0), 5.0) == math.inf
    package = with_hill(small, 160.0)
    moved = package.relief((0.0, 10.003))
    assert moved is not None
    assert moved.home_m == 160.0


def test_without_a_file_nothing_is_known(small):
    package = load(small.write())
    assert package.terrain is None
    assert package.relief() is None
    assert found(package, Severity.WARNING) == found(package, Severity.ERROR) == []


# --- the check ---


def test_a_way_well_above_the_ground_is_no_finding(small):
    package = with_hill(small, 115.0)
    assert found(package, Severity.WARNING) == found(package, Severity.ERROR) == []


def test_a_way_near_the_ground_is_a_warning_and_one_through_it_an_error(small):
    package = with_hill(small, 125.0)
    assert found(package, Severity.WARNING)[0] == "the way to item 2 (NAV_WAYPOINT) is 5 m above the ground"
    small.toml = small.toml.split("\n", 1)[1]
    package = with_hill(small, 140.0)
    assert found(package, Severity.ERROR) == ["the way to item 2 (NAV_WAYPOINT) is 10 m below the ground"]


def test_a_return_that_is_near_the_ground_is_a_warning(small):
    # home lies behind the hill, the rally point on its slope
    package = with_hill(small, 125.0)
    assert "no return from item 2 is 10 m above the ground: to landing it is" not in str(
        found(package, Severity.WARNING)
    )
    del small.items[2]
    small.toml = small.toml.split("\n", 1)[1]
    package = with_hill(small, 125.0)
    assert "no return from item 2 is 10 m above the ground: to rally 1 it is 5 m" in found(package, Severity.WARNING)


def test_heights_that_do_not_reach_to_home_are_a_warning(small):
    folder = small.write()
    small.toml = 'terrain = "terrain.asc"\n' + small.toml
    folder = small.write()
    (folder / "terrain.asc").write_text(hill(160.0).replace("xllcenter 10.0", "xllcenter 10.003"))
    assert any("do not reach to home" in text for text in found(load(folder), Severity.WARNING))


@pytest.mark.parametrize("winged", [False, True])
def test_a_return_on_wings_leads_down_to_its_height_and_may_meet_the_ground_there(small, winged):
    """A copter stays at the 150 m that it flies at; ArduPlane comes down to 100 m, and the hill is 95 m high."""
    if winged:
        hovering(small)
    for item in small.items[:2]:
        item["Altitude"] = item["params"][6] = 150
    small.items[2].update(command=20, Altitude=0, params=[0, 0, 0, 0, 0, 0, 0])
    texts = [text for text in found(with_hill(small, 195.0), Severity.WARNING) if "no return from item 2" in text]
    assert texts == (["no return from item 2 is 10 m above the ground: to rally 1 it is 5 m"] if winged else [])


# --- the places ---


def test_a_place_behind_the_hill_is_not_clear(small):
    package = with_hill(small, 145.0)
    finder = PlaceFinder(package.zones, Fence(()), package.relief())
    assert not finder.evaluate((0.0, 10.005), (0.0, 10.001), 40.0).way_clear
    assert finder.evaluate((0.0, 10.005), (0.0, 10.001), 55.0).way_clear
    assert finder.evaluate((0.0, 10.005), (0.0, 10.0045), 40.0).way_clear
    assert PlaceFinder(package.zones, Fence(())).evaluate((0.0, 10.005), (0.0, 10.001), 40.0).way_clear

# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission package at another home: the same flight there, or a clear refusal."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from geographiclib.geodesic import Geodesic
from shapely.geometry import shape

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.items import COMMANDS
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FenceCircle, FencePolygon, read_route
from mavproxy_handover.tools.resources import shipped
from sitl.main import main
from sitl.script.moved import Place, moved, read_place
from sitl.script.places import SetupError

#: all that ship, except the one whose heights of the ground are of where it is
MISSIONS = sorted({path.parent.name for path in shipped("missions").glob("*/mission.toml")} - {"hills"})
#: south of the equator and west of Greenwich; across the 180th meridian, both ways; far north; on the equator
PLACES = (Place(-33.45, -70.66), Place(-16.84, 179.9995), Place(12.0, -179.9995), Place(78.2, 15.6), Place(0.0, 5.0))


def _load(name: str) -> MissionPackage:
    return packages.load(shipped("missions") / name)


def _away_m(package: MissionPackage) -> list[float]:
    """From home to every item with a place, every rally point and every part of the fence, by Karney's algorithm."""
    route = package.route
    spots = [(item.lat_deg, item.lon_deg) for item in route.items if COMMANDS[item.command].located]
    spots += [(point.lat_deg, point.lon_deg) for point in route.rally]
    for part in route.fence:
        spots += part.corners if isinstance(part, FencePolygon) else [(part.lat_deg, part.lon_deg)]
    home = route.home
    return [Geodesic.WGS84.Inverse(home.lat_deg, home.lon_deg, *spot)["s12"] for spot in spots]


@pytest.mark.parametrize("place", PLACES, ids=lambda place: f"{place.lat_deg:g} {place.lon_deg:g}")
@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_is_the_same_flight_anywhere(name: str, place: Place) -> None:
    package = _load(name)
    there = moved(package, place)
    home = there.route.home
    assert (home.lat_deg, home.lon_deg) == (place.lat_deg, place.lon_deg)
    assert home.alt_m == package.route.home.alt_m
    assert there.digest != package.digest
    assert packages.from_bytes(there.to_bytes()) == there
    assert _away_m(there) == pytest.approx(_away_m(package), rel=1e-3, abs=0.01)
    here, walked = package.simulate(), there.simulate()
    assert walked.commanders == here.commanders
    assert walked.duration_s == pytest.approx(here.duration_s, rel=5e-3)
    assert len(there.route.fence) == len(package.route.fence)
    assert there.stations == package.stations
    assert there.gaps == package.gaps


def test_a_zone_is_cut_at_the_180th_meridian_and_put_together_again_away_from_it() -> None:
    package = _load("delivery")
    kinds = {feature["geometry"]["type"] for feature in json.loads(package.files["zones.geojson"])["features"]}
    assert kinds == {"Polygon"}
    across = moved(package, Place(-16.84, 179.9995))
    areas = [feature["geometry"] for feature in json.loads(across.files["zones.geojson"])["features"]]
    cut = [shape(area) for area in areas if area["type"] == "MultiPolygon"]
    assert cut
    assert all((area.bounds[0], area.bounds[2], len(area.geoms)) == (-180.0, 180.0, 2) for area in cut)
    back = moved(_load("meridian"), Place(52.679, 5.924))
    areas = [feature["geometry"] for feature in json.loads(back.files["zones.geojson"])["features"]]
    assert {area["type"] for area in areas} == {"Polygon"}
    assert all(len(area["coordinates"][0]) <= 7 for area in areas), "no crumbs at the seam"


_WAYPOINTS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t52.0\t6.0\t20\t1
1\t0\t3\t22\t0\t0\t0\t0\t52.0\t6.0\t30\t1
2\t0\t0\t16\t0\t0\t0\t0\t52.001\t6.0\t60\t1
3\t0\t2\t178\t1\t8\t-1\t0\t0\t0\t0\t1
4\t0\t3\t16\t0\t0\t0\t0\t52.001\t6.001\t40\t1
5\t0\t3\t21\t0\t0\t0\t0\t0\t0\t0\t1
"""


def test_the_older_format_and_heights_above_the_sea_go_with_home(tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(
        'name = "old"\ndetector = "circles"\nroute = "r.waypoints"\nzones = "z.geojson"\nexpected_handovers = 0\n'
        '[[stations]]\nname = "GCSA"\nsysid = 251\n'
    )
    (tmp_path / "r.waypoints").write_text(_WAYPOINTS)
    circle = {"type": "Point", "coordinates": [6.0, 52.0]}
    feature = {"type": "Feature", "properties": {"station": "GCSA", "radius_m": 500}, "geometry": circle}
    (tmp_path / "z.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    package = packages.load(tmp_path)
    there = moved(package, Place(-10.0, 20.0, 1500.0))
    assert there.route.home.alt_m == 1500.0
    assert [item.alt_m for item in there.route.items] == [30.0, 1540.0, 0.0, 40.0, 0.0]
    assert there.route.items[2] == package.route.items[2]
    assert there.route.items[4] == package.route.items[4], "a landing wherever it is then"
    assert _away_m(there)[:3] == pytest.approx(_away_m(package)[:3], rel=1e-3)


def test_the_waypoints_of_a_scan_go_along() -> None:
    package = _load("delivery")
    texts = {name: data.decode() for name, data in package.files.items()}
    plan = json.loads(texts["delivery.plan"])
    items = plan["mission"]["items"]
    scan = {"type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": {"Items": items[1:3]}}
    plan["mission"]["items"] = [items[0], scan, *items[3:]]
    texts["delivery.plan"] = json.dumps(plan)
    there = moved(packages.from_texts(texts, "delivery"), PLACES[0])
    assert _away_m(there) == pytest.approx(_away_m(package), rel=1e-3, abs=0.01)


def test_a_fence_of_circles_goes_along() -> None:
    package = _load("delivery")
    plan = json.loads(package.files["delivery.plan"])
    plan["geoFence"]["circles"] = [
        {"inclusion": False, "version": 1, "circle": {"center": [52.6777, 5.9182], "radius": 40.0}}
    ]
    plan["geoFence"]["breachReturn"] = [52.6767, 5.9222, 30]
    texts = {name: data.decode() for name, data in package.files.items()}
    package = packages.from_texts({**texts, "delivery.plan": json.dumps(plan)}, "delivery")
    there = moved(package, Place(-33.45, -70.66))
    circle = there.route.fence[-1]
    assert isinstance(circle, FenceCircle)
    assert (circle.inclusion, circle.radius_m) == (False, 40.0)
    assert _away_m(there) == pytest.approx(_away_m(package), rel=1e-3)
    assert json.loads(there.files["delivery.plan"])["geoFence"]["breachReturn"] == pytest.approx([-33.45, -70.66, 30])
    assert read_route("delivery.plan", there.files["delivery.plan"].decode()).fence == there.route.fence


def test_heights_of_the_ground_keep_a_mission_where_it_is() -> None:
    package = replace(_load("delivery"), terrain=object())  # type: ignore[arg-type]
    with pytest.raises(SetupError, match="cannot be flown elsewhere"):
        moved(package, PLACES[0])


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("-33.45,-70.66", Place(-33.45, -70.66)),
        (" 52.6, 5.9 , 12.5", Place(52.6, 5.9, 12.5)),
        ("0,180,0,270", Place(0.0, 180.0, 0.0, 270.0)),
    ],
)
def test_a_place_as_it_is_typed(text: str, place: Place) -> None:
    assert read_place(text) == place


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("52.6", "1 numbers"),
        ("1,2,3,4,5", "5 numbers"),
        ("here,5.9", "latitude is 'here'"),
        ("52.6,", "longitude is ''"),
        ("0,0", "an item means wherever the aircraft is"),
        ("85,0", r"latitude 85 \(allowed: -80 to 80\)"),
        ("nan,0", "latitude nan"),
        ("52,181", "longitude 181"),
        ("52,5,1e9", "altitude 1e"),
        ("52,5,0,361", "heading 361"),
    ],
)
def test_what_is_no_place_is_told(text: str, said: str) -> None:
    with pytest.raises(SetupError, match=said):
        read_place(text)


def test_the_command_line_takes_a_place_in_the_south_and_refuses_what_is_none(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--home", "-33.45,x"]) == 2
    assert "longitude is 'x'" in capsys.readouterr().err
    assert main(["--scenario", "two-vehicles", "--home", "-33.45,-70.66"]) == 2
    assert "scenario two-vehicles has several aircraft" in capsys.readouterr().err

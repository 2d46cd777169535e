# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover init mission`: what is written from a plan and zones, what is asked, and what each fault says."""

from __future__ import annotations

import argparse
import json
import os
import pty
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.cli import init_mission
from mavproxy_handover.cli.check import main as check_main
from mavproxy_handover.cli.init import main as init_main
from mavproxy_handover.cli.keys import main as keys_main
from mavproxy_handover.config.files import load_station, load_vehicle
from mavproxy_handover.mission import Circle
from mavproxy_handover.mission import package as packages

DATA = Path(__file__).resolve().parents[1] / "data" / "init"
MISSIONS = Path(__file__).resolve().parents[2] / "missions"
#: south, west, north, east of two zones that overlap on the survey's route
FARM, DIKE = (52.2087, 5.9486, 52.2120, 5.9550), (52.2087, 5.9523, 52.2120, 5.9585)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with survey.plan and stations.kml, and the user in it."""
    for path in DATA.iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Typed:
    """What a command line gave back."""

    def __init__(self, capsys: pytest.CaptureFixture[str], line: str) -> None:
        self.code = init_main(["mission", *line.split()])
        self.out, self.err = capsys.readouterr()

    @property
    def faults(self) -> list[str]:
        assert self.code == 2
        assert self.out == ""
        lines = self.err.splitlines()
        assert all(line.startswith("handover init: ") for line in lines)
        return [line.removeprefix("handover init: ") for line in lines]


@pytest.fixture
def typed(capsys: pytest.CaptureFixture[str]) -> Callable[[str], Typed]:
    return lambda line: Typed(capsys, line)


def box(bounds: tuple[float, float, float, float]) -> list[list[float]]:
    south, west, north, east = bounds
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def zones(**bounds: tuple[float, float, float, float]) -> str:
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": {"type": "Polygon", "coordinates": [box(each)]}}
        for name, each in bounds.items()
    ]
    Path("zones.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return "zones.geojson"


def plan(name: str = "survey.plan", **mission: Any) -> dict[str, Any]:
    """Change the mission of the plan; None removes a key."""
    data: dict[str, Any] = json.loads(Path("survey.plan").read_text(encoding="utf-8"))
    data["mission"] = {key: value for key, value in (data["mission"] | mission).items() if value is not None}
    Path(name).write_text(json.dumps(data), encoding="utf-8")
    return data


def with_fence(**fence: Any) -> None:
    data = json.loads(Path("survey.plan").read_text(encoding="utf-8"))
    data["geoFence"] = {"version": 2, "polygons": [], "circles": [], **fence}
    Path("survey.plan").write_text(json.dumps(data), encoding="utf-8")


def fence_polygon(bounds: tuple[float, float, float, float], inclusion: bool = True) -> dict[str, Any]:
    return {"inclusion": inclusion, "polygon": [[lat, lon] for lon, lat in box(bounds)[:-1]], "version": 1}


def waypoints() -> None:
    lines = ["QGC WPL 110", "0\t1\t0\t16\t0\t0\t0\t0\t52.21\t5.95\t42\t1",
             "1\t0\t3\t22\t0\t0\t0\t0\t52.21\t5.95\t30\t1",
             "2\t0\t3\t16\t0\t0\t0\t0\t52.211\t5.957\t30\t1", "3\t0\t3\t20\t0\t0\t0\t0\t0\t0\t0\t1"]  # fmt: skip
    Path("p.waypoints").write_text("\n".join(lines) + "\n", encoding="utf-8")


# --- what is written ---


def test_a_plan_and_a_kml_make_a_mission_that_the_check_passes(typed: Callable[[str], Typed]) -> None:
    done = typed("--plan survey.plan --zones stations.kml")
    assert (done.code, done.err) == (0, "")
    names = {str(path.relative_to("survey")) for path in Path("survey").rglob("*") if path.is_file()}
    assert names == {
        "handover.toml", "Farm.toml", "Dike-house.toml", "mission/mission.toml", "mission/survey.plan",
        "mission/zones.geojson",
    }  # fmt: skip
    assert Path("survey/mission/survey.plan").read_bytes() == (DATA / "survey.plan").read_bytes()
    package = packages.load("survey/mission")
    assert (package.name, package.profile.name, package.detector) == ("survey", "copter", "polygons")
    assert [(each.name, each.sysid) for each in package.stations] == [("Farm", 251), ("Dike-house", 252)]
    assert [zone.name for zone in package.zones] == ["", "Dike house"]
    assert (package.expected_handovers, package.cruise_speed_mps) == (2, 8.0)
    assert dict(package.policies) == {"on_out_of_coverage": "return"}
    text = Path("survey/mission/mission.toml").read_text(encoding="utf-8")
    assert "expected_handovers = 2          # commanders along the route: Farm Dike-house Farm\n" in text
    for line in (
        "zone        Dike-house: stations.kml: placemark 2 (Dike house)",
        "speed       8 m/s, speed of the plan",
        "returns     home, rally 1",
        "commanders  Farm -> Dike-house -> Farm",
        "check passed: 0 errors, 0 warnings",
        "  cd survey",
        "  handover keys make Farm Dike-house",
        "  handover sim --mission mission",
        "  handover.toml, keys/Farm.key, keys/Dike-house.key  to the companion computer",
        "  Farm.toml, keys/Farm.key, keys/ground.key, mission/  to Farm",
        "  Dike-house.toml, keys/Dike-house.key, keys/ground.key  to Dike-house",
    ):
        assert f"{line}\n" in done.out
    assert check_main(["survey/mission"]) == 0


def test_the_configurations_fit_together_and_their_addresses_are_no_real_ones(typed: Callable[[str], Typed]) -> None:
    done = typed("--plan survey.plan --zones stations.kml --out out/here --vehicle-name d-2 --vehicle-sysid 252")
    vehicle = load_vehicle(Path("out/here/handover.toml"))
    assert (vehicle.name, vehicle.sysid, vehicle.parent) == ("d-2", 252, 251)
    assert [(each.station.name, each.station.sysid, each.links) for each in vehicle.stations] == [
        ("Farm", 251, ("udpout:192.0.2.11:14551",)),
        ("Dike-house", 253, ("udpout:192.0.2.12:14552",)),
    ]
    farm, dike = (load_station(Path(f"out/here/{name}.toml")) for name in ("Farm", "Dike-house"))
    assert [each.vehicles[0].sysid for each in (farm, dike)] == [252, 252]
    assert (farm.vehicles[0].mission, dike.vehicles[0].mission) == (Path("out/here/mission").resolve(), None)
    assert (farm.ground, dike.ground) == ("udpin:0.0.0.0:15551", "udpin:0.0.0.0:15552")
    assert [(each.station.name, each.link) for each in farm.peers] == [("Dike-house", "udpout:192.0.2.12:15552")]
    assert [(each.station.name, each.link) for each in dike.peers] == [("Farm", "udpout:192.0.2.11:15551")]
    placeholders = (
        "Farm 192.0.2.11, Dike-house 192.0.2.12 are placeholders: put real ones in their place before a flight"
    )
    assert f"addresses   {placeholders}\n" in done.out
    for name, start in (
        ("handover.toml", "handover companion --config handover.toml --master DEVICE"),
        ("Dike-house.toml", "handover station --config Dike-house.toml --master udpin:0.0.0.0:14552"),
    ):
        head = Path("out/here", name).read_text(encoding="utf-8").splitlines()[2:4]
        assert head[0] == f"# Start: {start}"
        assert head[1].startswith("# 192.0.2.x, 198.51.100.x and 203.0.113.x are placeholders")


def test_the_keys_that_it_names_are_those_that_it_says_how_to_make(
    typed: Callable[[str], Typed], monkeypatch: pytest.MonkeyPatch
) -> None:
    typed("--plan survey.plan --zones stations.kml")
    monkeypatch.chdir("survey")
    assert keys_main(["make", "Farm", "Dike-house"]) == 0
    for entry in load_vehicle(Path("handover.toml")).stations:
        assert entry.key is not None
        assert entry.key.is_file()
    for name in ("Farm", "Dike-house"):
        station = load_station(Path(f"{name}.toml"))
        assert station.ground_key is not None
        assert station.ground_key.is_file()
        assert station.vehicles[0].key == Path(f"keys/{name}.key").resolve()


def test_given_addresses_stand_where_the_placeholders_would(typed: Callable[[str], Typed]) -> None:
    done = typed("--plan survey.plan --zones stations.kml --address Farm=127.0.0.1 --address Dike-house=[2001:db8::9]")
    assert "placeholder" not in done.out
    assert [each.links for each in load_vehicle(Path("survey/handover.toml")).stations] == [
        ("udpout:127.0.0.1:14551",),
        ("udpout:[2001:db8::9]:14552",),
    ]
    assert load_station(Path("survey/Farm.toml")).ground == "udpin:127.0.0.1:15551"
    assert load_station(Path("survey/Dike-house.toml")).ground == "udpin:[::]:15552"
    assert "placeholder" not in Path("survey/Farm.toml").read_text(encoding="utf-8")


def test_every_option_is_in_what_is_written(typed: Callable[[str], Typed]) -> None:
    done = typed(
        "--plan survey.plan --zones stations.kml --out x --speed 5 --handovers 3 --out-of-coverage land "
        "--station GCSB=2 --station GCSA=Farm --battery-wh 126 --hover-w 354 --parent GCSA"
    )
    assert done.code == 1
    assert "error:   the route makes 2 handovers, mission.toml expects 3\n" in done.out
    again = "Put right what is an error in plan or zones, then type the same command again with --force.\n"
    assert done.out.endswith(again)
    package = packages.load("x/mission")
    assert [station.name for station in package.stations] == ["GCSA", "GCSB"]
    assert (package.cruise_speed_mps, package.expected_handovers) == (5.0, 3)
    assert dict(package.policies) == {"on_out_of_coverage": "land"}
    assert (package.energy.battery_wh, package.energy.hover_w) == (126.0, 354.0)


@pytest.mark.parametrize("name", ["delivery", "ferry", "dike", "linear", "field-test", "meridian"])
def test_our_own_missions_are_made_again_from_their_plans_and_zones(name: str, typed: Callable[[str], Typed]) -> None:
    folder = MISSIONS / name
    assert typed(f"--plan {folder}/{name}.plan --zones {folder}/zones.geojson --out again").code == 0
    ours, again = packages.load(folder), packages.load("again/mission")
    assert again.expected_handovers == ours.expected_handovers
    assert again.profile is ours.profile
    assert again.detector == ours.detector
    assert again.stations == ours.stations
    assert again.simulate().commanders == ours.simulate().commanders


def test_the_order_of_the_zones_does_not_matter_where_home_is_in_one(typed: Callable[[str], Typed]) -> None:
    zones(Dike=DIKE, Farm=FARM)
    assert typed("--plan survey.plan --zones zones.geojson").code == 0
    assert [(each.name, each.sysid) for each in packages.load("survey/mission").stations] == [
        ("Farm", 251),
        ("Dike", 252),
    ]


def test_one_zone_is_a_mission_of_one_station(typed: Callable[[str], Typed]) -> None:
    zones(Farm=(52.2087, 5.9486, 52.2120, 5.9585))
    done = typed("--plan survey.plan --zones zones.geojson --name Orchard")
    assert done.code == 0
    package = packages.load("survey/mission")
    assert (package.name, package.expected_handovers, len(package.stations)) == ("Orchard", 0, 1)
    station = load_station(Path("survey/Farm.toml"))
    assert (station.ground, station.peers) == (None, ())
    assert "  Farm.toml, keys/Farm.key, mission/  to Farm\n" in done.out


def test_a_file_for_each_station_names_it(typed: Callable[[str], Typed]) -> None:
    for name, bounds in (("Farm", FARM), ("Südhaus", DIKE)):
        text = json.dumps({"type": "Polygon", "coordinates": [box(bounds)]})
        Path(f"{name}.geojson").write_text(text, encoding="utf-8")
    assert typed("--plan survey.plan --zones Farm.geojson --zones Südhaus.geojson").code == 0
    package = packages.load("survey/mission")
    assert [station.name for station in package.stations] == ["Farm", "Sudhaus"]
    assert package.zones[1].name == "Südhaus"


def test_a_change_of_speed_before_the_first_leg_is_the_speed_of_the_mission(typed: Callable[[str], Typed]) -> None:
    data = plan()
    change = {"autoContinue": True, "command": 178, "doJumpId": 9, "frame": 2, "params": [1, 6.5, -1, 0, 0, 0, 0],
              "type": "SimpleItem"}  # fmt: skip
    data["mission"]["items"].insert(1, change)
    Path("survey.plan").write_text(json.dumps(data), encoding="utf-8")
    assert (
        "speed       6.5 m/s, DO_CHANGE_SPEED before the first leg\n"
        in typed("--plan survey.plan --zones stations.kml").out
    )
    assert packages.load("survey/mission").cruise_speed_mps == 6.5


@pytest.mark.parametrize(
    ("kind", "vtol", "aircraft"),
    [(2, False, "copter"), (13, False, "copter"), (20, False, "quadplane"), (1, True, "quadplane")],
)
def test_the_kind_of_aircraft_is_that_of_the_plan(
    kind: int, vtol: bool, aircraft: str, typed: Callable[[str], Typed]
) -> None:
    data = plan(vehicleType=kind)
    if vtol:
        data["mission"]["items"][0]["command"] = 84
    Path("survey.plan").write_text(json.dumps(data), encoding="utf-8")
    typed("--plan survey.plan --zones stations.kml")
    assert packages.load("survey/mission").profile.name == aircraft


def test_a_mission_for_wings_names_their_settings_and_their_vehicle(typed: Callable[[str], Typed]) -> None:
    done = typed(f"--plan {MISSIONS}/ferry/ferry.plan --zones {MISSIONS}/ferry/zones.geojson")
    assert "  handover sim --mission mission --vehicle quadplane\n" in done.out
    text = Path("ferry/mission/mission.toml").read_text(encoding="utf-8")
    assert "# waypoint_m = 90               # WP_RADIUS\n" in text


def test_heights_of_the_ground_come_with_the_mission(typed: Callable[[str], Typed]) -> None:
    grid = "ncols 2\nnrows 2\nxllcorner 5.94\nyllcorner 52.20\ncellsize 0.02\n40 41\n42 43\n"
    Path("heights.txt").write_text(grid, encoding="utf-8")
    assert typed("--plan survey.plan --zones stations.kml --terrain heights.txt").code == 0
    package = packages.load("survey/mission")
    assert package.terrain is not None
    assert package.files["terrain.asc"].decode() == grid
    assert typed("--plan survey.plan --zones stations.kml --terrain no.asc --out other").faults == [
        "no.asc: No such file or directory"
    ]


def test_a_jump_without_end_is_told_with_the_option_that_allows_it(typed: Callable[[str], Typed]) -> None:
    data = plan()
    jump = {"autoContinue": True, "command": 177, "doJumpId": 9, "frame": 2, "params": [2, -1, 0, 0, 0, 0, 0],
            "type": "SimpleItem"}  # fmt: skip
    data["mission"]["items"].insert(4, jump)
    Path("survey.plan").write_text(json.dumps(data), encoding="utf-8")
    assert typed("--plan survey.plan --zones stations.kml").faults == [
        "survey.plan: item 5: DO_JUMP repeats without end: its energy cannot be judged (allowed: a number of times, or "
        "--endless-jump)"
    ]
    typed("--plan survey.plan --zones stations.kml --endless-jump")
    assert packages.load("survey/mission").route.endless


# --- zones of a geofence ---


def test_inclusion_areas_of_the_plan_become_zones_and_leave_its_fence(typed: Callable[[str], Typed]) -> None:
    kept = fence_polygon((52.3, 5.9, 52.31, 5.91), False)
    with_fence(polygons=[fence_polygon(DIKE), kept, fence_polygon(FARM)])
    done = typed("--plan survey.plan --zones survey.plan --station GCSA=2 --station GCSB=1")
    assert done.code == 0
    note = "2 areas of the plan's geofence are zones now, and no fence: the copy of the plan is without them"
    assert f"note        {note}\n" in done.out
    copy = json.loads(Path("survey/mission/survey.plan").read_text(encoding="utf-8"))
    assert copy["geoFence"]["polygons"] == [kept]
    assert packages.load("survey/mission").zones[0].area.bounds == (FARM[1], FARM[0], FARM[3], FARM[2])


def test_areas_without_names_are_named_in_their_order(typed: Callable[[str], Typed]) -> None:
    with_fence(polygons=[fence_polygon(FARM), fence_polygon(DIKE)])
    shutil.copy("survey.plan", "zones.plan")
    plan(hoverSpeed=4)
    with_fence()
    assert typed("--plan survey.plan --zones zones.plan --station GCSA --station GCSB").code == 0
    assert Path("survey/mission/survey.plan").read_bytes() == Path("survey.plan").read_bytes()
    line = "--plan survey.plan --zones zones.plan --station GCSA --out other"
    assert typed(line).faults == [
        "2 zones without a name, and 1 stations: name a station for each, in the order of the files, or with --station "
        "NAME=NUMBER those that count"
    ]


def test_circles_stay_circles_and_become_polygons_beside_polygons(typed: Callable[[str], Typed]) -> None:
    circles = [
        {"circle": {"center": [52.2103, lon], "radius": 320}, "inclusion": True, "version": 1}
        for lon in (5.9515, 5.956)
    ]
    with_fence(circles=circles)
    assert typed("--plan survey.plan --zones survey.plan --station A --station B").code == 0
    package = packages.load("survey/mission")
    assert package.detector == "circles"
    assert package.zones[0].area == Circle(52.2103, 5.9515, 320.0)
    with_fence(circles=circles[:1], polygons=[fence_polygon(DIKE)])
    assert typed("--plan survey.plan --zones survey.plan --station B --station A --parent A --out mixed").code == 0
    mixed = packages.load("mixed/mission")
    assert (mixed.detector, mixed.stations[0].name) == ("polygons", "A")
    assert len(mixed.zones[0].area.exterior.coords) == 129


def test_a_zone_of_too_many_corners_is_simplified_and_the_metres_are_told(typed: Callable[[str], Typed]) -> None:
    south, west, north, east = DIKE
    many = [[west + (east - west) * n / 1500, south - 0.00002 * (n % 2)] for n in range(1501)]
    feature = {
        "properties": {"name": "Dike"},
        "geometry": {"type": "Polygon", "coordinates": [[*many, [east, north], [west, north]]]},
    }
    farm = {"properties": {"name": "Farm"}, "geometry": {"type": "Polygon", "coordinates": [box(FARM)]}}
    Path("zones.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature, farm]}))
    done = typed("--plan survey.plan --zones zones.geojson")
    assert done.code == 0
    assert "note        Dike: the zone had too many corners: its border moved by up to 2.2 m\n" in done.out


# --- what is missing, and what is asked ---


def test_all_missing_options_are_told_at_once(typed: Callable[[str], Typed]) -> None:
    assert typed("").faults == [
        "--plan FILE: file of the route (.plan or .waypoints). Give this option",
        "--zones FILE: file of the zones (.geojson, .json, .kml, .kmz, .plan). Give this option",
    ]
    waypoints()
    with_fence(polygons=[fence_polygon(FARM), fence_polygon(DIKE)])
    assert typed("--plan p.waypoints --zones survey.plan").faults == [
        "--aircraft WORD: kind of aircraft (copter, plane, quadplane). Give this option",
        "--station NAME=1: survey.plan: geoFence, polygon 1 has no name. Give this option",
        "--station NAME=2: survey.plan: geoFence, polygon 2 has no name. Give this option",
        "--speed MPS: cruise speed in m/s, which the plan does not name. Give this option",
    ]
    assert sorted(os.listdir()) == ["p.waypoints", "stations.kml", "survey.plan"]


@pytest.mark.parametrize(
    ("bounds", "where"),
    [
        ({"A": FARM, "B": (52.2087, 5.9490, 52.2120, 5.9585)}, "home is in the zones of A, B"),
        ({"A": DIKE, "B": (52.2087, 5.9530, 52.2120, 5.9585)}, "home is in no zone"),
    ],
)
def test_a_parent_that_home_does_not_tell_is_missing(
    bounds: dict[str, Any], where: str, typed: Callable[[str], Typed]
) -> None:
    zones(**bounds)
    line = "--plan survey.plan --zones zones.geojson"
    assert typed(line).faults == [f"--parent NAME: the station that starts the flight; {where}. Give this option"]
    typed(f"{line} --parent B")
    assert packages.load("survey/mission").parent.name == "B"
    assert typed(f"{line} --parent C --out other").faults == ["--parent 'C' is no station (allowed: A, B)"]


def asked(line: str, *answers: str) -> tuple[int, list[str]]:
    """Exit code, and the questions, with these answers at a terminal."""
    parser = argparse.ArgumentParser()
    init_mission.add_options(parser)
    prompts, left = [], list(answers)

    def ask(prompt: str) -> str:
        prompts.append(prompt)
        if not left:
            raise EOFError
        return left.pop(0)

    code = init_mission.run(parser.parse_args(line.split()), ask)
    assert left == []
    return code, prompts


def test_at_a_terminal_what_is_missing_is_asked_with_a_proposal(capsys: pytest.CaptureFixture[str]) -> None:
    waypoints()
    with_fence(polygons=[fence_polygon(FARM), fence_polygon(DIKE)])
    code, prompts = asked(
        "", "no.plan", "p.waypoints", "survey.plan", "rocket", "copter", "Farm house", "Farm", "", "fast", "7", "",
        "127.0.0.1", "0", "126", "354",
    )  # fmt: skip
    assert code == 0
    assert prompts == [
        "file of the route (.plan or .waypoints): ",
        "file of the route (.plan or .waypoints): ",
        "file of the zones (.geojson, .json, .kml, .kmz, .plan): ",
        "kind of aircraft (copter, plane, quadplane): ",
        "kind of aircraft (copter, plane, quadplane): ",
        "name of the station of zone 1 (survey.plan: geoFence, polygon 1) [GCSA]: ",
        "name of the station of zone 1 (survey.plan: geoFence, polygon 1) [GCSA]: ",
        "name of the station of zone 2 (survey.plan: geoFence, polygon 2) [GCSB]: ",
        "cruise speed in m/s, which the plan does not name [10]: ",
        "cruise speed in m/s, which the plan does not name [10]: ",
        "address of Farm, as the aircraft reaches it [192.0.2.11]: ",
        "address of GCSB, as the aircraft reaches it [192.0.2.12]: ",
        "energy of the full battery in Wh [unknown]: ",
        "energy of the full battery in Wh [unknown]: ",
        "power in hover in W [unknown]: ",
    ]
    out = capsys.readouterr().out
    for refused in (
        "no.plan: no such file",
        "'rocket' (allowed: copter, plane, quadplane)",
        "'Farm house' is not a station's name (allowed: 1 to 16 letters, digits, - and _)",
        "'fast' (allowed: a number)",
        "battery_wh 0 (allowed: 1 to 100000 Wh)",
    ):
        assert f"  {refused}\n" in out
    package = packages.load("p/mission")
    assert [station.name for station in package.stations] == ["Farm", "GCSB"]
    assert (package.cruise_speed_mps, package.energy.battery_wh, package.energy.hover_w) == (7.0, 126.0, 354.0)


def test_enter_takes_every_proposal_and_an_end_of_input_writes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    line = "--plan survey.plan --zones stations.kml"
    assert asked(line)[0] == 2
    assert capsys.readouterr().err == "handover init: no answer: nothing was written\n"
    assert not Path("survey").exists()
    assert asked(line, "", "", "")[0] == 0
    assert "[energy]" not in Path("survey/mission/mission.toml").read_text(encoding="utf-8").replace("# [energy]", "")


def test_no_question_is_asked_about_a_plan_that_cannot_be_used(capsys: pytest.CaptureFixture[str]) -> None:
    with_fence(polygons=[fence_polygon(FARM)])
    plan("other.plan", vehicleType=12)
    assert asked("--plan other.plan --zones survey.plan") == (2, [])
    assert "the plan was made for a submarine" in capsys.readouterr().err


def test_a_terminal_is_asked_and_a_pipe_is_not(here: Path) -> None:
    """The program itself, at a terminal of its own and with its input from nowhere."""
    command = [sys.executable, "-m", "mavproxy_handover.cli", "init", "mission", "--plan", "survey.plan"]
    told = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=False)
    assert (told.returncode, told.stdout) == (2, "")
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, command)
    shown, answers = "", ["stations.kml", "", "", ""]
    try:
        while (part := _read(terminal)) is not None:
            shown += part
            if answers and re.search(r": $", part):
                os.write(terminal, f"{answers.pop(0)}\n".encode())
    finally:
        os.close(terminal)
        _pid, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0, shown
    assert answers == []
    assert "check passed" in shown
    assert (here / "survey" / "mission").is_dir()


def _read(terminal: int) -> str | None:
    try:
        return os.read(terminal, 65536).decode()
    except OSError:  # its program has ended
        return None


# --- faults ---


def test_faults_of_plan_and_zones_are_told_together_and_nothing_is_written(typed: Callable[[str], Typed]) -> None:
    data = plan()
    data["mission"]["items"][2]["params"][6] = 99999
    data["mission"]["items"][3]["command"] = 185
    Path("survey.plan").write_text(json.dumps(data), encoding="utf-8")
    text = Path("stations.kml").read_text(encoding="utf-8").replace("Dike house", "Farm")
    Path("stations.kml").write_text(text, encoding="utf-8")
    faults = typed("--plan survey.plan --zones stations.kml").faults
    assert len(faults) == 3
    assert faults[0].startswith("survey.plan: item 4: DO_FLIGHTTERMINATION takes away a safeguard")
    assert faults[1].startswith("survey.plan: item 3: altitude is 99999 (allowed: ")
    assert faults[2] == (
        "stations.kml: placemark 2 (Farm): a second zone with the name 'Farm', the first is stations.kml: placemark 1 "
        "(Farm) (allowed: one for each station). Rename one, or give --station NAME=NUMBER for each zone"
    )
    assert not Path("survey").exists()
    shutil.copy(DATA / "survey.plan", "survey.plan")
    assert typed("--plan survey.plan --zones stations.kml --station GCSA=1 --station GCSB=2").code == 0


def drawn_beside(*geometries: str) -> None:
    """Add placemarks to stations.kml: Other 3, Other 4, and so on."""
    marks = (f"<Placemark><name>Other {n}</name>{each}</Placemark>" for n, each in enumerate(geometries, 3))
    text = Path("stations.kml").read_text(encoding="utf-8").replace("</Document>", f"{''.join(marks)}</Document>")
    Path("stations.kml").write_text(text, encoding="utf-8")


LINE = "<LineString><coordinates>5.95,52.21 5.957,52.211</coordinates></LineString>"
POINT = "<Point><coordinates>5.95,52.21</coordinates></Point>"


def test_lines_and_points_beside_the_zones_are_left_out_and_told(typed: Callable[[str], Typed]) -> None:
    drawn_beside(LINE, POINT, f"<MultiGeometry>{POINT}</MultiGeometry>", "")
    done = typed("--plan survey.plan --zones stations.kml")
    assert done.code == 0
    assert [each.name for each in packages.load("survey/mission").stations] == ["Farm", "Dike-house"]
    places = ", ".join(f"stations.kml: placemark {n} (Other {n})" for n in (3, 4, 5, 6))
    assert (
        f"note        left out, because a line or a point is no zone: {places}. Draw it as a polygon if it is one\n"
        "note        other zones count if you name all that do: --station NAME=ZONE for each station, the parent "
        "first\n"
    ) in done.out


def test_of_many_lines_ten_are_told(typed: Callable[[str], Typed]) -> None:
    drawn_beside(*[LINE] * 14)
    done = typed("--plan survey.plan --zones stations.kml")
    assert "stations.kml: placemark 12 (Other 12) and 4 more. Draw it" in done.out
    assert "placemark 13" not in done.out


def test_a_line_that_is_named_as_a_zone_is_refused(typed: Callable[[str], Typed]) -> None:
    drawn_beside(LINE)
    assert typed("--plan survey.plan --zones stations.kml --station Farm --station A=3").faults == [
        "stations.kml: placemark 3 (Other 3): a LineString is no zone (allowed: Polygon, MultiGeometry of polygons, "
        "Point with radius_m). Draw it as a polygon, or name the zones that count with --station NAME=ZONE"
    ]


def test_a_file_of_lines_alone_has_no_zone(typed: Callable[[str], Typed]) -> None:
    text = f"<kml><Placemark><name>Route</name>{LINE}</Placemark></kml>"
    Path("lines.kml").write_text(text, encoding="utf-8")
    (told,) = typed("--plan survey.plan --zones stations.kml lines.kml").faults
    assert told.startswith("lines.kml: placemark 1 (Route): a LineString is no zone")


def test_numbers_of_zones_count_the_areas(typed: Callable[[str], Typed]) -> None:
    text = Path("stations.kml").read_text(encoding="utf-8")
    mark = f"<Placemark><name>Road</name>{LINE}</Placemark>"
    Path("stations.kml").write_text(text.replace("<Placemark>", f"{mark}<Placemark>", 1), encoding="utf-8")
    done = typed("--plan survey.plan --zones stations.kml --station GCSA=1 --station GCSB=2")
    assert done.code == 0
    assert "zone        GCSA: stations.kml: placemark 2 (Farm)\n" in done.out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--station Barn", "--station Barn: no zone 'Barn' (allowed: Farm, Dike house)"),
        ("--station A=3", "--station A: no zone '3' (allowed: Farm, Dike house)"),
        ("--station A=Farm --station B=1",
         "--station B: stations.kml: placemark 1 (Farm) is the zone of A (allowed: one for each)"),
        ("--station guard=Farm",
         "--station 'guard' is the name of another file (allowed: not ground, guard, handover, mission)"),
        ("--station ä=Farm", "--station 'ä' is not a station's name (allowed: 1 to 16 letters, digits, - and _)"),
        ("--address Barn=10.0.0.2", "--address 'Barn' is no station (allowed: Farm, Dike-house)"),
        ("--address Farm=10.0.0.2:14", "--address Farm: '10.0.0.2:14' is no address (allowed: a name, an IPv4 address, "
         "an IPv6 address in brackets)"),
        ("--address Farm", "--address Farm: '' is no address (allowed: a name, an IPv4 address, an IPv6 address in "
         "brackets)"),
        ("--speed 0", "--speed 0 (allowed: 0.1 to 100 m/s)"),
        ("--speed nan", "--speed nan (allowed: 0.1 to 100 m/s)"),
        ("--handovers -1", "--handovers -1 (allowed: 0 to 1000)"),
        ("--battery-wh 0", "--battery-wh 0 (allowed: 1 to 100000 Wh)"),
        ("--vehicle-sysid 0", "--vehicle-sysid 0 (allowed: a MAVLink system id, 1 to 255)"),
        ("--vehicle-name ä", "--vehicle-name 'ä' (allowed: 1 to 20 ASCII characters)"),
        ("--plan stations.kml", "stations.kml: not a route (allowed: a file named *.plan or *.waypoints). Save the "
         "plan as .plan"),
        ("--plan no.plan", "no.plan: No such file or directory"),
        ("--zones no.kml", "no.kml: No such file or directory"),
    ],
)  # fmt: skip
def test_an_option_that_does_not_fit_is_told(options: str, said: str, typed: Callable[[str], Typed]) -> None:
    assert typed(f"--plan survey.plan --zones stations.kml {options}").faults == [said]
    assert not Path("survey").exists()


def test_a_plan_for_a_rover_is_refused_whatever_is_given(typed: Callable[[str], Typed]) -> None:
    plan(vehicleType=10)
    line = "--plan survey.plan --zones stations.kml"
    assert typed(line).faults == [
        "survey.plan: the plan was made for a rover (allowed: copter, plane, quadplane). Make the plan for one of these"
    ]
    (fault,) = typed(f"{line} --aircraft copter").faults
    assert fault.startswith(
        "survey.plan: mission: the plan was made for a rover (vehicleType 10), the mission is for a copter"
    )


def test_a_mission_that_cannot_be_sent_is_told(typed: Callable[[str], Typed]) -> None:
    data = plan()
    data["more"] = os.urandom(60_000).hex()
    Path("survey.plan").write_text(json.dumps(data), encoding="utf-8")
    (fault,) = typed("--plan survey.plan --zones stations.kml").faults
    assert fault == (
        "survey: larger than 65536 bytes when packed: it could not be sent. Split the plan, or draw the zones with "
        "fewer corners"
    )


# --- what was there ---


def test_what_is_there_is_not_overwritten(typed: Callable[[str], Typed]) -> None:
    Path("survey").mkdir()
    assert typed("--plan survey.plan --zones stations.kml").code == 0, "an empty folder is taken"
    Path("survey/mine").write_text("mine")
    assert typed("--plan survey.plan --zones stations.kml").faults == [
        "survey exists already: nothing written. Give another --out, or --force, which keeps it"
    ]
    assert Path("survey/mine").read_text() == "mine"
    Path("file").write_text("mine")
    assert typed("--plan survey.plan --zones stations.kml --out file").code == 2
    assert Path("file").read_text() == "mine"


def test_force_keeps_the_folder_that_was_there_and_its_keys_are_copied(typed: Callable[[str], Typed]) -> None:
    line = "--plan survey.plan --zones stations.kml --force"
    typed(line)
    assert keys_main(["make", "Farm", "Dike-house", "--dir", "survey/keys"]) == 0
    key = Path("survey/keys/Farm.key").read_bytes()
    Path("survey/notes.txt").write_text("mine")
    for number in (1, 2):
        done = typed(line)
        assert done.code == 0
        assert f"  the folder that was there is kept as survey.old-{number}\n" in done.out
        assert Path("survey/keys/Farm.key").read_bytes() == key
        assert Path("survey/keys/Farm.key").stat().st_mode & 0o777 == 0o600
        assert Path("survey/keys").stat().st_mode & 0o777 == 0o700
    assert Path("survey.old-1/notes.txt").read_text() == "mine"
    assert not Path("survey/notes.txt").exists()


def test_a_disk_that_is_full_loses_nothing(typed: Callable[[str], Typed], monkeypatch: pytest.MonkeyPatch) -> None:
    line = "--plan survey.plan --zones stations.kml --force"
    typed(line)
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("mavproxy_handover.cli.new_folder.os.fsync", full)
        assert typed(line).faults == ["survey: No space left on device. Nothing was written: give another --out"]
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before

    rename = Path.rename

    def refused(path: Path, target: Path) -> Path:
        if path.name.startswith("."):
            raise OSError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refused)
    assert typed(line).faults == ["survey: Permission denied. Nothing was written: give another --out"]
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before

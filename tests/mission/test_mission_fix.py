# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover check --fix`: what it changes, what it leaves alone, and that nothing is lost."""

from __future__ import annotations

import json
import os

import pytest

from mavproxy_handover.cli.check import main
from mavproxy_handover.mission import load
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.fix import fix


def test_a_sound_mission_is_left_alone(small):
    folder = small.write()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert fix(folder) == ()
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("expected_handovers = 7  # as planned\n", "mission.toml: expected_handovers = 1. It was 7"),
        ("", "mission.toml: expected_handovers = 1"),
    ],
)
def test_the_number_of_handovers_is_written(small, line, told):
    small.toml = small.toml.replace("expected_handovers = 1\n", line)
    folder = small.write()
    assert fix(folder) == (told,)
    assert load(folder).expected_handovers == 1
    text = (folder / "mission.toml").read_text()
    assert ("# as planned" in text) == bool(line), "comments stay"
    assert (folder / "mission.toml.orig").read_text() == small.toml


def test_the_file_of_before_is_never_written_over(small):
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 2")
    folder = small.write()
    (folder / "mission.toml.orig").write_text("older")
    fix(folder)
    assert (folder / "mission.toml.orig").read_text() == "older"
    assert (folder / "mission.toml.orig2").read_text() == small.toml


def test_the_kind_of_aircraft_is_that_of_the_plan(small):
    small.plan["mission"]["vehicleType"] = 1
    folder = small.write()
    assert fix(folder)[0] == 'mission.toml: aircraft = "plane", as the plan says (vehicleType 1)'
    assert 'aircraft = "plane"' in (folder / "mission.toml").read_text()
    small.toml = 'aircraft = "copter"\n' + small.toml
    assert fix(small.write()) == (), "what the mission says is the planner's decision"


def test_a_home_that_was_never_set_is_at_the_take_off(small):
    small.plan["mission"]["plannedHomePosition"] = [0, 0, 50]
    small.items[0]["params"][4:6] = [0.0003, 10.001]
    folder = small.write()
    assert fix(folder) == (
        "small.plan: home is at the take-off, latitude 0.000300, longitude 10.001000. It was at 0, 0",
    )
    home = load(folder).route.home
    assert (home.lat_deg, home.lon_deg, home.alt_m) == (0.0003, 10.001, 50.0)


def test_a_home_that_was_never_set_in_a_waypoint_file_is_at_the_take_off(small):
    lines = [
        "QGC WPL 110",
        "0\t1\t0\t16\t0\t0\t0\t0\t0\t0\t12\t1",
        "1\t0\t3\t22\t0\t0\t0\t0\t0.0003\t10.001\t30\t1",
        "2\t0\t3\t16\t0\t0\t0\t0\t0\t10.005\t30\t1",
        "3\t0\t3\t21\t0\t0\t0\t0\t0\t10.005\t0\t1",
    ]
    small.toml = small.toml.replace("small.plan", "small.waypoints")
    folder = small.write()
    (folder / "small.waypoints").write_text("\n".join(lines) + "\n")
    assert fix(folder)[0].startswith("small.waypoints: home is at the take-off, latitude 0.000300")
    home = load(folder).route.home
    assert (home.lat_deg, home.lon_deg, home.alt_m) == (0.0003, 10.001, 12.0)


def test_without_a_place_of_the_take_off_home_stays_for_the_planner(small):
    small.plan["mission"]["plannedHomePosition"] = [0, 0, 50]
    small.items[0]["params"][4:6] = [0, 0]
    folder = small.write()
    assert fix(folder) == ()
    assert "home is not in the plan" in " ".join(load(folder).route.warnings)


def test_zones_get_their_station_from_the_name_and_are_closed(small):
    first = small.zones["features"][0]
    first["properties"] = {"name": "A"}
    first["geometry"]["coordinates"][0].pop()
    folder = small.write()
    assert fix(folder) == (
        "zones.geojson: feature 1: station is 'A', as its name",
        "zones.geojson: feature 1: the ring is closed: the first position stands at its end too",
    )
    assert [zone.station_name for zone in load(folder).zones] == ["A", "B"]
    assert json.loads((folder / "zones.geojson.orig").read_text()) == small.zones


@pytest.mark.parametrize("file", ["mission.toml", "small.plan", "zones.geojson"])
@pytest.mark.parametrize("text", ["", "[]", "{}", "null", '{"features": [3], "mission": {"items": 1}}', "\x00"])
def test_what_is_no_mission_is_left_for_the_check_to_tell(small, capsys, file, text):
    folder = small.write()
    (folder / file).write_text(text)
    assert fix(folder) == ()
    assert (folder / file).read_text() == text
    assert main([str(folder), "--fix"]) == 2
    assert capsys.readouterr().err.startswith("handover check: ")


def test_a_folder_that_is_not_there_is_told(tmp_path, capsys):
    assert main([str(tmp_path / "none"), "--fix"]) == 2
    assert "none/mission.toml: No such file" in capsys.readouterr().err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_told_and_stays(small):
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 2")
    folder = small.write()
    folder.chmod(0o555)
    try:
        with pytest.raises(MissionError, match="cannot be written"):
            fix(folder)
    finally:
        folder.chmod(0o755)


def test_the_command_says_what_it_changed_and_checks_the_result(small, capsys):
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 2")
    assert main([str(small.write()), "--fix"]) == 0
    said = capsys.readouterr()
    assert said.err == "fixed: mission.toml: expected_handovers = 1. It was 2\n"
    assert said.out.endswith("check passed: 0 errors, 0 warnings\n")

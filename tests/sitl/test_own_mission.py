# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover sim --mission`: what is flown and expected of a package that nobody has written a scenario for."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.mission import package as packages
from mavproxy_handover.tools.resources import shipped
from sitl.main import main
from sitl.script.expect import Commanders, Emergencies, Handovers, Landed
from sitl.script.own import KINDS, own_scenario
from sitl.script.places import SetupError
from sitl.script.scenario import parse_scenario, with_opening

MISSIONS = sorted(path.parent.name for path in shipped("missions").glob("*/mission.toml"))


def made(name: str, seed: int | None = None) -> tuple[packages.MissionPackage, Any]:
    folder = shipped("missions") / name
    package = packages.load(folder)
    return package, parse_scenario(own_scenario(package, folder, seed), name)


@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_can_be_flown_as_its_check_says(name: str) -> None:
    package, scenario = made(name)
    with_opening(scenario, package)
    assert scenario.mission == str((shipped("missions") / name).resolve())
    expected = {type(each): each for each in scenario.expectations}
    assert len(expected[Commanders].value) == package.expected_handovers + 1
    assert (Emergencies in expected) is not bool(package.gaps)
    assert Handovers in expected
    assert Landed in expected


def test_what_is_expected_of_the_delivery_is_what_its_own_scenario_has() -> None:
    _package, scenario = made("delivery")
    (commanders,) = [each for each in scenario.expectations if isinstance(each, Commanders)]
    assert commanders.value == ("GCSA", "GCSB", "GCSA", "GCSB", "GCSA")


def test_a_gap_is_allowed_before_the_start() -> None:
    _package, scenario = made("ridge")
    assert scenario.begin == "loaded"
    assert "HNDO_ALONE_MAX" in scenario.steps[0].deed.describe()


@pytest.mark.parametrize("name", MISSIONS)
def test_faults_are_the_same_by_their_seed_and_there_are_all_kinds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = shipped("missions") / name
    package = packages.load(folder)
    walk = package.simulate()  # which is the same each time, and takes most of the time
    monkeypatch.setattr(packages.MissionPackage, "simulate", lambda _package: walk)
    texts = {seed: own_scenario(package, folder, seed) for seed in range(60)}
    again = range(0, 60, 10)
    assert [texts[seed] for seed in again] == [own_scenario(package, folder, seed) for seed in again]
    words = set()
    for seed, text in texts.items():
        scenario = parse_scenario(text, f"{name} {seed}")
        with_opening(scenario, package)
        assert scenario.description.startswith(f"faults {seed}: ")
        words.add(re.sub(r"GCS[A-D]|\d+%", "", scenario.description.partition(": ")[2]))
    assert len(words) == len(KINDS)


def test_a_mission_that_ends_in_the_air_is_none_to_wait_for(tmp_path: Path) -> None:
    folder = tmp_path / "linear"
    shutil.copytree(shipped("missions") / "linear", folder)
    plan = json.loads((folder / "linear.plan").read_text())
    plan["mission"]["items"].pop()
    (folder / "linear.plan").write_text(json.dumps(plan))
    with pytest.raises(SetupError, match="ends in the air"):
        own_scenario(packages.load(folder), folder)


def test_a_mission_that_takes_hours_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "linear"
    shutil.copytree(shipped("missions") / "linear", folder)
    text = re.sub(r"cruise_speed_mps = .*", "cruise_speed_mps = 0.1", (folder / "mission.toml").read_text())
    (folder / "mission.toml").write_text(text)
    with pytest.raises(SetupError, match="longer than a simulation waits"):
        own_scenario(packages.load(folder), folder)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--faults", "3"], "--faults and --anyway go with --mission"),
        (["--mission", "/nowhere"], "/nowhere"),
        (["--mission", "x", "--scenario", "corridor"], "not allowed with argument"),
        (["--mission", "x", "--faults", "many"], "invalid int value"),
    ],
)
def test_bad_usage_is_one_line_and_nothing_is_started(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_mission_whose_check_fails_is_not_flown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "linear"
    shutil.copytree(shipped("missions") / "linear", folder)
    text = (folder / "mission.toml").read_text().replace("expected_handovers = 2", "expected_handovers = 5")
    (folder / "mission.toml").write_text(text)
    assert main(["--mission", str(folder)]) == 2
    error = capsys.readouterr().err
    assert "its check fails: " in error
    assert "--anyway" in error
    assert error.count("\n") == 1

# SPDX-License-Identifier: GPL-3.0-or-later

"""What programs read with `--json`: one object, with what people read, and the same exit code."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover import cli
from mavproxy_handover.store.keys import key_of, write_key

MISSIONS = Path(__file__).resolve().parents[2] / "missions"


def read(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, Any]:
    capsys.readouterr()
    code = cli.main([*words, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_keys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "keys"
    folder.mkdir(mode=0o700)
    write_key(folder / "GCSA.key", key_of("correct-horse-battery"))
    code, listed = read(capsys, "keys", "list", "--dir", str(folder))
    assert code == 0
    assert [key["name"] for key in listed["keys"]] == ["GCSA"]
    assert listed["keys"][0]["old_fingerprint"] is None
    assert listed["keys"][0]["made_utc"].endswith("+00:00")
    assert listed["problems"] == []
    (folder / "GCSA.key").chmod(0o644)
    code, checked = read(capsys, "keys", "check", "--dir", str(folder))
    assert code == 1
    assert checked["keys"] == []
    assert len(checked["problems"]) == 1
    assert str(folder / "GCSA.key") in checked["problems"][0]


def test_guard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scripts = tmp_path / "APM" / "scripts"
    scripts.mkdir(parents=True)
    guard, parameters = str(scripts / "handover_guard.lua"), str(scripts / "handover.parm")
    code, found = read(capsys, "guard", str(tmp_path), "--check")
    assert (code, found) == (1, {"findings": [], "missing": [guard, parameters], "written": []})
    code, found = read(capsys, "guard", str(tmp_path))
    assert (code, found["missing"], found["written"]) == (0, [], [guard, parameters])
    (scripts / "handover_guard.lua").write_text("-- another one")
    code, found = read(capsys, "guard", str(tmp_path))
    assert code == 1
    assert [(each["path"], each["stops"]) for each in found["findings"]] == [(guard, True)]
    assert (found["missing"], found["written"]) == ([guard], [])
    assert (scripts / "handover_guard.lua").read_text() == "-- another one"


def test_explain(capsys: pytest.CaptureFixture[str]) -> None:
    code, tables = read(capsys, "explain")
    assert code == 0
    lost = next(row for row in tables["causes"] if row["cause"] == "commander_lost")
    assert (lost["wrong"], lost["ends"]) == ("commander lost", "when it is gone")
    assert "place" in {row["fact"] for row in tables["facts"]}
    code, decided = read(capsys, "explain", "--state", "commander_lost")
    assert (code, decided["causes"]) == (0, ["commander_lost"])
    assert any("RETURN" in line for line in decided["decision"])


def test_init_mission(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for path in (Path(__file__).resolve().parents[1] / "data" / "init").iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    told = ("init", "mission", "--plan", "survey.plan", "--zones", "stations.kml")
    code, made = read(capsys, *told, "--address", "Farm=10.0.0.2")
    assert (code, made["written"], made["passed"], made["folder"], made["kept"]) == (0, True, True, "survey", None)
    assert made["files"] == [
        "Dike-house.toml", "Farm.toml", "handover.toml", "mission/mission.toml", "mission/survey.plan",
        "mission/zones.geojson",
    ]  # fmt: skip
    assert made["stations"] == [
        {"name": "Farm", "sysid": 251, "parent": True, "zone": "stations.kml: placemark 1 (Farm)",
         "address": "10.0.0.2", "placeholder": False},
        {"name": "Dike-house", "sysid": 252, "parent": False, "zone": "stations.kml: placemark 2 (Dike house)",
         "address": made["stations"][1]["address"], "placeholder": True},
    ]  # fmt: skip
    assert (made["speed"], made["return_sites"]) == (
        {"mps": 8.0, "text": "8 m/s, speed of the plan"},
        ["home", "rally 1"],
    )
    assert made["next"] == ["cd survey", "handover keys make Farm Dike-house", "handover sim --mission mission"]
    assert (made["check"]["errors"], made["check"]["commanders"]) == (0, ["Farm", "Dike-house", "Farm"])
    code, refused = read(capsys, *told)
    assert (code, refused["written"], refused["passed"], refused["missing"]) == (2, False, False, [])
    assert refused["faults"] == [
        "survey exists already: nothing written. Give another --out, or --force, which keeps it"
    ]
    code, again = read(capsys, *told, "--force", "--handovers", "3")
    assert (code, again["written"], again["passed"], again["kept"], again["next"]) == (
        1, True, False, "survey.old-1", [],
    )  # fmt: skip
    assert again["check"]["findings"][0]["rule"] == "handovers"
    code, asked = read(capsys, "init", "mission", "--plan", "survey.plan")
    assert (code, asked["written"], [each["option"] for each in asked["missing"]]) == (2, False, ["--zones FILE"])
    assert asked["faults"][0].startswith("--zones FILE: file of the zones")


def test_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = Path(shutil.copytree(MISSIONS / "delivery", tmp_path / "delivery"))
    code, found = read(capsys, "check", str(folder))
    assert (code, found["passed"], found["errors"], found["warnings"]) == (0, True, 0, 0)
    assert found["commanders"] == ["GCSA", "GCSB", "GCSA", "GCSB", "GCSA"]
    assert [(each["from"], each["to"]) for each in found["handovers"]][:2] == [("GCSA", "GCSB"), ("GCSB", "GCSA")]
    assert found["handovers"][0]["needed_s"] == 6.0
    assert found["energy"]["with_reserve_wh"] < found["energy"]["battery_wh"]
    toml = folder / "mission.toml"
    toml.write_text(toml.read_text().replace("expected_handovers = 4", "expected_handovers = 5"))
    code, found = read(capsys, "check", str(folder))
    assert (code, found["passed"]) == (1, False)
    assert [(each["severity"], each["rule"], each["item"]) for each in found["findings"]][:1] == [
        ("error", "handovers", None)
    ]
    toml.write_text("name = ")
    code, found = read(capsys, "check", str(folder))
    assert (code, found["passed"]) == (2, False)
    assert found["faults"][0].startswith("mission.toml: not TOML")

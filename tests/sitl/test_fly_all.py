# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of all flights: what counts as a failure, without flying."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from sitl import fly_all
from sitl.fly_all import Flight, agree, main


def flight(scenario: str, vehicle: str, *commanders: str) -> Flight:
    return Flight(scenario, vehicle, 0, 41.6, commanders)


def test_a_flight_is_one_line() -> None:
    row = flight("both-dead", "arducopter", "GCSA", "GCSB", "nobody").row
    assert row.split() == ["both-dead", "arducopter", "holds", "42", "s", "GCSA", "GCSB", "nobody"]


def test_the_same_stations_must_have_commanded_on_both_vehicles() -> None:
    same = [flight("nominal", "builtin", "GCSA", "GCSB"), flight("nominal", "arducopter", "GCSA", "GCSB")]
    assert agree(same) == []
    other = [flight("slow", "builtin", "GCSA"), flight("slow", "arducopter", "GCSA", "GCSB")]
    assert agree([*same, *other]) == ["slow: commanders differ: GCSA / GCSA GCSB"]


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The command lines of the flights, none of which takes place: arducopter fails in scenario `slow`."""
    lines: list[list[str]] = []

    def fly(argv: list[str], **_options: Any) -> subprocess.CompletedProcess[str]:
        lines.append(argv)
        held = not ("slow" in argv and "arducopter" in argv)
        verdicts = [{"held": True, "wanted": "a", "seen": "b"}, {"held": held, "wanted": "modes AUTO", "seen": "RTL"}]
        result = {"verdicts": verdicts, "commanders": ["GCSA"]}
        return subprocess.CompletedProcess(argv, 0 if held else 1, json.dumps(result), "")

    monkeypatch.setattr(fly_all.subprocess, "run", fly)
    monkeypatch.setattr(fly_all, "find_arducopter", lambda explicit: Path("/bin/true"))
    return lines


def test_what_fails_is_shown_and_is_exit_code_1(flown: list[list[str]], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nominal"]) == 0
    assert main(["nominal", "slow"]) == 1
    shown = capsys.readouterr().out.splitlines()
    assert shown[-2:] == ["    modes AUTO: RTL", "4 flights, 1 failed, 0 differ between the vehicles"]
    assert len(flown) == 6


def test_a_vehicle_that_is_missing_is_told_and_is_exit_code_1(
    flown: list[list[str]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(fly_all, "find_arducopter", lambda explicit: None)
    assert main(["nominal"]) == 1
    assert "MISSING" in capsys.readouterr().err
    assert len(flown) == 1
    assert main(["nominal", "--vehicle", "builtin"]) == 0


def test_a_program_that_cannot_be_run_is_named(flown: list[list[str]], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["nominal", "--arduplane", "/nowhere/arduplane"])
    assert ended.value.code == 2
    assert "--arduplane: /nowhere/arduplane is not a program that can be run" in capsys.readouterr().err
    assert not flown

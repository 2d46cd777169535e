# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover sim` as its user sees it before anything flies: usage, refusals in one line, exit codes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sitl import main as command
from sitl.report.page import main_report
from sitl.script.scenario import known_scenarios


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = command.main(list(arguments))
    out, err = capsys.readouterr()
    return code, out, err


def test_the_list_names_every_scenario_with_what_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--list")
    assert code == 0
    for name in known_scenarios():
        (line,) = [line for line in out.splitlines() if line.split()[0] == name]
        assert len(line.split()) > 4


def test_help_reads_like_help(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "--help")
    assert code == 0
    assert "usage: handover sim" in out
    for option in ("--scenario", "--vehicle", "--arducopter", "--speedup", "--out", "--list", "--json"):
        assert option in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--scenario", "nonsense"], ["no scenario 'nonsense'", "nominal"]),
        (["--speedup", "40"], ["--speedup 40", "0.5 to 20"]),
        (["--speedup", "0"], ["--speedup 0 is not 0.5 to 20"]),
        (["--speedup", "nan"], ["--speedup nan is not 0.5 to 20"]),
        (["--vehicle", "arducopter", "--arducopter", "/nowhere/arducopter"], ["--arducopter", "/nowhere/arducopter"]),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]
) -> None:
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    assert err.startswith("handover sim: ")
    for word in words:
        assert word in err


OWN = """
name = "lost-link"
description = "the commander's program dies"
mission = "MISSION"
begin = "start"
[[step]]
wait_reached = 2
[[step]]
kill = "GCSA"
[[expect]]
emergencies = ["commander_lost"]
"""


def test_a_scenario_of_ones_own_is_a_file_with_its_mission_beside_it(tmp_path: Path) -> None:
    own = tmp_path / "lost-link.toml"
    own.write_text(OWN.replace("MISSION", "delivery"))
    assert command.own_file(own).mission == "delivery"
    shutil.copytree(Path(__file__).parents[2] / "missions" / "linear", tmp_path / "here")
    own.write_text(OWN.replace("MISSION", "here"))
    assert command.own_file(own).mission == str(tmp_path / "here")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read: "),
        ("name =", "lost-link.toml: not valid TOML"),
        (OWN.replace("wait_reached", "wait_reach"), "lost-link.toml: [step 1] wait_reach: unknown key"),
        (OWN.replace("MISSION", "nowhere"), "no mission 'nowhere'"),
    ],
)
def test_what_is_wrong_with_ones_own_scenario_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, words: str
) -> None:
    own = tmp_path / "lost-link.toml"
    if text is not None:
        own.write_text(text)
    code, out, err = run(capsys, "--scenario", str(own))
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert words in err


def test_an_unknown_option_is_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "--speed", "3", "--vehicle", "kite")[0] == 2


def test_a_folder_that_holds_something_is_not_written_into(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    code, _, err = run(capsys, "--out", str(tmp_path))
    assert code == 2
    assert "is not empty" in err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_folder_that_cannot_be_made_is_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, _, err = run(capsys, "--out", str(tmp_path / "file" / "run"))
    assert code == 2
    assert len(err.strip().splitlines()) == 1


def test_a_folder_whose_name_mavproxy_cannot_take_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, _, err = run(capsys, "--out", str(tmp_path / "my runs"))
    assert code == 2
    assert "spaces" in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "my runs").exists()


def test_a_report_of_a_folder_without_a_run_is_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main_report([str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("handover report: ")
    assert len(err.strip().splitlines()) == 1
    assert main_report([str(tmp_path / "nowhere")]) == 2

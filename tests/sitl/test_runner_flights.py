# SPDX-License-Identifier: GPL-3.0-or-later

"""End to end: real MAVProxy processes, the guard, and a vehicle, through every scenario, by the command a user types.

Each flight is judged by its scenario; what is checked here beside that is what the user holds in hands afterwards:
the exit code, one JSON object, the report and its pictures, and no process left behind.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import sitl
from sitl.script.scenario import known_scenarios
from sitl.vehicles import find_arducopter

#: the package in use, installed or in a checkout
ROOT = Path(sitl.__file__).resolve().parents[1]
#: flown here; `make scenarios` flies every scenario on both vehicles
COMMANDERS = {
    "nominal": ["GCSA", "GCSB", "GCSA", "GCSB", "GCSA"],
    "out-of-coverage": ["GCSA"],
    "companion-killed": ["GCSA", "GCSB"],
    "unsigned": ["GCSA", "GCSB"],
    "guard-key": ["GCSA"],
    "guard-key-other": ["GCSA"],
}
#: of these, on which vehicle: one is enough where what is shown lies in the companion
ON_ARDUCOPTER = ("nominal", "companion-killed", "guard-key-other")
ON_THE_BUILT_IN = ("nominal", "out-of-coverage", "unsigned", "guard-key", "guard-key-other")


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts `handover sim`; what a failed test leaves running is ended."""
    started: list[subprocess.Popen[str]] = []
    # a shell starts what runs in the background, tests among it, deaf to ctrl-c; children inherit that
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def begin(folder: Path, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "sitl.main", "--json", "--out", str(folder), *arguments],
            cwd=folder.parent,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield begin
    signal.signal(signal.SIGINT, before)
    for process in started:
        if process.poll() is None:
            process.kill()
            process.communicate()


def companion_up(folder: Path) -> None:
    """Wait until the companion's journal has begun."""
    until = time.monotonic() + 30
    while not (folder / "companion" / "companion.jsonl").exists():
        assert time.monotonic() < until, "the companion did not come up"
        time.sleep(0.1)


def processes_in(folder: Path) -> list[int]:
    """Processes whose working directory is in the run's folder."""
    found = []
    for link in Path("/proc").glob("[0-9]*/cwd"):
        try:
            where = link.readlink()
        except OSError:
            continue
        if where.is_relative_to(folder):
            found.append(int(link.parent.name))
    return found


def fly(start: Start, vehicle: str, scenario: str, folder: Path) -> dict[str, Any]:
    process = start(folder, "--vehicle", vehicle, "--scenario", scenario)
    out, story = process.communicate(timeout=280)
    assert process.returncode == 0, story
    assert processes_in(folder) == []
    (line,) = out.splitlines()
    result: dict[str, Any] = json.loads(line)
    return result


def check(result: dict[str, Any], scenario: str, folder: Path) -> None:
    assert result["held"] is True
    assert all(verdict["held"] for verdict in result["verdicts"])
    assert result["commanders"] == COMMANDERS[scenario]
    assert [handover["station"] for handover in result["handovers"]] == COMMANDERS[scenario][1:]
    assert all(0 < handover["duration_s"] < 2 for handover in result["handovers"])
    text = Path(result["report"]).read_text(encoding="utf-8")
    assert "Every expectation held" in text
    assert (folder / "map.png").stat().st_size > 20_000
    assert text.count('<svg class="sequence"') >= 1


def test_what_is_flown_here_are_scenarios_that_ship() -> None:
    assert set(COMMANDERS) <= set(known_scenarios())
    assert {*ON_ARDUCOPTER, *ON_THE_BUILT_IN} == set(COMMANDERS)


@pytest.mark.process
@pytest.mark.parametrize("scenario", sorted(ON_THE_BUILT_IN))
def test_on_the_built_in_vehicle(start: Start, scenario: str, tmp_path: Path) -> None:
    check(fly(start, "builtin", scenario, tmp_path / "run"), scenario, tmp_path / "run")


@pytest.mark.sitl
@pytest.mark.parametrize("scenario", sorted(ON_ARDUCOPTER))
def test_on_arducopter(start: Start, scenario: str, tmp_path: Path) -> None:
    if find_arducopter() is None:
        pytest.skip("no ArduCopter SITL program ($ARDUCOPTER, PATH, ~/ardupilot/build/sitl/bin)")
    check(fly(start, "arducopter", scenario, tmp_path / "run"), scenario, tmp_path / "run")


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["ctrl-c", "sigterm"])
def test_a_run_that_is_stopped_leaves_no_process(start: Start, number: signal.Signals, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = start(folder, "--scenario", "nominal")
    companion_up(folder)
    assert len(processes_in(folder)) == 5, "vehicle, two stations, and the companion with what it supervises"
    process.send_signal(number)
    out, story = process.communicate(timeout=30)
    assert process.returncode == 130
    assert out == ""
    assert story.strip().endswith("handover sim: stopped; every process was ended")
    assert processes_in(folder) == []


@pytest.mark.process
def test_a_run_that_is_killed_takes_every_process_with_it(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = start(folder, "--scenario", "nominal")
    companion_up(folder)
    process.kill()
    process.communicate(timeout=10)
    until = time.monotonic() + 10
    while processes_in(folder):
        assert time.monotonic() < until, "processes are left behind"
        time.sleep(0.1)


@pytest.mark.process
def test_an_expectation_that_does_not_hold_is_exit_code_1(tmp_path: Path) -> None:
    """The same flight, judged by a scenario that wants what does not happen."""
    scenarios = tmp_path / "scenarios"
    scenarios.mkdir()
    text = (known_scenarios()["nominal"]).read_text(encoding="utf-8")
    ground, _, _ = text.partition("[[step]]")
    for right, other in (('name = "nominal"', 'name = "wrong"'), ('begin = "start"', 'begin = "loaded"')):
        assert right in ground
        ground = ground.replace(right, other)
    wrong = ground + '[[step]]\nwait_armed = false\n\n[[expect]]\ncommanders = ["GCSB"]\n'
    (scenarios / "wrong.toml").write_text(wrong, encoding="utf-8")
    code = (
        "import sys; from pathlib import Path; import sitl.main as m\n"
        "from sitl.script.scenario import known_scenarios\n"
        f"m.known_scenarios = lambda: known_scenarios(Path({str(scenarios)!r}))\n"
        f"sys.exit(m.main(['--scenario', 'wrong', '--json', '--out', {str(tmp_path / 'run')!r}]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    result = json.loads(done.stdout)
    assert result["held"] is False
    failed = [verdict for verdict in result["verdicts"] if not verdict["held"]]
    assert failed == [{"held": False, "wanted": "commanders GCSB", "seen": "GCSA"}]
    assert "1 of " in Path(result["report"]).read_text(encoding="utf-8")

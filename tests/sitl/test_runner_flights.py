# SPDX-License-Identifier: GPL-3.0-or-later

"""A run of `handover sim` that is stopped, killed, or judged not to hold, by the command that a user types."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sitl.script.scenario import known_scenarios
from tests.depth import first
from tests.sitl.runner_flight import ROOT, Start, companion_up, processes_in, starting

start = pytest.fixture(starting)


@pytest.mark.process
@pytest.mark.parametrize("number", first(1, [signal.SIGINT, signal.SIGTERM]), ids=["ctrl-c", "sigterm"])
def test_a_run_that_is_stopped_leaves_no_process(start: Start, number: signal.Signals, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    process = start(folder, "--scenario", "nominal")
    companion_up(folder)
    assert len(processes_in(folder)) == 5, "vehicle, two stations, and the companion with what it supervises"
    process.send_signal(number)
    out, story = process.communicate(timeout=60)
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
    process.communicate(timeout=60)
    until = time.monotonic() + 60
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
        timeout=300,
        check=False,
    )
    assert done.returncode == 1, done.stderr
    result = json.loads(done.stdout)
    assert result["held"] is False
    failed = [verdict for verdict in result["verdicts"] if not verdict["held"]]
    assert failed == [{"held": False, "wanted": "commanders GCSB", "seen": "GCSA"}]
    assert "1 of " in Path(result["report"]).read_text(encoding="utf-8")

# SPDX-License-Identifier: GPL-3.0-or-later

"""A whole run of `handover sim` as a user types it, from start to the report, for the tests that fly scenarios."""

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

import sitl
from tests.console_lines import missing

__all__ = [
    "COMMANDERS",
    "ON_ARDUCOPTER",
    "ON_THE_BUILT_IN",
    "ROOT",
    "Start",
    "check",
    "companion_up",
    "fly",
    "processes_in",
    "starting",
]

#: the package in use, installed or in a checkout
ROOT = Path(sitl.__file__).resolve().parents[1]
#: flown here; `make scenarios` flies every scenario on both vehicles
COMMANDERS = {
    "nominal": ["GCSA", "GCSB", "GCSA", "GCSB", "GCSA"],
    "out-of-coverage": ["GCSA"],
    "companion-killed": ["GCSA", "GCSB"],
    "guard-key-other": ["GCSA"],
    "partner-address": ["GCSA", "GCSB"],
}
#: of these, on which vehicle: one is enough where what is shown lies in the companion
ON_ARDUCOPTER = ("nominal", "companion-killed", "guard-key-other")
ON_THE_BUILT_IN = ("nominal", "out-of-coverage", "guard-key-other", "partner-address")


Start = Callable[..., "subprocess.Popen[str]"]


def starting() -> Iterator[Start]:
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
    until = time.monotonic() + 120
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
    out, story = process.communicate(timeout=800)
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
    assert all(0 <= handover["duration_s"] < 2 for handover in result["handovers"])
    text = Path(result["report"]).read_text(encoding="utf-8")
    assert "Every expectation held" in text
    assert (folder / "map.png").stat().st_size > 20_000
    assert '<svg class="sequence"' in text or not result["handovers"]
    assert missing(folder, scenario) == [], "lines of docs/thesis.md that no program has printed"

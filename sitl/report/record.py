# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the folder of a run: what was run, what came of it, and the journals.

A folder without `run.json` is read too, as far as it goes: journals of a real flight with the mission package beside
them make the same pictures, only without a verdict.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.journal import strangers_path
from sitl.report.evidence import Evidence, RunNotes
from sitl.report.journal_reader import read_journals

__all__ = ["RUN_FILE", "RecordError", "RunRecord", "Verdict", "load_run"]

RUN_FILE = "run.json"


class RecordError(Exception):
    """The folder holds no run that can be reported. The message is one line."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether an expectation held; `wanted` and `seen` are for people."""

    held: bool
    wanted: str
    seen: str


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run as its folder tells it. `values` is run.json, empty where there is none."""

    folder: Path
    evidence: Evidence
    values: Mapping[str, Any] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ()
    files: tuple[Path, ...] = ()

    @property
    def title(self) -> str:
        """The run in a few words."""
        if not self.staged:
            return f"flight of {self.evidence.package.name}"
        return f"{self.values.get('scenario', '?')} on {self.values.get('vehicle', '?')}"

    @property
    def staged(self) -> bool:
        """It was a scenario of a simulation, not the folder of a companion's or a station's run."""
        return "scenario" in self.values

    @property
    def held(self) -> bool | None:
        """Every expectation held; None when nobody expected anything."""
        return all(verdict.held for verdict in self.verdicts) if self.verdicts else None


def load_run(folder: Path) -> RunRecord:
    """Read a run's folder. Raises RecordError."""
    if not folder.is_dir():
        raise RecordError(f"{folder}: no such folder")
    found = sorted(folder.glob("*.jsonl")) + sorted(folder.glob("*/*.jsonl"))
    beside = set(map(strangers_path, found))  # followed with the journal that they lie beside
    journals = [path for path in found if path not in beside]
    if not journals:
        raise RecordError(f"{folder}: no journals (*.jsonl) in it or in its folders")
    values = _read_values(folder / RUN_FILE)
    try:
        package = packages.load(_mission(folder))
    except MissionError as error:
        raise RecordError(f"{folder}: no mission package in it: {error}") from None
    notes = RunNotes(
        speedup=_number(values.get("speedup"), 1.0),
        marks=values.get("marks") or {},
        deaths=values.get("deaths") or {},
        kills=values.get("kills") or {},
        ended_t=_number(values.get("ended_t"), None),
    )
    evidence = Evidence(read_journals(journals), package, notes)
    verdicts = tuple(
        Verdict(bool(entry.get("held")), str(entry.get("wanted", "")), str(entry.get("seen", "")))
        for entry in values.get("verdicts", [])
    )
    patterns = ("*.jsonl", "*/*.jsonl", "*/*.tlog", "*/*.console.txt", "vehicle/vehicle.log", "*/*.toml")
    files = [path for pattern in patterns for path in sorted(folder.glob(pattern))]
    return RunRecord(folder, evidence, values, verdicts, tuple(dict.fromkeys(files)))


def _mission(folder: Path) -> Path:
    """Where the mission is: put there for it, or laid beside a journal by a companion, the newest of several."""
    there = folder / "mission"
    if there.is_dir() or (folder / packages.MISSION_FILE).exists():
        return there if there.is_dir() else folder
    laid = [path for pattern in ("*-mission-*", "*/*-mission-*") for path in folder.glob(pattern) if path.is_dir()]
    return max(laid, key=lambda path: path.stat().st_mtime, default=folder)


def _number(value: Any, default: Any) -> Any:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else default


def _read_values(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise RecordError(f"{path}: cannot be read: {error}") from None
    if not isinstance(values, dict):
        raise RecordError(f"{path}: not the record of a run")
    return values

# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the records of a run: its order, its results, and its files.

A run of `handover sim` is a folder with `run.json`: its files share one clock, and simulated time may run faster than
the clock on the wall. Anything else is a flight, put together by `flight.py` from files of whatever clocks.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.flights import LATEST, latest_flight
from mavproxy_handover.store.journal import strangers_path
from sitl.report.clocks import utc_of
from sitl.report.evidence import Evidence, RunNotes, of_vehicle, seen_of
from sitl.report.flight import Source, Story, stories
from sitl.report.journal_reader import Entry, is_number, read_journals
from sitl.report.sources import SourceError, find, newest_flight, read, read_mission
from sitl.report.tlog import read_tlog
from sitl.report.watch import VEHICLE

__all__ = ["RUN_FILE", "RecordError", "RunRecord", "Verdict", "load", "load_run"]

RUN_FILE = "run.json"
#: its values that are numbers; one that is none is left out
_NUMBERS = frozenset(("speedup", "rate", "duration_sim_s", "duration_wall_s", "ended_t"))
#: how a run of several vehicles names what is seen of a further one
_SEEN_OF = seen_of("")
_SEEN_FILE = "seen.jsonl"


class RecordError(Exception):
    """The input has nothing that can be reported. The message is one line."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether an expectation held; `wanted` and `seen` are for people."""

    held: bool
    wanted: str
    seen: str


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run as its files tell it. `values` is run.json, empty without one; `folder` is where its report goes."""

    folder: Path
    stories: tuple[Story, ...]
    values: Mapping[str, Any] = field(default_factory=dict)
    verdicts: tuple[Verdict, ...] = ()
    files: tuple[Path, ...] = ()
    #: of a flight: what was read, with its clock; what was left out, and why
    sources: tuple[Source, ...] = ()
    left_out: tuple[str, ...] = ()
    #: UTC is that of a GPS
    by_gps: bool = False

    @property
    def evidence(self) -> Evidence:
        """The evidence of the first vehicle."""
        return self.stories[0].evidence

    @property
    def title(self) -> str:
        """The run in a few words."""
        if self.staged:
            return f"{self.values.get('scenario', '?')} on {self.values.get('vehicle', '?')}"
        mission = self.evidence.mission
        if mission is not None:
            return f"flight of {mission.name}"
        return "flight of " + " and ".join(story.vehicle for story in self.stories)

    @property
    def staged(self) -> bool:
        """Whether this is a scenario of a simulation, not the folder of a companion's or a station's run."""
        return "scenario" in self.values

    @property
    def held(self) -> bool | None:
        """Whether every expectation held; None if there was none."""
        return all(verdict.held for verdict in self.verdicts) if self.verdicts else None


def load(paths: Sequence[Path], mission: Path | None = None) -> RunRecord:
    """Read a run's folder, or the files of a flight in any combination; `mission` is a mission package's folder.
    Raises RecordError."""
    for path in paths:
        if not path.exists():
            raise RecordError(f"{path}: no such file or folder")
    paths = [each for path in paths for each in _whole_flight(path)]
    if len(paths) == 1 and paths[0].is_dir():
        values = _read_values(paths[0] / RUN_FILE)
        if "scenario" in values:
            return _staged(paths[0], values)
    return _flown(paths, mission)


def _whole_flight(path: Path) -> list[Path]:
    """Where `latest` leads: the folders of all runs of that flight, the one that it leads to first."""
    if path.name != LATEST or not path.is_symlink():
        return [path]
    newest = path.resolve()
    try:
        folders = latest_flight(path.parent)
    except OSError:
        return [path]
    return [newest, *(folder for folder in folders if folder.resolve() != newest)]


def load_run(folder: Path) -> RunRecord:
    """Read a run's folder. Raises RecordError."""
    if not folder.is_dir():
        raise RecordError(f"{folder}: no such folder")
    return load([folder])


# ---- a flight -----------------------------------------------------------------------------------------------------


def _flown(paths: Sequence[Path], mission: Path | None) -> RunRecord:
    try:
        found = find(paths)
        folders = [mission] if mission is not None else found.missions
        package = read_mission(folders)
        strands, empty = read(found.files)
    except SourceError as error:
        raise RecordError(str(error)) from None
    if not strands:
        raise RecordError(
            empty[0] if empty else f"{paths[0]}: no journals (*.jsonl), telemetry or dataflash logs in it"
        )
    here, elsewhere = newest_flight(strands)
    told, sources, alignment = stories(here, package)
    if not told:
        raise RecordError(f"{paths[0]}: nothing of a vehicle in it")
    folder = paths[0] if paths[0].is_dir() else paths[0].parent
    values = _read_values(folder / RUN_FILE) if paths[0].is_dir() else {}
    left_out = [*empty, *(f"{strand.path}: of another flight" for strand in elsewhere)]
    left_out += [f"{path}: days older than the rest" for path in found.old]
    files = tuple(strand.path for strand in here)
    return RunRecord(folder, tuple(told), values, (), files, tuple(sources), tuple(left_out), alignment.by_gps)


# ---- a run of the simulation --------------------------------------------------------------------------------------


def _staged(folder: Path, values: Mapping[str, Any]) -> RunRecord:
    # a further vehicle has a folder of its own, with folders like the first one's
    found = [path for pattern in ("*", "*/*", "*/*/*") for path in sorted(folder.glob(f"{pattern}.jsonl"))]
    beside = set(map(strangers_path, found))  # followed with the journal that they lie beside
    journals = [path for path in found if path not in beside]
    if not journals:
        raise RecordError(f"{folder}: no journals (*.jsonl) in it or in its folders")
    try:
        package = packages.load(_mission(folder))
    except MissionError as error:
        raise RecordError(f"{folder}: no mission package in it: {error}") from None
    entries = _entries(folder, journals)
    offsets = [utc - entry.t for entry in entries if (utc := utc_of(entry.get("utc"))) is not None]
    notes = RunNotes(
        speedup=_number(values.get("rate", values.get("speedup")), 1.0),
        marks=_moments(values.get("marks")),
        deaths=values.get("deaths") or {},
        kills=_moments(values.get("kills")),
        ended_t=_number(values.get("ended_t"), None),
        utc_offset_s=median(offsets) if offsets else None,
    )
    names = _vehicles(entries)
    logs = _logs(folder, notes.utc_offset_s)
    told = []
    for name in names:
        about = of_vehicle(entries, name, names) + logs.get(name, [])
        evidence = Evidence(about, package if name == names[0] else _other_mission(folder, name, package), notes)
        told.append(Story(name, evidence, "what the simulation watched", {}, {}))
    verdicts = tuple(
        Verdict(bool(entry.get("held")), str(entry.get("wanted", "")), str(entry.get("seen", "")))
        for entry in values["verdicts"]
    )
    patterns = (
        "*.jsonl", "*/*.jsonl", "*/*.tlog", "*/*.console.txt", "vehicle/vehicle.log", "*/*.toml",
        "*/*/*.jsonl", "*/*/*.tlog", "*/*/*.console.txt",
    )  # fmt: skip
    files = [path for pattern in patterns for path in sorted(folder.glob(pattern))]
    return RunRecord(folder, tuple(told), values, verdicts, tuple(dict.fromkeys(files)))


def _entries(folder: Path, journals: Sequence[Path]) -> list[Entry]:
    """What the journals say, in order. What is seen of a further vehicle is noted in its folder as of any."""
    seen = {path: path.relative_to(folder).parts[0] for path in journals if path.match(f"*/*/{_SEEN_FILE}")}
    entries = read_journals([path for path in journals if path not in seen])
    for path, name in seen.items():
        entries += [
            replace(entry, who=seen_of(name)) if entry.who == VEHICLE else entry for entry in read_journals([path])
        ]
    return sorted(entries, key=lambda entry: entry.t)


def _vehicles(entries: Iterable[Entry]) -> list[str]:
    """The vehicles' names, the first one's first: of the further ones what is seen is noted by name."""
    listed = list(entries)
    others = list(dict.fromkeys(entry.who.removeprefix(_SEEN_OF) for entry in listed if entry.who.startswith(_SEEN_OF)))
    companions = dict.fromkeys(entry.who for entry in listed if entry.event == "view")
    first = next((name for name in companions if name not in others), "vehicle")
    return [first, *others]


def _other_mission(folder: Path, name: str, package: MissionPackage) -> MissionPackage:
    try:
        return packages.load(folder / name / "mission")
    except MissionError:
        return package


def _logs(folder: Path, utc_offset_s: float | None) -> dict[str, list[Entry]]:
    """What journals of a simulation lack and the companions' telemetry logs have, by vehicle: battery and radio."""
    found: dict[str, list[Entry]] = {}
    if utc_offset_s is None:
        return found
    for path in (*sorted(folder.glob("*/*.tlog")), *sorted(folder.glob("*/*/*.tlog"))):
        beside = read_journals(sorted(path.parent.glob("*.jsonl")))
        who = next((entry.who for entry in beside if entry.event == "view"), "")
        try:
            strand = read_tlog(path) if who else None
        except OSError:
            continue
        if strand is None or not strand.on_board:
            continue
        found[who] = [
            Entry(entry.t - utc_offset_s, entry.who, entry.event, entry.text, entry.fields)
            for entries in strand.seen.values()
            for entry in entries
            if entry.event in ("battery", "radio")
        ]
    return found


def _mission(folder: Path) -> Path:
    """Where the mission is: put there for it, or laid beside a journal by a companion, the newest of several."""
    there = folder / "mission"
    if there.is_dir() or (folder / packages.MISSION_FILE).exists():
        return there if there.is_dir() else folder
    laid = [path for pattern in ("*-mission-*", "*/*-mission-*") for path in folder.glob(pattern) if path.is_dir()]
    return max(laid, key=lambda path: path.stat().st_mtime, default=folder)


def _number(value: Any, default: Any) -> Any:
    return float(value) if is_number(value) else default


def _moments(value: Any) -> dict[str, float]:
    """Names and when."""
    return {name: t for name, t in value.items() if is_number(t)} if isinstance(value, dict) else {}


def _read_values(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise RecordError(f"{path}: cannot be read: {error}") from None
    if not isinstance(values, dict):
        raise RecordError(f"{path}: not the record of a run")
    found = {key: value for key, value in values.items() if key not in _NUMBERS or is_number(value)}
    verdicts = values.get("verdicts")
    held = verdicts if isinstance(verdicts, list) else []
    return found | {"verdicts": [each for each in held if isinstance(each, dict)]}

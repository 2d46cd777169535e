# SPDX-License-Identifier: GPL-3.0-or-later

"""Comparisons in turns, journals, and results: one JSON object a line as they come, and a table at the end.

A pair is one measurement of ours and one of the baseline, one after the other. A disturbance of the machine that lasts
longer affects both, so the ratio within a pair is steadier than either number. Order within pairs alternates (A B, B
A), so that a drift favours neither side. A result is the median of the pairs' ratios with its quartiles.
"""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib import metadata
from itertools import cycle
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

__all__ = [
    "Committed",
    "Comparison",
    "Entry",
    "Measurement",
    "Pair",
    "Results",
    "Say",
    "both",
    "compare",
    "from_comparison",
    "in_turns",
    "quantile",
    "read_journal",
    "settled",
    "table",
    "transfers",
]

Say = Callable[[str], None]
T = TypeVar("T")


# ---- comparisons ----------------------------------------------------------------------------------------------------


def quantile(values: Sequence[float], part: float) -> float:
    """The `part` quantile (0 to 1) of some values, interpolated between neighbours. Raises ValueError for none."""
    if not values:
        raise ValueError("quantile of nothing")
    ordered = sorted(values)
    place = part * (len(ordered) - 1)
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (ordered[above] - ordered[below]) * (place - below)


@dataclass(frozen=True, slots=True)
class Pair:
    """One measurement of each side, in the same unit."""

    ours: float
    baseline: float

    @property
    def usable(self) -> bool:
        """A baseline of nothing, or less where an idle share was taken off, gives no ratio."""
        return self.baseline > 0.0


@dataclass(frozen=True, slots=True)
class Comparison:
    """The medians of both sides, and the median ratio with its quartiles."""

    ours: float
    baseline: float
    ratio: float
    low: float
    high: float
    pairs: int
    #: ratio of the 20 % quantiles of both sides: what else a machine does only ever adds to a time
    quiet_ratio: float = 0.0
    #: pairs whose baseline was lost in the noise
    unusable: int = 0

    @property
    def uncertainty(self) -> float:
        """Half the quartile range by the root of the number of pairs, as a part of the ratio."""
        if self.ratio <= 0.0:
            return math.inf
        return (self.high - self.low) / 2.0 / math.sqrt(self.pairs) / self.ratio


def compare(pairs: Sequence[Pair]) -> Comparison:
    """The summary of some pairs. Raises ValueError if none is usable."""
    usable = [pair for pair in pairs if pair.usable]
    ratios = [pair.ours / pair.baseline for pair in usable]
    return Comparison(
        median([pair.ours for pair in usable]),
        median([pair.baseline for pair in usable]),
        median(ratios),
        quantile(ratios, 0.25),
        quantile(ratios, 0.75),
        len(usable),
        quantile([pair.ours for pair in usable], 0.2) / quantile([pair.baseline for pair in usable], 0.2),
        len(pairs) - len(usable),
    )


def settled(pairs: Sequence[Pair], least: int, uncertainty: float) -> bool:
    """Whether `least` pairs are there and more of them would hardly move the ratio."""
    usable = sum(pair.usable for pair in pairs)
    return usable >= least and compare(pairs).uncertainty <= uncertainty


def both(measure: Callable[[bool], T], ours_first: bool) -> tuple[T, T]:
    """Ours and the baseline, one after the other; `measure(True)` is ours."""
    found = {ours: measure(ours) for ours in (ours_first, not ours_first)}
    return found[True], found[False]


def in_turns(measure: Callable[[bool], T]) -> Iterator[tuple[T, T]]:
    """Pairs of ours and the baseline, for ever; each side is the first one in turn."""
    return (both(measure, ours_first) for ours_first in cycle((True, False)))


# ---- journals -------------------------------------------------------------------------------------------------------


Entry = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Committed:
    """One change of authority.

    `since_entry_s`: from the zone check that noticed the region to the commit, failed attempts and waiting included.
    `duration_s`: of the attempt that was committed, as journalled; the two differ where an earlier attempt failed.
    `messages`: of that attempt, until the commit, sent by any program, copies and repetitions included.
    """

    since_entry_s: float
    duration_s: float
    messages: int
    failed_attempts: int
    #: the commander's release never came: committed by the limit on waiting for it
    by_timeout: bool


def read_journal(path: Path) -> list[Entry]:
    """The entries of a journal, without a line that was cut. Raises OSError."""
    entries = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entries.append(json.loads(line))
        except ValueError:
            continue
    return entries


def _is_step(entry: Entry) -> bool:
    return entry["event"] == "message" and entry.get("direction") == "out" and entry.get("name") != "HANDOVER_RESULT"


def transfers(companion: Sequence[Entry], stations: Iterable[Sequence[Entry]]) -> list[Committed]:
    """All commits, in order, from the journals of the companion and of the stations."""
    sent: dict[int, list[float]] = {}
    for journal in (companion, *stations):
        for entry in filter(_is_step, journal):
            sent.setdefault(entry["handover_id"], []).append(entry["t"])
    found = []
    #: when each station's zone was entered, since the last commit
    entered: dict[str, float] = {}
    failed: dict[str, int] = {}
    begun_at = 0.0
    for entry in companion:
        event, station = entry["event"], entry.get("station", "")
        if event == "zone_entered":
            entered[station] = entry["t"]
            failed[station] = 0
        elif event == "transfer_begun":
            begun_at = entry["t"]
        elif event == "transfer_aborted":
            failed[station] = failed.get(station, 0) + 1
        elif event == "transfer_committed":
            waited_s = begun_at - entered.get(station, begun_at)
            duration_s = entry["duration_s"]
            # both entries of one zone check are written in a row; the time between them is not waiting
            since_entry_s = duration_s + (waited_s if failed.get(station) or waited_s > 0.02 else 0.0)
            messages = sum(t <= entry["t"] for t in sent.get(entry["handover_id"], []))
            by_timeout = entry.get("reason") == "release_timeout"
            found.append(Committed(since_entry_s, duration_s, messages, failed.get(station, 0), by_timeout))
            entered.pop(station, None)
    return found


# ---- results --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Measurement:
    """One line of the results. `limit` is what `judged` ("ratio" or "ours") must not exceed, or with `at_least` may not
    fall below; None: no target."""

    part: str
    what: str
    unit: str
    case: dict[str, Any]
    ours: float | None = None
    baseline: float | None = None
    ratio: float | None = None
    ratio_quartiles: tuple[float, float] | None = None
    pairs: int | None = None
    limit: float | None = None
    judged: str = "ratio"
    at_least: bool = False
    #: whatever else belongs to it, for the file
    details: dict[str, Any] = field(default_factory=dict)
    #: one sentence that a reader of the table needs
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is held; None without a target or without a number."""
        value = self.ratio if self.judged == "ratio" else self.ours
        if self.limit is None or value is None:
            return None
        return value >= self.limit if self.at_least else value <= self.limit

    def as_json(self) -> dict[str, Any]:
        """The object of its line; what is not there is left out, numbers are rounded to five digits."""
        entry: dict[str, Any] = {"part": self.part, "what": self.what, "unit": self.unit, **self.case}
        numbers = {
            "ours": self.ours,
            "baseline": self.baseline,
            "ratio": self.ratio,
            "ratio_quartiles": self.ratio_quartiles,
            "pairs": self.pairs,
        }
        entry.update((key, _short(value)) for key, value in numbers.items() if value is not None)
        if self.limit is not None:
            entry.update(target=self.limit, target_of=self.judged, met=self.met)
            if self.at_least:
                entry["target_is"] = "at least"
        entry.update((key, _short(value)) for key, value in self.details.items())
        if self.note:
            entry["note"] = self.note
        return entry


def from_comparison(
    part: str, what: str, unit: str, case: dict[str, Any], comparison: Comparison, **more: Any
) -> Measurement:
    """A measurement that was made in pairs; unless `more` says otherwise, its target is on the ratio."""
    details = {"quiet_ratio": comparison.quiet_ratio, **more.pop("details", {})}
    if comparison.unusable:
        details["pairs_lost_in_noise"] = comparison.unusable
    numbers = comparison.ours, comparison.baseline, comparison.ratio, (comparison.low, comparison.high)
    return Measurement(part, what, unit, case, *numbers, comparison.pairs, details=details, **more)


def _short(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, (list, tuple)):
        return [_short(entry) for entry in value]
    if isinstance(value, dict):
        return {key: _short(entry) for key, entry in value.items()}
    return value


def machine() -> dict[str, Any]:
    """The machine and the versions of the measurement: the first line of the file."""
    versions = {}
    for package in ("mavproxy-handover", "MAVProxy", "pymavlink", "fastcrc", "shapely"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return {
        "part": "machine",
        "utc": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "python": sys.version.split()[0],
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "processors": os.cpu_count(),
        "load_average": os.getloadavg(),
        **versions,
    }


class Results:
    """Collects measurements; each goes to the file at once, so an interrupted run keeps what it has."""

    def __init__(self, path: Path) -> None:
        """Start `path` with the machine's line, and delete its old contents. Raises OSError."""
        self.path = path
        self.measurements: list[Measurement] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("", encoding="utf-8")
        self.line(machine())

    def line(self, entry: dict[str, Any]) -> None:
        """Write one object that is no measurement."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry, ensure_ascii=False) + "\n")

    def add(self, measurement: Measurement) -> None:
        """Take in a measurement."""
        self.measurements.append(measurement)
        self.line(measurement.as_json())

    @property
    def missed(self) -> list[Measurement]:
        """The measurements that miss their limit."""
        return [measurement for measurement in self.measurements if measurement.met is False]


_HEAD = ("measurement", "case", "unit", "ours", "baseline", "ratio (quartiles)", "target", "")


def table(measurements: Sequence[Measurement]) -> str:
    """All measurements as a table, notes below it."""
    rows = [_HEAD]
    notes: list[str] = []
    for entry in measurements:
        mark = ""
        if entry.note:
            if entry.note not in notes:
                notes.append(entry.note)
            mark = f" [{notes.index(entry.note) + 1}]"
        rows.append(
            (
                f"{entry.part}: {entry.what}{mark}",
                ", ".join(f"{key} {value}" for key, value in entry.case.items()),
                entry.unit,
                _number(entry.ours),
                _number(entry.baseline),
                _ratio(entry),
                _target(entry),
                {None: "", True: "held", False: "MISSED"}[entry.met],
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "  ".join("-" * width for width in widths if width))
    lines += [f"[{number}] {note}" for number, note in enumerate(notes, 1)]
    return "\n".join(lines)


def _target(entry: Measurement) -> str:
    if entry.limit is None:
        return ""
    return f"{'ratio ' if entry.judged == 'ratio' else ''}{'>=' if entry.at_least else '<='} {entry.limit:g}"


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _ratio(entry: Measurement) -> str:
    if entry.ratio is None:
        return ""
    if entry.ratio_quartiles is None:
        return f"{entry.ratio:.2f}"
    low, high = entry.ratio_quartiles
    return f"{entry.ratio:.2f} ({low:.2f}-{high:.2f}, {entry.pairs} pairs)"

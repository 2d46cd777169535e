# SPDX-License-Identifier: GPL-3.0-or-later

"""Results: one JSON object a line as they come, and a table for people at the end."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from sitl.bench.numbers import Comparison

__all__ = ["Measurement", "Results", "from_comparison", "machine", "table"]


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
    part: str,
    what: str,
    unit: str,
    case: dict[str, Any],
    comparison: Comparison,
    *,
    limit: float | None = None,
    details: dict[str, Any] | None = None,
    note: str = "",
) -> Measurement:
    """A measurement that was made in pairs; its target is on the ratio."""
    more: dict[str, Any] = {"quiet_ratio": comparison.quiet_ratio, **(details or {})}
    if comparison.unusable:
        more["pairs_lost_in_noise"] = comparison.unusable
    return Measurement(
        part,
        what,
        unit,
        case,
        comparison.ours,
        comparison.baseline,
        comparison.ratio,
        (comparison.low, comparison.high),
        comparison.pairs,
        limit,
        details=more,
        note=note,
    )


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

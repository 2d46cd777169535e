# SPDX-License-Identifier: GPL-3.0-or-later

"""The lines of the thesis's figures in what today's programs print: the table in `docs/thesis.md`, and a transcript.

Each row of the table names today's line, the program that prints it, and the scenarios in which it does. In a line `*`
stands for a value. Run as a program it checks flights that were made before: folders that `handover sim --out` or
`make scenarios` has written.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

__all__ = ["FIVE", "PAGE", "Line", "lines", "main", "missing", "printed", "rows"]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "thesis.md"
_BEGIN, _END = "<!-- console lines:begin -->", "<!-- console lines:end -->"
_CODE = re.compile(r"`([^`]+)`")
#: what the page calls "all five"
FIVE = ("nominal", "field-test", "low-battery-return", "tcp-provider", "authority")


@dataclass(frozen=True, slots=True)
class Line:
    """One row of the table. `who`: the program that prints it, by the name of its folder in a run."""

    figures: str
    thesis: str
    today: str
    who: str
    scenarios: tuple[str, ...]

    def stands_in(self, texts: Iterable[str]) -> bool:
        """Whether one of these lines is it."""
        pattern = re.compile(".+".join(re.escape(part) for part in self.today.split("*")))
        return any(pattern.fullmatch(text) for text in texts)


@cache
def rows() -> tuple[Line, ...]:
    """The tables of the page; one without a column of stations is the companion's."""
    text = PAGE.read_text(encoding="utf-8").partition(_BEGIN)[2].partition(_END)[0]
    found = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|") or cells[0] in ("figure", "---"):
            continue
        figures, thesis, today, *who, scenarios = cells
        found.append(Line(figures, thesis, _one(today), who[0] if who else "companion", _named(scenarios)))
    return tuple(found)


def _named(cell: str) -> tuple[str, ...]:
    return FIVE if cell == "all five" else tuple(_CODE.findall(cell))


def _one(cell: str) -> str:
    (word,) = _CODE.findall(cell)
    return str(word)


def printed(console: str) -> list[str]:
    """What a program has printed, a line each, without time, name and phase in front."""
    return [line.rpartition("]: ")[2] if "]: " in line else line for line in console.splitlines()]


def lines(scenario: str) -> tuple[Line, ...]:
    """The rows that a flight of this scenario must have."""
    return tuple(row for row in rows() if scenario in row.scenarios)


def missing(folder: Path, scenario: str) -> list[str]:
    """Lines of the table that no program of this run has printed."""
    console = {}
    for path in folder.glob("*/*.console.txt"):
        console[path.parent.name] = printed(path.read_text(encoding="utf-8", errors="replace"))
    return [f"{row.who}: {row.today}" for row in lines(scenario) if not row.stands_in(console.get(row.who, ()))]


def main(folders: Sequence[str]) -> int:
    """Check runs; returns 1 if a line is missing, or if there is no run."""
    checked, found = 0, 0
    for folder in sorted(path.parent for name in folders for path in Path(name).glob("**/run.json")):
        scenario = json.loads((folder / "run.json").read_text(encoding="utf-8"))["scenario"]
        absent = missing(folder, scenario)
        checked, found = checked + bool(lines(scenario)), found + len(absent)
        print(f"{scenario}: {len(lines(scenario))} lines of the figures, {len(absent)} missing ({folder.name})")
        for line in absent:
            print(f"    {line}")
    return 1 if found or not checked else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

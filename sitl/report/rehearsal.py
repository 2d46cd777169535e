# SPDX-License-Identifier: GPL-3.0-or-later

"""Tables of rehearsals on the ground, from a vehicle's journal.

The journal has the statistics of a rehearsal each minute and at its end (`operator/rehearsal/rehearsal_stats.py`). The
last ones count. A companion that was restarted begins new statistics, so one rehearsal may have several.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sitl.report.journal_reader import Entry

__all__ = ["EVENT", "Table", "books", "tables"]

EVENT = "rehearsal_report"


@dataclass(frozen=True, slots=True)
class Table:
    """A caption, the heads of the columns, and the rows."""

    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def books(entries: Iterable[Entry]) -> list[Entry]:
    """The last word of each book, in their order."""
    found: list[Entry] = []
    for entry in entries:
        if entry.event != EVENT:
            continue
        goes_on = found and not found[-1].get("over") and _number(entry, "seconds") >= _number(found[-1], "seconds")
        if goes_on and found[-1].who == entry.who:
            found[-1] = entry
        else:
            found.append(entry)
    return found


def tables(book: Entry) -> list[Table]:
    """The statistics of a rehearsal. Missing or malformed values are left out."""
    made, missed = _rows(book, "handovers"), [row for row in book.get("missed", []) if len(row) == 3]
    handovers = [_handover(number, each) for number, each in enumerate(made, 1)]
    handovers += [("", f"{here} → {there}", "", "", f"way to item {item}", "not made") for here, there, item in missed]
    return [
        Table("Handovers", ("", "", "at", "took, of that in flight", "against the check", ""), tuple(handovers)),
        Table(
            "Links",
            (
                "station",
                "link",
                "zones",
                "time",
                "lost, mean and most",
                "round trip, median and most",
                "longest silence",
            ),
            tuple(_link(each) for each in _rows(book, "links")),
        ),
        Table(
            "Refused",
            ("station", "what", "reason", "times"),
            tuple(tuple(map(str, row)) for row in book.get("refused", []) if len(row) == 4),
        ),
        Table(
            "Would have been done",
            ("at", "zones", "what"),
            tuple((f"{row[0]} s", str(row[1]), str(row[2])) for row in book.get("would", []) if len(row) == 3),
        ),
    ]


def _rows(book: Entry, name: str) -> list[Mapping[str, Any]]:
    return [each for each in book.get(name, []) if isinstance(each, Mapping)]


def _number(entry: Entry, name: str) -> float:
    value = entry.get(name, 0.0)
    return float(value) if isinstance(value, (int, float)) else 0.0


def _handover(number: int, made: Mapping[str, Any]) -> tuple[str, ...]:
    took = f"{made.get('took_s', 0.0):.2f} s"
    item, inside_s, off_m = made.get("item"), made.get("inside_s"), made.get("off_m")
    if inside_s is not None:
        took += f" of {inside_s:g} s"
    against = "the check has none here" if item is None else f"way to item {item}"
    if off_m is not None:
        against += f", {off_m:.0f} m off"
    outcome = "committed" if made.get("committed") else "came to nothing"
    pair = f"{made.get('from')} → {made.get('to')}"
    why = f"{outcome} ({made.get('why')})"
    if not made.get("committed"):
        against = ""
    return f"{number}", pair, f"{made.get('at_s')} s", took, against, why


def _link(seen: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(seen.get("station")),
        str(seen.get("device")),
        str(seen.get("place")),
        f"{seen.get('seconds')} s",
        _pair(seen.get("loss"), seen.get("loss_most"), 100.0, "%"),
        _pair(seen.get("round_trip_s"), seen.get("round_trip_most_s"), 1000.0, "ms"),
        _silence(seen),
    )


def _pair(usual: float | None, most: float | None, times: float, unit: str) -> str:
    """Two numbers in a unit of which there are `times` as many; "" where nothing was measured."""
    if usual is None or most is None:
        return ""
    return f"{usual * times:.1f} {unit}, {most * times:.1f} {unit}"


def _silence(seen: Mapping[str, Any]) -> str:
    where: Sequence[float] | None = seen.get("silent_at")
    if seen.get("unheard") and not seen.get("silent_s"):
        return "never heard"
    place = f" at {where[0]:.5f} {where[1]:.5f}" if where is not None and len(where) == 2 else ""
    return f"{seen.get('silent_s')} s{place}"

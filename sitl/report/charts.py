# SPDX-License-Identifier: GPL-3.0-or-later

"""The other pictures of a run: the messages of one handover, and what held when.

The sequence chart has a row for each message, in order, not to scale: a handover takes milliseconds and its messages
come in bursts. The times stand at the lanes where a message left and where it came.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sitl.report.evidence import NOBODY, Evidence
from sitl.report.exchange import Exchange, Flight, lanes
from sitl.report.journal_reader import Entry
from sitl.report.palette import INK, NOBODY_COLOUR, colours
from sitl.report.pictures import figure
from sitl.report.watch import VEHICLE

__all__ = ["MAX_ROWS", "draw_sequence", "draw_timeline"]

#: more messages than this are not drawn; the table of the report has them all
MAX_ROWS = 60
_ROW_IN, _WIDTH_IN = 0.36, 10.0
_LANE_X = (0.2, 0.5, 0.8)
_STEP = {
    "HANDOVER_REQUEST": "1",
    "ON_HANDOVER": "2",
    "OK_HANDOVER": "3",
    "CONNECT_HANDOVER": "4",
    "DRONE_CONNECTED": "5",
    "DISCONNECT_HANDOVER": "6",
    "HANDOVER_RESULT": "7",
}
_PHASE_COLOURS = {"on_load": "#D9D9D9", "on_mission": "#BFD9EC", "on_handover": "#F5D76E", "emergency": "#E08A8A"}
_LEASE_COLOURS = {"held": "#CFE8DC", "transfer": "#F5D76E", "lost": "#E08A8A", "recovering": "#E6CFE0"}
_GUARD_COLOURS = {"live": "#CFE8DC", "expired": "#E08A8A", "lost": "#E08A8A"}
_SILENT = "companion silent"
_PLAIN = ("#E3E3E3", "#F1F1F1")


def draw_sequence(transfer: Exchange, station_colours: dict[str, str], path: Path) -> None:
    """Write the sequence of one handover's messages as a PNG."""
    rows: list[Flight | None] = list(transfer.flights[:MAX_ROWS])
    if transfer.ended_t is not None:
        place = sum(
            flight.t <= transfer.ended_t and flight.name != "HANDOVER_RESULT" for flight in transfer.flights[:MAX_ROWS]
        )
        rows.insert(place, None)
    height = _ROW_IN * (len(rows) + 1) + 1.45
    made, axes = figure(_WIDTH_IN, height)
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(height, 0)
    axes.text(0.02, 0.3, _title(transfer), fontsize=12, fontweight="bold", color=INK, va="center")
    names = lanes(transfer)
    roles = ("commander", "vehicle", "partner")
    for x, name, role in zip(_LANE_X, names, roles, strict=True):
        colour = station_colours.get(name, "#444444")
        axes.plot([x, x], [1.08, height - 0.2], color=colour, linewidth=1.6, zorder=1)
        box = {"facecolor": "white", "edgecolor": colour, "boxstyle": "round,pad=0.35", "linewidth": 1.6}
        axes.text(x, 0.86, f"{name} ({role})", ha="center", va="center", fontsize=10, color=INK, bbox=box, zorder=3)
    y = 1.08 + _ROW_IN
    for row in rows:
        if row is None:
            _commit(axes, transfer, y)
        else:
            _arrow(axes, transfer, row, y, dict(zip(names, _LANE_X, strict=True)))
        y += _ROW_IN
    made.savefig(path)


def _title(transfer: Exchange) -> str:
    took = "" if transfer.duration_s is None else f" in {transfer.duration_s * 1000:.1f} ms"
    if transfer.committed:
        outcome = f"committed{took}"
    else:
        outcome = f"aborted: {transfer.reason.replace('_', ' ')}" if transfer.ended_t else "not ended"
    return f"Handover {transfer.handover_id}: {transfer.commander} → {transfer.partner}, {outcome}"


def _commit(axes: Any, transfer: Exchange, y: float) -> None:
    if transfer.committed:
        text = f"{transfer.vehicle} commits: {transfer.partner} commands" + (
            f", epoch {transfer.epoch}" if transfer.epoch is not None else ""
        )
    else:
        text = f"{transfer.vehicle} aborts: {transfer.commander} stays ({transfer.reason.replace('_', ' ')})"
    middle = y - 0.06
    axes.axhspan(middle - 0.13, middle + 0.13, xmin=0.1, xmax=0.9, facecolor="#F2F2F2", edgecolor="#BBBBBB", zorder=2)
    axes.text(0.5, middle, text, ha="center", va="center", fontsize=9, fontweight="bold", color=INK, zorder=4)
    axes.text(0.09, middle, _ms(transfer, transfer.ended_t), ha="right", va="center", fontsize=8, color=INK)


def _arrow(axes: Any, transfer: Exchange, flight: Flight, y: float, places: dict[str, float]) -> None:
    start, end = places.get(flight.sender), places.get(flight.receiver)
    if start is None or end is None:
        return
    lost = flight.received_t is None
    stop = start + (end - start) * 0.72 if lost else end
    style = (0, (5, 2.5)) if flight.relayed or flight.attempt > 1 else "-"
    colour = "#B00020" if lost else INK
    head = "-" if lost else "-|>"
    line = {"arrowstyle": head, "color": colour, "linewidth": 1.1, "linestyle": style, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (stop, y), (start, y), arrowprops=line, zorder=2)
    if lost:
        axes.plot([stop], [y], marker="x", markersize=7, markeredgewidth=1.8, color=colour, zorder=3)
    middle = _LANE_X[1]
    if min(start, end) < middle < max(start, end):
        # over the ground link: the line jumps over the vehicle's lane
        axes.plot([middle - 0.006, middle + 0.006], [y, y], color="white", linewidth=2.5, zorder=2.5)
        axes.plot([middle - 0.008, middle, middle + 0.008], [y, y - 0.08, y], color=colour, linewidth=1.1, zorder=2.6)
    words = f"{_STEP.get(flight.name, '')}  {flight.name}".strip()
    notes = [note for note in _notes(flight, lost) if note]
    label = words + (f"  ({', '.join(notes)})" if notes else "")
    centre = (start + end) / 2 if abs(end - start) < 0.4 else start + (end - start) * 0.25
    axes.text(centre, y - 0.05, label, ha="center", va="bottom", fontsize=8, color=colour, zorder=4)
    for t, x, other in ((flight.sent_t, start, end), (flight.received_t, end, start)):
        if t is not None:
            left = x < other
            axes.text(
                x - 0.008 if left else x + 0.008, y, _ms(transfer, t), ha="right" if left else "left", va="center",
                fontsize=7, color="#555555", zorder=4,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
            )  # fmt: skip


def _notes(flight: Flight, lost: bool) -> tuple[str, ...]:
    return (
        f"try {flight.attempt}" if flight.attempt > 1 else "",
        "passed on by the vehicle" if flight.relayed else "",
        "ground link" if flight.ground else "",
        flight.consent if flight.consent not in ("", "granted") else "",
        "lost" if lost else "",
    )


def _ms(transfer: Exchange, t: float | None) -> str:
    return "" if t is None else f"{(t - transfer.begun_t) * 1000:.1f} ms"


# ---- the timeline -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Bar:
    start_s: float
    end_s: float
    text: str
    colour: str


def draw_timeline(evidence: Evidence, transfers: Sequence[Exchange], path: Path) -> None:
    """Write what held when (commander, phase, lease, guard, flight mode) over simulated time as a PNG."""
    first, last = _span(evidence)
    station_colours = colours([station.name for station in evidence.package.stations])
    views = evidence.of(event="view")
    rows = [
        (
            "commander",
            _bars(evidence, views, last, lambda e: evidence.station_name(e.get("commander")), station_colours),
        ),
        ("phase", _bars(evidence, views, last, lambda e: str(e.get("phase", "")), _PHASE_COLOURS)),
        ("lease", _bars(evidence, views, last, lambda e: str(e.get("lease", "")), _LEASE_COLOURS)),
        ("guard", _bars(evidence, evidence.of(event="guard"), last, _guard_word, _GUARD_COLOURS)),
        ("flight mode", _bars(evidence, evidence.of(VEHICLE, "mode"), last, lambda e: str(e.get("mode")), {})),
    ]
    height = 0.42 * len(rows) + 1.35
    made, axes = figure(_WIDTH_IN + 1, height)
    axes.set_position((0.09, 0.55 / height, 0.895, (height - 1.2) / height))
    axes.set_xlim(first, last)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), [name for name, _ in rows], fontsize=9)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=8)
    axes.set_xlabel("simulated seconds", fontsize=9)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for place, (_, bars) in enumerate(rows):
        for bar in bars:
            _draw_bar(made, axes, place, bar)
    _flags(made, axes, evidence, transfers)
    made.savefig(path)


def _span(evidence: Evidence) -> tuple[float, float]:
    """From arming, with a little before it, to the end."""
    last = evidence.sim_at(evidence.entries[-1].t) if evidence.entries else 1.0
    armed = evidence.of(VEHICLE, "armed")
    first = max(0.0, evidence.sim_at(armed[0].t) - 10.0) if armed else 0.0
    return (first, last) if last > first else (0.0, first + 1.0)


def _guard_word(entry: Entry) -> str:
    return entry.text.rsplit("->", 1)[-1].strip()


def _bars(evidence: Evidence, entries: Sequence[Entry], last: float, word: Any, palette: dict[str, str]) -> list[_Bar]:
    changes: list[tuple[float, str]] = []
    for entry in entries:
        text = word(entry)
        if not changes or changes[-1][1] != text:
            changes.append((evidence.sim_at(entry.t), text))
    bars = []
    silent_s = evidence.sim_at(min(evidence.companion_ended_t(), evidence.entries[-1].t)) if changes else last
    if entries and entries[0].who != VEHICLE and silent_s < last:
        changes = [*(change for change in changes if change[0] < silent_s), (silent_s, _SILENT)]
    for index, (start, text) in enumerate(changes):
        end = changes[index + 1][0] if index + 1 < len(changes) else last
        fallback = {NOBODY: NOBODY_COLOUR, _SILENT: "#C4C4C4"}.get(text, _PLAIN[index % 2])
        bars.append(_Bar(start, end, text.replace("_", " "), palette.get(text, fallback)))
    return bars


def _draw_bar(made: Any, axes: Any, place: int, bar: _Bar) -> None:
    low, high = axes.get_xlim()
    start, end = max(bar.start_s, low), min(bar.end_s, high)
    if end <= start:
        return
    axes.barh(place, end - start, left=start, height=0.72, color=bar.colour, edgecolor="white", linewidth=0.8)
    dark = sum(int(bar.colour[i : i + 2], 16) for i in (1, 3, 5)) < 380
    text = axes.text(
        (start + end) / 2, place, bar.text, ha="center", va="center", fontsize=8, color="white" if dark else INK
    )
    renderer = made.canvas.get_renderer()
    wide = text.get_window_extent(renderer).width + 4
    room = axes.transData.transform((end, 0))[0] - axes.transData.transform((start, 0))[0]
    if wide > room:
        text.remove()


def _flags(made: Any, axes: Any, evidence: Evidence, transfers: Sequence[Exchange]) -> None:
    """Moments, as lines with a word above; words that would overlap go up a line."""
    spots = [
        (evidence.sim_at(transfer.ended_t), f"handover {transfer.handover_id}")
        for transfer in transfers
        if transfer.ended_t is not None
    ]
    spots += [
        (evidence.sim_at(entry.t), str(entry.get("reason", "emergency")).replace("_", " "))
        for entry in evidence.of(event="emergency")
    ]
    known = {text for _, text in spots}
    spots += [(evidence.sim_at(t), label) for label, t in evidence.notes.marks.items() if label not in known]
    renderer = made.canvas.get_renderer()
    ends = [float("-inf")] * 3
    low, high = axes.get_xlim()
    for at, text in sorted(spots):
        if not low <= at <= high:
            continue
        axes.axvline(at, color=INK, linewidth=0.9, zorder=5)
        label = axes.text(at, -0.5, text, ha="center", va="bottom", fontsize=8, color=INK)
        box = label.get_window_extent(renderer)
        line = next((i for i, end in enumerate(ends) if box.x0 > end + 4), len(ends) - 1)
        ends[line] = box.x1
        label.set_position((at, -0.5 - 0.36 * line))

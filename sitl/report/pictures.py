# SPDX-License-Identifier: GPL-3.0-or-later

"""The map of a flight as a picture beside the page: the mission's map (`mission/picture.py`), and the flight on it.

matplotlib is imported when a picture is drawn, not before: a vehicle has no use for it. Labels are put where they
cover the least; `labels.py` looks for the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.mission.colours import ALARM, INK, NOBODY, PAPER, WARNING
from mavproxy_handover.mission.drawing import columns
from mavproxy_handover.mission.picture import MapSheet
from sitl.report.evidence import NOBODY as NOBODY_NAME
from sitl.report.evidence import Evidence
from sitl.report.exchange import Exchange
from sitl.report.labels import LabelPlacer
from sitl.report.outcome import emergencies, level_of
from sitl.report.palette import colours
from sitl.report.times import duration
from sitl.report.track import airborne, nearest, pieces
from sitl.report.watch import VEHICLE

__all__ = ["draw_map", "figure"]

_DPI = 130


def figure(width_in: float, height_in: float) -> tuple[Any, Any]:
    """A figure and its only axes, without any window system."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width_in, height_in), dpi=_DPI)
    FigureCanvasAgg(made)
    return made, made.add_axes((0.0, 0.0, 1.0, 1.0))


def draw_map(evidence: Evidence, transfers: Sequence[Exchange], path: Path) -> None:
    """Write the map as a PNG. Raises OSError."""
    samples = airborne(evidence)
    sheet = MapSheet(evidence.package, also=[(sample.lat_deg, sample.lon_deg) for sample in samples])
    made, axes = figure(*sheet.size_inches())
    labels = LabelPlacer(made, axes)
    drawn = _Flown(evidence, sheet, labels)
    sheet.paint(axes, lambda there: drawn.draw(there, transfers))
    labels.place()
    made.savefig(path, facecolor=PAPER, bbox_inches="tight", pad_inches=0.15)


class _Flown:
    def __init__(self, evidence: Evidence, sheet: MapSheet, labels: LabelPlacer) -> None:
        self._evidence, self._sheet, self._labels = evidence, sheet, labels
        self._samples = airborne(evidence)
        self._colours = colours(evidence.stations)

    def draw(self, axes: Any, transfers: Sequence[Exchange]) -> str:
        """Draw it; returns the words for the head of the map."""
        self._emergencies(axes)
        self._track(axes)
        self._handovers(axes, transfers)
        self._marks(axes)
        committed = sum(transfer.committed for transfer in transfers)
        failed = len(transfers) - committed
        return f"as flown: {committed} handovers" + (f", {failed} came to nothing" if failed else "")

    def _place(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        return self._sheet.place(lat_deg, lon_deg)

    def _emergencies(self, axes: Any) -> None:
        shown: set[str] = set()
        for stretch in emergencies(self._evidence):
            line = [
                self._place(sample.lat_deg, sample.lon_deg)
                for sample in self._samples
                if stretch.begin_t <= sample.t <= stretch.end_t
            ]
            if len(line) > 1:
                name, colour = stretch.word, ALARM if stretch.level is Level.EMERGENCY else WARNING
                style = {"color": colour, "alpha": 0.4, "linewidth": 10, "solid_capstyle": "round", "zorder": 4.5}
                axes.plot(*columns(line), label=None if name in shown else name, **style)
                shown.add(name)

    def _track(self, axes: Any) -> None:
        """The flown track, cut where the commander changes."""
        from matplotlib.patheffects import Normal, Stroke

        named: set[str] = set()
        for name, piece in pieces(self._evidence, self._samples):
            line = [self._place(sample.lat_deg, sample.lon_deg) for sample in piece]
            words = "no station commands" if name == NOBODY_NAME else f"{name} commands"
            axes.plot(
                *columns(line),
                color=self._colours.get(name, NOBODY),
                linewidth=2.8,
                solid_capstyle="round",
                label=None if name in named else words,
                zorder=5,
                path_effects=[Stroke(linewidth=4.6, foreground=PAPER), Normal()],
            )
            named.add(name)
            self._labels.avoid(line)

    def _handovers(self, axes: Any, transfers: Sequence[Exchange]) -> None:
        """A mark where each transfer ended, in the colour of who commanded then."""
        label: str | None = "handover"
        for transfer in transfers:
            sample = None if transfer.ended_t is None else nearest(self._evidence.samples, transfer.ended_t)
            if sample is None:
                continue
            point = self._place(sample.lat_deg, sample.lon_deg)
            colour = self._colours.get(transfer.partner if transfer.committed else transfer.commander, NOBODY)
            style = {"markersize": 10, "markeredgecolor": INK, "markeredgewidth": 1.2, "zorder": 9, "ls": "none"}
            axes.plot(*point, marker="D", color=colour, label=label, **style)
            label = None
            self._labels.block(point, 8)
            took = "" if transfer.duration_s is None else f"\n{duration(transfer.duration_s)}"
            word = f"{transfer.commander} → {transfer.partner}" if transfer.committed else f"not to {transfer.partner}"
            self._labels.add(f"handover {transfer.handover_id}: {word}{took}", point, size=9, boxed=True)

    def _marks(self, axes: Any) -> None:
        """Emergencies, refusals, what the scenario broke, and the landing."""
        refused = [nearest(self._evidence.samples, entry.t) for entry in self._evidence.of(event="refused")]
        places = [self._place(sample.lat_deg, sample.lon_deg) for sample in refused if sample is not None]
        if places:
            axes.plot(*columns(places), "x", color=INK, markersize=6, label="refused", zorder=8, ls="none")
        spots: list[tuple[float, str, str]] = []
        for entry in self._evidence.of(event="emergency"):
            colour = INK if level_of(entry) < Level.EMERGENCY else ALARM
            spots.append((entry.t, str(entry.get("reason", "emergency")).replace("_", " "), colour))
        for label, t in self._evidence.notes.marks.items():
            if not any(text == label for _, text, _ in spots):
                spots.append((t, label, ALARM))
        for t, text, colour in spots:
            sample = nearest(self._evidence.samples, t)
            if sample is not None:
                point = self._place(sample.lat_deg, sample.lon_deg)
                axes.plot(*point, marker="X", markersize=10, markerfacecolor=colour, markeredgecolor=PAPER, zorder=10)
                self._labels.block(point, 7)
                self._labels.add(text, point, size=9, colour=colour, bold=True)
        for entry in self._evidence.of(VEHICLE, "landed")[-1:]:
            if None not in (entry.get("lat_deg"), entry.get("lon_deg")):
                point = self._place(entry.get("lat_deg"), entry.get("lon_deg"))
                style = {"markersize": 21, "markerfacecolor": "none", "markeredgecolor": INK, "markeredgewidth": 1.6}
                axes.plot(*point, marker="o", zorder=10, **style)
                self._labels.block(point, 11)
                self._labels.add("landed", point, size=9, bold=True)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The map of a run: zones, handover region, route, and the track in the colour of whoever commanded.

matplotlib is imported when a picture is drawn, not before: a vehicle has no use for it. Labels are put where they
cover the least; `labels.py` looks for the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from shapely.geometry import MultiPolygon, Polygon
from shapely.ops import unary_union

from mavproxy_handover.mission.geodesy import LocalPlane
from mavproxy_handover.mission.zones import Zone, beside, overlap
from sitl.report.evidence import NOBODY, Evidence
from sitl.report.exchange import Exchange
from sitl.report.labels import LabelPlacer
from sitl.report.palette import INK, NOBODY_COLOUR, colours
from sitl.report.watch import VEHICLE, Sample

__all__ = ["draw_map", "figure"]

_WIDTH_IN, _DPI = 11.0, 130


def figure(width_in: float, height_in: float) -> tuple[Any, Any]:
    """A figure and its only axes, without any window system."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width_in, height_in), dpi=_DPI)
    FigureCanvasAgg(made)
    return made, made.add_axes((0.0, 0.0, 1.0, 1.0))


def draw_map(evidence: Evidence, transfers: Sequence[Exchange], path: Path) -> None:
    """Write the map as a PNG."""
    picture = _Map(evidence)
    picture.zones()
    picture.route()
    picture.track()
    picture.handovers(transfers)
    picture.marks()
    picture.finish(path)


class _Map:
    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence
        home = evidence.package.route.home
        self._plane = LocalPlane(home.lat_deg, home.lon_deg)
        self._colours = colours([station.name for station in evidence.package.stations])
        self._changes = evidence.commanders()
        self._xs: list[float] = []
        self._ys: list[float] = []
        self._lines: list[list[tuple[float, float]]] = []
        width, height = self._size()
        self._figure, self._axes = figure(width, height)
        self._axes.set_position((0.065, 0.58 / height, 0.92, (height - 1.05) / height))
        self._labels = LabelPlacer(self._figure, self._axes)

    def _size(self) -> tuple[float, float]:
        """Figure size that fits the shape of the zones."""
        corners = [
            self._plane.to_plane(lat, lon)
            for zone in self._evidence.package.zones
            for part in getattr(zone.outline(), "geoms", [zone.outline()])
            for lon, lat in part.exterior.coords
        ]
        corners += [self._plane.to_plane(sample.lat_deg, sample.lon_deg) for sample in self._flown()]
        width = max(x for x, _ in corners) - min(x for x, _ in corners)
        height = max(y for _, y in corners) - min(y for _, y in corners)
        return _WIDTH_IN, min(12.0, max(5.5, _WIDTH_IN * 0.92 * height / max(width, 1.0) + 1.6))

    def _flown(self) -> list[Sample]:
        return [sample for sample in self._evidence.samples if sample.alt_m > 0.5 or sample.speed_mps > 0.5]

    def _xy(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        x, y = self._plane.to_plane(lat_deg, lon_deg)
        self._xs.append(x)
        self._ys.append(y)
        return x, y

    def _outline(self, zone: Zone) -> Polygon | MultiPolygon:
        return beside(zone.outline(), self._plane.lon_deg)

    def _rings(self, area: Any) -> list[list[tuple[float, float]]]:
        return [
            [self._xy(lat, lon) for lon, lat in part.exterior.coords]
            for part in getattr(area, "geoms", [area])
            if not part.is_empty
        ]

    def zones(self) -> None:
        """Each zone in its station's colour, the handover regions hatched."""
        zones = self._evidence.package.zones
        for zone in zones:
            others = [self._outline(other) for other in zones if other is not zone]
            alone = self._rings(self._outline(zone).difference(unary_union(others)))
            colour = self._colours.get(zone.station_name, NOBODY_COLOUR)
            rings = self._rings(self._outline(zone))
            for ring in rings:
                xs, ys = zip(*ring, strict=True)
                self._axes.fill(xs, ys, facecolor=colour, alpha=0.09, zorder=1)
                self._axes.plot(xs, ys, color=colour, linewidth=1.8, zorder=3)
                self._lines.append(ring)
            # the name stands where no other zone is, as long as there is such a place
            room = max(alone or rings, key=len)
            self._labels.add(f"zone of {zone.station_name}", room[0], size=11, colour=colour, bold=True, inside=room)
        for first, second in combinations(zones, 2):
            for ring in self._rings(overlap(first, second)):
                xs, ys = zip(*ring, strict=True)
                self._axes.fill(xs, ys, facecolor="none", edgecolor="#9A9A9A", hatch="////", linewidth=0, zorder=2)

    def route(self) -> None:
        """The planned route with the numbers of its items, home, rally points, delivery."""
        package = self._evidence.package
        home = self._xy(package.route.home.lat_deg, package.route.home.lon_deg)
        points = [home]
        for item in package.route.items:
            if not item.has_place:
                continue
            point = self._xy(item.lat_deg, item.lon_deg)
            points.append(point)
            if point == home or _near(point, home):
                continue
            delivery = item.seq == package.delivery_waypoint
            self._axes.plot(
                *point,
                marker="s" if delivery else "o",
                markersize=13,
                markerfacecolor="white",
                markeredgecolor=INK,
                markeredgewidth=1.6 if delivery else 0.9,
                zorder=7,
            )
            self._axes.text(*point, str(item.seq), ha="center", va="center_baseline", fontsize=7.5, color=INK, zorder=8)
            self._labels.block(point, 9)
            if delivery:
                self._labels.add("delivery", point, size=9)
        self._axes.plot(*zip(*points, strict=True), color=INK, linewidth=0.9, linestyle=(0, (4, 3)), zorder=4)
        self._axes.plot(*home, marker="H", markersize=15, markerfacecolor=INK, markeredgecolor="white", zorder=7)
        self._labels.block(home, 9)
        self._labels.add("home", home, size=9, bold=True)
        for number, rally in enumerate(package.route.rally, 1):
            point = self._xy(rally.lat_deg, rally.lon_deg)
            self._axes.plot(*point, marker="^", markersize=11, markerfacecolor="white", markeredgecolor=INK, zorder=7)
            self._labels.block(point, 8)
            self._labels.add(f"rally point {number}", point, size=9)

    def track(self) -> None:
        """The flown track, cut where the commander changes."""
        from matplotlib.patheffects import Normal, Stroke

        for name, piece in _pieces(self._evidence, self._flown()):
            line = [self._xy(sample.lat_deg, sample.lon_deg) for sample in piece]
            colour = self._colours.get(name, NOBODY_COLOUR)
            self._axes.plot(
                *zip(*line, strict=True),
                color=colour,
                linewidth=2.6,
                solid_capstyle="round",
                zorder=5,
                path_effects=[Stroke(linewidth=4.4, foreground="white"), Normal()],
            )
            self._lines.append(line)

    def handovers(self, transfers: Sequence[Exchange]) -> None:
        """A mark where each transfer ended, filled with the new commander's colour."""
        for transfer in transfers:
            if transfer.ended_t is None:
                continue
            sample = _nearest(self._evidence.samples, transfer.ended_t)
            if sample is None:
                continue
            point = self._xy(sample.lat_deg, sample.lon_deg)
            colour = self._colours.get(transfer.partner if transfer.committed else transfer.commander, NOBODY_COLOUR)
            self._axes.plot(
                *point, marker="D", markersize=10, markerfacecolor=colour, markeredgecolor=INK, markeredgewidth=1.2,
                zorder=9,
            )  # fmt: skip
            self._labels.block(point, 8)
            took = "" if transfer.duration_s is None else f"\n{transfer.duration_s * 1000:.0f} ms"
            word = f"{transfer.commander} → {transfer.partner}" if transfer.committed else f"not to {transfer.partner}"
            self._labels.add(f"handover {transfer.handover_id}: {word}{took}", point, size=9, boxed=True)

    def marks(self) -> None:
        """Emergencies, what the scenario broke, and the landing."""
        spots: list[tuple[float, str]] = []
        for entry in self._evidence.of(event="emergency"):
            spots.append((entry.t, str(entry.get("reason", "emergency")).replace("_", " ")))
        for label, t in self._evidence.notes.marks.items():
            if not any(text == label for _, text in spots):
                spots.append((t, label))
        for t, text in spots:
            sample = _nearest(self._evidence.samples, t)
            if sample is not None:
                self._cross((sample.lat_deg, sample.lon_deg), text, "#B00020")
        for entry in self._evidence.of(VEHICLE, "landed")[-1:]:
            if entry.get("lat_deg") is not None:
                point = self._xy(entry.get("lat_deg"), entry.get("lon_deg"))
                self._axes.plot(
                    *point, marker="o", markersize=21, markerfacecolor="none", markeredgecolor=INK, markeredgewidth=1.6,
                    zorder=10,
                )  # fmt: skip
                self._labels.block(point, 11)
                self._labels.add("landed", point, size=9, bold=True)

    def _cross(self, where: tuple[float, float], text: str, colour: str) -> None:
        point = self._xy(*where)
        self._axes.plot(*point, marker="X", markersize=10, markerfacecolor=colour, markeredgecolor="white", zorder=10)
        self._labels.block(point, 7)
        self._labels.add(text, point, size=9, colour=colour, bold=True)

    def finish(self, path: Path) -> None:
        """Limits, labels, legend; write the file."""
        self._set_limits()
        self._axes.set_xlabel("metres east of home", fontsize=9, color=INK)
        self._axes.set_ylabel("metres north of home", fontsize=9, color=INK)
        self._axes.tick_params(labelsize=8, colors=INK)
        self._axes.grid(color="#DDDDDD", linewidth=0.5, zorder=0)
        self._axes.set_axisbelow(True)
        for spine in self._axes.spines.values():
            spine.set_color("#BBBBBB")
        self._legend()
        for line in self._lines:
            self._labels.avoid(line)
        self._labels.place()
        self._figure.savefig(path)

    def _set_limits(self) -> None:
        """A metre is as long upwards as sideways, and everything is in the picture with a little room around."""
        wide, high = max(self._xs) - min(self._xs), max(self._ys) - min(self._ys)
        frame = self._axes.get_window_extent()
        per_px = 1.08 * max(wide / frame.width, high / frame.height, 50.0 / frame.width)
        x, y = (max(self._xs) + min(self._xs)) / 2, (max(self._ys) + min(self._ys)) / 2
        self._axes.set_xlim(x - per_px * frame.width / 2, x + per_px * frame.width / 2)
        self._axes.set_ylim(y - per_px * frame.height / 2, y + per_px * frame.height / 2)

    def _legend(self) -> None:
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        names = [station.name for station in self._evidence.package.stations]
        flown = {name for name, _ in _pieces(self._evidence, self._flown())}
        handles: list[Any] = [
            Line2D([], [], color=self._colours[name], linewidth=3, label=f"{name} commands") for name in names
        ]
        if NOBODY in flown:
            handles.append(Line2D([], [], color=NOBODY_COLOUR, linewidth=3, label="nobody commands"))
        handles.append(Line2D([], [], color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="planned route"))
        handles.append(Patch(facecolor="none", edgecolor="#9A9A9A", hatch="////", linewidth=0, label="handover region"))
        self._figure.legend(
            handles=handles, loc="upper center", ncols=len(handles), fontsize=9, frameon=False, bbox_to_anchor=(0.52, 1)
        )


def _near(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return abs(a[0] - b[0]) < 2.0 and abs(a[1] - b[1]) < 2.0


def _pieces(evidence: Evidence, samples: Sequence[Sample]) -> list[tuple[str, list[Sample]]]:
    """The track in pieces of one commander; neighbours share the sample at the change, so the line has no gap.

    After the companion's death nobody commands any more, whatever its last word was.
    """
    changes = evidence.commanders()
    end = evidence.companion_ended_t()
    pieces: list[tuple[str, list[Sample]]] = []
    for sample in samples:
        name = NOBODY if sample.t > end else evidence.commander_at(sample.t, changes)
        if not pieces or pieces[-1][0] != name:
            if pieces:
                pieces[-1][1].append(sample)
            pieces.append((name, []))
        pieces[-1][1].append(sample)
    return [(name, piece) for name, piece in pieces if len(piece) > 1]


def _nearest(samples: Sequence[Sample], t: float) -> Sample | None:
    return min(samples, key=lambda sample: abs(sample.t - t), default=None)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Draws the map of a mission: zones, handover regions, the route in the colours of its commanders.

Needs matplotlib, which `mavproxy-handover-sim` brings and which is loaded here only. The map is drawn in metres around
home, so circles are round and the scale bar is right; the axes are labelled in degrees.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import shapely

from mavproxy_handover.mission.check import Finding
from mavproxy_handover.mission.colours import (
    ALARM,
    DELIVERY,
    GRID,
    GROUND,
    INK,
    PAPER,
    RALLY,
    SOFT,
    station_colour,
)
from mavproxy_handover.mission.drawing import Points, columns, degrees, halo, note, patch, round_down, ticks
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.flat import parts, quiet_place
from mavproxy_handover.mission.gaps import undeclared
from mavproxy_handover.mission.geodesy import LocalPlane
from mavproxy_handover.mission.items import COMMANDS, LANDINGS, RETURN_TO_LAUNCH, TAKEOFFS
from mavproxy_handover.mission.map_findings import colours_of_items, list_findings
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FenceCircle
from mavproxy_handover.mission.route_simulation import Gap, Handover, RouteSimulation, Sample, by_commander
from mavproxy_handover.mission.zones import Circle, Zone, overlap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from shapely.geometry import MultiPolygon, Polygon

__all__ = ["MapSheet", "draw"]

#: latitude, longitude
Place = tuple[float, float]
#: places nearer than that (m) are one on a map
_SAME_M: Final = 3.0
_LEGEND_COLUMNS: Final = 4
#: height of the words of a zone
_LABEL_POINTS: Final = 40.0


def draw(
    package: MissionPackage,
    path: str | Path,
    simulation: RouteSimulation | None = None,
    findings: Sequence[Finding] = (),
) -> None:
    """Draw the map of `package` into the file `path`, whose ending tells the format.

    `simulation` saves another simulation of the route. `findings`: errors and warnings are listed below the map, and
    the items that they name are marked. Raises MissionError when matplotlib is missing or the file cannot be written.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissionError(f"{path}: a map needs matplotlib: pip install mavproxy-handover-sim") from None
    sheet = MapSheet(package, simulation, marked=colours_of_items(findings))
    figure = Figure(figsize=sheet.size_inches(), dpi=130)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    sheet.paint(axes)
    list_findings(axes, findings, _below_legend(axes))
    try:
        figure.savefig(path, facecolor=PAPER, bbox_inches="tight", pad_inches=0.15)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise MissionError(f"{path}: cannot write the map: {reason}") from None


def _below_legend(axes: Axes) -> float:
    """How many points below the axes the legend ends."""
    rows = math.ceil(len(axes.get_legend_handles_labels()[1]) / _LEGEND_COLUMNS)
    return 36.0 + 15.0 * rows


def _listed(numbers: Sequence[int]) -> str:
    """Up to three numbers, or the first and the last."""
    return ", ".join(map(str, numbers)) if len(numbers) <= 3 else f"{numbers[0]} ... {numbers[-1]}"


class MapSheet:
    """One map for one pair of axes. `simulation` saves another one; `also`: places that must be on it.

    `marked`: colours of the items that a finding names.

    A report draws a flight on it, by `place`: then the plan steps back.
    """

    def __init__(
        self,
        package: MissionPackage,
        simulation: RouteSimulation | None = None,
        also: Iterable[Place] = (),
        marked: Mapping[int, str] | None = None,
    ) -> None:
        self._marked = marked or {}
        self._package, self._simulation = package, simulation or package.simulate()
        simulation = self._simulation
        home = package.route.home
        self._plane = LocalPlane(home.lat_deg, home.lon_deg)
        self._home = self.place(home.lat_deg, home.lon_deg)
        self._colour = {station.sysid: station_colour(number) for number, station in enumerate(package.stations)}
        self._marks = list(
            {sample.seq: self.place(sample.lat_deg, sample.lon_deg) for sample in simulation.samples}.values()
        )
        self._marks += self._rally_points()
        self._marks += [self.place(handover.lat_deg, handover.lon_deg) for handover in simulation.handovers]
        flown = (self.place(sample.lat_deg, sample.lon_deg) for sample in simulation.samples)
        self._bounds = self._all_bounds([*(self.place(*place) for place in also), *flown])

    def size_inches(self) -> tuple[float, float]:
        """Width and height of the axes, in the proportions of the map."""
        west, south, east, north = self._bounds
        tall = (north - south) / (east - west)
        return (10.0, 10.0 * tall) if tall < 0.9 else (9.0 / tall, 9.0)

    def place(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Where a place is on the axes: metres east and north of home."""
        return self._plane.to_plane(lat_deg, lon_deg)

    def paint(self, axes: Axes, flown: Callable[[Axes], str] | None = None) -> None:
        """Draw everything, and set the limits, labels and legend of the axes.

        `flown` draws what was flown and returns the words for the head; what was planned is a thin line then.
        """
        axes.set_aspect("equal")
        axes.set_facecolor(GROUND)
        self._zones(axes)
        self._regions(axes)
        self._fence(axes)
        if flown is None:
            self._route(axes)
        else:
            self._plan(axes)
        self._rally(axes)
        if flown is None:
            self._handovers(axes)
        self._items(axes)
        self._frame(axes)
        self._heading(axes, self._facts() if flown is None else flown(axes))

    # --- the ground ---

    def _zones(self, axes: Axes) -> None:
        zones, named = self._package.zones, list[tuple[float, float]]()
        for zone in zones:
            place = self._quiet_place(zone)
            # a zone that lies on another one has its words above those of the other
            shift = _LABEL_POINTS * sum(math.dist(place, other) < self._label_m() for other in named)
            named.append(place)
            colour = self._colour[zone.station]
            for part in self._parts(zone.outline()):
                axes.add_patch(patch(part, facecolor=colour, alpha=0.13, linewidth=0.0, zorder=1))
                axes.add_patch(patch(part, facecolor="none", edgecolor=colour, linewidth=2.0, zorder=3))
            if isinstance(zone.area, Circle):
                axes.plot(*self.place(zone.area.lat_deg, zone.area.lon_deg), "+", color=colour, markersize=9, zorder=3)
            limits = [
                f"{word} {value:g} m"
                for word, value in (("above", zone.min_alt_m), ("below", zone.max_alt_m))
                if value is not None
            ]
            axes.annotate(
                "\n".join([*textwrap.wrap(zone.name, 14), *limits]),
                place,
                (0, shift - 8),
                textcoords="offset points",
                color=colour,
                fontsize=9,
                ha="center",
                va="top",
                zorder=9,
                path_effects=halo(),
            )
            axes.annotate(
                zone.station_name,
                place,
                (0, shift),
                textcoords="offset points",
                color=colour,
                fontsize=14,
                fontweight="bold",
                ha="center",
                va="center",
                zorder=9,
                path_effects=halo(),
            )

    def _label_m(self) -> float:
        """Two places nearer than that have no room for the words of two zones."""
        return 0.03 * (self._bounds[2] - self._bounds[0])

    def _quiet_place(self, zone: Zone) -> tuple[float, float]:
        """The middle of the largest circle in the zone that is free of other zones, route, marks and their notes."""
        area = shapely.union_all(self._parts(zone.outline()))
        line = shapely.LineString([self.place(sample.lat_deg, sample.lon_deg) for sample in self._simulation.samples])
        marks = shapely.MultiPoint(self._marks).buffer(math.sqrt(area.area) / 8.0)
        others = [other for other in self._package.zones if other is not zone]
        outlines = (shapely.union_all(self._parts(other.outline())) for other in others)
        return quiet_place(area, (line.buffer(1.0), marks, *outlines))

    def _rally_points(self) -> Points:
        return [self.place(point.lat_deg, point.lon_deg) for point in self._package.route.rally]

    def _regions(self, axes: Axes) -> None:
        label: str | None = "handover region"
        for first, second in combinations(self._package.zones, 2):
            for part in self._parts(overlap(first, second)):
                hatched = patch(
                    part, facecolor="none", edgecolor=SOFT, hatch="///", linewidth=0.0, alpha=0.55, zorder=2
                )
                hatched.set_label(label or "")
                axes.add_patch(hatched)
                label = None

    def _fence(self, axes: Axes) -> None:
        label: str | None = "geofence"
        for part in self._package.route.fence:
            if isinstance(part, FenceCircle):
                outline = Circle(part.lat_deg, part.lon_deg, part.radius_m).outline()
                corners = [(lat, lon) for lon, lat in outline.exterior.coords]
            else:
                corners = [*part.corners, part.corners[0]]
            points = [self.place(lat, lon) for lat, lon in corners]
            style = "--" if part.inclusion else ":"
            axes.plot(*columns(points), style, color=SOFT, linewidth=1.2, label=label, zorder=2)
            label = None

    # --- the flight ---

    def _route(self, axes: Axes) -> None:
        named: set[int] = set()
        names = {station.sysid: station.name for station in self._package.stations}
        for commander, stretch in by_commander(self._simulation.samples):
            points = [self.place(sample.lat_deg, sample.lon_deg) for sample in stretch]
            label = f"route, {names[commander]} commands" if commander not in named else None
            named.add(commander)
            axes.plot(*columns(points), color=PAPER, linewidth=5.0, solid_capstyle="round", zorder=4)
            axes.plot(
                *columns(points),
                color=self._colour[commander],
                linewidth=2.8,
                solid_capstyle="round",
                label=label,
                zorder=5,
            )
        for x, y, dx, dy, commander in self._arrows():
            axes.annotate(
                "",
                xy=(x + dx, y + dy),
                xytext=(x, y),
                arrowprops={
                    "arrowstyle": "-|>",
                    "color": self._colour[commander],
                    "mutation_scale": 17,
                    "linewidth": 0,
                    "shrinkA": 0,
                    "shrinkB": 0,
                },
                zorder=5,
            )
        open_gaps = undeclared(self._package.gaps, self._simulation)
        self._gaps(axes, open_gaps, "no coverage", {"color": ALARM, "alpha": 0.6})
        declared = [gap for gap in self._simulation.gaps if gap not in open_gaps]
        self._gaps(axes, declared, "gap, crossed alone", {"color": INK, "linestyle": (0, (1.0, 1.2))})

    def _plan(self, axes: Axes) -> None:
        points = [self.place(sample.lat_deg, sample.lon_deg) for sample in self._simulation.samples]
        axes.plot(*columns(points), color=INK, linewidth=1.0, linestyle=(0, (5, 3)), label="planned route", zorder=4)

    def _gaps(self, axes: Axes, gaps: Sequence[Gap], words: str, style: Mapping[str, Any]) -> None:
        label: str | None = words
        for gap in gaps:
            first, last = gap.distance_along_m, gap.distance_along_m + gap.length_m
            points = [
                self.place(s.lat_deg, s.lon_deg)
                for s in self._simulation.samples
                if first <= s.distance_along_m <= last
            ]
            axes.plot(*columns(points), linewidth=5.0, label=label, zorder=6, **style)
            label = None

    def _arrows(self) -> Iterator[tuple[float, float, float, float, int]]:
        """One arrow in the last third of each item's way, where it is long enough."""
        by_item: dict[int, list[Sample]] = {}
        for sample in self._simulation.samples:
            by_item.setdefault(sample.seq, []).append(sample)
        for way in by_item.values():
            if way[-1].distance_along_m - way[0].distance_along_m < 0.03 * self._simulation.length_m:
                continue
            place = way[0].distance_along_m + 0.62 * (way[-1].distance_along_m - way[0].distance_along_m)
            here = max(1, next(n for n, sample in enumerate(way) if sample.distance_along_m >= place))
            (x0, y0), (x1, y1) = (self.place(s.lat_deg, s.lon_deg) for s in (way[here - 1], way[here]))
            yield x0, y0, x1 - x0, y1 - y0, way[here].commander

    def _rally(self, axes: Axes) -> None:
        sites = [(f"R{number}", point) for number, point in enumerate(self._rally_points(), 1)]
        if not self._home_is_marked():
            sites.append(("home", self._home))
        label: str | None = "return site"
        for name, (x, y) in sites:
            axes.plot(x, y, "*", color=RALLY, markeredgecolor=INK, markersize=16, label=label, zorder=7, ls="none")
            note(axes, name, (x, y), (9, 7))
            label = None

    def _home_is_marked(self) -> bool:
        """An item is flown to home: its words name it."""
        return any(math.dist(end, self._home) < _SAME_M for end in self._ends().values())

    def _handovers(self, axes: Axes) -> None:
        names = {station.sysid: station.name for station in self._package.stations}
        noted = list[tuple[tuple[float, float], bool]]()
        label: str | None = "handover starts (time inside both zones)"
        for numbers, handover in self._handovers_by_place():
            x, y = self.place(handover.lat_deg, handover.lon_deg)
            colour = self._colour[handover.to_station]
            axes.plot(x, y, "D", color=colour, markeredgecolor=PAPER, markersize=9.5, label=label, zorder=8, ls="none")
            pair = f"{names[handover.from_station]} \N{RIGHTWARDS ARROW} {names[handover.to_station]}"
            words = f"{_listed(numbers)}: {pair}\n{handover.overlap_s:.1f} s"
            label = None
            # below, unless another mark is nearer there than above
            step = 0.04 * (self._bounds[2] - self._bounds[0])
            above, below = (
                min(math.dist((x, y + side), mark) for mark in self._marks if mark != (x, y)) for side in (step, -step)
            )
            is_below = below >= min(above, step)
            if any(math.dist((x, y), place) < step and is_below is side for place, side in noted):
                is_below = not is_below
            noted.append(((x, y), is_below))
            if is_below:
                note(axes, words, (x, y), (0, -12), va="top", ha="center")
            else:
                note(axes, words, (x, y), (0, 12), va="bottom", ha="center")

    def _handovers_by_place(self) -> Iterator[tuple[list[int], Handover]]:
        """The handovers of each place, one of them for all: that with the least time inside both zones."""
        shared: dict[tuple[int, int, int], list[int]] = {}
        for number, each in enumerate(self._simulation.handovers):
            x, y = self.place(each.lat_deg, each.lon_deg)
            shared.setdefault((round(x / _SAME_M), round(y / _SAME_M), each.to_station), []).append(number)
        for numbers in shared.values():
            least = min((self._simulation.handovers[number] for number in numbers), key=lambda each: each.overlap_s)
            yield [number + 1 for number in numbers], least

    def _items(self, axes: Axes) -> None:
        package = self._package
        ends = self._ends()
        shared: dict[tuple[int, int], list[int]] = {}
        for item in package.route.items:
            if COMMANDS[item.command].flown and item.seq in ends:
                x, y = ends[item.seq]
                shared.setdefault((round(x / 3.0), round(y / 3.0)), []).append(item.seq)
        for seqs in shared.values():
            commands = {package.route.items[seq - 1].command for seq in seqs}
            x, y = ends[seqs[0]]
            words = [
                word
                for word, those in (("take-off", TAKEOFFS), ("landing", LANDINGS), ("return", {RETURN_TO_LAUNCH}))
                if those & commands
            ]
            ground = bool(words)
            if math.dist((x, y), self._home) < _SAME_M:
                words.append("home")
            face = "#dddddd" if ground else PAPER
            if package.delivery_waypoint in seqs:
                face = DELIVERY
                hold = package.route.items[package.delivery_waypoint - 1]
                words.append("delivery" if ground else f"delivery, {hold.alt_m:g} m")
            axes.annotate(
                ", ".join(str(seq) for seq in seqs),
                (x, y),
                ha="center",
                va="center",
                fontsize=9,
                fontweight="bold",
                color=INK,
                zorder=10,
                bbox={
                    "boxstyle": "round,pad=0.28",
                    "facecolor": face,
                    "edgecolor": next((self._marked[seq] for seq in seqs if seq in self._marked), INK),
                    "linewidth": 1.1 if self._marked.keys().isdisjoint(seqs) else 2.6,
                },
            )
            if words and ground:
                note(axes, ", ".join(words), (x, y), (0, -13), va="top", ha="center")
            elif words:
                note(axes, ", ".join(words), (x, y), (14, 0), va="center")

    def _ends(self) -> dict[int, tuple[float, float]]:
        """Where each item ends. Wings fly past it: there it is the place of the item."""
        ends = {sample.seq: self.place(sample.lat_deg, sample.lon_deg) for sample in self._simulation.samples}
        if self._package.profile.flies_past:
            ends |= {
                item.seq: self.place(item.lat_deg, item.lon_deg)
                for item in self._package.route.items
                if item.has_place and item.command not in TAKEOFFS
            }
        return ends

    # --- the sheet ---

    def _frame(self, axes: Axes) -> None:
        west, south, east, north = self._bounds
        axes.set_xlim(west, east)
        axes.set_ylim(south, north)
        middle_lat, _ = self._plane.to_earth(0.0, (south + north) / 2.0)
        _, middle_lon = self._plane.to_earth((west + east) / 2.0, 0.0)
        lats = ticks(*(self._plane.to_earth(0.0, y)[0] for y in axes.get_ylim()))
        lons = ticks(*(self._plane.to_earth(x, 0.0)[1] for x in axes.get_xlim()))
        axes.set_yticks([self.place(lat, middle_lon)[1] for lat in lats], degrees(lats, "NS"))
        axes.set_xticks([self.place(middle_lat, lon)[0] for lon in lons], degrees(lons, "EW"))
        axes.tick_params(labelsize=8, colors="#555555")
        axes.grid(color=GRID, linewidth=0.6, zorder=0)
        axes.set_axisbelow(True)
        self._scale_bar(axes)
        axes.annotate(
            "N",
            xy=(0.975, 1.0),
            xytext=(0, -50),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="center",
            va="center",
            fontweight="bold",
            arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "shrinkB": 12},
            zorder=11,
        )

    def _scale_bar(self, axes: Axes) -> None:
        west, south, east, north = self._bounds
        room = 0.04 * max(east - west, north - south)
        x, y, length = west + room, south + 0.7 * room, round_down((east - west) / 5.0)
        axes.plot([x, x + length], [y, y], color=INK, linewidth=3.0, solid_capstyle="butt", zorder=11)
        for end in (x, x + length):
            axes.plot([end], [y], "|", color=INK, markersize=11, markeredgewidth=1.6, zorder=11)
        words = f"{length / 1000.0:g} km" if length >= 1000.0 else f"{length:g} m"
        axes.annotate(
            words, (x + length / 2.0, y), (0, 5), textcoords="offset points", ha="center", fontsize=9, zorder=11
        )

    def _facts(self) -> str:
        package, simulation = self._package, self._simulation
        minutes = f"{int(simulation.duration_s) // 60} min {int(simulation.duration_s) % 60:02d} s"
        return (
            f"{simulation.length_m / 1000.0:.2f} km, at least {minutes} at {package.cruise_speed_mps:g} m/s, "
            f"{len(simulation.handovers)} handovers"
        )

    def _heading(self, axes: Axes, facts: str) -> None:
        axes.set_title(f"Mission {self._package.name}", loc="left", fontsize=15, fontweight="bold", color=INK)
        axes.set_title(facts, loc="right", fontsize=10, color="#555555")
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            borderaxespad=2.8,
            ncols=_LEGEND_COLUMNS,
            fontsize=9,
            frameon=False,
            handlelength=2.4,
        )

    def _all_bounds(self, also: Points) -> tuple[float, float, float, float]:
        """West, south, east and north end of the map in metres, with room around for the scale bar below."""
        shapes = [shapely.MultiPoint([*self._marks, *also])]
        shapes += [part for zone in self._package.zones for part in self._parts(zone.outline())]
        for part in self._package.route.fence:
            if not isinstance(part, FenceCircle):
                shapes.append(shapely.MultiPoint([self.place(*corner) for corner in part.corners]))
        west, south, east, north = shapely.union_all(shapes).bounds
        room = 0.04 * max(east - west, north - south)
        return west - room, south - 2.2 * room, east + room, north + room

    def _parts(self, area: Polygon | MultiPolygon) -> list[Polygon]:
        return parts(self._plane, area)

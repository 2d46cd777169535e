# SPDX-License-Identifier: GPL-3.0-or-later

"""The pictures of the page that one can look into: the map, and what held when. Drawn by plotly, which is in the page.

plotly is imported when a page is made, not before: a vehicle has no use for it. Figures are made in the light colours;
the page swaps them where its reader's screen is dark (`palette.py`). The axis of time counts seconds of T+; the page
writes UTC below it (`script.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import combinations, pairwise
from typing import Any

import shapely

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.mission.colours import DELIVERY, RALLY, rgb
from mavproxy_handover.mission.drawing import round_down
from mavproxy_handover.mission.flat import parts, quiet_place
from mavproxy_handover.mission.geodesy import LocalPlane, beside_deg, degree_lengths_m, distance_m
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FenceCircle
from mavproxy_handover.mission.zones import Circle, overlap
from sitl.report.evidence import NOBODY
from sitl.report.exchange import Exchange
from sitl.report.flight import Story
from sitl.report.journal_reader import Entry
from sitl.report.outcome import emergencies, level_of
from sitl.report.palette import (
    ALARM,
    GRID,
    GROUND,
    GUARDS,
    INK,
    LEASES,
    LINKS,
    NOBODY_COLOUR,
    PAPER,
    PHASES,
    PLAIN,
    SILENT,
    SOFT,
    colours,
)
from sitl.report.times import Times, duration
from sitl.report.track import airborne, nearest, pieces
from sitl.report.watch import VEHICLE, Sample

__all__ = ["map_figure", "timeline_figure"]

#: more points than these make a page slow and no line finer
_MOST_POINTS = 4000
_GOOD, _WARN = "#009E73", "#E69F00"
#: entries that are decisions, and how grave each is
_DECISIONS = {
    "decision": INK, "emergency": ALARM, "failed_closed": ALARM, "emergency_over": _GOOD, "transfer_committed": _GOOD,
    "warning": _WARN, "gap": _WARN, "restarted": _WARN, "start_refused": _WARN, "position_stale": _WARN,
    "off_route": _WARN, "transfer_aborted": _WARN, "refused": SOFT, "fly": INK, "landed": INK, "airborne": INK,
}  # fmt: skip
#: an item nearer than this to home (m) is not drawn over it
_AT_HOME_M = 3.0
_SILENT_WORD = "companion silent"


def _few(samples: Sequence[Sample]) -> Sequence[Sample]:
    step = max(1, len(samples) // _MOST_POINTS)
    return samples if step == 1 else [*samples[::step], samples[-1]]


def _font() -> dict[str, Any]:
    return {"family": "system-ui, sans-serif", "size": 12, "color": INK}


def _hover_label() -> dict[str, Any]:
    return {"bgcolor": PAPER, "bordercolor": SOFT, "font": {"color": INK, "size": 12}, "align": "left"}


# ---- the map ------------------------------------------------------------------------------------------------------


def map_figure(story: Story, transfers: Sequence[Exchange], times: Times) -> Any:
    """Zones, route and the flown track in the commander's colour.

    Below the track lie a hold in orange and an emergency in red. None if no place is known.
    """
    samples = airborne(story.evidence)
    mission = story.evidence.mission
    if not samples and mission is None and not story.items:
        return None
    return _Map(story, samples, times).figure(transfers)


class _Map:
    def __init__(self, story: Story, samples: Sequence[Sample], times: Times) -> None:
        import plotly.graph_objects as go

        self._go, self._story, self._times = go, story, times
        self._evidence = story.evidence
        self._samples = samples
        self._colours = colours(self._evidence.stations)
        mission = self._evidence.mission
        if mission is not None:
            middle = mission.route.home.lat_deg, mission.route.home.lon_deg
        elif samples:
            middle = samples[0].lat_deg, samples[0].lon_deg
        else:
            middle = next(iter(story.items.values()))
        self._plane = LocalPlane(*middle)
        self._figure = go.Figure()
        self._lats: list[float] = []
        self._lons: list[float] = []

    def figure(self, transfers: Sequence[Exchange]) -> Any:
        """All of it."""
        mission = self._evidence.mission
        if mission is not None:
            self._zones(mission)
            self._fence(mission)
        items = self._items(mission)
        self._planned(items)
        self._track()
        self._points(mission, items)
        self._handovers(transfers)
        self._refusals()
        self._ends()
        self._sheet()
        return self._figure

    def _line(self, lats: Sequence[float], lons: Sequence[float], **style: Any) -> None:
        lons = [beside_deg(lon, self._plane.lon_deg) for lon in lons]
        if style.pop("counts", True):
            self._lats += lats
            self._lons += lons
        style.setdefault("hoverinfo", "skip")
        self._figure.add_trace(self._go.Scatter(x=lons, y=lats, **style))

    def _rings(self, area: Any) -> list[tuple[list[float], list[float]]]:
        found = []
        for part in parts(self._plane, area):
            corners = [self._plane.to_earth(x, y) for x, y in part.exterior.coords]
            found.append(([lat for lat, _ in corners], [lon for _, lon in corners]))
        return found

    def _zones(self, mission: MissionPackage) -> None:
        for zone in mission.zones:
            colour = self._colours.get(zone.station_name, NOBODY_COLOUR)
            for number, (lats, lons) in enumerate(self._rings(zone.outline())):
                self._line(
                    lats, lons, mode="lines", fill="toself", fillcolor=_clear(colour, 0.12), showlegend=False,
                    line={"color": colour, "width": 2}, name=f"zone of {zone.station_name}", legendgroup=f"z{number}",
                )  # fmt: skip
            own = parts(self._plane, zone.outline())
            others = [
                part for other in mission.zones if other is not zone for part in parts(self._plane, other.outline())
            ]
            area = shapely.union_all(own)
            busy = shapely.MultiPoint(self._busy(mission)).buffer(math.sqrt(area.area) / 9.0, quad_segs=2)
            lat, lon = self._plane.to_earth(*quiet_place(area, (busy, shapely.union_all(others))))
            self._figure.add_annotation(
                x=beside_deg(lon, self._plane.lon_deg), y=lat, text=f"<b>{escape(zone.station_name)}</b>",
                showarrow=False, font={"color": colour, "size": 15},
            )  # fmt: skip
        label = True
        for first, second in combinations(mission.zones, 2):
            for lats, lons in self._rings(overlap(first, second)):
                self._line(
                    lats, lons, mode="lines", fill="toself", fillcolor="rgba(0,0,0,0)", line={"width": 0},
                    fillpattern={"shape": "/", "fgcolor": SOFT, "size": 9, "solidity": 0.12},
                    name="handover region", showlegend=label,
                )  # fmt: skip
                label = False

    def _busy(self, mission: MissionPackage) -> list[tuple[float, float]]:
        """Where something is drawn, on the plane."""
        route = mission.route
        places = [(item.lat_deg, item.lon_deg) for item in route.items if item.has_place]
        places += [(rally.lat_deg, rally.lon_deg) for rally in route.rally]
        places += [(each.lat_deg, each.lon_deg) for each in self._samples[:: max(1, len(self._samples) // 300)]]
        return [self._plane.to_plane(*place) for place in places]

    def _fence(self, mission: MissionPackage) -> None:
        for number, part in enumerate(mission.route.fence):
            if isinstance(part, FenceCircle):
                outline = Circle(part.lat_deg, part.lon_deg, part.radius_m).outline()
                corners = [(lat, lon) for lon, lat in outline.exterior.coords]
            else:
                corners = [*part.corners, part.corners[0]]
            self._line(
                [lat for lat, _ in corners], [lon for _, lon in corners], mode="lines", name="geofence",
                line={"color": SOFT, "width": 1.2, "dash": "dash" if part.inclusion else "dot"}, showlegend=not number,
            )  # fmt: skip

    def _items(self, mission: MissionPackage | None) -> dict[int, tuple[float, float]]:
        """The items of the route that have a place, home as the first of a mission's."""
        if mission is None:
            return dict(sorted(self._story.items.items()))
        home = mission.route.home.lat_deg, mission.route.home.lon_deg
        return {0: home, **{item.seq: (item.lat_deg, item.lon_deg) for item in mission.route.items if item.has_place}}

    def _planned(self, items: Mapping[int, tuple[float, float]]) -> None:
        if items:
            lats, lons = [lat for lat, _ in items.values()], [lon for _, lon in items.values()]
            line = {"color": INK, "width": 1.1, "dash": "dash"}
            self._line(lats, lons, mode="lines", name="planned route", line=line)

    def _points(self, mission: MissionPackage | None, items: Mapping[int, tuple[float, float]]) -> None:
        """Waypoints by their numbers, home, rally points."""
        delivery = mission.delivery_waypoint if mission is not None else None
        shared: dict[tuple[float, float], list[int]] = {}
        for seq, (lat, lon) in items.items():
            if seq and not (0 in items and distance_m(lat, lon, *items[0]) < _AT_HOME_M):
                shared.setdefault((round(lat, 5), round(lon, 5)), []).append(seq)
        faces = [DELIVERY if delivery in seqs else PAPER for seqs in shared.values()]
        if shared:
            self._line(
                [lat for lat, _ in shared], [lon for _, lon in shared], mode="markers+text", showlegend=False,
                text=[", ".join(map(str, seqs)) for seqs in shared.values()], textposition="middle center",
                textfont={"size": 10, "color": [INK if face == PAPER else "#1b1b1c" for face in faces]},
                marker={"size": 18, "color": faces, "line": {"color": INK, "width": 1}},
            )  # fmt: skip
        if mission is None:
            return
        marker: dict[str, Any] = {"symbol": "hexagon", "size": 15, "color": INK}
        self._line([items[0][0]], [items[0][1]], mode="markers", marker=marker, name="home", hoverinfo="name")
        if mission.route.rally:
            self._line(
                [each.lat_deg for each in mission.route.rally], [each.lon_deg for each in mission.route.rally],
                mode="markers+text", text=[f"R{number}" for number, _ in enumerate(mission.route.rally, 1)],
                textposition="top right", name="rally point",
                marker={"symbol": "star", "size": 14, "color": RALLY, "line": {"color": INK, "width": 1}},
            )  # fmt: skip

    def _track(self) -> None:
        shown: set[str] = set()
        for stretch in emergencies(self._evidence):
            piece = [each for each in self._samples if stretch.begin_t <= each.t <= stretch.end_t]
            if len(piece) < 2:
                continue
            name, colour = stretch.word, ALARM if stretch.level is Level.EMERGENCY else _WARN
            self._line(
                [each.lat_deg for each in piece], [each.lon_deg for each in piece], mode="lines", name=name,
                line={"color": colour, "width": 13}, opacity=0.45, showlegend=name not in shown, legendgroup=name,
            )  # fmt: skip
            shown.add(name)
        if len(self._samples) == 1:
            (only,) = self._samples
            self._line(
                [only.lat_deg], [only.lon_deg], mode="markers", name="seen here", marker={"size": 12, "color": INK}
            )
        named: set[str] = set()
        modes = _Held(self._evidence.of(VEHICLE, "mode"), lambda entry: str(entry.get("mode")))
        for name, piece in pieces(self._evidence, _few(self._samples)):
            words = "no station commands" if name == NOBODY else f"{name} commands"
            self._line(
                [each.lat_deg for each in piece], [each.lon_deg for each in piece], mode="lines", name=words,
                line={"color": self._colours.get(name, NOBODY_COLOUR), "width": 3.5}, legendgroup=words,
                showlegend=name not in named, hoverinfo="text",
                hovertext=[self._about(each, words, modes.at(each.t)) for each in piece],
            )  # fmt: skip
            named.add(name)

    def _about(self, sample: Sample, words: str, mode: str) -> str:
        utc = self._times.utc(sample.t)
        return (
            f"<b>{self._times.plus(sample.t)}</b>{f' · {utc} UTC' if utc else ''}<br>{escape(words)}"
            f"<br>{sample.alt_m:.0f} m, {sample.speed_mps:.1f} m/s{f', {escape(mode)}' if mode else ''}"
            f"<br>{sample.lat_deg:.6f} {sample.lon_deg:.6f}"
        )

    def _handovers(self, transfers: Sequence[Exchange]) -> None:
        for committed, words, symbol in ((True, "handover", "diamond"), (False, "attempt that came to nothing", "x")):
            there = [
                (transfer, sample)
                for transfer in transfers
                if transfer.committed is committed
                and (sample := nearest(self._evidence.samples, transfer.ended_t or transfer.begun_t)) is not None
            ]
            if not there:
                continue
            taker = [self._colours.get(transfer.partner, NOBODY_COLOUR) for transfer, _ in there]
            self._line(
                [sample.lat_deg for _, sample in there], [sample.lon_deg for _, sample in there], name=words,
                mode="markers+text", text=[f"<b>{transfer.handover_id}</b>" for transfer, _ in there],
                textposition="top center", hoverinfo="text",
                hovertext=[self._transfer(transfer) for transfer, _ in there],
                marker={"symbol": symbol, "size": 12, "color": taker, "line": {"color": INK, "width": 1.2}},
            )  # fmt: skip

    def _transfer(self, transfer: Exchange) -> str:
        took = "" if transfer.duration_s is None else f" in {duration(transfer.duration_s)}"
        outcome = f"committed{took}" if transfer.committed else f"came to nothing: {transfer.reason.replace('_', ' ')}"
        words = f"handover {transfer.handover_id}: {transfer.commander} → {transfer.partner}"
        return f"<b>{escape(words)}</b><br>{escape(outcome)}<br>{self._times.plus(transfer.begun_t)}"

    def _refusals(self) -> None:
        there = [
            (entry, sample)
            for entry in self._evidence.of(event="refused")
            if (sample := nearest(self._evidence.samples, entry.t)) is not None
        ]
        if there:
            self._line(
                [sample.lat_deg for _, sample in there], [sample.lon_deg for _, sample in there], name="refused",
                mode="markers", hoverinfo="text",
                hovertext=[f"{self._times.plus(e.t)}<br>{escape(e.text or str(e.get('what')))}" for e, _ in there],
                marker={"symbol": "circle-x-open", "size": 10, "color": INK},
            )  # fmt: skip

    def _ends(self) -> None:
        for entry in self._evidence.of(VEHICLE, "landed")[-1:]:
            if None not in (entry.get("lat_deg"), entry.get("lon_deg")):
                self._line(
                    [entry.get("lat_deg")], [entry.get("lon_deg")], mode="markers", name="landed", hoverinfo="text",
                    hovertext=[f"landed, {self._times.plus(entry.t)}"],
                    marker={"symbol": "circle-open", "size": 22, "color": INK, "line": {"width": 2}},
                )  # fmt: skip

    def _sheet(self) -> None:
        """Limits, a scale, north; a metre is as long upwards as sideways."""
        per_lat, per_lon = degree_lengths_m(self._plane.lat_deg)
        west, east = min(self._lons), max(self._lons)
        south, north = min(self._lats), max(self._lats)
        wide = max((east - west) * per_lon, 40.0)
        room_m = max(0.05 * (north - south) * per_lat, 0.025 * wide, 10.0)
        room_lon, room_lat = max(0.05 * wide, 10.0) / per_lon, room_m / per_lat
        digits = max(2, math.ceil(-math.log10(max(wide, (north - south) * per_lat) / per_lon / 5.0)))
        length = round_down(wide / 4.0)
        axis = {
            "gridcolor": GRID,
            "zeroline": False,
            "ticksuffix": "°",
            "tickformat": f".{digits}f",
            "nticks": 5,
            "automargin": True,
        }
        self._figure.update_layout(
            template="none",
            font=_font(),
            hoverlabel=_hover_label(),
            paper_bgcolor=PAPER,
            plot_bgcolor=GROUND,
            hovermode="closest",
            dragmode="pan",
            margin={"l": 62, "r": 10, "t": 10, "b": 70},
            legend={"orientation": "h", "y": 0, "yref": "container", "yanchor": "bottom", "x": 0},
            meta={"tall": max(0.2, min(1.3, (north - south + 3.4 * room_lat) * per_lat / (1.1 * wide)))},
            xaxis={**axis, "range": [west - room_lon, east + room_lon], "constrain": "domain"},
            yaxis={
                **axis,
                "range": [south - 2.4 * room_lat, north + room_lat],
                "scaleanchor": "x",
                "scaleratio": per_lat / per_lon,
                "constrain": "domain",
            },
        )
        y, x = south - 1.5 * room_lat, west
        words = f"{length / 1000:g} km" if length >= 1000.0 else f"{length:g} m"
        end = x + length / per_lon
        self._figure.add_trace(
            self._go.Scatter(
                x=[x, (x + end) / 2, end],
                y=[y, y, y],
                mode="lines+markers+text",
                text=["", words, ""],
                textposition="top center",
                line={"color": INK, "width": 3},
                hoverinfo="skip",
                showlegend=False,
                marker={"symbol": "line-ns-open", "size": [10, 0, 10], "color": INK, "line": {"width": 2}},
            )
        )
        self._figure.add_annotation(
            xref="paper", yref="paper", x=0.985, y=0.985, ax=0, ay=34, text="<b>N</b>", arrowhead=2, arrowwidth=1.6,
            arrowcolor=INK, showarrow=True,
        )  # fmt: skip


def _clear(colour: str, part: float) -> str:
    """A colour with this opacity; it is the same on a dark screen."""
    red, green, blue = rgb(colour)
    return f"rgba({red},{green},{blue},{part:g})"


class _Held:
    """The value of a series of entries at a moment."""

    def __init__(self, entries: Sequence[Entry], word: Callable[[Entry], str]) -> None:
        self._entries, self._word, self._place = entries, word, 0

    def at(self, t: float) -> str:
        """The word at `t`."""
        found = ""
        for entry in self._entries:
            if entry.t > t:
                break
            found = self._word(entry)
        return found


# ---- what held when -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Bar:
    start: float
    end: float
    text: str
    colour: str
    hover: str


def timeline_figure(story: Story, transfers: Sequence[Exchange], times: Times) -> Any:
    """Altitude, battery, and below them in lanes: links, commander, phase, lease, guard, flight mode, decisions."""
    return _Timeline(story, times).figure(transfers)


class _Timeline:
    def __init__(self, story: Story, times: Times) -> None:
        import plotly.graph_objects as go

        self._go, self._story, self._times = go, story, times
        self._evidence = story.evidence
        self._first, self._last = self._span()
        self._figure = go.Figure()
        self._colours = colours(self._evidence.stations)

    def figure(self, transfers: Sequence[Exchange]) -> Any:
        """All of it."""
        lanes = self._lanes()
        battery = self._battery_points()
        plots = 110.0 + (90.0 if battery else 0.0)
        height = 78.0 + plots + 25.0 * (len(lanes) + 1)
        inner = height - 78.0
        bottom = 25.0 * (len(lanes) + 1) / inner
        top = bottom + (1.0 - bottom) * (90.0 / plots if battery else 0.0)
        names = [*(name for name, _ in lanes), "decisions"]
        for name, bars in lanes:
            self._bars(name, bars)
        self._decisions()
        self._altitude()
        axes: dict[str, Any] = {
            "yaxis": {
                "domain": [0, max(bottom - 0.02, 0.1)],
                "categoryorder": "array",
                "categoryarray": names[::-1],
                "showgrid": False,
                "fixedrange": True,
                "automargin": False,
                "type": "category",
                "range": [-0.6, len(names) - 0.4],
            },
            "yaxis2": {
                "domain": [top + 0.01, 1],
                "title": {"text": "m", "standoff": 4},
                "automargin": False,
                "gridcolor": GRID,
                "zeroline": False,
                "fixedrange": True,
                "rangemode": "tozero",
                "nticks": 5,
            },
        }
        if battery:
            unit, points = battery
            axes["yaxis3"] = {
                "domain": [bottom + 0.02, top - 0.02],
                "title": {"text": unit, "standoff": 4},
                "automargin": False,
                "gridcolor": GRID,
                "zeroline": False,
                "fixedrange": True,
                "nticks": 4,
            }
            self._figure.add_trace(
                self._go.Scatter(
                    x=[x for x, _, _ in points],
                    y=[y for _, y, _ in points],
                    yaxis="y3",
                    mode="lines",
                    line={"color": _WARN, "width": 2},
                    name="battery",
                    hoverinfo="text",
                    hovertext=[words for _, _, words in points],
                    showlegend=False,
                )
            )
        self._marks(transfers)
        self._figure.update_layout(
            template="none",
            font=_font(),
            hoverlabel=_hover_label(),
            paper_bgcolor=PAPER,
            plot_bgcolor=PAPER,
            height=height,
            barmode="overlay",
            bargap=0.12,
            margin={"l": 92, "r": 10, "t": 30, "b": 48},
            hovermode="closest",
            dragmode="zoom",
            showlegend=False,
            uniformtext={"minsize": 9, "mode": "hide"},
            xaxis={
                "range": [self._first, self._last],
                "gridcolor": GRID,
                "zeroline": False,
                "anchor": "y",
                "automargin": False,
                "showspikes": True,
                "spikemode": "across",
                "spikecolor": SOFT,
                "spikethickness": 1,
                "spikedash": "dot",
            },
            meta={"times": True, "utc0": self._utc_zero(), "narrow_left": 70},
            **axes,
        )
        return self._figure

    def _span(self) -> tuple[float, float]:
        """From a little before arming to a little after the landing, or all where that is not known."""
        evidence, plus = self._evidence, self._times.plus_s
        armed = evidence.of(VEHICLE, "armed") or evidence.of(VEHICLE, "airborne")
        ended = evidence.of(VEHICLE, "disarmed")
        first = plus(armed[0].t) - 10.0 if armed else plus(evidence.entries[0].t)
        last = plus(evidence.entries[-1].t)
        if ended and armed and ended[-1].t > armed[0].t and not evidence.armed_at_end():
            last = min(last, plus(ended[-1].t) + 10.0)
        return (first, last) if last > first else (first, first + 1.0)

    def _utc_zero(self) -> float | None:
        """UTC (s) at T+0 where both run equally fast."""
        if self._evidence.notes.speedup != 1.0 or not self._evidence.entries:
            return None
        first = self._evidence.entries[0].t
        at = self._times.at(first)
        return None if at is None else at.timestamp() - self._times.plus_s(first)

    def _hover(self, t: float, words: str) -> str:
        utc = self._times.utc(t)
        return f"<b>{self._times.plus(t)}</b>{f' · {utc} UTC' if utc else ''}<br>{words}"

    def _altitude(self) -> None:
        samples = _few(self._evidence.samples)
        if not any(each.alt_m for each in samples):  # its height is not known
            return
        self._figure.add_trace(
            self._go.Scatter(
                x=[self._times.plus_s(each.t) for each in samples],
                y=[each.alt_m for each in samples],
                yaxis="y2",
                mode="lines",
                line={"color": INK, "width": 1.8},
                name="altitude",
                hoverinfo="text",
                hovertext=[self._hover(e.t, f"{e.alt_m:.1f} m above home, {e.speed_mps:.1f} m/s") for e in samples],
            )
        )

    def _battery_points(self) -> tuple[str, list[tuple[float, float, str]]] | None:
        entries = self._evidence.of(VEHICLE, "battery")
        key, unit = ("percent", "%") if any(entry.get("percent") is not None for entry in entries) else ("volts", "V")
        points = []
        for entry in entries[:: max(1, len(entries) // _MOST_POINTS)]:
            value, volts = entry.get(key), entry.get("volts")
            if value is not None:
                words = f"battery {value:g} {unit}" + (f", {volts:.2f} V" if volts and key == "percent" else "")
                points.append((self._times.plus_s(entry.t), value, self._hover(entry.t, words)))
        return (unit, points) if len(points) > 1 else None

    def _lanes(self) -> list[tuple[str, list[_Bar]]]:
        evidence = self._evidence
        views = evidence.of(event="view")
        lanes = [(f"link {name}", self._links(name)) for name in evidence.stations]
        commander = self._held(views, lambda entry: evidence.station_name(entry.get("commander")), self._colours)
        lanes += [
            ("commander", commander),
            ("phase", self._held(views, lambda entry: str(entry.get("phase") or ""), PHASES)),
            ("lease", self._held(views, lambda entry: str(entry.get("lease") or ""), LEASES)),
            ("guard", self._held(evidence.of(event="guard"), _guard_word, GUARDS)),
            ("mode", self._held(evidence.of(VEHICLE, "mode"), lambda entry: str(entry.get("mode")), {})),
        ]
        return [(name, bars) for name, bars in lanes if bars]

    def _held(self, entries: Sequence[Entry], word: Callable[[Entry], str], palette: dict[str, str]) -> list[_Bar]:
        changes: list[tuple[float, str]] = []
        for entry in entries:
            text = word(entry)
            if text and (not changes or changes[-1][1] != text):
                changes.append((entry.t, text))
        if not changes:
            return []
        end_t = self._evidence.entries[-1].t
        silent_t = min(self._evidence.companion_ended_t(), end_t)
        if entries[0].who != VEHICLE and silent_t < end_t:
            changes = [*(change for change in changes if change[0] < silent_t), (silent_t, _SILENT_WORD)]
        return self._spread(changes, end_t, palette)

    def _spread(self, changes: Sequence[tuple[float, str]], end_t: float, palette: dict[str, str]) -> list[_Bar]:
        bars = []
        for number, ((begin, text), (end, _)) in enumerate(pairwise([*changes, (end_t, "")])):
            fallback = {NOBODY: NOBODY_COLOUR, _SILENT_WORD: SILENT}.get(text, PLAIN[number % 2])
            start, stop = max(self._times.plus_s(begin), self._first), min(self._times.plus_s(end), self._last)
            if stop > start:
                words = text.replace("_", " ")
                took = duration(self._times.plus_s(end) - self._times.plus_s(begin))
                hover = self._hover(begin, f"{escape(words)}, for {took}")
                bars.append(_Bar(start, stop, words, palette.get(text, fallback), hover))
        return bars

    def _links(self, name: str) -> list[_Bar]:
        """Whether the vehicle hears a station, and how well, by the companion.

        And where the station heard nothing of the vehicle, by its own log.
        """
        changes: list[tuple[float, str]] = []
        vehicle = self._story.vehicle
        for entry in self._evidence.entries:
            if entry.who != vehicle:
                continue
            word = _link_word(entry, name)
            if word:
                changes.append((entry.t, word))
        if not changes and name in self._story.silences:
            changes.append((self._evidence.entries[0].t, "heard"))
        for begin, end in self._story.silences.get(name, ()):
            held = next((word for t, word in reversed(changes) if t <= begin), "heard")
            changes = [change for change in changes if not begin <= change[0] <= end]
            changes += [(begin, "silent"), (end, held)]
        merged: list[tuple[float, str]] = []
        for change in sorted(changes):
            if not merged or merged[-1][1] != change[1]:
                merged.append(change)
        end_t = min(self._evidence.companion_ended_t(), self._evidence.entries[-1].t)
        return self._spread(merged, max(end_t, merged[-1][0]), LINKS) if merged else []

    def _bars(self, name: str, bars: Sequence[_Bar]) -> None:
        self._figure.add_trace(
            self._go.Bar(
                orientation="h",
                y=[name] * len(bars),
                base=[bar.start for bar in bars],
                x=[bar.end - bar.start for bar in bars],
                text=[escape(bar.text) for bar in bars],
                textposition="inside",
                insidetextanchor="middle",
                textangle=0,
                constraintext="inside",
                textfont={"color": [_on(bar.colour) for bar in bars], "size": 11},
                marker={"color": [bar.colour for bar in bars], "line": {"color": PAPER, "width": 1}},
                hoverinfo="text",
                hovertext=[bar.hover for bar in bars],
            )
        )

    def _decisions(self) -> None:
        stations = set(self._evidence.stations)
        told = [entry for entry in self._evidence.entries if entry.event in _DECISIONS and entry.who not in stations]
        self._figure.add_trace(
            self._go.Scatter(
                x=[self._times.plus_s(entry.t) for entry in told],
                y=["decisions"] * len(told),
                mode="markers",
                marker={
                    "symbol": "diamond",
                    "size": 10,
                    "color": [_colour(entry) for entry in told],
                    "line": {"color": PAPER, "width": 1},
                },
                hoverinfo="text",
                hovertext=[self._hover(entry.t, escape(_said(entry))) for entry in told],
            )
        )

    def _marks(self, transfers: Sequence[Exchange]) -> None:
        for stretch in emergencies(self._evidence):
            x0, x1 = self._times.plus_s(stretch.begin_t), self._times.plus_s(stretch.end_t)
            colour = ALARM if stretch.level is Level.EMERGENCY else _WARN
            self._figure.add_shape(
                type="rect", x0=x0, x1=x1, y0=0, y1=1, yref="paper", fillcolor=colour, opacity=0.16, line_width=0,
                layer="below",
            )  # fmt: skip
        room, last = 0.035 * (self._last - self._first), float("-inf")
        for transfer in transfers:
            if transfer.ended_t is None or not self._first <= self._times.plus_s(transfer.ended_t) <= self._last:
                continue
            x = self._times.plus_s(transfer.ended_t)
            dash = "solid" if transfer.committed else "dot"
            self._figure.add_shape(
                type="line", x0=x, x1=x, y0=0, y1=1, yref="paper", line={"color": INK, "width": 1, "dash": dash}
            )
            if x - last < room:
                continue
            last = x
            self._figure.add_annotation(
                x=x, y=1, yref="paper", yanchor="bottom", text=f"{transfer.handover_id}", showarrow=False,
                font={"size": 11},
            )  # fmt: skip


def _guard_word(entry: Entry) -> str:
    return entry.text.rsplit("->", 1)[-1].strip()


def _link_word(entry: Entry, station: str) -> str:
    """The state of a link in an entry of the companion: heard, weak or silent; "": none."""
    if entry.get("station") != station:
        return ""
    if entry.event in ("station_heard", "connected"):
        return "heard"
    if entry.event == "link_quality":
        return "weak" if "weak" in entry.text else "heard"
    return "silent" if entry.event in ("station_lost", "silent", "lost") else ""


def _colour(entry: Entry) -> str:
    return _WARN if entry.event == "emergency" and level_of(entry) < Level.EMERGENCY else _DECISIONS[entry.event]


def _said(entry: Entry) -> str:
    return entry.text or " ".join(
        [entry.event.replace("_", " "), *(str(entry.get(key)) for key in ("station", "reason") if entry.get(key))]
    )


def _on(colour: str) -> str:
    """Ink that is readable on a colour, on a dark screen too.

    Ink on a pale lane changes with the lane.
    """
    bright = sum(int(colour[place : place + 2], 16) * part for place, part in ((1, 0.3), (3, 0.59), (5, 0.11)))
    return INK if bright > 150 else "#fffffe"

# SPDX-License-Identifier: GPL-3.0-or-later

"""The web page, in NiceGUI, which includes Vue, Quasar and Leaflet: nothing is fetched from a network.

Rules that live here
--------------------
* The values are computed once a second for all browsers; each browser gets what has changed for it. A browser that does
  not listen any more is forgotten after a few seconds, so nothing is kept for it.
* At most MOST_VIEWERS browsers have opened their socket.
* The page commands nothing: a browser sends only where it looks.

Import this only for `handover watch`: NiceGUI is an extra.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Protocol

from fastapi import FastAPI
from nicegui import ui

from gcs_module.watch.missions import Mission
from gcs_module.watch.page_server import PageKind, page_server
from gcs_module.watch.page_values import Shown
from gcs_module.watch.scene import Scene
from gcs_module.watch.tiles import TileSource

__all__ = ["MOST_VIEWERS", "Watched", "build"]

MOST_VIEWERS: Final = 24
_HERE: Final = Path(__file__).resolve().parent
_EVERY_S: Final = 1.0

_COLUMNS: Final = (
    ("name", "aircraft"),
    ("commander", "commander"),
    ("phase", "phase · mode"),
    ("next", "next handover"),
    ("lease", "lease"),
    ("guard", "guard"),
    ("payload", "payload"),
    ("battery", "battery"),
    ("links", "stations and links"),
    ("place", "height, zone"),
)
_NAME: Final = """<span class="hw-dot" :class="[props.row.level, {ended: props.row.ended}]"></span>
 <b>{{ props.row.name }}</b>
 <span class="hw-note" v-if="props.row.ended">ended</span><span class="hw-aged" v-else>{{ props.row.old }}</span>"""
_COMMANDER: Final = """<span class="hw-chip" v-if="props.row.commander" :style="{background: props.row.colour}">
 {{ props.row.commander }}</span> <span class="hw-note">{{ props.row.epoch }}</span>"""
_LEASE: Final = """<span :class="{'hw-wrong': !props.row.held}">{{ props.row.lease }}</span>"""
_GUARD: Final = """<span :class="{'hw-wrong': !props.row.guarded}">{{ props.row.guard }}</span>"""
_BATTERY: Final = """<span :class="{'hw-wrong': props.row.low}">{{ props.row.battery }}</span>"""
_NEXT: Final = """<span>{{ props.row.next }}</span>"""
_LINKS: Final = """<span class="hw-link" v-for="link in props.row.links" :key="link.name" :class="link.state"
 ><i :style="{color: link.colour}"></i>{{ link.name }} <span class="hw-aged">{{ link.words }}</span></span>"""
_ALARM: Final = """<q-tr><q-td><div class="hw-alarm" :class="{done: props.row.acknowledged}"
 :style="{color: props.row.colour, background: props.row.ground}"><b>{{ props.row.aircraft }}</b> {{ props.row.text }}
 <span v-if="props.row.acknowledged">(acknowledged)</span></div></q-td></q-tr>"""
_STATION: Final = """<q-tr><q-td><span class="hw-chip" :style="{background: props.row.colour}">
 {{ props.row.name }}</span>
 {{ props.row.commands.length ? "commands " + props.row.commands.join(", ") : "" }}
 <span class="hw-note">{{ props.row.state }}</span></q-td></q-tr>"""
_LINE: Final = """<q-tr><q-td><div class="hw-line" :class="props.row.level"><span class="hw-note">{{ props.row.time }}
 {{ props.row.who }}</span>{{ props.row.text }}</div></q-td></q-tr>"""


class Watched(Protocol):
    """The values for a page, updated each second."""

    scene: Scene
    missions: dict[str, Mission]
    shown: Shown

    def heading(self) -> str:
        """A line on what is followed, and its state."""


class _Page:
    """The page in one browser."""

    def __init__(self, watched: Watched, tiles: Mapping[str, Any] | None) -> None:
        self._watched = watched
        self._missions: set[str] = set()
        #: places of each track that were sent, by aircraft; and how the colours were then
        self._given: dict[str, int] = {}
        with ui.element("div").classes("hw-top"):
            ui.html("<b>handover watch</b>", sanitize=False)
            self._heading = ui.label()
        with ui.element("div").classes("hw-side hw-alarms"):
            self._alarms = self._list("alarms", _ALARM)
        options = {"preferCanvas": True, "attributionControl": tiles is not None, "maxZoom": 20, "zoomSnap": 0.25}
        self._map = ui.leaflet(center=(0.0, 0.0), zoom=2, options=options).classes("hw-map")
        self._map.clear_layers()  # its own tiles come from a network
        with ui.element("div").classes("hw-table"):
            self._table = self._craft()
        with ui.element("div").classes("hw-side"):
            self._stations = self._list("stations", _STATION)
            self._feed = self._list("events", _LINE, key="number")
        ui.run_javascript(f"handoverWatch.attach({self._map.id}, {json.dumps(tiles)})")
        self.update()
        ui.timer(_EVERY_S, self.update)

    @staticmethod
    def _craft() -> ui.table:
        columns = [
            {"name": name, "field": name, "label": label, "align": "left", "sortable": name != "links"}
            for name, label in _COLUMNS
        ]
        table = ui.table(columns=columns, rows=[], row_key="name")
        table.props('dense flat hide-pagination :rows-per-page-options="[0]"')
        slots = {
            "name": _NAME,
            "commander": _COMMANDER,
            "lease": _LEASE,
            "guard": _GUARD,
            "battery": _BATTERY,
            "next": _NEXT,
        }
        for name, inside in {**slots, "links": _LINKS}.items():
            table.add_slot(f"body-cell-{name}", f'<q-td :props="props" class="hw-cell-{name}">{inside}</q-td>')
        table.on("row-click", js_handler="(event, row) => window.handoverWatch.focus(row.name)")
        return table

    @staticmethod
    def _list(title: str, inside: str, key: str = "text") -> ui.table:
        ui.label(title).classes("hw-head")
        columns = [{"name": "text", "field": "text", "label": ""}]
        table = ui.table(columns=columns, rows=[], row_key=key)
        table.props('dense flat hide-header hide-pagination hide-bottom :rows-per-page-options="[0]"')
        table.add_slot("body", inside)
        return table

    def update(self) -> None:
        """Send the changes."""
        shown = self._watched.shown
        self._heading.text = self._watched.heading()
        for table, rows in (
            (self._table, shown.aircraft),
            (self._alarms, shown.alarms),
            (self._stations, shown.stations),
            (self._feed, shown.feed),
        ):
            new = [dict(row) for row in rows]
            if table.rows != new:
                table.rows = new
        missions = [each.drawn for key, each in self._watched.missions.items() if key not in self._missions]
        self._missions |= self._watched.missions.keys()
        given = {
            "missions": missions,
            "tracks": [track for mark in shown.marks if (track := self._track(mark["name"])) is not None],
            "marks": shown.marks,
            "commanding": shown.commanding,
        }
        ui.run_javascript(f"handoverWatch.show({json.dumps(given)})")

    def _track(self, name: str) -> dict[str, Any] | None:
        craft = self._watched.scene.aircraft.get(name)
        if craft is None:
            return None
        colours = self._watched.shown.colours
        points = [
            (round(lat, 6), round(lon, 6), colours.get(commander, colours[""]))
            for lat, lon, commander in craft.track.since(self._given.get(name, 0))
        ]
        self._given[name] = craft.track.count
        return {"name": name, "points": points} if points else None


def build(
    watched: Watched,
    tiles: Mapping[str, Any] | None,
    begin: Callable[[], None],
    end: Callable[[], None],
    source: TileSource | None = None,
) -> FastAPI:
    """The application. `tiles`: values of the map's tiles for the browser, None: there are none; `source`: tiles from
    the disk; `begin` and `end` are called within its event loop."""
    kind = PageKind(
        "handover watch",
        {"/watch": _HERE / "static"},
        ("/watch/map.css", "/watch/watch.css"),
        ("/watch/watch.js",),
        MOST_VIEWERS,
    )
    return page_server(kind, lambda: _Page(watched, tiles), begin, end, source)

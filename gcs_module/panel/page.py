# SPDX-License-Identifier: GPL-3.0-or-later

"""The panel's web page. NiceGUI brings its values to the browser and the orders back; `static/panel.js` draws it.

Rules that live here
--------------------
* The values go to each browser some times a second, the sections that have changed. The browser counts the time since
  the last values: if this program ends, the page says so by itself.
* An order of a browser is text from outside: it is checked as any other order. It needs the key of the link
  (`panel_auth.py`).
* At most MOST_VIEWERS browsers have opened their socket.

Import this only for `handover panel`: NiceGUI is an extra.
"""

from __future__ import annotations

import hmac
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, Final

from fastapi import FastAPI
from nicegui import ui
from nicegui.events import GenericEventArguments

from gcs_module.panel.band import OLD_S
from gcs_module.panel.panel_values import Known, marks_of, page_of
from gcs_module.panel.session import Session
from gcs_module.panel.words import for_buttons, seconds_to
from gcs_module.watch.page_server import PageKind, page_server
from gcs_module.watch.tiles import TileSource
from mavproxy_handover.mission.geodesy import distance_m

__all__ = ["MOST_VIEWERS", "build"]

MOST_VIEWERS: Final = 8
_HERE: Final = Path(__file__).resolve().parent
_MAP: Final = _HERE.parent / "watch" / "static"
_EVERY_S: Final = 0.4
#: orders of one browser that wait for their reply
_WAITING: Final = 16
#: parts of the page that `panel.js` fills; "": above the columns
_PARTS: Final = {
    "": ("head", "duty", "band", "rows"),
    "left": ("shift", "alarms", "briefing", "lines"),
    "right": ("values", "links", "peers"),
}


class _Page:
    """The page in one browser."""

    def __init__(self, session: Session, key: str, tiles: Mapping[str, Any] | None) -> None:
        self._session = session
        self._key = key
        self._pinned = 0
        #: section -> its values as they were sent
        self._sent: dict[str, str] = {}
        self._missions: set[str] = set()
        #: places of each track that were sent, by aircraft
        self._given: dict[str, int] = {}
        #: number of an order -> its word and its aircraft
        self._waiting: dict[int, dict[str, Any]] = {}
        for column, parts in _PARTS.items():
            with ui.element("div").classes(f"hp-{column}") if column else nullcontext():
                for part in parts:
                    ui.element("div").classes(f"hp-{part}")
        options = {"preferCanvas": True, "attributionControl": tiles is not None, "maxZoom": 20, "zoomSnap": 0.25}
        with ui.element("div").classes("hp-map"):
            self._map = ui.leaflet(center=(0.0, 0.0), zoom=2, options=options).classes("hw-map")
            self._map.clear_layers()  # its own tiles come from a network
        ui.on("panel_order", self._on_order)
        ui.on("panel_pin", self._on_pin)
        ui.run_javascript(f"handoverWatch.attach({self._map.id}, {json.dumps(tiles)}); handoverPanel.attach()")
        self.update()
        ui.timer(_EVERY_S, self.update)

    # ---- out ------------------------------------------------------------------------------------------------------

    def update(self) -> None:
        """Send what has changed, and a sign of life."""
        known = self._session.known()
        page = page_of(known, self._pinned)
        changed = {}
        for name, values in page.sections.items():
            text = json.dumps(values)
            if self._sent.get(name) != text:
                self._sent[name], changed[name] = text, values
        changed["replies"] = self._replies()
        ui.run_javascript(f"handoverPanel.show({json.dumps(changed)})")
        missions = [each.drawn for key, each in self._session.missions.items() if key not in self._missions]
        self._missions |= self._session.missions.keys()
        given = {
            "missions": missions,
            "tracks": [track for name in self._session.tracks if (track := self._track(name, known.colours))],
            "commanding": self._commanding(known),
            **marks_of(known),
            "borders": list(self._borders(known)),
        }
        text = json.dumps(given)
        if self._sent.get("map") != text:
            self._sent["map"] = text
            ui.run_javascript(f"handoverWatch.show({text})")

    def _track(self, name: str, colours: Any) -> dict[str, Any] | None:
        track = self._session.tracks[name]
        points = [
            (round(lat, 6), round(lon, 6), colours.get(commander, "#8a8a8a"))
            for lat, lon, commander in track.since(self._given.get(name, 0))
        ]
        self._given[name] = track.count
        return {"name": name, "points": points} if points else None

    def _commanding(self, known: Known) -> dict[str, list[str]]:
        """By mission: the stations that command an aircraft that is heard."""
        found: dict[str, set[str]] = {}
        for craft in () if known.seen is None or known.dead else known.seen.aircraft:
            mission = self._session.missions.get(craft.mission)
            heard = craft.heard_at is not None and known.now - craft.heard_at <= OLD_S
            if mission is not None and craft.commander and heard:
                found.setdefault(mission.key, set()).add(craft.commander)
        return {key: sorted(names) for key, names in found.items()}

    def _borders(self, known: Known) -> Iterator[dict[str, Any]]:
        """The next border of each aircraft that is heard: the nearest of those between its two stations."""
        for craft in () if known.seen is None or known.dead else known.seen.aircraft:
            mission, border, place = self._session.missions.get(craft.mission), craft.border, craft.position
            if mission is None or border is None or place is None or known.now - place.at > OLD_S:
                continue
            pair = border.from_station, border.to_station
            found = [
                each.place
                for each in mission.crossings
                if (mission.names.get(each.from_station), mission.names.get(each.to_station)) == pair
            ]
            if found:
                at = min(found, key=partial(_far_m, place.value))
                denied = "denied" in (border.answer, border.other)
                left = f"{seconds_to(border.at, known.now)}{': denied' if denied else ''}"
                yield {"key": craft.name, "at": list(at), "words": f"{pair[0]} to {pair[1]} {left}"}

    def _replies(self) -> list[dict[str, Any]]:
        done = []
        for number, order in list(self._waiting.items()):
            reply = self._session.reply(number)
            if reply is not None:
                del self._waiting[number]
                done.append({"used": reply[0], "text": for_buttons(reply[1]), **order})
        return done

    # ---- in -------------------------------------------------------------------------------------------------------

    def _on_order(self, event: GenericEventArguments) -> None:
        given = event.args if isinstance(event.args, dict) else {}
        if hmac.compare_digest(str(given.get("key", "")).encode(), self._key.encode()):
            number, problem = self._session.order({name: value for name, value in given.items() if name != "key"})
        else:
            number, problem = 0, "Not sent: this page needs a new link. Press Enter in the panel's terminal."
        order = {"do": str(given.get("do", ""))[:20]}
        if problem:
            ui.run_javascript(
                f"handoverPanel.show({json.dumps({'replies': [{'used': False, 'text': problem, **order}]})})"
            )
        elif len(self._waiting) < _WAITING:
            self._waiting[number] = order

    def _on_pin(self, event: GenericEventArguments) -> None:
        given = event.args.get("vehicle") if isinstance(event.args, dict) else None
        if isinstance(given, int):
            self._pinned = 0 if given == self._pinned else given
            self.update()


def _far_m(here: tuple[float, float], there: tuple[float, float]) -> float:
    return distance_m(here[0], here[1], there[0], there[1])


def build(
    session: Session, begin: Callable[[], None], end: Callable[[], None], key: str, tiles: TileSource | None = None
) -> FastAPI:
    """The application. `begin` and `end` are called within its event loop; `key`: that orders need; `tiles`: of the
    map, None: it has none."""
    kind = PageKind(
        "handover panel",
        {"/panel": _HERE / "static", "/watch": _MAP},
        ("/watch/map.css", "/panel/panel.css"),
        ("/watch/watch.js", "/panel/panel.js"),
        MOST_VIEWERS,
    )
    drawn = None if tiles is None else tiles.drawn()
    return page_server(kind, lambda: _Page(session, key, drawn), begin, end, tiles)

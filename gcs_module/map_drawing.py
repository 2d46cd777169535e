# SPDX-License-Identifier: GPL-3.0-or-later

"""How the items of `map_items.py` look on MAVProxy's map: our own objects, drawn in the map's process.

MAVProxy's polygons and labels cannot draw holes, nor text that is legible on any background. Areas across the 180th
meridian they draw around the earth the other way.

A panel holds the time of its values, and its station sends it each second. A panel older than OLD_S is drawn grey with
its age: its station's program has stopped. For that the map redraws each second even if nothing arrives.

Import this only if a map is loaded: it needs OpenCV, as the map does. Only the map's process needs wx.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any, Final

import cv2
from MAVProxy.modules.mavproxy_map.mp_slipmap_util import SlipObject

from gcs_module.banner import OLD_S
from gcs_module.map_items import Colour, Item, Line, Mark, Paths, Place, Plate, Row, Sign
from mavproxy_handover.mission.geodesy import beside_deg

__all__ = ["map_object"]

_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_SIZE, _PLATE_SIZE = 0.45, 0.5
_EDGE: Final[Colour] = (255, 255, 255)
_BLACK: Final[Colour] = (0, 0, 0)
_GREY: Final[Colour] = (150, 150, 150)
#: the map redraws this often although nothing arrives (ms)
_AGAIN_MS: Final = 1000
#: pixels: margin around text, between lines, half a mark, from the corner, from one panel to the next
_AROUND, _BETWEEN, _HALF, _CORNER, _NEXT_PLATE = 4, 5, 7, 8, 110
#: nothing is drawn farther outside than this (pixels): OpenCV uses 32 bits
_FAR: Final = 1 << 24

#: radius of the ring around an aircraft (pixels): MAVProxy's icon is inside
_RING: Final = 20

_Bounds = tuple[float, float, float, float]
_Pixels = Callable[[Place], tuple[int, int]]


def map_object(key: str, layer: str, item: Item) -> Any:
    """The object for MAVProxy's map that shows an item."""
    if isinstance(item, Paths):
        return DrawnPaths(key, layer, item)
    return DrawnSign(key, layer, item) if isinstance(item, Sign) else DrawnPlate(key, layer, item)


def _beside(place: Place, bounds: _Bounds) -> Place:
    """The place on the side of the 180th meridian where the view is. `bounds`: south, west, height and width."""
    return place[0], beside_deg(place[1], bounds[1] + bounds[3] / 2.0)


class DrawnPaths(SlipObject):
    """Lines."""

    def __init__(self, key: str, layer: str, item: Paths) -> None:
        super().__init__(key, layer)
        self.item = item

    def draw(self, img: Any, pixmapper: _Pixels, bounds: _Bounds) -> None:
        """Called by the map."""
        item = self.item
        pieces = [piece for line in item.lines for piece in _pieces(line, img, pixmapper, bounds)]
        if item.edged:
            for start, end in pieces:
                cv2.line(img, start, end, _EDGE, item.width + 3, cv2.LINE_AA)
        for start, end in pieces:
            cv2.line(img, start, end, item.colour, item.width, cv2.LINE_AA)


def _pieces(
    line: Line, img: Any, pixmapper: _Pixels, bounds: _Bounds
) -> Iterable[tuple[tuple[int, int], tuple[int, int]]]:
    """The visible pieces of a line."""
    height, width = img.shape[:2]
    points = [pixmapper(_beside(place, bounds)) for place in line]
    for start, end in pairwise(points):
        if max(map(abs, (*start, *end))) < _FAR:
            seen, first, last = cv2.clipLine((0, 0, width, height), start, end)
            if seen:
                yield first, last


class DrawnSign(SlipObject):
    """Words at a place."""

    def __init__(self, key: str, layer: str, item: Sign) -> None:
        super().__init__(key, layer)
        self.item = item

    def draw(self, img: Any, pixmapper: _Pixels, bounds: _Bounds) -> None:
        """Called by the map."""
        item = self.item
        x, y = pixmapper(_beside(item.place, bounds))
        if max(abs(x), abs(y)) >= _FAR:
            return
        if item.mark is Mark.RING:
            cv2.circle(img, (x, y), _RING, _EDGE, 5, cv2.LINE_AA)
            cv2.circle(img, (x, y), _RING, item.colour, 2, cv2.LINE_AA)
            y += _RING + _AROUND
        elif item.mark is not Mark.NONE:
            look = cv2.MARKER_DIAMOND if item.mark is Mark.DIAMOND else cv2.MARKER_STAR
            inside = item.colour if item.plate == _EDGE else item.plate
            cv2.drawMarker(img, (x, y), _EDGE, look, 2 * _HALF + 2, 5, cv2.LINE_AA)
            cv2.drawMarker(img, (x, y), inside, look, 2 * _HALF, 2, cv2.LINE_AA)
            y += _HALF + 2 * _AROUND
        for words in item.words:
            (wide, high), _below = cv2.getTextSize(words, _FONT, _SIZE, 1)
            left, base = x - wide // 2, y + high
            # no edges around letters: OpenCV 5 draws broad ones in another font, which is wider
            corners = (left - _AROUND, y - _AROUND), (left + wide + _AROUND, base + _AROUND)
            cv2.rectangle(img, *corners, item.plate, -1)
            cv2.putText(img, words, (left, base), _FONT, _SIZE, item.colour, 1, cv2.LINE_AA)
            y += high + _BETWEEN + _AROUND


class DrawnPlate(SlipObject):
    """A panel in the corner of the view."""

    def __init__(self, key: str, layer: str, item: Plate) -> None:
        super().__init__(key, layer)
        self.item = item

    def draw(self, img: Any, pixmapper: _Pixels, bounds: _Bounds) -> None:
        """Called by the map."""
        y = _CORNER + self.item.number * _NEXT_PLATE
        rows = _aged(self.item, time.monotonic())
        if self.item.at:
            _draw_again()
        sizes = [cv2.getTextSize(row.words, _FONT, _PLATE_SIZE, 1)[0] for row in rows]
        wide = max((size[0] for size in sizes), default=0) + 2 * _AROUND
        for row, (_width, high) in zip(rows, sizes, strict=True):
            below = y + high + 2 * _AROUND + 2
            cv2.rectangle(img, (_CORNER, y), (_CORNER + wide, below), row.ground, -1)
            cv2.putText(
                img,
                row.words,
                (_CORNER + _AROUND, y + high + _AROUND),
                _FONT,
                _PLATE_SIZE,
                row.colour,
                1,
                cv2.LINE_AA,
            )
            y = below


def _aged(plate: Plate, now: float) -> tuple[Row, ...]:
    """The rows of a panel; grey and below their age if they are old."""
    age_s = now - plate.at if plate.at else 0.0
    if age_s <= OLD_S:
        return plate.rows
    first = Row(f"OLD: {age_s:.0f} s. THIS STATION'S PROGRAM STANDS STILL.", _BLACK, _GREY)
    return (first, *(Row(row.words, _GREY, _EDGE) for row in plate.rows))


#: the map's timer for the next redraw, if there is one
_timers: list[Any] = []


def _draw_again() -> None:
    """Make the map redraw soon. Without wx there is no window, and nothing is redrawn."""
    try:
        from MAVProxy.modules.lib.wx_loader import wx

        state = wx.GetApp().frame.state
    except (ImportError, AttributeError):
        return
    if not any(timer.IsRunning() for timer in _timers):
        _timers[:] = [wx.CallLater(_AGAIN_MS, lambda: setattr(state, "need_redraw", True))]

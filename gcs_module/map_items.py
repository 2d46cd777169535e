# SPDX-License-Identifier: GPL-3.0-or-later

"""The items on a map: lines, words at a place, a panel in the corner. Two items are equal if they look alike.

Places are (latitude, longitude) in degrees; in an area across the 180th meridian longitudes continue beyond 180.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["Colour", "Item", "Line", "Mark", "Paths", "Place", "Plate", "Row", "Sign"]

Place = tuple[float, float]
Colour = tuple[int, int, int]
Line = tuple[Place, ...]


class Mark(Enum):
    """The mark at the place of a `Sign`."""

    NONE = ""
    DIAMOND = "diamond"
    STAR = "star"
    RING = "ring"


@dataclass(frozen=True, slots=True)
class Paths:
    """Lines of one kind. `width` in pixels; `edged`: with a light edge, to be visible on any background."""

    lines: tuple[Line, ...]
    colour: Colour
    width: int
    edged: bool = False


@dataclass(frozen=True, slots=True)
class Sign:
    """Words at a place, line by line, below its mark. `plate`: background colour."""

    place: Place
    words: tuple[str, ...]
    colour: Colour
    mark: Mark = Mark.NONE
    plate: Colour = (255, 255, 255)


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a panel."""

    words: str
    colour: Colour
    ground: Colour


@dataclass(frozen=True, slots=True)
class Plate:
    """A panel in the upper left corner of the map. `number`: its position, from above; `at`: time of its values in
    seconds of the machine's monotonic clock, 0: they do not get old."""

    rows: tuple[Row, ...]
    number: int = 0
    at: float = 0.0


Item = Paths | Sign | Plate

# SPDX-License-Identifier: GPL-3.0-or-later

"""What there can be on a map: lines, words at a place, a plate in the corner. Values, equal if they look alike.

Places are (latitude, longitude) in degrees; longitudes go on beyond 180 where an area does.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["Colour", "Item", "Line", "Mark", "Paths", "Place", "Plate", "Row", "Sign"]

Place = tuple[float, float]
Colour = tuple[int, int, int]
Line = tuple[Place, ...]


class Mark(Enum):
    """What stands at the place of a sign."""

    NONE = ""
    DIAMOND = "diamond"
    STAR = "star"


@dataclass(frozen=True, slots=True)
class Paths:
    """Lines of one kind. `width` in pixels; `edged`: with a light edge, so that they are seen on any ground."""

    lines: tuple[Line, ...]
    colour: Colour
    width: int
    edged: bool = False


@dataclass(frozen=True, slots=True)
class Sign:
    """Words at a place, line by line, below its mark. `plate`: the colour behind them."""

    place: Place
    words: tuple[str, ...]
    colour: Colour
    mark: Mark = Mark.NONE
    plate: Colour = (255, 255, 255)


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a plate."""

    words: str
    colour: Colour
    ground: Colour


@dataclass(frozen=True, slots=True)
class Plate:
    """Lines in the upper left corner of the map. `number`: of the plate, from above; `at`: when they were true, in
    seconds of the machine's monotonic clock, 0: they do not grow old."""

    rows: tuple[Row, ...]
    number: int = 0
    at: float = 0.0


Item = Paths | Sign | Plate

# SPDX-License-Identifier: GPL-3.0-or-later

"""Straight pieces of a path on the ground, and the place of an aircraft on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

from mavproxy_handover.mission.geodesy import east_north_m

__all__ = ["Line", "PieceRow", "Spot"]

#: pieces before and after the last one that are checked first
_BACK, _AHEAD = 2, 8
#: an aircraft that is farther than that (m) from all of these may be at any other piece
_NEAR_M: Final = 15.0


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece of the flight, in degrees."""

    start: tuple[float, float]
    end: tuple[float, float]

    def measure(self, place: tuple[float, float]) -> tuple[float, float, float]:
        """Distance of a place along the line, beside it (right above 0), and the line's length: metres.

        Before the beginning and after the end the distance from that point counts.
        """
        east, north = east_north_m(*self.start, *self.end)
        length = math.hypot(east, north)
        away_east, away_north = east_north_m(*self.start, *place)
        if length < 1.0:
            return 0.0, math.hypot(away_east, away_north), length
        along = (away_east * east + away_north * north) / length
        across = (away_east * north - away_north * east) / length
        over = max(-along, along - length, 0.0)
        return along, math.copysign(math.hypot(across, over), across), length

    @property
    def bearing_deg(self) -> float:
        """Direction of the line at its middle."""
        return math.degrees(math.atan2(*east_north_m(*self.start, *self.end)))


@dataclass(frozen=True, slots=True)
class Spot:
    """Place of an aircraft on a row of pieces: number of the piece, distance along the row, distance beside it."""

    piece: int
    along_m: float
    across_m: float


class PieceRow:
    """Straight pieces that are flown one after the other. It remembers at which one the aircraft was last."""

    def __init__(self, lines: Sequence[Line]) -> None:
        """`lines`: at least one; each begins where the one before ends."""
        self.lines = tuple(lines)
        lengths = [line.measure(line.start)[2] for line in self.lines]
        self._begins_m = list(accumulate(lengths, initial=0.0))
        self._at = 0

    @property
    def start(self) -> tuple[float, float]:
        """Where it begins."""
        return self.lines[0].start

    @property
    def length_m(self) -> float:
        """The length of all pieces."""
        return self._begins_m[-1]

    def find(self, place: tuple[float, float]) -> Spot:
        """The nearest piece, of those around the last one if the aircraft is near them."""
        around = range(max(0, self._at - _BACK), min(len(self.lines), self._at + _AHEAD + 1))
        found = self._nearest(place, around)
        if abs(found.across_m) > _NEAR_M and len(around) < len(self.lines):
            found = self._nearest(place, range(len(self.lines)))
        self._at = found.piece
        return found

    def _nearest(self, place: tuple[float, float], pieces: range) -> Spot:
        best: Spot | None = None
        for number in pieces:
            along, across, length = self.lines[number].measure(place)
            if best is None or abs(across) < abs(best.across_m):
                best = Spot(number, self._begins_m[number] + min(max(along, 0.0), length), across)
        assert best is not None
        return best

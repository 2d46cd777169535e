# SPDX-License-Identifier: GPL-3.0-or-later

"""The ground of a campaign: a plane, in metres east and north of home, with places and circles on it.

It lies on the equator. There a plane of tens of kilometres agrees with degrees to within millimetres. So what is
computed on the plane (`pace.py`, `places.py`) holds for the rules.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import atan2, degrees, hypot, sqrt
from typing import Final

from mavproxy_handover.mission.geodesy import LocalPlane

__all__ = ["HOME", "Circle", "Spot", "bare_spans", "bearing_deg", "on_earth", "segment_m"]

_PLANE: Final = LocalPlane(0.0, 5.92)


@dataclass(frozen=True, slots=True)
class Spot:
    """A place: metres east and north of home, and a height above it.

    The height of a return site is that of the lowest way there.
    """

    x_m: float
    y_m: float
    alt_m: float = 0.0

    def away_m(self, x_m: float, y_m: float) -> float:
        """Horizontal distance."""
        return hypot(self.x_m - x_m, self.y_m - y_m)


HOME: Final = Spot(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Circle:
    """A zone."""

    x_m: float
    y_m: float
    radius_m: float

    def margin_m(self, x_m: float, y_m: float) -> float:
        """How far a place is inside, below 0 outside."""
        return self.radius_m - hypot(self.x_m - x_m, self.y_m - y_m)

    def crossed(self, x: float, y: float, vx: float, vy: float, more_m: float = 0.0) -> tuple[float, float] | None:
        """When a straight way goes into a circle that is larger by `more_m`, and out of it.

        In units of (vx, vy) from (x, y), below 0 for a point already passed; None: never.
        """
        dx, dy, radius = x - self.x_m, y - self.y_m, self.radius_m + more_m
        a, b, c = vx * vx + vy * vy, dx * vx + dy * vy, dx * dx + dy * dy - radius * radius
        under = b * b - a * c
        if under <= 0.0 or a == 0.0:
            return None
        root = sqrt(under)
        return (-b - root) / a, (-b + root) / a


def bare_spans(start: Spot, end: Spot, circles: Iterable[Circle], more_m: float = 0.0) -> Iterator[tuple[float, float]]:
    """The parts of a straight way (m) that are in none of the circles, each larger by `more_m`."""
    length = start.away_m(end.x_m, end.y_m)
    if length == 0.0:
        return
    east, north = (end.x_m - start.x_m) / length, (end.y_m - start.y_m) / length
    spans = (
        each.crossed(start.x_m, start.y_m, east, north, more_m) for each in circles if each.radius_m + more_m > 0.0
    )
    covered_to = 0.0
    for begins, ends in sorted(span for span in spans if span is not None):
        if begins > covered_to:
            yield covered_to, min(begins, length)
        covered_to = max(covered_to, ends)
        if covered_to >= length:
            return
    yield covered_to, length


def segment_m(x_m: float, y_m: float, start: Spot, end: Spot) -> float:
    """How far a place is from the straight way between two others."""
    east, north = end.x_m - start.x_m, end.y_m - start.y_m
    square = east * east + north * north
    part = 0.0 if square == 0.0 else ((x_m - start.x_m) * east + (y_m - start.y_m) * north) / square
    part = min(1.0, max(0.0, part))
    return hypot(start.x_m + part * east - x_m, start.y_m + part * north - y_m)


def on_earth(x_m: float, y_m: float) -> tuple[float, float]:
    """Latitude and longitude of a place on the plane."""
    return _PLANE.to_earth(x_m, y_m)


def bearing_deg(east_m: float, north_m: float) -> float:
    """Direction from north, clockwise, 0 up to 360."""
    return degrees(atan2(east_m, north_m)) % 360.0

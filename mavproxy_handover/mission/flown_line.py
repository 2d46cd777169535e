# SPDX-License-Identifier: GPL-3.0-or-later

"""Geometry of a line that is flown: metres east and north, and directions in degrees from north."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.mission.geodesy import east_north_m
from mavproxy_handover.mission.l1_guidance import Point
from mavproxy_handover.mission.leg import Place

__all__ = [
    "SAME_M",
    "Slope",
    "bearing_of_deg",
    "beside_m",
    "beyond",
    "difference_deg",
    "direction_deg",
    "part_behind",
]

#: two places nearer than that (m) are one
SAME_M: Final = 0.5


@dataclass(frozen=True, slots=True)
class Slope:
    """A change of height on the way to a place, even over the distance."""

    from_m: float
    to_m: float
    length_m: float

    def at(self, left_m: float) -> float:
        """Height where that distance is left."""
        if self.length_m < SAME_M:
            return self.to_m
        return self.to_m + (self.from_m - self.to_m) * min(1.0, max(0.0, left_m / self.length_m))


def part_behind(start: Point, end: Point, here: Point) -> float:
    """How much of a line is behind the aircraft: 1 and more at its end."""
    east, north = end[0] - start[0], end[1] - start[1]
    square = east * east + north * north
    return 1.0 if square < 1e-3 else ((here[0] - start[0]) * east + (here[1] - start[1]) * north) / square


def beside_m(start: Point, end: Point, here: Point) -> float:
    """Distance beside a line, right of it above 0."""
    east, north = end[0] - start[0], end[1] - start[1]
    length = math.hypot(east, north)
    return 0.0 if length < 1e-3 else ((here[0] - start[0]) * north - (here[1] - start[1]) * east) / length


def beyond(start: Point, end: Point, distance_m: float) -> Point:
    """The place so far beyond the end of a line."""
    length = math.dist(start, end)
    if length < 1e-3 or distance_m == 0.0:
        return end
    return (
        end[0] + (end[0] - start[0]) / length * distance_m,
        end[1] + (end[1] - start[1]) / length * distance_m,
    )


def direction_deg(way: tuple[float, float]) -> float:
    return math.degrees(math.atan2(*way))


def bearing_of_deg(start: Place, end: Place) -> float:
    return direction_deg(east_north_m(*start[:2], *end[:2]))


def difference_deg(deg: float, from_deg: float) -> float:
    return (deg - from_deg + 180.0) % 360.0 - 180.0

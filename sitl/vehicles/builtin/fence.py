# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether a place keeps to the fence, as ArduCopter asks it of a rally point before it returns there.

AC_Fence::check_destination_within_fence: of the fences that are on (FENCE_ENABLE, FENCE_TYPE) the ceiling, the circle
around home, and the areas that were uploaded: inside every one to stay inside, outside every one to stay out of. That
is all there is of the fence here: leaving it has no consequence in this model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from sitl.vehicles.builtin.frame import Location, offset_ne_m
from sitl.vehicles.builtin.items import Item
from sitl.vehicles.builtin.params import ParameterTable

__all__ = ["keeps_to_fence"]

_CEILING, _CIRCLE, _AREAS = 1, 2, 4
_POLYGONS, _CIRCLES = (5001, 5002), (5003, 5004)
_TO_STAY_INSIDE = (5001, 5003)


def keeps_to_fence(
    place: Location, above_home_m: float, home: Location, items: Sequence[Item], parameters: ParameterTable
) -> bool:
    """Whether the place, so high above home, keeps to the fences that are on."""
    kinds = int(parameters["FENCE_TYPE"]) if parameters["FENCE_ENABLE"] != 0 else 0
    if kinds & _CEILING and above_home_m > parameters["FENCE_ALT_MAX"]:
        return False
    if kinds & _CIRCLE and math.hypot(*offset_ne_m(home, place)) > parameters["FENCE_RADIUS"]:
        return False
    return not kinds & _AREAS or all(inside is wanted for inside, wanted in _areas(items, place))


def _areas(items: Sequence[Item], place: Location) -> Iterator[tuple[bool, bool]]:
    """Each area: whether the place is inside it, and whether it has to be."""
    index = 0
    while index < len(items):
        item = items[index]
        count = int(item.param1) if item.command in _POLYGONS else 1
        if item.command in _POLYGONS:
            corners = [offset_ne_m(place, _spot(corner)) for corner in items[index : index + count]]
            yield _around(corners), item.command in _TO_STAY_INSIDE
        elif item.command in _CIRCLES:
            away_m = math.hypot(*offset_ne_m(_spot(item), place))
            yield away_m < item.param1, item.command in _TO_STAY_INSIDE
        index += max(1, count)


def _spot(item: Item) -> Location:
    return Location(item.x, item.y, 0.0)


def _around(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether corners given from a place lie around it.

    A ray to the north then crosses the outline an odd number of times.
    """
    inside = False
    for one, other in pairwise([*corners, corners[0]]):
        if (one[1] > 0.0) is not (other[1] > 0.0):
            north = one[0] - one[1] * (other[0] - one[0]) / (other[1] - one[1])
            inside ^= north > 0.0
    return inside

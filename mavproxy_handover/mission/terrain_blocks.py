# SPDX-License-Identifier: GPL-3.0-or-later

"""Blocks of terrain as the autopilot asks for them, out of the heights that a mission brings.

A TERRAIN_REQUEST names a corner (south-west), a spacing and a mask of 8 x 7 blocks of 4 x 4 heights. Bit 0 is the
corner; bits count to the east first. A block is given only if the mission knows the ground at all its sixteen places,
between four known cells each. Nothing is extrapolated, and a gap in the grid is no height.

Source: ArduPilot's AP_Terrain (TerrainGCS.cpp, `Location::offset`).
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.mission.terrain import Terrain

__all__ = ["BLOCKS", "EAST_BLOCKS", "bits_of", "heights_of"]

BLOCKS: Final = 56
EAST_BLOCKS: Final = 8
_SIDE: Final = 4
#: metres of a degree of latitude, as ArduPilot counts it
_DEGREE_M: Final = 111_318.84502145034
_LOWEST_M, _HIGHEST_M = -32_768, 32_767


def bits_of(mask: int) -> list[int]:
    """The blocks that a mask asks for."""
    return [bit for bit in range(BLOCKS) if mask >> bit & 1]


def heights_of(terrain: Terrain, corner: tuple[float, float], spacing_m: int, bit: int) -> list[int] | None:
    """The sixteen heights (m) of a block; None: not all are known. `corner`: latitude and longitude, degrees."""
    if not 0 <= bit < BLOCKS or spacing_m <= 0 or not -80.0 <= corner[0] <= 80.0:
        return None
    up, right = _SIDE * (bit // EAST_BLOCKS), _SIDE * (bit % EAST_BLOCKS)
    found = []
    for number in range(_SIDE * _SIDE):
        height_m = terrain.between_m(
            _place(corner, spacing_m * (up + number // _SIDE), spacing_m * (right + number % _SIDE))
        )
        if height_m is None or not _LOWEST_M <= round(height_m) <= _HIGHEST_M:
            return None
        found.append(round(height_m))
    return found


def _place(corner: tuple[float, float], north_m: float, east_m: float) -> tuple[float, float]:
    north_deg = north_m / _DEGREE_M
    scale = math.cos(math.radians(corner[0] + north_deg / 2.0))
    return corner[0] + north_deg, corner[1] + east_m / _DEGREE_M / scale

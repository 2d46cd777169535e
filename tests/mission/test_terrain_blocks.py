# SPDX-License-Identifier: GPL-3.0-or-later

"""Blocks of terrain for the autopilot: right heights at the right places, and none that is not known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mavproxy_handover.mission.terrain import Terrain
from mavproxy_handover.mission.terrain_blocks import bits_of, heights_of

SOUTH, WEST, CELL = 52.0, 4.0, 0.001
CORNER = (52.02, 4.02)


def grid(gap: tuple[int, int] | None = None) -> Terrain:
    """Ten metres a row to the north, one a column to the east."""
    heights = np.add.outer(np.arange(100.0) * 10.0, np.arange(100.0))
    if gap is not None:
        heights[gap] = math.nan
    return Terrain(SOUTH, WEST, CELL, heights)


def test_the_bits_of_a_mask() -> None:
    assert bits_of(0) == []
    assert bits_of(1 | 1 << 8 | 1 << 55 | 1 << 60) == [0, 8, 55]


@pytest.mark.parametrize("bit", [0, 1, 8, 17, 55])
def test_heights_lie_where_the_autopilot_puts_them(bit: int) -> None:
    """Bits to the east first, heights to the east first, both to the north after that."""
    found = heights_of(grid(), CORNER, 100, bit)
    assert found is not None
    for number, height in enumerate(found):
        north = 100 * (4 * (bit // 8) + number // 4)
        east = 100 * (4 * (bit % 8) + number % 4)
        lat = CORNER[0] + north / 111_319
        lon = CORNER[1] + east / 111_319 / math.cos(math.radians(lat))
        assert height == pytest.approx((lat - SOUTH) / CELL * 10.0 + (lon - WEST) / CELL, abs=1.0)


def test_nothing_is_extrapolated() -> None:
    """A block that is outside, or partly outside, has no heights; nor has one beside a gap."""
    assert heights_of(grid(), (51.9999, 4.02), 100, 0) is None
    assert heights_of(grid(), (52.02, 3.9999), 100, 0) is None
    assert heights_of(grid(), (52.0975, 4.02), 100, 0) is None
    assert heights_of(grid(), CORNER, 100, 0) is not None
    for row in range(20, 24):
        for column in range(20, 25):
            assert heights_of(grid((row, column)), CORNER, 100, 0) is None
    assert heights_of(grid((40, 40)), CORNER, 100, 0) is not None


@pytest.mark.parametrize(("corner", "spacing", "bit"), [((89.0, 0.0), 100, 0), (CORNER, 0, 0), (CORNER, 100, 56)])
def test_what_cannot_be_asked_for_has_no_heights(corner: tuple[float, float], spacing: int, bit: int) -> None:
    assert heights_of(grid(), corner, spacing, bit) is None

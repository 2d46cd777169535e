# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of the ground that a mission brings along: an Esri ASCII grid, as GDAL and QGIS write it (AAIGrid).

Six lines of header (`ncols`, `nrows`, `xllcorner` or `xllcenter`, `yllcorner` or `yllcenter`, `cellsize` in degrees,
`NODATA_value`, which may be left out), then the heights in metres, row by row, the northernmost first. Above what they
are counted plays no part: all that is compared to them is counted from the ground at home.

Where the grid has no value the ground is not known, and nothing is said of it. What lies between cells counts as high
as the highest of the four around it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.geodesy import beside_deg, wrap_longitude_deg
from mavproxy_handover.mission.plan import Home

__all__ = ["CLEAR_M", "Relief", "Terrain", "read_terrain", "relief_of"]

#: a path is above the ground if its clearance is at least this (m)
CLEAR_M: Final = 10.0
#: cells of a grid, at the most
MOST_CELLS: Final = 100_000
#: a way is looked at this often at the most
_MOST_STEPS: Final = 20_000
#: sides of a cell: from a metre to a degree
_CELL_DEG: Final = (1e-5, 1.0)
#: a degree of latitude
_DEGREE_M: Final = 111_320.0
#: no ground is lower or higher (m)
_LOWEST_M, _HIGHEST_M = -500.0, 9000.0
_NAMES: Final = ("ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter", "cellsize", "nodata_value")
_NO_DATA: Final = -9999.0

#: latitude and longitude, degrees
_Spot = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """A grid of heights.

    `south`, `west`: middle of its first cell in degrees. `heights`: shape (rows, columns), in metres, the southernmost
    row first, NaN if unknown.
    """

    south: float
    west: float
    cell_deg: float
    heights: NDArray[np.float64]

    def highest_m(self, start: _Spot, end: _Spot) -> float | None:
        """The highest ground along the straight way, as far as it is known; None where none of it is."""
        west = beside_deg(self.west, start[1])
        lon = wrap_longitude_deg(end[1] - start[1])
        size = max(abs(end[0] - start[0]), abs(lon)) / self.cell_deg
        steps = min(_MOST_STEPS, max(1, math.ceil(2.0 * size)))
        part = np.linspace(0.0, 1.0, steps + 1, dtype=np.float64)
        found = self._around(start[0] + part * (end[0] - start[0]), start[1] + part * lon - west)
        return None if found.size == 0 else float(np.max(found))

    def _around(self, lats: NDArray[np.float64], east: NDArray[np.float64]) -> NDArray[np.float64]:
        """The known heights of the four cells around each place; `east` of the first cell, in degrees."""
        height, width = self.heights.shape
        # a place in the middle of a cell has no other around it
        at = (np.round((lats - self.south) / self.cell_deg, 6), np.round(east / self.cell_deg, 6))
        found = []
        for up, right in _CORNERS:
            rows, columns = up(at[0]).astype(int), right(at[1]).astype(int)
            inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
            found.append(self.heights[rows[inside], columns[inside]])
        heights: NDArray[np.float64] = np.concatenate(found)
        known: NDArray[np.float64] = heights[~np.isnan(heights)]
        return known

    def between_m(self, spot: _Spot) -> float | None:
        """The ground at a place, between the four cells around it as ArduPilot counts it; None where one is unknown."""
        height, width = self.heights.shape
        row = round((spot[0] - self.south) / self.cell_deg, 6)
        column = round((spot[1] - beside_deg(self.west, spot[1])) / self.cell_deg, 6)
        low, left = math.floor(row), math.floor(column)
        if not (0 <= low <= row <= height - 1 and 0 <= left <= column <= width - 1):
            return None
        high, right = min(low + 1, height - 1), min(left + 1, width - 1)
        up, east = row - low, column - left
        south = (1.0 - east) * self.heights[low, left] + east * self.heights[low, right]
        north = (1.0 - east) * self.heights[high, left] + east * self.heights[high, right]
        found = float((1.0 - up) * south + up * north)
        return None if math.isnan(found) else found

    def lowest_m(self, spot: _Spot) -> float | None:
        """The lowest of the cells around a place; None where none is known."""
        found = self._around(np.array([spot[0]]), np.array([spot[1] - beside_deg(self.west, spot[1])]))
        return None if found.size == 0 else float(np.min(found))


@dataclass(frozen=True, slots=True)
class Relief:
    """The ground relative to home.

    `home_m`: height of the grid at home, as the lowest of the cells around it. `level_m`: height between these cells.
    """

    terrain: Terrain
    home_m: float
    level_m: float

    @property
    def cell_m(self) -> float:
        """How far apart the heights of the grid are."""
        return self.terrain.cell_deg * _DEGREE_M

    def rise_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """How much higher the ground is at a place than at home; None: not known."""
        there = self.terrain.between_m((lat_deg, lon_deg))
        return None if there is None else there - self.level_m

    def above_m(self, start: _Spot, end: _Spot, height_m: float) -> float:
        """Least clearance of a straight path at that height above home; infinite if the ground is unknown."""
        highest = self.terrain.highest_m(start, end)
        return math.inf if highest is None else height_m - (highest - self.home_m)


def relief_of(terrain: Terrain | None, home: Home, here: _Spot | None = None) -> Relief | None:
    """The ground as seen from `here`, None: from the plan's home, whose altitude counts where the grid has none."""
    if terrain is None:
        return None
    spot = here or (home.lat_deg, home.lon_deg)
    at_home, level = terrain.lowest_m(spot), terrain.between_m(spot)
    lowest_m = home.alt_m if at_home is None else at_home
    return Relief(terrain, lowest_m, lowest_m if level is None else level)


_CORNERS: Final = tuple((up, right) for up in (np.floor, np.ceil) for right in (np.floor, np.ceil))


def read_terrain(name: str, text: str) -> Terrain:
    """The grid in a file of that name. Raises MissionError, with the line."""
    where, lines = Where(name), text.splitlines()
    header: dict[str, float] = {}
    number = 0
    while number < len(lines) and lines[number].split()[:1] and lines[number].split()[0].lower() in _NAMES:
        words = lines[number].split()
        if len(words) != 2 or words[0].lower() in header:
            raise where.error(f"line {number + 1}: a name and one number, each name once")
        header[words[0].lower()] = _number(where, words[1], number + 1)
        number += 1
    columns, rows = _count(where, header, "ncols"), _count(where, header, "nrows")
    if columns * rows > MOST_CELLS:
        raise where.error(f"{columns} x {rows} cells (allowed: at most {MOST_CELLS})")
    cell = header.get("cellsize")
    if cell is None or not _CELL_DEG[0] <= cell <= _CELL_DEG[1]:
        raise where.error(f"cellsize is {cell} (allowed: {_CELL_DEG[0]:g} to {_CELL_DEG[1]:g} degrees)")
    west, south = _middle(where, header, "xll", cell, 180.0), _middle(where, header, "yll", cell, 90.0)
    if south + rows * cell > 90.0 + cell:
        raise where.error("ends beyond the pole: a grid in degrees of latitude and longitude is wanted")
    no_data = header.get("nodata_value", _NO_DATA)
    heights = np.empty((rows, columns))
    if len(lines) - number != rows:
        raise where.error(f"{len(lines) - number} rows of heights, nrows is {rows}")
    for row, line in enumerate(lines[number:]):
        values = line.split()
        if len(values) != columns:
            raise where.error(f"line {number + row + 1}: {len(values)} heights, ncols is {columns}")
        heights[rows - 1 - row] = [_height(where, word, no_data, number + row + 1) for word in values]
    return Terrain(south, wrap_longitude_deg(west), cell, heights)


def _number(where: Where, word: str, line: int) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise where.error(f"line {line}: '{word[:20]}' is no number")
    return value


def _count(where: Where, header: dict[str, float], name: str) -> int:
    value = header.get(name)
    if value is None or not value.is_integer() or not 2 <= value <= MOST_CELLS:
        raise where.error(f"{name} is {value} (allowed: a whole number from 2 to {MOST_CELLS})")
    return int(value)


def _middle(where: Where, header: dict[str, float], name: str, cell: float, most: float) -> float:
    """Middle of the first cell."""
    corner, center = header.get(f"{name}corner"), header.get(f"{name}center")
    if (corner is None) is (center is None):
        raise where.error(f"one of {name}corner and {name}center is wanted")
    value = corner + cell / 2.0 if corner is not None else center
    assert value is not None
    if not -most - cell <= value <= most + cell:
        raise where.error(f"{name} is {value:g}: a grid in degrees of latitude and longitude is wanted")
    return value


def _height(where: Where, word: str, no_data: float, line: int) -> float:
    value = _number(where, word, line)
    if value == no_data:
        return math.nan
    if not _LOWEST_M <= value <= _HIGHEST_M:
        raise where.error(f"line {line}: a height of {word[:20]} m (allowed: {_LOWEST_M:g} to {_HIGHEST_M:g})")
    return value

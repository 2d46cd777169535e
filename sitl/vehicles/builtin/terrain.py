# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of the ground that the autopilot asks for, as AP_Terrain does it, if TERRAIN_ENABLE is given and 1.

Heights come in tiles of 28 x 32 places, TERRAIN_SPACING apart. Tiles are counted from whole degrees, and overlap the
next one by four places. A TERRAIN_DATA fills 4 x 4 places of one. Wanted are the tiles at home, around the aircraft and
at the mission's items above terrain. Every two seconds each channel gets a request for the first one that is not whole.
Heights are kept in memory only.

What is flown: the height of an item above terrain counts from the ground there. From item to item the aircraft flies
straight. The ground that it lands on stays flat.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.frame import Location, offset_ne_m, shift
from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.params import ParameterTable

__all__ = ["Ground", "TerrainProtocol"]

_SIDE: Final = 4
#: blocks of 4 x 4 places in a tile: north, east
_BLOCKS_NORTH, _BLOCKS_EAST = 7, 8
_WHOLE: Final = (1 << _BLOCKS_NORTH * _BLOCKS_EAST) - 1
#: places from tile to tile
_STEP_NORTH, _STEP_EAST = (_BLOCKS_NORTH - 1) * _SIDE, (_BLOCKS_EAST - 1) * _SIDE
#: tiles around the aircraft are looked for in this part of a tile's side
_AROUND: Final = 0.7
_DEGREE: Final = 10_000_000
_EVERY_S: Final = 2.0
_REPORT_S: Final = 1.0
_TERRAIN_FRAME: Final = 10
_Corner = tuple[int, int]


class Ground:
    """The heights that are known."""

    def __init__(self, spacing_m: int) -> None:
        self.spacing_m = spacing_m
        #: south-western corner -> block -> its sixteen heights
        self.tiles: dict[_Corner, dict[int, list[int]]] = {}

    def tile(self, lat_e7: int, lon_e7: int) -> tuple[_Corner, float, float]:
        """The corner of the tile at a place; how far north and east in it the place is, in spacings."""
        degrees = Location(lat_e7 // _DEGREE * _DEGREE, lon_e7 // _DEGREE * _DEGREE, 0.0)
        north, east = (metres / self.spacing_m for metres in offset_ne_m(degrees, Location(lat_e7, lon_e7, 0.0)))
        up, right = int(north) // _STEP_NORTH * _STEP_NORTH, int(east) // _STEP_EAST * _STEP_EAST
        return shift(degrees, up * self.spacing_m, right * self.spacing_m), north - up, east - right

    def height_m(self, lat_e7: int, lon_e7: int) -> float | None:
        """The ground at a place, between the four around it; None: not known. Its tile is wanted from now on."""
        corner, north, east = self.tile(lat_e7, lon_e7)
        blocks = self.tiles.setdefault(corner, {})
        low, left = int(north), int(east)
        found = [self._at(blocks, low + up, left + right) for up in (0, 1) for right in (0, 1)]
        known = [height for height in found if height is not None]
        if len(known) < len(found):
            return None
        up, right = north - low, east - left
        south, northern = (known[n] * (1 - right) + known[n + 1] * right for n in (0, 2))
        return south * (1 - up) + northern * up

    @staticmethod
    def _at(blocks: Mapping[int, list[int]], north: int, east: int) -> int | None:
        heights = blocks.get(north // _SIDE * _BLOCKS_EAST + east // _SIDE)
        return None if heights is None else heights[north % _SIDE * _SIDE + east % _SIDE]

    def take(self, message: Any) -> None:
        """A TERRAIN_DATA; of a tile that is not wanted it is passed over."""
        blocks = self.tiles.get((message.lat, message.lon))
        if blocks is not None and message.grid_spacing == self.spacing_m and message.gridbit < _WHOLE.bit_length():
            blocks[message.gridbit] = list(message.data)

    def missing(self) -> Iterator[tuple[_Corner, int]]:
        """The tiles that are not whole, and the blocks that each lacks."""
        for corner, blocks in self.tiles.items():
            mask = _WHOLE & ~sum(1 << bit for bit in blocks)
            if mask:
                yield corner, mask

    @property
    def loaded(self) -> int:
        """Blocks that are known."""
        return sum(map(len, self.tiles.values()))

    @property
    def pending(self) -> int:
        """Blocks that are asked for."""
        return sum(mask.bit_count() for _corner, mask in self.missing())


class TerrainProtocol:
    """Requests of the autopilot, and its reports."""

    def __init__(self, parameters: ParameterTable, links: Mapping[int, Link]) -> None:
        self._links = links
        self._due_s = dict.fromkeys(links, 0.0)
        self._report_s = 0.0
        self.ground: Ground | None = None
        if parameters.waits("TERRAIN_ENABLE"):
            parameters.define("TERRAIN_ENABLE", 1)
            parameters.define("TERRAIN_SPACING", 100)
            if parameters["TERRAIN_ENABLE"] >= 1:
                self.ground = Ground(int(parameters["TERRAIN_SPACING"]))

    def rise_m(self, lat_e7: int, lon_e7: int, home: Location) -> float:
        """How much higher the ground is at a place than at home; 0: not known."""
        if self.ground is None:
            return 0.0
        there, here = self.ground.height_m(lat_e7, lon_e7), self.ground.height_m(home.lat_e7, home.lon_e7)
        return 0.0 if there is None or here is None else there - here

    def handle(self, message: Any) -> bool:
        """Take in a message; False: it is about something else."""
        if self.ground is None or message.get_type() != "TERRAIN_DATA":
            return False
        self.ground.take(message)
        return True

    def update(self, here: Location, home: Location | None, items: list[Any], now_s: float) -> None:
        """Look for what is wanted, once a second, and ask. `items`: of the mission."""
        ground = self.ground
        if ground is None:
            return
        if now_s >= self._report_s:
            self._report_s = now_s + _REPORT_S
            self._want(ground, here, home, items)
            self._report(ground, here)
        for channel, link in self._links.items():
            asked = next(ground.missing(), None)
            if asked is not None and link.connected and now_s >= self._due_s[channel]:
                self._due_s[channel] = now_s + _EVERY_S
                corner, mask = asked
                link.send(dialect.MAVLink_terrain_request_message(*corner, ground.spacing_m, mask))

    def _want(self, ground: Ground, here: Location, home: Location | None, items: list[Any]) -> None:
        for item in items:
            if item.frame == _TERRAIN_FRAME:
                ground.height_m(item.x, item.y)
        if home is not None:
            ground.height_m(home.lat_e7, home.lon_e7)
        away_m = _AROUND * _SIDE * ground.spacing_m
        for north in (-1, 0, 1):
            for east in (-1, 0, 1):
                place = shift(here, north * _BLOCKS_NORTH * away_m, east * _BLOCKS_EAST * away_m)
                ground.height_m(*place)

    def _report(self, ground: Ground, here: Location) -> None:
        height_m = ground.height_m(here.lat_e7, here.lon_e7)
        level_m = 0.0 if height_m is None else here.alt_m - height_m
        fields = (ground.spacing_m if height_m is not None else 0, height_m or 0.0, level_m)
        report = dialect.MAVLink_terrain_report_message(
            here.lat_e7, here.lon_e7, *fields, ground.pending, ground.loaded
        )
        for link in self._links.values():
            if link.connected:
                link.send(report)

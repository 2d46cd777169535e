# SPDX-License-Identifier: GPL-3.0-or-later

"""Map tiles from this computer's disk: an MBTiles file, or a folder with z/x/y.png. Nothing is fetched from a network.

Rules that live here
--------------------
* A tile is asked for by three whole numbers, never by a name. A link that leads out of the folder is not followed.
* A query of an MBTiles file ends after a time: a view in it may compute without an end.
* A tile is at most MOST_BYTES long, and it is a picture by its first bytes: PNG, JPEG or WebP. Anything else counts as
  missing.
* What cannot be used at all is refused at the start, with one line that says what is allowed.
"""

from __future__ import annotations

import html
import re
import sqlite3
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

__all__ = ["MOST_BYTES", "Tile", "TileSource", "TilesError", "open_tiles", "place_of"]

MOST_BYTES: Final = 1 << 20
_MOST_ZOOM: Final = 24
_CREDIT: Final = 200
#: longest time (s) of the queries when an MBTiles file is opened, and of one tile; SQLite's steps between two looks
_OPEN_S: Final = 5.0
_TILE_S: Final = 0.5
_STEPS: Final = 10_000
_PLACE: Final = re.compile(r"([0-9]{1,2})/([0-9]{1,8})/([0-9]{1,8})")
_ENDINGS: Final = (".png", ".jpg", ".jpeg", ".webp")
_ALLOWED: Final = "allowed are an MBTiles file and a folder with z/x/y.png (or .jpg, .webp)"
#: gdal2tiles lays this beside tiles that are numbered from the south
_FROM_SOUTH: Final = "tilemapresource.xml"


class TilesError(Exception):
    """Tiles that cannot be used. The message is one line."""


@dataclass(frozen=True, slots=True)
class Tile:
    """One picture, and its media type."""

    data: bytes
    kind: str


class TileSource(Protocol):
    """Tiles from a disk. Safe for threads."""

    def drawn(self) -> Mapping[str, Any]:
        """The values for the map in the browser: address, zooms, bounds, credit."""

    def read(self, zoom: int, column: int, row: int) -> Tile | None:
        """One tile, `row` counted from the north; None: there is none."""


def place_of(text: str) -> tuple[int, int, int] | None:
    """Zoom, column and row of "z/x/y"; None: it is no place of a tile."""
    found = _PLACE.fullmatch(text)
    if found is None:
        return None
    zoom, column, row = (int(part) for part in found.groups())
    if zoom > _MOST_ZOOM or column >= 1 << zoom or row >= 1 << zoom:
        return None
    return zoom, column, row


def open_tiles(path: Path, credit: str = "") -> TileSource:
    """The tiles at this path. `credit`: whose they are. Raises TilesError."""
    if path.is_dir():
        return _Folder(path, credit)
    if path.is_file():
        return _MbTiles(path, credit)
    raise TilesError(f"{path}: no such file or folder; {_ALLOWED}")


def _tile(data: bytes) -> Tile | None:
    if len(data) > MOST_BYTES:
        return None
    kind = _kind(data)
    return Tile(data, kind) if kind else None


def _kind(data: bytes) -> str:
    """The media type by the first bytes; "": no picture."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    return "image/webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else ""


def _drawn(low: int, high: int, credit: str, bounds: list[list[float]] | None = None) -> dict[str, Any]:
    """The browser takes the credit for HTML: it becomes plain text here."""
    plain = html.escape(re.sub(r"<[^>]*>", "", credit).strip()[:_CREDIT])
    found = {"url": "/tiles/{z}/{x}/{y}", "credit": plain, "low": low, "high": high}
    return found if bounds is None else {**found, "bounds": bounds}


class _Folder:
    """A folder with z/x/y.png. Raises TilesError."""

    def __init__(self, path: Path, credit: str) -> None:
        self._root = path.resolve()
        self._from_south = (self._root / _FROM_SOUTH).is_file()
        zooms = _numbered(self._root)
        if not zooms:
            inside = next((each for each in sorted(self._root.iterdir()) if each.is_dir() and _numbered(each)), None)
            meant = "" if inside is None else f". Did you mean {path / inside.name}?"
            raise TilesError(f"{path}: has no folders 0, 1, 2 ... for the zooms; {_ALLOWED}{meant}")
        self._ending = next((ending for zoom in zooms if (ending := _ending(self._root / str(zoom)))), "")
        if not self._ending:
            raise TilesError(f"{path}: has no pictures in {zooms[0]}/x/; {_ALLOWED}")
        self._values = _drawn(zooms[0], zooms[-1], credit)

    def drawn(self) -> Mapping[str, Any]:
        """As TileSource."""
        return self._values

    def read(self, zoom: int, column: int, row: int) -> Tile | None:
        """As TileSource."""
        number = (1 << zoom) - 1 - row if self._from_south else row
        path = self._root / str(zoom) / str(column) / f"{number}{self._ending}"
        with suppress(OSError, RuntimeError):
            found = path.resolve(strict=True)
            if found.is_relative_to(self._root) and found.is_file():
                with found.open("rb") as stream:
                    return _tile(stream.read(MOST_BYTES + 1))
        return None


def _numbered(folder: Path) -> list[int]:
    """The numbers of the zooms that have a folder, in order."""
    names = [each.name for each in folder.iterdir() if each.name.isascii() and each.name.isdecimal() and each.is_dir()]
    return sorted(int(name) for name in names if name == str(int(name)) and int(name) <= _MOST_ZOOM)


def _ending(zoom: Path) -> str:
    """The ending of the first picture of a zoom; "": there is none."""
    for column in zoom.iterdir():
        if column.is_dir():
            for each in column.iterdir():
                if each.suffix in _ENDINGS:
                    return each.suffix
    return ""


class _MbTiles:
    """An MBTiles file: a SQLite database, which is only read. Raises TilesError."""

    def __init__(self, path: Path, credit: str) -> None:
        self._lock = threading.Lock()
        try:
            self._opened = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False)
            self._opened.set_progress_handler(self._is_over, _STEPS)
            self._ends_within(_OPEN_S)
            known = dict(self._opened.execute("SELECT name, value FROM metadata LIMIT 1000").fetchall())
            zooms = self._opened.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
            first = self._opened.execute("SELECT substr(tile_data, 1, 16) FROM tiles LIMIT 1").fetchone()
        except sqlite3.Error as error:
            raise TilesError(f"{path}: is no MBTiles file ({error}); {_ALLOWED}") from None
        if first is None:
            raise TilesError(f"{path}: has no tiles")
        if not isinstance(first[0], bytes) or not _kind(first[0]):
            named = f" It says format {known['format']}." if "format" in known else ""
            raise TilesError(
                f"{path}: its tiles are no pictures (png, jpg, webp).{named} Vector tiles cannot be shown."
            )
        low, high = (each if isinstance(each, int) and 0 <= each <= _MOST_ZOOM else -1 for each in zooms)
        if min(low, high) < 0:
            raise TilesError(f"{path}: zooms {zooms[0]} to {zooms[1]}: must be 0 to {_MOST_ZOOM}")
        self._values = _drawn(low, high, credit or str(known.get("attribution", "")), _bounds(known.get("bounds")))

    def _ends_within(self, seconds: float) -> None:
        """The queries from now on take no longer together."""
        self._until = time.monotonic() + seconds

    def _is_over(self) -> bool:
        return time.monotonic() > self._until

    def drawn(self) -> Mapping[str, Any]:
        """As TileSource."""
        return self._values

    def read(self, zoom: int, column: int, row: int) -> Tile | None:
        """As TileSource. The file counts rows from the south."""
        wanted = (MOST_BYTES, zoom, column, (1 << zoom) - 1 - row)
        text = (
            "SELECT CASE WHEN length(tile_data) <= ? THEN tile_data END FROM tiles "
            "WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        )
        with self._lock, suppress(sqlite3.Error):
            self._ends_within(_TILE_S)
            found = self._opened.execute(text, wanted).fetchone()
            if found is not None and isinstance(found[0], bytes):
                return _tile(found[0])
        return None


def _bounds(text: Any) -> list[list[float]] | None:
    """South-west and north-east corner from "west,south,east,north"; None: not said, or no bounds."""
    try:
        west, south, east, north = (float(part) for part in str(text).split(","))
    except ValueError:
        return None
    fits = -180.0 <= west < east <= 180.0 and -90.0 <= south < north <= 90.0
    return [[south, west], [north, east]] if fits else None

# SPDX-License-Identifier: GPL-3.0-or-later

"""Follows a journal while it is written, by a program that may be killed, started again, or roll the file over.

Rules that live here
--------------------
* A line counts when its end is there. One that is no entry is counted; one beyond MAX_LINE is thrown away as it comes.
* When another file stands under the name, what is left of the old one is read first, and then the new one from its
  beginning. A file that has become shorter begins anew.
* Of what was there before, the last HISTORY_BYTES are read.
* A file that is not there, or cannot be read, is tried again at each call. Nothing raises.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final

__all__ = ["HISTORY_BYTES", "MAX_LINE", "Entry", "Tail", "parse"]

#: some hours of one aircraft
HISTORY_BYTES: Final = 8 * 1024 * 1024
#: bytes; the longest entry that the project writes is a report of a rehearsal, a few thousand
MAX_LINE: Final = 256 * 1024
_SLICE: Final = 64 * 1024


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry. `utc`: seconds since 1970 by the clock of who wrote it, None: it does not say; `fields`: the rest."""

    utc: float | None
    who: str
    event: str
    text: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict)

    def word(self, key: str) -> str | None:
        """A value that is a text; None if there is none, or it is none."""
        value = self.fields.get(key)
        return value if isinstance(value, str) else None

    def number(self, key: str) -> float | None:
        """A value that is a finite number; None if there is none, or it is none."""
        value = self.fields.get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            return None
        return float(value)


def parse(line: bytes) -> Entry | None:
    """The entry in a line, None when there is none in it."""
    try:
        values = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(values, dict):
        return None
    who, event, text = values.pop("who", None), values.pop("event", None), values.pop("text", "")
    if not isinstance(who, str) or not isinstance(event, str) or not isinstance(text, str):
        return None
    return Entry(_seconds(values.pop("utc", None)), who, event, text, values)


def _seconds(utc: object) -> float | None:
    try:
        return datetime.fromisoformat(utc).timestamp() if isinstance(utc, str) else None
    except (ValueError, OverflowError):
        return None


class Tail:
    """One growing file. Not safe for threads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        #: lines that were no entries
        self.broken = 0
        self._file: int | None = None
        #: device and number of the file that `_offset` is in
        self._whose: tuple[int, int] | None = None
        self._offset = 0
        self._rest = b""
        #: the line that is coming is thrown away: too long, or its beginning was never read
        self._skips = False

    def read(self, most: int) -> tuple[list[Entry], int]:
        """The entries that are new, of about `most` bytes; and how many bytes were read, 0: there are no more now."""
        found: list[Entry] = []
        taken = 0
        try:
            while taken < most:
                data = self._next(min(_SLICE, most - taken))
                if not data:
                    break
                taken += len(data)
                self._split(data, found)
        except (OSError, ValueError):  # a path may be none
            self.close()
        return found, taken

    def close(self) -> None:
        """Leave the file. What is read next begins where it was left, if it is still the same file."""
        if self._file is not None:
            descriptor, self._file = self._file, None
            with suppress(OSError):
                os.close(descriptor)

    def _next(self, most: int) -> bytes:
        """Raises OSError."""
        if self._file is None:
            self._open()
        assert self._file is not None
        size = os.fstat(self._file).st_size
        if size < self._offset:
            self._begin(0)
        data = os.pread(self._file, most, self._offset)
        if not data and self._replaced():
            self.close()
            self._open()
            data = os.pread(self._file, most, self._offset)
        self._offset += len(data)
        return data

    def _open(self) -> None:
        self._file = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        there = os.fstat(self._file)
        if self._whose is None:
            beginning = max(0, there.st_size - HISTORY_BYTES)
            self._begin(beginning)
            self._skips = beginning > 0
        elif self._whose != (there.st_dev, there.st_ino):
            self._begin(0)
        self._whose = there.st_dev, there.st_ino

    def _begin(self, offset: int) -> None:
        self._offset, self._rest, self._skips = offset, b"", False

    def _replaced(self) -> bool:
        """Whether another file stands under the name; while none does, the old one may still grow."""
        try:
            there = os.stat(self.path)
        except FileNotFoundError:
            return False
        return (there.st_dev, there.st_ino) != self._whose

    def _split(self, data: bytes, found: list[Entry]) -> None:
        *lines, rest = data.split(b"\n")
        for line in lines:
            whole, self._rest = self._rest + line, b""
            if self._skips:
                self._skips = False
                continue
            entry = parse(whole)
            if entry is not None:
                found.append(entry)
            elif whole.strip():
                self.broken += 1
        self._rest = b"" if self._skips else self._rest + rest
        if len(self._rest) > MAX_LINE:
            self._rest, self._skips = b"", True
            self.broken += 1

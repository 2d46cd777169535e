# SPDX-License-Identifier: GPL-3.0-or-later

"""Follows a journal while a program writes it.

The program may be killed or restarted, and it may replace the file.

Rules that live here
--------------------
* A line counts when its end has been written. A line that is no entry is counted; a line longer than MAX_LINE is
  dropped.
* If another file has the name now, the rest of the old one is read first, then the new one from its beginning. A file
  that has become shorter is read from its beginning.
* Of the contents before the start, the last HISTORY_BYTES are read.
* A file that does not exist, or cannot be read, is tried again at each call. Nothing raises.
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

from mavproxy_handover.store.portable import CLOSED_ON_EXEC, NEVER_WAIT

__all__ = ["HISTORY_BYTES", "MAX_LINE", "Entry", "Tail", "parse"]

#: bytes: some hours of one aircraft
HISTORY_BYTES: Final = 8 * 1024 * 1024
#: bytes; the longest entry that the project writes is a report of a rehearsal, a few thousand
MAX_LINE: Final = 256 * 1024
_SLICE: Final = 64 * 1024


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry. `utc`: seconds since 1970 by the writer's clock, None: it has none; `fields`: the rest."""

    utc: float | None
    who: str
    event: str
    text: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict)

    def word(self, key: str) -> str | None:
        """A value that is a text; None if there is no such text."""
        value = self.fields.get(key)
        return value if isinstance(value, str) else None

    def number(self, key: str) -> float | None:
        """A value that is a finite number; None if there is no such number."""
        value = self.fields.get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            return None
        return float(value)


def parse(line: bytes) -> Entry | None:
    """The entry in a line, None if there is none."""
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
        #: lines that are no entries
        self.broken = 0
        self._file: int | None = None
        #: device and inode number of the file that `_offset` is in
        self._whose: tuple[int, int] | None = None
        self._offset = 0
        self._rest = b""
        #: the next line is dropped: too long, or its beginning was not read
        self._skips = False

    def read(self, most: int) -> tuple[list[Entry], int]:
        """The new entries, of about `most` bytes, and the number of bytes read.

        0 bytes: there are no more now.
        """
        found: list[Entry] = []
        taken = 0
        try:
            while taken < most:
                data = self._next(min(_SLICE, most - taken))
                if not data:
                    break
                taken += len(data)
                self._split(data, found)
        except (OSError, ValueError):  # a path may be invalid
            self.close()
        return found, taken

    def close(self) -> None:
        """Close the file. The next read continues there if it is still the same file."""
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
        self._file = os.open(self.path, os.O_RDONLY | CLOSED_ON_EXEC | NEVER_WAIT)
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
        """Whether another file has the name. While none has, the old one may still grow."""
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

# SPDX-License-Identifier: GPL-3.0-or-later

"""The journal: JSON lines, one object an entry, for people and programs after the flight.

Every entry carries `t` (monotonic seconds: differences are true even when the clock is set), `utc`, `who` and `event`;
`text` is the sentence for people. The file is size-capped: when full it moves to `NAME.1` and a new one begins, so the
newest events are always there. Writing never raises: a full disk must not end a flight; what is lost is counted, and
when there is room again the journal goes on. An entry that was cut (full disk, power failure) stays a line by itself.

`note` is for what comes often and changes nothing: a single entry costs as much as several that are written together,
when little else runs on the processor. Its entries have their own time and place, and are in the file a moment later.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

__all__ = ["Journal"]

_MAX_BYTES = 64 * 1024 * 1024
#: so many entries are not left waiting for `flush`
_MOST_WAITING = 256

#: made once: to make an encoder takes as long as to use it
_encode = json.JSONEncoder(ensure_ascii=False, default=str).encode


class Journal:
    """An append-only event log."""

    def __init__(self, path: Path, who: str, max_bytes: int = _MAX_BYTES) -> None:
        """Open `path` for appending. Raises OSError if that cannot be done: better before the flight than in it."""
        self.path = path
        self.lost = 0
        self._who = who
        self._max_bytes = max_bytes
        self._descriptor: int | None = None
        self._closed = False
        #: the file ends in the middle of a line
        self._cut = False
        #: entries that are not in the file yet: both times, event, text, values
        self._waiting: list[tuple[float, float, str, str, dict[str, Any]]] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        self._open()

    def write(self, event: str, text: str = "", **values: Any) -> None:
        """Add an entry, and those that wait. Values that are None are left out."""
        self.note(event, text, **values)
        self.flush()

    def note(self, event: str, text: str = "", **values: Any) -> None:
        """The same, but in the file with the next `write` or `flush`, whichever comes first."""
        self._waiting.append((time.monotonic(), time.time(), event, text, values))
        if len(self._waiting) >= _MOST_WAITING:
            self.flush()

    def flush(self) -> None:
        """Write what waits; to be called a few times a second."""
        waiting, self._waiting = self._waiting, []
        for at, utc, event, text, values in waiting:
            entry: dict[str, Any] = {"t": round(at, 4), "utc": "", "who": self._who, "event": event}
            if text:
                entry["text"] = text
            entry.update((key, value) for key, value in values.items() if value is not None)
            try:
                entry["utc"] = datetime.fromtimestamp(utc, timezone.utc).isoformat(timespec="milliseconds")
                line = _encode(entry) + "\n"
                self._put(line.encode("utf-8", "backslashreplace"))
            except (OSError, OverflowError, TypeError, ValueError):
                self.lost += 1

    def _open(self) -> int:
        if self._descriptor is None:
            flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
            self._descriptor = os.open(self.path, flags, 0o644)
            size = os.fstat(self._descriptor).st_size
            self._cut = size > 0 and os.pread(self._descriptor, 1, size - 1) != b"\n"
        return self._descriptor

    def _put(self, line: bytes) -> None:
        if self._closed:
            raise OSError("closed")
        descriptor = self._open()
        size = os.fstat(descriptor).st_size
        if size > 0 and size + len(line) > self._max_bytes:
            self._release()
            with suppress(OSError):  # too long a journal is better than none
                os.replace(self.path, self.path.with_name(self.path.name + ".1"))
            descriptor = self._open()
        data = b"\n" + line if self._cut else line
        written = os.write(descriptor, data)
        if written:
            self._cut = data[written - 1] != ord("\n")
        if written != len(data):
            raise OSError("no room for the whole line")

    def _release(self) -> None:
        if self._descriptor is not None:
            descriptor, self._descriptor = self._descriptor, None
            with suppress(OSError):
                os.close(descriptor)

    def close(self) -> None:
        """Close the file; entries after this are lost and counted."""
        self.flush()
        self._closed = True
        self._release()

# SPDX-License-Identifier: GPL-3.0-or-later

"""The journal: JSON lines, one object an entry, for people and programs after the flight.

Every entry carries `t` (monotonic seconds: differences are true even when the clock is set), `utc`, `who` and `event`;
`text` is the sentence for people. The file is size-capped: when full it moves to `NAME.1` and a new one begins, so the
newest events are always there. Writing never raises: a full disk must not end a flight; what is lost is counted.
"""

from __future__ import annotations

import json
import os
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TextIO

__all__ = ["Journal"]

_MAX_BYTES = 64 * 1024 * 1024


class Journal:
    """An append-only event log."""

    def __init__(self, path: Path, who: str, max_bytes: int = _MAX_BYTES) -> None:
        """Open `path` for appending. Raises OSError if that cannot be done: better before the flight than in it."""
        self.path = path
        self.lost = 0
        self._who = who
        self._max_bytes = max_bytes
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file: TextIO | None = path.open("a", encoding="utf-8", buffering=1)

    def write(self, event: str, text: str = "", **values: Any) -> None:
        """Add an entry. Values that are None are left out."""
        entry: dict[str, Any] = {
            "t": round(time.monotonic(), 4),
            "utc": datetime.now(timezone.utc).isoformat(timespec="milliseconds"),
            "who": self._who,
            "event": event,
        }
        if text:
            entry["text"] = text
        entry.update((key, value) for key, value in values.items() if value is not None)
        try:
            if self._file is None:
                raise OSError("closed")
            self._file.write(json.dumps(entry, ensure_ascii=False, default=str) + "\n")
            if self._file.tell() > self._max_bytes:
                self._roll()
        except (OSError, ValueError):
            self.lost += 1

    def _roll(self) -> None:
        assert self._file is not None
        self._file.close()
        self._file = None
        os.replace(self.path, self.path.with_name(self.path.name + ".1"))
        self._file = self.path.open("a", encoding="utf-8", buffering=1)

    def close(self) -> None:
        """Close the file; entries after this are lost and counted."""
        if self._file is not None:
            self._file.close()
            self._file = None

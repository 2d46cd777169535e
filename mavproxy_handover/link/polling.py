# SPDX-License-Identifier: GPL-3.0-or-later

"""`select.poll`, also for a station on Windows, where Python has none."""

from __future__ import annotations

import select
from contextlib import suppress
from typing import Any, Final

__all__ = ["Poll", "poll"]


class Poll:
    """`select.poll` by `select.select`, for sockets on Windows. It reports what was asked for, and errors as such."""

    READ: Final[int] = getattr(select, "POLLIN", 1)
    WRITE: Final[int] = getattr(select, "POLLOUT", 4)
    ERROR: Final[int] = getattr(select, "POLLERR", 8)

    def __init__(self) -> None:
        self._events: dict[int, int] = {}

    def register(self, file: Any, events: int) -> None:
        """Watch a socket, or its descriptor."""
        self._events[file if isinstance(file, int) else file.fileno()] = events

    def unregister(self, file: Any) -> None:
        """Watch it no more. Raises KeyError."""
        del self._events[file if isinstance(file, int) else file.fileno()]

    def poll(self, milliseconds: float) -> list[tuple[int, int]]:
        """(descriptor, events) of the ready ones."""
        if not self._events:
            return []
        found: dict[int, int] = {}
        seconds = max(0.0, milliseconds) / 1000.0
        with suppress(OSError, ValueError):  # one of them is closed: its owner finds out by reading
            ready = select.select(self._asked(self.READ), self._asked(self.WRITE), list(self._events), seconds)
            for event, descriptors in zip((self.READ, self.WRITE, self.ERROR), ready, strict=True):
                for each in descriptors:
                    found[each] = found.get(each, 0) | event
        return list(found.items())

    def _asked(self, event: int) -> list[int]:
        return [each for each, events in self._events.items() if events & event]


def poll() -> Any:
    """A new `select.poll`, or its stand-in."""
    return select.poll() if hasattr(select, "poll") else Poll()

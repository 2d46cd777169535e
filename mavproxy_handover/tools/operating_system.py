# SPDX-License-Identifier: GPL-3.0-or-later

"""What differs between Linux, macOS and Windows on the path of a station: flags of files, users, locks, `poll`.

A station runs on all three. Python has no `fcntl`, `select.poll` and numbers of users on Windows, so nothing else on
that path names them. Rights of a file are in access lists there. Python does not read them, so they are not judged.
"""

from __future__ import annotations

import os
import select
import sys
from contextlib import suppress
from typing import Any, Final

__all__ = ["CLOSED_ON_EXEC", "NEVER_WAIT", "NO_LINK", "Poll", "lock", "poll", "restrict", "user"]

#: flags of `os.open`: a child does not inherit it, bytes are not translated
CLOSED_ON_EXEC: Final[int] = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOINHERIT", 0) | getattr(os, "O_BINARY", 0)
#: do not wait for the other end of a pipe; refuse a symbolic link
NEVER_WAIT: Final[int] = getattr(os, "O_NONBLOCK", 0)
NO_LINK: Final[int] = getattr(os, "O_NOFOLLOW", 0)


def user() -> int | None:
    """The user that runs this process; None: this system has no numbers for users."""
    return os.geteuid() if hasattr(os, "geteuid") else None


def restrict(descriptor: int, mode: int) -> None:
    """Set the mode of an open file, if this system has modes. Raises OSError."""
    if hasattr(os, "fchmod") and sys.platform != "win32":
        os.fchmod(descriptor, mode)


def lock(descriptor: int, *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; returns False if another process has locked it.

    `wait`: until it is free. Raises OSError for a file that cannot be locked.
    """
    try:
        import fcntl
    except ImportError:
        return _lock_bytes(descriptor, wait=wait)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True


def _lock_bytes(descriptor: int, *, wait: bool) -> bool:
    """On Windows: lock the first byte."""
    import msvcrt

    windows: Any = msvcrt
    os.lseek(descriptor, 0, os.SEEK_SET)
    try:
        windows.locking(descriptor, windows.LK_LOCK if wait else windows.LK_NBLCK, 1)
    except OSError:
        return False
    return True


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

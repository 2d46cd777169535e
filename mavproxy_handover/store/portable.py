# SPDX-License-Identifier: GPL-3.0-or-later

"""Flags, rights and locks of files on Linux, macOS and Windows.

A station runs on all three. Python has no `fcntl` and no numbers of users on Windows, so nothing else on a station's
path names them. Rights of a file are in access lists there. Python does not read them, so they are not judged.
"""

from __future__ import annotations

import os
import sys
from typing import Any, Final

__all__ = ["CLOSED_ON_EXEC", "NEVER_WAIT", "NO_LINK", "lock", "restrict", "user"]

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

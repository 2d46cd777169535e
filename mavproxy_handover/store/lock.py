# SPDX-License-Identifier: GPL-3.0-or-later

"""One judge for a vehicle: who holds its lock is the only one, on this computer.

The lock is the kernel's and belongs to an open file: it is free as soon as its holder is dead, however that died, and
nothing has to be cleaned up. The file stays, and says nothing. It needs no room on the disk but for its name, and once
it is there none at all: a restart in flight must not end for a full or a failing disk.

A serial line has a lock of the same kind, which other programs heed too (pyserial's `exclusive`, tio, minicom).
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

__all__ = ["LockError", "VehicleLock", "lock_line"]


class LockError(Exception):
    """Somebody else holds it; one line for people."""


class VehicleLock:
    """Held from the moment that it is made."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        """`folder`: where the vehicle's state is kept. Raises LockError, OSError."""
        path = folder / f"{vehicle}.lock"
        folder.mkdir(parents=True, exist_ok=True)
        self.descriptor = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            if not _lock(self.descriptor):
                raise LockError(f"{path} is locked: another companion of {vehicle} is running")
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Give it back. Safe to call twice."""
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)


def lock_line(descriptor: int, device: str) -> None:
    """Lock a serial line for as long as it is open. Raises LockError. What knows no locks is left as it is."""
    try:
        free = _lock(descriptor)
    except OSError:
        return
    if not free:
        raise LockError(f"{device} is locked: another program uses this line, maybe another companion")


def _lock(descriptor: int) -> bool:
    """False: it is somebody else's. Raises OSError."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True

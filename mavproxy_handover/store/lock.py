# SPDX-License-Identifier: GPL-3.0-or-later

"""One judge for a vehicle: the process that holds its lock is the only one, on this computer.

The lock is the kernel's and belongs to an open file: it is free as soon as its holder is dead, however that died, and
nothing has to be cleaned up. The file stays, and says nothing. It needs no room on the disk but for its name, and once
it is there none at all: a restart in flight must not end for a full or a failing disk.

There are two lock files: one beside the state, one in memory-backed storage. On the ground both must be taken. A
restart in flight may do without the one beside the state, if that folder is gone: the one in memory still keeps a
second judge away.

A serial line has a lock of the same kind, which other programs heed too (pyserial's `exclusive`, tio, minicom).
"""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path

from mavproxy_handover.store.memory import memory_folder, memory_name

__all__ = ["LockError", "VehicleLock", "lock_line"]


class LockError(Exception):
    """Somebody else holds it; one line for people."""


class VehicleLock:
    """Held from the moment that it is made."""

    def __init__(self, folder: Path, vehicle: str, *, strict: bool = True) -> None:
        """`folder`: where the vehicle's state is kept. `strict` False: a folder that cannot be used is done without, if
        there is storage in memory. Raises LockError, OSError."""
        path = folder / f"{vehicle}.lock"
        place = memory_folder(os.environ)
        #: of the files that are locked
        self.descriptors: list[int] = []
        try:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                self._take(path, path, vehicle)
            except OSError:
                if strict or place is None:
                    raise
            if place is not None:
                self._take(place / f"{memory_name(folder, vehicle)}.lock", path, vehicle)
        except BaseException:
            self.release()
            raise

    def _take(self, path: Path, named: Path, vehicle: str) -> None:
        """Lock `path`; an error names `named`."""
        descriptor = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        self.descriptors.append(descriptor)
        with suppress(OSError):  # a file of an earlier version, which other users could hold; a read-only disk
            if os.fstat(descriptor).st_uid == os.geteuid():
                os.fchmod(descriptor, 0o600)
        if not _lock(descriptor):
            raise LockError(f"{named} is locked: another companion of {vehicle} is running")

    def release(self) -> None:
        """Give it back. Safe to call twice."""
        while self.descriptors:
            os.close(self.descriptors.pop())


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

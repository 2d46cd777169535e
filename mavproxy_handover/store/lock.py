# SPDX-License-Identifier: GPL-3.0-or-later

"""The lock of a vehicle. On this computer only the process that holds it may judge authority.

The kernel's lock belongs to an open file. It is free as soon as its holder is dead, for whatever reason, and needs no
cleaning up. The file stays and has no content. Once its name exists it needs no room on the disk, because a full or
failing disk must not end a restart in flight.

There are two lock files: one beside the state, one in memory-backed storage. On the ground both must be locked. A
restart in flight may go on without the one beside the state, if that folder is gone. The one in memory still keeps out
a second judge.

A serial line has a lock of the same kind, which other programs respect too (pyserial's `exclusive`, tio, minicom).
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mavproxy_handover.store.memory import memory_folder, memory_name
from mavproxy_handover.store.portable import CLOSED_ON_EXEC, NO_LINK, lock, restrict, user

__all__ = ["LockError", "VehicleLock", "lock_line"]


class LockError(Exception):
    """Another process holds the lock. The message is one line for people."""


class VehicleLock:
    """The lock, taken when the object is made."""

    def __init__(self, folder: Path, vehicle: str, *, strict: bool = True) -> None:
        """Take the lock. Raises LockError, OSError.

        `folder`: folder of the vehicle's state. `strict` False: an unusable folder is no error if there is storage in
        memory.
        """
        path = folder / f"{vehicle}.lock"
        place = memory_folder(os.environ)
        #: of the locked files
        self.descriptors: list[int] = []
        try:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                self._acquire(path, path, vehicle)
            except OSError:
                if strict or place is None:
                    raise
            if place is not None:
                self._acquire(place / f"{memory_name(folder, vehicle)}.lock", path, vehicle)
        except BaseException:
            self.release()
            raise

    def _acquire(self, path: Path, named: Path, vehicle: str) -> None:
        """Lock `path`; an error names `named`."""
        descriptor = os.open(path, os.O_RDONLY | os.O_CREAT | CLOSED_ON_EXEC | NO_LINK, 0o600)
        self.descriptors.append(descriptor)
        # the file is of an earlier version, which other users could lock; or the disk is read-only
        with suppress(OSError):
            if os.fstat(descriptor).st_uid == user():
                restrict(descriptor, 0o600)
        if not lock(descriptor):
            raise LockError(f"{named} is locked: another companion of {vehicle} is running")

    def release(self) -> None:
        """Release the lock. Safe to call twice."""
        while self.descriptors:
            os.close(self.descriptors.pop())


def lock_line(descriptor: int, device: str) -> None:
    """Lock a serial line while it is open. Raises LockError. A device without locks is not locked."""
    try:
        free = lock(descriptor)
    except OSError:
        return
    if not free:
        raise LockError(f"{device} is locked: another program uses this line, maybe another companion")

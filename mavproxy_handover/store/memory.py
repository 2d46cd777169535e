# SPDX-License-Identifier: GPL-3.0-or-later

"""A small record in memory-backed storage. It outlives the process, and a write does not wait for a disk.

Rules that live here
--------------------
* There are two slots of fixed size, written in turn and in place. Their room is reserved when the file is made. So a
  storage that fills up later cannot make a write fail, and an interrupted write leaves the other slot.
* Each slot has a serial that rises, a length and a checksum. Of the valid slots the one with the higher serial counts.
* If a record cannot be written, the file is marked void, because its content is no longer true (`Condition.VOID`).
* Only this user can access the folder (mode 0700). Links are not followed, because every user can write to /dev/shm.
"""

from __future__ import annotations

import enum
import hashlib
import os
import stat
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

__all__ = ["SLOT_BYTES", "Condition", "Slots", "boot_id", "memory_folder", "memory_name", "passed_over"]

#: more than the state of any flight needs, even with the longest route
SLOT_BYTES: Final = 64 * 1024
#: kind of slot, serial, length and checksum of the record that follows
_HEAD: Final = struct.Struct("<8sQI32s")
_HELD: Final = b"HNDOheld"
_VOID: Final = b"HNDOvoid"
_FOLDER: Final = "mavproxy-handover"
#: file systems in memory
_IN_MEMORY: Final = ("tmpfs", "ramfs")
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
_MOUNTS: Final = Path("/proc/self/mountinfo")


class Condition(enum.Enum):
    """Condition of the record in the file."""

    #: no record was ever written
    EMPTY = "empty"
    #: a valid record
    HELD = "held"
    #: marked void: the last record could not be written
    VOID = "void"
    #: there is content, but no valid record
    DAMAGED = "damaged"


class Slots:
    """A file of two slots. Not safe for threads."""

    def __init__(self, path: Path) -> None:
        """Open or make the file. Raises OSError if that fails, or if the file is not private to this user."""
        self.path = path
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        self._descriptor = os.open(path, flags, 0o600)
        try:
            found = os.fstat(self._descriptor)
            if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid() or found.st_nlink != 1:
                raise PermissionError(f"{path}: it is not a file of this user's own")
            os.fchmod(self._descriptor, 0o600)
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(self._descriptor, 0, 2 * SLOT_BYTES)
            #: condition, and of a valid record its serial (else 0) and content
            self.condition, self.serial, self.record = self._read()
        except BaseException:
            os.close(self._descriptor)
            raise

    def write(self, record: bytes, serial: int) -> None:
        """Write a record with a higher serial than the last one. Raises OSError; then call `void`."""
        if len(record) > SLOT_BYTES - _HEAD.size:
            raise OSError(f"the record has {len(record)} bytes, more than a slot holds")
        body = _HEAD.pack(_HELD, serial, len(record), _checksum(serial, record)) + record
        self._put(serial % 2, body)
        self.condition, self.serial, self.record = Condition.HELD, serial, record

    def void(self) -> None:
        """Mark the file as no longer true. Raises OSError; then remove the file."""
        self.condition, self.record = Condition.VOID, b""
        for slot in (0, 1):
            self._put(slot, _HEAD.pack(_VOID, 0, 0, bytes(32)))

    def close(self) -> None:
        """Close the file."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _put(self, slot: int, data: bytes) -> None:
        if os.pwrite(self._descriptor, data, slot * SLOT_BYTES) != len(data):
            raise OSError("a record was cut")

    def _read(self) -> tuple[Condition, int, bytes]:
        slots = [self._read_slot(slot) for slot in (0, 1)]
        found = [condition for condition, _serial, _record in slots]
        for condition in (Condition.HELD, Condition.VOID, Condition.DAMAGED):
            if condition in found:
                return max((slot for slot in slots if slot[0] is condition), key=lambda slot: slot[1])
        return Condition.EMPTY, 0, b""

    def _read_slot(self, slot: int) -> tuple[Condition, int, bytes]:
        whole = os.pread(self._descriptor, SLOT_BYTES, slot * SLOT_BYTES).ljust(SLOT_BYTES, b"\0")
        kind, serial, length, checksum = _HEAD.unpack_from(whole)
        record = whole[_HEAD.size : _HEAD.size + length]
        if kind == _HELD and serial % 2 == slot and checksum == _checksum(serial, record):
            return Condition.HELD, serial, record
        if kind == _VOID:
            return Condition.VOID, 0, b""
        return Condition.DAMAGED if any(whole[: _HEAD.size]) else Condition.EMPTY, 0, b""


def _checksum(serial: int, record: bytes) -> bytes:
    return hashlib.sha256(struct.pack("<Q", serial) + record).digest()


def boot_id() -> str:
    """Identifier of this boot of the system; "" if the system does not tell."""
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def memory_folder(environment: Mapping[str, str]) -> Path | None:
    """The private folder in memory-backed storage, made if needed; None if there is none that only this user can
    access.
    """
    return next((folder for folder in _folders(environment) if _own(folder)), None)


def passed_over(environment: Mapping[str, str]) -> str:
    """Why an existing folder of our name is not used, and what to do; "" if there is none.

    Any user may make a folder in /dev/shm before we do, and could then read and change our files.
    """
    for folder in _folders(environment):
        if _own(folder):
            return ""
        try:
            found = folder.lstat()
        except OSError:  # it does not exist and cannot be made: the next candidate is used
            continue
        cure = f"Remove it (sudo rm -r {folder}) and start again"
        if found.st_uid != os.geteuid():
            return f"{folder} belongs to user {found.st_uid}, not to user {os.geteuid()}, and is not used. {cure}"
        if not stat.S_ISDIR(found.st_mode):
            return f"{folder} is no folder, and is not used. {cure}"
        mode = stat.S_IMODE(found.st_mode)
        return f"{folder} has mode {mode:04o}, which lets other users in, and is not used. {cure}"
    return ""


def _folders(environment: Mapping[str, str]) -> Iterator[Path]:
    """Candidates for the folder, the best first."""
    named = environment.get("RUNTIME_DIRECTORY", "").split(":")[0]
    for base in (named, "/run", "/dev/shm"):
        if base and in_memory(Path(base)):
            yield Path(base) / f"{_FOLDER}-{os.geteuid()}"


def memory_name(folder: Path, vehicle: str) -> str:
    """Base name of a vehicle's files there. `folder`: folder of its state on the disk."""
    return hashlib.sha256(f"{folder.resolve()}\0{vehicle}".encode()).hexdigest()[:32]


def in_memory(path: Path) -> bool:
    """Whether `path` is in memory-backed storage; False if that is unknown."""
    try:
        device = path.stat().st_dev
        mounts = _MOUNTS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return False
    number = f"{os.major(device)}:{os.minor(device)}"
    for mount in mounts:
        fields = mount.split()
        if len(fields) > 2 and fields[2] == number and "-" in fields[:-1]:
            return fields[fields.index("-") + 1] in _IN_MEMORY
    return False


def _own(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return False
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    return private and found.st_uid == os.geteuid() and os.access(folder, os.W_OK | os.X_OK)

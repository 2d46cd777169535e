# SPDX-License-Identifier: GPL-3.0-or-later

"""A small record in memory-backed storage: it outlives the process, and to write it waits for no disk.

Rules that live here
--------------------
* Two slots of fixed size, written in turn and in place. Their room is taken when the file is made: a storage that fills
  up later cannot fail a write, and a write that ends in the middle leaves the other slot.
* Each slot has a serial that rises, a length and a checksum; of those that fit, the higher serial counts.
* What cannot be written is made void: what the file says is not true any more, and that shows (`Condition.VOID`).
* The folder is this user's alone, mode 0700, and a link is nothing that we follow: /dev/shm is everybody's.
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

#: more than the state of any flight needs, the longest of routes included
SLOT_BYTES: Final = 64 * 1024
#: kind of slot, serial, length and checksum of what follows
_HEAD: Final = struct.Struct("<8sQI32s")
_HELD: Final = b"HNDOheld"
_VOID: Final = b"HNDOvoid"
_FOLDER: Final = "mavproxy-handover"
#: file systems that live in memory
_IN_MEMORY: Final = ("tmpfs", "ramfs")
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
_MOUNTS: Final = Path("/proc/self/mountinfo")


class Condition(enum.Enum):
    """What was found in the file."""

    #: nothing was ever written
    EMPTY = "empty"
    #: a record that counts
    HELD = "held"
    #: made void: what came last could not be written
    VOID = "void"
    #: something was written, and nothing of it fits
    DAMAGED = "damaged"


class Slots:
    """A file of two slots. Not safe for threads."""

    def __init__(self, path: Path) -> None:
        """Open the file, or make it. Raises OSError: it cannot be had, or is not this user's own."""
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
            #: what counts now, if the file is in this condition, and its serial, 0 without one
            self.condition, self.serial, self.record = self._read()
        except BaseException:
            os.close(self._descriptor)
            raise

    def write(self, record: bytes, serial: int) -> None:
        """Put down a record, with a higher serial than the last one. Raises OSError; then `void` is due."""
        if len(record) > SLOT_BYTES - _HEAD.size:
            raise OSError(f"the record has {len(record)} bytes, more than a slot holds")
        body = _HEAD.pack(_HELD, serial, len(record), _checksum(serial, record)) + record
        self._put(serial % 2, body)
        self.condition, self.serial, self.record = Condition.HELD, serial, record

    def void(self) -> None:
        """What the file says is not true any more. Raises OSError; then it should go."""
        self.condition, self.record = Condition.VOID, b""
        for slot in (0, 1):
            self._put(slot, _HEAD.pack(_VOID, 0, 0, bytes(32)))

    def close(self) -> None:
        """Give the descriptor back."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _put(self, slot: int, data: bytes) -> None:
        if os.pwrite(self._descriptor, data, slot * SLOT_BYTES) != len(data):
            raise OSError("a record was cut")

    def _read(self) -> tuple[Condition, int, bytes]:
        slots = [self._look(slot) for slot in (0, 1)]
        found = [condition for condition, _serial, _record in slots]
        for condition in (Condition.HELD, Condition.VOID, Condition.DAMAGED):
            if condition in found:
                return max((slot for slot in slots if slot[0] is condition), key=lambda slot: slot[1])
        return Condition.EMPTY, 0, b""

    def _look(self, slot: int) -> tuple[Condition, int, bytes]:
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
    """What names the time since the power came on; "" where the system does not tell."""
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def memory_folder(environment: Mapping[str, str]) -> Path | None:
    """Our folder in memory-backed storage, made if need be; None if there is none that is ours alone."""
    return next((folder for folder in _folders(environment) if _own(folder)), None)


def passed_over(environment: Mapping[str, str]) -> str:
    """Why a folder of our name is not used, and what to do; "" if none is passed over.

    Any user may make a folder in /dev/shm before we do, and could then read and change what we keep there.
    """
    for folder in _folders(environment):
        if _own(folder):
            return ""
        try:
            found = folder.lstat()
        except OSError:  # it is not there, and may not be made: another place is taken
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
    """Where it could be, the best place first."""
    named = environment.get("RUNTIME_DIRECTORY", "").split(":")[0]
    for base in (named, "/run", "/dev/shm"):
        if base and in_memory(Path(base)):
            yield Path(base) / f"{_FOLDER}-{os.geteuid()}"


def memory_name(folder: Path, vehicle: str) -> str:
    """What the files of a vehicle are called there. `folder`: where its state is kept on the disk."""
    return hashlib.sha256(f"{folder.resolve()}\0{vehicle}".encode()).hexdigest()[:32]


def in_memory(path: Path) -> bool:
    """Whether what is at `path` lives in memory; False if that cannot be found out."""
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

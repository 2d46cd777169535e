# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of files of the autopilot, by path, where the file-transfer opcode alone does not decide.

Rules:

1. A row applies to writes (create, open for writing, remove, make or remove a directory, truncate, rename). A row with
   `reads` applies to every opcode that names a path, and without `writes` only to those that read. The first row that
   fits decides; without one, the opcode decides.
2. A path is compared as the most lenient of ArduPilot's file systems would read it. Case does not matter, `\\` also
   separates, and dots and spaces at the end of a name and repeated separators do not count. `..` is not resolved: a
   path that mentions a guarded folder counts as inside it.
3. WriteFile names a session and no path. A file that may not be opened cannot be written, and files that were opened
   before arming are closed at arming (`flush`).

Source: ArduPilot's AP_Filesystem (backends chosen by prefix), AP_Bootloader (flash from SD card), AP_HAL_ChibiOS,
AP_HAL_Linux and AP_HAL_SITL (`Storage.cpp`: where the storage is kept as a file, and its copies).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final

from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.ids import FTP_CHECKSUM, FTP_CREATE, FTP_OPEN_READ, FTP_OPEN_WRITE, FTP_RENAME

__all__ = ["FILE_RULES", "FileRule", "file_rule", "is_mission_file", "is_upload", "written_lists"]

_WRITES: Final = frozenset({FTP_CREATE, 8, 9, 10, FTP_OPEN_WRITE, 12, FTP_RENAME})
_READS: Final = frozenset({3, FTP_OPEN_READ, FTP_CHECKSUM, 16})
#: The paths in the payload. ArduPilot sets the last byte of the data to zero.
_DATA: Final = slice(12, 250)

_SEPARATORS: Final = re.compile(r"[/\\]+")


@dataclass(frozen=True, slots=True)
class FileRule:
    """A row: patterns of paths (`*`: any characters; a path begins and ends with one `/`), and the reason."""

    access: Access
    name: str  #: for people
    why: str
    patterns: tuple[str, ...]
    reads: bool = False  #: the row also applies to reading
    writes: bool = True


FILE_RULES: Final = (
    FileRule(
        Access.MAINTENANCE,
        "unreadable names",
        "characters that file systems read in more than one way: a long s is an s to them",
        ("*[!\x20-\x7e]*",),
        reads=True,
    ),
    FileRule(
        Access.MAINTENANCE,
        "short names",
        "a file system's second name for a long one",
        ("*~*",),
    ),
    FileRule(
        Access.MAINTENANCE,
        "guard's key",
        "a program that reads it can sign leases",
        ("*handover.key*", "*handov~*.key*"),
        reads=True,
    ),
    FileRule(
        Access.MAINTENANCE,
        "scripts",
        "programs that the autopilot runs, the guard among them",
        ("*/scripts/*", "/apm/"),
    ),
    FileRule(
        Access.MAINTENANCE,
        "firmware",
        "the boot loader flashes it at the next start",
        ("*.abin/*",),
    ),
    FileRule(
        Access.MAINTENANCE,
        "raw memory",
        "holds the autopilot's signing key; at every start a copy of it is put on the SD card",
        (
            "/@sys*storage.bin*",
            "/@sys*flash.bin*",
            "/@sys*crash_dump.bin*",
            "*/strg_bak/*",
            "*.stg/*",
            "*/eeprom*.bin/*",
        ),
        reads=True,
    ),
    FileRule(
        Access.ABSENT,
        "rally points",
        "the autopilot's own list, which holds only the return site: programs then ask for the list by messages",
        ("/@mission*rally*",),
        reads=True,
    ),
    FileRule(
        Access.LOG,
        "flight logs",
        "a download fills the channel that the lease travels on, as by LOG_REQUEST_DATA",
        ("*/logs/*",),
        reads=True,
        writes=False,
    ),
    FileRule(
        Access.SAFEGUARD,
        "parameters",
        "sets any parameter, and names it only after the file is open",
        ("/@param*",),
    ),
    FileRule(
        Access.SAFEGUARD,
        "missions",
        "in flight a mission, fence or rally list is judged before it is written: by the mission protocol",
        ("/@mission*",),
    ),
)

#: Files that the autopilot applies when they are closed.
_MISSION_FILES: Final = "/@mission*"
_FENCE_FILE: Final = "/@mission/fence*"
_UPLOADS: Final = ("/@param*", _MISSION_FILES)


def _read(path: bytes) -> str:
    """A path in the form of the patterns (rule 2)."""
    parts = (part.rstrip(" .") for part in _SEPARATORS.split(path.decode("latin-1").lower()))
    return "/" + "".join(f"{part}/" for part in parts if part)


def _paths(opcode: int, payload: bytes) -> list[str]:
    """The paths of a request: up to a zero byte; Rename has a second one after it."""
    names = payload[_DATA].split(b"\0")
    return [_read(name) for name in names[: 2 if opcode == FTP_RENAME else 1]]


def file_rule(opcode: int, payload: bytes) -> FileRule | None:
    """The row for a file-transfer request (its `payload` field), or None if the opcode alone decides."""
    writes = opcode in _WRITES
    if not writes and opcode not in _READS:
        return None
    paths = _paths(opcode, payload)
    for rule in FILE_RULES:
        applies = rule.writes if writes else rule.reads
        if applies and any(fnmatchcase(path, pattern) for path in paths for pattern in rule.patterns):
            return rule
    return None


def is_upload(path: bytes) -> bool:
    """Whether the autopilot applies a written file as parameters or mission items when it is closed."""
    return any(fnmatchcase(_read(path), pattern) for pattern in _UPLOADS)


def is_mission_file(path: bytes) -> bool:
    """Whether the autopilot applies a written file as mission, fence or rally items when it is closed."""
    return fnmatchcase(_read(path), _MISSION_FILES)


def written_lists(payload: bytes) -> frozenset[str]:
    """The lists that a file-transfer request begins to write or removes: "geofence", "mission", both or neither.

    A file of another list of the autopilot counts as the mission.
    """
    opcode = payload[3]
    if opcode not in _WRITES:
        return frozenset()
    paths = [path for path in _paths(opcode, payload) if fnmatchcase(path, _MISSION_FILES)]
    return frozenset("geofence" if fnmatchcase(path, _FENCE_FILE) else "mission" for path in paths)

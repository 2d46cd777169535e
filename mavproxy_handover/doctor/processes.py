# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the process that holds a lock, a port or a line, and a running companion, in /proc.

Reading /proc takes nothing. Trying a lock or a port would take it, and a companion that starts at that moment would be
refused. Processes of other users cannot be examined: then the holder has no name.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

__all__ = ["Process", "command_line", "companion_of", "listens", "lock_holder", "port_holder", "users_of"]

_PROC: Final = Path("/proc")
_LISTENS: Final = "0A"
#: any address, in the kernel's form
_ANY, _ANY_V6 = "0" * 8, "0" * 32


@dataclass(frozen=True, slots=True)
class Process:
    """A process. `pid` 0: one that this user may not examine."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})" if self.pid else "a process that cannot be seen from here"


UNKNOWN: Final = Process(0, "")


def lock_holder(path: Path) -> Process | None:
    """Process that holds the lock (flock) on that file; None if there is none. Raises OSError if that is unknown."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    for line in (_PROC / "locks").read_text(encoding="ascii", errors="replace").splitlines():
        fields = line.split()
        # waiting processes have an arrow
        if len(fields) < 6 or fields[1] != "FLOCK" or fields[5].split(":")[-1] != str(status.st_ino):
            continue
        major, minor = (int(part, 16) for part in fields[5].split(":")[:2])
        # some file systems report another number in a file's status
        same = (major, minor) == (os.major(status.st_dev), os.minor(status.st_dev))
        pid = int(fields[4])
        if same or (pid > 0 and _has_open(pid, str(path.resolve()))):
            return Process(pid, _name(pid)) if pid > 0 else UNKNOWN
    return None


def companion_of(config: Path) -> Process | None:
    """The `handover companion` of that configuration, or of none; None if there is none or the system does not tell.

    It exists before it has its vehicle's lock, and while it forks its judge again.
    """
    try:
        pids = _pids()
    except OSError:
        return None
    for pid in pids:
        words = _words(pid)
        for number, (program, what) in enumerate(pairwise(words)):
            if what == "companion" and "handover" in Path(program).name and _is_of(words[number + 2 :], pid, config):
                return Process(pid, _name(pid))
    return None


def _is_of(words: list[str], pid: int, config: Path) -> bool:
    named = [value for word, value in pairwise(words) if word == "--config"]
    named += [word.partition("=")[2] for word in words if word.startswith("--config=")]
    if not named:
        return True
    try:
        folder = Path(os.readlink(_PROC / str(pid) / "cwd"))
    except OSError:
        folder = Path("/")
    return (folder / Path(named[-1]).expanduser()).resolve() == config.resolve()


def users_of(path: Path) -> list[Process]:
    """Processes that have that file or line open."""
    target = str(path.resolve())
    return [Process(pid, _name(pid)) for pid in _pids() if pid != os.getpid() and _has_open(pid, target)]


def port_holder(udp: bool, port: int) -> Process:
    """Process that listens on that port of this machine, at any address."""
    kind = "udp" if udp else "tcp"
    inodes = {inode for table in (kind, f"{kind}6") for inode in _listening(table, udp, port)}
    for pid in _pids():
        for target in _open_files(pid):
            if target.startswith("socket:[") and target[8:-1] in inodes:
                return Process(pid, _name(pid))
    return UNKNOWN


def listens(udp: bool, host: str, port: int) -> bool | None:
    """True if a program listens on that port of an address of this machine; None: the system does not tell."""
    kind = "udp" if udp else "tcp"
    if not (_PROC / "net" / kind).exists():
        return None
    try:
        wanted = socket.inet_aton(host)[::-1].hex().upper()
    except OSError:
        wanted = _ANY
    found = {address for table in (kind, f"{kind}6") for address in _addresses(table, udp, port)}
    return bool(found) if wanted == _ANY else bool(found & {wanted, _ANY, _ANY_V6})


def _addresses(table: str, udp: bool, port: int) -> Iterator[str]:
    """Addresses with a listener on that port, in the kernel's form."""
    for fields in _rows(table):
        address, _, number = fields[1].rpartition(":")
        if int(number, 16) == port and (udp or fields[3] == _LISTENS):
            yield address


def _listening(table: str, udp: bool, port: int) -> Iterator[str]:
    for fields in _rows(table):
        if int(fields[1].rpartition(":")[2], 16) == port and (udp or fields[3] == _LISTENS):
            yield fields[9]


def _rows(table: str) -> list[list[str]]:
    try:
        rows = (_PROC / "net" / table).read_text(encoding="ascii").splitlines()[1:]
    except OSError:
        return []
    return [row.split() for row in rows]


def _pids() -> list[int]:
    return sorted(int(name) for name in os.listdir(_PROC) if name.isdecimal())


def _open_files(pid: int) -> Iterator[str]:
    folder = _PROC / str(pid) / "fd"
    try:
        names = os.listdir(folder)
    except OSError:  # another user's, or gone
        return
    for name in names:
        try:
            yield os.readlink(folder / name)
        except OSError:
            continue


def _has_open(pid: int, target: str) -> bool:
    return target in _open_files(pid)


def command_line(pid: int) -> str:
    """Command line of a process; "" if it is gone or may not be examined."""
    return " ".join(_words(pid)).strip()


def _words(pid: int) -> list[str]:
    try:
        return (_PROC / str(pid) / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")[:-1]
    except OSError:
        return []


def _name(pid: int) -> str:
    """Name of the program, and of the script that a Python runs."""
    names = [Path(word).name for word in command_line(pid).split() if not word.startswith("-")]
    return " ".join(names[: 2 if names[0].startswith("python") else 1]) if names else "?"

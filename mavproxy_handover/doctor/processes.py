# SPDX-License-Identifier: GPL-3.0-or-later

"""Which process holds a lock, a port, a line: read in /proc, where nothing has to be taken to find out.

To try a lock is to take it, and a companion that starts at that moment would be refused. What of other users' processes
cannot be seen is left out: then there is a holder without a name.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["Process", "command_line", "lock_holder", "port_holder", "users_of"]

_PROC: Final = Path("/proc")
_LISTENS: Final = "0A"


@dataclass(frozen=True, slots=True)
class Process:
    """A process; `pid` 0: somebody, whom we may not see."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})" if self.pid else "a process that cannot be seen from here"


UNKNOWN: Final = Process(0, "")


def lock_holder(path: Path) -> Process | None:
    """Who holds the lock (flock) on that file; None: nobody. Raises OSError if it cannot be found out."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    for line in (_PROC / "locks").read_text(encoding="ascii", errors="replace").splitlines():
        fields = line.split()
        # 1: FLOCK ADVISORY WRITE 4711 08:01:123456 0 EOF; what waits for a lock has an arrow
        if len(fields) < 6 or fields[1] != "FLOCK" or fields[5].split(":")[-1] != str(status.st_ino):
            continue
        major, minor = (int(part, 16) for part in fields[5].split(":")[:2])
        # some file systems have a number of their own for a file's status
        same = (major, minor) == (os.major(status.st_dev), os.minor(status.st_dev))
        pid = int(fields[4])
        if same or (pid > 0 and _has_open(pid, str(path.resolve()))):
            return Process(pid, _name(pid)) if pid > 0 else UNKNOWN
    return None


def users_of(path: Path) -> list[Process]:
    """Who has that file, or line, open."""
    target = str(path.resolve())
    return [Process(pid, _name(pid)) for pid in _pids() if pid != os.getpid() and _has_open(pid, target)]


def port_holder(udp: bool, port: int) -> Process:
    """Who listens on that port of this machine, whatever its address."""
    kind = "udp" if udp else "tcp"
    inodes = {inode for table in (kind, f"{kind}6") for inode in _listening(table, udp, port)}
    for pid in _pids():
        for target in _open_files(pid):
            if target.startswith("socket:[") and target[8:-1] in inodes:
                return Process(pid, _name(pid))
    return UNKNOWN


def _listening(table: str, udp: bool, port: int) -> Iterator[str]:
    try:
        rows = (_PROC / "net" / table).read_text(encoding="ascii").splitlines()[1:]
    except OSError:
        return
    for row in rows:
        fields = row.split()
        if int(fields[1].rpartition(":")[2], 16) == port and (udp or fields[3] == _LISTENS):
            yield fields[9]


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
    """What it was started with; "" for one that is gone, or that we may not see."""
    try:
        return (_PROC / str(pid) / "cmdline").read_bytes().decode("utf-8", "replace").replace("\0", " ").strip()
    except OSError:
        return ""


def _name(pid: int) -> str:
    """The program, and the script that a Python runs."""
    names = [Path(word).name for word in command_line(pid).split() if not word.startswith("-")]
    return " ".join(names[: 2 if names[0].startswith("python") else 1]) if names else "?"

# SPDX-License-Identifier: GPL-3.0-or-later

"""The service's user and its rights to a file. Another root has users of its own."""

from __future__ import annotations

import os
import pwd
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["EXECUTE", "READ", "WRITE", "Account", "account_of", "may", "myself", "reaches"]

READ, WRITE, EXECUTE = 4, 2, 1
_ROOT: Final = 0


@dataclass(frozen=True, slots=True)
class Account:
    """A user and the groups that it is in."""

    name: str
    uid: int
    groups: frozenset[int]


def myself() -> Account:
    """The user of this process."""
    uid = os.geteuid()
    try:
        name = pwd.getpwuid(uid).pw_name
    except KeyError:
        name = str(uid)
    return Account(name, uid, frozenset([os.getegid(), *os.getgroups()]))


def account_of(name: str, root: Path) -> Account | None:
    """The user of that name on the machine below `root`; None if there is none."""
    if root == Path("/"):
        try:
            user = pwd.getpwnam(name)
        except KeyError:
            return None
        return Account(name, user.pw_uid, frozenset(os.getgrouplist(name, user.pw_gid)))
    for fields in _rows(root / "etc" / "passwd", 4):
        if fields[0] == name and fields[2].isdecimal() and fields[3].isdecimal():
            groups = {int(fields[3])}
            for group in _rows(root / "etc" / "group", 4):
                if name in group[3].split(",") and group[2].isdecimal():
                    groups.add(int(group[2]))
            return Account(name, int(fields[2]), frozenset(groups))
    return None


def _rows(path: Path, least: int) -> list[list[str]]:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    return [fields for line in text.splitlines() if len(fields := line.split(":")) >= least]


def may(status: os.stat_result, account: Account, wanted: int) -> bool:
    """True if the file's mode permits it to the account. `wanted`: sum of READ, WRITE, EXECUTE."""
    if account.uid == _ROOT:
        return True
    shift = 6 if status.st_uid == account.uid else 3 if status.st_gid in account.groups else 0
    return status.st_mode >> shift & wanted == wanted


def reaches(path: Path, account: Account, root: Path) -> Path | None:
    """The first folder from `root` to `path` that the account may not enter; None if it may enter all.

    Raises OSError if the path does not exist, or if this process may not enter it.
    """
    for folder in reversed(path.parents):
        if folder.is_relative_to(root) and not may(folder.stat(), account, EXECUTE):
            return folder
    return None

# SPDX-License-Identifier: GPL-3.0-or-later

"""Flight folders. Each holds the files of one run of the companion or of a station.

Rules that live here
--------------------
* Each run has a new folder. So a run never opens, shortens or overwrites the files of another run. A restart by the
  supervisor belongs to the same run. The folder's name begins with the UTC time, for people. If the name exists
  already, a number is added, so a clock that is not set or is set back makes no two equal names.
* `latest` is a link to the folder that was begun last.
* A run may end before it wrote anything, for example if the key file is readable by others or no autopilot answers. Its
  folder is removed when the next run of its name begins, because a service manager retries every few seconds.
* A folder is locked while any process of its run lives; children and successors inherit the lock. A locked folder is
  never deleted. Of the others the oldest are deleted first, each as a whole.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from math import inf
from pathlib import Path
from typing import Any, Final, NamedTuple

from mavproxy_handover.store.portable import lock

__all__ = ["LATEST", "Flight", "Room", "begin", "delete", "flights", "latest_flight", "to_go"]

LATEST: Final = "latest"
#: lock file, and file with the facts about the run
_HELD: Final = ".held"
_ABOUT: Final = "run.json"
_NAME: Final = re.compile(r"(?P<time>\d{8}T\d{6}Z)-(?P<who>[\w.-]+)(\+(?P<count>\d+))?")
_TRIES: Final = 10_000
_DAY_S: Final = 86400.0


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight folder. `begun`: UTC time in its name. `ended`: UTC time of its last change. `held`: a process of its
    run lives.
    """

    path: Path
    who: str
    begun: datetime
    ended: datetime
    size: int
    held: bool


def begin(
    base: Path, who: str, utc: datetime, about: Mapping[str, Any], config: Path, content: bytes | None = None
) -> Path:
    """Make the folder of a new run and lock it for this process, its children and its successors.

    Writes `about` to it as JSON, and a copy of the configuration: `content`, or else what the file holds now. Raises
    OSError.
    """
    base.mkdir(parents=True, exist_ok=True)
    who = re.sub(r"[^\w.-]", "_", who)
    with suppress(OSError):  # a folder that cannot be removed stays
        _forget(base, who, config.name)
    stem = f"{utc.astimezone(timezone.utc):%Y%m%dT%H%M%SZ}-{who}"
    for number in range(1, _TRIES):
        folder = base / (stem if number == 1 else f"{stem}+{number}")
        try:
            folder.mkdir()
            break
        except FileExistsError:
            continue
    else:
        raise FileExistsError(17, "no free name for the folder of a flight", str(base / stem))
    held = os.open(folder / _HELD, os.O_WRONLY | os.O_CREAT, 0o600)
    lock(held, wait=True)
    os.set_inheritable(held, True)
    text = json.dumps({"begun_utc": utc.astimezone(timezone.utc).isoformat(timespec="seconds"), **about}, indent=1)
    (folder / _ABOUT).write_text(text + "\n", encoding="utf-8")
    (folder / config.name).write_bytes(config.read_bytes() if content is None else content)
    _lead_to(base, folder)
    return folder


def _forget(base: Path, who: str, config: str) -> None:
    """Delete the newest folder of that name if its run is over and has written nothing. Raises OSError."""
    begun = [
        (named["time"], int(named["count"] or 1), named.string)
        for named in map(_NAME.fullmatch, os.listdir(base))
        if named and named["who"] == who
    ]
    if not begun:
        return
    path = base / max(begun)[2]
    # a folder that another process is making has no such file yet: it is written under the lock
    if path.is_symlink() or not (path / _ABOUT).is_file():
        return
    written = (each.stat().st_size for each in path.iterdir() if each.name not in (_HELD, _ABOUT, config))
    if not any(written) and not _is_held(path):
        _delete(path)


def _lead_to(base: Path, folder: Path) -> None:
    """Point `latest` to the folder in one step. A file system without links gets none."""
    with suppress(OSError):
        draft = Path(tempfile.mktemp(prefix=".latest-", dir=base))
        draft.symlink_to(folder.name)
        draft.replace(base / LATEST)


def flights(base: Path) -> list[Flight]:
    """All flight folders, the oldest first; other entries are skipped. Raises OSError."""
    found = []
    for path in base.iterdir():
        named = _NAME.fullmatch(path.name)
        if named is None or path.is_symlink() or not path.is_dir():
            continue
        with suppress(ValueError):
            begun = datetime.strptime(named["time"], "%Y%m%dT%H%M%SZ").replace(tzinfo=timezone.utc)
            found.append((begun, int(named["count"] or 1), _describe(path, named["who"], begun)))
    return [flight for _begun, _count, flight in sorted(found, key=lambda each: (each[0], each[1], each[2].who))]


def latest_flight(base: Path) -> list[Path]:
    """The folders of the newest flight, in the order in which they ended, the last first.

    A flight has a run for the companion and one for each station, and another for each restart: all runs that overlap
    in time, directly or through others. Raises OSError.
    """
    chosen: list[Flight] = []
    for flight in sorted(flights(base), key=lambda each: (each.held, each.ended), reverse=True):
        if not chosen or flight.held or flight.ended >= min(each.begun for each in chosen):
            chosen.append(flight)
    return [flight.path for flight in chosen]


def _describe(path: Path, who: str, begun: datetime) -> Flight:
    size, last = 0, path.stat().st_mtime
    for folder, _folders, names in os.walk(path):
        for name in names:
            with suppress(OSError):  # deleted meanwhile
                status = os.lstat(os.path.join(folder, name))
                size, last = size + status.st_size, max(last, status.st_mtime)
    return Flight(path, who, begun, datetime.fromtimestamp(last, timezone.utc), size, _is_held(path))


def _is_held(path: Path) -> bool:
    try:
        descriptor = os.open(path / _HELD, os.O_RDONLY)
    except FileNotFoundError:
        return False
    except OSError:  # the lock file cannot be opened
        return True
    try:
        return not lock(descriptor)
    except OSError:
        return True
    finally:
        os.close(descriptor)


class Room(NamedTuple):
    """Bytes that stay free on the disk, and those that are free now."""

    keep: float = 0.0
    free: float = inf


NO_ROOM: Final = Room()


def to_go(
    found: Iterable[Flight], now: datetime, keep_days: float, keep_bytes: float, room: Room = NO_ROOM
) -> list[Flight]:
    """Folders that may be deleted, never a locked one.

    First those that ended more than `keep_days` ago, then the oldest, until the rest has at most `keep_bytes` and the
    disk has its `room`.
    """
    gone: list[Flight] = []
    kept: list[Flight] = []
    for flight in sorted(found, key=lambda each: each.ended):
        old = (now - flight.ended).total_seconds() > keep_days * _DAY_S
        (gone if old and not flight.held else kept).append(flight)
    size = sum(flight.size for flight in kept)
    free = room.free + sum(flight.size for flight in gone)
    for flight in kept:
        if size <= keep_bytes and free >= room.keep:
            break
        if not flight.held:
            gone.append(flight)
            size -= flight.size
            free += flight.size
    return gone


def delete(flight: Flight) -> None:
    """Delete the folder. It is renamed first, so that an interrupted deletion leaves no incomplete flight. Raises
    OSError.
    """
    _delete(flight.path)


def _delete(path: Path) -> None:
    doomed = path.with_name(f".gone-{path.name}")
    path.replace(doomed)
    shutil.rmtree(doomed)

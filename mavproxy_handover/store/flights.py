# SPDX-License-Identifier: GPL-3.0-or-later

"""Folders of flights: what a run of the companion, or of a station, leaves behind, and nothing of any other run.

Rules that live here
--------------------
* One folder for each run, made for it: so no run ever opens, shortens or overwrites what another one wrote. A restart
  by the supervisor is the same run. The name begins with the time by UTC, for people; it is only a name: a clock that
  was not set yet, or is set back, makes no two of one, as what is there already is counted past.
* `latest` leads to the newest one that was begun.
* A run that ended before it wrote anything (a key that others may read, no autopilot at the other end) leaves nothing
  when the next one of its name begins: a service manager tries every few seconds, for as long as nobody looks.
* A folder is held for as long as anything of its run lives (a lock that children and successors keep), and what is held
  is never deleted. Of the others the oldest go first, and only whole ones.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final

__all__ = ["LATEST", "Flight", "begin", "delete", "flights", "latest_flight", "to_go"]

LATEST: Final = "latest"
#: lock, and what the run is about
_HELD: Final = ".held"
_ABOUT: Final = "run.json"
_NAME: Final = re.compile(r"(?P<time>\d{8}T\d{6}Z)-(?P<who>[\w.-]+)(\+(?P<count>\d+))?")
_TRIES: Final = 10_000
_DAY_S: Final = 86400.0


@dataclass(frozen=True, slots=True)
class Flight:
    """A folder. `begun` is what its name says, `ended` its last change, both UTC. `held`: it is written to."""

    path: Path
    who: str
    begun: datetime
    ended: datetime
    size: int
    held: bool


def begin(
    base: Path, who: str, utc: datetime, about: Mapping[str, Any], config: Path, content: bytes | None = None
) -> Path:
    """Make the folder of a run that begins, and hold it for this process, its children and whoever it becomes.

    `about` goes into it as JSON, and so does the configuration file: `content`, or what is in it now. Raises OSError.
    """
    base.mkdir(parents=True, exist_ok=True)
    who = re.sub(r"[^\w.-]", "_", who)
    with suppress(OSError):  # what cannot be taken away stays
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
    lock = os.open(folder / _HELD, os.O_WRONLY | os.O_CREAT, 0o600)
    fcntl.flock(lock, fcntl.LOCK_EX)
    os.set_inheritable(lock, True)
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
    # one that another process is just making has no such file yet: that is written under the lock
    if path.is_symlink() or not (path / _ABOUT).is_file():
        return
    written = (each.stat().st_size for each in path.iterdir() if each.name not in (_HELD, _ABOUT, config))
    if not any(written) and not _is_held(path):
        _delete(path)


def _lead_to(base: Path, folder: Path) -> None:
    """`latest` in one step; where there can be no links there is none."""
    with suppress(OSError):
        draft = Path(tempfile.mktemp(prefix=".latest-", dir=base))
        draft.symlink_to(folder.name)
        draft.replace(base / LATEST)


def flights(base: Path) -> list[Flight]:
    """All folders there, the oldest first; anything else is left out. Raises OSError."""
    found = []
    for path in base.iterdir():
        named = _NAME.fullmatch(path.name)
        if named is None or path.is_symlink() or not path.is_dir():
            continue
        with suppress(ValueError):
            begun = datetime.strptime(named["time"], "%Y%m%dT%H%M%SZ").replace(tzinfo=timezone.utc)
            found.append((begun, int(named["count"] or 1), _look(path, named["who"], begun)))
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


def _look(path: Path, who: str, begun: datetime) -> Flight:
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
    except OSError:  # nobody to ask
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False


def to_go(found: Iterable[Flight], now: datetime, keep_days: float, keep_bytes: float) -> list[Flight]:
    """Which of them may be deleted: those that ended longer ago, and of the others the oldest, until the rest is no
    more than so many bytes. Never one that is held."""
    gone: list[Flight] = []
    kept: list[Flight] = []
    for flight in sorted(found, key=lambda each: each.ended):
        old = (now - flight.ended).total_seconds() > keep_days * _DAY_S
        (gone if old and not flight.held else kept).append(flight)
    size = sum(flight.size for flight in kept)
    for flight in kept:
        if size <= keep_bytes:
            break
        if not flight.held:
            gone.append(flight)
            size -= flight.size
    return gone


def delete(flight: Flight) -> None:
    """The whole folder; under another name first, so that what is cut short is no half flight. Raises OSError."""
    _delete(flight.path)


def _delete(path: Path) -> None:
    doomed = path.with_name(f".gone-{path.name}")
    path.replace(doomed)
    shutil.rmtree(doomed)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The machine itself: the unit, the clock, the disk."""

from __future__ import annotations

import ctypes
import errno
import os
import stat
import sys
import time
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

import mavproxy_handover
from mavproxy_handover.cli.machine import STATE
from mavproxy_handover.doctor.accounts import WRITE, may, reaches
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning

__all__ = ["clock", "disk", "service"]


# ---- the unit -------------------------------------------------------------------------------------------------------


def service(context: CheckContext) -> Iterator[Finding]:
    """Does systemd run it, and can it?"""
    name, unit = f"handover-{context.kind}", context.unit
    if context.running is not None:
        yield ok(name, f"runs: {context.running}; what it holds is not opened here")
    if context.unit_error:
        yield error(name, context.unit_error, f"Install it again: handover install {context.kind} --force.")
    if unit is None or not context.installed:
        if context.installed and not context.unit_error:
            do = f"Run: handover install {context.kind}."
            yield warning(name, "there is no unit: it runs when a person starts it", do)
        return
    if context.account_missing:
        there = f"its user {context.account_missing!r} does not exist yet"
        yield warning(name, there, "Run: systemd-sysusers; systemd-tmpfiles --create.")
    program = unit.program
    if program is None:
        yield error(name, f"{unit.path} starts nothing", f"Install it again: handover install {context.kind} --force.")
    elif not os.access(context.at(program), os.X_OK):
        do = f"Install the program there, or install the unit again with --program (docs/installation.md, {unit.path})."
        yield error(name, f"the unit starts {program}, which is no program there", do)
    elif not unit.enabled:
        yield warning(name, "it does not start with the machine", f"Run: systemctl enable --now {name}.")
    else:
        yield ok(name, f"starts with the machine, as {unit.user}")


# ---- the clock ------------------------------------------------------------------------------------------------------

#: adjtimex(2) without changes returns the state of the clock; TIME_ERROR: it is not synchronised
_TIMEX_BYTES: Final = 512
_TIME_ERROR: Final = 5
#: tolerance (s) between this clock and the time of installation
_BACKWARDS_S: Final = 60.0


def clock(context: CheckContext) -> Iterator[Finding]:
    """The time of day: signatures rest on it, and logs."""
    utc_s = context.clocks.utc()
    installed_s = Path(mavproxy_handover.__file__).stat().st_mtime
    shown = _shown(utc_s)
    if utc_s < installed_s - _BACKWARDS_S:
        context.clock_wrong = True
        found = f"{shown}, which is before this program was installed ({_shown(installed_s)})"
        do = "Set it, by network time, a receiver (gpsd, chrony) or a clock with a battery, before anything is signed."
        yield error("time of day", found, do)
        return
    kept = _synchronised(context.root)
    if kept is None:
        yield ok("time of day", f"{shown}; whether something keeps it right is not told here")
    elif kept:
        yield ok("time of day", f"{shown}, kept right by another clock")
    else:
        found = f"{shown}, and nothing keeps it right: signatures of a clock that is a minute off are refused"
        yield warning("time of day", found, "Run: timedatectl set-ntp true, or have chrony follow a receiver.")


def _shown(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")


def _synchronised(root: Path) -> bool | None:
    """Whether another clock keeps this one right; None: the system does not tell."""
    if (root / "run/systemd/timesync/synchronized").exists():
        return True
    if root != Path("/"):
        return False
    if sys.platform != "linux":
        return None
    try:
        state = int(ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES)))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != _TIME_ERROR


# ---- the disk -------------------------------------------------------------------------------------------------------

#: MAVProxy writes no tlog with less; and what an hour of flight may take
_LEAST_BYTES: Final = 200 << 20
_GOOD_BYTES: Final = 1 << 30
_BLOCK: Final = bytes(4096)
#: a file system that makes no files without a name
_NO_NAMELESS: Final = (errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL)
#: a flight gets by with a slow disk; beyond that journals lose lines
_SLOW_S: Final = 2.0


def disk(context: CheckContext) -> Iterator[Finding]:
    """Is there room where state and logs are kept, may they be written there, and how long does that take?"""
    folder = _kept_in(context)
    try:
        status, room = folder.stat(), os.statvfs(folder)
    except FileNotFoundError:
        yield error(str(folder), "no such folder", f"Run: systemd-tmpfiles --create, or mkdir -m 0750 {folder}.")
        return
    except OSError as fault:
        yield unseen(str(folder), str(fault.strerror), f"Run this as {context.account.name}, or with sudo.")
        return
    if not stat.S_ISDIR(status.st_mode):
        yield error(str(folder), "is no folder", "Move that file away, and run: systemd-tmpfiles --create.")
        return
    yield _room(folder, room)
    hindered = reaches(folder, context.account, context.root)
    if hindered is not None or not may(status, context.account, WRITE):
        mode = stat.S_IMODE((hindered or folder).stat().st_mode)
        found = (
            f"{context.account.name} may not {'enter' if hindered else 'write to'} {hindered or folder} ({mode:04o})"
        )
        yield error(str(folder), found, f"Run: chown {context.account.name}: {folder}; chmod 0750 {folder}.")
        return
    yield _written(folder, context)


def _kept_in(context: CheckContext) -> Path:
    if context.installed:
        return context.at(STATE)
    if context.vehicle is not None and context.vehicle.state is not None:
        state = context.at(context.vehicle.state)
        return state if state.exists() else state.parent
    journal = context.vehicle or context.station
    return context.path.parent if journal is None else context.at(journal.journal).parent


def _room(folder: Path, room: os.statvfs_result) -> Finding:
    free = room.f_bavail * room.f_frsize
    shown = f"{free / 1e9:.2f} GB free" if free >= 1e8 else f"{free / 1e6:.1f} MB free"
    do = f"Make room: handover logs prune --logs {folder / 'flights'} --keep-gb 1."
    if room.f_files and not room.f_favail:
        return error(str(folder), f"{shown}, and no file can be made any more", do)
    if free < _LEAST_BYTES:
        return error(str(folder), f"{shown}: flights leave no tlog, and soon no journal", do)
    return warning(str(folder), shown, do) if free < _GOOD_BYTES else ok(str(folder), shown)


def _written(folder: Path, context: CheckContext) -> Finding:
    """Write to a file without a name, which is gone when it is closed."""
    what = f"{folder}: writing"
    context.tell(f"writing to the disk of {folder}")
    begun_s = time.monotonic()
    try:
        with open(os.open(folder, os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, 0o600), "wb") as file:
            file.write(_BLOCK)
            file.flush()
            os.fsync(file.fileno())
    except PermissionError:
        return unseen(what, "not allowed", f"Run this as {context.account.name}, or with sudo.")
    except OSError as fault:
        if fault.errno in _NO_NAMELESS:
            return ok(what, "allowed; how long it takes cannot be tried on this file system")
        do = "Make room, or mount it for writing, or take another disk: nothing of a flight would be kept."
        return error(what, str(fault.strerror), do)
    took_s = time.monotonic() - begun_s
    shown = f"a block is on the disk within {took_s * 1000:.1f} ms"
    if took_s > _SLOW_S:
        do = "Take a better card or disk: what is in memory alone is lost with the power."
        return warning(what, shown, do)
    return ok(what, shown)

# SPDX-License-Identifier: GPL-3.0-or-later

"""What a flight's dataflash log tells: when the guard acted, by the autopilot's own clock, and who chose each mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pymavlink import DFReader

#: reasons of a mode in the log
RADIO, BATTERY, GCS, EKF, ESCAPE, FENCE, SCRIPTING = 3, 4, 5, 6, 9, 10, 32


def records(directory: Path, *kinds: str) -> list[Any]:
    """The records of these kinds in the flight's dataflash log, in order."""
    found = []
    for path in sorted((directory / "logs").glob("*.BIN")):
        log = DFReader.DFReader_binary(str(path))
        try:
            while (record := log.recv_match(type=list(kinds))) is not None:
                found.append(record)
        finally:
            log.close()
    return found


def guard_records(directory: Path) -> list[Any]:
    """The HNDO records of the flight's dataflash log, in order."""
    return records(directory, "HNDO")


def actions_logged(directory: Path) -> list[tuple[int, int, float]]:
    """Each time that the guard began to act: its state, the age of the lease then, and how long the state had lasted,
    both in milliseconds of the autopilot's own clock. The record is written in the very call that acts."""
    found = []
    before = since = None
    for record in guard_records(directory):
        if since is None or record.St != since.St:
            since = record
        if record.Ac and before is not None and not before.Ac:
            found.append((record.St, record.Age, (record.TimeUS - since.TimeUS) / 1000))
        before = record
    return found


def mode_changes(directory: Path) -> list[tuple[int, int, float]]:
    """Mode, reason and time (s, the autopilot's clock) of every change."""
    return [(record.Mode, record.Rsn, record.TimeUS / 1e6) for record in records(directory, "MODE")]

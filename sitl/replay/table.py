# SPDX-License-Identifier: GPL-3.0-or-later

"""A recorded flight as a table: comma-separated values with a line of names above them.

It needs a time (`time`: ISO 8601 with its zone, or seconds), `lat_deg`, `lon_deg` and `alt_m` (above home). It may have
`battery_percent`, `voltage_v`, `current_a`, `mode` (the autopilot's name or number), `armed` (0 or 1) and `waypoint`
(the item that is flown to). Other columns are left alone. An empty field is one that is not known then.
"""

from __future__ import annotations

import csv
import itertools
import math
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

from mavproxy_handover.vehicle.profiles import Profile
from sitl.replay.recording import Recording, RecordingError
from sitl.replay.samples import Sample, recorded

__all__ = ["read_table"]

_NEEDED: Final = ("time", "lat_deg", "lon_deg", "alt_m")
_RANGES: Final = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-180.0, 180.0),
    "alt_m": (-1000.0, 20_000.0),
    "battery_percent": (0.0, 100.0),
    "voltage_v": (0.0, 65.0),
    "current_a": (0.0, 320.0),
    "waypoint": (0.0, 65_535.0),
    "armed": (0.0, 1.0),
}


def read_table(path: Path, profile: Profile) -> Recording:
    """Read a table of this vehicle's flight. Raises RecordingError."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            names = tuple(rows.fieldnames or ())
            lacking = [name for name in _NEEDED if name not in names]
            if lacking:
                raise RecordingError(f"{path}: no column {', '.join(lacking)}; it has {', '.join(names) or 'none'}")
            samples = [_sample(path, number, row, profile) for number, row in enumerate(rows, 2)]
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: not a table: {error}") from None
    if len(samples) < 2:
        raise RecordingError(f"{path}: {len(samples)} rows: a flight has two at least")
    for number, (one, other) in enumerate(itertools.pairwise(samples), 3):
        if other.at <= one.at:
            raise RecordingError(f"{path}: line {number}: time: not later than the line before")
    return recorded(path, "table", samples, _assumed(names), profile)


def _assumed(names: tuple[str, ...]) -> list[str]:
    found = ["what was before the first line: it stands there, disarmed, for a few seconds"]
    if "mode" not in names:
        found.append("flight modes: AUTO all the time")
    if "armed" not in names:
        found.append("arming: from the first line to the last; in the air above 1 m")
    if "waypoint" not in names:
        found.append("which item was flown to: not known, so neither is what lies ahead on the route")
    if "battery_percent" not in names and "voltage_v" not in names:
        found.append("the battery: not known, so nothing is decided for energy")
    return found


def _sample(path: Path, line: int, row: dict[str, str | None], profile: Profile) -> Sample:
    def number(name: str) -> float | None:
        text = (row.get(name) or "").strip()
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        low, high = _RANGES[name]
        if not low <= value <= high:
            raise RecordingError(f"{path}: line {line}: {name}: {text!r} must be {low:g} to {high:g}")
        return value

    def needed(name: str) -> float:
        value = number(name)
        if value is None:
            raise RecordingError(f"{path}: line {line}: {name}: is missing")
        return value

    armed, waypoint = number("armed"), number("waypoint")
    return Sample(
        _time(path, line, (row.get("time") or "").strip()),
        needed("lat_deg"),
        needed("lon_deg"),
        needed("alt_m"),
        armed=None if armed is None else bool(armed),
        flying=False if armed == 0.0 else None,
        mode=_mode(path, line, (row.get("mode") or "").strip(), profile),
        waypoint=None if waypoint is None else int(waypoint),
        remaining=number("battery_percent"),
        voltage_v=number("voltage_v"),
        current_a=number("current_a"),
    )


def _time(path: Path, line: int, text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        try:
            moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
        except ValueError:
            seconds = math.nan
        else:
            zone = moment.tzinfo or timezone.utc
            seconds = moment.replace(tzinfo=zone).timestamp()
    if not 0.0 <= seconds < 4_102_444_800.0:
        raise RecordingError(f"{path}: line {line}: time: {text!r} must be seconds, or ISO 8601 (2026-11-23T15:04:38Z)")
    return seconds


def _mode(path: Path, line: int, text: str, profile: Profile) -> int | None:
    if not text:
        return None
    names = {mode.name: number for number, mode in profile.modes.items()}
    number = int(text) if text.isdecimal() else names.get(text.upper())
    if number not in profile.modes:
        raise RecordingError(f"{path}: line {line}: mode: {text!r} is no flight mode of {profile.firmware}")
    return number

# SPDX-License-Identifier: GPL-3.0-or-later

"""A recorded flight as ArduPilot's own log on the autopilot's card (.bin), read by pymavlink's reader.

Its times are GPS time turned into UTC. It begins when the aircraft arms, unless LOG_DISARMED says otherwise. What is
read: POS, XKF1 (velocity), BAT, MODE, ARM and EV (armed, on the ground), MISE, or CMD where there is none (the item
that is flown to).
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pymavlink import DFReader

from mavproxy_handover.vehicle.profiles import Profile
from sitl.replay.recording import Recording, RecordingError
from sitl.replay.samples import Sample, recorded

__all__ = ["read_dataflash"]

_READ: Final = ["POS", "XKF1", "BAT", "MODE", "ARM", "EV", "MISE", "CMD"]
#: how every record of a binary log begins
_BEGINS: Final = b"\xa3\x95"
#: EV: armed, disarmed, landed, off the ground
_ARMED, _DISARMED, _LANDED, _OFF_GROUND = 10, 11, 18, 28
#: before 4.7 the whole mission is written as CMD when a log begins (s)
_LISTED_S: Final = 5.0
#: positions come at up to 50 Hz
_LEAST_S: Final = 0.045
#: the earliest time (UTC s) that is no time since the autopilot was switched on: the year 2000
_EPOCH: Final = 946_684_800.0


def read_dataflash(path: Path, profile: Profile) -> Recording:
    """Read a log of this vehicle. Raises RecordingError."""
    try:
        if path.stat().st_size == 0:
            raise RecordingError(f"{path}: is empty")
        with path.open("rb") as file:
            if file.read(len(_BEGINS)) != _BEGINS:
                raise RecordingError(f"{path}: not a dataflash log: it does not begin like one")
        entries = _entries(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None
    except RecordingError:
        raise
    except Exception as error:  # the reader's own errors are of many kinds
        raise RecordingError(f"{path}: not a dataflash log: {type(error).__name__}: {error}") from None
    samples = _samples(entries)
    if len(samples) < 2:
        raise RecordingError(f"{path}: no positions (POS) in it")
    assumed = [
        "what was before the log began: the aircraft stands there, disarmed, for a few seconds",
        "failsafes and words of the autopilot: a dataflash log is read for place, battery, mode and arming only",
    ]
    if samples[0].at < _EPOCH:
        assumed.append("the time: the log has no GPS time; no journal can be compared with it")
    return recorded(path, "dataflash log", samples, assumed, profile)


def _entries(path: Path) -> list[tuple[float, Any]]:
    """The messages of the log that are used, in order of time."""
    found = []
    with contextlib.redirect_stderr(io.StringIO()):  # the reader tells there of what it does not know
        reader = DFReader.DFReader_binary(str(path), zero_time_base=False)
        try:
            while (message := reader.recv_match(type=_READ)) is not None:
                found.append((float(message._timestamp), message))
        finally:
            reader.data_map.close()
            reader.filehandle.close()
    return sorted(found, key=lambda entry: entry[0])


def _samples(entries: list[tuple[float, Any]]) -> list[Sample]:
    now = Sample(0.0, 0.0, 0.0, 0.0, armed=_armed_at_first(entries), flying=False)
    executed = "MISE" if any(entry.get_type() == "MISE" for _at, entry in entries) else "CMD"
    listed_until = -1.0 if executed == "MISE" or not entries else entries[0][0] + _LISTED_S
    found: list[Sample] = []
    for at, entry in entries:
        match entry.get_type():
            case "POS":
                if (entry.Lat, entry.Lng) == (0.0, 0.0) or (found and at - found[-1].at < _LEAST_S):
                    continue
                found.append(replace(now, at=at, lat_deg=entry.Lat, lon_deg=entry.Lng, alt_m=entry.RelHomeAlt))
            case "XKF1" if getattr(entry, "C", 0) == 0:
                now = replace(now, velocity=(entry.VN, entry.VE, entry.VD))
            case "BAT" if getattr(entry, "Inst", getattr(entry, "Instance", 0)) == 0:
                now = _battery(now, entry)
            case "MODE":
                now = replace(now, mode=int(entry.ModeNum))
            case "ARM":
                now = replace(now, armed=bool(entry.ArmState))
            case "EV":
                now = _event(now, int(entry.Id))
            case kind if kind == executed and at > listed_until:
                now = replace(now, waypoint=int(entry.CNum))
    return found


def _battery(now: Sample, entry: Any) -> Sample:
    left = float(getattr(entry, "RemPct", -1))
    return replace(
        now,
        voltage_v=float(entry.Volt),
        current_a=float(entry.Curr),
        consumed_mah=float(entry.CurrTot),
        remaining=left if 0.0 <= left <= 100.0 else None,
    )


def _event(now: Sample, number: int) -> Sample:
    if number in (_ARMED, _DISARMED):
        return replace(now, armed=number == _ARMED)
    if number in (_LANDED, _OFF_GROUND):
        return replace(now, flying=number == _OFF_GROUND)
    return now


def _armed_at_first(entries: list[tuple[float, Any]]) -> bool:
    """Whether the log begins armed: unless the first word of it is that it arms."""
    for _at, entry in entries:
        if entry.get_type() == "ARM":
            return not entry.ArmState
        if entry.get_type() == "EV" and entry.Id in (_ARMED, _DISARMED):
            return int(entry.Id) == _DISARMED
    return True

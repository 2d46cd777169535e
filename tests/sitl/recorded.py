# SPDX-License-Identifier: GPL-3.0-or-later

"""A flight's files made by hand, without any process: telemetry logs, a dataflash log, journals, each with its clock.

The aircraft is armed at 0 s, takes off at 2 s, flies north at 10 m/s, and lands and disarms at 60 s. GCSA commands, at
30 s GCSB takes over, from 40 s to 50 s there is an emergency (RTL). Times are seconds of that flight; `BEGUN_UTC` is
UTC of 0 s by GPS, and a file's clock may be `ahead` of that.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import LeaseState
from mavproxy_handover.wire.lease import Lease, pack_lease

BEGUN_UTC = 1_790_000_000.0
BOOT_S = 40.0
HOME = (52.684, 5.910)
END_S = 60
#: how long a frame is on its way to a station (s)
LINK_S = 0.08
STATIONS = {"GCSA": 251, "GCSB": 252}


def place(t: float) -> tuple[float, float, float]:
    """Latitude, longitude, metres above home."""
    north_m = 10.0 * max(0.0, t - 2.0)
    alt_m = min(30.0, max(0.0, 5.0 * (t - 2.0)), max(0.0, 6.0 * (END_S - t)))
    return HOME[0] + north_m / 111_300.0, HOME[1], alt_m


def mode(t: float) -> int:
    """AUTO, and RTL from 40 s on."""
    return 6 if t >= 40 else 3


@dataclass
class Tlog:
    """Frames with their times, as MAVProxy writes them."""

    ahead: float = 0.0
    late: float = 0.0
    begun: float = BEGUN_UTC
    data: list[tuple[float, bytes]] = field(default_factory=list)

    def add(self, t: float, message: Any, sysid: int = 1, compid: int = 1) -> None:
        """A message that was sent at `t`."""
        packer = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        self.data.append((t + self.late, message.pack(packer)))

    def write(self, path: Path) -> Path:
        """Write it."""
        path.parent.mkdir(parents=True, exist_ok=True)
        stamps = ((round((self.begun + t + self.ahead) * 1e6), raw) for t, raw in sorted(self.data))
        path.write_bytes(b"".join(struct.pack(">Q", stamp) + raw for stamp, raw in stamps))
        return path


def telemetry(log: Tlog, sysid: int = 1, *, gps: bool = True, speed: float = 1.0, east_deg: float = 0.0) -> None:
    """What the autopilot sends; with `speed` its clock runs so many times as fast as the others."""
    for tick in range((END_S + 2) * 5):
        t = tick / 5.0
        lat, lon, alt_m = place(t)
        boot_ms = int((BOOT_S + t * speed) * 1000)
        position = (boot_ms, int(lat * 1e7), int((lon + east_deg) * 1e7), 0, int(alt_m * 1000), 1000, 0, 0, 0)
        log.add(t, mavlink.MAVLink_global_position_int_message(*position), sysid)
        if tick % 5:
            continue
        armed = 128 if t < END_S else 0
        log.add(t, mavlink.MAVLink_heartbeat_message(2, 3, armed | 1, mode(t), 4, 3), sysid)
        utc = int((BEGUN_UTC + t * speed) * 1e6) if gps else 0
        log.add(t, mavlink.MAVLink_system_time_message(utc, boot_ms), sysid)
        status = (0, 0, 0, 0, 12600 - int(t) * 10, 1000, 100 - int(t) // 2, 0, 0, 0, 0, 0, 0)
        log.add(t, mavlink.MAVLink_sys_status_message(*status), sysid)


def companion_log(**values: Any) -> Tlog:
    """The log of the companion: the autopilot's frames and the leases."""
    log = Tlog(**{key: value for key, value in values.items() if key in ("ahead", "begun")})
    telemetry(log, **{key: value for key, value in values.items() if key in ("gps", "speed", "sysid")})
    sysid = values.get("sysid", 1)
    for tick in range(END_S * 5):
        t = tick / 5.0
        lease = Lease(LeaseState.HELD, 251 if t < 30 else 252, 7, tick, 1 if t < 30 else 2, 3000)
        log.add(t, pack_lease(lease, sysid), sysid, 191)
    return log


def station_log(name: str, *, ahead: float = 0.0, sysid: int = 1, vehicle: str = "drone-1", **values: Any) -> Tlog:
    """The log of a station."""
    log = Tlog(ahead, LINK_S)
    telemetry(log, sysid, **values)
    own = STATIONS[name]
    for t in range(END_S):
        log.add(t, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), own, 190)
        ack = (sysid, 0, sysid, own, 1, t, 1, 251, name.encode(), [0] * 32, 0)
        log.add(t, mavlink.MAVLink_connect_ack_message(*ack), own, 190)
        connect = (own, 0, sysid, own, 1, t, 1, 251, vehicle.encode(), [0] * 32)
        log.add(t, mavlink.MAVLink_connect_message(*connect), sysid, 198)
        commander, epoch = (251, 1) if t < 30 else (252, 2)
        emergency = 40 <= t < 50
        status = (3 if emergency else 1, commander, 0, own, epoch, 1, 1, 2, 34 if emergency else 0)
        log.add(t + 0.5, mavlink.MAVLink_authority_status_message(*status), sysid, 198)
    parties = (sysid, 251, 252, 1, 1)
    request = (1, *(int(value * 1e7) for value in place(30)[:2]), 30000, 0, 10.0, 85, 2, 3)
    for t, sender, message in (
        (30.0, sysid, mavlink.MAVLink_handover_request_message(252, 190, *parties, *request)),
        (30.0, 252, mavlink.MAVLink_on_handover_message(sysid, 191, *parties, 0, 0, 0)),
        (30.05, 251, mavlink.MAVLink_ok_handover_message(sysid, 191, *parties, 0, 0)),
        (30.1, sysid, mavlink.MAVLink_connect_handover_message(252, 190, *parties)),
        (30.1, 252, mavlink.MAVLink_drone_connected_message(sysid, 191, *parties, 0)),
        (30.15, 251, mavlink.MAVLink_disconnect_handover_message(sysid, 191, *parties)),
        (30.2, sysid, mavlink.MAVLink_handover_result_message(own, 190, sysid, 251, 252, 1, 2, 252, 0, 1)),
    ):
        if own in (sender, message.target_system):
            log.add(t, message, sender, 198 if sender == sysid else 190)
    return log


# ---- the autopilot's own log --------------------------------------------------------------------------------------

_FORMATS = {
    # name: (type, struct, pymavlink's letters, columns)
    "PARM": (64, "<Q16sff", "QNff", "TimeUS,Name,Value,Default"),
    "GPS": (130, "<QBBIHBHiiffff", "QBBIHBcLLffff", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ"),
    "POS": (131, "<Qiifff", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "MODE": (132, "<QBBB", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "EV": (133, "<QB", "QB", "TimeUS,Id"),
    "BAT": (134, "<QBfB", "QBfB", "TimeUS,Inst,Volt,RemPct"),
    "HNDO": (135, "<QBBBBBII", "QBBBBBII", "TimeUS,St,Ac,Fl,Cmd,LSt,Ep,Seq"),
}
#: seconds of UTC at which GPS weeks begin, and by how much GPS is ahead
_GPS_EPOCH, _LEAP_S = 315_964_800, 18


def dataflash(path: Path, *, gps: bool = True, speed: float = 1.0, step: float = 0.2) -> Path:
    """The autopilot's log as a binary file, from arming to disarming."""
    parts = [_record(128, "<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")]
    for name, (number, pattern, letters, columns) in _FORMATS.items():
        size = struct.calcsize(pattern) + 3
        parts.append(_record(128, "<BB4s16s64s", number, size, name.encode(), letters.encode(), columns.encode()))

    def put(name: str, t: float, *values: Any) -> None:
        number, pattern, _, _ = _FORMATS[name]
        parts.append(_record(number, pattern, int((BOOT_S + t * speed) * 1e6), *values))

    put("PARM", 0.0, b"MAV_SYSID", 1.0, 1.0)
    put("MODE", 0.0, 3, 3, 2)
    put("EV", 2.0, 28)
    for tick in range(int(END_S / step)):
        t = round(tick * step, 3)
        lat, lon, alt_m = place(t)
        put("POS", t, int(lat * 1e7), int(lon * 1e7), alt_m, alt_m, alt_m)
        if tick % round(1 / step):
            continue
        since_ms = round((BEGUN_UTC + t * speed - _GPS_EPOCH + _LEAP_S) * 1000)
        week, rest_ms = divmod(since_ms, 7 * 86400 * 1000)
        fix = (0, 6, rest_ms, week) if gps else (0, 0, 0, 0)
        put("GPS", t, *fix, 10, 121, int(lat * 1e7), int(lon * 1e7), alt_m, 10.0, 0.0, 0.0)
        put("BAT", t, 0, 12.6 - t * 0.01, 100 - int(t) // 2)
        commander, epoch = (251, 1) if t < 30 else (252, 2)
        put("HNDO", t, 2, 0, 2, commander, 1, epoch, tick)
        if t == 40:
            put("MODE", t, 6, 6, 2)
    put("EV", END_S, 18)
    put("EV", END_S, 11)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(parts))
    return path


def _record(number: int, pattern: str, *values: Any) -> bytes:
    return b"\xa3\x95" + bytes([number]) + struct.pack(pattern, *values)


# ---- journals -----------------------------------------------------------------------------------------------------


def journal(path: Path, who: str, entries: Iterable[tuple[float, str, dict[str, Any]]], **clock: float) -> Path:
    """A journal of entries (time, event, values); `clock`: `ahead` of GPS, and `mono`, monotonic time at 0 s."""
    ahead, mono = clock.get("ahead", 0.0), clock.get("mono", 5000.0)
    lines = []
    for t, event, values in entries:
        utc = datetime.fromtimestamp(BEGUN_UTC + t + ahead, timezone.utc).isoformat(timespec="milliseconds")
        lines.append(json.dumps({"t": round(mono + t, 4), "utc": utc, "who": who, "event": event, **values}))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def companion_entries() -> list[tuple[float, str, dict[str, Any]]]:
    """The companion's journal: views, positions, the handover at 30 s with its messages, the emergency."""
    found: list[tuple[float, str, dict[str, Any]]] = [
        (-1.0, "loaded", {"text": "handover"}),
        (-0.5, "view", _view("on_load", "GCSA", 1)),
        (0.0, "view", _view("on_mission", "GCSA", 1)),
        (30.0, "transfer_begun", {"station": "GCSB", "handover_id": 1, "reason": "zone"}),
        (30.0, "view", _view("on_handover", "GCSA", 1)),
        (30.2, "transfer_committed", {"station": "GCSB", "handover_id": 1, "epoch": 2, "duration_s": 0.2}),
        (30.2, "view", _view("on_mission", "GCSB", 2)),
        (40.0, "emergency", {"text": "coverage ends ahead: return", "reason": "coverage_ends"}),
        (0.5, "mode", {"text": "mode AUTO"}),
        (40.1, "mode", {"text": "mode RTL"}),
        (END_S, "landed", {"text": "disarmed: the flight is over"}),
        (50.0, "emergency_over", {"text": "the cause of the emergency is gone"}),
    ]
    for t in range(END_S):
        lat, lon, alt_m = place(t)
        found.append((float(t), "position", {"lat_deg": lat, "lon_deg": lon, "alt_m": alt_m}))
    found += [(t, "message", _message(name, "out", "GCSB")) for t, name in _DOWN]
    found += [(t + _WAY_S, "message", _message(name, "in", "GCSB")) for t, name in _UP]
    return sorted(found, key=lambda entry: entry[0])


#: messages between vehicle and GCSB, and how long each takes (s)
_DOWN = ((30.001, "HANDOVER_REQUEST"), (30.1, "CONNECT_HANDOVER"), (30.2, "HANDOVER_RESULT"))
_UP = ((30.05, "ON_HANDOVER"), (30.15, "DRONE_CONNECTED"))
_WAY_S = 0.004


def station_entries() -> list[tuple[float, str, dict[str, Any]]]:
    """GCSB's journal: the other ends of the messages."""
    found: list[tuple[float, str, dict[str, Any]]] = [(-1.0, "loaded", {"text": "handover_gcs"})]
    found += [(t + _WAY_S, "message", _message(name, "in", "")) for t, name in _DOWN]
    found += [(t, "message", _message(name, "out", "")) for t, name in _UP]
    return sorted(found, key=lambda entry: entry[0])


def _view(phase: str, commander: str, epoch: int) -> dict[str, Any]:
    return {"phase": phase, "commander": commander, "epoch": epoch, "lease": "held"}


def _message(name: str, direction: str, station: str) -> dict[str, Any]:
    values: dict[str, Any] = {"name": name, "direction": direction, "handover_id": 1, "epoch": 1}
    return {**values, "station": station} if station else values

# SPDX-License-Identifier: GPL-3.0-or-later

"""A recorded flight: the autopilot's messages with times, and what else its tlog shows of the companion of then.

A tlog is a row of stamps (UTC, microseconds, eight bytes, the highest first), each followed by a frame. It contains
what the companion heard of the autopilot and what it sent there: its leases, its own heartbeats, the commander's
commands and heartbeats. What it sent to the stations and heard of them is not in it.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ModeSourceSeen
from mavproxy_handover.core.common.model import LeaseState
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, GUARD_STATUS_TUNNEL, LEASE_TUNNEL
from mavproxy_handover.wire.lease import LEASE_VERSION, Lease, guard_status_version, unpack_guard_status, unpack_lease
from sitl.report.strand import Stamps
from sitl.report.tlog import frames

__all__ = ["COMMANDED", "Recording", "RecordingError", "read_tlog"]

#: leases under which a station commands
COMMANDED: Final = (LeaseState.HELD, LeaseState.TRANSFER)
_GCS: Final = mavlink.MAV_TYPE_GCS


class RecordingError(Exception):
    """The file is no recording that can be replayed. The message is one line."""


@dataclass(slots=True)
class Recording:
    """A flight. Times are UTC (s), and rise."""

    path: Path
    #: what kind of file it was, for people
    kind: str
    sysid: int
    #: the autopilot's own messages
    messages: list[tuple[float, Any]]
    #: the companion's own heartbeats: when its jobs of each second were done
    beats: list[float] = field(default_factory=list)
    leases: list[tuple[float, Lease]] = field(default_factory=list)
    #: heartbeats of stations that went to the autopilot: the commander's
    station_beats: dict[int, list[float]] = field(default_factory=dict)
    #: commands to the autopilot that ask for a mode
    hands: list[tuple[float, ModeSourceSeen]] = field(default_factory=list)
    #: the guard's words are among the messages
    guarded: bool = False
    #: messages that could not be read, and bytes that were no part of one
    unreadable: int = 0
    spoilt: int = 0
    #: what the file does not hold and is assumed instead, in words
    assumed: list[str] = field(default_factory=list)

    @property
    def begin(self) -> float:
        """The first message."""
        return self.messages[0][0]

    @property
    def end(self) -> float:
        """The last one."""
        return self.messages[-1][0]

    def runs(self) -> list[tuple[float, int]]:
        """When each run of the companion began to send leases, and their nonce.

        Without leases in the file there are no runs.
        """
        found: list[tuple[float, int]] = []
        for at, lease in self.leases:
            if not found or found[-1][1] != lease.nonce:
                found.append((at, lease.nonce))
        return found


def read_tlog(path: Path) -> Recording:
    """Read a tlog. Raises RecordingError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None
    spoilt: list[int] = []
    decoder = mavlink.MAVLink(None)
    decoded: list[tuple[float, Any, Frame]] = []
    unreadable = 0
    stamps = Stamps()
    for at, frame in frames(data, spoilt):
        if not stamps.believed(at):
            unreadable += 1
            continue
        try:
            decoded.append((at, decoder.decode(bytearray(frame.raw)), frame))
        except (mavlink.MAVError, struct.error, ValueError):
            unreadable += 1
    decoded.sort(key=lambda entry: entry[0])
    sysids = Counter(
        message.get_srcSystem()
        for _at, message, _frame in decoded
        if message.get_type() == "HEARTBEAT"
        and message.get_srcComponent() == AUTOPILOT_COMPID
        and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        and message.type != _GCS
    )
    if not sysids:
        raise RecordingError(f"{path}: no heartbeat of an autopilot in it ({len(decoded)} messages)")
    sysid = sysids.most_common(1)[0][0]
    recording = Recording(path, "tlog", sysid, [], unreadable=unreadable, spoilt=sum(spoilt))
    for at, message, frame in decoded:
        _sort(recording, at, message, frame)
    if not any(message.get_type() == "GLOBAL_POSITION_INT" for _at, message in recording.messages):
        raise RecordingError(f"{path}: no position (GLOBAL_POSITION_INT) of vehicle {sysid} in it")
    return recording


def _sort(recording: Recording, at: float, message: Any, frame: Frame) -> None:
    system, component, kind = message.get_srcSystem(), message.get_srcComponent(), message.get_type()
    if system == recording.sysid and component == AUTOPILOT_COMPID:
        if kind == "TUNNEL" and message.payload_type == GUARD_STATUS_TUNNEL:
            message = _in_todays_layout(message)
            recording.guarded |= unpack_guard_status(bytes(message.payload)[: message.payload_length]) is not None
        recording.messages.append((at, message))
    elif system == recording.sysid and component == COMPANION_COMPID:
        if kind == "HEARTBEAT":
            recording.beats.append(at)
        elif kind == "TUNNEL" and message.payload_type == LEASE_TUNNEL:
            lease = unpack_lease(bytes(message.payload)[: message.payload_length])
            if lease is not None:
                recording.leases.append((at, lease))
    elif system != recording.sysid:
        if kind == "HEARTBEAT":
            recording.station_beats.setdefault(system, []).append(at)
            return
        addressed = getattr(message, "target_system", 0) == recording.sysid
        hand = mode_requests.of_command(frame) if addressed else None
        if hand is not None:
            recording.hands.append((at, hand))


def _in_todays_layout(message: Any) -> Any:
    """A guard's status of layout 1 in the layout of today.

    The companion of a replay is of today, and would find the guard of the recording older than itself. Its nonce, which
    layout 1 has not, is 1.
    """
    body = bytes(message.payload)[: message.payload_length]
    if guard_status_version(body) != 1:
        return message
    today = bytes([LEASE_VERSION]) + body[1:] + (1).to_bytes(4, "little")
    told = mavlink.MAVLink_tunnel_message(
        message.target_system, message.target_component, message.payload_type, len(today), list(today.ljust(128, b"\0"))
    )
    told._header, told._timestamp = message.get_header(), getattr(message, "_timestamp", 0.0)
    return told

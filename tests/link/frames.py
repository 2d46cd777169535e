# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames, clocks and devices for the tests of links."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.base import Device, LinkCounters
from mavproxy_handover.wire.frames import Frame, parse_one
from sitl.vehicles.ports import PortPicker

STATION, STATION_COMPONENT = 251, 190


def frame_of(message: Any, seq: int = 0, sysid: int = STATION, compid: int = STATION_COMPONENT) -> Frame:
    sender = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    sender.seq = seq
    frame = parse_one(bytes(message.pack(sender)))
    assert frame is not None
    return frame


def heartbeat(seq: int = 0, sysid: int = STATION, compid: int = STATION_COMPONENT) -> Frame:
    message = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    return frame_of(message, seq, sysid, compid)


def command(seq: int = 0, number: int = mavlink.MAV_CMD_NAV_LAND) -> Frame:
    """The same command each time; only its sequence number differs."""
    return frame_of(mavlink.MAVLink_command_long_message(1, 1, number, 0, 0, 0, 0, 0, 0, 0, 0), seq)


def answer(stamp: int, seq: int = 0) -> Frame:
    """A station's answer to a probe."""
    return frame_of(mavlink.MAVLink_timesync_message(123_456_789, stamp), seq)


class Clock:
    """Seconds that only a test moves."""

    def __init__(self, now: float = 100.0) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


class Draw:
    """Bits that are not random: 1, 2, 3, ..."""

    def __init__(self) -> None:
        self.value = 0

    def __call__(self, bits: int) -> int:
        self.value = (self.value + 1) & ((1 << bits) - 1)
        return self.value


class FakeDevice:
    """A device that a test fills and looks into."""

    def __init__(self, device: str, on_write: Callable[[bytes], None] | None = None) -> None:
        self.device = device
        self.counters = LinkCounters()
        self.open = True
        self.full = False
        self.inbox: list[Frame] = []
        self.sent: list[bytes] = []
        self.accepted: list[Frame] = []
        self.closed = False
        self._on_write = on_write

    def read(self, once: bool = False) -> list[Frame]:
        frames, self.inbox = self.inbox, []
        return frames

    def write(self, data: bytes) -> bool:
        if self.full or not self.open:
            return False
        self.sent.append(data)
        if self._on_write is not None:
            self._on_write(data)
        return True

    def write_more(self, data: bytes) -> bool:
        return self.write(data)

    def flush(self) -> None:
        pass

    @property
    def flow_controlled(self) -> bool:
        return False

    def accept_sender(self, frame: Frame) -> bool:
        self.accepted.append(frame)
        return True

    def close(self) -> None:
        self.closed = True


def read_until(device: Device, condition: Callable[[], bool], timeout_s: float = 10.0) -> list[Frame]:
    """Read a device until the condition holds; its frames. Fails when that takes too long."""
    frames: list[Frame] = []
    deadline_s = time.monotonic() + timeout_s
    while True:
        frames += device.read()
        if condition():
            return frames
        assert time.monotonic() < deadline_s, f"{device.device}: {device.trouble or 'nothing happened'}"
        fileno = device.fileno()
        select.select([fileno] if fileno >= 0 else [], [], [], 0.005)


def read_frames(device: Device, count: int, timeout_s: float = 10.0) -> list[Frame]:
    """Read a device until it has given so many frames."""
    frames: list[Frame] = []
    deadline_s = time.monotonic() + timeout_s
    while len(frames) < count:
        assert time.monotonic() < deadline_s, f"{device.device}: {len(frames)} of {count} frames"
        fileno = device.fileno()
        select.select([fileno] if fileno >= 0 else [], [], [], 0.005)
        frames += device.read()
    return frames


def free_udp_port() -> int:
    """A port of 127.0.0.1 that nobody has now."""
    return PortPicker().udp()

# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes to a serial line that MAVProxy has opened, to an autopilot or to a modem.

MAVProxy opens its lines without a time-out for writing. Then pyserial, and with it the main loop, waits until the line
has taken everything. With a time-out of 0 pyserial spins. So its `write` is replaced by this one. Rules:

1. It never waits. Up to a few frames are kept if the line does not take them now, and leave with the next write.
2. A frame is taken as a whole or not at all, because a cut frame would cost the next one too.
3. A lost line raises OSError, as with pyserial. MAVProxy then opens it again.
4. The last `LEASE_ROOM` bytes of room are the lease's: other frames, however many, never keep it from the line.
"""

from __future__ import annotations

import errno
import os
from typing import Any, Final

import serial
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.base import OutBuffer

__all__ = ["LEASE_ROOM", "LineWriter", "has_rate", "is_line", "line_baud"]

#: several leases
LEASE_ROOM: Final = 512
#: the message that the lease travels in, as the head of a frame has it
_TUNNEL: Final = mavlink.MAVLINK_MSG_ID_TUNNEL.to_bytes(3, "little")


#: serial devices of USB, by a part of their path: their baud rate has no effect
_USB: Final = ("ttyACM", "usbmodem")


def has_rate(path: str) -> bool:
    """Whether the baud rate of the serial device at this path limits it: not if the device is USB itself."""
    return not any(part in os.path.realpath(path) for part in _USB)


def line_baud(port: Any) -> int | None:
    """The baud rate of a port of MAVProxy's links; None: it has none that limits it (UDP, TCP, USB)."""
    return port.baudrate if isinstance(port, serial.Serial) and has_rate(str(port.port)) else None


def is_line(port: Any) -> bool:
    """True if it is an open serial line with a descriptor (never on Windows)."""
    return isinstance(port, serial.Serial) and hasattr(port, "fd") and port.is_open


class LineWriter:
    """The writer of one serial line."""

    def __init__(self, port: Any) -> None:
        """`port`: see `is_line`. Its `write` is replaced until `release`."""
        self.port = port
        #: number of frames without room
        self.refused = 0
        self._out = OutBuffer()
        port.write = self.write

    def write(self, data: bytes) -> int:
        """Send a frame now or soon, or drop it. Returns its length, as pyserial does. Raises OSError."""
        data = bytes(data)
        spare = 0 if data[7:10] == _TUNNEL else LEASE_ROOM
        if not len(self._out):  # nearly always so
            try:
                taken = self._send(data)
            except (BlockingIOError, InterruptedError):
                taken = 0
            if taken == len(data) or self._out.add(data[taken:], spare=spare):
                return len(data)
        self.push()
        if not self._out.add(data, spare=spare):
            self.refused += 1
        self.push()
        return len(data)

    def push(self) -> None:
        """Send the waiting bytes that the line takes. Call it often. Raises OSError."""
        if len(self._out):
            self._out.drain(self._send)

    def _send(self, data: bytes) -> int:
        if self.port.fd is None:  # closed: its descriptor may be another file's by now
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        return os.write(self.port.fd, data)

    def release(self) -> None:
        """Restore pyserial's `write`."""
        self.port.__dict__.pop("write", None)

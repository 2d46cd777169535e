# SPDX-License-Identifier: GPL-3.0-or-later

"""Writing to a serial line that MAVProxy has opened: a companion's to the autopilot, a station's to its modem.

MAVProxy opens its lines without a time-out for writing: pyserial then waits until the line takes everything, and the
main loop with it; with a time-out of 0 it spins. So its `write` is replaced by this one. Rules:

1. It never waits. What the line does not take now is kept, up to a few frames, and leaves with the next write.
2. A frame is taken whole, or not at all: one that is cut would cost the next one too.
3. A line that is gone raises OSError, as pyserial's does: MAVProxy opens it again.
"""

from __future__ import annotations

import errno
import os
from typing import Any

import serial

from mavproxy_handover.link.base import OutBuffer

__all__ = ["LineWriter", "is_line"]


def is_line(port: Any) -> bool:
    """Whether it is an open serial line that has a descriptor (not so on Windows)."""
    return isinstance(port, serial.Serial) and hasattr(port, "fd") and port.is_open


class LineWriter:
    """The way out of one serial line."""

    def __init__(self, port: Any) -> None:
        """`port`: see `is_line`. Its `write` is this one's until `release`."""
        self.port = port
        #: frames that found no room
        self.refused = 0
        self._out = OutBuffer()
        port.write = self.write

    def write(self, data: bytes) -> int:
        """Send a frame, now or soon, or lose it. Returns its length, as pyserial does. Raises OSError."""
        data = bytes(data)
        if not len(self._out):  # nearly always so
            try:
                taken = self._send(data)
            except (BlockingIOError, InterruptedError):
                taken = 0
            if taken == len(data) or self._out.add(data[taken:]):
                return len(data)
        self.push()
        if not self._out.add(data):
            self.refused += 1
        self.push()
        return len(data)

    def push(self) -> None:
        """Send what waits, as far as the line takes it; to be called often. Raises OSError."""
        if len(self._out):
            self._out.drain(self._send)

    def _send(self, data: bytes) -> int:
        if self.port.fd is None:  # closed: its number may be another file's by now
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        return os.write(self.port.fd, data)

    def release(self) -> None:
        """The line is written to as before."""
        self.port.__dict__.pop("write", None)

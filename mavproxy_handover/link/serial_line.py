# SPDX-License-Identifier: GPL-3.0-or-later

"""Serial links (radio modems). They do not block, and reconnect by themselves after the device was unplugged.

pyserial opens and configures the line. Bytes are moved on its descriptor directly, because pyserial's own `write` spins
while the line takes nothing.

The time-out for an incomplete frame is 1.5 times the time that the longest frame takes at the line's rate. Below 16800
baud that is longer than `wire.frames.PATIENCE_S`.

A device that is missing at construction is no fault, because it may be plugged in later. No right to use it, another
program on it, or an unsupported rate are faults.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from typing import Final

import serial

from mavproxy_handover.link.base import Backoff, Clock, Device, OutBuffer, reason
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError
from mavproxy_handover.link.polling import poll
from mavproxy_handover.wire.frames import MAX_FRAME_BYTES, PATIENCE_S, Frame, FrameSplitter

__all__ = ["SerialLine"]

_READ_BYTES: Final = 4096
_BITS_OF_BYTE: Final = 10
_ABSENT: Final = (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO)


class SerialLine(Device):
    """A serial line at a fixed rate."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic) -> None:
        """Raises LinkError: no right, in use, no serial line, unsupported rate."""
        assert spec.kind is Kind.SERIAL
        if sys.platform == "win32":
            raise LinkError(f"link {spec.text} is a serial line, which needs Linux or macOS here: use UDP or TCP")
        super().__init__(spec.text, clock)
        self._path, self._baud = spec.host, spec.port
        self._backoff = Backoff(most_s=5.0)
        self._port: serial.Serial | None = None
        self._patience_s = max(PATIENCE_S, 1.5 * MAX_FRAME_BYTES * _BITS_OF_BYTE / self._baud)
        self._splitter = FrameSplitter(patience_s=self._patience_s)
        self._out = OutBuffer()
        self._hang_up = poll()
        fault = self._connect()
        if fault is not None and getattr(fault, "errno", None) not in _ABSENT:
            hint = "; is the user in group dialout?" if getattr(fault, "errno", None) == errno.EACCES else ""
            raise LinkError(f"link {spec.text} cannot be opened: {_words(fault)}{hint}")

    @property
    def open(self) -> bool:
        return self._port is not None

    @property
    def unfinished(self) -> bool:
        return self._splitter.waiting > 0

    def fileno(self) -> int:
        return -1 if self._port is None else int(self._port.fileno())

    def read(self, once: bool = False) -> list[Frame]:
        if self._closed:
            return []
        if self._port is None:
            if self._backoff.due(self._clock()):
                self._connect()
            return []
        try:
            # reading an unplugged device returns nothing, as for a silent one
            if self._hang_up.poll(0):
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            self._push()
            data = os.read(self._port.fileno(), _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            data = b""
        except OSError as error:
            self._failed(error)
            self._shut()
            return []
        if not data and not self._splitter.waiting:
            return []
        return self._split(self._splitter, data, self._clock())

    def write(self, data: bytes) -> bool:
        return self._put(data) or self._refused()

    def write_more(self, data: bytes) -> bool:
        return self._put(data, more=True)

    def _put(self, data: bytes, more: bool = False) -> bool:
        if self._port is None:
            return False
        try:
            self._push()
            if not self._out.add(data, more):
                return False
            self._push()
        except OSError as error:  # it is closed in the next `read`
            self._failed(error)
            return False
        return self._sent(data)

    def _push(self) -> None:
        assert self._port is not None
        descriptor = self._port.fileno()
        self._out.drain(lambda data: os.write(descriptor, data))

    def _connect(self) -> Exception | None:
        """Open the line; returns the error if that fails."""
        self._backoff.tried(self._clock())
        try:
            self._port = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
        except Exception as error:  # OSError, ValueError (the rate), termios.error: pyserial passes all of them on
            self.counters.errors += 1
            self.trouble = _words(error)
            return error
        self._backoff.succeeded()
        self._hang_up.register(self._port.fileno(), 0)  # hang-up and error are always reported
        self._splitter = FrameSplitter(patience_s=self._patience_s)
        self.counters.connects += 1
        self.trouble = ""
        return None

    def _shut(self) -> None:
        if self._port is None:
            return
        port, self._port = self._port, None
        self._out.clear()
        try:
            self._hang_up.unregister(port.fileno())
            port.reset_output_buffer()  # closing would wait for the unsent bytes
        except Exception:  # the device is gone
            pass
        try:
            port.close()
        except Exception:
            pass


def _words(error: Exception) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if isinstance(number, int) else reason(error)

# SPDX-License-Identifier: GPL-3.0-or-later

"""One MAVLink channel: what came in, what goes out, at which rates.

Channel numbers are serial numbers. A channel without a client discards what it would send; one whose client
does not read drops new messages once its buffer is full, as a serial port does. Stream rates outlive the
client.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.framing import FrameSplitter
from sitl.vehicles.builtin.params import Parameter

__all__ = ["Link"]

_BUFFER_LIMIT = 65536


@dataclass(slots=True)
class Schedule:
    """A message that is sent again and again: period in seconds of simulated time, and when it is due."""

    period_s: float
    due_s: float


@dataclass(slots=True)
class Link:
    """State of one channel."""

    channel: int
    sysid: int
    connected: bool = False
    heard: bool = False
    """Something valid has arrived: the autopilot calls such a channel active."""
    splitter: FrameSplitter = field(default_factory=FrameSplitter)
    schedule: dict[int, Schedule] = field(default_factory=dict)
    parameter_list: Iterator[tuple[int, Parameter]] | None = None
    timesync_due_s: float = 10.0
    dropped: int = 0
    _mav: dialect.MAVLink = field(init=False)
    _out: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self._mav = dialect.MAVLink(None, srcSystem=self.sysid, srcComponent=1)

    def set_sysid(self, sysid: int) -> None:
        self._mav.srcSystem = sysid

    def set_interval(self, message: int, period_s: float, now_s: float) -> None:
        """Send `message` every `period_s`; zero stops it."""
        if period_s <= 0:
            self.schedule.pop(message, None)
        else:
            self.schedule[message] = Schedule(period_s, now_s + period_s)

    def send(self, message: dialect.MAVLink_message) -> bool:
        """Queue a message of the autopilot. False: dropped."""
        if not self.room():
            return False
        self._out += message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return True

    def send_raw(self, frame: bytes) -> bool:
        """Queue a frame of another sender, unchanged."""
        if not self.room():
            return False
        self._out += frame
        return True

    def room(self) -> bool:
        if not self.connected or len(self._out) > _BUFFER_LIMIT:
            self.dropped += 1
            return False
        return True

    @property
    def pending(self) -> int:
        return len(self._out)

    def take(self) -> bytes:
        """The bytes for the client now."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def give_back(self, data: bytes) -> None:
        """The client did not take all of it."""
        self._out[:0] = data

    def attach(self) -> None:
        """A client connected: begin with clean buffers."""
        self.connected = True
        self.splitter = FrameSplitter()
        self._out.clear()

    def detach(self) -> None:
        self.connected = False
        self.parameter_list = None
        self._out.clear()

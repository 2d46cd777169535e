# SPDX-License-Identifier: GPL-3.0-or-later

"""The connection to the position box: a TCP client that only receives, and returns the newest record.

Rules that live here:

1. After construction nothing raises and nothing waits. Construction raises LinkError for an unknown host.
2. One `read` takes a limited number of bytes, and less than a record of the stream is kept. A box that sends more than
   is read makes its own records late, which shows (`Fix.late_s`), and delays nothing else. The first bytes of each
   connection are kept too, for people who compare layouts.
3. A connection is closed and replaced in three cases. The other side closes it; its data is no longer valid
   (`wire/box_record.py`: only a new connection has a known beginning); or it brings no new record for SILENT_S, which
   TCP alone does not detect.
4. The intervals between attempts grow up to MOST_WAIT_S, until a record has come. A box in flight is needed again soon,
   and a box that sends nonsense is not asked without end.
"""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.link.base import Backoff, Clock, reason
from mavproxy_handover.link.dialling import Dialling
from mavproxy_handover.link.forms import Kind, LinkError, parse_device
from mavproxy_handover.link.names import Names
from mavproxy_handover.wire.box_layout import THESIS, BoxLayout, BoxRecord
from mavproxy_handover.wire.box_record import LEAP_S, BoxStream, Lateness

__all__ = ["MOST_WAIT_S", "SILENT", "SILENT_S", "BoxCounters", "BoxLine", "Fix", "box_address"]

_READ_BYTES: Final = 8192
#: reads in one call: some 580 records, twenty times a second
_READS: Final = 4
_FIRST_WAIT_S, MOST_WAIT_S = 0.25, 2.0
#: after this time (s) without a new record the connection is replaced
SILENT_S: Final = 3.0
#: text of that error
SILENT: Final = f"nothing new for {SILENT_S:g} s"
assert SILENT_S < LEAP_S, "a silent box gets a new connection before its time may leap"
#: first bytes of a connection that are kept, for people who compare layouts
_HEAD_BYTES: Final = 1024


@dataclass(slots=True)
class BoxCounters:
    """Counters of a box since the start."""

    bytes_in: int = 0
    #: new records
    records: int = 0
    connects: int = 0
    #: failed attempts, and connections that were lost or closed here
    errors: int = 0


@dataclass(frozen=True, slots=True)
class Fix:
    """A record, and its delay (s) relative to the fastest record of its connection."""

    record: BoxRecord
    late_s: float


def box_address(text: object) -> str:
    """Check the address of a box, tcp:HOST:PORT, and return it. Raises LinkError."""
    spec = parse_device(text)
    if spec.kind is not Kind.TCP_OUT:
        raise LinkError(f"link {text!r} must be tcp:HOST:PORT: the box is a TCP server")
    return spec.text


class BoxLine:
    """A connection to `tcp:HOST:PORT` that is made again after a loss. See the module's rules."""

    def __init__(
        self,
        text: str,
        clock: Clock = time.monotonic,
        names: Names | None = None,
        layout: BoxLayout = THESIS,
    ) -> None:
        """`names`: see `Dialling`. Raises LinkError for a wrong address, and without `names` also for an
        unknown host.
        """
        self.device = box_address(text)
        self.layout = layout
        self.counters = BoxCounters()
        #: text of the last error; "" while records come
        self.trouble = ""
        #: first bytes of the last connection that brought any
        self.head = b""
        self._clock = clock
        self._backoff = Backoff(_FIRST_WAIT_S, MOST_WAIT_S)
        self._dialling = Dialling(parse_device(text), self._backoff, self._give_up, names)
        self._socket: socket.socket | None = None
        self._stream, self._lateness = BoxStream(layout), Lateness()
        self._raw = b""
        #: True until data comes over this connection
        self._begins = True
        #: time of the last new record, or of the connection
        self._news_at = 0.0
        self._closed = False
        self._dialling.begin(clock())

    @property
    def open(self) -> bool:
        """True if it is connected."""
        return self._socket is not None

    def fileno(self) -> int:
        """Descriptor to wait for until the next `read`; -1 while it is not connected."""
        return -1 if self._socket is None else self._socket.fileno()

    def descriptors(self) -> list[int]:
        """Open descriptors. A child process must not keep them. They may change in `read`."""
        return self._dialling.descriptors() + ([] if self._socket is None else [self._socket.fileno()])

    def read(self) -> Fix | None:
        """Return the newest record since the last call, if there is one, and maintain the connection."""
        if self._closed:
            return None
        now = self._clock()
        if self._socket is None:
            self._socket = self._dialling.poll(now)
            if self._socket is None:
                return None
            self.counters.connects += 1
            self._stream, self._lateness = BoxStream(self.layout), Lateness()
            self._begins = True
            self._news_at = now
        fix = self._receive(self._socket, now)
        if self._socket is not None and now - self._news_at >= SILENT_S:
            self._give_up(SILENT)
        return fix

    def raw(self) -> bytes:
        """Bytes of the newest complete record since the last call, valid or not; empty if there is none."""
        raw, self._raw = self._raw, b""
        return raw

    def _receive(self, sock: socket.socket, now: float) -> Fix | None:
        """Read the data that has come. Data that came before a connection was lost counts."""
        fix = None
        for _ in range(_READS):
            try:
                data = sock.recv(_READ_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                self._give_up(reason(error))
                break
            if not data:
                self._give_up("closed by the other side")
                break
            if self._begins or len(self.head) < _HEAD_BYTES:
                self.head = ((b"" if self._begins else self.head) + data)[:_HEAD_BYTES]
                self._begins = False
            self.counters.bytes_in += len(data)
            for record in self._stream.feed(data):
                self.counters.records += 1
                fix = Fix(record, self._lateness.of(record.time_s, now))
            self._raw = self._stream.last or self._raw
            if self._stream.broken:
                self._give_up(self._stream.broken)
                break
        if fix is not None:
            self._news_at = now
            if self._socket is not None:
                self._backoff.succeeded()
                self.trouble = ""
        return fix

    def close(self) -> None:
        """Close the connection. It cannot be used again. May be called twice."""
        self._closed = True
        self._shut()

    def _give_up(self, why: str) -> None:
        self.counters.errors += 1
        self.trouble = why
        self._shut()

    def _shut(self) -> None:
        self._dialling.shut()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

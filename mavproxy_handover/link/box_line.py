# SPDX-License-Identifier: GPL-3.0-or-later

"""The connection to the position box: a TCP client that only listens, and hands out the newest record.

Rules that live here:

1. After its construction nothing raises and nothing waits. Construction raises LinkError: an unknown host.
2. One `read` takes a bounded number of bytes, and what is kept of a stream is less than a record. A box that sends more
   than is read makes its own records late, which shows (`Fix.late_s`); it holds up nobody else. Of each connection the
   first bytes are kept too, for people who compare layouts.
3. A connection is given up, and another one made, when the other side ends it, when what it sends is not believed any
   more (`wire/box_record.py`: only a new connection has a beginning that is known), and when it brings nothing new for
   SILENT_S, which TCP alone would not notice.
4. Attempts grow rarer, to one in MOST_WAIT_S, until a record has come: a box in flight is wanted back soon, and one
   that sends nonsense is not asked without end.
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
#: reads in one go: some 580 records, twenty times a second
_READS: Final = 4
_FIRST_WAIT_S, MOST_WAIT_S = 0.25, 2.0
#: nothing new for so long: the connection is of no use
SILENT_S: Final = 3.0
#: and this is said of it
SILENT: Final = f"nothing new for {SILENT_S:g} s"
assert SILENT_S < LEAP_S, "a box that was silent is connected to anew before its time may leap"
#: bytes kept of the beginning of a connection, for people who compare layouts
_HEAD_BYTES: Final = 1024


@dataclass(slots=True)
class BoxCounters:
    """What came of a box since the start."""

    bytes_in: int = 0
    #: new ones
    records: int = 0
    connects: int = 0
    #: attempts that came to nothing, and connections that were lost or given up
    errors: int = 0


@dataclass(frozen=True, slots=True)
class Fix:
    """A record, and how much later than the quickest of its connection it came (s)."""

    record: BoxRecord
    late_s: float


def box_address(text: object) -> str:
    """`text`, if it says where a box is: tcp:HOST:PORT. Raises LinkError."""
    spec = parse_device(text)
    if spec.kind is not Kind.TCP_OUT:
        raise LinkError(f"link {text!r} must be tcp:HOST:PORT: the box is a TCP server")
    return spec.text


class BoxLine:
    """Connects to `tcp:HOST:PORT`, again and again. See the module's rules."""

    def __init__(
        self,
        text: str,
        clock: Clock = time.monotonic,
        names: Names | None = None,
        layout: BoxLayout = THESIS,
    ) -> None:
        """`names`: see `Dialling`. Raises LinkError: no form of a box; without `names` an unknown host too."""
        self.device = box_address(text)
        self.layout = layout
        self.counters = BoxCounters()
        #: the last thing that went wrong, in words; "" while records come
        self.trouble = ""
        #: how the last connection that brought anything began
        self.head = b""
        self._clock = clock
        self._backoff = Backoff(_FIRST_WAIT_S, MOST_WAIT_S)
        self._dialling = Dialling(parse_device(text), self._backoff, self._give_up, names)
        self._socket: socket.socket | None = None
        self._stream, self._lateness = BoxStream(layout), Lateness()
        self._raw = b""
        #: nothing has come over this connection yet
        self._begins = True
        #: the last new record, or the connection
        self._news_at = 0.0
        self._closed = False
        self._dialling.begin(clock())

    @property
    def open(self) -> bool:
        """Whether it is connected."""
        return self._socket is not None

    def fileno(self) -> int:
        """To wait for until the next `read`; -1 while it is not connected."""
        return -1 if self._socket is None else self._socket.fileno()

    def descriptors(self) -> list[int]:
        """What is open now; a child process must not keep it. May change in `read`."""
        return self._dialling.descriptors() + ([] if self._socket is None else [self._socket.fileno()])

    def read(self) -> Fix | None:
        """The newest record that has come since the last call, if one has; also looks after the connection."""
        if self._closed:
            return None
        now = self._clock()
        if self._socket is None:
            self._socket = self._dialling.look(now)
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
        """The bytes of the newest whole record since the last call, believed or not; none if there is no new one."""
        raw, self._raw = self._raw, b""
        return raw

    def _receive(self, sock: socket.socket, now: float) -> Fix | None:
        """Read what has come; what came before a connection was lost counts."""
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
        """Close for good; may be called twice."""
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

# SPDX-License-Identifier: GPL-3.0-or-later

"""TCP links.

A stalled stream must be noticed and closed, because everything written to it meanwhile arrives late. So there are few
unsent bytes, here and in the system. The system closes a connection whose bytes are not acknowledged for some seconds.
Bytes of a lost connection are never sent on the next one.

`tcp` connects without waiting, and reconnects after a loss, at growing intervals.

`tcpin` listens. It has one client. More connections may exist, so that a station whose old connection is dead can
reconnect, and connections of unknown senders do not exclude the station:

* the client is the connection whose frame was last called genuine (`accept_sender`). A client that was heard within
  PEER_HOLD_S is not replaced. A connection that proved genuine is never closed in favour of one that did not;
* a new connection is read before any connection is closed for it. Connections are closed in the next `read`, when it is
  known which ones are genuine;
* the one to close is the oldest unproven connection of the address that has the most of them. So a flood from one
  address does not exclude a station at another address. A station that shares the address has some tenths of a second
  for its first frame;
* little is read at once from unproven connections, so that the client does not wait. Those that have sent least are
  read first.

While no connection has proved genuine, the newest one is written to (of an address that has the fewest). Some programs
send nothing before they hear a vehicle. Other unproven connections are closed after a while. There are never more
connections than _STRANGERS + _TAKEN + _GENUINE.

A web page can make the operator's browser send bytes of its choice to any port of this computer, after the head of a
request. So `tcpin` closes a connection that begins as such a request, before a frame in it is looked for.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from typing import Final

from mavproxy_handover.link.base import PEER_HOLD_S, Backoff, Clock, Device, OutBuffer, reason
from mavproxy_handover.link.dialling import Dialling, tune
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError
from mavproxy_handover.link.names import Names, endpoint, hear_both_kinds, host_of
from mavproxy_handover.link.polling import Poll, poll
from mavproxy_handover.wire.frames import Frame, FrameSplitter

__all__ = ["TcpIn", "TcpOut"]

_READ_BYTES: Final = 8192
#: bytes read at once from one unproven connection, and from all of these except new ones together
_STRANGER_READ_BYTES: Final = 512
_STRANGERS_READ_BYTES: Final = 8192
#: connections that wait for the next `read`; the system rejects more
_BACKLOG: Final = 128
#: connections accepted in one `read`
_TAKEN: Final = 32
#: most connections kept that are not proven, and that are
_STRANGERS: Final = 32
_GENUINE: Final = 4
_UNPROVEN_S: Final = 10.0
#: beginnings of the requests that a browser sends for a page; no frame begins so
_OF_BROWSER: Final = (b"GET ", b"HEAD ", b"POST ", b"PUT ", b"PATCH ", b"DELETE ", b"OPTIONS ", b"CONNECT ", b"TRACE ")
_BEGINNING: Final = max(map(len, _OF_BROWSER))


class _Lost(Exception):
    """A connection is lost; the text says why."""


class _Connection:
    """One connection: splitter, unsent bytes. Only its owner closes it, in `read` (see `fileno`)."""

    def __init__(self, sock: socket.socket, since: float, host: str) -> None:
        self.socket = sock
        self.since = since
        self.host = host
        self.bytes_in = 0
        self.beginning = b""  #: its first bytes, _BEGINNING at most
        self.splitter = FrameSplitter()
        self.heard_at: float | None = None  #: time of the last genuine frame
        self.replaced = False  #: another connection is the client now; this one is closed in the next `read`
        self._out = OutBuffer()
        self._lost = ""

    @property
    def waits(self) -> bool:
        """True if `receive` has work although nothing has arrived."""
        return len(self._out) > 0 or self._lost != ""

    def send(self, data: bytes, more: bool = False) -> bool:
        """Add a frame and send what can be sent now. `more`: it belongs to a download and may wait for the next."""
        if more and not self._lost and self._out.add(data, more):
            return True
        self.push()
        if self._lost or not self._out.add(data, more):
            return False
        if not more:
            self.push()
        return not self._lost

    def push(self) -> None:
        """Send the waiting bytes that the system takes."""
        try:
            self._out.drain(self.socket.send)
        except OSError as error:
            self._lost = reason(error)

    def receive(self, limit: int) -> bytes:
        """Read at most `limit` bytes, and send waiting bytes. Raises _Lost."""
        self.push()
        if self._lost:
            raise _Lost(self._lost)
        try:
            data = self.socket.recv(limit)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            raise _Lost(reason(error)) from None
        if not data:
            raise _Lost("closed by the other side")
        self.bytes_in += len(data)
        return data


class TcpOut(Device):
    """A connection to `HOST:PORT` that is made again after a loss."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic, names: Names | None = None) -> None:
        """`names`: see `Dialling`. Raises LinkError for an unknown host."""
        assert spec.kind is Kind.TCP_OUT
        super().__init__(spec.text, clock)
        self._backoff = Backoff()
        self._connection: _Connection | None = None
        self._dialling = Dialling(spec, self._backoff, self._give_up, names)
        self._dialling.begin(self._clock())

    @property
    def open(self) -> bool:
        return self._connection is not None

    @property
    def unfinished(self) -> bool:
        return self._connection is not None and self._connection.splitter.waiting > 0

    def fileno(self) -> int:
        return -1 if self._connection is None else self._connection.socket.fileno()

    def descriptors(self) -> list[int]:
        return self._dialling.descriptors() + super().descriptors()

    def read(self, once: bool = False) -> list[Frame]:
        if self._closed:
            return []
        if self._connection is None:
            self._see_to_connecting()
            return []
        try:
            data = self._connection.receive(_READ_BYTES)
        except _Lost as loss:
            self._give_up(str(loss))
            return []
        if data:
            self._backoff.succeeded()
        elif not self._connection.splitter.waiting:
            return []
        return self._split(self._connection.splitter, data, self._clock())

    def write(self, data: bytes) -> bool:
        if self._connection is None or not self._connection.send(data):
            return self._refused()
        return self._sent(data)

    def write_more(self, data: bytes) -> bool:
        return self._connection is not None and self._connection.send(data, more=True) and self._sent(data)

    def flush(self) -> None:
        if self._connection is not None:
            self._connection.push()

    def _see_to_connecting(self) -> None:
        now = self._clock()
        made = self._dialling.poll(now)
        if made is not None:
            self._connection = _Connection(made, now, self._dialling.address[0])
            self.counters.connects += 1
            self.trouble = ""

    def _give_up(self, why: str) -> None:
        self.counters.errors += 1
        self.trouble = why
        self._shut()

    def _shut(self) -> None:
        self._dialling.shut()
        if self._connection is not None:
            self._connection.socket.close()
            self._connection = None


class TcpIn(Device):
    """Listens on `HOST:PORT` for one client."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic) -> None:
        """Raises LinkError: port in use, not an address of this machine."""
        assert spec.kind is Kind.TCP_IN
        super().__init__(spec.text, clock)
        self._clients: list[_Connection] = []  # oldest first
        self._proven: _Connection | None = None
        #: connection that is written to while none has proved genuine
        self._favoured: _Connection | None = None
        self._arrivals = poll()
        self._senders: dict[int, _Connection] = {}
        self._last: list[Frame] = []
        self._listener: socket.socket | None = None
        try:
            family, address = endpoint(spec)
            self._listener = socket.socket(family, socket.SOCK_STREAM)
            hear_both_kinds(self._listener)
            # a restarted companion must not wait until the system forgets its former connections
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind(address)
            self._listener.listen(_BACKLOG)
            self._listener.setblocking(False)
            self._arrivals.register(self._listener, Poll.READ)
        except OSError as error:
            if self._listener is not None:
                self._listener.close()
            raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None

    @property
    def open(self) -> bool:
        return self._served is not None

    @property
    def _served(self) -> _Connection | None:
        return self._proven or self._favoured

    @property
    def unfinished(self) -> bool:
        return any(client.splitter.waiting for client in self._clients)

    def fileno(self) -> int:
        """The client's descriptor. Without a client it is the listening socket's, or that of a single unproven
        connection.

        New connections and data of other connections wait for the next read.
        """
        if self._served is not None and (self._proven is not None or len(self._clients) == 1):
            return self._served.socket.fileno()
        return -1 if self._listener is None else self._listener.fileno()

    def descriptors(self) -> list[int]:
        if self._closed or self._listener is None:
            return []
        return [self._listener.fileno(), *(client.socket.fileno() for client in self._clients)]

    def read(self, once: bool = False) -> list[Frame]:
        if self._closed:
            return []
        now = self._clock()
        self._part(now)
        arrived = {descriptor for descriptor, _what in self._arrivals.poll(0)}
        newcomers = (
            self._accept_clients(now) if self._listener is not None and self._listener.fileno() in arrived else []
        )
        frames: list[Frame] = []
        senders: dict[int, _Connection] = {}
        left = _STRANGERS_READ_BYTES
        for client in self._in_turn(arrived):
            stranger = client is not self._served and client.heard_at is None
            if stranger and left <= 0:
                break
            count = self._receive(client, _STRANGER_READ_BYTES if stranger else _READ_BYTES, now, frames, senders)
            left -= count if stranger else 0
        for client in newcomers:
            self._receive(client, _STRANGER_READ_BYTES, now, frames, senders)
        if self._proven is None:
            self._favour()
        self._senders, self._last = senders, list(frames)
        return frames

    def _in_turn(self, arrived: set[int]) -> list[_Connection]:
        """Older connections that have something to read: first the proven ones, then those that have sent least."""
        some = [client for client in self._clients if client.socket.fileno() in arrived or client.waits]
        some += [client for client in self._clients if client.splitter.waiting and client not in some]
        return sorted(some, key=lambda client: (client is not self._served, client.heard_at is None, client.bytes_in))

    def _receive(
        self, client: _Connection, limit: int, now: float, frames: list[Frame], senders: dict[int, _Connection]
    ) -> int:
        """Read a client, and drop it if it is lost. Returns the number of bytes."""
        try:
            data = client.receive(limit)
        except _Lost as loss:
            self.trouble = str(loss)
            self._drop(client)
            return 0
        if len(client.beginning) < _BEGINNING:
            client.beginning += data[: _BEGINNING - len(client.beginning)]
            if client.beginning.startswith(_OF_BROWSER):
                self.trouble = "a web browser's request: closed"
                self._turn_away(client)
                return 0
        if data or client.splitter.waiting:
            found = self._split(client.splitter, data, now)
            for frame in found:
                senders[id(frame)] = client
            frames += found
        return len(data)

    def write(self, data: bytes) -> bool:
        served = self._served
        if served is None or not served.send(data):
            return self._refused()
        return self._sent(data)

    def write_more(self, data: bytes) -> bool:
        served = self._served
        return served is not None and served.send(data, more=True) and self._sent(data)

    def flush(self) -> None:
        if self._served is not None:
            self._served.push()

    def reply(self, frame: Frame, data: bytes) -> None:
        client = self._senders.get(id(frame))
        if client is not None and client in self._clients:
            client.send(data)

    def accept_sender(self, frame: Frame) -> bool:
        client = self._senders.get(id(frame))
        if client is None or client not in self._clients:
            return False
        now = client.heard_at = self._clock()
        before = self._proven
        if before is client:
            return True
        if before is not None:
            if before.heard_at is not None and now - before.heard_at <= PEER_HOLD_S:
                return False
            before.replaced = True
        client.replaced = False
        self._proven = client
        return True

    def _part(self, now: float) -> None:
        """Close connections that are useless or too many."""
        if not self._clients or self._clients == [self._proven]:  # nearly always so
            return
        for client in list(self._clients):
            useless = self._proven is not None and client is not self._proven
            quiet_s = now - (client.since if client.heard_at is None else client.heard_at)
            if client.replaced or (useless and quiet_s > _UNPROVEN_S):
                self._turn_away(client)
        strangers = [client for client in self._clients if client.heard_at is None]
        crowd = Counter(client.host for client in strangers)
        while len(strangers) > _STRANGERS:
            host, count = crowd.most_common(1)[0]
            crowd[host] = count - 1
            oldest = next(client for client in strangers if client.host == host)
            strangers.remove(oldest)
            self._turn_away(oldest)
        genuine = [(client.heard_at, client) for client in self._clients if client.heard_at is not None]
        if len(genuine) > _GENUINE:
            genuine.sort(key=lambda one: (one[1] is self._proven, one[0]))
            for _heard_at, client in genuine[:-_GENUINE]:
                self._turn_away(client)

    def _accept_clients(self, now: float) -> list[_Connection]:
        """Accept new connections. They are read before another one is closed for them."""
        taken: list[_Connection] = []
        assert self._listener is not None
        for _ in range(_TAKEN):
            try:
                sock, address = self._listener.accept()
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:  # the connection is lost already, or no descriptor is left
                self._failed(error)
                break
            tune(sock)
            self.counters.connects += 1
            self.trouble = ""
            taken.append(_Connection(sock, now, host_of(address[0])))
            self._arrivals.register(sock, Poll.READ)
        self._clients += taken
        return taken

    def _favour(self) -> None:
        crowd = Counter(client.host for client in self._clients)
        self._favoured = min(reversed(self._clients), key=lambda client: crowd[client.host], default=None)

    def _turn_away(self, client: _Connection) -> None:
        self.counters.strangers += 1
        self._drop(client)

    def _drop(self, client: _Connection) -> None:
        self._clients.remove(client)
        self._arrivals.unregister(client.socket)
        client.socket.close()
        if client is self._proven:
            self._proven = None
        if client is self._favoured:
            self._favoured = None

    def _shut(self) -> None:
        for client in list(self._clients):
            self._drop(client)
        if self._listener is not None:
            self._listener.close()

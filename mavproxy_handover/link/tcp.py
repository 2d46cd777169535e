# SPDX-License-Identifier: GPL-3.0-or-later

"""TCP links.

A stream that stands still must be noticed and given up, because everything written to it meanwhile is late: unsent
bytes are few, here and in the system, and a connection whose bytes nobody acknowledges for some seconds is closed by
the system. Bytes of a lost connection are never sent on the next one.

`tcp` connects, without waiting for it, and connects again when it is lost; attempts grow rarer.

`tcpin` listens. It has one client; more may be connected, so that a station whose old connection is dead gets in, and
a stranger's connection does not keep the station out. The client is whoever sent a frame that was last called genuine
(`accept_sender`); one that was heard within PEER_HOLD_S is not replaced. As long as nobody proved genuine, the newest
connection is written to, for programs that say nothing before they hear a vehicle. Others are closed after a while.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import time
from typing import Final

from mavproxy_handover.link.base import PEER_HOLD_S, Backoff, Clock, Device, OutBuffer, reason
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError
from mavproxy_handover.wire.frames import Frame, FrameSplitter

__all__ = ["TcpIn", "TcpOut"]

_READ_BYTES: Final = 8192
_UNPROVEN_READ_BYTES: Final = 2048
_SEND_BUFFER_BYTES: Final = 16384
_CONNECT_TIMEOUT_S: Final = 5.0
_UNACKNOWLEDGED_MS: Final = 5000
_CLIENTS: Final = 4
_UNPROVEN_S: Final = 10.0


def _tune(sock: socket.socket) -> None:
    """No waiting for more bytes, little waiting in the system, and a dead peer noticed. As far as the system has it."""
    sock.setblocking(False)
    options = [
        (socket.IPPROTO_TCP, "TCP_NODELAY", 1),
        (socket.SOL_SOCKET, "SO_SNDBUF", _SEND_BUFFER_BYTES),
        (socket.SOL_SOCKET, "SO_KEEPALIVE", 1),
        (socket.IPPROTO_TCP, "TCP_KEEPIDLE", 2),
        (socket.IPPROTO_TCP, "TCP_KEEPINTVL", 1),
        (socket.IPPROTO_TCP, "TCP_KEEPCNT", 3),
        (socket.IPPROTO_TCP, "TCP_USER_TIMEOUT", _UNACKNOWLEDGED_MS),
    ]
    for level, name, value in options:
        if hasattr(socket, name):
            try:
                sock.setsockopt(level, getattr(socket, name), value)
            except OSError:
                pass


class _Lost(Exception):
    """A connection is over; the text says why."""


class _Connection:
    """One connected stream: splitter, unsent bytes. It is closed by its owner alone, in `read`: see `fileno`."""

    def __init__(self, sock: socket.socket, since: float) -> None:
        self.socket = sock
        self.since = since
        self.splitter = FrameSplitter()
        self.heard_at: float | None = None  #: a genuine frame, last
        self.replaced = False  #: another connection has taken over; to be closed in the next `read`
        self._out = OutBuffer()
        self._lost = ""

    def send(self, data: bytes) -> bool:
        """Take a frame and send what can be sent now."""
        self._push()
        if self._lost or not self._out.add(data):
            return False
        self._push()
        return not self._lost

    def _push(self) -> None:
        try:
            self._out.drain(self.socket.send)
        except OSError as error:
            self._lost = reason(error)

    def receive(self, limit: int) -> bytes:
        """What has arrived, at most `limit` bytes; sends what waits. Raises _Lost."""
        self._push()
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
        return data


class TcpOut(Device):
    """Connects to `HOST:PORT`, again and again."""

    def __init__(self, spec: DeviceSpec, clock: Clock = time.monotonic) -> None:
        """Raises LinkError: unknown host."""
        assert spec.kind is Kind.TCP_OUT
        super().__init__(spec.text, clock)
        try:
            self._address = (socket.gethostbyname(spec.host), spec.port)
        except (OSError, UnicodeError) as error:
            raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None
        self._backoff = Backoff()
        self._connecting: socket.socket | None = None
        self._connect_by = 0.0
        self._connection: _Connection | None = None
        self._connect()

    @property
    def open(self) -> bool:
        return self._connection is not None

    @property
    def unfinished(self) -> bool:
        return self._connection is not None and self._connection.splitter.waiting > 0

    def fileno(self) -> int:
        return -1 if self._connection is None else self._connection.socket.fileno()

    def descriptors(self) -> list[int]:
        connecting = [] if self._connecting is None else [self._connecting.fileno()]
        return connecting + super().descriptors()

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

    def _connect(self) -> None:
        now = self._clock()
        self._backoff.tried(now)
        self._connect_by = now + _CONNECT_TIMEOUT_S
        try:
            sock = self._connecting = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            _tune(sock)
            result = sock.connect_ex(self._address)
        except OSError as error:
            self._give_up(reason(error))
            return
        if result not in (0, errno.EINPROGRESS, errno.EWOULDBLOCK):
            self._give_up(os.strerror(result))

    def _see_to_connecting(self) -> None:
        now = self._clock()
        if self._connecting is None:
            if self._backoff.due(now):
                self._connect()
            return
        poll = select.poll()
        poll.register(self._connecting, select.POLLOUT)
        if not poll.poll(0):
            if now >= self._connect_by:
                self._give_up("no answer")
            return
        result = self._connecting.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if result:
            self._give_up(os.strerror(result))
        elif self._connecting.getsockname() == self._connecting.getpeername():
            # on one machine an attempt can meet itself, and would then hold the port that the station wants
            self._give_up("nobody listens")
        else:
            self._connection = _Connection(self._connecting, now)
            self._connecting = None
            self.counters.connects += 1
            self.trouble = ""

    def _give_up(self, why: str) -> None:
        self.counters.errors += 1
        self.trouble = why
        self._shut()

    def _shut(self) -> None:
        if self._connecting is not None:
            self._connecting.close()
            self._connecting = None
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
        self._senders: dict[int, _Connection] = {}
        self._last: list[Frame] = []
        self._listener: socket.socket | None = None
        try:
            self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            # a restarted companion must not wait for the system to forget its former connections
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind((socket.gethostbyname(spec.host), spec.port))
            self._listener.listen(_CLIENTS)
            self._listener.setblocking(False)
        except (OSError, UnicodeError) as error:
            if self._listener is not None:
                self._listener.close()
            raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None

    @property
    def open(self) -> bool:
        return self._served is not None

    @property
    def _served(self) -> _Connection | None:
        return self._proven or (self._clients[-1] if self._clients else None)

    @property
    def unfinished(self) -> bool:
        return any(client.splitter.waiting for client in self._clients)

    def fileno(self) -> int:
        """The client's; while there is none, the listening socket's. Who connects meanwhile waits for the next read."""
        if self._served is not None:
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
        self._take_clients(now)
        frames: list[Frame] = []
        senders: dict[int, _Connection] = {}
        for client in list(self._clients):
            try:
                data = client.receive(_READ_BYTES if client is self._served else _UNPROVEN_READ_BYTES)
            except _Lost as loss:
                self.trouble = str(loss)
                self._drop(client)
                continue
            if data or client.splitter.waiting:
                found = self._split(client.splitter, data, now)
                for frame in found:
                    senders[id(frame)] = client
                frames += found
        self._senders, self._last = senders, list(frames)
        return frames

    def write(self, data: bytes) -> bool:
        served = self._served
        if served is None or not served.send(data):
            return self._refused()
        return self._sent(data)

    def accept_sender(self, frame: Frame) -> None:
        client = self._senders.get(id(frame))
        if client is None or client not in self._clients:
            return
        now = client.heard_at = self._clock()
        before = self._proven
        if before is client:
            return
        if before is not None:
            if before.heard_at is not None and now - before.heard_at <= PEER_HOLD_S:
                return
            before.replaced = True
        client.replaced = False
        self._proven = client

    def _take_clients(self, now: float) -> None:
        for client in list(self._clients):
            useless = self._proven is not None and client is not self._proven
            quiet_s = now - (client.since if client.heard_at is None else client.heard_at)
            if client.replaced or (useless and quiet_s > _UNPROVEN_S):
                self._turn_away(client)
        for _ in range(_CLIENTS):
            try:
                assert self._listener is not None
                sock, _address = self._listener.accept()
            except (BlockingIOError, InterruptedError):
                return
            except OSError as error:  # it was gone again, or no descriptor is left
                self._failed(error)
                return
            _tune(sock)
            self.counters.connects += 1
            self.trouble = ""
            self._clients.append(_Connection(sock, now))
            if len(self._clients) > _CLIENTS:
                self._turn_away(next(client for client in self._clients if client is not self._proven))

    def _turn_away(self, client: _Connection) -> None:
        self.counters.strangers += 1
        self._drop(client)

    def _drop(self, client: _Connection) -> None:
        self._clients.remove(client)
        client.socket.close()
        if client is self._proven:
            self._proven = None

    def _shut(self) -> None:
        for client in list(self._clients):
            self._drop(client)
        if self._listener is not None:
            self._listener.close()

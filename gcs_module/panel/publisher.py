# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's side of the panel's socket: sends snapshots, reads orders. It never blocks and never raises.

Rules that live here
--------------------
* A snapshot is made only if a reader can be given one, at most EACH_S apart. A reader that still has bytes to read gets
  no new one, so nothing piles up. One that reads nothing for SLOW_S is dropped.
* A reader's first line must hold the token, within HELLO_S. The lines of a reader, and its orders in a second, have
  limits. A reader beyond them is dropped.
* A mission package is sent once to each reader, before the first snapshot that names it.
"""

from __future__ import annotations

import hmac
import json
import socket
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from gcs_module.panel.endpoint import Endpoint
from gcs_module.panel.orders import Order, OrderError, Reply, read_order
from gcs_module.panel.snapshot import StationSeen, to_line

__all__ = ["EACH_S", "MOST_READERS", "Publisher"]

#: shortest time (s) between two snapshots, and between two looks at the sockets
EACH_S: Final = 0.25
_LOOK_S: Final = 0.02
HELLO_S: Final = 2.0
SLOW_S: Final = 3.0
MOST_READERS: Final = 4
#: longest line of a reader, most bytes that are read from it at once, most bytes that wait for it
_LINE: Final = 2048
_READ: Final = 4096
_MOST_WAITING: Final = 1 << 20
#: most orders of a reader in a second
_ORDERS: Final = 10


@dataclass(slots=True, eq=False)
class _Reader:
    """A panel that has connected. `moved_at`: when it last read something, or had nothing to read."""

    socket: socket.socket
    since: float
    moved_at: float
    known: bool = False
    received: bytearray = field(default_factory=bytearray)
    waiting: bytearray = field(default_factory=bytearray)
    missions: set[str] = field(default_factory=set)
    second: int = 0
    orders: int = 0


class Publisher:
    """One station's. `snapshot`: what is known now; `missions`: packages by digest; `carry_out`: does an order.

    `opened` and `closed` are told the descriptor of each socket. Times are monotonic seconds.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        snapshot: Callable[[float], StationSeen],
        missions: Callable[[], Mapping[str, str]],
        carry_out: Callable[[Order], Reply],
        opened: Callable[[int], None] = lambda _fileno: None,
        closed: Callable[[int], None] = lambda _fileno: None,
    ) -> None:
        self._endpoint = endpoint
        self._snapshot = snapshot
        self._missions = missions
        self._carry_out = carry_out
        self._opened, self._closed = opened, closed
        self._readers: list[_Reader] = []
        self._look_at = self._send_at = 0.0
        #: readers that were dropped, by the reason
        self.dropped: Counter[str] = Counter()
        opened(endpoint.listener.fileno())

    @property
    def readers(self) -> int:
        """How many panels are connected."""
        return len(self._readers)

    def tick(self, now: float) -> None:
        """To be called often; returns at once."""
        if now < self._look_at:
            return
        self._look_at = now + _LOOK_S
        self._accept(now)
        for reader in list(self._readers):
            self._read(reader, now)
        if now >= self._send_at:
            self._send_at = now + EACH_S
            self._publish()
        for reader in list(self._readers):
            self._write(reader, now)

    def close(self) -> None:
        """Drop all readers, and remove the socket."""
        for reader in list(self._readers):
            self._drop(reader, "closed")
        self._closed(self._endpoint.listener.fileno())
        self._endpoint.close()

    # ---- in -------------------------------------------------------------------------------------------------------

    def _accept(self, now: float) -> None:
        try:
            opened, _address = self._endpoint.listener.accept()
        except OSError:
            return
        if len(self._readers) >= MOST_READERS:
            opened.close()
            self.dropped["too many"] += 1
            return
        opened.setblocking(False)
        self._readers.append(_Reader(opened, now, now))
        self._opened(opened.fileno())

    def _read(self, reader: _Reader, now: float) -> None:
        try:
            data = reader.socket.recv(_READ)
        except BlockingIOError:
            if not reader.known and now - reader.since > HELLO_S:
                self._drop(reader, "silent")
            return
        except OSError:
            data = b""
        if not data:
            self._drop(reader, "gone")
            return
        reader.received += data
        *lines, rest = bytes(reader.received).split(b"\n")
        reader.received = bytearray(rest)
        if max(map(len, (*lines, rest))) > _LINE:
            self._drop(reader, "line too long")
            return
        for line in lines:
            if reader not in self._readers:
                return
            self._on_line(reader, line, now)

    def _on_line(self, reader: _Reader, line: bytes, now: float) -> None:
        values = _values(line)
        if not reader.known:
            token = values.get("token")
            given = token.encode(errors="replace") if isinstance(token, str) else None  # half a surrogate has no bytes
            if given is not None and hmac.compare_digest(given, self._endpoint.token.encode()):
                reader.known = True
                self._send_at = now
            else:
                self._drop(reader, "wrong token")
            return
        if int(now) != reader.second:
            reader.second, reader.orders = int(now), 0
        reader.orders += 1
        if reader.orders > _ORDERS:
            self._drop(reader, "too many orders")
            return
        try:
            reply = self._carry_out(read_order(values))
        except OrderError as error:
            number = values.get("number")
            reply = Reply(number if isinstance(number, int) else -1, False, str(error))
        reader.waiting += _line(reply.values())
        self._send_at = now  # the answer's effect shows at once

    # ---- out ------------------------------------------------------------------------------------------------------

    def _publish(self) -> None:
        ready = [reader for reader in self._readers if reader.known and not reader.waiting]
        ready += [reader for reader in self._readers if reader.known and 0 < len(reader.waiting) < _LINE]
        if not ready:
            return
        now = self._look_at - _LOOK_S
        missions = self._missions()
        line = to_line(self._snapshot(now))
        for reader in ready:
            for digest in missions.keys() - reader.missions:
                reader.waiting += _line({"kind": "mission", "digest": digest, "package": missions[digest]})
            reader.missions = set(missions)
            reader.waiting += line

    def _write(self, reader: _Reader, now: float) -> None:
        if not reader.waiting:
            reader.moved_at = now
            return
        try:
            sent = reader.socket.send(reader.waiting)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(reader, "gone")
            return
        if sent:
            reader.moved_at = now
            del reader.waiting[:sent]
        if len(reader.waiting) > _MOST_WAITING or now - reader.moved_at > SLOW_S:
            self._drop(reader, "slow")

    def _drop(self, reader: _Reader, why: str) -> None:
        if reader in self._readers:
            self._readers.remove(reader)
            self.dropped[why] += 1
            self._closed(reader.socket.fileno())
            reader.socket.close()


def _values(line: bytes) -> Mapping[str, Any]:
    """The values of a line; none if it is not an object of JSON."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _line(values: Mapping[str, Any]) -> bytes:
    return json.dumps(values, separators=(",", ":")).encode() + b"\n"

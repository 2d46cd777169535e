# SPDX-License-Identifier: GPL-3.0-or-later

"""A TCP connection that is made again and again, without waiting for it; attempts grow rarer.

It ends at the connected socket: what is said over it, and when it is lost, is its owner's matter.
"""

from __future__ import annotations

import errno
import os
import select
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from mavproxy_handover.link.base import Backoff, reason
from mavproxy_handover.link.forms import DeviceSpec, LinkError
from mavproxy_handover.link.names import Address, Names, endpoint, is_number, look_up_for

__all__ = ["Dialling", "tune"]

_CONNECT_TIMEOUT_S: Final = 5.0
_SEND_BUFFER_BYTES: Final = 16384
_UNACKNOWLEDGED_MS: Final = 5000


def tune(sock: socket.socket) -> None:
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


class Dialling:
    """Attempts to reach `HOST:PORT`, one at a time. `failed` is told in words why one came to nothing.

    A host with several addresses is tried at the next one each time.
    """

    def __init__(
        self, spec: DeviceSpec, backoff: Backoff, failed: Callable[[str], None], names: Names | None = None
    ) -> None:
        """`names`: knows the host's addresses, now or later; without it a name is looked up on the spot, and one that
        is not known raises LinkError."""
        self._spec = spec
        self._names = names
        if names is None and not is_number(spec.host):
            self._spec = replace(spec, host=look_up_for(spec)[0])
        self._turn = 0
        #: where the last attempt went
        self.address: Address = ("", spec.port)
        self._backoff = backoff
        self._failed = failed
        self._socket: socket.socket | None = None
        self._by = 0.0

    def descriptors(self) -> list[int]:
        """What is open now."""
        return [] if self._socket is None else [self._socket.fileno()]

    def begin(self, now: float) -> None:
        """Make an attempt, due or not."""
        self._backoff.tried(now)
        self._by = now + _CONNECT_TIMEOUT_S
        host = self._next_host()
        if not host:
            self._give_up(f"the address of {self._spec.host} is not known yet")
            return
        try:
            family, self.address = endpoint(replace(self._spec, host=host))
            sock = self._socket = socket.socket(family, socket.SOCK_STREAM)
            tune(sock)
            result = sock.connect_ex(self.address)
        except (OSError, LinkError) as error:
            self._give_up(reason(error))
            return
        if result not in (0, errno.EINPROGRESS, errno.EWOULDBLOCK):
            self._give_up(os.strerror(result))

    def _next_host(self) -> str:
        """The address for this attempt, "" if none is known."""
        if self._names is None:
            return self._spec.host
        self._names.look_again(self._spec.host)
        hosts = self._names.addresses(self._spec.host)
        self._turn += 1
        return hosts[(self._turn - 1) % len(hosts)] if hosts else ""

    def look(self, now: float) -> socket.socket | None:
        """The connected socket, once, when an attempt has come to something; makes the next one when that is due."""
        if self._socket is None:
            if self._backoff.due(now):
                self.begin(now)
            return None
        poll = select.poll()
        poll.register(self._socket, select.POLLOUT)
        if not poll.poll(0):
            if now >= self._by:
                self._give_up("no answer")
            return None
        result = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if result:
            self._give_up(os.strerror(result))
            return None
        try:
            itself = self._socket.getsockname() == self._socket.getpeername()
        except OSError as error:  # it was gone again
            self._give_up(reason(error))
            return None
        if itself:
            # on one machine an attempt can meet itself, and would then hold the port that the other side wants
            self._give_up("nobody listens")
            return None
        made, self._socket = self._socket, None
        return made

    def shut(self) -> None:
        """Break off the attempt that is under way."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _give_up(self, why: str) -> None:
        self.shut()
        self._failed(why)

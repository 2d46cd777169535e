# SPDX-License-Identifier: GPL-3.0-or-later

"""TCP connection attempts without waiting, at growing intervals.

This part ends at the connected socket. Its owner uses the connection and notices its loss.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from mavproxy_handover.link.base import Backoff, reason
from mavproxy_handover.link.forms import DeviceSpec, LinkError
from mavproxy_handover.link.names import Address, Names, endpoint, is_number, look_up_for
from mavproxy_handover.link.polling import Poll, poll

__all__ = ["Dialling", "tune"]

_CONNECT_TIMEOUT_S: Final = 5.0
_SEND_BUFFER_BYTES: Final = 16384
_UNACKNOWLEDGED_MS: Final = 5000


def tune(sock: socket.socket) -> None:
    """Set TCP options: send at once, buffer little in the system, notice a dead peer. Missing options are skipped."""
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
    """Attempts to reach `HOST:PORT`, one at a time. `failed` gets the reason of a failed attempt as text.

    If a host has several addresses, each attempt uses the next one.
    """

    def __init__(
        self, spec: DeviceSpec, backoff: Backoff, failed: Callable[[str], None], names: Names | None = None
    ) -> None:
        """`names`: finds the host's addresses, now or later. Without it the name is looked up at once, and an unknown
        name raises LinkError.
        """
        self._spec = spec
        self._names = names
        if names is None and not is_number(spec.host):
            self._spec = replace(spec, host=look_up_for(spec)[0])
        self._turn = 0
        #: address of the last attempt
        self.address: Address = ("", spec.port)
        self._backoff = backoff
        self._failed = failed
        self._socket: socket.socket | None = None
        self._by = 0.0

    def descriptors(self) -> list[int]:
        """The open descriptors."""
        return [] if self._socket is None else [self._socket.fileno()]

    def begin(self, now: float) -> None:
        """Start an attempt, even if none is due."""
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
        self._names.request(self._spec.host)
        hosts = self._names.addresses(self._spec.host)
        self._turn += 1
        return hosts[(self._turn - 1) % len(hosts)] if hosts else ""

    def poll(self, now: float) -> socket.socket | None:
        """Return the socket once after an attempt has succeeded; otherwise start the next attempt when it is due."""
        if self._socket is None:
            if self._backoff.due(now):
                self.begin(now)
            return None
        writable = poll()
        writable.register(self._socket, Poll.WRITE)
        if not writable.poll(0):
            if now >= self._by:
                self._give_up("no answer")
            return None
        result = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if result:
            self._give_up(os.strerror(result))
            return None
        try:
            itself = self._socket.getsockname() == self._socket.getpeername()
        except OSError as error:  # the connection is lost already
            self._give_up(reason(error))
            return None
        if itself:
            # on one machine an attempt can connect to itself, and would then hold the port that the other side needs
            self._give_up("no program listens")
            return None
        made, self._socket = self._socket, None
        return made

    def shut(self) -> None:
        """Cancel the current attempt."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _give_up(self, why: str) -> None:
        self.shut()
        self._failed(why)

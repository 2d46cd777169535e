# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages to the service manager (sd_notify(3)): the companion is ready, is in order, or ends.

The manager names a datagram socket in NOTIFY_SOCKET, and its time-out in WATCHDOG_USEC; without them no message is
sent. The supervisor sends the messages, but only while its child lives or is being replaced in time (`rules.py`). If
the supervisor hangs, or the child can neither end nor start, no message comes. Then the manager kills all processes and
starts them again. A child that keeps dying is different: it is replaced, without leases. If the manager started
everything again, that child would be trusted again. Without a supervisor the module itself sends the messages, from the
main loop. Otherwise the manager would end a companion that is in order.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, MutableMapping
from math import inf
from typing import Final

__all__ = ["ServiceManager", "named_manager", "service_manager"]

_NAMES: Final = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")
_READY, _BEAT, _STOPPING = b"READY=1", b"WATCHDOG=1", b"STOPPING=1"
#: messages for each time-out of the manager; two may be lost
_PER_WATCHDOG: Final = 3.0
#: time (s) after which an undelivered message is sent again; the queue is short, and full while a computer starts
_AGAIN_S: Final = 0.1


class ServiceManager:
    """Sends to the service manager. Nothing here raises or waits. Times are monotonic seconds."""

    def __init__(self, address: str | None = None, watchdog_s: float = inf) -> None:
        """`address`: a path, or an abstract name that begins with @. None: there is no manager."""
        self._address = b"" if address is None else os.fsencode(address)
        if self._address.startswith(b"@"):
            self._address = b"\0" + self._address[1:]
        self._pause_s = watchdog_s / _PER_WATCHDOG
        self._due_at = -inf if watchdog_s < inf else inf
        self._ready = False
        self._ready_at = -inf
        #: opened by the first message
        self._socket: socket.socket | None = None

    def in_order(self, now: float, *, lived: bool) -> None:
        """Report that the child is in order. `lived`: the main loop of some child has run."""
        if lived and not self._ready and now >= self._ready_at:
            self._ready = self._tell(_READY)
            self._ready_at = now + _AGAIN_S
        if now >= self._due_at:
            told = self._tell(_BEAT)
            self._due_at = now + (self._pause_s if told else min(self._pause_s, _AGAIN_S))

    def due_at(self) -> float:
        """Time of the next message; inf: never."""
        return self._due_at if self._address else inf

    def replaced(self, why: str) -> None:
        """Report that a child has died and will be replaced, for people who ask the manager."""
        self._tell(b"STATUS=started again: " + os.fsencode(why))

    def stopping(self) -> None:
        """Report that all processes end."""
        self._tell(_STOPPING)

    def _tell(self, word: bytes) -> bool:
        """Send a message; False if it was not delivered. Without a manager it always succeeds."""
        if not self._address:
            return True
        try:
            if self._socket is None:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
                self._socket.setblocking(False)
            self._socket.sendto(word, self._address)
        except OSError:  # full, closed, or never there
            return False
        return True

    def close(self) -> None:
        """Close the socket, at the end and in a child, because only the parent sends."""
        self._address = b""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def service_manager(environment: MutableMapping[str, str] = os.environ) -> ServiceManager:
    """The manager that the environment names. The names are removed from it, so that children have none."""
    manager = named_manager(environment)
    for name in _NAMES:
        environment.pop(name, None)
    return manager


def named_manager(environment: Mapping[str, str] = os.environ) -> ServiceManager:
    """The manager that the environment names. The names stay, so that a module that is loaded again finds them."""
    address, micros, whose = (environment.get(name, "") for name in _NAMES)
    meant = whose in ("", str(os.getpid()))
    watchdog_s = int(micros) / 1e6 if meant and micros.isascii() and micros.isdecimal() and len(micros) < 16 else 0.0
    return ServiceManager(address or None, watchdog_s or inf)

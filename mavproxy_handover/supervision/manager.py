# SPDX-License-Identifier: GPL-3.0-or-later

"""What the service manager is told: that the companion is ready, that it is in order, that it ends (sd_notify(3)).

The manager names a datagram socket in NOTIFY_SOCKET, and in WATCHDOG_USEC how long it waits for a word; without them
nothing is told to anybody. The word comes from the supervisor, and only while its child lives or is being replaced in
time (`rules.py`): a supervisor that hangs, a child that can be neither ended nor started, are silent, and then the
manager kills all of it and starts it anew. A child that keeps dying is no such case: it is replaced, without leases,
and to start all of it anew would have it trusted again. Where nobody supervises the module itself gives the word, from
the main loop: else the manager would wait for it in vain, and end a companion that is in order.
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
#: a word so often while the manager waits for one; two may be lost
_PER_WATCHDOG: Final = 3.0
#: a word that did not get through (its queue is short, and full while a computer starts) is tried again so soon
_AGAIN_S: Final = 0.1


class ServiceManager:
    """The way to it. Nothing here raises or waits. Times are monotonic seconds."""

    def __init__(self, address: str | None = None, watchdog_s: float = inf) -> None:
        """`address`: a path, or with an @ before it a name that is none; None: there is no manager."""
        self._address = b"" if address is None else os.fsencode(address)
        if self._address.startswith(b"@"):
            self._address = b"\0" + self._address[1:]
        self._pause_s = watchdog_s / _PER_WATCHDOG
        self._due_at = -inf if watchdog_s < inf else inf
        self._ready = False
        self._ready_at = -inf
        #: opened by the first word
        self._socket: socket.socket | None = None

    def in_order(self, now: float, *, lived: bool) -> None:
        """The child is as it should be. `lived`: some child's main loop has gone round."""
        if lived and not self._ready and now >= self._ready_at:
            self._ready = self._tell(_READY)
            self._ready_at = now + _AGAIN_S
        if now >= self._due_at:
            told = self._tell(_BEAT)
            self._due_at = now + (self._pause_s if told else min(self._pause_s, _AGAIN_S))

    def due_at(self) -> float:
        """When it wants a word again; inf: never."""
        return self._due_at if self._address else inf

    def replaced(self, why: str) -> None:
        """A child has died, and there will be another one; for people who ask the manager."""
        self._tell(b"STATUS=started again: " + os.fsencode(why))

    def stopping(self) -> None:
        """Somebody wants all of it to end."""
        self._tell(_STOPPING)

    def _tell(self, word: bytes) -> bool:
        """False: it did not get through. To nobody everything does."""
        if not self._address:
            return True
        try:
            if self._socket is None:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
                self._socket.setblocking(False)
            self._socket.sendto(word, self._address)
        except OSError:  # full, gone, or never there
            return False
        return True

    def close(self) -> None:
        """For a child, which is not the one to tell; and at the end."""
        self._address = b""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def service_manager(environment: MutableMapping[str, str] = os.environ) -> ServiceManager:
    """That of this process, by its environment, where nothing of it is left: children have none."""
    manager = named_manager(environment)
    for name in _NAMES:
        environment.pop(name, None)
    return manager


def named_manager(environment: Mapping[str, str] = os.environ) -> ServiceManager:
    """The same, and it can be asked for again: by a module that is loaded a second time."""
    address, micros, whose = (environment.get(name, "") for name in _NAMES)
    meant = whose in ("", str(os.getpid()))
    watchdog_s = int(micros) / 1e6 if meant and micros.isascii() and micros.isdecimal() and len(micros) < 16 else 0.0
    return ServiceManager(address or None, watchdog_s or inf)

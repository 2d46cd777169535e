# SPDX-License-Identifier: GPL-3.0-or-later

"""Free ports on loopback, never fixed numbers: several simulations may run on one machine.

A port is free at the moment it is handed out. The pickers of one process hand out none of the last `APART` numbers
again, neither for UDP nor for TCP. The program that gets a port binds it a moment later. The numbers are outside the
range that a system gives to sockets that name none. So only a picker of another process can take one in between, and
pickers start at random places.
"""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Iterator
from itertools import cycle
from random import randrange
from typing import Final

__all__ = ["APART", "PORTS", "PortPicker"]

LOOPBACK = "127.0.0.1"
#: What is handed out. Linux gives 32768 and above to sockets that name no port, other systems 49152 and above.
PORTS: Final = range(20000, 32768)
#: as many as several simulations take
APART: Final = 4096
#: what was handed out last in this process, and may not be bound yet
_GIVEN: Final[deque[int]] = deque(maxlen=APART)


class PortPicker:
    """Hands out ports for one simulation."""

    def __init__(self) -> None:
        start = randrange(len(PORTS))
        self._next: Iterator[int] = cycle((*PORTS[start:], *PORTS[:start]))

    def udp(self) -> int:
        """A free UDP port of 127.0.0.1. Raises OSError when there is none."""
        return self._pick(socket.SOCK_DGRAM)

    def tcp(self) -> int:
        """A free TCP port of 127.0.0.1. Raises OSError when there is none."""
        return self._pick(socket.SOCK_STREAM)

    def _pick(self, kind: socket.SocketKind) -> int:
        for _ in PORTS:
            port = next(self._next)
            if port not in _GIVEN and _is_free(port, kind):
                _GIVEN.append(port)
                return port
        raise OSError(f"no free port on {LOOPBACK} from {PORTS.start} to {PORTS.stop - 1}")


def _is_free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as sock:
        try:
            sock.bind((LOOPBACK, port))
        except OSError:
            return False
    return True

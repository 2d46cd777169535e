# SPDX-License-Identifier: GPL-3.0-or-later

"""Free ports on loopback, never fixed numbers: several simulations may run on one machine.

A port is free at the moment it is handed out. The program that gets it binds it a moment later. Nothing takes it in
between:

* The numbers are outside the range that a system gives to sockets that name none.
* The pickers of one process hand out none of the last `APART` numbers again, neither for UDP nor for TCP.
* The pickers of one user's processes claim what they hand out: each port is a byte of one file, which is locked for as
  long as the number is among the last ones of its process. The system drops the locks of a process that ends.
"""

from __future__ import annotations

import fcntl
import os
import socket
import tempfile
from collections import deque
from collections.abc import Iterator
from functools import cache
from itertools import cycle
from pathlib import Path
from random import randrange
from typing import Final

__all__ = ["APART", "PORTS", "PortPicker"]

LOOPBACK = "127.0.0.1"
#: What is handed out. Linux gives 32768 and above to sockets that name no port, other systems 49152 and above.
PORTS: Final = range(20000, 32768)
#: as many as several simulations take
APART: Final = 4096
#: what was handed out last in this process, and may not be bound yet
_GIVEN: Final[deque[int]] = deque()


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
            if port not in _GIVEN and _is_claimed(port):
                if _is_free(port, kind):
                    _GIVEN.append(port)
                    if len(_GIVEN) > APART:
                        _give_up(_GIVEN.popleft())
                    return port
                _give_up(port)
        raise OSError(f"no free port on {LOOPBACK} from {PORTS.start} to {PORTS.stop - 1}")


def _is_free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as sock:
        try:
            sock.bind((LOOPBACK, port))
        except OSError:
            return False
    return True


@cache
def _claims() -> int:
    """The open file whose bytes are the claims; one user's processes share it. Raises OSError."""
    path = Path(tempfile.gettempdir()) / f"handover-ports-{os.getuid()}"
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)


def _is_claimed(port: int) -> bool:
    """Claims it for this process: False while another process has it."""
    claims = _claims()
    try:
        fcntl.lockf(claims, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, port)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _give_up(port: int) -> None:
    fcntl.lockf(_claims(), fcntl.LOCK_UN, 1, port)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Free ports on loopback, asked of the system, never fixed numbers: several simulations may run on one machine.

A port is free at the moment it is handed out, and one picker never hands out the same number twice, neither for UDP
nor for TCP. Whoever gets it binds it a moment later; that another program takes it in between is possible and very
rare.
"""

from __future__ import annotations

import socket

__all__ = ["PortPicker"]

LOOPBACK = "127.0.0.1"
_TRIES = 100


class PortPicker:
    """Hands out ports for one simulation."""

    def __init__(self) -> None:
        self._given: set[int] = set()

    def udp(self) -> int:
        """A free UDP port of 127.0.0.1. Raises OSError when there is none."""
        return self._pick(socket.SOCK_DGRAM)

    def tcp(self) -> int:
        """A free TCP port of 127.0.0.1. Raises OSError when there is none."""
        return self._pick(socket.SOCK_STREAM)

    def _pick(self, kind: socket.SocketKind) -> int:
        for _ in range(_TRIES):
            with socket.socket(socket.AF_INET, kind) as sock:
                sock.bind((LOOPBACK, 0))
                port: int = sock.getsockname()[1]
            if port not in self._given:
                self._given.add(port)
                return port
        raise OSError("no free port on 127.0.0.1")

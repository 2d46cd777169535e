# SPDX-License-Identifier: GPL-3.0-or-later

"""A pilot's transmitter: pulse widths to the vehicle's radio port, fifty times a second while it is switched on.

ArduPilot's SITL and the built-in vehicle take sixteen of them in a datagram. Both are given port 0 and choose one that
is free, so it is looked up: it is the program's only UDP socket.
"""

from __future__ import annotations

import os
import socket
import struct
from pathlib import Path
from typing import Final

__all__ = ["POSITIONS", "Transmitter"]

#: pulse widths (us) of the six positions of the flight mode switch
POSITIONS: Final = (1165, 1295, 1425, 1555, 1685, 1815)
_MIDDLE, _DOWN = 1500, 1000
_INTERVAL_S: Final = 0.02


class Transmitter:
    """Off until the switch is moved. Times are monotonic seconds."""

    def __init__(self, pid: int) -> None:
        """`pid`: the vehicle's process. Raises OSError: it has no radio port."""
        self._port = _radio_port(pid)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._position: int | None = None
        self._throttle = _DOWN
        self._due_at = 0.0

    def switch(self, position: int | None) -> None:
        """Move the flight mode switch, 1 to 6; None: off.

        The throttle stick is down until it is moved for the second time, because arming needs that. A pilot that takes
        over in the air has it in the middle.
        """
        self._throttle = _DOWN if self._position is None else _MIDDLE
        self._position = position

    def tick(self, now: float) -> None:
        """Time has passed."""
        if self._position is None or now < self._due_at:
            return
        self._due_at = now + _INTERVAL_S
        # in the middle: a pilot that flies by hand holds the aircraft there
        sticks = [_MIDDLE, _MIDDLE, self._throttle, _MIDDLE] + [POSITIONS[self._position - 1]] + [_DOWN] * 11
        self._socket.sendto(struct.pack("<16H", *sticks), ("127.0.0.1", self._port))

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()


def _radio_port(pid: int) -> int:
    links = [os.readlink(entry) for entry in Path(f"/proc/{pid}/fd").iterdir() if entry.is_symlink()]
    own = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    rows = [line.split() for line in Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]]
    ports = [int(row[1].partition(":")[2], 16) for row in rows if row[9] in own]
    if len(ports) != 1:
        raise OSError(f"the vehicle has {len(ports)} UDP sockets, one is wanted")
    return ports[0]

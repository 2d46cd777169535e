# SPDX-License-Identifier: GPL-3.0-or-later

"""Ground station programs that watch a simulated flight, by UDP: they get all that the autopilot sends.

They can only read: of their frames only requests for parameters and missions (`READS`), and no more than MOST_A_SECOND,
reach the autopilot, with any system id. Everything else is dropped without an answer, as by a radio that only receives:
no command, no mode, no parameter set. The run does not wait for them, and one that is not there costs nothing.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.script.places import SetupError

__all__ = ["MOST_A_SECOND", "READS", "Watchers", "read_address"]

#: what a watcher may ask the autopilot
READS: Final = frozenset(
    (
        "PARAM_REQUEST_LIST",
        "PARAM_REQUEST_READ",
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST_INT",
        "MISSION_REQUEST",
        "MISSION_ACK",
    )
)
MOST_A_SECOND: Final = 50
_LARGEST: Final = 65536


def read_address(text: str) -> tuple[str, int]:
    """Host and port of `udp:HOST:PORT`. Raises SetupError."""
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind != "udp" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise SetupError(f"--watch {text!r} (allowed: udp:HOST:PORT, as in udp:127.0.0.1:14550)")
    try:
        found = socket.getaddrinfo(host, int(port), socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise SetupError(f"--watch {text!r}: {host}: {error.strerror or error}") from None
    address: tuple[str, int] = found[0][4][:2]  # type: ignore[assignment]
    return address


def _parser() -> Any:
    parser: Any = mavlink.MAVLink(None)
    parser.robust_parsing = True
    return parser


class Watchers:
    """The programs that watch one vehicle."""

    def __init__(self, addresses: Sequence[tuple[str, int]]) -> None:
        #: the line to each, and what reads it
        self._watchers: list[tuple[socket.socket, Any]] = []
        for address in addresses:
            line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            line.setblocking(False)
            with suppress(OSError):  # no route there now: each datagram tries again
                line.connect(address)
            self._watchers.append((line, _parser()))
        self._second, self._left = 0, MOST_A_SECOND

    def show(self, messages: Iterable[Any]) -> None:
        """Send frames of the autopilot to all of them."""
        if not self._watchers:
            return
        frames = [bytes(message.get_msgbuf()) for message in messages if message.get_type() != "BAD_DATA"]
        for line, _reader in self._watchers:
            for frame in frames:
                with suppress(OSError):  # no program listens there, or it is too slow
                    line.send(frame)

    def asked(self) -> list[bytes]:
        """Frames of theirs that may go on to the autopilot."""
        found: list[bytes] = []
        second = int(time.monotonic())
        if second != self._second:
            self._second, self._left = second, MOST_A_SECOND
        for line, reader in self._watchers:
            for _ in range(MOST_A_SECOND):
                try:
                    data = line.recv(_LARGEST)
                except OSError:
                    break
                for message in reader.parse_buffer(data) or ():
                    if message.get_type() in READS and self._left > 0:
                        self._left -= 1
                        found.append(bytes(message.get_msgbuf()))
        return found

    def close(self) -> None:
        """Close the links to all watching programs."""
        for line, _reader in self._watchers:
            line.close()

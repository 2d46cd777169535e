# SPDX-License-Identifier: GPL-3.0-or-later

"""The panel's side of the socket: the last snapshot with its age, the mission packages, and the replies to orders.

It connects again by itself, also to a station that has started again. It never changes to another station: the
configuration file must be the same. The station's clock is related to this one by the fastest of the last lines: a line
that was delayed on its way counts as old, never as new. In a simulation the station's clock runs at another rate.
"""

from __future__ import annotations

import base64
import binascii
import json
import socket
from collections import deque
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Any, Final

from gcs_module.panel.endpoint import EndpointError, connect
from gcs_module.panel.orders import Order
from gcs_module.panel.snapshot import SnapshotError, StationSeen, from_values

__all__ = ["Reader"]

#: time (s) between two attempts to connect
_AGAIN_S: Final = 0.5
#: longest line: 64 KiB of a package in base64, or a snapshot of many aircraft
_LINE: Final = 1 << 20
#: most bytes that are read in a turn
_TURN: Final = 1 << 22
_REPLIES, _MISSIONS = 32, 16
#: lines by which the two clocks are compared: some seconds
_OFFSETS: Final = 20


class Reader:
    """Reads one station. `where`: the file of its socket, None while it has none. Times are monotonic seconds.

    Not safe for threads.
    """

    def __init__(self, where: Callable[[], Path | None]) -> None:
        self._where = where
        self._socket: socket.socket | None = None
        self._received = bytearray()
        self._waiting = bytearray()
        self._again_at = -inf
        #: this clock less the station's, at the last lines of this connection
        self._offsets: deque[float] = deque(maxlen=_OFFSETS)
        self._number = 0
        #: the last snapshot, and when its line arrived
        self.seen: StationSeen | None = None
        self.arrived_at = -inf
        #: mission packages by their digest
        self.missions: dict[str, bytes] = {}
        #: number of the order, whether it was used, text
        self.replies: deque[tuple[int, bool, str]] = deque(maxlen=_REPLIES)
        #: why there is no connection, "" if there is one
        self.fault = "it does not run here"

    @property
    def connected(self) -> bool:
        """Whether the station's socket is open."""
        return self._socket is not None

    def station_now(self, now: float) -> float:
        """The time by the clock of the station; of a station that has ended, as if it ran on."""
        return now - min(self._offsets) if self._offsets else now

    def age_s(self, now: float) -> float:
        """The age of the snapshot (s); inf: there is none."""
        return inf if self.seen is None else max(0.0, self.station_now(now) - self.seen.at)

    def send(self, order: Order) -> bool:
        """Send an order; returns whether there is a connection."""
        if self._socket is None:
            return False
        values = {"number": order.number, "do": order.do, "vehicle": order.vehicle, "argument": order.argument}
        self._waiting += json.dumps(values).encode() + b"\n"
        self._write()
        return self._socket is not None

    def next_number(self) -> int:
        """A number for the next order."""
        self._number += 1
        return self._number

    def tick(self, now: float) -> None:
        """Read what has arrived; to be called some times a second."""
        if self._socket is None and now >= self._again_at:
            self._again_at = now + _AGAIN_S
            self._open()
        self._write()
        self._read(now)

    def close(self) -> None:
        """Close the connection."""
        self._lose("closed")

    def _open(self) -> None:
        path = self._where()
        if path is None:
            self.fault = "it does not run here"
            return
        try:
            self._socket, token = connect(path)
        except (ConnectionError, FileNotFoundError):
            self.fault = "it has ended"
            return
        except OSError as error:
            self.fault = f"{path}: {error.strerror or error}"
            return
        except EndpointError as error:
            self.fault = str(error)
            return
        self.fault = ""
        self._offsets.clear()
        self._received, self._waiting = bytearray(), bytearray(json.dumps({"token": token}).encode() + b"\n")

    def _lose(self, why: str) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        self.fault = why

    def _write(self) -> None:
        if self._socket is None or not self._waiting:
            return
        try:
            del self._waiting[: self._socket.send(self._waiting)]
        except BlockingIOError:
            pass
        except OSError as error:
            self._lose(str(error.strerror or error))

    def _read(self, now: float) -> None:
        taken = 0
        while self._socket is not None and taken < _TURN:
            try:
                data = self._socket.recv(1 << 16)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self._lose("it has ended")
                break
            taken += len(data)
            self._received += data
        *lines, rest = bytes(self._received).split(b"\n")
        self._received = bytearray(rest)
        if len(rest) > _LINE:
            self._lose("it sends what is no snapshot")
            return
        for line in lines:
            self._on_line(line, now)

    def _on_line(self, line: bytes, now: float) -> None:
        try:
            values = json.loads(line)
            if isinstance(values, dict):
                self._on_values(values, now)
        except SnapshotError as error:
            self._lose(str(error))
        except (ValueError, RecursionError):
            self._lose("it sends what is no snapshot")

    def _on_values(self, values: Mapping[str, Any], now: float) -> None:
        kind = values.get("kind")
        if kind == "snapshot":
            seen = from_values(values)
            if self.seen is not None and self.seen.configuration != seen.configuration:
                self._lose(f"another station of this name runs, with {seen.configuration}")
                return
            self.seen, self.arrived_at = seen, now
            self._offsets.append(now - seen.at)
        elif kind == "mission" and isinstance(values.get("digest"), str):
            try:
                package = base64.b64decode(values.get("package", ""), validate=True)
            except (binascii.Error, TypeError, ValueError):
                return
            self.missions[values["digest"]] = package
            while len(self.missions) > _MISSIONS:
                del self.missions[next(iter(self.missions))]
        elif kind == "reply":
            number, used, text = values.get("number"), values.get("used"), values.get("text")
            if isinstance(number, int) and isinstance(used, bool) and isinstance(text, str):
                self.replies.append((number, used, text))

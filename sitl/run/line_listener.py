# SPDX-License-Identifier: GPL-3.0-or-later

"""Listens on the line from companion to autopilot: `python -m sitl.run.line_listener --config FILE --autopilot PORT`.

    journal = "listener.jsonl"
    listen = 14700                  # the companion connects here
    messages = ["GPS_RTCM_DATA"]    # what is journalled, both ways

It relays every byte unchanged between the companion and the autopilot's TCP port. So its journal shows what truly
reaches the autopilot, and what the autopilot says itself. An entry is `to_autopilot` or `from_autopilot`, with the
name of the message (`what`), its sender (`sysid`, `component`) and all its fields that are single numbers. It ends
when its input does.
"""

from __future__ import annotations

import argparse
import json
import select
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final, TextIO

from pymavlink.dialects.v20 import handover as mavlink

from sitl.run.ending import Orders
from sitl.vehicles.ports import LOOPBACK

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

__all__ = ["LISTENER", "Line", "main", "values_of"]

#: name of the process, and of its entries
LISTENER: Final = "listener"
TO_AUTOPILOT, FROM_AUTOPILOT = "to_autopilot", "from_autopilot"
_READ_BYTES: Final = 65536
_CONNECT_S: Final = 10.0
#: metres of a degree of latitude, as ArduPilot counts it
_DEGREE_M: Final = 111_318.84502145034
#: a TERRAIN_DATA has 4 x 4 heights; eight of them stand side by side in a block of the autopilot
_SIDE, _IN_A_ROW = 4, 8


def values_of(message: Any) -> dict[str, Any]:
    """The fields of a message that are single numbers, and what is derived from them."""
    fields = {name: getattr(message, name) for name in message.fieldnames}
    single = {name: value for name, value in fields.items() if isinstance(value, (int, float))}
    return {**single, **_DERIVED.get(message.get_type(), _nothing)(message)}


def _nothing(_message: Any) -> dict[str, float]:
    return {}


def _heights(message: Any) -> dict[str, float]:
    """Of sixteen heights: the northern edge (degrees), the lowest and the highest."""
    north = message.gridbit // _IN_A_ROW * _SIDE + _SIDE - 1
    return {
        "north_deg": round(message.lat / 1e7 + north * message.grid_spacing / _DEGREE_M, 7),
        "lowest_m": min(message.data),
        "highest_m": max(message.data),
    }


_DERIVED: Final[dict[str, Callable[[Any], dict[str, float]]]] = {"TERRAIN_DATA": _heights}


class Line:
    """The line, and its journal."""

    def __init__(self, listen: int, autopilot: int, messages: Sequence[str], journal: TextIO) -> None:
        """`listen`, `autopilot`: TCP ports of this machine. Raises OSError."""
        self._autopilot_port = autopilot
        self._wanted = frozenset(messages)
        self._journal = journal
        self._server = socket.create_server((LOOPBACK, listen))
        #: socket -> its other end, the event of its messages, and what parses them
        self._ends: dict[socket.socket, tuple[socket.socket, str, Any]] = {}
        self.note("loaded", f"listens for {', '.join(messages)}")

    @property
    def sockets(self) -> list[socket.socket]:
        """For select."""
        return [self._server, *self._ends]

    def note(self, event: str, text: str, **values: object) -> None:
        """Write to the journal."""
        utc = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": utc, "who": LISTENER, "event": event, "text": text, **values}
        self._journal.write(json.dumps(entry) + "\n")

    def readable(self, sock: socket.socket) -> None:
        """A socket has something: a companion that connects, bytes, or its end."""
        if sock is self._server:
            self._connected()
        elif sock in self._ends:
            self._passed_on(sock)

    def _connected(self) -> None:
        companion, _address = self._server.accept()
        self.close()  # a companion that starts again: the line is its own
        try:
            autopilot = socket.create_connection((LOOPBACK, self._autopilot_port), _CONNECT_S)
        except OSError:
            companion.close()
            return
        for source, sink, event in ((companion, autopilot, TO_AUTOPILOT), (autopilot, companion, FROM_AUTOPILOT)):
            source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            parser: Any = mavlink.MAVLink(None)
            parser.robust_parsing = True
            self._ends[source] = (sink, event, parser)

    def _passed_on(self, sock: socket.socket) -> None:
        sink, event, parser = self._ends[sock]
        try:
            data = sock.recv(_READ_BYTES)
            sink.sendall(data)
        except OSError:
            data = b""
        if not data:
            self.close()
            return
        for message in parser.parse_buffer(data) or ():
            name = message.get_type()
            if name in self._wanted:
                sender = {"sysid": message.get_srcSystem(), "component": message.get_srcComponent()}
                self.note(event, name, what=name, **sender, **values_of(message))

    def close(self) -> None:
        """Close both ends; the companion may connect again."""
        for sock in self._ends:
            with suppress(OSError):
                sock.close()
        self._ends.clear()


def main(argv: Sequence[str] | None = None) -> int:
    """Run until standard input ends."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.line_listener", description="Listens on a line.")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE")
    parser.add_argument("--autopilot", type=int, required=True, metavar="PORT")
    arguments = parser.parse_args(argv)
    config = tomllib.loads(arguments.config.read_text(encoding="utf-8"))
    orders = Orders()
    with Path(config["journal"]).open("a", encoding="utf-8", buffering=1) as journal:
        line = Line(config["listen"], arguments.autopilot, config["messages"], journal)
        while True:
            sources: list[Any] = [*orders.descriptors, *line.sockets]
            for readable in select.select(sources, [], [], 1.0)[0]:
                if isinstance(readable, socket.socket):
                    line.readable(readable)
                elif orders.read(readable) is None:
                    return 0


if __name__ == "__main__":
    raise SystemExit(main())

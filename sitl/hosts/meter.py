# SPDX-License-Identifier: GPL-3.0-or-later

"""Measures the cost of a tunnel during the flight: round trips with and without it, and bytes of each packet.

Two programs. `python -m sitl.hosts.meter echo PORT` on a station's host sends back what it gets. `python -m
sitl.hosts.meter ask FILE NAME=ADDRESS:PORT ... --see INTERFACE=PORT ...` runs on the mission computer. It asks each
address ten times a second, one after the other. So the path with the tunnel and the path without it have the same load
at the same time. It also counts packets on its interfaces. On a tunnel's own interface (port 0) it counts every UDP
packet, on the interface below it the packets of the tunnel's UDP port. FILE gets a line of JSON a second. All numbers
in it are totals, except `round_trips`, which are those since the line before.

Sizes are those of IP packets, with the IP header and without the frame of the cable.
"""

from __future__ import annotations

import argparse
import json
import select
import socket
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from sitl.run.ending import Orders

__all__ = ["ASK_BYTES", "Seen", "main"]

#: a signed heartbeat has 34 bytes, signed telemetry about 60
ASK_BYTES: Final = 60
_INTERVAL_S: Final = 0.1
_LINE_S: Final = 1.0
#: an answer that comes later is a lost one
_LATE_S: Final = 3.0
_ALL_PROTOCOLS: Final = 0x0003
_IPV4, _UDP = 0x0800, 17
#: first byte of a WireGuard datagram that carries a packet; one of 32 bytes carries none: a keepalive
_DATA, _EMPTY_BYTES = 4, 32
_BUFFER_BYTES: Final = 1 << 21


@dataclass(slots=True)
class Seen:
    """Packets on one interface: IP packets and their bytes, both ways."""

    #: port of the tunnel, on the interface below it; 0 on the tunnel's own
    port: int
    packets: int = 0
    total_bytes: int = 0
    #: what the tunnel needs for itself: handshakes and keepalives
    own_packets: int = 0
    own_bytes: int = 0

    def count(self, packet: bytes) -> None:
        """Count an IPv4 packet, if it is one that counts here."""
        if len(packet) < 28 or packet[0] >> 4 != 4 or packet[9] != _UDP:
            return
        header = (packet[0] & 0x0F) * 4
        if len(packet) < header + 9:
            return
        size = int.from_bytes(packet[2:4], "big")
        if self.port and self.port not in struct.unpack_from("!HH", packet, header):
            return
        if self.port and (packet[header + 8] != _DATA or size - header - 8 == _EMPTY_BYTES):
            self.own_packets += 1
            self.own_bytes += size
        else:
            self.packets += 1
            self.total_bytes += size


@dataclass(slots=True)
class _Asked:
    """One address that is asked."""

    name: str
    address: tuple[str, int]
    sent: int = 0
    answered: int = 0
    round_trips: list[float] = field(default_factory=list)
    waiting: dict[int, float] = field(default_factory=dict)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one of the two programs until its input ends."""
    parser = argparse.ArgumentParser(prog="python -m sitl.hosts.meter", description="Measure what a tunnel costs.")
    below = parser.add_subparsers(dest="role", required=True)
    echo = below.add_parser("echo", help="send back what comes")
    echo.add_argument("port", type=int)
    ask = below.add_parser("ask", help="measure")
    ask.add_argument("file", type=Path)
    ask.add_argument("targets", nargs="+", metavar="NAME=ADDRESS:PORT")
    ask.add_argument("--see", action="append", default=[], metavar="INTERFACE=PORT")
    arguments = parser.parse_args(argv)
    orders = Orders()
    if arguments.role == "echo":
        _echo(arguments.port, orders)
    else:
        see = dict(_see(text) for text in arguments.see)
        _Meter(arguments.file, arguments.targets, see).run(orders)
    return 0


def _see(text: str) -> tuple[str, int]:
    """Interface and port."""
    name, _, port = text.partition("=")
    return name, int(port)


def _echo(port: int, orders: Orders) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("0.0.0.0", port))
        udp.setblocking(False)
        print("ready", flush=True)
        while True:
            readable, _, _ = select.select([udp.fileno(), *orders.descriptors], [], [])
            if any(each != udp.fileno() and orders.read(each) is None for each in readable):
                return
            try:
                udp.sendto(*udp.recvfrom(2048))
            except OSError:  # the path is cut
                continue


class _Meter:
    """The program that asks."""

    def __init__(self, path: Path, targets: Sequence[str], see: dict[str, int]) -> None:
        """Raises OSError."""
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self._asked: list[_Asked] = []
        for text in targets:
            name, _, address = text.partition("=")
            host, _, port = address.rpartition(":")
            self._asked.append(_Asked(name, (host, int(port))))
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.setblocking(False)
        self._taps: dict[socket.socket, Seen] = {}
        self._names: dict[socket.socket, str] = {}
        for name, below in see.items():
            tap = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL_PROTOCOLS))
            tap.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            tap.bind((name, _ALL_PROTOCOLS))
            tap.setblocking(False)
            self._taps[tap], self._names[tap] = Seen(below), name

    def run(self, orders: Orders) -> None:
        """Measure until told to end."""
        print("ready", flush=True)
        ask_at = line_at = time.monotonic()
        number = 0
        while True:
            now = time.monotonic()
            if now >= ask_at:
                ask_at = max(ask_at + _INTERVAL_S / len(self._asked), now - _INTERVAL_S)
                self._ask(self._asked[number % len(self._asked)], number, now)
                number += 1
            if now >= line_at:
                line_at = now + _LINE_S
                self._write(now)
            wait_s = max(0.0, min(ask_at, line_at) - time.monotonic())
            sockets = [self._udp.fileno(), *(tap.fileno() for tap in self._taps)]
            readable, _, _ = select.select([*sockets, *orders.descriptors], [], [], wait_s)
            if any(each not in sockets and orders.read(each) is None for each in readable):
                self._write(time.monotonic())
                return
            self._answers()
            for tap in self._taps:
                self._count(tap)

    def _ask(self, asked: _Asked, number: int, now: float) -> None:
        for old in [key for key, at in asked.waiting.items() if now - at > _LATE_S]:
            del asked.waiting[old]
        asked.sent += 1
        asked.waiting[number] = now
        try:
            self._udp.sendto(number.to_bytes(8, "big").ljust(ASK_BYTES, b"\0"), asked.address)
        except OSError:  # no way there now
            pass

    def _answers(self) -> None:
        while True:
            try:
                data, address = self._udp.recvfrom(2048)
            except OSError:
                return
            now, number = time.monotonic(), int.from_bytes(data[:8], "big")
            for asked in self._asked:
                if asked.address == address and number in asked.waiting:
                    asked.answered += 1
                    asked.round_trips.append(now - asked.waiting.pop(number))

    def _count(self, tap: socket.socket) -> None:
        seen = self._taps[tap]
        for _ in range(256):
            try:
                packet, where = tap.recvfrom(2048)
            except OSError:
                return
            if where[1] == _IPV4:
                seen.count(packet)

    def _write(self, now: float) -> None:
        line: dict[str, Any] = {"t": round(now, 4), "asked": {}, "seen": {}}
        for asked in self._asked:
            trips = [round(value, 6) for value in asked.round_trips]
            line["asked"][asked.name] = {"sent": asked.sent, "answered": asked.answered, "round_trips": trips}
            asked.round_trips.clear()
        for tap, seen in self._taps.items():
            line["seen"][self._names[tap]] = {
                "packets": seen.packets,
                "bytes": seen.total_bytes,
                "own_packets": seen.own_packets,
                "own_bytes": seen.own_bytes,
            }
        self._file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    raise SystemExit(main())

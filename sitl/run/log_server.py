# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m sitl.run.log_server`: an autopilot that serves one log, for machines without ArduCopter's program.

It handles log requests as ArduPilot does: one download at a time, and requests meanwhile are ignored. On TCP it sends
as fast as the other end reads. On UDP it sends one frame a datagram, `_UDP_HZ` of them a second, as ArduPilot's
simulation does. The log is made of random bytes from a fixed seed (`log_bytes`). It says "ready" when it listens.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import FrameSplitter
from sitl.vehicles.ports import LOOPBACK

__all__ = ["log_bytes", "main"]

VEHICLE, AUTOPILOT = 1, 1
_LOG: Final = 1
_DATA_BYTES: Final = 90
#: measured with ArduCopter 4.7: 150 kB of log a second
_UDP_HZ: Final = 1680.0
#: bytes that wait to leave by one link, at most: as the transmit buffer of an autopilot
_OUT_BYTES: Final = 8192
_BEAT_S: Final = 1.0


def log_bytes(size: int) -> bytes:
    """The log."""
    return random.Random(42).randbytes(size)


class _Link:
    """One client. `write` takes a frame; `room` waits until another frame of the log may be put."""

    def __init__(self, write: Callable[[bytes], None], room: Callable[[], Awaitable[None]]) -> None:
        self.room = room
        self.splitter = FrameSplitter()
        self._write = write
        self._own = mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=AUTOPILOT)

    def put(self, message: Any) -> None:
        raw = bytes(message.pack(self._own))
        self._own.seq = (self._own.seq + 1) & 0xFF
        with suppress(OSError):
            self._write(raw)


class _Pace:
    """At most so many frames a second."""

    def __init__(self, hz: float) -> None:
        self._interval_s = 1.0 / hz
        self._due = 0.0

    async def __call__(self) -> None:
        now = time.monotonic()
        self._due = max(self._due + self._interval_s, now - 0.01)
        if self._due > now:
            await asyncio.sleep(self._due - now)


class _Datagrams(asyncio.DatagramProtocol):
    receive: Callable[[bytes], None]

    def datagram_received(self, data: bytes, addr: object) -> None:
        self.receive(data)


class _Server:
    def __init__(self, log: bytes) -> None:
        self._log = log
        self._links: list[_Link] = []
        self._parser = mavlink.MAVLink(None)
        #: sends the log
        self._serving: asyncio.Task[None] | None = None

    async def beat(self) -> None:
        """Say once a second what this is, and where."""
        kind, pilot = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        while True:
            for link in self._links:
                link.put(mavlink.MAVLink_heartbeat_message(kind, pilot, 81, 0, mavlink.MAV_STATE_STANDBY, 3))
                link.put(mavlink.MAVLink_global_position_int_message(0, 526792000, 59240000, 0, 0, 0, 0, 0, 0))
            await asyncio.sleep(_BEAT_S)

    async def by_tcp(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a client until it has gone."""
        writer.transport.set_write_buffer_limits(_OUT_BYTES, _OUT_BYTES)
        link = _Link(writer.write, writer.drain)
        self._links.append(link)
        with suppress(OSError):
            while data := await reader.read(65536):
                self._take(link, data)
        self._links.remove(link)
        self._stop()
        writer.close()

    async def by_udp(self, port: int) -> None:
        """Send to a port, and take what comes back."""
        loop, client = asyncio.get_running_loop(), _Datagrams()
        transport, _ = await loop.create_datagram_endpoint(lambda: client, remote_addr=(LOOPBACK, port))
        link = _Link(transport.sendto, _Pace(_UDP_HZ))
        client.receive = lambda data: self._take(link, data)
        self._links.append(link)

    def _take(self, link: _Link, data: bytes) -> None:
        for frame in link.splitter.feed(data):
            if frame.msgid == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END:
                self._stop()
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA and self._serving is None:
                m = self._parser.decode(bytearray(frame.raw))
                self._serving = asyncio.create_task(self._serve(link, m.ofs, m.ofs + m.count))

    async def _serve(self, link: _Link, place: int, end: int) -> None:
        part = bytes(_DATA_BYTES)
        while len(part) == _DATA_BYTES and place < end:
            part = self._log[place : min(end, place + _DATA_BYTES)]
            with suppress(OSError):
                await link.room()
            link.put(mavlink.MAVLink_log_data_message(_LOG, place, len(part), [*part.ljust(_DATA_BYTES, b"\0")]))
            place += len(part)
        self._serving = None

    def _stop(self) -> None:
        if self._serving is not None:
            self._serving.cancel()
        self._serving = None


async def _serve(log: bytes, tcp: list[int], udp: list[int]) -> None:
    server = _Server(log)
    for port in tcp:
        await asyncio.start_server(server.by_tcp, LOOPBACK, port)
    for port in udp:
        await server.by_udp(port)
    print("ready", flush=True)
    await server.beat()


def main(argv: list[str]) -> None:
    """Serve until the process is ended."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.log_server")
    parser.add_argument("--size", type=int, required=True, help="bytes of the log")
    parser.add_argument("--tcp", type=int, action="append", default=[], help="port to listen at")
    parser.add_argument("--udp", type=int, action="append", default=[], help="port to send to")
    arguments = parser.parse_args(argv)
    asyncio.run(_serve(log_bytes(arguments.size), arguments.tcp, arguments.udp))


if __name__ == "__main__":
    main(sys.argv[1:])

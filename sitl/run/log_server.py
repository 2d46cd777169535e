# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m sitl.run.log_server`: an autopilot that serves one log, for machines without ArduCopter's program.

It handles log requests as ArduPilot does: one download at a time, and requests meanwhile are ignored. On TCP it sends
as fast as the other end reads. On UDP it sends one frame a datagram, `_UDP_HZ` of them a second, as ArduPilot's
simulation does. The log is made of random bytes from a fixed seed (`log_bytes`).
"""

from __future__ import annotations

import argparse
import random
import select
import socket
import sys
import time
from contextlib import suppress
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, FrameSplitter
from sitl.vehicles.ports import LOOPBACK

__all__ = ["log_bytes", "main"]

VEHICLE, AUTOPILOT = 1, 1
_LOG = 1
_DATA_BYTES = 90
#: measured with ArduCopter 4.7: 150 kB of log a second
_UDP_HZ = 1680.0
#: bytes that wait to leave by one link, at most: as the transmit buffer of an autopilot
_OUT_BYTES = 8192
_BEAT_S = 1.0


def log_bytes(size: int) -> bytes:
    """The log."""
    return random.Random(42).randbytes(size)


class _Link:
    """One link; `listener` of TCP, which has one client at a time, or an address for UDP."""

    def __init__(self, sock: socket.socket, address: tuple[str, int] | None = None) -> None:
        self._address = address
        self._listener = sock if address is None else None
        self.socket: socket.socket | None = None if address is None else sock
        self._out = bytearray()
        self._splitter = FrameSplitter()
        self._own = mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=AUTOPILOT)
        self._sent_at = time.monotonic()

    def descriptors(self) -> list[socket.socket]:
        return [sock for sock in (self._listener, self.socket) if sock is not None]

    def wants_to_write(self) -> bool:
        return self.socket is not None and (bool(self._out) or self._address is not None)

    def room(self) -> bool:
        """Whether another frame of the log may be put."""
        if self.socket is None:
            return False
        if self._address is None:
            return len(self._out) < _OUT_BYTES
        now = time.monotonic()
        if now - self._sent_at < 1.0 / _UDP_HZ:
            return False
        self._sent_at = max(self._sent_at + 1.0 / _UDP_HZ, now - 0.01)
        return True

    def put(self, message: Any) -> None:
        if self.socket is None:
            return
        raw = bytes(message.pack(self._own))
        self._own.seq = (self._own.seq + 1) & 0xFF
        if self._address is not None:
            with suppress(OSError):
                self.socket.sendto(raw, self._address)
            return
        self._out += raw
        self.push()

    def push(self) -> None:
        if self.socket is None or not self._out:
            return
        try:
            del self._out[: self.socket.send(self._out)]
        except BlockingIOError:
            pass
        except OSError:
            self._lost()

    def receive(self, ready: socket.socket) -> list[Frame]:
        """Whole frames that have arrived."""
        if ready is self._listener:
            self._lost()
            self.socket = self._listener.accept()[0]
            self.socket.setblocking(False)
            return []
        try:
            data = ready.recv(65536)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            if self._address is None:
                self._lost()
            return []
        return self._splitter.feed(data)

    def _lost(self) -> None:
        if self.socket is not None:
            self.socket.close()
        self.socket, self._splitter = None, FrameSplitter()
        self._out.clear()


class _Server:
    def __init__(self, log: bytes, links: list[_Link]) -> None:
        self._log = log
        self._links = links
        self._parser = mavlink.MAVLink(None)
        #: the link that gets the log, and from where to where
        self._served: _Link | None = None
        self._next = self._end = 0

    def run(self) -> None:
        beat_at = 0.0
        while True:
            now = time.monotonic()
            if now >= beat_at:
                beat_at = now + _BEAT_S
                self._beat()
            readers = {sock: link for link in self._links for sock in link.descriptors()}
            sends = self._served is not None
            writers = [link.socket for link in self._links if link.socket is not None and link.wants_to_write()]
            ready, _, _ = select.select(list(readers), writers if sends else [], [], 0.001 if sends else 0.1)
            for sock in ready:
                for frame in readers[sock].receive(sock):
                    self._take(readers[sock], frame)
            for link in self._links:
                link.push()
            self._send()

    def _beat(self) -> None:
        kind, pilot = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        for link in self._links:
            link.put(mavlink.MAVLink_heartbeat_message(kind, pilot, 81, 0, mavlink.MAV_STATE_STANDBY, 3))
            link.put(mavlink.MAVLink_global_position_int_message(0, 526792000, 59240000, 0, 0, 0, 0, 0, 0))

    def _take(self, link: _Link, frame: Frame) -> None:
        if frame.msgid == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END:
            self._served = None
        elif frame.msgid == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA and self._served is None:
            m = self._parser.decode(bytearray(frame.raw))
            self._served, self._next, self._end = link, m.ofs, min(len(self._log), m.ofs + m.count)

    def _send(self) -> None:
        for _ in range(40):
            link = self._served
            if link is None or not link.room():
                return
            part = self._log[self._next : min(self._end, self._next + _DATA_BYTES)]
            link.put(mavlink.MAVLink_log_data_message(_LOG, self._next, len(part), [*part.ljust(_DATA_BYTES, b"\0")]))
            self._next += len(part)
            if len(part) < _DATA_BYTES or self._next >= self._end:
                self._served = None


def main(argv: list[str]) -> None:
    """Serve until the process is ended."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.log_server")
    parser.add_argument("--size", type=int, required=True, help="bytes of the log")
    parser.add_argument("--tcp", type=int, action="append", default=[], help="port to listen at")
    parser.add_argument("--udp", type=int, action="append", default=[], help="port to send to")
    arguments = parser.parse_args(argv)
    links = []
    for port in arguments.tcp:
        links.append(_Link(socket.create_server((LOOPBACK, port))))
    for port in arguments.udp:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setblocking(False)
        links.append(_Link(sock, (LOOPBACK, port)))
    _Server(log_bytes(arguments.size), links).run()


if __name__ == "__main__":
    main(sys.argv[1:])

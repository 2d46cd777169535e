# SPDX-License-Identifier: GPL-3.0-or-later

"""A MAVLink link that is only listened to.

    udpin:HOST:PORT   what is sent to a local address, as by `--out=udp:HOST:PORT` of a MAVProxy
    tcp:HOST:PORT     what a server sends, after connecting to it

Rules that live here
--------------------
* After a socket is open, it is only read from, and closed.
* Other kinds of link are refused: they need a first message from this side, or are lines that another program uses.
* A server that is not there, or ends, is tried again. Of a flood MOST_FRAMES a second are read; the rest is dropped.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError, parse_device
from mavproxy_handover.wire.frames import Frame, FrameSplitter

__all__ = ["MOST_FRAMES", "PassiveLink", "parse_passive_link"]

#: frames read from one link in a second
MOST_FRAMES: Final = 4000
#: time (s) until a server is tried again
_AGAIN_S: Final = 2.0
_BYTES: Final = 65536


def parse_passive_link(text: str) -> DeviceSpec:
    """The meaning of a device string. Raises LinkError, one line, for a link that cannot be only listened to."""
    device = parse_device(text)
    if device.kind not in (Kind.UDP_IN, Kind.TCP_OUT):
        raise LinkError(f"link {text}: only udpin:HOST:PORT and tcp:HOST:PORT can be listened to without a word")
    return device


class PassiveLink:
    """One link. `on_frame`: gets each frame; `now`: the clock, monotonic seconds."""

    def __init__(self, device: DeviceSpec, on_frame: Callable[[Frame], None], now: Callable[[], float]) -> None:
        self.device = device
        #: its state, in words
        self.state = "not open yet"
        #: frames beyond MOST_FRAMES a second, and bytes that are no frames
        self.thrown_away = 0
        self.garbage = 0
        self._on_frame = on_frame
        self._now = now
        self._second, self._left = 0, MOST_FRAMES

    def bind(self) -> socket.socket | None:
        """Open a local address, before anything else starts; None: the link has none. Raises LinkError."""
        if self.device.kind is not Kind.UDP_IN:
            return None
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.bind((self.device.host, self.device.port))
        except OSError as error:
            opened.close()
            raise LinkError(f"link {self.device.text}: {error.strerror or error}") from None
        opened.setblocking(False)
        self.state = "listening"
        return opened

    async def run(self, opened: socket.socket | None) -> None:
        """Listen until cancelled. `opened`: what `bind` returned."""
        while True:
            try:
                if opened is not None:
                    await self._datagrams(opened)
                else:
                    await self._stream()
            except OSError as error:
                self.state = f"not connected: {error.strerror or error}"
            await asyncio.sleep(_AGAIN_S)

    async def _datagrams(self, opened: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            data = await loop.sock_recv(opened, _BYTES)
            # a splitter for each datagram: there may be several senders, and frames are never cut
            splitter = FrameSplitter()
            self._handle_frames(splitter.feed(data))
            self.garbage += splitter.counters.garbage_bytes + splitter.waiting

    async def _stream(self) -> None:
        loop = asyncio.get_running_loop()
        splitter = FrameSplitter()
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as opened:
            opened.setblocking(False)
            await loop.sock_connect(opened, (self.device.host, self.device.port))
            self.state = "connected"
            while data := await loop.sock_recv(opened, _BYTES):
                before = splitter.counters.garbage_bytes
                self._handle_frames(splitter.feed(data, self._now()))
                self.garbage += splitter.counters.garbage_bytes - before
        self.state = "not connected: the server has ended it"

    def _handle_frames(self, frames: list[Frame]) -> None:
        second = int(self._now())
        if second != self._second:
            self._second, self._left = second, MOST_FRAMES
        taken = frames[: self._left]
        self._left -= len(taken)
        self.thrown_away += len(frames) - len(taken)
        for frame in taken:
            with suppress(Exception):  # a fault in one frame must not cost the next ones
                self._on_frame(frame)

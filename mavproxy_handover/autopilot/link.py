# SPDX-License-Identifier: GPL-3.0-or-later

"""The way to the autopilot: MAVProxy's own link, with as little as possible between the gate and the wire.

Rules that live here:

1. Which link it is, is MAVProxy's choice. To ask is a search through all links, so it is asked again twenty times
   a second (`choose`), and at once when the link is no more.
2. A serial line is written to directly, and never waited for (`link/line_writer.py`), also in what MAVProxy itself
   writes. pyserial looks at the line again after each write, which costs as much as the write itself. Every fault is
   for MAVProxy, which reports it and opens the line again. The new line is written to directly from the next choice of
   the link on.
3. With a key of the autopilot, frames are signed here, once; ids and payload stay the sender's. The autopilot refuses a
   stamp that is not newer than the last, so ours outlive a restart (`peer`'s state is kept), and follow those that its
   heartbeats prove: one that has heard younger ones says so.
4. What was written goes into MAVProxy's tlog too, as MAVProxy does with what it forwards itself. The way there leads
   through a pipe, which costs several times what a frame costs elsewhere, so all frames of LOG_S take it at once:
   they have their own time each, and stand that much behind their place in the file at most.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from mavproxy_handover.clocks import Clocks
from mavproxy_handover.link.line_writer import LineWriter, is_line
from mavproxy_handover.wire.frames import parse_one
from mavproxy_handover.wire.signing import SignedPeer

__all__ = ["LOG_S", "AutopilotLink"]

#: MAVProxy's own signed messages use link id 0
_LINK_ID: Final = 1
LOG_S: Final = 0.25
_STAMP: Final = struct.Struct(">Q")


class AutopilotLink:
    """Takes whole frames. `find` is MAVProxy's search for the link, `peer` the autopilot's key, if there is one."""

    def __init__(self, mpstate: Any, find: Callable[[], Any], peer: SignedPeer | None, clocks: Clocks) -> None:
        self._clocks = clocks
        self._mpstate = mpstate
        self._find = find
        self._peer = peer
        self._master: Any = None
        #: the serial line behind the link, if there is one and it has a descriptor (not so on Windows)
        self._line: LineWriter | None = None
        #: what was written, and when (UTC s)
        self._log: list[tuple[float, bytes]] = []
        self._log_at = 0.0

    def choose(self) -> None:
        """Ask MAVProxy anew which link leads to the autopilot."""
        self._master = self._find()
        port = getattr(self._master, "port", None)
        if self._line is None or self._line.port is not port:
            self._line = LineWriter(port) if is_line(port) else None

    @property
    def signed(self) -> bool:
        """Whether the autopilot has a key."""
        return self._peer is not None

    def heard(self, message: Any) -> None:
        """A message of the autopilot's side, as MAVProxy hands it over. Its key is nothing to us but for the stamps."""
        if self._peer is None or message.get_type() != "HEARTBEAT":
            return
        frame = parse_one(bytes(message.get_msgbuf()))
        if frame is not None:
            self._peer.check(frame, self._clocks.utc(), self._clocks.monotonic())

    def write(self, data: bytes) -> None:
        """Send a frame. Without a link it is gone; whatever a link raises is passed on."""
        if self._peer is not None:
            data = self._peer.sign(data, _LINK_ID, self._clocks.utc(), self._clocks.monotonic()) or data
        if self._master not in self._mpstate.mav_master:
            self.choose()
        master, line = self._master, self._line
        if master is None:  # after `link remove`
            return
        # a line that was closed under its link: the number may be another file's by now
        written = False
        port: Any = getattr(master, "port", None)
        if line is not None and line.port is port and not master.portdead:
            with suppress(OSError, TypeError):  # unplugged, or just being opened again
                written = port.fd == master.fd and line.write(data) > 0
        if not written:
            master.write(data)
        self._log.append((self._clocks.utc(), data))

    def tick(self, now: float) -> None:
        """Send what a line did not take, and hand what was sent in LOG_S to MAVProxy's tlog; to be called often."""
        line = self._line
        if line is not None:
            with suppress(OSError):  # the next frame finds out
                line.push()
        if now >= self._log_at:
            self._log_at = now + LOG_S
            self.log()

    def release(self) -> None:
        """Give the line back as it was."""
        if self._line is not None:
            self._line.release()
            self._line = None

    def log(self) -> None:
        """The same at once."""
        frames, self._log = self._log, []
        queue = getattr(self._mpstate, "logqueue", None)
        if frames and queue:
            queue.put(b"".join(_STAMP.pack(int(at * 1e6)) + data for at, data in frames))

# SPDX-License-Identifier: GPL-3.0-or-later

"""The link to the autopilot: MAVProxy's own link, with little work between the gate and the wire.

Rules:

1. MAVProxy chooses the link. The choice searches all links, so it is made twenty times a second (`choose`), and at once
   when the link no longer exists.
2. A serial line is written to directly, without waiting for it (`link/line_writer.py`), also by MAVProxy itself.
   pyserial waits for the line again after each write, which costs as much as the write. MAVProxy handles every fault:
   it reports the fault and opens the line again. The new line is written to directly after the next choice of the link.
3. With a key of the autopilot, frames are signed here, once; ids and payload stay the sender's. The autopilot refuses a
   timestamp that is not newer than the last one. So the timestamps continue after a restart (the state of `peer` is
   kept), and follow those that the autopilot's signed heartbeats prove.
4. Written frames also go into MAVProxy's tlog, like those that MAVProxy forwards itself. They go through a pipe, which
   costs several times the other costs of a frame, so all frames of LOG_S are sent together. Each frame has its own
   time, and is at most LOG_S late in the file.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from mavproxy_handover.link.line_writer import LineWriter, is_line, line_baud
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.frames import parse_one
from mavproxy_handover.wire.signing import SignedPeer

__all__ = ["LOG_S", "AutopilotLink"]

#: MAVProxy's own signed messages use link id 0
_LINK_ID: Final = 1
LOG_S: Final = 0.25
_STAMP: Final = struct.Struct(">Q")


class AutopilotLink:
    """Takes whole frames. `find` is MAVProxy's search for the link, `peer` the autopilot's key, if there is one.
    `rated` is told the baud rate of each line; None: no rate limits it."""

    def __init__(
        self,
        mpstate: Any,
        find: Callable[[], Any],
        peer: SignedPeer | None,
        clocks: Clocks,
        rated: Callable[[int | None], None],
    ) -> None:
        self._clocks = clocks
        self._mpstate = mpstate
        self._find = find
        self._peer = peer
        self._rated = rated
        self._port: Any = None
        self._master: Any = None
        #: the serial line of the link, if it has one with a descriptor (Windows has none)
        self._line: LineWriter | None = None
        #: the written frames, with their times (UTC s)
        self._log: list[tuple[float, bytes]] = []
        self._log_at = 0.0

    def choose(self) -> None:
        """Ask MAVProxy again which link leads to the autopilot."""
        self._master = self._find()
        port = getattr(self._master, "port", None)
        if port is not self._port:
            self._port = port
            self._rated(line_baud(port))
        if self._line is None or self._line.port is not port:
            self._line = LineWriter(port) if is_line(port) else None

    @property
    def signed(self) -> bool:
        """Whether the autopilot has a key."""
        return self._peer is not None

    def track_timestamp(self, message: Any) -> None:
        """A message of the autopilot's side, from MAVProxy. The key serves only to follow its timestamps."""
        if self._peer is None or message.get_type() != "HEARTBEAT":
            return
        frame = parse_one(bytes(message.get_msgbuf()))
        if frame is not None:
            self._peer.check(frame, self._clocks.utc(), self._clocks.monotonic())

    def write(self, data: bytes) -> None:
        """Send a frame. Without a link the frame is lost. Raises what the link raises."""
        if self._peer is not None:
            data = self._peer.sign(data, _LINK_ID, self._clocks.utc(), self._clocks.monotonic()) or data
        if self._master not in self._mpstate.mav_master:
            self.choose()
        master, line = self._master, self._line
        if master is None:  # after `link remove`
            return
        # after the line was closed, its descriptor may belong to another file
        written = False
        port: Any = getattr(master, "port", None)
        if line is not None and line.port is port and not master.portdead:
            with suppress(OSError, TypeError):  # the line is unplugged, or being opened again
                written = port.fd == master.fd and line.write(data) > 0
        if not written:
            master.write(data)
        self._log.append((self._clocks.utc(), data))

    def tick(self, now: float) -> None:
        """Send what the line did not accept yet, and write the log each LOG_S; to be called often."""
        line = self._line
        if line is not None:
            with suppress(OSError):  # the next frame reports it
                line.push()
        if now >= self._log_at:
            self._log_at = now + LOG_S
            self.log()

    def release(self) -> None:
        """Return the line to MAVProxy in its former state."""
        if self._line is not None:
            self._line.release()
            self._line = None

    def log(self) -> None:
        """Send the written frames to MAVProxy's tlog now."""
        frames, self._log = self._log, []
        queue = getattr(self._mpstate, "logqueue", None)
        if frames and queue:
            queue.put(b"".join(_STAMP.pack(int(at * 1e6)) + data for at, data in frames))

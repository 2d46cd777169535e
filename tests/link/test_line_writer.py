# SPDX-License-Identifier: GPL-3.0-or-later

"""The line to the autopilot when more is written than it takes: the lease keeps its room."""

from __future__ import annotations

import os

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.line_writer import LineWriter
from mavproxy_handover.wire.frames import FrameSplitter
from mavproxy_handover.wire.ids import LEASE_TUNNEL
from tests.link.frames import command


class Pipe:
    """A line that keeps what it takes until it is read."""

    def __init__(self) -> None:
        self.far, self.fd = os.pipe()
        os.set_blocking(self.far, False)
        os.set_blocking(self.fd, False)

    def read(self) -> bytes:
        try:
            return os.read(self.far, 1 << 20)
        except BlockingIOError:
            return b""


def lease(number: int) -> bytes:
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    own.seq = number
    payload = [number, *[1] * 40, *[0] * 87]
    return bytes(mavlink.MAVLink_tunnel_message(1, 1, LEASE_TUNNEL, 41, payload).pack(own))


def test_a_flood_keeps_no_lease_from_the_line() -> None:
    pipe = Pipe()
    line = LineWriter(pipe)
    number = 0
    while not line.refused:
        line.write(command(number & 0xFF).raw)
        number += 1
    for each in range(5):
        line.write(lease(each))
        line.write(command(each).raw)
    assert line.refused == 6, "the frames of the flood, and no lease"
    splitter, arrived = FrameSplitter(), []
    while data := pipe.read():
        arrived += splitter.feed(data)
        line.push()
    tunnels = [frame.seq for frame in arrived if frame.msgid == mavlink.MAVLINK_MSG_ID_TUNNEL]
    assert tunnels == [0, 1, 2, 3, 4]
    assert splitter.counters.garbage_bytes == 0
    os.close(pipe.fd)
    os.close(pipe.far)

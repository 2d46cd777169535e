# SPDX-License-Identifier: GPL-3.0-or-later

"""The last step of a frame to the autopilot: the serial line directly, all else by MAVProxy, and the tlog."""

from __future__ import annotations

import os
import struct
import time
import tty
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import serial
from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.autopilot_line import LOG_S, AutopilotLink
from mavproxy_handover.tools.clocks import Clocks
from tests.module.conftest import Bench

FRAME = bytes(range(40))


class Log:
    """MAVProxy's queue of what belongs into the tlog."""

    def __init__(self) -> None:
        self.taken: list[bytes] = []

    def put(self, data: bytes) -> None:
        self.taken.append(bytes(data))


class Master:
    """A link of MAVProxy's; `written` is what came by way of MAVProxy."""

    def __init__(self, port: Any = None, fd: int | None = None) -> None:
        self.port, self.fd, self.portdead = port, fd, False
        self.written: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.written.append(data)


class Line:
    """A serial line: `master` is MAVProxy's end, `far` the autopilot's."""

    def __init__(self) -> None:
        self.far, near = os.openpty()
        tty.setraw(self.far)
        tty.setraw(near)
        self.port = serial.Serial(os.ttyname(near), timeout=0)
        os.close(near)
        os.set_blocking(self.far, False)
        self.master = Master(self.port, self.port.fileno())

    def arrived(self) -> bytes:
        time.sleep(0.01)  # the line discipline hands over in its own time
        try:
            return os.read(self.far, 65536)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        self.port.close()
        os.close(self.far)


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.close()


def link_to(
    *masters: Any, log: Log | None = None, rated: Callable[[int | None], None] = lambda _baud: None
) -> AutopilotLink:
    state = SimpleNamespace(mav_master=list(masters), logqueue=log)
    return AutopilotLink(
        state,
        lambda: state.mav_master[-1] if state.mav_master else None,
        None,
        Clocks(time.time, time.monotonic),
        rated,
    )


def test_a_serial_line_gets_the_frame_without_a_detour(line: Line) -> None:
    link_to(line.master).write(FRAME)
    assert line.arrived() == FRAME
    assert line.master.written == []


def test_the_baud_rate_of_each_link_is_told_once(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[int | None] = []
    line.port.baudrate = 57600
    link = link_to(line.master, rated=found.append)
    for _time in range(3):
        link.choose()
    assert found == [57600]
    monkeypatch.setattr(line.port, "_port", "/dev/ttyACM0")
    link_to(line.master, rated=found.append).choose()
    link_to(Master(object()), rated=found.append).choose()
    assert found == [57600, None, None], "USB and UDP have no rate that limits them"


def test_what_the_line_does_not_take_leaves_with_the_next_tick(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    write, room = os.write, [7, 0, 50, 100]

    def takes(descriptor: int, data: bytes) -> int:
        return write(descriptor, data[: room.pop(0)])

    monkeypatch.setattr("mavproxy_handover.link.line_writer.os.write", takes)
    link = link_to(line.master)
    link.write(FRAME)
    assert line.arrived() == FRAME[:7]
    link.write(FRAME)
    link.tick(0.0)
    assert line.arrived() == FRAME[7:] + FRAME
    assert line.master.written == []


def test_a_line_that_nobody_reads_holds_nobody_up(line: Line) -> None:
    """MAVProxy opens it without a time-out for writing. What MAVProxy itself writes goes the same way."""
    link = link_to(line.master)
    link.choose()
    begun = time.monotonic()
    for _ in range(2000):
        link.write(FRAME)
        assert line.port.write(FRAME) == len(FRAME)
        link.tick(begun)
    assert time.monotonic() - begun < 20.0  # a wait of 10 ms for each is noticed, a busy machine is not
    assert line.master.written == []
    found = b""
    while data := line.arrived():
        found += data
        link.tick(begun)
    assert len(found) > 4096
    assert found == FRAME * (len(found) // len(FRAME)), "whole frames alone"
    link.release()
    assert "write" not in vars(line.port)


def test_frames_stay_whole_and_in_order(line: Line) -> None:
    link = link_to(line.master)
    for _ in range(10):
        link.write(FRAME)
    assert line.arrived() == FRAME * 10


def test_a_line_that_is_gone_is_left_to_mavproxy(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(descriptor: int, data: bytes) -> int:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "write", fails)
    link_to(line.master).write(FRAME)
    assert line.master.written == [FRAME]


def test_a_dead_or_missing_descriptor_is_left_to_mavproxy(line: Line) -> None:
    line.master.portdead = True
    link_to(line.master).write(FRAME)
    line.master.portdead, line.master.fd = False, None
    link_to(line.master).write(FRAME)
    assert line.master.written == [FRAME, FRAME]
    assert line.arrived() == b""


def test_a_link_that_is_no_serial_line_is_written_to_by_mavproxy() -> None:
    master = Master()
    link_to(master).write(FRAME)
    assert master.written == [FRAME]


def test_a_link_that_changes_its_port_is_written_to_by_mavproxy_until_it_is_looked_at_again(line: Line) -> None:
    serial_port = line.master.port
    link = link_to(line.master)
    for port, there in ((object(), False), (serial_port, True), (None, False)):
        line.master.port = port
        line.master.written.clear()
        link.write(FRAME)
        assert (line.arrived(), line.master.written) == (b"", [FRAME])
        line.master.written.clear()
        link.choose()
        link.write(FRAME)
        assert (line.arrived(), line.master.written) == ((FRAME, []) if there else (b"", [FRAME]))


def test_pymavlink_s_own_serial_link_is_such_a_line(line: Line) -> None:
    line.port.close()
    master = mavutil.mavserial(line.port.port, source_system=1)
    try:
        link_to(master).write(FRAME)
        assert line.arrived() == FRAME
    finally:
        master.close()


def test_a_link_that_was_removed_is_not_written_to() -> None:
    first, second = Master(), Master()
    link = link_to(first, second)
    link.write(FRAME)
    link._mpstate.mav_master.remove(second)
    link.write(FRAME)
    assert (first.written, second.written) == ([FRAME], [FRAME])
    link._mpstate.mav_master.clear()
    link.write(FRAME)  # and nothing raises
    assert (first.written, second.written) == ([FRAME], [FRAME])


def test_frames_come_into_the_tlog_with_their_own_times_and_in_one_piece() -> None:
    log = Log()
    link = link_to(Master(), log=log)
    link.tick(100.0)
    before = int(time.time() * 1e6)
    link.write(FRAME)
    link.write(FRAME[::-1])
    after = int(time.time() * 1e6)
    link.tick(100.0 + LOG_S / 2)
    assert log.taken == []
    link.tick(100.0 + LOG_S)
    (piece,) = log.taken
    for start, frame in ((0, FRAME), (48, FRAME[::-1])):
        (stamp,) = struct.unpack_from(">Q", piece, start)
        assert before <= stamp <= after
        assert piece[start + 8 : start + 48] == frame
    assert len(piece) == 96
    link.tick(100.0 + 3 * LOG_S)
    assert len(log.taken) == 1


def test_without_a_tlog_nothing_is_kept() -> None:
    link = link_to(Master())
    for step in range(3):
        link.write(FRAME)
        link.tick(100.0 + step)
    assert not link._log


def test_what_the_gate_lets_through_is_in_the_tlog_and_what_it_refuses_is_not(bench: Bench) -> None:
    log = Log()
    bench.mpstate.logqueue = log  # type: ignore[attr-defined]
    bench.connect()
    land = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0)
    speed = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 1, 7, -1, 0, 0, 0, 0)
    bench.b.send(land)
    bench.a.send(speed)
    bench.run(0.5)
    logged = b"".join(log.taken)
    assert speed.get_msgbuf()[10:-2] in logged
    assert land.get_msgbuf()[10:-2] not in logged


def test_unload_leaves_no_frame_behind(bench: Bench) -> None:
    log = Log()
    bench.connect()
    bench.mpstate.logqueue = log  # type: ignore[attr-defined]
    bench.module._to_autopilot.write(FRAME)
    bench.mpstate.unload("handover")
    assert log.taken[-1].endswith(FRAME)

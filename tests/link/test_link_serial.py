# SPDX-License-Identifier: GPL-3.0-or-later

"""Serial links, over pseudo-terminals: bytes both ways, unplugged and plugged in again, a line that takes nothing."""

from __future__ import annotations

import contextlib
import os
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.link.devices import LinkError, open_device
from mavproxy_handover.link.serial_line import SerialLine
from mavproxy_handover.wire.frames import FrameSplitter
from tests.link.frames import Clock, command, heartbeat, read_frames, read_until


class Cable:
    """A pseudo-terminal under a name that stays, as udev gives one to a device."""

    def __init__(self, name: Path) -> None:
        self.name = name
        self.plug_in()

    def plug_in(self) -> None:
        self.far, near = os.openpty()
        tty.setraw(near)
        os.set_blocking(self.far, False)
        self.name.symlink_to(os.ttyname(near))
        os.close(near)

    def unplug(self) -> None:
        os.close(self.far)
        self.name.unlink()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    made = Cable(tmp_path / "ttyRADIO")
    yield made
    with contextlib.suppress(OSError):
        made.unplug()


@pytest.fixture
def line(cable: Cable, clock: Clock) -> Iterator[SerialLine]:
    device = open_device(f"serial:{cable.name}:57600", clock)
    assert isinstance(device, SerialLine)
    yield device
    device.close()


def test_frames_go_both_ways(line: SerialLine, cable: Cable) -> None:
    assert line.open
    os.write(cable.far, heartbeat(1).raw + command(2).raw)
    assert read_frames(line, 2) == [heartbeat(1), command(2)]
    assert line.write(b"telemetry")
    assert os.read(cable.far, 100) == b"telemetry"


def test_an_unplugged_device_is_used_again_when_it_is_back(line: SerialLine, cable: Cable, clock: Clock) -> None:
    os.write(cable.far, command(1).raw[:20])
    read_until(line, lambda: line.counters.bytes_in == 20)
    cable.unplug()
    read_until(line, lambda: not line.open)
    assert (line.fileno(), line.write(b"telemetry")) == (-1, False)
    clock.now += 20.0
    line.read()
    assert line.trouble == "No such file or directory"
    cable.plug_in()
    clock.now += 20.0
    read_until(line, lambda: line.open)
    os.write(cable.far, heartbeat(2).raw)
    assert read_frames(line, 1) == [heartbeat(2)]
    assert line.counters.connects == 2


def test_a_line_that_takes_nothing_refuses_whole_frames_and_blocks_nobody(line: SerialLine, cable: Cable) -> None:
    taken = sum(line.write(command(number & 0xFF).raw) for number in range(5000))
    assert 0 < taken < 5000
    assert line.counters.refused_out == 5000 - taken
    splitter = FrameSplitter()
    received = []
    while len(received) < taken:
        line.read()
        received += splitter.feed(os.read(cable.far, 4096))
    assert splitter.counters.garbage_bytes == 0


def test_a_device_that_is_not_there_yet_is_no_error(tmp_path: Path, clock: Clock) -> None:
    device = open_device(f"serial:{tmp_path / 'ttyRADIO'}:57600", clock)
    assert not device.open
    assert device.trouble == "No such file or directory"
    cable = Cable(tmp_path / "ttyRADIO")
    clock.now += 1.0
    read_until(device, lambda: device.open)
    device.close()
    cable.unplug()


def test_a_file_that_is_no_serial_line_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "ttyRADIO").write_text("not a terminal")
    with pytest.raises(LinkError, match=r"^link serial:.*ttyRADIO:57600 cannot be opened: ") as error:
        open_device(f"serial:{tmp_path / 'ttyRADIO'}:57600")
    assert "\n" not in str(error.value)


def test_a_line_that_another_program_uses_is_an_error(line: SerialLine, cable: Cable) -> None:
    with pytest.raises(LinkError, match=r"^link serial:.*ttyRADIO:57600 cannot be opened: "):
        open_device(f"serial:{cable.name}:57600")


def test_a_closed_line_does_not_come_back(line: SerialLine, cable: Cable, clock: Clock) -> None:
    line.close()
    clock.now += 100.0
    assert (line.read(), line.open, line.fileno(), line.write(b"late")) == ([], False, -1, False)


def test_noise_delays_the_frame_behind_it_by_no_more_than_a_moment(
    line: SerialLine, cable: Cable, clock: Clock
) -> None:
    os.write(cable.far, b"\xfd\xff\x00" + heartbeat(1).raw)
    read_until(line, lambda: line.counters.bytes_in > 3)
    assert line.unfinished
    clock.now += 0.24
    assert line.read() == []
    clock.now += 0.02
    assert line.read() == [heartbeat(1)]
    assert not line.unfinished


def test_a_slow_line_has_the_time_that_a_long_frame_takes_on_it(cable: Cable, clock: Clock) -> None:
    slow = open_device(f"serial:{cable.name}:2400", clock)
    os.write(cable.far, b"\xfd\xff\x00" + heartbeat(1).raw)
    read_until(slow, lambda: slow.counters.bytes_in > 3)
    clock.now += 1.7  # 280 bytes take 1.17 s
    assert slow.read() == []
    clock.now += 0.1
    assert slow.read() == [heartbeat(1)]
    slow.close()

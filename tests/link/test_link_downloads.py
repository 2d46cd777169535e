# SPDX-License-Identifier: GPL-3.0-or-later

"""Downloads on links with flow control: they are refused first, and leave room for every other frame."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest

from mavproxy_handover.link.base import Device, OutBuffer
from mavproxy_handover.link.bundle import LinkBundle
from mavproxy_handover.link.devices import open_device
from tests.link.frames import Clock, Draw, FakeDevice, command, read_until


def test_a_download_gets_half_of_the_room_for_unsent_bytes() -> None:
    buffer = OutBuffer(1000)
    assert [buffer.add(bytes(100), more=True) for _ in range(7)] == [True] * 5 + [False] * 2
    assert [buffer.add(bytes(100)) for _ in range(6)] == [True] * 5 + [False]


@pytest.fixture
def closing() -> Iterator[contextlib.ExitStack]:
    with contextlib.ExitStack() as stack:
        yield stack


def connected(closing: contextlib.ExitStack, kind: str) -> tuple[Device, socket.socket]:
    """A TCP link, and its other end."""
    listener = closing.enter_context(socket.create_server(("127.0.0.1", 0)))
    port = listener.getsockname()[1]
    if kind == "tcp":
        device = open_device(f"tcp:127.0.0.1:{port}", Clock())
        closing.callback(device.close)
        other = closing.enter_context(listener.accept()[0])
    else:
        listener.close()
        device = open_device(f"tcpin:127.0.0.1:{port}", Clock())
        closing.callback(device.close)
        other = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    read_until(device, lambda: device.open)
    other.settimeout(10)
    return device, other


@pytest.mark.parametrize("kind", ["tcp", "tcpin"])
@pytest.mark.parametrize("then", ["flush", "write"])
def test_frames_of_a_download_leave_together_with_the_flush_or_before_the_next_other_frame(
    closing: contextlib.ExitStack, kind: str, then: str
) -> None:
    device, other = connected(closing, kind)
    assert [device.write_more(bytes(109)) for _ in range(3)] == [True] * 3
    other.setblocking(False)
    with pytest.raises(BlockingIOError):
        other.recv(65536)
    last = b"" if then == "flush" else command(1).raw
    if then == "flush":
        device.flush()
    else:
        assert device.write(last)
    other.settimeout(10)
    assert other.recv(65536) == bytes(327) + last


@pytest.mark.parametrize("kind", ["tcp", "tcpin"])
def test_a_tcp_station_that_reads_nothing_is_refused_downloads_and_still_gets_a_command(
    closing: contextlib.ExitStack, kind: str
) -> None:
    device, other = connected(closing, kind)
    assert device.flow_controlled
    taken = 0
    while device.write_more(bytes(109)):
        taken += 1
        assert taken < 100_000
    assert device.counters.refused_out == 0
    assert device.write(command(1).raw)
    assert device.counters.refused_out == 0
    data = b""
    while len(data) < taken * 109 + len(command(1).raw):
        device.read()
        data += other.recv(65536)
    assert data == bytes(taken * 109) + command(1).raw


def test_of_several_links_none_of_which_is_known_to_work_all_carry_a_download() -> None:
    devices = [FakeDevice("a"), FakeDevice("b")]
    bundle = LinkBundle(devices, lambda _stamp: b"", Draw())
    devices[0].full = True
    assert bundle.write_more(command(1).raw)
    assert [len(device.sent) for device in devices] == [0, 1]
    devices[1].open = False
    assert not bundle.write_more(command(2).raw)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Downloads on links with flow control: they are refused first, and leave room for every other frame."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest

from mavproxy_handover.link.base import OutBuffer
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


@pytest.mark.parametrize("kind", ["tcp", "tcpin"])
def test_a_tcp_station_that_reads_nothing_is_refused_downloads_and_still_gets_a_command(
    closing: contextlib.ExitStack, kind: str
) -> None:
    listener = closing.enter_context(socket.create_server(("127.0.0.1", 0)))
    port = listener.getsockname()[1]
    if kind == "tcp":
        device = open_device(f"tcp:127.0.0.1:{port}", Clock())
        closing.callback(device.close)
        accepted = closing.enter_context(listener.accept()[0])
    else:
        listener.close()
        device = open_device(f"tcpin:127.0.0.1:{port}", Clock())
        closing.callback(device.close)
        accepted = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    read_until(device, lambda: device.open)
    assert device.flow_controlled
    taken = 0
    while device.write_more(bytes(109)):
        taken += 1
        assert taken < 100_000
    assert device.counters.refused_out == 0
    assert device.write(command(1).raw)
    assert device.counters.refused_out == 0
    accepted.settimeout(10)
    data = b""
    while len(data) < taken * 109 + len(command(1).raw):
        device.read()
        data += accepted.recv(65536)
    assert data == bytes(taken * 109) + command(1).raw


def test_of_several_links_none_of_which_is_known_to_work_all_carry_a_download() -> None:
    devices = [FakeDevice("a"), FakeDevice("b")]
    bundle = LinkBundle(devices, lambda _stamp: b"", Draw())
    devices[0].full = True
    assert bundle.write_more(command(1).raw)
    assert [len(device.sent) for device in devices] == [0, 1]
    devices[1].open = False
    assert not bundle.write_more(command(2).raw)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The room for what waits at a station's links, and serial lines that take nothing.

Stations with several vehicles have their links in `tests/module/test_station_fleet.py`.
"""

from __future__ import annotations

import os
import socket
import time
import tty
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
import serial

from gcs_module.links import Links

SMALL_BYTES = 8192


def links(*masters: Any) -> Links:
    return Links(SimpleNamespace(mav_master=list(masters)), (), lambda text: None, Counter())


def room(port: socket.socket) -> int:
    return port.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


@pytest.fixture(params=[socket.SOCK_DGRAM, socket.SOCK_STREAM], ids=["udp", "tcp"])
def port(request: pytest.FixtureRequest) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, request.param) as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BYTES)
        yield made


def test_what_waits_at_a_udp_link_has_room(port: socket.socket) -> None:
    """Without, a station that is slow for a second loses frames: 262 waited, and 115 behind them were lost."""
    before = room(port)
    links(SimpleNamespace(port=port)).refresh()
    assert (room(port) > 4 * before) is (port.type == socket.SOCK_DGRAM)


@pytest.mark.parametrize("port", [socket.SOCK_DGRAM], indirect=True)
def test_a_link_that_comes_later_is_seen_to_and_each_once(port: socket.socket) -> None:
    masters: list[Any] = []
    ours = Links(SimpleNamespace(mav_master=masters), (), lambda text: None, Counter())
    ours.refresh()
    before = room(port)
    masters.append(SimpleNamespace(port=port))
    ours.refresh()
    assert room(port) > before
    port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BYTES)
    ours.refresh()
    assert room(port) == before


def test_a_link_without_a_socket_or_with_a_closed_one_is_left_alone(port: socket.socket) -> None:
    port.close()
    no_socket = (SimpleNamespace(port=object()), SimpleNamespace(), SimpleNamespace(port=None))
    links(SimpleNamespace(port=port), *no_socket).refresh()


def test_a_serial_line_that_takes_nothing_does_not_stop_the_station() -> None:
    """MAVProxy opens it without a time-out for writing, so pyserial would wait for the modem."""
    far, near = os.openpty()
    tty.setraw(far)
    tty.setraw(near)
    port = serial.Serial(os.ttyname(near), timeout=0)
    ours = links(SimpleNamespace(port=port))
    ours.refresh()
    ours.refresh()
    frame = bytes(range(40))
    try:
        begun = time.monotonic()
        for _ in range(2000):
            assert port.write(frame) == len(frame)
        # a wait of 10 ms for each is noticed, a busy machine is not
        assert time.monotonic() - begun < 20.0
        os.set_blocking(far, False)
        found = b""
        with suppress(BlockingIOError):
            while True:
                found += os.read(far, 65536)
                ours.push()
                time.sleep(0.01)
        assert len(found) > 4096
        assert found == frame * (len(found) // len(frame)), "whole frames alone"
        port.close()
        ours.push()
        ours.release()
        assert "write" not in vars(port)
    finally:
        port.close()
        os.close(far)
        os.close(near)

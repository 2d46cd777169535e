# SPDX-License-Identifier: GPL-3.0-or-later

"""A sender that is not the peer of a listening link can be answered once, and does not become the peer by it."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

from mavproxy_handover.link.base import Device
from mavproxy_handover.link.devices import open_link
from mavproxy_handover.link.names import Names
from mavproxy_handover.wire.frames import Frame
from tests.gate.frames import make_frame


def wait(step: Callable[[], list[Frame]]) -> list[Frame]:
    for _ in range(200):
        found = step()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError("nothing came")


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_udpin_answers_the_stranger_and_has_no_peer() -> None:
    port = free_port(socket.SOCK_DGRAM)
    link: Device = open_link(f"udpin:127.0.0.1:{port}", Names())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.settimeout(2.0)
        stranger.sendto(make_frame("HEARTBEAT", sysid=255).raw, ("127.0.0.1", port))
        (frame,) = wait(link.read)
        link.reply(frame, b"why")
        assert stranger.recv(100) == b"why"
        assert not link.open
        link.reply(make_frame("HEARTBEAT", sysid=255), b"of another read")
        stranger.settimeout(0.2)
        try:
            raise AssertionError(stranger.recv(100))
        except TimeoutError:
            pass
    link.close()


def test_tcpin_answers_the_stranger() -> None:
    port = free_port(socket.SOCK_STREAM)
    link: Device = open_link(f"tcpin:127.0.0.1:{port}", Names())
    with socket.create_connection(("127.0.0.1", port), timeout=2.0) as stranger:
        stranger.sendall(make_frame("HEARTBEAT", sysid=255).raw)
        (frame,) = wait(link.read)
        link.reply(frame, b"why")
        assert stranger.recv(100) == b"why"
    link.close()

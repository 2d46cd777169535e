# SPDX-License-Identifier: GPL-3.0-or-later

"""Datagrams taken one at a time, and frames counted later than they came: what nobody may notice of either."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from mavproxy_handover.link.base import Device
from mavproxy_handover.link.bundle import LinkBundle
from mavproxy_handover.link.devices import open_device
from tests.link.frames import Clock, Draw, FakeDevice, command, heartbeat

LOOPBACK = "127.0.0.1"


@pytest.fixture
def sockets() -> Iterator[list[socket.socket]]:
    made = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3)]
    for each in made:
        each.bind((LOOPBACK, 0))
    yield made
    for each in made:
        each.close()


def listening() -> tuple[Device, int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        port = probe.getsockname()[1]
    return open_device(f"udpin:{LOOPBACK}:{port}", Clock()), port


class TestOneAtATime:
    def test_udpin_takes_one_datagram_of_the_peer_and_leaves_the_next(self, sockets: list[socket.socket]) -> None:
        device, port = listening()
        sockets[0].sendto(heartbeat().raw, (LOOPBACK, port))
        device.accept_sender(device.read()[0])
        for seq in (1, 2, 3):
            sockets[0].sendto(command(seq).raw, (LOOPBACK, port))
        assert [device.read(once=True) for _ in range(4)] == [[command(1)], [command(2)], [command(3)], []]
        device.close()

    def test_strangers_in_front_of_the_peer_do_not_use_up_its_turn(self, sockets: list[socket.socket]) -> None:
        device, port = listening()
        station, *strangers = sockets
        station.sendto(heartbeat(0).raw, (LOOPBACK, port))
        device.accept_sender(device.read()[0])
        for _ in range(50):
            for stranger in strangers:
                stranger.sendto(heartbeat(9).raw, (LOOPBACK, port))
        station.sendto(command(1).raw, (LOOPBACK, port))
        assert device.read(once=True)[-1] == command(1)
        device.close()

    def test_udpout_takes_one_and_leaves_the_next(self, sockets: list[socket.socket]) -> None:
        station = sockets[0]
        device = open_device(f"udpout:{LOOPBACK}:{station.getsockname()[1]}", Clock())
        device.write(b"hello")
        _hello, address = station.recvfrom(64)
        for seq in (1, 2):
            station.sendto(command(seq).raw, address)
        assert [device.read(once=True) for _ in range(3)] == [[command(1)], [command(2)], []]
        device.close()


class TestCountingLater:
    @staticmethod
    def bundle(*names: str) -> tuple[LinkBundle, list[FakeDevice]]:
        devices = [FakeDevice(name) for name in names]
        return LinkBundle(devices, lambda _stamp: b"probe", Draw()), devices

    @staticmethod
    def arrive(bundle: LinkBundle, device: FakeDevice, now: float, *seqs: int) -> None:
        device.inbox += [heartbeat(seq) for seq in seqs]
        for frame in bundle.read(device, now):
            bundle.accept(device, frame, now)

    def test_a_frame_proves_its_link_in_the_very_next_tick(self) -> None:
        """Not only when limits are looked at, five times a second."""
        bundle, (wifi, lte) = self.bundle("wifi", "lte")
        bundle.tick(100.0)
        self.arrive(bundle, lte, 100.05, 0)
        bundle.tick(100.05)
        wifi.sent.clear(), lte.sent.clear()
        bundle.write(command(0).raw)
        assert (wifi.sent, lte.sent) == ([], [command(0).raw])

    def test_frames_count_from_when_they_came(self) -> None:
        bundle, (link,) = self.bundle("wifi")
        self.arrive(bundle, link, 100.0, 0)
        self.arrive(bundle, link, 102.0, 1)
        bundle.tick(102.1)
        assert bundle.quality(link, 102.5).heard_ago_s == pytest.approx(0.5)
        assert bundle.quality(link, 102.5).frames == 2
        assert bundle.quality(link, 110.5).frames == 1  # that of second 100 has left the window, the other has not

    def test_waiting_frames_are_as_few_as_a_burst_however_long_no_tick_comes(self) -> None:
        bundle, (link,) = self.bundle("wifi")
        for number in range(5000):
            self.arrive(bundle, link, 100.0 + number / 1000, number & 0xFF)
            assert len(bundle._links[0].uncounted) <= 512
        assert bundle.quality(link, 105.0).frames == 5000
        assert bundle.quality(link, 105.0).loss == 0

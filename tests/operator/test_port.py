# SPDX-License-Identifier: GPL-3.0-or-later

"""A station behind several links: what its key proves is taken once, and copies that come late are no attack."""

from __future__ import annotations

import random
import socket
import time
from contextlib import closing

import pytest
from pymavlink.dialects.v10 import ardupilotmega as v10
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.files import StationLinks
from mavproxy_handover.core.common.model import Station
from mavproxy_handover.link.devices import Device, open_device
from mavproxy_handover.link.quality import Measure
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.store.keys import StationKeys
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer
from tests.link.frames import FakeDevice

KEY = bytes(range(32))
#: 2026-11-20 00:00 UTC
UTC_S = 1_795_132_800.0


class Routed:
    """GCSA's router: one signed stream, over Wi-Fi and LTE, each with a delay and losses of its own."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.links = tuple(FakeDevice(name) for name in ("udpin:0.0.0.0:14550", "udpin:0.0.0.0:14551"))
        config = StationLinks(Station(251, "GCSA"), tuple(link.device for link in self.links), frozenset({251}))
        clocks = Clocks(lambda: UTC_S + self.now, lambda: self.now)
        self.port = StationPort(config, self.links, 1, StationKeys(KEY), clocks)
        self._router = SignedPeer(KEY)
        self._own = mavlink.MAVLink(None, 251, 190)

    def frame(self) -> Frame:
        """The next frame, as the router signs it once."""
        plain = bytes(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0).pack(self._own))
        self._own.seq = (self._own.seq + 1) & 0xFF
        frame = parse_one(self._router.sign(plain, 1, UTC_S + self.now, self.now) or b"")
        assert frame is not None
        return frame

    def arrives(self, number: int, *frames: Frame) -> list[Frame]:
        link = self.links[number]
        link.inbox += frames
        return self.port.read(link, self.now)


def test_a_frame_on_two_links_has_each_links_number_and_one_stamp(routed: Routed) -> None:
    """By the stamp the station knows that both are one frame; by the numbers it judges its links."""
    own = mavlink.MAVLink(None, 1, 1)
    attitude = bytes(mavlink.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0).pack(own))
    routed.links[1].open = False
    routed.port.write_all(attitude)
    routed.links[1].open = True
    routed.port.write_all(attitude)
    routed.port.write_all(bytes(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(own)))
    frames = [[frame for frame in map(parse_one, link.sent) if frame is not None] for link in routed.links]
    assert [[frame.seq for frame in sent] for sent in frames] == [[0, 1, 2], [0, 1]]
    stamps = [[int.from_bytes(frame.raw[-12:-6], "little") for frame in sent] for sent in frames]
    assert stamps[0][1:] == stamps[1]
    assert stamps[0] == sorted(set(stamps[0]))
    for sent in frames:
        station = SignedPeer(KEY)
        verdicts = {station.check(frame, UTC_S + routed.now, routed.now) for frame in sent}
        assert verdicts == {SignatureVerdict.OK}


def test_nothing_goes_out_unsigned_to_a_station_with_a_key(routed: Routed) -> None:
    old = v10.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0).pack(v10.MAVLink(None, 1, 1))
    for data in (bytes(old), b"no frame", b""):
        routed.port.write(data)
        routed.port.write_all(data)
    assert [link.sent for link in routed.links] == [[], []]


@pytest.fixture
def routed() -> Routed:
    return Routed()


def test_what_the_faster_link_lost_is_taken_from_the_slower_one_and_is_no_attack(routed: Routed) -> None:
    luck = random.Random(5)
    on_their_way: list[tuple[float, int, Frame]] = []
    taken: list[bytes] = []
    sent = 0
    for _ in range(3000):  # 100 frames a second for 30 s; LTE is half a second behind
        routed.now += 0.01
        frame = routed.frame()
        sent += 1
        for number, delay_s, loss in ((0, 0.01, 0.2), (1, 0.3 + 0.4 * luck.random(), 0.0)):
            if luck.random() >= loss:
                on_their_way.append((routed.now + delay_s, number, frame))
        due = sorted((entry for entry in on_their_way if entry[0] <= routed.now), key=lambda entry: entry[0])
        on_their_way = [entry for entry in on_their_way if entry[0] > routed.now]
        for _at, number, late in due:
            taken += [found.raw for found in routed.arrives(number, late)]
        routed.port.tick(routed.now)
    assert not routed.port.bad_signatures
    assert not routed.port.attacked
    assert len(taken) == len(set(taken))
    assert len(taken) >= sent - 70


def test_a_fast_stream_whose_copies_are_late_is_no_attack(routed: Routed) -> None:
    """More frames came in between than there are sequence numbers: their stamps tell that they are no new ones."""
    frames = []
    for _ in range(400):
        routed.now += 0.004
        frames.append(routed.frame())
        assert routed.arrives(0, frames[-1]) == [frames[-1]]
    assert routed.arrives(1, *frames) == []
    assert not routed.port.bad_signatures


def test_a_frame_is_not_played_again_by_any_link(routed: Routed) -> None:
    frame = routed.frame()
    assert routed.arrives(0, frame) == [frame]
    assert routed.arrives(1, frame) == []
    assert not routed.port.bad_signatures
    for number in (0, 1):
        assert routed.arrives(number, frame) == []
    routed.now += 5.0
    for number in (0, 1):
        assert routed.arrives(number, frame) == []
    assert routed.port.bad_signatures == {SignatureVerdict.REPLAYED: 4}


def test_since_when_a_station_is_heard_without_an_interruption(routed: Routed) -> None:
    """Two heartbeats in a row may be lost by chance."""
    port, beat = routed.port, routed.frame()
    assert port.heard_since(500.0) == 500.0, "never heard"
    for at in (1000.0, 1001.0, 1004.0):
        port.record_heartbeat(beat, at)
        assert port.heard_since(at) == 1000.0
    assert port.heard_since(1007.5) == 1000.0
    assert port.heard_since(1007.6) == 1007.6, "interrupted at this moment"
    port.record_heartbeat(beat, 1008.0)
    assert port.heard_since(1009.0) == 1008.0


# ---- whose frames count for the quality of a link -----------------------------------------------------------------

HERE = "127.0.0.1"


@pytest.mark.parametrize("scheme", ["udpin", "tcpin"])
@pytest.mark.parametrize("signed", [False, True])
def test_what_a_stranger_sends_to_a_stations_port_does_not_count_for_its_link(scheme: str, signed: bool) -> None:
    """It uses the station's system id and numbers of its own, five times as often as the station speaks."""
    probe = socket.socket()
    probe.bind((HERE, 0))
    number = probe.getsockname()[1]
    probe.close()
    now = 1000.0
    link: Device = open_device(f"{scheme}:{HERE}:{number}", lambda: now)
    keys = StationKeys(KEY) if signed else None
    config = StationLinks(Station(251, "GCSA"), (link.device,), frozenset({251}))
    port = StationPort(config, (link,), 1, keys, Clocks(lambda: UTC_S + now, lambda: now))
    kind = socket.SOCK_DGRAM if scheme == "udpin" else socket.SOCK_STREAM
    station, stranger = socket.socket(socket.AF_INET, kind), socket.socket(socket.AF_INET, kind)
    own, forged = mavlink.MAVLink(None, 251, 190), mavlink.MAVLink(None, 251, 190)
    key = SignedPeer(KEY)
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)

    def send(sender: socket.socket, mav: mavlink.MAVLink, step: int) -> None:
        nonlocal now
        data = bytes(beat.pack(mav))
        mav.seq = (mav.seq + step) & 0xFF
        if signed and mav is own:
            data = key.sign(data, 1, UTC_S + now, now) or b""
        sender.send(data)
        deadline_s = time.monotonic() + 10.0
        while not port.read(link, now) and not port.rejected:
            assert time.monotonic() < deadline_s, "the frame did not arrive"
        port.rejected.clear()

    over = set()
    with station, stranger, closing(port):
        for sender in (station, stranger):
            sender.connect((HERE, number))
            if scheme == "tcpin":
                sender.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            port.read(link, now)
        for step in range(45):
            now = 1000.0 + step * 0.2
            send(station, own, 1)
            for _ in range(5):
                send(stranger, forged, 7)
            over |= {event.measure for event in port.tick(now)}
        quality = port.quality(link, now)
    assert (quality.loss, quality.frames, quality.duplicates, quality.reordered) == (0.0, 45, 0, 0)
    assert over == ({Measure.BAD_SIGNATURES} if signed else set())
    assert not port.weak


def test_a_full_receive_buffer_does_not_make_a_station_weak(routed: Routed) -> None:
    link = routed.links[0]
    config = StationLinks(Station(251, "GCSA"), (link.device,), frozenset({251}))
    port = StationPort(config, (link,), 1, StationKeys(KEY), Clocks(lambda: UTC_S + routed.now, lambda: routed.now))
    told = []
    for step in range(200):
        routed.now = 1000.0 + step * 0.05
        frame = routed.frame()
        if step < 60 or step % 10 == 0:
            link.inbox.append(frame)
        if step >= 60:
            link.counters.overflowed += 40
        assert not port.rejected
        port.read(link, routed.now)
        told += [event.measure for event in port.tick(routed.now)]
    assert told == [Measure.OVERFLOW]
    assert not port.weak

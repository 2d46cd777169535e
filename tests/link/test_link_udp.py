# SPDX-License-Identifier: GPL-3.0-or-later

"""UDP links on loopback: who is heard, who is answered, and what a flood costs."""

from __future__ import annotations

import socket
import sys
import tracemalloc
from collections.abc import Iterator

import pytest

from mavproxy_handover.link import udp
from mavproxy_handover.link.devices import LinkError, open_device
from mavproxy_handover.link.udp import UdpIn, UdpOut
from tests.link.frames import Clock, command, heartbeat

LOOPBACK = "127.0.0.1"


class Peer:
    """A plain UDP socket, as another program has it."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((LOOPBACK, 0))
        self.socket.setblocking(False)
        self.address: tuple[str, int] = self.socket.getsockname()

    def send(self, data: bytes, port: int) -> None:
        self.socket.sendto(data, (LOOPBACK, port))

    def received(self) -> list[bytes]:
        datagrams = []
        while True:
            try:
                datagrams.append(self.socket.recv(4096))
            except BlockingIOError:
                return datagrams


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def peers() -> Iterator[list[Peer]]:
    made = [Peer() for _ in range(4)]
    yield made
    for peer in made:
        peer.socket.close()


@pytest.fixture
def listening(clock: Clock) -> Iterator[tuple[UdpIn, int]]:
    probe = Peer()
    port = probe.address[1]
    probe.socket.close()
    device = open_device(f"udpin:{LOOPBACK}:{port}", clock)
    assert isinstance(device, UdpIn)
    yield device, port
    device.close()


def test_nobody_is_answered_before_somebody_proved_genuine(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    peers[0].send(heartbeat().raw, port)
    assert device.read() == [heartbeat()]
    assert not device.open
    assert not device.write(b"telemetry")
    assert device.counters.refused_out == 1
    assert peers[0].received() == []


def test_the_sender_of_a_genuine_frame_is_answered(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    peers[0].send(heartbeat().raw, port)
    (frame,) = device.read()
    device.accept_sender(frame)
    assert device.open
    assert device.write(b"telemetry")
    assert peers[0].received() == [b"telemetry"]
    assert (device.counters.frames_out, device.counters.bytes_out) == (1, 9)


def test_a_stranger_does_not_take_the_downlink_whatever_it_sends(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    device, port = listening
    station, stranger, _, _ = peers
    station.send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    stranger.send(heartbeat(1).raw, port)
    assert device.read() == [heartbeat(1)]  # judged by the caller, who does not call it genuine
    device.write(b"telemetry")
    assert (station.received(), stranger.received()) == ([b"telemetry"], [])


def test_of_two_equal_frames_the_sender_of_the_genuine_one_is_answered(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    device, port = listening
    stranger, station, _, _ = peers
    stranger.send(heartbeat().raw, port)
    station.send(heartbeat().raw, port)
    first, second = device.read()
    assert first == second
    device.accept_sender(second)
    device.write(b"telemetry")
    assert (station.received(), stranger.received()) == ([b"telemetry"], [])


def test_who_repeats_a_stations_frames_gets_no_downlink_while_the_station_speaks(
    listening: tuple[UdpIn, int], peers: list[Peer], clock: Clock
) -> None:
    device, port = listening
    station, repeater, _, _ = peers
    for second in range(5):
        clock.now = 100.0 + second
        for peer in (station, repeater):
            peer.send(heartbeat(second).raw, port)
            device.accept_sender(device.read()[0])
        device.write(b"telemetry")
    assert (len(station.received()), repeater.received()) == (5, [])


def test_a_station_that_comes_back_from_another_port_is_answered_there(
    listening: tuple[UdpIn, int], peers: list[Peer], clock: Clock
) -> None:
    device, port = listening
    before, after, _, _ = peers
    before.send(heartbeat().raw, port)
    device.accept_sender(device.read()[0])
    clock.now += 1.6
    after.send(heartbeat().raw, port)
    device.accept_sender(device.read()[0])
    device.write(b"telemetry")
    assert (before.received(), after.received()) == ([], [b"telemetry"])


def test_a_frame_of_the_read_before_last_moves_nothing(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    peers[0].send(heartbeat().raw, port)
    (old,) = device.read()
    assert device.read() == []
    device.accept_sender(old)
    assert not device.open


def test_noise_in_cut_datagrams_delays_the_frame_behind_it_by_no_more_than_a_moment(
    listening: tuple[UdpIn, int], peers: list[Peer], clock: Clock
) -> None:
    device, port = listening
    peers[0].send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    stream = b"\xfd\xff\x00" + heartbeat(1).raw
    for data in (stream[:10], stream[10:]):
        peers[0].send(data, port)
    assert device.read() == []
    assert device.unfinished
    clock.now += 0.26
    (frame,) = device.read()
    assert (frame, device.unfinished) == (heartbeat(1), False)
    clock.now += 10.0
    device.accept_sender(frame)  # it is the peer's still
    assert device.write(b"telemetry")
    assert peers[0].received() == [b"telemetry"]


@pytest.mark.parametrize("once", [False, True])
def test_udpout_is_no_longer_deaf_than_that_either(peers: list[Peer], clock: Clock, once: bool) -> None:
    station = peers[0]
    device = open_device(f"udpout:{LOOPBACK}:{station.address[1]}", clock)
    device.write(b"telemetry")
    vehicle = station.socket.recvfrom(100)[1]
    stream = b"\xfd\xff\x00" + heartbeat(1).raw
    for data in (stream[:10], stream[10:]):
        station.socket.sendto(data, vehicle)
    assert [device.read(once), device.read(once), device.read(once)] == [[], [], []]
    clock.now += 0.26
    assert device.read(once) == [heartbeat(1)]
    device.close()


def test_frames_of_the_peer_may_be_cut_anywhere(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    peers[0].send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    raw = heartbeat(1).raw + command(2).raw
    for part in (raw[:5], raw[5:30], raw[30:]):
        peers[0].send(part, port)
    assert device.read() == [heartbeat(1), command(2)]


def test_a_forged_frame_start_from_the_peers_address_delays_none_of_its_frames(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    device, port = listening
    peers[0].send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    peers[0].send(bytes([0xFD, 255, 0, 0, 0, 251, 190, 0, 0, 0]), port)  # 257 bytes are missing
    peers[0].send(command(1).raw, port)
    peers[0].send(heartbeat(2).raw + command(3).raw, port)
    assert device.read() == [command(1), heartbeat(2), command(3)]


def test_half_frames_of_strangers_are_not_kept_and_spoil_nothing(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    device, port = listening
    station, stranger, _, _ = peers
    station.send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    raw = heartbeat(1).raw
    station.send(raw[:9], port)
    stranger.send(heartbeat(2).raw[:9], port)
    station.send(raw[9:], port)
    stranger.send(heartbeat(2).raw[9:], port)
    assert device.read() == [heartbeat(1)]
    assert device.counters.strangers == 1  # the rest of a frame does not begin with one


@pytest.mark.parametrize("by_kernel", [True, False])
def test_udpout_hears_only_the_address_it_sends_to(
    peers: list[Peer], clock: Clock, by_kernel: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the kernel throws away what others send, or we do."""
    if by_kernel and sys.platform != "linux":
        pytest.skip("only Linux can do that")
    if not by_kernel:
        monkeypatch.setattr(udp, "_hear_only", lambda *_: False)
    station, stranger, _, _ = peers
    device = open_device(f"udpout:{LOOPBACK}:{station.address[1]}", clock)
    assert isinstance(device, UdpOut)
    assert device.open  # nobody has to be there
    assert device.write(b"hello")
    assert station.received() == [b"hello"]
    with socket.socket(fileno=socket.dup(device.fileno())) as same:
        port = same.getsockname()[1]
    stranger.send(heartbeat(1).raw, port)
    station.send(heartbeat(2).raw, port)
    station.send(heartbeat(3).raw + bytes(2048), port)  # longer than any station sends
    station.send(heartbeat(4).raw, port)
    assert device.read() == [heartbeat(2), heartbeat(4)]
    assert device.counters.strangers == (0 if by_kernel else 1)
    assert device.counters.oversize == 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as elsewhere:  # the same port at another address
        elsewhere.bind(("127.0.0.2", station.address[1]))
        elsewhere.sendto(heartbeat(5).raw, (LOOPBACK, port))
        assert device.read() == []
    device.close()


def test_a_kernel_that_cannot_throw_away_what_others_send_leaves_that_to_us(
    peers: list[Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        monkeypatch.setattr(sys, "platform", "darwin")
        assert udp._hear_only(plain, peers[0].address) is False
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(udp, "_SO_ATTACH_FILTER", -1)  # refused
        assert udp._hear_only(plain, peers[0].address) is False
        monkeypatch.setattr(udp, "_SO_ATTACH_FILTER", socket.SO_RCVBUF)  # taken, and no filter
        assert udp._hear_only(plain, peers[0].address) is False


def test_a_station_that_is_not_there_is_no_error(clock: Clock) -> None:
    closed = Peer()
    closed.socket.close()
    device = open_device(f"udpout:{LOOPBACK}:{closed.address[1]}", clock)
    for _ in range(5):
        assert device.write(b"hello")
        assert device.read() == []
    assert device.counters.errors == 0
    device.close()


def test_a_port_in_use_is_one_line_that_names_the_link(peers: list[Peer]) -> None:
    port = peers[0].address[1]
    with pytest.raises(LinkError, match=f"^link udpin:{LOOPBACK}:{port} cannot be opened: Address already in use$"):
        open_device(f"udpin:{LOOPBACK}:{port}")


def test_a_closed_link_is_silent_and_raises_nothing(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    peers[0].send(heartbeat().raw, port)
    device.accept_sender(device.read()[0])
    device.close()
    device.close()
    assert (device.read(), device.write(b"late"), device.open, device.fileno()) == ([], False, False, -1)


def test_datagrams_longer_than_any_station_sends_are_dropped_and_counted(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    device, port = listening
    peers[0].send(b"\xfe" * 60000, port)
    peers[0].send(heartbeat().raw, port)
    assert device.read() == [heartbeat()]
    assert device.counters.oversize == 1


@pytest.mark.parametrize("says", [heartbeat(9).raw, b"\xfd\xff\x00" * 680], ids=["frames", "noise"])
def test_a_station_that_comes_anew_is_heard_though_another_host_floods_the_link(
    listening: tuple[UdpIn, int], peers: list[Peer], says: bytes
) -> None:
    """It is no peer yet, and its frame comes behind the flood's."""
    device, port = listening
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.2", 0))
        for n in range(40):
            peers[n % 4].send(says, port)
        station.sendto(heartbeat(1).raw, (LOOPBACK, port))
        frames = device.read()
        assert frames[-1] == heartbeat(1)
        device.accept_sender(frames[-1])
        assert device.write(b"telemetry")
        assert station.recv(100) == b"telemetry"


def test_one_sender_is_remembered_however_many_there_are(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    for _ in range(50):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(heartbeat(9).raw, (LOOPBACK, port))
    device.read()
    peers[0].send(heartbeat(1).raw, port)
    (frame,) = device.read()
    device.accept_sender(frame)
    assert len(device._senders) == 1
    device.read()
    assert (device._senders, device._peer) == ({}, peers[0].address)


def test_a_flood_of_strangers_does_not_keep_the_peer_waiting(listening: tuple[UdpIn, int], peers: list[Peer]) -> None:
    device, port = listening
    station, *strangers = peers
    station.send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    for _ in range(30):
        for stranger in strangers:
            stranger.send(heartbeat(9).raw, port)
    station.send(command(1).raw, port)
    frames = device.read()
    assert frames.count(heartbeat(9)) == 16  # as many of one host as are looked at in one go
    assert frames[-1] == command(1)  # behind ninety of theirs, in the same read
    assert device.counters.strangers == 74


@pytest.mark.slow
def test_50000_datagrams_of_garbage_cost_bounded_work_and_no_memory(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    device, port = listening
    station, *strangers = peers
    station.send(heartbeat(0).raw, port)
    device.accept_sender(device.read()[0])
    rubbish = [b"\xfd" * 40, b"\xfe" * 40, bytes(range(256)), heartbeat(3).raw[:-1], heartbeat(4).raw + b"\x00"]
    # frames of ids that no dialect has: a splitter can only wait for what follows them
    rubbish.append(bytes([0xFD, 2, 0, 0, 0, 251, 190, 0xFF, 0xFF, 0x7F, 1, 2, 3, 4]))

    def flood(rounds: int) -> int:
        most = 0
        for number in range(rounds):
            for _ in range(40):
                for place, stranger in enumerate(strangers):
                    stranger.send(rubbish[(number + place) % len(rubbish)], port)
                station.send(rubbish[number % len(rubbish)], port)
            frames = device.read()
            most = max(most, len(frames))
        return most

    most = flood(293)
    # the last 3200 of 50080 datagrams: whatever were kept of them would show
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    most = max(most, flood(20))
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    # a read looks at 64 datagrams of the peer and 16 of a host's strangers, none of which holds more than one frame
    assert 0 < most <= 80
    assert grown < 16384
    assert device.counters.strangers > 20000
    while device.read():
        pass
    station.send(heartbeat(5).raw, port)
    assert device.read() == [heartbeat(5)]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere one read is like any other")
def test_one_datagram_at_a_time_is_held_to_the_same_size_and_its_faults_are_counted(
    peers: list[Peer], clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    station = peers[0]
    device = open_device(f"udpout:{LOOPBACK}:{station.address[1]}", clock)
    assert isinstance(device, UdpOut)
    device.write(b"hello")
    with socket.socket(fileno=socket.dup(device.fileno())) as same:
        port = same.getsockname()[1]
    station.send(heartbeat(1).raw + bytes(2048), port)
    station.send(heartbeat(2).raw, port)
    assert [device.read(once=True) for _ in range(3)] == [[], [heartbeat(2)], []]
    assert (device.counters.oversize, device.counters.errors, device.counters.frames_in) == (1, 0, 1)

    class Gone:
        def recv(self, size: int) -> bytes:
            raise OSError(100, "Network is down")

        def close(self) -> None:
            """Nothing."""

    device._socket.close()
    monkeypatch.setattr(device, "_socket", Gone())
    assert device.read(once=True) == []
    assert (device.counters.errors, device.trouble) == (1, "Network is down")
    device.close()
    assert device.read(once=True) == []
    assert device.counters.errors == 1, "after the end nothing is a fault"


# ---- by one way alone -----------------------------------------------------------------------------------------------


def test_a_link_leaves_from_the_address_that_it_names(clock: Clock, peers: list[Peer]) -> None:
    link = open_device(f"udpout:{LOOPBACK}:{peers[0].address[1]}@127.0.0.2", clock)
    assert link.write(heartbeat().raw)
    assert link.write(heartbeat().raw)
    data, sender = peers[0].socket.recvfrom(4096)
    assert (data, sender[0]) == (heartbeat().raw, "127.0.0.2")
    peers[0].socket.sendto(command().raw, sender)
    assert len(link.read()) == 1
    link.close()


def test_a_link_leaves_by_the_interface_that_it_names(clock: Clock, peers: list[Peer]) -> None:
    link = open_device(f"udpout:{LOOPBACK}:{peers[0].address[1]}@lo", clock)
    assert link.write(heartbeat().raw)
    assert peers[0].received() == [heartbeat().raw]
    link.close()


@pytest.mark.parametrize("way", ["wwan9", "203.0.113.7"])
def test_where_there_is_no_such_way_nothing_is_sent_and_it_is_looked_for_again(
    way: str, clock: Clock, peers: list[Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    link = open_device(f"udpout:{LOOPBACK}:{peers[0].address[1]}@{way}", clock)
    assert not link.write(heartbeat().raw)
    assert link.trouble
    assert peers[0].received() == []
    assert link.open, "nobody gives such a link up"
    monkeypatch.setattr(link, "_way", "lo" if way == "wwan9" else LOOPBACK)  # as if it were there now
    assert link.write(heartbeat().raw)
    assert link.trouble == ""
    assert peers[0].received() == [heartbeat().raw]
    link.close()
    assert not link.write(heartbeat().raw)


def test_an_interface_that_comes_back_under_another_number_is_found(
    clock: Clock, peers: list[Peer], monkeypatch: pytest.MonkeyPatch
) -> None:
    link = open_device(f"udpout:{LOOPBACK}:{peers[0].address[1]}@lo", clock)
    assert link.write(heartbeat().raw)
    number = socket.if_nametoindex("lo")
    peer = link._peer  # type: ignore[attr-defined]
    monkeypatch.setattr(link, "_peer", ("255.255.255.255", 9))  # no way there: the system refuses to send
    assert not link.write(heartbeat().raw)
    monkeypatch.setattr(link, "_peer", peer)
    asked: list[str] = []
    monkeypatch.setattr(socket, "if_nametoindex", lambda name: asked.append(name) or number)
    assert link.write(heartbeat().raw)
    assert asked == ["lo"]
    link.close()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell what a socket dropped")
def test_what_the_system_dropped_because_the_buffer_was_full_is_counted(
    listening: tuple[UdpIn, int], peers: list[Peer]
) -> None:
    """By the peer or by strangers: what is missing then was lost here, and not on the link."""
    device, port = listening
    with socket.socket(fileno=socket.dup(device.fileno())) as same:
        same.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 32768)
    station, stranger, _, _ = peers
    station.send(heartbeat().raw, port)
    device.accept_sender(device.read()[0])
    assert device.counters.overflowed == 0
    for _ in range(500):
        stranger.send(b"noise of a stranger", port)
    station.send(heartbeat(1).raw, port)
    assert heartbeat(1) not in [frame for _ in range(10) for frame in device.read()]
    assert 300 < device.counters.overflowed < 501
    before = device.counters.overflowed
    station.send(heartbeat(2).raw, port)
    assert device.read() == [heartbeat(2)]
    assert device.counters.overflowed == before


def test_what_the_kernel_keeps_from_us_on_purpose_is_no_overflow(peers: list[Peer], clock: Clock) -> None:
    """A stranger must not be able to make a link look overrun that is not."""
    station, stranger, _, _ = peers
    device = open_device(f"udpout:{LOOPBACK}:{station.address[1]}", clock)
    device.write(b"hello")
    with socket.socket(fileno=socket.dup(device.fileno())) as same:
        port = same.getsockname()[1]
    for number in range(500):
        stranger.send(b"noise of a stranger", port)
        if number % 5 == 0:
            station.send(heartbeat(number // 5).raw, port)
    assert len([frame for _ in range(200) for frame in device.read(once=True)]) == 100
    assert device.counters.overflowed == 0
    device.close()


# ---- downloads ------------------------------------------------------------------------------------------------------


def test_frames_of_a_download_share_datagrams_of_512_bytes_at_most(clock: Clock, peers: list[Peer]) -> None:
    peer = peers[0]
    device = open_device(f"udpout:{LOOPBACK}:{peer.address[1]}", clock)
    frames = [bytes([number]) * 109 for number in range(9)]
    try:
        assert all(device.write_more(frame) for frame in frames)
        assert peer.received() == [b"".join(frames[:4]), b"".join(frames[4:8])]
        device.flush()
        assert peer.received() == [frames[8]]
        device.flush()
        assert peer.received() == []
        assert (device.counters.frames_out, device.counters.bytes_out) == (9, 9 * 109)
        assert not device.flow_controlled
    finally:
        device.close()


def test_another_frame_does_not_wait_for_a_download_and_comes_in_order(clock: Clock, peers: list[Peer]) -> None:
    peer = peers[0]
    device = open_device(f"udpout:{LOOPBACK}:{peer.address[1]}", clock)
    try:
        device.write_more(b"download")
        device.write(b"command")
        assert peer.received() == [b"download", b"command"]
    finally:
        device.close()


def test_a_frame_longer_than_half_a_datagram_goes_alone(clock: Clock, peers: list[Peer]) -> None:
    peer = peers[0]
    device = open_device(f"udpout:{LOOPBACK}:{peer.address[1]}", clock)
    try:
        for number in range(3):
            device.write_more(bytes([number]) * 280)
        device.flush()
        assert [len(datagram) for datagram in peer.received()] == [280, 280, 280]
    finally:
        device.close()


def test_a_listening_link_without_a_peer_takes_no_download(listening: tuple[UdpIn, int]) -> None:
    device, _port = listening
    assert not device.write_more(b"download")
    device.flush()
    assert device.counters.refused_out == 0


def test_a_download_that_cannot_leave_is_counted_by_its_frames(clock: Clock, peers: list[Peer]) -> None:
    device = open_device(f"udpout:{LOOPBACK}:{peers[0].address[1]}", clock)
    for _ in range(3):
        device.write_more(b"download")
    device.close()
    device.flush()
    assert device.counters.refused_out == 3

# SPDX-License-Identifier: GPL-3.0-or-later

"""TCP links on loopback: connecting without waiting, coming back, and never half a frame."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest

from mavproxy_handover.link.base import Backoff
from mavproxy_handover.link.devices import LinkError, open_device
from mavproxy_handover.link.tcp import TcpIn, TcpOut
from mavproxy_handover.wire.frames import Frame, FrameSplitter
from tests.link.frames import STATION, Clock, command, heartbeat, read_frames, read_until

LOOPBACK = "127.0.0.1"


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def closing() -> Iterator[contextlib.ExitStack]:
    with contextlib.ExitStack() as stack:
        yield stack


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind((LOOPBACK, 0))
        port: int = sock.getsockname()[1]
    return port


def listener(closing: contextlib.ExitStack, port: int = 0) -> socket.socket:
    sock = closing.enter_context(socket.socket())
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind((LOOPBACK, port))
    sock.listen()
    sock.settimeout(10)
    return sock


def connect_out(closing: contextlib.ExitStack, clock: Clock, port: int) -> TcpOut:
    device = open_device(f"tcp:{LOOPBACK}:{port}", clock)
    assert isinstance(device, TcpOut)
    closing.callback(device.close)
    return device


def listen_in(closing: contextlib.ExitStack, clock: Clock) -> tuple[TcpIn, int]:
    port = free_port()
    device = open_device(f"tcpin:{LOOPBACK}:{port}", clock)
    assert isinstance(device, TcpIn)
    closing.callback(device.close)
    return device, port


def client(closing: contextlib.ExitStack, device: TcpIn, port: int) -> socket.socket:
    """A station's connection that `device` has taken."""
    sock = closing.enter_context(socket.create_connection((LOOPBACK, port), timeout=10))
    connects = device.counters.connects
    read_until(device, lambda: device.counters.connects > connects)
    return sock


# ---- tcp ----------------------------------------------------------------------------------------------------------


def test_it_connects_and_carries_frames_both_ways(closing: contextlib.ExitStack, clock: Clock) -> None:
    station = listener(closing)
    device = connect_out(closing, clock, station.getsockname()[1])
    assert not device.open
    assert device.fileno() == -1
    accepted = closing.enter_context(station.accept()[0])
    read_until(device, lambda: device.open)
    accepted.sendall(heartbeat(1).raw + command(2).raw)
    assert read_frames(device, 2) == [heartbeat(1), command(2)]
    assert device.write(b"telemetry")
    assert accepted.recv(100) == b"telemetry"


def test_nobody_listening_is_no_error_and_attempts_grow_rarer(closing: contextlib.ExitStack, clock: Clock) -> None:
    device = connect_out(closing, clock, free_port())
    attempts = []
    for tenth in range(250):
        clock.now = 100.0 + tenth / 10
        before = device.counters.errors
        device.read()
        if device.counters.errors > before:
            attempts.append(tenth / 10)
    assert device.trouble == "Connection refused"
    assert not device.write(b"telemetry")
    # the first at once; then after 0.5, 1, 2, 4, 8 and 10 s: a failure is seen one read after the attempt
    assert attempts == pytest.approx([0.0, 0.6, 1.6, 3.6, 7.6, 15.6], abs=0.15)


def test_a_lost_connection_comes_back(closing: contextlib.ExitStack, clock: Clock) -> None:
    station = listener(closing)
    port = station.getsockname()[1]
    device = connect_out(closing, clock, port)
    first = station.accept()[0]
    read_until(device, lambda: device.open)
    first.sendall(heartbeat(1).raw)
    read_frames(device, 1)
    first.close()
    read_until(device, lambda: not device.open)
    assert device.trouble == "closed by the other side"
    assert device.fileno() == -1
    clock.now += 1.0
    read_until(device, lambda: device.open)
    second = closing.enter_context(station.accept()[0])
    second.sendall(heartbeat(2).raw)
    assert read_frames(device, 1) == [heartbeat(2)]
    assert device.counters.connects == 2


def test_half_a_frame_of_a_lost_connection_spoils_nothing_on_the_next(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    station = listener(closing)
    device = connect_out(closing, clock, station.getsockname()[1])
    first = station.accept()[0]
    read_until(device, lambda: device.open)
    first.sendall(heartbeat(1).raw + command(2).raw[:20])
    read_frames(device, 1)
    first.close()
    read_until(device, lambda: not device.open)
    clock.now += 1.0
    read_until(device, lambda: device.open)
    second = closing.enter_context(station.accept()[0])
    second.sendall(heartbeat(3).raw)
    assert read_frames(device, 1) == [heartbeat(3)]


def test_a_station_that_reads_nothing_gets_whole_frames_or_none(closing: contextlib.ExitStack, clock: Clock) -> None:
    station = listener(closing)
    station.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    device = connect_out(closing, clock, station.getsockname()[1])
    accepted = closing.enter_context(station.accept()[0])
    read_until(device, lambda: device.open)
    taken = [number & 0xFF for number in range(20000) if device.write(command(number & 0xFF).raw)]
    assert 0 < len(taken) < 20000
    assert device.counters.refused_out == 20000 - len(taken)
    assert device.counters.frames_out == len(taken)
    accepted.settimeout(10)
    splitter = FrameSplitter()
    received = []
    while len(received) < len(taken):
        device.read()  # what waited in the device leaves
        received += splitter.feed(accepted.recv(4096))
    assert [frame.seq for frame in received] == taken
    assert splitter.counters.garbage_bytes == 0
    assert splitter.counters.bad_crc == 0


NOISE = b"\xfd\xff\x00"


def test_noise_delays_the_frame_behind_it_by_no_more_than_a_moment(closing: contextlib.ExitStack, clock: Clock) -> None:
    station = listener(closing)
    device = connect_out(closing, clock, station.getsockname()[1])
    accepted = closing.enter_context(station.accept()[0])
    read_until(device, lambda: device.open)
    accepted.sendall(NOISE + heartbeat(1).raw)
    read_until(device, lambda: device.counters.bytes_in > 3)
    assert device.unfinished
    clock.now += 0.26
    assert device.read() == [heartbeat(1)]
    assert not device.unfinished


def test_a_closed_link_does_not_come_back(closing: contextlib.ExitStack, clock: Clock) -> None:
    station = listener(closing)
    device = connect_out(closing, clock, station.getsockname()[1])
    closing.enter_context(station.accept()[0])
    read_until(device, lambda: device.open)
    device.close()
    clock.now += 100.0
    assert (device.read(), device.open, device.fileno(), device.write(b"late")) == ([], False, -1, False)
    assert device.counters.connects == 1


def test_backoff_starts_again_once_a_connection_worked() -> None:
    backoff = Backoff(first_s=0.5, most_s=10.0)
    waits = []
    now = 0.0
    for _ in range(7):
        assert backoff.due(now)
        backoff.tried(now)
        begun = now
        while not backoff.due(now):
            now += 0.5
        waits.append(now - begun)
    assert waits == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    backoff.succeeded()
    backoff.tried(now)
    assert not backoff.due(now + 0.4)
    assert backoff.due(now + 0.5)


# ---- tcpin --------------------------------------------------------------------------------------------------------


def test_a_station_connects_and_frames_go_both_ways(closing: contextlib.ExitStack, clock: Clock) -> None:
    device, port = listen_in(closing, clock)
    assert not device.open
    assert device.fileno() >= 0
    station = client(closing, device, port)
    station.sendall(heartbeat(1).raw)
    (frame,) = read_frames(device, 1)
    device.accept_sender(frame)
    assert device.write(b"telemetry")
    assert station.recv(100) == b"telemetry"


def test_a_program_that_waits_for_the_vehicle_hears_it_before_it_speaks(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    silent = client(closing, device, port)
    assert device.write(b"telemetry")
    assert silent.recv(100) == b"telemetry"


def test_a_strangers_connection_does_not_take_the_downlink_and_is_closed_after_a_while(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    station = client(closing, device, port)
    station.sendall(heartbeat(1).raw)
    device.accept_sender(read_frames(device, 1)[0])
    stranger = client(closing, device, port)
    stranger.sendall(heartbeat(2).raw)
    assert read_frames(device, 1) == [heartbeat(2)]  # and the caller does not call it genuine
    device.write(b"telemetry")
    assert station.recv(100) == b"telemetry"
    clock.now += 10.5
    device.read()
    assert stranger.recv(100) == b""
    assert device.counters.strangers == 1
    assert device.write(b"more")
    assert station.recv(100) == b"more"


def test_a_station_gets_in_past_its_own_dead_connection(closing: contextlib.ExitStack, clock: Clock) -> None:
    device, port = listen_in(closing, clock)
    dead = client(closing, device, port)
    dead.sendall(heartbeat(1).raw)
    device.accept_sender(read_frames(device, 1)[0])
    clock.now += 1.6  # the old connection is not closed, it is only silent
    alive = client(closing, device, port)
    alive.sendall(heartbeat(2).raw)
    device.accept_sender(read_frames(device, 1)[0])
    device.write(b"telemetry")
    assert alive.recv(100) == b"telemetry"
    device.read()
    assert dead.recv(100) == b""


def flood(
    closing: contextlib.ExitStack, port: int, count: int, host: str = LOOPBACK, says: bytes = b""
) -> list[socket.socket]:
    """Connections from an address of their own, where the machine has one; whoever is full does not answer."""
    made = []
    for _ in range(count):
        sock = closing.enter_context(socket.socket())
        sock.bind((host, 0))
        sock.settimeout(10)
        sock.connect((LOOPBACK, port))
        sock.sendall(says)
        made.append(sock)
    return made


def hear(device: TcpIn, rounds: int = 1) -> list[Frame]:
    """What is heard in some reads, by a caller to whom frames of the system STATION are genuine."""
    found = []
    for _ in range(rounds):
        for frame in device.read():
            if frame.sysid == STATION:
                device.accept_sender(frame)
                found.append(frame)
    return found


STRANGER = heartbeat(1, sysid=9).raw


def test_strangers_connections_are_few_and_do_not_keep_the_station_out(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    strangers = flood(closing, port, 40)
    read_until(device, lambda: device.counters.connects == 40)
    device.read()
    assert device.counters.strangers == 8
    assert strangers[0].recv(100) == b""
    station = client(closing, device, port)
    station.sendall(heartbeat(1).raw)
    device.accept_sender(read_frames(device, 1)[0])
    for _ in range(3):
        flood(closing, port, 40)
        read_until(device, lambda: device.read() == [] and device.counters.connects % 40 == 1)
    assert device.write(b"telemetry")
    assert station.recv(100) == b"telemetry"


@pytest.mark.parametrize("says", [b"", STRANGER, b"\xfd" * 600], ids=["silent", "frames", "noise"])
@pytest.mark.parametrize("moment", ["at once", "0.1 s later"])
def test_a_station_that_connects_amid_a_flood_is_heard_with_its_first_frame(
    closing: contextlib.ExitStack, clock: Clock, says: bytes, moment: str
) -> None:
    """100 connections a second, from its own address; a read each 0.02 s."""
    device, port = listen_in(closing, clock)
    for _ in range(30):
        flood(closing, port, 2, says=says)
        clock.now += 0.02
        assert hear(device) == []
    station = closing.enter_context(socket.create_connection((LOOPBACK, port), timeout=10))
    for _ in range(0 if moment == "at once" else 5):
        flood(closing, port, 2, says=says)
        clock.now += 0.02
        hear(device)
    station.sendall(heartbeat(3).raw)
    heard: list[Frame] = []
    for _ in range(3):
        flood(closing, port, 2, says=says)
        clock.now += 0.02
        heard += hear(device)
    assert heard == [heartbeat(3)]
    for step in range(100):  # and it stays
        with contextlib.suppress(OSError):
            flood(closing, port, 2, says=says)
        clock.now += 0.02
        if step % 50 == 0:
            station.sendall(heartbeat(4).raw)
        hear(device)
        assert len(device.descriptors()) <= 1 + 32 + 32 + 4
    assert device.write(b"telemetry")
    assert station.recv(100) == b"telemetry"


def test_who_floods_from_one_address_keeps_nobody_out_who_is_slow_from_another(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    (station,) = flood(closing, port, 1, host="127.0.0.2")
    hear(device)
    for _ in range(200):
        flood(closing, port, 2)
        clock.now += 0.02
        hear(device)
    assert device.counters.strangers >= 350
    assert device.write(b"telemetry")  # to the one that may be a program that waits for the vehicle
    assert station.recv(100) == b"telemetry"
    station.sendall(heartbeat(1).raw)
    assert hear(device, 3) == [heartbeat(1)]


def test_a_station_comes_back_past_a_flood_and_its_own_dead_connection(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    dead = client(closing, device, port)
    dead.sendall(heartbeat(1).raw)
    device.accept_sender(read_frames(device, 1)[0])
    clock.now += 1.6
    alive = closing.enter_context(socket.create_connection((LOOPBACK, port), timeout=10))
    flood(closing, port, 20)
    alive.sendall(heartbeat(2).raw)
    assert hear(device, 3) == [heartbeat(2)]
    assert device.write(b"telemetry")
    assert alive.recv(100) == b"telemetry"
    assert dead.recv(100) == b""


def test_who_proves_genuine_over_and_over_does_not_use_up_all_descriptors(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    """Without a key anybody may say that he is the station."""
    device, port = listen_in(closing, clock)
    for _ in range(30):
        for sock in flood(closing, port, 4, says=heartbeat(1).raw):
            closing.callback(sock.close)
        clock.now += 0.02
        hear(device)
    hear(device)
    assert len(device.descriptors()) <= 1 + 4


def test_what_strangers_send_is_read_in_small_pieces_behind_the_stations(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    station = client(closing, device, port)
    station.sendall(heartbeat(1).raw)
    device.accept_sender(read_frames(device, 1)[0])
    flood(closing, port, 30, says=STRANGER * 1000)
    read_until(device, lambda: device.counters.connects == 31)
    station.sendall(heartbeat(2).raw * 10)
    pieces = []
    for _ in range(20):
        before = device.counters.bytes_in
        frames = device.read()
        pieces.append(device.counters.bytes_in - before)
        if frames and frames[0].sysid == STATION:
            assert [frame.sysid for frame in frames[:10]] == [STATION] * 10
    assert max(pieces) <= 8192 + 512 + 210


def test_the_station_may_go_and_come_again(closing: contextlib.ExitStack, clock: Clock) -> None:
    device, port = listen_in(closing, clock)
    station = client(closing, device, port)
    station.sendall(heartbeat(1).raw)
    device.accept_sender(read_frames(device, 1)[0])
    station.close()
    read_until(device, lambda: not device.open)
    assert not device.write(b"telemetry")
    assert device.fileno() >= 0
    again = client(closing, device, port)
    assert device.write(b"telemetry")
    assert again.recv(100) == b"telemetry"


def test_every_descriptor_is_named_so_that_no_child_process_keeps_the_port(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    assert device.descriptors() == [device.fileno()]
    client(closing, device, port)
    assert len(device.descriptors()) == 2
    assert device.fileno() == device.descriptors()[1]
    outward = connect_out(closing, clock, port)
    assert len(outward.descriptors()) == 1  # still connecting
    read_until(outward, lambda: outward.open)
    assert outward.descriptors() == [outward.fileno()]
    for closed in (device, outward):
        closed.close()
        assert closed.descriptors() == []


def test_a_port_in_use_is_one_line_that_names_the_link(closing: contextlib.ExitStack) -> None:
    port = listener(closing).getsockname()[1]
    with pytest.raises(LinkError, match=f"^link tcpin:{LOOPBACK}:{port} cannot be opened: Address already in use$"):
        open_device(f"tcpin:{LOOPBACK}:{port}")


def test_noise_of_a_client_delays_its_frame_by_no_more_than_a_moment(
    closing: contextlib.ExitStack, clock: Clock
) -> None:
    device, port = listen_in(closing, clock)
    station = client(closing, device, port)
    station.sendall(NOISE + heartbeat(1).raw)
    read_until(device, lambda: device.counters.bytes_in > 3)
    assert device.unfinished
    clock.now += 0.26
    (frame,) = device.read()
    device.accept_sender(frame)
    assert (frame, device.unfinished) == (heartbeat(1), False)
    assert device.write(b"telemetry")
    assert station.recv(100) == b"telemetry"


def test_a_flood_on_one_connection_is_read_in_bounded_pieces(closing: contextlib.ExitStack, clock: Clock) -> None:
    device, port = listen_in(closing, clock)
    station = client(closing, device, port)
    station.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            station.send(heartbeat(1).raw * 1000)
    read_until(device, lambda: device.counters.bytes_in > 0)
    pieces = []
    for _ in range(20):
        before = device.counters.bytes_in
        frames = device.read()
        pieces.append(device.counters.bytes_in - before)
        assert len(frames) <= 8192 // len(heartbeat(1).raw) + 1
    assert max(pieces) == 8192


# ---- a web page ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [b"POST / ", b"GET /x ", b"OPTIONS / ", b"HEAD / "])
@pytest.mark.parametrize("cut", [0, 1, 3])
def test_frames_in_a_web_page_s_request_are_not_looked_for(
    closing: contextlib.ExitStack, clock: Clock, method: bytes, cut: int
) -> None:
    """A page in the operator's browser may send any bytes to a port of this computer, after the head of a request."""
    device, port = listen_in(closing, clock)
    page = client(closing, device, port)
    request = method + b"HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99\r\n\r\n" + heartbeat(1).raw + command(2).raw
    if cut:
        page.sendall(request[:cut])
        closing.callback(device.read)
        for _ in range(20):
            device.read()
    page.sendall(request[cut:])
    page.settimeout(0.01)
    frames: list[Frame] = []
    for _ in range(200):
        frames += device.read()
        with contextlib.suppress(TimeoutError, ConnectionError):
            if page.recv(1) == b"":
                break
    assert frames == []
    assert device.counters.strangers == 1


def test_a_line_that_begins_within_a_frame_is_served(closing: contextlib.ExitStack, clock: Clock) -> None:
    device, port = listen_in(closing, clock)
    late = client(closing, device, port)
    late.sendall(command(1).raw[7:] + heartbeat(2).raw)
    assert read_frames(device, 1) == [heartbeat(2)]

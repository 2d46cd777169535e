# SPDX-License-Identifier: GPL-3.0-or-later

"""Links that may be closed, and the addresses of names: looked up beside the main loop, the last ones remembered."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable, Iterator

import pytest

from mavproxy_handover.link import devices, names
from mavproxy_handover.link.base import Device
from mavproxy_handover.link.box_line import BoxLine
from mavproxy_handover.link.devices import LinkError, open_link, parse_device
from mavproxy_handover.link.names import Names
from mavproxy_handover.link.tcp import TcpOut
from mavproxy_handover.link.udp import UdpIn, UdpOut
from mavproxy_handover.tools.worker import Worker
from tests.link.frames import Clock, heartbeat, read_frames

HOME = "127.0.0.1"


class Resolver:
    """A name service of the test's. A look-up is done when the test lets it be."""

    def __init__(self) -> None:
        self.addresses: dict[str, tuple[str, ...]] = {}
        self.asked: list[str] = []
        self.waiting: list[Callable[[], None]] = []

    def search(self, host: str) -> tuple[str, ...]:
        self.asked.append(host)
        if host not in self.addresses:
            raise OSError(socket.EAI_AGAIN, "Temporary failure in name resolution")
        return self.addresses[host]

    def names(self, known: dict[str, tuple[str, ...]] | None = None) -> Names:
        return Names(known, Worker(self.waiting.append), self.search)

    def answer(self) -> None:
        waiting, self.waiting[:] = list(self.waiting), []
        for job in waiting:
            job()


@pytest.fixture
def resolver(monkeypatch: pytest.MonkeyPatch) -> Resolver:
    made = Resolver()
    monkeypatch.setattr(names, "look_up", made.search)
    return made


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def opened(clock: Clock) -> Iterator[Callable[..., Device]]:
    made: list[Device] = []

    def make(text: str, known: Names, *, strict: bool = False) -> Device:
        made.append(open_link(text, known, clock, strict=strict))
        return made[-1]

    yield make
    for device in made:
        device.close()


Opened = Callable[..., Device]


def port_of(sock: socket.socket) -> int:
    port: int = sock.getsockname()[1]
    return port


@pytest.fixture
def taken() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind((HOME, 0))
        holder.setblocking(False)
        yield holder


# ---- names ---------------------------------------------------------------------------------------------------------


def test_a_name_is_looked_up_beside_the_main_loop_and_its_address_stays(resolver: Resolver) -> None:
    known = resolver.names()
    assert known.addresses("gcs.example") == ()
    known.tick(100.0)
    assert resolver.asked == [], "nothing is asked in the main loop"
    resolver.addresses["gcs.example"] = ("192.0.2.7",)
    resolver.answer()
    known.tick(100.2)
    assert known.addresses("gcs.example") == ("192.0.2.7",)
    assert known.known == {"gcs.example": ("192.0.2.7",)}
    del resolver.addresses["gcs.example"]
    for at in (130.3, 160.4):
        known.request("gcs.example")
        known.tick(at)
        resolver.answer()
        known.tick(at + 0.1)
    assert len(resolver.asked) == 3
    assert known.addresses("gcs.example") == ("192.0.2.7",)


def test_one_that_nobody_knows_is_asked_for_again_every_second(resolver: Resolver) -> None:
    known = resolver.names()
    for tenth in range(100):
        known.addresses("gcs.example")
        known.tick(100.0 + tenth / 10)
        resolver.answer()
    assert 9 <= len(resolver.asked) <= 12


def test_one_that_is_known_is_asked_for_every_half_minute_at_most(resolver: Resolver) -> None:
    known = resolver.names()
    resolver.addresses["gcs.example"] = ("192.0.2.7",)
    for tenth in range(600):
        known.addresses("gcs.example")
        known.request("gcs.example")
        known.tick(100.0 + tenth / 10)
        resolver.answer()
    assert len(resolver.asked) == 2


def test_a_look_up_that_hangs_holds_up_nothing(resolver: Resolver) -> None:
    """And after half a minute the next one has its turn."""
    known = resolver.names()
    resolver.addresses["b.example"] = ("192.0.2.8",)
    known.addresses("a.example")
    known.addresses("b.example")
    known.tick(100.0)
    hanging, resolver.waiting[:] = list(resolver.waiting), []
    for second in range(32):
        known.tick(100.0 + second)
        resolver.answer()
    known.tick(133.0)
    assert known.addresses("b.example") == ("192.0.2.8",)
    assert len(hanging) == 1


def test_an_address_is_no_name(resolver: Resolver) -> None:
    known = resolver.names()
    assert known.addresses("192.0.2.7") == ("192.0.2.7",)
    assert known.addresses("fe80::1%wlan0") == ("fe80::1%wlan0",)
    known.tick(100.0)
    assert resolver.waiting == []


# ---- before a flight -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["udpin:{}:{}", "udpout:{}:{}", "tcp:{}:{}", "tcpin:{}:{}"])
def test_on_the_ground_a_name_without_an_address_is_an_error(form: str, resolver: Resolver, opened: Opened) -> None:
    text = form.format("gcs.example", 14550)
    with pytest.raises(LinkError) as error:
        opened(text, resolver.names(), strict=True)
    assert str(error.value) == f"link {text} cannot be opened: Temporary failure in name resolution"


def test_on_the_ground_a_port_in_use_is_an_error(resolver: Resolver, opened: Opened, taken: socket.socket) -> None:
    with pytest.raises(LinkError, match=r"cannot be opened: Address already in use"):
        opened(f"udpin:{HOME}:{port_of(taken)}", resolver.names(), strict=True)


def test_what_can_be_opened_on_the_ground_is_the_device_itself(resolver: Resolver, opened: Opened) -> None:
    assert type(opened(f"udpout:{HOME}:9", resolver.names(), strict=True)) is UdpOut
    assert type(opened(f"tcp:{HOME}:9", resolver.names(), strict=True)) is TcpOut


# ---- in flight -----------------------------------------------------------------------------------------------------


def test_a_port_in_use_is_a_closed_link_until_it_is_free(
    resolver: Resolver, opened: Opened, clock: Clock, taken: socket.socket
) -> None:
    port = port_of(taken)
    link = opened(f"udpin:{HOME}:{port}", resolver.names())
    assert (link.open, link.fileno(), link.descriptors(), link.unfinished) == (False, -1, [], False)
    assert link.trouble == f"link udpin:{HOME}:{port} cannot be opened: Address already in use"
    assert not link.write(heartbeat().raw)
    assert link.read() == []
    assert (link.counters.errors, link.counters.refused_out) == (1, 1)
    taken.close()
    assert link.read() == []
    assert link.fileno() == -1, "not before it is due"
    clock.now += 0.6
    link.read()
    assert link.fileno() >= 0
    assert link.trouble == ""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.sendto(heartbeat().raw, (HOME, port))
        (frame,) = read_frames(link, 1)
    link.accept_sender(frame)
    assert link.open
    assert link.counters.frames_in == 1, "counters go on"


def test_it_is_tried_again_every_second(resolver: Resolver, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `udpin` on an address that went with its interface."""
    tries: list[float] = []

    def gone(spec: devices.DeviceSpec, _clock: object) -> Device:
        tries.append(clock.now)
        raise LinkError(f"link {spec.text} cannot be opened: {os.strerror(errno.EADDRNOTAVAIL)}")

    monkeypatch.setattr(devices, "_made", gone)
    link = open_link("udpin:192.0.2.1:14550", resolver.names(), clock, strict=False)
    begun = clock.now
    while clock.now < begun + 60.0:
        clock.now += 0.05
        link.read()
    assert 55 <= len(tries) <= 65


def test_a_form_that_is_not_known_is_an_error_always(resolver: Resolver) -> None:
    with pytest.raises(LinkError, match="must be one of"):
        open_link("radio:1:2", resolver.names(), strict=False)


def test_a_restart_begins_with_the_last_address(resolver: Resolver, opened: Opened, taken: socket.socket) -> None:
    known = resolver.names({"gcs.example": (HOME,)})
    link = opened(f"udpout:gcs.example:{port_of(taken)}", known)
    assert link.open
    assert link.write(heartbeat().raw)
    assert taken.recv(300) == heartbeat().raw
    assert resolver.asked == []


def test_a_name_without_an_address_is_a_closed_link_until_it_has_one(
    resolver: Resolver, opened: Opened, clock: Clock, taken: socket.socket
) -> None:
    known = resolver.names()
    link = opened(f"udpout:gcs.example:{port_of(taken)}", known)
    assert not link.open
    assert link.trouble == (
        f"link udpout:gcs.example:{port_of(taken)} cannot be opened: the address of gcs.example is not known yet"
    )
    resolver.addresses["gcs.example"] = (HOME,)
    for _ in range(4):
        clock.now += 0.5
        known.tick(clock.now)
        resolver.answer()
        link.read()
    assert link.write(heartbeat().raw)
    assert taken.recv(300) == heartbeat().raw


def silent_for(link: Device, known: Names, resolver: Resolver, clock: Clock, seconds: float) -> None:
    for _ in range(round(seconds / 0.2)):
        clock.now += 0.2
        known.tick(clock.now)
        resolver.answer()
        assert link.read() == []


def test_a_station_that_moved_is_found_again(
    resolver: Resolver, opened: Opened, clock: Clock, taken: socket.socket
) -> None:
    """Its name has another address now, and nothing is heard from the one of before."""
    known = resolver.names({"gcs.example": ("127.0.0.9",)})
    link = opened(f"udpout:gcs.example:{port_of(taken)}", known)
    assert link.write(heartbeat().raw)
    resolver.addresses["gcs.example"] = (HOME,)
    silent_for(link, known, resolver, clock, 21.0)
    assert link.write(heartbeat().raw)
    assert taken.recv(300) == heartbeat().raw


def test_one_that_is_heard_stays_where_it_is(
    resolver: Resolver, opened: Opened, clock: Clock, taken: socket.socket
) -> None:
    known = resolver.names({"gcs.example": (HOME,)})
    link = opened(f"udpout:gcs.example:{port_of(taken)}", known)
    resolver.addresses["gcs.example"] = ("127.0.0.9",)
    for _ in range(5):
        link.write(heartbeat().raw)
        _data, sender = taken.recvfrom(300)
        taken.sendto(heartbeat().raw, sender)
        assert len(read_frames(link, 1)) == 1
        silent_for(link, known, resolver, clock, 9.0)
    assert resolver.asked == []


def test_a_station_with_two_addresses_is_called_at_the_other_one_when_the_first_is_silent(
    resolver: Resolver, opened: Opened, clock: Clock, taken: socket.socket
) -> None:
    known = resolver.names({"gcs.example": ("127.0.0.9", HOME)})
    resolver.addresses["gcs.example"] = ("127.0.0.9", HOME)
    link = opened(f"udpout:gcs.example:{port_of(taken)}", known)
    silent_for(link, known, resolver, clock, 10.5)
    link.write(heartbeat().raw)
    assert taken.recv(300) == heartbeat().raw
    silent_for(link, known, resolver, clock, 10.5)
    link.write(heartbeat().raw)
    with pytest.raises(BlockingIOError):
        taken.recv(300)


def test_a_listening_link_with_a_name_is_not_closed_for_silence(
    resolver: Resolver, opened: Opened, clock: Clock
) -> None:
    known = resolver.names({"me.example": (HOME,)})
    resolver.addresses["me.example"] = (HOME, "127.0.0.9")
    link = opened("udpin:me.example:0".replace(":0", ":39417"), known)
    before = link.fileno()
    silent_for(link, known, resolver, clock, 40.0)
    assert link.fileno() == before


def test_tcp_goes_on_to_the_next_address_of_a_name(resolver: Resolver, opened: Opened, clock: Clock) -> None:
    with socket.create_server((HOME, 0)) as server:
        known = resolver.names({"gcs.example": ("127.0.0.9", HOME)})
        link = opened(f"tcp:gcs.example:{port_of(server)}", known)
        for _ in range(40):
            clock.now += 0.2
            link.read()
            if link.open:
                break
        assert link.open


def test_the_box_waits_for_its_address(resolver: Resolver, clock: Clock) -> None:
    with socket.create_server((HOME, 0)) as server:
        known = resolver.names()
        box = BoxLine(f"tcp:box.example:{port_of(server)}", clock, known)
        assert box.trouble == "the address of box.example is not known yet"
        resolver.addresses["box.example"] = (HOME,)
        for _ in range(40):
            clock.now += 0.2
            known.tick(clock.now)
            resolver.answer()
            box.read()
            if box.open:
                break
        assert box.open
        box.close()


def test_a_closed_link_stays_closed(resolver: Resolver, opened: Opened, clock: Clock, taken: socket.socket) -> None:
    port = port_of(taken)
    link = opened(f"udpin:{HOME}:{port}", resolver.names())
    taken.close()
    link.close()
    clock.now += 60.0
    assert link.read() == []
    assert link.fileno() == -1
    other = UdpIn(parse_device(f"udpin:{HOME}:{port}"))
    other.close()

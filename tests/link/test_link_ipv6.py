# SPDX-License-Identifier: GPL-3.0-or-later

"""IPv6 links, on loopback and on one interface: each kind, mapped IPv4 addresses, scopes, and names of both kinds."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from mavproxy_handover.link import names
from mavproxy_handover.link.base import Device
from mavproxy_handover.link.devices import DeviceSpec, Kind, LinkError, open_device, parse_device
from mavproxy_handover.link.names import host_of, look_up
from tests.link.frames import command, heartbeat, read_frames

LOOPBACK = "::1"


def has_ipv6() -> bool:
    with suppress(OSError), socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return True
    return False


pytestmark = pytest.mark.skipif(not has_ipv6(), reason="this machine has no IPv6")

Opened = Callable[[str], Device]


@pytest.fixture
def opened() -> Iterator[Opened]:
    made: list[Device] = []

    def make(text: str) -> Device:
        made.append(open_device(text))
        return made[-1]

    yield make
    for device in made:
        device.close()


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET6, kind) as probe:
        probe.bind(("::", 0))
        port: int = probe.getsockname()[1]
        return port


def talk(listening: Device, calling: Device) -> None:
    """Both ways, and the listening end answers the one that proved genuine."""
    end = time.monotonic() + 10.0
    while not calling.write(heartbeat(1).raw):  # TCP connects in `read`
        assert time.monotonic() < end, calling.trouble
        calling.read()
        listening.read()
        time.sleep(0.01)
    (frame,) = read_frames(listening, 1)
    assert frame.raw == heartbeat(1).raw
    listening.accept_sender(frame)
    assert listening.open
    assert listening.write(command(2).raw)
    assert [each.raw for each in read_frames(calling, 1)] == [command(2).raw]


# ---- forms ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "kind", "host", "port", "way"),
    [
        ("udpin:[::]:14550", Kind.UDP_IN, "::", 14550, ""),
        ("udpout:[2001:db8::9]:14550", Kind.UDP_OUT, "2001:db8::9", 14550, ""),
        ("udpout:[2001:db8::9]:14550@wwan0", Kind.UDP_OUT, "2001:db8::9", 14550, "wwan0"),
        ("udpout:[fe80::1%wlan0]:14550", Kind.UDP_OUT, "fe80::1%wlan0", 14550, ""),
        ("tcp:[::ffff:192.0.2.1]:5760", Kind.TCP_OUT, "::ffff:192.0.2.1", 5760, ""),
        ("tcpin:[::1]:5760", Kind.TCP_IN, "::1", 5760, ""),
    ],
)
def test_an_address_stands_in_brackets(text: str, kind: Kind, host: str, port: int, way: str) -> None:
    assert parse_device(text) == DeviceSpec(text, kind, host, port, way)


@pytest.mark.parametrize(
    "text",
    [
        "udpin:::1:14550",
        "udpin:[::1]",
        "udpin:[::1]14550",
        "udpin:[::1:14550",
        "udpin:[]:14550",
        "udpin:[127.0.0.1]:14550",
        "udpin:[gcs.example]:14550",
        "udpin:[::1]:14550:1",
        "udpin:[::1]:0",
        "udpin:[fe80::1%]:14550",
        "udpin:[::1]:14550@wlan0",
        "udpin:[[::1]]:14550",
    ],
)
def test_anything_else_in_brackets_is_refused(text: str) -> None:
    with pytest.raises(LinkError, match="must be"):
        parse_device(text)


# ---- each kind -----------------------------------------------------------------------------------------------------


def test_udp(opened: Opened) -> None:
    port = free_port()
    talk(opened(f"udpin:[::1]:{port}"), opened(f"udpout:[::1]:{port}"))


def test_tcp(opened: Opened) -> None:
    port = free_port(socket.SOCK_STREAM)
    talk(opened(f"tcpin:[::1]:{port}"), opened(f"tcp:[::1]:{port}"))


@pytest.mark.parametrize(("listening", "calling"), [("udpin", "udpout"), ("tcpin", "tcp")])
def test_all_addresses_are_those_of_both_kinds(opened: Opened, listening: str, calling: str) -> None:
    port = free_port(socket.SOCK_STREAM if calling == "tcp" else socket.SOCK_DGRAM)
    talk(opened(f"{listening}:[::]:{port}"), opened(f"{calling}:127.0.0.1:{port}"))


@pytest.mark.parametrize(("listening", "calling"), [("udpin", "udpout"), ("tcpin", "tcp")])
def test_a_mapped_address_is_the_ipv4_address_that_it_stands_for(opened: Opened, listening: str, calling: str) -> None:
    port = free_port(socket.SOCK_STREAM if calling == "tcp" else socket.SOCK_DGRAM)
    talk(opened(f"{listening}:127.0.0.1:{port}"), opened(f"{calling}:[::ffff:127.0.0.1]:{port}"))


def link_local() -> str:
    """An address of this machine with its interface, "" if there is none."""
    with suppress(OSError):
        for line in Path("/proc/net/if_inet6").read_text().splitlines():
            digits, _index, _prefix, scope, _flags, interface = line.split()
            if scope == "20":
                return f"{socket.inet_ntop(socket.AF_INET6, bytes.fromhex(digits))}%{interface}"
    return ""


@pytest.mark.parametrize(("listening", "calling"), [("udpin", "udpout"), ("tcpin", "tcp")])
def test_a_link_local_address_with_its_interface(opened: Opened, listening: str, calling: str) -> None:
    address = link_local()
    if not address:
        pytest.skip("no interface here has a link-local address")
    port = free_port(socket.SOCK_STREAM if calling == "tcp" else socket.SOCK_DGRAM)
    talk(opened(f"{listening}:[{address}]:{port}"), opened(f"{calling}:[{address}]:{port}"))


def test_an_interface_that_is_not_there_is_told_at_the_start() -> None:
    with pytest.raises(LinkError, match=r"link udpin:\[fe80::1%none0\]:14550 cannot be opened: "):
        open_device("udpin:[fe80::1%none0]:14550")


def test_a_way_out_by_an_interface(opened: Opened) -> None:
    port = free_port()
    listening, calling = opened(f"udpin:[::1]:{port}"), opened(f"udpout:[::1]:{port}@lo")
    if sys.platform != "linux":
        pytest.skip("only Linux chooses the interface")
    talk(listening, calling)
    lost = opened(f"udpout:[::1]:{port}@none0")
    assert not lost.write(heartbeat(3).raw)
    assert lost.trouble == "no interface with this name"


# ---- others --------------------------------------------------------------------------------------------------------


def test_a_calling_link_hears_nobody_else(opened: Opened) -> None:
    port = free_port()
    listening, calling = opened(f"udpin:[::1]:{port}"), opened(f"udpout:[::1]:{port}")
    assert calling.write(heartbeat(1).raw)
    read_frames(listening, 1)
    local = socket.socket(fileno=socket.dup(calling.fileno()))
    with local, socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(command(7).raw, (LOOPBACK, local.getsockname()[1]))
        for _ in range(20):
            assert calling.read() == []
        if sys.platform == "linux":  # the kernel throws it away: it never gets to the socket
            assert calling.counters.strangers == 0


def test_strangers_of_one_network_are_one_host() -> None:
    """An IPv6 host has as many addresses as it likes, so what a flood may cost is counted by the first half of them."""
    assert host_of("2001:db8:1:2:aaaa::1") == host_of("2001:db8:1:2:bbbb::2")
    assert host_of("2001:db8:1:2::1") != host_of("2001:db8:1:3::1")
    assert host_of("::ffff:192.0.2.1") == host_of("192.0.2.1") == "192.0.2.1"
    assert host_of("fe80::1%eth0") == host_of("fe80::2%eth1")


def test_a_name_with_both_kinds_gives_ipv4_first(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        (socket.AF_INET6, socket.SOCK_DGRAM, 17, "", ("2001:db8::9", 0, 0, 0)),
        (socket.AF_INET6, socket.SOCK_DGRAM, 17, "", ("::ffff:192.0.2.9", 0, 0, 0)),
        (socket.AF_INET, socket.SOCK_DGRAM, 17, "", ("192.0.2.7", 0)),
        (socket.AF_INET, socket.SOCK_DGRAM, 17, "", ("192.0.2.7", 0)),
    ]
    monkeypatch.setattr(names.socket, "getaddrinfo", lambda *_arguments, **_options: found)
    assert look_up("gcs.example") == ("192.0.2.7", "2001:db8::9", "192.0.2.9")


def test_a_name_of_a_link_local_address_names_its_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    """As names of the local network do (`gcs.local`)."""
    found = [(socket.AF_INET6, socket.SOCK_DGRAM, 17, "", ("fe80::9", 0, 0, 4))]
    monkeypatch.setattr(names.socket, "getaddrinfo", lambda *_arguments, **_options: found)
    assert look_up("gcs.local") == ("fe80::9%4",)

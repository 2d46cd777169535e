# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's address that another station sends: what is one, what is refused, and its bytes written out by hand."""

from __future__ import annotations

import random

import pytest

from mavproxy_handover.wire.vehicle_address import (
    MAX_ADDRESSES,
    VehicleAddress,
    on_this_computer,
    pack_addresses,
    parse_address,
    unpack_addresses,
    why_unusable,
)

WIFI = VehicleAddress("10.0.0.2", 14552)
LTE = VehicleAddress("100.64.3.7", 5762)
#: station 252: udpout 10.0.0.2:14552 and udpout 100.64.3.7:5762
BYTES = bytes.fromhex("fc01 38d8 0a000002 fc01 1682 64400307".replace(" ", ""))


@pytest.mark.parametrize(("text", "address"), [("udpout:10.0.0.2:14552", WIFI), ("udpout:100.64.3.7:5762", LTE)])
def test_an_address_is_read_and_said_again(text: str, address: VehicleAddress) -> None:
    assert parse_address(text) == address
    assert address.text == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        None,
        5,
        ["udpout:10.0.0.2:14552"],
        "10.0.0.2:14552",
        "tcp:10.0.0.2:5762",
        "udpin:0.0.0.0:14550",
        "udpin:10.0.0.2:14550",
        "tcpin:10.0.0.2:5762",
        "udpbcast:10.0.0.255:14550",
        "mcast:",
        "serial:/dev/ttyUSB0:57600",
        "/dev/ttyUSB0",
        "/etc/passwd",
        "flight.tlog",
        "csv:1.csv",
        "udpout:drone.example.org:14552",
        "udpout:localhost:14552",
        "udpout:[::1]:14552",
        "udpout:10.0.0.2:14552@wwan0",
        'udpout:10.0.0.2:14552:{"label":"x"}',
        "udpout:10.0.0.2:14552;module load x",
        "udpout:10.0.0.2",
        "udpout:10.0.0.2:",
        "udpout:10.0.0.2:0",
        "udpout:10.0.0.2:65536",
        "udpout:10.0.0.2:-1",
        "udpout:10.0.0.2:1e3",
        "udpout:10.0.0.2:٣",
        "udpout:10.0.0.2:000000014552",
        "udpout:010.0.0.2:14552",
        "udpout:10.2:14552",
        "udpout:167772162:14552",
        "udpout: 10.0.0.2:14552",
        "udpout:10.0.0.2\n:14552",
        "udpout:0.0.0.0:14552",
        "udpout:0.1.2.3:14552",
        "udpout:224.0.0.1:14552",
        "udpout:239.255.145.50:14550",
        "udpout:255.255.255.255:14550",
        "udpout:240.0.0.1:14550",
        "UDPOUT:10.0.0.2:14552",
    ],
)
def test_anything_else_is_refused_with_a_word(text: object) -> None:
    with pytest.raises(ValueError, match=r"[a-z]+ .*"):
        parse_address(text)


def test_the_error_says_what_is_allowed() -> None:
    with pytest.raises(ValueError) as caught:
        parse_address("serial:/dev/ttyUSB0:57600")
    assert str(caught.value) == (
        "not an address of a vehicle (allowed: udpout:ADDRESS:PORT, ADDRESS an IPv4 address in digits, PORT 1 to 65535)"
    )


@pytest.mark.parametrize(("host", "local"), [("127.0.0.1", True), ("127.9.8.7", True), ("10.0.0.2", False)])
def test_a_loopback_address_leads_back_to_the_station(host: str, local: bool) -> None:
    assert on_this_computer(VehicleAddress(host, 14552)) is local


def test_the_bytes_are_those_written_out_by_hand() -> None:
    assert pack_addresses({252: (WIFI, LTE)}) == BYTES
    assert unpack_addresses(BYTES) == {252: (WIFI, LTE)}


def test_a_station_is_sent_its_own_addresses_alone() -> None:
    assert pack_addresses({251: (LTE,), 252: (WIFI, LTE)}, 252) == BYTES
    assert pack_addresses({251: (LTE,)}, 252) == b""


def test_twenty_two_addresses_fit_and_no_more_are_packed() -> None:
    many = dict.fromkeys(range(1, 31), (WIFI,))
    assert len(pack_addresses(many)) == 176
    assert list(unpack_addresses(pack_addresses(many))) == list(range(1, MAX_ADDRESSES + 1))


def test_zeros_unknown_kinds_port_zero_and_a_cut_entry_are_no_addresses() -> None:
    nothing = bytes(176)
    newer = bytes.fromhex("fc02 38d8 0a000002".replace(" ", ""))
    no_port = bytes.fromhex("fc01 0000 0a000002".replace(" ", ""))
    no_station = bytes.fromhex("0001 38d8 0a000002".replace(" ", ""))
    assert unpack_addresses(nothing) == {}
    assert unpack_addresses(newer + no_port + no_station + BYTES + BYTES[:7]) == {252: (WIFI, LTE)}


def test_an_address_that_is_sent_twice_counts_once() -> None:
    assert unpack_addresses(BYTES + BYTES) == {252: (WIFI, LTE)}


def test_no_bytes_raise_and_all_that_come_out_can_be_said() -> None:
    rng = random.Random(43)
    for _ in range(2000):
        for listed in unpack_addresses(rng.randbytes(rng.randrange(0, 260))).values():
            for address in listed:
                why_unusable(address)
                assert address.text.startswith("udpout:")
                assert 1 <= address.port <= 65535

# SPDX-License-Identifier: GPL-3.0-or-later

"""Sample addresses cannot be mistaken for real ones.

Pages and samples of configurations show loopback addresses, or addresses of the ranges that RFC 5737 keeps for
documentation. No computer has one of those, and `handover doctor` reports them. Pages of the bench name addresses that
the bench really gives. The page of networks names the addresses inside a tunnel, and a provider's range.
"""

from __future__ import annotations

import re
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path

import pytest

from mavproxy_handover.config.sample import station_sample, vehicle_sample
from tests.structure.readability import pages

ALLOWED = tuple(map(IPv4Network, ("127.0.0.0/8", "0.0.0.0/32", "192.0.2.0/24", "198.51.100.0/24", "203.0.113.0/24")))
#: pages with the addresses of `handover bench hosts`, which runs them in network namespaces
BENCH = ("bench-of-hosts.md", "encryption.md")
#: pages with addresses that a reader gives to the ends of a tunnel, and the range of translated addresses (RFC 6598)
TUNNEL = {"networks.md": ("10.9.3.", "100.64.0.0")}
#: not part of a longer number such as a version
_ADDRESS = re.compile(r"(?<![\d.])\d{1,3}(?:\.\d{1,3}){3}(?![\d.]*\d)")


def others(text: str) -> list[str]:
    """Addresses in the text that are in none of the allowed ranges."""
    return [each for each in _ADDRESS.findall(text) if not any(IPv4Address(each) in net for net in ALLOWED)]


@pytest.mark.parametrize("page", [path for path in pages() if path.name not in BENCH], ids=lambda path: path.name)
def test_addresses_of_a_page_are_samples(page: Path) -> None:
    found = others(page.read_text(encoding="utf-8"))
    assert [address for address in found if not address.startswith(TUNNEL.get(page.name, ()))] == []


@pytest.mark.parametrize("text", [vehicle_sample(), station_sample()], ids=["vehicle", "station"])
def test_addresses_of_a_sample_are_samples(text: str) -> None:
    assert others(text) == []


def test_other_addresses_are_found() -> None:
    assert others("udpout:10.0.0.2:14552, 192.0.2.2:14550, version 1.8.74") == ["10.0.0.2"]


@pytest.mark.parametrize("name", BENCH)
def test_the_bench_has_its_own(name: str) -> None:
    (page,) = [path for path in pages() if path.name == name]
    assert others(page.read_text(encoding="utf-8"))

# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's address for a station, as a shared mission carries it. Pure: no socket, no name service.

The address comes from another computer, so only UDP to an IPv4 address in digits and a port is allowed. There is no
room for a host name, a file, a device or a listening link. MAVProxy opens these links, and it supports no IPv6. While a
TCP link cannot be connected, MAVProxy waits for it in its main loop and reads no other link, so TCP is not allowed.

On the wire each address is one entry of 8 bytes, in network byte order: station u8, kind u8, port u16, IPv4 address
u32. An entry of zeros is empty. An unknown kind is skipped, because a newer program sent it.
"""

from __future__ import annotations

import ipaddress
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

__all__ = [
    "ALLOWED",
    "ENTRY_BYTES",
    "MAX_ADDRESSES",
    "MAX_OF_STATION",
    "WAITING_LABEL",
    "WAITING_LINK",
    "Addresses",
    "VehicleAddress",
    "on_this_computer",
    "pack_addresses",
    "parse_address",
    "plain_text",
    "unpack_addresses",
    "why_unusable",
]

#: a station's addresses by its system id, in order of preference
Addresses = Mapping[int, "tuple[VehicleAddress, ...]"]

ALLOWED: Final = "udpout:ADDRESS:PORT, ADDRESS an IPv4 address in digits"
#: room in MISSION_PACKAGE
MAX_ADDRESSES: Final = 22
#: paths to one station
MAX_OF_STATION: Final = 4
#: Label of a station's placeholder link while it has none to the vehicle. Nothing arrives at a loopback port that the
#: system chooses. Without any link MAVProxy would open one on every interface of the computer, or a serial port that it
#: finds.
WAITING_LABEL: Final = "no-vehicle-yet"
WAITING_LINK: Final = f'udpin:127.0.0.1:0:{{"label":"{WAITING_LABEL}"}}'
_TEXT: Final = 60
#: `kind` on the wire
_UDP_OUT: Final = 1
_WORD: Final = "udpout"
_ENTRY: Final = struct.Struct("!BBHI")
ENTRY_BYTES: Final = _ENTRY.size
_THIS_NETWORK: Final = ipaddress.IPv4Network("0.0.0.0/8")
_RESERVED: Final = ipaddress.IPv4Network("240.0.0.0/4")


@dataclass(frozen=True, slots=True)
class VehicleAddress:
    """Address at which a station reaches the vehicle by UDP. `host`: an IPv4 address in digits."""

    host: str
    port: int

    @property
    def text(self) -> str:
        """The address in pymavlink's form."""
        return f"{_WORD}:{self.host}:{self.port}"


def parse_address(text: object) -> VehicleAddress:
    """Parse an address in pymavlink's form. Raises ValueError: one line that says what is wrong."""
    kind, _, rest = text.partition(":") if isinstance(text, str) else ("", "", "")
    host, _, port = rest.partition(":")
    if kind != _WORD or not _is_number(port) or not 1 <= int(port) <= 65535:
        raise ValueError(f"not an address of a vehicle (allowed: {ALLOWED}, PORT 1 to 65535)")
    try:
        ipaddress.IPv4Address(host)
    except ValueError:
        raise ValueError(f"{host!r} is not an IPv4 address in digits (allowed: {ALLOWED})") from None
    address = VehicleAddress(host, int(port))
    why = why_unusable(address)
    if why:
        raise ValueError(why)
    return address


def why_unusable(address: VehicleAddress) -> str:
    """Why no vehicle can have this address, as text; "" if one can."""
    host = ipaddress.IPv4Address(address.host)
    if host in _THIS_NETWORK:
        return f"{address.host} names no computer"
    if host.is_multicast:
        return f"{address.host} is a multicast address, and not one vehicle"
    if host in _RESERVED:
        return f"{address.host} is a broadcast or reserved address, and not one vehicle"
    return ""


def on_this_computer(address: VehicleAddress) -> bool:
    """True if the address is a loopback address, which leads to the computer that uses it."""
    return ipaddress.IPv4Address(address.host).is_loopback


def pack_addresses(addresses: Addresses, only: int | None = None) -> bytes:
    """Pack the addresses of all stations or of one. At most MAX_ADDRESSES; the rest is left out."""
    entries = [(station, each) for station, listed in addresses.items() for each in listed if only in (None, station)]
    return b"".join(
        _ENTRY.pack(station, _UDP_OUT, address.port, int(ipaddress.IPv4Address(address.host)))
        for station, address in entries[:MAX_ADDRESSES]
    )


def unpack_addresses(data: Sequence[int] | bytes) -> dict[int, tuple[VehicleAddress, ...]]:
    """Unpack the addresses in a MISSION_PACKAGE, whatever its bytes; without duplicates for a station."""
    raw = bytes(data)
    found: dict[int, tuple[VehicleAddress, ...]] = {}
    for start in range(0, min(len(raw), MAX_ADDRESSES * _ENTRY.size) - _ENTRY.size + 1, _ENTRY.size):
        station, kind, port, host = _ENTRY.unpack_from(raw, start)
        if not station or kind != _UDP_OUT or not port:
            continue
        address = VehicleAddress(str(ipaddress.IPv4Address(host)), port)
        if address not in found.get(station, ()):
            found[station] = (*found.get(station, ()), address)
    return found


def plain_text(text: object) -> str:
    """Printable text of limited length, whatever another program sent."""
    return "".join(letter for letter in str(text)[:_TEXT] if letter.isprintable())


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= 5

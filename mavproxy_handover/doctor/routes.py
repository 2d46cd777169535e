# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the network interface of an address, and its kind, by Linux's rtnetlink.

Both questions need no rights and send nothing to the network (rtnetlink(7): RTM_GETROUTE, RTM_GETLINK). The kind is the
kernel's own word for virtual interfaces, for example "wireguard" or "gre"; a card has none. wireguard-go has a TUN
device, whose kind is "tun". Its socket shows that it is WireGuard, if this process may enter that folder.
"""

from __future__ import annotations

import ipaddress
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["Interface", "interface_named", "interface_of", "interface_to"]

_WIREGUARD_SOCKETS: Final = (Path("/run/wireguard"), Path("/var/run/wireguard"))
#: linux/rtnetlink.h, linux/netlink.h, linux/if_link.h
_GET_LINK, _GET_ROUTE, _REQUEST = 18, 26, 1
_NEW_LINK, _NEW_ROUTE = 16, 24
_DESTINATION, _SOURCE, _OUT_INTERFACE = 1, 2, 4
_LINK_NAME, _LINK_INFO, _INFO_KIND = 3, 18, 1
_TYPE_BITS: Final = 0x3FFF
_HEADER: Final = struct.Struct("=IHHII")
_ROUTE: Final = struct.Struct("=BBBBBBBBI")
_LINK: Final = struct.Struct("=BxHiII")
_ATTRIBUTE: Final = struct.Struct("=HH")
_ANSWER_BYTES: Final = 65536
_LIMIT_S: Final = 1.0
#: ioctl of an interface's IPv4 address (netdevice(7)), and the offset of the address in its answer
_SIOCGIFADDR: Final = 0x8915
_REQUEST_BYTES, _ADDRESS_AT = 40, 20


@dataclass(frozen=True, slots=True)
class Interface:
    """A network interface. `kind`: the kernel's word for a virtual one, "" for a card."""

    name: str
    kind: str


def interface_to(address: str, way: str = "") -> Interface | None:
    """The interface to an address. `way`: the prescribed interface, or own IPv4 address.

    Returns None if there is no route, no such interface, or the system does not tell.
    """
    source = b""
    if way:
        try:
            source = ipaddress.IPv4Address(way).packed
        except ValueError:
            return interface_named(way)
    target = ipaddress.ip_address(address.partition("%")[0]).packed
    family = socket.AF_INET if len(target) == 4 else socket.AF_INET6
    head = _ROUTE.pack(family, 8 * len(target), 8 * len(source), 0, 0, 0, 0, 0, 0)
    wanted = _attribute(_DESTINATION, target) + (_attribute(_SOURCE, source) if source else b"")
    answer = _asked(_GET_ROUTE, head + wanted, _NEW_ROUTE)
    if answer is None:
        return None
    number = dict(_attributes(answer[_ROUTE.size :])).get(_OUT_INTERFACE, b"")
    return _of_number(struct.unpack("=i", number)[0]) if len(number) == 4 else None


def interface_named(name: str) -> Interface | None:
    """The interface of that name; None: there is none, or the system does not tell."""
    try:
        return _of_number(socket.if_nametoindex(name))
    except OSError:
        return None


def interface_of(address: str) -> Interface | None:
    """The interface whose own IPv4 address that is; None: there is none, or the system does not tell."""
    try:
        import fcntl
    except ImportError:  # another system
        return None
    for _number, name in socket.if_nameindex():
        request = name.encode().ljust(_REQUEST_BYTES, b"\0")
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            told = fcntl.ioctl(end.fileno(), _SIOCGIFADDR, request)
            if socket.inet_ntoa(told[_ADDRESS_AT : _ADDRESS_AT + 4]) == address:
                return interface_named(name)
    return None


def _of_number(number: int) -> Interface | None:
    answer = _asked(_GET_LINK, _LINK.pack(socket.AF_UNSPEC, 0, number, 0, 0), _NEW_LINK)
    if answer is None:
        return None
    told = dict(_attributes(answer[_LINK.size :]))
    name = told.get(_LINK_NAME, b"").rstrip(b"\0").decode("ascii", "replace")
    kind = dict(_attributes(told.get(_LINK_INFO, b""))).get(_INFO_KIND, b"").rstrip(b"\0").decode("ascii", "replace")
    if kind == "tun" and any(os.path.exists(folder / f"{name}.sock") for folder in _WIREGUARD_SOCKETS):
        kind = "wireguard"
    return Interface(name, kind)


def _attribute(number: int, value: bytes) -> bytes:
    """One attribute, padded to a multiple of 4 bytes."""
    return (_ATTRIBUTE.pack(_ATTRIBUTE.size + len(value), number) + value).ljust(
        (_ATTRIBUTE.size + len(value) + 3) & ~3, b"\0"
    )


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Number and value of each attribute; ends at an incomplete one."""
    at = 0
    while at + _ATTRIBUTE.size <= len(data):
        size, number = _ATTRIBUTE.unpack_from(data, at)
        if size < _ATTRIBUTE.size or at + size > len(data):
            return
        yield number & _TYPE_BITS, data[at + _ATTRIBUTE.size : at + size]
        at += (size + 3) & ~3


def _asked(question: int, body: bytes, answer: int) -> bytes | None:
    """The kernel's answer without its header; None for an error, or an answer of another kind."""
    with suppress(OSError, AttributeError, struct.error):  # AttributeError: another system
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
            kernel.settimeout(_LIMIT_S)
            kernel.send(_HEADER.pack(_HEADER.size + len(body), question, _REQUEST, 1, 0) + body)
            data = kernel.recv(_ANSWER_BYTES)
        size, kind, *_rest = _HEADER.unpack_from(data)
        if kind == answer:
            return data[_HEADER.size : size]
    return None

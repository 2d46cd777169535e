# SPDX-License-Identifier: GPL-3.0-or-later

"""Parses device strings of links, in pymavlink's forms. It touches no device.

    udpin:HOST:PORT          listen on a local address; answer the sender that proved to be the station
    udpout:HOST:PORT[@WAY]   send to a station that listens; WAY: outgoing interface, or own address
    tcp:HOST:PORT            connect to a station that listens
    tcpin:HOST:PORT          listen for the station's connection
    /dev/ttyX[,BAUD]         serial line
    serial:/dev/ttyX:BAUD    serial line, too

HOST is a name, an IPv4 address or an IPv6 address in brackets: `udpin:[::]:14550`, `udpout:[fe80::1%wlan0]:14550`. WAY
is an interface or an IPv4 address: `udpout:198.51.100.9:14550@wwan0`. Without BAUD a serial line runs at 57600, as in
MAVProxy.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

__all__ = ["DEFAULT_BAUD", "FORMS", "DeviceSpec", "Kind", "LinkError", "parse_device"]

DEFAULT_BAUD: Final = 57600
BAUD_RANGE: Final = (1200, 4_000_000)
#: name of an interface in Linux, or an address
_WAY: Final = re.compile(r"[A-Za-z0-9._-]{1,15}")


class LinkError(Exception):
    """A link cannot be opened, for a reason on this machine. The message is one line for people."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


class Kind(Enum):
    """The kinds of link, by the first word of a device string."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    TCP_OUT = "tcp"
    TCP_IN = "tcpin"
    SERIAL = "serial"


#: The device strings of each kind. `link/devices.py` has the class of each.
FORMS: Final[Mapping[Kind, str]] = {
    Kind.UDP_IN: "udpin:HOST:PORT",
    Kind.UDP_OUT: "udpout:HOST:PORT[@WAY]",
    Kind.TCP_OUT: "tcp:HOST:PORT",
    Kind.TCP_IN: "tcpin:HOST:PORT",
    Kind.SERIAL: "/dev/ttyX[,BAUD], serial:/dev/ttyX:BAUD",
}
_FORMS: Final = f"{', '.join(FORMS.values())}; an IPv6 address as HOST stands in brackets"


@dataclass(frozen=True, slots=True)
class DeviceSpec:
    """A parsed device string.

    `text` is the string. `host` and `port` are path and baud rate of a serial line; an IPv6 address has no brackets.
    `way`: interface or own address by which a `udpout` leaves; "" if the system chooses.
    """

    text: str
    kind: Kind
    host: str
    port: int
    way: str = ""


def parse_device(text: object) -> DeviceSpec:
    """Parse a device string. Raises LinkError with one line that says what is allowed."""
    if not isinstance(text, str) or not text.isprintable():
        raise LinkError(f"link {text!r} must be one of {_FORMS}")
    if text.startswith("/dev/"):
        path, _, baud = text.partition(",")
        return _serial(text, path, baud if "," in text else str(DEFAULT_BAUD))
    word, _, rest = text.partition(":")
    if word == Kind.SERIAL.value:
        # paths such as /dev/serial/by-path/... contain colons
        path, _, baud = rest.rpartition(":")
        return _serial(text, path, baud)
    host, colon, port = _split(rest)
    port, at, way = port.partition("@")
    kinds = {kind.value: kind for kind in Kind}
    wrong_way = at and (word != Kind.UDP_OUT.value or not _WAY.fullmatch(way))
    if word not in kinds or not host or not colon or ":" in port or wrong_way:
        raise LinkError(f"link {text!r} must be one of {_FORMS}")
    number = _number(port)
    if not 1 <= number <= 65535:
        raise LinkError(f"link {text!r}: port must be 1 to 65535")
    return DeviceSpec(text, kinds[word], host, number, way)


def _split(rest: str) -> tuple[str, str, str]:
    """Host, colon and what follows it. The host is empty if brackets hold no IPv6 address."""
    if not rest.startswith("["):
        return rest.partition(":")
    inside, _bracket, after = rest[1:].partition("]")
    try:
        ipaddress.IPv6Address(inside)
    except ValueError:
        return "", "", ""
    return (inside, ":", after[1:]) if after.startswith(":") else ("", "", "")


def _serial(text: str, path: str, baud: str) -> DeviceSpec:
    low, high = BAUD_RANGE
    number = _number(baud)
    if not path.startswith("/"):
        raise LinkError(f"link {text!r} must be one of {_FORMS}")
    if not low <= number <= high:
        raise LinkError(f"link {text!r}: baud rate must be {low} to {high}")
    return DeviceSpec(text, Kind.SERIAL, path, number)


def _number(text: str) -> int:
    """A plain decimal number, else -1."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 8 else -1

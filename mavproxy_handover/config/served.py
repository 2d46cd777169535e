# SPDX-License-Identifier: GPL-3.0-or-later

"""The link to a program that flies through a station: which ones are allowed."""

from __future__ import annotations

import ipaddress
from typing import Final

from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError, parse_device

__all__ = ["parse_served"]

#: programs write `udp:HOST:PORT` for a port that they listen at
_UDP: Final = "udp:"
_FORMS: Final = "allowed: udp:127.0.0.1:14550, udpin:127.0.0.1:14551, tcpin:127.0.0.1:5770"


def parse_served(text: str) -> DeviceSpec:
    """The link to a program. Raises LinkError with one line: an unknown form, or another computer."""
    device = parse_device(f"udpout:{text.removeprefix(_UDP)}" if text.startswith(_UDP) else text)
    if device.kind is Kind.SERIAL:
        raise LinkError(f"link {text}: a program is served by network ({_FORMS})")
    if not _is_local(device.host):
        raise LinkError(
            f"link {text}: {device.host} is not this computer. Programs are served without a key, so only on this "
            "computer ({_FORMS})"
        )
    return device


def _is_local(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False

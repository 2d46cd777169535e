# SPDX-License-Identifier: GPL-3.0-or-later

"""Opens the device for a device string. The forms are in `forms`, the rules of all devices in `base`.

A new kind of link is a `Kind` with its form in `FORMS`, a class, and a row in `OPENS`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Final

from mavproxy_handover.link.base import Clock, Device, LinkCounters
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError, parse_device
from mavproxy_handover.link.names import Names, is_number
from mavproxy_handover.link.reopening import ReopeningLink
from mavproxy_handover.link.tcp import TcpIn, TcpOut
from mavproxy_handover.link.udp import UdpIn, UdpOut, UdpOutBy

__all__ = [
    "Device",
    "DeviceSpec",
    "Kind",
    "LinkCounters",
    "LinkError",
    "OPENS",
    "open_device",
    "open_link",
    "parse_device",
]


def open_device(text: str, clock: Clock = time.monotonic) -> Device:
    """Open the link that `text` names. `clock` gives monotonic seconds. A host name is looked up before this returns.

    Raises LinkError with one line: an unknown form, a port in use, an unknown host, no right to a serial line.
    """
    return _made(parse_device(text), clock)


def open_link(text: str, names: Names, clock: Clock = time.monotonic, *, strict: bool = True) -> Device:
    """Open a link of the companion. `names` knows the addresses of hosts, and finds them in flight.

    `strict` False: a link that cannot be opened now is closed and tried again. Raises LinkError: with `strict` as
    `open_device` does, otherwise only for an unknown form.
    """
    spec = parse_device(text)
    named = spec.kind is not Kind.SERIAL and not is_number(spec.host)
    if named and strict:
        names.find(spec)
    if spec.kind is Kind.TCP_OUT:  # it reconnects by itself
        return TcpOut(spec, clock, names)
    if named or not strict:
        return ReopeningLink(spec, _made, names, clock, strict=strict)
    return _made(spec, clock)


def _made(spec: DeviceSpec, clock: Clock) -> Device:
    return OPENS[spec.kind](spec, clock)


def _udp_out(spec: DeviceSpec, clock: Clock) -> Device:
    return UdpOutBy(spec, clock) if spec.way else UdpOut(spec, clock)


def _serial_line(spec: DeviceSpec, clock: Clock) -> Device:
    from mavproxy_handover.link.serial_line import SerialLine  # imported only if there is a serial link

    return SerialLine(spec, clock)


#: What opens a link of each kind.
OPENS: Final[Mapping[Kind, Callable[[DeviceSpec, Clock], Device]]] = {
    Kind.UDP_IN: UdpIn,
    Kind.UDP_OUT: _udp_out,
    Kind.TCP_OUT: TcpOut,
    Kind.TCP_IN: TcpIn,
    Kind.SERIAL: _serial_line,
}

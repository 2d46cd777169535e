# SPDX-License-Identifier: GPL-3.0-or-later

"""The device that a device string names. The forms are in `forms`, the rules of all devices in `base`."""

from __future__ import annotations

import time

from mavproxy_handover.link.base import Clock, Device, LinkCounters
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError, parse_device
from mavproxy_handover.link.tcp import TcpIn, TcpOut
from mavproxy_handover.link.udp import UdpIn, UdpOut, UdpOutBy

__all__ = ["Device", "DeviceSpec", "Kind", "LinkCounters", "LinkError", "open_device", "parse_device"]


def open_device(text: str, clock: Clock = time.monotonic) -> Device:
    """Open the link that `text` names. `clock` gives monotonic seconds.

    Raises LinkError, one line: a form that is not known, a port in use, an unknown host, no right to a serial line.
    """
    spec = parse_device(text)
    if spec.kind is Kind.UDP_IN:
        return UdpIn(spec, clock)
    if spec.kind is Kind.UDP_OUT:
        return UdpOutBy(spec, clock) if spec.way else UdpOut(spec, clock)
    if spec.kind is Kind.TCP_OUT:
        return TcpOut(spec, clock)
    if spec.kind is Kind.TCP_IN:
        return TcpIn(spec, clock)
    from mavproxy_handover.link.serial_line import SerialLine  # not for those who have no serial link

    return SerialLine(spec, clock)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the local ends of links: is the port free, does the interface of the link exist?

A port is looked up in the kernel's tables and not opened. Opening would take it from a companion that starts at
the same time. If the system has no such tables, the port is opened for a moment.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, warning
from mavproxy_handover.doctor.processes import Process, command_line, listens, port_holder, users_of
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError, parse_device
from mavproxy_handover.link.names import endpoint, hear_both_kinds

__all__ = ["held_by_ours", "ports"]

_STATION: Final = "handover_gcs"
_LISTENING: Final = (Kind.UDP_IN, Kind.TCP_IN)
_UNPRIVILEGED: Final = Path("/proc/sys/net/ipv4/ip_unprivileged_port_start")


def ports(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    for owner, text in _links(context):
        try:
            spec = parse_device(text)
        except LinkError as fault:  # of an option: a configuration's links are checked when it is read
            yield error(f"link of {owner}", str(fault), "Name a link in one of these forms.")
            continue
        if spec.kind in _LISTENING:
            yield _port(context, owner, spec)
        elif spec.kind is not Kind.SERIAL:
            yield from _way_out(owner, spec)


def _links(context: CheckContext) -> Iterator[tuple[str, str]]:
    """Owner and device string of each link."""
    if context.vehicle is not None:
        for station in context.vehicle.stations:
            for link in station.links:
                yield station.station.name, link
        if context.master is not None:
            yield "the autopilot", context.master
    elif context.station is not None:
        for vehicle in context.station.vehicles:
            for link in vehicle.links or ([context.master] if context.master else []):
                yield vehicle.called, link
        if context.station.ground is not None:
            yield "the ground link", context.station.ground
        for peer in context.station.peers:
            yield peer.station.name, peer.link


def _port(context: CheckContext, owner: str, spec: DeviceSpec) -> Finding:
    what = f"link of {owner}"
    # the kernel's tables are read only for IPv4; an IPv6 port is opened
    in_use = None if ":" in spec.host else listens(spec.kind is Kind.UDP_IN, spec.host, spec.port)
    if in_use:
        return _held(context, what, spec)
    if in_use is False and _reserved(spec.port):
        return error(what, f"{spec.text}: not allowed", "Take a port above 1023.")
    try:
        _bind(spec if in_use is None else replace(spec, port=0))  # 0: any free port, to test the address
    except (OSError, LinkError) as fault:
        number = getattr(fault, "errno", None)
        if number == errno.EADDRINUSE:
            return _held(context, what, spec)
        if number == errno.EADDRNOTAVAIL or isinstance(fault, LinkError):
            do = "Give an address of this machine, or 0.0.0.0 for all of them, or start its network."
            return error(what, f"{spec.text}: {spec.host} is no address of this machine now", do)
        if number == errno.EACCES:
            return error(what, f"{spec.text}: not allowed", "Take a port above 1023.")
        return error(what, f"{spec.text}: {getattr(fault, 'strerror', fault)}", "Give another address or port.")
    return ok(what, f"{spec.text} is free")


def _reserved(port: int) -> bool:
    """True if only root may listen on that port, and this is another user."""
    try:
        first = int(_UNPRIVILEGED.read_text(encoding="ascii"))
    except (OSError, ValueError):
        first = 1024
    return port < first and os.geteuid() != 0


def _bind(spec: DeviceSpec) -> None:
    udp = spec.kind is Kind.UDP_IN
    family, address = endpoint(spec)
    with socket.socket(family, socket.SOCK_DGRAM if udp else socket.SOCK_STREAM) as end:
        hear_both_kinds(end)
        if not udp:  # a connection that has just been closed does not block it
            end.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        end.bind(address)


def _held(context: CheckContext, what: str, spec: DeviceSpec) -> Finding:
    context.find_companion()  # it may have been restarted meanwhile
    holder = port_holder(spec.kind is Kind.UDP_IN, spec.port)
    if _ours(context, holder):
        return ok(what, f"{spec.text} is held by the {context.kind} that runs")
    stop = f"Stop process {holder.pid}" if holder.pid else f"Find it (sudo ss -lunpt sport = {spec.port}) and stop it"
    return error(what, f"{spec.text} is in use by {holder}", f"{stop}, or give the link another port.")


def held_by_ours(context: CheckContext, spec: DeviceSpec) -> bool:
    """True if the companion or station that runs here uses that port or line."""
    if spec.kind is Kind.SERIAL:
        return any(_ours(context, each) for each in users_of(context.at(Path(spec.host))))
    return spec.kind in _LISTENING and _ours(context, port_holder(spec.kind is Kind.UDP_IN, spec.port))


def _ours(context: CheckContext, holder: Process) -> bool:
    if context.kind == "station":  # it has no lock: it is recognised by the module that it loads
        return _STATION in command_line(holder.pid)
    return context.running is not None and holder.pid in (0, context.running.pid)


def _way_out(owner: str, spec: DeviceSpec) -> Iterator[Finding]:
    what = f"link of {owner}"
    try:
        endpoint(spec)
    except LinkError:
        do = "Give its address by number, or see to the name service: a start on the ground needs it."
        yield error(what, f"{spec.text}: {spec.host} is not a known host", do)
        return
    if spec.way and spec.way not in (name for _number, name in socket.if_nameindex()) and not _own(spec.way):
        found = f"{spec.text}: there is no interface or address {spec.way} now: nothing is sent by it"
        yield warning(what, found, f"Bring {spec.way} up, or take @{spec.way} away.")


def _own(address: str) -> bool:
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            end.bind((address, 0))
    except (OSError, UnicodeError):
        return False
    return True

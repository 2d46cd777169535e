# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks whether each link goes through a tunnel, by its route, and explains tunnel and signature.

A tunnel prevents others on the path from reading. A MAVLink signature prevents them from speaking as a station. One
does not replace the other (docs/encryption.md). IPsec without an interface of its own does not show in a route, so it
is not found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, ok, warning
from mavproxy_handover.doctor.routes import Interface, interface_of, interface_to
from mavproxy_handover.link.forms import Kind, LinkError, parse_device
from mavproxy_handover.link.names import endpoint

__all__ = ["tunnels"]

#: the kind of interface that always encrypts
_WIREGUARD: Final = "wireguard"
#: a policy decides whether these encrypt, or only authenticate
_IPSEC: Final = ("xfrm", "vti", "vti6")
#: interfaces whose other end is a program
_OF_A_PROGRAM: Final = ("tun", "tap")
#: tunnels without encryption
_PLAIN: Final = ("ipip", "gre", "gretap", "ip6gre", "ip6gretap", "sit", "ip6tnl", "vxlan", "geneve", "erspan", "fou")
_ANY_ADDRESS: Final = ("0.0.0.0", "::")
#: a packet with a forged sender from this machine's own network gets past a tunnel
_UNSIGNED_INSIDE: Final = "any program inside the tunnel, and a neighbour that forges its address, can"
_DO: Final = (
    "Make a key ('handover keys make') and name it at both ends; to keep others from reading, lead the link through a "
    "tunnel (docs/encryption.md)."
)


@dataclass(frozen=True, slots=True)
class _Way:
    """The path of a link, as text: `says`. `read`: True if others on the path can read it; None: not known.

    `signed`, `unsigned`: consequence of a signature and of its absence, up to "speak as NAME".
    """

    says: str
    read: bool | None
    signed: str = "others cannot"
    unsigned: str = "others can"


def _open(says: str) -> _Way:
    """A link that others can read."""
    return _Way(says, True, "they cannot", "they can")


def tunnels(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    for name, text, signed in _links(context):
        try:
            way = _way(text)
        except LinkError:  # reported with the ports
            continue
        yield _finding(name, text, way, signed)


def _links(context: CheckContext) -> Iterator[tuple[str, str, bool]]:
    """Name of the other end, device string, and whether the frames are signed."""
    if context.vehicle is not None:
        for station in context.vehicle.stations:
            for link in station.links:
                yield station.station.name, link, station.key is not None
    elif context.station is not None:
        for vehicle in context.station.vehicles:
            for link in vehicle.links or ([context.master] if context.master else []):
                yield vehicle.called, link, vehicle.key is not None
        for peer in context.station.peers:
            yield peer.station.name, peer.link, context.station.ground_key is not None


def _way(text: str) -> _Way:
    """Raises LinkError: no link, or a host without an address."""
    spec = parse_device(text)
    if spec.kind is Kind.SERIAL:
        return _open("not inside a tunnel (a serial line): others who receive it can read it")
    if spec.kind in (Kind.UDP_IN, Kind.TCP_IN) and spec.host in _ANY_ADDRESS:
        why = "it waits to be called, on any address of this machine"
        return _Way(f"whether it is inside a tunnel is not known: {why}", None)
    _family, address = endpoint(spec)
    if spec.kind in (Kind.UDP_IN, Kind.TCP_IN):
        return _own(str(address[0]))
    interface = interface_to(str(address[0]), spec.way)
    if interface is None:
        lacks = f"there is no interface {spec.way}" if spec.way else f"there is no route to {address[0]}"
        return _Way(f"whether it is inside a tunnel is not known: {lacks} now", None)
    return _by(interface)


def _own(address: str) -> _Way:
    """A link that listens on one of this machine's addresses: the interface of the address counts."""
    interface = interface_of(address)
    if interface is None:
        why = f"it waits to be called on {address}, whose interface is not known"
        return _Way(f"whether it is inside a tunnel is not known: {why}", None)
    if interface.kind == _WIREGUARD:  # Linux accepts packets to this address from any interface, and answers there
        says = (
            f"waits at an address of WireGuard ({interface.name}): others before the end of the tunnel cannot read "
            f"its packets; only a firewall blocks packets from outside"
        )
        return _Way(says, None, unsigned=_UNSIGNED_INSIDE)
    return _by(interface)


def _by(interface: Interface) -> _Way:
    name, kind = interface.name, interface.kind
    if name == "lo":
        return _Way("stays on this machine", False, "no other program here can", "any program here can")
    if kind == _WIREGUARD:  # the end of the tunnel may be a gateway, with an open path after it
        says = f"inside WireGuard ({name}): others on the way to the end of the tunnel cannot read it"
        return _Way(says, False, "no other program inside the tunnel can", _UNSIGNED_INSIDE)
    if kind in _IPSEC:
        return _Way(f"inside IPsec ({name}): whether it encrypts is not known here", None)
    if kind in _OF_A_PROGRAM:
        return _Way(f"inside a tunnel of a program ({name}): whether it encrypts is not known here", None)
    if kind in _PLAIN:
        return _open(f"inside a tunnel that does not encrypt ({name}, {kind}): others on the way can read it")
    if kind == "ppp":
        return _Way(
            f"leaves by a PPP line ({name}): whether that is a modem's call or a tunnel is not known here", None
        )
    return _open(f"not inside a tunnel (leaves by {name}): others on the way can read it")


def _finding(name: str, text: str, way: _Way, signed: bool) -> Finding:
    what = f"{name}, {text}"
    if signed:
        return ok(what, f"{way.says}; signed with the key of {name}: {way.signed} speak as {name}")
    found = f"{way.says}; not signed: {way.unsigned} speak as {name}"
    return warning(what, found, _DO) if way.read else ok(what, found)

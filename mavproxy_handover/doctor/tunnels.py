# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether each link goes inside a tunnel, by the route to its other end, and what that and its signature mean.

A tunnel keeps others on the way from reading. A MAVLink signature keeps them from speaking as a station. One does not
replace the other (docs/encryption.md). IPsec without an interface of its own does not show in a route: it is not seen
here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.doctor.check_context import Patient
from mavproxy_handover.doctor.finding import Finding, ok, warning
from mavproxy_handover.doctor.routes import Interface, interface_of, interface_to
from mavproxy_handover.link.forms import Kind, LinkError, parse_device
from mavproxy_handover.link.names import endpoint

__all__ = ["tunnels"]

#: the kind of interface that always encrypts
_WIREGUARD: Final = "wireguard"
#: a policy says whether these encrypt, or only authenticate
_IPSEC: Final = ("xfrm", "vti", "vti6")
#: a program is at the other end of these
_OF_A_PROGRAM: Final = ("tun", "tap")
#: tunnels that pack and do not encrypt
_PLAIN: Final = ("ipip", "gre", "gretap", "ip6gre", "ip6gretap", "sit", "ip6tnl", "vxlan", "geneve", "erspan", "fou")
_ANY_ADDRESS: Final = ("0.0.0.0", "::")
#: a packet with a forged sender gets past a tunnel from the network that this machine is in
_UNSIGNED_INSIDE: Final = "any program inside the tunnel, and a neighbour that forges its address, can"
_DO: Final = (
    "Make a key ('handover keys make') and name it at both ends; to keep others from reading, lead the link through a "
    "tunnel (docs/encryption.md)."
)


@dataclass(frozen=True, slots=True)
class _Way:
    """How a link goes, in words: `says`. `read`: whether others on the way can read it; None: not known.

    `signed`, `unsigned`: what follows from a signature and from its absence, up to "speak as NAME".
    """

    says: str
    read: bool | None
    signed: str = "others cannot"
    unsigned: str = "others can"


def _open(says: str) -> _Way:
    """A link that others can read."""
    return _Way(says, True, "they cannot", "they can")


def tunnels(patient: Patient) -> Iterator[Finding]:
    """The findings of this check."""
    for name, text, signed in _links(patient):
        try:
            way = _way(text)
        except LinkError:  # told with the ports
            continue
        yield _finding(name, text, way, signed)


def _links(patient: Patient) -> Iterator[tuple[str, str, bool]]:
    """Who is at the other end, the link, and whether its frames are signed."""
    if patient.vehicle is not None:
        for station in patient.vehicle.stations:
            for link in station.links:
                yield station.station.name, link, station.key is not None
    elif patient.station is not None:
        for vehicle in patient.station.vehicles:
            for link in vehicle.links or ([patient.master] if patient.master else []):
                yield vehicle.called, link, vehicle.key is not None
        for peer in patient.station.peers:
            yield peer.station.name, peer.link, patient.station.ground_key is not None


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
    """A link that waits to be called on one of this machine's addresses: the interface that has the address counts."""
    interface = interface_of(address)
    if interface is None:
        why = f"it waits to be called on {address}, whose interface is not known"
        return _Way(f"whether it is inside a tunnel is not known: {why}", None)
    if interface.kind == _WIREGUARD:  # Linux takes what is sent to this address by any interface, and answers there
        says = (
            f"waits at an address of WireGuard ({interface.name}): others on the way to the end of the tunnel cannot "
            f"read what comes through it, and only a firewall keeps out what comes past it"
        )
        return _Way(says, None, unsigned=_UNSIGNED_INSIDE)
    return _by(interface)


def _by(interface: Interface) -> _Way:
    name, kind = interface.name, interface.kind
    if name == "lo":
        return _Way("stays on this machine", False, "no other program here can", "any program here can")
    if kind == _WIREGUARD:  # its end may be a gateway, with more way after it
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

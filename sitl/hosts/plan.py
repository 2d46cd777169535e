# SPDX-License-Identifier: GPL-3.0-or-later

"""The hosts of the bench: addresses, interfaces, routes, and the commands that make them. Data, no system is touched.

The addresses are those of the thesis (listings 5.1 and 5.3): mission computer 192.168.11.100, stations 192.168.10.100
and 192.168.10.128, gateway 192.168.11.1 and 192.168.10.1. A station's host has the route of listing 5.3,
`192.168.11.0/24 via 192.168.10.1 dev eno1`, the mission computer the one that the listing has in its comment.

    mc --eth0-- gateway --switch-- stations (eno1)          path "wired"
    mc --wwan0-- lte -- stations (wwan0)                    path "lte"

With a tunnel there is one WireGuard interface for each path, at both ends. Each path stays a link that the companion
measures and chooses. One tunnel over both paths would choose by itself, late, and hide the other path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

__all__ = [
    "GATEWAY",
    "GROUND_PORT",
    "LINK_INTERFACES",
    "LTE",
    "MISSION_COMPUTER",
    "PATHS",
    "PORT",
    "Host",
    "Interface",
    "Plan",
    "Route",
    "TunnelEnd",
    "plan",
]

MISSION_COMPUTER: Final = "mc"
GATEWAY: Final = "gateway"
LTE: Final = "lte"
#: path -> the namespace that forwards its packets
PATHS: Final = {"wired": GATEWAY, "lte": LTE}
#: where a station listens for the vehicle, on each of its addresses, as in listing 5.1
PORT: Final = 14550
#: where it listens for the other stations
GROUND_PORT: Final = 15550
#: UDP ports of the tunnels
TUNNEL_PORTS: Final = {"wired": 51820, "lte": 51821}
#: 1420 fits in 1500 with IPv4 and IPv6; a modem's network may have less
TUNNEL_MTU: Final = {"wired": 1420, "lte": 1340}
KEEPALIVE_S: Final = 25

_AIR, _GROUND = "192.168.11", "192.168.10"
#: of the stations, in their order; the first two are the thesis's
_LAST: Final = (100, 128, 130, 131, 132, 133, 134, 135)
#: path -> interface of the mission computer, and of a station's computer
_AIR_INTERFACE: Final = {"wired": "eth0", "lte": "wwan0"}
_GROUND_INTERFACE: Final = {"wired": "eno1", "lte": "wwan0"}
#: path -> the interfaces by which the companion's links leave, without and with a tunnel
LINK_INTERFACES: Final = {path: (name, f"wg-{path}") for path, name in _AIR_INTERFACE.items()}
#: path -> the network inside its tunnels
_TUNNEL: Final = {"wired": "10.9.1", "lte": "10.9.2"}
_OPERATOR: Final = "100.64"


@dataclass(frozen=True, slots=True)
class Interface:
    """One network interface of a host; `peer` is the host at the other end of the cable, `peer_name` its interface.

    `address` has its prefix length; "" for a port of the switch.
    """

    name: str
    address: str
    peer: str = ""
    peer_name: str = ""


@dataclass(frozen=True, slots=True)
class Route:
    """One entry of a routing table."""

    to: str
    via: str
    interface: str

    def __str__(self) -> str:
        return f"{self.to} via {self.via} dev {self.interface}"


@dataclass(frozen=True, slots=True)
class Host:
    """One computer. `switch`: name of the bridge that joins its `ports`; `forwards`: it is a router."""

    name: str
    says: str
    interfaces: tuple[Interface, ...]
    routes: tuple[Route, ...] = ()
    switch: str = ""
    ports: tuple[str, ...] = ()
    forwards: bool = False

    def address(self, interface: str) -> str:
        """The address of an interface, without its prefix length. Raises KeyError."""
        found = {each.name: each.address for each in self.interfaces}[interface]
        return found.partition("/")[0]


@dataclass(frozen=True, slots=True)
class TunnelEnd:
    """A WireGuard interface. `peers`: host, its address inside the tunnel, and the address and port that this end
    calls; "" if it waits to be called."""

    host: str
    path: str
    interface: str
    address: str
    port: int
    mtu: int
    peers: tuple[tuple[str, str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """All hosts of a run."""

    stations: tuple[str, ...]
    hosts: tuple[Host, ...]
    tunnels: tuple[TunnelEnd, ...]
    #: stations whose links are inside the tunnel
    tunnelled: tuple[str, ...]

    def host(self, name: str) -> Host:
        """The host of that name. Raises KeyError."""
        return {each.name: each for each in self.hosts}[name]

    def host_of(self, station: str) -> str:
        """Name of a station's host."""
        return station.lower()

    def reach(self, station: str, path: str, *, inside: bool | None = None) -> tuple[str, str]:
        """Address of a station by a path, and the mission computer's interface for it. `inside`: through the tunnel;
        None: as the station's links are laid."""
        if inside is None:
            inside = station in self.tunnelled
        host = self.host_of(station)
        if inside:
            end = next(each for each in self.tunnels if (each.host, each.path) == (host, path))
            own = next(each for each in self.tunnels if (each.host, each.path) == (MISSION_COMPUTER, path))
            return end.address.partition("/")[0], own.interface
        return self.host(host).address(_GROUND_INTERFACE[path]), _AIR_INTERFACE[path]

    def commands(self) -> list[list[str]]:
        """The `ip` commands that make hosts, cables, addresses and routes, in order; without tunnels."""
        made = [["netns", "add", host.name] for host in self.hosts]
        for host in self.hosts:
            made.append(["-n", host.name, "link", "set", "lo", "up"])
            if host.switch:
                made.append(["-n", host.name, "link", "add", host.switch, "type", "bridge"])
        for host in self.hosts:
            for each in host.interfaces:
                if each.peer:
                    ends = ["peer", "name", each.peer_name, "netns", each.peer]
                    made.append(["link", "add", each.name, "netns", host.name, "type", "veth", *ends])
        for host in self.hosts:
            at = ["-n", host.name]
            made += [[*at, "link", "set", port, "master", host.switch, "up"] for port in host.ports]
            for each in host.interfaces:
                if each.address:
                    made.append([*at, "addr", "add", each.address, "dev", each.name])
                made.append([*at, "link", "set", each.name, "up"])
        for host in self.hosts:
            made += [["-n", host.name, "route", "add", *str(route).split()] for route in host.routes]
        return made


def plan(stations: Sequence[str], tunnelled: Sequence[str] = ()) -> Plan:
    """The hosts for these stations, `tunnelled` of them with a tunnel to the aircraft. Raises ValueError."""
    if not 1 <= len(stations) <= len(_LAST):
        raise ValueError(f"{len(stations)} stations: the bench has addresses for 1 to {len(_LAST)}")
    names = [station.lower() for station in stations]
    taken = {MISSION_COMPUTER, GATEWAY, LTE}
    for name in names:
        if name in taken or not name.replace("-", "").replace("_", "").isalnum():
            raise ValueError(f"station {name!r}: its name cannot be that of a host of the bench")
        taken.add(name)
    for station in tunnelled:
        if station not in stations:
            raise ValueError(f"--tunnel {station}: no station of this mission: {', '.join(stations)}")
    mission_computer = Host(
        MISSION_COMPUTER,
        "mission computer",
        (
            Interface("eth0", f"{_AIR}.100/24", GATEWAY, "air"),
            Interface("wwan0", f"{_OPERATOR}.0.2/30", LTE, MISSION_COMPUTER),
        ),
        (
            Route(f"{_GROUND}.0/24", f"{_AIR}.1", "eth0"),
            Route(f"{_OPERATOR}.0.0/16", f"{_OPERATOR}.0.1", "wwan0"),
        ),
    )
    ground = tuple(
        Host(
            name,
            f"computer of {station}",
            (
                Interface("eno1", f"{_GROUND}.{_LAST[number]}/24", GATEWAY, f"port{number + 1}"),
                Interface("wwan0", f"{_OPERATOR}.{number + 1}.2/30", LTE, name[:15]),
            ),
            (
                Route(f"{_AIR}.0/24", f"{_GROUND}.1", "eno1"),
                Route(f"{_OPERATOR}.0.0/16", f"{_OPERATOR}.{number + 1}.1", "wwan0"),
            ),
        )
        for number, (station, name) in enumerate(zip(stations, names, strict=True))
    )
    gateway = Host(
        GATEWAY,
        "gateway and switch",
        (Interface("air", f"{_AIR}.1/24"), Interface("ground", f"{_GROUND}.1/24")),
        switch="ground",
        ports=tuple(f"port{number + 1}" for number in range(len(names))),
        forwards=True,
    )
    lte = Host(
        LTE,
        "LTE network",
        (
            Interface(MISSION_COMPUTER, f"{_OPERATOR}.0.1/30"),
            *(Interface(name[:15], f"{_OPERATOR}.{number + 1}.1/30") for number, name in enumerate(names)),
        ),
        forwards=True,
    )
    hosts = (mission_computer, *ground, gateway, lte)
    ends = _tunnels(mission_computer, dict(zip(stations, ground, strict=True)), tunnelled) if tunnelled else ()
    return Plan(tuple(stations), hosts, ends, tuple(tunnelled))


def _tunnels(aircraft: Host, ground: dict[str, Host], tunnelled: Sequence[str]) -> tuple[TunnelEnd, ...]:
    """One interface for each path at the aircraft, one for each path at each station. The aircraft calls, because in a
    mobile network it has no address that a station could call."""
    ends: list[TunnelEnd] = []
    for path, port in TUNNEL_PORTS.items():
        network, outside = _TUNNEL[path], _GROUND_INTERFACE[path]
        inside = {station: f"{network}.{number + 2}" for number, station in enumerate(ground)}
        stations = [station for station in ground if station in tunnelled]
        peers = tuple(
            (ground[station].name, inside[station], f"{ground[station].address(outside)}:{port}")
            for station in stations
        )
        ends.append(
            TunnelEnd(aircraft.name, path, LINK_INTERFACES[path][1], f"{network}.1/24", port, TUNNEL_MTU[path], peers)
        )
        for station in stations:
            # the names differ in a run: wireguard-go has one socket for each name on the whole machine
            name = f"wg{list(ground).index(station) + 1}-{path}"
            ends.append(
                TunnelEnd(
                    ground[station].name,
                    path,
                    name,
                    f"{inside[station]}/24",
                    port,
                    TUNNEL_MTU[path],
                    ((aircraft.name, f"{network}.1", ""),),
                )
            )
    return tuple(ends)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The configuration of a vehicle and of each station for a new mission, with every other key as a comment."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from mavproxy_handover.config.sample import station_text, vehicle_text

__all__ = ["FirstVehicle", "StationSite", "configurations", "is_placeholder", "placeholder", "station_command"]

#: address blocks of documentation (RFC 5737): no computer has such an address
_DOCUMENTATION: Final = tuple(map(ipaddress.ip_network, ("192.0.2.0/24", "198.51.100.0/24", "203.0.113.0/24")))
_FIRST_PORT, _FIRST_GROUND_PORT = 14551, 15551
_FIRST_HOST: Final = 11
_NOTE: Final = "192.0.2.x, 198.51.100.x and 203.0.113.x are placeholders: put the real address in the place of each."


@dataclass(frozen=True, slots=True)
class FirstVehicle:
    """Name and MAVLink system id of the vehicle."""

    name: str
    sysid: int


@dataclass(frozen=True, slots=True)
class StationSite:
    """A station of the mission, and the address at which vehicle and other stations reach it."""

    name: str
    sysid: int
    host: str


def placeholder(number: int) -> str:
    """A documentation address for the station of that number, from 0."""
    block, host = divmod(_FIRST_HOST - 1 + number, 254)
    return str(_DOCUMENTATION[block][host + 1])


def is_placeholder(host: str) -> bool:
    """True if no computer can have this address, because it stands in for one that is not known."""
    try:
        address = ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return False
    return any(address in block for block in _DOCUMENTATION)


def station_command(name: str, number: int) -> str:
    """The command that starts the station of that number, from 0."""
    return f"handover station --config {name}.toml --master udpin:0.0.0.0:{_FIRST_PORT + number}"


def configurations(vehicle: FirstVehicle, stations: Sequence[StationSite], mission: str) -> dict[str, str]:
    """Texts of the configuration files by name; the first station is the parent, and has the folder `mission`."""
    notes = (_NOTE,) if any(is_placeholder(station.host) for station in stations) else ()
    start = "Start: handover companion --config handover.toml --master DEVICE"
    files = {"handover.toml": vehicle_text(_vehicle_values(vehicle, stations), (start, *notes))}
    for number, station in enumerate(stations):
        values = _station_values(vehicle, stations, number, mission if number == 0 else None)
        start = f"Start: {station_command(station.name, number)}"
        files[f"{station.name}.toml"] = station_text(values, (start, *notes))
    return files


def _vehicle_values(vehicle: FirstVehicle, stations: Sequence[StationSite]) -> Mapping[str, Any]:
    own = {
        "name": vehicle.name,
        "sysid": vehicle.sysid,
        "parent": stations[0].name,
        "journal": "handover.jsonl",
        "guard": True,
        "state": "state",
    }
    entries = [
        {
            "name": station.name,
            "sysid": station.sysid,
            "links": [f"udpout:{station.host}:{_FIRST_PORT + number}"],
            "key": _key(station.name),
        }
        for number, station in enumerate(stations)
    ]
    return {"vehicle": [own], "station": entries}


def _station_values(
    vehicle: FirstVehicle, stations: Sequence[StationSite], number: int, mission: str | None
) -> Mapping[str, Any]:
    station = stations[number]
    own = {
        "name": station.name,
        "sysid": station.sysid,
        "vehicle": vehicle.sysid,
        **({} if mission is None else {"mission": mission}),
        "key": _key(station.name),
        "consent": "automatic",
        "journal": f"{station.name}.jsonl",
    }
    peers = [
        {"name": other.name, "sysid": other.sysid, "link": f"udpout:{other.host}:{_FIRST_GROUND_PORT + n}"}
        for n, other in enumerate(stations)
        if n != number
    ]
    ground = {"listen": f"udpin:{_listening(station.host)}:{_FIRST_GROUND_PORT + number}", "key": "keys/ground.key"}
    return {"station": [own], "vehicle": [], "ground": [ground] if peers else [], "peer": peers}


def _listening(host: str) -> str:
    """Where a station listens that is reached at this address."""
    if host in ("127.0.0.1", "localhost"):
        return "127.0.0.1"
    return "[::]" if host.startswith("[") else "0.0.0.0"


def _key(name: str) -> str:
    return f"keys/{name}.key"

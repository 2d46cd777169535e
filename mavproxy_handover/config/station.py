# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a ground station's configuration file: its identity, its vehicles, and the links to other stations.

Its keys are in `station_keys.py`. A station with one vehicle describes it in [station], and MAVProxy gets its links as
options. A station with several has a [[vehicle]] for each: name, system id, key, mission and links, so that they cannot
be confused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.route import route_limits
from mavproxy_handover.config.served import parse_served
from mavproxy_handover.config.station_keys import ASK, GROUND, PEER, STATION, STATION_FILE, VEHICLE
from mavproxy_handover.config.toml import ConfigError, Table, check_tables, list_of_tables, one_table, read_toml
from mavproxy_handover.core.common.model import AUTOMATIC, QUESTIONS, UNASKED, Station
from mavproxy_handover.core.safety.route import RouteLimits
from mavproxy_handover.link.forms import LinkError

__all__ = ["FleetVehicle", "PeerConfig", "StationConfig", "load_station"]

#: keys of [station] that belong to each vehicle if there are [[vehicle]] tables, and their names there
_OF_VEHICLE: Final = {"vehicle": "sysid", "mission": "mission", "key": "key"}
#: a vehicle's name is typed, and labels MAVProxy's links: no blanks, and not the form of a system id
_NAME: Final = re.compile(r"(?=.*[A-Za-z])[A-Za-z0-9][A-Za-z0-9._-]{0,19}")
#: Questions that need no operator, by the word for all. A request of another operator, or a gift of the commander,
#: needs an operator. A forced handover has its own key.
_CONSENTS: Final = {"automatic": frozenset(AUTOMATIC), "operator": frozenset(UNASKED)}


@dataclass(frozen=True, slots=True)
class PeerConfig:
    """Another ground station, reached over the ground link."""

    station: Station
    link: str


@dataclass(frozen=True, slots=True)
class FleetVehicle:
    """A vehicle of this station. Paths are absolute."""

    sysid: int
    #: the operator's name for it; "" if it is the only one and has no table of its own
    name: str = ""
    #: its MAVProxy links, in pymavlink's device form; (): MAVProxy gets them as options, and all are its
    links: tuple[str, ...] = ()
    #: file of the key with which this station signs frames to it; None: not signed
    key: Path | None = None
    mission: Path | None = None

    @property
    def called(self) -> str:
        """Its name for people, until it has reported its own name."""
        return self.name or f"vehicle {self.sysid}"


@dataclass(frozen=True, slots=True)
class StationConfig:
    """A ground station's configuration. Paths are absolute."""

    path: Path
    station: Station
    #: one at least, in the order of the file
    vehicles: tuple[FleetVehicle, ...]
    #: questions that need no operator here, with the names of `core.model.QUESTIONS`
    automatic: frozenset[str]
    journal: Path
    ground: str | None
    #: file of the key of the ground link; None: the link is unsigned, as the configuration allows
    ground_key: Path | None = None
    peers: tuple[PeerConfig, ...] = field(default=())
    #: limits of the route check
    route: RouteLimits = field(default_factory=RouteLimits)
    #: the operator is asked about an address of the vehicle that another station sends; False: it is refused
    offered_addresses: bool = True
    #: the station takes an aircraft only while an operator is on duty
    require_operator: bool = False
    #: link to a program on this computer that flies through this station; None: MAVProxy itself is the program
    serve: str | None = None
    #: such an address may be one of this computer: for tests and simulations
    offered_addresses_local: bool = False


def load_station(path: Path) -> StationConfig:
    """Read and check a station's configuration. Raises ConfigError."""
    path = path.resolve()
    data = read_toml(path)
    check_tables(data, path, STATION_FILE)
    table = one_table(data, STATION, path)
    station = Station(table["sysid"], table["name"])
    vehicles = _vehicles(data, path, table, station)
    ground, ground_key = _ground(one_table(data, GROUND, path)) if GROUND.name in data else (None, None)
    peers = tuple(_peer(entry) for entry in list_of_tables(data, PEER, path))
    if peers and ground is None:
        raise ConfigError(f"{path}: [ground] is missing; [[peer]] needs a place to listen")
    ids = [station.sysid, *(vehicle.sysid for vehicle in vehicles), *(peer.station.sysid for peer in peers)]
    for sysid in ids:
        if ids.count(sysid) > 1:
            raise ConfigError(f"{path}: [[peer]] sysid {sysid} is given twice")
    return StationConfig(
        path=path,
        station=station,
        vehicles=vehicles,
        automatic=_automatic(table),
        journal=path.parent / (table["journal"] or f"{station.name}.jsonl"),
        ground=ground,
        ground_key=ground_key,
        peers=peers,
        route=route_limits(data, path),
        require_operator=table["require_operator"],
        serve=_serve(table),
        offered_addresses=table["offered_addresses"] == ASK,
        offered_addresses_local=table["offered_addresses_local"],
    )


def _serve(table: Table) -> str | None:
    if table["serve"] is None:
        return None
    try:
        parse_served(table["serve"])
    except LinkError as error:
        raise table.error("serve", str(error).removeprefix("link ")) from None
    return str(table["serve"])


def _ground(table: Table) -> tuple[str, Path | None]:
    """Where the ground link listens, and the file of its key."""
    listen = table.link("listen", table["listen"])
    if not listen.startswith("udpin:"):
        raise table.error("listen", f"{listen!r} must be udpin:HOST:PORT")
    key = table.path("key")
    if key is None and not table["allow_unsigned"]:
        raise table.error(
            "key",
            "is missing: any program could speak as another station; 'handover keys make ground' makes one, the "
            "same for all; allow_unsigned = true does without",
        )
    return listen, key


def _vehicles(data: Mapping[str, Any], path: Path, station_table: Table, station: Station) -> tuple[FleetVehicle, ...]:
    """The vehicles of the [[vehicle]] tables; without any, the one of [station]."""
    if "vehicle" not in data:
        sysid = station_table["vehicle"]
        if sysid == station.sysid:
            raise station_table.error("vehicle", f"{sysid} is the station's own sysid")
        return (FleetVehicle(sysid, key=station_table.path("key"), mission=_folder(station_table)),)
    for key, there in _OF_VEHICLE.items():
        if key in station_table:
            raise station_table.error(key, f"does not go together with [[vehicle]]: each says its own {there}")
    tables = list_of_tables(data, VEHICLE, path)
    if not tables:
        raise ConfigError(f"{path}: [[vehicle]] must be there at least once, or not be named")
    vehicles = tuple(_vehicle(table, station) for table in tables)
    _no_two(path, "name", [vehicle.name for vehicle in vehicles])
    _no_two(path, "sysid", [vehicle.sysid for vehicle in vehicles])
    _no_two(path, "link", [link for vehicle in vehicles for link in vehicle.links])
    _no_two(path, "key", [vehicle.key for vehicle in vehicles if vehicle.key is not None])
    return vehicles


def _no_two(path: Path, key: str, values: Sequence[object]) -> None:
    """Raise ConfigError if two vehicles share a value that must be unique."""
    for value in values:
        if values.count(value) > 1:
            shown = repr(value) if key == "name" else value
            raise ConfigError(f"{path}: [[vehicle]] {key} {shown} is given twice")


def _vehicle(table: Table, station: Station) -> FleetVehicle:
    name = table["name"]
    if not _NAME.fullmatch(name):
        raise table.error("name", f"{name!r} must be letters, digits, '.', '_' or '-', one letter at least")
    sysid = table["sysid"]
    if sysid == station.sysid:
        raise table.error("sysid", f"{sysid} is the station's own sysid")
    links = tuple(table.link("links", value) for value in table["links"])
    if not links:
        raise table.error("links", "must name at least one link")
    key = table.path("key")
    if key is None and not table["allow_unsigned"]:
        raise table.error(
            "key",
            f"is missing: any program could speak as {name}; 'handover keys make {station.name}-{name}' makes one, for "
            "this station and this vehicle alone; allow_unsigned = true does without",
        )
    return FleetVehicle(sysid, name, links, key, _folder(table))


def _folder(table: Table) -> Path | None:
    mission = table.path("mission")
    return None if mission is None else mission.resolve()


def _automatic(table: Table) -> frozenset[str]:
    """Questions that need no operator: one word for all, or a list of questions.

    A forced handover has its own key.
    """
    planned = _planned(table)
    return planned - frozenset(UNASKED) if table["forced"] == ASK else planned | frozenset(UNASKED)


def _planned(table: Table) -> frozenset[str]:
    consent = table["consent"]
    if not isinstance(consent, list):
        if not isinstance(consent, str) or consent not in _CONSENTS:
            raise table.error("consent", f"{consent!r} must be one of {', '.join(_CONSENTS)}, or a list of questions")
        return _CONSENTS[consent]
    known = sorted(set(QUESTIONS.values()))
    for word in consent:
        if word not in known:
            raise table.error("consent", f"{word!r} must be one of {', '.join(known)}")
    return frozenset(consent)


def _peer(table: Table) -> PeerConfig:
    station = Station(table["sysid"], table["name"])
    link = table.link("link", table["link"])
    if not link.startswith("udpout:"):
        raise table.error("link", f"{link!r} must be udpout:HOST:PORT")
    return PeerConfig(station, link)

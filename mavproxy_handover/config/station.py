# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a ground station's configuration file: its identity, its vehicles, and the links to other stations.

A station with one vehicle describes it in [station], and MAVProxy gets its links as options. A station with several has
a [[vehicle]] for each: name, system id, key, mission and links, so that they cannot be confused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.route import route_limits
from mavproxy_handover.config.toml import ConfigError, Table, check_tables, list_of_tables, read_toml
from mavproxy_handover.core.common.model import AUTOMATIC, QUESTIONS, UNASKED, Station
from mavproxy_handover.core.safety.route import RouteLimits

__all__ = ["FleetVehicle", "PeerConfig", "StationConfig", "load_station"]

#: keys of [station] that belong to each vehicle if there are [[vehicle]] tables, and their names there
_OF_VEHICLE: Final = {"vehicle": "sysid", "mission": "mission", "key": "key"}
_STATION_KEYS: Final = (
    "name",
    "sysid",
    *_OF_VEHICLE,
    "consent",
    "forced",
    "journal",
    "offered_addresses",
    "offered_addresses_local",
)
_VEHICLE_KEYS: Final = ("name", "sysid", "links", "key", "allow_unsigned", "mission")
_PEER_KEYS: Final = ("name", "sysid", "link")
#: a vehicle's name is typed, and labels MAVProxy's links: no blanks, and not the form of a system id
_NAME: Final = re.compile(r"(?=.*[A-Za-z])[A-Za-z0-9][A-Za-z0-9._-]{0,19}")
#: Questions that need no operator, by the word for all. A request of another operator, or a gift of the commander,
#: needs an operator. A forced handover has its own key.
_CONSENTS: Final = {"automatic": frozenset(AUTOMATIC), "operator": frozenset(UNASKED)}
#: what to do with an address of the vehicle that another station sends: ask the operator, or refuse it
_OFFERED: Final = ("ask", "refuse")
#: what to do when the commander is lost: this station takes the aircraft, or its operator is asked
_FORCED: Final = ("automatic", "ask")


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
    #: such an address may be one of this computer: for tests and simulations
    offered_addresses_local: bool = False


def load_station(path: Path) -> StationConfig:
    """Read and check a station's configuration. Raises ConfigError."""
    path = path.resolve()
    data = read_toml(path)
    check_tables(data, path, ("station", "vehicle", "ground", "peer", "route"), ("station",))
    table = Table(data["station"], "station", path, _STATION_KEYS)
    station = Station(table.sysid("sysid"), table.name("name"))
    vehicles = _vehicles(data, path, table, station)
    ground, ground_key = None, None
    if "ground" in data:
        ground_table = Table(data["ground"], "ground", path, ("listen", "key", "allow_unsigned"))
        ground = ground_table.link("listen", ground_table.get("listen", str, required=True))
        if not ground.startswith("udpin:"):
            raise ground_table.error("listen", f"{ground!r} must be udpin:HOST:PORT")
        ground_key = ground_table.path("key")
        if ground_key is None and not ground_table.get("allow_unsigned", bool, False):
            raise ground_table.error(
                "key",
                "is missing: any program could speak as another station; 'handover keys make ground' makes one, the "
                "same for all; allow_unsigned = true does without",
            )
    peers = tuple(_peer(entry) for entry in list_of_tables(data, "peer", path, _PEER_KEYS))
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
        journal=path.parent / table.get("journal", str, f"{station.name}.jsonl"),
        ground=ground,
        ground_key=ground_key,
        peers=peers,
        route=route_limits(data, path),
        offered_addresses=_word(table, "offered_addresses", _OFFERED) == _OFFERED[0],
        offered_addresses_local=table.get("offered_addresses_local", bool, False),
    )


def _vehicles(data: Mapping[str, Any], path: Path, station_table: Table, station: Station) -> tuple[FleetVehicle, ...]:
    """The vehicles of the [[vehicle]] tables; without any, the one of [station]."""
    if "vehicle" not in data:
        sysid = station_table.sysid("vehicle", required=False, default=1)
        if sysid == station.sysid:
            raise station_table.error("vehicle", f"{sysid} is the station's own sysid")
        return (FleetVehicle(sysid, key=station_table.path("key"), mission=_folder(station_table)),)
    for key, there in _OF_VEHICLE.items():
        if station_table.get(key, object) is not None:
            raise station_table.error(key, f"does not go together with [[vehicle]]: each says its own {there}")
    tables = list_of_tables(data, "vehicle", path, _VEHICLE_KEYS)
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
    name = table.name("name")
    if not _NAME.fullmatch(name):
        raise table.error("name", f"{name!r} must be letters, digits, '.', '_' or '-', one letter at least")
    sysid = table.sysid("sysid")
    if sysid == station.sysid:
        raise table.error("sysid", f"{sysid} is the station's own sysid")
    links = tuple(table.link("links", value) for value in table.get("links", list, required=True))
    if not links:
        raise table.error("links", "must name at least one link")
    key = table.path("key")
    if key is None and not table.get("allow_unsigned", bool, False):
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
    forced = _word(table, "forced", _FORCED)
    planned = _planned(table)
    return planned - frozenset(UNASKED) if forced == "ask" else planned | frozenset(UNASKED)


def _word(table: Table, key: str, allowed: Sequence[str]) -> str:
    """One of these words; the first one if the key is missing."""
    word: str = table.get(key, str, allowed[0])
    if word not in allowed:
        raise table.error(key, f"{word!r} must be one of {', '.join(allowed)}")
    return word


def _planned(table: Table) -> frozenset[str]:
    consent = table.get("consent", object, "automatic")
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
    station = Station(table.sysid("sysid"), table.name("name"))
    link = table.link("link", table.get("link", str, required=True))
    if not link.startswith("udpout:"):
        raise table.error("link", f"{link!r} must be udpout:HOST:PORT")
    return PeerConfig(station, link)

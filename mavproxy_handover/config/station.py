# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station's configuration file: who it is, which vehicle it is for, and how it reaches the other stations."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from mavproxy_handover.config.route import route_limits
from mavproxy_handover.config.toml import ConfigError, Table, check_tables, list_of_tables, read_toml
from mavproxy_handover.core.model import AUTOMATIC, QUESTIONS, Station
from mavproxy_handover.core.safety.route import RouteLimits

__all__ = ["PeerConfig", "StationConfig", "load_station"]

_STATION_KEYS: Final = ("name", "sysid", "vehicle", "consent", "mission", "key", "journal")
_PEER_KEYS: Final = ("name", "sysid", "link")
#: What another operator wants, or the commander's gives away, is for an operator to answer.
_CONSENTS: Final = {"automatic": frozenset(AUTOMATIC), "operator": frozenset[str]()}


@dataclass(frozen=True, slots=True)
class PeerConfig:
    """Another ground station, reached over the ground link."""

    station: Station
    link: str


@dataclass(frozen=True, slots=True)
class StationConfig:
    """A ground station's configuration. Paths are absolute."""

    path: Path
    station: Station
    vehicle: int
    #: what needs no operator here, in the words of `core.model.QUESTIONS`
    automatic: frozenset[str]
    mission: Path | None
    journal: Path
    ground: str | None
    #: file of the key that all stations of the ground link sign with; None: the link is open, which was asked for
    ground_key: Path | None = None
    peers: tuple[PeerConfig, ...] = field(default=())
    #: file of the key that this station signs with; None: it signs nothing
    key: Path | None = None
    #: from when on the aircraft is off its route
    route: RouteLimits = field(default_factory=RouteLimits)


def load_station(path: Path) -> StationConfig:
    """Read and check a station's configuration. Raises ConfigError."""
    path = path.resolve()
    data = read_toml(path)
    check_tables(data, path, ("station", "ground", "peer", "route"), ("station",))
    table = Table(data["station"], "station", path, _STATION_KEYS)
    station = Station(table.sysid("sysid"), table.name("name"))
    vehicle = table.sysid("vehicle", required=False, default=1)
    mission = table.path("mission")
    if vehicle == station.sysid:
        raise table.error("vehicle", f"{vehicle} is the station's own sysid")
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
                "is missing: anybody could speak as another station; 'handover keys make ground' makes one, the same "
                "for all; allow_unsigned = true does without",
            )
    peers = tuple(_peer(entry) for entry in list_of_tables(data, "peer", path, _PEER_KEYS))
    if peers and ground is None:
        raise ConfigError(f"{path}: [ground] is missing; [[peer]] needs a place to listen")
    ids = [station.sysid, vehicle, *(peer.station.sysid for peer in peers)]
    for sysid in ids:
        if ids.count(sysid) > 1:
            raise ConfigError(f"{path}: [[peer]] sysid {sysid} is given twice")
    return StationConfig(
        path=path,
        station=station,
        vehicle=vehicle,
        automatic=_automatic(table),
        mission=None if mission is None else mission.resolve(),
        journal=path.parent / table.get("journal", str, f"{station.name}.jsonl"),
        ground=ground,
        ground_key=ground_key,
        peers=peers,
        key=table.path("key"),
        route=route_limits(data, path),
    )


def _automatic(table: Table) -> frozenset[str]:
    """What needs no operator: by one word for all, or a list of questions."""
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

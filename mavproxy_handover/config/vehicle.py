# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the vehicle's configuration file: its stations, and every configurable limit. Its keys: `vehicle_keys.py`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mavproxy_handover.config.feeds import feed_settings
from mavproxy_handover.config.onboard import OnboardProgram, onboard_programs
from mavproxy_handover.config.payload import payload_rules
from mavproxy_handover.config.position import PositionSettings, position_settings
from mavproxy_handover.config.remote_id import RemoteIdSettings, remote_id_settings
from mavproxy_handover.config.route import route_limits
from mavproxy_handover.config.toml import ConfigError, Table, check_tables, list_of_tables, one_table, read_toml
from mavproxy_handover.config.vehicle_keys import (
    CLEAR,
    COMMANDS,
    HOLD_OFF,
    LIMITS,
    LINKS,
    OBSERVERS,
    POLICY,
    STATION,
    VEHICLE,
    VEHICLE_FILE,
)
from mavproxy_handover.core.authority.payload import PayloadRules
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import StandingConsent, Station
from mavproxy_handover.core.feeds import FeedSettings
from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.core.safety.route import RouteLimits
from mavproxy_handover.gate.client_capabilities import POLICIES as CAPABILITY_POLICIES
from mavproxy_handover.gate.observers import ObserverLimits
from mavproxy_handover.gate.policy.onboard import Right
from mavproxy_handover.link.quality import LinkLimits
from mavproxy_handover.mission.keys import ENERGY
from mavproxy_handover.tools.key_table import KeyTable
from mavproxy_handover.wire.ids import STATION_COMPIDS

__all__ = ["StationLinks", "VehicleConfig", "load_vehicle", "vehicle_of"]


@dataclass(frozen=True, slots=True)
class StationLinks:
    """A station as the vehicle knows it: identity, further ids on its links, and the links."""

    station: Station
    links: tuple[str, ...]
    sysids: frozenset[int]
    #: file of the key with which it signs; None: its frames are accepted unsigned
    key: Path | None = None
    #: limits above which one of its links is degraded
    limits: LinkLimits = field(default_factory=LinkLimits)
    #: which of its programs get the result NOT_IN_CONTROL: those that have shown support ("auto"), all, none
    not_in_control: str = CAPABILITY_POLICIES[0]
    #: the components of the station's own id that have its authority
    components: frozenset[int] = STATION_COMPIDS
    #: True if it gets the companion's heartbeat
    companion_heartbeat: bool = True
    #: id of its operator for Remote ID; "": not configured
    operator_id: str = ""


@dataclass(frozen=True, slots=True)
class VehicleConfig:
    """The companion's configuration. Paths are absolute."""

    path: Path
    name: str
    sysid: int
    parent: int
    journal: Path
    stations: tuple[StationLinks, ...]
    limits: Limits
    listen_only_outputs: bool = False
    #: folder of the state file; None: no state outlives a restart
    state: Path | None = None
    #: folder of a mission package that is on board already; None: the parent sends it
    mission: Path | None = None
    #: file of the autopilot's key; None: its link is not signed
    autopilot_key: Path | None = None
    #: file of the key on the guard's card; None: leases have no tag
    guard_key: Path | None = None
    #: limits of one observer on the downlink
    observers: ObserverLimits = field(default_factory=ObserverLimits)
    #: power and capacity of the aircraft; the mission's numbers take precedence
    energy: EnergySettings = field(default_factory=EnergySettings)
    #: limits of the route check
    route: RouteLimits = field(default_factory=RouteLimits)
    #: what to do with a command that would leave a limit, if it is not the default
    commands: Mapping[Limit, str] = field(default_factory=dict)
    #: source of the position
    position: PositionSettings = field(default_factory=PositionSettings)
    #: stations that may send feeds
    feeds: FeedSettings = field(default_factory=FeedSettings)
    #: which program sends Remote ID
    remote_id: RemoteIdSettings = field(default_factory=RemoteIdSettings)
    #: software on the companion that has a link of its own
    onboard: tuple[OnboardProgram, ...] = ()
    #: which station or program has payload authority
    payload: PayloadRules = field(default_factory=PayloadRules)


# ---- limits -------------------------------------------------------------------------------------------------------


def _limits(data: Mapping[str, Any], path: Path, guard_required: bool) -> Limits:
    values = one_table(data, LIMITS, path).given()
    for name, keys in (("policies", POLICY), ("hold_off_s", HOLD_OFF), ("clear_s", CLEAR)):
        values[name] = {Cause(key): value for key, value in _other_than_default(data, keys, path).items()}
    limits = Limits(**values, guard_required=guard_required)
    if limits.deaf_back_share <= limits.deaf_share:
        raise ConfigError(
            f"{path}: [limits] deaf_back_share = {limits.deaf_back_share:g} must be above deaf_share = "
            f"{limits.deaf_share:g}"
        )
    if limits.connect_interval_s >= limits.deaf_lost_s:
        raise ConfigError(
            f"{path}: [limits] connect_interval_s = {limits.connect_interval_s:g} must be below deaf_lost_s = "
            f"{limits.deaf_lost_s:g}: a commander that answers every question would be lost before the next one"
        )
    return limits


def _other_than_default(data: Mapping[str, Any], keys: KeyTable, path: Path) -> dict[str, Any]:
    """The values of a table that differ from the defaults."""
    given = one_table(data, keys, path).given()
    return {key: value for key, value in given.items() if value != keys[key].default}


def _energy(data: Mapping[str, Any], path: Path) -> EnergySettings:
    table = one_table(data, ENERGY, path)
    settings = EnergySettings(**table.given())
    if settings.payload_wrong:
        raise table.error("payload_kg", settings.payload_wrong)
    return settings


# ---- the file -----------------------------------------------------------------------------------------------------


def load_vehicle(path: Path) -> VehicleConfig:
    """Read and check a vehicle's configuration. Raises ConfigError."""
    path = path.resolve()
    return vehicle_of(read_toml(path), path)


def vehicle_of(data: Mapping[str, Any], path: Path, layout_text: bytes | None = None) -> VehicleConfig:
    """Check the content of such a file. `path`: its path, for errors and relative paths.

    `layout_text`: content of the file of a position box's layout, if that is not to be read. Raises ConfigError.
    """
    check_tables(data, path, VEHICLE_FILE)
    vehicle = one_table(data, VEHICLE, path)
    sysid, parent_name = vehicle["sysid"], vehicle["parent"]
    links = LinkLimits(**one_table(data, LINKS, path).given())
    entries = list_of_tables(data, STATION, path)
    stations = tuple(_station_links(table, links, vehicle["allow_unsigned"]) for table in entries)
    _unique(path, stations, sysid)
    parents = [entry.station.sysid for entry in stations if entry.station.name == parent_name]
    if not parents:
        known = ", ".join(entry.station.name for entry in stations)
        raise vehicle.error("parent", f"{parent_name!r} must be one of the stations: {known}")
    programs = _onboard(data, path, stations)
    payloads = [program.name for program in programs if Right.PAYLOAD in program.rights.rights]
    return VehicleConfig(
        path=path,
        name=vehicle["name"],
        sysid=sysid,
        parent=parents[0],
        journal=path.parent / vehicle["journal"],
        stations=stations,
        limits=_limits(data, path, vehicle["guard"]),
        listen_only_outputs=vehicle["listen_only_outputs"],
        state=path.parent / vehicle["state"],
        mission=vehicle.path("mission"),
        autopilot_key=vehicle.path("autopilot_key"),
        guard_key=vehicle.path("guard_key"),
        observers=ObserverLimits(**one_table(data, OBSERVERS, path).given()),
        energy=_energy(data, path),
        route=route_limits(data, path),
        commands={Limit(key): word for key, word in _other_than_default(data, COMMANDS, path).items()},
        position=position_settings(data, path, layout_text),
        feeds=feed_settings(data, path, {entry.station.name: entry.station.sysid for entry in stations}),
        remote_id=remote_id_settings(data, path),
        onboard=programs,
        payload=payload_rules(data, path, (*(entry.station.name for entry in stations), *payloads)),
    )


def _station_links(table: Table, limits: LinkLimits, unsigned: bool) -> StationLinks:
    standard = not table["module"]
    station = Station(table["sysid"], table["name"], standard, _consent(table, standard))
    links = tuple(table.link("links", link) for link in table["links"])
    if not links:
        raise table.error("links", "must name at least one link")
    key = table.path("key")
    if key is None and not unsigned:
        hint = f"'handover keys make {station.name}' makes one; allow_unsigned = true in [vehicle] does without"
        raise table.error("key", f"is missing: any program could speak as {station.name}; {hint}")
    components = frozenset(table["components"])
    if not components:
        raise table.error("components", "must name at least one component")
    beats = table["companion_heartbeat"]
    if not beats and not standard:
        raise table.error("companion_heartbeat", "= false goes with module = false: our module goes by that heartbeat")
    operator_id = table["operator_id"] or ""
    if not re.fullmatch(r"[ -~]{0,20}", operator_id):
        raise table.error("operator_id", f"{operator_id!r} must be 1 to 20 printable ASCII characters")
    sysids = frozenset([station.sysid, *table["sysids"]])
    return StationLinks(station, links, sysids, key, limits, table["not_in_control"], components, beats, operator_id)


def _onboard(data: Mapping[str, Any], path: Path, stations: tuple[StationLinks, ...]) -> tuple[OnboardProgram, ...]:
    """The onboard programs; none shares its name or its link with a station."""
    programs = onboard_programs(data, path)
    names = {entry.station.name for entry in stations}
    links = {link for entry in stations for link in entry.links}
    for program in programs:
        if program.name in names:
            raise ConfigError(f"{path}: [[onboard]] name {program.name!r} is also a station's; choose another")
        if program.link in links:
            raise ConfigError(f"{path}: [[onboard]] link {program.link} is also a station's; choose another port")
    return programs


def _consent(table: Table, standard: bool) -> StandingConsent | None:
    word = table["consent"]
    if word is not None and not standard:
        raise table.error("consent", "goes with module = false; with our module the station's own file has its consent")
    return None if word is None else StandingConsent(word)


def _unique(path: Path, stations: tuple[StationLinks, ...], vehicle: int) -> None:
    if not stations:
        raise ConfigError(f"{path}: [[station]] must be there at least once")
    names, links = set(), set()
    ids = {vehicle: "the vehicle"}
    for entry in stations:
        if entry.station.name in names:
            raise ConfigError(f"{path}: [[station]] name {entry.station.name!r} is given twice")
        names.add(entry.station.name)
        for sysid in sorted(entry.sysids):
            if sysid in ids:
                raise ConfigError(f"{path}: [[station]] sysid {sysid} of {entry.station.name} is also {ids[sysid]}'s")
            ids[sysid] = entry.station.name
        for link in entry.links:
            if link in links:
                raise ConfigError(f"{path}: [[station]] link {link} is given twice")
            links.add(link)

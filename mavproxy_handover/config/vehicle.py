# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the vehicle's configuration file: its stations, and every configurable limit with its range.

The ranges are wide enough for any sound installation and narrow enough that they switch nothing off. The longest
allowed limit still detects a loss, and the shortest does not degrade a healthy link.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.position import POSITION_RANGES, PositionSettings, position_settings
from mavproxy_handover.config.route import ROUTE_RANGES, route_limits
from mavproxy_handover.config.toml import ConfigError, Ranges, Table, check_tables, list_of_tables, read_toml
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import StandingConsent, Station
from mavproxy_handover.core.safety.commands import POLICIES, Limit
from mavproxy_handover.core.safety.energy_prior import (
    ENERGY_KEYS,
    ENERGY_RANGES,
    START_POLICIES,
    WHOLE_KEYS,
    EnergySettings,
)
from mavproxy_handover.core.safety.route import RouteLimits
from mavproxy_handover.gate.client_capabilities import POLICIES as CAPABILITY_POLICIES
from mavproxy_handover.gate.observers import ObserverLimits
from mavproxy_handover.link.quality import LinkLimits
from mavproxy_handover.wire.ids import STATION_COMPIDS

__all__ = [
    "LIMIT_RANGES",
    "LINK_RANGES",
    "OBSERVER_RANGES",
    "StationLinks",
    "VehicleConfig",
    "load_vehicle",
    "vehicle_of",
]


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


# ---- limits -------------------------------------------------------------------------------------------------------

LIMIT_RANGES: Final[Ranges] = {
    "heartbeat_lost_s": (1.5, 60),
    "recovery_s": (0.5, 30),
    "connect_interval_s": (0.2, 10),
    "connect_lost_s": (1, 60),
    "deaf_lost_s": (3, 120),
    "deaf_share": (0.02, 0.25),
    "deaf_back_share": (0.2, 0.6),
    "deaf_back_s": (1, 300),
    "retry_first_s": (0.05, 5),
    "retry_growth": (1, 4),
    "retry_max_s": (0.05, 10),
    "step_timeout_s": (0.5, 60),
    "operator_timeout_s": (3, 300),
    "release_timeout_s": (0.5, 30),
    "forced_timeout_s": (0.2, 10),
    "reserve_timeout_s": (0.1, 10),
    "retry_pause_s": (0.1, 60),
    "denied_pause_s": (0.1, 600),
    "result_timeout_s": (1, 120),
    "enter_margin_m": (0, 1000),
    "leave_margin_m": (0, 1000),
    "dwell_s": (0, 600),
    "exit_soon_s": (0, 120),
    "hold_lead_s": (1, 60),
    "answer_s": (0.3, 10),
    "hold_s": (0, 3600),
    "obey_s": (2, 30),
    "stuck_s": (10, 600),
    "rehearsal_lost_s": (10, 3600),
    "link_weak_s": (0, 60),
    "link_steady_s": (0, 600),
    "position_stale_s": (0.2, 30),
    "autopilot_lost_s": (1.5, 30),
    "guard_lost_s": (1, 30),
}
#: a station's heartbeat comes once a second, so less than 1.5 s of silence is meaningless; a loss of 1 is never
#: exceeded
LINK_RANGES: Final[Ranges] = {
    "silence_s": (1.5, 60),
    "loss": (0.01, 1),
    "round_trip_s": (0.05, 30),
    "bad_signatures": (1, 1000),
    "hold_s": (0.1, 60),
}
#: an allowance below the longest frame (280 bytes) would never let that one through
OBSERVER_RANGES: Final[Ranges] = {
    "message_hz": (0.1, 100),
    "bytes_per_s": (300, 1_000_000),
    "silence_s": (2, 3600),
}
_CAUSES: Final = tuple(cause.value for cause in Cause)
#: hold-off and clearing time of a cause
_WAIT_S: Final = (0.0, 600.0)


def _limits(data: Mapping[str, Any], path: Path, guard_required: bool) -> Limits:
    values: dict[str, Any] = {"guard_required": guard_required}
    values |= Table(data.get("limits", {}), "limits", path, tuple(LIMIT_RANGES)).numbers(LIMIT_RANGES)
    values["policies"] = _policies(Table(data.get("policy", {}), "policy", path, _CAUSES))
    for name in ("hold_off", "clear"):
        waits = Table(data.get(name, {}), name, path, _CAUSES).numbers(dict.fromkeys(_CAUSES, _WAIT_S))
        own = {Cause(key): seconds for key, seconds in waits.items()}
        values[f"{name}_s"] = {c: own[c] for c in own if own[c] != getattr(CAUSES[c], f"{name}_s")}
    limits = Limits(**values)
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


def _policies(table: Table) -> dict[Cause, str]:
    found = {}
    for key in _CAUSES:
        cause, word = Cause(key), table.get(key, str)
        row = CAUSES[cause]
        if word is None:
            continue
        if word not in row.policies:
            raise table.error(key, f"{word!r} must be one of " + ", ".join(row.policies))
        if word != row.policies[0]:
            found[cause] = word
    return found


def _energy(data: Mapping[str, Any], path: Path) -> EnergySettings:
    table = Table(data.get("energy", {}), "energy", path, ENERGY_KEYS)
    for key in sorted(WHOLE_KEYS):
        table.get(key, int)
    start = table.get("start", str)
    if start not in (None, *START_POLICIES):
        raise table.error("start", f"{start!r} must be one of " + ", ".join(START_POLICIES))
    settings = EnergySettings(**table.numbers(ENERGY_RANGES), start=start)
    if settings.payload_wrong:
        raise table.error("payload_kg", settings.payload_wrong)
    return settings


def _commands(data: Mapping[str, Any], path: Path) -> dict[Limit, str]:
    table = Table(data.get("commands", {}), "commands", path, tuple(limit.value for limit in Limit))
    found = {}
    for limit in Limit:
        word = table.get(limit.value, str)
        if word is None:
            continue
        if word not in POLICIES:
            raise table.error(limit.value, f"{word!r} must be one of " + ", ".join(POLICIES))
        if word != POLICIES[0]:
            found[limit] = word
    return found


def _check_ranges() -> None:
    described: tuple[tuple[type, set[str]], ...] = (
        (Limits, {*LIMIT_RANGES, "policies", "hold_off_s", "clear_s", "guard_required"}),
        (LinkLimits, {*LINK_RANGES}),
        (ObserverLimits, {*OBSERVER_RANGES}),
        (EnergySettings, {*ENERGY_KEYS}),
        (RouteLimits, {*ROUTE_RANGES}),
        (PositionSettings, {*POSITION_RANGES, "source", "box", "layout", "layout_file", "layout_text", "check"}),
    )
    for limits, names in described:
        known = {entry.name for entry in fields(limits)}
        assert known == names, f"{limits.__name__} without a range: {known ^ names}"


_check_ranges()

# ---- the file -----------------------------------------------------------------------------------------------------

_TABLES: Final = (
    "vehicle",
    "station",
    "limits",
    "policy",
    "hold_off",
    "clear",
    "links",
    "observers",
    "energy",
    "route",
    "commands",
    "position",
)
_VEHICLE_KEYS: Final = (
    "name",
    "sysid",
    "parent",
    "journal",
    "guard",
    "listen_only_outputs",
    "state",
    "mission",
    "allow_unsigned",
    "autopilot_key",
    "guard_key",
)
_STATION_KEYS: Final = (
    "name",
    "sysid",
    "links",
    "key",
    "module",
    "consent",
    "sysids",
    "not_in_control",
    "components",
    "companion_heartbeat",
)


def load_vehicle(path: Path) -> VehicleConfig:
    """Read and check a vehicle's configuration. Raises ConfigError."""
    path = path.resolve()
    return vehicle_of(read_toml(path), path)


def vehicle_of(data: Mapping[str, Any], path: Path, layout_text: bytes | None = None) -> VehicleConfig:
    """Check the content of such a file. `path`: its path, for errors and relative paths.

    `layout_text`: content of the file of a position box's layout, if that is not to be read. Raises ConfigError.
    """
    check_tables(data, path, _TABLES, ("vehicle", "station"))
    vehicle = Table(data["vehicle"], "vehicle", path, _VEHICLE_KEYS)
    name = vehicle.name("name")
    sysid = vehicle.sysid("sysid", required=False, default=1)
    parent_name = vehicle.name("parent")
    guard = vehicle.get("guard", bool, True)
    unsigned = vehicle.get("allow_unsigned", bool, False)
    limits = _limits(data, path, guard)
    links = LinkLimits(**Table(data.get("links", {}), "links", path, tuple(LINK_RANGES)).numbers(LINK_RANGES))
    observers = Table(data.get("observers", {}), "observers", path, tuple(OBSERVER_RANGES))
    entries = list_of_tables(data, "station", path, _STATION_KEYS)
    stations = tuple(_station_links(table, links, unsigned) for table in entries)
    _unique(path, stations, sysid)
    parents = [entry.station.sysid for entry in stations if entry.station.name == parent_name]
    if not parents:
        known = ", ".join(entry.station.name for entry in stations)
        raise vehicle.error("parent", f"{parent_name!r} must be one of the stations: {known}")
    return VehicleConfig(
        path=path,
        name=name,
        sysid=sysid,
        parent=parents[0],
        journal=path.parent / vehicle.get("journal", str, "handover.jsonl"),
        stations=stations,
        limits=limits,
        listen_only_outputs=vehicle.get("listen_only_outputs", bool, False),
        state=path.parent / vehicle.get("state", str, "state"),
        mission=vehicle.path("mission"),
        autopilot_key=vehicle.path("autopilot_key"),
        guard_key=vehicle.path("guard_key"),
        observers=ObserverLimits(**observers.numbers(OBSERVER_RANGES)),
        energy=_energy(data, path),
        route=route_limits(data, path),
        commands=_commands(data, path),
        position=position_settings(data, path, layout_text),
    )


def _station_links(table: Table, limits: LinkLimits, unsigned: bool) -> StationLinks:
    standard = not table.get("module", bool, True)
    station = Station(table.sysid("sysid"), table.name("name"), standard, _consent(table, standard))
    links = table.get("links", list, required=True)
    if not links:
        raise table.error("links", "must name at least one link")
    checked = tuple(table.link("links", link) for link in links)
    extra = table.get("sysids", list, [])
    for sysid in extra:
        if not isinstance(sysid, int) or isinstance(sysid, bool) or not 1 <= sysid <= 255:
            raise table.error("sysids", f"{sysid!r} must be a MAVLink system id, 1 to 255")
    key = table.path("key")
    if key is None and not unsigned:
        hint = f"'handover keys make {station.name}' makes one; allow_unsigned = true in [vehicle] does without"
        raise table.error("key", f"is missing: any program could speak as {station.name}; {hint}")
    result = table.get("not_in_control", str, CAPABILITY_POLICIES[0])
    if result not in CAPABILITY_POLICIES:
        raise table.error("not_in_control", f"{result!r} must be one of " + ", ".join(CAPABILITY_POLICIES))
    beats = table.get("companion_heartbeat", bool, True)
    if not beats and not standard:
        raise table.error("companion_heartbeat", "= false goes with module = false: our module goes by that heartbeat")
    sysids = frozenset([station.sysid, *extra])
    return StationLinks(station, checked, sysids, key, limits, result, _components(table), beats)


def _components(table: Table) -> frozenset[int]:
    components = table.get("components", list, sorted(STATION_COMPIDS))
    if not components:
        raise table.error("components", "must name at least one component")
    for component in components:
        if not isinstance(component, int) or isinstance(component, bool) or not 0 <= component <= 255:
            raise table.error("components", f"{component!r} must be a MAVLink component id, 0 to 255")
    return frozenset(components)


def _consent(table: Table, standard: bool) -> StandingConsent | None:
    word = table.get("consent", str)
    if word is None:
        return None
    if not standard:
        raise table.error("consent", "goes with module = false; with our module the station's own file has its consent")
    known = {each.value: each for each in StandingConsent}
    if word not in known:
        raise table.error("consent", f"{word!r} must be one of " + ", ".join(known))
    return known[word]


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

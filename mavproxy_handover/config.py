# SPDX-License-Identifier: GPL-3.0-or-later

"""The two configuration files, vehicle's and station's: TOML in, frozen dataclasses out.

Every error is one line that names the file, the key, the value and what is allowed. Unknown keys are errors: a
misspelt limit must not silently keep its default.
"""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

from mavproxy_handover.core.events import FlightAction
from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import Station
from mavproxy_handover.link.forms import LinkError, parse_device

__all__ = [
    "ConfigError",
    "PeerConfig",
    "StationConfig",
    "StationLinks",
    "VehicleConfig",
    "config_argument",
    "find_station_config",
    "find_vehicle_config",
    "load_station",
    "load_vehicle",
]

VEHICLE_PLACES = ("./handover.toml", "/etc/handover/vehicle.toml")
STATION_PLACES = ("./station.toml",)


class ConfigError(Exception):
    """A configuration cannot be used. The message is one line for people."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


@dataclass(frozen=True, slots=True)
class StationLinks:
    """A station as the vehicle knows it: identity, the ids behind its links, and the links."""

    station: Station
    links: tuple[str, ...]
    sysids: frozenset[int]
    #: file of the key that it signs with; None: its frames are taken unsigned
    key: Path | None = None


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
    #: folder of the state file; None: nothing outlives a restart
    state: Path | None = None
    #: folder of a mission package that is on board already; None: the parent sends it
    mission: Path | None = None
    #: file of the key that the autopilot was set up with; None: its link is not signed
    autopilot_key: Path | None = None
    #: file of the key on the guard's card; None: leases have no tag
    guard_key: Path | None = None


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
    operator_consents: bool
    mission: Path | None
    journal: Path
    ground: str | None
    peers: tuple[PeerConfig, ...] = field(default=())
    #: file of the key that this station signs with; None: it signs nothing
    key: Path | None = None


# ---- reading ------------------------------------------------------------------------------------------------------


class _Table:
    """One TOML table, read key by key; what is never asked for is an unknown key."""

    def __init__(self, data: Any, where: str, file: Path) -> None:
        if not isinstance(data, Mapping):
            raise ConfigError(f"{file}: [{where}] must be a table")
        self._data = data
        self._where = where
        self._file = file
        self._asked: list[str] = []

    def error(self, key: str, text: str) -> ConfigError:
        return ConfigError(f"{self._file}: [{self._where}] {key}: {text}")

    def get(self, key: str, kind: type, default: Any = None, *, required: bool = False) -> Any:
        self._asked.append(key)
        if key not in self._data:
            if required:
                raise self.error(key, f"is missing; it must be {_KIND_NAMES[kind]}")
            return default
        value = self._data[key]
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 2**63 else math.inf
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            raise self.error(key, f"{value!r} must be {_KIND_NAMES[kind]}")
        return value

    def sysid(self, key: str, *, required: bool = True, default: int = 0) -> int:
        value: int = self.get(key, int, default, required=required)
        if not 1 <= value <= 255:
            raise self.error(key, f"{value} must be a MAVLink system id, 1 to 255")
        return value

    def name(self, key: str) -> str:
        value: str = self.get(key, str, required=True)
        if not 1 <= len(value) <= 20 or not value.isprintable() or not value.isascii():
            raise self.error(key, f"{value!r} must be 1 to 20 printable ASCII characters")
        return value

    def done(self) -> None:
        for key in self._data:
            if key not in self._asked:
                near = difflib.get_close_matches(key, self._asked, 1)
                hint = f"did you mean {near[0]!r}?" if near else "allowed are: " + ", ".join(self._asked)
                raise self.error(key, f"unknown key; {hint}")


_KIND_NAMES = {int: "a whole number", float: "a number", str: "a text", bool: "true or false", list: "a list"}


def _read(path: Path) -> Mapping[str, Any]:
    try:
        with path.open("rb") as file:
            data: Mapping[str, Any] = tomllib.load(file)
            return data
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # ValueError: no TOML, no UTF-8, a number of thousands of digits
        raise ConfigError(f"{path}: not valid TOML: {error}") from None


def _tables(data: Mapping[str, Any], path: Path, allowed: tuple[str, ...], required: tuple[str, ...]) -> None:
    for key in data:
        if key not in allowed:
            near = difflib.get_close_matches(key, allowed, 1)
            hint = f"did you mean [{near[0]}]?" if near else "allowed are: " + ", ".join(allowed)
            raise ConfigError(f"{path}: unknown table [{key}]; {hint}")
    for key in required:
        if key not in data:
            raise ConfigError(f"{path}: [{key}] is missing")


def _list_of_tables(data: Mapping[str, Any], key: str, path: Path) -> list[_Table]:
    entries = data.get(key, [])
    if not isinstance(entries, list):
        raise ConfigError(f"{path}: [{key}] must be written [[{key}]], once for each")
    return [_Table(entry, f"{key} {number}", path) for number, entry in enumerate(entries, 1)]


def _link(table: _Table, key: str, value: Any) -> str:
    """A link in pymavlink's device form."""
    try:
        return parse_device(value).text
    except LinkError as error:
        raise table.error(key, str(error).removeprefix("link ")) from None


# ---- limits -------------------------------------------------------------------------------------------------------

#: field of Limits -> allowed range
_RANGES: dict[str, tuple[float, float]] = {
    "heartbeat_lost_s": (1.5, 60),
    "connect_interval_s": (0.2, 10),
    "connect_lost_s": (1, 60),
    "retry_first_s": (0.02, 5),
    "retry_growth": (1, 4),
    "retry_max_s": (0.05, 10),
    "step_timeout_s": (0.5, 60),
    "operator_timeout_s": (3, 300),
    "release_timeout_s": (0.5, 30),
    "forced_timeout_s": (0.2, 10),
    "retry_pause_s": (0.1, 60),
    "denied_pause_s": (0.1, 600),
    "result_timeout_s": (1, 120),
    "enter_margin_m": (0, 1000),
    "leave_margin_m": (0, 1000),
    "dwell_s": (0, 600),
    "exit_soon_s": (0, 120),
    "link_weak_s": (0, 60),
    "link_steady_s": (0, 600),
    "out_hold_s": (0, 60),
    "position_stale_s": (0.2, 30),
    "autopilot_lost_s": (1.5, 30),
    "guard_lost_s": (1, 30),
}
_POLICIES = ("out_of_coverage", "commander_lost")


def _limits(data: Mapping[str, Any], path: Path, guard_required: bool) -> Limits:
    values: dict[str, Any] = {"guard_required": guard_required}
    limits = _Table(data.get("limits", {}), "limits", path)
    for key, (low, high) in _RANGES.items():
        value = limits.get(key, float)
        if value is None:
            continue
        if not low <= value <= high:
            raise limits.error(key, f"{value:g} must be {low:g} to {high:g}")
        values[key] = value
    limits.done()
    policy = _Table(data.get("policy", {}), "policy", path)
    for key in _POLICIES:
        word = policy.get(key, str)
        if word is None:
            continue
        if word.upper() not in FlightAction.__members__:
            raise policy.error(
                key, f"{word!r} must be one of " + ", ".join(n.lower() for n in FlightAction.__members__)
            )
        values[key] = FlightAction[word.upper()]
    policy.done()
    return Limits(**values)


def _check_limits_table() -> None:
    known = {entry.name for entry in fields(Limits)}
    described = {*_RANGES, *_POLICIES, "guard_required"}
    assert known == described, f"limits without a range: {known ^ described}"


_check_limits_table()

# ---- the vehicle --------------------------------------------------------------------------------------------------


def config_argument(value: Any) -> str | None:
    """The `config` argument of `module load`, which MAVProxy reads as JSON. Raises ConfigError if it is no path."""
    if value is None or (isinstance(value, str) and value and "\0" not in value):
        return value
    raise ConfigError(f"argument config: {value!r} must be the path of a configuration file")


def find_vehicle_config(explicit: str | None) -> Path:
    """The vehicle's configuration file: `explicit`, else $HANDOVER_CONFIG, else the usual places.

    Raises ConfigError that says where was looked and how to make one.
    """
    named = explicit or os.environ.get("HANDOVER_CONFIG")
    return _find(named, "handover", VEHICLE_PLACES, "vehicle", "$HANDOVER_CONFIG, ")


def find_station_config(explicit: str | None) -> Path:
    """The same for a station: `explicit`, else the usual place."""
    return _find(explicit, "handover_gcs", STATION_PLACES, "station")


def _find(named: str | None, module: str, places: tuple[str, ...], kind: str, variable: str = "") -> Path:
    try:
        for place in (named,) if named else places:
            if named or Path(place).is_file():
                return Path(place).expanduser().resolve()
    except (OSError, RuntimeError, ValueError) as error:  # ~nobody, links in a circle
        raise ConfigError(f"{named}: {error}") from None
    looked = f'module load {module}:{{"config":"FILE"}} (no spaces in it), {variable}{", ".join(places)}'
    raise ConfigError(f"no configuration: looked for {looked}; the shell's 'handover init {kind}' writes one")


def load_vehicle(path: Path) -> VehicleConfig:
    """Read and check a vehicle's configuration. Raises ConfigError."""
    path = path.resolve()
    data = _read(path)
    _tables(data, path, ("vehicle", "station", "limits", "policy"), ("vehicle", "station"))
    vehicle = _Table(data["vehicle"], "vehicle", path)
    name = vehicle.name("name")
    sysid = vehicle.sysid("sysid", required=False, default=1)
    parent_name = vehicle.name("parent")
    journal = vehicle.get("journal", str, "handover.jsonl")
    guard = vehicle.get("guard", bool, True)
    listen_only = vehicle.get("listen_only_outputs", bool, False)
    state = vehicle.get("state", str, "state")
    mission = vehicle.get("mission", str)
    unsigned = vehicle.get("allow_unsigned", bool, False)
    autopilot_key = vehicle.get("autopilot_key", str)
    guard_key = vehicle.get("guard_key", str)
    vehicle.done()
    stations = tuple(_station_links(table, path.parent, unsigned) for table in _list_of_tables(data, "station", path))
    _unique(path, "station", stations, sysid)
    parents = [entry.station.sysid for entry in stations if entry.station.name == parent_name]
    if not parents:
        known = ", ".join(entry.station.name for entry in stations)
        raise vehicle.error("parent", f"{parent_name!r} must be one of the stations: {known}")
    return VehicleConfig(
        path=path,
        name=name,
        sysid=sysid,
        parent=parents[0],
        journal=path.parent / journal,
        stations=stations,
        limits=_limits(data, path, guard),
        listen_only_outputs=listen_only,
        state=path.parent / state,
        mission=None if mission is None else path.parent / mission,
        autopilot_key=None if autopilot_key is None else path.parent / autopilot_key,
        guard_key=None if guard_key is None else path.parent / guard_key,
    )


def _station_links(table: _Table, folder: Path, unsigned: bool) -> StationLinks:
    standard = not table.get("module", bool, True)
    station = Station(table.sysid("sysid"), table.name("name"), standard)
    links = table.get("links", list, required=True)
    if not links:
        raise table.error("links", "must name at least one link")
    checked = tuple(_link(table, "links", link) for link in links)
    extra = table.get("sysids", list, [])
    for sysid in extra:
        if not isinstance(sysid, int) or isinstance(sysid, bool) or not 1 <= sysid <= 255:
            raise table.error("sysids", f"{sysid!r} must be a MAVLink system id, 1 to 255")
    key = table.get("key", str)
    table.done()
    if key is None and not unsigned:
        hint = f"'handover keys make {station.name}' makes one; allow_unsigned = true in [vehicle] does without"
        raise table.error("key", f"is missing: anybody could speak as {station.name}; {hint}")
    key_path = None if key is None else folder / key
    return StationLinks(station, checked, frozenset([station.sysid, *extra]), key_path)


def _unique(path: Path, what: str, stations: tuple[StationLinks, ...], vehicle: int) -> None:
    if not stations:
        raise ConfigError(f"{path}: [[{what}]] must be there at least once")
    names, links = set(), set()
    ids = {vehicle: "the vehicle"}
    for entry in stations:
        if entry.station.name in names:
            raise ConfigError(f"{path}: [[{what}]] name {entry.station.name!r} is given twice")
        names.add(entry.station.name)
        for sysid in sorted(entry.sysids):
            if sysid in ids:
                raise ConfigError(f"{path}: [[{what}]] sysid {sysid} of {entry.station.name} is also {ids[sysid]}'s")
            ids[sysid] = entry.station.name
        for link in entry.links:
            if link in links:
                raise ConfigError(f"{path}: [[{what}]] link {link} is given twice")
            links.add(link)


# ---- the station --------------------------------------------------------------------------------------------------


def load_station(path: Path) -> StationConfig:
    """Read and check a station's configuration. Raises ConfigError."""
    path = path.resolve()
    data = _read(path)
    _tables(data, path, ("station", "ground", "peer"), ("station",))
    table = _Table(data["station"], "station", path)
    station = Station(table.sysid("sysid"), table.name("name"))
    vehicle = table.sysid("vehicle", required=False, default=1)
    consent = table.get("consent", str, "automatic")
    if consent not in ("automatic", "operator"):
        raise table.error("consent", f"{consent!r} must be one of automatic, operator")
    mission = table.get("mission", str)
    key = table.get("key", str)
    journal = table.get("journal", str, f"{station.name}.jsonl")
    table.done()
    if vehicle == station.sysid:
        raise table.error("vehicle", f"{vehicle} is the station's own sysid")
    ground = None
    if "ground" in data:
        ground_table = _Table(data["ground"], "ground", path)
        ground = _link(ground_table, "listen", ground_table.get("listen", str, required=True))
        if not ground.startswith("udpin:"):
            raise ground_table.error("listen", f"{ground!r} must be udpin:HOST:PORT")
        ground_table.done()
    peers = tuple(_peer(entry) for entry in _list_of_tables(data, "peer", path))
    if peers and ground is None:
        raise ConfigError(f"{path}: [ground] is missing; [[peer]] needs a place to listen")
    ids = [station.sysid, vehicle, *(peer.station.sysid for peer in peers)]
    for sysid in ids:
        if ids.count(sysid) > 1:
            raise ConfigError(f"{path}: [[peer]] sysid {sysid} is given twice")
    folder = path.parent
    return StationConfig(
        path=path,
        station=station,
        vehicle=vehicle,
        operator_consents=consent == "operator",
        mission=None if mission is None else (folder / mission).resolve(),
        journal=folder / journal,
        ground=ground,
        peers=peers,
        key=None if key is None else folder / key,
    )


def _peer(table: _Table) -> PeerConfig:
    station = Station(table.sysid("sysid"), table.name("name"))
    link = _link(table, "link", table.get("link", str, required=True))
    if not link.startswith("udpout:"):
        raise table.error("link", f"{link!r} must be udpout:HOST:PORT")
    table.done()
    return PeerConfig(station, link)

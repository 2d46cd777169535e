# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission package: everything that vehicle and stations must agree on before a flight, and nothing secret.

On disk it is a folder: `mission.toml`, the route, the zones. On the way to vehicle and partner stations it is one
block of bytes: the files as a JSON object of name -> text with sorted keys, compressed. The SHA-256 of that JSON is
the package's digest; two packages are equal when their digests are. Only files that `mission.toml` names travel, so a
key lying in the folder stays there.

`addresses.toml` (`mission/addresses.py`) lies beside them and is no part of the mission: no digest, no package bytes.

`from_bytes` reads what came over a radio link: sizes are bounded before anything is unpacked, nothing is written
anywhere, and bytes that are not exactly what `to_bytes` makes of their content are refused.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from mavproxy_handover.core.authority.payload import PayloadRules
from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.addresses import ADDRESSES_FILE, read_addresses
from mavproxy_handover.mission.corridor import covered_area
from mavproxy_handover.mission.errors import Faults, MissionError, Where
from mavproxy_handover.mission.gaps import DeclaredGap, Stretch, read_gaps, stretches
from mavproxy_handover.mission.geojson import read_zones
from mavproxy_handover.mission.items import COMMANDS, TAKEOFFS, MissionItem
from mavproxy_handover.mission.jumps import jumps
from mavproxy_handover.mission.keys import DEFAULT_RALLY_REACH_M, ENERGY, MISSION, POLICY, STATIONS, WINGS
from mavproxy_handover.mission.path import Path as FlownPath
from mavproxy_handover.mission.path import path_of
from mavproxy_handover.mission.payload import read_payload
from mavproxy_handover.mission.plan import FencePart, Route, first_in_air, on_ground, read_route
from mavproxy_handover.mission.returns import with_return
from mavproxy_handover.mission.route_simulation import (
    Leg,
    RouteSimulation,
    commanders_along,
    legs_of,
    simulate_legs,
)
from mavproxy_handover.mission.terrain import Relief, Terrain, read_terrain, relief_of
from mavproxy_handover.mission.waypoint_ownership import Belonging, belonging_of
from mavproxy_handover.mission.wings import Air, Wings
from mavproxy_handover.mission.zones import Zone, ZoneFinder
from mavproxy_handover.vehicle.profiles import ASSUMED, PROFILES, Profile, named
from mavproxy_handover.wire.vehicle_address import Addresses

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = [
    "FILE_NAME",
    "MISSION_FILE",
    "MissionPackage",
    "STATION_NAME",
    "StationEntry",
    "file_names",
    "from_bytes",
    "from_texts",
    "load",
    "read_file",
]

MISSION_FILE = "mission.toml"
#: those for which stations list waypoints
_LISTED = ("waypoints", "reached")

MAX_PACKED_BYTES = 64 * 1024
MAX_PLAIN_BYTES = 1024 * 1024
#: mission.toml is looked at before it is parsed, because a parser's time may grow with the square of a key's parts
MAX_TOML_BYTES = 64 * 1024
MAX_TOML_LINE = 4000
MAX_TOML_DOTS = 100
#: what a number may not have in any file: older Pythons take the square of its digits to read it
_ENDLESS_NUMBER = b"0" * 400
#: digits look alike. Looked for with a regular expression they take a second, in which no other thread gets a turn
_ALIKE = bytes.maketrans(b"123456789", b"000000000")
#: lists and tables, and values in them, in all files together. JSON is parsed in one go too, and so much of it takes
#: less than a tenth of a second
MAX_NESTED, MAX_VALUES = 50_000, 200_000
#: names that are a file in the package's own folder on every system
FILE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,50}(\.[A-Za-z0-9]{1,12}){1,2}")
STATION_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,15}")


@dataclass(frozen=True, slots=True)
class StationEntry:
    """A station of the mission. `sysid`: its MAVLink system id.

    `waypoints`: the items that it covers (detector "waypoints") or that belong to it ("reached").
    """

    name: str
    sysid: int
    waypoints: tuple[int, ...] = ()
    #: where its operator is: latitude and longitude (degrees), height above the ellipsoid (m); None: not named
    place: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MissionPackage:
    """A valid mission. It equals another one if the digests are equal."""

    name: str
    description: str
    #: of aircraft, that flies it
    profile: Profile
    #: in the order of mission.toml; the first is the parent, which starts the flight
    stations: tuple[StationEntry, ...]
    #: "circles", "polygons", "waypoints" or "reached"
    detector: str
    #: one zone a station, in the order of `stations`
    zones: tuple[Zone, ...]
    #: with detector "reached": the station of each waypoint
    belonging: Belonging | None
    route: Route
    #: number that the planner wrote; None: none
    expected_handovers: int | None
    #: a rally point may be this far from the route, metres
    rally_reach_m: float
    #: the speed of the mission, else of its plan, else the autopilot's default; of wings, the airspeed
    cruise_speed_mps: float
    #: True if the mission or its plan names the speed
    cruise_speed_named: bool
    #: item of the route where the delivery happens, if one is named
    delivery_waypoint: int | None
    #: the [policy] table: what the mission decides about emergencies, before the vehicle's own configuration
    policies: Mapping[str, str]
    #: the [payload] table: which station has gimbal, camera and winch, before the vehicle's own configuration
    payload: PayloadRules
    #: gaps in coverage that the mission means to cross
    gaps: tuple[DeclaredGap, ...]
    #: the [energy] table: what the aircraft draws and holds, before the vehicle's own configuration
    energy: EnergySettings
    #: heights of the ground, where the mission brings any
    terrain: Terrain | None
    #: the files of the package by name, line ends as \\n
    files: Mapping[str, bytes] = field(repr=False)
    #: SHA-256 of the canonical form, 32 bytes
    digest: bytes
    #: where each station reaches the vehicle, by its system id; no part of the digest
    addresses: Addresses = field(default_factory=lambda: MappingProxyType({}))
    #: what is wrong with the file of the addresses, with file and place; "" if nothing is
    addresses_fault: str = ""

    @property
    def parent(self) -> StationEntry:
        """The station that starts the flight."""
        return self.stations[0]

    def station(self, sysid: int) -> StationEntry | None:
        """The station with that system id, None when the mission has none."""
        return next((station for station in self.stations if station.sysid == sysid), None)

    def zone_finder(self) -> ZoneFinder:
        """A finder over the zones of the package."""
        return ZoneFinder(self.zones)

    def relief(self, home: tuple[float, float] | None = None) -> Relief | None:
        """The ground, as far as the mission knows it, with heights above `home`, None: above the plan's."""
        return relief_of(self.terrain, self.route.home, home)

    def air(self, wind: Wind | None = None) -> Air:
        """Air for wings. `wind` None: unknown, and the wind of [energy] may come from any direction."""
        # only the assumed unknown wind is needed
        model = self.energy.over(EnergySettings(battery_wh=1.0, hover_w=10.0)).model()
        assert model is not None
        return Air(self.cruise_speed_mps, wind, model.headwind_mps)

    def path(self, wind: Wind | None = None) -> FlownPath | None:
        """The path that wings fly in that wind, see `air`; None: the aircraft has none."""
        return path_of(self.route, self.air(wind)) if self.profile.flies_past else None

    def path_on_other_side(self, wind: Wind | None = None) -> FlownPath | None:
        """Without sideslip, and with turns about to the left: what wings fly is between `path` and this one."""
        return path_of(self.route, self.air(wind), sideslip=False, about=-1.0) if self.profile.flies_past else None

    def legs(self, wind: Wind | None = None) -> tuple[Leg, ...]:
        """The flown path as straight pieces: the lines of the route, or the path of wings."""
        path = self.path(wind)
        return legs_of(self.route, self.cruise_speed_mps) if path is None else path.legs

    def simulate(self, wind: Wind | None = None) -> RouteSimulation:
        """What is flown, walked through the zones: commanders in order, handovers, gaps. `wind`: see `air`; copters are
        walked without it."""
        if self.profile.flies_past:
            finder = self.zone_finder()
            return simulate_legs(self.legs(wind), finder, self.parent.sysid, belonging=self.belonging)
        return commanders_along(
            self.route,
            self.zone_finder(),
            self.parent.sysid,
            cruise_speed_mps=self.cruise_speed_mps,
            belonging=self.belonging,
        )

    def stretches(self, simulation: RouteSimulation, wind: Wind | None = None) -> tuple[Stretch, ...]:
        """The declared gaps on the simulated route. `wind` None: that of [energy] for an unknown wind."""
        stops = not self.profile.flies_past
        return stretches(self.gaps, self.legs(wind), simulation, self.energy, wind, stops=stops)

    def with_mission(
        self, items: tuple[MissionItem, ...], fence: tuple[FencePart, ...], cruise_mps: float
    ) -> MissionPackage:
        """Zones, stations and policies of this package, with the mission and geofence that the autopilot has on the
        ground.

        Its first item is home. Its speed (m/s) is the autopilot's, too. Waypoints of stations, declared gaps and the
        delivery belong to the package's own mission. The digest stays, because stations compare it, and their package
        has not changed. Raises MissionError.
        """
        route = on_ground(self.route, items, fence)
        route = replace(route, ground=relief_of(self.terrain, route.home))
        return replace(
            self,
            route=with_return(route, self.zones, self.terrain),
            belonging=None,
            gaps=(),
            delivery_waypoint=None,
            cruise_speed_mps=cruise_mps,
            cruise_speed_named=False,
            energy=self.energy.over(_flown_at(cruise_mps)) if self.profile.energy.holds_airspeed else self.energy,
        )

    def with_addresses(self, addresses: Addresses) -> MissionPackage:
        """Copy of this package with these addresses, as far as they are for its own stations."""
        own = {sysid: found for sysid, found in addresses.items() if self.station(sysid) is not None}
        return replace(self, addresses=MappingProxyType(own))

    def to_bytes(self) -> bytes:
        """The package as it travels, at most 64 KiB; `from_bytes` makes an equal package of it."""
        return zlib.compress(_plain_form(self.files), 9)

    def __eq__(self, other: object) -> bool:
        return self.digest == other.digest if isinstance(other, MissionPackage) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.digest)


def load(folder: str | Path) -> MissionPackage:
    """Read the mission package in `folder`, with its addresses. Raises MissionError, also for files that cannot be
    read. A fault of the addresses does not raise: the package has none then, and says why (`addresses_fault`)."""
    folder = Path(folder)
    mission_text = read_file(folder, MISSION_FILE)
    texts = {MISSION_FILE: mission_text}
    for name in _referenced(_toml(mission_text)):
        texts[name] = read_file(folder, name)
    package = from_texts(texts, str(folder))
    if not os.path.lexists(folder / ADDRESSES_FILE):
        return package
    try:
        return replace(package, addresses=_addresses(folder, package))
    except MissionError as fault:
        return replace(package, addresses_fault=str(fault))


def file_names(folder: str | Path) -> tuple[str, ...]:
    """The names of the files of the mission package in `folder`: those that travel, and the one of the addresses.

    Raises MissionError if mission.toml cannot be read."""
    folder = Path(folder)
    names = [MISSION_FILE, *_referenced(_toml(read_file(folder, MISSION_FILE)))]
    if os.path.lexists(folder / ADDRESSES_FILE):
        names.append(ADDRESSES_FILE)
    return tuple(dict.fromkeys(names))


def from_texts(texts: Mapping[str, str], source: str) -> MissionPackage:
    """The package of these files, by name: mission.toml and those that it names. Raises MissionError; `source` is for
    its words."""
    package = _build(texts)
    if len(package.to_bytes()) > MAX_PACKED_BYTES:
        raise MissionError(f"{source}: larger than {MAX_PACKED_BYTES} bytes when packed: it could not be sent")
    return package


def from_bytes(data: bytes) -> MissionPackage:
    """Read a package that came over a link. Raises MissionError and nothing else, whatever the bytes."""
    where = Where("mission package")
    if len(data) > MAX_PACKED_BYTES:
        raise where.error(f"{len(data)} bytes (allowed: at most {MAX_PACKED_BYTES})")
    unpacker = zlib.decompressobj()
    try:
        plain = unpacker.decompress(data, MAX_PLAIN_BYTES + 1)
    except zlib.error:
        raise where.error("not compressed data") from None
    if len(plain) > MAX_PLAIN_BYTES:
        raise where.error(f"more than {MAX_PLAIN_BYTES} bytes when unpacked")
    if _ENDLESS_NUMBER in plain.translate(_ALIKE):
        raise where.error("a number of hundreds of digits")
    if plain.count(b"[") + plain.count(b"{") > MAX_NESTED:
        raise where.error(f"more than {MAX_NESTED} lists and tables")
    if plain.count(b",") > MAX_VALUES:
        raise where.error(f"more than {MAX_VALUES} values")
    if not unpacker.eof or unpacker.unused_data:
        raise where.error("cut short, or something follows it")
    try:
        texts = json.loads(plain)
    except (ValueError, RecursionError):
        raise where.error("not JSON") from None
    if not isinstance(texts, dict) or not all(isinstance(text, str) for text in texts.values()):
        raise where.error("not files by name")
    for name in texts:
        _file_name(where, name, "a file")
    if MISSION_FILE not in texts:
        raise where.error(f"no {MISSION_FILE} in it")
    try:
        canonical = _plain_form({name: text.encode() for name, text in texts.items()}) == plain
    except UnicodeEncodeError:
        canonical = False
    if not canonical:
        raise where.error("not in the canonical form")
    wanted = {MISSION_FILE, *_referenced(_toml(texts[MISSION_FILE]))}
    for name in sorted(wanted ^ texts.keys()):
        problem = "is missing" if name in wanted else "is not named in mission.toml"
        raise where.error(f"file '{name}' {problem}")
    return _build(texts)


def _addresses(folder: Path, package: MissionPackage) -> Addresses:
    """Raises MissionError."""
    file = str(folder / ADDRESSES_FILE)
    table = _toml(read_file(folder, ADDRESSES_FILE), file)
    return MappingProxyType(read_addresses(table, {each.name: each.sysid for each in package.stations}, file))


def _plain_form(files: Mapping[str, bytes]) -> bytes:
    texts = {name: text.decode() for name, text in files.items()}
    return json.dumps(texts, sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode()


def read_file(folder: Path, name: str) -> str:
    """The text of a file of a mission, with one form of line ends. Raises MissionError."""
    path = folder / name
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_PLAIN_BYTES + 1)
    except OSError as error:
        raise MissionError(f"{path}: {error.strerror or 'cannot be read'}") from None
    if len(data) > MAX_PLAIN_BYTES:
        raise MissionError(f"{path}: larger than {MAX_PLAIN_BYTES} bytes")
    try:
        # one form of line ends and no byte order mark: a checkout on another system is the same mission
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise MissionError(f"{path}: not UTF-8 text (byte {error.start})") from None


def _toml(text: str, file: str = MISSION_FILE) -> Mapping[str, object]:
    where = Where(file)
    if len(text) > MAX_TOML_BYTES:
        raise where.error(f"{len(text)} characters (allowed: at most {MAX_TOML_BYTES})")
    for number, line in enumerate(text.splitlines(), 1):
        if len(line) > MAX_TOML_LINE:
            raise where.error(f"line {number}: {len(line)} characters (allowed: at most {MAX_TOML_LINE})")
        if line.count(".") > MAX_TOML_DOTS:
            raise where.error(f"line {number}: {line.count('.')} dots (allowed: at most {MAX_TOML_DOTS})")
    try:
        table: Mapping[str, object] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise where.error(f"not TOML: {error}") from None
    except (ValueError, RecursionError):
        raise where.error("not TOML that a mission can hold (a number or a nesting out of all bounds)") from None
    return table


def _file_name(where: Where, value: object, name: str) -> str:
    if not isinstance(value, str) or not FILE_NAME.fullmatch(value):
        raise where.error(f"{name} is not a plain file name (allowed: letters, digits, _ and -, an ending, no folder)")
    return value


def _referenced(mission: Mapping[str, object]) -> list[str]:
    where = Where(MISSION_FILE)
    names = [_file_name(where, where.need(mission, "route"), "route")]
    if "zones" in mission:
        names.append(_file_name(where, mission["zones"], "zones"))
    if "terrain" in mission:
        names.append(_file_name(where, mission["terrain"], "terrain"))
    return names


def _build(texts: Mapping[str, str]) -> MissionPackage:
    """Check the files against each other; raises MissionError with the faults of all files."""
    where = Where(MISSION_FILE)
    mission = _toml(texts[MISSION_FILE])
    detector = where.of_key(MISSION["detector"], where.need(mission, "detector"))
    profile = named(where.of_key(MISSION["aircraft"], mission.get("aircraft", ASSUMED.name)))
    faults = Faults()
    faults.get(lambda: where.known_keys(mission, MISSION.names))
    name = faults.get(lambda: where.text(where.need(mission, "name"), "name", 40))
    description = faults.get(lambda: _description(where, mission.get("description")))
    stations = faults.get(lambda: _stations(where, where.need(mission, "stations"), detector))
    expected = faults.get(lambda: _expected(where, mission.get("expected_handovers")))
    reach = mission.get("rally_reach_m", DEFAULT_RALLY_REACH_M)
    rally_reach_m = faults.get(lambda: where.of_key(MISSION["rally_reach_m"], reach))
    policies = faults.get(lambda: _policies(where, mission.get("policy", {})))
    energy = faults.get(lambda: _energy(where, mission.get("energy", {})))
    named_stations = tuple(station.name for station in stations or ())
    payload = faults.get(lambda: read_payload(where, mission.get("payload", {}), named_stations))
    wings = faults.get(lambda: _wings(where, mission.get("wings"), profile))
    terrain = faults.get(lambda: _terrain(mission.get("terrain"), texts))
    route = faults.get(lambda: _route(where, mission, texts, profile, detector))
    faults.raise_all()
    # without a fault nothing is missing
    assert name is not None
    assert rally_reach_m is not None
    assert description is not None
    assert stations is not None
    assert policies is not None
    assert energy is not None
    assert payload is not None
    assert wings is not None
    assert route is not None
    route = replace(route, wings=wings, ground=relief_of(terrain, route.home))
    speed = mission.get("cruise_speed_mps", route.cruise_speed_mps or profile.energy.cruise_mps)
    speed_mps = where.of_key(MISSION["cruise_speed_mps"], speed)
    files = {name: text.encode() for name, text in texts.items()}
    listed = [(station.sysid, station.waypoints) for station in stations]
    belonging = belonging_of(where, route, listed) if detector == "reached" else None
    zones = _zones(where, mission, texts, detector=detector, stations=stations, route=route, belonging=belonging)
    package = MissionPackage(
        name=name,
        description=description,
        profile=profile,
        stations=stations,
        detector=detector,
        zones=zones,
        belonging=belonging,
        route=with_return(route, zones, terrain),
        expected_handovers=expected,
        rally_reach_m=rally_reach_m,
        cruise_speed_mps=speed_mps,
        cruise_speed_named="cruise_speed_mps" in mission or route.cruise_speed_mps is not None,
        delivery_waypoint=_delivery(where, mission.get("delivery_waypoint"), route),
        policies=policies,
        payload=payload,
        gaps=read_gaps(where, mission.get("gap", []), {each.name: each.sysid for each in stations}, route),
        energy=energy.over(_flown_at(speed_mps)) if profile.energy.holds_airspeed else energy,
        terrain=terrain,
        files=MappingProxyType(files),
        digest=hashlib.sha256(_plain_form(files)).digest(),
    )
    _check_leaves(Where(str(mission["route"])), package)
    return package


def _check_leaves(where: Where, package: MissionPackage) -> None:
    """Check that the route leads anywhere: a take-off does. Raises MissionError."""
    first = first_in_air(package.route.items)
    if (first is None or first.command not in TAKEOFFS) and not any(leg.size_m > 0.0 for leg in package.legs()):
        raise where.error(
            "nothing is flown: the aircraft stays at home (allowed: at least one item that leads away, or up)"
        )


def _route(
    where: Where, mission: Mapping[str, object], texts: Mapping[str, str], profile: Profile, detector: str
) -> Route:
    file = str(mission["route"])
    endless = where.of_key(MISSION["endless_jump"], mission.get("endless_jump", False))
    route = read_route(file, texts[file], profile, endless=endless)
    if detector == "reached" and jumps(route.items):
        raise where.error("detector 'reached' does not go with DO_JUMP (a waypoint would belong to more than one way)")
    return route


def _description(where: Where, value: object) -> str:
    return "" if value is None else where.text(value, "description", 400)


def _terrain(name: object, texts: Mapping[str, str]) -> Terrain | None:
    return None if name is None else read_terrain(str(name), texts[str(name)])


def _stations(where: Where, value: object, detector: str) -> tuple[StationEntry, ...]:
    entries = where.array(value, "stations")
    if not entries:
        raise where.error("no stations (allowed: 1 or more, the parent first)")
    found: list[StationEntry] = []
    for number, entry in enumerate(entries, 1):
        inside = where.at(f"station {number}")
        table = inside.table(entry, "the station")
        inside.known_keys(table, STATIONS.names if detector in _LISTED else ("name", "sysid", "place"))
        name = inside.need(table, "name")
        if not isinstance(name, str) or not STATION_NAME.fullmatch(name):
            raise inside.error("name is not a station's name (allowed: 1 to 16 letters, digits, - and _)")
        sysid = inside.of_key(STATIONS["sysid"], inside.need(table, "sysid"))
        for other in found:
            if other.name == name:
                raise inside.error(f"name '{name}' is taken by another station")
            if other.sysid == sysid:
                raise inside.error(f"sysid {sysid} is taken by station '{other.name}'")
        waypoints: tuple[int, ...] = ()
        if detector in _LISTED:
            listed = inside.array(inside.need(table, "waypoints"), "waypoints")
            if not listed:
                raise inside.error("no waypoints (allowed: 1 or more items of the route)")
            waypoints = tuple(inside.whole(item, "a waypoint", 1, 65535) for item in listed)
        place = None if "place" not in table else _operator_place(inside, table["place"])
        found.append(StationEntry(name, sysid, waypoints, place))
    return tuple(found)


def _operator_place(where: Where, value: object) -> tuple[float, float, float]:
    """The place of a station's operator. Raises MissionError."""
    numbers = where.array(value, "place")
    if len(numbers) != 3:
        raise where.error(
            f"place has {len(numbers)} numbers (allowed: latitude, longitude, height above the ellipsoid)"
        )
    lat, lon, height = numbers
    return (
        where.number(lat, "latitude of place", -90.0, 90.0),
        where.number(lon, "longitude of place", -180.0, 180.0),
        where.number(height, "height of place", -500.0, 9000.0),
    )


def _zones(
    where: Where,
    mission: Mapping[str, object],
    texts: Mapping[str, str],
    *,
    detector: str,
    stations: tuple[StationEntry, ...],
    route: Route,
    belonging: Belonging | None,
) -> tuple[Zone, ...]:
    home = (route.home.lat_deg, route.home.lon_deg)
    if detector in _LISTED:
        if "zones" in mission:
            raise where.error(f"key 'zones' does not go with detector '{detector}' (the zones follow the route)")
        width = where.of_key(MISSION["corridor_m"], where.need(mission, "corridor_m"))
        return tuple(
            Zone(
                station.sysid,
                station.name,
                covered_area(
                    where.at(f"station {number}"),
                    route,
                    station.waypoints if belonging is None else belonging.covers(station.sysid, route),
                    width,
                ),
            )
            for number, station in enumerate(stations, 1)
        )
    if "corridor_m" in mission:
        listed = ", ".join(f"'{each}'" for each in _LISTED)
        raise where.error(f"key 'corridor_m' does not go with detector '{detector}' (allowed: with {listed})")
    zones_file = str(where.need(mission, "zones"))
    ids = {station.name: station.sysid for station in stations}
    return read_zones(zones_file, texts[zones_file], ids, detector, home)


def _expected(where: Where, value: object) -> int | None:
    return None if value is None else int(where.of_key(MISSION["expected_handovers"], value))


def _delivery(where: Where, value: object, route: Route) -> int | None:
    if value is None:
        return None
    seq = where.whole(value, "delivery_waypoint", 1, len(route.items))
    command = COMMANDS[route.items[seq - 1].command]
    if not command.flown:
        raise where.error(f"delivery_waypoint {seq} is {command.name} (allowed: an item that is flown to)")
    return seq


def _policies(where: Where, value: object) -> Mapping[str, str]:
    inside = where.at("[policy]")
    table = inside.table(value, "policy")
    inside.known_keys(table, POLICY.names)
    return MappingProxyType({key: inside.of_key(POLICY[key], word) for key, word in table.items()})


def _wings(where: Where, value: object, profile: Profile) -> Wings:
    if value is None:
        return Wings()
    if not profile.flies_past:
        allowed = ", ".join(each.name for each in PROFILES if each.flies_past)
        raise where.error(f"[wings] does not go with aircraft '{profile.name}' (allowed: with {allowed})")
    inside = where.at("[wings]")
    table = inside.table(value, "wings")
    inside.known_keys(table, WINGS.names)
    return Wings(**{key: inside.of_key(WINGS[key], number) for key, number in table.items()})


def _flown_at(speed_mps: float) -> EnergySettings:
    """Wings fly at their airspeed, where [energy] says nothing else."""
    return EnergySettings(cruise_mps=speed_mps, airspeed_mps=speed_mps)


def _energy(where: Where, value: object) -> EnergySettings:
    inside = where.at("[energy]")
    table = inside.table(value, "energy")
    inside.known_keys(table, ENERGY.names)
    settings = EnergySettings(**{key: inside.of_key(ENERGY[key], value) for key, value in table.items()})
    if settings.payload_wrong:
        raise inside.error(f"payload_kg: {settings.payload_wrong}")
    return settings

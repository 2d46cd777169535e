# SPDX-License-Identifier: GPL-3.0-or-later

"""The connections of a simulation: ports, configuration files, command lines.

    vehicle  <- TCP ->  companion  - UDP ->  each station's own ports (the station listens, the companion speaks first)
    station  - UDP ->  every other station's ground port

Stations may be on computers of their own (`sites.py`): addresses and command lines are then those of these computers.

If the scenario asks for it, a position box stands beside the vehicle: it has a port of the vehicle's own, and the
companion connects to it.

If the scenario asks for it, a station has no link to the vehicle: the companion listens for it, and its address is in
`addresses.toml` of the mission that the parent shares.

If the scenario asks for it, a serial line with noise replaces the vehicle's or a station's link. The proxy or the rogue
can stand in the links, too: both listen where the one end sends and pass on to where the other one listens. The files
are the ones of a real vehicle and a real station, and the command lines are those of `handover companion` and `handover
station`: the same programs fly here and there.
"""

from __future__ import annotations

import json
import secrets
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from mavproxy_handover.cli.keys import GROUND
from mavproxy_handover.cli.launch import station_argv, supervised_argv
from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.addresses import ADDRESSES_FILE
from mavproxy_handover.mission.package import MissionPackage, StationEntry
from mavproxy_handover.store.keys import key_path, write_key
from sitl.run import panel_driver
from sitl.run.bad_disks import on_slow_disk
from sitl.run.fleet import FIRST, Craft, first_of
from sitl.run.line_listener import LISTENER
from sitl.run.sites import HERE, Reach, Site
from sitl.run.transponder import TRANSPONDER
from sitl.script.places import SetupError, mission_folder
from sitl.script.scenario import AUTOPILOT, Scenario, panel_of, program_of
from sitl.script.weather import Weather
from sitl.vehicles.ports import LOOPBACK, PortPicker

__all__ = [
    "BOX",
    "COMPANION",
    "COMPANION_NAME",
    "IMPAIRMENT",
    "LINES",
    "ROGUE",
    "Program",
    "StationWires",
    "Wiring",
    "lay_out",
    "write_toml",
]

#: name of the companion's process, and its name in journals
COMPANION, COMPANION_NAME = "companion", FIRST[0]
#: names of the processes that stand in links
IMPAIRMENT, ROGUE, LINES = "impairment", "rogue", "lines"
#: name of the program on the companion, and its component
ONBOARD, ONBOARD_COMPONENT = "onboard", 25
#: name of the position box's process
BOX = "box"
SYSID = FIRST[1]
#: system id of a program that flies through a station, as most programs come
SERVED_SYSID = 255
#: files in the folder of each of our stations that MAVProxy can be told to load, one of them an unused mission
_TO_LOAD = {
    "other.waypoints": """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t52.679\t5.924\t0\t1
1\t0\t3\t22\t0\t0\t0\t0\t52.679\t5.924\t30\t1
""",
    "other.parm": "FS_OPTIONS 0\n",
}


@dataclass(frozen=True, slots=True)
class Program:
    """A process to start: `journal` is None for one that keeps none and says "ready" on its console instead."""

    name: str
    argv: tuple[str, ...]
    folder: Path
    journal: Path | None = None


@dataclass(frozen=True, slots=True)
class StationWires:
    """A station's files and addresses. `masters` is where it listens for the vehicle, one for each link; one that has a
    serial line, `line` as MAVProxy names it, has no other. Without both it gets the vehicle's address with a mission.
    """

    name: str
    sysid: int
    folder: Path
    config: Path
    masters: tuple[int, ...]
    standard: bool
    key: Path | None = None
    line: str = ""
    #: the program of a standard station; empty: ours
    instead: tuple[str, ...] = ()
    #: its configuration names the links, because there are several vehicles
    fleet: bool = False
    #: its own address for each of `masters`; empty: the loopback address for all of them
    addresses: tuple[str, ...] = ()
    #: words before its command line
    under: tuple[str, ...] = ()

    @property
    def journal(self) -> Path:
        """Its journal."""
        return self.folder / f"{self.name}.jsonl"

    def program(self) -> Program:
        """The program of this station, with its command line."""
        if self.standard:
            argv = [*self.instead] if self.instead else [sys.executable, "-m", "sitl.run.standard_gcs"]
            argv += ["--name", self.name, "--sysid", str(self.sysid)]
            argv += ["--vehicle", str(SYSID), "--listen", str(self.masters[0]), "--journal", str(self.journal)]
            argv += [] if self.key is None else ["--key", str(self.key)]
        elif self.fleet:
            argv = station_argv(self.config, None, self.folder / f"{self.name}.tlog")
        else:
            addresses = self.addresses or (LOOPBACK,) * len(self.masters)
            listens = [f"udpin:{address}:{port}" for address, port in zip(addresses, self.masters, strict=True)]
            links = [self.line] if self.line else listens
            first, others = next(iter(links), None), links[1:]
            argv = station_argv(self.config, first, self.folder / f"{self.name}.tlog")
            argv += [f"--master={other}" for other in others]
        return Program(self.name, (*self.under, *argv), self.folder, self.journal)


@dataclass(frozen=True, slots=True)
class Wiring:
    """All files and addresses of a run."""

    folder: Path
    companion_config: Path
    stations: tuple[StationWires, ...]
    #: in the order in which they are to be started, before companion and stations
    between: tuple[Program, ...] = ()
    #: links that go through the proxy
    impaired: tuple[str, ...] = ()
    #: what lies on the autopilot's card beside the guard
    card: tuple[Path, ...] = ()
    #: words before the companion's command line
    companion_under: tuple[str, ...] = ()
    #: what the companion opens instead of the autopilot's port, as MAVProxy names it: a serial line, or the listener's
    line: str = ""
    #: configurations of the further vehicles' companions, by vehicle
    others: Mapping[str, Path] = field(default_factory=dict)

    def other(self, name: str, master: str) -> Program:
        """A further vehicle's companion, supervised, with its autopilot at `master`."""
        config = self.others[name]
        home = config.parent
        return Program(
            name, tuple(supervised_argv(config, master, home / f"{name}.tlog")), home, home / f"{COMPANION}.jsonl"
        )

    def programs_between(self, master: str, truth: str) -> tuple[Program, ...]:
        """The programs in links and beside the vehicle; `master`: the autopilot's port, `truth`: another one of it."""
        port = ("--autopilot", master.rsplit(":", 1)[1]) if self.line else ()
        truth_port = truth.rsplit(":", 1)[1]
        more = {LINES: port, LISTENER: port, BOX: ("--vehicle", truth), TRANSPONDER: ("--autopilot", truth_port)}
        return tuple(replace(program, argv=(*program.argv, *more.get(program.name, ()))) for program in self.between)

    def companion(self, master: str) -> Program:
        """The companion, supervised, with the autopilot at `master`."""
        home = self.companion_config.parent
        argv = supervised_argv(self.companion_config, self.line or master, home / f"{COMPANION}.tlog")
        return Program(COMPANION, (*self.companion_under, *argv), home, home / f"{COMPANION}.jsonl")


class _Between:
    """Puts proxies, serial lines and the rogue in links while those are laid."""

    def __init__(self, folder: Path, ports: PortPicker, scenario: Scenario) -> None:
        self._home = folder / LINES
        self._ports = ports
        self._scenario = scenario
        self.lines: list[dict[str, Any]] = []
        self.proxies: list[dict[str, Any]] = []
        self.taps: list[dict[str, Any]] = []
        #: station -> port of the program that flies through it
        self.served = {name: ports.udp() for name in scenario.served}
        #: port of the link of the program on the companion, if there is one
        self.onboard = ports.udp() if scenario.onboard else 0
        #: port of the listener on the autopilot's line, if there is one
        self.listener = ports.tcp() if scenario.listen else 0

    @property
    def master(self) -> str:
        """The listener's address for the companion; "": it opens the autopilot's own port."""
        return f"tcp:{LOOPBACK}:{self.listener}" if self.listener else ""

    def _impaired(self, kind: str) -> bool:
        return self._scenario.impair is not None and kind in self._scenario.impair.links

    def air(self, station: str, name: str, target: int) -> int:
        """Where the companion sends for a link that ends at `target`."""
        if self._impaired("air"):
            self.proxies.append({"name": name, "listen": self._ports.udp(), "target": target})
            target = self.proxies[-1]["listen"]
        if station in self._scenario.rogue:
            self.taps.append({"name": station, "listen": self._ports.udp(), "target": target})
            target = self.taps[-1]["listen"]
        return target

    def ground(self, name: str, target: int) -> int:
        """Where one station sends to reach another one at `target`."""
        if not self._impaired("ground"):
            return target
        self.proxies.append({"name": name, "listen": self._ports.udp(), "target": target})
        listen: int = self.proxies[-1]["listen"]
        return listen

    def line(self, name: str) -> tuple[Path, Path, int] | None:
        """The serial line to a station or the autopilot: the vehicle's end, the other end, the rate. None: it has
        none."""
        serial = next((lines for lines in self._scenario.serial if name in lines.lines), None)
        if serial is None:
            return None
        near, far = self._home / f"vehicle-{name}", self._home / name
        ends = {"near": str(near)} if name == AUTOPILOT else {"near": str(near), "far": str(far)}
        noise = {"seed": serial.seed, "damage": serial.damage, "bursts_per_s": serial.bursts_per_s}
        self.lines.append({"name": name, **ends, "baud": serial.baud, **noise})
        return near, far, serial.baud

    def programs(self, folder: Path, grounds: list[dict[str, Any]], onboard: Sequence[str] = ()) -> tuple[Program, ...]:
        """Proxy, rogue and the program on the companion. `grounds`: what the rogue knows of the stations' ground links.
        `onboard`: the program that is tried as the one on the companion; empty: ours. Raises OSError.
        """
        programs = []
        if self.proxies:
            assert self._scenario.impair is not None
            weather = asdict(replace(Weather(), **dict(self._scenario.impair.match.values)))
            links = [{**proxy, "up": weather, "down": weather} for proxy in self.proxies]
            home = folder / IMPAIRMENT
            config = write_toml(home / f"{IMPAIRMENT}.toml", {"link": links}, {"seed": self._scenario.impair.seed})
            argv = (sys.executable, "-m", "sitl.run.bad_links", "--config", str(config))
            programs.append(Program(IMPAIRMENT, argv, home))
        if self.lines:
            config = write_toml(self._home / f"{LINES}.toml", {"line": self.lines})
            argv = (sys.executable, "-m", "sitl.run.noisy_lines", "--config", str(config))
            programs.append(Program(LINES, argv, self._home))
        if self.taps:
            home = folder / ROGUE
            journal = home / f"{ROGUE}.jsonl"
            tables = {"link": self.taps, "ground": grounds, "package": _foreign_package(home, self._scenario.mission)}
            config = write_toml(home / f"{ROGUE}.toml", tables, {"journal": str(journal), "vehicle": SYSID})
            argv = (sys.executable, "-m", "sitl.run.rogue", "--config", str(config))
            programs.append(Program(ROGUE, argv, home, journal))
        if self.onboard:
            home = folder / ONBOARD
            home.mkdir(parents=True, exist_ok=True)
            journal = home / f"{ONBOARD}.jsonl"
            started = (*onboard,) if onboard else (sys.executable, "-m", "sitl.run.onboard")
            options = ("--vehicle", str(SYSID), "--component", str(ONBOARD_COMPONENT), "--port", str(self.onboard))
            programs.append(Program(ONBOARD, (*started, *options, "--journal", str(journal)), home, journal))
        if self.listener:
            home = folder / LISTENER
            journal = home / f"{LISTENER}.jsonl"
            own = {"journal": str(journal), "listen": self.listener, "messages": list(self._scenario.listen)}
            config = write_toml(home / f"{LISTENER}.toml", {}, own)
            argv = (sys.executable, "-m", "sitl.run.line_listener", "--config", str(config))
            programs.append(Program(LISTENER, argv, home, journal))
        if self._scenario.transponder:
            home = folder / TRANSPONDER
            journal = home / f"{TRANSPONDER}.jsonl"
            config = write_toml(home / f"{TRANSPONDER}.toml", {}, {"journal": str(journal), "vehicle": SYSID})
            argv = (sys.executable, "-m", "sitl.run.transponder", "--config", str(config))
            programs.append(Program(TRANSPONDER, argv, home, journal))
        programs += [_served(folder, name, port) for name, port in self.served.items()]
        return tuple(programs)


def _panels(folder: Path, stations: Sequence[StationWires], scenario: Scenario) -> Iterator[Program]:
    """The operators with a panel in a browser. Raises OSError, SetupError."""
    why = panel_driver.why_not() if scenario.panel else ""
    if why:
        raise SetupError(f"scenario {scenario.name} has panels in a browser, and {why}")
    for station in stations:
        if station.name in scenario.panel:
            name = panel_of(station.name)
            home = folder / name
            home.mkdir(parents=True, exist_ok=True)
            journal = home / f"{name}.jsonl"
            argv = [sys.executable, "-m", "sitl.run.panel_driver", "--name", name, "--station", station.name]
            argv += ["--config", str(station.config), "--journal", str(journal)]
            yield Program(name, tuple(argv), home, journal)


def _served(folder: Path, station: str, port: int) -> Program:
    """A program that flies through a station, with the system id that most programs have. Raises OSError."""
    name = program_of(station)
    home = folder / name
    home.mkdir(parents=True, exist_ok=True)
    journal = home / f"{name}.jsonl"
    argv = [sys.executable, "-m", "sitl.run.standard_gcs", "--name", name, "--sysid", str(SERVED_SYSID)]
    argv += ["--vehicle", str(SYSID), "--listen", str(port), "--journal", str(journal)]
    return Program(name, tuple(argv), home, journal)


def lay_out(
    folder: Path,
    package: MissionPackage,
    mission: Path,
    scenario: Scenario,
    instead: Mapping[str, Sequence[str]] | None = None,
    others: Sequence[Craft] = (),
    sites: Mapping[str, Site] | None = None,
) -> Wiring:
    """Write the configuration files of all programs into `folder`. `instead`: see `sitl.run.runner.Order`; `others`:
    further vehicles; `sites`: stations that are on computers of their own.

    Raises OSError, SetupError.
    """
    ports = PortPicker()
    first = first_of(package, mission)
    between = _Between(folder, ports, scenario)
    at = {station.name: (sites or {}).get(station.name, HERE) for station in package.stations}
    ground = {name: site.ground_port or ports.udp() for name, site in at.items()}
    grounds = [{"name": entry.name, "sysid": entry.sysid, "target": ground[entry.name]} for entry in package.stations]
    keys = _make_keys(folder / "keys", package) if scenario.signed else {}
    guard_key, card = _guard_keys(folder, scenario)
    box = f"{LOOPBACK}:{ports.tcp()}" if scenario.box else ""
    entries, stations = [], []
    called = {name: ports.udp() for name in scenario.address}
    if called:
        mission = _with_addresses(folder, mission, called)
    beside = [_Beside.laid(craft, folder, ports, signed=scenario.signed) for craft in others]
    for station in package.stations:
        line = between.line(station.name)
        waits = station.name in called
        labels = () if line or waits else scenario.links.get(station.name, ("",))
        site = at[station.name]
        masters = tuple(site.port or ports.udp() for _ in labels)
        sends = [
            between.air(station.name, f"air-{station.name}" + (f"-{label}" if label else ""), master)
            for label, master in zip(labels, masters, strict=True)
        ]
        reaches = [site.reach(label) for label in labels]
        entry: dict[str, Any] = {
            "name": station.name,
            "sysid": station.sysid,
            "links": [f"serial:{line[0]}:{line[2]}"]
            if line
            else [f"udpin:{LOOPBACK}:{called[station.name]}"]
            if waits
            else list(map(_link, reaches, sends)),
        }
        standard = station.name in scenario.standard
        if standard:
            entry["module"] = False
            if station.name in scenario.consent:
                entry["consent"] = scenario.consent[station.name]
        if station.name in scenario.not_in_control:
            entry["not_in_control"] = scenario.not_in_control[station.name]
        if station.name in keys:
            entry["key"] = str(keys[station.name])
        entries.append(entry)
        home = folder / station.name
        config = home / f"{station.name}.toml"
        if not standard:
            tables = _station(station, package, mission, scenario, keys, ground, between, at)
            if beside:
                tables |= _fleet(
                    tables["station"], [_Beside(first, {station.name: masters[0]}, keys), *beside], station
                )
            config = write_toml(config, tables)
            for name, text in _TO_LOAD.items():
                (home / name).write_text(text, encoding="ascii")
        stations.append(
            StationWires(
                station.name,
                station.sysid,
                home,
                config,
                masters,
                standard,
                keys.get(station.name),
                f"{line[1]},{line[2]}" if line else "",
                tuple((instead or {}).get(station.name, ())),
                bool(beside),
                tuple(reach.address for reach in reaches),
                site.under,
            )
        )
    to_autopilot = between.line(AUTOPILOT)
    return Wiring(
        folder,
        write_toml(
            folder / COMPANION / f"{COMPANION}.toml",
            _vehicle(first, scenario, entries, guard_key, box, between.onboard),
        ),
        tuple(stations),
        (
            *between.programs(folder, grounds, (instead or {}).get(ONBOARD, ())),
            *_boxes(folder, box, scenario),
            *_panels(folder, stations, scenario),
        ),
        tuple(proxy["name"] for proxy in between.proxies),
        card,
        on_slow_disk(folder / COMPANION, scenario.fsync_s) if scenario.fsync_s else (),
        f"{to_autopilot[0]},{to_autopilot[2]}" if to_autopilot else between.master,
        {each.craft.name: each.companion(folder, scenario) for each in beside},
    )


@dataclass(frozen=True, slots=True)
class _Beside:
    """A vehicle's links where there are several: the port at each station, and the stations' keys towards it."""

    craft: Craft
    ports: Mapping[str, int]
    keys: Mapping[str, Path]

    @classmethod
    def laid(cls, craft: Craft, folder: Path, ports: PortPicker, *, signed: bool) -> _Beside:
        """Ports and keys of a further one. Raises OSError."""
        keys = _make_keys(folder / "keys" / craft.name, craft.package) if signed else {}
        return cls(craft, {station.name: ports.udp() for station in craft.package.stations}, keys)

    def companion(self, folder: Path, scenario: Scenario) -> Path:
        """Write its companion's configuration. Raises OSError."""
        entries = []
        for station in self.craft.package.stations:
            links = [f"udpout:{LOOPBACK}:{self.ports[station.name]}"]
            entry: dict[str, Any] = {"name": station.name, "sysid": station.sysid, "links": links}
            entries.append(entry | ({"key": str(self.keys[station.name])} if self.keys else {}))
        tables = _vehicle(self.craft, scenario, entries, None)
        return write_toml(folder / self.craft.name / COMPANION / f"{COMPANION}.toml", tables)


def _link(reach: Reach, port: int) -> str:
    """The device by which the companion calls a station."""
    return f"udpout:{reach.address}:{port}" + (f"@{reach.way}" if reach.way else "")


def _fleet(own: dict[str, Any], vehicles: Sequence[_Beside], station: StationEntry) -> dict[str, Any]:
    """[station] without what is each vehicle's own, and a [[vehicle]] for each."""
    tables = []
    for each in vehicles:
        craft = each.craft
        link = f"udpin:{LOOPBACK}:{each.ports[station.name]}"
        table: dict[str, Any] = {"name": craft.name, "sysid": craft.sysid, "links": [link]}
        table |= {"key": str(each.keys[station.name])} if each.keys else {"allow_unsigned": True}
        if station.name == craft.package.parent.name:
            table["mission"] = str(craft.mission)
        tables.append(table)
    kept = {key: value for key, value in own.items() if key not in ("vehicle", "mission", "key")}
    return {"station": kept, "vehicle": tables}


def _vehicle(
    craft: Craft,
    scenario: Scenario,
    stations: list[dict[str, Any]],
    guard_key: Path | None,
    box: str = "",
    onboard: int = 0,
) -> dict[str, Any]:
    vehicle: dict[str, Any] = {
        "name": craft.name,
        "sysid": craft.sysid,
        "parent": craft.package.parent.name,
        "journal": f"{COMPANION}.jsonl",
        "guard": True,
    }
    if not scenario.signed:
        vehicle["allow_unsigned"] = True
    if scenario.on_board:
        vehicle["mission"] = str(craft.mission)
    if guard_key is not None:
        vehicle["guard_key"] = str(guard_key)
    tables: dict[str, Any] = {"vehicle": vehicle, "station": stations}
    if scenario.limits:
        tables["limits"] = scenario.limits
    if scenario.policy:
        tables["policy"] = scenario.policy
    if scenario.feeds:
        tables["feeds"] = scenario.feeds
    if box:
        tables["position"] = {**scenario.box, "box": f"tcp:{box}"}
    if scenario.payload:
        tables["payload"] = scenario.payload
    if onboard:
        own = {"name": ONBOARD, "link": f"udpin:{LOOPBACK}:{onboard}", "component": ONBOARD_COMPONENT}
        tables["onboard"] = [{**own, **scenario.onboard}]
    return tables


def _boxes(folder: Path, address: str, scenario: Scenario) -> tuple[Program, ...]:
    """The position box, if there is one. It sends the layout that the vehicle's configuration has."""
    layout = ("--layout", str(scenario.box["layout"])) if "layout" in scenario.box else ()
    argv = (sys.executable, "-m", "sitl.run.data_box", "--listen", address, *layout)
    return (Program(BOX, argv, folder / BOX),) if address else ()


def _station(
    station: StationEntry,
    package: MissionPackage,
    mission: Path,
    scenario: Scenario,
    keys: Mapping[str, Path],
    ground: Mapping[str, int],
    between: _Between,
    at: Mapping[str, Site],
) -> dict[str, Any]:
    own: dict[str, Any] = {
        "name": station.name,
        "sysid": station.sysid,
        "vehicle": SYSID,
        "consent": scenario.consent.get(station.name, "automatic"),
        "forced": scenario.forced.get(station.name, "automatic"),
        "journal": f"{station.name}.jsonl",
    }
    if station == package.parent or scenario.on_board:
        own["mission"] = str(mission)
    if station.name in keys:
        own["key"] = str(keys[station.name])
    if station.name in scenario.address:
        own["offered_addresses_local"] = True
    if station.name in scenario.require_operator:
        own["require_operator"] = True
    if station.name in between.served:
        own["serve"] = f"udp:{LOOPBACK}:{between.served[station.name]}"
    peers = []
    for other in package.stations:
        if other == station or other.name in scenario.standard:
            continue
        port = between.ground(f"ground-{station.name}-{other.name}", ground[other.name])
        peers.append({"name": other.name, "sysid": other.sysid, "link": f"udpout:{at[other.name].ground}:{port}"})
    listen: dict[str, Any] = {"listen": f"udpin:{at[station.name].ground}:{ground[station.name]}"}
    listen |= {"key": str(keys[GROUND])} if GROUND in keys else {"allow_unsigned": True}
    return {"station": own, "ground": listen, "peer": peers}


def _with_addresses(folder: Path, mission: Path, called: Mapping[str, int]) -> Path:
    """A copy of the mission that has the vehicle's address for these stations, by port. Raises OSError."""
    copy = Path(shutil.copytree(mission, folder / "shared-mission"))
    write_toml(
        copy / ADDRESSES_FILE, {"vehicle": {name: [f"udpout:{LOOPBACK}:{port}"] for name, port in called.items()}}
    )
    return copy


def _make_keys(folder: Path, package: MissionPackage) -> dict[str, Path]:
    """A new key for each station, and one for the ground link."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {name: key_path(folder, name) for name in (*(station.name for station in package.stations), GROUND)}
    for path in paths.values():
        write_key(path, secrets.token_bytes(32))
    return paths


def _foreign_package(home: Path, flown: str) -> dict[str, str]:
    """A mission that is not the one that is flown, for the rogue to send. Raises OSError, MissionError."""
    package = packages.load(mission_folder("linear" if flown != "linear" else "delivery"))
    home.mkdir(parents=True, exist_ok=True)
    file = home / "stranger.bin"
    file.write_bytes(package.to_bytes())
    return {"file": str(file), "digest": package.digest.hex(), "name": package.name}


def _guard_keys(folder: Path, scenario: Scenario) -> tuple[Path | None, tuple[Path, ...]]:
    """The companion's file of the guard's key, and what lies on the card: the same key or another one."""
    if not scenario.guard_key:
        return None, ()
    own, card = key_path(folder / "keys", "guard"), folder / "card" / "handover.key"
    for path in (own, card):
        path.parent.mkdir(parents=True, exist_ok=True)
    key = secrets.token_bytes(32)
    write_key(own, key)
    write_key(card, key if scenario.guard_key == "same" else secrets.token_bytes(32))
    return own, (card,)


def write_toml(path: Path, tables: Mapping[str, Any], head: Mapping[str, Any] | None = None) -> Path:
    """Write a file of tables and lists of tables; `head`: what stands before them. Raises OSError."""
    lines: list[str] = [f"{key} = {_toml(entry)}" for key, entry in (head or {}).items()]
    for name, value in tables.items():
        for table in value if isinstance(value, list) else [value]:
            lines.append(f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
            lines += [f"{key} = {_toml(entry)}" for key, entry in table.items()]
            lines.append("")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _toml(value: Any) -> str:
    """JSON's numbers, texts, truth values and lists of them are TOML's as well; a table is written in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False)

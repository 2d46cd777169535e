# SPDX-License-Identifier: GPL-3.0-or-later

"""Who is connected to whom in a simulation: ports, configuration files, command lines.

    vehicle  <- TCP ->  companion  - UDP ->  each station's own port (the station listens, the companion speaks first)
    station  - UDP ->  every other station's ground port

The files are the ones a real vehicle and a real station have, and the command lines are those of `handover companion`
and `handover station`: what flies here is what flies there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mavproxy_handover.mission.package import MissionPackage
from sitl.ports import LOOPBACK, PortPicker
from sitl.scenario import Scenario

__all__ = ["COMPANION", "COMPANION_NAME", "StationWires", "Wiring", "lay_out"]

#: name of the companion's process, and its name in journals
COMPANION, COMPANION_NAME = "companion", "drone-1"
SYSID = 1


@dataclass(frozen=True, slots=True)
class StationWires:
    """A station's files and addresses. `master` is where its MAVProxy listens."""

    name: str
    config: Path
    master: str
    journal: Path
    tlog: Path


@dataclass(frozen=True, slots=True)
class Wiring:
    """All files and addresses of a run."""

    companion_config: Path
    companion_journal: Path
    companion_tlog: Path
    stations: tuple[StationWires, ...]


def lay_out(folder: Path, package: MissionPackage, mission: Path, scenario: Scenario) -> Wiring:
    """Write the configuration files of companion and stations into `folder`. Raises OSError."""
    ports = PortPicker()
    vehicle_ports = {station.name: ports.udp() for station in package.stations}
    ground_ports = {station.name: ports.udp() for station in package.stations}
    companion = folder / COMPANION
    vehicle: dict[str, Any] = {
        "name": COMPANION_NAME,
        "sysid": SYSID,
        "parent": package.parent.name,
        "journal": f"{COMPANION}.jsonl",
        "guard": True,
    }
    links = [
        {"name": station.name, "sysid": station.sysid, "links": [f"udpout:{LOOPBACK}:{vehicle_ports[station.name]}"]}
        for station in package.stations
    ]
    tables: dict[str, Any] = {"vehicle": vehicle, "station": links}
    if scenario.limits:
        tables["limits"] = scenario.limits
    if scenario.policy:
        tables["policy"] = scenario.policy
    companion_config = _write(companion / "companion.toml", tables)
    stations = []
    for station in package.stations:
        own = {
            "name": station.name,
            "sysid": station.sysid,
            "vehicle": SYSID,
            "consent": scenario.consent.get(station.name, "automatic"),
            "journal": f"{station.name}.jsonl",
        }
        if station == package.parent:
            own["mission"] = str(mission)
        peers = [
            {"name": other.name, "sysid": other.sysid, "link": f"udpout:{LOOPBACK}:{ground_ports[other.name]}"}
            for other in package.stations
            if other != station
        ]
        ground = {"listen": f"udpin:{LOOPBACK}:{ground_ports[station.name]}"}
        home = folder / station.name
        config = _write(home / f"{station.name}.toml", {"station": own, "ground": ground, "peer": peers})
        stations.append(
            StationWires(
                station.name,
                config,
                f"udpin:{LOOPBACK}:{vehicle_ports[station.name]}",
                home / f"{station.name}.jsonl",
                home / f"{station.name}.tlog",
            )
        )
    return Wiring(companion_config, companion / f"{COMPANION}.jsonl", companion / f"{COMPANION}.tlog", tuple(stations))


def _write(path: Path, tables: Mapping[str, Any]) -> Path:
    lines: list[str] = []
    for name, value in tables.items():
        for table in value if isinstance(value, list) else [value]:
            lines.append(f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
            # JSON's numbers, texts, truth values and lists of them are TOML's as well
            lines += [f"{key} = {json.dumps(entry, ensure_ascii=False)}" for key, entry in table.items()]
            lines.append("")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines), encoding="utf-8")
    return path

# SPDX-License-Identifier: GPL-3.0-or-later

"""The configurations of a replay: the one that was flown with, and the one that is tried.

Every value is checked as the companion checks its file. What only a real vehicle has (keys, links, journals, the
mission on board, the position box) is left out: none of it is in a recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import ConfigError, parse_value, read_toml
from mavproxy_handover.config.vehicle import VehicleConfig, vehicle_of
from mavproxy_handover.mission.package import MissionPackage

__all__ = ["Settings", "changed", "differences", "found_beside", "read_settings", "vehicle"]

#: tables that may be tried out
_TRIED: Final = ("limits", "policy", "hold_off", "clear", "energy", "route", "commands")

#: what a configuration file holds, and where it stands
Settings = tuple[Mapping[str, Any], Path]


def found_beside(recording: Path) -> Path | None:
    """The one configuration of a vehicle in the recording's folder; None where there is none, or more than one."""
    found = []
    for path in sorted(recording.parent.glob("*.toml")):
        try:
            data = read_toml(path)
        except ConfigError:
            continue
        if "vehicle" in data and "station" in data:
            found.append(path)
    return found[0] if len(found) == 1 else None


def read_settings(path: Path | None, package: MissionPackage) -> Settings:
    """The configuration of a file; None: the defaults, with the mission's stations. Raises ConfigError."""
    if path is None:
        return {"vehicle": {"name": "vehicle", "parent": package.parent.name}}, Path("defaults")
    path = path.resolve()
    data = dict(read_toml(path))
    vehicle_of(data, path)  # its own errors first: it may be no configuration of a vehicle
    return data, path


def changed(settings: Settings, words: Sequence[str]) -> Settings:
    """A copy with TABLE.KEY=VALUE of each word; KEY alone is one of [limits]. Raises ConfigError."""
    data = {key: dict(value) if isinstance(value, Mapping) else value for key, value in settings[0].items()}
    for word in words:
        key, sign, text = word.partition("=")
        table, dot, name = key.strip().rpartition(".")
        table = table if dot else "limits"
        if not sign or not name or not text.strip():
            raise ConfigError(f"--set {word}: must be KEY=VALUE, as limits.enter_margin_m=30")
        if table not in _TRIED:
            raise ConfigError(f"--set {word}: [{table}] is none of {', '.join(_TRIED)}")
        data.setdefault(table, {})[name] = parse_value(text.strip())
    return data, settings[1]


def vehicle(settings: Settings, package: MissionPackage, sysid: int) -> VehicleConfig:
    """The configuration of the vehicle for this mission. Raises ConfigError."""
    data, path = dict(settings[0]), settings[1]
    stations = {entry.name: entry.sysid for entry in package.stations}
    for entry in data.get("station", ()):
        if stations.get(entry.get("name"), entry.get("sysid")) != entry.get("sysid"):
            raise ConfigError(
                f"{path}: [[station]] {entry['name']} is {entry['sysid']}, the mission has {stations[entry['name']]}"
            )
    data["station"] = [
        {"name": name, "sysid": number, "links": [f"udpout:127.0.0.1:{port}"]}
        for port, (name, number) in enumerate(stations.items(), 14560)
    ]
    own = data["vehicle"]
    kept = {key: own[key] for key in ("name", "guard") if key in own}
    data["vehicle"] = {**kept, "sysid": sysid, "parent": package.parent.name, "allow_unsigned": True}
    data.pop("position", None)
    return vehicle_of(data, path)


def differences(flown: VehicleConfig, tried: VehicleConfig) -> list[str]:
    """The differences of the second, in words."""
    found = []
    for part in ("limits", "energy", "route"):
        before, after = getattr(flown, part), getattr(tried, part)
        for each in fields(before):
            was, now = getattr(before, each.name), getattr(after, each.name)
            if was == now:
                continue
            if isinstance(was, Mapping):
                for key in sorted({*was, *now}, key=str):
                    if was.get(key) != now.get(key):
                        name = getattr(key, "value", key)
                        found.append(f"{each.name} {name}: {was.get(key, 'default')} -> {now.get(key, 'default')}")
            else:
                found.append(f"{part}.{each.name}: {was} -> {now}")
    if flown.commands != tried.commands:
        found.append(f"commands: {_words(flown)} -> {_words(tried)}")
    return found


def _words(config: VehicleConfig) -> str:
    return ", ".join(f"{limit.value} {word}" for limit, word in config.commands.items()) or "defaults"

# SPDX-License-Identifier: GPL-3.0-or-later

"""The data of a companion's run: its configuration and everything that the configuration names, read once.

Rules that live here
--------------------
* A start on the ground reads the files. It is strict: anything missing or wrong is an error.
* A restart goes on with what the run before it had loaded (`store/restart_copy.py`), and reads no file. A restart is a
  start by the supervisor after a death, or a start in flight by the state in memory (`store/state_store.py`). So a file
  that is edited or damaged in flight cannot leave an aircraft without a judge.
* If a restart finds no such copy it reads the files. A key file that others may read is then only a warning.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from mavproxy_handover.config.toml import ConfigError, parse_toml, read_file
from mavproxy_handover.config.vehicle import VehicleConfig, vehicle_of
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.addresses import without_addresses
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.keys import StationKeys, load_key, load_station_keys
from mavproxy_handover.store.restart_copy import RestartCopy
from mavproxy_handover.store.state_store import in_flight
from mavproxy_handover.wire.signing import KEY_BYTES
from mavproxy_handover.wire.vehicle_address import pack_addresses, unpack_addresses

__all__ = ["Running", "Start", "forget", "keep", "load_running", "start_of"]


@dataclass(frozen=True, slots=True)
class Running:
    """A configuration with what it names. Its repr shows no key."""

    config: VehicleConfig
    #: the configuration file
    text: bytes = field(repr=False)
    #: keys of the stations that have one, by the station's name
    keys: Mapping[str, StationKeys] = field(default_factory=dict, repr=False)
    autopilot_key: bytes | None = field(default=None, repr=False)
    guard_key: bytes | None = field(default=None, repr=False)
    #: the mission package on board, if the configuration names one
    mission: MissionPackage | None = field(default=None, repr=False)
    #: last known addresses of the hosts that links name, by the host's name
    addresses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: it is a restart: missing things are skipped, and tried again
    restart: bool = False
    #: the restart copy holds it, except the addresses
    recorded: bool = False
    #: messages about it for people
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Start:
    """Facts at the beginning of a start: the configuration, its text, and whether the aircraft is in flight."""

    config: VehicleConfig
    text: bytes = field(repr=False)
    in_flight: bool


def start_of(path: Path) -> Start:
    """The start that would be made now, without the files that the configuration names. Raises ConfigError."""
    path = path.resolve()
    kept = _kept(path)
    if kept is not None and _flies(kept.config):
        return Start(kept.config, kept.text, in_flight=True)
    text = read_file(path)
    config = vehicle_of(parse_toml(text, path), path)
    return Start(config, text, _flies(config))


def load_running(path: Path, *, restarted: bool = False) -> Running:
    """Load the data of this companion's run. `restarted`: the supervisor reports that a run has died.

    Raises ConfigError, KeysError, MissionError.
    """
    path = path.resolve()
    kept = _kept(path)
    if kept is not None and (restarted or _flies(kept.config)):
        note = f"Restart: configuration, keys and mission are those of the run before; {path} is read at the next start"
        return replace(kept, restart=True, recorded=True, notes=(f"{note} on the ground",))
    start = start_of(path)
    config, text, restart = start.config, start.text, restarted or start.in_flight
    notes: list[str] = ["Restart: there is no record of the run before, so the files were read"] if restart else []
    warn = notes.append if restart else None
    key = partial(load_key, warn=warn)
    mission = None if config.mission is None else mission_package.load(config.mission)
    if mission is not None and mission.addresses_fault:
        notes.append(without_addresses(mission.addresses_fault))
    return Running(
        config,
        text,
        {entry.station.name: load_station_keys(entry.key, warn=warn) for entry in config.stations if entry.key},
        None if config.autopilot_key is None else key(config.autopilot_key),
        None if config.guard_key is None else key(config.guard_key),
        mission,
        restart=restart,
        notes=tuple(notes),
    )


def keep(running: Running) -> str:
    """Store it for a restart. Returns why that failed, "" if it succeeded.

    If it cannot be replaced, for example because the storage is full, a copy that a restart has used stays. Any other
    copy is removed: a restart must not go on with a configuration that is not the one in flight.
    """
    restart_copy = RestartCopy(running.config.path)
    try:
        restart_copy.save(_packed(running))
    except OSError as error:
        if not running.recorded:
            restart_copy.remove()
        return f"a restart in flight will have to read all files again: {error.strerror or error}"
    return ""


def forget(config: VehicleConfig) -> None:
    """Remove the restart copy after a run has ended on the ground.

    Then the next start reads the files, and no key stays in memory.
    """
    RestartCopy(config.path).remove()


def _flies(config: VehicleConfig) -> bool:
    return config.state is not None and in_flight(config.state, config.name)


def _packed(running: Running) -> Mapping[str, Any]:
    return {
        "path": str(running.config.path),
        "text": _word(running.text),
        "layout": _word(running.config.position.layout_text),
        "keys": {name: [_word(keys.current), _word(keys.previous)] for name, keys in running.keys.items()},
        "autopilot_key": _word(running.autopilot_key),
        "guard_key": _word(running.guard_key),
        "mission": None if running.mission is None else _word(running.mission.to_bytes()),
        "mission_addresses": None if running.mission is None else _word(pack_addresses(running.mission.addresses)),
        "addresses": {host: list(found) for host, found in running.addresses.items()},
    }


def _kept(path: Path) -> Running | None:
    """The stored data of a run with this configuration file; None if there is no valid copy."""
    record = RestartCopy(path).load()
    if record is None or record.get("path") != str(path):
        return None
    try:
        text, mission = _bytes(record["text"]), _optional(record["mission"], _bytes)
        layout = _optional(record.get("layout"), _bytes)
        addresses = _optional(record.get("mission_addresses"), _bytes) or b""
        keys = {name: StationKeys(_key(now), _optional(old, _key)) for name, (now, old) in record["keys"].items()}
        return Running(
            vehicle_of(parse_toml(text, path), path, layout),
            text,
            keys,
            _optional(record["autopilot_key"], _key),
            _optional(record["guard_key"], _key),
            None
            if mission is None
            else mission_package.from_bytes(mission).with_addresses(unpack_addresses(addresses)),
            {str(host): tuple(map(str, found)) for host, found in record["addresses"].items()},
        )
    except (ConfigError, MissionError, KeyError, TypeError, ValueError, AttributeError):
        return None


def _word(data: bytes | None) -> str | None:
    return None if data is None else b64encode(data).decode("ascii")


def _optional(word: Any, read: Callable[[Any], bytes]) -> bytes | None:
    return None if word is None else read(word)


def _bytes(word: Any) -> bytes:
    """Raises ValueError, TypeError."""
    return b64decode(word, validate=True)


def _key(word: Any) -> bytes:
    """Raises ValueError, TypeError."""
    key = _bytes(word)
    if len(key) != KEY_BYTES:
        raise ValueError("not a key")
    return key

# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds and reads the configuration files of vehicle and station: TOML in, frozen dataclasses out.

Every error is one line that names the file, the key, the value and what is allowed. Unknown keys are errors, because a
misspelt limit must not silently keep its default. `config/vehicle.py` reads the vehicle's file and `config/station.py`
the station's, both with the tools of `config/toml.py`. Other parts import from here.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from mavproxy_handover.config.station import FleetVehicle, PeerConfig, StationConfig, load_station
from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.config.vehicle import StationLinks, VehicleConfig, load_vehicle

__all__ = [
    "ConfigError",
    "FleetVehicle",
    "PeerConfig",
    "StationConfig",
    "StationLinks",
    "VehicleConfig",
    "find_station_config",
    "find_vehicle_config",
    "load_station",
    "load_vehicle",
    "path_argument",
]

VEHICLE_PLACES = ("./handover.toml", "/etc/handover/vehicle.toml")
STATION_PLACES = ("./station.toml",)


def path_argument(name: str, value: Any) -> str | None:
    """Check an argument of `module load`, which MAVProxy reads as JSON. Raises ConfigError if it is no path."""
    if value is None or (isinstance(value, str) and value and "\0" not in value):
        return value
    raise ConfigError(f"argument {name}: {value!r} must be the path of a file")


def find_vehicle_config(explicit: str | None) -> Path:
    """Find the vehicle's configuration file: `explicit`, else $HANDOVER_CONFIG, else the usual places.

    Raises ConfigError that says where it searched and how to make a file.
    """
    named = explicit or os.environ.get("HANDOVER_CONFIG")
    return _find(named, "handover", VEHICLE_PLACES, "vehicle", "$HANDOVER_CONFIG, ")


def find_station_config(explicit: str | None) -> Path:
    """Find a station's configuration file: `explicit`, else the usual place."""
    return _find(explicit, "handover_gcs", STATION_PLACES, "station")


def _find(named: str | None, module: str, places: tuple[str, ...], kind: str, variable: str = "") -> Path:
    try:
        for place in (named,) if named else places:
            if named or Path(place).is_file():
                return Path(place).expanduser().resolve()
    except (OSError, RuntimeError, ValueError) as error:  # an unknown user after ~, links in a circle
        raise ConfigError(f"{named}: {error}") from None
    looked = f'module load {module}:{{"config":"FILE"}} (no spaces in it), {variable}{", ".join(places)}'
    raise ConfigError(f"no configuration: looked for {looked}; the shell's 'handover init {kind}' writes one")

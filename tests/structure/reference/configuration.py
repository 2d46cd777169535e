# SPDX-License-Identifier: GPL-3.0-or-later

"""`docs/reference/configuration.md` and `mission.md`: every key, as the readers ask for it.

The samples that `handover init` writes are read while it is written down which key is asked for, as what, with which
range and default. What a key means is in `config/meanings.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final
from unittest import mock

from mavproxy_handover.config import meanings
from mavproxy_handover.config import position as position_module
from mavproxy_handover.config.station import load_station
from mavproxy_handover.config.toml import Ranges, Table
from mavproxy_handover.config.vehicle import VehicleConfig, load_vehicle
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.safety.commands import POLICIES, Limit
from mavproxy_handover.core.safety.energy_prior import (
    ENERGY_KEYS,
    ENERGY_RANGES,
    ON_ROTORS,
    START_POLICIES,
    WHOLE_KEYS,
    EnergySettings,
)
from mavproxy_handover.gate.client_capabilities import POLICIES as CAPABILITY_POLICIES
from mavproxy_handover.mission import gaps
from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.leg import DEFAULT_CRUISE_MPS
from mavproxy_handover.mission.wings import AS_IT_COMES, WINGS_RANGES
from mavproxy_handover.wire.box_layout import LAYOUTS, BoxLayout
from tests.structure.imports import ROOT
from tests.structure.reference.markdown import cell, code, page, table

__all__ = ["Key", "configuration", "keys_of_missions", "keys_of_stations", "keys_of_vehicles", "mission"]

_SAMPLES = ROOT / "mavproxy_handover" / "deploy"
_KINDS: Final = {
    int: "whole number",
    float: "number",
    str: "text",
    bool: "true or false",
    list: "list",
    object: "word or list",
}
_UNITS: Final = {
    "bytes_per_s": "bytes/s",
    "drag_per_s": "1/s",
    "drag_per_m": "1/m",
    "_mps": "m/s",
    "_deg": "degrees",
    "_wh": "Wh",
    "_kg": "kg",
    "_m2": "m²",
    "_hz": "Hz",
    "_w": "W",
    "_s": "s",
    "_m": "m",
}


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a table, as its reader takes it. `default`: "" where it is nothing."""

    name: str
    kind: str
    allowed: str = ""
    default: str = ""
    required: bool = False


class _Record:
    """Tables as they are asked: name -> key -> what it is asked for as."""

    def __init__(self) -> None:
        self.tables: dict[str, dict[str, Key]] = {}
        get, numbers, sysid, name = Table.get, Table.numbers, Table.sysid, Table.name

        def table_of(self_: Any) -> dict[str, Key]:
            where = self_._where.split()[0]
            return self.tables.setdefault(where, {key: Key(key, "") for key in self_._keys})

        def recorded_get(self_: Any, key: str, kind: type, default: Any = None, *, required: bool = False) -> Any:
            found = table_of(self_)
            if not found[key].kind:
                found[key] = Key(key, _KINDS[kind], "", _shown(default), required)
            return get(self_, key, kind, default, required=required)

        def recorded_numbers(self_: Any, ranges: Ranges) -> dict[str, float]:
            found = table_of(self_)
            values = numbers(self_, ranges)
            for key, (low, high) in ranges.items():
                whole = found[key].kind == _KINDS[int]
                found[key] = Key(key, _KINDS[int if whole else float], _range(low, high))
            return values

        def recorded_sysid(self_: Any, key: str, **more: Any) -> int:
            value = sysid(self_, key, **more)
            table_of(self_)[key] = replace(
                table_of(self_)[key], allowed="1 to 255", default=_shown(more.get("default"))
            )
            return value

        def recorded_name(self_: Any, key: str) -> str:
            value = name(self_, key)
            table_of(self_)[key] = replace(table_of(self_)[key], allowed="1 to 20 printable ASCII characters")
            return value

        self._patches = (
            mock.patch.object(Table, "get", recorded_get),
            mock.patch.object(Table, "numbers", recorded_numbers),
            mock.patch.object(Table, "sysid", recorded_sysid),
            mock.patch.object(Table, "name", recorded_name),
        )

    def of(self, load: Any, path: Path) -> Any:
        """Load a file, and write down what is asked for."""
        for patch in self._patches:
            patch.start()
        try:
            return load(path)
        finally:
            for patch in self._patches:
                patch.stop()

    def tell(self, where: str, key: str, *, allowed: str = "", default: str = "") -> None:
        """Add what only the reader's constants say."""
        known = self.tables[where][key]
        told = replace(known, allowed=allowed or known.allowed, default=default or known.default)
        self.tables[where][key] = told


def _shown(value: Any) -> str:
    """As it is written in the file."""
    if value is None or value in ([], ""):
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(_shown(each) for each in value)}]"
    if isinstance(value, BoxLayout):
        return f'"{value.name}"'
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"


def _range(low: float, high: float) -> str:
    return f"{low:.12g} to {high:.12g}"


def _words(words: Any) -> str:
    return ", ".join(f'"{word}"' for word in words)


@cache
def keys_of_vehicles() -> Mapping[str, Mapping[str, Key]]:
    """Table -> key of a vehicle's file."""
    record = _Record()
    config: VehicleConfig = record.of(load_vehicle, _SAMPLES / "vehicle.toml")
    for where, values in (
        ("limits", config.limits),
        ("links", config.stations[0].limits),
        ("observers", config.observers),
        ("route", config.route),
        ("position", config.position),
    ):
        for key in record.tables[where]:
            record.tell(where, key, default=_shown(getattr(values, key)))
    for cause in Cause:
        row = CAUSES[cause]
        record.tell("policy", cause.value, allowed=_words(row.policies), default=_shown(row.policies[0]))
        record.tell("hold_off", cause.value, default=_shown(row.hold_off_s))
        record.tell("clear", cause.value, default=_shown(row.clear_s))
    for limit in Limit:
        record.tell("commands", limit.value, allowed=_words(POLICIES), default=_shown(POLICIES[0]))
    for key, default in _energy_defaults().items():
        record.tell("energy", key, default=default)
    record.tell("energy", "start", allowed=_words(START_POLICIES))
    record.tell("station", "not_in_control", allowed=_words(CAPABILITY_POLICIES))
    record.tell("station", "components", allowed="0 to 255")
    record.tell("position", "source", allowed=_words(position_module.SOURCES))
    record.tell("position", "layout", allowed=f"{_words(LAYOUTS)}, a file")
    record.tell("position", "check", allowed=_words(position_module.CHECKS))
    return record.tables


def _energy_defaults() -> dict[str, str]:
    """What an aircraft is taken to be of which only battery and hover are known."""
    known = EnergySettings(battery_wh=100.0, hover_w=360.0)
    model = known.model()
    assert model is not None
    same = ("cruise_mps", "headwind_mps", "reserve_factor", "return_alt_m")
    return {
        **{key: _shown(getattr(model, key)) for key in same},
        "climb_factor": _shown(model.climb_w / model.hover_w),
        "descent_factor": _shown(model.descent_w / model.hover_w),
        "lean_deg": _shown(known.lean_limit_deg),
        "start": _shown(known.start_policy_for(ON_ROTORS)),
    }


@cache
def keys_of_stations() -> Mapping[str, Mapping[str, Key]]:
    """Table -> key of a station's file, with one vehicle and with several."""
    record = _Record()
    record.of(load_station, _SAMPLES / "station.toml")
    config = record.of(load_station, Path(__file__).with_name("several.toml"))
    for key in record.tables["route"]:
        record.tell("route", key, default=_shown(getattr(config.route, key)))
    record.tell("station", "journal", default="NAME.jsonl")
    return record.tables


@cache
def keys_of_missions() -> Mapping[str, Mapping[str, Key]]:
    """Table -> key of mission.toml."""
    longest = f"1 to {gaps.LONGEST_S:g}"
    known = {
        "": (
            Key("name", "text", "1 to 40 characters", required=True),
            Key("description", "text", "1 to 400 characters"),
            Key("aircraft", "text", _words(packages.AIRCRAFT), _shown(packages.AIRCRAFT[0])),
            Key("detector", "text", _words(packages.DETECTORS), required=True),
            Key("route", "text", "file name", required=True),
            Key("zones", "text", "file name"),
            Key("terrain", "text", "file name"),
            Key("corridor_m", "number", "5 to 10000"),
            Key("expected_handovers", "whole number", "0 to 1000", required=True),
            Key("cruise_speed_mps", "number", "0.1 to 100", _shown(DEFAULT_CRUISE_MPS)),
            Key("delivery_waypoint", "whole number", "an item of the route"),
            Key("stations", "tables", "1 or more", required=True),
            Key("policy", "table"),
            Key("energy", "table"),
            Key("wings", "table"),
            Key("gap", "tables"),
        ),
        "stations": (
            Key("name", "text", "1 to 16 letters, digits, - and _", required=True),
            Key("sysid", "whole number", "1 to 255", required=True),
            Key("waypoints", "list", "items of the route"),
        ),
        "policy": tuple(Key(key, "text", _words(words)) for key, words in packages._POLICIES.items()),
        "wings": tuple(
            Key(key, "number", _range(*WINGS_RANGES[key]), _shown(getattr(AS_IT_COMES, key))) for key in WINGS_RANGES
        ),
        "gap": (
            Key("from", "text", "a station", required=True),
            Key("to", "text or whole number", "a station, or an item of the route", required=True),
            Key("limit_s", "number", longest, required=True),
            Key("note", "text", "1 to 200 characters"),
        ),
        "energy": tuple(
            Key(
                key,
                "text" if key == "start" else _KINDS[int if key in WHOLE_KEYS else float],
                _words(START_POLICIES) if key == "start" else _range(*ENERGY_RANGES[key]),
            )
            for key in ENERGY_KEYS
        ),
    }
    return {where: {key.name: key for key in keys} for where, keys in known.items()}


def _unit(where: str, key: str) -> str:
    if where in ("hold_off", "clear"):
        return "s"
    return next((unit for suffix, unit in _UNITS.items() if key.endswith(suffix)), "")


def _tables(
    keys: Mapping[str, Mapping[str, Key]], said: Mapping[str, Mapping[str, str]], many: frozenset[str]
) -> Iterator[str]:
    for where in said:
        if where:
            yield f"### {'[[' if where in many else '['}{where}{']]' if where in many else ']'}"
        yield "" if said[where] is meanings.MISSION.get("policy") else meanings.TABLES.get(where, "")
        rows = []
        for key in keys[where].values():
            default = "needed" if key.required else code(key.default)
            kind = f"{key.kind}{', ' if _unit(where, key.name) else ''}{_unit(where, key.name)}"
            assert key.name in said[where], (
                f"[{where}] {key.name} has no meaning in mavproxy_handover/config/meanings.py"
            )
            meaning = said[where][key.name]
            rows.append((code(key.name), kind, cell(key.allowed), default, cell(meaning)))
        yield table(("key", "kind", "allowed", "default", "meaning"), rows)


def configuration() -> str:
    """The page of vehicle and station."""
    return page(
        "Configuration, key by key",
        "TOML. `handover init vehicle` and `handover init station` write samples with every key in it. A key that "
        "nobody knows, a value of another kind or out of its range keeps the module from loading, with one line that "
        "names file, table, key, value and what is allowed. Paths are relative to the folder of the file. What has no "
        "default may be left out, or follows from others, unless it is needed.",
        "## The vehicle's file",
        'Found as `module load handover:{"config":"FILE"}`, `$HANDOVER_CONFIG`, `./handover.toml`, '
        "`/etc/handover/vehicle.toml`.",
        *_tables(keys_of_vehicles(), meanings.VEHICLE, frozenset(("station",))),
        "## A station's file",
        'Found as `module load handover_gcs:{"config":"FILE"}`, or `./station.toml`. With `[[vehicle]]` tables, one '
        "for each, the station is for several vehicles.",
        *_tables(keys_of_stations(), meanings.STATION, frozenset(("vehicle", "peer"))),
    )


def mission() -> str:
    """The page of mission.toml."""
    return page(
        "mission.toml, key by key",
        "What a mission package is, and how one is made: [missions/README.md](../../missions/README.md). `handover "
        "check` says what is wrong with one, in a line that names file, place and what is allowed.",
        "## At the top",
        *_tables(keys_of_missions(), meanings.MISSION, frozenset(("stations", "gap"))),
    )

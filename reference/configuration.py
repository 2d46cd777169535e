# SPDX-License-Identifier: GPL-3.0-or-later

"""`configuration.md` and `mission.md`: every key, from the tables that the readers of the files use."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from mavproxy_handover.config.sample import toml_value
from mavproxy_handover.config.station_keys import STATION_FILE
from mavproxy_handover.config.vehicle_keys import VEHICLE_FILE
from mavproxy_handover.mission.keys import MISSION_KEYS
from mavproxy_handover.tools.key_table import Key, KeyTable
from reference.markdown import cell, code, page, table

__all__ = ["configuration", "mission"]

_KINDS: Final = {
    int: "whole number",
    float: "number",
    str: "text",
    bool: "true or false",
    list: "list",
    dict: "table",
    object: "word or list",
}


def _tables(tables: Sequence[KeyTable]) -> Iterator[str]:
    for each in tables:
        if each.name:
            yield f"### {each.header}"
        yield re.sub(r"docs/([\w-]+\.md)", r"[\1](../\1)", each.says)
        yield table(("key", "kind", "allowed", "default", "meaning"), map(_row, each.keys))


def _row(key: Key) -> tuple[str, ...]:
    kind = f"{_KINDS[key.kind]}, {key.unit}" if key.unit else _KINDS[key.kind]
    known = code("" if key.default in (None, "", []) else toml_value(key.default))
    allowed = ", ".join(map(toml_value, key.words)) or key.allowed
    return code(key.name), kind, cell(allowed), "needed" if key.required else known, cell(key.says)


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
        *_tables(VEHICLE_FILE),
        "## A station's file",
        'Found as `module load handover_gcs:{"config":"FILE"}`, or `./station.toml`. With `[[vehicle]]` tables, one '
        "for each, the station is for several vehicles.",
        *_tables(STATION_FILE),
    )


def mission() -> str:
    """The page of mission.toml."""
    return page(
        "mission.toml, key by key",
        "What a mission package is, and how one is made: [missions/README.md](../../missions/README.md). `handover "
        "check` says what is wrong with one, in a line that names file, place and what is allowed.",
        "## At the top",
        *_tables(MISSION_KEYS),
    )

# SPDX-License-Identifier: GPL-3.0-or-later

"""Commented samples of the configuration files, from their tables of keys.

A sample has every key. A few values are in force, so that the file can be loaded as it is; the others are comments with
the default, or with an example.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap
from typing import Any, Final

from mavproxy_handover.config.station_keys import STATION_FILE
from mavproxy_handover.config.vehicle_keys import VEHICLE_FILE
from mavproxy_handover.tools.key_table import Key, KeyTable

__all__ = ["Values", "station_sample", "station_text", "toml_value", "vehicle_sample", "vehicle_text"]

#: width of a line, and the column of its comment
_WIDTH, _COLUMN = 120, 40
_NO_BREAK: Final = "\N{NO-BREAK SPACE}"
#: values in force, by table; an empty list: the table is a comment
Values = Mapping[str, Sequence[Mapping[str, Any]]]

_VEHICLE: Final[Values] = {
    "vehicle": [
        {
            "name": "drone-1",
            "sysid": 1,
            "parent": "GCSA",
            "journal": "handover.jsonl",
            "guard": True,
            "state": "state",
        }
    ],
    "station": [
        {"name": "GCSA", "sysid": 251, "links": ["udpout:127.0.0.1:14551"], "key": "keys/GCSA.key"},
        {"name": "GCSB", "sysid": 252, "links": ["udpout:127.0.0.1:14552"], "key": "keys/GCSB.key"},
    ],
}
_STATION: Final[Values] = {
    "station": [
        {
            "name": "GCSA",
            "sysid": 251,
            "vehicle": 1,
            "key": "keys/GCSA.key",
            "consent": "automatic",
            "journal": "GCSA.jsonl",
        }
    ],
    "vehicle": [],
    "ground": [{"listen": "udpin:127.0.0.1:15551", "key": "keys/ground.key"}],
    "peer": [{"name": "GCSB", "sysid": 252, "link": "udpout:127.0.0.1:15552"}],
}
#: values of required keys in a table that is a comment as a whole
_EXAMPLES: Final[Mapping[str, Any]] = {
    "name": "drone-1",
    "sysid": 1,
    "links": ["udpin:0.0.0.0:14550"],
    "key": "keys/GCSA-drone-1.key",
}


_VEHICLE_HEAD: Final = (
    "Configuration of a vehicle's companion computer.",
    'Found as: module load handover:{"config":"FILE"}, $HANDOVER_CONFIG, ./handover.toml, /etc/handover/vehicle.toml',
)
_STATION_HEAD: Final = (
    "Configuration of a ground station.",
    'Found as: module load handover_gcs:{"config":"FILE"}, ./station.toml',
)


def vehicle_sample(folder: str = "") -> str:
    """A vehicle's file. `folder`: of journal and state, with the stroke at its end; "": that of the file."""
    return vehicle_text(_placed(_VEHICLE, "vehicle", folder))


def station_sample(folder: str = "") -> str:
    """A station's file. `folder`: of its journal, with the stroke at its end; "": that of the file."""
    return station_text(_placed(_STATION, "station", folder))


def vehicle_text(values: Values, notes: Sequence[str] = ()) -> str:
    """A vehicle's file with these values in force. `notes`: more lines at its head."""
    return _sample((*_VEHICLE_HEAD, *notes), VEHICLE_FILE, values)


def station_text(values: Values, notes: Sequence[str] = ()) -> str:
    """A station's file with these values in force. `notes`: more lines at its head."""
    return _sample((*_STATION_HEAD, *notes), STATION_FILE, values)


def toml_value(value: Any) -> str:
    """A value as it is written in the file."""
    if isinstance(value, list):
        return f"[{', '.join(map(toml_value, value))}]"
    return f"{value:.12g}" if isinstance(value, float) else json.dumps(value)


def _placed(values: Values, table: str, folder: str) -> Values:
    """The values with journal and state in that folder."""
    (first,) = values[table]
    placed = {key: f"{folder}{first[key]}" for key in ("journal", "state") if key in first}
    return {**values, table: [{**first, **placed}]}


def _sample(head: Sequence[str], tables: Sequence[KeyTable], values: Values) -> str:
    lines = [f"# {line}" for line in head]
    lines.append("# Times are in seconds, distances in metres. A key in a comment shows the default, or an example.")
    for table in tables:
        in_force = values.get(table.name, [] if table.many else [{}])
        lines += ["", *(f"# {line}" for line in wrap(table.says, _WIDTH - 2))]
        if not in_force:
            lines += [f"# {table.header}", *_keys(table, {})]
        for number, own in enumerate(in_force):
            keys = _keys(table, own) if number == 0 else (f"{key} = {toml_value(own[key])}" for key in own)
            lines += ["", table.header, *keys] if number else [table.header, *keys]
    return "\n".join(lines) + "\n"


def _keys(table: KeyTable, in_force: Mapping[str, Any]) -> Iterator[str]:
    for key in table.keys:
        if key.name in in_force:
            line = f"{key.name} = {toml_value(in_force[key.name])}"
        else:
            line = f"# {key.name} = {toml_value(_shown(key))}"
        yield from _commented(line, _meaning(key))


def _shown(key: Key) -> Any:
    """The value of a key that is not in force: an example, or its default."""
    if key.example is not None and not key.default:
        return key.example
    return _EXAMPLES.get(key.name) if key.default is None else key.default


def _meaning(key: Key) -> str:
    """What it means, with what is allowed. A range stays on one line."""
    if not key.allowed or (key.words and all(word in key.says for word in key.words)):
        return key.says
    allowed = f"{key.allowed} {key.unit}".strip()
    return f"{key.says} ({allowed if key.rule else allowed.replace(' ', _NO_BREAK)})"


def _commented(line: str, comment: str) -> Iterator[str]:
    """A line with a comment beside it, which goes on below."""
    first, *rest = wrap(comment, _WIDTH - _COLUMN - 2, break_on_hyphens=False)
    yield f"{line.ljust(_COLUMN - 1)} # {first}".replace(_NO_BREAK, " ")
    for more in rest:
        yield f"{' ' * _COLUMN}# {more}".replace(_NO_BREAK, " ")

# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads `[position] layout`: the name of a known layout, or a file that describes the box's record.

name = "acme"                 # optional; else the file's name
size = 56                     # bytes of a record; optional, else it ends with the last field
byte_order = "little"         # optional; or "big"

[[field]]                     # once for each field, in any order
field = "time"                # what it means (`wire/box_layout.py`, MEANINGS)
type = "double"
unit = "s"
offset = 0                    # the byte at which it begins
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Final

from mavproxy_handover.config.toml import ConfigError, Table, list_of_tables, parse_toml
from mavproxy_handover.tools.key_table import Key, KeyTable, text
from mavproxy_handover.wire.box_layout import LAYOUTS, MEANINGS, REQUIRED, TYPES, UNITS, BoxField, BoxLayout

__all__ = ["ENDING", "parse_layout"]

#: suffix of such a file
ENDING: Final = ".toml"
#: most bytes of a record
_MOST_BYTES: Final = 512
_ORDERS: Final = ("little", "big")
_HEAD: Final = KeyTable(
    "layout",
    (
        text("name", "what it is called"),
        Key("size", int, "bytes of a record"),
        text("byte_order", "little or big", _ORDERS[0]),
    ),
)
_FIELD: Final = KeyTable(
    "field",
    (
        text("field", "what it means", required=True),
        text("type", "as it is written", required=True),
        text("unit", "of its number", required=True),
        Key("offset", int, "the byte at which it begins", required=True),
    ),
    many=True,
)
_SAMPLE: Final = "docs/position-box.md has a sample"
#: one of these is enough
_EITHER: Final = ("vel_up", "vel_down")


def parse_layout(content: bytes, path: Path) -> BoxLayout:
    """Parse the layout in such a file; `path`: for errors. Raises ConfigError."""
    data = parse_toml(content, path)
    head = Table({key: value for key, value in data.items() if key != _FIELD.name}, _HEAD, path)
    name = path.stem if head["name"] is None else head["name"]
    if not 1 <= len(name) <= 20 or not name.isprintable() or not name.isascii():
        raise head.error("name", f"{name!r} must be 1 to 20 printable ASCII characters")
    if name in LAYOUTS:
        raise head.error("name", f"{name!r} is the name of a known layout: choose another one")
    order = _one_of(head, "byte_order", head["byte_order"], _ORDERS)
    fields = _fields(list_of_tables(data, _FIELD, path))
    for meaning in REQUIRED:
        if meaning not in (field.meaning for field in fields):
            raise ConfigError(f'{path}: {meaning} is missing: add a [[field]] with field = "{meaning}"; {_SAMPLE}')
    ends = fields[-1].offset + fields[-1].bytes
    size = ends if head["size"] is None else head["size"]
    if not ends <= size <= _MOST_BYTES:
        raise head.error("size", f"{size} must be {ends} to {_MOST_BYTES} bytes: {fields[-1].name} ends at {ends}")
    return BoxLayout(name, fields, size, order == "big")


def _fields(tables: Iterable[Table]) -> tuple[BoxField, ...]:
    """The fields in the order of their bytes. Raises ConfigError."""
    found: dict[str, tuple[BoxField, Table]] = {}
    for table in tables:
        field = _field(table)
        twice = [other for other in found if other == field.meaning or {other, field.meaning} == set(_EITHER)]
        if twice:
            raise table.error("field", f"{field.meaning!r}: there is {twice[0]!r} already; delete one of the two")
        found[field.meaning] = field, table
    ordered = sorted(found.values(), key=lambda each: each[0].offset)
    for (before, _), (field, table) in pairwise(ordered):
        ends = before.offset + before.bytes
        if field.offset < ends:
            where = f"{before.meaning} takes bytes {before.offset} to {ends - 1}"
            raise table.error("offset", f"{field.offset} of {field.meaning} overlaps: {where}")
    return tuple(field for field, _ in ordered)


def _field(table: Table) -> BoxField:
    """Parse one [[field]]. Raises ConfigError."""
    meaning = _one_of(table, "field", table["field"], MEANINGS)
    kind = _one_of(table, "type", table["type"], TYPES)
    unit = _one_of(table, "unit", table["unit"], UNITS[MEANINGS[meaning].quantity])
    offset = table["offset"]
    if meaning == "time" and kind == "float":
        raise table.error("type", "'float' is too coarse for the time; it must be double, or a whole number's type")
    field = BoxField(meaning, meaning, kind, unit, offset, MEANINGS[meaning].says)
    if not 0 <= offset <= _MOST_BYTES - field.bytes:
        raise table.error("offset", f"{offset} must be 0 to {_MOST_BYTES - field.bytes}")
    return field


def _one_of(table: Table, key: str, word: str, allowed: Iterable[str]) -> str:
    known = tuple(allowed)
    if word in known:
        return word
    near = difflib.get_close_matches(word, known, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise table.error(key, f"{word!r}: {hint}it must be one of {', '.join(known)}")

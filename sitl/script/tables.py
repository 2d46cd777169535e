# SPDX-License-Identifier: GPL-3.0-or-later

"""Turns TOML tables of a scenario into frozen dataclasses, and refuses unknown keys.

A dataclass is its own schema: field names are the keys, annotations the kinds, defaults make keys optional. A field
named `match` takes every key that is no field. A field named `value` lets the table be written as the bare value.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, TypeVar, get_type_hints

from sitl.report.matching import Match

__all__ = ["Reader", "ScenarioError"]

T = TypeVar("T")
_REQUIRED: Any = object()


class ScenarioError(Exception):
    """A scenario cannot be used. The message is one line that names file and key."""


_KIND_NAMES: dict[Any, str] = {
    str: "a text",
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    tuple[str, ...]: "a list of texts",
    tuple[int, ...]: "a list of whole numbers",
}


@dataclass(frozen=True, slots=True)
class Reader:
    """A place in a scenario file."""

    file: str
    place: str = ""

    def at(self, place: str) -> Reader:
        """The place `place` inside this one."""
        return Reader(self.file, f"{self.place}, {place}" if self.place else place)

    def error(self, key: str, text: str) -> ScenarioError:
        """An error here; the caller raises it."""
        where = f"{self.file}: [{self.place}] {key}" if self.place else f"{self.file}: {key}"
        return ScenarioError(f"{where}: {text}")

    def known_keys(self, table: Mapping[str, Any], allowed: Iterable[str]) -> None:
        """Refuse a key that is not in `allowed`."""
        words = list(allowed)
        for key in table:
            if key not in words:
                near = difflib.get_close_matches(key, words, 1)
                hint = f"did you mean {near[0]!r}?" if near else "allowed are: " + ", ".join(words)
                raise self.error(key, f"unknown key; {hint}")

    def value(self, table: Mapping[str, Any], key: str, kind: Any, default: Any = _REQUIRED) -> Any:
        """The value of a key, of a kind. Without a default the key must be there."""
        if key not in table:
            if default is _REQUIRED:
                raise self.error(key, f"is missing; it must be {_KIND_NAMES[kind]}")
            return default
        return self._convert(key, table[key], kind)

    def table(self, table: Mapping[str, Any], key: str, default: Any = _REQUIRED) -> Mapping[str, Any]:
        """The table under a key."""
        value = table.get(key, default)
        if not isinstance(value, Mapping):
            raise self.error(key, "must be a table")
        return value

    def tables(self, table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
        """The tables written [[key]]."""
        value = table.get(key, [])
        if not isinstance(value, list) or not all(isinstance(entry, Mapping) for entry in value):
            raise self.error(key, f"must be written [[{key}]], once for each")
        return value

    def numbers(self, table: Mapping[str, Any]) -> dict[str, float]:
        """A table of numbers."""
        return {key: self._convert(key, value, float) for key, value in table.items()}

    def words(self, table: Mapping[str, Any]) -> dict[str, str]:
        """A table of texts."""
        return {key: self._convert(key, value, str) for key, value in table.items()}

    def lists(self, table: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
        """A table of lists of texts."""
        return {key: self._convert(key, value, tuple[str, ...]) for key, value in table.items()}

    def one_of(self, table: Mapping[str, Any], words: Iterable[str], beside: Iterable[str]) -> tuple[str, Any]:
        """The one key of `words` that the table has, and its value; keys of `beside` may stand next to it."""
        words, beside = list(words), list(beside)
        self.known_keys(table, words + beside)
        found = [key for key in table if key in words]
        if len(found) != 1:
            which = f"it has {' and '.join(found)}" if found else "it has none"
            raise ScenarioError(f"{self.file}: [{self.place}] needs exactly one of {', '.join(words)}; {which}")
        return found[0], table[found[0]]

    def build(self, cls: type[T], value: Any) -> T:
        """An object of the dataclass `cls` from a table, or from a bare value."""
        hints = get_type_hints(cls)
        entries = {entry.name: entry for entry in fields(cls)}  # type: ignore[arg-type]
        if not isinstance(value, Mapping):
            if "value" not in entries:
                raise ScenarioError(f"{self.file}: [{self.place}] must be a table with {', '.join(entries)}")
            value = {"value": value}
        free = {key: value[key] for key in value if key not in entries}
        if "match" not in entries:
            self.known_keys(value, entries)
        made: dict[str, Any] = {}
        for name, entry in entries.items():
            if name == "match":
                made[name] = Match(tuple(free.items()))
            elif name in value:
                made[name] = self._convert(name, value[name], hints[name])
            elif entry.default is MISSING:
                raise self.error(name, "is missing")
        try:
            return cls(**made)
        except ValueError as error:
            raise ScenarioError(f"{self.file}: [{self.place}] {error}") from None

    def _convert(self, key: str, value: Any, kind: Any) -> Any:
        if kind == (float | None) or kind == (int | None):
            kind = float if kind == (float | None) else int
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if kind in (tuple[str, ...], tuple[int, ...]):
            inner = str if kind == tuple[str, ...] else int
            if isinstance(value, inner) and not isinstance(value, bool):
                return (value,)
            if isinstance(value, list) and all(isinstance(v, inner) and not isinstance(v, bool) for v in value):
                return tuple(value)
        elif isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
            return value
        raise self.error(key, f"{value!r} must be {_KIND_NAMES[kind]}")

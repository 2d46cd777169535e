# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a configuration file: TOML, table by table and key by key, by its tables of keys (`tools/key_table.py`).

Every error is one line that names the file, the table, the key, the value and what is allowed. An unknown key is an
error. It is reported before missing keys: a misspelt `key` is the reason why there is none.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

from mavproxy_handover.link.forms import LinkError, parse_device
from mavproxy_handover.tools.key_table import Key, KeyTable

__all__ = [
    "ConfigError",
    "Table",
    "check_tables",
    "list_of_tables",
    "one_table",
    "parse_toml",
    "parse_value",
    "read_file",
    "read_toml",
]

_KIND_NAMES: Final = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    bool: "true or false",
    list: "a list",
    object: "a word or a list",
}


class ConfigError(Exception):
    """A configuration cannot be used. The message is one line for people."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.splitlines()))


class Table:
    """One TOML table. Raises ConfigError if it is no table, or holds a key that `keys` does not have."""

    def __init__(self, data: Any, keys: KeyTable, file: Path, number: int | None = None) -> None:
        """`number`: which one of several it is, from 1, for errors."""
        self._where = keys.name if number is None else f"{keys.name} {number}"
        self._keys = keys
        self._file = file
        if not isinstance(data, Mapping):
            raise ConfigError(f"{file}: [{self._where}] must be a table")
        self._data = data
        for key in data:
            if key not in keys.names:
                near = difflib.get_close_matches(key, keys.names, 1)
                hint = f"did you mean {near[0]!r}?" if near else "allowed are: " + ", ".join(keys.names)
                raise self.error(key, f"unknown key; {hint}")

    def error(self, key: str, text: str) -> ConfigError:
        """The error of one key."""
        return ConfigError(f"{self._file}: [{self._where}] {key}: {text}")

    def __getitem__(self, name: str) -> Any:
        """The value of a key, checked; its default if it is missing."""
        key = self._keys[name]
        if name not in self._data:
            if key.required:
                raise self.error(name, f"is missing; it must be {_KIND_NAMES[key.kind]}")
            return key.default
        return self._checked(key, self._data[name])

    def __contains__(self, name: str) -> bool:
        return name in self._data

    def given(self) -> dict[str, Any]:
        """The keys that the file has, with their checked values."""
        return {key.name: self[key.name] for key in self._keys.keys if key.name in self._data}

    def path(self, name: str) -> Path | None:
        """A path, relative to the folder of the file; None if it is missing."""
        text: str | None = self[name]
        return None if text is None else self._file.parent / text

    def link(self, name: str, value: Any) -> str:
        """`value` as a link in pymavlink's device form. It is given, because a key may hold a list of links; `name` is
        for the error.
        """
        try:
            return parse_device(value).text
        except LinkError as error:
            raise self.error(name, str(error).removeprefix("link ")) from None

    def _checked(self, key: Key, value: Any) -> Any:
        """The value, a float if the key is a number: that may be written without a point."""
        if key.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 2**63 else math.inf
        if not isinstance(value, key.kind) or (key.kind is not bool and isinstance(value, bool)):
            raise self.error(key.name, f"{value!r} must be {_KIND_NAMES[key.kind]}")
        if key.words and value not in key.words:
            raise self.error(key.name, f"{value!r} must be one of {key.allowed}")
        if key.pattern and not re.fullmatch(key.pattern, value):
            raise self.error(key.name, f"{value!r} must be {key.allowed}")
        if key.limits is not None:
            self._check_limits(key, value, *key.limits)
        return value

    def _check_limits(self, key: Key, value: Any, low: float, high: float) -> None:
        kind = int if key.kind is list else key.kind
        for each in value if isinstance(value, list) else [value]:
            if not isinstance(each, kind) or isinstance(each, bool) or not low <= each <= high:
                raise self.error(key.name, f"{_plain(each)} must be {key.allowed}")


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else repr(value)


def read_toml(path: Path) -> Mapping[str, Any]:
    """Parse a whole file. Raises ConfigError: missing, unreadable, no TOML."""
    return parse_toml(read_file(path), path)


def read_file(path: Path) -> bytes:
    """Read the bytes of a file. Raises ConfigError: missing, unreadable."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None


def parse_toml(text: bytes, path: Path) -> Mapping[str, Any]:
    """Parse the text of a file. `path`: for errors. Raises ConfigError: no TOML."""
    try:
        data: Mapping[str, Any] = tomllib.loads(text.decode("utf-8"))
        return data
    except (ValueError, RecursionError) as error:  # ValueError: no TOML, no UTF-8, a number of thousands of digits
        raise ConfigError(f"{path}: not valid TOML: {error}") from None


def parse_value(text: str) -> Any:
    """Parse a value of such a file; a word that is no TOML by itself is a text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def check_tables(data: Mapping[str, Any], path: Path, tables: Sequence[KeyTable]) -> None:
    """Raise ConfigError for an unknown table, or a missing one that is required."""
    names = [table.name for table in tables]
    for name in data:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            hint = f"did you mean [{near[0]}]?" if near else "allowed are: " + ", ".join(names)
            raise ConfigError(f"{path}: unknown table [{name}]; {hint}")
    for table in tables:
        if table.required and table.name not in data:
            raise ConfigError(f"{path}: [{table.name}] is missing")


def one_table(data: Mapping[str, Any], keys: KeyTable, path: Path) -> Table:
    """The table of these keys; an empty one if the file has none."""
    return Table(data.get(keys.name, {}), keys, path)


def list_of_tables(data: Mapping[str, Any], keys: KeyTable, path: Path) -> list[Table]:
    """The tables [[name]] of these keys, each checked for its keys."""
    entries = data.get(keys.name, [])
    if not isinstance(entries, list):
        raise ConfigError(f"{path}: [{keys.name}] must be written [[{keys.name}]], once for each")
    return [Table(entry, keys, path, number) for number, entry in enumerate(entries, 1)]

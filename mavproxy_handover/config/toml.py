# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a configuration file: TOML, table by table and key by key.

Every error is one line that names the file, the table, the key, the value and what is allowed. An unknown key is an
error. It is reported before missing keys: a misspelt `key` is the reason why there is none.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

from mavproxy_handover.link.forms import LinkError, parse_device

__all__ = [
    "ConfigError",
    "Ranges",
    "Table",
    "check_tables",
    "list_of_tables",
    "parse_toml",
    "parse_value",
    "read_file",
    "read_toml",
]

#: key -> lowest and highest value allowed
Ranges = Mapping[str, tuple[float, float]]

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
    """One TOML table. Raises ConfigError if it is no table, or holds a key that is not one of `keys`."""

    def __init__(self, data: Any, where: str, file: Path, keys: Sequence[str]) -> None:
        """`where`: the table's name in errors, as in the file without brackets."""
        if not isinstance(data, Mapping):
            raise ConfigError(f"{file}: [{where}] must be a table")
        self._data = data
        self._where = where
        self._file = file
        self._keys = keys
        for key in data:
            if key not in keys:
                near = difflib.get_close_matches(key, keys, 1)
                hint = f"did you mean {near[0]!r}?" if near else "allowed are: " + ", ".join(keys)
                raise self.error(key, f"unknown key; {hint}")

    def error(self, key: str, text: str) -> ConfigError:
        """The error of one key."""
        return ConfigError(f"{self._file}: [{self._where}] {key}: {text}")

    def get(self, key: str, kind: type, default: Any = None, *, required: bool = False) -> Any:
        """The value of `key`, which must be a `kind`; `default` if it is missing. A float may be written without a
        point.
        """
        assert key in self._keys, f"[{self._where}] {key} is asked for and not allowed"
        if key not in self._data:
            if required:
                raise self.error(key, f"is missing; it must be {_KIND_NAMES[kind]}")
            return default
        value = self._data[key]
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 2**63 else math.inf
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            raise self.error(key, f"{value!r} must be {_KIND_NAMES[kind]}")
        return value

    def path(self, key: str) -> Path | None:
        """A path, relative to the folder of the file; None if it is missing."""
        text: str | None = self.get(key, str)
        return None if text is None else self._file.parent / text

    def sysid(self, key: str, *, required: bool = True, default: int = 0) -> int:
        """A MAVLink system id."""
        value: int = self.get(key, int, default, required=required)
        if not 1 <= value <= 255:
            raise self.error(key, f"{value} must be a MAVLink system id, 1 to 255")
        return value

    def name(self, key: str) -> str:
        """A name that fits into our messages."""
        value: str = self.get(key, str, required=True)
        if not 1 <= len(value) <= 20 or not value.isprintable() or not value.isascii():
            raise self.error(key, f"{value!r} must be 1 to 20 printable ASCII characters")
        return value

    def link(self, key: str, value: Any) -> str:
        """`value` as a link in pymavlink's device form. It is given, because a key may hold a list of links; `key` is
        for the error.
        """
        try:
            return parse_device(value).text
        except LinkError as error:
            raise self.error(key, str(error).removeprefix("link ")) from None

    def numbers(self, ranges: Ranges) -> dict[str, float]:
        """The numbers of the table, each checked against its range."""
        values = {}
        for key, (low, high) in ranges.items():
            value: float | None = self.get(key, float)
            if value is None:
                continue
            if not low <= value <= high:
                raise self.error(key, f"{value:g} must be {low:g} to {high:g}")
            values[key] = value
        return values


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


def check_tables(data: Mapping[str, Any], path: Path, allowed: tuple[str, ...], required: tuple[str, ...]) -> None:
    """Raise ConfigError for an unknown table, or a missing one that is required."""
    for key in data:
        if key not in allowed:
            near = difflib.get_close_matches(key, allowed, 1)
            hint = f"did you mean [{near[0]}]?" if near else "allowed are: " + ", ".join(allowed)
            raise ConfigError(f"{path}: unknown table [{key}]; {hint}")
    for key in required:
        if key not in data:
            raise ConfigError(f"{path}: [{key}] is missing")


def list_of_tables(data: Mapping[str, Any], key: str, path: Path, keys: Sequence[str]) -> list[Table]:
    """The tables [[key]], each checked for its allowed keys."""
    entries = data.get(key, [])
    if not isinstance(entries, list):
        raise ConfigError(f"{path}: [{key}] must be written [[{key}]], once for each")
    return [Table(entry, f"{key} {number}", path, keys) for number, entry in enumerate(entries, 1)]

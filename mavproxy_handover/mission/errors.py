# SPDX-License-Identifier: GPL-3.0-or-later

"""The error of this package, and checks of values that raise it.

A mission package is configuration: a fault is reported before flight, in one line. The line names the file, the place
in it, what is wrong and what is allowed. `Where` carries file and place while a file is read.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

from mavproxy_handover.tools.key_table import Key

__all__ = ["Faults", "MissionError", "Where", "parse_json"]

_SHOWN_LENGTH = 40
_T = TypeVar("_T")


class MissionError(ValueError):
    """A mission package, or a part of it, is not usable. Its text is one line.

    `grave`: it takes away a safeguard. `faults`: the text of each fault, if several were found at once.
    """

    def __init__(self, message: str, *, grave: bool = False, faults: tuple[str, ...] = ()) -> None:
        text = " ".join(message.split())
        super().__init__(text)
        self.grave = grave
        self.faults = faults or (text,)


class Faults:
    """Collects the faults of a mission, so that all of them are told at once."""

    def __init__(self) -> None:
        self._found: list[MissionError] = []

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note a MissionError that the block raises, and go on after the block."""
        try:
            yield
        except MissionError as error:
            self._found.append(error)

    def get(self, make: Callable[[], _T]) -> _T | None:
        """What `make` returns, or None if it raises MissionError, which is noted."""
        with self.noted():
            return make()
        return None

    def raise_all(self) -> None:
        """Raise MissionError if faults were noted: the gravest first, then in the order of the file."""
        found = sorted(self._found, key=lambda error: not error.grave)
        if not found:
            return
        faults = tuple(fault for error in found for fault in error.faults)
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise MissionError(f"{faults[0]}{more}", grave=found[0].grave, faults=faults)


@dataclass(frozen=True, slots=True)
class Where:
    """A place in a file of a mission package; every check below returns the value or raises MissionError."""

    file: str
    place: str = ""

    def at(self, place: str) -> Where:
        """The place `place` inside this one."""
        return Where(self.file, f"{self.place}, {place}" if self.place else place)

    def error(self, problem: str, *, grave: bool = False) -> MissionError:
        """An error here; the caller raises it. `grave`: what is here takes away a safeguard."""
        return MissionError(": ".join(part for part in (self.file, self.place, problem) if part), grave=grave)

    def number(self, value: object, name: str, low: float, high: float) -> float:
        """A finite number from `low` to `high`, both allowed."""
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise self.error(f"{name} is {_shown(value)} (allowed: a number from {low:g} to {high:g})")
        return float(value)

    def whole(self, value: object, name: str, low: int, high: int) -> int:
        """A whole number from `low` to `high`, both allowed; 3.0 is one."""
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(f"{name} is {_shown(value)} (allowed: a whole number from {low} to {high})")
        return value

    def text(self, value: object, name: str, longest: int) -> str:
        """Printable text of at most `longest` characters, not empty."""
        if not isinstance(value, str) or not value.strip() or len(value) > longest or not value.isprintable():
            raise self.error(f"{name} is {_shown(value)} (allowed: printable text of 1 to {longest} characters)")
        return value

    def choice(self, value: object, name: str, allowed: Iterable[str]) -> str:
        """One of the words of `allowed`."""
        words = tuple(allowed)
        if not isinstance(value, str) or value not in words:
            raise self.error(f"{name} is {_shown(value)} (allowed: {', '.join(words)})")
        return value

    def flag(self, value: object, name: str) -> bool:
        """True or false."""
        if not isinstance(value, bool):
            raise self.error(f"{name} is {_shown(value)} (allowed: true or false)")
        return value

    def of_key(self, key: Key, value: object) -> Any:
        """A value of a key that is a number, a whole number, true or false, or one of some words."""
        if key.kind is bool:
            return self.flag(value, key.name)
        if key.words:
            return self.choice(value, key.name, key.words)
        assert key.limits is not None
        low, high = key.limits
        if key.kind is int:
            return self.whole(value, key.name, int(low), int(high))
        return self.number(value, key.name, low, high)

    def table(self, value: object, name: str) -> Mapping[str, object]:
        """A JSON object or a TOML table."""
        if not isinstance(value, dict):
            raise self.error(f"{name} is {_shown(value)} (allowed: a table of keys and values)")
        return value

    def array(self, value: object, name: str) -> list[object]:
        """A JSON or TOML array."""
        if not isinstance(value, list):
            raise self.error(f"{name} is {_shown(value)} (allowed: a list)")
        return value

    def need(self, table: Mapping[str, object], key: str) -> object:
        """The value of a key that must be there."""
        if key not in table:
            raise self.error(f"key '{key}' is missing")
        return table[key]

    def known_keys(self, table: Mapping[str, object], allowed: Iterable[str]) -> None:
        """Refuse unknown keys: a misspelt limit must not pass for a limit."""
        words = tuple(allowed)
        for key in table:
            if key not in words:
                near = difflib.get_close_matches(key, words, n=1)
                hint = f", did you mean '{near[0]}'?" if near else ""
                raise self.error(f"unknown key '{_plain(key)}'{hint} (allowed: {', '.join(words)})")


def parse_json(text: str, where: Where) -> object:
    """Parse strict JSON (no NaN, no Infinity). Raises MissionError with line and column."""

    def refuse(constant: str) -> NoReturn:
        raise where.error(f"{constant} is not JSON (allowed: finite numbers, null)")

    try:
        return json.loads(text, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise where.at(f"line {error.lineno}, column {error.colno}").error(f"not JSON: {error.msg}") from None
    except MissionError:
        raise
    except (ValueError, RecursionError):
        # a number of thousands of digits, or brackets nested thousands deep: no real mission has these
        raise where.error("not JSON that a mission can hold (a number or a nesting out of all bounds)") from None


def _plain(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)[:_SHOWN_LENGTH]


def _shown(value: object) -> str:
    """A value as an error line shows it: short, one line, never longer than the problem."""
    if isinstance(value, str):
        return f"'{_plain(value)}'"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    try:
        return str(value)[:_SHOWN_LENGTH]
    except ValueError:
        return "a number of thousands of digits"

# SPDX-License-Identifier: GPL-3.0-or-later

"""Tables of configuration keys: name, default, range, unit and meaning of each key, written once.

The reader of a file, the sample that `handover init` writes and the reference are made from these tables. The default
of a limit is that of the rule's own dataclass.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from textwrap import dedent
from types import MappingProxyType
from typing import Any, Final

__all__ = ["Key", "KeyTable", "called", "flag", "items", "number", "numbers", "sysid", "text", "whole", "word"]

_NO_EXAMPLES: Final[Mapping[str, float]] = MappingProxyType({})
#: end of a key's name -> unit
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
    """One key of a table."""

    name: str
    #: int, float, str, bool, list; object: a word or a list
    kind: type[Any]
    #: what it means, for people
    says: str
    #: value if the key is missing; None: there is none
    default: Any = None
    required: bool = False
    #: lowest and highest value allowed, also of the whole numbers in a list
    limits: tuple[float, float] | None = None
    #: words allowed
    words: tuple[str, ...] = ()
    #: regular expression that a text must match
    pattern: str = ""
    #: what is allowed, if limits and words do not say it
    rule: str = ""
    unit: str = ""
    #: value in the sample, if there is no default
    example: Any = None

    @property
    def allowed(self) -> str:
        """What is allowed, for people; "" if that is every value of its kind."""
        if self.rule or self.limits is None:
            return self.rule or ", ".join(self.words)
        low, high = self.limits
        return f"{low:.12g} to {high:.12g}"


@dataclass(frozen=True, slots=True)
class KeyTable:
    """One table of a file. `many`: it is written [[name]], once for each. `says`: its purpose, for people."""

    name: str
    keys: tuple[Key, ...]
    says: str = ""
    many: bool = False
    required: bool = False
    _by_name: Mapping[str, Key] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_name", {key.name: key for key in self.keys})

    def __getitem__(self, name: str) -> Key:
        return self._by_name[name]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its keys, in order."""
        return tuple(self._by_name)

    @property
    def header(self) -> str:
        """Its first line in a file."""
        return f"[[{self.name}]]" if self.many else f"[{self.name}]"


# ---- kinds of keys -------------------------------------------------------------------------------------------------


def number(
    name: str, low: float, high: float, says: str, default: float | None = None, *, unit: str = "", example: Any = None
) -> Key:
    """A number in a range. Its unit follows from its name."""
    unit = unit or next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")
    return Key(name, float, says, default, limits=(low, high), unit=unit, example=example)


def numbers(table: str, defaults: object, examples: Mapping[str, float] = _NO_EXAMPLES) -> tuple[Key, ...]:
    """Numbers from a table of text with a row for each: `name lowest to highest meaning`.

    A row may go on in lines that are indented further. `defaults`: an object with attributes of these names; None, or
    no attribute: no default.
    """
    keys = []
    for row in re.split(r"\n(?! )", dedent(table).strip()):
        name, low, _to, high, *says = row.split()
        example = examples.get(name)
        keys.append(
            number(name, float(low), float(high), " ".join(says), getattr(defaults, name, None), example=example)
        )
    return tuple(keys)


def whole(name: str, low: int, high: int, says: str, *, required: bool = False, example: Any = None) -> Key:
    """A whole number in a range."""
    return Key(name, int, says, required=required, limits=(low, high), example=example)


def word(name: str, words: tuple[str, ...], says: str, default: str | None = None, *, required: bool = False) -> Key:
    """One of these words."""
    return Key(name, str, says, default, required, words=words, example=words[0])


def flag(name: str, says: str, *, default: bool) -> Key:
    """True or false."""
    return Key(name, bool, says, default)


def text(
    name: str, says: str, default: str | None = None, *, required: bool = False, rule: str = "", example: Any = None
) -> Key:
    """A text."""
    return Key(name, str, says, default, required, rule=rule, example=example)


def items(
    name: str,
    says: str,
    default: list[int] | None = None,
    *,
    required: bool = False,
    limits: tuple[float, float] | None = None,
    rule: str = "",
    example: Any = None,
) -> Key:
    """A list; with `limits` of whole numbers."""
    return Key(name, list, says, default, required, limits, rule=rule, example=example)


def sysid(name: str, says: str, default: int | None = None) -> Key:
    """A MAVLink system id, required if there is no default."""
    return Key(name, int, says, default, default is None, (1, 255), rule="a MAVLink system id, 1 to 255")


def called(name: str, says: str) -> Key:
    """A name that fits into our messages."""
    return Key(name, str, says, required=True, pattern="[ -~]{1,20}", rule="1 to 20 printable ASCII characters")

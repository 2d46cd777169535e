# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the unit of `handover install`, with drop-ins that change it."""

from __future__ import annotations

import configparser
import shlex
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

__all__ = ["Unit", "read_unit"]

_UNITS: Final = Path("etc/systemd/system")
_WANTS: Final = _UNITS / "multi-user.target.wants"


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit. `words`: its command line, the program first. `enabled`: it starts with the machine."""

    path: Path
    words: tuple[str, ...]
    user: str
    enabled: bool

    @property
    def program(self) -> PurePosixPath | None:
        """Path of its program on that machine."""
        return PurePosixPath(self.words[0].lstrip("-+!:@")) if self.words else None

    def option(self, name: str) -> str | None:
        """Value of an option of its command line; None if it is missing."""
        for number, word in enumerate(self.words):
            if word == name and number + 1 < len(self.words):
                return self.words[number + 1]
            if word.startswith(f"{name}="):
                return word.partition("=")[2]
        return None


def read_unit(kind: str, root: Path) -> Unit | None:
    """Read the unit of a companion or a station; None if none is installed. Raises ValueError (one line) and
    OSError.
    """
    name = f"handover-{kind}.service"
    path = root / _UNITS / name
    if not path.is_file():
        return None
    words: tuple[str, ...] = ()
    user = "root"
    for each in (path, *sorted((root / _UNITS / f"{name}.d").glob("*.conf"))):
        # a drop-in that empties ExecStart and sets it again has the key twice: the last one counts
        unit = configparser.ConfigParser(strict=False, interpolation=None)
        unit.optionxform = str  # type: ignore[assignment, method-assign]
        try:
            unit.read_string(each.read_text(encoding="utf-8"))
            line = unit.get("Service", "ExecStart", fallback="")
            words = tuple(shlex.split(line)) or words
        except (configparser.Error, ValueError) as error:
            raise ValueError(f"{each}: {' '.join(str(error).split())}") from None
        user = unit.get("Service", "User", fallback=user)
    return Unit(path, words, user, (root / _WANTS / name).is_symlink() or (root / _WANTS / name).exists())

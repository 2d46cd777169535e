# SPDX-License-Identifier: GPL-3.0-or-later

"""What the doctor has to say: one finding for each thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["Finding", "Level", "error", "ok", "unseen", "warning"]


class Level(Enum):
    """How bad it is. An error is what keeps a flight from going as planned, or from going at all."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    `do`: what to do about it, one sentence; "" where all is well. `looked`: False where it could not be looked at.
    """

    level: Level
    what: str
    found: str
    do: str = ""
    looked: bool = True


def ok(what: str, found: str) -> Finding:
    """All is well with it."""
    return Finding(Level.OK, what, found)


def warning(what: str, found: str, do: str) -> Finding:
    """It may be meant so, and it may do harm one day."""
    return Finding(Level.WARNING, what, found, do)


def error(what: str, found: str, do: str) -> Finding:
    """It is wrong."""
    return Finding(Level.ERROR, what, found, do)


def unseen(what: str, why: str, do: str) -> Finding:
    """It could not be looked at: nobody knows whether it is well."""
    return Finding(Level.WARNING, what, f"not looked at: {why}", do, looked=False)

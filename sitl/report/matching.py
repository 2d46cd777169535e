# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether an entry of a journal is one that a scenario means, and how to say it."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from sitl.report.journal_reader import Entry

__all__ = ["Match", "describe", "last_line", "matches"]


@dataclass(frozen=True, slots=True)
class Match:
    """Values that an entry of a journal must have, by key. Texts may hold the wildcards * and ?."""

    values: tuple[tuple[str, Any], ...] = ()


def matches(entry: Entry, who: str = "", event: str = "", match: Match | None = None) -> bool:
    """True when the entry has that source and that event (empty: any) and every value of `match`.

    A text of `match` may hold the wildcards * and ?; a list means any of its values.
    """
    if who and entry.who != who:
        return False
    if event and entry.event != event:
        return False
    return all(_equal(entry.get(key), wanted) for key, wanted in (match or Match()).values)


def _equal(value: Any, wanted: Any) -> bool:
    match wanted:
        case list():
            return any(_equal(value, one) for one in wanted)
        case str():
            return value is not None and fnmatchcase(str(value), wanted)
        case bool():
            return value is wanted
        case _:  # a number, which true and false are not
            return type(value) is not bool and value == wanted


def describe(who: str, event: str, match: Match) -> str:
    """The pattern in words."""
    parts = [event.replace("_", " ")] if event else []
    parts += [f"{key} {wanted}" for key, wanted in match.values]
    return (", ".join(parts) or "anything") + (f" ({who})" if who else "")


def last_line(text: str) -> str:
    """The essence of a fault's text: where it was noticed and the last line of the trace."""
    lines = text.strip().splitlines() or [""]
    return lines[0] if len(lines) == 1 else f"{lines[0].split(':', 1)[0]}: {lines[-1].strip()}"

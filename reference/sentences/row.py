# SPDX-License-Identifier: GPL-3.0-or-later

"""The form of the tables of sentences: rows, groups of rows, and the values that stand in them.

A group holds whole sentences, or parts that stand in sentences. A template has its values in braces:

* the name of a group of parts, `{need}`: one of its rows, by itself or in a list (`LISTS`);
* a name of `VALUES`: what the programs write there.

The tables are for the reference and for tests. Nothing that flies imports them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.core.common.levels import Level

__all__ = ["LISTS", "NOTHING", "VALUES", "Group", "Sentence"]

#: the action of a row that asks for none
NOTHING: Final = "Nothing."


@dataclass(frozen=True, slots=True)
class Sentence:
    """One sentence, or a part of sentences: what is shown, its level, what it means and what to do."""

    template: str
    level: Level
    meaning: str
    action: str = NOTHING


@dataclass(frozen=True, slots=True)
class Group:
    """Rows that people meet at one place. `name`: what templates call it; `whole`: its rows are whole sentences."""

    name: str
    title: str
    intro: str
    rows: tuple[Sentence, ...]
    whole: bool = True


#: name in a template -> name of the group, and what stands between two of its rows
LISTS: Final[Mapping[str, tuple[str, str]]] = {
    "needs": ("need", "; "),
    "limits": ("limit", ", "),
    "troubles": ("battery", ", "),
    "site_figures": ("site", ", "),
}

_NUMBER: Final = r"-?(?:\d+(?:\.\d+)?|inf|nan)(?:e[+-]?\d+)?"
_NAME: Final = r"[\w.@-]+"
#: name in a template -> the values that it stands for
VALUES: Final[Mapping[str, str]] = {
    # names of stations, vehicles, packages and people
    **dict.fromkeys(("station", "other", "commander", "partner", "name", "package", "vehicle"), _NAME),
    "stations": rf"{_NAME}(?:,? {_NAME})*",
    # numbers
    **dict.fromkeys(
        ("number", "seconds", "metres", "count", "items", "epoch", "waypoint", "system", "component", "value", "most"),
        _NUMBER,
    ),
    "percent": r"-?\d+ ?%",
    "digest": r"[0-9a-f]+",
    # what the autopilot, the operating system or a file says
    **dict.fromkeys(("autopilot", "reason", "error", "file"), r".+"),
    # words in capitals: modes, actions, parameters
    **dict.fromkeys(("mode", "command", "parameter"), r"[A-Za-z](?:[\w -]*\w)?"),
}

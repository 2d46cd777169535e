# SPDX-License-Identifier: GPL-3.0-or-later

"""The words and colours of a station's terminal: status line, prompt, lines. Pure.

The status line names the station that commands, what comes next, and the aircraft's values with their age. It ends with
the time of day, so that a line that stands still shows it. Of several aircraft the most urgent is first, until the line
is full.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gcs_module.alarms import Level
from gcs_module.banner import Situation, banner

__all__ = ["Craft", "line_colour", "prompt", "status", "status_colour", "who"]

_RESET: Final = "\x1b[0m"
#: level -> colours of the status line (SGR)
_STATUS: Final[Mapping[Level, str]] = {
    Level.INFO: "7",
    Level.ADVISORY: "97;44",
    Level.WARNING: "30;43",
    Level.EMERGENCY: "1;97;41",
}
#: MAVProxy's colours of a line, text and background -> SGR. Others have none: green for every INFO says nothing
_LINES: Final[Mapping[tuple[Any, Any], str]] = {
    ("white", "red"): "1;97;41",
    ("black", "orange"): "30;43",
    ("black", "yellow"): "30;43",
    ("blue", "white"): "36",
}
_RED: Final = "31"
#: words before the status line if it has no colours
_WORDS: Final[Mapping[Level, str]] = {Level.WARNING: "WARNING ", Level.EMERGENCY: "EMERGENCY "}
#: least width of a prompt, so that the typed text stays in its column while mode and commander change
_PROMPT_CELLS: Final = 16
_END: Final = "> "


@dataclass(frozen=True, slots=True)
class Craft:
    """An aircraft in the status line. `values`: height, speed and battery with their age; "": not known."""

    situation: Situation
    values: str


def status(station: str, crafts: Sequence[Craft], clock: str, width: int, *, colour: bool) -> tuple[str, Level]:
    """The status line for a terminal of this width, and its level."""
    told = sorted(((*banner(each.situation), each.values) for each in crafts), key=lambda each: -each[1])
    worst = told[0][1] if told else Level.INFO
    begin = f"{'' if colour else _WORDS.get(worst, '')}{station} | "
    room = width - len(begin) - len(clock) - 2
    parts: list[str] = []
    for text, _level, _values in told:
        if parts and len(" | ".join((*parts, text))) > room:
            parts.append(f"+{len(told) - len(parts)}")
            break
        parts.append(text)
    if len(told) == 1 and told[0][2] and len(parts[0]) + len(told[0][2]) + 3 <= room:
        parts.append(told[0][2])
    words = " | ".join(parts)[: max(0, room)]
    return f" {begin}{words}{' ' * (room - len(words))} {clock}"[:width], worst


def status_colour(level: Level, *, colour: bool) -> str:
    """The control sequence before the status line. Without colours it is inverted."""
    return f"\x1b[{_STATUS[level] if colour else '7'}m"


def line_colour(line: str, fg: Any, bg: Any) -> str:
    """A line with the colours that MAVProxy's console would give it."""
    code = _LINES.get((fg, bg)) or (_RED if fg == "red" else "")
    return f"\x1b[{code}m{line}{_RESET}" if code else line


def who(now: Situation | None) -> str:
    """The station that commands, for the prompt: "YOU", its name, "NONE"; "" if that is not known."""
    if now is None or now.old:
        return ""
    return "YOU" if now.own else now.commander or "NONE"


def prompt(mavproxys: str, now: Situation | None, cells: int = 0, *, fixed: bool = False) -> str:
    """MAVProxy's prompt with the station that commands before it: "YOU AUTO> ".

    `fixed`: padded to `cells`, or to the least width if that is 0, and cut to it. Other prompts stay as they are.
    """
    if not mavproxys.endswith(_END):
        return mavproxys
    words = f"{who(now)} {mavproxys.removesuffix(_END)}".lstrip()
    if not fixed:
        return f"{words}{_END}"
    cells = cells or max(_PROMPT_CELLS, len(words) + len(_END))
    return f"{words[: cells - len(_END)]}{_END}".ljust(cells)

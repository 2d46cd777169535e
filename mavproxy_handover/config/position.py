# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads `[position]`: source of the position, address of the box, layout of its record, limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.box_layouts import ENDING, parse_layout
from mavproxy_handover.config.toml import Ranges, Table, read_file
from mavproxy_handover.link.box_line import box_address
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.wire.box_layout import LAYOUTS, THESIS, BoxLayout

__all__ = ["CHECKS", "POSITION_RANGES", "SOURCES", "PositionSettings", "position_settings"]

AUTOPILOT, BOX = SOURCES = ("autopilot", "box")
#: when the two positions are compared: always, or once the aircraft is armed
ALWAYS, ARMED = CHECKS = ("always", "armed")

#: Upper limits are so low that a position in another zone never passes. Lower limits are so high that two good
#: receivers never disagree. 0 s unchecked: the box never counts without the autopilot's position
POSITION_RANGES: Final[Ranges] = {
    "box_age_s": (0.1, 5),
    "apart_m": (2, 1000),
    "apart_height_m": (2, 1000),
    "apart_mps": (1, 50),
    "apart_s": (0.2, 30),
    "agree_s": (0.5, 60),
    "unchecked_s": (0, 600),
}
_WORDS: Final = ("source", "box", "layout", "check")


@dataclass(frozen=True, slots=True)
class PositionSettings:
    """Source of the position, and limits outside which it does not count."""

    source: str = AUTOPILOT
    #: address of the box, tcp:HOST:PORT; "": there is none
    box: str = ""
    check: str = ALWAYS
    #: a record that is later than this is not used (s)
    box_age_s: float = 0.5
    #: limits: metres over ground, metres of height, difference of the speeds over ground
    apart_m: float = 25.0
    apart_height_m: float = 30.0
    apart_mps: float = 8.0
    #: time (s) above a limit until they disagree
    apart_s: float = 2.0
    #: time (s) well within all limits until they agree again
    agree_s: float = 5.0
    #: time (s) for which the box counts without a position to compare
    unchecked_s: float = 10.0
    #: layout of the box's record
    layout: BoxLayout = THESIS
    #: the file that the layout comes from; None: it is a known one
    layout_file: Path | None = None
    layout_text: bytes | None = field(default=None, repr=False)


def position_settings(data: Mapping[str, Any], path: Path, layout_text: bytes | None = None) -> PositionSettings:
    """Parse `[position]`, if it is there. `layout_text`: content of the layout's file; None: read it.

    Raises ConfigError.
    """
    table = Table(data.get("position", {}), "position", path, (*_WORDS, *POSITION_RANGES))
    source, check = _word(table, "source", SOURCES), _word(table, "check", CHECKS)
    box = table.get("box", str, "")
    if box:
        try:
            box = box_address(box)
        except LinkError as error:
            raise table.error("box", str(error).removeprefix("link ")) from None
    elif source == BOX:
        raise table.error("box", "is missing: where is the box? It must be tcp:HOST:PORT")
    layout, file, text = _layout(table, path, layout_text)
    numbers = table.numbers(POSITION_RANGES)
    return PositionSettings(source, box, check, layout=layout, layout_file=file, layout_text=text, **numbers)


def _layout(table: Table, path: Path, text: bytes | None) -> tuple[BoxLayout, Path | None, bytes | None]:
    """The layout, and the file that it comes from with its text. Raises ConfigError."""
    word: str = table.get("layout", str, THESIS.name)
    if word in LAYOUTS:
        return LAYOUTS[word], None, None
    if not word.endswith(ENDING):
        known = ", ".join(LAYOUTS)
        raise table.error("layout", f"{word!r} must be one of {known}, or a layout's file, which ends with {ENDING}")
    file = path.parent / word
    text = read_file(file) if text is None else text
    return parse_layout(text, file), file, text


def _word(table: Table, key: str, allowed: tuple[str, ...]) -> str:
    word: str = table.get(key, str, allowed[0])
    if word not in allowed:
        raise table.error(key, f"{word!r} must be one of " + ", ".join(allowed))
    return word

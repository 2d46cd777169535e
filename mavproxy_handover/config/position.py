# SPDX-License-Identifier: GPL-3.0-or-later

"""`[position]`: whose word of where the aircraft is counts, where the position box is, and how far it is believed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import Ranges, Table
from mavproxy_handover.link.box_line import box_address
from mavproxy_handover.link.forms import LinkError

__all__ = ["CHECKS", "POSITION_RANGES", "SOURCES", "PositionSettings", "position_settings"]

AUTOPILOT, BOX = SOURCES = ("autopilot", "box")
#: when the two positions are held against each other: always, or once the aircraft is armed
ALWAYS, ARMED = CHECKS = ("always", "armed")

#: no limit is so wide that a position in another zone passes for the same one, none so narrow that two good receivers
#: fall out over it; 0 s unchecked: never without the other's word
POSITION_RANGES: Final[Ranges] = {
    "box_age_s": (0.1, 5),
    "apart_m": (2, 1000),
    "apart_height_m": (2, 1000),
    "apart_mps": (1, 50),
    "apart_s": (0.2, 30),
    "agree_s": (0.5, 60),
    "unchecked_s": (0, 600),
}
_WORDS: Final = ("source", "box", "check")


@dataclass(frozen=True, slots=True)
class PositionSettings:
    """Whose position counts, and when it does not."""

    source: str = AUTOPILOT
    #: where the box is, tcp:HOST:PORT; "": there is none
    box: str = ""
    check: str = ALWAYS
    #: a record that is later than this is not used (s)
    box_age_s: float = 0.5
    #: the two positions are apart: metres over ground, metres of height, difference of their speeds over ground
    apart_m: float = 25.0
    apart_height_m: float = 30.0
    apart_mps: float = 8.0
    #: for so long, and they disagree (s)
    apart_s: float = 2.0
    #: together well within these limits for so long, and they agree again (s)
    agree_s: float = 5.0
    #: so long the box counts while there is nothing to hold it against (s)
    unchecked_s: float = 10.0


def position_settings(data: Mapping[str, Any], path: Path) -> PositionSettings:
    """What `[position]` says, where it is there. Raises ConfigError."""
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
    return PositionSettings(source, box, check, **table.numbers(POSITION_RANGES))


def _word(table: Table, key: str, allowed: tuple[str, ...]) -> str:
    word: str = table.get(key, str, allowed[0])
    if word not in allowed:
        raise table.error(key, f"{word!r} must be one of " + ", ".join(allowed))
    return word

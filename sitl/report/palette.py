# SPDX-License-Identifier: GPL-3.0-or-later

"""Colours of a report: those of every picture (`mission/colours.py`), and of what only a flight has.

Whatever is drawn is drawn in the light colours. A page swaps them where its reader's screen is dark: `dark` says which
for which.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from mavproxy_handover.mission.colours import (
    ALARM,
    DARK,
    GRID,
    GROUND,
    INK,
    NOBODY,
    PAPER,
    SOFT,
    WARNING,
    WELL,
    station_colour,
)
from sitl.report.evidence import NOBODY as NOBODY_NAME

__all__ = [
    "ALARM",
    "GRID",
    "GROUND",
    "GUARDS",
    "INK",
    "LEASES",
    "LINKS",
    "NOBODY_COLOUR",
    "PAPER",
    "PHASES",
    "PLAIN",
    "SILENT",
    "SOFT",
    "WARNING",
    "WELL",
    "colours",
    "dark",
]

NOBODY_COLOUR = NOBODY
_BAD: Final = "#e8a0a0"
#: neighbours without a colour of their own take turns; SILENT: no entries any more
PLAIN, SILENT = ("#e3e3e3", "#f1f1f1"), "#c4c4c4"
PHASES: Final = {"on_load": "#d9d9d9", "on_mission": "#bfd9ec", "on_handover": WARNING, "emergency": _BAD}
LEASES: Final = {"held": WELL, "transfer": WARNING, "lost": _BAD, "recovering": "#e6cfe0", "alone": "#e6cfe0"}
GUARDS: Final = {"live": WELL, "expired": _BAD, "lost": _BAD, "disabled": SILENT, "waiting": WARNING}
LINKS: Final = {"heard": WELL, "weak": WARNING, "silent": _BAD}
_DARK: Final = {
    **DARK,
    _BAD: "#8c3636",
    PLAIN[0]: "#3a4048",
    PLAIN[1]: "#2b3037",
    SILENT: "#565c64",
    "#d9d9d9": "#454b53",
    "#bfd9ec": "#2c5069",
    "#e6cfe0": "#6b4a62",
}


def colours(stations: Sequence[str]) -> dict[str, str]:
    """Station -> colour, the vehicle's parent first; grey stands for no station."""
    found = {name: station_colour(index) for index, name in enumerate(stations)}
    found[NOBODY_NAME] = NOBODY_COLOUR
    return found


def dark() -> dict[str, str]:
    """Light colour -> the one for a dark screen, all in small letters."""
    return {light.lower(): deep.lower() for light, deep in _DARK.items()}

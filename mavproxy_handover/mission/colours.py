# SPDX-License-Identifier: GPL-3.0-or-later

"""The colours of all pictures: map of a mission, report of a flight, map of a ground station.

The stations have Okabe and Ito's palette, which people with any colour vision can tell apart. Stations get the colours
in their order, the parent first. A picture on a dark background uses `DARK` to replace colours.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

__all__ = [
    "ALARM",
    "DARK",
    "DELIVERY",
    "GRID",
    "GROUND",
    "INK",
    "NOBODY",
    "PAPER",
    "RALLY",
    "SOFT",
    "STATION_COLOURS",
    "WARNING",
    "WELL",
    "rgb",
    "station_colour",
]

STATION_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
#: lines and text, quieter ones, the sheet, the background of a map, its grid
INK, SOFT, PAPER, GROUND, GRID = "#1b1b1b", "#8a8a8a", "#ffffff", "#fbfaf7", "#d9d6cf"
#: no commander; the delivery; a rally point
NOBODY, DELIVERY, RALLY = "#8d8d8d", "#F0E442", "#2ca02c"
#: an emergency, a warning, a good state
ALARM, WARNING, WELL = "#d00000", "#f5d76e", "#cfe8dc"
#: replacement of a colour on a dark background; other colours stay
DARK: Final = MappingProxyType(
    {
        INK: "#ece9e2",
        SOFT: "#9a978f",
        PAPER: "#15181c",
        GROUND: "#1b1f24",
        GRID: "#343a42",
        NOBODY: "#a3a3a3",
        ALARM: "#ff6b62",
        WARNING: "#8f7418",
        WELL: "#1f5a43",
        RALLY: "#5fc75f",
        "#0072B2": "#4aa3df",
        "#D55E00": "#f08a3e",
        "#009E73": "#2bc492",
        "#CC79A7": "#e39bc4",
    }
)


def station_colour(number: int) -> str:
    """The colour of the station with that place in the order, from 0, as "#rrggbb"."""
    return STATION_COLOURS[number % len(STATION_COLOURS)]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of "#rrggbb"."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue

# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations' colours, the same in every picture: map of a mission, report of a flight, map of a ground station.

Okabe and Ito's palette: told apart with every kind of colour vision. Stations take them in their order, the parent
first.
"""

from __future__ import annotations

from typing import Final

__all__ = ["STATION_COLOURS", "rgb", "station_colour"]

STATION_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def station_colour(number: int) -> str:
    """The colour of the station with that place in the order, from 0, as "#rrggbb"."""
    return STATION_COLOURS[number % len(STATION_COLOURS)]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of "#rrggbb"."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue

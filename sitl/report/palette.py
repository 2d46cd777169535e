# SPDX-License-Identifier: GPL-3.0-or-later

"""Colours of the pictures: the stations' as everywhere (`mission/colours.py`), and what no station has."""

from __future__ import annotations

from collections.abc import Sequence

from mavproxy_handover.mission.colours import station_colour
from sitl.report.evidence import NOBODY

__all__ = ["INK", "NOBODY_COLOUR", "PAPER", "colours"]

NOBODY_COLOUR = "#8A8A8A"
INK, PAPER = "#222222", "#FFFFFF"


def colours(stations: Sequence[str]) -> dict[str, str]:
    """Station -> colour, the vehicle's parent first; nobody is grey."""
    found = {name: station_colour(index) for index, name in enumerate(stations)}
    found[NOBODY] = NOBODY_COLOUR
    return found

# SPDX-License-Identifier: GPL-3.0-or-later

"""Colours of the pictures: the set of Okabe and Ito, which people with any kind of colour vision tell apart."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.report.evidence import NOBODY

__all__ = ["INK", "NOBODY_COLOUR", "PAPER", "colours"]

_STATIONS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
NOBODY_COLOUR = "#8A8A8A"
INK, PAPER = "#222222", "#FFFFFF"


def colours(stations: Sequence[str]) -> dict[str, str]:
    """Station -> colour, the vehicle's parent first; nobody is grey."""
    found = {name: _STATIONS[index % len(_STATIONS)] for index, name in enumerate(stations)}
    found[NOBODY] = NOBODY_COLOUR
    return found

# SPDX-License-Identifier: GPL-3.0-or-later

"""A second book-keeping of the causes, for the tests: written out by hand, not taken from the tables that it checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["EXPECTED", "Expected"]


@dataclass(frozen=True, slots=True)
class Expected:
    """What is expected of one cause.

    `times`: hold-off and clearing time in seconds, and whether it lasts as long as the flight. `noise`: the function of
    `test_whatever_comes.py` that makes it come and go; "": the monitor has the hysteresis. `off`: it can be switched
    off. `asks`: policy (the default first) -> what it asks for in the air, a letter for each combination of four facts:

        successor    --------++++++++
        gap          ----++++----++++
        may hold     --++--++--++--++
        place        -+-+-+-+-+-+-+-+
    """

    times: tuple[float, float, bool]
    noise: str
    asks: Mapping[str, str]
    off: bool = True


EXPECTED: Mapping[str, Expected] = {
    "energy": Expected((2.0, 0.0, True), "_energy", {
        "return": "LRLRLRLRLRLRLRLR",
        "land":   "LLLLLLLLLLLLLLLL",
        "warn":   "wwwwwwwwwwwwwwww",
    }),
    "commander_lost": Expected((0.0, 0.0, False), "_heartbeats", {
        "return": "LRLRCCCCTTTTTTTT",
        "land":   "LLLLCCCCTTTTTTTT",
        "warn":   "wwwwCCCCTTTTTTTT",
    }, off=False),
    "out_of_coverage": Expected((1.0, 0.0, False), "_margin", {
        "return": "LRLRCCCCLRLRCCCC",
        "land":   "LLLLCCCCLLLLCCCC",
        "warn":   "wwwwCCCCwwwwCCCC",
    }, off=False),
    "no_station": Expected((2.0, 1.0, False), "_off_station", {
        "return": "LRLRCCCCTTTTTTTT",
        "hold":   "LRHHCCCCTTTTTTTT",
        "land":   "LLLLCCCCTTTTTTTT",
        "warn":   "wwwwCCCCTTTTTTTT",
    }),
    "coverage_ends": Expected((0.0, 0.0, False), "_ahead", {
        "hold":   "LRHHCCCCLRHHCCCC",
        "return": "LRLRCCCCLRLRCCCC",
        "warn":   "wwwwCCCCwwwwCCCC",
    }),
    "authentication": Expected((0.0, 30.0, False), "_attack", {
        "warn":   "wwwwwwwwwwwwwwww",
        "hold":   "LRHHLRHHLRHHLRHH",
        "return": "LRLRLRLRLRLRLRLR",
        "land":   "LLLLLLLLLLLLLLLL",
    }),
    "links_weak": Expected((10.0, 10.0, False), "_links", {
        "warn":   "wwwwwwwwwwwwwwww",
        "hold":   "LRHHLRHHLRHHLRHH",
        "return": "LRLRLRLRLRLRLRLR",
        "land":   "LLLLLLLLLLLLLLLL",
    }),
    "guard_lost": Expected((3.0, 1.0, False), "_heartbeats", {
        "warn":   "wwwwwwwwwwwwwwww",
        "hold":   "LRHHLRHHLRHHLRHH",
        "return": "LRLRLRLRLRLRLRLR",
        "land":   "LLLLLLLLLLLLLLLL",
    }),
    "fence": Expected((1.0, 3.0, False), "", {
        "warn":   "wwwwwwwwwwwwwwww",
        "return": "LRLRLRLRLRLRLRLR",
        "land":   "LLLLLLLLLLLLLLLL",
    }),
    "off_route": Expected((0.0, 0.0, False), "", {
        "warn":   "wwwwwwwwwwwwwwww",
        "hold":   "LRHHLRHHLRHHLRHH",
        "return": "LRLRLRLRLRLRLRLR",
        "land":   "LLLLLLLLLLLLLLLL",
    }),
    "position_stale": Expected((1.0, 1.0, False), "_heartbeats", {
        "warn": "wwwwwwwwwwwwwwww",
        "land": "LLLLLLLLLLLLLLLL",
    }),
    "autopilot_lost": Expected((0.0, 1.0, False), "_heartbeats", {
        "warn": "wwwwwwwwwwwwwwww",
    }),
}  # fmt: skip

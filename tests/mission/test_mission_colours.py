# SPDX-License-Identifier: GPL-3.0-or-later

"""A station has one colour, whoever draws it."""

from __future__ import annotations

from mavproxy_handover.mission.colours import STATION_COLOURS, rgb, station_colour
from sitl.report.palette import colours


def test_the_report_of_a_flight_has_the_colours_of_the_map_of_its_mission() -> None:
    found = colours(("GCSA", "GCSB", "GCSC"))
    assert [found["GCSA"], found["GCSB"], found["GCSC"]] == ["#0072B2", "#D55E00", "#009E73"]
    assert [station_colour(number) for number in range(3)] == ["#0072B2", "#D55E00", "#009E73"]


def test_no_two_of_six_stations_look_alike_and_the_seventh_begins_anew() -> None:
    assert len({station_colour(number) for number in range(6)}) == 6
    assert station_colour(6) == STATION_COLOURS[0]


def test_a_colour_in_parts() -> None:
    assert rgb("#D55E00") == (213, 94, 0)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of a position box: what is above sea level, and what only changes with it."""

from __future__ import annotations

import math

import pytest

from mavproxy_handover.monitors.position.box_heights import BoxHeights, slack_m
from mavproxy_handover.wire.box_layout import BoxRecord


def record(alt_m: float = math.nan, baro_m: float = math.nan, agl_m: float = math.nan) -> BoxRecord:
    return BoxRecord(1.0, 52.679, 5.924, alt_m=alt_m, baro_m=baro_m, agl_m=agl_m)


def test_a_height_above_sea_level_is_one_whatever_the_autopilot_says() -> None:
    heights = BoxHeights()
    heights.level(record(alt_m=40.0, baro_m=90.0), 10.0, armed=False)
    assert heights.above_sea_m(record(alt_m=41.0, baro_m=95.0)) == 41.0


def test_pressure_altitude_is_levelled_on_the_ground_and_tells_changes_in_flight() -> None:
    heights = BoxHeights()
    heights.level(record(baro_m=75.0), 12.0, armed=False)
    heights.level(record(baro_m=77.0), 12.0, armed=False)  # the pressure falls while it waits
    heights.level(record(baro_m=107.0), 55.0, armed=True)
    assert heights.above_sea_m(record(baro_m=107.0)) == pytest.approx(42.0)


def test_after_a_restart_in_flight_it_is_levelled_once() -> None:
    heights = BoxHeights()
    heights.level(record(baro_m=107.0), 42.0, armed=True)
    heights.level(record(baro_m=117.0), 42.0, armed=True)
    assert heights.above_sea_m(record(baro_m=117.0)) == pytest.approx(52.0)


def test_height_above_ground_serves_where_there_is_no_pressure_altitude() -> None:
    heights = BoxHeights()
    heights.level(record(agl_m=0.0), 12.0, armed=False)
    assert heights.above_sea_m(record(agl_m=30.0)) == pytest.approx(42.0)
    heights.level(record(baro_m=75.0, agl_m=0.0), 12.0, armed=False)
    # a box that is started anew in flight sets itself to zero there, and its pressure altitude does not
    assert heights.above_sea_m(record(baro_m=105.0, agl_m=0.0)) == pytest.approx(42.0)


def test_without_a_height_nothing_is_said() -> None:
    heights = BoxHeights()
    assert math.isnan(heights.above_sea_m(record()))
    assert math.isnan(heights.above_sea_m(record(baro_m=75.0))), "it was not levelled"
    heights.level(record(), 12.0, armed=False)
    assert math.isnan(heights.above_sea_m(record()))


def test_the_air_may_make_a_barometric_height_wrong_and_no_other() -> None:
    assert slack_m(record(baro_m=175.0), 100.0) == pytest.approx(12.0)
    assert slack_m(record(baro_m=175.0), -50.0) == pytest.approx(6.0)
    assert slack_m(record(alt_m=112.0, baro_m=175.0), 100.0) == 0.0

# SPDX-License-Identifier: GPL-3.0-or-later

"""Circles and splines as they are walked, against those that ArduCopter flies. Needs an ArduCopter SITL program.

In calm, at 10 m/s. ArduCopter flies a circle inside of the one that it is told, and the walk has the flown one.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.plan import Home, Route
from mavproxy_handover.mission.route_simulation import legs_of
from sitl.vehicles import find_arducopter
from tests.sitl.curve_flight import fly, hold_against
from tests.sitl.guard_flight import HOME

pytestmark = [
    pytest.mark.sitl,
    pytest.mark.skipif(
        find_arducopter() is None,
        reason="no ArduCopter SITL program: set $ARDUCOPTER or build one in ~/ardupilot (waf copter)",
    ),
]

TAKEOFF, WAYPOINT, TURNS, TIME, RTL, SPLINE, DELAY = 22, 16, 18, 19, 20, 82, 93
#: how far flown and walked may be apart (m), and by what part in length
BESIDE_M, LENGTH = 3.0, 0.02
#: what it brakes after a circle counts as the next item where it is flown, and as the circle in the walk (m)
BRAKES_M = 20.0
#: how much longer a circle may take than the walk, which has no acceleration (s)
SLOWER_S = 15.0


def item(seq: int, command: int, east_m: float, north_m: float, *params: float) -> MissionItem:
    one, two, three, four = (*params, *[0.0] * (4 - len(params)))
    lat, lon = offset(*HOME[:2], east_m, north_m)
    return MissionItem(seq, command, 3, one, two, three, four, round(lat, 7), round(lon, 7), 30.0)


def route(*items: MissionItem) -> Route:
    climb = MissionItem(1, TAKEOFF, 3, 0, 0, 0, 0, 0.0, 0.0, 30.0)
    end = MissionItem(items[-1].seq + 1, RTL, 2, 0, 0, 0, 0, 0.0, 0.0, 0.0)
    return Route(Home(*HOME[:3]), (climb, *items, end))


@pytest.mark.timeout(600)
def test_circles_are_flown_as_they_are_walked(tmp_path: Path) -> None:
    """Three rounds of 100 m to the right, one and a half of 20 m to the left, one of 5 m, half of one of 300 m."""
    flown = route(
        item(2, TURNS, 300, 0, 3, 0, 100),
        item(3, TURNS, 300, 200, 2, 0, -20),
        item(4, TURNS, 200, 300, 1, 0, 5),
        item(5, TURNS, 200, -300, 0.5, 0, 304),
    )
    places, legs = fly(tmp_path, flown), legs_of(flown, 10.0)
    for seq in (2, 3, 4, 5):
        found = hold_against(legs, places, seq)
        print(seq, found)
        assert found.beside_m < BESIDE_M
        assert found.missed_m < BESIDE_M + BRAKES_M
        assert found.flown_m == pytest.approx(found.walked_m, rel=LENGTH, abs=BRAKES_M)
        assert 0.98 * found.walked_s < found.flown_s < 1.02 * found.walked_s + SLOWER_S


@pytest.mark.timeout(600)
def test_splines_are_flown_as_they_are_walked(tmp_path: Path) -> None:
    """A square of 400 m, then one behind a straight leg, one behind a stop, and one towards a waypoint."""
    flown = route(
        item(2, SPLINE, 400, 0),
        item(3, SPLINE, 400, 400),
        item(4, SPLINE, 0, 400),
        item(5, SPLINE, 0, 0),
        item(6, WAYPOINT, 0, -200),
        item(7, SPLINE, 200, -200),
        item(8, SPLINE, 200, 0, 3),
        item(9, SPLINE, 300, 100),
        item(10, WAYPOINT, 100, 200),
    )
    places, legs = fly(tmp_path, flown), legs_of(flown, 10.0)
    for seq in (2, 3, 4, 5, 7, 8, 9):
        found = hold_against(legs, places, seq)
        print(seq, found)
        assert found.beside_m < BESIDE_M
        assert found.missed_m < BESIDE_M
        assert found.flown_m == pytest.approx(found.walked_m, rel=LENGTH, abs=BESIDE_M)


@pytest.mark.timeout(300)
def test_waits_take_as_long_as_they_are_counted(tmp_path: Path) -> None:
    """30 s above a place, 20 s of NAV_DELAY, and one until the next full minute: a minute at the most."""
    flown = route(
        item(2, TIME, 100, 0, 30),
        MissionItem(3, DELAY, 2, 20, -1, -1, -1, 0.0, 0.0, 0.0),
        item(4, WAYPOINT, 100, 50),
        MissionItem(5, DELAY, 2, 0, -1, -1, 0, 0.0, 0.0, 0.0),
        item(6, WAYPOINT, 100, 100),
    )
    places = fly(tmp_path, flown)
    took = {seq: [p.time_s for p in places if p.seq == seq] for seq in (2, 3, 5)}
    spent = {seq: times[-1] - times[0] for seq, times in took.items()}
    print(spent)
    assert 40.0 < spent[2] < 60.0
    assert spent[3] == pytest.approx(20.0, abs=2.0)
    assert spent[5] < 62.0

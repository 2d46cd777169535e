# SPDX-License-Identifier: GPL-3.0-or-later

"""Legs that are shorter than the turns of wings need, flown on ArduPlane: how far beside them the aircraft comes.

The check takes such a leg where all within `Wings.reach_m` of it is covered alike (`mission/room.py`). So the aircraft
has to stay within that while it flies to the item, and to the next one until it is on that leg.
`pytest tests/sitl/test_short_legs_flown.py -s --long` prints a line for each flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pytest

from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.geodesy import east_north_m
from mavproxy_handover.mission.package import MissionPackage
from sitl.vehicles import find_arduplane
from tests.mission.corpus import Case, Item, flight, text_of, waypoint
from tests.sitl.corpus_flight import Place, fly

#: metres east and north of home: what is flown between the two far legs of the flight
SHAPES: Final[dict[str, tuple[tuple[float, float], ...]]] = {
    "square of 60 m": ((60, 1200), (60, 1260), (0, 1260), (0, 1200), (60, 1200)),
    "zigzag of 60 m": ((60, 1200), (0, 1200), (60, 1200), (0, 1200)),
    "rows 30 m apart": ((30, 1200), (30, 1080), (60, 1080), (60, 1200), (90, 1200), (90, 1080)),
    "saw": ((40, 1160), (80, 1200), (120, 1160), (80, 1120), (40, 1160)),
    "there and back": ((0, 1100), (0, 1200), (0, 1100), (0, 1200)),
    "steps of 5 m": ((5, 1200), (5, 1205), (0, 1205), (0, 1200)),
}
#: nearer than that (m) the aircraft is on its leg again
ON_IT_M: Final = 20.0

pytestmark = [pytest.mark.sitl, pytest.mark.long]


def _case(shape: str) -> Case:
    items: list[Item] = flight("plane", [waypoint(east, north, 60.0) for east, north in SHAPES[shape]])
    return Case(shape, "plane", "route.waypoints", text_of("waypoints", items, kind="plane"), "")


def _beside_m(package: MissionPackage, places: Sequence[Place], seq: int) -> float:
    """The most distance from the leg to that item, on the way to it, and on the next way until that is found."""
    items = package.route.items
    start, end, after = ((item.lat_deg, item.lon_deg) for item in items[seq - 2 : seq + 1])
    worst = 0.0
    for place in places:
        here = place.lat_deg, place.lon_deg
        if place.seq == seq + 1 and _from_line_m(end, after, here) < ON_IT_M:
            break
        if place.seq in (seq, seq + 1):
            worst = max(worst, _from_line_m(start, end, here))
    return worst


def _from_line_m(start: tuple[float, float], end: tuple[float, float], here: tuple[float, float]) -> float:
    (east, north), (to_east, to_north) = east_north_m(*start, *here), east_north_m(*start, *end)
    square = to_east**2 + to_north**2
    part = 0.0 if square == 0.0 else min(1.0, max(0.0, (east * to_east + north * to_north) / square))
    return float(((east - part * to_east) ** 2 + (north - part * to_north) ** 2) ** 0.5)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("shape", SHAPES)
def test_wings_stay_within_their_reach_of_a_leg_that_is_too_short(shape: str, tmp_path: Path) -> None:
    if find_arduplane() is None:
        pytest.skip("no ArduPlane SITL program: set $ARDUPLANE or build one in ~/ardupilot")
    package, places = fly(_case(shape), tmp_path)
    path = package.path()
    assert path is not None
    assert path.tight
    reach_m = package.route.wings.reach_m(package.air().fastest_mps)
    beside = {tight.seq: _beside_m(package, places, tight.seq) for tight in path.tight}
    print(
        f"\n{shape}: {', '.join(f'item {seq} {far:.0f} m' for seq, far in beside.items())} (allowed: {reach_m:.0f} m)"
    )
    assert max(beside.values()) < reach_m
    assert [each.text for each in check(package).findings if each.severity is Severity.ERROR] == []

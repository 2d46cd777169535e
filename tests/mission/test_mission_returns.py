# SPDX-License-Identifier: GPL-3.0-or-later

"""Where a mission that ends with RTL ends: at the place that a return is sent to, not at the nearest one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mavproxy_handover.mission.items import RETURN_TO_LAUNCH
from mavproxy_handover.mission.package import load
from mavproxy_handover.mission.plan import with_items
from mavproxy_handover.mission.returns import before_return, with_return
from mavproxy_handover.mission.route_simulation import legs_of

HOME, RALLY = (0.0, 10.001), (0.0, 10.0035)


@pytest.fixture
def back(small: Any) -> Any:
    """From (0, 10.005), in zone B; the rally point at 10.0035 is the nearest place."""
    small.items[2] = {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0] * 7}
    return small


def end(small: Any) -> tuple[float, float]:
    package = load(small.write())
    walked = package.simulate().samples[-1]
    assert legs_of(package.route)[-1].end[:2] == (walked.lat_deg, walked.lon_deg)
    return walked.lat_deg, walked.lon_deg


def test_to_the_nearest_of_places_that_are_alike(back: Any) -> None:
    assert end(back) == RALLY


def test_not_to_one_that_no_zone_covers(back: Any) -> None:
    """The fault: the walk told of a landing where no return would be sent to, and judged coverage and energy by it."""
    back.zones["features"] = [
        back.feature("A", [back.box(10.0, 10.003)]),
        back.feature("B", [back.box(10.002, 10.006, south=0.0002)]),
    ]
    assert end(back) == HOME


def test_not_to_one_outside_the_fence_nor_by_a_way_that_leaves_it(back: Any) -> None:
    polygon = [[-0.002, 9.999], [-0.002, 10.007], [0.002, 10.007], [0.002, 9.999]]
    keep_out = [[-0.0001, 10.0034], [-0.0001, 10.0036], [0.0001, 10.0036], [0.0001, 10.0034]]
    back.plan["rallyPoints"]["points"] = [[0.0, 10.0035, 30], [0.001, 10.002, 30]]
    back.plan["geoFence"]["polygons"] = [
        {"polygon": polygon, "inclusion": True, "version": 1},
        {"polygon": keep_out, "inclusion": False, "version": 1},
    ]
    assert end(back) == (0.001, 10.002), "home lies behind the exclusion"


def test_a_place_that_is_covered_and_the_way_is_not_comes_behind_one_where_both_are(back: Any) -> None:
    back.zones["features"] = [
        back.feature("A", [back.box(10.0, 10.004)]),
        back.feature("B", [back.box(10.0045, 10.006, north=0.003)]),
    ]
    back.plan["rallyPoints"]["points"] = [[*RALLY, 30], [0.002, 10.005, 30]]
    assert end(back) == (0.002, 10.005)


def test_a_mission_without_rtl_has_no_such_place(small: Any) -> None:
    assert load(small.write()).route.return_to is None


def test_of_a_mission_that_is_uploaded_in_flight_it_is_found_anew(back: Any) -> None:
    package = load(back.write())
    items = package.route.upload_items()
    near_home = (*items[:2], replace(items[2], lon_deg=10.0015), items[3])
    route = with_return(with_items(package.route, near_home), package.zones, package.terrain)
    assert legs_of(route)[-1].end[:2] == HOME


def test_of_thousands_of_rally_points_the_nearest_are_looked_at(back: Any) -> None:
    """The one that is covered is the 70th by distance: no autopilot holds so many, and no link is to cost minutes."""
    package = load(back.write())
    far = [replace(package.route.rally[0], lon_deg=10.05 + n * 1e-5) for n in range(5000)]
    route = with_return(replace(package.route, rally=(*far, *package.route.rally)), package.zones, package.terrain)
    assert route.return_to == RALLY
    crowd = [replace(package.route.rally[0], lat_deg=0.0015, lon_deg=10.005 + n * 1e-7) for n in range(70)]
    route = with_return(replace(package.route, rally=(*crowd, *package.route.rally)), package.zones, package.terrain)
    assert route.return_to == (0.0015, 10.005), "of places that no zone covers the nearest"


def test_behind_which_item_a_mission_returns(back: Any) -> None:
    route = load(back.write()).route
    seq, place = before_return(route) or (0, (0.0, 0.0))
    last = next(item for item in route.items if item.seq == seq)
    assert place == (last.lat_deg, last.lon_deg)
    assert route.items[route.items.index(last) + 1].command == RETURN_TO_LAUNCH


def test_behind_none_where_it_lands(small: Any) -> None:
    assert before_return(load(small.write()).route) is None

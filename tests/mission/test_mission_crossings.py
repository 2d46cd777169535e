# SPDX-License-Identifier: GPL-3.0-or-later

"""The borders on a mission's way, and how soon they are reached."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavproxy_handover.mission import load
from mavproxy_handover.mission.crossings import Seen, WayAhead
from mavproxy_handover.mission.geodesy import distance_m

MISSIONS = Path(__file__).parents[2] / "missions"
DATA = Path(__file__).parents[1] / "data" / "missions"
FOREVER = 1e9


@pytest.fixture(scope="module", params=["delivery", "linear", "corridor", "ridge", "waypoints"])
def walked(request):
    package = load(MISSIONS / request.param)
    walk = package.simulate()
    return package, walk, WayAhead(walk, flies_past=True)  # with the times of the walk


def seen(seq, lat_deg, lon_deg, alt_m=1000.0):
    """An aircraft that stands, above all climbs."""
    return Seen(seq, lat_deg, lon_deg, alt_m, 0.0, 0.0)


def changes(walk):
    """Places of the walk right behind a border."""
    return [after for before, after in zip(walk.samples, walk.samples[1:], strict=False) if before.open != after.open]


def test_without_waypoints_that_decide_a_zone_is_open_where_it_holds_the_aircraft(walked):
    package, walk, _way = walked
    if package.belonging is None:
        assert all(sample.open == sample.holding for sample in walk.samples)
    else:
        assert all(sample.open <= sample.holding for sample in walk.samples)
        assert any(sample.open < sample.holding for sample in walk.samples)


def test_from_take_off_all_of_them_are_ahead_in_order(walked):
    _package, walk, way = walked
    first = walk.samples[0]
    seq = next(sample.seq for sample in walk.samples if sample.distance_along_m > 0.0)
    found = way.borders(seen(seq, first.lat_deg, first.lon_deg), FOREVER)
    assert [border.holding for border in found] == [sample.open for sample in changes(walk)]
    assert [border.number for border in found] == list(range(len(found)))
    assert [border.in_s for border in found] == sorted(border.in_s for border in found)


def test_along_the_way_each_is_as_far_ahead_as_the_walk_has_it_and_gone_behind_it(walked):
    """Where the aircraft stands or climbs at a place, no more can be said than when it goes on."""
    _package, walk, way = walked
    moving = [
        here
        for here, after in zip(walk.samples, walk.samples[1:], strict=False)
        if after.seq == here.seq and after.distance_along_m > here.distance_along_m
    ]
    assert len(moving) > 50
    for here in moving:
        ahead = [border for border in changes(walk) if border.distance_along_m > here.distance_along_m + 0.5]
        found = way.borders(seen(here.seq, here.lat_deg, here.lon_deg), FOREVER)
        near = [border for border in changes(walk) if abs(border.distance_along_m - here.distance_along_m) <= 0.5]
        assert len(ahead) <= len(found) <= len(ahead) + len(near)
        for border, expected in zip(reversed(found), reversed(ahead), strict=False):
            assert border.holding == expected.open
            assert border.in_s == pytest.approx(expected.time_s - here.time_s, abs=1.0)


def test_beside_the_way_it_is_the_distance_to_the_end_of_the_leg_that_counts(walked):
    _package, walk, way = walked
    border = changes(walk)[0]
    (found, *_) = way.borders(seen(border.seq, border.lat_deg, border.lon_deg - 0.0005), FOREVER)
    away = distance_m(border.lat_deg, border.lon_deg, border.lat_deg, border.lon_deg - 0.0005)
    assert 0.0 < found.in_s <= away / 5.0 or found.number > 0


def test_what_is_farther_than_asked_for_is_left_out(walked):
    _package, walk, way = walked
    first = walk.samples[0]
    seq = next(sample.seq for sample in walk.samples if sample.distance_along_m > 0.0)
    every = way.borders(seen(seq, first.lat_deg, first.lon_deg), FOREVER)
    assert way.borders(seen(seq, first.lat_deg, first.lon_deg), every[0].in_s + 0.1) == every[:1]
    assert way.borders(seen(seq, first.lat_deg, first.lon_deg), every[0].in_s - 0.1) == ()


def test_of_an_item_that_the_way_does_not_have_nothing_is_known(walked):
    _package, walk, way = walked
    assert way.borders(seen(999, walk.samples[0].lat_deg, walk.samples[0].lon_deg), FOREVER) == ()


@pytest.mark.parametrize("name", ["loiter_turns", "spline"])
def test_on_a_curve_each_border_is_as_far_ahead_as_the_walk_has_it(name):
    """On ten turns the same border is crossed again and again, and on a spline the end of the leg tells nothing.
    At the edge of a circle the aircraft rests for 2 s: no more can be said than when it goes on."""
    walk = load(DATA / name).simulate()
    way = WayAhead(walk, flies_past=True)
    curves = {sample.seq for sample in walk.samples if sample.curved}
    places = [sample for sample in walk.samples if sample.seq in curves]
    assert len(places) > 400
    for here in places[::2]:
        ahead = [border for border in changes(walk) if border.distance_along_m > here.distance_along_m + 10.0]
        found = way.borders(seen(here.seq, here.lat_deg, here.lon_deg), FOREVER)
        expected = [border.time_s - here.time_s for border in ahead]
        assert len(ahead) <= len(found) <= len(ahead) + 2
        assert [border.in_s for border in found][len(found) - len(ahead) :] == [
            pytest.approx(each, abs=2.1) for each in expected
        ]


def test_an_aircraft_that_is_steady_near_the_beginning_of_the_path_has_borders_ahead():
    """The fault: two seconds before it was before the beginning, at the same place as the climb of the take-off."""
    walk = load(MISSIONS / "linear").simulate()
    way = WayAhead(walk)
    here = next(sample for sample in walk.samples if sample.distance_along_m > 5.0)
    for second in range(5):
        found = way.borders(Seen(here.seq, here.lat_deg, here.lon_deg, 1000.0, 10.0, float(second)), FOREVER)
        assert [border.holding for border in found] == [sample.open for sample in changes(walk)]
        assert all(0.0 < border.in_s < walk.duration_s for border in found)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Who commands where along a route. Distances on the equator: 0.001 degrees of longitude are 111.319 m."""

from __future__ import annotations

import json

import pytest
from shapely.geometry import Polygon

from mavproxy_handover.mission import Circle, Zone, ZoneFinder, commanders_along, load, read_route
from mavproxy_handover.mission.route_simulation import legs_from, legs_of, speed_at

A, B, C = 251, 252, 253


def strip(station, west, east, **limits):
    corners = [(west, -0.001), (east, -0.001), (east, 0.001), (west, 0.001)]
    return Zone(station, "ABC"[station - 251], Polygon(corners), **limits)


def walk(small, zones, **options):
    route = read_route("small.plan", json.dumps(small.plan))
    return commanders_along(route, ZoneFinder(zones), A, **options)


def near(value, tolerance=0.06):
    return pytest.approx(value, abs=tolerance)


# --- the path ---


def test_path_goes_up_along_and_down(small):
    legs = legs_of(read_route("small.plan", json.dumps(small.plan)))
    assert [(leg.seq, leg.end) for leg in legs] == [
        (1, (0.0, 10.001, 30.0)),
        (2, (0.0, 10.005, 30.0)),
        (3, (0.0, 10.005, 10.0)),
        (3, (0.0, 10.005, 0.0)),
    ]
    # 30 m at 2.5 m/s; 445.278 m at the plan's 5 m/s; 20 m at 1.5 m/s; 10 m at 0.5 m/s
    assert [leg.duration_s for leg in legs] == [12.0, near(89.056), near(13.333), 20.0]


def test_the_speed_that_the_route_has_set_by_an_item(small):
    """Items 2 and 4 change it; climbs (type 2) and a speed of 0 do not."""
    items = small.plan["mission"]["items"]
    first, *rest = items
    change = {**first, "command": 178, "frame": 2}
    speeds = [{**change, "params": [*pair, -1, 0, 0, 0, 0]} for pair in ([1, 6], [2, 3], [0, 4], [1, 0])]
    small.plan["mission"]["items"] = [first, *speeds, *rest]
    route = read_route("small.plan", json.dumps(small.plan))
    assert [speed_at(route, seq) for seq in range(8)] == [None, None, None, 6.0, 6.0, 4.0, 4.0, 4.0]


def test_speed_given_goes_before_the_plans_and_a_speed_command_before_both(small):
    route = read_route("small.plan", json.dumps(small.plan))
    assert legs_of(route, 10.0)[1].duration_s == near(44.528)
    small.items.insert(1, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 20, -1, 0, 0, 0, 0]})
    route = read_route("small.plan", json.dumps(small.plan))
    assert legs_of(route, 10.0)[1].duration_s == near(22.264)


def test_waiting_takes_time_and_a_steep_leg_as_long_as_its_climb(small):
    small.items[1] = small.item(2, 16, 0.0, 10.002, 80, param1=10)
    leg = legs_of(read_route("small.plan", json.dumps(small.plan)), 10.0)[1]
    assert (leg.duration_s, leg.hold_s) == (20.0, 10.0)  # 50 m at 2.5 m/s, not 111 m at 10 m/s


def test_time_spent_waiting_counts_for_all_that_follows(small):
    zones = [strip(A, 10.0, 10.006)]
    before = walk(small, zones).duration_s
    small.items[1]["params"][0] = 25
    assert walk(small, zones).duration_s == near(before + 25.0, 1e-6)


def test_absolute_altitudes_count_from_home(small):
    small.items[1]["frame"] = 0
    small.items[1]["params"][6] = 140.0
    assert legs_of(read_route("small.plan", json.dumps(small.plan)))[1].end[2] == 40.0


def test_return_goes_to_the_nearest_of_home_and_rally_points(small):
    small.items[2] = {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0] * 7}
    legs = legs_of(read_route("small.plan", json.dumps(small.plan)))
    assert legs[2].end == (0.0, 10.0035, 30.0)
    small.plan["rallyPoints"]["points"] = []
    legs = legs_of(read_route("small.plan", json.dumps(small.plan)))
    assert legs[2].end == (0.0, 10.001, 30.0)


def test_a_return_is_flown_at_the_cruise_speed_whatever_was_set_on_the_way(small):
    """ModeAuto's RTL begins as the mode RTL does: it forgets a DO_CHANGE_SPEED."""
    small.items[2] = {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0] * 7}
    small.items.insert(1, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 0, 0, 0]})
    route = read_route("small.plan", json.dumps(small.plan))
    assert [leg.speed_mps for leg in legs_of(route) if leg.length_m > 0.0] == [8.0, 5.0]
    assert [leg.speed_mps for leg in legs_from(route, 3, (0.0, 10.004, 30.0), 6.0) if leg.length_m > 0.0] == [8.0, 6.0]


def test_landing_without_a_place_is_where_the_aircraft_is(small):
    small.items[2]["params"][4:6] = [0, 0]
    assert legs_of(read_route("small.plan", json.dumps(small.plan)))[-1].end == (0.0, 10.005, 0.0)


# --- the rule ---


def test_authority_moves_where_the_next_zone_is_entered(small):
    found = walk(small, [strip(A, 10.0, 10.004), strip(B, 10.002, 10.006)])
    assert found.commanders == (A, B)
    (handover,) = found.handovers
    assert (handover.from_station, handover.to_station, handover.seq) == (A, B, 2)
    assert (handover.lat_deg, handover.lon_deg) == (0.0, near(10.002, 1e-6))
    assert handover.distance_along_m == near(111.319)
    assert handover.overlap_length_m == near(222.639)
    assert handover.overlap_s == near(44.528, 0.02)
    assert handover.time_s == near(12.0 + 22.264, 0.02)
    assert found.gaps == ()
    assert found.length_m == near(445.278)


def test_commander_changes_at_the_handover_and_nowhere_else(small):
    found = walk(small, [strip(A, 10.0, 10.004), strip(B, 10.002, 10.006)])
    for sample in found.samples:
        assert sample.commander == (A if sample.distance_along_m < found.handovers[0].distance_along_m else B)


def test_gap_is_told_with_place_and_length(small):
    found = walk(small, [strip(A, 10.0, 10.002), strip(B, 10.003, 10.006)])
    (gap,) = found.gaps
    assert (gap.lon_deg, gap.seq, gap.alt_m) == (near(10.002, 1e-6), 2, 30.0)
    assert (gap.distance_along_m, gap.length_m) == (near(111.319), near(111.319))
    assert gap.duration_s == near(22.264, 0.02)
    (handover,) = found.handovers
    assert (handover.lon_deg, handover.overlap_length_m, handover.overlap_s) == (near(10.003, 1e-6), 0.0, 0.0)


def test_gap_at_the_end_of_the_route_lasts_to_the_ground(small):
    (gap,) = walk(small, [strip(A, 10.0, 10.004)]).gaps
    assert gap.length_m == near(111.319)
    assert gap.duration_s == near(22.264 + 33.333, 0.02)


def test_turning_back_inside_the_region_moves_authority_back_before_the_zone_ends(small):
    """B is entered and left again without ever leaving A: A must have authority back when B ends."""
    small.items[1] = small.item(2, 16, 0.0, 10.003, 30)
    small.items[2] = small.item(3, 21, 0.0, 10.001, 0)
    found = walk(small, [strip(A, 10.0, 10.006), strip(B, 10.002, 10.006)])
    assert found.commanders == (A, B, A)
    back = found.handovers[1]
    assert back.lon_deg == near(10.002, 5e-5)
    assert back.overlap_length_m == near(222.639, 0.2)


def test_a_region_crossed_twice_is_two_handovers(small):
    small.items[2] = small.item(3, 21, 0.0, 10.001, 0)
    found = walk(small, [strip(A, 10.0, 10.004), strip(B, 10.002, 10.006)])
    assert found.commanders == (A, B, A)
    assert found.handovers[1].lon_deg == near(10.004, 1e-6)


def test_of_two_zones_entered_together_the_one_that_stays_longer_takes_over(small):
    zones = [strip(A, 10.0, 10.003), strip(B, 10.002, 10.0035), strip(C, 10.002, 10.006)]
    assert walk(small, zones).commanders == (A, C)


def test_zones_entered_one_after_another_are_all_used(small):
    zones = [strip(A, 10.0, 10.003), strip(B, 10.002, 10.005), strip(C, 10.004, 10.006)]
    assert walk(small, zones).commanders == (A, B, C)


def test_zone_narrower_than_a_step_is_not_missed_at_its_far_border(small):
    """Two borders within one step: the walk stops at each, so the overlap is not rounded to the step."""
    found = walk(small, [strip(A, 10.0, 10.00203), strip(B, 10.002, 10.006)])
    assert found.handovers[0].overlap_length_m == near(3.340)


def test_altitude_limits_make_gaps_on_the_way_up(small):
    found = walk(small, [strip(A, 10.0, 10.006, min_alt_m=10.0)])
    assert [(gap.seq, gap.length_m, gap.duration_s) for gap in found.gaps] == [
        (1, 0.0, near(4.0, 0.03)),
        (3, 0.0, near(20.0, 0.2)),
    ]


def test_long_route_is_walked_in_bounded_steps(small):
    small.items[1] = small.item(2, 16, 0.0, 100.0, 30)
    small.items[2] = small.item(3, 21, 0.0, 10.001, 0)
    found = walk(small, [Zone(A, "A", Circle(0.0, 10.001, 1000.0))])
    assert found.length_m > 20_000_000.0 * 0.99
    assert len(found.samples) < 25_000


# --- shipped missions ---


def test_delivery_crosses_the_region_four_times(missions):
    found = load(missions / "delivery").simulate()
    assert found.commanders == (251, 252, 251, 252, 251)
    assert found.gaps == ()
    for handover in found.handovers:
        assert handover.overlap_length_m >= 120.0
        assert handover.overlap_s >= 12.0


def test_delivery_stays_ten_seconds_in_each_zone_between_the_regions(missions):
    found = load(missions / "delivery").simulate()
    alone, start = [], 0.0
    for before, after in zip(found.samples, found.samples[1:], strict=False):
        if len(before.holding) == 2 and len(after.holding) == 1:
            start = after.time_s
        if len(before.holding) == 1 and len(after.holding) == 2:
            alone.append(after.time_s - start)
    assert len(alone) == 4
    assert min(alone) >= 10.0


def test_delivery_takes_about_five_minutes(missions):
    assert 240.0 <= load(missions / "delivery").simulate().duration_s <= 330.0


def test_the_mission_in_fiji_crosses_the_180th_meridian_within_its_handover_region(missions):
    walk = load(missions / "meridian").simulate()
    assert walk.commanders == (251, 252, 251)
    out, back = walk.handovers
    assert (out.lon_deg, back.lon_deg) == (pytest.approx(179.9985, abs=1e-5), pytest.approx(-179.9985, abs=1e-5))
    assert [handover.overlap_length_m for handover in walk.handovers] == pytest.approx([320.0, 320.0], abs=1.0)
    assert walk.gaps == ()


def test_linear_crosses_the_region_twice(missions):
    assert load(missions / "linear").simulate().commanders == (251, 252, 251)


def test_corridor_passes_four_stations(missions):
    found = load(missions / "corridor").simulate()
    assert found.commanders == (251, 252, 253, 254)
    assert found.gaps == ()

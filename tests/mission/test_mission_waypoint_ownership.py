# SPDX-License-Identifier: GPL-3.0-or-later

"""Waypoints that belong to stations: what the lists say, what is covered, and where the walk moves authority."""

from __future__ import annotations

import pytest

from mavproxy_handover.mission import MissionError, load
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.crossings import Seen, WayAhead
from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.waypoint_ownership import Belonging, belonging_of

A, B, C = 251, 252, 253
#: a thousandth of a degree of longitude on the equator (m)
PIECE_M = 111.3195

TOML = """\
name = "small"
detector = "reached"
corridor_m = 111.3195
route = "small.plan"
expected_handovers = 2
cruise_speed_mps = 10.0
[[stations]]
name = "A"
sysid = 251
waypoints = [1, 2, 5]
[[stations]]
name = "B"
sysid = 252
waypoints = [3, 4]
"""


@pytest.fixture
def line(small):
    """East along the equator: take-off at 10.001, items 2 to 5 at 10.003 to 10.009, down at the last one."""
    small.items[1:] = [small.item(n, 16, 0.0, 10.0 + (2 * n - 1) / 1000, 30) for n in range(2, 6)]
    small.items.append(small.item(6, 21, 0.0, 10.009, 0))
    small.plan["rallyPoints"]["points"] = []
    small.toml = TOML
    return small


def refusal(small) -> str:
    with pytest.raises(MissionError) as caught:
        load(small.write())
    return str(caught.value)


# --- whose ---


def test_what_nobody_lists_belongs_to_the_one_before(line):
    line.toml = TOML.replace("[1, 2, 5]", "[2, 5]").replace("[3, 4]", "[3]")
    package = load(line.write())
    assert package.belonging == Belonging((A, A, A, B, B, A, A), frozenset({A, B}), frozenset())
    assert [package.belonging.owner(seq) for seq in (-1, 0, 1, 3, 6, 7)] == [None, None, A, B, A, None]


@pytest.mark.parametrize(
    ("seq", "awaiting"),
    [
        (-1, set()),
        (0, {B}),
        (1, {B}),
        (3, {B}),  # on the way to B's first
        (4, {A}),
        (5, {A}),
        (6, {B}),
        (7, {B}),  # all done with
        (8, set()),  # no such item
    ],
)
def test_who_awaits_the_aircraft_on_its_way(line, seq, awaiting):
    assert load(line.write()).belonging.awaiting(seq) == awaiting


def test_on_a_way_back_nobody_waits_at_a_waypoint(line):
    line.items[5] = {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0] * 7}
    belonging = load(line.write()).belonging
    assert (belonging.awaiting(5), belonging.awaiting(6)) == ({A}, set())


def test_without_lists_that_decide_nothing_belongs_to_anybody(small):
    assert load(small.write()).belonging is None


def test_refuses_a_waypoint_of_two_stations(line):
    line.toml = TOML.replace("[3, 4]", "[2, 3, 4]")
    text = "mission.toml: station 2: waypoint 2 belongs to station 1 (allowed: one station for a waypoint)"
    assert refusal(line) == text


def test_refuses_a_waypoint_beyond_the_route(line):
    line.toml = TOML.replace("[3, 4]", "[3, 4, 7]")
    assert refusal(line) == "mission.toml: station 2: waypoint 7 is not on the route (allowed: 1 to 6)"


def test_refuses_a_waypoint_that_is_not_flown_to(line):
    line.items[2] = {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 0, 0, 0]}
    text = "mission.toml: station 2: waypoint 3 is DO_CHANGE_SPEED (allowed: an item that is flown to)"
    assert refusal(line) == text


def test_refuses_zones_beside_the_lists(line):
    line.toml = 'zones = "zones.geojson"\n' + TOML
    assert refusal(line) == (
        "mission.toml: key 'zones' does not go with detector 'reached' (the zones follow the route)"
    )


# --- what is covered ---


def test_a_station_covers_the_way_to_its_waypoints_and_to_the_first_one_behind(line):
    first, second = load(line.write()).zones
    # A from home to item 3, and again from item 5, with the way to it B's; each a corridor's width beyond
    west, _, east, _ = first.area.geoms[0].bounds
    assert (west, east) == (pytest.approx(10.0, abs=1e-6), pytest.approx(10.006, abs=1e-6))
    assert first.area.geoms[1].bounds[0] == pytest.approx(10.008, abs=1e-6)
    west, _, east, _ = second.area.bounds
    assert (west, east) == (pytest.approx(10.004, abs=1e-6), pytest.approx(10.010, abs=1e-6))


def test_items_in_between_that_are_not_flown_to_leave_no_hole(line):
    line.items.insert(3, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 0, 0, 0]})
    line.toml = TOML.replace("[1, 2, 5]", "[1, 2, 6]").replace("[3, 4]", "[3, 5]")
    package = load(line.write())
    assert package.belonging.covers(B, package.route) == {3, 5, 6}
    assert check(package).simulation.gaps == ()


# --- where authority moves ---


def test_authority_moves_at_the_waypoints_and_not_where_zones_begin(line):
    out, back = load(line.write()).simulate().handovers
    assert (out.from_station, out.to_station, out.seq) == (A, B, 3)
    assert (back.from_station, back.to_station, back.seq) == (B, A, 5)
    # its zone begins a corridor's width before the waypoint
    assert (out.lon_deg, back.lon_deg) == (pytest.approx(10.005, abs=1e-7), pytest.approx(10.009, abs=1e-7))


def test_what_is_left_of_both_zones_counts_from_the_waypoint_on(line):
    (out, _back) = load(line.write()).simulate().handovers
    assert out.overlap_length_m == pytest.approx(PIECE_M, abs=0.1)
    assert out.overlap_s == pytest.approx(PIECE_M / 10.0, abs=0.01)


def test_a_hold_at_the_waypoint_is_over_when_it_is_reached(line):
    line.items[2]["params"][0] = 20
    plain, held = load(line.write()).simulate(), None
    line.items[2]["params"][0] = 0
    held = load(line.write()).simulate()
    assert plain.handovers[0].time_s - held.handovers[0].time_s == pytest.approx(20.0)
    assert plain.handovers[0].overlap_s == pytest.approx(held.handovers[0].overlap_s)


def test_the_borders_ahead_are_the_waypoints(line):
    """Both operators are asked ahead of the waypoint, not of the place where the next zone begins."""
    package = load(line.write())
    way = WayAhead(package.simulate(), flies_past=True)  # with the times of the walk
    borders = way.borders(Seen(2, 0.0, 10.001, 40.0, 0.0, 0.0), 1e9)
    assert [set(border.holding) for border in borders] == [{A, B}, {B}, {A, B}]
    # from 10.001 to 10.005, and to 10.006, at 10 m/s
    assert [border.in_s for border in borders[:2]] == pytest.approx([4 * PIECE_M / 10, 5 * PIECE_M / 10], abs=0.01)


def test_a_zone_that_ends_before_the_waypoint_moves_authority_all_the_same(line):
    """The lists leave a way that B covers alone: A has it to the end of its zone."""
    package = load(line.write())
    walk = package.simulate()
    other = belonging_of(Where("mission.toml"), package.route, [(A, [1, 2, 3]), (B, [4])])
    from mavproxy_handover.mission.route_simulation import commanders_along

    found = commanders_along(package.route, package.zone_finder(), A, cruise_speed_mps=10.0, belonging=other)
    (handover,) = [each for each in found.handovers if each.to_station == B]
    assert handover.lon_deg == pytest.approx(10.006, abs=5e-5)
    assert walk.handovers[0].lon_deg < handover.lon_deg


# --- the check ---


def test_a_sound_round_passes_without_a_word_of_it(line):
    report = check(load(line.write()))
    assert [f.text for f in report.findings if "waypoint" in f.text] == []


def test_a_zone_that_ends_too_soon_behind_its_waypoint_is_a_warning(line):
    line.toml = TOML.replace("corridor_m = 111.3195", "corridor_m = 75")
    texts = [f.text for f in check(load(line.write())).findings if f.severity is Severity.WARNING]
    assert (
        "handover 1 A -> B: the zone of the first ends 7.5 s after waypoint 3: authority moves 8 s before that end, "
        "and not when the waypoint is reached"
    ) in texts


def test_the_round_that_ships_moves_authority_at_waypoints_4_6_and_9(missions):
    walk = load(missions / "waypoints").simulate()
    assert walk.commanders == (A, B, C, A)
    assert [handover.seq for handover in walk.handovers] == [4, 6, 9]
    assert walk.gaps == ()

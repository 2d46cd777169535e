# SPDX-License-Identifier: GPL-3.0-or-later

"""The energy budget of a mission: the table [energy], the route leg by leg, the ways back, and `handover check`.

The small mission: up to 30 m at longitude 10.001, 445.3 m eastwards at 5 m/s, down. Home is where it takes off, a rally
point of 30 m lies 167.0 m before its end. Hover 360 W, cruise 440 W at 10 m/s and no faster; climb
432 W, descent 360 W.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from mavproxy_handover.cli.check import main
from mavproxy_handover.core.safety.energy import Piece, Wind
from mavproxy_handover.core.safety.energy_prior import ON_WINGS, EnergySettings
from mavproxy_handover.mission import MissionError, load
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.check_text import report_text
from mavproxy_handover.mission.energy import budget_of, pieces_along, pieces_of, places_of, released_at
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.keys import ENERGY
from mavproxy_handover.mission.leg import Leg
from mavproxy_handover.mission.route_simulation import legs_of

NUMBERS = """
[energy]
battery_wh = {battery}
hover_w = 360
cruise_w = 440
headwind_mps = 0
reserve_factor = 1
reserve_wh = 2
return_alt_m = 15
"""


def numbers(small, battery=20.0):
    """The mission with numbers."""
    small.toml += NUMBERS.format(battery=battery)
    return small


def budget(small, wind=None, battery=20.0):
    package = load(numbers(small, battery).write())
    return budget_of(package.route, package.cruise_speed_mps, package.energy.model(wind))


def found(small, severity, **options):
    report = check(load(small.write()), **options)
    return [finding.text for finding in report.findings if finding.severity is severity and "energy" in finding.text]


# --- the table ---


def test_a_mission_without_the_table_has_no_numbers(small):
    assert load(small.write()).energy == EnergySettings()


def test_the_table_is_read(small):
    small.toml += '[energy]\nbattery_wh = 41\nbatteries = 2\ncells = 6.0\nstart = "warn"\n'
    assert load(small.write()).energy == EnergySettings(battery_wh=41.0, batteries=2.0, cells=6.0, start="warn")


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("battery_wh = 0.5", "battery_wh is 0.5 (allowed: a number from 1 to 100000)"),
        ("battery_wh = nan", "battery_wh is nan (allowed: a number from 1 to 100000)"),
        ('hover_w = "354"', "hover_w is '354' (allowed: a number from 10 to 200000)"),
        ("hover_w = true", "hover_w is true (allowed: a number from 10 to 200000)"),
        ("cells = 3.5", "cells is 3.5 (allowed: a whole number from 1 to 28)"),
        ("batteries = 9", "batteries is 9 (allowed: a whole number from 1 to 8)"),
        ('start = "never"', "start is 'never' (allowed: refuse, warn, off)"),
        ("start = 1", "start is 1 (allowed: refuse, warn, off)"),
        ("hover = 354", "unknown key 'hover', did you mean 'hover_w'? (allowed: battery_wh, batteries, cells,"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(small, line, text):
    small.toml += f"[energy]\n{line}\n"
    with pytest.raises(MissionError) as raised:
        load(small.write())
    assert str(raised.value).startswith(f"mission.toml: [energy]: {text}")


@pytest.mark.parametrize("key", [key.name for key in ENERGY.keys if key.limits is not None])
def test_both_ends_of_every_range_are_allowed_and_nothing_beyond(small, key):
    low, high = ENERGY[key].limits
    before = small.toml
    beside = "mass_kg = 1000\n" if key == "payload_kg" else ""
    for value in (low, high):
        small.toml = f"{before}[energy]\n{beside}{key} = {value}\n"
        assert getattr(load(small.write()).energy, key) == value
    for value in (low - 0.01 if low else -0.01, high + 1):
        small.toml = f"{before}[energy]\n{key} = {value}\n"
        with pytest.raises(MissionError):
            load(small.write())


def test_a_table_that_is_none_is_refused(small):
    small.toml = "energy = 3\n" + small.toml
    with pytest.raises(MissionError, match="energy is 3"):
        load(small.write())


# --- the route ---


def test_the_route_as_pieces(small):
    package = load(small.write())
    climb, along, down, landing = pieces_of(package.route, package.cruise_speed_mps, 15.0)
    assert climb == Piece(climb_m=30.0, speed_mps=5.0)
    assert along == Piece(length_m=pytest.approx(445.28, abs=0.01), bearing_deg=pytest.approx(90.0), speed_mps=5.0)
    assert down == Piece(descent_m=20.0, speed_mps=10.0, stops=0.5)
    assert landing == Piece(descent_m=10.0, landing_m=10.0, speed_mps=10.0, stops=0.5)


def test_a_change_of_speed_and_a_hold_are_in_the_pieces(small):
    small.items[1:1] = [small.item(2, 178, 0, 0, 0)]
    small.items[1]["params"] = [1, 8, -1, 0, 0, 0, 0]
    small.items[2]["params"][0] = 12
    package = load(small.write())
    along = pieces_of(package.route, package.cruise_speed_mps, 15.0)[1]
    assert (along.speed_mps, along.hold_s) == (8.0, 12.0)


def test_a_route_that_does_not_end_on_the_ground_is_flown_home_from_its_end(small):
    del small.items[2]
    package = load(small.write())
    pieces = pieces_of(package.route, package.cruise_speed_mps, 15.0)
    assert pieces[2:] == (
        Piece(length_m=pytest.approx(445.28, abs=0.01), bearing_deg=pytest.approx(270.0), hold_s=5.0, speed_mps=5.0),
        Piece(descent_m=30.0, landing_m=10.0),
    )


def test_the_way_back_is_flown_at_the_cruise_speed_of_the_mission(small):
    """The fault: at cruise_mps of [energy], 10 m/s: 10.1 Wh from the end of item 2. RTL flies at WPNAV_SPEED, which is
    the mission's; a DO_CHANGE_SPEED does not last into it."""
    del small.items[2]
    small.plan["rallyPoints"]["points"] = []
    numbers(small)
    # the pause of 5 s and the descent, 3.983 Wh; 89.06 s and 3.33 s at 370 W
    assert budget_of_small(small).items[1].back.need_wh == pytest.approx(13.48, abs=0.01)
    small.items[1:1] = [small.item(2, 178, 0, 0, 0)]
    small.items[1]["params"] = [1, 8, -1, 0, 0, 0, 0]
    assert budget_of_small(small).items[1].back.need_wh == pytest.approx(13.48, abs=0.01)
    small.toml = "cruise_speed_mps = 10\n" + small.toml
    # 44.53 s and 6.67 s at 440 W
    assert budget_of_small(small).items[1].back.need_wh == pytest.approx(10.24, abs=0.01)


def test_a_way_in_the_air_is_flown_back_at_the_speed_that_is_told(small):
    route = load(small.write()).route
    legs = legs_of(route)[:2]
    model = load(numbers(small).write()).energy.model()
    found = pieces_along(legs, places_of(route)[:1], model, 2.0)
    assert [piece.speed_mps for piece in found] == [5.0, 5.0, 2.0, None]


def gripper(small, action, after=1):
    """A gripper that does that behind an item."""
    small.items[after:after] = [small.item(after + 1, 211, 0, 0, 0)]
    small.items[after]["params"] = [1, action, 0, 0, 0, 0, 0]
    for number, item in enumerate(small.items, 1):
        item["doJumpId"] = number


def test_what_is_flown_behind_the_drop_is_flown_without_the_payload(small):
    gripper(small, 0)
    package = load(small.write())
    assert released_at(package.route) == 2
    pieces = pieces_of(package.route, package.cruise_speed_mps, 15.0)
    assert [piece.unloaded for piece in pieces] == [False, True, True, True]


def test_a_gripper_that_closes_drops_nothing(small):
    gripper(small, 1)
    package = load(small.write())
    assert released_at(package.route) is None
    assert not any(piece.unloaded for piece in pieces_of(package.route, package.cruise_speed_mps, 15.0))


def test_the_return_from_the_end_is_flown_without_the_payload(small):
    del small.items[2]
    gripper(small, 0, after=2)
    package = load(small.write())
    pieces = pieces_of(package.route, package.cruise_speed_mps, 15.0)
    assert [piece.unloaded for piece in pieces] == [False, False, True, True]


def test_the_budget_counts_the_payload(small):
    numbers(small)
    whole = budget_of_small(small)
    gripper(small, 0)
    small.toml = small.toml.replace("[energy]\n", "[energy]\nmass_kg = 4\npayload_kg = 1\n")
    lighter = budget_of_small(small)
    up, along, down = (item.need_wh for item in lighter.items)
    assert up == whole.items[0].need_wh
    # hover 360 W becomes 270, and what drag adds at 5 m/s, 10 W, stays: 280 of 370
    assert along == pytest.approx(whole.items[1].need_wh * 280.0 / 370.0, rel=1e-3)
    assert down == pytest.approx(whole.items[2].need_wh * 0.75, rel=1e-3)
    # from the end of the first item it would still come home with it, from the end of the second without
    assert lighter.items[0].back.need_wh == whole.items[0].back.need_wh
    assert lighter.items[1].back.need_wh < 0.8 * whole.items[1].back.need_wh


def test_the_check_says_where_the_payload_goes(small):
    numbers(small)
    small.toml = small.toml.replace("[energy]\n", "[energy]\nmass_kg = 4\npayload_kg = 1\n")
    assert "energy: no item of the route drops the payload of 1 kg" in found(small, Severity.WARNING)
    gripper(small, 0)
    assert "energy: after item 2 it is flown without 1 kg of payload" in found(small, Severity.INFO)


def budget_of_small(small):
    package = load(small.write())
    return budget_of(package.route, package.cruise_speed_mps, package.energy.model())


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        ("payload_kg = 1", "payload_kg: 1 says nothing without mass_kg"),
        ("mass_kg = 3\npayload_kg = 3", "payload_kg: 3 must be less than mass_kg, 3"),
    ],
)
def test_a_payload_that_cannot_be_is_named(small, lines, text):
    small.toml += f"[energy]\n{lines}\n"
    with pytest.raises(MissionError, match=text):
        load(small.write())


def test_places_to_return_to(small):
    names = [place.name for place in places_of(load(small.write()).route)]
    assert names == ["home", "rally 1", "landing"]


def test_a_landing_at_home_or_in_the_air_is_no_place_of_its_own(small):
    small.items[2]["params"][5] = 10.001
    assert [place.name for place in places_of(load(small.write()).route)] == ["home", "rally 1"]
    del small.items[2]
    assert [place.name for place in places_of(load(small.write()).route)] == ["home", "rally 1"]


def test_the_budget_item_by_item(small):
    found = budget(small)
    rows = [(item.seq, round(item.need_wh, 2), round(item.left_wh, 2)) for item in found.items]
    # 12 s and 2.5 s of climb at 432 W; 89.06 s and 3.33 s at 370 W; 13.33 s, 20 s and 1 s at 360 W
    assert rows == [(1, 1.74, 18.26), (2, 9.5, 8.76), (3, 3.43, 5.33)]
    assert found.need_wh == pytest.approx(14.67, abs=0.01)
    assert found.budget_wh == pytest.approx(16.67, abs=0.01)


def test_the_ways_back_item_by_item(small):
    backs = [item.back for item in budget(small).items]
    # home from right above it: the pause of 5 s and the descent; the landing point from right above it
    assert [(back.place, round(back.need_wh, 2)) for back in backs[:2]] == [("home", 3.98), ("landing", 3.98)]
    # what was left, less that, less the reserve of 2 Wh
    assert [round(back.margin_wh, 2) for back in backs[:2]] == [12.28, 2.78]
    assert backs[2] is None, "it has landed"


def test_from_where_on_there_is_no_way_back(small):
    # of 14 Wh 12.26 - 0.021327 x are left at x m (9.496 Wh over 445.28 m). Home takes 3.983 Wh for the pause and the
    # descent, 370 W for x / 5 + 3.333 s, and 2 Wh stay: 5.934 - 0.041883 x, which is nothing at 141.7 m
    small.plan["rallyPoints"]["points"] = []
    assert budget(small, battery=14.0).no_return_m == pytest.approx(141.7, abs=1.0)


def test_a_rally_point_on_the_way_moves_the_point_of_no_return(small):
    # At 278.3 m, above the rally point, 0.34 Wh are left over. The way back from d m past it is too short for 5 m/s: it
    # takes 370 W for 2 sqrt(d / 1.5) s. 0.34 - 0.0213 d - 0.1678 sqrt(d) is 0 at d = 2.8 m.
    assert budget(small, battery=14.0).no_return_m == pytest.approx(281.1, abs=1.0)


def box(small, west, east):
    """A geofence from longitude to longitude, over every latitude of the mission."""
    corners = [[0.01, west], [0.01, east], [-0.01, east], [-0.01, west]]
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": corners, "version": 1}]


def test_no_place_outside_the_geofence_is_a_way_back(small):
    """The fault: the check warned of such a rally point, "no return goes there", and counted on it."""
    del small.items[2]
    small.plan["rallyPoints"]["points"] = [[0.0, 10.0055, 30]]
    numbers(small, 30.0)
    assert budget_of_small(small).items[1].back.place == "rally 1"
    box(small, 9.9, 10.0052)
    item = budget_of_small(small).items[1]
    assert (item.back.place, round(item.back.need_wh, 2)) == ("home", 13.48)


def test_where_no_place_is_inside_the_geofence_there_is_no_way_back(small):
    del small.items[2]
    numbers(small, 100.0)
    box(small, 10.0036, 10.1)  # home and the rally point are west of it
    found_ = budget_of_small(small)
    assert [item.back for item in found_.items] == [None, None]
    assert found_.no_return_m == 0.0
    report = check(load(small.write()))
    errors = [finding.text for finding in report.findings if finding.severity is Severity.ERROR]
    assert "no return site is inside the geofence" in errors
    assert not any("is never farther than" in finding.text for finding in report.findings)


def test_the_nearest_place_that_the_check_tells_of_is_inside_the_geofence(small):
    def nearest():
        (text,) = [f.text for f in check(load(small.write())).findings if "is never farther than" in f.text]
        return text

    small.plan["rallyPoints"]["points"] = [[0.0, 10.0055, 30]]
    assert nearest().startswith("home or a rally point is never farther than 2")
    box(small, 9.9, 10.0052)
    assert nearest().startswith("home or a rally point is never farther than 445 m")


def test_with_enough_in_the_battery_there_always_is_one(small):
    assert budget(small, battery=100.0).no_return_m is None


def test_wind_ahead_costs_and_wind_from_behind_gives_nothing(small):
    calm = budget(small, Wind(0.0, 0.0)).need_wh
    small.toml = small.toml.split("\n[energy]")[0] + "\n"
    behind = budget(small, Wind(4.0, 270.0)).need_wh
    small.toml = small.toml.split("\n[energy]")[0] + "\n"
    ahead = budget(small, Wind(7.0, 90.0)).need_wh
    assert calm <= behind < calm * 1.02, "hovering in it is not free"
    # 3 m/s over ground at 10 through the air: 148.4 s and 2 s at 440 W instead of 92.4 s at 370 W
    assert ahead - calm > 8.8


# --- handover check ---


def test_a_mission_without_numbers_says_that_its_budget_is_unknown(small):
    report = check(load(small.write()), wind=Wind(12.0, 90.0))
    assert report.energy is None
    assert "energy      unknown: no [energy] numbers in mission.toml" in report_text(report).splitlines()
    assert report.exit_code == 0


def test_half_of_the_numbers_says_what_is_missing(small):
    small.toml += "[energy]\nbattery_wh = 41\n"
    text = report_text(check(load(small.write())))
    assert "energy      unknown: [energy] has neither hover_w nor mass_kg in mission.toml" in text.splitlines()


def test_a_budget_that_closes_is_no_finding(small):
    assert found(numbers(small), Severity.ERROR) == []
    assert check(load(small.write())).exit_code == 0


def test_a_route_that_needs_more_than_there_is_is_an_error(small):
    assert found(numbers(small, battery=15.0), Severity.ERROR) == [
        "energy: the route needs 16.7 Wh of 15.0 Wh with the reserve: it does not close",
        "energy: from item 2 no place is in reach with the reserve: the best is landing",
    ]
    assert check(load(small.write())).exit_code == 1


def test_an_item_with_no_place_in_reach_is_an_error(small):
    # a return waits 5 s before it comes down: half a watt-hour more than the route takes
    assert found(numbers(small, battery=17.0), Severity.ERROR) == [
        "energy: from item 2 no place is in reach with the reserve: the best is landing",
    ]


def test_a_wind_that_cannot_be_flown_against_is_an_error(small):
    assert found(numbers(small), Severity.ERROR, wind=Wind(10.0, 90.0)) == [
        "energy: the wind does not let the way to item 2 be flown"
    ]
    text = report_text(check(load(small.write()), wind=Wind(10.0, 90.0)))
    assert "energy      the route cannot be flown; wind: 10 m/s from 90 degrees" in text.splitlines()
    assert "inf " not in text
    assert "nan" not in text


def test_the_point_of_no_return_is_an_info(small):
    (text,) = found(numbers(small, battery=17.5), Severity.INFO)
    assert text.startswith("energy: from ")
    assert text.endswith(" m along the route on no return site is in reach with the reserve")


def test_the_table_of_the_budget(small):
    lines = report_text(check(load(numbers(small, 100.0).write()))).splitlines()
    assert lines[5] == (
        "energy      the route takes 14.7 Wh, with the reserve 16.7 Wh of 100.0 Wh; "
        "wind: 0 m/s from ahead wherever it flies"
    )
    first = next(number for number, line in enumerate(lines) if line.split()[:2] == ["to", "item"])
    assert [line.split() for line in lines[first + 1 : first + 4]] == [
        ["1", "0", "m", "-", "-", "1.7", "Wh", "98.3", "Wh", "home", "4.0", "Wh", "92.3", "Wh"],
        ["2", "445", "m", "5.0", "m/s", "370", "W", "9.5", "Wh", "88.8", "Wh", "landing", "4.0", "Wh", "82.8", "Wh"],
        ["3", "0", "m", "-", "-", "3.4", "Wh", "85.3", "Wh", "-", "-", "-"],
    ]


@pytest.mark.parametrize(
    ("option", "words"), [("8,270", "8 m/s from 270 degrees"), ("0,0", "0 m/s from 0 degrees"), ("7.5,90.5", "7.5 m/s")]
)
def test_the_option_for_the_wind(small, capsys, option, words):
    main([str(numbers(small, 100.0).write()), "--wind", option])
    assert f"wind: {words}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "option", ["8", "8,", ",8", "8,270,1", "-1,270", "61,0", "5,361", "5,-1", "nan,90", "5,nan", "a,b"]
)
def test_a_wind_that_is_none_is_bad_usage(small, capsys, option):
    assert main([str(numbers(small).write()), f"--wind={option}"]) == 2
    assert "allowed: " in capsys.readouterr().err


@pytest.mark.parametrize("name", ["delivery", "linear", "corridor", "meridian", "ridge", "field-test", "waypoints"])
@pytest.mark.parametrize("wind", [None, Wind(5.0, 0.0), Wind(5.0, 90.0), Wind(5.0, 180.0), Wind(5.0, 270.0)])
def test_the_missions_that_ship_close_their_budget(missions, name, wind):
    report = check(load(missions / name), wind=wind)
    assert report.energy is not None
    assert report.exit_code == 0


# --- curves ---


def test_a_curve_costs_one_start_and_one_stop_whatever_pieces_stand_for_it():
    """The fault: each piece of a circle was counted from rest to rest, 70 % too much."""
    ring = [Leg(2, (0.0, n * 1e-4, 30.0), (0.0, (n + 1) * 1e-4, 30.0), 1.1, curved=True) for n in range(10)]
    straight = [Leg(2, (0.0, 0.0, 30.0), (0.0, 1e-3, 30.0), 11.1)]
    model = EnergySettings(battery_wh=100.0, hover_w=300.0).model()
    curve_wh, line_wh = (model.need_wh(pieces_along(legs, (), model, None)) for legs in (ring, straight))
    assert curve_wh == pytest.approx(line_wh, rel=0.05)
    stops = [replace(leg, rests=True) for leg in ring]
    assert model.need_wh(pieces_along(stops, (), model, None)) > 1.6 * line_wh


@pytest.mark.parametrize(
    ("turn_deg", "part"),
    [
        pytest.param(0.0, 0.0, id="straight on"),
        pytest.param(10.0, 0.0, id="36 m/s would do"),
        pytest.param(60.0, 0.28, id="5.7 m/s"),
        pytest.param(90.0, 0.53, id="3.5 m/s"),
        pytest.param(135.0, 0.75, id="1.8 m/s"),
        pytest.param(180.0, 1.0, id="a stop"),
    ],
)
def test_a_corner_costs_a_part_of_a_stop_by_its_angle(turn_deg, part):
    """At 10 m/s a stop costs 6.67 s. A corner is cut by 1 m with 5 m/s^2: 1 m = r (1 / cos(turn / 2) - 1)."""
    turn = math.radians(turn_deg)
    corner, end = offset(0.0, 0.0, 0.0, 300.0), (300.0 * math.sin(turn), 300.0 + 300.0 * math.cos(turn))
    legs = [
        Leg(2, (0.0, 0.0, 30.0), (*corner, 30.0), 30.0),
        Leg(3, (*corner, 30.0), (*offset(0.0, 0.0, *end), 30.0), 30.0),
    ]
    model = EnergySettings(battery_wh=100.0, hover_w=300.0, cruise_w=300.0, headwind_mps=0.0).model()
    need_s = model.need_wh(pieces_along(legs, (), model, None)) * 3600.0 / 300.0
    assert need_s == pytest.approx(60.0 + 6.67 + 6.67 * part, abs=0.2)


def test_a_slow_descent_counts_as_a_landing_and_no_climb_does():
    low, high = (0.0, 0.0, 10.0), (0.0, 0.0, 40.0)
    model = EnergySettings(battery_wh=100.0, hover_w=300.0).model()
    (slow,), (fast,), (up,) = (
        pieces_along((Leg(2, *ends, time_s),), (), model, None)
        for ends, time_s in (((high, low), 60.0), ((high, low), 20.0), ((low, high), 12.0))
    )
    assert (slow.landing_m, fast.landing_m, up.landing_m) == (30.0, 0.0, 0.0)


def test_a_way_that_wings_fly_hovering_takes_the_power_of_hovering():
    """The fault: after a DO_VTOL_TRANSITION to hover the power of the wings was counted, 63 % too little."""
    model = EnergySettings(battery_wh=100.0, hover_w=650.0, cruise_w=134.0, cruise_mps=22.0).model(None, ON_WINGS)
    ends = (0.0, 0.0, 40.0), (0.0, 1e-2, 40.0)
    winged, hovering = (Leg(2, *ends, 222.0, speed_mps=5.0, hovers=hovers) for hovers in (False, True))
    winged_wh, hovering_wh = (model.need_wh(pieces_along((leg,), (), model, None)) for leg in (winged, hovering))
    assert hovering_wh / winged_wh == pytest.approx(650.0 / 134.0)


def test_a_landing_on_rotors_has_one_transition():
    model = EnergySettings(battery_wh=100.0, hover_w=650.0, cruise_w=134.0, cruise_mps=22.0).model(None, ON_WINGS)
    whole = Leg(2, (0.0, 0.0, 40.0), (0.0, 0.0, 0.0), 40.0)
    parts = (Leg(2, (0.0, 0.0, 40.0), (0.0, 0.0, 10.0), 20.0), Leg(2, (0.0, 0.0, 10.0), (0.0, 0.0, 0.0), 20.0))
    one_wh, two_wh = (model.need_wh(pieces_along(legs, (), model, None)) for legs in ((whole,), parts))
    assert one_wh == pytest.approx(two_wh)

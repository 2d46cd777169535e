# SPDX-License-Identifier: GPL-3.0-or-later

"""Routes: what of a plan reaches the autopilot, and the words for every plan that cannot be flown."""

from __future__ import annotations

import json

import pytest

from mavproxy_handover.mission import MissionError, MissionItem, RallyPoint, read_route
from mavproxy_handover.mission.plan import FenceCircle, FencePolygon, Home


def read(plan):
    return read_route("small.plan", plan if isinstance(plan, str) else json.dumps(plan))


def refusal(plan):
    with pytest.raises(MissionError) as caught:
        read(plan)
    return str(caught.value)


# --- what is read ---


def test_plan_becomes_home_items_rally_points_and_speed(small):
    route = read(small.plan)
    assert route.home == Home(0.0, 10.001, 100.0)
    assert route.items == (
        MissionItem(1, 22, 3, 0.0, 0.0, 0.0, 0.0, 0.0, 10.001, 30.0, True),
        MissionItem(2, 16, 3, 0.0, 0.0, 0.0, 0.0, 0.0, 10.005, 30.0, True),
        MissionItem(3, 21, 3, 0.0, 0.0, 0.0, 0.0, 0.0, 10.005, 0.0, True),
    )
    assert route.rally == (RallyPoint(0.0, 10.0035, 30.0),)
    assert route.cruise_speed_mps == 5.0
    assert route.fence == ()
    assert route.warnings == ()


def test_items_to_upload_start_with_home_so_that_index_is_item_number(small):
    upload = read(small.plan).upload_items()
    assert [item.seq for item in upload] == [0, 1, 2, 3]
    assert upload[0] == MissionItem(0, 16, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 10.001, 100.0, True)


def test_parameters_left_open_are_zero(small):
    small.items[1]["params"][:4] = [7, None, None, None]
    assert read(small.plan).items[1].params == (7.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("written", "stored"), [(0, 0), (5, 0), (3, 3), (6, 3), (10, 10), (11, 10)])
def test_frames_are_those_the_autopilot_stores(small, written, stored):
    small.items[1]["frame"] = written
    assert read(small.plan).items[1].frame == stored


def test_item_without_place_carries_none(small):
    small.items.insert(1, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 3, 4, 5]})
    assert read(small.plan).items[1] == MissionItem(2, 178, 2, 1.0, 8.0, -1.0, 0.0, 0.0, 0.0, 0.0, True)


def test_wings_are_planned_by_cruise_speed_and_copters_by_hover_speed(small):
    small.plan["mission"]["vehicleType"] = 1
    assert read(small.plan).cruise_speed_mps == 15.0


def test_geofence_is_read(small):
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": [[1, 2], [3, 4], [5, 2]], "version": 1}]
    small.plan["geoFence"]["circles"] = [{"circle": {"center": [1, 2], "radius": 50}, "inclusion": False, "version": 1}]
    assert read(small.plan).fence == (
        FencePolygon(True, ((1.0, 2.0), (3.0, 4.0), (5.0, 2.0))),
        FenceCircle(False, 1.0, 2.0, 50.0),
    )


def test_waypoint_file_gives_the_same_items_as_the_plan(small):
    text = (
        "QGC WPL 110\n"
        "0\t1\t0\t16\t0\t0\t0\t0\t0.0\t10.001\t100.0\t1\n"
        "# a remark\n"
        "1\t0\t3\t22\t0\t0\t0\tnan\t0.0\t10.001\t30\t1\n"
        "2\t0\t3\t16\t0\t0\t0\t0\t0.0\t10.005\t30\t1\n"
        "3\t0\t3\t21\t0\t0\t0\t0\t0.0\t10.005\t0\t1\n"
    )
    route = read_route("small.waypoints", text)
    assert (route.home, route.items) == (read(small.plan).home, read(small.plan).items)
    assert route.rally == ()
    assert route.warnings == ("no rally point: the aircraft can only return to home",)


@pytest.mark.parametrize("name", ["delivery", "linear", "corridor", "meridian", "ridge", "field-test", "waypoints"])
def test_shipped_plans_have_what_qgroundcontrol_wants_of_every_item(missions, name):
    plan = json.loads((missions / name / f"{name}.plan").read_text())
    assert plan["groundStation"] == "QGroundControl"
    assert (plan["mission"]["firmwareType"], plan["mission"]["vehicleType"]) == (3, 2)
    for number, item in enumerate(plan["mission"]["items"], 1):
        assert item["doJumpId"] == number
        assert len(item["params"]) == 7
        if item["command"] not in (20, 211):  # NAV_RETURN_TO_LAUNCH and DO_GRIPPER have no place
            assert (item["AltitudeMode"], item["frame"]) == (1, 3)
            assert item["Altitude"] == item["params"][6]


# --- what is odd ---


def test_route_that_does_not_end_on_the_ground_is_a_warning(small):
    del small.items[2]
    assert read(small.plan).warnings == ("the route ends with NAV_WAYPOINT, not with NAV_LAND or NAV_RETURN_TO_LAUNCH",)


def test_items_behind_a_return_are_a_warning(small):
    small.items[1] = {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0] * 7}
    assert read(small.plan).warnings == ("item 2 is NAV_RETURN_TO_LAUNCH: what follows it is never flown",)


def test_endless_loiter_is_a_warning(small):
    small.items[1]["command"] = 17
    assert read(small.plan).warnings == ("item 2 is NAV_LOITER_UNLIM: the aircraft waits there until told to go on",)


def test_plan_without_rally_points_is_a_warning(small):
    small.plan["rallyPoints"]["points"] = []
    assert read(small.plan).warnings == ("no rally point: the aircraft can only return to home",)


def test_plan_for_another_autopilot_is_a_warning(small):
    small.plan["mission"]["firmwareType"] = 12
    assert read(small.plan).warnings == (
        "the plan was made for another autopilot than ArduPilot (firmwareType is not 3)",
    )


# --- what is refused ---


def test_refuses_another_ending():
    with pytest.raises(MissionError) as caught:
        read_route("route.kml", "")
    assert str(caught.value) == "route.kml: not a route (allowed: a file named *.plan or *.waypoints)"


def test_refuses_text_that_is_no_json():
    assert refusal('{"fileType": ') == "small.plan: line 1, column 14: not JSON: Expecting value"


def test_refuses_infinity_which_python_would_read(small):
    text = json.dumps(small.plan).replace("10.005", "Infinity")
    assert refusal(text) == "small.plan: Infinity is not JSON (allowed: finite numbers, null)"


def test_refuses_nesting_out_of_all_bounds():
    assert refusal("[" * 100_000) == (
        "small.plan: not JSON that a mission can hold (a number or a nesting out of all bounds)"
    )


def test_refuses_a_file_that_is_no_plan():
    assert refusal({"fileType": "Fence"}) == "small.plan: not a QGroundControl plan (fileType is not 'Plan')"


def test_refuses_an_old_plan(small):
    small.plan["mission"]["version"] = 1
    assert refusal(small.plan) == (
        "small.plan: mission: version is not 2: save the plan again with a present QGroundControl"
    )


def test_refuses_an_old_geofence(small):
    small.plan["geoFence"] = {"polygon": [[0.0, 10.0], [0.0, 10.1], [0.1, 10.0]], "version": 1}
    assert refusal(small.plan) == (
        "small.plan: geoFence: version is not 2: save the plan again with a present QGroundControl"
    )


def test_refuses_a_plan_without_mission(small):
    del small.plan["mission"]
    assert refusal(small.plan) == "small.plan: key 'mission' is missing"


def test_refuses_complex_items_by_name(small):
    small.items[1] = {"type": "ComplexItem", "complexItemType": "survey"}
    assert refusal(small.plan) == (
        "small.plan: item 2: complex item 'survey' (allowed: SimpleItem; rebuild the pattern from waypoints)"
    )


def test_refuses_items_of_unknown_type(small):
    small.items[1]["type"] = "Simple"
    assert refusal(small.plan) == "small.plan: item 2: type is not 'SimpleItem'"


def test_refuses_six_parameters(small):
    small.items[1]["params"].pop()
    assert refusal(small.plan) == "small.plan: item 2: params has 6 numbers (allowed: 7)"


def test_refuses_a_parameter_that_is_no_number(small):
    small.items[1]["params"][1] = "5"
    assert refusal(small.plan) == ("small.plan: item 2: parameter 2 is '5' (allowed: a number from -1e+09 to 1e+09)")


@pytest.mark.parametrize("command", [177, 179, 207, 92, 5000])
def test_refuses_commands_that_would_make_the_check_worthless(small, command):
    small.items[1]["command"] = command
    assert refusal(small.plan).startswith(
        f"small.plan: item 2: command {command} is not one a mission package may hold (allowed: 16 NAV_WAYPOINT, "
    )


def test_refuses_a_command_that_is_no_number(small):
    small.items[1]["command"] = None
    assert refusal(small.plan) == "small.plan: item 2: command is null (allowed: a whole number from 0 to 65535)"


@pytest.mark.parametrize("frame", [1, 2, None, False, "3", 1e400])
def test_refuses_frames_without_a_place(small, frame):
    small.items[1]["frame"] = frame
    text = json.dumps(small.plan).replace("Infinity", "1e400")
    assert refusal(text) == (
        "small.plan: item 2: frame of NAV_WAYPOINT is not one with a place (allowed: 0, 5, 3, 6, 10, 11)"
    )


def test_refuses_a_latitude_beyond_the_pole(small):
    small.items[1]["params"][4] = 90.5
    assert refusal(small.plan) == "small.plan: item 2: latitude is 90.5 (allowed: a number from -90 to 90)"


def test_refuses_a_longitude_beyond_the_date_line(small):
    small.items[1]["params"][5] = -181
    assert refusal(small.plan) == "small.plan: item 2: longitude is -181 (allowed: a number from -180 to 180)"


def test_refuses_an_altitude_left_open(small):
    small.items[1]["params"][6] = None
    assert refusal(small.plan) == "small.plan: item 2: altitude is null (allowed: a number from -1000 to 10000)"


@pytest.mark.parametrize(
    ("made_for", "words"),
    [
        (1, "a fixed-wing aircraft (vehicleType 1), the mission is for a copter"),
        (20, "a VTOL aircraft (vehicleType 20), the mission is for a copter"),
        (10, "a rover (vehicleType 10), the mission is for a copter"),
        (12, "a submarine (vehicleType 12), the mission is for a copter"),
    ],
)
def test_a_plan_of_another_kind_of_aircraft_is_a_warning(small, made_for, words):
    small.plan["mission"]["vehicleType"] = made_for
    assert f"the plan was made for {words}" in read(small.plan).warnings


@pytest.mark.parametrize("made_for", [0, 2, 13, 14, 35, 99, True, "2", None])
def test_a_plan_of_a_copter_or_of_no_known_kind_is_none(small, made_for):
    small.plan["mission"]["vehicleType"] = made_for
    assert not any("made for" in text for text in read(small.plan).warnings)


def test_empty_rally_points_and_fence_of_an_old_plan_are_none(small):
    small.plan["rallyPoints"] = {"version": 1, "points": []}
    small.plan["geoFence"] = {"version": 1, "polygon": []}
    route = read(small.plan)
    assert (route.rally, route.fence) == ((), ())


def test_refuses_rally_points_of_an_old_plan(small):
    small.plan["rallyPoints"]["version"] = 1
    assert refusal(small.plan) == (
        "small.plan: rallyPoints: version is not 2: save the plan again with a present QGroundControl"
    )


def test_refuses_a_home_that_was_never_set(small):
    small.plan["mission"]["plannedHomePosition"] = [0, 0, 0]
    assert refusal(small.plan) == (
        "small.plan: home is at latitude 0, longitude 0: it was never set (allowed: the place of the take-off)"
    )


def test_refuses_a_home_without_altitude(small):
    small.plan["mission"]["plannedHomePosition"] = [0.0, 10.0]
    assert refusal(small.plan) == "small.plan: mission: plannedHomePosition has 2 numbers (allowed: 3)"


def test_refuses_a_rally_point_out_of_range(small):
    small.plan["rallyPoints"]["points"] = [[0, 0, 30], [10.0, 200.0, 30]]
    assert refusal(small.plan) == (
        "small.plan: rallyPoints: point 2 longitude is 200.0 (allowed: a number from -180 to 180)"
    )


def test_refuses_a_rally_point_in_centimetres(small):
    small.plan["rallyPoints"]["points"] = [[0, 0, 30000]]
    assert refusal(small.plan) == (
        "small.plan: rallyPoints: point 1 altitude is 30000 (allowed: a number from -1000 to 10000)"
    )


def test_refuses_a_fence_of_two_corners(small):
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": [[1, 2], [3, 4]]}]
    assert refusal(small.plan) == "small.plan: geoFence, polygon 1: 2 corners (allowed: 3 to 255)"


def test_refuses_a_fence_of_more_corners_than_the_autopilot_counts(small):
    ring = [[n / 1000, n / 1000] for n in range(256)]
    small.plan["geoFence"]["polygons"] = [{"inclusion": True, "polygon": ring}]
    assert refusal(small.plan) == "small.plan: geoFence, polygon 1: 256 corners (allowed: 3 to 255)"
    small.plan["geoFence"]["polygons"][0]["polygon"].pop()
    assert len(read(small.plan).fence[0].corners) == 255


def test_refuses_a_fence_circle_without_radius(small):
    small.plan["geoFence"]["circles"] = [{"circle": {"center": [1, 2]}}]
    assert refusal(small.plan) == "small.plan: geoFence, circle 1: key 'radius' is missing"


def test_refuses_a_route_without_takeoff(small):
    del small.items[0]
    assert refusal(small.plan) == "small.plan: the first flown item is NAV_WAYPOINT (allowed: NAV_TAKEOFF first)"


def test_refuses_an_empty_route(small):
    small.items.clear()
    assert refusal(small.plan) == "small.plan: nothing is flown (allowed: NAV_TAKEOFF first)"


def test_takeoff_may_follow_items_that_are_not_flown(small):
    small.items.insert(0, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 0, 0, 0]})
    assert read(small.plan).items[1].command == 22


def test_refuses_a_takeoff_that_does_not_climb(small):
    small.items[0]["params"][6] = 0
    assert refusal(small.plan) == "small.plan: item 1: take-off to 0 m (allowed: above home)"


def test_refuses_more_items_than_the_autopilot_stores(small):
    small.items[1:1] = [small.item(2, 16, 0.0, 10.002, 30)] * 700
    assert refusal(small.plan) == "small.plan: 703 items (allowed: at most 700)"


def waypoint_refusal(text):
    with pytest.raises(MissionError) as caught:
        read_route("a.waypoints", text)
    return str(caught.value)


HOME_LINE = "0 1 0 16 0 0 0 0 0.0 10.001 100.0 1\n"


def test_refuses_a_waypoint_file_of_another_version():
    assert waypoint_refusal("QGC WPL 100\n") == (
        "a.waypoints: not a waypoint file (allowed: a first line 'QGC WPL 110')"
    )


def test_refuses_an_empty_waypoint_file():
    assert waypoint_refusal("QGC WPL 110\n") == (
        "a.waypoints: no items (allowed: item 0 is home, item 1 the first one flown)"
    )


def test_refuses_a_waypoint_line_with_a_field_missing():
    assert waypoint_refusal("QGC WPL 110\n0 1 0 16 0 0 0 0 0.0 10.0 100.0\n") == (
        "a.waypoints: line 2: 11 fields (allowed: 12)"
    )


def test_refuses_waypoints_out_of_order():
    assert waypoint_refusal("QGC WPL 110\n" + HOME_LINE + "2 0 3 22 0 0 0 0 0 10 30 1\n") == (
        "a.waypoints: line 3: item number is '2' (allowed here: 1, items count up from 0)"
    )


def test_refuses_a_field_that_is_no_number():
    assert waypoint_refusal("QGC WPL 110\n" + HOME_LINE + "1 0 3 22 0 0 x 0 0 10 30 1\n") == (
        "a.waypoints: line 3: field 7 is 'x' (allowed: a number)"
    )


def test_refuses_a_field_that_is_infinite():
    assert waypoint_refusal("QGC WPL 110\n" + HOME_LINE + "1 0 3 22 0 0 0 0 0 inf 30 1\n") == (
        "a.waypoints: line 3: longitude is inf (allowed: a number from -180 to 180)"
    )

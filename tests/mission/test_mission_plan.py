# SPDX-License-Identifier: GPL-3.0-or-later

"""Routes: what of a plan reaches the autopilot, and the words for every plan that cannot be flown."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from mavproxy_handover.mission import MissionError, MissionItem, RallyPoint, difference, read_route
from mavproxy_handover.mission.plan import FenceCircle, FencePolygon, Home
from mavproxy_handover.mission.protocol_items import item_message, item_of, older_item_message
from mavproxy_handover.vehicle.profiles import PLANE


def read(plan):
    return read_route("small.plan", plan if isinstance(plan, str) else json.dumps(plan))


def refusal(plan):
    with pytest.raises(MissionError) as caught:
        read(plan)
    return str(caught.value)


def do_item(command, *params):
    numbers = [*params, *[0] * (7 - len(params))]
    return {"type": "SimpleItem", "command": command, "frame": 2, "params": numbers, "doJumpId": 1}


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


@pytest.mark.parametrize(("written", "stored"), [(0, 0), (2, 0), (5, 0), (3, 3), (6, 3), (10, 10), (11, 10)])
def test_frames_are_those_the_autopilot_stores(small, written, stored):
    small.items[1]["frame"] = written
    assert read(small.plan).items[1].frame == stored


def test_item_without_place_carries_none(small):
    small.items.insert(1, {"type": "SimpleItem", "command": 178, "frame": 2, "params": [1, 8, -1, 0, 3, 4, 5]})
    assert read(small.plan).items[1] == MissionItem(2, 178, 2, 1.0, 8.0, -1.0, 0.0, 0.0, 0.0, 0.0, True)


def test_wings_are_planned_by_cruise_speed_and_copters_by_hover_speed(small):
    small.plan["mission"]["vehicleType"] = 1
    assert read_route("small.plan", json.dumps(small.plan), PLANE).cruise_speed_mps == 15.0


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


def scan(name, *items):
    return {"type": "ComplexItem", "complexItemType": name, "TransectStyleComplexItem": {"Items": list(items)}}


@pytest.mark.parametrize("name", ["survey", "CorridorScan", "StructureScan"])
def test_a_scan_counts_by_the_waypoints_that_it_stores(small, name):
    trigger = do_item(206, 25)
    small.items[1] = scan(name, small.item(2, 16, 0.0, 10.002, 30), trigger, small.item(4, 16, 0.0, 10.004, 40))
    items = read(small.plan).items
    assert [(item.seq, item.command) for item in items] == [(1, 22), (2, 16), (3, 206), (4, 16), (5, 21)]
    assert (items[3].lon_deg, items[3].alt_m) == (10.004, 40.0)


def landing_pattern(**changes):
    return {
        "type": "ComplexItem",
        "complexItemType": "fwLandingPattern",
        "version": 2,
        "altitudesAreRelative": True,
        "landCoordinate": [0.0, 10.001, 0],
        "landingApproachCoordinate": [0.0, 10.006, 45],
        "loiterRadius": 80,
        "loiterClockwise": False,
        "stopTakingPhotos": True,
        "stopVideoPhotos": True,
        "useLoiterToAlt": True,
        **changes,
    }


def test_a_landing_pattern_is_the_items_that_qgroundcontrol_uploads_for_it(small):
    small.plan["mission"]["vehicleType"] = 1
    small.items[0]["params"][4:6] = [0.0, 10.004]
    small.items[2] = landing_pattern()
    items = read_route("small.plan", json.dumps(small.plan), PLANE).items
    assert [(item.seq, item.command) for item in items[2:]] == [
        (3, 189),
        (4, 206),
        (5, 2001),
        (6, 2501),
        (7, 31),
        (8, 21),
    ]
    assert items[6] == MissionItem(7, 31, 3, 1.0, -80.0, 0.0, 1.0, 0.0, 10.006, 45.0, True)
    assert items[7] == MissionItem(8, 21, 3, 0.0, 0.0, 0.0, 0.0, 0.0, 10.001, 0.0, True)
    assert not items[2].has_place


def test_a_landing_pattern_may_begin_with_a_waypoint_and_count_from_the_sea(small):
    small.plan["mission"]["vehicleType"] = 1
    small.items[0]["params"][4:6] = [0.0, 10.004]
    changes = {"useLoiterToAlt": False, "stopTakingPhotos": False, "altitudesAreRelative": False}
    small.items[2] = landing_pattern(**changes)
    items = read_route("small.plan", json.dumps(small.plan), PLANE).items
    assert [(item.command, item.frame) for item in items[2:]] == [(189, 0), (2501, 2), (16, 0), (21, 0)]


def test_a_fault_in_a_landing_pattern_names_its_key(small):
    small.items[2] = landing_pattern(loiterRadius="wide")
    assert refusal(small.plan) == (
        "small.plan: item 3, fwLandingPattern: loiterRadius is 'wide' (allowed: a number from 0 to 10000)"
    )


def test_a_fault_in_a_scan_is_told_by_its_waypoint(small):
    small.items[1] = scan("survey", small.item(2, 16, 0.0, 10.002, 30), small.item(3, 16, 95.0, 10.002, 30))
    assert refusal(small.plan) == (
        "small.plan: item 2, waypoint 2 of 'survey': latitude is 95.0 (allowed: a number from -90 to 90)"
    )


@pytest.mark.parametrize(
    ("command", "params"),
    [
        (202, (1, 2, 3, 4, 5, 6, 0)),
        (203, (0, 0, 0, 0, 1, 0, 0)),
        (206, (25, 0, 1)),
        (216, (1,)),
        (531, (1, 2.5)),
        (532, (4, 0)),
        (534, (1, 2, 3)),
        (1000, (-30, 90, 0, 0, 12, 0, 1)),
        (2500, (0, 1, 0)),
        (2501, (0,)),
    ],
)
def test_camera_gimbal_and_video_commands_are_kept_and_uploaded(small, command, params):
    small.items[1] = do_item(command, *params)
    item = read(small.plan).items[1]
    message = item_message(item, (1, 1), 0)
    sent = (*item.params, message.x, message.y, message.z)
    assert (item.command, sent[: len(params)]) == (command, params)
    assert not item.has_place
    assert difference(item, item_of(message)) is None
    older = older_item_message(item, (1, 1), 0)
    assert (older.x, older.y, older.z) == pytest.approx((message.x, message.y, message.z))
    assert item_of(older) == item


def test_parameters_in_the_place_of_a_place_are_compared(small):
    small.items[1] = do_item(203, 0, 0, 0, 0, 1)
    item = read(small.plan).items[1]
    assert difference(item, replace(item, lat_deg=0.0)) == "item 2: parameter 5 1 came back as 0"
    assert difference(item, replace(item, lon_deg=3e-7)) == "item 2: parameter 6 0 came back as 3"


def test_a_jump_of_a_plan_names_an_item_by_its_jump_id(small):
    for number, item in enumerate(small.items, 11):
        item["doJumpId"] = number
    small.items.insert(2, {**do_item(177, 12, 2), "doJumpId": 14})
    assert read(small.plan).items[2].params == (2.0, 2.0, 0.0, 0.0)


def test_a_takeoff_without_a_place_is_where_the_aircraft_stands(small):
    small.items[0]["params"][4:6] = [None, None]
    assert not read(small.plan).items[0].has_place


@pytest.mark.parametrize("section", [None, {}, [], {"version": 3}, {"version": 1, "points": [], "polygons": []}])
def test_an_empty_section_of_any_version_is_none(small, section):
    small.plan["rallyPoints"] = small.plan["geoFence"] = section
    route = read(small.plan)
    assert (route.rally, route.fence) == ((), ())


def test_a_home_without_height_is_said(small):
    small.plan["mission"]["plannedHomePosition"][2] = None
    route = read(small.plan)
    assert route.home.alt_m == 0.0
    assert route.warnings == ("home has no height in the plan: 0 m above the sea is assumed",)


# --- what is odd ---


def test_route_that_does_not_end_on_the_ground_is_a_warning(small):
    del small.items[2]
    assert read(small.plan).warnings == ("the route ends with NAV_WAYPOINT, not with NAV_LAND or NAV_RETURN_TO_LAUNCH",)


def test_items_behind_a_return_are_a_warning(small):
    small.items[1] = {"type": "SimpleItem", "command": 20, "frame": 2, "params": [0] * 7}
    assert read(small.plan).warnings == ("item 2 is NAV_RETURN_TO_LAUNCH: what follows it is never flown",)


def test_items_behind_a_landing_of_a_copter_are_a_warning(small):
    small.items.insert(1, small.item(2, 21, 0.0, 10.002, 0))
    assert read(small.plan).warnings == (
        "item 2 is NAV_LAND: ArduCopter disarms there. What follows it is flown only if MIS_OPTIONS has 4 and a "
        "take-off follows",
    )


def test_endless_loiter_is_a_warning(small):
    small.items[1]["command"] = 17
    assert read(small.plan).warnings == (
        "item 2 is NAV_LOITER_UNLIM: the aircraft waits there until told to go on. No time is counted for that. The "
        "flight ends when no return site would be in reach any more",
    )


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


def test_refuses_complex_items_without_stored_waypoints_by_name(small):
    small.items[1] = {"type": "ComplexItem", "complexItemType": "survey"}
    assert refusal(small.plan) == (
        "small.plan: item 2: complex item 'survey' stores no waypoints (allowed: a survey, corridor or structure scan "
        "that has them; rebuild the pattern from waypoints)"
    )


def test_refuses_items_of_unknown_type(small):
    small.items[1]["type"] = "Simple"
    assert refusal(small.plan) == "small.plan: item 2: type is not 'SimpleItem' or 'ComplexItem'"


def test_refuses_six_parameters(small):
    small.items[1]["params"].pop()
    assert refusal(small.plan) == "small.plan: item 2: params has 6 numbers (allowed: 7)"


def test_refuses_a_parameter_that_is_no_number(small):
    small.items[1]["params"][1] = "5"
    assert refusal(small.plan) == ("small.plan: item 2: parameter 2 is '5' (allowed: a number from -1e+09 to 1e+09)")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (179, "DO_SET_HOME takes away a safeguard: it moves home, to which a return leads"),
        (92, "NAV_GUIDED_ENABLE takes away a safeguard: it hands the aircraft to another controller"),
        (42702, "NAV_SCRIPT_TIME takes away a safeguard: a script on board flies the aircraft"),
        (185, "DO_FLIGHTTERMINATION takes away a safeguard: it stops the motors"),
        (218, "DO_AUX_FUNCTION takes away a safeguard: it can switch the geofence, the flight mode and the motors"),
        (
            207,
            "DO_FENCE_ENABLE takes away a safeguard: it switches the geofence, or its floor, off (allowed: 1 in "
            "parameter 1)",
        ),
        (
            208,
            "DO_PARACHUTE takes away a safeguard: it releases the parachute, or switches it off (allowed: 1 in "
            "parameter 1)",
        ),
        (42703, "NAV_ATTITUDE_TIME is not allowed: the path that it makes is not known before the flight"),
        (
            530,
            "SET_CAMERA_MODE is not allowed: ArduPilot does not store it, and would refuse the mission: remove the "
            "item",
        ),
        (
            5000,
            "NAV_FENCE_RETURN_POINT is not allowed: ArduPilot does not store it, and would refuse the mission: remove "
            "the item",
        ),
        (
            4999,
            "command 4999 is not allowed: ArduPilot does not store it, and would refuse the mission: remove the item",
        ),
    ],
)
def test_refuses_commands_by_name_and_reason(small, command, words):
    small.items[1]["command"] = command
    assert refusal(small.plan) == f"small.plan: item 2: {words}"


@pytest.mark.parametrize("command", [207, 208, 223])
def test_switching_a_safeguard_on_is_allowed(small, command):
    small.items[1] = do_item(command, 1)
    assert read(small.plan).items[1].command == command


@pytest.mark.parametrize("action", [0, 2, 0.5, 1.5, None])
def test_refuses_every_other_value_of_a_safeguard(small, action):
    small.items[1] = do_item(207, action)
    assert "takes away a safeguard" in refusal(small.plan)


def test_all_faults_are_told_at_once_the_gravest_first(small):
    small.items[1]["params"][4] = 90.5
    small.items.insert(2, do_item(530))
    small.items.insert(3, do_item(179))
    with pytest.raises(MissionError) as caught:
        read(small.plan)
    assert [fault.split(" ", 3)[:3] for fault in caught.value.faults] == [
        ["small.plan:", "item", "4:"],
        ["small.plan:", "item", "2:"],
        ["small.plan:", "item", "3:"],
    ]
    assert str(caught.value) == (
        "small.plan: item 4: DO_SET_HOME takes away a safeguard: it moves home, to which a return leads (and 2 more)"
    )


def test_faults_of_the_sections_are_told_with_those_of_the_items(small):
    small.items[1]["params"][4] = 90.5
    small.plan["rallyPoints"]["points"] = [[95.0, 10.0, 30.0]]
    small.plan["geoFence"]["circles"] = [{"circle": {"center": [1, 2]}}]
    small.plan["mission"]["plannedHomePosition"] = [0.0, 10.0]
    with pytest.raises(MissionError) as caught:
        read(small.plan)
    assert len(caught.value.faults) == 4


def test_refuses_a_command_that_is_no_number(small):
    small.items[1]["command"] = None
    assert refusal(small.plan) == "small.plan: item 2: command is null (allowed: a whole number from 0 to 65535)"


@pytest.mark.parametrize("frame", [1, 4, None, False, "3", 1e400])
def test_refuses_frames_without_a_place(small, frame):
    small.items[1]["frame"] = frame
    text = json.dumps(small.plan).replace("Infinity", "1e400")
    assert refusal(text) == (
        "small.plan: item 2: frame of NAV_WAYPOINT is not one with a place (allowed: 0, 2, 5, 3, 6, 10, 11)"
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
def test_a_plan_of_another_kind_of_aircraft_is_refused(small, made_for, words):
    small.plan["mission"]["vehicleType"] = made_for
    assert refusal(small.plan) == (
        f"small.plan: mission: the plan was made for {words}: set aircraft in mission.toml, or make the plan for that "
        "vehicle"
    )


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


NO_HOME = (
    "home is not in the plan, or at latitude 0, longitude 0. It is taken to be at item {}. Coverage, energy and "
    "returns count from there: set it to the place of the take-off"
)


def test_a_home_that_was_never_set_is_taken_to_be_at_the_take_off(small):
    small.plan["mission"]["plannedHomePosition"] = [0, 0, 120]
    route = read(small.plan)
    assert route.home == Home(0.0, 10.001, 120.0)
    assert route.warnings == (NO_HOME.format("1 (NAV_TAKEOFF)"),)


def test_a_home_that_was_never_set_is_else_taken_to_be_at_the_first_place(small):
    small.plan["mission"]["plannedHomePosition"] = [0, 0, 0]
    small.items[0]["params"][4:6] = [0, 0]
    route = read(small.plan)
    assert route.home == Home(0.0, 10.005, 0.0)
    assert route.warnings == (NO_HOME.format("2 (NAV_WAYPOINT)"),)


def test_refuses_a_home_that_was_never_set_if_no_item_has_a_place(small):
    small.plan["mission"]["plannedHomePosition"] = [0, 0, 0]
    small.items[:] = [small.item(1, 22, 0, 0, 30), small.item(2, 20, 0, 0, 0)]
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


def test_a_mission_without_takeoff_is_a_warning(small):
    del small.items[0]
    assert read(small.plan).warnings == (
        "the mission begins with NAV_WAYPOINT, not with NAV_TAKEOFF: START is refused. Take off with the remote "
        "control, then change to AUTO",
    )


def test_a_delay_may_wait_on_the_ground_before_the_takeoff(small):
    small.items.insert(0, {"type": "SimpleItem", "command": 93, "frame": 2, "params": [5, -1, -1, -1, 0, 0, 0]})
    assert read(small.plan).warnings == ()


def test_refuses_an_empty_route(small):
    small.items.clear()
    assert refusal(small.plan) == "small.plan: nothing is flown (allowed: at least one item that is)"


def test_a_takeoff_above_the_sea_says_where_home_is(small):
    small.items[0]["frame"] = 0
    assert refusal(small.plan) == (
        "small.plan: item 1: take-off to 30 m above the sea, and home is at 100 m (allowed: above home)"
    )


def test_faults_of_the_whole_route_are_told_at_once(small):
    small.items[0]["params"][6] = 0
    small.items.insert(2, {**do_item(177, 1, -1), "doJumpId": 9})
    with pytest.raises(MissionError) as caught:
        read(small.plan)
    assert len(caught.value.faults) == 2


@pytest.mark.parametrize(
    ("command", "name", "counts"),
    [
        (178, "DO_CHANGE_SPEED", "the slower speed for time and energy, the faster one for handovers. A speed without "
         "a condition ends that"),
        (211, "DO_GRIPPER", "the payload stays on board"),
    ],
)  # fmt: skip
def test_what_waits_for_a_condition_is_said(small, command, name, counts):
    small.items[1:1] = [do_item(112, 30), do_item(command, 1, 8)]
    (warning,) = read(small.plan).warnings
    assert warning == (
        f"item 3 ({name}) waits for item 2 (CONDITION_DELAY), and is left out if the next place is reached first. "
        f"The worst case counts: {counts}"
    )
    small.items[1:3] = [do_item(112, 30), small.item(3, 16, 0.0, 10.002, 30), do_item(command, 1, 8)]
    assert read(small.plan).warnings == ()


@pytest.mark.parametrize(("kind", "words"), [(2, "climbs: time and energy are counted at 2.5 m/s"), (3, "descents")])
def test_a_vertical_speed_that_is_not_counted_is_said(small, kind, words):
    small.items.insert(1, do_item(178, kind, 1.5))
    (warning,) = read(small.plan).warnings
    assert warning.startswith(f"item 2 (DO_CHANGE_SPEED) sets the speed of {words}")


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


def numbered(*numbers, command=16):
    """A waypoint file with home and items of these numbers, the last of that command."""
    lines = [f"{number} 0 3 {22 if n == 0 else 16} 0 0 0 0 0 10.002 30 1" for n, number in enumerate(numbers[:-1])]
    return f"QGC WPL 110\n{HOME_LINE}" + "\n".join([*lines, f"{numbers[-1]} 0 3 {command} 1 1 0 0 0 10.003 30 1"])


def test_waypoints_count_by_their_order_as_in_ground_station_programs():
    """MAVProxy, Mission Planner and QGroundControl number them anew."""
    route = read_route("a.waypoints", numbered(1, 2, 2, 12))
    assert [item.seq for item in route.items] == [1, 2, 3, 4]
    assert route.warnings[0] == (
        "line 5 has item number 2 (expected: 3): items count by their order, as in ground station programs. See that "
        "no line is missing, and number them from 0"
    )


def test_waypoints_that_count_well_are_not_told_about():
    assert "item number" not in " ".join(read_route("a.waypoints", numbered(1, 2, 3)).warnings)


def test_refuses_waypoints_out_of_order_if_a_jump_counts_by_their_numbers():
    assert waypoint_refusal(numbered(1, 2, 4, 5, command=177)) == (
        "a.waypoints: line 5: item number is '4', and DO_JUMP counts by it (allowed here: 3, items count up from 0)"
    )


def test_waypoints_that_count_from_one_have_no_home():
    route = read_route("a.waypoints", numbered(1, 2, 3).replace(HOME_LINE, ""))
    assert [(item.seq, item.command) for item in route.items] == [(1, 22), (2, 16), (3, 16)]
    assert route.home == Home(0.0, 10.002, 0.0)
    assert route.warnings[0] == NO_HOME.format("1 (NAV_TAKEOFF)")


def test_refuses_waypoints_that_begin_with_another_number():
    assert waypoint_refusal(numbered(4, 5).replace(HOME_LINE, "")) == (
        "a.waypoints: line 2: item number is '4' (allowed here: 0, home, or 1, the first one flown)"
    )


def test_refuses_an_item_number_that_is_no_number():
    assert waypoint_refusal(numbered(1, "x", 3)) == (
        "a.waypoints: line 4: item number is 'x' (allowed here: 2, items count up from 0)"
    )


def test_refuses_a_field_that_is_no_number():
    assert waypoint_refusal("QGC WPL 110\n" + HOME_LINE + "1 0 3 22 0 0 x 0 0 10 30 1\n") == (
        "a.waypoints: line 3: field 7 is 'x' (allowed: a number)"
    )


def test_refuses_a_field_that_is_infinite():
    assert waypoint_refusal("QGC WPL 110\n" + HOME_LINE + "1 0 3 22 0 0 0 0 0 inf 30 1\n") == (
        "a.waypoints: line 3, item 1: longitude is inf (allowed: a number from -180 to 180)"
    )


def test_a_jump_to_a_tag_is_a_warning_because_arducopter_flies_ahead_first(small):
    small.items[1:1] = [small.item(2, 600, 0, 0, 0, 7), small.item(3, 601, 0, 0, 0, 7)]
    small.items[2]["params"][:2] = [7, 1]
    for number, entry in enumerate(small.items, 1):
        entry["doJumpId"] = number
    assert any(
        text
        == "item 3 is DO_JUMP_TAG: ArduCopter first flies some way towards the item after it, and the walk does not. "
        "Use DO_JUMP where that matters"
        for text in read(small.plan).warnings
    )

# SPDX-License-Identifier: GPL-3.0-or-later

"""What a mission may hold depends on the kind of aircraft: wings do not wait, a copter has none, each is told why."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import groupby

import pytest

from mavproxy_handover.mission import MissionError, MissionItem, difference, load, read_route
from mavproxy_handover.mission.items import COMMANDS
from mavproxy_handover.mission.plan import with_items
from mavproxy_handover.mission.route_simulation import legs_of
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, PROFILES, QUADPLANE
from tests.mission.conftest import PLAN

#: MAV_TYPE of a plan for each kind
MADE_FOR = {COPTER: 2, PLANE: 1, QUADPLANE: 20}


def read(plan, kind):
    plan["mission"]["vehicleType"] = MADE_FOR[kind]
    return read_route("small.plan", json.dumps(plan), kind)


def refusal(plan, kind):
    with pytest.raises(MissionError) as caught:
        read(plan, kind)
    return str(caught.value)


def hovering(small):
    """The small mission for a quadplane."""
    small.items[0]["command"], small.items[2]["command"] = 84, 85
    small.plan["mission"]["vehicleType"] = 20
    small.toml = small.toml.replace("detector", 'aircraft = "quadplane"\ndetector', 1)
    return small


# --- mission.toml ---


def test_a_mission_that_names_no_aircraft_is_for_a_copter(small):
    package = load(small.write())
    assert (package.profile, package.route.profile) == (COPTER, COPTER)


def test_a_mission_says_what_kind_of_aircraft_flies_it(small):
    package = load(hovering(small).write())
    assert (package.profile, package.route.profile) == (QUADPLANE, QUADPLANE)
    assert [item.command for item in package.route.items] == [84, 16, 85]
    assert package.route.warnings == ()
    assert package.cruise_speed_mps == 15.0, "the plan's cruise speed, not its hover speed"


def test_a_kind_that_is_none_is_refused_with_file_key_and_values(small):
    small.toml = small.toml.replace("detector", 'aircraft = "glider"\ndetector', 1)
    with pytest.raises(MissionError) as caught:
        load(small.write())
    assert str(caught.value) == "mission.toml: aircraft is 'glider' (allowed: copter, plane, quadplane)"


# --- items of another kind ---


@pytest.mark.parametrize(
    ("command", "name", "why"),
    [
        (84, "NAV_VTOL_TAKEOFF", "it takes an aircraft that hovers and has wings"),
        (85, "NAV_VTOL_LAND", "it takes an aircraft that hovers and has wings"),
        (3000, "DO_VTOL_TRANSITION", "it takes an aircraft that hovers and has wings"),
        (30, "NAV_CONTINUE_AND_CHANGE_ALT", "ArduCopter passes over it"),
    ],
)
def test_a_copter_has_no_items_of_wings(small, command, name, why):
    small.items[1]["command"] = command
    assert refusal(small.plan, COPTER) == f"small.plan: item 2: {name} is not for a copter: {why}"


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
@pytest.mark.parametrize(
    ("command", "name", "why"),
    [
        (82, "NAV_SPLINE_WAYPOINT", "ArduPlane does not store it"),
        (93, "NAV_DELAY", "ArduPlane does not wait in flight: take NAV_LOITER_TIME"),
        (94, "NAV_PAYLOAD_PLACE", "ArduPlane lands there, and need not go on after it"),
        (115, "CONDITION_YAW", "ArduPlane passes over it"),
        (42600, "DO_WINCH", "ArduPlane passes over it"),
    ],
)
def test_wings_have_no_items_of_a_copter(small, kind, command, name, why):
    small.items[1]["command"] = command
    assert refusal(small.plan, kind) == f"small.plan: item 2: {name} is not for a {kind.name}: {why}"


def wait(number):
    return {"type": "SimpleItem", "command": 93, "frame": 2, "params": [60, -1, -1, -1, 0, 0, 0], "doJumpId": number}


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
def test_wings_wait_on_the_ground(small, kind):
    """ArduPlane waits while it is disarmed: before the take-off, and between a landing and the next take-off."""
    small.items[0]["params"][4:6] = [0.0, 10.002]
    again = [wait(5), small.item(6, 22, 0.0, 10.006, 30), small.item(7, 21, 0.0, 10.009, 0)]
    small.items[:] = [wait(1), *small.items, *again]
    route = read(small.plan, kind)
    assert [item.command for item in route.items] == [93, 22, 16, 21, 93, 22, 21]
    legs = legs_of(route)
    assert {leg.seq for leg in legs} == {2, 3, 4, 6, 7}, "no time in the air"
    assert legs[-1].end == (0.0, 10.009, 0.0)


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
def test_wings_do_not_wait_after_a_take_off(small, kind):
    small.items.insert(1, wait(2))
    assert refusal(small.plan, kind) == (
        f"small.plan: item 2: NAV_DELAY is not for a {kind.name}: ArduPlane does not wait in flight: take "
        "NAV_LOITER_TIME"
    )


def test_a_plane_does_not_take_off_by_hovering(small):
    small.items[0]["command"] = 84
    assert refusal(small.plan, PLANE) == (
        "small.plan: item 1: NAV_VTOL_TAKEOFF is not for a plane: it takes an aircraft that hovers and has wings"
    )


def jump(number, target, times):
    return {"type": "SimpleItem", "command": 177, "frame": 2, "params": [target, times, 0, 0, 0, 0, 0]}


def test_wings_that_circle_without_end_are_a_warning(small):
    hovering(small).items[1]["command"] = 17
    warnings = read(small.plan, QUADPLANE).warnings
    assert warnings[0].startswith("item 2 is NAV_LOITER_UNLIM: the aircraft circles there until told to go on")


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
def test_the_jumps_of_wings_are_walked(small, kind):
    small.items[0]["params"][4:6] = [0.0, 10.002]
    small.items.insert(2, jump(3, 2, 2))
    small.items.insert(2, small.item(3, 16, 0.0, 10.015, 30))
    for number, item in enumerate(small.items, 1):
        item["doJumpId"] = number
    legs = legs_of(read(small.plan, kind))
    assert [seq for seq, _legs in groupby(leg.seq for leg in legs)][:7] == [1, 2, 3, 2, 3, 2, 3]


def test_no_jump_goes_with_a_transition(small):
    """The fault: whether the aircraft hovers was told by the number of the item."""
    small.items.insert(2, jump(3, 2, 1))
    small.items.insert(2, {"type": "SimpleItem", "command": 3000, "frame": 2, "params": [4, 0, 0, 0, 0, 0, 0]})
    assert refusal(small.plan, QUADPLANE) == (
        "small.plan: item 3: DO_VTOL_TRANSITION in a mission with DO_JUMP: whether the aircraft hovers after a jump is "
        "not known"
    )


def test_an_upload_in_flight_is_read_for_the_same_kind(small):
    route = read(small.plan, PLANE)
    delay = MissionItem(1, 93, 2, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(MissionError, match="the upload: item 1: NAV_DELAY is not for a plane"):
        with_items(route, (delay, delay))


# --- numbers that wings do not have ---


@pytest.mark.parametrize(
    ("command", "params", "words"),
    [
        (16, [0, 256, 0], "parameter 2 of NAV_WAYPOINT is 256 (allowed: 0 to 255 m)"),
        (16, [0, 0, -1], "parameter 3 of NAV_WAYPOINT is -1 (allowed: 0 to 255 m)"),
        (18, [0, 0, 80], "parameter 1 of NAV_LOITER_TURNS is 0 (allowed: more than 0, up to 255 turns)"),
        (
            18,
            [1, 0, 3000],
            "parameter 3 of NAV_LOITER_TURNS is 3000 (allowed: a radius up to 2550 m, below 0 to the left",
        ),
        (
            178,
            [1, 20, -1],
            "parameter 1 of DO_CHANGE_SPEED is 1 (allowed: 0, airspeed. 1 would set MIN_GROUNDSPEED, also for later",
        ),
        (178, [0, -2, -1], "parameter 2 of DO_CHANGE_SPEED is -2 (allowed: 1 to 100 m/s)"),
        (3000, [2, 0, 0], "parameter 1 of DO_VTOL_TRANSITION is 2 (allowed: 3 to hover, 4 to fly on its wings)"),
        (85, [2, 0, 0], "parameter 1 of NAV_VTOL_LAND is 2 (allowed: 0, or 1 for a circle down before it)"),
    ],
)
def test_numbers_that_arduplane_takes_for_something_else_are_refused(small, command, params, words):
    hovering(small).items[1]["command"] = command
    small.items[1]["params"][:3] = params
    assert refusal(small.plan, QUADPLANE).startswith(f"small.plan: item 2: {words}")


def test_a_time_to_wait_at_a_waypoint_of_wings_is_a_warning(small):
    small.items[1]["params"][0] = 5
    route = read(small.plan, PLANE)
    assert route.warnings[-1] == (
        "item 2 (NAV_WAYPOINT) has 5 s to wait: ArduPlane flies on at once, as the check counts it. NAV_LOITER_TIME "
        "circles there"
    )
    assert all(leg.hold_s == 0.0 for leg in legs_of(route) if leg.seq == 2)


def test_a_commander_may_send_an_endless_circle_in_flight(small):
    """It ends by the next command; a mission of which it is a part would not."""
    circle = MissionItem(1, 17, 3, 0.0, 0.0, 80.0, 0.0, 0.0, 10.003, 30.0)
    assert with_items(read(small.plan, PLANE), (circle, circle)).items[0].command == 17


def test_hovering_up_to_a_height_above_the_sea_is_refused(small):
    """ArduPlane takes the number for a height above where it stands, whatever the frame."""
    hovering(small).items[0].update(frame=0)
    small.items[0]["params"][6] = 130
    assert refusal(small.plan, QUADPLANE) == (
        "small.plan: item 1: take-off to a height above the sea, which ArduPlane adds to where it stands "
        "(allowed: above home)"
    )


def test_a_plane_takes_off_towards_some_place(small):
    small.items[:] = [small.item(1, 22, 0.0, 0.0, 30), small.item(2, 30, 0.0, 0.0, 60)]
    assert refusal(small.plan, PLANE) == (
        "small.plan: item 1: take-off without a place, and no item after it has one "
        "(allowed: one ahead on the runway, to where it climbs)"
    )


def test_a_take_off_without_a_place_is_towards_the_next_one(small):
    small.items[0]["params"][4:6] = [0, 0]
    assert read(small.plan, PLANE).warnings[0] == (
        "item 1 (NAV_TAKEOFF) has no place: the aircraft climbs ahead in the direction in which it stands. The check "
        "takes that of the next place. Give the item a place ahead on the runway"
    )


def test_a_quadplane_that_ends_in_the_air_is_a_warning(small):
    del hovering(small).items[2]
    assert read(small.plan, QUADPLANE).warnings == (
        "the route ends with NAV_WAYPOINT, not with NAV_VTOL_LAND or NAV_RETURN_TO_LAUNCH",
    )


def test_wings_refuse_a_plan_for_a_multicopter(small):
    with pytest.raises(MissionError) as caught:
        read_route("small.plan", json.dumps(small.plan), PLANE)
    assert caught.value.faults[0] == (
        "small.plan: mission: the plan was made for a multicopter (vehicleType 2), the mission is for a plane: set "
        "aircraft in mission.toml, or make the plan for that vehicle"
    )


# --- the way down of wings ---


def going_down(small, *commands):
    """The small mission with a DO_LAND_START as item 2, and these behind it."""
    small.items[1:] = [small.item(seq, command, 0.0, 10.005, 30) for seq, command in enumerate((189, *commands), 2)]
    return small.plan


def uploaded(plan, kind):
    """The same, sent in flight. Returns why it is refused."""
    route = read(json.loads(json.dumps(PLAN)), kind)
    items = [MissionItem(0, 16, 3, 0, 0, 0, 0, 0.0, 10.0, 0.0)]
    for seq, each in enumerate(plan["mission"]["items"], 1):
        items.append(MissionItem(seq, each["command"], 3, 0, 0, 0, 0, *each["params"][4:]))
    with pytest.raises(MissionError) as caught:
        with_items(route, items)
    return str(caught.value)


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
@pytest.mark.parametrize(
    ("commands", "ends"),
    [
        ((16, 20, 21), "item 4, NAV_RETURN_TO_LAUNCH"),
        ((20,), "item 3, NAV_RETURN_TO_LAUNCH"),
        ((16,), "the end of the mission"),
        ((), "the end of the mission"),
        ((189, 16, 16), "the end of the mission"),
    ],
)
def test_a_landing_sequence_that_comes_to_no_landing_is_refused(small, kind, commands, ends):
    """ArduPlane returns behind the end of a mission, and a return goes to the nearest DO_LAND_START again."""
    landing = "NAV_LAND" if kind is PLANE else "NAV_VTOL_LAND"
    words = (
        f"item 2: DO_LAND_START leads to {ends}, and to no landing before: a return that goes there may never end "
        f"(allowed: {landing} before that)"
    )
    plan = going_down(small, *commands)
    assert refusal(plan, kind) == f"small.plan: {words}"
    assert uploaded(plan, kind) == f"the upload: {words}"


def test_an_endless_circle_in_a_landing_sequence_is_refused_in_flight_too(small):
    assert uploaded(going_down(small, 16, 17, 21), PLANE) == (
        "the upload: item 2: DO_LAND_START leads to item 4, NAV_LOITER_UNLIM, and to no landing before: a return that "
        "goes there may never end (allowed: NAV_LAND before that)"
    )


def test_the_second_of_two_landing_sequences_is_judged_too(small):
    assert refusal(going_down(small, 21, 189, 16), PLANE).startswith(
        "small.plan: item 4: DO_LAND_START leads to the end of the mission, "
    )


def test_landing_sequences_that_land_are_taken(small):
    for commands in ((21,), (16, 189, 16, 21), (16, 21, 189, 16, 21), (16, 21, 20)):
        assert len(read(going_down(small, *commands), PLANE).items) == 2 + len(commands)


def test_a_copter_is_not_asked_where_its_landing_sequence_leads(small):
    assert len(read(going_down(small, 16, 20), COPTER).items) == 4


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
def test_what_a_landing_that_is_broken_off_would_climb_to_is_refused(small, kind):
    """AP_Landing::restart_landing_sequence goes there instead of to the DO_LAND_START."""
    words = (
        "item 5: NAV_CONTINUE_AND_CHANGE_ALT after NAV_LAND: a landing that is broken off would go on there, and not "
        "land (allowed: something else; by itself it goes back to the nearest DO_LAND_START)"
    )
    plan = going_down(small, 16, 21, 30)
    assert refusal(plan, kind) == f"small.plan: {words}"
    assert uploaded(plan, kind) == f"the upload: {words}"
    assert len(read(going_down(small, 30, 21, 16, 30), kind).items) == 6


# --- what ArduPlane stores ---


def item(command, *params):
    return MissionItem(4, command, 3, *params, 52.679, 5.924, 30.0, True)


@pytest.mark.parametrize("kind", [PLANE, QUADPLANE])
def test_of_a_waypoint_arduplane_keeps_how_near_and_how_far_past_it_is_flown(kind):
    sent = item(16, 0.0, 60.7, 40.0, 90.0)
    assert difference(sent, item(16, 0.0, 60.0, 40.0, 0.0), kind) is None
    assert difference(sent, item(16, 0.0, 61.0, 40.0, 0.0), kind) == "item 4: parameter 2 60 came back as 61"
    assert difference(sent, item(16, 0.0, 60.0, 0.0, 0.0), kind) == "item 4: parameter 3 40 came back as 0"


def test_parts_of_a_turn_are_kept_in_parts_of_256():
    sent = item(18, 0.3, 0.0, 80.0, 1.0)
    assert difference(sent, item(18, 76 / 256, 0.0, 80.0, 1.0), PLANE) is None
    assert difference(sent, item(18, 0.0, 0.0, 80.0, 1.0), PLANE) == "item 4: parameter 1 0.296875 came back as 0"


def test_a_wide_circle_is_kept_in_tens_of_metres_and_its_direction():
    sent = item(18, 3.0, 0.0, -307.0, 0.0)
    assert difference(sent, item(18, 3.0, 0.0, -300.0, 0.0), PLANE) is None
    assert difference(sent, item(18, 3.0, 0.0, 300.0, 0.0), PLANE) == ("item 4: parameter 3 -300 came back as 300")
    assert difference(item(18, 3.0, 0.0, 2550.0, 0.0), item(18, 3.0, 0.0, 2550.0, 0.0), PLANE) is None


@pytest.mark.parametrize("command", [84, 85, 3000, 30, 31, 189])
def test_the_items_of_wings_come_back_as_they_are_stored(command):
    """What `mission_cmd_to_mavlink_int` makes of each: parameter 1 of 85, 30, 3000, 2 and 4 of 31, none of the rest."""
    kept = {84: (0, 0, 0, 0), 189: (0, 0, 0, 0), 31: (0, -60, 0, 1)}.get(command, (3, 0, 0, 0))
    back = tuple(float(value) for value in kept)
    sent = replace(item(command, 3.0, -60.0, 7.0, 1.0), frame=3)
    assert (
        difference(sent, replace(sent, param1=back[0], param2=back[1], param3=back[2], param4=back[3]), PLANE) is None
    )


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_each_command_compares_equal_to_itself_for_each_profile(command, profile):
    assert difference(item(command, 1.0, 2.0, 3.0, 4.0), item(command, 1.0, 2.0, 3.0, 4.0), profile) is None
    kept = profile.stores.get(command, COMMANDS[command].kept)
    assert len(kept) == 4
    assert set(kept) <= set("fisbytr-")


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_names_commands_of_missions_alone(profile):
    named = {
        *profile.not_flown,
        *profile.not_in_air,
        *profile.stores,
        *(command for command, _number in profile.item_ranges),
    }
    assert named <= COMMANDS.keys()
    assert all(profile.not_flown.values())

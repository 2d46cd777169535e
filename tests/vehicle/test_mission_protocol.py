# SPDX-License-Identifier: GPL-3.0-or-later

"""A plan on its way to the autopilot: mission, geofence, rally points, cruise speed; written, read back, compared."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import MissionItem, RallyPoint
from mavproxy_handover.mission.plan import FenceCircle, FencePolygon
from mavproxy_handover.vehicle.mission_protocol import fence_items, fence_parts
from mavproxy_handover.vehicle.procedures import Loaded, Plan, Procedures
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import AutopilotError, NoAnswer
from tests.module.vehicle import Autopilot
from tests.vehicle.profiles.test_copter import talk

HOME = MissionItem(0, 16, 0, 0, 0, 0, 0, 52.679, 5.924, 0)
TAKEOFF = MissionItem(1, 22, 3, 0, 0, 0, 0, 52.679, 5.924, 30)
WAYPOINT = MissionItem(2, 16, 3, 2, 0, 0, 0, 52.6795, 5.925, 40)
RALLY = RallyPoint(52.679, 5.923, 30)
SHORT = Plan((HOME, TAKEOFF))
FIELD = FencePolygon(True, ((52.676, 5.919), (52.676, 5.935), (52.683, 5.935), (52.683, 5.919)))
PYLON = FenceCircle(False, 52.678, 5.926, 25.5)
YARD = FencePolygon(False, ((52.68, 5.92), (52.68, 5.921), (52.681, 5.921)))
RANGE = FenceCircle(True, 52.679, 5.924, 2000.0)
MISSION, FENCE, RALLIES = 0, 1, 2


@pytest.fixture
def autopilot() -> Autopilot:
    autopilot = Autopilot()
    autopilot.guard_state = None
    return autopilot


@pytest.fixture
def copter() -> Procedures:
    return Procedures(1, VehicleState())


# ---- mission and rally points -------------------------------------------------------------------------------------


def test_a_plan_is_written_and_read_back(autopilot: Autopilot, copter: Procedures) -> None:
    made = talk(copter.load(Plan((HOME, TAKEOFF, WAYPOINT), (RALLY,), (PYLON,), 10.0)), autopilot)
    assert (made.finished, made.failure) == (True, None)
    sent = [m.get_type() for m in autopilot.received]
    assert sent == [
        "MISSION_COUNT", *["MISSION_ITEM_INT"] * 3,
        "MISSION_COUNT", "MISSION_ITEM_INT",
        "MISSION_COUNT", "MISSION_ITEM_INT",
        "MISSION_REQUEST_LIST", *["MISSION_REQUEST_INT"] * 3,
        "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT",
        "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT",
        *["PARAM_REQUEST_READ"] * 2, *["PARAM_REQUEST_READ"] * 2, "PARAM_SET",  # cruise, and the speed of a return
    ]  # fmt: skip
    assert {(m.target_system, m.target_component) for m in autopilot.received} == {(1, 1)}
    waypoint = autopilot.got("MISSION_ITEM_INT")[2]
    assert (waypoint.seq, waypoint.frame, waypoint.command, waypoint.param1) == (2, 3, 16, 2.0)
    assert (waypoint.x, waypoint.y, waypoint.z, waypoint.autocontinue) == (526795000, 59250000, 40.0, 1)


def test_without_rally_points_those_of_the_last_flight_are_cleared(autopilot: Autopilot, copter: Procedures) -> None:
    autopilot.items[2] = [object()]
    made = talk(copter.load(SHORT), autopilot)
    assert made.failure is None
    assert autopilot.items[2] == []
    (clear,) = autopilot.got("MISSION_CLEAR_ALL")
    assert clear.mission_type == mavlink.MAV_MISSION_TYPE_RALLY


def test_home_is_the_autopilots_own_business(autopilot: Autopilot, copter: Procedures) -> None:
    def spoil(item: Any) -> Any:
        if item.seq == 0 and item.mission_type == 0:
            item.x, item.z = 1, 584.0
        return item

    autopilot.spoil = spoil
    assert talk(copter.load(SHORT), autopilot).failure is None


def test_an_autopilot_that_holds_another_number_of_items_is_not_believed(
    autopilot: Autopilot, copter: Procedures
) -> None:
    autopilot.count_error = 1
    made = talk(copter.load(SHORT), autopilot)
    assert made.failure == "the autopilot holds 3 mission items of 2 written"


def test_an_autopilot_that_asks_for_an_item_that_is_not_there_ends_the_upload(copter: Procedures) -> None:
    conversation = copter.load(SHORT)
    next(conversation)
    with pytest.raises(NoAnswer, match="the autopilot asks for mission item 2 of 2"):
        conversation.send(mavlink.MAVLink_mission_request_int_message(1, 191, 2, 0))


def test_rally_altitudes_may_come_back_in_whole_metres(autopilot: Autopilot, copter: Procedures) -> None:
    def spoil(item: Any) -> Any:
        item.z = float(int(item.z))
        return item

    autopilot.spoil = spoil
    assert talk(copter.load(replace(SHORT, rally=(RallyPoint(52.679, 5.923, 30.9),))), autopilot).failure is None


def test_a_rally_altitude_that_is_another_is_told(autopilot: Autopilot, copter: Procedures) -> None:
    autopilot.spoil = lambda item: setattr(item, "z", 55.0) or item if item.mission_type == 2 else item
    made = talk(copter.load(replace(SHORT, rally=(RALLY,))), autopilot)
    assert made.failure == "rally point 0: altitude 30 m came back as 55 m"


def test_rally_points_that_the_autopilot_refuses_are_told_apart_from_the_mission(
    autopilot: Autopilot, copter: Procedures
) -> None:
    conversation = copter.load(Plan((HOME,), (RALLY,)))
    next(conversation)
    conversation.send(mavlink.MAVLink_mission_ack_message(1, 191, 0, 0))
    with pytest.raises(NoAnswer, match="the autopilot refused the rally points: MAV_MISSION_NO_SPACE"):
        conversation.send(mavlink.MAVLink_mission_ack_message(1, 191, mavlink.MAV_MISSION_NO_SPACE, 2))


def test_items_in_the_other_form_of_the_mission_protocol_are_asked_for_and_sent(copter: Procedures) -> None:
    """Older autopilots ask with MISSION_REQUEST; the answer is the same."""
    conversation = copter.load(SHORT)
    next(conversation)
    ask = conversation.send(mavlink.MAVLink_mission_request_message(1, 191, 1, 0))
    assert ask.messages[0].get_type() == "MISSION_ITEM_INT"
    assert ask.messages[0].seq == 1


# ---- the geofence -------------------------------------------------------------------------------------------------


def test_a_geofence_is_an_item_a_corner_or_a_circle() -> None:
    items = [(i.seq, i.command, i.frame, i.param1, i.lat_deg, i.lon_deg) for i in fence_items((YARD, RANGE, PYLON))]
    assert items == [
        (0, 5002, 0, 3.0, 52.68, 5.92),
        (1, 5002, 0, 3.0, 52.68, 5.921),
        (2, 5002, 0, 3.0, 52.681, 5.921),
        (3, 5003, 0, 2000.0, 52.679, 5.924),
        (4, 5004, 0, 25.5, 52.678, 5.926),
    ]
    assert {item.command for item in fence_items((FIELD,))} == {5001}


def test_items_of_a_fence_are_the_fence_again() -> None:
    """Two polygons of one kind stand next to each other: only the number of corners tells where the second begins."""
    twice = FencePolygon(False, ((52.67, 5.91), (52.67, 5.92), (52.675, 5.92), (52.675, 5.91)))
    parts = (FIELD, YARD, twice, RANGE, PYLON)
    assert fence_parts(fence_items(parts)) == parts


def test_a_point_to_return_to_is_no_part_of_a_fence() -> None:
    home = MissionItem(0, 5000, 0, 0, 0, 0, 0, 52.679, 5.924, 0)
    assert fence_parts((home, *fence_items((PYLON,)))) == (PYLON,)


@pytest.mark.parametrize("corners", [math.nan, 5.0, 2.0, 0.0])
def test_a_polygon_that_is_not_whole_is_no_fence(corners: float) -> None:
    items = tuple(replace(item, param1=corners) for item in fence_items((YARD,)))
    with pytest.raises(AutopilotError, match="a geofence with an incomplete polygon"):
        fence_parts(items)


@pytest.mark.parametrize("radius_m", [math.nan, 0.0, -3.0])
def test_a_circle_without_a_radius_is_no_fence(radius_m: float) -> None:
    with pytest.raises(AutopilotError, match="a geofence with a circle of"):
        fence_parts([replace(fence_items((PYLON,))[0], param1=radius_m)])


def test_the_fence_of_a_plan_takes_the_place_of_another_one(autopilot: Autopilot, copter: Procedures) -> None:
    autopilot.items[FENCE] = [object()]
    made = talk(copter.load(replace(SHORT, fence=(FIELD, PYLON), cruise_mps=10.0)), autopilot)
    assert (made.failure, made.result) == (None, Loaded((FIELD, PYLON), 10.0))
    assert [(m.command, m.param1, m.x, m.y, m.mission_type) for m in autopilot.items[FENCE]] == [
        (5001, 4.0, 526760000, 59190000, FENCE),
        (5001, 4.0, 526760000, 59350000, FENCE),
        (5001, 4.0, 526830000, 59350000, FENCE),
        (5001, 4.0, 526830000, 59190000, FENCE),
        (5004, 25.5, 526780000, 59260000, FENCE),
    ]


def test_a_plan_without_a_fence_leaves_the_vehicle_s_own_and_tells_of_it(
    autopilot: Autopilot, copter: Procedures
) -> None:
    assert talk(copter.load(replace(SHORT, fence=(FIELD,))), autopilot).failure is None
    autopilot.received.clear()
    made = talk(copter.load(SHORT), autopilot)
    assert (made.failure, made.result.fence) == (None, (FIELD,))
    assert [m for m in autopilot.got("MISSION_CLEAR_ALL") if m.mission_type == FENCE] == []
    assert [m for m in autopilot.got("MISSION_COUNT") if m.mission_type == FENCE] == []


def test_an_autopilot_that_knows_no_geofences_takes_a_plan_without_one(
    autopilot: Autopilot, copter: Procedures
) -> None:
    original = autopilot._take

    def take(m: Any) -> None:
        if getattr(m, "mission_type", None) == FENCE:
            autopilot.say(stock.MAVLink_mission_ack_message(1, 191, mavlink.MAV_MISSION_UNSUPPORTED, FENCE))
        else:
            original(m)

    autopilot._take = take  # type: ignore[method-assign]
    made = talk(copter.load(SHORT), autopilot)
    assert (made.failure, made.result) == (None, Loaded((), 10.0))
    made = talk(copter.load(replace(SHORT, fence=(PYLON,))), autopilot)
    assert made.failure == "the autopilot refused the geofence: MAV_MISSION_UNSUPPORTED"


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("command", 5003, "geofence item 0: command 5004 came back as 5003"),
        ("param1", 26.5, "geofence item 0: 25.5 corners or metres came back as 26.5"),
        ("param1", math.nan, "geofence item 0: 25.5 corners or metres came back as nan"),
        ("x", 526780003, "geofence item 0 came back at 52.6780003 5.9260000"),
        ("y", 59260003, "geofence item 0 came back at 52.6780000 5.9260003"),
    ],
)
def test_a_fence_that_comes_back_as_another_is_not_loaded(
    autopilot: Autopilot, copter: Procedures, field: str, value: float, text: str
) -> None:
    autopilot.spoil = lambda item: setattr(item, field, value) or item if item.mission_type == FENCE else item
    assert talk(copter.load(replace(SHORT, fence=(PYLON,))), autopilot).failure == text


# ---- the cruise speed ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "before", "after"),
    [(("WPNAV_SPEED", "RTL_SPEED"), 1000.0, 650.0), (("WP_SPD", "RTL_SPEED_MS"), 10.0, 6.5)],
    ids=["up to 4.6, in cm/s", "from 4.7, in m/s"],
)
def test_the_cruise_speed_becomes_the_autopilot_s_own(
    autopilot: Autopilot, copter: Procedures, names: tuple[str, str], before: float, after: float
) -> None:
    """And so does the speed of a return, which was 0."""
    autopilot.parameters = {names[0]: before, names[1]: 0.0}
    made = talk(copter.load(replace(SHORT, cruise_mps=6.5)), autopilot)
    assert (made.failure, made.result.cruise_mps) == (None, 6.5)
    assert autopilot.parameters == dict.fromkeys(names, after)


def test_a_speed_that_the_autopilot_has_already_is_not_written(autopilot: Autopilot, copter: Procedures) -> None:
    autopilot.parameters = {"WPNAV_SPEED": 1000.0, "RTL_SPEED": 1000.0}
    assert talk(copter.load(replace(SHORT, cruise_mps=10.0)), autopilot).failure is None
    assert autopilot.got("PARAM_SET") == []


def test_a_plan_that_names_no_speed_is_flown_at_the_vehicle_s_own(autopilot: Autopilot, copter: Procedures) -> None:
    autopilot.parameters = {"WPNAV_SPEED": 500.0}
    made = talk(copter.load(SHORT), autopilot)
    assert (made.failure, made.result.cruise_mps) == (None, 5.0)
    assert (autopilot.parameters, autopilot.got("PARAM_SET")) == ({"WPNAV_SPEED": 500.0}, [])


def test_a_speed_that_the_autopilot_does_not_take_is_a_plan_that_is_not_loaded(
    autopilot: Autopilot, copter: Procedures
) -> None:
    autopilot.fixed.add("WPNAV_SPEED")
    made = talk(copter.load(replace(SHORT, cruise_mps=6.5)), autopilot)
    assert made.failure == "the autopilot does not take WPNAV_SPEED 650, the mission's cruise speed"


def test_nor_is_one_whose_speed_of_a_return_it_does_not_take(autopilot: Autopilot, copter: Procedures) -> None:
    autopilot.fixed.add("RTL_SPEED")
    made = talk(copter.load(replace(SHORT, cruise_mps=6.5)), autopilot)
    assert made.failure == "the autopilot does not take RTL_SPEED 650, the speed of a return"


@pytest.mark.parametrize("parameters", [{}, {"WPNAV_SPEED": math.nan}, {"WPNAV_SPEED": 0.0}, {"WP_SPD": math.inf}])
def test_an_autopilot_without_a_speed_takes_no_plan(
    autopilot: Autopilot, copter: Procedures, parameters: dict[str, float]
) -> None:
    autopilot.parameters = parameters
    made = talk(copter.load(SHORT), autopilot)
    assert made.failure == "no answer to WPNAV_SPEED or WP_SPD"

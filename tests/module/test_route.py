# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check in the companion: seen in flight, journalled, shown, and told to the stations once. The mission's
speed when the aircraft comes back to it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.vehicle import AUTO, GUIDED, HOME

START = mavlink.MAV_CMD_MISSION_START
#: waypoint 2 of `delivery`, 70 m east and 95 m south of home
SECOND = (52.678146, 5.925035)


def beside(part: float, across_m: float) -> tuple[float, float]:
    """A place along the leg to waypoint 2, and so far to its right."""
    lat, lon = (a + part * (b - a) for a, b in zip(HOME, SECOND, strict=True))
    return offset(lat, lon, -0.805 * across_m, -0.593 * across_m)


def take_off(bench: Bench, delivery: MissionPackage) -> Bench:
    """Off the ground, and on the way to waypoint 2."""
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(2.0)
    bench.a.command(START)
    bench.autopilot.waypoint = 1
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.wait(2.0)
    bench.autopilot.waypoint = 2
    bench.run(1.0)
    return bench


@pytest.fixture
def flown(bench: Bench, delivery: MissionPackage) -> Bench:
    return take_off(bench, delivery)


def told(bench: Bench) -> list[tuple[str, str]]:
    return [(e["event"], e["text"]) for e in bench.journal() if e["event"] in ("off_route", "on_route")]


OFF = "off route: 41 m right of the leg to waypoint 2"
#: as a decision
TOLD = "WARNING. Off route: 41 m right of the leg to waypoint 2"


def test_a_deviation_is_told_once_to_everybody_and_so_is_its_end(flown: Bench) -> None:
    flown.autopilot.position = beside(0.5, 41.0)
    flown.run(2.5)
    assert told(flown) == []
    flown.wait(20.0)
    assert told(flown) == [("off_route", OFF)]
    (entry,) = flown.journal("off_route")
    assert (entry["waypoint"], entry["cross_track_m"], entry.get("course_off_deg")) == (
        2,
        pytest.approx(41, abs=0.2),
        None,
    )
    assert flown.mpstate.console.said("WARNING. Off route: 41 m right of the leg to waypoint 2.")
    assert flown.a.texts().count(TOLD) == 1
    assert flown.b.texts().count(TOLD) == 1
    route = flown.companion.autopilot.route
    assert route.deviation == route.track
    flown.mpstate.type("handover status")
    assert "route     41 m right of the leg to waypoint 2, OFF ROUTE" in flown.mpstate.console.lines
    flown.autopilot.position = beside(0.5, 2.0)
    flown.wait(10.0)
    back = "on the route again: 2 m right of the leg to waypoint 2"
    assert told(flown) == [("off_route", OFF), ("on_route", back)]
    assert flown.a.texts().count("ALL CLEAR. Over: off route") == 1
    assert route.deviation is None


def test_the_limits_are_the_configuration_s(bench: Bench, delivery: MissionPackage) -> None:
    bench.config.write_text(bench.config.read_text() + "\n[route]\noff_route_m = 50\n")
    assert bench.load() is not None
    assert bench.companion.config.route.off_route_m == 50.0
    take_off(bench, delivery)
    bench.autopilot.position = beside(0.5, 41.0)
    bench.wait(20.0)
    assert told(bench) == []


def test_in_another_mode_there_is_no_route(flown: Bench) -> None:
    flown.autopilot.mode = GUIDED
    flown.run(1.5)
    flown.autopilot.position = beside(0.5, 41.0)
    flown.wait(20.0)
    assert told(flown) == []
    assert flown.companion.autopilot.route.track is None
    flown.autopilot.mode = AUTO  # from here it flies straight to its waypoint
    flown.wait(20.0)
    assert told(flown) == []


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_mission_count_message(1, 1, 3, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 2, 3, 0),
    ],
    ids=["upload", "clear", "partial"],
)
def test_an_upload_that_has_only_begun_changes_no_route(flown: Bench, message: Any) -> None:
    flown.a.send(message)
    flown.run(0.5)
    flown.autopilot.position = beside(0.5, 41.0)
    flown.wait(5.0)
    assert [event for event, _text in told(flown)] == ["off_route"]


def test_a_file_that_is_no_mission_leaves_the_route_known(flown: Bench) -> None:
    """The fault: any file that was opened for writing ended the watch over the route."""
    create = list((bytes([0, 0, 0, 6, 4]) + bytes(7) + b"/APM/a.txt").ljust(251, b"\0"))
    flown.a.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, create))
    flown.run(0.5)
    assert len(flown.autopilot.got("FILE_TRANSFER_PROTOCOL")) == 1, "it passes in flight"
    flown.autopilot.position = beside(0.5, 41.0)
    flown.wait(20.0)
    assert [event for event, _text in told(flown)] == ["off_route"]


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_mission_count_message(1, 1, 3, 2),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 1),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 255),
    ],
    ids=["rally points", "fence", "all, which the companion does not pass on"],
)
def test_other_lists_are_no_mission(flown: Bench, message: Any) -> None:
    flown.a.send(message)
    flown.run(0.5)
    flown.autopilot.position = beside(0.5, 41.0)
    flown.wait(20.0)
    assert told(flown) == [("off_route", OFF)]


def test_an_item_that_is_not_told_any_more_is_none_to_be_off(flown: Bench) -> None:
    """The stream of MISSION_CURRENT has stopped: it flies on, 60 m behind what was waypoint 2."""
    flown.autopilot.waypoint = None
    flown.wait(4.0)
    flown.autopilot.position = beside(1.5, 0.0)
    flown.wait(20.0)
    assert told(flown) == []


def test_a_check_that_breaks_leaves_the_zones_alone(flown: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    route = flown.companion.autopilot.route
    monkeypatch.setattr(route, "update", lambda _state, _now: 1 / 0)
    flown.autopilot.position = (52.678146, 5.95)  # east of every zone
    flown.wait(5.0)
    assert flown.companion.faults["route"] > 0
    assert [entry["reason"] for entry in flown.journal("emergency")] == ["out_of_coverage"]


# ---- the mission's speed ------------------------------------------------------------------------------------------

CHANGE_SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED


def with_slow_end(delivery: MissionPackage) -> MissionPackage:
    """`delivery`, with a change to 6 m/s behind waypoint 2: the items behind are one number higher."""
    files = {name: text.decode() for name, text in delivery.files.items()}
    plan = json.loads(files["delivery.plan"])
    items = plan["mission"]["items"]
    items.insert(2, {**items[2], "command": CHANGE_SPEED, "frame": 2, "params": [1, 6, -1, 0, 0, 0, 0]})
    files["delivery.plan"] = json.dumps(plan)
    changed = replace(delivery, files={name: text.encode() for name, text in files.items()})
    return mission_package.from_bytes(changed.to_bytes())


def speeds(bench: Bench) -> list[tuple[float, float]]:
    return [(m.param1, m.param2) for m in bench.autopilot.got("COMMAND_LONG", 1) if m.command == CHANGE_SPEED]


def leave_and_come_back(bench: Bench, waypoint: int) -> None:
    bench.autopilot.waypoint = waypoint
    bench.wait(1.5)
    bench.autopilot.mode = GUIDED
    bench.wait(3.0)
    bench.autopilot.mode = AUTO
    bench.wait(3.0)


def test_back_in_auto_the_speed_is_what_the_mission_had_set_by_then(bench: Bench, delivery: MissionPackage) -> None:
    take_off(bench, with_slow_end(delivery))
    bench.run(2.0)
    assert speeds(bench) == []
    leave_and_come_back(bench, 2)
    assert speeds(bench) == [], "before the item that changes it the cruise speed holds"
    leave_and_come_back(bench, 5)
    assert speeds(bench) == [(1.0, 6.0)]
    (entry,) = bench.journal("speed")
    assert (entry["text"], entry["obeyed"]) == ("mission speed restored: 6 m/s", True)


def test_a_speed_that_is_refused_is_told(bench: Bench, delivery: MissionPackage) -> None:
    take_off(bench, with_slow_end(delivery))
    bench.autopilot.script[CHANGE_SPEED] = mavlink.MAV_RESULT_FAILED
    leave_and_come_back(bench, 5)
    assert [e["text"] for e in bench.journal("speed")] == ["speed 6 m/s refused (MAV_RESULT_FAILED)"]


def test_who_leaves_auto_meanwhile_is_not_told_a_speed_any_more(bench: Bench, delivery: MissionPackage) -> None:
    take_off(bench, with_slow_end(delivery))
    bench.autopilot.script[CHANGE_SPEED] = None
    leave_and_come_back(bench, 5)
    asked = len(speeds(bench))
    assert asked > 1
    bench.autopilot.mode = GUIDED
    bench.run(1.5)
    asked = len(speeds(bench))
    bench.wait(5.0)
    assert len(speeds(bench)) == asked


def test_a_mission_without_a_change_of_speed_is_left_alone(flown: Bench) -> None:
    leave_and_come_back(flown, 5)
    assert speeds(flown) == []

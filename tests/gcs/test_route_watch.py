# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check at a station: what it goes by, and what its operator is told."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.events import Notice
from gcs_module.route_watch import StationRouteWatch
from mavproxy_handover.core.safety.route import RouteLimits
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.package import MissionPackage, load
from tests.packages import ROUND

#: home of `delivery`, and its waypoint 2, to the south-east
HOME, SECOND = (52.679, 5.924), (52.678146, 5.925035)
AUTO, GUIDED = 3, 4
OFF = Notice("off_route", "Off route: 41 m left of the leg to waypoint 2, as this station sees it.")


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return load(ROUND)


def beside(part: float, left_m: float) -> tuple[float, float]:
    """A place along the leg to waypoint 2, and so far to its left."""
    lat, lon = (a + part * (b - a) for a, b in zip(HOME, SECOND, strict=True))
    return offset(lat, lon, 0.805 * left_m, 0.593 * left_m)


def telemetry(place: tuple[float, float], waypoint: int, mode: int = AUTO, armed: int = 1) -> Any:
    lat, lon = (round(value * 1e7) for value in place)
    return mavlink.MAVLink_handover_telemetry_message(
        251, 190, 0, 0, 12600, 90, lat, lon, 30000, 30000, 0, 0, 0, 0.0, 0.0, 0.0, 0, 0.0, waypoint, math.nan, 251,
        armed, mode,
    )  # fmt: skip


def position(place: tuple[float, float]) -> Any:
    lat, lon = (round(value * 1e7) for value in place)
    return mavlink.MAVLink_global_position_int_message(0, lat, lon, 0, 30000, 0, 0, 0, 0)


def heartbeat(mode: int, armed: bool = True) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 3, 1 | (128 if armed else 0), mode, 4, 3)


class Watch:
    """A station on the way of the aircraft from take-off to waypoint 2."""

    def __init__(self, package: MissionPackage | None, hold_s: float = 3.0) -> None:
        self.watch = StationRouteWatch(RouteLimits(off_hold_s=hold_s))
        self.watch.compare_to(package)
        self.now = 100.0
        self.told: list[Notice] = []

    def telemetry(self, message: Any, times: int = 1) -> None:
        for _ in range(times):
            self.now += 1.0
            notice = self.watch.on_telemetry(message, self.now)
            self.told += [] if notice is None else [notice]

    def autopilot(self, message: Any, times: int = 1, every_s: float = 0.25) -> None:
        for _ in range(times):
            self.now += every_s
            notice = self.watch.on_autopilot(message, self.now)
            self.told += [] if notice is None else [notice]

    def stream(self, waypoint: int, place: tuple[float, float], seconds: int) -> None:
        """What the autopilot says by itself."""
        for _ in range(seconds):
            self.autopilot(heartbeat(AUTO), every_s=0.0)
            self.autopilot(mavlink.MAVLink_mission_current_message(waypoint), every_s=0.0)
            self.autopilot(position(place), 4)


def test_the_operator_is_warned_once_and_told_of_the_end(delivery: MissionPackage) -> None:
    station = Watch(delivery)
    station.telemetry(telemetry(HOME, 1), 3)
    station.telemetry(telemetry(beside(0.4, 0.0), 2), 3)
    assert station.told == []
    station.telemetry(telemetry(beside(0.5, 41.0), 2), 30)
    assert station.told == [OFF]
    station.telemetry(telemetry(beside(0.6, 0.0), 2), 10)
    back = Notice("on_route", "On the route again: on the leg to waypoint 2, as this station sees it.")
    assert station.told == [OFF, back]


@pytest.mark.parametrize(("mode", "armed"), [(GUIDED, 1), (6, 1), (AUTO, 0)])
def test_elsewhere_than_in_auto_there_is_no_route(delivery: MissionPackage, mode: int, armed: int) -> None:
    station = Watch(delivery)
    station.telemetry(telemetry(HOME, 1), 3)
    station.telemetry(telemetry(beside(0.5, 41.0), 2, mode, armed), 30)
    assert station.told == []


def test_a_station_that_does_not_hold_the_mission_checks_nothing(delivery: MissionPackage) -> None:
    station = Watch(None)
    station.telemetry(telemetry(HOME, 1), 3)
    station.telemetry(telemetry(beside(0.5, 41.0), 2), 30)
    assert (station.told, station.watch.track) == ([], None)
    station.watch.compare_to(delivery)  # in flight: the leg begins where the aircraft is then
    station.telemetry(telemetry(beside(0.5, 41.0), 2), 30)
    assert station.told == []
    assert station.watch.track is not None


def test_the_same_package_again_changes_nothing(delivery: MissionPackage) -> None:
    station = Watch(delivery)
    station.telemetry(telemetry(HOME, 1), 3)
    station.telemetry(telemetry(beside(0.5, 41.0), 2), 2)
    station.watch.compare_to(delivery)
    station.telemetry(telemetry(beside(0.5, 41.0), 2), 2)
    assert station.told == [OFF]


def test_who_is_sent_no_telemetry_goes_by_the_autopilot_s_words(delivery: MissionPackage) -> None:
    station = Watch(delivery)
    station.autopilot(heartbeat(AUTO))
    station.autopilot(mavlink.MAVLink_mission_current_message(1))
    station.autopilot(position(HOME), 8)
    station.stream(2, beside(0.5, 41.0), 10)
    assert station.told == [OFF]
    station.autopilot(heartbeat(GUIDED))
    station.autopilot(position(beside(0.5, 41.0)), 4)
    assert [notice.event for notice in station.told] == ["off_route", "on_route"]


def test_before_anything_is_known_of_the_mission_a_position_says_nothing(delivery: MissionPackage) -> None:
    station = Watch(delivery)
    station.autopilot(heartbeat(AUTO))
    station.autopilot(position(beside(0.5, 41.0)), 60)
    station.autopilot(mavlink.MAVLink_mission_current_message(2))
    station.autopilot(position((0.0, 0.0)), 60)
    assert (station.told, station.watch.track) == ([], None)


@pytest.mark.parametrize("silent", ["mission", "mode"])
def test_what_is_heard_no_more_is_no_evidence(delivery: MissionPackage, silent: str) -> None:
    """An observer gets positions always, and the item that is flown only while somebody makes it be sent."""
    station = Watch(delivery)
    station.autopilot(heartbeat(AUTO))
    station.autopilot(mavlink.MAVLink_mission_current_message(1))
    station.autopilot(position(HOME), 4)
    station.autopilot(mavlink.MAVLink_mission_current_message(2))
    for _ in range(20):
        if silent == "mission":
            station.autopilot(heartbeat(AUTO))
        else:
            station.autopilot(mavlink.MAVLink_mission_current_message(2))
        station.autopilot(position(beside(1.0 if station.now < 104 else 2.5, 0.0)), 4)
    assert station.told == []


def test_where_the_aircraft_was_on_its_leg_is_not_shown_for_long(delivery: MissionPackage) -> None:
    station = Watch(delivery)
    station.telemetry(telemetry(HOME, 1), 3)
    station.telemetry(telemetry(beside(0.4, 2.0), 2))
    assert station.watch.words(station.now + 4.0) == "2 m left of the leg to waypoint 2"
    assert station.watch.words(station.now + 6.0) == ""
    station.telemetry(telemetry(beside(0.5, 41.0), 2), 6)
    assert station.watch.words(station.now) == "41 m left of the leg to waypoint 2, OFF ROUTE"


def test_telemetry_goes_before_what_the_autopilot_is_heard_to_say(delivery: MissionPackage) -> None:
    station = Watch(delivery, hold_s=0.5)
    station.telemetry(telemetry(HOME, 1), 3)
    for _ in range(20):
        station.telemetry(telemetry(beside(0.5, 2.0), 2))
        station.stream(2, beside(0.5, 41.0), 1)
    assert station.told == []
    station.stream(2, beside(0.5, 41.0), 10)  # and when it stops, they count
    assert station.told == [OFF]

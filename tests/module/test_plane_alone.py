# SPDX-License-Identifier: GPL-3.0-or-later

"""A plane without rotors, through the whole module: what its mission has to be, what its commander may make of it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.package import load
from tests.module.conftest import Bench
from tests.module.test_flight_uploads import Program, held
from tests.module.vehicle import Autopilot, PlaneAutopilot
from tests.packages import MISSIONS

START = mavlink.MAV_CMD_MISSION_START
ACCEPTED, DENIED = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_DENIED
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
WAYPOINT, UNLIM, LAND, LAND_START = 16, 17, 21, 189


@pytest.fixture
def flight(bench: Bench) -> Bench:
    """On the mission `dike`, which ends in a landing sequence, on its way to item 2."""
    ready(bench, "dike", plane)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.autopilot.waypoint, bench.autopilot.position = 2, (52.70, 5.42)
    bench.wait(2.0)
    bench.a.received.clear()
    return bench


def plane() -> Autopilot:
    autopilot = PlaneAutopilot(rotors=False)
    autopilot.parameters |= {"RTL_AUTOLAND": 1.0, "ARMING_REQUIRE": 1.0, "Q_ENABLE": 0.0, "AIRSPEED_MIN": 9.0}
    return autopilot


def quadplane() -> Autopilot:
    autopilot = PlaneAutopilot(rotors=True)
    autopilot.parameters |= {"Q_RTL_MODE": 1.0, "ARMING_REQUIRE": 1.0, "AIRSPEED_MIN": 9.0}
    return autopilot


def ready(bench: Bench, mission: str, autopilot: Callable[[], Autopilot]) -> None:
    package = load(MISSIONS / mission)
    bench.autopilot = autopilot()
    bench.autopilot.position = package.route.home.lat_deg, package.route.home.lon_deg
    bench.connect()
    bench.share(package, at_once=True)
    bench.wait(12.0)


def to(seq: int, command: int, lat: float, lon: float, alt: float) -> MissionItem:
    return MissionItem(seq, command, 3, 0.0, 0.0, 0.0, 0.0, lat, lon, alt)


HOME, AWAY = to(0, WAYPOINT, 52.69, 5.42, 0.0), to(1, WAYPOINT, 52.703, 5.42, 100.0)
DOWN = (
    to(2, LAND_START, 52.678, 5.402, 80.0),
    to(3, WAYPOINT, 52.6747, 5.41, 60.0),
    to(4, LAND, 52.69, 5.42, 0.0),
)


@pytest.mark.parametrize(
    "items",
    [
        (HOME, AWAY, to(2, WAYPOINT, 52.705, 5.421, 100.0)),
        (HOME, AWAY, to(2, UNLIM, 52.705, 5.421, 100.0)),
        (HOME, AWAY, to(2, LAND, 52.69, 5.42, 0.0)),
    ],
    ids=["waypoints", "circle", "landing that no return leads to"],
)
def test_a_mission_that_would_leave_its_return_circling_is_refused(
    flight: Bench, items: tuple[MissionItem, ...]
) -> None:
    """The fault: it was taken in silence, and the return behind it never came down."""
    before = held(flight)
    assert Program(flight, items).send() == DENIED
    why = "a return would not land: it would circle for ever: the mission has no landing sequence (DO_LAND_START)"
    assert why in flight.a.texts()
    assert held(flight) == before


def test_one_with_a_landing_sequence_is_taken(flight: Bench) -> None:
    assert Program(flight, (HOME, AWAY, *DOWN)).send() == ACCEPTED
    flight.autopilot.waypoint = 1
    flight.run(1.2)
    assert flight.companion.autopilot.aircraft.ways_down.may_be is False
    flight.autopilot.waypoint = 3
    flight.run(1.2)
    assert flight.companion.autopilot.aircraft.ways_down.may_be is True


@pytest.mark.parametrize(
    ("mission", "autopilot", "why"),
    [
        ("dike", Autopilot, "the mission is for a plane, and this is a copter"),
        ("dike", quadplane, "the mission is for a plane, and this is a quadplane"),
        ("delivery", quadplane, "the mission is for a copter, and this is a quadplane"),
        ("delivery", plane, "the mission is for a copter, and this is a plane"),
    ],
)
def test_what_was_checked_for_another_aircraft_is_not_flown(
    bench: Bench, mission: str, autopilot: Callable[[], Autopilot], why: str
) -> None:
    """The fault: turns, energy and circles were those of another one, and it took off."""
    ready(bench, mission, autopilot)
    bench.a.command(START)
    bench.wait(3.0)
    assert bench.a.acks(START) == [REJECTED]
    assert why in bench.a.texts()
    assert bench.companion.view.phase is Phase.ON_LOAD

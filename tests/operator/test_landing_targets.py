# SPDX-License-Identifier: GPL-3.0-or-later

"""LANDING_TARGET in a landing: what corrects it passes, what leads it away or keeps it from ending does not."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import GateReason
from mavproxy_handover.operator.onboard.landing_targets import LandingTargets
from mavproxy_handover.vehicle.state import VehicleState
from tests.gate.frames import make_frame

ALLOWED, AWAY, HELD = GateReason.ALLOWED, GateReason.LANDING_AWAY, GateReason.LANDING_HELD
RTL, LAND, AUTO = 6, 9, 3
IN_AIR, LANDING = mavlink.MAV_LANDED_STATE_IN_AIR, mavlink.MAV_LANDED_STATE_LANDING
SITE = (47.0, 8.0)
METRE = 1.0 / 111_190.0


class Aircraft:
    """One that says where it is, what it flies and whether it lands."""

    def __init__(self) -> None:
        self.state = VehicleState()
        self.targets = LandingTargets(self.state)
        self.now = 100.0
        self.flies(RTL)
        self.lands()
        self.at()

    def flies(self, mode: int, armed: bool = True) -> None:
        flags = 128 if armed else 0
        self.state.on_message(mavlink.MAVLink_heartbeat_message(2, 3, flags | 1, mode, 4, 3), self.now)

    def lands(self, state: int = LANDING) -> None:
        self.state.on_message(mavlink.MAVLink_extended_sys_state_message(0, state), self.now)

    def at(self, north_m: float = 0.0, height_m: float = 20.0, speed_mps: float = 0.0, sinks_mps: float = 1.0) -> None:
        lat, mm, cms = round((SITE[0] + north_m * METRE) * 1e7), round(height_m * 1000), (100 * speed_mps, 0)
        place = (lat, round(SITE[1] * 1e7), 400_000 + mm, mm)
        said = mavlink.MAVLink_global_position_int_message(0, *place, *map(round, cms), round(sinks_mps * 100), 0)
        self.state.on_message(said, self.now)

    def judge(self, **fields: Any) -> GateReason:
        self.now += 0.05
        return self.targets.judge(make_frame("LANDING_TARGET", sysid=1, compid=25, **fields), 10.0, self.now)


def test_a_target_below_passes_all_the_way_down() -> None:
    aircraft = Aircraft()
    for step in range(400):
        aircraft.at(north_m=step / 200, height_m=20 - step / 20)
        assert aircraft.judge(angle_x=0.1, angle_y=-0.1, distance=20.0 - step / 20) is ALLOWED


def test_a_landing_is_led_no_farther_than_the_limit() -> None:
    aircraft = Aircraft()
    assert aircraft.judge(angle_x=0.7, distance=3.0) is ALLOWED, "2 m beside it: as an honest one"
    aircraft.at(north_m=9.5, speed_mps=3.0)
    assert aircraft.judge(angle_x=0.7, distance=3.0) is ALLOWED
    aircraft.at(north_m=10.5, speed_mps=3.0)
    assert aircraft.judge(angle_x=0.7, distance=3.0) is AWAY


@pytest.mark.parametrize(
    ("fields", "verdict"),
    [
        ({"position_valid": 1, "x": 14.0, "y": -14.0}, ALLOWED),
        ({"position_valid": 1, "x": 15.0, "y": -14.0}, AWAY),
        ({"position_valid": 1, "x": math.nan}, AWAY),
        ({"angle_x": 0.5, "distance": 40.0}, ALLOWED),
        ({"angle_x": 0.6, "distance": 40.0}, AWAY),
        ({"angle_x": 0.77}, ALLOWED),
        ({"angle_x": 0.80}, AWAY),
        ({"angle_y": 1.5, "distance": 1.0}, AWAY),
        ({"angle_y": math.nan}, AWAY),
        ({"angle_x": 0.5, "distance": math.inf}, AWAY),
        ({"angle_x": 0.1, "distance": math.nan}, ALLOWED),
    ],
)
def test_a_target_far_from_the_aircraft_does_not_pass(fields: dict[str, Any], verdict: GateReason) -> None:
    """At 20 m height, with a limit of 10 m: 20 m over ground. Without a distance the height counts."""
    assert Aircraft().judge(**fields) is verdict


def test_an_aircraft_that_stands_is_let_down() -> None:
    """On the ground a lying target keeps it armed; in the air one that is too far away keeps it up."""
    aircraft = Aircraft()
    aircraft.at(sinks_mps=0.0)
    verdicts = [aircraft.judge(angle_x=0.1, distance=3.0) for _frame in range(200)]
    assert verdicts == [ALLOWED] * 101 + [HELD] * 99, "5 s at 20 a second"
    aircraft.at(sinks_mps=0.5)
    assert aircraft.judge(angle_x=0.1, distance=3.0) is ALLOWED, "it comes down again"


def test_a_slow_descent_is_no_standing() -> None:
    """ArduCopter came down the last two metres at 0.15 m/s."""
    aircraft = Aircraft()
    aircraft.at(height_m=1.5, sinks_mps=0.1)
    assert {aircraft.judge(angle_x=0.1, distance=1.5) for _frame in range(300)} == {ALLOWED}


@pytest.mark.parametrize(("mode", "state"), [(RTL, IN_AIR), (AUTO, IN_AIR)])
def test_before_the_landing_every_target_passes(mode: int, state: int) -> None:
    aircraft = Aircraft()
    aircraft.flies(mode)
    aircraft.lands(state)
    aircraft.at(sinks_mps=0.0)
    assert {aircraft.judge(position_valid=1, x=500.0) for _frame in range(300)} == {ALLOWED}
    aircraft.at(north_m=300.0)
    aircraft.lands()
    assert aircraft.judge(angle_x=0.1) is ALLOWED, "the landing begins here"
    aircraft.at(north_m=311.0)
    assert aircraft.judge(angle_x=0.1) is AWAY


def test_land_is_a_landing_whatever_the_landed_state() -> None:
    aircraft = Aircraft()
    aircraft.flies(LAND)
    aircraft.lands(IN_AIR)
    assert aircraft.judge(position_valid=1, x=500.0) is AWAY
    aircraft.flies(LAND, armed=False)
    assert aircraft.judge(position_valid=1, x=500.0) is ALLOWED, "on the ground nothing is led"


def test_without_a_position_no_landing_is_led() -> None:
    aircraft = Aircraft()
    aircraft.state = VehicleState()
    aircraft.targets = LandingTargets(aircraft.state)
    aircraft.flies(LAND)
    assert aircraft.judge(angle_x=0.1, distance=3.0) is AWAY

# SPDX-License-Identifier: GPL-3.0-or-later

"""The telemetry that the companion lives on, when a commander has changed what the autopilot sends."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from tests.module.conftest import Bench
from tests.module.test_handover import flight, hand_over  # noqa: F401
from tests.module.vehicle import Autopilot

POSITION, LANDED = 33, 245
RAW_IMU, SCALED_IMU = 27, 26
#: message id -> interval (us): GLOBAL_POSITION_INT, ATTITUDE, VFR_HUD, NAV_CONTROLLER_OUTPUT, EXTENDED_SYS_STATE,
#: MISSION_CURRENT, SYS_STATUS, BATTERY_STATUS, WIND, FENCE_STATUS, GPS_RAW_INT, SYSTEM_TIME
OURS = {
    33: 50_000,
    30: 250_000,
    74: 250_000,
    62: 500_000,
    245: 500_000,
    42: 500_000,
    1: 500_000,
    147: 1_000_000,
    168: 1_000_000,
    162: 1_000_000,
    24: 500_000,
    2: 1_000_000,
}
OFF = dict.fromkeys(OURS, -1)


class Obedient(Autopilot):
    """Keeps the rates that it was asked for last, by whomever, and streams position and landed state by them."""

    def __init__(self) -> None:
        super().__init__()
        self.position_s = 0.05
        self.intervals_us: dict[int, int] = {}

    def _take(self, m: Any) -> None:
        if m.get_type() == "COMMAND_LONG" and m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self.intervals_us[int(m.param1)] = int(m.param2)
        elif m.get_type() == "REQUEST_DATA_STREAM" and not m.start_stop:
            self.intervals_us = dict.fromkeys(self.intervals_us, -1)
        super()._take(m)

    def say(self, message: Any) -> None:
        if self.intervals_us.get(message.get_msgId(), 0) >= 0:
            super().say(message)


@pytest.fixture
def obedient(bench: Bench) -> Obedient:
    """What `flight` flies with."""
    bench.autopilot = autopilot = Obedient()
    return autopilot


@pytest.fixture
def cruise(obedient: Obedient, flight: Bench) -> Bench:  # noqa: F811
    """In flight in zone A for a while, GCSA commands."""
    flight.run(6.0)
    assert obedient.intervals_us == OURS
    return flight


def switch_off(bench: Bench, by: str) -> None:
    """GCSA ends every stream."""
    if by == "REQUEST_DATA_STREAM":
        bench.a.send(mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_ALL, 0, 0))
    else:
        for msgid in OURS:
            bench.a.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, msgid, -1)


@pytest.mark.parametrize("by", ["REQUEST_DATA_STREAM", "SET_MESSAGE_INTERVAL"])
def test_after_a_commit_the_streams_that_the_old_commander_had_switched_off_are_back(
    cruise: Bench, obedient: Obedient, by: str
) -> None:
    switch_off(cruise, by)
    cruise.run(0.1)
    assert obedient.intervals_us == OFF
    cruise.run(10.0)
    assert obedient.intervals_us == {**OFF, POSITION: 50_000, LANDED: 500_000}, (
        "the others are the commander's business"
    )
    hand_over(cruise)
    cruise.run(1.1)
    assert obedient.intervals_us == OURS


def test_they_are_back_too_when_the_commander_that_switched_them_off_is_lost(cruise: Bench, obedient: Obedient) -> None:
    switch_off(cruise, "SET_MESSAGE_INTERVAL")
    cruise.run(0.1)
    cruise.a.alive = False
    cruise.until(lambda: cruise.companion.view.commander != 251)
    cruise.run(1.1)
    assert obedient.intervals_us == OURS


def test_after_a_commit_the_other_messages_that_the_old_commander_had_asked_for_have_their_default_rate(
    cruise: Bench, obedient: Obedient
) -> None:
    for msgid, interval_us in {RAW_IMU: 20_000, SCALED_IMU: -1, POSITION: 40_000}.items():
        cruise.a.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, msgid, interval_us)
    cruise.run(0.1)
    assert obedient.intervals_us == {**OURS, RAW_IMU: 20_000, SCALED_IMU: -1, POSITION: 40_000}
    hand_over(cruise)
    assert obedient.intervals_us[POSITION] == 40_000, "positions would pause at the border"
    cruise.b.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, SCALED_IMU, 500_000)
    cruise.run(1.1)
    assert obedient.intervals_us == {**OURS, RAW_IMU: 0, SCALED_IMU: 500_000}


def test_a_commander_that_insists_is_answered_every_five_seconds(cruise: Bench, obedient: Obedient) -> None:
    obedient.received.clear()
    for _ in range(150):
        cruise.a.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LANDED, -1)
        cruise.run(0.1)
    asked = [m for m in obedient.got("COMMAND_LONG", 1) if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL]
    assert {m.param1 for m in asked} == {LANDED}
    assert len(asked) in (2, 3)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The position estimate against the GPS receiver, while onboard programs may move the estimate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.onboard.estimate_watch import EstimateWatch
from mavproxy_handover.vehicle.state import VehicleState

METRE = 1.0 / 111_190.0


class Flight:
    """An armed aircraft, and what the companion says and orders."""

    def __init__(self, used: bool = True) -> None:
        self.state = VehicleState()
        self.said: list[str] = []
        self.ordered: list[bytes] = []
        sender = SimpleNamespace(say_to_all=lambda text, _severity: self.said.append(text))
        log = SimpleNamespace(onboard=lambda _program, _text: None)
        reports = cast(Reports, SimpleNamespace(event_log=log, message_sender=sender))
        self.watch = EstimateWatch(1, used, self.state, reports, self.ordered.append)
        self.now = 100.0

    def parameter(self, name: str, value: float) -> None:
        message = mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)
        self.state.on_message(message, self.now)

    def second(self, off_m: float, *, armed: bool = True, fix: int = 3, speed_mps: float = 0.0) -> None:
        self.now += 1.0
        flags = (128 if armed else 0) | 1
        lat = round((47.0 + off_m * METRE) * 1e7)
        for message in (
            mavlink.MAVLink_heartbeat_message(2, 3, flags, 6, 4, 3),
            mavlink.MAVLink_global_position_int_message(0, lat, 80_000_000, 0, 0, round(speed_mps * 100), 0, 0, 0),
            mavlink.MAVLink_gps_raw_int_message(0, fix, 470_000_000, 80_000_000, 0, 0, 0, 0, 0, 10),
        ):
            self.state.on_message(message, self.now)
        self.watch.each_second(self.now)

    def sets(self) -> list[float]:
        parser = mavlink.MAVLink(None)
        found: list[Any] = [message for frame in self.ordered for message in parser.parse_buffer(frame) or []]
        assert {message.command for message in found} <= {mavlink.MAV_CMD_SET_EKF_SOURCE_SET}
        return [message.param1 for message in found]


def test_a_drift_is_ended_by_the_source_set_that_has_the_gps() -> None:
    flight = Flight()
    flight.parameter("EK3_SRC1_POSXY", 6.0)
    flight.parameter("EK3_SRC2_POSXY", 3.0)
    for second in range(13):
        flight.second(second * 2.0)
    assert flight.said == []
    for _second in range(4):
        flight.second(40.0)
    assert flight.said == [
        "Position estimate is 40 m from the GPS receiver. EKF source set 2 (GPS) ordered, programs' positions stopped."
    ]
    assert flight.watch.stopped
    assert flight.sets() == [2.0]
    for _second in range(10):
        flight.second(40.0)
    assert flight.sets() == [2.0] * 3, "one may be lost"
    flight.second(1.0)
    orders = len(flight.ordered)
    flight.second(1.0)
    assert flight.said[1:] == ["Position estimate and GPS receiver agree again."]
    assert len(flight.ordered) == orders
    assert flight.watch.stopped, "what has lied once does not pass again in this flight"
    flight.second(0.0, armed=False)
    assert not flight.watch.stopped


def test_without_a_set_that_has_the_gps_people_are_told_and_nothing_is_stopped() -> None:
    flight = Flight()
    flight.parameter("EK3_SRC1_POSXY", 6.0)
    for _second in range(70):
        flight.second(64.0)
    told = "Position estimate is 64 m from the GPS receiver. No EKF source set has GPS. Land, or fly by hand."
    assert flight.said == [told, told], "once a minute"
    assert not flight.watch.stopped
    assert flight.ordered == []


@pytest.mark.parametrize(
    ("off_m", "more"),
    [
        (24.0, {}),
        (34.0, {"speed_mps": 10.0}),
        (500.0, {"armed": False}),
        (500.0, {"fix": 1}),
    ],
)
def test_what_is_no_disagreement(off_m: float, more: dict[str, Any]) -> None:
    """Near, or a second's way, on the ground, or without a fix of the receiver."""
    flight = Flight()
    for _second in range(30):
        flight.second(off_m, **more)
    assert flight.said == []
    assert not flight.watch.stopped


def test_a_moment_is_no_disagreement() -> None:
    flight = Flight()
    for second in range(60):
        flight.second(100.0 if second % 4 < 3 else 0.0)
    assert flight.said == []


def test_without_a_program_that_moves_the_estimate_nothing_is_compared() -> None:
    flight = Flight(used=False)
    for _second in range(30):
        flight.second(500.0)
    assert flight.said == []

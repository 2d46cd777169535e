# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations are told of a return that comes no nearer, while onboard programs may report obstacles."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.onboard.return_watch import ReturnWatch
from mavproxy_handover.vehicle.state import VehicleState

AUTO, RTL = 3, 6
METRE = 1.0 / 111_190.0


class Return:
    """An aircraft in flight, and what the stations are told."""

    def __init__(self, used: bool = True, site: tuple[float, float] | None = (47.0, 8.0)) -> None:
        self.state = VehicleState()
        self.said: list[str] = []
        sender = SimpleNamespace(say_to_all=self.said.append)
        log = SimpleNamespace(onboard=lambda _program, _text: None)
        reports = cast(Reports, SimpleNamespace(event_log=log, message_sender=sender))
        self.watch = ReturnWatch(used, self.state, lambda: site, reports)
        self.now = 100.0

    def seconds(
        self, count: int, away_m: float, speed_mps: float = 0.0, mode: int = RTL, landed: int = 2, circles: int = 0
    ) -> None:
        for second in range(count):
            self.now += 1.0
            lat = round((47.0 + (away_m - speed_mps * second) * METRE) * 1e7)
            for message in (
                mavlink.MAVLink_heartbeat_message(2, 3, 129, mode, 4, 3),
                mavlink.MAVLink_extended_sys_state_message(0, landed),
                mavlink.MAVLink_global_position_int_message(0, lat, 80_000_000, 0, 30_000, 0, circles, 0, 0),
            ):
                self.state.on_message(message, self.now)
            self.watch.each_second(self.now)


def test_a_return_that_stands_is_told_once_a_minute() -> None:
    flight = Return()
    flight.seconds(60, 300.0, 4.0)
    flight.seconds(44, 60.0)
    assert flight.said == []
    flight.seconds(70, 60.0)
    text = "Return comes no nearer, 60 m from its site. Order LAND, or end the obstacle program."
    assert flight.said == [text, text]


def test_a_return_that_circles_at_its_site_is_told() -> None:
    """ArduCopter with BendyRuler, 4 to 20 m from home at 2 m/s."""
    flight = Return()
    flight.seconds(60, 300.0, 4.9)
    flight.seconds(50, 12.0, circles=200)
    assert flight.said == ["Return comes no nearer, 12 m from its site. Order LAND, or end the obstacle program."]


@pytest.mark.parametrize(
    ("away_m", "speed_mps", "mode", "landed"),
    [(900.0, 4.0, RTL, 2), (4.0, 0.0, RTL, 2), (300.0, 0.0, AUTO, 2), (300.0, 0.0, RTL, 4)],
)
def test_nothing_is_told_of_a_return_that_goes_on(away_m: float, speed_mps: float, mode: int, landed: int) -> None:
    """It comes nearer, is at its site, is no return, or lands where it is."""
    flight = Return()
    flight.seconds(200, away_m, speed_mps, mode, landed)
    assert flight.said == []


def test_without_obstacles_of_programs_or_without_a_site_nothing_is_told() -> None:
    for flight in (Return(used=False), Return(site=None)):
        flight.seconds(200, 300.0)
        assert flight.said == []

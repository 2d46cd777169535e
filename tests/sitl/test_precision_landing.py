# SPDX-License-Identifier: GPL-3.0-or-later

"""Precision landing: a program that sees a pad, and the built-in vehicle that comes down on it."""

from __future__ import annotations

import io
import math
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from sitl.run.onboard import Program, message_of
from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.builtin.physics import Body
from sitl.vehicles.builtin.precision_landing import PrecisionLanding

HERE = (47.0, 8.0)
METRE = 1.0 / 111_319.5


def target(angle_x: float, angle_y: float, distance: float) -> Any:
    return mavlink.MAVLink_landing_target_message(0, 0, 12, angle_x, angle_y, distance, 0, 0)


def landing(enabled: float = 1.0) -> tuple[PrecisionLanding, list[str]]:
    parameters, said = ParameterTable(), list[str]()
    parameters.set("PLND_ENABLED", enabled)
    parameters.set("PLND_TYPE", 1.0)
    return PrecisionLanding(parameters, lambda _severity, text: said.append(text)), said


@pytest.mark.parametrize(
    ("heading_deg", "angles", "wanted"),
    [
        (0.0, (math.atan(0.1), 0.0), (0.0, 1.0, -0.5)),
        (90.0, (math.atan(0.1), 0.0), (-1.0, 0.0, -0.5)),
        (0.0, (0.0, math.atan(-0.2)), (2.0, 0.0, -0.5)),
        (0.0, (0.0, math.atan(-0.9)), (3.0, 0.0, 0.0)),
    ],
)
def test_it_moves_over_the_target(
    heading_deg: float, angles: tuple[float, float], wanted: tuple[float, float, float]
) -> None:
    """From 10 m: one metre to the right, two metres ahead; nine metres ahead it does not come down."""
    precision, said = landing()
    body = Body(position=(0.0, 0.0, 10.0), heading_deg=heading_deg)
    slope = math.hypot(math.tan(angles[0]), math.tan(angles[1]), 1.0)
    precision.take(target(*angles, 10.0 * slope), body, 5.0)
    assert precision.steer(0.5, body, 5.1) == pytest.approx(wanted, abs=1e-6)
    assert said == ["PrecLand: Target Found"]
    assert precision.steer(0.5, body, 7.2) == (0.0, 0.0, -0.5)
    assert said == ["PrecLand: Target Found", "PrecLand: Target Lost"]


def test_what_is_not_enabled_moves_nothing() -> None:
    precision, said = landing(enabled=0.0)
    body = Body(position=(0.0, 0.0, 10.0))
    precision.take(target(0.1, 0.1, 10.0), body, 5.0)
    assert precision.steer(0.5, body, 5.1) == (0.0, 0.0, -0.5)
    assert said == []


def test_the_program_sees_a_pad_from_the_aircraft() -> None:
    """The pad is 6 m north, and the aircraft 8 m high flies east: the pad is to its left."""
    program = Program(1, 25, 9, io.StringIO())
    program.order(f"beacon {HERE[0] + 6.0 * METRE} {HERE[1]} 20 1", 0.0)
    sent: list[Any] = []
    program._send = sent.append  # type: ignore[method-assign]
    program.tick(0.0)
    assert [message for message in sent if message is not None and message.get_type() == "LANDING_TARGET"] == []
    program._position = SimpleNamespace(lat=round(HERE[0] * 1e7), lon=round(HERE[1] * 1e7), hdg=9000, relative_alt=8000)
    program.tick(0.05)
    (seen,) = [message for message in sent if message is not None and message.get_type() == "LANDING_TARGET"]
    assert (seen.angle_x, seen.angle_y) == pytest.approx((-math.atan2(6.0, 8.0), 0.0), abs=1e-3)
    assert seen.distance == pytest.approx(10.0, abs=0.01)
    program.socket.close()


def test_a_list_has_its_value_in_each_place() -> None:
    message = message_of("OBSTACLE_DISTANCE", 1, ["distances=100", "increment=5"])
    assert (message.distances, message.increment) == ([100] * 72, 5)

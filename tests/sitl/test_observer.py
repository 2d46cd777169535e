# SPDX-License-Identifier: GPL-3.0-or-later

"""The passive monitor changes the world: it sets a parameter of the simulation, again until the vehicle has it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.run import observer as module
from sitl.run.observer import Observer


class Vehicle:
    """The other end of the observer's connection."""

    def __init__(self, folder: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.observer = Observer(f"tcp:127.0.0.1:{server.getsockname()[1]}", 1, 1.0, folder / "vehicle.jsonl")
            self.socket, _address = server.accept()
        self.socket.settimeout(5.0)
        self._own: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def sets(self) -> list[tuple[str, float, int]]:
        """What it is told to set, in what is sent by one `poll`."""
        self.observer.poll()
        self.socket.settimeout(0.0)
        try:
            data = self.socket.recv(65536)
        except BlockingIOError:
            return []
        messages = mavlink.MAVLink(None).parse_buffer(data) or []
        return [(m.param_id, m.param_value, m.get_srcSystem()) for m in messages if m.get_type() == "PARAM_SET"]

    def say(self, name: str, value: float) -> None:
        self.socket.settimeout(5.0)
        self.socket.sendall(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 900, 1).pack(self._own))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def vehicle(tmp_path: Path, clock: list[float]) -> Iterator[Vehicle]:
    vehicle = Vehicle(tmp_path)
    vehicle.sets()
    yield vehicle
    vehicle.observer.close()
    vehicle.socket.close()


def heard(vehicle: Vehicle, done: Any) -> bool:
    """Poll until what was said is taken in, or it is clear that it does not come."""
    for _ in range(1000):
        vehicle.observer.poll()
        if done():
            return True
    return False


def test_it_is_set_again_each_second_until_the_vehicle_has_it(vehicle: Vehicle, clock: list[float]) -> None:
    done = vehicle.observer.change_world("SIM_WIND_SPD", 17.0)
    assert vehicle.sets() == [("SIM_WIND_SPD", 17.0, 1)]
    assert not done()
    assert vehicle.sets() == []
    clock[0] += 1.0
    assert vehicle.sets() == [("SIM_WIND_SPD", 17.0, 1)]
    vehicle.say("SIM_WIND_SPD", 0.0)
    assert not heard(vehicle, done)
    vehicle.say("SIM_WIND_SPD", 17.0)
    assert heard(vehicle, done)
    clock[0] += 1.0
    assert vehicle.sets() == []


def test_what_was_said_of_the_value_before_is_no_answer_to_the_next(vehicle: Vehicle) -> None:
    first = vehicle.observer.change_world("SIM_WIND_SPD", 17.0)
    vehicle.say("SIM_WIND_SPD", 17.0)
    assert heard(vehicle, first)
    again = vehicle.observer.change_world("SIM_WIND_SPD", 0.0)
    assert not again()
    assert ("SIM_WIND_SPD", 0.0, 1) in vehicle.sets()
    vehicle.say("SIM_WIND_SPD", 0.0)
    assert heard(vehicle, again)

# SPDX-License-Identifier: GPL-3.0-or-later

"""What the built-in vehicle has of a transmitter, of fences, and of a receiver without a fix."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.bench import Bench
from sitl.vehicles.builtin.items import Item
from sitl.vehicles.builtin.script_host import ScriptHost
from sitl.vehicles.builtin.telemetry import sys_status
from sitl.vehicles.builtin.vehicle import Vehicle

RADIO, FENCE = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, dialect.MAV_SYS_STATUS_GEOFENCE
GUIDED, LOITER, RTL, LAND, AUTO = 4, 5, 6, 9, 3
SWITCH = {"FS_THR_ENABLE": 1.0, "FLTMODE1": LOITER, "FLTMODE2": RTL, "FLTMODE6": LAND}


def sticks(vehicle: Vehicle, mode_pwm: int) -> None:
    vehicle.radio.receive(struct.pack("<16H", 1500, 1500, 1500, 1500, mode_pwm, *[1000] * 11))


def aloft(bench: Bench, north_m: float = 0.0) -> None:
    """In GUIDED, 20 m up, so far north of home."""
    bench.run(12.0)
    copter = bench.vehicle.copter
    assert copter.set_mode(GUIDED, 2)
    copter.motors_on()
    copter.begin_flight()
    copter.body.position = (north_m, 0.0, 20.0)


def fly(bench: Bench, seconds: float, mode_pwm: int) -> None:
    for _ in range(round(seconds * 10)):
        sticks(bench.vehicle, mode_pwm)
        bench.run(0.1)


def health(bench: Bench, bit: int) -> tuple[bool, bool]:
    """Whether SYS_STATUS has it as on, and as well."""
    status = sys_status(bench.vehicle.autopilot)
    assert status is not None
    return bool(status.onboard_control_sensors_enabled & bit), bool(status.onboard_control_sensors_health & bit)


def test_without_a_transmitter_there_is_none() -> None:
    bench = Bench()
    bench.run(5.0)
    assert health(bench, RADIO) == (False, False)


@pytest.mark.parametrize(("width", "mode"), [(1165, LOITER), (1295, RTL), (1815, LAND)])
def test_the_switch_chooses_when_it_is_moved_and_not_before(width: int, mode: int) -> None:
    bench = Bench(SWITCH)
    aloft(bench)
    fly(bench, 1.0, 1500)
    assert bench.vehicle.copter.mode.number == GUIDED
    fly(bench, 0.2, width)
    assert bench.vehicle.copter.mode.number == mode
    assert health(bench, RADIO) == (True, True)
    bench.vehicle.copter.set_mode(GUIDED, 2)
    fly(bench, 0.2, width)
    assert bench.vehicle.copter.mode.number == GUIDED


@pytest.mark.parametrize(("watched", "mode", "well"), [(1.0, RTL, False), (0.0, LOITER, True)])
def test_a_transmitter_that_falls_silent_is_a_failsafe_where_there_is_one(
    watched: float, mode: int, well: bool
) -> None:
    bench = Bench({**SWITCH, "FS_THR_ENABLE": watched})
    aloft(bench)
    fly(bench, 1.0, 1500)
    fly(bench, 1.0, 1165)
    bench.run(2.0)
    assert bench.vehicle.copter.mode.number == mode
    assert health(bench, RADIO) == (True, well)


def test_it_arms_with_a_transmitter_and_not_without() -> None:
    bench = Bench(SWITCH)
    bench.run(12.0)
    bench.vehicle.copter.set_mode(GUIDED, 2)
    assert not bench.vehicle.arming.arm()
    fly(bench, 0.5, 1165)
    bench.vehicle.copter.set_mode(GUIDED, 2)
    assert bench.vehicle.arming.arm()


def test_noise_on_the_radio_port_is_no_frame() -> None:
    bench = Bench(SWITCH)
    bench.vehicle.radio.receive(b"noise")
    assert not bench.vehicle.radio.ever


def square(half_m: float, command: int) -> list[Item]:
    """Four corners around home."""
    degrees = half_m / 111_320.0
    corners = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
    lat, lon = 52.679, 5.924
    return [
        Item(command, 0, param1=4, x=round((lat + n * degrees) * 1e7), y=round((lon + e * degrees / 0.606) * 1e7))
        for n, e in corners
    ]


@pytest.mark.parametrize(
    ("parameters", "items", "north_m", "breach"),
    [
        ({"FENCE_TYPE": 4}, square(100, 5001), 90.0, ""),
        ({"FENCE_TYPE": 4}, square(100, 5001), 110.0, "Polygon"),
        ({"FENCE_TYPE": 4}, square(100, 5002), 90.0, "Polygon"),
        ({"FENCE_TYPE": 4}, square(100, 5002), 110.0, ""),
        ({"FENCE_TYPE": 2, "FENCE_RADIUS": 100}, square(50, 5001), 90.0, ""),
        ({"FENCE_TYPE": 2, "FENCE_RADIUS": 100}, [], 110.0, "Circle"),
        ({"FENCE_TYPE": 4}, [], 110.0, ""),
        ({"FENCE_TYPE": 2, "FENCE_RADIUS": 100, "FENCE_ENABLE": 0}, [], 110.0, ""),
    ],
)
def test_a_fence_that_is_left_returns_once(
    parameters: dict[str, float], items: list[Item], north_m: float, breach: str
) -> None:
    bench = Bench({"FENCE_ENABLE": 1, **parameters})
    bench.vehicle.copter.fence = items
    aloft(bench, north_m)
    bench.run(0.2)
    copter = bench.vehicle.copter
    assert copter.mode.number == (RTL if breach else GUIDED)
    assert [line for line in bench.records if "breached" in line] == [
        line for line in bench.records if f"{breach} fence breached" in line
    ]
    on, well = health(bench, FENCE)
    assert (on, well) == (bench.vehicle.fence.on, bench.vehicle.fence.on and not breach)
    copter.set_mode(GUIDED, 2)
    bench.run(0.2)
    assert copter.mode.number == GUIDED


def test_a_fence_that_only_reports_does_nothing() -> None:
    bench = Bench({"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": 100, "FENCE_ACTION": 0})
    aloft(bench, 110.0)
    bench.run(0.2)
    assert (bench.vehicle.copter.mode.number, bench.vehicle.fence.breached) == (GUIDED, True)


def test_eight_seconds_without_a_fix_it_lands_and_needs_no_position() -> None:
    bench = Bench()
    aloft(bench)
    bench.vehicle.parameters.set("SIM_GPS1_ENABLE", 0)
    bench.run(7.5)
    assert bench.vehicle.copter.mode.number == GUIDED
    bench.run(1.5)
    assert bench.vehicle.copter.mode.number == LAND
    assert not bench.vehicle.copter.set_mode(RTL, 2)
    bench.vehicle.parameters.set("SIM_GPS1_ENABLE", 1)
    bench.run(1.0)
    assert bench.vehicle.copter.set_mode(RTL, 2)


def test_scripts_see_the_radio_and_the_estimator() -> None:
    bench = Bench(SWITCH)
    host = ScriptHost(bench.vehicle.autopilot, bench.vehicle.links, bench.vehicle.parameter_protocol, print)
    assert not host.rc_valid()
    aloft(bench)
    fly(bench, 0.5, 1500)
    assert host.rc_valid()
    bench.run(2.0)
    assert not host.rc_valid()
    bench.vehicle.parameters.set("SIM_GPS1_ENABLE", 0)
    assert not host.has_ekf_failsafed()
    bench.run(9.0)
    assert host.has_ekf_failsafed()

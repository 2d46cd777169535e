# SPDX-License-Identifier: GPL-3.0-or-later

"""What the aircraft did, told from its telemetry."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.report.watch import Clock, Watch, samples_of

ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


class Vehicle:
    """Makes messages as the autopilot sends them; every message is a tenth of a second later."""

    def __init__(self) -> None:
        self.watch = Watch(1, 5.0)
        self.t = 100.0
        self._parser = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def says(self, message: Any, *, sysid: int = 1, component: int = 1) -> list[str]:
        """The events that come of a message."""
        self.t += 0.1
        sender = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=component)
        whole = self._parser.parse_buffer(message.pack(sender))[0]
        return [entry.event for entry in self.watch.on_message(whole, self.t)]

    def heartbeat(self, mode: int, armed: bool = False, **who: int) -> list[str]:
        return self.says(mavlink.MAVLink_heartbeat_message(2, 3, ARMED if armed else 0, mode, 4, 3), **who)

    def position(self, alt_m: float, boot_s: float, lat: float = 52.679) -> list[str]:
        values = (round(lat * 1e7), 59240000, round(alt_m * 1000), round(alt_m * 1000), 300, 400, 0, 9000)
        return self.says(mavlink.MAVLink_global_position_int_message(round(boot_s * 1000), *values))

    def landed_state(self, state: int) -> list[str]:
        return self.says(mavlink.MAVLink_extended_sys_state_message(0, state))


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


def test_a_mode_is_noted_once(vehicle: Vehicle) -> None:
    assert vehicle.heartbeat(3) == ["mode"]
    assert vehicle.heartbeat(3) == []
    assert vehicle.watch.mode == "AUTO"
    assert vehicle.heartbeat(6) == ["mode"]
    assert vehicle.watch.mode == "RTL"


def test_heartbeats_of_others_are_not_the_aircrafts(vehicle: Vehicle) -> None:
    assert vehicle.heartbeat(6, sysid=251) == []
    assert vehicle.heartbeat(6, component=191) == []
    assert vehicle.watch.mode == ""


def test_a_flight_has_a_take_off_and_a_landing(vehicle: Vehicle) -> None:
    vehicle.heartbeat(4)
    assert vehicle.heartbeat(4, armed=True) == ["armed"]
    assert vehicle.position(1.0, 10) == ["sample"]
    assert vehicle.position(2.5, 11) == ["airborne", "sample"]
    assert vehicle.landed_state(mavlink.MAV_LANDED_STATE_IN_AIR) == []
    assert vehicle.landed_state(mavlink.MAV_LANDED_STATE_ON_GROUND) == ["landed"]
    assert (vehicle.watch.landed, vehicle.watch.armed) == (True, True)
    assert vehicle.heartbeat(4) == ["disarmed"]


def test_disarming_ends_a_flight_where_the_landed_state_is_unknown(vehicle: Vehicle) -> None:
    vehicle.heartbeat(3, armed=True)
    vehicle.position(30.0, 10)
    assert vehicle.heartbeat(3) == ["disarmed", "landed"]


def test_an_aircraft_on_the_ground_is_not_airborne_for_being_high(vehicle: Vehicle) -> None:
    vehicle.heartbeat(4)
    assert vehicle.position(50.0, 10) == ["sample"]
    assert not vehicle.watch.airborne


def test_simulated_time_is_the_autopilots(vehicle: Vehicle) -> None:
    vehicle.position(0.0, 10.0)
    vehicle.position(0.0, 10.5)
    assert vehicle.watch.clock.sim_at(vehicle.t) == 10.5


def test_samples_are_thinned_to_five_a_simulated_second(vehicle: Vehicle) -> None:
    events = [event for step in range(21) for event in vehicle.position(0.0, 10.0 + step * 0.05)]
    assert len(events) == 6


def test_a_position_at_zero_is_no_position_yet(vehicle: Vehicle) -> None:
    message = mavlink.MAVLink_global_position_int_message(1000, 0, 0, 0, 0, 0, 0, 0, 0)
    assert vehicle.says(message) == []
    assert vehicle.watch.sample is None


def test_a_sample_has_the_aircrafts_numbers(vehicle: Vehicle) -> None:
    vehicle.position(12.5, 10.0)
    sample = vehicle.watch.sample
    assert sample is not None
    assert (sample.lat_deg, sample.lon_deg, sample.alt_m, sample.heading_deg) == (52.679, 5.924, 12.5, 90.0)
    assert sample.speed_mps == 5.0


def test_samples_come_back_from_a_journal(vehicle: Vehicle) -> None:
    message = mavlink.MAVLink_global_position_int_message(10000, 526790000, 59240000, 0, 12500, 300, 400, 0, 9000)
    entries = vehicle.watch.on_message(message, 5.0) if message.pack(mavlink.MAVLink(None, 1, 1)) else []
    (sample,) = samples_of(entries)
    assert (sample.t, sample.sim_s, sample.alt_m, sample.speed_mps) == (5.0, 10.0, 12.5, 5.0)


def test_an_item_is_reached_once_a_time(vehicle: Vehicle) -> None:
    reached = mavlink.MAVLink_mission_item_reached_message(3)
    assert vehicle.says(reached) == ["reached"]
    assert vehicle.says(reached) == []
    assert vehicle.watch.reached == [3]


def test_the_throttle_stick_is_noted_when_it_moves(vehicle: Vehicle) -> None:
    def channels(throttle: int) -> list[str]:
        return vehicle.says(mavlink.MAVLink_rc_channels_message(0, 16, 1500, 1500, throttle, *[1500] * 15, 255))

    assert [channels(raw) for raw in (1000, 1000, 1200, 1200, 0)] == [["sticks"], [], ["sticks"], [], ["sticks"]]


def test_a_long_text_is_put_together(vehicle: Vehicle) -> None:
    first, second = b"HNDO: " + b"x" * 44, b"yz"
    assert vehicle.says(mavlink.MAVLink_statustext_message(2, first, 7, 0)) == []
    message = mavlink.MAVLink_statustext_message(2, second, 7, 1)
    assert vehicle.says(message) == ["said"]


def test_the_position_estimate_is_noted_when_it_comes_and_goes(vehicle: Vehicle) -> None:
    good = mavlink.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0, 0)
    assert vehicle.says(good) == ["position_ready"]
    assert vehicle.watch.position_ready
    assert vehicle.says(mavlink.MAVLink_ekf_status_report_message(167, 0, 0, 0, 0, 0)) == ["position_lost"]


def test_the_clock_fills_in_between_and_beyond() -> None:
    clock = Clock(5.0)
    clock.add(10.0, 100.0)
    clock.add(12.0, 110.0)
    assert clock.sim_at(11.0) == 105.0
    assert clock.sim_at(13.0) == 115.0
    assert clock.sim_at(9.0) == 95.0


def test_the_clock_never_goes_backwards() -> None:
    clock = Clock(1.0)
    clock.add(10.0, 100.0)
    clock.add(11.0, 50.0)
    clock.add(9.0, 120.0)
    assert clock.sim_at(10.0) == 100.0
    assert clock.sim_at(12.0) == 102.0

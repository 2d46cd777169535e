# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot said, as the companion passes it on: units, directions, and what is not known."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, GuardState, LeaseState, Phase, Reason
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire import codec, status
from mavproxy_handover.wire.codec import AircraftState
from mavproxy_handover.wire.lease import unpack_lease

VIEW = AuthorityView(Phase.ON_HANDOVER, 251, 252, 7, LeaseState.TRANSFER, armed=True, handover_id=3)


def position(north_cms: int = 0, east_cms: int = 0, down_cms: int = 0, heading: int = 9000) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_global_position_int_message(
        123456, 526790000, 59240000, 45000, 30000, north_cms, east_cms, down_cms, heading
    )


@pytest.fixture
def aircraft() -> VehicleState:
    return VehicleState()


@pytest.mark.parametrize(
    ("north", "east", "course"), [(500, 0, 0.0), (0, 500, 90.0), (-500, 0, 180.0), (0, -500, 270.0), (300, 300, 45.0)]
)
def test_the_track_is_the_course_over_ground(aircraft: VehicleState, north: int, east: int, course: float) -> None:
    aircraft.on_message(position(north, east), 1.0)
    assert aircraft.track[0] == pytest.approx(course)
    assert aircraft.track[1] == pytest.approx(math.hypot(north, east) / 100)


def test_before_a_position_there_is_no_track(aircraft: VehicleState) -> None:
    assert aircraft.track == (0.0, 0.0)


@pytest.mark.parametrize(
    ("base_mode", "landed", "flying"),
    [
        (0, mavlink.MAV_LANDED_STATE_IN_AIR, False),
        (128, mavlink.MAV_LANDED_STATE_IN_AIR, True),
        (128, mavlink.MAV_LANDED_STATE_TAKEOFF, True),
        (128, mavlink.MAV_LANDED_STATE_LANDING, True),
        (128, mavlink.MAV_LANDED_STATE_ON_GROUND, False),
        (128, mavlink.MAV_LANDED_STATE_UNDEFINED, True),
    ],
)
def test_armed_and_not_known_to_be_on_the_ground_is_flying(
    aircraft: VehicleState, base_mode: int, landed: int, flying: bool
) -> None:
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(2, 3, base_mode, 4, 4, 3), 1.0)
    aircraft.on_message(mavlink.MAVLink_extended_sys_state_message(0, landed), 1.0)
    assert aircraft.flying is flying


def test_telemetry_has_the_fields_of_the_thesis_in_the_units_of_the_dialect(aircraft: VehicleState) -> None:
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(2, 3, 128, 3, 4, 3), 1.0)
    aircraft.on_message(position(300, 400, -50, 12345), 1.0)
    aircraft.on_message(mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0.25, -0.5, 0.75), 1.0)
    aircraft.on_message(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 11800, 0, 76, 0, 0, 0, 0, 0, 0), 1.0)
    aircraft.on_message(mavlink.MAVLink_mission_current_message(8), 1.0)
    aircraft.on_message(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, 120, 0, 0, 0), 1.0)
    m = aircraft.record((251, 190), 1_700_000_000_000_000, (252, 251))
    assert (m.target_system, m.target_component, m.time_usec, m.time_boot_ms) == (
        251,
        190,
        1_700_000_000_000_000,
        123456,
    )
    assert (m.battery_voltage, m.battery_remaining) == (11800, 76)
    assert (m.lat, m.lon, m.alt, m.relative_alt) == (526790000, 59240000, 45000, 30000)
    assert (m.rollspeed, m.pitchspeed, m.yawspeed) == (0.25, -0.5, 0.75)
    assert (m.vx, m.vy, m.vz, m.heading, m.groundspeed) == (3.0, 4.0, -0.5, 12345, 5.0)
    assert (m.waypoint, m.waypoint_distance, m.armed, m.custom_mode) == (8, 120.0, 1, 3)
    assert (m.zone, m.other_zone) == (252, 251)


def test_what_is_not_known_is_said_as_mavlink_says_unknown(aircraft: VehicleState) -> None:
    m = aircraft.record((251, 190), 0, (0, 0))
    raw = codec.pack(m, mavlink.MAVLink(None, srcSystem=1, srcComponent=191))
    received = codec.decode_bytes(raw)
    assert received is not None
    assert (received.battery_voltage, received.battery_remaining, received.heading) == (65535, -1, 65535)
    assert math.isnan(received.waypoint_distance)
    assert aircraft.state() == AircraftState()


def test_the_state_in_a_request_is_that_of_the_last_position(aircraft: VehicleState) -> None:
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(2, 3, 128, 3, 4, 3), 1.0)
    aircraft.on_message(position(300, 400, 0, 12345), 1.0)
    aircraft.on_message(mavlink.MAVLink_mission_current_message(8), 1.0)
    assert aircraft.state() == AircraftState(526790000, 59240000, 30000, 12345, 5.0, -1, 8, 3)


# ---- what the companion says on its own ---------------------------------------------------------------------------


def test_authority_status_tells_the_whole_view() -> None:
    m = status.authority_status(VIEW, 252, GuardState.LIVE, Reason.ZONE)
    assert (m.phase, m.commander, m.partner, m.zone, m.epoch, m.handover_id) == (2, 251, 252, 252, 7, 3)
    assert (m.lease, m.guard, m.reason) == (2, 2, 1)


def test_nobody_and_none_are_0() -> None:
    m = status.authority_status(AuthorityView(), 0, GuardState.SILENT, Reason.NONE)
    assert (m.phase, m.commander, m.partner, m.zone, m.lease, m.guard) == (0, 0, 0, 0, 3, 255)


@pytest.mark.parametrize(("left_s", "said"), [(math.inf, 0), (255.0, 0), (254.9, 255), (9.4, 10), (0.0, 1), (-3.0, 1)])
def test_what_is_left_is_one_more_than_its_seconds_and_0_is_none(left_s: float, said: int) -> None:
    m = status.authority_status(VIEW, 252, GuardState.LIVE, Reason.ZONE, zone_ends_s=left_s)
    assert (m.zone_ends, m.answer_left) == (said, 0)
    m = status.authority_status(VIEW, 252, GuardState.LIVE, Reason.ZONE, answer_left_s=left_s)
    assert (m.zone_ends, m.answer_left) == (0, said)


def test_authority_status_says_where_a_return_goes() -> None:
    m = status.authority_status(VIEW, 252, GuardState.LIVE, Reason.ZONE, place=("rally 2", 52.67918, -5.931984))
    assert (m.place, m.place_lat, m.place_lon) == ("rally 2", 526791800, -59319840)
    m = status.authority_status(VIEW, 252, GuardState.LIVE, Reason.ZONE)
    assert (m.place, m.place_lat, m.place_lon) == ("", 0, 0)


@pytest.mark.parametrize(
    ("way", "said"),
    [
        (None, (0, 0)),
        ((94.2, 0.113), (96, 12)),
        ((0.0, 0.0), (1, 1)),
        ((math.inf, 0.1), (0, 11)),
        ((70_000.0, 9.0), (0, 0)),
        ((math.nan, math.nan), (0, 0)),
        ((30.0, None), (31, 0)),
    ],
)
def test_authority_status_says_what_a_return_takes(
    way: tuple[float, float | None] | None, said: tuple[int, int]
) -> None:
    m = status.authority_status(VIEW, 252, GuardState.LIVE, Reason.ZONE, way=way)
    assert (m.place_in, m.place_needs) == said


def test_control_status_speaks_for_the_system_and_names_the_commander_alone() -> None:
    m = status.control_status(VIEW)
    assert (m.flags, m.gcs_main, list(m.gcs_secondary)) == (1, 251, [0] * 10)
    assert status.control_status(AuthorityView()).gcs_main == 0


def test_the_companion_is_no_ground_station() -> None:
    m = status.heartbeat(VIEW)
    assert (m.type, m.autopilot, m.custom_mode) == (18, 8, 2)
    assert m.system_status == mavlink.MAV_STATE_ACTIVE
    assert status.heartbeat(AuthorityView(Phase.EMERGENCY)).system_status == mavlink.MAV_STATE_EMERGENCY


def test_each_lease_has_the_next_number_and_they_go_round() -> None:
    sequence = status.LeaseSequence(99)
    leases = [unpack_lease(bytes(sequence.next(VIEW, 1).payload[:24])) for _ in range(3)]
    assert [(lease.sequence, lease.nonce, lease.commander) for lease in leases if lease] == [
        (1, 99, 251),
        (2, 99, 251),
        (3, 99, 251),
    ]
    sequence.sequence = 0xFFFFFFFF
    last = unpack_lease(bytes(sequence.next(VIEW, 1).payload[:24]))
    assert last is not None
    assert last.sequence == 0


@pytest.mark.parametrize(
    ("kind", "autopilot", "foreign"),
    [
        *((kind, 3, "") for kind in (2, 3, 4, 13, 14, 15, 29, 35)),
        *((kind, 3, "") for kind in (1, 19, 20, 21, 22, 23, 24, 25)),
        (10, 3, "ardupilotmega ground rover"),
        (0, 3, "ardupilotmega generic"),
        (2, 12, "px4 quadrotor"),
        (1, 12, "px4 fixed wing"),
        (250, 99, "99 250"),
    ],
)
def test_only_of_arducopter_and_arduplane_the_modes_are_known_here(kind: int, autopilot: int, foreign: str) -> None:
    aircraft = VehicleState()
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(kind, autopilot, 0, 4, 4, 3), 1.0)
    assert aircraft.foreign == foreign


def test_every_value_has_the_time_at_which_the_autopilot_said_it() -> None:
    state = VehicleState()
    state.on_message(mavlink.MAVLink_heartbeat_message(2, 3, 128, 3, 5, 3), 1.0)
    state.on_message(position(), 2.0)
    state.on_message(mavlink.MAVLink_mission_current_message(8), 3.0)
    state.on_message(mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, 120, 0, 0, 0), 4.0)
    state.on_message(mavlink.MAVLink_extended_sys_state_message(0, 2), 5.0)
    said = state.telemetry
    assert (said.heartbeat.at, said.heartbeat.armed, said.heartbeat.critical) == (1.0, True, True)
    assert (said.own_position.at, state.position.at) == (2.0, 2.0)
    assert (said.waypoint.at, said.waypoint.value) == (3.0, 8)
    assert (said.to_waypoint_m.at, said.to_waypoint_m.value) == (4.0, 120.0)
    assert (said.landed.at, said.landed.state) == (5.0, 2)
    assert (said.attitude.at, said.attitude.value) == (-math.inf, None)


def test_a_position_that_does_not_count_is_the_autopilots_own_alone() -> None:
    state = VehicleState()
    state.trust_own(False)
    state.on_message(position(), 2.0)
    assert state.where is None
    assert state.telemetry.own_position.at == 2.0
    state.trust_own(True)
    state.on_message(position(), 3.0)
    assert state.position.at == 3.0


def test_home_at_0_0_is_no_home() -> None:
    state = VehicleState()
    state.has_home(52.5, 5.25, 1.0)
    state.has_home(0.0, 0.0, 2.0)
    assert (state.telemetry.home.value, state.telemetry.home.at) == ((52.5, 5.25), 1.0)


def test_a_breach_of_the_fence_is_remembered_with_its_time() -> None:
    state = VehicleState()
    state.on_message(mavlink.MAVLink_fence_status_message(1, 1, 3, 0, 0), 4.0)
    state.on_message(mavlink.MAVLink_fence_status_message(0, 1, 3, 0, 0), 5.0)
    assert (state.breached_at, state.telemetry.fence_status.at) == (4.0, 5.0)
    fence = mavlink.MAV_SYS_STATUS_GEOFENCE
    state.on_message(mavlink.MAVLink_sys_status_message(fence, fence, 0, 0, 11800, 0, 76, 0, 0, 0, 0, 0, 0), 6.0)
    assert state.breached_at == 6.0
    state.on_message(mavlink.MAVLink_sys_status_message(fence, fence, fence, 0, 11800, 0, 76, 0, 0, 0, 0, 0, 0), 7.0)
    state.on_message(mavlink.MAVLink_sys_status_message(fence, 0, 0, 0, 11800, 0, 76, 0, 0, 0, 0, 0, 0), 8.0)
    assert state.breached_at == 6.0


@pytest.mark.parametrize(("status", "critical", "failsafe"), [(4, False, False), (5, True, True), (6, False, True)])
def test_what_the_heartbeat_says_of_failsafes(status: int, critical: bool, failsafe: bool) -> None:
    state = VehicleState()
    state.on_message(mavlink.MAVLink_heartbeat_message(2, 3, 128, 3, status, 3), 1.0)
    said = state.telemetry.heartbeat
    assert (said.critical, said.failsafe) == (critical, failsafe)


def test_a_position_is_uncompared_until_it_is_compared_and_the_next_one_from_30_ms_on() -> None:
    state = VehicleState()
    assert not state.uncompared
    state.on_message(position(), 10.0)
    assert state.uncompared
    state.compared()
    assert not state.uncompared
    state.on_message(position(), 10.02)
    assert not state.uncompared
    state.on_message(position(), 10.04)
    assert state.uncompared

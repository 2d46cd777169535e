# SPDX-License-Identifier: GPL-3.0-or-later

"""The traffic of a measurement: the autopilot's streams and a station's mix, as messages to be packed.

The streams are those that an ArduCopter sends in flight. 50 a second is slightly more than the companion requests; 200
a second is a fast link with all streams. The mix is that of a station with a joystick in use. A parameter and a mission
download run, and a command is sent now and then.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

__all__ = ["DOWNLINK", "UPLINK_MIX", "Place", "downlink_message", "frame_key", "split", "uplink_message"]

VEHICLE = 1
AUTOPILOT = 1


@dataclass(frozen=True, slots=True)
class Place:
    """Where the aircraft is and how it moves: degrees, metres above home, metres per second."""

    lat_deg: float
    lon_deg: float
    alt_m: float = 30.0
    north_mps: float = 0.0
    east_mps: float = 0.0


#: frames a second in all -> message -> times a second
DOWNLINK: dict[int, dict[str, int]] = {
    50: {
        "GLOBAL_POSITION_INT": 20,
        "ATTITUDE": 8,
        "VFR_HUD": 4,
        "NAV_CONTROLLER_OUTPUT": 2,
        "EXTENDED_SYS_STATE": 2,
        "MISSION_CURRENT": 2,
        "SYS_STATUS": 2,
        "GPS_RAW_INT": 2,
        "RC_CHANNELS": 2,
        "SERVO_OUTPUT_RAW": 2,
        "BATTERY_STATUS": 1,
        "SYSTEM_TIME": 1,
        "VIBRATION": 1,
        "HEARTBEAT": 1,
    },
    200: {
        "GLOBAL_POSITION_INT": 20,
        "ATTITUDE": 50,
        "LOCAL_POSITION_NED": 25,
        "RAW_IMU": 25,
        "VFR_HUD": 20,
        "SERVO_OUTPUT_RAW": 20,
        "RC_CHANNELS": 10,
        "NAV_CONTROLLER_OUTPUT": 5,
        "GPS_RAW_INT": 5,
        "SYS_STATUS": 4,
        "VIBRATION": 4,
        "EXTENDED_SYS_STATE": 3,
        "MISSION_CURRENT": 3,
        "BATTERY_STATUS": 3,
        "SYSTEM_TIME": 2,
        "HEARTBEAT": 1,
    },
}


def downlink_message(name: str, place: Place, boot_ms: int, armed: bool, in_air: bool) -> Any:
    """One message of the autopilot's streams. KeyError for a name that is in none of them."""
    return _DOWNLINK_MESSAGES[name](place, boot_ms, armed, in_air)


def _heartbeat(_place: Place, _ms: int, armed: bool, in_air: bool) -> Any:
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
    state = mavlink.MAV_STATE_ACTIVE if in_air else mavlink.MAV_STATE_STANDBY
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, base, 3 if in_air else 0, state, 3
    )


def _position(place: Place, ms: int, _armed: bool, _in_air: bool) -> Any:
    heading = math.degrees(math.atan2(place.east_mps, place.north_mps)) % 360.0
    return mavlink.MAVLink_global_position_int_message(
        ms,
        round(place.lat_deg * 1e7),
        round(place.lon_deg * 1e7),
        round(place.alt_m * 1e3) - 4000,
        round(place.alt_m * 1e3),
        round(place.north_mps * 100),
        round(place.east_mps * 100),
        0,
        round(heading * 100),
    )


def _landed_state(_place: Place, _ms: int, _armed: bool, in_air: bool) -> Any:
    state = mavlink.MAV_LANDED_STATE_IN_AIR if in_air else mavlink.MAV_LANDED_STATE_ON_GROUND
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def _wave(ms: int, size: float) -> float:
    return size * math.sin(ms / 700.0)


_DOWNLINK_MESSAGES: dict[str, Callable[[Place, int, bool, bool], Any]] = {
    "HEARTBEAT": _heartbeat,
    "GLOBAL_POSITION_INT": _position,
    "EXTENDED_SYS_STATE": _landed_state,
    "ATTITUDE": lambda place, ms, *_: mavlink.MAVLink_attitude_message(
        ms, _wave(ms, 0.1), _wave(ms, 0.12), 1.2, 0.01, _wave(ms, 0.02), 0.001
    ),
    "LOCAL_POSITION_NED": lambda place, ms, *_: mavlink.MAVLink_local_position_ned_message(
        ms, _wave(ms, 90.0), 12.5, -place.alt_m, place.north_mps, place.east_mps, 0.02
    ),
    "RAW_IMU": lambda place, ms, *_: mavlink.MAVLink_raw_imu_message(
        ms * 1000, round(_wave(ms, 60)), -12, -998, 3, 7, round(_wave(ms, 9)), 220, -48, 391
    ),
    "VFR_HUD": lambda place, ms, *_: mavlink.MAVLink_vfr_hud_message(
        9.8, 9.9 + _wave(ms, 0.2), 68, 47, place.alt_m, _wave(ms, 0.1)
    ),
    "NAV_CONTROLLER_OUTPUT": lambda place, ms, *_: mavlink.MAVLink_nav_controller_output_message(
        1.5, -0.4, 68, 69, 140 + ms % 60, 0.1, 0.0, _wave(ms, 0.3)
    ),
    "MISSION_CURRENT": lambda place, ms, *_: mavlink.MAVLink_mission_current_message(3),
    "SYS_STATUS": lambda place, ms, *_: mavlink.MAVLink_sys_status_message(
        1399979183, 1382153387, 1467087023, 210, 22650 - ms % 40, 1120, 87, 0, 0, 0, 0, 0, 0
    ),
    "GPS_RAW_INT": lambda place, ms, *_: mavlink.MAVLink_gps_raw_int_message(
        ms * 1000, 6, round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), 26000, 62, 110, 980, 6800, 14
    ),
    "RC_CHANNELS": lambda place, ms, *_: mavlink.MAVLink_rc_channels_message(
        ms, 16, *(1500 + round(_wave(ms, 3)) for _ in range(16)), 65535, 65535, 200
    ),
    "SERVO_OUTPUT_RAW": lambda place, ms, *_: mavlink.MAVLink_servo_output_raw_message(
        ms * 1000 & 0xFFFFFFFF, 0, *(1500 + round(_wave(ms, 60)) for _ in range(8))
    ),
    "BATTERY_STATUS": lambda place, ms, *_: mavlink.MAVLink_battery_status_message(
        0, 0, 0, 2150, [22650 - ms % 40] + [65535] * 9, 1120, 640, 530, 87
    ),
    "SYSTEM_TIME": lambda place, ms, *_: mavlink.MAVLink_system_time_message(int(time.time() * 1e6), ms),
    "VIBRATION": lambda place, ms, *_: mavlink.MAVLink_vibration_message(ms * 1000, 0.02, 0.03, 0.04, 0, 0, 0),
}


# ---- up -----------------------------------------------------------------------------------------------------------


#: message -> how often in every twenty frames
UPLINK_MIX: dict[str, int] = {
    "MANUAL_CONTROL": 5,
    "RC_CHANNELS_OVERRIDE": 4,
    "PARAM_REQUEST_READ": 4,
    "MISSION_REQUEST_INT": 4,
    "COMMAND_LONG": 2,
    "HEARTBEAT": 1,
}

_UPLINK_MESSAGES: dict[str, Callable[[int], Any]] = {
    "MANUAL_CONTROL": lambda n: mavlink.MAVLink_manual_control_message(
        VEHICLE, n % 1000, n // 1000 % 1000, 500, -n % 1000, 0
    ),
    "RC_CHANNELS_OVERRIDE": lambda n: mavlink.MAVLink_rc_channels_override_message(
        VEHICLE, AUTOPILOT, 1000 + n % 1000, 1000 + n // 1000 % 1000, 1500, 1500, 1800, 1000, 1500, 65535
    ),
    "PARAM_REQUEST_READ": lambda n: mavlink.MAVLink_param_request_read_message(VEHICLE, AUTOPILOT, b"", n % 30000),
    "MISSION_REQUEST_INT": lambda n: mavlink.MAVLink_mission_request_int_message(VEHICLE, AUTOPILOT, n % 60000, 0),
    "COMMAND_LONG": lambda n: mavlink.MAVLink_command_long_message(
        VEHICLE,
        AUTOPILOT,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        0,
        n % 90,
        0,
        n,
        0,
        0,
        0,
        mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING,
    ),
    "HEARTBEAT": lambda n: mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, n, mavlink.MAV_STATE_ACTIVE, 3
    ),
}


def _order() -> tuple[str, ...]:
    """The mix spread evenly over its period: each message at its share of every stretch."""
    places = [((k + 0.5) / times, name) for name, times in UPLINK_MIX.items() for k in range(times)]
    return tuple(name for _place, name in sorted(places))


_ORDER = _order()


def uplink_message(number: int) -> Any:
    """Frame `number` of a station's mix; its contents tell it from all others of the next thousands."""
    return _UPLINK_MESSAGES[_ORDER[number % len(_ORDER)]](number)


# ---- frames -------------------------------------------------------------------------------------------------------


def split(data: bytes) -> tuple[list[bytes], bytes]:
    """Whole MAVLink frames in trusted bytes (of our own processes), and the rest that waits for more."""
    frames = []
    start, end = 0, len(data)
    while end - start >= 3:
        if data[start] == 0xFD:
            length = 12 + data[start + 1] + (13 if data[start + 2] & 1 else 0)
        elif data[start] == 0xFE:
            length = 8 + data[start + 1]
        else:
            start += 1
            continue
        if end - start < length:
            break
        frames.append(data[start : start + length])
        start += length
    return frames, data[start:]


def frame_key(raw: bytes) -> bytes:
    """The identity of a MAVLink 2 frame on its way, signed or not: sequence number, ids and payload."""
    return raw[4 : 10 + raw[1]]

# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's telemetry: one function per message, and the stream that carries it.

Fields follow GCS_Common and GCS_MAVLink_Copter of ArduCopter 4.7. Position and speed before the receiver has a fix are
zero. Messages about things the model does not have (raw sensors, motors one by one) are not sent at all.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.aircraft import ORIGIN_AFTER_S
from sitl.vehicles.builtin.autopilot import Autopilot
from sitl.vehicles.builtin.frame import shift
from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.mission import MissionState
from sitl.vehicles.builtin.modes import target_bearing_deg

__all__ = ["BUILDERS", "CAPABILITIES", "FIRMWARE", "STREAMS", "STREAM_IDS", "send", "send_banner"]

#: pymavlink's messages are untyped.
Message: TypeAlias = Any

FIRMWARE = (4, 7, 0)
BANNER = ("ArduCopter V4.7.0-dev (builtin model)", "Frame: QUAD/PLUS")

#: MAV_PROTOCOL_CAPABILITY of ArduCopter in SITL, without FTP (0x20), compass calibration (0x1000), terrain (0x200),
#: local NED (0x80) and attitude (0x40) targets, which the model does not have.
CAPABILITIES = 63983 & ~(0x20 | 0x1000 | 0x200 | 0x80 | 0x40)

#: Radio and fence depend on what there is.
_VARIABLE = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER | dialect.MAV_SYS_STATUS_GEOFENCE
#: The other MAV_SYS_STATUS_SENSOR bits as ArduCopter's SITL reports them once it is ready.
_SENSORS_PRESENT, _SENSORS_ENABLED, _SENSORS_HEALTHY = (
    bits & ~_VARIABLE for bits in (0x5331_FC2F, 0x5221_9C2F, 0x4731_9C2F)
)
_PREARM = 0x1000_0000
_EKF_FLAGS_READY, _EKF_FLAGS_WAITING = 831, 167


def _has_fix(a: Autopilot) -> bool:
    return a.copter.time_s >= ORIGIN_AFTER_S


def heartbeat(a: Autopilot) -> Message:
    copter = a.copter
    base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
    base |= dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    ended = copter.mission.state is MissionState.COMPLETE and copter.mode.number == 3 and copter.land_complete
    idle = not copter.armed and copter.mode.number in (6, 21)
    if not (copter.mode.manual_throttle or ended or idle):
        base |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED
    if copter.armed:
        base |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_QUADROTOR,
        dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
        base,
        copter.mode.number,
        _system_status(a),
        3,
    )


def _system_status(a: Autopilot) -> int:
    copter = a.copter
    if not copter.initialised:
        return int(dialect.MAV_STATE_BOOT)
    if copter.failsafe_active or copter.battery.level or copter.ekf_failed or a.radio.failed:
        return int(dialect.MAV_STATE_CRITICAL)
    return int(dialect.MAV_STATE_STANDBY if copter.land_complete else dialect.MAV_STATE_ACTIVE)


def sys_status(a: Autopilot) -> Message | None:
    if not a.copter.initialised:
        return None
    battery = a.copter.battery
    health = _SENSORS_HEALTHY
    if a.arming.ready or a.copter.armed:
        health |= _PREARM
    more, well = _more_sensors(a)
    return dialect.MAVLink_sys_status_message(
        _SENSORS_PRESENT | more,
        _SENSORS_ENABLED | more,
        health | well,
        0,
        round(battery.voltage_v * 1000) if battery.present else 0,
        round(battery.current_a * 100) if battery.present else -1,
        battery.remaining_percent if battery.present else -1,
        0,
        0,
        0,
        0,
        0,
        0,
    )


def _more_sensors(a: Autopilot) -> tuple[int, int]:
    """Radio and fence: what of them is there and on, and what is well."""
    on = well = 0
    if a.radio.ever:
        on |= dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        well |= 0 if a.radio.failed else dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    if a.fence.on:
        on |= dialect.MAV_SYS_STATUS_GEOFENCE
        well |= 0 if a.fence.breached else dialect.MAV_SYS_STATUS_GEOFENCE
    return on, well


def fence_status(a: Autopilot) -> Message | None:
    if not a.fence.on:
        return None
    kind = dialect.FENCE_BREACH_BOUNDARY if a.fence.breached else dialect.FENCE_BREACH_NONE
    return dialect.MAVLink_fence_status_message(int(a.fence.breached), a.fence.count, kind, round(a.fence.at_s * 1000))


def power_status(a: Autopilot) -> Message:
    return dialect.MAVLink_power_status_message(5000, 0, 0)


def meminfo(a: Autopilot) -> Message:
    return dialect.MAVLink_meminfo_message(0, 65535, 524288)


def mission_current(a: Autopilot, seq: int | None = None) -> Message:
    mission, mode = a.copter.mission, a.copter.mode
    state = int(mission.state) if mission.present else int(dialect.MISSION_STATE_NO_MISSION)
    if getattr(mode, "paused", False):
        state = int(dialect.MISSION_STATE_PAUSED)
    total = max(0, len(mission) - 1)
    return dialect.MAVLink_mission_current_message(
        mission.current if seq is None else seq, total, state, 1 if mode.number == 3 else 0
    )


def gps_raw_int(a: Autopilot) -> Message:
    if not a.copter.gps_ok:
        return dialect.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0)
    place, body = a.copter.location(), a.copter.body
    course = math.degrees(math.atan2(body.velocity[1], body.velocity[0])) % 360
    return dialect.MAVLink_gps_raw_int_message(
        a.micros(),
        6,
        place.lat_e7,
        place.lon_e7,
        round(place.alt_m * 1000),
        121,
        200,
        round(body.ground_speed_m_s * 100),
        round(course * 100) % 36000,
        10,
        round(place.alt_m * 1000),
        300,
        300,
        40,
        0,
        0,
    )


def nav_controller_output(a: Autopilot) -> Message | None:
    copter = a.copter
    if not copter.initialised:
        return None
    goal = copter.mode.target()
    roll, pitch = copter.body.roll_pitch_rad()
    distance, height, crosstrack = 0.0, 0.0, 0.0
    if goal is not None:
        here = copter.body.position
        distance, height = math.hypot(goal[0] - here[0], goal[1] - here[1]), goal[2] - here[2]
        crosstrack = copter.navigator.crosstrack_m(here) if copter.mode.number != 4 else 0.0
    return dialect.MAVLink_nav_controller_output_message(
        math.degrees(roll),
        math.degrees(pitch),
        int(copter.body.heading_deg),
        int(target_bearing_deg(copter.mode)),
        min(int(distance), 65535),
        height,
        0.0,
        crosstrack,
    )


def position_target_global_int(a: Autopilot) -> Message | None:
    copter = a.copter
    goal = copter.mode.target()
    if goal is None:
        return None
    lat, lon = shift(copter.start, goal[0], goal[1])
    return dialect.MAVLink_position_target_global_int_message(
        a.millis(), 0, 0xFDF8, lat, lon, copter.start.alt_m + goal[2], *([0.0] * 8)
    )


def global_position_int(a: Autopilot) -> Message:
    copter, body = a.copter, a.copter.body
    lat = lon = alt = above = 0
    if _has_fix(a):
        place = copter.location()
        lat, lon, alt = place.lat_e7, place.lon_e7, round(place.alt_m * 1000)
        above = round(copter.above_home_m() * 1000)
    vn, ve, vu = body.velocity
    heading = round(body.heading_deg * 100) % 36000
    return dialect.MAVLink_global_position_int_message(
        a.millis(), lat, lon, alt, above, round(vn * 100), round(ve * 100), round(-vu * 100), heading
    )


def local_position_ned(a: Autopilot) -> Message | None:
    if not a.copter.position_ok:
        return None
    (n, e, u), (vn, ve, vu) = a.copter.body.position, a.copter.body.velocity
    return dialect.MAVLink_local_position_ned_message(a.millis(), n, e, -u, vn, ve, -vu)


def attitude(a: Autopilot) -> Message:
    body = a.copter.body
    roll, pitch = body.roll_pitch_rad()
    yaw = math.radians((body.heading_deg + 180) % 360 - 180)
    return dialect.MAVLink_attitude_message(a.millis(), roll, pitch, yaw, 0.0, 0.0, math.radians(body.yaw_rate_deg_s))


def vfr_hud(a: Autopilot) -> Message:
    copter, body = a.copter, a.copter.body
    flying = copter.armed and not copter.land_complete
    throttle = 36 + round(2 * body.velocity[2]) if flying else 0
    return dialect.MAVLink_vfr_hud_message(
        body.ground_speed_m_s,
        body.ground_speed_m_s,
        int(body.heading_deg),
        throttle,
        copter.location().alt_m if _has_fix(a) else 0.0,
        body.velocity[2],
    )


def system_time(a: Autopilot) -> Message:
    unix_us = a.unix_start_us + a.micros() if _has_fix(a) else 0
    return dialect.MAVLink_system_time_message(unix_us, a.millis())


def battery_status(a: Autopilot) -> Message | None:
    battery = a.copter.battery
    if not battery.present:
        return None
    charge_state = {0: 1, 2: 2, 3: 3}[int(battery.level)]
    return dialect.MAVLink_battery_status_message(
        0,
        0,
        0,
        32767,
        [round(battery.voltage_v * 1000)] + [65535] * 9,
        round(battery.current_a * 100),
        round(battery.used_mah),
        round(battery.used_mah * battery.voltage_v * 0.036),
        battery.remaining_percent,
        0,
        charge_state,
        [0, 0, 0, 0],
        0,
        0,
    )


def ekf_status_report(a: Autopilot) -> Message:
    ready = a.copter.position_ok
    return dialect.MAVLink_ekf_status_report_message(_EKF_FLAGS_READY if ready else _EKF_FLAGS_WAITING, *([0.0] * 5))


def vibration(a: Autopilot) -> Message:
    return dialect.MAVLink_vibration_message(a.micros(), 0.0, 0.0, 0.0, 0, 0, 0)


def extended_sys_state(a: Autopilot) -> Message:
    copter = a.copter
    if copter.land_complete:
        landed = dialect.MAV_LANDED_STATE_ON_GROUND
    elif copter.mode.landing:
        landed = dialect.MAV_LANDED_STATE_LANDING
    elif copter.mode.taking_off:
        landed = dialect.MAV_LANDED_STATE_TAKEOFF
    else:
        landed = dialect.MAV_LANDED_STATE_IN_AIR
    return dialect.MAVLink_extended_sys_state_message(dialect.MAV_VTOL_STATE_MC, landed)


def rc_channels(a: Autopilot) -> Message:
    return dialect.MAVLink_rc_channels_message(a.millis(), 16, *a.sticks.channels(a.copter.time_s), 255)


def home_position(a: Autopilot) -> Message | None:
    copter = a.copter
    if copter.home is None:
        return None
    n, e, u = copter.local(copter.home)
    return dialect.MAVLink_home_position_message(
        copter.home.lat_e7,
        copter.home.lon_e7,
        round(copter.home.alt_m * 1000),
        n,
        e,
        -u,
        [math.nan] * 4,
        0.0,
        0.0,
        0.0,
        a.micros(),
    )


def gps_global_origin(a: Autopilot) -> Message | None:
    origin = a.copter.origin
    if origin is None:
        return None
    return dialect.MAVLink_gps_global_origin_message(
        origin.lat_e7, origin.lon_e7, round(origin.alt_m * 1000), a.micros()
    )


def sim_state(a: Autopilot) -> Message:
    """Where the simulation truly has it, whatever the receiver says. Latitude and longitude are in 1e-7 degrees in both
    pairs of fields, as ArduPilot has it."""
    body, place = a.copter.body, a.copter.location()
    roll, pitch = body.roll_pitch_rad()
    yaw = math.radians((body.heading_deg + 180) % 360 - 180)
    vn, ve, vu = body.velocity
    return dialect.MAVLink_sim_state_message(
        *([math.nan] * 4),
        roll,
        pitch,
        yaw,
        *([0.0] * 5),
        math.radians(body.yaw_rate_deg_s),
        float(place.lat_e7),
        float(place.lon_e7),
        place.alt_m,
        0.0,
        0.0,
        vn,
        ve,
        -vu,
        place.lat_e7,
        place.lon_e7,
    )


def autopilot_version(a: Autopilot) -> Message:
    version = struct.unpack(">I", bytes((*FIRMWARE, 0)))[0]
    custom = list(b"builtin\0")
    return dialect.MAVLink_autopilot_version_message(CAPABILITIES, version, 0, 0, 0, custom, [0] * 8, [0] * 8, 0, 0, 0)


#: MAV_DATA_STREAM id and parameter suffix of each stream, with the messages it carries.
STREAM_IDS = {
    2: "EXT_STAT",
    6: "POSITION",
    10: "EXTRA1",
    11: "EXTRA2",
    12: "EXTRA3",
    1: "RAW_SENS",
    3: "RC_CHAN",
    4: "RAW_CTRL",
}
STREAMS: dict[str, tuple[int, ...]] = {
    "EXT_STAT": (
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_POWER_STATUS,
        dialect.MAVLINK_MSG_ID_MEMINFO,
        dialect.MAVLINK_MSG_ID_MISSION_CURRENT,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
    ),
    "POSITION": (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
    "RC_CHAN": (dialect.MAVLINK_MSG_ID_RC_CHANNELS,),
    "EXTRA1": (dialect.MAVLINK_MSG_ID_ATTITUDE,),
    "EXTRA2": (dialect.MAVLINK_MSG_ID_VFR_HUD,),
    "EXTRA3": (
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME,
        dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
        dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        dialect.MAVLINK_MSG_ID_VIBRATION,
    ),
}

#: Every message that can be requested or given an interval.
BUILDERS: dict[int, Callable[[Autopilot], Message | None]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    dialect.MAVLINK_MSG_ID_POWER_STATUS: power_status,
    dialect.MAVLINK_MSG_ID_MEMINFO: meminfo,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: mission_current,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: nav_controller_output,
    dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: position_target_global_int,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    dialect.MAVLINK_MSG_ID_ATTITUDE: attitude,
    dialect.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    dialect.MAVLINK_MSG_ID_VIBRATION: vibration,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: rc_channels,
    dialect.MAVLINK_MSG_ID_FENCE_STATUS: fence_status,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    dialect.MAVLINK_MSG_ID_SIM_STATE: sim_state,
}


def send(a: Autopilot, link: Link, message: int) -> None:
    """Build a message by its id and send it on one channel."""
    built = BUILDERS[message](a)
    if built is not None:
        link.send(built)


def send_banner(link: Link) -> None:
    """Firmware name and frame, to one channel."""
    for text in BANNER:
        link.send(dialect.MAVLink_statustext_message(6, text.encode()))

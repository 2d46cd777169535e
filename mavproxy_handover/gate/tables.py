# SPDX-License-Identifier: GPL-3.0-or-later

"""What each message is to the gate: the policy, as data.

Every message of the dialect, every MAV_CMD, every file-transfer opcode and every tunnel payload type has one
row here, by name, with the reason. What has no row is refused, so a message or command that a newer dialect
brings stays outside until somebody gives it one; a name that an older pymavlink lacks is passed over.
`tests/gate/test_policy.py` holds both ends: nothing missing, nothing stale.

What a class means is said at `Access`; who gets what is decided in `judge.py`. Decisions behind the rows:

* No canonical list of "state-changing" messages exists. These rows follow what ArduPilot's message handlers do.
* Messages without a target steer too (estimator inputs, traffic, battery, clock): they are NEVER, except the
  few that a commander's ground station program has to send, which are STREAM.
* A stop from a station that does not command is refused, as in the thesis. Its operator asks for control
  instead; the aircraft's own failsafes need nobody's stop.
* File transfer goes by opcode, because ArduPilot takes missions and parameters through files. Ending a session
  is the commander's; a file that a reader leaves open is closed by the autopilot itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

__all__ = [
    "COMMAND_RULES",
    "COMPANION_COMPID",
    "FTP_OPCODES",
    "FTP_RULES",
    "GUARD_STATUS_TUNNEL",
    "LEASE_TUNNEL",
    "MESSAGES_BY_PART",
    "MESSAGE_RULES",
    "Access",
    "Rule",
]

#: MAVLink component of the companion computer within the vehicle's system.
COMPANION_COMPID: Final = 191

#: TUNNEL payload types of the lease (companion to guard) and of the guard's status (guard to companion).
LEASE_TUNNEL: Final = 47116
GUARD_STATUS_TUNNEL: Final = 47117


class Access(Enum):
    """Who may send something, and what becomes of it."""

    READ = "read"  #: any station; passed on
    LIVENESS = "liveness"  #: the commander's is passed on, any other is only noticed
    COMMAND = "command"  #: the commander's is passed on; anyone else is refused and told so
    STREAM = "stream"  #: the commander's is passed on; anyone else's is dropped in silence, for it is frequent
    ANSWERED = "answered"  #: loads a shared channel: the commander's is passed on, others are refused politely
    TRANSFER = "transfer"  #: any station; the companion's business, never passed on
    CONTROL = "control"  #: operator-control request; any station; the companion's business, never passed on
    MAINTENANCE = "maintenance"  #: over no radio link, whoever sends it
    NEVER = "never"  #: no station has a reason to send it; dropped


@dataclass(frozen=True, slots=True)
class Rule:
    """One row of the policy: names that share a class, and why they are in it."""

    access: Access
    why: str
    names: tuple[str, ...]


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split())


#: Messages that are judged by a part of their contents, and which part.
MESSAGES_BY_PART: Final = {
    "COMMAND_LONG": "command, by COMMAND_RULES",
    "COMMAND_INT": "command, by COMMAND_RULES",
    "COMMAND_ACK": "command: the answer to an operator-control request is the companion's; any other is STREAM, "
    "because the autopilot takes it for the next step of an accelerometer calibration",
    "FILE_TRANSFER_PROTOCOL": "opcode, by FTP_RULES",
    "TUNNEL": "payload type: lease and guard status are NEVER, the rest is MAINTENANCE",
}

MESSAGE_RULES: Final = (
    Rule(
        Access.LIVENESS,
        "keeps the autopilot's GCS failsafe quiet: only the commander's may",
        _names("HEARTBEAT"),
    ),
    Rule(
        Access.READ,
        "clock and link questions",
        _names("PING TIMESYNC"),
    ),
    Rule(
        Access.READ,
        "asks for parameters, missions, fence or rally points, and changes none",
        _names("""
            PARAM_REQUEST_READ PARAM_REQUEST_LIST PARAM_EXT_REQUEST_READ PARAM_EXT_REQUEST_LIST
            MISSION_REQUEST_LIST MISSION_REQUEST MISSION_REQUEST_INT MISSION_REQUEST_PARTIAL_LIST
            FENCE_FETCH_POINT RALLY_FETCH_POINT
        """),
    ),
    Rule(
        Access.READ,
        "ends a mission download",
        _names("MISSION_ACK"),
    ),
    Rule(
        Access.READ,
        "asks for a version, a setting or a terrain height",
        _names("""
            AUTOPILOT_VERSION_REQUEST OSD_PARAM_SHOW_CONFIG GOPRO_GET_REQUEST UAVIONIX_ADSB_GET TERRAIN_CHECK
        """),
    ),
    Rule(
        Access.READ,
        "acknowledges log data that was sent to it",
        _names("LOGGING_ACK"),
    ),
    Rule(
        Access.ANSWERED,
        "rates belong to the autopilot's one channel to us: one station's wish is every station's load",
        _names("REQUEST_DATA_STREAM"),
    ),
    Rule(
        Access.ANSWERED,
        "one log download at a time, and it fills the channel that the lease travels on",
        _names("LOG_REQUEST_LIST LOG_REQUEST_DATA LOG_REQUEST_END"),
    ),
    Rule(
        Access.COMMAND,
        "changes the flight mode",
        _names("SET_MODE"),
    ),
    Rule(
        Access.COMMAND,
        "parameters hold the failsafes, the fence and the GCS id",
        _names("PARAM_SET PARAM_EXT_SET PARAM_MAP_RC"),
    ),
    Rule(
        Access.COMMAND,
        "writes mission, fence or rally points, or moves in the mission",
        _names("""
            MISSION_COUNT MISSION_ITEM MISSION_ITEM_INT MISSION_WRITE_PARTIAL_LIST MISSION_CLEAR_ALL
            MISSION_SET_CURRENT
        """),
    ),
    Rule(
        Access.COMMAND,
        "older ways to write fence, rally points, home, origin and compass offsets",
        _names("""
            FENCE_POINT RALLY_POINT SAFETY_SET_ALLOWED_AREA SET_HOME_POSITION SET_GPS_GLOBAL_ORIGIN
            SET_MAG_OFFSETS
        """),
    ),
    Rule(
        Access.COMMAND,
        "moves or configures the payload",
        _names("""
            MOUNT_CONFIGURE DIGICAM_CONFIGURE DIGICAM_CONTROL GOPRO_SET_REQUEST LED_CONTROL PLAY_TUNE
        """),
    ),
    Rule(
        Access.COMMAND,
        "destroys evidence",
        _names("LOG_ERASE"),
    ),
    Rule(
        Access.COMMAND,
        "changes what the aircraft shows or says it is",
        _names("""
            OSD_PARAM_CONFIG UAVIONIX_ADSB_OUT_CFG UAVIONIX_ADSB_OUT_CFG_REGISTRATION
            UAVIONIX_ADSB_OUT_CFG_FLIGHTID UAVIONIX_ADSB_OUT_CONTROL
        """),
    ),
    Rule(
        Access.COMMAND,
        "the legacy control request, which no flight stack implements, and its password",
        _names("CHANGE_OPERATOR_CONTROL AUTH_KEY"),
    ),
    Rule(
        Access.STREAM,
        "sticks",
        _names("RC_CHANNELS_OVERRIDE MANUAL_CONTROL MANUAL_SETPOINT"),
    ),
    Rule(
        Access.STREAM,
        "guided setpoints; one that comes late after a commit matters most",
        _names("""
            SET_POSITION_TARGET_LOCAL_NED SET_POSITION_TARGET_GLOBAL_INT SET_ATTITUDE_TARGET
            SET_ACTUATOR_CONTROL_TARGET FOLLOW_TARGET
        """),
    ),
    Rule(
        Access.STREAM,
        "gimbal setpoints",
        _names("""
            GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
            GIMBAL_DEVICE_SET_ATTITUDE GIMBAL_CONTROL MOUNT_CONTROL
        """),
    ),
    Rule(
        Access.STREAM,
        "GPS corrections: they move the position, so one source",
        _names("GPS_RTCM_DATA GPS_INJECT_DATA"),
    ),
    Rule(
        Access.STREAM,
        "heights the autopilot flies by, sent when it asks for them",
        _names("TERRAIN_DATA"),
    ),
    Rule(
        Access.STREAM,
        "who flies and where from, as broadcast by the aircraft",
        _names("""
            OPEN_DRONE_ID_BASIC_ID OPEN_DRONE_ID_LOCATION OPEN_DRONE_ID_AUTHENTICATION OPEN_DRONE_ID_SELF_ID
            OPEN_DRONE_ID_SYSTEM OPEN_DRONE_ID_OPERATOR_ID OPEN_DRONE_ID_MESSAGE_PACK
            OPEN_DRONE_ID_SYSTEM_UPDATE UAVIONIX_ADSB_OUT_DYNAMIC
        """),
    ),
    Rule(
        Access.TRANSFER,
        "ours, from stations: the companion's own business",
        _names("""
            CONNECT CONNECT_ACK MISSION_PACKAGE MISSION_CHUNK MISSION_PACKAGE_ACK ON_HANDOVER OK_HANDOVER
            DRONE_CONNECTED DISCONNECT_HANDOVER
        """),
    ),
    Rule(
        Access.MAINTENANCE,
        "keys and signed administration; the autopilot would apply them to all its links",
        _names("SETUP_SIGNING SECURE_COMMAND"),
    ),
    Rule(
        Access.MAINTENANCE,
        "raw access to a bus or a serial port",
        _names("SERIAL_CONTROL DEVICE_OP_READ DEVICE_OP_WRITE CAN_FRAME CANFD_FRAME CAN_FILTER_MODIFY"),
    ),
    Rule(
        Access.MAINTENANCE,
        "carries contents that no table can judge",
        _names("V2_EXTENSION"),
    ),
    Rule(
        Access.MAINTENANCE,
        "simulated sensors and controls in place of the real ones",
        _names("""
            HIL_STATE HIL_CONTROLS HIL_RC_INPUTS_RAW HIL_ACTUATOR_CONTROLS HIL_SENSOR HIL_GPS HIL_OPTICAL_FLOW
            HIL_STATE_QUATERNION
        """),
    ),
    Rule(
        Access.MAINTENANCE,
        "starts a stream of log blocks, a firmware update or another radio network",
        _names("REMOTE_LOG_BLOCK_STATUS CUBEPILOT_FIRMWARE_UPDATE_START WIFI_CONFIG_AP"),
    ),
    Rule(
        Access.NEVER,
        "ours, from the vehicle to stations: whoever sends it here pretends to be the vehicle",
        _names("""
            AUTHORITY_STATUS CONTROL_STATUS HANDOVER_TELEMETRY HANDOVER_REQUEST CONNECT_HANDOVER
            HANDOVER_RESULT
        """),
    ),
    Rule(
        Access.NEVER,
        "feeds position, attitude or range to the autopilot's estimator or to its avoidance",
        _names("""
            GPS_INPUT GLOBAL_VISION_POSITION_ESTIMATE VISION_POSITION_ESTIMATE VISION_SPEED_ESTIMATE
            VISION_POSITION_DELTA VICON_POSITION_ESTIMATE ODOMETRY ATT_POS_MOCAP OPTICAL_FLOW OPTICAL_FLOW_RAD
            GLOBAL_POSITION_SENSOR LANDING_TARGET DISTANCE_SENSOR RANGEFINDER OBSTACLE_DISTANCE
            OBSTACLE_DISTANCE_3D TRAJECTORY_REPRESENTATION_WAYPOINTS TRAJECTORY_REPRESENTATION_BEZIER
            WHEEL_DISTANCE WATER_DEPTH
        """),
    ),
    Rule(
        Access.NEVER,
        "other traffic: the autopilot flies after it or away from it",
        _names("""
            GLOBAL_POSITION_INT ADSB_VEHICLE COLLISION AIS_VESSEL UTM_GLOBAL_POSITION ICAROUS_HEARTBEAT
            ICAROUS_KINEMATIC_BANDS UAVIONIX_ADSB_TRANSCEIVER_HEALTH_REPORT UAVIONIX_ADSB_OUT_STATUS
        """),
    ),
    Rule(
        Access.NEVER,
        "feeds battery, engine, air data or the clock; a false one starts or hides a failsafe",
        _names("""
            BATTERY_STATUS SMART_BATTERY_INFO EFI_STATUS GENERATOR_STATUS LOWEHEISER_GOV_EFI SYSTEM_TIME
            AIRSPEED WIND_COV HYGROMETER_SENSOR
        """),
    ),
    Rule(
        Access.NEVER,
        "the modem's: it throttles the autopilot's streams",
        _names("RADIO_STATUS RADIO"),
    ),
    Rule(
        Access.NEVER,
        "read by scripts, or written into the flight log as if the aircraft had said it",
        _names("""
            NAMED_VALUE_FLOAT NAMED_VALUE_INT NAMED_VALUE_STRING STATUSTEXT DEBUG DEBUG_VECT DEBUG_FLOAT_ARRAY
            MEMORY_VECT
        """),
    ),
    Rule(
        Access.NEVER,
        "from a gimbal, a camera or another component of the aircraft, which sit behind the companion",
        _names("""
            PARAM_VALUE PARAM_EXT_VALUE PARAM_EXT_ACK PARAM_ERROR GIMBAL_REPORT GIMBAL_TORQUE_CMD_REPORT
            GIMBAL_MANAGER_INFORMATION GIMBAL_MANAGER_STATUS GIMBAL_DEVICE_INFORMATION
            GIMBAL_DEVICE_ATTITUDE_STATUS AUTOPILOT_STATE_FOR_GIMBAL_DEVICE MOUNT_STATUS MOUNT_ORIENTATION
            GOPRO_HEARTBEAT GOPRO_GET_RESPONSE GOPRO_SET_RESPONSE CAMERA_STATUS CAMERA_FEEDBACK CAMERA_TRIGGER
            CAMERA_INFORMATION CAMERA_SETTINGS CAMERA_CAPTURE_STATUS CAMERA_IMAGE_CAPTURED CAMERA_FOV_STATUS
            CAMERA_TRACKING_IMAGE_STATUS CAMERA_TRACKING_GEO_STATUS CAMERA_THERMAL_RANGE STORAGE_INFORMATION
            VIDEO_STREAM_INFORMATION VIDEO_STREAM_STATUS HERELINK_VIDEO_STREAM_INFORMATION HERELINK_TELEM
            CUBEPILOT_RAW_RC CUBEPILOT_FIRMWARE_UPDATE_RESP AIRLINK_AUTH AIRLINK_AUTH_RESPONSE
            OPEN_DRONE_ID_ARM_STATUS ONBOARD_COMPUTER_STATUS WINCH_STATUS BUTTON_CHANGE UAVCAN_NODE_STATUS
            UAVCAN_NODE_INFO
        """),
    ),
    Rule(
        Access.NEVER,
        "the vehicle's own telemetry and answers; from a station they are a mistake or a lie",
        _names("""
            SYS_STATUS CHANGE_OPERATOR_CONTROL_ACK GPS_RAW_INT GPS_STATUS SCALED_IMU RAW_IMU RAW_PRESSURE
            SCALED_PRESSURE ATTITUDE ATTITUDE_QUATERNION LOCAL_POSITION_NED RC_CHANNELS_SCALED RC_CHANNELS_RAW
            SERVO_OUTPUT_RAW MISSION_CURRENT MISSION_ITEM_REACHED GPS_GLOBAL_ORIGIN SAFETY_ALLOWED_AREA
            ATTITUDE_QUATERNION_COV NAV_CONTROLLER_OUTPUT GLOBAL_POSITION_INT_COV LOCAL_POSITION_NED_COV
            RC_CHANNELS DATA_STREAM VFR_HUD ATTITUDE_TARGET POSITION_TARGET_LOCAL_NED
            POSITION_TARGET_GLOBAL_INT LOCAL_POSITION_NED_SYSTEM_GLOBAL_OFFSET HIGHRES_IMU SIM_STATE
            SCALED_IMU2 LOG_ENTRY LOG_DATA GPS2_RAW POWER_STATUS GPS_RTK GPS2_RTK SCALED_IMU3
            DATA_TRANSMISSION_HANDSHAKE ENCAPSULATED_DATA TERRAIN_REQUEST TERRAIN_REPORT SCALED_PRESSURE2
            ACTUATOR_CONTROL_TARGET ALTITUDE RESOURCE_REQUEST SCALED_PRESSURE3 CONTROL_SYSTEM_STATE
            AUTOPILOT_VERSION SENSOR_OFFSETS MEMINFO AP_ADC FENCE_STATUS AHRS SIMSTATE HWSTATUS LIMITS_STATUS
            WIND DATA16 DATA32 DATA64 DATA96 AIRSPEED_AUTOCAL COMPASSMOT_STATUS AHRS2 BATTERY2 AHRS3
            REMOTE_LOG_DATA_BLOCK MAG_CAL_PROGRESS MAG_CAL_REPORT EKF_STATUS_REPORT PID_TUNING DEEPSTALL RPM
            ESTIMATOR_STATUS HIGH_LATENCY HIGH_LATENCY2 VIBRATION HOME_POSITION MESSAGE_INTERVAL
            EXTENDED_SYS_STATE FLIGHT_INFORMATION LOGGING_DATA LOGGING_DATA_ACKED ISBD_LINK_STATUS RAW_RPM
            ORBIT_EXECUTION_STATUS ACTUATOR_OUTPUT_STATUS RELAY_STATUS DEVICE_OP_READ_REPLY
            DEVICE_OP_WRITE_REPLY SECURE_COMMAND_REPLY ADAP_TUNING AOA_SSA ESC_TELEMETRY_1_TO_4
            ESC_TELEMETRY_5_TO_8 ESC_TELEMETRY_9_TO_12 OSD_PARAM_CONFIG_REPLY OSD_PARAM_SHOW_CONFIG_REPLY
            MCU_STATUS ESC_TELEMETRY_13_TO_16 ESC_TELEMETRY_17_TO_20 ESC_TELEMETRY_21_TO_24
            ESC_TELEMETRY_25_TO_28 ESC_TELEMETRY_29_TO_32
        """),
    ),
)

#: Commands, in COMMAND_LONG and COMMAND_INT alike. Names without their MAV_CMD_.
COMMAND_RULES: Final = (
    Rule(
        Access.READ,
        "asks for a message, a version or a state, and changes none",
        _names("""
            REQUEST_MESSAGE GET_MESSAGE_INTERVAL REQUEST_PROTOCOL_VERSION REQUEST_AUTOPILOT_CAPABILITIES
            REQUEST_CAMERA_INFORMATION REQUEST_CAMERA_SETTINGS REQUEST_STORAGE_INFORMATION
            REQUEST_CAMERA_CAPTURE_STATUS REQUEST_FLIGHT_INFORMATION REQUEST_VIDEO_STREAM_INFORMATION
            REQUEST_VIDEO_STREAM_STATUS GET_HOME_POSITION UAVCAN_GET_NODE_INFO DO_SEND_BANNER
        """),
    ),
    Rule(
        Access.ANSWERED,
        "rates belong to the autopilot's one channel to us: one station's wish is every station's load",
        _names("SET_MESSAGE_INTERVAL"),
    ),
    Rule(
        Access.CONTROL,
        "the operator-control standard: the companion is the system manager that answers it",
        _names("REQUEST_OPERATOR_CONTROL"),
    ),
    Rule(
        Access.MAINTENANCE,
        "rewrites the boot loader or stops the processor",
        _names("FLASH_BOOTLOADER DEBUG_TRAP SET_FACTORY_TEST_MODE"),
    ),
    Rule(
        Access.MAINTENANCE,
        "opens a bus, binds a receiver, or wipes storage",
        _names("CAN_FORWARD START_RX_PAIR STORAGE_FORMAT"),
    ),
    Rule(
        Access.MAINTENANCE,
        "stops the guard: scripting can be halted by it",
        _names("SCRIPTING"),
    ),
    Rule(
        Access.MAINTENANCE,
        "breaks sensors on purpose",
        _names("INJECT_FAILURE"),
    ),
    Rule(
        Access.COMMAND,
        "arms, disarms, ends the flight, or changes the mode",
        _names("""
            DO_SET_MODE DO_FLIGHTTERMINATION DO_PARACHUTE DO_SET_STANDARD_MODE COMPONENT_ARM_DISARM
            RUN_PREARM_CHECKS ARM_AUTHORIZATION_REQUEST DO_SET_SAFETY_SWITCH_STATE
        """),
    ),
    Rule(
        Access.COMMAND,
        "starts, stops, continues or moves in the mission; a stop too is the commander's alone (thesis 6.1)",
        _names("""
            DO_JUMP DO_GO_AROUND DO_PAUSE_CONTINUE DO_SET_MISSION_CURRENT OVERRIDE_GOTO MISSION_START JUMP_TAG
            DO_JUMP_TAG
        """),
    ),
    Rule(
        Access.COMMAND,
        "flies: the same as a mission item, done at once",
        _names("""
            NAV_WAYPOINT NAV_LOITER_UNLIM NAV_LOITER_TURNS NAV_LOITER_TIME NAV_RETURN_TO_LAUNCH NAV_LAND
            NAV_TAKEOFF NAV_LAND_LOCAL NAV_TAKEOFF_LOCAL NAV_FOLLOW NAV_CONTINUE_AND_CHANGE_ALT
            NAV_LOITER_TO_ALT DO_FOLLOW DO_FOLLOW_REPOSITION DO_ORBIT DO_FIGURE_EIGHT NAV_ARC_WAYPOINT NAV_ROI
            NAV_PATHPLANNING NAV_SPLINE_WAYPOINT NAV_ALTITUDE_WAIT NAV_VTOL_TAKEOFF NAV_VTOL_LAND
            NAV_GUIDED_ENABLE NAV_DELAY NAV_PAYLOAD_PLACE NAV_LAST CONDITION_DELAY CONDITION_CHANGE_ALT
            CONDITION_DISTANCE CONDITION_YAW CONDITION_LAST DO_CHANGE_SPEED DO_CHANGE_ALTITUDE
            DO_RETURN_PATH_START DO_LAND_START DO_RALLY_LAND DO_REPOSITION DO_SET_REVERSE DO_INVERTED_FLIGHT
            NAV_SET_YAW_SPEED DO_SET_RESUME_REPEAT_DIST DO_GUIDED_MASTER DO_GUIDED_LIMITS DO_LAST
            OBLIQUE_SURVEY PANORAMA_CREATE DO_VTOL_TRANSITION SET_GUIDED_SUBMODE_STANDARD
            SET_GUIDED_SUBMODE_CIRCLE CONDITION_GATE NAV_FENCE_RETURN_POINT NAV_FENCE_POLYGON_VERTEX_INCLUSION
            NAV_FENCE_POLYGON_VERTEX_EXCLUSION NAV_FENCE_CIRCLE_INCLUSION NAV_FENCE_CIRCLE_EXCLUSION
            NAV_RALLY_POINT WAYPOINT_USER_1 WAYPOINT_USER_2 WAYPOINT_USER_3 WAYPOINT_USER_4 WAYPOINT_USER_5
            SPATIAL_USER_1 SPATIAL_USER_2 SPATIAL_USER_3 SPATIAL_USER_4 SPATIAL_USER_5 NAV_SCRIPT_TIME
            NAV_ATTITUDE_TIME GUIDED_CHANGE_SPEED GUIDED_CHANGE_ALTITUDE GUIDED_CHANGE_HEADING
        """),
    ),
    Rule(
        Access.COMMAND,
        "changes home, fence, estimator, parameters or rates of the autopilot",
        _names("""
            DO_SET_HOME DO_SET_PARAMETER DO_FENCE_ENABLE DO_AUTOTUNE_ENABLE DO_SEND_SCRIPT_MESSAGE
            DO_AUX_FUNCTION LOGGING_START LOGGING_STOP AIRFRAME_CONFIGURATION CONTROL_HIGH_LATENCY
            DO_ADSB_OUT_IDENT SET_EKF_SOURCE_SET BATTERY_RESET EXTERNAL_POSITION_ESTIMATE SET_HAGL
        """),
    ),
    Rule(
        Access.COMMAND,
        "calibrates, tests or restarts; the autopilot itself refuses what is unsafe in flight",
        _names("""
            DO_MOTOR_TEST PREFLIGHT_CALIBRATION PREFLIGHT_SET_SENSOR_OFFSETS PREFLIGHT_UAVCAN
            PREFLIGHT_STORAGE PREFLIGHT_REBOOT_SHUTDOWN ACTUATOR_TEST CONFIGURE_ACTUATOR POWER_OFF_INITIATED
            FIXED_MAG_CAL FIXED_MAG_CAL_FIELD FIXED_MAG_CAL_YAW DO_START_MAG_CAL DO_ACCEPT_MAG_CAL
            DO_CANCEL_MAG_CAL ACCELCAL_VEHICLE_POS GIMBAL_RESET GIMBAL_AXIS_CALIBRATION_STATUS
            GIMBAL_REQUEST_AXIS_CALIBRATION GIMBAL_FULL_RESET
        """),
    ),
    Rule(
        Access.COMMAND,
        "drives an output or the payload",
        _names("""
            DO_SET_RELAY DO_REPEAT_RELAY DO_SET_SERVO DO_REPEAT_SERVO DO_SET_ACTUATOR DO_GRIPPER DO_SPRAYER
            DO_ENGINE_CONTROL ILLUMINATOR_ON_OFF DO_ILLUMINATOR_CONFIGURE LOWEHEISER_SET_STATE
            PAYLOAD_PREPARE_DEPLOY PAYLOAD_CONTROL_DEPLOY DO_WINCH
        """),
    ),
    Rule(
        Access.COMMAND,
        "points or works a camera or gimbal",
        _names("""
            DO_SET_ROI_LOCATION DO_SET_ROI_WPNEXT_OFFSET DO_SET_ROI_NONE DO_SET_ROI_SYSID DO_CONTROL_VIDEO
            DO_SET_ROI DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL
            DO_SET_CAM_TRIGG_DIST DO_SET_CAM_TRIGG_INTERVAL DO_MOUNT_CONTROL_QUAT RESET_CAMERA_SETTINGS
            SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS SET_STORAGE_USAGE SET_CAMERA_SOURCE
            DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE
            REQUEST_CAMERA_IMAGE_CAPTURE DO_TRIGGER_CONTROL CAMERA_TRACK_POINT CAMERA_TRACK_RECTANGLE
            CAMERA_STOP_TRACKING VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE VIDEO_START_STREAMING
            VIDEO_STOP_STREAMING
        """),
    ),
    Rule(
        Access.COMMAND,
        "buttons and users' own commands: what they do is not known here",
        _names("""
            USER_1 USER_2 USER_3 USER_4 USER_5 SOLO_BTN_FLY_CLICK SOLO_BTN_FLY_HOLD SOLO_BTN_PAUSE_CLICK
        """),
    ),
)

#: File-transfer opcodes by number (MAVLink file transfer protocol, FtpOpcode).
FTP_OPCODES: Final = {
    0: "None",
    1: "TerminateSession",
    2: "ResetSessions",
    3: "ListDirectory",
    4: "OpenFileRO",
    5: "ReadFile",
    6: "CreateFile",
    7: "WriteFile",
    8: "RemoveFile",
    9: "CreateDirectory",
    10: "RemoveDirectory",
    11: "OpenFileWO",
    12: "TruncateFile",
    13: "Rename",
    14: "CalcFileCRC32",
    15: "BurstReadFile",
    16: "ListDirectoryWithTime",
    128: "Ack",
    129: "Nak",
}

FTP_RULES: Final = (
    Rule(
        Access.READ,
        "reads files and directories",
        _names("None ListDirectory OpenFileRO ReadFile CalcFileCRC32 BurstReadFile ListDirectoryWithTime"),
    ),
    Rule(
        Access.COMMAND,
        "writes files; ArduPilot takes missions, fences and parameters through files too",
        _names("""
            CreateFile WriteFile RemoveFile CreateDirectory RemoveDirectory OpenFileWO TruncateFile Rename
        """),
    ),
    Rule(
        Access.COMMAND,
        "older firmware has one open file for everybody: to end it may end the commander's upload",
        _names("TerminateSession ResetSessions"),
    ),
    Rule(Access.NEVER, "a server's answer, and no station is a server", _names("Ack Nak")),
)

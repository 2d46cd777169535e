# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of messages that only their id decides. `Access` explains the classes.

Messages without a target also steer (estimator inputs, traffic, battery, clock). They are NEVER, except the few that a
commander's ground station program must send, which are STREAM.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.gate.policy.access import Access, Rule, names

__all__ = ["FEED_MESSAGES", "MESSAGE_RULES"]

#: The messages of each kind of feed, by its key in `[feeds]`.
FEED_MESSAGES: Final = {
    "rtk": "GPS_RTCM_DATA GPS_INJECT_DATA",
    "adsb": "ADSB_VEHICLE",
    "terrain": "TERRAIN_DATA",
    "weather": "WIND_COV HYGROMETER_SENSOR",
}

MESSAGE_RULES: Final = (
    Rule(
        Access.LIVENESS,
        "keeps the autopilot's GCS failsafe quiet: only the commander's may",
        names("HEARTBEAT"),
    ),
    Rule(
        Access.READ,
        "clock and link questions",
        names("PING TIMESYNC"),
    ),
    Rule(
        Access.READ,
        "asks for one parameter, or for one point of the fence, and changes none",
        names("PARAM_REQUEST_READ PARAM_EXT_REQUEST_READ FENCE_FETCH_POINT"),
    ),
    Rule(
        Access.BULK,
        "asks for a whole list at once; while ArduPilot sends parameters, its streams have a quarter of their rates",
        names("PARAM_REQUEST_LIST PARAM_EXT_REQUEST_LIST MISSION_REQUEST_PARTIAL_LIST"),
    ),
    Rule(
        Access.READ,
        "asks for a version or a setting",
        names("AUTOPILOT_VERSION_REQUEST OSD_PARAM_SHOW_CONFIG GOPRO_GET_REQUEST UAVIONIX_ADSB_GET"),
    ),
    Rule(
        Access.BULK,
        "loads the height of any place, and puts those that the aircraft flies by out of memory",
        names("TERRAIN_CHECK"),
    ),
    Rule(
        Access.BULK,
        "asks again for all events that it has missed",
        names("REQUEST_EVENT"),
    ),
    Rule(
        Access.READ,
        "acknowledges log data that was sent to it",
        names("LOGGING_ACK"),
    ),
    Rule(
        Access.ANSWERED,
        "rates belong to the autopilot's one channel to us: one station's wish is every station's load",
        names("REQUEST_DATA_STREAM"),
    ),
    Rule(
        Access.LOG,
        "one log download at a time, and it fills the channel that the lease travels on",
        names("LOG_REQUEST_LIST LOG_REQUEST_DATA LOG_REQUEST_END"),
    ),
    Rule(
        Access.COMMAND,
        "changes the flight mode",
        names("SET_MODE"),
    ),
    Rule(
        Access.COMMAND,
        "moves in the mission",
        names("MISSION_SET_CURRENT"),
    ),
    Rule(
        Access.COMMAND,
        "ends a command that is being carried out, of any sender",
        names("COMMAND_CANCEL"),
    ),
    Rule(
        Access.SAFEGUARD,
        "limits how fast the aircraft flies and turns, without a check",
        names("SET_VELOCITY_LIMITS"),
    ),
    Rule(
        Access.SAFEGUARD,
        "older ways to write fence, home, origin and compass offsets, past what judges an upload",
        names("FENCE_POINT SAFETY_SET_ALLOWED_AREA SET_HOME_POSITION SET_GPS_GLOBAL_ORIGIN SET_MAG_OFFSETS"),
    ),
    Rule(
        Access.MAINTENANCE,
        "older ways to read and write the autopilot's own rally list, past the companion's",
        names("RALLY_POINT RALLY_FETCH_POINT"),
    ),
    Rule(
        Access.COMMAND,
        "moves or configures the payload",
        names("""
            MOUNT_CONFIGURE DIGICAM_CONFIGURE DIGICAM_CONTROL GOPRO_SET_REQUEST LED_CONTROL PLAY_TUNE
            PLAY_TUNE_V2
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "destroys the record of the flight, and keeps the logger busy for minutes",
        names("LOG_ERASE"),
    ),
    Rule(
        Access.COMMAND,
        "changes what the aircraft shows or says it is",
        names("""
            OSD_PARAM_CONFIG UAVIONIX_ADSB_OUT_CFG UAVIONIX_ADSB_OUT_CFG_REGISTRATION
            UAVIONIX_ADSB_OUT_CFG_FLIGHTID UAVIONIX_ADSB_OUT_CONTROL
        """),
    ),
    Rule(
        Access.COMMAND,
        "the legacy control request, which no flight stack implements, and its password",
        names("CHANGE_OPERATOR_CONTROL AUTH_KEY"),
    ),
    Rule(
        Access.STREAM,
        "sticks, channel by channel, in place of the pilot's",
        names("RC_CHANNELS_OVERRIDE RC_CHANNELS_OVERRIDE_V2"),
        stream="RC override",
    ),
    Rule(
        Access.STREAM,
        "sticks of a joystick",
        names("MANUAL_CONTROL MANUAL_SETPOINT"),
        stream="manual control",
    ),
    Rule(
        Access.STREAM,
        "guided setpoints: place, velocity or acceleration; one that comes late after a commit matters most",
        names("SET_POSITION_TARGET_LOCAL_NED SET_POSITION_TARGET_GLOBAL_INT"),
        stream="position target",
    ),
    Rule(
        Access.STREAM,
        "guided setpoints: attitude and thrust",
        names("SET_ATTITUDE_TARGET"),
        stream="attitude target",
    ),
    Rule(
        Access.STREAM,
        "guided setpoints: outputs",
        names("SET_ACTUATOR_CONTROL_TARGET"),
        stream="actuator target",
    ),
    Rule(
        Access.STREAM,
        "the place of the system that the aircraft follows",
        names("FOLLOW_TARGET"),
        stream="follow target",
    ),
    Rule(
        Access.STREAM,
        "gimbal setpoints",
        names("""
            GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
            GIMBAL_DEVICE_SET_ATTITUDE GIMBAL_CONTROL MOUNT_CONTROL
        """),
        stream="gimbal target",
    ),
    Rule(
        Access.FEED,
        "GPS corrections: they move the position, so one source",
        names(FEED_MESSAGES["rtk"]),
    ),
    Rule(
        Access.FEED,
        "heights the autopilot flies by, sent when it asks for them",
        names(FEED_MESSAGES["terrain"]),
    ),
    Rule(
        Access.FEED,
        "traffic that a receiver on the ground hears: the autopilot may fly away from it",
        names(FEED_MESSAGES["adsb"]),
    ),
    Rule(
        Access.FEED,
        "weather that a station measures, for scripts of the vehicle",
        names(FEED_MESSAGES["weather"]),
    ),
    Rule(
        Access.STREAM,
        "the operator and its position, as the aircraft broadcasts them",
        names("""
            OPEN_DRONE_ID_BASIC_ID OPEN_DRONE_ID_LOCATION OPEN_DRONE_ID_AUTHENTICATION OPEN_DRONE_ID_SELF_ID
            OPEN_DRONE_ID_SYSTEM OPEN_DRONE_ID_OPERATOR_ID OPEN_DRONE_ID_MESSAGE_PACK
            OPEN_DRONE_ID_SYSTEM_UPDATE UAVIONIX_ADSB_OUT_DYNAMIC
        """),
    ),
    Rule(
        Access.TRANSFER,
        "ours, from stations: the companion's own business",
        names("""
            CONNECT CONNECT_ACK MISSION_PACKAGE MISSION_CHUNK MISSION_PACKAGE_ACK ON_HANDOVER OK_HANDOVER
            DRONE_CONNECTED DISCONNECT_HANDOVER HANDOVER_OVERRIDE OK_AHEAD HANDOVER_REHEARSE
            HANDOVER_DELEGATE
        """),
    ),
    Rule(
        Access.MAINTENANCE,
        "keys and signed administration; the autopilot would apply them to all its links",
        names("SETUP_SIGNING SECURE_COMMAND"),
    ),
    Rule(
        Access.MAINTENANCE,
        "raw access to a bus or a serial port",
        names("SERIAL_CONTROL DEVICE_OP_READ DEVICE_OP_WRITE CAN_FRAME CANFD_FRAME CAN_FILTER_MODIFY"),
    ),
    Rule(
        Access.MAINTENANCE,
        "carries contents that no table can judge",
        names("V2_EXTENSION"),
    ),
    Rule(
        Access.MAINTENANCE,
        "simulated sensors and controls in place of the real ones",
        names("""
            HIL_STATE HIL_CONTROLS HIL_RC_INPUTS_RAW HIL_ACTUATOR_CONTROLS HIL_SENSOR HIL_GPS HIL_OPTICAL_FLOW
            HIL_STATE_QUATERNION
        """),
    ),
    Rule(
        Access.MAINTENANCE,
        "starts a stream of log blocks, a firmware update or another radio network",
        names("REMOTE_LOG_BLOCK_STATUS CUBEPILOT_FIRMWARE_UPDATE_START WIFI_CONFIG_AP CELLULAR_CONFIG"),
    ),
    Rule(
        Access.MAINTENANCE,
        "writes the memory of the motors' speed controllers",
        names("ESC_EEPROM"),
    ),
    Rule(
        Access.NEVER,
        "ours, from the vehicle to stations: a sender of it here pretends to be the vehicle",
        names("""
            AUTHORITY_STATUS CONTROL_STATUS HANDOVER_TELEMETRY HANDOVER_REQUEST CONNECT_HANDOVER
            HANDOVER_RESULT HANDOVER_DECISION HANDOVER_AHEAD HANDOVER_BRIEFING HANDOVER_REHEARSAL
        """),
    ),
    Rule(
        Access.NEVER,
        "ours, between stations: the vehicle does not use it",
        names("STATION_OPERATOR"),
    ),
    Rule(
        Access.NEVER,
        "feeds position, attitude or range to the autopilot's estimator or to its avoidance",
        names("""
            GPS_INPUT GLOBAL_VISION_POSITION_ESTIMATE VISION_POSITION_ESTIMATE VISION_SPEED_ESTIMATE
            VISION_POSITION_DELTA VICON_POSITION_ESTIMATE ODOMETRY ATT_POS_MOCAP OPTICAL_FLOW OPTICAL_FLOW_RAD
            GLOBAL_POSITION_SENSOR LANDING_TARGET DISTANCE_SENSOR RANGEFINDER OBSTACLE_DISTANCE
            OBSTACLE_DISTANCE_3D TRAJECTORY_REPRESENTATION_WAYPOINTS TRAJECTORY_REPRESENTATION_BEZIER
            WHEEL_DISTANCE WATER_DEPTH RANGING_BEACON TARGET_ABSOLUTE TARGET_RELATIVE
        """),
        told=True,
    ),
    Rule(
        Access.NEVER,
        "other traffic: the autopilot flies after it or away from it",
        names("""
            GLOBAL_POSITION_INT COLLISION AIS_VESSEL UTM_GLOBAL_POSITION ICAROUS_HEARTBEAT
            ICAROUS_KINEMATIC_BANDS UAVIONIX_ADSB_TRANSCEIVER_HEALTH_REPORT UAVIONIX_ADSB_OUT_STATUS
        """),
        told=True,
    ),
    Rule(
        Access.NEVER,
        "feeds battery, engine, air data or the clock; a false one starts or hides a failsafe",
        names("""
            BATTERY_STATUS BATTERY_STATUS_V2 BATTERY_INFO SMART_BATTERY_INFO FUEL_STATUS EFI_STATUS
            GENERATOR_STATUS LOWEHEISER_GOV_EFI SYSTEM_TIME AIRSPEED
        """),
        told=True,
    ),
    Rule(
        Access.NEVER,
        "the modem's: it throttles the autopilot's streams",
        names("RADIO_STATUS RADIO"),
    ),
    Rule(
        Access.NEVER,
        "the radio receiver's: its sender is the pilot, for the autopilot and the guard",
        names("RADIO_RC_CHANNELS"),
    ),
    Rule(
        Access.NEVER,
        "read by scripts, or written into the flight log as if the aircraft had said it",
        names("""
            NAMED_VALUE_FLOAT NAMED_VALUE_INT NAMED_VALUE_STRING STATUSTEXT DEBUG DEBUG_VECT DEBUG_FLOAT_ARRAY
            MEMORY_VECT
        """),
        told=True,
    ),
    Rule(
        Access.NEVER,
        "from a gimbal, a camera or another component of the aircraft, never from a station",
        names("""
            PARAM_VALUE PARAM_EXT_VALUE PARAM_EXT_ACK PARAM_ERROR GIMBAL_REPORT GIMBAL_TORQUE_CMD_REPORT
            GIMBAL_MANAGER_INFORMATION GIMBAL_MANAGER_STATUS GIMBAL_DEVICE_INFORMATION
            GIMBAL_DEVICE_ATTITUDE_STATUS AUTOPILOT_STATE_FOR_GIMBAL_DEVICE MOUNT_STATUS MOUNT_ORIENTATION
            GOPRO_HEARTBEAT GOPRO_GET_RESPONSE GOPRO_SET_RESPONSE CAMERA_STATUS CAMERA_FEEDBACK CAMERA_TRIGGER
            CAMERA_INFORMATION CAMERA_SETTINGS CAMERA_CAPTURE_STATUS CAMERA_IMAGE_CAPTURED CAMERA_FOV_STATUS
            CAMERA_TRACKING_IMAGE_STATUS CAMERA_TRACKING_GEO_STATUS CAMERA_THERMAL_RANGE STORAGE_INFORMATION
            VIDEO_STREAM_INFORMATION VIDEO_STREAM_STATUS HERELINK_VIDEO_STREAM_INFORMATION HERELINK_TELEM
            CUBEPILOT_RAW_RC CUBEPILOT_FIRMWARE_UPDATE_RESP AIRLINK_AUTH AIRLINK_AUTH_RESPONSE
            OPEN_DRONE_ID_ARM_STATUS ONBOARD_COMPUTER_STATUS WINCH_STATUS BUTTON_CHANGE UAVCAN_NODE_STATUS
            UAVCAN_NODE_INFO LINK_NODE_STATUS CELLULAR_STATUS COMPONENT_INFORMATION COMPONENT_INFORMATION_BASIC
            COMPONENT_METADATA SUPPORTED_TUNES ILLUMINATOR_STATUS ESC_INFO ESC_STATUS
        """),
    ),
    Rule(
        Access.NEVER,
        "the vehicle's own telemetry and answers; from a station they are a mistake or a lie",
        names("""
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
            ESC_TELEMETRY_25_TO_28 ESC_TELEMETRY_29_TO_32 PROTOCOL_VERSION MISSION_CHECKSUM AVAILABLE_MODES
            AVAILABLE_MODES_MONITOR CURRENT_MODE GNSS_INTEGRITY ESTIMATOR_SENSOR_FUSION_STATUS VELOCITY_LIMITS
            FIGURE_EIGHT_EXECUTION_STATUS TIME_ESTIMATE_TO_TARGET GROUP_START GROUP_END EVENT
            CURRENT_EVENT_SEQUENCE RESPONSE_EVENT_ERROR
        """),
    ),
)

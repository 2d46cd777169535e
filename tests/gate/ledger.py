# SPDX-License-Identifier: GPL-3.0-or-later

"""A second book-keeping of the policy, for the tests.

The lists below are written out by hand and on purpose not taken from the tables of `mavproxy_handover.gate`: what
those say and what is expected here are two entries for the same thing, and a slip in one shows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity
from mavproxy_handover.gate.policy.access import Access
from tests.gate.frames import ftp_request

VEHICLE = 1
GCSA, GCSB, GCSC = 251, 252, 253
TRACKER_OF_A, TRACKER_OF_B = 241, 242

A = StationIdentity(GCSA, frozenset({GCSA, TRACKER_OF_A}))
B = StationIdentity(GCSB, frozenset({GCSB, TRACKER_OF_B}))
C = StationIdentity(GCSC)


def listed(text: str) -> list[str]:
    return text.split()


# --- what everybody may send, and it reaches the autopilot
PASS_MESSAGES = listed("""
    PING TIMESYNC PARAM_REQUEST_READ PARAM_EXT_REQUEST_READ FENCE_FETCH_POINT AUTOPILOT_VERSION_REQUEST
    OSD_PARAM_SHOW_CONFIG GOPRO_GET_REQUEST UAVIONIX_ADSB_GET LOGGING_ACK
""")
PASS_COMMANDS = [512, 519, 520, 521, 522, 525, 527, 528, 2504, 2505, 410]

# --- what slows down or empties something at the autopilot: everybody's on the ground, in flight the commander's alone
BULK_MESSAGES = listed("""
    PARAM_REQUEST_LIST PARAM_EXT_REQUEST_LIST MISSION_REQUEST_PARTIAL_LIST REQUEST_EVENT TERRAIN_CHECK
""")
#: UAVCAN_GET_NODE_INFO, DO_SEND_BANNER
BULK_COMMANDS = [5200, 42428]
BULK_OPCODES = [0, 3, 4, 5, 14, 15, 16]

# --- the commander's alone; anyone else is told
TOLD_MESSAGES = listed("""
    SET_MODE MOUNT_CONFIGURE DIGICAM_CONFIGURE DIGICAM_CONTROL GOPRO_SET_REQUEST LED_CONTROL PLAY_TUNE
    OSD_PARAM_CONFIG
    UAVIONIX_ADSB_OUT_CFG UAVIONIX_ADSB_OUT_CFG_REGISTRATION UAVIONIX_ADSB_OUT_CFG_FLIGHTID
    UAVIONIX_ADSB_OUT_CONTROL CHANGE_OPERATOR_CONTROL AUTH_KEY COMMAND_CANCEL PLAY_TUNE_V2
""")
TOLD_OPCODES = [1, 2, 6, 7, 8, 9, 10, 11, 12, 13]

# --- writers of missions and fences: the commander's alone if their mission type exists. Rally points, alone or with
# all the rest, are the companion's list, and never reach the autopilot
ITEM_MESSAGES = listed("MISSION_COUNT MISSION_ITEM MISSION_ITEM_INT MISSION_WRITE_PARTIAL_LIST MISSION_CLEAR_ALL")
MISSION_TYPES = [0, 1, 2, 255]
RALLY_WRITE_TYPES = [2, 255]
# --- their readers: everybody's; rally points are read from the companion
READ_ITEM_MESSAGES = listed("MISSION_REQUEST_LIST MISSION_REQUEST MISSION_REQUEST_INT MISSION_ACK")
RALLY_READ_TYPES = [2]

#: of these, what ends at the companion in flight: mission and fence
STAGED_TYPES = [0, 1]

# --- the commander's alone; in flight the companion looks first what they would leave
#: NAV_WAYPOINT, DO_ORBIT, NAV_SPLINE_WAYPOINT, DO_CHANGE_SPEED, DO_REPOSITION, DO_SET_MISSION_CURRENT, OVERRIDE_GOTO;
#: NAV_FOLLOW, DO_FOLLOW, DO_FOLLOW_REPOSITION, DO_JUMP_TAG, GUIDED_CHANGE_SPEED
JUDGED_COMMANDS = [16, 34, 82, 178, 192, 224, 252, 25, 32, 33, 601, 43000]
JUDGED_MESSAGES = ["MISSION_SET_CURRENT"]

#: NAV_TAKEOFF, NAV_TAKEOFF_LOCAL, NAV_VTOL_TAKEOFF, SOLO_BTN_FLY_HOLD: they start a flight; DO_RETURN_PATH_START and
#: DO_LAND_START: somewhere in the mission
TAKE_OFF_COMMANDS = [22, 24, 84, 42002, 188, 189]

#: DO_MOTOR_TEST, ACTUATOR_TEST, DO_ENGINE_CONTROL, PREFLIGHT_CALIBRATION: motors may turn by them on the ground
TURNING_COMMANDS = [209, 310, 223, 241]

# --- the commander's alone, and while the vehicle is armed nobody's
SAFEGUARD_MESSAGES = listed("""
    FENCE_POINT SAFETY_SET_ALLOWED_AREA SET_HOME_POSITION SET_GPS_GLOBAL_ORIGIN SET_MAG_OFFSETS SET_VELOCITY_LIMITS
    LOG_ERASE
""")
#: PREFLIGHT_STORAGE, DO_SET_PARAMETER, BATTERY_RESET, PREFLIGHT_REBOOT_SHUTDOWN; of what shapes a return DO_SET_HOME,
#: DO_SET_GLOBAL_ORIGIN, DO_FENCE_ENABLE, SET_EKF_SOURCE_SET, ESTIMATOR_SENSOR_ENABLE, EXTERNAL_POSITION_ESTIMATE,
#: EXTERNAL_ATTITUDE_ESTIMATE, EXTERNAL_WIND_ESTIMATE, SET_HAGL, PREFLIGHT_SET_SENSOR_OFFSETS, the six that calibrate a
#: compass but for the one that calls that off, DO_INVERTED_FLIGHT, DO_PARACHUTE (0: switched off)
SAFEGUARD_COMMANDS = [
    *(245, 180, 42651, 246, 208),
    *(179, 611, 207, 42007, 43006, 43003, 620, 43004, 43005, 242, 42004, 42005, 42006, 42424, 42425, 210),
]
#: auxiliary functions: SAVE_WP, FENCE, RANGEFINDER, MISSION_RESET, ATTCON_ACCEL_LIM, AVOID_ADSB, AVOID_PROXIMITY,
#: RC_OVERRIDE_ENABLE, CLEAR_WP, GPS_DISABLE, Q_ASSIST, TER_DISABLE, EKF_SOURCE_SET, EKF_LANE_SWITCH, KILL_IMU1,
#: TRANSMITTER_TUNING, and some that no firmware has
SAFEGUARD_SWITCHES = [7, 10, 11, 24, 26, 38, 40, 46, 58, 65, 82, 86, 90, 103, 100, 219, 1, 999, 32000]
#: STOP_RESTART_SCRIPTING
MAINTENANCE_SWITCHES = [316]
#: CAMERA_TRIGGER, SPRAYER, GRIPPER, RELAY, BRAKE, LOITER, MOUNT_YAW_LOCK, SCRIPTING_1, USER_FUNC1
TOLD_SWITCHES = [9, 15, 19, 28, 33, 56, 163, 300, 47]
PARAMETER_MESSAGES = listed("PARAM_SET PARAM_EXT_SET PARAM_MAP_RC")
SAFEGUARD_PARAMETERS = listed("""
    HNDO_ENABLE HNDO_TIMEOUT HNDO_SYSID_SW SCR_ENABLE SCR_VM_I_COUNT SCR_HEAP_SIZE FS_GCS_ENABLE FS_GCS_TIMEOUT
    FS_OPTIONS FS_THR_ENABLE FS_EKF_THRESH FS_CRASH_CHECK THR_FAILSAFE THR_FS_VALUE AFS_ENABLE CHUTE_ENABLED
    GUID_TIMEOUT BATT_FS_LOW_ACT BATT2_FS_CRT_ACT BATT_LOW_VOLT BATT_MONITOR FENCE_ENABLE FENCE_ACTION ARMING_CHECK
    ARMING_SKIPCHK ARMING_REQUIRE MAV_GCS_SYSID MAV_GCS_SYSID_HI MAV_SYSID MAV_OPTIONS MAV1_OPTIONS MAV2_OPTIONS
    SYSID_THISMAV SYSID_MYGCS SYSID_ENFORCE SERIAL0_PROTOCOL SERIAL1_OPTIONS SERIAL2_BAUD SERIAL_PASS2 NET_ENABLE
    CAN_P1_DRIVER DDS_ENABLE RC_OPTIONS RC_OVERRIDE_TIME RC_PROTOCOLS RCMAP_THROTTLE RC7_OPTION RC16_OPTION RC3_MIN
    RC3_MAX RC3_TRIM RC3_DZ RC3_REVERSED FLTMODE1 FLTMODE_CH FLTMODE_GCSBLOCK MODE_CH BRD_SAFETY_DEFLT BRD_OPTIONS
    FORMAT_VERSION fs_gcs_enable hndo_enable FENCE_TOTAL FENCE_ALT_MAX FENCE_RADIUS FENCE_MARGIN FENCE_OPTIONS
    RALLY_LIMIT_KM RALLY_INCL_HOME RTL_ALT RTL_ALT_FINAL RTL_ALT_TYPE RTL_CLIMB_MIN RTL_CONE_SLOPE
    RTL_LOIT_TIME RTL_OPTIONS RTL_SPEED RTL_AUTOLAND RTL_ALTITUDE RTL_RADIUS rtl_alt RTL_ALT_M RTL_ALT_FINAL_M
    RTL_CLIMB_MIN_M RTL_SPEED_MS LAND_SPEED LAND_SPEED_HIGH LAND_ALT_LOW LAND_REPOSITION LAND_SPD_MS LAND_SPD_HIGH_MS
    LAND_ALT_LOW_M SRTL_ACCURACY SRTL_POINTS SRTL_OPTIONS Q_RTL_MODE Q_RTL_ALT Q_LAND_FINAL_SPD
    Q_ENABLE Q_OPTIONS Q_ASSIST_SPEED Q_ASSIST_ANGLE Q_TRANS_FAIL Q_TRANS_FAIL_ACT Q_FW_LND_APR_RAD AUTOLAND_WP_ALT
    TECS_LAND_SINK TECS_LAND_ARSPD ALT_HOLD_RTL q_options
    FLIGHT_OPTIONS TERRAIN_FOLLOW WP_LOITER_RAD Q_MAV_TYPE q_mav_type
    WPNAV_SPEED wpnav_speed WPNAV_SPEED_UP WPNAV_ACCEL WPNAV_RADIUS WP_SPD WP_SPD_DN WP_ACC WP_RADIUS ANGLE_MAX
    ATC_ANGLE_MAX ATC_ACCEL_R_MAX ATC_RATE_Y_MAX PSC_JERK_XY PSC_ANGLE_MAX AVOID_ENABLE OA_TYPE AVD_ENABLE PRX1_TYPE
    AIRSPEED_CRUISE TRIM_ARSPD_CM ARSPD_FBW_MIN MIN_GROUNDSPEED TRIM_THROTTLE TECS_CLMB_MAX TECS_SPDWEIGHT NAVL1_PERIOD
    ROLL_LIMIT_DEG LIM_ROLL_CD Q_WP_SPEED Q_WP_SPD Q_ANGLE_MAX Q_A_ACCEL_R_MAX EK3_SRC1_POSXY EK3_ENABLE AHRS_EKF_TYPE
    AHRS_ORIG_LAT BARO_ALT_OFFSET GPS_AUTO_SWITCH COMPASS_USE PLND_ENABLED MIS_OPTIONS MIS_RESTART MIS_TOTAL TUNE
    TUNE2_MAX TERRAIN_SPACING MOT_SPIN_MIN SERVO1_FUNCTION LANDING_GEAR HNDO SCR FS XFS_GCS_ENABLE SYSID ARMING RCX
    RCK_A NETX CHUTE RTL RTLX_ALT XRTL_ALT ALT_HOLD_FBWCM RALLY RALLYX_TOTAL LAND LANDX XLAND_SPEED SRTL XQ_OPTIONS
    FENCE FENCEX_ENABLE FLIGHT_OPTIONSX XTERRAIN_FOLLOW XQ_MAV_TYPE
""")
#: What no station sets at all.
MAINTENANCE_PARAMETERS = ["RALLY_TOTAL", "rally_total"]
#: What no row names, of odd bytes: nobody has judged it.
ODD_PARAMETERS = ["", "\x01\xff"]
#: What a commander may set in flight: gains, telemetry, logs, payload, modes of a person's, the simulator's.
TOLD_PARAMETERS = listed("""
    ATC_RAT_RLL_P ATC_ANG_PIT_P PSC_POSXY_P PSC_D_ACC_P PSC_NE_VEL_P Q_A_RAT_YAW_I Q_P_VELZ_P RLL_RATE_P PTCH2SRV_TCONST
    AUTOTUNE_AGGR Q_AUTOTUNE_AXES QUIK_ENABLE INS_HNTCH_FREQ MAV1_EXTRA1 MAV2_POSITION SR0_POSITION LOG_BITMASK OSD_TYPE
    OSD1_ENABLE NTF_LED_BRIGHT ADSB_SQUAWK CAM1_TYPE MNT1_TYPE GRIP_ENABLE ACRO_YAW_RATE FOLL_ENABLE SIMPLE SIM_WIND_SPD
    atc_rat_rll_p
""")

# --- files: opcode and path; what is behind the path's opcode in TOLD or BULK stays so
#: reading flight logs
LOG_FILES = [
    (4, b"APM/LOGS/00000001.BIN"),
    (3, b"APM/LOGS"),
    (16, b"/apm/logs/"),
    (14, b"logs/1.BIN"),
]
#: no radio link may
MAINTENANCE_FILES = [
    *((opcode, b"APM/scripts/x.lua") for opcode in (6, 8, 9, 10, 11, 12, 13)),
    (6, b"scripts/handover_guard.lua"),
    (6, b"/APM/scripts/x.lua"),
    (6, b"./scripts/x.lua"),
    (8, b"APM//Scripts/handover_guard.lua"),
    (6, b"APM\\SCRIPTS\\x.lua"),
    (6, b"apm/scripts./x.lua"),
    (6, b"apm/scripts /x.lua"),
    (10, b"scripts"),
    (6, b"scripts/modules/x.lua"),
    (6, b"scripts/../scripts/x.lua"),
    (13, b"x.lua\0scripts/x.lua"),
    (13, b"scripts/handover_guard.lua\0y.lua"),
    (13, b"APM\0APM2"),
    (10, b"/APM/"),
    (6, b"APM/SCRIPT~1/x.lua"),
    (6, b"APM/\xc5\xbfcripts/x.lua"),
    (6, b"a\x01b"),
    (6, b"ardupilot.abin"),
    (13, b"x\0/ardupilot.abin"),
    (6, b"/ARDUPILOT.ABIN"),
    (6, b"a" * 233 + b".abinx"),  # the 239th character is not read
    (4, b"APM/scripts/handover.key"),
    (14, b"scripts/HANDOVER.KEY"),
    (4, b"APM/SCRIPT~1/HANDOV~1.KEY"),
    (6, b"scripts/handover.key.new"),
    (4, b"@SYS/storage.bin"),
    (4, b"/@SYSstorage.bin"),
    (14, b"@SYS/flash.bin"),
    (4, b"@sys/crash_dump.bin"),
    (3, b"@SYS/storage.bin"),
    (16, b"@SYS/storage.bin"),
    (4, b"/APM/STRG_BAK/STRG0.bak"),
    (3, b"APM/STRG_BAK"),
    (14, b"apm/strg_bak/last_storage_bak"),
    (13, b"APM/STRG_BAK\0APM/x"),
    (4, b"APM/\xc5\xbfTRG_BAK/STRG0.bak"),
    (4, b"/APM/CubeOrange.stg"),
    (4, b"APM/CUBEOR~1.STG"),
    (11, b"APM/mission.stg"),
    (4, b"eeprom.bin"),
    (4, b"./eeprom-replay.bin"),
]
#: the commander's alone, though it only reads
TOLD_FILES = [
    (8, b"APM/LOGS/1.BIN"),
]
#: files that stations are told the vehicle does not have: the autopilot's own list of rally points
ABSENT_FILES = [
    (8, b"@MISSION/rally.dat"),
    (12, b"@MISSION/rally.dat"),
    (13, b"x\0@MISSION/rally.dat"),
    (13, b"@MISSION/rally.dat\0x"),
    (3, b"@MISSION/rally.dat"),
    (6, b"@MISSION/rally.dat2"),
    (4, b"@MISSIONrally.dat"),
    (4, b"@MISSION/x/../rally.dat"),
    (4, b"@MISSION/rally.dat"),
    (4, b"/@mission/RALLY.dat"),
    (14, b"@MISSION\\rally.dat"),
    (6, b"@MISSION/rally.dat"),
    (6, b"/@mission/rally.dat"),
    (11, b"/@mission/RALLY.dat"),
]
#: the commander's on the ground
SAFEGUARD_FILES = [
    (6, b"@PARAM/param.pck"),
    (11, b"/@PARAM/param.pck"),
    (11, b"@PARAMparam.pck"),
    (11, b"@PARAM/param.pck?/../../x"),
    (11, b"@PARAM\\param.pck"),
    (6, b"@MISSION/mission.dat"),
    (11, b"@MISSION/fence.dat"),
]
#: by the opcode alone
PLAIN_FILES = [
    (4, b"@MISSION/mission.dat"),
    (6, b"APM/LOGS/1.bin"),
    (6, b"x/myscripts/y"),
    (6, b"scripts.txt"),
    (6, b"abin"),
    (13, b"a\0b"),
    (13, b"a\0b\0scripts/c"),
    (6, b"a\0scripts/c"),
    (3, b"APM/scripts"),
    (4, b"APM/scripts/handover_guard.lua"),
    (14, b"scripts/handover_guard.lua"),
    (4, b"@PARAM/param.pck?withdefaults=1"),
    (4, b"@SYS/tasks.txt"),
    (4, b"ardupilot.abin"),
    (3, b"@SYS"),
    (3, b"APM"),
    (4, b"APM/catalogs/x"),
    (4, b"APM/logs.txt"),
    (4, b"APM/stg"),
    (4, b"APM/xeeprom.bin"),
    (4, b"APM/SCRIPT~1/x.lua"),
    (5, b"scripts"),
    (7, b"scripts/x.lua"),
    (7, b"@SYS/storage.bin"),  # what is written, not a path
]

# --- the commander's alone; anyone else's vanish in silence
SILENT_MESSAGES = listed("""
    RC_CHANNELS_OVERRIDE RC_CHANNELS_OVERRIDE_V2 MANUAL_CONTROL MANUAL_SETPOINT SET_POSITION_TARGET_LOCAL_NED
    SET_POSITION_TARGET_GLOBAL_INT SET_ATTITUDE_TARGET SET_ACTUATOR_CONTROL_TARGET FOLLOW_TARGET
    GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
    GIMBAL_DEVICE_SET_ATTITUDE GIMBAL_CONTROL MOUNT_CONTROL
    OPEN_DRONE_ID_BASIC_ID OPEN_DRONE_ID_LOCATION OPEN_DRONE_ID_AUTHENTICATION OPEN_DRONE_ID_SELF_ID
    OPEN_DRONE_ID_SYSTEM OPEN_DRONE_ID_OPERATOR_ID OPEN_DRONE_ID_MESSAGE_PACK OPEN_DRONE_ID_SYSTEM_UPDATE
    UAVIONIX_ADSB_OUT_DYNAMIC
""")

# --- everybody's while the vehicle is disarmed, one after the other; then nobody's
LOG_MESSAGES = listed("LOG_REQUEST_LIST LOG_REQUEST_DATA LOG_REQUEST_END")

# --- of these, what flies the aircraft or points its gimbal: a station that sent it before it had control has to end it
# once, and then begin anew
STICKS = [
    listed("RC_CHANNELS_OVERRIDE RC_CHANNELS_OVERRIDE_V2"),
    listed("MANUAL_CONTROL MANUAL_SETPOINT"),
    listed("SET_POSITION_TARGET_LOCAL_NED SET_POSITION_TARGET_GLOBAL_INT"),
    listed("SET_ATTITUDE_TARGET"),
    listed("SET_ACTUATOR_CONTROL_TARGET"),
    listed("FOLLOW_TARGET"),
    listed("""
        GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
        GIMBAL_DEVICE_SET_ATTITUDE GIMBAL_CONTROL MOUNT_CONTROL
    """),
]

#: data that commands nothing. Without [feeds]: the commander's alone, in silence; or no station's
COMMANDERS_FEEDS = ["GPS_RTCM_DATA", "GPS_INJECT_DATA", "TERRAIN_DATA"]
NO_STATIONS_FEEDS = ["ADSB_VEHICLE", "WIND_COV", "HYGROMETER_SENSOR"]

#: of these, what holds a stick even with zeros in all its fields: it can arm an aircraft that is not
HELD_MESSAGES = listed("MANUAL_CONTROL MANUAL_SETPOINT")

# --- the commander's go to the autopilot, because they load a channel that all share; others are answered here
RATE_MESSAGES = ["REQUEST_DATA_STREAM"]
RATE_COMMANDS = [510, 511]

# --- from everybody, for the companion itself
HANDOVER_MESSAGES = listed("""
    CONNECT CONNECT_ACK MISSION_PACKAGE MISSION_CHUNK MISSION_PACKAGE_ACK ON_HANDOVER OK_HANDOVER
    DRONE_CONNECTED DISCONNECT_HANDOVER HANDOVER_OVERRIDE OK_AHEAD HANDOVER_REHEARSE
    HANDOVER_DELEGATE
""")
CONTROL_COMMANDS = [32100]

# --- from nobody, over no radio link
MAINTENANCE_MESSAGES = listed("""
    SETUP_SIGNING SECURE_COMMAND SERIAL_CONTROL DEVICE_OP_READ DEVICE_OP_WRITE CAN_FRAME CANFD_FRAME
    CAN_FILTER_MODIFY V2_EXTENSION HIL_STATE HIL_CONTROLS HIL_RC_INPUTS_RAW HIL_ACTUATOR_CONTROLS HIL_SENSOR
    HIL_GPS HIL_OPTICAL_FLOW HIL_STATE_QUATERNION REMOTE_LOG_BLOCK_STATUS CUBEPILOT_FIRMWARE_UPDATE_START
    WIFI_CONFIG_AP CELLULAR_CONFIG ESC_EEPROM RALLY_POINT RALLY_FETCH_POINT
""")
#: FLASH_BOOTLOADER, DEBUG_TRAP, SET_FACTORY_TEST_MODE, CAN_FORWARD, START_RX_PAIR, STORAGE_FORMAT, SCRIPTING,
#: INJECT_FAILURE, DO_SET_SYS_CMP_ID
MAINTENANCE_COMMANDS = [42650, 42700, 42427, 32000, 500, 526, 42701, 420, 610]

# Every other message is dropped; every other command of the dialect is the commander's alone; every other opcode
# but 128 and 129 (a server's answers, dropped) is refused as unknown.

# --- names that have rows, and that the oldest pymavlink allowed (2.4.42) does not have: anything else is a slip
YOUNG_MESSAGES = listed("""
    AIRSPEED GLOBAL_POSITION_SENSOR NAMED_VALUE_STRING ONBOARD_COMPUTER_STATUS ORBIT_EXECUTION_STATUS PARAM_ERROR
""")
YOUNG_COMMANDS = listed("""
    ACTUATOR_TEST CONDITION_GATE CONFIGURE_ACTUATOR DO_FIGURE_EIGHT DO_ILLUMINATOR_CONFIGURE DO_ORBIT DO_SET_ACTUATOR
    DO_SET_STANDARD_MODE ILLUMINATOR_ON_OFF INJECT_FAILURE NAV_ARC_WAYPOINT REQUEST_CAMERA_IMAGE_CAPTURE
""")
#: ... and that pymavlink 2.4.50 does not have either: from the MAVLink definitions of July 2026, the two trees of
#: which (MAVLink's own and ArduPilot's) differ; in `common` and in `development`
UNBORN_MESSAGES = listed("""
    LINK_NODE_STATUS COMMAND_CANCEL ESC_INFO ESC_STATUS PROTOCOL_VERSION CELLULAR_STATUS CELLULAR_CONFIG
    FIGURE_EIGHT_EXECUTION_STATUS FUEL_STATUS BATTERY_INFO TIME_ESTIMATE_TO_TARGET COMPONENT_INFORMATION
    COMPONENT_INFORMATION_BASIC COMPONENT_METADATA PLAY_TUNE_V2 SUPPORTED_TUNES EVENT CURRENT_EVENT_SEQUENCE
    REQUEST_EVENT RESPONSE_EVENT_ERROR AVAILABLE_MODES CURRENT_MODE AVAILABLE_MODES_MONITOR ILLUMINATOR_STATUS

    MISSION_CHECKSUM RADIO_RC_CHANNELS GNSS_INTEGRITY RANGING_BEACON SET_VELOCITY_LIMITS VELOCITY_LIMITS
    BATTERY_STATUS_V2 GROUP_START GROUP_END RC_CHANNELS_OVERRIDE_V2 TARGET_ABSOLUTE TARGET_RELATIVE ESC_EEPROM
    ESTIMATOR_SENSOR_FUSION_STATUS
""")
#: number -> name
UNBORN_COMMANDS = {
    309: "ACTUATOR_GROUP_TEST",
    610: "DO_SET_SYS_CMP_ID",
    611: "DO_SET_GLOBAL_ORIGIN",
    620: "EXTERNAL_ATTITUDE_ESTIMATE",
    2020: "CAMERA_START_MTI",
    2021: "CAMERA_STOP_MTI",
    5005: "NAV_FENCE_HOME_CIRCLE_INCLUSION",
    12900: "ODID_SET_EMERGENCY",
    43004: "EXTERNAL_WIND_ESTIMATE",
    43006: "ESTIMATOR_SENSOR_ENABLE",
}

ALL_COMMANDS = sorted(n for n, e in mavlink.enums["MAV_CMD"].items() if e.name != "MAV_CMD_ENUM_END")

PASS, BULK, TOLD, SAFEGUARD = "pass", "bulk", "told", "safeguard"
SILENT, RATE, START, TAKE_OFF, HELD = "silent", "rate", "start", "take off", "held"
TURNING = "turning"
HANDOVER, CONTROL, LIVENESS = "handover", "control", "liveness"
JUDGED, CALLED_OFF = "judged", "called off"
ABSENT, MAINTENANCE, NEVER, UNKNOWN = "absent", "maintenance", "never", "unknown"
RALLY_READ, RALLY_WRITE = "rally read", "rally write"
COMMANDERS_FEED, NO_STATIONS_FEED = "commander's feed", "no station's feed"
#: what the policy alone says of both: a filter judges them
LEFT_FEED = "feed"
LOGS = "logs"

_ALLOWED = (Fate.FORWARD, GateReason.ALLOWED)
_NOT_IN_CONTROL = (Fate.REFUSE, GateReason.NOT_IN_CONTROL)
_CONSUMED = (Fate.CONSUME, GateReason.COMPANION)
_NO_RADIO = (Fate.REFUSE, GateReason.MAINTENANCE_ONLY)
_ABSENT = (Fate.REFUSE, GateReason.ABSENT)
_NEVER = (Fate.DROP, GateReason.NEVER)
_NO_FEED = (Fate.DROP, GateReason.FEED_NOT_NAMED)
_UNKNOWN = (Fate.REFUSE, GateReason.UNKNOWN_COMMAND)

#: kind -> (what the commander's becomes, what anyone else's becomes), on the ground
OUTCOMES = {
    PASS: (_ALLOWED, _ALLOWED),
    BULK: (_ALLOWED, _ALLOWED),
    TOLD: (_ALLOWED, _NOT_IN_CONTROL),
    JUDGED: (_ALLOWED, _NOT_IN_CONTROL),
    CALLED_OFF: (_ALLOWED, _ALLOWED),
    START: (_ALLOWED, _NOT_IN_CONTROL),
    TAKE_OFF: (_ALLOWED, _NOT_IN_CONTROL),
    TURNING: (_ALLOWED, _NOT_IN_CONTROL),
    SAFEGUARD: (_ALLOWED, _NOT_IN_CONTROL),
    LOGS: (_ALLOWED, _ALLOWED),
    SILENT: (_ALLOWED, (Fate.DROP, GateReason.NOT_IN_CONTROL)),
    HELD: (_ALLOWED, (Fate.DROP, GateReason.NOT_IN_CONTROL)),
    COMMANDERS_FEED: (_ALLOWED, (Fate.DROP, GateReason.NOT_IN_CONTROL)),
    NO_STATIONS_FEED: (_NO_FEED, _NO_FEED),
    LEFT_FEED: ((Fate.CONSUME, GateReason.FEED), (Fate.CONSUME, GateReason.FEED)),
    RATE: (_ALLOWED, (Fate.CONSUME, GateReason.OBSERVER_RATES)),
    LIVENESS: (_ALLOWED, (Fate.CONSUME, GateReason.LIVENESS_NOT_COMMANDER)),
    HANDOVER: (_CONSUMED, _CONSUMED),
    CONTROL: (_CONSUMED, _CONSUMED),
    RALLY_READ: (_CONSUMED, _CONSUMED),
    RALLY_WRITE: (_CONSUMED, _NOT_IN_CONTROL),
    ABSENT: (_ABSENT, _ABSENT),
    MAINTENANCE: (_NO_RADIO, _NO_RADIO),
    NEVER: (_NEVER, _NEVER),
    UNKNOWN: (_UNKNOWN, _UNKNOWN),
}
#: ... and the commander's of an armed vehicle, where that differs
ARMED = {
    SAFEGUARD: (Fate.REFUSE, GateReason.LOCKED_WHILE_ARMED),
    LOGS: (Fate.REFUSE, GateReason.ON_GROUND),
}

#: ... and anyone else's
ARMED_OTHERS = {BULK: (Fate.REFUSE, GateReason.COMMANDERS_IN_FLIGHT), LOGS: (Fate.REFUSE, GateReason.ON_GROUND)}

#: kind -> the class that the verdict names; the companion goes by it
ACCESS = {
    PASS: Access.READ,
    BULK: Access.BULK,
    TOLD: Access.COMMAND,
    JUDGED: Access.COMMAND,
    CALLED_OFF: Access.READ,
    START: Access.COMMAND,
    TAKE_OFF: Access.COMMAND,
    TURNING: Access.COMMAND,
    SAFEGUARD: Access.SAFEGUARD,
    LOGS: Access.LOG,
    SILENT: Access.STREAM,
    HELD: Access.STREAM,
    COMMANDERS_FEED: Access.FEED,
    NO_STATIONS_FEED: Access.FEED,
    LEFT_FEED: Access.FEED,
    RATE: Access.ANSWERED,
    LIVENESS: Access.LIVENESS,
    HANDOVER: Access.TRANSFER,
    CONTROL: Access.CONTROL,
    RALLY_READ: Access.RALLY_READ,
    RALLY_WRITE: Access.RALLY_WRITE,
    ABSENT: Access.ABSENT,
    MAINTENANCE: Access.MAINTENANCE,
    NEVER: Access.NEVER,
    UNKNOWN: None,
}


#: command, its first two parameters, and what it is then
PARAMETER_DEPENDENT = [
    # reboot; shutdown, hold in the boot loader, the magic number before a planned crash, what is no number
    (246, 1.0, 0.0, SAFEGUARD),
    *((246, value, 24.0, MAINTENANCE) for value in (2.0, 3.0, 42.0, 1.5, -1.0, float("nan"))),
    # the parachute: switched off or on, released; the autopilot cuts what is behind the point
    *((208, value, 0.0, SAFEGUARD) for value in (0.0, 1.0, 1.5, 3.0, float("nan"))),
    *((208, value, 0.0, TOLD) for value in (2.0, 2.5)),
    (400, 1.0, 0.0, TAKE_OFF),
    (400, 1.0, 21196.0, TAKE_OFF),
    (400, -1.0, 0.0, TAKE_OFF),
    (400, float("nan"), 0.0, TAKE_OFF),
    (400, 0.0, 21196.0, TOLD),
    *((218, function, 2.0, TAKE_OFF) for function in (41.0, 151.0, 153.0, 153.5, 154.0, 165.0)),
    # what is no number may be any switch, also the one that stops the guard
    *((218, value, position, MAINTENANCE) for value in (float("nan"), float("inf")) for position in (0.0, 1.0, 2.0)),
    *((218, function + 65536.0, 2.0, TAKE_OFF) for function in (41.0, 151.0, 153.0, 154.0, 165.0)),
    (218, 153.0 - 65536.0, 2.0, TAKE_OFF),
    (218, 153.0 + 256.0, 2.0, SAFEGUARD),
    *((176, 1.0, mode, TAKE_OFF) for mode in (28.0, 28.5, 284.0, 65564.0, -228.0)),
    *((176, 1.0, mode, START) for mode in (float("nan"), float("inf"))),
    *((176, 1.0, mode, TOLD) for mode in (0.0, 4.0, 27.0, 29.0, 32.0, 12.0, 283.0)),
    (218, 153.0, 1.0, TAKE_OFF),
    (218, 153.0, 0.0, TOLD),
    (218, 4.0, 2.0, TOLD),
    *((176, 1.0, mode, JUDGED) for mode in (3.0, 3.5, 259.0, -253.0)),
    *((176, 1.0, mode, JUDGED) for mode in (23.0, 23.5, 279.0)),  # FOLLOW: after another system
    *((218, 57.0, position, JUDGED) for position in (2.0, float("nan"))),
    (218, 57.0, 0.0, TOLD),
    *((176, 1.0, mode, TOLD) for mode in (5.0, 6.0, 9.0, 16.0, 17.0, 21.0)),  # LOITER, RTL, LAND ...: never judged
    *((218, 16.0, position, JUDGED) for position in (2.0, float("nan"))),
    *((218, 16.0, position, TOLD) for position in (0.0, 1.0)),
    *((193, goes_on, 0.0, JUDGED) for goes_on in (1.0, 1.9, 257.0, float("nan"))),
    *((193, pauses, 0.0, TOLD) for pauses in (0.0, 2.0)),
    (218, 81.0, 2.0, TOLD),
    *((218, float(function), 2.0, SAFEGUARD) for function in SAFEGUARD_SWITCHES),
    *((218, function, 0.0, SAFEGUARD) for function in (11.0, 11.9, 65547.0, -65525.0)),
    *((218, float(function), 2.0, MAINTENANCE) for function in MAINTENANCE_SWITCHES),
    *((218, float(function), 2.0, TOLD) for function in TOLD_SWITCHES),
]


def kind_of_message(name: str) -> str:
    lists = [
        (PASS, PASS_MESSAGES),
        (BULK, BULK_MESSAGES),
        (TOLD, TOLD_MESSAGES),
        (SAFEGUARD, SAFEGUARD_MESSAGES),
        (JUDGED, JUDGED_MESSAGES),
        (HELD, HELD_MESSAGES),
        (SILENT, [name for name in SILENT_MESSAGES if name not in HELD_MESSAGES]),
        (COMMANDERS_FEED, COMMANDERS_FEEDS),
        (NO_STATIONS_FEED, NO_STATIONS_FEEDS),
        (LOGS, LOG_MESSAGES),
        (RATE, RATE_MESSAGES),
        (HANDOVER, HANDOVER_MESSAGES),
        (MAINTENANCE, MAINTENANCE_MESSAGES),
        (LIVENESS, ["HEARTBEAT"]),
    ]
    found = [kind for kind, names in lists if name in names]
    assert len(found) <= 1, name
    return found[0] if found else NEVER


def kind_of_command(number: int, commands: Collection[int] = ALL_COMMANDS) -> str:
    """`commands`: those of the dialect."""
    if number not in commands:
        return UNKNOWN
    lists = [
        (PASS, PASS_COMMANDS),
        (BULK, BULK_COMMANDS),
        (RATE, RATE_COMMANDS),
        (CONTROL, CONTROL_COMMANDS),
        (MAINTENANCE, MAINTENANCE_COMMANDS),
        (SAFEGUARD, SAFEGUARD_COMMANDS),
        (START, [300]),
        (TAKE_OFF, TAKE_OFF_COMMANDS),
        (TURNING, TURNING_COMMANDS),
        (JUDGED, JUDGED_COMMANDS),
    ]
    found = [kind for kind, numbers in lists if number in numbers]
    assert len(found) <= 1, number
    return found[0] if found else TOLD


def kind_of_opcode(number: int) -> str:
    if number in BULK_OPCODES:
        return BULK
    if number in TOLD_OPCODES:
        return TOLD
    return NEVER if number in (128, 129) else UNKNOWN


def kind_of_items(mission_type: int) -> str:
    """Of what writes a list."""
    if mission_type in RALLY_WRITE_TYPES:
        return RALLY_WRITE
    return JUDGED if mission_type in STAGED_TYPES else UNKNOWN


def kind_of_reading(name: str, mission_type: int) -> str:
    """Of what reads one, or ends that; the end of an upload is MISSION_ACK, too."""
    if mission_type in RALLY_READ_TYPES:
        return RALLY_READ
    return CALLED_OFF if name == "MISSION_ACK" and mission_type in STAGED_TYPES else PASS


def kind_of_frame(name: str, fields: dict[str, int], ftp: bytes = b"", parameter: str = "") -> str | None:
    """The kind of any message by the lists above; None where they do not say (files and parameters not listed)."""
    if name in ("COMMAND_LONG", "COMMAND_INT"):
        return kind_of_command(fields["command"])
    if name == "COMMAND_ACK":
        return CONTROL if fields["command"] == 32100 else SILENT
    if name == "TUNNEL":
        return NEVER if fields["payload_type"] in (47116, 47117) else MAINTENANCE
    if name in ITEM_MESSAGES:
        return kind_of_items(fields["mission_type"])
    if name in READ_ITEM_MESSAGES:
        return kind_of_reading(name, fields["mission_type"])
    if name in PARAMETER_MESSAGES:
        if parameter in MAINTENANCE_PARAMETERS:
            return MAINTENANCE
        if parameter in SAFEGUARD_PARAMETERS or parameter in ODD_PARAMETERS:
            return SAFEGUARD
        return TOLD if parameter in TOLD_PARAMETERS else None
    if name == "FILE_TRANSFER_PROTOCOL":
        kind = kind_of_opcode(ftp[3])
        return kind if not ftp[12:].strip(b"\0") or ftp[3] in (0, 1, 2, 5, 7, 15) else None
    return kind_of_message(name)


@dataclass(frozen=True)
class Case:
    """One thing to send, and its kind. `version1`: MAVLink 1 can carry it."""

    name: str
    kind: str
    fields: tuple[tuple[str, object], ...] = ()
    version1: bool = True


BY_PART = [
    *listed("COMMAND_LONG COMMAND_INT COMMAND_ACK FILE_TRANSFER_PROTOCOL TUNNEL"),
    *ITEM_MESSAGES,
    *READ_ITEM_MESSAGES,
    *PARAMETER_MESSAGES,
]


def cases() -> Iterator[Case]:
    ids = {cls.msgname: msgid for msgid, cls in mavlink.mavlink_map.items()}
    for name, msgid in ids.items():
        if name not in BY_PART:
            yield Case(name, kind_of_message(name), (), msgid <= 255)
    for command in [*ALL_COMMANDS, 0, 15, 40001, 65535]:
        yield Case("COMMAND_LONG", kind_of_command(command), (("command", command),))
        yield Case("COMMAND_INT", kind_of_command(command), (("command", command),))
        yield Case("COMMAND_ACK", CONTROL if command == 32100 else SILENT, (("command", command),))
    for command, first, second, kind in PARAMETER_DEPENDENT:
        for name in ("COMMAND_LONG", "COMMAND_INT"):
            yield Case(name, kind, (("command", command), ("param1", first), ("param2", second)))
    for mode in (3, 259, 0xFFFFFF03, 23, 279):
        yield Case("SET_MODE", JUDGED, (("custom_mode", mode),))
    for mode, kind in ((28, TAKE_OFF), (0xFFFFFF1C, TAKE_OFF), (0, TOLD), (27, TOLD), (29, TOLD), (0x1C00, TOLD)):
        yield Case("SET_MODE", kind, (("custom_mode", mode),))
    for opcode in range(256):
        payload = ftp_request(opcode)
        yield Case("FILE_TRANSFER_PROTOCOL", kind_of_opcode(opcode), (("payload", payload),))
    for files, kind in (
        (MAINTENANCE_FILES, MAINTENANCE),
        (TOLD_FILES, TOLD),
        (LOG_FILES, LOGS),
        (ABSENT_FILES, ABSENT),
        (SAFEGUARD_FILES, SAFEGUARD),
        (PLAIN_FILES, None),
    ):
        for opcode, path in files:
            payload = ftp_request(opcode, path)
            yield Case("FILE_TRANSFER_PROTOCOL", kind or kind_of_opcode(opcode), (("payload", payload),))
    for payload_type in (47116, 47117):
        yield Case("TUNNEL", NEVER, (("payload_type", payload_type),), False)
    for payload_type in (0, 1, 200, 47115, 47118, 65535):
        yield Case("TUNNEL", MAINTENANCE, (("payload_type", payload_type),), False)
    for name in ITEM_MESSAGES:
        for mission_type in (0, 1, 2, 3, 4, 127, 254, 255):
            yield Case(name, kind_of_items(mission_type), (("mission_type", mission_type),), mission_type == 0)
    for name in READ_ITEM_MESSAGES:
        for mission_type in (0, 1, 2, 3, 255):
            kind = kind_of_reading(name, mission_type)
            yield Case(name, kind, (("mission_type", mission_type),), mission_type == 0)
    for name in ("MISSION_ITEM", "MISSION_ITEM_INT"):
        yield Case(name, JUDGED, (("current", 2),))
    for name in PARAMETER_MESSAGES:
        for parameters, kind in (
            (MAINTENANCE_PARAMETERS, MAINTENANCE),
            ([*SAFEGUARD_PARAMETERS, *ODD_PARAMETERS], SAFEGUARD),
            (TOLD_PARAMETERS, TOLD),
        ):
            for parameter in parameters:
                yield Case(name, kind, (("param_id", parameter.encode("latin-1")),), ids[name] <= 255)


CASES = list(cases())

#: Phase by phase: who commands, and who is about to; on the ground and armed.
VIEWS = [
    AuthorityView(Phase.ON_LOAD, None, None, 0, LeaseState.LOST),
    AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD),
    AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD, armed=True),
    AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True),
    AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=False),
    AuthorityView(Phase.ON_HANDOVER, GCSA, GCSB, 1, LeaseState.TRANSFER, armed=True),
    AuthorityView(Phase.ON_HANDOVER, GCSB, GCSA, 2, LeaseState.TRANSFER, armed=True),
    AuthorityView(Phase.EMERGENCY, GCSA, None, 2, LeaseState.HELD, armed=True),
    AuthorityView(Phase.EMERGENCY, None, None, 2, LeaseState.LOST, armed=True),
    AuthorityView(Phase.ON_MISSION, None, None, 3, LeaseState.RECOVERING, armed=True),
    AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True, rehearsal=True),
    AuthorityView(Phase.ON_HANDOVER, GCSB, GCSA, 2, LeaseState.TRANSFER, armed=True, rehearsal=True),
    AuthorityView(Phase.EMERGENCY, None, None, 2, LeaseState.LOST, armed=True, rehearsal=True),
]

#: (station whose link it comes by, system id in the frame, MAVLink version, what is wrong with the sender)
SENDERS = [
    (A, GCSA, 2, None),
    (A, GCSA, 1, None),
    (A, TRACKER_OF_A, 2, None),
    (B, GCSB, 2, None),
    (B, GCSB, 1, None),
    (C, GCSC, 2, None),
    (A, VEHICLE, 2, GateReason.SPOOFED_VEHICLE),
    (C, VEHICLE, 1, GateReason.SPOOFED_VEHICLE),
    (A, GCSB, 2, GateReason.SPOOFED_STATION),
    (B, GCSA, 2, GateReason.SPOOFED_STATION),
    (B, TRACKER_OF_A, 2, GateReason.SPOOFED_STATION),
    (C, 99, 2, GateReason.SPOOFED_STATION),
    (C, 0, 2, GateReason.SPOOFED_STATION),
    (C, 255, 1, GateReason.SPOOFED_STATION),
]


def expected(
    kind: str, station: StationIdentity, sysid: int, wrong: GateReason | None, view: AuthorityView
) -> tuple[Fate, GateReason]:
    """What becomes of a frame that is aimed at the vehicle's autopilot."""
    if wrong is not None:
        return Fate.DROP, wrong
    if view.rehearsal and kind in (START, TAKE_OFF, TURNING):
        return Fate.REFUSE, GateReason.REHEARSAL
    commands = view.commander is not None and view.commander == station.sysid
    if kind == LIVENESS and sysid in (TRACKER_OF_A, TRACKER_OF_B):
        commands = False
    if not commands:
        return ARMED_OTHERS.get(kind, OUTCOMES[kind][1]) if view.armed else OUTCOMES[kind][1]
    if kind in (START, TAKE_OFF) and view.phase is Phase.ON_LOAD:
        return Fate.CONSUME, GateReason.COMPANION
    if kind in (START, JUDGED, CALLED_OFF) and view.phase is not Phase.ON_LOAD:
        return Fate.CONSUME, GateReason.COMPANION
    if kind == HELD and view.rehearsal:
        return Fate.DROP, GateReason.REHEARSAL
    if kind == HELD and view.phase is Phase.ON_LOAD and not view.armed:
        return Fate.DROP, GateReason.NOT_ARMED
    return ARMED.get(kind, OUTCOMES[kind][0]) if view.armed else OUTCOMES[kind][0]

# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of auxiliary functions: what DO_AUX_FUNCTION switches, by the number in its first parameter.

Such a switch does the same as a parameter, a command or a mode, so it has the same class. A number without a row has
the class SAFEGUARD, because its effect on a return is not known: `gate/judge.py` locks that class while the vehicle is
armed.

Names and numbers of ArduCopter and ArduPlane 4.5 to 4.7 (RCn_OPTION). If two versions differ, the newer name is used.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.gate.policy.access import ANY, Access, Rule, names

__all__ = ["OTHER_SWITCHES", "SWITCH_NUMBERS", "SWITCH_RULES", "switch_name", "switch_rule"]

SWITCH_RULES: Final = (
    Rule(
        Access.MAINTENANCE,
        "stops the guard: scripting can be halted by it",
        names("STOP_RESTART_SCRIPTING"),
    ),
    Rule(
        Access.SAFEGUARD,
        "writes, clears, moves or restarts the mission, without a check of the route",
        names("SAVE_WP MISSION_RESET CLEAR_WP RELOCATE_MISSION"),
    ),
    Rule(
        Access.SAFEGUARD,
        "switches the fence, the avoidance, or what measures the height above the ground",
        names("FENCE AVOID_ADSB AVOID_PROXIMITY RANGEFINDER TER_DISABLE SURFACE_TRACKING"),
    ),
    Rule(
        Access.SAFEGUARD,
        "changes which sensors the estimator uses, or what they measure: a return is flown by its position",
        names("""
            EKF_SOURCE_SET EKF_LANE_SWITCH EKF_YAW_RESET GPS_DISABLE GPS_DISABLE_YAW DISABLE_AIRSPEED_USE
            ARSPD_CALIBRATE AHRS_TYPE COMPASS_LEARN MAG_CAL VISODOM_ALIGN OPTFLOW_CAL KILL_IMU1 KILL_IMU2 KILL_IMU3
            SAVE_TRIM AHRS_AUTO_TRIM TRIM_TO_CURRENT_SERVO_RC WIND_VANE_DIR_OFFSET
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "changes how fast or how steeply the aircraft flies, in a return too",
        names("""
            ATTCON_FEEDFWD ATTCON_ACCEL_LIM TRANSMITTER_TUNING TRANSMITTER_TUNING2 SYSTEMID CUSTOM_CONTROLLER STANDBY
            INVERTED REVERSE_THROTTLE SOARING CROW_SELECT FBWA_TAILDRAGGER LEARN_CRUISE WEATHER_VANE_ENABLE
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "changes how the aircraft comes down: by which means a plane lands, and where a copter does",
        names("""
            Q_ASSIST AIRMODE VFWD_THR_OVERRIDE LANDING_FLARE EMERGENCY_LANDING_EN FORCEFLYING PRECISION_LOITER
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "switches the parachute, the charging of the battery, or whether the pilot's radio goes before a station",
        names("PARACHUTE_ENABLE PARACHUTE_3POS BATTERY_MPPT_ENABLE RC_OVERRIDE_ENABLE"),
    ),
    Rule(
        Access.COMMAND,
        "a flight mode, or a part of one; AUTO in flight and what takes off are judged as such commands are",
        names("""
            FLIP SIMPLE_MODE RTL RESETTOARMEDYAW SUPERSIMPLE_MODE ACRO_TRAINER AUTO AUTOTUNE_MODE LAND BRAKE THROW
            SMART_RTL MANUAL ACRO STEERING HOLD GUIDED LOITER FOLLOW SIMPLE ZIGZAG ZIGZAG_SAVEWP ZIGZAG_AUTO STABILIZE
            POSHOLD ALTHOLD FLOWHOLD CIRCLE DRIFT TAKEOFF FBWA MODE_SWITCH_RESET TRAINING AUTO_RTL QRTL CRUISE TURTLE
            SIMPLE_HEADING_RESET QSTABILIZE FLIGHTMODE_PAUSE AUTOLAND PLANE_AUTO_LANDING_ABORT CAM_MODE_TOGGLE
            SAILBOAT_TACK SAILBOAT_MOTOR_3POS
        """),
    ),
    Rule(
        Access.COMMAND,
        "arms, disarms, or ends the flight",
        names("""
            ARMDISARM_UNUSED ARMDISARM ARMDISARM_AIRMODE ARM_EMERGENCY_STOP DISARM MOTOR_ESTOP MOTOR_INTERLOCK
            PARACHUTE_RELEASE
        """),
    ),
    Rule(
        Access.COMMAND,
        "tunes gains, which say how well a path is kept and not which one it is",
        names("FW_AUTOTUNE AUTOTUNE_TEST_GAINS QUICKTUNE FFT_NOTCH_TUNE"),
    ),
    Rule(
        Access.COMMAND,
        "drives an output, an engine or the payload",
        names("""
            CAMERA_TRIGGER SPRAYER GRIPPER RETRACT_MOUNT1 RETRACT_MOUNT2 RELAY RELAY2 RELAY3 RELAY4 RELAY5 RELAY6
            LANDING_GEAR LOST_VEHICLE_SOUND WINCH_ENABLE WINCH_CONTROL RUNCAM_CONTROL RUNCAM_OSD_CONTROL GENERATOR
            VTX_POWER LOWEHEISER_STARTER TORQEEDO_CLEAR_ERR TURBINE_START ICE_START_STOP MOUNT_YAW_LOCK MOUNT_RP_LOCK
            MOUNT_POI_LOCK MOUNT_LRF_ENABLE CAMERA_REC_VIDEO CAMERA_ZOOM CAMERA_MANUAL_FOCUS CAMERA_AUTO_FOCUS
            CAMERA_IMAGE_TRACKING CAMERA_LENS LOG_PAUSE
        """),
    ),
    Rule(
        Access.COMMAND,
        "a switch of the owner's own scripts or code: what it does is not known here",
        names("""
            USER_FUNC1 USER_FUNC2 USER_FUNC3 SCRIPTING_1 SCRIPTING_2 SCRIPTING_3 SCRIPTING_4 SCRIPTING_5 SCRIPTING_6
            SCRIPTING_7 SCRIPTING_8 SCRIPTING_9 SCRIPTING_10 SCRIPTING_11 SCRIPTING_12 SCRIPTING_13 SCRIPTING_14
            SCRIPTING_15 SCRIPTING_16
        """),
    ),
    Rule(
        Access.COMMAND,
        "a channel that is read as a stick, or none: as a switch it does nothing",
        names("""
            DO_NOTHING ROLL PITCH THROTTLE YAW MAINSAIL FLAP FWD_THR AIRBRAKE WALKING_HEIGHT MOUNT1_ROLL MOUNT1_PITCH
            MOUNT1_YAW MOUNT2_ROLL MOUNT2_PITCH MOUNT2_YAW LOWEHEISER_THROTTLE
        """),
    ),
)

#: Every other number.
OTHER_SWITCHES: Final = Rule(Access.SAFEGUARD, "any other switch: what it does to a return is not known", (ANY,))

#: name -> number
SWITCH_NUMBERS: Final = {
    "DO_NOTHING": 0, "FLIP": 2, "SIMPLE_MODE": 3, "RTL": 4, "SAVE_TRIM": 5, "SAVE_WP": 7, "CAMERA_TRIGGER": 9,
    "RANGEFINDER": 10, "FENCE": 11, "RESETTOARMEDYAW": 12, "SUPERSIMPLE_MODE": 13, "ACRO_TRAINER": 14, "SPRAYER": 15,
    "AUTO": 16, "AUTOTUNE_MODE": 17, "LAND": 18, "GRIPPER": 19, "PARACHUTE_ENABLE": 21, "PARACHUTE_RELEASE": 22,
    "PARACHUTE_3POS": 23, "MISSION_RESET": 24, "ATTCON_FEEDFWD": 25, "ATTCON_ACCEL_LIM": 26, "RETRACT_MOUNT1": 27,
    "RELAY": 28, "LANDING_GEAR": 29, "LOST_VEHICLE_SOUND": 30, "MOTOR_ESTOP": 31, "MOTOR_INTERLOCK": 32, "BRAKE": 33,
    "RELAY2": 34, "RELAY3": 35, "RELAY4": 36, "THROW": 37, "AVOID_ADSB": 38, "PRECISION_LOITER": 39,
    "AVOID_PROXIMITY": 40, "ARMDISARM_UNUSED": 41, "SMART_RTL": 42, "INVERTED": 43, "WINCH_ENABLE": 44,
    "WINCH_CONTROL": 45, "RC_OVERRIDE_ENABLE": 46, "USER_FUNC1": 47, "USER_FUNC2": 48, "USER_FUNC3": 49,
    "LEARN_CRUISE": 50, "MANUAL": 51, "ACRO": 52, "STEERING": 53, "HOLD": 54, "GUIDED": 55, "LOITER": 56, "FOLLOW": 57,
    "CLEAR_WP": 58, "SIMPLE": 59, "ZIGZAG": 60, "ZIGZAG_SAVEWP": 61, "COMPASS_LEARN": 62, "SAILBOAT_TACK": 63,
    "REVERSE_THROTTLE": 64, "GPS_DISABLE": 65, "RELAY5": 66, "RELAY6": 67, "STABILIZE": 68, "POSHOLD": 69,
    "ALTHOLD": 70, "FLOWHOLD": 71, "CIRCLE": 72, "DRIFT": 73, "SAILBOAT_MOTOR_3POS": 74, "SURFACE_TRACKING": 75,
    "STANDBY": 76, "TAKEOFF": 77, "RUNCAM_CONTROL": 78, "RUNCAM_OSD_CONTROL": 79, "VISODOM_ALIGN": 80, "DISARM": 81,
    "Q_ASSIST": 82, "ZIGZAG_AUTO": 83, "AIRMODE": 84, "GENERATOR": 85, "TER_DISABLE": 86, "CROW_SELECT": 87,
    "SOARING": 88, "LANDING_FLARE": 89, "EKF_SOURCE_SET": 90, "ARSPD_CALIBRATE": 91, "FBWA": 92, "RELOCATE_MISSION": 93,
    "VTX_POWER": 94, "FBWA_TAILDRAGGER": 95, "MODE_SWITCH_RESET": 96, "WIND_VANE_DIR_OFFSET": 97, "TRAINING": 98,
    "AUTO_RTL": 99, "KILL_IMU1": 100, "KILL_IMU2": 101, "CAM_MODE_TOGGLE": 102, "EKF_LANE_SWITCH": 103,
    "EKF_YAW_RESET": 104, "GPS_DISABLE_YAW": 105, "DISABLE_AIRSPEED_USE": 106, "FW_AUTOTUNE": 107, "QRTL": 108,
    "CUSTOM_CONTROLLER": 109, "KILL_IMU3": 110, "LOWEHEISER_STARTER": 111, "AHRS_TYPE": 112, "RETRACT_MOUNT2": 113,
    "CRUISE": 150, "TURTLE": 151, "SIMPLE_HEADING_RESET": 152, "ARMDISARM": 153, "ARMDISARM_AIRMODE": 154,
    "TRIM_TO_CURRENT_SERVO_RC": 155, "TORQEEDO_CLEAR_ERR": 156, "EMERGENCY_LANDING_EN": 157, "OPTFLOW_CAL": 158,
    "FORCEFLYING": 159, "WEATHER_VANE_ENABLE": 160, "TURBINE_START": 161, "FFT_NOTCH_TUNE": 162, "MOUNT_YAW_LOCK": 163,
    "LOG_PAUSE": 164, "ARM_EMERGENCY_STOP": 165, "CAMERA_REC_VIDEO": 166, "CAMERA_ZOOM": 167,
    "CAMERA_MANUAL_FOCUS": 168, "CAMERA_AUTO_FOCUS": 169, "QSTABILIZE": 170, "MAG_CAL": 171, "BATTERY_MPPT_ENABLE": 172,
    "PLANE_AUTO_LANDING_ABORT": 173, "CAMERA_IMAGE_TRACKING": 174, "CAMERA_LENS": 175, "VFWD_THR_OVERRIDE": 176,
    "MOUNT_LRF_ENABLE": 177, "FLIGHTMODE_PAUSE": 178, "ICE_START_STOP": 179, "AUTOTUNE_TEST_GAINS": 180,
    "QUICKTUNE": 181, "AHRS_AUTO_TRIM": 182, "AUTOLAND": 183, "SYSTEMID": 184, "MOUNT_RP_LOCK": 185,
    "MOUNT_POI_LOCK": 186, "ROLL": 201, "PITCH": 202, "THROTTLE": 203, "YAW": 204, "MAINSAIL": 207, "FLAP": 208,
    "FWD_THR": 209, "AIRBRAKE": 210, "WALKING_HEIGHT": 211, "MOUNT1_ROLL": 212, "MOUNT1_PITCH": 213, "MOUNT1_YAW": 214,
    "MOUNT2_ROLL": 215, "MOUNT2_PITCH": 216, "MOUNT2_YAW": 217, "LOWEHEISER_THROTTLE": 218, "TRANSMITTER_TUNING": 219,
    "TRANSMITTER_TUNING2": 220, "SCRIPTING_1": 300, "SCRIPTING_2": 301, "SCRIPTING_3": 302, "SCRIPTING_4": 303,
    "SCRIPTING_5": 304, "SCRIPTING_6": 305, "SCRIPTING_7": 306, "SCRIPTING_8": 307, "SCRIPTING_9": 308,
    "SCRIPTING_10": 309, "SCRIPTING_11": 310, "SCRIPTING_12": 311, "SCRIPTING_13": 312, "SCRIPTING_14": 313,
    "SCRIPTING_15": 314, "SCRIPTING_16": 315, "STOP_RESTART_SCRIPTING": 316,
}  # fmt: skip
_NAMES: Final = {number: name for name, number in SWITCH_NUMBERS.items()}
_RULES: Final = {SWITCH_NUMBERS[name]: rule for rule in SWITCH_RULES for name in rule.names}


def switch_rule(number: int) -> Rule:
    """The row of an auxiliary function; `OTHER_SWITCHES` if it has none of its own."""
    return _RULES.get(number, OTHER_SWITCHES)


def switch_name(number: int) -> str | None:
    """Its name in the firmware; None if it has no row."""
    return _NAMES.get(number)

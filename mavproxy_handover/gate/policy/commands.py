# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of MAV_CMD, in COMMAND_LONG and COMMAND_INT alike. `Access` explains the classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from mavproxy_handover.core.safety.commands import Kind
from mavproxy_handover.gate.policy.access import Access, Rule, names

__all__ = [
    "COMMAND_RULES",
    "JUDGED_RULES",
    "MODE_BITS",
    "TAKE_OFF_RULES",
    "TURNING",
    "JudgedRule",
    "TakeOffRule",
    "VALUE_RULES",
    "ValueRule",
]


@dataclass(frozen=True, slots=True)
class TakeOffRule:
    """A command that arms an aircraft on the ground or makes it take off, and the reason.

    `unless_zero`: the number of the parameter that must not be 0 for that. `values`: what parameter `which` must be, if
    there are any; the autopilot keeps the last `bits` bits of it, whatever stands above them. `mode`: it is the number
    of a flight mode, `switch`: of an auxiliary function, so the firmware's own count too (`Modes`). `midway`: it
    begins the mission elsewhere than at its take-off, which START never does: on the ground it is refused.
    """

    name: str
    why: str
    unless_zero: int | None = None
    which: int = 1
    values: tuple[int, ...] = ()
    bits: int = 16
    mode: bool = False
    switch: bool = False
    midway: bool = False


#: The bits of a flight mode in the autopilot.
MODE_BITS: Final = 8


#: On the ground these need what START needs, for every commander. Names without MAV_CMD_. DO_SET_MISSION_CURRENT is not
#: one of them: outside AUTO it moves nothing, AUTO needs one of these, and START of a plane chooses the first item
#: again.
TAKE_OFF_RULES: Final = (
    TakeOffRule("COMPONENT_ARM_DISARM", "arms, forced or not; 0 disarms", unless_zero=1),
    # ArmDisarm (41 before 4.2), with AirMode, Turtle, and ArmEmergencyStop; the low position disarms
    TakeOffRule("DO_AUX_FUNCTION", "a switch that arms", unless_zero=2, values=(41, 151, 153, 154, 165), switch=True),
    TakeOffRule("DO_SET_MODE", "TURTLE arms a copter, AUTO takes a plane off", which=2, bits=MODE_BITS, mode=True),
    TakeOffRule("NAV_TAKEOFF", "takes off"),
    TakeOffRule("NAV_TAKEOFF_LOCAL", "takes off"),
    TakeOffRule("NAV_VTOL_TAKEOFF", "takes off"),
    TakeOffRule("SOLO_BTN_FLY_HOLD", "on the ground ArduCopter arms and takes off by it"),
    TakeOffRule("DO_LAND_START", "AUTO, from the landing sequence on", midway=True),
    TakeOffRule("DO_RETURN_PATH_START", "AUTO, from the nearest leg of a return path on", midway=True),
)

#: These turn motors on the ground, or prepare that, without arming. PREFLIGHT_CALIBRATION includes compass calibration
#: with throttle. In a rehearsal people have their hands on the aircraft.
TURNING: Final = names("DO_MOTOR_TEST ACTUATOR_TEST ACTUATOR_GROUP_TEST DO_ENGINE_CONTROL PREFLIGHT_CALIBRATION")


@dataclass(frozen=True, slots=True)
class JudgedRule:
    """A command that the situation judges in flight: its effect, its name for people, and the reason.

    `which` and `values`: the rule applies only if that parameter has such a value, of which the autopilot keeps the
    last 8 bits; a second pair works in the same way. `mode`: such a value is the mode of that name in `Modes`. `item`:
    the parameter that names an item of the mission. `speed`: the parameter that is a speed; the first parameter is its
    kind. For `Kind.FLY_TO`, parameters 5 to 7 are the place. `radius`: the parameter that wings take for the radius of
    the circle there. `height`: the parameter of a command that has only a height, which only wings take; 7 is the
    height of the place, and the MAV_FRAME of any other parameter is the next parameter.
    """

    name: str
    kind: Kind
    word: str
    why: str
    which: int | None = None
    values: tuple[int, ...] = ()
    also: tuple[int, int] | None = None
    item: int | None = None
    speed: int | None = None
    radius: int | None = None
    height: int | None = None
    #: it has an effect only in AUTO; otherwise it continues to what was judged before, or the autopilot refuses it
    auto_only: bool = False
    mode: Literal["", "auto", "follow"] = ""


#: In flight these are judged by energy, fence and coverage. Commands that lead away from danger are not here: RTL,
#: LAND, BRAKE, LOITER, a pause, landing sequences and return paths. Commands without a place are not here either: the
#: heading of a plane (GUIDED_CHANGE_HEADING), the velocity of a copter. Names without MAV_CMD_.
JUDGED_RULES: Final = (
    JudgedRule("DO_SET_MODE", Kind.GO_ON, "AUTO", "AUTO flies the mission on", which=2, mode="auto"),
    JudgedRule("DO_SET_MODE", Kind.UNKNOWN, "FOLLOW", "flies after another system", which=2, mode="follow"),
    JudgedRule("MISSION_START", Kind.GO_ON, "START", "AUTO flies the mission on"),
    # the switch function of AUTO, in its high position
    JudgedRule("DO_AUX_FUNCTION", Kind.GO_ON, "AUTO", "AUTO by a switch", which=1, values=(16,), also=(2, 2)),
    JudgedRule("DO_AUX_FUNCTION", Kind.UNKNOWN, "FOLLOW", "FOLLOW by a switch", which=1, values=(57,), also=(2, 2)),
    JudgedRule("DO_FOLLOW", Kind.UNKNOWN, "FOLLOW", "chooses which system is followed"),
    JudgedRule("DO_FOLLOW_REPOSITION", Kind.UNKNOWN, "FOLLOW", "the same"),
    JudgedRule("NAV_FOLLOW", Kind.UNKNOWN, "FOLLOW", "the same"),
    JudgedRule("DO_JUMP_TAG", Kind.UNKNOWN, "another item", "flies on from an item that has a label"),
    JudgedRule("DO_PAUSE_CONTINUE", Kind.GO_ON, "CONTINUE", "the same", which=1, values=(1,), auto_only=True),
    JudgedRule("DO_SET_MISSION_CURRENT", Kind.GO_ON, "another item", "flies from another item on", item=1),
    JudgedRule("DO_REPOSITION", Kind.FLY_TO, "target", "flies to a place, or to a circle around it", radius=3),
    JudgedRule("NAV_WAYPOINT", Kind.FLY_TO, "target", "flies to a place"),
    JudgedRule("NAV_SPLINE_WAYPOINT", Kind.FLY_TO, "target", "flies to a place"),
    JudgedRule("OVERRIDE_GOTO", Kind.FLY_TO, "target", "flies to a place"),
    JudgedRule("DO_ORBIT", Kind.FLY_TO, "target", "flies around a place"),
    JudgedRule("DO_CHANGE_ALTITUDE", Kind.FLY_TO, "altitude", "flies on at another height", height=1),
    JudgedRule("GUIDED_CHANGE_ALTITUDE", Kind.FLY_TO, "altitude", "flies on at another height", height=7),
    JudgedRule("DO_CHANGE_SPEED", Kind.SPEED, "speed", "another speed needs other energy", speed=2),
    JudgedRule("GUIDED_CHANGE_SPEED", Kind.SPEED, "speed", "another speed in GUIDED needs other energy", speed=2),
)


@dataclass(frozen=True, slots=True)
class ValueRule:
    """A command that has another class than its row in `COMMAND_RULES` if its first parameter is none of `values`.

    `cut`: the autopilot ignores the decimals. `word`: what people call the command with such a parameter. `words`: by
    value, where that differs.
    """

    name: str
    values: tuple[float, ...]
    access: Access
    why: str
    word: str
    words: Mapping[int, str] = field(default_factory=dict)
    cut: bool = False


VALUE_RULES: Final = (
    ValueRule(
        "PREFLIGHT_REBOOT_SHUTDOWN",
        (0.0, 1.0),
        Access.MAINTENANCE,
        "keeps the autopilot in its boot loader, shuts it down, locks it up or wipes its settings: only a person at "
        "the aircraft can start it again",
        "reboot of this kind",
        {2: "shutdown", 3: "hold in the boot loader"},
    ),
    ValueRule(
        "DO_PARACHUTE",
        (2.0,),
        Access.SAFEGUARD,
        "switches the parachute off or on; to release it (2) is the commander's at any time",
        "parachute on",
        {0: "parachute off"},
        cut=True,
    ),
)


#: Commands, in COMMAND_LONG and COMMAND_INT alike. Names without MAV_CMD_.
COMMAND_RULES: Final = (
    Rule(
        Access.READ,
        "asks for a message, a version or a state, and changes none",
        names("""
            REQUEST_MESSAGE REQUEST_PROTOCOL_VERSION REQUEST_AUTOPILOT_CAPABILITIES
            REQUEST_CAMERA_INFORMATION REQUEST_CAMERA_SETTINGS REQUEST_STORAGE_INFORMATION
            REQUEST_CAMERA_CAPTURE_STATUS REQUEST_FLIGHT_INFORMATION REQUEST_VIDEO_STREAM_INFORMATION
            REQUEST_VIDEO_STREAM_STATUS GET_HOME_POSITION
        """),
    ),
    Rule(
        Access.BULK,
        "has several answers: of every node on a bus, or lines of text that every station gets to read",
        names("UAVCAN_GET_NODE_INFO DO_SEND_BANNER"),
    ),
    Rule(
        Access.ANSWERED,
        "rates belong to the autopilot's one channel to us; what an observer gets is the companion's choice",
        names("SET_MESSAGE_INTERVAL GET_MESSAGE_INTERVAL"),
    ),
    Rule(
        Access.CONTROL,
        "the operator-control standard: the companion is the system manager that answers it",
        names("REQUEST_OPERATOR_CONTROL"),
    ),
    Rule(
        Access.MAINTENANCE,
        "rewrites the boot loader or stops the processor",
        names("FLASH_BOOTLOADER DEBUG_TRAP SET_FACTORY_TEST_MODE"),
    ),
    Rule(
        Access.MAINTENANCE,
        "opens a bus, binds a receiver, or wipes storage",
        names("CAN_FORWARD START_RX_PAIR STORAGE_FORMAT"),
    ),
    Rule(
        Access.MAINTENANCE,
        "stops the guard: scripting can be halted by it",
        names("SCRIPTING"),
    ),
    Rule(
        Access.MAINTENANCE,
        "gives the vehicle another system id: companion and lease would not follow",
        names("DO_SET_SYS_CMP_ID"),
    ),
    Rule(
        Access.MAINTENANCE,
        "breaks sensors on purpose",
        names("INJECT_FAILURE"),
    ),
    Rule(
        Access.SAFEGUARD,
        "resets or writes parameters without naming them, the guard's and the failsafes' among them",
        names("PREFLIGHT_STORAGE DO_SET_PARAMETER"),
    ),
    Rule(
        Access.SAFEGUARD,
        "restarts the autopilot, in flight too if a parameter says so, and the guard with it",
        names("PREFLIGHT_REBOOT_SHUTDOWN"),
    ),
    Rule(
        Access.SAFEGUARD,
        "declares the battery full: its failsafe would count from there",
        names("BATTERY_RESET"),
    ),
    Rule(
        Access.SAFEGUARD,
        "moves home or the origin: heights of the mission and of a return are measured from home, and RTL ends there",
        names("DO_SET_HOME DO_SET_GLOBAL_ORIGIN"),
    ),
    Rule(
        Access.SAFEGUARD,
        "switches the fence off or on, for this flight; what is judged by it has to stay",
        names("DO_FENCE_ENABLE"),
    ),
    Rule(
        Access.SAFEGUARD,
        "changes which sensors the estimator uses, or tells it what to believe: a return is flown by its position",
        names("""
            SET_EKF_SOURCE_SET ESTIMATOR_SENSOR_ENABLE EXTERNAL_POSITION_ESTIMATE EXTERNAL_ATTITUDE_ESTIMATE
            EXTERNAL_WIND_ESTIMATE SET_HAGL PREFLIGHT_SET_SENSOR_OFFSETS FIXED_MAG_CAL FIXED_MAG_CAL_FIELD
            FIXED_MAG_CAL_YAW DO_START_MAG_CAL DO_ACCEPT_MAG_CAL
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "has a plane fly upside down, in a return too",
        names("DO_INVERTED_FLIGHT"),
    ),
    Rule(
        Access.COMMAND,
        "arms, disarms, ends the flight, or changes the mode",
        names("""
            DO_SET_MODE DO_FLIGHTTERMINATION DO_PARACHUTE DO_SET_STANDARD_MODE COMPONENT_ARM_DISARM
            RUN_PREARM_CHECKS ARM_AUTHORIZATION_REQUEST DO_SET_SAFETY_SWITCH_STATE
        """),
    ),
    Rule(
        Access.COMMAND,
        "starts, stops, continues or moves in the mission; only the commander may stop (thesis 6.1)",
        names("""
            DO_JUMP DO_GO_AROUND DO_PAUSE_CONTINUE DO_SET_MISSION_CURRENT OVERRIDE_GOTO MISSION_START JUMP_TAG
            DO_JUMP_TAG
        """),
    ),
    Rule(
        Access.COMMAND,
        "flies: the same as a mission item, done at once",
        names("""
            NAV_WAYPOINT NAV_LOITER_UNLIM NAV_LOITER_TURNS NAV_LOITER_TIME NAV_RETURN_TO_LAUNCH NAV_LAND
            NAV_TAKEOFF NAV_LAND_LOCAL NAV_TAKEOFF_LOCAL NAV_FOLLOW NAV_CONTINUE_AND_CHANGE_ALT
            NAV_LOITER_TO_ALT DO_FOLLOW DO_FOLLOW_REPOSITION DO_ORBIT DO_FIGURE_EIGHT NAV_ARC_WAYPOINT NAV_ROI
            NAV_PATHPLANNING NAV_SPLINE_WAYPOINT NAV_ALTITUDE_WAIT NAV_VTOL_TAKEOFF NAV_VTOL_LAND
            NAV_GUIDED_ENABLE NAV_DELAY NAV_PAYLOAD_PLACE NAV_LAST CONDITION_DELAY CONDITION_CHANGE_ALT
            CONDITION_DISTANCE CONDITION_YAW CONDITION_LAST DO_CHANGE_SPEED DO_CHANGE_ALTITUDE
            DO_RETURN_PATH_START DO_LAND_START DO_RALLY_LAND DO_REPOSITION DO_SET_REVERSE NAV_SET_YAW_SPEED
            DO_SET_RESUME_REPEAT_DIST DO_GUIDED_MASTER DO_GUIDED_LIMITS DO_LAST
            OBLIQUE_SURVEY PANORAMA_CREATE DO_VTOL_TRANSITION SET_GUIDED_SUBMODE_STANDARD
            SET_GUIDED_SUBMODE_CIRCLE CONDITION_GATE NAV_FENCE_RETURN_POINT NAV_FENCE_POLYGON_VERTEX_INCLUSION
            NAV_FENCE_POLYGON_VERTEX_EXCLUSION NAV_FENCE_CIRCLE_INCLUSION NAV_FENCE_CIRCLE_EXCLUSION
            NAV_FENCE_HOME_CIRCLE_INCLUSION
            NAV_RALLY_POINT WAYPOINT_USER_1 WAYPOINT_USER_2 WAYPOINT_USER_3 WAYPOINT_USER_4 WAYPOINT_USER_5
            SPATIAL_USER_1 SPATIAL_USER_2 SPATIAL_USER_3 SPATIAL_USER_4 SPATIAL_USER_5 NAV_SCRIPT_TIME
            NAV_ATTITUDE_TIME GUIDED_CHANGE_SPEED GUIDED_CHANGE_ALTITUDE GUIDED_CHANGE_HEADING
        """),
    ),
    Rule(
        Access.COMMAND,
        "tunes, logs, or tells scripts and others something; DO_AUX_FUNCTION is judged by what it switches besides",
        names("""
            DO_AUTOTUNE_ENABLE DO_SEND_SCRIPT_MESSAGE DO_AUX_FUNCTION LOGGING_START LOGGING_STOP AIRFRAME_CONFIGURATION
            CONTROL_HIGH_LATENCY DO_ADSB_OUT_IDENT ODID_SET_EMERGENCY
        """),
    ),
    Rule(
        Access.COMMAND,
        "calibrates or tests; the autopilot itself refuses what is unsafe in flight",
        names("""
            DO_MOTOR_TEST PREFLIGHT_CALIBRATION PREFLIGHT_UAVCAN ACTUATOR_TEST ACTUATOR_GROUP_TEST CONFIGURE_ACTUATOR
            POWER_OFF_INITIATED DO_CANCEL_MAG_CAL ACCELCAL_VEHICLE_POS GIMBAL_RESET GIMBAL_AXIS_CALIBRATION_STATUS
            GIMBAL_REQUEST_AXIS_CALIBRATION GIMBAL_FULL_RESET
        """),
    ),
    Rule(
        Access.COMMAND,
        "drives an output or the payload",
        names("""
            DO_SET_RELAY DO_REPEAT_RELAY DO_SET_SERVO DO_REPEAT_SERVO DO_SET_ACTUATOR DO_GRIPPER DO_SPRAYER
            DO_ENGINE_CONTROL ILLUMINATOR_ON_OFF DO_ILLUMINATOR_CONFIGURE LOWEHEISER_SET_STATE
            PAYLOAD_PREPARE_DEPLOY PAYLOAD_CONTROL_DEPLOY DO_WINCH
        """),
    ),
    Rule(
        Access.COMMAND,
        "points or works a camera or gimbal",
        names("""
            DO_SET_ROI_LOCATION DO_SET_ROI_WPNEXT_OFFSET DO_SET_ROI_NONE DO_SET_ROI_SYSID DO_CONTROL_VIDEO
            DO_SET_ROI DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL
            DO_SET_CAM_TRIGG_DIST DO_SET_CAM_TRIGG_INTERVAL DO_MOUNT_CONTROL_QUAT RESET_CAMERA_SETTINGS
            SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS SET_STORAGE_USAGE SET_CAMERA_SOURCE
            DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE
            REQUEST_CAMERA_IMAGE_CAPTURE DO_TRIGGER_CONTROL CAMERA_TRACK_POINT CAMERA_TRACK_RECTANGLE
            CAMERA_STOP_TRACKING VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE VIDEO_START_STREAMING
            VIDEO_STOP_STREAMING CAMERA_START_MTI CAMERA_STOP_MTI
        """),
    ),
    Rule(
        Access.COMMAND,
        "buttons and users' own commands: what they do is not known here",
        names("""
            USER_1 USER_2 USER_3 USER_4 USER_5 SOLO_BTN_FLY_CLICK SOLO_BTN_FLY_HOLD SOLO_BTN_PAUSE_CLICK
        """),
    ),
)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy of parameters: those that the safety of the flight depends on, by name, and the others.

While the vehicle is armed no station may set a safeguard, not even the commander: the autopilot saves the setting, and
the next commander would fly without that failsafe. On the ground the commander may. Rules:

1. A parameter is a safeguard if it can switch off the guard, a failsafe of the autopilot, the RC pilot, or the check of
   authority. It is also one if it can open another way into the autopilot.
2. A parameter is a safeguard if it shapes a return: its end, height, speeds, accelerations and angles, what it avoids,
   its sensors, its home, its landing. Guard or failsafe order a return when no station commands any more. So it must be
   the return that was checked before take-off, and that the energy is computed for. The commander changes its speed by
   DO_CHANGE_SPEED, which is judged.
3. A parameter that is known to do neither is the commander's at any time: gains, telemetry, logs, payload, and the
   pilot's own modes. Such a parameter has a row that says so.
4. A parameter without a row is a safeguard: its effect on a return is not known.
5. `*` stands for any characters. Case does not matter, as in ArduPilot. The first row that fits counts.
6. A message that sets parameters without naming them cannot be judged here: see `commands`, `files`.

Names of firmware 4.5 to 4.7, Copter's and Plane's, and Rover's where they differ. If a name changed, both names have a
row. `tests/data/firmware_parameters.txt` has the firmware's names, and the class that each is expected to have.
"""

from __future__ import annotations

import re
from typing import Final

from mavproxy_handover.gate.policy.access import ANY, Access, Rule, names

__all__ = ["PARAMETER_MESSAGES", "PARAMETER_RULES", "OTHER_PARAMETERS", "parameter_name", "parameter_rule"]

#: Messages that set the parameter that their `param_id` names.
PARAMETER_MESSAGES: Final = names("PARAM_SET PARAM_EXT_SET PARAM_MAP_RC")

PARAMETER_RULES: Final = (
    Rule(
        Access.MAINTENANCE,
        "the length of the autopilot's own rally list: 0 sends a return home, more brings back points of other flights",
        names("RALLY_TOTAL"),
    ),
    Rule(
        Access.SAFEGUARD,
        "the guard's own, and the count of starts that its nonce is drawn from",
        names("HNDO_* STAT_*"),
    ),
    Rule(Access.SAFEGUARD, "scripting, which the guard runs in: SCR_ENABLE 0 ends it in a second", names("SCR_*")),
    Rule(
        Access.SAFEGUARD,
        "the autopilot's failsafes, and the parachute",
        names("FS_* THR_FAILSAFE THR_FS_VALUE AFS_* CHUTE_* GUID_TIMEOUT GUIDED_TIMEOUT DR_* CRASH_* TERR_*"),
    ),
    Rule(Access.SAFEGUARD, "the battery's failsafe, and what it measures by", names("BATT*")),
    Rule(Access.SAFEGUARD, "the fence", names("FENCE_*")),
    Rule(
        Access.SAFEGUARD,
        "where a return ends, and the way there: RALLY_INCL_HOME 1 may send it home, RTL_ALT_FINAL lets it hover, "
        "RTL_SPEED sets its speed",
        names("RALLY_* RTL_* SRTL_* LAND_* Q_RTL_* Q_LAND_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "how a plane comes down: whether its rotors carry it, what fails over to them, and how it lands",
        names("Q_ENABLE Q_OPTIONS Q_ASSIST_* Q_TRANS_FAIL* Q_FW_LND_* AUTOLAND_* ALAND_* TECS_LAND_* ALT_HOLD_RTL"),
    ),
    Rule(
        Access.SAFEGUARD,
        "how a plane flies its return: with a climb straight on whatever RTL_CLIMB_MIN says (bit 4), at heights above "
        "the ground",
        names("FLIGHT_OPTIONS TERRAIN_* CLIMB_SLOPE_HGT GLIDE_SLOPE_* ALT_SLOPE_* ALT_OFFSET CRUISE_ALT_FLOOR"),
    ),
    Rule(
        Access.SAFEGUARD,
        "the speeds and accelerations by which a copter flies to a place, a return's too where RTL_SPEED is 0; of a "
        "plane, how it turns at places and in which circle it waits",
        names("WPNAV_* WP_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "how far a copter leans, how hard it turns and how softly it begins: that limits its speed in wind",
        names("""
            ANGLE_MAX ATC_ANGLE_MAX ATC_ANG_LIM_TC ATC_ANGLE_BOOST ATC_ACC* ATC_RATE_*MAX ATC_RATE_FF_ENAB ATC_SLEW_YAW
            ATC_INPUT_TC ATC_THR_* PSC_ANGLE_MAX PSC_JERK_*
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "how a copter waits and brakes in LOITER and under sticks, and how it flies circles of a mission",
        names("LOIT_* PILOT_* CIRCLE_* GUID_OPTIONS AUTO_OPTIONS"),
    ),
    Rule(
        Access.SAFEGUARD,
        "what the aircraft avoids, in a return too: it stops, backs away, climbs or flies around what it takes for an "
        "obstacle or for traffic",
        names("AVOID_* OA_* AVD_* PRX* ADSB_TYPE ADSB_LIST_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "the airspeeds, the throttle and the ground speed by which a plane flies, in a return too",
        names("""
            AIRSPEED_* TRIM_ARSPD_CM ARSPD_FBW_* MIN_GROUNDSPEED MIN_GNDSPD_CM TRIM_THROTTLE THR_MAX THR_MIN
            THR_SLEWRATE THROTTLE_NUDGE THR_SUPP_MAN THR_PASS_STAB SCALING_SPEED STALL_PREVENTION USE_REV_THRUST
            FWD_BAT_* FLAP_* DSPOILER_* PUP_* SOAR_*
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "how steeply a plane banks, climbs and sinks, and how it keeps its track, in a return too",
        names("""
            TECS_* NAVL1_* ROLL_LIMIT_DEG LIM_ROLL_CD PTCH_LIM_* LIM_PITCH_* LEVEL_ROLL_LIMIT STAB_PITCH_DOWN
            PTCH_TRIM_DEG TRIM_PITCH_CD RUDDER_ONLY STICK_MIXING
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "what an ArduPlane says that it is: by another type its modes are taken for those of another aircraft",
        names("Q_MAV_TYPE"),
    ),
    # gains come before other names with the same beginning
    Rule(
        Access.COMMAND,
        "gains of the attitude and position controllers, and what tunes them: they say how well a path is kept, and "
        "not which one it is",
        names("""
            ATC_RAT_* ATC_ANG_*_P ATC_LAND_* ATC_HOVR_ROL_TRM ATC_PIRO_COMP PSC_* Q_A_RAT_* Q_A_ANG_*_P Q_A_LAND_*
            Q_P_ACC* Q_P_D_* Q_P_NE_* Q_P_POS* Q_P_VEL* RLL_RATE_* PTCH_RATE_* YAW_RATE_* RLL2SRV_* PTCH2SRV_*
            YAW2SRV_* STEER2SRV_* KFF_* AUTOTUNE_* Q_AUTOTUNE_* QUIK_* QWIK_* RTUN_* GUIDED_* INS_HNTC2_* INS_HNTCH_*
            FFT_* FILT*
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "how a plane flies on its rotors, in a return too: speeds, accelerations, angles, transitions, motors",
        names("Q_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "what the estimator flies by and what its sensors measure: position, height, heading, wind; home and origin",
        names("""
            AHRS_* EK2_* EK3_* EAHRS_* GPS* COMPASS_* BARO* INS* ARSPD* RNGFND* FLOW_* VISO_* BCN_* TCAL_* HOME_*
        """),
    ),
    Rule(
        Access.SAFEGUARD,
        "lands elsewhere, or otherwise: precision landing, ship landing, landing gear, weather vane, ground effect",
        names("PLND_* PLDP_* SHIP_* LGR_* WVANE_* GND_EFFECT_COMP"),
    ),
    Rule(
        Access.SAFEGUARD,
        "how the mission is held and what AUTO does after a return: with MIS_RESTART 1 CONTINUE begins it again",
        names("MIS_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "lets a knob of the transmitter, or a station's RC override, change a speed or a gain in flight",
        names("TUNE TUNE_* TUNE2*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "motors, rotor, engine and outputs: what carries the aircraft back",
        names("MOT_* H_* IM_* AROT_* ICE_* SERVO* RELAY* FRAME_* ESC* TKOFF_* DISARM_DELAY RUDD_* MIXING_*"),
    ),
    Rule(Access.SAFEGUARD, "the checks before arming, the guard's among them", names("ARMING_*")),
    Rule(
        Access.COMMAND,
        "rates of telemetry on one link",
        names("SR*_* MAV*_ADSB MAV*_EXT_STAT MAV*_EXTRA* MAV*_PARAMS MAV*_POSITION MAV*_RAW_* MAV*_RC_CHAN"),
    ),
    Rule(
        Access.SAFEGUARD,
        "which station the autopilot obeys, and whose heartbeat it counts",
        names("MAV_* SYSID_*"),
    ),
    Rule(Access.SAFEGUARD, "signing and forwarding on one link", names("MAV*_OPTIONS")),
    Rule(
        Access.SAFEGUARD,
        "what is spoken on a port: takes the companion's link away or opens another way in",
        names("SERIAL* NET_* CAN_* DDS_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "the sticks and switches of the RC pilot, who always wins",
        names("RC_* RCMAP_* RC*_OPTION RC*_MIN RC*_MAX RC*_TRIM RC*_DZ RC*_REVERSED FLTMODE* MODE_CH"),
    ),
    Rule(Access.SAFEGUARD, "safety switch, watchdog, protection of the flash", names("BRD_*")),
    Rule(Access.SAFEGUARD, "0 wipes all parameters at the next start", names("FORMAT_VERSION")),
    Rule(
        Access.COMMAND,
        "logs, displays, lights and sounds, and how the aircraft shows itself to others",
        names("""
            LOG_* OSD* NTF_* VTX_* MSP_* FRSKY_* GCS_PID_MASK DID_* TELEM_DELAY ADSB_EMIT_TYPE ADSB_ICAO_*
            ADSB_LEN_WIDTH ADSB_LOG ADSB_OFFSET_* ADSB_OPTIONS ADSB_RF_* ADSB_SQUAWK
        """),
    ),
    Rule(
        Access.COMMAND,
        "the payload: cameras, gimbals, grippers, winch",
        names("CAM_* CAM1_* CAM2_* MNT* GRIP_* SPRAY_* WINCH_* VID1_*"),
    ),
    Rule(
        Access.COMMAND,
        "flight modes in which a person flies by hand, or has the aircraft follow: no return is flown by them",
        names("ACRO_* PHLD_* FHLD_* ZIGZ_* THROW_* SIMPLE SUPER_SIMPLE FOLL_* FBWB_* MAN_* SURFTRAK_*"),
    ),
    Rule(Access.COMMAND, "of a simulated aircraft alone", names("SIM_*")),
)

#: Every other parameter.
OTHER_PARAMETERS: Final = Rule(Access.SAFEGUARD, "any other parameter: what it does to a return is not known", (ANY,))


def _matcher(rules: tuple[Rule, ...]) -> re.Pattern[str]:
    """One expression for all patterns; the group that matched is the number of the rule."""
    groups = ("|".join(re.escape(name).replace(r"\*", ".*") for name in rule.names) for rule in rules)
    return re.compile("|".join(f"({group})" for group in groups), re.DOTALL)


_MATCHER: Final = _matcher(PARAMETER_RULES)


_UNPRINTABLE: Final = re.compile(r"[^ -~]")


def parameter_name(param_id: bytes) -> str:
    """The name in a `param_id` field, as the autopilot reads it: up to the first zero byte, in capitals.

    What cannot be printed is a question mark: the name goes to consoles and journals.
    """
    return _UNPRINTABLE.sub("?", param_id.partition(b"\0")[0].decode("latin-1")).upper()


def parameter_rule(name: str) -> Rule:
    """The row of a parameter, `OTHER_PARAMETERS` if it has none of its own."""
    found = _MATCHER.fullmatch(name)
    return OTHER_PARAMETERS if found is None or found.lastindex is None else PARAMETER_RULES[found.lastindex - 1]

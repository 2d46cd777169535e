# SPDX-License-Identifier: GPL-3.0-or-later

"""The profile of a copter: ArduCopter.

`CopterProcedures` says how it returns: by RTL, or by LAND if RTL does not show.

Sources: ArduCopter's mode.h, events.cpp, ekf_check.cpp, fence.cpp and RC_Channel_Copter.cpp; GCS_MAVLink_Copter.cpp for
texts, arming, MISSION_START and DO_PAUSE_CONTINUE.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.handling import STANDS_STILL
from mavproxy_handover.core.common.model import FlightAction, ModeClass
from mavproxy_handover.core.safety.energy_prior import ON_ROTORS
from mavproxy_handover.vehicle.profiles.procedures import FlightProcedures
from mavproxy_handover.vehicle.profiles.profile import (
    READ_OF_EVERY,
    SWITCHED,
    GuardRow,
    Modes,
    Profile,
    RuleGroup,
    mode_names,
    modes_of,
)
from mavproxy_handover.wire.conversation import Asking, NoAnswer
from mavproxy_handover.wire.ids import MISSION_START

__all__ = ["COPTER", "CopterProcedures"]

#: the flight mode TURTLE arms with hardly a check, and switches the failsafes off
_AUTO, _BRAKE, _TURTLE, _FOLLOW = 3, 17, 28, 23
_LONGEST_WAIT_S: Final = 65535
_WAIT: Final = (0, _LONGEST_WAIT_S, f"0 to {_LONGEST_WAIT_S} s")
#: why others do not fly these items
_BOTH: Final = "it takes an aircraft that hovers and has wings"


@dataclass(frozen=True, slots=True)
class CopterProcedures(FlightProcedures):
    """Those of ArduCopter, and of an autopilot of which no profile is known."""

    @property
    def firmware(self) -> Profile:
        """ArduCopter."""
        return COPTER

    def start(self) -> Asking:
        """Arm in GUIDED, then fly the mission in AUTO: what START means."""
        yield from self._mode(COPTER.guided)
        yield from self._arm()
        yield from self._do("MISSION_START", MISSION_START)
        yield from self._shows("mode AUTO", lambda m: bool(m.custom_mode == COPTER.auto))

    def hold(self, pause: bool) -> Asking:
        """Stop where it is, or go on. Returns what it does."""
        what = "hold" if pause else "go on"
        yield from self._do(what, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0 if pause else 1)
        return what

    def stand(self) -> Asking:
        """BRAKE: a paused GUIDED would ignore the commander's next targets. Returns what it does."""
        yield from self._mode(_BRAKE)
        return COPTER.mode_name(_BRAKE)

    def bring_home(self, action: FlightAction) -> Asking:
        """RTL, and LAND if that cannot be had. Returns the name of the mode that the autopilot took.

        An autopilot of no profile gets no number of a mode: the number means another mode there (6 is FOLLOW for a
        rover).
        """
        if self.aircraft.foreign:
            yield from self._do("return to launch", mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
            return "return to launch"
        wanted = (COPTER.back, COPTER.land) if action is FlightAction.RETURN else (COPTER.land,)
        return (yield from self._first_of(partial(self._named_mode, mode) for mode in wanted))

    def _named_mode(self, mode: int) -> Asking:
        """Change the mode and see it in a heartbeat. Returns its name."""
        yield from self._mode(mode)
        return COPTER.mode_name(mode)

    def return_anew(self) -> Asking:
        """Leave RTL and begin it again, at a full stop: it reads its place when it begins. What `bring_home` returns.

        If it does not leave, it is in RTL still.
        """
        with suppress(NoAnswer):
            yield from self._mode(COPTER.guided)
        return (yield from self.bring_home(FlightAction.RETURN))


COPTER: Final = Profile(
    name="copter",
    firmware="ArduCopter",
    types=frozenset(
        {
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_TYPE_COAXIAL,
            mavlink.MAV_TYPE_HELICOPTER,
            mavlink.MAV_TYPE_HEXAROTOR,
            mavlink.MAV_TYPE_OCTOROTOR,
            mavlink.MAV_TYPE_TRICOPTER,
            mavlink.MAV_TYPE_DODECAROTOR,
            mavlink.MAV_TYPE_DECAROTOR,
        }
    ),
    modes=modes_of(
        {
            # the pilot who chose FOLLOW or THROW keeps the aircraft
            ModeClass.HANDS: {
                0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 5: "LOITER", 11: "DRIFT", 13: "SPORT", 14: "FLIP",
                15: "AUTOTUNE", 16: "POSHOLD", 18: "THROW", 22: "FLOWHOLD", _FOLLOW: "FOLLOW", 24: "ZIGZAG",
                25: "SYSTEMID", 26: "AUTOROTATE", _TURTLE: "TURTLE",
            },
            ModeClass.MISSION: {_AUTO: "AUTO"},
            ModeClass.GUIDED: {4: "GUIDED", 20: "GUIDED_NOGPS"},
            ModeClass.STOP: {_BRAKE: "BRAKE"},
            ModeClass.RETURN: {6: "RTL", 21: "SMART_RTL", 27: "AUTO_RTL"},
            ModeClass.LAND: {9: "LAND"},
            ModeClass.OTHER: {7: "CIRCLE"},
        }
    ),
    gate=Modes(mode_names("COPTER_MODE"), _AUTO, (_TURTLE,), follow=_FOLLOW),
    auto=_AUTO,
    guided=4,
    back=6,
    land=9,
    to_place=frozenset({6}),
    # "GCS Failsafe", "EKF Failsafe: changed to LAND Mode", "Failsafe: Terrain data missing", "Polygon fence breached"
    by_itself=re.compile(r"\bFailsafe\b(?!.*[Cc]leared)|\b[Bb]reached$|^Trying \w+ Mode|^SmartRTL Unavailable"),
    starts_by="GUIDED, arm, AUTO",
    carried_out={
        FlightAction.HOLD: "stops, its mission paused",
        FlightAction.CONTINUE: "flies on, its mission resumed",
        FlightAction.RETURN: "RTL to the return site, and down",
        FlightAction.LAND: "LAND, where it is",
    },
    handling=STANDS_STILL,
    procedures=CopterProcedures,
    energy=ON_ROTORS,
    guard=GuardRow(
        firmware_type=2,
        # STABILIZE ACRO ALT_HOLD LOITER DRIFT SPORT FLIP AUTOTUNE POSHOLD FLOWHOLD SYSTEMID
        manual=frozenset({0, 1, 2, 5, 11, 13, 14, 15, 16, 22, 25}),
        # RC switch, throttle escape, toy, RC telemetry, RC auxiliary switch
        pilots=frozenset({1, 9, 18, 42, 53}),
        # radio, battery, GCS, EKF, GPS glitch, fence, terrain, avoidance, termination, crash, general, dead reckoning
        failsafes=frozenset({3, 4, 5, 6, 7, 10, 11, 14, 17, 19, 25, 50}),
        commands={2: "command", 32: "script", 52: "DDS command"},
        ladder={1: (6, 6, 6, 9), 2: (21, 6, 6, 6, 9), 3: (9,)},
    ),
    not_flown={
        mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: "ArduCopter passes over it",
        mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: _BOTH,
        mavlink.MAV_CMD_NAV_VTOL_LAND: _BOTH,
        mavlink.MAV_CMD_DO_VTOL_TRANSITION: _BOTH,
    },
    item_ranges={
        (mavlink.MAV_CMD_NAV_WAYPOINT, 1): _WAIT,
        (mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT, 1): _WAIT,
        (mavlink.MAV_CMD_NAV_LOITER_TIME, 1): _WAIT,
        (mavlink.MAV_CMD_NAV_DELAY, 1): _WAIT,
        (mavlink.MAV_CMD_NAV_LOITER_TURNS, 1): (0, 255, "0 to 255 turns"),
        (mavlink.MAV_CMD_NAV_LOITER_TURNS, 3): (-2000, 2000, "a radius up to 2000 m, below 0 to the left"),
    },
    height_unused=frozenset((mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_PAYLOAD_PLACE)),
    height_zero_unused=True,
    cruise={"WPNAV_SPEED": 100.0, "WP_SPD": 1.0},
    back_speed={"RTL_SPEED": 100.0, "RTL_SPEED_MS": 1.0},
    return_alt={"RTL_ALT_M": 1.0, "RTL_ALT": 100.0},
    radio_failsafe="FS_THR_ENABLE",
    gcs_failsafe="FS_GCS_ENABLE",
    gcs_timeout="FS_GCS_TIMEOUT",
    reads=(
        *READ_OF_EVERY, "FS_GCS_ENABLE", "FS_GCS_TIMEOUT", "FS_OPTIONS", "RALLY_LIMIT_KM",
        "SYSID_ENFORCE", "MAV_OPTIONS", "FS_THR_ENABLE", "RC_PROTOCOLS", "SCR_VM_I_COUNT", "SCR_LD_CHECKSUM",
        "ARMING_CHECK", "ARMING_SKIPCHK",
        *SWITCHED,
        "BATT_MONITOR", "BATT_FS_LOW_ACT", "BATT_FS_CRT_ACT", "BATT_LOW_VOLT", "BATT_LOW_MAH",
        "FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE", "FENCE_ACTION", "FENCE_OPTIONS", "FENCE_RADIUS",
        "FENCE_ALT_MAX",
        "RTL_ALT", "RTL_ALT_M", "RTL_ALT_FINAL", "RTL_ALT_FINAL_M", "RTL_SPEED", "RTL_SPEED_MS", "RALLY_INCL_HOME",
        "RTL_CLIMB_MIN", "RTL_CLIMB_MIN_M", "RTL_LOIT_TIME", "HNDO_ACTION", "FS_DR_ENABLE",
        "TERRAIN_ENABLE", "WPNAV_RFND_USE", "RNGFND1_TYPE", "CIRCLE_RATE", "DID_ENABLE", "DID_MAVPORT", "DID_CANDRIVER",
        "DID_OPTIONS",
        "WPNAV_SPEED", "WP_SPD", "WPNAV_SPEED_UP", "WP_SPD_UP", "WPNAV_SPEED_DN", "WP_SPD_DN", "LAND_SPEED",
        "LAND_SPD_MS",
        "LAND_ALT_LOW", "LAND_ALT_LOW_M", "WPNAV_ACCEL", "WP_ACC", "OA_TYPE", "GRIP_ENABLE",
    ),
    rules=frozenset((RuleGroup.EVERY, RuleGroup.ARDUCOPTER)),
    parameter_file="handover.parm",
)  # fmt: skip

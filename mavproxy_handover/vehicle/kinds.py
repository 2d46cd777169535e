# SPDX-License-Identifier: GPL-3.0-or-later

"""The firmware that is flown here, as data: what its flight modes are called and do, what it says, and how its names
differ. One `Vehicle` for each; who needs to know asks the aircraft for its own (`Aircraft.vehicle`), and nobody asks
whether it is a plane.

What an autopilot says of itself is the frame (MAV_TYPE), and numbers of flight modes mean something else in every
firmware. ArduPlane says FIXED_WING of itself, hovering or not, unless Q_MAV_TYPE names another type, be it a copter's.
But then it says when it flies on its wings (EXTENDED_SYS_STATE), which no copter does, and Q_MAV_TYPE is read before
START.

Sources: ArduCopter's mode.h, events.cpp, ekf_check.cpp, fence.cpp, RC_Channel_Copter.cpp, GCS_MAVLink_Copter.cpp;
ArduPlane's mode.h, events.cpp, system.cpp, ekf_check.cpp, fence.cpp, commands_logic.cpp, quadplane.cpp (`get_mav_type`)
and GCS_MAVLink_Plane.cpp.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.gate.policy import modes as gate_modes
from mavproxy_handover.gate.policy.modes import Modes
from mavproxy_handover.wire.ids import COPTER_AUTO, PLANE_AUTO, WINGED_TYPES

__all__ = ["COPTER", "PLANE", "VEHICLES", "Mode", "Vehicle", "vehicle_of"]


@dataclass(frozen=True, slots=True)
class Mode:
    """A flight mode: its name in the firmware, and what it does."""

    name: str
    flown: ModeClass


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """A firmware that is flown here. There is one object for each: they are told apart by identity."""

    #: what people call it
    name: str
    #: the MAV_TYPEs that it gives itself
    types: frozenset[int]
    #: number -> flight mode
    modes: Mapping[int, Mode]
    #: the same as the gate judges by them
    judged_by: Modes
    #: the mode that flies the mission, the one that flies to places, and the one that a return is
    auto: int
    guided: int
    back: int
    #: the mode that comes down here and now
    land: int
    #: how START is carried out, for people
    starts_by: str
    #: the mode by which it holds where it is; None: it pauses within its mode
    hold: int | None
    #: modes that fly to the place which the rally list holds
    to_place: frozenset[int]
    #: what a STATUSTEXT of it says where it has chosen a mode by itself
    by_itself: re.Pattern[str]
    #: where a failsafe is over and the mode of before, which it names, is flown again; None: it never is
    restored: re.Pattern[str] | None = None
    #: where the mission has come to its end, and that is a mode of its own; None: it is none
    by_mission: re.Pattern[str] | None = None
    #: MAV_CMD -> the mode that it leads to (None: any), where that differs from what the others do
    commands: Mapping[int, ModeClass | None] = field(default_factory=dict)
    #: kind of speed that its missions are flown by: SPEED_TYPE
    speed_type: int = mavlink.SPEED_TYPE_GROUNDSPEED
    #: the parameter of that -> its units in one m/s; a firmware has one of them
    cruise: Mapping[str, float] = field(default_factory=dict)
    #: the parameter of the speed of a return -> its units likewise; none: a return is flown at the speed of missions
    back_speed: Mapping[str, float] = field(default_factory=dict)
    #: the parameters of the least and of the most that it may be -> units likewise; none: any speed above 0
    slowest: Mapping[str, float] = field(default_factory=dict)
    fastest: Mapping[str, float] = field(default_factory=dict)
    #: the parameter that has the loss of the radio noticed (0: not), and those of the GCS failsafe and of its time
    radio_failsafe: str = ""
    gcs_failsafe: str = ""
    gcs_timeout: str = ""

    def mode_name(self, number: int) -> str:
        """What people call a mode of this number."""
        mode = self.modes.get(number)
        return f"mode {number}" if mode is None else mode.name

    def flown(self, number: int) -> ModeClass:
        """What the mode of this number does."""
        mode = self.modes.get(number)
        return ModeClass.OTHER if mode is None else mode.flown


def _modes(rows: Mapping[ModeClass, Mapping[int, str]]) -> dict[int, Mode]:
    return {number: Mode(name, flown) for flown, names in rows.items() for number, name in names.items()}


# ---- ArduCopter ---------------------------------------------------------------------------------------------------

COPTER: Final = Vehicle(
    name="ArduCopter",
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
    modes=_modes(
        {
            # of FOLLOW and THROW nobody knows better than the pilot who chose them
            ModeClass.HANDS: {
                0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 5: "LOITER", 11: "DRIFT", 13: "SPORT", 14: "FLIP",
                15: "AUTOTUNE", 16: "POSHOLD", 18: "THROW", 22: "FLOWHOLD", 23: "FOLLOW", 24: "ZIGZAG", 25: "SYSTEMID",
                26: "AUTOROTATE", 28: "TURTLE",
            },
            ModeClass.MISSION: {COPTER_AUTO: "AUTO"},
            ModeClass.GUIDED: {4: "GUIDED", 20: "GUIDED_NOGPS"},
            ModeClass.STOP: {17: "BRAKE"},
            ModeClass.RETURN: {6: "RTL", 21: "SMART_RTL", 27: "AUTO_RTL"},
            ModeClass.LAND: {9: "LAND"},
            ModeClass.OTHER: {7: "CIRCLE"},
        }
    ),
    judged_by=gate_modes.COPTER,
    auto=COPTER_AUTO,
    guided=4,
    back=6,
    land=9,
    starts_by="GUIDED, arm, AUTO",
    hold=None,
    to_place=frozenset({6}),
    # "GCS Failsafe", "EKF Failsafe: changed to LAND Mode", "Failsafe: Terrain data missing", "Polygon fence breached"
    by_itself=re.compile(r"\bFailsafe\b(?!.*[Cc]leared)|\b[Bb]reached$|^Trying \w+ Mode|^SmartRTL Unavailable"),
    cruise={"WPNAV_SPEED": 100.0, "WP_SPD": 1.0},
    back_speed={"RTL_SPEED": 100.0, "RTL_SPEED_MS": 1.0},
    radio_failsafe="FS_THR_ENABLE",
    gcs_failsafe="FS_GCS_ENABLE",
    gcs_timeout="FS_GCS_TIMEOUT",
)  # fmt: skip

# ---- ArduPlane ----------------------------------------------------------------------------------------------------

PLANE: Final = Vehicle(
    name="ArduPlane",
    types=WINGED_TYPES,
    modes=_modes(
        {
            ModeClass.HANDS: {
                0: "MANUAL", 2: "STABILIZE", 3: "TRAINING", 4: "ACRO", 5: "FBWA", 6: "FBWB", 7: "CRUISE", 8: "AUTOTUNE",
                17: "QSTABILIZE", 18: "QHOVER", 19: "QLOITER", 22: "QAUTOTUNE", 23: "QACRO",
            },
            ModeClass.MISSION: {PLANE_AUTO: "AUTO"},
            ModeClass.GUIDED: {15: "GUIDED"},
            # CIRCLE is what the short radio failsafe chooses: it waits there for the long one
            ModeClass.STOP: {1: "CIRCLE", 12: "LOITER"},
            ModeClass.RETURN: {11: "RTL", 21: "QRTL"},
            ModeClass.LAND: {20: "QLAND", 25: "LOITER_ALT_QLAND", 26: "AUTOLAND"},
            ModeClass.OTHER: {13: "TAKEOFF", 14: "AVOID_ADSB", 16: "INITIALISING", 24: "THERMAL"},
        }
    ),
    judged_by=gate_modes.PLANE,
    auto=PLANE_AUTO,
    guided=15,
    back=11,
    land=20,
    starts_by="AUTO, arm",
    hold=12,
    to_place=frozenset({11, 21}),
    # "GCS Failsafe On: RTL", "RC Long Failsafe On: RTL", "RC Short Failsafe: switched to CIRCLE"; up to 4.5 "Failsafe.
    # Long event on: ..."; a battery's is told by what is wrong with it alone; a take-off or transition that fails
    # becomes QLAND
    by_itself=re.compile(
        r"\bFailsafe\b(?!.*([Cc]leared|\b[Oo]ff\b))|\b[Bb]reached$|^Battery \d+ is |^Throttle failsafe on|^EKF variance"
        r"|^Aircraft in auto without|^Failed to complete takeoff|^Transition failed"
    ),
    restored=re.compile(r"^Flight mode (\w+) restored"),
    # behind its last item, and at one that says so
    by_mission=re.compile(r"^Mission complete, changing mode|^Mission: \d+ RTL$"),
    commands={
        mavlink.MAV_CMD_NAV_LOITER_UNLIM: ModeClass.STOP,
        mavlink.MAV_CMD_DO_LAND_START: ModeClass.LAND,
        mavlink.MAV_CMD_DO_VTOL_TRANSITION: None,
    },
    speed_type=mavlink.SPEED_TYPE_AIRSPEED,
    cruise={"TRIM_ARSPD_CM": 100.0, "AIRSPEED_CRUISE": 1.0},
    slowest={"ARSPD_FBW_MIN": 1.0, "AIRSPEED_MIN": 1.0},
    fastest={"ARSPD_FBW_MAX": 1.0, "AIRSPEED_MAX": 1.0},
    radio_failsafe="THR_FAILSAFE",
    gcs_failsafe="FS_GCS_ENABL",
    gcs_timeout="FS_LONG_TIMEOUT",
)  # fmt: skip

VEHICLES: Final = (COPTER, PLANE)
_BY_TYPE: Final = {kind: vehicle for vehicle in VEHICLES for kind in vehicle.types}


def vehicle_of(autopilot: int, kind: int, *, winged: bool = False) -> Vehicle | None:
    """The firmware of a HEARTBEAT with this MAV_AUTOPILOT and MAV_TYPE; None: nothing that is flown here.

    `winged`: it has shown itself to fly on wings, which goes before the type.
    """
    if autopilot != mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return None
    return PLANE if winged else _BY_TYPE.get(kind)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The numbers of flight modes and of their reasons that the guard must know, by ArduPilot's names, once more.

Written out by hand: the tests hold the script's tables against these, and these against ArduPilot's headers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Named = Mapping[str, int]


@dataclass(frozen=True)
class Numbers:
    """Those of one kind of vehicle."""

    auto: int
    returns: Named
    landings: Named
    by_hand: Named
    """Modes in which a pilot steers."""
    pilots: Named
    """Reasons of a mode: the pilot chose it."""
    failsafes: Named
    commands: Named
    sequences: Named
    """Reasons of AUTO: the autopilot itself has gone over to the landing sequence."""
    resumed: Named
    """Reasons: a failsafe is over."""
    radio_failsafe: str
    winged: bool


_COMMANDS = {"GCS_COMMAND": 2, "SCRIPTING": 32, "DDS_COMMAND": 52}
_FAILSAFES = {
    **{"RADIO_FAILSAFE": 3, "BATTERY_FAILSAFE": 4, "GCS_FAILSAFE": 5, "EKF_FAILSAFE": 6, "GPS_GLITCH": 7},
    **{"FENCE_BREACHED": 10, "TERRAIN_FAILSAFE": 11, "AVOIDANCE": 14, "TERMINATE": 17, "CRASH_FAILSAFE": 19},
    **{"FAILSAFE": 25, "DEADRECKON_FAILSAFE": 50},
}

COPTER_NUMBERS = Numbers(
    auto=3,
    returns={"RTL": 6, "SMART_RTL": 21, "AUTO_RTL": 27},
    landings={"LAND": 9},
    by_hand={
        **{"STABILIZE": 0, "ACRO": 1, "ALT_HOLD": 2, "LOITER": 5, "DRIFT": 11, "SPORT": 13, "FLIP": 14, "POSHOLD": 16},
        **{"FLOWHOLD": 22, "AUTOTUNE": 15, "SYSTEMID": 25},
    },
    pilots={"RC_COMMAND": 1, "THROTTLE_LAND_ESCAPE": 9, "TOY_MODE": 18, "FRSKY_COMMAND": 42, "AUX_FUNCTION": 53},
    failsafes=_FAILSAFES,
    commands=_COMMANDS,
    sequences={},
    resumed={},
    radio_failsafe="FS_THR_ENABLE",
    winged=False,
)

PLANE_NUMBERS = Numbers(
    auto=10,
    returns={"RTL": 11, "QRTL": 21},
    landings={"QLAND": 20, "LOITER_ALT_QLAND": 25, "AUTOLAND": 26},
    by_hand={
        **{"MANUAL": 0, "STABILIZE": 2, "TRAINING": 3, "ACRO": 4, "FLY_BY_WIRE_A": 5, "FLY_BY_WIRE_B": 6, "CRUISE": 7},
        **{"AUTOTUNE": 8, "QSTABILIZE": 17, "QHOVER": 18, "QLOITER": 19, "QAUTOTUNE": 22, "QACRO": 23},
    },
    pilots={"RC_COMMAND": 1, "FRSKY_COMMAND": 42, "AUX_FUNCTION": 53},
    failsafes={
        **_FAILSAFES,
        **{"VTOL_FAILED_TRANSITION": 23, "VTOL_FAILED_TAKEOFF": 24, "MODE_TAKEOFF_FAILSAFE": 51},
    },
    commands=_COMMANDS,
    sequences={"BATTERY_FAILSAFE": 4, "RTL_COMPLETE_SWITCHING_TO_FIXEDWING_AUTOLAND": 40},
    resumed={"FENCE_RETURN_PREVIOUS_MODE": 43, "RADIO_FAILSAFE_RECOVERY": 48},
    radio_failsafe="THR_FAILSAFE",
    winged=True,
)

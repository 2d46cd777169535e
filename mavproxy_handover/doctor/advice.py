# SPDX-License-Identifier: GPL-3.0-or-later

"""Advice for each finding of the rules in `monitors/preflight/rules.py`, which say what is wrong and its consequence.

The values are those of `ardupilot_lua/handover.parm` or `handover_plane.parm` (wings), which are read, and the guard's
defaults.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Final

from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.vehicle.profiles import PROFILES, Profile
from mavproxy_handover.wire.ids import COMPANION_COMPID

__all__ = ["ONBOARD", "SENSORS", "advice"]

#: files with recommended parameters -> which aircraft each is for, in words
_FILES: Final = {profile.parameter_file: profile.parameter_file_for for profile in PROFILES}
#: the guard's defaults, which are the recommended values; its port depends on the wiring
_GUARD: Final = {
    "HNDO_ENABLE": "1",
    "HNDO_COMPID": str(COMPANION_COMPID),
    "HNDO_TIMEOUT": "3",
    "HNDO_LOST_T": "3",
    "HNDO_SYSID_SW": "1",
}
_OWN: Final = {
    "HNDO_CHAN": "Set HNDO_CHAN to the number of this port among the autopilot's MAVLink ports (handover_guard.md).",
    "HNDO_ALONE_MAX": "Set HNDO_ALONE_MAX to the longest gap of the mission, if the aircraft may fly alone.",
    "FS_THR_ENABLE": "Set FS_THR_ENABLE to 1, or RC_PROTOCOLS to 0 on a vehicle without radio control.",
    "THR_FAILSAFE": "Set THR_FAILSAFE to 1, or RC_PROTOCOLS to 0 on a vehicle without radio control.",
    "ARMING_REQUIRE": "Set ARMING_REQUIRE to 1.",
    "FS_GCS_ENABL": "Set FS_GCS_ENABL to 1.",
    "FS_LONG_TIMEOUT": "Set FS_LONG_TIMEOUT to 10.",
    "FS_LONG_ACTN": "Set FS_LONG_ACTN to 1.",
    "FS_SHORT_ACTN": "Set FS_SHORT_ACTN to 0.",
    "RTL_AUTOLAND": "Set RTL_AUTOLAND to 1.",
    "RTL_ALTITUDE": "Set RTL_ALTITUDE below FENCE_ALT_MAX.",
    "ALT_HOLD_RTL": "Set ALT_HOLD_RTL below FENCE_ALT_MAX.",
    "RTL_CLIMB_MIN": "Set RTL_CLIMB_MIN to 0; with wings lower, or FENCE_ALT_MAX above the route and it.",
    "RTL_CLIMB_MIN_M": "Set RTL_CLIMB_MIN_M to 0.",
    "RTL_LOIT_TIME": "Set RTL_LOIT_TIME to 5000 or less.",
    "Q_RTL_ALT": "Set Q_RTL_ALT nearer to RTL_ALTITUDE, or FENCE_ALT_MAX higher.",
    "MIS_RESTART": "Set MIS_RESTART to 0.",
    "FLIGHT_OPTIONS": "Take bit 4 out of FLIGHT_OPTIONS.",
    "TERRAIN_FOLLOW": "Take bits 0, 4 and 9 out of TERRAIN_FOLLOW.",
    "Q_OPTIONS": "Put bit 5 (32) into Q_OPTIONS, and take bits 1 and 2 out of it.",
    "Q_MAV_TYPE": "Set Q_MAV_TYPE to 0.",
    "SCR_LD_CHECKSUM": "Set SCR_DEBUG_OPTS to 32 once, with the guard running.",
    "SYSID_ENFORCE": "Set SYSID_ENFORCE to 0.",
    "MAV_OPTIONS": "Take bit 0 out of MAV_OPTIONS.",
    "BATT_MONITOR": "Set BATT_MONITOR to the kind of power module that is fitted.",
    "BATT_LOW_VOLT": "Set BATT_LOW_VOLT to the voltage at which this battery has to be on its way home.",
    "FS_DR_ENABLE": "Set FS_DR_ENABLE to 2 (RTL), or 1 (land).",
    "FENCE_ENABLE": "Set FENCE_ENABLE to 1.",
    "TERRAIN_ENABLE": "Set TERRAIN_ENABLE to 1 and let it load the heights of the ground, or plan heights above home.",
    "CIRCLE_RATE": "Set CIRCLE_RATE to 20.",
    "FENCE_TYPE": "Set FENCE_TYPE to 4, or 5 with a ceiling.",
    "FENCE_ACTION": "Set FENCE_ACTION to 1.",
}
#: what is in every finding about sensors of onboard programs, and what these findings are about
ONBOARD: Final = "onboard program"
SENSORS: Final = "onboard sensors"
#: a parameter of a further battery, which has the value of the first
_FURTHER: Final = re.compile(r"BATT[2-9]_")
#: text in a finding without a parameter -> what to do
_WORDS: Final = (
    (
        "does not land",
        "Set Q_RTL_MODE to 1, or give the mission a DO_LAND_START with its landing and set RTL_AUTOLAND to 1.",
    ),
    ("bring the heights of the ground", "Plan this way higher, or give the mission a file of heights (key 'terrain')."),
    ("above sea", "Plan heights above home, or set the plan's home to its height above the sea."),
    ("scripting is off", "Set SCR_ENABLE to 1 and restart the autopilot."),
    ("guard is not loaded", "Put the guard on the SD card with 'handover guard CARD', restart the autopilot."),
    ("guard is older", "Put the guard on the SD card with 'handover guard CARD --force', restart the autopilot."),
    ("guard is newer", "Install the release of the guard here as well."),
    ("guard has no key", "Run 'handover guard CARD --key FILE' with the file of guard_key, restart the autopilot."),
    ("not fit guard_key", "Run 'handover guard CARD --key FILE' with the file of guard_key, restart the autopilot."),
    ("guard has a key", "Set guard_key in [vehicle], or delete handover.key from the card."),
    ("two guards", "Delete one of the two scripts from the card, restart the autopilot."),
    ("neither ArduCopter nor ArduPlane", "Name the line of the right vehicle, or load one of the two."),
    ("no onboard program may send", "Name the message in [[onboard]], if a program on the companion has that sensor."),
    (f"{ONBOARD} is not used", "Set that parameter, or take the message out of [[onboard]]."),
    (f"{ONBOARD} moves", "Check that sensor on the ground before each flight."),
    ("firmware", "Load a firmware between these two, or try all of it in simulation first."),
    ("no request", "Set the port's SERIALn_PROTOCOL to 2, and look whether its signing key is autopilot_key."),
)


def advice(parameter: str, text: str, *, profile: Profile | None = None) -> str:
    """Advice in one sentence. `parameter`: the one to change, "" for none. `text`: the finding.

    `profile`: of the aircraft, None: not known.
    """
    further = _FURTHER.match(parameter)
    if further is not None:
        return advice(parameter.replace(further[0], "BATT_"), text, profile=profile).replace("BATT_", further[0])
    if parameter in _OWN:
        return _OWN[parameter]
    if parameter in _GUARD:
        return f"Set {parameter} to {_GUARD[parameter]}; handover_guard.md says why."
    files = _FILES if profile is None else (profile.parameter_file,)
    found = {file: values[parameter] for file in files if parameter in (values := _recommended(file))}
    if len(set(found.values())) > 1:
        each = ", ".join(f"{_FILES[file]} to {value}".lstrip() for file, value in found.items())
        return f"Set {parameter} {each}; {' and '.join(found)} say why."
    for file, value in found.items():
        return f"Set {parameter} to {value}; {file} and handover_guard.md say why."
    if parameter:
        return f"Change {parameter}; the autopilot's documentation has its values."
    return next((do for words, do in _WORDS if words in text), "Read ardupilot_lua/handover_guard.md.")


@cache
def _recommended(file: str) -> dict[str, str]:
    """Parameters of a file: name -> value; empty if the file was not shipped."""
    try:
        text = (shipped("ardupilot_lua") / file).read_text(encoding="utf-8")
    except OSError:
        return {}
    pairs = (line.split() for line in text.splitlines() if not line.startswith("#"))
    return {words[0]: words[1] for words in pairs if len(words) == 2}

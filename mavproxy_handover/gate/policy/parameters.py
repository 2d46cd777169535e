# SPDX-License-Identifier: GPL-3.0-or-later

"""Parameters that the flight's safety rests on, by name.

While the vehicle is armed nobody sets them, the commander included: a setting is saved and outlives the
commander who made it, and the next one flies with a failsafe that is not there. On the ground the commander may.
Parameters without a row are the commander's at any time. Rules:

1. A parameter has a row if it can switch off the guard, a failsafe of the autopilot, the RC pilot, or the check
   who commands, if it can open another way into the autopilot, or if it decides where a return ends.
2. What shapes the flight that the commander orders stays the commander's even then: WPNAV_SPEED, MIS_OPTIONS, rates
   of streams. What shapes the return does not, its height and speeds among it (RTL_ALT, LAND_SPEED): it is flown when
   nobody commands any more, by the word of guard or failsafe, and has to be what was checked before take-off. So it is
   with a circle of a plane's, which is the one of its return too.
3. `*` stands for any characters. Case does not matter, because it does not to ArduPilot.
4. A message that sets parameters without naming them cannot be judged here: see `command_rules`, `files`.

Names of firmware 4.5 to 4.7, Plane's and Rover's where they differ.
"""

from __future__ import annotations

import re
from typing import Final

from mavproxy_handover.gate.policy.access import ANY, Access, Rule, names

__all__ = ["PARAMETER_MESSAGES", "PARAMETER_RULES", "OTHER_PARAMETERS", "parameter_name", "parameter_rule"]

#: Messages that set a parameter; its name is their `param_id`.
PARAMETER_MESSAGES: Final = names("PARAM_SET PARAM_EXT_SET PARAM_MAP_RC")

PARAMETER_RULES: Final = (
    Rule(
        Access.MAINTENANCE,
        "the length of the autopilot's own rally list: 0 sends a return home, more brings back points of other flights",
        names("RALLY_TOTAL"),
    ),
    Rule(Access.SAFEGUARD, "the guard's own", names("HNDO_*")),
    Rule(Access.SAFEGUARD, "scripting, which the guard runs in: SCR_ENABLE 0 ends it in a second", names("SCR_*")),
    Rule(
        Access.SAFEGUARD,
        "the autopilot's failsafes, and the parachute",
        names("FS_* THR_FAILSAFE THR_FS_VALUE AFS_* CHUTE_* GUID_TIMEOUT"),
    ),
    Rule(Access.SAFEGUARD, "the battery's failsafe, and what it measures by", names("BATT*")),
    Rule(Access.SAFEGUARD, "the fence; what the command DO_FENCE_ENABLE does is not saved, this is", names("FENCE_*")),
    Rule(
        Access.SAFEGUARD,
        "where a return ends, and the way there: RALLY_INCL_HOME 1 may send it home, RTL_ALT_FINAL lets it hover",
        names("RALLY_* RTL_* SRTL_* LAND_* Q_RTL_* Q_LAND_*"),
    ),
    Rule(
        Access.SAFEGUARD,
        "how a plane comes down: whether its rotors carry it, what fails over to them, and how it lands",
        names("Q_ENABLE Q_OPTIONS Q_ASSIST_* Q_TRANS_FAIL* Q_FW_LND_* AUTOLAND_* TECS_LAND_* ALT_HOLD_RTL"),
    ),
    Rule(
        Access.SAFEGUARD,
        "how a plane flies its return: with a climb straight on whatever RTL_CLIMB_MIN says (bit 4), at heights above "
        "the ground, in which circle",
        names("FLIGHT_OPTIONS TERRAIN_FOLLOW WP_LOITER_RAD"),
    ),
    Rule(
        Access.SAFEGUARD,
        "what an ArduPlane says that it is: by another type its modes are taken for those of another aircraft",
        names("Q_MAV_TYPE"),
    ),
    Rule(Access.SAFEGUARD, "the checks before arming, the guard's among them", names("ARMING_*")),
    Rule(
        Access.SAFEGUARD,
        "whom the autopilot obeys, and whose heartbeat it counts",
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
        "the RC pilot's sticks and switches: he always wins",
        names("RC_* RCMAP_* RC*_OPTION RC*_MIN RC*_MAX RC*_TRIM RC*_DZ RC*_REVERSED FLTMODE* MODE_CH"),
    ),
    Rule(Access.SAFEGUARD, "safety switch, watchdog, protection of the flash", names("BRD_*")),
    Rule(Access.SAFEGUARD, "0 wipes all parameters at the next start", names("FORMAT_VERSION")),
)

#: Every other parameter.
OTHER_PARAMETERS: Final = Rule(Access.COMMAND, "any other parameter", (ANY,))


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

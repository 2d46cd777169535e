# SPDX-License-Identifier: GPL-3.0-or-later

"""Every parameter of ArduCopter and ArduPlane 4.5 to 4.7 has the class that `firmware_parameters.txt` gives it."""

from __future__ import annotations

import re
from pathlib import Path

from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.parameters import OTHER_PARAMETERS, PARAMETER_RULES, parameter_rule

_FILE = Path(__file__).parent.parent / "data" / "firmware_parameters.txt"


def _sections() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in _FILE.read_text(encoding="ascii").splitlines():
        if line.startswith("["):
            found[line.strip("[]")] = names = []
        elif line and not line.startswith("#"):
            names.extend(line.split())
    return found


NAMES = _sections()


def test_the_list_has_the_names_of_each_firmware() -> None:
    assert {section: len(names) > 100 for section, names in NAMES.items() if section != "maintenance"} == {
        "locked": True,
        "no row": True,
        "open": True,
    }
    everything = [name for names in NAMES.values() for name in names]
    assert len(everything) == len(set(everything))


def test_what_shapes_a_return_or_a_failsafe_is_locked_by_a_row_of_its_own() -> None:
    rules = {name: parameter_rule(name) for name in NAMES["locked"]}
    wrong = [name for name, rule in rules.items() if rule.access is not Access.SAFEGUARD or rule is OTHER_PARAMETERS]
    assert wrong == []


def test_what_nobody_has_judged_is_locked() -> None:
    assert OTHER_PARAMETERS.access is Access.SAFEGUARD
    assert [name for name in NAMES["no row"] if parameter_rule(name) is not OTHER_PARAMETERS] == []


def test_what_shapes_no_return_is_the_commanders() -> None:
    assert [name for name in NAMES["open"] if parameter_rule(name).access is not Access.COMMAND] == []


def test_what_the_companion_keeps_itself_is_nobodys() -> None:
    assert NAMES["maintenance"] == ["RALLY_TOTAL"]
    assert parameter_rule("RALLY_TOTAL").access is Access.MAINTENANCE


def test_no_pattern_is_stale() -> None:
    """Each pattern names a parameter of the firmware, and is the first that does."""
    everything = [name for names in NAMES.values() for name in names]
    stale = [
        pattern
        for rule in PARAMETER_RULES
        for pattern in rule.names
        if not any(
            parameter_rule(name) is rule and re.fullmatch(re.escape(pattern).replace(r"\*", ".*"), name)
            for name in everything
        )
    ]
    assert stale == []


def test_the_names_by_which_a_return_can_be_slowed_down_are_in_the_list() -> None:
    asked = """
        WPNAV_SPEED WPNAV_SPEED_UP WPNAV_SPEED_DN WPNAV_ACCEL WP_SPD WP_SPD_UP WP_SPD_DN WP_ACC RTL_SPEED RTL_SPEED_MS
        ANGLE_MAX ATC_ANGLE_MAX AVOID_ENABLE OA_TYPE AIRSPEED_CRUISE TRIM_ARSPD_CM ROLL_LIMIT_DEG LIM_ROLL_CD
        TECS_CLMB_MAX RTL_RADIUS WP_LOITER_RAD Q_WP_SPEED Q_WP_SPD Q_RTL_ALT ALT_HOLD_RTL NAVL1_PERIOD EK3_SRC1_POSXY
        AHRS_EKF_TYPE TUNE TUNE_PARAM MIS_TOTAL
    """
    assert set(asked.split()) <= set(NAMES["locked"])

# SPDX-License-Identifier: GPL-3.0-or-later

"""What stands first in the status row, written out."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gcs_module.alarms import Level
from gcs_module.banner import Situation, age, banner, tag
from mavproxy_handover.core.model import FlightAction, Phase

FLIES = Situation("drone-1", Phase.ON_MISSION, "GCSB", True, "", "AUTO", 0.5)


@pytest.mark.parametrize(
    ("changes", "text", "level"),
    [
        ({}, "CONTROL: GCSB (you)", Level.INFO),
        ({"own": False}, "CONTROL: GCSB", Level.INFO),
        ({"phase": Phase.ON_LOAD, "mode": "GUIDED"}, "CONTROL: GCSB (you)", Level.INFO),
        ({"mode": "RTL"}, "CONTROL: GCSB (you) - RTL", Level.INFO),
        ({"mode": ""}, "CONTROL: GCSB (you)", Level.INFO),
        ({"partner": "GCSC", "left_s": 9.4}, "HANDOVER -> GCSC 9 s", Level.WARNING),
        ({"partner": "GCSC", "left_s": -1.0}, "HANDOVER -> GCSC 0 s", Level.WARNING),
        ({"partner": "GCSC", "left_s": inf}, "HANDOVER -> GCSC", Level.WARNING),
        ({"action": FlightAction.WARN}, "CONTROL: GCSB (you)", Level.INFO),
        ({"action": FlightAction.HOLD}, "CONTROL: GCSB (you) - HOLD", Level.WARNING),
        ({"action": FlightAction.RETURN, "mode": "RTL"}, "CONTROL: GCSB (you) - RTL", Level.EMERGENCY),
        ({"action": FlightAction.LAND, "mode": ""}, "CONTROL: GCSB (you) - LAND", Level.EMERGENCY),
        (
            {"action": FlightAction.RETURN, "partner": "GCSC", "mode": "RTL"},
            "CONTROL: GCSB (you) - RTL",
            Level.EMERGENCY,
        ),
        ({"commander": "", "own": False, "mode": "RTL"}, "NO COMMANDER - RTL", Level.EMERGENCY),
        ({"commander": "", "own": False, "mode": ""}, "NO COMMANDER", Level.EMERGENCY),
        ({"commander": "", "own": False, "alone": True}, "ALONE IN A DECLARED GAP - AUTO", Level.ADVISORY),
        ({"commander": "", "own": False, "phase": Phase.ON_LOAD}, "NO COMMANDER", Level.INFO),
        ({"commander": "", "heard_s": 3.1}, "drone-1: NOT HEARD FOR 3 s", Level.WARNING),
        ({"heard_s": 3.0}, "CONTROL: GCSB (you)", Level.INFO),
        ({"heard_s": inf}, "drone-1: NOT HEARD YET", Level.INFO),
    ],
)
def test_banner(changes: dict[str, object], text: str, level: Level) -> None:
    assert banner(replace(FLIES, **changes)) == (text, level)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "ONMISSION"),
        ({"mode": ""}, "ONMISSION"),
        ({"mode": "RTL"}, "ONMISSION RTL"),
        ({"mode": "LAND", "phase": Phase.ON_HANDOVER}, "ONHANDOVER LAND"),
        ({"mode": "RTL", "phase": Phase.EMERGENCY}, "EMERGENCY"),
        ({"mode": "LOITER", "phase": Phase.ON_LOAD}, "ONLOAD"),
        ({"heard_s": 12.0}, "ONMISSION 12 s old"),
        ({"heard_s": inf}, "ONMISSION"),
    ],
)
def test_tag(changes: dict[str, object], text: str) -> None:
    assert tag(replace(FLIES, **changes)) == text  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, ""), (3.0, ""), (3.4, "3 s old"), (119.0, "119 s old"), (120.0, "2 min old"), (inf, "never heard")],
)
def test_age(seconds: float, text: str) -> None:
    assert age(seconds) == text

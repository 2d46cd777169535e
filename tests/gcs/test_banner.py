# SPDX-License-Identifier: GPL-3.0-or-later

"""What stands first in the status row, written out."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gcs_module.alarms import Level
from gcs_module.banner import Situation, age, banner, named, tag
from mavproxy_handover.core.common.model import FlightAction, Phase

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
        # somebody commands: that is what counts
        ({"alone": True}, "CONTROL: GCSB (you)", Level.INFO),
        ({"ahead": "GCSC", "ahead_s": 29.6}, "CONTROL: GCSB (you) - GCSC IN 30 s", Level.INFO),
        ({"ahead": "GCSC", "ahead_s": 8.4, "asked": True}, "CONTROL: GCSB (you) - GCSC IN 8 s: ACCEPT?", Level.WARNING),
        ({"ahead": "GCSC", "ahead_s": 0.4}, "CONTROL: GCSB (you) - GCSC IN 0 s", Level.INFO),
        ({"ahead": "GCSC", "ahead_s": -2.0}, "CONTROL: GCSB (you) - GCSC IN 0 s", Level.INFO),
        ({"partner": "GCSC", "left_s": 0.4}, "HANDOVER -> GCSC 0 s", Level.WARNING),
        ({"rehearsal": True}, "REHEARSAL - CONTROL: GCSB (you)", Level.ADVISORY),
        ({"rehearsal": True, "partner": "GCSC", "left_s": 9.4}, "REHEARSAL - HANDOVER -> GCSC 9 s", Level.WARNING),
        ({"rehearsal": True, "heard_s": 3.1}, "drone-1: NOT HEARD FOR 3 s", Level.WARNING),
        ({"rehearsal": True, "heard_s": inf}, "drone-1: NOT HEARD YET", Level.INFO),
        ({"of": "drone-2"}, "drone-2: CONTROL: GCSB (you)", Level.INFO),
        ({"of": "drone-1", "heard_s": inf}, "drone-1: NOT HEARD YET", Level.INFO),
    ],
)
def test_banner(changes: dict[str, object], text: str, level: Level) -> None:
    assert banner(replace(FLIES, **changes)) == (text, level)  # type: ignore[arg-type]


def test_what_is_not_said_is_not_so() -> None:
    """Neither is the aircraft this station's, nor is its operator asked."""
    other = Situation("drone-1", Phase.ON_MISSION, "GCSB", heard_s=0.5, ahead="GCSC", ahead_s=9.0)
    assert banner(other) == ("CONTROL: GCSB - GCSC IN 9 s", Level.INFO)


@pytest.mark.parametrize(
    ("name", "text", "shown"),
    [
        ("", "lost", "lost"),
        ("drone-2", "lost", "drone-2: lost"),
        ("drone-2", "drone-2 is lost", "drone-2 is lost"),
        ("", "", ""),
    ],
)
def test_the_name_of_the_vehicle_stands_before_a_text_that_has_it_not(name: str, text: str, shown: str) -> None:
    assert named(name, text) == shown


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
    [
        (0.0, ""),
        (3.0, ""),
        (3.4, "3 s old"),
        (119.0, "119 s old"),
        (120.0, "2 min old"),
        (7200.0, "120 min old"),
        (inf, "never heard"),
    ],
)
def test_age(seconds: float, text: str) -> None:
    assert age(seconds) == text

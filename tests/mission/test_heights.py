# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights above the sea, above terrain, and near the ground."""

from __future__ import annotations

import pytest

from mavproxy_handover.mission import load
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.heights import above_sea, above_terrain, home_disagrees, listed
from mavproxy_handover.mission.items import MissionItem


def findings(small, severity):
    return [finding.text for finding in check(load(small.write())).findings if finding.severity is severity]


def set_height(small, seq, height_m, frame=3):
    entry = small.items[seq - 1]
    entry["params"][6] = entry["Altitude"] = height_m
    entry["frame"] = frame


def item(seq, command=16, frame=0, alt_m=50.0):
    return MissionItem(seq, command, frame, 0, 0, 0, 0, 52.0, 5.0, alt_m)


def test_a_height_above_the_sea_is_a_warning_that_names_the_item(small):
    small.plan["mission"]["plannedHomePosition"][2] = 5
    set_height(small, 2, 35, frame=0)
    assert findings(small, Severity.WARNING) == [
        "item 2 (NAV_WAYPOINT): the height is above the sea. It is right only with home at 5 m, as in the plan: START "
        "refuses more than 10 m of difference. Plan heights above home instead"
    ]


@pytest.mark.parametrize(
    ("height_m", "severity", "words"),
    [
        (
            -50,
            Severity.ERROR,
            "item 2 (NAV_WAYPOINT): down to 50 m below home: into the ground unless that is lower there. Plan higher, "
            "or bring the heights of the ground (key 'terrain')",
        ),
        (
            0.5,
            Severity.WARNING,
            "item 2 (NAV_WAYPOINT): 0.5 m above home, less than 5 m. Plan higher, or bring the heights of the ground "
            "(key 'terrain')",
        ),
    ],
)
def test_a_way_near_the_height_of_home_is_told(small, height_m, severity, words):
    set_height(small, 2, height_m)
    assert words in findings(small, severity)


def test_a_wait_on_the_ground_is_no_way_into_it(small):
    """Before the take-off, and between a landing and the next take-off."""
    wait = {"type": "SimpleItem", "command": 93, "frame": 2, "params": [5, -1, -1, -1, 0, 0, 0], "doJumpId": 9}
    small.items.insert(0, wait)
    small.items[4:] = [wait, small.item(6, 22, 0.0, 10.005, 30), small.item(7, 21, 0.0, 10.005, 0)]
    assert [text for text in findings(small, Severity.ERROR) if "height of home" in text] == []


def test_a_plan_with_home_at_sea_level_and_items_above_the_sea_is_told(small):
    """The field was at 600 m: the aircraft was flown into the ground."""
    small.plan["mission"]["plannedHomePosition"][2] = 0
    for seq in (1, 2):
        set_height(small, seq, 50, frame=0)
    texts = findings(small, Severity.WARNING)
    assert any(text.startswith("items 1 and 2 (NAV_TAKEOFF first): the height is above the sea.") for text in texts)


def test_items_whose_height_is_not_used_are_not_above_the_sea(small):
    """ArduCopter lands from the height that it has, and a height of 0 is none."""
    set_height(small, 3, 0, frame=0)
    route = load(small.write()).route
    assert [each.seq for each in above_sea(route)] == []
    assert above_terrain(route) == ()


@pytest.mark.parametrize(
    ("plan_m", "autopilot_m", "agrees"),
    [(0.0, 600.0, False), (600.0, 590.0, True), (600.0, 610.0, True), (600.0, 589.9, False), (0.0, None, False)],
)
def test_home_agrees_within_ten_metres(plan_m, autopilot_m, agrees):
    assert (home_disagrees([item(2)], plan_m, autopilot_m) == "") is agrees


def test_both_heights_of_home_are_said():
    assert home_disagrees([item(2), item(3)], 0.0, 600.2) == (
        "item 2 (NAV_WAYPOINT) and 1 more above sea: home is at 0 m in the plan and at 600 m in the autopilot "
        "(allowed: 10 m apart). Plan heights above home, or home at its height"
    )
    assert home_disagrees([item(2)], 0.0, None) == (
        "item 2 (NAV_WAYPOINT) above sea: the height of the autopilot's home is not known"
    )
    assert home_disagrees([], 0.0, None) == ""


def test_many_items_are_listed_by_number():
    assert listed([item(seq) for seq in range(2, 14)]) == (
        "items 2, 3, 4, 5, 6, 7, 8, 9 and 4 more (NAV_WAYPOINT first)"
    )
    assert listed([item(2), item(5, 18)]) == "items 2 and 5 (NAV_WAYPOINT first)"

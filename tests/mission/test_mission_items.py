# SPDX-License-Identifier: GPL-3.0-or-later

"""Reading a mission back from ArduCopter: what it does not store is no difference, everything else is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.mission import MissionItem, difference
from mavproxy_handover.mission.items import COMMANDS

WAYPOINT = MissionItem(4, 16, 3, 10.0, 2.0, 0.0, 90.0, 52.679, 5.924, 30.0, True)


def test_waypoint_comes_back_with_its_hold_time_only():
    assert difference(WAYPOINT, replace(WAYPOINT, param2=0.0, param4=0.0)) is None


def test_hold_time_is_kept_in_whole_seconds():
    assert difference(replace(WAYPOINT, param1=10.7), replace(WAYPOINT, param1=10.0)) is None
    assert difference(WAYPOINT, replace(WAYPOINT, param1=11.0)) == "item 4: parameter 1 10 came back as 11"


def test_landing_comes_back_with_a_direction_of_turn():
    land = MissionItem(11, 21, 3, 0.0, 0.0, 0.0, 0.0, 52.679, 5.924, 0.0, True)
    assert difference(land, replace(land, param4=1.0)) is None
    assert difference(land, replace(land, param4=-1.0)) == "item 11: parameter 4 1 came back as -1"


def test_loiter_time_keeps_the_sign_of_its_radius():
    loiter = MissionItem(3, 19, 3, 20.0, 0.0, -30.0, 0.0, 52.0, 5.0, 30.0, True)
    assert difference(loiter, replace(loiter, param3=-1.0)) is None
    assert difference(loiter, replace(loiter, param3=1.0)) == "item 3: parameter 3 -1 came back as 1"


def test_altitude_is_kept_in_centimetres():
    assert difference(replace(WAYPOINT, alt_m=17.2144), replace(WAYPOINT, alt_m=17.21)) is None
    assert difference(WAYPOINT, replace(WAYPOINT, alt_m=30.5)) == "item 4: altitude 30 m came back as 30.5 m"


def test_another_command_is_a_difference():
    assert difference(WAYPOINT, replace(WAYPOINT, command=82)) == "item 4: command 16 came back as 82"


def test_another_frame_is_a_difference():
    assert difference(WAYPOINT, replace(WAYPOINT, frame=0)) == "item 4: frame 3 came back as 0"


def test_another_place_is_a_difference():
    assert difference(WAYPOINT, replace(WAYPOINT, lat_deg=52.6790005)) == (
        "item 4: latitude 52.6790000 came back as 52.6790005"
    )
    assert difference(WAYPOINT, replace(WAYPOINT, lon_deg=5.9240001)) is None


def test_numbers_that_are_none_are_a_difference():
    assert difference(WAYPOINT, replace(WAYPOINT, alt_m=float("nan"))) == "item 4: altitude 30 m came back as nan m"


def test_item_without_place_is_compared_by_parameters_alone():
    speed = MissionItem(2, 178, 2, 1.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0, True)
    assert difference(speed, replace(speed, frame=0)) is None
    assert difference(speed, replace(speed, param2=9.0)) == "item 2: parameter 2 8 came back as 9"


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_each_command_compares_equal_to_itself_and_says_what_is_kept(command):
    item = MissionItem(1, command, 3, 1.0, 2.0, 3.0, 4.0, 52.0, 5.0, 30.0, True)
    assert difference(item, item) is None
    assert len(COMMANDS[command].kept) == 4
    assert set(COMMANDS[command].kept) <= set("fisbtr-")

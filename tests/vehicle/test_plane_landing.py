# SPDX-License-Identifier: GPL-3.0-or-later

"""A plane lands in AUTO: when that is its mission, when a return that goes on, when a landing it was sent to."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.plan import Home, Route
from mavproxy_handover.vehicle.state import VehicleState

MANUAL, AUTO, RTL, LOITER, GUIDED = 0, 10, 11, 12, 15
#: take-off, three waypoints, DO_LAND_START (5), two waypoints and the landing (8)
COMMANDS = (22, 16, 16, 16, 189, 16, 16, 21)


def route(*commands: int) -> Route:
    items = (MissionItem(n, command, 3, 0, 0, 0, 0, 52.68, 5.92, 50) for n, command in enumerate(commands, 1))
    return Route(Home(52.679, 5.924, 0.0), tuple(items))


class Cockpit:
    """What the autopilot says, and what is made of it."""

    def __init__(self, mission: Route | None) -> None:
        self.aircraft = VehicleState()
        self.aircraft.ways_down.set_route(mission)
        self.now = 10.0

    def mode(self, mode: int, kind: int = 1) -> ModeClass | None:
        self.now += 0.1
        self.aircraft.on_message(mavlink.MAVLink_heartbeat_message(kind, 3, 128, mode, 4, 3), self.now)
        return self.aircraft.flown

    def item(self, seq: int) -> ModeClass | None:
        self.now += 0.1
        self.aircraft.on_message(mavlink.MAVLink_mission_current_message(seq), self.now)
        return self.aircraft.flown


@pytest.fixture
def cockpit() -> Cockpit:
    """In AUTO, on its way to the second waypoint."""
    cockpit = Cockpit(route(*COMMANDS))
    cockpit.mode(MANUAL)
    cockpit.mode(AUTO)
    assert cockpit.item(3) is ModeClass.MISSION
    return cockpit


def test_a_mission_that_comes_to_its_landing_is_a_mission(cockpit: Cockpit) -> None:
    assert [cockpit.item(seq) for seq in (4, 6, 7, 8)] == [ModeClass.MISSION] * 4


def test_where_an_item_leads_is_known_before_it_is_flown_to(cockpit: Cockpit) -> None:
    leads_to = cockpit.aircraft.ways_down.leads_to
    assert [leads_to(seq) for seq in (1, 4, 5, 8)] == [None, None, ModeClass.LAND, ModeClass.LAND]
    cockpit.item(4)
    cockpit.item(6)
    assert [leads_to(seq) for seq in (2, 7)] == [None, None], "its mission has come there"
    cockpit.mode(RTL)
    assert [leads_to(seq) for seq in (2, 7)] == [None, None], "whatever is flown to by the next AUTO"
    cockpit.mode(AUTO)
    assert cockpit.item(7) is ModeClass.RETURN
    assert [leads_to(seq) for seq in (2, 7)] == [ModeClass.MISSION, None]


def test_where_no_way_down_is_known_no_item_leads_to_one() -> None:
    cockpit = Cockpit(None)
    cockpit.mode(AUTO)
    assert [cockpit.aircraft.ways_down.leads_to(seq) for seq in (1, 8)] == [None, None]


def test_an_item_that_nobody_told_of_makes_no_jump(cockpit: Cockpit) -> None:
    assert cockpit.item(6) is ModeClass.MISSION


def test_a_return_that_goes_on_to_the_landing_is_a_return(cockpit: Cockpit) -> None:
    """RTL_AUTOLAND: the mode is told before the item, or behind it."""
    assert cockpit.mode(RTL) is ModeClass.RETURN
    assert cockpit.mode(AUTO) is ModeClass.RETURN
    assert [cockpit.item(seq) for seq in (6, 7, 8)] == [ModeClass.RETURN] * 3
    assert cockpit.mode(AUTO) is ModeClass.RETURN
    assert not cockpit.aircraft.flies_mission


def test_a_return_whose_item_is_told_first_is_one_too(cockpit: Cockpit) -> None:
    cockpit.mode(RTL)
    assert cockpit.item(6) is ModeClass.RETURN
    assert cockpit.mode(AUTO) is ModeClass.RETURN
    assert cockpit.item(6) is ModeClass.RETURN


def test_a_jump_to_the_way_down_is_a_landing(cockpit: Cockpit) -> None:
    cockpit.item(2)
    assert cockpit.item(6) is ModeClass.LAND
    assert cockpit.item(7) is ModeClass.LAND


def test_from_another_mode_to_the_way_down_is_a_landing(cockpit: Cockpit) -> None:
    cockpit.mode(GUIDED)
    cockpit.mode(AUTO)
    assert cockpit.item(6) is ModeClass.LAND


def test_back_in_the_mission_from_a_return_is_the_mission(cockpit: Cockpit) -> None:
    cockpit.mode(RTL)
    assert cockpit.mode(AUTO) is ModeClass.RETURN, "not told yet"
    assert cockpit.item(3) is ModeClass.MISSION
    assert cockpit.aircraft.flies_mission


def test_a_landing_that_was_held_goes_on_as_what_it_was(cockpit: Cockpit) -> None:
    for seq in (4, 6):
        cockpit.item(seq)
    assert cockpit.mode(LOITER) is ModeClass.STOP
    assert cockpit.mode(AUTO) is ModeClass.STOP, "not told yet"
    assert cockpit.item(6) is ModeClass.MISSION


def test_the_item_is_not_waited_for_without_end(cockpit: Cockpit) -> None:
    cockpit.mode(RTL)
    cockpit.mode(AUTO)
    cockpit.now += 2.0
    assert cockpit.mode(AUTO) is ModeClass.MISSION


def test_a_way_down_that_is_told_to_land_lands(cockpit: Cockpit) -> None:
    cockpit.mode(RTL)
    cockpit.mode(AUTO)
    cockpit.item(6)
    cockpit.aircraft.ways_down.lands()
    assert cockpit.aircraft.flown is ModeClass.LAND
    assert cockpit.item(7) is ModeClass.LAND


@pytest.mark.parametrize(
    "mission",
    [None, route(22, 16, 21), route(22, 16, 189, 16), route(22, 16, 189, 20, 21)],
    ids=["unknown", "no way down", "one that ends aloft", "one that returns"],
)
def test_without_a_way_down_auto_is_the_mission_at_once(mission: Route | None) -> None:
    cockpit = Cockpit(mission)
    cockpit.mode(RTL)
    assert cockpit.mode(AUTO) is ModeClass.MISSION
    assert cockpit.item(3) is ModeClass.MISSION


def test_a_copters_auto_is_always_its_mission() -> None:
    cockpit = Cockpit(route(*COMMANDS))
    cockpit.mode(6, kind=2)
    assert cockpit.mode(3, kind=2) is ModeClass.MISSION
    assert cockpit.item(6) is ModeClass.MISSION

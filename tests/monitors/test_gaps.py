# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared gaps on the vehicle: when the aircraft is in one, and what START lacks for them."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import GapsJudged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GapFact
from mavproxy_handover.mission.gaps import Stretch
from mavproxy_handover.mission.package import load
from mavproxy_handover.monitors.gaps import GapMonitor, lacking
from mavproxy_handover.vehicle.state import VehicleState

RIDGE = load(Path(__file__).parents[2] / "missions" / "ridge")
(RIDGE_GAP,) = RIDGE.stretches(RIDGE.simulate())
AUTO, GUIDED = 3, 4
#: the gap of the ridge goes from 5.91222 to 5.91548 E; a metre is this much
LAT, BEGINS, METRE = 52.684, 5.912221, 1.0 / 67539.66
GOOD = {"HNDO_ALONE_MAX": 60.0, "HNDO_SYSID_SW": 1.0}
IN_IT, BEFORE = GapFact(60.0, "GCSA -> GCSB"), GapFact(60.0, "GCSA -> GCSB", ahead=True)


class Cockpit:
    """An aircraft and the watch of its gaps."""

    def __init__(self, limits: Limits | None = None) -> None:
        self.aircraft = VehicleState()
        self.watch = GapMonitor(limits or Limits())
        self.watch.set_gaps((RIDGE_GAP,))
        self.say(AUTO)
        self.fly_to(2)

    def say(self, mode: int, *, armed: bool = True, kind: int = mavlink.MAV_TYPE_QUADROTOR) -> None:
        base = 128 if armed else 0
        self.aircraft.on_message(mavlink.MAVLink_heartbeat_message(kind, 3, base, mode, 4, 3), 1.0)

    def fly_to(self, waypoint: int) -> None:
        self.aircraft.on_message(mavlink.MAVLink_mission_current_message(waypoint), 1.0)

    def at(self, east_m: float, beside_m: float = 0.0, speed_mps: float = 10.0) -> GapFact | None:
        """At so many metres behind the border."""
        lat, lon = LAT + beside_m / 111281.3, BEGINS + east_m * METRE
        values = round(lat * 1e7), round(lon * 1e7), 30000, 30000, 0, round(speed_mps * 100), 0, 0
        self.aircraft.on_message(mavlink.MAVLink_global_position_int_message(1, *values), 1.0)
        return self.watch.fact(self.aircraft)


@pytest.fixture
def cockpit() -> Cockpit:
    return Cockpit()


@pytest.mark.parametrize(
    ("east_m", "fact"),
    [
        (-140.0, None),
        (-83.0, None),
        (-77.0, BEFORE),
        (-3.0, BEFORE),
        (3.0, IN_IT),
        (110.0, IN_IT),
        (218.0, IN_IT),
        (225.0, IN_IT),
        (265.0, IN_IT),
        (275.0, None),
    ],
)
def test_on_the_way_it_begins_eight_seconds_before_and_ends_five_behind(
    cockpit: Cockpit, east_m: float, fact: GapFact | None
) -> None:
    assert cockpit.at(east_m) == fact


def test_who_is_faster_comes_into_it_sooner(cockpit: Cockpit) -> None:
    assert cockpit.at(-110.0, speed_mps=15.0) == BEFORE
    assert cockpit.at(-110.0, speed_mps=2.0) is None


def test_the_rules_look_ahead_as_far_as_they_are_configured() -> None:
    assert Cockpit(Limits(hold_lead_s=9.0)).at(-115.0) == BEFORE


@pytest.mark.parametrize("beside_m", [60.0, -60.0])
def test_beside_the_way_there_is_none(cockpit: Cockpit, beside_m: float) -> None:
    assert cockpit.at(100.0, beside_m) is None
    assert cockpit.at(100.0, beside_m / 2) == IN_IT


def test_only_in_auto_and_in_the_air(cockpit: Cockpit) -> None:
    cockpit.say(GUIDED)
    assert cockpit.at(100.0) is None
    cockpit.say(AUTO, armed=False)
    assert cockpit.at(100.0) is None
    cockpit.say(AUTO)
    assert cockpit.at(100.0) == IN_IT
    cockpit.say(AUTO, kind=mavlink.MAV_TYPE_FIXED_WING)
    assert cockpit.at(100.0) is None


def test_only_on_the_way_to_the_item_that_the_plan_flies_to_there(cockpit: Cockpit) -> None:
    cockpit.fly_to(3)
    assert cockpit.at(100.0) is None


def test_without_a_position_or_a_mission_there_is_none(cockpit: Cockpit) -> None:
    assert cockpit.watch.fact(cockpit.aircraft) is None
    assert cockpit.at(100.0) == IN_IT
    cockpit.watch.set_gaps(())
    assert cockpit.at(100.0) is None


# ---- START ----------------------------------------------------------------------------------------------------------


def lacks(parameters: dict[str, float] | None, *, guarded: bool = True, **changes: Any) -> str:
    return lacking((replace(RIDGE_GAP, **changes),), parameters, guarded)


def test_with_all_that_it_takes_nothing_is_missing() -> None:
    assert lacks(GOOD) == ""
    assert lacks({"HNDO_ALONE_MAX": 60.0}) == ""
    assert lacking((), None, True) == ""


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        (None, "the guard's parameters are not read yet"),
        ({}, "the guard has no HNDO_ALONE_MAX: it knows no gaps"),
        ({"HNDO_ALONE_MAX": 0.0}, "HNDO_ALONE_MAX is 0 s, GCSA -> GCSB may take 60 s"),
        ({"HNDO_ALONE_MAX": 59.5}, "HNDO_ALONE_MAX is 59.5 s, GCSA -> GCSB may take 60 s"),
        ({**GOOD, "HNDO_SYSID_SW": 0.0}, "HNDO_SYSID_SW is 0: the autopilot's GCS failsafe would end them"),
    ],
)
def test_what_is_missing_is_said(parameters: dict[str, float] | None, text: str) -> None:
    assert lacks(parameters) == text


def test_without_a_guard_there_are_no_gaps() -> None:
    assert lacks(GOOD, guarded=False) == "without a guard nothing brings the aircraft home out of one"


def test_one_that_takes_too_long_is_not_flown_into() -> None:
    assert lacks(GOOD, time_s=61.0) == "GCSA -> GCSB takes 61 s against the wind, its limit is 60 s"
    assert lacks(GOOD, time_s=inf) == "GCSA -> GCSB takes for ever in the wind, its limit is 60 s"


def test_the_longest_of_several_counts() -> None:
    longer = replace(RIDGE_GAP, declared=replace(RIDGE_GAP.declared, limit_s=90.0, words="GCSB -> GCSA"))
    both: tuple[Stretch, ...] = (RIDGE_GAP, longer)
    assert lacking(both, {"HNDO_ALONE_MAX": 60.0}, True) == "HNDO_ALONE_MAX is 60 s, GCSB -> GCSA may take 90 s"


def test_the_arbiter_is_told_when_it_changes(cockpit: Cockpit) -> None:
    assert cockpit.watch.longest_s == 60.0
    state, watch = cockpit.aircraft, cockpit.watch
    assert watch.update(state, 1.0) == [GapsJudged("the guard's parameters are not read yet")]
    state.parameters.reading_ended(1.0)
    assert watch.update(state, 2.0) == [GapsJudged("the guard has no HNDO_ALONE_MAX: it knows no gaps")]
    assert watch.update(state, 3.0) == []
    state.on_message(mavlink.MAVLink_param_value_message(b"HNDO_ALONE_MAX", 60.0, 9, 900, 65535), 4.0)
    assert watch.update(state, 4.0) == [GapsJudged("")]
    assert watch.update(state, 5.0) == []
    cockpit.watch.set_gaps(())
    assert cockpit.watch.longest_s == 0.0

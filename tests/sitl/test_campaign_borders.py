# SPDX-License-Identifier: GPL-3.0-or-later

"""The campaign finds an aircraft that is flown on over the last border where somebody commands it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from sitl.campaign.judge import judge
from sitl.campaign.log import FlightLog, Flown, Series
from sitl.campaign.plan import FlightPlan, draw
from sitl.campaign.plane import Circle, Spot, segment_m
from sitl.campaign.times import SECOND

A, B, C = 251, 252, 253
ROWS = {"over the border", "dead zone, not noticed"}


@pytest.fixture
def plan() -> FlightPlan:
    """From the zone of GCSA, which ends 1000 m east of home, into that of GCSB; GCSC is far away."""
    found = next(plan for seed in range(500) if not (plan := draw(seed)).policies and len(plan.stations) > 2)
    zones = Circle(0.0, 0.0, 1000.0), Circle(1500.0, 0.0, 600.0), Circle(9000.0, 0.0, 500.0)
    stations = tuple(replace(each, zone=zone) for each, zone in zip(found.stations, zones, strict=False))
    return replace(found, stations=stations, way=(Spot(0.0, 0.0, 50.0), Spot(1500.0, 0.0, 50.0)), gaps=())


def flown(plan: FlightPlan, seconds: int, *, north_m: float = 0.0, by: str = "start") -> FlightLog:
    """East at 10 m/s from 800 m on, so that the border is there after 20 s; then it returns."""
    end = seconds * SECOND
    there = Flown(0, end, 800.0, north_m, 50.0, 10.0, 0.0, 0.0, "AUTO", 1000.0)
    home = Flown(end, end + 60 * SECOND, 800.0 + 10.0 * seconds, north_m, 50.0, -10.0, 0.0, 0.0, "RTL", 1000.0)
    log = FlightLog(flown=[there, home], landed=(home.ended, 0.0, 0.0), ended=home.ended)
    log.modes = [(0, "AUTO", by), (end, "RTL", "companion"), (home.ended, "GROUND", "companion")]
    for station in plan.stations:
        log.working[station.sysid], log.believes[station.sysid] = Series(True), Series(None)
    log.commander.set(0, A)
    return log


def rows(plan: FlightPlan, log: FlightLog) -> list[str]:
    return [found.row for found in judge(plan, log) if found.row in ROWS]


@pytest.mark.parametrize(("seconds", "found"), [(23, []), (24, ["over the border"])])
def test_it_is_stopped_where_nobody_behind_the_border_has_taken_it(
    plan: FlightPlan, seconds: int, found: list[str]
) -> None:
    assert rows(plan, flown(plan, seconds)) == found
    assert rows(plan, flown(plan, seconds, by="companion")) == found  # which had held it


@pytest.mark.parametrize(("given_s", "found"), [(13, ["over the border"]), (15, []), (19, [])])
def test_who_was_given_it_right_before_the_border_cannot_stop_it_there(
    plan: FlightPlan, given_s: int, found: list[str]
) -> None:
    log = flown(plan, 40)
    log.commander = Series(None)
    log.commander.set(given_s * SECOND, A)
    assert rows(plan, log) == found


def test_whoever_takes_it_in_time_flies_it_on(plan: FlightPlan) -> None:
    log = flown(plan, 60)
    log.commander.set(22 * SECOND, B)
    assert rows(plan, log) == []


def test_where_two_others_are_one_may_fail(plan: FlightPlan) -> None:
    third = replace(plan.stations[2], zone=plan.stations[1].zone)
    both = replace(plan, stations=(*plan.stations[:2], third, *plan.stations[3:]))
    assert rows(both, flown(both, 29)) == []
    log = flown(both, 29)
    log.working[C].set(5 * SECOND, False)
    assert rows(both, log) == ["over the border"]


def test_who_is_carried_or_sent_over_the_border_is_not_flown_there_by_the_rules(plan: FlightPlan) -> None:
    assert rows(plan, flown(plan, 24, north_m=21.0)) == []
    for by in ("commander", "pilot"):
        assert rows(plan, flown(plan, 40, by=by)) == []
    for policy in ("warn", "off"):
        assert rows(replace(plan, policies={Cause.COVERAGE_ENDS: policy}), flown(plan, 60)) == []
    lifted = flown(plan, 24)
    lifted.lifted.append((0, "coverage"))
    assert rows(plan, lifted) == []


@pytest.mark.parametrize("what", ["companion", "cable", "fix", "obeys"])
def test_what_was_not_whole_of_late_excuses_it(plan: FlightPlan, what: str) -> None:
    log = flown(plan, 29)
    getattr(log, what).set(18 * SECOND, False)
    getattr(log, what).set(19 * SECOND, True)
    assert rows(plan, log) == []


def test_a_station_that_has_just_died_is_not_known_to_be_dead(plan: FlightPlan) -> None:
    for died_s, found in ((13, ["over the border"]), (17, [])):
        log = flown(plan, 24)
        log.working[B].set(died_s * SECOND, False)
        assert rows(plan, log) == found


@pytest.mark.parametrize(("seconds", "found"), [(26, []), (27, ["dead zone, not noticed"])])
def test_over_the_zone_of_a_dead_station_it_is_not_flown_on(plan: FlightPlan, seconds: int, found: list[str]) -> None:
    """Where it is not to be stopped before the border, because the configuration has it so."""
    unstopped = replace(plan, policies={Cause.COVERAGE_ENDS: "off"})
    log = flown(unstopped, seconds)
    log.working[B].set(2 * SECOND, False)
    assert rows(unstopped, log) == found
    assert rows(unstopped, flown(unstopped, seconds)) == []
    warned = replace(plan, policies={Cause.COVERAGE_ENDS: "off", Cause.NO_STATION: "warn"})
    assert rows(warned, log) == []


def test_how_far_a_place_is_from_a_way() -> None:
    start, end = Spot(0.0, 0.0), Spot(30.0, 40.0)
    assert segment_m(15.0, 20.0, start, end) == pytest.approx(0.0)
    assert segment_m(11.0, 23.0, start, end) == pytest.approx(5.0)
    assert segment_m(33.0, 44.0, start, end) == pytest.approx(5.0)
    assert segment_m(-3.0, -4.0, start, end) == pytest.approx(5.0)
    assert segment_m(3.0, 4.0, start, start) == pytest.approx(5.0)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared gaps in a campaign: crossed alone within their limit, by the rules, the guard and the autopilot alike."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.model import GuardState, LeaseState
from sitl.campaign.aircraft import Aircraft
from sitl.campaign.faults import Fault, TimedFault
from sitl.campaign.gaps import find_gaps
from sitl.campaign.guard import Guard
from sitl.campaign.judge import judge
from sitl.campaign.log import FlightLog, Flown, Series
from sitl.campaign.plan import FlightPlan, draw
from sitl.campaign.plane import Circle, Spot
from sitl.campaign.times import NEVER, SECOND
from sitl.campaign.world import World
from tests.depth import first

MODEL = draw(0).model()
WAY = (Spot(0.0, 0.0, 50.0), Spot(3000.0, 0.0, 50.0))
ZONES = (Circle(0.0, 0.0, 1000.0), Circle(3000.0, 0.0, 1500.0))


def declaring(seed: int = 20, *timed_faults: TimedFault, limit_s: float | None = None) -> FlightPlan:
    """A flight with a gap, which it declares; no policy but the table's, nobody is asked."""
    plan = draw(seed)
    zones = [station.zone for station in plan.stations]
    gaps = tuple(find_gaps(plan.way, zones, plan.model(), plan.speed_mps, 1.5))
    if limit_s is not None:
        gaps = tuple(replace(gap, limit_s=limit_s) for gap in gaps)
    stations = tuple(replace(station, asked=False) for station in plan.stations)
    return replace(
        plan,
        timed_faults=timed_faults,
        policies={},
        gaps=gaps,
        alone_max_s=600.0,
        stations=stations,
        resumes=0,
        loss=0.0,
    )


# ---- where they are --------------------------------------------------------------------------------------------------


def test_a_gap_is_the_part_of_a_leg_that_no_zone_holds() -> None:
    (gap,) = find_gaps(WAY, ZONES, MODEL, 10.0, 1.0)
    assert (gap.waypoint, gap.begins_m, gap.ends_m) == (1, pytest.approx(1000.0), pytest.approx(1500.0))
    assert gap.along_m(1200.0, 49.0) == pytest.approx(200.0)
    assert gap.along_m(1200.0, 51.0) is None


@pytest.mark.parametrize(
    ("x", "found"), [(919.0, None), (921.0, True), (999.0, True), (1001.0, False), (1549.0, False), (1551.0, None)]
)
def test_it_begins_for_the_rules_before_the_border_and_ends_behind_the_far_one(x: float, found: bool | None) -> None:
    (gap,) = find_gaps(WAY, ZONES, MODEL, 10.0, 1.0)
    fact = gap.fact(x, 0.0, 10.0)
    assert (None if fact is None else fact.ahead) is found


# ---- the guard -------------------------------------------------------------------------------------------------------


def guard(alone_max_s: float = 60.0) -> tuple[Guard, Aircraft]:
    plan = draw(1)
    aircraft = Aircraft(plan, FlightLog())
    aircraft.take_off(0)
    watch = Guard(aircraft, alone_max_s)
    watch.heed(True, LeaseState.HELD, 0.0, 0)
    return watch, aircraft


def test_alone_is_authority_for_as_long_as_the_first_lease_says_and_the_parameter_allows() -> None:
    for most_s, says_s, ends_s in ((60.0, 40.0, 40), (30.0, 40.0, 30), (0.0, 40.0, 0)):
        watch, aircraft = guard(most_s)
        watch.heed(True, LeaseState.ALONE, says_s, 0)
        watch.heed(True, LeaseState.ALONE, 500.0, SECOND // 2)  # a later one makes it no longer
        expected = GuardState.LIVE if ends_s else GuardState.LOST
        assert watch.state(max(0, ends_s * SECOND - 1)) is expected
        assert watch.state(ends_s * SECOND + 32) is GuardState.LOST
        watch.act_if_due(ends_s * SECOND + 2 * SECOND)
        assert aircraft.by == "start"
        watch.act_if_due(watch.due)
        assert aircraft.by == "guard"


def test_a_companion_that_dies_in_the_gap_is_a_loss_like_any_other() -> None:
    watch, aircraft = guard()
    watch.heed(True, LeaseState.ALONE, 60.0, 0)
    watch.heed(False, LeaseState.ALONE, 60.0, 10 * SECOND)
    assert watch.due == 13 * SECOND + 16
    watch.act_if_due(watch.due)
    assert aircraft.by == "guard"


def test_alone_does_not_end_a_loss_that_is_acted_on() -> None:
    watch, _aircraft = guard()
    watch.heed(True, LeaseState.LOST, 0.0, 0)
    watch.act_if_due(watch.due)
    assert watch.enforcing
    watch.heed(True, LeaseState.ALONE, 60.0, 20 * SECOND)
    assert watch.enforcing
    assert watch.state(21 * SECOND) is GuardState.LOST
    watch.heed(True, LeaseState.HELD, 0.0, 30 * SECOND)
    assert not watch.enforcing


# ---- flights ---------------------------------------------------------------------------------------------------------


def test_a_declared_gap_is_crossed_alone_and_authority_goes_on_behind_it() -> None:
    plan = declaring()
    assert plan.gaps
    world = World(plan, tells=True)
    log = world.run()
    assert log.orders == []
    assert None in log.commander.values[2:-1]  # no station commands in the middle of it
    assert log.modes[-1][2] in ("start", "mission")
    assert judge(plan, log) == ()
    assert [row.row for row in judge(replace(plan, gaps=()), log)] != []  # not declared it would be no crossing


def test_behind_its_limit_the_aircraft_comes_home() -> None:
    plan = declaring(limit_s=8.0)
    log = World(plan).run()
    assert "RETURN" in [action for _at, action, _why in log.orders]
    assert judge(plan, log) == ()


def test_a_head_wind_in_the_gap_lets_its_time_run_out() -> None:
    wind = TimedFault(Fault.GUST, 14 * SECOND, 400 * SECOND, amount=0.9, border=True, bare=True)
    plan = declaring(20, wind)
    world = World(plan, tells=True)
    log = world.run()
    blown = next(at for at, text in log.story if text.startswith("FAULT gust"))
    ordered = next(at for at, action, _why in log.orders if action == "RETURN")
    assert blown < ordered
    assert any(gap.along_m(*log.place_at(ordered)[:2]) is not None for gap in plan.gaps)
    assert judge(plan, log) == ()
    slow = next(piece for piece in log.flown if piece.begun == blown)
    assert 0.0 < (slow.vx**2 + slow.vy**2) ** 0.5 < 0.2 * plan.speed_mps


def test_a_guard_that_does_not_allow_it_lets_nobody_start() -> None:
    plan = replace(declaring(), alone_max_s=1.0)
    world = World(plan)
    assert world.run().modes == []


def test_without_a_guard_the_autopilots_failsafe_ends_it() -> None:
    """Nobody has told the autopilot to watch the companion."""
    quiet = TimedFault(Fault.NO_GUARD, 60 * SECOND, NEVER)
    plan = replace(declaring(20, quiet), alone_max_s=600.0)
    log = World(plan).run()
    assert ("RTL", "GCS failsafe") in [(mode, by) for _at, mode, by in log.modes]


@pytest.mark.parametrize("limit_s", first(1, [8.0, None]))
def test_the_same_comes_of_it_however_time_is_let_pass(limit_s: float | None) -> None:
    plan = declaring(limit_s=limit_s)
    short, whole = World(plan).run(), World(plan, plain=True).run()
    assert (short.modes, short.orders, short.moves) == (whole.modes, whole.orders, whole.moves)


# ---- the judge -------------------------------------------------------------------------------------------------------


def alone(x: float, seconds: int, by: str = "companion", carried: float = 0.0, limit_s: float = 300.0) -> list[str]:
    """Nobody commands who hangs so far along the way, in a gap with time left, until it is sent home by that, and is
    carried sideways at so many m/s; what of it is left undone by the rules."""
    rows = ("no commander, not noticed", "left to others")
    return [row for row in all_rows_of(x, seconds, by, carried, limit_s) if row in rows]


def all_rows_of(x: float, seconds: int, by: str, carried: float, limit_s: float) -> list[str]:
    """The same; all that is unsafe about it."""
    (gap,) = find_gaps(WAY, ZONES, MODEL, 10.0, 1.0)
    plan = replace(declaring(), gaps=(replace(gap, limit_s=limit_s),), speed_mps=10.0)
    stations = tuple(replace(station, zone=zone) for station, zone in zip(plan.stations[:2], ZONES, strict=True))
    plan = replace(plan, stations=stations)
    log = FlightLog(landed=(1000 * SECOND, 0.0, 0.0), ended=1000 * SECOND)
    for station in stations:
        log.working[station.sysid], log.believes[station.sysid] = Series(True), Series(None)
    log.flown = [Flown(0, seconds * SECOND, x, 0.0, 50.0, 0.0, carried, 0.0, "AUTO")]
    log.modes = [(0, "AUTO", "start"), (seconds * SECOND, "RTL", by), (1000 * SECOND, "GROUND", by)]
    return [found.row for found in judge(plan, log)]


def test_nobody_is_left_alone_in_a_gap_or_right_behind_it() -> None:
    assert alone(1250.0, 60) == []
    assert alone(1500.0 + 65.0, 60) == []  # the far station has yet to make contact
    assert alone(1500.0 + 75.0, 60) == ["no commander, not noticed"]
    assert alone(950.0, 60) == ["no commander, not noticed"]


def test_without_a_guard_the_failsafe_ends_a_crossing_and_a_guard_does_not() -> None:
    assert alone(1250.0, 60, "GCS failsafe") == []
    assert alone(1250.0, 60, "guard") == ["left to others"]
    assert alone(1500.0 + 65.0, 9, "GCS failsafe") == []
    assert alone(1500.0 + 75.0, 12, "GCS failsafe") == ["left to others"]


def test_who_is_carried_out_of_the_gap_sideways_was_in_it_for_no_longer_than_its_limit() -> None:
    """Flight 1052893: wind had it 50 m beside its leg when the failsafe, which knew of no gap, ended the crossing."""
    carried = 5.5  # beside the corridor after 10 s
    assert alone(1250.0, 14, "GCS failsafe", carried) == []
    assert alone(1250.0, 14, "GCS failsafe", carried, limit_s=3.0) == ["left to others"]
    assert alone(950.0, 14, "GCS failsafe", carried) == ["left to others"]


def test_contact_is_made_within_the_limit_of_the_gap() -> None:
    """Flight 4109122: lifted over the ceiling right behind the gap, it hung there while its far station was asked."""

    def rows(x: float, seconds: int, limit_s: float) -> bool:
        return "no commander, nothing done" in all_rows_of(x, seconds, "companion", 0.0, limit_s)

    assert not rows(1500.0 + 65.0, 30 + 18, 30.0)
    assert rows(1500.0 + 65.0, 30 + 19, 30.0)
    assert rows(1500.0 + 75.0, 19, 30.0)


@pytest.mark.parametrize(("seconds", "rows"), [(30 + 18, []), (30 + 19, ["uncovered, nothing done"])])
def test_the_judge_allows_the_limit_of_the_gap_and_no_second_more(seconds: int, rows: list[str]) -> None:
    (gap,) = find_gaps(WAY, ZONES, MODEL, 10.0, 1.0)
    plan = replace(declaring(), gaps=(replace(gap, limit_s=30.0),))
    stations = tuple(replace(station, zone=zone) for station, zone in zip(plan.stations[:2], ZONES, strict=True))
    plan = replace(plan, stations=stations)
    log = FlightLog(landed=(1000 * SECOND, 0.0, 0.0), ended=1000 * SECOND)
    for station in stations:
        log.working[station.sysid], log.believes[station.sysid] = Series(True), Series(None)
    log.commander.set(0, stations[0].sysid)
    log.flown = [Flown(0, seconds * SECOND, 1250.0, 0.0, 50.0, 0.0, 0.0, 0.0, "AUTO")]
    log.modes = [(0, "AUTO", "start"), (seconds * SECOND, "RTL", "companion"), (1000 * SECOND, "GROUND", "companion")]
    assert [found.row for found in judge(plan, log) if found.row == "uncovered, nothing done"] == rows

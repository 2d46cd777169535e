# SPDX-License-Identifier: GPL-3.0-or-later

"""Operators of a campaign: what they send in bad situations passes, is refused, or is theirs to answer for."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from sitl.campaign.faults import Fault, Insists, TimedFault
from sitl.campaign.judge import judge
from sitl.campaign.log import FlightLog, Series
from sitl.campaign.plan import FlightPlan, draw
from sitl.campaign.times import NEVER, SECOND
from sitl.campaign.world import World
from tests.depth import first

SAG = TimedFault(Fault.SAG, 300 * SECOND, NEVER, amount=0.97)


def wishing(
    insists: Insists, *timed_faults: TimedFault, seed: int = 2, resumes: int = 1, after_s: float = 20.0
) -> FlightPlan:
    """A flight in which operators want it to go on, with the table's policies."""
    plan = draw(seed)
    stations = tuple(replace(station, asked=False) for station in plan.stations)
    plan = replace(plan, timed_faults=timed_faults, policies={}, stations=stations)
    truth = replace(plan.truth, battery_failsafe=False)
    return replace(plan, insists=insists, resumes=resumes, resumes_after_s=after_s, truth=truth)


def flown(plan: FlightPlan, *, plain: bool = False) -> tuple[FlightLog, list[str]]:
    world = World(plan, plain=plain, tells=True)
    return world.run(), [text for _at, text in world.log.story]


def sent_on(log: FlightLog) -> int:
    return sum((mode, by) == ("AUTO", "commander") for _at, mode, by in log.modes)


def test_who_has_no_energy_is_not_sent_on() -> None:
    log, story = flown(wishing(Insists.NO, SAG))
    assert [text for text in story if text.startswith("AUTO refused")]
    assert sent_on(log) == 0
    assert log.landed is not None


@pytest.mark.parametrize("insists", [Insists.ANEW, Insists.LIFTS])
def test_whoever_insists_is_obeyed_and_has_taken_it_upon_himself(insists: Insists) -> None:
    plan = wishing(insists, SAG)
    log, _story = flown(plan)
    assert sent_on(log) == 1
    assert {limit for _at, limit in log.lifted} <= {"energy", "coverage"}
    assert "energy" in {limit for _at, limit in log.lifted}
    assert judge(plan, log) == ()


def test_a_return_for_a_cause_that_is_over_may_be_sent_on() -> None:
    """The station was silent for a while, and is back."""
    silent = TimedFault(Fault.NO_FIX, 100 * SECOND, 5 * SECOND)
    plan = replace(wishing(Insists.NO, silent, after_s=15.0), policies={Cause.POSITION_STALE: "warn"})
    held = replace(plan, timed_faults=(replace(silent, fault=Fault.STALLED, lasts=20 * SECOND),))
    for each in (plan, held):
        log, _story = flown(each)
        assert judge(each, log) == ()


@pytest.mark.parametrize(("insists", "starts"), [(Insists.NO, False), (Insists.ANEW, True), (Insists.LIFTS, True)])
def test_start_without_the_energy_is_refused_until_an_operator_insists(insists: Insists, starts: bool) -> None:
    plan = wishing(insists, resumes=0)
    assert plan.settings.battery_wh is not None
    plan = replace(plan, settings=replace(plan.settings, battery_wh=0.5 * plan.settings.battery_wh))
    log, story = flown(plan)
    assert [text for text in story if text.startswith("START refused: energy")]
    assert bool(log.modes) is starts
    assert [limit for _at, limit in log.lifted] == ["energy"] * starts
    assert judge(plan, log) == ()


@pytest.mark.parametrize(("insists", "after_s"), first(1, [(Insists.LIFTS, 90.0), (Insists.ANEW, 20.0)]))
def test_the_same_comes_of_it_however_time_is_let_pass(insists: Insists, after_s: float) -> None:
    """What is lifted for a minute is lifted for a minute of the operator's, not of rules whose clock stands still."""
    plan = wishing(insists, SAG, resumes=3, after_s=after_s)
    short, whole = flown(plan)[0], flown(plan, plain=True)[0]
    assert (short.modes, short.orders, short.lifted) == (whole.modes, whole.orders, whole.lifted)


def test_the_judge_leaves_to_an_operator_what_he_has_lifted_and_nothing_before() -> None:
    plan = wishing(Insists.NO)
    log = FlightLog(empty_at=500, landed=(500, 0.0, 0.0), ended=600)
    for station in plan.stations:
        log.working[station.sysid], log.believes[station.sysid] = Series(True), Series(None)
    assert [found.row for found in judge(plan, log)] == ["battery empty"]
    log.lifted = [(501, "energy"), (400, "coverage")]
    assert [found.row for found in judge(plan, log)] == ["battery empty"]
    log.lifted = [(499, "energy")]
    assert judge(plan, log) == ()

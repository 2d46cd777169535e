# SPDX-License-Identifier: GPL-3.0-or-later

"""Where a return goes in a campaign: to the one point of the rally list, whoever orders it, and alive or dead."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from sitl.campaign.faults import Fault, Target, TimedFault
from sitl.campaign.judge import judge
from sitl.campaign.plan import FlightPlan, draw
from sitl.campaign.times import NEVER, SECOND
from sitl.campaign.world import World
from tests.depth import seeds


def struck(seed: int, *timed_faults: TimedFault) -> FlightPlan:
    """The flight of a seed with these faults and the table's policies."""
    return replace(draw(seed), timed_faults=timed_faults, policies={}, resumes=0)


def at(fault: Fault, second: int) -> TimedFault:
    """It strikes so long behind take-off, for good."""
    return TimedFault(fault, second * SECOND, NEVER)


def landed_by_the_guard(seed: int) -> tuple[FlightPlan, World]:
    """A flight whose companion dies when it is well under way."""
    plan = struck(seed, at(Fault.GONE, 240))
    world = World(plan)
    world.run()
    return plan, world


def test_the_guards_return_goes_where_the_dead_companion_has_put_it() -> None:
    elsewhere = 0
    for seed in range(12):
        plan, world = landed_by_the_guard(seed)
        log = world.log
        if log.modes[-1][2] != "guard":  # it was on its way home by then
            continue
        place = log.rally.values[-1] or plan.places[0]
        assert log.landed is not None
        assert place.away_m(*log.landed[1:]) < 1.0
        assert log.rally.times[-1] <= log.companion.times[-1]  # nobody writes behind that
        elsewhere += place != plan.places[0]
        assert judge(plan, log) == ()
    assert elsewhere >= 3


def test_the_list_is_not_written_oftener_than_every_five_seconds(pytestconfig: pytest.Config) -> None:
    written = 0
    for seed in seeds(pytestconfig, 4, 15):
        world = World(draw(seed))
        world.run()
        # what a return waits for is written at once
        returns = [when for when, mode, _by in world.log.modes if mode == "RTL"]
        times = [when for when in world.log.rally.times[1:] if when not in returns]
        written += len(times)
        assert all(after - before >= 5 * SECOND for before, after in pairwise(times))
    assert written > 5


def test_who_turns_back_for_energy_comes_home_with_it() -> None:
    for seed in range(8):
        plan = struck(seed, replace(at(Fault.SAG, 300), amount=0.97))
        world = World(plan)
        log = world.run()
        assert "RETURN" in [action for _when, action, _why in log.orders]
        assert judge(plan, log) == ()


def test_a_return_is_begun_anew_for_a_place_that_stands_higher() -> None:
    """The station of the place that is flown to dies under way, and another place is covered."""
    dies = TimedFault(Fault.DEAD, 355 * SECOND, NEVER, Target.NEXT)
    plan = struck(5, replace(at(Fault.SAG, 330), amount=0.97), dies)
    log = World(plan).run()
    returns = [(when, by) for when, mode, by in log.modes if mode == "RTL"]
    assert [by for _when, by in returns] == ["companion", "companion"]
    places = [log.rally.at(when) or plan.places[0] for when, _by in returns]
    assert places[0] != places[1]
    assert log.landed is not None
    assert places[1].away_m(*log.landed[1:]) < 1.0
    assert judge(plan, log) == ()

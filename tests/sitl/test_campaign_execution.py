# SPDX-License-Identifier: GPL-3.0-or-later

"""Who flies in a campaign: failsafes and pilots win, what the autopilot does not follow is escalated."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import ConditionsSeen, Event, ModeSeen
from mavproxy_handover.core.common.model import ModeClass
from sitl.campaign.faults import Fault, Target, TimedFault
from sitl.campaign.judge import judge
from sitl.campaign.log import FlightLog
from sitl.campaign.plan import FlightPlan, draw
from sitl.campaign.times import NEVER, SECOND
from sitl.campaign.world import World
from tests.depth import first

SAG = TimedFault(Fault.SAG, 300 * SECOND, NEVER, amount=0.97)


def struck(*timed_faults: TimedFault, seed: int = 3, resumes: int | None = None, **truth: bool) -> FlightPlan:
    """A flight with these faults, the table's policies, no operator who has to be asked, and what is true besides."""
    plan = draw(seed)
    truths = {"battery_failsafe": False, "fence_failsafe": True, "radio": True} | truth
    stations = tuple(replace(station, asked=False) for station in plan.stations)
    plan = plan if resumes is None else replace(plan, resumes=resumes)
    return replace(plan, timed_faults=timed_faults, policies={}, truth=replace(plan.truth, **truths), stations=stations)


def flown(plan: FlightPlan, *, plain: bool = False) -> FlightLog:
    return World(plan, plain=plain).run()


def by(log: FlightLog) -> list[str]:
    return [f"{mode} {who}" for _at, mode, who in log.modes]


def orders(log: FlightLog) -> list[str]:
    return [action for _at, action, _why in log.orders]


def test_the_fence_brings_back_whom_the_wind_carries_out_of_it_and_nobody_interferes() -> None:
    out = TimedFault(Fault.BREACH, 120 * SECOND, 600 * SECOND, amount=0.9)
    log = flown(struck(out))
    assert by(log)[:2] == ["AUTO start", "RTL fence failsafe"]
    assert "RETURN" not in orders(log)
    assert log.landed is not None


def test_a_fence_that_only_tells_lets_it_go_and_the_rules_bring_it_back_when_coverage_ends() -> None:
    out = TimedFault(Fault.BREACH, 120 * SECOND, 600 * SECOND, amount=0.9)
    plan = struck(out, fence_failsafe=False)
    log = flown(plan)
    assert "RTL companion" in by(log)
    assert judge(plan, log) == ()


def test_over_its_ceiling_it_is_outside_its_fence_too() -> None:
    up = TimedFault(Fault.LIFT, 120 * SECOND, 30 * SECOND, amount=0.5)
    log = flown(struck(up))
    assert by(log)[:2] == ["AUTO start", "RTL fence failsafe"]
    assert log.modes[1][0] == pytest.approx((130 + 15 / 4.5) * SECOND, abs=5 * SECOND)
    told = flown(struck(up, fence_failsafe=False))
    assert "RTL fence failsafe" not in by(told)
    assert orders(told) == []  # the table warns


def test_nothing_is_commanded_while_a_pilot_has_it_and_what_he_gives_back_is_brought_home() -> None:
    plan = struck(SAG, TimedFault(Fault.PILOT, 290 * SECOND, 40 * SECOND))
    log = flown(plan)
    given_back = next(at for at, mode, who in log.modes if (mode, who) == ("AUTO", "pilot"))
    assert [at >= given_back for at, action, _why in log.orders if action == "RETURN"] == [True]
    assert by(log)[-1] == "GROUND companion"
    assert judge(plan, log) == ()


def test_without_a_radio_there_is_no_pilot() -> None:
    log = flown(struck(TimedFault(Fault.PILOT, 290 * SECOND, 40 * SECOND), radio=False))
    assert not [mode for mode in by(log) if mode.endswith("pilot")]


def test_what_is_not_obeyed_is_ordered_again_and_then_landed() -> None:
    plan = struck(SAG, TimedFault(Fault.DISOBEYS, 295 * SECOND, 40 * SECOND))
    log = flown(plan)
    assert orders(log)[:3] == ["RETURN", "RETURN", "LAND"]
    assert by(log)[-2:] == ["LAND companion", "GROUND companion"]


def test_a_return_that_gets_no_nearer_becomes_a_landing() -> None:
    log = flown(struck(SAG, TimedFault(Fault.STUCK, 295 * SECOND, 400 * SECOND), resumes=0))
    assert by(log)[-3:] == ["RTL companion", "LAND companion", "GROUND companion"]


def test_a_commander_that_hears_nothing_is_lost_however_time_is_let_pass() -> None:
    plan = struck(TimedFault(Fault.DEAF, 120 * SECOND, 60 * SECOND, Target.COMMANDER), resumes=0)
    short, whole = flown(plan), flown(plan, plain=True)
    assert (short.modes, short.commander.times, short.moves) == (whole.modes, whole.commander.times, whole.moves)
    lost = [at for at, who in zip(short.commander.times, short.commander.values, strict=True) if who is None and at > 0]
    begun = short.modes[0][0] + 120 * SECOND
    assert 9 * SECOND <= lost[0] - begun <= 11 * SECOND
    assert judge(plan, short) == ()


@pytest.mark.parametrize("fault", first(2, [Fault.DISOBEYS, Fault.PILOT, Fault.STUCK, Fault.BREACH]))
def test_the_same_comes_of_it_however_time_is_let_pass(fault: Fault) -> None:
    plan = struck(SAG, TimedFault(fault, 295 * SECOND, 60 * SECOND, amount=0.9), seed=3)
    short, whole = flown(plan), flown(plan, plain=True)
    assert (short.modes, short.orders, short.landed) == (whole.modes, whole.orders, whole.landed)


def test_an_autopilot_that_does_not_obey_is_no_fault_of_who_orders() -> None:
    plan = struck()
    log = flown(plan)
    begun = log.modes[0][0]
    log.commander.times[:], log.commander.values[:] = [0, begun + 50 * SECOND], [plan.stations[0].sysid, None]
    assert [found.row for found in judge(plan, log)] == ["no commander, nothing done", "no commander, not noticed"]
    log.obeys.set(begun + 52 * SECOND, False)
    assert [found.row for found in judge(plan, log)] == []


def test_what_is_flown_is_what_the_last_heartbeat_said_for_the_route_too() -> None:
    """Else the cause of a landing would be gone before it is known that it lands, and it would be undone."""
    strays = TimedFault(Fault.DRIFT, 120 * SECOND, 60 * SECOND, amount=0.9)
    deaf = TimedFault(Fault.DISOBEYS, 120 * SECOND, 30 * SECOND)
    plan = replace(struck(strays, deaf), policies={Cause.OFF_ROUTE: "land"})
    world = World(plan)
    heard: list[tuple[int, str]] = []
    give = world.companion.give

    def note(event: Event, now: int) -> None:
        if isinstance(event, ModeSeen) and event.flown is ModeClass.LAND:
            heard.append((now, "lands"))
        if isinstance(event, ConditionsSeen):
            heard.append((now, "off" if event.off_route else "on"))
        give(event, now)

    world.companion.give = note
    log = world.run()
    landed = next(at for at, mode, who in log.modes if (mode, who) == ("LAND", "companion"))
    assert landed > 150 * SECOND
    behind = [what for at, what in heard if at >= landed]
    assert behind[:2] == ["lands", "on"]
    assert judge(plan, log) == ()

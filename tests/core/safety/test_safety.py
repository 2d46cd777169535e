# SPDX-License-Identifier: GPL-3.0-or-later

"""Safety decisions, as a table."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import pytest

from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import FlightAction, Reason
from mavproxy_handover.core.safety.emergency import Decision, Situation, decide

WARN, RETURN, LAND = FlightAction.WARN, FlightAction.RETURN, FlightAction.LAND
NONE, LOST, OUT = Reason.NONE, Reason.COMMANDER_LOST, Reason.OUT_OF_COVERAGE

#: out of every zone since t = 50 s; the hold time is 1 s
BARELY, LONG = 50.999, 51.0


@pytest.mark.parametrize(
    ("flying", "commander_lost", "out", "now", "action", "reason"),
    [
        # in the air
        (True, False, False, LONG, WARN, NONE),
        (True, False, True, BARELY, WARN, NONE),
        (True, False, True, LONG, RETURN, OUT),
        (True, False, True, 5000.0, RETURN, OUT),
        (True, True, False, LONG, RETURN, LOST),
        (True, True, True, BARELY, RETURN, LOST),
        (True, True, True, LONG, RETURN, LOST),
        # on the ground: said, never flown
        (False, False, False, LONG, WARN, NONE),
        (False, False, True, BARELY, WARN, NONE),
        (False, False, True, LONG, WARN, OUT),
        (False, True, False, LONG, WARN, LOST),
        (False, True, True, LONG, WARN, LOST),
    ],
)
def test_decision(
    flying: bool, commander_lost: bool, out: bool, now: float, action: FlightAction, reason: Reason
) -> None:
    situation = Situation(flying, commander_lost, 50.0 if out else None, now)
    assert decide(situation, Limits()) == Decision(action, reason)


@pytest.mark.parametrize(
    ("commander_lost_policy", "out_policy", "action", "reason"),
    [
        (RETURN, LAND, LAND, OUT),
        (LAND, RETURN, LAND, LOST),
        (WARN, RETURN, RETURN, OUT),
        (RETURN, WARN, RETURN, LOST),
        (WARN, LAND, LAND, OUT),
        (WARN, WARN, WARN, LOST),
        (LAND, LAND, LAND, LOST),
    ],
)
def test_of_two_causes_the_stronger_policy_decides(
    commander_lost_policy: FlightAction, out_policy: FlightAction, action: FlightAction, reason: Reason
) -> None:
    limits = replace(Limits(), commander_lost=commander_lost_policy, out_of_coverage=out_policy)
    assert decide(Situation(True, True, 50.0, LONG), limits) == Decision(action, reason)


def test_on_the_ground_no_policy_flies() -> None:
    for lost_policy, out_policy, lost, out in product(FlightAction, FlightAction, (False, True), (None, 0.0)):
        limits = replace(Limits(), commander_lost=lost_policy, out_of_coverage=out_policy)
        assert decide(Situation(False, lost, out, LONG), limits).action is WARN


def test_the_hold_time_ends_when_the_deadline_says_so() -> None:
    # 0.1 + 0.7 is the deadline that the arbiter hands out; counted as seconds since, it would be a rounding error away
    limits = replace(Limits(), out_hold_s=0.7)
    since = 0.1
    deadline = since + limits.out_hold_s
    assert decide(Situation(True, False, since, deadline), limits).reason is OUT
    assert decide(Situation(True, False, since, math.nextafter(deadline, 0.0)), limits).reason is NONE

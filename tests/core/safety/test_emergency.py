# SPDX-License-Identifier: GPL-3.0-or-later

"""What of the safety decisions is news: each emergency once, what turns worse again, and the end."""

from __future__ import annotations

from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import FlightAction, Reason
from mavproxy_handover.core.safety.emergency import NOTHING_WRONG, Decision, Emergency, Situation

FINE = Situation(flying=True, commander_lost=False, out_since=None, now=100.0)
LOST = Situation(flying=True, commander_lost=True, out_since=None, now=100.0)
LOST_ON_GROUND = Situation(flying=False, commander_lost=True, out_since=None, now=100.0)
RETURN = Decision(FlightAction.RETURN, Reason.COMMANDER_LOST)
WARN = Decision(FlightAction.WARN, Reason.COMMANDER_LOST)


def test_each_emergency_is_news_once_and_so_is_its_end() -> None:
    emergency = Emergency(Limits())
    told = [emergency.judge(situation) for situation in (FINE, LOST, LOST, FINE, FINE, LOST)]
    assert told == [None, RETURN, None, NOTHING_WRONG, None, RETURN]


def test_what_was_a_warning_on_the_ground_takes_off() -> None:
    emergency = Emergency(Limits())
    assert [emergency.judge(situation) for situation in (LOST_ON_GROUND, LOST, LOST_ON_GROUND)] == [WARN, RETURN, None]


def test_after_the_landing_the_same_cause_is_no_news_and_in_the_next_flight_it_is() -> None:
    emergency = Emergency(Limits())
    emergency.judge(LOST)
    emergency.landed()
    assert [emergency.judge(situation) for situation in (LOST_ON_GROUND, LOST)] == [None, RETURN]


def test_while_it_is_not_known_that_nothing_is_wrong_no_emergency_ends() -> None:
    emergency = Emergency(Limits())
    emergency.resume()
    assert emergency.reason is Reason.RESTARTED
    assert emergency.judge(FINE, certain=False) is None
    assert emergency.judge(FINE) == NOTHING_WRONG


def test_what_is_wrong_is_wrong_while_that_is_not_known() -> None:
    emergency = Emergency(Limits(out_hold_s=1.0))
    emergency.resume()
    out = Situation(flying=True, commander_lost=False, out_since=90.0, now=100.0)
    assert emergency.judge(out, certain=False) == Decision(FlightAction.RETURN, Reason.OUT_OF_COVERAGE)


def test_the_end_of_the_hold_time_is_due_until_it_was_judged() -> None:
    emergency = Emergency(Limits(out_hold_s=1.0))
    assert emergency.due_at(None) is None
    assert emergency.due_at(100.0) == 101.0
    emergency.judge(Situation(flying=True, commander_lost=False, out_since=100.0, now=101.0))
    assert emergency.due_at(100.0) is None


def test_a_mission_without_a_policy_leaves_the_one_in_force() -> None:
    emergency = Emergency(Limits(out_of_coverage=FlightAction.RETURN))
    emergency.adopt(FlightAction.LAND)
    emergency.adopt(None)
    assert emergency.out_of_coverage is FlightAction.LAND

# SPDX-License-Identifier: GPL-3.0-or-later

"""Each decision as a sentence, word by word."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.events import Announce, PlaceJudged
from mavproxy_handover.core.model import FlightAction, Reason
from mavproxy_handover.core.safety.causes import Cause
from mavproxy_handover.core.safety.sentence import over, sentence
from mavproxy_handover.core.safety.strategy import Decision, Fact

WARN, HOLD, CONTINUE = FlightAction.WARN, FlightAction.HOLD, FlightAction.CONTINUE
RETURN, LAND = FlightAction.RETURN, FlightAction.LAND
RALLY = PlaceJudged("rally 2", True, "1.9 km, needs 21 % of 38 %, covered by GCSA")


def test_a_return_says_where_to_and_what_is_known_of_the_place() -> None:
    told = sentence(Decision(RETURN, Cause.COMMANDER_LOST), "GCSB silent 5 s", RALLY)
    text = "RETURN to rally 2: GCSB silent 5 s; 1.9 km, needs 21 % of 38 %, covered by GCSA"
    assert told == Announce(text, RETURN, Reason.COMMANDER_LOST, "GCSB silent 5 s", "rally 2")


def test_of_a_place_of_which_nothing_is_known_only_the_name_is_said() -> None:
    told = sentence(Decision(RETURN, Cause.ENERGY), "short by 3 Wh", PlaceJudged("home", True, ""))
    assert told == Announce("RETURN to home: short by 3 Wh", RETURN, Reason.ENERGY, "short by 3 Wh", "home")


def test_a_return_without_a_place_names_none() -> None:
    told = sentence(Decision(RETURN, Cause.OUT_OF_COVERAGE), "out of coverage", None)
    assert told == Announce("RETURN: out of coverage", RETURN, Reason.OUT_OF_COVERAGE, "out of coverage")


@pytest.mark.parametrize("action", [WARN, HOLD, CONTINUE, LAND])
def test_what_is_no_return_goes_to_no_place(action: FlightAction) -> None:
    told = sentence(Decision(action, Cause.COVERAGE_ENDS), "coverage ends ahead", RALLY)
    assert told == Announce(f"{action.name}: coverage ends ahead", action, Reason.COVERAGE_ENDS, "coverage ends ahead")


@pytest.mark.parametrize(
    ("fact", "words"),
    [
        (Fact.FLYING, "on the ground"),
        (Fact.AUTOPILOT, "the autopilot is not heard"),
        (Fact.PILOT, "a pilot has the aircraft"),
        (Fact.FAILSAFE, "a failsafe of the autopilot acts"),
        (Fact.RETURNING, "it returns already"),
        (Fact.LANDING, "it lands already"),
    ],
)
def test_a_warning_says_why_no_more_is_done(fact: Fact, words: str) -> None:
    told = sentence(Decision(WARN, Cause.GUARD_LOST, withheld=fact), "guard silent 4 s", RALLY)
    assert told == Announce(f"WARN: guard silent 4 s; {words}", WARN, Reason.GUARD_LOST, "guard silent 4 s")


def test_the_end_of_it_says_what_is_over() -> None:
    assert over(Decision(RETURN, Cause.ENERGY)) == Announce("OVER: energy for the way back only", None, Reason.ENERGY)
    assert over(None) == Announce("OVER: the emergency of before the restart", None, Reason.NONE)

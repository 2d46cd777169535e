# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle has decided, as it is told, and for how long its words are known."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from gcs_module.decisions import Decisions, Who
from gcs_module.events import Notice
from mavproxy_handover.core.model import FlightAction

OVER = mavlink.HANDOVER_ACTION_NONE


def decision(number: int, action: int, text: str, place: str = "", figures: str = "") -> Any:
    return mavlink.MAVLink_handover_decision_message(number, action, 5, place.encode(), figures.encode(), text.encode())


def test_it_is_told_once_with_what_is_wrong_what_is_done_and_what_may_be_done() -> None:
    decisions = Decisions()
    returns = decision(1, FlightAction.RETURN, "RETURN: GCSB silent 5 s", "rally 2", "GCSB silent 5 s")
    text = "GCSB silent 5 s. RTL to rally 2. 'handover request' takes over when it is in your zone."
    assert decisions.on_message(returns, Who.NOBODY) == Notice("decision", text, Level.EMERGENCY)
    assert decisions.on_message(returns, Who.NOBODY) is None
    assert (decisions.text, decisions.action) == ("RETURN: GCSB silent 5 s", FlightAction.RETURN)


def test_without_figures_its_own_words_are_what_is_wrong() -> None:
    told = Decisions().on_message(decision(1, FlightAction.HOLD, "HOLD: links weak"), Who.THIS)
    text = "HOLD: links weak. It holds inside coverage. 'handover give STATION' hands it over."
    assert told == Notice("decision", text, Level.WARNING)


def test_a_number_with_other_words_is_another_decision() -> None:
    decisions = Decisions()
    decisions.on_message(decision(1, FlightAction.WARN, "WARN: guard silent"), Who.THIS)
    assert decisions.on_message(decision(1, FlightAction.WARN, "WARN: links weak"), Who.THIS) is not None
    assert decisions.on_message(decision(2, FlightAction.WARN, "WARN: links weak"), Who.THIS) is not None


def test_its_end_is_told_and_nothing_is_in_force() -> None:
    decisions = Decisions()
    decisions.on_message(decision(1, FlightAction.RETURN, "RETURN: links weak"), Who.OTHER)
    assert decisions.on_message(decision(2, OVER, "OVER: links weak"), Who.OTHER) == Notice(
        "decision_over", "OVER: links weak"
    )
    assert (decisions.text, decisions.action) == ("", None)


@pytest.mark.parametrize("action", [77, 254])
def test_one_that_is_not_known_here_is_an_emergency_in_its_own_words(action: int) -> None:
    decisions = Decisions()
    told = decisions.on_message(decision(1, action, "DITCH: all is wrong"), Who.OTHER)
    assert told == Notice("decision", "DITCH: all is wrong", Level.EMERGENCY)
    assert (decisions.text, decisions.action) == ("DITCH: all is wrong", None)


def test_the_words_of_the_last_eight_are_known() -> None:
    """STATUSTEXT brings them too, and may hold more of them."""
    decisions = Decisions()
    for number in range(9):
        decisions.on_message(decision(number, FlightAction.WARN, f"WARN: {number} is wrong"), Who.THIS)
    known = [decisions.told(f"WARN: {number} is wrong, and more") for number in range(9)]
    assert known == [False, *[True] * 8]
    assert not decisions.told("WARN: 9 is wrong")


def test_a_decision_without_words_makes_no_text_known() -> None:
    decisions = Decisions()
    decisions.on_message(decision(1, OVER, ""), Who.THIS)
    assert not decisions.told("anything")

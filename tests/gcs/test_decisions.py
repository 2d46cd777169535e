# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle has decided, as it is told, and for how long its words are known."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from gcs_module.decisions import Decisions, Who
from gcs_module.events import Notice
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import Announce
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.core.safety.sentence import sentence
from mavproxy_handover.core.safety.strategy import Decision, Fact
from mavproxy_handover.wire import status

RETURNS = (
    "RETURN to rally 2. GCSB silent for 5 s. 1.9 km away, needs 21 % of the battery (38 % left), "
    "covered by GCSA all the way"
)
TAKE = "When it is in your zone, type 'handover request' to take over."


def decision(number: int, action: int, text: str) -> Any:
    """As the companion sends it: figures and place stand in the sentence too, which is cut to its field."""
    return status.decision(
        Announce(text, FlightAction(action), Reason.COMMANDER_LOST, "GCSB silent for 5 s", "rally 2"), number
    )


def over(number: int, text: str) -> Any:
    return status.decision(Announce(text, None, Reason.COMMANDER_LOST), number)


def nothing(_beginning: str) -> str:
    return ""


def line_of(action: FlightAction, text: str, who: Who) -> str:
    notice = Decisions(nothing).on_message(decision(1, action, text), who)
    assert notice is not None
    return notice.text


def test_it_is_told_once_in_the_vehicles_sentence_with_what_may_be_done() -> None:
    decisions = Decisions(nothing)
    returns = decision(1, FlightAction.RETURN, RETURNS)
    text = f"{RETURNS}. No station commands. {TAKE}"
    assert decisions.on_message(returns, Who.NOBODY) == Notice("decision", text, Level.EMERGENCY)
    assert decisions.on_message(returns, Who.NOBODY) is None
    assert (decisions.text, decisions.action) == (RETURNS, FlightAction.RETURN)


@pytest.mark.parametrize(
    ("fact", "line"),
    [
        (Fact.PILOT, "WARNING. GCSB silent for 5 s. A pilot has the aircraft."),
        (Fact.AUTOPILOT, "WARNING. GCSB silent for 5 s. The autopilot is not heard."),
        (Fact.LANDING, "WARNING. GCSB silent for 5 s. The aircraft lands already."),
    ],
)
def test_why_nothing_is_done_is_told(fact: Fact, line: str) -> None:
    withheld = Decision(FlightAction.WARN, Cause.COMMANDER_LOST, fact)
    message = status.decision(sentence(withheld, "GCSB silent for 5 s", None), 1)
    assert Decisions(nothing).on_message(message, Who.NOBODY) == Notice("decision", line, Level.WARNING)


@pytest.mark.parametrize("who", Who)
def test_a_landing_is_not_said_to_be_where_the_aircraft_is(who: Who) -> None:
    """A plane comes down by its next landing sequence."""
    may = {
        Who.NOBODY: f" No station commands. {TAKE}",
        Who.THIS: " You command: choose another mode if it must not land.",
        Who.OTHER: " Another station commands: this one may not act.",
    }
    text = "LAND: GCSB silent for 5 s"
    assert line_of(FlightAction.LAND, text, who) == f"LAND: GCSB silent for 5 s.{may[who]}"


@pytest.mark.parametrize(
    ("action", "who", "line"),
    [
        (FlightAction.TRANSFER, Who.THIS, "TRANSFER: links weak."),
        (FlightAction.HOLD, Who.THIS, "HOLD: links weak. Type 'handover give STATION' to hand it over."),
        (FlightAction.HOLD, Who.OTHER, f"HOLD: links weak. {TAKE}"),
        (FlightAction.CONTINUE, Who.OTHER, "CONTINUE: links weak."),
        (
            FlightAction.RETURN,
            Who.THIS,
            "RETURN: links weak. You command. When the cause is over, 'handover resume' continues the mission.",
        ),
        (FlightAction.RETURN, Who.OTHER, "RETURN: links weak. Another station commands: this one may not act."),
    ],
)
def test_what_is_done_is_said_once(action: FlightAction, who: Who, line: str) -> None:
    assert line_of(action, f"{action.name}: links weak", who) == line


@pytest.mark.parametrize(
    ("site", "begins"),
    [
        ("rally 2", "RETURN to rally 2. Links weak. You command."),
        ("", "RETURN. The autopilot chooses home or a rally point. Links weak. You command."),
    ],
)
def test_a_return_without_a_place_says_where_to(site: str, begins: str) -> None:
    decisions = Decisions(nothing)
    notice = decisions.on_message(decision(1, FlightAction.RETURN, "RETURN. Links weak"), Who.THIS, site)
    assert notice is not None
    assert notice.text.startswith(begins)
    assert decisions.text == begins.removesuffix(". You command.")
    assert decisions.told("RETURN. Links weak"), "the same words in STATUSTEXT are not told again"


def test_a_return_with_a_place_keeps_it() -> None:
    notice = Decisions(nothing).on_message(decision(1, FlightAction.RETURN, RETURNS), Who.THIS, "home")
    assert notice is not None
    assert notice.text.startswith("RETURN to rally 2. GCSB silent")


@pytest.mark.parametrize("action", [FlightAction.HOLD, FlightAction.RETURN])
def test_in_a_rehearsal_no_command_is_offered_because_nothing_is_done(action: FlightAction) -> None:
    assert line_of(action, "REHEARSAL: would act: links weak", Who.OTHER) == "REHEARSAL: would act: links weak"


#: longer than the message's field, which ends within "ground"
LONG = (
    "RETURN to rally 2. Energy: 99.4 Wh left, the way back needs 101.2 Wh with the reserve; 1.9 km, "
    "needs 21 % of the battery (38 % left), OUT OF REACH, the way is too near to the ground, "
    "covered by GCSA all the way"
)
CUT = LONG[:160]


def test_a_sentence_that_is_longer_than_the_message_is_told_whole() -> None:
    """STATUSTEXT, which has come by then, holds all of it."""
    decisions = Decisions(lambda beginning: LONG if beginning == CUT else "")
    notice = decisions.on_message(decision(1, FlightAction.RETURN, LONG), Who.OTHER)
    assert notice == Notice("decision", f"{LONG}. Another station commands: this one may not act.", Level.EMERGENCY)
    assert decisions.text == LONG
    assert decisions.told(LONG), "by a second link"


def test_if_its_end_is_not_here_yet_it_is_told_that_there_is_one() -> None:
    decisions = Decisions(nothing)
    notice = decisions.on_message(decision(1, FlightAction.RETURN, LONG), Who.NOBODY)
    assert notice == Notice("decision", f"{CUT}... No station commands. {TAKE}", Level.EMERGENCY)
    assert not decisions.told(LONG), "the whole of it is told when it comes"


def test_a_sentence_that_the_message_can_hold_is_not_looked_for() -> None:
    looked: list[str] = []
    decisions = Decisions(lambda beginning: looked.append(beginning) or "")
    for number, text in enumerate(("W" * 156, "W" * 157)):  # a character of four bytes may be missing behind the latter
        decisions.on_message(decision(number, FlightAction.WARN, text), Who.OTHER)
    assert looked == ["W" * 157]


def test_a_number_with_other_words_is_another_decision() -> None:
    decisions = Decisions(nothing)
    decisions.on_message(decision(1, FlightAction.WARN, "WARNING. Guard silent"), Who.THIS)
    assert decisions.on_message(decision(1, FlightAction.WARN, "WARNING. Links weak"), Who.THIS) is not None
    assert decisions.on_message(decision(2, FlightAction.WARN, "WARNING. Links weak"), Who.THIS) is not None


def test_its_end_is_told_and_nothing_is_in_force() -> None:
    decisions = Decisions(nothing)
    decisions.on_message(decision(1, FlightAction.RETURN, "RETURN: links weak"), Who.OTHER)
    assert decisions.on_message(over(2, "ALL CLEAR. Over: links weak"), Who.OTHER) == Notice(
        "decision_over", "ALL CLEAR. Over: links weak"
    )
    assert (decisions.text, decisions.action) == ("", None)


@pytest.mark.parametrize("action", [77, 254])
def test_one_that_is_not_known_here_is_an_emergency_in_its_own_words(action: int) -> None:
    decisions = Decisions(nothing)
    told = decisions.on_message(
        mavlink.MAVLink_handover_decision_message(1, action, 5, b"", b"", b"DITCH: all is wrong"), Who.OTHER
    )
    assert told == Notice("decision", "DITCH: all is wrong", Level.EMERGENCY)
    assert (decisions.text, decisions.action) == ("DITCH: all is wrong", None)


def test_the_words_of_the_last_eight_are_known() -> None:
    """STATUSTEXT brings them too."""
    decisions = Decisions(nothing)
    for number in range(9):
        decisions.on_message(decision(number, FlightAction.WARN, f"WARN: {number} is wrong"), Who.THIS)
    known = [decisions.told(f"WARN: {number} is wrong") for number in range(9)]
    assert known == [False, *[True] * 8]
    assert not decisions.told("WARNING. 8 is wrong, and more")


def test_a_decision_without_words_makes_no_text_known() -> None:
    decisions = Decisions(nothing)
    decisions.on_message(over(1, ""), Who.THIS)
    assert not decisions.told("anything")

# SPDX-License-Identifier: GPL-3.0-or-later

"""Conversations with the autopilot, one by one: what is sent, what counts as an answer, and how each can end."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.vehicle.profiles.copter import CopterProcedures
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Ask, Asking, Conversation, NoAnswer, RefusedError
from tests.module.vehicle import GUIDED, LAND, RTL, Autopilot

AUTO, LOITER, SMART_RTL = 3, 5, 21

MODE, ARM, START = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_MISSION_START
DENIED, IN_PROGRESS = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_IN_PROGRESS


def talk(
    conversation: Asking, autopilot: Autopilot, limit_s: float = 60.0, aircraft: VehicleState | None = None
) -> Conversation:
    """Run a conversation to its end, in steps of 50 ms. `aircraft` gets each message before the conversation does."""
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    written: list[bytes] = []
    now = 100.0
    made = Conversation(conversation, lambda message: written.append(bytes(message.pack(own))), now)
    while not made.finished and now < 100.0 + limit_s:
        now += 0.05
        waiting, written[:] = list(written), []
        for message in autopilot.step(waiting, now):
            if aircraft is not None:
                aircraft.on_message(message, now)
            made.on_message(message, now)
        made.tick(now)
    return made


@pytest.fixture
def autopilot() -> Autopilot:
    autopilot = Autopilot()
    autopilot.guard_state = None
    return autopilot


@pytest.fixture
def copter() -> CopterProcedures:
    return CopterProcedures(1, lambda: "PreArm: why", VehicleState())


@pytest.fixture
def flying(autopilot: Autopilot) -> CopterProcedures:
    """Of a copter that has said that it flies in GUIDED."""
    autopilot.mode, aircraft = GUIDED, VehicleState()
    for message in autopilot.step([], 99.0):
        aircraft.on_message(message, 99.0)
    return CopterProcedures(1, lambda: "PreArm: why", aircraft)


def _state(procedures: CopterProcedures) -> VehicleState:
    assert isinstance(procedures.aircraft, VehicleState)
    return procedures.aircraft


# ---- the way home -------------------------------------------------------------------------------------------------


def test_the_way_home_is_rtl_seen_in_a_heartbeat(autopilot: Autopilot, copter: CopterProcedures) -> None:
    autopilot.mode = GUIDED
    made = talk(copter.bring_home(FlightAction.RETURN), autopilot)
    assert (made.result, made.failure, autopilot.mode) == ("RTL", None, RTL)


def test_what_is_no_arducopter_is_told_no_mode_but_to_return(autopilot: Autopilot) -> None:
    """Mode 6 is FBWB for a plane, and FOLLOW for a rover."""
    aircraft = VehicleState()
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GROUND_ROVER, 3, 0, 0, 4, 3), 1.0)
    copter = CopterProcedures(1, str, aircraft)
    made = talk(copter.bring_home(FlightAction.LAND), autopilot)
    assert made.result == "return to launch"
    assert [m.command for m in autopilot.got("COMMAND_LONG")] == [mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH]


@pytest.mark.parametrize("how", ["refused", "not answered", "not done"])
def test_where_rtl_cannot_be_had_it_lands(autopilot: Autopilot, flying: CopterProcedures, how: str) -> None:
    original = autopilot._command

    def only_land(m: Any) -> None:
        if int(m.param2) == LAND:
            autopilot.script.clear()
            autopilot.forgets.clear()
        original(m)

    autopilot._command = only_land  # type: ignore[method-assign]
    if how == "not done":
        autopilot.forgets.add(MODE)
    else:
        autopilot.script[MODE] = DENIED if how == "refused" else None
    made = talk(flying.bring_home(FlightAction.RETURN), autopilot, aircraft=_state(flying))
    assert (made.result, made.failure, autopilot.mode) == ("LAND", None, LAND)


@pytest.mark.parametrize(
    ("mode", "name"), [(LOITER, "LOITER"), (AUTO, "AUTO"), (SMART_RTL, "SMART_RTL")], ids=["pilot", "AUTO", "failsafe"]
)
@pytest.mark.parametrize("answers", [True, False])
def test_what_another_chooses_before_rtl_shows_is_not_ended_by_a_landing(
    autopilot: Autopilot, flying: CopterProcedures, mode: int, name: str, answers: bool
) -> None:
    """The fault: RTL was acknowledged, the next heartbeat showed a pilot's mode, and LAND was ordered over it."""
    original = autopilot._command

    def taken_over(m: Any) -> None:
        if answers:
            original(m)
        autopilot.mode = mode

    autopilot._command = taken_over  # type: ignore[method-assign]
    made = talk(flying.bring_home(FlightAction.RETURN), autopilot, aircraft=_state(flying))
    assert {m.param2 for m in autopilot.got("COMMAND_LONG")} == {float(RTL)}
    assert made.failure == f"not commanded again: the autopilot is in {name} now"
    assert not isinstance(made.error, RefusedError)


def test_an_order_to_land_does_not_fly_home_first(autopilot: Autopilot, copter: CopterProcedures) -> None:
    made = talk(copter.bring_home(FlightAction.LAND), autopilot)
    assert made.result == "LAND"
    assert [m.param2 for m in autopilot.got("COMMAND_LONG")] == [float(LAND)]


def test_an_autopilot_that_does_neither_is_told(autopilot: Autopilot, copter: CopterProcedures) -> None:
    autopilot.script[MODE] = DENIED
    made = talk(copter.bring_home(FlightAction.RETURN), autopilot)
    assert made.failure == ("the autopilot does not obey: mode LAND refused (MAV_RESULT_DENIED): PreArm: why")


# ---- commands -----------------------------------------------------------------------------------------------------


def test_a_command_in_progress_is_waited_for(copter: CopterProcedures) -> None:
    conversation = copter.start()
    ask = next(conversation)
    in_progress = mavlink.MAVLink_command_ack_message(MODE, IN_PROGRESS, 0, 0, 1, 191)
    assert ask.answer(in_progress) is None
    assert ask.answer(mavlink.MAVLink_command_ack_message(ARM, 0, 0, 0, 1, 191)) is None, "of another command"
    assert ask.answer(mavlink.MAVLink_command_ack_message(MODE, 0, 0, 0, 1, 191)) == 0


def test_a_result_that_mavlink_has_no_name_for_is_shown_as_its_number(
    autopilot: Autopilot, copter: CopterProcedures
) -> None:
    autopilot.script[MODE] = 77
    assert talk(copter.start(), autopilot).failure == "mode GUIDED refused (77): PreArm: why"


def test_a_refusal_without_a_reason_ends_with_the_result(autopilot: Autopilot) -> None:
    autopilot.script[ARM] = DENIED
    made = talk(CopterProcedures(1, lambda: "", VehicleState()).start(), autopilot)
    assert made.failure == "arming refused (MAV_RESULT_DENIED)"


# ---- any conversation ---------------------------------------------------------------------------------------------


class Line:
    """Where a conversation's messages go."""

    def __init__(self) -> None:
        self.sent: list[str] = []


def ask(what: str, tries: int = 3) -> Ask:
    return Ask(what, (what,), lambda message: message if message == f"{what}!" else None, timeout_s=1.0, tries=tries)


def test_a_question_is_asked_as_often_as_it_says_and_then_it_fails() -> None:
    def conversation() -> Asking:
        yield ask("a")
        raise AssertionError("there was no answer")

    line = Line()
    made = Conversation(conversation(), line.sent.append, 0.0)
    for now in (0.5, 0.999, 1.0, 1.5, 2.0, 2.999):
        made.tick(now)
    assert (line.sent, made.finished) == (["a", "a", "a"], False)
    made.tick(3.0)
    assert (line.sent, made.finished, made.failure) == (["a", "a", "a"], True, "no answer to a")


def test_an_answer_leads_to_the_next_question_with_tries_of_its_own() -> None:
    def conversation() -> Asking:
        first = yield ask("a")
        second = yield ask("b")
        return first + second

    line = Line()
    made = Conversation(conversation(), line.sent.append, 0.0)
    made.tick(1.0)
    made.on_message("b!", 1.1)
    made.on_message("a!", 1.2)
    made.tick(2.1)
    assert line.sent == ["a", "a", "b"]
    made.tick(2.2)
    assert line.sent == ["a", "a", "b", "b"]
    made.on_message("b!", 2.3)
    assert (made.finished, made.failure, made.result) == (True, None, "a!b!")
    made.on_message("b!", 2.4)
    made.tick(100.0)
    assert line.sent == ["a", "a", "b", "b"]


def test_a_conversation_may_live_with_no_answer() -> None:
    def conversation() -> Asking:
        try:
            yield ask("a", tries=1)
        except NoAnswer:
            yield ask("b", tries=1)
        return "done"

    line = Line()
    made = Conversation(conversation(), line.sent.append, 0.0)
    made.tick(1.0)
    made.on_message("b!", 1.1)
    assert (line.sent, made.result) == (["a", "b"], "done")


def test_a_conversation_that_is_broken_off_has_failed_and_says_nothing_more() -> None:
    def conversation() -> Asking:
        yield ask("a")

    line = Line()
    made = Conversation(conversation(), line.sent.append, 0.0)
    made.break_off("why")
    made.tick(10.0)
    made.on_message("a!", 10.0)
    assert (line.sent, made.finished, made.failure) == (["a"], True, "why")
    made.break_off("again")
    assert made.failure == "why"

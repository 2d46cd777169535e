# SPDX-License-Identifier: GPL-3.0-or-later

"""The filters of the gate, by their table: what each does to a verdict, and which comes before which."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.client_capabilities import Dialect
from mavproxy_handover.gate.filters import Filter
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.frames import ftp_request
from tests.gate.ledger import GCSA, GCSB, VEHICLE, A, B

Make = Callable[..., Frame]
FLYING = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
DO_SET_MODE, AUTO, CONTINUE = 176, 3, {"command": 193, "param1": 1.0}


@pytest.fixture
def door() -> Door:
    """Station A commands in flight."""
    door = Door()
    door.change(FLYING)
    return door


def auto(make: Make, **more: Any) -> Frame:
    return make("COMMAND_LONG", command=DO_SET_MODE, param1=1.0, param2=AUTO, **more)


class TestCommandsInFlight:
    """The situation decides, and the verdict of the gate is final."""

    def test_it_passes_if_the_situation_allows_it(self, door: Door, make: Make) -> None:
        frame = auto(make)
        came = door.up(A, frame)
        assert (came.verdict.fate, came.verdict.reason) == (Fate.FORWARD, GateReason.ALLOWED)
        assert came.passed == [frame.raw]
        assert [(intent.word, station) for intent, station in door.asked] == [("AUTO", GCSA)]
        assert door.gate.counts[GCSA] == {GateReason.ALLOWED: 1}

    def test_it_is_refused_and_answered_if_not_and_the_gate_says_no_reason(self, door: Door, make: Make) -> None:
        """The check of commands tells why: a text of the gate would be the second one."""
        door.command_passes = False
        frame = auto(make)
        door.ports[GCSA].capabilities.show((frame.sysid, frame.compid), Dialect.OURS, door.now)  # it knows all results
        came = door.up(A, frame)
        assert (came.verdict.fate, came.verdict.reason, came.passed) == (Fate.REFUSE, GateReason.SITUATION, [])
        (answer,) = [mavlink.MAVLink(None).decode(bytearray(raw)) for raw in came.answers]
        assert (answer.get_type(), answer.command, answer.result) == ("COMMAND_ACK", DO_SET_MODE, 1), (
            "temporarily rejected"
        )
        assert door.said == []
        assert door.gate.counts[GCSA] == {GateReason.SITUATION: 1}

    def test_a_check_that_breaks_lets_nothing_pass(self, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
        def broken(*_anything: Any) -> bool:
            raise RuntimeError("a bug")

        monkeypatch.setattr(Door, "_allows", broken)
        door = Door()
        door.change(FLYING)
        with pytest.raises(RuntimeError):
            door.up(A, auto(make))
        assert door.passed == []

    def test_what_another_station_sends_is_not_asked_about(self, door: Door, make: Make) -> None:
        assert door.up(B, auto(make, sysid=GCSB)).verdict.reason is GateReason.NOT_IN_CONTROL
        assert door.asked == []

    def test_on_the_ground_a_command_that_begins_a_flight_stays_with_the_companion(
        self, door: Door, make: Make
    ) -> None:
        door.change(replace(FLYING, phase=Phase.ON_LOAD, armed=False))
        came = door.up(A, make("COMMAND_LONG", command=400, param1=1.0))
        assert (came.verdict.fate, came.passed, door.asked) == (Fate.CONSUME, [], [])
        came = door.up(A, make("COMMAND_LONG", command=300))
        assert (came.verdict.fate, came.passed, door.asked) == (Fate.CONSUME, [], []), "START"
        assert door.up(A, auto(make)).verdict.fate is Fate.FORWARD
        assert door.asked == []

    def test_what_the_policy_refuses_in_a_rehearsal_is_not_asked_about(self, door: Door, make: Make) -> None:
        door.change(replace(FLYING, rehearsal=True))
        assert door.up(A, make("COMMAND_LONG", command=300)).verdict.fate is Fate.REFUSE
        assert door.asked == []

    def test_a_command_for_another_aircraft_is_dropped_unasked(self, door: Door, make: Make) -> None:
        came = door.up(A, auto(make, target_system=VEHICLE + 1))
        assert (came.verdict.fate, came.verdict.reason) == (Fate.DROP, GateReason.OTHER_TARGET)
        assert (came.passed, door.asked) == ([], [])

    def test_a_rally_point_is_no_target_whatever_it_says(self, door: Door, make: Make) -> None:
        """MISSION_ITEM with current 2 is a place to fly to, but one of the rally list is the companion's."""
        came = door.up(A, make("MISSION_ITEM_INT", mission_type=2, current=2, frame=6, z=40.0))
        assert (came.verdict.fate, came.verdict.access) == (Fate.CONSUME, Access.RALLY_WRITE)
        assert (came.passed, door.asked) == ([], [])

    def test_a_part_of_an_upload_stays_with_the_companion(self, door: Door, make: Make) -> None:
        came = door.up(A, make("MISSION_COUNT", count=3, mission_type=0))
        assert (came.verdict.fate, came.passed, door.asked) == (Fate.CONSUME, [], [])


def test_an_observer_may_end_its_own_reading_of_a_file_and_no_other(door: Door, make: Make) -> None:
    door.change(replace(FLYING, phase=Phase.ON_LOAD, armed=False))
    ends = make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=ftp_request(1, b""))
    assert door.up(B, ends).verdict.fate is Fate.REFUSE
    door.up(B, make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=ftp_request(4, b"x")))
    assert door.up(B, ends).verdict.fate is Fate.FORWARD


def test_sticks_of_who_does_not_command_are_dropped_for_that_reason_on_the_ground_too(door: Door, make: Make) -> None:
    door.change(replace(FLYING, phase=Phase.ON_LOAD, armed=False))
    dropped = door.up(B, make("RC_CHANNELS_OVERRIDE", sysid=GCSB, chan1_raw=1500)).verdict
    assert (dropped.fate, dropped.reason) == (Fate.DROP, GateReason.NOT_IN_CONTROL)
    dropped = door.up(A, make("RC_CHANNELS_OVERRIDE", chan1_raw=1500)).verdict
    assert (dropped.fate, dropped.reason) == (Fate.DROP, GateReason.NOT_ARMED)


@pytest.mark.parametrize(
    ("access", "msgid", "commands", "sees"),
    [
        (Access.STREAM, 9, True, True),
        (Access.COMMAND, 9, True, False),
        (Access.STREAM, 8, True, False),
        (Access.STREAM, None, True, False),
        (Access.STREAM, 9, False, False),
    ],
)
def test_a_filter_sees_its_messages_of_its_classes_and_its_stations(
    access: Access, msgid: int | None, commands: bool, sees: bool
) -> None:
    def limit(_frame: Frame, verdict: Verdict, _station: int, _now: float) -> Verdict:
        return verdict

    row = Filter("some", frozenset({Access.STREAM}), limit, frozenset({9}), commands=True)
    assert (access in row.seen_of(msgid, commands)) is sees
    assert (Access.STREAM in row._replace(messages=None).seen_of(msgid, commands)) is commands
    assert Access.STREAM in row._replace(commands=None).seen_of(9, commands)


class TestCommandsOfTheCompanion:
    """A command that the autopilot does not know."""

    def test_it_is_the_companions_after_the_situation_has_allowed_it(self, door: Door, make: Make) -> None:
        door.takes_over = lambda _frame: True
        came = door.up(A, make("COMMAND_LONG", **CONTINUE))
        assert (came.verdict.fate, came.verdict.reason, came.passed) == (Fate.CONSUME, GateReason.COMPANION, [])
        assert len(door.asked) == 1

    def test_what_is_no_command_is_the_autopilots(self, door: Door, make: Make) -> None:
        door.takes_over = lambda _frame: True
        frame = make("PING")
        assert door.up(A, frame).passed == [frame.raw]

    def test_what_the_situation_forbids_is_refused(self, door: Door, make: Make) -> None:
        door.takes_over = lambda _frame: True
        door.command_passes = False
        came = door.up(A, make("COMMAND_LONG", **CONTINUE))
        assert (came.verdict.fate, came.passed) == (Fate.REFUSE, [])

    @pytest.mark.parametrize("view", [replace(FLYING, phase=Phase.ON_LOAD), replace(FLYING, rehearsal=True)])
    def test_on_the_ground_and_in_a_rehearsal_it_is_the_autopilots(
        self, door: Door, make: Make, view: AuthorityView
    ) -> None:
        door.change(view)
        door.takes_over = lambda _frame: True
        frame = make("COMMAND_LONG", **CONTINUE)
        came = door.up(A, frame)
        assert (came.verdict.fate, came.passed) == (Fate.FORWARD, [frame.raw])

# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that does not command asks so much and no more, and leaves the commander's file alone."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict, judge
from mavproxy_handover.gate.questions import Budget, Questions, Sort
from mavproxy_handover.gate.refusals import refusal
from mavproxy_handover.wire.frames import Frame
from tests.gate.frames import ftp_request
from tests.gate.ledger import GCSA, GCSB, GCSC, TRACKER_OF_B, VEHICLE, A, B, C

Make = Callable[..., Frame]
COMMANDED_BY_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD)
ALLOWED = (Fate.FORWARD, GateReason.ALLOWED)
TOO_MANY = (Fate.DROP, GateReason.TOO_MANY)
FILE_BUSY = (Fate.REFUSE, GateReason.FILE_BUSY)
CREATE, TERMINATE, READ, OPEN = 6, 1, 5, 4


BUDGETS = {
    Sort.QUESTION: Budget(10.0, 20.0, 15.0, 30.0),
    Sort.SLOWNESS: Budget(0.1, 25.0, 0.2, 40.0),
    Sort.COMPANION: Budget(10.0, 20.0),
}


class Desk:
    """The gate's way of a frame: judged, limited, followed by the flush."""

    def __init__(self) -> None:
        self.flusher = FlushTracker(VEHICLE)
        self.questions = Questions(self.flusher, BUDGETS)

    def ask(self, frame: Frame, now: float, commander: int | None = GCSA) -> Verdict:
        view = COMMANDED_BY_A if commander else AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST)
        station = {GCSA: A, GCSC: C}.get(frame.sysid, B)
        verdict = judge(frame, station, view, VEHICLE)
        verdict = self.questions.limit(frame, verdict, station.sysid, commander, now)
        if station.sysid == commander and verdict.fate is Fate.FORWARD:
            self.questions.commander_sent(frame, now)
        self.flusher.saw(frame, verdict, station.sysid)
        return verdict

    def outcome(self, frame: Frame, now: float, commander: int | None = GCSA) -> tuple[Fate, GateReason]:
        verdict = self.ask(frame, now, commander)
        return verdict.fate, verdict.reason


@pytest.fixture
def desk() -> Desk:
    return Desk()


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("PING", {}),
        ("COMMAND_LONG", {"command": 512}),
        ("FILE_TRANSFER_PROTOCOL", {"payload": ftp_request(READ)}),
        ("CONNECT", {}),
        ("COMMAND_LONG", {"command": 32100}),
    ],
)
def test_an_observer_has_a_reserve_and_then_so_many_a_second(
    desk: Desk, make: Make, name: str, fields: dict[str, object]
) -> None:
    frame = make(name, sysid=GCSB, **fields)
    for second, expected in ((0.0, 20), (1.0, 10), (3.0, 20), (100.0, 20)):
        passed = [desk.outcome(frame, second) for _ in range(50)]
        assert passed[expected:] == [TOO_MANY] * (50 - expected)
        assert TOO_MANY not in passed[:expected]


def test_the_commander_asks_as_much_as_it_likes(desk: Desk, make: Make) -> None:
    frame = make("PARAM_REQUEST_READ", sysid=GCSA)
    assert [desk.outcome(frame, 0.0) for _ in range(100)] == [ALLOWED] * 100


def test_what_is_refused_or_dropped_anyway_is_not_counted(desk: Desk, make: Make) -> None:
    for name, fields in (("COMMAND_LONG", {"command": 400}), ("RC_CHANNELS_OVERRIDE", {}), ("HEARTBEAT", {})):
        for _ in range(100):
            assert desk.ask(make(name, sysid=GCSB, **fields), 0.0).reason is not GateReason.TOO_MANY
    assert desk.outcome(make("PING", sysid=GCSB), 0.0) == ALLOWED


def test_who_asks_too_much_of_the_autopilot_can_still_take_part_in_a_transfer(desk: Desk, make: Make) -> None:
    for _ in range(100):
        desk.ask(make("PING", sysid=GCSB), 0.0)
    assert desk.outcome(make("ON_HANDOVER", sysid=GCSB), 0.0) == (Fate.CONSUME, GateReason.COMPANION)


def counted(desk: Desk, frame: Frame, now: float, times: int = 60) -> int:
    """How many of so many questions pass, all at once."""
    return sum(desk.outcome(frame, now) != TOO_MANY for _ in range(times))


def test_all_that_do_not_command_share_what_the_autopilot_answers(desk: Desk, make: Make) -> None:
    of_b, of_c = make("PING", sysid=GCSB), make("PING", sysid=GCSC)
    assert [counted(desk, frame, 0.0) for frame in (of_b, of_c)] == [20, 10], "30 in all"
    assert [counted(desk, frame, 1.0) for frame in (of_b, of_c)] == [10, 5], "15 a second in all"
    assert [counted(desk, frame, 2.0) for frame in (of_c, of_b)] == [15, 0], "C's reserve is not used up"
    assert counted(desk, make("PING", sysid=GCSA), 2.0) == 60, "the commander's own are not among them"


def test_nobody_keeps_another_one_from_a_transfer(desk: Desk, make: Make) -> None:
    assert counted(desk, make("CONNECT", sysid=GCSB), 0.0) == 20
    assert counted(desk, make("CONNECT", sysid=GCSC), 0.0) == 20


EXTENDED = ("PARAM_EXT_REQUEST_LIST", {})
LIST, BANNER = ("PARAM_REQUEST_LIST", {}), ("COMMAND_LONG", {"command": 42428})
LISTING = ("FILE_TRANSFER_PROTOCOL", {"payload": ftp_request(3, b"/")})


@pytest.mark.parametrize(
    ("question", "every_s", "expected"),
    [
        (LIST, 20.0, 2),  # ten seconds each, of which two come back until the next: 25, 17, 9
        (EXTENDED, 20.0, 2),
        (LIST, 0.5, 34),  # the first costs ten, one that begins it anew half a second
        (BANNER, 3.0, 35),  # a second each, of which 0.3 come back
        (LISTING, 0.1, 267),  # the first a second, the others 0.1
    ],
)
def test_bulk_reads_may_slow_down_the_commanders_telemetry_for_so_long(
    desk: Desk, make: Make, question: tuple[str, dict[str, object]], every_s: float, expected: int
) -> None:
    """25 s for one station, and then a tenth of the time."""
    name, fields = question
    frame = make(name, sysid=GCSB, **fields)
    passed = 0
    while passed < 1000 and desk.outcome(frame, passed * every_s) != TOO_MANY:
        passed += 1
    assert passed == expected


def test_who_has_read_too_much_in_bulk_may_still_ask_for_one_thing(desk: Desk, make: Make) -> None:
    name, fields = LIST
    for number in range(40):
        desk.ask(make(name, sysid=GCSB, **fields), number * 1.0)
    assert desk.outcome(make(name, sysid=GCSB, **fields), 40.0) == TOO_MANY
    assert desk.outcome(make("PING", sysid=GCSB), 40.0) == ALLOWED
    assert desk.outcome(make(name, sysid=GCSC, **fields), 40.0) == ALLOWED, "another station's share"


def test_two_that_read_at_the_same_time_pay_once_and_all_together_have_an_end(desk: Desk, make: Make) -> None:
    name, _fields = LIST
    assert desk.outcome(make(name, sysid=GCSB), 0.0) == ALLOWED  # B 15 left, all 30
    assert desk.outcome(make(name, sysid=GCSC), 0.0) == ALLOWED  # costs nothing more
    for at in (20.0, 40.0):
        assert desk.outcome(make(name, sysid=GCSC), at) == ALLOWED  # all 24, 18
    assert desk.outcome(make(name, sysid=GCSB), 60.0) == ALLOWED  # 12
    assert desk.outcome(make(name, sysid=GCSC), 80.0) == ALLOWED  # 6, and C has 25 - 30 + 8
    assert desk.outcome(make(name, sysid=GCSB), 100.0) == ALLOWED  # 0
    assert desk.outcome(make(name, sysid=GCSB), 140.0) == TOO_MANY
    assert desk.outcome(make(name, sysid=GCSC), 200.0) == ALLOWED


def test_the_commanders_bulk_reads_cost_the_others_nothing(desk: Desk, make: Make) -> None:
    for number in range(200):
        assert desk.outcome(make("PARAM_REQUEST_LIST", sysid=GCSA), number * 0.5) == ALLOWED
    assert desk.outcome(make("PARAM_REQUEST_LIST", sysid=GCSB), 100.0) == ALLOWED


def test_so_many_senders_of_one_station_reach_the_autopilot(desk: Desk, make: Make) -> None:
    frames = [make("PING", sysid=sysid, compid=compid) for compid in range(1, 100) for sysid in (GCSB, TRACKER_OF_B)]
    outcomes = [desk.outcome(frame, float(number)) for number, frame in enumerate(frames)]
    assert outcomes == [ALLOWED] * 4 + [TOO_MANY] * 194
    assert desk.outcome(frames[3], 1000.0) == ALLOWED
    assert desk.ask(make("CONNECT", sysid=GCSB), 1000.0).fate is Fate.CONSUME


def test_a_clock_that_stands_still_or_goes_back_gives_nothing(desk: Desk, make: Make) -> None:
    frame = make("PING", sysid=GCSB)
    assert [desk.outcome(frame, 9.0 - number) for number in range(21)] == [ALLOWED] * 20 + [TOO_MANY]


def ftp(make: Make, opcode: int, sysid: int, data: bytes = b"", session: int = 3) -> Frame:
    return make("FILE_TRANSFER_PROTOCOL", sysid=sysid, payload=ftp_request(opcode, data, session))


def test_nobody_else_uses_file_transfer_while_the_commander_writes_a_file(desk: Desk, make: Make) -> None:
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@SYS/tasks.txt"), 0.0) == ALLOWED
    desk.ask(ftp(make, CREATE, GCSA, b"@MISSION/mission.dat"), 0.0)
    for opcode in (0, 3, 4, 5, 14, 15, 16):
        assert desk.outcome(ftp(make, opcode, GCSB), 0.1) == FILE_BUSY
    assert desk.outcome(make("PING", sysid=GCSB), 0.1) == ALLOWED
    assert desk.outcome(ftp(make, READ, GCSA), 0.1) == ALLOWED
    desk.ask(ftp(make, TERMINATE, GCSA), 0.2)
    done = [1, 0, 3, 128, 0, TERMINATE, *[0] * 245]
    aim = {"target_system": GCSA, "target_component": 190}
    desk.flusher.note_reply(make("FILE_TRANSFER_PROTOCOL", sysid=1, compid=1, payload=done, **aim))
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@SYS/tasks.txt"), 10.1) == FILE_BUSY
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@SYS/tasks.txt"), 10.2) == ALLOWED


def test_a_file_that_stays_open_keeps_others_out_however_long_the_commander_is_silent(desk: Desk, make: Make) -> None:
    desk.ask(ftp(make, CREATE, GCSA, b"@MISSION/mission.dat"), 0.0)
    assert desk.outcome(ftp(make, OPEN, GCSB, b"y"), 1000.0) == FILE_BUSY


def test_a_reader_does_not_keep_the_commander_out(desk: Desk, make: Make) -> None:
    """The autopilot refuses the commander's first request, and the next one once the reader was silent for 3 s."""
    assert desk.outcome(ftp(make, READ, GCSB), 0.0) == ALLOWED
    assert desk.outcome(ftp(make, 3, GCSA, b"/"), 0.1) == ALLOWED
    assert [desk.outcome(ftp(make, READ, GCSB), at) for at in (0.2, 5.0, 10.0, 10.2)] == [FILE_BUSY] * 3 + [ALLOWED]


def test_what_a_commander_is_refused_does_not_keep_others_out(desk: Desk, make: Make) -> None:
    assert desk.outcome(ftp(make, CREATE, GCSA, b"scripts/x.lua"), 0.0)[0] is Fate.REFUSE
    desk.ask(make("PING", sysid=GCSA), 0.0)
    assert desk.outcome(ftp(make, READ, GCSB), 0.1) == ALLOWED


def test_a_file_of_a_station_that_commands_no_more_keeps_nobody_waiting(desk: Desk, make: Make) -> None:
    desk.ask(ftp(make, CREATE, GCSA, b"x"), 0.0)
    assert desk.outcome(ftp(make, OPEN, GCSB, b"y"), 0.1, commander=None) == ALLOWED


def test_the_refusal_says_that_there_is_no_session(desk: Desk, make: Make) -> None:
    desk.ask(ftp(make, CREATE, GCSA, b"x"), 0.0)
    frame = ftp(make, OPEN, GCSB, b"y")
    own = mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=191)
    (answer,) = refusal(frame, desk.ask(frame, 0.1), own, lambda result: result)
    message = mavlink.MAVLink(None).decode(bytearray(answer))
    assert (message.target_system, message.get_srcComponent()) == (GCSB, 1)
    assert (message.payload[3], message.payload[5], message.payload[12]) == (129, OPEN, 5)


NOT_IN_CONTROL = (Fate.REFUSE, GateReason.NOT_IN_CONTROL)


def test_an_observer_may_end_its_own_reading(desk: Desk, make: Make) -> None:
    """The fault: its file stayed open at the autopilot, which refused the commander's next request for a file."""
    assert desk.outcome(ftp(make, TERMINATE, GCSB), 0.0) == NOT_IN_CONTROL
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@PARAM/param.pck"), 0.1) == ALLOWED
    assert desk.outcome(ftp(make, TERMINATE, GCSB, session=4), 0.2) == NOT_IN_CONTROL
    assert desk.outcome(ftp(make, TERMINATE, TRACKER_OF_B), 0.3) == NOT_IN_CONTROL
    assert desk.outcome(ftp(make, TERMINATE, GCSC), 0.4) == NOT_IN_CONTROL
    assert desk.outcome(ftp(make, TERMINATE, GCSB), 0.5) == ALLOWED
    assert desk.outcome(ftp(make, TERMINATE, GCSB), 0.6) == NOT_IN_CONTROL


def test_it_may_not_when_another_station_has_opened_a_file_since(desk: Desk, make: Make) -> None:
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@PARAM/param.pck"), 0.0) == ALLOWED
    assert desk.outcome(ftp(make, OPEN, GCSC, b"@PARAM/param.pck"), 0.1) == ALLOWED
    assert desk.outcome(ftp(make, TERMINATE, GCSB), 0.2) == NOT_IN_CONTROL
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@PARAM/param.pck"), 0.3) == ALLOWED
    desk.ask(ftp(make, OPEN, GCSA, b"@MISSION/mission.dat"), 0.4)
    for at in (0.5, 20.0):
        assert desk.outcome(ftp(make, TERMINATE, GCSB), at) == NOT_IN_CONTROL


def test_the_end_of_its_reading_does_not_go_to_another_aircraft(desk: Desk, make: Make) -> None:
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@PARAM/param.pck"), 0.0) == ALLOWED
    elsewhere = make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, target_system=9, payload=ftp_request(TERMINATE, session=3))
    assert desk.outcome(elsewhere, 0.1) == (Fate.DROP, GateReason.OTHER_TARGET)


def test_an_observer_hears_at_once_that_there_is_no_rally_file_while_the_commander_writes_one(
    desk: Desk, make: Make
) -> None:
    desk.ask(ftp(make, CREATE, GCSA, b"@MISSION/mission.dat"), 0.0)
    rally = ftp(make, OPEN, GCSB, b"@MISSION/rally.dat")
    assert desk.outcome(rally, 0.1) == (Fate.REFUSE, GateReason.ABSENT)


def test_an_observer_never_resets_the_sessions_of_all(desk: Desk, make: Make) -> None:
    assert desk.outcome(ftp(make, OPEN, GCSB, b"@PARAM/param.pck"), 0.0) == ALLOWED
    assert desk.outcome(ftp(make, 2, GCSB), 0.1) == NOT_IN_CONTROL

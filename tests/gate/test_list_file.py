# SPDX-License-Identifier: GPL-3.0-or-later

"""The rally list as a file: what a program asks and what it hears, one by one."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.list_file import BURST, ListFile
from mavproxy_handover.gate.mission_server import Turn
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.protocol_items import Flaw
from mavproxy_handover.wire.file_transfer import DATA, Head, checksum, head_of, message
from tests.gate.frames import ftp_request, make_frame

STATION, OTHER = 251, 252
PROGRAM = (251, 190)
RALLY = mavlink.MAV_MISSION_TYPE_RALLY
TERMINATE, RESET, OPEN, READ, CREATE, WRITE, OPEN_WRITE, CRC, BURST_READ, ACK, NAK = (
    1,
    2,
    4,
    5,
    6,
    7,
    11,
    14,
    15,
    128,
    129,
)
MOST = 5
NAME = b"@MISSION/rally.dat"
ITEM = struct.Struct("<4fiifHH6B")


def point(lat: int, alt: float = 30.0) -> MissionItem:
    return MissionItem(0, 5100, 3, 0.0, 0.0, 0.0, 0.0, lat / 1e7, 5.9, alt, True)


def refuse_low(item: MissionItem) -> Flaw | None:
    return Flaw(mavlink.MAV_MISSION_INVALID_PARAM7, f"item {item.seq}: too low") if item.alt_m < 0.0 else None


@pytest.fixture
def points() -> list[MissionItem]:
    return [point(520000000), point(521000001, 40.0)]


@pytest.fixture
def file(points: list[MissionItem]) -> ListFile:
    return ListFile(RALLY, MOST, lambda: points, refuse_low)


def ask(
    file: ListFile,
    opcode: int,
    data: bytes = b"",
    *,
    size: int | None = None,
    offset: int = 0,
    session: int = 3,
    seq: int = 7,
) -> Turn:
    head = Head(seq, session, opcode, len(data) if size is None else size, 0, 0, offset)
    return file.answer(STATION, message((1, 1), head, data), PROGRAM)


def heard(turn: Turn) -> list[tuple[int, bytes]]:
    """Opcode and data of each answer."""
    found = []
    for answer in turn.answers:
        assert (answer.target_system, answer.target_component) == PROGRAM
        head = head_of(bytes(answer.payload))
        assert head.session == 3
        found.append((head.opcode, bytes(answer.payload)[DATA][: head.size]))
    return found


def heads(turn: Turn) -> list[Head]:
    return [head_of(bytes(answer.payload)) for answer in turn.answers]


def content(
    *points: tuple[int, float], magic: int = 0x763D, kind: int = RALLY, options: int = 0, start: int = 0
) -> bytes:
    """A file of such points: latitude in 1e-7 degrees, height."""
    items = [
        ITEM.pack(0, 0, 0, 0, lat, 59000000, alt, n, 5100, 0, 0, 3, 0, 1, RALLY) for n, (lat, alt) in enumerate(points)
    ]
    return struct.pack("<5H", magic, kind, options, start, len(points)) + b"".join(items)


def written(file: ListFile, data: bytes, opcode: int = CREATE) -> Turn:
    """What comes of a file that is written whole."""
    assert heard(ask(file, opcode, NAME)) == [(ACK, b"")]
    for offset in range(0, len(data), 80):
        assert heard(ask(file, WRITE, data[offset : offset + 80], offset=offset)) == [(ACK, b"")]
    return ask(file, TERMINATE)


def test_reading_it_gives_arducopters_file(file: ListFile) -> None:
    whole = content((520000000, 30.0), (521000001, 40.0))
    assert len(whole) == 10 + 2 * 38
    assert heard(ask(file, OPEN, NAME)) == [(ACK, struct.pack("<I", len(whole)))]
    assert heard(ask(file, READ, size=50)) == [(ACK, whole[:50])]
    turn = ask(file, READ, size=239, offset=50)
    assert heard(turn) == [(ACK, whole[50:])]
    assert heads(turn) == [Head(8, 3, ACK, 36, READ, 0, 50)]
    assert heard(ask(file, READ, size=239, offset=len(whole))) == [(NAK, b"\x06")]
    assert heard(ask(file, READ, size=239, offset=0xFFFFFFFF)) == [(NAK, b"\x06")]
    assert heard(ask(file, TERMINATE)) == [(ACK, b"")]


def test_it_stays_what_it_was_when_it_was_opened(file: ListFile, points: list[MissionItem]) -> None:
    ask(file, OPEN, NAME)
    points.clear()
    assert heard(ask(file, READ, size=239)) == [(ACK, content((520000000, 30.0), (521000001, 40.0)))]


def test_a_burst_is_numbered_on_and_ends_with_the_end(file: ListFile) -> None:
    whole = content((520000000, 30.0), (521000001, 40.0))
    ask(file, OPEN, NAME)
    turn = ask(file, BURST_READ, size=40, seq=65534)
    assert heard(turn) == [(ACK, whole[:40]), (ACK, whole[40:80]), (ACK, whole[80:]), (NAK, b"\x06")]
    assert [(h.sequence, h.answered, h.burst_complete, h.offset) for h in heads(turn)] == [
        (65535, BURST_READ, 0, 0),
        (0, BURST_READ, 0, 40),
        (1, BURST_READ, 1, 80),
        (2, BURST_READ, 0, 86),
    ]
    assert heard(ask(file, BURST_READ, size=0)) == [(ACK, whole), (NAK, b"\x06")], "0: as much as there is room for"
    assert heard(ask(file, BURST_READ, size=80, offset=86)) == [(NAK, b"\x06")]


def test_a_burst_of_small_pieces_has_an_end_too(file: ListFile) -> None:
    ask(file, OPEN, NAME)
    turn = ask(file, BURST_READ, size=1)
    assert len(turn.answers) == BURST == 24
    assert [h.burst_complete for h in heads(turn)] == [0] * (BURST - 1) + [1]


def test_its_checksum_is_the_autopilots(file: ListFile) -> None:
    whole = content((520000000, 30.0), (521000001, 40.0))
    assert heard(ask(file, CRC, NAME)) == [(ACK, checksum(whole).to_bytes(4, "little"))]


@pytest.mark.parametrize("opcode", [CREATE, OPEN_WRITE])
def test_a_whole_list_counts_when_its_session_is_terminated(file: ListFile, opcode: int) -> None:
    turn = written(file, content((523000000, 25.0), (524000000, 26.5), (525000000, 27.0)), opcode)
    assert heard(turn) == []
    assert turn.whole is not None
    assert (turn.whole.sender, turn.whole.kind) == (PROGRAM, RALLY)
    assert [(i.seq, i.command, i.frame, i.lat_deg, i.alt_m) for i in turn.whole.items] == [
        (0, 5100, 3, 52.3, 25.0),
        (1, 5100, 3, 52.4, 26.5),
        (2, 5100, 3, 52.5, 27.0),
    ]
    assert heard(file.conclude(STATION)) == [(ACK, b"")]


def test_what_was_not_concluded_is_never_acknowledged(file: ListFile) -> None:
    written(file, content((523000000, 25.0)))
    again = ask(file, TERMINATE)
    assert (heard(again), again.whole) == ([(NAK, b"\x01")], None)


def test_pieces_may_come_in_any_order_and_twice(file: ListFile) -> None:
    data = content((523000000, 25.0))
    ask(file, CREATE, NAME)
    ask(file, WRITE, data[30:], offset=30)
    ask(file, WRITE, data[:30])
    ask(file, WRITE, data[:30])
    turn = ask(file, TERMINATE)
    assert turn.whole is not None
    assert [i.lat_deg for i in turn.whole.items] == [52.3]


def test_an_empty_list_is_one(file: ListFile) -> None:
    turn = written(file, content())
    assert turn.whole is not None
    assert turn.whole.items == ()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "the file has no head"),
        (b"\0" * 9, "the file has no head"),
        (content((523000000, 25.0), magic=0x671B), "the file is of another kind"),
        (content((523000000, 25.0), kind=0), "the file is of another kind"),
        (content((523000000, 25.0), options=1), "a part of a list is not taken by file"),
        (content((523000000, 25.0), start=1), "a part of a list is not taken by file"),
        (content((523000000, 25.0))[:-1], "1 items do not take 47 bytes"),
        (content((523000000, 25.0)) + b"\0", "1 items do not take 49 bytes"),
        (content((523000000, 25.0), (524000000, -1.0)), "item 1: too low"),
    ],
)
def test_what_is_no_list_changes_nothing_and_is_said_once(file: ListFile, data: bytes, words: str) -> None:
    turn = written(file, data)
    assert (heard(turn), turn.whole, turn.words) == ([(NAK, b"\x01")], None, words)
    again = ask(file, TERMINATE)
    assert (heard(again), again.whole, again.words) == ([(NAK, b"\x01")], None, "")


def test_it_does_not_grow_beyond_the_longest_list(file: ListFile) -> None:
    longest = 10 + MOST * 38
    ask(file, CREATE, NAME)
    assert heard(ask(file, WRITE, b"x", offset=longest - 1)) == [(ACK, b"")]
    turn = ask(file, WRITE, b"x", offset=longest)
    assert (heard(turn), turn.words) == ([(NAK, b"\x01")], f"{longest + 1} bytes (at most {longest})")
    assert heard(ask(file, WRITE, b"x", offset=0xFFFFFFFF)) == [(NAK, b"\x01")]


def test_what_is_open_for_one_is_not_open_for_the_other(file: ListFile) -> None:
    ask(file, OPEN, NAME)
    assert heard(ask(file, WRITE, b"x")) == [(NAK, b"\x01")]
    ask(file, CREATE, NAME)
    assert heard(ask(file, READ, size=10)) == [(NAK, b"\x01")]
    assert heard(ask(file, BURST_READ, size=10)) == [(NAK, b"\x01")]


def test_without_an_open_file_nothing_is_read(file: ListFile) -> None:
    assert heard(ask(file, READ, size=10)) == [(NAK, b"\x05")]
    assert heard(ask(file, TERMINATE)) == [(NAK, b"\x05")]


# ---- whose a request is -------------------------------------------------------------------------------------------


def takes(
    file: ListFile, opcode: int, *, station: int = STATION, compid: int = 190, session: int = 3, seq: int = 7
) -> Access | None:
    payload = ftp_request(opcode, b"", session, seq)
    return file.access(station, make_frame("FILE_TRANSFER_PROTOCOL", compid=compid, payload=payload))


def test_of_nobody_s_file_nothing_is_known(file: ListFile) -> None:
    for opcode in range(256):
        assert takes(file, opcode) is None


def test_requests_of_its_session_are_its_own(file: ListFile) -> None:
    ask(file, OPEN, NAME)
    read, write = Access.RALLY_READ, Access.RALLY_WRITE
    assert [takes(file, opcode) for opcode in (READ, BURST_READ, TERMINATE)] == [read, read, read]
    assert takes(file, WRITE) is write, "and is refused by itself"
    assert [takes(file, opcode) for opcode in (0, 3, 8, 12, 13, CRC, ACK, NAK, 255)] == [None] * 9
    assert takes(file, READ, session=4) is None
    assert takes(file, READ, compid=191) is None
    assert takes(file, READ, station=OTHER) is None
    assert takes(file, READ) is read
    ask(file, CREATE, NAME)
    assert [takes(file, opcode) for opcode in (WRITE, TERMINATE)] == [write, write]


def test_what_is_asked_of_a_camera_has_nothing_to_do_with_it(file: ListFile) -> None:
    ask(file, OPEN, NAME)
    for opcode in (READ, TERMINATE, OPEN, RESET):
        payload = ftp_request(opcode, b"", 3, 7)
        assert file.access(STATION, make_frame("FILE_TRANSFER_PROTOCOL", target_component=100, payload=payload)) is None
    everybody = make_frame("FILE_TRANSFER_PROTOCOL", target_component=0, payload=ftp_request(READ, b"", 3, 7))
    assert file.access(STATION, everybody) is Access.RALLY_READ


@pytest.mark.parametrize("opcode", [OPEN, CREATE, OPEN_WRITE, RESET])
def test_whatever_is_opened_next_ends_it(file: ListFile, opcode: int) -> None:
    ask(file, CREATE, NAME)
    assert file.writers == (STATION,)
    assert takes(file, opcode, session=9) is None
    assert file.writers == ()
    assert takes(file, WRITE) is None


def test_the_end_is_answered_again_and_then_it_is_the_autopilots(file: ListFile) -> None:
    written(file, content((523000000, 25.0)))
    turn = file.conclude(STATION)
    assert takes(file, TERMINATE) is Access.RALLY_WRITE
    again = ask(file, TERMINATE)
    assert (heard(again), again.answers) == ([(ACK, b"")], turn.answers)
    assert takes(file, TERMINATE, seq=8) is None
    assert takes(file, WRITE) is None
    assert file.writers == ()


def test_a_station_that_reads_is_no_writer(file: ListFile) -> None:
    ask(file, OPEN, NAME)
    assert file.writers == ()


def test_what_was_given_up_is_gone(file: ListFile) -> None:
    ask(file, CREATE, NAME)
    file.forget(STATION)
    file.forget(STATION)
    assert file.writers == ()
    assert takes(file, TERMINATE) is None


def test_no_request_whatever_it_holds_raises(file: ListFile) -> None:
    for opcode in range(256):
        for fill in (0, 0xFF):
            for begun in (OPEN, CREATE):
                ask(file, begun, NAME)
                payload = bytes((fill, fill, 3, opcode)) + bytes([fill]) * 247
                request: Any = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(payload))
                file.answer(STATION, request, PROGRAM)

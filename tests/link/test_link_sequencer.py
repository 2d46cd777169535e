# SPDX-License-Identifier: GPL-3.0-or-later

"""Each rule at the head of `link/link_sequencer.py`, seen by who counts lost frames at the other end: pymavlink."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v10 import ardupilotmega as v10
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.link_sequencer import NO_STAMP, LinkSequencer
from mavproxy_handover.wire.frames import parse_one
from mavproxy_handover.wire.signing import sign
from sitl.report.loss import Heard, losses

KEY = bytes(range(32))


class Line:
    """What was sent; refuses while `full`."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.full = False

    def __call__(self, data: bytes) -> bool:
        if not self.full:
            self.sent.append(data)
        return not self.full

    def numbers(self, sender: tuple[int, int]) -> list[int]:
        """Of one system and component, in the order in which they were sent."""
        found = [frame for frame in map(parse_one, self.sent) if frame is not None]
        return [frame.seq for frame in found if (frame.sysid, frame.compid) == sender]


class Key:
    """Signs with KEY."""

    def stamp(self) -> int:
        return 5

    def sealed(self, data: bytes, stamp: int) -> bytes | None:
        return sign(data, KEY, 0, stamp)


def packed(message: Any, seq: int, sysid: int = 1, compid: int = 1, dialect: Any = mavlink) -> bytes:
    own = dialect.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    own.seq = seq
    return bytes(message.pack(own))


def attitude(seq: int, sysid: int = 1, compid: int = 1) -> bytes:
    return packed(mavlink.MAVLink_attitude_message(seq, 0.5, 0, 0, 0, 0, 0), seq, sysid, compid)


@pytest.fixture
def line() -> Line:
    return Line()


def test_pymavlink_sees_no_loss_where_frames_were_left_out_and_put_in(line: Line, tmp_path: Path) -> None:
    sequencer = LinkSequencer(line)
    voice = 250
    for seq in range(0, 900, 3):  # two of three are left out
        sequencer.send(attitude(seq & 0xFF))
        if seq % 5 == 0:  # an answer in the autopilot's name, by a counter of its own
            sequencer.send(packed(mavlink.MAVLink_command_ack_message(400, 0), voice & 0xFF))
            voice += 1
    log = io.BytesIO()
    for number, raw in enumerate(line.sent):
        log.write(struct.pack(">Q", 1_800_000_000_000_000 + number) + raw)
    path = tmp_path / "a.tlog"
    path.write_bytes(log.getvalue())
    assert losses(path) == {(1, 1): Heard(heard=360, lost=0)}


def test_every_sender_is_counted_for_itself_and_the_count_goes_round(line: Line) -> None:
    sequencer = LinkSequencer(line)
    senders = ((1, 1), (1, 191), (2, 1), (255, 255), (0, 0))
    for number in range(300):
        for sysid, compid in senders:
            assert sequencer.send(attitude(7 * number & 0xFF, sysid, compid))
    for sender in senders:
        assert line.numbers(sender) == [number & 0xFF for number in range(300)]


def test_what_the_link_did_not_take_leaves_no_hole(line: Line) -> None:
    sequencer = LinkSequencer(line)
    for number in range(12):
        line.full = number % 3 == 1
        assert sequencer.send(attitude(number)) is not line.full
    assert line.numbers((1, 1)) == list(range(8))


def test_a_frame_of_the_old_protocol_and_one_of_an_unknown_message_are_numbered_too(line: Line) -> None:
    sequencer = LinkSequencer(line)
    sequencer.send(attitude(9))
    sequencer.send(packed(v10.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0), 77, dialect=v10))
    unknown = bytes([0xFD, 2, 0, 0, 50, 1, 1, 0x30, 0x75, 0x01, 3, 4, 0xAA, 0xBB])  # id 95536
    sequencer.send(unknown)
    sequencer.send(attitude(9))
    assert line.numbers((1, 1)) == [0, 1, 2, 3]
    assert line.sent[1] == packed(v10.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0), 1, dialect=v10)


def test_a_frame_that_fits_and_everything_but_number_and_crc_stays_as_it_is(line: Line) -> None:
    sequencer = LinkSequencer(line)
    fits, other = attitude(0), attitude(40)
    sequencer.send(fits)
    sequencer.send(other)
    assert line.sent[0] is fits
    assert line.sent[1][5:-2] == other[5:-2]
    assert line.sent[1][:4] == other[:4]


def test_a_signature_that_is_not_ours_to_renew_is_not_broken_and_counting_goes_on_behind_it(line: Line) -> None:
    sequencer = LinkSequencer(line)
    signed = sign(attitude(100), KEY, 3, 1)
    assert signed is not None
    for raw in (attitude(5), signed, attitude(6)):
        assert sequencer.send(raw)
    line.full = True
    assert not sequencer.send(signed)
    line.full = False
    assert sequencer.send(attitude(7))
    assert line.sent[1] == signed
    assert line.numbers((1, 1)) == [0, 100, 101, 102]


def test_what_is_signed_is_numbered_before(line: Line) -> None:
    sequencer = LinkSequencer(line, Key())
    for seq in (30, 40):
        assert sequencer.send(attitude(seq), 5)
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = KEY
    reader.signing.timestamp = 1
    assert [reader.decode(bytearray(raw)).get_seq() for raw in line.sent[:1]] == [0]
    assert line.numbers((1, 1)) == [0, 1]


def test_what_cannot_be_signed_is_not_sent_and_has_no_number(line: Line) -> None:
    sequencer = LinkSequencer(line, Key())
    old = packed(v10.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0), 77, dialect=v10)
    for data, stamp in ((old, 5), (b"no frame", 5), (b"", 5), (attitude(1), NO_STAMP)):
        assert not sequencer.send(data, stamp)
    assert sequencer.send(attitude(1), 5)
    assert line.numbers((1, 1)) == [0]


def test_what_is_no_frame_goes_out_as_it_is_where_nothing_is_signed(line: Line) -> None:
    sequencer = LinkSequencer(line)
    for data in (b"", b"\xfd", b"\xfe\x09", b"telemetry", attitude(1) + b"\0"):
        assert sequencer.send(data)
        assert line.sent[-1] == data

# SPDX-License-Identifier: GPL-3.0-or-later

"""Another sequence number for a frame: what pymavlink makes of it, and that nothing else in it changes."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as old
from pymavlink.dialects.v20 import handover as mavlink
from pymavlink.generator.mavcrc import x25crc

from mavproxy_handover.wire.frames import parse_one
from mavproxy_handover.wire.numbers import number_place, renumber
from mavproxy_handover.wire.signing import sign

NUMBERS = st.integers(0, 255)


def frame(payload: bytes, crc_extra: int, msgid: int, seq: int, version: int) -> bytes:
    """A frame made by hand, as the standard says (https://mavlink.io/en/guide/serialization.html)."""
    if version == 2:
        head = bytes([0xFD, len(payload), 0, 0, seq, 1, 1]) + msgid.to_bytes(3, "little")
    else:
        head = bytes([0xFE, len(payload), seq, 1, 1, msgid & 0xFF])
    crc = x25crc(head[1:] + payload)
    crc.accumulate(bytes([crc_extra]))
    return head + payload + crc.crc.to_bytes(2, "little")


@given(
    payload=st.binary(max_size=255),
    crc_extra=NUMBERS,
    msgid=st.integers(0, 0xFFFFFF),
    before=NUMBERS,
    after=NUMBERS,
    version=st.sampled_from([1, 2]),
)
def test_a_frame_is_the_one_that_would_have_been_made_with_that_number_whatever_its_message(
    payload: bytes, crc_extra: int, msgid: int, before: int, after: int, version: int
) -> None:
    raw = frame(payload, crc_extra, msgid, before, version)
    assert renumber(raw, number_place(raw), after) == frame(payload, crc_extra, msgid, after, version)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("length", range(256))
def test_every_length_has_its_own_correction(length: int, version: int) -> None:
    raw = frame(bytes(length), 77, 5, 0, version)
    for number in (1, 2, 4, 8, 16, 32, 64, 128):  # linear: these say it for all others
        assert renumber(raw, number_place(raw), number) == frame(bytes(length), 77, 5, number, version)


@pytest.mark.parametrize(
    ("dialect", "message"),
    [
        (mavlink, mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)),
        (mavlink, mavlink.MAVLink_statustext_message(4, b"seven", 0, 0)),
        (mavlink, mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [255] * 251)),
        (mavlink, mavlink.MAVLink_authority_status_message(1, 251, 0, 0, 2, 3, 1, 1, 0)),
        (old, old.MAVLink_attitude_message(1, 0.5, 0.25, 0.125, 1.0, 2.0, 3.0)),
    ],
)
def test_pymavlink_reads_it(dialect: Any, message: Any) -> None:
    own = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    own.seq = 200
    raw = bytes(message.pack(own))
    read = dialect.MAVLink(None).decode(bytearray(renumber(raw, number_place(raw), 7)))
    assert (read.get_seq(), read.to_dict()) == (7, message.to_dict())


def test_what_was_damaged_is_damaged_afterwards() -> None:
    raw = bytearray(mavlink.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0).pack(mavlink.MAVLink(None, 1, 1)))
    raw[12] ^= 1
    assert parse_one(renumber(bytes(raw), 4, 9)) is None


def test_the_same_number_changes_nothing() -> None:
    raw = frame(b"abc", 1, 5, 9, 2)
    assert renumber(raw, 4, 9) is raw


WHOLE = frame(b"abc", 1, 5, 9, 2)


@pytest.mark.parametrize(
    ("raw", "place"),
    [
        (WHOLE, 4),
        (sign(WHOLE, bytes(32), 0, 1), 4),
        (frame(b"abc", 1, 5, 9, 1), 2),
        (b"", 0),
        (b"\xfd", 0),
        (b"\xfe", 0),
        (b"telemetry", 0),
        (WHOLE[:-1], 0),
        (WHOLE + b"\0", 0),
        (WHOLE + bytes(13), 0),
        (frame(b"abc", 1, 5, 9, 1)[:-1], 0),
        (frame(b"abc", 1, 5, 9, 1) + b"\0", 0),
        (WHOLE[:2] + b"\2" + WHOLE[3:], 0),
        (WHOLE[:2] + b"\1" + WHOLE[3:], 0),
        (WHOLE[:2] + b"\3" + WHOLE[3:] + bytes(13), 0),
        (b"\xfc" + WHOLE[1:], 0),
    ],
)
def test_only_one_whole_frame_has_a_number(raw: bytes, place: int) -> None:
    assert number_place(raw) == place

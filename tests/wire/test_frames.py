# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames out of byte streams: any cut, any garbage, both versions, nothing that was not checked."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink
from pymavlink.generator.mavcrc import x25crc

from mavproxy_handover.wire.frames import (
    MAX_FRAME_BYTES,
    Frame,
    FrameSplitter,
    field_offset,
    parse_one,
    target,
)

#: HEARTBEAT of a ground station (system 251, component 190, sequence 7), whole, byte by byte.
HEARTBEAT_V2 = bytes.fromhex("fd09000007fbbe000000000000000608c00403")
HEARTBEAT_V1 = bytes.fromhex("fe0907fbbe00000000000608c00403")


def raw_frame(
    msgid: int,
    payload: bytes,
    *,
    version: int = 2,
    sysid: int = 251,
    compid: int = 190,
    seq: int = 0,
    flags: int = 0,
    crc_extra: int | None = None,
) -> bytes:
    """A frame made by hand, CRC included."""
    if version == 1:
        head = bytes([0xFE, len(payload), seq, sysid, compid, msgid])
    else:
        head = bytes([0xFD, len(payload), flags, 0, seq, sysid, compid]) + msgid.to_bytes(3, "little")
    if crc_extra is None:
        crc_extra = mavlink.mavlink_map[msgid].crc_extra
    body = head + payload
    crc = x25crc(body[1:] + bytes([crc_extra])).crc.to_bytes(2, "little")
    signature = bytes(range(13)) if flags & 1 and version == 2 else b""
    return body + crc + signature


def with_crc(body: bytes, crc_extra: int) -> bytes:
    return body + x25crc(body[1:] + bytes([crc_extra])).crc.to_bytes(2, "little")


def test_a_version_2_frame_is_read_field_by_field() -> None:
    raw = with_crc(HEARTBEAT_V2, 50)
    splitter = FrameSplitter()
    assert splitter.feed(raw) == [
        Frame(
            raw=raw,
            version=2,
            msgid=0,
            sysid=251,
            compid=190,
            seq=7,
            signed=False,
            payload=bytes.fromhex("000000000608c00403"),
            known=True,
        )
    ]
    assert (splitter.counters.frames, splitter.counters.garbage_bytes) == (1, 0)


def test_a_version_1_frame_is_read_field_by_field() -> None:
    raw = with_crc(HEARTBEAT_V1, 50)
    assert FrameSplitter().feed(raw) == [
        Frame(raw, 1, 0, 251, 190, 7, False, bytes.fromhex("000000000608c00403"), True)
    ]


def test_a_signed_frame_is_whole_and_says_so() -> None:
    raw = raw_frame(0, bytes(9), flags=1)
    assert len(raw) == 10 + 9 + 2 + 13
    (frame,) = FrameSplitter().feed(raw)
    assert frame.signed
    assert frame.raw == raw


def test_pymavlink_reads_what_this_module_reads() -> None:
    """Every message of the dialect, packed by pymavlink with zeros at its end left out."""
    sender = mavlink.MAVLink(None, srcSystem=251, srcComponent=190)
    receiver = mavlink.MAVLink(None)
    for msgid, cls in mavlink.mavlink_map.items():
        message = receiver.decode(bytearray(raw_frame(msgid, bytes(cls.unpacker.size))))
        has_system = "target_system" in cls.fieldnames
        has_component = "target_component" in cls.fieldnames
        if has_system:
            message.target_system = 77
        if has_component:
            message.target_component = 88
        if cls.msgname == "MANUAL_CONTROL":
            message.target = 77
            has_system = True
        raw = message.pack(sender)
        (frame,) = FrameSplitter().feed(raw)
        assert (frame.msgid, frame.sysid, frame.compid, frame.raw) == (msgid, 251, 190, raw), cls.msgname
        assert len(frame.payload) == cls.unpacker.size, cls.msgname
        expected = (77, 88 if has_component else 0) if has_system else None
        assert target(frame) == expected, cls.msgname
        assert parse_one(raw) == frame, cls.msgname


def test_offsets_are_those_of_the_wire_not_of_the_definition() -> None:
    """MAVLink sorts fields by size; the command of a COMMAND_LONG comes behind seven floats."""
    assert field_offset(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, "command") == 28
    assert field_offset(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, "target_system") == 30
    assert field_offset(mavlink.MAVLINK_MSG_ID_TUNNEL, "payload_type") == 0
    assert field_offset(mavlink.MAVLINK_MSG_ID_MISSION_CHUNK, "data") == 11
    with pytest.raises(KeyError):
        field_offset(mavlink.MAVLINK_MSG_ID_HEARTBEAT, "command")


def test_zeros_left_out_at_the_end_are_there_again() -> None:
    (frame,) = FrameSplitter().feed(raw_frame(76, b"\x01"))
    assert frame.payload == b"\x01" + bytes(32)
    assert target(frame) == (0, 0)


def test_fields_newer_than_our_definition_are_left_out_of_the_payload_but_not_of_the_frame() -> None:
    raw = raw_frame(0, bytes(range(9)) + b"newer")
    (frame,) = FrameSplitter().feed(raw)
    assert frame.payload == bytes(range(9))
    assert frame.raw == raw


def test_a_version_1_frame_longer_than_its_message_is_none() -> None:
    longer, right = (raw_frame(0, bytes(length), version=1) for length in (10, 9))
    splitter = FrameSplitter()
    assert [f.raw for f in splitter.feed(longer + right)] == [right]
    assert splitter.counters.garbage_bytes == len(longer)
    assert parse_one(longer) is None


@pytest.mark.parametrize("cut", range(7))
def test_a_stray_version_1_magic_byte_does_not_hold_up_the_frame_behind_it(cut: int) -> None:
    """Read as a head it is a HEARTBEAT of 255 bytes: the frame behind it does not wait for them."""
    frame = raw_frame(0, bytes(9))
    stream = b"\xfe\xff\x00\x00\x00\x00" + frame
    splitter = FrameSplitter()
    frames = [*splitter.feed(stream[:cut]), *splitter.feed(stream[cut:])]
    assert [f.raw for f in frames] == [frame]


def test_a_frame_with_a_bad_crc_costs_only_itself() -> None:
    before, damaged, after = (raw_frame(0, bytes([1] * 9), seq=n) for n in range(3))
    for position in range(len(damaged)):
        if position < 10:
            continue  # the header decides how long the frame is; tested below
        broken = bytearray(damaged)
        broken[position] ^= 0x01
        splitter = FrameSplitter()
        assert [f.seq for f in splitter.feed(before + broken + after)] == [0, 2], position
        assert splitter.counters.bad_crc == 1
        assert splitter.counters.garbage_bytes == len(damaged)


def test_a_wrong_length_does_not_swallow_the_frames_behind_it() -> None:
    damaged = bytearray(raw_frame(0, bytes(9), seq=0))
    damaged[1] = 30
    followers = [raw_frame(0, bytes(9), seq=n) for n in (1, 2, 3)]
    assert [f.seq for f in FrameSplitter().feed(bytes(damaged) + b"".join(followers))] == [1, 2, 3]


def test_a_frame_inside_a_damaged_one_is_found() -> None:
    inner = raw_frame(0, bytes(9), seq=5)
    assert [f.seq for f in FrameSplitter().feed(raw_frame(76, inner, crc_extra=0))] == [5]


def test_a_stray_magic_byte_does_not_swallow_the_frame_behind_it() -> None:
    """The three stray bytes read as the head of a frame of an unknown id, with a length that covers the next."""
    for seq in range(256):
        frame = raw_frame(0, bytes(9), seq=seq)
        assert [f.seq for f in FrameSplitter().feed(b"\xfd\x00\x00" + frame + bytes(MAX_FRAME_BYTES))] == [seq]


def test_a_stray_magic_byte_swallows_nothing_when_the_cut_falls_behind_its_length() -> None:
    stream = b"\xfd\x00\x00" + raw_frame(0, bytes(9), seq=5)
    splitter = FrameSplitter()
    assert splitter.feed(stream[:12]) == []
    assert [f.seq for f in splitter.feed(stream[12:])] == [5]


def test_unknown_ids_are_skipped_by_length_and_counted() -> None:
    unknown = raw_frame(47199, b"\xfd" * 20, crc_extra=1)
    splitter = FrameSplitter()
    frames = splitter.feed(unknown + raw_frame(0, bytes(9), seq=9))
    assert [f.seq for f in frames] == [9]
    assert (splitter.counters.unknown_id, splitter.counters.garbage_bytes) == (1, 0)


def test_all_three_bytes_of_an_id_count() -> None:
    """Read by two bytes, 0x010000 would be a HEARTBEAT."""
    raw = raw_frame(0x010000, bytes(9), crc_extra=mavlink.mavlink_map[0].crc_extra)
    assert FrameSplitter().feed(raw + raw_frame(0, bytes(9)))[0].raw != raw
    frame = parse_one(raw)
    assert frame is not None
    assert (frame.msgid, frame.known) == (0x010000, False)


def test_flags_we_do_not_understand_drop_the_frame() -> None:
    strange = raw_frame(0, bytes(9), flags=2, seq=1)
    splitter = FrameSplitter()
    assert [f.seq for f in splitter.feed(strange + raw_frame(0, bytes(9), seq=9))] == [9]
    assert splitter.counters.bad_flags == 1
    assert splitter.counters.garbage_bytes == len(strange)
    assert parse_one(strange) is None


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"\xfd",
        b"\xfe\x00",
        bytes(20),
        raw_frame(0, bytes(9)) + b"\x00",
        raw_frame(0, bytes(9)) * 2,
        raw_frame(0, bytes(9))[:-1],
        raw_frame(0, bytes(9))[1:],
        raw_frame(0, bytes(9), crc_extra=51),
        raw_frame(0, bytes(9), version=1, crc_extra=51),
    ],
)
def test_parse_one_takes_exactly_one_whole_checked_frame(raw: bytes) -> None:
    assert parse_one(raw) is None


def test_parse_one_returns_unknown_ids_unchecked_and_says_so() -> None:
    frame = parse_one(raw_frame(47199, b"\x00\x01\x02\x00", crc_extra=1))
    assert frame is not None
    assert (frame.known, frame.msgid, frame.sysid, frame.payload) == (False, 47199, 251, b"\x00\x01\x02\x00")
    assert target(frame) is None


def test_parse_one_takes_mavproxys_bytearray_and_keeps_bytes() -> None:
    frame = parse_one(bytearray(raw_frame(0, bytes(9))))
    assert frame is not None
    assert type(frame.raw) is bytes


def test_one_feed_looks_at_no_more_than_max_buffer() -> None:
    raw = raw_frame(0, bytes(9))
    splitter = FrameSplitter(max_buffer=MAX_FRAME_BYTES)
    assert MAX_FRAME_BYTES == 280
    frames = splitter.feed(raw * 20)
    assert len(frames) == 280 // len(raw)
    assert splitter.counters.overflow_bytes == 20 * len(raw) - 280
    with pytest.raises(ValueError, match="max_buffer = 279"):
        FrameSplitter(max_buffer=279)


SAMPLES = [
    raw_frame(0, bytes(9), seq=1),
    raw_frame(0, bytes(9), version=1, seq=2),
    raw_frame(76, bytes(range(1, 34)), seq=3),
    raw_frame(76, bytes(range(33)), version=1, seq=4),
    raw_frame(47113, b"\xfd\xfe\xfd", seq=5),
    raw_frame(110, b"\xfd" * 254, flags=1, seq=6),
    raw_frame(385, b"\xfe" * 133, flags=1, seq=7),
]
GARBAGE = st.binary(max_size=30).map(lambda b: b.replace(b"\xfd", b"").replace(b"\xfe", b""))


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


@given(st.lists(st.tuples(st.sampled_from(SAMPLES), GARBAGE)), st.lists(st.integers(0, 5000)))
def test_any_cut_of_a_valid_stream_gives_the_same_frames(parts: list[tuple[bytes, bytes]], cuts: list[int]) -> None:
    stream = b"".join(garbage + sample for sample, garbage in parts)
    splitter = FrameSplitter()
    frames = [frame for piece in pieces(stream, cuts) for frame in splitter.feed(piece)]
    assert [frame.raw for frame in frames] == [sample for sample, _ in parts]
    assert splitter.counters.frames == len(parts)
    assert splitter.counters.garbage_bytes == sum(len(garbage) for _, garbage in parts)


def in_pieces(data: bytes, cuts: list[int]) -> tuple[list[bytes], object, int]:
    splitter = FrameSplitter()
    frames = [frame for piece in pieces(data, cuts) for frame in splitter.feed(piece)]
    return [frame.raw for frame in frames], splitter.counters, len(splitter._rest)


NOISE = st.lists(
    st.one_of(st.binary(max_size=20), st.sampled_from(SAMPLES), st.sampled_from([b"\xfd", b"\xfe", b"\xfd\xff\x00"]))
).map(b"".join)


@pytest.mark.slow
@settings(max_examples=300)
@given(NOISE, st.lists(st.integers(0, 5000)))
def test_garbage_never_raises_and_any_cut_of_it_gives_the_same(data: bytes, cuts: list[int]) -> None:
    whole = in_pieces(data, [])
    assert in_pieces(data, cuts) == whole
    frames, _, waiting = whole
    assert waiting <= MAX_FRAME_BYTES
    for raw in frames:
        assert parse_one(raw) is not None


# ---- frames that begin and do not end -----------------------------------------------------------------------------

DEAF_S = 0.3
TICK_S = 0.05
STREAM = st.lists(st.one_of(st.binary(max_size=20), st.sampled_from([b"\xfd", b"\xfe", b"\xfd\xff\x00"]))).map(b"".join)


def heard(noise: bytes, beats_at: list[float], cuts: list[int]) -> dict[int, float]:
    """When each heartbeat was found, by its place in `beats_at`, the times at which it came. The noise came at 0.

    The splitter is asked in every tick as well, as by the companion.
    """
    splitter = FrameSplitter()
    for piece in pieces(noise, cuts):
        splitter.feed(piece, 0.0)
    arrivals = [(at, raw_frame(0, bytes(9), seq=number)) for number, at in enumerate(beats_at)]
    ticks = [(tick * TICK_S, b"") for tick in range(1, 400)]
    found = {}
    for at, data in sorted(arrivals + ticks):
        for frame in splitter.feed(data, at):
            if (frame.sysid, frame.msgid, frame.payload) == (251, 0, bytes(9)):
                found[frame.seq] = at
    assert splitter.waiting == 0
    return found


@pytest.mark.parametrize("noise", [b"\xfd\xff\x00", b"\xfe", b"\xfd", b"\xfe\xff", b"\xfd\xff\x00" * 90, b"\xfd" * 279])
def test_noise_makes_nobody_deaf_for_longer_than_heartbeats_stay_away(noise: bytes) -> None:
    beats_at = [0.01, 1.01, 2.01, 3.01]
    found = heard(noise, beats_at, [])
    assert set(found) == {0, 1, 2, 3}
    assert found[0] <= DEAF_S
    assert [found[number] for number in (1, 2, 3)] == [1.01, 2.01, 3.01]


def test_a_damaged_length_costs_its_frame_and_delays_the_next_by_no_more_than_that() -> None:
    damaged = bytearray(raw_frame(0, bytes(9), seq=99))
    damaged[1] = 255
    assert heard(bytes(damaged), [0.2, 0.28, 0.5, 1.5], []) == {
        0: pytest.approx(0.25),
        1: pytest.approx(0.28),
        2: 0.5,
        3: 1.5,
    }


@pytest.mark.slow
@settings(max_examples=300)
@given(STREAM, st.lists(st.integers(0, 5000)), st.floats(0.3, 1.0))
def test_after_any_noise_the_next_frame_is_found(noise: bytes, cuts: list[int], pause_s: float) -> None:
    """After a silence, and behind heartbeats that came with the noise."""
    assert heard(noise, [pause_s], cuts) == {0: pause_s}
    found = heard(noise, [0.02, pause_s, pause_s + 0.4], cuts)
    assert (found[1], found[2]) == (pause_s, pause_s + 0.4)


@pytest.mark.slow
@settings(max_examples=300)
@given(STREAM, st.lists(st.integers(0, 5000)))
def test_in_time_any_cut_without_pauses_gives_what_it_gives_without_time(data: bytes, cuts: list[int]) -> None:
    stream = data + SAMPLES[2] + data
    splitter = FrameSplitter()
    parts = pieces(stream, cuts)
    frames = [frame.raw for n, piece in enumerate(parts) for frame in splitter.feed(piece, 0.2 * n / len(parts))]
    expected, counters, waiting = in_pieces(stream, [])
    assert (frames, splitter.counters, splitter.waiting) == (expected, counters, waiting)


@pytest.mark.parametrize("sample", SAMPLES, ids=range(len(SAMPLES)))
def test_a_frame_as_slow_as_a_line_of_57600_baud_is_whole(sample: bytes) -> None:
    """However it is cut, with the noise of a moment before still there."""
    byte_s = 10 / 57600
    splitter = FrameSplitter()
    splitter.feed(b"\xfd\xff\x00", 10.0 - 0.2)
    stream = [(10.0 + n * byte_s, bytes([byte])) for n, byte in enumerate(sample)]
    ticks = [(10.0 - 0.2 + n * TICK_S, b"") for n in range(1, 20)]
    found = [frame.raw for at, data in sorted(stream + ticks) for frame in splitter.feed(data, at)]
    assert found == [sample]


def test_a_reader_that_was_late_loses_nothing() -> None:
    """The rest of a frame waited in the system: it counts before the frame is given up."""
    splitter = FrameSplitter()
    raw = raw_frame(76, bytes(range(1, 34)))
    assert splitter.feed(raw[:15], 1.0) == []
    assert [frame.raw for frame in splitter.feed(raw[15:] + raw, 9.0)] == [raw, raw]


def test_patience_is_as_long_as_it_is_said_to_be() -> None:
    splitter = FrameSplitter(patience_s=2.0)
    splitter.feed(b"\xfd\xff\x00", 0.0)
    beat = raw_frame(0, bytes(9))
    assert splitter.feed(beat, 1.0) == []
    assert splitter.feed(b"", 1.99) == []
    assert [frame.raw for frame in splitter.feed(b"", 2.0)] == [beat]


def test_what_is_kept_of_the_times_is_no_more_than_what_is_kept() -> None:
    splitter = FrameSplitter(patience_s=1e9)
    for tick in range(10_000):
        splitter.feed(b"\xfd" if tick % 40 == 0 else b"", tick * TICK_S)
    assert len(splitter._arrived) <= splitter.waiting <= MAX_FRAME_BYTES


@given(st.binary(max_size=300))
def test_parse_one_never_raises(data: bytes) -> None:
    for candidate in (data, b"\xfd" + data, b"\xfe" + data):
        frame = parse_one(candidate)
        assert frame is None or frame.raw == candidate


@pytest.mark.parametrize("version", [1, 2])
def test_parse_one_believes_that_a_crc_was_checked_and_nothing_else(version: int) -> None:
    raw = raw_frame(0, bytes(9), version=version)
    assert parse_one(raw, proven=True) == parse_one(raw) is not None
    wrong = raw_frame(0, bytes(9), version=version, crc_extra=51)
    frame = parse_one(wrong, proven=True)
    assert frame is not None
    assert frame.raw == wrong
    assert parse_one(raw[:-1], proven=True) is None
    assert parse_one(raw + b"\x00", proven=True) is None

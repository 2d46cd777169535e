# SPDX-License-Identifier: GPL-3.0-or-later

"""Signatures: the same as everybody else's, no frame taken twice, nobody silenced, and no clock that must be right."""

from __future__ import annotations

import hashlib
import random
from bisect import bisect_right
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, FrameSplitter, parse_one
from mavproxy_handover.wire.signing import (
    MAX_TIMESTAMP,
    SignatureVerdict,
    SignedPeer,
    SigningClock,
    Verifier,
    fingerprint,
    resign,
    sign,
    timestamp_of,
    unsign,
)

OK = SignatureVerdict.OK
UNSIGNED = SignatureVerdict.UNSIGNED
BAD = SignatureVerdict.BAD
REPLAYED = SignatureVerdict.REPLAYED
TOO_OLD = SignatureVerdict.TOO_OLD
TOO_MANY_STREAMS = SignatureVerdict.TOO_MANY_STREAMS

#: SHA-256 of "correct-horse-battery-staple"
KEY = bytes.fromhex("87cbebfeebc05f7c54ac9336c4b4bbec831227a641951a4bde7edd56020f8590")
OTHER_KEY = bytes(range(32))
#: 2026-11-20 00:00 UTC
MIDNIGHT_UTC_S = 1_795_132_800.0
MIDNIGHT = 37_506_240_000_000
SECOND = 100_000

#: frame without signature, link id, stamp, and the same frame as pymavlink 2.4.50 signs it with KEY
VECTORS = [
    pytest.param(
        "fd09000007fbbe000000000000000608000403c7d2",
        3,
        0x0123456789AB,
        "fd09010007fbbe000000000000000608000403202a03ab8967452301ce0d288f03f1",
        id="HEARTBEAT",
    ),
    pytest.param(
        "fd200000fffcbe4c00000000803f0000000000000000000000000000000000000000000000009001010135e6",
        0,
        37_587_456_000_000,
        "fd200100fffcbe4c00000000803f00000000000000000000000000000000000000000000000090010101e2780"
        "00080f6822f2258f91a28ccea",
        id="COMMAND_LONG",
    ),
    pytest.param(
        "fd8500000001bf8101000cb8010180" + "ff" * 128 + "3d50",
        255,
        MAX_TIMESTAMP,
        "fd8501000001bf8101000cb8010180" + "ff" * 128 + "3930" + "ff" * 7 + "f423a175ec11",
        id="TUNNEL, every field at its end",
    ),
]


def heartbeat(
    stamp: int, *, key: bytes = KEY, sysid: int = 251, compid: int = 190, link: int = 0, seq: int = 0
) -> Frame:
    """A signed HEARTBEAT of a station."""
    own = mavlink.MAVLink(None, sysid, compid)
    own.seq = seq
    plain = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(own)
    return parsed(sign(plain, key, link, stamp))


def parsed(raw: bytes | None) -> Frame:
    assert raw is not None
    frame = parse_one(raw)
    assert frame is not None
    return frame


def stock_program(sysid: int = 251, *, key: bytes = KEY, stamp: int = MIDNIGHT, link: int = 0) -> Any:
    """A ground station program that signs as pymavlink does: +1 for each frame, and follows what it is sent."""
    program = mavlink.MAVLink(None, sysid, 190)
    program.signing.secret_key = key
    program.signing.sign_outgoing = True
    program.signing.link_id = link
    program.signing.timestamp = stamp
    return program


def sent_by(program: Any) -> Frame:
    return parsed(bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(program)))


def vehicle_heartbeat() -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(mavlink.MAVLink(None, 1, 1)))


# ---- stamps -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("utc_s", "stamp"),
    [
        (1_420_070_400.0, 0),
        (1_420_070_401.0, 100_000),
        (1_420_070_400.000_01, 1),
        (MIDNIGHT_UTC_S, MIDNIGHT),
        (0.0, 0),
        (-5.0, 0),
        (7_258_118_400.0, MAX_TIMESTAMP),  # the year 2200
        (float("inf"), MAX_TIMESTAMP),
        (float("nan"), 0),
    ],
)
def test_a_stamp_counts_ten_microseconds_since_2015_and_stays_in_48_bits(utc_s: float, stamp: int) -> None:
    assert timestamp_of(utc_s) == stamp


# ---- signing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("plain", "link", "stamp", "signed"), VECTORS)
def test_a_frame_is_signed_as_pymavlink_signs_it(plain: str, link: int, stamp: int, signed: str) -> None:
    assert sign(bytes.fromhex(plain), KEY, link, stamp) == bytes.fromhex(signed)


@pytest.mark.parametrize(("plain", "link", "stamp", "signed"), VECTORS)
def test_the_signature_of_another_key_is_replaced_by_ours(plain: str, link: int, stamp: int, signed: str) -> None:
    theirs = sign(bytes.fromhex(plain), OTHER_KEY, 77, 12345)
    assert theirs is not None
    assert resign(theirs, KEY, link, stamp) == bytes.fromhex(signed)
    assert resign(bytes.fromhex(plain), KEY, link, stamp) == bytes.fromhex(signed)


@pytest.mark.parametrize(("plain", "link", "stamp", "signed"), VECTORS)
def test_without_its_signature_a_frame_is_what_it_was_before(plain: str, link: int, stamp: int, signed: str) -> None:
    assert unsign(bytes.fromhex(signed)) == bytes.fromhex(plain)
    assert unsign(bytes.fromhex(plain)) == bytes.fromhex(plain)


@pytest.mark.parametrize(("plain", "link", "stamp", "signed"), VECTORS)
def test_what_pymavlink_signed_is_good(plain: str, link: int, stamp: int, signed: str) -> None:
    assert Verifier(KEY).check(parsed(bytes.fromhex(signed)), MIDNIGHT_UTC_S - 1e9, 0.0) is OK


def test_pymavlink_accepts_every_message_that_we_sign_and_only_the_signature_is_new() -> None:
    source = random.Random(3)
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = KEY
    for count, (msgid, definition) in enumerate(sorted(mavlink.mavlink_map.items())):
        own = mavlink.MAVLink(None, 251, 190)
        own.seq = count & 0xFF
        payload = source.randbytes(definition.unpacker.size)
        message = mavlink.MAVLink_message(msgid, definition.msgname)
        plain = bytes(message._pack(own, definition.crc_extra, payload))
        frame = parsed(sign(plain, KEY, 7, MIDNIGHT + count))
        before = parsed(plain)
        assert frame == before._replace(raw=frame.raw, signed=True), msgid
        assert (len(frame.raw), frame.raw[2]) == (len(plain) + 13, 1)
        assert reader.check_signature(bytearray(frame.raw), 251, 190), msgid


def test_pymavlink_decodes_what_we_sign() -> None:
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = KEY
    signed = sign(vehicle_heartbeat(), KEY, 7, MIDNIGHT)
    assert signed is not None
    message = reader.decode(bytearray(signed))
    assert (message.get_type(), message.get_srcSystem(), message.get_signed()) == ("HEARTBEAT", 1, True)


def test_a_frame_of_an_unknown_message_can_be_signed() -> None:
    raw = bytes.fromhex("fd0200000701bfbeba01aabb1234")
    signed = sign(raw, KEY, 1, MIDNIGHT)
    assert signed is not None
    assert (signed[:2], signed[2], signed[3:12]) == (raw[:2], 1, raw[3:12])
    assert unsign(signed) == raw


@pytest.mark.parametrize("length", [0, 1, 9, 128, 254, 255])
def test_a_frame_damaged_before_it_was_signed_is_not_made_whole(length: int) -> None:
    own = mavlink.MAVLink(None, 1, 1)
    message = mavlink.MAVLink_message(mavlink.MAVLINK_MSG_ID_TUNNEL, "TUNNEL")
    good = bytes(message._pack(own, mavlink.MAVLink_tunnel_message.crc_extra, b"\x55" * length))
    damaged = good[:-1] + bytes([good[-1] ^ 0x20])
    assert parse_one(sign(good, KEY, 0, MIDNIGHT) or b"") is not None
    assert parse_one(sign(damaged, KEY, 0, MIDNIGHT) or b"") is None


@pytest.mark.parametrize(
    ("raw", "why"),
    [
        (mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 251), True), "MAVLink 1"),
        (vehicle_heartbeat()[:-1], "cut"),
        (vehicle_heartbeat() + b"\0", "more than a frame"),
        (vehicle_heartbeat()[:2] + b"\2" + vehicle_heartbeat()[3:], "a flag that we do not know"),
        (vehicle_heartbeat()[:2] + b"\2" + vehicle_heartbeat()[3:] + bytes(13), "and as if it were signed"),
        (heartbeat(MIDNIGHT).raw[:2] + b"\3" + heartbeat(MIDNIGHT).raw[3:], "that flag beside the signature's"),
        (b"\xfd", "a magic byte"),
        (b"", "nothing"),
    ],
)
def test_what_is_not_one_whole_mavlink_2_frame_is_not_signed(raw: bytes, why: str) -> None:
    assert sign(raw, KEY, 0, MIDNIGHT) is None, why
    assert resign(raw, KEY, 0, MIDNIGHT) is None, why
    assert unsign(raw) == raw, why


def test_compatibility_flags_are_nobodys_business() -> None:
    raw = vehicle_heartbeat()
    signed = sign(raw[:3] + b"\7" + raw[4:], KEY, 0, MIDNIGHT)
    assert signed is not None
    assert signed[2:4] == b"\1\7"


def test_sign_leaves_a_signature_alone_that_is_there_already() -> None:
    assert sign(heartbeat(MIDNIGHT).raw, OTHER_KEY, 0, MIDNIGHT) is None


@given(st.binary(max_size=300))
def test_no_bytes_make_signing_raise(raw: bytes) -> None:
    for candidate in (raw, b"\xfd" + raw, b"\xfe" + raw):
        signed = resign(candidate, KEY, 0, MIDNIGHT)
        assert signed is None or unsign(signed) == unsign(candidate)
        sign(candidate, KEY, 0, MIDNIGHT)


@pytest.mark.parametrize("key", [b"", KEY[:-1], KEY + b"\0"])
def test_a_key_has_32_bytes(key: bytes) -> None:
    for use in (lambda: Verifier(key), lambda: SignedPeer(key), lambda: SignedPeer(KEY, key)):
        with pytest.raises(ValueError, match="a signing key has 32 bytes, not "):
            use()


def test_a_fingerprint_names_a_key_and_is_no_part_of_it() -> None:
    assert fingerprint(KEY) == hashlib.sha256(b"handover key fingerprint" + KEY).hexdigest()[:16]
    assert fingerprint(KEY) != fingerprint(OTHER_KEY)
    assert fingerprint(KEY) not in KEY.hex()
    assert fingerprint(KEY) not in hashlib.sha256(KEY).hexdigest()


# ---- where stamps come from ---------------------------------------------------------------------------------------


def stamp_in(raw: bytes | None) -> int:
    assert raw is not None
    return int.from_bytes(raw[-12:-6], "little")


def test_stamps_rise_when_many_frames_are_signed_at_once() -> None:
    peer = SignedPeer(KEY)
    stamps = [stamp_in(peer.sign(vehicle_heartbeat(), 4, MIDNIGHT_UTC_S, 10.0)) for _ in range(3)]
    assert stamps == [MIDNIGHT, MIDNIGHT + 1, MIDNIGHT + 2]


def test_a_signature_names_its_link_and_replaces_another_one() -> None:
    signed = SignedPeer(KEY).sign(heartbeat(MIDNIGHT, key=OTHER_KEY, link=9).raw, 4, MIDNIGHT_UTC_S, 10.0)
    assert signed == heartbeat(MIDNIGHT, link=4).raw


def test_stamps_follow_the_wall_clock_forward() -> None:
    clock = SigningClock()
    assert clock.next(0.0, 10.0) == 1
    assert clock.next(MIDNIGHT_UTC_S, 11.0) == MIDNIGHT
    assert clock.next(MIDNIGHT_UTC_S + 3600, 12.0) == MIDNIGHT + 3600 * SECOND


def test_stamps_neither_fall_nor_stand_still_when_the_wall_clock_is_set_back() -> None:
    clock = SigningClock()
    assert clock.next(MIDNIGHT_UTC_S, 10.0) == MIDNIGHT
    assert clock.next(MIDNIGHT_UTC_S - 3600, 10.0) == MIDNIGHT + 1
    assert clock.next(MIDNIGHT_UTC_S - 3599, 11.0) == MIDNIGHT + 1 * SECOND
    assert clock.next(MIDNIGHT_UTC_S - 3000, 610.0) == MIDNIGHT + 600 * SECOND
    assert clock.next(MIDNIGHT_UTC_S + 601, 611.0) == MIDNIGHT + 601 * SECOND


def test_stamps_follow_the_newest_stamp_of_the_other_end_and_keep_pace_from_there() -> None:
    clock = SigningClock()
    clock.follow(MIDNIGHT, 5.0)
    assert clock.next(0.0, 5.0) == MIDNIGHT
    assert clock.next(0.0, 6.0) == MIDNIGHT + 1 * SECOND
    clock.follow(MIDNIGHT + 1 * SECOND + 1, 7.0)  # newer than where we began, older than where we are
    assert clock.next(0.0, 7.0) == MIDNIGHT + 2 * SECOND
    assert clock.next(0.0, 8.0) == MIDNIGHT + 3 * SECOND


def test_stamps_from_before_a_restart_are_gone_on_from_at_the_pace_of_time() -> None:
    clock = SigningClock()
    clock.follow(MIDNIGHT)
    assert clock.next(0.0, 500.0) == MIDNIGHT
    assert clock.next(0.0, 501.0) == MIDNIGHT + SECOND


def test_stamps_of_all_links_of_a_key_rise_together() -> None:
    peer, wifi, lte = SignedPeer(KEY), 0, 1
    stamps = [stamp_in(peer.sign(vehicle_heartbeat(), link, MIDNIGHT_UTC_S, 0.0)) for link in (wifi, lte, wifi)]
    assert stamps == [MIDNIGHT, MIDNIGHT + 1, MIDNIGHT + 2]


def test_when_48_bits_are_used_up_nothing_is_signed_rather_than_signed_wrongly() -> None:
    peer = SignedPeer(KEY)
    peer.clock.follow(MAX_TIMESTAMP, 0.0)
    assert stamp_in(peer.sign(vehicle_heartbeat(), 0, 0.0, 0.0)) == MAX_TIMESTAMP
    assert peer.sign(vehicle_heartbeat(), 0, 0.0, 0.0) is None
    assert peer.sign(vehicle_heartbeat(), 0, 0.0, 1.0) is None


# ---- the hash -----------------------------------------------------------------------------------------------------


def test_a_frame_without_signature_is_unsigned_and_so_is_mavlink_1() -> None:
    verifier = Verifier(KEY)
    message = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for mavlink1 in (False, True):
        frame = parsed(bytes(message.pack(mavlink.MAVLink(None, 251, 190), mavlink1)))
        assert verifier.check(frame, MIDNIGHT_UTC_S, 0.0) is UNSIGNED


def test_a_frame_signed_with_another_key_is_bad() -> None:
    assert Verifier(KEY).check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0) is BAD


def test_a_change_of_any_bit_is_noticed() -> None:
    good = heartbeat(MIDNIGHT)
    verifier = Verifier(KEY)
    for position in range(len(good.raw)):
        for bit in range(8):
            raw = bytearray(good.raw)
            raw[position] ^= 1 << bit
            assert verifier.check(good._replace(raw=bytes(raw)), MIDNIGHT_UTC_S, 0.0) is BAD, (position, bit)
    assert verifier.check(good, MIDNIGHT_UTC_S, 0.0) is OK


def test_a_forged_stamp_from_the_far_future_silences_nobody() -> None:
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is OK
    forged = heartbeat(MIDNIGHT + 10**12)
    forged = forged._replace(raw=forged.raw[:-1] + bytes([forged.raw[-1] ^ 1]))
    assert verifier.check(forged, MIDNIGHT_UTC_S, 0.1) is BAD
    assert verifier.check(heartbeat(MIDNIGHT + 1), MIDNIGHT_UTC_S, 0.2) is OK
    assert (
        verifier.check(heartbeat(MIDNIGHT + 2, compid=191), MIDNIGHT_UTC_S, 0.3) is OK
    )  # nor the first frame of another
    assert verifier.newest == MIDNIGHT + 2


def test_a_forged_first_frame_takes_no_place_in_the_table() -> None:
    verifier = Verifier(KEY, max_streams=1)
    for link in range(256):
        assert verifier.check(heartbeat(MIDNIGHT, key=OTHER_KEY, link=link), MIDNIGHT_UTC_S, 0.0) is BAD
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is OK


@given(st.lists(st.binary(max_size=80), max_size=20), st.integers(0, 200))
def test_no_bytes_make_checking_raise_and_none_are_good(pieces: list[bytes], cut: int) -> None:
    stream = b"".join(pieces) + heartbeat(MIDNIGHT, key=OTHER_KEY).raw + b"".join(pieces)
    splitter, peer = FrameSplitter(), SignedPeer(KEY, bytes(32))
    frames = splitter.feed(stream[:cut]) + splitter.feed(stream[cut:])
    frames += [frame for frame in map(parse_one, pieces) if frame is not None]
    assert all(peer.check(frame, MIDNIGHT_UTC_S, 0.0) in (UNSIGNED, BAD) for frame in frames)


# ---- replays ------------------------------------------------------------------------------------------------------


def test_the_same_frame_again_and_an_older_one_are_replays() -> None:
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT + 5), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 5), MIDNIGHT_UTC_S, 0.0) is REPLAYED
    assert verifier.check(heartbeat(MIDNIGHT + 5, seq=9), MIDNIGHT_UTC_S, 0.0) is REPLAYED
    assert verifier.check(heartbeat(MIDNIGHT + 5 - 2 * SECOND), MIDNIGHT_UTC_S, 0.0) is REPLAYED
    assert verifier.check(heartbeat(MIDNIGHT + 6), MIDNIGHT_UTC_S, 0.0) is OK


def test_a_frame_that_younger_ones_overtook_on_another_link_is_taken_once() -> None:
    """A router sends one stream over Wi-Fi, which loses the first, and LTE, which is late."""
    verifier = Verifier(KEY)
    lost, *others = (heartbeat(MIDNIGHT + number) for number in range(5))
    assert {verifier.check(frame, MIDNIGHT_UTC_S, 0.0) for frame in others} == {OK}
    assert verifier.check(lost, MIDNIGHT_UTC_S, 0.4) is OK
    assert {verifier.check(frame, MIDNIGHT_UTC_S, 0.4) for frame in (lost, *others)} == {REPLAYED}


@pytest.mark.parametrize("rate_hz", [0.4, 1.0, 7.0, 50.0])
def test_what_was_overtaken_is_taken_for_two_seconds_and_hardly_longer(rate_hz: float) -> None:
    for late_s, verdict in ((1.9, OK), (2.6, REPLAYED)):
        verifier = Verifier(KEY)
        for number in range(int(20 * rate_hz)):
            at = number / rate_hz
            assert verifier.check(heartbeat(MIDNIGHT + int(at * SECOND)), MIDNIGHT_UTC_S + at, at) is OK
        at += late_s
        overtaken = heartbeat(MIDNIGHT + int((at - late_s) * SECOND) - 1)
        assert verifier.check(overtaken, MIDNIGHT_UTC_S + at, at) is verdict, late_s


def test_a_full_memory_makes_a_frame_old_and_never_new_again() -> None:
    verifier = Verifier(KEY)
    frames = [heartbeat(MIDNIGHT + 2 * number) for number in range(4000)]
    assert {verifier.check(frame, MIDNIGHT_UTC_S, 0.0) for frame in frames} == {OK}
    assert {verifier.check(frame, MIDNIGHT_UTC_S, 0.0) for frame in frames} == {REPLAYED}
    assert verifier.check(heartbeat(MIDNIGHT + 2 * 3999 - 1), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 1), MIDNIGHT_UTC_S, 0.0) is REPLAYED


def test_the_first_frame_of_a_stream_does_not_let_in_what_is_older_than_a_first_frame_may_be() -> None:
    verifier = Verifier(KEY)
    verifier.restore({}, floor=MIDNIGHT)
    assert verifier.check(heartbeat(MIDNIGHT + 5), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.1) is REPLAYED
    assert verifier.check(heartbeat(MIDNIGHT + 1), MIDNIGHT_UTC_S, 0.1) is OK


@pytest.mark.slow
def test_a_hundred_thousand_copies_late_ones_and_replays_against_a_set_of_all_that_was_heard() -> None:
    """Three links carry one station's two streams, each with its own delay and losses; an attacker plays again what
    he likes by any of them. A frame is taken the first time it comes, if no younger one of its stream came more than
    two seconds before; never a second time."""
    luck = random.Random(20261122)
    verifier = Verifier(KEY)
    streams = [(MIDNIGHT + number * 2_500 + stream, stream) for number in range(8_000) for stream in (0, 1)]
    sent = [(stamp, stream, heartbeat(stamp, link=stream)) for stamp, stream in streams]
    arrivals = []
    for place, (stamp, _stream, _frame) in enumerate(sent):
        at = (stamp - MIDNIGHT) / SECOND
        for delay_s, jitter_s, loss in ((0.005, 0.01, 0.3), (0.3, 0.3, 0.2), (0.9, 2.0, 0.1)):
            if luck.random() >= loss:
                arrivals.append((at + delay_s + jitter_s * luck.random(), place))
        for _ in range(4):  # played again, sooner or later
            arrivals.append((at + luck.choice([0.5, 3.0, 60.0]) * luck.random(), place))
    arrivals.sort()
    assert len(arrivals) > 100_000
    heard: set[bytes] = set()
    newest: list[list[tuple[float, int]]] = [[], []]  # of each stream: when the newest stamp rose, and to what
    taken = refused = 0
    for at, place in arrivals:
        stamp, stream, frame = sent[place]
        verdict = verifier.check(frame, MIDNIGHT_UTC_S + at, 1000.0 + at)
        rises = newest[stream]
        younger = bisect_right(rises, stamp, key=lambda rise: rise[1])
        overtaken_s = at - rises[younger][0] if younger < len(rises) else 0.0
        if frame.raw in heard:
            assert verdict is REPLAYED
            refused += 1
        elif overtaken_s < 2.0:
            assert verdict is OK
        elif overtaken_s > 2.6:
            assert verdict is REPLAYED
        if verdict is OK:
            heard.add(frame.raw)
            taken += 1
        if not rises or stamp > rises[-1][1]:
            rises.append((at, stamp))
    assert taken > 15_900
    assert refused > 80_000


def test_systems_components_and_links_are_streams_of_their_own() -> None:
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT + 5), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT, sysid=245), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT, compid=191), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT, link=1), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT, link=1), MIDNIGHT_UTC_S, 0.0) is REPLAYED


def test_a_first_frame_may_be_sixty_seconds_behind_our_clock() -> None:
    assert Verifier(KEY).check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S + 60.0, 0.0) is OK
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S + 60.5, 0.0) is TOO_OLD
    assert verifier.behind_s == pytest.approx(0.5)
    assert verifier.check(heartbeat(MIDNIGHT + SECOND), MIDNIGHT_UTC_S + 60.5, 0.0) is OK
    assert Verifier(KEY, first_packet_tolerance_s=5).check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S + 5.5, 0.0) is TOO_OLD


def test_a_first_frame_may_be_sixty_seconds_behind_the_newest_stamp_whatever_our_clock_says() -> None:
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT), 0.0, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT - 60 * SECOND, link=1), 0.0, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT - 60 * SECOND - 1, link=2), 0.0, 0.0) is TOO_OLD


def test_stamps_ahead_of_our_clock_are_accepted_because_ours_may_not_be_set() -> None:
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT), 0.0, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 3600 * SECOND, link=1), MIDNIGHT_UTC_S, 0.0) is OK


def test_a_clock_that_is_set_forward_leaves_running_streams_alone() -> None:
    verifier = Verifier(KEY)
    assert verifier.check(heartbeat(MIDNIGHT), 0.0, 100.0) is OK  # the clock is not set yet
    assert verifier.check(heartbeat(MIDNIGHT + SECOND), MIDNIGHT_UTC_S + 1, 101.0) is OK  # now it is
    assert verifier.check(heartbeat(MIDNIGHT + 2 * SECOND), MIDNIGHT_UTC_S + 86400, 102.0) is OK  # now it is wrong
    assert verifier.check(heartbeat(MIDNIGHT + 3 * SECOND, link=1), MIDNIGHT_UTC_S + 86400, 103.0) is TOO_OLD
    assert verifier.check(heartbeat(MIDNIGHT + 4 * SECOND), MIDNIGHT_UTC_S + 4, 104.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 5 * SECOND, link=1), MIDNIGHT_UTC_S + 5, 105.0) is OK


@pytest.mark.parametrize("step_s", [-86400.0, -3600.0, -61.0, 3600.0])
def test_no_step_of_our_clock_makes_a_replay_acceptable(step_s: float) -> None:
    verifier = Verifier(KEY)
    captured = [heartbeat(MIDNIGHT + count * SECOND) for count in range(120)]
    for count, frame in enumerate(captured):
        assert verifier.check(frame, MIDNIGHT_UTC_S + count, float(count)) is OK
    assert {verifier.check(frame, MIDNIGHT_UTC_S + 120 + step_s, 120.0) for frame in captured} == {REPLAYED}


# ---- frames that were held back -----------------------------------------------------------------------------------


@pytest.mark.parametrize("clock_s", [0.0, MIDNIGHT_UTC_S], ids=["clock not set", "clock set"])
@pytest.mark.parametrize("kind", [Verifier, SignedPeer])
def test_a_frame_held_back_on_its_way_is_too_old(kind: type[Verifier] | type[SignedPeer], clock_s: float) -> None:
    verifier = kind(KEY)
    assert verifier.check(heartbeat(MIDNIGHT), clock_s, 1000.0) is OK
    # signed at second 1 and 2; arrived at second 31, which is 30 late, and at second 33, which is 31 late
    assert verifier.check(heartbeat(MIDNIGHT + 1 * SECOND), clock_s + 31, 1031.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 2 * SECOND), clock_s + 33, 1033.0) is TOO_OLD
    assert verifier.behind_s == pytest.approx(31.0, abs=0.1)
    assert verifier.check(heartbeat(MIDNIGHT + 34 * SECOND), clock_s + 34, 1034.0) is OK


def test_a_frame_that_was_too_old_once_is_never_fresh_again() -> None:
    verifier = Verifier(KEY, max_age_s=30)
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is OK
    held = heartbeat(MIDNIGHT + SECOND)
    assert verifier.check(held, MIDNIGHT_UTC_S + 600, 600.0) is TOO_OLD
    assert verifier.check(held, MIDNIGHT_UTC_S + 1, 600.0) is REPLAYED  # the clock was set back by ten minutes


def test_without_a_maximum_age_any_rising_stamp_of_a_running_stream_is_good() -> None:
    verifier = Verifier(KEY, max_age_s=None)
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 1), MIDNIGHT_UTC_S + 86400, 86400.0) is OK


def test_the_age_is_measured_against_the_least_delay_seen() -> None:
    verifier = Verifier(KEY, max_age_s=30)
    assert verifier.check(heartbeat(MIDNIGHT), 0.0, 50.0) is OK  # a first frame that was 50 s under way
    assert verifier.check(heartbeat(MIDNIGHT + 51 * SECOND), 0.0, 51.0) is OK  # this one came at once
    assert verifier.check(heartbeat(MIDNIGHT + 52 * SECOND), 0.0, 83.0) is TOO_OLD


def test_a_station_that_brings_its_stamps_up_to_date_every_ten_seconds_is_heard() -> None:
    verifier = Verifier(KEY)
    for count in range(600):  # five frames a second, +1 each, as MAVProxy does
        stamp = MIDNIGHT + count // 50 * 10 * SECOND + count % 50
        assert verifier.check(heartbeat(stamp), MIDNIGHT_UTC_S + count / 5, count / 5) is OK


def test_a_station_whose_clock_drifts_is_heard_for_days() -> None:
    verifier = Verifier(KEY)
    for hour in range(24 * 7):
        stamp = MIDNIGHT + int(hour * 3600 * SECOND * (1 - 200e-6))
        assert verifier.check(heartbeat(stamp), 0.0, hour * 3600.0) is OK


def test_the_allowance_for_drift_does_not_add_up_while_frames_come_in_time() -> None:
    verifier = Verifier(KEY)
    for minute in range(24 * 60):
        assert verifier.check(heartbeat(MIDNIGHT + minute * 60 * SECOND), 0.0, minute * 60.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 86341 * SECOND), 0.0, 86341.0 + 35.0) is TOO_OLD


def test_a_station_that_set_its_clock_right_is_heard_once_its_stamps_rise_again() -> None:
    verifier = Verifier(KEY)
    ahead = 3600 * SECOND
    assert verifier.check(heartbeat(MIDNIGHT + ahead), MIDNIGHT_UTC_S, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 10 * SECOND), MIDNIGHT_UTC_S + 10, 10.0) is REPLAYED
    assert verifier.check(heartbeat(MIDNIGHT + ahead + SECOND), MIDNIGHT_UTC_S + 3601, 3601.0) is OK
    assert (
        verifier.check(heartbeat(MIDNIGHT + ahead + 2 * SECOND), 0.0, 3602.0) is OK
    )  # from now on this is its usual delay
    assert verifier.check(heartbeat(MIDNIGHT + ahead + 3 * SECOND), 0.0, 3640.0) is TOO_OLD


# ---- the table of streams -----------------------------------------------------------------------------------------


def test_the_table_of_streams_is_bounded() -> None:
    verifier = Verifier(KEY)
    for link in range(16):
        assert verifier.check(heartbeat(MIDNIGHT, link=link), MIDNIGHT_UTC_S, 0.0) is OK
    for link in range(16, 256):
        assert verifier.check(heartbeat(MIDNIGHT + 1, link=link), MIDNIGHT_UTC_S, 0.0) is TOO_MANY_STREAMS
    for link in range(16):
        assert verifier.check(heartbeat(MIDNIGHT + 2, link=link), MIDNIGHT_UTC_S, 0.0) is OK


def test_a_full_table_forgets_a_stream_only_when_its_frames_are_too_old_anyway() -> None:
    verifier = Verifier(KEY, max_streams=2)
    assert verifier.check(heartbeat(MIDNIGHT, link=0), MIDNIGHT_UTC_S, 0.0) is OK
    for second in (20, 40, 60):
        assert (
            verifier.check(heartbeat(MIDNIGHT + second * SECOND, link=1), MIDNIGHT_UTC_S + second, float(second)) is OK
        )
    newcomer = heartbeat(MIDNIGHT + 60 * SECOND, link=2)
    assert verifier.check(newcomer, MIDNIGHT_UTC_S + 60, 60.0) is TOO_MANY_STREAMS
    assert verifier.check(heartbeat(MIDNIGHT + 61 * SECOND, link=1), MIDNIGHT_UTC_S + 61, 61.0) is OK
    assert verifier.check(newcomer, MIDNIGHT_UTC_S + 61, 61.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT, link=0), 0.0, 61.0) is TOO_OLD


def test_what_was_forgotten_stays_refused_when_the_tolerance_is_raised_at_the_next_start() -> None:
    verifier = Verifier(KEY, max_streams=1, first_packet_tolerance_s=0)
    assert verifier.check(heartbeat(MIDNIGHT, link=0), 0.0, 0.0) is OK
    assert verifier.check(heartbeat(MIDNIGHT + 1, link=1), 0.0, 0.0) is TOO_MANY_STREAMS
    verifier.newest += 2
    assert verifier.check(heartbeat(MIDNIGHT + 2, link=1), 0.0, 0.0) is OK
    assert verifier.floor == MIDNIGHT


def test_a_peer_has_sixteen_streams() -> None:
    peer = SignedPeer(KEY)
    verdicts = [peer.check(heartbeat(MIDNIGHT, link=link), MIDNIGHT_UTC_S, 0.0) for link in range(17)]
    assert verdicts == [OK] * 16 + [TOO_MANY_STREAMS]


def test_a_table_needs_room_for_a_stream() -> None:
    with pytest.raises(ValueError, match="max_streams = 0: must be 1 or more"):
        Verifier(KEY, max_streams=0)


# ---- restarts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("clock_s", [0.0, MIDNIGHT_UTC_S - 3600, MIDNIGHT_UTC_S], ids=["not set", "behind", "right"])
def test_after_a_restart_everything_captured_before_is_refused_and_what_is_signed_now_is_not(clock_s: float) -> None:
    before = Verifier(KEY)
    captured = [heartbeat(MIDNIGHT + count, link=count % 3, compid=190 + count % 2) for count in range(30)]
    assert {before.check(frame, MIDNIGHT_UTC_S, 0.0) for frame in captured} == {OK}
    after = Verifier(KEY)
    after.restore(before.state())
    assert {after.check(frame, clock_s, 5.0) for frame in captured} == {TOO_OLD}
    assert after.check(heartbeat(MIDNIGHT + 29, link=9), clock_s, 5.0) is TOO_OLD  # in a stream not seen before as well
    assert after.check(heartbeat(MIDNIGHT + 30), clock_s, 5.0) is OK


def test_a_state_survives_a_restart_in_which_nobody_spoke() -> None:
    first = Verifier(KEY)
    assert first.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is OK
    assert first.state() == {fingerprint(KEY): MIDNIGHT}
    second = Verifier(KEY)
    second.restore(first.state())
    assert second.state() == {fingerprint(KEY): MIDNIGHT}


def test_the_state_of_another_key_says_nothing() -> None:
    verifier = Verifier(KEY)
    verifier.restore({fingerprint(OTHER_KEY): MAX_TIMESTAMP})
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is OK


def test_a_lost_state_can_be_replaced_by_a_floor() -> None:
    verifier = Verifier(KEY)
    verifier.restore({}, floor=MIDNIGHT)
    assert verifier.check(heartbeat(MIDNIGHT), MIDNIGHT_UTC_S, 0.0) is TOO_OLD
    assert verifier.state() == {fingerprint(KEY): MIDNIGHT}
    assert verifier.check(heartbeat(MIDNIGHT + 1), MIDNIGHT_UTC_S, 0.0) is OK


@pytest.mark.slow
@settings(max_examples=300)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("send"), st.integers(0, 5), st.integers(-200, 200)),
            st.tuples(st.just("replay"), st.integers(0, 10**6), st.just(0)),
            st.tuples(st.just("wait"), st.integers(0, 200), st.just(0)),
            st.tuples(st.just("set clock"), st.integers(-1000, 1000), st.just(0)),
            st.tuples(st.just("restart"), st.just(0), st.just(0)),
        ),
        max_size=60,
    )
)
def test_no_frame_is_ever_accepted_twice(steps: list[tuple[str, int, int]]) -> None:
    """Whatever senders' clocks, our clock, restarts and a full table do."""
    verifier = Verifier(KEY, max_streams=3)
    now_s, offset_s = 1000.0, 0.0
    sent: list[Frame] = []
    accepted: set[bytes] = set()
    for what, number, skew in steps:
        if what == "wait":
            now_s += number
            continue
        if what == "set clock":
            offset_s = float(number)
            continue
        if what == "restart":
            state = verifier.state()
            verifier = Verifier(KEY, max_streams=3)
            verifier.restore(state)
            continue
        if what == "send":
            sent.append(heartbeat(MIDNIGHT + int((now_s + skew) * SECOND), link=number))
            frame = sent[-1]
        elif sent:
            frame = sent[number % len(sent)]
        else:
            continue
        if verifier.check(frame, MIDNIGHT_UTC_S + now_s + offset_s, now_s) is OK:
            assert frame.raw not in accepted
            accepted.add(frame.raw)


# ---- both directions with a stock program -------------------------------------------------------------------------


def test_a_station_whose_clock_is_an_hour_behind_joins_after_our_first_frame() -> None:
    peer = SignedPeer(KEY)
    station = stock_program(stamp=MIDNIGHT - 3600 * SECOND)
    assert peer.check(sent_by(station), MIDNIGHT_UTC_S, 0.0) is TOO_OLD
    assert peer.behind_s == pytest.approx(3540.0)
    downlink = peer.sign(vehicle_heartbeat(), 0, MIDNIGHT_UTC_S, 0.1)
    assert downlink is not None
    assert station.decode(bytearray(downlink)).get_srcSystem() == 1
    assert peer.check(sent_by(station), MIDNIGHT_UTC_S, 0.2) is OK


def test_a_companion_whose_clock_is_not_set_is_heard_by_the_station_after_its_first_frame() -> None:
    peer = SignedPeer(KEY)
    station = stock_program()
    too_early = peer.sign(vehicle_heartbeat(), 0, 0.0, 0.0)
    with pytest.raises(mavlink.MAVError, match="Invalid signature"):
        station.decode(bytearray(too_early or b""))
    assert peer.check(sent_by(station), 0.0, 1.0) is OK
    downlink = peer.sign(vehicle_heartbeat(), 0, 0.0, 2.0)
    assert station.decode(bytearray(downlink or b"")).get_srcSystem() == 1


def test_a_companion_restarted_with_a_lost_clock_is_heard_by_the_station_at_once() -> None:
    before = SignedPeer(KEY)
    station = stock_program()
    assert before.check(sent_by(station), MIDNIGHT_UTC_S, 0.0) is OK
    after = SignedPeer(KEY)
    after.restore(before.state())
    downlink = after.sign(vehicle_heartbeat(), 0, 0.0, 0.0)
    assert station.decode(bytearray(downlink or b"")).get_srcSystem() == 1
    assert after.check(sent_by(station), 0.0, 0.1) is OK


def test_a_program_that_only_counts_is_kept_up_to_date_by_what_it_hears() -> None:
    """An older QGroundControl reads its clock once and then adds 1 a frame."""
    peer = SignedPeer(KEY)
    station = stock_program()
    for second in range(120):
        now_utc_s, now_s = MIDNIGHT_UTC_S + second, float(second)
        assert peer.check(sent_by(station), now_utc_s, now_s) is OK
        station.decode(bytearray(peer.sign(vehicle_heartbeat(), 0, now_utc_s, now_s) or b""))


# ---- two keys during a rotation -----------------------------------------------------------------------------------


def key_in(raw: bytes | None) -> str:
    frame = parsed(raw)
    good = [
        name for name, key in (("current", KEY), ("previous", OTHER_KEY)) if Verifier(key).check(frame, 0.0, 0.0) is OK
    ]
    return good[0]


def test_during_a_rotation_both_keys_are_accepted_and_no_third_one() -> None:
    peer = SignedPeer(KEY, OTHER_KEY)
    assert peer.check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0) is OK
    assert peer.check(heartbeat(MIDNIGHT, key=KEY), MIDNIGHT_UTC_S, 0.0) is OK
    assert peer.check(heartbeat(MIDNIGHT + 1, key=bytes(32)), MIDNIGHT_UTC_S, 0.0) is BAD
    assert peer.check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0) is REPLAYED
    assert SignedPeer(KEY).check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0) is BAD


def test_a_station_is_answered_in_the_key_that_it_uses_and_the_new_key_stays() -> None:
    peer = SignedPeer(KEY, OTHER_KEY)
    assert key_in(peer.sign(vehicle_heartbeat(), 0, MIDNIGHT_UTC_S, 0.0)) == "current"
    peer.check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0)
    assert key_in(peer.sign(vehicle_heartbeat(), 0, MIDNIGHT_UTC_S, 1.0)) == "previous"
    peer.check(heartbeat(MIDNIGHT, key=KEY), MIDNIGHT_UTC_S, 0.0)
    assert key_in(peer.sign(vehicle_heartbeat(), 0, MIDNIGHT_UTC_S, 2.0)) == "current"
    peer.check(heartbeat(MIDNIGHT + 1, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0)
    assert key_in(peer.sign(vehicle_heartbeat(), 0, MIDNIGHT_UTC_S, 3.0)) == "current"


def test_a_refused_frame_of_the_old_key_does_not_choose_the_key() -> None:
    peer = SignedPeer(KEY, OTHER_KEY)
    assert peer.check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S + 3600, 0.0) is TOO_OLD
    assert key_in(peer.sign(vehicle_heartbeat(), 0, MIDNIGHT_UTC_S, 0.0)) == "current"


def test_the_state_of_a_peer_holds_both_keys_apart() -> None:
    peer = SignedPeer(KEY, OTHER_KEY)
    peer.check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0)
    assert peer.state() == {fingerprint(KEY): 0, fingerprint(OTHER_KEY): MIDNIGHT}
    retired = SignedPeer(KEY)
    retired.restore(peer.state())
    assert retired.state() == {fingerprint(KEY): 0}


def test_a_new_key_starts_afresh_after_stamps_from_a_clock_far_ahead() -> None:
    peer = SignedPeer(OTHER_KEY)
    assert peer.check(heartbeat(MIDNIGHT + 10**12, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0) is OK
    rotated = SignedPeer(KEY, OTHER_KEY)
    rotated.restore(peer.state())
    assert rotated.check(heartbeat(MIDNIGHT, key=OTHER_KEY), MIDNIGHT_UTC_S, 0.0) is TOO_OLD
    assert rotated.check(heartbeat(MIDNIGHT, key=KEY), MIDNIGHT_UTC_S, 0.0) is OK


def test_a_stamp_that_was_proven_holds_though_the_monotonic_clock_should_go_back() -> None:
    clock = SigningClock()
    clock.follow(900_000, 10.0)
    clock.follow(500_000, 5.0)
    assert clock.next(0.0, 5.0) == 900_000

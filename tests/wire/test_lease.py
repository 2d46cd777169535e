# SPDX-License-Identifier: GPL-3.0-or-later

"""Lease and guard status, byte by byte: the Lua script at the other end reads the same layout by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, GuardState, LeaseState, Phase
from mavproxy_handover.wire.ids import GUARD_STATUS_TUNNEL, LEASE_TUNNEL
from mavproxy_handover.wire.lease import GuardStatus, Lease, pack_lease, unpack_guard_status, unpack_lease
from mavproxy_handover.wire.status import LeaseSequence

LEASE = Lease(LeaseState.TRANSFER, 251, 0x01020304, 0x05060708, 0x090A0B0C, 3000, guard_nonce=0x11121314)
#: version 2, state 2, commander 251, flags 0, nonce, sequence, epoch, ttl, seconds left, guard nonce; little-endian
LEASE_BYTES = bytes.fromhex("02 02 fb 00 04030201 08070605 0c0b0a09 b80b 0000 14131211")
#: the layout of the release before, as recordings hold it
LEASE_BYTES_1 = bytes.fromhex("01 02 fb 00 04030201 08070605 0c0b0a09 b80b 0000")

STATUS = GuardStatus(
    GuardState.EXPIRED,
    action=1,
    enforcing=True,
    armed=True,
    flying=False,
    tampered=True,
    foreign=False,
    nonce=0x01020304,
    sequence=0x05060708,
    epoch=0x090A0B0C,
    rejected=0x0D0E,
    firmware=(4, 6),
    guard_nonce=0x11121314,
)
#: version 2, state 3, action 1, flags enforcing + armed + tampered, nonce, sequence, epoch, rejected,
#: firmware 4.6, nonce of the guard
STATUS_BYTES = bytes.fromhex("02 03 01 0b 04030201 08070605 0c0b0a09 0e0d 04 06 14131211")
STATUS_BYTES_1 = bytes.fromhex("01 03 01 0b 04030201 08070605 0c0b0a09 0e0d 04 06")


def test_a_lease_is_these_24_bytes_and_zeros_after_them() -> None:
    message = pack_lease(LEASE, 1)
    assert (message.target_system, message.target_component) == (1, 1)
    assert (message.payload_type, LEASE_TUNNEL, message.payload_length) == (47116, 47116, 24)
    assert bytes(message.payload) == LEASE_BYTES + bytes(104)


def test_the_frame_of_a_lease_byte_by_byte() -> None:
    """Payload order of TUNNEL: payload_type, target system, target component, payload_length, payload."""
    raw = bytes(pack_lease(LEASE, 7).pack(mavlink.MAVLink(None, srcSystem=7, srcComponent=191)))
    payload = bytes.fromhex("0cb8 07 01 18") + LEASE_BYTES.rstrip(b"\0")
    assert raw[:10] == bytes([0xFD, len(payload), 0, 0, 0, 7, 191, 0x81, 0x01, 0x00])
    assert raw[10:-2] == payload


def test_a_lease_comes_back_as_it_went() -> None:
    assert unpack_lease(LEASE_BYTES) == LEASE


def test_leases_and_statuses_of_the_release_before_are_read_without_a_guard_nonce() -> None:
    assert unpack_lease(LEASE_BYTES_1) == replace(LEASE, guard_nonce=0)
    assert unpack_guard_status(STATUS_BYTES_1) == replace(STATUS, guard_nonce=0, version=1)


def test_two_guards_are_flag_2() -> None:
    raw = LEASE_BYTES[:3] + b"\x02" + LEASE_BYTES[4:]
    assert bytes(pack_lease(replace(LEASE, two_guards=True), 1).payload)[:24] == raw
    assert unpack_lease(raw) == replace(LEASE, two_guards=True)


def test_a_status_with_a_tag_has_flag_32_and_8_bytes_more() -> None:
    tagged = STATUS_BYTES[:3] + b"\x2b" + STATUS_BYTES[4:]
    assert unpack_guard_status(tagged + bytes(8)) == replace(STATUS, tagged=True)
    assert unpack_guard_status(tagged) is None
    assert unpack_guard_status(STATUS_BYTES + bytes(8)) is None


def test_the_seconds_that_are_left_alone_stand_behind_the_life_of_the_lease() -> None:
    alone = Lease(LeaseState.ALONE, 0, 0x01020304, 0x05060708, 0x090A0B0C, 3000, left_s=0x0102)
    raw = bytes.fromhex("02 05 00 00 04030201 08070605 0c0b0a09 b80b 0201 00000000")
    assert bytes(pack_lease(alone, 1).payload)[:24] == raw
    assert unpack_lease(raw) == alone


@pytest.mark.parametrize(("alone_s", "left_s"), [(0.0, 0), (-3.0, 0), (0.1, 1), (39.2, 40), (40.0, 40), (1e6, 65535)])
def test_a_second_that_has_begun_is_told_as_a_whole_one(alone_s: float, left_s: int) -> None:
    view = AuthorityView(Phase.ON_MISSION, None, None, 4, LeaseState.ALONE, armed=True)
    message = LeaseSequence(9).next(view, 1, alone_s)
    lease = unpack_lease(bytes(message.payload)[:24])
    assert lease == Lease(LeaseState.ALONE, 0, 9, 1, 4, 3000, left_s)


def test_nobody_is_commander_0() -> None:
    message = pack_lease(Lease(LeaseState.LOST, 0, 1, 1, 0, 3000), 1)
    assert bytes(message.payload[:4]) == bytes([2, 3, 0, 0])


def test_the_sequence_wraps() -> None:
    assert bytes(pack_lease(replace(LEASE, sequence=0x1_0000_0000), 1).payload[8:12]) == bytes(4)


@settings(deadline=None)
@given(
    st.builds(
        Lease,
        st.sampled_from(LeaseState),
        st.integers(0, 255),
        st.integers(1, 0xFFFFFFFF),
        st.integers(0, 0xFFFFFFFF),
        st.integers(0, 0xFFFFFFFF),
        st.integers(0, 0xFFFF),
    )
)
def test_any_lease_comes_back_as_it_went(lease: Lease) -> None:
    message = pack_lease(lease, 1)
    assert unpack_lease(bytes(message.payload[: message.payload_length])) == lease


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        LEASE_BYTES[:-1],
        LEASE_BYTES + b"\0",
        b"\x00" + LEASE_BYTES[1:],
        b"\x03" + LEASE_BYTES[1:],
        b"\x02\x00" + LEASE_BYTES[2:],
        b"\x02\x06" + LEASE_BYTES[2:],
    ],
    ids=["empty", "short", "long", "version 0", "version 3", "state 0", "state 6"],
)
def test_what_is_no_lease_is_none(payload: bytes) -> None:
    assert unpack_lease(payload) is None


def test_a_guard_status_is_these_24_bytes() -> None:
    assert GUARD_STATUS_TUNNEL == 47117
    assert unpack_guard_status(STATUS_BYTES) == STATUS


@pytest.mark.parametrize(
    ("flags", "true"),
    [
        (0, ()),
        (1, ("enforcing",)),
        (2, ("armed",)),
        (4, ("flying",)),
        (8, ("tampered",)),
        (16, ("foreign",)),
        (0xC0, ()),
    ],
)
def test_each_flag_is_its_bit(flags: int, true: tuple[str, ...]) -> None:
    status = unpack_guard_status(STATUS_BYTES[:3] + bytes([flags]) + STATUS_BYTES[4:])
    assert status is not None
    names = ("enforcing", "armed", "flying", "tampered", "foreign")
    assert tuple(name for name in names if getattr(status, name)) == true


@pytest.mark.parametrize(
    ("number", "state"),
    [
        (0, GuardState.DISABLED),
        (1, GuardState.WAITING),
        (2, GuardState.LIVE),
        (3, GuardState.EXPIRED),
        (4, GuardState.LOST),
    ],
)
def test_each_state_is_its_number(number: int, state: GuardState) -> None:
    status = unpack_guard_status(bytes([2, number]) + STATUS_BYTES[2:])
    assert status is not None
    assert status.state is state


@pytest.mark.parametrize("number", [5, 100, 255])
def test_a_state_that_a_guard_cannot_have_is_no_status(number: int) -> None:
    """255 is what the companion calls a guard that it does not hear; no guard can say that of itself."""
    assert unpack_guard_status(bytes([2, number]) + STATUS_BYTES[2:]) is None


@pytest.mark.slow
@settings(deadline=None)
@given(st.binary(max_size=40))
def test_any_bytes_are_a_status_or_none(payload: bytes) -> None:
    status = unpack_guard_status(payload)
    assert status is None or (payload[0] in (1, 2) and payload[1] <= 4)
    lease = unpack_lease(payload)
    assert lease is None or (payload[0] in (1, 2) and 1 <= payload[1] <= 5)


@pytest.mark.parametrize(
    ("phase", "commander", "lease", "told"),
    [
        (Phase.ON_MISSION, 251, LeaseState.HELD, (LeaseState.RECOVERING, 251)),
        (Phase.ON_HANDOVER, 251, LeaseState.TRANSFER, (LeaseState.RECOVERING, 251)),
        (Phase.EMERGENCY, 251, LeaseState.HELD, (LeaseState.RECOVERING, 251)),
        (Phase.ON_MISSION, None, LeaseState.LOST, (LeaseState.LOST, 0)),
        (Phase.ON_MISSION, None, LeaseState.RECOVERING, (LeaseState.LOST, 0)),
        (Phase.ON_MISSION, None, LeaseState.ALONE, (LeaseState.LOST, 0)),
    ],
)
def test_no_lease_of_a_rehearsal_permits_arming(
    phase: Phase, commander: int | None, lease: LeaseState, told: tuple[LeaseState, int]
) -> None:
    view = AuthorityView(phase, commander, None, 1, lease, armed=True, rehearsal=True)
    message = LeaseSequence(9).next(view, 1, 12.0)
    sent = unpack_lease(bytes(message.payload)[: message.payload_length])
    assert sent is not None
    assert (sent.state, sent.commander, sent.left_s) == (*told, 0)

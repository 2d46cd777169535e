# SPDX-License-Identifier: GPL-3.0-or-later

"""The tag of a lease: HalfSipHash-2-4 against its published vectors, and what the tag covers."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.wire.lease import Lease, pack_lease, unpack_lease
from mavproxy_handover.wire.lease_tag import half_siphash_2_4, lease_tag
from mavproxy_handover.wire.status import LeaseSequence
from tests.wire.half_siphash_vectors import KEY, VECTORS

FILE_KEY = bytes(range(32))
LEASE = Lease(LeaseState.TRANSFER, 251, 0x01020304, 0x05060708, 0x090A0B0C, 3000, guard_nonce=0x11121314)
#: version 2, state 2, commander 251, flags 1 (tagged), nonce, sequence, epoch, ttl, seconds left, guard nonce
TAGGED_BYTES = bytes.fromhex("02 02 fb 01 04030201 08070605 0c0b0a09 b80b 0000 14131211")


@pytest.mark.parametrize("length", range(64))
def test_published_vectors(length: int) -> None:
    assert half_siphash_2_4(KEY, bytes(range(length))) == VECTORS[length]


@pytest.mark.parametrize("length", [0, 7, 9, 16])
def test_key_of_another_length_is_our_own_fault(length: int) -> None:
    with pytest.raises(ValueError, match="has 8 bytes"):
        half_siphash_2_4(bytes(length), b"")


def test_tagged_lease_is_32_bytes_and_says_so() -> None:
    message = pack_lease(LEASE, 7, FILE_KEY)
    assert message.payload_length == 32
    payload = bytes(message.payload)
    assert payload[:24] == TAGGED_BYTES
    assert payload[32:] == bytes(96)
    # payload type 47116, system 7, component 1, then the lease
    assert payload[24:32] == half_siphash_2_4(bytes(range(8)), bytes.fromhex("0cb8 07 01") + TAGGED_BYTES)


def test_tag_depends_on_everything_it_covers() -> None:
    tags = {
        lease_tag(FILE_KEY, 47116, (1, 1), TAGGED_BYTES),
        lease_tag(bytes(32), 47116, (1, 1), TAGGED_BYTES),
        lease_tag(FILE_KEY, 47117, (1, 1), TAGGED_BYTES),
        lease_tag(FILE_KEY, 47116, (2, 1), TAGGED_BYTES),
        lease_tag(FILE_KEY, 47116, (1, 2), TAGGED_BYTES),
        *(lease_tag(FILE_KEY, 47116, (1, 1), _flipped(TAGGED_BYTES, bit)) for bit in range(192)),
    }
    assert len(tags) == 197


def _flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_both_forms_are_unpacked_and_flag_and_length_must_agree() -> None:
    plain, tagged = pack_lease(LEASE, 1), pack_lease(LEASE, 1, FILE_KEY)
    for message in (plain, tagged):
        assert unpack_lease(bytes(message.payload)[: message.payload_length]) == LEASE
    assert unpack_lease(bytes(tagged.payload)[:24]) is None
    assert unpack_lease(bytes(plain.payload)[:32]) is None
    for length in (20, 23, 25, 28, 31, 33):
        assert unpack_lease(bytes(tagged.payload)[:length]) is None


def test_a_companion_with_a_key_tags_every_lease() -> None:
    view = AuthorityView(Phase.ON_LOAD, 251, None, 9, LeaseState.HELD, False)
    leases = LeaseSequence(5, FILE_KEY)
    first, second = leases.next(view, 1), leases.next(view, 1)
    assert first.payload_length == second.payload_length == 32
    assert first.payload[24:32] != second.payload[24:32]
    assert LeaseSequence(5).next(view, 1).payload_length == 24


def test_frame_of_a_tagged_lease_fits_what_the_guard_reads() -> None:
    raw = pack_lease(LEASE, 1, FILE_KEY).pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=191))
    assert raw[1] == 5 + 32

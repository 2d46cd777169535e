# SPDX-License-Identifier: GPL-3.0-or-later

"""The tag that proves that the sender of a lease knows the key.

For vehicles on which other programs than the companion can write to its port of the autopilot. A Lua script has 10 000
instructions for each call and 32-bit integers, too little for SHA-256. HalfSipHash uses 32-bit words and fits.

HalfSipHash-2-4, 64 bits of key and of tag, by Jean-Philippe Aumasson and Daniel J. Bernstein (github.com/veorq/SipHash,
with the vectors that the tests use). It is a MAC with a short key: an attacker with large means can search 2^64 keys.
So it protects a cable and does not replace MAVLink signing. The two nonces and the sequence of the lease prevent
replays.

Layout: the tag follows the 24 bytes of the lease, whose flag bit 0 says so. It covers payload type (u16), target
system, target component and those 24 bytes. The guard's status has a tag of the same kind (flag bit 5). Key: the first
8 of the 32 bytes in a key file (`keys.load_key`).
"""

from __future__ import annotations

import struct
from typing import Final

__all__ = ["HASH_KEY_BYTES", "TAG_BYTES", "half_siphash_2_4", "lease_tag"]

HASH_KEY_BYTES: Final = 8
TAG_BYTES: Final = 8
_MASK: Final = 0xFFFFFFFF
_COVERED = struct.Struct("<HBB")


def half_siphash_2_4(key: bytes, message: bytes) -> bytes:
    """The 8-byte HalfSipHash-2-4 of `message` under an 8-byte `key`. Raises ValueError for a key of another length."""
    if len(key) != HASH_KEY_BYTES:
        raise ValueError(f"a HalfSipHash key has {HASH_KEY_BYTES} bytes, not {len(key)}")
    k0, k1 = struct.unpack("<II", key)
    state = [k0, k1 ^ 0xEE, 0x6C796765 ^ k0, 0x74656462 ^ k1]
    whole = len(message) & ~3
    last = message[whole:].ljust(3, b"\0") + bytes([len(message) & 0xFF])
    for (word,) in struct.iter_unpack("<I", message[:whole] + last):
        state[3] ^= word
        _rounds(state, 2)
        state[0] ^= word
    state[2] ^= 0xEE
    _rounds(state, 4)
    low = state[1] ^ state[3]
    state[1] ^= 0xDD
    _rounds(state, 4)
    return struct.pack("<II", low, state[1] ^ state[3])


def lease_tag(key: bytes, payload_type: int, target: tuple[int, int], body: bytes) -> bytes:
    """The tag of a lease or a status to the target (system, component). `key`: 32 bytes of a key file."""
    return half_siphash_2_4(key[:HASH_KEY_BYTES], _COVERED.pack(payload_type, *target) + body)


def _turn(word: int, bits: int) -> int:
    return (word << bits | word >> (32 - bits)) & _MASK


def _rounds(state: list[int], count: int) -> None:
    a, b, c, d = state
    for _ in range(count):
        a = (a + b) & _MASK
        b = _turn(b, 5) ^ a
        a = _turn(a, 16)
        c = (c + d) & _MASK
        d = _turn(d, 8) ^ c
        a = (a + d) & _MASK
        d = _turn(d, 7) ^ a
        c = (c + b) & _MASK
        b = _turn(b, 13) ^ c
        c = _turn(c, 16)
    state[:] = a, b, c, d

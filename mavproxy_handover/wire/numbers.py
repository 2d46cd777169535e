# SPDX-License-Identifier: GPL-3.0-or-later

"""Changes the sequence number of a complete frame, without knowing its message.

The frame's CRC covers the number. It is not computed again but corrected. CRCs are linear, so another number changes
the CRC by a known value. The value depends on the changed bits, and on how many bytes follow them in the CRC's range.
So no CRC extra is needed, messages that the dialect lacks can be numbered too, and a damaged frame stays damaged.
"""

from __future__ import annotations

from array import array
from typing import Final

from pymavlink.generator.mavcrc import x25crc

from mavproxy_handover.wire.frames import (
    CRC_BYTES,
    FLAG_SIGNED,
    HEADER_V1,
    HEADER_V2,
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE_BYTES,
)

__all__ = ["is_signed", "number_place", "renumber"]

#: offset of the number
_PLACE_V1: Final = 2
_PLACE_V2: Final = 4
#: bytes between number and payload, and the CRC extra at the end
_FOLLOW_V1: Final = HEADER_V1 - _PLACE_V1 - 1 + 1
_FOLLOW_V2: Final = HEADER_V2 - _PLACE_V2 - 1 + 1


def _of_one_byte(value: int) -> int:
    """Change of the CRC if the last byte changes by `value`."""
    crc = x25crc()
    crc.crc = 0
    crc.accumulate(bytes([value]))
    return int(crc.crc)


def _changes() -> tuple[array[int], ...]:
    """Changes of the CRC: for each number of following bytes, for each change (old number xor new)."""
    step = [_of_one_byte(value) for value in range(256)]
    rows = [array("H", step)]
    for _ in range(255 + max(_FOLLOW_V1, _FOLLOW_V2)):  # one more byte follows
        rows.append(array("H", [crc >> 8 ^ step[crc & 0xFF] for crc in rows[-1]]))
    return tuple(rows)


_CHANGES: Final = _changes()


def number_place(raw: bytes) -> int:
    """Offset of the sequence number in `raw`; 0 if that is not one complete frame with flags that we understand.

    System and component follow it.
    """
    size = len(raw)
    if size >= HEADER_V2 + CRC_BYTES and raw[0] == MAGIC_V2:
        bare = HEADER_V2 + raw[1] + CRC_BYTES
        flags = raw[2]
        if flags == 0:
            return _PLACE_V2 if size == bare else 0
        return _PLACE_V2 if flags == FLAG_SIGNED and size == bare + SIGNATURE_BYTES else 0
    if size >= HEADER_V1 + CRC_BYTES and raw[0] == MAGIC_V1 and size == HEADER_V1 + raw[1] + CRC_BYTES:
        return _PLACE_V1
    return 0


def is_signed(raw: bytes) -> bool:
    """True if a complete frame has a signature."""
    return raw[0] == MAGIC_V2 and raw[2] == FLAG_SIGNED


def renumber(raw: bytes, place: int, number: int) -> bytes:
    """Return `raw` with the sequence number `number` (0 to 255) and the corrected CRC. `place`: its `number_place`.

    A signature is not changed, so it is invalid if the number changes.
    """
    before = raw[place]
    if before == number:
        return raw
    length = raw[1]
    if place == _PLACE_V2:
        change = _CHANGES[length + _FOLLOW_V2][before ^ number]
        end = HEADER_V2 + length
    else:
        change = _CHANGES[length + _FOLLOW_V1][before ^ number]
        end = HEADER_V1 + length
    changed = bytearray(raw)
    changed[place] = number
    changed[end] ^= change & 0xFF
    changed[end + 1] ^= change >> 8
    return bytes(changed)

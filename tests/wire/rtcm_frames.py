# SPDX-License-Identifier: GPL-3.0-or-later

"""RTCM 3 messages for tests, written anew from the standard's tables and not with `wire/rtcm.py`."""

from __future__ import annotations

__all__ = ["base", "message"]


def _crc(data: bytes) -> int:
    crc = 0
    for byte in data:
        crc ^= byte << 16
        for _bit in range(8):
            crc <<= 1
            if crc & 0x1000000:
                crc ^= 0x1864CFB
    return crc


def message(body: bytes) -> bytes:
    """A body with head and check sum."""
    data = b"\xd3" + len(body).to_bytes(2, "big") + body
    return data + _crc(data).to_bytes(3, "big")


def base(x_m: float, y_m: float, z_m: float, number: int = 1005) -> bytes:
    """A message 1005 or 1006 of a base at this place."""
    fields = [(number, 12), (7, 12), (0, 6), (0b1110, 4)]
    for value_m, more in ((x_m, 2), (y_m, 2), (z_m, 0)):
        fields += [(round(value_m * 10000) % (1 << 38), 38), (0, more)]
    if number == 1006:
        fields.append((15000, 16))
    bits = "".join(f"{value:0{width}b}" for value, width in fields if width)
    return message(int(bits, 2).to_bytes(len(bits) // 8, "big"))

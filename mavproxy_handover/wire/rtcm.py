# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the place of an RTK base in corrections: RTCM 3 messages 1005 and 1006, in GPS_RTCM_DATA or GPS_INJECT_DATA.

A message may lie in several GPS_RTCM_DATA, and a GPS_RTCM_DATA may hold a part of one: fragments are put together as
ArduPilot does it (`AP_GPS::handle_gps_rtcm_fragment`), and the end of each is kept for the next. Only these two
messages are looked for, so that corrections cost no more than a search for four bytes. Nothing here raises, whatever
the bytes are, and memory is bounded by `_MOST_BYTES`.

Sources: RTCM 10403.3 (DF025 to DF027: 38 bits, 0.0001 m); MAVLink's GPS_RTCM_DATA; ArduPilot's AP_GPS.cpp.
"""

from __future__ import annotations

import math
from typing import Final

__all__ = ["BaseReader", "INJECTED_BYTES", "RTCM_BYTES", "crc24q"]

#: bytes of corrections in GPS_RTCM_DATA and in GPS_INJECT_DATA, at the most
RTCM_BYTES: Final = 180
INJECTED_BYTES: Final = 110
#: preamble, length and the first byte of the message number: 1005, which has 19 bytes, and 1006, which has 21
_BEGINNINGS: Final = ((b"\xd3\x00\x13\x3e", 19, 1005), (b"\xd3\x00\x15\x3e", 21, 1006))
_HEAD, _CRC = 3, 3
_LONGEST: Final = _HEAD + 21 + _CRC
_FRAGMENTS: Final = 4
_MOST_BYTES: Final = _FRAGMENTS * RTCM_BYTES + _LONGEST
#: candidates in one piece: garbage costs no more
_MOST_TRIES: Final = 16
_POLYNOMIAL: Final = 0x1864CFB
#: distance from the centre of the Earth: no base is deeper or higher (m)
_LOWEST_M, _HIGHEST_M = 6_330_000.0, 6_400_000.0
_UNIT_M: Final = 0.0001


def _table() -> tuple[int, ...]:
    found = []
    for byte in range(256):
        crc = byte << 16
        for _bit in range(8):
            crc = crc << 1 ^ (_POLYNOMIAL if crc & 0x800000 else 0)
        found.append(crc & 0xFFFFFF)
    return tuple(found)


_TABLE: Final = _table()


def crc24q(data: bytes) -> int:
    """The CRC of RTCM 3."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFFFF) ^ _TABLE[crc >> 16 ^ byte]
    return crc


class BaseReader:
    """The corrections of one station."""

    def __init__(self) -> None:
        self._sequence = -1
        self._parts: dict[int, bytes] = {}
        self._last_part = _FRAGMENTS - 1
        #: the end of what was searched: a message may go on
        self._tail = b""

    def fragment(self, flags: int, data: bytes) -> tuple[float, float, float] | None:
        """A GPS_RTCM_DATA; the place of the base (m from the centre of the Earth) if it is complete by that."""
        if not flags & 1:
            return self.stream(data)
        part, sequence = flags >> 1 & 3, flags >> 3 & 31
        if sequence != self._sequence or part in self._parts:
            self._parts, self._last_part = {}, _FRAGMENTS - 1
        self._sequence, self._parts[part] = sequence, data
        if len(data) < RTCM_BYTES:
            self._last_part = part
        if any(each not in self._parts for each in range(self._last_part + 1)):
            return None
        whole = b"".join(self._parts[each] for each in range(self._last_part + 1))
        self._parts, self._last_part = {}, _FRAGMENTS - 1
        return self.stream(whole)

    def stream(self, data: bytes) -> tuple[float, float, float] | None:
        """Further bytes of the corrections; the newest place of the base in them."""
        bytes_ = (self._tail + data)[-_MOST_BYTES:]
        self._tail = bytes_[-(_LONGEST - 1) :]
        found = [place for beginning in _BEGINNINGS for place in _places(bytes_, *beginning)]
        return found[-1] if found else None


def _places(data: bytes, beginning: bytes, length: int, number: int) -> list[tuple[float, float, float]]:
    found, at = [], data.find(beginning)
    for _try in range(_MOST_TRIES):
        if at < 0:
            break
        body, end = data[at + _HEAD : at + _HEAD + length], at + _HEAD + length
        fits = int.from_bytes(body[:2], "big") >> 4 == number and len(data) >= end + _CRC
        if fits and crc24q(data[at:end]) == int.from_bytes(data[end : end + _CRC], "big"):
            place = _place(body)
            if _LOWEST_M <= math.hypot(*place) <= _HIGHEST_M:
                found.append(place)
        at = data.find(beginning, at + 1)
    return found


def _place(body: bytes) -> tuple[float, float, float]:
    bits, size = int.from_bytes(body, "big"), len(body) * 8
    x, y, z = (_signed(bits >> (size - start - 38)) * _UNIT_M for start in (34, 74, 114))
    return x, y, z


def _signed(bits: int) -> int:
    value = bits & ((1 << 38) - 1)
    return value - (1 << 38) if value >> 37 else value

# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVLink frames as the gate sees them: header, verified bytes, a few payload bytes, no decoded fields.

Decoding a whole message costs more than judging it, and what is passed on must be passed on byte for byte.
So this module finds frames in a byte stream, checks them, and leaves them whole. Rules that live here:

1. A frame counts only if its CRC fits the definition of its message in our dialect. A frame of an id that the
   dialect does not have cannot be checked; it is skipped and counted. Its length is believed only if a magic
   byte follows, because a stray magic byte in garbage has a length too, and would swallow the frame behind it.
2. A frame with an incompatibility flag other than "signed" is not understood; it is skipped and counted.
   Nor is a MAVLink 1 frame with more payload than its message has, which is skipped before the rest of it is
   there: MAVLink 1 knows no newer fields, and a stray magic byte must not hold up the frames behind it.
3. After garbage or a bad CRC the search goes on one byte behind the magic byte, so a damaged frame costs no
   frame but itself.
4. Any cut of the stream gives the same frames. What is kept between two calls is no longer than one frame.
5. A frame that has begun is waited for no longer than PATIENCE_S: then its first byte is garbage, and the search goes
   on in what came behind it. Else a stray magic byte with a length, or one damaged length byte, would hold back what
   comes behind it until 280 bytes are there, which on a link that carries heartbeats takes longer than heartbeats may
   stay away. A real frame comes faster: 280 bytes take 49 ms at 57600 baud. Its last byte counts when it is fed, so a
   caller that was late to read loses nothing. Who gives no time (what arrives whole needs none) waits for ever.
6. Nothing that arrives raises.

Signatures are not checked here (that needs a link's key); `Frame.signed` says that one is there.
"""

from __future__ import annotations

import re
import struct
from binascii import crc_hqx
from bisect import bisect_right
from dataclasses import dataclass
from math import inf
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

__all__ = [
    "MAX_FRAME_BYTES",
    "PATIENCE_S",
    "Frame",
    "FrameCounters",
    "FrameSplitter",
    "checked_types",
    "field_bytes",
    "field_float",
    "field_int",
    "field_offset",
    "parse_one",
    "target",
    "target_places",
]

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
HEADER_V1: Final = 6
HEADER_V2: Final = 10
CRC_BYTES: Final = 2
SIGNATURE_BYTES: Final = 13
FLAG_SIGNED: Final = 0x01

#: The longest frame there can be: MAVLink 2, full payload, signed.
MAX_FRAME_BYTES: Final = HEADER_V2 + 255 + CRC_BYTES + SIGNATURE_BYTES

#: How long a frame that has begun is waited for. Streams are looked at every 0.05 s while one waits
#: (`schedule.TICK_S`), so noise makes nobody deaf for longer than 0.3 s.
PATIENCE_S: Final = 0.25

_MAGIC: Final = re.compile(b"[\xfd\xfe]")
_STRUCT_ITEM: Final = re.compile(r"(\d*)([a-zA-Z])")


class Frame(NamedTuple):
    """One whole MAVLink frame.

    `payload` has the full length of the message's definition when the id is known: trailing zeros that
    MAVLink 2 left out are there again, and fields newer than our dialect are not. Of an unknown id it is what
    was received. `known` is False only in frames from `parse_one`: their CRC could not be checked.
    A tuple, because making a frozen dataclass takes longer than checking the frame's CRC.
    """

    raw: bytes
    version: int  #: 1 or 2
    msgid: int
    sysid: int
    compid: int
    seq: int
    signed: bool
    payload: bytes
    known: bool


@dataclass(slots=True)
class FrameCounters:
    """What a splitter has seen. Every byte fed is in a frame, a skipped frame, garbage, dropped, or waits."""

    frames: int = 0  #: whole and checked
    bad_crc: int = 0
    bad_flags: int = 0  #: incompatibility flags that we do not understand
    unknown_id: int = 0  #: whole by their length, unchecked, skipped
    garbage_bytes: int = 0  #: bytes that belong to no frame
    overflow_bytes: int = 0  #: bytes beyond `max_buffer` of a single feed


@dataclass(frozen=True, slots=True)
class _Definition:
    crc_extra: bytes
    length: int
    padding: bytes
    target_system: int | None
    target_component: int | None


def _fields(message: type) -> dict[str, slice]:
    """Where a message's fields are in the payload, in wire order, from the format that pymavlink unpacks by."""
    items = _STRUCT_ITEM.findall(message.unpacker.format.lstrip("<"))  # type: ignore[attr-defined]
    fields = {}
    position = 0
    for name, (count, code) in zip(message.ordered_fieldnames, items, strict=True):  # type: ignore[attr-defined]
        end = position + struct.calcsize(f"<{count}{code}")
        fields[name] = slice(position, end)
        position = end
    return fields


def _definition(message: type) -> _Definition:
    offsets = {name: place.start for name, place in _fields(message).items()}
    length: int = message.unpacker.size  # type: ignore[attr-defined]
    return _Definition(
        crc_extra=bytes([message.crc_extra]),  # type: ignore[attr-defined]
        length=length,
        padding=bytes(length),
        # MANUAL_CONTROL is the one message that calls its target system just "target".
        target_system=offsets.get("target_system", offsets.get("target")),
        target_component=offsets.get("target_component"),
    )


_FIELDS: Final[dict[int, dict[str, slice]]] = {msgid: _fields(cls) for msgid, cls in mavlink.mavlink_map.items()}
_DEFINITIONS: Final[dict[int, _Definition]] = {msgid: _definition(cls) for msgid, cls in mavlink.mavlink_map.items()}


def checked_types(dialect: Any) -> frozenset[type]:
    """The messages of a dialect module of pymavlink whose CRC it has checked as our definition would: with the same
    extra byte. None if pymavlink is told to check no CRC (MAV_IGNORE_CRC)."""
    if getattr(dialect, "MAVLINK_IGNORE_CRC", False):
        return frozenset()
    ours, theirs = mavlink.mavlink_map, getattr(dialect, "mavlink_map", {})
    return frozenset(
        each for msgid, each in theirs.items() if msgid in ours and each.crc_extra == ours[msgid].crc_extra
    )


def target_places(msgid: int) -> tuple[int, int | None, int | None]:
    """Length of a message's payload, and where target system and component are in it, if it has them.

    KeyError if the dialect lacks the message.
    """
    definition = _DEFINITIONS[msgid]
    return definition.length, definition.target_system, definition.target_component


def field_offset(msgid: int, field: str) -> int:
    """Where a field begins in the payload, in bytes. KeyError if the dialect lacks message or field."""
    offset: int = _FIELDS[msgid][field].start
    return offset


def field_bytes(frame: Frame, field: str) -> bytes:
    """A field as it is in the payload; an array whole. KeyError if the dialect lacks message or field."""
    return frame.payload[_FIELDS[frame.msgid][field]]


def field_int(frame: Frame, field: str) -> int:
    """A field that is a number without sign. KeyError if the dialect lacks message or field."""
    return int.from_bytes(field_bytes(frame, field), "little")


def field_float(frame: Frame, field: str) -> float:
    """A field that is a float of 32 bits. KeyError if the dialect lacks message or field."""
    (value,) = _FLOAT.unpack(field_bytes(frame, field))
    return float(value)


def target(frame: Frame) -> tuple[int, int] | None:
    """The system and component that a frame is aimed at (0 = all), or None if its message has no target.

    A message with a target system and no target component is aimed at component 0.
    """
    definition = _DEFINITIONS.get(frame.msgid)
    if definition is None or definition.target_system is None:
        return None
    payload = frame.payload
    if len(payload) < definition.length:
        return None
    component = definition.target_component
    return payload[definition.target_system], 0 if component is None else payload[component]


_FLOAT: Final = struct.Struct("<f")

#: Every byte with its bits in reverse. MAVLink's CRC (CRC-16/MCRF4XX) is the one of the standard library with the bits
#: of each byte, and of itself, in reverse.
_REVERSED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def _crc_fits(raw: bytes, end: int, crc_extra: bytes) -> bool:
    data = raw[1:end] + crc_extra + raw[end : end + CRC_BYTES]  # with its CRC behind it, any data has the CRC 0
    return not crc_hqx(data.translate(_REVERSED), 0xFFFF)


def _frame_length(data: bytes, start: int) -> int:
    """Length of the frame whose header begins at `start`; 0 if more bytes are needed to tell."""
    if data[start] == MAGIC_V1:
        if len(data) - start < 2:
            return 0
        return HEADER_V1 + data[start + 1] + CRC_BYTES
    if len(data) - start < 3:
        return 0
    signature = SIGNATURE_BYTES if data[start + 2] & FLAG_SIGNED else 0
    return HEADER_V2 + data[start + 1] + CRC_BYTES + signature


def _message_id(data: bytes, start: int) -> int:
    if data[start] == MAGIC_V1:
        return data[start + 5]
    return data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16


def _too_long(data: bytes, start: int) -> bool:
    """Whether the MAVLink 1 header that begins at `start` gives its message more payload than it has."""
    definition = _DEFINITIONS.get(data[start + 5])
    return definition is not None and data[start + 1] > definition.length


def _build(raw: bytes, definition: _Definition | None) -> Frame:
    """The frame that `raw` holds. Its length and CRC have been checked."""
    length = raw[1]
    if raw[0] == MAGIC_V2:
        payload = raw[HEADER_V2 : HEADER_V2 + length]
        version, seq, sysid, compid = 2, raw[4], raw[5], raw[6]
        signed = bool(raw[2] & FLAG_SIGNED)
    else:
        payload = raw[HEADER_V1 : HEADER_V1 + length]
        version, seq, sysid, compid = 1, raw[2], raw[3], raw[4]
        signed = False
    if definition is not None and length != definition.length:
        payload = (payload + definition.padding)[: definition.length]
    return Frame(raw, version, _message_id(raw, 0), sysid, compid, seq, signed, payload, definition is not None)


def parse_one(raw: bytes | bytearray, proven: bool = False) -> Frame | None:
    """The frame that `raw` holds from its first byte to its last, or None.

    None means: not a frame, not exactly one, a bad CRC, or flags we do not understand. A frame of an unknown
    id is returned with `known` False, because its CRC cannot be checked. `proven`: somebody has checked it already.
    """
    if type(raw) is not bytes:
        raw = bytes(raw)
    size = len(raw)
    if size >= HEADER_V2 + CRC_BYTES and raw[0] == MAGIC_V2:  # nearly every frame, so at one go
        length, flags = raw[1], raw[2]
        end = HEADER_V2 + length
        signed = flags == FLAG_SIGNED
        if size != end + (CRC_BYTES + SIGNATURE_BYTES if signed else CRC_BYTES) or (flags and not signed):
            return None
        seq, sysid, compid = raw[4], raw[5], raw[6]
        msgid = raw[7]
        if raw[8] or raw[9]:
            msgid |= raw[8] << 8 | raw[9] << 16
        definition = _DEFINITIONS.get(msgid)
        payload = raw[HEADER_V2:end]
        if definition is None:
            return Frame(raw, 2, msgid, sysid, compid, seq, signed, payload, False)
        if not proven and not _crc_fits(raw, end, definition.crc_extra):
            return None
        if length != definition.length:
            payload = (payload + definition.padding)[: definition.length]
        # what Frame(...) does, without its function in between
        return tuple.__new__(Frame, (raw, 2, msgid, sysid, compid, seq, signed, payload, True))
    if size < HEADER_V1 + CRC_BYTES or raw[0] != MAGIC_V1 or _frame_length(raw, 0) != size or _too_long(raw, 0):
        return None
    definition = _DEFINITIONS.get(raw[5])
    if definition is not None and not proven and not _crc_fits(raw, HEADER_V1 + raw[1], definition.crc_extra):
        return None
    return _build(raw, definition)


class FrameSplitter:
    """Finds the frames in one peer's byte stream. Use one splitter for each peer: streams do not mix.

    `max_buffer` (bytes) limits what one `feed` looks at; what is over is dropped and counted. `patience_s`: see rule 5.
    """

    def __init__(self, max_buffer: int = 65536, patience_s: float = PATIENCE_S) -> None:
        if max_buffer < MAX_FRAME_BYTES:
            raise ValueError(f"max_buffer = {max_buffer}: must be {MAX_FRAME_BYTES} or more, one whole frame")
        self.counters = FrameCounters()
        self._max_buffer = max_buffer
        self._patience_s = patience_s
        self._rest = b""
        #: when the bytes of the rest came: (place of the first of some, time), in order
        self._arrived: list[tuple[int, float]] = []

    @property
    def waiting(self) -> int:
        """Bytes kept for the next `feed`."""
        return len(self._rest)

    def feed(self, data: bytes, now: float | None = None) -> list[Frame]:
        """Take the next bytes of the stream; return the frames that they complete, in order.

        `now` (seconds): while something is `waiting`, to be called without data as well. Give it always or never.
        """
        counters = self.counters
        buffer = self._rest + data if self._rest else bytes(data)
        if len(buffer) > self._max_buffer:
            counters.overflow_bytes += len(buffer) - self._max_buffer
            buffer = buffer[: self._max_buffer]
        frames: list[Frame] = []
        end = len(buffer)
        position = 0
        while position < end:
            found = _MAGIC.search(buffer, position)
            if found is None:
                counters.garbage_bytes += end - position
                position = end
                break
            start = found.start()
            counters.garbage_bytes += start - position
            position = start
            if buffer[start] == MAGIC_V2 and end - start > 2 and buffer[start + 2] & ~FLAG_SIGNED:
                counters.bad_flags += 1
                counters.garbage_bytes += 1
                position = start + 1
                continue
            if buffer[start] == MAGIC_V1 and end - start >= HEADER_V1 and _too_long(buffer, start):
                counters.garbage_bytes += 1
                position = start + 1
                continue
            length = _frame_length(buffer, start)
            if length == 0 or end - start < length:
                if self._is_old(start, now):
                    counters.garbage_bytes += 1
                    position = start + 1
                    continue
                break
            definition = _DEFINITIONS.get(_message_id(buffer, start))
            if definition is None:
                behind = start + length
                if behind == end and not self._is_old(start, now):
                    break
                if behind < end and buffer[behind] in (MAGIC_V1, MAGIC_V2):
                    counters.unknown_id += 1
                    position = behind
                else:
                    counters.garbage_bytes += 1
                    position = start + 1
                continue
            raw = buffer[start : start + length]
            header = HEADER_V1 if raw[0] == MAGIC_V1 else HEADER_V2
            if not _crc_fits(raw, header + raw[1], definition.crc_extra):
                counters.bad_crc += 1
                counters.garbage_bytes += 1
                position = start + 1
                continue
            counters.frames += 1
            frames.append(_build(raw, definition))
            position = start + length
        self._keep(buffer, position, now)
        return frames

    def _is_old(self, start: int, now: float | None) -> bool:
        """Whether the byte at `start`, in what was kept and what came now, came longer ago than a frame takes."""
        if now is None or start >= len(self._rest) or not self._arrived:
            return False
        _place, at = self._arrived[bisect_right(self._arrived, (start, inf)) - 1]
        return now - at >= self._patience_s

    def _keep(self, buffer: bytes, position: int, now: float | None) -> None:
        """What lies from `position` on waits for the next bytes."""
        if position == len(buffer):
            self._rest = b""
            self._arrived = []
            return
        if now is not None:
            arrived = self._arrived
            if len(buffer) > len(self._rest):
                arrived = [*arrived, (len(self._rest), now)]
            first = bisect_right(arrived, (position, inf)) - 1
            self._arrived = [(max(0, place - position), at) for place, at in arrived[first:]]
        self._rest = buffer[position:]

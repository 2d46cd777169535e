# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVLink frames as the gate sees them: header, checked bytes, single fields of the payload, no decoded messages.

Decoding a whole message costs more than judging it, and the gate must forward frames byte for byte. So this module
finds frames in a byte stream, checks them, and leaves them unchanged. Rules that live here:

1. A frame counts only if its CRC fits the definition of its message in our dialect. A frame with an unknown id cannot
   be checked. If a magic byte follows its last byte, the whole frame is skipped and counted. Otherwise only its magic
   byte is skipped: it may be a stray byte in garbage, whose length would swallow the next frame.
2. A frame with an incompatibility flag other than "signed" is not understood; it is skipped and counted. A MAVLink 1
   frame with more payload than its message has is skipped before the rest of it has arrived. MAVLink 1 has no extension
   fields, and a stray magic byte must not delay the next frames.
3. After garbage or a bad CRC the search continues one byte after the magic byte. So a damaged frame costs only itself.
4. Any cut of the stream gives the same frames. At most one frame is kept between two calls.
5. The time-out for an incomplete frame is PATIENCE_S. Then its first byte is garbage, and the search continues in the
   bytes after it. Otherwise a stray magic byte, or one damaged length byte, would hold back up to 280 bytes. A link
   that carries only heartbeats needs longer for 280 bytes than the 5 s after which a station counts as lost. A real
   frame is faster: 280 bytes take 49 ms at 57600 baud. `feed` adds the new bytes before it checks the time-out, so a
   caller that calls late loses no complete frame. A caller that gives no time has no time-out.
6. No data from outside raises.

Signatures are not checked here (that needs a link's key); `Frame.signed` says that there is one.
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
    "MAGIC_V2",
    "PATIENCE_S",
    "REVERSED",
    "Frame",
    "FrameCounters",
    "FrameSplitter",
    "checked_types",
    "crc_extra",
    "field_bytes",
    "field_float",
    "field_int",
    "field_offset",
    "parse_one",
    "target",
    "target_offsets",
]

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
HEADER_V1: Final = 6
HEADER_V2: Final = 10
CRC_BYTES: Final = 2
SIGNATURE_BYTES: Final = 13
FLAG_SIGNED: Final = 0x01

#: The longest possible frame: MAVLink 2, full payload, signed.
MAX_FRAME_BYTES: Final = HEADER_V2 + 255 + CRC_BYTES + SIGNATURE_BYTES

#: Time-out (s) of an incomplete frame. Streams with an incomplete frame are read every 0.05 s (`schedule.TICK_S`), so
#: noise costs at most 0.3 s.
PATIENCE_S: Final = 0.25

_MAGIC: Final = re.compile(b"[\xfd\xfe]")
_STRUCT_ITEM: Final = re.compile(r"(\d*)([a-zA-Z])")


class Frame(NamedTuple):
    """One complete MAVLink frame.

    If the id is known, `payload` has the full length of the message's definition: trailing zeros that MAVLink 2 left
    out are restored, and fields newer than our dialect are removed. For an unknown id it is the received payload.
    `known` is False only in frames from `parse_one` whose CRC could not be checked. It is a tuple, because making a
    frozen dataclass takes longer than checking the frame's CRC.
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
    """Counters of a splitter. Every byte belongs to a frame, a skipped frame, garbage, dropped bytes, or
    waiting bytes.
    """

    frames: int = 0  #: complete and checked
    bad_crc: int = 0
    bad_flags: int = 0  #: incompatibility flags that we do not understand
    unknown_id: int = 0  #: complete by their length, unchecked, skipped
    garbage_bytes: int = 0  #: bytes outside all frames
    overflow_bytes: int = 0  #: bytes beyond `max_buffer` of a single feed


@dataclass(frozen=True, slots=True)
class _Definition:
    crc_extra: bytes
    length: int
    padding: bytes
    target_system: int | None
    target_component: int | None


def _fields(message: type) -> dict[str, slice]:
    """Slices of a message's fields in the payload, in wire order, from the format that pymavlink unpacks."""
    items = _STRUCT_ITEM.findall(message.unpacker.format.lstrip("<"))  # type: ignore[attr-defined]
    fields = {}
    position = 0
    for name, (count, code) in zip(message.ordered_fieldnames, items, strict=True):  # type: ignore[attr-defined]
        end = position + struct.calcsize(f"<{count}{code}")
        fields[name] = slice(position, end)
        position = end
    return fields


def _definition(message: type) -> _Definition:
    offsets = {name: part.start for name, part in _fields(message).items()}
    length: int = message.unpacker.size  # type: ignore[attr-defined]
    return _Definition(
        crc_extra=bytes([message.crc_extra]),  # type: ignore[attr-defined]
        length=length,
        padding=bytes(length),
        # MANUAL_CONTROL is the only message that calls its target system just "target".
        target_system=offsets.get("target_system", offsets.get("target")),
        target_component=offsets.get("target_component"),
    )


_FIELDS: Final[dict[int, dict[str, slice]]] = {msgid: _fields(cls) for msgid, cls in mavlink.mavlink_map.items()}
_DEFINITIONS: Final[dict[int, _Definition]] = {msgid: _definition(cls) for msgid, cls in mavlink.mavlink_map.items()}


def checked_types(dialect: Any) -> frozenset[type]:
    """Messages of a pymavlink dialect module that pymavlink has checked with the same CRC extra byte as we do.

    Empty if pymavlink is told to check no CRC (MAV_IGNORE_CRC).
    """
    if getattr(dialect, "MAVLINK_IGNORE_CRC", False):
        return frozenset()
    ours, theirs = mavlink.mavlink_map, getattr(dialect, "mavlink_map", {})
    return frozenset(
        each for msgid, each in theirs.items() if msgid in ours and each.crc_extra == ours[msgid].crc_extra
    )


def target_offsets(msgid: int) -> tuple[int, int | None, int | None]:
    """Length of a message's payload, and offsets of target system and component, if it has them.

    Raises KeyError if the dialect lacks the message.
    """
    definition = _DEFINITIONS[msgid]
    return definition.length, definition.target_system, definition.target_component


def crc_extra(msgid: int) -> bytes:
    """The CRC extra byte of a message. Raises KeyError if the dialect lacks the message."""
    return _DEFINITIONS[msgid].crc_extra


def field_offset(msgid: int, field: str) -> int:
    """Offset of a field in the payload. Raises KeyError if the dialect lacks message or field."""
    offset: int = _FIELDS[msgid][field].start
    return offset


def field_bytes(frame: Frame, field: str) -> bytes:
    """Bytes of a field in the payload; an array as a whole. Raises KeyError if the dialect lacks message or field."""
    return frame.payload[_FIELDS[frame.msgid][field]]


def field_int(frame: Frame, field: str) -> int:
    """Value of an unsigned field. Raises KeyError if the dialect lacks message or field."""
    return int.from_bytes(field_bytes(frame, field), "little")


def field_float(frame: Frame, field: str) -> float:
    """Value of a 32-bit float field. Raises KeyError if the dialect lacks message or field."""
    (value,) = _FLOAT.unpack(field_bytes(frame, field))
    return float(value)


def target(frame: Frame) -> tuple[int, int] | None:
    """Target system and component of a frame (0 = all), or None if its message has no target.

    A message with a target system and no target component has target component 0.
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

#: Every byte with its bits in reverse order. MAVLink's CRC (CRC-16/MCRF4XX) is that of the standard library with
#: reversed bits of each byte and of the result.
REVERSED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def _crc_fits(raw: bytes, end: int, crc_extra: bytes) -> bool:
    data = raw[1:end] + crc_extra + raw[end : end + CRC_BYTES]  # any data followed by its CRC has the CRC 0
    return not crc_hqx(data.translate(REVERSED), 0xFFFF)


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
    """True if the MAVLink 1 header at `start` has more payload than its message."""
    definition = _DEFINITIONS.get(data[start + 5])
    return definition is not None and data[start + 1] > definition.length


def _build(raw: bytes, definition: _Definition | None) -> Frame:
    """Make the frame of `raw`, whose length and CRC are checked."""
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
    """Parse `raw` as exactly one frame.

    Returns None if it is no frame, not exactly one, has a bad CRC, or flags that are not understood. A frame of an
    unknown id is returned with `known` False, because its CRC cannot be checked. `proven`: the CRC is known to
    be right.
    """
    if type(raw) is not bytes:
        raw = bytes(raw)
    size = len(raw)
    if size >= HEADER_V2 + CRC_BYTES and raw[0] == MAGIC_V2:  # nearly every frame, so in one step
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
        # like Frame(...), without its function call
        return tuple.__new__(Frame, (raw, 2, msgid, sysid, compid, seq, signed, payload, True))
    if size < HEADER_V1 + CRC_BYTES or raw[0] != MAGIC_V1 or _frame_length(raw, 0) != size or _too_long(raw, 0):
        return None
    definition = _DEFINITIONS.get(raw[5])
    if definition is not None and not proven and not _crc_fits(raw, HEADER_V1 + raw[1], definition.crc_extra):
        return None
    return _build(raw, definition)


class FrameSplitter:
    """Finds the frames in one peer's byte stream. Use one splitter for each peer, because streams must not mix.

    `max_buffer` (bytes) limits the data of one `feed`; the rest is dropped and counted. `patience_s`: see rule 5.
    """

    def __init__(self, max_buffer: int = 65536, patience_s: float = PATIENCE_S) -> None:
        if max_buffer < MAX_FRAME_BYTES:
            raise ValueError(f"max_buffer = {max_buffer}: must be {MAX_FRAME_BYTES} or more, one whole frame")
        self.counters = FrameCounters()
        self._max_buffer = max_buffer
        self._patience_s = patience_s
        self._rest = b""
        #: arrival times of the waiting bytes: (offset of the first byte, time), in order
        self._arrived: list[tuple[int, float]] = []

    @property
    def waiting(self) -> int:
        """Bytes kept for the next `feed`."""
        return len(self._rest)

    def feed(self, data: bytes, now: float | None = None) -> list[Frame]:
        """Take the next bytes of the stream; return the frames that they complete, in order.

        `now` (seconds): while something is `waiting`, call this without data too. Give it always or never.
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
        """True if the byte at `start` (in kept and new data) arrived longer ago than a frame may take."""
        if now is None or start >= len(self._rest) or not self._arrived:
            return False
        _offset, at = self._arrived[bisect_right(self._arrived, (start, inf)) - 1]
        return now - at >= self._patience_s

    def _keep(self, buffer: bytes, position: int, now: float | None) -> None:
        """Keep the bytes from `position` on for the next call."""
        if position == len(buffer):
            self._rest = b""
            self._arrived = []
            return
        if now is not None:
            arrived = self._arrived
            if len(buffer) > len(self._rest):
                arrived = [*arrived, (len(self._rest), now)]
            first = bisect_right(arrived, (position, inf)) - 1
            self._arrived = [(max(0, offset - position), at) for offset, at in arrived[first:]]
        self._rest = buffer[position:]

# SPDX-License-Identifier: GPL-3.0-or-later

"""A serial line driven by bytes: noise, frames, damaged frames, pieces and pauses, as the splitter gets them.

A plan is a row of instructions: noise, a frame (whole, or in two pieces with a pause between them), a damaged frame, a
pause. Time goes in steps of `schedule.TICK_S`, and while something waits the splitter is asked at each, as the devices
are. What must hold:

* nothing raises, and what is kept is no longer than a frame;
* no frame is invented: each was sent, byte for byte, in the order of the bytes, no byte is in two, and its CRC is the
  one that pymavlink works out;
* a frame that comes 0.3 s after the last noise is there with its last byte;
* no frame is handed over more than 0.3 s after its last byte;
* a frame that came in one piece is handed over, unless bytes of it are in another frame, or in one of an id that nobody
  knows (`wire.frames`, rule 1).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.tools.schedule import TICK_S
from mavproxy_handover.wire.frames import MAX_FRAME_BYTES, Frame, FrameSplitter
from mavproxy_handover.wire.signing import sign
from tests.fuzz.reader import Reader

__all__ = ["DAMAGED", "DEAF_S", "FRAME", "NOISE", "PAUSE", "SPLIT", "KINDS", "Heard", "made", "run", "seeds"]

NOISE, FRAME, SPLIT, DAMAGED, PAUSE = range(5)
DEAF_S: Final = 0.3
#: a frame is taken for one piece though its halves come this far apart
_ONE_PIECE_S: Final = 0.2
#: times are sums of steps
_ROUNDING_S: Final = 1e-6


KINDS: Final = 6
_UNKNOWN: Final = 5


def made(kind: int, count: int) -> bytes:
    """What a program sends: short and long, both versions, signed, with magic bytes inside. Each `count` is another."""
    own = mavlink.MAVLink(None, 251, 190)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, count, 4, 3)
    if kind == 0:
        return bytes(beat.pack(own))
    if kind == 1:
        return bytes(beat.pack(own, True))
    if kind == 2:
        return bytes(mavlink.MAVLink_command_long_message(1, 1, 400, 0, count, 0, 0, 0, 0, 0, 1).pack(own))
    if kind == 3:
        payload = [0xFD, 0xFE, 0xFF, 0] * 31 + [*count.to_bytes(3, "little"), 1]
        return bytes(mavlink.MAVLink_tunnel_message(1, 191, 47116, 128, payload).pack(own))
    if kind == 4:
        signed = sign(bytes(beat.pack(own)), bytes(range(32)), 1, 37_506_240_000_000 + count)
        assert signed is not None
        return signed
    return b"\xfd\x03\x00\x00\x00\xfb\xbe\x31\xd4\x01" + count.to_bytes(3, "little") + b"\x07\x08"


@dataclass(slots=True)
class _Sent:
    """A frame that was sent whole: its place in the stream, and when its last byte came."""

    start: int
    end: int
    at: float


class Heard:
    """A splitter at the end of a line, and what must hold."""

    def __init__(self) -> None:
        self.now = 100.0
        self.frames: list[Frame] = []
        self._splitter = FrameSplitter()
        self._stream = bytearray()
        self._noise_at = -1.0
        #: where each frame that came out lies
        self._found: dict[int, int] = {}
        self._behind = 0
        self._sent: list[_Sent] = []

    def noise(self, data: bytes) -> None:
        if data:
            self._noise_at = self.now
            self._feed(data)

    def frame(self, kind: int, *, cut: int = 0, pause_s: float = 0.0) -> None:
        """A frame, with a pause behind its first bytes, `cut` of them."""
        raw = made(kind, len(self._stream))
        start, begun_at, cut = len(self._stream), self.now, cut % len(raw)
        # what bytes of noise took with them is noise from there on
        lost_at = [sent.at for sent in self._sent if self._found.get(sent.start) != sent.end]
        quiet = begun_at - max([self._noise_at, *lost_at]) > DEAF_S + _ROUNDING_S
        if cut:
            self._feed(raw[:cut])
            self.pause(pause_s)
        if kind == _UNKNOWN or self.now - begun_at > _ONE_PIECE_S + _ROUNDING_S:
            self._noise_at = self.now  # one that waits for what is behind it, or is given up
            self._feed(raw[cut:])
            return
        self._sent.append(_Sent(start, start + len(raw), self.now))
        self._feed(raw[cut:])
        if quiet:
            assert self._found.get(start) == start + len(raw), "deaf after noise"

    def pause(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until - _ROUNDING_S:
            self.now = min(self.now + TICK_S, until)
            if self._splitter.waiting:
                self._feed(b"")

    def end(self) -> None:
        """The line is silent from here on."""
        self.pause(2 * DEAF_S)
        assert self._splitter.waiting == 0
        counters = self._splitter.counters
        assert counters.frames == len(self.frames)
        known = sum(len(frame.raw) for frame in self.frames) + counters.garbage_bytes + counters.overflow_bytes
        assert known <= len(self._stream)
        assert counters.unknown_id or known == len(self._stream)
        for sent in self._sent:
            if self._found.get(sent.start) == sent.end:
                continue
            inside = any(start < sent.end and end > sent.start for start, end in self._found.items())
            assert inside or counters.unknown_id, "a frame is lost"

    def _feed(self, data: bytes) -> None:
        self._stream += data
        frames = self._splitter.feed(data, self.now)
        assert self._splitter.waiting <= MAX_FRAME_BYTES
        for frame in frames:
            self._check(frame)
        self.frames += frames

    def _check(self, frame: Frame) -> None:
        raw = frame.raw
        start = self._stream.find(raw, self._behind)
        assert start >= 0, "invented"
        for sent in self._sent:
            if sent.start == start:
                assert self.now - sent.at <= DEAF_S + _ROUNDING_S, "held back"
        self._behind = self._found[start] = start + len(raw)
        definition = mavlink.mavlink_map[frame.msgid]
        end = len(raw) - (15 if frame.signed else 2)
        crc = mavlink.x25crc(raw[1:end] + bytes([definition.crc_extra])).crc
        assert raw[end : end + 2] == crc.to_bytes(2, "little"), "CRC"


def seeds() -> Iterator[bytes]:
    """What made a line deaf once, and plain traffic."""
    for number in range(KINDS):
        yield bytes([FRAME, number, PAUSE, 4]) * 3
        yield bytes([NOISE, 3, 0xFD, 0xFF, 0, FRAME, number, PAUSE, 20, FRAME, number])
        yield bytes([DAMAGED, number, 1, 0x80, PAUSE, 7, FRAME, number])
        yield bytes([SPLIT, number, 5, 3, SPLIT, number, 9, 8, FRAME, number])
    yield bytes([NOISE, 12]) + b"\xfd\x20\x00\x00\x00\x01\x01\x31\xd4\x01\x00\x00" + bytes([FRAME, 0, FRAME, 2])
    yield bytes([NOISE, 40]) + b"\xfe\xfd" * 20 + bytes([PAUSE, 6, FRAME, 3, FRAME, 4])


def run(plan: bytes) -> Heard:
    """Carry a plan out; any exception is a finding."""
    reader, heard = Reader(plan), Heard()
    while reader.more():
        what = reader.byte() % 5
        if what == NOISE:
            heard.noise(reader.counted())
        elif what == PAUSE:
            heard.pause(reader.byte() % 32 * TICK_S / 2)
        else:
            kind = reader.byte() % KINDS
            if what == FRAME:
                heard.frame(kind)
            elif what == SPLIT:
                heard.frame(kind, cut=reader.byte(), pause_s=reader.byte() % 16 * TICK_S / 2)
            else:
                damaged = bytearray(made(kind, 0))
                damaged[reader.byte() % len(damaged)] ^= reader.byte() or 1
                heard.noise(bytes(damaged))
    heard.end()
    return heard

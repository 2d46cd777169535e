# SPDX-License-Identifier: GPL-3.0-or-later

"""Streams of guided targets, judged when the target changes and not frame by frame.

A program repeats a target many times a second, or moves it a little each time. To look where it lies with respect to
zones and fence costs a hundred times more than to pass the frame on. So what was found holds on:

1. A target that is within `NEAR_M` of the one that was judged last has its verdict, for `HOLDS_S`: the aircraft moves,
   and what it can reach changes.
2. What was judged less than `PAUSE_S` ago and is farther away waits for its turn: it is dropped. A stream repeats it,
   and none moves at 30 m/s. So whoever jumps to and fro costs no more than ten judgements a second.
3. One stream is one message of one station. Nothing that carries no place is judged, but for the height that wings
   take from a place on earth that is left out.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.intent import NO_HEIGHT, NO_PLACE, Aim, aim_of
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.modes import COPTER, Modes
from mavproxy_handover.wire.frames import Frame, field_offset

__all__ = ["HOLDS_S", "NEAR_M", "PAUSE_S", "TargetStreams"]

NEAR_M: Final = 3.0
HOLDS_S: Final = 1.0
PAUSE_S: Final = 0.1

_GLOBAL: Final[int] = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
_LOCAL: Final[int] = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
#: where both messages have the place, its type_mask and its frame
_PLACE: Final = field_offset(_LOCAL, "x")
_MASK: Final = field_offset(_LOCAL, "type_mask")
_FRAME: Final = field_offset(_LOCAL, "coordinate_frame")
#: the place's numbers, and how far away each is the same: metres, or 1e-7 degrees (of longitude it is less than that)
_NUMBERS: Final[Mapping[int, tuple[struct.Struct, float]]] = {
    _GLOBAL: (struct.Struct("<iif"), NEAR_M / 111_700.0 * 1e7),
    _LOCAL: (struct.Struct("<fff"), NEAR_M),
}


@dataclass(slots=True)
class _Judged:
    """The target that was judged last: its frame and numbers, when that was, and whether it passes."""

    frame: int = -1
    numbers: tuple[float, float, float] = (inf, inf, inf)
    at: float = -inf
    passes: bool = True


class TargetStreams:
    """The streams of the commander. Times are monotonic seconds."""

    def __init__(self) -> None:
        #: whether a target of a station may be flown to now
        self.judge: Callable[[Aim, int, float], bool] = lambda _aim, _station, _now: True
        self._streams: dict[tuple[int, int], _Judged] = {}

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float, modes: Modes = COPTER) -> Verdict:
        """The verdict on a frame of TARGET_MESSAGES that stands. `modes`: those of the aircraft's firmware."""
        msgid, payload = frame.msgid, frame.payload
        if payload[_MASK] & (NO_HEIGHT if modes.wings else NO_PLACE):
            return verdict
        judged = self._streams.get((station, msgid))
        if judged is None:
            judged = self._streams[station, msgid] = _Judged()
        unpack, near = _NUMBERS[msgid]
        numbers = first, second, third = unpack.unpack_from(payload, _PLACE)
        one, two, three = judged.numbers
        # written so that what is no number is never the same
        same = (
            abs(first - one) <= near
            and abs(second - two) <= near
            and abs(third - three) <= NEAR_M
            and payload[_FRAME] == judged.frame
        )
        if not same or now - judged.at >= HOLDS_S:
            if now - judged.at < PAUSE_S:
                return verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)
            aim = aim_of(frame, modes)
            judged.frame, judged.numbers, judged.at = payload[_FRAME], numbers, now
            judged.passes = aim is None or self.judge(aim, station, now)
        return verdict if judged.passes else verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)

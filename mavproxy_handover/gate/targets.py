# SPDX-License-Identifier: GPL-3.0-or-later

"""Streams of guided targets, judged when the target changes and not frame by frame.

A program repeats a target many times a second, or moves it a little each time. To look where it lies with respect to
zones and fence costs a hundred times more than to pass the frame on. So what was found holds on:

1. A target that is within `NEAR_M` of the one that was judged last has its verdict, for `HOLDS_S`: the aircraft moves,
   and what it can reach changes.
2. What was judged less than `PAUSE_S` ago and is farther away waits for its turn: it is dropped. A stream repeats it,
   and none moves at 30 m/s. So whoever jumps to and fro costs no more than ten judgements a second.
3. One stream is one message of one station. Nothing that carries no place is judged, but for the height that wings
   take whatever the mask leaves out.
4. A frame with a number that is none (NaN, infinite), in a field that the autopilot takes, is dropped. ArduCopter
   checks the velocity alone: one target with a NaN in its place ended its simulation with a floating point exception
   (4.7-dev).
5. FOLLOW_TARGET is a target too: the place of the system that is followed. The aircraft flies beside it, by FOLL_OFS.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.intent import NO_PLACE, Aim, aim_of
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.modes import COPTER, Modes
from mavproxy_handover.wire.frames import Frame, field_offset

__all__ = ["HOLDS_S", "NEAR_M", "PAUSE_S", "TargetStreams"]

NEAR_M: Final = 3.0
HOLDS_S: Final = 1.0
PAUSE_S: Final = 0.1

_GLOBAL: Final[int] = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
_LOCAL: Final[int] = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
_FOLLOW: Final[int] = mavlink.MAVLINK_MSG_ID_FOLLOW_TARGET
#: where both guided messages have the place, their type_mask and their frame
_PLACE: Final = field_offset(_LOCAL, "x")
_MASK: Final = field_offset(_LOCAL, "type_mask")
_FRAME: Final = field_offset(_LOCAL, "coordinate_frame")
_MASK_BITS: Final = struct.Struct("<H")
#: place, velocity, acceleration, yaw and its rate: what the autopilot takes of a guided message, and the bit of its
#: type_mask that leaves each out
_VALUES: Final[Mapping[int, struct.Struct]] = {_GLOBAL: struct.Struct("<ii9f"), _LOCAL: struct.Struct("<11f")}
_LEFT_OUT: Final = tuple(1 << bit for bit in (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11))
#: the place's numbers, where they are, and how far away each is the same: metres, or 1e-7 degrees (of longitude it is
#: less than that)
_NEAR_E7: Final = NEAR_M / 111_700.0 * 1e7
_NUMBERS: Final[Mapping[int, tuple[struct.Struct, int, float]]] = {
    _GLOBAL: (struct.Struct("<iif"), _PLACE, _NEAR_E7),
    _LOCAL: (struct.Struct("<fff"), _PLACE, NEAR_M),
    _FOLLOW: (struct.Struct("<iif"), field_offset(_FOLLOW, "lat"), _NEAR_E7),
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

    def __init__(self, passes: Callable[[Aim, int, float], bool]) -> None:
        """`passes`: whether a target of a station (system id) may be flown to now."""
        self._passes = passes
        self._streams: dict[tuple[int, int], _Judged] = {}

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float, modes: Modes = COPTER) -> Verdict:
        """The verdict on a frame of TARGET_MESSAGES that stands. `modes`: those of the aircraft's firmware."""
        msgid, payload = frame.msgid, frame.payload
        number = -1
        # wings add the height of a local target to their own, whatever its mask says: none is near another
        adds = modes.wings and msgid == _LOCAL
        if msgid != _FOLLOW:
            if _senseless(msgid, payload):
                return verdict._replace(fate=Fate.DROP, reason=GateReason.NO_NUMBER)
            number = payload[_FRAME]
            if not modes.wings and payload[_MASK] & NO_PLACE:
                return verdict
        judged = self._streams.get((station, msgid))
        if judged is None:
            judged = self._streams[station, msgid] = _Judged()
        unpack, place, near = _NUMBERS[msgid]
        near, near_m = (0.0, 0.0) if adds else (near, NEAR_M)
        numbers = first, second, third = unpack.unpack_from(payload, place)
        one, two, three = judged.numbers
        # written so that what is no number is never the same
        same = (
            abs(first - one) <= near
            and abs(second - two) <= near
            and abs(third - three) <= near_m
            and number == judged.frame
        )
        if not same or now - judged.at >= HOLDS_S:
            if now - judged.at < PAUSE_S:
                return verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)
            aim = aim_of(frame, modes)
            judged.frame, judged.numbers, judged.at = number, numbers, now
            judged.passes = False  # until it is known: if the judgement breaks, no copy passes by the verdict before
            judged.passes = aim is None or (aim.makes_sense and self._passes(aim, station, now))
        return verdict if judged.passes else verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)


def _senseless(msgid: int, payload: bytes) -> bool:
    """Whether a guided message holds a number that is none, in a field that it does not leave out."""
    values = _VALUES[msgid].unpack_from(payload, _PLACE)
    if isfinite(sum(values)):
        return False
    (mask,) = _MASK_BITS.unpack_from(payload, _MASK)
    return any(not isfinite(value) and not mask & bit for value, bit in zip(values, _LEFT_OUT, strict=True))

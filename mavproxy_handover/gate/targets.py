# SPDX-License-Identifier: GPL-3.0-or-later

"""Judges streams of guided targets when the target changes, not frame by frame.

A program repeats a target many times a second, or moves it a little each time. To compare a target with zones and fence
costs a hundred times more than to pass the frame on. So a verdict stays valid for a while
(`operator/checks/command_check.py` makes it):

1. A target within `NEAR_M` of the last judged one has the same verdict, for `HOLDS_S`: the aircraft moves, and what it
   can reach changes.
2. A target farther away that comes less than `PAUSE_S` after the last judgement is dropped. The stream repeats it, and
   no stream moves at 30 m/s. So a target that jumps to and fro costs at most ten judgements a second.
3. One stream is one message of one station. A frame without a place is not judged, except for the height that planes
   take whatever the mask says.
4. A frame with NaN or infinity in a field that the autopilot uses is dropped. ArduCopter checks only the velocity: one
   target with a NaN in its position ended its simulation with a floating point exception (4.7-dev).
5. FOLLOW_TARGET is a target too: the position of the system that the aircraft follows, beside it by FOLL_OFS.
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
from mavproxy_handover.vehicle.profiles import ASSUMED, Modes
from mavproxy_handover.wire.frames import Frame, field_offset

__all__ = ["HOLDS_S", "NEAR_M", "PAUSE_S", "TargetStreams"]

NEAR_M: Final = 3.0
HOLDS_S: Final = 1.0
PAUSE_S: Final = 0.1

_GLOBAL: Final[int] = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
_LOCAL: Final[int] = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
_FOLLOW: Final[int] = mavlink.MAVLINK_MSG_ID_FOLLOW_TARGET
#: offsets of the place, the type_mask and the frame in both guided messages
_PLACE: Final = field_offset(_LOCAL, "x")
_MASK: Final = field_offset(_LOCAL, "type_mask")
_FRAME: Final = field_offset(_LOCAL, "coordinate_frame")
_MASK_BITS: Final = struct.Struct("<H")
#: place, velocity, acceleration, yaw and yaw rate in a guided message, and the bits of its type_mask that leave them
#: out
_VALUES: Final[Mapping[int, struct.Struct]] = {_GLOBAL: struct.Struct("<ii9f"), _LOCAL: struct.Struct("<11f")}
_LEFT_OUT: Final = tuple(1 << bit for bit in (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11))
#: format and offset of the place, and the largest difference that counts as the same: metres, or 1e-7 degrees (fewer
#: metres of longitude)
_NEAR_E7: Final = NEAR_M / 111_700.0 * 1e7
_NUMBERS: Final[Mapping[int, tuple[struct.Struct, int, float]]] = {
    _GLOBAL: (struct.Struct("<iif"), _PLACE, _NEAR_E7),
    _LOCAL: (struct.Struct("<fff"), _PLACE, NEAR_M),
    _FOLLOW: (struct.Struct("<iif"), field_offset(_FOLLOW, "lat"), _NEAR_E7),
}


@dataclass(slots=True)
class _Judged:
    """The last judged target of a stream: its frame and numbers, the time, and whether it passes."""

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

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float, modes: Modes = ASSUMED.gate) -> Verdict:
        """The verdict on a frame of TARGET_MESSAGES that stands. `modes`: those of the aircraft's firmware."""
        msgid, payload = frame.msgid, frame.payload
        number = -1
        # wings add the height of a local target to their own, whatever its mask says: none is near another
        adds = modes.takes_heights and msgid == _LOCAL
        if msgid != _FOLLOW:
            if _senseless(msgid, payload):
                return verdict._replace(fate=Fate.DROP, reason=GateReason.NO_NUMBER)
            number = payload[_FRAME]
            if not modes.takes_heights and payload[_MASK] & NO_PLACE:
                return verdict
        judged = self._streams.get((station, msgid))
        if judged is None:
            judged = self._streams[station, msgid] = _Judged()
        unpack, place, near = _NUMBERS[msgid]
        near, near_m = (0.0, 0.0) if adds else (near, NEAR_M)
        numbers = first, second, third = unpack.unpack_from(payload, place)
        one, two, three = judged.numbers
        # a NaN is never the same
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
            judged.passes = False  # if the judgement raises, no copy passes by the verdict before
            judged.passes = aim is None or (aim.makes_sense and self._passes(aim, station, now))
        return verdict if judged.passes else verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)


def _senseless(msgid: int, payload: bytes) -> bool:
    """Whether a guided message has NaN or infinity in a field that its mask does not leave out."""
    values = _VALUES[msgid].unpack_from(payload, _PLACE)
    if isfinite(sum(values)):
        return False
    (mask,) = _MASK_BITS.unpack_from(payload, _MASK)
    return any(not isfinite(value) and not mask & bit for value, bit in zip(values, _LEFT_OUT, strict=True))

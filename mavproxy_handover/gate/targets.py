# SPDX-License-Identifier: GPL-3.0-or-later

"""Streams of guided targets, judged when the target changes and not frame by frame.

A program repeats a target many times a second, or moves it a little each time. To look where it lies with respect to
zones and fence costs a hundred times more than to pass the frame on. So what was found holds on:

1. A target that is within `NEAR_M` of the one that was judged last has its verdict, for `HOLDS_S`: the aircraft moves,
   and what it can reach changes.
2. What was judged less than `PAUSE_S` ago and is farther away waits for its turn: it is dropped. A stream repeats it,
   and none moves at 30 m/s. So whoever jumps to and fro costs no more than ten judgements a second.
3. One stream is one message of one station. Nothing that carries no place is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.gate.intent import Aim, aim_of
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.wire.frames import Frame

__all__ = ["HOLDS_S", "NEAR_M", "PAUSE_S", "TargetStreams"]

NEAR_M: Final = 3.0
HOLDS_S: Final = 1.0
PAUSE_S: Final = 0.1
#: the same in degrees, anywhere: of longitude it is less than that
_NEAR_DEG: Final = NEAR_M / 111_700.0


@dataclass(slots=True)
class _Judged:
    """The target that was judged last, when, and whether it passes."""

    aim: Aim | None = None
    at: float = -inf
    passes: bool = True


def _same(first: Aim, second: Aim | None) -> bool:
    if second is None or first.frame != second.frame:
        return False
    near = _NEAR_DEG if first.on_earth else NEAR_M
    return (
        abs(first.first - second.first) <= near
        and abs(first.second - second.second) <= near
        and abs(first.third - second.third) <= NEAR_M
    )


class TargetStreams:
    """The streams of the commander. Times are monotonic seconds."""

    def __init__(self) -> None:
        #: whether a target of a station may be flown to now
        self.judge: Callable[[Aim, int, float], bool] = lambda _aim, _station, _now: True
        self._streams: dict[tuple[int, int], _Judged] = {}

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        """The verdict on a frame of TARGET_MESSAGES that stands."""
        aim = aim_of(frame)
        if aim is None:
            return verdict
        judged = self._streams.setdefault((station, frame.msgid), _Judged())
        if now - judged.at >= HOLDS_S or not _same(aim, judged.aim):
            if now - judged.at < PAUSE_S:
                return verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)
            judged.aim, judged.at = aim, now
            judged.passes = self.judge(aim, station, now)
        return verdict if judged.passes else verdict._replace(fate=Fate.DROP, reason=GateReason.SITUATION)

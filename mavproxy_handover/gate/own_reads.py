# SPDX-License-Identifier: GPL-3.0-or-later

"""Keeps the answers to the companion's own reads of parameters from the stations.

ArduPilot answers a read by name with PARAM_VALUE of index 65535, without an address. MAVSDK counts such a value as one
of its own download, never asks for another one, and waits forever. So an answer to the companion stays aboard. Rules:

1. One question of the companion keeps one value aboard, within `ANSWER_S`.
2. A value that differs from the last one goes to the stations, so that no station misses a change.
3. When a station reads or sets a parameter, the companion's questions for it are forgotten: the station gets its
   answer.

Time is an argument (monotonic seconds).
"""

from __future__ import annotations

from collections import deque
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.frames import Frame, field_bytes, field_int

__all__ = ["ANSWER_S", "OwnReads"]

ANSWER_S: Final = 1.0
#: the index of a value that was asked for by name, or sent without a question
_NO_INDEX: Final = 0xFFFF
#: the most names that are remembered: several times what an autopilot has
_MOST: Final = 8192
#: the most questions for one parameter that wait for their answers
_MOST_QUESTIONS: Final = 8

_READ: Final[int] = mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ
_SET: Final[int] = mavlink.MAVLINK_MSG_ID_PARAM_SET


class OwnReads:
    """The open questions of the companion, and the last value of each parameter."""

    def __init__(self) -> None:
        #: name of the parameter -> the times of its questions that wait for an answer
        self._asked_at: dict[bytes, deque[float]] = {}
        self._values: dict[bytes, bytes] = {}

    def companion_sent(self, frame: Frame, now: float) -> None:
        """Note a frame of the companion to the autopilot."""
        if frame.msgid == _READ:
            self._asked_at.setdefault(field_bytes(frame, "param_id"), deque(maxlen=_MOST_QUESTIONS)).append(now)

    def station_sent(self, frame: Frame) -> None:
        """Note a frame of a station to the autopilot."""
        if frame.msgid in (_READ, _SET):
            self._asked_at.pop(field_bytes(frame, "param_id"), None)

    def keeps(self, frame: Frame, now: float) -> bool:
        """Whether this PARAM_VALUE of the autopilot answers only the companion."""
        name, value = field_bytes(frame, "param_id"), field_bytes(frame, "param_value")
        before = self._values.get(name, value)
        if len(self._values) >= _MOST:
            self._values.clear()
        self._values[name] = value
        if field_int(frame, "param_index") != _NO_INDEX:
            return False
        asked_at = self._asked_at.get(name)
        while asked_at:
            if now - asked_at.popleft() <= ANSWER_S:
                return value == before
        return False

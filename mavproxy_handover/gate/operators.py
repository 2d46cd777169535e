# SPDX-License-Identifier: GPL-3.0-or-later

"""Notes what stations say about their operators for Remote ID: OPEN_DRONE_ID_SYSTEM, _SYSTEM_UPDATE and _OPERATOR_ID.

The verdict stays: only the commander's frames go to the autopilot. What an observer's program says counts once it has
authority: then the companion sends it at once (`core/remote_id.py`). A fault here costs the note only.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Final

from mavproxy_handover.core.remote_id import OperatorPlace, Operators
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float
from mavproxy_handover.wire.message_ids import MESSAGE_IDS, message_ids

__all__ = ["REMOTE_ID_MESSAGES", "OperatorNotes"]

REMOTE_ID_MESSAGES: Final = message_ids(
    "OPEN_DRONE_ID_SYSTEM", "OPEN_DRONE_ID_SYSTEM_UPDATE", "OPEN_DRONE_ID_OPERATOR_ID"
)
_OPERATOR_ID: Final = MESSAGE_IDS["OPEN_DRONE_ID_OPERATOR_ID"]
#: verdicts on a frame of the station itself
_GENUINE: Final = frozenset((GateReason.ALLOWED, GateReason.NOT_IN_CONTROL))


class OperatorNotes:
    """Of one vehicle. `fault` is told what broke, and where."""

    def __init__(self, operators: Operators, fault: Callable[[str, str], None]) -> None:
        self._operators = operators
        self._fault = fault

    def note(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        """Note a frame. Returns the verdict as it is."""
        if verdict.fate in (Fate.FORWARD, Fate.DROP) and verdict.reason in _GENUINE:
            try:
                self._note(frame, station, now)
            except Exception:
                self._fault("Remote ID of a station", traceback.format_exc(limit=-3))
        return verdict

    def _note(self, frame: Frame, station: int, now: float) -> None:
        if frame.msgid == _OPERATOR_ID:
            raw = field_bytes(frame, "operator_id").partition(b"\0")[0]
            text = raw.decode("ascii", "replace")
            if text and text.isascii() and text.isprintable():
                self._operators.said_id(station, text)
            return
        lat, lon = (
            int.from_bytes(field_bytes(frame, name), "little", signed=True) / 1e7
            for name in ("operator_latitude", "operator_longitude")
        )
        height_m = field_float(frame, "operator_altitude_geo")
        # zeros: the program has no position
        if (lat or lon) and abs(lat) <= 90.0 and abs(lon) <= 180.0 and -1000.0 <= height_m <= 31_767.0:
            self._operators.said_place(station, OperatorPlace(lat, lon, height_m, live=True), now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""How much a station that does not command may ask, and when it has to wait. Applied to what `judge` lets through.

Everybody may read, and everybody may speak to the companion. But the autopilot has one channel and one open file, and
the companion one journal, so:

1. What goes to the autopilot, and what the companion itself has to answer, is limited for each station that does not
   command to `per_second`, with a reserve of `burst`; more is dropped. The two are counted apart: who asks too much of
   the autopilot can still take part in a transfer.
2. While the commander has a file open for writing, and for `PRIORITY_S` after whatever it asked of file transfer,
   nobody else uses that: the autopilot closes the file of a session that has paused for 3 s as soon as another one asks
   for anything, and closing applies what is half-written; and one that pauses less keeps the commander out.
3. Of one station only `SENDERS` senders (system, component) reach the autopilot: it remembers twenty, for ever, and a
   component of the aircraft that speaks up later would not be found any more.

The commander is not limited. Memory is bounded by the number of stations. Time is an argument (monotonic seconds).

Sources: ArduPilot's GCS_FTP.cpp (FTP_SESSION_TIMEOUT), MAVLink_routing.h (MAVLINK_MAX_ROUTES).
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.frames import Frame

__all__ = ["BURST", "PER_SECOND", "PRIORITY_S", "SENDERS", "Questions"]

PER_SECOND: Final = 50.0
#: a mission, or the parameters that a list left out, asked for one by one on a fast link
BURST: Final = 200.0
#: three times as long as the autopilot keeps the session of somebody who is silent
PRIORITY_S: Final = 10.0
#: the station's program, and what is behind it
SENDERS: Final = 4

_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_COUNTED: Final = {
    (Fate.FORWARD, Access.READ),
    (Fate.CONSUME, Access.TRANSFER),
    (Fate.CONSUME, Access.CONTROL),
}


class Questions:
    """Follows what stations ask. `flusher` knows the files that are open for writing."""

    def __init__(self, flusher: FlushTracker, per_second: float = PER_SECOND, burst: float = BURST) -> None:
        self._flusher = flusher
        self._per_second = per_second
        self._burst = burst
        #: by station and by what becomes of it: what it may still send, and when that was counted
        self._left: dict[tuple[int, Fate], tuple[float, float]] = {}
        self._commander_at = -math.inf  #: its last request of file transfer
        #: by station: who has asked the autopilot
        self._senders: dict[int, set[tuple[int, int]]] = {}

    def commander_sent(self, frame: Frame, now: float) -> None:
        """A frame of the commander went to the autopilot (rule 2)."""
        if frame.msgid == _FTP:
            self._commander_at = now

    def limit(self, frame: Frame, verdict: Verdict, station_sysid: int, commander: int | None, now: float) -> Verdict:
        """The verdict that stands: `verdict`, or that the station has to wait."""
        if station_sysid == commander or (verdict.fate, verdict.access) not in _COUNTED:
            return verdict
        known = verdict.fate is not Fate.FORWARD or self._knows(station_sysid, (frame.sysid, frame.compid))
        if not known or not self._affords(station_sysid, verdict.fate, now):
            return verdict._replace(fate=Fate.DROP, reason=GateReason.TOO_MANY)
        if frame.msgid == _FTP and commander is not None and self._commander_needs_files(commander, now):
            return verdict._replace(fate=Fate.REFUSE, reason=GateReason.FILE_BUSY)
        return verdict

    def _commander_needs_files(self, commander: int, now: float) -> bool:
        return now - self._commander_at < PRIORITY_S or self._flusher.writes(commander)

    def _knows(self, station_sysid: int, sender: tuple[int, int]) -> bool:
        senders = self._senders.setdefault(station_sysid, set())
        if sender not in senders and len(senders) < SENDERS:
            senders.add(sender)
        return sender in senders

    def _affords(self, station_sysid: int, fate: Fate, now: float) -> bool:
        key = station_sysid, fate
        left, counted_at = self._left.get(key, (self._burst, now))
        left = min(self._burst, left + max(0.0, now - counted_at) * self._per_second)
        affords = left >= 1.0
        self._left[key] = left - 1.0 if affords else left, now
        return affords

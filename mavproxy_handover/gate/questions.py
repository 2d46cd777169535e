# SPDX-License-Identifier: GPL-3.0-or-later

"""How much a station that does not command may ask, and when it has to wait. Applied to what `judge` lets through.

Everybody may read, and everybody may speak to the companion. But the autopilot has one channel and one open file, and
the companion one journal, so (`BUDGETS`):

1. What goes to the autopilot is limited for each station that does not command, and for all of them together: by the
   number of questions, and for bulk reads by the seconds for which they slow down what the commander hears
   (`SLOW_S`; two at the same time do it once). What the companion itself has to answer is limited for each station, and
   apart: who asks too much of the autopilot can still take part in a transfer, and nobody keeps another one from it.
   What is over a limit is dropped.
2. While the commander has a file open for writing, and for `PRIORITY_S` after whatever it asked of file transfer,
   nobody else uses that of the autopilot, which closes the file of a session that has paused for 3 s as soon as another
   one asks for anything, and closing applies what is half-written; and one that pauses less keeps the commander out.
3. An observer may end the reading of the file that it opened last, unless another station has opened one since. Else
   the file stays open, and the autopilot refuses everybody else's requests until it was left alone for 3 s.
4. Of one station only `SENDERS` senders (system, component) reach the autopilot: it remembers twenty, for ever, and a
   component of the aircraft that speaks up later would not be found any more.

The commander is not limited. Memory is bounded by the number of stations. Time is an argument (monotonic seconds).

Sources: ArduPilot's GCS_FTP.cpp (FTP_SESSION_TIMEOUT), MAVLink_routing.h (MAVLINK_MAX_ROUTES), GCS_Common.cpp
(get_reschedule_interval_ms).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.flush import FlushTracker
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.file_transfer import head_of
from mavproxy_handover.wire.frames import Frame, field_bytes
from mavproxy_handover.wire.ids import FTP_OPEN_READ, FTP_TERMINATE

__all__ = ["BUDGETS", "PRIORITY_S", "SENDERS", "SLOW_LIST_S", "SLOW_S", "Budget", "Questions", "Sort"]

#: three times as long as the autopilot keeps the session of somebody who is silent
PRIORITY_S: Final = 10.0
#: the station's program, and what is behind it
SENDERS: Final = 4

#: how long the autopilot's streams are slow after it has answered a bulk read
SLOW_S: Final = 1.0
#: ... and while it sends all its parameters: a thousand and more, on a fast line
SLOW_LIST_S: Final = 10.0


class Sort(Enum):
    """What is counted apart."""

    QUESTION = "question"  #: to the autopilot, one by one
    SLOWNESS = "slowness"  #: seconds for which bulk reads slow down the autopilot's streams
    COMPANION = "companion"  #: to the companion, one by one


@dataclass(frozen=True, slots=True)
class Budget:
    """What one station may take (so much a second, and a reserve), and all that do not command together."""

    per_second: float
    reserve: float
    all_per_second: float = 0.0
    all_reserve: float = math.inf  #: without an end


BUDGETS: Final[Mapping[Sort, Budget]] = {
    # the reserve: a mission, or the parameters that a list left out, asked for one by one on a fast link
    Sort.QUESTION: Budget(25.0, 200.0, 50.0, 400.0),
    # the reserve: six stations' parameter lists, one after the other; then a tenth of the time
    Sort.SLOWNESS: Budget(0.1, 6 * SLOW_LIST_S, 0.1, 12 * SLOW_LIST_S),
    Sort.COMPANION: Budget(50.0, 200.0),
}

_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_LISTS: Final = (mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST, mavlink.MAVLINK_MSG_ID_PARAM_EXT_REQUEST_LIST)
_COUNTED: Final[Mapping[tuple[Fate, Access | None], Sort]] = {
    (Fate.FORWARD, Access.READ): Sort.QUESTION,
    (Fate.FORWARD, Access.BULK): Sort.QUESTION,
    (Fate.CONSUME, Access.RALLY_READ): Sort.COMPANION,
    (Fate.CONSUME, Access.TRANSFER): Sort.COMPANION,
    (Fate.CONSUME, Access.CONTROL): Sort.COMPANION,
}


@dataclass(slots=True)
class _Purse:
    """What is left, and when that was counted."""

    left: float
    counted_at: float

    def fill(self, per_second: float, reserve: float, now: float) -> None:
        self.left = min(reserve, self.left + max(0.0, now - self.counted_at) * per_second)
        self.counted_at = now


class Questions:
    """Follows what stations ask. `flusher` knows the files that are open for writing."""

    def __init__(self, flusher: FlushTracker, budgets: Mapping[Sort, Budget] = BUDGETS) -> None:
        self._flusher = flusher
        self._budgets = budgets
        #: by station (None: all together) and sort
        self._purses: dict[tuple[int | None, Sort], _Purse] = {}
        #: until when what observers have asked for slows down the autopilot's streams
        self._slow_until = -math.inf
        self._commander_at = -math.inf  #: its last request of file transfer
        #: system, component and session of the observer that has opened a file for reading, and nobody has since
        self._reader: tuple[int, int, int] | None = None
        #: by station: who has asked the autopilot
        self._senders: dict[int, set[tuple[int, int]]] = {}

    def commander_sent(self, frame: Frame, now: float) -> None:
        """A frame of the commander went to the autopilot (rule 2)."""
        if frame.msgid == _FTP:
            self._commander_at, self._reader = now, None

    def limit(self, frame: Frame, verdict: Verdict, station_sysid: int, commander: int | None, now: float) -> Verdict:
        """The verdict that stands: `verdict`, or that the station has to wait; or that it may end its own reading."""
        reads = frame.msgid == _FTP and station_sysid != commander
        if reads and verdict.reason is GateReason.NOT_IN_CONTROL and self._ends_own(frame):
            verdict = verdict._replace(fate=Fate.FORWARD, access=Access.READ, reason=GateReason.ALLOWED)
        sort = _COUNTED.get((verdict.fate, verdict.access))
        if station_sysid == commander or sort is None:
            return verdict
        known = sort is Sort.COMPANION or self._knows(station_sysid, (frame.sysid, frame.compid))
        costs = {sort: 1.0}
        slow_until = self._slow_until
        if verdict.access is Access.BULK:
            slow_until = max(slow_until, now + (SLOW_LIST_S if frame.msgid in _LISTS else SLOW_S))
            costs[Sort.SLOWNESS] = slow_until - max(self._slow_until, now)
        if not known or not self._affords(station_sysid, costs, now):
            return verdict._replace(fate=Fate.DROP, reason=GateReason.TOO_MANY)
        autopilots = frame.msgid == _FTP and sort is not Sort.COMPANION
        if autopilots and commander is not None and self._commander_needs_files(commander, now):
            return verdict._replace(fate=Fate.REFUSE, reason=GateReason.FILE_BUSY)
        self._slow_until = slow_until
        if autopilots:
            self._note_reader(frame)
        return verdict

    def _ends_own(self, frame: Frame) -> bool:
        head = head_of(field_bytes(frame, "payload"))
        return head.opcode == FTP_TERMINATE and self._reader == (frame.sysid, frame.compid, head.session)

    def _note_reader(self, frame: Frame) -> None:
        head = head_of(field_bytes(frame, "payload"))
        if head.opcode == FTP_OPEN_READ:
            self._reader = frame.sysid, frame.compid, head.session
        elif head.opcode == FTP_TERMINATE:
            self._reader = None

    def _commander_needs_files(self, commander: int, now: float) -> bool:
        return now - self._commander_at < PRIORITY_S or self._flusher.writes(commander)

    def _knows(self, station_sysid: int, sender: tuple[int, int]) -> bool:
        senders = self._senders.setdefault(station_sysid, set())
        if sender not in senders and len(senders) < SENDERS:
            senders.add(sender)
        return sender in senders

    def _affords(self, station_sysid: int, costs: Mapping[Sort, float], now: float) -> bool:
        """Whether station and all together have that much left; if so, it is taken."""
        taken: list[tuple[_Purse, float]] = []
        for sort, cost in costs.items():
            budget = self._budgets[sort]
            for who, per_second, reserve in (
                (station_sysid, budget.per_second, budget.reserve),
                (None, budget.all_per_second, budget.all_reserve),
            ):
                purse = self._purses.setdefault((who, sort), _Purse(reserve, now))
                purse.fill(per_second, reserve, now)
                taken.append((purse, cost))
        if any(purse.left < cost for purse, cost in taken):
            return False
        for purse, cost in taken:
            purse.left -= cost
        return True

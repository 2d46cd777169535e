# SPDX-License-Identifier: GPL-3.0-or-later

"""Limits what a station without authority may ask. Applied to frames that `judge` lets pass.

Every station may read, and every station may send messages to the companion. But the autopilot has one channel and one
open file, and the companion has one journal. So (`BUDGETS`):

1. Questions to the autopilot are limited for each station that does not command, and for all of them together: by their
   number, and bulk reads also by the seconds for which they slow down the commander's telemetry (`SLOW_S`; two at the
   same time count once; a flight log counts none, because it is read on the ground). Questions to the companion are
   limited for each station separately: a station that asks the autopilot too much can still take part in a transfer,
   and no station keeps another one from it. Frames over a limit are dropped.
2. The commander has priority for file transfer: while it has a file open for writing, and for `PRIORITY_S` after its
   last request. In that time no other station may use file transfer of the autopilot. If a session pauses for 3
   seconds, the autopilot closes its file on the next request of another sender. Closing applies what is half-written.
   Within the 3 seconds the session of another sender would keep the commander out.
3. An observer may end the reading of the file that it opened last, unless another station has opened one since.
   Otherwise the file stays open, and the autopilot refuses the requests of all other senders for 3 s after the last
   one.
4. Only `SENDERS` senders (system, component) of one station reach the autopilot: it remembers twenty routes forever,
   and would not find a component of the aircraft that appears later.

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

__all__ = ["ASKED", "BUDGETS", "PRIORITY_S", "SENDERS", "SLOW_LIST_S", "SLOW_S", "Budget", "Questions", "Sort"]

#: three times the autopilot's time-out of a session without requests
PRIORITY_S: Final = 10.0
#: the station's program, and programs that connect through it
SENDERS: Final = 4

#: how long the autopilot's streams are slow after it has answered a bulk read
SLOW_S: Final = 1.0
#: ... and while it sends all its parameters: a thousand and more, on a fast line
SLOW_LIST_S: Final = 10.0


class Sort(Enum):
    """Kinds of cost, each with its own budget."""

    QUESTION = "question"  #: to the autopilot: their number
    SLOWNESS = "slowness"  #: seconds for which bulk reads slow down the autopilot's streams
    COMPANION = "companion"  #: to the companion: their number

    #: as in `Access`
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class Budget:
    """The budget of one station (a rate and a reserve), and of all stations without authority together."""

    per_second: float
    reserve: float
    all_per_second: float = 0.0
    all_reserve: float = math.inf  #: no limit


BUDGETS: Final[Mapping[Sort, Budget]] = {
    # the reserve: a mission, or the parameters that a list left out, asked for one by one on a fast link
    Sort.QUESTION: Budget(25.0, 200.0, 50.0, 400.0),
    # the reserve: six stations' parameter lists, one after the other; then a tenth of the time
    Sort.SLOWNESS: Budget(0.1, 6 * SLOW_LIST_S, 0.1, 12 * SLOW_LIST_S),
    Sort.COMPANION: Budget(50.0, 200.0),
}

#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_NOT_IN_CONTROL: Final = GateReason.NOT_IN_CONTROL
_BULK: Final = Access.BULK
_COMPANION: Final = Sort.COMPANION
_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_LISTS: Final = (mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST, mavlink.MAVLINK_MSG_ID_PARAM_EXT_REQUEST_LIST)
_COUNTED: Final[Mapping[tuple[Fate, Access | None], Sort]] = {
    (Fate.FORWARD, Access.READ): Sort.QUESTION,
    (Fate.FORWARD, Access.BULK): Sort.QUESTION,
    (Fate.FORWARD, Access.LOG): Sort.QUESTION,
    (Fate.CONSUME, Access.RALLY_READ): Sort.COMPANION,
    (Fate.CONSUME, Access.TRANSFER): Sort.COMPANION,
    (Fate.CONSUME, Access.CONTROL): Sort.COMPANION,
}
#: the classes of questions
ASKED: Final = frozenset(access for _fate, access in _COUNTED)


@dataclass(slots=True)
class _Purse:
    """The rest of a budget, and when it was counted."""

    left: float
    counted_at: float

    def fill(self, per_second: float, reserve: float, now: float) -> None:
        self.left = min(reserve, self.left + max(0.0, now - self.counted_at) * per_second)
        self.counted_at = now


class Questions:
    """Counts the questions of stations. `flusher` knows the files that are open for writing."""

    def __init__(self, flusher: FlushTracker, budgets: Mapping[Sort, Budget] = BUDGETS) -> None:
        self._flusher = flusher
        self._budgets = budgets
        #: the rests, by station (None: all together) and kind
        self._purses: dict[tuple[int | None, Sort], _Purse] = {}
        #: until when reads of observers slow down the autopilot's streams
        self._slow_until = -math.inf
        self._commander_at = -math.inf  #: its last request of file transfer
        #: system, component and session of the observer that opened a file for reading last
        self._reader: tuple[int, int, int] | None = None
        #: that file is a flight log
        self._log_open = False
        #: by station: its senders that have asked the autopilot
        self._senders: dict[int, set[tuple[int, int]]] = {}

    def commander_sent(self, frame: Frame, now: float) -> None:
        """Note a frame of the commander that went to the autopilot (rule 2)."""
        if frame.msgid == _FTP:
            self._commander_at, self._reader = now, None

    def limit(self, frame: Frame, verdict: Verdict, station_sysid: int, commander: int | None, now: float) -> Verdict:
        """The verdict that stands: `verdict`, or that the station must wait, or that it may end its own reading."""
        reads = frame.msgid == _FTP and station_sysid != commander
        if reads and verdict.reason is _NOT_IN_CONTROL and self._ends_own(frame):
            verdict = verdict._replace(fate=Fate.FORWARD, access=Access.READ, reason=GateReason.ALLOWED)
        sort = _COUNTED.get((verdict.fate, verdict.access))
        if station_sysid == commander or sort is None:
            return verdict
        known = sort is _COMPANION or self._knows(station_sysid, (frame.sysid, frame.compid))
        costs = {sort: 1.0}
        slow_until = self._slow_until
        if verdict.access is _BULK and not self._reads_log(frame):
            slow_until = max(slow_until, now + (SLOW_LIST_S if frame.msgid in _LISTS else SLOW_S))
            costs[Sort.SLOWNESS] = slow_until - max(self._slow_until, now)
        if not known or not self._affords(station_sysid, costs, now):
            return verdict._replace(fate=Fate.DROP, reason=GateReason.TOO_MANY)
        autopilots = frame.msgid == _FTP and sort is not _COMPANION
        if autopilots and commander is not None and self._commander_needs_files(commander, now):
            return verdict._replace(fate=Fate.REFUSE, reason=GateReason.FILE_BUSY)
        self._slow_until = slow_until
        if autopilots:
            self._note_reader(frame, verdict)
        return verdict

    def _ends_own(self, frame: Frame) -> bool:
        head = head_of(field_bytes(frame, "payload"))
        return head.opcode == FTP_TERMINATE and self._reader == (frame.sysid, frame.compid, head.session)

    def _reads_log(self, frame: Frame) -> bool:
        """Whether a frame goes on to read the flight log that its sender has opened."""
        if frame.msgid != _FTP or self._reader is None or not self._log_open:
            return False
        return self._reader[:2] == (frame.sysid, frame.compid)

    def _note_reader(self, frame: Frame, verdict: Verdict) -> None:
        head = head_of(field_bytes(frame, "payload"))
        if head.opcode == FTP_OPEN_READ:
            self._reader = frame.sysid, frame.compid, head.session
            self._log_open = verdict.access is Access.LOG
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
        """Whether the budgets of the station and of all together are sufficient. If so, the costs are deducted."""
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

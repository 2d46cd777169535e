# SPDX-License-Identifier: GPL-3.0-or-later

"""Keeps exactly one point in the autopilot's rally list: the return site, for every return.

Rules
-----
* The list holds one point, never none and never two. When ArduCopter replaces one point by another, it keeps the old
  point until the new list is complete. So an interrupted upload never leaves the list empty.
* The point is written when it changes, at most every `WRITE_S`. If a return waits for it, it is written at once.
* A point counts when it was read back equal. The list is read again every `READ_S` and when RALLY_TOTAL changes, since
  other programs on board can write it. Then the point is written again, and people are told.
* After a restart of the autopilot or of the companion, the list is read before anything is written. An autopilot that
  has just started has no room for lists and answers with an error, so it is read `START_S` later.
* When a return begins, nothing is written until the place that it flies to is known: it is what the list holds.
* An upload that another program has open, or left open, ends after at most 8 s; then the next try follows. An
  interrupted upload of the companion ends when the companion begins a new one.

Sources: ArduPilot's MissionItemProtocol.cpp, AP_Rally.cpp.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mavproxy_handover.mission.items import RallyPoint, alike
from mavproxy_handover.vehicle.mission_protocol import LOADING, MissionProtocol
from mavproxy_handover.wire.conversation import Asking, Conversation, Conversations

__all__ = ["START_S", "RallyWriter"]

WRITE_S: Final = 5.0
READ_S: Final = 10.0
START_S: Final = 10.0
_AGAIN_S: Final = 8.0
#: name of the conversation
_NAME: Final = "rally"
_COUNTER: Final = "RALLY_TOTAL"


class RallyWriter:
    """Keeps the wanted point in the autopilot's rally list. Times are monotonic seconds.

    `holds` is called with each point that was written and read back. `failed` is called with the reason of a failed
    write, `changed` when another program has written the list.
    """

    def __init__(
        self,
        sysid: int,
        conversations: Conversations,
        holds: Callable[[RallyPoint, float], None],
        failed: Callable[[str], None],
        changed: Callable[[float], None],
    ) -> None:
        self._lists = MissionProtocol(sysid)
        self._conversations = conversations
        self._holds = holds
        self._failed = failed
        self._changed = changed
        #: the point that the list held when it was read last; None: the list held no point, or several
        self.held: RallyPoint | None = None
        #: the list has been read, or is written without waiting for that (`hurry`)
        self.known = False
        #: the last write failed, and the list has not held the wanted point since
        self.failing = False
        self._wanted: RallyPoint | None = None
        #: the list is read from time to time and kept, from the first `forget` on
        self._ours = False
        #: nothing is written until a point is wanted again
        self._rests = False
        #: the point that is being written
        self._writes: RallyPoint | None = None
        self._read_at = self._write_at = -math.inf

    @property
    def settled(self) -> bool:
        """The list holds the wanted point, or no point is wanted."""
        return self._wanted is None or (self.held is not None and alike(self.held, self._wanted))

    def want(self, point: RallyPoint) -> None:
        """Set the point that the list must hold."""
        self._wanted, self._rests = point, False
        self.failing = self.failing and not self.settled

    def rest(self) -> None:
        """Write nothing until a point is wanted again. What is being written is written to its end."""
        self._rests = True

    def forget(self) -> None:
        """The content of the list is not known: read it at the next tick, and keep it from then on."""
        self.known, self._ours, self._read_at = False, True, -math.inf
        self._drop()

    def restarted(self, now: float) -> None:
        """The autopilot has just started: read the list when it is ready."""
        self.forget()
        self._read_at = now + START_S

    def counted(self, name: str, now: float) -> None:
        """The autopilot has sent the value of a parameter, of any name: RALLY_TOTAL counts the points of the list."""
        if name == _COUNTER and self.known and _NAME not in self._conversations:
            self._read_at = min(self._read_at, now)

    def hurry(self, now: float) -> None:
        """A return waits: write the wanted point now, without reading the list first. It counts as known from now."""
        self.known, self._rests, self._write_at = True, False, -math.inf
        self._read_at = max(self._read_at, now + READ_S)
        self.tick(now)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        talks, wanted = self._conversations, self._wanted
        if LOADING in talks:
            self._drop()
        elif _NAME in talks:
            if self._writes is not None and wanted is not None and not alike(self._writes, wanted):
                self._drop()  # it is the wrong point by now; the same sender may begin again
        elif self._ours and now >= self._read_at:
            self._read(now)
        elif wanted is not None and self._may_write and not self.settled and now >= self._write_at:
            self._write(wanted, now)

    @property
    def _may_write(self) -> bool:
        return self.known and not self._rests

    def _drop(self) -> None:
        if self._conversations.drop(_NAME) and self._writes is not None:
            self._writes = self.held = None  # the list holds the old point or the new one

    def _read(self, now: float) -> None:
        self._read_at = now + READ_S

        def done(talk: Conversation, now: float) -> None:
            if talk.failure is not None:
                self._read_at = now + _AGAIN_S
                return
            before, self.held = self.held, talk.result
            self.known, first = True, not self.known
            if (
                not first
                and before is not None
                and not self.settled
                and (self.held is None or not alike(self.held, before))
            ):
                self._write_at = now
                self._changed(now)

        self._conversations.begin(_NAME, self._lists.held_rally(), done, now)

    def _write(self, point: RallyPoint, now: float) -> None:
        self._writes, self._write_at = point, now + WRITE_S

        def done(talk: Conversation, now: float) -> None:
            self._writes = None
            if talk.failure is not None:
                self.held = None
                self.failing = True
                self._read_at = self._write_at = now + _AGAIN_S
                self._failed(talk.failure)
                return
            self.held, self.failing, self._read_at = point, False, now + READ_S
            self._holds(point, now)

        self._conversations.begin(_NAME, self._written(point), done, now)

    def _written(self, point: RallyPoint) -> Asking:
        yield from self._lists.write_rally((point,))
        yield from self._lists.compare_rally((point,))

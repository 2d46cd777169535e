# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's rally list holds one point, always: the place where a return goes, whoever orders it.

Rules
-----
* One point, never none and never two. Of a list of one, replaced by a list of one, ArduCopter keeps the old point until
  the new one is there: whatever cuts the upload, a return has a place to go to.
* Written when it is another one, and not oftener than every `WRITE_S`; what a return waits for is written at once.
* What was written counts once it was read back equal. It is read again every `READ_S`, and when RALLY_TOTAL changes,
  for others on board can write the list too: then it is written again, and people are told.
* What holds after a restart, of the autopilot or of the companion, is read before anything is written. An autopilot
  that has just started has no room for lists yet, and tells everybody so: it is read `START_S` later.
* An upload that somebody else has open, or left open, ends after 8 s at the latest: then the next try. Our own that was
  cut is begun anew by the same sender, which ends it.

Sources: ArduPilot's MissionItemProtocol.cpp, AP_Rally.cpp.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mavproxy_handover.autopilot.mission_protocol import MissionProtocol
from mavproxy_handover.mission.items import RallyPoint, alike
from mavproxy_handover.wire.conversation import Asking, Conversation, Conversations

__all__ = ["START_S", "RallyKeeper"]

WRITE_S: Final = 5.0
READ_S: Final = 10.0
START_S: Final = 10.0
_AGAIN_S: Final = 8.0
#: names of the conversations: ours, and the one that writes a whole plan, this list with it
_NAME: Final = "rally"
_LOADING: Final = "load"
_COUNTER: Final = "RALLY_TOTAL"


class RallyKeeper:
    """Keeps `wanted` in the autopilot's rally list. Times are monotonic seconds.

    `holds` is told of each point that was written and read back, `failed` of a write that came to nothing, in words,
    `changed` that somebody else has written the list.
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
        #: the one point that the list held when it was read last; None: not one point
        self.held: RallyPoint | None = None
        #: the list has been read
        self.known = False
        #: the last write came to nothing, and what is wanted is not held since
        self.failing = False
        self._wanted: RallyPoint | None = None
        self._ours = False
        #: what is being written
        self._writes: RallyPoint | None = None
        self._read_at = self._write_at = -math.inf

    @property
    def settled(self) -> bool:
        """The list holds what is wanted, or nothing is."""
        return self._wanted is None or (self.held is not None and alike(self.held, self._wanted))

    def want(self, point: RallyPoint) -> None:
        """The list is to hold this point."""
        self._wanted = point
        self.failing = self.failing and not self.settled

    def forget(self) -> None:
        """What it holds is not known: it is read, at the next tick, and kept from then on."""
        self.known, self._ours, self._read_at = False, True, -math.inf
        self._drop()

    def restarted(self, now: float) -> None:
        """The autopilot has just started: what it holds is read once it is ready."""
        self.forget()
        self._read_at = now + START_S

    def counted(self, name: str, now: float) -> None:
        """A parameter of the autopilot was set, or told."""
        if name == _COUNTER and self.known and _NAME not in self._conversations:
            self._read_at = min(self._read_at, now)

    def hurry(self, now: float) -> None:
        """A return waits: what is wanted is written now, whatever holds."""
        self.known, self._write_at = True, -math.inf
        self._read_at = max(self._read_at, now + READ_S)
        self.tick(now)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        talks, wanted = self._conversations, self._wanted
        if _LOADING in talks:
            self._drop()
        elif _NAME in talks:
            if self._writes is not None and wanted is not None and not alike(self._writes, wanted):
                self._drop()  # it is the wrong one by now; the same sender may begin anew
        elif self._ours and now >= self._read_at:
            self._read(now)
        elif wanted is not None and self.known and not self.settled and now >= self._write_at:
            self._write(wanted, now)

    def _drop(self) -> None:
        if self._conversations.drop(_NAME) and self._writes is not None:
            self._writes = self.held = None  # the old one or the new one

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

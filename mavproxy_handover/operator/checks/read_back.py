# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads mission and geofence back before a flight, to check that they are those that were loaded or judged.

They can be changed without the companion: by USB, by another telemetry port, by a switch of the pilot. So START, and
each command that arms or takes off, reads them back first. ArduPilot 4.5 to 4.7 sends no digest of a list (none of
MAVLink's opaque ids). So the lists themselves are read, several items at once.

* Lists that were read back equal count for `GOOD_S`, so that AUTO right after arming is not delayed.
* A command that arms waits at most `WAIT_S`: motors must not start long after the command. The reading continues, and
  the same command sent again finds it complete.
* A later disarm of the commander withdraws the commands that wait: the motors stay off.
* The rally list is the companion's own and is read every ten seconds anyway (`operator/return_site/rally_writer.py`).

Times are monotonic seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from math import inf
from typing import Final

from mavproxy_handover.mission.plan import Route
from mavproxy_handover.vehicle.procedures import Procedures
from mavproxy_handover.wire.conversation import Asking, AutopilotError, Conversation, Conversations

__all__ = ["GOOD_S", "WAIT_S", "WITHDRAWN", "NotHeldError", "ReadBack"]

GOOD_S: Final = 10.0
WAIT_S: Final = 3.0
WITHDRAWN: Final = "withdrawn by a later disarm"
#: commands that wait at once
_MOST: Final = 8
#: name of the conversation
_CHECK: Final = "mission read back"

#: is called with the trouble in words, "" if there is none
Then = Callable[[str, float], None]


class NotHeldError(AutopilotError):
    """The autopilot holds another mission or geofence than it did; the text says what differs."""


class ReadBack:
    """Reads back the lists of one vehicle. Times are monotonic seconds."""

    def __init__(self, conversations: Conversations, procedures: Callable[[], Procedures]) -> None:
        self._conversations = conversations
        self._procedures = procedures
        #: the route that the autopilot must hold; None: not known, so nothing is compared
        self._route: Route | None = None
        #: how the autopilot's lists differed at the last comparison; "": they did not, or the difference was taken
        self._difference = ""
        #: when the lists were read back equal last
        self._equal_at = -inf
        #: commands that wait: their callbacks, and since when
        self._waiting: dict[Hashable, tuple[Then, float]] = {}

    def asking(self) -> Asking:
        """Compare, as a part of START. Raises NotHeldError, and NoAnswer if the autopilot does not answer."""
        if self._route is None:
            return
        try:
            yield from self._procedures().holds(self._route)
        except AutopilotError as error:
            self._difference = str(error)
            raise NotHeldError(self._difference) from None

    def pop_difference(self) -> str:
        """How the lists of the autopilot differ from the mission, once; "" if no difference was found."""
        difference, self._difference = self._difference, ""
        return difference

    def ask(self, command: Hashable, then: Then, now: float) -> None:
        """Tell `then`, now or soon, whether `command` may begin a flight."""
        if now - self._equal_at < GOOD_S:
            then("", now)
            return
        if command in self._waiting or len(self._waiting) >= _MOST:
            return
        self._waiting[command] = then, now
        if _CHECK not in self._conversations:
            self._conversations.begin(_CHECK, self.asking(), self._done, now)

    def set_route(self, route: Route | None, now: float) -> None:
        """The autopilot holds another route; None: not known, or it is being written.

        Earlier results do not count, and no command that waits begins a flight.
        """
        self._route, self._difference = route, ""
        self._equal_at = -inf
        if self._conversations.drop(_CHECK):
            self._tell("the mission is being written", now)

    def refuse(self, now: float) -> None:
        """The autopilot holds another mission: no command that waits begins a flight."""
        self._tell("the mission was changed without the companion", now)

    def withdraw(self, now: float) -> None:
        """The commander disarms: no command that waits begins a flight any more."""
        self._tell(WITHDRAWN, now)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        late = [command for command, (_then, since) in self._waiting.items() if now - since >= WAIT_S]
        for command in late:
            then, _since = self._waiting.pop(command)
            then("the mission is still being read back: send it again", now)

    def _done(self, talk: Conversation, now: float) -> None:
        if talk.failure is None:
            self._equal_at = now
            self._tell("", now)
        elif not isinstance(talk.error, NotHeldError):  # else `refuse` answers them, after the mission was dropped
            self._tell(f"the mission cannot be read back: {talk.failure}", now)

    def _tell(self, trouble: str, now: float) -> None:
        waiting, self._waiting = self._waiting, {}
        for then, _since in waiting.values():
            then(trouble, now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Tracks what the programs at the stations understand, and what they get instead of what they do not.

A program that does not know the result of a command sees no answer at all: it waits, asks again, and some programs end.
So a result of INSTEAD goes only to senders that have shown that they know it; all others get the other result of its
row. NOT_IN_CONTROL is a new result of the operator-control standard. Rules:

1. A sender shows it by a message of our own dialect, or by a request of operator control in the layout of 2026.
   `operator/requests/operator_control.py` tells the layouts apart: a program with an older one may not know the result.
2. Each sender (system and component) shows it for itself: another program that connects through the station may be of
   another kind.
3. It is valid only while the station is heard. After `ANEW_S` without a heartbeat another program may have the same
   ids, so a sender that comes back must show it again. Ours does within a second, by its answer to CONNECT. A DENIED
   too many costs nothing, but a NOT_IN_CONTROL too many may end a program.
4. The vehicle's configuration may set it instead, for each station.

Memory is bounded: `MOST` senders of a station. Times are monotonic seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.ids import NOT_IN_CONTROL

__all__ = ["ANEW_S", "INSTEAD", "MOST", "POLICIES", "Dialect", "ClientCapabilities"]

ANEW_S: Final = 5.0
MOST: Final = 16
#: what the configuration may say of a station; the first one is the default
POLICIES: Final = ("auto", "always", "never")

#: Results that only senders get that have shown that they know them: what all others get.
INSTEAD: Final[Mapping[int, int]] = {NOT_IN_CONTROL: mavlink.MAV_RESULT_DENIED}

_Sender = tuple[int, int]  #: system, component


class Dialect(Enum):
    """The dialect that a sender has shown, and how its operator asks for control with it."""

    NONE = ""
    STANDARD = "request control"
    OURS = "'handover request'"


class ClientCapabilities:
    """The dialects of the senders of one station."""

    def __init__(self, policy: str = POLICIES[0]) -> None:
        assert policy in POLICIES
        self._policy = policy
        #: the dialect of each sender, and when it last showed it
        self._shown: dict[_Sender, tuple[Dialect, float]] = {}

    def show(self, sender: _Sender, dialect: Dialect, now: float) -> None:
        """Note that a sender uses a dialect. A sender of our dialect that also uses the standard stays ours."""
        known = self._shown.get(sender)
        if known is None and len(self._shown) >= MOST:
            return
        ours = known is not None and known[0] is Dialect.OURS
        self._shown[sender] = (Dialect.OURS if ours else dialect, now)

    def of(self, sender: _Sender) -> Dialect:
        """The dialect that a sender has shown."""
        known = self._shown.get(sender)
        return Dialect.NONE if known is None else known[0]

    @property
    def ours(self) -> bool:
        """Whether a program of the station has shown our dialect."""
        return any(dialect is Dialect.OURS for dialect, _at in self._shown.values())

    def knows_not_in_control(self, sender: _Sender) -> bool:
        """Whether NOT_IN_CONTROL may go to this sender."""
        if self._policy != POLICIES[0]:
            return self._policy == "always"
        return sender in self._shown

    def result(self, sender: _Sender, result: int) -> int:
        """The result that goes to this sender: one that it knows."""
        return result if result not in INSTEAD or self.knows_not_in_control(sender) else INSTEAD[result]

    def silence_ends(self, now: float) -> None:
        """Forget what was shown before the station was silent for `ANEW_S`. To be called when it is heard again."""
        self._shown = {sender: known for sender, known in self._shown.items() if now - known[1] < ANEW_S}

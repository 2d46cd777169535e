# SPDX-License-Identifier: GPL-3.0-or-later

"""Who has shown that it understands NOT_IN_CONTROL, the young result of the operator-control standard.

A program that does not know it takes it for no answer at all: it waits, asks again, and some end there. So it goes to
those that have shown to know it, and everybody else gets DENIED. Rules:

1. It is shown by a message of our own dialect, or by a request of operator control that is certainly in the layout of
   2026 (`operator/operator_control.py`): who has an older one may not know the result.
2. It is shown by a sender (system and component) for itself: a program behind a station's own may be of another kind.
3. It is kept no longer than the station is heard. After `ANEW_S` of silence another program may sit there, under the
   same ids, so who comes back has to show it anew; ours does within a second, by its answer to CONNECT. A DENIED too
   many costs nothing, a NOT_IN_CONTROL too many may cost a program.
4. The vehicle's configuration may say it instead, station by station.

Memory is bounded: `MOST` senders of a station. Times are monotonic seconds.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

__all__ = ["ANEW_S", "MOST", "POLICIES", "Tongue", "Tongues"]

ANEW_S: Final = 5.0
MOST: Final = 16
#: what the configuration may say of a station, the word without one first
POLICIES: Final = ("auto", "always", "never")

_Sender = tuple[int, int]  #: system, component


class Tongue(Enum):
    """What a sender has shown to speak, and how its operator asks for control there."""

    NONE = ""
    STANDARD = "request control"
    OURS = "'handover request'"


class Tongues:
    """The senders of one station."""

    def __init__(self, policy: str = POLICIES[0]) -> None:
        assert policy in POLICIES
        self._policy = policy
        #: what each has shown, and when it did last
        self._shown: dict[_Sender, tuple[Tongue, float]] = {}

    def show(self, sender: _Sender, tongue: Tongue, now: float) -> None:
        """A sender speaks it. Who speaks our dialect may use the standard as well: it is ours all the same."""
        known = self._shown.get(sender)
        if known is None and len(self._shown) >= MOST:
            return
        ours = known is not None and known[0] is Tongue.OURS
        self._shown[sender] = (Tongue.OURS if ours else tongue, now)

    def of(self, sender: _Sender) -> Tongue:
        """What a sender has shown."""
        known = self._shown.get(sender)
        return Tongue.NONE if known is None else known[0]

    @property
    def ours(self) -> bool:
        """Whether a program of the station has shown to speak our dialect."""
        return any(tongue is Tongue.OURS for tongue, _at in self._shown.values())

    def knows_not_in_control(self, sender: _Sender) -> bool:
        """Whether NOT_IN_CONTROL may go to it."""
        if self._policy != POLICIES[0]:
            return self._policy == "always"
        return sender in self._shown

    def silence_ends(self, now: float) -> None:
        """The station is heard again after `ANEW_S`: what was shown before counts no more."""
        self._shown = {sender: known for sender, known in self._shown.items() if now - known[1] < ANEW_S}

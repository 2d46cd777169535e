# SPDX-License-Identifier: GPL-3.0-or-later

"""Which operator is on duty at this station: sign-on, sign-off, and the change of shift. Pure: time is an argument.

Rules that live here:

1. `handover operator NAME` signs an operator on. If another operator is on duty, it shows how each aircraft is, and the
   next operator confirms that with the same command within CONFIRM_S. Then the shift has changed.
2. `handover operator off` signs off. It is refused while an aircraft in flight is commanded from here, or is about to
   be. Then the aircraft is handed over first, or the next operator signs on.
3. If the operator on duty signs on again, the change of shift is cancelled.
4. A station with `require_operator` is manned only while an operator is on duty. An unmanned station is no partner for
   a handover, and START, REQUEST and ACCEPT are refused here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

__all__ = ["CONFIRM_S", "NEEDS_OPERATOR", "OFF", "Change", "Duty", "Outcome", "is_name"]

#: time (s) in which the next operator confirms the briefing
CONFIRM_S: Final = 120.0
#: commands that an unmanned station refuses
NEEDS_OPERATOR: Final = ("start", "request", "accept")
#: the word that signs off, in place of a name
OFF: Final = "off"
#: letters of any language, digits, and what names are joined with
_NAME: Final = re.compile(r"[^\W_][\w .'-]{0,29}")


def is_name(text: str) -> bool:
    """Whether an operator may be called so."""
    return text != OFF and _NAME.fullmatch(text) is not None


class Change(Enum):
    """Effect of a command `handover operator`."""

    TOLD = "nothing changed"
    BRIEFED = "the next operator is briefed"
    ON = "an operator signed on"
    OFF = "the operator signed off"
    SHIFT = "the shift changed"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Effect of a command, and the line for the operator. `before`: the operator who was on duty."""

    change: Change
    text: str
    before: str = ""


class Duty:
    """`required`: the station's `require_operator`."""

    def __init__(self, required: bool) -> None:
        self.required = required
        #: the operator on duty; "" if none is
        self.name = ""
        self._next = ""
        self._next_until = -inf

    def next_one(self, now: float) -> tuple[str, float]:
        """The next operator, who has to confirm the briefing, and the end of the time for that; "": there is none."""
        return (self._next, self._next_until) if now < self._next_until else ("", -inf)

    @property
    def manned(self) -> bool:
        """Whether the station may take an aircraft."""
        return bool(self.name) or not self.required

    def command(self, words: str, now: float, flown: str) -> Outcome:
        """`handover operator WORDS`. `flown`: names of the aircraft in flight that are commanded from here, or
        are about to be; "" without one."""
        name = " ".join(words.split())
        if not name:
            return Outcome(Change.TOLD, self._state())
        if name == OFF:
            return self._off(flown)
        if not is_name(name):
            return Outcome(Change.TOLD, f"{name!r} is no name (allowed: 1 to 30 letters, digits, blanks, . ' -)")
        if name == self.name:
            if self._next:
                self._next, self._next_until = "", -inf
                return Outcome(Change.TOLD, f"{name} stays on duty.")
            return Outcome(Change.TOLD, f"{name} is on duty already.")
        if not self.name:
            return self._on(name, Change.ON, f"{name} is on duty.")
        if self._next == name and now < self._next_until:
            before = self.name
            return self._on(name, Change.SHIFT, f"{name} is on duty, after {before}.")
        self._next, self._next_until = name, now + CONFIRM_S
        text = f"Read how it is, then type 'handover operator {name}' once more. {self.name} is on duty until then."
        return Outcome(Change.BRIEFED, text, self.name)

    def _state(self) -> str:
        if self.name:
            return f"{self.name} is on duty."
        hint = "'handover operator NAME' signs on."
        return (
            f"No operator is on duty: this station takes no aircraft. {hint}"
            if self.required
            else (f"No operator has signed on. {hint}")
        )

    def _on(self, name: str, change: Change, text: str) -> Outcome:
        before, self.name = self.name, name
        self._next, self._next_until = "", -inf
        return Outcome(change, text, before)

    def _off(self, flown: str) -> Outcome:
        if not self.name:
            return Outcome(Change.TOLD, self._state())
        if flown:
            text = (
                f"{self.name} stays on duty: {flown} flies under this station's command, or is about to. Hand it over "
                "first ('handover give STATION'), or let the next operator sign on."
            )
            return Outcome(Change.TOLD, text)
        before, self.name = self.name, ""
        return Outcome(Change.OFF, f"{before} has signed off.", before)

# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle has decided about what is wrong: told the operator once, with what he may do, and shown while it is
in force.

HANDOVER_DECISION is repeated with the same number while the decision lasts. After a restart of the companion the
numbers begin anew, so a number counts as known together with its words.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from enum import Enum
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import DECISIONS
from gcs_module.events import Notice
from mavproxy_handover.core.model import FlightAction

__all__ = ["Decisions", "Who", "told"]

#: how the vehicle begins what it says in a rehearsal
_REHEARSED: Final = "REHEARSAL: "
_OVER: Final[int] = mavlink.HANDOVER_ACTION_NONE
#: words that were told of late, as STATUSTEXT brings them too
_TOLD: Final = 8


class Who(Enum):
    """Who commands, as seen from a station."""

    NOBODY = "nobody"
    THIS = "this station"
    OTHER = "another station"


#: what is done, for people; {place} is where a return goes
_DONE: Final[Mapping[FlightAction, str]] = {
    FlightAction.WARN: "",
    FlightAction.TRANSFER: "Authority is on its way to another station.",
    FlightAction.HOLD: "It holds inside coverage.",
    FlightAction.CONTINUE: "It flies on through the gap that its mission declares.",
    FlightAction.RETURN: "RTL{place}.",
    FlightAction.LAND: "It lands where it is.",
}
_TAKE: Final = "'handover request' takes over when it is in your zone."
#: what an operator may do about it, by who commands
_MAY: Final[Mapping[tuple[FlightAction, Who], str]] = {
    (FlightAction.HOLD, Who.THIS): "'handover give STATION' hands it over.",
    (FlightAction.HOLD, Who.OTHER): _TAKE,
    (FlightAction.RETURN, Who.NOBODY): _TAKE,
    (FlightAction.RETURN, Who.THIS): "'handover resume' goes on once that is over.",
    (FlightAction.RETURN, Who.OTHER): "",
    (FlightAction.LAND, Who.NOBODY): _TAKE,
    (FlightAction.LAND, Who.THIS): "You command: choose another mode if it must not land there.",
}


def told(action: FlightAction, wrong: str, place: str, who: Who) -> str:
    """What is wrong, what is done, and what the operator may do."""
    done = _DONE[action].format(place=f" to {place}" if place else "")
    return " ".join(words for words in (f"{wrong}.", done, _MAY.get((action, who), "")) if words)


def _text(raw: bytes | str) -> str:
    return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw


class Decisions:
    """The last one of one vehicle."""

    def __init__(self) -> None:
        self._known: tuple[int, str] | None = None
        self._told: deque[str] = deque(maxlen=_TOLD)
        #: the vehicle's sentence of what is in force; "": nothing is wrong
        self.text = ""
        #: what is done; None: nothing is wrong, or not known by its number here
        self.action: FlightAction | None = None

    def told(self, text: str) -> bool:
        """Whether these are the words of a decision that was told of late: they may be longer than what it can hold."""
        return any(text.startswith(known) for known in self._told)

    def on_message(self, m: Any, who: Who) -> Notice | None:
        """A HANDOVER_DECISION; returns what to tell the operator, None if it is told already."""
        text = _text(m.text)
        known = m.number, text
        if known == self._known:
            return None
        self._known = known
        if text:
            self._told.append(text)
        if m.action == _OVER:
            self.text, self.action = "", None
            return Notice("decision_over", text)
        self.text = text
        self.action = action = FlightAction(m.action) if m.action in list(FlightAction) else None
        if action is None:  # of a newer version: its own words have to do
            return Notice("decision", text, DECISIONS[FlightAction.RETURN])
        if text.startswith(_REHEARSED):  # of what is not done, they say it best
            return Notice("decision", text, DECISIONS[action])
        return Notice("decision", told(action, _text(m.figures) or text, _text(m.place), who), DECISIONS[action])

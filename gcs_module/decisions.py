# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle has decided about what is wrong: told the operator once, with what he may do, and shown while it is
in force.

The sentence is the vehicle's, one for every operator: action, place, figures, why something is withheld. How it is
done differs with the kind of aircraft, of which nothing is said here. HANDOVER_DECISION is repeated with the same
number while the decision lasts. After a restart of the companion the numbers begin anew, so a number counts as known
together with its words.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import DECISIONS
from gcs_module.events import Notice
from mavproxy_handover.core.common.model import FlightAction

__all__ = ["Decisions", "Who", "told"]

#: how the vehicle begins what it says in a rehearsal
_REHEARSED: Final = "REHEARSAL: "
_OVER: Final[int] = mavlink.HANDOVER_ACTION_NONE
#: words that were told of late, as STATUSTEXT brings them too
_TOLD: Final = 8
#: so many bytes of a sentence may be all that its message could hold: 160, less what a cut character leaves free
_CUT: Final = 157


class Who(Enum):
    """Who commands, as seen from a station."""

    NOBODY = "nobody"
    THIS = "this station"
    OTHER = "another station"


_TAKE: Final = "'handover request' takes over when it is in your zone."
#: what an operator may do about it, by who commands
_MAY: Final[Mapping[tuple[FlightAction, Who], str]] = {
    (FlightAction.HOLD, Who.THIS): "'handover give STATION' hands it over.",
    (FlightAction.HOLD, Who.OTHER): _TAKE,
    (FlightAction.RETURN, Who.NOBODY): _TAKE,
    (FlightAction.RETURN, Who.THIS): "'handover resume' goes on once that is over.",
    (FlightAction.RETURN, Who.OTHER): "",
    (FlightAction.LAND, Who.NOBODY): _TAKE,
    (FlightAction.LAND, Who.THIS): "You command: choose another mode if it must not land.",
}


def told(action: FlightAction, text: str, who: Who) -> str:
    """The vehicle's sentence, and what the operator may do."""
    end = "" if text.endswith(".") else "."
    return f"{text}{end} {_MAY.get((action, who), '')}".rstrip()


def _text(raw: bytes | str) -> str:
    return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw


class Decisions:
    """The last one of one vehicle. `said`: its words in STATUSTEXT that begin so and are not told yet, "" if there are
    none."""

    def __init__(self, said: Callable[[str], str]) -> None:
        self._said = said
        self._known: tuple[int, str] | None = None
        self._told: deque[str] = deque(maxlen=_TOLD)
        #: the vehicle's sentence of what is in force; "": nothing is wrong
        self.text = ""
        #: what is done; None: nothing is wrong, or not known by its number here
        self.action: FlightAction | None = None

    def told(self, text: str) -> bool:
        """Whether these are the words of a decision that was told of late."""
        return text in self._told

    def _whole(self, text: str) -> str:
        """All of a sentence. What is longer than its message is whole in STATUSTEXT, which is said first."""
        return text if len(text.encode()) < _CUT else self._said(text) or f"{text}..."

    def on_message(self, m: Any, who: Who) -> Notice | None:
        """A HANDOVER_DECISION; returns what to tell the operator, None if it is told already."""
        text = _text(m.text)
        known = m.number, text
        if known == self._known:
            return None
        self._known = known
        text = self._whole(text)
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
        return Notice("decision", told(action, text, who), DECISIONS[action])

# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's decision about what is wrong.

It is told to the operator once, with the possible commands, and shown while it is in force.

The sentence is the vehicle's and the same for every operator: action, place, figures, why something is withheld. The
way in which a kind of aircraft carries it out is not told here. HANDOVER_DECISION is repeated with the same number
while the decision lasts. After a restart of the companion the numbers start again, so a decision is known by its number
and its text together.
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

#: the beginning of the vehicle's sentences in a rehearsal
_REHEARSED: Final = "REHEARSAL: "
_OVER: Final[int] = mavlink.HANDOVER_ACTION_NONE
#: texts told recently, which STATUSTEXT repeats
_TOLD: Final = 8
#: a sentence with this many bytes may be cut: 160 fit, less the rest of a cut character
_CUT: Final = 157


class Who(Enum):
    """Which station commands, seen from this one."""

    NOBODY = "nobody"
    THIS = "this station"
    OTHER = "another station"


_TAKE: Final = "When it is in your zone, type 'handover request' to take over."
_WATCH: Final = "Another station commands: this one may not act."
#: whether this station may act, and the possible commands, by the action and by which station commands
_MAY: Final[Mapping[tuple[FlightAction, Who], str]] = {
    (FlightAction.HOLD, Who.THIS): "Type 'handover give STATION' to hand it over.",
    (FlightAction.HOLD, Who.OTHER): _TAKE,
    (FlightAction.RETURN, Who.NOBODY): f"No station commands. {_TAKE}",
    (FlightAction.RETURN, Who.THIS): "You command. When the cause is over, 'handover resume' continues the mission.",
    (FlightAction.RETURN, Who.OTHER): _WATCH,
    (FlightAction.LAND, Who.NOBODY): f"No station commands. {_TAKE}",
    (FlightAction.LAND, Who.THIS): "You command: choose another mode if it must not land.",
    (FlightAction.LAND, Who.OTHER): _WATCH,
}
#: the beginning of a return whose place the vehicle does not name
_NO_PLACE: Final = "RETURN."


def told(action: FlightAction, text: str, who: Who) -> str:
    """The vehicle's sentence, and what the operator may do."""
    end = "" if text.endswith(".") else "."
    return f"{text}{end} {_MAY.get((action, who), '')}".rstrip()


def _placed(text: str, site: str) -> str:
    """The vehicle's sentence; a return without a place gets it. `site`: the return site in force, "" not known."""
    if not text.startswith(_NO_PLACE):
        return text
    place = f"RETURN to {site}." if site else "RETURN. The autopilot chooses home or a rally point."
    return place + text.removeprefix(_NO_PLACE)


def _text(raw: bytes | str) -> str:
    return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw


class Decisions:
    """The last decision of one vehicle. `said`: takes the text with this beginning from the STATUSTEXTs that wait; ""
    if there is none."""

    def __init__(self, said: Callable[[str], str]) -> None:
        self._said = said
        self._known: tuple[int, str] | None = None
        self._told: deque[str] = deque(maxlen=_TOLD)
        #: the vehicle's sentence about the decision in force; "": nothing is wrong
        self.text = ""
        #: the action in force; None: nothing is wrong, or the action's number is not known here
        self.action: FlightAction | None = None

    def told(self, text: str) -> bool:
        """Whether this is the text of a recent decision."""
        return text in self._told

    def _whole(self, text: str) -> str:
        """The complete sentence. If it is longer than its message, STATUSTEXT has brought it completely before."""
        return text if len(text.encode()) < _CUT else self._said(text) or f"{text}..."

    def on_message(self, m: Any, who: Who, site: str = "") -> Notice | None:
        """A HANDOVER_DECISION; returns the line for the operator, None if it is told already.

        `site`: the name of the return site, by the vehicle's last status; "": not known.
        """
        text = _text(m.text)
        known = m.number, text
        if known == self._known:
            return None
        self._known = known
        text = self._whole(text)
        self._told.append(text)
        text = _placed(text, site)
        if m.action == _OVER:
            self.text, self.action = "", None
            return Notice("decision_over", text)
        self.text = text
        self.action = action = FlightAction(m.action) if m.action in list(FlightAction) else None
        if action is None:  # an action of a newer version: use its text alone
            return Notice("decision", text, DECISIONS[FlightAction.RETURN])
        if text.startswith(_REHEARSED):  # in a rehearsal nothing is done: no command to offer
            return Notice("decision", text, DECISIONS[action])
        return Notice("decision", told(action, text, who), DECISIONS[action])

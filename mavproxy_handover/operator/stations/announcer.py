# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells every station what was decided: HANDOVER_DECISION for our module, STATUSTEXT for every program.

STATUSTEXT is sent once, because programs show it each time it comes. HANDOVER_DECISION has a number by which a station
recognises it. It is repeated while the decision is in force: a link may lose it, and a station may come later. A change
of commander is a text only, because AUTHORITY_STATUS and CONTROL_STATUS repeat it.

Programs choose by the severity what they speak and in which colour they show it. QGroundControl speaks NOTICE and
above. `SEVERITIES` and `REHEARSAL` have all severities but one: the reason of a refusal is a WARNING to the station
that asked (`operator/stations/sender.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Advise, Announce, RehearsalMoved
from mavproxy_handover.core.common.levels import DECISION_LEVELS
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.wire import status
from mavproxy_handover.wire.texts import COMMANDS_NOW, SEVERITY

__all__ = ["COMMANDER", "REHEARSAL", "SEVERITIES", "Announcer"]

#: time (s) between two repetitions, and the number of messages about the end of a decision
_AGAIN_S: Final = 1.5
_ENDS: Final = 3

#: another station has authority, or no station
COMMANDER: Final[int] = mavlink.MAV_SEVERITY_NOTICE
#: decision -> its severity; None: nothing is wrong any more
SEVERITIES: Final[Mapping[FlightAction | None, int]] = {
    action: SEVERITY[level] for action, level in DECISION_LEVELS.items()
}

#: whether a rehearsal has begun, and whether an operator has ordered that -> severity
REHEARSAL: Final[Mapping[tuple[bool, bool], int]] = {
    (True, True): mavlink.MAV_SEVERITY_WARNING,
    (False, True): mavlink.MAV_SEVERITY_NOTICE,
    (False, False): mavlink.MAV_SEVERITY_CRITICAL,
}


class Announcer:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(self, message_sender: MessageSender) -> None:
        self._message_sender = message_sender
        self._number = 0
        self._told: Announce | None = None
        self._again_at = 0.0
        #: the number of messages still to be sent about the end of a decision
        self._left = 0

    @property
    def text(self) -> str:
        """The decision in force, in one sentence; "" if nothing is wrong."""
        return "" if self._told is None or self._told.action is None else self._told.text

    @property
    def action(self) -> FlightAction | None:
        """The decision in force; None if nothing is wrong."""
        return None if self._told is None else self._told.action

    def tell(self, told: Announce, now: float) -> None:
        """Tell every station."""
        self._number = self._number % 0xFFFF + 1
        self._told, self._left = told, _ENDS
        self._message_sender.say_to_all(told.text, SEVERITIES[told.action])
        self._send(now)

    def commander(self, name: str, handover_id: int | None) -> None:
        """Tell every station the name of the commander, "" for none. `handover_id`: of the transfer, if any."""
        number = "" if handover_id is None else f" (handover {handover_id})"
        self._message_sender.say_to_all(f"{name or 'no station'}{COMMANDS_NOW}{number}", COMMANDER)

    def advise(self, advice: Advise) -> None:
        """Tell some operators what they can correct."""
        for station in advice.stations:
            self._message_sender.say(self._message_sender.ports[station], advice.text)

    def rehearsal(self, moved: RehearsalMoved) -> None:
        """Tell every station that a rehearsal has begun or ended."""
        self._message_sender.say_to_all(moved.text, REHEARSAL[moved.on, moved.reason is Reason.OPERATOR])

    def _send(self, now: float) -> None:
        assert self._told is not None
        self._again_at = now + _AGAIN_S
        self._message_sender.to_stations(status.decision(self._told, self._number))
        if self._told.action is None:
            self._left -= 1
            if not self._left:
                self._told = None

    def tick(self, now: float) -> None:
        """Time has passed; to be called each second."""
        if self._told is not None and now >= self._again_at:
            self._send(now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells every station what was decided: HANDOVER_DECISION for our module, STATUSTEXT for everybody's program.

STATUSTEXT is said once, as programs show it each time it comes. HANDOVER_DECISION has a number, by which a station
knows it again, so it is repeated while the decision is in force: a link may lose it, and a station may come later.
Who commands is a text alone: AUTHORITY_STATUS and CONTROL_STATUS say it all the time.

Programs choose by the severity what they speak and how they colour it (QGroundControl speaks NOTICE and graver).
`SEVERITIES` and `REHEARSAL` are all there is of it; why something is refused is a WARNING to the station that asked
(`stations/sender.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Advise, Announce, RehearsalMoved
from mavproxy_handover.core.common.model import FlightAction, Reason
from mavproxy_handover.stations.sender import MessageSender
from mavproxy_handover.wire import status

__all__ = ["COMMANDER", "REHEARSAL", "SEVERITIES", "Announcer"]

#: every other second, and how often the end of it all is said
_AGAIN_S: Final = 1.5
_ENDS: Final = 3

#: somebody else commands, or nobody
COMMANDER: Final[int] = mavlink.MAV_SEVERITY_NOTICE
#: what is decided -> how grave it is; None: nothing is wrong any more
SEVERITIES: Final[Mapping[FlightAction | None, int]] = {
    None: mavlink.MAV_SEVERITY_NOTICE,
    FlightAction.WARN: mavlink.MAV_SEVERITY_WARNING,
    FlightAction.HOLD: mavlink.MAV_SEVERITY_WARNING,
    FlightAction.TRANSFER: mavlink.MAV_SEVERITY_WARNING,
    FlightAction.CONTINUE: mavlink.MAV_SEVERITY_WARNING,
    FlightAction.RETURN: mavlink.MAV_SEVERITY_CRITICAL,
    FlightAction.LAND: mavlink.MAV_SEVERITY_CRITICAL,
}

#: of a rehearsal: whether it has begun, and whether an operator has said so -> how grave it is
REHEARSAL: Final[Mapping[tuple[bool, bool], int]] = {
    (True, True): mavlink.MAV_SEVERITY_WARNING,
    (False, True): mavlink.MAV_SEVERITY_NOTICE,
    (False, False): mavlink.MAV_SEVERITY_CRITICAL,
}


class Announcer:
    """What was told last. Times are monotonic seconds."""

    def __init__(self, voice: MessageSender) -> None:
        self._voice = voice
        self._number = 0
        self._told: Announce | None = None
        self._again_at = 0.0
        #: of what is over: how often it is still said
        self._left = 0

    @property
    def text(self) -> str:
        """What is in force, in one sentence; "" if nothing is wrong."""
        return "" if self._told is None or self._told.action is None else self._told.text

    def tell(self, told: Announce, now: float) -> None:
        """Tell everybody."""
        self._number = self._number % 0xFFFF + 1
        self._told, self._left = told, _ENDS
        self._voice.say_to_all(told.text, SEVERITIES[told.action])
        self._send(now)

    def commander(self, name: str, handover_id: int | None) -> None:
        """Tell everybody who commands now, "" if nobody does; `handover_id`: of the transfer behind it, if one is."""
        number = "" if handover_id is None else f" (handover {handover_id})"
        self._voice.say_to_all(f"{name or 'no station'} commands now{number}", COMMANDER)

    def advise(self, advice: Advise) -> None:
        """Tell some operators what they can mend."""
        for station in advice.stations:
            self._voice.say(self._voice.ports[station], advice.text)

    def rehearsal(self, moved: RehearsalMoved) -> None:
        """Tell everybody that a rehearsal has begun, or is over."""
        self._voice.say_to_all(moved.text, REHEARSAL[moved.on, moved.reason is Reason.OPERATOR])

    def _send(self, now: float) -> None:
        assert self._told is not None
        self._again_at = now + _AGAIN_S
        self._voice.to_stations(status.decision(self._told, self._number))
        if self._told.action is None:
            self._left -= 1
            if not self._left:
                self._told = None

    def tick(self, now: float) -> None:
        """Time has passed; to be called each second."""
        if self._told is not None and now >= self._again_at:
            self._send(now)

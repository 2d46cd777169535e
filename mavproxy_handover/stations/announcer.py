# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells every station what was decided: HANDOVER_DECISION for our module, STATUSTEXT for everybody's program.

STATUSTEXT is said once, as programs show it each time it comes. HANDOVER_DECISION has a number, by which a station
knows it again, so it is repeated while the decision is in force: a link may lose it, and a station may come later.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.events import Announce
from mavproxy_handover.core.model import FlightAction
from mavproxy_handover.stations.voice import Voice
from mavproxy_handover.wire import status

__all__ = ["Announcer"]

#: every other second, and how often the end of it all is said
_AGAIN_S: Final = 1.5
_ENDS: Final = 3

_CRITICAL = (FlightAction.RETURN, FlightAction.LAND)


def _severity(told: Announce) -> int:
    if told.action is None:
        return int(mavlink.MAV_SEVERITY_NOTICE)
    return int(mavlink.MAV_SEVERITY_CRITICAL if told.action in _CRITICAL else mavlink.MAV_SEVERITY_WARNING)


class Announcer:
    """What was told last. Times are monotonic seconds."""

    def __init__(self, voice: Voice) -> None:
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
        for port in self._voice.ports.values():
            self._voice.say(port, told.text, _severity(told))
        self._send(now)

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

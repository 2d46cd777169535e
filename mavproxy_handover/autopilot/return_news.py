# SPDX-License-Identifier: GPL-3.0-or-later

"""What people are told of the place of a return: which one it is, that it is not in the list, who else writes the list.

The journal has every change. Stations read in flight which place it is when it is not home, and once a flight that a
place could not be written.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.reports import Reports
from mavproxy_handover.core.safety.return_site import Choice
from mavproxy_handover.monitors.return_site.candidates import HOME
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["ReturnNews"]

#: that somebody else writes the list is told this often (s) at most
_OVERWRITTEN_S: Final = 60.0
_NOT_LISTED: Final = ", NOT IN THE AUTOPILOT'S LIST"


class ReturnNews:
    """Of one vehicle. `name`: of a station. `listed` in its methods: a return goes to the place that is chosen."""

    def __init__(self, state: VehicleState, name: Callable[[int], str], reports: Reports) -> None:
        self._state = state
        self._name = name
        self._reports = reports
        #: the place that is in the journal, and the one that stations know of
        self._told, self._stations_told = "", HOME
        self._unwritten_told = False
        self._overwritten_told_at = -math.inf

    def words(self, choice: Choice, *, listed: bool) -> str:
        """Where a return goes, for people."""
        return f"{choice.words(self._name)}{'' if listed else _NOT_LISTED}"

    def figures(self, choice: Choice, *, listed: bool) -> str:
        """The same in figures."""
        return f"{choice.figures(self._name)}{'' if listed else _NOT_LISTED}"

    def place(self, choice: Choice, *, listed: bool) -> None:
        """Which place a return means from now on, if that is news; the stations read it in flight."""
        self._unwritten_told = False
        name = choice.place.name
        if name == self._told:
            return
        self._told = name
        text = f"a return goes to {self.words(choice, listed=listed)}"
        self._reports.event_log.place(text, name, choice.reachable)
        if self._state.armed and name != self._stations_told:
            self._stations_told = name
            self._reports.voice.say_to_all(f"A{text[1:]}", mavlink.MAV_SEVERITY_NOTICE)

    def armed(self) -> None:
        """A flight begins: what could not be written may be told again."""
        self._unwritten_told = False

    def landed(self) -> None:
        """The flight is over."""
        self._stations_told = HOME

    def not_written(self, why: str) -> None:
        """A write of the list came to nothing."""
        self._reports.event_log.place_failed(why)

    def elsewhere(self, name: str) -> None:
        """This place is not in the list; the stations read it in flight, once."""
        if not self._unwritten_told and self._state.armed:
            self._unwritten_told = True
            self._reports.voice.say_to_all(f"{name} is not in the autopilot's list: a return may go elsewhere")

    def written(self) -> None:
        """The list holds what was written."""
        self._unwritten_told = False

    def overwritten(self, now: float) -> None:
        """Another program has written the list."""
        self._reports.event_log.rally_overwritten()
        if self._state.armed and now - self._overwritten_told_at >= _OVERWRITTEN_S:
            self._overwritten_told_at = now
            self._reports.voice.say_to_all("Rally list changed by another program. Restoring the return site")

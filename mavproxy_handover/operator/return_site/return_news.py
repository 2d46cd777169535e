# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages about the return site: its changes, writes that fail, and changes of the rally list by other programs.

The journal has every change. In flight, stations are told the site if it is not home. Once a flight, they are told that
a site could not be written.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.safety.return_site import Choice
from mavproxy_handover.monitors.return_site.candidates import HOME
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["ReturnNews"]

#: least interval (s) of the message that another program changes the list
_OVERWRITTEN_S: Final = 60.0
_NOT_LISTED: Final = ", NOT IN THE AUTOPILOT'S LIST"


class ReturnNews:
    """The messages of one vehicle. `name` returns a station's name. `listed` in its methods: the autopilot's list holds
    the chosen site."""

    def __init__(self, state: VehicleState, name: Callable[[int], str], reports: Reports) -> None:
        self._state = state
        self._name = name
        self._reports = reports
        #: the last site in the journal, and the last site that stations were told
        self._told, self._stations_told = "", HOME
        self._unwritten_told = False
        self._overwritten_told_at = -math.inf

    def words(self, choice: Choice, *, listed: bool) -> str:
        """The return site, for people."""
        return f"{choice.words(self._name)}{'' if listed else _NOT_LISTED}"

    def brief(self, choice: Choice, *, listed: bool) -> str:
        """The return site, for a line that has what is left in the battery already."""
        figures = choice.figures(self._name, brief=True)
        return f"{choice.place.name}: {figures}{'' if listed else _NOT_LISTED}"

    def figures(self, choice: Choice, *, listed: bool) -> str:
        """The return site in figures."""
        return f"{choice.figures(self._name)}{'' if listed else _NOT_LISTED}"

    def place(self, choice: Choice, *, listed: bool) -> None:
        """Tell the return site if it has changed; in flight the stations are told too."""
        self._unwritten_told = False
        name = choice.place.name
        if name == self._told:
            return
        self._told = name
        text = f"a return goes to {self.words(choice, listed=listed)}"
        self._reports.event_log.place(text, name, choice.reachable)
        if self._state.armed and name != self._stations_told:
            self._stations_told = name
            self._reports.message_sender.say_to_all(f"A{text[1:]}", mavlink.MAV_SEVERITY_NOTICE)

    def armed(self) -> None:
        """A flight begins: a failed write may be told again."""
        self._unwritten_told = False

    def landed(self) -> None:
        """The flight is over."""
        self._stations_told = HOME

    def not_written(self, why: str) -> None:
        """A write of the list failed."""
        self._reports.event_log.place_failed(why)

    def elsewhere(self, name: str) -> None:
        """Tell the stations in flight, once, that this site is not in the list."""
        if not self._unwritten_told and self._state.armed:
            self._unwritten_told = True
            self._reports.message_sender.say_to_all(f"{name} is not in the autopilot's list: a return may go elsewhere")

    def written(self) -> None:
        """The list holds the site that was written."""
        self._unwritten_told = False

    def overwritten(self, now: float) -> None:
        """Another program has written the list."""
        self._reports.event_log.rally_overwritten()
        if self._state.armed and now - self._overwritten_told_at >= _OVERWRITTEN_S:
            self._overwritten_told_at = now
            self._reports.message_sender.say_to_all("Rally list changed by another program. Restoring the return site")

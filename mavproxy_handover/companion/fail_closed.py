# SPDX-License-Identifier: GPL-3.0-or-later

"""An internal fault of the rules ends authority: no station has authority, and no lease is sent.

Without a lease the guard brings the aircraft home. What helps the guard is done as well, each step for itself: after
one fault another one is likely. A return is ordered; a landing that is flown or ordered goes on.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.companion.decision_news import DecisionNews
from mavproxy_handover.core.common.events import Announce
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState, ModeClass, Reason
from mavproxy_handover.gate.flush import Closing
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.tools.schedule import attempt

__all__ = ["FailClosed"]

#: why the aircraft is brought home, for operators
_FAILED: Final = "internal fault of the companion, no station commands"


@dataclass(frozen=True, slots=True)
class FailClosed:
    """Of one vehicle. Times are monotonic seconds."""

    gate: Gate
    autopilot: Autopilot
    event_log: EventLog
    news: DecisionNews
    fault: Callable[[str, str], None]

    def put_in_force(self, view: AuthorityView, now: float) -> None:
        """Put this view in force at the gate; the journal says what was closed at the autopilot."""
        closed: list[tuple[int, Closing]] = self.gate.change(view, now)
        for station, closing in closed:
            self.event_log.closed(station, closing)

    def end_authority(self, text: str, now: float) -> None:
        """End authority for the rest of this run. `text`: what broke."""
        view = self.gate.view
        nobody = AuthorityView(view.phase, None, None, view.epoch, LeaseState.LOST, view.armed)
        self._attempt("flush", self.put_in_force, nobody, now)
        self._attempt("journal", self.event_log.failed_closed, text)
        self._attempt("end of START", self.autopilot.orders.give_start_up, "internal fault", now)
        if self.autopilot.aircraft.flying:
            action = self._way_home()
            self._attempt("way home", self._come_home, action, now)
            told = Announce(f"{action.name}: {_FAILED}", action, Reason.FAULT)
            self._attempt("word of it", self.news.tell, told, now)
        self._attempt("console", self.event_log.authority_ends, text)

    def _way_home(self) -> FlightAction:
        """LAND if the aircraft lands or was ordered to, else RETURN; RETURN also if that cannot be found out."""
        try:
            lands = self.autopilot.aircraft.lands or self.autopilot.orders.landing
        except Exception:
            self.fault("way home", traceback.format_exc(limit=-3))
            lands = False
        return FlightAction.LAND if lands else FlightAction.RETURN

    def _come_home(self, action: FlightAction, now: float) -> None:
        """Order a return or a landing. An aircraft that lands in a mode that ends on the ground gets no order."""
        aircraft = self.autopilot.aircraft
        if not (aircraft.lands and aircraft.flown in (ModeClass.RETURN, ModeClass.LAND)):
            self.autopilot.orders.fly(action, now)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: Any) -> None:
        attempt(self.fault, where, job, *arguments)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Rehearsal on the ground: people carry the disarmed aircraft through the zones, and authority moves as in flight.

Theory of operation
-------------------
During a rehearsal the aircraft counts as flying (`Flight.rehearsing`). Positions, links and stations that fall silent
have the same effects as in flight: transfers, refusals, phases, decisions. Decisions are told and never commanded
(`safety/decision_executor.py`), and START is refused (`start.py`).

A rehearsal begins by the commander's request, under the conditions of START except energy and gaps: the carried
aircraft needs no energy. So the aircraft is disarmed, on the ground, and the autopilot's heartbeat says so.

A rehearsal ends

* by the request of the commander of that moment;
* after `Limits.rehearsal_lost_s` without a commander;
* at once, if the autopilot says that it is armed. From then on it is a flight, and earlier decisions do not count.

It outlives a restart as a flight does (`common/snapshot.py`). Neither its beginning nor its end gives authority.
"""

from __future__ import annotations

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.phases import PhaseCause
from mavproxy_handover.core.authority.start import Start
from mavproxy_handover.core.authority.transfer import Cause
from mavproxy_handover.core.authority.transfer_manager import TransferManager
from mavproxy_handover.core.common.events import Action, Record, RehearsalAsked, RehearsalMoved, RehearsalRefused
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Reason

__all__ = ["Rehearsal"]


class Rehearsal:
    """State of the rehearsal. Times are monotonic seconds."""

    __slots__ = ("_authority", "_flight", "_limits", "_nobody_since", "_start", "_transfer_manager")

    def __init__(
        self, authority: Authority, flight: Flight, transfer_manager: TransferManager, start: Start, limits: Limits
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._transfer_manager = transfer_manager
        self._start = start
        self._limits = limits
        #: since when there has been no commander in it; None: there is a commander, or no rehearsal
        self._nobody_since: float | None = None

    def needs(self, station: int, now: float) -> tuple[str, ...]:
        """Needs of a rehearsal by this station's request that are not met, in words; empty: it may begin."""
        return self._start.needs(station, now, carried=True)

    def asked(self, event: RehearsalAsked, now: float, actions: list[Action]) -> bool:
        """Take a station's request; returns whether a rehearsal is to end. A request for the present state changes
        nothing."""
        name = self._authority.name(event.station)
        if event.begin and not self._flight.rehearsing:
            needs = self.needs(event.station, now)
            if not needs:
                self._begin(event.station, now, actions)
        elif self._authority.view.commander != event.station:
            needs = (f"{name} does not command",)
        else:
            needs = ()
        if needs:
            what = "begin" if event.begin else "end"
            text = f"rehearsal does not {what}: {'; '.join(needs)}"
            actions.append(Record("rehearsal_refused", text, Reason.NOT_READY, event.station))
            actions.append(RehearsalRefused(event.station, event.begin, needs))
        return not event.begin and not needs and self._flight.rehearsing

    def _begin(self, station: int, now: float, actions: list[Action]) -> None:
        self._transfer_manager.move(Cause.PREEMPTED, now, actions)  # as START does: a request of another station
        self._flight.rehearsal_begun()
        self._start.enter_mission("carried, in a rehearsal", now, actions, PhaseCause.REHEARSED)
        text = f"REHEARSAL: begun by {self._authority.name(station)}, nothing arms"
        actions.append(RehearsalMoved(True, text, Reason.OPERATOR))

    def over(self, now: float) -> tuple[str, Reason] | None:
        """Words and reason why the rehearsal is over without a request; None: it is not over, or there is none."""
        if not self._flight.rehearsing:
            return None
        if self._flight.armed:
            return "the aircraft is armed", Reason.STARTED
        due_at = self.due_at()
        if due_at is not None and now >= due_at:
            return f"no station has had authority for {self._limits.rehearsal_lost_s:.0f} s", Reason.COMMANDER_LOST
        return None

    def end(self) -> None:
        """End the rehearsal. The view follows with the next `Authority.refresh`."""
        self._flight.rehearsal_over()
        self._nobody_since = None
        self._authority.end_rehearsal()

    def update(self, now: float) -> None:
        """Note whether there is a commander. Called after each event."""
        if not self._flight.rehearsing or self._authority.view.commander is not None:
            self._nobody_since = None
        elif self._nobody_since is None:
            self._nobody_since = now

    def due_at(self) -> float | None:
        """Time at which it is over without a commander; None while there is one, or no rehearsal."""
        return None if self._nobody_since is None else self._nobody_since + self._limits.rehearsal_lost_s

# SPDX-License-Identifier: GPL-3.0-or-later

"""A rehearsal on the ground: the disarmed aircraft is carried through the zones; all but the flying is as in flight.

Theory of operation
-------------------
While it lasts the aircraft counts as flying (`Flight.rehearsing`), so positions, links and stations that fall silent
bring about what they would in flight: transfers, refusals, phases, decisions. What comes of a decision is told and
never commanded (`safety/execution.py`), and START is refused (`start.py`).

It begins by the commander's word where START could be, but for the energy, and with it the gaps, which nobody needs who
walks. So never armed, never in flight, never without a heartbeat of the autopilot that says so.

It ends by the word of whoever commands then; when nobody has commanded for `Limits.rehearsal_lost_s`; and at once when
the autopilot says that it is armed: from that moment on it is a flight, and nothing of what was decided before counts.
It outlives a restart as a flight does (`snapshot.py`). It gives nobody authority, neither where it begins nor where it
ends.
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
    """Whether one is under way. Times are monotonic seconds."""

    __slots__ = ("_authority", "_flight", "_limits", "_nobody_since", "_start", "_transfer_manager")

    def __init__(
        self, authority: Authority, flight: Flight, transfer_manager: TransferManager, start: Start, limits: Limits
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._transfer_manager = transfer_manager
        self._start = start
        self._limits = limits
        #: since when nobody has commanded in it; None: somebody does, or there is none
        self._nobody_since: float | None = None

    def needs(self, station: int, now: float) -> tuple[str, ...]:
        """What a rehearsal by this station's word still lacks, in words; empty when it may begin."""
        return self._start.needs(station, now, carried=True)

    def asked(self, event: RehearsalAsked, now: float, actions: list[Action]) -> bool:
        """A station's word. What it asks for already is changes nothing; returns whether a rehearsal is to end."""
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
        self._transfer_manager.move(Cause.PREEMPTED, now, actions)  # as START does: another's request
        self._flight.rehearsal_begun()
        self._start.enter_mission("carried, in a rehearsal", now, actions, PhaseCause.REHEARSED)
        text = f"REHEARSAL: begun by {self._authority.name(station)}, nothing arms"
        actions.append(RehearsalMoved(True, text, Reason.OPERATOR))

    def over(self, now: float) -> tuple[str, Reason] | None:
        """Why it is over whatever stations say, and the reason for that; None: it is not, or there is none."""
        if not self._flight.rehearsing:
            return None
        if self._flight.armed:
            return "the aircraft is armed all the same", Reason.STARTED
        due_at = self.due_at()
        if due_at is not None and now >= due_at:
            return f"nobody has commanded for {self._limits.rehearsal_lost_s:.0f} s", Reason.COMMANDER_LOST
        return None

    def end(self) -> None:
        """It is over. The view follows with the next `Authority.refresh`."""
        self._flight.rehearsal_over()
        self._nobody_since = None
        self._authority.end_rehearsal()

    def look(self, now: float) -> None:
        """Something has happened: does anybody command?"""
        if not self._flight.rehearsing or self._authority.view.commander is not None:
            self._nobody_since = None
        elif self._nobody_since is None:
            self._nobody_since = now

    def due_at(self) -> float | None:
        """When it is over because nobody commands; None while somebody does, or there is none."""
        return None if self._nobody_since is None else self._nobody_since + self._limits.rehearsal_lost_s

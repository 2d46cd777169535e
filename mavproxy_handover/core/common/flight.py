# SPDX-License-Identifier: GPL-3.0-or-later

"""The last word of autopilot, position and guard, and whether it still counts.

In a rehearsal the aircraft is carried, and counts as flying (`flying`). Whether it is off the ground is `aloft`.
"""

from __future__ import annotations

from math import inf

from mavproxy_handover.core.common.events import (
    AircraftJudged,
    AutopilotState,
    BoxJudged,
    EnergyJudged,
    GapsJudged,
    GuardSeen,
    HeightsJudged,
    MissionJudged,
    ReturnJudged,
)
from mavproxy_handover.core.common.handling import STANDS_STILL
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.core.common.never import assert_never

__all__ = ["Flight", "StartJudgement"]

#: what START may lack, by the monitors
StartJudgement = EnergyJudged | GapsJudged | AircraftJudged | BoxJudged | HeightsJudged | ReturnJudged | MissionJudged


class Flight:
    """The state of the aircraft. Times are monotonic seconds."""

    __slots__ = (
        "_autopilot_at",
        "_guard",
        "_guard_at",
        "_guard_misfit",
        "_guard_misfit_at",
        "_guard_ours",
        "_limits",
        "_position_at",
        "_stale_told",
        "aircraft_lacks",
        "aloft",
        "armed",
        "box_lacks",
        "circle_m",
        "circles_s",
        "energy_short",
        "foreign",
        "gaps_lack",
        "handling",
        "heights_lack",
        "mission_lacks",
        "rehearsing",
        "return_lacks",
    )

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        #: None until the autopilot has said it
        self.armed: bool | None = None
        #: off the ground as far as the autopilot knows
        self.aloft = False
        #: it is carried along its route
        self.rehearsing = False
        #: an aircraft that is not supported, in words; "": `kind` counts
        self.foreign = ""
        #: how the aircraft carries out an order
        self.handling = STANDS_STILL
        #: the order to circle has to come this time before a border (s), and this far from every border (m)
        self.circles_s = self.circle_m = 0.0
        #: what the loaded mission lacks in energy, in words
        self.energy_short = ""
        #: what the gaps of the loaded mission lack, in words
        self.gaps_lack = ""
        #: why the loaded mission would not be flown at the heights that were checked, in words
        self.heights_lack = ""
        #: why the position box is not to be flown with, in words
        self.box_lacks = ""
        #: why a return would not end on the ground, in words
        self.return_lacks = ""
        #: why the loaded mission is none for this aircraft, in words
        self.aircraft_lacks = ""
        #: why no mission is loaded, in words
        self.mission_lacks = ""
        self._autopilot_at = -inf
        self._position_at = -inf
        self._stale_told = False
        self._guard = GuardState.SILENT
        self._guard_ours = False
        self._guard_misfit = ""
        self._guard_misfit_at = self._guard_at = -inf

    @property
    def flying(self) -> bool:
        """The rules of a flight count."""
        return self.rehearsing or self.aloft

    def autopilot_said(self, event: AutopilotState, now: float) -> None:
        """A heartbeat of the autopilot."""
        self._autopilot_at = now
        self.armed = event.armed
        self.aloft = event.armed and event.flying
        self.foreign = event.foreign
        self.handling, self.circles_s, self.circle_m = event.handling, event.circles_s, event.circle_m

    def judged(self, event: StartJudgement) -> None:
        """What START lacks, by a monitor. It counts until the next event of its kind."""
        match event:
            case EnergyJudged():
                self.energy_short = event.shortfall
            case GapsJudged():
                self.gaps_lack = event.lacking
            case AircraftJudged():
                self.aircraft_lacks = event.lacking
            case BoxJudged():
                self.box_lacks = event.lacking
            case HeightsJudged():
                self.heights_lack = event.lacking
            case ReturnJudged():
                self.return_lacks = event.lacking
            case MissionJudged():
                self.mission_lacks = event.lacking
            case _:
                assert_never(event)

    def rehearsal_begun(self) -> None:
        """From now on the aircraft is carried along its route."""
        self.rehearsing = True

    def rehearsal_over(self) -> None:
        """The aircraft is not carried any more."""
        self.rehearsing = False

    def position_seen(self, now: float) -> None:
        """A fresh position."""
        self._position_at = now
        self._stale_told = False

    def guard_said(self, event: GuardSeen, now: float) -> None:
        """A status message of the guard. SILENT: not proven to be the guard's, so only `misfit` counts."""
        self._guard_misfit, self._guard_misfit_at = event.misfit, now
        if event.state is GuardState.SILENT:
            return
        self._guard_at = now
        self._guard_ours = event.ours
        self._guard = event.state

    def autopilot_alive(self, now: float) -> bool:
        """Whether the autopilot's word still counts."""
        return now < self._autopilot_at + self._limits.autopilot_lost_s

    def position_known(self, now: float) -> bool:
        """Whether the last position still counts."""
        return now < self._position_at + self._limits.position_stale_s

    def silent_on_position(self) -> bool:
        """Whether the autopilot has gone on to speak after its last position; else it is not heard at all."""
        return self._autopilot_at > self._position_at + self._limits.position_stale_s / 2.0

    def disarmed(self, now: float) -> bool:
        """Disarmed, and the autopilot has said so just now."""
        return self.autopilot_alive(now) and self.armed is False

    def guard(self, now: float) -> GuardState:
        """What the guard last said of itself; SILENT when that is too long ago."""
        return self._guard if now - self._guard_at < self._limits.guard_lost_s else GuardState.SILENT

    def guarded(self, now: float) -> bool:
        """Whether the guard answers the leases of this companion, or none is required."""
        return not self._limits.guard_required or not self.guard_lacks(now)

    def guard_lacks(self, now: float) -> str:
        """Why the guard does not watch over this companion's authority, in words; "" if it does."""
        if self._guard_misfit and now - self._guard_misfit_at < self._limits.guard_lost_s:
            return self._guard_misfit
        answers = self._guard_ours and self.guard(now) is GuardState.LIVE
        return "" if answers else "the guard does not answer the lease"

    def autopilot_silent_s(self, now: float) -> float:
        """For how long the autopilot has said nothing; inf if it never has."""
        return now - self._autopilot_at

    def guard_silent_s(self, now: float) -> float:
        """The same of the guard."""
        return now - self._guard_at

    def position_silent_s(self, now: float) -> float:
        """How old the position is."""
        return now - self._position_at

    def autopilot_lost_at(self) -> float:
        """When the autopilot's last word counts no more; -inf without one."""
        return self._autopilot_at + self._limits.autopilot_lost_s

    def guard_lost_at(self) -> float:
        """When the guard's last word counts no more; -inf without one."""
        return self._guard_at + self._limits.guard_lost_s

    def position_lost_at(self) -> float:
        """When the last position counts no more; -inf without one."""
        return self._position_at + self._limits.position_stale_s

    def stale_at(self) -> float | None:
        """When the position becomes too old in flight; None where that is told already, or does not matter."""
        if not self.flying or self._stale_told:
            return None
        return self._position_at + self._limits.position_stale_s

    def position_lost(self, now: float) -> bool:
        """True once when the position has become too old in flight."""
        stale_at = self.stale_at()
        if stale_at is None or now < stale_at:
            return False
        self._stale_told = True
        return True

# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's own failsafes: ground station, position, battery and fence.

Each has the moment at which it acts next, by what is known of the piece that is flown.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from sitl.campaign.aircraft import EMPTY_PART, LOW_PART, Aircraft, Mode
from sitl.campaign.log import FlightLog
from sitl.campaign.plan import FlightPlan
from sitl.campaign.times import NEVER, SECOND, in_ticks

__all__ = ["Failsafes"]

#: FS_GCS_TIMEOUT, and when the autopilot lands without a position
_GCS_TIMEOUT, _EKF = in_ticks(10.0), in_ticks(8.0)
#: manual recovery of ArduCopter's fence
_RECOVERY: Final = in_ticks(10.0)


class Failsafes:
    """The failsafes of one aircraft. Times are ticks. `tells`: the autopilot says that one of them acts."""

    def __init__(self, plan: FlightPlan, aircraft: Aircraft, log: FlightLog, tells: Callable[[int], None]) -> None:
        self._plan, self._aircraft, self._log, self._tells = plan, aircraft, log, tells
        self._gcs_stopped: int | None = 0
        self._gcs_due = self._ekf_due = self._battery_due = NEVER
        #: the guard has made it watch the companion's heartbeats, until a station commands again
        self._watches_itself = False
        #: when the border of the fence is crossed next, or its ceiling; which of them the aircraft is beyond, and when
        #: one was crossed outwards and inwards last
        self._border_due = self._ceiling_due = NEVER
        self._outside = self._above = False
        self._breach = [NEVER, NEVER]
        #: the autopilot has none
        self.no_position = False
        #: for the piece that began then; -1: to be found out
        self._piece_of = -1

    # ---- when -----------------------------------------------------------------------------------------------------

    def due(self) -> int:
        """When the next of them acts, as far as is known."""
        if self._aircraft.begun != self._piece_of:
            self._piece_of = self._aircraft.begun
            self._update_battery()
            self._update_fence()
        return min(self._gcs_due, self._ekf_due, self._battery_due, self._border_due, self._ceiling_due)

    def recompute(self) -> None:
        """Compute again for the piece that is flown."""
        self._piece_of = -1

    def heartbeats(self, *, come: bool, held: bool, alone: bool, watched: bool, now: int) -> None:
        """Whether heartbeats of a ground station come.

        `come`: the companion's messages do; `held`: a station commands; `alone`: none does, as the mission declares;
        `watched`: the guard works.
        """
        if come and watched and (held or alone):
            self._watches_itself = not held
        if come and (held or self._watches_itself):
            self._gcs_stopped, self._gcs_due = None, NEVER
        elif self._gcs_stopped is None:
            self._gcs_stopped, self._gcs_due = now, now + _GCS_TIMEOUT

    def position(self, *, there: bool, now: int) -> None:
        """The position is lost, or there again."""
        if there:
            self._ekf_due, self.no_position = NEVER, False
        else:
            self._ekf_due = now + _EKF if self._aircraft.flying else NEVER

    def _update_fence(self) -> None:
        """When the border of the fence is crossed, or its ceiling."""
        aircraft, fence = self._aircraft, self._plan.fence
        self._border_due = self._ceiling_due = NEVER
        if aircraft.flying:
            x, y, z = aircraft.at(aircraft.begun)
            vx, vy, up = aircraft.velocity
            times = fence.crossed(x, y, vx, vy)
            if times is not None and (times[0] > 0.0 or not self._outside):
                self._border_due = self._in(times[0] if self._outside else times[1])
            if up != 0.0 and (up > 0.0) is not self._above:
                self._ceiling_due = self._in((self._plan.ceiling_m - z) / up)

    def _in(self, seconds: float) -> int:
        """The tick at this time after the beginning of the piece that is flown."""
        return self._aircraft.begun + max(0, int(seconds * SECOND)) + 1

    def _update_battery(self) -> None:
        """When the battery comes to the next level at which something happens."""
        aircraft = self._aircraft
        parts = [0.0]
        if self._plan.truth.battery_failsafe and aircraft.flying and aircraft.mode is not Mode.LAND:
            parts.append(EMPTY_PART)
            if aircraft.mode is not Mode.RTL:
                parts.append(LOW_PART)
        self._battery_due = min(aircraft.falls_to(part) for part in parts) if aircraft.flying else NEVER

    # ---- what -----------------------------------------------------------------------------------------------------

    def act(self, now: int) -> bool:
        """Whatever is due; whether anything comes of it that is no routine."""
        aircraft, before = self._aircraft, self._aircraft.mode
        if self._gcs_due <= now:
            self._gcs_due = NEVER
            if aircraft.flying and not aircraft.mode.comes_down and aircraft.mode is not Mode.PILOT:
                self._failsafe(now)
                aircraft.come_home("GCS failsafe", now)
        if self._ekf_due <= now:
            self._ekf_due, self.no_position = NEVER, True
            self._failsafe(now)
            aircraft.land("EKF failsafe", now)
        crossed = min(self._border_due, self._ceiling_due) <= now
        if crossed:
            self._cross_fence(now)
        if self._battery_due <= now:
            self._piece_of = -1
            left = aircraft.left_wh(now) / aircraft.battery_wh
            if left <= 0.001:
                aircraft.falls(now)
            elif left <= EMPTY_PART + 0.001:
                self._failsafe(now)
                aircraft.land("battery failsafe", now)
            elif aircraft.mode is not Mode.RTL:
                self._failsafe(now)
                aircraft.come_home("battery failsafe", now)
        return crossed or aircraft.mode is not before

    def _failsafe(self, now: int) -> None:
        self._aircraft.failsafe = True
        self._tells(now)

    def _cross_fence(self, now: int) -> None:
        """A mode that was changed outside opens ten seconds in which no breach is acted on."""
        aircraft, before = self._aircraft, self._aircraft.breached
        self._outside ^= self._border_due <= now
        self._above ^= self._ceiling_due <= now
        aircraft.breached = self._outside or self._above
        self._log.breached.set(now, aircraft.breached)
        self._piece_of = -1
        if aircraft.breached is before:
            return
        if not aircraft.breached:
            self._breach[1] = now
            return
        began, ended = self._breach
        self._breach = [now, NEVER]
        by_hand = any(began <= at <= ended and now < at + _RECOVERY for at, _mode, _by in self._log.modes)
        if self._plan.truth.fence_failsafe and not by_hand:
            self._failsafe(now)
            aircraft.come_home("fence failsafe", now)

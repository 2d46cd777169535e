# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard, by the description on its page: RTL, once, without a live lease.

RTL also follows if leases say for too long that no station commands.

Leases flow five times a second while companion, cable and main loop are well. So the guard's last lease is as old as
the moment when one of them failed, and nothing needs to be counted in between. A lease that says that the aircraft is
alone in a declared gap counts as authority. It does so for as long as the first of them has said, HNDO_ALONE_MAX at
most. An aircraft in a pilot's hands, on its way home or on its way down is left alone.
"""

from __future__ import annotations

from mavproxy_handover.core.common.model import GuardState, LeaseState
from sitl.campaign.aircraft import Aircraft, Mode
from sitl.campaign.times import NEVER, in_ticks

__all__ = ["Guard"]

#: HNDO_TIMEOUT and HNDO_LOST_T
TIMEOUT, LOST = in_ticks(3.0), in_ticks(3.0)
#: it looks twenty times a second, and leases come five times
_LOOKS = in_ticks(0.25)


class Guard:
    """One guard. Times are ticks."""

    __slots__ = (
        "_acted",
        "_aircraft",
        "_alone_max_s",
        "_alone_until",
        "_flows",
        "_lost_since",
        "_stopped",
        "due",
        "works",
    )

    def __init__(self, aircraft: Aircraft, alone_max_s: float) -> None:
        """`alone_max_s`: HNDO_ALONE_MAX."""
        self._aircraft, self._alone_max_s = aircraft, alone_max_s
        self.works = True
        self._flows = False
        #: when the last lease came, and since when leases say that no station commands
        self._stopped = 0
        self._lost_since: int | None = None
        #: until when it may be alone in the gap that is crossed; None: it is in none
        self._alone_until: int | None = None
        self._acted = False
        self.due = NEVER

    def state(self, now: int) -> GuardState:
        """The guard's status, while leases flow or just have."""
        if self._acted and not self._flows:
            return GuardState.EXPIRED
        return GuardState.LIVE if self._lost_since is None or now < self._lost_since else GuardState.LOST

    @property
    def enforcing(self) -> bool:
        """Whether it has sent the aircraft home, and no station has commanded since."""
        return self._acted

    def heed(self, flows: bool, lease: LeaseState, alone_s: float, now: int) -> None:
        """Whether leases come, their state, and for how long the aircraft may still be alone (s).

        To be called whenever that changes.
        """
        if self._flows and not flows:
            self._stopped = now
        self._flows = flows
        if flows:
            self._read(lease, alone_s, now)
        self._plan()

    def _read(self, lease: LeaseState, alone_s: float, now: int) -> None:
        if lease in (LeaseState.HELD, LeaseState.TRANSFER):
            self._lost_since = self._alone_until = None
            self._acted = False
            return
        if lease is LeaseState.ALONE:
            if self._alone_until is None:  # what later leases say makes it no longer
                self._alone_until = now + in_ticks(min(alone_s, self._alone_max_s))
            if not self._acted and now < self._alone_until:
                self._lost_since = self._alone_until
                return
        if self._lost_since is None or self._lost_since > now:
            self._lost_since = now

    def _plan(self) -> None:
        times = [] if self._flows else [self._stopped + TIMEOUT + _LOOKS]
        if self._lost_since is not None:
            times.append(self._lost_since + LOST + _LOOKS)
        self.due = NEVER if self._acted or not self.works else min(times, default=NEVER)

    def stop(self, works: bool) -> None:
        """Its script dies, or lives again."""
        self.works = works
        self._plan()

    def act_if_due(self, now: int) -> None:
        """Whether it is time to act."""
        if now < self.due:
            return
        aircraft = self._aircraft
        if aircraft.mode is Mode.PILOT or not aircraft.flying:  # it stands back, and looks again
            self.due = now + in_ticks(0.5)
            return
        self._acted = True
        self._plan()
        if not aircraft.mode.comes_down:
            aircraft.come_home("guard", now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard on the flight controller: what it says of itself, and the leases that it gets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mavproxy_handover.autopilot.guard_link import GuardLink
from mavproxy_handover.autopilot.reports import Reports
from mavproxy_handover.core.common.events import Event, GuardSeen
from mavproxy_handover.core.common.model import AuthorityView, GuardState
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.ids import GUARD_STATUS_TUNNEL
from mavproxy_handover.wire.lease import GuardStatus
from mavproxy_handover.wire.status import LeaseSequence

__all__ = ["Guard"]


class Guard:
    """Of one vehicle. `leases`: of this companion; `link`: the guards that answer, and what leases must carry for them;
    `clock`: monotonic seconds, as all times here."""

    def __init__(
        self,
        sysid: int,
        state: VehicleState,
        leases: LeaseSequence,
        link: GuardLink,
        reports: Reports,
        clock: Callable[[], float],
    ) -> None:
        self._sysid = sysid
        self._state = state
        self._leases = leases
        self._link = link
        self._reports = reports
        self._clock = clock
        #: what it said last of itself
        self.status: GuardStatus | None = None
        #: what was told last of leases and guard that do not fit
        self._misfit = ""

    @property
    def asks(self) -> bool:
        """It has no lease of this companion, or a nonce that no lease has carried yet."""
        return self._link.asks

    def problem(self, now: float) -> str:
        """Why leases and guard do not fit, in words; "" if nothing is known."""
        return self._link.problem(now)

    def take(self, message: Any, now: float) -> tuple[list[Event], GuardStatus | None]:
        """A TUNNEL message of the autopilot: what it means for the rules, and the guard's status, if it is one."""
        if message.payload_type != GUARD_STATUS_TUNNEL:
            return [], None
        status = self._link.take(bytes(message.payload)[: message.payload_length], now)
        misfit = self._link.problem(now)
        self._tell_misfit(misfit)
        if status is None:
            return [GuardSeen(GuardState.SILENT, ours=False, misfit=misfit)], None
        self.status = status
        return [GuardSeen(status.state, status.nonce == self._leases.nonce, misfit)], status

    def _tell_misfit(self, misfit: str) -> None:
        """In flight the operators hear of it at once; on the ground the check before flight tells it."""
        if misfit and misfit != self._misfit and self._state.flying:
            self._reports.voice.say_to_all(misfit)
        self._misfit = misfit

    def send_lease(self, view: AuthorityView, alone_s: float) -> None:
        """Tell it who has authority; `alone_s`: how long the aircraft may still fly on without a commander."""
        now = self._clock()
        two = self._link.withholds(now)
        for nonce in self._link.addressed(now):
            self._reports.voice.to_autopilot(self._leases.next(view, self._sysid, alone_s, nonce, two_guards=two))
        self._link.answered()

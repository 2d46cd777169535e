# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard on the flight controller: its status, and the leases that it gets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mavproxy_handover.core.common.events import Event, GuardSeen
from mavproxy_handover.core.common.model import AuthorityView, GuardState
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.vehicle.guard_link import GuardLink
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.ids import GUARD_STATUS_TUNNEL
from mavproxy_handover.wire.lease import GuardStatus
from mavproxy_handover.wire.status import LeaseSequence

__all__ = ["Guard"]


class Guard:
    """The guard of one vehicle. `leases`: of this companion; `link`: the guards that answer, and the nonces of leases;
    `clock` returns monotonic seconds, as all times here."""

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
        #: its last status; None: none yet
        self.status: GuardStatus | None = None
        #: the last text about leases and guard that do not fit
        self._misfit = ""

    @property
    def asks(self) -> bool:
        """The guard has no lease of this companion, or a nonce that no lease has carried yet."""
        return self._link.asks

    def problem(self, now: float) -> str:
        """Why leases and guard do not fit, in words; "" if nothing is known."""
        return self._link.problem(now)

    def on_tunnel(self, message: Any, now: float) -> tuple[list[Event], GuardStatus | None]:
        """A TUNNEL message of the autopilot. Returns events for the rules, and the guard's status if it holds one."""
        if message.payload_type != GUARD_STATUS_TUNNEL:
            return [], None
        status = self._link.on_status(bytes(message.payload)[: message.payload_length], now)
        misfit = self._link.problem(now)
        self._tell_misfit(misfit)
        if status is None:
            return [GuardSeen(GuardState.SILENT, ours=False, misfit=misfit)], None
        self.status = status
        return [GuardSeen(status.state, status.nonce == self._leases.nonce, misfit)], status

    def _tell_misfit(self, misfit: str) -> None:
        """Tell the operators in flight at once; on the ground the check before flight tells them."""
        if misfit and misfit != self._misfit and self._state.flying:
            self._reports.message_sender.say_to_all(misfit)
        self._misfit = misfit

    def send_lease(self, view: AuthorityView, alone_s: float) -> None:
        """Send the lease. `alone_s`: for how long (s) the aircraft may still fly without a commander."""
        now = self._clock()
        two = self._link.withholds(now)
        for nonce in self._link.addressed(now):
            self._reports.message_sender.to_autopilot(
                self._leases.next(view, self._sysid, alone_s, nonce, two_guards=two)
            )
        self._link.answered()

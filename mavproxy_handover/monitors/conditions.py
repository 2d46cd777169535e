# SPDX-License-Identifier: GPL-3.0-or-later

"""Conditions in flight that the vehicle state shows: energy, route and fence.

`core/safety/conditions.py` handles them. A condition that cannot be computed keeps its last value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ConditionsSeen, Event
from mavproxy_handover.core.safety.route import TrackFact
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["ConditionMonitor", "breach"]

#: after this time (s) without a message, a stream of at least one message a second has stopped
_STOPPED_S: Final = 3.0
_BREACHES: Final = {
    mavlink.FENCE_BREACH_MINALT: "too low",
    mavlink.FENCE_BREACH_MAXALT: "too high",
    mavlink.FENCE_BREACH_BOUNDARY: "its border",
}


def breach(state: VehicleState, now: float) -> str:
    """The breach of the fence, in words; "" if none is known.

    FENCE_STATUS comes only while a fence is enabled; without it, SYS_STATUS shows the breach.
    """
    fence: Any = state.telemetry.fence_status.value
    if fence is not None and now - state.telemetry.fence_status.at < _STOPPED_S:
        if not fence.breach_status:
            return ""
        return f"outside the fence ({_BREACHES.get(fence.breach_type, 'breached')})"
    lately = now - state.telemetry.sys_status.at < _STOPPED_S
    known = (
        lately
        and state.telemetry.sys_status.value is not None
        and mode_requests.breached(state.telemetry.sys_status.value)
    )
    return "outside the fence" if known else ""


class ConditionMonitor:
    """The conditions of one aircraft.

    `energy` returns the energy left and needed, in words; None while a return site is in reach. `route` returns the
    position on the leg while the aircraft is off its route. `fault` takes the place and the text of a fault.
    """

    def __init__(
        self,
        energy: Callable[[], str | None],
        route: Callable[[], TrackFact | None],
        fault: Callable[[str, str], None],
    ) -> None:
        self._energy = energy
        self._route = route
        self._fault = fault
        #: the current conditions, and those that were returned last
        self._seen = self._told = ConditionsSeen()

    def update(self, state: VehicleState, now: float) -> list[Event]:
        """Returns the conditions when they change; to be called each second."""
        attempt(self._fault, "energy condition", self._check_energy, state)
        attempt(self._fault, "route condition", self._check_route, state)
        attempt(self._fault, "fence condition", self._check_fence, state, now)
        if self._seen == self._told:
            return []
        self._told = self._seen
        return [self._seen]

    def _check_energy(self, state: VehicleState) -> None:
        short = self._energy() if state.flying else None
        self._seen = replace(self._seen, energy=short is not None, energy_words=short or "")

    def _check_route(self, state: VehicleState) -> None:
        track = self._route() if state.flying else None
        words = "" if track is None else f"off route: {track.text}"
        self._seen = replace(self._seen, off_route=track is not None, off_route_words=words)

    def _check_fence(self, state: VehicleState, now: float) -> None:
        wrong = breach(state, now) if state.flying else ""
        self._seen = replace(self._seen, fence=bool(wrong), fence_words=wrong)

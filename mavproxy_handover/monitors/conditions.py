# SPDX-License-Identifier: GPL-3.0-or-later

"""What looks wrong in flight that only the vehicle's state shows: energy, route and fence. What becomes of it is
`core/safety/conditions.py`.

A sign that cannot be worked out stays as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ConditionsSeen, Event
from mavproxy_handover.core.safety.route import TrackFact
from mavproxy_handover.schedule import attempt
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["ConditionMonitor", "breach"]

#: what comes once a second, or oftener, has stopped
_STOPPED_S: Final = 3.0
_BREACHES: Final = {
    mavlink.FENCE_BREACH_MINALT: "too low",
    mavlink.FENCE_BREACH_MAXALT: "too high",
    mavlink.FENCE_BREACH_BOUNDARY: "its border",
}


def breach(state: VehicleState, now: float) -> str:
    """What is wrong with the fence, in words; "" if nothing is known to be.

    FENCE_STATUS comes only while a fence is on; where it does not, SYS_STATUS has a word of it.
    """
    fence: Any = state.telemetry.fence_status.value
    if fence is not None and now - state.telemetry.fence_status.at < _STOPPED_S:
        if not fence.breach_status:
            return ""
        return f"outside the fence: {_BREACHES.get(fence.breach_type, 'breached')}"
    lately = now - state.telemetry.sys_status.at < _STOPPED_S
    known = (
        lately
        and state.telemetry.sys_status.value is not None
        and mode_requests.breached(state.telemetry.sys_status.value)
    )
    return "outside the fence" if known else ""


class ConditionMonitor:
    """Of one aircraft. `energy`: what is left and needed, in words, None while some place of a return is in reach;
    `route`: where the aircraft is while it is off its route; `fault` is told what broke, and where."""

    def __init__(
        self,
        energy: Callable[[], str | None],
        route: Callable[[], TrackFact | None],
        fault: Callable[[str, str], None],
    ) -> None:
        self._energy = energy
        self._route = route
        self._fault = fault
        #: what looks wrong, and what was found last
        self._seen = self._told = ConditionsSeen()

    def update(self, state: VehicleState, now: float) -> list[Event]:
        """Each second: what looks wrong, when that changes."""
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

# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot does, for whoever watches that it does what was decided: its mode, who may have chosen it, motion
and fence.

It is told to the arbiter as events; nothing is concluded here (`core/safety/helm.py`, `core/safety/supervision.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot import hands
from mavproxy_handover.autopilot.aircraft import Aircraft
from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.core.events import HandSeen, ModeSeen, MotionSeen
from mavproxy_handover.core.model import Hand
from mavproxy_handover.wire.lease import GuardStatus

__all__ = ["ExecutionWatch"]

#: what comes once a second, or oftener, has stopped
_STOPPED_S: Final = 3.0
_LANDING: Final[int] = mavlink.MAV_LANDED_STATE_LANDING
_BREACHES: Final = {
    mavlink.FENCE_BREACH_MINALT: "too low",
    mavlink.FENCE_BREACH_MAXALT: "too high",
    mavlink.FENCE_BREACH_BOUNDARY: "its border",
}


class ExecutionWatch:
    """Of one aircraft. `radio_watched`: whether the loss of the radio would be noticed. Times are monotonic seconds."""

    def __init__(self, aircraft: Aircraft, ties: Ties, radio_watched: Callable[[], bool]) -> None:
        self._aircraft = aircraft
        self._ties = ties
        self._radio_watched = radio_watched
        self._critical = False

    # ---- as it comes ----------------------------------------------------------------------------------------------

    def state(self, now: float) -> None:
        """A heartbeat, or whether it has landed."""
        aircraft = self._aircraft
        if aircraft.critical and not self._critical:
            self._ties.handle(HandSeen(Hand.FAILSAFE), now)
        self._critical = aircraft.critical
        name = aircraft.vehicle.mode_name(aircraft.custom_mode)
        landing = aircraft.landed_state == _LANDING
        self._ties.handle(ModeSeen(aircraft.flown, name, landing, self._radio), now)

    @property
    def _radio(self) -> bool:
        status = self._aircraft.sys_status
        return status is not None and self._radio_watched() and hands.radio_lives(status)

    def text(self, text: str, now: float) -> None:
        """A STATUSTEXT of the autopilot."""
        hand = hands.of_text(text, self._aircraft.vehicle)
        if hand is not None:
            self._ties.handle(hand, now)

    def guard(self, status: GuardStatus, now: float) -> None:
        """A word of the guard."""
        if status.enforcing:
            self._ties.handle(HandSeen(Hand.GUARD), now)

    # ---- each second ----------------------------------------------------------------------------------------------

    def each_second(self, now: float) -> None:
        """Motion."""
        aircraft = self._aircraft
        if not aircraft.flying or aircraft.own_position is None:
            return
        fresh = now - aircraft.waypoint_distance_at < _STOPPED_S
        # a circle around the place is at the place
        left_m = (
            max(0.0, aircraft.waypoint_distance_m - aircraft.return_circle_m) if fresh and aircraft.to_place else None
        )
        if now - aircraft.own_position_at < _STOPPED_S:
            climb_mps = -aircraft.own_position.vz / 100.0
            self._ties.handle(MotionSeen(aircraft.own_speed_mps, climb_mps, left_m), now)

    def breach(self, now: float) -> str:
        """What is wrong with the fence, in words; "" if nothing is known to be.

        FENCE_STATUS comes only while a fence is on; where it does not, SYS_STATUS has a word of it.
        """
        aircraft = self._aircraft
        fence: Any = aircraft.fence_status
        if fence is not None and now - aircraft.fence_status_at < _STOPPED_S:
            if not fence.breach_status:
                return ""
            return f"outside the fence: {_BREACHES.get(fence.breach_type, 'breached')}"
        known = aircraft.sys_status is not None and hands.breached(aircraft.sys_status)
        return "outside the fence" if known else ""

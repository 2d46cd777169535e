# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot does, for whoever watches that it does what was decided: its mode, who may have chosen it, motion
and fence.

It is told to the arbiter as events; nothing is concluded here (`core/safety/helm.py`, `core/safety/supervision.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.core.events import HandSeen, ModeSeen, MotionSeen, MotionUnseen
from mavproxy_handover.core.model import Hand
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.vehicle import hands
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.lease import GuardStatus

__all__ = ["ExecutionWatch"]

#: what comes once a second, or oftener, has stopped
_STOPPED_S: Final = 3.0
#: what was said of the radio counts so long: who takes a pilot for a stranger fights him
_RADIO_S: Final = 10.0
_LANDING: Final[int] = mavlink.MAV_LANDED_STATE_LANDING
_BREACHES: Final = {
    mavlink.FENCE_BREACH_MINALT: "too low",
    mavlink.FENCE_BREACH_MAXALT: "too high",
    mavlink.FENCE_BREACH_BOUNDARY: "its border",
}


class ExecutionWatch:
    """Of one aircraft. `radio_watched`: whether the loss of the radio would be noticed; `place`: latitude and longitude
    (degrees) of where a return goes, None: not known. Times are monotonic seconds."""

    def __init__(
        self,
        aircraft: VehicleState,
        ties: Ties,
        radio_watched: Callable[[], bool],
        place: Callable[[], tuple[float, float] | None],
    ) -> None:
        self._aircraft = aircraft
        self._ties = ties
        self._radio_watched = radio_watched
        self._place = place
        self._critical = False
        self._moves = False

    # ---- as it comes ----------------------------------------------------------------------------------------------

    def state(self, now: float) -> None:
        """A heartbeat, or whether it has landed."""
        aircraft = self._aircraft
        if aircraft.telemetry.heartbeat.critical and not self._critical:
            self._ties.handle(HandSeen(Hand.FAILSAFE), now)
        self._critical = aircraft.telemetry.heartbeat.critical
        name = aircraft.vehicle.mode_name(aircraft.custom_mode)
        landing = aircraft.telemetry.landed.state == _LANDING
        self._ties.handle(ModeSeen(aircraft.flown, name, landing, self._radio(now)), now)

    def _radio(self, now: float) -> bool:
        status = self._aircraft.telemetry.sys_status.value
        lately = now - self._aircraft.telemetry.sys_status.at < _RADIO_S
        return status is not None and lately and self._radio_watched() and hands.radio_lives(status)

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
        moved, self._moves = self._moves, now - aircraft.telemetry.own_position.at < _STOPPED_S
        if not aircraft.flying or aircraft.telemetry.own_position.value is None:
            return
        if self._moves:
            climb_mps = -aircraft.telemetry.own_position.value.vz / 100.0
            self._ties.handle(MotionSeen(aircraft.own_speed_mps, climb_mps, self._left_m(now)), now)
        elif moved:
            self._ties.handle(MotionUnseen(), now)

    def _left_m(self, now: float) -> float | None:
        """How far it is to the place that it flies to (m), by the autopilot's word, or by where both are."""
        aircraft = self._aircraft
        if not aircraft.to_place:
            return None
        away_m = aircraft.telemetry.to_waypoint_m.value
        if now - aircraft.telemetry.to_waypoint_m.at >= _STOPPED_S:
            own, place = aircraft.telemetry.own_position.value, self._place()
            if own is None or place is None:
                return None
            away_m = distance_m(own.lat / 1e7, own.lon / 1e7, *place)
        return max(0.0, away_m - aircraft.return_circle_m)  # a circle around the place is at the place

    def breach(self, now: float) -> str:
        """What is wrong with the fence, in words; "" if nothing is known to be.

        FENCE_STATUS comes only while a fence is on; where it does not, SYS_STATUS has a word of it.
        """
        aircraft = self._aircraft
        fence: Any = aircraft.telemetry.fence_status.value
        if fence is not None and now - aircraft.telemetry.fence_status.at < _STOPPED_S:
            if not fence.breach_status:
                return ""
            return f"outside the fence: {_BREACHES.get(fence.breach_type, 'breached')}"
        lately = now - aircraft.telemetry.sys_status.at < _STOPPED_S
        known = (
            lately
            and aircraft.telemetry.sys_status.value is not None
            and hands.breached(aircraft.telemetry.sys_status.value)
        )
        return "outside the fence" if known else ""

# SPDX-License-Identifier: GPL-3.0-or-later

"""The monitor of mode and motion: mode, its possible source, and motion, for the check that decisions are carried out.

The rules that draw conclusions are `core/safety/mode_source.py` and `core/safety/command_verification.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mavproxy_handover.core.common.events import Event, ModeSeen, ModeSourceSeen, MotionSeen, MotionUnseen
from mavproxy_handover.core.common.model import ModeSource
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.lease import GuardStatus

__all__ = ["ModeAndMotionMonitor"]

#: after this time (s) without a message, a stream of at least one message a second has stopped
_STOPPED_S: Final = 3.0
#: a report about the radio counts for this time (s): the companion must not act against the pilot. A silence of the
#: autopilot in it counts as `_STOPPED_S`
_RADIO_S: Final = 10.0


class ModeAndMotionMonitor:
    """The monitor of one aircraft. Times are monotonic seconds.

    `place` returns latitude and longitude (degrees) of the return site; None: not known.
    """

    def __init__(self, place: Callable[[], tuple[float, float] | None]) -> None:
        self._place = place
        self._critical = False
        self._moves = False
        #: the first and the last call of `on_state`; inf: none yet
        self._first_at = self._heard_at = math.inf
        #: the last report about the radio, and the time (s) since then that does not count
        self._reported_at = -math.inf
        self._uncounted_s = 0.0

    # ---- messages -------------------------------------------------------------------------------------------------

    def on_state(self, state: VehicleState, now: float) -> list[Event]:
        """A HEARTBEAT or EXTENDED_SYS_STATE has arrived, and the state was updated."""
        found: list[Event] = []
        self._first_at = min(self._first_at, now)
        silent_s, self._heard_at = now - self._heard_at, now
        self._uncounted_s += max(0.0, silent_s - _STOPPED_S)
        critical = state.telemetry.heartbeat.critical
        if critical and not self._critical:
            found.append(ModeSourceSeen(ModeSource.FAILSAFE))
        self._critical = critical
        name = state.profile.mode_name(state.custom_mode)
        found.append(ModeSeen(state.flown, name, state.comes_down, self._radio(state, now)))
        return found

    @staticmethod
    def radio_watched(state: VehicleState) -> bool:
        """Whether the autopilot would notice a loss of the radio, as far as is known."""
        parameters = state.parameters.read
        return parameters is None or parameters.get(state.profile.radio_failsafe, 1) != 0

    def _radio(self, state: VehicleState, now: float) -> bool:
        """Whether a pilot could steer, as far as is known.

        The first heartbeat may come before the first report about the radio. After a silence of the autopilot the last
        report counts until the next one. After a start of the companion a pilot could steer for `_STOPPED_S`.
        """
        status, at = state.telemetry.sys_status.value, state.telemetry.sys_status.at
        if at > self._reported_at:
            self._reported_at, self._uncounted_s = at, 0.0
        if status is None:
            return now - self._first_at < _STOPPED_S and self.radio_watched(state)
        lately = now - at - self._uncounted_s < _RADIO_S
        return lately and self.radio_watched(state) and mode_requests.radio_lives(status)

    @staticmethod
    def text(state: VehicleState, text: str) -> list[Event]:
        """A STATUSTEXT of the autopilot."""
        hand = mode_requests.of_text(text, state.profile)
        return [] if hand is None else [hand]

    @staticmethod
    def guard(status: GuardStatus) -> list[Event]:
        """A status of the guard."""
        return [ModeSourceSeen(ModeSource.GUARD)] if status.enforcing else []

    # ---- each second ----------------------------------------------------------------------------------------------

    def update(self, state: VehicleState, now: float) -> list[Event]:
        """Returns the motion, or once that it is not known any more."""
        own = state.telemetry.own_position
        moved, self._moves = self._moves, now - own.at < _STOPPED_S
        if not state.flying or own.value is None:
            return []
        if self._moves:
            climb_mps = -own.value.vz / 100.0
            return [MotionSeen(state.own_speed_mps, climb_mps, self._left_m(state, now))]
        return [MotionUnseen()] if moved else []

    def _left_m(self, state: VehicleState, now: float) -> float | None:
        """The distance (m) to the return site: by the autopilot's message, or by both positions; None: not known."""
        if not state.to_place:
            return None
        away_m = state.telemetry.to_waypoint_m.value
        if now - state.telemetry.to_waypoint_m.at >= _STOPPED_S:
            own, place = state.telemetry.own_position.value, self._place()
            if own is None or place is None:
                return None
            away_m = distance_m(own.lat / 1e7, own.lon / 1e7, *place)
        return max(0.0, away_m - state.return_circle_m)  # on its circle the aircraft is at the site

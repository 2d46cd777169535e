# SPDX-License-Identifier: GPL-3.0-or-later

"""The telemetry streams that the companion needs, and their restoration after a station has slowed or ended them.

The streams are those of `OWN_RATES`. The autopilot keeps one set of rates for a link, and the commander may change it.
Rules:

1. All streams are requested once, when the autopilot is first heard and after it was silent.
2. If positions come too seldom for the zone check, they are requested again. If no position comes for long, all streams
   are requested. EXTENDED_SYS_STATE is also requested if it is missing: an aircraft on the ground must not be commanded
   to return.
3. Otherwise the commander decides the rates. When it no longer commands, all streams are requested again: the next
   commander has not chosen these rates, and uses the same telemetry. Rates of other messages: `gate/flush.py`.
4. Requests are at least `_PAUSE_S` apart, so that a commander that repeats its rates does not cause a flood.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.vehicle.procedures import Procedures
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.own_rates import OWN_RATES

__all__ = ["Streams"]

_PAUSE_S = 5.0
_SILENT_S = 3.0
_NO_POSITION_S = 2.0
#: fewer positions than this: a ground station has requested a lower rate
_POSITIONS_A_SECOND = 10
_NO_LANDED_STATE_S = 3.0


class Streams:
    """The streams of one vehicle. `send` sends a message to the autopilot."""

    def __init__(self, procedures: Callable[[], Procedures], send: Callable[[Any], None]) -> None:
        self._procedures = procedures
        self._send = send
        self._asked = False
        self._again_at = 0.0
        self._positions = 0

    def position_seen(self) -> None:
        """A position of the autopilot has arrived."""
        self._positions += 1

    def renew(self) -> None:
        """Request all streams again within a second: the station that set the rates no longer commands."""
        self._asked, self._again_at = False, 0.0

    def each_second(self, aircraft: VehicleState, now: float) -> None:
        """Request the streams that are missing."""
        slow, self._positions = self._positions < _POSITIONS_A_SECOND, 0
        if now - aircraft.telemetry.heartbeat.at >= _SILENT_S:
            self._asked = False
            return
        wanted = set()
        if slow:
            wanted.add(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
        if now - aircraft.telemetry.landed.at > _NO_LANDED_STATE_S:
            wanted.add(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        if not self._asked or now - aircraft.telemetry.own_position.at > _NO_POSITION_S:
            wanted.update(OWN_RATES)
        if wanted and now >= self._again_at:
            self._again_at, self._asked = now + _PAUSE_S, True
            for msgid, request in zip(OWN_RATES, self._procedures().stream_requests(), strict=True):
                if msgid in wanted:
                    self._send(request)

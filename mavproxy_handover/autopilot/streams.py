# SPDX-License-Identifier: GPL-3.0-or-later

"""The telemetry that the companion lives on, and how it is got back when somebody has slowed it down or ended it.

The autopilot keeps one set of rates for a link, and the commander may change it like everything else. Rules:

1. All streams are asked for once, when the autopilot is first heard and when it was silent.
2. Fewer positions than the zone check can do with: they are asked for again; none at all for long: everything is.
   The same for the word whether the aircraft has landed: the way home is not commanded to one on the ground.
3. Else the rates are the commander's business. When it commands no more, everything is asked for again: nobody after it
   has chosen what it had set, and the telemetry is the next one's too.
4. Requests are `_PAUSE_S` apart, or a commander that insists would be answered in a storm.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.procedures import STREAMS, Procedures
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["Streams"]

_PAUSE_S = 5.0
_SILENT_S = 3.0
_NO_POSITION_S = 2.0
#: fewer than this: a ground station has asked for slower ones
_POSITIONS_A_SECOND = 10
_NO_LANDED_STATE_S = 3.0


class Streams:
    """`send` puts a message on its way to the autopilot."""

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
        """Ask for everything again, within a second: whoever set the rates commands no more."""
        self._asked, self._again_at = False, 0.0

    def each_second(self, aircraft: VehicleState, now: float) -> None:
        """Ask for what is missing."""
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
            wanted.update(STREAMS)
        if wanted and now >= self._again_at:
            self._again_at, self._asked = now + _PAUSE_S, True
            for msgid, request in zip(STREAMS, self._procedures().stream_requests(), strict=True):
                if msgid in wanted:
                    self._send(request)

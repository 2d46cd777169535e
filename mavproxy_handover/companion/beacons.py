# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages of the companion at intervals: leases, status of authority, heartbeats."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.model import AuthorityView, Reason
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.wire import status

__all__ = ["BEAT_ALONE_S", "BEAT_S", "Beacons"]

#: the shortest time (s) between two heartbeats of the companion, if the autopilot sends its own, and if not
BEAT_S: Final = 0.9
BEAT_ALONE_S: Final = 1.9


class Beacons:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        in_force: AuthorityInForce,
        arbiter: Arbiter,
        autopilot: Autopilot,
        message_sender: MessageSender,
        now: float,
    ) -> None:
        self._in_force = in_force
        self._arbiter = arbiter
        self._autopilot = autopilot
        self._message_sender = message_sender
        #: when the stations got the companion's heartbeat last
        self._beaten_at = now
        #: why authority is as it is
        self.reason = Reason.NONE

    @property
    def view(self) -> AuthorityView:
        """The authority in force."""
        return self._in_force.view

    def send_lease(self, alone_s: float) -> None:
        """Send the guard a lease. `alone_s`: how long (s) the aircraft may still fly without a commander."""
        self._autopilot.guard.send_lease(self._in_force.view, alone_s)

    def send_authority_status(self, now: float) -> None:
        """AUTHORITY_STATUS to every station."""
        arbiter, autopilot = self._arbiter, self._autopilot
        told = status.authority_status(
            self._in_force.view,
            arbiter.zone(),
            arbiter.guard(now),
            self.reason,
            route_changed=autopilot.mission.flown.changed,
            zone_ends_s=arbiter.zone_ends_s,
            answer_left_s=arbiter.answer_left_s(now),
            place=autopilot.return_site.where,
            way=autopilot.return_site.way,
        )
        self._message_sender.to_stations(told)

    def send_control_status(self) -> None:
        """CONTROL_STATUS to every station."""
        self._message_sender.to_stations(status.control_status(self._in_force.view))

    def beat_autopilot(self) -> None:
        """The companion's heartbeat to the autopilot."""
        self._message_sender.to_autopilot(status.heartbeat(self._in_force.view))

    def beat_stations(self, now: float, pause_s: float) -> None:
        """The companion's heartbeat to the stations, if the last one is `pause_s` old.

        It follows the autopilot's heartbeat. A program may take the first heartbeat that it receives for the only one:
        MAVSDK 3 looks for an autopilot at that moment and never again.
        """
        if now - self._beaten_at >= pause_s:
            self._beaten_at = now
            self._message_sender.beat(status.heartbeat(self._in_force.view))

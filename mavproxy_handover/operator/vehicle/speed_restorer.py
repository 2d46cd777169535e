# SPDX-License-Identifier: GPL-3.0-or-later

"""The speed of the mission and of a return, restored after a change of mode.

ArduPilot forgets the speed of a DO_CHANGE_SPEED item when the aircraft leaves AUTO. Back in AUTO, the companion sends
that speed again. A speed of the commander may arrive just after a return has begun, and would slow it down. So the
companion sends the speed of the return again.
"""

from __future__ import annotations

from mavproxy_handover.mission.route_simulation import speed_at
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.orders import Orders
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.uploads.flown_mission import FlownMission

__all__ = ["SpeedRestorer"]


class SpeedRestorer:
    """Restores the speeds of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        context: Context,
        flown: FlownMission,
        orders: Orders,
        return_site: ReturnSite,
        command_check: CommandCheck,
    ) -> None:
        self._state = context.state
        self._flown = flown
        self._orders = orders
        self._return_site = return_site
        self._command_check = command_check

    def mission_flown(self, now: float) -> None:
        """The aircraft begins to fly its mission, or ends."""
        state, route = self._state, self._flown.route
        resumes = state.flies_mission and state.flying and not state.foreign
        speed_mps = speed_at(route, state.waypoint) if resumes and route is not None else None
        self._orders.resume_speed(speed_mps, now)

    def mode_changed(self, now: float) -> None:
        """The aircraft flies another mode; to be called after `mission_flown`, which ends a change of speed that is
        under way."""
        takes_speed = self._state.profile.return_takes_speed
        if self._state.to_place and takes_speed and self._command_check.sped_lately(now):
            self._orders.resume_speed(self._return_site.candidates.return_mps, now)

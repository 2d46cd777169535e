# SPDX-License-Identifier: GPL-3.0-or-later

"""The newest position, compared with the zones and with the route."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.events import PositionSeen
from mavproxy_handover.core.common.model import ZoneFact
from mavproxy_handover.monitors.position.source import PositionMonitor
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.base.output_dispatcher import OutputDispatcher
from mavproxy_handover.operator.uploads.flown_mission import MissionMonitors
from mavproxy_handover.tools.schedule import attempt

__all__ = ["ZoneCheck"]

#: a position that waited longer (s), because the main loop stood still, is not used: a newer one follows
_OLD_S: Final = 0.2


class ZoneCheck:
    """The zone check of one vehicle. Times are monotonic seconds."""

    def __init__(
        self, context: Context, monitors: MissionMonitors, positions: PositionMonitor, dispatcher: OutputDispatcher
    ) -> None:
        self._state = context.state
        self._fault = context.reports.fault
        self._handle = context.authority.handle
        self._monitors = monitors
        self._positions = positions
        self._dispatcher = dispatcher

    def facts(self) -> tuple[ZoneFact, ...]:
        """Facts about every zone at the last position; empty before a package and a position are known."""
        return self._monitors.waypoints.marked(self._state, self._monitors.zones.facts(self._state))

    def update(self, now: float) -> None:
        """Tell the rules where the last position is with respect to every zone; then check the route."""
        state, monitors = self._state, self._monitors
        state.compared()
        if now - state.position.at > _OLD_S:
            return
        if state.dead_reckoning and not self._positions.by_box:
            return
        self._handle(PositionSeen(self.facts(), monitors.gaps.fact(state)), now)
        attempt(self._fault, "route", self._check_route, now)

    def _check_route(self, now: float) -> None:
        self._dispatcher.dispatch(self._monitors.route.update(self._state, now), now)

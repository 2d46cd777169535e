# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs with the autopilot at fixed intervals: in each tick, and each second.

A fault in one job costs that job only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.monitors.borders import BorderMonitor
from mavproxy_handover.monitors.conditions import ConditionMonitor
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.mode_and_motion import ModeAndMotionMonitor
from mavproxy_handover.monitors.position.source import PositionMonitor
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.base.output_dispatcher import MonitorOutput, OutputDispatcher
from mavproxy_handover.operator.checks.preflight import Preflight
from mavproxy_handover.operator.orders import Orders
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.uploads.mission_on_board import MissionOnBoard
from mavproxy_handover.operator.vehicle.guard import Guard
from mavproxy_handover.operator.vehicle.streams import Streams
from mavproxy_handover.operator.vehicle.telemetry import Telemetry
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["RoundMonitors", "RoundParts", "Rounds"]


@dataclass(frozen=True, slots=True)
class RoundMonitors:
    """The monitors that look at the state each second."""

    positions: PositionMonitor
    energy: EnergyMonitor
    borders: BorderMonitor
    mode_and_motion: ModeAndMotionMonitor
    conditions: ConditionMonitor


@dataclass(frozen=True, slots=True)
class RoundParts:
    """The other parts that have work to do at intervals."""

    guard: Guard
    preflight: Preflight
    streams: Streams
    telemetry: Telemetry
    orders: Orders
    return_site: ReturnSite
    mission: MissionOnBoard


class Rounds:
    """The jobs of one vehicle at intervals. Times are monotonic seconds."""

    def __init__(
        self, context: Context, dispatcher: OutputDispatcher, monitors: RoundMonitors, parts: RoundParts
    ) -> None:
        self._context = context
        self._state = context.state
        self._dispatcher = dispatcher
        self._monitors = monitors
        self._parts = parts

    def tick(self, now: float) -> None:
        """To be called often."""
        parts = self._parts
        self._attempt("conversations", self._context.conversations.tick, now)
        parts.mission.tick(now)
        self._attempt("return sites", parts.return_site.tick, now)
        self._attempt("way home", parts.orders.tick, now)
        self._attempt("position box", self._update, self._monitors.positions.read, now)

    def each_second(self, view: AuthorityView, grounded: bool, now: float) -> None:
        """`view`: the authority in force; `grounded`: neither armed nor about to be."""
        parts, monitors = self._parts, self._monitors
        self._attempt("positions", self._update, monitors.positions.update, now)
        self._attempt("telemetry", parts.telemetry.each_second, view, now)
        self._attempt("streams", parts.streams.each_second, self._state, now)
        self._attempt("the mission on board", parts.mission.load_on_board, grounded, now)
        self._attempt("preflight", self._check, grounded, now)
        self._attempt("energy", self._watch_energy, grounded, now)
        self._attempt("the plan", parts.mission.flown.judge, now)
        self._attempt("the way ahead", parts.mission.do_later, now)
        self._attempt("the way ahead", self._update, monitors.borders.update, now)
        self._attempt("return sites", self._judge_places, now)
        self._attempt("motion", self._update, monitors.mode_and_motion.update, now)
        self._attempt("conditions", self._update, monitors.conditions.update, now)

    def _update(self, update: Callable[[VehicleState, float], Sequence[MonitorOutput]], now: float) -> None:
        """Update a monitor, and dispatch its output."""
        self._dispatcher.dispatch(update(self._state, now), now)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: object) -> None:
        attempt(self._context.reports.fault, where, job, *arguments)

    def _check(self, grounded: bool, now: float) -> None:
        guard = self._parts.guard
        firmware = None if guard.status is None else guard.status.firmware
        asked = grounded or self._state.always_armed
        rules = self._context.authority.arbiter
        self._parts.preflight.each_second(asked, rules.guard(now), firmware, now, guard.problem(now))

    def _watch_energy(self, grounded: bool, now: float) -> None:
        self._dispatcher.dispatch(self._monitors.energy.update(self._state, now, grounded=grounded), now)

    def _judge_places(self, now: float) -> None:
        self._parts.return_site.each_second(now, returning=self._parts.orders.returning)

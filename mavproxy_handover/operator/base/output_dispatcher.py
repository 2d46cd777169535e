# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends the output of the monitors on: events to the rules, news to people."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mavproxy_handover.core.common.events import Event
from mavproxy_handover.core.safety.route import RouteNews
from mavproxy_handover.monitors.energy import EnergyNews, EnergyWarned
from mavproxy_handover.monitors.position.source import BoxNews
from mavproxy_handover.operator.base.context import Reports

__all__ = ["MonitorOutput", "OutputDispatcher"]

MonitorOutput = Event | RouteNews | BoxNews | EnergyNews | EnergyWarned


class OutputDispatcher:
    """Sends events to `handle`, and news to the event log and to the stations."""

    def __init__(self, handle: Callable[[Event, float], None], reports: Reports) -> None:
        self._handle = handle
        self._reports = reports

    def dispatch(self, outputs: Iterable[MonitorOutput], now: float) -> None:
        """Send these on, in their order."""
        for output in outputs:
            match output:
                case RouteNews():
                    self._reports.event_log.route(output)
                case BoxNews():
                    self._reports.event_log.position_source(output.text, output.source, output.standing)
                    if output.severity is not None:
                        self._reports.message_sender.say_to_all(output.text, output.severity)
                case EnergyNews():
                    self._reports.event_log.energy(output.fact, aloud=output.aloud)
                    if output.for_stations:
                        self._reports.message_sender.say_to_all(output.for_stations)
                case EnergyWarned():
                    self._reports.event_log.energy_warning(output.shortfall)
                case _:
                    self._handle(output, now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""HANDOVER_TELEMETRY, once a second: to the commander, to the partner, and to the journal.

A position that is too old is not sent: an operator would take it for the present one.
"""

from __future__ import annotations

from collections.abc import Callable

from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["Telemetry"]


class Telemetry:
    """`zones`: as `Arbiter.zones`; `utc`: the time (s); `stale_s`: how old the position may be."""

    def __init__(
        self,
        aircraft: VehicleState,
        zones: Callable[[], tuple[int, int]],
        reports: Reports,
        utc: Callable[[], float],
        stale_s: float,
    ) -> None:
        self._aircraft = aircraft
        self._zones = zones
        self._reports = reports
        self._utc = utc
        self._stale_s = stale_s

    def each_second(self, view: AuthorityView, now: float) -> None:
        """Send position and state of the aircraft. `view`: the authority in force."""
        aircraft, reports = self._aircraft, self._reports
        where = aircraft.where
        if where is None or now - aircraft.position.at > self._stale_s:
            return
        zones = self._zones()
        reports.event_log.zones(zones)
        reports.event_log.position(where, zones, view.commander, aircraft.waypoint)
        for station in (view.commander, view.partner):
            port = reports.message_sender.ports.get(station or 0)
            if port is not None and station == view.commander:
                reports.event_log.telemetry(port.name)
            if port is not None:
                told = aircraft.record(port.target, int(self._utc() * 1e6), zones)
                attempt(reports.fault, f"sending to {port.name}", port.send, told)

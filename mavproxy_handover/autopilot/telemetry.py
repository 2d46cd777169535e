# SPDX-License-Identifier: GPL-3.0-or-later

"""HANDOVER_TELEMETRY, once a second: to the commander, to the partner that is about to take over, and to the journal.

A position that is too old goes to nobody: to an operator it would look like the present one.
"""

from __future__ import annotations

from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.core.model import AuthorityView
from mavproxy_handover.schedule import attempt
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["Telemetry"]


class Telemetry:
    """`stale_s`: how old the position may be."""

    def __init__(self, aircraft: VehicleState, ties: Ties, stale_s: float) -> None:
        self._aircraft = aircraft
        self._ties = ties
        self._stale_s = stale_s

    def each_second(self, view: AuthorityView, now: float) -> None:
        """Send where the aircraft is and what it does; `view`: the one in force."""
        aircraft, ties = self._aircraft, self._ties
        where = aircraft.where
        if where is None or now - aircraft.position.at > self._stale_s:
            return
        zones = ties.arbiter.zones()
        ties.narrator.zones(zones)
        ties.narrator.position(where, zones, view.commander, aircraft.waypoint)
        for station in (view.commander, view.partner):
            port = ties.voice.ports.get(station or 0)
            if port is not None and station == view.commander:
                ties.narrator.telemetry(port.name)
            if port is not None:
                told = aircraft.record(port.target, int(ties.clocks.utc() * 1e6), zones)
                attempt(ties.fault, f"sending to {port.name}", port.send, told)

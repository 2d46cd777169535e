# SPDX-License-Identifier: GPL-3.0-or-later

"""HANDOVER_TELEMETRY, once a second: to the commander, to the partner that is about to take over, and to the journal.

A position that is too old goes to nobody: to an operator it would look like the present one.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

from mavproxy_handover.autopilot.aircraft import Aircraft
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.model import AuthorityView
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.stations.port import StationPort

__all__ = ["Telemetry"]


class Telemetry:
    """`stale_s`: how old the position may be."""

    def __init__(
        self,
        aircraft: Aircraft,
        arbiter: Arbiter,
        ports: Mapping[int, StationPort],
        narrator: Narrator,
        stale_s: float,
    ) -> None:
        self._aircraft = aircraft
        self._arbiter = arbiter
        self._ports = ports
        self._narrator = narrator
        self._stale_s = stale_s

    def each_second(self, view: AuthorityView, now: float) -> None:
        """Send where the aircraft is and what it does; `view`: the one in force."""
        if now - self._aircraft.position_at > self._stale_s:
            return
        zone = self._arbiter.zone()
        self._narrator.position(self._aircraft, zone, view.commander)
        for station in (view.commander, view.partner):
            port = self._ports.get(station or 0)
            if port is not None:
                port.send(self._aircraft.telemetry(port.target, int(time.time() * 1e6), zone))

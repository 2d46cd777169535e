# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission package that a station holds for one vehicle, compared with the one that the vehicle announces.

An offer of another station counts once the vehicle announces it (`inbox.py`). The route check works only while the
vehicle flies the mission of the package that is held.
"""

from __future__ import annotations

from typing import Any

from gcs_module.core import MissionHeld, StationCore
from gcs_module.event_log import FlightEventLog
from gcs_module.mission_transfer import MissionTransfer
from gcs_module.route_watch import StationRouteWatch
from gcs_module.vehicle_state import VehicleState
from mavproxy_handover.mission.package import MissionPackage

__all__ = ["MissionSession"]


class MissionSession:
    """Times are monotonic seconds. `sysid`: the vehicle's."""

    def __init__(
        self,
        sysid: int,
        transfer: MissionTransfer,
        core: StationCore,
        state: VehicleState,
        route: StationRouteWatch,
        event_log: FlightEventLog,
    ) -> None:
        self._sysid = sysid
        self._transfer = transfer
        self._core = core
        self._state = state
        self._route = route
        self._event_log = event_log

    def on_message(self, sysid: int, component: int, message: Any, now: float) -> list[Any]:
        """A package message of the vehicle or of another station; returns the answers to it."""
        answers, line = self._transfer.on_message(sysid, component, message, now)
        if line:
            self._report(sysid, "package_sent", line)
        return answers

    def tick(self, now: float) -> list[tuple[int, Any]]:
        """(receiver, message) to send now; to be called often."""
        messages, lines = self._transfer.tick(now, lambda receiver: self._is_alive(receiver, now))
        for receiver, line in lines:
            self._report(receiver, "package_offer", line)
        return messages

    def update(self) -> MissionHeld | None:
        """Accept an offer that the vehicle announces, and compare the route with the package that is held. Returns the
        event for the rules if another package is held now."""
        inbox, announced = self._transfer.inbox, self._core.vehicle_digest
        line = inbox.accept_announced(announced, self._state.disarmed)
        if line:
            self._report(self._sysid, "package_received", line)
        held = inbox.held
        same = held is not None and held.digest == announced
        self._route.compare_to(held if same and not self._state.rerouted else None)
        return MissionHeld(held.digest) if held is not None and held.digest != self._core.digest else None

    def flown(self) -> MissionPackage | None:
        """The package that the vehicle announces, or the one that is held while the vehicle has announced none."""
        held, announced = self._transfer.held, self._core.vehicle_digest
        return held if held is not None and (not any(announced) or announced == held.digest) else None

    def _is_alive(self, receiver: int, now: float) -> bool:
        if receiver == self._sysid:
            return self._core.vehicle_alive(now)
        return self._core.peer_alive(receiver, now)

    def _report(self, sysid: int, event: str, line: str) -> None:
        """A line about the package exchange. `sysid`: the other end; 0: this station."""
        name = "this station" if not sysid else "vehicle" if sysid == self._sysid else self._core.name(sysid)
        self._event_log.package(event, line, name)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends Remote ID's operator to the autopilot: OPEN_DRONE_ID_SYSTEM, _SYSTEM_UPDATE and _OPERATOR_ID.

When which place is sent: `core/remote_id.py`. The autopilot passes it on to its transponder. If neither the mission nor
a program of the commander has a place, while the vehicle has Remote ID, all stations are told.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.remote_id import RemoteIdSettings
from mavproxy_handover.core.remote_id import OperatorPlace, Operators, RemoteIdRule, Sending
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["RemoteId"]

#: the whole message and the id come with every third place; the others are an update
_WHOLE_EVERY: Final = 3
#: Remote ID counts time from 2019-01-01 UTC
_EPOCH_S: Final = 1_546_300_800
_UNKNOWN_M: Final = -1000.0
_NO_ID: Final = b"\0" * 20
#: time (s) from which on a missing place is told, and between two such texts
_MISSING_S, _AGAIN_S = 5.0, 60.0


@dataclass(frozen=True, slots=True)
class RemoteIdSources:
    """Sources of the operator's place. `package`: the mission on board; `utc`: the time (s)."""

    in_force: AuthorityInForce
    operators: Operators
    package: Callable[[], MissionPackage | None]
    utc: Callable[[], float]


class RemoteId:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        settings: RemoteIdSettings,
        sources: RemoteIdSources,
        aircraft: VehicleState,
        reports: Reports,
    ) -> None:
        self._vehicle = vehicle
        self._settings = settings
        self._rule = RemoteIdRule(sources.operators)
        self._sources = sources
        self._aircraft = aircraft
        self._reports = reports
        #: the station whose operator was told last
        self._station: int | None = None
        #: since when the place of the operator is missing
        self._missing_at = math.inf
        #: when that was told last
        self._told_at = -math.inf

    def tick(self, now: float) -> None:
        """Send what is due; to be called often."""
        if not self._settings.companion:
            return
        rule = self._rule
        sending = rule.due(self._sources.in_force.view.commander, self._planned(), now)
        if sending is not None:
            self._send(sending)
        self._missing_at = min(self._missing_at, now) if rule.unknown else math.inf
        if now - self._missing_at >= _MISSING_S and now - self._told_at >= _AGAIN_S:
            self._told_at = now
            self._tell_missing()

    def _planned(self) -> Mapping[int, OperatorPlace]:
        package = self._sources.package()
        stations = () if package is None else package.stations
        return {each.sysid: OperatorPlace(*each.place) for each in stations if each.place is not None}

    def _send(self, sending: Sending) -> None:
        to_autopilot = self._reports.message_sender.to_autopilot
        place, since_s = sending.place, max(0, int(self._sources.utc()) - _EPOCH_S)
        at = (round(place.lat_deg * 1e7), round(place.lon_deg * 1e7))
        if sending.number % _WHOLE_EVERY:
            to_autopilot(
                mavlink.MAVLink_open_drone_id_system_update_message(self._vehicle, 0, *at, place.height_m, since_s)
            )
            return
        settings = self._settings
        eu = (settings.category_eu, settings.class_eu)
        located = (
            mavlink.MAV_ODID_OPERATOR_LOCATION_TYPE_LIVE_GNSS
            if place.live
            else mavlink.MAV_ODID_OPERATOR_LOCATION_TYPE_FIXED
        )
        area = (1, 0, _UNKNOWN_M, _UNKNOWN_M)
        to_autopilot(
            mavlink.MAVLink_open_drone_id_system_message(
                self._vehicle, 0, _NO_ID, located, int(any(eu)), *at, *area, *eu, place.height_m, since_s
            )
        )
        if sending.operator_id:
            name = sending.operator_id.encode("ascii").ljust(20, b"\0")
            to_autopilot(mavlink.MAVLink_open_drone_id_operator_id_message(self._vehicle, 0, _NO_ID, 0, name))
        if self._station != sending.station:
            self._station = sending.station
            port = self._reports.message_sender.ports[sending.station]
            self._reports.event_log.remote_id(port.name, place.lat_deg, place.lon_deg, sending.operator_id)

    def _tell_missing(self) -> None:
        """Tell all stations that the operator's place is missing, if the vehicle has Remote ID."""
        enabled = self._aircraft.parameters.get("DID_ENABLE")
        port = self._reports.message_sender.ports.get(self._rule.station or 0)
        if port is None or enabled is None or enabled.value < 1.0:
            return
        text = f"Remote ID: the place of {port.name} is not known ('place' in [[stations]] of the mission)."
        self._reports.event_log.remote_id_missing(port.name, text)
        self._reports.message_sender.say_to_all(text)

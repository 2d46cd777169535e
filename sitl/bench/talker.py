# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that takes part in transfers by the rules that ship (`StationCore`), on a socket of the bench's own.

So what it may send besides is up to the measurement. There is no ground link: the vehicle passes on what the stations
have to say to each other.
"""

from __future__ import annotations

import time
from typing import Any

from gcs_module.core import AuthorityHeard, FromVehicle, MissionHeld, StationCore, ToVehicle, VehicleHeard
from mavproxy_handover.core.model import AUTOMATIC, LeaseState, Phase, Station
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.ids import COMPANION_COMPID
from sitl.bench.loop import Loop
from sitl.bench.station import FakeStation
from sitl.bench.traffic import VEHICLE

__all__ = ["TalkingStation"]


class TalkingStation(FakeStation):
    """It consents to everything at once."""

    def __init__(self, loop: Loop, name: str, sysid: int, key: bytes | None = None) -> None:
        super().__init__(loop, name, sysid, key)
        self._core = StationCore(Station(sysid, name), "drone-1", (), automatic=AUTOMATIC)

    def hold(self, package: MissionPackage) -> None:
        """It has the mission package."""
        self.digest = package.digest
        self._core.handle(MissionHeld(package.digest), time.monotonic())

    def _take(self, raw: bytes) -> None:
        message = codec.decode_bytes(raw)
        if message is None:
            return
        kind, now = message.get_type(), time.monotonic()
        decoded = codec.decode(message)
        event: Any = VehicleHeard() if decoded is None else FromVehicle(decoded)
        if kind == "AUTHORITY_STATUS":
            who = message.commander or None, message.partner or None
            recovering = message.lease == LeaseState.RECOVERING
            event = AuthorityHeard(Phase(message.phase), *who, message.epoch, message.handover_id, recovering)
        for action in self._core.handle(event, now):
            if isinstance(action, ToVehicle):
                self.send(codec.encode(action.message, (VEHICLE, COMPANION_COMPID), VEHICLE))
        if kind != "CONNECT":  # the core has answered that
            super()._take(raw)

# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that takes part in transfers by the rules that ship (`StationCore`), on a socket of the bench's own.

So what it may send besides is up to the measurement. Without a ground link (`ground.py`) the vehicle passes on what the
stations have to say to each other.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from gcs_module.core import (
    AuthorityHeard,
    Event,
    FromVehicle,
    MissionHeld,
    StationCore,
    ToPeer,
    ToVehicle,
    VehicleHeard,
)
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import AUTOMATIC, LeaseState, Phase, Reason, Station
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire import codec
from sitl.bench.loop import Loop
from sitl.bench.station import FakeStation
from sitl.bench.traffic import VEHICLE

__all__ = ["TalkingStation"]


class TalkingStation(FakeStation):
    """A station that consents to every transfer at once."""

    def __init__(
        self,
        loop: Loop,
        name: str,
        sysid: int,
        key: bytes | None = None,
        vehicle: int = VEHICLE,
        peers: tuple[Station, ...] = (),
    ) -> None:
        """`peers`: the stations that it reaches over a ground link, once it has one."""
        super().__init__(loop, name, sysid, key, vehicle)
        #: sends another station a message over the ground link
        self.to_peer: Callable[[int, Message], None] = lambda _peer, _message: None
        self._core = StationCore(Station(sysid, name), "drone-1", peers, automatic=AUTOMATIC)

    def hold(self, package: MissionPackage) -> None:
        """The station holds this mission package."""
        self.digest = package.digest
        self.hear(MissionHeld(package.digest))

    def reaches(self, peer: int) -> bool:
        """Whether another station is heard over the ground link."""
        return self._core.peer_alive(peer, time.monotonic())

    def hear(self, event: Event) -> None:
        """Do what the rules say to an event."""
        for action in self._core.handle(event, time.monotonic()):
            if isinstance(action, ToVehicle):
                self.send(codec.encode(action.message, self.companion, self.companion[0]))
            elif isinstance(action, ToPeer):
                self.to_peer(action.peer, action.message)

    def _take(self, raw: bytes) -> None:
        message = codec.decode_bytes(raw)
        if message is None:
            return
        kind = message.get_type()
        decoded = codec.decode(message)
        event: Any = VehicleHeard() if decoded is None else FromVehicle(decoded)
        if kind == "AUTHORITY_STATUS":
            who = message.commander or None, message.partner or None
            recovering = message.lease == LeaseState.RECOVERING
            event = AuthorityHeard(
                Phase(message.phase),
                *who,
                message.epoch,
                message.handover_id,
                recovering,
                Reason(message.transfer_reason),
                crossing=message.crossing,
            )
        self.hear(event)
        if kind != "CONNECT":  # the core has answered that
            super()._take(raw)

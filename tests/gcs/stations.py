# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations as tests of their rules begin: who they are, what they have heard, and what they say."""

from __future__ import annotations

from gcs_module.core import Action, AuthorityHeard, FromVehicle, Notice, PeerHeard, StationCore, VehicleHeard
from mavproxy_handover.core.common.messages import Message, OnHandover, TransferKey
from mavproxy_handover.core.common.model import AUTOMATIC, Phase, Reason, Station

__all__ = [
    "DIGEST",
    "KEY",
    "NAMES",
    "NOW",
    "A",
    "B",
    "C",
    "announced",
    "from_vehicle",
    "notices",
    "partner",
    "passed_on",
    "station",
    "words",
]

A, B, C = 251, 252, 253
NAMES = {A: "GCSA", B: "GCSB", C: "GCSC"}
#: from A to B, number 7, in epoch 3
KEY = TransferKey(A, B, 7, 3)
DIGEST = bytes(range(32))
NOW = 100.0


def station(sysid: int, *, asks: bool = False, commander: int | None = A, epoch: int = 3) -> StationCore:
    """A station that has heard who commands."""
    peers = tuple(Station(other, name) for other, name in NAMES.items() if other != sysid)
    core = StationCore(Station(sysid, NAMES[sysid]), "drone", peers, automatic=() if asks else AUTOMATIC)
    core.handle(AuthorityHeard(Phase.ON_MISSION, commander, None, epoch), NOW)
    core.handle(VehicleHeard(), NOW)
    return core


def partner(*, asks: bool = False, ground: bool = True) -> StationCore:
    """Station B while A commands, with a ground link to it or without."""
    core = station(B, asks=asks)
    if ground:
        core.handle(PeerHeard(A), NOW)
    return core


def announced(core: StationCore, key: TransferKey = KEY) -> StationCore:
    """The vehicle has said that this transfer is under way."""
    status = AuthorityHeard(
        Phase.ON_HANDOVER, key.from_station, key.to_station, key.epoch, key.handover_id, why=Reason.ZONE
    )
    core.handle(status, NOW)
    return core


def passed_on(key: TransferKey = KEY) -> OnHandover:
    """The partner's word, as the vehicle passes it on and says why it asks."""
    return OnHandover(key, reason=Reason.ZONE, relayed=True)


def from_vehicle(core: StationCore, message: Message, now: float = NOW) -> list[Action]:
    """What a station does about a message of the vehicle."""
    return core.handle(FromVehicle(message), now)


def words(actions: list[Action]) -> list[Action]:
    """What goes out, without what the operator reads."""
    return [action for action in actions if not isinstance(action, Notice)]


def notices(actions: list[Action]) -> list[str]:
    """What the operator reads."""
    return [action.text for action in actions if isinstance(action, Notice)]

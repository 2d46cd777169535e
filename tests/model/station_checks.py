# SPDX-License-Identifier: GPL-3.0-or-later

"""What must hold for a station at every step of an exploration, and between the stations and the vehicle.

1. A station's epoch does not fall, and it never speaks of an old one.
2. It says only what is the commander's or the partner's to say, whichever it is in that transfer.
3. It releases only what it has consented to; where the operator decides, it consents only to what he agreed to.
4. No station is ahead of the vehicle. One that believes to command in the vehicle's epoch does, or nobody does.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from gcs_module import core as gcs
from mavproxy_handover.core.messages import (
    Connect,
    ConnectAck,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.model import Consent
from tests.model.checks import demand

__all__ = ["StationBefore", "StationBooks", "check_beliefs", "check_station"]


@dataclass(frozen=True, slots=True)
class StationBooks:
    """What a station has said since it started: the transfer it consented to, and the one its operator agreed to."""

    granted: TransferKey | None = None
    agreed: TransferKey | None = None
    #: whom its operator wished to command
    wished: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class StationBefore:
    """What a station was before an event. `asked`: its operator decides."""

    station: int
    asked: bool
    epoch: int
    question: TransferKey | None


def check_station(
    books: StationBooks, before: StationBefore, event: gcs.Event, said: Iterable[gcs.Action], core: gcs.StationCore
) -> StationBooks:
    """Judge what a station made of one event; returns its books after it."""
    station = before.station
    demand(core.epoch >= before.epoch, "a station's epoch fell")
    if isinstance(event, gcs.Answer) and event.yes and before.question is not None:
        books = replace(books, agreed=before.question)
    if isinstance(event, gcs.Wish):
        books = replace(books, wished=books.wished | {event.station})
    for action in said:
        if not isinstance(action, (gcs.ToVehicle, gcs.ToPeer)):
            continue
        word = action.message
        if isinstance(word, (Connect, ConnectAck)):
            continue
        key = word.key
        demand(key.epoch >= core.epoch, f"{type(word).__name__} about an old epoch")
        if isinstance(word, (OkHandover, DisconnectHandover)):
            demand(key.from_station == station, f"{type(word).__name__} for another commander")
        if isinstance(word, (OnHandover, DroneConnected)):
            demand(key.to_station == station, f"{type(word).__name__} for another partner")
        granting = isinstance(word, (OkHandover, OnHandover)) and word.consent is Consent.GRANTED
        if before.asked and (granting or isinstance(word, DroneConnected)):
            agreed = books.agreed == key or key.to_station in books.wished
            demand(agreed, f"{type(word).__name__} without the operator's word")
        if isinstance(word, OkHandover) and granting:
            books = replace(books, granted=key)
        if isinstance(word, DisconnectHandover):
            demand(books.granted == key, "released what it had not consented to")
    return books


class Believer(Protocol):
    """What a station believes."""

    @property
    def station(self) -> int: ...
    @property
    def commander(self) -> int | None: ...
    @property
    def epoch(self) -> int: ...


def check_beliefs(commander: int | None, epoch: int, blank: bool, beliefs: Iterable[Believer]) -> None:
    """No station is ahead of the vehicle, and none commands beside it."""
    if blank:
        return
    for each in beliefs:
        demand(each.epoch <= epoch, f"station {each.station} is ahead of the vehicle")
        if each.commander == each.station and each.epoch == epoch:
            here = commander in (each.station, None)
            demand(here, f"station {each.station} believes to command in the vehicle's own epoch")

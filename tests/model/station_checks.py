# SPDX-License-Identifier: GPL-3.0-or-later

"""What must hold for a station at every step of an exploration, and between the stations and the vehicle.

1. A station's epoch does not fall, and it never speaks of an old one.
2. It says only what is the commander's or the partner's to say, whichever it is in that transfer.
3. It releases only what it has consented to. Without its operator's word it consents only where it is not the operator
   who decides, and the vehicle has said that it asks for a reason that needs none.
4. No station is ahead of the vehicle. One that believes to command in the vehicle's epoch does, or nobody does.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from gcs_module import core as gcs
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import QUESTIONS, Consent
from tests.model.checks import demand

__all__ = ["StationBefore", "StationBooks", "check_beliefs", "check_station"]


@dataclass(frozen=True, slots=True)
class StationBooks:
    """What a station has said since it started: the transfer it consented to, and the one its operator agreed to."""

    granted: TransferKey | None = None
    agreed: TransferKey | None = None
    #: the transfer that the vehicle has given a reason for that needs no operator
    excused: TransferKey | None = None
    #: and the one before: what is late says it again
    excused_before: TransferKey | None = None
    #: the same, said to everybody
    announced: TransferKey | None = None
    #: whom its operator wished to command
    wished: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class StationBefore:
    """What a station was before an event. `automatic`: the questions that need no operator there."""

    station: int
    automatic: Collection[str]
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
        if before.question is not None and before.question.to_station == event.station:  # to ask for it is to accept it
            books = replace(books, agreed=before.question)
    if isinstance(event, gcs.WishAnswered) and not event.accepted:
        books = replace(books, wished=books.wished - {event.station})
    excused = _excused(event, before.automatic)
    if isinstance(event, gcs.AuthorityHeard):
        books = replace(books, announced=excused or books.announced)
    elif excused is not None and excused != books.excused:
        books = replace(books, excused=excused, excused_before=books.excused)
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
        if granting or isinstance(word, DroneConnected):
            agreed = books.agreed == key or key.to_station in books.wished
            agreed = agreed or key in (books.announced, books.excused, books.excused_before)
            demand(agreed, f"{type(word).__name__} without the operator's word")
        if isinstance(word, OkHandover) and granting:
            books = replace(books, granted=key)
        if isinstance(word, DisconnectHandover):
            demand(books.granted == key, "released what it had not consented to")
    return books


def _excused(event: gcs.Event, automatic: Collection[str]) -> TransferKey | None:
    """The transfer for which the vehicle gives a reason that needs no operator at this station."""
    if isinstance(event, gcs.AuthorityHeard) and event.commander and event.partner:
        key = TransferKey(event.commander, event.partner, event.handover_id, event.epoch)
        return key if QUESTIONS.get(event.why) in automatic else None
    if isinstance(event, gcs.FromVehicle) and isinstance(event.message, (HandoverRequest, OnHandover)):
        return event.message.key if QUESTIONS.get(event.message.reason) in automatic else None
    return None


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

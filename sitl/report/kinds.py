# SPDX-License-Identifier: GPL-3.0-or-later

"""Which handovers went alike: one picture is enough for those, and the others are worth a look.

Two are alike when the same messages went the same ways between the same parts (commander, vehicle, partner), none was
sent twice or lost, and they ended alike. The order in which messages of the same moment were noted does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sitl.report.exchange import Exchange, Flight

__all__ = ["Kind", "Row", "kinds", "rows"]

#: a pause longer than this (s) between two messages is drawn as one
_PAUSE_S = 0.25


@dataclass(frozen=True, slots=True)
class Kind:
    """Handovers that went alike; `first` is drawn for all. `odd`: something went otherwise than by the book."""

    first: Exchange
    others: tuple[Exchange, ...]
    odd: bool


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a picture: a message, several alike, or the commit or the abort.

    `last`: the last one of several; `pause_s`: the time that passed before it, if it is worth showing.
    """

    flight: Flight | None
    times: int = 1
    last: Flight | None = None
    pause_s: float | None = None


def kinds(transfers: Sequence[Exchange]) -> list[Kind]:
    """The kinds, in the order in which they first came."""
    groups: dict[object, list[Exchange]] = {}
    for transfer in transfers:
        odd = is_odd(transfer)
        key = (transfer.vehicle, transfer.handover_id, transfer.begun_t) if odd else _shape(transfer)
        groups.setdefault(key, []).append(transfer)
    return [Kind(group[0], tuple(group[1:]), is_odd(group[0])) for group in groups.values()]


def is_odd(transfer: Exchange) -> bool:
    """Whether anything went otherwise than by the book: not committed, a message lost, sent again, or late."""
    return not transfer.committed or any(
        flight.lost or flight.attempt > 1 or flight.consent not in ("", "granted") for flight in transfer.flights
    )


def _shape(transfer: Exchange) -> object:
    parts = {transfer.commander: "commander", transfer.partner: "partner", transfer.vehicle: "vehicle"}
    return frozenset(
        (flight.name, parts.get(flight.sender), parts.get(flight.receiver), flight.relayed, flight.ground)
        for flight in transfer.flights
    )


def rows(transfer: Exchange) -> list[Row]:
    """The rows of a handover: repetitions of a message together, with pauses, the end in its place."""
    before = [flight for flight in transfer.flights if not _after(transfer, flight)]
    after = [flight for flight in transfer.flights if _after(transfer, flight)]
    found = _told(before)
    if transfer.ended_t is not None:
        found.append(Row(None, pause_s=_pause(before[-1].t, transfer.ended_t) if before else None))
    return found + _told(after)


def _after(transfer: Exchange, flight: Flight) -> bool:
    return transfer.ended_t is not None and (flight.t > transfer.ended_t or flight.name == "HANDOVER_RESULT")


def _told(flights: Sequence[Flight]) -> list[Row]:
    found: list[Row] = []
    open_rows: dict[object, int] = {}
    last_t: float | None = None
    for flight in flights:
        key = (flight.name, flight.sender, flight.receiver, flight.relayed, flight.lost, flight.consent)
        place = open_rows.get(key)
        if place is not None:
            row = found[place]
            found[place] = Row(row.flight, row.times + 1, flight, row.pause_s)
        else:
            pause_s = None if last_t is None else _pause(last_t, flight.t)
            open_rows = {each: at for each, at in open_rows.items() if len(found) - at <= _ALIKE_WITHIN}
            open_rows[key] = len(found)
            found.append(Row(flight, pause_s=pause_s))
        last_t = flight.t
    return found


#: repetitions of several messages in turn are put together as long as there are no more kinds of them than this
_ALIKE_WITHIN = 8


def _pause(before_t: float, t: float) -> float | None:
    return t - before_t if t - before_t > _PAUSE_S else None

# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages of each handover, put together from the journals of both ends, with sender and times.

A message is journalled by its sender ("out") and by its receiver ("in"). The two entries are paired by transfer, name,
sender and receiver, in order, and only forwards in time; one that has no second half was lost, unless its receiver left
no record at all. The entry names the other end: `via = "ground"` is the other station, anything else at a station is
the vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sitl.report.evidence import Evidence
from sitl.report.journal_reader import Entry

__all__ = ["Exchange", "Flight", "exchanges", "lanes"]

#: an answer to the outcome may come this much later and still belongs to the picture
_TAIL_S = 0.5


@dataclass(frozen=True, slots=True)
class Flight:
    """One message on its way. Times are monotonic; None: not noted."""

    name: str
    sender: str
    receiver: str
    sent_t: float | None
    received_t: float | None
    attempt: int = 1
    relayed: bool = False
    ground: bool = False
    consent: str = ""
    #: it did not come; one whose receiver left no record may have come for all we know
    lost: bool = False

    @property
    def t(self) -> float:
        """When it first shows in a journal."""
        return self.sent_t if self.sent_t is not None else self.received_t or 0.0


@dataclass(frozen=True, slots=True)
class Exchange:
    """One handover: its parties, its outcome and its messages in order. `duration_s` as the vehicle measured it."""

    handover_id: int
    vehicle: str
    commander: str
    partner: str
    begun_t: float
    ended_t: float | None
    committed: bool
    reason: str
    duration_s: float | None
    epoch: int | None
    flights: tuple[Flight, ...]


def exchanges(evidence: Evidence) -> list[Exchange]:
    """Every transfer of the run, in order."""
    changes = evidence.commanders()
    found = []
    for begun in evidence.of(event="transfer_begun"):
        number = begun.get("handover_id")
        end = next(
            (
                entry
                for entry in evidence.entries
                if entry.t >= begun.t
                and entry.event in ("transfer_committed", "transfer_aborted")
                and entry.get("handover_id") == number
            ),
            None,
        )
        took = None if end is None else end.get("duration_s")
        # the vehicle counts from the position that made it begin, a moment before it could write that down
        since = begun.t if end is None or not isinstance(took, (int, float)) else min(begun.t, end.t - took)
        until = evidence.entries[-1].t if end is None else end.t + _TAIL_S
        partner = str(begun.get("station", "?"))
        found.append(
            Exchange(
                handover_id=int(number or 0),
                vehicle=begun.who,
                commander=evidence.commander_at(begun.t, changes),
                partner=partner,
                begun_t=since,
                ended_t=None if end is None else end.t,
                committed=end is not None and end.event == "transfer_committed",
                reason=str((end or begun).get("reason", "")),
                duration_s=took,
                epoch=None if end is None else end.get("epoch"),
                flights=tuple(_flights(evidence, begun, until)),
            )
        )
    return found


def _flights(evidence: Evidence, begun: Entry, until: float) -> list[Flight]:
    vehicle = begun.who
    witnesses = {entry.who for entry in evidence.of(event="message")}
    entries = [
        entry
        for entry in evidence.of(event="message")
        # a station may note the request a moment before the vehicle has written that it began
        if begun.t - 0.1 <= entry.t <= until and entry.get("handover_id") == begun.get("handover_id")
    ]
    halves = [_half(entry, vehicle) for entry in entries]
    routes = dict.fromkeys((half.name, half.sender, half.receiver) for half in halves)
    flights = [
        flight
        for route in routes
        for flight in _pair([half for half in halves if (half.name, half.sender, half.receiver) == route])
    ]
    flights = [replace(flight, lost=flight.received_t is None and flight.receiver in witnesses) for flight in flights]
    return sorted(flights, key=lambda flight: flight.t)


def _half(entry: Entry, vehicle: str) -> Flight:
    other = str(entry.get("station", "?"))
    ground = entry.get("via") == "ground"
    if entry.who != vehicle and not ground:
        other = vehicle
    out = entry.get("direction") == "out"
    return Flight(
        name=str(entry.get("name", "?")),
        sender=entry.who if out else other,
        receiver=other if out else entry.who,
        sent_t=entry.t if out else None,
        received_t=None if out else entry.t,
        attempt=int(entry.get("attempt") or 1),
        relayed=bool(entry.get("relayed")),
        ground=ground,
        consent=str(entry.get("consent") or ""),
    )


def _pair(halves: list[Flight]) -> list[Flight]:
    """Join sendings and arrivals of one message on one way.

    When as many came as were sent, the first came first. When some were lost, an arrival belongs to the last sending
    before it: a repetition is sent because what went before did not come.
    """
    sent = [half for half in halves if half.sent_t is not None]
    arrived = [half for half in halves if half.received_t is not None]
    some_lost = len(arrived) < len(sent)
    joined = []
    for arrival in reversed(arrived) if some_lost else arrived:
        assert arrival.received_t is not None
        # journals have ten-thousandths of a second: an arrival may seem that much too early
        before = [half for half in sent if half.t <= arrival.received_t + 0.0005]
        if not before:
            joined.append(arrival)
            continue
        departure = before[-1 if some_lost else 0]
        sent.remove(departure)
        joined.append(
            replace(
                departure,
                received_t=max(departure.t, arrival.received_t),
                relayed=departure.relayed or arrival.relayed,
            )
        )
    return joined + sent


def lanes(exchange: Exchange) -> Sequence[str]:
    """The parties from left to right: the vehicle stands between the stations."""
    return (exchange.commander, exchange.vehicle, exchange.partner)

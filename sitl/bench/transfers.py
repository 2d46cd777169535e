# SPDX-License-Identifier: GPL-3.0-or-later

"""How long a transfer takes: on loopback, over slow links, over lossy ones.

Loopback is measured with real processes, because the programs themselves take the time. Over bad links the links take
it, and hundreds of transfers one after the other take hours. So these are flown in lanes: many vehicles side by side in
this process, with the real modules and real sockets and only MAVProxy's main loop replaced. Two of the weathers are
also flown with real processes, fewer times, to show that it makes no difference.

A link has the same delay and loss each way; vehicle to stations, and station to station.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sitl.bench.durations import Committed, read_journal, transfers
from sitl.bench.flight import Flight
from sitl.bench.lanes import Lane
from sitl.bench.loop import BenchError, Loop
from sitl.bench.numbers import median, quantile
from sitl.bench.results import Measurement
from sitl.script.weather import Weather

__all__ = ["LOSSY", "SLOW", "Condition", "LanePlan", "fly_lanes", "fly_loopback", "fly_with_bad_links"]

#: "Numbers that are held to" in docs/architecture.md, in milliseconds
LOOPBACK_MEDIAN_MS, LOOPBACK_LATE_MS = 10.0, 50.0
ONE_WAY_TRIPS, SLACK_MS = 6, 50.0
#: after take-off, until every station has answered CONNECT with the mission that it holds
_SETTLE_S = 3.0
LOSSY_LATE_MS = 3000.0


@dataclass(frozen=True, slots=True)
class Condition:
    """The properties of the links. `late_limit_ms`: the limit for 99 of 100 transfers; None: no limit."""

    name: str
    weather: Weather
    #: about this time (s) between a commit and the next entry
    pause_s: float
    #: lanes that share the work in a full run
    lanes: int
    late_limit_ms: float | None
    median_limit_ms: float | None = None

    @property
    def trips_limit_ms(self) -> float:
        """Six one-way trips, without any time for the programs."""
        return ONE_WAY_TRIPS * self.weather.delay_s * 1e3


def _slow(delay_s: float, lanes: int) -> Condition:
    limit_ms = ONE_WAY_TRIPS * delay_s * 1e3 + SLACK_MS
    return Condition(f"{delay_s * 1e3:g} ms one way", Weather(delay_s=delay_s), 0.3 + 2 * delay_s, lanes, limit_ms)


def _lossy(loss: float, lanes: int, limit_ms: float | None) -> Condition:
    return Condition(f"{loss:.0%} loss each way", Weather(loss=loss), 0.6, lanes, limit_ms)


#: conditions that are flown at the same time; together they must leave the machine most of its time
SLOW = (_slow(0.05, 2), _slow(0.25, 6))
LOSSY = (_lossy(0.05, 2, None), _lossy(0.20, 5, LOSSY_LATE_MS), _lossy(0.40, 8, None))
_LOOPBACK = Condition("loopback", Weather(), 0.15, 1, LOOPBACK_LATE_MS, LOOPBACK_MEDIAN_MS)


@dataclass(frozen=True, slots=True)
class LanePlan:
    """Transfers of each condition, the time limit for all of them, and lanes (None: as many as usual)."""

    transfers: int
    limit_s: float
    lanes: int | None = None


def _measurements(
    condition: Condition, flown: Sequence[Committed], how: str, given_up: int, wanted: int
) -> Iterator[Measurement]:
    if not flown:
        raise BenchError(f"{condition.name}: not one transfer was committed")
    since_entry = [one.since_entry_s * 1e3 for one in flown]
    attempt = [one.duration_s * 1e3 for one in flown]
    messages = [float(one.messages) for one in flown]
    case = {"links": condition.name, "how": how}
    details: dict[str, Any] = {
        "transfers": len(flown),
        "wanted": wanted,
        "median_ms": median(since_entry),
        "p95_ms": quantile(since_entry, 0.95),
        "p99_ms": quantile(since_entry, 0.99),
        "max_ms": max(since_entry),
        "committed_attempt_ms": {
            "median": median(attempt),
            "p95": quantile(attempt, 0.95),
            "p99": quantile(attempt, 0.99),
            "max": max(attempt),
        },
        "six_one_way_trips_ms": condition.trips_limit_ms,
        "messages_median": median(messages),
        "messages_max": max(messages),
        "attempts_that_failed": sum(one.failed_attempts for one in flown),
        "committed_by_release_timeout": sum(one.by_timeout for one in flown),
        "entries_given_up": given_up,
    }
    limits = {"median": condition.median_limit_ms, "99 %": condition.late_limit_ms}
    note = (
        "from the zone check that noticed the region to the commit, failed attempts included; "
        "baseline: six one-way trips"
    )
    numbers = {"median": 0.5, "95 %": 0.95, "99 %": 0.99, "max": 1.0}
    for name, part in numbers.items():
        yield Measurement(
            "transfers",
            f"duration, {name}",
            "ms",
            {**case, "n": len(flown), "messages": round(median(messages))},
            ours=quantile(since_entry, part),
            baseline=condition.trips_limit_ms or None,
            limit=limits.get(name),
            judged="ours",
            details=details if name == "median" else {},
            note=note,
        )


def _of(journals: Sequence[Sequence[dict[str, Any]]]) -> list[Committed]:
    return transfers(journals[0], journals[1:])


def fly_loopback(
    folder: Path, wanted: int, limit_s: float, say: Callable[[str], None], *, signing: bool
) -> Iterator[Measurement]:
    """Real processes, perfect links."""
    condition = replace(_LOOPBACK, name="loopback, signed" if signing else "loopback")
    with Flight(folder, condition.pause_s, signing=signing) as flight:
        flight.shuttle_until(wanted, limit_s)
        flown = _of(flight.journals)
        given_up = flight.shuttle.given_up
    yield from _measurements(condition, flown, "real processes", given_up, wanted)
    took_ms = median([one.duration_s for one in flown]) * 1e3
    say(f"{condition.name}, real processes: {len(flown)} transfers, median {took_ms:.1f} ms")


def fly_with_bad_links(folder: Path, each: int, limit_s: float, say: Callable[[str], None]) -> Iterator[Measurement]:
    """Real processes over 50 ms one way, then over 20 % loss: the check on the lanes."""
    slow, lossy = SLOW[0], LOSSY[1]
    orders = {slow.name: ("delay all 0.05",), lossy.name: ("delay all 0", "loss all 0.2")}
    with Flight(folder, lossy.pause_s, bad_links=True, seed=2) as flight:
        for condition in (slow, lossy):
            for order in orders[condition.name]:
                flight.weather(order)
            # the transfer that the change of weather fell into is left out
            flight.shuttle_until(flight.shuttle.commits + 1, limit_s)
            before, given_up = len(_of(flight.journals)), flight.shuttle.given_up
            flight.shuttle_until(flight.shuttle.commits + each, limit_s)
            flown = _of(flight.journals)[before:]
            say(f"{condition.name}, real processes: {len(flown)} transfers")
            yield from _measurements(condition, flown, "real processes", flight.shuttle.given_up - given_up, each)


class _Fleet:
    """The lanes of one condition."""

    def __init__(self, loop: Loop, folder: Path, condition: Condition, lanes: int, seed: int) -> None:
        self.condition = condition
        self.lanes: list[Lane] = []
        self.open = True
        for number in range(lanes):
            name = f"{condition.name.replace(' ', '-').replace('%', '')}-{number}"
            self.lanes.append(Lane(loop, folder / name, condition.weather, condition.pause_s, seed + number))

    @property
    def commits(self) -> int:
        return sum(lane.shuttle.commits for lane in self.lanes)

    def close(self) -> None:
        if self.open:
            self.open = False
            for lane in self.lanes:
                lane.close()

    def flown(self) -> list[Committed]:
        return [one for lane in self.lanes for one in _of([read_journal(path) for path in lane.wires.journals])]


def fly_lanes(
    folder: Path, conditions: Sequence[Condition], plan: LanePlan, say: Callable[[str], None]
) -> Iterator[Measurement]:
    """These conditions at the same time; each ends when it has enough."""
    loop = Loop(many=True)
    fleets: list[_Fleet] = []
    try:
        for number, condition in enumerate(conditions):
            lanes = condition.lanes if plan.lanes is None else plan.lanes
            fleets.append(_Fleet(loop, folder, condition, lanes, 1000 * (number + 1)))
        lanes_of_all = [lane for fleet in fleets for lane in fleet.lanes]
        for lane in lanes_of_all:
            lane.begin()
            loop.run(0.037)  # not all in step
        loop.run_until(lambda: all(lane.commanded for lane in lanes_of_all), 60.0, "the parents command")
        for lane in lanes_of_all:
            lane.share()
        loop.run_until(lambda: all(lane.ready for lane in lanes_of_all), 120.0, "the missions are loaded")
        for lane in lanes_of_all:
            lane.autopilot.take_off()
        loop.run_until(lambda: all(lane.flying for lane in lanes_of_all), 20.0, "the aircraft are on their missions")
        loop.run(_SETTLE_S)
        for lane in lanes_of_all:
            lane.shuttling = True
        yield from _watch(loop, fleets, plan, say)
    finally:
        for fleet in fleets:
            fleet.close()


def _watch(loop: Loop, fleets: list[_Fleet], plan: LanePlan, say: Callable[[str], None]) -> Iterator[Measurement]:
    began = time.monotonic()
    told_at = began
    while any(fleet.open for fleet in fleets):
        loop.run(0.5)
        now = time.monotonic()
        late = now - began > plan.limit_s
        for fleet in fleets:
            if fleet.open and (late or fleet.commits >= plan.transfers):
                for lane in fleet.lanes:
                    lane.check()
                given_up = sum(lane.shuttle.given_up for lane in fleet.lanes)
                fleet.close()
                yield from _measurements(fleet.condition, fleet.flown(), "in lanes", given_up, plan.transfers)
        if now - told_at > 15.0:
            told_at = now
            say("; ".join(f"{fleet.condition.name}: {fleet.commits}" for fleet in fleets))

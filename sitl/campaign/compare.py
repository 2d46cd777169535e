# SPDX-License-Identifier: GPL-3.0-or-later

"""Compares both ways to let time pass: are the outcomes the same, and how much faster is one?

Each seed is flown both ways, one after the other, so that other load of the machine affects both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from sitl.campaign.outcome import fly

__all__ = ["Comparison", "compare"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """The totals of a number of flights. `differ`: seeds whose outcomes are not the same."""

    flights: int
    hours: float
    events_cpu_s: float
    plain_cpu_s: float
    differ: tuple[int, ...]

    @property
    def words(self) -> str:
        """Both numbers for people, and what they come to."""
        events, plain = self.hours / self.events_cpu_s, self.hours / self.plain_cpu_s
        same = "the same outcomes" if not self.differ else f"NOT the same: {' '.join(map(str, self.differ))}"
        return (
            f"{self.flights} flights, {self.hours:.1f} hours: {events:.2f} flight hours a second of processor time, "
            f"{plain:.2f} with every step made, {events / plain:.1f} times; {same}"
        )


def compare(seeds: Iterable[int]) -> Iterator[Comparison]:
    """Fly them; tells after each what all so far came to."""
    flights, hours, events_s, plain_s = 0, 0.0, 0.0, 0.0
    differ: tuple[int, ...] = ()
    for seed in seeds:
        short, whole = fly(seed), fly(seed, plain=True)
        flights, hours = flights + 1, hours + short.aloft_s / 3600.0
        events_s, plain_s = events_s + short.cpu_s, plain_s + whole.cpu_s
        differ += () if short.same == whole.same else (seed,)
        yield Comparison(flights, hours, events_s, plain_s, differ)

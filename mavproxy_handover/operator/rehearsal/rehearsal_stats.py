# SPDX-License-Identifier: GPL-3.0-or-later

"""Counts of a rehearsal on the ground, for its report. Pure: times and places are arguments.

Of each link of a station, place by place: how much of it was lost, how long a round trip took, and how long nothing was
heard, with where that was. A place is the set of zones that held the aircraft. Of the handovers how long they took and
how far they were from where the check of the mission has them; further what was refused, and what would have been done.

Nothing in here grows without bound: what there is more of than `MOST` of a kind is counted, and no more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from statistics import median
from typing import Any, Final

__all__ = ["MOST", "Foreseen", "LinkSeen", "RehearsalStats"]

#: entries of a kind
MOST: Final = 100
#: round trips of a link in a place that the median is of; of more, the last ones
_ROUND_TRIPS: Final = 600

_Where = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Foreseen:
    """A handover that the check of the mission expects.

    It has the names of the stations, the place where it begins, the item flown to, and the time (s) that the flight
    leaves for it.
    """

    from_station: str
    to_station: str
    where: _Where
    item: int
    inside_s: float


@dataclass(frozen=True, slots=True)
class LinkSeen:
    """A link at one moment; None: not known. `silent_s`: since the station was heard by it."""

    station: str
    device: str
    silent_s: float | None
    loss: float | None
    round_trip_s: float | None


@dataclass(slots=True)
class _Stretch:
    """A link in a place."""

    seconds: float = 0.0
    loss: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # sum, count, most
    round_trips_s: list[float] = field(default_factory=list)
    round_trip_most_s: float = 0.0
    silent_s: float = 0.0
    silent_at: _Where | None = None
    unheard: bool = False

    def saw(self, link: LinkSeen, seconds: float, where: _Where | None) -> None:
        self.seconds += seconds
        if link.loss is not None:
            total, count, most = self.loss
            self.loss = [total + link.loss, count + 1, max(most, link.loss)]
        if link.round_trip_s is not None:
            self.round_trips_s = [*self.round_trips_s[1 - _ROUND_TRIPS :], link.round_trip_s]
            self.round_trip_most_s = max(self.round_trip_most_s, link.round_trip_s)
        if link.silent_s is None:
            self.unheard = True
        elif link.silent_s > self.silent_s:
            self.silent_s, self.silent_at = link.silent_s, where

    @property
    def loss_mean(self) -> float | None:
        total, count, _most = self.loss
        return total / count if count else None


@dataclass(slots=True)
class _Handover:
    """One that was made, or came to nothing. `foreseen`: as the check has it; `off_m`: how far from there."""

    from_station: str
    to_station: str
    at_s: float
    took_s: float
    why: str
    committed: bool
    place: str
    where: _Where | None
    foreseen: Foreseen | None = None
    off_m: float | None = None


class RehearsalStats:
    """Of one rehearsal. Times are monotonic seconds."""

    def __init__(self, begun_at: float, foreseen: Sequence[Foreseen], *, restarted: bool = False) -> None:
        """`foreseen`: what the check of the mission has; `restarted`: it had begun before, and that is not known."""
        self._begun_at = begun_at
        self._restarted = restarted
        self._foreseen = tuple(foreseen)
        #: how many of those have been made
        self._made = 0
        self._over: tuple[float, str] | None = None
        self._seen_at = begun_at
        self._stretches: dict[tuple[str, str, str], _Stretch] = {}
        self._handovers: list[_Handover] = []
        self._refused: Counter[tuple[str, str, str]] = Counter()
        self._would: list[tuple[float, str, str]] = []
        #: of what there was no room for
        self._left_out = 0
        self.place = ""
        self.where: _Where | None = None

    @property
    def over(self) -> bool:
        """Nothing more is seen."""
        return self._over is not None

    # ---- what is seen ---------------------------------------------------------------------------------------------

    def expects(self, foreseen: Sequence[Foreseen]) -> None:
        """Set the handovers that the check of the mission expects.

        After a restart they are known some time after the rehearsal began.
        """
        if not self._foreseen and not self._handovers:
            self._foreseen = tuple(foreseen)

    def saw(self, now: float, place: str, where: _Where | None, links: Sequence[LinkSeen]) -> None:
        """The links at this moment; to be called more than once a second."""
        seconds, self._seen_at = now - self._seen_at, now
        self.place, self.where = place, where
        for link in links:
            stretch = self._stretches.get((link.station, link.device, place))
            if stretch is None:
                if len(self._stretches) >= MOST:
                    self._left_out += 1
                    continue
                stretch = self._stretches[link.station, link.device, place] = _Stretch()
            stretch.saw(link, seconds, where)

    def handover(
        self, from_station: str, to_station: str, now: float, took_s: float, why: str, distance_m: Any = None
    ) -> None:
        """Authority has moved; `distance_m`: tells how far two places are apart (m)."""
        found = self._match_foreseen(from_station, to_station)
        off_m = None if found is None or self.where is None else distance_m(*self.where, *found.where)
        self._note(from_station, to_station, now, took_s, why, True, found, off_m)

    def aborted(self, from_station: str, to_station: str, now: float, took_s: float, why: str) -> None:
        """A transfer was aborted."""
        self._note(from_station, to_station, now, took_s, why, False, None, None)

    def _match_foreseen(self, from_station: str, to_station: str) -> Foreseen | None:
        """The next one on the route, if it is that; one that was left out before it is never made."""
        for number in range(self._made, len(self._foreseen)):
            found = self._foreseen[number]
            if (found.from_station, found.to_station) == (from_station, to_station):
                self._made = number + 1
                return found
        return None

    def _note(
        self,
        from_station: str,
        to_station: str,
        now: float,
        took_s: float,
        why: str,
        committed: bool,
        found: Foreseen | None,
        off_m: float | None,
    ) -> None:
        if len(self._handovers) >= MOST:
            self._left_out += 1
            return
        at_s = now - self._begun_at
        self._handovers.append(
            _Handover(from_station, to_station, at_s, took_s, why, committed, self.place, self.where, found, off_m)
        )

    def refused(self, station: str, what: str, why: str) -> None:
        """Something of a station was refused."""
        key = station, what, why
        if key in self._refused or len(self._refused) < MOST:
            self._refused[key] += 1
        else:
            self._left_out += 1

    def would(self, now: float, text: str) -> None:
        """Count a decision that would have been carried out in flight."""
        if len(self._would) < MOST:
            self._would.append((now - self._begun_at, self.place, text))
        else:
            self._left_out += 1

    def end(self, now: float, why: str) -> None:
        """The rehearsal is over."""
        self._over = now, why

    # ---- the report ----------------------------------------------------------------------------------------------

    def lines(self, now: float) -> tuple[str, ...]:
        """The report for people, each line short enough for HANDOVER_REHEARSAL."""
        ended_at, why = self._over or (now, "under way")
        made = [each for each in self._handovers if each.committed]
        as_foreseen = sum(each.foreseen is not None for each in made)
        since = ", seen since a restart" if self._restarted else ""
        lines = [
            f"rehearsal {why}, {ended_at - self._begun_at:.0f} s{since}",
            f"handovers {len(made)}, {as_foreseen} of {len(self._foreseen)} that the check has",
            *(f"  {_words(number, each)}" for number, each in enumerate(self._handovers, 1)),
            *(
                f"  not made: {each.from_station} -> {each.to_station}, way to item {each.item}"
                for each in self._missed()
            ),
            *self._links(),
            *(f"refused {count} x {what} of {station}: {why}" for (station, what, why), count in self._refused.items()),
            *(f"{at_s:.0f} s, {place}: {text}" for at_s, place, text in self._would),
        ]
        if not self._would:
            lines.append("nothing would have been commanded")
        if self._left_out:
            lines.append(f"{self._left_out} more entries left out")
        return tuple(lines)

    def entry(self, now: float) -> dict[str, Any]:
        """The same as values, for the journal."""
        ended_at, why = self._over or (now, "under way")
        return {
            "over": self.over,
            "why": why,
            "seconds": round(ended_at - self._begun_at, 1),
            "restarted": self._restarted,
            "foreseen": len(self._foreseen),
            "handovers": [_values(each) for each in self._handovers],
            "missed": [[each.from_station, each.to_station, each.item] for each in self._missed()],
            "links": [
                {"station": station, "device": device, "place": place, **_measured(seen)}
                for (station, device, place), seen in self._by_link()
            ],
            "refused": [[*key, count] for key, count in self._refused.items()],
            "would": [[round(at_s, 1), place, text] for at_s, place, text in self._would],
            "left_out": self._left_out,
        }

    def _links(self) -> list[str]:
        """A line for each link, and one for each place below it."""
        lines: list[str] = []
        before: tuple[str, str] | None = None
        for (station, device, place), seen in self._by_link():
            if before != (station, device):
                lines.append(f"link {station} {device}")
            before = station, device
            lines.append(f"  {_stretch(place, seen)}")
        return lines

    def _missed(self) -> Sequence[Foreseen]:
        """Those of the check that have not been made."""
        made = [each.foreseen for each in self._handovers if each.foreseen is not None]
        return [each for each in self._foreseen if not any(each is other for other in made)]

    def _by_link(self) -> list[tuple[tuple[str, str, str], _Stretch]]:
        return sorted(self._stretches.items())


def _words(number: int, made: _Handover) -> str:
    pair = f"{number}: {made.from_station} -> {made.to_station} at {made.at_s:.0f} s"
    if not made.committed:
        return f"{pair}: came to nothing ({made.why}), {made.took_s:.1f} s"
    if made.foreseen is None:
        return f"{pair}, took {made.took_s:.2f} s ({made.why}); the check has none here"
    off = "" if made.off_m is None else f", {made.off_m:.0f} m off the check's place"
    return (
        f"{pair}, took {made.took_s:.2f} s of {made.foreseen.inside_s:.1f} s in flight{off}, item {made.foreseen.item}"
    )


def _stretch(place: str, seen: _Stretch) -> str:
    words = [f"{place} {seen.seconds:.0f} s"]
    if seen.loss_mean is not None:
        words.append(f"lost {seen.loss_mean:.0%} (most {seen.loss[2]:.0%})")
    if seen.round_trips_s:
        words.append(f"trip {median(seen.round_trips_s) * 1000:.0f} ms (most {seen.round_trip_most_s * 1000:.0f})")
    where = "" if seen.silent_at is None else f" at {seen.silent_at[0]:.5f} {seen.silent_at[1]:.5f}"
    words.append("never heard" if seen.unheard and not seen.silent_s else f"silent {seen.silent_s:.1f} s{where}")
    return ", ".join(words)


def _values(made: _Handover) -> Mapping[str, Any]:
    found = made.foreseen
    return {
        "from": made.from_station,
        "to": made.to_station,
        "at_s": round(made.at_s, 1),
        "took_s": round(made.took_s, 4),
        "why": made.why,
        "committed": made.committed,
        "place": made.place,
        "where": made.where,
        "item": None if found is None else found.item,
        "inside_s": None if found is None or found.inside_s == inf else round(found.inside_s, 1),
        "off_m": None if made.off_m is None else round(made.off_m, 1),
    }


def _measured(seen: _Stretch) -> Mapping[str, Any]:
    return {
        "seconds": round(seen.seconds, 1),
        "loss": None if seen.loss_mean is None else round(seen.loss_mean, 4),
        "loss_most": None if seen.loss_mean is None else round(seen.loss[2], 4),
        "round_trip_s": round(median(seen.round_trips_s), 5) if seen.round_trips_s else None,
        "round_trip_most_s": round(seen.round_trip_most_s, 5) if seen.round_trips_s else None,
        "silent_s": round(seen.silent_s, 2),
        "silent_at": seen.silent_at,
        "unheard": seen.unheard,
    }

# SPDX-License-Identifier: GPL-3.0-or-later

"""Gaps in coverage on the way of a flight, and those of them that its mission declares.

Every waypoint lies inside a zone here, so a gap is a part of one leg. What the real edge makes of a declared gap
(`monitors/gaps.py`) is `GapPlan.fact`; where the guard allows less than the longest limit, START is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

from mavproxy_handover.core.common.model import GapFact
from mavproxy_handover.core.safety.energy import EnergyModel
from sitl.campaign.plane import Circle, Spot, bare_spans, bearing_deg

__all__ = ["GapPlan", "find_gaps", "gap_at", "lacking"]

#: an aircraft farther beside the route is not on it (m)
_CORRIDOR_M: Final = 50.0
#: for the rules a gap begins this time (s) before its border, and after its far border this time (s) is allowed for
#: contact: hold_lead_s and 3 s, as in `monitors/gaps.py`
LEAD_S, CONTACT_S = 8.0, 5.0


@dataclass(frozen=True, slots=True)
class GapPlan:
    """A declared gap: on the leg to this waypoint, from one length of it to another (m).

    `limit_s`: the time that it may take (s).
    """

    waypoint: int
    start: Spot
    end: Spot
    begins_m: float
    ends_m: float
    limit_s: float
    words: str

    def along_m(self, x_m: float, y_m: float) -> float | None:
        """How far into the gap, below 0 before it; None: not on this leg."""
        east, north = self.end.x_m - self.start.x_m, self.end.y_m - self.start.y_m
        length = self.start.away_m(self.end.x_m, self.end.y_m)
        dx, dy = x_m - self.start.x_m, y_m - self.start.y_m
        if abs(dx * north - dy * east) / length > _CORRIDOR_M:
            return None
        return (dx * east + dy * north) / length - self.begins_m

    def place(self, along_m: float) -> tuple[float, float]:
        """East and north of a place on the leg, so far from its beginning."""
        part = along_m / self.start.away_m(self.end.x_m, self.end.y_m)
        east, north = self.end.x_m - self.start.x_m, self.end.y_m - self.start.y_m
        return self.start.x_m + part * east, self.start.y_m + part * north

    @property
    def length_m(self) -> float:
        """From border to border."""
        return self.ends_m - self.begins_m

    def changes_s(self, x_m: float, y_m: float, vx: float, vy: float, speed_mps: float) -> tuple[float, ...]:
        """When (s) the rules' facts about the gap change for an aircraft that flies straight on.

        The gap begins to matter, begins, and is over; none if it never matters.
        """
        length = self.start.away_m(self.end.x_m, self.end.y_m)
        east, north = (self.end.x_m - self.start.x_m) / length, (self.end.y_m - self.start.y_m) / length
        dx, dy = x_m - self.start.x_m, y_m - self.start.y_m
        along, rate = dx * east + dy * north - self.begins_m, vx * east + vy * north
        spans = (
            _between(along, rate, -LEAD_S * speed_mps, self.length_m + CONTACT_S * speed_mps),
            _between(dx * north - dy * east, vx * north - vy * east, -_CORRIDOR_M, _CORRIDOR_M),
        )
        begins, ends = max(begins for begins, _ends in spans), min(ends for _begins, ends in spans)
        if begins >= ends:
            return ()
        return tuple(at for at in (begins, ends, *_between(along, rate, 0.0, self.length_m)) if begins <= at <= ends)

    def fact(self, x_m: float, y_m: float, speed_mps: float) -> GapFact | None:
        """The facts for the rules at this place."""
        along = self.along_m(x_m, y_m)
        if along is None or not -LEAD_S * speed_mps <= along <= self.length_m + CONTACT_S * speed_mps:
            return None
        return GapFact(self.limit_s, self.words, ahead=along < 0.0)


def _between(value: float, rate: float, low: float, high: float) -> tuple[float, float]:
    """From when to when (s) a value that changes at that rate is between the two."""
    if abs(rate) < 1e-9:
        return (-inf, inf) if low <= value <= high else (inf, -inf)
    times = (low - value) / rate, (high - value) / rate
    return min(times), max(times)


def find_gaps(
    way: Sequence[Spot], zones: Iterable[Circle], model: EnergyModel, speed_mps: float, spare: float
) -> Iterator[GapPlan]:
    """Every gap on the way, with `spare` times as much time as it takes against the wind."""
    circles = tuple(zones)
    for waypoint, (start, end) in enumerate(pairwise(way), 1):
        bearing = bearing_deg(end.x_m - start.x_m, end.y_m - start.y_m)
        made = model.made_good(bearing, speed_mps).speed_mps
        for begins, ends in bare_spans(start, end, circles):
            if ends - begins > 1.0:
                limit_s = float(round(spare * (ends - begins) / made + 5.0))
                yield GapPlan(waypoint, start, end, begins, ends, limit_s, f"leg {waypoint}")


def gap_at(gaps: Iterable[GapPlan], waypoint: int, x_m: float, y_m: float, speed_mps: float) -> GapFact | None:
    """The gap that an aircraft there is in, which flies to this waypoint."""
    found = (gap.fact(x_m, y_m, speed_mps) for gap in gaps if gap.waypoint == waypoint)
    return next((fact for fact in found if fact is not None), None)


def lacking(gaps: Sequence[GapPlan], alone_max_s: float) -> str:
    """The energy that is missing to cross them, in words; "" if none."""
    longest_s = max((gap.limit_s for gap in gaps), default=0.0)
    return "" if alone_max_s >= longest_s else f"HNDO_ALONE_MAX is {alone_max_s:g} s, a gap may take {longest_s:g} s"

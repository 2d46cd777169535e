# SPDX-License-Identifier: GPL-3.0-or-later

"""The truth of each second of a flight, for the judge.

Where the aircraft was, what worked, and for how long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from sitl.campaign.aircraft import Mode
from sitl.campaign.gaps import CONTACT_S
from sitl.campaign.log import FlightLog
from sitl.campaign.plan import FlightPlan
from sitl.campaign.times import SECOND

__all__ = [
    "BORDER_M",
    "LEFT_M",
    "ON_ITS_WAY",
    "REACTS_S",
    "SETTLED_S",
    "Found",
    "Moment",
    "gap_allowed_s",
    "has_left",
    "is_behind_gap",
    "longest",
    "moments_of",
    "parts_whole_s",
    "unnoticed",
    "whole_s",
]

#: so far outside a zone still counts as its border (m)
BORDER_M: Final = 20.0
#: modes in which the aircraft is not on its way down or home, and no pilot flies it
ON_ITS_WAY: Final = (Mode.AUTO.name, Mode.PAUSE.name)
#: companion, cable, position and obedience whole, and no pilot flies: this time (s) before it counts; 2.5 s until a
#: restarted companion waits no longer for its commander, 6 s until what was not obeyed is ordered again
SETTLED_S: Final = 10
#: then this time (s) without a commander, outside every zone, or with no place in reach: 2 s for a forced transfer, or
#: a hold-off of 1 or 2 s; 1 s until it is checked, 1 s in doubt about the source of the mode, 1 s for rounding
REACTS_S: Final = 5
#: what is farther outside than that is outside for the rules (m)
LEFT_M: Final = 6.0


@dataclass(frozen=True, slots=True)
class Found:
    """Something unsafe: which row of the table, when (tick), and what happened, for people."""

    row: str
    at: int
    text: str


@dataclass(frozen=True, slots=True)
class Moment:
    """The truth of one second."""

    at: int
    place: tuple[float, float, float]
    mode: str
    commander: int | None
    companion: bool
    #: the autopilot does what it is ordered
    obeys: bool
    #: limit (s) of the declared gap that it flies through, or has just flown through; 0: in none
    gap_s: float
    #: directly after a gap, where the rules give the far station time to make contact
    behind_gap: bool
    #: stations that work, and whose zones hold the aircraft
    usable: frozenset[int]
    #: stations that work, and whose links hold the aircraft
    heard: frozenset[int]
    #: companion and autopilot hear each other: the rally list is kept
    writes: bool
    #: how far the aircraft is inside the commander's zone, and inside any, of stations that work or not
    margin_m: float
    inside_m: float
    #: what is really left (Wh), and when the piece ends that is flown
    left_wh: float
    piece_ends: int


def moments_of(plan: FlightPlan, log: FlightLog) -> Iterator[Moment]:
    """Every second in the air."""
    zones = plan.zones
    for piece in log.flown:
        if piece.mode == Mode.GROUND.name:
            continue
        first = -(-piece.begun // SECOND) * SECOND
        for at in range(first, piece.ended, SECOND):
            x, y, z = piece.at(at)
            commander, companion = log.commander.at(at), log.companion.at(at)
            margins = {sysid: zone.margin_m(x, y) for sysid, zone in zones.items() if log.working[sysid].at(at)}
            usable = frozenset(sysid for sysid, margin in margins.items() if margin > -BORDER_M)
            heard = frozenset(sysid for sysid, margin in margins.items() if margin > 0.0)
            inside = max(zone.margin_m(x, y) for zone in zones.values())
            writes = companion and log.cable.at(at)
            margin = 0.0 if commander is None else zones[commander].margin_m(x, y)
            yield Moment(
                at,
                (x, y, z),
                piece.mode,
                commander if companion else None,
                companion,
                log.obeys.at(at),
                gap_allowed_s(plan, piece.mode, x, y),
                is_behind_gap(plan, x, y),
                usable,
                heard,
                writes,
                margin,
                inside,
                piece.left_at(at),
                piece.ended,
            )


def whole_s(log: FlightLog, at: int) -> float:
    """How long (s) companion, cable, position and obedience had been whole then.

    Only in a flight that neither a pilot nor an operator has changed of late; 0: something is not whole.
    """
    begun, _mode, by = log.mode_at(at)
    if by == "commander":  # the order stands until something new is wrong
        return 0.0
    return min(parts_whole_s(log, at), (at - begun) / SECOND)


def parts_whole_s(log: FlightLog, at: int) -> float:
    """How long (s) companion, cable, position and obedience had been whole then, with any pilot."""
    needed = (log.companion, log.cable, log.fix, log.obeys)
    if not all(series.at(at) for series in needed):
        return 0.0
    return (at - max(series.since(at) for series in needed)) / SECOND


def gap_allowed_s(plan: FlightPlan, mode: str, x: float, y: float) -> float:
    """Limit (s) of the declared gap that is flown through there.

    It also counts where contact is made after the gap; 0: there is none.
    """
    if mode not in ON_ITS_WAY:
        return 0.0
    for gap in plan.gaps:
        along = gap.along_m(x, y)
        if along is not None and -BORDER_M <= along <= gap.length_m + _contact_m(plan):
            return gap.limit_s
    return 0.0


def _contact_m(plan: FlightPlan) -> float:
    """The distance after a gap in which the far station may make contact, within the gap's limit."""
    return CONTACT_S * plan.speed_mps + BORDER_M


def is_behind_gap(plan: FlightPlan, x: float, y: float) -> bool:
    """Whether that is directly after a gap, where the far station is given time to make contact."""
    alongs = [(gap.length_m, gap.along_m(x, y)) for gap in plan.gaps]
    return any(along is not None and 0.0 <= along - length_m <= _contact_m(plan) for length_m, along in alongs)


def longest(moments: tuple[Moment, ...], limit_s: int, wrong: Callable[[Moment], bool]) -> Moment | None:
    """The moment when something has gone on for longer than the limit, what a declared gap allows left out.

    That is the gap's own limit, and no second more: after it everything counts, the gap or not.
    """
    run = alone = 0
    for before, moment in pairwise((None, *moments)):
        assert moment is not None
        follows = before is None or moment.at - before.at <= SECOND
        alone = alone + 1 if moment.gap_s and wrong(moment) and follows else 0
        if 0 < alone <= moment.gap_s:
            run = 0
            continue
        run = run + 1 if wrong(moment) and follows else int(wrong(moment))
        if not moment.obeys:  # no order can send it home; counting starts again after that
            run = 0
        if run > limit_s:
            return moment
    return None


def unnoticed(log: FlightLog, moments: tuple[Moment, ...], wrong: Callable[[Moment], bool]) -> Moment | None:
    """The moment when that has gone on for longer than the rules need.

    On the way and with all whole that they need.
    """

    def counts(moment: Moment) -> bool:
        return moment.mode in ON_ITS_WAY and wrong(moment) and whole_s(log, moment.at) >= SETTLED_S

    return longest(moments, REACTS_S, counts)


def has_left(moment: Moment) -> bool:
    """Whether its commander's zone does not hold the aircraft any more."""
    return moment.commander is not None and moment.margin_m < -LEFT_M

# SPDX-License-Identifier: GPL-3.0-or-later

"""The figures of `fleet.py`: missed handovers, and the growth of the cost with the number of vehicles.

A handover is missed if a region was entered and authority did not move, or if it was aborted. It is also missed if it
took longer than a bad link may make it, or if the station itself has not noticed it. If the machine was busier than
`BUSY_LIMIT`, the numbers are shown as void.

Growth is judged from two vehicles on: distinguishing vehicles at all costs a station something once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from statistics import linear_regression
from typing import Final

from sitl.bench.durations import Entry, transfers
from sitl.bench.results import Measurement

__all__ = [
    "BUSY_LIMIT",
    "LATE_S",
    "Crossing",
    "Growth",
    "Handovers",
    "Load",
    "growth",
    "growth_of",
    "handovers_of",
    "results",
]

#: part of all processors' time; above it the station was not measured but the machine
BUSY_LIMIT: Final = 0.8
#: what 99 of 100 handovers take at the worst that links may be
LATE_S: Final = 3.0
#: a vehicle more costs so much more among many than among few
GROWTH_LIMIT: Final = 1.3
MEMORY_LIMIT: Final = 1.05
_VOID: Final = f"VOID: the machine was busier than {BUSY_LIMIT:.0%}"

#: a region that was entered: from whom, to whom
Crossing = tuple[int | None, int | None]


@dataclass(frozen=True, slots=True)
class Handovers:
    """The results of handovers. `asked`: regions that were entered; `made`: commits in the vehicles' journals."""

    asked: int
    made: int
    #: those of the real station, and those that it has told of itself
    own: int
    seen: int
    #: asked for and not made, or made and not asked for, of each vehicle
    amiss: int
    aborted: int
    late: int
    slowest_s: float
    #: messages of transfers that the real station got over the ground link, and that it sent
    by_ground: tuple[int, int]

    @property
    def missed(self) -> int:
        """How many were not as they should be."""
        return max(self.amiss, abs(self.own - self.seen)) + self.aborted + self.late


def handovers_of(
    station: int, own: Sequence[Entry], flown: Sequence[tuple[Sequence[Crossing], Sequence[Entry]]]
) -> Handovers:
    """From the station's own journal; and of each vehicle the regions that it has entered, and its journal."""
    asked = [crossing for crossings, _journal in flown for crossing in crossings]
    committed = [transfers(journal, ()) for _crossings, journal in flown]
    made = [one for each in committed for one in each]
    ground = [entry["direction"] for entry in own if entry["event"] == "message" and entry.get("via") == "ground"]
    return Handovers(
        asked=len(asked),
        made=len(made),
        own=sum(station in crossing for crossing in asked),
        seen=sum(entry["event"] in ("control_gained", "control_lost") for entry in own),
        amiss=sum(abs(len(crossings) - len(each)) for (crossings, _), each in zip(flown, committed, strict=True)),
        aborted=sum(entry["event"] == "transfer_aborted" for _, journal in flown for entry in journal),
        late=sum(each.since_entry_s > LATE_S for each in made),
        slowest_s=max((each.since_entry_s for each in made), default=0.0),
        by_ground=(ground.count("in"), ground.count("out")),
    )


@dataclass(frozen=True, slots=True)
class Load:
    """One number of vehicles, measured. Memory in MiB; `busy`: part of the machine's time."""

    vehicles: int
    seconds: float
    cpu_ms_per_s: float
    memory: tuple[float, float]
    busy: float
    handovers: Handovers


@dataclass(frozen=True, slots=True)
class Growth:
    """The cost of one more vehicle, step by step.

    `many_by_few`: of the last step by those before it (1.0 is a straight line); `most_by_least`: of the dearest by the
    cheapest. The straight line that fits best: `base` + vehicles * `each`, `off` at most by that part of a cost.
    """

    steps: tuple[float, ...]
    many_by_few: float
    most_by_least: float
    base: float
    each: float
    off: float


def growth(costs: dict[int, float]) -> Growth:
    """How cost grows with the number of vehicles, from two on.

    `costs`: number of vehicles -> cost. ValueError with less than three such numbers, or where more cost nothing more.
    """
    numbers = sorted(number for number in costs if number > 1)
    if len(numbers) < 3:
        raise ValueError("growth: at least three numbers of several vehicles")
    steps = tuple((costs[b] - costs[a]) / (b - a) for a, b in pairwise(numbers))
    if min(steps) <= 0.0:
        raise ValueError("growth: more vehicles cost nothing more")
    few = (costs[numbers[-2]] - costs[numbers[0]]) / (numbers[-2] - numbers[0])
    line = linear_regression(numbers, [costs[number] for number in numbers])
    off = max(abs(line.intercept + line.slope * number - costs[number]) / costs[number] for number in numbers)
    return Growth(steps, steps[-1] / few, max(steps) / min(steps), line.intercept, line.slope, off)


def growth_of(loads: Sequence[Load]) -> Iterator[Measurement]:
    """How the station's processor time has grown; nothing where that was not measured for enough numbers."""
    costs = {load.vehicles: load.cpu_ms_per_s for load in loads}
    if sum(vehicles > 1 for vehicles in costs) < 3:
        return
    found = growth(costs)
    void = any(load.busy > BUSY_LIMIT for load in loads)
    steps = " ".join(f"{step:.1f}" for step in found.steps)
    line = f"{found.base:.0f} + {found.each:.1f} ms/s for each, {found.off:.0%} off at most"
    more = f"one more costs {steps} ms/s, the dearest {found.most_by_least:.2f} of the cheapest"
    yield Measurement(
        "fleet",
        "CPU of one vehicle more: among many by among few",
        "",
        {"vehicles": " ".join(map(str, costs))},
        ours=found.many_by_few,
        limit=None if void else GROWTH_LIMIT,
        judged="ours",
        details=asdict(found),
        note=f"{line}; {more}{f'; {_VOID}' if void else ''}",
    )


def results(load: Load) -> Iterator[Measurement]:
    """Its numbers; without targets where the machine was too busy."""
    case = {"vehicles": load.vehicles, "stations": 4}
    void = load.busy > BUSY_LIMIT
    note = _VOID if void else ""
    each = load.cpu_ms_per_s / load.vehicles
    words = f"{each:.1f} ms/s for each vehicle; {load.busy:.0%} of the machine's time was used"
    yield Measurement(
        "fleet",
        "station: CPU per second",
        "ms/s",
        case,
        ours=load.cpu_ms_per_s,
        details={"seconds": load.seconds, "machine_busy": load.busy, "each_ms_per_s": each},
        note=f"{words}{f'; {_VOID}' if void else ''}",
    )
    begun, ended = load.memory
    yield Measurement(
        "fleet",
        "station: memory, at the end by the beginning",
        "MiB",
        case,
        ours=ended,
        baseline=begun,
        ratio=ended / begun,
        limit=None if void else MEMORY_LIMIT,
        note=note,
    )
    handovers = load.handovers
    yield Measurement(
        "fleet",
        f"handovers missed, of {handovers.asked}, {handovers.own} of the station",
        "",
        case,
        ours=float(handovers.missed),
        limit=None if void else 0.0,
        judged="ours",
        details=asdict(handovers),
        note=note,
    )

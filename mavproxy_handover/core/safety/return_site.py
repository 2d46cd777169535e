# SPDX-License-Identifier: GPL-3.0-or-later

"""Where a return goes: home, a rally point, or the place where the mission lands; chosen before it is needed.

Theory of operation
-------------------
The facts of a place (`PlaceFact`) are made elsewhere: the charge that is left there, whether way and place are inside
the fence, which zones hold them, how long the way takes. `Standing` puts them in the order in which they
count, and `best` is the place that stands highest, the soonest of those that stand alike:

1. The place itself is inside the fence: ArduCopter passes over any other in silence, and goes home.
2. It is reached with the reserve left; or else with what the reserve is there for.
3. Climb, way and descent are inside the fence, and above the ground as far as its heights are known.
4. Coverage: a station that could take the aircraft covers the place, and one or another of them all the way to it; or
   the place at least, for who is out of coverage already has a part of every way that is not covered.

So what is reachable, inside the fence and covered is never passed over for what is not. What is not known of energy
counts as reachable: all places are alike in that, and to land where it is is no better.

`ReturnSiteChooser` keeps the choice, and changes it when a fact changes, not at each change of a measured number. A
fact that rests on measured numbers counts as false after it was false for a while. It counts as true again after it was
true for longer. A fact that changes to and fro stays as it was, or counts as false. A place of equal rank replaces the
choice only if it is reached clearly sooner. A station that is lost counts as lost at once, because it was silent for
seconds already. After it is heard again it counts after a while. The choice moves to another place only if that place
is also better by the facts of this moment.

During a return a place that is only reached sooner does not replace the choice; a place of higher rank does. Near the
end of the return nothing replaces it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite
from typing import Final, NamedTuple

__all__ = ["Choice", "Coverage", "ReturnSiteChooser", "PlaceFact", "Reach", "Standing", "best", "standing"]

#: time after which a yes that turned into a no counts as a no (s), and the other way round
WORSE_S: Final = 2.5
BETTER_S: Final = 20.0
#: a longer pause between two looks counts for no more than this
_MOST_S: Final = 2.0
#: what is as good has to be there in this part of the time, less so many seconds
SOONER_PART, SOONER_S = 0.8, 5.0
#: a return that is as near as this to its end (m) ends there
NEAR_M: Final = 100.0


class Reach(IntEnum):
    """How far the energy goes."""

    NO = 0  #: it does not
    RESERVE = 1  #: with a part of the reserve
    YES = 2  #: and the reserve is left; or nothing is known of it


class Coverage(IntEnum):
    """Where stations that could take the aircraft cover it."""

    NO = 0  #: not at the place
    THERE = 1  #: at the place, and not all the way
    ALL = 2  #: and all the way


@dataclass(frozen=True, slots=True)
class PlaceFact:
    """Facts of one place, from the position of the aircraft.

    `time_s` until it is on the ground there, infinite where the wind does not let it be flown. `margin_wh`: what is
    left beyond need and reserve, `spare_wh`: beyond the need alone; both None where that is not known. `needs` and
    `left` are parts of the battery, for people. `inside`: the place is inside the fence; `way_inside`: so are climb,
    way and descent; `way_clear`: the ground is well below the way, or its height is not known. `there`: system ids of
    the stations whose zones hold the place; `way`: the different sets of them that the way to it goes through.
    """

    name: str
    distance_m: float
    time_s: float
    margin_wh: float | None = None
    spare_wh: float | None = None
    needs: float | None = None
    left: float | None = None
    inside: bool = True
    way_inside: bool = True
    there: frozenset[int] = frozenset()
    way: frozenset[frozenset[int]] = frozenset()
    way_clear: bool = True

    @property
    def reach(self) -> Reach:
        """Whether the energy that is left takes it there."""
        if not isfinite(self.time_s):
            return Reach.NO
        if self.margin_wh is None or self.margin_wh > 0.0:
            return Reach.YES
        return Reach.RESERVE if self.spare_wh is not None and self.spare_wh >= 0.0 else Reach.NO

    def coverage(self, usable: Set[int]) -> Coverage:
        """Where stations that could take the aircraft, `usable`, cover it."""
        if self.there.isdisjoint(usable):
            return Coverage.NO
        return Coverage.THERE if any(part.isdisjoint(usable) for part in self.way) else Coverage.ALL


class Standing(NamedTuple):
    """How good a place is, the heaviest first: of two standings the greater one is the better place."""

    inside: bool
    reach: Reach
    way_free: bool
    coverage: Coverage

    @property
    def reachable(self) -> bool:
        """A return that begins now gets there: it would be flown to, and the energy lasts."""
        return self.inside and self.reach is not Reach.NO


def standing(place: PlaceFact, usable: Set[int]) -> Standing:
    """How good a place is by the facts of this moment."""
    return Standing(place.inside, place.reach, place.way_inside and place.way_clear, place.coverage(usable))


def best(places: Iterable[PlaceFact], usable: Set[int]) -> PlaceFact | None:
    """The place that stands highest by the facts of this moment; the first of equal ones, None without a place."""
    return max(places, key=lambda place: (standing(place, usable), -place.time_s), default=None)


@dataclass(frozen=True, slots=True)
class Choice:
    """The return site of now, its standing, and the stations that cover it and could take the aircraft."""

    place: PlaceFact
    standing: Standing
    covered_by: tuple[int, ...]

    @property
    def reachable(self) -> bool:
        """The energy lasts for it, and the autopilot would fly there."""
        return self.standing.reachable

    def words(self, name: Callable[[int], str]) -> str:
        """Place and figures for people: "rally 2: 1.9 km away, covered by GCSA all the way". `name` of a station."""
        return f"{self.place.name}: {self.figures(name)}"

    def figures(self, name: Callable[[int], str], *, brief: bool = False) -> str:
        """The same without the name of the place. `brief`: without what is left in the battery."""
        place, far = self.place, self.place.distance_m
        parts = [f"{far / 1000.0:.1f} km away" if far >= 1000.0 else f"{far:.0f} m away"]
        if not isfinite(place.time_s):
            parts.append("the wind does not let it be flown")
        elif place.needs is not None and place.left is not None:
            left = "" if brief else f" of the battery ({place.left:.0%} left)"
            parts.append(f"needs {place.needs:.0%}{left}".replace("%", " %"))
        if self.standing.reach is Reach.NO:
            parts.append("OUT OF REACH")
        if not self.standing.inside:
            parts.append("outside the fence")
        elif not self.standing.way_free:
            parts.append("the way leaves the fence" if not place.way_inside else "the way is too near to the ground")
        stations = ", ".join(map(name, self.covered_by))
        if self.standing.coverage is Coverage.NO or not stations:
            parts.append("covered by no station")
        else:
            how = "all the way" if self.standing.coverage is Coverage.ALL else "at its end only"
            parts.append(f"covered by {stations} {how}")
        return ", ".join(parts)


class _Steady:
    """A yes or no that does not flicker."""

    __slots__ = ("_level_s", "value")

    def __init__(self, value: bool) -> None:
        self.value = value
        self._level_s = BETTER_S if value else 0.0

    @property
    def settled(self) -> bool:
        """Whether it counts as it was at every recent look."""
        return self._level_s in (0.0, BETTER_S)

    def update(self, value: bool, passed_s: float) -> bool:
        """Take the value of now, `passed_s` after the last look; returns the value that counts."""
        change_s = passed_s if value else -passed_s * BETTER_S / WORSE_S
        self._level_s = min(BETTER_S, max(0.0, self._level_s + change_s))
        if self._level_s in (0.0, BETTER_S):
            self.value = self._level_s > 0.0
        return self.value


class _Record:
    """Steady values of one place."""

    __slots__ = ("_all", "_full", "_inside", "_some", "_there", "_way")

    def __init__(self, now: Standing) -> None:
        self._inside, self._way = _Steady(now.inside), _Steady(now.way_free)
        self._full, self._some = _Steady(now.reach is Reach.YES), _Steady(now.reach is not Reach.NO)
        self._cover(now)

    def _cover(self, now: Standing) -> None:
        self._all, self._there = _Steady(now.coverage is Coverage.ALL), _Steady(now.coverage is not Coverage.NO)

    @property
    def settled(self) -> bool:
        """Whether every value counts as the facts say."""
        parts = (self._inside, self._way, self._full, self._some, self._all, self._there)
        return all(part.settled for part in parts)

    def update(self, now: Standing, passed_s: float, *, others: bool) -> Standing:
        """Take the standing by the facts; returns the one that counts. `others`: other stations could take the
        aircraft."""
        if others:
            self._cover(now)
        full = self._full.update(now.reach is Reach.YES, passed_s)
        some = self._some.update(now.reach is not Reach.NO, passed_s)
        all_the_way = self._all.update(now.coverage is Coverage.ALL, passed_s)
        there = self._there.update(now.coverage is not Coverage.NO, passed_s)
        return Standing(
            self._inside.update(now.inside, passed_s),
            Reach.YES if full and some else Reach.RESERVE if some else Reach.NO,
            self._way.update(now.way_free, passed_s),
            Coverage.ALL if all_the_way and there else Coverage.THERE if there else Coverage.NO,
        )


class ReturnSiteChooser:
    """The choice in force. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_looked_at", "_name", "_records", "_since", "_usable")

    def __init__(self) -> None:
        self._name: str | None = None
        self._records: dict[str, _Record] = {}
        self._looked_at = -inf
        #: stations that could take the aircraft, as they count
        self._usable: frozenset[int] = frozenset()
        #: since when each one could: from the beginning (-inf), since it came back, or not now (inf)
        self._since: dict[int, float] = {}

    def restore(self, name: str) -> None:
        """Keep this return site, which was chosen already."""
        self._name = name

    def choose(
        self,
        places: Sequence[PlaceFact],
        usable: Set[int],
        now: float,
        *,
        returning: bool = False,
        fixed: bool = False,
        ends: bool = False,
    ) -> Choice | None:
        """The choice by the facts of this moment; None without a place.

        `usable`: stations that could take the aircraft. `returning`: it is on its way to the place chosen already.
        `fixed`: nothing may change. `ends`: the mission is about to end with a return; of places that are as good it
        goes to the soonest, as was reckoned before the flight (`mission/returns.py`), whichever was chosen before.
        """
        others = self._count(usable, now)
        passed_s = min(_MOST_S, max(0.0, now - self._looked_at))
        self._looked_at = now
        found: dict[str, tuple[PlaceFact, Standing]] = {}
        certain: dict[str, tuple[PlaceFact, Standing]] = {}
        for place in places:
            raw = standing(place, self._usable)
            record = self._records.get(place.name)
            if record is None:
                record = self._records[place.name] = _Record(raw)
            counts = record.update(raw, passed_s, others=others)
            found[place.name] = place, counts
            certain[place.name] = place, _worse(counts, raw)
        self._records = {name: record for name, record in self._records.items() if name in found}
        if not found:
            self._name = None
            return None
        top = max(certain.values(), key=lambda entry: (entry[1], -entry[0].time_s))
        held = None if self._name is None else found.get(self._name)
        if held is None or (not fixed and _goes_over(held, top, returning=returning, ends=ends)):
            held = found[top[0].name]
        place, counts = held
        self._name = place.name
        return Choice(place, counts, tuple(sorted(place.there & self._usable)))

    @property
    def usable(self) -> frozenset[int]:
        """Stations that could take the aircraft, as they count."""
        return self._usable

    def stays_until(self, now: float) -> float:
        """Time until which the choice stays if the facts do; inf: for ever.

        It is `now` while a fact does not count yet, then the moment at which the next station counts again.
        """
        if not all(record.settled for record in self._records.values()):
            return now
        return min((since + BETTER_S for since in self._since.values() if now < since + BETTER_S < inf), default=inf)

    def _count(self, usable: Set[int], now: float) -> bool:
        """Take in who could take the aircraft; whether others count now than at the last look."""
        before = self._usable
        for station in usable:
            since = self._since.get(station, -inf)  # the first time it counts at once
            self._since[station] = now if since == inf else since
        for station in self._since.keys() - usable:
            self._since[station] = inf
        self._usable = frozenset(station for station in usable if now - self._since[station] >= BETTER_S)
        return self._usable != before


def _worse(one: Standing, other: Standing) -> Standing:
    """What both of them are at the least."""
    return Standing(
        one.inside and other.inside,
        min(one.reach, other.reach),
        one.way_free and other.way_free,
        min(one.coverage, other.coverage),
    )


def _goes_over(
    held: tuple[PlaceFact, Standing], other: tuple[PlaceFact, Standing], *, returning: bool, ends: bool
) -> bool:
    """Whether a return goes to the other place from now on."""
    (place, counts), (candidate, better) = held, other
    if returning and place.distance_m < NEAR_M:
        return False
    if better != counts:
        return better > counts
    if ends:
        return candidate.time_s < place.time_s
    return not returning and candidate.time_s < SOONER_PART * place.time_s - SOONER_S

# SPDX-License-Identifier: GPL-3.0-or-later

"""Route check, the thesis's `check_route` (section 4.4): whether the aircraft is on its leg, in the right direction.

The rule is pure: the flown leg comes in as a `TrackFact` (geometry: `mission/track.py`), time is an argument. The same
rule runs on the vehicle, 5 times a second, and at every station, as often as it hears of the aircraft. Other modules
decide about a deviation.

Two measures, each judged for itself; the aircraft is off its route while one of them is over:

* cross-track distance from the leg, over `off_route_m`;
* course over ground against the leg, over `off_heading_deg`. Course, not heading: the nose may look at a region of
  interest. Where there is nothing to compare (a turn, hardly any speed), the fact says so, and this measure waits.

A measure is over after it was beyond its limit for `off_hold_s` in all since it was last well within it. It is no
longer over after it was well within for `off_clear_s` without a break. After a deviation both times start again. Well
within means below two thirds of the limit: so noise around a limit does not repeat a message, and does not delay one.
If no leg is flown (take-off, landing, return, GUIDED), there is no route to be off. Height is not judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Final

__all__ = ["RouteCheck", "RouteLimits", "RouteNews", "TrackFact"]

_WITHIN: Final = 2.0 / 3.0
#: after a longer silence (s) the time in between is not known, so the count starts again
_GAP_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class RouteLimits:
    """Limits of the route check."""

    #: distance from the leg being flown, metres
    off_route_m: float = 30.0
    #: course over ground against it, degrees
    off_heading_deg: float = 60.0
    #: seconds over a limit until it is told
    off_hold_s: float = 3.0
    #: seconds well within both limits until it is over
    off_clear_s: float = 3.0


@dataclass(frozen=True, slots=True)
class TrackFact:
    """Where the aircraft is with respect to the leg that it flies."""

    #: item of the mission that it flies to
    seq: int
    #: distance from the leg, metres; above 0 to its right
    cross_track_m: float
    #: course over ground against the leg, degrees, -180 to 180, above 0 to the right; None: nothing to compare
    course_off_deg: float | None
    #: how far along the leg, metres, below 0 before its beginning; and how long the leg is
    along_m: float
    length_m: float

    @property
    def text(self) -> str:
        """Where it is, for people."""
        return f"{self.side} the leg to waypoint {self.seq}"

    @property
    def side(self) -> str:
        """How far from the leg, and on which side."""
        away_m = abs(self.cross_track_m)
        return "on" if away_m < 0.5 else f"{away_m:.0f} m {'right' if self.cross_track_m > 0 else 'left'} of"


@dataclass(frozen=True, slots=True)
class RouteNews:
    """A deviation has begun (`off`) or is over."""

    off: bool
    text: str
    #: None: no leg is flown any more
    fact: TrackFact | None


class _Measure:
    """One measure against its limit."""

    __slots__ = ("_beyond", "_beyond_s", "_limit", "_limits", "_within", "_within_s", "over")

    def __init__(self, limit: float, limits: RouteLimits) -> None:
        self._limit = limit
        self._limits = limits
        self.over = False
        self.count_anew()

    def count_anew(self) -> None:
        """Nothing is known of the time until now."""
        self._beyond = self._within = False  #: at the last value
        self._beyond_s = self._within_s = 0.0

    def add_sample(self, value: float | None, passed_s: float) -> None:
        """The value now, None if there is none, and how long it is since the last one."""
        if value is None:
            self._beyond = self._within = False
            return
        beyond, within = value > self._limit, value < self._limit * _WITHIN
        if within:
            self._beyond_s = 0.0
        elif beyond and self._beyond:
            self._beyond_s += passed_s
        self._within_s = self._within_s + passed_s if within and self._within else 0.0
        self._beyond, self._within = beyond, within
        if beyond and self._beyond_s >= self._limits.off_hold_s:
            self.over = True
        elif within and self._within_s >= self._limits.off_clear_s:
            self.over = False


class RouteCheck:
    """Judges one aircraft against its route. Times are monotonic seconds."""

    __slots__ = ("_at", "_course", "_distance", "_limits", "deviation")

    def __init__(self, limits: RouteLimits) -> None:
        self._limits = limits
        self._at = -inf
        #: what is known of the present deviation, as of the last look; None: the aircraft is not off its route
        self.deviation: TrackFact | None = None
        self._begin()

    def _begin(self) -> None:
        self._distance = _Measure(self._limits.off_route_m, self._limits)
        self._course = _Measure(self._limits.off_heading_deg, self._limits)

    def update(self, fact: TrackFact | None, now: float) -> RouteNews | None:
        """Where the aircraft is now, None where it flies no leg; returns what is news."""
        passed_s, self._at = max(0.0, now - self._at), now
        if fact is None:
            self._begin()
            return self._conclude(None)
        if passed_s > _GAP_S:
            self._distance.count_anew()
            self._course.count_anew()
        self._distance.add_sample(_known(fact.cross_track_m), passed_s)
        self._course.add_sample(_known(fact.course_off_deg), passed_s)
        return self._conclude(fact)

    def _conclude(self, fact: TrackFact | None) -> RouteNews | None:
        was_off, off = self.deviation is not None, self._distance.over or self._course.over
        self.deviation = fact if off else None
        if off is was_off:
            return None
        if was_off:
            self._begin()
        return RouteNews(off, self._words(fact, off), fact)

    def _words(self, fact: TrackFact | None, off: bool) -> str:
        if fact is None:
            return "no leg of the mission is flown any more: the deviation is over"
        if not off:
            return f"on the route again: {fact.text}"
        if self._distance.over or fact.course_off_deg is None:
            return f"off route: {fact.text}"
        course = f"course {abs(fact.course_off_deg):.0f} deg off the leg to waypoint {fact.seq}"
        return f"off route: {course}, {fact.side} it"


def _known(value: float | None) -> float | None:
    return abs(value) if value is not None and isfinite(value) else None

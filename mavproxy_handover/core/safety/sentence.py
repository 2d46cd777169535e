# SPDX-License-Identifier: GPL-3.0-or-later

"""Each safety decision as one sentence: action, place, what is wrong with its figures, and the place's.

"RETURN to rally 2: GCSB silent 5 s; 1.9 km, needs 21 % of 38 %, covered by GCSA."

What is wrong is said by whoever made the sign: the edge of energy, route and fence (`SignsSeen`), the rules of all that
they know themselves (`Figures`), the edge of the place (`PlaceJudged`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf
from typing import Final

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.events import Announce, PlaceJudged, SignsSeen
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.model import FlightAction, GuardState, Reason
from mavproxy_handover.core.safety.strategy import Decision, Fact

__all__ = ["Figures", "over", "sentence"]

#: why nothing is commanded, for people
_WITHHELD: Final[Mapping[Fact, str]] = {
    Fact.FLYING: "on the ground",
    Fact.AUTOPILOT: "the autopilot is not heard",
    Fact.PILOT: "a pilot has the aircraft",
    Fact.FAILSAFE: "a failsafe of the autopilot acts",
    Fact.RETURNING: "it returns already",
    Fact.LANDING: "it lands already",
}


def sentence(decision: Decision, figures: str, place: PlaceJudged | None) -> Announce:
    """What is done from now on, for everybody. `figures`: what is wrong; `place`: where a return would go."""
    word, reason = decision.action.name, CAUSES[decision.cause].reason
    if decision.action is FlightAction.RETURN and place is not None:
        words = f"; {place.words}" if place.words else ""
        return Announce(f"{word} to {place.name}: {figures}{words}", decision.action, reason, figures, place.name)
    behind = "" if decision.withheld is None else f"; {_WITHHELD[decision.withheld]}"
    return Announce(f"{word}: {figures}{behind}", decision.action, reason, figures)


def over(before: Decision | None) -> Announce:
    """Nothing is wrong any more; `before`: the last decision, None if it was another run's."""
    if before is None:
        return Announce("OVER: the emergency of before the restart", None, Reason.NONE)
    return Announce(f"OVER: {CAUSES[before.cause].words}", None, CAUSES[before.cause].reason)


class Figures:
    """What is wrong, in words with numbers, from what the rules know. Times are monotonic seconds."""

    __slots__ = ("_authority", "_candidates", "_flight")

    def __init__(self, authority: Authority, flight: Flight, candidates: Candidates) -> None:
        self._authority = authority
        self._flight = flight
        self._candidates = candidates

    def of(self, cause: Cause, told: SignsSeen, now: float) -> str:
        """The cause with its figures; its name where there are none. `told`: what the edge has seen."""
        return _WORDS[cause](self, told, now) or CAUSES[cause].words

    def _owner(self) -> str:
        return self._authority.name(self._authority.owner)

    def _commander(self, _told: SignsSeen, now: float) -> str:
        owner = self._authority.owner
        deaf = "" if owner is None else self._candidates.deaf_words(owner, now)
        if deaf:
            return f"{self._owner()} {deaf}"
        silent_s = inf if owner is None else self._candidates.silent_s(owner, now)
        return f"{self._owner()} silent {silent_s:.0f} s" if silent_s < inf else ""

    def _outside(self, _told: SignsSeen, _now: float) -> str:
        nearest = self._candidates.zones.nearest()
        if nearest is None:
            return ""
        station, margin_m = nearest
        return f"out of coverage, {-margin_m:.0f} m outside the zone of {self._authority.name(station)}"

    def _no_station(self, _told: SignsSeen, _now: float) -> str:
        names = ", ".join(self._authority.name(station) for station in self._candidates.zones.inside())
        return f"no station here could take the aircraft: {names}" if names else ""

    def _ends(self, _told: SignsSeen, _now: float) -> str:
        owner = self._authority.owner
        left_s = inf if owner is None else self._candidates.zones.ends_s(owner)
        return f"coverage ends ahead, zone of {self._owner()} in {left_s:.0f} s" if left_s < inf else ""

    def _attacked(self, _told: SignsSeen, _now: float) -> str:
        return f"repeated authentication failures in the name of {self._owner()}"

    def _weak(self, _told: SignsSeen, _now: float) -> str:
        return f"links of {self._owner()} weak, and no better station"

    def _guard(self, _told: SignsSeen, now: float) -> str:
        if self._flight.guard(now) is GuardState.DISABLED:
            return "guard switched off"
        return _silent("guard", self._flight.guard_silent_s(now))

    def _position(self, _told: SignsSeen, now: float) -> str:
        silent_s = self._flight.position_silent_s(now)
        return f"no fresh position for {silent_s:.0f} s" if silent_s < inf else ""

    def _autopilot(self, _told: SignsSeen, now: float) -> str:
        return _silent("autopilot", self._flight.autopilot_silent_s(now))


def _silent(who: str, silent_s: float) -> str:
    return f"{who} silent {silent_s:.0f} s" if silent_s < inf else ""


_WORDS: Final[Mapping[Cause, Callable[[Figures, SignsSeen, float], str]]] = {
    Cause.ENERGY: lambda _figures, told, _now: told.energy_words,
    Cause.COMMANDER_LOST: Figures._commander,
    Cause.OUT_OF_COVERAGE: Figures._outside,
    Cause.NO_STATION: Figures._no_station,
    Cause.COVERAGE_ENDS: Figures._ends,
    Cause.AUTHENTICATION: Figures._attacked,
    Cause.LINKS_WEAK: Figures._weak,
    Cause.GUARD_LOST: Figures._guard,
    Cause.FENCE: lambda _figures, told, _now: told.fence_words,
    Cause.OFF_ROUTE: lambda _figures, told, _now: told.off_route_words,
    Cause.POSITION_STALE: Figures._position,
    Cause.AUTOPILOT_LOST: Figures._autopilot,
}

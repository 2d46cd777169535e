# SPDX-License-Identifier: GPL-3.0-or-later

"""What can be wrong: the causes of safety decisions, as a table, and when one counts.

Theory of operation
-------------------
A sign says that something looks wrong at this moment; it is a fact, made elsewhere and with a hysteresis of its own
where a measured number stands behind it. A cause is a sign that has stayed. `CauseWatch` turns signs into causes:

* A cause begins when its sign has been there for its hold-off. While the sign is away the time so far runs back at a
  quarter of the pace (PX4's `updateStartDelay` does the same): what flickers gets through, what happens once does not.
* A cause ends by its rule: when its sign has been away for `clear_s`, or with the flight.
* A cause whose policy is "off" never begins.

CAUSES is all there is to say of a cause but what is done about it, which is `strategy.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from enum import Enum, IntEnum
from math import inf
from typing import Final

__all__ = ["CAUSES", "POLICIES", "Action", "Cause", "CauseRow", "CauseWatch", "Ends"]


class Action(IntEnum):
    """What may be done, mildest first."""

    WARN = 0
    HOLD = 1  #: stop inside usable coverage and wait
    TRANSFER = 2  #: authority is on its way to a station: wait for that
    CONTINUE = 3  #: fly on through a gap that the mission declares
    RETURN = 4  #: to the chosen place
    LAND = 5  #: here and now


class Cause(Enum):
    """What is wrong, in the words of the configuration. In this order where two ask for the same action."""

    ENERGY = "energy"
    COMMANDER_LOST = "commander_lost"
    OUT_OF_COVERAGE = "out_of_coverage"
    NO_STATION = "no_station"
    COVERAGE_ENDS = "coverage_ends"
    AUTHENTICATION = "authentication"
    LINKS_WEAK = "links_weak"
    GUARD_LOST = "guard_lost"
    FENCE = "fence"
    OFF_ROUTE = "off_route"
    POSITION_STALE = "position_stale"
    AUTOPILOT_LOST = "autopilot_lost"


class Ends(Enum):
    """When a cause is over."""

    WITH_ITS_SIGN = "when it is gone"
    WITH_THE_FLIGHT = "with the flight"


#: The words that a policy can be: what is done about a cause at the most. "off": it is not looked at.
POLICIES: Final = ("off", "warn", "hold", "return", "land")


@dataclass(frozen=True, slots=True)
class CauseRow:
    """What the table says of a cause: what it is, for people; how long its sign has to stay and to be away (s); when it
    is over; which policies it can have, the one that it has without a word in the configuration first."""

    words: str
    hold_off_s: float
    clear_s: float
    ends: Ends
    policies: tuple[str, ...]


_WHILE, _FLIGHT = Ends.WITH_ITS_SIGN, Ends.WITH_THE_FLIGHT
_ANY = ("hold", "return", "land", "off")

CAUSES: Final[Mapping[Cause, CauseRow]] = {
    # less energy does not become more: who has turned back for it does not turn round again
    Cause.ENERGY: CauseRow("energy for the way home only", 2.0, 0.0, _FLIGHT, ("return", "land", "warn", "off")),
    # it has been silent for heartbeat_lost_s already
    Cause.COMMANDER_LOST: CauseRow("commander lost", 0.0, 0.0, _WHILE, ("return", "land", "warn")),
    Cause.OUT_OF_COVERAGE: CauseRow("outside every zone", 1.0, 0.0, _WHILE, ("return", "land", "warn")),
    Cause.NO_STATION: CauseRow(
        "no station here that could take the aircraft", 2.0, 1.0, _WHILE, ("return", "hold", "land", "warn", "off")
    ),
    # the border is ahead: every second of a hold-off is flown towards it
    Cause.COVERAGE_ENDS: CauseRow("coverage ends ahead", 0.0, 1.0, _WHILE, ("hold", "return", "warn", "off")),
    Cause.AUTHENTICATION: CauseRow("repeated authentication failures", 0.0, 30.0, _WHILE, ("warn", *_ANY)),
    Cause.LINKS_WEAK: CauseRow("links weak, and no better station", 10.0, 10.0, _WHILE, ("warn", *_ANY)),
    Cause.GUARD_LOST: CauseRow("guard lost", 3.0, 1.0, _WHILE, ("warn", *_ANY)),
    # the autopilot keeps its fence itself
    Cause.FENCE: CauseRow("outside the fence", 1.0, 3.0, _WHILE, ("warn", "return", "land", "off")),
    Cause.OFF_ROUTE: CauseRow("off route", 0.0, 0.0, _WHILE, ("warn", *_ANY)),
    Cause.POSITION_STALE: CauseRow("no fresh position", 0.0, 1.0, _WHILE, ("warn", "land", "off")),
    # nothing can be commanded: it is for people to know, and for the autopilot's own failsafe
    Cause.AUTOPILOT_LOST: CauseRow("autopilot not heard", 0.0, 1.0, _WHILE, ("warn", "off")),
}


class CauseWatch:
    """Which causes there are now. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_ends_at", "_filled", "_looked_at", "_off", "_signs", "active")

    #: how much slower a hold-off runs back than it runs
    BACK: Final = 4.0

    def __init__(self, off: Set[Cause] = frozenset()) -> None:
        """`off`: causes that are not looked at."""
        self._off = frozenset(off)
        self._looked_at = -inf
        self._signs: frozenset[Cause] = frozenset()
        #: of signs that are no causes yet: how long each has stayed, less what has run back (s)
        self._filled: dict[Cause, float] = {}
        #: of causes whose sign is away: when they are over
        self._ends_at: dict[Cause, float] = {}
        #: the causes there are
        self.active: frozenset[Cause] = frozenset()

    def look(self, signs: Set[Cause], now: float) -> frozenset[Cause]:
        """The signs of this moment; returns the causes. Between two looks counts what the earlier one saw."""
        passed_s = max(0.0, now - self._looked_at) if self._looked_at > -inf else 0.0
        self._looked_at = max(self._looked_at, now)
        before, self._signs = self._signs, frozenset(signs) - self._off
        for cause, filled in list(self._filled.items()):
            self._filled[cause] = filled + (passed_s if cause in before else -passed_s / self.BACK)
        for cause in self._signs - self.active:
            self._filled[cause] = max(0.0, self._filled.get(cause, 0.0))
        begun = {cause for cause in self._signs - self.active if self._filled[cause] >= CAUSES[cause].hold_off_s}
        self.active = frozenset(begun | {cause for cause in self.active if self._goes_on(cause, now)})
        self._filled = {
            cause: filled
            for cause, filled in self._filled.items()
            if cause not in self.active and (filled > 0.0 or cause in self._signs)
        }
        return self.active

    def _goes_on(self, cause: Cause, now: float) -> bool:
        """Whether what was a cause at the last look is one still."""
        row = CAUSES[cause]
        if cause in self._signs or row.ends is Ends.WITH_THE_FLIGHT:
            self._ends_at.pop(cause, None)
            return True
        if now < self._ends_at.setdefault(cause, now + row.clear_s):
            return True
        del self._ends_at[cause]
        return False

    def landed(self) -> None:
        """The flight is over, and with it every cause and every sign."""
        self.active = self._signs = frozenset()
        self._looked_at = -inf
        self._filled, self._ends_at = {}, {}

    def due_at(self) -> float | None:
        """When a cause begins or ends next if the signs stay as they are; None if none does."""
        begins = [
            self._looked_at + CAUSES[cause].hold_off_s - filled
            for cause, filled in self._filled.items()
            if cause in self._signs
        ]
        return min([*begins, *self._ends_at.values()], default=None)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Causes of safety decisions: the table of them, and the rule when one begins and ends.

Theory of operation
-------------------
A condition says that something looks wrong at this moment. It is a fact, found in `safety/conditions.py` and by the
monitors; a condition that rests on a measured number has a hysteresis there. A cause is a condition that has lasted.
`CauseWatch` turns conditions into causes:

* A cause begins when its condition has lasted for its hold-off. While the condition is away, the time so far runs back
  at a quarter of the pace, as in PX4's `updateStartDelay`. So a condition that flickers becomes a cause, and a single
  short one does not.
* A cause ends by its rule: when its condition has been away for `clear_s`, or with the flight.
* A cause whose policy is "off" never begins.

CAUSES has everything about a cause except the action, which is in `safety/strategy.py`. The configuration, its sample,
the reference and the page about safety are made from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from enum import Enum
from typing import Final

from mavproxy_handover.core.common.model import Reason

__all__ = ["CAUSES", "POLICIES", "Cause", "CauseRow", "CauseWatch", "Ends"]


class Cause(Enum):
    """A fault, in the words of the configuration. Of two with the same action the first in this order is named."""

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
    """One row of the table of causes.

    `reason`: its number on the wire; `words`: for people. `hold_off_s`: how long its condition has to last; `clear_s`:
    how long its condition has to be away. `policies`: those that it can have, the default first. `meaning`: for the
    people who write a configuration.
    """

    reason: Reason
    words: str
    hold_off_s: float
    clear_s: float
    ends: Ends
    policies: tuple[str, ...]
    meaning: str


_SIGN, _FLIGHT = Ends.WITH_ITS_SIGN, Ends.WITH_THE_FLIGHT


def _row(
    reason: Reason, words: str, hold_off_s: float, clear_s: float, ends: Ends, policies: str, meaning: str
) -> CauseRow:
    return CauseRow(reason, words, hold_off_s, clear_s, ends, tuple(policies.split()), meaning)


CAUSES: Final[Mapping[Cause, CauseRow]] = {
    # energy does not come back: an aircraft that has turned back for it does not turn round again
    Cause.ENERGY: _row(
        Reason.ENERGY, "energy only for the way back", 2.0, 0.0, _FLIGHT, "return land warn off",
        "no more is left than the route to the return site needs, with the reserve"),
    # the commander has been silent for heartbeat_lost_s already
    Cause.COMMANDER_LOST: _row(
        Reason.COMMANDER_LOST, "commander lost", 0.0, 0.0, _SIGN, "return land warn",
        "no commander is heard, and no other station takes the aircraft"),
    Cause.OUT_OF_COVERAGE: _row(
        Reason.OUT_OF_COVERAGE, "out of coverage", 1.0, 0.0, _SIGN, "return land warn",
        "outside every zone; a mission's own on_out_of_coverage goes before"),
    Cause.NO_STATION: _row(
        Reason.NO_STATION, "no station here could take the aircraft", 2.0, 1.0, _SIGN, "return hold land warn off",
        "inside zones, but no station of theirs could take the aircraft"),
    # during a hold-off the aircraft would fly on towards the border
    Cause.COVERAGE_ENDS: _row(
        Reason.COVERAGE_ENDS, "coverage ends ahead", 0.0, 0.0, _SIGN, "hold return warn off",
        "the border of the last zone that counts is ahead"),
    Cause.AUTHENTICATION: _row(
        Reason.AUTHENTICATION, "repeated authentication failures", 0.0, 30.0, _SIGN, "warn hold return land off",
        "another sender pretends to be the commander"),
    Cause.LINKS_WEAK: _row(
        Reason.LINK_QUALITY, "links weak, and no better station", 10.0, 10.0, _SIGN, "warn hold return land off",
        "the commander's links are bad, and no station's are better"),
    Cause.GUARD_LOST: _row(
        Reason.GUARD_LOST, "guard lost", 3.0, 1.0, _SIGN, "warn hold return land off",
        "the guard is not heard any more"),
    # the autopilot keeps its fence itself
    Cause.FENCE: _row(
        Reason.FENCE, "outside the fence", 1.0, 3.0, _SIGN, "warn return land off",
        "outside the autopilot's fence, which keeps it itself (FENCE_ACTION)"),
    Cause.OFF_ROUTE: _row(
        Reason.OFF_ROUTE, "off route", 0.0, 0.0, _SIGN, "warn hold return land off",
        "see [route]"),
    Cause.POSITION_STALE: _row(
        Reason.POSITION_STALE, "no fresh position", 1.0, 1.0, _SIGN, "warn land off",
        "no fresh position"),
    # nothing can be commanded: people are told, and the autopilot has its own failsafe
    Cause.AUTOPILOT_LOST: _row(
        Reason.AUTOPILOT_LOST, "autopilot not heard", 0.0, 1.0, _SIGN, "warn off",
        "the autopilot is not heard"),
}  # fmt: skip


class CauseWatch:
    """The causes of this moment. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_begins_at", "_clear_s", "_ends_at", "_gone", "_hold_off_s", "_off", "active")

    #: a hold-off runs back this much slower than it runs
    BACK: Final = 4.0

    def __init__(
        self,
        off: Set[Cause] = frozenset(),
        hold_off_s: Mapping[Cause, float] | None = None,
        clear_s: Mapping[Cause, float] | None = None,
    ) -> None:
        """`off`: causes that never begin. `hold_off_s`, `clear_s`: values that differ from the table."""
        self._off = frozenset(off)
        self._hold_off_s = {cause: row.hold_off_s for cause, row in CAUSES.items()} | dict(hold_off_s or {})
        self._clear_s = {cause: row.clear_s for cause, row in CAUSES.items()} | dict(clear_s or {})
        #: conditions that are no causes yet: when each becomes one if it lasts
        self._begins_at: dict[Cause, float] = {}
        #: conditions that went away before that: when, and how long they had lasted (s)
        self._gone: dict[Cause, tuple[float, float]] = {}
        #: causes whose condition is away: when each is over
        self._ends_at: dict[Cause, float] = {}
        #: the causes there are
        self.active: frozenset[Cause] = frozenset()

    def update(self, conditions: Set[Cause], now: float) -> frozenset[Cause]:
        """Take the conditions of this moment; returns the causes. Between two calls the earlier conditions hold."""
        conditions = conditions - self._off
        for cause in [cause for cause in self._begins_at if cause not in conditions]:
            stayed_s = self._hold_off_s[cause] - (self._begins_at.pop(cause) - now)
            self._gone[cause] = (now, stayed_s)
        for cause in conditions - self.active - self._begins_at.keys():
            gone_at, stayed_s = self._gone.pop(cause, (now, 0.0))
            stayed_s = max(0.0, stayed_s - (now - gone_at) / self.BACK)
            self._begins_at[cause] = now + max(0.0, self._hold_off_s[cause] - stayed_s)
        begun = {cause for cause, at in self._begins_at.items() if now >= at}
        self.active = frozenset(begun | {cause for cause in self.active if self._goes_on(cause, conditions, now)})
        for cause in begun:
            del self._begins_at[cause]
        return self.active

    def _goes_on(self, cause: Cause, conditions: Set[Cause], now: float) -> bool:
        """Whether a cause of the last call is still one."""
        if cause in conditions or CAUSES[cause].ends is Ends.WITH_THE_FLIGHT:
            self._ends_at.pop(cause, None)
            return True
        if now < self._ends_at.setdefault(cause, now + self._clear_s[cause]):
            return True
        del self._ends_at[cause]
        return False

    def resume(self, causes: Set[Cause]) -> None:
        """Continue the causes of the run before, without a hold-off."""
        self.active |= causes - self._off

    def landed(self) -> None:
        """The flight is over, and with it the causes that last as long as it does."""
        self.active = frozenset(cause for cause in self.active if CAUSES[cause].ends is not Ends.WITH_THE_FLIGHT)

    def due_at(self) -> float | None:
        """When a cause begins or ends next if the conditions stay as they are; None if none does."""
        return min([*self._begins_at.values(), *self._ends_at.values()], default=None)

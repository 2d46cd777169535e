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
from enum import Enum
from typing import Final

from mavproxy_handover.core.common.model import Reason

__all__ = ["CAUSES", "POLICIES", "Cause", "CauseRow", "CauseWatch", "Ends"]


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
    """What the table says of a cause.

    Its number for others, and what it is, for people; how long its sign has to stay, and to be away (s); when it is
    over; which policies it can have, the one that it has without a word in the configuration first.
    """

    reason: Reason
    words: str
    hold_off_s: float
    clear_s: float
    ends: Ends
    policies: tuple[str, ...]


_SIGN, _FLIGHT = Ends.WITH_ITS_SIGN, Ends.WITH_THE_FLIGHT


def _row(reason: Reason, words: str, hold_off_s: float, clear_s: float, ends: Ends, policies: str) -> CauseRow:
    return CauseRow(reason, words, hold_off_s, clear_s, ends, tuple(policies.split()))


CAUSES: Final[Mapping[Cause, CauseRow]] = {
    # less energy does not become more: who has turned back for it does not turn round again
    Cause.ENERGY: _row(
        Reason.ENERGY, "energy for the way back only", 2.0, 0.0, _FLIGHT, "return land warn off"),
    # it has been silent for heartbeat_lost_s already
    Cause.COMMANDER_LOST: _row(
        Reason.COMMANDER_LOST, "commander lost", 0.0, 0.0, _SIGN, "return land warn"),
    Cause.OUT_OF_COVERAGE: _row(
        Reason.OUT_OF_COVERAGE, "out of coverage", 1.0, 0.0, _SIGN, "return land warn"),
    Cause.NO_STATION: _row(
        Reason.NO_STATION, "no station here could take the aircraft", 2.0, 1.0, _SIGN, "return hold land warn off"),
    # the border is ahead: every second of a hold-off is flown towards it
    Cause.COVERAGE_ENDS: _row(
        Reason.COVERAGE_ENDS, "coverage ends ahead", 0.0, 0.0, _SIGN, "hold return warn off"),
    Cause.AUTHENTICATION: _row(
        Reason.AUTHENTICATION, "repeated authentication failures", 0.0, 30.0, _SIGN, "warn hold return land off"),
    Cause.LINKS_WEAK: _row(
        Reason.LINK_QUALITY, "links weak, and no better station", 10.0, 10.0, _SIGN, "warn hold return land off"),
    Cause.GUARD_LOST: _row(
        Reason.GUARD_LOST, "guard lost", 3.0, 1.0, _SIGN, "warn hold return land off"),
    # the autopilot keeps its fence itself
    Cause.FENCE: _row(
        Reason.FENCE, "outside the fence", 1.0, 3.0, _SIGN, "warn return land off"),
    Cause.OFF_ROUTE: _row(
        Reason.OFF_ROUTE, "off route", 0.0, 0.0, _SIGN, "warn hold return land off"),
    Cause.POSITION_STALE: _row(
        Reason.POSITION_STALE, "no fresh position", 1.0, 1.0, _SIGN, "warn land off"),
    # nothing can be commanded: it is for people to know, and for the autopilot's own failsafe
    Cause.AUTOPILOT_LOST: _row(
        Reason.AUTOPILOT_LOST, "autopilot not heard", 0.0, 1.0, _SIGN, "warn off"),
}  # fmt: skip


class CauseWatch:
    """Which causes there are now. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_begins_at", "_clear_s", "_ends_at", "_gone", "_hold_off_s", "_off", "active")

    #: how much slower a hold-off runs back than it runs
    BACK: Final = 4.0

    def __init__(
        self,
        off: Set[Cause] = frozenset(),
        hold_off_s: Mapping[Cause, float] | None = None,
        clear_s: Mapping[Cause, float] | None = None,
    ) -> None:
        """`off`: causes that are not looked at. `hold_off_s`, `clear_s`: where they are not the table's."""
        self._off = frozenset(off)
        self._hold_off_s = {cause: row.hold_off_s for cause, row in CAUSES.items()} | dict(hold_off_s or {})
        self._clear_s = {cause: row.clear_s for cause, row in CAUSES.items()} | dict(clear_s or {})
        #: of signs that are no causes yet: when each is one if it stays
        self._begins_at: dict[Cause, float] = {}
        #: of those that went away before: when, and how long they had stayed (s)
        self._gone: dict[Cause, tuple[float, float]] = {}
        #: of causes whose sign is away: when they are over
        self._ends_at: dict[Cause, float] = {}
        #: the causes there are
        self.active: frozenset[Cause] = frozenset()

    def look(self, signs: Set[Cause], now: float) -> frozenset[Cause]:
        """The signs of this moment; returns the causes. Between two looks counts what the earlier one saw."""
        signs = signs - self._off
        for cause in [cause for cause in self._begins_at if cause not in signs]:
            stayed_s = self._hold_off_s[cause] - (self._begins_at.pop(cause) - now)
            self._gone[cause] = (now, stayed_s)
        for cause in signs - self.active - self._begins_at.keys():
            gone_at, stayed_s = self._gone.pop(cause, (now, 0.0))
            stayed_s = max(0.0, stayed_s - (now - gone_at) / self.BACK)
            self._begins_at[cause] = now + max(0.0, self._hold_off_s[cause] - stayed_s)
        begun = {cause for cause, at in self._begins_at.items() if now >= at}
        self.active = frozenset(begun | {cause for cause in self.active if self._goes_on(cause, signs, now)})
        for cause in begun:
            del self._begins_at[cause]
        return self.active

    def _goes_on(self, cause: Cause, signs: Set[Cause], now: float) -> bool:
        """Whether what was a cause at the last look is one still."""
        if cause in signs or CAUSES[cause].ends is Ends.WITH_THE_FLIGHT:
            self._ends_at.pop(cause, None)
            return True
        if now < self._ends_at.setdefault(cause, now + self._clear_s[cause]):
            return True
        del self._ends_at[cause]
        return False

    def resume(self, causes: Set[Cause]) -> None:
        """The run before had these, and there is no sign that has to stay for it: they go on."""
        self.active |= causes - self._off

    def landed(self) -> None:
        """The flight is over, and with it the causes that last as long as it does."""
        self.active = frozenset(cause for cause in self.active if CAUSES[cause].ends is not Ends.WITH_THE_FLIGHT)

    def due_at(self) -> float | None:
        """When a cause begins or ends next if the signs stay as they are; None if none does."""
        return min([*self._begins_at.values(), *self._ends_at.values()], default=None)

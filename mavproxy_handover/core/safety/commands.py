# SPDX-License-Identifier: GPL-3.0-or-later

"""What becomes of a command of the commander that would leave energy, fence or coverage: it passes, with a warning or
without, or it is refused with the reason.

Theory of operation
-------------------
Who commands is not the question here, it was answered before. A command is of a `Kind`; the table `JUDGED` says which
limits a kind can leave at all. Where there is something that it would leave (`left`, worked out elsewhere, in words),
the limit's policy decides: "off" is not looked at, "warn" lets it pass and says so, "refuse" refuses it.

What leads away from danger is in no row, and is never refused: RTL, LAND, BRAKE, LOITER, a pause, the pilot's modes.
The word without configuration is "refuse" for all three. A warning is read when the aircraft is on its way already,
and a refusal costs whoever means it three seconds: it says itself how it is lifted. Both ways are the operator's
own hand, and each lifts one limit, the one that the refusal has named:

* `lift`: for `LIFTED_S`, for whoever commands then. It ends with that one's authority.
* The same command sent anew, `ANEW_S` after the answer at the earliest and `UNTIL_S` at the latest: that command alone.
  Earlier it is a copy or a program that repeats itself, and each copy moves the answer: a program that goes on
  repeating never gets through. What says of itself that it is a repetition does not count either, nor does a stream.

What was lifted or let pass once passes again as long as it is sent anew in time: an acknowledgement may get lost.
Pure: no clock, no I/O. Times are monotonic seconds; not safe for threads.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import Final

__all__ = [
    "ANEW_S",
    "JUDGED",
    "LIFTED_S",
    "POLICIES",
    "STREAMED",
    "UNTIL_S",
    "CommandRules",
    "Kind",
    "Limit",
    "Outcome",
    "Ruling",
]

ANEW_S: Final = 3.0
UNTIL_S: Final = 15.0
LIFTED_S: Final = 60.0
#: what the configuration may say of a limit, the word without one first
POLICIES: Final = ("refuse", "warn", "off")


class Limit(Enum):
    """What a command may leave, in the words of the configuration; the gravest first."""

    ENERGY = "energy"
    FENCE = "fence"
    COVERAGE = "coverage"


class Kind(Enum):
    """What a command does."""

    START = "start"  #: begins the flight
    GO_ON = "go on"  #: the mission is flown on from here, by itself or from another item
    FLY_TO = "fly to"  #: to a place, and wait there
    TARGET = "target"  #: the same, in a stream of targets
    SPEED = "speed"  #: the mission is flown at another speed
    ROUTE = "route"  #: another mission


#: Which limits a kind of command can leave. START's coverage and fence were checked with the package.
JUDGED: Final[Mapping[Kind, tuple[Limit, ...]]] = {
    Kind.START: (Limit.ENERGY,),
    Kind.GO_ON: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.FLY_TO: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.TARGET: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.SPEED: (Limit.ENERGY,),
    Kind.ROUTE: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
}
#: Kinds that programs repeat by themselves: only `lift` lifts for these.
STREAMED: Final = frozenset({Kind.TARGET})


class Outcome(Enum):
    """What becomes of a command."""

    PASSES = "passes"
    WARNED = "passes with a warning"
    LIFTED = "passes because a limit was lifted"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Ruling:
    """The outcome, and for what reason: `limits` that are warned of or lifted, or the one that it is refused for, and
    `words` of these."""

    outcome: Outcome
    limits: tuple[Limit, ...] = ()
    words: str = ""

    @property
    def passes(self) -> bool:
        """The command is carried out."""
        return self.outcome is not Outcome.REFUSED


@dataclass(slots=True)
class _Asked:
    """A command that was refused, as it was asked, and when it was answered last."""

    wish: Hashable
    at: float
    #: the limit that the answer has named; None: it was let pass
    named: Limit | None
    lifted: set[Limit] = field(default_factory=set)


class CommandRules:
    """Rules on the commands of one vehicle's commander."""

    def __init__(self, policies: Mapping[Limit, str] | None = None) -> None:
        """`policies`: where they are not the first of POLICIES."""
        self._policies = {limit: (policies or {}).get(limit, POLICIES[0]) for limit in Limit}
        self._lifted: dict[Limit, float] = {}
        self._asked: dict[tuple[int, Kind], _Asked] = {}

    def policy(self, limit: Limit) -> str:
        """What is done about it."""
        return self._policies[limit]

    def looks_at(self, kind: Kind) -> tuple[Limit, ...]:
        """The limits of this kind of command that matter: what it would leave of others need not be worked out."""
        return tuple(limit for limit in JUDGED[kind] if self._policies[limit] != "off")

    def rule(
        self, kind: Kind, wish: Hashable, left: Mapping[Limit, str], station: int, now: float, *, repeats: bool = False
    ) -> Ruling:
        """What becomes of a command of `station`, which commands.

        `wish`: what tells it from others of its kind. `left`: the limits that it would leave, in words. `repeats`: it
        says of itself that it was sent before.
        """
        limits = [limit for limit in self.looks_at(kind) if left.get(limit)]
        warned = [limit for limit in limits if self._policies[limit] == "warn"]
        strict = [limit for limit in limits if limit not in warned]
        asked = self._asked_before(kind, wish, station, now, repeats)
        by_hand = [limit for limit in strict if self.lifted(limit, now) or limit in asked.lifted]
        refused = next((limit for limit in strict if limit not in by_hand), None)
        if not strict:
            self._asked.pop((station, kind), None)
        else:
            asked.named, asked.at = refused, now
            self._asked[station, kind] = asked
        if refused is not None:
            return Ruling(Outcome.REFUSED, (refused,), left[refused])
        told = tuple(by_hand or warned)
        outcome = Outcome.LIFTED if by_hand else Outcome.WARNED if warned else Outcome.PASSES
        return Ruling(outcome, told, ", ".join(left[limit] for limit in told))

    def _asked_before(self, kind: Kind, wish: Hashable, station: int, now: float, repeats: bool) -> _Asked:
        """What there is of the same command, with the limit lifted that its last answer has named if it may be."""
        asked = self._asked.get((station, kind))
        if asked is None or asked.wish != wish or now - asked.at > UNTIL_S or kind in STREAMED:
            return _Asked(wish, -inf, None)
        if asked.named is not None and not repeats and now - asked.at >= ANEW_S:
            asked.lifted.add(asked.named)
        return asked

    # ---- what the operator lifts ----------------------------------------------------------------------------------

    def lift(self, limit: Limit, now: float) -> None:
        """The operator of whoever commands lifts a limit, for LIFTED_S."""
        self._lifted[limit] = now + LIFTED_S

    def lifted(self, limit: Limit, now: float) -> bool:
        """Whether it is lifted for every command."""
        return now < self._lifted.get(limit, -inf)

    def lifted_s(self, now: float) -> dict[Limit, float]:
        """The limits that are lifted, and for how long yet (s)."""
        return {limit: until - now for limit, until in self._lifted.items() if now < until}

    def authority_moved(self) -> None:
        """Somebody else commands, or nobody: what was lifted for the one before does not count any more."""
        self._lifted.clear()
        self._asked.clear()

# SPDX-License-Identifier: GPL-3.0-or-later

"""Check of the commander's commands against energy, fence and coverage: each passes, is warned of, or is refused.

Theory of operation
-------------------
The gate has checked before that the sender commands. A command has a `Kind`; the table `JUDGED` says which limits a
kind can exceed. The caller works out the limits that a command would exceed (`exceeded`: each limit, and in words by
how much or where). The limit's policy decides: "off" is not checked, "warn" lets the command pass with a warning,
"refuse" refuses it. `operator/checks/command_check.py` is the caller and tells people.

Commands that lead away from danger are in no row, and are never refused: RTL, LAND, BRAKE, LOITER, a pause, the pilot's
modes. The default is "refuse" for all three limits. An operator reads a warning only after the aircraft is on its way.
A refusal costs an operator who insists ten seconds, and says how to lift the limit. There are two ways, both for the
operator, and each lifts the one limit that the refusal has named:

* `lift`: for `LIFTED_S`, for the station that commands then. It ends with that station's authority.
* The same command sent again to insist: that command alone, for `LIFTED_S` at most. It counts if all of this holds:
  - It comes `QUIET_S` to `UNTIL_S` after the last copy of it, with no copy in between. Each copy starts the wait again,
    passed or refused. Sooner it is a retransmission, later it is a new command. Programs repeat a command for less
    than `QUIET_S`, except for some messages, which have their own `quiet_s` (`tests/core/safety/retransmission.py` has
    the timers of QGroundControl, MAVSDK, Mission Planner, MAVProxy and our station).
  - The station was heard during the whole wait. If its link was interrupted, copies may have been lost or delayed. Then
    the next copy of an endless repetition would look like an operator's.
  - It does not say of itself that it is a repetition, and it is no stream.

A copy of a command that passed passes too if it comes sooner than `QUIET_S`: the acknowledgement may have been lost.
Pure: no clock, no I/O. Times are monotonic seconds; not safe for threads.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import Final

__all__ = [
    "JUDGED",
    "LIFTED_S",
    "POLICIES",
    "QUIET_S",
    "STREAMED",
    "UNTIL_S",
    "CommandRules",
    "Kind",
    "Limit",
    "Outcome",
    "Ruling",
]

#: a copy after less than this time is a retransmission of a program, and does not lift the limit
QUIET_S: Final = 10.0
#: a copy after more than this time is a new command
UNTIL_S: Final = 30.0
#: for how long an operator lifts a limit
LIFTED_S: Final = 60.0
#: what the configuration may say of a limit, the word without one first
POLICIES: Final = ("refuse", "warn", "off")


class Limit(Enum):
    """Limits that a command may leave, in the words of the configuration; the gravest first."""

    ENERGY = "energy"
    FENCE = "fence"
    COVERAGE = "coverage"


class Kind(Enum):
    """Kinds of commands by their effect."""

    START = "start"  #: begins the flight
    GO_ON = "go on"  #: the mission is flown on from here, by itself or from another item
    FLY_TO = "fly to"  #: to a place, and wait there
    TARGET = "target"  #: to a place, in a stream of targets
    SPEED = "speed"  #: the mission is flown at another speed
    ROUTE = "route"  #: another mission
    UNKNOWN = "unknown way"  #: to where nothing here can tell: after another system, to a place by a label


#: Which limits a kind of command can leave. START's coverage and fence were checked with the package. A way that is not
#: known may leave each of them: one refusal is enough, and one word of the operator.
JUDGED: Final[Mapping[Kind, tuple[Limit, ...]]] = {
    Kind.START: (Limit.ENERGY,),
    Kind.GO_ON: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.FLY_TO: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.TARGET: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.SPEED: (Limit.ENERGY,),
    Kind.ROUTE: (Limit.ENERGY, Limit.FENCE, Limit.COVERAGE),
    Kind.UNKNOWN: (Limit.COVERAGE,),
}
#: Kinds that programs repeat by themselves: only `lift` lifts for these.
STREAMED: Final = frozenset({Kind.TARGET})


class Outcome(Enum):
    """Verdict on a command."""

    PASSES = "passes"
    WARNED = "passes with a warning"
    LIFTED = "passes because a limit was lifted"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Ruling:
    """The verdict and its reason.

    `limits`: those that are lifted and those that are warned of, or the one of the refusal; `words`: of these.
    `warning`: of the limits that are only warned of; "" if there is none. `copy_after_s`: seconds since the last copy
    of the same command; None: there was none.
    """

    outcome: Outcome
    limits: tuple[Limit, ...] = ()
    words: str = ""
    warning: str = ""
    copy_after_s: float | None = field(default=None, compare=False)

    @property
    def passes(self) -> bool:
        """The command is carried out."""
        return self.outcome is not Outcome.REFUSED


@dataclass(slots=True)
class _Asked:
    """A command as it was asked, and when its last copy came."""

    wish: Hashable
    at: float
    #: the limit that the last answer has named; None: it was let pass
    named: Limit | None
    lifted: set[Limit] = field(default_factory=set)
    #: when the first of these was lifted
    lifted_at: float = inf

    def lift(self, limit: Limit, now: float) -> None:
        """The operator insists: this limit does not count for this command any more."""
        self.lifted.add(limit)
        self.lifted_at = min(self.lifted_at, now)

    def answered(self, named: Limit | None, now: float) -> None:
        """A copy was answered. `named`: the limit that the refusal names; None: it was let pass."""
        self.named, self.at = named, now

    def copied(self, now: float) -> None:
        """A copy came and was not judged."""
        self.at = now


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
        self,
        kind: Kind,
        wish: Hashable,
        exceeded: Mapping[Limit, str],
        station: int,
        now: float,
        *,
        heard_since: float,
        repeats: bool = False,
        quiet_s: float = QUIET_S,
        begun_at: float | None = None,
    ) -> Ruling:
        """The verdict on a command of `station`, which commands.

        `wish`: what tells it from others of its kind. `exceeded`: the limits that it would exceed, in words.
        `heard_since`: since when the station has been heard without an interruption. `repeats`: it says of itself that
        it was sent before. `quiet_s`: how long programs may go on repeating it. `begun_at`: when its first message
        came, if it took more than one.
        """
        limits = [limit for limit in self.looks_at(kind) if exceeded.get(limit)]
        warned = [limit for limit in limits if self._policies[limit] == "warn"]
        strict = [limit for limit in limits if limit not in warned]
        begun_at = now if begun_at is None else begun_at
        asked, after_s = self._asked_before(kind, wish, station, begun_at)
        insists = not repeats and after_s is not None and after_s >= quiet_s and heard_since <= asked.at
        if insists and asked.named is not None:
            asked.lift(asked.named, now)
        by_hand = [limit for limit in strict if self.lifted(limit, now) or limit in asked.lifted]
        refused = next((limit for limit in strict if limit not in by_hand), None)
        if not strict:
            self._asked.pop((station, kind), None)
        else:
            asked.answered(refused, now)
            self._asked[station, kind] = asked
        if refused is not None:
            return Ruling(Outcome.REFUSED, (refused,), exceeded[refused], copy_after_s=after_s)
        outcome = Outcome.LIFTED if by_hand else Outcome.WARNED if warned else Outcome.PASSES
        told = [*by_hand, *warned]
        words, warning = (", ".join(exceeded[limit] for limit in each) for each in (told, warned))
        return Ruling(outcome, tuple(told), words, warning, after_s)

    def _asked_before(self, kind: Kind, wish: Hashable, station: int, begun_at: float) -> tuple[_Asked, float | None]:
        """The record of the same command, and seconds from its last copy to `begun_at`; None: it is a new command."""
        asked = self._asked.get((station, kind))
        if asked is None or asked.wish != wish or kind in STREAMED:
            return _Asked(wish, -inf, None), None
        after_s = begun_at - asked.at
        copies_s = QUIET_S if asked.named is None else UNTIL_S
        if after_s > copies_s or begun_at - asked.lifted_at > LIFTED_S:
            return _Asked(wish, -inf, None), None
        return asked, after_s

    def came(self, kind: Kind, wish: Hashable, station: int, now: float) -> None:
        """A copy was not judged, because too many commands came at once: the wait starts again."""
        asked = self._asked.get((station, kind))
        if asked is not None and asked.wish == wish:
            asked.copied(now)

    # ---- what the operator lifts ----------------------------------------------------------------------------------

    def lift(self, limit: Limit, now: float) -> None:
        """The operator of the commander lifts a limit, for LIFTED_S."""
        self._lifted[limit] = now + LIFTED_S

    def lifted(self, limit: Limit, now: float) -> bool:
        """Whether it is lifted for every command."""
        return now < self._lifted.get(limit, -inf)

    def lifted_s(self, now: float) -> dict[Limit, float]:
        """The limits that are lifted, and for how long yet (s)."""
        return {limit: until - now for limit, until in self._lifted.items() if now < until}

    def authority_moved(self) -> None:
        """The commander has changed: what was lifted for the last one does not count any more."""
        self._lifted.clear()
        self._asked.clear()

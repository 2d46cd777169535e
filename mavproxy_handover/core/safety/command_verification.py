# SPDX-License-Identifier: GPL-3.0-or-later

"""Verification of orders: whether mode and motion show that the autopilot follows, when to repeat, when to give up.

Theory of operation
-------------------
An acknowledged command is not yet carried out. `Handling.shows` says for each action which mode and which motion show
it. The limits say how long each may take:

* HOLD shows only by rest: ArduCopter pauses within its mode. The time for it follows from the speed at the command.
* RETURN shows by the mode, then by a smaller distance to the destination of RTL, or by a climb, which comes first.
  During the climb the destination is above the aircraft; a destination that is suddenly far away is another one. An
  aircraft that has not got nearer by NEARER_M within `stuck_s` is blown backwards, or flies somewhere else. At the
  destination (`at_place_m`) no more motion is expected: the aircraft waits, or comes down.
* LAND shows by the mode, then by a descent.
* A copter that does not take RTL is commanded to LAND in the same attempt: `bring_home` in
  `vehicle/profiles/copter.py`. So LAND shows an ordered RETURN too (`Handling.shows` in `core/common/handling.py`).
* CONTINUE, which ends a hold, shows only by motion: the mode of a paused mission is the mode of a flown one.

This is the table for copters. An aircraft with wings never rests. It holds by circling, in a mode for that, and goes on
by leaving that mode. After a return it circles some way from the return site. A plane without hover motors lands by a
landing sequence. Only the mode can show that. So each profile has its own `Handling`.

A climb, a breached fence or an unknown destination can hide the progress of a return or a landing. The time does not
run while one of them lasts. It starts with the first look after that. So the result does not depend on how often
`verify` is called. `due_at` says when the next call is needed if no event comes.

An order that does not show in time is commanded again, TRIES times. After that the autopilot is `unable` to do the
action. `strategy.py` gets this as a fact (the aircraft cannot hold, no return site can be reached) and goes on to the
next graver action. After LAND there is no graver action. LAND is repeated while another mode shows. If the mode is
right and the aircraft does not come down, that is told once, because a repetition would not help. The same order for
another cause is the same order: causes that take turns give it no more time.

If the autopilot refuses an order, HOLD and RETURN are `unable` at once, and LAND is commanded again after
REFUSED_AGAIN_S. A refusal counts only for the order in force, once. It does not count if the order still shows: the
aircraft is at rest, or in the mode.

A held aircraft counts as held until something else shows (`stands`). A return after the hold that was ordered and never
flown has not ended it. When the cause is over, the aircraft is to go on. A standing aircraft has no graver action, so
CONTINUE is repeated like LAND.

A pilot, a failsafe and a command of the commander end the order (WITHDRAWN). The commander's command holds until a new
decision. An order that a pilot or a failsafe has interrupted is commanded again after they have given the aircraft
back, while its cause lasts. A mode of an unknown source is commanded away. While the autopilot is not heard, no time
runs. When it is heard again, the order in force is commanded again at once.

While the fence is breached, a return or a landing under way is not commanded again and not given up. A change of the
mode gives ArduCopter's fence ten seconds of "manual recovery", in which it does not act on a further breach.
"""

from __future__ import annotations

from collections.abc import Set
from enum import Enum
from math import inf
from typing import Final

from mavproxy_handover.core.common.events import MotionSeen
from mavproxy_handover.core.common.handling import STANDS_STILL, Handling
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, ModeSource
from mavproxy_handover.core.safety.mode_source import ModeTracker
from mavproxy_handover.core.safety.strategy import Fact

__all__ = [
    "NEARER_M",
    "REFUSED_AGAIN_S",
    "TRIES",
    "Seen",
    "CommandVerification",
]

#: number of commands before an order is given up
TRIES: Final = 2
#: limits that count as nearer (m), as a climb or a descent (m/s), and as rest (m/s)
NEARER_M: Final = 5.0
CLIMBS_MPS: Final = 0.3
RESTS_MPS: Final = 1.0
#: a stop loses at least so much speed each second (m/s2), once the command has arrived (s)
BRAKES_MPS2: Final = 1.25
ARRIVES_S: Final = 2.0
#: time after which a refused landing is commanded again (s)
REFUSED_AGAIN_S: Final = 1.0
#: more than wind can move the aircraft between two reports (m): it has another destination now
OTHER_PLACE_M: Final = 50.0

_COMING_HOME: Final = frozenset({Fact.RETURNING, Fact.LANDING})
#: facts that show that the aircraft follows, or does more
_SHOWS_AS: Final = {FlightAction.RETURN: _COMING_HOME, FlightAction.LAND: frozenset({Fact.LANDING})}
#: orders without a graver one after them
_ENDLESS: Final = (FlightAction.CONTINUE, FlightAction.LAND)
#: orders to stand still, or to move again
_STANDING: Final = (FlightAction.HOLD, FlightAction.CONTINUE)


class Seen(Enum):
    """Result of an order."""

    OBEYED = "the autopilot follows"
    AGAIN = "commanded again"
    UNABLE = "the autopilot does not follow"
    REFUSED = "the autopilot refuses it"
    WITHDRAWN = "not commanded any more"


class CommandVerification:
    """The order in force. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_commanded_at",
        "_deaf",
        "_excused",
        "_first_speed",
        "_interrupted",
        "_last_m",
        "_limits",
        "_motion",
        "_nearest_m",
        "_refused",
        "_shown",
        "_since",
        "_tries",
        "due_at",
        "handling",
        "order",
        "shows_by",
        "stands",
        "unable",
    )

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        #: how the aircraft carries out an order
        self.handling = STANDS_STILL
        #: the order in force; None: none
        self.order: FlightAction | None = None
        #: orders that the autopilot did not follow since the first cause
        self.unable: frozenset[FlightAction] = frozenset()
        #: the aircraft was held, and nothing shows since that it moves
        self.stands = False
        #: since when the present step has been awaited
        self._since = -inf
        #: when the order was given to the autopilot last
        self._commanded_at = -inf
        self._tries = 0
        #: the order has shown by mode, or by rest
        self._shown = False
        #: the autopilot has refused the order, and `verify` has not handled that yet
        self._refused = False
        #: the return or the landing that a pilot or a failsafe has interrupted
        self._interrupted: FlightAction | None = None
        #: the autopilot is not heard
        self._deaf = False
        #: at the last look there was a reason why the aircraft gets no nearer
        self._excused = False
        #: the least distance to the destination (m) since the order showed, and the last one
        self._nearest_m = self._last_m = inf
        #: speed (m/s) when the order was given
        self._first_speed = 0.0
        self._motion: MotionSeen | None = None
        #: when `verify` has to be called at the latest; None: no time runs
        self.due_at: float | None = None
        #: until when an order need not show yet, so that nothing milder is news; None: that time does not run
        self.shows_by: float | None = None

    # ---- what happens ---------------------------------------------------------------------------------------------

    def moved(self, motion: MotionSeen, now: float) -> None:
        """The motion of the aircraft."""
        self._motion = motion
        if self.order is FlightAction.RETURN and self._shown and motion.left_m is not None:
            if motion.left_m <= self._nearest_m - NEARER_M or motion.left_m > self._last_m + OTHER_PLACE_M:
                self._nearest_m, self._since = motion.left_m, now
            self._last_m = motion.left_m

    def unseen(self) -> None:
        """The motion is not known any more: checks that need it conclude nothing."""
        self._motion = None

    def ordered(self, action: FlightAction, now: float) -> None:
        """HOLD, RETURN or LAND is the order in force from now on, or stays it."""
        self._interrupted = None
        self.stands |= action is FlightAction.HOLD
        self._commanded_at = now
        if action is not self.order:
            self._begin(action, 1, now)

    def resume_standing(self) -> None:
        """The aircraft stood by an order of the run before."""
        self.stands = True

    def grounded(self) -> None:
        """The aircraft is on the ground: it does not stand by an order."""
        self.stands = False

    def watch(self, handling: Handling) -> None:
        """How the aircraft that is watched carries out an order."""
        self.handling = handling

    def refused(self, action: FlightAction) -> None:
        """The autopilot has refused this. It counts only for the order in force, and only before that shows."""
        self._refused |= action is self.order and not self._shown

    def go_on(self, now: float) -> None:
        """Order the aircraft on: if it stands by an order, watch until it moves."""
        stands = self.stands
        self.over()
        if stands:
            self.stands = True
            self._begin(FlightAction.CONTINUE, 1, now)

    def _begin(self, action: FlightAction, tries: int, now: float) -> None:
        self.order, self._tries = action, tries
        self._since = self._commanded_at = now
        self._shown = self._excused = self._refused = False
        self._first_speed = 0.0 if self._motion is None else self._motion.speed_mps

    def over(self) -> None:
        """There is no cause any more, or the flight is over: forget everything about orders."""
        self.order = self._interrupted = None
        self.stands = False
        self.unable = frozenset()

    def taken(self, hand: ModeSource) -> FlightAction | None:
        """Another source has chosen the mode; returns the order that this has ended, None if none."""
        order, self.order = self.order, None
        self.stands = False
        if hand is ModeSource.COMMANDER:  # the aircraft may be able to follow where the commander takes it
            order, self._interrupted, self.unable = order or self._interrupted, None, frozenset()
        elif order is not None and order not in _STANDING:  # a hold is decided again if it is needed
            self._interrupted = order
        return order

    def commanded(self) -> FlightAction | None:
        """The commander has commanded how the aircraft flies; from now on it stands or moves by that command.

        Returns the order that this has ended, None if none.
        """
        self.stands = False
        if self.order not in _STANDING:
            return None
        order, self.order, self.unable = self.order, None, frozenset()
        return order

    def sent_on(self, now: float) -> None:
        """The commander orders the held aircraft on: watch until it moves.

        ArduCopter does not end its pause if the commanded mode is the present one.
        """
        self.stands = True
        self._begin(FlightAction.CONTINUE, 1, now)

    # ---- what is seen ---------------------------------------------------------------------------------------------

    def unshown(self, mode: ModeTracker, now: float) -> FlightAction | None:
        """The return or landing that was just ordered, so that it need not show yet.

        None: there is none, or the mode is not known.
        """
        shows_as = _SHOWS_AS.get(self.order) if self.order is not None else None
        self.shows_by = None
        if shows_as is None or mode.flown is None or mode.facts() & shows_as:
            return None
        shows_by = self._commanded_at + self._limits.obey_s
        if now >= shows_by:
            return None
        self.shows_by = shows_by
        return self.order

    def verify(self, mode: ModeTracker, facts: Set[Fact], breached: bool, now: float) -> Seen | None:
        """Compare the aircraft to the order; returns what is new about it.

        `breached`: the aircraft is outside the fence. AGAIN asks for the same command once more.
        """
        self.due_at = None
        if Fact.FLYING not in facts or mode.flown is None:
            return None
        if Fact.AUTOPILOT not in facts:
            self._deaf = True
            return None
        if Fact.PILOT in facts or Fact.FAILSAFE in facts:
            return None
        if self._interrupted is not None:  # the aircraft has been given back
            order, self._interrupted = self._interrupted, None
            self._begin(order, self._tries + 1, now)
            if not self._follows(mode):
                self.due_at = now + self._limits.obey_s
                return Seen.AGAIN
        was_deaf, self._deaf = self._deaf, False
        if self.order is None:
            return None
        if was_deaf:
            self._since = now
        refused, self._refused = self._refused, False
        if refused and not self._is_so(mode):
            return self._denied(self.order, now)
        if not self._follows(mode):
            return self._astray(was_deaf, breached and bool(facts & _COMING_HOME), now)
        return self._moves(self.order, mode, facts, breached, now)

    def _is_so(self, mode: ModeTracker) -> bool:
        """Whether the refused order still shows."""
        assert self.order is not None
        if self.handling.shows[self.order].modes:
            return self._follows(mode)
        return self._motion is not None and self._motion.speed_mps < RESTS_MPS

    def _denied(self, order: FlightAction, now: float) -> Seen | None:
        """The autopilot has refused the order, and the order does not show."""
        if order not in _ENDLESS:
            self.unable |= {order}
            self.order = None
            return Seen.REFUSED
        self._since = min(self._since, now + REFUSED_AGAIN_S - self._limits.obey_s)
        self._has_time(self._limits.obey_s, now)
        return None

    def _again(self, action: FlightAction, now: float) -> Seen:
        self._begin(action, self._tries + 1, now)
        self.due_at = now + self._limits.obey_s
        return Seen.AGAIN

    def _follows(self, mode: ModeTracker) -> bool:
        assert self.order is not None
        modes = self.handling.shows[self.order].modes
        return not modes or mode.flown in modes or (self.order is FlightAction.LAND and mode.landing)

    def _astray(self, was_deaf: bool, home: bool, now: float) -> Seen | None:
        """The mode is not one of the order."""
        order = self.order
        assert order is not None
        if home:
            return None
        if self._shown or was_deaf:  # the mode was left, or no command arrived
            self._tries = 0
            return self._again(order, now)
        if self._has_time(self._limits.obey_s, now):
            return None
        return self._again(order, now) if self._tries < TRIES or order in _ENDLESS else self._give_up(order)

    def _moves(
        self, order: FlightAction, mode: ModeTracker, facts: Set[Fact], breached: bool, now: float
    ) -> Seen | None:
        """The mode is right: check the motion."""
        if not self.handling.shows[order].motion:
            return self._shows(order)
        if order is FlightAction.HOLD:
            return self._rests(now)
        if order is FlightAction.CONTINUE:
            return self._goes_on(bool(facts & _COMING_HOME), now)
        self.stands = False
        motion, was_excused = self._motion, self._excused
        self._excused = motion is None or breached or self._needs_no_progress(order, motion, facts)
        first = not self._shown
        if first:
            self._shown = True
            self._nearest_m = self._last_m = inf if motion is None or motion.left_m is None else motion.left_m
        if first or (was_excused and not self._excused):
            self._since = now
        has_time = self._excused or self._has_time(self._limits.stuck_s, now)
        if first:
            return Seen.OBEYED
        return None if has_time else self._give_up(order)

    def _shows(self, order: FlightAction) -> Seen | None:
        """The mode is the only evidence."""
        first, self._shown = not self._shown, True
        if order is not FlightAction.HOLD:
            self.stands = False
        if order is FlightAction.CONTINUE:
            self.order = None
        return Seen.OBEYED if first else None

    def _rests(self, now: float) -> Seen | None:
        if self._shown or self._motion is None:
            return None
        if self._motion.speed_mps < RESTS_MPS:
            self._shown = True
            return Seen.OBEYED
        return None if self._has_time(self._stops_s, now) else self._give_up(FlightAction.HOLD)

    @property
    def _stops_s(self) -> float:
        """The longest time to come to rest from the speed at the order."""
        return ARRIVES_S + self._first_speed / BRAKES_MPS2

    def _goes_on(self, home: bool, now: float) -> Seen | None:
        # an aircraft that moves may not have come to rest yet
        if self._has_time(max(self._limits.obey_s, self._stops_s), now):
            return None
        motion = self._motion
        moves = motion is None or motion.speed_mps >= RESTS_MPS or abs(motion.climb_mps) > CLIMBS_MPS
        if not moves and not home:
            self._tries = 0  # there is no graver order
            return self._again(FlightAction.CONTINUE, now)
        self.order, self.stands = None, False
        return None if home else Seen.OBEYED

    def _has_time(self, limit_s: float, now: float) -> bool:
        """Whether there is time left; sets `due_at` to its end."""
        ends_at = self._since + limit_s
        if now >= ends_at:
            return False
        self.due_at = ends_at
        return True

    def _needs_no_progress(self, order: FlightAction, motion: MotionSeen, facts: Set[Fact]) -> bool:
        """Whether the aircraft follows the order without getting nearer to its destination."""
        if Fact.LANDING in facts:  # a gust may hold the aircraft up: landing is enough for a return
            return order is FlightAction.RETURN or motion.climb_mps < -CLIMBS_MPS
        # a climb, an unknown destination, or at the destination
        there_m = self.handling.at_place_m
        return motion.climb_mps > CLIMBS_MPS or motion.left_m is None or motion.left_m <= there_m

    def _give_up(self, order: FlightAction) -> Seen | None:
        if order in self.unable:
            return None
        self.unable |= {order}
        if order is not FlightAction.LAND:
            self.order = None
        return Seen.UNABLE

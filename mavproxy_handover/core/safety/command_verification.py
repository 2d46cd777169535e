# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether the autopilot does what was commanded: seen by its mode and by its motion, commanded again, given up.

Theory of operation
-------------------
A command that is acknowledged is not a deed. `FOLLOW` says for each action by which mode it shows, by which motion, and
how long each may take (the limits have the seconds):

* HOLD shows by rest alone: ArduCopter pauses within its mode. Rest takes as long as the speed at the command needs.
* RETURN shows by the mode, then by getting nearer to where RTL flies to, or climbing, which it does first (there it
  flies to a place above itself; one that is suddenly far away is another one). What has not got nearer for `stuck_s`,
  by NEARER_M at least, is blown backwards, or flies somewhere else. At the place (AT_PLACE_M) nothing more is expected:
  it waits, or comes down.
* LAND shows by the mode, then by coming down.
* CONTINUE, which ends a hold, shows by motion alone: what stands still within its mode looks like what flies in it.

That is how a copter shows. What has wings never rests: it holds by circling, in a mode for that, and goes on by leaving
it. Where it flies back to it circles, some way from the place, and what cannot hover lands by a landing sequence: of
that nothing but the mode can be asked. So there is a table of `FOLLOW` for each kind.

What keeps a return or a landing from showing that it gets on, a climb, a breached fence, a place that nobody knows,
keeps its time from running: that begins with the first look behind it. So nothing here depends on how often it is
looked at, and `due_at` says when it has to be, if nothing is said until then.

What does not show in time is commanded again, TRIES times; then the action is one that the autopilot does not follow
(`unable`). The strategy learns that as a fact: it cannot hold, no place can be reached. So it is the table of
`strategy.py` that goes on to the next graver action, and nothing here. Under LAND there is nothing: it is repeated
while another mode shows, and told once where it does not come down in the right one, which to command again is no help.
An order that is decided anew, for another cause, is the same order: causes that take turns give it no more time.

What the autopilot refuses, by a negative answer, is not waited for: a HOLD or a RETURN is `unable` at once, a LAND is
commanded again after REFUSED_AGAIN_S. It counts only for the order in force, once, and not where that order shows all
the same: the aircraft is at rest, or in its mode.

What was held is held until something else shows (`stands`): a return that was ordered behind the hold, and never flown,
has not ended it. Where that is over, the aircraft is to go on, and for what stands still there is nothing graver to
come: CONTINUE, like LAND, is repeated.

Who has taken the aircraft keeps it. A pilot, a failsafe and the commander's own word end the order (`withdrawn`): the
commander's word stands until something new is decided; what a pilot or a failsafe has interrupted is commanded again
while its cause is there, once neither of them has it. A mode that a stranger has chosen is commanded away. While the
autopilot is not heard nothing is counted, and when it is heard again, the order in force is commanded again at once.

While the fence is breached nothing is commanded again and nothing given up of what returns or lands already: a change
of the mode gives ArduCopter's fence ten seconds of "manual recovery", in which a further breach is never acted on.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

from mavproxy_handover.core.common.events import MotionSeen
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, Kind, ModeClass, ModeSource
from mavproxy_handover.core.safety.mode_source import ModeTracker
from mavproxy_handover.core.safety.strategy import Fact

__all__ = [
    "AT_PLACE_M",
    "CIRCLES_THERE_M",
    "FOLLOW",
    "NEARER_M",
    "REFUSED_AGAIN_S",
    "TRIES",
    "Follow",
    "Seen",
    "CommandVerification",
]

#: commanded so often before it is given up
TRIES: Final = 2
#: what counts as nearer (m), as at the place (m; what has wings circles there), as a climb and a descent (m/s), and as
#: rest (m/s)
NEARER_M: Final = 5.0
AT_PLACE_M: Final = 15.0
CIRCLES_THERE_M: Final = 250.0
CLIMBS_MPS: Final = 0.3
RESTS_MPS: Final = 1.0
#: a stop loses at least so much speed each second (m/s2), once the command has arrived (s)
BRAKES_MPS2: Final = 1.25
ARRIVES_S: Final = 2.0
#: a landing that is refused is commanded again after so long (s)
REFUSED_AGAIN_S: Final = 1.0
#: more than it can be blown away from one report to the next (m): it flies to another place now
OTHER_PLACE_M: Final = 50.0

_COMING_HOME: Final = frozenset({Fact.RETURNING, Fact.LANDING})
#: the aircraft is on its way by these, or by more
_SHOWS_AS: Final = {FlightAction.RETURN: _COMING_HOME, FlightAction.LAND: frozenset({Fact.LANDING})}
#: nothing graver is to come behind these
_ENDLESS: Final = (FlightAction.CONTINUE, FlightAction.LAND)
#: the aircraft stands still by these, or is to move again
_STANDING: Final = (FlightAction.HOLD, FlightAction.CONTINUE)


@dataclass(frozen=True, slots=True)
class Follow:
    """How an action shows: the modes of it (none: any), and the name of the motion ("": none is looked at)."""

    modes: frozenset[ModeClass]
    motion: str


#: A landing is more than a return: what cannot return is landed by it.
_COMES_BACK: Final = Follow(frozenset({ModeClass.RETURN, ModeClass.LAND}), "gets nearer to the place, or climbs")
_COMES_DOWN: Final = Follow(frozenset({ModeClass.LAND}), "comes down")
_CIRCLES: Final[Mapping[FlightAction, Follow]] = {
    FlightAction.HOLD: Follow(frozenset({ModeClass.STOP}), ""),
    FlightAction.CONTINUE: Follow(frozenset({ModeClass.MISSION, ModeClass.GUIDED}), ""),
    FlightAction.RETURN: _COMES_BACK,
}
FOLLOW: Final[Mapping[Kind, Mapping[FlightAction, Follow]]] = {
    Kind.COPTER: {
        FlightAction.HOLD: Follow(frozenset(), "comes to rest"),
        FlightAction.CONTINUE: Follow(frozenset(), "moves"),
        FlightAction.RETURN: _COMES_BACK,
        FlightAction.LAND: _COMES_DOWN,
    },
    Kind.QUADPLANE: {**_CIRCLES, FlightAction.LAND: _COMES_DOWN},
    # its landing sequence is a part of a mission, or waits at the end of a return
    Kind.PLANE: {
        **_CIRCLES,
        FlightAction.LAND: Follow(frozenset({ModeClass.LAND, ModeClass.MISSION, ModeClass.RETURN}), ""),
    },
}


class Seen(Enum):
    """What has come of an order."""

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
        "kind",
        "order",
        "stands",
        "unable",
    )

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        #: of the aircraft that is watched
        self.kind = Kind.COPTER
        #: what the autopilot is to do; None: nothing is commanded
        self.order: FlightAction | None = None
        #: what it has been commanded in vain, while something is wrong
        self.unable: frozenset[FlightAction] = frozenset()
        #: it was held, and nothing has shown since that it is not any more
        self.stands = False
        #: since when what is awaited now has been awaited
        self._since = -inf
        #: when the order was given to the autopilot last
        self._commanded_at = -inf
        self._tries = 0
        #: the order has shown by mode, or by rest
        self._shown = False
        #: the autopilot has answered that it does not do it, and that was not looked at yet
        self._refused = False
        #: the return or the landing that a pilot or a failsafe has interrupted
        self._interrupted: FlightAction | None = None
        #: the autopilot is not heard
        self._deaf = False
        #: at the last look there was a reason why it gets no nearer
        self._excused = False
        #: the least distance to the place (m) since the order showed, and the last one
        self._nearest_m = self._last_m = inf
        #: speed (m/s) when the order was given
        self._first_speed = 0.0
        self._motion: MotionSeen | None = None
        #: when the next look is due that nothing else calls for; None: none is
        self.due_at: float | None = None

    # ---- what happens ---------------------------------------------------------------------------------------------

    def moved(self, motion: MotionSeen, now: float) -> None:
        """How the aircraft moves."""
        self._motion = motion
        if self.order is FlightAction.RETURN and self._shown and motion.left_m is not None:
            if motion.left_m <= self._nearest_m - NEARER_M or motion.left_m > self._last_m + OTHER_PLACE_M:
                self._nearest_m, self._since = motion.left_m, now
            self._last_m = motion.left_m

    def unseen(self) -> None:
        """It is not known any more how the aircraft moves: of what needs a motion nothing is concluded."""
        self._motion = None

    def ordered(self, action: FlightAction, now: float) -> None:
        """The autopilot is commanded this from now on, or still: HOLD, RETURN or LAND."""
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

    def watch(self, kind: Kind) -> None:
        """The kind of aircraft that is watched."""
        self.kind = kind

    def refused(self, action: FlightAction) -> None:
        """The autopilot has answered that it does not do this. Another order than the one in force, or one that has
        shown, is not concerned."""
        self._refused |= action is self.order and not self._shown

    def go_on(self, now: float) -> None:
        """It is commanded to go on: what stands still by its order is watched until it does."""
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
        """Nothing is wrong any more, or the flight is over: the next order begins anew."""
        self.order = self._interrupted = None
        self.stands = False
        self.unable = frozenset()

    def taken(self, hand: ModeSource) -> FlightAction | None:
        """Somebody else has chosen the mode; returns the order that this has ended, None if none."""
        order, self.order = self.order, None
        self.stands = False
        if hand is ModeSource.COMMANDER:  # what it could not do then it may be able to do where he flies it
            order, self._interrupted, self.unable = order or self._interrupted, None, frozenset()
        elif order is not None and order not in _STANDING:  # a hold that may be again is a decision of its own
            self._interrupted = order
        return order

    def commanded(self) -> FlightAction | None:
        """The commander has said how it flies: whether it stands or moves now, it does so by that word. Returns the
        order that this has ended, None if none."""
        self.stands = False
        if self.order not in _STANDING:
            return None
        order, self.order, self.unable = self.order, None, frozenset()
        return order

    def sent_on(self, now: float) -> None:
        """The commander has what stood by an order fly on: watched until it does, as a mode that it is in already ends
        no pause of ArduCopter."""
        self.stands = True
        self._begin(FlightAction.CONTINUE, 1, now)

    # ---- what is seen ---------------------------------------------------------------------------------------------

    def unshown(self, mode: ModeTracker, now: float) -> FlightAction | None:
        """The return or the landing that was ordered so lately that the autopilot need not show it yet; None: there is
        none, or it is not known what is flown."""
        shows_as = _SHOWS_AS.get(self.order) if self.order is not None else None
        if shows_as is None or mode.flown is None or mode.facts() & shows_as:
            return None
        return self.order if now < self._commanded_at + self._limits.obey_s else None

    def look(self, mode: ModeTracker, facts: Set[Fact], breached: bool, now: float) -> Seen | None:
        """Compare what the autopilot does to the order; what is news about it.

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
        if self._interrupted is not None:  # it has been given back
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
        """The order shows all the same."""
        assert self.order is not None
        if FOLLOW[self.kind][self.order].modes:
            return self._follows(mode)
        return self._motion is not None and self._motion.speed_mps < RESTS_MPS

    def _denied(self, order: FlightAction, now: float) -> Seen | None:
        """The autopilot has refused it, and it is not so."""
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
        modes = FOLLOW[self.kind][self.order].modes
        return not modes or mode.flown in modes or (self.order is FlightAction.LAND and mode.landing)

    def _astray(self, was_deaf: bool, home: bool, now: float) -> Seen | None:
        """The mode is another one."""
        order = self.order
        assert order is not None
        if home:
            return None
        if self._shown or was_deaf:  # it was left, or nothing arrived
            self._tries = 0
            return self._again(order, now)
        if self._has_time(self._limits.obey_s, now):
            return None
        return self._again(order, now) if self._tries < TRIES or order in _ENDLESS else self._give_up(order)

    def _moves(
        self, order: FlightAction, mode: ModeTracker, facts: Set[Fact], breached: bool, now: float
    ) -> Seen | None:
        """The mode is right: what of the motion?"""
        if not FOLLOW[self.kind][order].motion:
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
        """The mode is all that there is to be seen."""
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
        """So long it takes at most to come to rest from the speed that it had when the order was given."""
        return ARRIVES_S + self._first_speed / BRAKES_MPS2

    def _goes_on(self, home: bool, now: float) -> Seen | None:
        # what still moves may not have come to rest yet
        if self._has_time(max(self._limits.obey_s, self._stops_s), now):
            return None
        motion = self._motion
        moves = motion is None or motion.speed_mps >= RESTS_MPS or abs(motion.climb_mps) > CLIMBS_MPS
        if not moves and not home:
            self._tries = 0  # nothing graver is to come
            return self._again(FlightAction.CONTINUE, now)
        self.order, self.stands = None, False
        return None if home else Seen.OBEYED

    def _has_time(self, limit_s: float, now: float) -> bool:
        """What is awaited may still come; until then."""
        ends_at = self._since + limit_s
        if now >= ends_at:
            return False
        self.due_at = ends_at
        return True

    def _needs_no_progress(self, order: FlightAction, motion: MotionSeen, facts: Set[Fact]) -> bool:
        """Whether it does what was commanded without getting nearer to the place."""
        if Fact.LANDING in facts:  # a gust may hold it up: that it lands is enough for a return
            return order is FlightAction.RETURN or motion.climb_mps < -CLIMBS_MPS
        # it climbs, or it is not known where to, or it is there
        there_m = CIRCLES_THERE_M if self.kind.winged else AT_PLACE_M
        return motion.climb_mps > CLIMBS_MPS or motion.left_m is None or motion.left_m <= there_m

    def _give_up(self, order: FlightAction) -> Seen | None:
        if order in self.unable:
            return None
        self.unable |= {order}
        if order is not FlightAction.LAND:
            self.order = None
        return Seen.UNABLE

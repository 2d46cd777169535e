# SPDX-License-Identifier: GPL-3.0-or-later

"""Who flies: what the autopilot's mode says, and who chose it.

Theory of operation
-------------------
ArduPilot tells its mode and not who chose it. So whoever may have is noted beforehand: the companion's own orders, the
commander's commands that pass, the guard when it says that it acts, and the autopilot's own words: of a failsafe
(STATUSTEXT, the state CRITICAL), of one that is over and gives back the mode of before, and, with wings, of a mission
that ends with a return, which is a mode of its own there. A mode that changes in flight is his of `EVIDENCE` who was
heard of last, shortly before or up to DOUBT_S behind it: a word may come after its deed. Until then it is in doubt, and
nobody is fought.
A mode shows up to a second after the command for it. An order that the companion gives in that second is newer than
the commander's command: such a mode is `OVERTAKEN`, and ends no order.
What nobody is known to have chosen is

* the guard's, if it returns or lands and was chosen while the autopilot was not heard: then the autopilot hears nothing
  of the companion either, and the guard sends it home;
* else the pilot's while the radio lives: the autopilot hears a receiver, is not in its radio failsafe, and has one;
* else a failsafe's, if it returns or lands, or has said of late that it acts: one of the estimator's hovers by hand;
* else a stranger's, of whom nobody knows anything: it counts for nothing, as at the guard.

What cannot be told apart, and how it is read: a failsafe whose words were lost, and a pilot (either way nothing is
commanded); a pilot's switch soon after a command to the same mode, and that command (the mode is what both wanted); RC
overrides of the commander that turn the mode switch, and a pilot's (while they last nothing is commanded, and the
autopilot's radio failsafe follows when they end); a second computer on board, and nobody at all.

A pilot has the aircraft while it flies by hand, or in a mode that he chose, and his radio lives. He gives it back by
choosing AUTO or GUIDED after he has flown by hand since take-off, be it for one moment on the way of a switch, or while
the autopilot was not heard, for all that is known; by landing; and by what a commander's accepted command or the
companion's own order makes of the mode. No cause ends it, a new one neither. On the ground nobody flies: whatever is
chosen there is the flight's beginning, unless it is flown by hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

from mavproxy_handover.core.common.events import ModeSeen, ModeSourceSeen
from mavproxy_handover.core.common.model import ModeClass, ModeSource
from mavproxy_handover.core.safety.strategy import Fact

__all__ = ["DOUBT_S", "EVIDENCE", "GIVES_BACK", "Change", "ModeTracker", "Trace"]

#: so long (s) behind a change of the mode a word may explain it: the guard speaks twice a second
DOUBT_S: Final = 1.0

_ENDS: Final = frozenset({ModeClass.RETURN, ModeClass.LAND})
#: what a failsafe has chosen and nobody else leaves; its stop waits for what comes behind it
_OF_FAILSAFES: Final = _ENDS | {ModeClass.HANDS}


@dataclass(frozen=True, slots=True)
class Trace:
    """What somebody who was heard of may have done: for so long (s), and which modes, where none was named."""

    within_s: float
    modes: frozenset[ModeClass]


#: Who may have chosen a mode; of two who were heard of at once the first. The companion's orders are repeated, and RTL
#: that cannot be had becomes LAND within one of them; a command of the commander is carried out or it is not.
EVIDENCE: Final[Mapping[ModeSource, Trace]] = {
    ModeSource.COMPANION: Trace(15.0, _ENDS),
    ModeSource.COMMANDER: Trace(5.0, frozenset(ModeClass)),
    ModeSource.GUARD: Trace(5.0, _ENDS),
    ModeSource.FAILSAFE: Trace(5.0, _ENDS | {ModeClass.STOP}),
    ModeSource.MISSION: Trace(5.0, frozenset({ModeClass.RETURN})),
}

#: What a pilot chooses after he has flown by hand, and that gives the aircraft back.
GIVES_BACK: Final = frozenset({ModeClass.MISSION, ModeClass.GUIDED})


class Change(Enum):
    """What became of a mode that changed."""

    PILOT = "a pilot has taken over"
    GIVEN_BACK = "the pilot has given it back"
    COMMANDER = "the commander has chosen another mode"
    OVERTAKEN = "the commander asked for it before the order"
    FAILSAFE = "a failsafe of the autopilot acts"
    MISSION = "the mission ends with it"
    GUARD = "the guard acts"
    UNHEARD = "chosen while the autopilot was not heard"
    STRANGER = "nobody is known to have chosen the mode"


_CHANGES: Final = {
    ModeSource.PILOT: Change.PILOT,
    ModeSource.COMMANDER: Change.COMMANDER,
    ModeSource.FAILSAFE: Change.FAILSAFE,
    ModeSource.MISSION: Change.MISSION,
    ModeSource.GUARD: Change.GUARD,
    ModeSource.STRANGER: Change.STRANGER,
}


class ModeTracker:
    """Who flies one aircraft. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_asked",
        "_before",
        "_flying",
        "_overtaken",
        "_since",
        "_unheard",
        "chosen_by",
        "flown",
        "landing",
        "name",
        "radio",
    )

    def __init__(self) -> None:
        #: None before the autopilot has said it, and for what is no ArduCopter
        self.flown: ModeClass | None = None
        #: the mode's own name, for people
        self.name = ""
        #: it is coming down to land, whatever the mode is called
        self.landing = False
        #: a pilot could steer
        self.radio = False
        self.chosen_by = ModeSource.NOBODY
        #: who flew what before the mode changed
        self._before: tuple[ModeSource, ModeClass | None] = ModeSource.NOBODY, None
        self._flying = False
        #: the mode that is in doubt was chosen while the autopilot was not heard
        self._unheard = False
        #: when the mode changed, while it is in doubt who chose it; -inf when it is not
        self._since = -inf
        #: the companion has given an order since the commander's last command
        self._overtaken = False
        #: who was heard of, when, and the mode that was asked for, None if that is not known
        self._asked: dict[ModeSource, tuple[float, ModeClass | None]] = {}

    # ---- what is heard --------------------------------------------------------------------------------------------

    def heard(self, event: ModeSourceSeen, now: float) -> Change | None:
        """Somebody has, or may have, chosen the mode."""
        self._asked[event.hand] = now, event.flown
        if event.hand is ModeSource.COMMANDER:
            self._overtaken = False
        return self.settle(now)

    def ordered(self) -> None:
        """The companion orders something: what the commander asked for before is not his answer to that."""
        self._overtaken = True

    def seen(self, event: ModeSeen, flying: bool, now: float, *, unheard: bool = False) -> Change | None:
        """The autopilot has said its mode; returns what has become known by it. `unheard`: it was not heard for a time
        before."""
        before, self.flown = self.flown, event.flown
        self.name, self.landing, self.radio = event.name, event.landing, event.radio
        was_flying, self._flying = self._flying, flying
        if not flying or not was_flying or before is None:
            self.chosen_by, self._since = ModeSource.NOBODY, -inf
        elif event.flown is not before:
            self._before = self.chosen_by, before
            self.chosen_by, self._since, self._unheard = ModeSource.DOUBT, now, unheard
        return self.settle(now)

    def settle(self, now: float) -> Change | None:
        """Who chose the mode that changed, if that is known by now; None if it was known before, or is not yet."""
        if self.chosen_by is not ModeSource.DOUBT:
            return None
        hand = self._by_evidence()
        if hand is None:
            if now < self._since + DOUBT_S:
                return None
            if self._unheard and self.flown in _ENDS:
                self.chosen_by, self._since, self._unheard = ModeSource.GUARD, -inf, False
                return Change.UNHEARD
            hand = self._by_nobody()
        before, flown = self._before
        by_hand = flown is ModeClass.HANDS and before in (ModeSource.PILOT, ModeSource.NOBODY, ModeSource.DOUBT)
        by_hand |= self._unheard
        self._since, self._unheard = -inf, False
        if hand is ModeSource.PILOT and by_hand and self.flown in GIVES_BACK:
            self.chosen_by = ModeSource.NOBODY
            return Change.GIVEN_BACK
        self.chosen_by = hand
        if hand is ModeSource.COMMANDER and self._overtaken:
            return Change.OVERTAKEN
        return _CHANGES.get(hand)

    def _by_evidence(self) -> ModeSource | None:
        latest, found = -inf, None
        for hand, trace in EVIDENCE.items():
            at, flown = self._asked.get(hand, (-inf, None))
            fits = self.flown in trace.modes if flown is None else self.flown is flown
            if fits and at >= self._since - trace.within_s and at > latest:
                latest, found = at, hand
        return found

    def _by_nobody(self) -> ModeSource:
        if self.radio:
            return ModeSource.PILOT
        spoken_at, flown = self._asked.get(ModeSource.FAILSAFE, (-inf, None))
        spoke = flown is None and spoken_at >= self._since - EVIDENCE[ModeSource.FAILSAFE].within_s
        acts = self.flown in _ENDS or (spoke and self.flown is ModeClass.HANDS)
        return ModeSource.FAILSAFE if acts else ModeSource.STRANGER

    # ---- what it comes to -----------------------------------------------------------------------------------------

    @property
    def piloted(self) -> bool:
        """A pilot has the aircraft, or may have."""
        if self.chosen_by is ModeSource.DOUBT:
            return True
        by_hand = self.chosen_by is ModeSource.NOBODY and self.flown is ModeClass.HANDS
        return self.radio and (by_hand or self.chosen_by is ModeSource.PILOT)

    def facts(self) -> set[Fact]:
        """What of it a decision rests on."""
        found = set()
        if self.piloted:
            found.add(Fact.PILOT)
        if self.chosen_by is ModeSource.FAILSAFE and self.flown in _OF_FAILSAFES:
            found.add(Fact.FAILSAFE)
        if self.landing or self.flown is ModeClass.LAND:
            found.add(Fact.LANDING)
        elif self.flown is ModeClass.RETURN:
            found.add(Fact.RETURNING)
        return found

    def due_at(self) -> float | None:
        """When it is no more in doubt who chose the mode; None while it is not."""
        return self._since + DOUBT_S if self.chosen_by is ModeSource.DOUBT else None

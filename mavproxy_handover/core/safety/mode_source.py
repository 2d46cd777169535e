# SPDX-License-Identifier: GPL-3.0-or-later

"""Source of the flight mode: the person or program that chose it, and what follows for decisions.

Theory of operation
-------------------
ArduPilot reports its mode, and not the source that chose it. So the rules note every source that may have chosen one:

* the companion's own orders, and the commander's commands that pass;
* the guard, when it says that it acts;
* the autopilot's own reports: a failsafe (STATUSTEXT, the state CRITICAL), and the end of a failsafe that restores the
  mode of before. With wings also the end of a mission with a return, which is a mode of its own there.

A mode change is attributed to the latest plausible source of `EVIDENCE`: a report shortly before the change, or up to
DOUBT_S after it. Until then the source is in doubt, and nothing is commanded against it.
A mode shows up to a second after the command for it. An order of the companion in that second is newer than the
commander's command: such a mode is `OVERTAKEN`, and ends no order.
A mode change without evidence is attributed as follows:

* To the guard, if the mode returns or lands and was chosen while the autopilot was not heard. Then the autopilot does
  not hear the companion either, and the guard sends it home.
* Else to the pilot while the radio works: there is a receiver, the autopilot hears it, and is not in radio failsafe.
* Else to a failsafe, if the mode returns or lands, or if the autopilot has just said that a failsafe acts. The
  estimator's failsafe hovers by hand.
* Else to an unknown source, which has no effect. The guard does the same.

Some cases look alike, and are read like this:

* A failsafe whose report was lost, and a pilot: nothing is commanded in both cases.
* A pilot's switch soon after a command to the same mode, and that command: both wanted that mode.
* RC overrides of the commander that turn the mode switch, and a pilot. While they last, nothing is commanded. When they
  end, the autopilot's radio failsafe follows.
* A second computer on board, and no source at all.

A pilot has the aircraft while it flies by hand, or in a mode that the pilot chose, and the radio works. The pilot gives
it back

* by choosing AUTO or GUIDED after flying by hand since take-off. One moment by hand during a switch is enough. A time
  in which the autopilot was not heard counts as flying by hand, because it is not known;
* by landing;
* if an accepted command of the commander, or an order of the companion, changes the mode.

No cause takes the aircraft from a pilot, and neither does a new cause. On the ground no source counts: a mode that is
chosen there is the beginning of the flight, unless it is flown by hand.
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

#: time after a mode change in which a report may explain it (s): the guard reports twice a second
DOUBT_S: Final = 1.0

_ENDS: Final = frozenset({ModeClass.RETURN, ModeClass.LAND})
#: modes of a failsafe in which nothing is commanded; its stop is followed by another mode
_OF_FAILSAFES: Final = _ENDS | {ModeClass.HANDS}


@dataclass(frozen=True, slots=True)
class Trace:
    """Reach of a report: how long it may explain a mode change (s), and which modes, if it names none."""

    within_s: float
    modes: frozenset[ModeClass]


#: Sources that may have chosen a mode; of two at the same time the first counts. The companion repeats its orders, and
#: ArduPilot replaces an impossible RTL by LAND within one of them. A command of the commander is carried out or
#: refused.
EVIDENCE: Final[Mapping[ModeSource, Trace]] = {
    ModeSource.COMPANION: Trace(15.0, _ENDS),
    ModeSource.COMMANDER: Trace(5.0, frozenset(ModeClass)),
    ModeSource.GUARD: Trace(5.0, _ENDS),
    ModeSource.FAILSAFE: Trace(5.0, _ENDS | {ModeClass.STOP}),
    ModeSource.MISSION: Trace(5.0, frozenset({ModeClass.RETURN})),
}

#: Modes that give the aircraft back if a pilot chooses them after flying by hand.
GIVES_BACK: Final = frozenset({ModeClass.MISSION, ModeClass.GUIDED})


class Change(Enum):
    """Attribution of a mode change."""

    PILOT = "a pilot has taken over"
    GIVEN_BACK = "the pilot has given it back"
    COMMANDER = "the commander has chosen another mode"
    OVERTAKEN = "the commander asked for it before the order"
    FAILSAFE = "a failsafe of the autopilot acts"
    MISSION = "the mission ends with it"
    GUARD = "the guard acts"
    UNHEARD = "chosen while the autopilot was not heard"
    STRANGER = "the source of the mode is not known"


_CHANGES: Final = {
    ModeSource.PILOT: Change.PILOT,
    ModeSource.COMMANDER: Change.COMMANDER,
    ModeSource.FAILSAFE: Change.FAILSAFE,
    ModeSource.MISSION: Change.MISSION,
    ModeSource.GUARD: Change.GUARD,
    ModeSource.STRANGER: Change.STRANGER,
}


class ModeTracker:
    """Tracks the mode of one aircraft and its source. Times are monotonic seconds; not safe for threads."""

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
        #: class of the mode; None: not reported yet, or not supported
        self.flown: ModeClass | None = None
        #: the mode's own name, for people
        self.name = ""
        #: the aircraft is coming down to land, in any mode
        self.landing = False
        #: a pilot could steer
        self.radio = False
        self.chosen_by = ModeSource.NOBODY
        #: source and class of the mode before the change
        self._before: tuple[ModeSource, ModeClass | None] = ModeSource.NOBODY, None
        self._flying = False
        #: the mode in doubt was chosen while the autopilot was not heard
        self._unheard = False
        #: when the mode changed, while its source is in doubt; -inf: no doubt
        self._since = -inf
        #: the companion has given an order since the commander's last command
        self._overtaken = False
        #: source -> time of its last report, and the class of the mode that it asked for, None: not known
        self._asked: dict[ModeSource, tuple[float, ModeClass | None]] = {}

    # ---- what is heard --------------------------------------------------------------------------------------------

    def note_source(self, event: ModeSourceSeen, now: float) -> Change | None:
        """A source has, or may have, chosen the mode."""
        self._asked[event.hand] = now, event.flown
        if event.hand is ModeSource.COMMANDER:
            self._overtaken = False
        return self.resolve_doubt(now)

    def ordered(self) -> None:
        """The companion gives an order: an earlier command of the commander does not answer it."""
        self._overtaken = True

    def seen(self, event: ModeSeen, flying: bool, now: float, *, unheard: bool = False) -> Change | None:
        """The autopilot reports its mode; returns a change that is attributed by now.

        `unheard`: the autopilot was not heard for a time before.
        """
        before, self.flown = self.flown, event.flown
        self.name, self.landing, self.radio = event.name, event.landing, event.radio
        was_flying, self._flying = self._flying, flying
        if not flying or not was_flying or before is None:
            self.chosen_by, self._since = ModeSource.NOBODY, -inf
        elif event.flown is not before:
            self._before = self.chosen_by, before
            self.chosen_by, self._since, self._unheard = ModeSource.DOUBT, now, unheard
        return self.resolve_doubt(now)

    def resolve_doubt(self, now: float) -> Change | None:
        """Attribute a mode change in doubt, if that is possible by now; None: nothing is new."""
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
        """Whether a pilot has the aircraft, or may have it."""
        if self.chosen_by is ModeSource.DOUBT:
            return True
        by_hand = self.chosen_by is ModeSource.NOBODY and self.flown is ModeClass.HANDS
        return self.radio and (by_hand or self.chosen_by is ModeSource.PILOT)

    def facts(self) -> set[Fact]:
        """Facts of the mode that a decision rests on."""
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
        """When the doubt about the source ends; None without a doubt."""
        return self._since + DOUBT_S if self.chosen_by is ModeSource.DOUBT else None

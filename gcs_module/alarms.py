# SPDX-License-Identifier: GPL-3.0-or-later

"""How grave is what an operator is told, how he notices it, and what is said again until he has.

Theory of operation
-------------------
Every line has a level, from one table: EVENTS by what it is about, DECISIONS by what is done about what is wrong. The
level alone says how the line looks and sounds (LOOKS): colour, bell of the terminal, speech, and after how long it is
said again.

An alarm is a line that stays true: nobody commands, the aircraft comes home, the vehicle is not heard, a question
waits. It is raised under a name, said again while it stands, and silenced by `handover ack`, by its end, or by another
line under its name. What has been acknowledged stays shown in `handover status` until it is over; if it becomes graver,
it is said anew.

Pure: time is an argument.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from math import inf
from typing import Final

from mavproxy_handover.core.common.model import FlightAction

__all__ = ["DECISIONS", "ENDS", "EVENTS", "LOOKS", "STANDS", "Alarm", "Alarms", "Level", "Look"]


class Level(IntEnum):
    """How grave it is; the higher the graver."""

    INFO = 0
    #: to be known: nothing has to be done at once
    ADVISORY = 1
    #: something is about to go wrong, or waits for the operator
    WARNING = 2
    #: the aircraft is not where its mission has it, or nobody commands it
    EMERGENCY = 3


@dataclass(frozen=True, slots=True)
class Look:
    """How a level is noticed: colours of MAVProxy's console, bell, speech, and after how long (s) an alarm is said
    again."""

    colour: str
    ground: str
    bell: bool
    spoken: bool
    again_s: float


LOOKS: Final[Mapping[Level, Look]] = {
    Level.INFO: Look("black", "white", False, False, inf),
    Level.ADVISORY: Look("blue", "white", False, True, inf),
    Level.WARNING: Look("black", "orange", True, True, 30.0),
    Level.EMERGENCY: Look("white", "red", True, True, 10.0),
}

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level

#: what a line is about, and how grave that is
EVENTS: Final[Mapping[str, Level]] = {
    "connected": _INFO,
    "address": _ADVISORY,
    "lost": _WARNING,
    "authority": _INFO,
    "control_gained": _ADVISORY,
    "control_lost": _ADVISORY,
    "no_commander": _EMERGENCY,
    "phase": _INFO,
    "requested": _WARNING,
    "announced": _ADVISORY,
    "asked": _WARNING,
    "ahead": _INFO,
    "consent": _INFO,
    "told": _INFO,
    "set_up": _INFO,
    "released": _INFO,
    "aborted": _ADVISORY,
    "question": _ADVISORY,
    "countdown": _WARNING,
    "named": _ADVISORY,
    "peer": _INFO,
    "peer_lost": _ADVISORY,
    "zone_left": _ADVISORY,
    "zone_ends": _ADVISORY,
    "rerouted": _ADVISORY,
    "off_route": _WARNING,
    "on_route": _INFO,
    "decision": _EMERGENCY,
    "decision_over": _ADVISORY,
    "text": _INFO,
    "stream": _WARNING,
}

#: what stays true behind such a line: the name of its alarm, and the lines behind which it is true no more
STANDS: Final[Mapping[str, str]] = {
    "lost": "link",
    "no_commander": "commander",
    "requested": "question",
    "asked": "question",
    "decision": "decision",
    "off_route": "route",
}
ENDS: Final[Mapping[str, str]] = {
    "connected": "link",
    "authority": "commander",
    "control_gained": "commander",
    "control_lost": "commander",
    "consent": "question",
    "set_up": "question",
    "aborted": "question",
    "decision_over": "decision",
    "on_route": "route",
    "rerouted": "route",
}

#: what is done about what is wrong
DECISIONS: Final[Mapping[FlightAction, Level]] = {
    FlightAction.WARN: _ADVISORY,
    FlightAction.TRANSFER: _ADVISORY,
    FlightAction.CONTINUE: _WARNING,
    FlightAction.HOLD: _WARNING,
    FlightAction.RETURN: _EMERGENCY,
    FlightAction.LAND: _EMERGENCY,
}


@dataclass(slots=True)
class Alarm:
    """One that stands. `again_at`: monotonic seconds; inf once it is acknowledged, or said once only."""

    level: Level
    text: str
    again_at: float
    acknowledged: bool


class Alarms:
    """What stands for one vehicle, by name. Times are monotonic seconds; not safe for threads."""

    def __init__(self) -> None:
        self._standing: dict[str, Alarm] = {}

    @property
    def standing(self) -> tuple[Alarm, ...]:
        """All of them, the gravest first."""
        return tuple(sorted(self._standing.values(), key=lambda alarm: -alarm.level))

    def begin(self, name: str, level: Level, text: str, now: float) -> None:
        """It is so from now on. Who has acknowledged it as grave as it is now is not told again."""
        known = self._standing.get(name)
        quiet = known is not None and known.acknowledged and level <= known.level
        self._standing[name] = Alarm(level, text, inf if quiet else now + LOOKS[level].again_s, quiet)

    def heard(self, event: str, level: Level, text: str, now: float) -> None:
        """A line of this kind was told: what stands or ends with it."""
        self.end(ENDS.get(event, ""))
        if event in STANDS:
            self.begin(STANDS[event], level, text, now)

    def end(self, name: str) -> None:
        """It is so no more."""
        self._standing.pop(name, None)

    def due(self, now: float) -> tuple[Alarm, ...]:
        """Those that are to be said again now, the gravest first; they count as said."""
        found = tuple(alarm for alarm in self.standing if now >= alarm.again_at)
        for alarm in found:
            alarm.again_at = now + LOOKS[alarm.level].again_s
        return found

    def acknowledge(self) -> tuple[Alarm, ...]:
        """The operator has noticed everything that stands; returns what that silences."""
        loud = tuple(alarm for alarm in self.standing if not alarm.acknowledged)
        for alarm in loud:
            alarm.again_at, alarm.acknowledged = inf, True
        return loud

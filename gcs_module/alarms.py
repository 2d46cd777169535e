# SPDX-License-Identifier: GPL-3.0-or-later

"""The levels of lines to the operator, how each level looks and sounds, and the alarms that are repeated.

Theory of operation
-------------------
Every line has a level, from a table: EVENTS by the kind of line, DECISIONS by the vehicle's action (the vehicle's own
table, `core/common/levels.py`). The level alone
decides how the line looks and sounds (LOOKS): colour, terminal bell, speech, and the interval at which it is repeated.

An alarm is a line that stays true: no station commands, the aircraft returns, the vehicle is not heard, a question
waits. It is raised under a name and repeated while it stands. `handover ack`, its end, or another line under its name
silences it. An acknowledged alarm stays in `handover status` until it is over; if its level rises, it is told again.

Pure: time is an argument.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.core.common.levels import DECISION_LEVELS, Level
from mavproxy_handover.core.common.model import FlightAction

__all__ = ["DECISIONS", "ENDS", "EVENTS", "LOOKS", "STANDS", "Alarm", "Alarms", "Level", "Look"]


@dataclass(frozen=True, slots=True)
class Look:
    """How a level is shown.

    Colours of MAVProxy's console, bell, speech, and the interval (s) at which an alarm is repeated.
    """

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

#: kind of line -> its level
EVENTS: Final[Mapping[str, Level]] = {
    "connected": _INFO,
    "address": _ADVISORY,
    "lost": _WARNING,
    "authority": _INFO,
    "manager": _ADVISORY,
    "managers": _WARNING,
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
    "program": _INFO,
    "program_lost": _EMERGENCY,
    "zone_left": _ADVISORY,
    "zone_ends": _ADVISORY,
    "rerouted": _ADVISORY,
    "off_route": _WARNING,
    "on_route": _INFO,
    "decision": _EMERGENCY,
    "decision_over": DECISION_LEVELS[None],
    "text": _INFO,
    "stream": _WARNING,
}

#: kind of line -> the alarm that it raises (STANDS), or ends (ENDS)
STANDS: Final[Mapping[str, str]] = {
    "lost": "link",
    "no_commander": "commander",
    "requested": "question",
    "asked": "question",
    "decision": "decision",
    "off_route": "route",
    "program_lost": "program",
    "managers": "manager",
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
    "program": "program",
    "manager": "manager",
}

#: the vehicle's action -> the level of its line: the one table of them
DECISIONS: Final[Mapping[FlightAction, Level]] = {
    action: level for action, level in DECISION_LEVELS.items() if action is not None
}


@dataclass(slots=True)
class Alarm:
    """A standing alarm. `again_at`: time of the next repetition (monotonic s); inf after it is acknowledged, or for a
    level that is told only once. `row`: of `notices.NOTICES`, "" if its line is not from there; `since`: when its text
    was first told."""

    level: Level
    text: str
    again_at: float
    acknowledged: bool
    name: str = ""
    row: str = ""
    since: float = 0.0


class Alarms:
    """The standing alarms of one vehicle, by name. Times are monotonic seconds; not safe for threads."""

    def __init__(self) -> None:
        self._standing: dict[str, Alarm] = {}

    @property
    def standing(self) -> tuple[Alarm, ...]:
        """All of them, the most serious first."""
        return tuple(sorted(self._standing.values(), key=lambda alarm: -alarm.level))

    def begin(self, name: str, level: Level, text: str, now: float, row: str = "") -> None:
        """Raise an alarm. If it was acknowledged at this level or a higher one, it stays silent."""
        known = self._standing.get(name)
        quiet = known is not None and known.acknowledged and level <= known.level
        since = known.since if known is not None and known.text == text else now
        again_at = inf if quiet else now + LOOKS[level].again_s
        self._standing[name] = Alarm(level, text, again_at, quiet, name, row, since)

    def on_line(self, event: str, level: Level, text: str, now: float, row: str = "") -> None:
        """A line of this kind was told: raise or end the alarm that belongs to it."""
        self.end(ENDS.get(event, ""))
        if event in STANDS:
            self.begin(STANDS[event], level, text, now, row)

    def end(self, name: str) -> None:
        """End an alarm."""
        self._standing.pop(name, None)

    def due(self, now: float) -> tuple[Alarm, ...]:
        """The alarms to repeat now, the most serious first; their next repetition is set."""
        found = tuple(alarm for alarm in self.standing if now >= alarm.again_at)
        for alarm in found:
            alarm.again_at = now + LOOKS[alarm.level].again_s
        return found

    def acknowledge(self) -> tuple[Alarm, ...]:
        """The operator has noticed all standing alarms; returns those that this silences."""
        loud = tuple(alarm for alarm in self.standing if not alarm.acknowledged)
        for alarm in loud:
            alarm.again_at, alarm.acknowledged = inf, True
        return loud

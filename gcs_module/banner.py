# SPDX-License-Identifier: GPL-3.0-or-later

"""The first words of the console's status row: which station commands, and what is going on. Pure.

Mode, phase and age are combined: a vehicle that is not heard is not shown as flying its mission, and neither is an
aircraft in RTL.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from gcs_module.alarms import Level
from mavproxy_handover.core.common.model import FlightAction, Phase

__all__ = ["OLD_S", "Situation", "age", "banner", "named", "tag"]

#: a value older than this (s) is marked as old
OLD_S: Final = 3.0
#: the modes in which the mission is flown, and the phases in which it should be
_MISSION_MODES: Final = ("AUTO", "")
_ON_MISSION: Final = (Phase.ON_MISSION, Phase.ON_HANDOVER)


@dataclass(frozen=True, slots=True)
class Situation:
    """A station's knowledge of a vehicle at one moment. Names of stations are "" if there is none.

    `heard_s`: time since the vehicle was heard, inf: never; `mode`: of the autopilot, "" not known or too old;
    `action`: what the vehicle does about what is wrong; `left_s`: time left for an operator who is asked, inf: none is;
    `alone`: no station commands, because the mission declares a gap there; `ahead`: the station that is to take the
    aircraft at the border ahead, `ahead_s`: in how many seconds, `asked`: this station's operator is asked early; `of`:
    the vehicle's name, "" if the station has no other one; `rehearsal`: the aircraft is carried, and nothing is
    commanded.
    """

    vehicle: str
    phase: Phase = Phase.ON_LOAD
    commander: str = ""
    own: bool = False
    partner: str = ""
    mode: str = ""
    heard_s: float = inf
    action: FlightAction | None = None
    left_s: float = inf
    alone: bool = False
    ahead: str = ""
    ahead_s: float = inf
    asked: bool = False
    of: str = ""
    rehearsal: bool = False

    @property
    def old(self) -> bool:
        """Whether the values are older than OLD_S."""
        return self.heard_s > OLD_S


def age(seconds: float) -> str:
    """The age of a value, for people; "" if it is fresh."""
    if seconds <= OLD_S:
        return ""
    if seconds < 120.0:
        return f"{seconds:.0f} s old"
    return f"{seconds / 60.0:.0f} min old" if seconds < inf else "never heard"


def banner(now: Situation) -> tuple[str, Level]:
    """The text of the status row, and its level."""
    words, level = _banner(now)
    if now.rehearsal and not now.old:
        words, level = f"REHEARSAL - {words}", max(level, Level.ADVISORY)
    return named(now.of, words), level


def named(name: str, text: str) -> str:
    """A text with the vehicle's name before it, unless the text contains the name."""
    return text if name in text else f"{name}: {text}"


def _banner(now: Situation) -> tuple[str, Level]:
    if now.heard_s == inf:
        return f"{now.vehicle}: NOT HEARD YET", Level.INFO
    if now.old:
        return f"{now.vehicle}: NOT HEARD FOR {now.heard_s:.0f} s", Level.WARNING
    flying = now.phase is not Phase.ON_LOAD
    mode = f" - {now.mode}" if now.mode else ""
    if not now.commander and now.alone:
        return f"ALONE IN A DECLARED GAP{mode}", Level.ADVISORY
    if not now.commander:
        return (f"NO COMMANDER{mode}", Level.EMERGENCY) if flying else ("NO COMMANDER", Level.INFO)
    control = f"CONTROL: {now.commander}{' (you)' if now.own else ''}"
    if now.action is not None and now.action >= FlightAction.RETURN:
        return f"{control}{mode or ' - ' + now.action.name}", Level.EMERGENCY
    if now.partner:
        left = "" if now.left_s == inf else f" {max(0.0, now.left_s):.0f} s"
        return f"HANDOVER -> {now.partner}{left}", Level.WARNING
    if now.action is not None and now.action is not FlightAction.WARN:
        return f"{control} - {now.action.name}", Level.WARNING
    if now.ahead:
        words = f"{control} - {now.ahead} IN {max(0.0, now.ahead_s):.0f} s"
        return (f"{words}: ACCEPT?", Level.WARNING) if now.asked else (words, Level.INFO)
    return f"{control}{mode if flying and now.mode not in _MISSION_MODES else ''}", Level.INFO


def tag(now: Situation) -> str:
    """The words in brackets before each line, in the form of the thesis.

    "ONMISSION", "ONMISSION RTL", "ONMISSION 12 s old"; with several vehicles "drone-2 ONMISSION".
    """
    words = f"{now.of} {now.phase.name.replace('_', '')}".lstrip()
    if now.phase in _ON_MISSION and now.mode not in _MISSION_MODES:
        words += f" {now.mode}"
    return words if now.heard_s == inf or not now.old else f"{words} {age(now.heard_s)}"

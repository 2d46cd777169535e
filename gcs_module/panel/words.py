# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's sentences in the words of the panel: buttons in place of typed commands. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Final

from gcs_module.notices import QUESTION

__all__ = ["LABELS", "age", "for_buttons", "remedy_of", "seconds_to"]

#: the panel's order -> the words on its button
LABELS: Final[Mapping[str, str]] = {
    "accept": "Accept",
    "deny": "Deny",
    "request": "Request",
    "give": "Give to",
    "release": "Release",
    "stop": "Stop",
    "continue": "Continue",
    "resume": "Resume",
    "return": "Return",
    "override": "Override",
    "acknowledge": "Acknowledge",
    "start": "Start",
    "share": "Share",
    "sign_on": "Sign on",
    "confirm": "Take over",
    "sign_off": "Sign off",
}
#: typed command -> button, where the two words differ
_TYPED: Final = {"ack": "Acknowledge", "operator": "Sign on"}
_COMMAND: Final = re.compile(r"(?P<verb>\b[Tt]ype )?'handover (?:-v \S+ )?(?P<word>\w+)(?: STATION| NAME)?'")
#: the vehicle's action -> what this operator can do about it
_REMEDIES: Final[Mapping[tuple[str, bool], str]] = {
    ("hold", True): "Give the aircraft to a station that can take it, or wait.",
    ("hold", False): "Wait. Request control if the aircraft is in your zone.",
    ("return", True): "Let it return. When the cause is over, Resume continues the mission.",
    ("return", False): "Let it return. Request control if the aircraft is in your zone.",
    ("land", True): "Let it land, or choose another mode if it must not land here.",
    ("land", False): "Watch it land. Request control if the aircraft is in your zone.",
    ("continue", True): "Watch it: it flies on although something is wrong.",
    ("continue", False): "Watch it: it flies on although something is wrong.",
}


def for_buttons(text: str) -> str:
    """A sentence for an operator who presses buttons: no command to type in it."""

    def button(found: re.Match[str]) -> str:
        typed = found["word"]
        label = _TYPED.get(typed, LABELS.get(typed, ""))
        if not label:
            return found[0]
        verb = {"T": "Press ", "t": "press "}.get((found["verb"] or "")[:1], "")
        return f"{verb}{label}"

    return _COMMAND.sub(button, text.removesuffix(QUESTION))


def remedy_of(action: str, own: bool) -> str:
    """What this operator can do while the vehicle carries out this action. `own`: this station commands."""
    return _REMEDIES.get((action, own), "")


def age(seconds_old: float) -> str:
    """The age of a value in few letters."""
    if seconds_old < 100.0:
        return f"{seconds_old:.0f} s"
    return f"{seconds_old / 60.0:.0f} min" if seconds_old < 6000.0 else f"{seconds_old / 3600.0:.0f} h"


def seconds_to(at: float, now: float) -> str:
    """The time until `at`, "in 18 s" or "now"."""
    left = math.ceil(max(0.0, at - now))
    return f"in {left} s" if left else "now"

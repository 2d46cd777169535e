# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's lines that are left out at a station. Data only.

NOISE tells an operator nothing. TWICE tells an event that the station tells in a line of its own. `handover set
mavproxy_lines 1` shows all of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

__all__ = ["NOISE", "TWICE", "Twice", "is_noise"]


@dataclass(frozen=True, slots=True)
class Noise:
    """Lines that a pattern matches completely, and why they are left out."""

    pattern: re.Pattern[str]
    why: str


def _noise(pattern: str, why: str) -> Noise:
    return Noise(re.compile(pattern), why)


NOISE: Final = (
    _noise(r"\d+", "a distance that MAVProxy's speech says, without a word of what it is"),
    _noise(r"height -?\d+", "the status line and the telemetry have the height"),
    _noise(r"waypoint \d+", "the autopilot's own text about the item follows"),
    _noise(r"AP: No ap_message for mavlink id \(\d+\)", "the autopilot does not know a message that was asked for"),
    _noise(r"AP: Flight plan received", "the station says that the mission is loaded"),
    _noise(r"AP: HNDO: lease live, \S+ commands", "the station says which station commands"),
    _noise(r"AP: (?:[A-Z]\w+ )?V\d+\.\d+.*\([0-9a-f]{8}\)", "the firmware's banner"),
    _noise(r"AP: (?:ChibiOS|NuttX): [0-9a-f]+", "the firmware's banner"),
    _noise(r"Detected vehicle \d+:\d+ on link \d+", "the station says that the vehicle is connected"),
    _noise(r"online system \d+", "the station says that the vehicle is connected"),
    _noise(r"Got COMMAND_ACK: (?:MISSION_START|DO_PAUSE_CONTINUE|REQUEST_OPERATOR_CONTROL): "
           r"(?:ACCEPTED|IN_PROGRESS)", "the station tells the outcome of its command"),
    _noise(r"Got COMMAND_ACK: (?:SET_MESSAGE_INTERVAL|REQUEST_MESSAGE): \w+", "a program has asked for messages"),
    _noise(r"Got MISSION_ACK: TYPE_\w+: ACCEPTED", "the station says that the mission is loaded"),
    _noise(r"(?:Log Directory|Telemetry log): .*", "the folder is in the command line above"),
    _noise(r"Loaded module handover_gcs.*", "the module has said so itself"),
    _noise(r"Unloading module (?!handover_gcs)\w+", "the station ends"),
    _noise(r"no script .*", "no start-up script of MAVProxy is needed"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Twice:
    """A line of MAVProxy that waits for the station's own line about the same event.

    `own`: words of the station's line; `{what}` is what the pattern has found. If the station writes a line with one
    of them, this line is left out. Else it comes after `lines.WAIT_S`.
    """

    pattern: re.Pattern[str]
    own: tuple[str, ...]


def _twice(pattern: str, *own: str) -> Twice:
    return Twice(re.compile(pattern), own)


_DECISION: Final = "RETURN|LAND|HOLD|WARNING|TRANSFER|CONTINUE|ALL CLEAR|REHEARSAL"
TWICE: Final = (
    _twice(r"AP: (?:Handover: )?(?P<what>[\w.-]+) commands now\b.*", "{what} commands", "{what} is the commander"),
    _twice(r"AP: (?:Handover: )?(?P<what>no station) commands now\b.*", "{what} commands"),
    _twice(rf"AP: (?:Handover: )?(?P<what>(?:{_DECISION})\b.*)", "{what}"),
    _twice(r"AP: (?:Handover: )?Control denied: (?P<what>.*)", "{what}"),
    _twice(r"AP: (?:Handover: )?(?P<what>landed: the flight is over)", "is on load"),
)


def is_noise(line: str) -> bool:
    """Whether the line tells an operator nothing."""
    return any(each.pattern.fullmatch(line) for each in NOISE)

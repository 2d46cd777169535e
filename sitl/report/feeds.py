# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds and onboard programs of a flight, from the companion's journal: spans and what was not used.

A span of a feed is the time in which one station was its source. A span of an onboard program is a delegation of guided
targets, or a silence. A span without an end lasts as long as the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from sitl.report.evidence import Evidence
from sitl.report.journal_reader import Entry

__all__ = ["NAMES", "Span", "feed_spans", "onboard_spans", "unused"]

#: kind of feed in the journal -> what people call it
NAMES: Final = {"rtk": "RTK corrections", "adsb": "ADS-B", "terrain": "terrain", "weather": "weather"}
#: an entry of another source, or of none, ends the span before it
_CHANGES: Final = ("source", "silent")
_OTHERS: Final = ("not used", "no place")


@dataclass(frozen=True, slots=True)
class Span:
    """`what` from `begun_t` to `ended_t` (None: to the end of the record), by `who`; `why` it ended."""

    what: str
    who: str
    begun_t: float
    ended_t: float | None = None
    why: str = ""


def feed_spans(evidence: Evidence) -> list[Span]:
    """The sources of each feed, in order of their beginnings."""
    found: list[Span] = []
    last: dict[str, int] = {}
    for entry in _of_feeds(evidence, _CHANGES):
        kind = _kind(entry)
        if kind in last:
            at = last.pop(kind)
            found[at] = replace(found[at], ended_t=entry.t, why=entry.text)
        if entry.get("change") == "source":
            last[kind] = len(found)
            found.append(Span(kind, str(entry.get("station")), entry.t))
    return found


def unused(evidence: Evidence) -> list[Entry]:
    """What was told of feeds that were not used, or not checked."""
    return _of_feeds(evidence, _OTHERS)


def _of_feeds(evidence: Evidence, changes: Sequence[str]) -> list[Entry]:
    return [entry for entry in evidence.of(event="feed") if entry.get("change") in changes]


def _kind(entry: Entry) -> str:
    kind = str(entry.get("kind"))
    return NAMES.get(kind, kind)


def onboard_spans(evidence: Evidence) -> list[Span]:
    """Delegations to onboard programs and their silences, in order of their beginnings."""
    found: list[Span] = []
    led: dict[str, int] = {}
    silent: dict[str, int] = {}
    for entry in evidence.of(event="onboard"):
        program = str(entry.get("program"))
        if entry.get("by"):
            led[program] = len(found)
            found.append(Span(f"{program} leads in GUIDED", str(entry.get("by")), entry.t))
        elif entry.get("end"):
            why = entry.text.partition(": ")[2]
            if program in led:
                at = led.pop(program)
                found[at] = replace(found[at], ended_t=entry.t, why=why)
            else:
                found.append(Span(f"{program} leads in GUIDED", "", entry.t, entry.t, why))
        elif entry.get("heard") is False:
            silent[program] = len(found)
            found.append(Span(f"{program} is silent", "", entry.t))
        elif entry.get("heard") is True and program in silent:
            at = silent.pop(program)
            found[at] = replace(found[at], ended_t=entry.t, why="it is heard again")
    return found

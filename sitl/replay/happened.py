# SPDX-License-Identifier: GPL-3.0-or-later

"""The past of the flight by its journal: what was decided, and what no log contains.

A journal has the stations' answers with times, when they were heard and lost, and what was typed. So with it a replay
knows these; without it they are assumed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

from mavproxy_handover.core.common.model import Consent
from mavproxy_handover.store.journal import strangers_path
from sitl.report.journal_reader import Entry, read_journals

__all__ = [
    "DECIDED",
    "Answer",
    "Decision",
    "Happened",
    "Transfer",
    "decision_of",
    "journal_beside",
    "nearest",
    "read_journal",
]

#: entries that say what was decided, and what it went by
DECIDED: Final = frozenset(
    {
        *("zone_entered", "zone_left", "position_stale", "off_route", "on_route"),
        *("start", "start_refused", "start_failed", "started", "landed", "authority", "authority_lost"),
        *("transfer_begun", "transfer_raised", "transfer_committed", "transfer_aborted"),
        *("warning", "warning_over", "emergency", "emergency_over", "gap", "gap_over", "would", "decision"),
    }
)
_REQUEST: Final = re.compile(r"(\S+) (requests|releases) control: ")
_BEGUN: Final = re.compile(r"handover \d+(?: \(forced\))?: (\S+) -> (\S+)")


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision, at `at` (UTC s). `action`: what is done from then on, with the return site."""

    at: float
    event: str
    reason: str
    station: str
    action: str
    text: str

    @property
    def what(self) -> tuple[str, ...]:
        """All except time and figures: two decisions with the same values are the same."""
        return self.event, self.reason, self.station, self.action


@dataclass(frozen=True, slots=True)
class Answer:
    """A station's answer in a transfer, `after_s` after its beginning."""

    station: str
    name: str
    after_s: float
    consent: Consent | None


@dataclass(slots=True)
class Transfer:
    """A transfer that was tried at `at` (UTC s), and every answer to it."""

    at: float
    from_station: str
    to_station: str
    answers: list[Answer] = field(default_factory=list)


@dataclass(slots=True)
class Happened:
    """The contents of the journal of one flight. Times are UTC (s)."""

    path: Path
    decisions: list[Decision] = field(default_factory=list)
    transfers: list[Transfer] = field(default_factory=list)
    #: station is heard (True) or no more (False); of what a silence was learnt from, see `ground.py`
    heard: list[tuple[float, str]] = field(default_factory=list)
    lost: list[tuple[float, str]] = field(default_factory=list)
    unfit: list[tuple[float, str]] = field(default_factory=list)
    foreseen: list[tuple[float, str, bool]] = field(default_factory=list)
    #: runs of the companion
    loaded: list[float] = field(default_factory=list)
    mission: list[tuple[float, bool]] = field(default_factory=list)
    starts: list[tuple[float, str]] = field(default_factory=list)
    start_ends: list[tuple[float, bool, str]] = field(default_factory=list)
    #: requests of control: station, and whether it is no release
    requests: list[tuple[float, str, bool]] = field(default_factory=list)
    #: link quality (True: weak) and attacks: what changed, in words
    links: list[tuple[float, str, str, str]] = field(default_factory=list)
    #: entries of what cannot be fed to the rules, by kind
    left_out: dict[str, int] = field(default_factory=dict)


#: entries about acts that a replay does not repeat, in words
_LEFT_OUT: Final = {
    "override": "limits that an operator lifted",
    "rerouted": "missions that were written in flight",
    "rally_list": "rally points of a station",
    "position_source": "words on the position box",
    "rehearsal": "rehearsals",
    "fault": "faults of the companion",
    "failed_closed": "faults that ended authority",
    "clock_step": "steps of the clock",
}


def journal_beside(recording: Path) -> Path | None:
    """The journal of the companion in the recording's folder; None: there is none.

    It has the recording's name, or it is the only one.
    """
    same = recording.with_suffix(".jsonl")
    if same.is_file():
        return same
    found = sorted(recording.parent.glob("*.jsonl"))
    beside = set(map(strangers_path, found))
    journals = [path for path in found if path not in beside]
    return journals[0] if len(journals) == 1 else None


def _utc(entry: Entry) -> float | None:
    try:
        return datetime.fromisoformat(str(entry.get("utc"))).timestamp()
    except ValueError:
        return None


def decision_of(at: float, entry: Entry) -> Decision | None:
    """The decision that an entry tells of, if it does."""
    if entry.event not in DECIDED:
        return None
    reason, station, action = (str(entry.get(key) or "") for key in ("reason", "station", "action"))
    place = entry.get("place")
    return Decision(at, entry.event, reason, station, f"{action} to {place}" if place else action, entry.text)


def read_journal(path: Path) -> Happened:
    """Read it. Broken lines are left out, as everywhere; raises OSError."""
    path.stat()
    happened = Happened(path)
    for entry in read_journals([path]):
        at = _utc(entry)
        if at is not None:
            _take(happened, at, entry)
    return happened


def _take(happened: Happened, at: float, entry: Entry) -> None:
    decision = decision_of(at, entry)
    if decision is not None:
        happened.decisions.append(decision)
    station, reason = str(entry.get("station") or ""), str(entry.get("reason") or "")
    match entry.event:
        case "loaded":
            happened.loaded.append(at)
        case "mission_loaded":
            happened.mission.append((at, True))
        case "mission_dropped":
            happened.mission.append((at, False))
        case "station_heard":
            happened.heard.append((at, station))
        case "authority_lost" if reason == "commander_lost":
            happened.lost.append((at, station))
        case "partner_unfit" if reason == "partner_silent":
            happened.unfit.append((at, station))
        case "start" | "start_refused":
            happened.starts.append((at, station))
        case "started" | "start_failed":
            happened.start_ends.append((at, entry.event == "started", entry.text))
        case "foreseen_answer":
            happened.foreseen.append((at, station, "agrees" in entry.text))
        case "transfer_begun":
            named = _BEGUN.match(entry.text)
            if named is not None:
                happened.transfers.append(Transfer(at, named[1], named[2]))
        case "message" if entry.get("direction") == "in":
            _answered(happened, at, entry, station)
        case "control":
            request = _REQUEST.match(entry.text)
            if request is not None:
                happened.requests.append((at, request[1], request[2] == "requests"))
        case "link_quality" | "attack":
            happened.links.append((at, station, entry.event, entry.text))
        case other if other in _LEFT_OUT:
            words = _LEFT_OUT[other]
            happened.left_out[words] = happened.left_out.get(words, 0) + 1


def _answered(happened: Happened, at: float, entry: Entry, station: str) -> None:
    """An answer belongs to the last transfer that had begun."""
    if not happened.transfers:
        return
    transfer = happened.transfers[-1]
    word = str(entry.get("consent") or "").upper()
    consent = Consent[word] if word in Consent.__members__ else None
    transfer.answers.append(Answer(station, str(entry.get("name")), max(0.0, at - transfer.at), consent))


def nearest(transfers: Iterable[Transfer], from_station: str, to_station: str, at: float) -> Transfer | None:
    """The one between these two that was tried next to `at`."""
    alike = [each for each in transfers if (each.from_station, each.to_station) == (from_station, to_station)]
    return min(alike, key=lambda each: abs(each.at - at), default=None)

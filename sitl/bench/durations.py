# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads transfers from journals: how long each took, with how many messages, and what failed on the way."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Committed", "read_journal", "transfers"]

Entry = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Committed:
    """One change of authority.

    `since_entry_s`: from the zone check that noticed the region to the commit, failed attempts and waiting included.
    `duration_s`: of the attempt that was committed, as journalled; the two differ where an earlier attempt failed.
    `messages`: of that attempt, until the commit, sent by any program, copies and repetitions included.
    """

    since_entry_s: float
    duration_s: float
    messages: int
    failed_attempts: int
    #: the commander's release never came: committed by the limit on waiting for it
    by_timeout: bool


def read_journal(path: Path) -> list[Entry]:
    """The entries of a journal, without a line that was cut. Raises OSError."""
    entries = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entries.append(json.loads(line))
        except ValueError:
            continue
    return entries


def _is_step(entry: Entry) -> bool:
    return entry["event"] == "message" and entry.get("direction") == "out" and entry.get("name") != "HANDOVER_RESULT"


def transfers(companion: Sequence[Entry], stations: Iterable[Sequence[Entry]]) -> list[Committed]:
    """All commits, in order, from the journals of the companion and of the stations."""
    sent: dict[int, list[float]] = {}
    for journal in (companion, *stations):
        for entry in journal:
            if _is_step(entry):
                sent.setdefault(entry["handover_id"], []).append(entry["t"])
    found = []
    #: when each station's zone was entered, since the last commit
    entered: dict[str, float] = {}
    failed: dict[str, int] = {}
    begun_at = 0.0
    for entry in companion:
        event, station = entry["event"], entry.get("station", "")
        if event == "zone_entered":
            entered[station] = entry["t"]
            failed[station] = 0
        elif event == "transfer_begun":
            begun_at = entry["t"]
        elif event == "transfer_aborted":
            failed[station] = failed.get(station, 0) + 1
        elif event == "transfer_committed":
            waited_s = begun_at - entered.get(station, begun_at)
            duration_s = entry["duration_s"]
            # both entries of one zone check are written in a row; the time between them is not waiting
            since_entry_s = duration_s + (waited_s if failed.get(station) or waited_s > 0.02 else 0.0)
            messages = sum(t <= entry["t"] for t in sent.get(entry["handover_id"], []))
            by_timeout = entry.get("reason") == "release_timeout"
            found.append(Committed(since_entry_s, duration_s, messages, failed.get(station, 0), by_timeout))
            entered.pop(station, None)
    return found

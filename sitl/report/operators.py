# SPDX-License-Identifier: GPL-3.0-or-later

"""The operators of a flight, from the journals: the operator on duty at each station, and what each one did.

The vehicle's journal counts, because it has what arrived. A station's journal adds its operator's commands and
acknowledged alarms. If the vehicle names no operator at all, a station's journal counts for the rest as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from sitl.report.evidence import Evidence
from sitl.report.journal_reader import Entry

__all__ = ["Done", "agreed", "operators"]

#: of the vehicle, and what a station adds
_OF_VEHICLE = ("operator", "foreseen_answer", "control", "start", "start_refused", "override")
_OF_STATION = ("command", "acknowledged")
#: of a station without the vehicle's journal
_INSTEAD = ("operator", "consent")
_ANSWERS = {"granted": "agrees to handover {number}", "denied": "denies handover {number}"}


@dataclass(frozen=True, slots=True)
class Done:
    """One row: at `t` something was done at a station under an operator's name; "": the operator has signed off."""

    t: float
    station: str
    operator: str
    text: str


def operators(evidence: Evidence) -> list[Done]:
    """All of them, in order of time. Empty: no operator has signed on."""
    stations = frozenset(evidence.stations)
    of_vehicle = [*_of_vehicle(evidence, stations)]
    wanted = _OF_STATION if of_vehicle else (*_OF_STATION, *_INSTEAD)
    of_stations = [
        _done(entry, entry.who)
        for entry in evidence.entries
        if entry.who in stations and entry.event in wanted and _named(entry) and entry.get("result") is None
    ]
    return sorted((*of_vehicle, *of_stations), key=lambda done: done.t)


def agreed(evidence: Evidence, handover_id: int) -> str:
    """The operators who agreed to a handover, by name and station; "": no name is known."""
    stations = frozenset(evidence.stations)
    names = {
        str(entry.get("station")): str(entry.get("operator"))
        for entry in evidence.of(event="message")
        if entry.who not in stations and entry.get("handover_id") == handover_id and entry.get("consent") == "granted"
        if entry.get("operator")
    }
    return ", ".join(f"{operator} ({station})" for station, operator in names.items())


def _of_vehicle(evidence: Evidence, stations: frozenset[str]) -> Iterator[Done]:
    told: set[tuple[object, ...]] = set()
    for entry in evidence.entries:
        if entry.who in stations:
            continue
        if entry.event in _OF_VEHICLE and (_named(entry) or entry.event == "operator"):
            yield _done(entry, str(entry.get("station") or entry.get("by") or ""))
        elif entry.event == "message" and _named(entry):
            answer = _ANSWERS.get(str(entry.get("consent")))
            key = entry.get("station"), entry.get("handover_id"), entry.get("consent")
            if answer is not None and key not in told:
                told.add(key)
                text = answer.format(number=entry.get("handover_id"))
                yield Done(entry.t, str(entry.get("station")), str(entry.get("operator")), text)


def _named(entry: Entry) -> bool:
    return bool(entry.get("operator"))


def _done(entry: Entry, station: str) -> Done:
    return Done(entry.t, station, str(entry.get("operator") or ""), entry.text or entry.event)

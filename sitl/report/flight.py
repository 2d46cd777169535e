# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes flights of recorded files: of journals, telemetry logs and dataflash logs, in any combination.

Each file is a strand (`strand.py`); `clocks.py` brings them to one axis, UTC where a GPS told it. Then, for each
vehicle, one story is put together. If several files tell the same, the nearest witness is believed:

* what the aircraft did: the autopilot's own log, then the log of the companion beside it, then those of stations; a
  further witness counts only for times of which the nearer ones say nothing;
* the commander and the reason: the companion's journal; without it AUTHORITY_STATUS as stations heard it, then the
  leases, then the guard's record in the autopilot's log;
* messages of a handover: the journals of both ends; for a station without one, its telemetry log.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.package import MissionPackage
from sitl.report.clocks import Alignment, Shift, align
from sitl.report.evidence import Evidence, RunNotes
from sitl.report.journal_reader import Entry
from sitl.report.strand import Kind, Strand
from sitl.report.watch import AIRBORNE_M, VEHICLE, number

__all__ = ["Source", "Story", "stories"]

#: a witness that says nothing for this time (s) does not count for that time
_HOLE_S = 3.0
#: two entries of different witnesses within this time (s) may be one event
_SAME_S = 3.0
#: how a journal tells of a flight mode
_MODE = "mode "
_TURNING = ("armed", "disarmed", "airborne", "landed", "mode", "reached", "firmware")

_Spans = list[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Source:
    """A file that was read: its kind, its span of time (on the axis, s), and its clock."""

    path: Path
    kind: str
    who: str
    span: tuple[float, float] | None
    clock: str
    broken: int = 0


@dataclass(frozen=True, slots=True)
class Story:
    """One vehicle's flight. `witness` says whose account of the aircraft it is; `items` is the route as the autopilot
    had it: item -> latitude, longitude (degrees)."""

    vehicle: str
    evidence: Evidence
    witness: str
    items: Mapping[int, tuple[float, float]]
    #: station -> when nothing of the vehicle was heard there, as its telemetry log shows
    silences: Mapping[str, _Spans]


def stories(strands: Sequence[Strand], package: MissionPackage | None) -> tuple[list[Story], list[Source], Alignment]:
    """Every vehicle's flight, and the files that they come from. The strands are moved to one axis in place."""
    alignment = align(strands)
    for strand in strands:
        if strand.kind is Kind.TLOG and not strand.who:
            beside = [each.who for each in strands if each.kind is Kind.JOURNAL and _together(each, strand)]
            strand.who = beside[0] if len(set(beside)) == 1 else ""
    stations, vehicles = _names(strands, package)
    found = [_story(name, sysids, strands, package, stations) for name, sysids in vehicles.items()]
    sources = [_source(strand, shift) for strand, shift in zip(strands, alignment.shifts, strict=True)]
    told = [story for story in found if story.evidence.entries]
    return told, sources, alignment


def _source(strand: Strand, shift: Shift) -> Source:
    return Source(strand.path, strand.kind.value, strand.who, strand.span(), str(shift), strand.broken)


# ---- names --------------------------------------------------------------------------------------------------------


def _names(
    strands: Sequence[Strand], package: MissionPackage | None
) -> tuple[dict[int, str], dict[str, frozenset[int]]]:
    """Stations by system id, and of each vehicle by name its system ids (one, or none that is known)."""
    stations: dict[int, str] = {}
    names: dict[int, str] = {}
    for strand in strands:
        stations.update((sysid, name) for sysid, name in strand.stations.items() if sysid not in stations)
        names.update(strand.vehicles)
    if package is not None:
        stations.update((station.sysid, station.name) for station in package.stations)
    companions = [strand for strand in strands if strand.kind is Kind.JOURNAL and strand.on_board]
    sysids = {sysid for strand in strands for sysid in (*strand.seen, *strand.told)}
    for strand in companions:
        beside = [each for each in strands if each.kind is Kind.TLOG and each.on_board and _together(each, strand)]
        for sysid in {sysid for each in beside for sysid in each.seen}:
            names.setdefault(sysid, strand.who)
    unnamed = sysids - set(names)
    nameless = {strand.who for strand in companions} - set(names.values())
    if len(unnamed) == 1 and len(nameless) == 1:
        names[unnamed.pop()] = nameless.pop()
    vehicles = {names.get(sysid, f"vehicle {sysid}"): frozenset({sysid}) for sysid in sorted(sysids)}
    for strand in companions:
        vehicles.setdefault(strand.who, frozenset())
    if not vehicles:
        vehicles["vehicle"] = frozenset()
    for entry in (entry for strand in strands for told in strand.told.values() for entry in told):
        for sysid in (entry.get("commander"), entry.get("station"), entry.get("from_station")):
            if isinstance(sysid, int) and sysid:
                stations.setdefault(sysid, f"station {sysid}")
    # a station without a number, by its journal
    number = -1
    for strand in strands:
        if (
            strand.kind is Kind.JOURNAL
            and not strand.on_board
            and strand.who not in (*stations.values(), *vehicles, "")
        ):
            stations[number] = strand.who
            number -= 1
    return stations, vehicles


def _together(one: Strand, other: Strand) -> bool:
    return one.path.parent == other.path.parent


# ---- one vehicle --------------------------------------------------------------------------------------------------


def _story(
    name: str,
    sysids: frozenset[int],
    strands: Sequence[Strand],
    package: MissionPackage | None,
    stations: Mapping[int, str],
) -> Story:
    companions = [strand for strand in strands if strand.kind is Kind.JOURNAL and strand.who == name]
    journals = [
        strand
        for strand in strands
        if strand.kind is Kind.JOURNAL and strand not in companions and strand.who in stations.values()
    ]
    seen, witness = _seen(strands, sysids, companions, journals, name)
    entries = list(seen)
    for strand in companions:
        entries += strand.own
    for strand in journals:
        entries += [entry for entry in strand.own if entry.get("vehicle", name) == name]
    if not any(entry.event == "view" for strand in companions for entry in strand.own):
        entries += _told(strands, sysids, name, stations)
    written = {strand.who for strand in (*companions, *journals)}
    entries += _messages(strands, sysids, name, stations, written)
    items: dict[int, tuple[float, float]] = {}
    silences: dict[str, _Spans] = {}
    for strand in strands:
        for sysid in sysids:
            items.update(strand.items.get(sysid, {}))
            if strand.kind is Kind.TLOG and not strand.on_board and strand.who:
                silences.setdefault(strand.who, []).extend(strand.silences.get(sysid, []))
    known = any(_has_utc(strand) for strand in strands)
    notes = RunNotes(utc_offset_s=0.0 if known else None)
    return Story(name, Evidence(entries, package, notes, stations), witness, items, silences)


def _has_utc(strand: Strand) -> bool:
    """Whether the file tells the time of day. Without it a journal has monotonic time, and a dataflash log the seconds
    since the autopilot was started."""
    if strand.kind is Kind.DATAFLASH:
        return any(tick.gps_s is not None for tick in strand.ticks)
    return strand.kind is Kind.TLOG or strand.offset_s is not None


def _seen(
    strands: Sequence[Strand],
    sysids: frozenset[int],
    companions: Sequence[Strand],
    journals: Sequence[Strand],
    name: str,
) -> tuple[list[Entry], str]:
    """The acts of the aircraft, and their witnesses."""
    ranks = [
        ("the autopilot's own log", [strand for strand in strands if strand.kind is Kind.DATAFLASH]),
        ("the companion's telemetry log", [each for each in strands if each.kind is Kind.TLOG and each.on_board]),
    ]
    others = [each for each in strands if each.kind is Kind.TLOG and not each.on_board]
    others.sort(key=lambda strand: -sum(len(strand.seen.get(sysid, ())) for sysid in sysids))
    ranks += [(f"the telemetry log of {strand.who or strand.path.name}", [strand]) for strand in others]
    watched = [each for each in strands if each.kind is Kind.JOURNAL and each.who == VEHICLE]
    groups = [("what was watched of it", [entry for each in watched for entry in each.own])]
    groups += [
        (words, [entry for strand in group for sysid in sysids for entry in strand.seen.get(sysid, ())])
        for words, group in ranks
    ]
    groups += [
        ("the companion's journal", [entry for each in companions for entry in _from_journal(each.own)]),
    ]
    kept: list[Entry] = []
    believed: list[str] = []
    for words, entries in groups:
        added = _added(kept, sorted(entries, key=lambda entry: entry.t))
        if sum(entry.event == "sample" for entry in added) > 1:
            believed.append(words)
        kept = sorted(kept + added, key=lambda entry: entry.t)
    if not believed:  # a station's journal has places, and no height
        for each in journals:
            about = [entry for entry in each.own if entry.get("vehicle", name) == name]
            found = _positions(about, "telemetry")
            if len(found) > 1:
                believed, kept = [f"the journal of {each.who}"], sorted(kept + found, key=lambda entry: entry.t)
                break
    kept = [
        replace(entry, fields={**entry.fields, "sim_s": entry.t}) if entry.event == "sample" else entry
        for entry in kept
    ]
    first, rest = believed[:1], believed[1:]
    witness = "".join(first) + (f"; where it is silent, {', '.join(rest)}" if rest else "")
    return kept, witness


def _added(kept: Sequence[Entry], entries: Sequence[Entry]) -> list[Entry]:
    """The entries that a further witness adds."""
    if not kept:
        return list(entries)
    spans = _spans([entry.t for entry in kept if entry.event == "sample"])
    turns: dict[tuple[str, Any], list[float]] = {}
    for entry in kept:
        if entry.event in _TURNING:
            turns.setdefault(_turn(entry), []).append(entry.t)
    return [
        entry
        for entry in entries
        if entry.event == "radio"
        or (not _within(spans, entry.t) and not any(abs(t - entry.t) < _SAME_S for t in turns.get(_turn(entry), ())))
    ]


def _turn(entry: Entry) -> tuple[str, Any]:
    return entry.event, entry.get("mode") or entry.get("number") or entry.get("version")


def _spans(times: Sequence[float]) -> _Spans:
    """From when to when a witness speaks."""
    found: _Spans = []
    for t in times:
        if found and t - found[-1][1] <= _HOLE_S:
            found[-1] = (found[-1][0], t)
        else:
            found.append((t, t))
    return found


def _within(spans: _Spans, t: float) -> bool:
    place = bisect_right(spans, (t, float("inf"))) - 1
    return place >= 0 and spans[place][0] <= t <= spans[place][1]


def _from_journal(entries: Sequence[Entry]) -> list[Entry]:
    """The aircraft in the companion's journal: places, modes, and when it was in the air."""
    found = _positions(entries, "position")
    up = next((entry for entry in found if entry.get("alt_m") > AIRBORNE_M), None)
    if up is not None:
        found.append(Entry(up.t, VEHICLE, "airborne", "airborne", {}))
    last = None
    for entry in entries:
        if entry.event == "mode" and entry.text.startswith(_MODE):
            mode = entry.text.removeprefix(_MODE)
            found.append(Entry(entry.t, VEHICLE, "mode", entry.text, {"mode": mode}))
        if entry.event == "position":
            last = entry
        if entry.event == "landed" and up is not None and entry.t > up.t:
            place = {} if last is None else {key: last.get(key) for key in ("lat_deg", "lon_deg")}
            found.append(Entry(entry.t, VEHICLE, "landed", "landed", place))
    return found


def _positions(entries: Iterable[Entry], event: str) -> list[Entry]:
    """Samples of the positions that a journal has, a second apart; speed from one to the next."""
    places = [
        entry
        for entry in entries
        if entry.event == event and number(entry, "lat_deg") is not None and number(entry, "lon_deg") is not None
    ]
    found = []
    for before, entry in pairwise([*places[:1], *places]):
        way = distance_m(before.get("lat_deg"), before.get("lon_deg"), entry.get("lat_deg"), entry.get("lon_deg"))
        values = {
            "sim_s": entry.t,
            "lat_deg": entry.get("lat_deg"),
            "lon_deg": entry.get("lon_deg"),
            "alt_m": number(entry, "alt_m") or 0.0,
            "heading_deg": 0.0,
            "speed_mps": round(way / (entry.t - before.t), 2) if entry.t - before.t > 0.1 else 0.0,
        }
        found.append(Entry(entry.t, VEHICLE, "sample", "", values))
    return found


def _told(strands: Sequence[Strand], sysids: frozenset[int], name: str, stations: Mapping[int, str]) -> list[Entry]:
    """The commanders by the file that tells them best; another one counts where the better ones are silent."""
    accounts = [
        (strand, [entry for sysid in sysids for entry in strand.told.get(sysid, ()) if entry.event != "message"])
        for strand in strands
    ]
    accounts = [(strand, entries) for strand, entries in accounts if entries]

    def worth(strand: Strand, entries: Sequence[Entry]) -> tuple[bool, bool, int]:
        phases = any(entry.get("phase") for entry in entries)
        return phases, strand.kind is Kind.TLOG, len(entries)

    kept: list[Entry] = []
    for _, entries in sorted(accounts, key=lambda account: worth(*account), reverse=True):
        spans = _spans([entry.t for entry in kept if entry.event == "view"])
        numbers = {(entry.event, entry.get("handover_id")) for entry in kept if entry.event.startswith("transfer_")}
        kept += [
            entry
            for entry in entries
            if not _within(spans, entry.t) and (entry.event, entry.get("handover_id")) not in numbers
        ]
        kept.sort(key=lambda entry: entry.t)
    return [replace(_with_names(entry, stations), who=name) for entry in kept]


def _messages(
    strands: Sequence[Strand],
    sysids: frozenset[int],
    name: str,
    stations: Mapping[int, str],
    written: set[str],
) -> list[Entry]:
    """Messages of handovers from the telemetry logs of those who have no journal here."""
    found = []
    for strand in strands:
        if strand.kind is not Kind.TLOG or not strand.who or strand.who in written or strand.on_board:
            continue
        for sysid in sysids:
            for entry in strand.told.get(sysid, ()):
                if entry.event == "message":
                    found.append(replace(_with_names(entry, stations), who=strand.who))
    return found


def _with_names(entry: Entry, stations: Mapping[int, str]) -> Entry:
    """Numbers of stations as their names."""
    fields = dict(entry.fields)
    for key in ("commander", "station", "from_station"):
        if isinstance(fields.get(key), int):
            fields[key] = stations.get(fields[key], f"station {fields[key]}") if fields[key] else None
    return replace(entry, fields=fields)

# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover replay`: a recorded flight through today's rules, with any mission and any limits."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.tools.command_line import CommandParser
from sitl.replay.compare import Comparison, compare
from sitl.replay.flight import Replay, replay
from sitl.replay.happened import Decision, Happened, journal_beside, read_journal
from sitl.replay.reading import read_recording
from sitl.replay.recording import Recording, RecordingError
from sitl.replay.settings import changed, differences, found_beside, read_settings, vehicle

__all__ = ["main"]

#: so far apart (s) two decisions are the same: jobs of each second may come that much earlier or later
_TOLERANCE_S: Final = 1.0
_COVERED: Final = "  = both   - then only   + now only"


@dataclass(frozen=True, slots=True)
class _Told:
    """All that is told."""

    recording: Recording
    package: MissionPackage
    happened: Happened | None
    flown: VehicleConfig
    first: Replay
    #: against the journal; None: there is none
    held: Comparison | None
    tried: Replay | None = None
    changes: tuple[str, ...] = ()
    #: the one under other limits against the first
    other: Comparison | None = None
    #: the flight had a position box
    boxed: bool = False

    @property
    def code(self) -> int:
        """1: something would have been decided that was not, or the other way round."""
        return 0 if (self.held is None or self.held.equal) and (self.other is None or self.other.equal) else 1


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = CommandParser(
        prog="handover replay",
        examples=(
            ("handover replay flight.tlog --mission missions/delivery", "what the rules of today would decide"),
            (
                "handover replay flight.tlog --mission missions/delivery --set limits.enter_margin_m=30",
                "the same with another limit",
            ),
        ),
        codes={0: "the same decisions", 1: "something differs", 2: "wrong usage, or a recording that cannot be read"},
        description="Pass a recorded flight through today's rules. Shows commanders and decisions with their reasons, "
        "compared with what happened.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="a tlog, a dataflash log (.bin) or a table (.csv)")
    parser.add_argument("--mission", type=Path, required=True, metavar="DIR", help="the mission package to fly it by")
    parser.add_argument(
        "--journal", type=Path, metavar="FILE", help="of the companion (the one beside FILE, if there is one)"
    )
    parser.add_argument("--no-journal", action="store_true", help="leave the one that is there out")
    parser.add_argument(
        "--flown", type=Path, metavar="FILE", help="the configuration it was flown with (the one beside FILE, else the "
        "defaults)",
    )  # fmt: skip
    parser.add_argument("--config", type=Path, metavar="FILE", help="try this one, and list what differs")
    parser.add_argument(
        "--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE",
        help="try other values, as limits.enter_margin_m=30 or policy.out_of_coverage=land, and list what differs",
    )  # fmt: skip
    parser.add_argument(
        "--tolerance", type=float, default=_TOLERANCE_S, metavar="S",
        help="so far apart two decisions are the same (%(default)g)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="for programs")
    arguments = parser.parse_args(argv)
    if not (math.isfinite(arguments.tolerance) and arguments.tolerance > 0.0):
        parser.error("--tolerance must be more than 0")
    if arguments.journal is not None and arguments.no_journal:
        parser.error("--journal and --no-journal exclude each other")
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Replay; 0: as it happened, or nothing to compare with; 1: something differs; 2: bad usage or input."""
    try:
        arguments = _arguments(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        told = _replay(arguments)
    except (RecordingError, ConfigError, MissionError) as error:
        print(f"handover replay: {error}", file=sys.stderr)
        return 2
    print(json.dumps(_values(told), indent=2, ensure_ascii=False) if arguments.json else "\n".join(_lines(told)))
    return told.code


def _replay(arguments: argparse.Namespace) -> _Told:
    package = packages.load(arguments.mission)
    settings = read_settings(arguments.flown or found_beside(arguments.file), package)
    other = read_settings(arguments.config, package) if arguments.config is not None else settings
    tries = arguments.config is not None or bool(arguments.set)
    other = changed(other, arguments.set)
    vehicle(other, package, 1)  # what is wrong with it is told before anything is read
    happened = _journal(arguments)
    recording = read_recording(arguments.file, package.profile)
    flown = vehicle(settings, package, recording.sysid)
    inputs = _inputs(happened, package)
    first = replay(recording, inputs, package, flown, flown)
    held = None if happened is None else compare(_within(happened, recording), first.decisions, arguments.tolerance)
    if not tries:
        return _Told(recording, package, happened, flown, first, held, boxed="position" in settings[0])
    config = vehicle(other, package, recording.sysid)
    changes = tuple(differences(flown, config))
    tried = replay(recording, inputs, package, config, flown)
    against = compare(first.decisions, tried.decisions, arguments.tolerance)
    return _Told(recording, package, happened, flown, first, held, tried, changes, against, "position" in settings[0])


def _inputs(happened: Happened | None, package: MissionPackage) -> Happened | None:
    """The journal, where it tells of stations of this mission: of others it says nothing."""
    names = {entry.name for entry in package.stations}
    return happened if happened is not None and any(name in names for _at, name in happened.heard) else None


def _journal(arguments: argparse.Namespace) -> Happened | None:
    path: Path | None = arguments.journal
    if path is None and not arguments.no_journal:
        path = journal_beside(arguments.file)
    if path is None:
        return None
    try:
        return read_journal(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None


def _within(happened: Happened, recording: Recording) -> list[Decision]:
    """The decisions of the journal while the recording lasts: one may go on where the other has ended."""
    return [each for each in happened.decisions if recording.begin - 1.0 <= each.at <= recording.end + 1.0]


# ---- for people -----------------------------------------------------------------------------------------------------


def _utc(at: float) -> str:
    return datetime.fromtimestamp(at, timezone.utc).strftime("%Y-%m-%d %H:%M:%S")


def _line(mark: str, decision: Decision, begin: float) -> str:
    words = decision.text or decision.event
    reason = f" [{decision.reason}]" if decision.reason else ""
    return f"  {mark} T+{decision.at - begin:8.2f} s  {words}{reason}"


def _side_by_side(comparison: Comparison, begin: float) -> list[str]:
    rows = [(now.at, "=", now) for _then, now in comparison.both]
    rows += [(each.at, "-", each) for each in comparison.before]
    rows += [(each.at, "+", each) for each in comparison.after]
    return [_line(mark, decision, begin) for _at, mark, decision in sorted(rows, key=lambda row: row[0])]


def _sum(comparison: Comparison, before: str, after: str) -> str:
    return (
        f"{len(comparison.both)} the same, at most {comparison.apart_s:.2f} s apart; "
        f"{len(comparison.before)} only {before}, {len(comparison.after)} only {after}"
    )


def _lines(told: _Told) -> list[str]:
    recording, begin = told.recording, told.recording.begin
    lines = [
        f"{recording.path}: {recording.kind}, {recording.end - begin:.0f} s from {_utc(begin)} UTC, "
        f"vehicle {recording.sysid}; mission {told.package.name}",
        f"limits of the flight: {told.flown.path}",
        "",
        "Commanders of the replay:",
        *_commanders(told.first, begin),
        "",
    ]
    if told.held is None:
        lines += ["What would have been decided:", *(_line(" ", each, begin) for each in told.first.decisions), ""]
    else:
        assert told.happened is not None
        lines += [
            f"What would have been decided, and what was ({told.happened.path}):",
            *_side_by_side(told.held, begin),
            _COVERED,
            _sum(told.held, "then", "now"),
            "",
        ]
    if told.tried is not None and told.other is not None:
        lines += [
            "With other limits:",
            *(f"  {change}" for change in told.changes or ("none is other",)),
            "Commanders with them:",
            *_commanders(told.tried, begin),
            "What would have been decided with them, and with those of the flight:",
            *_side_by_side(told.other, begin),
            "  = both   - with those of the flight only   + with the others only",
            _sum(told.other, "with those of the flight", "with the others"),
            "",
        ]
    lines += ["What the recording does not hold:", *(f"  {words}" for words in _assumptions(told))]
    return lines


def _commanders(found: Replay, begin: float) -> list[str]:
    rows = [f"  T+{each.at - begin:8.2f} s  {each.station or 'nobody'} ({each.reason})" for each in found.commanders]
    return rows or ["  none, all the time"]


def _assumptions(told: _Told) -> list[str]:
    """The unknowns of a replay, and its assumptions."""
    recording, happened = told.recording, _inputs(told.happened, told.package)
    found = list(recording.assumed)
    if told.happened is not None and happened is None:
        found.append(
            "stations of this mission: none is in the journal, so it is compared, and nothing else is taken of it"
        )
    if happened is None:
        found += [
            "what operators typed: START is taken to come when it arms, and nothing else is asked for",
            "which stations were heard: all of them all the time, but for a commander whose heartbeats end in it",
            "what stations answered: every question is granted at once",
            "how good the links of the stations were: good all the time",
            "when the mission was loaded: before the first message",
        ]
    else:
        found += [
            "what operators typed, what stations answered and when they were heard is the journal's word",
            "silences of stations: known where one was lost or missed by them, else heard all the time",
        ]
        found += [f"{count} {what}: not repeated" for what, count in sorted(happened.left_out.items())]
        if happened.requests:
            found.append("how a request of control was worded: taken as one that may be granted without a question")
    replays = [told.first] if told.tried is None else [told.first, told.tried]
    assumed = max(each.assumed_answers for each in replays)
    if assumed and happened is not None:
        found.append(f"answers in {assumed} transfers that were not tried then: granted at once")
    if told.first.aloft:
        found.append(f"what was before: it begins in flight, as after a restart under {told.first.aloft}")
    if told.boxed:
        found.append("the position box of the configuration: the autopilot's own position counts instead")
    if not recording.guarded:
        found.append("the guard: alive all the time" if told.flown.limits.guard_required else "the guard: none")
    if recording.unreadable:
        found.append(f"{recording.unreadable} messages could not be read")
    if recording.spoilt:
        found.append(f"{recording.spoilt} bytes are no part of a message")
    found.append("another way of the aircraft: it flies what it flew, whatever would have been ordered")
    for each in replays:
        found += [f"  T+{at - recording.begin:.2f} s: not flown then: {words}" for at, words in each.disobeyed]
        found += [f"fault: {words}" for words in dict.fromkeys(each.faults)]
    return found


# ---- for programs ---------------------------------------------------------------------------------------------------


def _of(decision: Decision) -> dict[str, Any]:
    values = {"at": round(decision.at, 3), "event": decision.event, "reason": decision.reason}
    values |= {"station": decision.station, "action": decision.action, "text": decision.text}
    return {key: value for key, value in values.items() if value != ""}


def _compared(comparison: Comparison | None) -> dict[str, Any] | None:
    if comparison is None:
        return None
    return {
        "equal": comparison.equal,
        "apart_s": round(comparison.apart_s, 3),
        "both": [[_of(one), _of(other)] for one, other in comparison.both],
        "only_before": [_of(each) for each in comparison.before],
        "only_after": [_of(each) for each in comparison.after],
    }


def _found(found: Replay | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "commanders": [
            {"at": round(each.at, 3), "station": each.station or None, "reason": each.reason}
            for each in found.commanders
        ],
        "decisions": [_of(each) for each in found.decisions],
        "not_flown": [{"at": round(at, 3), "text": words} for at, words in found.disobeyed],
    }


def _values(told: _Told) -> dict[str, Any]:
    recording = told.recording
    return {
        "file": str(recording.path),
        "kind": recording.kind,
        "vehicle": recording.sysid,
        "begin": round(recording.begin, 3),
        "end": round(recording.end, 3),
        "mission": told.package.name,
        "flown": str(told.flown.path),
        "journal": None if told.happened is None else str(told.happened.path),
        "replay": _found(told.first),
        "happened": _compared(told.held),
        "changes": list(told.changes),
        "tried": _found(told.tried),
        "difference": _compared(told.other),
        "not_recorded": _assumptions(told),
    }

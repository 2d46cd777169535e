# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds what a flight left behind: journals, telemetry logs, dataflash logs, the mission; and reads it.

A folder is searched with everything in it; a file is what its name ends with. What was written at another time than
the newest of the files belongs to another flight, and is left out and said to be.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.journal import strangers_path
from sitl.report.clocks import by_utc, utc_of
from sitl.report.dataflash import DataflashError, read_dataflash
from sitl.report.journal_reader import Entry, parse_line
from sitl.report.strand import Kind, Strand
from sitl.report.tlog import read_tlog

__all__ = ["Found", "SourceError", "find", "newest_flight", "read", "read_mission"]

#: in a folder; a file that is named itself may be a dataflash log as text (.log) too
_ENDINGS = {".jsonl": Kind.JOURNAL, ".tlog": Kind.TLOG, ".bin": Kind.DATAFLASH}
_TEXT_LOG = ".log"
#: files that are so far apart (s) are of different flights; a clock may be wrong by minutes
_APART_S = 900.0
#: a file that was last written this time (s) before another one is not read for the same flight
_DAYS_S = 2 * 86400.0


class SourceError(Exception):
    """The input has nothing to report. The message is one line."""


@dataclass(frozen=True, slots=True)
class Found:
    """Files of a flight, and the folders in which a mission lies, the likeliest first.

    `old`: files not to be read.
    """

    files: tuple[Path, ...]
    missions: tuple[Path, ...]
    old: tuple[Path, ...] = ()


def find(paths: Iterable[Path]) -> Found:
    """The files in what was given. Raises SourceError, naming the path that holds none."""
    files: dict[Path, Path] = {}
    missions: list[Path] = []
    old: list[Path] = []
    for path in paths:
        if path.is_dir():
            here = sorted(each for each in path.rglob("*") if each.suffix.lower() in _ENDINGS and each.is_file())
            here, past = _recent(here)
            old += past
            laid = sorted({each.parent for each in path.rglob(packages.MISSION_FILE)}, key=_age, reverse=True)
            if not here and not laid:
                raise SourceError(
                    f"{path}: no journals (*.jsonl), telemetry logs (*.tlog) or dataflash logs (*.bin) in it"
                )
        elif path.is_file() and (path.suffix.lower() in _ENDINGS or path.suffix.lower() == _TEXT_LOG):
            here = [path]
            laid = sorted(path.parent.glob(f"{path.stem}-mission-*"), key=_age, reverse=True)
        elif path.exists():
            endings = ", ".join([*_ENDINGS, _TEXT_LOG])
            raise SourceError(f"{path}: not a file that is known by its ending ({endings})")
        else:
            raise SourceError(f"{path}: no such file or folder")
        files.update((each.resolve(), each) for each in here)
        missions += [each for each in laid if each not in missions]
    beside = {strangers_path(each) for each in files}
    return Found(tuple(each for real, each in files.items() if real not in beside), tuple(missions), tuple(old))


def _recent(files: list[Path]) -> tuple[list[Path], list[Path]]:
    """The files of a folder, and those that were last written days before the newest.

    So a month of flights is not read for the last one. A dataflash log's date does not count: an autopilot may know
    none.
    """
    ages = {path: _age(path) for path in files if _ENDINGS[path.suffix.lower()] is not Kind.DATAFLASH}
    newest = max(ages.values(), default=0.0)
    past = [path for path, age in ages.items() if newest - age > _DAYS_S]
    return [path for path in files if path not in past], past


def _age(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def read_mission(folders: Sequence[Path]) -> MissionPackage | None:
    """The first mission that can be read. Raises SourceError when one is there and none can be."""
    why = ""
    for folder in folders:
        try:
            return packages.load(folder)
        except MissionError as error:
            why = why or str(error)
    if why:
        raise SourceError(why)
    return None


def read(files: Iterable[Path]) -> tuple[list[Strand], list[str]]:
    """Read the files; what told nothing is named with the reason. Raises SourceError when a file cannot be read."""
    strands, empty = [], []
    for path in files:
        kind = _ENDINGS.get(path.suffix.lower(), Kind.DATAFLASH)
        try:
            if kind is Kind.JOURNAL:
                strand = _read_journal(path)
            else:
                strand = read_tlog(path) if kind is Kind.TLOG else read_dataflash(path)
        except OSError as error:
            raise SourceError(f"{path}: cannot be read: {error.strerror or error}") from None
        except DataflashError as error:
            empty.append(str(error))
            continue
        if strand.span() is None:
            empty.append(f"{path}: a {kind.value} in which nothing is told")
        else:
            strands.append(strand)
    return _with_utc(strands, empty), empty


def _with_utc(strands: list[Strand], empty: list[str]) -> list[Strand]:
    """Journals with only monotonic time on the axis of those that have UTC too.

    They are of one computer if they lie in one folder or in its folders. If none has UTC, monotonic time is the axis.
    """
    bare = [strand for strand in strands if strand.kind is Kind.JOURNAL and strand.offset_s is None]
    if len(bare) == len(strands):
        return strands
    kept = []
    for strand in strands:
        if strand in bare:
            folder = strand.path.parent
            offset_s = next(
                (each.offset_s for each in strands if each.offset_s is not None and folder in each.path.parents), None
            )
            if offset_s is None:
                empty.append(f"{strand.path}: a journal without UTC")
                continue
            strand.own = [replace(entry, t=entry.t + offset_s) for entry in strand.own]
            strand.offset_s = offset_s
        kept.append(strand)
    return kept


def _read_journal(path: Path) -> Strand:
    """A journal, what was rolled over before it, and what strangers made it write."""
    strand = Strand(path, Kind.JOURNAL)
    entries: list[Entry] = []
    beside = strangers_path(path)
    for file in (path.with_name(path.name + ".1"), path, beside):
        if file != path and not file.is_file():
            continue
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            entry = parse_line(line)
            if entry is not None:
                entries.append(entry)
            elif line.strip():
                strand.broken += 1
    timed = by_utc(entries)
    offsets = [utc - entry.t for entry in entries if (utc := utc_of(entry.get("utc"))) is not None]
    strand.offset_s = median(offsets) if offsets else None
    strand.own = sorted(timed or entries, key=lambda entry: entry.t)
    speakers = [entry.who for entry in strand.own]
    strand.who = max(set(speakers), key=speakers.count, default="")
    strand.on_board = any(entry.event == "view" for entry in strand.own)
    return strand


def newest_flight(strands: Sequence[Strand]) -> tuple[list[Strand], list[Strand]]:
    """The strands of the newest flight, and those of others."""
    spans = {number: strand.span() or (0.0, 0.0) for number, strand in enumerate(strands)}
    groups: list[list[int]] = []
    end = 0.0
    for number in sorted(spans, key=lambda number: spans[number]):
        if not groups or spans[number][0] > end + _APART_S:
            groups.append([])
        groups[-1].append(number)
        end = max(end, spans[number][1])
    newest = set(groups[-1]) if groups else set()
    return (
        [strand for number, strand in enumerate(strands) if number in newest],
        [strand for number, strand in enumerate(strands) if number not in newest],
    )

# SPDX-License-Identifier: GPL-3.0-or-later

"""Puts files of different clocks on one axis of time, and says by how much each was shifted.

A computer that wrote a telemetry log was told the time by the vehicle: SYSTEM_TIME carries UTC of the GPS. How far the
computer's clock was ahead of that is the file's shift. Rules that live here:

* What was written beside a telemetry log, by the same computer, has the same shift.
* Two telemetry logs are compared by what both heard, the same moment of the vehicle's clock in each: by GPS time, and
  where there is none by the time since the autopilot was started. One of them, the reference, gives UTC for all.
* Of a journal without a telemetry log beside it the shift follows from the messages of handovers, which both ends wrote
  down: the quickest one each way takes equally long. This also makes the shift of a station's journal exact: GPS time
  comes with a link's delay, and messages of a handover follow each other in milliseconds.
* A dataflash log has GPS time itself. Where the vehicle's clock and the reference's do not run equally fast (a
  simulation at another speed) it is laid along the reference, moment by moment.
* What cannot be compared with anything is taken as it is, with a note.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from statistics import median

from sitl.report.journal_reader import Entry
from sitl.report.strand import Kind, Stamps, Strand, Tick

__all__ = ["Alignment", "Shift", "align", "by_utc", "utc_of"]

#: fewer readings than this say nothing
_FEWEST = 3
#: clocks of which one wanders more than this (s) against the other run at different speeds
_STEADY_S = 2.0
#: what part of the readings is taken as not late, of one clock, and of two
_LATE, _MIDDLE = 0.1, 0.5
#: shifts smaller than this (s) are not worth a word
_TELLING_S = 0.05
#: between two entries of one run of a program: a clock that was set by more begins another stretch
_CLOCK_STEP_S = 0.5
#: what messages of handovers correct at most where GPS time has spoken already
_FINE_S = 2.0

_Pairs = list[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Shift:
    """How the times of a file were brought to the axis: `ahead_s` seconds were taken off; None: moment by moment.

    `why` says what that rests on, in a few words.
    """

    ahead_s: float | None
    why: str

    def __str__(self) -> str:
        if self.ahead_s is None:
            return self.why
        if abs(self.ahead_s) < _TELLING_S:
            return f"not shifted: {self.why}"
        way = "ahead" if self.ahead_s > 0 else "behind"
        return f"{abs(self.ahead_s):.2f} s {way}, shifted: {self.why}"


@dataclass(slots=True)
class Alignment:
    """The shift of each file, in the order of the files.

    `by_gps`: whether UTC on the axis is that of a GPS.
    """

    shifts: list[Shift]
    by_gps: bool


def utc_of(text: object) -> float | None:
    """Seconds of UTC that a journal's `utc` says; None when it says nothing."""
    try:
        at = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return (at if at.tzinfo else at.replace(tzinfo=timezone.utc)).timestamp()


def by_utc(entries: Iterable[Entry]) -> list[Entry]:
    """A journal's entries with `t` as UTC of its writer (s); those without one are left out.

    Monotonic time is kept within a stretch in which the clock was not set: its differences are true.
    """
    found: list[Entry] = []
    stretch: list[tuple[Entry, float]] = []

    def close() -> None:
        if stretch:
            offset = median(utc - entry.t for entry, utc in stretch)
            found.extend(_at(entry, entry.t + offset) for entry, _ in stretch)
            stretch.clear()

    last = 0.0
    stamps = Stamps()
    for entry in entries:
        utc = utc_of(entry.get("utc"))
        if utc is None or not stamps.believed(utc):
            continue
        if stretch and abs((utc - entry.t) - last) > _CLOCK_STEP_S:
            close()
        last = utc - entry.t
        stretch.append((entry, utc))
    close()
    return found


def align(strands: Sequence[Strand]) -> Alignment:
    """Bring every strand to one axis; their times are changed in place."""
    shifts: dict[int, Shift] = {}
    reference = _reference(strands)
    by_gps = False
    if reference is not None:
        by_gps = _align_logs(strands, reference, shifts)
    for number, strand in enumerate(strands):
        if strand.kind is Kind.DATAFLASH and number not in shifts:
            gps = any(tick.gps_s is not None for tick in strand.ticks)
            by_gps = by_gps or gps
            shifts[number] = Shift(0.0, "it has GPS time" if gps else "no GPS time in it, and nothing to compare with")
    _align_journals(strands, shifts)
    for number in range(len(strands)):
        shifts.setdefault(number, Shift(0.0, "nothing to compare its clock with"))
    return Alignment([shifts[number] for number in range(len(strands))], by_gps)


# ---- telemetry and dataflash logs ---------------------------------------------------------------------------------


def _reference(strands: Sequence[Strand]) -> int | None:
    """The telemetry log that says the time: one with GPS time, on board before any other, the fullest."""
    worth = {
        number: (sum(tick.gps_s is not None for tick in strand.ticks) >= _FEWEST, strand.on_board, len(strand.ticks))
        for number, strand in enumerate(strands)
        if strand.kind is Kind.TLOG
    }
    return max(worth, key=lambda number: worth[number], default=None)


def _align_logs(strands: Sequence[Strand], reference: int, shifts: dict[int, Shift]) -> bool:
    """Shift all logs; returns whether GPS time was there."""
    base = strands[reference]
    ahead = [tick.t - tick.gps_s for tick in base.ticks if tick.gps_s is not None]
    gps, shift = False, Shift(0.0, "no GPS time in it")
    if len(ahead) >= _FEWEST:
        ahead_s = _steady(ahead, _LATE)
        gps = ahead_s is not None
        if ahead_s is not None:
            shift = Shift(ahead_s, f"GPS time, {len(ahead)} readings")
        else:
            shift = Shift(0.0, "the vehicle's clock ran at another speed, as in a simulation: this computer's is taken")
    shifts[reference] = shift
    for number, strand in enumerate(strands):
        if number == reference or strand.kind is Kind.JOURNAL:
            continue
        found = _against(base, strand, shift.ahead_s or 0.0, gps)
        if found is not None:
            shifts[number], to_axis = found
            _move(strand, to_axis)
    _move(base, _minus(shift.ahead_s or 0.0))
    return gps


def _against(
    base: Strand, strand: Strand, base_ahead_s: float, base_gps: bool
) -> tuple[Shift, Callable[[float], float]] | None:
    """The shift of a log that heard the same vehicle as the reference, `base`."""
    # what is read on board, beside the autopilot, is not late; of two stations both may be
    part = _LATE if base.on_board else _MIDDLE
    for words, key in (("GPS time", _gps), ("the autopilot's clock", _boot)):
        for sysid in dict.fromkeys(tick.sysid for tick in strand.ticks):
            pairs = _pairs(base.ticks, sysid, key)
            mine = _pairs(strand.ticks, sysid, key)
            differences = [t - there for clock, t in mine if (there := _at_clock(pairs, clock)) is not None]
            if len(differences) < _FEWEST:
                continue
            count = f"{len(differences)} readings"
            apart_s = _steady(differences, part)
            if apart_s is not None:
                ahead_s = apart_s + base_ahead_s
                return Shift(ahead_s, f"{words}, {count}"), _minus(ahead_s)
            if strand.kind is Kind.DATAFLASH:
                return Shift(None, f"laid along the telemetry by {words}, {count}"), _along(pairs, mine, base_ahead_s)
    mine_ahead = [tick.t - tick.gps_s for tick in strand.ticks if tick.gps_s is not None]
    own_ahead_s = _steady(mine_ahead, _LATE) if base_gps else None
    if own_ahead_s is not None:
        ahead_s = own_ahead_s
        return Shift(ahead_s, f"GPS time, {len(mine_ahead)} readings"), _minus(ahead_s)
    return None


def _gps(tick: Tick) -> float | None:
    return tick.gps_s


def _boot(tick: Tick) -> float | None:
    return tick.boot_s


def _pairs(ticks: Sequence[Tick], sysid: int, key: Callable[[Tick], float | None]) -> _Pairs:
    """Time by the vehicle's clock and by the file's, rising in both."""
    found: _Pairs = []
    for tick in sorted(ticks, key=lambda tick: tick.t):
        clock = key(tick)
        if tick.sysid == sysid and clock is not None and (not found or clock > found[-1][0]):
            found.append((clock, tick.t))
    return found


def _at_clock(pairs: _Pairs, clock: float) -> float | None:
    """The file's time at a moment of the vehicle's clock, None outside what the file knows."""
    place = bisect_left(pairs, (clock,))
    if place == len(pairs) or (place == 0 and pairs[0][0] != clock):
        return None
    if place == 0:
        return pairs[0][1]
    (c0, t0), (c1, t1) = pairs[place - 1], pairs[place]
    return t0 + (t1 - t0) * (clock - c0) / (c1 - c0)


def _along(pairs: _Pairs, mine: _Pairs, base_ahead_s: float) -> Callable[[float], float]:
    """From a file's time to the axis, by way of the vehicle's clock."""
    by_time = [(t, clock) for clock, t in mine]

    def to_axis(t: float) -> float:
        clock = _line(by_time, t)
        return _line(pairs, clock) - base_ahead_s

    return to_axis


def _line(points: _Pairs, at: float) -> float:
    """The value of a line through points at a place, continued beyond its ends."""
    place = min(max(bisect_left(points, (at,)), 1), len(points) - 1)
    (x0, y0), (x1, y1) = points[place - 1], points[place]
    return y0 + (y1 - y0) * (at - x0) / (x1 - x0)


def _steady(differences: Sequence[float], part: float) -> float | None:
    """How far one clock is ahead of another, from readings in the order of time.

    None: it is not one number. `part` of the readings lie below the result. A reading can only be late, never early: of
    one clock against GPS time the low ones are true, of two that both read late the middle ones. Quarters of the time
    are compared. So readings which are late by seconds, on a bad link, do not look like a clock that runs wrong.
    """
    if len(differences) < _FEWEST:
        return None
    size = max(_FEWEST, len(differences) // 4)
    quarters = [_ranked(differences[place : place + size], part) for place in range(0, len(differences), size)]
    return _ranked(differences, part) if max(quarters) - min(quarters) < _STEADY_S else None


def _ranked(values: Sequence[float], part: float) -> float:
    return sorted(values)[int(part * (len(values) - 1))]


# ---- journals -----------------------------------------------------------------------------------------------------


def _align_journals(strands: Sequence[Strand], shifts: dict[int, Shift]) -> None:
    journals = [number for number, strand in enumerate(strands) if strand.kind is Kind.JOURNAL]
    for number in journals:
        beside = _beside(strands, number)
        if beside is not None and beside in shifts and shifts[beside].ahead_s is not None:
            ahead_s = shifts[beside].ahead_s or 0.0
            shifts[number] = Shift(ahead_s, f"as {strands[beside].path.name} beside it")
            _move(strands[number], _minus(ahead_s))
    companions = [number for number in journals if any(entry.event == "view" for entry in strands[number].own)]
    for number in journals:
        companion = next((each for each in companions if _share(strands[each], strands[number])), None)
        if number in companions or companion is None:
            continue
        fine = _by_messages(strands[companion], strands[number])
        known = number in shifts
        if fine is None or (known and abs(fine[0]) > _FINE_S):
            continue
        ahead_s, count = fine
        coarse_s = (shifts[number].ahead_s or 0.0) if known else 0.0
        why = f"messages of handovers, {count} of them"
        if known:
            why = f"{shifts[number].why}, made exact by {why}"
        shifts[number] = Shift(coarse_s + ahead_s, why)
        _move(strands[number], _minus(ahead_s))
        beside = _beside(strands, number)
        if beside is None:
            continue
        # the same computer has one clock, and GPS time comes with a delay
        _move(strands[beside], _minus(ahead_s))
        if beside not in shifts:
            shifts[beside] = Shift(ahead_s, f"as {strands[number].path.name} beside it")


def _beside(strands: Sequence[Strand], number: int) -> int | None:
    """The telemetry log that the writer of a journal wrote at the same time.

    It is the only one in the folder, or has the journal's name.
    """
    journal = strands[number]
    there = [
        other
        for other, strand in enumerate(strands)
        if strand.kind is Kind.TLOG and strand.path.parent == journal.path.parent
    ]
    named = [other for other in there if strands[other].path.stem == journal.path.stem]
    journals = [
        strand for strand in strands if strand.kind is Kind.JOURNAL and strand.path.parent == journal.path.parent
    ]
    alone = there if len(there) == 1 and len({strand.who for strand in journals}) == 1 else []
    return next(iter(named or alone), None)


def _share(one: Strand, other: Strand) -> bool:
    return _by_messages(one, other) is not None


def _by_messages(vehicle: Strand, station: Strand) -> tuple[float, int] | None:
    """How far the station's journal is ahead of the vehicle's (s), and how many messages show that.

    None: there are too few.
    """
    ways: dict[bool, list[float]] = {True: [], False: []}
    mine, theirs = _sent(vehicle, station.who), _sent(station, "")
    for key, at in mine.items():
        other = theirs.get(key)
        if at is not None and other is not None:
            ways[key[3] == "out"].append(other - at)
    down, up = ways[True], ways[False]
    if not down or not up or len(down) + len(up) < _FEWEST:
        return None
    # what the vehicle sends comes late at the station, and the other way round: the quickest of each are equally late
    return (min(down) + max(up)) / 2.0, len(down) + len(up)


def _sent(strand: Strand, other: str) -> dict[tuple[str, int, int, str], float | None]:
    """Messages of transfers between vehicle and station that are in a journal exactly once: when; None: more often.

    The key ends with the way as the vehicle sees it.
    """
    found: dict[tuple[str, int, int, str], float | None] = {}
    on_ground = not other
    for entry in strand.own:
        if entry.event != "message" or entry.get("via") == "ground":
            continue
        if other and entry.get("station") != other:
            continue
        if on_ground and entry.get("direction") not in ("in", "out"):
            continue
        way = str(entry.get("direction"))
        if on_ground:
            way = "in" if way == "out" else "out"
        key = (str(entry.get("name")), _whole(entry.get("handover_id")), _whole(entry.get("epoch")), way)
        found[key] = entry.t if key not in found else None
    return found


def _whole(value: object) -> int:
    return value if isinstance(value, int) else -1


# ---- moving -------------------------------------------------------------------------------------------------------


def _minus(ahead_s: float) -> Callable[[float], float]:
    return lambda t: t - ahead_s


def _at(entry: Entry, t: float) -> Entry:
    return Entry(t, entry.who, entry.event, entry.text, entry.fields)


def _move(strand: Strand, to_axis: Callable[[float], float]) -> None:
    """Move everything in a strand but its ticks, which stay what the file said."""
    strand.own = [_at(entry, to_axis(entry.t)) for entry in strand.own]
    for group in (strand.seen, strand.told):
        for sysid, entries in group.items():
            group[sysid] = [_at(entry, to_axis(entry.t)) for entry in entries]
    strand.silences = {
        sysid: [(to_axis(begin), to_axis(end)) for begin, end in spans] for sysid, spans in strand.silences.items()
    }

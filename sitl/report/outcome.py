# SPDX-License-Identifier: GPL-3.0-or-later

"""The outcome of a flight in a few sentences, and the stretches in which something was wrong.

The most serious sentence comes first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from mavproxy_handover.core.common.levels import DECISION_LEVELS, Level
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.mission.geodesy import distance_m
from sitl.report.evidence import NOBODY, CommanderChange, Evidence
from sitl.report.exchange import Exchange
from sitl.report.journal_reader import Entry
from sitl.report.times import Times, duration
from sitl.report.watch import VEHICLE, Sample

__all__ = ["Gravity", "Line", "Stretch", "emergencies", "level_of", "outcome"]

#: a shorter time (s) without a commander in flight is the pause of a handover or of a restart
_PAUSE_S = 0.5
#: a landing nearer than this (m) to a place is at it
_NEAR_M = 10.0
#: a position wanders by less than this (m) on the ground
_MOVED_M = 25.0
#: more commanders than these in a row are not named
_MOST_NAMES = 6


class Gravity(IntEnum):
    """How a sentence is meant."""

    PLAIN = 0
    GOOD = 1
    WARNING = 2
    BAD = 3


@dataclass(frozen=True, slots=True)
class Line:
    """One sentence."""

    gravity: Gravity
    text: str


@dataclass(frozen=True, slots=True)
class Stretch:
    """From when to when (t of the entries), and what it was."""

    begin_t: float
    end_t: float
    why: str
    #: by the action of its decision, as at the stations
    level: Level = Level.EMERGENCY

    @property
    def word(self) -> str:
        """Its name, in small letters."""
        if self.level is Level.EMERGENCY:
            return "emergency"
        return "held" if self.why.endswith(": hold") else "warning"


def level_of(entry: Entry) -> Level:
    """The level of an entry "emergency", by the vehicle's own table of decisions. Without an action: an emergency."""
    word = str(entry.get("action") or entry.text.rpartition(": ")[2]).upper()
    action = FlightAction.__members__.get(word)
    return Level.EMERGENCY if action is None else DECISION_LEVELS[action]


def _warns(entry: Entry) -> bool:
    return level_of(entry) < Level.EMERGENCY


def emergencies(evidence: Evidence) -> list[Stretch]:
    """Warnings and emergencies, each from its beginning to its end.

    It ends at the landing or at the end of the record, too. A hold that a return follows ends where the return begins.
    """
    found: list[Stretch] = []
    begun: Entry | None = None
    for entry in evidence.entries:
        if entry.event == "emergency" and begun is None:
            begun = entry
        elif entry.event == "emergency" and begun is not None and _warns(begun) and not _warns(entry):
            found.append(_stretch(begun, entry.t))
            begun = entry
        elif begun is not None and (
            (entry.event == "emergency_over" and entry.who == begun.who)
            or (entry.who == VEHICLE and entry.event in ("landed", "disarmed"))
        ):
            found.append(_stretch(begun, entry.t))
            begun = None
    if begun is not None:
        found.append(_stretch(begun, evidence.entries[-1].t))
    return found


def _stretch(begun: Entry, end_t: float) -> Stretch:
    return Stretch(begun.t, end_t, _why(begun), level_of(begun))


def _why(entry: Entry) -> str:
    return entry.text or str(entry.get("reason", "emergency")).replace("_", " ")


def outcome(evidence: Evidence, transfers: Sequence[Exchange], times: Times) -> list[Line]:
    """The sentences, in the order of their importance to a reader."""
    lines = [_end(evidence, times)]
    if evidence.begins_in_air:
        height_m = evidence.samples[0].alt_m
        lines.append(Line(Gravity.WARNING, f"The record begins in the air, {height_m:.0f} m above home."))
    lines += _wrong(evidence, times)
    lines += _handovers(evidence, transfers)
    lines += _alone(evidence)
    lines += _restarts(evidence)
    lines += _battery(evidence)
    lines += _refusals(evidence)
    return lines


def _end(evidence: Evidence, times: Times) -> Line:
    """Where and how it ended."""
    airborne = evidence.of(VEHICLE, "airborne")
    landed = [entry for entry in evidence.of(VEHICLE, "landed") if not airborne or entry.t >= airborne[0].t]
    if not airborne and not landed:
        if evidence.of(event="rehearsal"):
            return Line(Gravity.PLAIN, "It was carried, and did not fly.")
        moved = any(_apart_m(evidence.samples[0], sample) > _MOVED_M for sample in evidence.samples)
        words = "It moved; how high, these files do not tell." if moved else "It did not leave the ground."
        return Line(Gravity.PLAIN, words)
    if airborne and (not landed or landed[-1].t < airborne[-1].t):
        last = evidence.samples[-1] if evidence.samples else None
        height = "" if last is None else f", {last.alt_m:.0f} m above home"
        return Line(Gravity.BAD, f"What is recorded ends in the air{height}, at {times.plus(evidence.entries[-1].t)}.")
    spans = evidence.flights()
    took = sum(max(times.plus_s(end) - times.plus_s(begin), 0.0) for begin, end in spans)
    several = f"{len(spans)} flights, " if len(spans) > 1 else ""
    flown = f" after {several}{duration(took)} in the air" if spans else ""
    if any(entry.get("by_height") for entry in landed):
        flown += ", by the height alone"
    armed = evidence.armed_at_end()
    motors = ", its motors armed to the end" if armed else ""
    where = _place(evidence, landed[-1])
    return Line(Gravity.BAD if armed else Gravity.GOOD, f"Landed{where}{flown}{motors}.")


def _apart_m(one: Sample, other: Sample) -> float:
    return distance_m(one.lat_deg, one.lon_deg, other.lat_deg, other.lon_deg)


def _place(evidence: Evidence, landed: Entry) -> str:
    lat, lon = landed.get("lat_deg"), landed.get("lon_deg")
    mission = evidence.mission
    if lat is None or lon is None:
        return ""
    if mission is None:
        return f" at {lat:.6f} {lon:.6f}"
    route = mission.route
    places = [("home", route.home.lat_deg, route.home.lon_deg)]
    places += [(f"rally point {number}", each.lat_deg, each.lon_deg) for number, each in enumerate(route.rally, 1)]
    places += [(f"waypoint {item.seq}", item.lat_deg, item.lon_deg) for item in route.items if item.has_place]
    name, away_m = min(
        ((name, distance_m(lat, lon, *there)) for name, *there in places), key=lambda place: round(place[1] - 0.5)
    )
    return f" at {name}, {away_m:.1f} m off" if away_m < _NEAR_M else f" {away_m:.0f} m from {name}"


def _wrong(evidence: Evidence, times: Times) -> list[Line]:
    found = emergencies(evidence)
    lines = [
        Line(
            Gravity.BAD if each.level is Level.EMERGENCY else Gravity.WARNING,
            f"{each.word.capitalize()} at {times.plus(each.begin_t)}, for "
            f"{duration(times.plus_s(each.end_t) - times.plus_s(each.begin_t))}: {each.why}.",
        )
        for each in found
    ]
    lines += [Line(Gravity.BAD, f"Internal fault: {_why(entry)}") for entry in evidence.of(event="failed_closed")]
    # leases and the guard's record say who commands, and nothing of emergencies
    grave = any(line.gravity is Gravity.BAD for line in lines)
    if not grave and any(entry.get("phase") for entry in evidence.of(event="view")):
        lines.append(Line(Gravity.GOOD, "No emergency."))
    modes = evidence.modes_flown()
    if modes:
        lines.append(Line(Gravity.PLAIN, f"Modes flown: {' → '.join(modes)}."))
    return lines


def _handovers(evidence: Evidence, transfers: Sequence[Exchange]) -> list[Line]:
    done = [each for each in transfers if each.committed]
    failed = [each for each in transfers if not each.committed]
    if not transfers:
        if len(evidence.commanders()) < 2:
            return [Line(Gravity.PLAIN, "No handover.")]
        names = [each.commander for each in evidence.commanders()]
        way = " → ".join([*names[:_MOST_NAMES], *(["…"] if len(names) > _MOST_NAMES else [])])
        return [Line(Gravity.PLAIN, f"Authority moved, {way}; these files do not tell how.")]
    took = sorted(each.duration_s for each in done if each.duration_s is not None)
    spread = "" if not took else f", in {duration(took[0])}" + (f" to {duration(took[-1])}" if len(took) > 1 else "")
    lines = [Line(Gravity.GOOD if done else Gravity.WARNING, f"{_count(len(done), 'handover')} committed{spread}.")]
    if failed:
        reasons = Counter(each.reason.replace("_", " ") if each.ended_t else "not ended" for each in failed)
        words = ", ".join(f"{reason} {count}×" if count > 1 else reason for reason, count in reasons.most_common())
        lines.append(Line(Gravity.WARNING, f"{_count(len(failed), 'attempt')} came to nothing: {words}."))
    return lines


def _alone(evidence: Evidence) -> list[Line]:
    """How long no station commanded in the air."""
    changes = evidence.commanders()
    armed = evidence.of(VEHICLE, "armed")
    spans = evidence.flights() or ([(armed[0].t, evidence.entries[-1].t)] if armed else [])
    total = sum(_alone_s(evidence, changes, begin, end) for begin, end in spans) if changes else 0.0
    return [Line(Gravity.BAD, f"No station commanded for {duration(total)} in the air.")] if total > _PAUSE_S else []


def _alone_s(evidence: Evidence, changes: Sequence[CommanderChange], begin: float, end: float) -> float:
    """How long no station commanded between two moments (s)."""
    dead_t = evidence.companion_ended_t()
    edges = [*(change.t for change in changes), min(dead_t, end)]
    total = 0.0
    for change, until in zip(changes, edges[1:], strict=True):
        if change.commander == NOBODY:
            total += max(0.0, evidence.sim_at(min(until, end)) - evidence.sim_at(max(change.t, begin)))
    return total + (max(0.0, evidence.sim_at(end) - evidence.sim_at(max(dead_t, begin))) if dead_t < end else 0.0)


def _restarts(evidence: Evidence) -> list[Line]:
    again = evidence.of(event="restarted")
    if not again:
        return []
    why = [entry.text.removeprefix("started again by the supervisor: ") for entry in evidence.of(event="started_again")]
    words = f": {'; '.join(dict.fromkeys(why))}" if why else ""
    return [Line(Gravity.WARNING, f"The companion was restarted in flight {_times(len(again))}{words}.")]


def _battery(evidence: Evidence) -> list[Line]:
    known = [entry.get("percent") for entry in evidence.of(VEHICLE, "battery") if entry.get("percent") is not None]
    if not known:
        return []
    return [
        Line(Gravity.WARNING if known[-1] < 20 else Gravity.PLAIN, f"Battery {known[0]:.0f} % to {known[-1]:.0f} %.")
    ]


def _refusals(evidence: Evidence) -> list[Line]:
    refused = evidence.of(event="refused")
    if not refused:
        return []
    count = len(refused) + sum(int(entry.get("also") or 0) for entry in refused)
    by = Counter(str(entry.get("station", "?")) for entry in refused)
    return [Line(Gravity.PLAIN, f"{_count(count, 'frame')} refused, of {', '.join(by)}.")]


def _count(number: int, what: str) -> str:
    return f"{number or 'No'} {what}{'' if number == 1 else 's'}"


def _times(number: int) -> str:
    return {1: "once", 2: "twice"}.get(number, f"{number} times")

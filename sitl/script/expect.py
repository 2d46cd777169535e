# SPDX-License-Identifier: GPL-3.0-or-later

"""The words of a scenario's expectations, judged after the run on its journals, and on its stations' logs.

Each judgement says what was wanted and what was seen, whether it held or not. `ALWAYS` are expectations of every run:
no program died unbidden, none noted a fault, and authority never was in two hands, which the epoch proves: each
change of commander has a higher one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Final

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import COMMANDS, LANDINGS, RETURN_TO_LAUNCH
from sitl.report.evidence import NOBODY, Evidence
from sitl.report.journal_reader import Entry
from sitl.report.loss import Heard
from sitl.report.matching import Match, describe, last_line, matches
from sitl.report.record import Verdict
from sitl.report.watch import VEHICLE

__all__ = ["ALWAYS", "EXPECTATIONS", "Corrections", "Expectation", "Loss", "OfVehicle"]

#: two programs may give the same moment times that differ by so much (s)
_SAME_MOMENT_S: Final = 0.1
#: more numbers than these are told as a range
_SHOWN: Final = 12


@dataclass(frozen=True, slots=True)
class Expectation:
    """Base of the expectations."""

    def labels(self) -> tuple[str, ...]:
        """Labels of steps that the expectation names."""
        return ()

    def judge(self, evidence: Evidence) -> Verdict:
        """Look at the evidence. Never raises on account of what is or is not in it."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Commanders(Expectation):
    """Only these stations commanded, in this order.

    The word `nobody` stands for the loss of authority.
    """

    value: tuple[str, ...]

    def judge(self, evidence: Evidence) -> Verdict:
        seen = [change.commander for change in evidence.commanders()]
        return Verdict(seen == list(self.value), f"commanders {_chain(self.value)}", _chain(seen))


@dataclass(frozen=True, slots=True)
class Handovers(Expectation):
    """So many transfers were committed, each with its duration (none longer than `within_s`), and so many aborted."""

    committed: int
    aborted: int = 0
    within_s: float | None = None

    def judge(self, evidence: Evidence) -> Verdict:
        done = evidence.of(event="transfer_committed")
        aborted = evidence.of(event="transfer_aborted")
        times = [entry.get("duration_s") for entry in done]
        most_s = inf if self.within_s is None else self.within_s
        timed = all(isinstance(time, (int, float)) and 0 <= time <= most_s for time in times)
        shown = ", ".join(f"{time * 1000:.0f} ms" if isinstance(time, (int, float)) else "no time" for time in times)
        seen = f"{len(done)} committed" + (f" ({shown})" if shown else "") + f", {len(aborted)} aborted"
        held = len(done) == self.committed and len(aborted) == self.aborted and timed
        limit = "" if self.within_s is None else f" within {self.within_s:g} s"
        return Verdict(held, f"handovers: {self.committed} committed{limit}, {self.aborted} aborted", seen)


@dataclass(frozen=True, slots=True)
class Count(Expectation):
    """So many entries with this source, this event and these values are in the journals: exactly, or within limits."""

    event: str
    who: str = ""
    count: int | None = None
    at_least: int | None = None
    at_most: int | None = None
    match: Match = field(default_factory=Match)

    def __post_init__(self) -> None:
        if self.count is None and self.at_least is None and self.at_most is None:
            raise ValueError("needs one of count, at_least, at_most")

    def judge(self, evidence: Evidence) -> Verdict:
        number = sum(matches(entry, self.who, self.event, self.match) for entry in evidence.entries)
        low = self.count if self.count is not None else self.at_least
        high = self.count if self.count is not None else self.at_most
        held = (low is None or number >= low) and (high is None or number <= high)
        parts = [f"exactly {self.count}"] if self.count is not None else []
        parts += [f"at least {self.at_least}"] if self.at_least is not None else []
        parts += [f"at most {self.at_most}"] if self.at_most is not None else []
        return Verdict(held, f"{' and '.join(parts)}: {describe(self.who, self.event, self.match)}", str(number))


@dataclass(frozen=True, slots=True)
class Number(Expectation):
    """A number in every entry with this source, this event and these values, of which there is at least one."""

    event: str
    key: str
    who: str = ""
    above: float | None = None
    below: float | None = None
    match: Match = field(default_factory=Match)

    def __post_init__(self) -> None:
        if self.above is None and self.below is None:
            raise ValueError("needs above or below")

    def judge(self, evidence: Evidence) -> Verdict:
        low, high = (-inf if self.above is None else self.above), (inf if self.below is None else self.below)
        found = [entry.get(self.key) for entry in evidence.entries if matches(entry, self.who, self.event, self.match)]
        held = bool(found) and all(isinstance(value, (int, float)) and low < value < high for value in found)
        limits = [f"above {low:g}"] * (self.above is not None) + [f"below {high:g}"] * (self.below is not None)
        wanted = f"{self.key} {' and '.join(limits)}: {describe(self.who, self.event, self.match)}"
        seen = ", ".join(map(str, found)) or "no such entry"
        if held and len(found) > _SHOWN:
            seen = f"{min(found)} to {max(found)} in {len(found)} entries"
        return Verdict(held, wanted, seen)


@dataclass(frozen=True, slots=True)
class Follows(Expectation):
    """Every entry with this source, this event and these values follows another event of that source in time.

    There must be at least one such entry. It comes within `within_s` after the last `after` before it. Both must be
    about the same station, if both name one, and `after` about item `number`, if one is given.
    """

    event: str
    after: str
    within_s: float
    who: str = ""
    number: int | None = None
    match: Match = field(default_factory=Match)

    def judge(self, evidence: Evidence) -> Verdict:
        of = self.after.replace("_", " ") + (f" {self.number}" if self.number is not None else "")
        wanted = f"{describe(self.who, self.event, self.match)} within {self.within_s:g} s after {of}"
        delays: list[float | None] = []
        for entry in evidence.entries:
            if matches(entry, self.who, self.event, self.match):
                before = [other.t for other in evidence.of(entry.who, self.after) if self._leads(other, entry)]
                delays.append(entry.t - before[-1] if before else None)
        held = bool(delays) and all(delay is not None and delay <= self.within_s for delay in delays)
        shown = ["never before it" if delay is None else f"after {delay:.3f} s" for delay in delays]
        return Verdict(held, wanted, ", ".join(shown) or "no such entry")

    def _leads(self, other: Entry, entry: Entry) -> bool:
        stations = other.get("station"), entry.get("station")
        same = None in stations or stations[0] == stations[1]
        return other.t <= entry.t and same and self.number in (None, other.get("number"))


@dataclass(frozen=True, slots=True)
class Corrections(Expectation):
    """From one moment to another, RTK corrections reach the autopilot without a longer pause. Labels name the moments.

    What counts is the autopilot's own log. A vehicle that writes none is judged by the listener on its line.
    """

    after: str
    until: str
    gap_below_s: float

    def labels(self) -> tuple[str, ...]:
        return (self.after, self.until)

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = f"corrections without a gap of {self.gap_below_s:g} s from '{self.after}' to '{self.until}'"
        marks, logged = evidence.notes.marks, evidence.notes.corrections
        if self.after not in marks or self.until not in marks:
            return Verdict(False, wanted, "one of the two never came")
        begin, end = (evidence.sim_at(marks[label]) for label in self.labels())
        lined = [
            evidence.sim_at(entry.t)
            for entry in evidence.of(event="to_autopilot")
            if entry.get("what") == "GPS_RTCM_DATA"
        ]
        inside = [time for time in (lined if logged is None else logged) if begin <= time <= end]
        longest = max(later - earlier for earlier, later in pairwise([begin, *inside, end]))
        source = "on the autopilot's line" if logged is None else "in the autopilot's log"
        seen = f"{len(inside)} {source}, the longest gap is {longest:.2f} s"
        return Verdict(bool(inside) and longest < self.gap_below_s, wanted, seen)


@dataclass(frozen=True, slots=True)
class Quiet(Expectation):
    """No entry with this source, one of these events and these values between two moments.

    Labels of steps name both moments.
    """

    event: tuple[str, ...]
    after: str
    until: str
    who: str = ""
    match: Match = field(default_factory=Match)

    def labels(self) -> tuple[str, ...]:
        return (self.after, self.until)

    def judge(self, evidence: Evidence) -> Verdict:
        events = " or ".join(describe(self.who, event, self.match) for event in self.event)
        wanted = f"no {events} from '{self.after}' to '{self.until}'"
        begin, end = (evidence.notes.marks.get(label) for label in self.labels())
        if begin is None or end is None:
            return Verdict(False, wanted, "one of the two never came")
        found = [
            entry
            for entry in evidence.entries
            if begin <= entry.t < end and any(matches(entry, self.who, event, self.match) for event in self.event)
        ]
        seen = ", ".join(f"{entry.event.replace('_', ' ')} after {entry.t - begin:.1f} s" for entry in found)
        return Verdict(not found, wanted, seen or f"none in {end - begin:.1f} s")


@dataclass(frozen=True, slots=True)
class Memory(Expectation):
    """The companion's memory grows by less than so much from one moment to another, both named by labels of steps."""

    after: str
    until: str
    grows_below_mb: float

    def labels(self) -> tuple[str, ...]:
        return (self.after, self.until)

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = f"memory grows by less than {self.grows_below_mb:g} MB from '{self.after}' to '{self.until}'"
        marks = evidence.notes.marks
        begin, end = marks.get(self.after), marks.get(self.until)
        if begin is None or end is None:
            return Verdict(False, wanted, "one of the two never came")
        sizes = [entry.get("resident_kb") for entry in evidence.of(event="memory") if begin <= entry.t <= end]
        if len(sizes) < 2:
            return Verdict(False, wanted, "it was not measured")
        grown = (max(sizes) - sizes[0]) / 1024
        return Verdict(
            grown < self.grows_below_mb, wanted, f"{sizes[0] / 1024:.1f} MB, grown by {grown:.1f} MB at most"
        )


@dataclass(frozen=True, slots=True)
class Commands(Expectation):
    """The commands named by `what` that the gate accepted and refused, exactly, station by station.

    Written as STATION = [accepted, refused]; a station that is not named must have neither.
    """

    what: tuple[str, ...]
    match: Match

    def __post_init__(self) -> None:
        for station, pair in self.match.values:
            good = isinstance(pair, list) and len(pair) == 2 and all(isinstance(n, int) and n >= 0 for n in pair)
            if not good:
                raise ValueError(f"{station}: {pair!r} must be [accepted, refused], two whole numbers")

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = {station: (pair[0], pair[1]) for station, pair in self.match.values}
        seen: dict[str, tuple[int, int]] = {}
        for word, place in (("accepted", 0), ("refused", 1)):
            for entry in evidence.of(event=word):
                if not matches(entry, match=Match((("what", list(self.what)),))):
                    continue
                pair = list(seen.get(str(entry.get("station", "?")), (0, 0)))
                pair[place] += 1
                seen[str(entry.get("station", "?"))] = (pair[0], pair[1])
        everyone = {**dict.fromkeys(wanted, (0, 0)), **seen}
        held = all(wanted.get(station, (0, 0)) == pair for station, pair in everyone.items())
        return Verdict(held, f"{_pairs(wanted)} of {', '.join(self.what)}", _pairs(everyone))


@dataclass(frozen=True, slots=True)
class Modes(Expectation):
    """The flight modes from leaving the ground to touching it, in this order and no others."""

    value: tuple[str, ...]

    def judge(self, evidence: Evidence) -> Verdict:
        seen = evidence.modes_flown()
        return Verdict(seen == list(self.value), f"modes {_chain(self.value)}", _chain(seen))


@dataclass(frozen=True, slots=True)
class ModeWithin(Expectation):
    """The autopilot shows a mode within so many simulated seconds after the moment that a step's label names.

    The moment is often an entry of the companion, the mode is an entry of the observer. The clocks of two programs
    differ by up to one step of the vehicle. So an answer in the same step may have the earlier time.
    """

    mode: str
    after: str
    within_s: float

    def labels(self) -> tuple[str, ...]:
        return (self.after,)

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = f"mode {self.mode} within {self.within_s:g} s after '{self.after}'"
        mark = evidence.notes.marks.get(self.after)
        if mark is None:
            return Verdict(False, wanted, f"'{self.after}' never came")
        for entry in evidence.of(VEHICLE, "mode"):
            if entry.t >= mark - _SAME_MOMENT_S and entry.get("mode") == self.mode:
                took = max(0.0, evidence.sim_at(entry.t) - evidence.sim_at(mark))
                return Verdict(took <= self.within_s, wanted, f"after {took:.1f} s")
        return Verdict(False, wanted, "the mode was never shown after that")


@dataclass(frozen=True, slots=True)
class Landed(Expectation):
    """The aircraft flew, landed and disarmed; near home or a rally point if `near` says so."""

    within_m: float
    near: tuple[str, ...] = ("home", "rally")

    def __post_init__(self) -> None:
        for word in self.near:
            if word not in ("home", "rally", "last_item") and not re.fullmatch(r"rally [1-9]\d?", word):
                raise ValueError(f"near: {word!r} must be one of home, rally, rally 1 and so on, last_item")

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = f"landed within {self.within_m:g} m of {' or '.join(self.near)}, disarmed"
        landings = evidence.of(VEHICLE, "landed")
        if not landings:
            return Verdict(False, wanted, "never landed")
        if evidence.armed_at_end():
            return Verdict(False, wanted, "still armed at the end")
        place = landings[-1]
        if place.get("lat_deg") is None:
            return Verdict(False, wanted, "landed at an unknown place")
        away = sorted(
            (distance_m(place.get("lat_deg"), place.get("lon_deg"), lat, lon), word)
            for word, lat, lon in _landing_places(evidence)
            if word.split()[0] in self.near or word.replace(" point", "") in self.near
        )
        if not away:
            return Verdict(False, wanted, "the mission has no such place")
        return Verdict(away[0][0] <= self.within_m, wanted, f"{away[0][0]:.1f} m from {away[0][1]}")


@dataclass(frozen=True, slots=True)
class ItemsReached(Expectation):
    """The autopilot said of every mission item that is flown to that it reached it ("all").

    A landing that ends the mission is not among them: ArduCopter disarms instead of saying so.
    """

    value: str

    def __post_init__(self) -> None:
        if self.value != "all":
            raise ValueError(f"{self.value!r} must be 'all'")

    def judge(self, evidence: Evidence) -> Verdict:
        route = evidence.package.route.items
        wanted = [item.seq for item in route if COMMANDS[item.command].flown]
        if route[-1].command in (*LANDINGS, RETURN_TO_LAUNCH):
            wanted.remove(route[-1].seq)
        numbers = [entry.get("number") for entry in evidence.of(VEHICLE, "reached")]
        missing = [number for number in wanted if number not in numbers]
        seen = "all reached" if not missing else f"not reached: {', '.join(map(str, missing))}"
        return Verdict(not missing, f"mission items {', '.join(map(str, wanted))} reached", seen)


@dataclass(frozen=True, slots=True)
class Emergencies(Expectation):
    """The companion declared emergencies for these reasons, in this order; an empty list: none."""

    value: tuple[str, ...]

    def judge(self, evidence: Evidence) -> Verdict:
        seen = [str(entry.get("reason", "no reason")) for entry in evidence.of(event="emergency")]
        return Verdict(
            seen == list(self.value),
            f"emergencies: {', '.join(self.value) or 'none'}",
            ", ".join(seen) or "none",
        )


@dataclass(frozen=True, slots=True)
class Said(Expectation):
    """The autopilot said this (STATUSTEXT; * and ? stand for anything)."""

    value: str

    def judge(self, evidence: Evidence) -> Verdict:
        match = Match((("text", self.value),))
        heard = [entry.text for entry in evidence.of(VEHICLE, "said") if matches(entry, match=match)]
        return Verdict(bool(heard), f"autopilot says {self.value!r}", heard[0] if heard else "it did not")


@dataclass(frozen=True, slots=True)
class Loss(Expectation):
    """In every station's log so much is missing at most (%), by the count of pymavlink: its program shows no more."""

    below_percent: float

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = f"every station's log has lost less than {self.below_percent:g} %"
        found = evidence.notes.losses
        held = bool(found) and all(
            isinstance(one, Heard) and one.heard > 0 and one.percent < self.below_percent for one in found.values()
        )
        seen = "; ".join(one if isinstance(one, str) else f"{name} {one}" for name, one in sorted(found.items()))
        return Verdict(held, wanted, seen or "no log of any station")


@dataclass(frozen=True, slots=True)
class Countdown(Expectation):
    """The seconds to each handover that both its stations showed were right within so much.

    Judged are the last `last_s` seconds before the transfer was committed. In that time each of the two stations must
    have shown at least half as many values.
    """

    last_s: float
    within_s: float

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = f"countdowns right within {self.within_s:g} s over the last {self.last_s:g} s"
        done = evidence.of(event="transfer_committed")
        worst, faults = 0.0, [] if done else ["no handover was made"]
        for entry in done:
            came, taker = evidence.sim_at(entry.t), str(entry.get("station"))
            changes = [change.commander for change in evidence.commanders() if change.t < entry.t - _SAME_MOMENT_S]
            for station in (changes[-1] if changes else NOBODY, taker):
                errors = [
                    shown + at - came
                    for at, shown in self._shown(evidence, station, taker)
                    if came - self.last_s <= at < came
                ]
                if len(errors) < self.last_s / 2:
                    faults.append(f"{station} showed {len(errors)} values before {taker} got it")
                worst = max([worst, *map(abs, errors)])
        held = not faults and worst <= self.within_s
        return Verdict(held, wanted, "; ".join([f"{worst:.1f} s wrong at most, {len(done)} handovers", *faults]))

    @staticmethod
    def _shown(evidence: Evidence, station: str, taker: str) -> Iterator[tuple[float, float]]:
        """Simulated time and seconds of each value that a station showed."""
        for entry in evidence.of(station, "border_shown"):
            shown = entry.get("in_s")
            if entry.get("station") == taker and isinstance(shown, (int, float)):
                yield evidence.sim_at(entry.t), float(shown)


@dataclass(frozen=True, slots=True)
class OfVehicle(Expectation):
    """An expectation of a further vehicle, judged as if it were the only one."""

    vehicle: str
    inner: Expectation

    def labels(self) -> tuple[str, ...]:
        return self.inner.labels()

    def judge(self, evidence: Evidence) -> Verdict:
        verdict = self.inner.judge(evidence.others[self.vehicle])
        return replace(verdict, wanted=f"{self.vehicle}: {verdict.wanted}")


@dataclass(frozen=True, slots=True)
class NobodyDied(Expectation):
    """No program ended before the end of the run, save those that the scenario killed."""

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = "every program runs to the end"
        deaths = [f"{name} {how}" for name, how in evidence.notes.deaths.items()]
        return Verdict(not deaths, wanted, "; ".join(deaths) or "they did")


@dataclass(frozen=True, slots=True)
class NoFault(Expectation):
    """No program noted an internal fault in its journal."""

    def judge(self, evidence: Evidence) -> Verdict:
        faults = [f"{entry.who}: {last_line(entry.text)}" for entry in evidence.of(event="fault")]
        return Verdict(not faults, "no internal fault in any journal", "; ".join(faults[:3]) or "none")


@dataclass(frozen=True, slots=True)
class OneCommander(Expectation):
    """Authority is never in two hands: every change of commander comes with a higher epoch."""

    def judge(self, evidence: Evidence) -> Verdict:
        wanted = "one commander at a time, each under a higher epoch"
        changes = evidence.commanders()
        # a station loses authority under the epoch that it had
        epochs = [change.epoch for change in changes if change.commander != NOBODY]
        held = bool(epochs) and all(a < b for a, b in pairwise(epochs))
        seen = ", ".join(f"{change.commander} {change.epoch}" for change in changes) or "no station ever commanded"
        return Verdict(held, wanted, seen)


def _landing_places(evidence: Evidence) -> list[tuple[str, float, float]]:
    route = evidence.package.route
    places = [("home", route.home.lat_deg, route.home.lon_deg)]
    places += [(f"rally point {n}", point.lat_deg, point.lon_deg) for n, point in enumerate(route.rally, 1)]
    located = [item for item in route.items if item.has_place]
    if located:
        places.append(("last_item", located[-1].lat_deg, located[-1].lon_deg))
    return places


def _chain(words: Sequence[str]) -> str:
    return " → ".join(words) or "none"


def _pairs(pairs: Mapping[str, tuple[int, int]]) -> str:
    words = (f"{name} {pair[0]} accepted, {pair[1]} refused" for name, pair in sorted(pairs.items()))
    return "; ".join(words) or "none"


ALWAYS: tuple[Expectation, ...] = (NobodyDied(), NoFault(), OneCommander())

#: word in the file -> expectation
EXPECTATIONS: Mapping[str, type[Expectation]] = {
    "commanders": Commanders,
    "handovers": Handovers,
    "count": Count,
    "number": Number,
    "follows": Follows,
    "corrections": Corrections,
    "quiet": Quiet,
    "memory": Memory,
    "commands": Commands,
    "modes": Modes,
    "mode_within": ModeWithin,
    "landed": Landed,
    "items_reached": ItemsReached,
    "emergencies": Emergencies,
    "said": Said,
    "loss": Loss,
    "countdown": Countdown,
}

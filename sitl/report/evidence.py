# SPDX-License-Identifier: GPL-3.0-or-later

"""The records of a run, for the expectations and the report: journals, moments, places, deaths.

Everything comes from files of the run's folder, so that a report can be made again later from the folder alone. Entries
after the end of the timeline are left out: they tell of the programs being stopped, not of the flight.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from types import MappingProxyType

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.package import MissionPackage
from sitl.report.journal_reader import Entry
from sitl.report.loss import Heard
from sitl.report.matching import matches
from sitl.report.watch import AIRBORNE_M, VEHICLE, Clock, Sample, number, samples_of

__all__ = ["NOBODY", "CommanderChange", "Evidence", "RunNotes", "of_vehicle", "seen_of"]

NOBODY = "nobody"
#: an aircraft that is airborne so soon (s) after its first position was so before
_FIRST_S = 1.5
#: a companion that flies writes its position every second
_SILENCE_S = 5.0


@dataclass(frozen=True, slots=True)
class CommanderChange:
    """From `t` on, `commander` (a station's name or `NOBODY`) commands under `epoch`."""

    t: float
    commander: str
    epoch: int


@dataclass(slots=True)
class RunNotes:
    """Facts that stand in no journal: only the runner knows them."""

    #: simulated seconds in one second of the entries' `t`
    speedup: float = 1.0
    #: label of a step -> monotonic time at which it was done
    marks: dict[str, float] = field(default_factory=dict)
    #: process -> how it ended without being asked to
    deaths: dict[str, str] = field(default_factory=dict)
    #: process -> monotonic time at which the scenario killed it
    kills: dict[str, float] = field(default_factory=dict)
    #: end of the timeline
    ended_t: float | None = None
    #: station -> what its log says was lost on the way to it, or why that is not known; measured where it is expected
    losses: dict[str, Heard | str] = field(default_factory=dict)
    #: when the autopilot's own log has RTK corrections (simulated s); None: it writes no log, or nothing asked for it
    corrections: Sequence[float] | None = None
    #: UTC (s) less the `t` of the entries; None: not known
    utc_offset_s: float | None = None


def seen_of(name: str) -> str:
    """`who` of what is seen of a further vehicle itself."""
    return f"{VEHICLE} of {name}"


def of_vehicle(entries: Iterable[Entry], name: str, names: Sequence[str]) -> list[Entry]:
    """What is about one of several vehicles, as if there were no other; `names`: of all, the first one's first.

    That is: nothing of another one's companion, nothing that is seen of it, and nothing that a station says of it.
    """
    if len(names) == 1:
        return list(entries)
    seen = {other: seen_of(other) if other != names[0] else VEHICLE for other in names}
    strangers = {who for other in names if other != name for who in (other, seen[other])}
    return [
        replace(entry, who=VEHICLE) if entry.who == seen[name] else entry
        for entry in entries
        if entry.who not in strangers and entry.get("vehicle", name) == name
    ]


class Evidence:
    """The journals of a run, sorted by time, with what is needed to read them."""

    def __init__(
        self,
        entries: Iterable[Entry],
        package: MissionPackage | None,
        notes: RunNotes | None = None,
        names: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        """Without `notes`: a flight that was not a simulation. `names`: stations by system id, where no package names
        them."""
        self.notes = notes or RunNotes()
        ended_t = self.notes.ended_t
        cut = sorted(entries, key=lambda entry: entry.t)
        self.entries: Sequence[Entry] = [entry for entry in cut if ended_t is None or entry.t <= ended_t]
        self._package = package
        self._names = dict(names)
        if package is not None:
            self._names.update((station.sysid, station.name) for station in package.stations)
        #: of the further vehicles, by name; the entries above are those of the first
        self.others: Mapping[str, Evidence] = {}
        self.samples: Sequence[Sample] = _carried(samples_of(self.entries), self.entries)
        self._clock = Clock(self.notes.speedup)
        for sample in self.samples:
            self._clock.add(sample.t, sample.sim_s)

    @property
    def package(self) -> MissionPackage:
        """The mission that was flown. Raises LookupError if it is not known."""
        if self._package is None:
            raise LookupError("no mission package")
        return self._package

    @property
    def mission(self) -> MissionPackage | None:
        """The mission that was flown; None if it is not known."""
        return self._package

    @property
    def stations(self) -> tuple[str, ...]:
        """The names of the stations, the parent's first if there is a mission."""
        if self._package is not None:
            return tuple(station.name for station in self._package.stations)
        return tuple(dict.fromkeys(name for _, name in sorted(self._names.items())))

    def of(self, who: str = "", event: str = "") -> list[Entry]:
        """The entries of a source and an event (empty: any)."""
        return [entry for entry in self.entries if matches(entry, who, event)]

    def sim_at(self, t: float) -> float:
        """Simulated seconds at monotonic `t`."""
        return self._clock.sim_at(t)

    def station_name(self, value: object) -> str:
        """A station as a journal names it, by name or system id, as its name."""
        if value in (None, 0, "", NOBODY):
            return NOBODY
        if isinstance(value, int):
            return self._names.get(value, f"station {value}")
        return str(value)

    def commanders(self) -> list[CommanderChange]:
        """The changes of the commander, from the vehicle's own views; begins with the first commander.

        A companion that was restarted in flight obeys no station until it has heard the former commander. That holds
        with and without a view that says so.
        """
        changes: list[CommanderChange] = []
        for entry in self.entries:
            if entry.event not in ("view", "restarted"):
                continue
            commander = self.station_name(entry.get("commander"))
            epoch = entry.get("epoch")
            if not changes and commander == NOBODY:
                continue
            if not changes or changes[-1].commander != commander:
                changes.append(CommanderChange(entry.t, commander, epoch if isinstance(epoch, int) else -1))
        return changes

    def commander_at(self, t: float, changes: Sequence[CommanderChange] | None = None) -> str:
        """The commander at monotonic `t`."""
        found = NOBODY
        for change in self.commanders() if changes is None else changes:
            if change.t > t:
                break
            found = change.commander
        return found

    def companion_ended_t(self) -> float:
        """When the companion ended: killed, or silent to the end; infinity if it was there to the end.

        After that its last message does not count any more: no station commands.
        """
        if "companion" in self.notes.kills:
            return self.notes.kills["companion"]
        companions = {entry.who for entry in self.of(event="view")}
        spoken = [entry.t for entry in self.entries if entry.who in companions]
        silent = bool(spoken) and self.entries[-1].t - spoken[-1] > _SILENCE_S
        return spoken[-1] if silent else inf

    def flights(self) -> list[tuple[float, float]]:
        """The spans (t) in the air, in order.

        The last span ends with the record if the aircraft did not land.
        """
        spans: list[tuple[float, float]] = []
        up: float | None = None
        for entry in self.of(VEHICLE):
            if entry.event == "airborne" and up is None:
                up = entry.t
            elif entry.event == "landed" and up is not None:
                spans.append((up, entry.t))
                up = None
        return spans if up is None else [*spans, (up, self.entries[-1].t)]

    @property
    def begins_in_air(self) -> bool:
        """Whether the aircraft was in the air already when the record of it began."""
        flights = self.flights()
        if not flights or not self.samples:
            return False
        first = self.samples[0]
        return first.alt_m > AIRBORNE_M and flights[0][0] <= first.t + _FIRST_S

    def modes_flown(self) -> list[str]:
        """The flight modes in the air, in order."""
        mode, airborne = "", False
        flown: list[str] = []
        for entry in self.of(VEHICLE):
            if entry.event == "mode":
                mode = str(entry.get("mode"))
            elif entry.event in ("airborne", "landed"):
                airborne = entry.event == "airborne"
            if airborne and mode and (not flown or flown[-1] != mode):
                flown.append(mode)
        return flown

    def armed_at_end(self) -> bool:
        """Whether the motors were armed when the run ended."""
        changes = [entry.event for entry in self.of(VEHICLE) if entry.event in ("armed", "disarmed")]
        return bool(changes) and changes[-1] == "armed"


def _carried(samples: list[Sample], entries: Sequence[Entry]) -> list[Sample]:
    """The samples; in a rehearsal at the places where the companion had the aircraft, with the speed of these.

    In a simulation a carried aircraft stands still: only the position box moves it.
    """
    moves = [entry for entry in entries if entry.event == "rehearsal"]
    begun, over = (next((e.t for e in moves if e.get("on") is on), inf) for on in (True, False))
    if begun == inf:
        return samples
    places = [
        (entry.t, lat_deg, lon_deg, number(entry, "alt_m") or 0.0)
        for entry in entries
        if entry.event == "position"
        and (lat_deg := number(entry, "lat_deg")) is not None
        and (lon_deg := number(entry, "lon_deg")) is not None
    ]
    times = [place[0] for place in places]
    found = []
    for sample in samples:
        last = bisect_right(times, sample.t) - 1
        if not begun <= sample.t <= over or last < 1 or sample.t - times[last] > _SILENCE_S:
            found.append(sample)
            continue
        (t0, lat0, lon0, _), (t1, lat1, lon1, alt_m) = places[last - 1 : last + 1]
        speed_mps = round(distance_m(lat0, lon0, lat1, lon1) / max(t1 - t0, 0.1), 2)
        found.append(replace(sample, lat_deg=lat1, lon_deg=lon1, alt_m=alt_m, speed_mps=speed_mps))
    return found

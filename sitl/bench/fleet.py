# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of a station's program with one vehicle, with a few, with ten: processor time, memory, handovers.

The station is a real process, `handover station` as users start it, the second of the four of the corridor mission. The
vehicles and the other three stations run in this process. Each vehicle is the real companion module, with an autopilot
that is moved from zone to zone. Each other station has the rules that ship (`StationCore`) on its own socket for each
vehicle, and one end of the ground link for all vehicles. All of them sign. All vehicles go up and down the corridor,
each at its own time. So authority over them comes to the station, goes on to the next, and comes back. Over each of
them it changes about four times a minute, more often than on a real route.

A handover is missed if a region was entered and authority did not move, or if it was aborted. It is also missed if it
took longer than a bad link may make it, or if the station itself has not noticed it. If the machine was busier than
`BUSY_LIMIT`, the numbers are shown as void. Growth is judged from two vehicles on: distinguishing vehicles at all costs
a station something once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import linear_regression
from time import monotonic
from typing import Final

from mavproxy_handover.cli.launch import station_argv
from mavproxy_handover.config.files import load_station
from mavproxy_handover.core.common.model import Phase, Station
from mavproxy_handover.mission.package import MissionPackage, StationEntry
from mavproxy_handover.tools.resources import shipped
from sitl.bench.autopilot import STREAM, HostedVehicle, Place, Stops
from sitl.bench.results import Entry, Measurement, Say, read_journal, transfers
from sitl.bench.rig import (
    BenchError,
    Loop,
    Rig,
    companion_config,
    cpu_s,
    key_file,
    key_for,
    shipped_mission,
    station_config,
    station_entry,
)
from sitl.bench.stations import GroundEnd, TalkingStation
from sitl.run.processes import Child
from sitl.vehicles.ports import PortPicker

__all__ = [
    "BUSY_LIMIT",
    "FULL",
    "LATE_S",
    "QUICK",
    "Growth",
    "Handovers",
    "Load",
    "Plan",
    "growth",
    "growth_of",
    "handovers_of",
    "measure",
    "results",
]

#: part of all processors' time; above it the station was not measured but the machine
BUSY_LIMIT: Final = 0.8
#: what 99 of 100 handovers take at the worst that links may be
LATE_S: Final = 3.0
#: a vehicle more costs so much more among many than among few
GROWTH_LIMIT: Final = 1.3
MEMORY_LIMIT: Final = 1.05
_VOID: Final = f"VOID: the machine was busier than {BUSY_LIMIT:.0%}"
#: after take-off, before a vehicle moves and anything counts: the station has caught up with what it was sent at once
_SETTLE_S: Final = 5.0
_TOLD_S: Final = 30.0


# ---- what was measured ----------------------------------------------------------------------------------------------


#: a region that was entered, as commander and partner
Crossing = tuple[int | None, int | None]


@dataclass(frozen=True, slots=True)
class Handovers:
    """The results of handovers. `asked`: regions that were entered; `made`: commits in the vehicles' journals."""

    asked: int
    made: int
    #: those of the real station, and those that it has told of itself
    own: int
    seen: int
    #: asked for and not made, or made and not asked for, of each vehicle
    amiss: int
    aborted: int
    late: int
    slowest_s: float
    #: messages of transfers that the real station got over the ground link, and that it sent
    by_ground: tuple[int, int]

    @property
    def missed(self) -> int:
        """How many were not as they should be."""
        return max(self.amiss, abs(self.own - self.seen)) + self.aborted + self.late


def handovers_of(
    station: int, own: Sequence[Entry], flown: Sequence[tuple[Sequence[Crossing], Sequence[Entry]]]
) -> Handovers:
    """From the station's own journal; and of each vehicle the regions that it has entered, and its journal."""
    asked = [crossing for crossings, _journal in flown for crossing in crossings]
    committed = [transfers(journal, ()) for _crossings, journal in flown]
    made = [one for each in committed for one in each]
    ground = [entry["direction"] for entry in own if entry["event"] == "message" and entry.get("via") == "ground"]
    return Handovers(
        asked=len(asked),
        made=len(made),
        own=sum(station in crossing for crossing in asked),
        seen=sum(entry["event"] in ("control_gained", "control_lost") for entry in own),
        amiss=sum(abs(len(crossings) - len(each)) for (crossings, _), each in zip(flown, committed, strict=True)),
        aborted=sum(entry["event"] == "transfer_aborted" for _, journal in flown for entry in journal),
        late=sum(each.since_entry_s > LATE_S for each in made),
        slowest_s=max((each.since_entry_s for each in made), default=0.0),
        by_ground=(ground.count("in"), ground.count("out")),
    )


@dataclass(frozen=True, slots=True)
class Load:
    """One number of vehicles, measured. Memory in MiB; `busy`: part of the machine's time."""

    vehicles: int
    seconds: float
    cpu_ms_per_s: float
    memory: tuple[float, float]
    busy: float
    handovers: Handovers


@dataclass(frozen=True, slots=True)
class Growth:
    """The cost of one more vehicle, step by step.

    `many_by_few`: of the last step by those before it (1.0 is a straight line); `most_by_least`: of the dearest by the
    cheapest. The straight line that fits best: `base` + vehicles * `each`, `off` at most by that part of a cost.
    """

    steps: tuple[float, ...]
    many_by_few: float
    most_by_least: float
    base: float
    each: float
    off: float


def growth(costs: dict[int, float]) -> Growth:
    """How cost grows with the number of vehicles, from two on.

    `costs`: number of vehicles -> cost. ValueError with less than three such numbers, or where more cost nothing more.
    """
    numbers = sorted(number for number in costs if number > 1)
    if len(numbers) < 3:
        raise ValueError("growth: at least three numbers of several vehicles")
    steps = tuple((costs[b] - costs[a]) / (b - a) for a, b in pairwise(numbers))
    if min(steps) <= 0.0:
        raise ValueError("growth: more vehicles cost nothing more")
    few = (costs[numbers[-2]] - costs[numbers[0]]) / (numbers[-2] - numbers[0])
    line = linear_regression(numbers, [costs[number] for number in numbers])
    off = max(abs(line.intercept + line.slope * number - costs[number]) / costs[number] for number in numbers)
    return Growth(steps, steps[-1] / few, max(steps) / min(steps), line.intercept, line.slope, off)


def growth_of(loads: Sequence[Load]) -> Iterator[Measurement]:
    """How the station's processor time has grown; nothing where that was not measured for enough numbers."""
    costs = {load.vehicles: load.cpu_ms_per_s for load in loads}
    if sum(vehicles > 1 for vehicles in costs) < 3:
        return
    found = growth(costs)
    void = any(load.busy > BUSY_LIMIT for load in loads)
    steps = " ".join(f"{step:.1f}" for step in found.steps)
    line = f"{found.base:.0f} + {found.each:.1f} ms/s for each, {found.off:.0%} off at most"
    more = f"one more costs {steps} ms/s, the dearest {found.most_by_least:.2f} of the cheapest"
    yield Measurement(
        "fleet",
        "CPU of one vehicle more: among many by among few",
        "",
        {"vehicles": " ".join(map(str, costs))},
        ours=found.many_by_few,
        limit=None if void else GROWTH_LIMIT,
        judged="ours",
        details=asdict(found),
        note=f"{line}; {more}{f'; {_VOID}' if void else ''}",
    )


def results(load: Load) -> Iterator[Measurement]:
    """Its numbers; without targets where the machine was too busy."""
    void = load.busy > BUSY_LIMIT
    note = _VOID if void else ""
    of_fleet = partial(Measurement, "fleet", case={"vehicles": load.vehicles, "stations": 4})
    each = load.cpu_ms_per_s / load.vehicles
    words = f"{each:.1f} ms/s for each vehicle; {load.busy:.0%} of the machine's time was used"
    yield of_fleet(
        "station: CPU per second",
        "ms/s",
        ours=load.cpu_ms_per_s,
        details={"seconds": load.seconds, "machine_busy": load.busy, "each_ms_per_s": each},
        note=f"{words}{f'; {_VOID}' if void else ''}",
    )
    begun, ended = load.memory
    yield of_fleet(
        "station: memory, at the end by the beginning",
        "MiB",
        ours=ended,
        baseline=begun,
        ratio=ended / begun,
        limit=None if void else MEMORY_LIMIT,
        note=note,
    )
    handovers = load.handovers
    yield of_fleet(
        f"handovers missed, of {handovers.asked}, {handovers.own} of the station",
        "",
        ours=float(handovers.missed),
        limit=None if void else 0.0,
        judged="ours",
        details=asdict(handovers),
        note=note,
    )


# ---- the vehicles and the station -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Plan:
    """The numbers of vehicles, and how long each is measured (s). `pause_s`: about this long in each zone."""

    seconds: dict[int, float]
    pause_s: float = 15.0

    def lasting(self, seconds: float) -> Plan:
        """A copy of this plan with the same duration for each number of vehicles."""
        return Plan(dict.fromkeys(self.seconds, seconds), self.pause_s)


FULL = Plan({1: 120.0, 2: 120.0, 5: 180.0, 10: 300.0})
QUICK = Plan({2: 12.0}, 2.0)


class Vehicle(HostedVehicle):
    """One vehicle, and the stations that are not the real one, as far as they are this vehicle's."""

    def __init__(
        self, loop: Loop, folder: Path, package: MissionPackage, sysid: int, port: int, pause_s: float
    ) -> None:
        """`port`: where the real station listens for it. Raises OSError, BenchError, KeysError."""
        super().__init__(loop, sysid, _stops(package), pause_s, sysid)
        self.name = f"drone-{sysid}"
        self.journal = folder / self.name / "companion.jsonl"
        real, keys = package.stations[1], folder / "keys"
        self.stations = [
            TalkingStation(loop, each.name, each.sysid, key_for(each.name), sysid, _peers(package, each.sysid))
            for each in package.stations
            if each is not real
        ]
        #: the real station signs with a key only for this vehicle
        key = key_file(keys, f"{real.name}-{self.name}")
        #: [[vehicle]] of the real station
        self.entry = {"name": self.name, "sysid": sysid, "links": [f"udpin:127.0.0.1:{port}"], "key": str(key)}
        self.entry["mission"] = str(shipped("missions") / "corridor")
        entries = [station.entry(keys) for station in self.stations]
        entries.insert(1, station_entry(real.name, real.sysid, port, key))
        self.load(companion_config(folder / self.name, entries, dwell_s=0.0, name=self.name, sysid=sysid))

    def fly(self) -> None:
        """Begin to move from zone to zone."""
        self.tour.begin(monotonic())
        self.moves = True

    def close(self) -> None:
        for station in self.stations:
            station.close()
        super().close()


def _peers(package: MissionPackage, station: int) -> tuple[Station, ...]:
    """The other stations."""
    return tuple(Station(each.sysid, each.name) for each in package.stations if each.sysid != station)


def _stops(package: MissionPackage) -> Stops:
    """The route's places, and who commands there alone; None where two zones meet."""
    found: list[tuple[Place, int | None]] = []
    for item in package.route.items:
        inside = [each.sysid for each in package.stations if item.seq in each.waypoints]
        if item.lat_deg is not None and item.lon_deg is not None and 1 <= len(inside) <= 2:
            owner = inside[0] if len(inside) == 1 else None
            if not found or found[-1][1] != owner:
                found.append((Place(item.lat_deg, item.lon_deg), owner))
    return found


class Bench(Rig):
    """A number of vehicles, and the station's process."""

    def __init__(self, folder: Path, vehicles: int, pause_s: float) -> None:
        super().__init__(folder, many=True)
        self.package = shipped_mission("corridor")
        self.real = self.package.stations[1]
        self.home = folder / self.real.name
        self.vehicles: list[Vehicle] = []
        #: of the stations that are not the real one
        self.ground: list[GroundEnd] = []
        self._count, self._pause_s = vehicles, pause_s

    def close(self) -> None:
        super().close()
        for vehicle in self.vehicles:
            vehicle.close()
        for end in self.ground:
            end.close()

    def set_up(self) -> None:
        picker = PortPicker()
        for sysid in range(1, self._count + 1):
            self.vehicles.append(Vehicle(self.loop, self.folder, self.package, sysid, picker.udp(), self._pause_s))
        ground = {station.name: picker.udp() for station in self.package.stations}
        for number, entry in enumerate(each for each in self.package.stations if each is not self.real):
            self.ground.append(GroundEnd(self.loop, load_station(self._configure(entry, ground))))
            for vehicle in self.vehicles:
                self.ground[-1].join(vehicle.stations[number])
        config = self._configure(self.real, ground, self.vehicles)
        self.run("station", station_argv(config, None, self.home / "mav.tlog"))
        self._take_off()

    def _take_off(self) -> None:
        vehicles, parent = self.vehicles, self.package.parent.sysid
        for vehicle in vehicles:
            vehicle.autopilot.stream(STREAM)
        self.wait(lambda: all(each.companion.view.commander == parent for each in vehicles), "the parent commands all")
        for vehicle in vehicles:
            vehicle.stations[0].share(self.package)
        self.wait(lambda: all(each.stations[0].shared for each in vehicles), "the mission package is loaded")
        for station in (station for vehicle in vehicles for station in vehicle.stations):
            station.hold(self.package)
        self.wait(lambda: all(self._ready(each) for each in vehicles), "the station has everything")
        for vehicle in vehicles:
            vehicle.autopilot.take_off()
        self.wait(
            lambda: all(each.companion.view.phase is not Phase.ON_LOAD for each in vehicles), "all are on missions"
        )
        self.loop.run(_SETTLE_S)
        for vehicle in vehicles:
            vehicle.fly()

    def _ready(self, vehicle: Vehicle) -> bool:
        """The station may take the vehicle, and all others hear it over the ground link."""
        arbiter, real = vehicle.companion.arbiter, self.real.sysid
        return arbiter.unfit(real, monotonic()) is None and all(each.reaches(real) for each in vehicle.stations)

    def _configure(self, station: StationEntry, ground: dict[str, int], vehicles: Sequence[Vehicle] = ()) -> Path:
        """The file of a station; `ground`: ports of the ground links by station."""
        own = {"name": station.name, "sysid": station.sysid}
        peers = {each.name: (each.sysid, ground[each.name]) for each in _peers(self.package, station.sysid)}
        return station_config(
            self.folder / station.name,
            own,
            ground[station.name],
            peers,
            keys=self.folder / "keys",
            vehicles=[vehicle.entry for vehicle in vehicles],
        )

    def check(self) -> None:
        """Raises BenchError if the bench is broken.

        The station has ended, a fault occurred inside a vehicle's module, or a station refused what another one signed.
        """
        super().check()
        broken = [f"{vehicle.name}: {text}" for vehicle in self.vehicles if (text := vehicle.faults())]
        if broken:
            raise BenchError("; ".join(broken))
        refused = [end.refused for end in self.ground if end.refused]
        if refused:
            raise BenchError(f"frames of the ground link were refused: {refused}")

    def outcome(self) -> Handovers:
        """The results of all handovers; to be called when the station has ended."""
        own = read_journal(self.home / f"{self.real.name}.jsonl")
        flown = [(vehicle.tour.asked, read_journal(vehicle.journal)) for vehicle in self.vehicles]
        return handovers_of(self.real.sysid, own, flown)


def _fly(folder: Path, vehicles: int, seconds: float, pause_s: float, say: Say) -> Load:
    with Bench(folder, vehicles, pause_s) as bench:
        child = bench.processes["station"]
        begun_at, cpu, machine = monotonic(), cpu_s(child.pid), _machine()
        memory = _resident_mib(child)
        until = begun_at + seconds
        while (now := monotonic()) < until:
            bench.loop.run(min(_TOLD_S, until - now))
            bench.check()
            done = sum(vehicle.tour.commits for vehicle in bench.vehicles)
            say(f"{vehicles} vehicles: {monotonic() - begun_at:.0f} of {seconds:.0f} s, {done} handovers")
        took_s = monotonic() - begun_at
        used_s, after = cpu_s(child.pid) - cpu, _machine()
        grown = _resident_mib(child)
        for vehicle in bench.vehicles:
            vehicle.moves = False  # no further handover begins
        bench.loop.run(LATE_S)  # what is under way ends
        bench.check()
    busy = 1.0 - (after[1] - machine[1]) / max(1e-9, after[0] - machine[0])
    return Load(vehicles, took_s, used_s / took_s * 1e3, (memory, grown), busy, bench.outcome())


def _machine() -> tuple[float, float]:
    """All processors' time so far, and how much of it was idle (in the system's ticks)."""
    with open("/proc/stat", encoding="ascii") as file:
        ticks = [float(word) for word in file.readline().split()[1:9]]
    return sum(ticks), ticks[3] + ticks[4]


def _resident_mib(child: Child) -> float:
    kilobytes = child.resident_kb()
    if kilobytes is None:
        raise BenchError("the station's memory cannot be read")
    return kilobytes / 1024.0


def measure(plan: Plan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Fly each number of vehicles. Raises OSError, BenchError, KeysError, MissionError."""
    loads = []
    for vehicles, seconds in plan.seconds.items():
        load = _fly(folder / "fleet" / f"{vehicles}", vehicles, seconds, plan.pause_s, say)
        loads.append(load)
        yield from results(load)
    yield from growth_of(loads)

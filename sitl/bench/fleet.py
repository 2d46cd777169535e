# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of a station's program with one vehicle, with a few, with ten: processor time, memory, handovers.

The station is a real process, `handover station` as users start it, the second of the four of the corridor mission. The
vehicles and the other three stations run in this process. Each vehicle is the real companion module, with an autopilot
that is moved from zone to zone. Each other station has the rules that ship (`StationCore`) on its own socket for each
vehicle, and one end of the ground link for all vehicles. All of them sign. All vehicles go up and down the corridor,
each at its own time. So authority over them comes to the station, goes on to the next, and comes back. Over each of
them it changes about four times a minute, more often than on a real route.

`fleet_figures.py` says what counts, and when nothing counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from time import monotonic
from types import TracebackType
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import station_argv
from mavproxy_handover.companion import module as vehicle_module
from mavproxy_handover.config.station import PeerConfig, StationConfig
from mavproxy_handover.core.common.model import Phase, Station
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage, StationEntry
from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.wire.ids import COMPANION_COMPID
from sitl.bench.autopilot import FakeAutopilot
from sitl.bench.durations import read_journal
from sitl.bench.fleet_figures import LATE_S, Crossing, Handovers, Load, growth_of, handovers_of, results
from sitl.bench.ground import GroundEnd
from sitl.bench.host import IDLE_S, Host
from sitl.bench.loop import BenchError, Loop, Timer, cpu_s
from sitl.bench.results import Measurement
from sitl.bench.rig import key_file, key_for, toml
from sitl.bench.talker import TalkingStation
from sitl.bench.traffic import Place
from sitl.run.processes import Child, Processes
from sitl.vehicles.ports import PortPicker

__all__ = ["Plan", "Tour", "measure"]

_STREAM: Final = 50
_GIVE_UP_S: Final = 60.0
_LIMIT_START_S: Final = 90.0
#: after take-off, before a vehicle moves and anything counts: the station has caught up with what it was sent at once
_SETTLE_S: Final = 5.0
_TOLD_S: Final = 30.0
#: the key of the ground link
_GROUND: Final = "ground"


@dataclass(frozen=True, slots=True)
class Plan:
    """The numbers of vehicles, and how long each is measured (s). `pause_s`: about this long in each zone."""

    seconds: dict[int, float]
    pause_s: float = 15.0

    def lasting(self, seconds: float) -> Plan:
        """A copy of this plan with the same duration for each number of vehicles."""
        return Plan(dict.fromkeys(self.seconds, seconds), self.pause_s)


class Tour:
    """An aircraft that is moved up and down a row of places.

    The row is a zone, the region to the next zone, that zone, and so on. `stops`: places, and the station that is to
    command there; None: the region between its neighbours.
    """

    def __init__(
        self, autopilot: FakeAutopilot, stops: Sequence[tuple[Place, int | None]], pause_s: float, luck: Random
    ) -> None:
        self.handovers = 0
        #: the regions that were entered: from whom, to whom
        self.asked: list[Crossing] = []
        #: regions in which authority went nowhere
        self.given_up = 0
        self._autopilot, self._stops, self._pause_s, self._luck = autopilot, stops, pause_s, luck
        self._at, self._step = 0, 1
        self._next_at = 0.0
        autopilot.place = stops[0][0]

    def begin(self, now: float) -> None:
        """In the air; where it stands, it stands for a while."""
        self._next_at = now + self._pause_s * self._luck.uniform(0.0, 1.0)

    def step(self, now: float) -> None:
        """To be called often, once it has begun."""
        if self._stops[self._at][1] is None:
            self._in_region(now)
        elif now >= self._next_at:
            if not 0 <= self._at + self._step < len(self._stops):
                self._step = -self._step
            self._go(now, _GIVE_UP_S)

    def _in_region(self, now: float) -> None:
        follows = self._stops[self._at + self._step][1]
        if self._autopilot.commander == follows and not self._autopilot.in_transfer:
            self.handovers += 1
        elif now < self._next_at:
            return
        else:
            self.given_up += 1
            self._step = -self._step
        self._go(now, self._pause_s * self._luck.uniform(0.8, 1.2))

    def _go(self, now: float, stay_s: float) -> None:
        before = self._stops[self._at][1]
        self._at += self._step
        place, owner = self._stops[self._at]
        if owner is None:
            self.asked.append((before, self._stops[self._at + self._step][1]))
        self._autopilot.place = place
        self._next_at = now + stay_s


class _Master:
    """The companion's link to its autopilot: no wire, but no call within a call either."""

    def __init__(self) -> None:
        self.waiting: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.waiting.append(bytes(data))


class _Vehicle:
    """One vehicle, and the stations that are not the real one, as far as they are this vehicle's."""

    def __init__(
        self, loop: Loop, folder: Path, package: MissionPackage, sysid: int, port: int, pause_s: float
    ) -> None:
        """`port`: where the real station listens for it. Raises OSError, BenchError, KeysError."""
        self.name = f"drone-{sysid}"
        self._loop, self._folder, self._package = loop, folder, package
        real = package.stations[1]
        self.stations = [
            TalkingStation(loop, each.name, each.sysid, key_for(each.name), sysid, _peers(package, each.sysid))
            for each in package.stations
            if each is not real
        ]
        self._master = _Master()
        self._parser = mavlink.MAVLink(None)
        stops = _stops(package)
        self.autopilot = FakeAutopilot(loop, self._from_autopilot, stops[0][0], sysid)
        self.tour = Tour(self.autopilot, stops, pause_s, Random(sysid))
        ports = {station.name: station.port for station in self.stations} | {real.name: port}
        keys = {each.name: self.key_name(each.name) if each is real else each.name for each in package.stations}
        self.companion = Host(loop, self._master, sysid, COMPANION_COMPID)
        self.module = self.companion.load(vehicle_module, str(self._configure(sysid, ports, keys)))
        self._timers: list[Timer] = [loop.every(IDLE_S, self._idle)]
        self._flies = False

    def key_name(self, station: str) -> str:
        """The name of the key that the real station signs with only for this vehicle."""
        return f"{station}-{self.name}"

    @property
    def journal(self) -> Path:
        """The companion's."""
        return self._folder / self.name / "companion.jsonl"

    def _configure(self, sysid: int, ports: dict[str, int], keys: dict[str, str]) -> Path:
        tables: dict[str, Any] = {
            "vehicle": {
                "name": self.name,
                "sysid": sysid,
                "parent": self._package.parent.name,
                "journal": self.journal.name,
                "guard": False,
            },
            "station": [
                {
                    "name": each.name,
                    "sysid": each.sysid,
                    "links": [f"udpout:127.0.0.1:{ports[each.name]}"],
                    "key": str(key_file(self._folder / "keys", keys[each.name])),
                }
                for each in self._package.stations
            ],
            "limits": {"dwell_s": 0.0},
            "policy": {"out_of_coverage": "warn", "commander_lost": "warn"},
        }
        self.journal.parent.mkdir(parents=True, exist_ok=True)
        path = self.journal.with_name("handover.toml")
        path.write_text(toml(tables), encoding="utf-8")
        return path

    # ---- what goes on ---------------------------------------------------------------------------------------------

    def _from_autopilot(self, raw: bytes) -> None:
        for message in self._parser.parse_buffer(raw) or []:
            self.companion.deliver(message)
        self._to_autopilot()

    def _to_autopilot(self) -> None:
        waiting, self._master.waiting = self._master.waiting, []
        for raw in waiting:
            self.autopilot.receive(raw)

    def _idle(self) -> None:
        self.companion.idle_if_due()
        self._to_autopilot()
        if self._flies:
            self.tour.step(monotonic())

    def fly(self) -> None:
        """Begin to move from zone to zone."""
        self.tour.begin(monotonic())
        self._flies = True

    def rest(self) -> None:
        """Stop moving: no further handover begins."""
        self._flies = False

    @property
    def view(self) -> Any:
        """Authority over it, as its own companion has it."""
        return self.module.companion.view

    def faults(self) -> str:
        """The faults inside its module; "" if none."""
        companion = self.module.companion
        return f"{self.name}: {dict(companion.faults)}" if companion.faults or companion.failed else ""

    def close(self) -> None:
        """Unload everything and close all sockets."""
        for timer in self._timers:
            timer.cancel()
        self.autopilot.silence()
        for station in self.stations:
            station.close()
        self.companion.unload()


def _peers(package: MissionPackage, station: int) -> tuple[Station, ...]:
    """The other stations."""
    return tuple(Station(each.sysid, each.name) for each in package.stations if each.sysid != station)


def _stops(package: MissionPackage) -> list[tuple[Place, int | None]]:
    """The route's places, and who commands there alone; None where two zones meet."""
    found: list[tuple[Place, int | None]] = []
    for item in package.route.items:
        inside = [each.sysid for each in package.stations if item.seq in each.waypoints]
        if item.lat_deg is not None and item.lon_deg is not None and 1 <= len(inside) <= 2:
            owner = inside[0] if len(inside) == 1 else None
            if not found or found[-1][1] != owner:
                found.append((Place(item.lat_deg, item.lon_deg), owner))
    return found


class _Bench:
    """A number of vehicles, and the station's process."""

    def __init__(self, folder: Path, vehicles: int, pause_s: float) -> None:
        self.loop = Loop(many=True)
        self.folder = folder
        self.package = mission_package.load(shipped("missions") / "corridor")
        self.real = self.package.stations[1]
        self.vehicles: list[_Vehicle] = []
        #: of the stations that are not the real one
        self.ground: list[GroundEnd] = []
        self._count, self._pause_s = vehicles, pause_s
        self._processes = Processes()
        self._child: Child | None = None

    def __enter__(self) -> _Bench:
        try:
            self._start()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._close()

    def _close(self) -> None:
        self._processes.stop_all()
        for vehicle in self.vehicles:
            vehicle.close()
        for end in self.ground:
            end.close()

    def _start(self) -> None:
        picker = PortPicker()
        ports = {sysid: picker.udp() for sysid in range(1, self._count + 1)}
        for sysid, port in ports.items():
            vehicle = _Vehicle(self.loop, self.folder, self.package, sysid, port, self._pause_s)
            self.vehicles.append(vehicle)
        ground = {station.name: picker.udp() for station in self.package.stations}
        for number, entry in enumerate(each for each in self.package.stations if each is not self.real):
            self.ground.append(self._ground_end(entry, ground))
            for vehicle in self.vehicles:
                self.ground[-1].join(vehicle.stations[number])
        argv = station_argv(self._configure(ports, ground), None, self.folder / "station" / "mav.tlog")
        self._child = self._processes.start("station", argv, self.folder / "station")
        for vehicle in self.vehicles:
            vehicle.autopilot.stream(_STREAM)
        parent = self.package.parent.sysid
        self._wait(lambda: all(each.view.commander == parent for each in self.vehicles), "the parent commands all")
        for vehicle in self.vehicles:
            vehicle.stations[0].share(self.package)
        self._wait(lambda: all(each.stations[0].shared for each in self.vehicles), "the mission package is loaded")
        for vehicle in self.vehicles:
            for station in vehicle.stations:
                station.hold(self.package)
        self._wait(lambda: all(self._ready(each) for each in self.vehicles), "the station has everything")
        for vehicle in self.vehicles:
            vehicle.autopilot.take_off()
        self._wait(lambda: all(each.view.phase is not Phase.ON_LOAD for each in self.vehicles), "all are on missions")
        self.loop.run(_SETTLE_S)
        for vehicle in self.vehicles:
            vehicle.fly()

    def _ready(self, vehicle: _Vehicle) -> bool:
        """The station may take the vehicle, and all others hear it over the ground link."""
        arbiter, real = vehicle.module.companion.arbiter, self.real.sysid
        return arbiter.unfit(real, monotonic()) is None and all(each.reaches(real) for each in vehicle.stations)

    def _ground_end(self, station: StationEntry, ports: dict[str, int]) -> GroundEnd:
        folder = self.folder / station.name
        folder.mkdir(parents=True, exist_ok=True)
        config = StationConfig(
            path=folder,
            station=Station(station.sysid, station.name),
            vehicles=(),
            automatic=frozenset(),
            journal=folder / f"{station.name}.jsonl",
            ground=f"udpin:127.0.0.1:{ports[station.name]}",
            ground_key=key_file(self.folder / "keys", _GROUND),
            peers=tuple(
                PeerConfig(each, f"udpout:127.0.0.1:{ports[each.name]}") for each in _peers(self.package, station.sysid)
            ),
        )
        return GroundEnd(self.loop, config)

    def _configure(self, ports: dict[int, int], ground: dict[str, int]) -> Path:
        entry = self.real
        tables: dict[str, Any] = {
            "station": {"name": entry.name, "sysid": entry.sysid, "journal": f"{entry.name}.jsonl"},
            "vehicle": [
                {
                    "name": vehicle.name,
                    "sysid": sysid,
                    "links": [f"udpin:127.0.0.1:{port}"],
                    "key": str(key_file(self.folder / "keys", vehicle.key_name(entry.name))),
                    "mission": str(shipped("missions") / "corridor"),
                }
                for vehicle, (sysid, port) in zip(self.vehicles, ports.items(), strict=True)
            ],
            "ground": {
                "listen": f"udpin:127.0.0.1:{ground[entry.name]}",
                "key": str(key_file(self.folder / "keys", _GROUND)),
            },
            "peer": [
                {"name": each.name, "sysid": each.sysid, "link": f"udpout:127.0.0.1:{ground[each.name]}"}
                for each in _peers(self.package, entry.sysid)
            ],
        }
        path = self.folder / "station" / "station.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(toml(tables), encoding="utf-8")
        return path

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        """Raises BenchError, with what the station said last, if that takes too long."""

        def checked() -> bool:
            self.check()
            return condition()

        try:
            self.loop.run_until(checked, _LIMIT_START_S, what)
        except BenchError as late:
            raise BenchError(f"{late}; the station's last words: {' | '.join(self.child.console()[-5:])}") from late

    def check(self) -> None:
        """Raises BenchError if the bench is broken.

        The station has ended, a fault occurred inside a vehicle's module, or a station refused what another one signed.
        """
        child = self._child
        if child is not None and not child.alive():
            raise BenchError(f"the station has ended: {' | '.join(child.console()[-5:])}")
        broken = [text for text in (vehicle.faults() for vehicle in self.vehicles) if text]
        if broken:
            raise BenchError(f"faults inside the modules: {'; '.join(broken)}")
        refused = [end.refused for end in self.ground if end.refused]
        if refused:
            raise BenchError(f"frames of the ground link were refused: {refused}")

    @property
    def child(self) -> Child:
        """The station's process."""
        assert self._child is not None
        return self._child

    def outcome(self) -> Handovers:
        """The results of all handovers; to be called when the station has ended."""
        own = read_journal(self.folder / "station" / f"{self.real.name}.jsonl")
        flown = [(vehicle.tour.asked, read_journal(vehicle.journal)) for vehicle in self.vehicles]
        return handovers_of(self.real.sysid, own, flown)


def _fly(folder: Path, vehicles: int, seconds: float, pause_s: float, say: Callable[[str], None]) -> Load:
    with _Bench(folder, vehicles, pause_s) as bench:
        pid, child = bench.child.pid, bench.child
        begun_at, cpu, machine = monotonic(), cpu_s(pid), _machine()
        memory = _resident_mib(child)
        until = begun_at + seconds
        while (now := monotonic()) < until:
            bench.loop.run(min(_TOLD_S, until - now))
            bench.check()
            done = sum(vehicle.tour.handovers for vehicle in bench.vehicles)
            say(f"{vehicles} vehicles: {monotonic() - begun_at:.0f} of {seconds:.0f} s, {done} handovers")
        took_s = monotonic() - begun_at
        used_s, after = cpu_s(pid) - cpu, _machine()
        grown = _resident_mib(child)
        for vehicle in bench.vehicles:
            vehicle.rest()
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


def measure(folder: Path, plan: Plan, say: Callable[[str], None]) -> Iterator[Measurement]:
    """Fly each number of vehicles. Raises OSError, BenchError, KeysError, MissionError."""
    loads = []
    for vehicles, seconds in plan.seconds.items():
        load = _fly(folder / f"{vehicles}", vehicles, seconds, plan.pause_s, say)
        loads.append(load)
        yield from results(load)
    yield from growth_of(loads)

# SPDX-License-Identifier: GPL-3.0-or-later

"""One run: vehicle, companion and stations are started, the timeline is played, the expectations are judged.

One thread does everything: it waits for the observer's socket, follows the journals, tells the story and asks the
present step whether it is done. Every wait is bounded (`step_limit.py`). A step that fails ends the timeline. The
expectations are judged then, too, because they show why.
"""

from __future__ import annotations

import json
import os
import select
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Protocol

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.keys import KeysError
from sitl.report.dataflash import corrections_logged
from sitl.report.evidence import Evidence, RunNotes, of_vehicle, seen_of
from sitl.report.journal_reader import Entry, JournalReader
from sitl.report.loss import measure
from sitl.report.record import RUN_FILE, Verdict
from sitl.report.watch import Watch
from sitl.run.fleet import FIRST, Craft, Flown, first_of
from sitl.run.memory import memory_of_a_run
from sitl.run.observer import Observer
from sitl.run.pacing import Pacing
from sitl.run.processes import Processes, ProcessGone, ending
from sitl.run.proxy import give_orders, type_orders
from sitl.run.sites import Site
from sitl.run.step_limit import StepLimit
from sitl.run.stopper import Stopper
from sitl.run.story import Story
from sitl.run.transmitter import Transmitter
from sitl.run.watchers import Watchers
from sitl.run.wiring import BOX, COMPANION, IMPAIRMENT, LINES, Program, Wiring, lay_out
from sitl.script.expect import ALWAYS, Corrections, Loss, OfVehicle
from sitl.script.places import SetupError, guard_files
from sitl.script.scenario import Scenario, Step
from sitl.script.steps import Running, Steady, StepFailed
from sitl.sim_time import Page, in_sim_time
from sitl.vehicles import LaunchError, RunningVehicle, VehicleSpec, launch

__all__ = ["Network", "Order", "Result", "run"]

_POLL_S = 0.02
#: a vehicle that is held goes on within this
_PACING_S = 0.004
_SETTLE_S, _SETTLE_WALL_S = 0.5, 10.0
#: on the wall clock: a program starts in no simulated time
_LOAD_TIMEOUT_S = 90.0
#: channel of SERIAL1, where the companion is
_COMPANION_CHANNEL = 1


class Network(Protocol):
    """Computers of their own for the stations, and the paths between them and the vehicle."""

    #: station -> its computer
    sites: Mapping[str, Site]
    #: names of the paths, which `change` takes
    paths: Sequence[str]

    def programs(self, folder: Path) -> Sequence[Program]:
        """Programs that run beside those of the flight. They are started first, and say when they are ready."""

    def change(self, order: str) -> None:
        """Cut or heal a path: "cut NAME", "heal NAME". Raises StepFailed."""


@dataclass(frozen=True, slots=True)
class Order:
    """The flight to run. `folder` is new or empty."""

    scenario: Scenario
    package: MissionPackage
    vehicle: str
    speedup: float
    folder: Path
    arducopter: str | None = None
    arduplane: str | None = None
    #: standard station, or "onboard" -> the program that is tried in its place; it takes the options of
    #: `sitl.run.standard_gcs`, or of `sitl.run.onboard`
    instead: Mapping[str, Sequence[str]] = field(default_factory=dict)
    #: further vehicles
    others: tuple[Craft, ...] = ()
    #: host and port of each ground station program that watches
    watchers: tuple[tuple[str, int], ...] = ()
    #: of the aircraft before the flight, clockwise from north
    heading_deg: float = 0.0
    #: where the stations are, if not on this machine's loopback
    network: Network | None = None
    #: programs that watch, with lines to them that are open already; in the place of `watchers`
    watching: Watchers | None = None


@dataclass(slots=True)
class Result:
    """The result of a run."""

    order: Order
    verdicts: list[Verdict] = field(default_factory=list)
    duration_wall_s: float = 0.0
    duration_sim_s: float = 0.0
    evidence: Evidence | None = None

    @property
    def held(self) -> bool:
        """Every expectation held."""
        return bool(self.verdicts) and all(verdict.held for verdict in self.verdicts)


def run(order: Order, story: Story) -> Result:
    """Run a scenario once. Raises SetupError with one line when it cannot be set up."""
    begun = time.monotonic()
    _prepare_folder(order)
    with memory_of_a_run(), Processes() as processes:
        flight = _Flight(order, story, processes)
        try:
            flight.set_up()
            flight.play()
        finally:
            flight.tear_down()
    result = flight.judge()
    result.duration_wall_s = time.monotonic() - begun
    _write_run(order, flight, result)
    return result


def _prepare_folder(order: Order) -> None:
    try:
        order.folder.mkdir(parents=True, exist_ok=True)
        if any(order.folder.iterdir()):
            raise SetupError(f"{order.folder} is not empty: give --out another folder")
        mission = order.folder / "mission"
        mission.mkdir()
        for name, data in order.package.files.items():
            (mission / name).write_bytes(data)
    except OSError as error:
        raise SetupError(f"{order.folder}: {error.strerror}") from None


class _Flight:
    """The run under way; what the steps see of it is `sitl.script.steps.Stage`."""

    def __init__(self, order: Order, story: Story, processes: Processes) -> None:
        self.order = order
        self.story = story
        self.processes = processes
        #: simulated time for all programs; None: they go by the wall clock. Real networks do so, and in real time a
        #: program that is late is seen to be late
        self.page: Page | None = None
        if order.network is None and order.speedup != 1.0:
            self.page = Page(_memory(order.folder) / "sim_time", make=True)
        #: simulated seconds in a second of the clock that all programs have
        self.rate = order.speedup if self.page is None else 1.0
        self.reader = JournalReader()
        self.since = {"typed": 0, "last": 0, "begin": 0}
        self.taken: set[int] = set()
        self.notes = RunNotes(self.rate)
        self.step_verdicts: list[Verdict] = []
        self.begun_t = self.now()
        self.begun_utc = datetime.now(timezone.utc)
        self.vehicle: RunningVehicle | None = None
        self._observer: Observer | None = None
        #: further vehicles, and the one that the step under way is about; "": the first
        self._others: dict[str, Flown] = {}
        self._about = ""
        self._transmitter: Transmitter | None = None
        self._told = 0
        self._impaired: tuple[str, ...] = ()
        self._memory_at = 0.0
        self._memory = (order.folder / "memory.jsonl").open("w", encoding="utf-8", buffering=1)

    # ---- what steps see -------------------------------------------------------------------------------------------

    @property
    def watch(self) -> Watch:
        if self._about:
            return self._others[self._about].observer.watch
        assert self._observer is not None
        return self._observer.watch

    def _sim_at(self, t: float) -> float:
        """Simulated seconds, by the first vehicle's clock."""
        return 0.0 if self._observer is None else self._observer.watch.clock.sim_at(t)

    def now(self) -> float:
        """The time that all programs of the run have, monotonic (s)."""
        if self.page is None:
            return time.monotonic()
        sim_s, begun, _ = self.page.read()
        return begun + sim_s

    def entries(self) -> list[Entry]:
        return self.reader.entries

    def sim_s(self) -> float:
        return self._sim_at(self.now())

    def place(self, name: str) -> tuple[float, float]:
        place, home = self.order.scenario.places[name], self.order.package.route.home
        return offset(home.lat_deg, home.lon_deg, place.east_m, place.north_m)

    def _begin_anew(self) -> None:
        """The entries that a `wait` searches begin here."""
        self._pump(0.0)
        self.since["typed"] = self.since["last"] = len(self.reader.entries)

    def type(self, process: str, line: str) -> None:
        self._begin_anew()
        try:
            self.processes[process].type(line)
        except ProcessGone as error:
            raise StepFailed(str(error)) from None

    def kill(self, process: str) -> None:
        self._begin_anew()
        self.processes[process].kill()
        self.notes.kills[process] = self.now()

    def close(self, process: str, how: str) -> None:
        self._begin_anew()
        try:
            self.processes[process].close(how)
        except ProcessGone as error:
            raise StepFailed(str(error)) from None
        self.notes.kills[process] = self.now()

    def crash(self, process: str) -> None:
        self._begin_anew()
        pid = self.processes[process].offspring()
        if pid is None:
            raise StepFailed(f"{process} supervises no process")
        os.kill(pid, signal.SIGKILL)

    def restart(self, process: str) -> None:
        self._begin_anew()
        try:
            self.processes.restart(process)
        except (ValueError, OSError) as error:
            raise StepFailed(str(error)) from None
        del self.notes.kills[process]

    def impair(self, orders: Sequence[str]) -> Callable[[], bool]:
        self._begin_anew()
        serial = tuple(name for lines in self.order.scenario.serial for name in lines.lines)
        network = self.order.network
        paths = [] if network is None else [order for order in orders if order.split()[1] in network.paths]
        wired = [order for order in orders if order.split()[1] in serial]
        others = [order for order in orders if order not in (*wired, *paths)]
        for order in paths:
            assert network is not None
            network.change(order)
        given = [give_orders(self.processes[LINES], serial, wired)] if wired else []
        if others:
            if IMPAIRMENT not in self.processes:
                raise StepFailed("no link goes through the proxy: say so by [impair]")
            given.append(give_orders(self.processes[IMPAIRMENT], self._impaired, others))
        return lambda: all(done() for done in given)

    def box(self, order: str) -> Callable[[], bool]:
        self._begin_anew()
        if BOX not in self.processes:
            raise StepFailed("there is no position box: say so by [box]")
        return type_orders(self.processes[BOX], [order])

    def change_world(self, name: str, value: float) -> Callable[[], bool]:
        self._begin_anew()
        assert self._observer is not None
        return self._observer.change_world(name, value)

    def transmit(self, position: int | None) -> None:
        self._begin_anew()
        assert self.vehicle is not None
        try:
            self._transmitter = self._transmitter or Transmitter(self.vehicle.pid)
        except OSError as error:
            raise StepFailed(str(error)) from None
        self._transmitter.switch(position)

    # ---- the three parts of a run ---------------------------------------------------------------------------------

    def set_up(self) -> None:
        """Start everything. Raises SetupError."""
        order = self.order
        try:
            others = tuple(craft.in_folder(order.folder) for craft in order.others)
            mission = order.folder / "mission"
            sites = {} if order.network is None else order.network.sites
            wiring = lay_out(order.folder, order.package, mission, order.scenario, order.instead, others, sites)
            first = first_of(order.package, mission)
            seen = order.folder / "vehicle.jsonl"
            self.vehicle, self._observer = self._start_vehicle(wiring, first, order.folder, seen, leads=True)
            for craft in others:
                folder = order.folder / craft.name
                seen = folder / "vehicle" / "seen.jsonl"
                started = self._start_vehicle(wiring, craft, folder, seen, leads=False)
                self._others[craft.name] = Flown(craft.name, *started)
            self._start_programs(wiring, self.vehicle)
        except (ConfigError, KeysError, OSError) as error:
            raise SetupError(" ".join(str(error).split())) from None

    def _start_vehicle(
        self, wiring: Wiring, craft: Craft, folder: Path, seen: Path, *, leads: bool
    ) -> tuple[RunningVehicle, Observer]:
        """`leads`: simulated time is this vehicle's."""
        order, home = self.order, craft.package.route.home
        script, parameters = guard_files(craft.package.profile)
        spec = VehicleSpec(
            home=(home.lat_deg, home.lon_deg, home.alt_m, order.heading_deg),
            sysid=craft.sysid,
            speedup=order.speedup,
            clock=None if self.page is None else self.page.path,
            leads=leads,
            scripts=(script, *wiring.card),
            defaults=parameters,
            parameters={"HNDO_CHAN": _COMPANION_CHANNEL, **order.scenario.parameters},
            arducopter=order.arducopter,
            arduplane=order.arduplane,
        )
        try:
            vehicle = launch(order.vehicle, spec, folder / "vehicle")
        except LaunchError as error:
            # its first line says what, the last one of the vehicle's log why
            first, *rest = str(error).strip().splitlines()
            raise SetupError(f"{first} {rest[-1].strip()}" if rest else first) from None
        try:
            watching = order.watching or Watchers(order.watchers)
            pacing = None
            if self.page is not None and order.vehicle != "builtin":  # which writes and follows the page itself
                stopper = Stopper(self.page, vehicle.pid)
                pacing = Pacing(self.page, vehicle.pid, order.speedup, leads=leads, stopper=stopper)
            return vehicle, Observer(vehicle.monitor, craft.sysid, self.rate, seen, watching, self.now, pacing)
        except OSError:
            vehicle.stop()
            raise

    def _start_programs(self, wiring: Wiring, vehicle: RunningVehicle) -> None:
        self._impaired = wiring.impaired
        master = vehicle.companion_master
        network = self.order.network
        beside = () if network is None else network.programs(self.order.folder)
        between = (*beside, *wiring.programs_between(master, vehicle.address(0)))
        for program in between:
            self._start(program)
        self._await_up(between)
        programs = (
            wiring.companion(master),
            *(wiring.other(name, flown.vehicle.companion_master) for name, flown in self._others.items()),
            *(station.program() for station in wiring.stations),
        )
        for program in programs:
            self._start(program)
        self._await_up(programs)

    def _start(self, program: Program) -> None:
        if program.journal is not None:
            self.reader.follow(program.journal)
        argv = program.argv if self.page is None else in_sim_time(self.page.path, program.argv)
        self.processes.start(program.name, argv, program.folder)

    def _await_up(self, programs: Sequence[Program]) -> None:
        """A program that is up has begun its journal, or said that it is ready. Raises SetupError with what its console
        said."""
        until = time.monotonic() + _LOAD_TIMEOUT_S
        missing = list(programs)
        while missing:
            self._pump(_POLL_S)
            missing = [program for program in missing if not self._is_up(program)]
            for program in missing:
                child = self.processes[program.name]
                trouble = _trouble(child.console())
                if trouble or not child.alive() or time.monotonic() > until:
                    how = "does not come up" if child.alive() else "ended while starting"
                    text = f"{program.name} {how}: {trouble or 'it does not say why'} (see {child.log_path})"
                    raise SetupError(text)

    def _is_up(self, program: Program) -> bool:
        if program.journal is not None:
            return program.journal.exists()
        return "ready" in self.processes[program.name].console()

    def play(self) -> None:
        """Go through the timeline."""
        for step in self.order.scenario.steps:
            if step.say:
                self.story.line(step.say, sim_s=self.sim_s())
            trouble = self._do(step)
            if trouble:
                self.story.line(f"{step.title} failed: {trouble}", sim_s=self.sim_s())
                wanted = f"{step.title}: {step.deed.describe()}"
                self.step_verdicts.append(Verdict(False, wanted, trouble))
                break
        else:
            steps = len(self.order.scenario.steps)
            self.step_verdicts.append(Verdict(True, f"timeline of {steps} steps", "all done"))
        self._settle()
        self.notes.ended_t = self.now()

    def _settle(self) -> None:
        """All programs write down what follows from the last step. Bounded on the wall clock too."""
        begun, until = self.now(), time.monotonic() + _SETTLE_WALL_S
        while self.now() - begun < _SETTLE_S and time.monotonic() < until:
            self._pump(_POLL_S)

    def _do(self, step: Step) -> str:
        """Do a step; returns what went wrong, or nothing."""
        self._about = step.vehicle
        limit = StepLimit(step, self.sim_s(), time.monotonic(), follows=self.page is not None)
        try:
            running = step.deed.begin(self)
            while not running.done():
                self._pump(_POLL_S)
                self.story.progress(f"waiting for {step.deed.describe()} ({running.seen()})", self.sim_s())
                if self.notes.deaths:
                    deaths = ", ".join(f"{name} {how}" for name, how in self.notes.deaths.items())
                    return f"{deaths}; {running.seen()}"
                passed = limit.passed(self.sim_s(), time.monotonic())
                if passed:
                    return f"{passed}: {running.seen()}"
        except StepFailed as error:
            return str(error)
        self._done(step, running)
        return ""

    def _done(self, step: Step, running: Running) -> None:
        if step.label:
            self.notes.marks[step.label] = self.now() if running.at is None else running.at
        if isinstance(step.deed, Steady):
            self.step_verdicts.append(Verdict(True, step.deed.describe(), running.seen()))

    def tear_down(self) -> None:
        """End everything that was started, whatever has happened."""
        for observer in (self._observer, *(flown.observer for flown in self._others.values())):
            if observer is not None:
                observer.close()
        # the built-in vehicle writes the page itself, and ends after the programs
        if self.page is not None and (self.order.vehicle != "builtin" or not (self.vehicle and self.vehicle.alive())):
            self.page.let_go()
        if self._transmitter is not None:
            self._transmitter.close()
        self._memory.close()
        try:
            self.processes.stop_all()
        finally:
            for vehicle in (self.vehicle, *(flown.vehicle for flown in self._others.values())):
                if vehicle is not None:
                    vehicle.stop()

    # ---- in between -----------------------------------------------------------------------------------------------

    def _pump(self, timeout_s: float) -> None:
        """Handle what has come, waiting for the vehicle for `timeout_s` at most; tell the story; notice deaths."""
        observer = self._observer
        if observer is not None and observer.connected:
            select.select([observer], [], [], min(timeout_s, _PACING_S))
            self.reader.add(observer.poll())
            for flown in self._others.values():
                self.reader.add(flown.poll())
        else:
            time.sleep(timeout_s)
        self.reader.poll()
        if self._transmitter is not None:
            self._transmitter.tick(self.now())
        self._weigh()
        while self._told < len(self.reader.entries):
            entry = self.reader.entries[self._told]
            self._told += 1
            self.story.entry(entry, self._sim_at(entry.t))
        deaths = self.notes.deaths
        for child in self.processes.dead():
            if child.name not in deaths and child.returncode is not None:
                deaths[child.name] = ending(child.returncode)
        running = [("vehicle", self.vehicle), *((seen_of(name), each.vehicle) for name, each in self._others.items())]
        for name, vehicle in running:
            if vehicle is not None and not vehicle.alive() and name not in deaths:
                deaths[name] = "ended"

    def _weigh(self) -> None:
        """Once a second: the memory of the companion."""
        now = self.now()
        if now < self._memory_at or COMPANION not in self.processes:
            return
        self._memory_at = now + 1.0
        size_kb = self.processes[COMPANION].resident_kb()
        if size_kb is not None:
            entry = Entry(now, "runner", "memory", "", {"process": COMPANION, "resident_kb": size_kb})
            self.reader.add([entry])
            self._memory.write(entry.to_line() + "\n")

    def judge(self) -> Result:
        """Judge what was seen."""
        if any(isinstance(expectation, Loss) for expectation in self.order.scenario.expectations):
            names = {station.name for station in self.order.package.stations} - set(self.order.scenario.standard)
            self.notes.losses = {name: measure(self.order.folder / name / f"{name}.tlog") for name in names}
        if any(isinstance(expectation, Corrections) for expectation in self.order.scenario.expectations):
            self.notes.corrections = corrections_logged(self.order.folder / "vehicle" / "logs")
        entries, vehicles = self.reader.entries, [FIRST[0], *self._others]
        evidence = Evidence(of_vehicle(entries, FIRST[0], vehicles), self.order.package, self.notes)
        evidence.others = {
            craft.name: Evidence(of_vehicle(entries, craft.name, vehicles), craft.package, self.notes)
            for craft in self.order.others
        }
        always = (*ALWAYS, *(OfVehicle(name, each) for name in self._others for each in ALWAYS))
        verdicts = list(self.step_verdicts)
        verdicts += [expectation.judge(evidence) for expectation in (*self.order.scenario.expectations, *always)]
        assert self.notes.ended_t is not None  # the timeline was played
        return Result(self.order, verdicts, duration_sim_s=evidence.sim_at(self.notes.ended_t), evidence=evidence)


def _memory(folder: Path) -> Path:
    """Where all programs of the run keep what is in memory; `folder` where nothing is."""
    return Path(os.environ.get("RUNTIME_DIRECTORY") or folder)


def _trouble(console: Sequence[str]) -> str:
    """The line in which MAVProxy or a module says why it does not load; nothing if there is none."""
    # not `handover:{`, which is in the command line that `handover companion` prints
    marks = ("Failed to load module", "is not loaded:", "handover: ", "handover_gcs: ", "Error:", "Exception:")
    return next((line.strip() for line in console if any(mark in line for mark in marks)), "")


def _write_run(order: Order, flight: _Flight, result: Result) -> None:
    """The file that `handover report` needs beside the journals."""
    values: dict[str, Any] = {
        "scenario": order.scenario.name,
        "description": order.scenario.description,
        "vehicle": order.vehicle,
        "firmware": flight.watch.firmware,
        "speedup": order.speedup,
        "rate": flight.rate,
        "begun_utc": flight.begun_utc.isoformat(timespec="seconds"),
        "begun_t": flight.begun_t,
        "ended_t": flight.notes.ended_t,
        "duration_wall_s": round(result.duration_wall_s, 1),
        "duration_sim_s": round(result.duration_sim_s, 1),
        "marks": flight.notes.marks,
        "deaths": flight.notes.deaths,
        "kills": flight.notes.kills,
        "held": result.held,
        "verdicts": [
            {"held": verdict.held, "wanted": verdict.wanted, "seen": verdict.seen} for verdict in result.verdicts
        ],
    }
    text = json.dumps(values, indent=2, ensure_ascii=False)
    (order.folder / RUN_FILE).write_text(text + "\n", encoding="utf-8")

# SPDX-License-Identifier: GPL-3.0-or-later

"""A vehicle with programs connected to it: through the companion that ships, or directly.

Through the companion: the vehicle has the guard, the mission package is on board, GCSA is the parent and GCSB the other
station. Directly: the vehicle has no guard, and one program is connected where the companion would be.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import mavproxy_handover
from mavproxy_handover.cli.launch import supervised_argv
from mavproxy_handover.mission import package as packages
from sitl.report.journal_reader import Entry, JournalReader
from sitl.run.observer import Observer
from sitl.run.processes import Processes
from sitl.run.wiring import COMPANION, COMPANION_NAME
from sitl.script.places import guard_files, mission_folder
from sitl.vehicles import RunningVehicle, VehicleSpec, launch
from sitl.vehicles.ports import LOOPBACK, PortPicker
from tests.clients.table import COMMANDER, OBSERVER, Client

__all__ = ["PROGRAMS", "Done", "Site", "SiteError"]

PROGRAMS = Path(__file__).resolve().parent / "programs"
CONTROL = Path(mavproxy_handover.__file__).resolve().parent / "wire" / "operator_control.xml"
SYSIDS: Mapping[str, int] = {COMMANDER: 251, OBSERVER: 252}
VEHICLE = 1
_POLL_S = 0.02
_UP_S = 60.0
#: the autopilot's serial port 1 is MAVLink channel 1
_CHANNEL = 1
_CONFIG = """[vehicle]
name = "{name}"
sysid = {vehicle}
parent = "{parent}"
journal = "{companion}.jsonl"
guard = true
allow_unsigned = true
mission = "{mission}"
"""
_STATION = """
[[station]]
name = "{name}"
sysid = {sysid}
links = ["udpout:{host}:{port}"]
module = false
consent = "automatic"
"""


class SiteError(AssertionError):
    """Something did not come up, or a program gave no answer."""


@dataclass(frozen=True, slots=True)
class Done:
    """What came of a job, in the program's own word."""

    result: str
    took_s: float
    count: int | None = None


class Site:
    """The processes of one vehicle. Leave the `with` block to end them."""

    def __init__(
        self, folder: Path, client: Client, environments: Path, arducopter: Path | None, *, guarded: bool
    ) -> None:
        self._folder = folder
        self._client = client
        self._environments = environments
        self._arducopter = arducopter
        self._guarded = guarded
        self._ports = PortPicker()
        self._reader = JournalReader()
        self._processes = Processes()
        self._vehicle: RunningVehicle | None = None
        self._observer: Observer | None = None
        #: how each station's program reaches the vehicle
        self._places: dict[str, tuple[str, str]] = {}

    def __enter__(self) -> Site:
        try:
            self._start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    def _stop(self) -> None:
        self._processes.stop_all()
        if self._observer is not None:
            self._observer.close()
        if self._vehicle is not None:
            self._vehicle.stop()

    # ---- what there is to start -----------------------------------------------------------------------------------

    def _start(self) -> None:
        mission = mission_folder("delivery")
        home = packages.load(mission).route.home
        script, parameters = guard_files()
        spec = VehicleSpec(
            home=(home.lat_deg, home.lon_deg, home.alt_m, 0.0),
            sysid=VEHICLE,
            scripts=(script,) if self._guarded else (),
            defaults=parameters if self._guarded else (),
            parameters={"HNDO_CHAN": _CHANNEL} if self._guarded else {},
            arducopter=None if self._arducopter is None else str(self._arducopter),
        )
        self._vehicle = launch("arducopter" if self._arducopter else "builtin", spec, self._folder / "vehicle")
        self._observer = Observer(self._vehicle.monitor, VEHICLE, 1.0, self._folder / "vehicle.jsonl")
        if self._guarded:
            listens = {name: self._ports.udp() for name in SYSIDS}
            self._start_companion(self._vehicle.companion_master, mission, listens)
            self._places = {name: ("--listen", str(port)) for name, port in listens.items()}
        else:
            port = self._vehicle.companion_master.rsplit(":", 1)[1]
            self._places = {COMMANDER: ("--tcp", port)}

    def _start_companion(self, master: str, mission: Path, listens: Mapping[str, int]) -> None:
        home = self._folder / COMPANION
        home.mkdir()
        config = home / f"{COMPANION}.toml"
        text = _CONFIG.format(
            name=COMPANION_NAME, vehicle=VEHICLE, parent=COMMANDER, companion=COMPANION, mission=mission
        )
        for name, port in listens.items():
            text += _STATION.format(name=name, sysid=SYSIDS[name], host=LOOPBACK, port=port)
            text += "".join(f"{key} = {value}\n" for key, value in self._client.station.items())
        config.write_text(text, encoding="utf-8")
        self._reader.follow(home / f"{COMPANION}.jsonl")
        self._processes.start(COMPANION, supervised_argv(config, master, home / f"{COMPANION}.tlog"), home)
        self.wait(lambda: bool(self.entries(COMPANION_NAME, "guard")), _UP_S, "the companion to hear the guard")

    def _start_client(self, name: str, place: Sequence[str]) -> None:
        """`place`: how the program reaches the vehicle, through its router if it has one."""
        if self._client.router is not None:
            place = self._start_router(name, place)
        home = self._folder / name
        home.mkdir()
        journal = home / f"{name}.jsonl"
        self._reader.follow(journal)
        python = self._client.python(self._environments)
        argv = [str(python), "-u", "-E", "-s", str(PROGRAMS / self._client.program), *place]
        argv += ["--name", name, "--sysid", str(SYSIDS[name]), "--vehicle", str(VEHICLE), "--journal", str(journal)]
        self._processes.start(name, [*argv, "--control", str(CONTROL), *self._client.options], home)

    def _start_router(self, name: str, place: Sequence[str]) -> tuple[str, ...]:
        assert self._client.router is not None
        behind = self._ports.udp()
        kind, port = place
        master = f"udpin:{LOOPBACK}:{port}" if kind == "--listen" else f"tcp:{LOOPBACK}:{port}"
        folder = self._environments / self._client.router.name / "bin"
        argv = [str(folder / "python"), "-E", "-s", str(folder / "mavproxy.py"), f"--master={master}"]
        argv += [f"--out=udpout:{LOOPBACK}:{behind}", f"--source-system={SYSIDS[name]}", "--daemon"]
        self._processes.start(f"{name}-router", argv, self._folder / f"{name}-router")
        return "--listen", str(behind)

    # ---- what is done and seen ------------------------------------------------------------------------------------

    @property
    def watch(self) -> Any:
        """The aircraft as it truly is."""
        assert self._observer is not None
        return self._observer.watch

    @property
    def ready(self) -> bool:
        """The autopilot would let itself be armed; the companion has loaded the mission."""
        loaded = not self._guarded or bool(self.entries(COMPANION_NAME, "mission_loaded"))
        return loaded and self.watch.position_ready and self.watch.checks_pass

    def entries(self, name: str, event: str) -> list[Entry]:
        """Journal entries so far."""
        self.poll()
        return [entry for entry in self._reader.entries if entry.who == name and entry.event == event]

    def poll(self) -> None:
        """Take in what has come."""
        assert self._observer is not None
        self._observer.poll()
        self._reader.poll()

    def shows(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Whether the condition holds within the time."""
        until = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > until:
                return False
            time.sleep(_POLL_S)
            self.poll()
        return True

    def rest(self, seconds: float) -> None:
        """Let time pass."""
        self.shows(lambda: False, seconds)

    def wait(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Until the condition holds. Raises SiteError."""
        if not self.shows(lambda: condition() or bool(self._processes.dead()), timeout_s) or not condition():
            gone = [f"{child.name} has ended: {child.console()[-3:]}" for child in self._processes.dead()]
            raise SiteError(f"waited for {what}: " + (", ".join(gone) or f"not within {timeout_s:g} s"))

    def type(self, name: str, word: str, timeout_s: float) -> Done:
        """Have a program do a job; it is started with its first one. Raises SiteError."""
        if name not in self._processes:
            self._start_client(name, self._places[name])
        before = len(self.entries(name, "command"))
        self._processes[name].type(word)
        self.wait(lambda: len(self.entries(name, "command")) > before, timeout_s, f"{name} to answer {word}")
        entry = self.entries(name, "command")[before]
        return Done(str(entry.get("result")), float(entry.get("took_s")), entry.get("count"))

    def version(self, name: str) -> str:
        """What the program says it is."""
        return os.linesep.join(entry.text for entry in self.entries(name, "loaded"))

# SPDX-License-Identifier: GPL-3.0-or-later

"""One vehicle and two stations as real processes: three MAVProxy, and a fourth process for bad links."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from mavproxy_handover.cli.launch import companion_argv, station_argv
from sitl.bench.autopilot import SerialAutopilot
from sitl.bench.durations import read_journal
from sitl.bench.lanes import link_plans
from sitl.bench.loop import BenchError, Loop
from sitl.bench.rig import toml
from sitl.bench.shuttle import A, B, Shuttle, write_files
from sitl.bench.traffic import Place
from sitl.run.bad_links import LinkPlan
from sitl.run.processes import Child, Processes
from sitl.script.weather import Weather
from sitl.vehicles.ports import PortPicker

__all__ = ["Flight"]

_LIMIT_S = 40.0
_STREAM = 50


class Flight:
    """Leaving the `with` block ends all processes."""

    def __init__(
        self,
        folder: Path,
        pause_s: float,
        *,
        bad_links: bool = False,
        signing: bool = False,
        seed: int = 1,
        companion: Callable[[Path, str, Path], list[str]] = companion_argv,
    ) -> None:
        """`bad_links`: proxies on every link, perfect ones until `weather` is called. `companion`: its command line, of
        configuration, master and tlog. Raises OSError, KeysError.
        """
        self.loop = Loop()
        self.autopilot = SerialAutopilot(self.loop, Place(52.6790, 5.9240))
        self.shuttle = Shuttle(self.autopilot.model, pause_s, seed)
        self._folder = folder
        self._processes = Processes()
        self._children: list[Child] = []
        self._links: Child | None = None
        ports = PortPicker()
        self._listen = {sysid: ports.udp() for sysid in (A, B)}
        ground = {sysid: ports.udp() for sysid in (A, B)}
        vehicle_to, ground_to = self._listen, ground
        self._plans: list[LinkPlan] = []
        if bad_links:
            named = {f"vehicle-{sysid}": port for sysid, port in self._listen.items()}
            named |= {f"ground-{sysid}": port for sysid, port in ground.items()}
            self._plans, senders = link_plans(ports, Weather(), named)
            vehicle_to = {sysid: senders[f"vehicle-{sysid}"] for sysid in (A, B)}
            ground_to = {sysid: senders[f"ground-{sysid}"] for sysid in (A, B)}
        self.wires = write_files(folder, vehicle_to, ground, ground_to, signing=signing)
        self._seed = seed
        self._companion_argv = companion

    def __enter__(self) -> Flight:
        try:
            self._start()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def _close(self) -> None:
        self._processes.stop_all()
        self.autopilot.close()

    def _start(self) -> None:
        if self._plans:
            links = [{"name": plan.name, "listen": plan.listen, "target": plan.target} for plan in self._plans]
            config = self._folder / "links.toml"
            # a key outside any table has to stand before the first one
            config.write_text(f"seed = {self._seed}\n" + toml({"link": links}), encoding="utf-8")
            argv = [sys.executable, "-m", "sitl.run.bad_links", "--config", str(config)]
            self._links = self._run("links", argv)
            self._wait(lambda: "ready" in self._console("links"), "the links are there")
        for sysid, name in ((A, "GCSA"), (B, "GCSB")):
            master = f"udpin:127.0.0.1:{self._listen[sysid]}"
            self._run(name, station_argv(self.wires.stations[sysid], master, self._folder / name / "mav.tlog"))
        master = self.autopilot.device
        log = self._folder / "companion" / "mav.tlog"
        self._run("companion", self._companion_argv(self.wires.companion, master, log))
        model = self.autopilot.model
        model.stream(_STREAM)
        self._wait(lambda: model.commander == A, "the parent commands")
        self._processes["GCSA"].type("handover share")
        self._wait(self._loaded, "vehicle and partner have the mission package")
        model.take_off()
        self.loop.every(0.01, self.shuttle.step, 1.0)

    @property
    def companion(self) -> Child:
        """The companion's process; with a supervisor that."""
        return self._processes["companion"]

    def restart_companion(self) -> None:
        """Kill it, and start it again at once."""
        self.companion.kill()
        self._children.remove(self.companion)
        self._children.append(self._processes.restart("companion"))

    def _loaded(self) -> bool:
        companion, _parent, partner = self.wires.journals
        return _has(companion, "mission_written") and _has(partner, "package_received")

    def _run(self, name: str, argv: list[str]) -> Child:
        child = self._processes.start(name, argv, self._folder / name)
        self._children.append(child)
        return child

    def _console(self, name: str) -> str:
        return "\n".join(self._processes[name].console())

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        next_look = 0.0

        def looked() -> bool:
            nonlocal next_look
            if time.monotonic() < next_look:
                return False
            next_look = time.monotonic() + 0.2
            self.check()
            return condition()

        self.loop.run_until(looked, _LIMIT_S, what)

    def weather(self, order: str) -> None:
        """Give the links an order, such as `loss all 0.2`. Raises BenchError if they do not take it."""
        assert self._links is not None
        before = len(self._links.console())
        self._links.type(order)
        self._wait(lambda: len(self._console("links").splitlines()) > before, f"the links take {order!r}")
        answer = self._links.console()[-1]
        if not answer.startswith("ok"):
            raise BenchError(f"links: {order!r}: {answer}")

    def shuttle_until(self, commits: int, limit_s: float) -> None:
        """Let the aircraft go back and forth until that many commits in all, `limit_s` at most."""
        until = time.monotonic() + limit_s
        while self.shuttle.commits < commits and time.monotonic() < until:
            self.loop.run(0.5)
            self.check()

    def check(self) -> None:
        """Raises BenchError if a process has ended."""
        for child in self._children:
            if not child.alive():
                raise BenchError(f"{child.name} has ended: {' | '.join(child.console()[-5:])}")

    @property
    def journals(self) -> list[list[dict[str, object]]]:
        """Companion's, GCSA's and GCSB's so far."""
        return [read_journal(path) for path in self.wires.journals]


def _has(journal: Path, event: str) -> bool:
    return journal.is_file() and any(entry["event"] == event for entry in read_journal(journal))

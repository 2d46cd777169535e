# SPDX-License-Identifier: GPL-3.0-or-later

"""The operator's panel: its cost, and its harm to a station and to a vehicle's lease.

`cost`: `handover panel` is a real process. The station is a socket in this process, which sends the snapshots of 20
aircraft as often as a real one does. If Chromium is installed, it shows the page; the result says so.

`harm`: the station is a real process, `handover station`, with real companions in this process (`fleet.py`). Authority
changes between the stations all the time. The station sends 20 heartbeats a second to each vehicle. The states come one
after the other, in the same run. They are: no panel, a panel, a stopped browser (SIGSTOP), a stopped panel, a killed
panel, and a flood. The flood is of bad and good lines at the station's socket, with requests for the page. In each
state the frames of the station that reach the vehicle are counted. The longest gap between two leases is measured. The
state without a panel is the baseline.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.flight_values import Stamped
from gcs_module.panel.endpoint import FOLDER_VARIABLE, find, open_endpoint
from gcs_module.panel.orders import Order, Reply
from gcs_module.panel.publisher import Publisher
from gcs_module.panel.snapshot import AircraftSeen, LineSeen, LinkSeen, PeerSeen, ReturnSite, StationSeen
from mavproxy_handover.wire.ids import COMPANION_COMPID, LEASE_TUNNEL
from sitl.bench import fleet
from sitl.bench.results import Measurement, Say
from sitl.bench.rig import BenchError, Rig, cpu_s
from sitl.run.processes import Child

__all__ = ["FULL", "QUICK", "Plan", "measure"]

#: part of a processor, and memory (MiB), that the panel may use
CPU_LIMIT: Final = 0.05
MEMORY_LIMIT: Final = 200.0
#: part of the station's frames that must arrive in each state
RATE_LIMIT: Final = 0.9
#: the longest gap between leases that is allowed (s)
LEASE_LIMIT_S: Final = 0.4
_PANEL: Final = "import sys; from mavproxy_handover.cli import main; sys.exit(main())"
_FLOOD: Final = [sys.executable, "-m", "sitl.bench.panel_flood"]
_BEGIN_S: Final = 60.0
#: the station's uplink in the measurement of harm: so many frames of it in a second, beside the others
_HEARTBEATS: Final = 20
_TUNNEL: Final = mavlink.MAVLINK_MSG_ID_TUNNEL


@dataclass(frozen=True, slots=True)
class Plan:
    """Aircraft on the panel, time of the cost, time of each state of the harm (s), and vehicles in it."""

    aircraft: int
    cost_s: float
    state_s: float
    vehicles: int = 2
    pause_s: float = 4.0


FULL = Plan(20, 60.0, 30.0)
QUICK = Plan(20, 6.0, 5.0)


# ---- the panel's process and a browser ------------------------------------------------------------------------------


@contextmanager
def sockets_apart() -> Iterator[None]:
    """A folder for the panels' sockets of this run."""
    before = os.environ.get(FOLDER_VARIABLE)
    with tempfile.TemporaryDirectory(prefix="panels-") as folder:
        os.environ[FOLDER_VARIABLE] = str(Path(folder) / "sockets")
        try:
            yield
        finally:
            os.environ.pop(FOLDER_VARIABLE)
            if before is not None:
                os.environ[FOLDER_VARIABLE] = before


def _panel(rig: Rig, station: str, number: int = 0) -> tuple[Child, str]:
    """Start the panel; the process, and its link."""
    argv = [sys.executable, "-c", _PANEL, "panel", "--port", "0", "--station", station]
    child = rig.run(f"panel-{number}", argv)

    def link() -> str:
        return next((line for line in child.console() if line.startswith("http://")), "")

    rig.wait(lambda: bool(link()), "the panel has printed its link", _BEGIN_S, 0.2)
    return child, link()


def _chromium() -> str | None:
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def _browser(rig: Rig, link: str, number: int = 0) -> Child | None:
    """Open the page in a browser without a window; None: there is no Chromium here."""
    program = _chromium()
    if program is None:
        return None
    folder = rig.folder / f"browser-{number}" / "profile"
    words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", f"--user-data-dir={folder}"]
    return rig.run(f"browser-{number}", [program, *words, "--window-size=1400,900", "--remote-debugging-port=0", link])


# ---- cost -----------------------------------------------------------------------------------------------------------


class Shown(Rig):
    """A station's socket with many aircraft, and a panel that reads it."""

    NAME: Final = "GCSA"

    def __init__(self, folder: Path, aircraft: int) -> None:
        super().__init__(folder)
        self._aircraft = aircraft
        self._publisher: Publisher | None = None

    def set_up(self) -> None:
        self._publisher = publisher = Publisher(open_endpoint(self.NAME), self._seen, dict, _no_order)
        self.loop.every(0.02, lambda: publisher.tick(time.monotonic()))
        self.panel, self.link = _panel(self, self.NAME)
        self.wait(lambda: publisher.readers > 0, "the panel reads the station", _BEGIN_S)

    def close(self) -> None:
        super().close()
        if self._publisher is not None:
            self._publisher.close()

    def _seen(self, now: float) -> StationSeen:
        names = ("GCSA", "GCSB", "GCSC")
        return StationSeen(
            station=self.NAME,
            at=now,
            program="bench",
            configuration="bench",
            limits=("energy",),
            operator="",
            required=False,
            next_operator="",
            next_until=None,
            aircraft=tuple(_craft(number, names[number % 3], now) for number in range(1, self._aircraft + 1)),
            peers=tuple(PeerSeen(name, True, now, None) for name in names[1:]),
        )


def _no_order(order: Order) -> Reply:
    return Reply(order.number, False, "Not used.")


def _craft(number: int, commander: str, now: float) -> AircraftSeen:
    """One of many aircraft. All its values are new in each snapshot."""
    moved = now % 600.0 * 1e-5
    return AircraftSeen(
        sysid=number,
        name=f"drone-{number}",
        heard_at=now,
        authority_at=now,
        phase="on_mission",
        commander=commander,
        own=commander == Shown.NAME,
        partner="",
        epoch=1,
        alone=False,
        rehearsal=False,
        zone=commander,
        zone_ends_at=now + number * 7.0 + 30.0 - now % 30.0,
        action="",
        decision="",
        question=None,
        border=None,
        answer_until=None,
        mode=Stamped("AUTO", now),
        armed=Stamped(True, now),
        position=Stamped((52.68 + moved, 5.92 + number * 1e-3), now),
        height_m=Stamped(30.0 + moved * 1e3, now),
        speed_mps=Stamped(5.0 + moved * 1e2, now),
        heading_deg=Stamped(90.0, now),
        battery_percent=Stamped(94.0 - moved * 1e3, now),
        battery_v=Stamped(12.4, now),
        battery_left_s=Stamped(900.0, now),
        return_site=ReturnSite("home", 52.679, 5.924),
        payload=(),
        rerouted=False,
        mission="",
        overrides=(),
        briefing_at=None,
        briefing=(),
        alarms=(),
        links=(LinkSeen("udpin:0.0.0.0:14550", True, True, now),),
        lines=tuple(LineSeen(line, now - line, 0, f"line {line} of drone-{number}") for line in range(12)),
    )


def cost(plan: Plan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Processor time and memory of the panel."""
    with Shown(folder / "panel-cost", plan.aircraft) as bench:
        browser = _browser(bench, bench.link)
        bench.loop.run(10.0 if browser else 2.0)
        bench.check()
        begun_at, used_s = time.monotonic(), cpu_s(bench.panel.pid)
        bench.loop.run(plan.cost_s)
        bench.check()
        took_s, used_s = time.monotonic() - begun_at, cpu_s(bench.panel.pid) - used_s
        kilobytes = bench.panel.resident_kb()
    case = {"aircraft": plan.aircraft, "browser": browser is not None}
    note = "Chromium shows the page" if browser else "NO BROWSER: there is no Chromium here, nothing shows the page"
    say(f"{plan.aircraft} aircraft on one panel: {used_s / took_s:.1%} of a processor")
    part = used_s / took_s
    yield Measurement("panel", "panel: part of a processor", "", case, part, limit=CPU_LIMIT, judged="ours", note=note)
    if kilobytes is None:
        raise BenchError("the panel's memory cannot be read")
    size = kilobytes / 1024.0
    yield Measurement("panel", "panel: memory", "MiB", case, size, limit=MEMORY_LIMIT, judged="ours", note=note)


# ---- harm -----------------------------------------------------------------------------------------------------------


class Station(fleet.Bench):
    """The station's process, whose frames and leases are watched at the first vehicle."""

    def __init__(self, folder: Path, vehicles: int, pause_s: float) -> None:
        super().__init__(folder, vehicles, pause_s)
        self.frames: list[float] = []
        self.leases: list[float] = []
        #: the largest delay of this process itself, which hosts the companions (s)
        self.late_s = 0.0
        self._beat_at = 0.0

    def set_up(self) -> None:
        super().set_up()
        self._port: Any = self.vehicles[0].companion.ports[self.real.sysid]
        self.vehicles[0].autopilot.on_frame = self._saw
        self.loop.every(0.005, self._look)
        self.processes["station"].type(f"set heartbeat {_HEARTBEATS}")
        self.wait(self._steady, "the station sends its heartbeats", _BEGIN_S)

    def _steady(self) -> bool:
        """Whether more than half of the heartbeats come."""
        now = time.monotonic()
        return sum(now - at < 2.0 for at in self.frames[-4 * _HEARTBEATS :]) > _HEARTBEATS

    def _look(self) -> None:
        now = time.monotonic()
        if not self.frames or self._port.frames_at != self.frames[-1]:
            self.frames.append(self._port.frames_at)
        if self._beat_at:
            self.late_s = max(self.late_s, now - self._beat_at - 0.005)
        self._beat_at = now

    def _saw(self, raw: bytes) -> None:
        ours = raw[0] == 0xFD and raw[6] == COMPANION_COMPID and int.from_bytes(raw[7:10], "little") == _TUNNEL
        if ours and int.from_bytes(raw[10:12], "little") == LEASE_TUNNEL:
            self.leases.append(time.monotonic())


@dataclass(frozen=True, slots=True)
class State:
    """Measurements of one state: frames in a second, longest gap between leases, and this process's own delay."""

    name: str
    rate: float
    lease_gap_s: float
    late_s: float


def _in_state(bench: Station, name: str, seconds: float, say: Say) -> State:
    begun_at, frames, leases = time.monotonic(), len(bench.frames), len(bench.leases)
    bench.late_s = bench._beat_at = 0.0
    bench.loop.run(seconds)
    bench.check()
    ended_at = time.monotonic()
    marks = [begun_at, *bench.leases[leases:], ended_at]
    gap_s = max(after - before for before, after in pairwise(marks))
    state = State(name, (len(bench.frames) - frames) / (ended_at - begun_at), gap_s, bench.late_s)
    say(f"{name}: {state.rate:.1f} frames/s, longest gap of leases {gap_s:.3f} s")
    return state


def _signal(child: Child, number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.killpg(child.pid, number)


def states(plan: Plan, folder: Path, say: Say) -> Iterator[State]:
    """The states one after the other, in one run; the first is the baseline."""
    with Station(folder / "panel-harm", plan.vehicles, plan.pause_s) as bench:

        def measured(name: str) -> State:
            return _in_state(bench, name, plan.state_s, say)

        yield measured("no panel")
        child, link = _panel(bench, bench.real.name, 1)
        browser = _browser(bench, link, 1)
        bench.loop.run(5.0)
        yield measured("panel")
        if browser is not None:
            _signal(browser, signal.SIGSTOP)
            yield measured("browser stopped")
            browser.kill()
        _signal(child, signal.SIGSTOP)
        yield measured("panel stopped")
        child.kill()
        yield measured("panel killed")
        child, link = _panel(bench, bench.real.name, 2)
        where = find(bench.real.name)
        if where is None:
            raise BenchError("the station's socket for panels is gone")
        flood = bench.run("flood", [*_FLOOD, str(where), link])
        bench.loop.run(1.0)
        yield measured("flood")
        flood.kill()
        child.kill()
        yield measured("no panel again")


def results(found: Sequence[State]) -> Iterator[Measurement]:
    """The numbers of each state beside those of the first."""
    first = found[0]
    for state in found[1:]:
        case = {"state": state.name}
        details = {"bench_late_s": state.late_s}
        yield Measurement(
            "panel",
            f"{state.name}: frames of the station that reach the vehicle",
            "1/s",
            case,
            state.rate,
            first.rate,
            state.rate / max(1e-9, first.rate),
            limit=RATE_LIMIT,
            at_least=True,
            details=details,
        )
        yield Measurement(
            "panel",
            f"{state.name}: longest gap of leases",
            "s",
            case,
            state.lease_gap_s,
            first.lease_gap_s,
            state.lease_gap_s / max(1e-9, first.lease_gap_s),
            limit=LEASE_LIMIT_S,
            judged="ours",
            details=details,
            note=f"this process itself was late by up to {state.late_s * 1e3:.0f} ms",
        )


def measure(plan: Plan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Cost, then harm. Raises OSError, BenchError, KeysError, MissionError."""
    with sockets_apart():
        yield from cost(plan, folder, say)
        found = list(states(plan, folder, say))
        if _chromium() is None:
            say("panel: NO BROWSER: Chromium is not installed here, so a stopped browser was not measured")
        yield from results(found)

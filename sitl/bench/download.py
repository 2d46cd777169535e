# SPDX-License-Identifier: GPL-3.0-or-later

"""How fast a station downloads a log: through the companion, and directly from the autopilot, in turns.

The target is for the same kind of link: a station that reaches the companion by UDP is compared to one that reaches the
autopilot by UDP, and TCP to TCP. UDP beside direct TCP is told without a target. All are real processes. The autopilot
is ArduCopter's program where there is one, else `log_server`. The stations are the installed MAVProxy with the modules
that it loads by itself, and programs of pymavlink and MAVSDK (`log_reader`). Rate and retries are what a station tells
at the end of its download, and the file must be right to the byte. A download that is not over in time counts for the
baseline as if it had ended then, and for the companion as nothing.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.cli.launch import companion_argv, mavproxy
from sitl.bench.log_server import log_bytes
from sitl.bench.loop import BenchError
from sitl.bench.numbers import Pair, abba, compare
from sitl.bench.results import Measurement
from sitl.bench.rig import PARENT, toml
from sitl.bench.traffic import AUTOPILOT, VEHICLE
from sitl.run.processes import Child, Processes
from sitl.vehicles import VehicleSpec, find_arducopter
from sitl.vehicles.arducopter import arguments_of
from sitl.vehicles.ports import LOOPBACK, PortPicker
from sitl.vehicles.process import BASE_PARAMETERS

__all__ = ["MAVPROXY", "RATE_RATIO", "Plan", "Program", "finished", "mavsdk", "measure", "pymavlink"]

RATE_RATIO: Final = 0.8
_POLL_S: Final = 0.05
_UP_LIMIT_S: Final = 60.0
#: a download that has brought nothing by then was not let through yet: it is asked for again
_BEGUN_S: Final = 3.0
_FINISHED: Final = re.compile(r"Finished downloading .*\((\d+) bytes .* ([\d.]+) kbyte/sec (\d+|unknown) retries\)")
_READER: Final = Path(__file__).with_name("log_reader.py")
_FILE: Final = "got.bin"


@dataclass(frozen=True, slots=True)
class Program:
    """A ground station. `argv`: of the kind of link and the port, which it listens to by UDP and calls by TCP."""

    name: str
    argv: Callable[[str, int], list[str]]
    #: it can be told to download once its console has this; `ready_real`: and this, with ArduCopter
    ready: str
    ready_real: str = ""


def _of_pymavlink(link: str, port: int) -> str:
    return f"{'udpin' if link == 'udp' else 'tcp'}:{LOOPBACK}:{port}"


def _of_mavsdk(link: str, port: int) -> str:
    return f"{'udpin' if link == 'udp' else 'tcpout'}://{LOOPBACK}:{port}"


MAVPROXY: Final = Program(
    "stock MAVProxy",
    lambda link, port: [
        *mavproxy(),
        f"--master={_of_pymavlink(link, port)}",
        f"--source-system={PARENT}",
        f"--target-system={VEHICLE}",
    ],
    f"Detected vehicle {VEHICLE}:{AUTOPILOT}",
    " parameters",  # which it fetches at once, by file transfer
)


def pymavlink() -> Program:
    """A program of the installed pymavlink."""
    return Program(
        f"pymavlink {version('pymavlink')}",
        lambda link, port: [sys.executable, str(_READER), "pymavlink", _of_pymavlink(link, port)],
        "ready",
    )


def mavsdk(python: str) -> Program | None:
    """A program of the MAVSDK that this Python has; None if it has none."""
    python = os.path.abspath(python)  # a station runs in a folder of its own
    asks = "import mavsdk; from importlib.metadata import version; print(version('mavsdk'))"
    try:
        told = subprocess.run([python, "-c", asks], capture_output=True, text=True, timeout=_UP_LIMIT_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return Program(
        f"MAVSDK {told.stdout.strip()}",
        lambda link, port: [python, str(_READER), "mavsdk", _of_mavsdk(link, port)],
        "ready",
    )


@dataclass(frozen=True, slots=True)
class Plan:
    """Bytes of the log, pairs of downloads, and the longest that one may take."""

    size: int
    pairs: int
    limit_s: float
    #: kinds of link to the companion, each with those of the direct one
    links: tuple[tuple[str, tuple[str, ...]], ...] = (("udp", ("udp", "tcp")), ("tcp", ("tcp",)))
    #: False: the small server even where ArduCopter's program is, and stock MAVProxy alone
    real: bool = True


@dataclass(frozen=True, slots=True)
class _Download:
    """One download as the station tells it. `retries` None: it does not tell them."""

    kbytes_per_s: float
    retries: int | None = None
    #: it was over in time
    over: bool = True

    def __str__(self) -> str:
        if not self.over:
            return "not over in time"
        return "retries not told" if self.retries is None else f"{self.retries} retries"


def finished(console: list[str]) -> tuple[int, float, int | None] | None:
    """Bytes, kB/s and retries of the last download that a station reports as finished.

    None for a value that it does not know.
    """
    for line in reversed(console):
        found = _FINISHED.search(line)
        if found:
            return int(found[1]), float(found[2]), int(found[3]) if found[3].isdigit() else None
    return None


class _Site:
    """An autopilot with a log, and a companion. Leaving the `with` block ends all processes."""

    def __init__(self, folder: Path, link: str, plan: Plan) -> None:
        self._folder, self._link, self._plan = folder, link, plan
        self._processes = Processes()
        self._log = log_bytes(plan.size)
        picker = PortPicker()
        self._tcp, self._companion_tcp, self._udp = picker.tcp(), picker.tcp(), picker.udp()
        self._station_port = picker.udp() if link == "udp" else picker.tcp()
        self._program = find_arducopter() if plan.real else None
        self._number = 0

    @property
    def vehicle(self) -> str:
        return "log server" if self._program is None else "arducopter"

    def __enter__(self) -> _Site:
        try:
            self._start()
        except BaseException:
            self._processes.stop_all()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self._processes.stop_all()

    def _start(self) -> None:
        vehicle = self._folder / "vehicle"
        (vehicle / "logs").mkdir(parents=True)
        tcp, udp = {0: self._tcp, 1: self._companion_tcp}, f"{LOOPBACK}:{self._udp}"
        if self._program is None:
            ports = [word for port in tcp.values() for word in ("--tcp", str(port))]
            argv = [sys.executable, "-m", "sitl.bench.log_server", "--size", str(self._plan.size)]
            argv += [*ports, "--udp", str(self._udp)]
        else:
            (vehicle / "logs" / "00000001.BIN").write_bytes(self._log)
            (vehicle / "logs" / "LASTLOG.TXT").write_text("1\n", encoding="ascii")
            parameters = vehicle / "base.parm"
            shutil.copy(BASE_PARAMETERS, parameters)
            spec = VehicleSpec(home=(52.6792, 5.9240, 0.0, 0.0), sysid=VEHICLE)
            argv = arguments_of(self._program, spec, "quad", tcp, [parameters])
            argv += ["--serial2", f"udpclient:{udp}"]
        self._processes.start("vehicle", argv, vehicle)
        companion = self._folder / "companion"
        companion.mkdir()
        config = companion / "handover.toml"
        config.write_text(toml(self._tables()), encoding="utf-8")
        master = f"tcp:{LOOPBACK}:{self._companion_tcp}"
        time.sleep(1.0)  # MAVProxy does not try a second time
        argv = companion_argv(config, master, companion / "mav.tlog")
        self._wait_for(self._processes.start("companion", argv, companion), "stations GCSA", _UP_LIMIT_S)

    def _tables(self) -> dict[str, Any]:
        way = "udpout" if self._link == "udp" else "tcpin"
        return {
            "vehicle": {
                "name": "drone-1",
                "sysid": VEHICLE,
                "parent": "GCSA",
                "journal": "companion.jsonl",
                "guard": False,
                "allow_unsigned": True,
            },
            "station": [
                {
                    "name": "GCSA",
                    "sysid": PARENT,
                    "links": [f"{way}:{LOOPBACK}:{self._station_port}"],
                    "module": False,
                    "consent": "automatic",
                }
            ],
        }

    def through_companion(self, program: Program) -> _Download:
        """One download by a station of its own. Raises BenchError, OSError."""
        return self._download(program, "ours", program.argv(self._link, self._station_port))

    def directly(self, program: Program, link: str) -> _Download:
        """Measure a download from the autopilot itself. Raises BenchError, OSError."""
        return self._download(program, "direct", program.argv(link, self._udp if link == "udp" else self._tcp))

    def _download(self, program: Program, way: str, argv: list[str]) -> _Download:
        self._number += 1
        name = f"{way}-{self._number}"
        station = self._processes.start(name, argv, self._folder / name)
        try:
            self._wait_for(station, program.ready, _UP_LIMIT_S)
            if self._program is not None and program.ready_real:
                self._wait_for(station, program.ready_real, _UP_LIMIT_S)
            return self._downloaded(station, way == "ours")
        finally:
            station.stop()

    def _wait_for(self, station: Child, text: str, limit_s: float) -> None:
        until = time.monotonic() + limit_s
        while not any(text in line for line in station.console()):
            if time.monotonic() > until or not station.alive():
                raise BenchError(f"{station.name}: no {text!r} (console: {' | '.join(station.console()[-5:])})")
            time.sleep(_POLL_S)

    def _downloaded(self, station: Child, ours: bool) -> _Download:
        path = station.folder / _FILE
        begun = asked_at = time.monotonic()
        station.type(f"log download 1 {_FILE}")
        while time.monotonic() - begun < self._plan.limit_s:
            time.sleep(_POLL_S)
            told = finished(station.console())
            if told is not None:
                if path.read_bytes() != self._log:
                    raise BenchError(f"{station.name}: the file is not the log ({told[0]} bytes)")
                return _Download(told[1], told[2])
            if time.monotonic() - asked_at > _BEGUN_S and not (path.is_file() and path.stat().st_size):
                asked_at = time.monotonic()
                station.type(f"log cancel;log download 1 {_FILE}")
        if not path.is_file() or not path.stat().st_size:
            raise BenchError(f"{station.name}: no log data (console: {' | '.join(station.console()[-5:])})")
        return _Download(0.0 if ours else self._plan.size / self._plan.limit_s / 1e3, over=False)


def measure(folder: Path, plan: Plan, programs: Sequence[Program], say: Callable[[str], None]) -> Iterator[Measurement]:
    """One line for each program, kind of link and direct way. Raises BenchError, ConfigError, LaunchError, OSError."""
    for link, ways in plan.links:
        with _Site(folder / link, link, plan) as site:
            for program in programs:
                for way in ways:
                    yield _measured(site, program, link, way, plan, say)


def _measured(
    site: _Site, program: Program, link: str, way: str, plan: Plan, say: Callable[[str], None]
) -> Measurement:
    found: dict[bool, list[_Download]] = {True: [], False: []}
    for order in islice(abba(), plan.pairs):
        for ours in order:
            found[ours].append(site.through_companion(program) if ours else site.directly(program, way))
        last = {ours: downloads[-1] for ours, downloads in found.items()}
        say(
            f"{site.vehicle}, {program.name}, {link}: {last[True].kbytes_per_s:.0f} kB/s, {last[True]}; "
            f"directly by {way} {last[False].kbytes_per_s:.0f} kB/s, {last[False]}"
        )
    pairs = [Pair(a.kbytes_per_s, b.kbytes_per_s) for a, b in zip(found[True], found[False], strict=True)]
    compared = compare(pairs)
    return Measurement(
        "download",
        f"log download by {program.name}",
        "kB/s",
        {"vehicle": site.vehicle, "link": link, "direct": way, "log_kB": plan.size // 1000},
        compared.ours,
        compared.baseline,
        compared.ratio,
        (compared.low, compared.high),
        compared.pairs,
        limit=RATE_RATIO if link == way else None,
        at_least=True,
        details={
            "retries": [download.retries for download in found[True]],
            "retries_direct": [download.retries for download in found[False]],
        },
        note=f"{site.vehicle}, {program.name}, {link}: the baseline is the same program at the autopilot by {way}; "
        f"{', '.join(map(str, found[True]))}, directly {', '.join(map(str, found[False]))}",
    )

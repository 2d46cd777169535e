# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads of stations: how fast a log comes down, and whether observers' requests cost the commander its telemetry.

`download`: how fast a station downloads a log, through the companion and directly from the autopilot, in turns. The
target is for the same kind of link: a station that reaches the companion by UDP is compared to one that reaches the
autopilot by UDP, and TCP to TCP. UDP beside direct TCP is told without a target. All are real processes. The autopilot
is ArduCopter's program where there is one, else `sitl/run/log_server.py`. The stations are the installed MAVProxy with
the modules that it loads by itself, and programs of pymavlink and MAVSDK (`sitl/run/log_reader.py`). Rate and retries
are what a station tells at the end of its download, and the file must be right to the byte. A download that is not over
in time counts for the baseline as if it had ended then, and for the companion as nothing.

`starve`: whether observers' requests cost the commander its telemetry. The telemetry of a real vehicle in flight is
measured beside four observers that request everything they can, and without requests, in turns. The baseline is the
same flight with the same observers, which only send heartbeats. Each message is counted at the commander, over all
turns of a side; the message with the most loss is the result.
"""

from __future__ import annotations

import itertools
import math
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import companion_argv, mavproxy
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.policy.access import names
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.ids import MISSION_START
from sitl.bench.autopilot import A
from sitl.bench.results import Measurement, Pair, Say, compare, from_comparison, in_turns
from sitl.bench.rig import (
    AUTOPILOT,
    VEHICLE,
    BenchError,
    Rig,
    Timer,
    companion_config,
    last_words,
    shipped_mission,
    station_entry,
)
from sitl.bench.stations import FakeStation, load_mission, make_stations
from sitl.run import log_reader
from sitl.run.log_server import log_bytes
from sitl.run.processes import Child
from sitl.script.places import guard_files
from sitl.vehicles import RunningVehicle, VehicleSpec, find_arducopter, launch
from sitl.vehicles.arducopter import arguments_of
from sitl.vehicles.ports import LOOPBACK, PortPicker
from sitl.vehicles.process import BASE_PARAMETERS

__all__ = [
    "DOWNLOAD",
    "DOWNLOAD_QUICK",
    "GREED",
    "STARVE",
    "STARVE_QUICK",
    "DownloadPlan",
    "StarvePlan",
    "download",
    "finished",
    "mavsdk",
    "slowest",
    "starve",
]

# ---- log downloads --------------------------------------------------------------------------------------------------

DOWNLOAD_RATIO: Final = 0.8
_POLL_S: Final = 0.05
_UP_LIMIT_S: Final = 60.0
#: a download that has brought nothing by then was not let through yet: it is asked for again
_BEGUN_S: Final = 3.0
_FINISHED: Final = re.compile(r"Finished downloading .*\((\d+) bytes .* ([\d.]+) kbyte/sec (\d+|unknown) retries\)")
_READER: Final = log_reader.__file__
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
        f"--source-system={A}",
        f"--target-system={VEHICLE}",
    ],
    f"Detected vehicle {VEHICLE}:{AUTOPILOT}",
    " parameters",  # which it fetches at once, by file transfer
)


def pymavlink() -> Program:
    """A program of the installed pymavlink."""
    return Program(
        f"pymavlink {version('pymavlink')}",
        lambda link, port: [sys.executable, _READER, "pymavlink", _of_pymavlink(link, port)],
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
        lambda link, port: [python, _READER, "mavsdk", _of_mavsdk(link, port)],
        "ready",
    )


@dataclass(frozen=True, slots=True)
class DownloadPlan:
    """Bytes of the log, pairs of downloads, and the longest that one may take."""

    size: int
    pairs: int
    limit_s: float
    #: kinds of link to the companion, each with those of the direct one
    links: tuple[tuple[str, tuple[str, ...]], ...] = (("udp", ("udp", "tcp")), ("tcp", ("tcp",)))
    #: False: the small server even where ArduCopter's program is, and stock MAVProxy alone
    real: bool = True
    #: Pythons that have MAVSDK
    mavsdk: tuple[str, ...] = (sys.executable,)


DOWNLOAD = DownloadPlan(3_000_000, 3, 120.0)
DOWNLOAD_QUICK = DownloadPlan(400_000, 1, 20.0, (("udp", ("udp",)),), real=False)


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


class Site(Rig):
    """An autopilot with a log, and a companion."""

    def __init__(self, folder: Path, link: str, plan: DownloadPlan) -> None:
        super().__init__(folder)
        self._link, self._plan = link, plan
        self._log = log_bytes(plan.size)
        picker = PortPicker()
        self._tcp, self._companion_tcp, self._udp = picker.tcp(), picker.tcp(), picker.udp()
        self._station_port = picker.udp() if link == "udp" else picker.tcp()
        self._program = find_arducopter() if plan.real else None
        self.vehicle = "log server" if self._program is None else "arducopter"
        self._number = 0

    def set_up(self) -> None:
        vehicle = self.run("vehicle", self._autopilot(self.folder / "vehicle"))
        way = "udpout" if self._link == "udp" else "tcpin"
        entry = {**station_entry("GCSA", A, 0), "module": False, "consent": "automatic"}
        entry["links"] = [f"{way}:{LOOPBACK}:{self._station_port}"]
        companion = self.folder / "companion"
        config = companion_config(companion, [entry])
        if self._program is None:  # MAVProxy does not try a second time
            self._wait_for(vehicle, "ready")
        else:
            time.sleep(1.0)
        argv = companion_argv(config, f"tcp:{LOOPBACK}:{self._companion_tcp}", companion / "mav.tlog")
        self._wait_for(self.run("companion", argv), "stations GCSA")

    def _autopilot(self, home: Path) -> list[str]:
        """The command of the autopilot, whose log is there."""
        tcp, udp = {0: self._tcp, 1: self._companion_tcp}, f"{LOOPBACK}:{self._udp}"
        if self._program is None:
            ports = [word for port in tcp.values() for word in ("--tcp", str(port))]
            argv = [sys.executable, "-m", "sitl.run.log_server", "--size", str(self._plan.size)]
            return [*argv, *ports, "--udp", str(self._udp)]
        (home / "logs").mkdir(parents=True)
        (home / "logs" / "00000001.BIN").write_bytes(self._log)
        (home / "logs" / "LASTLOG.TXT").write_text("1\n", encoding="ascii")
        parameters = home / "base.parm"
        shutil.copy(BASE_PARAMETERS, parameters)
        spec = VehicleSpec(home=(52.6792, 5.9240, 0.0, 0.0), sysid=VEHICLE)
        return [*arguments_of(self._program, spec, "quad", tcp, [parameters]), "--serial2", f"udpclient:{udp}"]

    def through_companion(self, program: Program) -> _Download:
        """One download by a station of its own. Raises BenchError, OSError."""
        return self._download(program, "ours", program.argv(self._link, self._station_port))

    def directly(self, program: Program, link: str) -> _Download:
        """Measure a download from the autopilot itself. Raises BenchError, OSError."""
        return self._download(program, "direct", program.argv(link, self._udp if link == "udp" else self._tcp))

    def _download(self, program: Program, way: str, argv: list[str]) -> _Download:
        self._number += 1
        name = f"{way}-{self._number}"
        station = self.run(name, argv)
        try:
            self._wait_for(station, program.ready)
            if self._program is not None and program.ready_real:
                self._wait_for(station, program.ready_real)
            return self._downloaded(station, way == "ours")
        finally:
            station.stop()

    @staticmethod
    def _wait_for(station: Child, text: str) -> None:
        until = time.monotonic() + _UP_LIMIT_S
        while not any(text in line for line in station.console()):
            if time.monotonic() > until or not station.alive():
                raise BenchError(f"{station.name}: no {text!r} (console: {last_words(station)})")
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
            raise BenchError(f"{station.name}: no log data (console: {last_words(station)})")
        return _Download(0.0 if ours else self._plan.size / self._plan.limit_s / 1e3, over=False)


def _programs(plan: DownloadPlan, say: Say) -> list[Program]:
    """The ground stations that download."""
    if not plan.real:
        return [MAVPROXY]
    found = {python: mavsdk(python) for python in plan.mavsdk}
    for python in (python for python, program in found.items() if program is None):
        say(f"download: {python} has no mavsdk: MAVSDK is not measured (--mavsdk PYTHON)")
    return [MAVPROXY, pymavlink(), *filter(None, found.values())]


def download(plan: DownloadPlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """One line for each program, kind of link and direct way. Raises BenchError, ConfigError, LaunchError, OSError."""
    programs = _programs(plan, say)
    for link, ways in plan.links:
        with Site(folder / "download" / link, link, plan) as site:
            for program, way in itertools.product(programs, ways):
                yield _downloaded(site, program, link, way, plan, say)


def _downloaded(site: Site, program: Program, link: str, way: str, plan: DownloadPlan, say: Say) -> Measurement:
    def turn(ours: bool) -> _Download:
        return site.through_companion(program) if ours else site.directly(program, way)

    found: list[tuple[_Download, _Download]] = []
    for ours, direct in islice(in_turns(turn), plan.pairs):
        found.append((ours, direct))
        say(
            f"{site.vehicle}, {program.name}, {link}: {ours.kbytes_per_s:.0f} kB/s, {ours}; "
            f"directly by {way} {direct.kbytes_per_s:.0f} kB/s, {direct}"
        )
    pairs = [Pair(ours.kbytes_per_s, direct.kbytes_per_s) for ours, direct in found]
    through, directly = zip(*found, strict=True)
    return from_comparison(
        "download",
        f"log download by {program.name}",
        "kB/s",
        {"vehicle": site.vehicle, "link": link, "direct": way, "log_kB": plan.size // 1000},
        compare(pairs),
        limit=DOWNLOAD_RATIO if link == way else None,
        at_least=True,
        details={
            "retries": [one.retries for one in through],
            "retries_direct": [one.retries for one in directly],
        },
        note=f"{site.vehicle}, {program.name}, {link}: the baseline is the same program at the autopilot by {way}; "
        f"{', '.join(map(str, through))}, directly {', '.join(map(str, directly))}",
    )


# ---- greedy observers -----------------------------------------------------------------------------------------------


TELEMETRY_RATIO: Final = 0.9
OBSERVERS: Final = 4
#: seen less often than this (1/s), a message says nothing about a rate
_LEAST_HZ: Final = 0.9
#: answers to requests, and messages about events, are no telemetry
_NO_TELEMETRY: Final = names("""
    STATUSTEXT PARAM_VALUE PARAM_ERROR COMMAND_ACK FILE_TRANSFER_PROTOCOL TIMESYNC MISSION_COUNT MISSION_ITEM_INT
    TERRAIN_REPORT AUTOPILOT_VERSION HOME_POSITION GPS_GLOBAL_ORIGIN CONNECT
""")
_STREAM_HZ: Final = 4
_READY_LIMIT_S: Final = 150.0
_SETTLE_S: Final = 2.0
#: until it flies its mission, and until it stands still
_MANOEUVRE_S: Final = 10.0
_COMPANION_CHANNEL: Final = 1


@dataclass(frozen=True, slots=True)
class StarvePlan:
    """Pairs of turns, the seconds of each, and the kinds of vehicle."""

    pairs: int
    seconds: float
    vehicles: tuple[str, ...] = ("builtin", "arducopter")


STARVE = StarvePlan(4, 15.0)
STARVE_QUICK = StarvePlan(1, 5.0, ("builtin",))


@dataclass(frozen=True, slots=True)
class _Slowest:
    """The message that has lost most: its rates with and without greed (1/s), and their ratio."""

    name: str
    greedy_hz: float
    calm_hz: float
    ratio: float


def _ftp(opcode: int, path: bytes) -> mavlink.MAVLink_message:
    head = bytes([0, 0, 0, opcode, len(path), 0, 0, 0, 0, 0, 0, 0])
    return mavlink.MAVLink_file_transfer_protocol_message(0, VEHICLE, AUTOPILOT, list((head + path).ljust(251, b"\0")))


def _command(number: int, *parameters: float) -> mavlink.MAVLink_message:
    values = [*parameters, *[0.0] * (7 - len(parameters))]
    return mavlink.MAVLink_command_long_message(VEHICLE, AUTOPILOT, number, 0, *values)


def _somewhere() -> mavlink.MAVLink_message:
    lat, lon = random.uniform(52.0, 53.0), random.uniform(5.0, 6.0)
    return mavlink.MAVLink_terrain_check_message(round(lat * 1e7), round(lon * 1e7))


_indexes = itertools.count()

#: what a greedy observer asks for, and how often a second
GREED: Final[dict[str, tuple[float, Callable[[], mavlink.MAVLink_message]]]] = {
    "parameter list": (2.0, lambda: mavlink.MAVLink_param_request_list_message(VEHICLE, AUTOPILOT)),
    "directory": (2.0, lambda: _ftp(3, b"/")),
    "file": (2.0, lambda: _ftp(4, b"@PARAM/param.pck")),
    "banner": (2.0, lambda: _command(mavlink.MAV_CMD_DO_SEND_BANNER)),
    "terrain": (2.0, _somewhere),
    "mission list": (2.0, lambda: mavlink.MAVLink_mission_request_list_message(VEHICLE, AUTOPILOT, 0)),
    "mission item": (10.0, lambda: mavlink.MAVLink_mission_request_int_message(VEHICLE, AUTOPILOT, 1, 0)),
    "parameter": (
        20.0,
        lambda: mavlink.MAVLink_param_request_read_message(VEHICLE, AUTOPILOT, b"", next(_indexes) % 500),
    ),
    "version": (2.0, lambda: _command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)),
    "home": (2.0, lambda: _command(mavlink.MAV_CMD_GET_HOME_POSITION)),
    "streams": (1.0, lambda: mavlink.MAVLink_request_data_stream_message(VEHICLE, AUTOPILOT, 0, 50, 1)),
    "interval": (1.0, lambda: _command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 1000)),
    "log list": (1.0, lambda: mavlink.MAVLink_log_request_list_message(VEHICLE, AUTOPILOT, 0, 0xFFFF)),
}


class Hungry(Rig):
    """A vehicle, its companion, the commander and the observers."""

    def __init__(self, folder: Path, kind: str) -> None:
        """Raises OSError."""
        super().__init__(folder)
        self.stations = make_stations(self.loop, 1 + OBSERVERS)
        self.commander = self.stations[0]
        self._kind = kind
        self._vehicle: RunningVehicle | None = None
        self._greed: list[Timer] = []

    def close(self) -> None:
        super().close()
        if self._vehicle is not None:
            self._vehicle.stop()
        for station in self.stations:
            station.close()

    def set_up(self) -> None:
        package, commander = shipped_mission("delivery"), self.commander
        self._vehicle = self._launch(package)
        home = self.folder / "companion"
        config = companion_config(home, [station.entry() for station in self.stations], guard=True)
        self.run("companion", companion_argv(config, self._vehicle.companion_master, home / "mav.tlog"))
        self.wait(lambda: commander.commander == A, "the parent commands")
        load_mission(self, commander, package, _READY_LIMIT_S)
        commander.digest = package.digest  # the observers have none, so none takes the aircraft
        start = self.loop.every(3.0, lambda: commander.send(_command(MISSION_START)))
        self.wait(lambda: commander.phase == Phase.ON_MISSION, "the aircraft has started", _READY_LIMIT_S)
        start.cancel()
        self.loop.run(_MANOEUVRE_S)
        commander.send(_command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0))  # it stays in the zone of no other station
        commander.send(mavlink.MAVLink_request_data_stream_message(VEHICLE, AUTOPILOT, 0, _STREAM_HZ, 1))
        self.loop.run(_MANOEUVRE_S)

    def _launch(self, package: MissionPackage) -> RunningVehicle:
        home = package.route.home
        script, parameters = guard_files()
        spec = VehicleSpec(
            home=(home.lat_deg, home.lon_deg, home.alt_m, 0.0),
            sysid=VEHICLE,
            scripts=(script,),
            defaults=parameters,
            parameters={"HNDO_CHAN": _COMPANION_CHANNEL},
        )
        return launch(self._kind, spec, self.folder / "vehicle")

    def check(self) -> None:
        super().check()
        if self._vehicle is not None and not self._vehicle.alive():
            raise BenchError(f"{self._kind}: the vehicle has ended")

    def turn(self, greedy: bool, seconds: float) -> Counter[int]:
        """The messages that the commander hears in this time (s), by id. Raises BenchError."""
        for number, observer in enumerate(self.stations[1:] if greedy else ()):
            self._ask(observer, number)
        self.loop.run(_SETTLE_S)
        before = self.commander.heard.copy()
        self.loop.run(seconds)
        heard = self.commander.heard - before
        for timer in self._greed:
            timer.cancel()
        self._greed = []
        self.check()
        if self.commander.commander != A or self.commander.phase != Phase.ON_MISSION:
            raise BenchError(f"{self._kind}: the flight did not go on as it was")
        return heard

    def _ask(self, observer: FakeStation, number: int) -> None:
        def asks(make: Callable[[], Any]) -> Callable[[], None]:
            return lambda: observer.send(make())

        for place, (per_second, make) in enumerate(GREED.values()):
            first_in_s = (number * 0.618 + place * 0.382) % 1.0 / per_second
            self._greed.append(self.loop.every(1.0 / per_second, asks(make), first_in_s))


def slowest(greedy: Counter[int], calm: Counter[int], seconds: float) -> _Slowest:
    """The message whose rate has fallen most, of those that are telemetry. Raises BenchError if there is none."""
    found = _Slowest("", 0.0, 0.0, math.inf)
    for msgid, count in calm.items():
        known = mavlink.mavlink_map.get(msgid)
        if known is None or known.msgname in _NO_TELEMETRY or count < _LEAST_HZ * seconds:
            continue
        ratio = greedy[msgid] / count
        if ratio < found.ratio:
            found = _Slowest(known.msgname, greedy[msgid] / seconds, count / seconds, ratio)
    if not found.name:
        raise BenchError("the commander hears no telemetry")
    return found


def starve(plan: StarvePlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Fly each vehicle, ask, count. Raises BenchError, LaunchError, OSError, MissionError."""
    for vehicle in plan.vehicles:
        if vehicle == "arducopter" and find_arducopter() is None:
            say("starve: no arducopter program here: measured on the embedded vehicle alone")
        else:
            yield _starved(plan, folder / f"starve-{vehicle}", vehicle, say)


def _starved(plan: StarvePlan, folder: Path, vehicle: str, say: Say) -> Measurement:
    greedy, calm = Counter[int](), Counter[int]()
    begun = time.monotonic()
    with Hungry(folder, vehicle) as flight:
        say(f"{vehicle}: in the air after {time.monotonic() - begun:.0f} s")
        pairs = in_turns(partial(flight.turn, seconds=plan.seconds))
        for number, (with_greed, without) in enumerate(islice(pairs, plan.pairs), 1):
            greedy += with_greed
            calm += without
            seconds = number * plan.seconds
            lost = slowest(greedy, calm, seconds)
            say(f"{vehicle}, {seconds:.0f} s each: {lost.name} {lost.greedy_hz:.2f} of {lost.calm_hz:.2f} Hz")

    def rates_hz(msgid: int) -> list[float]:
        return [greedy[msgid] / seconds, calm[msgid] / seconds]

    kinds = {msgid: mavlink.mavlink_map[msgid].msgname for msgid in calm if msgid in mavlink.mavlink_map}
    texts = rates_hz(mavlink.MAVLINK_MSG_ID_STATUSTEXT)
    return Measurement(
        "starve",
        "telemetry at the commander, slowest message",
        "Hz",
        {"vehicle": vehicle, "observers": OBSERVERS},
        lost.greedy_hz,
        lost.calm_hz,
        lost.ratio,
        pairs=plan.pairs,
        limit=TELEMETRY_RATIO,
        at_least=True,
        details={
            "message": lost.name,
            "statustext_hz": texts,
            "rates_hz": {name: rates_hz(msgid) for msgid, name in kinds.items()},
            "asked_hz_by_each": {what: per_second for what, (per_second, _make) in GREED.items()},
        },
        note=f"{vehicle}: {lost.name} has lost most; "
        f"lines of text come {texts[0]:.1f} and {texts[1]:.1f} times a second",
    )

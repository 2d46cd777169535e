# SPDX-License-Identifier: GPL-3.0-or-later

"""The longest time between two leases under load, as the autopilot sees it: does the companion's main loop stall?

The guard flies home after three seconds without a lease. The lease is sent from MAVProxy's main loop, so a stall of the
loop shows here: a slow disk, parsing of packages, writing of journals, other programs. Each load has its own companion
process, with an artificial autopilot on a serial line and two stations that sign. In flight authority goes from one to
the other about once a second.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import companion_argv
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MAX_PLAIN_BYTES, MissionPackage
from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.wire.ids import COMPANION_COMPID, LEASE_TUNNEL
from mavproxy_handover.wire.package_transfer import CHUNK_BYTES, package_id
from sitl.bench.autopilot import SerialAutopilot
from sitl.bench.loop import BenchError, Loop
from sitl.bench.numbers import median, quantile
from sitl.bench.private_mounts import SmallDisk, small_disk
from sitl.bench.results import Measurement
from sitl.bench.rig import key_file, key_for, toml
from sitl.bench.shuttle import A, B, Shuttle
from sitl.bench.talker import TalkingStation
from sitl.bench.traffic import VEHICLE, Place
from sitl.run.processes import Child, Processes
from sitl.run.slow_disk import on_slow_disk
from sitl.script.places import SetupError

__all__ = ["LOADS", "Plan", "measure"]

#: the longest gap between leases that is allowed, under any load
LIMIT_S: Final = 0.4
FSYNC_S: Final = 2.0
#: about this time (s) between two transfers
_PAUSE_S: Final = 0.8
_LIMIT_START_S: Final = 60.0
_STREAM: Final = 50
_FLOOD_EVERY_S, _FLOOD_FRAMES = 0.01, 20
_BUSY: Final = 4
_TUNNEL: Final = 385
_WHO = {A: "GCSA", B: "GCSB"}


@dataclass(frozen=True, slots=True)
class Plan:
    """How long each load lasts, and which there are."""

    seconds: float
    loads: tuple[str, ...]


class _Bench:
    """A companion process, its autopilot and its stations."""

    def __init__(self, folder: Path, under: Sequence[str] = ()) -> None:
        """`under`: words before the companion's command line. `folder`/disk is the companion's disk."""
        self.loop = Loop()
        self.folder = folder
        self.autopilot = SerialAutopilot(self.loop, Place(52.6790, 5.9240))
        self.shuttle = Shuttle(self.autopilot.model, _PAUSE_S, 1)
        self.stations = {sysid: TalkingStation(self.loop, name, sysid, key_for(name)) for sysid, name in _WHO.items()}
        self.package = mission_package.load(shipped("missions") / "delivery")
        #: when leases arrived (monotonic s), and the largest delay of the bench itself
        self.leases: list[float] = []
        self.late_s = 0.0
        self._under = tuple(under)
        self._processes = Processes()
        self._child: Child | None = None
        self._beat_at = 0.0

    def __enter__(self) -> _Bench:
        try:
            config = self._configure()
            argv = companion_argv(config, self.autopilot.device, self.folder / "mav.tlog")
            self._child = self._processes.start("companion", [*self._under, *argv], self.folder)
            model = self.autopilot.model
            model.stream(_STREAM)
            model.on_frame = self._saw
            self.loop.every(0.02, self._beat)
            self.wait(lambda: model.commander == A, "the parent commands")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process and close everything."""
        self._processes.stop_all()
        for station in self.stations.values():
            station.close()
        self.autopilot.close()

    def _configure(self) -> Path:
        stations = [
            {
                "name": name,
                "sysid": sysid,
                "links": [f"udpout:127.0.0.1:{self.stations[sysid].port}"],
                "key": str(key_file(self.folder / "keys", name)),
            }
            for sysid, name in _WHO.items()
        ]
        vehicle = {
            "name": "drone-1",
            "sysid": VEHICLE,
            "parent": "GCSA",
            "guard": False,
            "journal": str(self.folder / "log" / "companion.jsonl"),
            "state": str(self.folder / "disk" / "state"),
        }
        tables: dict[str, Any] = {
            "vehicle": vehicle,
            "station": stations,
            "limits": {"dwell_s": 0.0},
            "policy": {"out_of_coverage": "warn", "commander_lost": "warn"},
        }
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / "handover.toml"
        path.write_text(toml(tables), encoding="utf-8")
        return path

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Run until the condition is true. Raises BenchError after a time limit, and if the process ends."""

        def checked() -> bool:
            self.check()
            return condition()

        self.loop.run_until(checked, _LIMIT_START_S, what)

    def check(self) -> None:
        """Raises BenchError if the process has ended."""
        if self._child is not None and not self._child.alive():
            raise BenchError(f"the companion has ended: {' | '.join(self._child.console()[-5:])}")

    def take_off(self) -> None:
        """Load the mission and start the flight from zone to zone."""
        parent = self.stations[A]
        parent.share(self.package)
        self.wait(lambda: parent.shared or bool(parent.share_trouble), "the mission package is loaded")
        if parent.share_trouble:
            raise BenchError(f"mission package refused: {parent.share_trouble}")
        for station in self.stations.values():
            station.hold(self.package)
        self.autopilot.model.take_off()
        self.wait(lambda: parent.phase == Phase.ON_MISSION, "the aircraft is on its mission")
        self.loop.every(0.01, self.shuttle.step, 1.0)
        self.wait(lambda: self.shuttle.commits >= 1, "a first transfer")

    def run(self, seconds: float) -> list[float]:
        """Let time pass. Returns the gaps between the leases in it (s), the unfinished one at the end included."""
        begun_at, first = time.monotonic(), len(self.leases)
        self.late_s, self._beat_at = 0.0, 0.0
        until = begun_at + seconds
        while time.monotonic() < until:
            self.loop.run(0.25)
            self.check()
        marks = [begun_at, *self.leases[first:], time.monotonic()]
        return [after - before for before, after in pairwise(marks)]

    def _saw(self, raw: bytes) -> None:
        ours = raw[0] == 0xFD and raw[6] == COMPANION_COMPID and int.from_bytes(raw[7:10], "little") == _TUNNEL
        if ours and int.from_bytes(raw[10:12], "little") == LEASE_TUNNEL:
            self.leases.append(self.autopilot.received_at)

    def _beat(self) -> None:
        now = time.monotonic()
        if self._beat_at:
            self.late_s = max(self.late_s, now - self._beat_at - 0.02)
        self._beat_at = now


# ---- loads ----------------------------------------------------------------------------------------------------------


Measured = tuple[list[float], _Bench]


@contextmanager
def _flying(folder: Path, under: Sequence[str] = ()) -> Iterator[_Bench]:
    with _Bench(folder, under) as bench:
        bench.take_off()
        yield bench


def _nothing(folder: Path, seconds: float) -> Measured:
    with _flying(folder) as bench:
        return bench.run(seconds), bench


def _slow_disk(folder: Path, seconds: float) -> Measured:
    with _flying(folder, on_slow_disk(folder, FSYNC_S)) as bench:
        return bench.run(seconds), bench


def _bad_disk(folder: Path, seconds: float, parts: Sequence[str], spoil: Callable[[SmallDisk], None]) -> Measured:
    with ExitStack() as stack:
        disks = [stack.enter_context(small_disk(folder / part)) for part in parts]
        bench = stack.enter_context(_flying(folder))
        for disk in disks:
            spoil(disk)
        return bench.run(seconds), bench


def _busy(folder: Path, seconds: float) -> Measured:
    with _flying(folder) as bench:
        others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(_BUSY)]
        try:
            return bench.run(seconds), bench
        finally:
            for other in others:
                other.kill()
                other.wait()


def _journal_flood(folder: Path, seconds: float) -> Measured:
    """Frames in the stations' names without a signature, of many kinds, by the stations' own links."""
    with _flying(folder) as bench:
        numbers = iter(range(1 << 30))

        def flood() -> None:
            for _ in range(_FLOOD_FRAMES):
                number = next(numbers)
                plain = mavlink.MAVLink(None, srcSystem=(A, B, 77)[number % 3], srcComponent=190)
                message = mavlink.MAVLink_command_long_message(VEHICLE, 1, number % 500, 0, number, 0, 0, 0, 0, 0, 0)
                bench.stations[(A, B)[number % 2]].put(bytes(message.pack(plain)))

        bench.loop.every(_FLOOD_EVERY_S, flood)
        return bench.run(seconds), bench


class _Packages:
    """Sends packages that cost their reader much time.

    It sends one after the other, and never waits for an answer.
    """

    def __init__(self, bench: _Bench, station: TalkingStation) -> None:
        self._station = station
        self._packages = [(f"p{n}", data) for n, data in enumerate(_hostile_packages(bench.package))]
        self._frames: Iterator[Any] = iter(())
        self._number = 0
        bench.loop.every(0.01, self._step)

    def _step(self) -> None:
        for _ in range(8):
            message = next(self._frames, None)
            if message is None:
                self._number += 1
                self._frames = self._next()
                return
            self._station.send(message)

    def _next(self) -> Iterator[Any]:
        name, data = self._packages[self._number % len(self._packages)]
        # the digest is wrong: that shows only after the package has been read
        digest = (self._number.to_bytes(4, "little") * 8)[:32]
        target = (VEHICLE, COMPANION_COMPID)
        yield mavlink.MAVLink_mission_package_message(*target, len(data), list(digest), name.encode())
        for offset in range(0, len(data), CHUNK_BYTES):
            piece = data[offset : offset + CHUNK_BYTES]
            padded = list(piece.ljust(CHUNK_BYTES, b"\0"))
            yield mavlink.MAVLink_mission_chunk_message(*target, package_id(digest), offset, len(piece), padded)


def _hostile_packages(package: MissionPackage) -> list[bytes]:
    """Packages of a few kilobytes each: endless numbers, empty lists, deep nesting, and comb-shaped zones."""
    room = MAX_PLAIN_BYTES - 10
    plain = [
        (b"9" * 399 + b" ") * (room // 400),
        b"[" + b"[]," * (room // 3 - 1) + b"[]]",
        b"[" + b"1," * (room // 2 - 1) + b"1]",
        b"[" * room,
    ]
    texts = {name: data.decode() for name, data in package.files.items()}
    for teeth in (60, 240):
        zones = json.loads(texts["zones.geojson"])
        zones["features"][0]["geometry"]["coordinates"] = [_comb(teeth)]
        combed = {**texts, "zones.geojson": json.dumps(zones)}
        plain.append(json.dumps(combed, sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode())
    return [zlib.compress(text, 9) for text in plain]


def _comb(teeth: int) -> list[list[float]]:
    west, east, south, north = 5.9200, 5.9340, 52.6760, 52.6830
    ring = [[west, south]]
    step = (east - west) / (2 * teeth)
    for number in range(teeth):
        left, middle, right = (round(west + (2 * number + part) * step, 7) for part in (0, 1, 2))
        ring += [[left, north], [middle, north], [middle, south + 0.0002], [right, south + 0.0002]]
    return [*ring, [east, south], [west, south]]


def _packages_in_flight(folder: Path, seconds: float) -> Measured:
    with _flying(folder) as bench:
        _Packages(bench, bench.stations[B])
        return bench.run(seconds), bench


def _packages_on_the_ground(folder: Path, seconds: float) -> Measured:
    """On the ground all packages of the parent are read."""
    with _Bench(folder) as bench:
        bench.loop.run(2.0)
        _Packages(bench, bench.stations[A])
        return bench.run(seconds), bench


#: name -> how it is measured; the others are compared to the first one
LOADS: dict[str, Callable[[Path, float], Measured]] = {
    "none": _nothing,
    f"fsync {FSYNC_S:g} s": _slow_disk,
    "full disk": partial(_bad_disk, parts=("disk", "log"), spoil=SmallDisk.fill),
    "read-only disk": partial(_bad_disk, parts=("disk",), spoil=SmallDisk.turn_read_only),
    "hostile packages, in flight": _packages_in_flight,
    "hostile packages, on the ground": _packages_on_the_ground,
    "journal flood": _journal_flood,
    f"{_BUSY} busy processes": _busy,
}


def measure(plan: Plan, folder: Path, say: Callable[[str], None]) -> Iterator[Measurement]:
    """One companion after the other. A load that cannot be made is reported, and the others continue."""
    quiet: float | None = None
    for number, name in enumerate(plan.loads):
        try:
            gaps, bench = LOADS[name](folder / f"stalls-{number}", plan.seconds)
        except (BenchError, SetupError, OSError) as error:
            say(f"{name}: NOT MEASURED: {error}")
            yield Measurement(
                "stalls", "longest gap", "s", {"load": name}, limit=LIMIT_S, judged="ours", note=str(error)
            )
            continue
        longest = max(gaps)
        quiet = longest if number == 0 else quiet
        commits = bench.shuttle.commits
        say(f"{name}: longest gap {longest:.3f} s, {len(gaps)} leases, {commits} transfers")
        yield Measurement(
            "stalls",
            "longest gap",
            "s",
            {"load": name, "transfers": commits},
            ours=longest,
            baseline=quiet,
            limit=LIMIT_S,
            judged="ours",
            details={
                "leases": len(gaps),
                "median_s": median(gaps),
                "p99_s": quantile(gaps, 0.99),
                "bench_late_s": bench.late_s,
                "given_up": bench.shuttle.given_up,
            },
            note="between two leases, as the autopilot sees it; baseline: without any load, in the same run",
        )

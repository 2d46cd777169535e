# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion under load: whether leases keep coming, and how soon it starts again after death and stall.

`stalls`: the longest time between two leases, as the autopilot sees it. The guard flies home after three seconds
without a lease. The lease is sent from MAVProxy's main loop, so a stall of the loop shows here: a slow disk, parsing of
packages, writing of journals, other programs. Each load has its own companion process, with an artificial autopilot on
a serial line and two stations that sign. In flight authority goes from one to the other about once a second.

`restart`: how long the guard has no commander when the companion dies or stalls in flight. The time is from the last
lease of one run to the first HELD one of the next. Real processes, one vehicle and two signed stations, every link with
20 % loss each way, and four busy processes. Ours is `handover companion`, whose child is killed (SIGKILL) or stopped
(SIGSTOP: it stalls and does not die). The baseline is the same MAVProxy without a supervisor, killed and started again
at once by a watcher that does nothing else. `--restarts-within 0` lets the supervisor forget every restart: the rule
for the third one would end the measurement.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import random
import signal
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from statistics import median
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import companion_argv, supervised_argv
from mavproxy_handover.core.common.model import LeaseState, Phase
from mavproxy_handover.mission.package import MAX_PLAIN_BYTES, MissionPackage
from mavproxy_handover.wire.ids import COMPANION_COMPID, LEASE_TUNNEL
from mavproxy_handover.wire.package_transfer import CHUNK_BYTES, package_id
from sitl.bench.autopilot import SHUTTLE, STREAM, A, B, SerialAutopilot, Tour
from sitl.bench.results import Measurement, Say, quantile
from sitl.bench.rig import VEHICLE, BenchError, Rig, companion_config, key_for, shipped_mission
from sitl.bench.stations import TalkingStation, load_mission
from sitl.bench.transfers import Flight
from sitl.run.bad_disks import SmallDisk, on_slow_disk, small_disk
from sitl.run.processes import Processes
from sitl.script.places import SetupError

__all__ = ["LOADS", "RESTART", "RESTART_QUICK", "STALLS", "STALLS_QUICK", "StallPlan", "restart", "stalls"]

_BUSY: Final = 4
_KEEP_BUSY: Final = [sys.executable, "-c", "while True: pass"]


@contextmanager
def busy_processes(folder: Path) -> Iterator[None]:
    """Processes that use all the time they get."""
    with Processes() as load:
        for number in range(_BUSY):
            load.start(f"busy-{number}", _KEEP_BUSY, folder / "busy")
        yield


# ---- longest gap between leases -------------------------------------------------------------------------------------

#: the longest gap between leases that is allowed, under any load
LIMIT_S: Final = 0.4
FSYNC_S: Final = 2.0
#: about this time (s) between two transfers
_PAUSE_S: Final = 0.8
_FLOOD_EVERY_S, _FLOOD_FRAMES = 0.01, 20
_TUNNEL: Final = mavlink.MAVLINK_MSG_ID_TUNNEL


class Leases(Rig):
    """A companion process, its autopilot and its stations; the leases that arrive are noted."""

    def __init__(self, folder: Path, under: Sequence[str] = ()) -> None:
        """`under`: words before the companion's command line. `folder`/disk is the companion's disk."""
        super().__init__(folder)
        self.autopilot = SerialAutopilot(self.loop, SHUTTLE[0][0])
        self.tour = Tour(self.autopilot.model, SHUTTLE, _PAUSE_S, 1)
        self.parent, self.partner = (
            TalkingStation(self.loop, name, sysid, key_for(name)) for name, sysid in (("GCSA", A), ("GCSB", B))
        )
        self.package = shipped_mission("delivery")
        #: when leases arrived (monotonic s), and the largest delay of the bench itself
        self.leases: list[float] = []
        self.late_s = 0.0
        self._under = tuple(under)
        self._beat_at = 0.0

    def set_up(self) -> None:
        keys = self.folder / "keys"
        journal, state = self.folder / "log" / "companion.jsonl", self.folder / "disk" / "state"
        entries = [station.entry(keys) for station in (self.parent, self.partner)]
        config = companion_config(self.folder, entries, dwell_s=0.0, journal=str(journal), state=str(state))
        argv = companion_argv(config, self.autopilot.device, self.folder / "mav.tlog")
        self.run("companion", [*self._under, *argv])
        model = self.autopilot.model
        model.stream(STREAM)
        model.on_frame = self._saw
        self.loop.every(0.02, self._beat)
        self.wait(lambda: model.commander == A, "the parent commands")

    def close(self) -> None:
        super().close()
        self.parent.close()
        self.partner.close()
        self.autopilot.close()

    def take_off(self) -> None:
        """Load the mission and start the flight from zone to zone."""
        load_mission(self, self.parent, self.package)
        for station in (self.parent, self.partner):
            station.hold(self.package)
        self.autopilot.model.take_off()
        self.wait(lambda: self.parent.phase == Phase.ON_MISSION, "the aircraft is on its mission")
        self.loop.every(0.01, lambda: self.tour.step(time.monotonic()), 1.0)
        self.wait(lambda: self.tour.commits >= 1, "a first transfer")

    def gaps(self, seconds: float) -> list[float]:
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


Measured = tuple[list[float], Leases]


@contextmanager
def _flying(folder: Path, under: Sequence[str] = ()) -> Iterator[Leases]:
    with Leases(folder, under) as bench:
        bench.take_off()
        yield bench


def _slow_disk(folder: Path, seconds: float) -> Measured:
    with _flying(folder, on_slow_disk(folder, FSYNC_S)) as bench:
        return bench.gaps(seconds), bench


def _small_disks(
    folder: Path, seconds: float, parts: Sequence[str] = (), spoil: Callable[[SmallDisk], None] = SmallDisk.fill
) -> Measured:
    """With small disks for these parts of the folder, which are spoilt in flight."""
    with ExitStack() as stack:
        disks = [stack.enter_context(small_disk(folder / part)) for part in parts]
        bench = stack.enter_context(_flying(folder))
        for disk in disks:
            spoil(disk)
        return bench.gaps(seconds), bench


def _busy(folder: Path, seconds: float) -> Measured:
    with _flying(folder) as bench, busy_processes(folder):
        return bench.gaps(seconds), bench


def _journal_flood(folder: Path, seconds: float) -> Measured:
    """Frames in the stations' names without a signature, of many kinds, by the stations' own links."""
    with _flying(folder) as bench:
        numbers = itertools.count()

        def flood() -> None:
            for number in islice(numbers, _FLOOD_FRAMES):
                plain = mavlink.MAVLink(None, srcSystem=(A, B, 77)[number % 3], srcComponent=190)
                message = mavlink.MAVLink_command_long_message(VEHICLE, 1, number % 500, 0, number, 0, 0, 0, 0, 0, 0)
                (bench.parent, bench.partner)[number % 2].put(bytes(message.pack(plain)))

        bench.loop.every(_FLOOD_EVERY_S, flood)
        return bench.gaps(seconds), bench


class _Packages:
    """Sends packages that cost their reader much time.

    It sends one after the other, and never waits for an answer.
    """

    def __init__(self, bench: Leases, station: TalkingStation) -> None:
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
        _Packages(bench, bench.partner)
        return bench.gaps(seconds), bench


def _packages_on_the_ground(folder: Path, seconds: float) -> Measured:
    """On the ground all packages of the parent are read."""
    with Leases(folder) as bench:
        bench.loop.run(2.0)
        _Packages(bench, bench.parent)
        return bench.gaps(seconds), bench


#: name -> how it is measured; the others are compared to the first one
LOADS: dict[str, Callable[[Path, float], Measured]] = {
    "none": _small_disks,
    f"fsync {FSYNC_S:g} s": _slow_disk,
    "full disk": partial(_small_disks, parts=("disk", "log")),
    "read-only disk": partial(_small_disks, parts=("disk",), spoil=SmallDisk.turn_read_only),
    "hostile packages, in flight": _packages_in_flight,
    "hostile packages, on the ground": _packages_on_the_ground,
    "journal flood": _journal_flood,
    f"{_BUSY} busy processes": _busy,
}


@dataclass(frozen=True, slots=True)
class StallPlan:
    """How long each load lasts, and which there are."""

    seconds: float
    loads: tuple[str, ...]


STALLS = StallPlan(20.0, tuple(LOADS))
STALLS_QUICK = StallPlan(3.0, tuple(LOADS)[:2])


def stalls(plan: StallPlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """One companion after the other. A load that cannot be made is reported, and the others continue."""
    quiet: float | None = None
    for number, name in enumerate(plan.loads):
        gap = partial(Measurement, "stalls", "longest gap", "s", limit=LIMIT_S, judged="ours")
        try:
            gaps, bench = LOADS[name](folder / f"stalls-{number}", plan.seconds)
        except (BenchError, SetupError, OSError) as error:
            say(f"{name}: NOT MEASURED: {error}")
            yield gap({"load": name}, note=str(error))
            continue
        longest, commits = max(gaps), bench.tour.commits
        quiet = longest if number == 0 else quiet
        say(f"{name}: longest gap {longest:.3f} s, {len(gaps)} leases, {commits} transfers")
        yield gap(
            {"load": name, "transfers": commits},
            ours=longest,
            baseline=quiet,
            details={
                "leases": len(gaps),
                "median_s": median(gaps),
                "p99_s": quantile(gaps, 0.99),
                "bench_late_s": bench.late_s,
                "given_up": bench.tour.given_up,
            },
            note="between two leases, as the autopilot sees it; baseline: without any load, in the same run",
        )


# ---- death and stall ------------------------------------------------------------------------------------------------

#: "Numbers that are held to" in docs/architecture.md
KILLED_LATE_S, STALLED_LATE_S = 2.0, 2.5
_LOSS: Final = 0.2
#: a run that is not over by then is no measurement
_RUN_LIMIT_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class RestartPlan:
    """How many deaths, stalls, and deaths of the baseline."""

    kills: int
    stalls: int
    baseline: int


RESTART = RestartPlan(60, 60, 12)
RESTART_QUICK = RestartPlan(2, 2, 1)


class _Run:
    """The leases of the present run and the last one of the run before; times are monotonic seconds."""

    def __init__(self) -> None:
        self.nonce = 0
        self.last_at = -math.inf
        self.before_at = -math.inf
        self.held_at = math.inf

    def record(self, state: int, nonce: int) -> None:
        """One has arrived."""
        now = time.monotonic()
        if nonce != self.nonce:
            self.nonce, self.before_at, self.held_at = nonce, self.last_at, math.inf
        self.last_at = now
        if state == LeaseState.HELD:
            self.held_at = min(self.held_at, now)


def _again(config: Path, master: str, logfile: Path) -> list[str]:
    return [*supervised_argv(config, master, logfile), "--restarts-within=0"]


def _gaps(flight: Flight, number: int, end: Callable[[], None], luck: random.Random) -> list[float]:
    """End the companion's run so many times; the seconds without a HELD lease."""
    leases = _Run()
    flight.autopilot.model.on_lease = leases.record
    gaps: list[float] = []
    while len(gaps) < number:
        flight.loop.run_until(lambda: leases.held_at < math.inf, _RUN_LIMIT_S, "somebody commands")
        flight.loop.run(luck.uniform(1.0, 2.0))  # heartbeats come once a second: at any time between two
        flight.check()
        former = leases.nonce
        end()
        flight.loop.run_until(
            lambda former=former: leases.nonce != former and leases.held_at < math.inf,  # type: ignore[misc]
            _RUN_LIMIT_S,
            "a station commands after the restart",
        )
        gaps.append(leases.held_at - leases.before_at)
    return gaps


def _ending(flight: Flight, number: signal.Signals) -> Callable[[], None]:
    def end() -> None:
        child = flight.companion.offspring()
        if child is None:
            raise BenchError("the companion has no child")
        os.kill(child, number)

    return end


def restart(plan: RestartPlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Deaths and stalls of ours, and deaths of the baseline in between."""
    with busy_processes(folder):
        unsupervised = _fly(
            folder / "unsupervised", companion_argv, lambda flight: [(plan.baseline, flight.restart_companion)]
        )[0]
        say(f"without a supervisor: {_numbers(unsupervised)}")
        killed, stalled = _fly(
            folder / "supervised",
            _again,
            lambda flight: [
                (plan.kills, _ending(flight, signal.SIGKILL)),
                (plan.stalls, _ending(flight, signal.SIGSTOP)),
            ],
        )
        say(f"killed: {_numbers(killed)}")
        say(f"stalled: {_numbers(stalled)}")
    yield from _measurements("killed", killed, KILLED_LATE_S, unsupervised)
    yield from _measurements("stalled", stalled, STALLED_LATE_S, None)


def _fly(
    folder: Path,
    companion: Callable[[Path, str, Path], list[str]],
    ends: Callable[[Flight], list[tuple[int, Callable[[], None]]]],
) -> list[list[float]]:
    luck = random.Random(1)
    with Flight(folder, 1e6, bad_links=True, signing=True, companion=companion) as flight:
        flight.weather(f"loss all {_LOSS}")
        return [_gaps(flight, number, end, luck) for number, end in ends(flight)]


def _numbers(gaps: Sequence[float]) -> str:
    late, worst = quantile(gaps, 0.99), max(gaps)
    return f"{len(gaps)} restarts, median {median(gaps):.2f} s, 99 % {late:.2f} s, longest {worst:.2f} s"


def _measurements(
    what: str, gaps: Sequence[float], late_limit_s: float, baseline: Sequence[float] | None
) -> Iterator[Measurement]:
    case = {"load": f"{_BUSY} busy processes", "links": f"{_LOSS:.0%} loss each way", "n": len(gaps)}
    note = "from the last lease to the next HELD one; baseline: killed without a supervisor, started again at once"
    for name, part, limit in (("median", 0.5, None), ("99 %", 0.99, late_limit_s)):
        yield Measurement(
            "restart",
            f"{what}, {name}",
            "s",
            case,
            ours=quantile(gaps, part),
            baseline=None if baseline is None else quantile(baseline, part),
            limit=limit,
            judged="ours",
            details={"gaps_s": list(gaps)} if name == "median" else {},
            note=note,
        )

# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m sitl.bench`: runs the parts, writes `bench.jsonl`, prints the table.

The exit code says whether the measurements could be made, not whether the targets are held: a target that is missed is
a result. `--strict` makes it an error.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.keys import KeysError
from sitl.bench import downlink, download, energy, fleet, restart, stall_bench, starve, transfers, uplink, zones
from sitl.bench.loop import BenchError
from sitl.bench.results import Measurement, Results, table
from sitl.bench.rig import Rig
from sitl.run.memory import memory_of_a_run
from sitl.vehicles import LaunchError, find_arducopter

__all__ = ["main"]

PARTS = ("uplink", "downlink", "zones", "energy", "transfers", "stalls", "restart", "starve", "download", "fleet")
Say = Callable[[str], None]
_LONGEST_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Plans:
    """How much of everything. `starts`: least and most starts of the processes for uplink and downlink."""

    starts: tuple[int, int]
    uplink: uplink.Plan
    #: whether the stations sign, and whether the stock MAVProxy is as it comes
    uplinks: tuple[tuple[bool, bool], ...]
    downlink: downlink.Plan
    #: number of stations, and whether the stock MAVProxy is as it comes
    downlinks: tuple[tuple[int, bool], ...]
    zones: zones.Plan
    energy: energy.Plan
    loopback: int
    loopback_limit_s: float
    checked: int
    check_limit_s: float
    waves: tuple[tuple[transfers.Condition, ...], ...]
    lanes: transfers.LanePlan
    stalls: stall_bench.Plan
    restart: restart.Plan
    starve: starve.Plan
    download: download.Plan
    fleet: fleet.Plan
    #: download: Pythons that have MAVSDK
    mavsdk: tuple[str, ...] = (sys.executable,)


FULL = Plans(
    (2, 3),
    uplink.Plan({200: 4.2, 1000: 1.8}, 3.6, 2),
    ((False, False), (True, False), (True, True)),
    downlink.Plan((50, 200), 2.5),
    ((2, False), (2, True), (10, False)),
    zones.Plan((2, 10, 100), (50, 1000), 0.2, 4, 8),
    energy.Plan(0.2, 4, 8),
    300,
    120.0,
    20,
    60.0,
    (transfers.SLOW, transfers.LOSSY),
    transfers.LanePlan(300, 200.0),
    stall_bench.Plan(20.0, tuple(stall_bench.LOADS)),
    restart.Plan(60, 60, 12),
    starve.Plan(4, 15.0),
    download.Plan(3_000_000, 3, 120.0),
    fleet.Plan({1: 120.0, 2: 120.0, 5: 180.0, 10: 300.0}),
)
QUICK = Plans(
    (1, 1),
    uplink.Plan({1000: 0.9}, 0.9, 1),
    ((False, False), (True, False)),
    downlink.Plan((50,), 1.0),
    ((2, False),),
    zones.Plan((2, 10), (50,), 0.05, 1, 2),
    energy.Plan(0.05, 1, 2),
    20,
    15.0,
    0,
    0.0,
    ((transfers.SLOW[0], transfers.LOSSY[1]),),
    transfers.LanePlan(6, 15.0, 2),
    stall_bench.Plan(3.0, tuple(stall_bench.LOADS)[:2]),
    restart.Plan(2, 2, 1),
    starve.Plan(1, 5.0, ("builtin",)),
    download.Plan(400_000, 1, 20.0, (("udp", ("udp",)),), real=False),
    fleet.Plan({2: 12.0}, 2.0),
)


def _uplink(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    least, most = plans.starts
    fastest = max(plans.uplink.rates)
    for signs, as_it_comes in plans.uplinks:
        signing, stock = "on" if signs else "off", "as it comes" if as_it_comes else "our modules"
        case = {"signing": signing, "stock": stock}
        cpu = uplink.CpuStudy(plans.uplink, case)
        delay = uplink.DelayStudy(plans.uplink, case)
        alone = replace(plans.uplink, rates={fastest: plans.uplink.rates[fastest]})
        observer = None if as_it_comes else uplink.CpuStudy(alone, case, observer=True)
        name = f"uplink-signing-{signing}{'-as-it-comes' if as_it_comes else ''}"
        for start in range(most):
            with Rig(folder / f"{name}-{start}", 2, signs, as_it_comes) as rig:
                say(f"signing {signing}, stock {stock}, {cpu.measure(rig)}; {delay.measure(rig)}")
                if start == 0 and observer is not None:
                    say(f"signing {signing}, {observer.measure(rig)}")
            if start + 1 >= least and cpu.settled():
                break
        for study in (cpu, delay, observer):
            if study is not None:
                yield from study.results()


def _downlink(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    least, most = plans.starts
    for stations, as_it_comes in plans.downlinks:
        study = downlink.Study(plans.downlink, stations, as_it_comes)
        name = f"downlink-{stations}{'-as-it-comes' if as_it_comes else ''}"
        for start in range(most):
            with Rig(folder / f"{name}-{start}", stations, as_it_comes=as_it_comes) as rig:
                say(study.measure(rig))
            if start + 1 >= least and study.settled():
                break
        yield from study.results()


def _zones(plans: Plans, _folder: Path, say: Say) -> Iterator[Measurement]:
    return zones.measure(plans.zones, say)


def _energy(plans: Plans, _folder: Path, say: Say) -> Iterator[Measurement]:
    return energy.measure(plans.energy, say)


def _transfers(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    for signing in (False, True):
        where = folder / ("loopback-signed" if signing else "loopback")
        wanted = plans.loopback // 3 if signing else plans.loopback
        yield from transfers.fly_loopback(where, wanted, plans.loopback_limit_s, say, signing=signing)
    if plans.checked:
        yield from transfers.fly_with_bad_links(folder / "bad-links", plans.checked, plans.check_limit_s, say)
    for number, wave in enumerate(plans.waves):
        yield from transfers.fly_lanes(folder / f"lanes-{number}", wave, plans.lanes, say)


def _stalls(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    return stall_bench.measure(plans.stalls, folder / "stalls", say)


def _restart(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    return restart.measure(folder / "restart", plans.restart, say)


def _starve(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    for vehicle in plans.starve.vehicles:
        if vehicle == "arducopter" and find_arducopter() is None:
            say("starve: no arducopter program here: measured on the embedded vehicle alone")
            continue
        yield from starve.measure(folder / f"starve-{vehicle}", vehicle, plans.starve, say)


def _download(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    programs = [download.MAVPROXY]
    if plans.download.real:
        programs.append(download.pymavlink())
        for python in plans.mavsdk:
            program = download.mavsdk(python)
            if program is None:
                say(f"download: {python} has no mavsdk: MAVSDK is not measured (--mavsdk PYTHON)")
            else:
                programs.append(program)
    return download.measure(folder / "download", plans.download, programs, say)


def _fleet(plans: Plans, folder: Path, say: Say) -> Iterator[Measurement]:
    return fleet.measure(folder / "fleet", plans.fleet, say)


_RUN: dict[str, Callable[[Plans, Path, Say], Iterator[Measurement]]] = {
    "uplink": _uplink,
    "downlink": _downlink,
    "zones": _zones,
    "energy": _energy,
    "transfers": _transfers,
    "stalls": _stalls,
    "restart": _restart,
    "starve": _starve,
    "download": _download,
    "fleet": _fleet,
}


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m sitl.bench",
        description="Measure the companion: frames beside stock MAVProxy, zones, energy, transfers, leases, restarts, "
        "reads; and a station with many vehicles.",
    )
    parser.add_argument("--quick", action="store_true", help="a smoke test: everything once, under two minutes")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for bench.jsonl and logs (runs/bench-TIME)")
    parser.add_argument("--seconds", type=float, metavar="S", help="fleet: duration for each number of vehicles")
    parser.add_argument(
        "--mavsdk",
        action="append",
        metavar="PYTHON",
        help="download: a Python that has MAVSDK, for each to be measured (this one)",
    )
    parser.add_argument("--strict", action="store_true", help="exit code 1 if a target is missed")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"some of: {', '.join(PARTS)} (default: all)")
    arguments = parser.parse_args(argv)
    unknown = [part for part in arguments.parts if part not in PARTS]
    if unknown:
        parser.error(f"unknown part {unknown[0]!r}: must be one of {', '.join(PARTS)}")
    if arguments.seconds is not None and not 1.0 <= arguments.seconds <= _LONGEST_S:
        parser.error(f"--seconds {arguments.seconds:g}: must be 1 to {_LONGEST_S:.0f}")
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run; 0: measured, 1: a part could not be measured (or --strict and a target missed), 2: bad usage."""
    try:
        arguments = _arguments(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    folder: Path = arguments.out or Path("runs") / time.strftime("bench-%Y%m%d-%H%M%S")
    if folder.is_dir() and any(folder.iterdir()):  # journals are appended to
        print(f"bench: {folder} is not empty: measurements need a folder of their own", file=sys.stderr)
        return 2
    plans = QUICK if arguments.quick else FULL
    if arguments.seconds is not None:
        plans = replace(plans, fleet=plans.fleet.lasting(arguments.seconds))
    if arguments.mavsdk:
        plans = replace(plans, mavsdk=tuple(arguments.mavsdk))
    began = time.monotonic()

    def say(text: str) -> None:
        print(f"[{time.monotonic() - began:5.0f} s] {text}", flush=True)

    broken = False
    try:
        results = Results(folder / "bench.jsonl")
    except OSError as error:
        print(f"bench: {folder}: {error.strerror}", file=sys.stderr)
        return 2
    try:
        with memory_of_a_run():
            for part in arguments.parts or PARTS:
                say(f"{part} ...")
                try:
                    for measurement in _RUN[part](plans, folder.resolve(), say):
                        results.add(measurement)
                except (BenchError, ConfigError, KeysError, LaunchError, MissionError, OSError, ValueError) as error:
                    broken = True
                    say(f"{part}: NOT MEASURED: {error}")
                    results.line({"part": part, "error": str(error)})
    except KeyboardInterrupt:
        broken = True
        say("interrupted")
    print()
    print(table(results.measurements))
    missed = results.missed
    say(f"{len(missed)} of {sum(m.met is not None for m in results.measurements)} targets missed; {results.path}")
    return 1 if broken or (arguments.strict and missed) else 0

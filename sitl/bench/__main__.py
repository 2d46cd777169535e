# SPDX-License-Identifier: GPL-3.0-or-later

"""`python -m sitl.bench`: runs the parts, writes `bench.jsonl`, prints the table.

The exit code says whether the measurements could be made, not whether the targets are held: a target that is missed is
a result. `--strict` makes it an error.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.keys import KeysError
from sitl.bench import fleet, floods, frames, load, panel, reads, rules, transfers
from sitl.bench.results import Measurement, Results, Say, table
from sitl.bench.rig import BenchError
from sitl.run.memory import memory_of_a_run
from sitl.vehicles import LaunchError

__all__ = ["BENCHES", "main"]

_LONGEST_S: Final = 86_400.0


@dataclass(frozen=True, slots=True)
class Bench:
    """A part: what measures it, by which plan, and by which plan with --quick."""

    measure: Callable[[Any, Path, Say], Iterator[Measurement]]
    full: Any
    quick: Any


BENCHES: Final[Mapping[str, Bench]] = {
    "uplink": Bench(frames.uplink, frames.UPLINK, frames.UPLINK_QUICK),
    "downlink": Bench(frames.downlink, frames.DOWNLINK, frames.DOWNLINK_QUICK),
    "zones": Bench(rules.zones, rules.ZONES, rules.ZONES_QUICK),
    "energy": Bench(rules.energy, rules.ENERGY, rules.ENERGY_QUICK),
    "transfers": Bench(transfers.measure, transfers.FULL, transfers.QUICK),
    "stalls": Bench(load.stalls, load.STALLS, load.STALLS_QUICK),
    "restart": Bench(load.restart, load.RESTART, load.RESTART_QUICK),
    "starve": Bench(reads.starve, reads.STARVE, reads.STARVE_QUICK),
    "download": Bench(reads.download, reads.DOWNLOAD, reads.DOWNLOAD_QUICK),
    "floods": Bench(floods.measure, floods.FULL, floods.QUICK),
    "fleet": Bench(fleet.measure, fleet.FULL, fleet.QUICK),
    "panel": Bench(panel.measure, panel.FULL, panel.QUICK),
}


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m sitl.bench",
        description="Measure the companion: frames beside stock MAVProxy, zones, energy, transfers, leases, restarts, "
        "reads, floods; a station with many vehicles; and the operator's panel.",
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
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"some of: {', '.join(BENCHES)} (default: all)")
    arguments = parser.parse_args(argv)
    unknown = [part for part in arguments.parts if part not in BENCHES]
    if unknown:
        parser.error(f"unknown part {unknown[0]!r}: must be one of {', '.join(BENCHES)}")
    if arguments.seconds is not None and not 1.0 <= arguments.seconds <= _LONGEST_S:
        parser.error(f"--seconds {arguments.seconds:g}: must be 1 to {_LONGEST_S:.0f}")
    return arguments


def _plan(part: str, arguments: argparse.Namespace) -> Any:
    """What is to be measured of a part, with what the command line says of it."""
    plan = BENCHES[part].quick if arguments.quick else BENCHES[part].full
    if part == "fleet" and arguments.seconds is not None:
        return plan.lasting(arguments.seconds)
    if part == "download" and arguments.mavsdk:
        return replace(plan, mavsdk=tuple(arguments.mavsdk))
    return plan


def _run(arguments: argparse.Namespace, results: Results, folder: Path, say: Say) -> bool:
    """Measure the parts; whether all of them could be measured."""
    done = True
    for part in arguments.parts or BENCHES:
        say(f"{part} ...")
        try:
            for measurement in BENCHES[part].measure(_plan(part, arguments), folder, say):
                results.add(measurement)
        except (BenchError, ConfigError, KeysError, LaunchError, MissionError, OSError, ValueError) as error:
            done = False
            say(f"{part}: NOT MEASURED: {error}")
            results.line({"part": part, "error": str(error)})
    return done


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
    try:
        results = Results(folder / "bench.jsonl")
    except OSError as error:
        print(f"bench: {folder}: {error.strerror}", file=sys.stderr)
        return 2
    began = time.monotonic()

    def say(text: str) -> None:
        print(f"[{time.monotonic() - began:5.0f} s] {text}", flush=True)

    try:
        with memory_of_a_run():
            done = _run(arguments, results, folder.resolve(), say)
    except KeyboardInterrupt:
        done = False
        say("interrupted")
    print()
    print(table(results.measurements))
    missed = results.missed
    say(f"{len(missed)} of {sum(m.met is not None for m in results.measurements)} targets missed; {results.path}")
    return 0 if done and not (arguments.strict and missed) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover bench hosts`: flies a mission with each program on a host of its own, cuts a path, and says what happened.

Exit code 0: every expectation held. 1: one did not. 2: wrong usage, or the hosts cannot be made here.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, TextIO

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.tools.command_line import CommandParser
from sitl import main as sim
from sitl.hosts import namespaces, tunnel
from sitl.hosts.flight import flight
from sitl.hosts.namespaces import Namespaces
from sitl.hosts.network import BenchNetwork
from sitl.hosts.plan import MISSION_COMPUTER, PATHS, plan
from sitl.hosts.results import results_of
from sitl.hosts.table import table
from sitl.run.processes import Processes
from sitl.run.runner import Order, Result
from sitl.run.watchers import Watchers, read_address
from sitl.script.places import SetupError, mission_folder
from sitl.script.scenario import ScenarioError, parse_scenario, with_opening
from sitl.vehicles import KINDS, LaunchError

__all__ = ["RESULTS_FILE", "main"]

RESULTS_FILE: Final = "hosts.json"
_BAD_USAGE = 2
#: stations' heartbeats come up to 2 s of the wall clock apart at a handover; FS_GCS_TIMEOUT is 10 s of simulated time
MAX_SPEEDUP: Final = 5.0


def main(argv: Sequence[str] | None = None) -> int:
    """`handover bench`; returns the exit code."""
    parser = _parser()
    try:
        arguments = parser.parse_args(sys.argv[1:] if argv is None else argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    stream = sys.stderr if arguments.json else sys.stdout
    sim.stop_like_ctrl_c()
    try:
        return _hosts(arguments, stream)
    except (SetupError, ScenarioError, MissionError, LaunchError) as error:
        print(f"handover bench hosts: {error}", file=sys.stderr)
        return _BAD_USAGE
    except KeyboardInterrupt:
        print("\nhandover bench hosts: stopped; every process was ended, every host is gone", file=sys.stderr)
        return 130


_EXAMPLES: Final = (
    ("sudo handover bench hosts", "the linear mission, with its wired path cut"),
    ("sudo handover bench hosts --cut none --tunnel", "no path cut, the links of the parent in a tunnel"),
)
_CODES: Final = {0: "every expectation held", 1: "one did not", 2: "wrong usage, or the hosts cannot be made here"}


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="handover bench",
        examples=_EXAMPLES,
        codes=_CODES,
        description="Benches of several computers. Speed is measured by python -m sitl.bench.",
    )
    below = parser.add_subparsers(dest="bench", required=True, metavar="BENCH")
    text = (
        "Fly a mission with each computer on a network namespace of this machine, as in chapter 5 of the thesis. "
        "Each station has two paths; one is cut in flight. Needs root."
    )
    hosts = below.add_parser(
        "hosts",
        help="fly with each program on a host of its own",
        description=text,
        examples=_EXAMPLES,
        codes=_CODES,
    )
    hosts.add_argument("--mission", default="linear", metavar="NAME", help="one that ships, or a folder (linear)")
    hosts.add_argument("--vehicle", default="builtin", choices=KINDS, help="as of handover sim (default: builtin)")
    hosts.add_argument("--arducopter", metavar="PATH", help="ArduCopter's SITL program, as of handover sim")
    hosts.add_argument("--arduplane", metavar="PATH", help="ArduPlane's SITL program, as of handover sim")
    hosts.add_argument(
        "--cut", default="wired", choices=[*PATHS, "none"], help="the path that is cut in flight (default: wired)"
    )
    hosts.add_argument(
        "--tunnel",
        action="append",
        nargs="?",
        const="",
        default=[],
        metavar="STATION",
        help="the links to this station (default: the parent) go through WireGuard, with keys made for the run; once "
        "for each station",
    )
    hosts.add_argument("--speedup", type=float, default=2.0, metavar="N", help="simulated seconds per second (2)")
    hosts.add_argument(
        "--watch",
        action="append",
        default=[],
        metavar="udp:HOST:PORT",
        help="show the flight to a ground station program outside of the namespaces; it can command nothing",
    )
    hosts.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the run (default: runs/TIME-hosts-MISSION-VEHICLE)"
    )
    hosts.add_argument("--json", action="store_true", help="print one JSON object at the end; the story to stderr")
    return parser


def _hosts(arguments: argparse.Namespace, stream: TextIO) -> int:
    """Raises SetupError, ScenarioError, MissionError, LaunchError."""
    folder_of_mission = mission_folder(arguments.mission)
    package = packages.load(folder_of_mission)
    sim.check_vehicle(arguments.vehicle, package, arguments.arducopter, arguments.arduplane)
    speedup = arguments.speedup
    if not 0.5 <= speedup <= MAX_SPEEDUP:
        raise SetupError(
            f"--speedup {speedup:g} is not 0.5 to {MAX_SPEEDUP:g}: programs and networks of the bench go by the wall "
            f"clock, FS_GCS_TIMEOUT (10 s) and HNDO_TIMEOUT (3 s) by simulated time"
        )
    scenario = parse_scenario(flight(package, folder_of_mission, arguments.cut), "bench hosts")
    scenario = with_opening(scenario, package)
    try:
        tunnelled = [name or package.parent.name for name in arguments.tunnel]
        hosts = plan([station.name for station in package.stations], list(dict.fromkeys(tunnelled)))
    except ValueError as error:
        raise SetupError(str(error)) from None
    why = namespaces.cannot() or (tunnel.cannot() if arguments.tunnel else "")
    if why:
        raise SetupError(why)
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = sim.folder_of(arguments.out or Path("runs") / f"{stamp}-hosts-{package.name}-{arguments.vehicle}")
    with ExitStack() as stack:
        # made here, these lines leave from the namespace that the command was started in; all else is inside
        watching = Watchers([read_address(text) for text in arguments.watch])
        stack.callback(watching.close)
        made = stack.enter_context(Namespaces(hosts))
        tunnels = stack.enter_context(Processes())
        consoles = Path(stack.enter_context(TemporaryDirectory(prefix="handover-tunnels-")))
        tunnel_says = tunnel.build(made, tunnels, consoles) if hosts.tunnels else ""
        network = BenchNetwork(made)
        print(f"LTE path: {network.lte_says}.", file=stream, flush=True)
        stack.enter_context(made.entered(MISSION_COMPUTER))
        order = Order(
            scenario,
            package,
            arguments.vehicle,
            speedup,
            folder,
            arguments.arducopter,
            arguments.arduplane,
            network=network,
            watching=watching,
        )
        result = sim.fly(order, stream)
        results = results_of(result, hosts, network.lte_says, tunnel_says)
    (folder / RESULTS_FILE).write_text(json.dumps(results, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return _conclude(result, results, arguments, stream)


def _conclude(result: Result, results: dict[str, object], arguments: argparse.Namespace, stream: TextIO) -> int:
    report = sim.report_of(result.order.folder)
    for line in table(results):
        print(line, file=stream)
    sim.conclude(result, report, stream)
    if arguments.json:
        print(json.dumps({**sim.summary(result, report), "hosts": results}, ensure_ascii=False))
    return 0 if result.held else 1

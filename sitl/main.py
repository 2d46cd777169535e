# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover sim`: flies a scenario with real processes on this machine, judges it and writes a report.

Exit code 0: every expectation held. 1: one did not. 2: the command line is wrong or nothing could be set up.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Any, Final, TextIO

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.vehicle.profiles import ASSUMED
from sitl.report.page import write_report
from sitl.report.record import RecordError, load_run
from sitl.run.fleet import others_of
from sitl.run.runner import Order, Result, run
from sitl.run.story import Story
from sitl.run.watchers import read_address
from sitl.script.moved import moved, read_place
from sitl.script.own import own_scenario
from sitl.script.places import SetupError, mission_folder
from sitl.script.scenario import (
    AUTOPILOT,
    Scenario,
    ScenarioError,
    known_scenarios,
    load_scenario,
    panel_of,
    parse_scenario,
    program_of,
    with_opening,
)
from sitl.vehicles import KINDS, LaunchError, find_arducopter, find_arduplane, flies
from sitl.vehicles.fetched import PUBLISHED, fetch

__all__ = [
    "check_vehicle",
    "conclude",
    "fly",
    "folder_of",
    "main",
    "own_file",
    "report_of",
    "speedup_of",
    "stop_like_ctrl_c",
    "summary",
]

DEFAULT_SPEEDUP = 8.0
#: no computer of today simulates three programs of MAVProxy and an aircraft faster
MAX_SPEEDUP = 20.0
#: what is played where no scenario is named
USUAL_SCENARIO: Final = {"copter": "nominal", "quadplane": "ferry", "plane": "dike"}
#: what MAVProxy's command line splits or eats
UNUSABLE = " ;'\"\\"
_BAD_USAGE = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = _parser()
    try:
        arguments = parser.parse_args(_joined(sys.argv[1:] if argv is None else argv))
    except SystemExit as stop:
        return int(stop.code or 0)
    if arguments.list:
        _list()
        return 0
    stream = sys.stderr if arguments.json else sys.stdout
    stop_like_ctrl_c()
    try:
        if arguments.fetch_arducopter:
            fetch(lambda line: print(line, file=stream, flush=True))
            return 0
        order = _order(arguments)
        result = fly(order, stream)
    except (SetupError, ScenarioError, MissionError, LaunchError) as error:
        print(f"handover sim: {error}", file=sys.stderr)
        return _BAD_USAGE
    except KeyboardInterrupt:
        print("\nhandover sim: stopped; every process was ended", file=sys.stderr)
        return 130
    report = report_of(order.folder)
    conclude(result, report, stream)
    if arguments.json:
        print(json.dumps(summary(result, report), ensure_ascii=False))
    return 0 if result.held else 1


def _joined(argv: Sequence[str]) -> list[str]:
    """Join a place in the south or west to its option, because it begins as options do."""
    found: list[str] = []
    for word in argv:
        if found and found[-1] == "--home" and word[:1] == "-" and word[1:2].isdigit():
            found[-1] = f"--home={word}"
        else:
            found.append(word)
    return found


def stop_like_ctrl_c() -> None:
    """SIGTERM and a closed terminal end a run as Ctrl-C does, with every process."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, stop)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="handover sim",
        examples=(
            ("handover sim", "the delivery mission, in two minutes"),
            (
                "handover sim --scenario commander-dead-before --vehicle arducopter",
                "a lost commander, flown by ArduCopter SITL",
            ),
            ("handover sim --mission missions/delivery --faults 7", "your own mission, with faults by chance"),
            ("handover sim --scenario lost-link.toml", "your own scenario"),
        ),
        codes={0: "every expectation held", 1: "one did not", 2: "wrong usage, or nothing could be set up"},
        description="Fly a scenario: a simulated vehicle with the guard, a companion and ground stations as real "
        "processes on this machine; then judge it and write a report.",
    )
    flown = parser.add_argument_group("what is flown")
    what = flown.add_mutually_exclusive_group()
    usual = ", ".join(f"{name} for a {kind}" for kind, name in USUAL_SCENARIO.items())
    what.add_argument(
        "--scenario",
        metavar="NAME|FILE",
        help=f"what to play: one that ships, or a file of your own, named *.toml (default: {usual})",
    )
    what.add_argument("--mission", type=Path, metavar="DIR", help="fly this mission package as its check says")
    flown.add_argument("--faults", type=int, metavar="SEED", help="with --mission: something goes wrong, by chance")
    flown.add_argument("--anyway", action="store_true", help="with --mission: even if its check finds errors")
    flown.add_argument(
        "--home",
        metavar="LAT,LON[,ALT[,HEADING]]",
        help="fly the same mission there: its places keep their way from home",
    )
    flown.add_argument(
        "--watch",
        action="append",
        default=[],
        metavar="udp:HOST:PORT",
        help="show the flight to a ground station program there, which can read and command nothing; once for each",
    )
    flown.add_argument("--list", action="store_true", help="list the scenarios and end")
    vehicle = parser.add_argument_group("the vehicle")
    vehicle.add_argument(
        "--vehicle",
        default="builtin",
        choices=[*KINDS, "auto"],
        help="builtin: the copter model that ships here; arducopter: ArduPilot's own SITL program; quadplane, plane: "
        "ArduPlane's; auto: what the mission is for, of copters arducopter if there is one (default: builtin)",
    )
    vehicle.add_argument(
        "--arducopter", metavar="PATH", help="the SITL program (else $ARDUCOPTER, PATH, ~/ardupilot, the one fetched)"
    )
    vehicle.add_argument(
        "--arduplane", metavar="PATH", help="ArduPlane's SITL program (else $ARDUPLANE, PATH, ~/ardupilot)"
    )
    vehicle.add_argument(
        "--fetch-arducopter",
        action="store_true",
        help=f"bring ArduPilot's published ArduCopter {PUBLISHED.version} for this (Linux, x86_64), and end",
    )
    run = parser.add_argument_group("the run")
    run.add_argument(
        "--speedup",
        type=float,
        metavar="N",
        help=f"simulated seconds per second, 0.5 to {MAX_SPEEDUP:g} (default: {DEFAULT_SPEEDUP:g}, or the scenario's)",
    )
    run.add_argument("--out", type=Path, metavar="DIR", help="folder of the run (default: runs/TIME-SCENARIO-VEHICLE)")
    run.add_argument("--json", action="store_true", help="print one JSON object at the end; the story goes to stderr")
    return parser


def _list() -> None:
    for name, path in known_scenarios().items():
        try:
            text = load_scenario(path).description
        except ScenarioError as error:
            text = f"cannot be used: {error}"
        print(f"{name:<22} {text}")


def speedup_of(speedup: float) -> float:
    """A speed-up that a flight can have. Raises SetupError."""
    if not 0.5 <= speedup <= MAX_SPEEDUP:
        raise SetupError(f"--speedup {speedup:g} is not 0.5 to {MAX_SPEEDUP:g}")
    return speedup


def folder_of(named: Path) -> Path:
    """Where a run is kept, as an absolute path. Raises SetupError: MAVProxy cannot take such a path."""
    folder = named.resolve()
    if any(character in str(folder) for character in UNUSABLE):
        raise SetupError(f"{folder}: MAVProxy cannot take a path with spaces, quotes or ';': give another --out")
    return folder


def _order(arguments: argparse.Namespace) -> Order:
    scenario = _scenario(arguments)
    speedup = speedup_of(arguments.speedup if arguments.speedup is not None else scenario.speedup or DEFAULT_SPEEDUP)
    package = packages.load(mission_folder(scenario.mission))
    vehicle = _vehicle(arguments, package)
    if scenario.needs not in ("", vehicle):
        raise SetupError(f"scenario {scenario.name} needs --vehicle {scenario.needs}")
    _check_names(scenario, package)
    place = None if arguments.home is None else read_place(arguments.home)
    if place is not None:
        if scenario.fleet:
            raise SetupError(f"--home moves one mission: scenario {scenario.name} has several aircraft")
        package = moved(package, place)
    scenario = with_opening(scenario, package)
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = folder_of(arguments.out or Path("runs") / f"{stamp}-{scenario.name}-{vehicle}")
    others = others_of(scenario, package)
    for craft in others:
        _check_kind(vehicle, craft.package)
    heading_deg = 0.0 if place is None else place.heading_deg
    return Order(
        scenario,
        package,
        vehicle,
        speedup,
        folder,
        arguments.arducopter,
        arguments.arduplane,
        others=others,
        watchers=tuple(map(read_address, arguments.watch)),
        heading_deg=heading_deg,
    )


def _vehicle(arguments: argparse.Namespace, package: packages.MissionPackage) -> str:
    """The vehicle that flies the mission. Raises SetupError: it is not for it, or is not there."""
    vehicle: str = arguments.vehicle
    if vehicle == "auto":
        fitting = [kind for kind in KINDS if flies(kind) is package.profile]
        vehicle = "arducopter" if "arducopter" in fitting and find_arducopter(arguments.arducopter) else fitting[0]
    check_vehicle(vehicle, package, arguments.arducopter, arguments.arduplane)
    return vehicle


def check_vehicle(
    vehicle: str, package: packages.MissionPackage, arducopter: str | None, arduplane: str | None
) -> None:
    """Vehicle and mission fit, and the vehicle's program is there. Raises SetupError."""
    _check_kind(vehicle, package)
    if vehicle == "arducopter" and find_arducopter(arducopter) is None:
        raise SetupError(
            "no arducopter found: give --arducopter PATH, set $ARDUCOPTER, bring one with --fetch-arducopter, or "
            "take --vehicle builtin"
        )
    if package.profile.firmware == "ArduPlane" and find_arduplane(arduplane) is None:
        raise SetupError("no arduplane found: give --arduplane PATH, set $ARDUPLANE, or build it in ~/ardupilot")


def _check_kind(vehicle: str, package: packages.MissionPackage) -> None:
    """A mission is flown by the kind of aircraft that it is for. Raises SetupError."""
    if flies(vehicle) is not package.profile:
        fitting = " or ".join(kind for kind in KINDS if flies(kind) is package.profile)
        raise SetupError(
            f"mission {package.name} is for a {package.profile.name}, and --vehicle {vehicle} is a "
            f"{flies(vehicle).name}: take --vehicle {fitting}"
        )


def _scenario(arguments: argparse.Namespace) -> Scenario:
    if arguments.mission is not None:
        return _own(arguments.mission, arguments.faults, anyway=arguments.anyway)
    if arguments.faults is not None or arguments.anyway:
        raise SetupError("--faults and --anyway go with --mission")
    scenarios = known_scenarios()
    profile = ASSUMED if arguments.vehicle == "auto" else flies(arguments.vehicle)
    name = USUAL_SCENARIO[profile.name] if arguments.scenario is None else arguments.scenario
    if name in scenarios:
        return load_scenario(scenarios[name])
    if name.endswith(".toml"):
        return own_file(Path(name).expanduser())
    raise ScenarioError(
        f"no scenario {name!r}; the scenarios are {', '.join(scenarios) or 'none'}; or give the path of a file named "
        "*.toml"
    )


def own_file(path: Path) -> Scenario:
    """The scenario of a user's own file. Its mission may be a folder beside the file. Raises ScenarioError."""
    scenario = load_scenario(path)
    beside = path.parent / scenario.mission
    return replace(scenario, mission=str(beside)) if (beside / packages.MISSION_FILE).is_file() else scenario


def _own(folder: Path, faults: int | None, *, anyway: bool) -> Scenario:
    """The scenario of a mission package's own check. Raises MissionError, SetupError."""
    package = packages.load(folder)
    wrong = [finding.text for finding in check(package).findings if finding.severity is Severity.ERROR]
    if wrong and not anyway:
        raise SetupError(f"{folder}: its check fails: {'; '.join(wrong)} (--anyway flies it)")
    return parse_scenario(own_scenario(package, folder, faults), f"{package.name} by its check")


def _check_names(scenario: Scenario, package: packages.MissionPackage) -> None:
    """Stations that the scenario names must be in the mission."""
    names = [station.name for station in package.stations]
    used = {*scenario.consent, *scenario.standard, *scenario.not_in_control, *scenario.links, *scenario.rogue}
    used |= {*scenario.served, *scenario.panel, *scenario.require_operator}
    used |= {name for lines in scenario.serial for name in lines.lines if name != AUTOPILOT}
    for step in scenario.steps:
        used.update(step.deed.processes())
    for name in sorted(
        used
        - {
            *names,
            "companion",
            *scenario.fleet,
            *map(program_of, scenario.served),
            *map(panel_of, scenario.panel),
            *(["rogue"] if scenario.rogue else []),
            *(["onboard"] if scenario.onboard else []),
            *(["listener"] if scenario.listen else []),
            *(["transponder"] if scenario.transponder else []),
        }
    ):
        raise ScenarioError(
            f"{scenario.name}.toml: {name!r} is no station of mission {package.name!r}: {', '.join(names)}"
        )


def fly(order: Order, stream: TextIO) -> Result:
    """Run it once and tell the story. Raises SetupError."""
    story = Story(stream, [station.name for station in order.package.stations])
    story.heading(f"{order.scenario.name}: {order.scenario.description}")
    story.line(
        f"vehicle {order.vehicle}, mission {order.package.name}, {order.speedup:g} times real time, in {order.folder}"
    )
    result = run(order, story)
    story.heading("Expectations")
    for verdict in result.verdicts:
        story.verdict(verdict.held, f"{verdict.wanted}: {verdict.seen}")
    return result


def report_of(folder: Path) -> Path | None:
    """The report; a run without one is still a run, so trouble here is told and not raised."""
    try:
        return write_report(load_run(folder))
    except (RecordError, OSError) as error:
        print(f"handover sim: no report: {error}", file=sys.stderr)
        return None


def conclude(result: Result, report: Path | None, stream: TextIO) -> None:
    """Print the result of the run in one line, and where its report is."""
    failed = sum(not verdict.held for verdict in result.verdicts)
    outcome = "every expectation held" if result.held else f"{failed} of {len(result.verdicts)} expectations failed"
    print(
        f"{result.order.scenario.name} on {result.order.vehicle}: {outcome}; {result.duration_sim_s:.0f} s flown in "
        f"{result.duration_wall_s:.0f} s",
        file=stream,
    )
    if report is not None:
        print(f"report: {report}", file=stream)


def summary(result: Result, report: Path | None) -> dict[str, Any]:
    """The values of a run that `--json` prints."""
    evidence = result.evidence
    committed = [] if evidence is None else evidence.of(event="transfer_committed")
    return {
        "scenario": result.order.scenario.name,
        "vehicle": result.order.vehicle,
        "speedup": result.order.speedup,
        "held": result.held,
        "verdicts": [
            {"held": verdict.held, "wanted": verdict.wanted, "seen": verdict.seen} for verdict in result.verdicts
        ],
        "commanders": [] if evidence is None else [change.commander for change in evidence.commanders()],
        "handovers": [
            {"station": entry.get("station"), "epoch": entry.get("epoch"), "duration_s": entry.get("duration_s")}
            for entry in committed
        ],
        "duration_wall_s": round(result.duration_wall_s, 1),
        "duration_sim_s": round(result.duration_sim_s, 1),
        "folder": str(result.order.folder),
        "report": None if report is None else str(report),
    }


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: GPL-3.0-or-later

"""The command line of `handover check`. `mission/check.py` judges."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.core.common.model import Station
from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.mission.check import OPERATOR_S, CheckReport, check
from mavproxy_handover.mission.check_json import report_json
from mavproxy_handover.mission.check_text import report_text
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.fix import fix
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage, load
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["judged", "main"]


def _wind(text: str) -> Wind:
    speed, _comma, direction = text.partition(",")
    try:
        wind = Wind(float(speed), float(direction))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} (allowed: SPEED,DIRECTION, as in 8,270)") from None
    if not (0.0 <= wind.speed_mps <= 60.0 and 0.0 <= wind.from_deg <= 360.0):
        raise argparse.ArgumentTypeError(f"{text} (allowed: 0 to 60 m/s, 0 to 360 degrees)")
    return wind


@dataclass(frozen=True, slots=True)
class _Vehicle:
    """Data of the vehicle's file that the check needs."""

    stations: tuple[Station, ...] = ()
    operator_s: float = OPERATOR_S


def _vehicle(named: str | None, package: MissionPackage) -> _Vehicle:
    """The vehicle's file, which is named or found as the companion would find it.

    A file that is not named counts only if it has the stations of this mission; otherwise nothing is known. Raises
    ConfigError or ImportError for a named one.
    """
    try:  # the check of a mission needs no MAVLink, which the configuration does
        from mavproxy_handover.config.files import find_vehicle_config, load_vehicle

        config = load_vehicle(find_vehicle_config(named))
    except (ConfigError, ImportError):
        if named is not None:
            raise
        return _Vehicle()
    stations = tuple(each.station for each in config.stations)
    known = {(station.sysid, station.name) for station in stations}
    if named is None and not all((station.sysid, station.name) in known for station in package.stations):
        return _Vehicle()
    return _Vehicle(stations, config.limits.operator_timeout_s)


def judged(package: MissionPackage, config: str | None, wind: Wind | None = None) -> CheckReport:
    """The check of a mission with the vehicle's file of that name. Raises ConfigError, ImportError."""
    vehicle = _vehicle(config, package)
    return check(package, operator_s=vehicle.operator_s, wind=wind, stations=vehicle.stations)


def _parser() -> CommandParser:
    parser = CommandParser(
        prog="handover check",
        description="Check a mission package before flight: coverage, handovers, rally points, energy.",
        examples=(
            ("handover check missions/delivery", "what would go wrong, before anything flies"),
            (
                "handover check missions/delivery --map map.png --wind 8,270",
                "a map, and the energy in 8 m/s from the west",
            ),
            ("handover check missions/delivery --json", "the same for programs"),
        ),
        codes={0: "passed", 1: "errors found", 2: "the mission or the command cannot be read"},
    )
    parser.add_argument("mission", metavar="MISSION", help=f"folder of the mission package, or its {MISSION_FILE}")
    parser.add_argument("--map", metavar="FILE", help="draw a map of the mission (.png, .svg or .pdf)")
    parser.add_argument(
        "--json", action="store_true", help="for programs: findings, handovers and energy as one object"
    )
    parser.add_argument(
        "--fix",
        action="store_true",
        help="put right what needs no decision, and say what was changed. The old files are kept as NAME.orig",
    )
    parser.add_argument(
        "--wind",
        type=_wind,
        metavar="SPEED,DIRECTION",
        help="count the energy with this wind, and the turns of wings: m/s, degrees that it comes from (else: "
        "headwind_mps of [energy])",
    )
    parser.add_argument(
        "--config",
        metavar="FILE",
        help="the vehicle's configuration, for what it says of consent and operators (default: as the companion finds "
        "it, if it has the stations of the mission)",
    )
    return parser


def main(args: Sequence[str]) -> int:
    """The command `handover check`. Returns 0 passed, 1 errors found, 2 bad input."""
    try:
        options = _parser().parse_args(list(args))
    except SystemExit as stop:  # argparse has printed the error
        return 0 if stop.code in (0, None) else 2
    named = Path(options.mission)
    try:
        return _checked(named.parent if named.name == MISSION_FILE else named, options)
    except MissionError as error:
        faults: Sequence[str] = error.faults
    except ConfigError as error:
        faults = (str(error),)
    if options.json:
        print(json.dumps({"passed": False, "faults": list(faults)}, indent=1))
    for fault in faults:
        print(f"handover check: {fault}", file=sys.stderr)
    return 2


def _checked(folder: Path, options: argparse.Namespace) -> int:
    """Raises MissionError, ConfigError."""
    for fixed in fix(folder) if options.fix else ():
        print(f"fixed: {fixed}", file=sys.stderr)
    package = load(folder)
    report = judged(package, options.config, options.wind)
    print(json.dumps(report_json(report), indent=1) if options.json else report_text(report))
    if options.map:
        from mavproxy_handover.mission.picture import draw

        draw(package, Path(options.map), report.simulation, report.findings)
    return report.exit_code

# SPDX-License-Identifier: GPL-3.0-or-later

"""The command line of `handover check`. `mission/check.py` judges and prints."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.core.common.model import Station
from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.mission.check import OPERATOR_S, REACH_M, TRANSFER_S, check, report_text
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage, load
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["main"]


def _above_zero(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text} (allowed: a number above 0)")
    return value


def _wind(text: str) -> Wind:
    speed, _comma, direction = text.partition(",")
    try:
        wind = Wind(float(speed), float(direction))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} (allowed: SPEED,DIRECTION, as in 8,270)") from None
    if not (0.0 <= wind.speed_mps <= 60.0 and 0.0 <= wind.from_deg <= 360.0):
        raise argparse.ArgumentTypeError(f"{text} (allowed: 0 to 60 m/s, 0 to 360 degrees)")
    return wind


def _stations(named: str | None, package: MissionPackage) -> tuple[Station, ...]:
    """The stations of the vehicle's file, which is named or found as the companion would find it.

    A file that is not named counts only if it has the stations of this mission; otherwise there are none. Raises
    ConfigError or ImportError for a named one.
    """
    try:  # the check of a mission needs no MAVLink, which the configuration does
        from mavproxy_handover.config.files import find_vehicle_config, load_vehicle

        stations = tuple(each.station for each in load_vehicle(find_vehicle_config(named)).stations)
    except (ConfigError, ImportError):
        if named is not None:
            raise
        return ()
    known = {(station.sysid, station.name) for station in stations}
    fits = all((station.sysid, station.name) in known for station in package.stations)
    return stations if named is not None or fits else ()


def main(args: Sequence[str]) -> int:
    """The command `handover check`. Returns 0 passed, 1 errors found, 2 bad input."""
    parser = CommandParser(
        prog="handover check",
        description="Check a mission package before flight: coverage, handovers, rally points, energy.",
        examples=(
            ("handover check missions/delivery", "what would go wrong, before anything flies"),
            (
                "handover check missions/delivery --map map.png --wind 8,270",
                "a map, and the energy in 8 m/s from the west",
            ),
        ),
        codes={0: "passed", 1: "errors found", 2: "the mission or the command cannot be read"},
    )
    parser.add_argument("mission", metavar="MISSION", help=f"folder of the mission package, or its {MISSION_FILE}")
    parser.add_argument("--map", metavar="FILE", help="draw a map of the mission (.png, .svg or .pdf)")
    parser.add_argument(
        "--transfer", type=_above_zero, default=TRANSFER_S, metavar="S", help="seconds a transfer needs (%(default)g)"
    )
    parser.add_argument(
        "--operator",
        type=_above_zero,
        default=OPERATOR_S,
        metavar="S",
        help="seconds an operator may take to answer (%(default)g)",
    )
    parser.add_argument(
        "--reach", type=_above_zero, default=REACH_M, metavar="M", help="metres off the route for rally (%(default)g)"
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
        help="the vehicle's configuration, for what it says of consent (default: as the companion finds it, if it has "
        "the stations of the mission)",
    )
    try:
        options = parser.parse_args(list(args))
    except SystemExit as stop:  # argparse has printed the error
        return 0 if stop.code in (0, None) else 2
    folder = Path(options.mission)
    try:
        package = load(folder.parent if folder.name == MISSION_FILE else folder)
        report = check(
            package,
            transfer_s=options.transfer,
            operator_s=options.operator,
            reach_m=options.reach,
            wind=options.wind,
            stations=_stations(options.config, package),
        )
        print(report_text(report))
        if options.map:
            from mavproxy_handover.mission.picture import draw

            draw(package, Path(options.map), report.simulation)
    except MissionError as error:
        for fault in error.faults:
            print(f"handover check: {fault}", file=sys.stderr)
        return 2
    except ConfigError as error:
        print(f"handover check: {error}", file=sys.stderr)
        return 2
    return report.exit_code

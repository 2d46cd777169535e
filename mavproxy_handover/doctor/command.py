# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover doctor`: the table of checks, and the output of their findings.

An exception in a check is a finding, and the next check runs. Exit codes: 1 if there is an error; else 2 if something
could not be checked; else 0, with or without warnings.

With --json standard output is one object: `format` (1), `kind`, `root`, `configuration`, `exit`, and `findings`, a list
in the order of the checks. Each has `check`, `level` ("ok", "warning", "error"), `looked` (true if it could be
checked), `what`, `found` and `do` ("" if nothing is to be done). Keys may be added; none changes or goes.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from mavproxy_handover.cli.machine import CONFIGURATION, below
from mavproxy_handover.config.files import STATION_PLACES, ConfigError, find_station_config, find_vehicle_config
from mavproxy_handover.doctor.air import air
from mavproxy_handover.doctor.check_context import CheckContext, CompanionStarted, admit
from mavproxy_handover.doctor.feeds import feeds, onboard_programs
from mavproxy_handover.doctor.finding import Finding, Level, unseen
from mavproxy_handover.doctor.flight_controller import autopilot
from mavproxy_handover.doctor.host import clock, disk, service
from mavproxy_handover.doctor.mission import missions
from mavproxy_handover.doctor.ports import ports
from mavproxy_handover.doctor.position_box import position_box
from mavproxy_handover.doctor.programs import programs
from mavproxy_handover.doctor.settings import configuration, keys
from mavproxy_handover.doctor.stations import stations
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["CHECKS", "main"]

_FORMAT: Final = 1
_KINDS: Final = tuple(CONFIGURATION)
#: name -> check, in an order in which each finds the results that it needs
CHECKS: Final[dict[str, Callable[[CheckContext], Iterator[Finding]]]] = {
    "programs": programs,
    "configuration": configuration,
    "keys": keys,
    "service": service,
    "clock": clock,
    "disk": disk,
    "mission": missions,
    "ports": ports,
    "autopilot": autopilot,
    "position box": position_box,
    "stations": stations,
    "feeds": feeds,
    "onboard programs": onboard_programs,
    "vehicles": air,
}


class _Usage(Exception):
    """Wrong usage, one line: the requested machine cannot be checked."""


def main(argv: Sequence[str], clocks: Clocks = Clocks(time.time, time.monotonic)) -> int:  # noqa: B008 (a constant)
    """`handover doctor`. 0: all is well; 1: something is wrong; 2: wrong usage, or something could not be looked at."""
    parser = CommandParser(
        prog="handover doctor",
        examples=(
            ("handover doctor", "what is wrong with this machine, and what to do"),
            (
                "handover doctor companion --config handover.toml --device /dev/ttyTHS1,921600",
                "before the companion is installed",
            ),
        ),
        codes={0: "no error", 1: "an error was found", 2: "wrong usage, or something could not be looked at"},
        description="Find out what is wrong with this machine, and say what to do about it. Nothing is changed. The "
        "autopilot is asked for parameters and its version, and for nothing while it is armed.",
    )
    parser.add_argument("kind", nargs="?", choices=_KINDS, help="default: the one that there is a configuration for")
    parser.add_argument("--config", type=Path, metavar="FILE", help="default: as the module finds it")
    parser.add_argument("--root", type=Path, metavar="DIR", help="the machine's files lie below this folder")
    parser.add_argument("--device", help="the autopilot's line, or a station's link (default: as in the unit)")
    parser.add_argument("--no-links", action="store_true", help="ask no station, and listen to no vehicle")
    parser.add_argument("--json", action="store_true", help="for programs; the keys do not change")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        context = _context(arguments, clocks)
    except (_Usage, ConfigError) as error:
        print(f"handover doctor: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"handover doctor: {error.filename}: {error.strerror}; as another user, or with sudo?", file=sys.stderr)
        return 2
    found: list[tuple[str, Finding]] = []
    for name, check in CHECKS.items():
        for finding in _run(name, check, context):
            found.append((name, finding))
            if not arguments.json:
                _print(name, finding)
    code = _code(finding for _name, finding in found)
    if arguments.json:
        print(json.dumps(_as_json(context, found, code), indent=1))
    else:
        print(f"\n{_summary([finding for _name, finding in found])}")
    return code


def _run(name: str, check: Callable[[CheckContext], Iterator[Finding]], context: CheckContext) -> Iterator[Finding]:
    try:
        yield from check(context)
    except CompanionStarted:
        why = "a companion has just been started: what was open here was let go at once"
        yield unseen(name, why, "Run this again: what a running companion holds is told by its journal.")
    except Exception as fault:  # an exception here must not hide other findings
        why = f"the check itself broke: {type(fault).__name__}: {' '.join(str(fault).split())}"
        yield unseen(name, why, "Report this, with the line above; look at it by hand meanwhile.")


# ---- what is looked at ----------------------------------------------------------------------------------------------


def _context(arguments: argparse.Namespace, clocks: Clocks) -> CheckContext:
    """Raises _Usage, ConfigError, OSError."""
    root = Path("/") if arguments.root is None else arguments.root.expanduser().resolve()
    if not root.is_dir():
        raise _Usage(f"--root {root}: no such folder")
    kind = arguments.kind or _kind(arguments.config, root)
    path = _configuration(kind, arguments.config, root)
    if not path.exists():
        raise _Usage(f"{path}: no such file; 'handover install {kind}' or 'handover init' writes one")
    return admit(kind, root, path, arguments.device, not arguments.no_links, clocks, _tell)


def _kind(named: Path | None, root: Path) -> str:
    """The kind that has a configuration. Raises _Usage for both, or none."""
    if named is not None:
        raise _Usage(f"say what {named} is of: handover doctor companion|station --config {named}")
    found = []
    for kind in _KINDS:
        try:
            if _configuration(kind, None, root).exists():
                found.append(kind)
        except ConfigError:
            continue
    if len(found) == 1:
        return found[0]
    why = "both have a configuration here" if found else "neither has a configuration here"
    raise _Usage(f"companion or station? {why}")


def _configuration(kind: str, named: Path | None, root: Path) -> Path:
    """Path of the configuration. Raises ConfigError."""
    if named is not None:
        return named.expanduser().resolve()
    installed = below(root, CONFIGURATION[kind])
    if root != Path("/"):
        return installed
    if kind == "companion":
        return find_vehicle_config(None)
    return find_station_config(None) if Path(STATION_PLACES[0]).is_file() else installed


def _tell(what: str) -> None:
    """Print a text about a long step, only on a terminal."""
    print(f"... {what}", file=sys.stderr, flush=True)


# ---- what is told ---------------------------------------------------------------------------------------------------


def _print(name: str, finding: Finding) -> None:
    print(f"{finding.level.value:8} {name:14} {finding.what}: {finding.found}")
    if finding.do:
        print(f"{'':23} -> {finding.do}", flush=True)


def _code(findings: Iterator[Finding]) -> int:
    seen = list(findings)
    if any(finding.level is Level.ERROR for finding in seen):
        return 1
    return 0 if all(finding.looked for finding in seen) else 2


def _summary(findings: list[Finding]) -> str:
    errors = sum(finding.level is Level.ERROR for finding in findings)
    hidden = sum(not finding.looked for finding in findings)
    warnings = sum(finding.level is Level.WARNING for finding in findings) - hidden
    if not errors and not hidden:
        return f"All is well, with {_count(warnings, 'warning')}." if warnings else "All is well."
    parts = [_count(errors, "error"), _count(warnings, "warning"), f"{hidden} not looked at"]
    return f"{', '.join(parts)}."


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _as_json(context: CheckContext, found: list[tuple[str, Finding]], code: int) -> dict[str, object]:
    return {
        "format": _FORMAT,
        "kind": context.kind,
        "root": str(context.root),
        "configuration": str(context.path),
        "exit": code,
        "findings": [
            {
                "check": name,
                "level": finding.level.value,
                "looked": finding.looked,
                "what": finding.what,
                "found": finding.found,
                "do": finding.do,
            }
            for name, finding in found
        ],
    }

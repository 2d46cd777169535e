# SPDX-License-Identifier: GPL-3.0-or-later

"""Flies every scenario on every vehicle that its mission is for, and prints a table: `python -m sitl.fly_all`.

A scenario must hold on each vehicle, and the same stations must have commanded in the same order on all of them. Exit
code 0: all this is so. 1: it is not, or arducopter is missing. A scenario of wings is skipped, with a line that says
so, where there is no arduplane. The runs are kept below `--out`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mavproxy_handover.mission import package as packages
from mavproxy_handover.vehicle.profiles import ASSUMED, Profile
from sitl.run import panel_driver
from sitl.script.places import mission_folder
from sitl.script.scenario import ScenarioError, known_scenarios, load_scenario
from sitl.vehicles import KINDS, LaunchError, find_arducopter, find_arduplane, flies

__all__ = ["Flight", "agree", "main"]

#: on the wall clock: a step has a limit of its own, and a busy computer takes many minutes for a long flight
_LIMIT_S = 3600.0


@dataclass(frozen=True, slots=True)
class Flight:
    """The result of one run. `failed`: expectations that did not hold, in words."""

    scenario: str
    vehicle: str
    code: int
    wall_s: float
    commanders: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()

    @property
    def row(self) -> str:
        """One line of the table."""
        outcome = "holds" if self.code == 0 else f"exit {self.code}"
        chain = " ".join(self.commanders) or "-"
        return f"{self.scenario:<22} {self.vehicle:<11} {outcome:<8} {self.wall_s:5.0f} s  {chain}"


def agree(flights: Sequence[Flight]) -> list[str]:
    """Scenarios in which not the same stations commanded on every vehicle, a line each."""
    chains: dict[str, set[tuple[str, ...]]] = {}
    for flight in flights:
        chains.setdefault(flight.scenario, set()).add(flight.commanders)
    return [
        f"{scenario}: commanders differ: " + " / ".join(" ".join(chain) or "-" for chain in sorted(seen))
        for scenario, seen in chains.items()
        if len(seen) > 1
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m sitl.fly_all", description="Fly every scenario on every vehicle.")
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="default: all")
    parser.add_argument("--vehicle", action="append", choices=KINDS, help="as often as wanted; default: all")
    parser.add_argument("--arducopter", metavar="PATH", help="ArduCopter's SITL program")
    parser.add_argument("--arduplane", metavar="PATH", help="ArduPlane's SITL program")
    parser.add_argument("--out", type=Path, default=Path("runs/all"), metavar="DIR", help="default: runs/all")
    arguments = parser.parse_args(argv)
    try:
        copter, plane = find_arducopter(arguments.arducopter), find_arduplane(arguments.arduplane)
    except LaunchError as error:
        parser.error(str(error))
    names = arguments.scenarios or list(known_scenarios())
    vehicles = arguments.vehicle or list(KINDS)
    missing = "arducopter" in vehicles and copter is None
    if missing:
        vehicles.remove("arducopter")
        print("no arducopter found: its flights are MISSING from this table", file=sys.stderr)
    given = {"--arducopter": arguments.arducopter, "--arduplane": arguments.arduplane}
    programs = [word for option, path in given.items() if path for word in (option, path)]
    stamp = time.strftime("%Y%m%d-%H%M%S")
    flights = []
    for name in names:
        profile = _profile_of(name)
        browser = panel_driver.why_not() if name in known_scenarios() and _has_panel(name) else ""
        if browser:
            print(f"{name:<22} skipped: it has panels in a browser, and {browser}", flush=True)
            continue
        if plane is None and profile.firmware == "ArduPlane":
            print(f"{name:<22} skipped: it is flown by a {profile.name}, and no arduplane is found", flush=True)
            continue
        needs = _needs(name)
        for vehicle in (each for each in vehicles if flies(each) is profile and needs in ("", each)):
            flights.append(_fly(name, vehicle, arguments.out / f"{stamp}-{name}-{vehicle}", programs))
            print(flights[-1].row, flush=True)
            for line in flights[-1].failed:
                print(f"    {line}", flush=True)
    differing = agree(flights)
    for line in differing:
        print(line)
    bad = sum(flight.code != 0 for flight in flights)
    print(f"{len(flights)} flights, {bad} failed, {len(differing)} differ between the vehicles")
    return 1 if bad or differing or missing else 0


def _has_panel(name: str) -> bool:
    try:
        return bool(load_scenario(known_scenarios()[name]).panel)
    except ScenarioError:  # the flight itself reports it
        return False


def _needs(name: str) -> str:
    """The only vehicle that can fly a scenario; "": every one of its kind."""
    try:
        return load_scenario(known_scenarios()[name]).needs
    except (KeyError, ScenarioError):  # the flight itself reports it
        return ""


def _profile_of(name: str) -> Profile:
    """The profile of a scenario's mission.

    For an unknown scenario the flight itself reports the error.
    """
    path = known_scenarios().get(name)
    return ASSUMED if path is None else packages.load(mission_folder(load_scenario(path).mission)).profile


def _fly(scenario: str, vehicle: str, folder: Path, programs: Sequence[str]) -> Flight:
    argv = [sys.executable, "-m", "sitl.main", "--json", "--scenario", scenario, "--vehicle", vehicle]
    argv += ["--out", str(folder), *programs]
    begun = time.monotonic()
    try:
        done = subprocess.run(argv, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Flight(scenario, vehicle, -1, time.monotonic() - begun, failed=(f"not over within {_LIMIT_S:g} s",))
    wall_s = time.monotonic() - begun
    try:
        result: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        said = done.stderr.strip().splitlines()
        return Flight(scenario, vehicle, done.returncode or -1, wall_s, failed=tuple(said[-1:]))
    failed = tuple(f"{v['wanted']}: {v['seen']}" for v in result["verdicts"] if not v["held"])
    return Flight(scenario, vehicle, done.returncode, wall_s, tuple(result["commanders"]), failed)


if __name__ == "__main__":
    raise SystemExit(main())

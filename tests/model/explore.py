# SPDX-License-Identifier: GPL-3.0-or-later

"""Explores the rules of vehicle and stations exhaustively and prints what was seen: `make explore`, or

    python tests/model/explore.py [--quick] [--list] [NAME ...]

Without names all settings of `plans.DEEP` (minutes, and a few gigabytes of memory), with `--quick` those of every test
run. NAME: only settings whose name contains it. Exit code 1 if something that must hold does not; then the shortest
schedule that leads there is told step by step.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

# at the end: what is explored is the installed package, the tests come from here
sys.path.append(str(Path(__file__).parents[2]))

from tests.model.explorer import Report, explore
from tests.model.plans import DEEP, QUICK
from tests.model.setting import Setting
from tests.model.steps import Graph

__all__ = ["main"]


def _bounds(setting: Setting) -> str:
    """What is bounded, in one line."""
    kinds = ", ".join(sorted(kind.name.lower().replace("_", " ") for kind in setting.kinds))
    parts = [
        f"vehicle and {setting.stations} stations",
        "path " + " ".join(place or "-" for place in setting.path),
        f"up to {setting.faults} of: {kinds}" if setting.faults else "no faults",
    ]
    if setting.operators:
        parts.append(f"operators asked: {setting.operators}")
    if setting.forced:
        parts.append(f"asked about a forced handover: {setting.forced}")
    if setting.consent is not None:
        parts.append(f"consent of the standard stations: {setting.consent.value}")
    if setting.standard:
        parts.append(f"standard only: {setting.standard}")
    if setting.requests:
        wishes = ", ".join(sorted(wish.name.lower() for wish in setting.wishes))
        parts.append(f"up to {setting.requests} of the requests: {wishes}")
    if setting.depth is not None:
        parts.append(f"to depth {setting.depth}")
    return "; ".join(parts)


def _progress(line: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[K  {line}", end="", file=sys.stderr, flush=True)
    else:
        print(f"  {line}", file=sys.stderr, flush=True)


def _table(reports: list[Report]) -> str:
    lines = [
        "| setting | states | transitions | depth | all | longest transfer | time |",
        "|---|--:|--:|--:|---|--:|--:|",
    ]
    lines += [
        f"| {r.setting} | {r.states} | {r.transitions} | {r.depth} | {'yes' if r.complete else 'to this depth'} "
        f"| {r.longest_s} s | {r.elapsed_s:.1f} s |"
        for r in reports
    ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Explore as the arguments say."""
    parser = argparse.ArgumentParser(description="exhaustive exploration of the rules of authority")
    parser.add_argument("names", nargs="*", metavar="NAME", help="only settings whose name contains this")
    parser.add_argument("--quick", action="store_true", help="the settings of every test run")
    parser.add_argument("--list", action="store_true", help="print the settings and what each bounds")
    options = parser.parse_args(arguments)
    wanted = [
        setting
        for setting in (QUICK if options.quick else DEEP)
        if not options.names or any(name in setting.name for name in options.names)
    ]
    reports: list[Report] = []
    begun = time.perf_counter()
    for setting in wanted:
        print(f"{setting.name}: {_bounds(setting)}", flush=True)
        if options.list:
            continue
        report = explore(Graph(setting), _progress)
        if sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr)
        print(f"  {report}", flush=True)
        reports.append(report)
        if report.found is not None:
            print(report.found)
    if options.list:
        return 0
    states, transitions = sum(r.states for r in reports), sum(r.transitions for r in reports)
    print(f"\n{_table(reports)}\n")
    print(f"{states} states, {transitions} transitions, {time.perf_counter() - begun:.0f} s")
    broken = [report.setting for report in reports if report.found is not None]
    print(f"VIOLATED in: {', '.join(broken)}" if broken else "Nothing that must hold is violated.")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())

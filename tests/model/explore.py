# SPDX-License-Identifier: GPL-3.0-or-later

"""Explores the rules of vehicle and stations exhaustively and prints what was seen: `make explore`, or

    python tests/model/explore.py [--quick] [--states N] [--list] [NAME ...]

Without names all settings of `plans.DEEP`, with `--quick` those of every test run. NAME: the setting of this name, or
all settings whose name contains it. Exit code 1 if something that must hold does not; then the shortest schedule that
leads there is told step by step.

A deep setting is explored until `Setting.states` states are known, or N. The report says to which depth that is
complete: every schedule of so many steps was followed. All deep settings together take half an hour of one core.
With `--states 0` each is explored to its end: that takes many hours, and many gigabytes of memory.
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
        "| setting | states | transitions | explored | longest transfer | processor time |",
        "|---|--:|--:|---|--:|--:|",
    ]
    lines += [
        f"| {r.setting} | {r.states} | {r.transitions} | {r.extent} | {r.longest_s} s | {r.processor_s:.1f} s |"
        for r in reports
    ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Explore as the arguments say."""
    parser = argparse.ArgumentParser(description="exhaustive exploration of the rules of authority")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="the setting of this name, or all whose name contains it"
    )
    parser.add_argument("--quick", action="store_true", help="the settings of every test run")
    parser.add_argument(
        "--states",
        type=int,
        metavar="N",
        help="explore each setting until N states are known; 0: to its end, as --quick does",
    )
    parser.add_argument("--list", action="store_true", help="print the settings and what each bounds")
    options = parser.parse_args(arguments)
    plan = QUICK if options.quick else DEEP
    known = {setting.name for setting in plan}
    wanted = [
        setting
        for setting in plan
        if not options.names
        or any(name == setting.name if name in known else name in setting.name for name in options.names)
    ]
    if not wanted:
        parser.error(f"no setting has one of these in its name: {', '.join(options.names)}")
    if options.states is not None and options.states < 0:
        parser.error(f"--states {options.states}: 0 or more")
    reports: list[Report] = []
    begun = time.perf_counter()
    for number, setting in enumerate(wanted, 1):
        print(f"{number}/{len(wanted)} {setting.name}: {_bounds(setting)}", flush=True)
        if options.list:
            continue
        usual = 0 if options.quick else setting.states
        report = explore(Graph(setting), _progress, (usual if options.states is None else options.states) or None)
        if sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr)
        print(f"  {report}", flush=True)
        reports.append(report)
        if report.found is not None:
            print(report.found)
    if options.list:
        return 0
    states, transitions = sum(r.states for r in reports), sum(r.transitions for r in reports)
    processor_s, elapsed_s = sum(r.processor_s for r in reports), time.perf_counter() - begun
    print(f"\n{_table(reports)}\n")
    print(f"{states} states, {transitions} transitions, {processor_s:.0f} s of processor time, {elapsed_s:.0f} s")
    broken = [report.setting for report in reports if report.found is not None]
    print(f"VIOLATED in: {', '.join(broken)}" if broken else "Nothing that must hold is violated in what was explored.")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())

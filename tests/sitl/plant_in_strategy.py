# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the campaign: python -m tests.sitl.plant_in_strategy [options] [part of a name] ...

Ten faults, each of a kind that people make, are planted in a copy of the rules, one at a time, and a campaign is flown
over each copy: it must find every one of them, and nothing without one. Exit code 1 otherwise. They were chosen by what
the strategy must not do, not by what the campaign looks for.

One that stood here is none: that `Strategy` forgets a return whose cause goes on. What is milder is no news while that
cause is there (`Emergency._known`), and the one thing that is, a successor for a lost commander, is waited for within
`forced_timeout_s` of the loss alone; when it fails the return is decided again, and is flown all the while.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sitl.campaign.plan import DOWNLINK

__all__ = ["PLANTED", "Planted"]

ROOT = Path(__file__).parents[2]
PACKAGES = ("mavproxy_handover", "gcs_module", "sitl", "missions")
CORE = "mavproxy_handover/core/"
#: flights at a time where no more are flown than it takes
PIECE = 100


@dataclass(frozen=True, slots=True)
class Planted:
    """A fault: what it is, in which file of the core, what stands there once, and what stands there with the fault."""

    name: str
    file: str
    right: str
    wrong: str


PLANTED = (
    Planted(
        "who can reach no place is only warned",
        "safety/strategy.py",
        '"return": (_RETURN, _LAND),',
        '"return": (_RETURN, _WARN),',
    ),
    Planted(
        "of two causes the milder one is obeyed",
        "safety/strategy.py",
        "if best is None or action > best.action:",
        "if best is None or action < best.action:",
    ),
    Planted(
        "who lands already is sent home",
        "safety/strategy.py",
        "Fact.LANDING: FlightAction.LAND,",
        "Fact.LANDING: FlightAction.RETURN,",
    ),
    Planted(
        "a pilot who steers is commanded",
        "safety/strategy.py",
        "OVERRULE: Final = (Fact.PILOT, Fact.FAILSAFE)",
        "OVERRULE: Final = (Fact.FAILSAFE,)",
    ),
    Planted(
        "a transfer that is under way is waited for without end",
        "authority/coverage.py",
        "hurried = now < authority.hurry_until(self._limits.forced_timeout_s)",
        "hurried = True",
    ),
    Planted(
        "the energy has no say",
        "safety/conditions.py",
        "        if self.reported.energy:\n",
        "        if self.reported.energy and authority.lost:\n",
    ),
    Planted(
        "the time in a gap never ends",
        "safety/gap.py",
        "return self.since is None or now < self.since + self.gap.limit_s",
        "return self.since is None or now < self.since + 100.0 * self.gap.limit_s",
    ),
    Planted(
        "a place is chosen without a look at who covers it",
        "safety/return_site.py",
        "place.way_inside and place.way_clear, place.coverage(usable))",
        "place.way_inside and place.way_clear, Coverage.ALL)",
    ),
    Planted(
        "a return that is not flown is not noticed",
        "safety/command_verification.py",
        "        if self._has_time(self._limits.obey_s, now):\n",
        "        if self._has_time(1000.0 * self._limits.obey_s, now):\n",
    ),
    Planted(
        "out of coverage is no cause while somebody commands",
        "safety/conditions.py",
        "        if authority.out_of_coverage:\n",
        "        if authority.out_of_coverage and authority.lost:\n",
    ),
)


def planted_copy(folder: Path, planted: Planted | None) -> Path:
    """A copy of the product with that fault in it, in `folder`. Raises ValueError where it has no place."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    if planted is not None:
        path = folder / CORE / planted.file
        source = path.read_text(encoding="utf-8")
        if source.count(planted.right) != 1:
            raise ValueError(f"{planted.name}: stands {source.count(planted.right)} times in {planted.file}")
        path.write_text(source.replace(planted.right, planted.wrong), encoding="utf-8")
    return folder


def unsafe_flights(
    folder: Path, planted: Planted | None, first: int, runs: int, jobs: int, *, until_found: bool = False
) -> tuple[int, Counter[str], str]:
    """Fly a campaign over such a copy: flights, how many of them for each kind of what was unsafe, and in words: the
    first of them, and a seed of each kind. `until_found`: no further than the PIECE in which that first one is.

    Raises RuntimeError if the campaign itself does not end.
    """
    home = planted_copy(folder / "product", planted)
    pieces = range(first, first + runs, PIECE if until_found else runs)
    lines: list[dict[str, Any]] = []
    for seed in pieces:
        lines += _flown(home, folder / f"campaign-{seed}", seed, min(pieces.step, first + runs - seed), jobs)
        if any(line["unsafe"] for line in lines):
            break
    rows: Counter[str] = Counter()
    seeds: dict[str, int] = {}
    for line in lines:
        for row in {found[0] for found in line["unsafe"]}:
            rows[row] += 1
            seeds[row] = min(line["seed"], seeds.get(row, line["seed"]))
    if not rows:
        return len(lines), rows, ""
    kinds = ", ".join(f"{row}: {count}, as in {seeds[row]}" for row, count in rows.most_common())
    return len(lines), rows, f"first in flight {min(seeds.values()) - first + 1}; {kinds}"


def _flown(home: Path, out: Path, first: int, runs: int, jobs: int) -> list[dict[str, Any]]:
    """The outcomes of these flights with the product that stands in `home`."""
    command = "import sys; from sitl.campaign.main import main; sys.exit(main(sys.argv[1:]))"
    options = [f"--runs={runs}", f"--jobs={jobs}", f"--seed={first}", f"--out={out}"]
    flown = subprocess.run(
        [sys.executable, "-c", command, *options],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )
    if flown.returncode not in (0, 1):
        raise RuntimeError(flown.stderr[-2000:])
    return [json.loads(line) for line in (out / "flights.jsonl").read_text(encoding="utf-8").splitlines()]


def main(arguments: Sequence[str]) -> int:
    """Plant, fly, tell; 1 if a fault was not found, or something was found without any."""
    from tests.sitl.planted_by_others import PLANTED_BY_OTHERS  # it is written in the terms of this file
    from tests.sitl.planted_in_hearing import PLANTED_IN_HEARING

    options = argparse.ArgumentParser(prog="plant_in_strategy", description=__doc__)
    options.add_argument("--runs", type=int, default=2000, help="flights for each fault (2000)")
    options.add_argument("--jobs", type=int, default=2, help="processes (2)")
    options.add_argument("--seed", type=int, default=500_000, help="of the first flight (500000)")
    options.add_argument("--until-found", action="store_true", help=f"{PIECE} flights at a time, until it is found")
    options.add_argument("--by-others", action="store_true", help="the ten of planted_by_others.py in place of these")
    options.add_argument(
        "--downlink", action="store_true", help="those of planted_in_hearing.py, in flights whose downlinks fail"
    )
    options.add_argument("parts", nargs="*", metavar="PART", help="only faults with one of these in their name")
    chosen = options.parse_args(arguments)
    planted = PLANTED_BY_OTHERS if chosen.by_others else PLANTED
    if chosen.downlink:
        planted, chosen.seed = PLANTED_IN_HEARING, max(chosen.seed, DOWNLINK)
    wanted = [fault for fault in planted if not chosen.parts or any(part in fault.name for part in chosen.parts)]
    wrong = 0
    for fault in (None, *wanted):
        begun = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            flights, rows, words = unsafe_flights(
                Path(folder), fault, chosen.seed, chosen.runs, chosen.jobs, until_found=chosen.until_found
            )
        name = "without a fault" if fault is None else fault.name
        good = bool(rows) is (fault is not None)
        wrong += not good
        print(
            f"{'' if good else 'WRONG: '}{name}: {words or 'nothing unsafe'} ({flights} flights, "
            f"{time.monotonic() - begun:.0f} s)",
            flush=True,
        )
    return 1 if wrong or not wanted else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

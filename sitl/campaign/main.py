# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover campaign`: random flights with random faults over the real rules, and their results."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mavproxy_handover.tools.command_line import CommandParser
from sitl.campaign.compare import compare
from sitl.campaign.figures import Figures, figures
from sitl.campaign.judge import ended, judge
from sitl.campaign.page import summary, write_page
from sitl.campaign.plan import DOWNLINK, HARD, draw
from sitl.campaign.times import SECOND
from sitl.campaign.work import Campaign, CampaignError, Flights, fly_all
from sitl.campaign.world import World

__all__ = ["main"]

#: between two lines of progress (s)
_TELLS_S = 10.0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = CommandParser(
        prog="handover campaign",
        examples=(
            ("handover campaign --runs 1000 --jobs 4", "a thousand flights on four processes"),
            ("handover campaign --seed 20055 --story", "the flight of one seed, in sentences"),
        ),
        codes={
            0: "no flight was unsafe",
            1: "a flight was unsafe; its seed is told",
            2: "wrong usage, or a folder of another campaign",
        },
        description="Fly random missions with random faults over the real rules, in simulated time, and judge them by "
        "what really happened.",
    )
    parser.add_argument("--runs", type=int, default=200, metavar="N", help="how many flights (200)")
    parser.add_argument("--jobs", type=int, default=1, metavar="M", help="processes on this machine (1)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the first flight (0)")
    parser.add_argument(
        "--hard",
        action="store_true",
        help=f"flights in which two or three pairs of causes strike: seeds from {HARD} on",
    )
    parser.add_argument(
        "--downlink",
        action="store_true",
        help=f"flights in which only the downlinks of stations fail: seeds from {DOWNLINK} on",
    )
    parser.add_argument("--story", action="store_true", help="tell the flight of --seed in sentences, and fly no other")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of Dask: its workers fly")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder; one that is there goes on (runs/campaign-TIME)"
    )
    parser.add_argument(
        "--compare", action="store_true", help="fly each flight both ways: the same outcomes, and how much faster?"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end; progress to stderr")
    arguments = parser.parse_args(argv)
    for name, least in (("runs", 1), ("jobs", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            parser.error(f"--{name} must be {least} or more")
    if arguments.story and (arguments.compare or arguments.runs != parser.get_default("runs")):
        parser.error("--story tells of one flight: without --runs and --compare")
    if arguments.hard and arguments.seed < HARD:
        arguments.seed += HARD
    if arguments.downlink and arguments.seed < DOWNLINK:
        arguments.seed += DOWNLINK
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; 0: nothing unsafe, 1: something, 2: bad usage, or it cannot be flown."""
    try:
        arguments = _arguments(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    if arguments.story:
        return _tell(arguments.seed)
    if arguments.compare:
        return _compare(range(arguments.seed, arguments.seed + arguments.runs))
    campaign = Campaign(arguments.seed, arguments.runs)
    folder: Path = arguments.out or Path("runs") / time.strftime("campaign-%Y%m%d-%H%M%S")
    try:
        return _fly(campaign, folder, arguments)
    except CampaignError as error:
        print(f"handover campaign: {error}", file=sys.stderr)
        return 2


def _fly(campaign: Campaign, folder: Path, arguments: argparse.Namespace) -> int:
    flights = Flights(folder, campaign)
    told_on = sys.stderr if arguments.json else sys.stdout
    begun = told = time.monotonic()
    flown = 0
    for batch in fly_all(campaign, flights.outcomes, arguments.jobs, arguments.scheduler):
        flights.add(batch)
        flown += len(batch)
        now = time.monotonic()
        if now - told >= _TELLS_S:
            told = now
            left_s = (campaign.runs - len(flights.outcomes)) * (now - begun) / flown
            unsafe = sum(bool(each.unsafe) for each in flights.outcomes.values())
            text = f"{len(flights.outcomes)} of {campaign.runs} flights, {unsafe} unsafe, {left_s:.0f} s to go"
            print(text, file=told_on, flush=True)
    outcomes = list(flights.outcomes.values())
    found = figures(outcomes)
    try:
        page = write_page(folder, outcomes)
    except OSError as error:
        raise CampaignError(f"{folder}: {error.strerror}") from error
    if arguments.json:
        print(json.dumps(_as_json(found, page), indent=1))
    else:
        print(summary(found), page, sep="\n")
    return 1 if found.unsafe_flights else 0


def _as_json(found: Figures, page: Path) -> dict[str, Any]:
    """`unsafe`: each way to be unsafe, with the seeds of its flights."""
    return {
        "flights": found.flights,
        "hours": round(found.hours, 3),
        "ended": dict(found.ended),
        "unsafe_flights": found.unsafe_flights,
        "unsafe": found.examples,
        "page": str(page),
    }


def _compare(seeds: range) -> int:
    """Both ways to let time pass, side by side."""
    told = time.monotonic()
    for found in compare(seeds):
        now = time.monotonic()
        if found.flights == len(seeds) or now - told >= _TELLS_S:
            told = now
            print(found.words, flush=True)
    return 1 if found.differ else 0


def _tell(seed: int) -> int:
    """The story of one flight."""
    plan = draw(seed)
    log = World(plan, tells=True).run()
    print(plan.words)
    for cause, policy in sorted(plan.policies.items(), key=lambda pair: pair[0].value):
        print(f"  policy {cause.value}: {policy}")
    found = judge(plan, log)
    lines = [*log.story, *((each.at, f"UNSAFE ({each.row}): {each.text}") for each in found)]
    for at, text in sorted(lines, key=lambda line: line[0]):
        print(f"{at / SECOND:9.2f} s  {text}")
    print(f"ended: {ended(log)}")
    return 1 if found else 0

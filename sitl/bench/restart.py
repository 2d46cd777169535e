# SPDX-License-Identifier: GPL-3.0-or-later

"""How long the guard has no commander when the companion dies or stalls in flight.

The time is from the last lease of one run to the first HELD one of the next.

Real processes, one vehicle and two signed stations, every link with 20 % loss each way, and four busy processes. Ours
is `handover companion`, whose child is killed (SIGKILL) or stopped (SIGSTOP: it stalls and does not die). The baseline
is the same MAVProxy without a supervisor, killed and started again at once by a watcher that does nothing else.
`--restarts-within 0` lets the supervisor forget every restart: the rule for the third one would end the measurement.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from mavproxy_handover.cli.launch import companion_argv, supervised_argv
from mavproxy_handover.core.common.model import LeaseState
from sitl.bench.flight import Flight
from sitl.bench.loop import BenchError
from sitl.bench.numbers import median, quantile
from sitl.bench.results import Measurement
from sitl.run.processes import Processes

__all__ = ["Plan", "measure"]

#: "Numbers that are held to" in docs/architecture.md
KILLED_LATE_S, STALLED_LATE_S = 2.0, 2.5
_BUSY, _LOSS = 4, 0.2
#: a run that is not over by then is no measurement
_LIMIT_S = 60.0
_KEEP_BUSY = [sys.executable, "-c", "while True: pass"]


@dataclass(frozen=True, slots=True)
class Plan:
    """How many deaths, stalls, and deaths of the baseline."""

    kills: int
    stalls: int
    baseline: int


class _Leases:
    """The leases of the present run and the last one of the run before; times are monotonic seconds."""

    def __init__(self) -> None:
        self.nonce = 0
        self.last_at = -math.inf
        self.before_at = -math.inf
        self.held_at = math.inf

    def record(self, state: int, nonce: int) -> None:
        """One has arrived."""
        now = time.monotonic()
        if nonce != self.nonce:
            self.nonce, self.before_at, self.held_at = nonce, self.last_at, math.inf
        self.last_at = now
        if state == LeaseState.HELD:
            self.held_at = min(self.held_at, now)


def _again(config: Path, master: str, logfile: Path) -> list[str]:
    return [*supervised_argv(config, master, logfile), "--restarts-within=0"]


def _gaps(flight: Flight, number: int, end: Callable[[], None], luck: Random) -> list[float]:
    """End the companion's run so many times; the seconds without a HELD lease."""
    leases = _Leases()
    flight.autopilot.model.on_lease = leases.record
    gaps: list[float] = []
    while len(gaps) < number:
        flight.loop.run_until(lambda: leases.held_at < math.inf, _LIMIT_S, "somebody commands")
        flight.loop.run(luck.uniform(1.0, 2.0))  # heartbeats come once a second: at any time between two
        flight.check()
        former = leases.nonce
        end()
        flight.loop.run_until(
            lambda former=former: leases.nonce != former and leases.held_at < math.inf,  # type: ignore[misc]
            _LIMIT_S,
            "a station commands after the restart",
        )
        gaps.append(leases.held_at - leases.before_at)
    return gaps


def _ending(flight: Flight, number: signal.Signals) -> Callable[[], None]:
    def end() -> None:
        child = flight.companion.offspring()
        if child is None:
            raise BenchError("the companion has no child")
        os.kill(child, number)

    return end


def measure(folder: Path, plan: Plan, say: Callable[[str], None]) -> Iterator[Measurement]:
    """Deaths and stalls of ours, and deaths of the baseline in between."""
    with Processes() as load:
        for number in range(_BUSY):
            load.start(f"busy-{number}", _KEEP_BUSY, folder / "busy")
        unsupervised = _fly(
            folder / "unsupervised", companion_argv, lambda flight: [(plan.baseline, flight.restart_companion)]
        )[0]
        say(f"without a supervisor: {_numbers(unsupervised)}")
        killed, stalled = _fly(
            folder / "supervised",
            _again,
            lambda flight: [
                (plan.kills, _ending(flight, signal.SIGKILL)),
                (plan.stalls, _ending(flight, signal.SIGSTOP)),
            ],
        )
        say(f"killed: {_numbers(killed)}")
        say(f"stalled: {_numbers(stalled)}")
    yield from _measurements("killed", killed, KILLED_LATE_S, unsupervised)
    yield from _measurements("stalled", stalled, STALLED_LATE_S, None)


def _fly(
    folder: Path,
    companion: Callable[[Path, str, Path], list[str]],
    ends: Callable[[Flight], list[tuple[int, Callable[[], None]]]],
) -> list[list[float]]:
    luck = Random(1)
    with Flight(folder, 1e6, bad_links=True, signing=True, companion=companion) as flight:
        flight.weather(f"loss all {_LOSS}")
        return [_gaps(flight, number, end, luck) for number, end in ends(flight)]


def _numbers(gaps: Sequence[float]) -> str:
    late, worst = quantile(gaps, 0.99), max(gaps)
    return f"{len(gaps)} restarts, median {median(gaps):.2f} s, 99 % {late:.2f} s, longest {worst:.2f} s"


def _measurements(
    what: str, gaps: Sequence[float], late_limit_s: float, baseline: Sequence[float] | None
) -> Iterator[Measurement]:
    case = {"load": f"{_BUSY} busy processes", "links": f"{_LOSS:.0%} loss each way", "n": len(gaps)}
    note = "from the last lease to the next HELD one; baseline: killed without a supervisor, started again at once"
    for name, part, limit in (("median", 0.5, None), ("99 %", 0.99, late_limit_s)):
        yield Measurement(
            "restart",
            f"{what}, {name}",
            "s",
            case,
            ours=quantile(gaps, part),
            baseline=None if baseline is None else quantile(baseline, part),
            limit=limit,
            judged="ours",
            details={"gaps_s": list(gaps)} if name == "median" else {},
            note=note,
        )

# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs at fixed intervals. An exception in one job stops no other.

A job that is late by less than its interval keeps its old times, so that its rate holds on a busy machine. After a
longer stall it starts again from now; missed runs are not made up.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

__all__ = ["TICK_S", "Schedule", "attempt"]

Job = Callable[[float], None]

#: least time (s) between ticks, however fast MAVProxy's main loop runs; urgent work is triggered by frames
TICK_S: Final = 0.05


def attempt(fault: Callable[[str, str], None], where: str, job: Callable[..., None], *arguments: Any) -> None:
    """Run `job`. An exception goes to `fault`, and the caller continues."""
    try:
        job(*arguments)
    except Exception:
        fault(where, traceback.format_exc(limit=-3))


@dataclass(slots=True)
class _Planned:
    name: str
    job: Job
    interval_s: float
    #: delay (s) that is added once, after the first run
    later_s: float
    due_at: float = -math.inf


class Schedule:
    """Runs `jobs` (name, job, interval in s), the first time at once. `fault` gets the name of a job that raised.

    If all jobs came together, a frame would wait for all of them. So after the first run each job is delayed to one
    tick after the one before it.
    """

    def __init__(self, jobs: Iterable[tuple[str, Job, float]], fault: Callable[[str, str], None]) -> None:
        self._jobs = [
            _Planned(name, job, interval_s, number * TICK_S % interval_s)
            for number, (name, job, interval_s) in enumerate(jobs)
        ]
        self._fault = fault

    def run(self, now: float) -> None:
        """Run the jobs that are due; `now` in monotonic seconds. Call it often."""
        for planned in self._jobs:
            if now >= planned.due_at:
                late_s = now - planned.due_at
                late_s = late_s if late_s < planned.interval_s else 0.0
                planned.due_at = now + planned.interval_s - late_s + planned.later_s
                planned.later_s = 0.0
                attempt(self._fault, planned.name, planned.job, now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs that come round at fixed intervals, each on its own: what breaks in one stops no other.

A job that comes late by less than its interval keeps to its old times, so that its rate holds on a busy machine. After
a longer stall it begins anew: nothing is made up for.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

__all__ = ["TICK_S", "Schedule", "attempt"]

Job = Callable[[float], None]

#: ticks come no faster than this, however fast MAVProxy's main loop goes round; what is more urgent comes as a frame
TICK_S: Final = 0.05


def attempt(fault: Callable[[str, str], None], where: str, job: Callable[..., None], *arguments: Any) -> None:
    """Do it; if it breaks `fault` is told, and what comes behind it is none the worse for it."""
    try:
        job(*arguments)
    except Exception:
        fault(where, traceback.format_exc(limit=-3))


@dataclass(slots=True)
class _Planned:
    name: str
    job: Job
    interval_s: float
    #: put off once, after the first time
    later_s: float
    due_at: float = -math.inf


class Schedule:
    """Runs `jobs` (name, job, interval in s), the first time at once. `fault` is told the name of what broke.

    Jobs that all came together would keep a frame waiting for all of them. So after the first time each is put off
    until a tick behind the one before it.
    """

    def __init__(self, jobs: Iterable[tuple[str, Job, float]], fault: Callable[[str, str], None]) -> None:
        self._jobs = [
            _Planned(name, job, interval_s, number * TICK_S % interval_s)
            for number, (name, job, interval_s) in enumerate(jobs)
        ]
        self._fault = fault

    def run(self, now: float) -> None:
        """Run what is due; monotonic seconds. To be called often."""
        for planned in self._jobs:
            if now >= planned.due_at:
                late_s = now - planned.due_at
                late_s = late_s if late_s < planned.interval_s else 0.0
                planned.due_at = now + planned.interval_s - late_s + planned.later_s
                planned.later_s = 0.0
                attempt(self._fault, planned.name, planned.job, now)

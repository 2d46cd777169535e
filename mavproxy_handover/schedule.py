# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs that come round at fixed intervals, each on its own: what breaks in one stops no other.

A job that comes late by less than its interval keeps to its old times, so that its rate holds on a busy machine. After
a longer stall it begins anew: nothing is made up for.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable

__all__ = ["Schedule"]

Job = Callable[[float], None]


class Schedule:
    """Runs `jobs` (each with its interval in s), the first time at once. `fault` is told what broke."""

    def __init__(self, jobs: Iterable[tuple[Job, float]], fault: Callable[[str, str], None]) -> None:
        self._due = {job: (interval_s, 0.0) for job, interval_s in jobs}
        self._fault = fault

    def run(self, now: float) -> None:
        """Run what is due; monotonic seconds. To be called often."""
        for job, (interval_s, due_at) in self._due.items():
            if now >= due_at:
                late_s = now - due_at
                self._due[job] = (interval_s, now + interval_s - (late_s if late_s < interval_s else 0.0))
                try:
                    job(now)
                except Exception:
                    self._fault(job.__name__.strip("_"), traceback.format_exc(limit=-3))

# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs jobs of unbounded size (parsing, computing with zones) in a thread beside the main loop.

The main loop sends the lease, so it must not wait for long jobs. A job runs in its own thread, one at a time. `tick`
delivers its result in the main loop. A job must not touch any object that the main loop uses: it gets its input and
returns a value.

Python's threads take turns of 5 ms. Whenever the main loop gives up its turn, to read or to send, it would get it back
only after that time. A lease needs many such calls. So while a job runs, turns are short (`TURN_S`).

A thread cannot be ended from outside. So a job that takes longer than `LONGEST_S` has failed: its result is ignored,
and the next job may begin beside it. At most `MOST_LEFT` such threads may run; at that number no job is accepted until
one of them ends.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Final, TypeVar

__all__ = ["LONGEST_S", "MOST_LEFT", "TURN_S", "Worker", "in_thread"]

LONGEST_S: Final = 30.0
MOST_LEFT: Final = 2
TURN_S: Final = 0.0002

_Value = TypeVar("_Value")


def in_thread(run: Callable[[], None]) -> None:
    """Run this in a thread that does not keep the program from ending."""
    threading.Thread(target=run, name="handover-worker", daemon=True).start()


class Worker:
    """Runs one job at a time. `start` starts the thread; a test may run the job at once."""

    def __init__(self, start: Callable[[Callable[[], None]], None] | None = None) -> None:
        self._start = start
        #: finished jobs: number and result of each
        self._finished: deque[tuple[int, Any]] = deque()
        #: current job: its number, the receiver of its result, and its deadline
        self._number = 0
        self._then: Callable[[Any, float], None] | None = None
        self._until: float | None = None
        #: numbers of failed jobs whose threads still run
        self._left: set[int] = set()
        #: length of a turn (s) when no job runs
        self._turn_s = sys.getswitchinterval()

    @property
    def busy(self) -> bool:
        """True while a job runs or its result is not delivered yet."""
        return self._then is not None

    def submit(self, job: Callable[[], _Value], then: Callable[[_Value | Exception, float], None]) -> bool:
        """Start `job`. `then` gets its return value or its exception, and the time, from `tick`.

        Returns False if it is not accepted: another job runs, or too many failed ones still run.
        """
        if self.busy or len(self._left) >= MOST_LEFT:
            return False
        self._number += 1
        number, self._then, self._until = self._number, then, None

        def run() -> None:
            result: Any
            try:
                result = job()
            except Exception as error:
                result = error
            self._finished.append((number, result))

        sys.setswitchinterval(TURN_S)
        (self._start or in_thread)(run)
        return True

    def tick(self, now: float) -> None:
        """Deliver results, and give up jobs that take too long. Call it often. Raises what the receiver raises.

        The time of a job counts from the first tick after `submit`.
        """
        while self._finished:
            number, result = self._finished.popleft()
            self._left.discard(number)
            if not self._left:
                sys.setswitchinterval(self._turn_s)
            if number == self._number and self._then is not None:
                self._conclude(result, now)
        if self._then is None:
            return
        if self._until is None:
            self._until = now + LONGEST_S
        elif now >= self._until:
            self._left.add(self._number)
            self._conclude(TimeoutError(f"not done within {LONGEST_S:g} s"), now)

    def _conclude(self, result: Any, now: float) -> None:
        then, self._then = self._then, None
        assert then is not None
        then(result, now)

# SPDX-License-Identifier: GPL-3.0-or-later

"""Work of a size that others choose (to parse, to compute with zones), done beside the main loop.

The lease goes out from the main loop, so nothing stands in it that may take long. A job runs in a thread of its own,
one at a time; what came of it is handed over by `tick`, in the main loop. A job must touch nothing that the main loop
touches: it gets what it needs, and returns a value.

Python's threads take turns, 5 ms each: whenever the main loop has let go of its turn, to read or to send, it would get
it back only that much later, and a lease stands behind many such calls. So while a job runs, turns are short
(`TURN_S`).

A thread cannot be ended from outside. So a job that takes longer than `LONGEST_S` is given up: it has failed, whatever
comes of it later, and the next one may begin beside it. Of those that go on all the same there are `MOST_LEFT` at most;
from then on nothing is taken until one of them ends.
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
    """Runs one job at a time. `start` has the job run; a test may have it run at once."""

    def __init__(self, start: Callable[[Callable[[], None]], None] | None = None) -> None:
        self._start = start
        #: jobs that have ended: their number and what came of each
        self._finished: deque[tuple[int, Any]] = deque()
        #: of the job that is under way: its number, who gets what comes of it, and until when it may take
        self._number = 0
        self._then: Callable[[Any, float], None] | None = None
        self._until: float | None = None
        #: numbers of those that were given up and go on
        self._left: set[int] = set()
        #: how long turns are when no job runs
        self._turn_s = sys.getswitchinterval()

    @property
    def busy(self) -> bool:
        """A job is under way, or what came of it has not been handed over yet."""
        return self._then is not None

    def submit(self, job: Callable[[], _Value], then: Callable[[_Value | Exception, float], None]) -> bool:
        """Have `job` done; `then` gets what it returned, or the exception it ended with, and the time (`tick`).

        False: another job is under way, or too many do not end, and this one was not taken.
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
        """Hand over what is finished, give up what takes too long; to be called often. Raises what the receiver raises.

        The time of a job counts from the first tick after it was given.
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

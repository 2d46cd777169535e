# SPDX-License-Identifier: GPL-3.0-or-later

"""Work of a size that others choose (to parse, to compute with zones), done beside the main loop.

The lease goes out from the main loop, so nothing stands in it that may take long. A job runs in a thread of its own,
one at a time; what came of it is handed over by `tick`, in the main loop. A job must touch nothing that the main loop
touches: it gets what it needs, and returns a value.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["Worker", "in_thread"]

_Value = TypeVar("_Value")


def in_thread(run: Callable[[], None]) -> None:
    """Run this in a thread that does not keep the program from ending."""
    threading.Thread(target=run, name="handover-worker", daemon=True).start()


class Worker:
    """Runs one job at a time. `start` has the job run; a test may have it run at once."""

    def __init__(self, start: Callable[[Callable[[], None]], None] | None = None) -> None:
        self._start = start
        self._finished: deque[Callable[[float], None]] = deque()
        self._busy = False

    @property
    def busy(self) -> bool:
        """A job is under way, or what came of it has not been handed over yet."""
        return self._busy

    def submit(self, job: Callable[[], _Value], then: Callable[[_Value | Exception, float], None]) -> bool:
        """Have `job` done; `then` gets what it returned, or the exception it ended with, and the time (`tick`).

        False: another job is under way, and this one was not taken.
        """
        if self._busy:
            return False
        self._busy = True

        def run() -> None:
            result: Any
            try:
                result = job()
            except Exception as error:
                result = error
            self._finished.append(lambda now: then(result, now))

        (self._start or in_thread)(run)
        return True

    def tick(self, now: float) -> None:
        """Hand over what is finished; to be called often. Raises what the receiver raises."""
        while self._finished:
            conclude = self._finished.popleft()
            self._busy = False
            conclude(now)

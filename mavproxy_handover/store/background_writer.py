# SPDX-License-Identifier: GPL-3.0-or-later

"""What is written to a disk is written behind the main loop: the lease goes out from there, and a disk may hang.

Rules that live here
--------------------
* One thread for each thing that is written, so that what hangs in one holds up no other.
* Of jobs with the same name only the newest is done: what nobody has begun when the next one comes is not news any
  more. So no more jobs can wait than there are names.
* Nothing here raises, and nothing waits but `settle` and `close`, which are told for how long. The thread keeps no
  program from ending.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

__all__ = ["CLOSE_S", "Behind"]

#: at the end so long is waited for what has still to be written: the program has two seconds to end
CLOSE_S = 0.5
_LOG = logging.getLogger(__name__)


class Behind:
    """Does jobs in a thread of its own, which begins with the first of them. A job may raise: that ends it alone."""

    def __init__(self, name: str) -> None:
        self._name = name
        #: what waits, by name, the oldest first
        self._waiting: dict[str, Callable[[], None]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._working = False
        self._closed = False

    @property
    def idle(self) -> bool:
        """Nothing waits, and nothing is being done."""
        with self._changed:
            return not self._waiting and not self._working

    def put(self, name: str, job: Callable[[], None]) -> bool:
        """Have `job` done, in place of the one of this name that still waits. False: that cannot be, it is not taken.

        Returns at once.
        """
        with self._changed:
            if self._closed or not self._begun():
                return False
            self._waiting[name] = job
            self._changed.notify_all()
        return True

    def settle(self, within_s: float) -> bool:
        """Wait until all is done, so long at most; whether it is."""
        until = time.monotonic() + within_s
        with self._changed:
            while self._waiting or self._working:
                left_s = until - time.monotonic()
                if left_s <= 0.0:
                    return False
                self._changed.wait(left_s)
        return True

    def close(self, within_s: float = CLOSE_S) -> bool:
        """Take nothing more, and wait for what was taken, so long at most; whether all of it is done."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        done = self.settle(within_s)
        with self._changed:
            self._waiting.clear()  # the disk hangs: should it come back, what it does then is nobody's wish any more
        return done

    def _begun(self) -> bool:
        if self._thread is None:
            thread = threading.Thread(target=self._run, name=self._name, daemon=True)
            try:
                thread.start()
            except RuntimeError:  # the system has no room for one more: the next job tries again
                return False
            self._thread = thread
        return True

    def _run(self) -> None:
        while True:
            with self._changed:
                self._working = False
                self._changed.notify_all()
                while not self._waiting:
                    if self._closed:
                        return
                    self._changed.wait()
                name = next(iter(self._waiting))
                job = self._waiting.pop(name)
                self._working = True
            try:
                job()
            except Exception:  # whoever gave the job knows what to make of it; what it did not foresee is told here
                _LOG.exception("%s: %s failed", self._name, name)

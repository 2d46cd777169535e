# SPDX-License-Identifier: GPL-3.0-or-later

"""Threads that write to a disk for the main loop. The main loop sends the lease, and a disk may hang.

Rules that live here
--------------------
* One thread for each thing that is written. If one thread hangs, the others go on.
* A new job replaces a waiting job of the same name, because the older one is obsolete. So no more jobs can wait than
  there are names.
* Nothing here raises. Only `wait_until_written` and `close` wait, at most as long as they are told. The threads do not
  keep the program from ending.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

__all__ = ["CLOSE_S", "BackgroundWriter"]

#: time (s) that `close` waits for unfinished writes; the whole program has two seconds to end
CLOSE_S = 0.5
_LOG = logging.getLogger(__name__)


class BackgroundWriter:
    """Runs jobs in its own thread, which starts with the first job. An exception ends only the job that raised it."""

    def __init__(self, name: str) -> None:
        self._name = name
        #: waiting jobs by name, the oldest first
        self._waiting: dict[str, Callable[[], None]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._working = False
        self._closed = False

    @property
    def idle(self) -> bool:
        """True if no job waits or runs."""
        with self._changed:
            return not self._waiting and not self._working

    def put(self, name: str, job: Callable[[], None]) -> bool:
        """Queue `job`. It replaces a waiting job of the same name. Returns at once.

        Returns False if the job cannot be accepted: this writer is closed, or its thread cannot start.
        """
        with self._changed:
            if self._closed or not self._begun():
                return False
            self._waiting[name] = job
            self._changed.notify_all()
        return True

    def wait_until_written(self, within_s: float) -> bool:
        """Wait until all jobs are done, at most `within_s`. Returns True if they are."""
        until = time.monotonic() + within_s
        with self._changed:
            while self._waiting or self._working:
                left_s = until - time.monotonic()
                if left_s <= 0.0:
                    return False
                self._changed.wait(left_s)
        return True

    def close(self, within_s: float = CLOSE_S) -> bool:
        """Accept no more jobs and wait for the accepted ones, at most `within_s`. Returns True if all are done."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        done = self.wait_until_written(within_s)
        with self._changed:
            self._waiting.clear()  # the disk hangs: drop the jobs, so that nothing is written if it recovers later
        return done

    def _begun(self) -> bool:
        if self._thread is None:
            thread = threading.Thread(target=self._run, name=self._name, daemon=True)
            try:
                thread.start()
            except RuntimeError:  # the system cannot start a thread now; the next job tries again
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
            except Exception:  # a job handles its expected errors itself; log what it did not expect
                _LOG.exception("%s: %s failed", self._name, name)

# SPDX-License-Identifier: GPL-3.0-or-later

"""One thread, many sockets, exact timers: the loop in which fake autopilots and stations live.

`select.select` and not epoll where it matters, because Python's epoll waits in whole milliseconds and frames are sent
a millisecond apart.
"""

from __future__ import annotations

import heapq
import itertools
import select
import time
from collections.abc import Callable
from contextlib import suppress

__all__ = ["BenchError", "Loop", "Timer", "cpu_s"]


class BenchError(Exception):
    """A measurement cannot be made; one line for people."""


def cpu_s(pid: int) -> float:
    """Processor time of a process, user and system, all its threads, in seconds.

    The sum that /proc/PID/stat shows in hundredths of a second, from the process's own clock (clock_getcpuclockid of
    POSIX), which counts nanoseconds. Raises BenchError when there is no such process.
    """
    try:
        return time.clock_gettime((~pid << 3) | 2)
    except OSError as error:
        raise BenchError(f"processor time of process {pid}: {error.strerror}") from None


class Timer:
    """Something that happens again and again until it is cancelled."""

    __slots__ = ("cancelled", "due", "interval_s", "job")

    def __init__(self, interval_s: float, job: Callable[[], None], due: float) -> None:
        self.interval_s = interval_s
        self.job = job
        self.due = due
        self.cancelled = False

    def cancel(self) -> None:
        """No more."""
        self.cancelled = True


class Loop:
    """Runs timers and readers. Times are monotonic seconds."""

    #: a timer that is later than this skips what it missed instead of catching up
    CATCH_UP_S = 0.25

    def __init__(self, *, many: bool = False) -> None:
        """`many`: for hundreds of sockets. Waiting is then by epoll, and up to a millisecond too long."""
        self._epoll = select.epoll() if many else None
        self._readers: dict[int, Callable[[], None]] = {}
        self._timers: list[tuple[float, int, Timer]] = []
        self._clocks: list[Callable[[], float | None]] = []
        self._numbers = itertools.count()

    def add_reader(self, descriptor: int, job: Callable[[], None]) -> None:
        """Call `job` whenever there is something to read."""
        if self._epoll is not None and descriptor not in self._readers:
            self._epoll.register(descriptor, select.EPOLLIN)
        self._readers[descriptor] = job

    def remove_reader(self, descriptor: int) -> None:
        """Stop that; before the descriptor is closed."""
        if self._readers.pop(descriptor, None) is not None and self._epoll is not None:
            with suppress(OSError):  # its owner has closed it already: the system has forgotten it
                self._epoll.unregister(descriptor)

    def add_clock(self, job: Callable[[], float | None]) -> None:
        """Call `job` in every round.

        It returns in how many seconds it must be called again (None: it does not matter).
        """
        self._clocks.append(job)

    def remove_clock(self, job: Callable[[], float | None]) -> None:
        """Stop that."""
        self._clocks.remove(job)

    def every(self, interval_s: float, job: Callable[[], None], first_in_s: float = 0.0) -> Timer:
        """Call `job` every `interval_s`; a late call does not delay the next ones."""
        timer = Timer(interval_s, job, time.monotonic() + first_in_s)
        heapq.heappush(self._timers, (timer.due, next(self._numbers), timer))
        return timer

    def run(self, seconds: float) -> None:
        """Run for that long."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._round(until)

    def run_until(self, condition: Callable[[], bool], limit_s: float, what: str) -> None:
        """Run until `condition`. Raises BenchError, naming `what`, if that takes longer than `limit_s`."""
        until = time.monotonic() + limit_s
        while not condition():
            if time.monotonic() >= until:
                raise BenchError(f"{what}: not within {limit_s:g} s")
            self._round(min(until, time.monotonic() + 0.05))

    def _round(self, until: float) -> None:
        now = time.monotonic()
        while self._timers and self._timers[0][0] <= now < until:
            _due, _number, timer = heapq.heappop(self._timers)
            if timer.cancelled:
                continue
            timer.job()
            timer.due += timer.interval_s
            if now - timer.due > self.CATCH_UP_S:
                timer.due = now
            heapq.heappush(self._timers, (timer.due, next(self._numbers), timer))
            # a burst that catches up must not keep the receivers waiting
            if self._readers:
                self._read(0.0)
            now = time.monotonic()
        wait_s = until - now
        for clock in self._clocks:
            due_in_s = clock()
            if due_in_s is not None and due_in_s < wait_s:
                wait_s = due_in_s
        if self._timers:
            wait_s = min(wait_s, self._timers[0][0] - now)
        self._read(max(0.0, wait_s))

    def _read(self, wait_s: float) -> None:
        if self._epoll is None:
            ready, _, _ = select.select(list(self._readers), [], [], wait_s)
        else:
            ready = [descriptor for descriptor, _events in self._epoll.poll(wait_s)]
        for descriptor in ready:
            reader = self._readers.get(descriptor)
            if reader is not None:
                reader()

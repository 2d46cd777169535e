# SPDX-License-Identifier: GPL-3.0-or-later

"""Simulated time for the programs of a simulation: their clocks go with the vehicle's, at any speed-up.

A flight at eight times real time is faithful only if every time-out lasts eight times shorter on the wall clock. So the
vehicle writes its simulated time into a page of shared memory, and each program of the run reads its clocks there:

    python -m sitl.sim_time PAGE PROGRAM ...      run a Python program with the clocks of PAGE

Rules:

1. `time.time` and `time.monotonic` return the time of the page: in all programs the same, as coarse as the vehicle's
   steps. Each reading is later than the one before by a very small amount. `time.sleep`, `select.select` and
   `select.poll` wait in simulated time. Other waits (locks, queues, other processes) go by the wall clock.
2. The vehicle waits for a program that is late. Each thread that waits for input writes until when it has done its
   work: it found no input, and waits until then. The vehicle stands still while one of them is late by more than
   `LATE_S`. It waits for a thread that does not move while that needs the processor or the disk, `STARVED_S` of the
   wall clock at most. It waits `ASLEEP_S` for one that is asleep, stopped or dead. A program that starts is late from
   its first moment: starting takes no simulated time.
3. A vehicle that writes nothing for `SILENT_S` of the wall clock hangs, and one that has ended writes no more
   (`Page.let_go`): the clocks go on without it. A vehicle that gets no processor is silent as well, for less.
"""

from __future__ import annotations

import fcntl
import math
import mmap
import os
import runpy
import select
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

__all__ = ["ASLEEP_S", "LATE_S", "SILENT_S", "STARVED_S", "Pace", "Page", "follow", "in_sim_time", "main"]

LATE_S: Final = 0.03
ASLEEP_S: Final = 0.5
STARVED_S: Final = 30.0
SILENT_S: Final = 30.0

_SLOTS: Final = 128
#: number of the entry, odd while it is written
_NUMBER: Final = struct.Struct("<Q")
#: wall clock, simulated time, pace, time of the page's first moment on the wall clock, and UTC then
_HEAD: Final = struct.Struct("<ddddd")
_HEAD_AT: Final = _NUMBER.size
_SLOT: Final = struct.Struct("<QQd")  # thread, 0: free; how often it looked for input; until when its work is done
_SLOTS_AT: Final = 64
_BYTES: Final = _SLOTS_AT + _SLOTS * _SLOT.size
_TRIES: Final = 1000
#: a waiting thread reads the page this often (s of the wall clock): the vehicle is not always as fast as it says
_SHORTEST_S, _LOOK_S = 0.0005, 0.05
#: two readings of a clock differ by this at least: multiprocessing looks again and again until its deadline has passed
_LEAST_S: Final = 1e-9
#: the clocks of the machine, which `follow` replaces
_wall, _sleep, _select, _poll = time.monotonic, time.sleep, select.select, select.poll
_utc = time.time


class Page:
    """The shared page. One process makes it, the vehicle writes its time, all others read."""

    def __init__(self, path: Path, *, make: bool = False) -> None:
        """Open the page at `path`, or make it. Raises OSError."""
        self.path = path
        with path.open("w+b" if make else "r+b") as file:
            if make:
                file.truncate(_BYTES)
            self._memory = mmap.mmap(file.fileno(), _BYTES)
        if make:
            at = _wall()
            self._put(_HEAD_AT, _HEAD.pack(at, 0.0, 0.0, at, _utc()))

    def write(self, sim_s: float, pace: float) -> None:
        """The vehicle's simulated time now, and how many simulated seconds go by in one of the wall clock."""
        self._write(_wall(), sim_s, pace)

    def let_go(self) -> None:
        """No vehicle writes any more: from now on the clocks go on without one, so that all programs can end."""
        sim_s, pace = _HEAD.unpack_from(self._memory, _HEAD_AT)[1:3]
        self._write(_wall() - SILENT_S, sim_s, pace)

    def _write(self, at: float, sim_s: float, pace: float) -> None:
        number: int = _NUMBER.unpack_from(self._memory, 0)[0]
        begun, utc = _HEAD.unpack_from(self._memory, _HEAD_AT)[3:]
        self._put(0, _NUMBER.pack(number | 1))
        self._put(_HEAD_AT, _HEAD.pack(at, sim_s, pace, begun, utc))
        self._put(0, _NUMBER.pack((number | 1) + 1))

    def _put(self, at: int, data: bytes) -> None:
        """Write whole numbers at once. `struct.pack_into` would write zeros before, which others would read."""
        self._memory[at : at + len(data)] = data

    def read(self) -> tuple[float, float, float]:
        """Simulated seconds since the page was made, the wall clock when it was made, UTC then."""
        now = _wall()  # before the page is read: a reader that gets no processor meanwhile must not see a silence
        for _ in range(_TRIES):  # the vehicle may have been killed while it wrote
            number = _NUMBER.unpack_from(self._memory, 0)[0]
            at, sim_s, pace, begun, utc = _HEAD.unpack_from(self._memory, _HEAD_AT)
            if number % 2 == 0 and _NUMBER.unpack_from(self._memory, 0)[0] == number:
                break
        return sim_s + max(0.0, now - at - SILENT_S) * max(pace, 1.0), begun, utc

    @property
    def silence_s(self) -> float:
        """How long ago the vehicle's time was written (s of the wall clock)."""
        now = _wall()
        return now - float(_HEAD.unpack_from(self._memory, _HEAD_AT)[0])

    @property
    def pace(self) -> float:
        """Simulated seconds in one of the wall clock, as the vehicle said last."""
        return max(float(_HEAD.unpack_from(self._memory, _HEAD_AT)[2]), 1e-3)

    def claim(self) -> int:
        """A slot for this thread. Raises RuntimeError if there is none left."""
        with self.path.open("r+b") as file:
            fcntl.lockf(file, fcntl.LOCK_EX)
            for slot in range(_SLOTS):
                if _SLOT.unpack_from(self._memory, _SLOTS_AT + slot * _SLOT.size)[0] == 0:
                    self.promise(slot, 0, self.read()[0])
                    return slot
        raise RuntimeError(f"{self.path}: more than {_SLOTS} threads wait in simulated time")

    def promise(self, slot: int, looks: int, until_s: float) -> None:
        """The thread of this slot has looked for input so often, and has done its work until `until_s` (simulated
        seconds)."""
        self._put(_SLOTS_AT + slot * _SLOT.size, _SLOT.pack(threading.get_native_id(), looks, until_s))

    def promises(self) -> list[tuple[int, int, float]]:
        """What all threads have promised, by slot: thread, looks, until when; of free slots nothing."""
        found = []
        for slot in range(_SLOTS):
            promise = _SLOT.unpack_from(self._memory, _SLOTS_AT + slot * _SLOT.size)
            if not promise[0]:
                break
            found.append(promise)
        return found


class Pace:
    """The vehicle's side of rule 2: whether it may go on."""

    def __init__(self, page: Page) -> None:
        self._page = page
        #: by slot: thread and how often it had looked for input, and when that was first seen
        self._seen: list[tuple[tuple[int, int], float]] = []

    def may_go_on(self, sim_s: float) -> bool:
        """Whether no thread is too late that will catch up."""
        now = _wall()
        promises = self._page.promises()
        self._seen += [((0, 0), now)] * (len(promises) - len(self._seen))
        late = False
        for slot, (thread, looks, until_s) in enumerate(promises):
            if (thread, looks) != self._seen[slot][0]:
                self._seen[slot] = ((thread, looks), now)
            if until_s + LATE_S < sim_s and not late:
                unmoved_s = now - self._seen[slot][1]
                late = unmoved_s < ASLEEP_S or (unmoved_s < STARVED_S and _works(thread))
        return not late


def _works(thread: int) -> bool:
    """Whether a thread has the processor, wants it, or waits for the disk."""
    try:
        text = Path(f"/proc/{thread}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] in "RD"


class _Follower:
    """The clocks of one process, by a page."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._last = -math.inf
        self._start()
        os.register_at_fork(after_in_child=self._start)

    def _start(self) -> None:
        self._mine = threading.local()
        self._mine.slot, self._mine.looks, self._mine.until_s = self._page.claim(), 0, self._page.read()[0]

    def monotonic(self) -> float:
        sim_s, begun, _ = self._page.read()
        self._last = max(self._last + _LEAST_S, begun + sim_s)
        return self._last

    def utc(self) -> float:
        begun, utc = self._page.read()[1:]
        return utc + self.monotonic() - begun

    def wait(self, look: Callable[[float | None], Any], seconds: float | None) -> Any:
        """Wait for something at most so many simulated seconds. `look` waits on the wall clock (None: without end) and
        returns what came, or nothing."""
        found = look(0.0)
        if seconds is not None and seconds <= 0.0:  # that it finds nothing here does not mean that it has done its work
            return found
        begun = self._page.read()[1]
        until = math.inf if seconds is None else self.monotonic() + seconds
        if found:  # its work is not done: it stays as late as it is
            self._promise(getattr(self._mine, "until_s", self.monotonic() - self._page.read()[1]))
            return found
        self._promise(until - begun)
        while True:
            left_s = until - self.monotonic()
            found = look(None if left_s == math.inf else self._on_the_wall(left_s))
            if found or left_s <= 0.0:
                self._promise(self.monotonic() - begun)
                return found

    def _on_the_wall(self, left_s: float) -> float:
        return min(max(left_s / self._page.pace, _SHORTEST_S), _LOOK_S)

    def _promise(self, until_s: float) -> None:
        slot = getattr(self._mine, "slot", None)
        if slot is None:
            slot = self._mine.slot = self._page.claim()
            self._mine.looks = 0
        self._mine.looks += 1
        self._mine.until_s = until_s
        self._page.promise(slot, self._mine.looks, until_s)

    def sleep(self, seconds: float) -> None:
        begun, start = self._page.read()[1], self.monotonic()
        until = start + max(seconds, 0.0)
        promised: float | None = getattr(self._mine, "until_s", None)
        if promised is not None:
            self._promise(until - begun)
        while (left_s := until - self.monotonic()) > 0.0:
            _sleep(self._on_the_wall(left_s))
        if promised is not None:  # as late after it as before
            self._promise(promised + self.monotonic() - start)

    def select(self, read: Any, write: Any, wrong: Any, timeout: float | None = None) -> Any:
        nothing: tuple[list[Any], list[Any], list[Any]] = ([], [], [])

        def look(left_s: float | None) -> Any:
            found = _select(read, write, wrong, left_s)
            return found if found != nothing else None

        return self.wait(look, timeout) or nothing


class _Poll:
    """`select.poll` in simulated time."""

    _follower: _Follower

    def __init__(self) -> None:
        self._poll = _poll()
        self.register, self.modify, self.unregister = self._poll.register, self._poll.modify, self._poll.unregister

    def poll(self, timeout: float | None = None) -> list[tuple[int, int]]:
        def look(left_s: float | None) -> list[tuple[int, int]]:
            return self._poll.poll(None if left_s is None else math.ceil(left_s * 1000.0))

        seconds = None if timeout is None or timeout < 0 else timeout / 1000.0
        found: list[tuple[int, int]] = self._follower.wait(look, seconds)
        return found


def follow(page: Page) -> None:
    """From now on the clocks of this process are those of the page. To be called before what uses them is imported."""
    follower = _Follower(page)
    time.monotonic = follower.monotonic
    time.time = follower.utc
    time.sleep = follower.sleep  # type: ignore[assignment]
    select.select = follower.select
    select.poll = type("poll", (_Poll,), {"_follower": follower})  # type: ignore[assignment, misc]


def in_sim_time(page: Path, argv: Sequence[str]) -> tuple[str, ...]:
    """The command line of a program of our Python, run with the clocks of a page.

    What stands before Python stays. A program of another Python goes by the wall clock.
    """
    if sys.executable not in argv:
        return tuple(argv)
    place = argv.index(sys.executable)
    return (*argv[: place + 1], "-m", "sitl.sim_time", str(page), *argv[place + 1 :])


def main(argv: Sequence[str]) -> None:
    """`PAGE -m MODULE ...` or `PAGE SCRIPT ...`."""
    follow(Page(Path(argv[0])))
    if argv[1] == "-m":
        sys.argv = list(argv[2:])
        runpy.run_module(argv[2], run_name="__main__", alter_sys=True)
    else:
        sys.argv = list(argv[1:])
        sys.path[0] = str(Path(argv[1]).parent)
        runpy.run_path(argv[1], run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1:])

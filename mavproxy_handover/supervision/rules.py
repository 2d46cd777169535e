# SPDX-License-Identifier: GPL-3.0-or-later

"""When the companion's process counts as dead or stalled, and what follows. Pure: time is an argument.

Theory of operation
-------------------
A process is in one of four states, by the last sign that it gave (`watchdog_pipe.py`), and each has its patience:

    STARTING   no sign yet: it loads                      start_s
    LIVE       its main loop goes round                   silent_s, less than half of what the guard allows
    LOOSE      the module is unloaded, MAVProxy goes on   for ever: an operator did that
    ENDING     somebody wants it to end                   end_s

Out of patience it is killed. What follows an end depends on the state it came in:

* an end in ENDING is the end; so is one before the first sign of life that there ever was, on the ground: a
  configuration that cannot be used does not get better by trying;
* an exit code of FAILED_LOADS in STARTING is a failed load: the process says itself that it cannot start, and has
  judged nothing. The load is tried again after a pause that grows from `failed_s` to `failed_most_s`. It is no restart.
  A first start in flight that finds another companion running gives up: a second one is not wanted;
* any other end is a death, and the process is started again: at once, but after a pause where it died before it lived;
* the third restart within `window_s` sends no more leases, nor does any after it: nobody commands, the guard brings the
  aircraft home, and authority waits for somebody to start all of it anew. A judge that keeps dying is none. Failed
  loads do not hide that: the time that they take is no part of the window.

Time in which the supervisor itself did not run is no silence of the process: it is pardoned.
"""

from __future__ import annotations

import signal
from collections import deque
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

from mavproxy_handover.watchdog_pipe import BEAT, ENDING, LET_GO, Told

__all__ = ["LOCKED", "REFUSED", "Limits", "Next", "State", "Watch"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Times in seconds."""

    start_s: float = 10.0
    silent_s: float = 1.2
    end_s: float = 1.9
    #: restarts in this time count together
    window_s: float = 60.0
    #: so many of them still send leases
    trusted: int = 2
    #: before a start after one that failed: the first time, and at most
    failed_s: float = 0.3
    failed_most_s: float = 1.0
    #: between starts that send no leases
    hopeless_s: float = 5.0


class State(Enum):
    """Of the process, by its last sign."""

    STARTING = "starting"
    LIVE = "live"
    LOOSE = "loose"
    ENDING = "ending"


#: exit codes of a process that says that it cannot start: MAVProxy's own, that of bad input, and that of one that finds
#: another companion of this vehicle running
REFUSED, LOCKED = 2, 75
FAILED_LOADS: Final = (1, REFUSED, LOCKED)
#: a first start that finds another companion running tries so often: the one before it may be about to be gone
_LOCK_TRIES: Final = 3
_BY_SIGN: Final = {BEAT[0]: State.LIVE, LET_GO[0]: State.LOOSE, ENDING[0]: State.ENDING}


@dataclass(frozen=True, slots=True)
class Next:
    """What follows an end: `told` is for the process that is started at `at`; None: the end, with `code`."""

    told: Told | None = None
    at: float = 0.0
    code: int = 0


class Watch:
    """What the supervisor knows. Times are monotonic seconds."""

    def __init__(self, limits: Limits, *, in_flight: bool = False) -> None:
        """`in_flight`: the first process starts in flight, where a start that fails is tried again."""
        self._limits = limits
        self.state = State.STARTING
        self._in_flight = in_flight
        #: when the present process was started
        self._started_at = 0.0
        #: loads that failed since a process lived, the pause after the last one, and why the process before them ended
        self._failed = 0
        self._pause_s = 0.0
        self._died = ""
        #: since when the patience of the present state runs
        self._since = 0.0
        #: some process has lived
        self.lived = False
        self._trusted = True
        self._restarts: deque[float] = deque()
        self._patience = {
            State.STARTING: limits.start_s,
            State.LIVE: limits.silent_s,
            State.LOOSE: inf,
            State.ENDING: limits.end_s,
        }

    def started(self, now: float) -> None:
        """A process was started."""
        self.state, self._since, self._started_at = State.STARTING, now, now

    def heard(self, signs: bytes, now: float) -> None:
        """It gave signs. An end that has begun is not taken back."""
        for sign in signs:
            state = _BY_SIGN.get(sign)
            if state is None or self.state is State.ENDING:
                continue
            self.state, self._since = state, now
            if state is State.LIVE:
                self.lived, self._failed, self._pause_s = True, 0, 0.0

    def asked_to_end(self, now: float) -> None:
        """Somebody wants the whole of it to end."""
        if self.state is not State.ENDING:
            self.state, self._since = State.ENDING, now

    def pardon(self, seconds: float) -> None:
        """The supervisor itself stood still so long."""
        self._since += seconds

    def due(self) -> float:
        """When patience is at its end; inf: never."""
        return self._since + self._patience[self.state]

    def ended(self, code: int, now: float) -> Next:
        """The process has ended. `code`: exit code, or the negative number of the signal that ended it."""
        if self.state is State.ENDING or not (self.lived or self._in_flight):
            return Next(code=_passed_on(code))
        if self.state is State.STARTING and code in FAILED_LOADS and now < self.due():
            return self._failed_load(code, now)
        limits, why = self._limits, self._why(code, now)
        while self._restarts and now - self._restarts[0] >= limits.window_s:
            self._restarts.popleft()
        self._restarts.append(now)
        self._died = why
        pause_s = limits.failed_s if self.state is State.STARTING else 0.0
        if not self._trusted:
            pause_s = limits.hopeless_s
        self._trusted = self._trusted and len(self._restarts) <= limits.trusted
        return Next(Told(why, self._trusted), now + pause_s)

    def _failed_load(self, code: int, now: float) -> Next:
        """What follows a start of which the process itself says that it cannot be."""
        limits = self._limits
        self._failed += 1
        if code == LOCKED and not self.lived and self._failed >= _LOCK_TRIES:
            return Next(code=_passed_on(code))
        self._pause_s = min(max(limits.failed_s, 2.0 * self._pause_s), limits.failed_most_s)
        pause_s = self._pause_s if self._trusted else limits.hopeless_s
        # in this time no judge could have died
        lost_s = now - self._started_at + pause_s
        self._restarts = deque(at + lost_s for at in self._restarts)
        before = self._died or "it was started in flight"
        why = f"{before}; failed loads since then: {self._failed}, the last one ended with {code}"
        return Next(Told(why, self._trusted), now + pause_s)

    def _why(self, code: int, now: float) -> str:
        if now >= self.due():
            what = "it had not started after" if self.state is State.STARTING else "its main loop stood still for"
            return f"{what} {now - self._since:.1f} s"
        return f"it was killed by {_signal(-code)}" if code < 0 else f"it ended with {code}"


def _passed_on(code: int) -> int:
    """The exit code of all of it."""
    if code == LOCKED:
        return REFUSED
    return code if code >= 0 else 128 - code


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # a real-time signal
        return f"signal {number}"

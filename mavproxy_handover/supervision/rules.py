# SPDX-License-Identifier: GPL-3.0-or-later

"""Rules for a dead or stalled companion process, and for what follows. Pure: time is an argument.

Theory of operation
-------------------
The last signal of a process (`watchdog_pipe.py`) gives its state. Each state has a time-out:

    STARTING   no signal yet: it loads                      start_s
    LIVE       its main loop runs                           silent_s, less than half of what the guard allows
    LOOSE      the module is unloaded, MAVProxy goes on     never: an operator did that
    ENDING     the process is to end                        end_s

After the time-out it is killed. The consequence of an end depends on the state:

* an end in ENDING is final. An end on the ground before the first sign of life of any process is final too, because
  trying again does not repair a configuration;
* an exit code of FAILED_LOADS in STARTING is a failed load: the process reports that it cannot start, and has judged
  nothing. The load is tried again after a pause that grows from `failed_s` to `failed_most_s`. It does not count as a
  restart. A first start in flight that finds another companion running gives up, because there must be only one;
* any other end is a death. The process is started again at once, or after a pause if it died before its first sign of
  life;
* from the third restart within `window_s` on, no leases are sent. Then no station commands, the guard brings the
  aircraft home, and there is no authority until an operator starts everything again. A judge that keeps dying cannot be
  trusted. Failed loads do not hide that: their time is not part of the window.

If the supervisor itself did not run for a time, that time does not count as silence of the process.
"""

from __future__ import annotations

import signal
from collections import deque
from dataclasses import dataclass
from enum import Enum
from math import inf
from typing import Final

from mavproxy_handover.supervision.watchdog_pipe import BEAT, ENDING, LET_GO, Told

__all__ = ["LOCKED", "REFUSED", "Limits", "Next", "State", "Watch"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Times in seconds."""

    start_s: float = 10.0
    silent_s: float = 1.2
    end_s: float = 1.9
    #: restarts in this time count together
    window_s: float = 60.0
    #: number of restarts within it that still send leases
    trusted: int = 2
    #: pause before a start after a failed one: the first, and the longest
    failed_s: float = 0.3
    failed_most_s: float = 1.0
    #: pause between starts that send no leases
    hopeless_s: float = 5.0


class State(Enum):
    """State of the process, by its last signal."""

    STARTING = "starting"
    LIVE = "live"
    LOOSE = "loose"
    ENDING = "ending"


#: exit codes of a process that cannot start: MAVProxy's own, that of bad input, and that for another running companion
#: of this vehicle
REFUSED, LOCKED = 2, 75
FAILED_LOADS: Final = (1, REFUSED, LOCKED)
#: attempts of a first start that finds another companion running, which may be about to end
_LOCK_TRIES: Final = 3
_BY_SIGN: Final = {BEAT[0]: State.LIVE, LET_GO[0]: State.LOOSE, ENDING[0]: State.ENDING}


@dataclass(frozen=True, slots=True)
class Next:
    """Consequence of an end. `told`: for the process that is started at `at`. None: the end, with `code`."""

    told: Told | None = None
    at: float = 0.0
    code: int = 0


class Watch:
    """Watches the process by its signals. Times are monotonic seconds."""

    def __init__(self, limits: Limits, *, in_flight: bool = False) -> None:
        """`in_flight`: the first process starts in flight, so a failed start is tried again."""
        self._limits = limits
        self.state = State.STARTING
        self._in_flight = in_flight
        #: time at which the current process was started
        self._started_at = 0.0
        #: failed loads since a process lived, the pause after the last one, and the reason of the end before them
        self._failed = 0
        self._pause_s = 0.0
        self._died = ""
        #: start of the time-out of the current state
        self._since = 0.0
        #: True once some process has lived
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
        """Record the start of a process."""
        self.state, self._since, self._started_at = State.STARTING, now, now

    def handle_signals(self, signs: bytes, now: float) -> None:
        """Handle signals of the process. ENDING is never left."""
        for sign in signs:
            state = _BY_SIGN.get(sign)
            if state is None or self.state is State.ENDING:
                continue
            self.state, self._since = state, now
            if state is State.LIVE:
                self.lived, self._failed, self._pause_s = True, 0, 0.0

    def asked_to_end(self, now: float) -> None:
        """Record that all processes are to end."""
        if self.state is not State.ENDING:
            self.state, self._since = State.ENDING, now

    def pardon(self, seconds: float) -> None:
        """Add to the time-out, because the supervisor itself did not run for this time."""
        self._since += seconds

    def due(self) -> float:
        """End of the time-out; inf: never."""
        return self._since + self._patience[self.state]

    def ended(self, code: int, now: float) -> Next:
        """Handle the end of the process. `code`: exit code, or negative number of the signal that ended it."""
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
        """Consequence of a start that the process itself reports as failed."""
        limits = self._limits
        self._failed += 1
        if code == LOCKED and not self.lived and self._failed >= _LOCK_TRIES:
            return Next(code=_passed_on(code))
        self._pause_s = min(max(limits.failed_s, 2.0 * self._pause_s), limits.failed_most_s)
        pause_s = self._pause_s if self._trusted else limits.hopeless_s
        # no judge could have died in this time
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
    """The exit code of the supervisor."""
    if code == LOCKED:
        return REFUSED
    return code if code >= 0 else 128 - code


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # a real-time signal
        return f"signal {number}"

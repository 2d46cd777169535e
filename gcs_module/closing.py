# SPDX-License-Identifier: GPL-3.0-or-later

"""The end of a station that commands aircraft in flight.

The station releases them. The vehicle then hands each to a station that is ready and whose zone holds it. If there is
none, the vehicle tells all other stations, and gives control to the first that asks. This station ends as soon as it
commands no aircraft any more, and after WAIT_S at the latest. An aircraft that no station has taken has lost its
commander then.

The releases come before the lines about them, and a fault in one step stops no other: often the terminal is gone.

The thread that ends the program waits; the main loop does the rest. Times are monotonic seconds.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from math import inf
from typing import Final, Protocol

from gcs_module.commands import StationCommands
from gcs_module.core import StationCore
from gcs_module.vehicle_state import VehicleState

__all__ = ["WAIT_S", "Closing", "Flown"]

#: longest time (s) for a station to take the aircraft
WAIT_S: Final = 10.0
#: a main loop that stands still keeps nothing from ending: this much longer (s) is waited for it
_STALLED_S: Final = 2.0
#: pieces of that wait
_PIECES: Final = 120


class Flown(Protocol):
    """One aircraft of the station, as far as closing needs it."""

    core: StationCore
    state: VehicleState
    commands: StationCommands


class Closing:
    """`tell`: a line for the operator and the journal."""

    def __init__(self, aircraft: Sequence[Flown], tell: Callable[[str], None]) -> None:
        self._aircraft = aircraft
        self._tell = tell
        self._asked = threading.Event()
        self._done = threading.Event()
        self._until = inf
        self._then: Callable[[], None] | None = None
        self._offered: list[Flown] = []

    @property
    def flown(self) -> str:
        """Names of the aircraft in flight that this station commands; "" if there is none."""
        return _names(each for each in self._aircraft if each.state.flown_from_here)

    def ask(self, then: Callable[[], None]) -> None:
        """Release what is flown from here. `then` is called by the main loop when that is over."""
        self._then = then
        self._asked.set()

    def wait(self) -> None:
        """The same for another thread: returns when that is over, or if the main loop does not get to it.

        It waits in short pieces. A signal that comes just before a wait begins does not interrupt it.
        """
        self._asked.set()
        for _ in range(_PIECES):
            if self._done.wait((WAIT_S + _STALLED_S) / _PIECES):
                return

    def tick(self, now: float) -> None:
        """To be called often by the main loop."""
        if not self._asked.is_set() or self._done.is_set():
            return
        if self._until == inf:
            self._begin(now)
        left = [each for each in self._offered if each.state.flown_from_here]
        if not any(each.core.vehicle_alive(now) for each in left) or now >= self._until:
            self._end([each for each in self._offered if each.state.flown_from_here or each.core.commander is None])

    def _begin(self, now: float) -> None:
        self._until = now + WAIT_S
        self._offered = [each for each in self._aircraft if each.state.flown_from_here]
        jobs: list[Callable[[], None]] = []
        for each in self._offered:
            release = partial(each.commands.run, ["release"])
            # without our companion a release is asked for twice, and tells all others
            jobs += [release, release] if each.core.control.in_use else [release]
        if self._offered:
            offer = f"This station ends, and offers {_names(self._offered)} to the other stations"
            jobs.append(partial(self._tell, f"{offer}, for at most {WAIT_S:.0f} s."))
        _run_all(jobs)

    def _end(self, left: Sequence[Flown]) -> None:
        lost = "It loses its commander now, and acts by itself."
        jobs: list[Callable[[], None]] = [
            partial(self._tell, f"No station has taken {each.core.vehicle_name}. {lost}") for each in left
        ]
        _run_all([*jobs, self._done.set, *([] if self._then is None else [self._then])])


def _run_all(jobs: Iterable[Callable[[], None]]) -> None:
    """Run every job, also after one that fails; then raise the first fault. A terminal that is gone is such a fault."""
    faults = []
    for job in jobs:
        try:
            job()
        except Exception as fault:
            faults.append(fault)
    if faults:
        raise faults[0]


def _names(aircraft: Iterable[Flown]) -> str:
    return " and ".join(each.core.vehicle_name for each in aircraft)

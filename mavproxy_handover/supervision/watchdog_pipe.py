# SPDX-License-Identifier: GPL-3.0-or-later

"""The pipe from the companion to the supervisor that started it (`supervision/`).

The supervisor gives the facts of a start (`Told`). Then the companion sends signals, one byte each. Signs of life come
from MAVProxy's main loop, as the lease does, and never from a thread. So they prove that the judge runs. Without a
supervisor (`module load handover` in a stock MAVProxy) there is no watchdog pipe.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import Final

__all__ = ["BEAT", "ENDING", "LET_GO", "WatchdogPipe", "Refusal", "Told", "hold", "watchdog_pipe"]

#: signals: the main loop runs; it will run without us (the module is unloaded); the process was told to end
BEAT, LET_GO, ENDING = b".", b"-", b"e"
#: least time (s) between two signs of life: one for every second tick
_BEAT_S: Final = 0.08


@dataclass(frozen=True, slots=True)
class Told:
    """Facts of a start. `why`: how the process before this one ended, "" at the first start."""

    why: str = ""
    #: False: it has died too often, so no station may command until an operator starts it again
    leases: bool = True


class Refusal(Enum):
    """Reasons for which a module is not loaded."""

    #: a fault of this machine: a file, a link, a device
    MACHINE = "machine"
    #: another companion of this vehicle runs
    LOCKED = "locked"
    #: an internal fault
    FAULT = "fault"


class WatchdogPipe:
    """The companion's end of the pipe. Nothing here raises or waits. Times are monotonic seconds."""

    def __init__(self, descriptor: int, told: Told) -> None:
        """`descriptor`: the pipe to the supervisor, which closes with the process."""
        self.told = told
        #: True once the main loop has run with the module loaded
        self.lived = False
        #: why the module was not loaded, if it was not
        self.refused: Refusal | None = None
        self._descriptor = descriptor
        self._beat_at = 0.0
        os.set_blocking(descriptor, False)

    def beat(self, now: float) -> None:
        """Send a sign of life. Call it in every tick."""
        if now >= self._beat_at:
            self._beat_at = now + _BEAT_S
            self.lived = True
            self._sign(BEAT)

    def let_go(self) -> None:
        """Report that the module is unloaded while MAVProxy goes on: silence has no meaning from now on."""
        self._sign(LET_GO)

    def ending(self) -> None:
        """Report that the process was told to end."""
        self._sign(ENDING)

    def _sign(self, sign: bytes) -> None:
        with suppress(OSError):  # full: the supervisor is stopped; broken: it is dead, and this process will be
            os.write(self._descriptor, sign)


_held: list[WatchdogPipe] = []


def hold(line: WatchdogPipe | None) -> None:
    """Set the watchdog pipe of this process; None: it has none."""
    _held[:] = [] if line is None else [line]


def watchdog_pipe() -> WatchdogPipe | None:
    """The watchdog pipe of this process; None without a supervisor."""
    return _held[0] if _held else None

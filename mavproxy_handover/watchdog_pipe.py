# SPDX-License-Identifier: GPL-3.0-or-later

"""What ties the companion to the supervisor that started it (`supervision/`): what it was told at its start, and the
signs that it gives from then on, one byte each, through a pipe.

The signs of life come from MAVProxy's main loop, as the lease does, and never from a thread: what they prove is that
the judge goes round. Without a supervisor (`module load handover` in a stock MAVProxy) there is no lifeline.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import Final

__all__ = ["BEAT", "ENDING", "LET_GO", "Lifeline", "Refusal", "Told", "hold", "lifeline"]

#: the main loop goes round; it will go round without us (the module is unloaded); an end that somebody wants has begun
BEAT, LET_GO, ENDING = b".", b"-", b"e"
#: the pause between two signs of life is no shorter: they come in every second tick
_BEAT_S: Final = 0.08


@dataclass(frozen=True, slots=True)
class Told:
    """What a start is about. `why`: what became of the process before this one, "" at the first start."""

    why: str = ""
    #: False: it has died too often, so nobody may command until somebody has looked
    leases: bool = True


class Refusal(Enum):
    """What keeps a module from being loaded."""

    #: something on this machine: a file, a link, a device
    MACHINE = "machine"
    #: another companion of this vehicle runs
    LOCKED = "locked"
    #: an internal fault
    FAULT = "fault"


class Lifeline:
    """The companion's end. Nothing here raises or waits. Times are monotonic seconds."""

    def __init__(self, descriptor: int, told: Told) -> None:
        """`descriptor`: the pipe to the supervisor, which is closed with the process."""
        self.told = told
        #: the main loop has gone round with the module in it
        self.lived = False
        #: what kept the module from being loaded, if something did
        self.refused: Refusal | None = None
        #: closes what must be closed when the process cannot be ended otherwise
        self.at_the_end: Callable[[], None] = lambda: None
        self._descriptor = descriptor
        self._beat_at = 0.0
        os.set_blocking(descriptor, False)

    def beat(self, now: float) -> None:
        """The main loop goes round; to be called in every tick."""
        if now >= self._beat_at:
            self._beat_at = now + _BEAT_S
            self.lived = True
            self._sign(BEAT)

    def let_go(self) -> None:
        """The module is unloaded while MAVProxy goes on: from now on silence means nothing."""
        self._sign(LET_GO)

    def ending(self) -> None:
        """An end has begun that is no death."""
        self._sign(ENDING)

    def _sign(self, sign: bytes) -> None:
        with suppress(OSError):  # full: the supervisor is stopped; broken: it is dead, and we are about to be
            os.write(self._descriptor, sign)


_held: list[Lifeline] = []


def hold(line: Lifeline | None) -> None:
    """From now on this is the process's lifeline; None: it has none."""
    _held[:] = [] if line is None else [line]


def lifeline() -> Lifeline | None:
    """This process's lifeline; None if nobody supervises it."""
    return _held[0] if _held else None

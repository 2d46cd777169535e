# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults of a flight, their times, and what operators do about them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from mavproxy_handover.core.common.model import Phase

__all__ = ["Fault", "Insists", "TimedFault", "Target"]


class Fault(Enum):
    """A fault. Its effect is in `fault_injection.py`."""

    DEAD = "its program dies, and comes back knowing nothing"
    DEAF = "it hears nothing of the vehicle"
    MUTE = "the vehicle hears nothing of it"
    THIN = "it hears a part of what the vehicle says, and is heard"
    RHYTHM = "it hears the vehicle for a while, then not, again and again, and is heard"
    BURST = "nothing gets through, either way"
    WEAK = "a third of the messages of its link is lost"
    ATTACK = "an attacker commands in its name, with bad signatures"
    ROGUE = "stations that do not command send the aircraft elsewhere"
    KILLED = "the companion dies, and starts again from its state"
    GONE = "the companion dies, and does not come back"
    STALLED = "the companion's main loop stands still"
    BLIND = "the cable between companion and autopilot is cut"
    NO_GUARD = "the guard is silent: its script was stopped"
    NO_FIX = "no position any more"
    SAG = "a part of the battery's energy is gone"
    DRIFT = "wind carries the aircraft off its route"
    BREACH = "wind carries the aircraft out of its fence"
    GUST = "a head wind holds the aircraft up"
    LIFT = "an updraft carries the aircraft over the ceiling of its fence"
    PILOT = "a pilot takes the aircraft, and gives it back"
    DISOBEYS = "the autopilot does nothing of what the companion orders"
    STUCK = "a return gets no nearer to its place"


class Target(Enum):
    """Whom of the stations a fault strikes."""

    COMMANDER = "the commander"
    NEXT = "the next station on the route"
    ALL = "all stations"
    NOBODY = "no station"


class Insists(Enum):
    """The operator's next act after a refusal."""

    NO = "leaves it at that"
    ANEW = "sends it again in time"
    LIFTS = "lifts the limit that was named"


@dataclass(frozen=True, slots=True)
class TimedFault:
    """A fault and its time.

    `after` counts ticks from take-off, from the `nth` time that `phase` begins, or (`border`) from the first time that
    the aircraft is about to leave the zone of its commander; (`bare`) from that and every other time. `late`: all that
    counts only after the flight is ripe (`plan.py`). `lasts`: ticks; `amount`: how much of it, where that has a
    meaning.
    """

    fault: Fault
    after: int
    lasts: int
    target: Target = Target.NOBODY
    phase: Phase | None = None
    nth: int = 1
    amount: float = 0.0
    border: bool = False
    bare: bool = False
    late: bool = False
    #: of RHYTHM: for how many ticks it hears, and for how many not
    rhythm: tuple[int, int] = (0, 0)

    @property
    def words(self) -> str:
        """For people."""
        struck = "" if self.target is Target.NOBODY else f" ({self.target.value})"
        return f"{self.fault.name.lower().replace('_', ' ')}{struck}: {self.fault.value}"

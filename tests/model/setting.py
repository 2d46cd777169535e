# SPDX-License-Identifier: GPL-3.0-or-later

"""What an exploration is about: how many stations, where the aircraft flies, what may go wrong and how often."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import StandingConsent

__all__ = ["FAULTS", "IMPATIENT", "LIMITS", "LUCKY", "PARENT", "Fault", "Request", "Setting"]

PARENT = 251


class Fault(Enum):
    """What can go wrong. Each time costs one of the faults that a schedule may have."""

    LOSE = "a message is lost"
    DOUBLE = "a message arrives twice, the copy at any later time"
    HOLD = "a message is held back: it arrives at any later time, or never"
    RESTART_STATION = "a station's program restarts at once and knows nothing"
    KILL_STATION = "a station dies; it may come back, knowing nothing"
    RESTART_VEHICLE = "the companion restarts at once from its state file"
    KILL_VEHICLE = "the companion dies; it may come back from its state file"
    BLANK_VEHICLE = "the companion restarts and its state file is lost"
    CUT = "a link is cut in one direction; it may heal"
    DEAF = "a station hears nothing of the vehicle, and is heard; it may hear again"
    WEAK = "the links of a station are over a limit; they may become good again"
    SHORT = "no more energy is left than the way to the best place needs"
    LIE = "a station says a word of the present transfer that may not be its to say"


#: what is explored by default
FAULTS = frozenset(Fault) - {Fault.BLANK_VEHICLE, Fault.DEAF, Fault.WEAK, Fault.SHORT, Fault.LIE}


class Request(Enum):
    """What an operator may ask for on his own."""

    CONTROL = "asks for control"
    ALLOW = "asks for control and allows takeover"
    RELEASE = "releases control"
    GIVE = "gives control to another station"
    CANCEL = "cancels the transfer"
    WISH = "asks at the own station for control, and the vehicle accepts that"
    REFUSED = "asks at the own station for control, and the vehicle refuses that"


#: The limits of flight, where retransmission is once a tick; the long ones are shortened, and keep their order.
LIMITS = Limits(
    recovery_s=2.0,
    deaf_lost_s=5.0,
    deaf_back_s=2.0,
    retry_first_s=1.0,
    retry_growth=1.0,
    retry_max_s=1.0,
    operator_timeout_s=6.0,
    denied_pause_s=3.0,
    result_timeout_s=3.0,
    dwell_s=3.0,
    link_weak_s=2.0,
    link_steady_s=4.0,
    hold_s=3.0,
)

#: One answer in five bars a station still, two do not: with one question a tick that is as fine as it gets.
LUCKY = replace(LIMITS, deaf_share=0.25, deaf_back_share=0.5)

#: A step has two tries: where only messages go wrong, two faults are enough for a step to fail.
IMPATIENT = replace(LIMITS, step_timeout_s=2.0)


@dataclass(frozen=True, slots=True)
class Setting:
    """What is explored.

    A position is written as the letters of the stations whose zones hold the aircraft; a small letter: that zone is
    about to end along the track, and behind its border are the zones of the next position. "=" before them: the mission
    declares a gap there. "?" behind one: that station awaits the aircraft at a waypoint.
    """

    name: str
    stations: int = 2
    #: the aircraft's path, begun at its first position with GCSA in command; "_A": on the ground there
    path: tuple[str, ...] = ("A", "AB")
    #: how many faults a schedule may have, and of which kinds
    faults: int = 2
    kinds: frozenset[Fault] = FAULTS
    #: stations whose operator is asked
    operators: str = ""
    #: those of them that are asked about a forced handover as well
    forced: str = ""
    #: stations that speak the MAVLink standard only, and what the vehicle's file answers for them
    standard: str = ""
    consent: StandingConsent | None = None
    #: how many requests the operators may make in all, and which
    requests: int = 0
    wishes: frozenset[Request] = frozenset()
    limits: Limits = LIMITS
    #: no further than this many steps; None: until nothing is new
    depth: int | None = None
    #: a deep exploration ends when so many states are known, in two minutes at most; `--states` changes that
    states: int = 40_000

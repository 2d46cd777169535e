# SPDX-License-Identifier: GPL-3.0-or-later

"""The terms of the system as types: phases, lease states, reasons, zones, missions, and the view for the gate.

Values that travel (phases, lease states, consents, reasons) have the numbers of `wire/handover.xml`;
`tests/wire/test_dialect.py` compares the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import Final

__all__ = [
    "AUTOMATIC",
    "NO_MISSION",
    "NO_MATTER_ON_GROUND",
    "PROTOCOL_VERSION",
    "QUESTIONS",
    "RANKS",
    "UNASKED",
    "AuthorityView",
    "BorderFact",
    "Consent",
    "FlightAction",
    "ModeClass",
    "GapFact",
    "GuardState",
    "ModeSource",
    "LeaseState",
    "Mission",
    "Outcome",
    "Phase",
    "Reason",
    "StandingConsent",
    "Station",
    "ZoneFact",
    "in_words",
    "journal_in_words",
]

#: Version of the messages of `wire/handover.xml`; stations of another version are not handed authority.
PROTOCOL_VERSION = 1


class Phase(IntEnum):
    """Phase of the flight: the three states of the thesis (section 4.3), and the emergency."""

    ON_LOAD = 0  #: on the ground: waiting for parent, mission package and START
    ON_MISSION = 1  #: flying under one commander
    ON_HANDOVER = 2  #: a transfer is under way; the commander still commands
    EMERGENCY = 3  #: the aircraft is being brought home


class LeaseState(IntEnum):
    """State of authority, as the companion tells it to the guard."""

    HELD = 1  #: a commander holds authority
    TRANSFER = 2  #: held, and a transfer is under way
    LOST = 3  #: no station holds authority
    RECOVERING = 4  #: the companion restarted and has not yet heard the commander of its state file
    ALONE = 5  #: no station holds authority, and the aircraft flies on through a gap that the mission declares


class GuardState(IntEnum):
    """State of the guard, by its own message (`HANDOVER_GUARD`)."""

    DISABLED = 0
    WAITING = 1
    LIVE = 2
    EXPIRED = 3
    LOST = 4
    SILENT = 255


class FlightAction(IntEnum):
    """Actions against a fault, the mildest first."""

    WARN = 0
    TRANSFER = 1  #: a station is about to get authority: the aircraft flies on and waits for it
    HOLD = 2  #: stop inside usable coverage and wait
    CONTINUE = 3  #: fly on through a gap that the mission declares
    RETURN = 4  #: to the return site
    LAND = 5  #: here and now


class ModeClass(Enum):
    """Class of a flight mode: what the mode does, whatever its name."""

    HANDS = "by hand"
    MISSION = "the mission"
    GUIDED = "to a place that is named"
    STOP = "stands still, or circles where it is"
    RETURN = "to the return site"
    LAND = "down to the ground"
    OTHER = "something else"


class ModeSource(Enum):
    """Source of a flight mode: the person or program that chose it."""

    NOBODY = "no source in flight"
    COMPANION = "the companion"
    COMMANDER = "the commander"
    GUARD = "the guard"
    FAILSAFE = "a failsafe of the autopilot"
    MISSION = "the mission, at its end"
    PILOT = "the pilot"
    STRANGER = "an unknown source"
    DOUBT = "in doubt"


class Consent(IntEnum):
    """A station's answer to the question of a transfer."""

    GRANTED = 0
    DENIED = 1
    WAITING = 2  #: its operator has been asked


class Outcome(IntEnum):
    """How a transfer ended."""

    COMMITTED = 0
    ABORTED = 1


class Reason(IntEnum):
    """Why authority moved, did not move, or was lost."""

    NONE = 0
    ZONE = 1  #: the aircraft entered the next station's zone
    OPERATOR = 2  #: an operator's word
    PARENT_CONNECTED = 3  #: the parent station took up its vehicle on the ground
    RELEASE_TIMEOUT = 4  #: the commander consented, then fell silent; the partner had confirmed
    COMMANDER_LOST = 5
    COMMANDER_RETURNED = 6
    PARTNER_SILENT = 7
    PARTNER_REFUSED = 8
    COMMANDER_SILENT = 9
    COMMANDER_DENIED = 10
    LEFT_REGION = 11  #: the aircraft left the partner's zone before the commit
    CANCELLED = 12
    OUT_OF_COVERAGE = 13  #: the aircraft is outside every zone
    AUTOPILOT_LOST = 14  #: no heartbeat of the autopilot
    POSITION_STALE = 15
    GUARD_LOST = 16
    LANDED = 17  #: disarmed: the flight is over
    STARTED = 18
    FAULT = 19  #: an internal fault; no station is granted anything
    MISSION_DIFFERS = 20  #: the partner holds another mission package
    VERSION_DIFFERS = 21
    NOT_READY = 22  #: START refused: something on the list of needs is missing
    RESTARTED = 23  #: the companion restarted and waits for its commander
    LINK_QUALITY = 24  #: the commander's links are over their limits, the partner's are not
    AUTHENTICATION = 25  #: bad signatures at a rate that is no accident
    REQUESTED = 26  #: another station's operator asks for control
    GIVEN = 27  #: the commander's operator gives control away
    ZONE_ENDS = 28  #: the commander's zone has ended or is about to, another still holds the aircraft
    PREEMPTED = 29  #: a transfer for a graver reason took its place
    NO_STATION = 30  #: inside zones, and no station of theirs could take the aircraft
    COVERAGE_ENDS = 31  #: the border of the last zone that counts is ahead
    ENERGY = 32  #: no more energy than the way to a place needs, with the reserve
    OFF_ROUTE = 33
    FENCE = 34
    PARTNER_UNANSWERED = 35  #: the partner's operator was asked and did not answer
    COMMANDER_UNANSWERED = 36  #: the commander's operator was asked and did not answer
    CANNOT_BE_ASKED = 37  #: the commander's program did not show that it can ask its operator
    CONSENT_REFUSED = 38  #: the vehicle's configuration refuses handovers of this station
    MISSION_MISSING = 39  #: the partner holds no mission package
    UNMANNED = 40  #: no operator has signed on at the partner


#: Why a transfer is begun, the least grave reason first, each with its rank: a graver one takes the place of a lesser
#: one under way.
RANKS: Final = {
    reason: rank
    for rank, reason in enumerate(
        (
            Reason.REQUESTED,
            Reason.ZONE,
            Reason.GIVEN,
            Reason.LINK_QUALITY,
            Reason.ZONE_ENDS,
            Reason.COMMANDER_LOST,
        )
    )
}


#: What a station is asked about by a transfer, in the word that its configuration has for it.
QUESTIONS: Final = {
    Reason.ZONE: "zone",
    Reason.ZONE_ENDS: "zone",
    Reason.LINK_QUALITY: "link",
    Reason.REQUESTED: "request",
    Reason.GIVEN: "give",
    Reason.COMMANDER_LOST: "forced",
}


#: Those of them that need no operator, unless a station's configuration says otherwise. A request or a gift of another
#: operator is for an operator to answer.
AUTOMATIC: Final = ("zone", "link", "forced")
#: What needs no operator even if `consent` asks the operator about everything: a forced handover asks no station.
UNASKED: Final = ("forced",)


#: Reasons against a partner in flight that do not prevent command on the ground: the station may bring another mission
#: later, and nothing is handed over.
NO_MATTER_ON_GROUND: Final = (
    Reason.MISSION_DIFFERS,
    Reason.MISSION_MISSING,
    Reason.CONSENT_REFUSED,
    Reason.UNMANNED,
)

#: Reasons whose name does not say to people what it means.
_WORDS: Final = {
    Reason.PARTNER_REFUSED: "the partner's operator denied",
    Reason.COMMANDER_DENIED: "the commander's operator denied",
    Reason.PARTNER_UNANSWERED: "the partner's operator did not answer",
    Reason.COMMANDER_UNANSWERED: "the commander's operator did not answer",
    Reason.CANNOT_BE_ASKED: "the commander's program cannot ask its operator",
}


def in_words(reason: Reason) -> str:
    """For people: "commander lost"."""
    return _WORDS.get(reason) or reason.name.lower().replace("_", " ")


def journal_in_words(reason: str) -> str:
    """The words for a reason of the journal, "commander_lost". An unknown reason stays as it is."""
    known = Reason.__members__.get(reason.upper())
    return reason.replace("_", " ") if known is None else in_words(known)


class StandingConsent(Enum):
    """Answer of the vehicle's file for a station that cannot be asked."""

    AUTOMATIC = "automatic"  #: planned handovers from it and to it need no answer
    REFUSE = "refuse"  #: it is never partner, and no planned handover takes the aircraft from it


@dataclass(frozen=True, slots=True)
class Station:
    """A ground station known to the vehicle. `sysid` is its MAVLink system id (1..255).

    `standard`: it runs no module of ours and speaks the operator-control protocol of the MAVLink standard only.
    `consent`: what is answered for it in a planned handover. None: its operator is asked, if the handover needs consent
    (`AUTOMATIC` has those that need none). A standard station is asked only as commander; as partner it counts as
    ready.
    """

    sysid: int
    name: str
    standard: bool = False
    consent: StandingConsent | None = None


@dataclass(frozen=True, slots=True)
class AuthorityView:
    """All that the gate needs to judge a frame. Immutable: swapped whole at every change of authority.

    `commander`: system id of the station whose commands pass; None: no commands pass. `partner` is set during a
    transfer. `armed`: the autopilot has not said that it is disarmed, or a rehearsal is under way. Everything that is
    locked while armed stays locked that long.
    """

    phase: Phase = Phase.ON_LOAD
    commander: int | None = None
    partner: int | None = None
    epoch: int = 0
    lease: LeaseState = LeaseState.LOST
    armed: bool = False
    handover_id: int = 0
    #: a request for control is granted without asking the commander
    takeover_allowed: bool = False
    #: the reason of the transfer under way; NONE without one
    why: Reason = Reason.NONE
    #: the border that it was begun for, if that was foreseen (`core/authority/foresight.py`), else 0
    crossing: int = 0
    #: the aircraft is carried along its route (`core/authority/rehearsal.py`): nothing arms, and nothing is commanded
    rehearsal: bool = False


@dataclass(frozen=True, slots=True)
class ZoneFact:
    """Where the aircraft is with respect to one station's zone: a fact, not geometry.

    The zone finder (`mission/zones.py`) makes one for each station of a position; hysteresis, dwell and every decision
    belong to the rules.
    """

    #: system id of the station
    station: int
    #: geodesic distance to the border of its zone in metres, > 0 inside, < 0 outside (far outside to 2 %)
    margin_m: float
    #: seconds until the present track at the present speed leaves the zone; None when it does not within the
    #: horizon, when the aircraft is slower than 0.5 m/s, and when it is outside
    exit_s: float | None
    #: the same on the way that it is known to fly, if one is; None when it stays in the zone for the next while
    ends_s: float | None = None
    #: system ids of the stations whose zones hold the place where it leaves then
    beyond: frozenset[int] = frozenset()
    #: the aircraft has to reach a waypoint of the station before the zone is a reason to move authority there; the zone
    #: still covers the aircraft
    awaits: bool = False


@dataclass(frozen=True, slots=True)
class BorderFact:
    """A place ahead on the mission's way where zones begin or end: a fact, not geometry (`mission/crossings.py`).

    `number`: which one on that way; `in_s`: how soon it is reached; `holding`: the stations whose zones hold the way
    after it.
    """

    number: int
    in_s: float
    holding: frozenset[int]


@dataclass(frozen=True, slots=True)
class GapFact:
    """The aircraft is where its mission declares a gap in coverage: a fact, not geometry (`mission/gaps.py`).

    `limit_s`: the longest time for the gap (s). `words`: from where to where, for people. `ahead`: the aircraft is on
    the way into it, a few seconds before the last zone ends.
    """

    limit_s: float
    words: str
    ahead: bool = False


@dataclass(frozen=True, slots=True)
class Mission:
    """The mission package and how far the aircraft has come.

    `digest`: its SHA-256, empty without one. `route`: the commanders that its planned track needs, in order.
    `at`: where on the route the present commander stands.
    """

    digest: bytes = b""
    route: tuple[int, ...] = ()
    at: int = 0

    @property
    def following(self) -> int | None:
        """The station that the route needs next; None at its end."""
        following = self.at + 1
        return self.route[following] if following < len(self.route) else None

    def advanced(self, station: int) -> Mission:
        """The same when this station commands; one that is not ahead on the route changes nothing."""
        if station not in self.route[self.at :]:
            return self
        return replace(self, at=self.route.index(station, self.at))


NO_MISSION = Mission()

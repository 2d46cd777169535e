# SPDX-License-Identifier: GPL-3.0-or-later

"""Events that the arbiter takes, and actions that it asks for.

The caller turns bytes and ticks into events, passes them to `Arbiter.handle`, and carries the actions out in their
order. Neither side knows more of the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from mavproxy_handover.core.common.handling import STANDS_STILL, Handling
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import (
    AuthorityView,
    BorderFact,
    FlightAction,
    GapFact,
    GuardState,
    ModeClass,
    ModeSource,
    Reason,
    ZoneFact,
)

__all__ = [
    "Action",
    "Advise",
    "AircraftJudged",
    "Announce",
    "AutopilotState",
    "BeginStart",
    "BordersSeen",
    "Cancel",
    "ControlAnswer",
    "ControlRequested",
    "ControlResult",
    "EnergyJudged",
    "Event",
    "Fly",
    "BoxJudged",
    "GapsJudged",
    "GuardSeen",
    "ModeSourceSeen",
    "LinkJudged",
    "MissionJudged",
    "MissionLoaded",
    "ModeSeen",
    "MotionSeen",
    "MotionUnseen",
    "NotifyOwner",
    "OperatorControlShown",
    "PlaceJudged",
    "PositionSeen",
    "Record",
    "RehearsalAsked",
    "RehearsalMoved",
    "RehearsalRefused",
    "HeightsJudged",
    "ReturnJudged",
    "Send",
    "ConditionsSeen",
    "StartFinished",
    "StartRefused",
    "StartRequested",
    "StationHeard",
    "StationMessage",
    "TakeOffPassed",
    "Tick",
    "ViewChanged",
]


# ---- events -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed: the arbiter does what is due."""


@dataclass(frozen=True, slots=True)
class StationHeard:
    """A heartbeat of a station came through its own link."""

    station: int


@dataclass(frozen=True, slots=True)
class StationMessage:
    """A transfer message of a station came through its own link."""

    station: int
    message: Message


@dataclass(frozen=True, slots=True)
class PositionSeen:
    """A fresh position of the aircraft, as facts about every zone. `gap`: the declared gap that the aircraft is in."""

    zones: tuple[ZoneFact, ...]
    gap: GapFact | None = None


@dataclass(frozen=True, slots=True)
class BordersSeen:
    """The zone borders on the mission's way ahead, the nearest first.

    Empty if the aircraft does not fly that way, or the way is not known. `route`: counts the missions that the
    autopilot has held.
    """

    borders: tuple[BorderFact, ...]
    route: int = 0


@dataclass(frozen=True, slots=True)
class AutopilotState:
    """A heartbeat of the autopilot. `flying`: off the ground as far as the autopilot knows.

    `foreign`: an aircraft that is not supported, in words; "": `handling` counts.
    An aircraft may hold by circling. To stay inside a zone it needs the order `circles_s` (s) before it would
    fly over a border, at a place that is `circle_m` (m) away from every border. Both are 0 if it stands still.
    """

    armed: bool
    flying: bool
    foreign: str = ""
    handling: Handling = STANDS_STILL
    circles_s: float = 0.0
    circle_m: float = 0.0


@dataclass(frozen=True, slots=True)
class ModeSeen:
    """The autopilot's flight mode: its class, None for an unsupported aircraft, and its name.

    `landing`: the aircraft is coming down to land, in any mode. `radio`: a pilot could steer, as far as the autopilot
    knows.
    """

    flown: ModeClass | None
    name: str = ""
    landing: bool = False
    radio: bool = False


@dataclass(frozen=True, slots=True)
class ModeSourceSeen:
    """A source has, or may have, chosen the flight mode. `flown`: the class of that mode; None: not known."""

    hand: ModeSource
    flown: ModeClass | None = None


@dataclass(frozen=True, slots=True)
class OrderRefused:
    """The autopilot has refused an order of the companion."""

    action: FlightAction


@dataclass(frozen=True, slots=True)
class MotionSeen:
    """Motion of the aircraft: speed over ground and climb (m/s), and the distance left to its destination (m).

    `left_m` None: not known.
    """

    speed_mps: float
    climb_mps: float
    left_m: float | None = None


@dataclass(frozen=True, slots=True)
class MotionUnseen:
    """The autopilot no longer reports the motion of the aircraft."""


@dataclass(frozen=True, slots=True)
class GuardSeen:
    """A status message of the guard. `ours`: it echoes the nonce of this companion's leases. `misfit`: why leases and
    guard do not fit, in words; "": they do.
    With the state SILENT it is a status that is not proven to be the guard's."""

    state: GuardState
    ours: bool
    misfit: str = ""


@dataclass(frozen=True, slots=True)
class EnergyJudged:
    """A lack of energy for the loaded mission, in words; "": none, or energy is not checked.

    It counts until the next one. On the ground it is judged each second, and when a mission is loaded.
    """

    shortfall: str


@dataclass(frozen=True, slots=True)
class GapsJudged:
    """A fault of the gaps of the loaded mission, in words; "": none, or no gaps. It counts until the next one."""

    lacking: str


@dataclass(frozen=True, slots=True)
class AircraftJudged:
    """A reason why this aircraft cannot fly the loaded mission, in words; "": none. It counts until the next one."""

    lacking: str


@dataclass(frozen=True, slots=True)
class BoxJudged:
    """A reason of the position box to refuse START, in words; "": none. It counts until the next one."""

    lacking: str


@dataclass(frozen=True, slots=True)
class HeightsJudged:
    """A reason why the mission would not be flown at the checked heights, in words; "": none.

    It counts until the next one.
    """

    lacking: str


@dataclass(frozen=True, slots=True)
class ReturnJudged:
    """A reason why a return would not end on the ground, in words; "": none. It counts until the next one."""

    lacking: str


@dataclass(frozen=True, slots=True)
class ConditionsSeen:
    """Conditions that the monitors find in flight. They count until the next event of this kind.

    They are three of `common/causes.py`: energy (no more than the return site needs), route and fence. The words have
    the figures.
    """

    energy: bool = False
    off_route: bool = False
    fence: bool = False
    energy_words: str = ""
    off_route_words: str = ""
    fence_words: str = ""


@dataclass(frozen=True, slots=True)
class PlaceJudged:
    """The return site of now, by name, and whether the energy left reaches it. It counts until the next one.

    `words`: figures for people, as in "1.9 km away, covered by GCSA all the way".
    """

    name: str
    reachable: bool
    words: str = ""


@dataclass(frozen=True, slots=True)
class MissionLoaded:
    """The mission package was written to the autopilot, read back and found equal.

    `route` is the order in which its planned track needs commanders, `out_of_coverage` the mission's own policy, None
    if it has none. An empty digest: what the autopilot holds is not a known mission any more.
    """

    digest: bytes
    route: tuple[int, ...]
    out_of_coverage: str | None = None


@dataclass(frozen=True, slots=True)
class MissionJudged:
    """The reason why no mission is loaded, in words; "": none is known."""

    lacking: str


@dataclass(frozen=True, slots=True)
class StartRequested:
    """A station sent MAV_CMD_MISSION_START on the ground."""

    station: int


@dataclass(frozen=True, slots=True)
class RehearsalAsked:
    """A station asks for a rehearsal on the ground to begin, or to end."""

    station: int
    begin: bool


@dataclass(frozen=True, slots=True)
class TakeOffPassed:
    """A command of the commander that arms or takes off goes to the autopilot: it has all that START needs."""

    station: int


@dataclass(frozen=True, slots=True)
class StartFinished:
    """The START sequence is over; `text` says what stopped it."""

    ok: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class Cancel:
    """An operator cancels the transfer."""

    station: int


@dataclass(frozen=True, slots=True)
class ControlRequested:
    """MAV_CMD_REQUEST_OPERATOR_CONTROL of a station (2026 layout).

    `request` False releases. `takeover`: later requests may be granted without asking the sender. `timeout_s`: how long
    the owner has to answer. `for_station`: the station that shall have control; the sender itself, or, from the
    commander, the one it gives to.
    """

    station: int
    request: bool
    takeover: bool
    timeout_s: float
    for_station: int


@dataclass(frozen=True, slots=True)
class OperatorControlShown:
    """The program of a station has shown that it knows operator control.

    It has sent a well-formed request, or has accepted a request that asks its operator.
    """

    station: int


@dataclass(frozen=True, slots=True)
class LinkJudged:
    """A measurement on a station's links went over a limit, or came back.

    `weak`: every link of the station is over a limit of loss, round trip or silence. `attacked`: frames with bad
    signatures arrive at a rate that is no accident. `text`: the measurement, for people.
    """

    station: int
    weak: bool
    attacked: bool
    text: str


Event = (
    Tick
    | StationHeard
    | StationMessage
    | PositionSeen
    | BordersSeen
    | AutopilotState
    | ModeSeen
    | ModeSourceSeen
    | OrderRefused
    | MotionSeen
    | MotionUnseen
    | GuardSeen
    | EnergyJudged
    | BoxJudged
    | GapsJudged
    | AircraftJudged
    | HeightsJudged
    | ReturnJudged
    | ConditionsSeen
    | PlaceJudged
    | MissionJudged
    | MissionLoaded
    | StartRequested
    | RehearsalAsked
    | TakeOffPassed
    | StartFinished
    | Cancel
    | ControlRequested
    | OperatorControlShown
    | LinkJudged
)


# ---- actions ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Send:
    """Send a transfer message to a station, on all its links."""

    station: int
    message: Message
    attempt: int = 1


@dataclass(frozen=True, slots=True)
class ViewChanged:
    """Authority, phase or epoch changed: the gate judges by this view from here on, and all are told.

    The caller also closes transactions that a former commander left open at the autopilot.
    """

    view: AuthorityView
    reason: Reason


@dataclass(frozen=True, slots=True)
class Fly:
    """Command the autopilot to do this."""

    action: FlightAction
    reason: Reason


@dataclass(frozen=True, slots=True)
class Announce:
    """Tell every operator and every program what is done about what is wrong, in one sentence.

    `action`: what is in force from now on, None if nothing is. `figures`: what is wrong; `place`: where a return goes.
    """

    text: str
    action: FlightAction | None
    reason: Reason
    figures: str = ""
    place: str = ""


@dataclass(frozen=True, slots=True)
class Advise:
    """Tell the operators of these stations of a fault that they can mend, in one text."""

    stations: tuple[int, ...]
    text: str


@dataclass(frozen=True, slots=True)
class BeginStart:
    """Every need is met: arm in GUIDED, then fly the mission in AUTO."""

    station: int


@dataclass(frozen=True, slots=True)
class StartRefused:
    """Answer the station's START with a refusal; `needs` are the unmet ones, in words."""

    station: int
    needs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RehearsalMoved:
    """A rehearsal has begun, or is over: tell every station, in these words. The view says so already."""

    on: bool
    text: str
    reason: Reason


@dataclass(frozen=True, slots=True)
class RehearsalRefused:
    """Tell the station that no rehearsal begins, or ends, by its word; `needs`: what that lacks, in words."""

    station: int
    begin: bool
    needs: tuple[str, ...]


class ControlResult(IntEnum):
    """Answer to a request of operator control, numbered as MAV_RESULT."""

    ACCEPTED = 0
    DENIED = 2
    PENDING = 4  #: MAV_RESULT_FAILED, which the standard uses for "the owner is being asked"


@dataclass(frozen=True, slots=True)
class ControlAnswer:
    """Answer a station's request of operator control; `text` says why it was denied."""

    station: int
    result: ControlResult
    text: str = ""


@dataclass(frozen=True, slots=True)
class NotifyOwner:
    """Ask the commander, by the standard's command, whether `requester` may have control."""

    station: int
    requester: int
    timeout_s: float


@dataclass(frozen=True, slots=True)
class Record:
    """An entry for the journal. `event` is a fixed lower-case word, `text` the sentence for people."""

    event: str
    text: str
    reason: Reason = Reason.NONE
    station: int | None = None
    duration_s: float | None = None


Action = (
    Send
    | ViewChanged
    | Fly
    | Announce
    | Advise
    | BeginStart
    | StartRefused
    | RehearsalMoved
    | RehearsalRefused
    | ControlAnswer
    | NotifyOwner
    | Record
)

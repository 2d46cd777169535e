# SPDX-License-Identifier: GPL-3.0-or-later

"""The events and actions of the station's rules (`core`). Pure, as `core` is."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

from gcs_module.alarms import EVENTS, Level
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import Phase, Reason

__all__ = [
    "AcknowledgeManager",
    "Action",
    "Answer",
    "AskManager",
    "AuthorityHeard",
    "AutopilotHeard",
    "ControlAsked",
    "ControlStatusHeard",
    "Event",
    "FromPeer",
    "FromVehicle",
    "MissionHeld",
    "Notice",
    "PeerHeard",
    "ToPeer",
    "ToVehicle",
    "VehicleHeard",
    "Wish",
    "WishAnswered",
]


# ---- events -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FromVehicle:
    """A message of the vehicle's companion."""

    message: Message


@dataclass(frozen=True, slots=True)
class FromPeer:
    """A message of another station, over the ground link."""

    peer: int
    message: Message


@dataclass(frozen=True, slots=True)
class PeerHeard:
    """A heartbeat of another station, over the ground link."""

    peer: int


@dataclass(frozen=True, slots=True)
class VehicleHeard:
    """A heartbeat of the vehicle's companion."""


@dataclass(frozen=True, slots=True)
class AuthorityHeard:
    """AUTHORITY_STATUS. `handover_id`: of the transfer under way if there is a partner, else of the last one."""

    phase: Phase
    commander: int | None
    partner: int | None
    epoch: int
    handover_id: int = 0
    #: no station commands yet, and one may do so in this epoch
    recovering: bool = False
    #: the reason of the transfer under way
    why: Reason = Reason.NONE
    #: the station whose zone holds the aircraft, the commander's first; None: the zone of no station
    zone: int | None = None
    #: time (s) until the known route leaves the commander's zone; inf: no end is in sight
    zone_ends_s: float = inf
    #: no station commands, because the mission declares a gap there
    alone: bool = False
    #: the time left (s) for an operator who is asked; inf: none is asked
    answer_left_s: float = inf
    #: the number of the border of the transfer under way, if the vehicle foresaw it; else 0
    crossing: int = 0


@dataclass(frozen=True, slots=True)
class ControlStatusHeard:
    """CONTROL_STATUS of a component of the vehicle. `main`: the station in control, None: no station is."""

    component: int
    manager: bool
    takeover: bool
    main: int | None


@dataclass(frozen=True, slots=True)
class ControlAsked:
    """A component of the vehicle passes on another station's request for control, by the standard's command."""

    component: int
    requester: int
    timeout_s: float


@dataclass(frozen=True, slots=True)
class AutopilotHeard:
    """A heartbeat of the autopilot."""

    armed: bool


@dataclass(frozen=True, slots=True)
class MissionHeld:
    """The station holds this mission package (SHA-256)."""

    digest: bytes


@dataclass(frozen=True, slots=True)
class Answer:
    """The operator's answer to the open question."""

    yes: bool


@dataclass(frozen=True, slots=True)
class Wish:
    """The operator asks that `station` commands: a transfer to it needs no further question here. `timeout_s`: the time
    that the present commander has to answer."""

    station: int
    timeout_s: float = 30.0


@dataclass(frozen=True, slots=True)
class WishAnswered:
    """The vehicle's answer to that request. Not `accepted`: it was refused, or there was no answer. `pending`: the
    present commander is asked."""

    station: int
    accepted: bool
    pending: bool = False


Event = (
    FromVehicle
    | FromPeer
    | PeerHeard
    | VehicleHeard
    | AuthorityHeard
    | ControlStatusHeard
    | ControlAsked
    | AutopilotHeard
    | MissionHeld
    | Answer
    | Wish
    | WishAnswered
)


# ---- actions ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ToVehicle:
    """Send to the vehicle's companion."""

    message: Message


@dataclass(frozen=True, slots=True)
class ToPeer:
    """Send to another station over the ground link."""

    peer: int
    message: Message


@dataclass(frozen=True, slots=True)
class AskManager:
    """Send MAV_CMD_REQUEST_OPERATOR_CONTROL to the manager of the standard, for this station. `word`: its name for the
    operator; `request`: False releases control; `takeover`: later requests are granted without a question."""

    word: str
    request: bool
    takeover: bool = False
    timeout_s: float = 0.0


@dataclass(frozen=True, slots=True)
class AcknowledgeManager:
    """Acknowledge a request that this component of the vehicle has passed on."""

    component: int


@dataclass(frozen=True, slots=True)
class Notice:
    """A line for the operator and the journal. `event`: a key of `alarms.EVENTS`, which gives its level; `level`
    overrides that. `row`: its row of `notices.NOTICES`, "" if the line is not from that table."""

    event: str
    text: str
    level: Level | None = None
    row: str = field(default="", compare=False)

    @property
    def gravity(self) -> Level:
        """The level of the line."""
        return EVENTS[self.event] if self.level is None else self.level


Action = ToVehicle | ToPeer | AskManager | AcknowledgeManager | Notice

# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station's rules are told, and what they ask for: the events and actions of `core`. Pure, as `core` is."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from gcs_module.alarms import EVENTS, Level
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import Phase, Reason

__all__ = [
    "Action",
    "Answer",
    "AuthorityHeard",
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
    #: nobody commands yet, and one may, in this very epoch
    recovering: bool = False
    #: why the transfer under way was begun
    why: Reason = Reason.NONE
    #: whose zone holds the aircraft, the commander's first; None: nobody's
    zone: int | None = None
    #: how soon the known way leaves the commander's zone (s); inf: no end in sight
    zone_ends_s: float = inf
    #: nobody commands because the mission declares a gap there
    alone: bool = False
    #: what is left for an operator who is asked (s); inf: nobody is
    answer_left_s: float = inf
    #: for which border the transfer under way was begun, if that was foreseen; else 0
    crossing: int = 0


@dataclass(frozen=True, slots=True)
class MissionHeld:
    """The station holds this mission package (SHA-256)."""

    digest: bytes


@dataclass(frozen=True, slots=True)
class Answer:
    """The operator's answer to the question that is open."""

    yes: bool


@dataclass(frozen=True, slots=True)
class Wish:
    """The operator asked that this station shall command: a transfer to it needs no further question here."""

    station: int


@dataclass(frozen=True, slots=True)
class WishAnswered:
    """The vehicle has answered that request; not `accepted`: it was refused, or there was no answer."""

    station: int
    accepted: bool


Event = FromVehicle | FromPeer | PeerHeard | VehicleHeard | AuthorityHeard | MissionHeld | Answer | Wish | WishAnswered


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
class Notice:
    """A line for the operator and the journal. `event` is a fixed lower-case word of `alarms.EVENTS`, which says how
    grave it is; `level` says so where the word alone does not."""

    event: str
    text: str
    level: Level | None = None

    @property
    def gravity(self) -> Level:
        """How grave it is."""
        return EVENTS[self.event] if self.level is None else self.level


Action = ToVehicle | ToPeer | Notice

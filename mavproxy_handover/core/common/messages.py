# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages of `wire/handover.xml` as the rules see them; `wire/codec.py` turns them into bytes and back.

Every transfer message carries the commander (`from_station`), the partner (`to_station`), the number of the transfer
and the epoch in which it runs. The event that brings a message names its sender.
"""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.core.common.model import Consent, Outcome, Reason

__all__ = [
    "EPOCH_MAX",
    "Connect",
    "ConnectAck",
    "ConnectHandover",
    "CrossingKey",
    "DisconnectHandover",
    "DroneConnected",
    "HandoverAhead",
    "HandoverRequest",
    "HandoverResult",
    "Message",
    "OkAhead",
    "OkHandover",
    "OnHandover",
    "TransferKey",
    "TransferMessage",
]

#: An epoch above this one is no memory of any flight (it travels in 32 bits). The vehicle learns none from a station. A
#: station that holds one believes the vehicle's next word that is not above it.
EPOCH_MAX = 0x7FFF_FFFF


@dataclass(frozen=True, slots=True)
class Connect:
    """Question whether the station is there and agrees. The answer is `ConnectAck` with the same nonce."""

    station: int
    protocol_version: int
    nonce: int
    epoch: int
    commander: int | None
    name: str
    mission_digest: bytes  #: SHA-256, or empty where the sender has no mission package


@dataclass(frozen=True, slots=True)
class ConnectAck:
    """Answer to `Connect`; with nonce 0, sent unasked to acknowledge a `HandoverResult` by state."""

    station: int
    protocol_version: int
    nonce: int
    epoch: int
    commander: int | None
    name: str
    mission_digest: bytes
    accepted: bool = True
    #: an operator has signed on, or the station needs none
    manned: bool = True
    #: the operator on duty, for journals; "": none has signed on
    operator: str = ""


@dataclass(frozen=True, slots=True)
class TransferKey:
    """Key of one transfer. A message with another key than the present one changes nothing."""

    from_station: int
    to_station: int
    handover_id: int
    epoch: int

    def before(self, other: TransferKey) -> bool:
        """Whether this transfer began before `other`. Within an epoch the number decides, which wraps."""
        if self.epoch != other.epoch:
            return self.epoch < other.epoch
        return 0 < (other.handover_id - self.handover_id) % 0x10000 < 0x8000


@dataclass(frozen=True, slots=True)
class CrossingKey:
    """Key of a border ahead at which a transfer is expected: its number counts within the epoch."""

    from_station: int
    to_station: int
    crossing: int
    epoch: int


@dataclass(frozen=True, slots=True)
class HandoverAhead:
    """Before step 1, vehicle to partner and commander: in `in_s` seconds you will be asked; you may answer now.

    `commander`, `partner`: what they have answered so far, None: nothing. Nothing moves by it.
    """

    key: CrossingKey
    in_s: float
    commander: Consent | None = None
    partner: Consent | None = None


@dataclass(frozen=True, slots=True)
class OkAhead:
    """Partner or commander to vehicle: what it will answer there, as things are."""

    key: CrossingKey
    consent: Consent = Consent.GRANTED


@dataclass(frozen=True, slots=True)
class HandoverRequest:
    """Step 1, vehicle to partner: will you take the aircraft? `crossing`: at which border; 0: at none foreseen."""

    key: TransferKey
    reason: Reason = Reason.NONE
    crossing: int = 0


@dataclass(frozen=True, slots=True)
class OnHandover:
    """Step 2, partner to commander with a copy to the vehicle. `relay`: the sender has no ground link; `crossing`: as
    in `HandoverRequest`, where it is passed on by the vehicle."""

    key: TransferKey
    consent: Consent = Consent.GRANTED
    reason: Reason = Reason.NONE
    relay: bool = False
    relayed: bool = False
    crossing: int = 0


@dataclass(frozen=True, slots=True)
class OkHandover:
    """Step 3, commander to vehicle: consent."""

    key: TransferKey
    consent: Consent = Consent.GRANTED
    reason: Reason = Reason.NONE


@dataclass(frozen=True, slots=True)
class ConnectHandover:
    """Step 4, vehicle to partner: set yourself up as commander."""

    key: TransferKey


@dataclass(frozen=True, slots=True)
class DroneConnected:
    """Step 5, partner to commander and to vehicle: done."""

    key: TransferKey
    relay: bool = False
    relayed: bool = False


@dataclass(frozen=True, slots=True)
class DisconnectHandover:
    """Step 6, commander to vehicle: released. The vehicle commits here."""

    key: TransferKey


@dataclass(frozen=True, slots=True)
class HandoverResult:
    """Step 7, vehicle to both. `key.epoch` is the epoch now in force."""

    key: TransferKey
    commander: int | None
    outcome: Outcome
    reason: Reason


#: the steps of a transfer: what carries a `TransferKey`
TransferMessage = (
    HandoverRequest | OnHandover | OkHandover | ConnectHandover | DroneConnected | DisconnectHandover | HandoverResult
)
Message = Connect | ConnectAck | HandoverAhead | OkAhead | TransferMessage

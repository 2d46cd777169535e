# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages between companion and guard, inside TUNNEL messages.

Every ArduPilot firmware knows TUNNEL, so the autopilot's signing protects it and firmware 4.5 delivers it to Lua. No
field is wider than 32 bits: Lua on the flight controller has 32-bit integers. Layouts: docs/architecture.md.

Version 2 added `guard_nonce`. Version 1 is still read, because recordings contain it and an older guard sends it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import GuardState, LeaseState
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, LEASE_TUNNEL, TUNNEL_BYTES
from mavproxy_handover.wire.lease_tag import TAG_BYTES, lease_tag

__all__ = [
    "LEASE_VERSION",
    "GuardStatus",
    "Lease",
    "guard_status_version",
    "pack_lease",
    "unpack_guard_status",
    "unpack_lease",
]

#: version of both layouts
LEASE_VERSION: Final = 2
_LEASE = struct.Struct("<BBBBIIIHHI")
_STATUS = struct.Struct("<BBBBIIIHBBI")
#: version -> bytes; a later version appends its fields
_LEASE_BYTES: Final = {1: 20, 2: 24}
_STATUS_BYTES: Final = {1: 20, 2: 24}
_FLAG_TAGGED, _FLAG_TWO_GUARDS = 1, 2
_FLAG_ENFORCING, _FLAG_ARMED, _FLAG_FLYING, _FLAG_TAMPERED, _FLAG_FOREIGN, _FLAG_STATUS_TAGGED = 1, 2, 4, 8, 16, 32
_FLAG_SECOND = 64


@dataclass(frozen=True, slots=True)
class Lease:
    """One lease. `commander`: 0 = no station. `nonce`: random number of this run of the companion, never 0.

    `left_s`: how long the aircraft may still fly without a commander, in the state ALONE. `guard_nonce`: nonce of the
    guard that it is for; 0 asks the guard for it. `two_guards`: two guards are heard, so neither may permit arming.
    """

    state: LeaseState
    commander: int
    nonce: int
    sequence: int
    epoch: int
    ttl_ms: int
    left_s: int = 0
    guard_nonce: int = 0
    two_guards: bool = False


@dataclass(frozen=True, slots=True)
class GuardStatus:
    """The guard's status. Nonce, sequence and epoch are those of the last lease that it accepted.

    `guard_nonce`: its own nonce, which a lease must carry; 0 in version 1. `tagged`: a tag with its key follows.
    `second`: another guard has started before it on the same card.

    `enforcing`: it is acting on a loss of authority now. A guard that is switched off has the state DISABLED.
    `foreign`: it does not know the modes of this type of vehicle, and permits no arming.
    """

    state: GuardState
    action: int
    enforcing: bool
    armed: bool
    flying: bool
    tampered: bool
    foreign: bool
    nonce: int
    sequence: int
    epoch: int
    rejected: int
    firmware: tuple[int, int]
    guard_nonce: int = 0
    tagged: bool = False
    second: bool = False
    version: int = LEASE_VERSION


def pack_lease(lease: Lease, vehicle: int, key: bytes | None = None) -> mavlink.MAVLink_tunnel_message:
    """The TUNNEL message with `lease` for the autopilot of system `vehicle`; with a `key` it has a tag."""
    body = _LEASE.pack(
        LEASE_VERSION,
        lease.state,
        lease.commander,
        (0 if key is None else _FLAG_TAGGED) | (_FLAG_TWO_GUARDS if lease.two_guards else 0),
        lease.nonce,
        lease.sequence & 0xFFFFFFFF,
        lease.epoch,
        lease.ttl_ms,
        lease.left_s,
        lease.guard_nonce,
    )
    target = vehicle, AUTOPILOT_COMPID
    if key is not None:
        body += lease_tag(key, LEASE_TUNNEL, target, body)
    return mavlink.MAVLink_tunnel_message(*target, LEASE_TUNNEL, len(body), list(body.ljust(TUNNEL_BYTES, b"\0")))


def unpack_lease(payload: bytes) -> Lease | None:
    """The lease in a TUNNEL payload that is cut to its length, or None if it holds no lease.

    It may have a tag, which is not checked.
    """
    size = _LEASE_BYTES.get(payload[0]) if payload else None
    if size is None or len(payload) not in (size, size + TAG_BYTES):
        return None
    fields = _LEASE.unpack(payload[:size].ljust(_LEASE.size, b"\0"))
    _version, state, commander, flags, nonce, sequence, epoch, ttl_ms, left_s, guard_nonce = fields
    if bool(flags & _FLAG_TAGGED) != (len(payload) > size) or state not in LeaseState.__members__.values():
        return None
    two_guards = bool(flags & _FLAG_TWO_GUARDS)
    return Lease(LeaseState(state), commander, nonce, sequence, epoch, ttl_ms, left_s, guard_nonce, two_guards)


def guard_status_version(payload: bytes) -> int | None:
    """Version of a TUNNEL payload of the guard's type; None if it is empty."""
    return payload[0] if payload else None


def unpack_guard_status(payload: bytes) -> GuardStatus | None:
    """The guard's status in a TUNNEL payload that is cut to its length, or None if it holds none.

    Its tag is not checked.
    """
    size = _STATUS_BYTES.get(payload[0]) if payload else None
    if size is None or len(payload) not in (size, size + TAG_BYTES):
        return None
    fields = _STATUS.unpack(payload[:size].ljust(_STATUS.size, b"\0"))
    version, state, action, flags, nonce, sequence, epoch, rejected, major, minor, guard_nonce = fields
    tagged = bool(flags & _FLAG_STATUS_TAGGED)
    if tagged != (len(payload) > size) or state not in GuardState.__members__.values() or state == GuardState.SILENT:
        return None
    return GuardStatus(
        state=GuardState(state),
        action=action,
        enforcing=bool(flags & _FLAG_ENFORCING),
        armed=bool(flags & _FLAG_ARMED),
        flying=bool(flags & _FLAG_FLYING),
        tampered=bool(flags & _FLAG_TAMPERED),
        foreign=bool(flags & _FLAG_FOREIGN),
        nonce=nonce,
        sequence=sequence,
        epoch=epoch,
        rejected=rejected,
        firmware=(major, minor),
        guard_nonce=guard_nonce,
        tagged=tagged,
        second=bool(flags & _FLAG_SECOND),
        version=version,
    )

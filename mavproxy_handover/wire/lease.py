# SPDX-License-Identifier: GPL-3.0-or-later

"""What companion and guard tell each other inside TUNNEL messages.

TUNNEL is known to every ArduPilot firmware, so the autopilot's signing protects it and firmware 4.5 delivers it to Lua.
No field is wider than 32 bits: Lua on the flight controller has 32-bit integers. Layouts: docs/architecture.md.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.model import GuardState, LeaseState
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, LEASE_TUNNEL, TUNNEL_BYTES
from mavproxy_handover.wire.lease_tag import TAG_BYTES, lease_tag

__all__ = [
    "GuardStatus",
    "Lease",
    "pack_lease",
    "unpack_guard_status",
    "unpack_lease",
]

_VERSION = 1
_LEASE = struct.Struct("<BBBBIIIHH")
_STATUS = struct.Struct("<BBBBIIIHBB")
_FLAG_TAGGED = 1
_FLAG_ENFORCING, _FLAG_ARMED, _FLAG_FLYING, _FLAG_TAMPERED, _FLAG_FOREIGN = 1, 2, 4, 8, 16


@dataclass(frozen=True, slots=True)
class Lease:
    """One lease. `commander` 0 = nobody; `nonce` is drawn when the companion starts, never 0.

    `left_s`: how long the aircraft may still fly on alone, in the state ALONE.
    """

    state: LeaseState
    commander: int
    nonce: int
    sequence: int
    epoch: int
    ttl_ms: int
    left_s: int = 0


@dataclass(frozen=True, slots=True)
class GuardStatus:
    """What the guard says of itself; nonce, sequence and epoch are those of the last lease it accepted.

    `enforcing`: it is acting on a loss of authority now. A guard that is switched off has the state DISABLED.
    `foreign`: the vehicle is of a type whose modes it does not know; it lets nobody arm.
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


def pack_lease(lease: Lease, vehicle: int, key: bytes | None = None) -> mavlink.MAVLink_tunnel_message:
    """The TUNNEL message that carries `lease` to the autopilot of system `vehicle`; with a `key` it has a tag."""
    body = _LEASE.pack(
        _VERSION,
        lease.state,
        lease.commander,
        0 if key is None else _FLAG_TAGGED,
        lease.nonce,
        lease.sequence & 0xFFFFFFFF,
        lease.epoch,
        lease.ttl_ms,
        lease.left_s,
    )
    target = vehicle, AUTOPILOT_COMPID
    if key is not None:
        body += lease_tag(key, LEASE_TUNNEL, target, body)
    return mavlink.MAVLink_tunnel_message(*target, LEASE_TUNNEL, len(body), list(body.ljust(TUNNEL_BYTES, b"\0")))


def unpack_lease(payload: bytes) -> Lease | None:
    """The lease in a TUNNEL payload cut to its length, with a tag (not looked at) or without, or None if it is none."""
    if len(payload) not in (_LEASE.size, _LEASE.size + TAG_BYTES):
        return None
    version, state, commander, flags, nonce, sequence, epoch, ttl_ms, left_s = _LEASE.unpack_from(payload)
    if bool(flags & _FLAG_TAGGED) != (len(payload) > _LEASE.size):
        return None
    if version != _VERSION or state not in LeaseState.__members__.values():
        return None
    return Lease(LeaseState(state), commander, nonce, sequence, epoch, ttl_ms, left_s)


def unpack_guard_status(payload: bytes) -> GuardStatus | None:
    """The guard's status in a TUNNEL payload cut to its length, or None if it is none."""
    if len(payload) != _STATUS.size:
        return None
    version, state, action, flags, nonce, sequence, epoch, rejected, major, minor = _STATUS.unpack(payload)
    if version != _VERSION or state not in GuardState.__members__.values() or state == GuardState.SILENT:
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
    )

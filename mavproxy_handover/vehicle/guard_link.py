# SPDX-License-Identifier: GPL-3.0-or-later

"""The guards that answer on the autopilot's link, and the guard that the next lease is for.

A guard chooses a nonce when it starts and sends it in each status. A lease counts only with the nonce of the guard that
reads it, so a lease recorded before a restart of the guard is refused. This module keeps the nonce and says when a
lease must go out at once. It reports guards that do not fit: another version, another key, two guards on one card.

If this companion has a key, a status that does not prove the key is ignored. A recorded status proves the key, but it
does not echo one of the last leases. A guard that echoes one keeps its leases, even if other statuses are heard.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.wire.ids import COMPANION_COMPID, GUARD_STATUS_TUNNEL
from mavproxy_handover.wire.lease import (
    LEASE_VERSION,
    GuardStatus,
    guard_status_version,
    unpack_guard_status,
)
from mavproxy_handover.wire.lease_tag import TAG_BYTES, lease_tag
from mavproxy_handover.wire.status import LeaseSequence

__all__ = ["GuardLink", "misfit_of"]

#: a guard that was heard within this time (s) still runs
_RUNS_S: Final = 3.0
#: two guards were heard in turn within this time (s): both run
_TWO_S: Final = 10.0
#: after a new nonce the guard of the former one has spoken twice within this time (s), if it still runs
_DOUBT_S: Final = 1.2
#: a status that echoes one of this many last leases is not a recording (about 4 s of leases)
_LAST_LEASES: Final = 100
#: at most one lease in this time (s) is sent only because a status asked for it
_ANSWER_S: Final = 0.04

_OLDER: Final = "the guard is older than this companion: put the handover_guard.lua of this release on the card"
_NEWER: Final = "the guard is newer than this companion: install the same release on both"
_NO_KEY: Final = "the guard has no key: put handover.key on its card, beside the script"
_OTHER_KEY: Final = "the guard's status does not fit guard_key: its handover.key is another key, or a stranger sends it"
_KEYED: Final = "the guard has a key: set guard_key in the vehicle's configuration"
_TWO: Final = "two guards answer: remove one of the two scripts from the card"


def misfit_of(status: GuardStatus, *, keyed: bool) -> str:
    """Why a single status does not fit, in words; "" if it fits. `keyed`: this companion has a key."""
    if status.version < LEASE_VERSION:
        return _OLDER
    if status.second:
        return _TWO
    if status.tagged is not keyed:
        return _NO_KEY if keyed else _KEYED
    return ""


class GuardLink:
    """Collects the statuses of the guards. Times are monotonic seconds."""

    def __init__(self, vehicle: int, key: bytes | None, leases: LeaseSequence) -> None:
        """`vehicle`: its system id; `key`: of the tags, None without one; `leases`: of this companion."""
        self._target = vehicle, COMPANION_COMPID
        self._key = key
        self._leases = leases
        #: nonces of the guards -> when each was heard last, newest last; never more than two
        self._heard: dict[int, float] = {}
        #: the nonce of the guard that has echoed one of the last leases, and until when that counts
        self._fresh, self._fresh_until = 0, 0.0
        self._two_until = self._doubt_until = 0.0
        self._asked_at = -1.0
        self._misfit = ""
        self._misfit_until = 0.0
        #: a lease must go out at once
        self.asks = False

    def on_status(self, payload: bytes, now: float) -> GuardStatus | None:
        """A status arrived. Returns it if it is the guard's; None: another layout, or no proof of the key."""
        status = unpack_guard_status(payload)
        if status is None:
            version = guard_status_version(payload)
            if version is not None and version > LEASE_VERSION:
                self._note(_NEWER, now)
            return None
        if status.version < LEASE_VERSION:
            self._note(_OLDER, now)
            return status if self._key is None else None  # nothing in it proves the key
        if self._key is not None and not self._proven(payload, self._key):
            self._note(_OTHER_KEY if status.tagged else _NO_KEY, now)
            return None
        if self._key is None and status.tagged:
            self._note(_KEYED, now)
        self._hear(status, now)
        return status

    def problem(self, now: float) -> str:
        """Why guard and companion do not fit, in words; "" if nothing is known."""
        if self.two(now):
            return _TWO
        return self._misfit if now < self._misfit_until else ""

    def two(self, now: float) -> bool:
        """Whether two guards run."""
        return now < self._two_until

    def withholds(self, now: float) -> bool:
        """Whether no guard may permit arming: two guards run, or the first may still run after a new nonce."""
        return self.two(now) or now < self._doubt_until

    def addressed(self, now: float) -> tuple[int, ...]:
        """The nonces for the next leases, one lease each; (0,): no nonce is known, and the lease asks for it."""
        if not self._heard:
            return (0,)
        nonces = list(self._heard)
        if not self.two(now):
            del nonces[:-1]
        if now < self._fresh_until and self._fresh not in nonces:
            nonces.append(self._fresh)
        return tuple(nonces)

    def answered(self) -> None:
        """Leases have gone out."""
        self.asks = False

    def _note(self, misfit: str, now: float) -> None:
        self._misfit, self._misfit_until = misfit, now + _RUNS_S

    def _proven(self, payload: bytes, key: bytes) -> bool:
        body, tag = payload[:-TAG_BYTES], payload[-TAG_BYTES:]
        return tag == lease_tag(key, GUARD_STATUS_TUNNEL, self._target, body)

    def _hear(self, status: GuardStatus, now: float) -> None:
        nonce = status.guard_nonce
        newest = next(reversed(self._heard), None)
        if newest is not None and nonce == newest % 0xFFFFFFFF + 1:
            del self._heard[newest]  # the guard has gone on to the next nonce (`own.change` in the guard)
            self._fresh_until = 0.0
        elif newest is not None and nonce != newest and now - self._heard[newest] < _RUNS_S:
            self._doubt_until = now + _DOUBT_S
            if now - self._heard.get(nonce, -_RUNS_S) < _RUNS_S:
                self._two_until = now + _TWO_S  # the other guard was heard since, so this is not a restart
        if status.second:
            self._two_until = now + _TWO_S
        self._heard.pop(nonce, None)
        self._heard[nonce] = now
        while len(self._heard) > 2:
            del self._heard[next(iter(self._heard))]
        ours = status.nonce == self._leases.nonce
        if ours and (self._leases.sequence - status.sequence) & 0xFFFFFFFF < _LAST_LEASES:
            self._fresh, self._fresh_until = nonce, now + _RUNS_S
        if (nonce != newest or not ours) and now - self._asked_at >= _ANSWER_S:
            self.asks, self._asked_at = True, now

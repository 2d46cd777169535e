# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages of the companion itself: heartbeat, lease, AUTHORITY_STATUS, CONTROL_STATUS. They are built here,
not sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, inf
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Announce
from mavproxy_handover.core.common.model import AuthorityView, GuardState, LeaseState, Phase, Reason
from mavproxy_handover.wire.lease import Lease, pack_lease

__all__ = [
    "LEASE_INTERVAL_S",
    "LeaseSequence",
    "authority_status",
    "briefing",
    "control_status",
    "decision",
    "heartbeat",
    "rehearsal",
]

LEASE_INTERVAL_S = 0.2
_LEASE_TTL_MS = 3000
#: largest value of a field of 16 bits
_MOST_S = 0xFFFF
#: largest value of a field of 8 bits
_MOST_LEFT_S = 0xFF
#: a return takes less than this (s), and needs less than this part of the battery; else the status has no figure
_LONGEST_WAY_S, _MOST_NEEDED = 0xFFFE, 2.5
#: bytes of texts: a return site's name (here and in HANDOVER_DECISION), that message's figures and text, and a line of
#: HANDOVER_BRIEFING and HANDOVER_REHEARSAL
_PLACE_BYTES, _FIGURES_BYTES, _TEXT_BYTES, _LINE_BYTES = 20, 60, 160, 120
_MOST_LINES = 0xFF
_NO_ACTION = mavlink.HANDOVER_ACTION_NONE


class LeaseSequence:
    """Numbers the leases of one run of the companion. `nonce` is never 0; with a `key` each lease has a tag."""

    def __init__(self, nonce: int, key: bytes | None = None) -> None:
        self.nonce = nonce
        self._key = key
        self.sequence = 0

    def next(
        self,
        view: AuthorityView,
        vehicle: int,
        alone_s: float = 0.0,
        guard_nonce: int = 0,
        *,
        two_guards: bool = False,
    ) -> Any:
        """The next lease, as the TUNNEL message to the autopilot.

        `alone_s`: time left of a gap. `guard_nonce`: nonce of the guard that it is for, 0: not known. `two_guards`: two
        guards are heard.

        Seconds are rounded up, so that the guard is not the first to act at the end of the gap. In a rehearsal the
        lease has the state in which the guard permits no arming and commands nothing: authority that is being
        recovered. Without a commander it is LOST as always. In a gap it is LOST too, because no aircraft flies in a
        rehearsal.
        """
        state = view.lease
        if view.rehearsal:
            state = LeaseState.LOST if view.commander is None else LeaseState.RECOVERING
            alone_s = 0.0
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        left_s = min(ceil(max(0.0, alone_s)), _MOST_S)
        lease = Lease(
            state=state,
            commander=view.commander or 0,
            nonce=self.nonce,
            sequence=self.sequence,
            epoch=view.epoch,
            ttl_ms=_LEASE_TTL_MS,
            left_s=left_s,
            guard_nonce=guard_nonce,
            two_guards=two_guards,
        )
        return pack_lease(lease, vehicle, self._key)


def heartbeat(view: AuthorityView) -> Any:
    """The companion's own heartbeat, as an onboard computer and not a ground station."""
    status = mavlink.MAV_STATE_EMERGENCY if view.phase is Phase.EMERGENCY else mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, view.phase, status, 3
    )


def authority_status(
    view: AuthorityView,
    zone: int,
    guard: GuardState,
    reason: Reason,
    *,
    route_changed: bool = False,
    zone_ends_s: float = inf,
    answer_left_s: float = inf,
    place: tuple[str, float, float] | None = None,
    way: tuple[float, float | None] | None = None,
) -> Any:
    """AUTHORITY_STATUS of this dialect.

    `route_changed`: the flown mission is not that of the package any more. `zone_ends_s`: time until the commander's
    zone ends on the known route (s), inf: no end in sight. `answer_left_s`: time left for an operator to answer, inf:
    no question is open. `place`: name, latitude and longitude (degrees) of the return site, None: there is none yet.
    `way`: time (s) and part of the battery that a return from here needs, None: not known.
    """
    name, lat_deg, lon_deg = place or ("", 0.0, 0.0)
    takes_s, needs = way or (inf, None)
    return mavlink.MAVLink_authority_status_message(
        view.phase,
        view.commander or 0,
        view.partner or 0,
        zone,
        view.epoch,
        view.handover_id,
        view.lease,
        guard,
        reason,
        view.why,
        int(route_changed),
        _seconds(zone_ends_s),
        _seconds(answer_left_s),
        view.crossing,
        round(lat_deg * 1e7),
        round(lon_deg * 1e7),
        _cut(name, _PLACE_BYTES),
        int(view.rehearsal),
        1 + ceil(takes_s) if 0.0 <= takes_s < _LONGEST_WAY_S else 0,
        1 + round(100.0 * needs) if needs is not None and 0.0 <= needs < _MOST_NEEDED else 0,
    )


def control_status(view: AuthorityView) -> Any:
    """CONTROL_STATUS of the MAVLink standard, sent by the companion for the whole system."""
    flags = mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER
    if view.takeover_allowed:
        flags |= mavlink.GCS_CONTROL_STATUS_FLAGS_TAKEOVER_ALLOWED
    return mavlink.MAVLink_control_status_message(flags, view.commander or 0, [0] * 10)


def _seconds(left_s: float) -> int:
    """Seconds rounded up, in a byte; 0: none, or more than fit."""
    return 0 if left_s >= _MOST_LEFT_S else 1 + int(max(0.0, left_s))


def briefing(target: tuple[int, int], number: int, lines: Sequence[str]) -> list[Any]:
    """HANDOVER_BRIEFING of this dialect, one message for each line. `number` identifies the briefing."""
    return [
        mavlink.MAVLink_handover_briefing_message(*target, number, line, len(lines), _cut(text, _LINE_BYTES))
        for line, text in enumerate(lines, 1)
    ]


def rehearsal(
    target: tuple[int, int], vehicle: int, wish: int, nonce: int, accepted: bool, lines: Sequence[str] = ()
) -> list[Any]:
    """HANDOVER_REHEARSAL of this dialect: the answer to HANDOVER_REHEARSE, one message, or one for each line."""
    told = [(line, _cut(text, _LINE_BYTES)) for line, text in enumerate(lines[:_MOST_LINES], 1)] or [(0, b"")]
    count = min(len(lines), _MOST_LINES)
    return [
        mavlink.MAVLink_handover_rehearsal_message(*target, vehicle, wish, nonce, int(accepted), line, count, text)
        for line, text in told
    ]


def decision(told: Announce, number: int) -> Any:
    """HANDOVER_DECISION of this dialect. `number` identifies the decision."""
    return mavlink.MAVLink_handover_decision_message(
        number,
        _NO_ACTION if told.action is None else told.action,
        told.reason,
        _cut(told.place, _PLACE_BYTES),
        _cut(told.figures, _FIGURES_BYTES),
        _cut(told.text, _TEXT_BYTES),
    )


def _cut(text: str, most: int) -> bytes:
    """The text in at most `most` bytes, without a partial character."""
    return text.encode("utf-8")[:most].decode("utf-8", "ignore").encode("utf-8")

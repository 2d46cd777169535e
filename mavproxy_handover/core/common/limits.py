# SPDX-License-Identifier: GPL-3.0-or-later

"""The limits of the rules that the vehicle's file may set, each with its unit in its name.

`config/vehicle.py` has their ranges. A number that no file sets is a constant in the module of its rule, as TRIES in
`core/safety/command_verification.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mavproxy_handover.core.common.causes import Cause

__all__ = ["Limits"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Times in seconds, distances in metres."""

    #: a station whose heartbeat has been missing this long is lost
    heartbeat_lost_s: float = 5.0
    #: how long the commander of before may take to come back after a restart in flight; the guard returns after
    #: HNDO_LOST_T without a commander, and a forced transfer has to fit into the time that is left
    recovery_s: float = 2.5
    #: how often the vehicle asks each station whether it is there
    connect_interval_s: float = 1.0
    #: an answer to that older than this proves nothing
    connect_lost_s: float = 5.0
    #: a commander that is heard and does not answer for this time hears nothing of the aircraft: it is lost
    deaf_lost_s: float = 10.0
    #: a commander that answers less than this share of the questions is lost too; see `authority/hearing.py`
    deaf_share: float = 0.15
    #: a station counts again when it has answered this share or more for this time
    deaf_back_share: float = 0.3
    deaf_back_s: float = 12.0
    #: first retransmission of a transfer message, growth from one to the next, and the longest wait
    retry_first_s: float = 0.2
    retry_growth: float = 1.5
    retry_max_s: float = 1.0
    #: a step that takes longer ends the transfer; the commander stays
    step_timeout_s: float = 4.0
    #: the same when a station has said that its operator has been asked
    operator_timeout_s: float = 30.0
    #: commander consented, partner confirmed, release missing this long: the vehicle commits
    release_timeout_s: float = 2.0
    #: a forced transfer (there is no commander) that takes longer is given up
    forced_timeout_s: float = 2.0
    #: a partner of a forced transfer that takes longer is replaced by another one that is ready
    reserve_timeout_s: float = 0.8
    #: pause before a transfer that failed is tried again, and after an operator's denial
    retry_pause_s: float = 2.0
    denied_pause_s: float = 10.0
    #: how long HANDOVER_RESULT is repeated to a station that does not show the new epoch
    result_timeout_s: float = 10.0
    #: a zone is entered this far inside its border, and left this far outside
    enter_margin_m: float = 5.0
    leave_margin_m: float = 5.0
    #: no transfer for a zone's sake sooner than this after the last one, unless coverage ends
    dwell_s: float = 5.0
    #: the commander's zone ends within this time along the track: time to move
    exit_soon_s: float = 8.0
    #: the commander's links have been weak this long, a partner's good this long: reason enough to move
    link_weak_s: float = 3.0
    link_steady_s: float = 30.0
    #: the last coverage that counts ends this soon along the track: the aircraft is to stop
    hold_lead_s: float = 5.0
    #: a transfer that takes longer is no reason to fly over that border; a partner that takes longer to answer does not
    #: count as a station that could take the aircraft
    answer_s: float = 1.0
    #: the longest hold there
    hold_s: float = 60.0
    #: a mode that was commanded and does not show after this time is commanded again
    obey_s: float = 6.0
    #: a return that gets no nearer, or a landing that does not come down, fails after this time
    stuck_s: float = 30.0
    #: the policy of each cause, and how long its condition has to last and to be away, if not the values of the table
    policies: Mapping[Cause, str] = field(default_factory=dict)
    hold_off_s: Mapping[Cause, float] = field(default_factory=dict)
    clear_s: Mapping[Cause, float] = field(default_factory=dict)
    #: a rehearsal on the ground ends after this time without a commander
    rehearsal_lost_s: float = 300.0
    #: older position, autopilot heartbeat and guard status count as lost
    position_stale_s: float = 2.0
    autopilot_lost_s: float = 3.0
    guard_lost_s: float = 2.0
    #: False for vehicles without a guard
    guard_required: bool = True

# SPDX-License-Identifier: GPL-3.0-or-later

"""The phases of a vehicle, as a table.

Theory of operation
-------------------
ON_LOAD on the ground, ON_MISSION under one commander, ON_HANDOVER while a transfer runs, EMERGENCY while the aircraft
is being brought home. An emergency on the ground is a warning and no phase: there is no entry for it, so it changes
nothing. EMERGENCY ends when its causes are gone (the flight mode stays as it is: the commander decides what comes
next) or on the ground.

A rehearsal (`rehearsal.py`) goes through the same phases with an aircraft that is carried: it begins on the ground, and
leads back there from whatever phase it has come to.

PHASES is complete; a pair that is missing changes nothing.
"""

from __future__ import annotations

from enum import Enum

from mavproxy_handover.core.common.model import Phase

__all__ = ["PHASES", "PhaseCause"]


class PhaseCause(Enum):
    """Causes that can move the phase."""

    STARTED = "started"
    TRANSFER_BEGUN = "transfer begun"
    TRANSFER_ENDED = "transfer ended"
    EMERGENCY = "emergency"
    RECOVERED = "emergency over"
    DISARMED = "disarmed"
    REHEARSED = "rehearsal begun"
    REHEARSAL_OVER = "rehearsal over"


PHASES: dict[tuple[Phase, PhaseCause], Phase] = {
    (Phase.ON_LOAD, PhaseCause.STARTED): Phase.ON_MISSION,
    (Phase.ON_MISSION, PhaseCause.TRANSFER_BEGUN): Phase.ON_HANDOVER,
    (Phase.ON_MISSION, PhaseCause.EMERGENCY): Phase.EMERGENCY,
    (Phase.ON_MISSION, PhaseCause.DISARMED): Phase.ON_LOAD,
    (Phase.ON_HANDOVER, PhaseCause.TRANSFER_ENDED): Phase.ON_MISSION,
    (Phase.ON_HANDOVER, PhaseCause.EMERGENCY): Phase.EMERGENCY,
    (Phase.ON_HANDOVER, PhaseCause.DISARMED): Phase.ON_LOAD,
    (Phase.EMERGENCY, PhaseCause.RECOVERED): Phase.ON_MISSION,
    (Phase.EMERGENCY, PhaseCause.DISARMED): Phase.ON_LOAD,
    (Phase.ON_LOAD, PhaseCause.REHEARSED): Phase.ON_MISSION,
    (Phase.ON_MISSION, PhaseCause.REHEARSAL_OVER): Phase.ON_LOAD,
    (Phase.ON_HANDOVER, PhaseCause.REHEARSAL_OVER): Phase.ON_LOAD,
    (Phase.EMERGENCY, PhaseCause.REHEARSAL_OVER): Phase.ON_LOAD,
}

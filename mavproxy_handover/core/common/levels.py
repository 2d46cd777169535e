# SPDX-License-Identifier: GPL-3.0-or-later

"""How serious a sentence to people is: one scale for vehicle, station, report and watch page.

`DECISION_LEVELS` is the one table of the levels of safety decisions. STATUSTEXT has its severity from it
(`wire/texts.py`), a station its colour and sound (`gcs_module/alarms.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from mavproxy_handover.core.common.model import FlightAction

__all__ = ["DECISION_LEVELS", "Level"]


class Level(IntEnum):
    """How serious a sentence is; a higher value is more serious."""

    INFO = 0
    #: for information: no action is needed at once
    ADVISORY = 1
    #: something is wrong or is about to go wrong, or waits for the operator
    WARNING = 2
    #: the aircraft has left its mission, or no station commands it
    EMERGENCY = 3


#: safety decision -> its level; None: nothing is wrong any more
DECISION_LEVELS: Final[Mapping[FlightAction | None, Level]] = {
    None: Level.ADVISORY,
    FlightAction.WARN: Level.WARNING,
    FlightAction.TRANSFER: Level.WARNING,
    FlightAction.CONTINUE: Level.WARNING,
    FlightAction.HOLD: Level.WARNING,
    FlightAction.RETURN: Level.EMERGENCY,
    FlightAction.LAND: Level.EMERGENCY,
}

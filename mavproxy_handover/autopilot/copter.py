# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself says to ArduCopter: START, the stop, the way home.

Sources: ArduCopter's GCS_MAVLink_Copter.cpp for arming, MISSION_START and DO_PAUSE_CONTINUE.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.procedures import Procedures, disobeys
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.vehicle.kinds import COPTER, Vehicle
from mavproxy_handover.wire.conversation import Asking, NoAnswer
from mavproxy_handover.wire.ids import MISSION_START

__all__ = ["Copter"]


@dataclass(frozen=True, slots=True)
class Copter(Procedures):
    """Those of ArduCopter; `foreign` returns what the autopilot is, in words, if that is nothing that is flown here."""

    foreign: Callable[[], str] = str

    @property
    def vehicle(self) -> Vehicle:
        """ArduCopter."""
        return COPTER

    def start(self) -> Asking:
        """Arm in GUIDED, then fly the mission in AUTO: what START means."""
        yield from self._mode(COPTER.guided)
        yield from self._arm()
        yield from self._do("MISSION_START", MISSION_START)
        yield from self._shows("mode AUTO", lambda m: bool(m.custom_mode == COPTER.auto))

    def hold(self, pause: bool) -> Asking:
        """Stop where it is, or go on. Returns what it does."""
        what = "hold" if pause else "go on"
        yield from self._do(what, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0 if pause else 1)
        return what

    def bring_home(self, action: FlightAction) -> Asking:
        """RTL, and LAND if that cannot be had. Returns the name of the mode that the autopilot took.

        What is nothing that is flown here is never told a number of a mode, which means another one there (6 is CIRCLE
        for a rover).
        """
        if self.foreign():
            yield from self._do("return to launch", mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
            return "return to launch"
        wanted = (COPTER.back, COPTER.land) if action is FlightAction.RETURN else (COPTER.land,)
        errors: list[NoAnswer] = []
        for mode in wanted:
            try:
                yield from self._mode(mode)
                return COPTER.mode_name(mode)
            except NoAnswer as error:
                errors.append(error)
        raise disobeys(errors)

    def return_anew(self) -> Asking:
        """Leave RTL and begin it again, at a full stop: it reads its place when it begins. What `bring_home` returns.

        If it does not leave, it is in RTL still.
        """
        with suppress(NoAnswer):
            yield from self._mode(COPTER.guided)
        return (yield from self.bring_home(FlightAction.RETURN))

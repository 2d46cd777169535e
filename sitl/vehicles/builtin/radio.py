# SPDX-License-Identifier: GPL-3.0-or-later

"""A pilot's radio control: the flight mode switch, and what happens when it falls silent.

As in ArduCopter: the switch (channel FLTMODE_CH) chooses FLTMODE1 to FLTMODE6 when its position changes, not before; a
receiver that was heard and is silent for RC_FS_TIMEOUT is a radio failsafe if FS_THR_ENABLE is not 0, which returns.
The sticks themselves do not fly the aircraft: in manual control it stands still. Without a transmitter there is neither
switch nor failsafe.
"""

from __future__ import annotations

import struct
from typing import Final

from sitl.vehicles.builtin.copter import Copter, ModeReason

__all__ = ["Radio"]

_CHANNELS: Final = struct.Struct("<16H")
_TIMEOUT_S: Final = 1.0
#: the switch's positions end at these pulse widths (us)
_ENDS: Final = (1230, 1360, 1490, 1620, 1749)
_RTL, _LAND = 6, 9


class Radio:
    """The receiver of one vehicle."""

    def __init__(self, copter: Copter) -> None:
        self._copter = copter
        self._heard_at_s: float | None = None
        self._position: int | None = None
        #: the radio failsafe acts
        self.failed = False

    @property
    def ever(self) -> bool:
        """A receiver was heard."""
        return self._heard_at_s is not None

    def receive(self, data: bytes) -> None:
        """A frame of pulse widths, as SITL takes it on its radio port; anything else is none."""
        if len(data) != _CHANNELS.size:
            return
        widths = _CHANNELS.unpack(data)
        self._heard_at_s = self._copter.time_s
        width = widths[int(self._copter.parameters["FLTMODE_CH"]) - 1]
        position = sum(width > end for end in _ENDS)
        if position != self._position:
            first, self._position = self._position is None, position
            if not first or not self._copter.armed:
                self._copter.set_mode(int(self._copter.parameters[f"FLTMODE{position + 1}"]), ModeReason.RC_COMMAND)

    def update(self) -> None:
        """Time has passed."""
        copter = self._copter
        if self._heard_at_s is None or copter.parameters["FS_THR_ENABLE"] == 0:
            self.failed = False
            return
        silent = copter.time_s - self._heard_at_s > _TIMEOUT_S
        if silent and not self.failed and copter.armed and not copter.land_complete:
            copter.say(4, "Radio Failsafe")
            if not copter.set_mode(_RTL, ModeReason.RADIO_FAILSAFE):
                copter.set_mode(_LAND, ModeReason.RADIO_FAILSAFE)
        elif self.failed and not silent:
            copter.say(4, "Radio Failsafe Cleared")
        self.failed = silent

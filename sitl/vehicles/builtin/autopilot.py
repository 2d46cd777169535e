# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot as telemetry, commands and scripts see it: the aircraft and what watches over it, without a channel."""

from __future__ import annotations

from dataclasses import dataclass

from sitl.vehicles.builtin.arming import Arming
from sitl.vehicles.builtin.copter import Copter
from sitl.vehicles.builtin.failsafe import Failsafes
from sitl.vehicles.builtin.geofence import Geofence
from sitl.vehicles.builtin.radio import Radio
from sitl.vehicles.builtin.sticks import Sticks

__all__ = ["Autopilot"]


@dataclass(frozen=True, slots=True)
class Autopilot:
    """Its parts, and its clock."""

    copter: Copter
    arming: Arming
    failsafes: Failsafes
    sticks: Sticks
    radio: Radio
    fence: Geofence
    unix_start_us: int
    """The receiver's time at the start, microseconds since 1970."""

    def micros(self) -> int:
        """Time since the start."""
        return round(self.copter.time_s * 1e6)

    def millis(self) -> int:
        """Time since the start."""
        return round(self.copter.time_s * 1e3)

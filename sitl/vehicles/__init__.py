# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicles of a simulation, with one interface to start them.

Kinds: `arducopter`, ArduPilot's own SITL program, and `builtin`, the copter model that ships with this project for
machines without one; `quadplane` and `plane`, ArduPlane's program, without a substitute. All are real processes on
loopback, take the same start position, scripts and parameter files, and speak MAVLink 2 on the same serial ports:
SERIAL1 (channel 1) for the companion, SERIAL2 (channel 2) for a passive observer, SERIAL0 (channel 0) for a radio wired
straight to the autopilot.
"""

from __future__ import annotations

from sitl.vehicles.arducopter import find_arducopter
from sitl.vehicles.arduplane import find_arduplane
from sitl.vehicles.process import KINDS, RunningVehicle, flies, launch
from sitl.vehicles.spec import LaunchError, VehicleSpec

__all__ = [
    "KINDS",
    "LaunchError",
    "RunningVehicle",
    "VehicleSpec",
    "find_arducopter",
    "find_arduplane",
    "flies",
    "launch",
]

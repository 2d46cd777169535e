# SPDX-License-Identifier: GPL-3.0-or-later

"""The numbers that a station shows of one aircraft, each with the time when it was heard. Pure: time is an argument.

They come from the autopilot's own messages, which every station gets, and from HANDOVER_TELEMETRY, which only a
commander and a partner get. A number that is not finite, or that the sender marks as not known, is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite
from typing import Any, Final

__all__ = ["FlightValues", "Stamped"]

_NO_HEADING: Final = 0xFFFF
_NO_VOLTAGE: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class Stamped:
    """A value, and when it was heard (monotonic s)."""

    value: Any
    at: float


class FlightValues:
    """The last values of one aircraft. None: never heard."""

    def __init__(self) -> None:
        #: latitude and longitude (degrees)
        self.position: Stamped | None = None
        self.height_m: Stamped | None = None
        self.speed_mps: Stamped | None = None
        self.heading_deg: Stamped | None = None
        self.battery_percent: Stamped | None = None
        self.battery_v: Stamped | None = None
        #: the time left in flight by the autopilot's own estimate (s)
        self.battery_left_s: Stamped | None = None

    def on_autopilot(self, m: Any, now: float) -> None:
        """A message of the autopilot, of any kind."""
        kind = m.get_type()
        if kind == "GLOBAL_POSITION_INT":
            self._move(m, hypot(m.vx, m.vy) / 100.0, m.hdg, now)
        elif kind == "SYS_STATUS":
            self._battery(m.battery_remaining, m.voltage_battery, now)
        elif kind == "BATTERY_STATUS" and m.id == 0 and m.time_remaining > 0:
            self.battery_left_s = Stamped(float(m.time_remaining), now)

    def on_telemetry(self, m: Any, now: float) -> None:
        """A HANDOVER_TELEMETRY."""
        self._move(m, m.groundspeed, m.heading, now)
        self._battery(m.battery_remaining, m.battery_voltage, now)

    def _move(self, m: Any, speed_mps: float, heading_cdeg: int, now: float) -> None:
        if m.lat or m.lon:
            self.position = Stamped((m.lat / 1e7, m.lon / 1e7), now)
        self.height_m = Stamped(m.relative_alt / 1000.0, now)
        if isfinite(speed_mps):
            self.speed_mps = Stamped(float(speed_mps), now)
        if heading_cdeg != _NO_HEADING:
            self.heading_deg = Stamped(heading_cdeg / 100.0, now)

    def _battery(self, percent: int, millivolts: int, now: float) -> None:
        if percent >= 0:
            self.battery_percent = Stamped(float(percent), now)
        if millivolts not in (0, _NO_VOLTAGE):
            self.battery_v = Stamped(millivolts / 1000.0, now)

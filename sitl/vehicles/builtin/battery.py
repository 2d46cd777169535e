# SPDX-License-Identifier: GPL-3.0-or-later

"""The battery: constant voltage, current by what the motors do, charge counted.

As in SITL with its default battery, the voltage is the parameter SIM_BATT_VOLTAGE, so that a scenario can lower
it in flight; the currents are those that SITL's quad drew in hover, climb and descent. The low and critical
failsafes follow AP_BattMonitor: by voltage held for BATT_LOW_TIMER seconds, or by remaining charge, each
announced once per flight step up.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from sitl.vehicles.builtin.params import ParameterTable

__all__ = ["Battery", "BatteryLevel"]

HOVER_A = 28.0
_CLIMB_A_PER_M_S = 1.0
_IDLE_A = 0.0
_SPINNING_A = 2.0


class BatteryLevel(IntEnum):
    """Failsafe level, in rising order."""

    OK = 0
    LOW = 2
    CRITICAL = 3


@dataclass(slots=True)
class Battery:
    """State of the pack; `update` is called with the time step, `check` while armed."""

    parameters: ParameterTable
    used_mah: float = 0.0
    current_a: float = 0.0
    level: BatteryLevel = BatteryLevel.OK
    _low_since_s: float | None = None
    _critical_since_s: float | None = None

    @property
    def voltage_v(self) -> float:
        return self.parameters["SIM_BATT_VOLTAGE"]

    @property
    def remaining_percent(self) -> int:
        capacity = self.parameters["BATT_CAPACITY"]
        return max(0, int(100 * (capacity - self.used_mah) / capacity)) if capacity > 0 else 0

    @property
    def present(self) -> bool:
        return self.parameters["BATT_MONITOR"] > 0

    def update(self, dt: float, armed: bool, flying: bool, climb_m_s: float) -> None:
        """Draw current for `dt` seconds."""
        if flying:
            self.current_a = max(0.0, HOVER_A + _CLIMB_A_PER_M_S * climb_m_s)
        else:
            self.current_a = _SPINNING_A if armed else _IDLE_A
        self.used_mah += self.current_a * dt / 3.6

    def arming_fault(self) -> str | None:
        """Why this battery forbids arming, in the autopilot's words; None when it does not."""
        p = self.parameters
        left = p["BATT_CAPACITY"] - self.used_mah
        faults = (
            (p["BATT_ARM_VOLT"] > 0 and self.voltage_v < p["BATT_ARM_VOLT"], "below minimum arming voltage"),
            (p["BATT_ARM_MAH"] > 0 and left < p["BATT_ARM_MAH"], "below minimum arming capacity"),
            (self._below("BATT_LOW_VOLT"), "low voltage failsafe"),
            (p["BATT_LOW_MAH"] > 0 and left < p["BATT_LOW_MAH"], "low capacity failsafe"),
            (self._below("BATT_CRT_VOLT"), "critical voltage failsafe"),
            (p["BATT_CRT_MAH"] > 0 and left < p["BATT_CRT_MAH"], "critical capacity failsafe"),
        )
        return next((text for failed, text in faults if failed), None) if self.present else None

    def check(self, now_s: float) -> BatteryLevel | None:
        """The level newly reached, or None. Levels only rise."""
        if not self.present:
            return None
        p = self.parameters
        left = p["BATT_CAPACITY"] - self.used_mah
        timer = p["BATT_LOW_TIMER"]
        self._critical_since_s = self._since(self._critical_since_s, self._below("BATT_CRT_VOLT"), now_s)
        self._low_since_s = self._since(self._low_since_s, self._below("BATT_LOW_VOLT"), now_s)
        found = BatteryLevel.OK
        if self._held(self._low_since_s, timer, now_s) or (p["BATT_LOW_MAH"] > 0 and left < p["BATT_LOW_MAH"]):
            found = BatteryLevel.LOW
        if self._held(self._critical_since_s, timer, now_s) or (p["BATT_CRT_MAH"] > 0 and left < p["BATT_CRT_MAH"]):
            found = BatteryLevel.CRITICAL
        if found <= self.level:
            return None
        self.level = found
        return found

    def _below(self, name: str) -> bool:
        return 0 < self.voltage_v < self.parameters[name]

    @staticmethod
    def _since(since_s: float | None, active: bool, now_s: float) -> float | None:
        return (now_s if since_s is None else since_s) if active else None

    @staticmethod
    def _held(since_s: float | None, timer_s: float, now_s: float) -> bool:
        return since_s is not None and timer_s > 0 and now_s - since_s > timer_s

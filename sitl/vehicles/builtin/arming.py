# SPDX-License-Identifier: GPL-3.0-or-later

"""Arming: what must hold before the motors may start, and what the refusal says.

All checks run, so a refusal names every reason ("Arm: ..."); while disarmed the same checks run once a second
and are shown every thirty ("PreArm: ..."). A forced arm (21196) and ARMING_CHECK 0 skip everything but the
position a mode needs; the scripts' authorisation is among what they skip, as in ArduPilot.
"""

from __future__ import annotations

from collections.abc import Callable

from sitl.vehicles.builtin.copter import Copter

__all__ = ["Arming"]

_SHOW_EVERY_S = 30.0


class Arming:
    """Arms and disarms the aircraft on request."""

    def __init__(
        self, copter: Copter, script_refusal: Callable[[], str | None], radio: Callable[[], bool] = lambda: False
    ) -> None:
        """`radio`: whether a transmitter is heard."""
        self._copter = copter
        self._radio = radio
        self._script_refusal = script_refusal
        self._checked_at_s = 0.0
        self._shown_at_s = 0.0
        self.ready = False

    def arm(self, force: bool = False) -> bool:
        """Run the checks and start the motors; a refusal is told in STATUSTEXTs."""
        copter = self._copter
        if copter.armed:
            return True
        essential = self._essential()
        if force or copter.parameters["ARMING_CHECK"] == 0:
            faults = essential
        else:
            faults = self._parameter_checks() + essential + self._system_checks()
        if not faults and not force and not copter.mode.can_arm():
            faults = [f"{copter.mode.name} mode not armable"]
        for fault in faults:
            copter.say(2, f"Arm: {fault}")
        if faults:
            return False
        copter.motors_on()
        if not force and copter.parameters["ARMING_CHECK"] == 0:
            copter.say(4, "Warning: Arming Checks Disabled")
        return True

    def disarm(self, force: bool = False) -> bool:
        """Stop the motors on a station's request; refused in the air unless forced."""
        copter = self._copter
        if not copter.armed:
            return True
        if not force and not copter.land_complete:
            return False
        copter.disarm()
        return True

    def update(self) -> None:
        """The periodic check while disarmed."""
        copter = self._copter
        if copter.armed:
            self._checked_at_s = copter.time_s
        if copter.time_s - self._checked_at_s < 1.0:
            return
        self._checked_at_s = copter.time_s
        faults = self._parameter_checks() + self._essential() + self._system_checks()
        was_ready, self.ready = self.ready, not faults
        if faults and (was_ready or copter.time_s - self._shown_at_s >= _SHOW_EVERY_S):
            self._shown_at_s = copter.time_s
            for fault in faults:
                copter.say(2, f"PreArm: {fault}")

    def show(self) -> None:
        """Run the checks and tell what fails, on request."""
        for fault in self._parameter_checks() + self._essential() + self._system_checks():
            self._copter.say(2, f"PreArm: {fault}")

    def _essential(self) -> list[str]:
        copter = self._copter
        if not copter.initialised:
            return ["System not initialised"]
        if copter.mode.needs_position and not copter.position_ok:
            return ["Need Position Estimate"]
        return []

    def _parameter_checks(self) -> list[str]:
        copter = self._copter
        faults = []
        if copter.failsafe_active:
            faults.append("GCS failsafe on")
        if copter.parameters["FS_THR_ENABLE"] != 0 and not self._radio():
            faults.append("RC not found")
        return faults

    def _system_checks(self) -> list[str]:
        faults = []
        battery = self._copter.battery.arming_fault()
        if battery is not None:
            faults.append(f"Battery 1 {battery}")
        if self._copter.battery.level:
            faults.append("Battery failsafe")
        refusal = self._script_refusal()
        if refusal is not None:
            faults.append(refusal)
        return faults

# SPDX-License-Identifier: GPL-3.0-or-later

"""The aircraft with its flight modes: changing them, motors, landing detection.

Rules, as in ArduCopter: disarmed, any mode is accepted, because arming checks it; armed, modes that need a
position refuse without one; setting the mode it is in already succeeds and overwrites the reason. Landed is
what the landing detector says: on the ground with motors at their lower limit for a while.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from sitl.vehicles.builtin.aircraft import ORIGIN_AFTER_S, Aircraft, Listener, level
from sitl.vehicles.builtin.auto import Auto
from sitl.vehicles.builtin.frame import Location
from sitl.vehicles.builtin.mission import Mission
from sitl.vehicles.builtin.modes import Brake, Guided, Land, Loiter, Mode, Stabilize
from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.builtin.returning import ReturnToLaunch, SmartReturn

__all__ = ["Copter", "ModeReason"]

LAND_DETECT_S = 1.2


class ModeReason(IntEnum):
    """ArduPilot's reasons for a mode change that occur here."""

    UNKNOWN = 0
    RC_COMMAND = 1
    GCS_COMMAND = 2
    RADIO_FAILSAFE = 3
    BATTERY_FAILSAFE = 4
    GCS_FAILSAFE = 5
    EKF_FAILSAFE = 6
    MISSION_END = 8
    FENCE_BREACHED = 10
    INITIALISED = 26
    SCRIPTING = 32


class Copter(Aircraft):
    """The simulated aircraft without its radio: what it does, one time step at a time."""

    def __init__(
        self,
        parameters: ParameterTable,
        start: Location,
        heading_deg: float,
        listener: Listener,
        rise_m: Callable[[int, int, Location], float] = level,
    ) -> None:
        super().__init__(parameters, start, heading_deg, listener, rise_m)
        self.failsafe_active = False
        self.reason = ModeReason.INITIALISED
        self.auto, self.guided, self.land = Auto(self), Guided(self), Land(self)
        self.smart_rtl = SmartReturn(self)
        others = [Stabilize(self), Loiter(self), ReturnToLaunch(self), Brake(self)]
        all_modes: list[Mode] = [self.auto, self.guided, self.land, self.smart_rtl, *others]
        self.modes = {mode.number: mode for mode in all_modes}
        self.mode = self.modes.get(int(parameters["INITIAL_MODE"]), self.modes[Stabilize.number])
        self.mission = Mission(self.auto.start_command, self.auto.verify_command, self.auto.mission_complete, self.say)

    # -- what others do -------------------------------------------------------------------------------------------

    def set_mode(self, number: int, reason: int) -> bool:
        """Change the flight mode; False says why in a text."""
        if number == self.mode.number:
            self.reason = ModeReason(reason) if reason in set(ModeReason) else ModeReason.UNKNOWN
            return True
        new = self.modes.get(number)
        if new is None:
            self.say(4, f"No such mode {number}")
            return False
        fault = None
        if self.armed:
            if new.needs_position and not self.position_ok:
                fault = "requires position"
            elif new.manual_throttle:
                fault = "in RC failsafe"
        if fault is None and not new.init(not self.armed):
            fault = "init failed"
        if fault is not None:
            self.say(4, f"Mode change to {new.name} failed: {fault}")
            return False
        self.mode.exit()
        self.mode = new
        self.reason = ModeReason(reason) if reason in set(ModeReason) else ModeReason.UNKNOWN
        self.listener.mode_changed()
        return True

    def motors_on(self) -> None:
        """Arming succeeded."""
        self.armed, self.armed_at_s, self.auto_armed = True, self.time_s, False
        self._idle_since_s = self.time_s
        self.say(6, "Arming motors")
        if self.home is not None and not self.home_locked:
            self.set_home(self.location(), lock=False)
        self.smart_rtl.remember_home()

    def step(self, dt: float) -> None:
        """Advance the simulation by `dt` seconds."""
        self.time_s += dt
        if self.origin is None and self.time_s >= ORIGIN_AFTER_S:
            self._find_origin()
        self.body.wind = self.wind() if self.armed and not self.land_complete else (0.0, 0.0)
        self.mission.restart = self.parameters["MIS_RESTART"] == 1
        if self.armed:
            self.mode.run(dt)
            if self.mode is not self.smart_rtl:
                self.smart_rtl.record()
            self._detect_landing()
            self._idle_disarm()
        else:
            if self.mode is self.auto:
                self.mode.run(dt)
            self._fall(dt)
        flying = self.armed and not self.land_complete
        self.battery.update(dt, self.armed, flying, self.body.velocity[2])

    # -- inside ---------------------------------------------------------------------------------------------------

    def _detect_landing(self) -> None:
        if self.land_complete:
            return
        settled = self.body.on_ground and self.body.velocity[2] == 0.0 and self.mode.descending
        if not settled:
            self._touched_since_s = None
        elif self._touched_since_s is None:
            self._touched_since_s = self.time_s
        elif self.time_s - self._touched_since_s >= LAND_DETECT_S:
            self._set_landed(True)

    def _idle_disarm(self) -> None:
        """DISARM_DELAY: disarm if the aircraft is armed and idle on the ground, without a take-off."""
        delay = self.parameters["DISARM_DELAY"]
        if not self.armed or not self.land_complete or (self.auto_armed and self.mode.taking_off):
            self._idle_since_s = self.time_s
        elif delay > 0 and self.time_s - self._idle_since_s >= delay:
            self.disarm()

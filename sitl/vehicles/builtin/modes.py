# SPDX-License-Identifier: GPL-3.0-or-later

"""The flight modes except AUTO and the two that return.

Each mode turns its purpose into a velocity command for the airframe at every step. There are no sticks: LOITER
and BRAKE hold where they stop, STABILIZE only exists on the ground (in flight the autopilot without a receiver
refuses it).
"""

from __future__ import annotations

import math
from dataclasses import replace

from sitl.vehicles.builtin.aircraft import Aircraft
from sitl.vehicles.builtin.frame import Location, Vector, bearing_deg
from sitl.vehicles.builtin.navigator import approach_speed, pursue

__all__ = ["Brake", "Guided", "Land", "Loiter", "Mode", "Stabilize", "Takeoff", "target_bearing_deg"]

_LAND_PAUSE_S = 4.0


class Mode:
    """One flight mode. `init` prepares it (False: refused), `run` flies one step."""

    number = -1
    name = ""
    needs_position = True
    manual_throttle = False
    autopilot = False

    def __init__(self, copter: Aircraft) -> None:
        self.copter = copter

    def init(self, ignore_checks: bool) -> bool:
        return True

    def exit(self) -> None:
        """Leave the mode."""

    def run(self, dt: float) -> None:
        """Stand on the ground or hold the present place."""
        if not self.grounded():
            self.brake(dt)

    def can_arm(self) -> bool:
        """Whether a ground station or a script may arm in this mode."""
        return False

    def pause(self) -> bool:
        return False

    def resume(self) -> bool:
        return False

    def take_off(self, height_m: float) -> bool:
        """MAV_CMD_NAV_TAKEOFF to `height_m` above home."""
        return False

    def change_speed(self, kind: str, value_m_s: float) -> bool:
        """`kind`: speed, up or down."""
        return False

    def target(self) -> Vector | None:
        """Where it is flying to, in the local frame, if anywhere."""
        return None

    @property
    def landing(self) -> bool:
        return False

    @property
    def taking_off(self) -> bool:
        return False

    @property
    def descending(self) -> bool:
        """Whether touching the ground now is a landing."""
        return self.landing

    # -- common moves ---------------------------------------------------------------------------------------------

    def grounded(self) -> bool:
        """Disarmed or landed: stand still. True when that was all there is to do."""
        copter = self.copter
        if copter.armed and not copter.land_complete:
            return False
        if copter.body.on_ground and not copter.body.resting:
            copter.body.rest()
        return True

    def brake(self, dt: float, accel: float | None = None) -> None:
        limits = self.copter.limits()
        self.copter.body.drive((0.0, 0.0, 0.0), accel or limits.accel, limits.accel_up, dt)

    def follow(self, dt: float, hold_heading: bool = False) -> None:
        """Fly the navigator's track; the nose points where it flies unless the heading is held."""
        copter = self.copter
        command = copter.navigator.update(copter.body.position, dt)
        limits = copter.navigator.limits
        copter.body.drive(command, max(limits.accel, limits.corner_accel), 2 * limits.accel_up, dt)
        if not hold_heading and copter.parameters["WP_YAW_BEHAVIOR"] != 0:
            copter.body.turn(None, dt)
        else:
            copter.body.turn(copter.body.heading_deg, dt)

    def descend(self, dt: float) -> None:
        """Land: WPNAV_SPEED_DN (or LAND_SPEED_HIGH) down to LAND_ALT_LOW, LAND_SPEED below it."""
        copter, p = self.copter, self.copter.parameters
        if self.grounded():
            return
        slow = abs(p["LAND_SPEED"]) / 100
        fast = p["LAND_SPEED_HIGH"] / 100 if p["LAND_SPEED_HIGH"] > 0 else copter.limits().down
        height = copter.body.position[2] - copter.body.ground_m
        above = height - max(p["LAND_ALT_LOW"], 100.0) / 100
        accel = copter.limits().accel_up
        rate = max(slow, min(fast, approach_speed(above, accel)))
        copter.body.drive(copter.precision.steer(rate, copter.body, copter.time_s), copter.limits().accel, accel, dt)
        copter.body.turn(copter.body.heading_deg, dt)


class Takeoff:
    """A vertical climb to a height in the local frame; carries the aircraft off the ground first."""

    def __init__(self, mode: Mode) -> None:
        self.mode = mode
        self.height_m = 0.0
        self.complete = True

    def begin(self, height_m: float) -> None:
        self.height_m, self.complete = height_m, False

    def run(self, dt: float) -> None:
        copter = self.mode.copter
        if not copter.armed or not copter.auto_armed or not copter.lifted:
            self.mode.grounded()
            return
        if copter.land_complete:
            copter.begin_flight()
        limits = copter.limits()
        gap = self.height_m - copter.body.position[2]
        rate = math.copysign(min(limits.up, approach_speed(abs(gap), limits.accel_up * 0.7)), gap)
        copter.body.drive((0.0, 0.0, rate), limits.accel, limits.accel_up, dt)
        self.complete = abs(gap) <= 0.1 * limits.up and abs(copter.body.velocity[2]) <= 0.15 * limits.up


class Stabilize(Mode):
    number, name, needs_position, manual_throttle = 0, "STABILIZE", False, True

    def can_arm(self) -> bool:
        return True


class Loiter(Mode):
    number, name = 5, "LOITER"

    def run(self, dt: float) -> None:
        if not self.grounded():
            self.brake(dt, self.copter.parameters["LOIT_BRK_ACCEL"] / 100)

    def can_arm(self) -> bool:
        return True


class Brake(Mode):
    number, name = 17, "BRAKE"


class Land(Mode):
    number, name, needs_position, autopilot = 9, "LAND", False, True

    def __init__(self, copter: Aircraft) -> None:
        super().__init__(copter)
        self._pause_until_s = -math.inf

    def init(self, ignore_checks: bool) -> bool:
        self._pause_until_s = -math.inf
        return True

    def hold_first(self) -> None:
        """Wait four seconds before descending: how failsafes land."""
        self._pause_until_s = self.copter.time_s + _LAND_PAUSE_S

    def run(self, dt: float) -> None:
        if self.copter.spooled_down:
            self.copter.disarm()
        elif self.copter.time_s < self._pause_until_s:
            super().run(dt)
        else:
            self.descend(dt)

    @property
    def landing(self) -> bool:
        return True


class Guided(Mode):
    """Waits for a destination, a velocity or a take-off; holds until then, and again when velocities stop coming."""

    number, name, autopilot = 4, "GUIDED", True

    def __init__(self, copter: Aircraft) -> None:
        super().__init__(copter)
        self.takeoff = Takeoff(self)
        self._doing = "hold"
        self._destination: Vector = (0.0, 0.0, 0.0)
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._velocity_at_s = 0.0
        self._paused = False
        self._limits = copter.limits()

    def init(self, ignore_checks: bool) -> bool:
        self._doing, self._paused = "hold", False
        self._limits = self.copter.limits()
        return True

    def can_arm(self) -> bool:
        return True

    def take_off(self, height_m: float) -> bool:
        copter = self.copter
        if not copter.armed or not copter.land_complete or height_m <= copter.above_home_m():
            return False
        self.takeoff.begin((copter.home or copter.start).alt_m + height_m - copter.start.alt_m)
        self._doing = "takeoff"
        copter.auto_armed = True
        return True

    def go_to(self, place: Location) -> bool:
        """Fly to `place` in a straight line and stop there."""
        self._destination = self.copter.local(place)
        self._switch("go")
        return True

    def fly_with(self, velocity: Vector) -> None:
        """Fly with a velocity (m/s) for GUID_TIMEOUT seconds at most."""
        self._velocity, self._velocity_at_s = velocity, self.copter.time_s
        self._switch("velocity")

    def stop(self) -> None:
        self._switch("hold")

    def _switch(self, doing: str) -> None:
        """Take up another kind of flying; a changed speed is forgotten then, as in ArduCopter."""
        if doing != self._doing:
            self._limits = self.copter.limits()
        self._doing = doing

    def pause(self) -> bool:
        self._paused = True
        return True

    def resume(self) -> bool:
        self._paused = False
        return True

    def change_speed(self, kind: str, value_m_s: float) -> bool:
        self._limits = replace(self._limits, **{kind: value_m_s})
        return True

    def run(self, dt: float) -> None:
        copter = self.copter
        if self._doing == "takeoff" and not self._paused:
            if self.takeoff.complete and not copter.land_complete:
                self.brake(dt)
            else:
                self.takeoff.run(dt)
            return
        if self.grounded():
            return
        fresh = copter.time_s - self._velocity_at_s <= copter.parameters["GUID_TIMEOUT"]
        if self._paused or self._doing == "hold" or (self._doing == "velocity" and not fresh):
            self.brake(dt)
        else:
            goal = self._velocity
            if self._doing == "go":
                goal = pursue(copter.body.position, self._destination, self._limits)
            copter.body.drive(goal, self._limits.accel, self._limits.accel_up, dt)
            copter.body.turn(None, dt)

    def target(self) -> Vector | None:
        return self._destination if self._doing == "go" else None

    @property
    def taking_off(self) -> bool:
        return self._doing == "takeoff" and not self.takeoff.complete


def target_bearing_deg(mode: Mode) -> float:
    """Direction to the mode's target, 0 without one."""
    goal = mode.target()
    if goal is None:
        return 0.0
    here = mode.copter.body.position
    return bearing_deg(goal[0] - here[0], goal[1] - here[1])

# SPDX-License-Identifier: GPL-3.0-or-later

"""RTL and SMART_RTL.

RTL: climb to the return height, fly to home or the nearest rally point, wait RTL_LOIT_TIME, land (or descend to
RTL_ALT_FINAL and stay). Where to is read once, when it begins: told again, it goes on to where it was going. On the
ground it does nothing at all: it never takes off. SMART_RTL flies the recorded path back to where the aircraft armed,
two metres above its end, and lands there; it refuses without a path.
"""

from __future__ import annotations

import math

from sitl.vehicles.builtin.aircraft import Aircraft
from sitl.vehicles.builtin.frame import AltFrame, Location, Vector
from sitl.vehicles.builtin.modes import Mode
from sitl.vehicles.builtin.navigator import approach_speed

__all__ = ["ReturnToLaunch", "SmartReturn"]

_PATH_PERIOD_S = 1 / 3


class ReturnToLaunch(Mode):
    """Stages: start, climb, return, wait, descend or land."""

    number, name, autopilot = 6, "RTL", True

    def __init__(self, copter: Aircraft) -> None:
        super().__init__(copter)
        self.stage = "start"
        self._target: Vector = (0.0, 0.0, 0.0)
        self._waiting_since_s = 0.0

    def init(self, ignore_checks: bool) -> bool:
        if not ignore_checks and self.copter.home is None:
            return False
        self.stage = "start"
        return True

    def run(self, dt: float) -> None:
        if self.stage == "start" and self.copter.armed:
            self._begin()
        self._settle()
        if self.stage == "land":
            if self.copter.spooled_down:
                self.finished()
            else:
                self.descend(dt)
        elif self.grounded():
            return
        elif self.stage == "descend":
            self._descend_to_final(dt)
        else:
            hold = self.copter.parameters["WP_YAW_BEHAVIOR"] in (0, 2)
            self.follow(dt, hold_heading=hold or self.stage != "return")

    def finished(self) -> None:
        """Landed with motors at idle."""
        self.copter.disarm()

    def change_speed(self, kind: str, value_m_s: float) -> bool:
        self.copter.navigator.set_limits(**{kind: value_m_s})
        return True

    def target(self) -> Vector | None:
        return None if self.stage in ("start", "land") else self.copter.navigator.destination

    @property
    def landing(self) -> bool:
        return self.stage == "land"

    def _begin(self) -> None:
        copter = self.copter
        place, height_m = copter.return_target()
        self._target = copter.local(Location(place.lat_e7, place.lon_e7, height_m, AltFrame.ABOVE_HOME))
        start = copter.stopping_point()
        copter.navigator.begin(copter.limits(copter.parameters["RTL_SPEED"] / 100), start)
        copter.navigator.fly_to((start[0], start[1], self._target[2]), 0.0)
        self.stage = "climb"

    def _settle(self) -> None:
        """Move to the next stage when the present one is done."""
        copter = self.copter
        navigator = copter.navigator
        if self.stage == "climb" and navigator.reached:
            navigator.fly_to(self._target, 0.0)
            self.stage = "return"
        elif self.stage == "return" and navigator.reached:
            self._waiting_since_s = copter.time_s
            self.stage = "wait"
        elif (
            self.stage == "wait" and copter.time_s - self._waiting_since_s >= copter.parameters["RTL_LOIT_TIME"] / 1000
        ):
            self.stage = "land" if copter.parameters["RTL_ALT_FINAL"] <= 0 else "descend"

    def _descend_to_final(self, dt: float) -> None:
        copter = self.copter
        goal = (copter.home or copter.start).alt_m + copter.parameters["RTL_ALT_FINAL"] / 100 - copter.start.alt_m
        gap = goal - copter.body.position[2]
        limits = copter.limits()
        rate = math.copysign(min(limits.down if gap < 0 else limits.up, approach_speed(abs(gap), limits.accel_up)), gap)
        copter.body.drive((0.0, 0.0, rate), limits.accel, limits.accel_up, dt)


class SmartReturn(Mode):
    """Back along the recorded path. `record` is called all the time, in every other mode."""

    number, name, autopilot = 21, "SMARTRTL", True

    def __init__(self, copter: Aircraft) -> None:
        super().__init__(copter)
        self._path: list[Vector] = []
        self._usable = False
        self._recorded_at_s = -math.inf
        self._landing = False

    def remember_home(self) -> None:
        """Armed here: the path starts again."""
        self._path = [self.copter.body.position]
        self._usable = self.copter.position_ok

    def record(self) -> None:
        """Add the present position to the path, dropping points that lie on a straight line (SRTL_ACCURACY)."""
        copter = self.copter
        if not self._usable or copter.land_complete:
            return
        if copter.time_s - self._recorded_at_s < _PATH_PERIOD_S:
            return
        self._recorded_at_s = copter.time_s
        here, accuracy = copter.body.position, copter.parameters["SRTL_ACCURACY"]
        if math.dist(here, self._path[-1]) < max(accuracy, 0.5):
            return
        if len(self._path) >= 2 and _off_line(self._path[-2], here, self._path[-1]) < accuracy * 0.5:
            self._path[-1] = here
            return
        if len(self._path) >= copter.parameters["SRTL_POINTS"]:
            self._usable = False
            copter.say(4, "SmartRTL deactivated: buffer full")
            return
        self._path.append(here)

    def init(self, ignore_checks: bool) -> bool:
        if not self._usable or not self._path:
            return False
        copter = self.copter
        copter.navigator.begin(copter.limits(), copter.stopping_point())
        self._landing = False
        return True

    def run(self, dt: float) -> None:
        copter = self.copter
        if self._landing:
            if copter.spooled_down:
                copter.disarm()
            else:
                self.descend(dt)
            return
        if self.grounded():
            return
        if copter.navigator.reached:
            if not self._path:
                self._landing = True
                return
            point = self._path.pop()
            if not self._path:
                point = (point[0], point[1], point[2] + 2.0)
            copter.navigator.fly_to(point, copter.body.ground_speed_m_s)
            if self._path:
                copter.navigator.then(self._path[-1])
        self.follow(dt, hold_heading=copter.parameters["WP_YAW_BEHAVIOR"] in (0, 2))

    def target(self) -> Vector | None:
        return None if self._landing else self.copter.navigator.destination

    @property
    def landing(self) -> bool:
        return self._landing


def _off_line(start: Vector, end: Vector, point: Vector) -> float:
    """Distance of `point` from the line through `start` and `end`."""
    line = [e - s for s, e in zip(start, end, strict=True)]
    offset = [p - s for s, p in zip(start, point, strict=True)]
    length = math.sqrt(sum(c * c for c in line))
    if length < 1e-6:
        return math.dist(start, point)
    along = sum(o * c for o, c in zip(offset, line, strict=True)) / length
    return math.sqrt(max(0.0, sum(o * o for o in offset) - along * along))

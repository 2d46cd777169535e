# SPDX-License-Identifier: GPL-3.0-or-later

"""The aircraft without its modes: identity, position, limits, home and rally points, the ground under it.

A flight mode may read and change this; `Copter` adds the modes to it, and so the mission, which one of them flies. Home
is where it was switched on until it arms, then where it armed, unless a station has locked it. Disarming resets the
mission.

Everything that others must hear goes out through the `Listener`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from sitl.vehicles.builtin.battery import Battery
from sitl.vehicles.builtin.fence import keeps_to_fence
from sitl.vehicles.builtin.frame import AltFrame, Location, Vector, offset_ne_m, shift
from sitl.vehicles.builtin.items import Item
from sitl.vehicles.builtin.mission import Mission
from sitl.vehicles.builtin.navigator import Limits, Navigator
from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.builtin.physics import Body
from sitl.vehicles.builtin.precision_landing import PrecisionLanding

__all__ = ["ORIGIN_AFTER_S", "Aircraft", "Listener", "level"]

#: The receiver finds its satellites, then the estimator trusts them; SITL takes 20 s and 42 s for the same two steps.
ORIGIN_AFTER_S = 5.0
POSITION_AFTER_S = 10.0
#: The first step that the autopilot's main loop counts as initialised.
INITIALISED_AFTER_S = 1.0

ARMING_DELAY_S = 2.0
#: Spool-up and the slow rise of throttle before the aircraft leaves the ground.
LIFT_OFF_DELAY_S = 1.9
SPOOL_DOWN_S = 0.8
_RTL_ALT_MIN_M = 0.3
#: frame of an item whose height counts from the ground there
_TERRAIN = 10
_MIN_CONE_SLOPE = 0.5


class Listener(Protocol):
    """Receives what happens to the aircraft."""

    def text(self, severity: int, text: str) -> None: ...

    def item_reached(self, index: int) -> None: ...

    def mode_changed(self) -> None: ...

    def home_changed(self) -> None: ...

    def stored(self, name: str) -> None:
        """A parameter that the autopilot itself counts (MIS_TOTAL and its like) was saved."""


def level(_lat_e7: int, _lon_e7: int, _home: Location) -> float:
    """The ground is flat."""
    return 0.0


class Aircraft:
    """State of the aircraft, and what follows from it alone."""

    #: set by `Copter`: the items call on the mode that flies them
    mission: Mission

    def __init__(
        self,
        parameters: ParameterTable,
        start: Location,
        heading_deg: float,
        listener: Listener,
        rise_m: Callable[[int, int, Location], float],
    ) -> None:
        """`rise_m`: how much higher the ground is at a place (1e-7 degrees) than at home."""
        self._rise_m = rise_m
        self.parameters = parameters
        self.listener = listener
        self.time_s = 0.0
        self.start = start
        self.body = Body(heading_deg=heading_deg % 360.0)
        self.battery = Battery(parameters)
        self.navigator = Navigator()
        self.precision = PrecisionLanding(parameters, self.say)
        self.origin: Location | None = None
        self.home: Location | None = None
        self.home_locked = False
        self.rally: list[Item] = []
        self.fence: list[Item] = []
        #: the estimator has been without a receiver for too long
        self.ekf_failed = False
        self.armed = False
        self.auto_armed = False
        self.land_complete = True
        self.armed_at_s = 0.0
        self.flying_since_s: float | None = None
        self._idle_since_s = 0.0
        self._landed_since_s = -math.inf
        self._touched_since_s: float | None = None

    # -- what others ask ------------------------------------------------------------------------------------------

    def say(self, severity: int, text: str) -> None:
        self.listener.text(severity, text)

    @property
    def initialised(self) -> bool:
        return self.time_s >= INITIALISED_AFTER_S

    @property
    def gps_ok(self) -> bool:
        """The receiver has a fix."""
        return self.time_s >= ORIGIN_AFTER_S and self.parameters["SIM_GPS1_ENABLE"] != 0

    @property
    def position_ok(self) -> bool:
        """The estimator has a position that modes may rely on."""
        return self.time_s >= POSITION_AFTER_S and not self.ekf_failed

    @property
    def in_arming_delay(self) -> bool:
        return self.armed and self.time_s - self.armed_at_s < ARMING_DELAY_S

    @property
    def spooled_down(self) -> bool:
        """Motors at idle on the ground: a while after the landing was detected, or after arming."""
        idle_since_s = max(self._landed_since_s + SPOOL_DOWN_S, self.armed_at_s + ARMING_DELAY_S)
        return self.land_complete and self.time_s >= idle_since_s

    @property
    def lifted(self) -> bool:
        """Time enough since arming for the motors to carry."""
        return self.time_s - self.armed_at_s >= ARMING_DELAY_S + LIFT_OFF_DELAY_S

    def location(self) -> Location:
        """Where it is, altitude above sea level."""
        lat, lon = shift(self.start, self.body.position[0], self.body.position[1])
        return Location(lat, lon, self.start.alt_m + self.body.position[2])

    def above_home_m(self) -> float:
        return self.location().alt_m - (self.home or self.start).alt_m

    def local(self, place: Location) -> Vector:
        """A location in the local frame."""
        north, east = offset_ne_m(self.start, place)
        base = (self.home or self.start).alt_m if place.frame is AltFrame.ABOVE_HOME else 0.0
        return north, east, place.alt_m + base - self.start.alt_m

    def item_location(self, item: Item, default: Location) -> Location:
        """The place an item names; zero latitude and longitude, or zero altitude, mean those of `default`."""
        frame = AltFrame.ABSOLUTE if item.frame == 0 else AltFrame.ABOVE_HOME
        lat, lon = (default.lat_e7, default.lon_e7) if item.x == 0 and item.y == 0 else (item.x, item.y)
        if item.z != 0:
            rise_m = self._rise_m(lat, lon, self.home or self.start) if item.frame == _TERRAIN else 0.0
            return Location(lat, lon, item.z + rise_m, frame)
        return Location(lat, lon, default.alt_m, default.frame)

    def wind(self) -> tuple[float, float]:
        """Where the air moves to at this height (north, east, m/s), by SITL's parameters: less below SIM_WIND_T_ALT."""
        p, height_m = self.parameters, self.body.position[2] - self.body.ground_m
        speed, full_m = max(p["SIM_WIND_SPD"], 0.0), p["SIM_WIND_T_ALT"]
        if p["SIM_WIND_T"] == 0 and height_m < full_m:
            speed *= math.sqrt(max(height_m, 0.0) / full_m)
        away = math.radians(p["SIM_WIND_DIR"] + 180.0)
        return speed * math.cos(away), speed * math.sin(away)

    def limits(self, speed_m_s: float = 0.0) -> Limits:
        """Limits of waypoint flight from the WPNAV parameters; `speed_m_s` above zero replaces the speed."""
        p = self.parameters
        accel = max(p["WPNAV_ACCEL"], 50.0) / 100
        return Limits(
            speed=max(speed_m_s if speed_m_s > 0 else p["WPNAV_SPEED"] / 100, 0.1),
            up=max(p["WPNAV_SPEED_UP"], 10.0) / 100,
            down=max(p["WPNAV_SPEED_DN"], 10.0) / 100,
            accel=accel,
            accel_up=max(p["WPNAV_ACCEL_Z"], 50.0) / 100,
            corner_accel=p["WPNAV_ACCEL_C"] / 100 if p["WPNAV_ACCEL_C"] > 0 else 2 * accel,
            radius=max(p["WPNAV_RADIUS"], 5.0) / 100,
        )

    def stopping_point(self) -> Vector:
        """Where it would come to rest if it braked now."""
        limits = self.limits()
        n, e, u = self.body.position
        vn, ve, vu = self.body.velocity
        flat = self.body.ground_speed_m_s / (2 * limits.accel)
        return n + vn * flat, e + ve * flat, u + vu * abs(vu) / (2 * limits.accel_up)

    def return_target(self) -> tuple[Location, float]:
        """Home or the nearest rally point, and the height above home (m) to return at (RTL and RALLY parameters)."""
        here = self.location()
        home = self.home or self.start
        target = Location(home.lat_e7, home.lon_e7, home.alt_m)
        nearest = self._nearest_rally(here)
        if nearest is not None:
            distance, place = nearest
            home_distance = math.hypot(*offset_ne_m(here, home))
            if self.parameters["RALLY_INCL_HOME"] == 0 or distance < home_distance:
                target = place
        height = target.alt_m if target.frame is AltFrame.ABOVE_HOME else target.alt_m - home.alt_m
        now_m = self.above_home_m()
        floor = max(_RTL_ALT_MIN_M, now_m + max(0.0, self.parameters["RTL_CLIMB_MIN"] / 100))
        height = max(height, 0.0, self.parameters["RTL_ALT"] / 100, floor)
        slope = self.parameters["RTL_CONE_SLOPE"]
        if slope >= _MIN_CONE_SLOPE:
            height = min(height, max(math.hypot(*offset_ne_m(here, target)) * slope, floor))
        return target, max(height, now_m)

    def _nearest_rally(self, here: Location) -> tuple[float, Location] | None:
        places = [self.item_location(item, here) for item in self.rally if (item.x, item.y) != (0, 0)]
        places = [place for place in places if self._in_fence(place)]  # any other is passed over without a word
        if not places:
            return None
        distance, place = min(((math.hypot(*offset_ne_m(here, p)), p) for p in places), key=lambda pair: pair[0])
        limit_m = self.parameters["RALLY_LIMIT_KM"] * 1000
        return None if 0 < limit_m < distance else (distance, place)

    def _in_fence(self, place: Location) -> bool:
        home = self.home or self.start
        above_m = place.alt_m if place.frame is AltFrame.ABOVE_HOME else place.alt_m - home.alt_m
        return keeps_to_fence(place, above_m, home, self.fence, self.parameters)

    # -- what others do -------------------------------------------------------------------------------------------

    def disarm(self) -> None:
        """Motors off, wherever it is; in the air it falls."""
        if not self.armed:
            return
        self.armed = self.auto_armed = False
        self.say(6, "Disarming motors")
        self._set_landed(True)
        self.mission.reset()

    def set_home(self, place: Location, lock: bool) -> None:
        self.home, self.home_locked = place, self.home_locked or lock
        self.mission.home = Item(16, 0, x=place.lat_e7, y=place.lon_e7, z=round(place.alt_m, 2))
        self.listener.home_changed()

    def begin_flight(self) -> None:
        """The take-off has carried it off the ground."""
        self._set_landed(False)

    # -- inside ---------------------------------------------------------------------------------------------------

    def _find_origin(self) -> None:
        self.origin = self.start
        self.say(6, "EKF3 IMU0 origin set")
        before = len(self.mission)
        self.mission.keep_home()
        if before == 0:
            self.listener.stored("MIS_TOTAL")
        self.set_home(self.start, lock=False)

    def _fall(self, dt: float) -> None:
        if self.body.on_ground:
            if not self.body.resting:
                self.body.rest()
        else:
            self.body.drive((0.0, 0.0, -50.0), 0.5, 9.8, dt)

    def _set_landed(self, landed: bool) -> None:
        if landed and not self.land_complete:
            self._landed_since_s = self.time_s
        self._touched_since_s = None
        self.land_complete = landed
        self.flying_since_s = None if landed else self.flying_since_s or self.time_s
        self._idle_since_s = self.time_s

# SPDX-License-Identifier: GPL-3.0-or-later

"""AUTO: flies the mission's items.

Starting and judging items follows ArduCopter's mode_auto: a take-off ignores the place it names; a waypoint with a
delay, or with only a stop after it, is flown to a standstill; the others are rounded. Landing at a place first flies
there at the present height. RTL inside the mission is the RTL mode run from here. The mission ends in a hover, or
disarmed if it ends on the ground.

Items that need payload, circles or a ranging sensor are not flown: "do" items of that kind count as done, navigation
items are skipped with a text.
"""

from __future__ import annotations

from sitl.vehicles.builtin.aircraft import Aircraft
from sitl.vehicles.builtin.frame import AltFrame, Location, Vector, shift
from sitl.vehicles.builtin.items import Cmd, Item
from sitl.vehicles.builtin.mission import MissionState
from sitl.vehicles.builtin.modes import Mode, Takeoff
from sitl.vehicles.builtin.returning import ReturnToLaunch

__all__ = ["Auto"]

#: AUTO_OPTIONS bits.
_ALLOW_ARMING, _ALLOW_TAKEOFF_WITHOUT_THROTTLE = 1, 2
_SPEED_KINDS = {0: "speed", 1: "speed", 2: "up", 3: "down"}
#: "do" items that are never announced as reached (AP_Mission::verify_command): relay, servo, camera, gripper
_NOT_ANNOUNCED = frozenset((181, 183, 203, 206, Cmd.GRIPPER, 2000, 2001))


class _MissionReturn(ReturnToLaunch):
    """RTL as a mission item: it does not disarm, the mission's end does."""

    done = False

    def init(self, ignore_checks: bool) -> bool:
        self.done = False
        return super().init(ignore_checks)

    def finished(self) -> None:
        self.done = True


class Auto(Mode):
    """Submodes: hold, takeoff, waypoint, land, rtl."""

    number, name, autopilot = 3, "AUTO", True

    def __init__(self, copter: Aircraft) -> None:
        super().__init__(copter)
        self.takeoff = Takeoff(self)
        self.rtl = _MissionReturn(copter)
        self._doing = "hold"
        self._waiting_to_start = False
        self._seen_changes = 0
        self._overrides: dict[str, float] = {}
        self._reached_at_s: float | None = None
        self._flying_to_land = False
        self._condition: tuple[float, float] = (0.0, 0.0)
        self._delay_until_s = 0.0

    # -- mode -----------------------------------------------------------------------------------------------------

    def init(self, ignore_checks: bool) -> bool:
        mission = self.copter.mission
        if not mission.present and not ignore_checks:
            return False
        if self.copter.armed and self.copter.land_complete and not mission.starts_with_takeoff():
            self.copter.say(2, "Auto: Missing Takeoff Cmd")
            return False
        self._doing = "hold"
        self._overrides.clear()
        self._waiting_to_start = True
        self._seen_changes = mission.changes
        self.copter.navigator.begin(self.copter.limits(), self.copter.stopping_point())
        return True

    def exit(self) -> None:
        if self.copter.mission.state is MissionState.RUNNING:
            self.copter.mission.stop()

    def can_arm(self) -> bool:
        return bool(int(self.copter.parameters["AUTO_OPTIONS"]) & _ALLOW_ARMING)

    def run(self, dt: float) -> None:
        copter = self.copter
        if self._waiting_to_start:
            if copter.origin is not None:
                copter.mission.start_or_resume()
                self._waiting_to_start = False
                self._seen_changes = copter.mission.changes
        else:
            self._notice_changes()
            copter.mission.update()
        if not copter.armed:
            return
        if self._doing == "takeoff":
            if int(copter.parameters["AUTO_OPTIONS"]) & _ALLOW_TAKEOFF_WITHOUT_THROTTLE:
                copter.auto_armed = True
            if self.takeoff.complete and not copter.land_complete:
                self.brake(dt)
            else:
                self.takeoff.run(dt)
        elif self._doing == "land":
            self.descend(dt)
        elif self._doing == "rtl":
            self.rtl.run(dt)
        elif not self.grounded():
            if self._doing == "waypoint":
                self.follow(dt)
            else:
                self.brake(dt)

    def pause(self) -> bool:
        if self._doing != "waypoint" or self.copter.navigator.reached:
            return False
        self.copter.navigator.paused = True
        return True

    def resume(self) -> bool:
        self.copter.navigator.paused = False
        return True

    @property
    def paused(self) -> bool:
        return self.copter.navigator.paused

    def change_speed(self, kind: str, value_m_s: float) -> bool:
        self._overrides[kind] = value_m_s
        self.copter.navigator.set_limits(**{kind: value_m_s})
        return True

    def target(self) -> Vector | None:
        if self._doing == "rtl":
            return self.rtl.target()
        return self.copter.navigator.destination if self._doing == "waypoint" else None

    @property
    def landing(self) -> bool:
        return self._doing == "land" or (self._doing == "rtl" and self.rtl.landing)

    @property
    def taking_off(self) -> bool:
        return self._doing == "takeoff" and not self.takeoff.complete

    # -- mission --------------------------------------------------------------------------------------------------

    def start_command(self, index: int, item: Item) -> bool:
        """Begin an item; False: cannot be flown, try the next."""
        if item.command == Cmd.TAKEOFF:
            self._start_takeoff(item)
        elif item.command in (Cmd.WAYPOINT, Cmd.SPLINE_WAYPOINT, Cmd.LOITER_UNLIM, Cmd.LOITER_TIME):
            self._start_waypoint(index, item)
        elif item.command == Cmd.LAND:
            self._start_land(item)
        elif item.command == Cmd.RTL:
            self.rtl.init(True)
            self._doing = "rtl"
        elif item.command == Cmd.DELAY:
            self._delay_until_s = self.copter.time_s + item.param1
            self.copter.say(6, f"Delaying {int(item.param1)} sec")
        elif item.command == Cmd.CONDITION_DELAY:
            self._condition = (self.copter.time_s, item.param1)
        elif item.command == Cmd.CONDITION_DISTANCE:
            self._condition = (0.0, item.param1)
        elif item.command == Cmd.CHANGE_SPEED:
            kind = _SPEED_KINDS.get(int(item.param1))
            if kind is not None and item.param2 > 0:
                self.change_speed(kind, item.param2)
        elif item.command == Cmd.SET_HOME:
            here = self.copter.location()
            self.copter.set_home(here if item.param1 == 1 else self._absolute(item, here), lock=False)
        elif item.command == Cmd.GRIPPER:
            # said whether or not a gripper is fitted, as ArduCopter does
            self.copter.say(6, f"Gripper {'Grabbed' if item.param2 else 'Released'}")
        elif item.command < Cmd.CONDITION_DELAY:
            self.copter.say(4, f"Mission: {index} not modelled, skipped")
            return False
        return True

    def verify_command(self, index: int, item: Item) -> bool:
        """Whether an item is done; announces it if it is, but for those that ArduPilot does not announce."""
        done = self._done(index, item)
        if done and item.command not in _NOT_ANNOUNCED:
            self.copter.listener.item_reached(index)
        return done

    def mission_complete(self) -> None:
        """End the mission: no item is left."""
        if self.copter.land_complete:
            self.copter.disarm()
        self._doing = "hold"

    def _done(self, index: int, item: Item) -> bool:
        copter = self.copter
        if item.command == Cmd.TAKEOFF:
            return self.takeoff.complete
        if item.command in (Cmd.WAYPOINT, Cmd.SPLINE_WAYPOINT, Cmd.LOITER_TIME):
            return self._waited(index, item.param1)
        if item.command == Cmd.LOITER_UNLIM:
            return False
        if item.command == Cmd.LAND:
            return self._verify_land()
        if item.command == Cmd.RTL:
            return self.rtl.done or (self.rtl.stage == "descend" and copter.spooled_down)
        if item.command == Cmd.DELAY:
            return copter.time_s >= self._delay_until_s
        if item.command == Cmd.CONDITION_DELAY:
            return copter.time_s - self._condition[0] > max(self._condition[1], 0.0)
        if item.command == Cmd.CONDITION_DISTANCE:
            return copter.navigator.distance_m(copter.body.position) < max(self._condition[1], 0.0)
        return True

    def _waited(self, index: int, delay_s: float) -> bool:
        copter = self.copter
        if not copter.navigator.reached:
            return False
        if self._reached_at_s is None:
            self._reached_at_s = copter.time_s
        if copter.time_s - self._reached_at_s < delay_s:
            return False
        copter.say(6, f"Reached command #{index}")
        return True

    def _verify_land(self) -> bool:
        copter = self.copter
        if self._flying_to_land:
            if copter.navigator.reached:
                self._flying_to_land = False
                self._doing = "land"
            return False
        if copter.spooled_down:
            copter.disarm()
        return False

    # -- items ----------------------------------------------------------------------------------------------------

    def _start_takeoff(self, item: Item) -> None:
        copter = self.copter
        wanted = copter.local(self._absolute(item, copter.location()))[2]
        self.takeoff.begin(max(wanted, copter.body.position[2] + (1.0 if copter.land_complete else 0.0)))
        self._doing = "takeoff"

    def _start_waypoint(self, index: int, item: Item) -> None:
        self._fly_to(self.copter.item_location(item, self._default()))
        self._reached_at_s = None
        if item.param1 > 0 and item.command != Cmd.LOITER_UNLIM:
            return
        follower = self.copter.mission.next_nav(index + 1)
        onward = self.copter.mission.read(follower) if follower is not None else None
        stops = (Cmd.WAYPOINT, Cmd.LOITER_UNLIM, Cmd.LOITER_TIME, Cmd.SPLINE_WAYPOINT)
        if onward is not None and onward.command in stops and item.command in (Cmd.WAYPOINT, Cmd.SPLINE_WAYPOINT):
            place = self.copter.item_location(onward, self.copter.item_location(item, self._default()))
            self.copter.navigator.then(self.copter.local(place))

    def _start_land(self, item: Item) -> None:
        self._flying_to_land = item.x != 0 or item.y != 0
        if not self._flying_to_land:
            self._doing = "land"
            return
        self._fly_to(Location(item.x, item.y, self.copter.above_home_m(), AltFrame.ABOVE_HOME))

    def _fly_to(self, place: Location) -> None:
        copter = self.copter
        navigator = copter.navigator
        if self._doing != "waypoint" or not navigator.reached:
            begin = copter.stopping_point()
            if self._doing == "takeoff":
                begin = (*copter.body.position[:2], self.takeoff.height_m)
            navigator.begin(copter.limits(), begin)
            navigator.set_limits(**self._overrides)
        navigator.fly_to(copter.local(place), copter.body.ground_speed_m_s)
        self._doing = "waypoint"

    def _default(self) -> Location:
        """The place that zero fields of an item mean: the last destination if it was reached, else here."""
        copter = self.copter
        if self._doing == "waypoint" and copter.navigator.reached:
            n, e, u = copter.navigator.destination
            place = copter.location()
            here = copter.local(place)
            lat, lon = shift(place, n - here[0], e - here[1])
            return Location(lat, lon, copter.start.alt_m + u)
        return copter.location()

    def _absolute(self, item: Item, here: Location) -> Location:
        """The item's place with zero altitude taken as it stands."""
        frame = AltFrame.ABSOLUTE if item.frame == 0 else AltFrame.ABOVE_HOME
        lat, lon = (here.lat_e7, here.lon_e7) if item.x == 0 and item.y == 0 else (item.x, item.y)
        return Location(lat, lon, item.z, frame)

    def _notice_changes(self) -> None:
        mission = self.copter.mission
        if mission.changes == self._seen_changes:
            return
        self._seen_changes = mission.changes
        if mission.state is MissionState.RUNNING and self._doing == "waypoint":
            if mission.restart_current():
                self.copter.say(2, "Auto mission changed, restarted command")
            else:
                self.copter.say(2, "Auto mission changed but failed to restart command")

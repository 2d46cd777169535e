# SPDX-License-Identifier: GPL-3.0-or-later

"""The true place of the aircraft, its true consumption, and what its autopilot does by itself.

It flies straight pieces (`Piece`), each at one speed and one power. So place and remaining energy are known for any
moment without stepping. ArduCopter's behaviour is modelled as far as it matters here:

* AUTO: straight up, along the route, down at its end, or the return, which is a mode of its own as it is ArduPlane's. A
  pause brakes it; an aircraft that was carried off flies back.
* RTL: up to the height of the return, straight to the one point of its rally list, which it reads when it begins, a
  pause, down. A second order for it changes nothing; leaving RTL and ordering it again does. LAND: straight down.
* Its own failsafes: a low and an empty battery (RTL, LAND), 8 s without a position (LAND), no heartbeat of the
  commander for 10 s (RTL), the fence (RTL). `world.py` decides when they act.

Consumption, and the effect of the wind, are in `physics.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import hypot, inf
from typing import Final

from sitl.campaign.log import FlightLog, Flown
from sitl.campaign.physics import CLIMB_MPS, DESCENT_MPS, LANDING_BELOW_M, LANDING_MPS, LOITER_S, Physics
from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import Spot
from sitl.campaign.times import NEVER, SECOND, in_ticks

__all__ = ["BY_MISSION", "Aircraft", "Mode"]

#: parts of the full battery at which the autopilot acts by itself, if it does
LOW_PART, EMPTY_PART = 0.12, 0.05
#: deceleration to a stop (m/s^2)
_BRAKING: Final = 2.5
_SLOWEST_MPS: Final = 0.2
#: the source of a return after the last waypoint
BY_MISSION: Final = "mission"


class Mode(Enum):
    """The flight mode."""

    GROUND = "on the ground"
    AUTO = "AUTO"
    PAUSE = "AUTO, held"
    RTL = "RTL"
    LAND = "LAND"
    PILOT = "in a pilot's hands"

    @property
    def comes_down(self) -> bool:
        """Whether it is on its way home, or down."""
        return self in (Mode.RTL, Mode.LAND)


@dataclass(slots=True)
class _Leg:
    """A piece to be flown: to where, how fast (m/s; None: as long as `ticks`), at which power (W)."""

    x_m: float
    y_m: float
    z_m: float
    speed_mps: float
    watts: float
    ticks: int = 0


class Aircraft:
    """One aircraft. Times are ticks; `log` is told of every piece."""

    def __init__(self, plan: FlightPlan, log: FlightLog) -> None:
        self._plan, self._log = plan, log
        self._physics = Physics.of(plan)
        self.mode = Mode.GROUND
        self.by = ""
        self.armed = False
        self._x = self._y = self._z = 0.0
        self._vx = self._vy = self._vz = 0.0
        self._watts = 0.0
        self._begun = 0
        self._ends = NEVER
        self._used_j = 0.0
        self._capacity_j = plan.settings.battery_wh * 3600.0 if plan.settings.battery_wh else inf
        self._legs: list[_Leg] = []
        #: the one of them that is flown
        self._leg = _Leg(0.0, 0.0, 0.0, 0.0, 0.0)
        #: number of the waypoint that is flown to
        self.waypoint = 0
        #: speed at which wind carries it away, east and north (m/s)
        self.drift = (0.0, 0.0)
        self._lift_mps = 0.0
        self.landed_at: Spot | None = None
        #: the one point of its rally list: the return site of every return
        self.rally: Spot = plan.places[0]
        #: one of its own failsafes has acted; it is outside its fence; its returns get nowhere
        self.failsafe = self.breached = False
        self._stuck = False

    # ---- looking ----------------------------------------------------------------------------------------------------

    def at(self, now: int) -> tuple[float, float, float]:
        """East, north and height of this moment."""
        s = (now - self._begun) / SECOND
        return self._x + self._vx * s, self._y + self._vy * s, self._z + self._vz * s

    @property
    def velocity(self) -> tuple[float, float, float]:
        """East, north and up (m/s)."""
        return self._vx, self._vy, self._vz

    @property
    def speed_mps(self) -> float:
        """Over ground."""
        return hypot(self._vx, self._vy)

    def away_m(self, now: int) -> float | None:
        """How far it is to where a return flies to; None: it does not return."""
        if self.mode is not Mode.RTL:
            return None
        x, y, _z = self.at(now)
        leg = next((leg for leg in (self._leg, *self._legs) if leg.speed_mps == inf), None)
        return 0.0 if leg is None else hypot(leg.x_m - x, leg.y_m - y)

    @property
    def lifted(self) -> bool:
        """An updraft has it."""
        return self._lift_mps > 0.0

    @property
    def flying(self) -> bool:
        """Off the ground."""
        return self.mode is not Mode.GROUND

    @property
    def ends(self) -> int:
        """When the piece ends that is flown now."""
        return self._ends

    @property
    def begun(self) -> int:
        """When it began."""
        return self._begun

    @property
    def watts(self) -> float:
        """The power that is really drawn."""
        return self._watts

    @property
    def battery_wh(self) -> float:
        """The true energy of the full battery."""
        return self._capacity_j / 3600.0

    def left_wh(self, now: int) -> float:
        """The energy that is really left."""
        return (self._capacity_j - self._used(now)) / 3600.0

    def _used(self, now: int) -> float:
        return self._used_j + self._watts * (now - self._begun) / SECOND

    def falls_to(self, part: float) -> int:
        """When so much of the full battery is left, as things are; NEVER if that is over."""
        over = self._capacity_j * (1.0 - part) - self._used_j
        if self._watts <= 0.0 or over < 0.0:
            return NEVER
        return self._begun + in_ticks(over / self._watts) + 1

    def way_ahead(self) -> tuple[Spot, ...]:
        """The waypoints that are flown to next, in AUTO."""
        return self._plan.way[self.waypoint :] if self.mode is Mode.AUTO else ()

    # ---- pieces -----------------------------------------------------------------------------------------------------

    def _end_piece(self, now: int) -> None:
        """End the present piece and log it."""
        if now > self._begun:
            place, speed = (self._x, self._y, self._z), (self._vx, self._vy, self._vz)
            left_wh = self.left_wh(self._begun)
            self._log.flown.append(Flown(self._begun, now, *place, *speed, self.mode.name, left_wh, self._watts))
        x, y, z = self.at(now)
        self._used_j = self._used(now)
        self._x, self._y, self._z, self._begun = x, y, max(0.0, z), now
        self._vx = self._vy = self._vz = 0.0
        self._ends = NEVER

    def _fly(self, leg: _Leg, now: int) -> None:
        """Begin a piece; the one before is settled."""
        dx, dy, dz = leg.x_m - self._x, leg.y_m - self._y, leg.z_m - self._z
        length = hypot(dx, dy)
        ticks = leg.ticks
        if leg.speed_mps > 0.0:
            way = length if length > 0.01 else abs(dz)
            ticks = max(1, in_ticks(way / leg.speed_mps))
        seconds = ticks / SECOND
        self._vx, self._vy, self._vz = dx / seconds, dy / seconds, dz / seconds
        self._watts, self._ends = leg.watts * self._plan.truth.power, now + ticks

    def _still(self, now: int, watts: float) -> None:
        self._watts, self._ends = watts * self._plan.truth.power, NEVER

    def _level(self, x_m: float, y_m: float, z_m: float) -> _Leg:
        """Straight there as fast as wind and speed allow."""
        east, north = x_m - self._x, y_m - self._y
        speed, airspeed = self._made_good(east, north)
        return _Leg(x_m, y_m, z_m, speed, self._physics.power_w(airspeed))

    def _made_good(self, east: float, north: float) -> tuple[float, float]:
        """Ground speed and airspeed in that direction, with the wind as it is."""
        ahead, across = self._physics.against(east, north)
        speed = max(_SLOWEST_MPS, min(self._plan.speed_mps, self._physics.most_mps(ahead, across)))
        return speed, min(self._physics.airspeed_mps, hypot(speed + ahead, across))

    def _up(self, z_m: float) -> _Leg:
        return _Leg(self._x, self._y, z_m, CLIMB_MPS, self._physics.climb_w)

    def _down(self, x_m: float, y_m: float, z_m: float) -> list[_Leg]:
        low, watts = min(z_m, LANDING_BELOW_M), self._physics.descent_w
        legs = [_Leg(x_m, y_m, low, DESCENT_MPS, watts)] if z_m > low else []
        return [*legs, _Leg(x_m, y_m, 0.0, LANDING_MPS, watts)]

    # ---- orders -----------------------------------------------------------------------------------------------------

    def _set(self, mode: Mode, by: str, now: int) -> None:
        self._end_piece(now)
        self.mode, self.by, self._legs = mode, by, []
        self.drift, self._lift_mps = (0.0, 0.0), 0.0
        self._log.left.append((now, self.left_wh(now)))
        self._log.mode(now, mode.name, by)

    def take_off(self, now: int) -> None:
        """In AUTO, from the ground."""
        self.armed = True
        self._set(Mode.AUTO, "start", now)
        self._fly(self._up(self._plan.way[0].alt_m), now)

    def resume(self, by: str, now: int) -> None:
        """AUTO: on along the way."""
        if self.flying and self.mode is not Mode.AUTO:
            self._set(Mode.AUTO, by, now)
            self._along(now)

    def pause(self, now: int) -> None:
        """DO_PAUSE_CONTINUE 0: AUTO stops."""
        if self.mode is not Mode.AUTO:
            return
        vx, vy, speed = self._vx, self._vy, self.speed_mps
        self._set(Mode.PAUSE, "hold", now)
        if speed > 0.0:
            ticks = in_ticks(speed / _BRAKING)
            s = ticks / SECOND / 2.0
            self._fly(_Leg(self._x + vx * s, self._y + vy * s, self._z, 0.0, self._physics.cruise_w, ticks), now)
        else:
            self._still(now, self._hover_w)

    def rally_is(self, place: Spot, now: int) -> None:
        """Its rally list is written."""
        self.rally = place
        self._log.rally.set(now, place)

    def return_anew(self, by: str, now: int) -> None:
        """Out of RTL and into it again: the list is read again."""
        if self.mode is Mode.RTL:
            self._return(by, now)

    def come_home(self, by: str, now: int) -> None:
        """RTL; the second order changes nothing."""
        if self.flying and self.mode is not Mode.RTL:
            self._return(by, now)

    def _return(self, by: str, now: int) -> None:
        self._set(Mode.RTL, by, now)
        place = self.rally
        height = max(self._z, place.alt_m, self._physics.return_alt_m)
        if height > self._z + 0.01:
            self._legs.append(self._up(height))
        self._legs.append(_Leg(place.x_m, place.y_m, height, inf, 0.0))
        self._legs.append(_Leg(place.x_m, place.y_m, height, 0.0, self._hover_w, in_ticks(LOITER_S)))
        self._legs += self._down(place.x_m, place.y_m, height)
        self._next(now)

    def land(self, by: str, now: int) -> None:
        """LAND: straight down."""
        if not self.flying or self.mode is Mode.LAND:
            return
        self._set(Mode.LAND, by, now)
        self._legs = self._down(self._x, self._y, self._z)
        self._next(now)

    def pilot_takes_over(self, now: int) -> None:
        """A pilot has it, and hovers."""
        if self.flying:
            self._set(Mode.PILOT, "pilot", now)
            self._still(now, self._hover_w)

    def carried(self, velocity: tuple[float, float], now: int, lift_mps: float = 0.0) -> None:
        """Wind carries it to the side or up, in AUTO; (0, 0): no more, and it flies on from there."""
        if self.mode is not Mode.AUTO:
            return
        self._end_piece(now)
        self.drift, self._lift_mps = velocity, lift_mps
        self._along(now)

    @property
    def _hover_w(self) -> float:
        return self._physics.still_w

    def _along(self, now: int) -> None:
        """Fly to the next waypoint, or do what follows the last one."""
        way = self._plan.way
        if self.waypoint >= len(way):
            self._end_of_way(now)
            return
        spot = way[self.waypoint]
        if self.waypoint == 0 and self._z < spot.alt_m - 0.5:
            self._fly(self._up(spot.alt_m), now)
            return
        leg = self._level(spot.x_m, spot.y_m, spot.alt_m)
        self._fly(leg, now)
        east, north = self.drift
        if self._lift_mps:  # it stays where it is, but for the height
            self._vx = self._vy = 0.0
            self._vz, self._ends = self._lift_mps, NEVER
        elif east or north:
            self._vx, self._vy = self._vx + east, self._vy + north
            self._ends = NEVER  # it gets nowhere until the wind lets it go

    def _end_of_way(self, now: int) -> None:
        if not self._plan.lands:
            self.come_home(BY_MISSION, now)
        elif not self._legs:
            self._legs = self._down(self._x, self._y, self._z)
            self._next(now)

    def _next(self, now: int) -> None:
        if not self._legs:
            self._touch_down(now)
            return
        leg = self._leg = self._legs.pop(0)
        if leg.speed_mps == inf and self._stuck:
            self._legs.insert(0, leg)
            self._still(now, self._physics.cruise_w)
            return
        if leg.speed_mps == inf:
            level = self._level(leg.x_m, leg.y_m, leg.z_m)
            leg = level if hypot(leg.x_m - self._x, leg.y_m - self._y) > 0.5 else self._up(leg.z_m + 0.01)
        self._fly(leg, now)

    def _touch_down(self, now: int) -> None:
        self._end_piece(now)
        self.landed_at = Spot(self._x, self._y)
        self._log.landed = (now, self._x, self._y)
        self.mode, self.armed, self._watts = Mode.GROUND, False, 0.0
        self._log.mode(now, Mode.GROUND.name, self.by)

    def turn(self, now: int) -> None:
        """The piece has come to its end."""
        self._end_piece(now)
        match self.mode:
            case Mode.AUTO if self._legs or self.waypoint >= len(self._plan.way):
                self._next(now)
            case Mode.AUTO:
                self.waypoint += 1
                self._along(now)
            case Mode.RTL | Mode.LAND:
                self._next(now)
            case Mode.PAUSE | Mode.PILOT:
                self._still(now, self._hover_w)
            case Mode.GROUND:
                pass

    # ---- faults -----------------------------------------------------------------------------------------------------

    def stuck(self, is_so: bool, now: int) -> None:
        """A return hangs where it is, or does so no more."""
        self._stuck = is_so
        if self.mode is not Mode.RTL or not any(leg.speed_mps == inf for leg in (self._leg, *self._legs)):
            return
        self._end_piece(now)
        if is_so:
            self._legs.insert(0, self._leg)
        self._next(now)

    def down_wh(self, now: int) -> float:
        """Energy for coming straight down from here, as it is believed.

        A quarter more, and a part of the reserve for the time of the decision.
        """
        return 1.25 * self._physics.down_wh(self.at(now)[2]) + 0.25 * self._physics.reserve_wh

    def home_wh(self, now: int) -> float:
        """The energy that must be left for the return site that needs least, with the reserve."""
        here = self.at(now)
        return self._physics.budget_wh(min(self._physics.home_wh(here, place) for place in self._plan.places))

    def sag(self, left_wh: float, now: int) -> None:
        """No more than that is left. A new piece begins, which goes on as before."""
        velocity, ends = self.velocity, self._ends
        self._end_piece(now)
        (self._vx, self._vy, self._vz), self._ends = velocity, ends
        left = self._capacity_j - self._used(now)
        self._capacity_j -= max(0.0, left - left_wh * 3600.0)

    def falls(self, now: int) -> None:
        """The battery is empty in the air."""
        self._log.empty_at = now
        self._log.note(now, "the battery is empty in the air")
        self._end_piece(now)
        self._z = 0.0
        self._legs = []
        self._touch_down(now)

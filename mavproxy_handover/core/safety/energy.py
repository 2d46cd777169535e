# SPDX-License-Identifier: GPL-3.0-or-later

"""Energy that a way through the air needs, the margin that is left, and the point of no return.

Theory of operation
-------------------
A way is a list of straight pieces (`Piece`). The energy of a piece is power times time:

* Power over airspeed v: P(v) = hover + (cruise - hover) (v / cruise_mps)^3. The power of drag grows with the cube of
  the airspeed. The saving of a rotor in slow forward flight is left out, which is the safe side.
* ArduCopter holds the ground speed that it was told as long as its lean limit allows. That limit is an airspeed, va.
  With wh ahead and wx across, the speed made good is min(told, sqrt(va^2 - wx^2) - wh); 0 or less: the piece is not to
  be flown at all, its need is infinite. A tail wind counts as calm: on the way back it is a head wind.
* Each piece is flown from rest to rest: speeding up and braking cost speed / `ACCELERATION_MPSS` seconds. A piece of a
  curve, through which it flies on, costs nothing of that, and a corner a part (`stops`). Up or down it costs
  speed / `CLIMB_ACCELERATION_MPSS`, on a way that leads anywhere too: a longer way is never the cheaper one.
* Climb, descent and waiting stand against the same wind.
* An aircraft that `holds_airspeed` keeps the commanded airspeed, and the power for it. The wind adds to its ground
  speed, or takes from it, and it flies against a cross wind at an angle. It waits by circling. It goes straight up or
  down on rotors, as a copter does. Each change between wings and rotors takes TRANSITION_S with the power of both.
* A lighter aircraft, once its payload is dropped: hover, climb and descent cost the part of what they did that is left
  of the mass. By momentum theory it is that part to the power of 1.5, which is less; the share that motors and
  propellers keep of that is not known. The part of drag stays, and the airspeed at the lean limit goes with the root of
  the mass: thrust that is tilted as far has to stand against the same drag.

The rule is the point of no return: margin = left - factor x need - reserve. The aircraft may go on until the margin of
the return site is negative. A value that is not known makes the need larger, or the answer "unknown"; it never makes
the need smaller. Energies are watt-hours, powers watts.

Sources: Leishman, Principles of Helicopter Aerodynamics, 5.5 (parasitic power); flights on ArduCopter SITL, where the
cube fits within 1 % at 5 and 10 m/s; ArduCopter's defaults for WPNAV_ACCEL and WPNAV_JERK, WPNAV_SPEED_UP and _DN,
LAND_SPEED, LAND_ALT_LOW, RTL_LOIT_TIME; ArduPlane's Q_TRANSITION_MS and TECS_SINK_MIN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import cos, hypot, inf, isfinite, radians, sin, sqrt
from typing import Final, NamedTuple

__all__ = [
    "ACCELERATION_MPSS",
    "CIRCLE_S",
    "CLIMB_ACCELERATION_MPSS",
    "CLIMB_MPS",
    "DESCENT_MPS",
    "LANDING_BELOW_M",
    "LANDING_MPS",
    "LOITER_S",
    "SINK_MPS",
    "TRANSITION_S",
    "EnergyFact",
    "EnergyModel",
    "MadeGood",
    "Piece",
    "Wind",
    "landing",
    "point_of_no_return",
    "way_home",
]

#: WPNAV_SPEED_UP, WPNAV_SPEED_DN, LAND_SPEED and LAND_ALT_LOW of ArduCopter
CLIMB_MPS, DESCENT_MPS, LANDING_MPS, LANDING_BELOW_M = 2.5, 1.5, 0.5, 10.0
#: of a change from rest to 10 m/s with WPNAV_ACCEL 2.5 m/s^2 and WPNAV_JERK 1 m/s^3, as if it were even: it takes 6.5 s
ACCELERATION_MPSS: Final = 1.5
#: WPNAV_ACCEL_Z
CLIMB_ACCELERATION_MPSS: Final = 1.0
#: RTL_LOIT_TIME: how long a return waits above its place before it comes down
LOITER_S: Final = 5.0
#: and what has wings: one circle of 90 m, at 20 m/s
CIRCLE_S: Final = 30.0
#: how fast it sinks while it circles, at the least: TECS_SINK_MIN
SINK_MPS: Final = 2.0
#: from wings to rotors and back, with both at work: Q_TRANSITION_MS 5 s, and as much to get to the speed
TRANSITION_S: Final = 10.0
_SECONDS_AN_HOUR: Final = 3600.0


@dataclass(frozen=True, slots=True)
class Wind:
    """Horizontal wind: its speed (m/s), and the direction that it comes from (degrees from north, clockwise)."""

    speed_mps: float
    from_deg: float

    def against(self, bearing_deg: float) -> tuple[float, float]:
        """Head wind (m/s; 0 for a tail wind) and cross wind (m/s) of a flight in that direction."""
        angle = radians(self.from_deg - bearing_deg)
        return max(0.0, self.speed_mps * cos(angle)), abs(self.speed_mps * sin(angle))


class Piece(NamedTuple):
    """A straight piece of a way. Lengths in metres, none negative; directions in degrees from north.

    `length_m` is horizontal, `climb_m` and `descent_m` are what it gains and loses on it. `landing_m` of the descent is
    flown as slowly as ArduCopter lands. `hold_s` is waited at its end. `speed_mps` is the ground speed that the
    autopilot was told, None: the cruise speed of the model. `unloaded`: the payload is dropped before it. `stops`: the
    part of a start from rest and of a stop that its ends cost. 1: both, 0: neither. `hovers`: an aircraft with wings
    flies it on its rotors.
    """

    length_m: float = 0.0
    bearing_deg: float = 0.0
    climb_m: float = 0.0
    descent_m: float = 0.0
    landing_m: float = 0.0
    hold_s: float = 0.0
    speed_mps: float | None = None
    unloaded: bool = False
    stops: float = 1.0
    hovers: bool = False

    @property
    def vertical_s(self) -> float:
        """How long climb, descent and landing take, at the least."""
        down_s = (self.descent_m - self.landing_m) / DESCENT_MPS + self.landing_m / LANDING_MPS
        return self.climb_m / CLIMB_MPS + down_s

    @property
    def vertical_stops_s(self) -> float:
        """How much longer climb or descent takes by speeding up and braking."""
        fastest = CLIMB_MPS if self.climb_m > 0.0 else DESCENT_MPS if self.descent_m > self.landing_m else LANDING_MPS
        size_m = max(self.climb_m, self.descent_m)
        return _duration_s(size_m, fastest, self.stops, CLIMB_ACCELERATION_MPSS) - size_m / fastest


class MadeGood(NamedTuple):
    """How a direction is flown in the wind: ground speed (m/s), 0 where it cannot be flown, and power (W)."""

    speed_mps: float
    power_w: float


@dataclass(frozen=True, slots=True)
class EnergyModel:
    """Energy model of this aircraft: the configured values, corrected by the learned ones.

    Powers in W: `cruise_w` at airspeed `cruise_mps` in level flight, the others at rest in calm air. `airspeed_mps` is
    the fastest airspeed that it can hold. `wind` None: it is not known, and `headwind_mps` blows from ahead wherever it
    flies. `unloaded_part`: what its mass is without the payload, as a part of what it is now; 1 where there is none.
    `holds_airspeed`: it flies on wings, and what it is told is an airspeed; the powers of hovering are its rotors'.
    """

    battery_wh: float
    hover_w: float
    cruise_w: float
    climb_w: float
    descent_w: float
    cruise_mps: float
    airspeed_mps: float
    headwind_mps: float
    #: what a need is multiplied with, and what has to be left beyond it
    reserve_factor: float
    reserve_wh: float
    #: RTL_ALT: the height above home at which a return is flown at the least
    return_alt_m: float
    wind: Wind | None = None
    unloaded_part: float = 1.0
    holds_airspeed: bool = False

    @property
    def unloaded(self) -> EnergyModel:
        """The same aircraft without its payload."""
        if self.unloaded_part == 1.0:
            return self
        part = self.unloaded_part
        if self.holds_airspeed:  # what a lighter wing saves is not counted on
            return replace(
                self,
                hover_w=self.hover_w * part,
                climb_w=self.climb_w * part,
                descent_w=self.descent_w * part,
                unloaded_part=1.0,
            )
        return replace(
            self,
            hover_w=self.hover_w * part,
            cruise_w=self.hover_w * part + max(0.0, self.cruise_w - self.hover_w),
            climb_w=self.climb_w * part,
            descent_w=self.descent_w * part,
            airspeed_mps=self.airspeed_mps * sqrt(part),
            unloaded_part=1.0,
        )

    def power_w(self, airspeed_mps: float) -> float:
        """Power in level flight at that airspeed; never less than that of hovering, or on wings that of cruising."""
        if self.holds_airspeed:
            return self.cruise_w * max(1.0, airspeed_mps / self.cruise_mps) ** 3
        more_w = max(0.0, self.cruise_w - self.hover_w)
        return self.hover_w + more_w * (airspeed_mps / self.cruise_mps) ** 3

    def made_good(self, bearing_deg: float, speed_mps: float | None = None) -> MadeGood:
        """Speed and power in that direction at this commanded speed (None: the cruise speed).

        `speed_mps` is over ground, or with wings through the air.
        """
        told = self.cruise_mps if speed_mps is None else speed_mps
        ahead, across = (self.headwind_mps, 0.0) if self.wind is None else self.wind.against(bearing_deg)
        airspeed = min(told, self.airspeed_mps) if self.holds_airspeed else self.airspeed_mps
        if across >= airspeed:
            return MadeGood(0.0, inf)
        speed = min(told, sqrt(airspeed**2 - across**2) - ahead)
        if speed <= 0.0:
            return MadeGood(0.0, inf)
        if self.holds_airspeed:
            return MadeGood(speed, self.power_w(airspeed))
        return MadeGood(speed, self.power_w(hypot(speed + ahead, across)))

    def piece_wh(self, piece: Piece) -> float:
        """What one piece costs this aircraft; infinite where the wind does not let it be flown."""
        return self.need_wh((piece,))

    def _hanging_wh(self, piece: Piece, still_w: float) -> float:
        """A piece that is flown on rotors alone; `still_w`: the power of standing against the wind."""
        level_w, level_s = still_w, 0.0
        if piece.length_m > 0.0:
            made = self.made_good(piece.bearing_deg, piece.speed_mps)
            if made.speed_mps <= 0.0:
                return inf
            level_w, level_s = max(made.power_w, still_w), _duration_s(piece.length_m, made.speed_mps, piece.stops)
        vertical_s = piece.vertical_s + piece.vertical_stops_s
        joules = level_w * max(level_s, vertical_s) + still_w * piece.hold_s
        if vertical_s > 0.0:
            climb_s = vertical_s if piece.descent_m == 0.0 else piece.climb_m / CLIMB_MPS
            joules += (self.climb_w - self.hover_w) * climb_s + (self.descent_w - self.hover_w) * (vertical_s - climb_s)
        return max(0.0, joules) / _SECONDS_AN_HOUR

    def _on_wings_wh(self, piece: Piece) -> float:
        """A piece that leads anywhere is flown on the wings, climbing and sinking on its way; another one by rotors."""
        climb_s, vertical_s = piece.climb_m / CLIMB_MPS, piece.vertical_s
        joules = (self.climb_w - self.hover_w) * climb_s
        if piece.length_m > 0.0:
            made = self.made_good(piece.bearing_deg, piece.speed_mps)
            if made.speed_mps <= 0.0:
                return inf
            power_w = self.hover_w if piece.hovers else made.power_w
            joules += power_w * (max(piece.length_m / made.speed_mps, climb_s) + piece.hold_s)
        elif vertical_s > 0.0:
            transition_s = piece.stops * TRANSITION_S
            joules += self.hover_w * (vertical_s + piece.hold_s) + (self.hover_w + self.cruise_w) * transition_s
            joules += (self.descent_w - self.hover_w) * (vertical_s - climb_s)
        else:
            joules += self.cruise_w * piece.hold_s
        return max(0.0, joules) / _SECONDS_AN_HOUR

    def need_wh(self, way: Iterable[Piece]) -> float:
        """What a way costs, without any reserve; infinite where the wind does not let it be flown."""
        wind_mps = self.headwind_mps if self.wind is None else self.wind.speed_mps
        still_w = self.power_w(min(wind_mps, self.airspeed_mps))
        light, light_still_w = self.unloaded, still_w
        if light is not self:
            light_still_w = light.power_w(min(wind_mps, light.airspeed_mps))
        total = 0.0
        for piece in way:
            model, hanging_w = (light, light_still_w) if piece.unloaded else (self, still_w)
            total += model._on_wings_wh(piece) if self.holds_airspeed else model._hanging_wh(piece, hanging_w)
        return total

    def budget_wh(self, need_wh: float) -> float:
        """Energy that a way of that need takes from the budget: the need with its factor, and the reserve."""
        return self.reserve_factor * need_wh + self.reserve_wh

    def margin_wh(self, left_wh: float, way: Iterable[Piece]) -> float:
        """Energy beyond the budget of a way; negative: do not begin it, -infinite: it cannot be flown."""
        return left_wh - self.budget_wh(self.need_wh(way))


def _duration_s(length_m: float, speed_mps: float, stops: float, acceleration: float = ACCELERATION_MPSS) -> float:
    """Time of a piece with that part of a start and a stop. A piece too short for the speed never gets to it."""
    if length_m < stops * speed_mps**2 / acceleration:
        return 2.0 * sqrt(stops * length_m / acceleration)
    return length_m / speed_mps + stops * speed_mps / acceleration


def landing(alt_m: float) -> Piece:
    """Straight down from that height above the ground."""
    height = max(0.0, alt_m)
    return Piece(descent_m=height, landing_m=min(height, LANDING_BELOW_M))


def way_home(
    distance_m: float,
    bearing_deg: float,
    alt_m: float,
    place_alt_m: float,
    return_alt_m: float,
    *,
    speed_mps: float | None = None,
    climbs_on_way: bool = False,
    down: Sequence[Piece] | None = None,
) -> tuple[Piece, ...]:
    """The way of RTL to a return site: up to the return height, straight there, a pause, and down.

    Heights above home. `place_alt_m`: that of a rally point is a floor for the return, as `return_alt_m` is; where the
    aircraft is higher, it stays there. The ground at the place is taken to be as high as home. `speed_mps`: as in
    `Piece`. `climbs_on_way`: and it circles once above the place. `down`: so it comes down from there, on
    its wings, once it has circled down to these floors; None: straight.
    """
    height = max(alt_m, place_alt_m, return_alt_m)
    if climbs_on_way:
        sinks_s = 0.0 if down is None else (height - max(place_alt_m, return_alt_m)) / SINK_MPS
        there = Piece(
            length_m=distance_m,
            bearing_deg=bearing_deg,
            climb_m=height - alt_m,
            hold_s=CIRCLE_S + sinks_s,
            speed_mps=speed_mps,
        )
        return (there, landing(height)) if down is None else (there, *down)
    there = Piece(length_m=distance_m, bearing_deg=bearing_deg, hold_s=LOITER_S, speed_mps=speed_mps)
    return (Piece(climb_m=height - alt_m), there, landing(height)) if height > alt_m else (there, landing(height))


def point_of_no_return(margin_wh: Callable[[float], float], places_m: Sequence[float]) -> float | None:
    """The first distance along a route (m, to half a metre) without a way back; None: there is always one.

    `margin_wh` gives the margin of the return site at a distance along the route. It is called at `places_m`, which
    rise, and between two of them where the margin changes its sign.
    """
    before: float | None = None
    for place in places_m:
        if margin_wh(place) >= 0.0:
            before = place
            continue
        if before is None:
            return place
        low, high = before, place
        while high - low > 0.5:
            middle = (low + high) / 2.0
            low, high = (middle, high) if margin_wh(middle) >= 0.0 else (low, middle)
        return high
    return None


@dataclass(frozen=True, slots=True)
class EnergyFact:
    """State of energy at monotonic time `at` (s).

    `left_wh` None: not known. `power_w`: drawn now, None: not measured. `model` None: nothing was configured, or too
    little (`missing` says what); then nothing can be said of any way. `wind_source`: where `model.wind` comes from, in
    a word, "" without one. `learned`: the model is more than what was configured. `trouble`: what is odd, in words.
    """

    at: float
    left_wh: float | None = None
    power_w: float | None = None
    model: EnergyModel | None = None
    wind_source: str = ""
    learned: bool = False
    trouble: tuple[str, ...] = ()
    missing: str = ""

    def margin_wh(self, way: Iterable[Piece]) -> float | None:
        """The margin of a way that begins here and now; None: not known. See `EnergyModel.margin_wh`."""
        if self.model is None or self.left_wh is None:
            return None
        return self.model.margin_wh(self.left_wh, way)

    def words(self) -> str:
        """All that for people, in one line."""
        model = self.model
        if model is None:
            return f"unknown: {self.missing}"
        left = "what is left is not known" if self.left_wh is None else f"{self.left_wh:.1f} Wh"
        parts = [f"{left} of {model.battery_wh:.1f} Wh left" if self.left_wh is not None else left]
        if self.power_w is not None:
            parts.append(f"{self.power_w:.0f} W")
        if model.wind is not None:
            parts.append(f"wind {model.wind.speed_mps:.1f} m/s from {model.wind.from_deg:.0f} ({self.wind_source})")
        else:
            parts.append(f"wind not known, {model.headwind_mps:.1f} m/s from ahead")
        parts.append("learned" if self.learned else "as configured")
        return ", ".join([*parts, *self.trouble])

    def shortfall(self, need_wh: float) -> str:
        """Why a way of that need must not be begun, in words; "" where it may."""
        if self.model is None:
            return ""
        if not isfinite(need_wh):
            return "the wind does not let it be flown"
        budget = self.model.budget_wh(need_wh)
        if self.left_wh is None:
            return f"{budget:.1f} Wh are needed with the reserve, and what is left is not known"
        if self.left_wh < budget:
            return f"{budget:.1f} Wh are needed with the reserve, {self.left_wh:.1f} Wh are left"
        return ""

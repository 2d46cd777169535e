# SPDX-License-Identifier: GPL-3.0-or-later

"""Learning of energy values in flight: power by phase, the airspeed that can be held, the wind.

Rules:

1. One sample a second. A value counts as the middle one of the last `RECENT` of its kind, so a single wild one is
   nothing; what is no number, or no number that an aircraft can have, is dropped.
2. What was configured weighs as much as `PRIOR_WEIGHT` samples, and what was learned never makes a need smaller than
   what was seen recently: of the long run and the last samples the dearer one holds. It goes no lower than `LEAST_PART`
   of what was configured, and as high as it is seen.
3. The motion tells the phase that a power belongs to. What it takes to cruise is brought down only by samples whose
   airspeed is known and near that of cruise. A sample in an unknown wind, or with an airspeed well below cruise, as in
   a strong tail wind, can only raise it.
4. Wind has three sources, the best first: the autopilot's WIND message; the lean in steady flight, if the drag of the
   airframe is configured; the lean limit, where the airspeed is the fastest that it holds. ArduPilot sends WIND with
   speed 0 without an estimate. Its value is raised by `WIND_READS_LOW`: in five flights of ArduCopter in SITL, in 3 to
   9 m/s, the wind was 1.00 to 1.25 of it, 1.09 in the mean. Without a source for `WIND_S`, the last known speed counts
   for `REMEMBERED_S`, or the configured one if that is more. It is a head wind in every direction. Of the last samples
   the strongest counts.
5. What was learned with a payload on board is brought down, by the mass, to what it takes without it, once it is
   dropped; what was seen last is forgotten then. If it is still there, the next samples say so: the dearer one holds.
6. The airspeed that it holds is learned at the lean limit, by the autopilot's wind alone: the others rest on it.
7. An aircraft with wings holds the commanded airspeed. So every steady level flight teaches the power of cruise. The
   power of climb and sink on the wings is not learned. It leans to turn, so its lean says nothing about the wind.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from math import atan2, cos, degrees, hypot, inf, isfinite, radians, sin, sqrt, tan
from statistics import median
from typing import Final

from mavproxy_handover.core.safety.energy import EnergyModel, Wind
from mavproxy_handover.core.safety.energy_prior import ON_ROTORS, EnergyPrior, EnergySettings

__all__ = [
    "LEAST_PART",
    "PRIOR_WEIGHT",
    "RECENT",
    "REMEMBERED_S",
    "WIND_READS_LOW",
    "WIND_S",
    "Learner",
    "Motion",
    "thrust_direction",
]

RECENT: Final = 15
PRIOR_WEIGHT: Final = 30
WIND_READS_LOW: Final = 1.09
LEAST_PART: Final = 0.5
WIND_S: Final = 60.0
REMEMBERED_S: Final = 900.0
#: samples that a slow mean remembers
_MEMORY: Final = 120
#: samples that make a middle value worth its name
_ENOUGH: Final = 5
_MOST_W: Final = 200_000.0
_MOST_WIND_MPS: Final = 60.0
#: the airspeed may be learned this much higher than configured, as a part of it
_MOST_AIRSPEED_PART: Final = 1.3
#: rising or sinking faster than this is climb or descent, slower over ground than the second is hover (m/s)
_VERTICAL_MPS, _HOVER_MPS = 0.5, 1.5
#: part of the cruise airspeed from which on a sample tells what cruising takes
_NEAR_CRUISE: Final = 0.8
#: steady: no more change of speed than this in a second (m/s)
_STEADY_MPS: Final = 0.5
#: part of the lean limit that counts as being at it
_AT_LIMIT: Final = 0.93
_GRAVITY_MPSS: Final = 9.80665
#: words of the sources of wind, the best one first
_AUTOPILOT, _LEAN, _LIMIT = "autopilot", "lean", "lean limit"


@dataclass(frozen=True, slots=True)
class Motion:
    """How the aircraft moves: speeds over ground (m/s), lean (degrees) and where its thrust pushes it (degrees from
    north). `power_w` None: not measured."""

    north_mps: float
    east_mps: float
    up_mps: float
    lean_deg: float
    lean_to_deg: float
    power_w: float | None

    @property
    def ground_mps(self) -> float:
        """Ground speed."""
        return hypot(self.north_mps, self.east_mps)


def thrust_direction(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float]:
    """Lean and the direction of it, both in degrees, of MAVLink's ATTITUDE; the second from north."""
    down = cos(roll_rad) * cos(pitch_rad)
    forward, right = -cos(roll_rad) * sin(pitch_rad), sin(roll_rad)
    north = forward * cos(yaw_rad) - right * sin(yaw_rad)
    east = forward * sin(yaw_rad) + right * cos(yaw_rad)
    return degrees(atan2(hypot(north, east), down)), degrees(atan2(east, north)) % 360.0


class _Level:
    """A learned value beside the configured one. `sign` 1: a larger value costs more energy, -1: a smaller one."""

    __slots__ = ("_count", "_least", "_most", "_recent", "_sign", "_slow")

    def __init__(self, configured: float, least: float, most: float, sign: int) -> None:
        self._slow = configured
        self._least, self._most = least, most
        self._sign = sign
        self._count = 0
        self._recent: deque[float] = deque(maxlen=RECENT)

    def add(self, value: float) -> None:
        """One sample."""
        self._recent.append(value)
        self._count += 1
        weight = min(PRIOR_WEIGHT + self._count, _MEMORY)
        self._slow += (median(self._recent) - self._slow) / weight

    @property
    def learned(self) -> bool:
        """Whether what was seen weighs as much as what was configured."""
        return self._count >= PRIOR_WEIGHT

    @property
    def value(self) -> float:
        """The dearer one of the long run and of the last samples."""
        bounded = min(max(self._slow, self._least), self._most)
        if len(self._recent) < _ENOUGH:
            return bounded
        recent = median(self._recent)
        return max(bounded, recent) if self._sign > 0 else min(bounded, recent)

    def scale(self, part: float) -> None:
        """All of it is that part of what it was, and what was seen last says nothing any more."""
        self._slow *= part
        self._least, self._most = self._least * part, self._most * part
        self._recent.clear()


def _power_level(configured_w: float) -> _Level:
    return _Level(configured_w, LEAST_PART * configured_w, inf, 1)


class _Winds:
    """The wind by one source: the middle of its last samples, and the strongest such in so many."""

    __slots__ = ("_at", "_east", "_north", "_speeds")

    def __init__(self) -> None:
        self._north: deque[float] = deque(maxlen=RECENT)
        self._east: deque[float] = deque(maxlen=RECENT)
        self._speeds: deque[float] = deque(maxlen=RECENT)
        self._at = -inf

    def add(self, north_mps: float, east_mps: float, now: float) -> None:
        """Wind that blows so fast towards north and east."""
        if not (isfinite(north_mps) and isfinite(east_mps)) or hypot(north_mps, east_mps) > _MOST_WIND_MPS:
            return
        if now - self._at > WIND_S:
            self._north.clear()
            self._east.clear()
            self._speeds.clear()
        self._north.append(north_mps)
        self._east.append(east_mps)
        self._speeds.append(hypot(median(self._north), median(self._east)))
        self._at = now

    def wind(self, now: float) -> Wind | None:
        """What it says; None: nothing, or nothing of late."""
        if len(self._north) < _ENOUGH or now - self._at > WIND_S:
            return None
        from_deg = degrees(atan2(-median(self._east), -median(self._north))) % 360.0
        return Wind(max(list(self._speeds)[_ENOUGH - 1 :]), from_deg)


class Learner:
    """Learns one flight after the other, from the numbers of `settings` on. Times are monotonic seconds."""

    def __init__(self, settings: EnergySettings, usual: EnergyPrior = ON_ROTORS) -> None:
        """`usual`: what counts where the settings say nothing. Raises ValueError if there is no model to learn from."""
        prior = settings.model(prior=usual)
        if prior is None:
            raise ValueError(settings.missing_for(usual))
        self._prior: EnergyModel = prior
        self._configured = prior
        self._lean_limit_deg = settings.lean_limit_deg
        self._drag = self._drag_loaded = (settings.drag_per_s or 0.0, settings.drag_per_m or 0.0)
        self._hover, self._cruise = _power_level(prior.hover_w), _power_level(prior.cruise_w)
        self._climb, self._descent = _power_level(prior.climb_w), _power_level(prior.descent_w)
        most = _MOST_AIRSPEED_PART * prior.airspeed_mps
        self._airspeed = _Level(prior.airspeed_mps, LEAST_PART * prior.airspeed_mps, most, -1)
        self._winds = {word: _Winds() for word in (_AUTOPILOT, _LEAN, _LIMIT)}
        #: the payload is on board, as far as is known
        self._loaded = True
        #: the last wind that was known: its speed, and when
        self._last_wind = (0.0, -inf)
        self._before: Motion | None = None
        self._now = -inf

    @property
    def learned(self) -> bool:
        """Whether the flight has had a say."""
        return any(level.learned for level in (self._hover, self._cruise, self._climb, self._descent))

    def carry(self, loaded: bool) -> None:
        """Whether the payload is on board. On the ground it counts as loaded again."""
        if loaded == self._loaded:
            return
        self._loaded = loaded
        heavy, light = self._configured, self._configured.unloaded
        before, self._prior = self._prior, heavy if loaded else light
        for level, old, new in (
            (self._hover, before.hover_w, self._prior.hover_w),
            (self._cruise, before.cruise_w, self._prior.cruise_w),
            (self._climb, before.climb_w, self._prior.climb_w),
            (self._descent, before.descent_w, self._prior.descent_w),
            (self._airspeed, before.airspeed_mps, self._prior.airspeed_mps),
        ):
            level.scale(new / old)
        lighter = 1.0 if loaded else heavy.unloaded_part
        self._drag = (self._drag_loaded[0] / lighter, self._drag_loaded[1] / lighter)

    def wind_seen(self, speed_mps: float, from_deg: float, now: float) -> None:
        """The autopilot's WIND message. Speed 0 is how it says that it has no estimate."""
        if not (isfinite(speed_mps) and isfinite(from_deg)) or not 0.0 < speed_mps <= _MOST_WIND_MPS:
            return
        angle, speed = radians(from_deg), WIND_READS_LOW * speed_mps
        self._winds[_AUTOPILOT].add(-speed * cos(angle), -speed * sin(angle), now)

    def fly(self, motion: Motion, now: float) -> None:
        """One second in the air."""
        numbers = (motion.north_mps, motion.east_mps, motion.up_mps, motion.lean_deg, motion.lean_to_deg)
        before, self._before = self._before, None
        if not all(isfinite(number) for number in numbers) or motion.ground_mps > 2.0 * _MOST_WIND_MPS:
            return
        gap_s, self._now, self._before = now - self._now, now, motion
        if before is None or gap_s > 2.0:
            return
        changes = (motion.north_mps - before.north_mps, motion.east_mps - before.east_mps)
        steady = hypot(*changes) <= _STEADY_MPS and abs(motion.up_mps) <= _VERTICAL_MPS
        if steady and not self._prior.holds_airspeed:
            self._learn_wind(motion, now)
        self._learn_power(motion, steady, now)

    def _learn_wind(self, motion: Motion, now: float) -> None:
        at_limit = motion.lean_deg >= _AT_LIMIT * self._lean_limit_deg
        angle = radians(motion.lean_to_deg)
        by_lean = self._airspeed_of(motion.lean_deg)
        for word, airspeed in ((_LEAN, by_lean), (_LIMIT, self._airspeed.value if at_limit else None)):
            if airspeed is not None:
                north, east = motion.north_mps - airspeed * cos(angle), motion.east_mps - airspeed * sin(angle)
                self._winds[word].add(north, east, now)
        own = self._winds[_AUTOPILOT].wind(now)
        if at_limit and own is not None:
            self._airspeed.add(_through_air_mps(motion, own))

    def _airspeed_of(self, lean_deg: float) -> float | None:
        """The airspeed that leans it so far in steady flight; None where its drag is not configured."""
        linear, square = self._drag
        if (linear == 0.0 and square == 0.0) or not 0.0 <= lean_deg < 80.0:
            return None
        pushed = _GRAVITY_MPSS * tan(radians(lean_deg))
        if square == 0.0:
            return pushed / linear
        return (sqrt(linear**2 + 4.0 * square * pushed) - linear) / (2.0 * square)

    def _learn_power(self, motion: Motion, steady: bool, now: float) -> None:
        watts = motion.power_w
        if watts is None or not isfinite(watts) or not 0.0 < watts <= _MOST_W:
            return
        if self._prior.holds_airspeed and motion.ground_mps >= _HOVER_MPS:
            if steady:  # whatever the wind, it flies at the airspeed that it was told
                self._cruise.add(watts)
        elif motion.up_mps > _VERTICAL_MPS:
            self._climb.add(watts)
        elif motion.up_mps < -_VERTICAL_MPS:
            self._descent.add(watts)
        elif motion.ground_mps < _HOVER_MPS:
            self._hover.add(watts)
        elif steady:
            self._learn_cruise(motion, watts, now)

    def _learn_cruise(self, motion: Motion, watts: float, now: float) -> None:
        wind, _source = self._wind(now)
        cruise_mps, hover_w = self._prior.cruise_mps, self._hover.value
        if wind is not None:
            airspeed = _through_air_mps(motion, wind)
            if airspeed >= _NEAR_CRUISE * cruise_mps:
                self._cruise.add(hover_w + (watts - hover_w) * (cruise_mps / airspeed) ** 3)
                return
        if watts > self._cruise.value:
            self._cruise.add(watts)

    def _wind(self, now: float) -> tuple[Wind | None, str]:
        for word, winds in self._winds.items():
            wind = winds.wind(now)
            if wind is not None:
                self._last_wind = (wind.speed_mps, now)
                return wind, word
        return None, ""

    def model(self, now: float) -> tuple[EnergyModel, str]:
        """What flying costs by all that is known, and where its wind comes from, in a word ("": not known)."""
        prior, hover_w = self._prior, self._hover.value
        wind, source = self._wind(now)
        last_mps, last_at = self._last_wind
        model = replace(
            prior,
            hover_w=hover_w,
            cruise_w=self._cruise.value if prior.holds_airspeed else max(hover_w, self._cruise.value),
            climb_w=max(hover_w, self._climb.value),
            descent_w=self._descent.value,
            airspeed_mps=self._airspeed.value,
            headwind_mps=max(prior.headwind_mps, last_mps if now - last_at <= REMEMBERED_S else 0.0),
            wind=wind,
        )
        return model, source


def _through_air_mps(motion: Motion, wind: Wind) -> float:
    """Airspeed of a motion over ground in that wind."""
    angle = radians(wind.from_deg)
    return hypot(motion.north_mps + wind.speed_mps * cos(angle), motion.east_mps + wind.speed_mps * sin(angle))

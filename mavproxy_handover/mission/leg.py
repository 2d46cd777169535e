# SPDX-License-Identifier: GPL-3.0-or-later

"""`Leg`: a straight piece of the flown path, and functions that the paths of all kinds of aircraft share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final

from mavproxy_handover.core.safety.energy import CLIMB_MPS, DESCENT_MPS, LANDING_BELOW_M, LANDING_MPS
from mavproxy_handover.mission.geodesy import distance_m, wrap_longitude_deg
from mavproxy_handover.mission.items import FRAME_ABOVE_SEA, FRAME_ABOVE_TERRAIN, MissionItem
from mavproxy_handover.mission.plan import Route

__all__ = [
    "DEFAULT_CRUISE_MPS",
    "Leg",
    "Place",
    "above_home_m",
    "down",
    "first_pass",
    "duration_s",
    "return_place",
    "rise_m",
    "round_by_round",
]

#: WPNAV_SPEED of ArduCopter, for routes that name no speed
DEFAULT_CRUISE_MPS: Final = 10.0
#: most pieces of unrolled circles; further rounds become time at their end
_MOST_PIECES: Final = 20_000

#: latitude, longitude (degrees), metres above home
Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight piece of the path, flown on the way to item `seq`; altitudes above home, `hold_s` at its end.

    `speed_mps`: the ground speed that the autopilot was told; of wings, the airspeed. `times`: pieces of a circle are
    flown so many times, all of them in turn; length and duration are those of once. `follows`: its height was counted
    from the ground below it. `curved`: it stands for a piece of a circle or of a spline. `rests`: the aircraft stops at
    its end, without waiting. `hovers`: an aircraft with wings flies it on its rotors.
    """

    seq: int
    start: Place
    end: Place
    duration_s: float
    hold_s: float = 0.0
    speed_mps: float = DEFAULT_CRUISE_MPS
    times: int = 1
    follows: bool = False
    curved: bool = False
    rests: bool = False
    hovers: bool = False

    @property
    def length_m(self) -> float:
        """Horizontal length."""
        return distance_m(*self.start[:2], *self.end[:2])

    @property
    def size_m(self) -> float:
        """Length or change of altitude, whichever is more."""
        return max(self.length_m, abs(self.end[2] - self.start[2]))

    def at(self, part: float) -> Place:
        """Latitude, longitude and altitude at `part` (0 to 1) of the leg."""
        (lat, lon, alt), (lat2, lon2, alt2) = self.start, self.end
        return (
            lat + part * (lat2 - lat),
            wrap_longitude_deg(lon + part * wrap_longitude_deg(lon2 - lon)),
            alt + part * (alt2 - alt),
        )


def first_pass(legs: Sequence[Leg]) -> dict[int, tuple[Leg, ...]]:
    """The legs to each item, as it is flown the first time: a jump may lead to it again."""
    found: dict[int, tuple[Leg, ...]] = {}
    for seq, group in groupby(legs, key=lambda leg: leg.seq):
        found.setdefault(seq, tuple(group))
    return found


def round_by_round(legs: Sequence[Leg]) -> tuple[Leg, ...]:
    """The path with each round of a circle as its own legs, in the order of flight."""
    if all(leg.times == 1 for leg in legs):
        return tuple(legs)
    found: list[Leg] = []
    for (_seq, times), group in groupby(legs, key=lambda leg: (leg.seq, leg.times)):
        once = [replace(leg, times=1) for leg in group]
        rounds = max(1, min(times, (_MOST_PIECES - len(found)) // len(once)))
        for _ in range(rounds):
            found += once
        if rounds < times:
            left_s = (times - rounds) * sum(leg.duration_s for leg in once)
            found[-1] = replace(found[-1], hold_s=found[-1].hold_s + left_s)
    return tuple(found)


def duration_s(start: Place, end: Place, speed_mps: float) -> float:
    """Least time of a straight path, by its length or by its change of height."""
    climb = end[2] - start[2]
    vertical = climb / CLIMB_MPS if climb > 0.0 else -climb / DESCENT_MPS
    return max(distance_m(*start[:2], *end[:2]) / speed_mps, vertical)


def rise_m(route: Route, lat_deg: float, lon_deg: float) -> float:
    """Height of the ground there above that at home; 0 if the mission does not have it."""
    rise = None if route.ground is None else route.ground.rise_m(lat_deg, lon_deg)
    return 0.0 if rise is None else rise


def above_home_m(route: Route, item: MissionItem, place: tuple[float, float]) -> float:
    """The height of an item above home, at that place (degrees)."""
    if item.frame == FRAME_ABOVE_TERRAIN:
        return item.alt_m + rise_m(route, *place)
    return item.alt_m - route.home.alt_m if item.frame == FRAME_ABOVE_SEA else item.alt_m


def return_place(route: Route, lat: float, lon: float) -> tuple[float, float]:
    """Where a return from there ends: the expected place, or the nearest of home and the rally points."""
    if route.return_to is not None:
        return route.return_to
    places = [(route.home.lat_deg, route.home.lon_deg), *((point.lat_deg, point.lon_deg) for point in route.rally)]
    return min(places, key=lambda place: distance_m(lat, lon, *place))


def down(seq: int, place: Place) -> Iterator[Leg]:
    """A landing: straight down, the last metres slowly."""
    lat, lon, alt = place
    low = min(alt, LANDING_BELOW_M)
    if alt > low:
        yield Leg(seq, place, (lat, lon, low), (alt - low) / DESCENT_MPS)
    if low > 0.0:
        yield Leg(seq, (lat, lon, low), (lat, lon, 0.0), low / LANDING_MPS)

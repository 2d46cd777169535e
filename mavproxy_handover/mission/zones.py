# SPDX-License-Identifier: GPL-3.0-or-later

"""Zones of coverage, and the finder that turns a position into facts about them.

A zone is a circle or one or more polygons (with holes), edges straight in longitude and latitude. The finder answers
for every station, many times a second: how far is the border, on which side of it is the aircraft, and when will it
be crossed; `borders.py` holds the geometry of it.

Longitudes are counted from -180 to 180, so an area that crosses the 180th meridian is in two parts, or else goes on
beyond 180. Before two areas are laid over each other, both are brought to the same side (`beside`).

Altitude limits are metres above home. They only decide between inside and outside: a margin inside is horizontal, for
an aircraft that cruises just below the ceiling is not about to leave. Outside, the way back counts, upwards too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import shapely
from shapely.affinity import translate
from shapely.geometry import MultiPolygon, Polygon

from mavproxy_handover.core.common.model import ZoneFact
from mavproxy_handover.mission.borders import Border, Circle, CircleBorder, Plane, PolygonBorder, plane_at
from mavproxy_handover.mission.geodesy import beside_deg, distance_m, wrap_longitude_deg

__all__ = ["Circle", "Zone", "ZoneFinder", "beside", "overlap"]

#: slower than this a track says nothing about where the aircraft will be
SLOWEST_TRACK_MPS = 0.5
#: how far ahead `exit_s` looks
HORIZON_S = 300.0
#: how far ahead `ends_s` looks
NEAR_S = 20.0
#: how finely: metres or seconds of flight, whichever is more
_STEP_M, _STEP_S = 5.0, 0.4
#: what is known of a zone that is farther away than this (m) is kept while the aircraft moves by less than this part of
#: the way there: on which side it is stays certain, and how far it is stays as exact as that. No rule asks for more:
#: the widest `leave_margin_m` that can be configured is nearer
KEPT_FROM_M, KEPT_PART = 1100.0, 0.02
#: farther than any two places on earth are from each other
_AROUND_M = 1e8


@dataclass(frozen=True, slots=True)
class Zone:
    """The coverage of one station.

    `area` is a circle, or a shapely polygon or multi-polygon in (longitude, latitude). `station` is the system id;
    altitude limits are metres above home, None where there is none.
    """

    station: int
    station_name: str
    area: Circle | Polygon | MultiPolygon
    name: str = ""
    min_alt_m: float | None = None
    max_alt_m: float | None = None

    def outline(self) -> Polygon | MultiPolygon:
        """The area in (longitude, latitude), perhaps beyond 180; a circle as a polygon of 128 corners."""
        return self.area.outline() if isinstance(self.area, Circle) else self.area

    def altitude_excess_m(self, alt_m: float | None) -> float:
        """How far `alt_m` (above home) is outside the altitude limits; 0 within them, or when it is not known."""
        if alt_m is None:
            return 0.0
        below = 0.0 if self.min_alt_m is None else self.min_alt_m - alt_m
        above = 0.0 if self.max_alt_m is None else alt_m - self.max_alt_m
        return max(0.0, below, above)


def beside(area: Polygon | MultiPolygon, lon_deg: float) -> Polygon | MultiPolygon:
    """The area with every part on the side of the 180th meridian where `lon_deg` is.

    Parts that meet at the meridian, because it cut them in two, are joined.
    """
    if area.is_empty:
        return area
    parts = shapely.get_parts(area)
    turns = [_turns(part, lon_deg) for part in parts]
    if not any(turns):
        return area
    shifted = [translate(part, 360.0 * turn) for part, turn in zip(parts, turns, strict=True)]
    joined = shifted[0] if len(shifted) == 1 else shapely.union_all(shifted)
    assert isinstance(joined, Polygon | MultiPolygon)
    return joined


def _turns(part: Polygon, lon_deg: float) -> int:
    """Whole turns by which the middle of `part` has to be moved to be beside `lon_deg`."""
    west, _, east, _ = part.bounds
    middle: float = (west + east) / 2.0
    return round((beside_deg(middle, lon_deg) - middle) / 360.0)


def overlap(first: Zone, second: Zone) -> Polygon | MultiPolygon:
    """The handover region of two zones in (longitude, latitude), perhaps beyond 180; empty if there is none."""
    lowest = max((z.min_alt_m for z in (first, second) if z.min_alt_m is not None), default=-math.inf)
    highest = min((z.max_alt_m for z in (first, second) if z.max_alt_m is not None), default=math.inf)
    if lowest >= highest:
        return Polygon()
    lon_deg = first.outline().bounds[0]
    common = beside(first.outline(), lon_deg).intersection(beside(second.outline(), lon_deg))
    parts = [part for part in shapely.get_parts(common) if isinstance(part, Polygon)]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


class ZoneFinder:
    """Finds the aircraft's place relative to every zone. Any number of finders may exist.

    Fastest for places that follow each other along a track, because results that stay valid are kept. So the margin of
    a zone that does not hold the aircraft is exact near its border, and elsewhere to `KEPT_PART`; all other results are
    as if each place was the first.
    """

    def __init__(self, zones: Iterable[Zone], *, horizon_s: float = HORIZON_S) -> None:
        """`horizon_s`: how far ahead an exit is looked for."""
        self.zones = tuple(zones)
        self.horizon_s = horizon_s
        self._borders: tuple[tuple[Zone, Border], ...] = tuple(
            (zone, CircleBorder(zone.area) if isinstance(zone.area, Circle) else PolygonBorder(zone.area))
            for zone in self.zones
        )
        #: the last place, and how far the aircraft has moved in all (m)
        self._lat = self._lon = self._moved_m = 0.0
        #: of each zone what is kept, and up to which `_moved_m`
        self._kept: list[tuple[float, ZoneFact | None]] = [(-math.inf, None)] * len(self.zones)

    def holding(self, lat_deg: float, lon_deg: float, alt_m: float | None = None) -> frozenset[int]:
        """System ids of the stations whose zone holds a place (`alt_m` above home)."""
        return frozenset(
            zone.station
            for zone, border in self._borders
            if border.contains(lat_deg, lon_deg) and zone.altitude_excess_m(alt_m) == 0.0
        )

    def facts(
        self,
        lat_deg: float,
        lon_deg: float,
        track_deg: float,
        ground_speed_mps: float,
        alt_m: float | None = None,
        way: Sequence[tuple[float, float]] = (),
    ) -> tuple[ZoneFact, ...]:
        """One fact a zone, in the order of the zones.

        `way`: the places (latitude, longitude) that are flown to next, one after the other; none: straight on.

        `track_deg` is the direction of motion over ground from north, `alt_m` metres above home (None: altitude
        limits are not looked at). A position that is no place on earth gives no facts; a track or speed that is no
        number gives facts without `exit_s`.
        """
        if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0):
            return ()
        plane = plane_at(lat_deg)
        track = math.radians(track_deg) if math.isfinite(track_deg) else 0.0
        moving = math.isfinite(track_deg) and SLOWEST_TRACK_MPS <= ground_speed_mps < math.inf
        reach_m = ground_speed_mps * self.horizon_s if moving else 0.0
        ahead: tuple[tuple[float, float, float], ...] | None = None  # worked out only where a border is near
        # across the 180th meridian the nearest part of an area may be another one
        turned = abs(lon_deg - self._lon) > 180.0
        self._moved_m += _AROUND_M if turned else distance_m(lat_deg, lon_deg, self._lat, self._lon)
        self._lat, self._lon, moved_m = lat_deg, lon_deg, self._moved_m
        found = []
        for number, (until_m, kept) in enumerate(self._kept):
            if moved_m < until_m and kept is not None:
                found.append(kept)
                continue
            zone, border = self._borders[number]
            excess = zone.altitude_excess_m(alt_m)
            margin = border.margin_m(lat_deg, lon_deg, plane)
            exit_s = None
            if margin <= 0.0:
                margin = -math.hypot(margin, excess)
            elif excess > 0.0:
                margin = -excess
            elif margin < reach_m:
                out_m = border.exit_m(lat_deg, lon_deg, plane, math.sin(track), math.cos(track), reach_m)
                exit_s = out_m / ground_speed_mps if out_m <= reach_m else None
            ends_m = None
            if moving and 0.0 < margin < ground_speed_mps * NEAR_S:
                if ahead is None:
                    ahead = _ahead((lat_deg, lon_deg), way, ground_speed_mps, track, plane)
                ends_m = next((far for far, lat, lon in ahead if not border.contains(lat, lon)), None)
            ends_s = None if ends_m is None else ends_m / ground_speed_mps
            beyond = frozenset[int]() if ends_m is None or ahead is None else self._beyond(ends_m, ahead, alt_m)
            fact = ZoneFact(zone.station, margin, exit_s, ends_s, beyond)
            found.append(fact)
            if margin <= -KEPT_FROM_M and zone.min_alt_m is None and zone.max_alt_m is None:
                self._kept[number] = moved_m - KEPT_PART * margin, fact
        return tuple(found)

    def _beyond(self, far_m: float, ahead: Sequence[tuple[float, float, float]], alt_m: float | None) -> frozenset[int]:
        """Stations whose zones hold the last place before that distance."""
        before = next(((lat, lon) for far, lat, lon in reversed(ahead) if far < far_m), None)
        return frozenset() if before is None else self.holding(*before, alt_m)


def _ahead(
    start: tuple[float, float], way: Sequence[tuple[float, float]], speed_mps: float, track: float, plane: Plane
) -> tuple[tuple[float, float, float], ...]:
    """Places on the way of the next NEAR_S seconds: how far each is (m), latitude, longitude (degrees)."""
    reach_m, step_m = speed_mps * NEAR_S, max(_STEP_M, speed_mps * _STEP_S)
    legs = list(pairwise([start, *way]))
    if not legs:
        straight = reach_m * math.cos(track) / plane.per_lat, reach_m * math.sin(track) / plane.per_lon
        legs = [(start, (start[0] + straight[0], start[1] + straight[1]))]
    found = []
    flown_m = 0.0
    for (lat, lon), (to_lat, to_lon) in legs:
        north, east = (to_lat - lat) * plane.per_lat, wrap_longitude_deg(to_lon - lon) * plane.per_lon
        length_m = math.hypot(north, east)
        for step in range(1, math.ceil(min(length_m, reach_m - flown_m) / step_m) + 1):
            part = min(1.0, step * step_m / length_m)
            place = lat + part * (to_lat - lat), wrap_longitude_deg(lon + part * wrap_longitude_deg(to_lon - lon))
            found.append((flown_m + part * length_m, *place))
        flown_m += length_m
        if flown_m >= reach_m:
            break
    return tuple(found)

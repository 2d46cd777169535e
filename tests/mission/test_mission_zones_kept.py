# SPDX-License-Identifier: GPL-3.0-or-later

"""What the finder keeps from one place to the next is what it would work out anew."""

from __future__ import annotations

import math
import random

import pytest
from shapely.geometry import MultiPolygon, Polygon

from mavproxy_handover.core.authority.zones import ZoneTracker
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import ZoneFact
from mavproxy_handover.mission import Circle, Zone, ZoneFinder
from mavproxy_handover.mission.geodesy import distance_m, offset
from mavproxy_handover.mission.zones import KEPT_FROM_M, KEPT_PART

LAT, LON = 52.68, 5.92


def wavy(chance: random.Random, lat: float, lon: float) -> Polygon:
    corners = []
    for corner in range(50):
        turn = 2.0 * math.pi * corner / 50
        radius = 2500.0 * (1.0 + 0.2 * chance.random())
        north_east = offset(lat, lon, radius * math.sin(turn), radius * math.cos(turn))
        corners.append((north_east[1], north_east[0]))
    return Polygon(corners)


def many_zones(chance: random.Random) -> list[Zone]:
    """A field of zones, some of them circles, some in two parts, some with a ceiling, two of one station."""
    zones = []
    for number in range(24):
        lat, lon = offset(LAT, LON, chance.uniform(-15e3, 15e3), chance.uniform(-15e3, 15e3))
        area: Circle | Polygon | MultiPolygon = wavy(chance, lat, lon)
        if number % 5 == 0:
            area = Circle(lat, lon, 2500.0)
        elif number % 7 == 0:
            assert isinstance(area, Polygon)
            area = MultiPolygon([area, wavy(chance, *offset(lat, lon, 9000.0, 0.0))])
        ceiling = 120.0 if number % 6 == 0 else None
        zones.append(Zone(1 + number % 20, f"S{number}", area, max_alt_m=ceiling))
    return zones


def flights(chance: random.Random) -> list[tuple[float, float, float, float, float]]:
    """Places 20 times a second, at any speed, with turns, now and then somewhere else; track, speed and height."""
    places = []
    for _ in range(14):
        lat, lon = offset(LAT, LON, chance.uniform(-12e3, 12e3), chance.uniform(-12e3, 12e3))
        for _ in range(6):
            track, speed, alt = (
                chance.uniform(0.0, 360.0),
                chance.choice((0.3, 20.0, 60.0, 400.0)),
                chance.uniform(20, 150),
            )
            for _ in range(60):
                away = speed / 20.0
                east, north = away * math.sin(math.radians(track)), away * math.cos(math.radians(track))
                lat, lon = offset(lat, lon, east, north)
                places.append((lat, lon, track, speed, alt))
    return places


def plain(finder: ZoneFinder, place: tuple[float, float, float, float, float]) -> tuple[ZoneFact, ...]:
    """As if nothing had been before: the aircraft was at the other end of the world."""
    finder.facts(-LAT, LON - 180.0, 0.0, 0.0)
    return finder.facts(*place)


@pytest.mark.parametrize("seed", range(3))
def test_everything_but_the_margin_of_far_zones_is_exact_and_that_to_two_percent(seed: int) -> None:
    chance = random.Random(seed)
    zones = many_zones(chance)
    finder, other = ZoneFinder(zones), ZoneFinder(zones)
    kept = 0
    for place in flights(chance)[::5]:
        for found, exact in zip(finder.facts(*place), plain(other, place), strict=True):
            if exact.margin_m > -(1.0 - KEPT_PART) * KEPT_FROM_M:
                assert found == exact
                continue
            assert found.margin_m == pytest.approx(exact.margin_m, rel=0.0205)
            assert (found.exit_s, found.ends_s, found.beyond) == (None, None, frozenset())
            kept += found.margin_m != exact.margin_m
    assert kept > 1000  # else nothing is kept, and nothing shown


def test_who_is_inside_is_decided_as_if_nothing_were_kept() -> None:
    chance = random.Random(9)
    zones = many_zones(chance)
    finder, fresh = ZoneFinder(zones), ZoneFinder(zones)
    pairs = [
        (ZoneTracker(limits), ZoneTracker(limits))
        for limits in (Limits(), Limits(enter_margin_m=1000.0, leave_margin_m=1000.0))
    ]
    changes = [0, 0]
    for number, place in enumerate(flights(chance)):
        kept, exact = finder.facts(*place), plain(fresh, place)
        for which, (one, other) in enumerate(pairs):
            found = one.update(kept, float(number))
            assert found == other.update(exact, float(number))
            assert one.inside() == other.inside()
            changes[which] += len(found.entered) + len(found.left)
    assert min(changes) > 6


def test_another_place_far_away_is_looked_at_anew() -> None:
    zone = Zone(1, "A", Circle(LAT, LON, 500.0))
    finder = ZoneFinder([zone])
    assert finder.facts(LAT + 0.1, LON, 0.0, 0.0)[0].margin_m < -10_000.0
    assert finder.facts(LAT, LON, 0.0, 0.0)[0].margin_m == 500.0
    far = finder.facts(LAT + 0.1, LON, 0.0, 0.0)[0].margin_m
    assert far == pytest.approx(500.0 - distance_m(LAT + 0.1, LON, LAT, LON))

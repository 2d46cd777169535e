# SPDX-License-Identifier: GPL-3.0-or-later

"""What a way from here on would leave. Places are metres east and north of 52.0 N 6.0 E, expected words written out."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.mission.ahead import Ahead, around, leaves_coverage, leaves_fence, straight
from mavproxy_handover.mission.borders import Circle
from mavproxy_handover.mission.fence import Fence, outside_fence
from mavproxy_handover.mission.geodesy import distance_m, offset
from mavproxy_handover.mission.items import LAND, RETURN_TO_LAUNCH, TAKEOFF, WAYPOINT, MissionItem
from mavproxy_handover.mission.plan import FenceCircle, FencePart, FencePolygon, Home, Route
from mavproxy_handover.mission.route_simulation import Leg
from mavproxy_handover.mission.zones import Zone, ZoneFinder

HOME = 52.0, 6.0
A, B = 251, 252


def at(east_m: float, north_m: float = 0.0, alt_m: float = 40.0) -> tuple[float, float, float]:
    return (*offset(*HOME, east_m, north_m), alt_m)


def circle(east_m: float, radius_m: float, inclusion: bool = True) -> FenceCircle:
    return FenceCircle(inclusion, *at(east_m)[:2], radius_m)


def box(west_m: float, east_m: float, half_m: float, inclusion: bool = True) -> FencePolygon:
    corners = ((west_m, -half_m), (east_m, -half_m), (east_m, half_m), (west_m, half_m))
    return FencePolygon(inclusion, tuple(at(*corner)[:2] for corner in corners))


def zones(*spans: tuple[int, float, float]) -> ZoneFinder:
    """A round zone for each (station, middle east, radius)."""
    return ZoneFinder(Zone(station, str(station), Circle(*at(middle)[:2], radius)) for station, middle, radius in spans)


#: A holds -990 to 990, B 790 to 2790
OVERLAP = ((A, 0.0, 990.0), (B, 1790.0, 1000.0))


def path(*places: tuple[float, float, float]) -> tuple[Leg, ...]:
    return tuple(Leg(n, start, end, 0.0) for n, (start, end) in enumerate(pairwise(places), 1))


def in_pieces(start_m: float, end_m: float, seq: int = 1, pieces: int = 20) -> tuple[Leg, ...]:
    """A way to the east that stands for a curve."""
    places = [at(start_m + (end_m - start_m) * n / pieces) for n in range(pieces + 1)]
    return tuple(Leg(seq, start, end, 0.0, curved=True) for start, end in pairwise(places))


def test_a_curve_may_lead_back_inside() -> None:
    """From 200 m outside of zone and fence; the way of the next item may not be outside."""
    back, finder = in_pieces(-1190.0, 0.0), zones((A, 0.0, 990.0))
    fence = Fence((circle(0.0, 990.0),))
    assert leaves_coverage(back, finder, {A}) == ""
    assert leaves_fence(back, fence) == ""
    short = in_pieces(-1190.0, -1100.0)
    assert leaves_coverage(short, finder, {A}) == "leads out of coverage (item 1)"
    assert leaves_fence(short, fence) == "breaks the geofence within 90 m (item 1)"
    away = (*in_pieces(-1190.0, 0.0), *in_pieces(0.0, -1190.0, 2))
    assert leaves_coverage(away, finder, {A}).startswith("leaves coverage in")
    assert leaves_fence(away, fence).startswith("breaks the geofence within 2")


def test_of_a_curve_of_many_pieces_places_are_looked_at_in_steps() -> None:
    class Counting(ZoneFinder):
        asked = 0

        def holding(self, *place: float) -> frozenset[int]:  # type: ignore[override]
            Counting.asked += 1
            return super().holding(*place)

    finder = Counting(zones((A, 0.0, 990.0)).zones)
    assert leaves_coverage(in_pieces(-900.0, 900.0, pieces=1800), finder, {A}) == ""
    assert Counting.asked <= 95


@pytest.mark.parametrize(
    ("spans", "places", "usable", "words"),
    [
        (OVERLAP, (0.0, 900.0), {A}, ""),
        (OVERLAP, (0.0, 2000.0), {A, B}, ""),
        (OVERLAP, (0.0, 2000.0), {A}, ""),  # B's comes later than near: it need not be there yet
        (OVERLAP, (800.0, 2000.0), {A}, "leaves coverage in 180 m (item 1)"),
        (OVERLAP, (800.0, 2000.0), {A, B}, ""),
        (OVERLAP, (800.0, 2000.0), set(), "leads out of coverage (item 1)"),
        (OVERLAP, (985.0, 1300.0), {A}, "leaves coverage at once (item 1)"),
        (OVERLAP, (0.0, 2000.0, 3200.0), {A, B}, "leaves coverage in 2787 m (item 2)"),
        (((A, 0.0, 990.0), (B, 2500.0, 1000.0)), (0.0, 900.0, 2500.0), {A, B}, "leaves coverage in 980 m (item 2)"),
        # from outside back in, and from outside to nowhere
        (OVERLAP, (-1200.0, 0.0), {A}, ""),
        (OVERLAP, (-1200.0, -1100.0), {A}, "leads out of coverage (item 1)"),
        (OVERLAP, (-1800.0, 0.0), {A}, ""),
        (OVERLAP, (1000.0, 2000.0), {A}, "leads out of coverage (item 1)"),  # into the zone of who is not there
        (OVERLAP, (1000.0, 2000.0, 0.0), {A}, "leads out of coverage (item 1)"),  # later is too late
        (OVERLAP, (1000.0, 900.0, 100.0), {A}, ""),
        ((), (0.0, 100.0), {A}, "leads out of coverage (item 1)"),
    ],
)
def test_coverage(
    spans: tuple[tuple[int, float, float], ...], places: tuple[float, ...], usable: set[int], words: str
) -> None:
    assert leaves_coverage(path(*map(at, places)), zones(*spans), usable) == words


@pytest.mark.parametrize(
    ("fence", "places", "words"),
    [
        ((), (0.0, 5000.0), ""),
        ((circle(0.0, 500.0),), (0.0, 400.0), ""),
        ((circle(0.0, 500.0),), (0.0, 600.0), "breaks the geofence within 600 m (item 1)"),
        ((circle(0.0, 500.0),), (0.0, 300.0, 600.0), "breaks the geofence within 600 m (item 2)"),
        ((circle(300.0, 5.0, False),), (0.0, 600.0), "breaks the geofence within 600 m (item 1)"),
        ((box(298.0, 302.0, 50.0, False),), (0.0, 600.0), "breaks the geofence within 600 m (item 1)"),
        ((box(298.0, 302.0, 50.0, False),), (0.0, 290.0), ""),
        ((box(-100.0, 1000.0, 100.0),), (0.0, 990.0), ""),
        ((box(-100.0, 1000.0, 100.0),), (0.0, 1010.0), "breaks the geofence within 1010 m (item 1)"),
        # outside already: back in it may
        ((circle(0.0, 500.0),), (600.0, 0.0), ""),
        ((circle(0.0, 500.0),), (600.0, 550.0), "breaks the geofence within 50 m (item 1)"),
        ((circle(0.0, 500.0),), (600.0, 0.0, 700.0), "breaks the geofence within 1300 m (item 2)"),
    ],
)
def test_the_geofence(fence: tuple[FencePart, ...], places: tuple[float, ...], words: str) -> None:
    assert leaves_fence(path(*map(at, places)), Fence(fence)) == words


def test_a_way_around_a_corner_of_the_fence_breaks_it_between_two_places_inside() -> None:
    corners = ((0, 0), (1000, 0), (1000, 1000), (500, 100), (0, 1000))
    fence = Fence([FencePolygon(True, tuple(at(*corner)[:2] for corner in corners))])
    left, right = at(100, 600)[:2], at(900, 600)[:2]
    assert fence.holds(left)
    assert fence.holds(right)
    assert not fence.holds_way(left, right)


def test_a_fence_across_the_180th_meridian() -> None:
    fence = Fence([FencePolygon(True, ((-17.0, 179.9), (-17.0, -179.9), (-17.2, -179.9), (-17.2, 179.9)))])
    assert fence.holds_way((-17.1, 179.95), (-17.1, -179.95))
    assert not fence.holds_way((-17.1, 179.95), (-17.1, -179.85))


@given(
    parts=st.lists(
        st.builds(
            lambda east, size, inside, round_: (
                circle(east, size, inside) if round_ else box(east - size, east + size, size, inside)
            ),
            st.floats(-500, 500),
            st.floats(20, 900),
            st.booleans(),
            st.booleans(),
        ),
        max_size=3,
    ),
    ends=st.tuples(*[st.floats(-1000, 1000)] * 4),
    part=st.floats(0, 1),
)
def test_a_way_that_breaks_no_fence_has_no_place_that_does(
    parts: list[FencePart], ends: tuple[float, float, float, float], part: float
) -> None:
    (lat, lon), (lat2, lon2) = at(*ends[:2])[:2], at(*ends[2:])[:2]
    fence = Fence(parts)
    if fence.holds_way((lat, lon), (lat2, lon2)):
        place = lat + part * (lat2 - lat), lon + part * (lon2 - lon)
        assert not outside_fence(parts, *place) or _on_the_line(parts, place)


def _on_the_line(parts: list[FencePart], place: tuple[float, float]) -> bool:
    """Within a millimetre of a border, where rounding decides."""
    return any(
        outside_fence(parts, *offset(*place, east, north)) is False
        for east, north in ((0.001, 0.0), (-0.001, 0.0), (0.0, 0.001), (0.0, -0.001))
    )


def item(seq: int, command: int, east_m: float, alt_m: float = 40.0, **more: float) -> MissionItem:
    lat, lon, _alt = at(east_m)
    return MissionItem(seq, command, 3, more.get("param1", 0.0), more.get("param2", 0.0), 0, 0, lat, lon, alt_m)


ROUTE = Route(
    Home(*HOME, 10.0),
    (
        item(1, TAKEOFF, 0.0),
        item(2, WAYPOINT, 500.0),
        item(3, 178, 0.0, param1=1.0, param2=6.0),
        item(4, WAYPOINT, 1500.0),
        item(5, LAND, 1600.0, 0.0),
    ),
)


def shown(legs: tuple[Leg, ...]) -> list[tuple[int, int, int, int, float]]:
    """Of each leg: item, length, heights, speed."""
    return [(leg.seq, round(leg.length_m), round(leg.start[2]), round(leg.end[2]), leg.speed_mps) for leg in legs]


def test_a_mission_taken_up_in_the_air_begins_where_the_aircraft_is() -> None:
    ahead = Ahead(ROUTE, zones(*OVERLAP), 8.0)
    assert shown(ahead.way(4, at(700.0, 0.0, 55.0))) == [
        (4, 800, 55, 40, 6.0), (5, 100, 40, 40, 6.0), (5, 0, 40, 10, 10.0), (5, 0, 10, 0, 10.0),
    ]  # fmt: skip
    assert shown(ahead.way(2, at(700.0)))[:2] == [(2, 200, 40, 40, 8.0), (4, 1000, 40, 40, 6.0)]
    assert shown(ahead.way(1, at(700.0, 0.0, 20.0)))[:2] == [(1, 0, 20, 40, 8.0), (2, 200, 40, 40, 8.0)]
    assert ahead.way(9, at(700.0)) == ()


def test_a_mission_that_returns_goes_home_from_where_it_is() -> None:
    back = Route(Home(*HOME, 0.0), (item(1, TAKEOFF, 0.0), item(2, RETURN_TO_LAUNCH, 0.0)))
    assert shown(Ahead(back, zones(), None).way(2, at(300.0)))[0] == (2, 300, 40, 40, 10.0)


def test_a_guided_target_is_a_straight_way() -> None:
    assert shown(straight(at(0.0), at(400.0, 300.0, 60.0), 5.0)) == [(0, 500, 40, 60, 5.0)]


def circled(east_m: float, radius_m: float, alt_m: float = 40.0) -> tuple[Leg, ...]:
    """A target of wings, from the middle of zone A."""
    there = at(east_m, 0.0, alt_m)
    return (*straight(at(0.0), there, 20.0), *around(there, radius_m, 20.0))


def test_a_circle_is_flown_once_around_its_middle() -> None:
    out, *ring = around(at(500.0), 90.0, 20.0)
    assert (out.start, ring[0].start, ring[-1].end) == (at(500.0), out.end, out.end)
    ends = [distance_m(*leg.end[:2], *at(500.0)[:2]) for leg in ring]
    middles = [distance_m(*leg.at(0.5)[:2], *at(500.0)[:2]) for leg in ring]
    assert max(ends) < 90.1
    assert min(middles) > 89.99, "no piece is inside of what is flown"
    assert sum(leg.length_m for leg in ring) == pytest.approx(565.5, abs=1.0)
    assert {leg.end[2] for leg in ring} == {40.0}
    assert {leg.speed_mps for leg in ring} == {20.0}


@pytest.mark.parametrize(
    ("east_m", "radius_m", "words"),
    [
        (895.0, 90.0, ""),
        (980.0, 90.0, "leaves coverage in "),  # the target itself is inside
        (690.0, 3000.0, "leaves coverage in "),
        (0.0, 980.0, ""),
        (0.0, 1000.0, "leaves coverage in "),
    ],
)
def test_coverage_and_fence_of_a_circle(east_m: float, radius_m: float, words: str) -> None:
    legs = circled(east_m, radius_m)
    assert leaves_coverage(legs, zones((A, 0.0, 990.0)), {A})[: len(words) or None] == words
    broken = leaves_fence(legs, Fence((circle(0.0, 990.0),)))
    assert bool(words) is broken.startswith("breaks the geofence within ")
    on_it = Fence((circle(east_m + radius_m, 5.0, False),))
    assert leaves_fence(legs, on_it).startswith("breaks the geofence within ")


@pytest.mark.parametrize(
    ("alt_m", "words"), [(100.0, ""), (101.0, "climbs above the fence's ceiling of 100 m"), (20.0, "")]
)
def test_the_ceiling_of_the_fence(alt_m: float, words: str) -> None:
    assert leaves_fence(circled(300.0, 90.0, alt_m), Fence(()), 100.0) == words
    assert leaves_fence(circled(300.0, 90.0, alt_m), Fence(())) == ""
    from_above = straight(at(0.0, 0.0, 300.0), at(300.0, 0.0, alt_m), 20.0)
    assert leaves_fence(from_above, Fence(()), 100.0) == words, "back below it may"


def test_landing_and_take_off_leave_nothing_that_their_place_does_not() -> None:
    high = ZoneFinder([Zone(A, "A", Circle(*HOME, 1000.0), min_alt_m=20.0)])
    route = Route(Home(*HOME, 0.0), (item(1, TAKEOFF, 0.0), item(2, LAND, 300.0, 0.0)))
    assert leaves_coverage(Ahead(route, high, None).way(2, at(0.0)), high, {A}) == ""

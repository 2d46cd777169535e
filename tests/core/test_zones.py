# SPDX-License-Identifier: GPL-3.0-or-later

"""Hysteresis, entries that count, dwell, and the choice of the next station."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, nan

import pytest

from mavproxy_handover.core.authority.zones import ZoneChange, ZoneTracker
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import RANKS, Reason, ZoneFact

A, B, C = 251, 252, 253
NOTHING = ZoneChange((), ())


def tracker() -> ZoneTracker:
    return ZoneTracker(Limits())


def fact(station: int, margin_m: float, exit_s: float | None = None) -> ZoneFact:
    return ZoneFact(station, margin_m, exit_s)


def next_commander(
    zones: ZoneTracker,
    commander: int,
    usable: Sequence[int],
    route_next: int | None,
    now: float,
    better: Sequence[int] = (),
) -> int | None:
    """Whom the gravest reason calls, as `Candidates.wanted` has it."""
    reasons = zones.reasons(commander, usable, now, better)
    gravest = max(reasons.values(), key=RANKS.__getitem__, default=None)
    called = [station for station, why in reasons.items() if why is gravest]
    return zones.best(called, route_next) if called else None


class TestMembership:
    @pytest.mark.parametrize(
        ("margin_m", "entered"), [(-100.0, ()), (0.0, ()), (4.99, ()), (5.0, (A,)), (5.01, (A,)), (1e6, (A,))]
    )
    def test_a_zone_is_entered_five_metres_inside(self, margin_m: float, entered: tuple[int, ...]) -> None:
        zones = tracker()
        assert zones.update([fact(A, margin_m)], 0.0) == ZoneChange(entered, ())
        assert zones.holds(A) is bool(entered)

    @pytest.mark.parametrize(("margin_m", "left"), [(1.0, ()), (-4.99, ()), (-5.0, (A,)), (-1e6, (A,))])
    def test_a_zone_is_left_five_metres_outside(self, margin_m: float, left: tuple[int, ...]) -> None:
        zones = tracker()
        zones.update([fact(A, 50.0)], 0.0)
        assert zones.update([fact(A, margin_m)], 1.0) == ZoneChange((), left)
        assert zones.holds(A) is not bool(left)

    def test_a_track_along_the_border_does_not_flicker(self) -> None:
        zones = tracker()
        changes = [zones.update([fact(A, margin)], 0.0) for margin in (4, -4, 4.9, 5, 4, -4.9, 0, 4.9, -4, -5, 0, 4.9)]
        assert [change for change in changes if change != NOTHING] == [ZoneChange((A,), ()), ZoneChange((), (A,))]

    def test_entered_and_left_in_the_order_of_the_facts(self) -> None:
        zones = tracker()
        assert zones.update([fact(C, 10), fact(A, 10), fact(B, -10)], 0.0) == ZoneChange((C, A), ())
        assert zones.update([fact(C, -10), fact(A, -10), fact(B, 10)], 1.0) == ZoneChange((B,), (C, A))

    def test_a_station_with_several_zones_is_covered_by_the_best(self) -> None:
        zones = tracker()
        zones.update([fact(A, -900), fact(A, 20.0), fact(A, -30)], 0.0)
        assert zones.holds(A)
        assert zones.update([fact(A, 8.0), fact(A, -40)], 1.0) == NOTHING
        # out of the first, into the second: never uncovered, no new entry
        assert zones.update([fact(A, -40), fact(A, 8.0)], 2.0) == NOTHING
        assert zones.update([fact(A, -40), fact(A, -8.0)], 3.0) == ZoneChange((), (A,))

    def test_a_zone_that_is_no_longer_in_the_mission_is_left(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50), fact(B, 50)], 0.0)
        assert zones.update([fact(A, 50)], 1.0) == ZoneChange((), (B,))
        assert not zones.holds(B)
        assert next_commander(zones, A, (B,), B, 100.0) is None

    def test_margin_that_is_no_number_changes_nothing(self) -> None:
        zones = tracker()
        assert zones.update([fact(A, nan)], 0.0) == NOTHING
        zones.update([fact(A, 50)], 1.0)
        assert zones.update([fact(A, nan)], 2.0) == NOTHING
        assert zones.holds(A)

    def test_nobody_holds_nothing(self) -> None:
        assert not tracker().holds(None)

    def test_inside_names_the_first_one_first(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50), fact(B, 50), fact(C, 50)], 0.0)
        assert zones.inside(B) == (B, A, C)
        assert zones.inside(None) == (A, B, C)
        assert zones.inside(99) == (A, B, C)


class TestOutOfEveryZone:
    def test_nothing_known_is_not_out(self) -> None:
        zones = tracker()
        assert zones.out_since is None
        zones.update([], 1.0)
        assert zones.out_since is None

    def test_out_since_the_first_position_outside(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50), fact(B, -50)], 1.0)
        assert zones.out_since is None
        zones.update([fact(A, -4), fact(B, -50)], 2.0)
        assert zones.out_since is None
        zones.update([fact(A, -6), fact(B, -50)], 3.0)
        assert zones.out_since == 3.0
        zones.update([fact(A, -60), fact(B, -50)], 4.0)
        assert zones.out_since == 3.0
        zones.update([fact(A, -60), fact(B, 4)], 5.0)
        assert zones.out_since == 3.0
        zones.update([fact(A, -60), fact(B, 5)], 6.0)
        assert zones.out_since is None

    def test_started_outside(self) -> None:
        zones = tracker()
        zones.update([fact(A, -1)], 7.0)
        assert zones.out_since == 7.0


class TestNextCommander:
    def test_an_entry_calls_for_its_station(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, -50)], 0.0)
        zones.moved(0.0)
        assert next_commander(zones, A, (B,), B, 10.0) is None
        zones.update([fact(A, 500), fact(B, 5)], 10.0)
        assert next_commander(zones, A, (B,), B, 10.0) == B

    def test_a_station_that_is_not_usable_is_not_chosen(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, 50)], 10.0)
        assert next_commander(zones, A, (), B, 10.0) is None

    def test_usable_is_not_enough_outside_its_zone(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, -50)], 10.0)
        assert next_commander(zones, A, (A, B, C), B, 10.0) is None

    def test_the_commander_is_not_its_own_successor(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500)], 10.0)
        assert next_commander(zones, A, (A,), A, 10.0) is None

    def test_an_entry_before_the_last_change_does_not_count(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, 500)], 0.0)
        zones.moved(1.0)
        assert next_commander(zones, B, (A,), A, 100.0) is None

    def test_an_entry_on_the_ground_does_not_count(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, 500)], 0.0)
        zones.forget_entries()
        assert next_commander(zones, A, (B,), B, 100.0) is None

    def test_an_entry_keeps_counting_until_the_zone_is_left(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, 500)], 0.0)
        zones.update([fact(A, 500), fact(B, 700)], 1.0)
        assert next_commander(zones, A, (B,), None, 1.0) == B
        zones.update([fact(A, 500), fact(B, -700)], 2.0)
        assert next_commander(zones, A, (B,), None, 2.0) is None

    def test_nothing_moves_in_the_dwell_time(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, -50)], 0.0)
        zones.moved(100.0)
        zones.update([fact(A, 500), fact(B, 50)], 101.0)
        assert next_commander(zones, A, (B,), B, 104.999) is None
        assert next_commander(zones, A, (B,), B, 105.0) == B

    def test_the_dwell_time_gives_way_when_the_commanders_zone_has_ended(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, -50)], 0.0)
        zones.moved(100.0)
        zones.update([fact(A, -50), fact(B, 50)], 101.0)
        assert next_commander(zones, A, (B,), B, 101.0) == B

    @pytest.mark.parametrize(
        ("left_a_s", "left_b_s", "expected"),
        [
            (None, None, None),  # no end in sight
            (8.001, 100.0, None),  # not yet
            (8.0, 100.0, B),
            (8.0, None, B),
            (8.0, 8.0, None),  # it would win nothing
            (3.0, 2.0, None),
            (0.0, 0.1, B),
        ],
    )
    def test_about_to_leave(self, left_a_s: float | None, left_b_s: float | None, expected: int | None) -> None:
        # both entered before the last change of authority: only the end of the commander's zone can call
        zones = tracker()
        zones.update([fact(A, 50, left_a_s), fact(B, 50, left_b_s)], 0.0)
        zones.moved(0.0)
        assert next_commander(zones, A, (B,), B, 10.0) == expected

    def test_out_of_the_commanders_zone_any_zone_will_do(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50), fact(B, 50, 1.0)], 0.0)
        zones.moved(0.0)
        zones.update([fact(A, -50), fact(B, 40, 0.5)], 1.0)
        assert next_commander(zones, A, (B,), None, 1.0) == B

    @pytest.mark.parametrize("commanders", [(), (fact(A, 3.0),)], ids=["has no zone", "is not yet in its zone"])
    def test_whose_zone_does_not_hold_the_aircraft_has_no_time_left(self, commanders: tuple[ZoneFact, ...]) -> None:
        zones = tracker()
        zones.update([*commanders, fact(B, 50, 20.0)], 0.0)
        zones.moved(0.0)
        assert next_commander(zones, A, (B,), None, 10.0) == B

    @pytest.mark.parametrize(
        ("left_b_s", "left_c_s", "route_next", "expected"),
        [
            (10.0, 99.0, B, B),  # the route first
            (10.0, 99.0, C, C),
            (10.0, 99.0, None, C),  # then the longest
            (99.0, 10.0, None, B),
            (None, 99.0, None, B),  # no end in sight is the longest
            (99.0, None, A, C),
            (20.0, 20.0, None, B),  # and with nothing between them, always the same
            (None, None, None, B),
        ],
    )
    def test_of_three_zones(
        self, left_b_s: float | None, left_c_s: float | None, route_next: int | None, expected: int
    ) -> None:
        zones = tracker()
        zones.update([fact(A, 50), fact(B, 50, left_b_s), fact(C, 50, left_c_s)], 0.0)
        assert next_commander(zones, A, (B, C), route_next, 10.0) == expected
        assert next_commander(zones, A, (C, B), route_next, 10.0) == expected

    def test_the_route_does_not_call_a_station_that_nothing_else_calls(self) -> None:
        # C is next on the route but was entered long ago; B is a fresh entry
        zones = tracker()
        zones.update([fact(A, 50), fact(C, 50)], 0.0)
        zones.moved(0.0)
        zones.update([fact(A, 50), fact(B, 50), fact(C, 50)], 10.0)
        assert next_commander(zones, A, (B, C), C, 10.0) == B

    def test_no_ping_pong_inside_one_region(self) -> None:
        # both zones hold the aircraft for a minute; the fresh entry calls once, and nothing calls back
        zones = tracker()
        zones.update([fact(A, 500), fact(B, -50)], 0.0)
        commander, changes = A, []
        for second in range(1, 61):
            now = float(second)
            zones.update([fact(A, 500), fact(B, 500)], now)
            other = A if commander == B else B
            chosen = next_commander(zones, commander, (other,), other, now)
            if chosen is not None:
                commander = chosen
                changes.append((second, chosen))
                zones.moved(now)
        assert changes == [(1, B)]


@pytest.mark.parametrize(("left_s", "called"), [(1.0, None), (8.001, None), (30.0, None), (30.001, B), (None, B)])
def test_a_better_link_calls_no_station_whose_zone_ends_before_it_was_worth_it(
    left_s: float | None, called: int | None
) -> None:
    zones = tracker()
    zones.update((fact(A, 50.0), fact(B, 50.0, left_s)), 0.0)
    zones.moved(0.0)
    assert next_commander(zones, A, [B], None, 100.0, better=[B]) == called


class TestAwaitedAtAWaypoint:
    """A station that awaits the aircraft at a waypoint: its zone covers, and calls when that is reached."""

    AWAITS = ZoneFact(B, 500.0, None, awaits=True)
    REACHED = ZoneFact(B, 500.0, None)

    def test_its_zone_calls_nobody_until_the_waypoint_is_reached(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), fact(B, -50)], 0.0)
        zones.moved(0.0)
        for second in range(10, 60):
            zones.update([fact(A, 500), self.AWAITS], float(second))
            assert next_commander(zones, A, (B,), B, float(second)) is None
        zones.update([fact(A, 500), self.REACHED], 60.0)
        assert next_commander(zones, A, (B,), B, 60.0) == B

    def test_entering_it_is_told_as_ever_and_reaching_the_waypoint_is_no_second_entry(self) -> None:
        zones = tracker()
        assert zones.update([self.AWAITS], 0.0) == ZoneChange((B,), ())
        assert zones.update([self.REACHED], 1.0) == NOTHING

    def test_it_holds_the_aircraft_and_is_not_open(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), self.AWAITS], 0.0)
        assert zones.inside() == (A, B)
        assert (zones.open(A), zones.open(B), zones.open(C)) == (True, False, False)
        zones.update([fact(A, 500), self.REACHED], 1.0)
        assert zones.open(B)
        zones.update([fact(A, 500), fact(B, -500)], 2.0)
        assert not zones.open(B)

    def test_where_the_commanders_zone_ends_no_waypoint_is_waited_for(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50, 8.0), self.AWAITS], 10.0)
        assert zones.reasons(A, (B,), 10.0) == {B: Reason.ZONE_ENDS}

    def test_nor_when_its_links_are_the_better_ones(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), self.AWAITS], 10.0)
        assert zones.reasons(A, (B,), 10.0, better=(B,)) == {B: Reason.LINK_QUALITY}

    def test_a_waypoint_reached_outside_its_zone_counts_when_the_zone_is_entered(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), ZoneFact(B, -50.0, None, awaits=True)], 0.0)
        zones.update([fact(A, 500), fact(B, -50)], 10.0)
        assert next_commander(zones, A, (B,), B, 10.0) is None
        zones.update([fact(A, 500), fact(B, 50)], 11.0)
        assert next_commander(zones, A, (B,), B, 11.0) == B

    def test_a_station_that_awaits_it_once_more_calls_no_more(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), self.REACHED], 0.0)
        zones.update([fact(A, 500), self.AWAITS], 1.0)
        assert next_commander(zones, A, (B,), B, 10.0) is None
        zones.update([fact(A, 500), self.REACHED], 11.0)
        assert next_commander(zones, A, (B,), B, 11.0) == B

    def test_each_waypoint_calls_once(self) -> None:
        """Given away again behind it, authority stays there: the waypoint was reached before that."""
        zones = tracker()
        zones.update([fact(A, 500), self.AWAITS], 0.0)
        zones.update([fact(A, 500), self.REACHED], 1.0)
        zones.moved(1.0)
        zones.moved(20.0)
        zones.update([fact(A, 500), self.REACHED], 100.0)
        assert next_commander(zones, A, (B,), B, 100.0) is None

    def test_on_the_ground_an_awaited_zone_is_not_forgotten_but_still_awaited(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500), self.AWAITS], 0.0)
        zones.forget_entries()
        zones.update([fact(A, 500), self.REACHED], 50.0)
        assert next_commander(zones, A, (B,), B, 50.0) == B


class TestBeyondTheBorder:
    """Up to five metres outside a zone still counts as holding the aircraft, but not for long: it is on its way out."""

    def test_a_better_link_calls_no_station_whose_border_is_crossed(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50.0), fact(B, 50.0)], 0.0)
        zones.moved(0.0)
        zones.update([fact(A, 50.0), fact(B, -1.0)], 99.0)
        assert zones.holds(B)
        assert next_commander(zones, A, [B], None, 100.0, better=[B]) is None

    def test_on_the_border_it_is_not_crossed(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50.0), fact(B, 50.0)], 0.0)
        zones.moved(0.0)
        zones.update([fact(A, 50.0), fact(B, 0.0)], 99.0)
        assert next_commander(zones, A, [B], None, 100.0, better=[B]) == B

    def test_a_commander_whose_border_is_crossed_is_followed_by_whoever_keeps_the_aircraft(self) -> None:
        zones = tracker()
        zones.update([fact(A, 50.0), fact(B, 50.0)], 0.0)
        zones.moved(0.0)
        zones.update([fact(A, -1.0), fact(B, 50.0, 20.0)], 99.0)
        assert next_commander(zones, A, [B], None, 100.0) == B

    def test_the_one_inside_its_border_is_better_than_the_one_beyond_it(self) -> None:
        zones = tracker()
        zones.update([fact(B, 50.0), fact(C, 50.0)], 0.0)
        zones.update([fact(B, -1.0), fact(C, 50.0, 3.0)], 1.0)
        assert zones.best([B, C], None) == C


class TestWhatIsAskedOfOneZone:
    """The tracker answers how far a zone is, where it ends along the route, and which zones follow there."""

    def test_the_nearest_zone_of_several(self) -> None:
        zones = tracker()
        assert zones.nearest() is None
        zones.update([fact(A, -300.0), fact(B, -20.0), fact(C, -90.0)], 0.0)
        assert zones.nearest() == (B, -20.0)

    def test_the_distance_inside_the_border_and_of_an_unknown_station(self) -> None:
        zones = tracker()
        zones.update([fact(A, 42.0)], 0.0)
        assert (zones.margin_m(A), zones.margin_m(B)) == (42.0, -inf)

    @pytest.mark.parametrize(
        ("margin_m", "ends_s", "expected"),
        [(50.0, 12.0, 12.0), (50.0, None, inf), (0.0, 12.0, 12.0), (-1.0, 12.0, 0.0)],
    )
    def test_when_the_known_way_leaves_a_zone(self, margin_m: float, ends_s: float | None, expected: float) -> None:
        zones = tracker()
        zones.update([fact(A, 50.0)], 0.0)
        zones.update([ZoneFact(A, margin_m, None, ends_s=ends_s)], 1.0)
        assert zones.holds(A)
        assert zones.ends_s(A) == expected

    def test_the_known_way_is_not_inside_a_zone_that_was_not_entered(self) -> None:
        zones = tracker()
        zones.update([ZoneFact(A, 4.0, None, ends_s=12.0)], 0.0)
        assert (zones.ends_s(A), zones.ends_s(B)) == (0.0, 0.0)

    def test_the_zones_where_the_known_way_leaves_another(self) -> None:
        zones = tracker()
        zones.update([ZoneFact(A, 50.0, None, beyond=frozenset({B}))], 0.0)
        assert (zones.beyond(A), zones.beyond(C)) == (frozenset({B}), frozenset())

    def test_good_links_are_not_given_up_for_an_entry_with_weak_ones(self) -> None:
        zones = tracker()
        zones.update([fact(A, 500.0), fact(B, 500.0)], 0.0)
        assert zones.reasons(A, (B,), 10.0, worse=(B,)) == {}
        assert zones.reasons(A, (B,), 10.0) == {B: Reason.ZONE}

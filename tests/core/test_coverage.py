# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts of authority for the safety rules: which coverage counts, and where the last of it ends."""

from __future__ import annotations

from math import inf

import pytest

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.coverage import Coverage
from mavproxy_handover.core.authority.transfer import Cause as Move
from mavproxy_handover.core.authority.transfer import Transfer
from mavproxy_handover.core.common.authority_facts import CoverageFacts
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import AutopilotState, LinkJudged
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.handling import STANDS_STILL
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import TransferKey
from mavproxy_handover.core.common.model import Reason, Station, ZoneFact
from tests.core.test_candidates import NAMES, NOW, A, B, C, candidates


class Bench:
    """GCSA commands in flight; all three stations are there, and the zones of GCSA and GCSB hold the aircraft."""

    def __init__(self) -> None:
        self.limits = Limits()
        self.flight = Flight(self.limits)
        self.fly()
        self.authority = Authority([Station(sysid, name) for sysid, name in NAMES.items()], self.flight)
        self.authority.owner = A
        self.candidates = candidates()
        self.zones(A=None, B=None)
        self.coverage = Coverage(self.authority, self.flight, self.candidates, self.limits)

    def fly(self, *, circles_s: float = 0.0, circle_m: float = 0.0) -> None:
        self.flight.autopilot_said(AutopilotState(True, True, "", STANDS_STILL, circles_s, circle_m), NOW)

    def zones(self, *, beyond: frozenset[int] = frozenset(), **ends_s: float | None) -> None:
        """The zones of these stations hold the aircraft, 100 m inside; the known way leaves them then."""
        stations = {name[-1]: sysid for sysid, name in NAMES.items()}
        inside = {stations[letter]: ends for letter, ends in ends_s.items()}
        self.candidates.zones.update(
            [
                ZoneFact(sysid, 100.0, None, inside[sysid], beyond)
                if sysid in inside
                else ZoneFact(sysid, -100.0, None)
                for sysid in NAMES
            ],
            NOW,
        )

    def transfer(self, *, forced_until: float | None = None, begun: float = NOW) -> Transfer:
        transfer = Transfer(TransferKey(A, B, 1, 1), Reason.ZONE, self.limits, begun, forced_until=forced_until)
        self.authority.begin_transfer(transfer)
        return transfer

    @property
    def ends_ahead(self) -> bool:
        return self.coverage.coverage(NOW).ends_ahead


class TestOwner:
    def test_who_commands(self) -> None:
        bench = Bench()
        assert (bench.coverage.owner, bench.coverage.owner_name, bench.coverage.lost) == (A, "GCSA", False)
        assert bench.coverage.covered
        assert not bench.coverage.out_of_coverage
        assert bench.coverage.margin_m(A) == 100.0

    def test_an_attack_is_in_the_name_of_the_owner(self) -> None:
        bench = Bench()
        bench.candidates.links.judged(LinkJudged(A, False, True, ""), "GCSA", NOW, [])
        assert bench.coverage.attacked
        bench.authority.owner = B
        assert not bench.coverage.attacked
        bench.authority.owner = None
        assert not bench.coverage.attacked


class TestSuccessor:
    def lost(self) -> Bench:
        bench = Bench()
        bench.authority.lose(A, NOW, [])
        return bench

    def test_a_forced_transfer_is_waited_for_two_seconds(self) -> None:
        bench = self.lost()
        assert not bench.coverage.successor_awaited(NOW)
        bench.transfer(forced_until=NOW + 2.0)
        assert bench.coverage.successor_awaited(NOW + 1.9)
        assert not bench.coverage.successor_awaited(NOW + 2.0)

    def test_not_when_only_operators_have_still_to_answer(self) -> None:
        bench = self.lost()
        bench.transfer(forced_until=NOW + 2.0).move(Move.PARTNER_ASKS, NOW)
        assert not bench.coverage.successor_awaited(NOW)

    def test_not_for_an_owner_that_is_heard(self) -> None:
        bench = Bench()
        bench.transfer(forced_until=NOW + 2.0)
        assert not bench.coverage.successor_awaited(NOW)

    def test_after_a_restart_the_owner_is_waited_for(self) -> None:
        bench = self.lost()
        bench.authority.recover_until = NOW + 2.5
        assert bench.coverage.successor_awaited(NOW + 2.2)


class TestHere:
    def test_nothing_is_wrong_in_the_zone_of_the_owner(self) -> None:
        assert Bench().coverage.coverage(NOW) == CoverageFacts()

    def test_without_an_owner_nothing_is_shown(self) -> None:
        bench = Bench()
        bench.authority.owner = None
        for station in (A, B):
            bench.candidates.pause(station, Reason.ZONE_ENDS, Reason.PARTNER_SILENT, NOW)
        nothing = CoverageFacts(no_station=False, links_weak=False, ends_ahead=False)
        assert bench.coverage.coverage(NOW) == nothing

    def test_without_another_station_in_the_zones_that_hold_the_aircraft_no_station_could_take_it(self) -> None:
        bench = Bench()
        bench.zones(B=None)
        assert not bench.coverage.coverage(NOW).no_station
        bench.candidates.pause(B, Reason.ZONE_ENDS, Reason.PARTNER_SILENT, NOW)
        assert bench.coverage.coverage(NOW).no_station

    def test_outside_every_zone_that_is_not_said(self) -> None:
        bench = Bench()
        bench.zones()
        assert not bench.coverage.coverage(NOW).no_station

    @pytest.mark.parametrize(("begun", "no_station"), [(NOW - 0.9, False), (NOW - 1.0, True)])
    def test_a_partner_that_does_not_answer_does_not_count(self, begun: float, no_station: bool) -> None:
        bench = Bench()
        bench.zones(B=None)
        bench.transfer(begun=begun)
        assert bench.coverage.coverage(NOW).no_station is no_station

    def test_a_partner_that_did_not_answer_in_the_last_transfer_has_to_answer_first(self) -> None:
        bench = Bench()
        bench.zones(B=None)
        bench.candidates.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        bench.transfer()
        assert bench.coverage.coverage(NOW).no_station
        bench.candidates.spoke(B)
        assert not bench.coverage.coverage(NOW).no_station

    def test_another_station_counts_though_the_partner_does_not_answer(self) -> None:
        bench = Bench()
        bench.zones(B=None, C=None)
        bench.transfer(begun=NOW - 5.0)
        assert not bench.coverage.coverage(NOW).no_station

    def test_weak_links_are_said_when_no_station_has_better_ones(self) -> None:
        bench = Bench()
        bench.candidates.links.judged(LinkJudged(A, True, False, ""), "GCSA", NOW - 10.0, [])
        assert not bench.coverage.coverage(NOW).links_weak
        bench.zones(A=None)
        assert bench.coverage.coverage(NOW).links_weak


class TestEndAhead:
    @pytest.mark.parametrize(("ends_s", "ahead"), [(None, False), (5.1, False), (5.0, True), (0.5, True)])
    def test_five_seconds_before_the_last_zone_ends(self, ends_s: float | None, ahead: bool) -> None:
        bench = Bench()
        bench.zones(A=ends_s)
        assert bench.ends_ahead is ahead

    def test_an_aircraft_that_circles_needs_its_own_time(self) -> None:
        bench = Bench()
        bench.fly(circles_s=9.0)
        bench.zones(A=9.0)
        assert bench.ends_ahead

    @pytest.mark.parametrize(
        ("circle_m", "ends_s", "ahead"), [(100.0, 30.0, False), (100.1, 30.0, True), (100.1, None, False)]
    )
    def test_and_room_on_both_sides_if_the_zone_ends_at_all(
        self, circle_m: float, ends_s: float | None, ahead: bool
    ) -> None:
        bench = Bench()
        bench.fly(circle_m=circle_m)
        bench.zones(A=ends_s)
        assert bench.ends_ahead is ahead

    def test_outside_the_owners_zone_nothing_ends_ahead(self) -> None:
        bench = Bench()
        bench.zones(B=1.0)
        assert not bench.ends_ahead

    def test_without_an_owner_that_is_heard_neither(self) -> None:
        bench = Bench()
        bench.zones(A=1.0)
        bench.authority.lose(A, NOW, [])
        assert not bench.ends_ahead

    @pytest.mark.parametrize(("ends_s", "ahead"), [(None, False), (3.1, False), (3.0, True), (2.0, True)])
    def test_another_zone_that_lasts_longer_covers(self, ends_s: float | None, ahead: bool) -> None:
        bench = Bench()
        bench.zones(A=3.0, B=ends_s)
        assert bench.ends_ahead is ahead

    @pytest.mark.parametrize(("begun", "ahead"), [(NOW - 0.9, False), (NOW - 1.0, True)])
    def test_that_of_a_partner_for_a_second(self, begun: float, ahead: bool) -> None:
        bench = Bench()
        bench.zones(A=3.0, B=None)
        bench.transfer(begun=begun)
        assert bench.ends_ahead is ahead

    @pytest.mark.parametrize(("begun", "ahead"), [(NOW - 0.9, False), (NOW - 1.0, True)])
    def test_a_partner_that_answered_and_is_slow_does_not_cover_after_the_border(
        self, begun: float, ahead: bool
    ) -> None:
        bench = Bench()
        bench.zones(A=3.0, B=None)
        transfer = bench.transfer(begun=begun)
        transfer.move(Move.PARTNER_ASKS, begun)
        assert not transfer.unanswered(NOW)
        assert bench.ends_ahead is ahead

    def test_a_partner_that_has_to_answer_first_does_not_cover_however_short_the_transfer_is(self) -> None:
        bench = Bench()
        bench.zones(A=3.0, B=None)
        bench.candidates.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        bench.transfer()
        assert bench.ends_ahead
        bench.candidates.spoke(B)
        assert not bench.ends_ahead

    def test_a_third_station_covers_though_the_partner_is_slow(self) -> None:
        bench = Bench()
        bench.zones(A=3.0, B=None, C=None)
        bench.transfer(begun=NOW - 5.0)
        assert not bench.ends_ahead

    def test_a_station_whose_zone_begins_where_this_one_ends_covers(self) -> None:
        bench = Bench()
        bench.zones(A=3.0, beyond=frozenset({C}))
        assert not bench.ends_ahead
        bench.candidates.pause(C, Reason.ZONE_ENDS, Reason.PARTNER_SILENT, NOW)
        assert bench.ends_ahead

    @pytest.mark.parametrize(("begun", "ahead"), [(NOW - 0.9, False), (NOW - 1.0, True)])
    def test_there_too_a_partner_covers_for_a_second(self, begun: float, ahead: bool) -> None:
        bench = Bench()
        bench.zones(A=3.0, beyond=frozenset({B}))
        bench.transfer(begun=begun)
        assert bench.ends_ahead is ahead

    def test_there_too_a_partner_that_has_to_answer_first_does_not_cover(self) -> None:
        bench = Bench()
        bench.zones(A=3.0, beyond=frozenset({B}))
        bench.candidates.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        bench.transfer()
        assert bench.ends_ahead
        bench.candidates.spoke(B)
        assert not bench.ends_ahead


class TestWords:
    def test_a_commander_that_is_silent(self) -> None:
        bench = Bench()
        assert bench.coverage.words(Cause.COMMANDER_LOST, NOW + 7.0) == "GCSA silent for 7 s"
        bench.candidates._presence[A].heard_at = -inf
        assert bench.coverage.words(Cause.COMMANDER_LOST, NOW) == ""
        bench.authority.owner = None
        assert bench.coverage.words(Cause.COMMANDER_LOST, NOW) == ""

    def test_a_commander_that_hears_nothing(self) -> None:
        bench = Bench()
        bench.candidates._presence[A].answered_at = NOW - 12.0
        assert bench.coverage.words(Cause.COMMANDER_LOST, NOW) == "GCSA hears nothing for 12 s"

    def test_how_far_outside_which_zone(self) -> None:
        bench = Bench()
        bench.candidates.zones.update([ZoneFact(A, -70.0, None), ZoneFact(B, -30.0, None)], NOW)
        assert bench.coverage.words(Cause.OUT_OF_COVERAGE, NOW) == "out of coverage, 30 m outside the zone of GCSB"
        bench.candidates.zones.update((), NOW)
        assert bench.coverage.words(Cause.OUT_OF_COVERAGE, NOW) == ""

    def test_the_stations_here(self) -> None:
        bench = Bench()
        text = "no station whose zone holds the aircraft can take it: GCSA, GCSB"
        assert bench.coverage.words(Cause.NO_STATION, NOW) == text
        bench.zones()
        assert bench.coverage.words(Cause.NO_STATION, NOW) == ""

    def test_how_soon_coverage_ends(self) -> None:
        bench = Bench()
        assert bench.coverage.words(Cause.COVERAGE_ENDS, NOW) == ""
        bench.zones(A=4.2)
        assert (
            bench.coverage.words(Cause.COVERAGE_ENDS, NOW)
            == "the zone of GCSA ends in 4 s, and no station is ready beyond it"
        )
        bench.authority.owner = None
        assert bench.coverage.words(Cause.COVERAGE_ENDS, NOW) == ""

    def test_other_causes_have_no_figures_here(self) -> None:
        assert Bench().coverage.words(Cause.ENERGY, NOW) == ""

# SPDX-License-Identifier: GPL-3.0-or-later

"""The border ahead by itself: which one it is, how long it counts, and what both stations are told of it."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.foresight import Foresight
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.authority.transfer import Transfer
from mavproxy_handover.core.common.events import Action, AutopilotState, BordersSeen, Record, Send
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import CrossingKey, HandoverAhead, OkAhead, TransferKey
from mavproxy_handover.core.common.model import BorderFact, Consent, Mission, Phase, Reason, Station, ZoneFact
from tests.core.test_candidates import NAMES, NOW, A, B, C, candidates, inside, outside

KEY = CrossingKey(A, B, 1, 4)


def border(*holding: int, in_s: float = 20.0, number: int = 0) -> BorderFact:
    return BorderFact(number, in_s, frozenset(holding))


class Bench:
    """GCSA commands in flight, in epoch 4; its zone holds the aircraft, and those of GCSB and GCSC do not."""

    def __init__(self, *, route: tuple[int, ...] = (A, B, C)) -> None:
        self.limits = Limits()
        self.flight = Flight(self.limits)
        self.fly()
        self.authority = Authority([Station(sysid, name) for sysid, name in NAMES.items()], self.flight)
        self.authority.owner, self.authority.epoch, self.authority.phase = A, 4, Phase.ON_MISSION
        self.candidates = candidates(inside(A), outside(B), outside(C), route=route)
        self.presence = self.candidates._presence
        self.foresight = Foresight(self.authority, self.flight, self.presence, self.candidates, self.limits)

    def fly(self, *, flying: bool = True) -> None:
        self.flight.autopilot_said(AutopilotState(flying, flying), NOW)

    def standard(self, station: int) -> None:
        """This station has no module of ours."""
        there = Presence(Station(station, NAMES[station], standard=True), self.limits)
        there.heard_at = NOW
        self.presence[station] = there

    def enter(self, *stations: int, awaits: bool = False) -> None:
        """The zones of GCSA and of these hold the aircraft."""
        facts = [ZoneFact(each, 100.0 if each in (A, *stations) else -100.0, None) for each in NAMES]
        self.candidates.zones.update([replace(each, awaits=awaits and each.station != A) for each in facts], NOW)

    def see(self, *borders: BorderFact, now: float = NOW, route: int = 0) -> list[Action]:
        actions: list[Action] = []
        self.foresight.seen(BordersSeen(borders, route), now, actions)
        return actions

    def told(self, now: float) -> dict[int, HandoverAhead]:
        """What each station is told in that moment."""
        actions: list[Action] = []
        self.foresight.speak(now, actions)
        found = {each.station: each.message for each in actions if isinstance(each, Send)}
        assert len(found) == len(actions)
        return found  # type: ignore[return-value]

    def transfer(self, crossing: int) -> None:
        key = TransferKey(A, B, 1, 4)
        self.authority.begin_transfer(Transfer(key, Reason.ZONE, self.limits, NOW, crossing=crossing))

    @property
    def key(self) -> CrossingKey | None:
        return self.foresight.key


def foreseen() -> Bench:
    """The border to GCSB is 20 s ahead."""
    bench = Bench()
    bench.see(border(A, B))
    assert bench.key == KEY
    return bench


class TestTold:
    def test_before_a_border_is_seen_there_is_nothing_to_say(self) -> None:
        bench = Bench()
        assert (bench.key, bench.foresight.left_s(NOW), bench.foresight.deadlines()) == (None, inf, [])
        assert bench.told(NOW) == {}
        assert bench.foresight.number_for(B, Reason.ZONE, NOW) == 0

    def test_both_stations_each_second_the_partner_first(self) -> None:
        bench = Bench()
        text = "GCSA -> GCSB is expected in 20 s: both may answer now"
        assert bench.see(border(A, B)) == [Record("foreseen", text, Reason.ZONE, B)]
        assert bench.foresight.left_s(NOW + 3.0) == 17.0
        assert list(bench.told(NOW).items()) == [(B, HandoverAhead(KEY, 20.0)), (A, HandoverAhead(KEY, 20.0))]
        assert bench.foresight.deadlines() == [NOW + 1.0]
        assert bench.told(NOW + 0.9) == {}
        assert bench.told(NOW + 1.0) == {B: HandoverAhead(KEY, 19.0), A: HandoverAhead(KEY, 19.0)}

    def test_a_standard_commander_is_not_told(self) -> None:
        bench = Bench()
        bench.standard(A)
        bench.see(border(A, B))
        assert bench.told(NOW) == {B: HandoverAhead(KEY, 20.0)}

    @pytest.mark.parametrize(("after_s", "stations"), [(2.4, {A, B}), (2.5, set())])
    def test_for_two_and_a_half_seconds_after_its_way_is_left(self, after_s: float, stations: set[int]) -> None:
        assert foreseen().told(NOW + after_s).keys() == stations

    def test_the_time_that_is_left_is_never_negative(self) -> None:
        """In an overlap authority should move eight seconds before the commander's zone ends."""
        bench = Bench()
        bench.enter(B)
        [told] = bench.see(border(B, in_s=5.0))
        assert isinstance(told, Record)
        assert told.text == "GCSA -> GCSB is expected in 0 s: both may answer now"
        assert bench.foresight.left_s(NOW) == -3.0
        bench.enter()
        assert {each.in_s for each in bench.told(NOW).values()} == {0.0}

    def test_not_during_a_transfer(self) -> None:
        bench = foreseen()
        bench.transfer(0)
        assert bench.told(NOW) == {}
        bench.authority.end_transfer()
        assert bench.told(NOW + 1.0).keys() == {A, B}

    def test_not_when_the_partners_zone_holds_the_aircraft(self) -> None:
        bench = foreseen()
        bench.see(border(A, B, in_s=9.0), now=NOW + 11.0)
        assert bench.told(NOW + 11.0).keys() == {A, B}
        bench.enter(B)
        assert bench.told(NOW + 12.0) == {}

    def test_during_another_transfer_a_border_may_come_up(self) -> None:
        bench = Bench()
        bench.transfer(0)
        bench.see(border(A, C))
        assert bench.key == replace(KEY, to_station=C)


class TestTheSameBorder:
    def test_it_has_the_time_of_the_last_look_however_late_that_is(self) -> None:
        bench = foreseen()
        assert bench.see(border(A, B, in_s=40.0), now=NOW + 1.0) == []
        assert bench.key == KEY
        assert bench.foresight.left_s(NOW + 1.0) == 40.0
        assert bench.told(NOW + 3.4).keys() == {A, B}

    def test_late_in_an_overlap_it_is_no_second_border(self) -> None:
        bench = Bench()
        bench.enter(B)
        assert len(bench.see(border(B, in_s=2.0))) == 1
        assert bench.see(border(B, in_s=1.5), now=NOW + 0.5) == []
        assert bench.key == KEY

    @pytest.mark.parametrize(("now", "known"), [(NOW + 24.9, KEY), (NOW + 25.0, CrossingKey(A, C, 2, 4))])
    def test_until_five_seconds_after_it_another_does_not_take_its_place(self, now: float, known: CrossingKey) -> None:
        bench = foreseen()
        bench.see(border(A, C, number=1), now=now)
        assert bench.key == known

    def test_another_border_of_the_same_number_on_the_way_is_another(self) -> None:
        bench = foreseen()
        bench.see(border(A, C), now=NOW + 25.0)
        assert bench.key == CrossingKey(A, C, 2, 4)

    def test_inside_the_partners_zone_the_next_border_with_this_partner_is_no_other_question(self) -> None:
        bench = foreseen()
        bench.enter(B)
        bench.told(NOW + 20.0)
        bench.see(border(B, number=1, in_s=20.0), now=NOW + 30.0)
        assert bench.key == KEY
        bench.see(border(A, C, number=2), now=NOW + 21.0)
        assert bench.key == CrossingKey(A, C, 2, 4)

    def test_not_while_a_transfer_for_it_is_under_way(self) -> None:
        bench = foreseen()
        bench.transfer(1)
        bench.see(border(A, C, number=1), now=NOW + 30.0)
        assert bench.key == KEY
        bench.authority.end_transfer()
        bench.transfer(0)
        bench.see(border(A, C, number=1), now=NOW + 30.0)
        assert bench.key == CrossingKey(A, C, 2, 4)

    def test_the_next_one_begins_without_answers_and_is_told_at_once(self) -> None:
        bench = foreseen()
        bench.foresight.accept_answer(B, OkAhead(KEY), [])
        bench.told(NOW + 24.6)
        bench.see(border(A, B, number=1), now=NOW + 25.0)
        key = CrossingKey(A, B, 2, 4)
        assert bench.told(NOW + 25.0) == {B: HandoverAhead(key, 20.0), A: HandoverAhead(key, 20.0)}

    def test_numbers_begin_again_at_one(self) -> None:
        bench = Bench()
        bench.foresight._number = 0xFFFE
        for route, number in ((1, 0xFFFF), (2, 1)):
            bench.see(border(A, B), route=route)
            assert bench.key == replace(KEY, crossing=number)


class TestWhichOne:
    @pytest.mark.parametrize(("in_s", "key"), [(30.0, KEY), (30.1, None)])
    def test_it_is_told_as_early_as_an_operator_may_need(self, in_s: float, key: CrossingKey | None) -> None:
        bench = Bench()
        bench.see(border(A, B, in_s=in_s))
        assert bench.key == key

    @pytest.mark.parametrize(("in_s", "news"), [(30.0, True), (30.1, False)])
    def test_so_early_it_is_told_what_the_partner_lacks(self, in_s: float, news: bool) -> None:
        bench = Bench()
        bench.presence[B].answer = replace(bench.presence[B].answer, mission_digest=b"")  # type: ignore[type-var]
        unfit = [each for each in bench.see(border(A, B, in_s=in_s)) if isinstance(each, Record)]
        assert [each.event for each in unfit] == (["partner_unfit", "foreseen"] if news else [])

    def test_of_several_the_next_station_on_the_route(self) -> None:
        for route, partner in (((A, B, C), B), ((A, C, B), C)):
            bench = Bench(route=route)
            bench.see(border(A, B, C))
            assert bench.key == replace(KEY, to_station=partner)

    def test_a_station_that_is_not_there_or_has_no_module_of_ours_is_passed_over(self) -> None:
        bench = Bench()
        bench.standard(B)
        bench.see(border(A, 77, in_s=3.0), border(A, B, 77, in_s=5.0, number=1), border(A, B, C, number=2))
        assert bench.key == replace(KEY, to_station=C)
        assert bench.foresight.left_s(NOW) == 20.0

    def test_a_zone_that_holds_the_aircraft_already_begins_at_no_border(self) -> None:
        bench = Bench()
        bench.enter(B)
        bench.see(border(A, B))
        assert bench.key is None
        bench.enter(B, awaits=True)
        bench.see(border(A, B))
        assert bench.key == KEY

    def test_nor_does_one_that_began_at_a_border_before(self) -> None:
        bench = Bench()
        bench.standard(C)
        bench.see(border(A, C, in_s=5.0), border(A, C, in_s=9.0, number=1), border(A, C, B, number=2))
        assert (bench.key, bench.foresight.left_s(NOW)) == (KEY, 20.0)
        bench = Bench()
        bench.see(border(A, in_s=5.0), border(A, number=1))
        assert bench.key is None

    def test_where_the_commanders_zone_ends_in_an_overlap_eight_seconds_before(self) -> None:
        bench = Bench()
        bench.enter(C)
        bench.see(border(B, C))
        assert bench.key == replace(KEY, to_station=C)
        assert bench.foresight.left_s(NOW) == 12.0

    def test_where_it_ends_and_another_begins_at_the_border_itself(self) -> None:
        bench = Bench()
        bench.see(border(B))
        assert (bench.key, bench.foresight.left_s(NOW)) == (KEY, 20.0)

    def test_behind_a_place_that_no_zone_holds_nothing_is_expected(self) -> None:
        bench = Bench()
        bench.see(border(in_s=5.0), border(B, number=1))
        assert bench.key is None

    def test_without_a_commander_nothing_is_expected(self) -> None:
        bench = Bench()
        bench.authority.owner = None
        assert bench.foresight._expected((border(B),)) is None
        assert bench.see(border(B)) == []
        assert bench.key is None


def lose(bench: Bench) -> None:
    bench.authority.lost = True


def land(bench: Bench) -> None:
    bench.fly(flying=False)


def emergency(bench: Bench) -> None:
    bench.authority.phase = Phase.EMERGENCY


def commit(bench: Bench) -> None:
    bench.authority.epoch += 1


def move(bench: Bench) -> None:
    bench.authority.owner = C


def reload(bench: Bench) -> None:
    bench.candidates.hold(Mission(bytes(32), (A, B, C)))


class TestItsEnd:
    @pytest.mark.parametrize("what", [lose, land, emergency, commit, move, reload])
    def test_with_the_commander_the_flight_and_the_mission(self, what: object) -> None:
        bench = foreseen()
        what(bench)  # type: ignore[operator]
        assert bench.told(NOW) == {}
        assert (bench.key, bench.foresight.deadlines()) == (None, [])
        bench = foreseen()
        what(bench)  # type: ignore[operator]
        assert bench.foresight.number_for(B, Reason.ZONE, NOW) == 0

    @pytest.mark.parametrize("what", [lose, land, emergency])
    def test_so_none_is_told_then(self, what: object) -> None:
        bench = Bench()
        what(bench)  # type: ignore[operator]
        assert bench.see(border(A, B)) == []
        assert bench.key is None

    def test_during_a_transfer_it_goes_on(self) -> None:
        bench = foreseen()
        bench.authority.phase = Phase.ON_HANDOVER
        assert bench.told(NOW).keys() == {A, B}
        bench = Bench()
        bench.authority.phase = Phase.ON_HANDOVER
        bench.see(border(A, B))
        assert bench.key == KEY

    def test_during_the_transfer_for_it_it_does_not_end(self) -> None:
        bench = foreseen()
        bench.transfer(1)
        commit(bench)
        bench.told(NOW + 70.0)
        assert bench.key == KEY
        bench.authority.end_transfer()
        bench.told(NOW + 70.0)
        assert bench.key is None

    def test_the_answers_end_with_it(self) -> None:
        bench = foreseen()
        bench.foresight.accept_answer(B, OkAhead(KEY), [])
        emergency(bench)
        bench.told(NOW)
        assert bench.foresight.accept_answer(B, OkAhead(KEY), []) == "no such border ahead"
        assert bench.foresight.left_s(NOW) == inf

    def test_another_route_ends_it(self) -> None:
        bench = foreseen()
        bench.see(route=1)
        assert bench.key is None
        bench = foreseen()
        bench.see(route=0)
        assert bench.key == KEY

    @pytest.mark.parametrize(
        ("holds", "after_s", "key"),
        [(False, 59.9, KEY), (False, 60.0, None), (True, 60.0, KEY)],
    )
    def test_a_minute_after_its_way_was_left_outside_the_partners_zone(
        self, holds: bool, after_s: float, key: CrossingKey | None
    ) -> None:
        bench = foreseen()
        bench.enter(*((B,) if holds else ()))
        bench.told(NOW + after_s)
        assert bench.key == key

    @pytest.mark.parametrize(("after_s", "key"), [(11.9, KEY), (12.0, None)])
    def test_with_the_partners_zone_once_it_was_entered_within_eight_seconds_of_the_border(
        self, after_s: float, key: CrossingKey | None
    ) -> None:
        bench = foreseen()
        bench.enter(B)
        bench.told(NOW + after_s)
        assert bench.key == KEY
        bench.enter()
        bench.told(NOW + after_s)
        assert bench.key == key

    def test_a_border_that_was_not_entered_is_not_over_yet(self) -> None:
        bench = foreseen()
        bench.told(NOW + 21.0)
        assert bench.key == KEY


class TestNumber:
    def test_a_transfer_to_its_partner_for_the_zones_sake_has_it(self) -> None:
        bench = foreseen()
        named = {reason for reason in Reason if bench.foresight.number_for(B, reason, NOW) == 1}
        assert named == {Reason.ZONE, Reason.ZONE_ENDS}
        assert bench.foresight.number_for(C, Reason.ZONE, NOW) == 0


class TestAnswers:
    def test_each_is_told_once_and_both_stations_learn_of_it(self) -> None:
        bench = foreseen()
        actions: list[Action] = []
        for consent in (Consent.WAITING, Consent.WAITING, Consent.GRANTED):
            assert bench.foresight.accept_answer(B, OkAhead(KEY, consent), actions) is None
        assert bench.foresight.accept_answer(A, OkAhead(KEY, Consent.DENIED), actions) is None
        assert actions == [
            Record("foreseen_answer", "GCSB asks its operator", Reason.ZONE, B),
            Record("foreseen_answer", "GCSB agrees to it beforehand", Reason.ZONE, B),
            Record("foreseen_answer", "GCSA will not have it", Reason.ZONE, A),
        ]
        told = HandoverAhead(KEY, 20.0, commander=Consent.DENIED, partner=Consent.GRANTED)
        assert bench.told(NOW) == {A: told, B: told}

    def test_only_the_two_stations_may_answer_and_only_for_this_border(self) -> None:
        bench = foreseen()
        assert bench.foresight.accept_answer(C, OkAhead(KEY), []) == "not the sender's to say"
        other = replace(KEY, crossing=2)
        assert bench.foresight.accept_answer(B, OkAhead(other), []) == "no such border ahead"
        assert Bench().foresight.accept_answer(B, OkAhead(KEY), []) == "no such border ahead"
        assert bench.told(NOW)[B] == HandoverAhead(KEY, 20.0)

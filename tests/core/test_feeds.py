# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of feeds: one source at a time, who takes over and when, and which RTK base may be used."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.feeds import BasePlaces, FeedKind, FeedRule, FeedSettings, Source, TerrainRequests, Unnamed

A, B, C = 251, 252, 253
RULE = FeedRule(3.0, (A, B), named=True)
ARMED, GROUND = True, False


def run(source: Source, station: int, start: float, end: float, armed: bool = ARMED) -> list[bool]:
    """A station that sends once a second."""
    return [source.offer(station, True, armed, start + second) for second in range(int(end - start) + 1)]


def test_the_first_that_sends_is_the_source_and_the_next_one_waits() -> None:
    source = Source(RULE)
    assert source.offer(A, True, ARMED, 0.0)
    assert not source.offer(B, True, ARMED, 0.1)
    assert source.offer(A, True, ARMED, 1.0)


def test_a_station_that_is_not_named_is_never_the_source() -> None:
    source = Source(RULE)
    assert run(source, C, 0.0, 60.0) == [False] * 61
    assert source.station is None


def test_the_next_one_takes_over_after_the_silence_and_not_before() -> None:
    source = Source(RULE)
    source.offer(A, True, ARMED, 0.0)
    assert [source.offer(B, True, ARMED, now) for now in (1.0, 2.0, 3.0)] == [False] * 3
    assert source.offer(B, True, ARMED, 3.01)


def test_time_alone_makes_the_next_one_the_source() -> None:
    source = Source(RULE)
    source.offer(A, True, ARMED, 0.0)
    source.offer(B, True, ARMED, 2.0)
    source.decide(ARMED, 3.01)
    assert source.station == B


def test_armed_a_source_that_comes_back_waits() -> None:
    source = Source(RULE)
    source.offer(A, True, ARMED, 0.0)
    assert run(source, B, 4.0, 10.0) == [True] * 7
    for second in range(11, 100):
        assert not source.offer(A, True, ARMED, float(second))
        assert source.offer(B, True, ARMED, second + 0.5)
    assert not source.offer(A, True, ARMED, 102.4)
    assert source.offer(A, True, ARMED, 102.6), "now the other one is silent"


def test_on_the_ground_the_first_takes_over_again_after_it_has_sent_without_a_pause() -> None:
    source = Source(RULE)
    run(source, B, 0.0, 10.0, GROUND)
    found = []
    for second in range(11, 16):
        source.offer(B, True, GROUND, second + 0.5)
        found.append(source.offer(A, True, GROUND, float(second)))
    assert found == [False, False, False, True, True]


def test_a_source_that_is_alone_and_silent_is_said_to_be() -> None:
    source = Source(RULE)
    source.offer(A, True, ARMED, 0.0)
    source.decide(ARMED, 3.0)
    assert (source.station, source.silent) == (A, False)
    source.decide(ARMED, 3.1)
    assert (source.station, source.silent) == (A, True)
    assert source.offer(A, True, ARMED, 20.0)
    assert not source.silent


def test_a_base_that_may_not_be_used_is_as_good_as_silent() -> None:
    source = Source(RULE)
    assert not source.offer(A, False, ARMED, 0.0)
    assert source.offer(B, True, ARMED, 0.1)
    assert not source.offer(B, False, ARMED, 0.2)
    assert source.offer(A, True, ARMED, 0.3)


@given(st.lists(st.tuples(st.sampled_from([A, B, C]), st.booleans(), st.booleans(), st.floats(0.0, 5.0))))
def test_of_any_offers_one_station_passes_at_a_time(offers: list[tuple[int, bool, bool, float]]) -> None:
    """Between the last frame of one source and the first of another is the silence, or the earlier one takes over on
    the ground, or the source's base may not be used any more."""
    source, now, last = Source(RULE), 0.0, None
    for station, fits, armed, step_s in offers:
        now += step_s
        refused = not fits and station == source.station
        passes = source.offer(station, fits, armed, now)
        assert not passes or (station == source.station and fits and station != C)
        if passes and armed and last is not None and last[0] != station:
            assert now - last[1] > RULE.silence_s
        if passes or refused:
            last = None if refused else (station, now)
        if not armed:
            last = None


class TestBases:
    """Places of RTK bases."""

    HERE = (4_000_000.0, 500_000.0, 4_900_000.0)
    NEAR = (4_000_000.6, 500_000.0, 4_900_000.0)
    FAR = (4_000_001.1, 500_000.0, 4_900_000.0)

    def test_without_a_place_every_base_may_be_used(self) -> None:
        places = BasePlaces(1.0)
        places.follow(A, False, ARMED)
        assert places.fits(A, A)
        assert places.fits(B, A)

    def test_a_base_at_the_place_may_be_used_and_one_elsewhere_not(self) -> None:
        places = BasePlaces(1.0)
        places.note(A, self.HERE)
        places.follow(A, False, ARMED)
        assert places.first == A
        assert not places.fits(B, A), "its place is not known"
        places.note(B, self.FAR)
        assert not places.fits(B, A)
        assert round(places.apart_m(B), 3) == 1.1
        places.note(B, self.NEAR)
        assert places.fits(B, A)

    def test_armed_the_place_stays_also_if_the_base_moves_or_is_silent(self) -> None:
        places = BasePlaces(1.0)
        places.note(A, self.HERE)
        places.follow(A, False, ARMED)
        places.note(A, self.FAR)
        places.follow(A, False, ARMED)
        assert not places.fits(A, A)
        places.note(B, self.NEAR)
        places.follow(A, True, ARMED)
        assert places.fits(B, A)

    def test_on_the_ground_the_place_is_that_of_the_source_and_none_while_it_is_silent(self) -> None:
        places = BasePlaces(1.0)
        places.note(A, self.HERE)
        places.note(B, self.FAR)
        places.follow(A, False, GROUND)
        assert not places.fits(B, A)
        places.follow(A, True, GROUND)
        assert places.fits(B, A)
        places.follow(B, False, GROUND)
        assert not places.fits(A, B)


def test_without_a_configuration_all_is_as_before_there_were_feeds() -> None:
    rules = FeedSettings().rules
    assert set(rules) == set(FeedKind)
    assert not any(rule.named for rule in rules.values())
    unnamed = Counter(rule.unnamed for rule in rules.values())
    assert unnamed == {Unnamed.COMMANDER: 2, Unnamed.NO_STATION: 2}
    assert {kind for kind, rule in rules.items() if rule.unnamed is Unnamed.COMMANDER} == {
        FeedKind.RTK,
        FeedKind.TERRAIN,
    }


class TestTerrain:
    """Requests for terrain."""

    BLOCK = (520_000_000, 40_000_000, 100)

    def test_the_commander_is_asked_first_and_then_the_others_in_their_order(self) -> None:
        requests = TerrainRequests(FeedRule(4.0, (A, B, C), named=True))
        found = [requests.ask(self.BLOCK, B, now, 3) for now in (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0)]
        assert found == [(B,), (B,), (B, A), (B, A), (B, A, C), (B, A, C), (B, A, C), (B, A, C)]

    def test_a_commander_that_is_not_named_is_not_asked(self) -> None:
        requests = TerrainRequests(FeedRule(4.0, (A,), named=True))
        assert requests.ask(self.BLOCK, B, 0.0, 3) == (A,)
        assert requests.ask(self.BLOCK, B, 9.0, 3) == (A,)

    def test_a_station_answers_what_it_was_asked_and_nothing_else(self) -> None:
        requests = TerrainRequests(FeedRule(4.0, (A, B), named=True))
        assert not requests.answers(A, self.BLOCK, 0, 0.0)
        requests.ask(self.BLOCK, A, 0.0, 3)
        assert requests.answers(A, self.BLOCK, 0, 1.0)
        assert not requests.answers(B, self.BLOCK, 0, 1.0)
        assert not requests.answers(A, (1, 2, 3), 0, 1.0)
        assert requests.ask(self.BLOCK, A, 4.5, 3) == (A,), "it is at it"
        assert requests.ask(self.BLOCK, A, 5.5, 3) == (A, B)
        assert requests.answers(B, self.BLOCK, 0, 6.0)
        assert not requests.answers(B, self.BLOCK, 0, 60.0), "long forgotten"

    def test_a_part_that_was_not_asked_for_or_is_answered_is_not_taken(self) -> None:
        requests = TerrainRequests(FeedRule(4.0, (A, B), named=True))
        requests.ask(self.BLOCK, A, 0.0, 0b101)
        assert [requests.answers(A, self.BLOCK, part, 1.0) for part in (0, 1, 2, 0)] == [True, False, True, False]
        requests.ask(self.BLOCK, A, 2.0, 0b001)
        assert [requests.answers(A, self.BLOCK, part, 3.0) for part in (0, 2)] == [True, False]

    def test_the_open_requests_are_bounded(self) -> None:
        requests = TerrainRequests(FeedRule(4.0, (A,), named=True))
        for number in range(1000):
            requests.ask((number, 0, 100), A, number / 1000, 1)
        assert not requests.answers(A, (900, 0, 100), 0, 1.0)
        assert requests.answers(A, (999, 0, 100), 0, 1.0)

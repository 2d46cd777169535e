# SPDX-License-Identifier: GPL-3.0-or-later

"""When an aircraft is off its route, and when no more: values over time, and what is told."""

from __future__ import annotations

from itertools import pairwise
from math import inf, nan

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits, RouteNews, TrackFact

LIMITS = RouteLimits(off_route_m=30.0, off_heading_deg=60.0, off_hold_s=3.0, off_clear_s=3.0)


def fact(across_m: float, course_deg: float | None = 0.0, seq: int = 5) -> TrackFact:
    return TrackFact(seq, across_m, course_deg, 120.0, 400.0)


def told(facts: list[TrackFact | None], every_s: float = 1.0, limits: RouteLimits = LIMITS) -> list[tuple[float, str]]:
    """What is told, with its time: the first look is at 0 s."""
    check = RouteCheck(limits)
    news = ((n * every_s, check.update(fact, 100.0 + n * every_s)) for n, fact in enumerate(facts))
    return [(at_s, entry.text) for at_s, entry in news if entry is not None]


OFF_41 = "off route: 41 m right of the leg to waypoint 5"


@pytest.mark.parametrize(
    ("across_m", "expected"),
    [
        pytest.param([41] * 3, [], id="two seconds are none yet"),
        pytest.param([41] * 4, [(3.0, OFF_41)], id="three are"),
        pytest.param([41] * 60, [(3.0, OFF_41)], id="it is told once"),
        pytest.param([-41] * 4, [(3.0, "off route: 41 m left of the leg to waypoint 5")], id="on the left"),
        pytest.param([30] * 60, [], id="the limit itself is no deviation"),
        pytest.param([0, 41, 0, 41, 0, 41, 0, 41, 0], [], id="a position that jumps is none"),
        pytest.param(
            [41, 41, 25, 41, 41, 25, 41, 41], [(7.0, OFF_41)], id="a little less for a moment puts nothing off"
        ),
        pytest.param([41, 41, 41, 19, 41, 41, 41], [], id="well within begins anew"),
        pytest.param(
            [41] * 4 + [10] * 4,
            [(3.0, OFF_41), (7.0, "on the route again: 10 m right of the leg to waypoint 5")],
            id="three seconds well within, and it is over",
        ),
        pytest.param([41] * 4 + [25] * 60, [(3.0, OFF_41)], id="a little less is not over"),
        pytest.param([41] * 4 + [10, 10, 25] * 20, [(3.0, OFF_41)], id="nor is within for two seconds at a time"),
        pytest.param([41] * 4 + [0.2] * 4, [(3.0, OFF_41), (7.0, "on the route again: on the leg to waypoint 5")]),
    ],
)
def test_distance_from_the_leg(across_m: list[float], expected: list[tuple[float, str]]) -> None:
    assert told([fact(across) for across in across_m]) == expected


@pytest.mark.parametrize(
    ("course_deg", "expected"),
    [
        ([95, 95, 95], []),
        ([-95, -95, -95, -95], [(3.0, "off route: course 95 deg off the leg to waypoint 5, 4 m right of it")]),
        ([60] * 60, []),
        ([180, None, 180, None, 180, 180], []),
        ([99, 99, 99, None, 99, 99], [(5.0, "off route: course 99 deg off the leg to waypoint 5, 4 m right of it")]),
    ],
)  # fmt: skip
def test_course_against_the_leg(course_deg: list[float | None], expected: list[tuple[float, str]]) -> None:
    """Where there is none (a turn, no speed) nothing is counted, and nothing is forgotten."""
    assert told([fact(4.0, course) for course in course_deg]) == expected


def test_one_deviation_of_two_measures_is_over_with_the_second() -> None:
    both = [fact(41, 95)] * 4
    distance_over = [fact(41, 0)] * 4
    neither = [fact(0, 0)] * 4
    assert told([*both, *distance_over, *neither]) == [
        (3.0, OFF_41),
        (11.0, "on the route again: on the leg to waypoint 5"),
    ]


def test_where_no_leg_is_flown_a_deviation_is_over_and_counting_begins_anew() -> None:
    ends = "no leg of the mission is flown any more: the deviation is over"
    assert told([*[fact(41)] * 4, None, None, *[fact(41)] * 3]) == [(3.0, OFF_41), (4.0, ends)]
    assert told([fact(41), fact(41), fact(41), None, fact(41), fact(41), fact(41), fact(41)]) == [(7.0, OFF_41)]
    assert told([None] * 10) == []


def test_another_leg_is_no_end_of_a_deviation() -> None:
    assert told([*[fact(41)] * 4, *[fact(35, seq=6)] * 10]) == [(3.0, OFF_41)]


def test_what_was_not_seen_is_not_counted() -> None:
    """A station that hears of the aircraft every 10 s knows nothing of the time between."""
    assert told([fact(41)] * 20, every_s=10.0) == []
    assert told([fact(41)] * 2, every_s=4.0) == [(4.0, OFF_41)]


def test_a_clock_that_stands_or_goes_back_counts_nothing() -> None:
    check = RouteCheck(LIMITS)
    for now in (100.0, 100.0, 99.0, 98.0, 99.5, 101.0):  # 3 s forward, in 1.5 s pieces
        news = check.update(fact(41), now)
    assert news == RouteNews(True, OFF_41, fact(41))


def test_the_fact_of_the_present_deviation_is_there_to_be_asked() -> None:
    check = RouteCheck(LIMITS)
    for now in range(4):
        assert check.deviation is None
        check.update(fact(41), float(now))
    assert check.deviation == fact(41)
    check.update(fact(77, seq=6), 4.0)
    assert check.deviation == fact(77, seq=6)
    check.update(None, 5.0)
    assert check.deviation is None


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_what_is_no_number_is_no_evidence(value: float) -> None:
    assert told([fact(value, value)] * 60) == []
    assert told([*[fact(41)] * 4, *[fact(value)] * 20]) == [(3.0, OFF_41)]


def test_limits_that_were_changed_count() -> None:
    limits = RouteLimits(off_route_m=10.0, off_heading_deg=20.0, off_hold_s=1.0, off_clear_s=2.0)
    assert [at_s for at_s, _text in told([*[fact(11)] * 2, *[fact(6)] * 3], limits=limits)] == [1.0, 4.0]
    assert [at_s for at_s, _text in told([*[fact(0, 21)] * 2, *[fact(0, 13)] * 3], limits=limits)] == [1.0, 4.0]


# ---- properties ---------------------------------------------------------------------------------------------------

STEPS = st.floats(0.0, 4.0)


@pytest.mark.slow
@given(st.lists(st.tuples(STEPS, st.floats(-30, 30), st.one_of(st.none(), st.floats(-60, 60)))))
def test_within_its_limits_nobody_is_off_the_route(flight: list[tuple[float, float, float | None]]) -> None:
    check, now = RouteCheck(LIMITS), 0.0
    for step_s, across_m, course_deg in flight:
        now += step_s
        assert check.update(fact(across_m, course_deg), now) is None


@given(st.lists(st.tuples(STEPS, st.floats(20.1, 500))))
def test_noise_around_the_limit_is_told_once(flight: list[tuple[float, float]]) -> None:
    check, now, news = RouteCheck(LIMITS), 0.0, 0
    for step_s, across_m in flight:
        now += step_s
        news += check.update(fact(across_m), now) is not None
    assert news <= 1


#: its course had been off for a second when it was back on its route, and two more were enough
@example([(0.0, 31.0, None), (3.0, 31.0, 61.0), (1.0, 0.0, 61.0), (0.0, 0.0, None), (3.0, 0.0, 61.0), (2.0, 0.0, 61.0)])
@given(st.lists(st.tuples(STEPS, st.floats(), st.one_of(st.none(), st.floats()))))
def test_begin_and_end_take_turns_and_are_three_seconds_apart(flight: list[tuple[float, float, float | None]]) -> None:
    check, now = RouteCheck(LIMITS), 0.0
    news = []
    for step_s, across_m, course_deg in flight:
        now += step_s
        entry = check.update(fact(across_m, course_deg), now)
        if entry is not None:
            news.append((now, entry.off))
        assert (check.deviation is not None) is (bool(news) and news[-1][1])
    assert all(off is (number % 2 == 0) for number, (_at, off) in enumerate(news))
    assert all(later - sooner >= 3.0 - 1e-9 for (sooner, _a), (later, _b) in pairwise(news))


@given(st.integers(4, 40), st.floats(31, 1e6), st.floats(0.1, 4.0))
def test_who_stays_away_is_told_of_after_the_hold_off_whatever_the_rate(
    n: int, across_m: float, every_s: float
) -> None:
    facts = [fact(across_m)] * (n + 40)
    (at_s, _text), *others = told(facts, every_s=every_s)
    assert others == []
    assert 3.0 - 1e-6 <= at_s < 3.0 + every_s + 1e-6


def test_the_limits_without_a_word_in_the_configuration() -> None:
    assert RouteLimits() == RouteLimits(30.0, 60.0, 3.0, 3.0)


@pytest.mark.parametrize("deviation", [fact(41.0), fact(4.0, 95.0)], ids=["distance", "course"])
def test_after_a_silence_of_more_than_five_seconds_it_is_counted_anew(deviation: TrackFact) -> None:
    assert [at for at, _text in told([deviation] * 4, every_s=5.0)] == [5.0]
    assert told([deviation] * 20, every_s=5.1) == []


def test_two_thirds_of_the_limit_is_not_well_within() -> None:
    assert told([fact(41.0)] * 4 + [fact(20.0)] * 60) == [(3.0, OFF_41)]
    assert len(told([fact(41.0)] * 4 + [fact(19.9)] * 60)) == 2


@pytest.mark.parametrize(
    ("across_m", "words"),
    [(0.0, "on"), (0.49, "on"), (-0.49, "on"), (0.5, "0 m right of"), (0.9, "1 m right of"), (-1.2, "1 m left of")],
)
def test_half_a_metre_beside_the_leg_is_on_it(across_m: float, words: str) -> None:
    assert fact(across_m).side == words

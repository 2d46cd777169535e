# SPDX-License-Identifier: GPL-3.0-or-later

"""Two words of where the aircraft is: when a pair is not used, when they disagree, and when they agree again."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.config.position import PositionSettings
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.monitors.position.cross_check import CLOSE, CrossCheck, Difference, Place

SETTINGS = PositionSettings(apart_m=25.0, apart_height_m=30.0, apart_mps=8.0, apart_s=2.0, agree_s=5.0)
HERE = Place(52.679, 5.924, 40.0, 3.0, -4.0)
#: one for each measure, a little beyond its limit
BEYOND = [Difference(25.1, 0.0, 0.0), Difference(0.0, 30.1, 0.0), Difference(0.0, 0.0, 8.1)]
NONE = Difference(0.0, 0.0, 0.0)


def looked(check: CrossCheck, difference: Difference, begin: float, end: float) -> list[bool]:
    """Whether they disagree after each look, ten times a second."""
    found = []
    for step in range(round((end - begin) * 10) + 1):
        check.compare(difference, begin + step / 10)
        found.append(check.apart)
    return found


def test_what_is_measured_is_metres_and_metres_a_second() -> None:
    lat, lon = offset(HERE.lat_deg, HERE.lon_deg, 30.0, 40.0)
    found = Difference.between(HERE, Place(lat, lon, 33.0, 0.0, 0.0))
    assert found.over_ground_m == pytest.approx(50.0, abs=0.1)
    assert found.height_m == pytest.approx(7.0)
    assert found.speed_mps == pytest.approx(5.0)


def test_across_the_180th_meridian_they_are_as_near_as_anywhere() -> None:
    one, other = Place(0.0, 179.9999, 0, 0, 0), Place(0.0, -179.9999, 0, 0, 0)
    assert Difference.between(one, other).over_ground_m == pytest.approx(22.3, abs=0.1)


@pytest.mark.parametrize("beyond", BEYOND)
def test_a_pair_beyond_one_limit_is_not_used_at_once(beyond: Difference) -> None:
    check = CrossCheck(SETTINGS)
    check.compare(NONE, 0.0)
    assert check.sound
    check.compare(beyond, 0.1)
    assert not check.sound
    assert not check.apart
    check.compare(NONE, 0.2)
    assert check.sound, "one pair is no disagreement"


@pytest.mark.parametrize("beyond", BEYOND)
def test_pairs_that_stay_beyond_are_a_disagreement_after_their_time(beyond: Difference) -> None:
    check = CrossCheck(SETTINGS)
    found = looked(check, beyond, 10.0, 12.0)
    assert found == [False] * 20 + [True]


def test_what_is_beyond_now_and_then_is_not_used_and_no_disagreement() -> None:
    check = CrossCheck(SETTINGS)
    for second in range(120):
        check.compare(BEYOND[0], second)
        assert not check.sound
        assert True not in looked(check, NONE, second + 0.1, second + 0.9)
        assert check.sound


@pytest.mark.parametrize(
    ("lies", "truths", "after_s"), [(9, 1, 3.0), (1, 1, 6.0), (1, 2, 13.0)], ids=["9 of 10", "1 of 2", "1 of 3"]
)
def test_one_that_tells_the_truth_now_and_then_is_found_out(lies: int, truths: int, after_s: float) -> None:
    """The fault: a single true record took back all that was held against a box that lies, and nobody was told."""
    check = CrossCheck(SETTINGS)
    now, pairs = 0.0, [BEYOND[0]] * lies + [NONE] * truths
    while not check.apart:
        assert now < after_s
        for pair in pairs:
            check.compare(pair, now)
            now += 0.1
    for _ in range(20):
        for pair in pairs:
            check.compare(pair, now)
            assert not check.sound, "no record of it is used any more"
            now += 0.1


def test_a_silence_between_two_pairs_counts_for_nothing() -> None:
    check = CrossCheck(SETTINGS)
    for minute in range(3):
        check.compare(BEYOND[0], 60.0 * minute)
        assert not check.apart


def test_it_is_over_when_they_were_well_together_for_long_enough() -> None:
    check = CrossCheck(SETTINGS)
    looked(check, BEYOND[0], 0.0, 2.0)
    near = Difference(25.0 * CLOSE - 0.1, 0.0, 0.0)
    found = looked(check, near, 3.0, 8.0)
    assert found == [True] * 50 + [False]
    assert check.sound


def test_between_the_limit_and_two_thirds_of_it_nothing_changes() -> None:
    between = Difference(20.0, 0.0, 0.0)
    check = CrossCheck(SETTINGS)
    assert True not in looked(check, between, 0.0, 60.0)
    looked(check, BEYOND[0], 60.0, 62.0)
    assert False not in looked(check, between, 62.1, 120.0)
    assert not check.sound


def test_a_pair_that_cannot_be_measured_is_beyond() -> None:
    check = CrossCheck(SETTINGS)
    check.compare(Difference(float("nan"), 0.0, 0.0), 0.0)
    assert not check.sound


def test_the_worst_measure_is_told() -> None:
    check = CrossCheck(SETTINGS)
    assert check.words == ""
    check.compare(Difference(30.0, 90.0, 1.0), 0.0)
    assert check.words == "90 m apart in height (limit 30 m)"
    check.compare(Difference(80.0, 3.0, 1.0), 0.1)
    assert check.words == "80 m apart (limit 25 m)"
    check.compare(Difference(1.0, 3.0, 14.0), 0.2)
    assert check.words == "14.0 m/s apart in speed (limit 8 m/s)"


@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=80))
def test_whatever_comes_no_pair_beyond_a_limit_is_used(distances: list[float]) -> None:
    check = CrossCheck(SETTINGS)
    for step, distance in enumerate(distances):
        check.compare(Difference(distance, 0.0, 0.0), step * 0.3)
        assert not (check.sound and distance > 25.0)

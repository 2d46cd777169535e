# SPDX-License-Identifier: GPL-3.0-or-later

"""Positions of a flight against its legs: what is lost on a busy computer is no fault of the flight."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.leg import Leg
from tests.sitl.curve_flight import Place, hold_against

HOME = (47.0, 8.0)


def spot(along_m: float, beside_m: float = 0.0) -> tuple[float, float]:
    """A place on a quarter of a circle of 200 m, so far along it and beside it."""
    angle, radius_m = along_m / 200.0, 200.0 + beside_m
    return offset(*HOME, radius_m * math.cos(angle), radius_m * math.sin(angle))


def walked() -> list[Leg]:
    ends = [(*spot(20.0 * number), 30.0) for number in range(16)]
    return [Leg(2, start, end, 2.0, curved=True) for start, end in pairwise(ends)]


def flown(step_m: float, beside_m: float = 0.0) -> list[Place]:
    """At 10 m/s, a position each so many metres; the next item follows at 300 m."""
    count = int(320.0 / step_m)
    return [
        Place(n * step_m / 10.0, *spot(n * step_m, beside_m), 30.0, 2 if n * step_m < 300.0 else 3)
        for n in range(count + 1)
    ]


@pytest.mark.parametrize("step_m", [1.0, 13.0, 19.0])
def test_positions_that_are_lost_are_not_missed(step_m: float) -> None:
    """19 m apart are 1.9 s without a position: the arc is 0.2 m off their line."""
    assert hold_against(walked(), flown(step_m), 2).missed_m < 0.5


@pytest.mark.parametrize("step_m", [1.0, 13.0])
def test_a_path_beside_the_legs_is_missed(step_m: float) -> None:
    found = hold_against(walked(), flown(step_m, beside_m=5.0), 2)
    assert found.missed_m == pytest.approx(5.0, abs=0.5)
    assert found.beside_m == pytest.approx(5.0, abs=0.5)


def test_a_flight_that_turns_off_before_the_end_has_missed_it() -> None:
    places = [place for place in flown(1.0) if place.time_s < 28.0]
    assert hold_against(walked(), places, 2).missed_m > 19.0

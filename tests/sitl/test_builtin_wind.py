# SPDX-License-Identifier: GPL-3.0-or-later

"""The wind of the embedded vehicle: what it leaves of a wish, where it blows to, and how much of it there is below."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.vehicles.builtin.bench import Bench
from sitl.vehicles.builtin.physics import made_good


@pytest.mark.parametrize(
    ("wanted", "wind", "becomes"),
    [
        pytest.param((15.0, 0.0), (0.0, 0.0), (15.0, 0.0), id="calm air limits nothing"),
        pytest.param((10.0, 0.0), (5.0, 0.0), (10.0, 0.0), id="a tail wind that is wanted anyway"),
        pytest.param((10.0, 0.0), (-8.0, 0.0), (2.0, 0.0), id="upwind of 8 m/s it makes 2"),
        pytest.param((10.0, 0.0), (0.0, 8.0), (6.0, 0.0), id="across 8 m/s it makes 6, straight"),
        pytest.param((10.0, 0.0), (-11.0, 0.0), (-1.0, 0.0), id="11 m/s blows it backwards"),
        pytest.param((10.0, 0.0), (0.0, 13.0), (0.0, 3.0), id="13 m/s carries it along"),
        pytest.param((0.0, 0.0), (0.0, 9.0), (0.0, 0.0), id="a hover holds in 9 m/s"),
        pytest.param((0.0, 0.0), (0.0, 12.0), (0.0, 2.0), id="and not in 12"),
    ],
)
def test_what_becomes_of_a_velocity(
    wanted: tuple[float, float], wind: tuple[float, float], becomes: tuple[float, float]
) -> None:
    assert made_good(wanted, wind) == pytest.approx(becomes, abs=1e-9)


SPEED = st.floats(-30, 30)


@given(st.tuples(SPEED, SPEED), st.tuples(SPEED, SPEED))
def test_nothing_needs_more_than_there_is_and_what_can_be_held_is_held(
    wanted: tuple[float, float], wind: tuple[float, float]
) -> None:
    north, east = made_good(wanted, wind)
    if wind == (0.0, 0.0):
        assert (north, east) == wanted
        return
    assert math.hypot(north - wind[0], east - wind[1]) <= 10.0 + 1e-6
    if math.hypot(*wind) <= 10.0:  # the same way over ground, slower at most
        assert north * wanted[1] == pytest.approx(east * wanted[0], abs=1e-3)
        assert math.hypot(north, east) <= math.hypot(*wanted) + 1e-6


@pytest.mark.parametrize(
    ("kind", "height_m", "speed"),
    [(0.0, 60.0, 12.0), (0.0, 90.0, 12.0), (0.0, 15.0, 6.0), (0.0, 0.0, 0.0), (1.0, 15.0, 12.0)],
)
def test_there_is_less_of_it_below_as_in_sitl(kind: float, height_m: float, speed: float) -> None:
    copter = Bench({"SIM_WIND_SPD": 12.0, "SIM_WIND_DIR": 90.0, "SIM_WIND_T": kind}).vehicle.copter
    copter.body.position = (0.0, 0.0, height_m)
    north, east = copter.wind()
    assert (north, east) == pytest.approx((0.0, -speed), abs=1e-9), "it comes from the east"


def test_on_the_ground_nothing_is_blown_away() -> None:
    bench = Bench({"SIM_WIND_SPD": 25.0, "SIM_WIND_T": 1.0})
    bench.run(20.0)
    assert bench.vehicle.copter.body.position == (0.0, 0.0, 0.0)

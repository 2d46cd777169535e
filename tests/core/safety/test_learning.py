# SPDX-License-Identifier: GPL-3.0-or-later

"""What a flight teaches: power by phase, wind, the airspeed that can be held; and what it must not.

Configured: hover 360 W, cruise 440 W at 10 m/s, climb 432 W, descent 360 W, 2 m/s of wind where nobody knows.
"""

from __future__ import annotations

from dataclasses import replace
from math import atan, degrees, inf, nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.safety.energy import EnergyModel, Piece, Wind
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.core.safety.learning import Learner, Motion, thrust_direction

SETTINGS = EnergySettings(battery_wh=100.0, hover_w=360.0, cruise_w=440.0, headwind_mps=2.0)
HOVER = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 360.0)
NORTHWARDS = Motion(10.0, 0.0, 0.0, 20.0, 0.0, 440.0)
CLIMB = replace(HOVER, up_mps=2.5)
DESCENT = replace(HOVER, up_mps=-1.5)
#: what SITL's quad leans by: 12.2 degrees at 5 m/s, 29.9 at 10 (flown)
DRAG = {"drag_per_s": 0.2843, "drag_per_m": 0.02798}


class Flight:
    """A learner, a second at a time."""

    def __init__(self, settings: EnergySettings = SETTINGS) -> None:
        self.learner = Learner(settings)
        self.now = 1000.0

    def fly(self, motion: Motion, seconds: int, wind: tuple[float, float] | None = None) -> None:
        """`wind`: as it is; the autopilot's message says a tenth less."""
        for _ in range(seconds):
            self.now += 1.0
            if wind is not None:
                self.learner.wind_seen(wind[0] / 1.09, wind[1], self.now)
            self.learner.fly(motion, self.now)

    @property
    def model(self) -> EnergyModel:
        return self.learner.model(self.now)[0]

    @property
    def source(self) -> str:
        return self.learner.model(self.now)[1]


@pytest.fixture
def flight() -> Flight:
    return Flight()


def test_before_anything_was_seen_it_is_what_was_configured(flight: Flight) -> None:
    assert flight.model == SETTINGS.model()
    assert (flight.source, flight.learner.learned) == ("", False)


def test_without_numbers_there_is_nothing_to_learn_from() -> None:
    with pytest.raises(ValueError, match="has no battery_wh"):
        Learner(EnergySettings(hover_w=360.0))


@pytest.mark.parametrize(
    ("motion", "name", "configured"),
    [(HOVER, "hover_w", 360.0), (CLIMB, "climb_w", 432.0), (DESCENT, "descent_w", 360.0)],
)
def test_power_is_learned_by_phase(flight: Flight, motion: Motion, name: str, configured: float) -> None:
    flight.fly(replace(motion, power_w=500.0), 6)
    # five samples: what was seen recently counts at once
    assert getattr(flight.model, name) == 500.0
    flight.fly(replace(motion, power_w=configured), 400)
    assert getattr(flight.model, name) == pytest.approx(configured, rel=0.02)


def test_less_than_configured_is_learned_slowly_and_never_below_half(flight: Flight) -> None:
    flight.fly(replace(HOVER, power_w=300.0), 31)
    # 30 samples weigh about as much as what was configured
    assert 315.0 < flight.model.hover_w < 345.0
    flight.fly(replace(HOVER, power_w=100.0), 3000)
    assert flight.model.hover_w == 180.0


def test_more_than_configured_is_believed_however_much_it_is(flight: Flight) -> None:
    flight.fly(replace(HOVER, power_w=4000.0), 10)
    assert flight.model.hover_w == 4000.0
    assert flight.model.cruise_w == 4000.0
    assert flight.model.climb_w == 4000.0


@pytest.mark.parametrize("wild", [0.0, -5.0, 9000.0, 1e9, nan, inf])
def test_a_wild_value_now_and_then_is_nothing(flight: Flight, wild: float) -> None:
    flight.fly(HOVER, 20)
    before = flight.model.hover_w
    for _ in range(6):
        flight.fly(replace(HOVER, power_w=wild), 1)
        flight.fly(HOVER, 9)
    assert flight.model.hover_w == pytest.approx(before, rel=0.001)


@pytest.mark.parametrize("field", ["north_mps", "east_mps", "up_mps", "lean_deg", "lean_to_deg"])
def test_a_motion_that_is_no_number_teaches_nothing(flight: Flight, field: str) -> None:
    flight.fly(replace(HOVER, power_w=900.0, **{field: nan}), 50)
    assert flight.model == SETTINGS.model()


def test_cruise_is_learned_at_the_airspeed_that_it_was_flown_at(flight: Flight) -> None:
    # against 2 m/s over ground 8 m/s: 10 m/s through the air
    flight.fly(replace(NORTHWARDS, north_mps=8.0, power_w=480.0), 400, wind=(2.0, 0.0))
    assert flight.model.cruise_w == pytest.approx(480.0, rel=0.01)
    flight.fly(replace(NORTHWARDS, north_mps=8.0, power_w=400.0), 800, wind=(2.0, 0.0))
    assert flight.model.cruise_w == pytest.approx(400.0, rel=0.01)


@pytest.mark.parametrize("wind", [(8.0, 180.0), None])
def test_power_with_the_wind_behind_or_unknown_makes_no_cruise_cheaper(
    flight: Flight, wind: tuple[float, float] | None
) -> None:
    flight.fly(replace(NORTHWARDS, power_w=362.0), 400, wind)
    assert flight.model.cruise_w == 440.0
    flight.fly(replace(NORTHWARDS, power_w=460.0), 20, wind)
    assert flight.model.cruise_w >= 460.0


#: a quarter of its mass is payload
LOADED = replace(SETTINGS, mass_kg=4.0, payload_kg=1.0, airspeed_mps=10.0)


def test_without_its_payload_it_takes_less_from_the_moment_of_the_drop() -> None:
    flight = Flight(LOADED)
    flight.fly(HOVER, 100)
    flight.learner.carry(loaded=False)
    model = flight.model
    assert model.hover_w == pytest.approx(360.0 * 0.75, rel=1e-3)
    # what drag adds stays as it was
    assert model.cruise_w == pytest.approx(360.0 * 0.75 + 80.0, rel=1e-3)
    assert model.climb_w == pytest.approx(432.0 * 0.75, rel=1e-3)
    assert model.descent_w == pytest.approx(360.0 * 0.75, rel=1e-3)
    assert model.airspeed_mps == pytest.approx(10.0 * 0.8660, rel=1e-3)
    assert model.unloaded_part == 1.0


def test_what_was_learned_with_the_payload_counts_without_it_too() -> None:
    flight = Flight(LOADED)
    flight.fly(replace(HOVER, power_w=400.0), 600)
    flight.learner.carry(loaded=False)
    assert flight.model.hover_w == pytest.approx(400.0 * 0.75, rel=0.02)


def test_a_payload_that_is_still_there_is_seen() -> None:
    flight = Flight(LOADED)
    flight.fly(HOVER, 100)
    flight.learner.carry(loaded=False)
    flight.fly(HOVER, 5)
    assert flight.model.hover_w == 360.0


def test_on_the_ground_it_is_loaded_again() -> None:
    flight = Flight(LOADED)
    before = flight.model
    for _ in range(3):
        flight.learner.carry(loaded=False)
        flight.learner.carry(loaded=False)
        flight.learner.carry(loaded=True)
    assert flight.model.unloaded_part == before.unloaded_part == 0.75
    assert flight.model.hover_w == pytest.approx(before.hover_w)
    assert flight.model.airspeed_mps == pytest.approx(before.airspeed_mps)


def test_without_a_payload_nothing_is_dropped(flight: Flight) -> None:
    before = flight.model
    flight.learner.carry(loaded=False)
    assert flight.model == before


def test_what_is_not_steady_teaches_no_cruise(flight: Flight) -> None:
    for second in range(100):
        flight.fly(replace(NORTHWARDS, north_mps=5.0 + 4.0 * (second % 2), power_w=900.0), 1)
    assert flight.model.cruise_w == 440.0


# ---- wind ---------------------------------------------------------------------------------------------------------


def test_the_autopilots_wind_counts_after_a_few_samples(flight: Flight) -> None:
    flight.fly(HOVER, 4, wind=(6.0, 90.0))
    assert flight.source == ""
    flight.fly(HOVER, 1, wind=(6.0, 90.0))
    assert flight.source == "autopilot"
    wind = flight.model.wind
    assert wind is not None
    assert (wind.speed_mps, wind.from_deg) == pytest.approx((6.0, 90.0))


@pytest.mark.parametrize("direction", [-180.0, 180.0, 0.0, 77.0])
def test_wind_of_speed_zero_is_no_estimate(flight: Flight, direction: float) -> None:
    flight.fly(HOVER, 60, wind=(0.0, direction))
    assert flight.model.wind is None
    assert flight.model.headwind_mps == 2.0


@pytest.mark.parametrize("wild", [(nan, 90.0), (6.0, nan), (inf, 90.0), (-6.0, 90.0), (61.0, 90.0)])
def test_wind_that_is_none_is_dropped(flight: Flight, wild: tuple[float, float]) -> None:
    for _ in range(60):
        flight.now += 1.0
        flight.learner.wind_seen(*wild, flight.now)
    assert flight.model.wind is None


def test_the_autopilots_wind_is_taken_for_a_tenth_stronger(flight: Flight) -> None:
    for _ in range(10):
        flight.now += 1.0
        flight.learner.wind_seen(6.0, 30.0, flight.now)
    assert flight.model.wind == Wind(pytest.approx(6.54), pytest.approx(30.0))


def test_of_the_last_samples_the_strongest_wind_counts(flight: Flight) -> None:
    flight.fly(HOVER, 30, wind=(9.0, 0.0))
    # eight samples make the middle of fifteen; the strongest of before is still among the last
    flight.fly(HOVER, 8, wind=(3.0, 0.0))
    assert flight.model.wind == Wind(pytest.approx(9.0), pytest.approx(0.0, abs=1e-6))
    flight.fly(HOVER, 30, wind=(3.0, 0.0))
    assert flight.model.wind == Wind(pytest.approx(3.0), pytest.approx(0.0, abs=1e-6))


def test_a_wind_of_long_ago_blows_from_ahead_as_strong_as_it_was(flight: Flight) -> None:
    flight.fly(HOVER, 30, wind=(9.0, 0.0))
    assert flight.source == "autopilot"
    flight.fly(HOVER, 61)
    assert (flight.model.wind, flight.source) == (None, "")
    assert flight.model.headwind_mps == pytest.approx(9.0)
    flight.now += 880.0
    assert flight.model.headwind_mps == 2.0, "a quarter of an hour later it is forgotten"


@pytest.mark.parametrize(
    ("north", "east", "lean", "lean_to", "speed", "from_deg"),
    [
        # hovering in 5.66 m/s it leans 14.3 degrees into the wind (flown)
        (0.0, 0.0, 14.3, 45.0, 5.66, 45.0),
        # calm: 10 m/s northwards at 29.9 degrees
        (10.0, 0.0, 29.9, 0.0, 0.0, None),
        # with it: 10 m/s over ground at the lean of 5
        (10.0, 0.0, 12.2, 0.0, 5.0, 180.0),
        # against it, at the lean limit
        (4.0, 0.0, 29.9, 0.0, 6.0, 0.0),
    ],
)
def test_wind_by_the_lean_where_the_drag_is_known(
    north: float, east: float, lean: float, lean_to: float, speed: float, from_deg: float | None
) -> None:
    flight = Flight(replace(SETTINGS, **DRAG))
    flight.fly(Motion(north, east, 0.0, lean, lean_to, None), 20)
    wind = flight.model.wind
    assert wind is not None
    assert flight.source == "lean"
    assert wind.speed_mps == pytest.approx(speed, abs=0.05)
    if from_deg is not None:
        assert wind.from_deg == pytest.approx(from_deg, abs=0.5)


def test_without_the_drag_only_the_lean_limit_tells_the_wind(flight: Flight) -> None:
    flight.fly(replace(NORTHWARDS, lean_deg=20.0), 60)
    assert flight.model.wind is None
    # as fast as it gets, 10 m/s, and 4 over ground
    flight.fly(replace(NORTHWARDS, north_mps=4.0, lean_deg=29.0), 20)
    assert flight.source == "lean limit"
    assert flight.model.wind == Wind(pytest.approx(6.0), pytest.approx(0.0))


def test_the_autopilots_wind_goes_before_the_lean() -> None:
    flight = Flight(replace(SETTINGS, **DRAG))
    flight.fly(Motion(0.0, 0.0, 0.0, 14.3, 45.0, None), 20, wind=(3.0, 90.0))
    assert (flight.source, flight.model.wind) == ("autopilot", Wind(pytest.approx(3.0), pytest.approx(90.0)))


def test_speeding_up_is_no_wind() -> None:
    flight = Flight(replace(SETTINGS, **DRAG))
    for second in range(8):
        flight.fly(Motion(float(second), 0.0, 0.0, 25.0, 0.0, None), 1)
    assert flight.model.wind is None


def test_seconds_that_are_missing_are_no_change_of_speed(flight: Flight) -> None:
    for _ in range(60):
        flight.now += 30.0
        flight.fly(replace(NORTHWARDS, north_mps=4.0, lean_deg=29.0), 1)
    assert flight.model.wind is None


def test_the_airspeed_that_it_holds_is_learned_at_the_lean_limit(flight: Flight) -> None:
    # 2 over ground against 6: it holds 8, and no more than was seen recently counts
    flight.fly(replace(NORTHWARDS, north_mps=2.0, lean_deg=29.5), 20, wind=(6.0, 0.0))
    assert flight.model.airspeed_mps == pytest.approx(8.0)
    # 12 is learned slowly, and no more than 13
    flight.fly(replace(NORTHWARDS, north_mps=6.0, lean_deg=29.5), 600, wind=(6.0, 0.0))
    assert 11.0 < flight.model.airspeed_mps <= 12.0
    flight.fly(replace(NORTHWARDS, north_mps=14.0, lean_deg=29.5), 3000, wind=(6.0, 0.0))
    assert flight.model.airspeed_mps == 13.0


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "lean", "towards"),
    [
        (0.0, 0.0, 1.0, 0.0, None),
        # nose down: forward
        (0.0, -0.2, 0.0, degrees(0.2), 0.0),
        (0.0, -0.2, radians(90.0), degrees(0.2), 90.0),
        # right side down: to the right
        (0.2, 0.0, 0.0, degrees(0.2), 90.0),
        (0.2, 0.0, radians(-90.0), degrees(0.2), 0.0),
        (0.0, 0.2, radians(30.0), degrees(0.2), 210.0),
    ],
)
def test_where_the_thrust_pushes(roll: float, pitch: float, yaw: float, lean: float, towards: float | None) -> None:
    found, direction = thrust_direction(roll, pitch, yaw)
    assert found == pytest.approx(lean)
    if towards is not None:
        assert direction == pytest.approx(towards)


# ---- what holds for all flights -----------------------------------------------------------------------------------

numbers = st.one_of(st.floats(), st.floats(-20.0, 20.0))
motions = st.builds(
    Motion, numbers, numbers, numbers, st.floats(0.0, 90.0), st.floats(0.0, 360.0), st.one_of(st.none(), st.floats())
)


@pytest.mark.slow
@given(st.lists(st.tuples(motions, numbers, numbers), max_size=40))
def test_whatever_is_seen_nothing_raises_and_the_model_stays_one(
    seen: list[tuple[Motion, float, float]],
) -> None:
    flight = Flight(replace(SETTINGS, **DRAG))
    for motion, speed, direction in seen:
        flight.fly(motion, 1, wind=(speed, direction))
        model = flight.model
        assert model.need_wh([Piece(climb_m=20.0, hold_s=10.0), Piece(descent_m=20.0)]) > 0.0
        assert model.need_wh([Piece(length_m=100.0, bearing_deg=45.0)]) > 0.0
        assert model.hover_w >= 180.0
        assert model.cruise_w >= model.hover_w
        assert model.climb_w >= model.hover_w


@given(st.lists(st.floats(50.0, 5000.0), min_size=5, max_size=60))
def test_hovering_never_costs_less_than_it_just_did(watts: list[float]) -> None:
    flight = Flight()
    flight.fly(replace(HOVER, power_w=watts[0]), 1)
    for value in watts:
        flight.fly(replace(HOVER, power_w=value), 1)
    recent = sorted(watts[-15:])
    assert flight.model.hover_w >= recent[(len(recent) - 1) // 2]


def test_lean_of_the_drag_formula() -> None:
    # g tan(lean) = 0.2843 * 8 + 0.02798 * 64 = 4.065: by hand 22.5 degrees
    assert degrees(atan(4.065 / 9.80665)) == pytest.approx(22.5, abs=0.05)
    flight = Flight(replace(SETTINGS, **DRAG))
    flight.fly(Motion(0.0, 0.0, 0.0, 22.5, 0.0, None), 20)
    assert flight.model.wind == Wind(pytest.approx(8.0, abs=0.05), pytest.approx(0.0))

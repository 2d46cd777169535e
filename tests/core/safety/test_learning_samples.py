# SPDX-License-Identifier: GPL-3.0-or-later

"""Which samples of a flight count, for what, and how long they are remembered."""

from __future__ import annotations

from math import inf, nan

import pytest

from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.core.safety.energy_prior import ON_WINGS, EnergySettings
from mavproxy_handover.core.safety.learning import Learner, Motion, _Level, _Winds

SETTINGS = EnergySettings(
    battery_wh=41.0, hover_w=350.0, cruise_w=400.0, headwind_mps=3.0, mass_kg=4.0, payload_kg=1.0, lean_deg=30.0
)


def level(sign: int = 1) -> _Level:
    return _Level(100.0, 50.0, 130.0, sign)


def winds(*samples: tuple[float, float], begin: float = 0.0) -> _Winds:
    """Wind towards north and east, a sample each second."""
    made = _Winds()
    for number, (north, east) in enumerate(samples):
        made.add(north, east, begin + number)
    return made


def motion(
    *, north: float = 0.0, east: float = 0.0, up: float = 0.0, lean: float = 0.0, watts: float | None = 500.0
) -> Motion:
    return Motion(north, east, up, lean, 0.0, watts)


def learner(**settings: float) -> Learner:
    return Learner(EnergySettings(**{**{k: getattr(SETTINGS, k) for k in GIVEN}, **settings}))


GIVEN = ("battery_wh", "hover_w", "cruise_w", "headwind_mps", "mass_kg", "payload_kg", "lean_deg")


def counts(made: Learner) -> tuple[int, int, int, int]:
    """How many samples of hover, cruise, climb and descent there were."""
    return made._hover._count, made._cruise._count, made._climb._count, made._descent._count


def flown(*motions: Motion, step_s: float = 1.0, **settings: float) -> Learner:
    made = learner(**settings)
    for number, each in enumerate(motions):
        made.fly(each, 100.0 + number * step_s)
    return made


class TestLevel:
    def test_it_is_learned_after_thirty_samples(self) -> None:
        made = level()
        for _ in range(29):
            made.add(100.0)
        assert not made.learned
        made.add(100.0)
        assert made.learned

    def test_a_sample_moves_it_by_its_weight(self) -> None:
        made = level()
        made.add(131.0)
        assert made.value == pytest.approx(101.0)

    def test_it_remembers_a_hundred_and_twenty_samples(self) -> None:
        made = level()
        made._count = 500
        made.add(220.0)
        assert made.value == pytest.approx(101.0)

    @pytest.mark.parametrize(("sign", "value"), [(1, 120.0), (-1, 101.88)])
    def test_the_dearer_one_of_the_long_run_and_of_the_last_five(self, sign: int, value: float) -> None:
        made = level(sign)
        for _ in range(4):
            made.add(120.0)
        assert made.value < 103.0
        made._slow = 101.88
        made._recent.append(120.0)
        assert made.value == pytest.approx(value)

    def test_scaled_its_bounds_are_scaled_and_the_last_samples_say_nothing(self) -> None:
        made = level()
        for _ in range(5):
            made.add(120.0)
        made.scale(0.5)
        assert made.value < 52.0
        made._slow = 1.0
        assert made.value == 25.0
        made._slow = 1000.0
        assert made.value == 65.0


class TestWinds:
    WEST_WIND, NORTH_WIND = (0.0, 20.0), (-5.0, 0.0)

    def test_five_samples_make_a_wind_for_a_minute(self) -> None:
        assert winds(*[self.NORTH_WIND] * 4).wind(4.0) is None
        made = winds(*[self.NORTH_WIND] * 5)
        assert made.wind(64.0) == Wind(5.0, pytest.approx(0.0))
        assert made.wind(64.1) is None

    def test_after_a_minute_without_one_they_begin_anew(self) -> None:
        made = winds(*[self.WEST_WIND] * 5)
        made.add(*self.NORTH_WIND, 64.1)
        assert made.wind(64.1) is None
        for number in range(4):
            made.add(*self.NORTH_WIND, 65.0 + number)
        assert made.wind(68.0) == Wind(5.0, pytest.approx(0.0))

    def test_within_a_minute_they_go_on(self) -> None:
        made = winds(*[self.WEST_WIND] * 5)
        made.add(*self.NORTH_WIND, 64.0)
        assert made.wind(64.0) is not None

    @pytest.mark.parametrize("sample", [(nan, 1.0), (1.0, nan), (inf, 1.0), (60.5, 0.0), (0.0, -60.5)])
    def test_what_is_no_wind_does_not_count(self, sample: tuple[float, float]) -> None:
        made = winds(*[self.NORTH_WIND] * 4, sample)
        assert made.wind(5.0) is None

    def test_sixty_metres_a_second_are_a_wind(self) -> None:
        assert winds(*[(60.0, 0.0)] * 5).wind(4.0) == Wind(60.0, pytest.approx(180.0))

    def test_the_strongest_middle_of_five_samples_or_more(self) -> None:
        assert winds((-20.0, 0.0), (-20.0, 0.0), (-2.0, 0.0), (-2.0, 0.0), (-2.0, 0.0)).wind(4.0) == Wind(
            2.0, pytest.approx(0.0)
        )


class TestWindOfTheAutopilot:
    @pytest.mark.parametrize(
        ("speed", "from_deg", "counted"),
        [(0.5, 90.0, 1), (0.0, 90.0, 0), (5.0, inf, 0), (nan, 90.0, 0), (5.0, 90.0, 1)],
    )
    def test_what_is_no_wind_does_not_count(self, speed: float, from_deg: float, counted: int) -> None:
        made = learner()
        made.wind_seen(speed, from_deg, 100.0)
        assert len(made._winds["autopilot"]._north) == counted

    @pytest.mark.parametrize(("now", "headwind"), [(1004.0, 10.9), (1004.5, 3.0)])
    def test_the_last_wind_is_a_headwind_for_fifteen_minutes(self, now: float, headwind: float) -> None:
        made = learner()
        for number in range(5):
            made.wind_seen(10.0, 90.0, 100.0 + number)
        made.model(104.0)
        assert made.model(now)[0].headwind_mps == pytest.approx(headwind)


class TestSamples:
    @pytest.mark.parametrize(
        ("watts", "counted"),
        [(200_000.0, 1), (200_000.5, 0), (0.5, 1), (0.0, 0), (-1.0, 0), (inf, 0), (nan, 0), (None, 0)],
    )
    def test_a_power_that_none_can_draw_does_not_count(self, watts: float | None, counted: int) -> None:
        assert counts(flown(motion(), motion(watts=watts))) == (counted, 0, 0, 0)

    @pytest.mark.parametrize(
        ("sample", "counted"),
        [
            (motion(north=1.4), (1, 0, 0, 0)),
            (motion(north=1.5), (0, 1, 0, 0)),
            (motion(east=9.0), (0, 1, 0, 0)),
            (motion(up=0.6), (0, 0, 1, 0)),
            (motion(up=-0.6), (0, 0, 0, 1)),
            (motion(up=0.5), (1, 0, 0, 0)),
            (motion(north=9.0, up=0.5), (0, 1, 0, 0)),
            (motion(north=9.0, up=-0.5), (0, 1, 0, 0)),
        ],
    )
    def test_each_counts_for_what_is_flown(self, sample: Motion, counted: tuple[int, ...]) -> None:
        assert counts(flown(sample, sample)) == counted

    @pytest.mark.parametrize(("north", "cruises"), [(9.5, 1), (9.6, 0)])
    def test_cruising_is_steady(self, north: float, cruises: int) -> None:
        assert counts(flown(motion(north=9.0), motion(north=north)))[1] == cruises

    @pytest.mark.parametrize(("step_s", "counted"), [(1.0, 1), (2.0, 1), (2.5, 0)])
    def test_two_samples_are_no_more_than_two_seconds_apart(self, step_s: float, counted: int) -> None:
        assert counts(flown(motion(), motion(), step_s=step_s))[0] == counted

    @pytest.mark.parametrize(("north", "known"), [(120.0, True), (120.5, False), (nan, False)])
    def test_a_speed_that_none_can_fly_is_no_sample(self, north: float, known: bool) -> None:
        assert (flown(motion(north=north))._before is not None) is known

    def test_after_one_that_is_none_the_next_one_is_the_first(self) -> None:
        assert counts(flown(motion(), motion(up=nan), motion())) == (0, 0, 0, 0)

    def test_the_flight_has_a_say_as_soon_as_one_power_is_learned(self) -> None:
        assert not flown(*[motion()] * 30).learned
        assert flown(*[motion()] * 31).learned


class TestPayload:
    def test_without_it_powers_and_drag_are_those_of_the_lighter_aircraft_until_it_is_loaded_again(self) -> None:
        made = learner(drag_per_s=0.3, drag_per_m=0.06)
        made.carry(False)
        assert made._drag == (pytest.approx(0.4), pytest.approx(0.08))
        made.carry(True)
        assert made._drag == (pytest.approx(0.3), pytest.approx(0.06))

    def test_what_does_not_change_forgets_no_sample(self) -> None:
        made = flown(*[motion(watts=600.0)] * 6)
        made.carry(True)
        assert made.model(106.0)[0].hover_w == 600.0
        made.carry(False)
        assert made.model(106.0)[0].hover_w < 400.0


class TestLean:
    @pytest.mark.parametrize(
        ("linear", "square", "lean_deg", "airspeed"),
        [
            (0.0, 0.0, 20.0, None),
            (0.5, 0.0, 45.0, 19.6133),
            (0.0, 0.05, 45.0, 14.0048),
            (0.5, 0.05, 45.0, 9.8705),
            (0.5, 0.0, 0.0, 0.0),
            (0.5, 0.0, 0.5, 0.1712),
            (0.5, 0.0, -0.1, None),
            (0.5, 0.0, 79.9, 110.1),
            (0.5, 0.0, 80.0, None),
        ],
    )
    def test_the_airspeed_that_leans_it_so_far(
        self, linear: float, square: float, lean_deg: float, airspeed: float | None
    ) -> None:
        found = learner(drag_per_s=linear, drag_per_m=square)._airspeed_of(lean_deg)
        assert found == (None if airspeed is None else pytest.approx(airspeed, rel=1e-3, abs=1e-6))

    @pytest.mark.parametrize(("lean", "counted"), [(0.93 * 30.0, 1), (27.8, 0)])
    def test_at_its_limit_it_is_as_fast_as_it_gets(self, lean: float, counted: int) -> None:
        sample = motion(north=9.0, lean=lean)
        made = learner()
        for number in range(5):
            made.wind_seen(5.0, 0.0, 95.0 + number)
        for number in range(2):
            made.fly(sample, 100.0 + number)
        assert len(made._winds["lean limit"]._north) == counted
        assert made._airspeed._count == counted


class TestCruise:
    """What cruising takes: at the airspeed that it has in the wind, if that is near the one of cruise."""

    def in_wind(self, from_deg: float, sample: Motion) -> Learner:
        made = learner()
        north, east = (-5.0, 0.0) if from_deg == 0.0 else (0.0, -5.0)
        for number in range(5):
            made._winds["autopilot"].add(north, east, 95.0 + number)
        for number in range(2):
            made.fly(sample, 100.0 + number)
        return made

    @pytest.mark.parametrize(
        ("from_deg", "sample"), [(0.0, motion(north=3.0, watts=500.0)), (90.0, motion(east=3.0, watts=500.0))]
    )
    def test_it_counts_once_as_at_the_airspeed_of_cruise(self, from_deg: float, sample: Motion) -> None:
        made = self.in_wind(from_deg, sample)
        assert made._cruise._count == 1
        assert made._cruise._recent[-1] == pytest.approx(350.0 + 150.0 * 1.25**3)

    def test_slower_than_four_fifths_of_it_only_what_takes_more_counts(self) -> None:
        assert self.in_wind(0.0, motion(north=2.9, watts=300.0))._cruise._count == 0
        assert self.in_wind(0.0, motion(north=3.0, watts=300.0))._cruise._count == 1

    @pytest.mark.parametrize(("watts", "counted"), [(400.0, 0), (400.5, 1)])
    def test_without_a_wind_only_what_takes_more_counts(self, watts: float, counted: int) -> None:
        sample = motion(north=9.0, watts=watts)
        assert flown(sample, sample)._cruise._count == counted

    def test_on_wings_every_steady_sample_counts(self) -> None:
        made = Learner(SETTINGS, ON_WINGS)
        for number in range(2):
            made.fly(motion(north=1.5, watts=300.0), 100.0 + number)
        assert made._cruise._count == 1


def test_without_a_wind_and_a_configured_one_there_is_no_headwind() -> None:
    assert learner(headwind_mps=0.0).model(100.0)[0].headwind_mps == 0.0

# SPDX-License-Identifier: GPL-3.0-or-later

"""What a way costs an aircraft with wings: numbers by hand.

The model of the tables: hover 1800 W, cruise 360 W at an airspeed of 20 m/s and no faster, climb 2160 W, descent as
hover. So 3600 m in calm air take 180 s, 64,800 J or 18 Wh.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.safety.energy import EnergyModel, MadeGood, Piece, Wind, landing, way_home
from mavproxy_handover.core.safety.energy_prior import ON_ROTORS, ON_WINGS, EnergyPrior, EnergySettings
from mavproxy_handover.core.safety.learning import Learner, Motion

MODEL = EnergyModel(
    battery_wh=500.0,
    hover_w=1800.0,
    cruise_w=360.0,
    climb_w=2160.0,
    descent_w=1800.0,
    cruise_mps=20.0,
    airspeed_mps=20.0,
    headwind_mps=0.0,
    reserve_factor=1.1,
    reserve_wh=20.0,
    return_alt_m=50.0,
    wind=Wind(0.0, 0.0),
    holds_airspeed=True,
)
NORTH, EAST, SOUTH = 0.0, 90.0, 180.0
#: north-going pieces of 3600 m in so much wind from the north: time made good at 15, 8 and 12 m/s less
FROM_NORTH = [(0.0, 20.0, 18.0), (5.0, 15.0, 24.0), (8.0, 12.0, 30.0), (12.0, 8.0, 45.0)]


@pytest.mark.parametrize(("wind_mps", "ground_mps", "watt_hours"), FROM_NORTH)
def test_a_head_wind_costs_time_and_no_more_power(wind_mps: float, ground_mps: float, watt_hours: float) -> None:
    model = replace(MODEL, wind=Wind(wind_mps, NORTH))
    assert model.made_good(NORTH) == MadeGood(ground_mps, 360.0)
    assert model.piece_wh(Piece(length_m=3600.0)) == pytest.approx(watt_hours)


def test_a_tail_wind_is_not_counted_on() -> None:
    model = replace(MODEL, wind=Wind(8.0, NORTH))
    assert model.made_good(SOUTH) == MadeGood(20.0, 360.0)


def test_across_the_wind_it_flies_at_an_angle() -> None:
    made = replace(MODEL, wind=Wind(12.0, NORTH)).made_good(EAST)
    assert made.speed_mps == pytest.approx(16.0)
    assert made.power_w == pytest.approx(360.0)


@pytest.mark.parametrize(("wind_mps", "bearing"), [(20.0, NORTH), (20.0, EAST), (25.0, NORTH)])
def test_what_the_wind_does_not_let_it_fly_is_out_of_reach(wind_mps: float, bearing: float) -> None:
    model = replace(MODEL, wind=Wind(wind_mps, NORTH))
    assert model.made_good(bearing) == MadeGood(0.0, inf)
    assert model.piece_wh(Piece(length_m=100.0, bearing_deg=bearing)) == inf


def test_a_faster_airspeed_takes_power_by_its_cube_and_a_slower_one_no_less() -> None:
    model = replace(MODEL, airspeed_mps=40.0)
    assert model.made_good(NORTH, 40.0) == MadeGood(40.0, 2880.0)
    assert model.made_good(NORTH, 10.0) == MadeGood(10.0, 360.0)
    assert MODEL.made_good(NORTH, 40.0) == MadeGood(20.0, 360.0), "no faster than it can"


def test_climbing_on_the_way_costs_what_rotors_take_for_it_and_the_time_if_that_is_longer() -> None:
    # 50 m at 2.5 m/s are 20 s of 360 W more; 3600 m take longer than that, 200 m do not
    assert MODEL.piece_wh(Piece(length_m=3600.0, climb_m=50.0)) == pytest.approx(18.0 + 2.0)
    assert MODEL.piece_wh(Piece(length_m=200.0, climb_m=50.0)) == pytest.approx((360.0 * 20.0 + 7200.0) / 3600.0)


def test_straight_down_is_flown_by_rotors_behind_a_transition() -> None:
    # 20 m at 1.5 and 10 m at 0.5 m/s: 33.33 s of hovering, and 10 s of both
    assert MODEL.piece_wh(landing(30.0)) == pytest.approx((1800.0 * (100.0 / 3.0) + 21600.0) / 3600.0)


def test_waiting_is_circling_and_above_its_place_hovering() -> None:
    assert MODEL.piece_wh(Piece(hold_s=100.0)) == pytest.approx(10.0)
    assert MODEL.piece_wh(Piece(length_m=3600.0, hold_s=100.0)) == pytest.approx(28.0)
    up = Piece(climb_m=25.0)
    assert MODEL.piece_wh(up._replace(hold_s=10.0)) - MODEL.piece_wh(up) == pytest.approx(5.0)


def test_nothing_costs_nothing() -> None:
    assert MODEL.piece_wh(Piece()) == 0.0


def test_it_comes_home_climbing_on_its_way_and_circles_once_above_the_place() -> None:
    assert way_home(3600.0, SOUTH, 40.0, 30.0, 50.0, climbs_on_way=True) == (
        Piece(length_m=3600.0, bearing_deg=SOUTH, climb_m=10.0, hold_s=30.0),
        landing(50.0),
    )


DOWN = (Piece(length_m=1000.0, bearing_deg=EAST, speed_mps=20.0), Piece(length_m=1500.0, descent_m=60.0))


def test_without_rotors_it_comes_down_by_its_landing_sequence() -> None:
    """The fault: its return was counted with a landing of rotors, which it has not, and without the sequence."""
    way = way_home(3600.0, SOUTH, 40.0, 30.0, 50.0, speed_mps=20.0, climbs_on_way=True, down=DOWN)
    there = Piece(length_m=3600.0, bearing_deg=SOUTH, climb_m=10.0, hold_s=30.0, speed_mps=20.0)
    assert way == (there, *DOWN)
    # 180 s there and 30 s around it, 50 s and 75 s down, at 360 W; 4 s of climb take 360 W more
    assert MODEL.need_wh(way) == pytest.approx((335.0 * 360.0 + 4.0 * 360.0) / 3600.0)


@pytest.mark.parametrize(("alt", "climb_m", "hold_s"), [(100.0, 0.0, 55.0), (50.0, 0.0, 30.0), (20.0, 30.0, 30.0)])
def test_from_above_it_circles_down_to_the_height_of_its_place(alt: float, climb_m: float, hold_s: float) -> None:
    """Below that ArduPlane does not go on to the sequence (RTL_AUTOLAND 1): 50 m at 2 m/s."""
    there, *_down = way_home(3600.0, SOUTH, alt, 30.0, 50.0, climbs_on_way=True, down=DOWN)
    assert (there.climb_m, there.hold_s) == (climb_m, hold_s)


def test_without_its_payload_its_rotors_take_less_and_its_wings_as_much() -> None:
    light = replace(MODEL, unloaded_part=0.5).unloaded
    assert light.unloaded == light, "there is only one payload"
    assert (light.hover_w, light.climb_w, light.descent_w) == (900.0, 1080.0, 900.0)
    assert (light.cruise_w, light.airspeed_mps) == (360.0, 20.0)


# ---- what is configured -------------------------------------------------------------------------------------------


def test_the_wings_may_take_less_than_the_rotors() -> None:
    settings = EnergySettings(battery_wh=500.0, hover_w=1800.0, cruise_w=360.0)
    model = settings.model(prior=ON_WINGS)
    assert model is not None
    assert (model.hover_w, model.cruise_w, model.cruise_mps, model.holds_airspeed) == (1800.0, 360.0, 12.0, True)
    copter = settings.model()
    assert copter is not None
    assert (copter.cruise_w, copter.cruise_mps, copter.holds_airspeed) == (1800.0, 10.0, False)


def test_its_return_is_as_high_as_arduplanes_unless_that_is_said() -> None:
    settings = EnergySettings(battery_wh=500.0, hover_w=1800.0)
    heights = {on: settings.model(prior=on).return_alt_m for on in (ON_ROTORS, ON_WINGS)}  # type: ignore[union-attr]
    assert heights == {ON_ROTORS: 15.0, ON_WINGS: 100.0}
    said = replace(settings, return_alt_m=60.0).model(prior=ON_WINGS)
    assert said is not None
    assert said.return_alt_m == 60.0


@pytest.mark.parametrize(
    ("settings", "watts"),
    [
        (EnergySettings(battery_wh=500.0, hover_w=1800.0), (1800.0, 1800.0)),
        (EnergySettings(battery_wh=500.0, cruise_w=360.0), (360.0, 360.0)),
        (EnergySettings(battery_wh=500.0, mass_kg=10.0, cruise_w=360.0), (1650.0, 360.0)),
    ],
)
def test_a_power_that_nobody_says_is_as_large_as_the_other(
    settings: EnergySettings, watts: tuple[float, float]
) -> None:
    model = settings.model(prior=ON_WINGS)
    assert model is not None
    assert (model.hover_w, model.cruise_w) == watts


def test_what_is_missing_for_wings() -> None:
    assert EnergySettings().missing_for(ON_WINGS) == "no [energy] numbers"
    assert EnergySettings(cruise_w=360.0).missing_for(ON_WINGS) == "[energy] has no battery_wh"
    assert EnergySettings(battery_wh=500.0).missing_for(ON_WINGS) == "[energy] has neither cruise_w nor hover_w"
    assert EnergySettings(battery_wh=500.0, cruise_w=360.0).missing_for(ON_WINGS) == ""
    assert EnergySettings(battery_wh=500.0, cruise_w=360.0).missing == "[energy] has neither hover_w nor mass_kg"
    assert EnergySettings(battery_wh=500.0).model(prior=ON_WINGS) is None
    with pytest.raises(ValueError, match="neither cruise_w nor hover_w"):
        Learner(EnergySettings(battery_wh=500.0), ON_WINGS)


# ---- what is learned ----------------------------------------------------------------------------------------------


def flown(seconds: int, motion: Motion, prior: EnergyPrior = ON_WINGS) -> EnergyModel:
    """What is known behind so many seconds of this."""
    learner = Learner(EnergySettings(battery_wh=500.0, hover_w=1800.0, cruise_w=360.0), prior)
    for second in range(seconds):
        learner.fly(motion, float(second))
    return learner.model(float(seconds))[0]


def test_steady_flight_on_the_wings_teaches_what_cruising_takes_whatever_the_wind() -> None:
    model = flown(200, Motion(15.0, 0.0, 0.0, 2.0, 0.0, 480.0))
    assert model.cruise_w == pytest.approx(480.0, rel=0.05)
    assert model.hover_w == 1800.0


def test_no_less_than_half_of_what_was_configured_is_learned() -> None:
    assert flown(600, Motion(15.0, 0.0, 0.0, 2.0, 0.0, 60.0)).cruise_w >= 180.0


def test_climbing_on_the_wings_says_nothing_of_the_rotors() -> None:
    model = flown(200, Motion(15.0, 0.0, 2.0, 2.0, 0.0, 700.0))
    assert (model.climb_w, model.cruise_w, model.descent_w) == (2160.0, 360.0, 1800.0)


def test_hovering_teaches_what_hovering_takes() -> None:
    assert flown(200, Motion(0.5, 0.0, 0.0, 2.0, 0.0, 2200.0)).hover_w == pytest.approx(2200.0, rel=0.05)


def test_a_steep_bank_is_no_wind() -> None:
    model = flown(200, Motion(15.0, 0.0, 0.0, 45.0, 90.0, 400.0))
    assert model.wind is None


def test_a_piece_of_half_a_metre_is_flown_on_the_wings() -> None:
    assert MODEL.piece_wh(Piece(length_m=0.5, hold_s=36.0)) == pytest.approx(360.0 * 36.025 / 3600.0)


def test_half_a_metre_a_second_over_ground_is_slow_and_not_out_of_reach() -> None:
    model = replace(MODEL, wind=Wind(19.5, NORTH))
    assert model.piece_wh(Piece(length_m=36.0)) == pytest.approx(7.2)


def test_what_leads_nowhere_is_flown_by_rotors_with_both_transitions() -> None:
    climbs = Piece(climb_m=1.25)
    assert MODEL.piece_wh(climbs) == pytest.approx((360.0 * 0.5 + 1800.0 * 0.5 + 2160.0 * 10.0) / 3600.0)
    up_and_down = Piece(climb_m=25.0, descent_m=30.0)
    joules = 360.0 * 10.0 + 1800.0 * 30.0 + 2160.0 * 10.0 - 300.0 * 20.0
    assert replace(MODEL, descent_w=1500.0).piece_wh(up_and_down) == pytest.approx(joules / 3600.0)

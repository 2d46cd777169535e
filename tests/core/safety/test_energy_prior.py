# SPDX-License-Identifier: GPL-3.0-or-later

"""What is known before a flight: numbers that are given, made of others, or defaults; and which are missing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.safety.energy import EnergyModel, Wind
from mavproxy_handover.core.safety.energy_prior import (
    ON_ROTORS,
    ON_WINGS,
    EnergySettings,
    hover_power_w,
)

GIVEN = EnergySettings(battery_wh=41.0, hover_w=354.0)


def test_what_nobody_says_is_made_of_what_is_said() -> None:
    assert GIVEN.model() == EnergyModel(
        battery_wh=41.0,
        hover_w=354.0,
        cruise_w=pytest.approx(389.4),
        climb_w=pytest.approx(424.8),
        descent_w=354.0,
        cruise_mps=10.0,
        airspeed_mps=10.0,
        headwind_mps=3.0,
        reserve_factor=1.1,
        # a fifth of the battery, and a minute of hover
        reserve_wh=pytest.approx(8.2 + 5.9),
        return_alt_m=15.0,
        wind=None,
    )


def test_what_is_said_holds() -> None:
    said = EnergySettings(
        battery_wh=126.0,
        hover_w=354.0,
        cruise_w=385.0,
        climb_factor=1.1,
        descent_factor=0.95,
        cruise_mps=8.0,
        airspeed_mps=12.0,
        headwind_mps=5.0,
        reserve_factor=1.2,
        reserve_wh=7.0,
        return_alt_m=40.0,
    )
    assert said.model(Wind(4.0, 90.0)) == EnergyModel(
        126.0, 354.0, 385.0, pytest.approx(389.4), pytest.approx(336.3), 8.0, 12.0, 5.0, 1.2, 7.0, 40.0, Wind(4.0, 90.0)
    )


def test_cruise_never_takes_less_than_hover() -> None:
    model = replace(GIVEN, cruise_w=300.0).model()
    assert model is not None
    assert model.cruise_w == 354.0


def test_the_fastest_airspeed_is_that_of_cruise_where_nobody_says() -> None:
    model = replace(GIVEN, cruise_mps=7.0).model()
    assert model is not None
    assert model.airspeed_mps == 7.0


@pytest.mark.parametrize(
    ("mass", "payload", "part", "wrong"),
    [
        (4.0, 1.0, 0.75, ""),
        (4.0, 0.0, 1.0, ""),
        (4.0, None, 1.0, ""),
        (None, 1.0, 1.0, "1 says nothing without mass_kg, the mass at take-off with it"),
        (4.0, 4.0, 1.0, "4 must be less than mass_kg, 4"),
        (4.0, 5.0, 1.0, "5 must be less than mass_kg, 4"),
    ],
)
def test_the_payload_is_a_part_of_the_mass(mass: float | None, payload: float | None, part: float, wrong: str) -> None:
    settings = replace(GIVEN, mass_kg=mass, payload_kg=payload)
    model = settings.model()
    assert model is not None
    assert (model.unloaded_part, settings.payload_wrong) == (part, wrong)


@pytest.mark.parametrize(
    ("mass", "area", "watts"),
    [
        # 29.42 N ^ 1.5 = 159.57; sqrt(2 * 1.225 * 0.4) = 0.98995; half of what goes in comes out
        (3.0, 0.4, 322.4),
        (6.0, 0.4, 911.8),
        (3.0, 1.6, 161.2),
    ],
)
def test_power_in_hover_by_momentum_theory(mass: float, area: float, watts: float) -> None:
    assert hover_power_w(mass, area) == pytest.approx(watts, abs=0.1)


@pytest.mark.parametrize(
    ("settings", "watts"),
    [
        (EnergySettings(battery_wh=41.0, mass_kg=3.0), 495.0),
        (EnergySettings(battery_wh=41.0, mass_kg=3.0, rotor_area_m2=0.4), 322.4),
        (EnergySettings(battery_wh=41.0, mass_kg=3.0, rotor_area_m2=0.4, hover_w=354.0), 354.0),
    ],
)
def test_where_the_power_in_hover_comes_from(settings: EnergySettings, watts: float) -> None:
    model = settings.model()
    assert model is not None
    assert model.hover_w == pytest.approx(watts, abs=0.1)


@pytest.mark.parametrize(
    ("settings", "missing"),
    [
        (EnergySettings(), "no [energy] numbers"),
        (EnergySettings(cruise_w=385.0, rotor_area_m2=0.4, start="refuse"), "no [energy] numbers"),
        (EnergySettings(hover_w=354.0), "[energy] has no battery_wh"),
        (EnergySettings(mass_kg=3.0), "[energy] has no battery_wh"),
        (EnergySettings(battery_wh=41.0), "[energy] has neither hover_w nor mass_kg"),
        (GIVEN, ""),
    ],
)
def test_what_there_is_no_budget_without(settings: EnergySettings, missing: str) -> None:
    assert settings.missing == missing
    assert (settings.model() is None) == bool(missing)


@pytest.mark.parametrize(
    ("settings", "policy"),
    [
        (EnergySettings(), "off"),
        (EnergySettings(start="refuse"), "off"),
        (GIVEN, "refuse"),
        (replace(GIVEN, start="refuse"), "refuse"),
        (replace(GIVEN, start="warn"), "warn"),
        (replace(GIVEN, start="off"), "off"),
    ],
)
def test_start_is_refused_where_there_are_numbers_and_nothing_else_was_said(
    settings: EnergySettings, policy: str
) -> None:
    assert settings.start_policy_for(ON_ROTORS) == policy


def test_key_by_key_the_first_goes_before_the_second() -> None:
    mission = EnergySettings(battery_wh=41.0, cruise_w=400.0, start="warn")
    vehicle = EnergySettings(battery_wh=126.0, hover_w=354.0, start="off")
    assert mission.over(vehicle) == EnergySettings(battery_wh=41.0, hover_w=354.0, cruise_w=400.0, start="warn")
    assert EnergySettings().over(vehicle) == vehicle


def test_on_wings_hovering_alone_is_enough_and_on_rotors_cruising_alone_is_not() -> None:
    hovers, cruises = EnergySettings(battery_wh=41.0, hover_w=350.0), EnergySettings(battery_wh=41.0, cruise_w=400.0)
    assert hovers.missing_for(ON_WINGS) == cruises.missing_for(ON_WINGS) == ""
    assert cruises.missing_for(ON_ROTORS) == "[energy] has neither hover_w nor mass_kg"
    assert cruises.model() is None
    assert cruises.model(prior=ON_WINGS) is not None


def test_it_leans_thirty_degrees_where_nothing_is_said() -> None:
    assert EnergySettings().lean_limit_deg == 30.0
    assert EnergySettings(lean_deg=45.0).lean_limit_deg == 45.0

# SPDX-License-Identifier: GPL-3.0-or-later

"""What a way costs, and from where on there is none back: numbers by hand, and what must hold for all numbers.

The model of the tables: hover 360 W, cruise 440 W at 10 m/s, and no more airspeed than that. So 5 m/s of airspeed take
360 + 80 / 8 = 370 W, and a piece of 900 m flown at v takes 900 / v + v / 1.5 seconds.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.safety.energy import (
    EnergyFact,
    EnergyModel,
    Piece,
    Wind,
    landing,
    point_of_no_return,
    way_home,
)

MODEL = EnergyModel(
    battery_wh=100.0,
    hover_w=360.0,
    cruise_w=440.0,
    climb_w=432.0,
    descent_w=324.0,
    cruise_mps=10.0,
    airspeed_mps=10.0,
    headwind_mps=0.0,
    reserve_factor=1.1,
    reserve_wh=20.0,
    return_alt_m=15.0,
    wind=Wind(0.0, 0.0),
)
NORTH, EAST, SOUTH, WEST = 0.0, 90.0, 180.0, 270.0


@pytest.mark.parametrize(("airspeed", "watts"), [(0.0, 360.0), (5.0, 370.0), (10.0, 440.0), (15.0, 630.0)])
def test_power_grows_with_the_cube_of_the_airspeed(airspeed: float, watts: float) -> None:
    assert MODEL.power_w(airspeed) == pytest.approx(watts)


def test_no_airspeed_takes_less_than_hovering() -> None:
    assert replace(MODEL, cruise_w=300.0).power_w(10.0) == 360.0


@pytest.mark.parametrize(
    ("wind", "ahead", "across"),
    [
        (Wind(5.0, NORTH), 5.0, 0.0),
        (Wind(5.0, SOUTH), 0.0, 0.0),
        (Wind(5.0, EAST), 0.0, 5.0),
        (Wind(5.0, WEST), 0.0, 5.0),
        (Wind(10.0, 60.0), 5.0, 8.660254),
        (Wind(10.0, 120.0), 0.0, 8.660254),
    ],
)
def test_wind_blows_against_a_flight_to_the_north(wind: Wind, ahead: float, across: float) -> None:
    assert wind.against(NORTH) == pytest.approx((ahead, across), abs=1e-6)


@pytest.mark.parametrize(
    ("bearing", "ahead", "across"), [(EAST, 5.0, 0.0), (WEST, 0.0, 0.0), (NORTH, 0.0, 5.0), (30.0, 2.5, 4.330127)]
)
def test_wind_from_the_east_blows_against_a_flight_to_the_east(bearing: float, ahead: float, across: float) -> None:
    assert Wind(5.0, EAST).against(bearing) == pytest.approx((ahead, across), abs=1e-6)


@pytest.mark.parametrize(
    ("wind", "told", "speed", "watts"),
    [
        (Wind(0.0, 0.0), None, 10.0, 440.0),
        (Wind(0.0, 0.0), 5.0, 5.0, 370.0),
        # against it at the lean limit, with it as in calm, across it by the triangle of 6, 8 and 10
        (Wind(5.0, NORTH), None, 5.0, 440.0),
        (Wind(5.0, SOUTH), None, 10.0, 440.0),
        (Wind(6.0, EAST), None, 8.0, 440.0),
        # room to hold a slow speed against it: 3 over ground, 8 through the air, 80 * 0.512
        (Wind(5.0, NORTH), 3.0, 3.0, 400.96),
        (Wind(3.0, EAST), 4.0, 4.0, 370.0),
        (Wind(10.0, NORTH), None, 0.0, inf),
        (Wind(11.0, NORTH), None, 0.0, inf),
        (Wind(10.0, EAST), None, 0.0, inf),
        (Wind(9.0, 45.0), None, 1.3497, 440.0),
    ],
)
def test_the_speed_made_good(wind: Wind, told: float | None, speed: float, watts: float) -> None:
    made = replace(MODEL, wind=wind).made_good(NORTH, told)
    assert (made.speed_mps, made.power_w) == pytest.approx((speed, watts), abs=1e-4)


def test_a_wind_that_nobody_knows_blows_from_ahead_wherever_it_flies() -> None:
    model = replace(MODEL, wind=None, headwind_mps=4.0)
    assert {model.made_good(bearing).speed_mps for bearing in (NORTH, EAST, SOUTH, 211.0)} == {6.0}


@pytest.mark.parametrize(
    ("piece", "wind", "joules"),
    [
        # 90 s and 6.667 s of speeding up and braking, at 440 W
        (Piece(length_m=900.0), Wind(0.0, 0.0), 42_533.3),
        # 180 s and 3.333 s
        (Piece(length_m=900.0), Wind(5.0, NORTH), 80_666.7),
        (Piece(length_m=900.0), Wind(5.0, SOUTH), 42_533.3),
        # too short for 10 m/s: 2 sqrt(24 / 1.5) = 8 s
        (Piece(length_m=24.0), Wind(0.0, 0.0), 3_520.0),
        (Piece(hold_s=10.0), Wind(0.0, 0.0), 3_600.0),
        # held against the wind: 5 m/s of airspeed
        (Piece(hold_s=10.0), Wind(5.0, SOUTH), 3_700.0),
        # 20 s of climb at 432 W, and 2.5 s of speeding up and braking; of descent at 324 W, and 1.5 s
        (Piece(climb_m=50.0), Wind(0.0, 0.0), 9_720.0),
        (Piece(descent_m=30.0), Wind(0.0, 0.0), 6_966.0),
        # on a way that goes on, half of that
        (Piece(climb_m=50.0, stops=0.5), Wind(0.0, 0.0), 9_180.0),
        # of 40 m the last 10 slowly: 20 s, 20 s and 1.5 s
        (landing(40.0), Wind(0.0, 0.0), 13_446.0),
        # all of it slowly: 20 s and 0.5 s
        (landing(10.0), Wind(0.0, 0.0), 6_642.0),
        # too low for that speed: 2 sqrt(0.2 / 1.0) s
        (landing(0.2), Wind(0.0, 0.0), 289.8),
        (landing(-3.0), Wind(0.0, 0.0), 0.0),
        # the climb is on the way: 72 W more for 22.5 s
        (Piece(length_m=900.0, climb_m=50.0), Wind(0.0, 0.0), 44_153.3),
        # it takes longer than the way: 22.5 s at 440 W and 72 W
        (Piece(length_m=24.0, climb_m=50.0), Wind(0.0, 0.0), 11_520.0),
        (Piece(length_m=1.0), Wind(10.0, NORTH), inf),
        # straight down it comes in any wind
        (Piece(descent_m=30.0), Wind(20.0, NORTH), 8_686.0),
    ],
)
def test_the_need_of_a_piece(piece: Piece, wind: Wind, joules: float) -> None:
    assert replace(MODEL, wind=wind).piece_wh(piece) * 3600.0 == pytest.approx(joules, abs=0.1)


#: a quarter of the mass is payload, which the aircraft still has
LOADED = replace(MODEL, unloaded_part=0.75)


def test_without_its_payload_it_hovers_climbs_and_descends_on_what_is_left_of_the_mass() -> None:
    light = replace(MODEL, hover_w=270.0, cruise_w=350.0, climb_w=324.0, descent_w=243.0, airspeed_mps=8.660254)
    for field in ("hover_w", "cruise_w", "climb_w", "descent_w", "airspeed_mps", "unloaded_part"):
        assert getattr(LOADED.unloaded, field) == pytest.approx(getattr(light, field))
    assert replace(LOADED, cruise_w=300.0).unloaded.cruise_w == 270.0, "no airspeed takes less than hovering"


def test_without_a_payload_nothing_gets_lighter() -> None:
    assert MODEL.unloaded is MODEL
    assert LOADED.unloaded.unloaded is not LOADED
    assert LOADED.unloaded.unloaded == LOADED.unloaded


def test_a_piece_is_flown_without_the_payload_where_that_is_dropped_before_it() -> None:
    heavy, light = Piece(hold_s=100.0), Piece(hold_s=100.0, unloaded=True)
    assert LOADED.piece_wh(heavy) == pytest.approx(10.0)
    assert LOADED.piece_wh(light) == pytest.approx(7.5)
    assert LOADED.need_wh([heavy, light, light]) == pytest.approx(25.0)
    assert MODEL.need_wh([light]) == pytest.approx(10.0), "there is none"


def test_the_way_home_climbs_flies_waits_and_lands() -> None:
    assert way_home(900.0, 77.0, 5.0, 0.0, 15.0) == (
        Piece(climb_m=10.0),
        Piece(length_m=900.0, bearing_deg=77.0, hold_s=5.0),
        Piece(descent_m=15.0, landing_m=10.0),
    )


def test_the_way_home_is_flown_at_the_speed_that_the_autopilot_returns_with() -> None:
    """The fault: it was counted at cruise_mps of [energy], 10 m/s, whatever the mission had the autopilot fly at."""
    up, there, down = way_home(900.0, 77.0, 5.0, 0.0, 15.0, speed_mps=1.5)
    assert (up.speed_mps, there.speed_mps, down.speed_mps) == (None, 1.5, None)


@pytest.mark.parametrize(("alt", "place_alt", "height"), [(5.0, 60.0, 60.0), (80.0, 60.0, 80.0), (5.0, -5.0, 15.0)])
def test_the_place_and_the_aircraft_may_be_higher_than_the_return(alt: float, place_alt: float, height: float) -> None:
    way = way_home(100.0, 0.0, alt, place_alt, 15.0)
    assert (sum(piece.climb_m for piece in way), way[-1].descent_m) == (height - alt, height)


def test_the_margin_keeps_factor_and_reserve() -> None:
    way = [Piece(hold_s=100.0)]  # 10 Wh
    assert MODEL.need_wh(way) == pytest.approx(10.0)
    assert MODEL.margin_wh(50.0, way) == pytest.approx(19.0)
    assert MODEL.margin_wh(31.0, way) == pytest.approx(0.0)
    assert MODEL.margin_wh(50.0, [Piece(length_m=1.0), Piece(hold_s=1.0)]) < 30.0
    assert replace(MODEL, wind=Wind(12.0, 0.0)).margin_wh(50.0, [Piece(length_m=1.0)]) == -inf


@pytest.mark.parametrize(
    ("margins", "place"),
    [
        # the margin at 0, 100, 200 and 300 m; even in between
        ((30.0, 20.0, 10.0, 0.0), None),
        ((30.0, 10.0, -10.0, -30.0), 150.0),
        ((-1.0, 10.0, 10.0, 10.0), 0.0),
        # it comes back into reach: the first loss counts
        ((10.0, -10.0, 10.0, 10.0), 50.0),
        ((10.0, 10.0, 10.0, -inf), 200.0),
    ],
)
def test_the_point_of_no_return(margins: tuple[float, ...], place: float | None) -> None:
    def margin(at: float) -> float:
        number = min(int(at // 100), 2)
        part = at / 100 - number
        if part == 0.0:
            return margins[number]
        return margins[number] * (1 - part) + margins[number + 1] * part

    found = point_of_no_return(margin, (0.0, 100.0, 200.0, 300.0))
    assert found == (None if place is None else pytest.approx(place, abs=0.5))


def test_point_of_no_return_by_energy_is_where_out_and_home_cost_the_same() -> None:
    # E / (e_out + e_home), by hand: calm out and back 44 J/m each, 88 kJ: 1,000 m; without landing, reserve and factor
    def margin(at: float) -> float:
        return 88_000.0 - 44.0 * at - 44.0 * at

    assert point_of_no_return(margin, (0.0, 700.0, 1400.0)) == pytest.approx(1000.0, abs=0.5)


FACT = EnergyFact(5.0, left_wh=31.0, model=MODEL)


@pytest.mark.parametrize(
    ("fact", "need", "words"),
    [
        (FACT, 10.0, ""),
        (FACT, 10.1, "31.1 Wh are needed with the reserve, 31.0 Wh are left"),
        (FACT, inf, "the wind does not let it be flown"),
        (replace(FACT, left_wh=None), 10.0, "31.0 Wh are needed with the reserve, and what is left is not known"),
        (replace(FACT, left_wh=0.0), 0.0, "20.0 Wh are needed with the reserve, 0.0 Wh are left"),
        (EnergyFact(5.0, left_wh=31.0), 1000.0, ""),
        (EnergyFact(5.0), inf, ""),
    ],
)
def test_a_shortfall_is_said_in_words(fact: EnergyFact, need: float, words: str) -> None:
    assert fact.shortfall(need) == words


def test_half_a_metre_a_second_is_slow_and_can_be_flown() -> None:
    made = replace(MODEL, wind=Wind(9.5, NORTH)).made_good(NORTH)
    assert (made.speed_mps, made.power_w) == (pytest.approx(0.5), pytest.approx(440.0))
    assert isfinite(replace(MODEL, wind=Wind(9.5, NORTH)).piece_wh(Piece(length_m=10.0)))


def test_a_piece_that_is_long_enough_for_its_speed_is_flown_at_it() -> None:
    """10 m/s need 100 / 1.5 = 67 m: 100 m take 10 s and 10 / 1.5 s."""
    assert MODEL.piece_wh(Piece(length_m=100.0)) * 3600.0 == pytest.approx(440.0 * (10.0 + 10.0 / 1.5))


def test_the_point_of_no_return_is_found_to_half_a_metre() -> None:
    assert point_of_no_return(lambda place: 10.2 - place, (0.0, 64.0)) == 10.5
    assert point_of_no_return(lambda place: 32.0 - place, (0.0, 64.0)) == 32.5


@pytest.mark.parametrize(
    ("fact", "words"),
    [
        (EnergyFact(0.0, missing="battery_wh is not configured"), "unknown: battery_wh is not configured"),
        (
            EnergyFact(0.0, model=replace(MODEL, wind=None, headwind_mps=3.0)),
            "what is left is not known, wind not known, 3.0 m/s from ahead, as configured",
        ),
        (
            EnergyFact(0.0, 61.26, 401.7, replace(MODEL, wind=Wind(4.24, 272.0)), "mission", True, ("odd", "very")),
            "61.3 Wh of 100.0 Wh left, 402 W, wind 4.2 m/s from 272 (mission), learned, odd, very",
        ),
        (
            EnergyFact(0.0, 0.0, 0.0, MODEL, "WIND"),
            "0.0 Wh of 100.0 Wh left, 0 W, wind 0.0 m/s from 0 (WIND), as configured",
        ),
    ],
)
def test_what_is_known_in_words(fact: EnergyFact, words: str) -> None:
    assert fact.words() == words


def test_without_numbers_no_margin_is_known() -> None:
    way = [Piece(hold_s=100.0)]
    assert FACT.margin_wh(way) == pytest.approx(0.0)
    assert EnergyFact(5.0, left_wh=31.0).margin_wh(way) is None
    assert replace(FACT, left_wh=None).margin_wh(way) is None


# ---- what holds for all numbers -----------------------------------------------------------------------------------

metres = st.floats(0.0, 20_000.0)
angles = st.floats(0.0, 360.0)
winds = st.floats(0.0, 30.0)
speeds = st.one_of(st.none(), st.floats(0.5, 30.0))
pieces = st.builds(
    Piece,
    metres,
    angles,
    metres,
    metres,
    st.just(0.0),
    st.floats(0.0, 600.0),
    speeds,
    stops=st.floats(0.0, 1.0),
)
models = st.builds(
    lambda hover, cruise, climb, descent, reference, most, ahead: replace(
        MODEL,
        hover_w=hover,
        cruise_w=hover * cruise,
        climb_w=hover * climb,
        descent_w=hover * descent,
        cruise_mps=reference,
        airspeed_mps=most,
        headwind_mps=ahead,
    ),
    st.floats(20.0, 5000.0),
    st.floats(0.8, 2.0),
    st.floats(1.0, 3.0),
    st.floats(0.5, 2.0),
    st.floats(1.0, 30.0),
    st.floats(1.0, 30.0),
    st.floats(0.0, 20.0),
)


def no_less(more: float, less: float) -> bool:
    """Up to rounding."""
    return more >= less * (1.0 - 1e-9) - 1e-12


@given(models, pieces, winds, angles)
def test_no_need_is_negative_or_no_number(model: EnergyModel, piece: Piece, wind: float, direction: float) -> None:
    need = replace(model, wind=Wind(wind, direction)).piece_wh(piece)
    assert need >= 0.0
    assert isfinite(need) or piece.length_m > 0.0


@given(models, pieces, winds, angles, metres)
def test_farther_is_never_cheaper(
    model: EnergyModel, piece: Piece, wind: float, direction: float, more_m: float
) -> None:
    model = replace(model, wind=Wind(wind, direction))
    farther = piece._replace(length_m=piece.length_m + more_m)
    assert no_less(model.piece_wh(farther), model.piece_wh(piece))


@given(models, pieces, winds, winds, angles)
def test_more_wind_is_never_cheaper(
    model: EnergyModel, piece: Piece, one: float, other: float, direction: float
) -> None:
    weak, strong = sorted((one, other))
    known = [replace(model, wind=Wind(speed, direction)).piece_wh(piece) for speed in (weak, strong)]
    assert no_less(known[1], known[0])
    guessed = [replace(model, wind=None, headwind_mps=speed).piece_wh(piece) for speed in (weak, strong)]
    assert no_less(guessed[1], guessed[0])


@given(models, pieces, winds, angles)
def test_no_wind_is_cheaper_than_calm(model: EnergyModel, piece: Piece, wind: float, direction: float) -> None:
    """Not even the one from behind."""
    calm = replace(model, wind=Wind(0.0, 0.0)).piece_wh(piece)
    assert no_less(replace(model, wind=Wind(wind, direction)).piece_wh(piece), calm)


@given(models, st.lists(pieces, max_size=5), st.floats(0.0, 500.0))
def test_a_margin_is_never_more_than_what_is_left(model: EnergyModel, way: list[Piece], left: float) -> None:
    assert model.margin_wh(left, way) <= left


def test_a_climb_that_is_too_short_for_its_speed_costs_its_climb() -> None:
    """2 sqrt(1.25 / 1.0) = 2.236 s at 432 W."""
    assert MODEL.piece_wh(Piece(climb_m=1.25)) == pytest.approx(432.0 * 2.236 / 3600.0, rel=1e-3)


def test_at_the_height_of_the_return_nothing_is_climbed() -> None:
    assert len(way_home(500.0, NORTH, 50.0, 20.0, 50.0)) == 2
    assert len(way_home(500.0, NORTH, 49.0, 20.0, 50.0)) == 3

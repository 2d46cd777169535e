# SPDX-License-Identifier: GPL-3.0-or-later

"""What flying takes in a campaign, by figures worked out on paper, and never more than the rules reckon with."""

from __future__ import annotations

import ast
from dataclasses import replace
from math import inf
from pathlib import Path

import pytest

from mavproxy_handover.core.safety.energy import way_home
from sitl.campaign import physics
from sitl.campaign.physics import Physics
from sitl.campaign.plan import draw
from sitl.campaign.plane import Spot, bearing_deg

#: 100 W at rest, 150 W at 10 m/s, no wind, RTL at 30 m
CALM = Physics(100.0, 150.0, 160.0, 90.0, 10.0, 15.0, 0.0, 0.0, 30.0, 1.1, 5.0, None)
HOME = Spot(0.0, 0.0)
NORTH = (0.0, 3600.0, 30.0)


def test_it_uses_no_line_of_the_rules() -> None:
    tree = ast.parse(Path(physics.__file__).read_text(encoding="utf-8"))
    modules = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not [module for module in modules if module and module.startswith("mavproxy_handover")]


def test_drag_grows_with_the_cube() -> None:
    assert [CALM.power_w(v) for v in (0.0, 5.0, 10.0, 20.0)] == [100.0, 106.25, 150.0, 500.0]


def test_straight_down() -> None:
    assert CALM.down_wh(25.0) == pytest.approx(90.0 * (15.0 / 1.5 + 10.0 / 0.5) / 3600.0)
    assert CALM.down_wh(5.0) == pytest.approx(90.0 * 10.0 / 3600.0)


def test_the_way_home_in_calm_air() -> None:
    level, wait = 150.0 * 360.0, 100.0 * 5.0
    assert CALM.home_wh(NORTH, HOME) == pytest.approx((level + wait) / 3600.0 + CALM.down_wh(30.0))
    low = (0.0, 3600.0, 10.0)
    assert CALM.home_wh(low, HOME) - CALM.home_wh(NORTH, HOME) == pytest.approx(160.0 * 20.0 / 2.5 / 3600.0)
    assert CALM.budget_wh(10.0) == 16.0


def test_against_the_wind_with_it_and_across() -> None:
    def level_wh(blown: Physics) -> float:
        return blown.home_wh(NORTH, HOME) - blown.still_w * 5.0 / 3600.0 - blown.down_wh(30.0)

    south = replace(CALM, wind_mps=8.0, from_deg=180.0)  # home is south
    assert level_wh(south) == pytest.approx(CALM.power_w(15.0) * 3600.0 / 7.0 / 3600.0)
    north = replace(CALM, wind_mps=8.0, from_deg=0.0)
    assert level_wh(north) == pytest.approx(CALM.power_w(2.0) * 360.0 / 3600.0)
    west = replace(CALM, wind_mps=9.0, from_deg=270.0)
    assert level_wh(west) == pytest.approx(CALM.power_w((100.0 + 81.0) ** 0.5) * 360.0 / 3600.0)
    assert replace(CALM, wind_mps=15.0, from_deg=180.0).home_wh(NORTH, HOME) == inf
    untold = replace(north, headwind_mps=5.0)
    assert level_wh(untold) == pytest.approx(CALM.power_w(15.0) * 360.0 / 3600.0)


@pytest.mark.parametrize("seed", range(60))
def test_the_rules_reckon_with_no_less(seed: int) -> None:
    """So whoever is out of reach by these figures is out of reach for the rules, and nothing is asked of them that they
    could not know."""
    plan = draw(seed)
    true, believed = Physics.of(plan), plan.model()
    for spot in plan.way:
        here = (spot.x_m, spot.y_m, spot.alt_m)
        for place in plan.places:
            away, bearing = place.away_m(spot.x_m, spot.y_m), bearing_deg(place.x_m - spot.x_m, place.y_m - spot.y_m)
            way = way_home(away, bearing, spot.alt_m, place.alt_m, believed.return_alt_m)
            assert true.budget_wh(true.home_wh(here, place)) <= believed.budget_wh(believed.need_wh(way)) + 1e-9

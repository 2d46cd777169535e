# SPDX-License-Identifier: GPL-3.0-or-later

"""Energy predicted against energy used, on ArduCopter in calm and in wind. Needs an ArduCopter SITL program.

The numbers are those of the missions that ship, from flights on ArduCopter that were made before, in other winds, over
other lengths and in other directions. Two predictions are held against each flight: of all of it, by what is configured
and the true wind, and of the return, at the turn, by what the autopilot has said by then.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission import load
from sitl.vehicles import find_arducopter
from tests.sitl.energy_flight import fly

DELIVERY = Path(__file__).parents[2] / "missions" / "delivery"

pytestmark = [
    pytest.mark.sitl,
    pytest.mark.skipif(
        find_arducopter() is None,
        reason="no ArduCopter SITL program: set $ARDUCOPTER or build one in ~/ardupilot (waf copter)",
    ),
]

#: metres east and north of home: 358 m in the direction of 296.6 degrees
OUT = (-320.0, 160.0)
AHEAD, BEHIND, ACROSS = 296.6, 116.6, 26.6
WITHIN = 0.10


def loaded(settings: EnergySettings) -> EnergySettings:
    """The same aircraft with a kilogram more: 4 kg for 3, and what SITL's motors draw goes with what they push."""
    assert settings.hover_w is not None
    assert settings.cruise_w is not None
    hover_w = settings.hover_w * 4.0 / 3.0
    cruise_w = hover_w + settings.cruise_w - settings.hover_w
    airspeed_mps = 10.0 * (4.0 / 3.0) ** 0.5
    return replace(settings, mass_kg=4.0, payload_kg=1.0, hover_w=hover_w, cruise_w=cruise_w, airspeed_mps=airspeed_mps)


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("speed", "direction", "payload"),
    [
        pytest.param(0.0, 0.0, False, id="calm", marks=pytest.mark.long),
        pytest.param(5.0, AHEAD, False, id="5 ahead", marks=pytest.mark.long),
        pytest.param(5.0, BEHIND, False, id="5 behind", marks=pytest.mark.long),
        pytest.param(5.0, ACROSS, False, id="5 across"),
        pytest.param(8.0, AHEAD, False, id="8 ahead", marks=pytest.mark.long),
        pytest.param(8.0, BEHIND, False, id="8 behind", marks=pytest.mark.long),
        pytest.param(8.0, ACROSS, False, id="8 across", marks=pytest.mark.long),
        pytest.param(0.0, 0.0, True, id="payload dropped, calm", marks=pytest.mark.long),
        pytest.param(5.0, AHEAD, True, id="payload dropped, 5 ahead", marks=pytest.mark.long),
    ],
)
def test_what_was_predicted_is_used(tmp_path: Path, speed: float, direction: float, payload: bool) -> None:
    settings = load(DELIVERY).energy
    flown = fly(tmp_path, loaded(settings) if payload else settings, OUT, Wind(speed, direction))
    print(
        f"\nwind {speed:g} m/s from {direction:g}: used {flown.used_wh:.2f} Wh, planned {flown.planned_wh:.2f} Wh "
        f"({flown.planned_wh / flown.used_wh - 1.0:+.1%}); back {flown.used_back_wh:.2f} Wh, predicted "
        f"{flown.predicted_back_wh:.2f} Wh ({flown.predicted_back_wh / flown.used_back_wh - 1.0:+.1%})"
    )
    assert flown.planned_wh == pytest.approx(flown.used_wh, rel=WITHIN)
    assert flown.predicted_back_wh == pytest.approx(flown.used_back_wh, rel=WITHIN)
    assert flown.fact.wind_source == "autopilot"
    assert flown.fact.trouble == ()


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "return_mps", [pytest.param(2.0, id="2 m/s"), pytest.param(5.0, id="5 m/s", marks=pytest.mark.long)]
)
def test_a_return_is_counted_at_the_speed_at_which_it_is_flown(tmp_path: Path, return_mps: float) -> None:
    """The fault: a return that the autopilot flew at 1 m/s was counted with the mission's 10 m/s."""
    flown = fly(tmp_path, load(DELIVERY).energy, OUT, Wind(0.0, 0.0), return_mps=return_mps)
    print(f"\nat {return_mps:g} m/s: used {flown.used_back_wh:.2f} Wh, predicted {flown.predicted_back_wh:.2f} Wh")
    assert flown.predicted_back_wh == pytest.approx(flown.used_back_wh, rel=WITHIN)

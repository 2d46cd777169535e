# SPDX-License-Identifier: GPL-3.0-or-later

"""Forty files of the corpus, flown on ArduCopter and ArduPlane, against their walk: path, length, time, energy.

`pytest tests/sitl/test_corpus_flown.py -s --long` prints a line for each flight. It has the distance of the flown path
from the walk, level and in height. Length, time and energy follow, as flown, as walked, and the difference. Of wings
the distance is that outside of parts of the way that the walk does not know (`Path.loose`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from sitl.vehicles import find_arducopter, find_arduplane
from tests.mission.corpus import OK, Case, cases
from tests.sitl.corpus_flight import fly, judged

#: of the corpus: every item that changes the path
FLOWN: Final = (
    # ---- copter ----
    "waypoint-copter",
    "waypoint-waits-copter",
    "spline-copter",
    "splines-copter-plan",
    "loiter-turns-copter",
    "loiter-turns-left-copter",
    "loiter-turns-half-copter",
    "loiter-turns-wide-copter",
    "loiter-time-copter",
    "loiter-to-altitude-copter",
    "payload-place-copter",
    "delay-copter",
    "condition-delay-copter",
    "condition-distance-copter",
    "condition-yaw-copter",
    "return-copter",
    "takeoff-copter",
    "speed-ground-copter",
    "speed-climb-copter",
    "land-start-copter",
    "survey-copter-plan",
    "corridor-copter-plan",
    "structure-copter-plan",
    "jump-back-twice-copter-waypoints",
    "jumps-nested-copter-plan",
    "jump-to-tag-copter-plan",
    "two-landings-copter-waypoints",
    "height-0-copter-plan",
    "frame-0-copter-plan",
    # ---- wings ----
    "waypoint-plane",
    "waypoint-near-plane",
    "waypoint-past-plane",
    "loiter-turns-plane",
    "loiter-turns-left-plane",
    "loiter-time-plane",
    "loiter-to-altitude-plane",
    "change-altitude-plane",
    "landing-pattern-plane-plan",
    "turn-by-turn-plane-plan",
    "jump-back-twice-plane-plan",
    "waypoint-quadplane",
    "loiter-turns-half-quadplane",
    "vtol-land-spiral-quadplane",
    "transition-hover-quadplane",
    "speed-air-quadplane",
)
#: how far flown and walked may be apart: metres (copter, wings), and parts of length and time
PATH_M, WINGS_M, LENGTH, TIME = 5.0, 12.0, 0.02, 0.12
#: and of energy: by how much the walk may have too little, and too much. A change between wings and rotors has too much
ENERGY: Final = {"copter": (0.10, 0.10), "plane": (0.10, 0.10), "quadplane": (0.10, 0.20)}
#: what the flights have shown to be apart, with the reason; a flight that is within all limits is told, too
APART: Final = {
    "jump-to-tag-copter-plan": "with DO_JUMP_TAG ArduCopter 4.7-dev flies towards the item after the jump first",
    "two-landings-copter-waypoints": "ArduCopter disarms at the first landing, of which the check warns",
    "change-altitude-plane": "how fast it climbs decides where it turns: SITL's plane climbs faster than 2 m/s",
    "speed-air-quadplane": "slower than cruise the power of cruise is counted: 60 % too much at 14 m/s",
    "transition-hover-quadplane": "it flies 300 m more where it slows down to hover, and takes to its wings to land",
}
_BY_NAME: Final = {case.name: case for case in cases()}

pytestmark = [pytest.mark.sitl, pytest.mark.long]


def test_what_is_flown_is_in_the_corpus() -> None:
    assert len(FLOWN) >= 40
    assert [name for name in FLOWN if _BY_NAME[name].verdict != OK] == []


@pytest.mark.timeout(900)
@pytest.mark.parametrize("case", [_BY_NAME[name] for name in FLOWN], ids=lambda case: case.name)
def test_the_flight_is_the_walk(case: Case, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if (find_arducopter() if case.kind == "copter" else find_arduplane()) is None:
        firmware = "ArduCopter" if case.kind == "copter" else "ArduPlane"
        pytest.skip(f"no {firmware} SITL program: set ${firmware.upper()} or build one in ~/ardupilot")
    why = APART.get(case.name, "")
    if why:
        request.applymarker(pytest.mark.xfail(reason=why, raises=AssertionError, strict=False))
    outcome = judged(case.name, *fly(case, tmp_path))
    print(f"\n{outcome.row()}")
    assert outcome.beside_m < (PATH_M if case.kind == "copter" else WINGS_M)
    for (flown, walked), part in ((outcome.length_m, LENGTH), (outcome.time_s, TIME)):
        assert walked == pytest.approx(flown, rel=part)
    flown_wh, walked_wh = outcome.energy_wh
    less, more = ENERGY[case.kind]
    assert flown_wh * (1.0 - less) <= walked_wh <= flown_wh * (1.0 + more)

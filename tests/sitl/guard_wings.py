# SPDX-License-Identifier: GPL-3.0-or-later

"""An ArduPlane that flies with the guard, for tests: a plane that takes off from a runway, and a QuadPlane.

The airframes are those of ArduPilot's simulation, with what its own tests tune them with. Needs an ArduPlane SITL
program (`waf plane`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

from tests.sitl.firmware import Firmware
from tests.sitl.flown import recorded
from tests.sitl.guard_cases import SOFT_M_S, Outcome, chosen, said
from tests.sitl.guard_flight import (
    ACCEPTED,
    FAILED,
    FORCE,
    HURRY,
    LIVE,
    PLANE_PARAMETERS,
    SPEEDUP,
    Flight,
    launched,
    position,
)
from tests.sitl.guard_suite import EVERY_TIME

MANUAL, CIRCLE, STABILIZE, FBWA, FBWB, CRUISE = 0, 1, 2, 5, 6, 7
AUTO, RTL, LOITER, TAKEOFF, GUIDED = 10, 11, 12, 13, 15
QSTABILIZE, QHOVER, QLOITER, QLAND, QRTL, LOITER_ALT_QLAND, AUTOLAND = 17, 18, 19, 20, 21, 25, 26

REPOSITION, LANDING_SEQUENCE, SET_CURRENT = 192, 189, 224
VTOL_TAKE_OFF, VTOL_LANDING = 84, 85
#: reasons of a mode: a station's command, and those that only aircraft with wings have
COMMAND = 2
ARRIVED_VTOL, ARRIVED, QRTL_AT_ONCE, RESUMED = 39, 40, 44, 48
#: a landing counts as one at a place within this (m): a plane rolls out
NEAR_M = 40.0
Step = Callable[["WingedFlight"], object]

#: what both need here
_BOTH: Mapping[str, float] = {
    "ARMING_RUDDER": 0,
    "THR_FAILSAFE": 0,
    "FLTMODE_CH": 5,
    "FLTMODE1": LOITER,
    "FLTMODE2": FBWA,
    "FLTMODE6": FBWA,
    "ARSPD_USE": 1,
    "PTCH2SRV_RLL": 1,
    "KFF_RDDRMIX": 0.5,
    "NAVL1_PERIOD": 15,
    "RC3_MIN": 1000,
    "RC3_MAX": 2000,
    "RC3_TRIM": 1000,
    "SERVO3_MIN": 1000,
    "SERVO3_MAX": 2000,
    "THR_MAX": 100,
    "INS_GYR_CAL": 0,
    "RTL_ALTITUDE": 60,
    "ALT_HOLD_RTL": 6000,
    "TKOFF_ALT": 50,
    "LAND_DISARMDELAY": 5,
}
#: model of the simulation -> what ArduPilot's own tests tune it with, by the names of 4.7 and of before
AIRFRAMES: Mapping[str, Mapping[str, float]] = {
    "plane": {
        **_BOTH,
        "AIRSPEED_CRUISE": 22,
        "TRIM_ARSPD_CM": 2200,
        "AIRSPEED_MIN": 10,
        "AIRSPEED_MAX": 30,
        "ARSPD_FBW_MIN": 10,
        "ARSPD_FBW_MAX": 30,
        "TRIM_THROTTLE": 50,
        "PTCH_LIM_MIN_DEG": -20,
        "PTCH_LIM_MAX_DEG": 25,
        "ROLL_LIMIT_DEG": 65,
        "LIM_ROLL_CD": 6500,
        "LAND_PITCH_DEG": 1,
        "LAND_FLARE_SEC": 3,
        "WP_LOITER_RAD": 80,
        "WP_RADIUS": 50,
        "RLL2SRV_RMAX": 90,
        "RLL2SRV_TCONST": 0.25,
        "RLL_RATE_D": 0.01743,
        "RLL_RATE_FF": 0.237212,
        "RLL_RATE_I": 0.25,
        "RLL_RATE_P": 0.3,
        "PTCH2SRV_RMAX_DN": 90,
        "PTCH2SRV_RMAX_UP": 90,
        "PTCH2SRV_TCONST": 0.25,
        "PTCH_RATE_D": 0.007265,
        "PTCH_RATE_FF": 0.595723,
        "PTCH_RATE_I": 0.11,
        "PTCH_RATE_P": 0.15,
    },
    "quadplane": {
        **_BOTH,
        "Q_ENABLE": 1,
        "Q_ASSIST_SPEED": 18,
        "AIRSPEED_CRUISE": 25,
        "TRIM_ARSPD_CM": 2500,
        "AIRSPEED_MIN": 13,
        "AIRSPEED_MAX": 35,
        "ARSPD_FBW_MIN": 13,
        "ARSPD_FBW_MAX": 35,
        "PTCH_LIM_MIN_DEG": -30,
        "PTCH_LIM_MAX_DEG": 30,
        "ROLL_LIMIT_DEG": 65,
        "LIM_ROLL_CD": 6500,
        "SCHED_LOOP_RATE": 300,
        "RLL_RATE_D": 0,
        "RLL_RATE_FF": 0.552741,
        "RLL_RATE_I": 0.2125,
        "RLL_RATE_P": 0.141009,
        "PTCH_RATE_D": 0,
        "PTCH_RATE_FF": 1.407055,
        "PTCH_RATE_I": 0.2125,
        "PTCH_RATE_P": 0.309954,
        "Q_M_THST_EXPO": 0.65,
        "Q_M_PWM_MIN": 1000,
        "Q_M_PWM_MAX": 2000,
        "Q_M_BAT_VOLT_MAX": 12.8,
        "Q_M_BAT_VOLT_MIN": 9.6,
        "Q_A_RAT_RLL_P": 0.108,
        "Q_A_RAT_RLL_I": 0.108,
        "Q_A_RAT_RLL_D": 0.001,
        "Q_A_RAT_PIT_P": 0.103,
        "Q_A_RAT_PIT_I": 0.103,
        "Q_A_RAT_PIT_D": 0.001,
        "Q_A_RAT_YAW_P": 0.2,
        "Q_A_RAT_YAW_I": 0.02,
        "Q_A_ANG_RLL_P": 6,
        "Q_A_ANG_PIT_P": 6,
        "Q_RTL_ALT": 20,
    },
}


class WingedFlight(Flight):
    """A flying ArduPlane."""

    GCS_TIMEOUT_NAME = "FS_LONG_TIMEOUT"

    def arm_in(self, mode: int) -> None:
        """With a live lease, arm as soon as the autopilot can."""
        self.sending = True
        self.until(lambda: self.is_state(LIVE), 90, "lease live")
        self.pace(HURRY)
        self.until(lambda: self._arms_in(mode), 180, "arming")
        self.pace(SPEEDUP)

    def _arms_in(self, mode: int) -> bool:
        if self.mode != mode:
            self.set_mode(mode)
            self.run(1.2)
        if self.mode != mode or self.arm() != ACCEPTED:
            self.run(1)
            return False
        return True

    def order(self, mode: int) -> None:
        """The station's order; the mode is there."""
        assert self.set_mode(mode) == ACCEPTED, f"mode {mode} refused, {self.texts[-3:]}"
        self.until(lambda: self.mode == mode, 3, f"mode {mode}")

    def fly_to(self, north_m: float, altitude_m: float) -> None:
        """GUIDED to a place to the north of home (m), which is circled then; altitude above home (m)."""
        place = position(north_m)
        self.station.send(
            dialect.MAVLink_command_int_message(1, 1, 3, REPOSITION, 0, 0, -1, 1, 0, 0, *place, altitude_m)
        )
        self.until(lambda: self.mode == GUIDED, 3, "GUIDED")


@dataclass(frozen=True, slots=True)
class WingedCase:
    """One flight of the suite on wings."""

    name: str
    model: str
    fly: Callable[[WingedFlight], Outcome]
    parameters: Mapping[str, float] = field(default_factory=dict)


def winged_flights(cases: Sequence[WingedCase]) -> Callable[..., None]:
    """The test that flies these cases on every ArduPlane there is, and says what came of them."""

    @pytest.mark.sitl
    @pytest.mark.parametrize(
        "case",
        [
            pytest.param(case, id=case.name, marks=() if case.name in EVERY_TIME else (pytest.mark.long,))
            for case in cases
        ],
    )
    def test(case: WingedCase, arduplane: Firmware, tmp_path: Path, request: pytest.FixtureRequest) -> None:
        recorded(request, case.name, arduplane)
        with launched(
            WingedFlight,
            arduplane,
            tmp_path / "flight",
            parameters={**AIRFRAMES[case.model], **case.parameters},
            recommended=PLANE_PARAMETERS,
            model=case.model,
        ) as flight:
            outcome = case.fly(flight)
        recorded(request, case.name, arduplane, outcome)

    return test


def winged(situation: Step, goes: Step, seen: Callable[[WingedFlight], Outcome]) -> Callable[[WingedFlight], Outcome]:
    """A flight in three parts: what the aircraft is doing, how authority goes, what must be seen then."""

    def fly(flight: WingedFlight) -> Outcome:
        situation(flight)
        goes(flight)
        return seen(flight)

    return fly


# ---- what must be seen, of both ------------------------------------------------------------------------------------


def on_the_ground(flight: WingedFlight, away_m: float = 0.0) -> Outcome:
    """Down and disarmed by the autopilot itself, softly, at home or so far away from it (m)."""
    flight.hurry()
    flight.until(lambda: not flight.armed, 500, "landed and disarmed")
    assert 0 < flight.touch_down_m_s <= SOFT_M_S, f"hit the ground at {flight.touch_down_m_s:.1f} m/s"
    assert abs(flight.home_m - away_m) <= NEAR_M, f"landed {flight.home_m:.0f} m from home"
    return f"landed {flight.home_m:.0f} m from home at {flight.touch_down_m_s:.1f} m/s"


def modes_of(flight: WingedFlight) -> list[tuple[int, int]]:
    """Ends the flight. Its modes and their reasons."""
    return [entry[:2] for entry in chosen(flight)]


def no_lease_no_arming(mode: int, armed_in: int) -> Callable[[WingedFlight], Outcome]:
    """On the ground, in that mode; `armed_in`: the one in which it is armed with a lease, which is lost then."""

    def fly(flight: WingedFlight) -> Outcome:
        flight.pace(HURRY)
        flight.run(60)
        assert flight.set_mode(mode) == ACCEPTED
        assert flight.arm() == FAILED, f"it arms; {flight.texts}"
        said(flight, "HNDO: no lease from companion")
        flight.pace(4)
        flight.texts.clear()
        forced = flight.arm(FORCE)
        if forced == ACCEPTED:
            said(flight, "HNDO: no lease, disarmed", 3)
        flight.until(lambda: not flight.armed, 2, "disarmed")
        assert flight.home_m < 3, flight.home_m
        flight.sending = True
        flight.until(lambda: flight.is_state(LIVE), 5, "lease live")
        assert flight.set_mode(armed_in) == ACCEPTED
        flight.until(lambda: flight.arm() == ACCEPTED, 30, "arming with a lease")
        flight.cut()
        said(flight, "HNDO: lease lost, disarmed", 6)
        flight.until(lambda: not flight.armed, 2, "disarmed")
        by_force = "disarmed at once" if forced == ACCEPTED else "refused"
        return f"refused, forced: {by_force}; armed, lease lost: disarmed"

    return fly

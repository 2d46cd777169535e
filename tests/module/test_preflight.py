# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion says of guard, parameters and firmware before a flight, and when it looks."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.monitors.preflight.own_failsafes import PlanFacts, circles_for_ever, plan_facts
from mavproxy_handover.monitors.preflight.rules import (
    Finding,
    Found,
    judge,
    names_of,
)
from mavproxy_handover.operator.checks.preflight import Preflight
from mavproxy_handover.vehicle.parameter_reading import reading
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, QUADPLANE, Profile
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversations
from tests.module.conftest import Bench, Clock
from tests.module.vehicle import Autopilot
from tests.packages import MISSIONS, ROUND
from tests.vehicle.profiles.test_copter import talk
from tests.vehicle.test_plane_landing import route

PARAMETER_FILE = Path(__file__).parents[2] / "ardupilot_lua" / "handover.parm"
PLANE_FILE = PARAMETER_FILE.with_name("handover_plane.parm")
#: an ArduCopter 4.7 with handover.parm and the guard's defaults
GOOD = {
    "SCR_ENABLE": 1.0,
    "HNDO_ENABLE": 1.0,
    "HNDO_CHAN": 1.0,
    "HNDO_COMPID": 191.0,
    "HNDO_TIMEOUT": 3.0,
    "HNDO_LOST_T": 3.0,
    "HNDO_SYSID_SW": 1.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_GCS_TIMEOUT": 10.0,
    "FS_OPTIONS": 8.0,
    "FS_THR_ENABLE": 1.0,
    "RC_PROTOCOLS": 1.0,
    "SCR_VM_I_COUNT": 10000.0,
    "SCR_LD_CHECKSUM": 4711.0,
    "RALLY_LIMIT_KM": 0.0,
    "MAV_OPTIONS": 0.0,
    "ARMING_SKIPCHK": 0.0,
    "HNDO_ACTION": 1.0,
    "BATT_MONITOR": 4.0,
    "BATT_FS_LOW_ACT": 2.0,
    "BATT_FS_CRT_ACT": 1.0,
    "BATT_LOW_VOLT": 10.5,
    "BATT_LOW_MAH": 0.0,
    "FENCE_ENABLE": 1.0,
    "FENCE_AUTOENABLE": 0.0,
    "FENCE_TYPE": 4.0,
    "FENCE_ACTION": 1.0,
    "FENCE_OPTIONS": 0.0,
    "FENCE_RADIUS": 300.0,
    "FENCE_ALT_MAX": 100.0,
    "RTL_ALT_M": 15.0,
    "RTL_ALT_FINAL_M": 0.0,
    "RALLY_INCL_HOME": 0.0,
    "TERRAIN_ENABLE": 1.0,
    "WPNAV_RFND_USE": 1.0,
    "RNGFND1_TYPE": 0.0,
    "CIRCLE_RATE": 20.0,
}


#: without these no mission is loaded
SPEEDS = {"WPNAV_SPEED": 1000.0, "RTL_SPEED": 0.0}


class ParameterAutopilot(Autopilot):
    """An autopilot with parameters. It says nothing to a name that it does not have."""

    def __init__(self, parameters: dict[str, float]) -> None:
        super().__init__()
        self.parameters = {**SPEEDS, **parameters}
        #: requests that get lost before one is answered
        self.deaf_for = 0
        self.asked: list[str] = []
        #: firmware that has PARAM_ERROR says so of a name that it does not have
        self.says_error = False

    def _take(self, m: Any) -> None:
        if m.get_type() != "PARAM_REQUEST_READ":
            super()._take(m)
            return
        if m.param_id not in COPTER.reads:
            self._say_parameter(m.param_id)
            return
        self.asked.append(m.param_id)
        if self.deaf_for > 0:
            self.deaf_for -= 1
        elif m.param_id in self.parameters:
            self._say_parameter(m.param_id)
        elif self.says_error:
            self.say(stock.MAVLink_param_error_message(1, 191, m.param_id.encode(), -1, 1))


# ---- reading ------------------------------------------------------------------------------------------------------


def test_every_parameter_that_is_there_is_read_and_a_missing_one_costs_a_time_out() -> None:
    autopilot = ParameterAutopilot(dict(GOOD))
    ended = talk(reading(1, COPTER.reads), autopilot, limit_s=10.0)
    assert ended.finished
    assert ended.result == {**GOOD, **SPEEDS}
    assert {name: autopilot.asked.count(name) for name in ("SYSID_ENFORCE", "HNDO_CHAN")} == {
        "SYSID_ENFORCE": 3,
        "HNDO_CHAN": 1,
    }


def test_a_request_that_got_lost_is_repeated() -> None:
    autopilot = ParameterAutopilot(dict.fromkeys(COPTER.reads, 7.0))
    autopilot.deaf_for = 8
    ended = talk(reading(1, COPTER.reads), autopilot, limit_s=10.0)
    assert ended.result == dict.fromkeys(COPTER.reads, 7.0)


def test_a_firmware_that_says_that_it_lacks_a_name_is_not_asked_again() -> None:
    autopilot = ParameterAutopilot({"SCR_ENABLE": 1.0})
    autopilot.says_error = True
    ended = talk(reading(1, COPTER.reads), autopilot, limit_s=1.0)
    assert ended.result == {"SCR_ENABLE": 1.0, **SPEEDS}
    assert sorted(autopilot.asked) == sorted(COPTER.reads)


def test_other_parameters_and_nonsense_are_no_answers() -> None:
    autopilot = ParameterAutopilot({"SCR_ENABLE": float("nan"), "HNDO_ENABLE": float("inf")})
    assert talk(reading(1, COPTER.reads), autopilot, limit_s=10.0).result == SPEEDS


def test_no_more_is_asked_at_once_than_the_autopilot_keeps() -> None:
    first = next(reading(1, COPTER.reads))
    assert len(first.messages) <= 20


# ---- judging ------------------------------------------------------------------------------------------------------


def found(guard: GuardState = GuardState.LIVE, firmware: tuple[int, int] | None = (4, 7), **changes: Any) -> Found:
    """GOOD with changes; a parameter that is None is not there."""
    heard_on, foreign, plan = changes.pop("heard_on", None), changes.pop("foreign", ""), changes.pop("plan", None)
    parameters = {name: value for name, value in {**GOOD, **changes}.items() if value is not None}
    return Found(parameters, guard, firmware, foreign, heard_on, plan)


def test_what_is_recommended_fits() -> None:
    assert judge(found(), Limits()) == ()
    older = found(firmware=(4, 5), MAV_OPTIONS=None, SYSID_ENFORCE=0.0, ARMING_SKIPCHK=None, ARMING_CHECK=1.0)
    assert judge(older, Limits()) == ()


def test_the_parameter_file_that_ships_fits() -> None:
    lines = [line.split() for line in PARAMETER_FILE.read_text().splitlines() if line and not line.startswith("#")]
    shipped = {name: float(value) for name, value in lines if name in COPTER.reads}
    assert len(shipped) >= 6
    assert judge(found(**shipped), Limits()) == ()


def test_a_vehicle_without_radio_control_needs_no_radio_failsafe() -> None:
    assert judge(found(FS_THR_ENABLE=0.0, RC_PROTOCOLS=0.0), Limits()) == ()


def test_of_what_is_not_flown_here_nothing_else_is_said() -> None:
    """The fault: a rover was told how to set up a copter's failsafes."""
    (finding,) = judge(found(foreign="ardupilotmega ground rover", FS_THR_ENABLE=0.0, HNDO_COMPID=190.0), Limits())
    assert finding.text.startswith("ardupilotmega ground rover is neither")


def test_checksums_are_of_scripts_that_run() -> None:
    texts = [finding.text for finding in judge(found(guard=GuardState.SILENT, SCR_LD_CHECKSUM=-1.0), Limits())]
    assert not any("CHECKSUM" in text for text in texts)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"HNDO_ENABLE": 0.0}, "the guard is switched off"),
        (
            {"foreign": "ardupilotmega ground rover"},
            "ardupilotmega ground rover is neither ArduCopter nor ArduPlane: START is refused, and the guard "
            "refuses arming",
        ),
        ({"SCR_VM_I_COUNT": 2500.0}, "SCR_VM_I_COUNT is 2500: below 10000 the guard may be removed in flight"),
        (
            {"SCR_LD_CHECKSUM": -1.0},
            "SCR_LD_CHECKSUM is -1: an SD card that is gone or changed is not noticed at arming; set SCR_DEBUG_OPTS to "
            "32 once",
        ),
        (
            {"FS_THR_ENABLE": 0.0},
            "FS_THR_ENABLE is 0: the guard believes no pilot then; on a vehicle without radio control set RC_PROTOCOLS "
            "0 as well",
        ),
        ({"HNDO_CHAN": -1.0}, "the guard takes leases from any port: any program that reaches one can send them"),
        ({"HNDO_COMPID": 190.0}, "HNDO_COMPID is 190, must be 191"),
        (
            {"HNDO_TIMEOUT": 0.5},
            "HNDO_TIMEOUT is 0.5 s: a few lost leases (there are five a second) end the flight",
        ),
        (
            {"HNDO_TIMEOUT": 10.0},
            "HNDO_TIMEOUT is 10 s, not shorter than FS_GCS_TIMEOUT: the guard would not be the first to act",
        ),
        (
            {"HNDO_LOST_T": 1.0},
            "HNDO_LOST_T is 1 s: the guard acts while the companion still looks for a partner, up to 2 s",
        ),
        (
            {"HNDO_LOST_T": 2.75},
            "HNDO_LOST_T is 2.75 s: the guard acts while the companion recovers from a restart (3 s)",
        ),
        (
            {"HNDO_SYSID_SW": 0.0},
            "HNDO_SYSID_SW is 0: the autopilot's GCS failsafe goes on watching one station, also when another commands",
        ),
        (
            {"FS_GCS_ENABLE": 0.0},
            "FS_GCS_ENABLE is 0: nothing brings the aircraft home if companion and guard both fail",
        ),
        (
            {"FS_GCS_TIMEOUT": 5.0},
            "FS_GCS_TIMEOUT is 5 s: the autopilot returns before a partner can take over (7 s)",
        ),
        ({"FS_OPTIONS": 10.0}, "FS_OPTIONS is 10: bit 1 lets a mission go on without a ground station"),
        ({"FS_OPTIONS": 16.0}, "FS_OPTIONS is 16: bit 4 is for flights with a safety pilot at hand"),
        ({"RALLY_LIMIT_KM": 0.3}, "RALLY_LIMIT_KM is 0.3: a return goes home if the return site is farther away"),
        ({"MAV_OPTIONS": 1.0}, "MAV_OPTIONS is 1: bit 0 makes the autopilot not answer observers"),
        ({"SYSID_ENFORCE": 1.0}, "SYSID_ENFORCE is 1: the autopilot does not answer observers"),
        ({"ARMING_CHECK": 0.0}, "ARMING_CHECK is 0: the guard cannot refuse arming, only disarm"),
        ({"ARMING_SKIPCHK": -1.0}, "ARMING_SKIPCHK is -1: the guard cannot refuse arming, only disarm"),
        ({"firmware": (4, 4)}, "firmware 4.4 is older than the oldest that this was made for, 4.5"),
        ({"firmware": (4, 8)}, "firmware 4.8 is newer than the newest that this was made for, 4.7"),
        ({"heard_on": 2}, "HNDO_CHAN is 1, but this companion is on channel 2"),
        (
            {"guard": GuardState.SILENT, "firmware": None},
            "HNDO_CHAN is 1 and the guard is silent here: is that the port of this companion?",
        ),
    ],
)
def test_each_thing_that_does_not_fit_is_said_alone(changes: dict[str, Any], text: str) -> None:
    assert [finding.text for finding in judge(found(**changes), Limits())] == [text]


#: a route of 800 m, up to 50 m, with one area to stay inside, and with two
PLAN, TWO = PlanFacts(True, 1, 800.0, 50.0), PlanFacts(True, 2, 800.0, 50.0)
NO_FENCE = PlanFacts(False, 0, 800.0, 50.0)
AT_10_MPS = replace(NO_FENCE, cruise_mps=10.0)
SMART = "SMART_RTL flies back the way it came, not to the return site"
AUTO_RTL = "AUTO_RTL follows the mission's landing sequence, and does not go to the return site"
CLIMBS_FIRST = "a return climbs by so much first, and the energy of that is not counted"
AT_5_MPS = "a return is flown at 5 m/s, handover check and START count the mission's cruise speed"


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"BATT_MONITOR": 0.0}, "BATT_MONITOR is 0: the autopilot does not measure the battery"),
        (
            {"BATT_FS_LOW_ACT": 0.0},
            "BATT_FS_LOW_ACT is 0: nothing brings the aircraft home when the battery is low",
        ),
        (
            {"BATT_LOW_VOLT": 0.0},
            "BATT_LOW_VOLT is 0, and BATT_LOW_MAH is 0: the battery's failsafe never acts",
        ),
        ({"BATT_FS_LOW_ACT": 3.0}, f"BATT_FS_LOW_ACT is 3: {SMART}"),
        ({"BATT_FS_LOW_ACT": 4.0}, f"BATT_FS_LOW_ACT is 4: {SMART}"),
        ({"BATT_FS_LOW_ACT": 5.0, "BATT_FS_CRT_ACT": 0.0}, "BATT_FS_LOW_ACT is 5: stops the motors in the air"),
        ({"BATT_FS_LOW_ACT": 6.0}, f"BATT_FS_LOW_ACT is 6: {AUTO_RTL}"),
        ({"BATT_FS_CRT_ACT": 5.0}, "BATT_FS_CRT_ACT is 5: stops the motors in the air"),
        ({"BATT_FS_CRT_ACT": 7.0}, "BATT_FS_CRT_ACT is 7: never acts after BATT_FS_LOW_ACT 2"),
        ({"BATT_FS_LOW_ACT": 1.0, "BATT_FS_CRT_ACT": 2.0}, "BATT_FS_CRT_ACT is 2: never acts after BATT_FS_LOW_ACT 1"),
        ({"FS_GCS_ENABLE": 3.0}, f"FS_GCS_ENABLE is 3: {SMART}"),
        ({"FS_GCS_ENABLE": 4.0}, f"FS_GCS_ENABLE is 4: {SMART}"),
        ({"FS_GCS_ENABLE": 6.0}, f"FS_GCS_ENABLE is 6: {AUTO_RTL}"),
        ({"FS_THR_ENABLE": 4.0}, f"FS_THR_ENABLE is 4: {SMART}"),
        ({"FS_THR_ENABLE": 5.0}, f"FS_THR_ENABLE is 5: {SMART}"),
        ({"FS_THR_ENABLE": 6.0}, f"FS_THR_ENABLE is 6: {AUTO_RTL}"),
        ({"FS_DR_ENABLE": 3.0}, f"FS_DR_ENABLE is 3: {SMART}"),
        ({"FS_DR_ENABLE": 4.0}, f"FS_DR_ENABLE is 4: {SMART}"),
        ({"FS_DR_ENABLE": 5.0}, "FS_DR_ENABLE is 5: stops the motors in the air"),
        ({"FS_DR_ENABLE": 6.0}, f"FS_DR_ENABLE is 6: {AUTO_RTL}"),
        ({"HNDO_ACTION": 2.0}, f"HNDO_ACTION is 2: {SMART}"),
        ({"FENCE_ACTION": 3.0}, f"FENCE_ACTION is 3: {SMART}"),
        ({"FENCE_ACTION": 5.0}, f"FENCE_ACTION is 5: {SMART}"),
        ({"FENCE_ACTION": 0.0}, "FENCE_ACTION is 0: leaving the geofence is reported, and nothing is done"),
        ({"FENCE_ENABLE": 0.0, "plan": PLAN}, "FENCE_ENABLE is 0: the plan's geofence is stored, and not kept to"),
        (
            {"FENCE_TYPE": 8.0, "plan": PLAN},
            "FENCE_TYPE is 8: without bit 2 the plan's geofence is stored, and not kept to",
        ),
        (
            {"FENCE_OPTIONS": 2.0, "plan": TWO},
            "FENCE_OPTIONS is 2: bit 1 makes one area of those to stay inside; the plan was checked against each",
        ),
        (
            {"FENCE_TYPE": 6.0, "plan": PLAN},
            "FENCE_RADIUS is 300 m, and the route goes 800 m from home: take bit 1 out of FENCE_TYPE",
        ),
        (
            {"FENCE_TYPE": 2.0, "plan": NO_FENCE},
            "FENCE_RADIUS is 300 m, and the route goes 800 m from home: take bit 1 out of FENCE_TYPE",
        ),
        (
            {"FENCE_TYPE": 5.0, "FENCE_ALT_MAX": 45.0, "plan": PLAN},
            "FENCE_ALT_MAX is 45 m, and the route climbs to 50 m",
        ),
        (
            {"FENCE_TYPE": 5.0, "RTL_ALT_M": 120.0},
            "RTL_ALT_M is 120 m, above FENCE_ALT_MAX: a return is flown at 100 m",
        ),
        (
            {"FENCE_TYPE": 5.0, "RTL_ALT_M": None, "RTL_ALT": 12000.0},
            "RTL_ALT is 120 m, above FENCE_ALT_MAX: a return is flown at 100 m",
        ),
        ({"RTL_SPEED_MS": 5.0}, f"RTL_SPEED_MS is 5: {AT_5_MPS}"),
        ({"RTL_SPEED": 500.0}, f"RTL_SPEED is 500: {AT_5_MPS}"),
        ({"RTL_SPEED": 500.0, "WPNAV_SPEED": 800.0}, f"RTL_SPEED is 500: {AT_5_MPS}"),
        (
            {"WPNAV_SPEED": 300.0, "plan": AT_10_MPS},
            "WPNAV_SPEED is 300: 3 m/s is flown, handover check and START count 10 m/s",
        ),
        ({"WP_SPD": 3.0, "plan": AT_10_MPS}, "WP_SPD is 3: 3 m/s is flown, handover check and START count 10 m/s"),
        (
            {"WPNAV_SPEED_UP": 100.0},
            "WPNAV_SPEED_UP is 100: a return climbs at 1 m/s, and the energy of 2.5 m/s is counted",
        ),
        ({"WP_SPD_UP": 1.0}, "WP_SPD_UP is 1: a return climbs at 1 m/s, and the energy of 2.5 m/s is counted"),
        (
            {"WPNAV_SPEED_DN": 100.0},
            "WPNAV_SPEED_DN is 100: a return comes down at 1 m/s, and the energy of 1.5 m/s is counted",
        ),
        ({"LAND_SPEED": 25.0}, "LAND_SPEED is 25: it lands at 0.25 m/s, and the energy of 0.5 m/s is counted"),
        ({"LAND_SPD_MS": 0.25}, "LAND_SPD_MS is 0.25: it lands at 0.25 m/s, and the energy of 0.5 m/s is counted"),
        (
            {"WPNAV_ACCEL": 100.0},
            "WPNAV_ACCEL is 100: it speeds up and brakes at 1 m/s2, and the energy of 1.5 m/s2 is counted",
        ),
        (
            {"LAND_ALT_LOW": 3000.0},
            "LAND_ALT_LOW is 3000: it lands slowly from 30 m on, and the energy is counted from 10 m",
        ),
        (
            {"OA_TYPE": 1.0},
            "OA_TYPE is 1: a return flies around obstacles, and the energy and coverage of that are not counted",
        ),
        (
            {"RC7_OPTION": 11.0},
            "RC7_OPTION is 11 (FENCE): a station's RC override switches it in flight, which DO_AUX_FUNCTION may not",
        ),
        ({"RTL_CLIMB_MIN": 1500.0}, f"RTL_CLIMB_MIN is 15 m: {CLIMBS_FIRST}"),
        ({"RTL_CLIMB_MIN_M": 15.0}, f"RTL_CLIMB_MIN_M is 15 m: {CLIMBS_FIRST}"),
        (
            {"RTL_LOIT_TIME": 60000.0},
            "RTL_LOIT_TIME is 60 s: a return waits this long above its site, but the energy of 5 s is counted",
        ),
        ({"RTL_ALT_FINAL_M": 5.0}, "RTL_ALT_FINAL_M is 5: a return ends hovering at 5 m, not landed"),
        (
            {"RTL_ALT_FINAL_M": None, "RTL_ALT_FINAL": 500.0},
            "RTL_ALT_FINAL is 500: a return ends hovering at 5 m, not landed",
        ),
        (
            {"RALLY_INCL_HOME": 1.0},
            "RALLY_INCL_HOME is 1: where home is nearer a return goes there, not to the return site",
        ),
    ],
)
def test_each_of_the_autopilot_s_own_failsafes_that_does_not_fit_is_said_alone(
    changes: dict[str, Any], text: str
) -> None:
    assert [finding.text for finding in judge(found(**changes), Limits())] == [text]


@pytest.mark.parametrize(
    "changes",
    [
        {"BATT_MONITOR": 4.0, "BATT_FS_LOW_ACT": 7.0, "BATT_FS_CRT_ACT": 7.0},
        {"BATT_LOW_VOLT": 0.0, "BATT_LOW_MAH": 600.0},
        {"BATT_FS_CRT_ACT": 0.0},
        {"FS_DR_ENABLE": 0.0},
        {"FS_DR_ENABLE": 2.0},
        {"RTL_SPEED": 0.0},
        {"RTL_SPEED": 1000.0, "WPNAV_SPEED": 1000.0},
        {"RC7_OPTION": 4.0, "RC8_OPTION": 153.0, "RC9_OPTION": 0.0, "RC10_OPTION": 300.0},
        {"RTL_SPEED_MS": 10.0, "WP_SPD": 10.0, "plan": AT_10_MPS},
        {"WPNAV_SPEED": 1500.0, "plan": AT_10_MPS},
        {"WPNAV_SPEED_UP": 250.0, "WPNAV_SPEED_DN": 150.0, "LAND_SPEED": 50.0, "LAND_ALT_LOW": 1000.0},
        {"WP_SPD_UP": 2.5, "WP_SPD_DN": 1.5, "LAND_SPD_MS": 0.5, "LAND_ALT_LOW_M": 10.0, "WP_ACC": 2.5, "OA_TYPE": 0.0},
        {"RTL_CLIMB_MIN": 0.0, "RTL_LOIT_TIME": 5000.0},
        {"RTL_CLIMB_MIN_M": 0.0, "RTL_LOIT_TIME": 0.0},
        {"FENCE_ENABLE": 0.0, "FENCE_AUTOENABLE": 3.0, "plan": PLAN},
        {"FENCE_ENABLE": 0.0, "FENCE_TYPE": 7.0, "FENCE_ACTION": 0.0, "plan": NO_FENCE},
        {"FENCE_ENABLE": None, "FENCE_AUTOENABLE": None, "FENCE_TYPE": None, "plan": PLAN},
        {"FENCE_TYPE": 8.0, "plan": NO_FENCE},
        {"FENCE_OPTIONS": 2.0, "plan": PLAN},
        {"FENCE_TYPE": 7.0, "FENCE_RADIUS": 801.0, "FENCE_ALT_MAX": 51.0, "plan": PLAN},
        {"FENCE_TYPE": 6.0, "FENCE_ALT_MAX": 10.0, "FENCE_RADIUS": 801.0, "plan": PLAN},
    ],
)
def test_what_is_no_trouble_is_not_said(changes: dict[str, Any]) -> None:
    """A critical action as grave as the low one acts; a fence that is off limits nothing; and so on."""
    assert judge(found(**changes), Limits()) == ()


# ---- further batteries --------------------------------------------------------------------------------------------

#: a second battery as well set up as the first
SECOND = {
    "BATT2_MONITOR": 4.0,
    "BATT2_FS_LOW_ACT": 2.0,
    "BATT2_FS_CRT_ACT": 1.0,
    "BATT2_LOW_VOLT": 10.5,
    "BATT2_LOW_MAH": 0.0,
}
FITS, SECOND_IS_SMART = "guard, parameters and firmware fit", f"BATT2_FS_LOW_ACT is 3: {SMART}"


def with_batteries(batteries: int, kind: Profile = COPTER, **changes: float) -> list[str]:
    good = GOOD if kind is COPTER else GOOD_PLANE
    state = Found({**good, **changes}, GuardState.LIVE, (4, 7), plan=FLAT, profile=kind, batteries=batteries)
    return [finding.text for finding in judge(state, Limits())]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"BATT2_MONITOR": 0.0}, "BATT2_MONITOR is 0: the autopilot does not measure the battery"),
        (
            {"BATT2_FS_LOW_ACT": 0.0},
            "BATT2_FS_LOW_ACT is 0: nothing brings the aircraft home when the battery is low",
        ),
        (
            {"BATT2_LOW_VOLT": 0.0},
            "BATT2_LOW_VOLT is 0, and BATT2_LOW_MAH is 0: the battery's failsafe never acts",
        ),
        ({"BATT2_FS_LOW_ACT": 3.0}, f"BATT2_FS_LOW_ACT is 3: {SMART}"),
        ({"BATT2_FS_LOW_ACT": 6.0}, f"BATT2_FS_LOW_ACT is 6: {AUTO_RTL}"),
        ({"BATT2_FS_CRT_ACT": 5.0}, "BATT2_FS_CRT_ACT is 5: stops the motors in the air"),
        ({"BATT2_FS_CRT_ACT": 7.0}, "BATT2_FS_CRT_ACT is 7: never acts after BATT2_FS_LOW_ACT 2"),
    ],
)
def test_a_second_battery_that_flies_it_is_judged_as_the_first(changes: dict[str, float], text: str) -> None:
    """The fault: with batteries = 2 only BATT_FS_* was read, and the second could choose SMART_RTL."""
    assert with_batteries(2, **{**SECOND, **changes}) == [text]
    assert with_batteries(1, **{**SECOND, **changes}) == []


def test_the_eighth_battery_is_judged_and_an_autopilot_without_it_hears_nothing_of_it() -> None:
    assert with_batteries(8, **SECOND) == []
    assert with_batteries(8, BATT8_FS_CRT_ACT=4.0) == [f"BATT8_FS_CRT_ACT is 4: {SMART}"]


def test_a_second_battery_of_a_plane_is_judged_by_what_a_plane_does() -> None:
    plane = {**SECOND, "BATT2_FS_LOW_ACT": 1.0, "BATT2_FS_CRT_ACT": 4.0}
    assert with_batteries(2, QUADPLANE, **plane) == []
    assert with_batteries(2, QUADPLANE, **{**plane, "BATT2_FS_CRT_ACT": 7.0}) == [
        "BATT2_FS_CRT_ACT is 7: AUTOLAND lands at home, not at the return site",
        "BATT2_FS_CRT_ACT is 7: never acts after BATT2_FS_LOW_ACT 1",
    ]


def test_what_is_read_of_further_batteries() -> None:
    assert names_of(COPTER) == COPTER.reads
    assert names_of(PLANE, 3)[len(PLANE.reads) :] == (
        "BATT2_MONITOR",
        "BATT2_FS_LOW_ACT",
        "BATT2_FS_CRT_ACT",
        "BATT2_LOW_VOLT",
        "BATT2_LOW_MAH",
        "BATT3_MONITOR",
        "BATT3_FS_LOW_ACT",
        "BATT3_FS_CRT_ACT",
        "BATT3_LOW_VOLT",
        "BATT3_LOW_MAH",
    )


@pytest.mark.parametrize(
    ("own", "missions", "text"),
    [
        (EnergySettings(), None, FITS),
        (EnergySettings(batteries=2.0), None, SECOND_IS_SMART),
        (EnergySettings(batteries=2.0), EnergySettings(), SECOND_IS_SMART),
        (EnergySettings(), EnergySettings(batteries=2.0), SECOND_IS_SMART),
        (EnergySettings(batteries=2.0), EnergySettings(batteries=1.0), FITS),
    ],
)
def test_how_many_batteries_fly_it_is_the_missions_to_say_and_else_the_vehicles(
    own: EnergySettings, missions: EnergySettings | None, text: str
) -> None:
    autopilot = ParameterAutopilot({**GOOD, **SECOND, "BATT2_FS_LOW_ACT": 3.0})
    coder, written = mavlink.MAVLink(None, srcSystem=1, srcComponent=191), list[bytes]()
    talks = Conversations(lambda message: written.append(bytes(message.pack(coder))), lambda where, text: None)
    said: list[str] = []
    aircraft = VehicleState()
    preflight = Preflight(1, aircraft, Limits(), talks, lambda text, parameter, fits: said.append(text), own)
    if missions is not None:
        preflight.planned(FLAT, energy=missions)
        preflight.planned(FLAT)  # a mission sent in flight says nothing of batteries
    for tick in range(300):
        now = 0.05 * tick
        aircraft.on_message(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3), now)
        preflight.each_second(True, GuardState.LIVE, (4, 7), now)
        waiting, written[:] = list(written), []
        for message in autopilot.step(waiting, now):
            aircraft.on_message(message, now)
            talks.on_message(message, now)
        talks.tick(now)
    assert said == [text]


@pytest.mark.parametrize(("most_s", "gap_s", "told"), [(0, 0, 0), (60, 60, 0), (60, 0, 0), (59, 60, 1), (None, 60, 1)])
def test_a_gap_of_the_mission_needs_a_guard_that_allows_it(most_s: float | None, gap_s: float, told: int) -> None:
    own = {} if most_s is None else {"HNDO_ALONE_MAX": float(most_s)}
    found = judge(Found({**GOOD, **own}, GuardState.LIVE, (4, 7), gap_s=gap_s), Limits())
    assert len(found) == told
    if told:
        is_s = f"{most_s or 0:g} s"
        text = f"HNDO_ALONE_MAX is {is_s}: too short for a gap of the mission (60 s), START is refused"
        assert found == (Finding("HNDO_ALONE_MAX", text),)


def test_the_rate_of_a_circle_is_that_of_its_target() -> None:
    """100 m at 10 m/s: the aircraft flies a smaller circle, and not faster around."""
    turns = Path(__file__).resolve().parents[1] / "data" / "missions" / "loiter_turns"
    assert plan_facts(load(turns).route, 10.0).circle_deg_s == pytest.approx(5.73, abs=0.01)
    assert plan_facts(load(MISSIONS / "delivery").route).circle_deg_s == 0.0


def test_the_facts_of_a_plan() -> None:
    facts = plan_facts(load(ROUND).route)
    assert (facts.fence, facts.inclusions, facts.highest_m) == (True, 1, 50.0)
    assert facts.farthest_m == pytest.approx(546.3, abs=0.5)  # waypoint 8: 195 m north, 510 m east
    corridor = plan_facts(load(MISSIONS / "corridor").route)
    assert (corridor.fence, corridor.inclusions) == (False, 0)


@pytest.mark.parametrize(
    ("commands", "lands", "aloft"),
    [
        ((22, 16), False, None),
        ((22, 16, 189, 16, 21), True, None),
        ((22, 16, 189, 16, 20, 21), False, 3),
        ((22, 16, 189, 16), False, 3),
        ((22, 189, 16, 21, 189, 16), False, 5),
    ],
)
def test_a_plan_lands_where_each_of_its_landing_sequences_does(
    commands: tuple[int, ...], lands: bool, aloft: int | None
) -> None:
    """A return goes to the nearest, whichever that is."""
    facts = plan_facts(replace(route(*commands), profile=PLANE))
    assert (facts.lands, facts.aloft) == (lands, aloft)


def without_guard(**changes: Any) -> Found:
    lacking = {name: None for name in GOOD if name.startswith("HNDO_")}
    return found(GuardState.SILENT, None, **{**lacking, **changes})


def test_an_autopilot_without_the_guard() -> None:
    text = "the guard is not loaded; 'handover guard' puts it on the SD card"
    assert judge(without_guard(), Limits()) == (Finding("", text),)
    assert [finding.text for finding in judge(without_guard(SCR_ENABLE=0.0), Limits())] == [
        "scripting is off: the guard does not run"
    ]


def test_a_vehicle_that_needs_no_guard_hears_nothing_of_one() -> None:
    assert judge(without_guard(), Limits(guard_required=False)) == ()
    assert len(judge(without_guard(FS_GCS_ENABLE=0.0), Limits(guard_required=False))) == 1


def test_an_autopilot_that_answers_nothing_is_one_finding_and_no_reason_for_more() -> None:
    assert [finding.text for finding in judge(Found({}, GuardState.SILENT), Limits())] == [
        "the autopilot answers no request for parameters: nothing could be checked"
    ]


def test_limits_that_were_changed_count() -> None:
    limits = Limits(heartbeat_lost_s=9.0, forced_timeout_s=4.0)
    assert [finding.parameter for finding in judge(found(), limits)] == ["HNDO_LOST_T", "FS_GCS_TIMEOUT"]


@pytest.mark.parametrize(("recovery_s", "lost_s", "fits"), [(2.8, 3.3, True), (2.8, 3.2, False), (1.5, 2.0, True)])
def test_the_guard_s_patience_lasts_for_a_recovery_and_half_a_second(
    recovery_s: float, lost_s: float, fits: bool
) -> None:
    """As an autopilot sends it: with 24 bits."""
    (sent,) = struct.unpack("<f", struct.pack("<f", lost_s))
    assert (judge(found(HNDO_LOST_T=sent), Limits(recovery_s=recovery_s)) == ()) is fits


# ---- in the companion ---------------------------------------------------------------------------------------------


@pytest.fixture
def flown(clock: Clock, tmp_path: Path) -> Iterator[Bench]:
    """A bench whose autopilot has parameters, all of them good."""
    bench = Bench(tmp_path, clock)
    bench.autopilot = ParameterAutopilot(dict(GOOD))
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


ABOVE_TERRAIN = MissionItem(2, 16, 10, 0, 0, 0, 0, 52.0, 5.0, 30.0)
ABOVE_SEA = MissionItem(3, 16, 0, 0, 0, 0, 0, 52.0, 5.0, 630.0)


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        (
            {"CIRCLE_RATE": 5.0},
            [
                "CIRCLE_RATE is 5 degrees/s: a circle of the mission takes longer, and more energy, than was counted "
                "(11.5 were counted)"
            ],
        ),
        (
            {"CIRCLE_RATE": 0.0},
            ["CIRCLE_RATE is 0 degrees/s: a circle of the mission never ends (11.5 were counted)"],
        ),
        ({"CIRCLE_RATE": -11.5}, []),
    ],
)
def test_circles_take_as_long_as_they_were_counted(changes: dict[str, float], texts: list[str]) -> None:
    plan = PlanFacts(True, 1, 200.0, 50.0, circle_deg_s=11.5)
    assert [finding.text for finding in judge(found(plan=plan, **changes), Limits())] == texts
    assert judge(found(plan=PlanFacts(True, 1, 200.0, 50.0), **changes), Limits()) == ()


@pytest.mark.parametrize("kind", [COPTER, PLANE])
def test_a_mission_that_opens_a_gripper_needs_one(kind: Profile) -> None:
    """The fault: nothing was said, the autopilot says `Gripper Released`, and the load comes home."""
    plan = PlanFacts(True, 1, 200.0, 50.0, gripper=9, lands=True)

    def said(changes: dict[str, float], plan: PlanFacts) -> list[str]:
        findings = judge(replace(found(plan=plan, **changes), profile=kind), Limits())
        return [finding.text for finding in findings if finding.parameter == "GRIP_ENABLE"]

    text = "GRIP_ENABLE is 0: item 9 (DO_GRIPPER) moves no gripper, and the load stays on board"
    assert said({"GRIP_ENABLE": 0.0}, plan) == [text]
    assert said({"GRIP_ENABLE": 1.0}, plan) == []
    assert said({}, plan) == [], "not answered is not off"
    assert said({"GRIP_ENABLE": 0.0}, replace(plan, gripper=None)) == []
    assert "GRIP_ENABLE" in names_of(COPTER)
    assert "GRIP_ENABLE" in names_of(PLANE)


def test_the_gripper_of_the_delivery_is_its_item_9() -> None:
    assert plan_facts(load(MISSIONS / "delivery").route).gripper == 9
    assert plan_facts(load(MISSIONS / "linear").route).gripper is None


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({}, []),
        (
            {"TERRAIN_ENABLE": 0.0},
            [
                "item 2 (NAV_WAYPOINT) above terrain: TERRAIN_ENABLE is not 1 and there is no range finder. Set it to "
                "1, or plan heights above home; START is refused"
            ],
        ),
        ({"TERRAIN_ENABLE": 0.0, "RNGFND1_TYPE": 8.0}, []),
    ],
)
def test_heights_above_terrain_need_terrain(changes: dict[str, float], texts: list[str]) -> None:
    plan = PlanFacts(True, 1, 200.0, 50.0, above_terrain=(ABOVE_TERRAIN,), ground=True)
    assert [finding.text for finding in judge(found(plan=plan, **changes), Limits())] == texts


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({"DID_ENABLE": 1.0, "DID_MAVPORT": 2.0}, []),
        ({"DID_ENABLE": 1.0, "DID_MAVPORT": -1.0, "DID_CANDRIVER": 1.0}, []),
        ({"DID_ENABLE": 0.0, "DID_OPTIONS": 0.0}, []),
        (
            {"DID_ENABLE": 1.0, "DID_MAVPORT": -1.0, "DID_CANDRIVER": 0.0},
            ["DID_MAVPORT is -1, and DID_CANDRIVER is 0: Remote ID is enabled and has no transponder"],
        ),
        (
            {"DID_ENABLE": 0.0, "DID_OPTIONS": 1.0},
            ["DID_ENABLE is 0, and DID_OPTIONS wants Remote ID for arming: arming is refused"],
        ),
    ],
)
def test_remote_id_needs_its_transponder(changes: dict[str, float], texts: list[str]) -> None:
    assert [finding.text for finding in judge(found(**changes), Limits())] == texts


def test_heights_above_terrain_without_heights_of_the_ground_are_told() -> None:
    plan = PlanFacts(True, 1, 200.0, 50.0, above_terrain=(ABOVE_TERRAIN,))
    assert [finding.text for finding in judge(found(plan=plan), Limits())] == [
        "item 2 (NAV_WAYPOINT) above terrain: the mission has no heights of the ground, so its heights above home are "
        "not known"
    ]


def test_heights_above_the_sea_need_both_homes_at_the_same_height() -> None:
    plan = PlanFacts(True, 1, 200.0, 50.0, home_alt_m=0.0, above_sea=(ABOVE_SEA,))
    texts = {
        home_m: [finding.text for finding in judge(replace(found(plan=plan), home_alt_m=home_m), Limits())]
        for home_m in (5.0, 600.0, None)
    }
    assert texts == {
        5.0: [],
        600.0: [
            "item 3 (NAV_WAYPOINT) above sea: home is at 0 m in the plan and at 600 m in the autopilot (allowed: 10 m "
            "apart). Plan heights above home, or home at its height; START is refused"
        ],
        None: ["item 3 (NAV_WAYPOINT) above sea: the height of the autopilot's home is not known; START is refused"],
    }


def said(bench: Bench) -> list[tuple[str, bool]]:
    return [(entry["text"], entry["fits"]) for entry in bench.journal("preflight")]


def test_all_is_well_is_said_once(flown: Bench) -> None:
    flown.connect()
    flown.wait(60.0)
    assert said(flown) == [("guard, parameters and firmware fit", True)]
    assert flown.autopilot.asked.count("HNDO_CHAN") == 1  # type: ignore[attr-defined]
    flown.mpstate.type("handover status")
    assert "preflight guard, parameters and firmware fit" in flown.mpstate.console.lines


def test_what_does_not_fit_is_journalled_shown_and_in_the_status_until_it_is_put_right(flown: Bench) -> None:
    flown.autopilot.parameters["RALLY_LIMIT_KM"] = 0.3  # type: ignore[attr-defined]
    flown.connect()
    flown.wait(90.0)
    text = "RALLY_LIMIT_KM is 0.3: a return goes home if the return site is farther away"
    assert said(flown) == [(text, False)]
    assert flown.journal("preflight")[0]["parameter"] == "RALLY_LIMIT_KM"
    assert len([line for line in flown.mpstate.console.lines if f"Preflight WARNING: {text}." in line]) == 1
    flown.mpstate.type("handover status")
    assert flown.mpstate.console.lines[-1] == f"preflight WARNING: {text}"
    flown.autopilot.parameters["RALLY_LIMIT_KM"] = 0.0  # type: ignore[attr-defined]
    flown.wait(40.0)
    assert said(flown)[1:] == [("guard, parameters and firmware fit", True)]


def test_the_guards_own_words_name_the_right_channel(flown: Bench) -> None:
    flown.autopilot.guard_state = None
    flown.connect()
    flown.autopilot.say(stock.MAVLink_statustext_message(4, b"HNDO: lease refused, channel 2 not 1"))
    for message in flown.autopilot._out:
        flown.mpstate.deliver(message)
    flown.wait(20.0)
    assert said(flown) == [("HNDO_CHAN is 1, but this companion is on channel 2", False)]


def test_nothing_is_asked_while_armed(flown: Bench) -> None:
    flown.autopilot.guard_state = None  # it waits longer for one that is silent
    flown.connect()
    flown.autopilot.armed = True
    flown.wait(30.0)
    assert flown.autopilot.asked == []  # type: ignore[attr-defined]
    assert flown.companion.autopilot.preflight.findings is None


def test_a_reading_that_a_start_overtakes_is_finished(flown: Bench) -> None:
    flown.autopilot.parameters["FS_GCS_ENABLE"] = 0.0  # type: ignore[attr-defined]
    flown.connect()
    flown.until(lambda: "preflight" in flown.companion.autopilot.conversations)
    flown.autopilot.armed = True
    flown.wait(8.0)
    assert len(said(flown)) == 1


def test_an_autopilot_that_was_started_anew_is_read_again(flown: Bench) -> None:
    flown.connect()
    flown.wait(20.0)
    flown.autopilot.silent = True
    flown.wait(6.0)
    flown.autopilot.silent = False
    flown.autopilot.parameters["FS_GCS_ENABLE"] = 0.0  # type: ignore[attr-defined]
    flown.wait(20.0)
    assert [text for text, _fits in said(flown)] == [
        "guard, parameters and firmware fit",
        "FS_GCS_ENABLE is 0: nothing brings the aircraft home if companion and guard both fail",
    ]


def test_a_mission_with_a_geofence_is_a_reason_to_look_again(flown: Bench, delivery: MissionPackage) -> None:
    flown.autopilot.parameters["FENCE_ENABLE"] = 0.0
    flown.connect()
    flown.run(20.0)
    assert said(flown) == [("guard, parameters and firmware fit", True)]
    flown.share(delivery)
    flown.run(8.0)
    assert said(flown)[1:] == [("FENCE_ENABLE is 0: the plan's geofence is stored, and not kept to", False)]
    flown.autopilot.parameters["FENCE_ENABLE"] = 1.0
    flown.run(40.0)
    assert said(flown)[2:] == [("guard, parameters and firmware fit", True)]


# ---- wings --------------------------------------------------------------------------------------------------------

#: an ArduPlane 4.7 that hovers too, whose returns land by rotors
GOOD_PLANE = {
    **{name: value for name, value in GOOD.items() if name.startswith(("SCR_", "HNDO_", "BATT_", "FENCE_", "RALLY_"))},
    "FS_GCS_ENABL": 1.0,
    "FS_LONG_TIMEOUT": 10.0,
    "FS_LONG_ACTN": 1.0,
    "FS_SHORT_ACTN": 0.0,
    "THR_FAILSAFE": 1.0,
    "RC_PROTOCOLS": 1.0,
    "MAV_OPTIONS": 0.0,
    "ARMING_SKIPCHK": 0.0,
    "ARMING_REQUIRE": 1.0,
    "BATT_FS_LOW_ACT": 1.0,
    "BATT_FS_CRT_ACT": 4.0,
    "RTL_ALTITUDE": 80.0,
    "RTL_AUTOLAND": 0.0,
    "Q_ENABLE": 1.0,
    "Q_RTL_MODE": 1.0,
    "MIS_RESTART": 0.0,
    "WP_LOITER_RAD": 60.0,
    "RTL_RADIUS": 0.0,
    "FLIGHT_OPTIONS": 0.0,
    "TERRAIN_FOLLOW": 0.0,
    "Q_OPTIONS": 32.0,
    "Q_MAV_TYPE": 0.0,
}
FLAT = PlanFacts(fence=True, inclusions=1, farthest_m=800.0, highest_m=60.0)
WITH_LANDING = PlanFacts(fence=True, inclusions=1, farthest_m=800.0, highest_m=60.0, lands=True)


def on_wings(kind: Profile = QUADPLANE, plan: PlanFacts | None = FLAT, **changes: float) -> list[str]:
    parameters = {**GOOD_PLANE, **changes}
    return [each.text for each in judge(Found(parameters, GuardState.LIVE, (4, 7), plan=plan, profile=kind), Limits())]


def test_a_plane_as_recommended_fits() -> None:
    assert on_wings() == []
    assert on_wings(PLANE, WITH_LANDING, RTL_AUTOLAND=1.0) == []


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"ARMING_REQUIRE": 0.0},
            "ARMING_REQUIRE is 0: it is always armed and takes off by a change of mode; the guard cannot refuse arming",
        ),
        (
            {"FS_GCS_ENABL": 0.0},
            "FS_GCS_ENABL is 0: nothing brings the aircraft home if companion and guard both fail",
        ),
        (
            {"FS_GCS_ENABL": 3.0},
            "FS_GCS_ENABL is 3: it acts only in AUTO, and nothing brings the aircraft home from LOITER or GUIDED",
        ),
        (
            {"FS_LONG_TIMEOUT": 5.0},
            "FS_LONG_TIMEOUT is 5 s: the autopilot returns before a partner can take over (7 s)",
        ),
        (
            {"FS_LONG_ACTN": 0.0},
            "FS_LONG_ACTN is 0: the failsafes let a mission go on without radio and ground station",
        ),
        ({"FS_LONG_ACTN": 2.0}, "FS_LONG_ACTN is 2: glides without a motor, wherever it is"),
        ({"FS_SHORT_ACTN": 2.0}, "FS_SHORT_ACTN is 2: glides without a motor, wherever it is"),
        (
            {"THR_FAILSAFE": 0.0},
            "THR_FAILSAFE is 0: the guard believes no pilot then; on a vehicle without radio control set RC_PROTOCOLS "
            "0 as well",
        ),
        ({"FENCE_ACTION": 2.0}, "FENCE_ACTION is 2: ArduPlane knows no such action: nothing is done"),
        (
            {"BATT_FS_CRT_ACT": 7.0},
            "BATT_FS_CRT_ACT is 7: AUTOLAND lands at home, not at the return site",
        ),
        ({"BATT_FS_LOW_ACT": 3.0}, "BATT_FS_LOW_ACT is 3: stops the motors in the air"),
        (
            {"RTL_ALTITUDE": 120.0, "FENCE_TYPE": 5.0},
            "RTL_ALTITUDE is 120 m, above FENCE_ALT_MAX: a return is flown at 100 m",
        ),
        (
            {"RTL_CLIMB_MIN": 50.0, "FENCE_TYPE": 5.0},
            "RTL_CLIMB_MIN is 50 m: a return from the route's 60 m climbs above FENCE_ALT_MAX first, 100 m",
        ),
        (
            {"Q_RTL_ALT": 15.0, "FENCE_TYPE": 5.0},
            "Q_RTL_ALT is 15 m: QRTL from afar comes in at 145 m, above FENCE_ALT_MAX, 100 m",
        ),
        ({"MIS_RESTART": 1.0}, "MIS_RESTART is 1: CONTINUE, and AUTO after a return, begin the mission again"),
        ({"RALLY_LIMIT_KM": 5.0}, "RALLY_LIMIT_KM is 5: a return goes home if the return site is farther away"),
        (
            {"FLIGHT_OPTIONS": 17.0},
            "FLIGHT_OPTIONS is 17: bit 4 has a return climb straight on to its whole height, whatever RTL_CLIMB_MIN is",
        ),
        *(
            (
                {"TERRAIN_FOLLOW": float(bits)},
                f"TERRAIN_FOLLOW is {bits}: a return keeps a height above the ground, not the one above home that is "
                "judged",
            )
            for bits in (1, 16, 512)
        ),
        (
            {"Q_OPTIONS": 0.0},
            "Q_OPTIONS is 0: without bit 5 the failsafes land it out of hover where it is, not at the return site",
        ),
        *(
            (
                {"Q_OPTIONS": float(options)},
                f"Q_OPTIONS is {options}: bits 1 and 2 make a plane's of take-off and landing; the mission was "
                "checked with those of a QuadPlane",
            )
            for options in (34, 36)
        ),
        *(
            (
                {"Q_MAV_TYPE": float(kind)},
                f"Q_MAV_TYPE is {kind}: its modes are taken for those of another aircraft; START is refused",
            )
            for kind in (2, 10)
        ),
        (
            {"Q_RTL_MODE": 0.0},
            "a return does not land: it would circle for ever: the mission has no landing sequence (DO_LAND_START), "
            "and Q_RTL_MODE is 0; START is refused",
        ),
    ],
)
def test_what_does_not_fit_a_plane_is_said(changes: dict[str, float], text: str) -> None:
    assert text in on_wings(**changes)


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        (QUADPLANE, {"RTL_CLIMB_MIN": 40.0, "FENCE_TYPE": 5.0}),
        (QUADPLANE, {"RTL_CLIMB_MIN": 50.0, "FENCE_TYPE": 4.0}),
        (QUADPLANE, {"Q_RTL_ALT": 60.0, "FENCE_TYPE": 5.0}),
        (QUADPLANE, {"Q_RTL_ALT": 15.0, "FENCE_TYPE": 4.0}),
        (PLANE, {"Q_RTL_ALT": 15.0, "FENCE_TYPE": 5.0, "RTL_AUTOLAND": 1.0}),
        (QUADPLANE, {"FLIGHT_OPTIONS": 15.0, "TERRAIN_FOLLOW": 14.0, "Q_MAV_TYPE": 1.0}),
        (QUADPLANE, {"Q_OPTIONS": float(1 << 20)}),  # they return on its wings
        (PLANE, {"Q_OPTIONS": 6.0, "RTL_AUTOLAND": 1.0}),
    ],
)
def test_a_return_that_stays_below_the_ceiling_fits(kind: Profile, changes: dict[str, float]) -> None:
    assert on_wings(kind, WITH_LANDING, **changes) == []


def test_what_says_that_it_is_a_copter_and_has_that_parameter_is_none() -> None:
    (finding,) = judge(found(Q_MAV_TYPE=2.0), Limits())
    assert finding.text.startswith("Q_MAV_TYPE is 2: ")


def test_the_parameter_file_for_wings_that_ships_fits() -> None:
    lines = [line.split() for line in PLANE_FILE.read_text().splitlines() if line and not line.startswith("#")]
    shipped = {name: float(value) for name, value in lines if name in PLANE.reads}
    assert len(shipped) >= 14
    assert on_wings(**shipped) == []
    assert on_wings(PLANE, WITH_LANDING, **shipped) == []


def test_a_copters_rules_do_not_judge_a_plane() -> None:
    assert on_wings(FS_OPTIONS=2.0, RTL_ALT_FINAL=300.0, FS_THR_ENABLE=0.0, FS_GCS_ENABLE=0.0) == []
    assert [each.text for each in judge(found(ARMING_REQUIRE=0.0, FS_LONG_ACTN=0.0, MIS_RESTART=1.0), Limits())] == []


@pytest.mark.parametrize(
    ("kind", "plan", "changes", "lacks"),
    [
        (COPTER, FLAT, {}, ""),
        (PLANE, None, {}, ""),
        (PLANE, WITH_LANDING, {"RTL_AUTOLAND": 1.0}, ""),
        (PLANE, WITH_LANDING, {"RTL_AUTOLAND": 2.0}, ""),
        (PLANE, WITH_LANDING, {"RTL_AUTOLAND": 0.0}, "it would circle for ever: RTL_AUTOLAND is not 1"),
        (PLANE, WITH_LANDING, {"RTL_AUTOLAND": 3.0}, "it would circle for ever: RTL_AUTOLAND is not 1"),
        (
            PLANE,
            FLAT,
            {"RTL_AUTOLAND": 1.0, "Q_RTL_MODE": 1.0},
            "it would circle for ever: the mission has no landing sequence (DO_LAND_START)",
        ),
        *((QUADPLANE, FLAT, {"Q_RTL_MODE": mode}, "") for mode in (1.0, 2.0, 3.0)),
        (QUADPLANE, WITH_LANDING, {"RTL_AUTOLAND": 1.0}, ""),
        (
            QUADPLANE,
            WITH_LANDING,
            {},
            "it would circle for ever: RTL_AUTOLAND is not 1, and Q_RTL_MODE is 0",
        ),
        (PLANE, WITH_LANDING, None, "its parameters are not read yet"),
        *(
            (
                kind,
                PlanFacts(fence=True, inclusions=1, farthest_m=800.0, highest_m=60.0, aloft=12),
                {"RTL_AUTOLAND": 1.0, "Q_RTL_MODE": 1.0},
                "it would never land: the landing sequence of item 12 (DO_LAND_START) comes to no landing",
            )
            for kind in (PLANE, QUADPLANE)
        ),
    ],
)
def test_a_return_ends_in_a_landing_or_it_lacks_something(
    kind: Profile, plan: PlanFacts | None, changes: dict[str, float] | None, lacks: str
) -> None:
    assert circles_for_ever(changes, plan, kind) == lacks

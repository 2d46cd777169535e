# SPDX-License-Identifier: GPL-3.0-or-later

"""The firmware that is flown here: numbers of modes, words, and what an aircraft says that it is."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ModeSourceSeen
from mavproxy_handover.core.common.model import ModeClass, ModeSource
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, PROFILES, QUADPLANE, Profile
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.frames import parse_one

#: ArduPlane's mode.h
PLANE_MODES = {
    0: ("MANUAL", ModeClass.HANDS),
    1: ("CIRCLE", ModeClass.STOP),
    2: ("STABILIZE", ModeClass.HANDS),
    3: ("TRAINING", ModeClass.HANDS),
    4: ("ACRO", ModeClass.HANDS),
    5: ("FBWA", ModeClass.HANDS),
    6: ("FBWB", ModeClass.HANDS),
    7: ("CRUISE", ModeClass.HANDS),
    8: ("AUTOTUNE", ModeClass.HANDS),
    9: ("mode 9", ModeClass.OTHER),
    10: ("AUTO", ModeClass.MISSION),
    11: ("RTL", ModeClass.RETURN),
    12: ("LOITER", ModeClass.STOP),
    13: ("TAKEOFF", ModeClass.OTHER),
    14: ("AVOID_ADSB", ModeClass.OTHER),
    15: ("GUIDED", ModeClass.GUIDED),
    16: ("INITIALISING", ModeClass.OTHER),
    17: ("QSTABILIZE", ModeClass.HANDS),
    18: ("QHOVER", ModeClass.HANDS),
    19: ("QLOITER", ModeClass.HANDS),
    20: ("QLAND", ModeClass.LAND),
    21: ("QRTL", ModeClass.RETURN),
    22: ("QAUTOTUNE", ModeClass.HANDS),
    23: ("QACRO", ModeClass.HANDS),
    24: ("THERMAL", ModeClass.OTHER),
    25: ("LOITER_ALT_QLAND", ModeClass.LAND),
    26: ("AUTOLAND", ModeClass.LAND),
    27: ("mode 27", ModeClass.OTHER),
}
COPTER_FLOWN = {
    3: ModeClass.MISSION,
    4: ModeClass.GUIDED,
    5: ModeClass.HANDS,
    6: ModeClass.RETURN,
    7: ModeClass.OTHER,
    9: ModeClass.LAND,
    10: ModeClass.OTHER,
    17: ModeClass.STOP,
    20: ModeClass.GUIDED,
    21: ModeClass.RETURN,
    27: ModeClass.RETURN,
    28: ModeClass.HANDS,
}


def test_every_mode_of_arduplane_has_its_name_and_what_it_does() -> None:
    assert {number: (PLANE.mode_name(number), PLANE.flown(number)) for number in PLANE_MODES} == PLANE_MODES


def test_the_same_number_is_another_mode_for_a_copter() -> None:
    assert {number: COPTER.flown(number) for number in COPTER_FLOWN} == COPTER_FLOWN
    assert (COPTER.mode_name(6), PLANE.mode_name(6)) == ("RTL", "FBWB")


def test_the_names_are_those_of_the_dialect() -> None:
    found = {entry.name.removeprefix("COPTER_MODE_"): n for n, entry in mavlink.enums["COPTER_MODE"].items()}
    assert {mode.name: number for number, mode in COPTER.modes.items()}.items() <= found.items()
    written = {"FBWA": "FLY_BY_WIRE_A", "FBWB": "FLY_BY_WIRE_B"}
    known = {entry.name.removeprefix("PLANE_MODE_"): n for n, entry in mavlink.enums["PLANE_MODE"].items()}
    ours = {written.get(mode.name, mode.name): number for number, mode in PLANE.modes.items()}
    newer = {"LOITER_ALT_QLAND", "AUTOLAND", "INITIALISING"} - known.keys()
    assert {name: number for name, number in ours.items() if name not in newer}.items() <= known.items()


@pytest.mark.parametrize("profile", PROFILES, ids=[profile.name for profile in PROFILES])
def test_the_modes_by_role_do_what_their_role_says(profile: Profile) -> None:
    assert profile.flown(profile.auto) is ModeClass.MISSION
    assert profile.flown(profile.guided) is ModeClass.GUIDED
    assert profile.flown(profile.back) is ModeClass.RETURN
    assert profile.flown(profile.land) is ModeClass.LAND
    assert profile.back in profile.to_place
    assert {profile.flown(mode) for mode in profile.to_place} == {ModeClass.RETURN}


# ---- what it says of itself ---------------------------------------------------------------------------------------


def told(kind: int, vtol_state: int = 0, **parameters: float) -> VehicleState:
    """An aircraft that has said this of itself, in flight at 20 m/s."""
    aircraft = VehicleState()
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(kind, 3, 128, 10, 4, 3), 1.0)
    aircraft.on_message(mavlink.MAVLink_extended_sys_state_message(vtol_state, 2), 1.0)
    aircraft.on_message(mavlink.MAVLink_global_position_int_message(0, 526790000, 59240000, 0, 0, 2000, 0, 0, 0), 1.0)
    for name, value in parameters.items():
        aircraft.on_message(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 900, 0), 1.0)
    return aircraft


def twice(kind: int, vtol_state: int) -> VehicleState:
    """The same, and one heartbeat more: ArduPlane with Q_MAV_TYPE set calls itself what that says, and still tells
    when it flies on its wings. The fault: a return was ordered by a copter's number, FBWB."""
    aircraft = told(kind, vtol_state)
    for at in (2.0, 3.0):
        aircraft.on_message(mavlink.MAVLink_heartbeat_message(kind, 3, 128, 11, 4, 3), at)
    assert (aircraft.foreign, aircraft.flown) == ("", ModeClass.RETURN)
    return aircraft


def called_otherwise() -> VehicleState:
    """It hovers, and Q_MAV_TYPE is set in the air."""
    aircraft = told(mavlink.MAV_TYPE_FIXED_WING, 3)
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, 3, 128, 11, 4, 3), 2.0)
    assert (aircraft.foreign, aircraft.flown) == ("", ModeClass.RETURN)
    return aircraft


@pytest.mark.parametrize(
    ("aircraft", "kind"),
    [
        (told(mavlink.MAV_TYPE_QUADROTOR), COPTER),
        (told(mavlink.MAV_TYPE_HELICOPTER, 3, Q_ENABLE=1.0), COPTER),
        (told(mavlink.MAV_TYPE_FIXED_WING), PLANE),
        (told(mavlink.MAV_TYPE_FIXED_WING, Q_ENABLE=0.0), PLANE),
        (told(mavlink.MAV_TYPE_FIXED_WING, Q_ENABLE=1.0), QUADPLANE),
        (told(mavlink.MAV_TYPE_FIXED_WING, 4), QUADPLANE),
        (told(21, 3), QUADPLANE),
        (twice(mavlink.MAV_TYPE_QUADROTOR, 4), QUADPLANE),
        (twice(mavlink.MAV_TYPE_GROUND_ROVER, 1), QUADPLANE),
        (called_otherwise(), QUADPLANE),
        (told(mavlink.MAV_TYPE_QUADROTOR, 3), COPTER),
        (told(mavlink.MAV_TYPE_GROUND_ROVER), COPTER),
    ],
    ids=[
        "copter",
        "heli",
        "plane",
        "no rotors",
        "rotors",
        "says so",
        "tiltrotor",
        "called copter",
        "called rover",
        "called copter in the air",
        "hovers as copters do",
        "rover",
    ],
)
def test_a_plane_hovers_too_where_it_says_so(aircraft: VehicleState, kind: Profile) -> None:
    """ArduPlane's MAV_TYPE is FIXED_WING with rotors and without, unless Q_MAV_TYPE says otherwise."""
    assert aircraft.profile is kind


@pytest.mark.parametrize(
    ("aircraft", "circles_s", "circle_m"),
    [
        (told(mavlink.MAV_TYPE_QUADROTOR, WP_LOITER_RAD=80.0), 0.0, 0.0),
        (told(mavlink.MAV_TYPE_FIXED_WING), 6.5, 60.0),
        (told(mavlink.MAV_TYPE_FIXED_WING, WP_LOITER_RAD=-80.0), 8.0, 80.0),
        (told(mavlink.MAV_TYPE_FIXED_WING, WP_LOITER_RAD=0.0), 6.5, 60.0),
        (told(mavlink.MAV_TYPE_FIXED_WING, WP_LOITER_RAD=80.0, RTL_RADIUS=-120.0), 8.0, 120.0),
        (told(mavlink.MAV_TYPE_FIXED_WING, 4), 6.5, 60.0),
        (told(mavlink.MAV_TYPE_FIXED_WING, 3), 0.0, 0.0),
        (told(mavlink.MAV_TYPE_FIXED_WING, 2), 0.0, 0.0),
    ],
    ids=["copter", "default", "left turns", "zero", "return's own", "forwards", "hovers", "slows down to hover"],
)
def test_what_flies_on_wings_needs_room_for_a_circle(aircraft: VehicleState, circles_s: float, circle_m: float) -> None:
    """Two seconds and one and a half radii, at 20 m/s; the circle of ArduPlane is 60 m if it says nothing."""
    assert aircraft.circles_s == pytest.approx(circles_s)
    assert aircraft.return_circle_m == circle_m


def test_what_stands_on_its_wheels_does_not_need_for_ever_to_circle() -> None:
    aircraft = VehicleState()
    aircraft.on_message(mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3), 1.0)
    assert aircraft.circles_s == pytest.approx(20.0)


# ---- who may have chosen a mode -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "acts"),
    [
        ("GCS Failsafe On: RTL", True),
        ("RC Long Failsafe On: RTL", True),
        ("RC Short Failsafe: switched to CIRCLE", True),
        ("RC Short Failsafe On", True),
        ("Failsafe. Long event on: type=1/reason=5", True),
        ("Failsafe. Short event on: type=2/reason=3", True),
        ("Throttle failsafe on", True),
        ("Battery 1 is low 10.40V used 1200 mAh", True),
        ("Battery 2 is critical 9.90V used 3000 mAh", True),
        ("Polygon fence breached", True),
        ("EKF variance", True),
        ("Aircraft in auto without a running mission", True),
        ("Failed to complete takeoff within time limit", True),
        ("Transition failed, exceeded time limit", True),
        ("GCS Failsafe Off", False),
        ("Failsafe. Long event off: reason=5", False),
        ("RC Long Failsafe Cleared", False),
        ("Short Failsafe Cleared", False),
        ("Throttle failsafe off", False),
        ("Fence breach cleared", False),
        ("Transition done", False),
        ("Reached waypoint #3 dist 12m", False),
        ("Handover: GCS Failsafe", False),
    ],
)
def test_arduplane_says_what_it_does_by_itself(text: str, acts: bool) -> None:
    assert mode_requests.of_text(text, PLANE) == (ModeSourceSeen(ModeSource.FAILSAFE) if acts else None)


@pytest.mark.parametrize(
    ("text", "hand"),
    [
        ("Mission complete, changing mode to RTL", ModeSourceSeen(ModeSource.MISSION)),
        ("Mission: 9 RTL", ModeSourceSeen(ModeSource.MISSION)),
        ("Mission: 9 RTLx", None),
        ("Mission: 9 WP", None),
        # CIRCLE or FBWA of a short radio failsafe is over
        ("Flight mode AUTO restored", ModeSourceSeen(ModeSource.FAILSAFE, ModeClass.MISSION)),
        ("Flight mode GUIDED restored", ModeSourceSeen(ModeSource.FAILSAFE, ModeClass.GUIDED)),
        ("Flight mode FLY_BY_WIRE_A restored", None),
    ],
)
def test_arduplane_says_how_its_mission_ends_and_what_a_failsafe_gives_back(
    text: str, hand: ModeSourceSeen | None
) -> None:
    assert mode_requests.of_text(text, PLANE) == hand


def test_a_copters_words_are_read_as_before() -> None:
    assert mode_requests.of_text("GCS Failsafe") == ModeSourceSeen(ModeSource.FAILSAFE)
    assert mode_requests.of_text("GCS Failsafe Cleared") is None
    assert mode_requests.of_text("Battery 1 is low 10.40V used 1200 mAh", COPTER) is None


@pytest.mark.parametrize(("pauses", "flown"), [(0.0, ModeClass.STOP), (1.0, ModeClass.MISSION)])
def test_a_commanders_stop_is_told_from_his_going_on(pauses: float, flown: ModeClass) -> None:
    command = mavlink.MAVLink_command_long_message(1, 1, 193, 0, pauses, 0, 0, 0, 0, 0, 0)
    raw = bytes(command.pack(mavlink.MAVLink(None, srcSystem=251, srcComponent=190)))
    frame = parse_one(raw)
    assert frame is not None
    assert mode_requests.of_command(frame) == ModeSourceSeen(ModeSource.COMMANDER, flown)

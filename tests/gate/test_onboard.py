# SPDX-License-Identifier: GPL-3.0-or-later

"""Every message and every command from onboard programs, with every set of rights, against a second book-keeping."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.onboard import OnboardFilters, OnboardMatters, OnboardRights, judge_onboard
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.onboard import SENSORS, Right
from mavproxy_handover.vehicle.profiles import COPTER
from mavproxy_handover.wire.frames import Frame
from tests.gate.frames import IDS
from tests.gate.ledger import CASES

VEHICLE, COMPONENT = 1, 195
ALL = frozenset(Right)
SOME_SENSORS = frozenset(("LANDING_TARGET", "ODOMETRY"))

#: the second book-keeping, written out: what each right lets pass
GUIDED = {"SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"}
READS = {"PING", "TIMESYNC", "PARAM_REQUEST_READ", "AUTOPILOT_VERSION_REQUEST"}
READ_COMMANDS = {
    "REQUEST_MESSAGE", "REQUEST_PROTOCOL_VERSION", "REQUEST_AUTOPILOT_CAPABILITIES", "REQUEST_CAMERA_INFORMATION",
    "REQUEST_CAMERA_SETTINGS", "REQUEST_STORAGE_INFORMATION", "REQUEST_CAMERA_CAPTURE_STATUS",
    "REQUEST_FLIGHT_INFORMATION", "REQUEST_VIDEO_STREAM_INFORMATION", "REQUEST_VIDEO_STREAM_STATUS",
    "GET_HOME_POSITION",
}  # fmt: skip
PAYLOAD = {
    "GIMBAL_MANAGER_SET_ATTITUDE", "GIMBAL_MANAGER_SET_PITCHYAW", "GIMBAL_MANAGER_SET_MANUAL_CONTROL",
    "GIMBAL_DEVICE_SET_ATTITUDE", "DIGICAM_CONFIGURE", "DIGICAM_CONTROL", "GOPRO_SET_REQUEST",
}  # fmt: skip
PAYLOAD_COMMANDS = {
    "DO_DIGICAM_CONFIGURE", "DO_DIGICAM_CONTROL", "DO_CONTROL_VIDEO", "DO_SET_CAM_TRIGG_DIST",
    "DO_SET_CAM_TRIGG_INTERVAL", "DO_TRIGGER_CONTROL", "RESET_CAMERA_SETTINGS", "SET_CAMERA_MODE", "SET_CAMERA_ZOOM",
    "SET_CAMERA_FOCUS", "SET_CAMERA_SOURCE", "SET_STORAGE_USAGE", "IMAGE_START_CAPTURE", "IMAGE_STOP_CAPTURE",
    "REQUEST_CAMERA_IMAGE_CAPTURE", "VIDEO_START_CAPTURE", "VIDEO_STOP_CAPTURE", "VIDEO_START_STREAMING",
    "VIDEO_STOP_STREAMING", "DO_GIMBAL_MANAGER_PITCHYAW", "DO_GIMBAL_MANAGER_CONFIGURE", "DO_WINCH", "DO_GRIPPER",
    "DO_SPRAYER", "ILLUMINATOR_ON_OFF", "DO_ILLUMINATOR_CONFIGURE",
}  # fmt: skip
#: what a payload manager tells the stations
SAYS = {
    "COMMAND_ACK", "PARAM_EXT_VALUE", "PARAM_EXT_ACK", "PARAM_ERROR", "CAMERA_INFORMATION", "CAMERA_SETTINGS",
    "CAMERA_CAPTURE_STATUS", "CAMERA_FOV_STATUS", "CAMERA_THERMAL_RANGE", "STORAGE_INFORMATION",
    "VIDEO_STREAM_INFORMATION", "VIDEO_STREAM_STATUS", "CAMERA_IMAGE_CAPTURED", "CAMERA_TRACKING_IMAGE_STATUS",
    "CAMERA_TRACKING_GEO_STATUS", "GIMBAL_MANAGER_INFORMATION", "GIMBAL_MANAGER_STATUS", "GIMBAL_DEVICE_INFORMATION",
    "GIMBAL_DEVICE_ATTITUDE_STATUS", "WINCH_STATUS",
}  # fmt: skip
COMMANDS = ("COMMAND_LONG", "COMMAND_INT")
COMMAND_NAMES = {number: entry.name.removeprefix("MAV_CMD_") for number, entry in mavlink.enums["MAV_CMD"].items()}
#: what no right may ever contain
NEVER = {
    "COMPONENT_ARM_DISARM", "DO_SET_MODE", "MISSION_START", "NAV_TAKEOFF", "DO_FLIGHTTERMINATION", "DO_REPOSITION",
    "REQUEST_OPERATOR_CONTROL", "DO_SET_SERVO", "DO_SET_RELAY", "DO_SET_ACTUATOR", "DO_MOTOR_TEST", "DO_PARACHUTE",
    "DO_SET_ROI", "DO_SET_ROI_LOCATION", "DO_MOUNT_CONTROL", "DO_SET_HOME", "DO_CHANGE_SPEED", "DO_AUX_FUNCTION",
    "SET_EKF_SOURCE_SET", "PREFLIGHT_REBOOT_SHUTDOWN", "DO_FENCE_ENABLE", "DO_SET_PARAMETER",
}  # fmt: skip


def program(rights: frozenset[Right], sensors: frozenset[str] = frozenset()) -> OnboardRights:
    return OnboardRights("mavros", COMPONENT, rights, sensors)


def may_pass(name: str, command: int | None, rights: frozenset[Right], sensors: frozenset[str]) -> bool:
    if name == "HEARTBEAT" or name in READS:
        return True
    if name in COMMANDS:
        word = COMMAND_NAMES.get(command or 0, "")
        return word in READ_COMMANDS or (Right.PAYLOAD in rights and word in PAYLOAD_COMMANDS)
    if name in SENSORS:
        return Right.SENSORS in rights and name in sensors
    if name in GUIDED:
        return Right.GUIDED in rights
    if name in SAYS:
        return Right.MANAGER in rights
    return Right.PAYLOAD in rights and name in PAYLOAD


SETS = [
    frozenset(right for right, on in zip(Right, each, strict=True) if on) for each in product((0, 1), repeat=len(Right))
]


@pytest.mark.parametrize("rights", SETS, ids=lambda rights: "+".join(sorted(r.value for r in rights)) or "none")
@pytest.mark.parametrize("sensors", [SOME_SENSORS, frozenset(SENSORS)], ids=["some", "all"])
def test_every_message_and_command_passes_by_its_right_or_not_at_all(
    make: Callable[..., Frame], rights: frozenset[Right], sensors: frozenset[str]
) -> None:
    compared = 0
    own = program(rights, sensors)
    for case in CASES:
        fields = dict(case.fields)
        for version in (1, 2):
            if version == 1 and not case.version1:
                continue
            frame = make(case.name, sysid=VEHICLE, compid=COMPONENT, version=version, **fields)
            verdict = judge_onboard(frame, own, VEHICLE)
            command = fields.get("command")
            passes = may_pass(case.name, command, rights, sensors)
            assert (verdict.fate is Fate.FORWARD) is passes, (case, rights, verdict)
            if passes:
                assert verdict.reason is GateReason.ALLOWED
            compared += 1
    for command, word in COMMAND_NAMES.items():
        for message in COMMANDS:
            frame = make(message, sysid=VEHICLE, compid=COMPONENT, command=command)
            passes = may_pass(message, command, rights, sensors)
            assert (judge_onboard(frame, own, VEHICLE).fate is Fate.FORWARD) is passes, word
            assert not (passes and word in NEVER), word
            compared += 1
    assert compared > 1500


def test_payload_reaches_no_flight_function_at_any_component(make: Callable[..., Frame]) -> None:
    """Every command and every component id, with all rights: what passes is a read or the payload's."""
    own = program(ALL, frozenset(SENSORS))
    payload_components = {0, 1, *range(100, 106), 154, *range(171, 176), 169}
    compared = 0
    for command, word in COMMAND_NAMES.items():
        for component in range(256):
            frame = make("COMMAND_LONG", sysid=VEHICLE, compid=COMPONENT, command=command, target_component=component)
            passes = judge_onboard(frame, own, VEHICLE).fate is Fate.FORWARD
            may = word in READ_COMMANDS or (word in PAYLOAD_COMMANDS and component in payload_components)
            assert passes is (may and component != 191), (word, component)
            compared += 1
    assert compared > 40_000


@pytest.mark.parametrize(
    ("sysid", "compid", "reason"),
    [
        (251, COMPONENT, GateReason.SPOOFED_STATION),
        (2, COMPONENT, GateReason.SPOOFED_STATION),
        (VEHICLE, 1, GateReason.COMPONENT),
        (VEHICLE, 191, GateReason.COMPONENT),
        (VEHICLE, 196, GateReason.COMPONENT),
    ],
)
def test_another_identity_passes_nothing(
    make: Callable[..., Frame], sysid: int, compid: int, reason: GateReason
) -> None:
    own = program(ALL, frozenset(SENSORS))
    for case in CASES:
        frame = make(case.name, sysid=sysid, compid=compid, **dict(case.fields))
        verdict = judge_onboard(frame, own, VEHICLE)
        assert (verdict.fate, verdict.reason) == (Fate.DROP, reason), case


def test_a_frame_for_another_system_or_for_the_companion_passes_not(make: Callable[..., Frame]) -> None:
    own = program(ALL, frozenset(SENSORS))
    for name in ("COMMAND_LONG", "SET_POSITION_TARGET_LOCAL_NED", "PARAM_REQUEST_READ", "PING"):
        other = make(name, sysid=VEHICLE, compid=COMPONENT, target_system=2)
        assert judge_onboard(other, own, VEHICLE).reason is GateReason.OTHER_TARGET
        companion = make(name, sysid=VEHICLE, compid=COMPONENT, target_component=191, **_of(name))
        assert judge_onboard(companion, own, VEHICLE).reason is GateReason.COMPANION_TARGET
    gimbal = make("SET_POSITION_TARGET_LOCAL_NED", sysid=VEHICLE, compid=COMPONENT, target_component=154)
    assert judge_onboard(gimbal, own, VEHICLE).fate is Fate.DROP


def _of(name: str) -> dict[str, int]:
    return {"command": mavlink.MAV_CMD_REQUEST_MESSAGE} if name == "COMMAND_LONG" else {}


class Matters:
    """The answers of the companion to the questions of the filters."""

    def __init__(self, has_room: Callable[[float, int], bool] = lambda _now, _size: True) -> None:
        self._has_room = has_room
        self.delegated = self.passes = self.payload = self.may_move_estimate = True
        self.asked: list[str] = []
        #: by the limit of a program: the verdict on its landing targets
        self.landing: dict[float, GateReason] = {}

    def matters(self) -> OnboardMatters:
        return OnboardMatters(
            lambda _name, _now: self.delegated,
            self._target,
            lambda _kind, _name: self.payload,
            lambda: COPTER.gate,
            self._has_room,
            lambda _frame, within_m, _now: self.landing.get(within_m, GateReason.ALLOWED),
            lambda: self.may_move_estimate,
        )

    def _target(self, _aim: object, name: str, _now: float) -> bool:
        self.asked.append(name)
        return self.passes


def filtered(filters: OnboardFilters, own: OnboardRights, frame: Frame, now: float) -> Verdict:
    return filters.limit(frame, judge_onboard(frame, own, VEHICLE), now)


def test_a_message_that_comes_too_often_is_dropped(make: Callable[..., Frame]) -> None:
    own = program(ALL, frozenset(SENSORS))
    filters = OnboardFilters(own, Matters().matters())
    frame = make("LANDING_TARGET", sysid=VEHICLE, compid=COMPONENT)
    found = [filtered(filters, own, frame, 100.0 + n * 0.002).reason for n in range(5000)]
    passed = found.count(GateReason.ALLOWED)
    assert 500 <= passed <= 515, "50 a second for 10 s, and 10 at once"
    assert found.count(GateReason.TOO_OFTEN) == 5000 - passed
    assert filtered(filters, own, make("ODOMETRY", sysid=VEHICLE, compid=COMPONENT), 110.0).fate is Fate.FORWARD


def test_landing_targets_are_judged_with_the_limit_of_their_program(make: Callable[..., Frame]) -> None:
    answers = Matters()
    answers.landing = {4.0: GateReason.LANDING_AWAY}
    sensors = frozenset(SENSORS)
    near, far = (OnboardRights("mavros", COMPONENT, ALL, sensors, landing_m=limit) for limit in (4.0, 5.0))
    frame = make("LANDING_TARGET", sysid=VEHICLE, compid=COMPONENT)
    verdict = filtered(OnboardFilters(near, answers.matters()), near, frame, 1.0)
    assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.LANDING_AWAY)
    assert filtered(OnboardFilters(far, answers.matters()), far, frame, 1.0).fate is Fate.FORWARD
    other = make("ODOMETRY", sysid=VEHICLE, compid=COMPONENT)
    assert filtered(OnboardFilters(near, answers.matters()), near, other, 1.0).fate is Fate.FORWARD


def test_positions_pass_while_the_estimate_agrees_with_the_receiver(make: Callable[..., Frame]) -> None:
    own, answers = program(ALL, frozenset(SENSORS)), Matters()
    filters = OnboardFilters(own, answers.matters())
    answers.may_move_estimate = False
    stopped = {
        name
        for name in SENSORS
        if filtered(filters, own, make(name, sysid=VEHICLE, compid=COMPONENT), 1.0)[::2]
        == (Fate.DROP, GateReason.ESTIMATE)
    }
    others = {"LANDING_TARGET", "OBSTACLE_DISTANCE", "OBSTACLE_DISTANCE_3D", "DISTANCE_SENSOR"}
    assert stopped == set(SENSORS) - others


def test_all_bytes_of_a_program_are_limited(make: Callable[..., Frame]) -> None:
    own = OnboardRights("mavros", COMPONENT, ALL, frozenset(SENSORS), 1000.0)
    filters = OnboardFilters(own, Matters().matters())
    frame = make("ODOMETRY", sysid=VEHICLE, compid=COMPONENT, x=1.0)
    passed = sum(
        len(frame.raw) for n in range(600) if filtered(filters, own, frame, 50.0 + n / 60).fate is Fate.FORWARD
    )
    assert passed <= 1000 * 10 + 1000


def test_targets_need_delegation_and_a_place_that_passes(make: Callable[..., Frame]) -> None:
    own, answers = program(ALL), Matters()
    filters = OnboardFilters(own, answers.matters())
    place = {"lat_int": 526790000, "lon_int": 59240000, "alt": 40.0, "coordinate_frame": 6, "type_mask": 0xFF8}
    frame = make("SET_POSITION_TARGET_GLOBAL_INT", sysid=VEHICLE, compid=COMPONENT, **place)
    answers.delegated = False
    verdict = filtered(filters, own, frame, 1.0)
    assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.NOT_DELEGATED)
    assert answers.asked == [], "what is not delegated costs no judgement"
    answers.delegated = True
    assert filtered(filters, own, frame, 1.2).fate is Fate.FORWARD
    assert answers.asked == ["mavros"]
    answers.passes = False
    verdict = filtered(filters, own, frame, 2.5)
    assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.SITUATION)
    nan = make("SET_POSITION_TARGET_GLOBAL_INT", sysid=VEHICLE, compid=COMPONENT, **{**place, "alt": float("nan")})
    assert filtered(filters, own, nan, 4.0).reason is GateReason.NO_NUMBER


def test_payload_commands_need_payload_authority(make: Callable[..., Frame]) -> None:
    own, answers = program(ALL), Matters()
    filters = OnboardFilters(own, answers.matters())
    command = make("COMMAND_LONG", sysid=VEHICLE, compid=COMPONENT, command=mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW)
    stream = make("GIMBAL_MANAGER_SET_PITCHYAW", sysid=VEHICLE, compid=COMPONENT)
    assert filtered(filters, own, command, 1.0).fate is Fate.FORWARD
    assert filtered(filters, own, stream, 1.0).fate is Fate.FORWARD
    answers.payload = False
    verdict = filtered(filters, own, command, 2.0)
    assert (verdict.fate, verdict.reason) == (Fate.REFUSE, GateReason.NOT_PAYLOADS)
    assert filtered(filters, own, stream, 2.0)[::2] == (Fate.DROP, GateReason.NOT_PAYLOADS)


def test_every_sensor_of_the_table_is_known_and_no_station_may_send_one() -> None:
    from mavproxy_handover.gate.policy.rows import MESSAGE_ROWS

    for name in SENSORS:
        assert MESSAGE_ROWS[IDS[name]].access is Access.NEVER, name

# SPDX-License-Identifier: GPL-3.0-or-later

"""Every message and every command, from every kind of sender, in every phase, against a second book-keeping.

The lists below are written out by hand and on purpose not taken from `gate/tables.py`: what the tables say and
what is expected here are two entries for the same thing, and a slip in one shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Action, GateReason, StationIdentity, Verdict, judge
from mavproxy_handover.wire.frames import Frame, FrameSplitter

VEHICLE = 1
GCSA, GCSB, GCSC = 251, 252, 253
TRACKER_OF_A, TRACKER_OF_B = 241, 242


def listed(text: str) -> list[str]:
    return text.split()


# --- what everybody may send, and it reaches the autopilot
PASS_MESSAGES = listed("""
    PING TIMESYNC PARAM_REQUEST_READ PARAM_REQUEST_LIST PARAM_EXT_REQUEST_READ PARAM_EXT_REQUEST_LIST
    MISSION_REQUEST_LIST MISSION_REQUEST MISSION_REQUEST_INT MISSION_REQUEST_PARTIAL_LIST MISSION_ACK
    FENCE_FETCH_POINT RALLY_FETCH_POINT AUTOPILOT_VERSION_REQUEST OSD_PARAM_SHOW_CONFIG GOPRO_GET_REQUEST
    UAVIONIX_ADSB_GET TERRAIN_CHECK LOGGING_ACK
""")
PASS_COMMANDS = [512, 510, 519, 520, 521, 522, 525, 527, 528, 2504, 2505, 410, 5200, 42428]
PASS_OPCODES = [0, 3, 4, 5, 14, 15, 16]

# --- the commander's alone; anyone else is told
TOLD_MESSAGES = listed("""
    SET_MODE PARAM_SET PARAM_EXT_SET PARAM_MAP_RC MISSION_COUNT MISSION_ITEM MISSION_ITEM_INT
    MISSION_WRITE_PARTIAL_LIST MISSION_CLEAR_ALL MISSION_SET_CURRENT FENCE_POINT RALLY_POINT
    SAFETY_SET_ALLOWED_AREA SET_HOME_POSITION SET_GPS_GLOBAL_ORIGIN SET_MAG_OFFSETS MOUNT_CONFIGURE
    DIGICAM_CONFIGURE DIGICAM_CONTROL GOPRO_SET_REQUEST LED_CONTROL PLAY_TUNE LOG_ERASE OSD_PARAM_CONFIG
    UAVIONIX_ADSB_OUT_CFG UAVIONIX_ADSB_OUT_CFG_REGISTRATION UAVIONIX_ADSB_OUT_CFG_FLIGHTID
    UAVIONIX_ADSB_OUT_CONTROL CHANGE_OPERATOR_CONTROL AUTH_KEY
""")
TOLD_OPCODES = [1, 2, 6, 7, 8, 9, 10, 11, 12, 13]

# --- the commander's alone; anyone else's vanish in silence
SILENT_MESSAGES = listed("""
    RC_CHANNELS_OVERRIDE MANUAL_CONTROL MANUAL_SETPOINT SET_POSITION_TARGET_LOCAL_NED
    SET_POSITION_TARGET_GLOBAL_INT SET_ATTITUDE_TARGET SET_ACTUATOR_CONTROL_TARGET FOLLOW_TARGET
    GIMBAL_MANAGER_SET_ATTITUDE GIMBAL_MANAGER_SET_PITCHYAW GIMBAL_MANAGER_SET_MANUAL_CONTROL
    GIMBAL_DEVICE_SET_ATTITUDE GIMBAL_CONTROL MOUNT_CONTROL GPS_RTCM_DATA GPS_INJECT_DATA TERRAIN_DATA
    OPEN_DRONE_ID_BASIC_ID OPEN_DRONE_ID_LOCATION OPEN_DRONE_ID_AUTHENTICATION OPEN_DRONE_ID_SELF_ID
    OPEN_DRONE_ID_SYSTEM OPEN_DRONE_ID_OPERATOR_ID OPEN_DRONE_ID_MESSAGE_PACK OPEN_DRONE_ID_SYSTEM_UPDATE
    UAVIONIX_ADSB_OUT_DYNAMIC
""")

# --- the commander's alone, because they load a channel that all share
RATE_MESSAGES = ["REQUEST_DATA_STREAM", "LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END"]
RATE_COMMANDS = [511]

# --- from everybody, for the companion itself
COMPANION_MESSAGES = listed("""
    CONNECT CONNECT_ACK MISSION_PACKAGE MISSION_CHUNK MISSION_PACKAGE_ACK ON_HANDOVER OK_HANDOVER
    DRONE_CONNECTED DISCONNECT_HANDOVER
""")
COMPANION_COMMANDS = [32100]

# --- from nobody, over no radio link
MAINTENANCE_MESSAGES = listed("""
    SETUP_SIGNING SECURE_COMMAND SERIAL_CONTROL DEVICE_OP_READ DEVICE_OP_WRITE CAN_FRAME CANFD_FRAME
    CAN_FILTER_MODIFY V2_EXTENSION HIL_STATE HIL_CONTROLS HIL_RC_INPUTS_RAW HIL_ACTUATOR_CONTROLS HIL_SENSOR
    HIL_GPS HIL_OPTICAL_FLOW HIL_STATE_QUATERNION REMOTE_LOG_BLOCK_STATUS CUBEPILOT_FIRMWARE_UPDATE_START
    WIFI_CONFIG_AP
""")
#: FLASH_BOOTLOADER, DEBUG_TRAP, SET_FACTORY_TEST_MODE, CAN_FORWARD, START_RX_PAIR, STORAGE_FORMAT, SCRIPTING,
#: INJECT_FAILURE
MAINTENANCE_COMMANDS = [42650, 42700, 42427, 32000, 500, 526, 42701, 420]

# Every other message is dropped; every other command of the dialect is the commander's alone; every other opcode
# but 128 and 129 (a server's answers, dropped) is refused as unknown.

ALL_COMMANDS = sorted(n for n, e in mavlink.enums["MAV_CMD"].items() if e.name != "MAV_CMD_ENUM_END")

PASS, TOLD, SILENT, RATE = "pass", "told", "silent", "rate"
COMPANION, MAINTENANCE, NEVER, LIVENESS, UNKNOWN, START = (
    "companion",
    "maintenance",
    "never",
    "liveness",
    "unknown",
    "start",
)

#: kind -> (what the commander's becomes, what anyone else's becomes)
OUTCOMES = {
    PASS: ((Action.FORWARD, GateReason.ALLOWED), (Action.FORWARD, GateReason.ALLOWED)),
    TOLD: ((Action.FORWARD, GateReason.ALLOWED), (Action.REFUSE, GateReason.NOT_IN_CONTROL)),
    START: ((Action.FORWARD, GateReason.ALLOWED), (Action.REFUSE, GateReason.NOT_IN_CONTROL)),
    SILENT: ((Action.FORWARD, GateReason.ALLOWED), (Action.DROP, GateReason.NOT_IN_CONTROL)),
    RATE: ((Action.FORWARD, GateReason.ALLOWED), (Action.REFUSE, GateReason.RATES_OF_COMMANDER)),
    LIVENESS: ((Action.FORWARD, GateReason.ALLOWED), (Action.CONSUME, GateReason.LIVENESS_NOT_COMMANDER)),
    COMPANION: ((Action.CONSUME, GateReason.COMPANION), (Action.CONSUME, GateReason.COMPANION)),
    MAINTENANCE: ((Action.REFUSE, GateReason.MAINTENANCE_ONLY), (Action.REFUSE, GateReason.MAINTENANCE_ONLY)),
    NEVER: ((Action.DROP, GateReason.NEVER), (Action.DROP, GateReason.NEVER)),
    UNKNOWN: ((Action.REFUSE, GateReason.UNKNOWN_COMMAND), (Action.REFUSE, GateReason.UNKNOWN_COMMAND)),
}


def kind_of_message(name: str) -> str:
    lists = [
        (PASS, PASS_MESSAGES),
        (TOLD, TOLD_MESSAGES),
        (SILENT, SILENT_MESSAGES),
        (RATE, RATE_MESSAGES),
        (COMPANION, COMPANION_MESSAGES),
        (MAINTENANCE, MAINTENANCE_MESSAGES),
        (LIVENESS, ["HEARTBEAT"]),
    ]
    found = [kind for kind, listed in lists if name in listed]
    assert len(found) <= 1, name
    return found[0] if found else NEVER


def kind_of_command(number: int) -> str:
    if number in PASS_COMMANDS:
        return PASS
    if number in RATE_COMMANDS:
        return RATE
    if number in COMPANION_COMMANDS:
        return COMPANION
    if number in MAINTENANCE_COMMANDS:
        return MAINTENANCE
    if number == 300:
        return START
    return TOLD if number in ALL_COMMANDS else UNKNOWN


def kind_of_opcode(number: int) -> str:
    if number in PASS_OPCODES:
        return PASS
    if number in TOLD_OPCODES:
        return TOLD
    return NEVER if number in (128, 129) else UNKNOWN


@dataclass(frozen=True)
class Case:
    name: str
    kind: str
    fields: tuple[tuple[str, object], ...] = ()


BY_PART = ["COMMAND_LONG", "COMMAND_INT", "COMMAND_ACK", "FILE_TRANSFER_PROTOCOL", "TUNNEL"]


def cases() -> Iterator[Case]:
    for cls in mavlink.mavlink_map.values():
        if cls.msgname not in BY_PART:
            yield Case(cls.msgname, kind_of_message(cls.msgname))
    for command in [*ALL_COMMANDS, 0, 15, 40001, 65535]:
        yield Case("COMMAND_LONG", kind_of_command(command), (("command", command),))
        yield Case("COMMAND_INT", kind_of_command(command), (("command", command),))
        yield Case("COMMAND_ACK", COMPANION if command == 32100 else SILENT, (("command", command),))
    for opcode in range(256):
        payload = [0, 0, 0, opcode] + [0] * 247
        yield Case("FILE_TRANSFER_PROTOCOL", kind_of_opcode(opcode), (("payload", payload),))
    for payload_type in (47116, 47117):
        yield Case("TUNNEL", NEVER, (("payload_type", payload_type),))
    for payload_type in (0, 1, 200, 47115, 47118, 65535):
        yield Case("TUNNEL", MAINTENANCE, (("payload_type", payload_type),))


CASES = list(cases())

#: Phase by phase: who commands, and who is about to.
VIEWS = [
    AuthorityView(Phase.ON_LOAD, None, None, 0, LeaseState.LOST),
    AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD),
    AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD),
    AuthorityView(Phase.ON_HANDOVER, GCSA, GCSB, 1, LeaseState.TRANSFER),
    AuthorityView(Phase.ON_HANDOVER, GCSB, GCSA, 2, LeaseState.TRANSFER),
    AuthorityView(Phase.EMERGENCY, GCSA, None, 2, LeaseState.HELD),
    AuthorityView(Phase.EMERGENCY, None, None, 2, LeaseState.LOST),
]

A = StationIdentity(GCSA, frozenset({GCSA, TRACKER_OF_A}))
B = StationIdentity(GCSB, frozenset({GCSB, TRACKER_OF_B}))
C = StationIdentity(GCSC)

#: (station whose link it comes by, system id in the frame, MAVLink version, what is wrong with the sender)
SENDERS = [
    (A, GCSA, 2, None),
    (A, GCSA, 1, None),
    (A, TRACKER_OF_A, 2, None),
    (B, GCSB, 2, None),
    (B, GCSB, 1, None),
    (C, GCSC, 2, None),
    (A, VEHICLE, 2, GateReason.SPOOFED_VEHICLE),
    (C, VEHICLE, 1, GateReason.SPOOFED_VEHICLE),
    (A, GCSB, 2, GateReason.SPOOFED_STATION),
    (B, GCSA, 2, GateReason.SPOOFED_STATION),
    (B, TRACKER_OF_A, 2, GateReason.SPOOFED_STATION),
    (C, 99, 2, GateReason.SPOOFED_STATION),
    (C, 0, 2, GateReason.SPOOFED_STATION),
    (C, 255, 1, GateReason.SPOOFED_STATION),
]


def expected(
    case: Case, station: StationIdentity, sysid: int, wrong: GateReason | None, view: AuthorityView
) -> tuple[Action, GateReason]:
    if wrong is not None:
        return Action.DROP, wrong
    commands = view.commander is not None and view.commander == station.sysid
    if case.kind == LIVENESS and sysid in (TRACKER_OF_A, TRACKER_OF_B):
        commands = False
    if case.kind == START and commands and view.phase is Phase.ON_LOAD:
        return Action.CONSUME, GateReason.COMPANION
    return OUTCOMES[case.kind][0 if commands else 1]


@pytest.mark.parametrize(("station", "sysid", "version", "wrong"), SENDERS)
def test_every_message_and_command_from_every_sender_in_every_phase(
    make: Callable[..., Frame], station: StationIdentity, sysid: int, version: int, wrong: GateReason | None
) -> None:
    judged = 0
    for case in CASES:
        if version == 1 and mavlink_id(case.name) > 255:
            continue
        frame = make(case.name, sysid=sysid, version=version, **dict(case.fields))
        for view in VIEWS:
            verdict = judge(frame, station, view, VEHICLE)
            assert (verdict.action, verdict.reason) == expected(case, station, sysid, wrong, view), (
                f"{case} from {sysid} behind {station.sysid}, version {version}, {view}: {verdict}"
            )
            assert verdict.what.startswith(case.name)
            judged += 1
    assert judged > 6000


def mavlink_id(name: str) -> int:
    return next(msgid for msgid, cls in mavlink.mavlink_map.items() if cls.msgname == name)


# --- single rules, one by one

COMMANDED_BY_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD)


def outcome(frame: Frame, station: StationIdentity, view: AuthorityView = COMMANDED_BY_A) -> Verdict:
    return judge(frame, station, view, VEHICLE)


def test_a_stop_from_a_station_that_does_not_command_is_refused(make: Callable[..., Frame]) -> None:
    for command, what in (
        (193, "MAV_CMD_DO_PAUSE_CONTINUE"),
        (20, "MAV_CMD_NAV_RETURN_TO_LAUNCH"),
        (21, "MAV_CMD_NAV_LAND"),
    ):
        verdict = outcome(make("COMMAND_LONG", sysid=GCSB, command=command), B)
        assert (verdict.action, verdict.reason) == (Action.REFUSE, GateReason.NOT_IN_CONTROL)
        assert verdict.what == f"COMMAND_LONG/{what}"


def test_what_is_addressed_to_everybody_is_addressed_to_us(make: Callable[..., Frame]) -> None:
    for name in ("COMMAND_LONG", "COMMAND_INT"):
        frame = make(name, sysid=GCSB, command=400, target_system=0, target_component=0)
        assert outcome(frame, B).reason is GateReason.NOT_IN_CONTROL
    frame = make("COMMAND_LONG", command=400, target_system=0, target_component=0)
    assert outcome(frame, A).action is Action.FORWARD


@pytest.mark.parametrize("other", [2, GCSB, 255])
def test_what_is_addressed_to_another_system_is_dropped_whoever_sends_it(
    make: Callable[..., Frame], other: int
) -> None:
    for name, fields in (
        ("COMMAND_LONG", {"command": 400}),
        ("COMMAND_LONG", {"command": 40001}),
        ("COMMAND_LONG", {"command": 42700}),
        ("PARAM_REQUEST_LIST", {}),
        ("MISSION_COUNT", {}),
        ("RC_CHANNELS_OVERRIDE", {}),
        ("SETUP_SIGNING", {}),
        ("OK_HANDOVER", {}),
    ):
        for sysid, station in ((GCSA, A), (GCSB, B)):
            verdict = outcome(make(name, sysid=sysid, target_system=other, **fields), station)
            assert (verdict.action, verdict.reason) == (Action.DROP, GateReason.OTHER_TARGET), name
    assert outcome(make("MANUAL_CONTROL", target=other), A).reason is GateReason.OTHER_TARGET


def test_other_components_of_the_vehicle_are_the_commanders_too(make: Callable[..., Frame]) -> None:
    for component in (0, 1, 100, 154):
        frame = make("COMMAND_LONG", command=1000, target_component=component)
        assert outcome(frame, A).action is Action.FORWARD
        frame = make("COMMAND_LONG", sysid=GCSB, command=1000, target_component=component)
        assert outcome(frame, B).reason is GateReason.NOT_IN_CONTROL


def test_the_companions_component_takes_only_what_the_companion_consumes(make: Callable[..., Frame]) -> None:
    def at_companion(name: str, sysid: int = GCSA, **fields: object) -> tuple[Action, GateReason]:
        frame = make(name, sysid=sysid, target_component=191, **fields)
        verdict = outcome(frame, A if sysid == GCSA else B)
        return verdict.action, verdict.reason

    refused = (Action.REFUSE, GateReason.COMPANION_TARGET)
    assert at_companion("COMMAND_LONG", command=400) == refused
    assert at_companion("COMMAND_LONG", command=300) == refused
    assert at_companion("COMMAND_LONG", command=512) == refused
    assert at_companion("COMMAND_LONG", command=512, sysid=GCSB) == refused
    assert at_companion("PARAM_REQUEST_LIST", sysid=GCSB) == refused
    assert at_companion("PARAM_SET") == refused
    assert at_companion("FILE_TRANSFER_PROTOCOL") == refused
    assert at_companion("RC_CHANNELS_OVERRIDE") == (Action.DROP, GateReason.COMPANION_TARGET)
    assert at_companion("COMMAND_LONG", command=400, sysid=GCSB) == (Action.REFUSE, GateReason.NOT_IN_CONTROL)
    assert at_companion("COMMAND_LONG", command=32100, sysid=GCSB) == (Action.CONSUME, GateReason.COMPANION)
    assert at_companion("COMMAND_ACK", command=32100) == (Action.CONSUME, GateReason.COMPANION)
    assert at_companion("CONNECT", sysid=GCSB) == (Action.CONSUME, GateReason.COMPANION)
    assert at_companion("TUNNEL", payload_type=47117) == (Action.DROP, GateReason.NEVER)


def test_start_on_the_ground_is_the_companions_by_either_command_form_and_target(
    make: Callable[..., Frame],
) -> None:
    on_load = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD)
    for name in ("COMMAND_LONG", "COMMAND_INT"):
        for component in (0, 1, 191):
            frame = make(name, command=300, target_component=component)
            assert outcome(frame, A, on_load).action is Action.CONSUME


def test_a_frame_that_could_not_be_checked_is_dropped(make: Callable[..., Frame]) -> None:
    for msgid in (0, 76, 47199, 0xFFFFFF):
        frame = Frame(b"", 2, msgid, GCSA, 190, 0, False, b"", False)
        verdict = outcome(frame, A)
        assert (verdict.action, verdict.reason) == (Action.DROP, GateReason.UNKNOWN_MESSAGE)


def test_a_message_outside_the_policy_is_dropped_even_if_it_was_checked() -> None:
    verdict = outcome(Frame(b"", 2, 47131, GCSA, 190, 0, False, bytes(10), True), A)
    assert (verdict.action, verdict.reason) == (Action.DROP, GateReason.UNKNOWN_MESSAGE)
    assert (verdict.access, verdict.what) == (None, "message 47131")


def test_a_station_is_always_among_its_own_ids_and_ids_are_real() -> None:
    assert StationIdentity(251).sysids == {251}
    assert StationIdentity(251, frozenset({240})).sysids == {240, 251}
    for sysid, sysids in ((0, frozenset()), (256, frozenset()), (251, frozenset({0}))):
        with pytest.raises(ValueError, match="must be 1 to 255"):
            StationIdentity(sysid, sysids)


@given(
    st.integers(0, 0xFFFFFF) | st.sampled_from(sorted(mavlink.mavlink_map)),
    st.integers(0, 255) | st.just(GCSA),
    st.binary(max_size=300),
    st.booleans(),
    st.sampled_from(VIEWS),
)
def test_whatever_a_frame_holds_there_is_a_verdict(
    msgid: int, sysid: int, payload: bytes, known: bool, view: AuthorityView
) -> None:
    verdict = judge(Frame(payload, 2, msgid, sysid, 0, 0, False, payload, known), A, view, VEHICLE)
    if verdict.action is Action.FORWARD:
        assert known
        assert sysid in (GCSA, TRACKER_OF_A)


@given(st.binary(max_size=600))
def test_bytes_that_are_no_frames_reach_nobody(data: bytes) -> None:
    for frame in FrameSplitter().feed(data):
        assert outcome(frame, C).action is not Action.FORWARD or frame.sysid == GCSC

# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of the judge, one by one. `test_every_sender.py` has every message and sender."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate import judge as gate_judge
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, Verdict, judge, uploads
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.rows import MESSAGE_ROWS, Row
from mavproxy_handover.wire.frames import Frame, FrameSplitter
from tests.gate.frames import ftp_request
from tests.gate.ledger import (
    GCSA,
    GCSB,
    GCSC,
    MISSION_TYPES,
    RALLY_WRITE_TYPES,
    TRACKER_OF_A,
    VEHICLE,
    VIEWS,
    A,
    B,
    C,
)

COMMANDED_BY_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD)


GROUNDED = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD)


def outcome(frame: Frame, station: StationIdentity, view: AuthorityView = COMMANDED_BY_A) -> Verdict:
    return judge(frame, station, view, VEHICLE)


def test_no_verdict_is_worked_out_beforehand_where_more_than_the_message_matters(
    make: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    manual, beat, ping = make("MANUAL_CONTROL").msgid, make("HEARTBEAT").msgid, make("PING").msgid
    dear = {msgid for msgid, row in MESSAGE_ROWS.items() if row.access in (Access.BULK, Access.SAFEGUARD, Access.LOG)}
    assert make("PARAM_REQUEST_LIST").msgid in dear
    assert {manual, ping} <= set(gate_judge._usual_by_id())
    rows = {**MESSAGE_ROWS, manual: Row("MANUAL_CONTROL", Access.SAFEGUARD), ping: Row("PING", Access.BULK)}
    monkeypatch.setattr(gate_judge, "MESSAGE_ROWS", rows)
    by_contents = {make(name).msgid for name in ("SET_MODE", "MISSION_SET_CURRENT", "MISSION_ACK")}
    assert sorted(gate_judge._usual_by_id()) == sorted(set(rows) - dear - by_contents - {manual, beat, ping})


@pytest.mark.parametrize("name", ["MANUAL_CONTROL", "COMMAND_LONG", "HEARTBEAT"])
def test_the_vehicle_s_id_is_nobody_s_whatever_a_station_is_said_to_speak_for(
    make: Callable[..., Frame], name: str
) -> None:
    greedy = StationIdentity(GCSA, frozenset((VEHICLE,)))
    verdict = outcome(make(name, sysid=VEHICLE), greedy)
    assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.SPOOFED_VEHICLE)


def test_a_frame_with_less_payload_than_its_message_has_is_judged_all_the_same(make: Callable[..., Frame]) -> None:
    frame = make("RC_CHANNELS_OVERRIDE", sysid=GCSA)
    for length in range(len(frame.payload)):
        verdict = outcome(frame._replace(payload=frame.payload[:length]), A)
        assert (verdict.fate, verdict.reason) == (Fate.FORWARD, GateReason.ALLOWED)


def test_a_stop_from_a_station_that_does_not_command_is_refused(make: Callable[..., Frame]) -> None:
    for command, what in (
        (193, "MAV_CMD_DO_PAUSE_CONTINUE"),
        (20, "MAV_CMD_NAV_RETURN_TO_LAUNCH"),
        (21, "MAV_CMD_NAV_LAND"),
    ):
        verdict = outcome(make("COMMAND_LONG", sysid=GCSB, command=command), B)
        assert (verdict.fate, verdict.reason) == (Fate.REFUSE, GateReason.NOT_IN_CONTROL)
        assert verdict.what == f"COMMAND_LONG/{what}"


COMMANDED_BY_A_ARMED = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)

LOCKED = (Fate.REFUSE, GateReason.LOCKED_WHILE_ARMED)
ALLOWED = (Fate.FORWARD, GateReason.ALLOWED)
NOT_IN_CONTROL = (Fate.REFUSE, GateReason.NOT_IN_CONTROL)


def both_ways(frame: Frame, station: StationIdentity) -> list[tuple[Fate, GateReason]]:
    """The outcome on the ground, and while armed."""
    verdicts = [outcome(frame, station, view) for view in (COMMANDED_BY_A, COMMANDED_BY_A_ARMED)]
    return [(verdict.fate, verdict.reason) for verdict in verdicts]


@pytest.mark.parametrize("name", ["FS_GCS_ENABLE", "SCR_ENABLE", "HNDO_ENABLE", "MAV_GCS_SYSID", "SYSID_MYGCS"])
def test_what_disables_guard_failsafe_or_authority_is_locked_while_armed(make: Callable[..., Frame], name: str) -> None:
    param_id = name.encode()
    assert both_ways(make("PARAM_SET", param_id=param_id), A) == [ALLOWED, LOCKED]
    assert both_ways(make("PARAM_EXT_SET", param_id=param_id), A) == [ALLOWED, LOCKED]
    assert both_ways(make("PARAM_SET", sysid=GCSB, param_id=param_id), B) == [NOT_IN_CONTROL, NOT_IN_CONTROL]
    assert outcome(make("PARAM_SET", param_id=param_id), A).what == f"PARAM_SET/{name}"


@pytest.mark.parametrize(
    "name",
    ["RALLY_INCL_HOME", "RALLY_LIMIT_KM", "RTL_ALT", "RTL_ALT_M", "RTL_CLIMB_MIN_M", "LAND_SPD_MS", "FENCE_TOTAL"],
)
def test_where_a_return_ends_is_settled_before_take_off(make: Callable[..., Frame], name: str) -> None:
    for message in ("PARAM_SET", "PARAM_EXT_SET", "PARAM_MAP_RC"):
        assert both_ways(make(message, param_id=name.encode()), A) == [ALLOWED, LOCKED]


def test_nothing_of_a_station_reaches_the_autopilots_own_rally_list(make: Callable[..., Frame]) -> None:
    """It holds the chosen place of a return: RALLY_TOTAL 0 would send it home, 2 bring back another flight's point."""
    taken, refused = (Fate.CONSUME, GateReason.COMPANION), (Fate.REFUSE, GateReason.MAINTENANCE_ONLY)
    absent = (Fate.REFUSE, GateReason.ABSENT)
    for name in (
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_ITEM",
        "MISSION_WRITE_PARTIAL_LIST",
        "MISSION_CLEAR_ALL",
    ):
        for mission_type in (2, 255):
            assert both_ways(make(name, mission_type=mission_type), A) == [taken, taken]
            theirs = make(name, sysid=GCSB, mission_type=mission_type)
            assert both_ways(theirs, B) == [NOT_IN_CONTROL, NOT_IN_CONTROL]
    for name in ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"):
        for sysid, station in ((GCSA, A), (GCSB, B)):
            assert both_ways(make(name, sysid=sysid, mission_type=2), station) == [taken, taken]
            if name != "MISSION_ACK":  # in flight it may call an upload off
                assert both_ways(make(name, sysid=sysid, mission_type=0), station) == [ALLOWED, ALLOWED]
    for message in ("PARAM_SET", "PARAM_EXT_SET", "PARAM_MAP_RC"):
        assert both_ways(make(message, param_id=b"RALLY_TOTAL"), A) == [refused, refused]
    for opcode in (4, 6, 8, 11, 12, 14):
        file = make("FILE_TRANSFER_PROTOCOL", payload=ftp_request(opcode, b"@MISSION/rally.dat"))
        assert both_ways(file, A) == [absent, absent]
        theirs = make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=ftp_request(opcode, b"@MISSION/rally.dat"))
        assert both_ways(theirs, B) == [absent, absent]
    for name in ("RALLY_POINT", "RALLY_FETCH_POINT"):
        assert both_ways(make(name), A) == [refused, refused]


def test_gains_are_the_commanders_in_flight_too(make: Callable[..., Frame]) -> None:
    assert both_ways(make("PARAM_SET", param_id=b"ATC_RAT_RLL_P"), A) == [ALLOWED, ALLOWED]
    assert both_ways(make("PARAM_SET", param_id=b"ATC_RAT_RLL_P", sysid=GCSB), B) == [NOT_IN_CONTROL, NOT_IN_CONTROL]


def test_what_shapes_a_return_is_locked_while_armed(make: Callable[..., Frame]) -> None:
    """`param set WPNAV_SPEED 100` in flight: RTL then flew 1 m/s, and landed with an empty battery."""
    for frame in (
        make("PARAM_SET", param_id=b"WPNAV_SPEED"),
        make("PARAM_SET", param_id=b"WP_SPD"),
        make("COMMAND_LONG", command=mavlink.MAV_CMD_DO_SET_HOME, param1=0.0, param7=300.0),
        make("COMMAND_INT", command=mavlink.MAV_CMD_DO_SET_HOME, z=300.0),
        make("COMMAND_LONG", command=mavlink.MAV_CMD_DO_FENCE_ENABLE),
        make("SET_HOME_POSITION"),
        make("SET_GPS_GLOBAL_ORIGIN"),
        make("COMMAND_LONG", command=mavlink.MAV_CMD_DO_AUX_FUNCTION, param1=11.0),
        make("COMMAND_LONG", command=mavlink.MAV_CMD_DO_AUX_FUNCTION, param1=90.0),
    ):
        assert both_ways(frame, A) == [ALLOWED, LOCKED]


@pytest.mark.parametrize(
    ("param_id", "outcomes", "what"),
    [
        (b"fs_options", [ALLOWED, LOCKED], "PARAM_SET/FS_OPTIONS"),
        (b"FS_OPTIONS\0rubbish", [ALLOWED, LOCKED], "PARAM_SET/FS_OPTIONS"),
        (b"MNT1_TYPE\0FS_OPTION", [ALLOWED, ALLOWED], "PARAM_SET/MNT1_TYPE"),
        (b"BATT_FS_VOLTSRC1", [ALLOWED, LOCKED], "PARAM_SET/BATT_FS_VOLTSRC1"),
        (b"FS_\x1b[31m\xff", [ALLOWED, LOCKED], "PARAM_SET/FS_?[31M?"),
        (b"", [ALLOWED, LOCKED], "PARAM_SET/"),
    ],
)
def test_a_parameters_name_is_read_as_the_autopilot_reads_it(
    make: Callable[..., Frame], param_id: bytes, outcomes: list[tuple[Fate, GateReason]], what: str
) -> None:
    frame = make("PARAM_SET", param_id=param_id)
    assert both_ways(frame, A) == outcomes
    assert outcome(frame, A).what == what


def test_parameters_that_are_not_named_are_locked_while_armed(make: Callable[..., Frame]) -> None:
    upload = ftp_request(6, b"@PARAM/param.pck")
    assert both_ways(make("FILE_TRANSFER_PROTOCOL", payload=upload), A) == [ALLOWED, LOCKED]
    assert both_ways(make("COMMAND_LONG", command=245, param1=2.0), A) == [ALLOWED, LOCKED]
    assert both_ways(make("COMMAND_INT", command=180), A) == [ALLOWED, LOCKED]


def test_missions_may_be_uploaded_as_files_on_the_ground_alone(make: Callable[..., Frame]) -> None:
    upload = ftp_request(6, b"@MISSION/mission.dat")
    assert both_ways(make("FILE_TRANSFER_PROTOCOL", payload=upload), A) == [ALLOWED, LOCKED]
    download = ftp_request(4, b"@MISSION/mission.dat")
    assert both_ways(make("FILE_TRANSFER_PROTOCOL", payload=download), A) == [ALLOWED, ALLOWED]
    frame = make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=upload)
    assert both_ways(frame, B) == [NOT_IN_CONTROL, NOT_IN_CONTROL]


def test_no_station_writes_scripts_or_reads_the_memory_with_the_signing_key(make: Callable[..., Frame]) -> None:
    maintenance = (Fate.REFUSE, GateReason.MAINTENANCE_ONLY)
    for opcode, path, what in (
        (6, b"APM/scripts/x.lua", "FILE_TRANSFER_PROTOCOL/CreateFile (scripts)"),
        (8, b"scripts/handover_guard.lua", "FILE_TRANSFER_PROTOCOL/RemoveFile (scripts)"),
        (4, b"@SYS/storage.bin", "FILE_TRANSFER_PROTOCOL/OpenFileRO (raw memory)"),
    ):
        for sysid, station in ((GCSA, A), (GCSB, B)):
            frame = make("FILE_TRANSFER_PROTOCOL", sysid=sysid, payload=ftp_request(opcode, path))
            assert both_ways(frame, station) == [maintenance, maintenance]
            assert outcome(frame, station).what == what


def test_a_mission_type_that_does_not_exist_is_refused(make: Callable[..., Frame]) -> None:
    for mission_type in range(256):
        verdict = outcome(make("MISSION_COUNT", count=3, mission_type=mission_type), A, GROUNDED)
        known = GateReason.COMPANION if mission_type in RALLY_WRITE_TYPES else GateReason.ALLOWED
        assert verdict.reason is (known if mission_type in MISSION_TYPES else GateReason.UNKNOWN_COMMAND), mission_type
    assert outcome(make("MISSION_COUNT", mission_type=1), A).what == "MISSION_COUNT/FENCE"
    assert outcome(make("MISSION_COUNT", mission_type=9), A).what == "MISSION_COUNT/9"


def test_what_is_addressed_to_everybody_is_addressed_to_us(make: Callable[..., Frame]) -> None:
    for name in ("COMMAND_LONG", "COMMAND_INT"):
        frame = make(name, sysid=GCSB, command=400, target_system=0, target_component=0)
        assert outcome(frame, B).reason is GateReason.NOT_IN_CONTROL
    frame = make("COMMAND_LONG", command=400, target_system=0, target_component=0)
    assert outcome(frame, A).fate is Fate.FORWARD


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
            assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.OTHER_TARGET), name
    assert outcome(make("MANUAL_CONTROL", target=other), A).reason is GateReason.OTHER_TARGET


def test_other_components_of_the_vehicle_are_the_commanders_too(make: Callable[..., Frame]) -> None:
    for component in (0, 1, 100, 154):
        frame = make("COMMAND_LONG", command=1000, target_component=component)
        assert outcome(frame, A).fate is Fate.FORWARD
        frame = make("COMMAND_LONG", sysid=GCSB, command=1000, target_component=component)
        assert outcome(frame, B).reason is GateReason.NOT_IN_CONTROL


def test_the_companions_component_takes_only_what_the_companion_consumes(make: Callable[..., Frame]) -> None:
    def at_companion(name: str, sysid: int = GCSA, **fields: object) -> tuple[Fate, GateReason]:
        frame = make(name, sysid=sysid, target_component=191, **fields)
        verdict = outcome(frame, A if sysid == GCSA else B)
        return verdict.fate, verdict.reason

    refused = (Fate.REFUSE, GateReason.COMPANION_TARGET)
    assert at_companion("COMMAND_LONG", command=400) == refused
    assert at_companion("COMMAND_LONG", command=300) == refused
    assert at_companion("COMMAND_LONG", command=512) == refused
    assert at_companion("COMMAND_LONG", command=512, sysid=GCSB) == refused
    assert at_companion("PARAM_REQUEST_LIST", sysid=GCSB) == refused
    assert at_companion("PARAM_SET") == refused
    assert at_companion("FILE_TRANSFER_PROTOCOL") == refused
    assert at_companion("RC_CHANNELS_OVERRIDE") == (Fate.DROP, GateReason.COMPANION_TARGET)
    assert at_companion("COMMAND_LONG", command=400, sysid=GCSB) == (Fate.REFUSE, GateReason.NOT_IN_CONTROL)
    assert at_companion("COMMAND_LONG", command=32100, sysid=GCSB) == (Fate.CONSUME, GateReason.COMPANION)
    assert at_companion("COMMAND_ACK", command=32100) == (Fate.CONSUME, GateReason.COMPANION)
    assert at_companion("CONNECT", sysid=GCSB) == (Fate.CONSUME, GateReason.COMPANION)
    assert at_companion("TUNNEL", payload_type=47117) == (Fate.DROP, GateReason.NEVER)


def test_start_on_the_ground_is_the_companions_by_either_command_form_and_target(
    make: Callable[..., Frame],
) -> None:
    on_load = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD)
    for name in ("COMMAND_LONG", "COMMAND_INT"):
        for component in (0, 1, 191):
            frame = make(name, command=300, target_component=component)
            assert outcome(frame, A, on_load).fate is Fate.CONSUME


def test_a_frame_that_could_not_be_checked_is_dropped(make: Callable[..., Frame]) -> None:
    for msgid in (0, 76, 47199, 0xFFFFFF):
        frame = Frame(b"", 2, msgid, GCSA, 190, 0, False, b"", False)
        verdict = outcome(frame, A)
        assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.UNKNOWN_MESSAGE)


def test_even_a_frame_without_its_payload_has_a_verdict() -> None:
    for msgid in mavlink.mavlink_map:
        for known in (True, False):
            frame = Frame(b"", 2, msgid, GCSA, 190, 0, False, b"", known)
            assert (outcome(frame, A).reason is GateReason.UNKNOWN_MESSAGE) is not known


def test_a_message_outside_the_policy_is_dropped_even_if_it_was_checked() -> None:
    verdict = outcome(Frame(b"", 2, 47131, GCSA, 190, 0, False, bytes(10), True), A)
    assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.UNKNOWN_MESSAGE)
    assert (verdict.access, verdict.what) == (None, "message 47131")


def test_a_station_is_always_among_its_own_ids_and_ids_are_real() -> None:
    assert StationIdentity(251).sysids == {251}
    assert StationIdentity(1, frozenset({255})).sysids == {1, 255}
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
    if verdict.fate is Fate.FORWARD:
        assert known
        assert sysid in (GCSA, TRACKER_OF_A)


@given(st.binary(max_size=600))
def test_bytes_that_are_no_frames_reach_nobody(data: bytes) -> None:
    for frame in FrameSplitter().feed(data):
        assert outcome(frame, C).fate is not Fate.FORWARD or frame.sysid == GCSC


@pytest.mark.parametrize(
    ("name", "fields", "fate"),
    [
        ("COMMAND_LONG", {"command": 21}, Fate.REFUSE),
        ("PARAM_SET", {"param_id": b"X"}, Fate.REFUSE),
        ("MISSION_COUNT", {"count": 3}, Fate.REFUSE),
        ("RC_CHANNELS_OVERRIDE", {}, Fate.DROP),
        ("HEARTBEAT", {}, Fate.DROP),
        ("OK_HANDOVER", {}, Fate.DROP),
        ("COMMAND_LONG", {"command": 32100}, Fate.REFUSE),
    ],
)
@pytest.mark.parametrize("view", [GROUNDED, replace(GROUNDED, phase=Phase.ON_MISSION, armed=True)])
def test_a_component_that_is_not_the_stations_has_no_part_in_its_authority(
    make: Callable[..., Frame], view: AuthorityView, name: str, fields: dict[str, object], fate: Fate
) -> None:
    verdict = judge(make(name, sysid=GCSA, compid=25, **fields), A, view, VEHICLE)
    assert (verdict.fate, verdict.reason) == (fate, GateReason.COMPONENT)
    assert (
        judge(make(name, sysid=TRACKER_OF_A, compid=25, **fields), A, view, VEHICLE).reason is not GateReason.COMPONENT
    )


def test_a_component_that_is_not_the_stations_may_read(make: Callable[..., Frame]) -> None:
    frame = make("PARAM_REQUEST_READ", sysid=GCSA, compid=25)
    assert judge(frame, A, GROUNDED, VEHICLE).fate is Fate.FORWARD


# --- what phase, rehearsal and sender change

ON_GROUND, IN_FLIGHT = GROUNDED, COMMANDED_BY_A_ARMED
REHEARSED = replace(IN_FLIGHT, rehearsal=True)
CONSUMED = (Fate.CONSUME, GateReason.COMPANION)
START, LAND, TAKE_OFF = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_TAKEOFF


@pytest.mark.parametrize(("sysid", "station", "others"), [(GCSA, A, ALLOWED), (GCSB, B, NOT_IN_CONTROL)])
def test_in_a_rehearsal_nobody_starts_and_the_rest_is_as_in_flight(
    make: Callable[..., Frame], sysid: int, station: StationIdentity, others: tuple[Fate, GateReason]
) -> None:
    for command, wanted in ((START, (Fate.REFUSE, GateReason.REHEARSAL)), (LAND, others)):
        verdict = outcome(make("COMMAND_LONG", sysid=sysid, command=command), station, REHEARSED)
        assert (verdict.fate, verdict.reason) == wanted


def test_a_further_system_of_a_station_commands_and_its_heartbeat_does_not_count(make: Callable[..., Frame]) -> None:
    not_counted = (Fate.CONSUME, GateReason.LIVENESS_NOT_COMMANDER)
    for sysid, beats in ((GCSA, ALLOWED), (TRACKER_OF_A, not_counted)):
        beat = outcome(make("HEARTBEAT", sysid=sysid), A)
        command = outcome(make("COMMAND_LONG", sysid=sysid, command=LAND), A)
        assert (beat.fate, beat.reason) == beats
        assert (command.fate, command.reason) == ALLOWED


def test_on_the_ground_a_take_off_is_the_companions_and_an_answer_to_one_is_not(make: Callable[..., Frame]) -> None:
    for command in (START, TAKE_OFF):
        taken = outcome(make("COMMAND_LONG", command=command), A, ON_GROUND)
        answer = outcome(make("COMMAND_ACK", command=command), A, ON_GROUND)
        assert (taken.fate, taken.reason) == CONSUMED
        assert (answer.fate, answer.reason) == ALLOWED


@pytest.mark.parametrize(
    ("sysid", "station", "mission_type", "wanted"),
    [(GCSA, A, 0, CONSUMED), (GCSA, A, 1, CONSUMED), (GCSA, A, 255, ALLOWED), (GCSB, B, 0, ALLOWED)],
)
def test_in_flight_only_the_commander_calls_off_an_upload_and_only_of_mission_or_fence(
    make: Callable[..., Frame], sysid: int, station: StationIdentity, mission_type: int, wanted: tuple[Fate, GateReason]
) -> None:
    verdict = outcome(make("MISSION_ACK", sysid=sysid, mission_type=mission_type), station, IN_FLIGHT)
    assert (verdict.fate, verdict.reason) == wanted


def test_a_guided_target_in_an_item_is_no_upload(make: Callable[..., Frame]) -> None:
    item = {"command": mavlink.MAV_CMD_NAV_WAYPOINT, "frame": mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
    assert uploads(make("MISSION_ITEM_INT", **item))
    assert not uploads(make("MISSION_ITEM_INT", **item, current=2))
    assert not uploads(make("MISSION_COUNT", mission_type=2))

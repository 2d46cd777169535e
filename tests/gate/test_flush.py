# SPDX-License-Identifier: GPL-3.0-or-later

"""What a former commander had open at the autopilot is closed in its own name, and nothing else is sent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.flush import Closing, FlushTracker
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, Verdict, judge
from mavproxy_handover.wire.frames import Frame
from tests.gate.frames import IDS, ftp_request

VEHICLE, GCSA, GCSB, TRACKER = 1, 251, 252, 241
#: every component of it is the station
A = StationIdentity(GCSA, frozenset({TRACKER}), frozenset(range(256)))
COMMANDED_BY_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD)
FORWARDED = Verdict(Fate.FORWARD, None, GateReason.ALLOWED, "")
ACCEPTED, ERROR, DENIED, INVALID_SEQUENCE, CANCELLED = 0, 1, 14, 13, 15

Make = Callable[..., Frame]


@pytest.fixture
def tracker() -> FlushTracker:
    return FlushTracker(VEHICLE)


def send(tracker: FlushTracker, *frames: Frame) -> None:
    """The commander sends frames, and the gate lets them through: on the ground what the companion judges in flight."""
    for frame in frames:
        verdict = judge(frame, A, COMMANDED_BY_A, VEHICLE)
        if verdict.fate is Fate.CONSUME:
            verdict = judge(frame, A, replace(COMMANDED_BY_A, phase=Phase.ON_LOAD, armed=False), VEHICLE)
        assert verdict.fate is Fate.FORWARD
        tracker.saw(frame, verdict, GCSA)


def read(closings: list[Closing]) -> list[tuple[str, list[Any]]]:
    """What each closing is called, and what the autopilot reads."""
    return [(c.what, [mavlink.MAVLink(None).decode(bytearray(raw)) for raw in c.frames]) for c in closings]


def origin(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def aim(message: Any) -> tuple[int, int]:
    return message.target_system, message.target_component


# ---- uploads ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "name", "incomplete"), [(0, "mission", True), (1, "fence", False)])
def test_an_unfinished_upload_ends_by_a_count_that_cannot_be_stored(
    tracker: FlushTracker, make: Make, kind: int, name: str, incomplete: bool
) -> None:
    send(tracker, make("MISSION_COUNT", compid=77, count=3, mission_type=kind))
    send(tracker, make("MISSION_ITEM_INT", compid=77, mission_type=kind))
    (closing,) = tracker.flush(GCSA)
    assert (closing.what, closing.incomplete) == (f"unfinished {name} upload ended", incomplete)
    ((_, [message]),) = read([closing])
    assert message.get_type() == "MISSION_COUNT"
    assert (origin(message), aim(message)) == ((GCSA, 77), (VEHICLE, 1))
    assert (message.count, message.mission_type) == (65535, kind)


def test_a_partial_upload_is_an_upload(tracker: FlushTracker, make: Make) -> None:
    send(tracker, make("MISSION_WRITE_PARTIAL_LIST", start_index=1, end_index=2))
    assert [what for what, _ in read(tracker.flush(GCSA))] == ["unfinished mission upload ended"]


@pytest.mark.parametrize(
    ("result", "ended"),
    [(ACCEPTED, True), (ERROR, True), (CANCELLED, True), (INVALID_SEQUENCE, False), (DENIED, False)],
)
def test_an_upload_has_ended_when_the_autopilot_says_so(
    tracker: FlushTracker, make: Make, result: int, ended: bool
) -> None:
    """DENIED is the answer to a question that its own sender asks while the upload lasts, which goes on."""
    send(tracker, make("MISSION_COUNT", count=3, mission_type=1))
    tracker.note_reply(
        make("MISSION_ACK", sysid=1, compid=1, target_system=GCSA, target_component=190, mission_type=1, type=result)
    )
    assert (tracker.flush(GCSA) == []) is ended


def test_other_messages_of_the_autopilot_end_nothing(tracker: FlushTracker, make: Make) -> None:
    """A COMMAND_ACK to the one who has a file and an upload open."""
    send(tracker, make("MISSION_COUNT"), ftp(make, 6, b"x"))
    for name in ("COMMAND_ACK", "MISSION_REQUEST_INT", "HEARTBEAT", "PARAM_VALUE"):
        fields = {} if name in ("HEARTBEAT", "PARAM_VALUE") else {"target_system": GCSA, "target_component": 190}
        tracker.note_reply(make(name, sysid=1, compid=1, **fields))
    assert len(tracker.flush(GCSA)) == 2


@pytest.mark.parametrize(
    "other", [{"mission_type": 0}, {"target_component": 191}, {"target_system": GCSB}, {"target_system": 0}]
)
def test_the_end_of_another_upload_is_not_the_end_of_this_one(
    tracker: FlushTracker, make: Make, other: dict[str, int]
) -> None:
    send(tracker, make("MISSION_COUNT", count=3, mission_type=1))
    fields = {"target_system": GCSA, "target_component": 190, "mission_type": 1, **other}
    tracker.note_reply(make("MISSION_ACK", sysid=1, compid=1, **fields))
    assert len(tracker.flush(GCSA)) == 1


def test_uploads_of_two_kinds_are_both_ended(tracker: FlushTracker, make: Make) -> None:
    send(tracker, make("MISSION_COUNT", mission_type=1), make("MISSION_COUNT", mission_type=0))
    assert [what for what, _ in read(tracker.flush(GCSA))] == [
        "unfinished fence upload ended",
        "unfinished mission upload ended",
    ]


# ---- files --------------------------------------------------------------------------------------------------------


def ftp(make: Make, opcode: int, data: bytes = b"", session: int = 4, sequence: int = 0, compid: int = 190) -> Frame:
    payload = ftp_request(opcode, data, session, sequence)
    return make("FILE_TRANSFER_PROTOCOL", compid=compid, payload=payload)


def test_a_file_open_for_writing_is_closed(tracker: FlushTracker, make: Make) -> None:
    send(tracker, ftp(make, 6, b"APM/terrain/x", sequence=10), ftp(make, 7, b"data", sequence=11))
    ((what, [message]),) = read(tracker.flush(GCSA))
    assert what == "file 'APM/terrain/x' closed"
    assert (origin(message), aim(message)) == ((GCSA, 190), (VEHICLE, 1))
    assert message.target_network == 0
    #                          seq    session  TerminateSession, empty
    assert message.payload == [12, 0, 4, 1, *[0] * 247]


@pytest.mark.parametrize("path", [b"@MISSION/mission.dat", b"/@mission/fence.dat", b"@PARAM/param.pck"])
def test_what_is_applied_when_it_is_closed_is_spoiled_before_it_is_closed(
    tracker: FlushTracker, make: Make, path: bytes
) -> None:
    send(tracker, ftp(make, 11, path, sequence=65534))
    (closing,) = tracker.flush(GCSA)
    assert not closing.incomplete
    ((what, [spoil, close]),) = read([closing])
    assert what == f"file {path.decode()!r} closed, contents thrown away"
    #                        seq       session  WriteFile, 12 bytes at offset 0, all zero
    assert spoil.payload == [255, 255, 4, 7, 12, *[0] * 246]
    assert close.payload == [0, 0, 4, 1, *[0] * 247]


def answer(
    make: Make, opcode: int, of: int, *, session: int = 4, sequence: int = 1, target: int = GCSA, compid: int = 190
) -> Frame:
    """What the autopilot says to a request with the sequence number before: 128 done, 129 refused."""
    payload = [*sequence.to_bytes(2, "little"), session, opcode, 0, of, *[0] * 245]
    aimed = {"target_system": target, "target_component": compid}
    return make("FILE_TRANSFER_PROTOCOL", sysid=1, compid=1, payload=payload, **aimed)


DONE, REFUSED = 128, 129


@pytest.mark.parametrize(("opcode", "session", "closed"), [(1, 4, True), (2, 4, True), (1, 5, False), (2, 5, False)])
def test_a_file_is_closed_when_the_autopilot_says_that_the_station_closed_it(
    tracker: FlushTracker, make: Make, opcode: int, session: int, closed: bool
) -> None:
    send(tracker, ftp(make, 6, b"x"), ftp(make, opcode, session=session))
    tracker.note_reply(answer(make, REFUSED, opcode, session=session))
    tracker.note_reply(answer(make, DONE, opcode, session=session, target=GCSB))
    assert len(tracker.flush(GCSA)) == 1
    send(tracker, ftp(make, 6, b"x"), ftp(make, opcode, session=session))
    tracker.note_reply(answer(make, DONE, opcode, session=session))
    assert (tracker.flush(GCSA) == []) is closed


def test_an_end_that_the_autopilot_never_heard_of_is_none(tracker: FlushTracker, make: Make) -> None:
    """Its queue takes a few requests and drops the others: to ask for the end is not the end."""
    send(tracker, ftp(make, 6, b"@PARAM/param.pck"), ftp(make, 1))
    assert [what for what, _ in read(tracker.arming())] == [
        "file '@PARAM/param.pck' closed, contents thrown away",
    ]


def test_a_file_that_could_not_be_opened_is_not_open(tracker: FlushTracker, make: Make) -> None:
    send(tracker, ftp(make, 6, b"x"))
    tracker.note_reply(answer(make, REFUSED, 7))  # of a write: the file is still open
    tracker.note_reply(answer(make, REFUSED, 6, target=GCSB))
    tracker.note_reply(answer(make, REFUSED, 6, session=5))
    tracker.note_reply(answer(make, REFUSED, 6, sequence=2))
    tracker.note_reply(
        make("FILE_TRANSFER_PROTOCOL", sysid=1, target_system=GCSA, target_component=190, payload=[0] * 251)
    )
    assert len(tracker.flush(GCSA)) == 1
    send(tracker, ftp(make, 6, b"x", sequence=0xFFFF))
    tracker.note_reply(answer(make, REFUSED, 6, sequence=0))
    assert tracker.flush(GCSA) == []


def test_a_file_that_is_asked_for_twice_and_refused_is_not_open(tracker: FlushTracker, make: Make) -> None:
    send(tracker, ftp(make, 6, b"x", sequence=0), ftp(make, 6, b"x", sequence=2))
    tracker.note_reply(answer(make, 5, 6, sequence=3))  # neither done nor refused
    assert tracker.writes(GCSA)
    tracker.note_reply(answer(make, REFUSED, 6, sequence=3))
    assert tracker.flush(GCSA) == []


@pytest.mark.parametrize("session", [4, 5])
@pytest.mark.parametrize("path", [b"x", b"@PARAM/param.pck"])
def test_a_second_file_that_is_refused_does_not_hide_the_first(
    tracker: FlushTracker, make: Make, session: int, path: bytes
) -> None:
    """There is one open file at the autopilot; asked for another one it refuses, and the first stays open."""
    send(tracker, ftp(make, 6, b"@PARAM/param.pck", sequence=0))
    tracker.note_reply(answer(make, DONE, 6, sequence=1))
    send(tracker, ftp(make, 6, path, session=session, sequence=2))
    tracker.note_reply(answer(make, REFUSED, 6, session=session, sequence=3))
    ((what, [spoil, _close]),) = read(tracker.arming())
    assert what == "file '@PARAM/param.pck' closed, contents thrown away"
    assert spoil.payload[2:4] == [4, 7]


def test_a_crowd_of_requests_does_not_hide_the_file_that_is_open(tracker: FlushTracker, make: Make) -> None:
    send(tracker, ftp(make, 6, b"@PARAM/param.pck"))
    tracker.note_reply(answer(make, DONE, 6))
    for compid in range(1, 100):
        send(tracker, ftp(make, 6, b"x", compid=compid))
    assert [what for what, _ in read(tracker.arming())] == ["file '@PARAM/param.pck' closed, contents thrown away"]
    assert len(tracker.flush(GCSA)) == 7


def test_a_request_for_a_file_that_is_open_hides_no_other(tracker: FlushTracker, make: Make) -> None:
    for compid in (*range(1, 9), 8):
        send(tracker, ftp(make, 6, b"x", compid=compid))
    assert len(tracker.flush(GCSA)) == 8


def test_what_closing_would_apply_is_spoiled_before_anything_closes_its_session(
    tracker: FlushTracker, make: Make
) -> None:
    send(tracker, ftp(make, 6, b"x"), ftp(make, 6, b"@PARAM/param.pck"))
    opcodes = [message.payload[3] for _, messages in read(tracker.flush(GCSA)) for message in messages]
    assert opcodes == [7, 1, 1]


def test_a_station_writes_while_it_has_a_file_open_for_writing(tracker: FlushTracker, make: Make) -> None:
    assert not tracker.writes(GCSA)
    send(tracker, make("RC_CHANNELS_OVERRIDE"), ftp(make, 4, b"x"))
    assert not tracker.writes(GCSA)
    send(tracker, ftp(make, 6, b"x"))
    assert tracker.writes(GCSA)
    assert not tracker.writes(GCSB)
    tracker.flush(GCSA)
    assert not tracker.writes(GCSA)


@pytest.mark.parametrize(
    ("name", "fields", "is_open"),
    [
        ("MISSION_COUNT", {"mission_type": 0}, True),
        ("MISSION_COUNT", {"mission_type": 1}, True),
        ("MISSION_COUNT", {"mission_type": 255}, False),
        ("FILE_TRANSFER_PROTOCOL", {"payload": ftp_request(6, b"@MISSION/mission.dat")}, True),
        ("FILE_TRANSFER_PROTOCOL", {"payload": ftp_request(6, b"@PARAM/param.pck")}, False),
        ("RC_CHANNELS_OVERRIDE", {}, False),
    ],
)
def test_a_list_is_open_while_any_station_writes_the_mission_or_the_geofence(
    tracker: FlushTracker, make: Make, name: str, fields: dict[str, Any], is_open: bool
) -> None:
    assert not tracker.list_open
    tracker.saw(make(name, **fields), FORWARDED, GCSA)
    assert tracker.list_open is is_open
    # whatever else this station, and another one, have open
    tracker.saw(make("MISSION_COUNT", mission_type=255), FORWARDED, GCSA)
    tracker.saw(ftp(make, 6, b"@PARAM/param.pck", session=9), FORWARDED, GCSA)
    tracker.saw(make("RC_CHANNELS_OVERRIDE", sysid=GCSB), FORWARDED, GCSB)
    assert tracker.list_open is is_open
    tracker.flush(GCSA)
    assert not tracker.list_open


def test_reading_files_leaves_nothing_to_close(tracker: FlushTracker, make: Make) -> None:
    send(tracker, ftp(make, 4, b"@PARAM/param.pck"), ftp(make, 15), ftp(make, 5), ftp(make, 3, b"/"))
    assert tracker.flush(GCSA) == []


def test_parameter_and_mission_files_are_closed_at_arming_and_others_stay_open(
    tracker: FlushTracker, make: Make
) -> None:
    send(tracker, ftp(make, 6, b"@PARAM/param.pck", compid=190), ftp(make, 6, b"APM/terrain/x", compid=192))
    send(tracker, ftp(make, 11, b"@MISSION/mission.dat", compid=191))
    (what, messages), (also, _) = read(tracker.arming())
    assert what == "file '@PARAM/param.pck' closed, contents thrown away"
    assert [message.payload[3] for message in messages] == [7, 1]
    assert also == "file '@MISSION/mission.dat' closed, contents thrown away"
    assert tracker.arming() == []
    ((what, _),) = read(tracker.flush(GCSA))
    assert what == "file 'APM/terrain/x' closed"


# ---- sticks, guided stream, log -------------------------------------------------------------------------------------


#: the second version is newer than most dialects
STICKS = [name for name in ("RC_CHANNELS_OVERRIDE", "RC_CHANNELS_OVERRIDE_V2", "MANUAL_CONTROL") if name in IDS]


@pytest.mark.parametrize("name", STICKS)
def test_sticks_are_released_on_all_channels(tracker: FlushTracker, make: Make, name: str) -> None:
    send(tracker, make(name, sysid=TRACKER, compid=3))
    (closing,) = tracker.flush(GCSA)
    assert not closing.incomplete
    ((what, [message]),) = read([closing])
    assert what == "RC override released"
    assert (origin(message), aim(message)) == ((TRACKER, 3), (VEHICLE, 1))
    assert message.get_type() == "RC_CHANNELS_OVERRIDE"
    channels = [getattr(message, f"chan{number}_raw") for number in range(1, 19)]
    assert channels == [0] * 8 + [65534] * 10


ONLY_PLACE, PLACE_AND_VELOCITY, ONLY_VELOCITY, ONLY_ACCELERATION = (
    0b110111111000,
    0b110111000000,
    0b110111000111,
    0b110000111111,
)


@pytest.mark.parametrize("name", ["SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"])
@pytest.mark.parametrize(
    ("mask", "stream"),
    [(ONLY_PLACE, False), (PLACE_AND_VELOCITY, True), (ONLY_VELOCITY, True), (ONLY_ACCELERATION, True)],
)
def test_a_velocity_is_stopped_and_a_place_is_flown_to(
    tracker: FlushTracker, make: Make, name: str, mask: int, stream: bool
) -> None:
    send(tracker, make(name, type_mask=mask))
    closed = read(tracker.flush(GCSA))
    assert [what for what, _ in closed] == (["guided stream stopped"] if stream else [])
    for _, [message] in closed:
        assert message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"
        assert (origin(message), aim(message)) == ((GCSA, 190), (VEHICLE, 1))
        assert message.type_mask == ONLY_VELOCITY
        values = [message.time_boot_ms, message.lat_int, message.lon_int, message.alt, message.vx, message.vy]
        values += [message.vz, message.afx, message.afy, message.afz, message.yaw, message.yaw_rate]
        assert values == [0] * 12


def test_an_attitude_stream_is_stopped(tracker: FlushTracker, make: Make) -> None:
    send(tracker, make("SET_ATTITUDE_TARGET"))
    assert [what for what, _ in read(tracker.flush(GCSA))] == ["guided stream stopped"]


@pytest.mark.parametrize(
    ("name", "fields", "over"),
    [
        ("SET_POSITION_TARGET_LOCAL_NED", {"type_mask": ONLY_PLACE}, True),
        ("COMMAND_INT", {"command": 192}, True),
        ("COMMAND_LONG", {"command": 176}, True),
        ("COMMAND_LONG", {"command": 17}, True),
        ("COMMAND_LONG", {"command": 20}, True),
        ("COMMAND_LONG", {"command": 21}, True),
        ("COMMAND_LONG", {"command": 22}, True),
        ("COMMAND_LONG", {"command": 300}, True),
        ("COMMAND_LONG", {"command": 178}, False),
        ("SET_MODE", {"custom_mode": 6}, True),
        ("MISSION_ITEM_INT", {"current": 2}, True),
        ("MISSION_ITEM", {"current": 2}, True),
        ("MISSION_ITEM_INT", {"current": 0}, False),
    ],
)
def test_a_stream_that_another_aim_has_replaced_is_over(
    tracker: FlushTracker, make: Make, name: str, fields: dict[str, int], over: bool
) -> None:
    """The aircraft flies to the new place: to stop it there would be no flush but a command."""
    send(tracker, make("SET_POSITION_TARGET_LOCAL_NED", type_mask=ONLY_VELOCITY))
    tracker.saw(make(name, **fields), FORWARDED, GCSA)
    assert (tracker.flush(GCSA) == []) is over


@pytest.mark.parametrize("name", ["LOG_REQUEST_LIST", "LOG_REQUEST_DATA"])
def test_a_log_download_is_ended(tracker: FlushTracker, make: Make, name: str) -> None:
    send(tracker, make(name))
    ((what, [message]),) = read(tracker.flush(GCSA))
    assert (what, message.get_type()) == ("log download ended", "LOG_REQUEST_END")
    assert (origin(message), aim(message)) == ((GCSA, 190), (VEHICLE, 1))
    send(tracker, make(name), make("LOG_REQUEST_END"))
    assert tracker.flush(GCSA) == []


# ---- message rates --------------------------------------------------------------------------------------------------

#: SET_MESSAGE_INTERVAL, and RATES_COMPID
INTERVAL, OF_RATES = 511, 189
RAW_IMU, SCALED_IMU, VIBRATION, ATTITUDE = 27, 26, 241, 30


def rate(make: Make, msgid: float, interval_us: float, name: str = "COMMAND_LONG", **fields: Any) -> Frame:
    return make(name, command=INTERVAL, param1=msgid, param2=interval_us, **fields)


@pytest.mark.parametrize("name", ["COMMAND_LONG", "COMMAND_INT"])
def test_message_rates_are_set_to_the_default_by_the_companion_itself(
    tracker: FlushTracker, make: Make, name: str
) -> None:
    send(tracker, rate(make, RAW_IMU, 20_000, name), rate(make, VIBRATION, -1, name, target_component=0))
    ((what, messages),) = read(tracker.flush(GCSA))
    assert what == "default message rates restored: RAW_IMU VIBRATION"
    for message, msgid in zip(messages, (RAW_IMU, VIBRATION), strict=True):
        assert (message.get_type(), message.command, message.confirmation) == ("COMMAND_LONG", INTERVAL, 0)
        assert (origin(message), aim(message)) == ((VEHICLE, OF_RATES), (VEHICLE, 1))
        values = [getattr(message, f"param{number}") for number in range(1, 8)]
        assert values == [msgid, 0, 0, 0, 0, 0, 0]
    assert tracker.flush(GCSA) == []


def test_rates_that_need_no_reset_get_none(tracker: FlushTracker, make: Make) -> None:
    send(tracker, rate(make, ATTITUDE, 20_000))  # the companion restores its own
    send(tracker, make("COMMAND_LONG", command=178, param1=RAW_IMU, param2=5.0))  # no rate
    send(tracker, rate(make, RAW_IMU, 20_000, target_component=100))  # a camera's
    send(tracker, rate(make, SCALED_IMU, 20_000), rate(make, SCALED_IMU, 0))  # default again
    send(tracker, *(rate(make, no_id, 20_000) for no_id in (float("nan"), float("inf"), -1.0, 27.5, 1e6)))
    assert tracker.flush(GCSA) == []


def test_the_newest_32_rates_are_remembered(tracker: FlushTracker, make: Make) -> None:
    chosen = [name for name in sorted(IDS) if name.startswith(("CAMERA", "GIMBAL", "LOG", "PARAM", "RC", "SET"))][:33]
    assert len(chosen) == 33
    send(tracker, *(rate(make, IDS[name], 1e6) for name in ("RAW_IMU", *chosen[:31], "RAW_IMU", *chosen[31:])))
    ((what, _),) = read(tracker.flush(GCSA))
    assert what.removeprefix("default message rates restored: ").split() == [*chosen[2:31], "RAW_IMU", *chosen[31:]]


# ---- all of it ------------------------------------------------------------------------------------------------------


def test_what_was_flushed_is_forgotten(tracker: FlushTracker, make: Make) -> None:
    send(tracker, make("RC_CHANNELS_OVERRIDE"))
    assert len(tracker.flush(GCSA)) == 1
    assert tracker.flush(GCSA) == []


def test_stations_are_told_apart(tracker: FlushTracker, make: Make) -> None:
    send(tracker, make("RC_CHANNELS_OVERRIDE"))
    assert tracker.flush(GCSB) == []
    assert len(tracker.flush(GCSA)) == 1


@pytest.mark.parametrize("action", [action for action in Fate if action is not Fate.FORWARD])
def test_what_did_not_reach_the_autopilot_opened_nothing(tracker: FlushTracker, make: Make, action: Fate) -> None:
    verdict = Verdict(action, None, GateReason.NOT_IN_CONTROL, "")
    for name in ("MISSION_COUNT", "RC_CHANNELS_OVERRIDE", "SET_ATTITUDE_TARGET", "LOG_REQUEST_LIST"):
        tracker.saw(make(name, sysid=GCSB), verdict, GCSB)
    tracker.saw(ftp(make, 6, b"x"), verdict, GCSB)
    assert tracker.flush(GCSB) == []


def test_frames_addressed_to_a_component_are_closed_at_that_component(tracker: FlushTracker, make: Make) -> None:
    send(tracker, make("MISSION_COUNT", target_component=0), ftp(make, 6, b"x"))
    send(tracker, make("FILE_TRANSFER_PROTOCOL", compid=7, target_component=100, payload=ftp_request(6, b"y")))
    closed = [message for _, messages in read(tracker.flush(GCSA)) for message in messages]
    assert [aim(message) for message in closed] == [(1, 1), (1, 1), (1, 100)]


def test_what_is_remembered_of_a_station_is_bounded(tracker: FlushTracker, make: Make) -> None:
    for compid in range(1, 256):
        send(tracker, make("RC_CHANNELS_OVERRIDE", compid=compid), ftp(make, 6, b"x", compid=compid))
        send(tracker, make("MISSION_COUNT", compid=compid), make("SET_ATTITUDE_TARGET", compid=compid))
    closings = tracker.flush(GCSA)
    assert len(closings) == 4 * 8
    assert {origin(message)[1] for _, messages in read(closings) for message in messages} == set(range(248, 256))


def test_an_entry_that_is_used_again_is_not_the_oldest(tracker: FlushTracker, make: Make) -> None:
    for compid in (1, 2, 3, 4, 5, 6, 7, 8, 1, 9):
        send(tracker, make("RC_CHANNELS_OVERRIDE", compid=compid))
    components = [origin(message)[1] for _, [message] in read(tracker.flush(GCSA))]
    assert components == [3, 4, 5, 6, 7, 8, 1, 9]


@given(st.sampled_from(sorted(mavlink.mavlink_map)), st.binary(min_size=0, max_size=255), st.integers(0, 255))
def test_whatever_a_frame_holds_nothing_raises(msgid: int, contents: bytes, sysid: int) -> None:
    size = mavlink.mavlink_map[msgid].unpacker.size
    frame = Frame(b"", 2, msgid, sysid, 1, 0, False, contents.ljust(size, b"\0")[:size], True)
    tracker = FlushTracker(VEHICLE)
    tracker.saw(frame, FORWARDED, GCSA)
    tracker.note_reply(frame)
    for closing in [*tracker.arming(), *tracker.flush(GCSA)]:
        for raw in closing.frames:
            assert mavlink.MAVLink(None).decode(bytearray(raw)).get_srcSystem() in (sysid, VEHICLE)

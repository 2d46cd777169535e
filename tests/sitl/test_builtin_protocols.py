# SPDX-License-Identifier: GPL-3.0-or-later

"""The built-in vehicle speaks like ArduCopter: missions, parameters, commands, streams, routing, garbage.

The expected answers were read off ArduCopter's SITL program (version 4.7.0-dev) doing the same.
"""

from __future__ import annotations

import math
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.bench import Bench
from sitl.vehicles.builtin.frame import shift
from sitl.vehicles.builtin.framing import FrameSplitter, decode
from sitl.vehicles.builtin.items import Item, Result, stored
from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.builtin.terrain import Ground

ACCEPTED, ERROR, BAD_FRAME, UNSUPPORTED, NO_SPACE = 0, 1, 2, 3, 4
INVALID_SEQUENCE, DENIED, CANCELLED = 13, 14, 15
MISSION, FENCE, RALLY = 0, 1, 2
STATION_A, STATION_B = (251, 190), (252, 190)


@pytest.fixture
def bench() -> Bench:
    bench = Bench(channels=(1, 2))
    bench.run(11.0)
    return bench


def request(index: int, kind: int = MISSION) -> dialect.MAVLink_message:
    return dialect.MAVLink_mission_request_int_message(1, 1, index, kind)


def count(number: int, kind: int = MISSION) -> dialect.MAVLink_message:
    return dialect.MAVLink_mission_count_message(1, 1, number, kind)


def item_message(seq: int, item: Item, kind: int = MISSION) -> dialect.MAVLink_message:
    head = (1, 1, seq, item.frame, item.command, 0, 1, *item.params)
    return dialect.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, kind)


# -- what is kept of an item ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sent", "read_back"),
    [
        (
            Item(16, 6, 2.7, 3, 4, math.nan, 526798000, 59240000, 25.123),
            Item(16, 3, 2, 0, 0, 0, 526798000, 59240000, 25.12),
        ),
        (Item(16, 0, 0, 0, 0, 0, 526793000, 59245000, 35.0), Item(16, 0, 0, 0, 0, 0, 526793000, 59245000, 35.0)),
        (Item(22, 3, 15, 1, 2, math.nan, 0, 0, 20.0), Item(22, 3, 15, 0, 0, 0, 0, 0, 20.0)),
        (Item(19, 3, 3, 0, -50, 1, 526798000, 59250000, 25.0), Item(19, 3, 3, 0, -1, 1, 526798000, 59250000, 25.0)),
        (Item(17, 3, 0, 0, -30, 0, 526793000, 59245000, 35.0), Item(17, 3, 0, 0, -30, 0, 526793000, 59245000, 35.0)),
        (Item(21, 3, 0, 0, 0, math.nan), Item(21, 3, 0, 0, 0, 1)),
        (Item(20, 2, 0, 0, 0, 0, 5, 6, 7.0), Item(20, 0)),
        (Item(178, 6, 1, 8, -1, 0), Item(178, 0, 1, 8, -1, 0)),
        (Item(177, 2, 6, 1, 0, 0), Item(177, 0, 6, 1, 0, 0)),
        (Item(112, 3, 2.5), Item(112, 0, 2.5)),
    ],
)
def test_items_come_back_as_the_autopilot_stores_them(sent: Item, read_back: Item) -> None:
    kept = stored(sent)
    assert isinstance(kept, Item)
    assert kept.z == pytest.approx(read_back.z, abs=1e-5)
    assert (kept.command, kept.frame, kept.params, kept.x, kept.y) == (
        read_back.command,
        read_back.frame,
        read_back.params,
        read_back.x,
        read_back.y,
    )


@pytest.mark.parametrize(
    ("item", "result"),
    [
        (Item(9999), Result.UNSUPPORTED),
        (Item(5100, 3), Result.UNSUPPORTED),
        (Item(0), Result.INVALID),
        (Item(16, 7), Result.UNSUPPORTED_FRAME),
        (Item(16, 3, math.nan), Result.INVALID_PARAM1),
        (Item(20, 3, 0, 0, 0, math.inf), Result.INVALID_PARAM4),
        (Item(16, 3, x=900000001), Result.INVALID_PARAM5_X),
        (Item(16, 3, y=-1800000001), Result.INVALID_PARAM6_Y),
        (Item(16, 3, z=math.nan), Result.INVALID_PARAM7),
    ],
)
def test_items_that_cannot_be_stored_are_refused_with_their_reason(item: Item, result: Result) -> None:
    assert stored(item) is result


# -- mission protocol -------------------------------------------------------------------------------------------------


def test_item_zero_reads_back_as_home_whatever_was_written(bench: Bench) -> None:
    items = [Item(16, 0, x=520000000, y=50000000), Item(22, 3, z=20.0)]
    assert bench.upload(items) == ACCEPTED
    assert bench.download() == [Item(16, 0, x=526790000, y=59240000, z=10.0), Item(22, 3, z=20.0)]


def test_home_alone_counts_as_one_item_until_the_mission_is_cleared(bench: Bench) -> None:
    assert len(bench.download()) == 1
    ack = bench.ask(dialect.MAVLink_mission_clear_all_message(1, 1, MISSION), "MISSION_ACK")
    assert ack.type == ACCEPTED
    assert bench.download() == []


def test_rally_points_keep_whole_metres_and_their_frame(bench: Bench) -> None:
    sent = [
        Item(5100, 3, 1, 2, 3, 4, 526797000, 59235000, 20.7),
        Item(5100, 0, x=526790000, y=59300000, z=30.0),
    ]
    assert bench.upload(sent, RALLY) == ACCEPTED
    assert bench.download(RALLY) == [
        Item(5100, 3, x=526797000, y=59235000, z=20.0, autocontinue=0),
        Item(5100, 0, x=526790000, y=59300000, z=30.0, autocontinue=0),
    ]
    assert bench.vehicle.parameters["RALLY_TOTAL"] == 2


def test_a_fence_is_stored_and_given_back(bench: Bench) -> None:
    corners = [(526700000, 59100000), (526700000, 59400000), (526900000, 59400000)]
    assert bench.upload([Item(5001, 3, 3, x=x, y=y) for x, y in corners], FENCE) == ACCEPTED
    assert bench.download(FENCE) == [Item(5001, 0, 3, x=x, y=y, autocontinue=0) for x, y in corners]


@pytest.mark.parametrize(
    "bad",
    [
        [(5001, 3), (5001, 3)],
        [(5001, 2), (5001, 2)],
        [(5001, 3), (5001, 3), (5002, 3)],
        [(5001, 3), (5001, 4), (5001, 3)],
        [(5001, 3), (5003, 50), (5001, 3), (5001, 3)],
        [(5004, 0)],
    ],
    ids=["cut short", "two corners", "another kind", "another number", "a circle inside", "no radius"],
)
def test_what_is_no_fence_leaves_the_fence_of_before(bench: Bench, bad: list[tuple[int, float]]) -> None:
    good = [Item(5003, 0, 50.5, x=526790000, y=59240000, autocontinue=0)]
    assert bench.upload(good, FENCE) == ACCEPTED
    assert bench.upload([Item(kind, 0, size, x=526700000, y=59100000) for kind, size in bad], FENCE) == ERROR
    assert bench.download(FENCE) == good


def test_two_polygons_and_a_circle_are_a_fence(bench: Bench) -> None:
    items = [Item(5002, 0, 3, x=n, y=n, autocontinue=0) for n in range(1, 7)]
    items.append(Item(5004, 0, 7.5, x=9, y=9, autocontinue=0))
    assert bench.upload(items, FENCE) == ACCEPTED
    assert bench.download(FENCE) == items
    assert bench.vehicle.parameters["FENCE_TOTAL"] == 7


@pytest.mark.parametrize(
    ("items", "kind", "result"),
    [
        ([Item(9999)] * 2, MISSION, ACCEPTED + 3),
        ([Item(16, 7)] * 2, MISSION, BAD_FRAME),
        ([Item(16, 3, x=1, y=1)], RALLY, UNSUPPORTED),
        ([Item(16), Item(177, 2, 5, 1)], MISSION, ERROR),
        ([], 5, UNSUPPORTED),
    ],
)
def test_a_bad_item_ends_the_upload_with_its_reason(bench: Bench, items: list[Item], kind: int, result: int) -> None:
    assert bench.upload(items, kind) == result
    assert bench.ask(item_message(1, Item(16)), "MISSION_ACK").type == ERROR  # no upload runs any more


def test_too_many_items_are_refused_before_anything_is_lost(bench: Bench) -> None:
    bench.upload([Item(16), Item(22, 3, z=20.0)])
    assert bench.ask(count(5000), "MISSION_ACK").type == NO_SPACE
    assert bench.texts()[-1] == "Only 650 items are supported"
    assert len(bench.download()) == 2


def test_an_upload_belongs_to_the_station_that_began_it(bench: Bench) -> None:
    bench.send(count(3), source=STATION_A)
    assert bench.ask(count(2), "MISSION_ACK", source=STATION_B).type == DENIED
    assert bench.ask(item_message(0, Item(16)), "MISSION_ACK", source=STATION_B).type == DENIED
    assert bench.ask(dialect.MAVLink_mission_request_list_message(1, 1, 0), "MISSION_ACK").type == DENIED
    assert bench.ask(item_message(0, Item(16)), "MISSION_REQUEST", source=STATION_A).seq == 1


def test_the_same_station_may_begin_its_upload_again(bench: Bench) -> None:
    bench.send(count(3), source=STATION_A)
    bench.send(item_message(0, Item(16)), source=STATION_A)
    assert bench.ask(count(2), "MISSION_REQUEST", source=STATION_A).seq == 0


def test_an_item_out_of_turn_does_not_end_the_upload(bench: Bench) -> None:
    bench.send(count(3))
    assert bench.ask(item_message(2, Item(16)), "MISSION_ACK").type == INVALID_SEQUENCE
    assert bench.ask(item_message(0, Item(16)), "MISSION_REQUEST").seq == 1


def test_a_silent_upload_is_asked_for_again_and_then_given_up(bench: Bench) -> None:
    start, start_s = len(bench.heard), bench.now_s
    bench.send(count(3))
    bench.run(12.0, until=lambda: bench.last("MISSION_ACK", start) is not None)
    assert bench.now_s - start_s == pytest.approx(8.0, abs=0.1)
    assert bench.last("MISSION_ACK", start).type == CANCELLED
    requests = [h for h in bench.heard[start:] if h.message.get_type() == "MISSION_REQUEST"]
    assert [h.message.seq for h in requests] == [0] * 8
    bench.run(0.1)
    assert bench.texts()[-1] == "Mission upload timeout"


def test_requests_beyond_the_end_tell_the_count_and_fail(bench: Bench) -> None:
    assert bench.ask(request(55), "MISSION_ACK").type == INVALID_SEQUENCE
    assert bench.last("MISSION_COUNT").count == 1


def test_the_old_request_is_answered_in_degrees_with_a_warning(bench: Bench) -> None:
    answer = bench.ask(dialect.MAVLink_mission_request_message(1, 1, 0, 0), "MISSION_ITEM")
    assert answer.x == pytest.approx(52.679, abs=1e-5)
    bench.run(0.1)
    assert bench.texts()[-1] == "got MISSION_REQUEST; use MISSION_REQUEST_INT!"


def test_the_old_item_message_is_taken_in_degrees(bench: Bench) -> None:
    bench.send(count(2))
    bench.send(item_message(0, Item(16)))
    old = dialect.MAVLink_mission_item_message(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, 52.5, 5.5, 20.0, 0)
    assert bench.ask(old, "MISSION_ACK").type == ACCEPTED
    assert (bench.download()[1].x, bench.download()[1].y) == (525000000, 55000000)


def test_set_current_answers_with_the_same_number(bench: Bench) -> None:
    bench.upload([Item(16), Item(22, 3, z=20.0), Item(16, 3, x=526800000, y=59240000, z=20.0)])
    assert bench.ask(dialect.MAVLink_mission_set_current_message(1, 1, 2), "MISSION_CURRENT").seq == 2
    assert bench.ask(dialect.MAVLink_mission_set_current_message(1, 1, 9), "MISSION_CURRENT") is None
    assert bench.vehicle.copter.mission.current == 2


def test_a_running_mission_cannot_be_cleared_in_flight(bench: Bench) -> None:
    bench.upload([Item(16), Item(22, 3, z=20.0), Item(17, 3, x=526800000, y=59240000, z=20.0)])
    for command in ((176, 1.0, 4.0), (400, 1.0), (300,)):
        assert bench.command(int(command[0]), *command[1:]) == ACCEPTED
    bench.run(8.0)
    assert bench.ask(dialect.MAVLink_mission_clear_all_message(1, 1, MISSION), "MISSION_ACK").type == ERROR
    assert len(bench.download()) == 3


# -- parameters -------------------------------------------------------------------------------------------------------


def test_a_parameter_set_is_answered_on_every_active_channel_and_cut_to_its_type(bench: Bench) -> None:
    bench.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), source=STATION_A, channel=2)
    start = len(bench.heard)
    bench.send(dialect.MAVLink_param_set_message(1, 1, b"RTL_ALT", 2000.7, 9))
    values = [h for h in bench.heard[start:] if h.message.get_type() == "PARAM_VALUE"]
    assert [(h.channel, h.message.param_value, h.message.param_type) for h in values] == [
        (1, 2000.0, 6),
        (2, 2000.0, 6),
    ]


@pytest.mark.parametrize(("name", "value"), [(b"NOPE", 1.0), (b"RTL_ALT", math.nan), (b"RTL_ALT", math.inf)])
def test_unknown_parameters_and_values_that_are_no_number_get_no_answer(
    bench: Bench, name: bytes, value: float
) -> None:
    assert bench.ask(dialect.MAVLink_param_set_message(1, 1, name, value, 9), "PARAM_VALUE") is None
    assert bench.vehicle.parameters["RTL_ALT"] == 1500.0


def test_the_list_holds_every_parameter_once_and_begins_with_the_banner(bench: Bench) -> None:
    bench.send(dialect.MAVLink_param_request_list_message(1, 1))
    bench.run(5.0)
    values = [h.message for h in bench.heard if h.message.get_type() == "PARAM_VALUE"]
    listed = {m.param_index: m.param_id for m in values if m.param_index != 65535}
    assert sorted(listed) == list(range(values[-1].param_count))
    assert len(set(listed.values())) == len(listed)
    assert bench.texts()[-2:] == ["ArduCopter V4.7.0-dev (builtin model)", "Frame: QUAD/PLUS"]


def test_parameters_are_read_by_name_and_by_index(bench: Bench) -> None:
    by_name = bench.ask(dialect.MAVLink_param_request_read_message(1, 1, b"RALLY_LIMIT_KM", -1), "PARAM_VALUE")
    assert (by_name.param_value, by_name.param_type) == (pytest.approx(0.3), 9)
    index = bench.vehicle.parameters.index("WPNAV_SPEED")
    by_index = bench.ask(dialect.MAVLink_param_request_read_message(1, 1, b"", index), "PARAM_VALUE")
    assert (by_index.param_id, by_index.param_index) == ("WPNAV_SPEED", index)


def test_files_are_read_with_comments_and_keep_values_for_scripts(tmp_path: Path) -> None:
    file = tmp_path / "a.parm"
    file.write_text("# comment\nRTL_ALT 3000 # cm\nHNDO_TIMEOUT,4\n\n", encoding="utf-8")
    table = ParameterTable()
    assert table.load(file) == 1
    assert table["RTL_ALT"] == 3000
    assert table.define("HNDO_TIMEOUT", 3.0)
    assert table["HNDO_TIMEOUT"] == 4.0
    assert not table.define("RTL_ALT", 1.0)


def test_a_bad_parameter_line_names_file_and_line(tmp_path: Path) -> None:
    file = tmp_path / "a.parm"
    file.write_text("RTL_ALT 3000\nRTL_ALT high\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"a\.parm:2: expected NAME VALUE, found 'RTL_ALT high'"):
        ParameterTable().load(file)


# -- commands ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "result"),
    [
        ((512, 148), ACCEPTED),
        ((512, 99999), 4),
        ((510, 33), ACCEPTED),
        ((510, 99999), 4),
        ((511, 99999, 100000), 2),
        ((520, 1), ACCEPTED),
        ((520, 0), 4),
        ((410,), ACCEPTED),
        ((401,), ACCEPTED),
        ((42428,), ACCEPTED),
        ((43000,), UNSUPPORTED),
        ((32100,), UNSUPPORTED),
        ((192, -1, 1), UNSUPPORTED),
        ((178, 1, 0), 2),
        ((178, 4, 3), 2),
        ((193, 2), 2),
        ((400, 0.5), UNSUPPORTED),
        ((224, 40), 2),
    ],
)
def test_commands_are_acknowledged_as_the_autopilot_does(bench: Bench, command: tuple[float, ...], result: int) -> None:
    assert bench.command(int(command[0]), *command[1:]) == result


def test_the_acknowledgement_goes_to_the_sender_on_its_channel(bench: Bench) -> None:
    start = len(bench.heard)
    message = dialect.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0)
    ack = bench.ask(message, "COMMAND_ACK", source=STATION_B, channel=2)
    assert (ack.target_system, ack.target_component, ack.result) == (*STATION_B, ACCEPTED)
    assert {h.channel for h in bench.heard[start:] if h.message.get_type() == "COMMAND_ACK"} == {2}


def test_home_set_by_a_station_stays_when_it_arms(bench: Bench) -> None:
    message = dialect.MAVLink_command_int_message(1, 1, 0, 179, 0, 0, 0, 0, 0, 0, 526801000, 59260000, 12.0)
    assert bench.ask(message, "COMMAND_ACK").result == ACCEPTED
    home = bench.last("HOME_POSITION")
    assert (home.latitude, home.longitude, home.altitude) == (526801000, 59260000, 12000)
    bench.command(176, 1, 4)
    bench.command(400, 1)
    assert bench.vehicle.mission_protocol is not None
    assert bench.download()[0] == Item(16, 0, x=526801000, y=59260000, z=12.0)


def test_reposition_outside_guided_needs_the_change_mode_flag(bench: Bench) -> None:
    bench.fly(10.0)
    bench.command(176, 1, 17)
    place = (526795000, 59240000, 20.0)
    denied = dialect.MAVLink_command_int_message(1, 1, 6, 192, 0, 0, -1, 0, 0, 0, *place)
    assert bench.ask(denied, "COMMAND_ACK").result == 2
    accepted = dialect.MAVLink_command_int_message(1, 1, 6, 192, 0, 0, -1, 1, 0, 0, *place)
    assert bench.ask(accepted, "COMMAND_ACK").result == ACCEPTED
    assert bench.vehicle.copter.mode.number == 4


def test_a_mode_change_is_told_by_a_heartbeat_at_once(bench: Bench) -> None:
    bench.run(0.5)
    start = len(bench.heard)
    bench.send(dialect.MAVLink_set_mode_message(1, 1, 6))
    beats = [h.message.custom_mode for h in bench.heard[start:] if h.message.get_type() == "HEARTBEAT"]
    assert beats == [6, 6]  # one on each channel


# -- telemetry --------------------------------------------------------------------------------------------------------


def rate_hz(bench: Bench, kind: str, seconds: float = 4.0) -> float:
    start = len(bench.heard)
    bench.run(seconds)
    return sum(h.channel == 1 and h.message.get_type() == kind for h in bench.heard[start:]) / seconds


def test_stream_requests_and_intervals_set_the_rate_of_one_channel(bench: Bench) -> None:
    assert rate_hz(bench, "GLOBAL_POSITION_INT") == 0
    bench.send(dialect.MAVLink_request_data_stream_message(1, 1, 6, 5, 1))
    assert rate_hz(bench, "GLOBAL_POSITION_INT") == 5
    bench.command(511, 33, 50000)
    assert rate_hz(bench, "GLOBAL_POSITION_INT") == 20
    bench.command(511, 33, 0)  # back to the stream's rate
    assert rate_hz(bench, "GLOBAL_POSITION_INT") == 5
    bench.command(511, 33, -1)
    assert rate_hz(bench, "GLOBAL_POSITION_INT") == 0
    assert rate_hz(bench, "LOCAL_POSITION_NED") == 5
    assert not [h for h in bench.heard if h.channel == 2 and h.message.get_type() == "GLOBAL_POSITION_INT"]


def test_overrides_of_the_station_that_it_obeys_are_shown_until_they_are_released_or_run_out(bench: Bench) -> None:
    def override(sysid: int, **channels: int) -> list[int]:
        values = [channels.get(f"chan{n}", 0xFFFF) for n in range(1, 19)]
        bench.send(dialect.MAVLink_rc_channels_override_message(1, 1, *values), (sysid, 190))
        return shown()

    def shown() -> list[int]:
        bench.command(512, 65)
        message = bench.last("RC_CHANNELS")
        return [getattr(message, f"chan{n}_raw") for n in (3, 9, 16, 17)]

    assert override(251, chan3=1200) == [0, 0, 0, 0], "it obeys 255"
    assert override(255, chan3=1200, chan9=1300, chan16=1400, chan17=1500) == [1200, 1300, 1400, 0]
    assert override(255, chan9=0) == [1200, 1300, 1400, 0], "0 leaves a channel above 8 alone"
    assert override(255, chan9=0xFFFE, chan3=0) == [0, 0, 1400, 0]
    bench.run(2.5)
    assert shown() == [0, 0, 1400, 0]
    bench.run(1.0)
    assert shown() == [0, 0, 0, 0]
    bench.send(dialect.MAVLink_request_data_stream_message(1, 1, 3, 5, 1))
    assert rate_hz(bench, "RC_CHANNELS") == 5


def test_heartbeat_every_second_and_system_time_tell_simulated_time(bench: Bench) -> None:
    assert rate_hz(bench, "HEARTBEAT") == 1
    bench.command(512, 2)
    assert bench.last("SYSTEM_TIME").time_boot_ms == pytest.approx(bench.now_s * 1000, abs=20)
    assert (
        bench.last("SYSTEM_TIME").time_unix_usec
        == 1_700_000_000_000_000 + bench.last("SYSTEM_TIME").time_boot_ms * 1000
    )


def test_position_is_zero_before_the_receiver_has_a_fix() -> None:
    bench = Bench({"MAV2_POSITION": 5, "MAV2_EXT_STAT": 5})
    bench.run(3.0)
    assert (bench.last("GLOBAL_POSITION_INT").lat, bench.last("GPS_RAW_INT").fix_type) == (0, 0)
    bench.run(8.0)
    assert (bench.last("GLOBAL_POSITION_INT").lat, bench.last("GPS_RAW_INT").fix_type) == (526790000, 6)


def test_the_simulations_own_state_is_told_without_a_fix_too() -> None:
    bench = Bench({"SIM_GPS1_ENABLE": 0})
    bench.run(1.0)
    bench.command(512, 108)
    bench.run(0.2)
    state = bench.last("SIM_STATE")
    assert (state.lat_int, state.lon_int, state.alt) == (526790000, 59240000, 10.0)
    assert (state.vn, state.ve, state.vd) == (0.0, 0.0, 0.0)


def test_landed_state_follows_the_flight(bench: Bench) -> None:
    bench.command(511, 245, 100000)
    bench.fly(10.0)
    bench.run(2.0)
    bench.command(21)
    bench.run(60.0, until=lambda: not bench.vehicle.copter.armed)
    states = [h.message.landed_state for h in bench.heard if h.message.get_type() == "EXTENDED_SYS_STATE"]
    changes = [state for i, state in enumerate(states) if i == 0 or state != states[i - 1]]
    assert changes == [1, 3, 2, 4, 1]  # on ground, take-off, in air, landing, on ground


def test_long_texts_travel_in_chunks_of_fifty(bench: Bench) -> None:
    bench.vehicle.text(6, "x" * 70)
    bench.run(0.1)
    chunks = [h.message for h in bench.heard if h.message.get_type() == "STATUSTEXT" and h.channel == 1][-2:]
    assert [(len(m.text), m.chunk_seq) for m in chunks] == [(50, 0), (20, 1)]
    assert chunks[0].id == chunks[1].id != 0


def test_timesync_is_answered_with_the_clock(bench: Bench) -> None:
    answer = bench.ask(dialect.MAVLink_timesync_message(0, 12345), "TIMESYNC")
    assert (answer.ts1, answer.tc1) == (12345, bench.vehicle.autopilot.micros() * 1000)


# -- routing and the sysid filter -------------------------------------------------------------------------------------


def test_a_message_for_a_station_on_the_other_channel_is_passed_on_unchanged(bench: Bench) -> None:
    bench.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), source=STATION_A, channel=2)
    start = len(bench.heard)
    bench.send(dialect.MAVLink_command_long_message(251, 190, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    passed = [h for h in bench.heard[start:] if h.message.get_type() == "COMMAND_LONG"]
    assert [(h.channel, h.message.get_srcComponent(), h.message.target_system) for h in passed] == [(2, 191, 251)]
    assert not bench.vehicle.copter.armed


def test_heartbeats_reach_the_other_active_channel(bench: Bench) -> None:
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    bench.send(beat, source=STATION_A, channel=2)
    start = len(bench.heard)
    bench.send(beat, source=STATION_B, channel=1)
    sources = [(h.channel, h.message.get_srcSystem()) for h in bench.heard[start:] if h.message.get_srcSystem() != 1]
    assert sources == [(2, 252)]


def test_a_private_channel_is_neither_forwarded_to_nor_from() -> None:
    bench = Bench({"MAV3_OPTIONS": 2}, channels=(1, 2))
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    bench.send(beat, source=STATION_A, channel=2)
    bench.send(beat, source=STATION_B, channel=1)
    assert [h for h in bench.heard if h.message.get_srcSystem() in (251, 252)] == []


def test_messages_for_another_vehicle_are_not_obeyed(bench: Bench) -> None:
    bench.send(dialect.MAVLink_command_long_message(7, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0))
    assert bench.vehicle.copter.mode.number == 0


def test_its_own_frames_coming_back_are_dropped(bench: Bench) -> None:
    bench.send(dialect.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0), source=(1, 1))
    assert bench.vehicle.copter.mode.number == 0


def test_enforcement_lets_only_the_station_and_own_components_in() -> None:
    bench = Bench({"MAV_OPTIONS": 1, "MAV_GCS_SYSID": 251})
    assert bench.command(176, 1, 6, source=STATION_B) is None
    assert bench.command(176, 1, 6, source=STATION_A) == ACCEPTED
    assert bench.command(176, 1, 9) == ACCEPTED


# -- garbage ----------------------------------------------------------------------------------------------------------


def test_frames_are_found_between_garbage_and_across_cuts() -> None:
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(dialect.MAVLink(None, 251, 190))
    stream = b"\x00\x11\x22" + beat + b"\xfd\x05\x80" + beat
    splitter, found = FrameSplitter(), []
    for index in range(len(stream)):
        found += splitter.push(stream[index : index + 1])
    assert [decode(frame) is not None for frame in found] == [True, True]
    assert splitter.skipped == 6


def test_a_frame_with_a_wrong_checksum_is_counted_and_ignored(bench: Bench) -> None:
    frame = bytearray(dialect.MAVLink_set_mode_message(1, 1, 6).pack(dialect.MAVLink(None, 1, 191)))
    frame[-1] ^= 0xFF
    bench.vehicle.receive(1, bytes(frame))
    assert bench.vehicle.bad_frames == 1
    assert bench.vehicle.copter.mode.number == 0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=20))
def test_arbitrary_bytes_never_raise(chunks: list[bytes]) -> None:
    bench = Bench()
    for chunk in chunks:
        bench.vehicle.receive(1, chunk)
    bench.run(0.05)


def test_arbitrary_payloads_in_sound_frames_never_raise() -> None:
    """Every message id, filled with random and with extreme bytes, on the ground and in flight."""
    rng = random.Random(20240817)
    for flying in (False, True):
        bench = Bench(channels=(1, 2))
        bench.run(11.0)
        if flying:
            bench.fly(10.0)
        encoder = dialect.MAVLink(None, 1, 191)
        for msgid, kind in dialect.mavlink_map.items():
            for filling in (bytes(range(256)), b"\xff" * 256, b"\x7f" * 256, rng.randbytes(256), rng.randbytes(256)):
                message = dialect.MAVLink_message(msgid, kind.msgname)
                payload = bytearray(filling[: kind.unpacker.size])
                for name, value in (("target_system", 1), ("target_component", 1)):
                    if name in kind.ordered_fieldnames and not any(kind.array_lengths):
                        payload[_offset(kind, name)] = value
                bench.vehicle.receive(rng.choice((1, 2)), message._pack(encoder, kind.crc_extra, bytes(payload)))
            bench.vehicle.step()
        bench.run(2.0)


def _offset(kind: type[dialect.MAVLink_message], name: str) -> int:
    """Offset of a one-byte field in a payload without arrays."""
    sizes = {"b": 1, "B": 1, "c": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8}
    letters = [letter for letter in kind.native_format.decode() if letter in sizes]
    return sum(sizes[letter] for letter in letters[: kind.ordered_fieldnames.index(name)])


# -- Remote ID --------------------------------------------------------------------------------------------------------


def operator_at(lat: int, *, whole: bool) -> dialect.MAVLink_message:
    if whole:
        return dialect.MAVLink_open_drone_id_system_message(0, 0, bytes(20), 1, 0, lat, 7, 1, 0, 0, 0, 0, 0, 2.0, 3)
    return dialect.MAVLink_open_drone_id_system_update_message(0, 0, lat, 7, 2.0, 3)


def test_the_transponder_gets_the_place_that_came_last() -> None:
    bench = Bench({"DID_ENABLE": 1, "DID_MAVPORT": 2}, channels=(1, 2))
    for whole, lat in ((True, 5), (False, 6)):
        bench.send(operator_at(lat, whole=whole))
        bench.run(1.5)
    own = [
        heard
        for heard in bench.heard
        if heard.message.get_type() == "OPEN_DRONE_ID_SYSTEM" and heard.message.get_srcComponent() == 1
    ]
    assert {heard.channel for heard in own} == {2}
    places = [heard.message.operator_latitude for heard in own]
    assert sorted(set(places), key=places.index)[-2:] == [5, 6]


def test_without_remote_id_nothing_goes_to_a_transponder() -> None:
    bench = Bench({"DID_MAVPORT": 2}, channels=(1, 2))
    bench.send(operator_at(5, whole=True))
    bench.run(1.5)
    assert not [each for each in bench.heard if each.message.get_type().startswith("OPEN_DRONE_ID")]


# -- terrain ----------------------------------------------------------------------------------------------------------


def answer_terrain(bench: Bench, start: int) -> int:
    """Answer each request since `start`: the ground rises 10 m from block to block to the north. Returns the next."""
    for heard in bench.heard[start:]:
        asked = heard.message
        if asked.get_type() != "TERRAIN_REQUEST" or heard.channel != 1:
            continue
        for bit in (each for each in range(56) if asked.mask >> each & 1):
            heights = [10 * (bit // 8)] * 16
            bench.send(dialect.MAVLink_terrain_data_message(asked.lat, asked.lon, asked.grid_spacing, bit, heights))
    return len(bench.heard)


def test_terrain_is_asked_for_until_all_is_there() -> None:
    bench = Bench({"TERRAIN_ENABLE": 1})
    bench.run(12.0)
    assert bench.last("TERRAIN_REPORT").pending > 0
    start = 0
    for _request in range(30):
        start = answer_terrain(bench, start)
        bench.run(2.1)
    report = bench.last("TERRAIN_REPORT")
    assert (report.pending, report.spacing) == (0, 100)
    assert report.loaded % 56 == 0
    assert report.loaded >= 4 * 56
    quiet = len(bench.heard)
    bench.run(5.0)
    assert bench.last("TERRAIN_REQUEST", quiet) is None


def test_without_its_parameter_no_terrain_is_asked_for() -> None:
    bench = Bench()
    bench.run(15.0)
    assert bench.last("TERRAIN_REQUEST") is None
    assert bench.last("TERRAIN_REPORT") is None


def test_the_ground_at_a_place_is_between_the_four_around_it() -> None:
    ground = Ground(100)
    place = (520_100_000, 50_100_000)
    corner, north, east = ground.tile(*place)
    assert ground.height_m(*place) is None
    assert [corner for corner, _mask in ground.missing()] == [corner]
    block = int(north) // 4 * 8 + int(east) // 4
    rows = [[row] * 4 for row in range(4)]
    for bit in range(56):
        heights = [height + 4 * (bit // 8) for row in rows for height in row]
        ground.take(dialect.MAVLink_terrain_data_message(*corner, 100, bit, heights))
    assert ground.height_m(*place) == pytest.approx(north, abs=1e-6), "each step to the north is a metre higher"
    assert (ground.pending, ground.loaded) == (0, 56)
    ground.take(dialect.MAVLink_terrain_data_message(corner[0] + 1, corner[1], 100, block, [0] * 16))
    assert list(ground.tiles) == [corner], "a tile that is not wanted is passed over"


def test_an_item_above_terrain_is_flown_above_the_ground_there() -> None:
    bench = Bench({"TERRAIN_ENABLE": 1})
    copter = bench.vehicle.copter
    bench.run(12.0)
    start = 0
    for _request in range(30):
        start = answer_terrain(bench, start)
        bench.run(2.1)
    home = copter.home
    assert home is not None
    there = shift(home, 1000.0, 0.0)
    protocol = bench.vehicle.terrain
    rise_m = protocol.rise_m(*there, home)
    assert abs(rise_m) > 5.0
    place = copter.item_location(Item(16, 10, x=there[0], y=there[1], z=40.0), copter.location())
    assert place.alt_m == pytest.approx(40.0 + rise_m)
    assert copter.item_location(Item(16, 3, x=there[0], y=there[1], z=40.0), copter.location()).alt_m == 40.0

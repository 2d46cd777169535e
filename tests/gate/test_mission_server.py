# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's side of the mission protocol: what a program on the ground sends and what it hears, one by one."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.mission_server import AGAIN_S, PATIENCE_S, REMEMBERED_S, MissionServer, Turn
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.protocol_items import Flaw, filled, flaw, item_message, item_of, older_item_message

QGC, OTHER = (255, 190), (254, 190)
VEHICLE = (1, 1)
MISSION, ALL = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_ALL
ACCEPTED, DENIED = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_DENIED


def item(seq: int, lat_deg: float = 52.1, **changed: float) -> MissionItem:
    fields = {"param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": 0.0, "lon_deg": 5.9, "alt_m": 40.0, **changed}
    return MissionItem(seq, 16, 3, lat_deg=lat_deg, **fields)  # type: ignore[arg-type]


def count(number: int) -> Any:
    return mavlink.MAVLink_mission_count_message(*VEHICLE, number, MISSION)


def sent(number: int, lat_deg: float = 52.1, **changed: float) -> Any:
    return item_message(item(number, lat_deg, **changed), VEHICLE, MISSION)


def clear(kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_clear_all_message(*VEHICLE, kind)


def read(number: int) -> Any:
    return mavlink.MAVLink_mission_request_int_message(*VEHICLE, number, MISSION)


def ack(result: int) -> Any:
    return mavlink.MAVLink_mission_ack_message(*VEHICLE, result, MISSION)


def words(turn: Turn) -> list[str]:
    """The answers, short: what is asked for or told, with its number."""
    named = {
        "MISSION_REQUEST_INT": lambda m: f"int {m.seq}",
        "MISSION_REQUEST": lambda m: f"item {m.seq}",
        "MISSION_ACK": lambda m: f"ack {m.type}",
        "MISSION_COUNT": lambda m: f"count {m.count}",
        "MISSION_ITEM_INT": lambda m: f"MISSION_ITEM_INT {m.seq} {m.x}",
        "MISSION_ITEM": lambda m: f"MISSION_ITEM {m.seq} {m.x:.5f}",
    }
    return [named[m.get_type()](m) for m in turn.answers]


def addressed(turn: Turn) -> set[tuple[int, int]]:
    return {(m.target_system, m.target_component) for m in turn.answers}


def server(*held: MissionItem) -> MissionServer:
    made = MissionServer(MISSION, most=700)
    made.offered = held or None
    return made


def upload(desk: MissionServer, number: int, now: float = 0.0) -> Turn:
    """All items, without a hitch; returns the turn at which the list is whole."""
    desk.handle(count(number), QGC, now)
    turns = [desk.handle(sent(seq), QGC, now) for seq in range(number)]
    return turns[-1]


def test_a_list_is_asked_for_item_by_item_and_answered_when_it_is_dealt_with() -> None:
    desk = server()
    assert words(desk.handle(count(3), QGC, 0.0)) == ["int 0"]
    assert words(desk.handle(sent(0), QGC, 0.1)) == ["int 1"]
    assert words(desk.handle(sent(1), QGC, 0.2)) == ["int 2"]
    whole = desk.handle(sent(2, 52.3), QGC, 0.3)
    assert words(whole) == []
    assert whole.whole is not None
    assert (whole.whole.sender, whole.whole.kind) == (QGC, MISSION)
    assert [(i.seq, i.lat_deg, i.alt_m) for i in whole.whole.items] == [
        (0, 52.1, 40.0),
        (1, 52.1, 40.0),
        (2, 52.3, 40.0),
    ]
    assert desk.sender == QGC
    done = desk.conclude(ACCEPTED, 1.0)
    assert words(done) == ["ack 0"]
    assert addressed(done) == {QGC}
    assert desk.sender is None


def test_while_it_is_dealt_with_the_last_item_is_asked_for_so_that_the_program_goes_on_waiting() -> None:
    desk = server()
    upload(desk, 2)
    assert words(desk.tick(AGAIN_S - 0.01)) == []
    assert words(desk.tick(AGAIN_S)) == ["item 1"]
    assert words(desk.handle(sent(1), QGC, 0.6)) == [], "the copy is nothing new"
    assert words(desk.tick(2 * AGAIN_S)) == ["int 1"]
    for turn in range(3, 100):  # as long as it takes
        assert len(desk.tick(turn * AGAIN_S).answers) == 1
    assert words(desk.conclude(DENIED, 60.0)) == [f"ack {DENIED}"]


def test_what_does_not_come_is_asked_for_again_in_both_forms_and_then_given_up() -> None:
    desk = server()
    desk.handle(count(2), QGC, 0.0)
    asked = [words(desk.tick(at * AGAIN_S)) for at in range(1, 4)]
    assert asked == [["item 0"], ["int 0"], ["item 0"]]
    over = desk.tick(PATIENCE_S)
    assert words(over) == [f"ack {mavlink.MAV_MISSION_OPERATION_CANCELLED}"]
    assert over.words == "the upload was given up: item 0 did not come"
    assert desk.sender is None
    assert words(desk.tick(20.0)) == []


def test_a_program_that_sends_the_older_items_is_asked_in_the_older_form() -> None:
    desk = server()
    desk.handle(count(2), QGC, 0.0)
    turn = desk.handle(older_item_message(item(0), VEHICLE, MISSION), QGC, 0.1)
    assert words(turn) == ["item 1"]
    whole = desk.handle(older_item_message(item(1), VEHICLE, MISSION), QGC, 0.2).whole
    assert whole is not None
    assert [i.lat_deg for i in whole.items] == [52.1, 52.1]


@pytest.mark.parametrize("stray", [0, 2, 65535], ids=["a copy", "one ahead", "out of range"])
def test_an_item_out_of_turn_changes_nothing_and_is_answered_by_nothing(stray: int) -> None:
    desk = server()
    desk.handle(count(3), QGC, 0.0)
    desk.handle(sent(0), QGC, 0.1)
    assert desk.handle(sent(stray, 10.0), QGC, 0.2) == Turn()
    assert words(desk.handle(sent(1), QGC, 0.3)) == ["int 2"]
    whole = desk.handle(sent(2), QGC, 0.4).whole
    assert whole is not None
    assert {i.lat_deg for i in whole.items} == {52.1}


def test_the_answer_is_given_again_to_a_copy_of_the_last_item_for_a_while() -> None:
    desk = server()
    upload(desk, 2)
    desk.conclude(ACCEPTED, 1.0)
    assert words(desk.handle(sent(1), QGC, 1.0 + REMEMBERED_S - 0.1)) == ["ack 0"]
    assert words(desk.handle(sent(0), QGC, 1.1)) == [], "not the last one"
    assert words(desk.handle(sent(1), OTHER, 1.1)) == [], "not its sender"
    assert words(desk.handle(sent(1), QGC, 1.0 + REMEMBERED_S)) == []


def test_another_sender_is_denied_while_an_upload_is_open_and_does_not_disturb_it() -> None:
    desk = server()
    desk.handle(count(2), QGC, 0.0)
    for message in (count(5), clear()):
        denied = desk.handle(message, OTHER, 0.1)
        assert words(denied) == [f"ack {DENIED}"]
        assert addressed(denied) == {OTHER}
        assert denied.words == "another upload is under way"
    assert desk.handle(sent(0, 10.0), OTHER, 0.2) == Turn()
    assert desk.handle(ack(mavlink.MAV_MISSION_OPERATION_CANCELLED), OTHER, 0.2) == Turn()
    assert words(desk.handle(sent(0), QGC, 0.3)) == ["int 1"]


def test_its_sender_may_begin_anew_but_not_while_the_list_is_dealt_with() -> None:
    desk = server()
    desk.handle(count(3), QGC, 0.0)
    desk.handle(sent(0, 10.0), QGC, 0.1)
    assert words(desk.handle(count(1), QGC, 0.2)) == ["int 0"]
    whole = desk.handle(sent(0, 52.1), QGC, 0.3).whole
    assert whole is not None
    assert [i.lat_deg for i in whole.items] == [52.1]
    assert desk.handle(count(7), QGC, 0.4) == Turn()
    assert desk.handle(clear(), QGC, 0.4) == Turn()
    assert words(desk.conclude(ACCEPTED, 0.5)) == ["ack 0"]
    assert words(desk.handle(count(7), QGC, 0.6)) == ["int 0"]


def test_its_sender_may_call_it_off_until_it_is_whole() -> None:
    desk = server()
    cancel = ack(mavlink.MAV_MISSION_OPERATION_CANCELLED)
    desk.handle(count(2), QGC, 0.0)
    assert desk.handle(ack(ACCEPTED), QGC, 0.1) == Turn(), "the end of a download"
    assert desk.handle(cancel, QGC, 0.1).words == "the upload was called off by its sender"
    assert desk.sender is None
    upload(desk, 1)
    assert desk.handle(cancel, QGC, 0.2) == Turn()
    assert desk.sender == QGC


@pytest.mark.parametrize("number", [701, 65535])
def test_too_many_items_are_refused_before_any_is_asked_for(number: int) -> None:
    turn = server().handle(count(number), QGC, 0.0)
    assert words(turn) == [f"ack {mavlink.MAV_MISSION_NO_SPACE}"]
    assert turn.words == f"{number} items (at most 700)"


def test_a_flood_of_counts_is_answered_each_and_leaves_one_upload() -> None:
    desk = server()
    for _ in range(1000):
        assert words(desk.handle(count(700), QGC, 0.0)) == ["int 0"]
    assert words(desk.tick(AGAIN_S)) == ["item 0"]


@pytest.mark.parametrize(
    ("changed", "result", "says"),
    [
        ({"lat_deg": 91.0}, mavlink.MAV_MISSION_INVALID_PARAM5_X, "item 0: latitude out of range"),
        ({"lon_deg": -180.1}, mavlink.MAV_MISSION_INVALID_PARAM6_Y, "item 0: longitude out of range"),
        ({"alt_m": math.nan}, mavlink.MAV_MISSION_INVALID_PARAM7, "item 0: altitude out of range"),
        ({"alt_m": math.inf}, mavlink.MAV_MISSION_INVALID_PARAM7, "item 0: altitude out of range"),
        ({"param1": math.inf}, mavlink.MAV_MISSION_INVALID_PARAM1, "item 0: parameter 1 is no number"),
        ({"param4": -math.inf}, mavlink.MAV_MISSION_INVALID_PARAM4, "item 0: parameter 4 is no number"),
    ],
)
def test_an_item_that_is_none_ends_the_upload_at_once(changed: dict[str, float], result: int, says: str) -> None:
    desk = server()
    desk.handle(count(2), QGC, 0.0)
    turn = desk.handle(sent(0, **changed), QGC, 0.1)
    assert (words(turn), turn.words) == ([f"ack {result}"], says)
    assert desk.sender is None


def test_a_parameter_that_is_left_open_is_0() -> None:
    assert filled(item_of(sent(4, param4=math.nan))) == item(4)


def test_the_holder_of_the_server_may_refuse_an_item() -> None:
    desk = MissionServer(MISSION, 700, lambda i: Flaw(3, "no such command") if i.seq == 1 else None)
    desk.handle(count(2), QGC, 0.0)
    assert words(desk.handle(sent(0), QGC, 0.1)) == ["int 1"]
    turn = desk.handle(sent(1), QGC, 0.1)
    assert (words(turn), turn.words) == (["ack 3"], "no such command")


def test_nothing_to_hold_is_a_list_as_well() -> None:
    for message, kind in ((count(0), MISSION), (clear(), MISSION), (clear(ALL), ALL)):
        desk = server(item(0), item(1))
        assert desk.knows(message)
        whole = desk.handle(message, QGC, 0.0).whole
        assert whole is not None
        assert (whole.items, whole.kind) == ((), kind)
        assert words(desk.tick(5.0)) == [], "there is no item to ask for"
        done = desk.conclude(DENIED, 5.0)
        assert [(m.type, m.mission_type) for m in done.answers] == [(DENIED, kind)]


def test_a_copy_of_a_clear_is_answered_as_the_clear_was() -> None:
    desk = server(item(0))
    desk.handle(clear(), QGC, 0.0)
    desk.conclude(DENIED, 0.1)
    again = desk.handle(clear(), QGC, 1.0)
    assert (words(again), again.whole) == ([f"ack {DENIED}"], None)
    assert desk.handle(clear(), QGC, 0.1 + REMEMBERED_S).whole is not None


def test_a_part_of_a_list_is_laid_into_what_is_offered() -> None:
    desk = server(item(0, 50.0), item(1, 51.0), item(2, 52.0))
    part = mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, 1, 1, MISSION)
    assert words(desk.handle(part, QGC, 0.0)) == ["int 1"]
    whole = desk.handle(sent(1, 10.0), QGC, 0.1).whole
    assert whole is not None
    assert [(i.seq, i.lat_deg) for i in whole.items] == [(0, 50.0), (1, 10.0), (2, 52.0)]


def test_a_part_may_go_on_behind_the_end_by_one_as_arducopter_has_it() -> None:
    desk = server(item(0, 50.0), item(1, 51.0))
    part = mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, 1, 2, MISSION)
    assert words(desk.handle(part, QGC, 0.0)) == ["int 1"]
    desk.handle(sent(1, 10.0), QGC, 0.1)
    whole = desk.handle(sent(2, 20.0), QGC, 0.1).whole
    assert whole is not None
    assert [(i.seq, i.lat_deg) for i in whole.items] == [(0, 50.0), (1, 10.0), (2, 20.0)]
    full = MissionServer(MISSION, most=2)
    full.offered = (item(0), item(1))
    assert words(full.handle(part, QGC, 0.0)) == [f"ack {mavlink.MAV_MISSION_ERROR}"]


@pytest.mark.parametrize("now_there", [(item(0, 50.0),), (item(0, 50.0), item(1, 51.0), item(2, 53.0)), (), None])
def test_a_part_of_a_list_that_has_changed_meanwhile_is_not_taken(now_there: tuple[MissionItem, ...] | None) -> None:
    """The fault: of a list that had become shorter the part was taken for the whole."""
    desk = server(item(0, 50.0), item(1, 51.0), item(2, 52.0))
    part = mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, 1, 2, MISSION)
    desk.handle(part, QGC, 0.0)
    desk.handle(sent(1, 10.0), QGC, 0.1)
    desk.offered = now_there
    turn = desk.handle(sent(2, 20.0), QGC, 0.2)
    assert (turn.whole, words(turn)) == (None, [f"ack {mavlink.MAV_MISSION_ERROR}"])
    assert turn.words == "the list has changed meanwhile"
    assert desk.sender is None


@pytest.mark.parametrize(("first", "last"), [(-1, 0), (0, 4), (2, 1), (-1, -1), (32767, 32767)])
def test_a_part_that_is_none_is_refused(first: int, last: int) -> None:
    part = mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, first, last, MISSION)
    for desk in (server(item(0), item(1), item(2)), server()):
        assert words(desk.handle(part, QGC, 0.0)) == [f"ack {mavlink.MAV_MISSION_ERROR}"]


def test_what_is_offered_is_read_in_both_forms_during_an_upload_too() -> None:
    desk = server(item(0, 50.0), item(7, 51.0))
    desk.handle(count(3), OTHER, 0.0)
    listed = mavlink.MAVLink_mission_request_list_message(*VEHICLE, MISSION)
    assert words(desk.handle(listed, QGC, 0.1)) == ["count 2"]
    assert words(desk.handle(read(1), QGC, 0.2)) == ["MISSION_ITEM_INT 1 510000000"]
    older = mavlink.MAVLink_mission_request_message(*VEHICLE, 0, MISSION)
    assert words(desk.handle(older, QGC, 0.3)) == ["MISSION_ITEM 0 50.00000"]
    assert words(desk.handle(read(2), QGC, 0.4)) == [f"ack {mavlink.MAV_MISSION_INVALID_SEQUENCE}"]
    desk.current = 1
    (shown,) = desk.handle(read(1), QGC, 0.5).answers
    assert shown.current == 1


def test_who_reads_what_is_not_known_is_told_so() -> None:
    desk = server()
    listed = mavlink.MAVLink_mission_request_list_message(*VEHICLE, MISSION)
    assert words(desk.handle(listed, QGC, 0.0)) == [f"ack {mavlink.MAV_MISSION_ERROR}"]
    assert words(desk.handle(read(0), QGC, 0.0)) == [f"ack {mavlink.MAV_MISSION_INVALID_SEQUENCE}"]
    part = mavlink.MAVLink_mission_request_partial_list_message(*VEHICLE, 0, 1, MISSION)
    assert words(desk.handle(part, QGC, 0.0)) == [f"ack {mavlink.MAV_MISSION_UNSUPPORTED}"]


def test_whoever_loses_control_loses_its_upload_and_is_told() -> None:
    desk = server()
    desk.handle(count(2), QGC, 0.0)
    over = desk.give_up("its sender no longer has authority", 1.0)
    assert words(over) == [f"ack {mavlink.MAV_MISSION_OPERATION_CANCELLED}"]
    assert addressed(over) == {QGC}
    assert over.words == "its sender no longer has authority"
    assert desk.give_up("again", 1.0) == Turn()
    assert desk.conclude(ACCEPTED, 1.0) == Turn()


def test_other_kinds_of_lists_are_not_its_business() -> None:
    desk = server()
    assert not desk.knows(mavlink.MAVLink_mission_count_message(*VEHICLE, 1, mavlink.MAV_MISSION_TYPE_RALLY))
    assert not desk.knows(mavlink.MAVLink_mission_count_message(*VEHICLE, 1, ALL))
    assert not desk.knows(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    assert desk.knows(count(1))
    assert desk.knows(clear(ALL))


def test_an_item_survives_the_way_there_and_back() -> None:
    flown = MissionItem(3, 19, 3, 5.0, 0.0, 1.0, 0.0, 52.6790123, 5.9240456, 37.5, auto_continue=False)
    packed = item_message(flown, VEHICLE, MISSION).pack(mavlink.MAVLink(None))
    again = mavlink.MAVLink(None).parse_buffer(packed)
    assert again is not None
    assert item_of(again[0]) == flown
    assert flaw(flown) is None


def test_the_integer_forms_of_frames_are_the_same_frames() -> None:
    message = item_message(item(0), VEHICLE, MISSION)
    for sent_as, kept in ((5, 0), (6, 3), (11, 10), (0, 0), (3, 3), (10, 10), (2, 2)):
        message.frame = sent_as
        assert item_of(message).frame == kept


def test_any_numbers_in_an_item_are_taken_or_refused_and_never_raise() -> None:
    patterns = (b"\0" * 4, b"\xff" * 4, b"\0\0\x80\x7f", b"\0\0\x80\xff", b"\x01\0\x80\x7f", b"\xff\xff\x7f\x7f")
    (floats,) = zip(*(struct.unpack("<f", p) for p in patterns), strict=True)
    for value in floats:
        for place in (-(2**31), -1, 0, 2**31 - 1):
            message = mavlink.MAVLink_mission_item_int_message(
                *VEHICLE, 0, 3, 16, 0, 1, value, value, value, value, place, place, value, MISSION
            )
            desk = server()
            desk.handle(count(1), QGC, 0.0)
            turn = desk.handle(message, QGC, 0.1)
            assert turn.whole is not None or words(turn)[0].startswith("ack ")


# ---- times and edges ------------------------------------------------------------------------------------------------


def part(first: int, last: int) -> Any:
    return mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, first, last, MISSION)


def test_an_item_is_asked_for_every_half_second_and_given_up_after_eight_seconds() -> None:
    desk = server()
    desk.handle(count(1), QGC, 0.0)
    asked = [words(desk.tick(at)) for at in (0.4, 0.5, 0.9, 1.0, 7.9, 8.3)]
    assert asked == [[], ["item 0"], [], ["int 0"], ["item 0"], []]
    assert desk.tick(8.4).words == "the upload was given up: item 0 did not come"


def test_each_item_that_comes_extends_the_time() -> None:
    desk = server()
    desk.handle(count(3), QGC, 0.0)
    for number in range(2):
        desk.tick(6.0 * number + 5.9)
        desk.handle(sent(number), QGC, 6.0 * number + 6.0)
    assert words(desk.tick(19.9)) == ["item 2"]
    assert desk.tick(20.5).words == "the upload was given up: item 2 did not come"


def test_the_next_item_is_asked_for_in_the_form_with_integers_again() -> None:
    desk = server()
    desk.handle(count(3), QGC, 0.0)
    assert words(desk.tick(0.5)) == ["item 0"]
    assert words(desk.handle(sent(0), QGC, 0.6)) == ["int 1"]


def test_the_answer_is_repeated_for_two_and_a_half_seconds_to_a_list_of_one_item_too() -> None:
    desk = server()
    upload(desk, 1)
    desk.conclude(ACCEPTED, 1.0)
    assert [words(desk.handle(sent(0), QGC, at)) for at in (1.1, 3.4, 3.5)] == [["ack 0"], ["ack 0"], []]


def test_an_upload_that_is_not_complete_is_not_concluded() -> None:
    desk = server()
    desk.handle(count(2), QGC, 0.0)
    assert desk.conclude(ACCEPTED, 0.1) == Turn()
    assert desk.sender == QGC
    assert words(desk.handle(sent(0), QGC, 0.2)) == ["int 1"]


def test_a_list_is_cleared_right_after_it_was_written_and_all_lists_after_one() -> None:
    desk = server()
    upload(desk, 2)
    desk.conclude(ACCEPTED, 0.1)
    assert desk.handle(clear(), QGC, 0.2).whole is not None
    desk.conclude(ACCEPTED, 0.3)
    assert desk.handle(clear(ALL), QGC, 0.4).whole is not None


def test_a_part_begins_at_the_first_item_and_ends_at_the_most_there_may_be() -> None:
    desk = MissionServer(MISSION, most=3)
    desk.offered = (item(0), item(1))
    assert words(desk.handle(part(0, 0), QGC, 0.0)) == ["int 0"]
    assert words(desk.handle(part(1, 2), QGC, 0.1)) == ["int 1"]
    assert words(desk.handle(part(0, 0), OTHER, 0.2)) == [f"ack {DENIED}"], "another upload is under way"


def test_nothing_is_called_off_when_nothing_is_under_way() -> None:
    assert server().handle(ack(mavlink.MAV_MISSION_OPERATION_CANCELLED), QGC, 0.0) == Turn()

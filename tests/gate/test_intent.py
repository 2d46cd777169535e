# SPDX-License-Identifier: GPL-3.0-or-later

"""What a frame of the commander wants: read out of the frame, whatever it holds."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.safety.commands import Kind
from mavproxy_handover.gate.intent import INTENT_MESSAGES, TARGET_MESSAGES, Aim, aim_of, intent_of, repeats, wish_of
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, Modes
from mavproxy_handover.wire.frames import Frame

Make = Callable[..., Frame]
GO_ON, FLY_TO, SPEED = Kind.GO_ON, Kind.FLY_TO, Kind.SPEED

#: frame -> kind, what people call it, and what else stands in it
WANTED: list[tuple[str, dict[str, Any], Kind, str, dict[str, Any]]] = [
    ("COMMAND_LONG", {"command": 176, "param2": 3.0}, GO_ON, "AUTO", {}),
    ("COMMAND_INT", {"command": 176, "param2": 3.0}, GO_ON, "AUTO", {}),
    ("SET_MODE", {"custom_mode": 3}, GO_ON, "AUTO", {}),
    ("COMMAND_LONG", {"command": 300}, GO_ON, "START", {}),
    ("COMMAND_LONG", {"command": 218, "param1": 16.0, "param2": 2.0}, GO_ON, "AUTO", {}),
    ("COMMAND_LONG", {"command": 193, "param1": 1.0}, GO_ON, "CONTINUE", {"auto_only": True}),
    ("COMMAND_LONG", {"command": 224, "param1": 7.0}, GO_ON, "item 7", {"item": 7}),
    ("COMMAND_LONG", {"command": 224, "param1": -1.0}, GO_ON, "item -1", {"item": -1}),
    ("COMMAND_LONG", {"command": 224, "param1": math.nan}, GO_ON, "item -1", {"item": -1}),
    ("MISSION_SET_CURRENT", {"seq": 65535}, GO_ON, "item 65535", {"item": 65535}),
    ("COMMAND_LONG", {"command": 178, "param2": 12.0}, SPEED, "speed", {"speed_mps": 12.0}),
    (
        "COMMAND_INT",
        {"command": 192, "frame": 0, "x": 521234567, "y": -59000000, "z": 40.0},
        FLY_TO,
        "target",
        {"aim": Aim(0, 52.1234567, -5.9, 40.0)},
    ),
    (
        "COMMAND_LONG",
        {"command": 192, "param5": 52.5, "param6": 6.25, "param7": 40.0},
        FLY_TO,
        "target",
        {"aim": Aim(3, 52.5, 6.25, 40.0)},
    ),
    (
        "MISSION_ITEM_INT",
        {"current": 2, "frame": 6, "x": 525000000, "y": 62500000, "z": 30.0, "command": 16},
        FLY_TO,
        "target",
        {"aim": Aim(6, 52.5, 6.25, 30.0)},
    ),
    (
        "MISSION_ITEM",
        {"current": 2, "frame": 3, "x": 52.5, "y": 6.25, "z": 30.0, "command": 16},
        FLY_TO,
        "target",
        {"aim": Aim(3, 52.5, 6.25, 30.0)},
    ),
]


@pytest.mark.parametrize(("name", "fields", "kind", "word", "more"), WANTED)
def test_what_a_frame_wants(
    make: Make, name: str, fields: dict[str, Any], kind: Kind, word: str, more: dict[str, Any]
) -> None:
    intent = intent_of(make(name, **fields))
    assert intent is not None
    assert (intent.kind, intent.word) == (kind, word)
    found = {key: getattr(intent, key) for key in ("item", "aim", "speed_mps", "auto_only")}
    assert found == {"item": None, "aim": None, "speed_mps": None, "auto_only": False, **more}


#: what leads away from danger, and what is no order to fly
NEVER_JUDGED: list[tuple[str, dict[str, Any]]] = [
    *(("COMMAND_LONG", {"command": 176, "param2": mode}) for mode in (0.0, 2.0, 4.0, 5.0, 6.0, 9.0, 16.0, 17.0, 21.0)),
    *(("SET_MODE", {"custom_mode": mode}) for mode in (0, 2, 5, 6, 9, 16, 17, 21, 27)),
    ("COMMAND_LONG", {"command": 20}),  # RTL
    ("COMMAND_LONG", {"command": 21}),  # LAND
    ("COMMAND_INT", {"command": 21}),
    ("COMMAND_LONG", {"command": 17}),  # LOITER
    ("COMMAND_LONG", {"command": 193, "param1": 0.0}),  # STOP
    ("COMMAND_LONG", {"command": 188}),  # return path
    ("COMMAND_LONG", {"command": 189}),  # landing sequence
    ("COMMAND_LONG", {"command": 185}),  # terminate
    ("COMMAND_LONG", {"command": 400, "param1": 0.0}),
    ("COMMAND_LONG", {"command": 42001}),  # the pause button
    ("MISSION_ITEM_INT", {"current": 0}),
    ("MISSION_ITEM_INT", {"current": 3}),
    ("MISSION_COUNT", {}),
    ("HEARTBEAT", {}),
]


@pytest.mark.parametrize(("name", "fields"), NEVER_JUDGED)
def test_what_is_never_judged(make: Make, name: str, fields: dict[str, Any]) -> None:
    assert intent_of(make(name, **fields)) is None


#: what else is judged of wings, where the place of a target is the middle of a circle, and a height alone is one
OF_WINGS: list[tuple[str, dict[str, Any], str, Aim]] = [
    *(
        (
            "COMMAND_INT",
            {"command": 192, "param3": radius, "frame": 3, "x": 525000000, "y": 62500000, "z": 40.0},
            "target",
            Aim(3, 52.5, 6.25, 40.0, radius_m=told),
        )
        for radius, told in (
            (0.0, 0.0),
            (300.7, 300.0),
            (1.9, 0.0),
            (2.0, 2.0),
            (-300.0, 0.0),
            (math.nan, 0.0),
            (1e9, 65535.0),
        )
    ),
    ("COMMAND_INT", {"command": 192, "param3": math.inf}, "target", Aim(0, 0.0, 0.0, 0.0, radius_m=65535.0)),
    ("COMMAND_LONG", {"command": 186, "param1": 500.0, "param2": 3.0}, "altitude", Aim(3, 0.0, 0.0, 500.0, here=True)),
    ("COMMAND_INT", {"command": 186, "param1": 500.0}, "altitude", Aim(0, 0.0, 0.0, 500.0, here=True)),
    ("COMMAND_LONG", {"command": 43001, "param7": 120.0}, "altitude", Aim(3, 0.0, 0.0, 120.0, here=True)),
    ("COMMAND_INT", {"command": 43001, "frame": 6, "z": 120.0}, "altitude", Aim(6, 0.0, 0.0, 120.0, here=True)),
]


@pytest.mark.parametrize(("name", "fields", "word", "aim"), OF_WINGS)
def test_what_a_frame_wants_of_wings(make: Make, name: str, fields: dict[str, Any], word: str, aim: Aim) -> None:
    intent = intent_of(make(name, **fields), PLANE.gate)
    assert intent is not None
    assert (intent.kind, intent.word, intent.aim) == (FLY_TO, word, aim)
    if word == "altitude":
        assert intent_of(make(name, **fields), COPTER.gate) is None


def test_an_item_of_an_upload_is_not_judged_of_wings_either(make: Make) -> None:
    assert intent_of(make("MISSION_ITEM_INT", current=0, frame=6, z=600.0), PLANE.gate) is None


@pytest.mark.parametrize(
    ("modes", "kinds"),
    [
        (COPTER.gate, {0.0: 0, 0.85: 0, 1.0: 1, 2.0: 2, 2.85: 2, 3.0: 3, 7.0: 3, math.nan: 0}),
        (PLANE.gate, {0.0: 0, 1.0: 1, 2.9: 2, 3.0: 3, 7.0: 7, 257.0: 1, math.inf: 0}),
    ],
)
def test_the_kind_of_a_speed_is_read_as_the_autopilot_reads_it(
    make: Make, modes: Modes, kinds: dict[float, int]
) -> None:
    for asked, kind in kinds.items():
        intent = intent_of(make("COMMAND_LONG", command=178, param1=asked, param2=12.0, param3=40.0), modes)
        assert intent is not None
        assert (intent.speed_mps, intent.speed_type, intent.throttle) == (12.0, kind, 40.0), asked


@pytest.mark.parametrize(
    ("name", "fields"),
    [("COMMAND_LONG", {"command": 300, "param1": 2.0, "param3": 40.0}), ("SET_MODE", {"custom_mode": 3})],
)
def test_what_is_no_speed_says_nothing_of_one(make: Make, name: str, fields: dict[str, Any]) -> None:
    intent = intent_of(make(name, **fields))
    assert intent is not None
    assert (intent.speed_mps, intent.speed_type, intent.throttle, intent.repeats) == (None, 0, 0.0, False)


def test_a_place_counts_as_a_place_and_not_as_a_height(make: Make) -> None:
    intent = intent_of(make("COMMAND_INT", command=192, frame=6, z=40.0))
    assert intent is not None
    assert intent.aim is not None
    assert intent.aim.here is False


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_may_be_any_mode_or_switch(make: Make, number: float) -> None:
    for fields in ({"command": 176, "param2": number}, {"command": 218, "param1": number, "param2": 2.0}):
        intent = intent_of(make("COMMAND_LONG", **fields))
        assert intent is not None
        assert (intent.kind, intent.word) == (GO_ON, "AUTO")


@pytest.mark.parametrize("name", ["COMMAND_LONG", "COMMAND_INT"])
def test_a_heading_leads_to_no_place_and_is_judged_no_more_than_a_velocity(make: Make, name: str) -> None:
    assert intent_of(make(name, command=43002, param2=90.0), PLANE.gate) is None


def test_a_repetition_is_told_by_its_counter_and_is_the_same_wish(make: Make) -> None:
    fields = {"command": 176, "param1": 1.0, "param2": 3.0}
    first, again = make("COMMAND_LONG", **fields), make("COMMAND_LONG", confirmation=1, **fields)
    other = make("COMMAND_LONG", **{**fields, "param2": 4.0})
    assert (repeats(first), repeats(again)) == (False, True)
    assert wish_of(first) == wish_of(again) != wish_of(other)
    assert wish_of(first) != wish_of(make("COMMAND_LONG", compid=7, **fields))
    intent = intent_of(again)
    assert intent is not None
    assert intent.repeats


#: what leads where nothing can tell, and the word for it
UNKNOWN: list[tuple[str, dict[str, Any], str]] = [
    ("SET_MODE", {"base_mode": 1, "custom_mode": 23}, "FOLLOW"),
    ("COMMAND_LONG", {"command": 176, "param1": 1.0, "param2": 23.0}, "FOLLOW"),
    ("COMMAND_INT", {"command": 176, "param1": 1.0, "param2": 23.0}, "FOLLOW"),
    ("COMMAND_LONG", {"command": 218, "param1": 57.0, "param2": 2.0}, "FOLLOW"),
    ("COMMAND_LONG", {"command": 32, "param1": 7.0}, "FOLLOW"),
    ("COMMAND_LONG", {"command": 601, "param1": 3.0}, "another item"),
]


@pytest.mark.parametrize(("name", "fields", "word"), UNKNOWN)
def test_what_leads_where_nothing_can_tell(make: Make, name: str, fields: dict[str, Any], word: str) -> None:
    """The fault: by FOLLOW, or by a label of the mission, an aircraft was sent anywhere and no limit was looked at."""
    intent = intent_of(make(name, **fields))
    assert intent is not None
    assert (intent.kind, intent.word, intent.aim, intent.item) == (Kind.UNKNOWN, word, None, None)


def test_a_plane_has_no_mode_follow(make: Make) -> None:
    assert intent_of(make("SET_MODE", base_mode=1, custom_mode=23), PLANE.gate) is None
    assert intent_of(make("COMMAND_LONG", command=176, param1=1.0, param2=23.0), PLANE.gate) is None


def test_of_wings_the_item_that_is_a_height_alone_is_judged(make: Make) -> None:
    """The fault: ArduPlane takes the height of MISSION_ITEM with current 3, and nothing looked at it."""
    frame = make("MISSION_ITEM_INT", current=3, frame=6, x=525000000, y=62500000, z=600.0)
    intent = intent_of(frame, PLANE.gate)
    assert intent is not None
    assert (intent.kind, intent.word, intent.aim) == (FLY_TO, "altitude", Aim(6, 0.0, 0.0, 600.0, here=True))
    assert intent_of(frame, COPTER.gate) is None


PLACE = {"command": 192, "param1": -1.0, "param2": 1.0, "param4": math.nan}
#: two forms of one act, and whether they are the same command to an operator who sends it again
FORMS: list[tuple[tuple[str, dict[str, Any]], tuple[str, dict[str, Any]], bool]] = [
    (
        ("COMMAND_LONG", {"command": 176, "param1": 1.0, "param2": 3.0}),
        ("SET_MODE", {"base_mode": 209, "custom_mode": 3}),
        True,
    ),
    (
        ("COMMAND_LONG", {"command": 176, "param1": 1.0, "param2": 3.0}),
        ("COMMAND_INT", {"command": 176, "param1": 1.0, "param2": 3.0, "frame": 3}),
        True,
    ),
    (("SET_MODE", {"base_mode": 1, "custom_mode": 3}), ("SET_MODE", {"base_mode": 1, "custom_mode": 4}), False),
    (("SET_MODE", {"base_mode": 1, "custom_mode": 3}), ("SET_MODE", {"base_mode": 0, "custom_mode": 3}), False),
    (("MISSION_SET_CURRENT", {"seq": 5}), ("COMMAND_LONG", {"command": 224, "param1": 5.0}), True),
    (("MISSION_SET_CURRENT", {"seq": 5}), ("COMMAND_INT", {"command": 224, "param1": 5.0}), True),
    (("MISSION_SET_CURRENT", {"seq": 5}), ("MISSION_SET_CURRENT", {"seq": 6}), False),
    (("MISSION_SET_CURRENT", {"seq": 5}), ("COMMAND_LONG", {"command": 224, "param1": 5.0, "param2": 1.0}), False),
    (
        ("COMMAND_INT", {**PLACE, "frame": 6, "x": 526823000, "y": 59240000, "z": 40.0}),
        ("COMMAND_LONG", {**PLACE, "param5": 52.6823, "param6": 5.924, "param7": 40.0}),
        True,
    ),
    (
        ("COMMAND_INT", {**PLACE, "frame": 3, "x": 526823000, "y": 59240000, "z": 40.0}),
        ("COMMAND_INT", {**PLACE, "frame": 0, "x": 526823000, "y": 59240000, "z": 40.0}),
        False,
    ),
    (
        ("COMMAND_INT", {**PLACE, "frame": 3, "x": 526823000, "y": 59240000, "z": 40.0}),
        ("COMMAND_INT", {**PLACE, "frame": 3, "x": 526833000, "y": 59240000, "z": 40.0}),
        False,
    ),
    (
        ("MISSION_ITEM_INT", {"current": 2, "frame": 6, "x": 526823000, "y": 59240000, "z": 40.0}),
        ("MISSION_ITEM", {"current": 2, "frame": 3, "x": 52.6823, "y": 5.924, "z": 40.0}),
        True,
    ),
    (("COMMAND_LONG", {"command": 300, "param1": 0.0}), ("COMMAND_INT", {"command": 300, "param1": 0.0}), True),
    (("COMMAND_LONG", {"command": 21}), ("COMMAND_INT", {"command": 21, "frame": 6}), True),
    (("COMMAND_LONG", {"command": 178, "param5": 6.0}), ("COMMAND_INT", {"command": 178, "x": 6}), True),
    (("COMMAND_LONG", {"command": 400, "param5": 6.0}), ("COMMAND_INT", {"command": 400, "x": 6}), True),
    (("COMMAND_LONG", {"command": 178, "param3": 40.0}), ("COMMAND_LONG", {"command": 178, "param3": 50.0}), False),
    (("COMMAND_LONG", {"command": 176, "param1": math.nan}), ("COMMAND_LONG", {"command": 176, "param1": 1.0}), False),
    (("COMMAND_LONG", {"command": 176, "param2": math.nan}), ("COMMAND_LONG", {"command": 176, "param2": 3.0}), False),
    (("SET_ATTITUDE_TARGET", {"thrust": 0.5}), ("SET_ATTITUDE_TARGET", {"thrust": 0.5}), True),
    (("SET_ATTITUDE_TARGET", {"thrust": 0.5}), ("SET_ATTITUDE_TARGET", {"thrust": 0.6}), False),
]


@pytest.mark.parametrize(("one", "other", "same"), FORMS)
def test_two_forms_of_one_act_are_the_same_wish(
    make: Make, one: tuple[str, dict[str, Any]], other: tuple[str, dict[str, Any]], same: bool
) -> None:
    assert (wish_of(make(one[0], **one[1])) == wish_of(make(other[0], **other[1]))) is same


@pytest.mark.parametrize(
    ("name", "fields", "quiet_s"),
    [("MISSION_SET_CURRENT", {"seq": 5}, 20.0), ("COMMAND_LONG", {"command": 224, "param1": 5.0}, 10.0)],
)
def test_how_long_programs_may_go_on_repeating_it(
    make: Make, name: str, fields: dict[str, Any], quiet_s: float
) -> None:
    """Mission Planner repeats MISSION_SET_CURRENT for up to 16 s."""
    intent = intent_of(make(name, **fields))
    assert intent is not None
    assert intent.quiet_s == quiet_s


@pytest.mark.parametrize(
    ("name", "fields", "aim"),
    [
        (
            "SET_POSITION_TARGET_GLOBAL_INT",
            {"coordinate_frame": 6, "lat_int": 525000000, "lon_int": -62500000, "alt": 30.0},
            Aim(6, 52.5, -6.25, 30.0),
        ),
        (
            "SET_POSITION_TARGET_LOCAL_NED",
            {"coordinate_frame": 9, "x": 10.0, "y": -5.0, "z": 1.0},
            Aim(9, 10.0, -5.0, 1.0),
        ),
    ],
)
def test_a_stream_s_target(make: Make, name: str, fields: dict[str, Any], aim: Aim) -> None:
    assert aim_of(make(name, type_mask=0b110111111000, **fields)) == aim
    for no_place in (0b1, 0b10, 0b100, 0b110111000111):
        assert aim_of(make(name, type_mask=no_place, **fields)) is None


@pytest.mark.parametrize("mask", [0b011, 0b001, 0b111, 0b101, 0b111000111])
def test_of_a_stream_wings_take_the_height_alone(make: Make, mask: int) -> None:
    """Up to ArduPlane 4.6 it flies to the height though the mask leaves that out, in nearly every mask."""
    fields = {"type_mask": mask, "coordinate_frame": 6, "lat_int": 525000000, "alt": 300.0}
    frame = make("SET_POSITION_TARGET_GLOBAL_INT", **fields)
    assert aim_of(frame, PLANE.gate) == Aim(6, 0.0, 0.0, 300.0, here=True)
    assert aim_of(frame) is None
    assert aim_of(make("SET_POSITION_TARGET_LOCAL_NED", type_mask=mask, z=-300.0), PLANE.gate) is None


@pytest.mark.parametrize(
    ("aim", "sense"),
    [
        (Aim(3, 52.0, 6.0, 40.0), True),
        (Aim(3, 90.0, -180.0, 40.0), True),
        (Aim(3, 90.1, 6.0, 40.0), False),
        (Aim(3, 52.0, -180.1, 40.0), False),
        (Aim(3, math.nan, 6.0, 40.0), False),
        (Aim(1, 5000.0, 6.0, -40.0), True),
        (Aim(1, 5000.0, math.inf, -40.0), False),
    ],
)
def test_a_target_that_is_no_place(aim: Aim, sense: bool) -> None:
    assert aim.makes_sense is sense


@given(st.sampled_from(sorted(INTENT_MESSAGES | TARGET_MESSAGES)), st.binary(max_size=64), st.integers(0, 65535))
def test_whatever_a_frame_holds_nothing_raises(msgid: int, contents: bytes, command: int) -> None:
    size = mavlink.mavlink_map[msgid].unpacker.size
    payload = bytearray(contents.ljust(size, b"\xff")[:size])
    if msgid in (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT):
        payload[28:30] = struct.pack("<H", command)
    frame = Frame(b"", 2, msgid, 251, 190, 0, False, bytes(payload), True)
    if msgid in TARGET_MESSAGES:
        aim_of(frame)
        aim_of(frame, PLANE.gate)
    else:
        intent_of(frame)
        intent_of(frame, PLANE.gate)
        wish_of(frame)

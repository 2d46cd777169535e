# SPDX-License-Identifier: GPL-3.0-or-later

"""Why something is refused, as the operator reads it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.gate.client_capabilities import Dialect
from mavproxy_handover.gate.judge import Fate, GateReason, judge
from mavproxy_handover.gate.policy.tables import COMMAND_RULES, MESSAGE_RULES
from mavproxy_handover.gate.refusal_text import (
    COMMANDS,
    MESSAGES,
    SWITCHES,
    called,
    how_to_lift,
    sentence,
    subject_of,
    thesis_command,
    unsaid,
)
from mavproxy_handover.vehicle.profiles import PLANE, UNKNOWN_MODES
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.frames import ftp_request
from tests.gate.ledger import GCSA, GCSB, TRACKER_OF_B, A, B

Make = Callable[..., Frame]
OF_A = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
NAMES = {e.name: number for number, e in mavlink.enums["MAV_CMD"].items()}


@pytest.fixture
def door() -> Door:
    """Station A commands, in flight."""
    door = Door(step_s=1.0)
    door.change(OF_A)
    return door


@pytest.mark.parametrize(
    ("name", "fields", "text"),
    [
        ("SET_MODE", {"custom_mode": 6}, "mode RTL refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 176, "param1": 1.0, "param2": 6.0}, "mode RTL refused: GCSA commands"),
        ("COMMAND_INT", {"command": 176, "param2": 4.0}, "mode GUIDED refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 176, "param2": 77.0}, "mode refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 176, "param2": float("nan")}, "mode refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 176, "param2": float("inf")}, "mode refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 400, "param1": 1.0}, "arm refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 400}, "disarm refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 300}, "START refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 193}, "STOP refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 193, "param1": 1.0}, "CONTINUE refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 20}, "RTL refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 21}, "LAND refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 22}, "take-off refused: GCSA commands"),
        ("COMMAND_INT", {"command": 192}, "target refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 181}, "relay refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 2500}, "video start capture refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 246}, "reboot refused: GCSA commands"),
        ("COMMAND_LONG", {"command": 42428}, "banner refused: in flight GCSA alone may ask"),
        ("COMMAND_LONG", {"command": 42700}, "debug trap refused: maintenance only, over no radio link"),
        ("COMMAND_LONG", {"command": 40001}, "unknown command refused: not known to this vehicle"),
        ("MISSION_COUNT", {"mission_type": 0}, "mission upload refused: GCSA commands"),
        ("MISSION_ITEM_INT", {"mission_type": 1}, "fence upload refused: GCSA commands"),
        ("MISSION_WRITE_PARTIAL_LIST", {"mission_type": 2}, "rally point upload refused: GCSA commands"),
        ("MISSION_CLEAR_ALL", {"mission_type": 255}, "removal of everything refused: GCSA commands"),
        ("MISSION_COUNT", {"mission_type": 77}, "unknown list refused: not known to this vehicle"),
        ("MISSION_ITEM", {"current": 2}, "target refused: GCSA commands"),
        ("MISSION_SET_CURRENT", {"seq": 3}, "another mission item refused: GCSA commands"),
        ("PARAM_SET", {"param_id": b"RTL_ALT"}, "parameter RTL_ALT refused: GCSA commands"),
        ("PARAM_SET", {"param_id": b"SIXTEEN_LETTERS_"}, "parameter SIXTEEN_LETTERS_ refused: GCSA commands"),
        ("PARAM_EXT_SET", {"param_id": b"CAM\x1b[2J\xff"}, "parameter CAM?[2J? refused: GCSA commands"),
        ("PARAM_REQUEST_LIST", {}, "parameter list refused: in flight GCSA alone may ask"),
        ("FILE_TRANSFER_PROTOCOL", {"payload": ftp_request(6, b"x")}, "file upload refused: GCSA commands"),
        ("FILE_TRANSFER_PROTOCOL", {"payload": ftp_request(13, b"x")}, "renaming a file refused: GCSA commands"),
        ("SET_HOME_POSITION", {}, "home position refused: GCSA commands"),
        ("SETUP_SIGNING", {}, "signing key refused: maintenance only, over no radio link"),
        ("LED_CONTROL", {}, "led control refused: GCSA commands"),
    ],
)
def test_an_observer_reads_what_was_refused_and_why(
    door: Door, make: Make, name: str, fields: dict[str, Any], text: str
) -> None:
    came = door.up(B, make(name, sysid=GCSB, **fields))
    assert came.verdict.fate is Fate.REFUSE
    assert door.said == [(GCSB, text)]
    assert door.faults == []


@pytest.mark.parametrize("opcode", [1, 2, 3, 4, 5, 14, 15])
def test_files_that_a_program_reads_by_itself_are_refused_in_silence(door: Door, make: Make, opcode: int) -> None:
    """MAVProxy reads the parameters as a file when it begins, and ends what it has left open."""
    came = door.up(B, make("FILE_TRANSFER_PROTOCOL", sysid=GCSB, payload=ftp_request(opcode, b"@SYS/x")))
    assert came.verdict.fate is Fate.REFUSE
    assert len(came.answers) == 1
    assert door.said == []


def test_what_is_locked_is_said_to_the_commander_too(door: Door, make: Make) -> None:
    door.up(A, make("PARAM_SET", sysid=GCSA, param_id=b"RTL_ALT"))
    door.up(A, make("COMMAND_LONG", sysid=GCSA, command=245))
    assert door.said == [
        (GCSA, "parameter RTL_ALT refused: locked while armed"),
        (GCSA, "parameter storage refused: locked while armed"),
    ]


@pytest.mark.parametrize(
    ("name", "fields", "text"),
    [
        (
            "COMMAND_LONG",
            {"command": 246, "param1": 3.0},
            "hold in the boot loader refused: maintenance only, over no radio link",
        ),
        ("COMMAND_INT", {"command": 246, "param1": 2.0}, "shutdown refused: maintenance only, over no radio link"),
        (
            "COMMAND_LONG",
            {"command": 246, "param1": 42.0},
            "reboot of this kind refused: maintenance only, over no radio link",
        ),
        ("COMMAND_LONG", {"command": 246, "param1": 1.0}, "reboot refused: locked while armed"),
        ("COMMAND_LONG", {"command": 208, "param1": 0.0}, "parachute off refused: locked while armed"),
        ("COMMAND_LONG", {"command": 208, "param1": 1.0}, "parachute on refused: locked while armed"),
        ("LOG_ERASE", {}, "erasing the logs refused: locked while armed"),
    ],
)
def test_the_commander_reads_why_in_flight(
    door: Door, make: Make, name: str, fields: dict[str, Any], text: str
) -> None:
    door.up(A, make(name, sysid=GCSA, **fields))
    assert door.said == [(GCSA, text)]


def test_in_a_rehearsal_everybody_is_told_that_nothing_arms(door: Door, make: Make) -> None:
    door.change(replace(OF_A, rehearsal=True))
    door.up(A, make("COMMAND_LONG", sysid=GCSA, command=300))
    door.up(A, make("COMMAND_LONG", sysid=GCSA, command=400, param1=1.0))
    door.up(B, make("COMMAND_LONG", sysid=GCSB, command=22))
    door.up(B, make("COMMAND_LONG", sysid=GCSB, command=21))
    assert door.said == [
        (GCSA, "START refused: a rehearsal is under way: nothing arms"),
        (GCSA, "arm refused: a rehearsal is under way: nothing arms"),
        (GCSB, "take-off refused: a rehearsal is under way: nothing arms"),
        (GCSB, "LAND refused: GCSA commands"),
    ]


def test_when_nobody_commands_it_says_so(door: Door, make: Make) -> None:
    door.change(replace(OF_A, commander=None, lease=LeaseState.LOST))
    door.up(A, make("COMMAND_LONG", sysid=GCSA, command=21))
    door.up(A, make("PARAM_REQUEST_LIST", sysid=GCSA))
    assert door.said == [
        (GCSA, "LAND refused: no station commands"),
        (GCSA, "parameter list refused: not in flight"),
    ]


def test_who_speaks_our_dialect_or_the_standard_reads_how_to_ask_for_control(door: Door, make: Make) -> None:
    capabilities = door.ports[GCSB].capabilities
    capabilities.show((GCSB, 190), Dialect.OURS, door.now)
    capabilities.show((TRACKER_OF_B, 190), Dialect.STANDARD, door.now)
    door.up(B, make("SET_MODE", sysid=GCSB, custom_mode=6))
    door.up(B, make("SET_MODE", sysid=TRACKER_OF_B, custom_mode=9))
    assert door.said == [
        (GCSB, "mode RTL refused: GCSA commands ('handover request')"),
        (GCSB, "mode LAND refused: GCSA commands (request control)"),
    ]


def test_each_sender_gets_the_result_that_it_knows(door: Door, make: Make) -> None:
    """A program without our module behind a station that has it."""
    door.ports[GCSB].capabilities.show((GCSB, 190), Dialect.OURS, door.now)
    results = []
    for sysid, compid in ((GCSB, 190), (GCSB, 191), (TRACKER_OF_B, 190)):
        (ack,) = door.up(B, make("COMMAND_LONG", sysid=sysid, compid=compid, command=21)).answers
        results.append(mavlink.MAVLink(None).decode(bytearray(ack)).result)
    assert results == [10, 2, 2]


def test_the_same_in_two_protocols_is_one_matter_and_another_commander_is_another(door: Door, make: Make) -> None:
    door.up(B, make("SET_MODE", sysid=GCSB, custom_mode=6))
    door.up(B, make("COMMAND_LONG", sysid=GCSB, command=176, param2=6.0))
    door.up(B, make("COMMAND_INT", sysid=GCSB, command=176, param2=6.0))
    assert door.said == [(GCSB, "mode RTL refused: GCSA commands")]
    door.up(B, make("SET_MODE", sysid=GCSB, custom_mode=9))
    door.change(replace(OF_A, commander=None))
    door.up(B, make("SET_MODE", sysid=GCSB, custom_mode=6))
    assert [text for _station, text in door.said[1:]] == [
        "mode LAND refused: GCSA commands",
        "mode RTL refused: no station commands",
    ]


def test_a_flood_is_told_of_once_and_makes_no_words(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[object] = []

    def counted(*arguments: Any, **more: Any) -> str:
        made.append(arguments)
        return sentence(*arguments, **more)

    monkeypatch.setattr("mavproxy_handover.gate.replies.sentence", counted)
    door = Door(step_s=0.001)
    door.change(OF_A)
    frame = make("COMMAND_LONG", sysid=GCSB, command=400, param1=1.0)
    for _ in range(9000):
        door.up(B, frame)
    assert len(door.said) == len(made) == 1
    for number in range(9000):
        door.up(B, make("PARAM_SET", sysid=GCSB, param_id=b"P%d" % number))
    assert len(door.said) == len(made) <= 1 + 10


def test_another_vehicles_modes_have_no_copters_names(door: Door, make: Make) -> None:
    door.modes = UNKNOWN_MODES
    door.up(B, make("SET_MODE", sysid=GCSB, custom_mode=6))
    assert door.said == [(GCSB, "mode refused: GCSA commands")]


def test_a_planes_modes_have_their_own_names(door: Door, make: Make) -> None:
    door.modes = PLANE.gate
    for number in (11, 21, 26):
        door.up(B, make("SET_MODE", sysid=GCSB, custom_mode=number))
    names = ("RTL", "QRTL", "AUTOLAND")
    assert door.said == [(GCSB, f"mode {name} refused: GCSA commands") for name in names]


def test_names_in_the_tables_are_names_of_the_dialect() -> None:
    """Or of what the policy knows and the installed dialect lacks."""
    policy = {name for rule in (*COMMAND_RULES, *MESSAGE_RULES) for name in rule.names}
    assert {*COMMANDS, *SWITCHES} <= {name.removeprefix("MAV_CMD_") for name in NAMES} | policy
    assert set(MESSAGES) <= {cls.msgname for cls in mavlink.mavlink_map.values()} | policy


def test_every_refusal_of_the_dialect_has_words_without_numbers(make: Make) -> None:
    """But for those that are part of a name."""
    seen = set()
    frames = [make(cls.msgname, sysid=GCSB) for cls in mavlink.mavlink_map.values()]
    frames += [make("COMMAND_LONG", sysid=GCSB, command=number) for number in NAMES.values() if number < 65536]
    for frame in frames:
        for view in (OF_A, replace(OF_A, armed=False)):
            verdict = judge(frame, B, view, 1)
            if verdict.fate is not Fate.REFUSE:
                continue
            text = sentence(subject_of(frame), verdict.reason, "GCSA", Dialect.OURS)
            seen.add(verdict.reason)
            words, _, why = text.partition(" refused: ")
            assert "" not in (words, why), text
            assert re.fullmatch(r"[ -^`-~]+", words), text
            assert not re.search(r"\b\d", words) or re.search(r"(user|waypoint|mag cal) ", words), text
            assert len(text) < 120, text
    assert seen >= {GateReason.NOT_IN_CONTROL, GateReason.COMMANDERS_IN_FLIGHT, GateReason.MAINTENANCE_ONLY}


def test_a_subject_says_what_it_is_called() -> None:
    assert called("arm") == "arm"
    assert called(6) == "mode RTL"
    assert called(6, modes=UNKNOWN_MODES) == "mode"
    assert called(6, modes=PLANE.gate) == "mode FLY_BY_WIRE_B"
    assert called(b"RTL_ALT\0\0\0\0\0\0\0\0\0") == "parameter RTL_ALT"


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (11.0, "auxiliary switch fence"),
        (300.0, "auxiliary switch scripting 1"),
        (65536.0 + 11.0, "auxiliary switch fence"),  # the autopilot keeps 16 bits
        (5555.0, "auxiliary switch"),
        (float("nan"), "auxiliary switch"),
        (float("inf"), "auxiliary switch"),
    ],
)
def test_an_auxiliary_switch_has_the_name_of_its_function(make: Make, number: float, name: str) -> None:
    assert subject_of(make("COMMAND_LONG", command=218, param1=number)) == name


@pytest.mark.parametrize(
    ("name", "fields", "left_open", "of_the_thesis"),
    [
        ("COMMAND_LONG", {"command": 300}, "", "START"),
        ("COMMAND_LONG", {"command": 193}, "STOP", "STOP"),
        ("COMMAND_INT", {"command": 193, "param1": 1.0}, "CONTINUE", "CONTINUE"),
        ("COMMAND_LONG", {"command": 400, "param1": 1.0}, "arm", ""),
        ("COMMAND_LONG", {"command": 21}, "", ""),
        ("COMMAND_LONG", {"command": 176, "param2": 6.0}, "mode RTL", ""),
        ("COMMAND_LONG", {"command": 218, "param1": 11.0}, "auxiliary switch fence", ""),
        ("SET_MODE", {"custom_mode": 6}, "mode RTL", ""),
        ("PARAM_SET", {"param_id": b"RTL_ALT"}, "parameter RTL_ALT", ""),
        ("MISSION_COUNT", {}, "", ""),
        ("HEARTBEAT", {}, "", ""),
    ],
)
def test_what_the_name_of_a_frame_leaves_open_and_the_commands_of_the_thesis(
    make: Make, name: str, fields: dict[str, Any], left_open: str, of_the_thesis: str
) -> None:
    frame = make(name, **fields)
    assert (unsaid(frame), thesis_command(frame)) == (left_open, of_the_thesis)
    unchecked = frame._replace(known=False)
    assert (unsaid(unchecked), thesis_command(unchecked)) == ("", "")


def test_the_operator_reads_how_to_lift_a_limit() -> None:
    assert how_to_lift(Limit.ENERGY, None) == "To lift it, type 'handover override energy'"
    assert how_to_lift(Limit.FENCE, 2.0) == "To insist, send it again after 2 s, or type 'handover override fence'"


@pytest.mark.parametrize(
    ("reason", "commander", "why"),
    [
        (GateReason.FILE_BUSY, "GCSA", "GCSA is using file transfer"),
        (GateReason.ABSENT, "GCSA", "there is no such file, use the mission protocol"),
        (GateReason.FILE_BUSY, "", "another station is using file transfer"),
        (GateReason.OTHER_TARGET, "GCSA", "other target"),
    ],
)
def test_a_reason_is_told_in_words(reason: GateReason, commander: str, why: str) -> None:
    assert sentence("reading files", reason, commander, Dialect.NONE) == f"reading files refused: {why}"

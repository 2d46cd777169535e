# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy is complete, has no stale names, and every row says why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason, judge
from mavproxy_handover.gate.policy.parameters import parameter_rule
from mavproxy_handover.gate.policy.rows import Access, begins_midway, classify, moves, takes_off
from mavproxy_handover.gate.policy.tables import (
    COMMAND_RULES,
    FTP_RULES,
    MESSAGE_RULES,
    MESSAGES_BY_PART,
    MISSION_TYPE_RULES,
    MISSION_TYPES,
    POLICY,
    Rule,
)
from mavproxy_handover.vehicle.profiles import ASSUMED
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import FTP_OPCODES, MISSION_START
from tests.gate.ledger import (
    ACCESS,
    ALL_COMMANDS,
    GCSA,
    UNBORN_COMMANDS,
    UNBORN_MESSAGES,
    VEHICLE,
    YOUNG_COMMANDS,
    YOUNG_MESSAGES,
    A,
    kind_of_command,
    kind_of_message,
)

DIALECT_MESSAGES = {cls.msgname for cls in mavlink.mavlink_map.values()}
DIALECT_COMMANDS = {
    entry.name.removeprefix("MAV_CMD_")
    for entry in mavlink.enums["MAV_CMD"].values()
    if entry.name != "MAV_CMD_ENUM_END"
}


def names(rules: tuple[Rule, ...]) -> list[str]:
    return [name for rule in rules for name in rule.names]


NEWER_MESSAGES = {*YOUNG_MESSAGES, *UNBORN_MESSAGES}
NEWER_COMMANDS = {*YOUNG_COMMANDS, *UNBORN_COMMANDS.values()}


def test_every_message_of_the_dialect_is_classified_and_no_name_is_stale() -> None:
    classified = names(MESSAGE_RULES) + list(MESSAGES_BY_PART)
    assert DIALECT_MESSAGES - set(classified) == set()
    assert set(classified) - DIALECT_MESSAGES <= NEWER_MESSAGES
    assert set(classified) >= NEWER_MESSAGES
    assert [name for name, count in Counter(classified).items() if count > 1] == []


def test_every_command_of_the_dialect_is_classified_and_no_name_is_stale() -> None:
    classified = names(COMMAND_RULES)
    assert DIALECT_COMMANDS - set(classified) == set()
    assert set(classified) - DIALECT_COMMANDS <= NEWER_COMMANDS
    assert set(classified) >= NEWER_COMMANDS
    assert [name for name, count in Counter(classified).items() if count > 1] == []


def test_what_is_newer_than_the_dialect_has_the_class_that_the_ledger_gives_it() -> None:
    """No frame can show it yet: these rows are compared by name."""
    messages = {name: rule.access for rule in MESSAGE_RULES for name in rule.names}
    assert {name: messages[name] for name in NEWER_MESSAGES} == {
        name: ACCESS[kind_of_message(name)] for name in NEWER_MESSAGES
    }
    commands = {name: rule.access for rule in COMMAND_RULES for name in rule.names}
    assert {name: commands[name] for name in UNBORN_COMMANDS.values()} == {
        name: ACCESS[kind_of_command(number, UNBORN_COMMANDS)] for number, name in UNBORN_COMMANDS.items()
    }


def test_what_the_installed_dialect_lacks_is_refused_whoever_sends_it(make: Callable[..., Frame]) -> None:
    commander, unborn = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD), 0
    for number in UNBORN_COMMANDS:
        if number in ALL_COMMANDS:
            continue
        unborn += 1
        for message in ("COMMAND_LONG", "COMMAND_INT"):
            verdict = judge(make(message, command=number), A, commander, VEHICLE)
            assert (verdict.fate, verdict.reason) == (Fate.REFUSE, GateReason.UNKNOWN_COMMAND)
    for msgid in (80, 412, 421):  # COMMAND_CANCEL, REQUEST_EVENT, RC_CHANNELS_OVERRIDE_V2
        if msgid in mavlink.mavlink_map:
            continue
        unborn += 1
        frame = make("HEARTBEAT")._replace(msgid=msgid, known=False, payload=bytes([VEHICLE, 1, 0, 0]))
        verdict = judge(frame, A, commander, VEHICLE)
        assert (verdict.fate, verdict.reason) == (Fate.DROP, GateReason.UNKNOWN_MESSAGE)
    if not unborn:
        pytest.skip("this pymavlink knows them all")


def test_every_file_transfer_opcode_is_classified_once() -> None:
    assert sorted(names(FTP_RULES)) == sorted(FTP_OPCODES.values())
    assert sorted(FTP_OPCODES) == [*range(17), 128, 129]


@pytest.mark.skipif("MAV_FTP_OPCODE" not in mavlink.enums, reason="this pymavlink has no MAV_FTP_OPCODE")
def test_opcodes_have_the_numbers_of_the_dialect() -> None:
    theirs = {
        entry.name.removeprefix("MAV_FTP_OPCODE_"): number
        for number, entry in mavlink.enums["MAV_FTP_OPCODE"].items()
        if not entry.name.endswith("ENUM_END")
    }
    renamed = {"ResetSessions": "RESETSESSION", "CalcFileCRC32": "CALCFILECRC", "Nack": "NAK"}
    ours = {renamed.get(name, name.upper()): number for number, name in FTP_OPCODES.items()}
    if "LISTDIRECTORYWITHTIME" not in theirs:  # newer than the dialect
        ours.pop("LISTDIRECTORYWITHTIME")
    assert ours == theirs


def test_every_mission_type_of_the_dialect_is_classified() -> None:
    theirs = {
        number: entry.name.removeprefix("MAV_MISSION_TYPE_")
        for number, entry in mavlink.enums["MAV_MISSION_TYPE"].items()
        if not entry.name.endswith("ENUM_END")
    }
    assert theirs == MISSION_TYPES
    assert sorted(names(MISSION_TYPE_RULES)) == sorted(MISSION_TYPES.values())


def test_every_row_gives_a_reason_and_none_is_there_twice() -> None:
    assert all(row.why for row in POLICY)
    assert [key for key, count in Counter((row.kind, row.name) for row in POLICY).items() if count > 1] == []


@pytest.mark.parametrize(
    ("name", "pattern"),
    [("HNDO_ENABLE", "HNDO_*"), ("SCR_ENABLE", "SCR_*"), ("FORMAT_VERSION", "FORMAT_VERSION"), ("X", "*")],
)
def test_the_rule_of_a_parameter_is_the_one_that_names_it(name: str, pattern: str) -> None:
    assert pattern in parameter_rule(name).names


def test_the_whole_policy_is_one_table() -> None:
    kinds = Counter(row.kind for row in POLICY)
    assert kinds["message"] == len(names(MESSAGE_RULES))
    assert kinds["command"] == len(names(COMMAND_RULES))
    assert kinds["command by parameter"] == 2
    assert kinds["file opcode"] == len(FTP_OPCODES)
    assert set(kinds) == {
        "message",
        "command",
        "command by parameter",
        "acknowledged command",
        "mission type",
        "mission type, read",
        "parameter",
        "auxiliary function",
        "file",
        "file opcode",
        "tunnel payload type",
    }
    assert {row.access for row in POLICY} == set(Access)


def test_start_is_the_command_of_the_standard() -> None:
    assert mavlink.MAV_CMD_MISSION_START == MISSION_START


def test_all_of_our_own_messages_are_the_companions_or_nobodys() -> None:
    """47100 to 47131 never reach the autopilot."""
    allowed = {Access.TRANSFER, Access.NEVER}
    ours = {cls.msgname for msgid, cls in mavlink.mavlink_map.items() if 47100 <= msgid <= 47131}
    assert len(ours) == 23
    for rule in MESSAGE_RULES:
        if ours & set(rule.names):
            assert rule.access in allowed, rule


def test_the_part_that_decides_is_read_from_the_payload(make: Callable[..., Frame]) -> None:
    assert classify(make("COMMAND_LONG", command=21)).what == "COMMAND_LONG/MAV_CMD_NAV_LAND"
    assert classify(make("COMMAND_INT", command=21)).what == "COMMAND_INT/MAV_CMD_NAV_LAND"
    assert classify(make("COMMAND_ACK", command=32100)).what == "COMMAND_ACK/MAV_CMD_REQUEST_OPERATOR_CONTROL"
    opcode = [9, 9, 9, 11, *[9] * 8, *b"file", *[0] * 235]
    assert classify(make("FILE_TRANSFER_PROTOCOL", payload=opcode)).what == "FILE_TRANSFER_PROTOCOL/OpenFileWO"
    assert classify(make("TUNNEL", payload_type=47116)).what == "TUNNEL/47116"
    assert classify(make("COMMAND_LONG", command=40001)).what == "COMMAND_LONG/40001"
    assert classify(make("MISSION_ITEM_INT", mission_type=2)).what == "MISSION_ITEM_INT/RALLY"
    assert classify(make("PARAM_SET", param_id=b"SCR_ENABLE")).what == "PARAM_SET/SCR_ENABLE"
    assert classify(make("HEARTBEAT")).what == "HEARTBEAT"


@pytest.mark.parametrize(
    ("command", "value", "word"),
    [
        ("PREFLIGHT_REBOOT_SHUTDOWN", 1.0, ""),
        ("PREFLIGHT_REBOOT_SHUTDOWN", 2.0, " (shutdown)"),
        ("PREFLIGHT_REBOOT_SHUTDOWN", 3.0, " (hold in the boot loader)"),
        ("PREFLIGHT_REBOOT_SHUTDOWN", 2.5, " (reboot of this kind)"),
        ("PREFLIGHT_REBOOT_SHUTDOWN", float("nan"), " (reboot of this kind)"),
        ("DO_PARACHUTE", 2.5, ""),
        ("DO_PARACHUTE", 0.5, " (parachute off)"),
        ("DO_PARACHUTE", float("nan"), " (parachute on)"),
        ("DO_AUX_FUNCTION", 9.0, ""),
        ("DO_AUX_FUNCTION", 11.0, " (FENCE)"),
        ("DO_AUX_FUNCTION", 65536.0 + 11.0, " (FENCE)"),  # the autopilot keeps 16 bits
        ("DO_AUX_FUNCTION", 200.0, " (200)"),
        ("DO_AUX_FUNCTION", float("nan"), " (no number)"),
    ],
)
def test_the_word_of_a_value_with_another_class_stands_behind_the_command(
    make: Callable[..., Frame], command: str, value: float, word: str
) -> None:
    number = getattr(mavlink, f"MAV_CMD_{command}")
    for message in ("COMMAND_LONG", "COMMAND_INT"):
        row = classify(make(message, command=number, param1=value))
        assert row.what == f"{message}/MAV_CMD_{command}{word}"


@pytest.mark.parametrize(
    ("command", "midway"),
    [
        ("DO_LAND_START", True),
        ("NAV_TAKEOFF", False),  # it takes off, but from the beginning
        ("MISSION_START", False),
    ],
)
def test_a_mission_begins_midway_by_the_commands_that_say_so(
    make: Callable[..., Frame], command: str, midway: bool
) -> None:
    row = classify(make("COMMAND_LONG", command=getattr(mavlink, f"MAV_CMD_{command}")))
    assert begins_midway(row) is midway
    assert begins_midway(classify(make("HEARTBEAT"))) is False


#: modes of an aircraft that takes off by mode 9 and by switch 77
_MODES = replace(ASSUMED.gate, take_off=(9,), take_off_switches=(77,))
_NAN = float("nan")


@pytest.mark.parametrize(
    ("command", "params", "starts", "turns"),
    [
        ("NAV_TAKEOFF", (), True, True),
        ("COMPONENT_ARM_DISARM", (1.0,), True, True),
        ("COMPONENT_ARM_DISARM", (0.0,), False, False),
        ("COMPONENT_ARM_DISARM", (_NAN,), True, True),
        ("DO_AUX_FUNCTION", (41.0, 2.0), True, True),
        ("DO_AUX_FUNCTION", (41.0, 0.0), False, False),
        ("DO_AUX_FUNCTION", (77.0, 2.0), True, True),
        ("DO_AUX_FUNCTION", (78.0, 2.0), False, False),
        ("DO_AUX_FUNCTION", (65536.0 + 41.0, 2.0), True, True),  # the autopilot keeps 16 bits
        ("DO_SET_MODE", (1.0, 9.0), True, True),
        ("DO_SET_MODE", (1.0, 256.0 + 9.0), True, True),  # of a mode 8 bits
        ("DO_SET_MODE", (1.0, 8.0), False, False),
        ("DO_SET_MODE", (1.0, 77.0), False, False),
        ("DO_SET_MODE", (1.0, _NAN), True, True),
        ("MISSION_START", (), False, True),
        ("DO_MOTOR_TEST", (), False, True),
        ("NAV_LAND", (), False, False),
        ("DO_SET_HOME", (), False, False),
    ],
)
def test_what_takes_off_and_what_turns_motors(
    make: Callable[..., Frame], command: str, params: tuple[float, ...], starts: bool, turns: bool
) -> None:
    fields = {f"param{place}": value for place, value in enumerate(params, start=1)}
    frame = make("COMMAND_LONG", command=getattr(mavlink, f"MAV_CMD_{command}"), **fields)
    row = classify(frame)
    assert (takes_off(frame, row, _MODES), moves(frame, row, _MODES)) == (starts, turns)


def test_other_messages_than_commands_take_off_by_a_mode_alone(make: Callable[..., Frame]) -> None:
    for mode, starts in ((9, True), (256 + 9, True), (8, False)):
        frame = make("SET_MODE", custom_mode=mode)
        row = classify(frame)
        assert (takes_off(frame, row, _MODES), moves(frame, row, _MODES)) == (starts, starts)
    for command in (mavlink.MAV_CMD_NAV_TAKEOFF, MISSION_START, mavlink.MAV_CMD_DO_MOTOR_TEST):
        answer = make("COMMAND_ACK", command=command)
        assert not moves(answer, classify(answer), _MODES)
    beat = make("HEARTBEAT")
    assert not takes_off(beat, classify(beat), _MODES)


def test_only_of_commands_the_first_parameter_decides(make: Callable[..., Frame]) -> None:
    row = classify(make("COMMAND_ACK", command=mavlink.MAV_CMD_DO_PARACHUTE))
    assert (row.what, row.access) == ("COMMAND_ACK/MAV_CMD_DO_PARACHUTE", Access.STREAM)
    assert classify(make("HEARTBEAT")).access is Access.LIVENESS

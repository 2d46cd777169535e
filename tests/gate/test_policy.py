# SPDX-License-Identifier: GPL-3.0-or-later

"""The policy is complete, has no stale names, and every row says why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason, judge
from mavproxy_handover.gate.policy.parameters import parameter_rule
from mavproxy_handover.gate.policy.rows import Access, classify
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
    assert len(ours) == 21
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

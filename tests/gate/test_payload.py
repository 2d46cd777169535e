# SPDX-License-Identifier: GPL-3.0-or-later

"""Payload authority at the gate: another station's than flight authority, and never a flight function."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.rows import classify
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.ledger import CASES, GCSA, GCSB, A, B
from tests.gate.test_onboard import COMMAND_NAMES, NEVER, PAYLOAD, PAYLOAD_COMMANDS

FLYING = AuthorityView(Phase.ON_MISSION, GCSA, None, 3, LeaseState.HELD, armed=True)
COMPONENTS = {0, 1, *range(100, 106), 154, *range(171, 176), 169}
GIMBAL = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW


def door(holder: int | None) -> Door:
    found = Door(step_s=30.0)
    found.change(FLYING)
    found.payload = holder
    return found


def test_every_command_to_every_component_of_a_station_with_the_payload_alone(make: Callable[..., Frame]) -> None:
    """GCSA commands, GCSB has the payload: of GCSB only payload commands pass, beside what every station may."""
    gate, compared = door(GCSB), 0
    for command, word in COMMAND_NAMES.items():
        for component in range(256):
            frame = make("COMMAND_LONG", sysid=GCSB, command=command, target_component=component)
            verdict = gate.up(B, frame).verdict
            payload = word in PAYLOAD_COMMANDS and component in COMPONENTS
            if payload:
                assert (verdict.fate, verdict.reason) == (Fate.FORWARD, GateReason.ALLOWED), (word, component)
                assert word not in NEVER
            elif verdict.fate is Fate.FORWARD:
                assert classify(frame).access is Access.READ, (word, component)
            compared += 1
    assert compared > 40_000


def test_every_message_of_a_station_with_the_payload_alone(make: Callable[..., Frame]) -> None:
    plain, passed = door(None), set()
    for case in CASES:
        frame = make(case.name, sysid=GCSB, **dict(case.fields))
        with_it, without = door(GCSB).up(B, frame).verdict, plain.up(B, frame).verdict
        command = COMMAND_NAMES.get(dict(case.fields).get("command", 0), "")
        commands = case.name in ("COMMAND_LONG", "COMMAND_INT") and command in PAYLOAD_COMMANDS
        if case.name in PAYLOAD or commands:
            assert with_it.fate is Fate.FORWARD, case
            assert without.fate is not Fate.FORWARD, case
            passed.add(command or case.name)
        else:
            assert (with_it.fate, with_it.reason) == (without.fate, without.reason), case
    assert passed >= PAYLOAD


@pytest.mark.parametrize("holder", [GCSB, 0])
def test_the_commander_keeps_the_flight_and_loses_the_payload(make: Callable[..., Frame], holder: int) -> None:
    gate = door(holder)
    frame = make("COMMAND_LONG", sysid=GCSA, command=GIMBAL)
    came = gate.up(A, frame)
    assert (came.verdict.fate, came.verdict.reason) == (Fate.REFUSE, GateReason.NOT_PAYLOADS)
    assert came.answers, "refused in the protocol's way"
    assert gate.said[-1][1].endswith("refused: another has payload authority")
    stream = make("GIMBAL_MANAGER_SET_PITCHYAW", sysid=GCSA)
    assert gate.up(A, stream).verdict.fate is Fate.DROP
    home = make("COMMAND_LONG", sysid=GCSA, command=mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    assert gate.up(A, home).verdict.fate is Fate.FORWARD
    turned = make("COMMAND_LONG", sysid=GCSA, command=mavlink.MAV_CMD_DO_MOUNT_CONTROL)
    assert gate.up(A, turned).verdict.fate is Fate.FORWARD, "it may turn the aircraft: flight authority's"


def test_another_system_in_its_name_gets_no_payload(make: Callable[..., Frame]) -> None:
    gate = door(GCSB)
    frame = make("COMMAND_LONG", sysid=77, command=GIMBAL)
    assert gate.up(B, frame).verdict.fate is Fate.DROP
    camera = make("COMMAND_LONG", sysid=GCSB, compid=100, command=GIMBAL)
    assert gate.up(B, camera).verdict.reason is GateReason.COMPONENT


def test_a_station_with_the_payload_alone_does_not_fill_the_line_of_the_lease(make: Callable[..., Frame]) -> None:
    gate = Door(step_s=0.001)
    gate.change(FLYING)
    gate.payload = GCSB
    stream = make("GIMBAL_MANAGER_SET_PITCHYAW", sysid=GCSB)
    command = make("COMMAND_LONG", sysid=GCSB, command=GIMBAL)
    came = [gate.up(B, frame) for _ in range(1000) for frame in (stream, command)]
    passed = sum(len(raw) for each in came for raw in each.passed)
    assert passed <= 3000 * 3, "the rate of two seconds, and the reserve"
    late = {each.verdict[:3:2] for each in came[-2:]}
    assert late <= {(Fate.DROP, GateReason.TOO_OFTEN), (Fate.REFUSE, GateReason.TOO_OFTEN)}
    mine = make("COMMAND_LONG", sysid=GCSA, command=mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    assert gate.up(A, mine).verdict.fate is Fate.FORWARD
    gate.now += 1.0
    assert gate.up(B, stream).verdict.fate is Fate.FORWARD

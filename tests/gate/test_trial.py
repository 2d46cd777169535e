# SPDX-License-Identifier: GPL-3.0-or-later

"""What `handover policy` says of each name is what the gate does with it, in each situation and from each role.

Three parties must agree: the answer of the command, the gate behind the stations of these tests (`door`), and for every
name that it lists the second book-keeping (`ledger`), which knows nothing of the policy's tables.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from mavproxy_handover.cli.policy import main
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.examples import Example, examples, frame_of
from mavproxy_handover.gate.judge import Fate, GateReason
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.parameters import PARAMETER_RULES, parameter_rule
from mavproxy_handover.gate.policy.tables import MESSAGES_BY_PART, POLICY, PolicyRow
from mavproxy_handover.gate.trial import SITUATIONS, Answer, Situation, answer
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.ledger import CASES, GCSA, GCSB, A, B, Case, expected

CAMERA = 100
#: a part of the names in each run, all of them in a long one: 13,000 gates take half a minute
STRIDE = 3


def of_the_door(frame: Frame, situation: Situation) -> Answer:
    """The verdict of the gate that the other tests drive."""
    door = Door(step_s=0.0)
    asked: list[object] = []
    door.target_passes = lambda *aim: not asked.append(aim)  # type: ignore[func-returns-value]
    door.change(situation.view)
    station = A if situation.station == GCSA else B
    verdict = door.up(station, frame).verdict
    return Answer(verdict.fate, verdict.reason, bool(asked or door.asked), verdict.access)


def check(rows: tuple[PolicyRow, ...]) -> int:
    compared = 0
    for row in rows:
        for example in examples(row.kind, row.name):
            for situation in SITUATIONS:
                frame = frame_of(example, situation.station, situation.component)
                said = answer(row.kind, example, situation)
                assert said == of_the_door(frame, situation), (row, example, situation)
                assert said.access is row.access, (row, example)
                compared += 1
    return compared


def test_each_name_is_answered_as_the_gate_judges_it() -> None:
    assert check(POLICY[::STRIDE]) > 3000


@pytest.mark.long
@pytest.mark.parametrize("begin", range(1, STRIDE))
def test_each_other_name_too(begin: int) -> None:
    assert check(POLICY[begin::STRIDE]) > 3000


def test_the_situations_are_those_of_every_role() -> None:
    who = [situation.who for situation in SITUATIONS]
    assert len(set(who)) == len(who)
    for role in ("commander", "partner", "observer", "any station", "camera"):
        assert any(name.startswith(role) for name in who), role
    assert {situation.view.phase for situation in SITUATIONS} == set(Phase)
    assert {situation.station for situation in SITUATIONS} == {GCSA, GCSB}
    assert CAMERA in {situation.component for situation in SITUATIONS}


def as_example(case: Case) -> Example:
    return Example("", case.name, dict(case.fields))


def of_the_ledger(case: Case, situation: Situation) -> tuple[Fate, GateReason]:
    station = A if situation.station == GCSA else B
    return expected(case.kind, station, station.sysid, None, situation.view)


def test_the_second_book_keeping_agrees() -> None:
    """Of frames that hold sticks it says what becomes of zeros, so these are left to the door."""
    compared = 0
    for case in CASES[::7]:
        for situation in SITUATIONS:
            if situation.component == CAMERA:
                continue
            said = answer("message", as_example(case), situation)
            found = (Fate.CONSUME, GateReason.COMPANION) if said.judged else (said.fate, said.reason)
            wanted = of_the_ledger(case, situation)
            if said.access is Access.STREAM and said.judged:
                found = wanted  # a target that the situation allows
            assert found == wanted, (case, situation)
            compared += 1
    assert compared > 3000


NEITHER = [("message", "RC_CHANNELS_OVERRIDE_V2"), ("command", "DO_SET_SYS_CMP_ID")]


@pytest.mark.parametrize(("kind", "name"), NEITHER)
def test_a_name_that_the_dialect_lacks_is_said_to_be_unknown(kind: str, name: str) -> None:
    if examples(kind, name):
        pytest.skip("this pymavlink knows it")
    said = {str(answer(kind, None, situation)) for situation in SITUATIONS}
    assert said == {"dropped: unknown message" if kind == "message" else "refused: not known to this vehicle"}


def as_json(name: str, capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    assert main([name, "--json"]) == 0
    found: list[dict[str, Any]] = json.loads(capsys.readouterr().out)
    return found


def test_the_command_prints_these_answers(capsys: pytest.CaptureFixture[str]) -> None:
    (row,) = [row for row in as_json("COMPONENT_ARM_DISARM", capsys) if row["kind"] == "command"]
    assert list(row["verdicts"]) == ["param1 0", "param1 1"]
    assert row["verdicts"]["param1 1"]["commander, before START"] == "handled by the companion"
    assert row["verdicts"]["param1 1"]["observer, in a rehearsal"].startswith("refused: a rehearsal is under way")
    assert main(["COMPONENT_ARM_DISARM"]) == 0
    out = capsys.readouterr().out.splitlines()
    begin = out.index("COMPONENT_ARM_DISARM with param1 1 (command)")
    assert out[begin + 1 : begin + 3] == ["  handled by the companion", "    commander, before START"]


@pytest.mark.parametrize("name", ["FS_GCS_ENABLE", "RALLY_TOTAL", "ATC_RAT_RLL_P", "CAM1_TYPE", "NO_SUCH_NAME"])
def test_a_parameter_is_asked_for_by_its_own_name(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    rule = parameter_rule(name)
    rows = [row for row in as_json(name, capsys) if row["kind"] == "parameter" and row["why"] == rule.why]
    example = Example("", "PARAM_SET", {"param_id": name.encode()})
    wanted = {situation.who: str(answer("parameter", example, situation)) for situation in SITUATIONS}
    assert wanted in [row["verdicts"][""] for row in rows]


def test_every_pattern_of_parameters_has_an_example_of_its_own() -> None:
    for rule in PARAMETER_RULES:
        for name in rule.names:
            (example,) = examples("parameter", name)
            found = parameter_rule(example.fields["param_id"].decode())
            assert found.access is rule.access, (name, example)


def test_every_kind_of_the_policy_has_examples() -> None:
    for kind in {row.kind for row in POLICY}:
        assert any(examples(row.kind, row.name) for row in POLICY if row.kind == kind), kind
    assert set(MESSAGES_BY_PART) & {row.name for row in POLICY} == set()


def test_an_answer_depends_on_no_other(make: Callable[..., Frame]) -> None:
    situation = replace_station(SITUATIONS[0])
    first = answer("message", Example("", "MANUAL_CONTROL", {}), situation)
    assert first == answer("message", Example("", "MANUAL_CONTROL", {}), situation)


def replace_station(situation: Situation) -> Situation:
    return situation._replace(view=replace(situation.view, commander=GCSB))


def test_a_feed_depends_on_the_configuration_and_the_answer_says_so() -> None:
    for name in ("GPS_RTCM_DATA", "ADSB_VEHICLE"):
        for situation in SITUATIONS:
            (example,) = examples("message", name)
            said = answer("message", example, situation)
            assert said.access is Access.FEED
            assert str(said) == "passes if the station is the source ([feeds])", (name, situation)

# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover policy NAME` says what the gate does with that name, whether the name has a row of its own or not."""

from __future__ import annotations

import json

import pytest

from mavproxy_handover.cli.policy import main
from mavproxy_handover.gate.policy.parameters import parameter_rule
from mavproxy_handover.gate.policy.tables import MESSAGES_BY_PART

#: parameters of ArduPilot: with a row of their own, in a group of rows, and without any
PARAMETERS = (
    "WPNAV_SPEED", "RTL_ALT", "FS_GCS_ENABLE", "SERVO1_FUNCTION", "ATC_RAT_RLL_P", "CAM1_TYPE", "MNT1_TYPE",
    "SR0_EXTRA1", "LOG_BITMASK", "PILOT_SPEED_UP", "MIS_OPTIONS", "BATT_CAPACITY", "SIM_SPEEDUP",
)  # fmt: skip


def rows(name: str, capsys: pytest.CaptureFixture[str]) -> list[dict[str, str]]:
    assert main([name, "--json"]) == 0, capsys.readouterr().err
    found: list[dict[str, str]] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_parameter_has_the_class_that_the_gate_gives_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = [row for row in rows(name, capsys) if row["kind"] == "parameter"]
    assert parameter_rule(name).access.value in {row["class"] for row in found}
    assert parameter_rule(name).why in {row["why"] for row in found}


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("PARAM_SET", {"parameter"}),
        ("MISSION_COUNT", {"mission type"}),
        ("MISSION_REQUEST_LIST", {"mission type, read"}),
        ("FILE_TRANSFER_PROTOCOL", {"file opcode", "file"}),
        ("TUNNEL", {"tunnel payload type"}),
        ("COMMAND_INT", {"command"}),
    ],
)
def test_a_message_that_is_judged_by_its_contents_shows_the_rows_of_these(
    name: str, kinds: set[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert {row["kind"] for row in rows(name, capsys)} == kinds
    assert main([name]) == 0
    assert f"{name} is judged by its {MESSAGES_BY_PART[name]}" in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("name", list(MESSAGES_BY_PART))
def test_no_message_that_the_gate_passes_is_said_to_be_refused(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rows(name, capsys)


def test_a_name_of_nothing_is_refused_by_that_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["no-such-thing"]) == 1
    assert capsys.readouterr().err == ("handover policy: no-such-thing: no row fits. What has no row is refused.\n")

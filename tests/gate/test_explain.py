# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover policy` and the documentation say what the gate does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mavproxy_handover.cli.policy import main
from mavproxy_handover.gate.explain import (
    CLASSES,
    columns,
    contents,
    for_commander,
    for_others,
    markdown_table,
    summary,
)
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.tables import POLICY

DOCUMENT = Path(__file__).parents[2] / "docs" / "authority.md"


def test_the_documentation_has_the_summary_of_the_policy() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    _before, begin, rest = text.partition("<!-- policy:begin -->\n")
    table, end, _behind = rest.partition("\n<!-- policy:end -->")
    assert (begin, end) != ("", ""), "the markers are missing"
    assert table == markdown_table(summary()), "make it anew: make reference"


def test_every_class_is_explained() -> None:
    assert set(CLASSES) == set(Access)
    assert all(contents(access) for access in Access)


@pytest.mark.parametrize(
    ("access", "commander", "others"),
    [
        (Access.READ, "passes", "passes"),
        (Access.BULK, "passes", "passes; armed: refused: only the commander's in flight"),
        (Access.LIVENESS, "passes", "noticed by the companion"),
        (Access.ANSWERED, "passes", "answered by the companion"),
        (Access.COMMAND, "passes", "refused: not in control"),
        (Access.STREAM, "passes", "dropped: not in control"),
        (Access.SAFEGUARD, "passes; armed: refused: locked while armed", "refused: not in control"),
        (Access.TRANSFER, "answered by the companion", "answered by the companion"),
        (Access.MAINTENANCE, "refused", "refused"),
        (Access.NEVER, "dropped", "dropped"),
    ],
)
def test_each_class_says_what_becomes_of_it(access: Access, commander: str, others: str) -> None:
    assert (for_commander(access), for_others(access)) == (commander, others)


def printed(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert main(argv) == 0
    return capsys.readouterr().out


def test_the_command_prints_every_row(capsys: pytest.CaptureFixture[str]) -> None:
    rows = json.loads(printed(capsys, "--json"))
    assert [(row["kind"], row["name"], row["class"], row["why"]) for row in rows] == [
        (row.kind, row.name, row.access.value, row.why) for row in POLICY
    ]
    noticed = next(row for row in rows if row["class"] == "liveness")
    assert (noticed["commander"], noticed["others"]) == ("passes", "noticed by the companion")
    text = printed(capsys)
    assert all(row.name in text and row.why in text for row in POLICY)
    assert "PARAM_SET is judged by its parameter" in text


@pytest.mark.parametrize(
    ("asked", "names"),
    [
        ("RC_CHANNELS_OVERRIDE", ["RC_CHANNELS_OVERRIDE", "RC_CHANNELS_OVERRIDE_V2"]),
        ("mav_cmd_component_arm_disarm", ["COMPONENT_ARM_DISARM"]),
        ("*_RALLY_*", ["DO_RALLY_LAND", "NAV_RALLY_POINT"]),
        ("FS_GCS_ENABLE", ["FS_*"]),
        ("MAV1_OPTIONS", ["MAV*_OPTIONS"]),
        ("scripts", ["scripts"]),
    ],
)
def test_names_are_found_by_a_part_by_a_pattern_and_by_the_pattern_of_a_row(
    capsys: pytest.CaptureFixture[str], asked: str, names: list[str]
) -> None:
    rows = json.loads(printed(capsys, asked, "--json"))
    assert [row["name"] for row in rows] == names


def test_one_rows_meaning_is_printed_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(capsys, "HNDO_ENABLE")
    assert "HNDO_*  the guard's own" in text
    assert "safeguard: from the commander passes; armed: refused: locked while armed" in text


def test_the_summary_has_a_line_for_every_class(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(printed(capsys, "--summary").splitlines()) == 1 + len(Access)
    rows = json.loads(printed(capsys, "--summary", "--json"))
    assert rows[0] == {
        "class": "read",
        "what": "asks and changes nothing",
        "from the commander": "passes",
        "from any other station": "passes",
        "how many": "10 messages, 11 commands, 3 mission types to read",
    }


def test_a_name_without_a_row_and_wrong_usage_are_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["no such thing"]) == 1
    assert "What has no row is refused" in capsys.readouterr().err
    assert main(["--summarise"]) == 2
    assert main(["--help"]) == 0


def test_a_bar_in_a_cell_does_not_split_it() -> None:
    assert markdown_table([("a",), ("b|c",)]) == "| a |\n|---|\n| b\\|c |"


def test_each_column_is_as_wide_as_its_longest_cell_and_the_last_is_not_filled() -> None:
    assert columns([("a", "class", "why"), ("longest", "b", "so")]) == "a        class  why\nlongest  b      so"
    assert columns([("a", "why")]) == "a  why"


def test_the_line_below_the_head_has_a_cell_for_each_column_of_the_head() -> None:
    assert markdown_table([("a", "b"), ("c",)]) == "| a | b |\n|---|---|\n| c |"

# SPDX-License-Identifier: GPL-3.0-or-later

"""The table "Flown" of the guard's page: every case of the suite has its row, every row its case, and none failed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sitl.firmware import Firmware, NotFirmware, firmware_of
from tests.sitl.flown import (
    BEGIN,
    END,
    FAILED,
    NOT_ASKED,
    NOT_FLOWN,
    Recorder,
    digest,
    flown_with,
    outcomes,
    rows,
    table,
    write,
)
from tests.sitl.guard_flight import GUARD, PARAMETERS, PLANE_PARAMETERS
from tests.sitl.guard_suite import EVERY_TIME, FILES, case_names

PAGE = GUARD.with_suffix(".md")
HERE = Path(__file__).parent


def test_page_and_suite_name_the_same_cases() -> None:
    assert list(rows(PAGE)) == case_names()


def test_no_two_cases_have_one_name() -> None:
    names = case_names()
    assert len(set(names)) == len(names)
    assert not [name for name in names if "|" in name]


def test_what_is_flown_every_time_is_in_the_suite() -> None:
    assert set(case_names()) >= EVERY_TIME


def test_every_file_that_flies_the_guard_is_in_the_suite() -> None:
    flying = {path.stem for path in HERE.glob("test_guard_*.py")} - {Path(__file__).stem}
    assert flying == set(FILES)


#: what only these vehicles fly, on as many versions
VERSIONS = {"Plane: ": 1, "QuadPlane: ": 1, "Rover": 1}


def test_every_case_was_flown_on_every_version_and_held() -> None:
    for case, told in rows(PAGE).items():
        assert len(told) == 3, case
        assert not [outcome for outcome in told if FAILED in outcome or outcome == NOT_FLOWN], case
        asked = [outcome for outcome in told if outcome != NOT_ASKED]
        wanted = next((count for start, count in VERSIONS.items() if case.startswith(start)), 3)
        assert len(asked) == wanted, case


def test_table_has_cases_in_order_and_versions_by_number() -> None:
    outcomes = {
        ("b", "4.10.0"): "home",
        ("a", "4.7.0-dev"): "RTL | LAND",
        ("a", "4.10.0"): "home",
    }
    assert table(["a", "b", "c"], outcomes) == [
        "| case | 4.7.0-dev | 4.10.0 |",
        "|---|---|---|",
        "| a | RTL / LAND | home |",
        "| b | - | home |",
        "| c | not flown | not flown |",
    ]


def test_table_goes_between_the_marks_and_nowhere_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n", encoding="utf-8")
    write(page, table(["a"], {("a", "4.6.3"): "home"}), {"4.6.3": "0123456789abcdef"})
    assert page.read_text(encoding="utf-8") == (
        f"before\n{BEGIN}\n| case | 4.6.3 |\n|---|---|\n| a | home |\n\n"
        f"Flown with script and parameters 0123456789abcdef: 4.6.3.\n{END}\nafter\n"
    )
    assert rows(page) == {"a": ["home"]}
    page.write_text("no marks\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"page\.md: the lines .* are missing"):
        write(page, [], {})


def test_below_it_stands_what_each_version_was_flown_with_the_newest_first(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"{BEGIN}\n{END}\n", encoding="utf-8")
    digests = {"4.5.7": "0123456789abcdef", "4.10.0": "fedcba9876543210", "4.6.3": "0123456789abcdef"}
    write(page, table(["a"], {("a", version): "home" for version in digests}), digests)
    assert page.read_text(encoding="utf-8").splitlines()[-3:-1] == [
        "Flown with script and parameters fedcba9876543210: 4.10.0.",
        "Flown with script and parameters 0123456789abcdef: 4.6.3, 4.5.7.",
    ]
    assert flown_with(page) == digests


def flight(case: str, version: str, outcome: str) -> pytest.TestReport:
    told = [("flown", [case, version, outcome])]
    return pytest.TestReport("node", ("file", 1, "test"), {}, "passed", None, "call", user_properties=told)


def test_a_partial_run_keeps_of_a_version_what_was_flown_with_the_same_script_and_of_others_all(tmp_path: Path) -> None:
    page, script = tmp_path / "page.md", tmp_path / "guard.lua"
    page.write_text(f"{BEGIN}\n{END}\n", encoding="utf-8")
    assert outcomes(page) == {}
    script.write_text("return 1\n", encoding="utf-8")
    before = {("a", "4.6.3"): "home", ("b", "4.6.3"): "LAND", ("b", "4.7.0"): "RTL"}
    write(page, table(["a", "b"], before), dict.fromkeys(("4.6.3", "4.7.0"), digest(script)))
    assert outcomes(page) == before
    same = Recorder(page, script)
    same.pytest_runtest_logreport(flight("a", "4.6.3", "RTL"))
    assert same.told == {**before, ("a", "4.6.3"): "RTL"}
    script.write_text("return 2\n", encoding="utf-8")
    other = Recorder(page, script)
    other.pytest_runtest_logreport(flight("a", "4.6.3", "RTL"))
    other.pytest_runtest_logreport(flight("b", "4.6.3", "RTL"))
    assert other.told == {("a", "4.6.3"): "RTL", ("b", "4.6.3"): "RTL", ("b", "4.7.0"): "RTL"}
    assert other.flown_with == {"4.6.3": digest(script), "4.7.0": flown_with(page)["4.7.0"]}


#: versions of which the table tells what came of them with an earlier script or parameters: to be flown anew
FLOWN_BEFORE = {"4.5.7", "4.6.3", "4.7.0-dev"}


def test_what_was_flown_with_an_earlier_script_is_known() -> None:
    today = digest(GUARD, PARAMETERS, PLANE_PARAMETERS)
    assert {version for version, each in flown_with(PAGE).items() if each != today} == FLOWN_BEFORE
    assert "4.7.0-dev" in flown_with(PAGE)


def test_comments_and_layout_are_not_flown(tmp_path: Path) -> None:
    script, parameters = tmp_path / "guard.lua", tmp_path / "guard.parm"
    script.write_text("-- one\nreturn f(1, 2)\n", encoding="utf-8")
    parameters.write_text("# on\nSCR_ENABLE 1\n\nFS_GCS_ENABLE 1 # RTL\n", encoding="utf-8")
    before = digest(script, parameters)
    script.write_text("-- another\nreturn f(1,\n         2)\n", encoding="utf-8")
    assert digest(script, parameters) == before
    parameters.write_text("SCR_ENABLE  1\nFS_GCS_ENABLE 1\n", encoding="utf-8")
    assert digest(script, parameters) == before
    parameters.write_text("SCR_ENABLE 1\nFS_GCS_ENABLE 2\n", encoding="utf-8")
    assert digest(script, parameters) != before


def test_version_is_read_out_of_the_program(tmp_path: Path) -> None:
    program = tmp_path / "arducopter"
    program.write_bytes(b"\x7fELF....ArduCopter V4.7.0-dev\0ArduCopter V4.7.0-dev (2598e9d4)\0")
    assert firmware_of(program) == Firmware("Copter", "4.7.0-dev", program.resolve())
    assert firmware_of(program).numbers == (4, 7)
    assert firmware_of(program).gcs_id == "MAV_GCS_SYSID"
    program.write_bytes(b"ArduCopter V4.6.3\0")
    assert firmware_of(program).gcs_id == "SYSID_MYGCS"
    program.write_bytes(b"something else")
    with pytest.raises(NotFirmware, match="is no ArduCopter"):
        firmware_of(program)
    with pytest.raises(NotFirmware, match="cannot be read"):
        firmware_of(tmp_path / "nowhere")

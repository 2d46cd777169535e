# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of console lines in `docs/thesis.md`, and the check that looks for them in a flight's transcript."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sitl.script.scenario import known_scenarios
from tests import console_lines
from tests.console_lines import FIVE, Line, lines, main, missing, printed, rows

#: one line of each kind
START = Line("6.2", "", "START accepted from GCSA.", "companion", ("nominal",))
DISTANCE = Line("6.14", "", "* m, * m/s, battery *, * m to waypoint *, zone GCSA", "GCSA", ("nominal",))
TELEMETRY = "52.679000 5.924000 3 m, 0.0 m/s, battery 99%, 88 m to waypoint 1, zone GCSA"


def run(folder: Path, companion: str, station: str) -> Path:
    """A run's folder with these consoles."""
    for who, console in (("companion", companion), ("GCSA", station)):
        (folder / who).mkdir(parents=True)
        (folder / who / f"{who}.console.txt").write_text(console, encoding="utf-8")
    (folder / "run.json").write_text(json.dumps({"scenario": "nominal"}), encoding="utf-8")
    return folder


def test_the_table_is_read_and_names_what_there_is() -> None:
    assert len(rows()) == 46
    assert {row.who for row in rows()} == {"companion", "GCSA", "GCSB"}
    assert {name for row in rows() for name in row.scenarios} <= set(known_scenarios())
    assert all(row.scenarios for row in rows())
    assert {len(lines(name)) for name in FIVE} == {38, 39, 44}
    assert len({(row.who, row.today) for row in rows()}) == len(rows())


def test_the_figures_whose_consoles_can_be_read_are_all_there() -> None:
    named = {figure.strip() for row in rows() for figure in row.figures.split(",")}
    assert named >= {"6.2", "6.3", "6.4", "6.5", "6.6", "6.7", "6.8", "6.10", "6.11", "6.13", "6.14"}


@pytest.mark.parametrize(
    ("companion", "station", "absent"),
    [
        ("[12:00:00|drone-1][ONLOAD]: START accepted from GCSA.", f"[12:00:03|GCSA][ONMISSION]: {TELEMETRY}", []),
        ("START accepted from GCSA.", f"AUTO> [12:00:03|GCSA][ONMISSION RTL]: {TELEMETRY}", []),
        ("[12:00:00|drone-1][ONLOAD]: START accepted from GCSB.", TELEMETRY, ["companion: START accepted from GCSA."]),
        ("[12:00:00|drone-1][ONLOAD]: START accepted from GCSA. And more.", TELEMETRY, [f"companion: {START.today}"]),
        (f"START accepted from GCSA.\n{TELEMETRY}", "", [f"GCSA: {DISTANCE.today}"]),
        (START.today, TELEMETRY.replace("88 m to waypoint 1", "waypoint 1"), [f"GCSA: {DISTANCE.today}"]),
    ],
)
def test_a_line_counts_whole_and_of_its_own_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, companion: str, station: str, absent: list[str]
) -> None:
    monkeypatch.setattr(console_lines, "rows", lambda: (START, DISTANCE))
    folder = run(tmp_path / "run", companion, station)
    assert missing(folder, "nominal") == absent
    assert missing(folder, "linear") == []
    assert main([str(tmp_path)]) == (1 if absent else 0)


def test_where_no_flight_was_checked_nothing_is_in_order(tmp_path: Path) -> None:
    assert main([str(tmp_path)]) == 1


def test_what_a_program_has_printed_is_without_time_name_and_phase() -> None:
    console = "STABILIZE> [12:00:00|GCSA][ONLOAD]: START sent.\nAP: Arming motors\n"
    assert printed(console) == ["START sent.", "AP: Arming motors"]

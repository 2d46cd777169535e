# SPDX-License-Identifier: GPL-3.0-or-later

"""Operators' names in the report: a table of their own, and beside the handovers that they agreed to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sitl.report.journal_reader import Entry
from sitl.report.operators import agreed, operators
from sitl.report.page import write_report
from sitl.report.record import load_run
from tests.sitl.synthetic import VEHICLE_NAME, evidence, nominal, wall, write_folder

JANSEN, BAKKER = {"GCSA": "Jansen"}, {"GCSB": "Bakker"}
ON_DUTY = JANSEN | BAKKER


def named() -> list[Entry]:
    """The flight as planned, with an operator on duty at each station, an override and a change of shift."""
    entries = []
    for entry in nominal():
        station = str(entry.get("station"))
        inward = entry.who == VEHICLE_NAME and entry.event == "message" and entry.get("direction") == "in"
        more = {"operator": ON_DUTY[station]} if inward and entry.get("consent") else {}
        entries.append(replace(entry, fields={**entry.fields, **more}))

    def note(sim_s: float, who: str, event: str, text: str, **fields: object) -> None:
        entries.append(Entry(wall(sim_s), who, event, text, fields))

    for name, operator in ON_DUTY.items():
        note(5, VEHICLE_NAME, "operator", f"{operator} is on duty at {name}", station=name, operator=operator)
        note(4.9, name, "operator", f"{operator} is on duty.", operator=operator)
    note(70, VEHICLE_NAME, "override", "GCSA lifts fence for 60 s, on duty: Jansen", by="GCSA", operator="Jansen")
    note(71, "GCSA", "command", "STOP sent. On duty: Jansen.", what="STOP", operator="Jansen")
    note(71.2, "GCSA", "command", "STOP accepted. On duty: Jansen.", what="STOP", operator="Jansen", result="accepted")
    note(300, VEHICLE_NAME, "operator", "Smit is on duty at GCSA, after Jansen", station="GCSA", operator="Smit")
    return sorted(entries, key=lambda entry: entry.t)


def test_what_was_done_under_which_name() -> None:
    rows = [(done.station, done.operator, done.text) for done in operators(evidence(named()))]
    assert rows[:2] == [
        ("GCSA", "Jansen", "Jansen is on duty at GCSA"),
        ("GCSB", "Bakker", "Bakker is on duty at GCSB"),
    ]
    assert ("GCSA", "Jansen", "GCSA lifts fence for 60 s, on duty: Jansen") in rows
    assert ("GCSA", "Jansen", "STOP sent. On duty: Jansen.") in rows
    assert not any("STOP accepted" in text for _station, _operator, text in rows)
    assert [row for row in rows if row[2] == "agrees to handover 1"] == [
        ("GCSB", "Bakker", "agrees to handover 1"),
        ("GCSA", "Jansen", "agrees to handover 1"),
    ]
    assert ("GCSA", "Smit", "Smit is on duty at GCSA, after Jansen") in rows


def test_who_agreed_to_a_handover() -> None:
    assert agreed(evidence(named()), 1) == "Bakker (GCSB), Jansen (GCSA)"
    assert agreed(evidence(), 1) == ""


def test_without_the_vehicle_s_names_the_stations_journals_count() -> None:
    entries = [entry for entry in named() if entry.who != VEHICLE_NAME or not entry.get("operator")]
    assert ("GCSB", "Bakker is on duty.") in [(done.station, done.text) for done in operators(evidence(entries))]


def test_a_flight_without_names_has_no_such_rows() -> None:
    assert operators(evidence()) == []


def test_both_stand_in_the_page(tmp_path: Path) -> None:
    write_folder(tmp_path, named())
    page = write_report(load_run(tmp_path)).read_text(encoding="utf-8")
    assert "<h2>Operators</h2>" in page
    assert "Bakker (GCSB), Jansen (GCSA)" in page
    assert "Smit is on duty at GCSA, after Jansen" in page

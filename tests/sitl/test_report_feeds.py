# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds and onboard programs in the report: which station was the source when, delegations, and what was not used."""

from __future__ import annotations

from pathlib import Path

from sitl.report.feeds import Span, feed_spans, onboard_spans, unused
from sitl.report.journal_reader import Entry
from sitl.report.page import main_report
from tests.sitl.recorded import companion_entries, journal
from tests.sitl.synthetic import VEHICLE_NAME, evidence
from tests.sitl.test_report_small_logs import words_of


def feed(t: float, change: str, text: str, station: str = "GCSA", kind: str = "rtk") -> Entry:
    return Entry(t, VEHICLE_NAME, "feed", text, {"kind": kind, "station": station, "change": change})


def program(t: float, text: str, **values: object) -> Entry:
    return Entry(t, VEHICLE_NAME, "onboard", text, {"program": "precland", **values})


NONE = "RTK corrections: none. GCSA is silent for 3 s."
OTHER = "RTK corrections: from GCSB after GCSA."
FEEDS = [
    feed(10.0, "source", "RTK corrections: from GCSA."),
    feed(11.0, "source", "ADS-B: from GCSB.", "GCSB", "adsb"),
    feed(20.0, "silent", NONE),
    feed(30.0, "source", "RTK corrections: from GCSA again."),
    feed(35.0, "not used", "RTK corrections of GCSB are not used: too many bytes in a second.", "GCSB"),
    feed(40.0, "source", OTHER, "GCSB"),
]


def test_each_source_has_its_time() -> None:
    assert feed_spans(evidence(FEEDS)) == [
        Span("RTK corrections", "GCSA", 10.0, 20.0, NONE),
        Span("ADS-B", "GCSB", 11.0),
        Span("RTK corrections", "GCSA", 30.0, 40.0, OTHER),
        Span("RTK corrections", "GCSB", 40.0),
    ]
    assert [entry.t for entry in unused(evidence(FEEDS))] == [35.0]


PROGRAM = [
    program(5.0, "precland is heard", heard=True),
    program(10.0, "GCSA delegates guided targets to precland", by="GCSA"),
    program(20.0, "precland no longer leads the aircraft: the program is silent", end="silence"),
    program(21.0, "Hold confirmed: BRAKE. Order GUIDED to lead it again.", confirmed=True),
    program(25.0, "precland is silent for 5 s", heard=False),
    program(30.0, "precland is heard", heard=True),
    program(40.0, "precland no longer leads the aircraft: the companion has restarted", end="restart"),
    program(50.0, "GCSB delegates guided targets to precland", by="GCSB"),
]


def test_each_delegation_has_its_beginning_and_its_end() -> None:
    assert onboard_spans(evidence(PROGRAM)) == [
        Span("precland leads in GUIDED", "GCSA", 10.0, 20.0, "the program is silent"),
        Span("precland is silent", "", 25.0, 30.0, "it is heard again"),
        Span("precland leads in GUIDED", "", 40.0, 40.0, "the companion has restarted"),
        Span("precland leads in GUIDED", "GCSB", 50.0),
    ]


def test_the_page_has_them_and_has_no_section_without_any(tmp_path: Path) -> None:
    def words(name: str, entries: list[Entry]) -> str:
        more = [(entry.t, entry.event, {"text": entry.text, **entry.fields}) for entry in entries]
        path = journal(tmp_path / name / f"{VEHICLE_NAME}.jsonl", VEHICLE_NAME, [*companion_entries(), *more])
        page = tmp_path / name / "page.html"
        assert main_report([str(path), "--out", str(page)]) == 0
        return words_of(page)

    text = words("with", [*FEEDS, *PROGRAM])
    assert "Feeds and onboard programs" in text
    assert "RTK corrections GCSA RTK corrections: none. GCSA is silent for 3 s." in text
    assert "precland leads in GUIDED GCSA the program is silent" in text
    assert "to the end precland leads in GUIDED GCSB" in text
    assert "GCSB RTK corrections of GCSB are not used: too many bytes in a second." in text
    assert "Feeds and onboard programs" not in words("without", [])

# SPDX-License-Identifier: GPL-3.0-or-later

"""The rehearsals of a journal as tables of the report: the vehicle's own book, read back."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.stations.rehearsal_book import Foreseen, LinkSeen, RehearsalBook
from sitl.report.journal_reader import Entry
from sitl.report.rehearsal import EVENT, books, tables

HERE = (52.679, 5.9272)


def entry(values: dict[str, Any], t: float = 1.0, who: str = "drone-1") -> Entry:
    return Entry(t, who, EVENT, "", json.loads(json.dumps(values)))


@pytest.fixture
def book() -> RehearsalBook:
    seen = RehearsalBook(100.0, (Foreseen("GCSA", "GCSB", HERE, 3, 14.2), Foreseen("GCSB", "GCSA", HERE, 5, 15.0)))
    seen.saw(110.0, "GCSA+GCSB", HERE, [LinkSeen("GCSA", "udpout", 1.5, 0.02, 0.034)])
    seen.saw(111.0, "GCSA", HERE, [LinkSeen("GCSB", "udpout", None, None, None)])
    seen.handover("GCSA", "GCSB", 112.0, 0.034, "zone", distance_m)
    seen.refused("GCSB", "COMMAND_LONG/MAV_CMD_NAV_LAND", "not in control")
    seen.would(120.0, "would RETURN: out of coverage")
    seen.end(130.0, "ended by GCSA")
    return seen


def test_what_the_vehicle_wrote_is_what_is_shown(book: RehearsalBook) -> None:
    handovers, links, refused, would = tables(entry(book.entry(130.0)))
    assert handovers.rows == (
        ("1", "GCSA → GCSB", "12.0 s", "0.03 s of 14.2 s", "way to item 3, 0 m off", "committed (zone)"),
        ("", "GCSB → GCSA", "", "", "way to item 5", "not made"),
    )
    assert links.rows == (
        (
            "GCSA",
            "udpout",
            "GCSA+GCSB",
            "10.0 s",
            "2.0 %, 2.0 %",
            "34.0 ms, 34.0 ms",
            "1.5 s at 52.67900 5.92720",
        ),
        ("GCSB", "udpout", "GCSA", "1.0 s", "", "", "never heard"),
    )
    assert refused.rows == (("GCSB", "COMMAND_LONG/MAV_CMD_NAV_LAND", "not in control", "1"),)
    assert would.rows == (("20.0 s", "GCSA", "would RETURN: out of coverage"),)


def test_the_last_word_of_each_book_counts() -> None:
    told = [{"seconds": 60.0, "over": False}, {"seconds": 120.0, "over": False}, {"seconds": 130.0, "over": True}]
    again = [{"seconds": 60.0, "over": False}]
    found = books([entry(values, float(t)) for t, values in enumerate([*told, *again])])
    assert [(each.get("seconds"), each.get("over")) for each in found] == [(130.0, True), (60.0, False)]


def test_a_companion_that_was_started_again_has_a_book_of_its_own() -> None:
    told = [{"seconds": 180.0, "over": False}, {"seconds": 60.0, "over": True, "restarted": True}]
    assert len(books([entry(values) for values in told])) == 2


def test_nothing_of_other_entries() -> None:
    assert books([Entry(1.0, "drone-1", "rehearsal", "", {})]) == []


def test_an_empty_book_has_empty_tables() -> None:
    assert [table.rows for table in tables(entry({}))] == [(), (), (), ()]

# SPDX-License-Identifier: GPL-3.0-or-later

"""The rehearsals of a journal as tables of the report: the vehicle's own book, read back."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.operator.rehearsal.rehearsal_stats import Foreseen, LinkSeen, RehearsalStats
from sitl.report.evidence import Evidence
from sitl.report.journal_reader import Entry
from sitl.report.rehearsal import EVENT, books, tables

HERE = (52.679, 5.9272)


def entry(values: dict[str, Any], t: float = 1.0, who: str = "drone-1") -> Entry:
    return Entry(t, who, EVENT, "", json.loads(json.dumps(values)))


@pytest.fixture
def book() -> RehearsalStats:
    seen = RehearsalStats(100.0, (Foreseen("GCSA", "GCSB", HERE, 3, 14.2), Foreseen("GCSB", "GCSA", HERE, 5, 15.0)))
    seen.saw(110.0, "GCSA+GCSB", HERE, [LinkSeen("GCSA", "udpout", 1.5, 0.02, 0.034)])
    seen.saw(111.0, "GCSA", HERE, [LinkSeen("GCSB", "udpout", None, None, None)])
    seen.handover("GCSA", "GCSB", 112.0, 0.034, "zone", distance_m)
    seen.refused("GCSB", "COMMAND_LONG/MAV_CMD_NAV_LAND", "not in control")
    seen.would(120.0, "would RETURN. Out of coverage")
    seen.end(130.0, "ended by GCSA")
    return seen


def test_what_the_vehicle_wrote_is_what_is_shown(book: RehearsalStats) -> None:
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
    assert would.rows == (("20.0 s", "GCSA", "would RETURN. Out of coverage"),)


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


def test_the_track_is_where_the_aircraft_was_carried() -> None:
    """Simulated it stands still, and the companion has it go north at 11 m/s while the rehearsal lasts."""
    stood = {"lat_deg": 52.0, "lon_deg": 5.0, "alt_m": 0.0, "heading_deg": 0.0, "speed_mps": 0.0}
    seen = [Entry(t, "vehicle", "sample", "", {"sim_s": t, **stood}) for t in (1.0, 3.0, 4.0, 6.0, 40.0)]
    places = [
        Entry(0.5 + t, "drone-1", "position", "", {"lat_deg": 52.0 + t * 1e-4, "lon_deg": 5.0, "alt_m": 1.0})
        for t in range(9)
    ]
    spoilt = Entry(3.7, "drone-1", "position", "", {"lat_deg": None, "lon_deg": "east"})
    moves = [Entry(t, "drone-1", "rehearsal", "", {"on": on}) for t, on in ((2.0, True), (5.0, False))]
    samples = Evidence([*seen, *places, spoilt, *moves], None).samples
    assert [sample.lat_deg for sample in samples] == pytest.approx([52.0, 52.0002, 52.0003, 52.0, 52.0])
    assert [sample.speed_mps for sample in samples] == pytest.approx([0.0, 11.1, 11.1, 0.0, 0.0], abs=0.1)


def test_where_nothing_was_rehearsed_the_vehicles_own_places_count() -> None:
    stood = {"lat_deg": 52.0, "lon_deg": 5.0, "alt_m": 0.0, "heading_deg": 0.0, "speed_mps": 0.0}
    seen = [Entry(t, "vehicle", "sample", "", {"sim_s": t, **stood}) for t in (1.0, 3.0)]
    places = [Entry(t, "drone-1", "position", "", {"lat_deg": 52.1, "lon_deg": 5.0}) for t in (0.5, 0.9, 2.9)]
    assert [sample.lat_deg for sample in Evidence([*seen, *places], None).samples] == [52.0, 52.0]

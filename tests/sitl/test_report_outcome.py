# SPDX-License-Identifier: GPL-3.0-or-later

"""What the report says first, how it tells of repeated messages, and of time."""

from __future__ import annotations

from typing import Any

import pytest

from mavproxy_handover.core.common.levels import DECISION_LEVELS, Level
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.mission.colours import STATION_COLOURS
from sitl.report.evidence import Evidence
from sitl.report.exchange import Exchange, Flight
from sitl.report.journal_reader import Entry
from sitl.report.kinds import kinds, rows
from sitl.report.outcome import Gravity, emergencies, level_of, outcome
from sitl.report.palette import dark
from sitl.report.style import STYLE
from sitl.report.times import Times, duration


def flight(*entries: tuple[float, str, str, dict[str, Any]]) -> Evidence:
    """Entries of a flight without a mission, on the wall clock."""
    return Evidence([Entry(t, who, event, values.pop("text", ""), values) for t, who, event, values in entries], None)


def said(evidence: Evidence) -> list[tuple[Gravity, str]]:
    return [(line.gravity, line.text) for line in outcome(evidence, [], Times(evidence))]


def sample(t: float, alt_m: float) -> tuple[float, str, str, dict[str, Any]]:
    values = {"sim_s": t, "lat_deg": 52.0, "lon_deg": 5.0, "alt_m": alt_m, "heading_deg": 0.0, "speed_mps": 3.0}
    return t, "vehicle", "sample", values


def test_a_record_that_ends_in_the_air_says_so_first() -> None:
    found = said(flight(sample(99.0, 0.0), (100.0, "vehicle", "airborne", {}), sample(161.5, 24.6)))
    assert found[0] == (Gravity.BAD, "What is recorded ends in the air, 25 m above home, at T+1:01.5.")


def test_motors_that_are_armed_to_the_end_are_no_good_end() -> None:
    found = said(
        flight(
            (90.0, "vehicle", "armed", {}),
            sample(100.0, 3.0),
            (100.0, "vehicle", "airborne", {}),
            sample(160.0, 0.0),
            (160.0, "vehicle", "landed", {"lat_deg": 52.0, "lon_deg": 5.0}),
        )
    )
    assert found[0] == (
        Gravity.BAD,
        "Landed at 52.000000 5.000000 after 1 min 0 s in the air, its motors armed to the end.",
    )


def test_an_aircraft_that_never_flew_is_not_said_to_have_landed() -> None:
    assert said(flight(sample(1.0, 0.0), sample(2.0, 0.0)))[0] == (Gravity.PLAIN, "It did not leave the ground.")


def test_an_emergency_lasts_until_it_is_over_or_the_aircraft_has_landed() -> None:
    evidence = flight(
        (0.0, "vehicle", "airborne", {}),
        (10.0, "drone-1", "emergency", {"text": "coverage ends ahead: hold"}),
        (12.0, "drone-1", "emergency", {"text": "commander lost: return"}),
        (14.0, "drone-1", "emergency_over", {}),
        (20.0, "drone-1", "emergency", {"reason": "commander_lost"}),
        (30.0, "vehicle", "landed", {}),
        (40.0, "drone-1", "emergency_over", {}),
    )
    found = [(stretch.begin_t, stretch.end_t, stretch.why, stretch.level) for stretch in emergencies(evidence)]
    assert found == [
        (10.0, 12.0, "coverage ends ahead: hold", Level.WARNING),
        (12.0, 14.0, "commander lost: return", Level.EMERGENCY),
        (20.0, 30.0, "commander lost", Level.EMERGENCY),
    ]


def test_a_hold_is_a_warning_as_at_the_station() -> None:
    evidence = flight(
        (0.0, "vehicle", "airborne", {}),
        (0.0, "drone-1", "view", {"phase": "on_mission", "commander": "GCSA", "epoch": 1}),
        (10.0, "drone-1", "emergency", {"text": "coverage ends ahead: hold"}),
        (12.0, "drone-1", "emergency_over", {}),
        (30.0, "vehicle", "landed", {}),
        sample(0.0, 3.0),
        sample(30.0, 0.0),
    )
    found = said(evidence)
    assert (Gravity.WARNING, "Held at T+0:10.0, for 2.00 s: coverage ends ahead: hold.") in found
    assert (Gravity.GOOD, "No emergency.") in found


@pytest.mark.parametrize("action", FlightAction)
def test_the_report_has_the_levels_of_the_vehicles_table(action: FlightAction) -> None:
    word = action.name.lower()
    for entry in ({"text": f"links weak: {word}"}, {"text": "links weak", "action": word}):
        (found,) = flight((1.0, "drone-1", "emergency", entry)).of(event="emergency")
        assert level_of(found) is DECISION_LEVELS[action]


def test_a_return_after_a_hold_is_an_emergency_from_the_return_on() -> None:
    evidence = flight(
        (0.0, "vehicle", "airborne", {}),
        (10.0, "drone-1", "emergency", {"text": "coverage ends ahead: hold"}),
        (70.0, "drone-1", "emergency", {"text": "coverage ends ahead: return"}),
        (90.0, "vehicle", "landed", {}),
        sample(0.0, 3.0),
        sample(90.0, 0.0),
    )
    found = said(evidence)
    assert (Gravity.WARNING, "Held at T+0:10.0, for 1 min 0 s: coverage ends ahead: hold.") in found
    assert (Gravity.BAD, "Emergency at T+1:10.0, for 20.00 s: coverage ends ahead: return.") in found


def test_nobody_commanding_in_the_air_is_told_with_its_time() -> None:
    views = [
        (-5.0, None), (0.0, "GCSA"), (30.0, None), (33.5, "GCSB"), (60.0, None),
    ]  # fmt: skip
    entries = [(t, "drone-1", "view", {"phase": "on_mission", "commander": who, "epoch": 1}) for t, who in views]
    evidence = flight(
        *entries, sample(0.0, 0.0), (1.0, "vehicle", "airborne", {}), (50.0, "vehicle", "landed", {}), sample(61.0, 0.0)
    )
    assert (Gravity.BAD, "No station commanded for 3.50 s in the air.") in said(evidence)


def test_leases_alone_do_not_say_that_there_was_no_emergency() -> None:
    view = {"commander": "GCSA", "epoch": 1, "lease": "held"}
    evidence = flight((0.0, "drone-1", "view", view), (1.0, "vehicle", "airborne", {}), (9.0, "vehicle", "landed", {}))
    assert not any("emergency" in text.lower() for _, text in said(evidence))


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.0124, "12.4 ms"), (2.972, "2.97 s"), (59.994, "59.99 s"), (327.4, "5 min 27 s"), (7384.0, "2 h 3 min")],
)
def test_how_long_something_took_has_the_unit_that_fits(seconds: float, words: str) -> None:
    assert duration(seconds) == words


@pytest.mark.parametrize(
    ("t", "words"),
    [
        (100.0, "T+0:00.0"),
        (99.97, "T+0:00.0"),
        (87.66, "T-0:12.3"),
        (159.96, "T+1:00.0"),
        (3761.0, "T+1:01:01.0"),
    ],
)
def test_time_since_take_off_is_a_clock(t: float, words: str) -> None:
    evidence = flight(sample(0.0, 0.0), (100.0, "vehicle", "airborne", {}), sample(4000.0, 5.0))
    assert Times(evidence).plus(t) == words


def exchange(number: int, flights: list[Flight], *, committed: bool = True, ended_t: float | None = 9.0) -> Exchange:
    reason = "zone" if committed else "commander_silent"
    return Exchange(number, "drone-1", "GCSA", "GCSB", 0.0, ended_t, committed, reason, 0.1, 2, tuple(flights))


def test_a_tower_of_the_same_question_is_one_row_and_its_pauses_are_told() -> None:
    waiting = [
        flight
        for t in (1.0, 2.0, 4.0, 8.0)
        for flight in (
            Flight("ON_HANDOVER", "drone-1", "GCSA", t, t + 0.01, relayed=True),
            Flight("OK_HANDOVER", "GCSA", "drone-1", t + 0.02, t + 0.03, consent="waiting"),
        )
    ]
    request = Flight("HANDOVER_REQUEST", "drone-1", "GCSB", 0.0, 0.001)
    result = Flight("HANDOVER_RESULT", "drone-1", "GCSA", 9.0, 9.1)
    found = [
        (row.flight.name if row.flight else "", row.times, row.pause_s)
        for row in rows(exchange(1, [request, *waiting, result]))
    ]
    assert found == [
        ("HANDOVER_REQUEST", 1, None),
        ("ON_HANDOVER", 4, 1.0),
        ("OK_HANDOVER", 4, None),
        ("", 1, pytest.approx(0.98)),
        ("HANDOVER_RESULT", 1, None),
    ]


def test_handovers_that_went_alike_are_one_kind_and_each_odd_one_is_its_own() -> None:
    request = Flight("HANDOVER_REQUEST", "drone-1", "GCSB", 0.0, 0.001)
    lost = Flight("HANDOVER_REQUEST", "drone-1", "GCSB", 0.0, None, lost=True)
    unknown = Flight("HANDOVER_REQUEST", "drone-1", "GCSB", 0.0, None)
    found = kinds(
        [
            exchange(1, [request]),
            exchange(2, [lost]),
            exchange(3, [unknown]),  # its receiver left no record: as far as one knows it went by the book
            exchange(4, [lost]),
            exchange(5, [request], committed=False),
        ]
    )
    told = [(kind.first.handover_id, [other.handover_id for other in kind.others], kind.odd) for kind in found]
    assert told == [(1, [3], False), (2, [], True), (4, [], True), (5, [], True)]


def test_every_station_has_a_colour_for_light_and_one_for_dark_screens() -> None:
    light, deep = STYLE.split("@media(prefers-color-scheme:dark)")
    for number, colour in enumerate(STATION_COLOURS):
        assert f"--station{number}:{colour}" in light
        assert f"--station{number}:{dark().get(colour.lower(), colour.lower())}" in deep.lower()

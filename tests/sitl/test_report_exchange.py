# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages of a handover put together from the journals of both ends."""

from __future__ import annotations

from dataclasses import replace

from sitl.report.exchange import Flight, exchanges, lanes
from sitl.report.journal_reader import Entry
from tests.sitl.synthetic import BEGUN_T, VEHICLE_NAME, evidence, nominal


def names(flights: tuple[Flight, ...]) -> list[str]:
    return [f"{flight.name} {flight.sender}>{flight.receiver}" for flight in flights]


def test_a_handover_by_the_book_has_its_seven_steps_in_order() -> None:
    first = exchanges(evidence())[0]
    assert (first.commander, first.partner, first.committed, first.epoch) == ("GCSA", "GCSB", True, 2)
    assert lanes(first) == ("GCSA", "drone-1", "GCSB")
    assert names(first.flights) == [
        "HANDOVER_REQUEST drone-1>GCSB",
        "ON_HANDOVER GCSB>GCSA",
        "ON_HANDOVER GCSB>drone-1",
        "OK_HANDOVER GCSA>drone-1",
        "CONNECT_HANDOVER drone-1>GCSB",
        "DRONE_CONNECTED GCSB>GCSA",
        "DRONE_CONNECTED GCSB>drone-1",
        "DISCONNECT_HANDOVER GCSA>drone-1",
        "HANDOVER_RESULT drone-1>GCSA",
        "HANDOVER_RESULT drone-1>GCSB",
    ]
    assert all(flight.received_t is not None and flight.sent_t is not None for flight in first.flights)
    assert [flight.ground for flight in first.flights][:3] == [False, True, False]


def test_the_message_that_was_lost_is_the_one_before_the_repetition() -> None:
    second = exchanges(evidence())[1]
    first_try, second_try = second.flights[:2]
    assert (first_try.attempt, first_try.received_t) == (1, None)
    assert second_try.attempt == 2
    assert second_try.received_t is not None
    assert second.duration_s == 0.2218


def test_what_the_vehicle_passed_on_is_told_from_what_it_said_itself() -> None:
    third = exchanges(evidence())[2]
    assert [(f.name, f.sender) for f in third.flights if f.relayed] == [
        ("ON_HANDOVER", "drone-1"),
        ("DRONE_CONNECTED", "drone-1"),
    ]


def test_two_sent_and_two_come_are_paired_in_order() -> None:
    def half(t: float, direction: str, who: str, station: str) -> Entry:
        fields = {"direction": direction, "name": "HANDOVER_REQUEST", "station": station, "handover_id": 1}
        return Entry(t, who, "message", "", fields)

    entries = [
        Entry(BEGUN_T, VEHICLE_NAME, "transfer_begun", "", {"handover_id": 1, "station": "GCSB"}),
        half(BEGUN_T + 0.0, "out", VEHICLE_NAME, "GCSB"),
        half(BEGUN_T + 0.2, "out", VEHICLE_NAME, "GCSB"),
        half(BEGUN_T + 0.25, "in", "GCSB", "vehicle"),
        half(BEGUN_T + 0.45, "in", "GCSB", "vehicle"),
    ]
    (exchange,) = exchanges(evidence(entries))
    assert [(f.sent_t, f.received_t) for f in exchange.flights] == [
        (BEGUN_T, BEGUN_T + 0.25),
        (BEGUN_T + 0.2, BEGUN_T + 0.45),
    ]
    assert (exchange.ended_t, exchange.committed) == (None, False)


def test_without_the_receivers_journal_the_sendings_stand_alone() -> None:
    entries = [entry for entry in nominal() if entry.who != "GCSB"]
    first = exchanges(evidence(entries))[0]
    alone = [flight for flight in first.flights if flight.received_t is None]
    assert names(tuple(alone)) == [
        "HANDOVER_REQUEST drone-1>GCSB",
        "CONNECT_HANDOVER drone-1>GCSB",
        "HANDOVER_RESULT drone-1>GCSB",
    ]


def test_time_runs_from_the_position_that_made_the_vehicle_begin() -> None:
    entries = [replace(entry, t=entry.t + 0.002) if entry.event == "transfer_begun" else entry for entry in nominal()]
    for exchange in exchanges(evidence(entries)):
        assert exchange.ended_t is not None
        assert exchange.duration_s is not None
        assert abs(exchange.ended_t - exchange.begun_t - exchange.duration_s) < 1e-6

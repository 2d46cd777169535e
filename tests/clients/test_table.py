# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of programs and jobs fits together, so that a run that takes half an hour does not end on a wrong word."""

from __future__ import annotations

from sitl.script.scenario import load_scenario
from tests.clients.flight import CONDITIONS, Flown, Row, table_of
from tests.clients.site import PROGRAMS, Done
from tests.clients.table import (
    CLIENTS,
    COMMANDER,
    ENVIRONMENTS,
    FLIGHT,
    NO_HEARTBEATS,
    OBSERVER,
    Expects,
    Job,
    Outcome,
    outcome_of,
)


def test_every_program_is_there_and_its_environment_is_made() -> None:
    assert {client.program for client in CLIENTS if not (PROGRAMS / client.program).is_file()} == set()
    used = {client.environment for client in CLIENTS} | {client.router for client in CLIENTS if client.router}
    assert used == set(ENVIRONMENTS)


def test_every_job_is_one_that_its_programs_know() -> None:
    for client in CLIENTS:
        source = (PROGRAMS / client.program).read_text(encoding="utf-8")
        jobs = {job.word for job in client.jobs if job.word in client.words}
        assert {word for word in jobs if f'"{word}"' not in source} == set(), client.name


def test_what_the_aircraft_must_do_can_be_looked_at() -> None:
    assert {job.aircraft for client in CLIENTS for job in client.jobs} - {""} <= set(CONDITIONS)


def test_every_job_is_done_by_a_program() -> None:
    done = {(job.word, client.name) for client in CLIENTS for job in client.jobs if job.word in client.words}
    assert {job.word for job in FLIGHT + NO_HEARTBEATS} == {word for word, _name in done}


def test_an_observer_is_refused_everything_that_changes_something() -> None:
    passed = {job.word for job in FLIGHT if job.station == OBSERVER and job.expects != Expects.REFUSED}
    assert passed == {"connect", "version", "modes", "mission", "parameters"}


def test_a_programs_own_word_is_not_taken_for_another_outcome() -> None:
    assert outcome_of("accepted") == outcome_of("success") == Outcome.DONE
    assert outcome_of("command_denied") == outcome_of("permission_denied") == Outcome.REFUSED
    assert outcome_of("temporarily_rejected") == outcome_of("no answer") == outcome_of("no change") == Outcome.OTHER


def test_the_rate_of_a_download_stands_beside_the_direct_one() -> None:
    job = Job(COMMANDER, "log", Expects.DONE, rate=True)
    row = Row(job, gate=Done("read", 4.0, 1_600_000), direct=Done("read", 2.0, 1_000_000))
    told = table_of(Flown(CLIENTS[0], rows=[row]))[-1]
    assert told == "| log | GCSA | read 1000000, 2.000 s | read 1600000, 4.000 s, 400 kB/s of 500 (0.80) | done |"


def test_the_flight_of_two_programs_of_mavsdk_can_be_read() -> None:
    assert set(load_scenario(PROGRAMS.parent / "mavsdk_flight.toml").standard) == {"GCSA", "GCSB"}

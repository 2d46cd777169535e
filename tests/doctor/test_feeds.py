# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds and onboard programs: what is configured, and what of it the journal of a running companion has."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.lock import VehicleLock
from tests.doctor.machine import Machine, Speaker, companion, heartbeat

STATE = "var/lib/handover/state"
JOURNAL = "var/lib/handover/flights/latest/drone-1.jsonl"
MORE = """
[feeds]
rtk = ["GCSB", "GCSA"]
adsb = ["GCSA"]
[[onboard]]
name = "precland"
link = "udpin:127.0.0.1:14600"
component = 25
rights = ["sensors"]
sensors = ["LANDING_TARGET"]
"""
LOADED = ("loaded", {"text": "handover"})
FITS = ("preflight", {"text": "guard, parameters and firmware fit", "fits": True})
HEARD = [("station_heard", {"station": name}) for name in ("GCSA", "GCSB")]
Entry = tuple[str, dict[str, object]]


@pytest.fixture(scope="module")
def armed() -> Iterator[Speaker]:
    speaker = Speaker(lambda: heartbeat(armed=True))
    yield speaker
    speaker.close()


@pytest.fixture
def machine(tmp_path: Path, armed: Speaker) -> Machine:
    made = companion(tmp_path, armed.device, {"GCSA": 9, "GCSB": 10})
    made.config.write_text(made.config.read_text() + MORE)
    return made


@pytest.fixture
def runs(machine: Machine) -> Iterator[Machine]:
    """With the lock of its vehicle held by this very process."""
    lock = VehicleLock(machine.path(STATE), "drone-1")
    yield machine
    lock.release()


def journal(machine: Machine, *entries: Entry) -> None:
    written = Journal(machine.path(JOURNAL), "drone-1")
    for event, values in (LOADED, *HEARD, FITS, *entries):
        written.write(event, **values)  # type: ignore[arg-type]
    assert written.wait_until_written(10.0)
    written.close()


def feed(change: str, text: str, station: str = "GCSB", kind: str = "rtk") -> Entry:
    return "feed", {"kind": kind, "station": station, "change": change, "text": text}


def program(text: str, **values: object) -> Entry:
    return "onboard", {"program": "precland", "text": text, **values}


def test_without_a_companion_the_configuration_is_told(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    found = machine.doctor(capsys, "--no-links")
    assert found.of("feeds", "ok") == [
        "RTK corrections: GCSB, then GCSA; whether one sends shows while the companion runs",
        "ADS-B: GCSA; whether one sends shows while the companion runs",
    ]
    assert found.of("onboard programs", "ok") == [
        "precland: system 1, component 25, to udpin:127.0.0.1:14600; whether it sends shows while the companion runs"
    ]


def test_a_station_that_is_not_known_is_named(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    machine.config.write_text(machine.config.read_text().replace('adsb = ["GCSA"]', 'adsb = ["GCSX"]'))
    (said,) = machine.doctor(capsys, "--no-links").of("configuration", "error")
    assert "[feeds] adsb" in said
    assert "'GCSX' must be one of the stations: GCSA, GCSB" in said


def test_corrections_and_a_program_that_never_came(runs: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    journal(runs)
    found = runs.doctor(capsys)
    assert found.of("feeds") == [
        "RTK corrections: none since the companion began; may come from GCSB, then GCSA",
        "ADS-B: GCSA; nothing has come since the companion began, which may be right",
    ]
    assert found.of("feeds", "warning") == found.of("feeds")[:1]
    assert found.of("onboard programs", "warning") == ["precland: was not heard since the companion began"]
    (do,) = [line for line in found.lines("warning") if "precland" in line]
    assert do.endswith("-> Start it: system 1, component 25, to udpin:127.0.0.1:14600.")


def test_what_comes_is_well(runs: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    old = feed("not used", "RTK corrections of GCSA are not used: too many bytes in a second.", "GCSA")
    journal(runs, old)
    journal(
        runs,
        feed("source", "RTK corrections: from GCSB."),
        program("precland is heard", heard=True),
        program("GCSA delegates guided targets to precland", by="GCSA"),
    )
    found = runs.doctor(capsys)
    assert found.of("feeds", "ok")[0] == "RTK corrections: from GCSB, by the companion that runs"
    assert found.of("feeds", "warning") == [], "what an earlier run has told is past"
    assert found.of("onboard programs") == ["precland: heard, by the companion that runs"]


def test_what_has_failed_is_told_with_its_reason(runs: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    placeless = "The base of GCSB does not send its place (RTCM 1005 or 1006): a second base is not checked."
    apart = "RTK corrections of GCSA are not used: its base is 3.0 m from that of GCSB (rtk_apart_m 1)."
    journal(
        runs,
        feed("source", "RTK corrections: from GCSB."),
        feed("no place", placeless),
        *[feed("not used", apart, "GCSA")] * 2,
        feed("silent", "RTK corrections: none. GCSB is silent for 3 s."),
        program("precland is heard", heard=True),
        program("precland is silent for 5 s", heard=False),
    )
    found = runs.doctor(capsys)
    assert found.of("feeds", "warning") == [
        "RTK corrections: none. GCSB is silent for 3 s",
        f"RTK corrections of GCSB: {placeless[:-1]}",
        f"RTK corrections of GCSA: {apart[:-1]}",
    ]
    assert found.of("onboard programs", "warning") == ["precland: is silent"]


def test_a_link_that_a_fault_has_closed(runs: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    closed = "Link of precland closed after an internal fault. Restart the companion on the ground."
    journal(runs, program("precland is heard", heard=True), program(closed))
    assert runs.doctor(capsys).of("onboard programs", "error") == [
        "precland: its link was closed after an internal fault"
    ]


def test_without_a_journal_nothing_is_said_to_be_well(runs: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    found = runs.doctor(capsys)
    for check in ("feeds", "onboard programs"):
        (said,) = found.of(check, "warning")
        assert "not looked at: the companion runs, and its journal is not found" in said


def test_sensors_of_programs_are_warnings_with_advice(runs: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    texts = [
        "LANDING_TARGET of an onboard program is not used: PLND_TYPE is 0",
        "PRX1_TYPE is 2, and no onboard program may send OBSTACLE_DISTANCE or its like",
    ]
    journal(runs, *[("preflight", {"text": text, "parameter": "", "fits": False}) for text in texts])
    found = runs.doctor(capsys)
    assert found.of("autopilot", "error") == []
    first, second = (line for line in found.lines("warning") if line.startswith("autopilot: onboard sensors: "))
    assert first.endswith("-> Set that parameter, or take the message out of [[onboard]].")
    assert second.endswith("-> Name the message in [[onboard]], if a program on the companion has that sensor.")

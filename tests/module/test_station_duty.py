# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover operator` at a station: what it changes for the vehicle, the journal and the console."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import module as gcs_module
from tests.module.conftest import Clock
from tests.module.test_station_module import START, StationBench

ACCEPTED, UNMANNED = mavlink.HANDOVER_CONNECT_RESULT_ACCEPTED, mavlink.HANDOVER_CONNECT_RESULT_UNMANNED


@pytest.fixture
def bench(tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Iterator[StationBench]:
    monkeypatch.setattr(gcs_module, "time", clock)
    made = StationBench(tmp_path, clock)
    made.config.write_text(made.config.read_text().replace("vehicle = 1", "vehicle = 1\nrequire_operator = true"))
    yield made
    made.close()
    assert made.mpstate.escaped == []


def answer(bench: StationBench) -> Any:
    return acknowledged(bench).result


def acknowledged(bench: StationBench) -> Any:
    bench.sent()
    bench.hear(mavlink.MAVLink_connect_message(251, 190, 1, 1, 1, 7, 1, 251, b"drone-1", list(bytes(32))))
    (ack,) = [m for m in bench.sent() if m.get_type() == "CONNECT_ACK"]
    return ack


def test_the_vehicle_hears_whether_the_station_is_manned(bench: StationBench) -> None:
    bench.load()
    assert bench.mpstate.console.said("No operator is on duty: this station takes no aircraft.")
    assert answer(bench) == UNMANNED
    bench.mpstate.type("handover operator Jansen")
    assert bench.mpstate.console.said("Jansen is on duty.")
    assert answer(bench) == ACCEPTED
    bench.mpstate.type("handover operator off")
    assert answer(bench) == UNMANNED


def test_the_vehicle_hears_the_operator_s_name(bench: StationBench) -> None:
    bench.load()
    assert acknowledged(bench).operator == ""
    bench.mpstate.type("handover operator Jansen")
    assert acknowledged(bench).operator == "Jansen"
    bench.mpstate.type("handover operator off")
    assert acknowledged(bench).operator == ""


@pytest.mark.parametrize("word", ["start", "request", "accept"])
def test_without_an_operator_the_station_asks_for_nothing(bench: StationBench, word: str) -> None:
    bench.load()
    (line,) = bench.mpstate.type(f"handover {word}")
    assert line == f"handover {word}: no operator is on duty. Sign on first: 'handover operator NAME'"
    assert bench.commands() == []


def test_commands_carry_the_operator_s_name_into_the_journal(bench: StationBench) -> None:
    bench.load()
    answer(bench)
    bench.mpstate.type("handover operator Jansen")
    bench.mpstate.type("handover start")
    assert [command for command, _parameter in bench.commands()] == [START]
    (entry,) = bench.journal("command")
    assert (entry["operator"], entry["text"]) == ("Jansen", "START sent. On duty: Jansen.")
    signed = bench.journal("operator")
    assert [(each.get("operator"), each["text"]) for each in signed][1:] == [("Jansen", "Jansen is on duty.")]


def test_the_next_operator_sees_the_state_before_the_shift_changes(bench: StationBench) -> None:
    bench.load()
    bench.mpstate.type("handover operator Jansen")
    lines = bench.mpstate.type("handover operator Bakker")
    assert any(line.startswith("commander") for line in lines)
    assert lines[-1] == "Read how it is, then type 'handover operator Bakker' once more. Jansen is on duty until then."
    assert bench.mpstate.type("handover operator Bakker")[-1].endswith("Bakker is on duty, after Jansen.")


def test_no_operator_leaves_while_the_aircraft_comes_to_this_station(bench: StationBench) -> None:
    bench.load()
    answer(bench)
    bench.mpstate.type("handover operator Jansen")
    core = bench.module.aircraft[0].core
    core.commander, core.partner = 252, 251
    line = bench.mpstate.type("handover operator off")[0]
    assert line.startswith("Jansen stays on duty: drone-1 flies under this station's command, or is about to.")
    core.partner = None
    bench.mpstate.type("handover operator off")
    assert bench.mpstate.console.said("Jansen has signed off.")


def test_a_restart_says_at_once_that_it_signed_the_operator_off(bench: StationBench) -> None:
    bench.load()
    bench.mpstate.type("handover operator Jansen")
    kept = bench.config.with_name("GCSA.operator")
    until = time.monotonic() + 10.0
    while not kept.is_file() and time.monotonic() < until:
        bench.run(1.0)
    bench.mpstate.unload("handover_gcs")
    bench.load()
    line = (
        "WARNING: Jansen is signed off: this station's program was started again. To sign on again, type 'handover "
        "operator Jansen'. This station takes no aircraft until then."
    )
    assert bench.mpstate.console.said(line)
    assert answer(bench) == UNMANNED, "the file signs nobody on"
    bench.mpstate.type("handover operator Jansen")
    assert answer(bench) == ACCEPTED

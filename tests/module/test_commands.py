# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover ...` at the companion's MAVProxy: every word of it, and odd ones."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench

USAGE = [
    "usage: handover <status|stations|zones|rehearsal|cancel|override>",
    "  status    phase, commander, epoch, lease, guard, mission, energy",
    "  stations  every station: link, liveness, what the gate did",
    "  zones     zones of the loaded mission and where the aircraft is",
    "  rehearsal what was seen in the rehearsal on the ground, or in the last one",
    "  cancel    call the present transfer off; the commander stays",
    "  override  energy|fence|coverage: let commands leave this limit for a minute, as the commander may",
]


@pytest.mark.parametrize("line", ["handover", "handover help"])
def test_no_word_shows_the_usage(bench: Bench, line: str) -> None:
    bench.load()
    assert bench.mpstate.type(line) == USAGE


@pytest.mark.parametrize(
    "words",
    [
        "foo",
        "status now",
        "STATUS",
        "cancel 7",
        "stations \x00",
        "zones --help",
        "set",
        "override",
        "override all",
        "override energy now",
        "ünïcode",
        "status " * 300,
    ],
)
def test_unknown_words_are_named_and_the_usage_shown(bench: Bench, words: str) -> None:
    bench.load()
    lines = bench.mpstate.type(f"handover {words}")
    assert lines == [f"handover: unknown command {' '.join(words.split())!r}", *USAGE]


def test_completion_offers_the_words_of_the_usage(bench: Bench) -> None:
    bench.load()
    assert bench.mpstate.completions["handover"] == [
        "<status|stations|zones|rehearsal|cancel|override>",
        "override <energy|fence|coverage>",
    ]
    assert bench.mpstate.command_map["handover"][1].startswith("authority handover"), "what MAVProxy's help shows"


def test_status_before_anything_is_heard_says_what_start_lacks(bench: Bench) -> None:
    bench.load()
    assert bench.mpstate.type("handover status") == [
        "phase     ON_LOAD",
        "commander no station, epoch 0, lease LOST",
        "guard     SILENT",
        "mission   none",
        "zone      none",
        "energy    unknown: no [energy] numbers",
        "START     not yet: GCSA does not command; no mission loaded; no autopilot; the guard does not answer the "
        "lease; no position",
    ]


def test_status_when_all_is_ready(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(delivery)
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None)
    assert bench.mpstate.type("handover status") == [
        "phase     ON_LOAD",
        "commander GCSA, epoch 1, lease HELD",
        "guard     LIVE, firmware 4.6, 0 leases refused",
        "mission   f433d144af77fc76",
        "zone      GCSA",
        "energy    126.0 Wh of 126.0 Wh left, 0 W, wind not known, 3.0 m/s from ahead, as configured",
        "place     home: 0 m away, needs 3 % of the battery (100 % left), covered by GCSA all the way",
        "START     ready",
        "preflight guard, parameters and firmware fit",
    ]


def test_status_tells_of_a_journal_that_loses_entries(bench: Bench) -> None:
    bench.load()
    for _ in range(3):
        bench.companion.journal.write("odd", value={(1, 2): 3})
    assert bench.companion.wait_until_written(10.0)
    assert bench.mpstate.type("handover status")[-1] == "journal   3 entries lost: is the disk full?"


def test_status_tells_who_speaks_in_the_companions_name(bench: Bench) -> None:
    bench.load()
    bench.companion.gate.in_our_name.update({(1, 191): 3, (1, 42): 7})
    line = "aboard    frames in the companion's name from the vehicle's side, by sender: 1/42 7, 1/191 3"
    assert bench.mpstate.type("handover status")[-1] == line


def test_stations_tells_link_liveness_and_verdicts(bench: Bench) -> None:
    bench.connect()
    bench.b.alive = False
    bench.b.command(mavlink.MAV_CMD_NAV_LAND)
    bench.wait(6.0)
    lines = bench.mpstate.type("handover stations")
    assert lines[0].startswith("GCSA (251): heard 0.")
    assert lines[0].endswith(" s ago, connected")
    assert lines[1].startswith(f"  udpout:127.0.0.1:{bench.a.port}: ")
    assert lines[1].endswith(" out, 0 damaged")
    assert lines[2].startswith("  gate: ")
    assert lines[3].startswith("GCSB (252): heard ")
    assert lines[3].endswith(" s ago, not connected")
    assert "not in control 1" in lines[5]


def test_zones_tells_where_the_aircraft_is(bench: Bench, delivery: MissionPackage) -> None:
    bench.load()
    assert bench.mpstate.type("handover zones") == ["no mission loaded, or no position yet"]
    bench.connect()
    bench.share(delivery)
    bench.run(0.5)
    inside, outside = bench.mpstate.type("handover zones")
    assert inside.startswith("GCSA: inside, ")
    assert inside.endswith(" m to its border")
    assert outside.startswith("GCSB: ")
    assert outside.endswith(" m away")


def test_cancel_without_a_transfer_says_so(bench: Bench) -> None:
    bench.load()
    assert bench.mpstate.type("handover cancel") == ["no transfer is under way"]


def test_a_fault_in_a_command_is_told_to_the_operator_and_journalled(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_arguments: object) -> None:
        raise RuntimeError("a bug")

    bench.load()
    with monkeypatch.context() as patch:
        patch.setattr(bench.companion.arbiter, "start_needs", broken)
        lines = bench.mpstate.type("handover status")
    assert lines[-1] == "handover: internal fault, see the journal"
    assert bench.companion.faults["command"] == 1

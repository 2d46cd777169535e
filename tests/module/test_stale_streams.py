# SPDX-License-Identifier: GPL-3.0-or-later

"""Through the module: sticks that ran before their station had control."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.vehicle import AUTO, Station


def sticks(throttle: int) -> Any:
    return mavlink.MAVLink_rc_channels_override_message(1, 1, 0, 0, throttle, *[0] * 15)


def stream(bench: Bench, station: Station, seconds: float) -> None:
    """What MAVProxy sends after `rc 3 1200`."""
    for _ in range(round(seconds * 10)):
        station.send(sticks(1200))
        bench.run(0.1)


def at_the_autopilot(bench: Bench, sysid: int) -> list[int]:
    """The throttle of the overrides that reached it, since this was last asked."""
    found = [message.chan3_raw for message in bench.autopilot.got("RC_CHANNELS_OVERRIDE", sysid)]
    bench.autopilot.received.clear()
    return found


def told(bench: Bench) -> list[tuple[str, str, str]]:
    return [(entry["station"], entry["stream"], entry["state"]) for entry in bench.journal("stream")]


@pytest.fixture
def flight(bench: Bench) -> Bench:
    """GCSA commands an armed aircraft, GCSB is an observer, both have been heard for a while."""
    bench.connect()
    bench.autopilot.armed = True
    bench.run(2.0)
    return bench


def test_a_lost_commander_that_returns_has_to_let_go_of_its_sticks_first(flight: Bench) -> None:
    stream(flight, flight.a, 1.0)
    assert at_the_autopilot(flight, 251) == [1200] * 10
    flight.a.alive = False
    flight.until(lambda: flight.companion.view.commander is None)
    flight.run(1.0)
    assert at_the_autopilot(flight, 251) == [0], "the companion's release"
    flight.a.alive = True
    flight.until(lambda: flight.companion.view.commander == 251)
    flight.autopilot.received.clear()
    stream(flight, flight.a, 5.0)
    assert at_the_autopilot(flight, 251) == []
    flight.a.send(sticks(0))
    flight.a.send(sticks(1300))
    flight.run(0.2)
    assert at_the_autopilot(flight, 251) == [0, 1300]
    assert told(flight) == [("GCSA", "RC override", "ran before"), ("GCSA", "RC override", "obeyed")]
    texts = [message.text for message in flight.a.got("STATUSTEXT")]
    assert texts[-3:] == [
        "Handover: RC override: stop it for 3 s first",
        "Handover: it ran before you had control",
        "Handover: RC override: obeyed from now on",
    ]
    assert {entry["reason"] for entry in flight.journal("refused")} == {"it ran before the station had control"}


def test_an_observers_sticks_are_refused_in_words(flight: Bench) -> None:
    stream(flight, flight.b, 2.0)
    assert at_the_autopilot(flight, 252) == []
    assert told(flight) == [("GCSB", "RC override", "refused")]
    assert flight.journal("stream")[0]["text"] == "RC override of GCSB refused: it does not command"
    assert [text for _severity, text in flight.b.told() if "commands now" not in text] == [
        "Handover: RC override: not in control",
        "Handover: RC override: end it before handover",
    ]


def test_sticks_that_a_pause_has_ended_are_told_of_with_the_tick(flight: Bench) -> None:
    stream(flight, flight.b, 1.0)
    flight.run(4.0)
    assert told(flight)[-1] == ("GCSB", "RC override", "ended")


def test_after_a_restart_in_flight_nobody_has_a_hand_on_the_sticks(bench: Bench, delivery: MissionPackage) -> None:
    """Whether they were live or refused before is not known any more."""
    bench.connect()
    bench.share(delivery)
    bench.run(2.0)
    bench.autopilot.armed = bench.autopilot.airborne = True
    bench.autopilot.mode = AUTO
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    stream(bench, bench.a, 1.0)
    bench.mpstate.unload("handover")
    bench.load()
    bench.until(lambda: bench.companion.view.commander == 251)
    bench.autopilot.received.clear()
    stream(bench, bench.a, 5.0)
    assert at_the_autopilot(bench, 251) == []
    bench.run(4.0)
    bench.a.send(sticks(1300))
    bench.run(0.1)
    assert at_the_autopilot(bench, 251) == [1300]


def test_a_fault_in_looking_after_them_costs_nothing_else(flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_now: float) -> None:
        raise RuntimeError("planted")

    monkeypatch.setattr(flight.companion.gate, "tick", broken)
    leases = len(flight.autopilot.leases())
    flight.run(1.0)
    assert len(flight.autopilot.leases()) >= leases + 4
    assert flight.companion.view.commander == 251

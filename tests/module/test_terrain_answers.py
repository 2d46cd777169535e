# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's requests for terrain through the whole companion: what is answered aboard, and what stations hear."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.terrain import Terrain
from tests.module.conftest import Bench
from tests.module.test_faults import broken

SOUTH, WEST = 52.70, 5.60


def bring(bench: Bench, delivery: MissionPackage, level_m: float) -> tuple[float, float]:
    """A grid around the aircraft's home, which is at 0 m; its home."""
    bench.connect()
    home = bench.companion.autopilot.aircraft.telemetry.home.value or (52.78, 5.70)
    bench.companion.autopilot.aircraft.has_home(*home, bench.clock.now)
    terrain = Terrain(home[0] - 0.05, home[1] - 0.05, 0.001, np.full((101, 101), level_m))
    bench.companion.autopilot.mission.flown.package = replace(delivery, terrain=terrain)
    return home


def ask(bench: Bench, lat: float, lon: float, mask: int) -> None:
    request = mavlink.MAVLink_terrain_request_message(round(lat * 1e7), round(lon * 1e7), 100, mask)
    bench.autopilot.say(request)
    for message in bench.autopilot._out:
        bench.mpstate.deliver(message)


@pytest.fixture
def level(monkeypatch: pytest.MonkeyPatch) -> None:
    """The autopilot's home is at the sea."""
    monkeypatch.setattr("mavproxy_handover.vehicle.state.VehicleState.home_alt_m", 0.0)


@pytest.mark.usefixtures("level")
def test_a_block_inside_the_grid_is_answered_aboard(bench: Bench, delivery: MissionPackage) -> None:
    home = bring(bench, delivery, 7.0)
    bench.autopilot.received.clear()
    bench.a.received.clear()
    ask(bench, *home, 0b101)
    bench.run(1.0)
    found = bench.autopilot.got("TERRAIN_DATA")
    assert [(m.gridbit, m.data, m.get_srcComponent()) for m in found] == [(0, [7] * 16, 191), (2, [7] * 16, 191)]
    assert bench.a.got("TERRAIN_REQUEST") == []


@pytest.mark.usefixtures("level")
def test_before_home_is_known_what_is_inside_waits(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = bring(bench, delivery, 7.0)
    bench.autopilot.received.clear()
    bench.a.received.clear()
    with monkeypatch.context() as unknown:
        unknown.setattr("mavproxy_handover.vehicle.state.VehicleState.home_alt_m", None)
        ask(bench, *home, 1)
        ask(bench, home[0] + 1.0, home[1], 1)
        bench.run(1.0)
    assert bench.autopilot.got("TERRAIN_DATA") == []
    asked = bench.a.got("TERRAIN_REQUEST")
    assert [message.lat for message in asked] == [round((home[0] + 1.0) * 1e7)]
    ask(bench, *home, 1)
    bench.run(1.0)
    assert [message.gridbit for message in bench.autopilot.got("TERRAIN_DATA")] == [0]


@pytest.mark.usefixtures("level")
def test_a_grid_that_does_not_have_home_is_not_used(bench: Bench, delivery: MissionPackage) -> None:
    home = bring(bench, delivery, 7.0)
    bench.companion.autopilot.aircraft.has_home(home[0] + 2.0, home[1], bench.clock.now)
    bench.autopilot.received.clear()
    ask(bench, *home, 1)
    bench.run(0.3)
    assert bench.autopilot.got("TERRAIN_DATA") == []
    assert len(bench.a.got("TERRAIN_REQUEST")) == 1


@pytest.mark.usefixtures("level")
def test_what_is_not_inside_goes_to_the_commander(bench: Bench, delivery: MissionPackage) -> None:
    home = bring(bench, delivery, 7.0)
    bench.autopilot.received.clear()
    ask(bench, home[0] + 1.0, home[1], 1)
    bench.run(1.0)
    assert bench.autopilot.got("TERRAIN_DATA") == []
    assert len(bench.a.got("TERRAIN_REQUEST")) == 1
    assert bench.b.got("TERRAIN_REQUEST") == []


@pytest.mark.usefixtures("level")
def test_heights_of_another_level_are_not_sent_and_told(bench: Bench, delivery: MissionPackage) -> None:
    home = bring(bench, delivery, 43.0)
    ask(bench, *home, 1)
    bench.run(1.0)
    assert len(bench.a.got("TERRAIN_REQUEST")) == 1
    assert bench.autopilot.got("TERRAIN_DATA") == []
    assert "The mission's terrain is at 43 m where the autopilot's home is at 0 m" in bench.b.texts()


@pytest.mark.usefixtures("level")
def test_a_fault_passes_the_request_to_the_commander(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = bring(bench, delivery, 7.0)
    monkeypatch.setattr(Terrain, "between_m", broken)
    ask(bench, *home, 1)
    bench.run(0.5)
    assert len(bench.a.got("TERRAIN_REQUEST")) == 1
    where: Any = bench.companion.faults
    assert where["answering a terrain request"] == 1

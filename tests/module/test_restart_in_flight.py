# SPDX-License-Identifier: GPL-3.0-or-later

"""The module is loaded again in flight: what the autopilot says before its first heartbeat proves nothing of arming."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as stock

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.package import MissionPackage, load
from tests.module.conftest import Bench
from tests.module.vehicle import AUTO

IN_AIR = 2


def extended_state() -> Any:
    own = stock.MAVLink(None, srcSystem=1, srcComponent=1)
    return stock.MAVLink(None).decode(bytearray(stock.MAVLink_extended_sys_state_message(0, IN_AIR).pack(own)))


def test_the_flight_goes_on_whatever_the_autopilot_says_first(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(delivery)
    bench.run(1.5)
    bench.autopilot.armed = bench.autopilot.airborne = True
    bench.autopilot.mode = AUTO
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.mpstate.unload("handover")
    bench.load()
    bench.mpstate.deliver(extended_state())
    assert bench.companion.view.phase is Phase.ON_MISSION
    assert not bench.journal("landed")
    bench.until(lambda: bench.companion.view.commander == 251)
    assert (bench.companion.view.phase, bench.companion.view.epoch) == (Phase.ON_MISSION, 2)
    assert len(bench.journal("started")) == 1


def test_the_mission_lies_beside_the_journal_of_every_run_that_flies_it(
    bench: Bench, delivery: MissionPackage, tmp_path: Path
) -> None:
    bench.connect()
    bench.share(delivery)
    bench.run(1.5)
    name = f"mission-{delivery.digest.hex()[:8]}"
    first = bench.companion.journal.path
    bench.autopilot.armed = bench.autopilot.airborne = True
    bench.autopilot.mode = AUTO
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.mpstate.unload("handover")
    second = tmp_path / "second" / "drone-1.jsonl"
    bench.load(journal=str(second))
    assert bench.companion.journal.wait_until_written(5.0)
    for journal in (first, second):
        assert load(journal.with_name(f"{journal.stem}-{name}")).digest == delivery.digest

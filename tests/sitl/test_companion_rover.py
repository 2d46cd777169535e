# SPDX-License-Identifier: GPL-3.0-or-later

"""A companion on what is flown by neither of the two firmwares: it says so in one line, and starts nothing."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from mavproxy_handover.mission import package as packages
from sitl.run.runner import Order, run
from sitl.run.story import Story
from sitl.script.places import mission_folder
from sitl.script.scenario import parse_scenario
from tests.sitl.firmware import Firmware

SCENARIO = """
name = "rover"
description = "START at a rover"
mission = "linear"

[[step]]
wait = {who = "drone-1", event = "authority", station = "GCSA", since = "begin"}

[[step]]
type = {station = "GCSA", line = "handover start"}

[[step]]
wait = {who = "drone-1", event = "start_refused", text = "*ground rover is neither ArduCopter nor ArduPlane*"}
timeout_s = 30

[[step]]
wait = {who = "drone-1", event = "preflight", text = "*ground rover is neither ArduCopter*", since = "begin"}
timeout_s = 30

[[step]]
pause_s = 2

[[expect]]
count = {who = "drone-1", event = "start_refused", count = 1}

[[expect]]
count = {who = "drone-1", event = "preflight", count = 1}

[[expect]]
count = {who = "drone-1", event = "started", count = 0}

[[expect]]
count = {who = "vehicle", event = "armed", count = 0}
"""


@pytest.mark.sitl
def test_a_rover_does_not_start(ardurover: Firmware, tmp_path: Path) -> None:
    order = Order(
        parse_scenario(SCENARIO, "rover.toml"),
        packages.load(mission_folder("linear")),
        "arducopter",
        1.0,
        tmp_path / "run",
        arducopter=str(ardurover.program),
    )
    result = run(order, Story(io.StringIO()))
    assert [verdict for verdict in result.verdicts if not verdict.held] == []
    assert len(result.verdicts) >= 6

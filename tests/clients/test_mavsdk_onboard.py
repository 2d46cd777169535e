# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVSDK on the companion, with real processes: the vehicle that ships, the companion, two stations, the program."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mavproxy_handover.mission import package as packages
from sitl.run.runner import Order, run
from sitl.run.story import Story
from sitl.run.wiring import ONBOARD
from sitl.script.places import mission_folder
from sitl.script.scenario import load_scenario, with_opening
from tests.clients.site import PROGRAMS
from tests.clients.table import CLIENTS, Client

pytestmark = [pytest.mark.clients, pytest.mark.process]

SCENARIO = Path(__file__).resolve().parent / "mavsdk_onboard.toml"
STATION = "mavsdk_station.py"


@pytest.mark.parametrize("client", [pytest.param(each, id=each.name) for each in CLIENTS if each.program == STATION])
def test_it_leads_while_that_is_delegated_and_a_handover_ends_it(
    client: Client, environments: Path, tmp_path: Path
) -> None:
    scenario = load_scenario(SCENARIO)
    package = packages.load(mission_folder(scenario.mission))
    program = (str(client.python(environments)), "-E", "-s", str(PROGRAMS / "mavsdk_onboard.py"))
    folder = tmp_path / "run"
    order = Order(with_opening(scenario, package), package, "builtin", 1.0, folder, instead={ONBOARD: program})
    result = run(order, Story(sys.stdout))
    assert [verdict for verdict in result.verdicts if not verdict.held] == []

# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVSDK as commander and as observer, with real processes: the vehicle that ships, the companion, two programs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.mission import package as packages
from sitl.run.runner import Order, run
from sitl.run.story import Story
from sitl.script.places import mission_folder
from sitl.script.scenario import load_scenario, with_opening
from tests.clients.site import CONTROL, PROGRAMS
from tests.clients.table import CLIENTS, Client

pytestmark = [pytest.mark.clients, pytest.mark.process]

HERE = Path(__file__).resolve().parent
PROGRAM = "mavsdk_station.py"
#: MAVSDK asks again after half a second, three times; who is answered at once is never asked again
AT_ONCE_S = 1.0
DENIED = {"command_denied", "denied", "permission_denied"}
SPEEDUP = 4.0


def entries(folder: Path, name: str, event: str) -> list[dict[str, Any]]:
    lines = (folder / name / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
    return [entry for entry in map(json.loads, lines) if entry["event"] == event]


@pytest.mark.parametrize("client", [pytest.param(each, id=each.name) for each in CLIENTS if each.program == PROGRAM])
def test_the_observer_is_refused_at_once_and_the_commander_flies(
    client: Client, environments: Path, tmp_path: Path
) -> None:
    scenario = load_scenario(HERE / "mavsdk_flight.toml")
    package = packages.load(mission_folder(scenario.mission))
    program = (str(client.python(environments)), "-E", "-s", str(PROGRAMS / PROGRAM), "--control", str(CONTROL))
    folder = tmp_path / "run"
    order = Order(
        with_opening(scenario, package),
        package,
        "builtin",
        SPEEDUP,
        folder,
        instead=dict.fromkeys(scenario.standard, program),
    )
    result = run(order, Story(sys.stdout))
    assert [verdict for verdict in result.verdicts if not verdict.held] == []

    for name in scenario.standard:
        assert len(entries(folder, name, "loaded")) == 1, "it was never started again"
        assert entries(folder, name, "position"), "it sees the aircraft"
        texts = {entry["text"]: entry["severity"] for entry in entries(folder, name, "said")}
        assert texts["Handover: GCSB commands now (handover 1)"] == "notice"
    observer = entries(folder, "GCSB", "command")
    refused = [entry for entry in observer if entry["result"] in DENIED]
    for entry in refused:
        print(f"{client.name}, observer: {entry['text']} after {entry['took_s'] * 1000:.1f} ms")
    assert len(refused) == 15  # release is one: no other station gives up the commander's control
    assert max(entry["took_s"] for entry in refused) < AT_ONCE_S
    said = {entry["text"] for entry in entries(folder, "GCSB", "said") if entry["severity"] == "warning"}
    assert {
        "Handover: arm refused: GCSA commands",
        "Handover: mission upload refused: GCSA commands",
        "Handover: parameter FS_OPTIONS refused: GCSA commands",
        "Handover: START refused: GCSA commands",
        # its release has shown that it can ask, so from then on the texts say so
        "Handover: mode RTL refused: GCSA commands (request control)",
        "Handover: LAND refused: GCSA commands (request control)",
        "Handover: disarm refused: GCSA commands (request control)",
    } <= said

# SPDX-License-Identifier: GPL-3.0-or-later

"""The scenarios with an operator's panel in a browser, flown; and what is said where there is no browser.

Flights need Chromium; skipped, saying so, where it is missing.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mavproxy_handover.mission import package as packages
from sitl.run import panel_driver, wiring
from sitl.script.places import SetupError, mission_folder
from sitl.script.scenario import known_scenarios, load_scenario
from tests.sitl.runner_flight import Start, starting

start = pytest.fixture(starting)
SCENARIOS = ("panel-consent", "panel-dead-station")


def bands(folder: Path, station: str) -> list[str]:
    """What the band of a panel has said, one after the other."""
    journal = folder / f"{station}-panel" / f"{station}-panel.jsonl"
    entries = [json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines()]
    return [entry["text"] for entry in entries if entry["event"] == "band"]


@pytest.mark.process
@pytest.mark.long
@pytest.mark.skipif(bool(panel_driver.why_not()), reason=panel_driver.why_not())
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_flight_with_panels_in_a_browser(start: Start, scenario: str, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    flown = start(folder, "--scenario", scenario, "--vehicle", "builtin", "--speedup", "3")
    out, story = flown.communicate(timeout=400)
    assert flown.returncode == 0, story
    assert json.loads(out)["held"] is True
    if scenario == "panel-consent":
        for name, own in (("GCSA", "Let GCSB take drone-#?"), ("GCSB", "Take drone-# from GCSA?")):
            assert any(
                band.startswith(("YOU | ", "GCSA | ")) and band.endswith(f" | {own}") for band in bands(folder, name)
            )
    else:
        assert any(
            band.startswith("NOT KNOWN | The program of station GCSA does not") for band in bands(folder, "GCSA")
        )


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_without_a_browser_it_is_said_in_one_line(
    scenario: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(panel_driver, "chromium", lambda: None)
    loaded = load_scenario(known_scenarios()[scenario])
    mission = mission_folder(loaded.mission)
    with pytest.raises(SetupError) as caught:
        wiring.lay_out(tmp_path, packages.load(mission), mission, loaded)
    assert str(caught.value).startswith(
        f"scenario {scenario} has panels in a browser, and no Chromium is installed here"
    )

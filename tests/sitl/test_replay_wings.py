# SPDX-License-Identifier: GPL-3.0-or-later

"""Replays of what has wings: its modes are ArduPlane's, by the mission that it is replayed on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mavproxy_handover.cli import main as handover
from tests.depth import first

FERRY = Path(__file__).parents[2] / "missions" / "ferry"
NAMES = "time,lat_deg,lon_deg,alt_m,mode,armed"


def eastward(path: Path, mode: str) -> Path:
    """From home straight to the east at 22 m/s, 100 m high, past all three stations; on the ground at first."""
    rows = [f"{1_780_000_000 + t},52.705,5.3,{0 if t < 5 else 100},{mode},{int(t >= 5)}" for t in range(10)]
    rows += [f"{1_780_000_010 + t},52.705,{5.3 + 0.000326 * t:.6f},100,{mode},1" for t in range(470)]
    path.write_text("\n".join([NAMES, *rows]) + "\n")
    return path


@pytest.mark.parametrize("mode", first(1, ["10", "AUTO"]))
def test_a_table_of_a_quadplane_has_its_commanders_from_its_start_on(
    tmp_path: Path, mode: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The fault: its heartbeats were a copter's, whose AUTO is mode 3, and 10 was none of its modes."""
    path = eastward(tmp_path / "flight.csv", mode)
    handover(["replay", str(path), "--mission", str(FERRY), "--json"])
    found = json.loads(capsys.readouterr().out)["replay"]
    assert [each["station"] for each in found["commanders"]] == ["GCSA", "GCSB", "GCSC"]
    assert "started" in [each["event"] for each in found["decisions"]]


@pytest.mark.parametrize("mode", ["LAND", "9", "BRAKE"])
def test_a_mode_that_arduplane_has_not_is_one_error(
    tmp_path: Path, mode: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = eastward(tmp_path / "flight.csv", mode)
    assert handover(["replay", str(path), "--mission", str(FERRY)]) == 2
    assert capsys.readouterr().err == (
        f"handover replay: {path}: line 2: mode: '{mode}' is no flight mode of ArduPlane\n"
    )

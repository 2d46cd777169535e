# SPDX-License-Identifier: GPL-3.0-or-later

"""Replays of recordings that are no tlog: a dataflash log of ArduCopter, and a table.

`linear-arducopter.bin` is the log of a flight of `linear` on ArduCopter 4.7-dev, with fewer entries a second and
without the kinds that are not read. Its journal of then has the same: GCSA, GCSB, GCSA.
"""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.cli import main as handover

DATA = Path(__file__).parents[1] / "data" / "replay"
LINEAR = Path(__file__).parents[2] / "missions" / "linear"
BEGIN = "2026-06-01T12:00:"


def run(path: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[int, dict[str, Any]]:
    code = handover(["replay", str(path), "--mission", str(LINEAR), "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def table(path: Path, rows: list[str], names: str = "time,lat_deg,lon_deg,alt_m") -> Path:
    path.write_text("\n".join([names, *rows]) + "\n")
    return path


def eastward(seconds: int, more: str = "") -> list[str]:
    """From home 0.0001 degrees (6.8 m) a second to the east, 30 m high."""
    return [f"{1_780_000_000 + t},52.6841,{5.910 + 0.0001 * t:.4f},30{more}" for t in range(seconds)]


def test_a_dataflash_log_has_the_commanders_of_its_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "00000001.BIN"
    path.write_bytes(gzip.decompress((DATA / "linear-arducopter.bin.gz").read_bytes()))
    code, found = run(path, capsys)
    assert code == 0
    commanders = found["replay"]["commanders"]
    assert [each["station"] for each in commanders] == ["GCSA", "GCSB", "GCSA"]
    # 4 times as fast as the clock on the wall, the journal has 26.6 s between both commits
    assert commanders[2]["at"] - commanders[1]["at"] == pytest.approx(106.3, abs=1.0)
    assert [each["event"] for each in found["replay"]["decisions"]][-1] == "landed"
    assert "the guard: alive all the time" in found["not_recorded"]


def test_a_table_of_places_shows_where_authority_would_have_moved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, found = run(table(tmp_path / "flight.csv", eastward(90)), capsys)
    assert code == 0
    entered = [each for each in found["replay"]["decisions"] if each["event"] == "zone_entered"]
    assert [each["station"] for each in entered] == ["GCSA", "GCSB"]
    # the flights of `linear` enter the zone of GCSB at 5.91486 degrees east
    assert entered[1]["at"] - 1_780_000_000 == pytest.approx(48.6, abs=0.5)
    assert [each["station"] for each in found["replay"]["commanders"]] == ["GCSA", "GCSB"]
    told = "\n".join(found["not_recorded"])
    for words in ("AUTO all the time", "which item was flown to: not known", "the battery: not known"):
        assert words in told


def test_a_wider_margin_moves_the_border_of_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = run(table(tmp_path / "flight.csv", eastward(70)), capsys, "--set", "enter_margin_m=73")
    assert code == 1
    moved = [each["at"] for each in found["tried"]["decisions"] if each["event"] == "transfer_committed"]
    before = [each["at"] for each in found["replay"]["decisions"] if each["event"] == "transfer_committed"]
    assert moved[0] - before[0] == pytest.approx(68.0 / 6.76, abs=0.3)


def test_a_battery_that_runs_low_in_a_table_brings_it_home(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = "time,lat_deg,lon_deg,alt_m,battery_percent,voltage_v,current_a,mode,armed"
    rows = [
        f"{1_780_000_000 + t},52.6841,{5.910 + 0.00002 * t:.5f},30,{max(2, 100 - 3 * t)},22.2,16,AUTO,1"
        for t in range(60)
    ]
    _code, found = run(table(tmp_path / "flight.csv", rows, names), capsys)
    emergencies = [each for each in found["replay"]["decisions"] if each["event"] == "emergency"]
    assert [each["reason"] for each in emergencies][:1] == ["energy"]
    assert found["replay"]["not_flown"], "it went on: the order was not followed"


def test_times_are_read_as_people_write_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{BEGIN}{t:02d}+02:00,52.6841,5.9101,20" for t in range(5)]
    _code, found = run(table(tmp_path / "flight.csv", rows), capsys)
    assert found["end"] == pytest.approx(1780308004.0, abs=0.2)  # 10:00:04 UTC


@pytest.mark.parametrize(
    ("names", "rows", "said"),
    [
        ("time,lat_deg,alt_m", ["1,2,3"], "no column lon_deg"),
        ("time,lat_deg,lon_deg,alt_m", ["1,52,5,30"], "1 rows"),
        ("time,lat_deg,lon_deg,alt_m", ["1,52,5,30", "1,52,5,30"], "line 3: time: not later"),
        ("time,lat_deg,lon_deg,alt_m", ["1,52,5,30", "2,95,5,30"], "line 3: lat_deg: '95' must be -90 to 90"),
        ("time,lat_deg,lon_deg,alt_m", ["1,52,nan,30", "2,52,5,30"], "line 2: lon_deg: 'nan'"),
        ("time,lat_deg,lon_deg,alt_m", ["1,52,5,", "2,52,5,30"], "line 2: alt_m: is missing"),
        ("time,lat_deg,lon_deg,alt_m", ["noon,52,5,1", "2,52,5,30"], "line 2: time: 'noon'"),
        ("time,lat_deg,lon_deg,alt_m,mode", ["1,52,5,1,HOVER", "2,52,5,30,AUTO"], "line 2: mode: 'HOVER'"),
    ],
)
def test_a_bad_table_is_one_error_with_its_line(
    tmp_path: Path, names: str, rows: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "flight.csv", rows, names)
    assert handover(["replay", str(path), "--mission", str(LINEAR)]) == 2
    error = capsys.readouterr().err
    assert f"{path}: " in error
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "contents", "said"),
    [
        ("flight.bin", b"", "is empty"),
        ("flight.bin", b"\xa3\x95 nothing of the kind" * 40, "no positions (POS) in it"),
        ("flight.txt", b"", "must be one of .tlog, .bin, .csv"),
        ("flight.csv", b"\xff\xfe\x00", "not a table"),
    ],
)
def test_a_file_of_another_kind_is_one_error(
    tmp_path: Path, name: str, contents: bytes, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(contents)
    assert handover(["replay", str(path), "--mission", str(LINEAR)]) == 2
    assert said in capsys.readouterr().err
    assert handover(["replay", str(tmp_path / "none.tlog"), "--mission", str(LINEAR)]) == 2
    assert "none.tlog: No such file" in capsys.readouterr().err

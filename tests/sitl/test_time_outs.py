# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of time-outs: what is measured in the journals of a run, and what is outside."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sitl.time_outs import ROWS, Run, main, table

CONFIG = """
[vehicle]
name = "drone-1"
sysid = 1
parent = "GCSA"
guard = true
allow_unsigned = true

[[station]]
name = "GCSA"
sysid = 251
links = ["udpout:127.0.0.1:23593"]

[[station]]
name = "GCSB"
sysid = 252
links = ["udpout:127.0.0.1:23594"]

[limits]
hold_s = 10.0
"""


def written(
    folder: Path, companion: list[dict[str, Any]], said: list[dict[str, Any]] | None = None, **facts: Any
) -> Path:
    """A run whose journals say this; times in simulated seconds."""
    (folder / "companion").mkdir(parents=True)
    (folder / "run.json").write_text(
        json.dumps({"vehicle": "builtin", "speedup": 8.0, "marks": {}, "kills": {}, **facts})
    )
    (folder / "companion" / "companion.toml").write_text(CONFIG)
    for path, entries in (
        (folder / "companion" / "companion.jsonl", companion),
        (folder / "vehicle.jsonl", said or []),
    ):
        path.write_text("".join(f"{json.dumps(entry)}\n" for entry in entries))
    return folder


def measured(folder: Path, name: str) -> list[float]:
    (row,) = (each for each in ROWS if each.name == name)
    return [round(value, 3) for value in row.measure(Run(folder))]


def message(t: float, attempt: int, direction: str = "out") -> dict[str, Any]:
    return {
        "t": t, "event": "message", "direction": direction, "station": "GCSA", "attempt": attempt,
        "name": "ON_HANDOVER", "handover_id": 1, "epoch": 1,
    }  # fmt: skip


def test_a_commander_is_lost_so_long_after_its_last_heartbeat_or_message(tmp_path: Path) -> None:
    lost = {
        "t": 105.2,
        "utc": "2026-11-27T10:40:05.200+00:00",
        "event": "authority_lost",
        "text": "GCSA is lost: no station commands",
        "station": "GCSA",
    }
    folder = written(tmp_path / "run", [lost], kills={"GCSA": 101.0})
    station = mavlink.MAVLink(None, srcSystem=251, srcComponent=190)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station)
    # 2026-11-27T10:39:59 and 10:40:00.1
    log = b"".join(struct.pack(">Q", round(at_s * 1e6)) + beat for at_s in (1_795_776_000.0 - 1.0, 1_795_776_000.1))
    (folder / "companion" / "companion.tlog").write_bytes(log)
    assert measured(folder, "commander lost") == [5.1]


def test_of_retransmissions_those_without_an_answer_between_them_count(tmp_path: Path) -> None:
    sent = [message(100.0, 1), message(100.2, 2), message(100.5, 3), message(100.6, 0, "in"), message(100.7, 4)]
    folder = written(tmp_path, sent)
    assert measured(folder, "first retransmission") == [0.2]
    assert measured(folder, "later retransmissions") == []


def test_the_guard_is_measured_by_what_the_vehicle_says(tmp_path: Path) -> None:
    lost = {"t": 100.0, "event": "authority_lost", "text": "GCSB answers no more: no station commands"}
    said = {"t": 103.05, "event": "said", "text": "HNDO: no authority, in RTL"}
    assert measured(written(tmp_path / "one", [lost], [said]), "guard: lease says LOST, RTL") == [3.05]
    committed = {"t": 101.0, "event": "transfer_committed", "text": "handover 2 committed: GCSA commands, epoch 3"}
    assert measured(written(tmp_path / "other", [lost, committed], [said]), "guard: lease says LOST, RTL") == []


def test_the_table_has_a_column_for_each_kind_of_run_and_names_what_is_outside(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def hold(seconds: float) -> list[dict[str, Any]]:
        return [
            {"t": 100.0, "event": "emergency", "text": "coverage ends ahead: hold"},
            {"t": 100.0 + seconds, "event": "emergency", "text": "coverage ends ahead: return"},
        ]

    written(tmp_path / "1", hold(10.02), speedup=1.0)
    written(tmp_path / "2", hold(10.04))
    written(tmp_path / "3", hold(10.06), vehicle="arducopter")
    assert main([str(tmp_path)]) == 0
    assert (
        "| hold at the border, then return | `hold_s` | 10 | 10.02 (1) | 10.04 (1) | 10.06 (1) |"
        in capsys.readouterr().out
    )
    written(tmp_path / "4", hold(1.25))
    assert main([str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "| 10.02 (1) | 1.25 to 10.04 (2) | 10.06 (1) |" in out
    assert f"OUTSIDE: hold at the border, then return: 1.25 s instead of 10.00 s in {tmp_path / '4'}" in out


def test_a_time_out_that_no_run_has_met_stays_in_the_table(tmp_path: Path) -> None:
    lines, wrong = table([Run(written(tmp_path, []))])
    assert len(lines) == 2 + len(ROWS)
    assert lines[2] == "| commander lost | `heartbeat_lost_s` | | - | - | - |"
    assert wrong == []

# SPDX-License-Identifier: GPL-3.0-or-later

"""Recorded flights through today's rules: what was decided then is decided now, and other limits show their difference.

The recordings are of three simulated flights (`handover sim`): the companion's tlog, its journal and its configuration,
without what the replay does not read.
"""

from __future__ import annotations

import gzip
import json
import shutil
import struct
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.cli import main as handover
from sitl.replay.recording import read_tlog
from tests.packages import MISSIONS, ROUND

FLIGHTS = Path(__file__).parents[1] / "data" / "replay"
#: the package that each of them flew
MISSION = {"linear": MISSIONS / "linear", "commander-dead": ROUND, "out-of-coverage": ROUND}


@pytest.fixture
def flight(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """The tlog of the flight that is named, with journal and configuration beside it."""
    folder = FLIGHTS / request.param
    (tmp_path / "flight.tlog").write_bytes(gzip.decompress((folder / "flight.tlog.gz").read_bytes()))
    for name in ("flight.jsonl", "flight.toml"):
        shutil.copy(folder / name, tmp_path / name)
    (tmp_path / "mission").symlink_to(MISSION[request.param])
    return tmp_path / "flight.tlog"


def run(flight: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[int, dict[str, Any]]:
    code = handover(["replay", str(flight), "--mission", str(flight.parent / "mission"), "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def events(found: list[dict[str, Any]]) -> list[str]:
    return [" ".join(filter(None, (each["event"], each.get("reason"), each.get("action")))) for each in found]


@pytest.mark.parametrize(
    ("flight", "commanders", "decided"),
    [
        (
            "linear",
            [("GCSA", "parent_connected"), ("GCSB", "zone"), ("GCSA", "zone")],
            ["transfer_committed zone", "landed landed"],
        ),
        (
            "commander-dead",
            [("GCSA", "parent_connected"), (None, "commander_lost"), ("GCSB", "commander_lost")],
            ["authority_lost commander_lost", "decision commander_lost return to rally 2"],
        ),
        (
            "out-of-coverage",
            [("GCSA", "parent_connected")],
            ["emergency out_of_coverage", "decision out_of_coverage return to home"],
        ),
    ],
    indirect=["flight"],
)
def test_what_was_decided_in_a_flight_is_decided_in_its_replay(
    flight: Path, commanders: list[tuple[str, str]], decided: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    code, found = run(flight, capsys)
    happened = found["happened"]
    assert (happened["only_before"], happened["only_after"]) == ([], [])
    assert code == 0
    assert happened["equal"]
    assert happened["apart_s"] < 0.25
    assert [(each["station"], each["reason"]) for each in found["replay"]["commanders"]] == commanders
    for event in decided:
        assert event in events(found["replay"]["decisions"])
    # as many as the journal has, not one more or less
    journal = [json.loads(line)["event"] for line in (flight.parent / "flight.jsonl").read_text().splitlines()]
    for event in ("zone_entered", "transfer_begun", "transfer_committed", "emergency", "decision"):
        assert journal.count(event) == sum(each["event"] == event for each in found["replay"]["decisions"])


@pytest.mark.parametrize("flight", ["commander-dead"], indirect=True)
def test_other_limits_are_listed_with_what_they_change(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = run(flight, capsys, "--set", "limits.heartbeat_lost_s=4")
    assert code == 1
    assert found["changes"] == ["limits.heartbeat_lost_s: 2.5 -> 4.0"]
    assert found["happened"]["equal"]
    lost = [each["at"] for each in found["tried"]["decisions"] if each["event"] == "authority_lost"]
    before = [each["at"] for each in found["replay"]["decisions"] if each["event"] == "authority_lost"]
    assert lost[0] - before[0] == pytest.approx(1.5, abs=0.06)
    assert "authority_lost commander_lost" in events(found["difference"]["only_before"])
    assert "authority_lost commander_lost" in events(found["difference"]["only_after"])


@pytest.mark.parametrize("flight", ["linear"], indirect=True)
def test_a_limit_that_changes_nothing_differs_in_nothing(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = run(flight, capsys, "--set", "step_timeout_s=8")
    assert code == 0
    assert found["changes"] == ["limits.step_timeout_s: 4.0 -> 8.0"]
    assert found["difference"]["equal"]
    assert len(found["difference"]["both"]) == 13


@pytest.mark.parametrize("flight", ["linear"], indirect=True)
def test_a_journal_that_says_something_else_is_told_apart(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal = flight.parent / "flight.jsonl"
    lines = journal.read_text().splitlines()
    journal.write_text("\n".join(line for line in lines if '"zone_left"' not in line or "GCSB" in line) + "\n")
    code, found = run(flight, capsys)
    assert code == 1
    assert [each["text"] for each in found["happened"]["only_after"]] == ["zone of GCSA left"]
    assert found["happened"]["only_before"] == []


@pytest.mark.parametrize("flight", ["commander-dead"], indirect=True)
def test_a_tlog_alone_says_what_is_assumed(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The commander's heartbeats are in it, so its loss is found without a journal."""
    code, found = run(flight, capsys, "--no-journal")
    assert code == 0
    assert found["happened"] is None
    assert [each["station"] for each in found["replay"]["commanders"]] == ["GCSA", None, "GCSB"]
    told = "\n".join(found["not_recorded"])
    for words in (
        "START is taken to come when it arms",
        "every question is granted at once",
        "all of them all the time",
    ):
        assert words in told


@pytest.mark.parametrize("flight", ["linear"], indirect=True)
def test_a_recording_that_begins_in_flight_begins_under_its_first_lease(
    flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From between both handovers on: GCSB commands, and gives to GCSA."""
    begin = read_tlog(flight).begin
    data, place = flight.read_bytes(), 0
    while struct.unpack_from(">Q", data, place)[0] / 1e6 < begin + 25.0:
        place += 8 + 12 + data[place + 9] + (13 if data[place + 10] & 1 else 0)
    flight.write_bytes(data[place:])
    code, found = run(flight, capsys, "--no-journal")
    assert code == 0
    commanders = [(each["station"], each["reason"]) for each in found["replay"]["commanders"]]
    assert commanders == [("GCSB", "commander_returned"), ("GCSA", "zone")]
    assert found["replay"]["commanders"][1]["at"] - begin == pytest.approx(40.75, abs=0.3)
    assert "what was before: it begins in flight, as after a restart under GCSB" in found["not_recorded"]


@pytest.mark.parametrize("flight", ["linear"], indirect=True)
def test_another_mission_has_stations_of_its_own(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The mission `linear` with two other stations, of which the journal says nothing."""
    other = flight.parent / "other"
    other.mkdir()
    for path in (MISSIONS / "linear").iterdir():
        text = path.read_text().replace("GCSA", "WEST").replace("GCSB", "EAST")
        (other / path.name).write_text(text.replace("251", "201").replace("252", "202"))
    (flight.parent / "mission").unlink()
    (flight.parent / "mission").symlink_to(other)
    code, found = run(flight, capsys)
    assert code == 1
    assert [each["station"] for each in found["replay"]["commanders"]] == ["WEST", "EAST", "WEST"]
    assert [each["text"] for each in found["happened"]["only_before"]].count("zone of GCSB entered") == 1
    assert "none is in the journal" in "\n".join(found["not_recorded"])


@pytest.mark.parametrize("flight", ["out-of-coverage"], indirect=True)
def test_people_read_it_in_order_of_time(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    margin = "leave_margin_m=40"
    code = handover(["replay", str(flight), "--mission", str(flight.parent / "mission"), "--set", margin])
    text = capsys.readouterr().out
    assert code == 1
    assert "  = T+   11.6" in text
    assert "11 the same" in text
    assert "limits.leave_margin_m: 5.0 -> 40.0" in text
    assert "  - T+   12.6" in text
    assert "  + T+   13." in text


@pytest.mark.parametrize("flight", ["linear"], indirect=True)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "limits.enter_margin_m"), "--set limits.enter_margin_m: must be KEY=VALUE"),
        (("--set", "limits.enter_margin_m=5000"), "enter_margin_m"),
        (("--set", "stations.x=1"), "[stations] is none of limits"),
        (("--set", "limits.enter_margin=3"), "did you mean 'enter_margin_m'?"),
        (("--config", "none.toml"), "none.toml: no such file"),
        (("--journal", "none.jsonl"), "none.jsonl: No such file"),
    ],
)
def test_bad_words_are_one_error(
    flight: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code = handover(["replay", str(flight), "--mission", str(flight.parent / "mission"), *words])
    error = capsys.readouterr().err
    assert code == 2
    assert said in error
    assert error.startswith("handover replay: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize("contents", [b"", b"no tlog at all, of any kind", b"\0" * 5000])
def test_a_file_that_is_no_recording_is_one_error(
    tmp_path: Path, contents: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(contents)
    assert handover(["replay", str(path), "--mission", str(MISSIONS / "linear")]) == 2
    assert f"{path}: no heartbeat of an autopilot in it" in capsys.readouterr().err


@pytest.mark.parametrize("flight", ["out-of-coverage"], indirect=True)
def test_noise_within_a_tlog_costs_what_it_hits(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = bytearray(flight.read_bytes())
    data[20000:20100] = bytes(100)
    data[30000] ^= 0xFF
    flight.write_bytes(bytes(data[:-7]))
    code, found = run(flight, capsys)
    assert any("bytes are no part of a message" in words for words in found["not_recorded"])
    assert [each["station"] for each in found["replay"]["commanders"]] == ["GCSA"]
    assert code == 0

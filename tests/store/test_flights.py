# SPDX-License-Identifier: GPL-3.0-or-later

"""Folders of flights: no run touches another one's, and what may be deleted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from mavproxy_handover.cli.logs import main
from mavproxy_handover.store import flights as module
from mavproxy_handover.store.flights import Flight, begin, delete, flights, latest_flight, to_go

NOON = datetime(2026, 5, 17, 12, 0, 0, tzinfo=timezone.utc)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "vehicle.toml"
    path.write_text("[vehicle]\n")
    return path


@pytest.fixture(autouse=True)
def released() -> Iterator[None]:
    """What a test holds is given back at its end: a process holds it until its own."""
    before = set(os.listdir("/proc/self/fd"))
    yield
    for descriptor in set(os.listdir("/proc/self/fd")) - before:
        try:
            if os.readlink(f"/proc/self/fd/{descriptor}").endswith(".held"):
                os.close(int(descriptor))
        except OSError:
            continue


def flight(name: str, ended_days_ago: float, size: int, *, held: bool = False) -> Flight:
    ended = NOON - timedelta(days=ended_days_ago)
    return Flight(Path(name), "drone-1", ended - timedelta(hours=1), ended, size, held)


def test_each_run_has_a_folder_of_its_own_whatever_the_clock_says(tmp_path: Path, config: Path) -> None:
    base = tmp_path / "flights"
    first = begin(base, "drone-1", NOON, {"version": "1"}, config)
    second = begin(base, "drone-1", NOON, {"version": "1"}, config)
    third = begin(base, "drone-1", NOON, {}, config)
    earlier = begin(base, "GCS A", NOON - timedelta(days=9000), {}, config)
    assert [path.name for path in (first, second, third, earlier)] == [
        "20260517T120000Z-drone-1",
        "20260517T120000Z-drone-1+2",
        "20260517T120000Z-drone-1+3",
        "20010925T120000Z-GCS_A",
    ]
    assert (base / "latest").resolve() == earlier
    assert json.loads((first / "run.json").read_text()) == {"begun_utc": "2026-05-17T12:00:00+00:00", "version": "1"}
    assert (first / "vehicle.toml").read_text() == "[vehicle]\n"


def test_the_list_is_in_the_order_in_which_they_began(tmp_path: Path, config: Path) -> None:
    base = tmp_path / "flights"
    for _number in range(12):
        begin(base, "drone-1", NOON, {}, config)
    begin(base, "drone-1", NOON - timedelta(hours=1), {}, config)
    (base / "notes").mkdir()
    (base / "20260517T120000Z-x").write_text("a file")
    (base / "20269917T120000Z-drone-1").mkdir()
    names = [each.path.name for each in flights(base)]
    assert names[:3] == ["20260517T110000Z-drone-1", "20260517T120000Z-drone-1", "20260517T120000Z-drone-1+2"]
    assert names[-1] == "20260517T120000Z-drone-1+12"
    assert len(names) == 13


def test_starts_that_fail_one_after_the_other_leave_one_folder(tmp_path: Path, config: Path) -> None:
    """As a service manager starts a station whose key others may read, every two seconds for a night."""
    base = tmp_path / "flights"
    other = begin(base, "GCSB", NOON + timedelta(seconds=1), {}, config)
    (base / "20260517T110000Z-GCSA").write_text("a file")
    for number in range(4):
        folder = _begun_and_over(base, "GCSA", NOON + timedelta(seconds=2 * number), config)
        (folder / "GCSA.tlog").touch()
    assert [each.path.name for each in flights(base)] == [other.name, "20260517T120006Z-GCSA"]
    assert (base / "latest").resolve().name == "20260517T120006Z-GCSA"


@pytest.mark.parametrize("written", ["GCSA.jsonl", "GCSA.tlog", "mission/plan.waypoints"])
def test_what_a_run_wrote_stays_when_the_next_one_begins(written: str, tmp_path: Path, config: Path) -> None:
    folder = _begun_and_over(tmp_path, "GCSA", NOON, config)
    (folder / written).parent.mkdir(exist_ok=True)
    (folder / written).write_text("{}")
    _begun_and_over(tmp_path, "GCSA", NOON + timedelta(seconds=2), config)
    assert (folder / written).read_text() == "{}"


def test_a_run_that_has_written_nothing_yet_and_lives_stays(tmp_path: Path, config: Path) -> None:
    living = begin(tmp_path, "GCSA", NOON, {}, config)
    begin(tmp_path, "GCSA", NOON + timedelta(seconds=2), {}, config)
    assert living.is_dir()


def test_a_folder_that_another_process_is_just_making_stays(tmp_path: Path, config: Path) -> None:
    made = tmp_path / "20260517T120000Z-GCSA"
    made.mkdir()
    begin(tmp_path, "GCSA", NOON, {}, config)
    assert made.is_dir()


def _begun_and_over(base: Path, who: str, utc: datetime, config: Path) -> Path:
    """A run that begins and ends: by another process, as nothing but its end lets go of a folder."""
    code = (
        "import sys; from datetime import datetime; from pathlib import Path; "
        "from mavproxy_handover.store.flights import begin; "
        "print(begin(Path(sys.argv[1]), sys.argv[2], datetime.fromisoformat(sys.argv[3]), {}, Path(sys.argv[4])))"
    )
    words = [sys.executable, "-c", code, str(base), who, utc.isoformat(), str(config)]
    return Path(subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip())


def test_a_folder_is_held_as_long_as_anything_of_its_run_lives(tmp_path: Path, config: Path) -> None:
    """The process that begins it becomes another one, as `handover station` does."""
    program = (
        "import os, sys\nfrom datetime import datetime, timezone\nfrom pathlib import Path\n"
        "from mavproxy_handover.store.flights import begin\n"
        "begin(Path(sys.argv[1]), 'GCSA', datetime.now(timezone.utc), {}, Path(sys.argv[2]))\n"
        "os.execv('/bin/cat', ['cat'])\n"
    )
    base = tmp_path / "flights"
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(base), str(config)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(b"x\n")
    process.stdin.flush()
    assert process.stdout.readline() == b"x\n"
    (held,) = flights(base)
    assert held.held
    assert main(["prune", "--logs", str(base), "--keep-days", "0", "--keep-gb", "0"]) == 0
    assert held.path.is_dir()
    process.communicate()
    (free,) = flights(base)
    assert not free.held


def test_what_a_folder_holds_is_its_size_and_its_end(tmp_path: Path, config: Path) -> None:
    folder = begin(tmp_path / "flights", "drone-1", NOON, {}, config)
    (folder / "mission").mkdir()
    (folder / "mission" / "a.plan").write_bytes(b"x" * 1000)
    os.utime(folder / "mission" / "a.plan", (4e9, 4e9))
    (found,) = flights(tmp_path / "flights")
    assert found.size >= 1000
    assert found.ended == datetime.fromtimestamp(4e9, timezone.utc)


@pytest.mark.parametrize(
    ("days", "most", "gone"),
    [
        (30.0, 1e9, []),
        (10.0, 1e9, ["a"]),
        (1.9, 1e9, ["a", "b"]),
        (30.0, 600, []),
        (30.0, 599, ["a"]),
        (30.0, 300, ["a", "b"]),
        (30.0, 0, ["a", "b", "d"]),
        (0.0, 0, ["a", "b", "d"]),
        (10.0, 400, ["a", "b"]),
    ],
)
def test_the_oldest_go_first_and_one_that_is_held_never(days: float, most: float, gone: list[str]) -> None:
    found = [flight("a", 11.0, 100), flight("b", 2.0, 200), flight("c", 1.0, 200, held=True), flight("d", 0.5, 100)]
    assert [each.path.name for each in to_go(reversed(found), NOON, days, most)] == gone


def test_a_folder_that_cannot_be_deleted_is_said_and_the_others_go(
    tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    base = tmp_path / "flights"
    for hour in range(2):
        folder = base / f"20260517T1{hour}0000Z-drone-1"
        folder.mkdir(parents=True)
        (folder / "x.tlog").write_bytes(b"1234")
    real = module.delete

    def stubborn(one: Flight) -> None:
        if "T10" in one.path.name:
            raise OSError(30, "Read-only file system", str(one.path))
        real(one)

    monkeypatch.setattr("mavproxy_handover.cli.logs.delete", stubborn)
    assert main(["prune", "--logs", str(base), "--keep-days", "0", "--dry-run"]) == 0
    assert capsys.readouterr().out.count("would go") == 2
    assert main(["prune", "--logs", str(base), "--keep-days", "0"]) == 1
    captured = capsys.readouterr()
    assert "Read-only file system" in captured.err
    assert "deleted" in captured.out
    assert [path.name for path in base.iterdir()] == ["20260517T100000Z-drone-1"]


def test_the_list_for_people_and_for_programs(tmp_path: Path, config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = tmp_path / "flights"
    folder = begin(base, "drone-1", NOON, {}, config)
    assert main(["--logs", str(base)]) == 0
    head, row = capsys.readouterr().out.splitlines()
    assert head.split("  ")[0] == "begun (UTC)"
    assert row.split("  ")[0] == "2026-05-17 12:00:00"
    assert "goes on" in row
    assert main(["list", "--logs", str(base), "--json"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)
    assert (entry["path"], entry["who"], entry["goes_on"]) == (str(folder), "drone-1", True)


@pytest.mark.parametrize("words", [["prune", "--keep-days", "-1"], ["prune", "--keep-gb", "nan"], ["burn"]])
def test_bad_usage_deletes_nothing(words: list[str], tmp_path: Path, config: Path) -> None:
    base = tmp_path / "flights"
    begin(base, "drone-1", NOON, {}, config)
    assert main([*words, "--logs", str(base)]) == 2
    assert len(flights(base)) == 1


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--logs", str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err == f"handover logs: {tmp_path / 'none'}: No such file or directory\n"


def test_a_deletion_that_is_cut_short_leaves_no_half_flight(
    tmp_path: Path, config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = tmp_path / "flights"
    begin(base, "drone-1", NOON, {}, config)

    def cut(_path: Path) -> None:
        raise OSError(5, "Input/output error", "x")

    monkeypatch.setattr(module.shutil, "rmtree", cut)
    with pytest.raises(OSError, match="Input/output"):
        delete(flights(base)[0])
    assert flights(base) == []


def run_folder(base: Path, name: str, ended: datetime) -> Path:
    """A run that is over, with one file that was last written then."""
    folder = base / name
    folder.mkdir(parents=True)
    (folder / "x.jsonl").write_text("{}\n")
    for path in (folder / "x.jsonl", folder):
        os.utime(path, (ended.timestamp(), ended.timestamp()))
    return folder


def test_the_newest_flight_is_all_runs_that_overlap_in_time(tmp_path: Path) -> None:
    """GCSB's terminal was closed and started anew: the last folder is its own, and holds no flight by itself."""
    minute = timedelta(minutes=1)
    run_folder(tmp_path, "20260517T100000Z-drone-1", NOON - 60 * minute)  # the flight before
    companion = run_folder(tmp_path, "20260517T120000Z-drone-1", NOON + 30 * minute)
    station = run_folder(tmp_path, "20260517T120100Z-GCSA", NOON + 31 * minute)
    killed = run_folder(tmp_path, "20260517T120200Z-GCSB", NOON + 10 * minute)
    again = run_folder(tmp_path, "20260517T121500Z-GCSB", NOON + 29 * minute)
    assert latest_flight(tmp_path) == [station, companion, again, killed]

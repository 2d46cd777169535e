# SPDX-License-Identifier: GPL-3.0-or-later

"""The journal: every entry a line, whatever the disk does; the newest always there."""

from __future__ import annotations

import json
import os
import resource
import signal
import threading
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mavproxy_handover.store import journal as journal_file
from mavproxy_handover.store.journal import Journal

WAIT_S = 10.0


def settled(journal: Journal) -> Journal:
    """What was given is in the file, or lost."""
    assert journal.wait_until_written(WAIT_S)
    return journal


def entries(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.jsonl"


@pytest.fixture
def disk() -> Iterator[Any]:
    """Sets how long a file may grow, as a full disk does; the kernel then writes what still fits."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    signal.signal(signal.SIGXFSZ, before)


def test_an_entry_has_both_times_who_and_what(path: Path) -> None:
    journal = Journal(path, "drone-1")
    journal.write("zone_entered", "zone of GCSB entered", station="GCSB", reason=None, duration_s=1.5)
    settled(journal)
    (entry,) = entries(path)
    assert list(entry) == ["t", "utc", "who", "event", "text", "station", "duration_s"]
    assert isinstance(entry["t"], float)
    assert datetime.fromisoformat(entry["utc"]).utcoffset() is not None
    assert (entry["who"], entry["event"], entry["text"]) == ("drone-1", "zone_entered", "zone of GCSB entered")
    assert (entry["station"], entry["duration_s"]) == ("GCSB", 1.5)


def test_an_entry_is_in_the_file_a_moment_later(path: Path) -> None:
    """Nobody has to ask for it: a process that is killed takes nothing with it but its last moment."""
    journal = Journal(path, "a")
    journal.write("one")
    until = time.monotonic() + WAIT_S
    while not path.read_text() and time.monotonic() < until:
        time.sleep(0.001)
    assert [entry["event"] for entry in entries(path)] == ["one"]


def test_a_note_comes_with_the_next_entry_in_its_place_and_with_its_time(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 100.0
    monkeypatch.setattr(
        "mavproxy_handover.store.journal.time", SimpleNamespace(monotonic=lambda: now, time=lambda: now)
    )
    journal = Journal(path, "a")
    journal.note("one", "text", value=1)
    now = 101.5
    assert entries(path) == []
    journal.write("two")
    settled(journal)
    first, second = entries(path)
    assert (first["event"], first["text"], first["value"], first["t"]) == ("one", "text", 1, 100.0)
    assert (second["event"], second["t"]) == ("two", 101.5)
    assert first["utc"] == "1970-01-01T00:01:40.000+00:00"


@pytest.mark.parametrize("writes", ["flush", "close"])
def test_notes_are_in_the_file_after(path: Path, writes: str) -> None:
    journal = Journal(path, "a")
    journal.note("one")
    journal.note("two")
    getattr(journal, writes)()
    settled(journal)
    assert [entry["event"] for entry in entries(path)] == ["one", "two"]
    journal.close()
    assert len(entries(path)) == 2
    assert journal.lost == 0


def test_a_clock_beyond_all_years_costs_one_entry(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal(path, "a")
    journal.note("before")
    with monkeypatch.context() as odd:
        odd.setattr("mavproxy_handover.store.journal.time", SimpleNamespace(monotonic=lambda: 1.0, time=lambda: 1e18))
        journal.note("odd")
    journal.write("after")
    settled(journal)
    assert [entry["event"] for entry in entries(path)] == ["before", "journal_lost", "after"]
    assert journal.lost == 1


def test_notes_that_nobody_flushes_do_not_pile_up(path: Path) -> None:
    journal = Journal(path, "a")
    for number in range(255):
        journal.note("note", number=number)
    assert entries(path) == []
    journal.note("note", number=255)
    assert journal._writer.wait_until_written(WAIT_S)
    assert [entry["number"] for entry in entries(path)] == list(range(256))


def test_text_and_values_may_hold_anything(path: Path) -> None:
    journal = Journal(path, "a")
    journal.write("odd", 'line\nbreak "quotes" ünïcode \ud800 \0', value=b"\xff", path=Path("/x"))
    settled(journal)
    (entry,) = entries(path)
    assert entry["text"] == 'line\nbreak "quotes" ünïcode \ud800 \0'
    assert (entry["value"], entry["path"]) == ("b'\\xff'", "/x")
    assert path.read_text(encoding="utf-8").count("\n") == 1


def test_a_value_that_cannot_be_written_is_counted_and_does_not_raise(path: Path) -> None:
    class Odd:
        def __str__(self) -> str:
            raise ValueError

    circle: list[Any] = []
    circle.append(circle)
    journal = Journal(path, "a")
    journal.write("odd", value=circle)
    journal.write("odd", value={(1, 2): 3})
    journal.write("odd", value=Odd())
    journal.write("fine")
    settled(journal)
    assert journal.lost == 3
    *told, fine = entries(path)
    assert fine["event"] == "fine"
    assert {entry["event"] for entry in told} == {"journal_lost"}
    assert sum(entry["count"] for entry in told) == 3
    assert told[-1]["text"] == f"{told[-1]['count']} entries are missing here: the disk was full or too slow"


def test_a_full_disk_is_counted_and_does_not_raise() -> None:
    journal = Journal(Path("/dev/full"), "a")
    for _ in range(3):
        journal.write("event", "text")
    journal.close()
    assert journal.lost == 3


def test_after_a_full_disk_the_journal_goes_on_and_a_cut_entry_is_a_line_by_itself(path: Path, disk: Any) -> None:
    journal = Journal(path, "a")
    journal.write("before")
    settled(journal)
    size = path.stat().st_size
    disk(size + 20)
    journal.write("cut")
    journal.write("lost")
    settled(journal)
    assert journal.lost == 2
    disk(None)
    journal.write("after")
    journal.write("last")
    settled(journal)
    lines = path.read_text().splitlines()
    told = [json.loads(line) for line in (lines[0], *lines[2:])]
    assert [entry["event"] for entry in told] == ["before", "journal_lost", "after", "last"]
    assert told[1]["count"] == 2
    assert len(lines[1]) == 20
    assert journal.lost == 2


def test_a_line_that_a_power_failure_cut_spoils_no_entry_of_the_next_flight(path: Path) -> None:
    path.write_text('{"event": "first"}\n{"event": "cu')
    journal = Journal(path, "a")
    journal.write("next")
    settled(journal)
    lines = path.read_text().splitlines()
    assert lines[:2] == ['{"event": "first"}', '{"event": "cu']
    assert json.loads(lines[2])["event"] == "next"


def test_a_full_file_moves_aside_and_the_newest_entries_stay(path: Path) -> None:
    journal = Journal(path, "a", max_bytes=1000)
    for number in range(100):
        journal.write("event", number=number)
    settled(journal)
    old = path.with_name("journal.jsonl.1")
    assert path.stat().st_size <= 1000
    assert old.stat().st_size <= 1000
    numbers = [entry["number"] for entry in (*entries(old), *entries(path))]
    assert numbers == list(range(numbers[0], 100))
    assert len(numbers) >= 10
    assert journal.lost == 0


def test_an_entry_longer_than_the_cap_is_written_all_the_same(path: Path) -> None:
    journal = Journal(path, "a", max_bytes=100)
    journal.write("long", "x" * 500)
    settled(journal)
    assert entries(path)[0]["text"] == "x" * 500


def test_a_file_that_cannot_be_moved_aside_grows_on(path: Path) -> None:
    path.with_name("journal.jsonl.1").mkdir()
    journal = Journal(path, "a", max_bytes=300)
    for number in range(10):
        journal.write("event", number=number)
    settled(journal)
    assert [entry["number"] for entry in entries(path)] == list(range(10))
    assert journal.lost == 0


def test_a_second_run_appends(path: Path) -> None:
    first = Journal(path, "a")
    first.write("one")
    first.close()
    second = Journal(path, "a")
    second.write("two")
    settled(second)
    assert [entry["event"] for entry in entries(path)] == ["one", "two"]


def test_entries_after_close_are_counted(path: Path) -> None:
    journal = Journal(path, "a")
    journal.close()
    journal.write("late")
    journal.close()
    assert journal.lost == 1
    assert path.read_text() == ""


def test_the_folder_is_made(tmp_path: Path) -> None:
    Journal(tmp_path / "a" / "b" / "j.jsonl", "a").write("one")
    assert (tmp_path / "a" / "b" / "j.jsonl").exists()


def test_in_flight_a_place_that_cannot_be_written_is_no_error_and_is_tried_again(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("a file in the way")
    path = tmp_path / "logs" / "journal.jsonl"
    journal = Journal(path, "drone-1", strict=False)
    journal.write("first")
    assert journal.wait_until_written(5.0)
    assert journal.lost == 1
    (tmp_path / "logs").unlink()
    journal.write("second")
    assert journal.wait_until_written(5.0)
    journal.close()
    assert [json.loads(line)["event"] for line in path.read_text().splitlines()] == ["journal_lost", "second"]


def test_a_place_that_cannot_be_written_is_told_before_the_flight(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        Journal(tmp_path, "a")


class TestADiskThatHangs:
    """Whoever writes is not held up, and memory is bounded; what found no room is told of."""

    @pytest.fixture
    def free(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
        """The disk hangs until this is set."""
        free, write = threading.Event(), os.write

        def hanging(descriptor: int, data: bytes) -> int:
            assert threading.current_thread() is not threading.main_thread(), "the disk is waited for"
            assert free.wait(WAIT_S)
            return write(descriptor, data)

        monkeypatch.setattr(journal_file.os, "write", hanging)
        yield free
        free.set()

    def test_nobody_waits_and_all_is_written_in_the_end(self, path: Path, free: threading.Event) -> None:
        journal = Journal(path, "a")
        for number in range(100):
            journal.write("event", number=number)
        assert entries(path) == []
        free.set()
        settled(journal)
        assert [entry["number"] for entry in entries(path)] == list(range(100))
        assert journal.lost == 0

    def test_what_waits_is_bounded_and_what_is_over_is_counted_and_told(
        self, path: Path, free: threading.Event
    ) -> None:
        journal = Journal(path, "a")
        for number in range(6000):
            journal.write("event", number=number)
        assert 6000 - 4096 - 1 <= journal.lost <= 6000 - 4096
        lost = journal.lost
        free.set()
        settled(journal)
        journal.write("after")
        settled(journal)
        kept = entries(path)
        assert len([entry for entry in kept if entry["event"] == "event"]) == 6000 - lost
        assert [entry["count"] for entry in kept if entry["event"] == "journal_lost"] == [lost]
        assert kept[-1]["event"] == "after"

    def test_the_end_does_not_wait_for_it(self, path: Path, free: threading.Event) -> None:
        journal = Journal(path, "a")
        for _ in range(5):
            journal.write("event")
        journal.close(0.01)
        assert journal.lost >= 4, "one is with the disk, and may get there yet"
        journal.write("late")
        assert journal.lost >= 5


def test_what_the_entries_speak_of_lies_beside_them(path: Path) -> None:
    journal = Journal(path, "drone-1")
    journal.lay_beside("mission-0a1b2c3d", {"mission.toml": b'name = "one"\n', "zones.geojson": b"{}"})
    settled(journal)
    folder = path.with_name("journal-mission-0a1b2c3d")
    assert {each.name: each.read_bytes() for each in folder.iterdir()} == {
        "mission.toml": b'name = "one"\n',
        "zones.geojson": b"{}",
    }
    journal.lay_beside("mission-0a1b2c3d", {"mission.toml": b"another"})
    settled(journal)
    assert (folder / "mission.toml").read_bytes() == b'name = "one"\n'
    assert sorted(each.name for each in path.parent.iterdir()) == ["journal-mission-0a1b2c3d", "journal.jsonl"]


def test_what_cannot_be_laid_beside_it_is_told_and_leaves_nothing(path: Path, disk: Any) -> None:
    journal = Journal(path, "drone-1")
    journal.write("started")
    settled(journal)
    disk(4096)
    journal.lay_beside("mission-0a1b2c3d", {"mission.toml": b"x" * 10_000})
    settled(journal)
    disk(None)
    assert [entry["event"] for entry in entries(path)] == ["started", "not_kept"]
    assert "journal-mission-0a1b2c3d cannot be kept: File too large" in entries(path)[1]["text"]
    assert [each.name for each in path.parent.iterdir()] == ["journal.jsonl"]

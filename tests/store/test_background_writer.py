# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs for a disk: in a thread of their own, the newest of a name alone, and nobody waits for a disk that hangs."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from mavproxy_handover.store.background_writer import BackgroundWriter

WAIT_S = 10.0


class Disk:
    """Hangs until it is let go."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.began = threading.Event()
        self.free = threading.Event()

    def write(self, what: str) -> None:
        self.began.set()
        assert self.free.wait(WAIT_S)
        self.done.append(what)


@pytest.fixture
def behind() -> Iterator[BackgroundWriter]:
    behind = BackgroundWriter("test")
    yield behind
    behind.close(WAIT_S)


@pytest.fixture
def disk() -> Iterator[Disk]:
    disk = Disk()
    yield disk
    disk.free.set()


def test_a_job_is_done_in_a_thread_that_keeps_nobody_from_ending(behind: BackgroundWriter) -> None:
    seen: list[threading.Thread] = []
    assert behind.put("a", lambda: seen.append(threading.current_thread()))
    assert behind.wait_until_written(WAIT_S)
    assert seen[0] is not threading.main_thread()
    assert seen[0].daemon


def test_of_one_name_only_the_newest_job_runs_and_the_others_in_order(behind: BackgroundWriter, disk: Disk) -> None:
    behind.put("state", lambda: disk.write("state 1"))
    assert disk.began.wait(WAIT_S)
    for number in (2, 3, 4):
        behind.put("state", lambda number=number: disk.write(f"state {number}"))  # type: ignore[misc]
        behind.put("package", lambda number=number: disk.write(f"package {number}"))  # type: ignore[misc]
    assert not behind.idle
    disk.free.set()
    assert behind.wait_until_written(WAIT_S)
    assert disk.done == ["state 1", "state 4", "package 4"]
    assert behind.idle


def test_what_breaks_ends_alone(behind: BackgroundWriter) -> None:
    done: list[str] = []
    behind.put("a", lambda: {}["nothing"])
    behind.put("b", lambda: done.append("b"))
    assert behind.wait_until_written(WAIT_S)
    behind.put("c", lambda: done.append("c"))
    assert behind.wait_until_written(WAIT_S)
    assert done == ["b", "c"]


def test_a_disk_that_hangs_is_waited_for_no_longer_than_told(behind: BackgroundWriter, disk: Disk) -> None:
    behind.put("a", lambda: disk.write("a"))
    behind.put("b", lambda: disk.write("b"))
    assert not behind.wait_until_written(0.01)
    assert not behind.close(0.01)
    assert disk.done == []


def test_what_had_not_begun_when_it_was_closed_is_not_done_later(behind: BackgroundWriter, disk: Disk) -> None:
    behind.put("a", lambda: disk.write("a"))
    assert disk.began.wait(WAIT_S)
    behind.put("b", lambda: disk.write("b"))
    behind.close(0.0)
    disk.free.set()
    assert behind.wait_until_written(WAIT_S)
    assert disk.done == ["a"]


def test_the_end_waits_for_what_was_taken_and_takes_nothing_more(behind: BackgroundWriter) -> None:
    done: list[str] = []
    behind.put("a", lambda: done.append("a"))
    assert behind.close(WAIT_S)
    assert done == ["a"]
    assert not behind.put("b", lambda: done.append("b"))
    assert behind.close(WAIT_S)
    assert done == ["a"]


def test_without_room_for_a_thread_a_job_is_not_taken_and_nothing_raises(
    behind: BackgroundWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    done: list[str] = []
    with monkeypatch.context() as full:
        full.setattr(threading.Thread, "start", no_room)
        assert not behind.put("a", lambda: done.append("a"))
    assert behind.wait_until_written(0.0)
    assert behind.put("b", lambda: done.append("b"))
    assert behind.wait_until_written(WAIT_S)
    assert done == ["b"]


def test_a_job_that_raises_ends_alone_and_is_told(behind: BackgroundWriter, caplog: pytest.LogCaptureFixture) -> None:
    done: list[str] = []

    def broken() -> None:
        raise ZeroDivisionError("of the job's own")

    assert behind.put("broken", broken)
    assert behind.wait_until_written(WAIT_S)
    assert behind.put("next", lambda: done.append("next"))
    assert behind.wait_until_written(WAIT_S)
    assert done == ["next"]
    (record,) = caplog.records
    assert record.getMessage() == "test: broken failed"
    assert record.exc_info is not None
    assert isinstance(record.exc_info[1], ZeroDivisionError)

# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's log queues in the companion's process, and how its files are closed."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from MAVProxy.modules.lib import multiproc

from mavproxy_handover.supervision import tlog
from mavproxy_handover.supervision.tlog import LogQueue, close_logs, log_options, replace_queues


def test_a_queue_that_nobody_empties_stays_small_and_counts() -> None:
    queue = LogQueue(most=3)
    for number in range(5):
        queue.put(number)
    assert queue.lost == 2
    assert [queue.get() for _ in range(3)] == [0, 1, 2]
    assert queue.empty()


def test_only_mavproxy_itself_gets_such_queues(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its windows are processes of their own."""
    original = multiproc.Queue
    monkeypatch.setattr(multiproc, "Queue", original)
    replace_queues("mavproxy's script")
    ours: dict[str, Any] = {"__name__": "mavproxy's script", "multiproc": multiproc}
    others: dict[str, Any] = {"__name__": "MAVProxy.modules.mavproxy_map", "multiproc": multiproc}
    for namespace in (ours, others):
        exec("queue = multiproc.Queue()", namespace)
    assert isinstance(ours["queue"], LogQueue)
    assert type(others["queue"]) is type(original())


@pytest.fixture
def mpstate(tmp_path: Path) -> SimpleNamespace:
    return SimpleNamespace(
        logqueue=LogQueue(),
        logqueue_raw=LogQueue(),
        logfile=(tmp_path / "mav.tlog").open("wb"),
        logfile_raw=(tmp_path / "mav.tlog.raw").open("wb"),
    )


def test_what_waits_is_written_before_the_files_are_closed(mpstate: SimpleNamespace, tmp_path: Path) -> None:
    mpstate.logqueue.put(b"frame")
    mpstate.logqueue.put(b", the last")
    mpstate.logqueue_raw.put(b"bytes")
    close_logs(mpstate, 5.0)
    assert (tmp_path / "mav.tlog").read_bytes() == b"frame, the last"
    assert (tmp_path / "mav.tlog.raw").read_bytes() == b"bytes"
    assert mpstate.logfile.closed
    assert mpstate.logfile_raw.closed


def test_a_writer_that_waits_for_more_is_woken_up(mpstate: SimpleNamespace) -> None:
    """MAVProxy's waits for raw bytes, and sees the end only then."""
    writer = threading.Thread(target=mpstate.logqueue_raw.get, name="log_writer", daemon=True)
    writer.start()
    close_logs(mpstate, 10.0)
    assert not writer.is_alive()


def test_a_full_disk_is_no_reason_not_to_end(mpstate: SimpleNamespace) -> None:
    mpstate.logfile.close()
    mpstate.logfile = open("/dev/full", "wb")  # noqa: SIM115 (it is what must be closed)
    for _ in range(10):
        mpstate.logqueue.put(bytes(4096))
    close_logs(mpstate, 1.0)
    assert mpstate.logfile_raw.closed


def test_without_logs_there_is_nothing_to_close() -> None:
    close_logs(SimpleNamespace(logqueue=None, logqueue_raw=None), 1.0)


class TestInFlight:
    """MAVProxy begins its log anew, and does not start at all with less than 200 MiB free: not after a restart."""

    def test_the_log_of_before_goes_on(self, tmp_path: Path) -> None:
        (tmp_path / "a.tlog").write_bytes(b"before")
        assert log_options(["--master=x", f"--logfile={tmp_path}/a.tlog"]) == ["--append-log"]
        assert (tmp_path / "a.tlog").read_bytes() == b"before"

    def test_the_last_word_on_where_it_is_counts(self, tmp_path: Path) -> None:
        argv = [f"--logfile={tmp_path}/missing/a.tlog", f"--logfile={tmp_path}/b.tlog"]
        assert log_options(argv) == ["--append-log"]
        assert log_options(argv[::-1]) == ["--no-state"]

    def test_without_room_it_does_without(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(
            tlog.os, "statvfs", lambda _path: os.statvfs_result((4096, 4096, 0, 51_199, 0, 0, 0, 0, 0, 255))
        )
        assert log_options([f"--logfile={tmp_path}/a.tlog"]) == ["--no-state"]
        monkeypatch.setattr(
            tlog.os, "statvfs", lambda _path: os.statvfs_result((4096, 4096, 0, 51_200, 0, 0, 0, 0, 0, 255))
        )
        assert log_options([f"--logfile={tmp_path}/a.tlog"]) == ["--append-log"]

# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that dies takes its windows with it. With real processes; a window here is a process that sleeps."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

STATION = """
import multiprocessing, signal, sys, time
from gcs_module.window_watchdog import WindowWatchdog

def window():
    for ends in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(ends, lambda *_: None)  # as MAVProxy's handlers, which end no window
    while True:
        time.sleep(1)

def opened():
    each = multiprocessing.get_context("fork").Process(target=window)
    each.start()
    return each

first = opened()
watchdog = WindowWatchdog(lambda where, text: print("fault", where, text, flush=True))
watchdog.tick()
second = opened()
watchdog.tick()
print(first.pid, second.pid, watchdog.pid, flush=True)
for line in sys.stdin:
    if line.strip() == "tick":
        watchdog.tick()
    if line.strip() == "close one":
        second.kill()
        second.join()
        watchdog.tick()
    if line.strip() == "end":
        watchdog.close()
    print(watchdog.pid, flush=True)
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="windows there end with the pipe of their station")


def runs(pid: int) -> bool:
    """Whether a process lives; one that has ended and was not waited for does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


def gone(pids: list[int], within_s: float) -> bool:
    until = time.monotonic() + within_s
    while any(runs(pid) for pid in pids):
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


class Station:
    """A station with two windows, one opened before its watchdog and one after."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", STATION], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.windows = [int(word) for word in self._said().split()]
        self.watchdog = self.windows.pop()

    def _said(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def told(self, line: str) -> str:
        assert self.process.stdin is not None
        print(line, file=self.process.stdin, flush=True)
        return self._said().strip()

    def end(self) -> None:
        for pid in (self.process.pid, *self.windows, self.watchdog):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.communicate()


@pytest.fixture
def station() -> Iterator[Station]:
    made = Station()
    yield made
    made.end()


def test_the_windows_of_a_station_that_is_killed_end_within_three_seconds(station: Station) -> None:
    assert all(map(runs, station.windows))
    station.process.send_signal(signal.SIGKILL)
    assert gone(station.windows, 3.0), "they would go on showing what the dead station knew last"
    assert gone([station.watchdog], 3.0)


def test_the_windows_of_a_station_that_lives_stay(station: Station) -> None:
    time.sleep(1.0)
    assert all(map(runs, station.windows))
    station.process.send_signal(signal.SIGSTOP)  # it stands still, and is not dead
    time.sleep(1.0)
    assert all(map(runs, station.windows))
    station.process.send_signal(signal.SIGCONT)


def test_the_watchdog_ends_with_its_module_and_leaves_the_windows_alone(station: Station) -> None:
    assert station.told("end") == "None"
    assert gone([station.watchdog], 3.0)
    assert all(map(runs, station.windows))


def test_a_window_that_was_closed_is_watched_no_more(station: Station) -> None:
    station.told("close one")
    station.process.send_signal(signal.SIGKILL)
    assert gone(station.windows, 3.0)


def test_a_watchdog_that_dies_is_started_again(station: Station) -> None:
    os.kill(station.watchdog, signal.SIGKILL)
    assert gone([station.watchdog], 3.0)
    station.told("tick")
    again = int(station.told("tick"))
    assert again != station.watchdog
    station.process.send_signal(signal.SIGKILL)
    assert gone([*station.windows, again], 3.0)


def test_ctrl_c_in_the_stations_terminal_does_not_reach_the_watchdog(station: Station) -> None:
    """It goes to all programs of a terminal; the station may ask before it ends."""
    assert os.getsid(station.watchdog) == station.watchdog
    assert os.getsid(station.process.pid) != station.watchdog

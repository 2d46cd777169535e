# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs at fixed intervals: the rate holds on a busy machine, a stall is not made up for, a bug stops no other job."""

from __future__ import annotations

import pytest

from mavproxy_handover.tools.schedule import Schedule


class Bench:
    def __init__(self) -> None:
        self.runs: list[tuple[str, float]] = []
        self.faults: list[str] = []
        jobs = [("often", self.often, 0.25), ("broken job", self.broken, 1.0), ("seldom", self.seldom, 1.0)]
        self.schedule = Schedule(jobs, lambda where, _text: self.faults.append(where))

    def broken(self, now: float) -> None:
        raise RuntimeError("a bug")

    def often(self, now: float) -> None:
        self.runs.append(("often", now))

    def seldom(self, now: float) -> None:
        self.runs.append(("seldom", now))

    def run(self, *times: float) -> list[tuple[str, float]]:
        self.runs.clear()
        for now in times:
            self.schedule.run(now)
        return self.runs


def test_every_job_runs_at_once_and_then_at_its_interval() -> None:
    bench = Bench()
    assert bench.run(10.0, 10.125, 10.25, 10.5) == [
        ("often", 10.0),
        ("seldom", 10.0),
        ("often", 10.25),
        ("often", 10.5),
    ]


def test_a_job_that_comes_late_keeps_to_its_old_times() -> None:
    bench = Bench()
    bench.run(10.0)
    assert bench.run(10.375, 10.5, 10.75) == [("often", 10.375), ("often", 10.5), ("often", 10.75)]


def test_what_was_missed_in_a_stall_is_not_made_up_for() -> None:
    bench = Bench()
    bench.run(10.0)
    assert bench.run(15.0, 15.125, 15.25) == [("often", 15.0), ("seldom", 15.0), ("often", 15.25)]


def test_a_job_that_breaks_is_told_by_its_name_and_stops_no_other() -> None:
    bench = Bench()
    assert bench.run(10.0) == [("often", 10.0), ("seldom", 10.0)]
    assert bench.faults == ["broken job"]


def times(interval_s: float, number: int, ticks: int = 64) -> list[float]:
    """When the job of that number ran, 32 times a second being asked."""
    found: list[float] = []
    jobs = [("other", lambda now: None, 1.0)] * number + [("last", found.append, interval_s)]
    schedule = Schedule(jobs, lambda *_: None)
    for tick in range(ticks):
        schedule.run(10.0 + tick / 32.0)
    return [at - 10.0 for at in found]


def test_jobs_are_a_tick_apart_after_the_first_time() -> None:
    assert times(1.0, 0) == [0.0, 1.0]
    assert times(1.0, 1) == [0.0, pytest.approx(1.05, abs=1 / 32)]
    assert times(1.0, 4) == [0.0, pytest.approx(1.2, abs=1 / 32)]
    assert times(0.5, 4) == [0.0, *(pytest.approx(at, abs=1 / 32) for at in (0.7, 1.2, 1.7))]


def test_no_job_is_put_off_by_as_much_as_its_interval() -> None:
    assert times(0.5, 12) == [0.0, *(pytest.approx(at, abs=1 / 32) for at in (0.6, 1.1, 1.6))]

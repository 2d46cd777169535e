# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs beside the main loop: one at a time, and what came of each is handed over where it belongs."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from mavproxy_handover.tools.worker import LONGEST_S, MOST_LEFT, TURN_S, Worker


class Held:
    """Runs jobs when the test says so."""

    def __init__(self) -> None:
        self.jobs: list[Callable[[], None]] = []
        self.came: list[tuple[Any, float]] = []
        self.worker = Worker(self.jobs.append)

    def submit(self, job: Callable[[], Any]) -> bool:
        return self.worker.submit(job, lambda result, now: self.came.append((result, now)))


def test_what_came_of_a_job_is_handed_over_by_the_next_tick() -> None:
    held = Held()
    assert held.submit(lambda: 42)
    held.worker.tick(1.0)
    assert (held.came, held.worker.busy) == ([], True)
    held.jobs.pop()()
    assert held.came == [], "not in the thread that worked"
    held.worker.tick(2.0)
    assert (held.came, held.worker.busy) == ([(42, 2.0)], False)
    held.worker.tick(3.0)
    assert len(held.came) == 1


def test_a_second_job_is_not_taken_until_the_first_is_handed_over() -> None:
    held = Held()
    assert held.submit(lambda: 1)
    assert not held.submit(lambda: 2)
    held.jobs.pop()()
    assert not held.submit(lambda: 3)
    held.worker.tick(1.0)
    assert held.submit(lambda: 4)
    held.jobs.pop()()
    held.worker.tick(2.0)
    assert [result for result, _now in held.came] == [1, 4]


def test_a_job_that_breaks_is_handed_over_as_what_broke_it() -> None:
    held = Held()
    held.submit(lambda: {}["nothing"])
    held.jobs.pop()()
    held.worker.tick(1.0)
    ((error, _now),) = held.came
    assert isinstance(error, KeyError)
    assert held.submit(lambda: 1), "and the next one is taken"


def test_it_works_in_a_thread_of_its_own_that_keeps_nobody_from_ending() -> None:
    seen: list[threading.Thread] = []
    done = threading.Event()

    def job() -> None:
        seen.append(threading.current_thread())
        done.set()

    worker = Worker()
    worker.submit(job, lambda _result, _now: None)
    assert done.wait(10.0)
    assert seen[0] is not threading.main_thread()
    assert seen[0].daemon


def test_what_the_receiver_raises_does_not_stop_the_worker() -> None:
    held = Held()

    def broken(_result: Any, _now: float) -> None:
        raise RuntimeError("planted")

    held.worker.submit(lambda: 1, broken)
    held.jobs.pop()()
    try:
        held.worker.tick(1.0)
    except RuntimeError:
        pass
    assert not held.worker.busy


class TestAJobThatDoesNotEnd:
    """A package that takes for ever to read must not keep out all others."""

    @staticmethod
    def given_up(held: Held, at: float) -> Callable[[], None]:
        """One job more that is given up; returns what ends it after all."""
        assert held.submit(lambda: "late")
        held.worker.tick(at)
        held.worker.tick(at + LONGEST_S)
        return held.jobs.pop()

    def test_has_failed_after_a_while_and_the_next_one_is_taken(self) -> None:
        held = Held()
        held.submit(lambda: 1)
        held.worker.tick(100.0)
        held.worker.tick(100.0 + LONGEST_S - 0.1)
        assert held.came == []
        held.worker.tick(100.0 + LONGEST_S)
        ((error, now),) = held.came
        assert isinstance(error, TimeoutError)
        assert str(error) == "not done within 30 s"
        assert now == 100.0 + LONGEST_S
        assert held.submit(lambda: 2)

    def test_what_comes_of_it_later_goes_to_nobody(self) -> None:
        held = Held()
        late = self.given_up(held, 0.0)
        held.submit(lambda: "next")
        late()
        held.worker.tick(50.0)
        assert len(held.came) == 1, "the one that was given up"
        held.jobs.pop()()
        held.worker.tick(51.0)
        assert held.came[1:] == [("next", 51.0)]

    def test_of_such_there_are_a_few_at_most(self) -> None:
        held = Held()
        ends = [self.given_up(held, 100.0 * number) for number in range(MOST_LEFT)]
        assert not held.submit(lambda: "one more")
        ends[0]()
        held.worker.tick(1000.0)
        assert held.submit(lambda: "one more")
        held.jobs.pop()()
        held.worker.tick(1001.0)
        assert held.came[-1] == ("one more", 1001.0)


class TestTurns:
    """With Python's own turns of 5 ms each call of the main loop would take that much longer while a job runs."""

    @pytest.fixture(autouse=True)
    def usual(self) -> Iterator[None]:
        before = sys.getswitchinterval()
        sys.setswitchinterval(0.004)
        yield
        sys.setswitchinterval(before)

    def test_are_short_while_a_job_runs_and_as_before_after_it(self) -> None:
        held = Held()
        held.submit(lambda: 1)
        assert sys.getswitchinterval() == pytest.approx(TURN_S, rel=0.01)
        held.worker.tick(1.0)
        assert sys.getswitchinterval() == pytest.approx(TURN_S, rel=0.01)
        held.jobs.pop()()
        held.worker.tick(2.0)
        assert sys.getswitchinterval() == pytest.approx(0.004, rel=0.01)

    def test_and_while_one_that_was_given_up_goes_on(self) -> None:
        held = Held()
        late = TestAJobThatDoesNotEnd.given_up(held, 0.0)
        assert sys.getswitchinterval() == pytest.approx(TURN_S, rel=0.01)
        held.submit(lambda: 2)
        held.jobs.pop()()
        held.worker.tick(100.0)
        assert sys.getswitchinterval() == pytest.approx(TURN_S, rel=0.01)
        late()
        held.worker.tick(101.0)
        assert sys.getswitchinterval() == pytest.approx(0.004, rel=0.01)

# SPDX-License-Identifier: GPL-3.0-or-later

"""How long a step of a scenario may take, in simulated time and on the wall clock."""

from __future__ import annotations

from sitl.run.step_limit import StepLimit
from sitl.script.scenario import Step
from sitl.script.steps import Pause


def limit(timeout_s: float | None, timeout_wall_s: float | None = None, *, follows: bool = True) -> StepLimit:
    """The limit of a step that begins at 100 s of simulated time, 1000 s of the wall clock."""
    step = Step(1, Pause(1.0), timeout_s=timeout_s, timeout_wall_s=timeout_wall_s)
    return StepLimit(step, 100.0, 1000.0, follows=follows)


def test_a_limit_is_of_simulated_seconds() -> None:
    step = limit(20.0)
    assert step.passed(120.0, 1003.0) == ""
    assert step.passed(120.1, 1003.1) == "not within 20 s"


def test_a_limit_on_the_wall_clock_is_one() -> None:
    step = limit(None, 5.0)
    assert step.passed(140.0, 1005.0) == ""
    assert step.passed(140.0, 1005.1) == "not within 5 s of the wall clock"


def test_a_step_keeps_its_time_on_a_busy_machine() -> None:
    step = limit(20.0)
    for seconds in range(20):  # a simulated second takes half a minute of the wall clock
        assert step.passed(100.0 + seconds, 1000.0 + 30.0 * seconds) == ""
    assert step.passed(120.1, 1600.0) == "not within 20 s"


def test_a_vehicle_that_stops_simulating_ends_the_step() -> None:
    step = limit(20.0)
    assert step.passed(103.0, 1010.0) == ""
    assert step.passed(103.0, 1070.0) == ""
    assert step.passed(103.0, 1070.1) == "simulated time has stood still for 60 s"


def test_a_step_by_the_wall_clock_takes_no_more_than_two_and_a_half_times_its_limit() -> None:
    step = limit(20.0, follows=False)
    assert step.passed(110.0, 1065.0) == ""
    assert step.passed(110.0, 1065.1) == "not within 65 s of the wall clock"

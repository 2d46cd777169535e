# SPDX-License-Identifier: GPL-3.0-or-later

"""End to end: real MAVProxy processes, the guard, and the embedded vehicle, by the command that a user types.

Each flight is judged by its scenario. Checked here beside that is what the user gets: the exit code, one JSON object,
the report and its pictures, and no process left behind.

These flights take longest of all tests here: in a file of their own they begin early. The longest are flown by `--long`
only; `make demo` flies one of them, `make scenarios` all.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl.script.scenario import known_scenarios
from tests.sitl.runner_flight import COMMANDERS, ON_ARDUCOPTER, ON_THE_BUILT_IN, Start, check, fly, starting

start = pytest.fixture(starting)

#: "partner-address" shows start, handover and landing as "nominal" does, in a third of the time; a return out of
#: coverage is tested in `tests/module` too, a guard that has another key in `tests/lua`
LONG = ("nominal", "out-of-coverage", "guard-key-other")


def test_what_is_flown_here_are_scenarios_that_ship() -> None:
    assert set(COMMANDERS) <= set(known_scenarios())
    assert {*ON_ARDUCOPTER, *ON_THE_BUILT_IN} == set(COMMANDERS)


@pytest.mark.process
@pytest.mark.parametrize(
    "scenario",
    [pytest.param(name, marks=[pytest.mark.long] if name in LONG else []) for name in sorted(ON_THE_BUILT_IN)],
)
def test_on_the_built_in_vehicle(start: Start, scenario: str, tmp_path: Path) -> None:
    check(fly(start, "builtin", scenario, tmp_path / "run"), scenario, tmp_path / "run")

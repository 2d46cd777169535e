# SPDX-License-Identifier: GPL-3.0-or-later

"""The same as `test_built_in_scenarios.py` on ArduCopter: the very guard, on the very autopilot."""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl.vehicles import find_arducopter
from tests.sitl.runner_flight import ON_ARDUCOPTER, Start, check, fly, starting

start = pytest.fixture(starting)


@pytest.mark.sitl
@pytest.mark.parametrize("scenario", sorted(ON_ARDUCOPTER))
def test_on_arducopter(start: Start, scenario: str, tmp_path: Path) -> None:
    if find_arducopter() is None:
        pytest.skip("no ArduCopter SITL program ($ARDUCOPTER, PATH, ~/ardupilot/build/sitl/bin)")
    check(fly(start, "arducopter", scenario, tmp_path / "run"), scenario, tmp_path / "run")

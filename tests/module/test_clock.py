# SPDX-License-Identifier: GPL-3.0-or-later

"""The wall clock is set in flight (GPS time arrives, NTP steps): nothing changes but what the journal says of it."""

from __future__ import annotations

import time

import pytest

from mavproxy_handover import companion, narrator
from mavproxy_handover.autopilot import telemetry
from mavproxy_handover.core.model import Phase
from mavproxy_handover.stations import port
from mavproxy_handover.store import journal
from tests.module.conftest import Bench, Clock
from tests.module.test_handover import IN_BOTH, flight  # noqa: F401  (a fixture)

YEAR_S = 365 * 86400.0


class Wall:
    """Stands in for the module `time` where a module of ours asks for the time of day."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.offset_s = 1.7e9

    strftime = staticmethod(time.strftime)

    def monotonic(self) -> float:
        return self._clock.now

    def time(self) -> float:
        return self._clock.now + self.offset_s


@pytest.fixture
def wall(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall(clock)
    for module in (companion, journal, narrator, port, telemetry):
        if hasattr(module, "time"):
            monkeypatch.setattr(module, "time", wall)
    return wall


@pytest.mark.parametrize("step_s", [YEAR_S, 3600.0, 1.1, -1.1, -3600.0, -YEAR_S])
def test_a_step_in_the_middle_of_a_handover_is_journalled_and_changes_nothing(
    wall: Wall,
    flight: Bench,  # noqa: F811
    step_s: float,
) -> None:
    flight.run(2.0)
    flight.autopilot.position = IN_BOTH
    flight.until(lambda: flight.companion.view.phase is Phase.ON_HANDOVER)
    wall.offset_s += step_s
    flight.run(1.5)
    assert flight.companion.view.commander == 252
    (entry,) = flight.journal("clock_step")
    assert entry["text"] == f"the clock was set by {step_s:+.1f} s"
    (committed,) = flight.journal("transfer_committed")
    assert 0.0 <= committed["duration_s"] < 1.0
    assert flight.journal("authority_lost") == flight.journal("position_stale") == flight.journal("emergency") == []
    times = [entry["t"] for entry in flight.journal()]
    assert times == sorted(times)
    flight.run(10.0)
    assert len(flight.journal("clock_step")) == 1
    assert flight.companion.view.epoch == 2


def test_a_clock_that_is_slewed_is_not_told_of(wall: Wall, flight: Bench) -> None:  # noqa: F811
    for _ in range(10):
        wall.offset_s += 0.5
        flight.run(1.0)
    assert flight.journal("clock_step") == []
